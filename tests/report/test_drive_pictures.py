"""The pictures of a registered drive: those that its knowledge allows, and what they say of a fix."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure

from canon.site import Site, register_site
from lgprjax.batch import RegisteredDrive, example_scan, fix_example, settings_of, write_registered
from lgprjax.batch.assumptions import is_baseline
from lgprjax.formats import DriveLog, MapFile
from lgprjax.pso import SwarmConfig
from lgprjax.registration import RegisterOptions, Thresholds
from lgprjax.report import DriveResult, drive_section
from lgprjax.report.registered import (
    Registered,
    draw_drive,
    drive_result,
    search_in_words,
    summarise_search,
    write_page,
)

SWARM = RegisterOptions(search_m=1.5, swarm=SwarmConfig(particles=32, iterations=12))


@pytest.fixture(scope="module")
def live(site: Site) -> RegisteredDrive:
    return register_site(site, "live")


def pictures(site: Site, drive: RegisteredDrive, options: RegisterOptions, folder: Path, *, impostor: bool) -> set[str]:
    with MapFile.open(site.map) as source, DriveLog.open(site.logs["live"]) as log:
        result = drive_result(drive, source, impostor=impostor)
        figures = draw_drive(result, drive, source, log, options, folder, True)
    assert {figure.path.name for figure in figures} | {"live-scans.html"} == {path.name for path in folder.iterdir()}
    return {figure.path.name.removeprefix("live-") for figure in figures}


def test_nothing_is_said_of_confidence_where_no_truth_is_known(
    site: Site, live: RegisteredDrive, tmp_path: Path
) -> None:
    blind, impostor = tmp_path / "blind", tmp_path / "impostor"
    blind.mkdir()
    impostor.mkdir()
    left = {"trajectory.png", "match.png", "map.png"}
    plain = RegisterOptions(search_m=1.5)
    # A picture of an earlier run would pass for one of these fixes.
    for old in ("live-confidence.png", "live-swarm.png"):
        (blind / old).write_bytes(b"of an earlier run")
    assert pictures(site, replace(live, truth=None), plain, blind, impostor=False) == left
    assert pictures(site, live, plain, impostor, impostor=True) == left


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


def test_each_drive_of_a_page_says_how_it_was_searched(
    site: Site, live: RegisteredDrive, tmp_path: Path, drawn: list[Figure]
) -> None:
    first, second = RegisterOptions(search_m=1.5, risk=1e-3), RegisterOptions(search_m=3.0, risk=1e-6)
    with MapFile.open(site.map) as source, DriveLog.open(site.logs["live"]) as log:
        result = drive_result(live, source, impostor=False)
        write_registered(live, source, log, first, tmp_path, False)

    def registered(result: DriveResult, options: RegisterOptions) -> Registered:
        summary = summarise_search(result, options)
        return result, summary, drive_section(summary, ())

    before = registered(result, first)
    (tmp_path / "summary.json").write_text(json.dumps([before[1].as_json()]), encoding="utf-8")
    write_page([registered(replace(result, name="other"), second)], tmp_path, "page")
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    words = [search_in_words(settings_of(options)) for options in (first, second)]
    # The drive that was registered before stands first.
    assert 0 < page.index(words[0]) < page.index(words[1])
    dashed = [drawn[-1].axes[3 * row].lines[0].get_xdata()[0] for row in range(2)]  # type: ignore[index]
    assert dashed == pytest.approx([3.0, 6.0])


def test_words_of_a_search_hold_its_settings() -> None:
    own = RegisterOptions(window_m=2.0, own_thresholds=Thresholds(5.5, 2.5))
    for options, values in (
        (RegisterOptions(search_m=3.0, risk=1e-6), ("3 m", "1e-06")),
        (RegisterOptions(window_m=0.0, time_scale=1.05), ("1.05", "0.0001")),
        (own, ("2 m",)),
    ):
        words = search_in_words(settings_of(options))
        assert all(value in words for value in values)
        assert ("0.0001" in words) == (options.risk == 1e-4 and options.own_thresholds is None)
    # Records of an older version had no risk.
    settings = settings_of(replace(own, own_thresholds=None))
    del settings["risk"]
    assert "2 m" in search_in_words(settings)


def test_a_drive_that_the_map_was_made_of_is_told(site: Site, live: RegisteredDrive) -> None:
    with MapFile.open(site.map) as source:
        for name, own in (("baseline_left", True), ("live", False)):
            with DriveLog.open(site.logs[name]) as log:
                assert is_baseline(source, log) is own
        plain = drive_result(live, source, impostor=False).remarks
        told = drive_result(replace(live, is_baseline=True), source, impostor=False).remarks
        assert len(told) == len(plain) + 1
        assert set(plain) < set(told)


def test_what_a_dimension_cannot_know_is_told(site: Site, live: RegisteredDrive) -> None:
    """Roll by one channel; the place along flat layers."""
    with MapFile.open(site.map) as source:
        plain = drive_result(live, source, impostor=False).remarks

        def more(drive: RegisteredDrive) -> list[str]:
            return [each for each in drive_result(drive, source, impostor=False).remarks if each not in plain]

        assert len(more(replace(live, channels=1))) == 1
        flat = np.arange(len(live.table)) < 7
        table, covariance = live.table.copy(), np.array(live.fix.covariance)
        table.loc[flat, "code"] = "ambiguous"
        # Half a metre along the way: the drive leads anywhere.
        yaw = np.asarray(live.fix.pose)[flat, 3]
        facing = np.stack([np.cos(yaw), np.sin(yaw)], axis=1)
        covariance[flat, :2, :2] = live.map_odometry_covariance[flat] + 0.25 * facing[:, :, None] * facing[:, None]
        changed = replace(live, table=table, fix=live.fix._replace(covariance=covariance))
        (told,) = more(changed)
        assert str(flat.sum()) in told
        # Uncertain labels of the map are no flat layers.
        assert more(replace(changed, map_odometry_covariance=covariance[:, :2, :2])) == []


def test_travel_in_reverse_adds_to_the_distance(site: Site, live: RegisteredDrive) -> None:
    way = live.track.travel_m - live.track.travel_m[0]
    turned = np.where(way < 10.0, way, 20.0 - way)
    back = replace(live, track=live.track._replace(travel_m=turned))
    with MapFile.open(site.map) as source:
        distance_m = drive_result(back, source, impostor=False).distance_m
    assert (np.diff(distance_m) >= 0.0).all()
    assert distance_m[-1] == pytest.approx(way[-1], abs=0.1)
