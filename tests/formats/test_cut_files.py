"""Files that end too early: refused in traces, and read as far as they are whole where that is asked for."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from formats.samples import IPRB_TRACES, dzt_header, write_dt1, write_iprb, write_mala
from formats.segy_sample import write_segy
from lgprjax.errors import InputError
from lgprjax.formats import read_iprb_array, read_profile, read_segy
from lgprjax.formats.surveys import READERS

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


@pytest.mark.parametrize("name", _FILES)
@pytest.mark.parametrize("extra", [0, 7])
def test_cut_file(tmp_path: Path, name: str, extra: int) -> None:
    make, traces, before, trace_bytes, header = _FILES[name]
    path = make(tmp_path / name)
    whole = read_profile(path, partial=True)
    assert whole.cut is None
    assert len(whole.channels) == traces
    path.write_bytes(path.read_bytes()[: before + 2 * trace_bytes + extra])
    if header is None and extra == 0:
        # Nothing says that anything is missing.
        assert read_profile(path).cut is None
        assert len(read_profile(path).channels) == 2
        return
    expected = "a whole number" if header is None else f"{traces} as {header} says"
    found = "2 and a part of one" if extra else "2"
    with pytest.raises(InputError) as caught:
        read_profile(path)
    line = f"{path}: traces: expected {expected}, found {found}; read the whole ones with lgprjax import --partial"
    assert str(caught.value) == line
    cut = read_profile(path, partial=True)
    np.testing.assert_array_equal(cut.channels, whole.channels[:2])
    assert cut.cut == ("2 of at least 3 traces" if header is None else f"2 of {traces} traces")
    assert cut.positions_m is None or len(cut.positions_m) == 2
    assert list(tmp_path.glob("*.sgy*")) == ([path] if name == "a.sgy" else [])


@pytest.mark.parametrize("name", _FILES)
def test_no_whole_trace_is_refused_with_and_without_the_option(tmp_path: Path, name: str) -> None:
    make, _, before, trace_bytes, _ = _FILES[name]
    path = make(tmp_path / name)
    data = path.read_bytes()
    for size in {before + 1, before + trace_bytes - 1}:
        path.write_bytes(data[:size])
        for partial in (False, True):
            with pytest.raises(InputError, match=r"traces: expected .*, found a part of one$"):
                read_profile(path, partial=partial)


@pytest.mark.parametrize("name", [name for name, row in _FILES.items() if row[4]])
def test_more_traces_than_the_header_says_are_no_cut(tmp_path: Path, name: str) -> None:
    path = _FILES[name][0](tmp_path / name)
    data = path.read_bytes()
    path.write_bytes(data + data[: _FILES[name][3]])
    for partial in (False, True):
        with pytest.raises(InputError, match=r"traces: expected 6 as .* says, found 7$"):
            read_profile(path, partial=partial)


def test_cut_channels_of_an_array_keep_what_all_have(tmp_path: Path) -> None:
    paths = [write_iprb(tmp_path / f"a_A0{n}.iprb", IPRB_TRACES + n, CH_X_OFFSET=0.1 * n) for n in range(3)]
    data = [path.read_bytes() for path in paths]
    paths[0].write_bytes(data[0][:-16])
    paths[2].write_bytes(data[2][:-20])
    with pytest.raises(InputError, match=r"a_A00\.iprb: traces: expected 5 as a_A00\.iprh says, found 4; read"):
        read_iprb_array(paths)
    profile = read_iprb_array(paths, partial=True)
    np.testing.assert_array_equal(profile.channels, np.stack([IPRB_TRACES[:3] + n for n in range(3)], axis=1))
    assert profile.cut == "3 of 5 traces"
    assert profile.positions_m is not None
    assert len(profile.positions_m) == 3


def test_array_of_lines_of_different_length_is_none(tmp_path: Path) -> None:
    """A channel that is whole and shorter than a cut one belongs to another recording."""
    first = write_iprb(tmp_path / "a_A01.iprb")
    short = write_iprb(tmp_path / "a_A02.iprb", IPRB_TRACES[:3], CH_X_OFFSET=0.1)
    first.write_bytes(first.read_bytes()[:-3])
    with pytest.raises(InputError, match=r"a_A02\.iprb: recording: expected 4 traces of 8 samples of 16 bits as in"):
        read_iprb_array([first, short], partial=True)
    other = write_iprb(tmp_path / "a_A03.iprb", LAST__TRACE=7, CH_X_OFFSET=0.2)
    with pytest.raises(InputError, match=r"a_A03\.iprh: LAST TRACE: expected 5 as in a_A01.iprh, found 7"):
        read_iprb_array([first, other], partial=True)


def test_cut_segy_keeps_its_options(tmp_path: Path) -> None:
    path = write_segy(tmp_path / "a.sgy", interval=4000, trace_interval=4000)
    path.write_bytes(path.read_bytes()[:-5])
    profile = read_segy(path, sample_interval_ns=0.8, partial=True)
    assert (profile.sample_interval_ns, profile.cut, len(profile.channels)) == (0.8, "5 of at least 6 traces", 5)
    assert profile.path == path


def test_every_suffix_is_tried_here() -> None:
    assert set(READERS) == {Path(name).suffix.lower() for name in _FILES} | {".segy"}
