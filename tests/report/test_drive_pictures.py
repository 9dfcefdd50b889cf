"""The pictures of a registered drive: those that its knowledge allows, and what they say of a fix."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from generated import Site, register_site
from lgprjax.batch import RegisteredDrive, example_scan, fix_example
from lgprjax.formats import DriveLog, MapFile
from lgprjax.pso import SwarmConfig
from lgprjax.registration import RegisterOptions
from lgprjax.report.registered import draw_drive, drive_result

SWARM = RegisterOptions(search_m=1.5, swarm=SwarmConfig(particles=32, iterations=12))


@pytest.fixture(scope="module")
def live(site: Site) -> RegisteredDrive:
    return register_site(site, "live")


def drawn(site: Site, drive: RegisteredDrive, options: RegisterOptions, folder: Path, *, impostor: bool) -> set[str]:
    with MapFile.open(site.map) as source, DriveLog.open(site.logs["live"]) as log:
        result = drive_result(drive, source, impostor=impostor)
        figures = draw_drive(result, drive, source, log, options, folder, False)
    assert {figure.path.name for figure in figures} | {"live-scans.html"} == {path.name for path in folder.iterdir()}
    return {figure.path.name.removeprefix("live-") for figure in figures}


def test_a_swarm_is_drawn_where_one_searches(site: Site, live: RegisteredDrive, tmp_path: Path) -> None:
    whole = {"trajectory.png", "confidence.png", "match.png", "map.png", "swarm.png"}
    assert drawn(site, live, SWARM, tmp_path, impostor=False) == whole


def test_nothing_is_said_of_confidence_where_no_truth_is_known(
    site: Site, live: RegisteredDrive, tmp_path: Path
) -> None:
    blind, impostor = tmp_path / "blind", tmp_path / "impostor"
    blind.mkdir()
    impostor.mkdir()
    left = {"trajectory.png", "match.png", "map.png"}
    plain = RegisterOptions(search_m=1.5)
    assert drawn(site, replace(live, truth=None), plain, blind, impostor=False) == left
    assert drawn(site, live, plain, impostor, impostor=True) == left


def test_the_swarm_of_an_example_ends_at_its_fix(site: Site, live: RegisteredDrive) -> None:
    scan = example_scan(live)
    assert scan is not None
    with MapFile.open(site.map) as source, DriveLog.open(site.logs["live"]) as log:
        example = fix_example(source, log, live, SWARM, scan)
    assert example is not None
    assert example.swarm is not None
    assert np.hypot(*(np.asarray(example.swarm.best_m)[-1] - example.best_m)) < 0.04
    met = np.asarray(example.swarm.best_score)
    assert met.shape == (13, 32)
    assert met[-1].max() == pytest.approx(float(live.fix.correlation[scan]), abs=0.05)
    # The rival stands on the surface, apart from the best place.
    assert example.second_m is not None
    assert 0.2 < np.hypot(*(example.second_m - example.best_m)) < 5.0
    # The road runs east: the tile's frame lies along it.
    assert abs(np.degrees(example.frame[2])) < 5.0
