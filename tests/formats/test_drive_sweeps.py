"""Stepped-frequency sweeps in a drive log: what is written comes back, with its mask and responses."""

from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np

from formats.samples import make_description, write_drive
from lgprjax.formats import DriveLog, DriveWriter, SweepRecording, check_file
from refusals import refused


def _sweeps(scans: int = 5) -> np.ndarray:
    rng = np.random.default_rng(4)
    return (rng.normal(size=(scans, 3, 8)) + 1j * rng.normal(size=(scans, 3, 8))).astype(np.complex64)


def test_sweeps_round_trip(tmp_path: Path) -> None:
    path = tmp_path / "a.drive.h5"
    sweeps = _sweeps()
    known = np.random.default_rng(5).random((5, 3)) > 0.3
    description = make_description(sweeps=True)
    with DriveWriter.create(path, description, channels=3, dtype=np.complex64) as writer:
        writer.append_sweeps(np.arange(5.0), sweeps, sweeps[:, 0], known)
        with refused("/radar/sweeps"):
            writer.append(np.array([9.0]), np.zeros((1, 3, 8)))
    with DriveLog.open(path) as log:
        found, calibration, valid = log.read_sweeps(1, 4)
        np.testing.assert_array_equal(found, sweeps[1:4])
        np.testing.assert_array_equal(calibration, sweeps[1:4, 0])
        np.testing.assert_array_equal(valid, known[1:4])
        assert log.samples == 8
        assert log.non_finite_scans == 0
        with refused("/radar/traces", file=path):
            log.read_traces(0, 1)


def test_non_finite_sweeps_are_marked_and_zero(tmp_path: Path) -> None:
    path = tmp_path / "a.drive.h5"
    sweeps, calibration = _sweeps(), np.ones((5, 8), np.complex64)
    sweeps[1, 2, 5] = np.nan
    sweeps[3, 0, 0] = complex(0.0, np.inf)
    calibration[2, 7] = np.nan
    with DriveWriter.create(path, make_description(sweeps=True), channels=3, dtype=np.complex64) as writer:
        writer.append_sweeps(np.arange(5.0), sweeps, calibration)
    with DriveLog.open(path) as log:
        found, divisor, valid = log.read_sweeps(0, 5)
        assert log.non_finite_scans == 3
    due = np.ones((5, 3), bool)
    due[1, 2] = due[3, 0] = False
    np.testing.assert_array_equal(found[due], sweeps[due])
    np.testing.assert_array_equal(found[~due], 0.0)
    np.testing.assert_array_equal(divisor[2], 0.0)
    np.testing.assert_array_equal(np.delete(divisor, 2, axis=0), 1.0)
    due[2] = False
    np.testing.assert_array_equal(valid, due)


def test_channel_responses_come_back(tmp_path: Path) -> None:
    path, plain = tmp_path / "a.drive.h5", make_description(sweeps=True)
    assert isinstance(plain.recording, SweepRecording)
    gain, delay_ns = np.array([0.9, 1.0, 1.1]), np.array([-0.2, 0.0, 0.2])
    recording = replace(plain.recording, group_delay_ns=12.5, channel_gain=gain, channel_delay_ns=delay_ns)
    with DriveWriter.create(path, replace(plain, recording=recording), channels=3, dtype=np.complex64) as writer:
        writer.append_sweeps(np.arange(5.0), _sweeps(), _sweeps()[:, 0])
    with DriveLog.open(path) as log:
        found = log.description.recording
        assert isinstance(found, SweepRecording)
        assert found.group_delay_ns == 12.5
        np.testing.assert_array_equal(found.response.gain, gain)
        np.testing.assert_array_equal(found.response.delay_ns, delay_ns)
    with refused("/radar/channel_gain", "1 of 3"):
        DriveWriter.create(
            tmp_path / "b.drive.h5",
            replace(plain, recording=replace(recording, channel_gain=gain * [1, 0, 1])),
            channels=3,
            dtype=np.complex64,
        )


def test_logs_of_version_1_0_are_read(tmp_path: Path) -> None:
    """They know neither group delay nor channel responses, and their sweeps no mask."""
    path = tmp_path / "a.drive.h5"
    with DriveWriter.create(path, make_description(sweeps=True), channels=3, dtype=np.complex64) as writer:
        writer.append_sweeps(np.arange(5.0), _sweeps(), _sweeps()[:, 0])
    with h5py.File(path, "r+") as store:
        store.attrs["schema_version"] = np.bytes_("1.0")
        del store["/radar/sweeps"].attrs["group_delay_ns"]
        del store["/radar/valid"]
    assert check_file(path) == []
    with DriveLog.open(path) as log:
        found = log.description.recording
        assert isinstance(found, SweepRecording)
        assert found.group_delay_ns == 0.0
        np.testing.assert_array_equal(found.response.gain, np.ones(3))
        np.testing.assert_array_equal(found.response.delay_ns, np.zeros(3))
        assert log.read_sweeps(0, 5)[2].all()


def test_traces_are_no_sweeps(tmp_path: Path) -> None:
    with DriveLog.open(write_drive(tmp_path / "a.drive.h5")) as log:
        with refused("/radar/sweeps"):
            log.read_sweeps(0, 1)
        with refused("scans", "0 to 6", found="4 to 7"):
            log.read_traces(4, 7)
