"""Jumps in recorded travel: found, bridged or left open, and never where a vehicle only drives."""

import re
from pathlib import Path

import numpy as np
import pyproj
import pytest

from drawn_travel import Drawn, draw
from formats.samples import make_description
from lgprjax.formats import DriveLog, DriveWriter, NavigationTrack, OdometryTrack
from lgprjax.formats.survey_track import distances_m, path_headings_deg
from lgprjax.formats.travel import MendedTravel, legs_of, mend_travel, scale_by_fixes, silences
from lgprjax.frames import LocalFrame
from lgprjax.recordings import drive_health
from lgprjax.recordings.drives import track_of_drive, travel_line

FIRST, DRIVES, JUMPING = 30000, 40, 120  # drawn after the limits had been set


def _found(drive: Drawn, mended: MendedTravel) -> bool:
    jumps = (*mended.bridged, *mended.broken)
    return any(jump.start_s - 0.6 <= drive.jump_s <= jump.stop_s + 0.6 for jump in jumps)


def _left_m(drive: Drawn, mended: MendedTravel) -> float:
    """By how much the travel across the jump is still wrong."""
    wrong = mended.distance_m - drive.true_m
    before, after = drive.time_s < drive.jump_s - 1.2, drive.time_s > drive.jump_s + 1.2
    return abs(float(np.median(wrong[after][:20]) - np.median(wrong[before][-20:])))


def test_driving_is_no_jump() -> None:
    """Stops and starts at 6 m/s², reversals, stands, uneven and sparse records, chords of noisy positions."""
    for number in range(FIRST, FIRST + DRIVES):
        drive = draw(number, jumps=False)
        mended = mend_travel(drive.time_s, drive.distance_m)
        assert (mended.bridged, mended.broken) == ((), ()), number
        np.testing.assert_array_equal(mended.distance_m, drive.distance_m)


def test_jumps_are_found_and_bridged() -> None:
    """Sudden ones of half a metre, smoothed ones of two, and those of eight between sparse records."""
    drives = [draw(number, jumps=True) for number in range(FIRST, FIRST + JUMPING)]
    kinds = {"sudden": (False, 5.0, 0.5, 12), "slow": (True, 5.0, 2.0, 8), "sparse": (False, 0.0, 8.0, 4)}
    for kind, (smoothed, least_hz, least_m, count) in kinds.items():
        most_hz = 5.0 if kind == "sparse" else np.inf
        some = [
            drive
            for drive in drives
            if drive.smoothed == smoothed and least_hz <= drive.rate_hz < most_hz and abs(drive.added_m) >= least_m
        ][:count]
        assert len(some) == count
        mended = [mend_travel(drive.time_s, drive.distance_m) for drive in some]
        assert all(_found(*each) for each in zip(some, mended, strict=True)), kind
        left = [_left_m(*each) for each in zip(some, mended, strict=True) if not each[1].broken]
        if kind != "sparse":
            assert np.percentile(left, 95.0) < (0.15 if kind == "sudden" else 0.5)


def test_there_and_back_are_two_jumps() -> None:
    """The positions stand aside for three seconds: the way there and the way back are both added to chords."""
    time_s = np.arange(0.0, 20.0, 0.02)
    distance = 3.0 * time_s + 2.0 * (time_s >= 8.0) + 2.0 * (time_s >= 11.0)
    mended = mend_travel(time_s, distance)
    np.testing.assert_allclose([jump.metres for jump in mended.bridged], [2.0, 2.0], atol=1e-6)
    np.testing.assert_allclose(mended.distance_m, 3.0 * time_s, atol=1e-6)


@pytest.mark.parametrize("rate_hz", [10.0, 50.0])
def test_two_jumps_are_found_at_whatever_distance(rate_hz: float) -> None:
    """Aside for 1 to 6 s: a jump near one that is larger is looked for when that one has been taken out."""
    time_s = np.arange(0.0, 30.0, 1.0 / rate_hz)
    ripple = 0.01 * np.sin(7.0 * time_s)
    for aside_s in np.arange(1.0, 6.1, 1.0):
        distance = 2.5 * time_s + ripple + 2.1 * (time_s >= 9.75) + 1.6 * (time_s >= 9.75 + aside_s)
        mended = mend_travel(time_s, distance)
        assert len(mended.bridged) == 2, aside_s
        np.testing.assert_allclose(mended.distance_m, 2.5 * time_s + ripple, atol=0.1)


