"""What a map says its own matches err by: baselines left out one by one and registered on the others."""

from pathlib import Path

import numpy as np
import pytest

from canon.site import Site
from lgprjax.batch.chance import OtherBaselines, measure_chance
from lgprjax.formats import MapFile
from lgprjax.registration import POOLED
from plane_ground import STEP_M, write_plane_map


def test_baselines_over_one_another_say_what_matches_err_by(site: Site) -> None:
    with MapFile.open(site.map) as source:
        chance = source.chance
    assert chance is not None
    # Two baselines of 40 m half beside each other: ten pieces each, less those at which no fix was ok.
    assert 10 <= chance.left_out <= 20
    assert 1.0 <= chance.sigma_scale <= 2.0
    assert chance.sigma_scale != POOLED.sigma_scale


def test_the_baseline_that_is_left_out_holds_no_data(site: Site) -> None:
    with MapFile.open(site.map) as source:
        others = OtherBaselines(source, 1)
        some = np.flatnonzero(source.drive == 1)[5:9]
        kept = np.flatnonzero(source.drive == 0)[5:9]
        assert not others.read_stations(some).valid.any()
        np.testing.assert_array_equal(others.read_stations(kept).profile, source.read_stations(kept).profile)


def test_left_out_baselines_tell_the_scatter_of_labels(tmp_path: Path) -> None:
    """Five drives over one another, each of whose labels is off by a vector of its own."""
    along = np.arange(0.0, 20.0, STEP_M)
    offset = 0.08 * np.random.default_rng(8).standard_normal((5, 2))
    truth = [np.stack([along, np.full_like(along, 0.1 * n), np.zeros_like(along)], axis=1) for n in range(5)]
    label = [pose + [*off, 0.0] for pose, off in zip(truth, offset, strict=True)]
    write_plane_map(tmp_path / "a.map.h5", truth, label, sigma_m=0.05)
    with MapFile.open(tmp_path / "a.map.h5") as source:
        found = measure_chance(source).label_scatter_m
    # Of each and the mean of the others: the sample's own standard deviation.
    true = float(np.sqrt(np.mean(np.var(offset, axis=0, ddof=1))))
    assert found == pytest.approx(true, rel=0.35, abs=0.015)


def test_two_baselines_tell_no_scatter(site: Site) -> None:
    with MapFile.open(site.map) as source:
        assert source.chance is not None
        assert source.chance.label_scatter_m == 0.0
