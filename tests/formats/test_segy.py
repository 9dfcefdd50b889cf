"""SEG-Y lines, written by segyio and byte by byte: sample types, the interval, coordinates, and bad files."""

import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from formats.segy_sample import COUNTS, write_segy
from lgprjax.formats import SurveyOrigin, import_segy, read_segy
from refusals import refused

_PLACE = SurveyOrigin(48.0, 11.0, 30.0)


@pytest.mark.parametrize(("code", "dtype"), [(1, "f4"), (2, "i4"), (3, "i2"), (5, "f4"), (8, "i2")])
def test_sample_types(tmp_path: Path, code: int, dtype: str) -> None:
    traces = COUNTS // 256 if code == 8 else COUNTS * 5000 if code == 2 else COUNTS
    for endian in ("big", "little"):
        profile = read_segy(write_segy(tmp_path / "a.sgy", traces, code=code, endian=endian))
        np.testing.assert_array_equal(profile.traces, traces)
        assert profile.channels.dtype == np.dtype(dtype)


def test_ibm_float_is_decoded_as_ibm_wrote_it(tmp_path: Path) -> None:
    # -118.625 is 0xC276A000 in IBM's notation; read as IEEE it would be -61.65.
    path = write_segy(tmp_path / "a.sgy", np.full((2, 4), -118.625), code=1)
    assert path.read_bytes()[3840:3844] == bytes.fromhex("C276A000")
    np.testing.assert_array_equal(read_segy(path).traces, -118.625)


def test_interval_word_is_read_as_picoseconds_wherever_it_stands(tmp_path: Path) -> None:
    for options, interval_ns in (
        ({"revision": 0}, 0.4),
        ({"revision": 1}, 0.4),
        ({"trace_interval": 0}, 0.4),
        ({"interval": 0, "trace_interval": 625}, 0.625),
    ):
        profile = read_segy(write_segy(tmp_path / "a.sgy", **options))  # type: ignore[arg-type]
        assert profile.sample_interval_ns == pytest.approx(interval_ns)
        assert f"{1000 * interval_ns:.0f}" in str(profile.metadata["reading"])
        assert (profile.spacing_m, profile.positions_m) == (None, None)


@pytest.mark.parametrize(("interval", "trace_interval"), [(4000, 4000), (1, 1), (0, 0), (400, 800)])
def test_implausible_interval_asks_for_the_option(tmp_path: Path, interval: int, trace_interval: int) -> None:
    path = write_segy(tmp_path / "a.sgy", interval=interval, trace_interval=trace_interval)
    values = [value for value in (interval, trace_interval) if value]
    with refused("sample interval", "--sample-interval-ns", 10, 2000, *values):
        read_segy(path)
    profile = read_segy(path, sample_interval_ns=0.8, time_zero_ns=3.0)
    assert (profile.sample_interval_ns, profile.time_zero_ns) == (0.8, 3.0)


def test_extended_interval_of_revision_2(tmp_path: Path) -> None:
    # Bytes 3273 to 3280 hold microseconds as a double: the only field of SEG-Y that can say 0.15217 ns.
    path = write_segy(tmp_path / "a.sgy", interval=0, trace_interval=0, code=5)
    data = bytearray(path.read_bytes())
    data[3500:3502] = b"\x02\x01"
    struct.pack_into(">d", data, 3272, 0.15217e-3)
    path.write_bytes(data)
    assert read_segy(path).sample_interval_ns == pytest.approx(0.15217)


def test_midpoints_with_scalar_and_feet(tmp_path: Path) -> None:
    along = np.arange(6) * 20  # hundredths of a foot
    headers = {71: -100, 73: along, 77: 0 * along + 500, 81: along + 100, 85: 0 * along + 500, 89: 1}
    profile = read_segy(write_segy(tmp_path / "a.sgy", headers=headers, units=2))
    assert profile.spacing_m == pytest.approx(0.2 * 0.3048)
    assert profile.coordinates is not None
    np.testing.assert_allclose(profile.coordinates.x, (along + 50) / 100 * 0.3048)
    np.testing.assert_allclose(profile.coordinates.y, 5 * 0.3048)


@pytest.mark.parametrize(("scalar", "factor"), [(0, 1.0), (10, 10.0), (-1000, 0.001)])
def test_coordinate_scalar(tmp_path: Path, scalar: int, factor: float) -> None:
    headers = {71: scalar, 181: 1000 + 7 * np.arange(6), 185: 3}
    profile = read_segy(write_segy(tmp_path / "a.sgy", headers=headers))
    assert profile.spacing_m == pytest.approx(7 * factor)


def test_bad_files_are_refused_and_leave_nothing(tmp_path: Path) -> None:
    headers = {71: -100, 73: 1000 + 20 * np.arange(6), 77: 100}
    path = write_segy(tmp_path / "a.sgy", headers=headers)
    whole = path.read_bytes()

    def patched(at: int, new: bytes) -> bytes:
        return whole[:at] + new + whole[at + len(new) :]

    binary = "binary header"
    cases: list[tuple[bytes, dict[str, Any], str, tuple[object, ...]]] = [
        (b"", {}, "file", ()),
        (whole[:3500], {}, "file", (3600, 3500)),
        (whole[:3600], {}, "traces", ()),
        (whole[:-7], {}, "traces", (5,)),
        (patched(3224, b"\0\4"), {}, f"{binary}, sample format", (1, 2, 3, 5, 8, 4)),
        (patched(3220, b"\0\0"), {}, f"{binary}, samples a trace", (2, 0)),
        (patched(3220, b"\0\14"), {}, "traces", (5,)),
        (patched(3504, b"\xff\xff"), {}, f"{binary}, extended text headers", (-1,)),
        (patched(3504, b"\0\1"), {}, "traces", ()),
        (whole, {"sample_interval_ns": -1.0}, "sample interval", (-1,)),
        (whole, {"time_zero_ns": float("nan")}, "time zero", ("nan",)),
        (whole, {"utm_zone": "32N"}, "coordinates", (100000, 900000, 10)),
        (whole, {"length_m": -2.0}, "length_m", (-2,)),
        (whole, {"place": SurveyOrigin(95.0, 0.0, 0.0)}, "latitude_deg", (-90, 90, 95)),
    ]
    for data, options, place, values in cases:
        path.write_bytes(data)
        with refused(place, *values):
            import_segy(path, output=tmp_path / "a.drive.h5", **({"place": _PLACE} | options))
        assert list(tmp_path.iterdir()) == [path]