def test_positions_that_a_slow_receiver_holds_are_no_jumps() -> None:
    time_s = np.arange(0.0, 30.0, 0.02)
    held = np.floor(time_s) * 1.3
    mended = mend_travel(time_s, held)
    assert (mended.bridged, mended.broken) == ((), ())
    jumped = held + 12.0 * (time_s >= 15.0)
    mended = mend_travel(time_s, jumped)
    assert len(mended.bridged) == 1
    np.testing.assert_allclose(np.interp(29.5, time_s, mended.distance_m) - mended.distance_m[0], held[-1], atol=0.1)


def test_a_gap_too_long_to_bridge_parts_the_track() -> None:
    time_s = np.arange(0.0, 60.0, 3.0)
    mended = mend_travel(time_s, 2.0 * time_s + 200.0 * (time_s >= 30.0))
    assert mended.bridged == ()
    (jump,) = mended.broken
    assert (jump.start_s, jump.stop_s) == (27.0, 30.0)
    scans_s = np.arange(0.0, 57.0, 0.5)
    leg = legs_of(scans_s, mended.broken)
    assert np.all(leg[scans_s <= 27.0] == 0)
    assert len(set(leg[scans_s >= 30.0])) == 1
    # A scan within the gap is on a leg of its own.
    assert np.all(np.diff(leg[(scans_s >= 27.0) & (scans_s <= 30.0)]) == 1)


def test_a_silent_odometer_parts_the_track() -> None:
    """Within the silence, and beyond the record, travel is not known; scans beyond one end share a leg."""
    time_s = np.concatenate([np.arange(1.0, 10.0, 0.02), np.arange(15.0, 30.0, 0.02)])
    scans_s = np.arange(0.0, 31.0, 0.03)
    leg = legs_of(scans_s, silences(time_s, 2.0 * time_s))
    parts = [scans_s < 0.95, (scans_s > 1.0) & (scans_s < 9.9), (scans_s > 15.1) & (scans_s < 29.9), scans_s > 30.05]
    assert [len(set(leg[part])) for part in parts] == [1, 1, 1, 1]
    assert len({int(leg[part][0]) for part in parts}) == 4
    assert np.all(np.diff(leg[(scans_s > 9.98) & (scans_s < 15.0)]) == 1)


def test_an_odometer_of_few_records_is_not_silent() -> None:
    """A receiver at 1 Hz that misses two records, one that is silent while the vehicle stands, and ends that agree."""
    slow_s = np.delete(np.arange(0.0, 60.0), [20, 21])
    stood_s = np.concatenate([np.arange(0.0, 10.0, 0.02), np.arange(25.0, 40.0, 0.02)])
    travel_m = np.interp(stood_s, [0.0, 10.0, 25.0, 40.0], [0.0, 20.0, 20.0, 50.0])
    for time_s, distance_m in ((slow_s, 2.0 * slow_s), (stood_s, travel_m)):
        scans_s = np.arange(time_s[0], time_s[-1], 0.01)
        assert not legs_of(scans_s, silences(time_s, distance_m)).any()
        assert not legs_of(time_s, silences(time_s, distance_m)).any()


