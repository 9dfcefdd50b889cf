"""Files that end too early: refused in traces, and read as far as they are whole where that is asked for."""

import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from formats.samples import IPRB_TRACES, dzt_header, write_dt1, write_iprb, write_mala
from formats.segy_sample import write_segy
from lgprjax.formats import read_iprb_array, read_profile, read_segy
from lgprjax.formats.surveys import READERS
from refusals import refused

_TRACES = np.random.default_rng(6).integers(-30000, 30000, (6, 8))


def _dzt(path: Path) -> Path:
    """Two channels of three traces."""
    block = dzt_header(word=2, channels=2)
    path.write_bytes(block + block + (_TRACES + 32768).astype("<u2").tobytes())
    return path


# Name and maker of a file; its traces; the bytes before them and of one; what the headers say of their number.
_FILES: dict[str, tuple[Callable[[Path], Path], int, int, int, str | None]] = {
    "a.DT1": (lambda path: write_dt1(path, _TRACES), 6, 0, 144, "a.HD"),
    "a.dzt": (_dzt, 3, 2048, 32, None),
    "a.rd3": (lambda path: write_mala(path, _TRACES.astype("<i2")), 6, 0, 16, "a.rad"),
    "a.rd7": (lambda path: write_mala(path, _TRACES.astype("<i4")), 6, 0, 32, "a.rad"),
    "a.iprb": (lambda path: write_iprb(path, _TRACES), 6, 0, 16, "a.iprh"),
    "a.sgy": (lambda path: write_segy(path, _TRACES), 6, 3600, 256, None),
}


def _numbers(text: str | None) -> list[int]:
    assert text is not None
    return [int(number) for number in re.findall(r"\d+", text)]


@pytest.mark.parametrize("name", _FILES)
def test_cut_file(tmp_path: Path, name: str) -> None:
    make, traces, before, trace_bytes, header = _FILES[name]
    path = make(tmp_path / name)
    data, whole = path.read_bytes(), read_profile(path, partial=True)
    assert whole.cut is None
    assert len(whole.channels) == traces
    said = () if header is None else (traces, header)
    for extra in (0, 7):
        path.write_bytes(data[: before + 2 * trace_bytes + extra])
        if header is None and extra == 0:
            # Nothing says that anything is missing.
            assert read_profile(path).cut is None
            assert len(read_profile(path).channels) == 2
            continue
        with refused("traces", *said, file=path, found="--partial"):
            read_profile(path)
        cut = read_profile(path, partial=True)
        np.testing.assert_array_equal(cut.channels, whole.channels[:2])
        assert _numbers(cut.cut) == [2, 3 if header is None else traces]
        assert cut.positions_m is None or len(cut.positions_m) == 2
    # No whole trace, and one more than the header says.
    bad: dict[bytes, tuple[int, ...]] = {data[: before + 1]: (), data[: before + trace_bytes - 1]: ()}
    bad |= {} if header is None else {data + data[:trace_bytes]: (6, 7)}
    for size, values in bad.items():
        path.write_bytes(size)
        for partial in (False, True):
            with refused("traces", *values, file=path):
                read_profile(path, partial=partial)
    assert {each.suffix for each in tmp_path.iterdir()} <= {path.suffix, Path(header or name).suffix}


def test_cut_channels_of_an_array_keep_what_all_have(tmp_path: Path) -> None:
    paths = [write_iprb(tmp_path / f"a_A0{n}.iprb", IPRB_TRACES + n, CH_X_OFFSET=0.1 * n) for n in range(3)]
    for path, missing in ((paths[0], 16), (paths[2], 20)):
        path.write_bytes(path.read_bytes()[:-missing])
    with refused("traces", 5, "a_A00.iprh", file="a_A00.iprb", found=4):
        read_iprb_array(paths)
    profile = read_iprb_array(paths, partial=True)
    np.testing.assert_array_equal(profile.channels, np.stack([IPRB_TRACES[:3] + n for n in range(3)], axis=1))
    assert _numbers(profile.cut) == [3, 5]
    assert profile.positions_m is not None
    assert len(profile.positions_m) == 3


def test_array_of_lines_of_different_length_is_none(tmp_path: Path) -> None:
    """A channel that is whole and shorter than a cut one belongs to another recording."""
    first = write_iprb(tmp_path / "a_A01.iprb")
    short = write_iprb(tmp_path / "a_A02.iprb", IPRB_TRACES[:3], CH_X_OFFSET=0.1)
    first.write_bytes(first.read_bytes()[:-3])
    with refused("recording", 4, 8, 16, file="a_A02.iprb"):
        read_iprb_array([first, short], partial=True)
    other = write_iprb(tmp_path / "a_A03.iprb", LAST__TRACE=7, CH_X_OFFSET=0.2)
    with refused("LAST TRACE", 5, "a_A01.iprh", file="a_A03.iprh", found=7):
        read_iprb_array([first, other], partial=True)


def test_cut_segy_keeps_its_options(tmp_path: Path) -> None:
    path = write_segy(tmp_path / "a.sgy", interval=4000, trace_interval=4000)
    path.write_bytes(path.read_bytes()[:-5])
    profile = read_segy(path, sample_interval_ns=0.8, partial=True)
    assert (profile.path, profile.sample_interval_ns, len(profile.channels)) == (path, 0.8, 5)


def test_every_suffix_is_tried_here() -> None:
    assert set(READERS) == {Path(name).suffix.lower() for name in _FILES} | {".segy"}
