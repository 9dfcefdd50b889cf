"""Vendor readers: the real files, channels against another reading of their bytes, and the traps of each format."""

import struct
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from formats.samples import dzt_header, write_dt1, write_mala
from lgprjax.formats import read_dt1, read_dzt, read_mala, read_profile
from refusals import refused

_TRACES = np.random.default_rng(2).integers(-30000, 30000, (4, 8))
_BIAS = {8: 128, 16: 32768, 32: 0}

# file: time zero ns, centre frequency Hz; validation/surveys/test_real_table.py holds all else against the data's table
_REAL = {
    "gprpy_dune/FILE____032.DZT": (0.0, 400e6),
    "gprpy_yosemite/XLINE00.DT1": (3.18 * 0.8, 50e6),
    "gprpymini_mala500/utility_example.rd3": (0.0, 500e6),
    "hautefeuille/FILE__001.DZT": (8.88889, 350e6),
    "charisma_lab_slab/Lab_specimen_data.DZT": (0.0, 1.6e9),
}


def _struct_scan(data: bytes, number: int) -> list[int]:
    """Samples of a scan of a DZT file by ``struct`` alone; those of channels follow one another."""
    word, samples, bits = struct.unpack_from("<3H", data, 2)
    (channels,) = struct.unpack_from("<H", data, 52)
    at = 1024 * word if word < 1024 else max(word, 1024 * channels)
    code = {8: "B", 16: "H", 32: "i"}[bits]
    values = struct.unpack_from(f"<{samples}{code}", data, at + number * samples * bits // 8)
    return [0, 0, *(value - _BIAS[bits] for value in values[2:])]


@pytest.mark.real
def test_real_files(real_data: Path) -> None:
    for name, (zero_ns, frequency_hz) in _REAL.items():
        profile = read_profile(real_data / name)
        assert profile.time_zero_ns == pytest.approx(zero_ns, rel=1e-5)
        assert profile.centre_frequency_hz == pytest.approx(frequency_hz)
        # Offset binary read with the wrong sign, or marks taken for data, would show here.
        amplitude = np.abs(profile.traces.astype(np.float64)).max(axis=0)
        assert abs(profile.traces.mean()) < 0.05 * amplitude.max()
        if name.endswith(".DZT"):
            data = (real_data / name).read_bytes()
            for scan in (0, len(profile.channels) - 1):
                assert profile.channels[scan, 0, 2:].tolist() == _struct_scan(data, scan)[2:], name
    lines = [read_dt1(path) for path in sorted((real_data / "gpr_o_parallel_lines").glob("*.DT1"))]
    assert sorted({round(line.time_zero_ns / 0.8, 2) for line in lines}) == [1.14, 1.15, 1.49]


def test_dt1_in_feet_with_fractional_time_zero_and_a_header_in_any_case(tmp_path: Path) -> None:
    path = write_dt1(tmp_path / "a.dt1", _TRACES, unit="ft", step=2.0, start=10.0)
    path.with_suffix(".HD").rename(tmp_path / "a.hd")
    profile = read_dt1(path)
    np.testing.assert_array_equal(profile.traces, _TRACES)
    assert profile.spacing_m == pytest.approx(0.6096)
    assert profile.positions_m is not None
    np.testing.assert_allclose(profile.positions_m, (10 + 2 * np.arange(4)) * 0.3048)
    assert profile.sample_interval_ns == pytest.approx(0.8)
    assert profile.time_zero_ns == pytest.approx(1.0)
    assert profile.centre_frequency_hz == 100e6


# Small words count header blocks, large ones bytes; behind the latter each channel still has its header.
@pytest.mark.parametrize(
    ("bits", "channels", "word"), [(8, 1, 1), (16, 2, 2), (32, 2, 1024), (16, 3, 128), (8, 4, 4096), (32, 16, 16)]
)
def test_dzt_channels(tmp_path: Path, bits: int, channels: int, word: int) -> None:
    low, high = (0, 2**bits) if bits < 32 else (-(2**31), 2**31)
    stored = np.random.default_rng(bits + channels).integers(low, high, (5, channels, 11))
    # The whole range: the least and the largest value come back as they are.
    stored[0, :, 2], stored[0, :, 3] = low, high - 1
    header = dzt_header(word=word, samples=11, bits=bits, channels=channels, per_m=40.0, range_ns=5.5) * channels
    offset = 1024 * word if word < 1024 else max(word, 1024 * channels)
    data = header.ljust(offset, b"\0") + stored.astype({8: "u1", 16: "<u2", 32: "<i4"}[bits]).tobytes()
    (tmp_path / "a.DZT").write_bytes(data)
    profile = read_dzt(tmp_path / "a.DZT")
    assert profile.channels.shape == (5, channels, 11)
    read = profile.channels.astype(np.int64).reshape(5 * channels, 11)
    np.testing.assert_array_equal(read, [_struct_scan(data, scan) for scan in range(5 * channels)])
    np.testing.assert_array_equal(profile.traces, profile.channels[:, 0])
    assert profile.sample_interval_ns == 0.5
    assert profile.positions_m is not None
    np.testing.assert_allclose(profile.positions_m, np.arange(5) / 40.0)


def test_part_of_a_dzt_channel_is_no_scan(tmp_path: Path) -> None:
    """The last scan of three channels lacks its last channel: that scan is not whole."""
    stored = np.arange(4 * 3 * 8).reshape(4, 3, 8)
    path = tmp_path / "a.DZT"
    path.write_bytes(dzt_header(word=3, channels=3) * 3 + stored.astype("<u2").tobytes()[:-16])
    with refused("traces", found=3):
        read_dzt(path)
    np.testing.assert_array_equal(read_dzt(path, partial=True).channels[:, :, 2:], stored[:3, :, 2:] - 32768)


@pytest.mark.parametrize(
    ("place", "form", "value", "field"),
    [(4, "<H", 9, "samples"), (6, "<H", 32, "bits"), (22, "<f", 1.0, "position_ns"), (26, "<f", 9.0, "range_ns")],
)
def test_dzt_channel_of_another_shape_is_refused(
    tmp_path: Path, place: int, form: str, value: float, field: str
) -> None:
    data = bytearray(dzt_header(word=3, channels=3) * 3 + bytes(2 * 3 * 8 * 2))
    struct.pack_into(form, data, 2048 + place, value)
    (tmp_path / "a.DZT").write_bytes(data)
    with refused(f"header of channel 2, {field}", found=value):
        read_dzt(tmp_path / "a.DZT")


def test_dzt_recorded_by_time_with_nothing_said(tmp_path: Path) -> None:
    path = tmp_path / "a.DZT"
    header = dzt_header(bits=32, per_m=0.0, permittivity=0.0, antenna=b"", position_ns=-8.889)
    path.write_bytes(header + _TRACES.astype("<i4").tobytes())
    profile = read_dzt(path)
    assert (profile.spacing_m, profile.positions_m, profile.centre_frequency_hz) == (None, None, None)
    assert profile.time_zero_ns == pytest.approx(8.889)


def test_frequency_is_read_from_the_antennas_name(tmp_path: Path) -> None:
    path = tmp_path / "a.DZT"
    for antenna, frequency_hz in ((b"1.5/1.6GHz", 1.6e9), (b"HS350US", 350e6), (b"350HS", 350e6), (b"3207", None)):
        path.write_bytes(dzt_header(bits=32, antenna=antenna) + _TRACES.astype("<i4").tobytes())
        assert read_dzt(path).centre_frequency_hz == frequency_hz, antenna
    for name, frequency_hz in (("1.2 mhz", 1.2e6), ("GX80", None), ("0 MHz", None), (f"{'9' * 5000} MHz", None)):
        mala = write_mala(tmp_path / "a.rd3", _TRACES.astype("<i2"), ANTENNAS=name)
        assert read_mala(mala).centre_frequency_hz == frequency_hz, name


@pytest.mark.parametrize(("suffix", "dtype"), [(".rd3", "<i2"), (".RD7", "<i4")])
def test_mala_sample_rate_is_in_megahertz(tmp_path: Path, suffix: str, dtype: str) -> None:
    stored = _TRACES * (1 if dtype == "<i2" else 70000)
    profile = read_mala(write_mala(tmp_path / f"a{suffix}", stored.astype(dtype)))
    np.testing.assert_array_equal(profile.traces, stored)
    assert profile.sample_interval_ns == pytest.approx(0.2)
    assert (profile.spacing_m, profile.centre_frequency_hz) == (0.01, 500e6)
    timed = read_mala(write_mala(tmp_path / f"a{suffix}", stored.astype(dtype), DISTANCE_INTERVAL=0.0))
    assert (timed.spacing_m, timed.positions_m) == (None, None)


def _dt1(**lines: object) -> Callable[[Path], Path]:
    return lambda folder: write_dt1(folder / "a.DT1", _TRACES, **lines)  # type: ignore[arg-type]


def _dt1_bytes(edit: Callable[[bytes], bytes]) -> Callable[[Path], Path]:
    def make(folder: Path) -> Path:
        path = write_dt1(folder / "a.DT1", _TRACES)
        path.write_bytes(edit(path.read_bytes()))
        return path

    return make


def _named(name: str, data: bytes = b"data") -> Callable[[Path], Path]:
    def make(folder: Path) -> Path:
        (folder / name).write_bytes(data)
        return folder / name

    return make


def _mala(**lines: object) -> Callable[[Path], Path]:
    return lambda folder: write_mala(folder / "a.rd3", _TRACES.astype("<i2"), **lines)


def _dzt(data: bytes = _TRACES.astype("<i4").tobytes(), **header: object) -> Callable[[Path], Path]:
    return _named("a.DZT", dzt_header(**({"bits": 32} | header)) + data)  # type: ignore[arg-type]


_NAN = np.float32(np.nan).tobytes()
_UNLIKE = dzt_header(word=2, channels=2) + dzt_header(word=2, channels=2, range_ns=9.0) + bytes(64)
# By format and fault: a maker of the file, the file that is to blame, the place, and values that are named.
_BAD: dict[str, dict[str, tuple[Callable[[Path], Path], str, str, tuple[object, ...]]]] = {
    "dt1": {
        "no header": (_named("a.DT1"), "a.DT1", "header file", ("a.HD",)),
        "no file": (lambda folder: folder / "a.dt1", "a.dt1", "file", ()),
        "empty": (_dt1_bytes(lambda _: b""), "a.DT1", "file", ()),
        "other samples": (_dt1_bytes(lambda d: d[:8] + bytes(4) + d[12:]), "a.DT1", "header of trace 0", (8,)),
        "position": (_dt1_bytes(lambda d: d[:4] + _NAN + d[8:]), "a.DT1", "header of trace 0", ("nan",)),
        "signalling nan": (_dt1_bytes(lambda d: d[:4] + b"\1\0\x80\x7f" + d[8:]), "a.DT1", "header of trace 0", ()),
        "endless window": (_dt1(TOTAL_TIME_WINDOW=1e300), "a.HD", "TOTAL TIME WINDOW", ("1e+300",)),
        "least window": (_dt1(TOTAL_TIME_WINDOW=1e-300), "a.HD", "TOTAL TIME WINDOW", ("1e-300",)),
        "negative window": (_dt1(TOTAL_TIME_WINDOW=-200), "a.HD", "TOTAL TIME WINDOW", (-200,)),
        "nan window": (_dt1(TOTAL_TIME_WINDOW="nan"), "a.HD", "TOTAL TIME WINDOW", ("nan",)),
        "unit": (_dt1(unit="furlong"), "a.HD", "POSITION UNITS", ("furlong", "ft")),
        "step": (_dt1(STEP_SIZE_USED=0), "a.HD", "STEP SIZE USED", (0,)),
        "word": (_dt1(TIMEZERO_AT_POINT="first"), "a.HD", "TIMEZERO AT POINT", ("first",)),
    },
    "dzt": {
        "no file": (lambda folder: folder / "none.DZT", "none.DZT", "file", ()),
        "folder": (lambda folder: folder, "folder", "file", ()),
        "short header": (_named("a.DZT", dzt_header()[:1000]), "a.DZT", "header of channel 0", (1024, 1000)),
        "other format": (_named("a.DZT", b"II*\0" * 400), "a.DZT", "header", ()),
        "zeros": (_named("a.DZT", bytes(4096)), "a.DZT", "header", ("0x0000",)),
        "bits": (_dzt(bits=24), "a.DZT", "header", (24,)),
        "no data": (_dzt(b""), "a.DZT", "traces", ()),
        "offset beyond": (_dzt(word=128), "a.DZT", "traces", ()),
        "no offset": (_dzt(word=0), "a.DZT", "header, data offset", (0,)),
        "range": (_dzt(range_ns=-5), "a.DZT", "header, range_ns", (-5,)),
        "nan range": (_dzt(range_ns=float("nan")), "a.DZT", "header, range_ns", ("nan",)),
        "inf position": (_dzt(position_ns=float("inf")), "a.DZT", "header, position_ns", ("inf",)),
        "spacing": (_dzt(per_m=-50), "a.DZT", "header, scans_per_m", (-50,)),
        "no channel": (_dzt(channels=0), "a.DZT", "header, channels", (1, 16, 0)),
        "channels": (_dzt(channels=17), "a.DZT", "header, channels", (17,)),
        "samples": (_dzt(samples=2), "a.DZT", "header, samples", (2,)),
        "unlike channels": (_named("a.DZT", _UNLIKE), "a.DZT", "header of channel 1, range_ns", (4.0, 9.0)),
    },
    "mala": {
        "no header": (_named("a.rd3"), "a.rd3", "header file", ("a.rad",)),
        "rate": (_mala(FREQUENCY=-1), "a.rad", "FREQUENCY", (-1,)),
        "window": (_mala(TIMEWINDOW=80.0), "a.rad", "TIMEWINDOW", (8, 1.6, 80)),
        "spacing": (_mala(DISTANCE_INTERVAL=-0.1), "a.rad", "DISTANCE INTERVAL", (-0.1,)),
        "samples": (_mala(SAMPLES=7.5), "a.rad", "SAMPLES", (7.5,)),
        "suffix": (_named("a.gpz"), "a.gpz", "file name", (".gpz", ".dt1", ".dzt", ".rd3", ".rd7", ".iprb", ".sgy")),
    },
}


@pytest.mark.parametrize("kind", _BAD)
def test_bad_files_are_refused(tmp_path: Path, kind: str) -> None:
    for fault, (make, file, place, values) in _BAD[kind].items():
        folder = tmp_path / fault
        folder.mkdir()
        path = make(folder)
        with refused(place, *values, file=fault if file == "folder" else file):
            read_profile(path)
