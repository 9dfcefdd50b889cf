"""Recordings of a ROS 2 user's robot as drives: topics, clocks, covariances, damage."""

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pyproj
import pytest

from formats.mcap_sample import (
    LATITUDE_DEG,
    LONGITUDE_DEG,
    METRE_DEG,
    Message,
    attitude_of,
    changed,
    odometry_of,
    position_of,
    rover_messages,
    scan_of,
    write_recording,
)
from lgprjax.formats import DriveLog, McapAssumed, McapTopics, TraceRecording, UniformArray, check_file, import_mcap
from refusals import refused

_PITCH = UniformArray(0.2, 0.5, 0.15)
_Edit = Callable[[list[Message]], list[Message]]


def _imported(folder: Path, messages: list[Message], **options: Any) -> tuple[DriveLog, tuple[str, ...]]:
    """The drive of a recording of these messages, and what was said of it."""
    path = write_recording(folder / "rover.mcap", messages)
    told: dict[str, Any] = {"array": _PITCH, "force": True} | options
    imported = import_mcap(path, output=folder / "rover.drive.h5", **told)
    assert check_file(folder / "rover.drive.h5") == []
    return DriveLog.open(folder / "rover.drive.h5"), imported.notes


def _check_refused(
    folder: Path, messages: list[Message], place: str, *values: object, options: dict[str, Any] | None = None
) -> None:
    path, told = write_recording(folder / "rover.mcap", messages), {"array": _PITCH, **(options or {})}
    with refused(place, *values, file=path):
        import_mcap(path, output=folder / "x.drive.h5", **told)
    assert not list(folder.glob("*x.drive*"))


def _column(values: np.ndarray | None) -> np.ndarray:
    assert values is not None
    return values


def test_a_rover_of_any_make(tmp_path: Path) -> None:
    """Topics under the user's own names, the scans' type in the user's own package."""
    messages = rover_messages()
    log, notes = _imported(tmp_path, messages)
    assert notes == ()
    with log:
        signals = [values["data"] for topic, _, _, values in messages if topic == "/rover/gpr"]
        stored, valid, _ = log.read_stored(0, log.scans)
        assert [scan.tobytes() for scan in stored] == signals
        assert valid.all()
        np.testing.assert_allclose(log.scan_time_s, np.arange(50) / 20.0, atol=1e-9)
        found = log.description
    assert (found.name, found.t0_utc) == ("rover", "2023-11-14T22:13:20Z")
    assert found.recording == TraceRecording(0.25, 1.5, 0.0, None, 16)
    np.testing.assert_allclose(found.array.y_m, [0.1, -0.1])
    np.testing.assert_allclose(found.array.x_m, 0.5)
    assert found.array.height_m == 0.15
    track = found.navigation
    np.testing.assert_allclose(track.latitude_deg, LATITUDE_DEG + METRE_DEG * track.time_s, atol=1e-12)
    np.testing.assert_allclose((track.heading_deg + 180.0) % 360.0, 180.0, atol=1e-9)
    np.testing.assert_allclose(track.height_m, 430.0)
    for name, sigma in {"east_m": 0.2, "north_m": 0.3, "height_m": 0.5}.items():
        np.testing.assert_allclose(getattr(track, f"sigma_{name}"), sigma)
    np.testing.assert_allclose(_column(track.sigma_heading_deg), np.degrees(0.02))
    np.testing.assert_allclose(_column(track.sigma_roll_deg), np.degrees(0.01))
    np.testing.assert_allclose(found.odometry.distance_m, found.odometry.time_s, atol=1e-9)
    assert found.provenance["topics"] == {
        "/rover/gpr": "my_msgs/msg/RadarScan",
        "/rover/gps": "sensor_msgs/msg/NavSatFix",
        "/rover/imu": "sensor_msgs/msg/Imu",
        "/rover/odom": "nav_msgs/msg/Odometry",
    }


def test_an_odometers_places_and_speeds_become_travel(tmp_path: Path) -> None:
    """Reversing is negative travel; where only speeds are told they are summed."""

    def back(number: int, _: dict[str, Any]) -> dict[str, Any]:
        return odometry_of(number / 10.0, 0.1 * min(number, 24 - number))

    def speed(number: int, _: dict[str, Any]) -> dict[str, Any]:
        return odometry_of(number / 10.0, 0.0, speed_mps=2.0 - number / 10.0)

    log, _ = _imported(tmp_path, changed(rover_messages(), "/rover/odom", back))
    with log:
        odometry = log.description.odometry
    np.testing.assert_allclose(odometry.distance_m[[12, 24]], [1.2, 0.0], atol=1e-9)
    log, _ = _imported(tmp_path, changed(rover_messages(), "/rover/odom", speed))
    with log:
        odometry = log.description.odometry
    np.testing.assert_allclose(odometry.distance_m, 2.0 * odometry.time_s - odometry.time_s**2 / 2.0, atol=1e-9)


