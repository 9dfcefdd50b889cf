"""What viewers show of an exported drive: transforms and radargrams, held against the log's own numbers."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from formats.mcap_sample import SAMPLES, SCANS, curved_description, curved_fixes, decoded, write_curved
from lgprjax.formats import (
    DriveDescription,
    DriveWriter,
    OdometryTrack,
    SweepRecording,
    TraceRecording,
    export_mcap,
    read_fixes,
)
from lgprjax.radar import uniform_array

_MOUNTING_M = np.array([3.0, 0.0, 0.2])
"""The array's centre in the vehicle's frame, as ``make_description`` has it."""


def _ecef_m(latitude_deg: Any, longitude_deg: Any, height_m: Any) -> np.ndarray:
    """WGS-84, from its two constants."""
    a, f = 6378137.0, 1.0 / 298.257223563
    e2 = f * (2.0 - f)
    latitude, longitude = np.radians(latitude_deg), np.radians(longitude_deg)
    n = a / np.sqrt(1.0 - e2 * np.sin(latitude) ** 2)
    x = (n + height_m) * np.cos(latitude) * np.cos(longitude)
    y = (n + height_m) * np.cos(latitude) * np.sin(longitude)
    return np.stack([x, y, (n * (1.0 - e2) + height_m) * np.sin(latitude)], axis=-1)


def _enu_m(latitude_deg: Any, longitude_deg: Any, height_m: Any, anchor: tuple[float, float, float]) -> np.ndarray:
    """East, north and up of an anchor."""
    latitude, longitude = np.radians(anchor[0]), np.radians(anchor[1])
    s, c, sl, cl = np.sin(latitude), np.cos(latitude), np.sin(longitude), np.cos(longitude)
    turn = np.array([[-sl, cl, 0.0], [-s * cl, -s * sl, c], [c * cl, c * sl, s]])
    return np.asarray((_ecef_m(latitude_deg, longitude_deg, height_m) - _ecef_m(*anchor)) @ turn.T)


def _transforms(messages: list[tuple[int, SimpleNamespace]]) -> tuple[np.ndarray, Rotation, set[tuple[str, str]]]:
    """Translations, rotations, and the frames from and to."""
    each = [message.transforms[0] for _, message in messages]
    assert all(len(message.transforms) == 1 for _, message in messages)
    place = np.array([[getattr(one.transform.translation, axis) for axis in "xyz"] for one in each])
    turn = Rotation.from_quat([[getattr(one.transform.rotation, axis) for axis in "xyzw"] for one in each])
    return place, turn, {(one.header.frame_id, one.child_frame_id) for one in each}


@pytest.fixture(scope="module")
def curved(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, np.ndarray, np.ndarray]:
    """The curved drive and its recording, with what was written."""
    folder = tmp_path_factory.mktemp("curved")
    signal, valid = write_curved(folder / "a.drive.h5")
    export_mcap(folder / "a.drive.h5", folder / "a.mcap")
    return folder, signal, valid


def test_without_fixes_the_vehicle_moves_by_its_navigation(curved: tuple[Path, np.ndarray, np.ndarray]) -> None:
    found, track = decoded(curved[0] / "a.mcap"), curved_description().navigation
    place, turn, frames = _transforms(found["/tf"])
    assert frames == {("map", "base_link")}
    anchor = (float(track.latitude_deg[0]), float(track.longitude_deg[0]), float(track.height_m[0]))
    np.testing.assert_allclose(
        place, _enu_m(track.latitude_deg, track.longitude_deg, track.height_m, anchor), atol=1e-6
    )
    # The meridians of a drive of some metres are parallel to a millionth of a radian.
    heading, roll = np.radians(track.heading_deg), np.radians(track.roll_deg)
    forward, left = turn.apply([1.0, 0.0, 0.0]), turn.apply([0.0, 1.0, 0.0])
    np.testing.assert_allclose(forward, np.stack([np.sin(heading), np.cos(heading), 0 * heading], axis=1), atol=1e-5)
    np.testing.assert_allclose(left[:, 2], np.sin(roll), atol=1e-9)
    mounting, straight, frames = _transforms(found["/tf_static"])
    assert frames == {("base_link", "radar_array")}
    np.testing.assert_allclose(mounting[0], _MOUNTING_M, atol=1e-12)
    np.testing.assert_allclose(straight.as_matrix()[0], np.eye(3), atol=1e-12)


def test_fixes_that_are_ok_place_the_array_where_they_say(
    curved: tuple[Path, np.ndarray, np.ndarray], tmp_path: Path
) -> None:
    """The chain of both transforms leads to the fix; where no fix is ok there is no transform."""
    path, _, _ = curved_fixes(tmp_path)
    export_mcap(curved[0] / "a.drive.h5", tmp_path / "a.mcap", fixes=path)
    found, table = decoded(tmp_path / "a.mcap"), read_fixes(path)
    ok = table[table["code"] == "ok"]
    place, turn, frames = _transforms(found["/tf"])
    assert (frames, len(place)) == ({("map", "base_link")}, SCANS // 3)
    assert [ns for ns, _ in found["/tf"]] == [ns for ns, _ in found["/lgpr/pose"]]
    names = ("anchor_latitude_deg", "anchor_longitude_deg", "anchor_height_m")
    anchor = (float(table.attrs[names[0]]), float(table.attrs[names[1]]), float(table.attrs[names[2]]))
    array_m = place + turn.apply(_transforms(found["/tf_static"])[0][0])
    latitude, longitude, height = (ok[name].to_numpy() for name in ("latitude_deg", "longitude_deg", "height_m"))
    due_m = _enu_m(latitude, longitude, height, anchor)
    np.testing.assert_allclose(array_m, due_m, atol=1e-4)  # heights of the table have four decimals
    heading, forward = np.radians(ok["heading_deg"].to_numpy()), turn.apply([1.0, 0.0, 0.0])
    np.testing.assert_allclose(forward[:, 0], np.sin(heading), atol=1e-5)
    np.testing.assert_allclose(forward[:, 1], np.cos(heading), atol=1e-5)
    np.testing.assert_allclose(turn.apply([0.0, 1.0, 0.0])[:, 2], np.sin(np.radians(ok["roll_deg"])), atol=1e-6)


def _images(path: Path) -> tuple[list[int], list[np.ndarray]]:
    """Stamps and pixels [row, column]."""
    messages = decoded(path).get("/gpr/radargram", [])
    assert {(m.encoding, m.is_bigendian, m.header.frame_id) for _, m in messages} <= {("mono8", 0, "radar_array")}
    pixels = [np.frombuffer(m.data, np.uint8).reshape(m.height, m.step)[:, : m.width] for _, m in messages]
    return [ns for ns, _ in messages], pixels


def _background_removed(traces: np.ndarray, half: int) -> np.ndarray:
    """Dewowed and without the mean trace, sample by sample."""
    samples = traces.shape[1]
    dewowed = np.stack(
        [traces[:, i] - traces[:, max(i - half, 0) : i + half + 1].mean(axis=1) for i in range(samples)], axis=1
    )
    return np.asarray(dewowed - np.nanmean(dewowed, axis=0))


def test_pixels_are_the_samples_of_the_middle_channel(curved: tuple[Path, np.ndarray, np.ndarray]) -> None:
    """Each row is the background-removed samples of one travel time, times a factor that does not fall."""
    folder, signal, valid = curved
    (first_ns, last_ns), (first, last) = _images(folder / "a.mcap")
    # The drive reverses after two seconds: 200 scans of 300 lead on.
    assert last_ns - first_ns == (199 - 127) * 10**7
    assert first.shape == last.shape == (SAMPLES, 200)
    assert np.all(first[:, :72] == 128)
    traces = np.where(valid[:, 1, None], signal[:, 1] - 128.0, np.nan)
    for image, scans in ((first[:, 72:], slice(0, 128)), (last, slice(0, 200))):
        due = _background_removed(traces[scans], 15)  # 1.5 periods of 20 samples
        held = np.isfinite(due).all(axis=1)
        assert np.all(image.T[~held] == 128)
        grey, due = image.T[held].astype(float) - 128.0, due[held]
        inside = (grey > -127.0) & (grey < 127.0)
        factor = np.sum(np.where(inside, grey * due, 0.0), axis=0) / np.sum(np.where(inside, due**2, 0.0), axis=0)
        # Half a step of rounding, and the factor is one found from rounded pixels.
        np.testing.assert_allclose(np.where(inside, grey - factor * due, 0.0), 0.0, atol=0.7)
        assert np.all(np.diff(factor) > -1e-3 * factor[0])
        assert np.mean(~inside) == pytest.approx(0.015, abs=0.01)


def _described(recording: TraceRecording | SweepRecording, channels: int, scans: int) -> DriveDescription:
    """A drive of 1 m/s with a scan every 10 ms."""
    known = curved_description(scans=scans)
    time_s = np.arange(-0.1, scans / 100.0 + 0.1, 0.05)
    array = uniform_array(channels, 0.127, x_m=3.0, height_m=0.2)
    return replace(known, recording=recording, array=array, odometry=OdometryTrack(time_s, time_s))


def test_images_of_a_long_drive_stay_small(tmp_path: Path) -> None:
    """At most 512 columns and four bytes a column and sample of the drive, with the newest scan at the right."""
    scans, samples = 1500, 16
    rng = np.random.default_rng(2)
    traces = rng.normal(size=(scans, 1, samples)).astype(np.float32)
    traces[1278:1280, 0] *= 30.0  # the last two before the tenth image
    description = _described(TraceRecording(0.2, 0.0, 0.0, 2.5e8, samples), 1, scans)
    with DriveWriter.create(tmp_path / "l.drive.h5", description, channels=1, dtype=np.float32) as writer:
        writer.append(np.arange(scans) / 100.0, traces)
    export_mcap(tmp_path / "l.drive.h5", tmp_path / "l.mcap")
    stamps, images = _images(tmp_path / "l.mcap")
    assert {image.shape for image in images} == {(samples, 512)}
    assert sum(image.size for image in images) <= 4 * scans * samples + 512 * samples
    np.testing.assert_array_equal(np.diff(stamps), [128 * 10**7] * 10 + [92 * 10**7])
    strength = np.abs(images[9].astype(float) - 128.0).mean(axis=0)
    assert set(np.argsort(strength)[-2:]) == {510, 511}
    # In the next image they have moved on by 128 columns.
    strength = np.abs(images[10].astype(float) - 128.0).mean(axis=0)
    assert set(np.argsort(strength)[-2:]) == {382, 383}


def _exported_sweeps(folder: Path, frequencies_hz: np.ndarray, sweeps: np.ndarray, calibration: np.ndarray) -> Path:
    """A recording of sweeps by one antenna, whose look-up is the same at every frequency."""
    lookup = np.full((1, len(frequencies_hz)), 0.3 + 0.1j, np.complex64)
    recording = SweepRecording(frequencies_hz, lookup, np.ones(len(frequencies_hz), np.complex64))
    heard = (sweeps + lookup * calibration).astype(np.complex64)[:, None]
    drive = folder / f"{len(frequencies_hz)}.drive.h5"
    with DriveWriter.create(drive, _described(recording, 1, len(sweeps)), channels=1, dtype=np.complex64) as writer:
        writer.append_sweeps(np.arange(len(sweeps)) / 100.0, heard, calibration)
    export_mcap(drive, drive.with_suffix(".mcap"))
    return drive.with_suffix(".mcap")


def test_sweeps_become_traces_by_the_inverse_transform(tmp_path: Path) -> None:
    """One reflector that sinks from 10 to 30 ns: the strongest pixel of each column follows it."""
    frequencies_hz, echo_ns = np.arange(100e6, 401e6, 2e6), np.linspace(10.0, 30.0, 200)
    calibration = np.full((200, len(frequencies_hz)), 1.5 - 0.5j, np.complex64)
    sweeps = np.exp(-2e-9j * np.pi * np.outer(echo_ns, frequencies_hz)) * calibration
    image = _images(_exported_sweeps(tmp_path, frequencies_hz, sweeps, calibration))[1][-1].astype(float) - 128.0
    # Up to fifteen periods of 250 MHz, 60 ns.
    found_ns = np.argmax(np.abs(image), axis=0) * 60.0 / len(image)
    assert np.median(np.abs(found_ns - echo_ns)) < 1.0
    assert np.corrcoef(found_ns, echo_ns)[0, 1] > 0.95
    # Sweeps in unequal steps have no radargram.
    unequal_hz, ones = np.array([100e6, 130e6, 140e6, 200e6, 215e6]), np.ones((20, 5), np.complex64)
    found = decoded(_exported_sweeps(tmp_path, unequal_hz, ones, ones))
    assert len(found["/gpr/scan"]) == 20
    assert "/gpr/radargram" not in found
