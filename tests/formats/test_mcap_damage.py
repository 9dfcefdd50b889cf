"""Recordings that were cut, damaged or are none, and long ones: what is whole comes in, in little memory."""

import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from formats.mcap_sample import rover_messages, write_recording
from formats.samples import make_description, make_track
from lgprjax.errors import InputError
from lgprjax.formats import DriveLog, DriveWriter, OdometryTrack, UniformArray, check_file, export_mcap, import_mcap

_PITCH = UniformArray(0.2, 0.5, 0.15)


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


@pytest.mark.parametrize("share", [0.3, 0.55, 0.9, 0.999])
def test_a_killed_recorder_loses_only_what_is_not_whole(
    curved: tuple[Path, np.ndarray], share: float, tmp_path: Path
) -> None:
    path, signal = curved
    data = path.read_bytes()
    (tmp_path / "cut.mcap").write_bytes(data[: int(share * len(data))])
    imported = import_mcap(tmp_path / "cut.mcap", array=_PITCH, output=tmp_path / "cut.drive.h5")
    assert any("ends too early or is damaged" in note for note in imported.notes)
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
        imported = import_mcap(tmp_path / f"{name}.mcap", array=_PITCH, output=tmp_path / f"{name}.drive.h5")
        assert any("damaged" in note for note in imported.notes)
        stored = _rows_of(tmp_path / f"{name}.drive.h5")
        assert len(signal) * 0.7 < len(stored) < len(signal)
        # What is left are scans of before and of after the damage, in their order.
        place = [int(np.flatnonzero((signal == scan).all(axis=(1, 2)))[0]) for scan in stored]
        assert place == sorted(place)
        assert place[0] == 0
        assert place[-1] == len(signal) - 1


@pytest.mark.parametrize("seed", [0, *(pytest.param(seed, marks=pytest.mark.campaign) for seed in range(1, 40))])
def test_changed_bytes_are_one_line_or_a_drive(seed: int, tmp_path: Path) -> None:
    """Whatever bytes come, the drive is sound or there is none; nothing is left half-written."""
    path = write_recording(tmp_path / "x.mcap", rover_messages(20), chunk_size=2048)
    data, rng = path.read_bytes(), np.random.default_rng(seed)
    told: list[str] = []
    for _ in range(40):
        changed_data = bytearray(data)
        for at in rng.integers(0, len(data), int(rng.integers(1, 6))):
            changed_data[at] = int(rng.integers(0, 256))
        if rng.random() < 0.3:
            first, last = sorted(rng.integers(0, len(data), 2))
            del changed_data[first : min(last, first + 300)]
        (tmp_path / "x.mcap").write_bytes(changed_data)
        try:
            import_mcap(tmp_path / "x.mcap", array=_PITCH, output=tmp_path / "x.drive.h5", force=True)
        except InputError as error:
            told.append(str(error))
        else:
            assert [each for each in check_file(tmp_path / "x.drive.h5") if each.severity == "error"] == []
        assert {each.name for each in tmp_path.iterdir()} <= {"x.mcap", "x.drive.h5"}
    assert len(told) < 40
    assert not [line for line in told if "\n" in line]


@pytest.mark.parametrize("content", [b"", b"\x89MCAP0\r\n", b"GIF89a" * 40, b"\x89MCAP0\r\n" * 9])
def test_files_that_hold_no_recording(content: bytes, tmp_path: Path) -> None:
    (tmp_path / "x.mcap").write_bytes(content)
    with pytest.raises(InputError, match=r"x\.mcap: (file|topics): expected"):
        import_mcap(tmp_path / "x.mcap", output=tmp_path / "x.drive.h5")
    with pytest.raises(InputError, match="readable file"):
        import_mcap(tmp_path / "none.mcap", output=tmp_path / "x.drive.h5")


@pytest.mark.campaign
def test_memory_does_not_grow_with_the_drive(tmp_path: Path) -> None:
    """Fifty MB more of scans, and a process that imports them needs no more."""
    peaks_kib, block = [], np.random.default_rng(1).integers(0, 256, (1000, 11, 369), dtype=np.uint8)
    for scans in (3000, 15000):
        time_s = np.arange(0.0, scans / 126.0 + 0.5, 0.5)
        description = replace(
            make_description(channels=11, samples=369),
            navigation=make_track(len(time_s)),
            odometry=OdometryTrack(time_s, time_s),
        )
        with DriveWriter.create(tmp_path / "a.drive.h5", description, channels=11, dtype=np.uint8) as writer:
            for first in range(0, scans, len(block)):
                writer.append(np.arange(first, first + len(block)) / 126.0, block)
        export_mcap(tmp_path / "a.drive.h5", tmp_path / "a.mcap", force=True)
        paths = f"{str(tmp_path / 'a.mcap')!r}, output={str(tmp_path / 'b.drive.h5')!r}"
        code = (
            f"import resource; from lgprjax.formats import import_mcap; import_mcap({paths}, force=True); "
            "print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)"
        )
        done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
        peaks_kib.append(int(done.stdout))
        (tmp_path / "a.drive.h5").unlink()
    assert peaks_kib[1] < peaks_kib[0] + 12000
