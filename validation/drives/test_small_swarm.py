"""A swarm search that is too small for its region, and one that is repeated."""

from pathlib import Path

import numpy as np

from canon.site import Site
from lgprjax.pso import SwarmConfig
from lgprjax.registration import SEARCH_SWARM
from registration.test_swarm_search import first_metres, ok_of, searched


def test_a_place_that_no_swarm_finds_is_no_fix(site: Site, tmp_path: Path) -> None:
    """A swarm too small for its region: it may miss places, and believes none that it did not find."""
    drive = searched(site, first_metres(site, "live", tmp_path, scans=120), SwarmConfig(particles=8, iterations=4))
    assert drive.truth is not None
    error_m = np.hypot(*(np.asarray(drive.fix.pose) - drive.truth)[:, :2].T)
    assert not ok_of(drive).all()
    assert np.all(error_m[ok_of(drive)] < 0.3)


def test_the_seed_decides(site: Site, tmp_path: Path) -> None:
    path = first_metres(site, "live", tmp_path)
    one, again = (searched(site, path, SEARCH_SWARM) for _ in range(2))
    np.testing.assert_array_equal(np.asarray(one.fix.pose), np.asarray(again.fix.pose))


def test_other_ground_has_no_place(site: Site, tmp_path: Path) -> None:
    assert not ok_of(searched(site, first_metres(site, "impostor", tmp_path, scans=60), SEARCH_SWARM)).any()