def test_stamps_count_not_the_order_nor_the_time_of_recording(tmp_path: Path) -> None:
    """Scans recorded pairwise in the wrong order, one twice, and one without a stamp."""
    messages = rover_messages()
    at = [number for number, each in enumerate(messages) if each[0] == "/rover/gpr"]
    for one, other in zip(at[:20:2], at[1:20:2], strict=True):
        messages[one], messages[other] = messages[other], messages[one]
    messages.insert(at[30], messages[at[30]])
    none = scan_of(0.0, np.zeros((2, 16), np.int16)) | {"header": {"stamp": {"sec": 0, "nanosec": 0}, "frame_id": ""}}
    messages.insert(at[40], ("/rover/gpr", "my_msgs/msg/RadarScan", 2.0, none))
    log, notes = _imported(tmp_path, messages)
    with log:
        assert log.scans == 50
        due = {
            values["header"]["stamp"]["nanosec"] + 10**9 * values["header"]["stamp"]["sec"]: values["data"]
            for topic, _, _, values in rover_messages()
            if topic == "/rover/gpr"
        }
        stored, _, _ = log.read_stored(0, 50)
        assert [scan.tobytes() for scan in stored] == [due[ns] for ns in sorted(due)]
    left_out, moved = notes
    assert re.findall(r"/rover/gpr|\d+", left_out) == ["/rover/gpr", "1", "1"]
    assert re.findall(r"/rover/gpr|\d+", moved) == ["/rover/gpr", "10"]


def test_without_stamps_the_times_of_recording_count(tmp_path: Path) -> None:
    empty = {"stamp": {"sec": 0, "nanosec": 0}, "frame_id": ""}
    messages = [(*each[:3], each[3] | {"header": empty}) for each in rover_messages()]
    log, notes = _imported(tmp_path, messages)
    with log:
        np.testing.assert_allclose(log.scan_time_s, 0.02 + np.arange(50) / 20.0, atol=1e-9)
    assert sorted(note.partition(":")[0] for note in notes) == ["/rover/gpr", "/rover/gps", "/rover/imu", "/rover/odom"]


def test_clocks_that_do_not_agree_are_told(tmp_path: Path) -> None:
    """Positions stamped by GPS time run leap seconds ahead: nothing would lie where it is said to."""

    def ahead(_: int, values: dict[str, Any]) -> dict[str, Any]:
        stamp = values["header"]["stamp"]
        return values | {"header": {"stamp": {**stamp, "sec": stamp["sec"] - 2}, "frame_id": ""}}

    _, notes = _imported(tmp_path, changed(rover_messages(), "/rover/gps", ahead))
    assert any(re.findall(r"/rover/\w+|\d+ s", note) == ["/rover/gps", "2 s", "/rover/gpr"] for note in notes)


def test_the_antenna_is_not_the_axle(tmp_path: Path) -> None:
    """1.5 m ahead, 0.4 m to the left and 2 m up on a vehicle that leans 5 degrees to the right and looks east."""
    roll, x_m, y_m, z_m = np.radians(5.0), 1.5, 0.4, 2.0
    leaning = {"x": float(np.sin(roll / 2)), "y": 0.0, "z": 0.0, "w": float(np.cos(roll / 2))}

    def lean(_: int, values: dict[str, Any]) -> dict[str, Any]:
        return values | {"orientation": leaning}

    messages = changed(rover_messages(), "/rover/imu", lean)
    log, _ = _imported(tmp_path, messages, assumed=McapAssumed((x_m, y_m, z_m)))
    with log:
        track = log.description.navigation
    np.testing.assert_allclose(track.heading_deg, 90.0, atol=1e-9)
    np.testing.assert_allclose(track.roll_deg, 5.0, atol=1e-9)
    geod = pyproj.Geod(ellps="WGS84")
    azimuth, _, distance = geod.inv(track.longitude_deg[0], track.latitude_deg[0], LONGITUDE_DEG, LATITUDE_DEG)
    east, north = distance * np.sin(np.radians(azimuth)), distance * np.cos(np.radians(azimuth))
    # Leaning right moves what is high to the right, here south, and lifts what is on the left.
    # The geodesic runs on the ellipsoid, 430 m lower: a tenth of a millimetre less.
    np.testing.assert_allclose(east, x_m, atol=2e-4)
    np.testing.assert_allclose(north, y_m * np.cos(roll) - z_m * np.sin(roll), atol=2e-4)
    np.testing.assert_allclose(430.0 - track.height_m[0], z_m * np.cos(roll) + y_m * np.sin(roll), atol=1e-6)


