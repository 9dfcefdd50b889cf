"""Drives and fixes as recordings: what other programs decode, and what comes back."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pandas as pd
import pytest
from scipy.spatial.transform import Rotation

from formats.mcap_sample import SCANS, curved_description, curved_fixes, decoded, write_curved
from formats.samples import make_description, make_track
from lgprjax.formats import (
    DriveLog,
    DriveWriter,
    SweepRecording,
    check_file,
    export_mcap,
    import_mcap,
    read_fixes,
)
from lgprjax.frames import LocalFrame
from lgprjax.radar import ArrayGeometry
from refusals import refused


def _ns(message: SimpleNamespace) -> Any:
    """The stamp, of a transform that of its only one."""
    (one,) = getattr(message, "transforms", (message,))
    return one.header.stamp.sec * 10**9 + one.header.stamp.nanosec


@pytest.fixture(scope="module")
def exported(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, np.ndarray, np.ndarray]:
    folder = tmp_path_factory.mktemp("exported")
    signal, valid = write_curved(folder / "a.drive.h5")
    assert export_mcap(folder / "a.drive.h5", folder / "a.mcap") == (SCANS, 0, ("truth", "vehicle"))
    return folder, signal, valid


def test_the_library_of_ros_users_decodes_it(exported: tuple[Path, np.ndarray, np.ndarray]) -> None:
    folder, signal, valid = exported
    found, description = decoded(folder / "a.mcap"), curved_description()
    records, turns = len(description.navigation.time_s), len(description.odometry.time_s)
    counts = {"/gpr/array": 1, "/gpr/scan": SCANS, "/gnss/fix": records, "/gnss/imu": records, "/odometry": turns}
    counts |= {"/tf": records, "/tf_static": 1, "/gpr/radargram": 2}
    assert {topic: len(messages) for topic, messages in found.items()} == counts
    for messages in found.values():
        assert all(log_ns == _ns(message) for log_ns, message in messages)
        assert all(np.diff([log_ns for log_ns, _ in messages]) > 0)
    begin_ns = pd.Timestamp(description.t0_utc).value
    scans = [message for _, message in found["/gpr/scan"]]
    np.testing.assert_array_equal([_ns(scan) - begin_ns for scan in scans], np.arange(SCANS) * 10**7)
    assert {(s.channels, s.samples, s.encoding, s.sample_interval_ns, s.time_zero_ns, s.zero_level) for s in scans} == {
        (3, 8, "uint8", 0.2, 1.5, 128.0)
    }
    data = np.array([np.frombuffer(scan.data, np.uint8) for scan in scans]).reshape(signal.shape)
    np.testing.assert_array_equal(data, signal)
    np.testing.assert_array_equal([list(scan.valid) for scan in scans], valid)
    (array,) = (message for _, message in found["/gpr/array"])
    np.testing.assert_array_equal(array.y_m, description.array.y_m)
    assert (array.height_m, array.centre_frequency_hz) == (0.2, 2.5e8)


def test_navigation_has_the_axes_of_ros(exported: tuple[Path, np.ndarray, np.ndarray]) -> None:
    found, track = decoded(exported[0] / "a.mcap"), curved_description().navigation
    fixes = [message for _, message in found["/gnss/fix"]]
    np.testing.assert_array_equal([fix.latitude for fix in fixes], track.latitude_deg)
    np.testing.assert_array_equal([fix.longitude for fix in fixes], track.longitude_deg)
    covariance = np.array([fix.position_covariance for fix in fixes]).reshape(-1, 3, 3)
    assert track.sigma_north_m is not None
    assert track.sigma_heading_deg is not None
    np.testing.assert_allclose(covariance[:, 1, 1], track.sigma_north_m**2, rtol=1e-12)
    assert {(fix.status.status, fix.position_covariance_type) for fix in fixes} == {(0, 3)}
    imus = [message for _, message in found["/gnss/imu"]]
    turn = Rotation.from_quat([[getattr(imu.orientation, axis) for axis in "xyzw"] for imu in imus])
    yaw, pitch, roll = turn.as_euler("ZYX", degrees=True).T
    np.testing.assert_allclose((90.0 - yaw) % 360.0, track.heading_deg, atol=1e-9)
    np.testing.assert_allclose(roll, track.roll_deg, atol=1e-9)
    np.testing.assert_allclose(pitch, 0.0, atol=1e-9)
    # Forward is where the heading points, and a positive roll lifts the left side.
    forward, left = turn.apply([1.0, 0.0, 0.0]), turn.apply([0.0, 1.0, 0.0])
    np.testing.assert_allclose(forward[:, 0], np.sin(np.radians(track.heading_deg)), atol=1e-9)
    np.testing.assert_array_equal(np.sign(left[:, 2]), np.sign(track.roll_deg))
    variances = np.array([imu.orientation_covariance for imu in imus])
    np.testing.assert_allclose(variances[:, 8], np.radians(track.sigma_heading_deg) ** 2, rtol=1e-12)
    assert {imu.angular_velocity_covariance[0] for imu in imus} == {-1.0}


def test_sigmas_that_are_not_stated_are_unknown_covariances(tmp_path: Path) -> None:
    path = tmp_path / "a.drive.h5"
    description = replace(make_description(), navigation=make_track(sigmas=False))
    with DriveWriter.create(path, description, channels=3, dtype=np.uint8) as writer:
        writer.append(np.arange(6) * 0.1, np.zeros((6, 3, 8), np.uint8))
    export_mcap(path, tmp_path / "a.mcap")
    found = decoded(tmp_path / "a.mcap")
    assert {message.position_covariance_type for _, message in found["/gnss/fix"]} == {0}
    assert not np.any([message.orientation_covariance for _, message in found["/gnss/imu"]])


_SIGMAS = ("sigma_east_m", "sigma_north_m", "sigma_height_m", "sigma_heading_deg", "sigma_roll_deg")


@pytest.mark.parametrize("suffix", ["mcap", "bag", "db3"])
@pytest.mark.parametrize(
    "stated",
    [_SIGMAS[:2], (*_SIGMAS[:2], _SIGMAS[3]), (_SIGMAS[3],), (_SIGMAS[2], _SIGMAS[4]), _SIGMAS[:3], _SIGMAS[3:]],
)
def test_each_sigma_that_is_stated_comes_back(stated: tuple[str, ...], suffix: str, tmp_path: Path) -> None:
    """Of a receiver on a field there is a place and a heading, and neither height nor roll."""
    values = {name: np.linspace(0.01, 0.4, 5) * (1 + number) for number, name in enumerate(_SIGMAS)}
    track = replace(make_track(sigmas=False), **{name: values[name] for name in stated})
    before, after = tmp_path / "a.drive.h5", tmp_path / "b.drive.h5"
    with DriveWriter.create(
        before, replace(make_description(), navigation=track), channels=3, dtype=np.uint8
    ) as writer:
        writer.append(np.arange(6) * 0.1, np.zeros((6, 3, 8), np.uint8))
    export_mcap(before, tmp_path / f"a.{suffix}")
    import_mcap(tmp_path / f"a.{suffix}", output=after)
    with DriveLog.open(after) as log:
        found = log.description.navigation
    for name in _SIGMAS:
        sigma = getattr(found, name)
        assert (sigma is not None) == (name in stated), name
        if sigma is not None:
            np.testing.assert_allclose(sigma, values[name], rtol=1e-12)
    if suffix == "mcap":
        # Filters of other programs need covariances that are positive definite, and large where nothing is known.
        for _, message in decoded(tmp_path / "a.mcap")["/gnss/fix"]:
            covariance = np.reshape(message.position_covariance, (3, 3))
            assert np.all(np.linalg.eigvalsh(covariance) > 0.0) or not message.position_covariance_type


@pytest.mark.parametrize("dtype", ["uint8", "int32", "float32", "complex64"])
def test_there_and_back(tmp_path: Path, dtype: str) -> None:
    before, after = tmp_path / "a.drive.h5", tmp_path / "b.drive.h5"
    signal, valid = write_curved(before, dtype)
    export_mcap(before, tmp_path / "a.mcap")
    imported = import_mcap(tmp_path / "a.mcap", output=after)
    assert imported == (SCANS, ())
    assert [finding for finding in check_file(after) if finding.severity == "error"] == []
    with DriveLog.open(before) as old, DriveLog.open(after) as new:
        stored, heard, calibration = new.read_stored(0, SCANS)
        np.testing.assert_array_equal(stored.view(np.uint8), signal.view(np.uint8))
        np.testing.assert_array_equal(heard, valid)
        np.testing.assert_allclose(new.scan_time_s, old.scan_time_s, atol=1e-9)
        was, now = old.description, new.description
        if isinstance(now.recording, SweepRecording):
            assert isinstance(was.recording, SweepRecording)
            assert calibration is not None
            np.testing.assert_array_equal(calibration, signal[:, 0] + 1.0)
            np.testing.assert_array_equal(now.recording.lookup_sweeps, was.recording.lookup_sweeps)
            np.testing.assert_array_equal(now.recording.frequencies_hz, was.recording.frequencies_hz)
            assert now.recording.channel_gain is None
        else:
            assert now.recording == was.recording
    assert (now.name, now.t0_utc) == (was.name, was.t0_utc)
    assert now.provenance["exported"] == was.provenance
    for name in ArrayGeometry._fields:
        np.testing.assert_array_equal(getattr(now.array, name), getattr(was.array, name))
    track, due = now.navigation, was.navigation
    np.testing.assert_array_equal(track.latitude_deg, due.latitude_deg)
    np.testing.assert_array_equal(track.longitude_deg, due.longitude_deg)
    np.testing.assert_array_equal(track.height_m, due.height_m)
    apart_deg = (track.heading_deg - due.heading_deg + 180.0) % 360.0 - 180.0
    np.testing.assert_allclose(apart_deg, 0.0, atol=1e-11)
    np.testing.assert_allclose(track.roll_deg, due.roll_deg, atol=1e-11)
    for name in ("time_s", "sigma_east_m", "sigma_north_m", "sigma_height_m", "sigma_heading_deg", "sigma_roll_deg"):
        np.testing.assert_allclose(getattr(track, name), getattr(due, name), rtol=1e-12, atol=1e-9)
    np.testing.assert_allclose(now.odometry.time_s, was.odometry.time_s, atol=1e-9)
    travel_m = was.odometry.distance_m - was.odometry.distance_m[0]
    np.testing.assert_allclose(now.odometry.distance_m, travel_m, atol=1e-11)


def test_the_moment_that_is_not_known_comes_back(tmp_path: Path) -> None:
    """Surveys without a clock begin at time zero, which must not pass for a stamp that is missing."""
    known = curved_description()
    track, odometry = known.navigation, known.odometry
    description = replace(
        known,
        t0_utc="1970-01-01T00:00:00Z",
        navigation=replace(track, time_s=track.time_s - track.time_s[0]),
        odometry=replace(odometry, time_s=odometry.time_s - odometry.time_s[0]),
    )
    with DriveWriter.create(tmp_path / "u.drive.h5", description, channels=3, dtype=np.uint8) as writer:
        writer.append(np.arange(SCANS) / 100.0, np.ones((SCANS, 3, 8), np.uint8))
    export_mcap(tmp_path / "u.drive.h5", tmp_path / "u.mcap")
    assert import_mcap(tmp_path / "u.mcap", output=tmp_path / "v.drive.h5") == (SCANS, ())
    with DriveLog.open(tmp_path / "v.drive.h5") as log:
        assert log.description.t0_utc == "1970-01-01T00:00:00Z"
        assert log.description.navigation.time_s[0] == 0.0


def test_fixes_are_poses_only_where_they_are_ok(tmp_path: Path) -> None:
    write_curved(tmp_path / "a.drive.h5")
    path, frame, covariance = curved_fixes(tmp_path, turned_deg=3.0)
    assert export_mcap(tmp_path / "a.drive.h5", tmp_path / "a.mcap", fixes=path).poses == SCANS / 3
    found, table = decoded(tmp_path / "a.mcap"), read_fixes(path)
    quality = [message for _, message in found["/lgpr/quality"]]
    assert [q.code for q in quality] == list(table["code"])
    assert [q.scan for q in quality] == list(range(SCANS))
    np.testing.assert_array_equal([q.correlation for q in quality], table["correlation"])
    np.testing.assert_array_equal([q.margin for q in quality], table["margin"])
    ok = table[table["code"] == "ok"]
    poses, places = ([message for _, message in found[topic]] for topic in ("/lgpr/pose", "/lgpr/fix"))
    assert len(poses) == len(places) == len(ok)
    np.testing.assert_array_equal([p.latitude for p in places], ok["latitude_deg"])
    np.testing.assert_array_equal([p.altitude for p in places], ok["height_m"])
    # The pose's place in the map's frame, brought to the earth, is the position's.
    x, y, z = np.array([[getattr(p.pose.pose.position, axis) for axis in "xyz"] for p in poses]).T
    latitude, longitude, height = frame.to_geodetic(x, y, z)
    np.testing.assert_allclose(latitude, ok["latitude_deg"], atol=1e-11)
    np.testing.assert_allclose(longitude, ok["longitude_deg"], atol=1e-11)
    np.testing.assert_allclose(height, ok["height_m"], atol=1e-6)
    turn = Rotation.from_quat([[getattr(p.pose.pose.orientation, axis) for axis in "xyzw"] for p in poses])
    yaw, _, roll = turn.as_euler("ZYX").T
    heading = frame.heading_of_yaw(yaw, ok["longitude_deg"].to_numpy())
    np.testing.assert_allclose(np.exp(1j * np.radians(heading - ok["heading_deg"])), 1.0, atol=1e-9)
    np.testing.assert_allclose(np.degrees(roll), ok["roll_deg"], atol=1e-9)
    first = np.array(poses[0].pose.covariance).reshape(6, 6)
    assert first[5, 3] == first[3, 5] == covariance[0, 3, 4]
    assert first[0, 5] == covariance[0, 0, 3]
    # East and north of the place itself are turned against those of a map whose anchor is 3 degrees of longitude off.
    told, largest = np.array(places[0].position_covariance), covariance[0, :3, :3].max()
    np.testing.assert_allclose(told, _turned(frame, ok.iloc[0], covariance[0]), atol=1e-3 * largest)
    assert np.abs(told - covariance[0, :3, :3].reshape(-1)).max() > 1e-2 * largest
    # The drive's own topics are read without being asked for.
    assert import_mcap(tmp_path / "a.mcap", output=tmp_path / "b.drive.h5") == (SCANS, ())
    with DriveLog.open(tmp_path / "b.drive.h5") as log:
        track, due = log.description.navigation, curved_description().navigation
        np.testing.assert_array_equal(track.latitude_deg, due.latitude_deg)


def _turned(frame: LocalFrame, fix: pd.Series, covariance: np.ndarray) -> np.ndarray:
    """Covariance in the axes of the place, from where a metre east and a metre north of it lie in the map."""
    own = LocalFrame(*(float(fix[name]) for name in ("latitude_deg", "longitude_deg", "height_m")))
    there = own.to_geodetic(np.array([0.0, 1.0, 0.0]), np.array([0.0, 0.0, 1.0]), np.zeros(3))
    east, north, _ = frame.to_local(*there)
    jacobian = np.eye(3)
    steps = np.array([[east[1] - east[0], east[2] - east[0]], [north[1] - north[0], north[2] - north[0]]])
    # The map's plane is also tilted against that of the place; only the turn is meant.
    left, _, right = np.linalg.svd(steps)
    jacobian[:2, :2] = left @ right
    return np.asarray(jacobian.T @ covariance[:3, :3] @ jacobian).reshape(-1)


def test_fixes_of_another_drive_are_refused(tmp_path: Path) -> None:
    write_curved(tmp_path / "a.drive.h5")
    write_curved(tmp_path / "short.drive.h5", scans=100)
    path, _, _ = curved_fixes(tmp_path)
    before = sorted(tmp_path.iterdir())
    for output in ("x.mcap", "x.bag", "x.db3"):
        with refused("time_s", "short.drive.h5"):
            export_mcap(tmp_path / "short.drive.h5", tmp_path / output, fixes=path)
        with refused("file name", ".fixes.h5"):
            export_mcap(tmp_path / "a.drive.h5", tmp_path / output, fixes=path.with_suffix(".csv"))
    assert sorted(tmp_path.iterdir()) == before