@pytest.fixture(scope="module")
def aside(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A drive on a circle whose positions step two metres aside: travel and headings follow its positions."""
    time_s = np.arange(0.0, 20.0, 0.05)
    yaw = 0.05 * time_s
    east, north = 40.0 * np.sin(yaw), 40.0 * (1.0 - np.cos(yaw))
    stepped = time_s >= 10.0
    east, north = east - 2.0 * stepped * np.sin(0.5), north + 2.0 * stepped * np.cos(0.5)
    plane = pyproj.Proj(proj="aeqd", ellps="WGS84", lat_0=42.0, lon_0=11.0)
    longitude, latitude = (np.asarray(each) for each in plane(east, north, inverse=True))
    travel = distances_m(latitude, longitude)
    zeros = np.zeros(len(time_s))
    heading = path_headings_deg(latitude, longitude, travel)
    navigation = NavigationTrack(time_s, latitude, longitude, zeros, heading, zeros)
    description = make_description(channels=1)
    description = type(description)(
        **{**vars(description), "navigation": navigation, "odometry": OdometryTrack(time_s, travel), "truth": None}
    )
    path = tmp_path_factory.mktemp("aside") / "a.drive.h5"
    with DriveWriter.create(path, description, channels=1, dtype=np.uint8) as writer:
        signal = np.random.default_rng(1).integers(0, 255, (len(time_s), 1, 8), dtype=np.uint8)
        writer.append(time_s, signal)
    return path


def test_a_track_of_positions_that_jump_is_mended_and_its_health_says_so(aside: Path) -> None:
    with DriveLog.open(aside) as log:
        drive = track_of_drive(log, LocalFrame(42.0, 11.0, 0.0))
        time_s = log.scan_time_s
    assert (drive.jumps_bridged, drive.breaks) == (1, 0)
    told = travel_line(drive)
    assert told is not None
    assert re.findall(r"\d+", told) == ["1"]
    # 2 m/s on the circle, and its tangent: a chord of the raw positions would look 60 degrees aside at the step.
    np.testing.assert_allclose(drive.track.travel_m - drive.track.travel_m[0], 2.0 * time_s, atol=0.03)
    np.testing.assert_allclose(drive.track.speed_mps, 2.0, atol=0.05)
    np.testing.assert_allclose(drive.track.pose[:, 3], 0.05 * time_s, atol=np.radians(1.5))
    assert np.isnan(drive.track.sigma_m).all()
    assert not drive.track.leg.any()
    with DriveLog.open(aside) as log:
        figure = drive_health(log).figure("travel_jump")
    assert figure.value == pytest.approx(2.0, abs=0.15)
    assert figure.verdict == "look"
    (where,) = figure.where
    assert (where.start_s, where.stop_s) == pytest.approx((9.95, 10.0), abs=0.011)


def test_stated_sigmas_are_those_of_one_axis(tmp_path: Path) -> None:
    description = make_description()
    records = len(description.navigation.time_s)
    stated = {"sigma_east_m": np.full(records, 0.3), "sigma_north_m": np.full(records, 0.1)}
    navigation = type(description.navigation)(**{**vars(description.navigation), **stated})
    description = type(description)(**{**vars(description), "navigation": navigation})
    path = tmp_path / "a.drive.h5"
    with DriveWriter.create(path, description, channels=3, dtype=np.uint8) as writer:
        writer.append(np.arange(6) * 0.1, np.zeros((6, 3, 8), np.uint8))
    with DriveLog.open(path) as log:
        track = track_of_drive(log, LocalFrame(42.5, -71.0, 3.0)).track
    np.testing.assert_allclose(track.sigma_m, np.sqrt(0.05))


@pytest.mark.parametrize(("scale", "gap"), [(0.97, False), (1.03, True), (1.002, True)])
def test_the_scale_of_travel_is_that_of_the_fixes(scale: float, gap: bool) -> None:
    """A bend of 25 m, a heading that is 2 degrees off, fixes in stretches, good to 3 cm."""
    draw = np.random.default_rng(5)
    way_m = np.linspace(0.0, 120.0, 2400)
    yaw = way_m / 25.0
    place = 25.0 * np.stack([np.sin(yaw), 1.0 - np.cos(yaw)], axis=1) + 0.03 * draw.normal(size=(len(yaw), 2))
    ok = np.floor(way_m / 3.0) % 4 != 0
    leg = (way_m > 60.0).astype(np.int64) if gap else np.zeros(len(way_m), np.int64)
    found = scale_by_fixes(place, yaw + np.radians(2.0), way_m / scale, leg, ok)
    if abs(scale - 1.0) < 0.01:
        assert found is None
    else:
        assert found == pytest.approx(scale, abs=0.004)
    assert scale_by_fixes(place, yaw, way_m / scale, leg, ok & (way_m < 15.0)) is None
