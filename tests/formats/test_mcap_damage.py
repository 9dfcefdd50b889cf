"""Recordings that were cut, damaged or are none, and long ones: what is whole comes in, in little memory."""

from pathlib import Path

import numpy as np
import pytest

from formats.mcap_sample import rover_messages, write_recording
from lgprjax.errors import InputError
from lgprjax.formats import DriveLog, UniformArray, check_file, import_mcap
from refusals import refused

PITCH = UniformArray(0.2, 0.5, 0.15)


@pytest.fixture(scope="module")
def curved(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, np.ndarray]:
    """A recording in small chunks, and its scans."""
    folder = tmp_path_factory.mktemp("curved")
    messages = rover_messages(80)
    path = write_recording(folder / "a.mcap", messages, chunk_size=2048)
    signal = [np.frombuffer(each[3]["data"], np.int16).reshape(2, 16) for each in messages if each[0] == "/rover/gpr"]
    return path, np.array(signal)


def _rows_of(path: Path) -> np.ndarray:
    with DriveLog.open(path) as log:
        return log.read_stored(0, log.scans)[0]


@pytest.mark.parametrize("share", [0.3, 0.999])
def test_a_killed_recorder_loses_only_what_is_not_whole(
    curved: tuple[Path, np.ndarray], share: float, tmp_path: Path
) -> None:
    path, signal = curved
    data = path.read_bytes()
    (tmp_path / "cut.mcap").write_bytes(data[: int(share * len(data))])
    imported = import_mcap(tmp_path / "cut.mcap", array=PITCH, output=tmp_path / "cut.drive.h5")
    assert len(imported.notes) >= 1
    stored = _rows_of(tmp_path / "cut.drive.h5")
    np.testing.assert_array_equal(stored, signal[: len(stored)])
    assert len(stored) >= (share - 0.25) * len(signal)


def test_a_damaged_chunk_costs_its_own_messages(curved: tuple[Path, np.ndarray], tmp_path: Path) -> None:
    """In one file the content of a chunk is damaged, in the other the length of its record."""
    path, signal = curved
    data = path.read_bytes()
    chunk = data.index(b"zstd", len(data) // 2)
    begin = data.rindex(b"\x06", 0, chunk - 40)
    for name, at in {"content": chunk + 60, "length": begin + 3}.items():
        damaged = bytearray(data)
        damaged[at] ^= 0xFF
        (tmp_path / f"{name}.mcap").write_bytes(damaged)
        imported = import_mcap(tmp_path / f"{name}.mcap", array=PITCH, output=tmp_path / f"{name}.drive.h5")
        assert len(imported.notes) >= 1
        stored = _rows_of(tmp_path / f"{name}.drive.h5")
        assert len(signal) * 0.7 < len(stored) < len(signal)
        # What is left are scans of before and of after the damage, in their order.
        place = [int(np.flatnonzero((signal == scan).all(axis=(1, 2)))[0]) for scan in stored]
        assert place == sorted(place)
        assert place[0] == 0
        assert place[-1] == len(signal) - 1


def try_changed_bytes(seed: int, times: int, folder: Path) -> None:
    """Whatever bytes come, the drive is sound or there is none; nothing is left half-written."""
    path = write_recording(folder / "x.mcap", rover_messages(20), chunk_size=2048)
    data, rng = path.read_bytes(), np.random.default_rng(seed)
    told = 0
    for _ in range(times):
        changed_data = bytearray(data)
        for at in rng.integers(0, len(data), int(rng.integers(1, 6))):
            changed_data[at] = int(rng.integers(0, 256))
        if rng.random() < 0.3:
            first, last = sorted(rng.integers(0, len(data), 2))
            del changed_data[first : min(last, first + 300)]
        path.write_bytes(changed_data)
        try:
            import_mcap(path, array=PITCH, output=folder / "x.drive.h5", force=True)
        except InputError:
            told += 1
        else:
            assert [each for each in check_file(folder / "x.drive.h5") if each.severity == "error"] == []
        assert {each.name for each in folder.iterdir()} <= {"x.mcap", "x.drive.h5"}
    assert told < times


def test_changed_bytes_are_refused_or_a_drive(tmp_path: Path) -> None:
    """Forty seeds of it: ``make validation NAME=damage``."""
    try_changed_bytes(0, 20, tmp_path)


def test_files_that_hold_no_recording_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "x.mcap"
    for content, place in ((None, "file"), (b"", "file"), (b"GIF89a" * 40, "file"), (b"\x89MCAP0\r\n" * 9, "topics")):
        if content is not None:
            path.write_bytes(content)
        with refused(place, file=path):
            import_mcap(path, output=tmp_path / "x.drive.h5")