def test_heading_along_the_path_where_nothing_tells_it(tmp_path: Path) -> None:
    messages = [each for each in rover_messages() if each[0] not in ("/rover/imu", "/rover/odom")]
    log, notes = _imported(tmp_path, messages)
    with log:
        found = log.description
    np.testing.assert_allclose((found.navigation.heading_deg + 180.0) % 360.0, 180.0, atol=1e-6)
    np.testing.assert_allclose(found.navigation.roll_deg, 0.0)
    np.testing.assert_allclose(np.diff(found.odometry.distance_m), 0.2, rtol=5e-3)
    assert len(notes) == 2


def test_an_odometers_heading_only_counts_where_it_is_asked_for(tmp_path: Path) -> None:
    """It says east, the vehicle drives north."""
    messages = [each for each in rover_messages() if each[0] != "/rover/imu"]
    log, notes = _imported(tmp_path, messages)
    with log:
        assert abs((log.description.navigation.heading_deg[0] + 180.0) % 360.0 - 180.0) < 1e-3
    assert len(notes) == 1
    asked = {"topics": McapTopics(heading="/rover/odom"), "assumed": McapAssumed(heading_sigma_deg=2.0)}
    log, notes = _imported(tmp_path, messages, **asked)
    with log:
        np.testing.assert_allclose(log.description.navigation.heading_deg, 90.0, atol=1e-9)
        np.testing.assert_allclose(_column(log.description.navigation.sigma_heading_deg), 2.0)
    assert notes == ()


def test_positions_without_a_fix_and_gaps_of_headings_are_left_out(tmp_path: Path) -> None:
    def lost(number: int, values: dict[str, Any]) -> dict[str, Any]:
        return values | ({"status": {"status": -1, "service": 0}} if number == 4 else {})

    messages = changed(rover_messages(120), "/rover/gps", lost)
    messages = [each for each in messages if each[0] != "/rover/imu" or not 1.5 < each[2] < 3.0]
    log, notes = _imported(tmp_path, messages)
    with log:
        time_s = log.description.navigation.time_s
    assert 0.8 not in np.round(time_s, 3)
    assert not np.any((time_s > 1.51) & (time_s < 2.99))
    (note,) = notes
    assert re.findall(r"/rover/gps|\d+", note) == ["/rover/gps", "1"]


def _two_receivers(messages: list[Message]) -> list[Message]:
    return messages + [("/other/gps", *each[1:]) for each in messages if each[0] == "/rover/gps"]


def _same(messages: list[Message]) -> list[Message]:
    return messages


def _without(topic: str) -> _Edit:
    return lambda messages: [each for each in messages if each[0] != topic]


def _each(topic: str, **members: object) -> _Edit:
    return lambda messages: changed(messages, topic, lambda _, values: values | members)


def _some(topic: str, **members: object) -> _Edit:
    return lambda messages: changed(messages, topic, lambda n, values: values | (members if 2 < n < 50 else {}))


_FEWER = {"channels": 1, "data": bytes(32)}


_SCAN, _GNSS = "lgprjax_msgs/msg/RadarScan", "sensor_msgs/msg/NavSatFix"
_NO_GNSS_SIGMA = _some("/rover/gps", position_covariance_type=0)
_NO_HEADING_SIGMA = _some("/rover/imu", orientation_covariance=[0.0] * 9)
_SWEEPS = _each("/rover/gpr", encoding="complex64", samples=4, calibration=bytes(32))


