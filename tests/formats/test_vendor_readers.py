"""Vendor readers: the real files, and every trap of the formats in a file written byte by byte."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from formats.samples import dzt_header, real_data, write_dt1, write_mala
from lgprjax.errors import InputError
from lgprjax.formats import read_dt1, read_dzt, read_mala, read_profile

_TRACES = np.random.default_rng(2).integers(-30000, 30000, (4, 8))

# file, time zero ns, centre frequency Hz; everything else is held against the data's table in test_real_table.py
_REAL = [
    ("gprpy_dune/FILE____032.DZT", 0.0, 400e6),
    ("gprpy_yosemite/XLINE00.DT1", 3.18 * 0.8, 50e6),
    ("gprpymini_mala500/utility_example.rd3", 0.0, 500e6),
    ("hautefeuille/FILE__001.DZT", 8.88889, 350e6),
    ("hautefeuille/FILE__002.DZT", 8.88889, 350e6),
    ("hautefeuille/FILE__003.DZT", 8.88889, 350e6),
    ("charisma_lab_slab/Lab_specimen_data.DZT", 0.0, 1.6e9),
]


@pytest.mark.real
@pytest.mark.parametrize(("name", "zero", "frequency"), _REAL)
def test_real_file(name: str, zero: float, frequency: float) -> None:
    profile = read_profile(real_data() / name)
    assert profile.time_zero_ns == pytest.approx(zero, rel=1e-5)
    assert profile.centre_frequency_hz == pytest.approx(frequency)
    # Offset binary read with the wrong sign, or marks taken for data, would show here.
    amplitude = np.abs(profile.traces.astype(np.float64)).max(axis=0)
    assert abs(profile.traces.mean()) < 0.05 * amplitude.max()


@pytest.mark.real
def test_real_parallel_lines_have_fractional_time_zeros() -> None:
    folder = real_data() / "gpr_o_parallel_lines"
    profiles = [read_dt1(path) for path in sorted(folder.glob("*.DT1"))]
    assert sorted({round(p.time_zero_ns / 0.8, 2) for p in profiles}) == [1.14, 1.15, 1.49]


def test_dt1_in_feet_with_fractional_time_zero(tmp_path: Path) -> None:
    profile = read_dt1(write_dt1(tmp_path / "a.DT1", _TRACES, unit="ft", step=2.0, start=10.0))
    np.testing.assert_array_equal(profile.traces, _TRACES)
    assert profile.spacing_m == pytest.approx(0.6096)
    assert profile.positions_m is not None
    np.testing.assert_allclose(profile.positions_m, (10 + 2 * np.arange(4)) * 0.3048)
    assert profile.sample_interval_ns == pytest.approx(0.8)
    assert profile.time_zero_ns == pytest.approx(1.0)
    assert profile.centre_frequency_hz == 100e6


def test_dt1_finds_its_header_in_any_case(tmp_path: Path) -> None:
    path = write_dt1(tmp_path / "a.dt1", _TRACES)
    path.with_suffix(".HD").rename(tmp_path / "a.hd")
    np.testing.assert_array_equal(read_dt1(path).traces, _TRACES)


@pytest.mark.parametrize("bits", [8, 16, 32])
def test_dzt_sample_types_and_marks(tmp_path: Path, bits: int) -> None:
    dtype, offset, scale = {8: ("u1", 128, 256), 16: ("<u2", 32768, 1), 32: ("<i4", 0, 1)}[bits]
    signed = _TRACES // scale
    path = tmp_path / "a.DZT"
    path.write_bytes(dzt_header(bits=bits) + (signed + offset).astype(dtype).tobytes())
    profile = read_dzt(path)
    np.testing.assert_array_equal(profile.traces[:, 2:], signed[:, 2:])
    np.testing.assert_array_equal(profile.traces[:, :2], 0)
    assert profile.sample_interval_ns == 0.5


@pytest.mark.parametrize(("word", "offset"), [(1, 1024), (128, 131072), (1024, 1024), (2048, 2048)])
def test_dzt_data_offset(tmp_path: Path, word: int, offset: int) -> None:
    path = tmp_path / "a.DZT"
    path.write_bytes(dzt_header(word=word, bits=32).ljust(offset, b"\0") + _TRACES.astype("<i4").tobytes())
    np.testing.assert_array_equal(read_dzt(path).traces[:, 2:], _TRACES[:, 2:])


@pytest.mark.parametrize("word", [2, 1024, 2048])
def test_dzt_channels_are_interleaved_and_each_has_a_header(tmp_path: Path, word: int) -> None:
    path = tmp_path / "a.DZT"
    block = dzt_header(word=word, bits=32, channels=2)
    path.write_bytes(block + block + _TRACES.astype("<i4").tobytes())
    profile = read_dzt(path)
    assert profile.channels.shape == (2, 2, 8)
    np.testing.assert_array_equal(profile.channels[1, 0, 2:], _TRACES[2, 2:])
    np.testing.assert_array_equal(profile.channels[1, 1, 2:], _TRACES[3, 2:])
    np.testing.assert_array_equal(profile.traces, profile.channels[:, 0])


def test_dzt_recorded_by_time_with_nothing_said(tmp_path: Path) -> None:
    path = tmp_path / "a.DZT"
    header = dzt_header(bits=32, per_m=0.0, permittivity=0.0, antenna=b"", position_ns=-8.889)
    path.write_bytes(header + _TRACES.astype("<i4").tobytes())
    profile = read_dzt(path)
    assert profile.spacing_m is None
    assert profile.positions_m is None
    assert profile.centre_frequency_hz is None
    assert profile.time_zero_ns == pytest.approx(8.889)


@pytest.mark.parametrize(
    ("antenna", "frequency_hz"),
    [(b"400MHz", 400e6), (b"1.5/1.6GHz", 1.6e9), (b"HS350US", 350e6), (b"350HS", 350e6), (b"3207", None), (b"", None)],
)
def test_dzt_frequency_from_antenna_name(tmp_path: Path, antenna: bytes, frequency_hz: float | None) -> None:
    path = tmp_path / "a.DZT"
    path.write_bytes(dzt_header(bits=32, antenna=antenna) + _TRACES.astype("<i4").tobytes())
    assert read_dzt(path).centre_frequency_hz == frequency_hz


@pytest.mark.parametrize(("suffix", "dtype"), [(".rd3", "<i2"), (".RD7", "<i4")])
def test_mala_sample_rate_is_in_megahertz(tmp_path: Path, suffix: str, dtype: str) -> None:
    stored = _TRACES * (1 if dtype == "<i2" else 70000)
    profile = read_mala(write_mala(tmp_path / f"a{suffix}", stored.astype(dtype)))
    np.testing.assert_array_equal(profile.traces, stored)
    assert profile.sample_interval_ns == pytest.approx(0.2)
    assert profile.spacing_m == 0.01
    assert profile.centre_frequency_hz == 500e6


@pytest.mark.parametrize(
    ("antenna", "frequency_hz"),
    [("500 MHz shielded", 500e6), ("1.2 mhz", 1.2e6), ("GX80", None), ("0 MHz", None), (f"{'9' * 5000} MHz", None)],
)
def test_mala_frequency_from_antenna_name(tmp_path: Path, antenna: str, frequency_hz: float | None) -> None:
    path = write_mala(tmp_path / "a.rd3", _TRACES.astype("<i2"), ANTENNAS=antenna)
    assert read_mala(path).centre_frequency_hz == frequency_hz


def test_mala_rd7_is_not_read_as_rd3(tmp_path: Path) -> None:
    path = write_mala(tmp_path / "a.rd3", _TRACES.astype("<i4"))
    with pytest.raises(InputError, match=r"traces: expected 4 as a.rad says, found 8$"):
        read_mala(path)
    np.testing.assert_array_equal(read_mala(path.rename(tmp_path / "a.rd7")).traces, _TRACES)


def test_mala_recorded_by_time(tmp_path: Path) -> None:
    profile = read_mala(write_mala(tmp_path / "a.rd3", _TRACES.astype("<i2"), DISTANCE_INTERVAL=0.0))
    assert profile.spacing_m is None
    assert profile.positions_m is None


def _dt1(**lines: object) -> Callable[[Path], Path]:
    return lambda folder: write_dt1(folder / "a.DT1", _TRACES, **lines)  # type: ignore[arg-type]


def _dt1_bytes(edit: Callable[[bytes], bytes]) -> Callable[[Path], Path]:
    def make(folder: Path) -> Path:
        path = write_dt1(folder / "a.DT1", _TRACES)
        path.write_bytes(edit(path.read_bytes()))
        return path

    return make


def _dzt(data: bytes) -> Callable[[Path], Path]:
    def make(folder: Path) -> Path:
        path = folder / "a.DZT"
        path.write_bytes(data)
        return path

    return make


def _mala(**lines: object) -> Callable[[Path], Path]:
    return lambda folder: write_mala(folder / "a.rd3", _TRACES.astype("<i2"), **lines)


def _lonely(name: str) -> Callable[[Path], Path]:
    def make(folder: Path) -> Path:
        (folder / name).write_bytes(b"data")
        return folder / name

    return make


_DATA = _TRACES.astype("<i4").tobytes()
_NAN = np.float32(np.nan).tobytes()
_BAD: dict[str, tuple[Callable[[Path], Path], str]] = {
    "dt1 without header": (_lonely("a.DT1"), "header file: expected a.HD beside it, found none: copy it there"),
    "dt1 count": (
        _dt1(NUMBER_OF_TRACES=5),
        "a.DT1: traces: expected 5 as a.HD says, found 4; read the whole ones with lgprjax import --partial",
    ),
    "dt1 more than its header says": (_dt1(NUMBER_OF_TRACES=3), "a.DT1: traces: expected 3 as a.HD says, found 4"),
    "dt1 cut short": (_dt1_bytes(lambda data: data[:-7]), "expected 4 as a.HD says, found 3 and a part of one; read"),
    "dt1 no whole trace": (_dt1_bytes(lambda data: data[:99]), "traces: expected 4 as a.HD says, found a part of one"),
    "dt1 empty": (_dt1_bytes(lambda _: b""), "an empty file"),
    "dt1 other samples": (_dt1_bytes(lambda d: d[:8] + bytes(4) + d[12:]), "header of trace 0: expected 8 samples"),
    "dt1 position": (_dt1_bytes(lambda d: d[:4] + _NAN + d[8:]), "header of trace 0: expected a finite position"),
    "dt1 position of no value": (_dt1_bytes(lambda d: d[:4] + b"\1\0\x80\x7f" + d[8:]), "trace 0: expected a finite"),
    "dt1 endless window": (_dt1(TOTAL_TIME_WINDOW=1e300), "TOTAL TIME WINDOW: expected a number, found '1e+300'"),
    "dt1 window of nothing": (_dt1(TOTAL_TIME_WINDOW=1e-300), "expected a number above zero, found 1e-300"),
    "dt1 unit": (_dt1(unit="furlong"), "POSITION UNITS: expected m or ft, found 'furlong'"),
    "dt1 window": (_dt1(TOTAL_TIME_WINDOW=-200), "TOTAL TIME WINDOW: expected a number above zero, found -200"),
    "dt1 no window": (_dt1(TOTAL_TIME_WINDOW=0), "TOTAL TIME WINDOW: expected a number above zero, found 0"),
    "dt1 step": (_dt1(STEP_SIZE_USED=0), "STEP SIZE USED: expected a number above zero"),
    "dt1 nan window": (_dt1(TOTAL_TIME_WINDOW="nan"), "TOTAL TIME WINDOW: expected a number, found 'nan'"),
    "dt1 word for a number": (_dt1(TIMEZERO_AT_POINT="first"), "TIMEZERO AT POINT: expected a number, found 'first'"),
    "dzt missing": (lambda folder: folder / "none.DZT", "No such file"),
    "dzt empty": (_dzt(b""), "an empty file"),
    "dzt folder": (lambda folder: folder, "file: expected a recording, found a folder"),
    "dzt short header": (_dzt(dzt_header()[:1000]), "header of channel 0: expected 1024 bytes, found 1000 bytes"),
    "dzt other format": (_dzt(b"II*\0" * 400), "expected a DZT header"),
    "dzt zeros": (_dzt(bytes(4096)), "found tag 0x0000 with 0 bits a sample"),
    "dzt bits": (_dzt(dzt_header(bits=24) + _DATA), "with 24 bits a sample"),
    "dzt no data": (_dzt(dzt_header()), "traces: expected at least one, found none"),
    "dzt cut short": (
        _dzt((dzt_header(bits=32) + _DATA)[:-3]),
        "traces: expected a whole number, found 3 and a part of one; read",
    ),
    "dzt offset beyond": (_dzt(dzt_header(word=128) + _DATA), "traces: expected at least one, found none"),
    "dzt no offset": (_dzt(dzt_header(word=0) + _DATA), "found 0 bytes for 1 channels"),
    "dzt range": (_dzt(dzt_header(range_ns=-5) + _DATA), "range_ns: expected a number above zero, found -5"),
    "dzt no range": (_dzt(dzt_header(range_ns=0) + _DATA), "range_ns: expected a number above zero, found 0"),
    "dzt nan range": (_dzt(dzt_header(range_ns=float("nan")) + _DATA), "range_ns: expected a number above zero"),
    "dzt inf position": (_dzt(dzt_header(position_ns=float("inf")) + _DATA), "position_ns: expected a finite number"),
    "dzt spacing": (_dzt(dzt_header(per_m=-50) + _DATA), "scans_per_m: expected zero or more, found -50"),
    "dzt channels": (_dzt(dzt_header(channels=0) + _DATA), "channels: expected 1 to 16, found 0"),
    "dzt samples": (_dzt(dzt_header(samples=2) + _DATA), "samples: expected more than 2, found 2"),
    "dzt unlike channels": (
        _dzt(dzt_header(word=2, channels=2) + dzt_header(word=2, channels=2, range_ns=9.0) + _DATA),
        "header of channel 1, range_ns: expected 4.0 as in channel 0, found 9.0",
    ),
    "no such file": (lambda folder: folder / "a.dt1", "file: expected a readable file, found no such file"),
    "mala without header": (_lonely("a.rd3"), "header file: expected a.rad beside it, found none"),
    "mala count": (
        _mala(LAST_TRACE=9),
        "traces: expected 9 as a.rad says, found 4; read the whole",
    ),
    "mala samples": (_mala(SAMPLES=7, TIMEWINDOW=1.4), "traces: expected 4 as a.rad says, found 4 and a part of one"),
    "mala rate": (_mala(FREQUENCY=-1), "FREQUENCY: expected a number above zero, found -1"),
    "mala window": (_mala(TIMEWINDOW=80.0), "TIMEWINDOW: expected 8 samples at FREQUENCY, 1.6 ns, found 80"),
    "mala spacing": (_mala(DISTANCE_INTERVAL=-0.1), "DISTANCE INTERVAL: expected zero or more, found -0.1"),
    "mala fraction of samples": (_mala(SAMPLES=7.5), "SAMPLES: expected a whole number, found 7.5"),
    "unknown suffix": (_lonely("a.gpz"), "file name: expected a suffix among .dt1, .dzt, .rd3, .rd7, .iprb, .sgy"),
}


@pytest.mark.parametrize("case", _BAD)
def test_bad_file_is_one_clear_line(tmp_path: Path, case: str) -> None:
    make, words = _BAD[case]
    with pytest.raises(InputError) as caught:
        read_profile(make(tmp_path))
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)
    assert str(tmp_path) in str(caught.value)