@pytest.mark.parametrize(
    ("edit", "options", "place", "values"),
    [
        (_without("/rover/gpr"), {}, "topics", (_SCAN, "/rover/gps")),
        (_without("/rover/gps"), {}, "topics", (_GNSS,)),
        (_two_receivers, {}, "--gnss-topic", (_GNSS, "/other/gps, /rover/gps")),
        (_same, {"topics": McapTopics(gnss="/rover/imu")}, "--gnss-topic", ("/rover/imu: sensor_msgs/msg/Imu",)),
        (_same, {"topics": McapTopics(heading="/no")}, "--heading-topic", ("sensor_msgs/msg/Imu",)),
        (_same, {"topics": McapTopics(array="/no")}, "--array-topic", ("lgprjax_msgs/msg/RadarArray",)),
        (_same, {"array": None}, "array", ("lgprjax_msgs/msg/RadarArray",)),
        (_NO_GNSS_SIGMA, {}, "/rover/gps", ("--gnss-sigma-m",)),
        (_NO_HEADING_SIGMA, {}, "/rover/imu", ("--heading-sigma-deg",)),
        (_each("/rover/gps", latitude=float("nan")), {}, "topics", (_GNSS,)),
        (_each("/rover/gpr", sample_interval_ns=0.0), {}, "RadarScan, sample_interval_ns", (0,)),
        (_each("/rover/gpr", encoding="uint12"), {}, "topics", (_SCAN,)),
        (_SWEEPS, {}, "topics", ("RadarArray",)),
        (
            lambda m: changed(m, "/rover/gpr", lambda n, v: v | (_FEWER if n == 20 else {})),
            {},
            "/rover/gpr, scan 21",
            ("2 channels of 16 int16 every 0.25 ns",),
        ),
        (lambda m: [e for e in m if e[0] != "/rover/gps" or e[2] > 2.5], {}, "/rover/gps", (2,)),
        (lambda m: [e for e in m if e[0] != "/rover/gpr" or e[2] < 0.04], {}, "/rover/gpr", (2, "1")),
    ],
)
def test_what_is_missing_is_refused(
    edit: _Edit, options: dict[str, Any], place: str, values: tuple[object, ...], tmp_path: Path
) -> None:
    _check_refused(tmp_path, edit(rover_messages()), place, *values, options=options)


def test_sigmas_that_no_message_tells_are_as_told_or_none(tmp_path: Path) -> None:
    messages = _each("/rover/gps", position_covariance_type=0)(rover_messages())
    messages = _each("/rover/imu", orientation_covariance=[0.0] * 9)(messages)
    log, _ = _imported(tmp_path, messages, assumed=McapAssumed(gnss_sigma_m=1.5, heading_sigma_deg=3.0))
    with log:
        track = log.description.navigation
    np.testing.assert_allclose([_column(track.sigma_east_m), _column(track.sigma_height_m)], 1.5)
    np.testing.assert_allclose([_column(track.sigma_heading_deg), _column(track.sigma_roll_deg)], 3.0)
    log, _ = _imported(tmp_path, messages)
    with log:
        track = log.description.navigation
    sigmas = (track.sigma_east_m, track.sigma_north_m, track.sigma_height_m, track.sigma_heading_deg)
    assert (*sigmas, track.sigma_roll_deg) == (None,) * 5
    log, _ = _imported(tmp_path, _without("/rover/imu")(rover_messages()))
    with log:
        assert log.description.navigation.sigma_heading_deg is None
        assert log.description.navigation.sigma_east_m is not None


def test_an_imu_without_orientation_has_no_heading(tmp_path: Path) -> None:
    messages = _each("/rover/imu", orientation_covariance=[-1.0] + [0.0] * 8)(rover_messages())
    log, notes = _imported(tmp_path, messages)
    with log:
        assert abs((log.description.navigation.heading_deg[3] + 180.0) % 360.0 - 180.0) < 1e-3
    assert len(notes) == 1


def test_scans_that_wait_are_few_or_it_is_said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("lgprjax.formats.mcap_import._MOST_WAITING", 20)
    messages = rover_messages(60)
    late = [each for each in messages if each[0] == "/rover/gpr"][:1]
    rest = [each for each in messages if each is not late[0]]
    _check_refused(tmp_path, rest + late, "/rover/gpr", 20)


def test_positions_far_from_the_first_scan_do_not_matter(tmp_path: Path) -> None:
    """A receiver that was switched on a minute before the radar."""
    early = [("/rover/gps", "sensor_msgs/msg/NavSatFix", t, position_of(t, 0.0)) for t in np.arange(-60.0, -0.1, 1.0)]
    early += [("/rover/imu", "sensor_msgs/msg/Imu", t, attitude_of(t, np.pi / 2)) for t in np.arange(-60.0, -0.1, 0.5)]
    log, notes = _imported(tmp_path, sorted(early + rover_messages(), key=lambda each: each[2]))
    with log:
        assert log.scans == 50
        assert log.description.navigation.time_s[0] == -60.0
        assert log.scan_time_s[0] == 0.0
    assert notes == ()
