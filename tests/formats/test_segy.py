"""SEG-Y lines, written by segyio and byte by byte: sample types, the interval, coordinates, and bad files."""

import builtins
import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from formats.segy_sample import COUNTS, write_segy
from lgprjax.errors import InputError
from lgprjax.formats import SurveyOrigin, import_segy, read_segy

_PLACE = SurveyOrigin(48.0, 11.0, 30.0)


@pytest.mark.parametrize("endian", ["big", "little"])
@pytest.mark.parametrize(("code", "dtype"), [(1, "f4"), (2, "i4"), (3, "i2"), (5, "f4"), (8, "i2")])
def test_sample_types(tmp_path: Path, code: int, dtype: str, endian: str) -> None:
    traces = COUNTS // 256 if code == 8 else COUNTS * 5000 if code == 2 else COUNTS
    profile = read_segy(write_segy(tmp_path / "a.sgy", traces, code=code, endian=endian))
    np.testing.assert_array_equal(profile.traces, traces)
    assert profile.channels.dtype == np.dtype(dtype)


def test_ibm_float_is_decoded_as_ibm_wrote_it(tmp_path: Path) -> None:
    # -118.625 is 0xC276A000 in IBM's notation; read as IEEE it would be -61.65.
    path = write_segy(tmp_path / "a.sgy", np.full((2, 4), -118.625), code=1)
    assert path.read_bytes()[3840:3844] == bytes.fromhex("C276A000")
    np.testing.assert_array_equal(read_segy(path).traces, -118.625)


@pytest.mark.parametrize("revision", [0, 1])
def test_interval_word_is_read_as_picoseconds(tmp_path: Path, revision: int) -> None:
    profile = read_segy(write_segy(tmp_path / "a.sgy", revision=revision))
    assert profile.sample_interval_ns == pytest.approx(0.4)
    assert "the interval word 400 read as picoseconds" in str(profile.metadata["reading"])
    assert profile.spacing_m is None
    assert profile.positions_m is None


def test_interval_word_in_one_header_only(tmp_path: Path) -> None:
    assert read_segy(write_segy(tmp_path / "a.sgy", trace_interval=0)).sample_interval_ns == pytest.approx(0.4)
    path = write_segy(tmp_path / "b.sgy", interval=0, trace_interval=625)
    assert read_segy(path).sample_interval_ns == pytest.approx(0.625)


@pytest.mark.parametrize(
    ("interval", "trace_interval", "found"),
    [(4000, 4000, "4000"), (1, 1, "1"), (0, 0, "none"), (400, 800, "400, 800"), (40000, 40000, "40000")],
)
def test_implausible_interval_asks_for_the_option(
    tmp_path: Path, interval: int, trace_interval: int, found: str
) -> None:
    path = write_segy(tmp_path / "a.sgy", interval=interval, trace_interval=trace_interval)
    with pytest.raises(InputError) as caught:
        read_segy(path)
    assert str(caught.value).endswith(f"(10 to 2000), or --sample-interval-ns, found {found}")
    profile = read_segy(path, sample_interval_ns=0.8, time_zero_ns=3.0)
    assert (profile.sample_interval_ns, profile.time_zero_ns) == (0.8, 3.0)
    assert "from the option (the header says" in str(profile.metadata["reading"])


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


@pytest.mark.parametrize(("scalar", "factor"), [(0, 1.0), (1, 1.0), (10, 10.0), (-1000, 0.001)])
def test_coordinate_scalar(tmp_path: Path, scalar: int, factor: float) -> None:
    headers = {71: scalar, 181: 1000 + 7 * np.arange(6), 185: 3}
    profile = read_segy(write_segy(tmp_path / "a.sgy", headers=headers))
    assert profile.spacing_m == pytest.approx(7 * factor)


def test_missing_segyio_says_what_to_install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = write_segy(tmp_path / "a.sgy")
    real = builtins.__import__

    def without(name: str, *arguments: Any, **options: Any) -> Any:
        if name == "segyio":
            raise ImportError(name)
        return real(name, *arguments, **options)

    monkeypatch.setattr(builtins, "__import__", without)
    with pytest.raises(InputError) as caught:
        read_segy(path)
    assert str(caught.value).endswith(
        "a.sgy: SEG-Y: expected the optional package segyio (pip install lgprjax[segy]), found none"
    )


def test_bad_files_are_one_line_and_leave_nothing(tmp_path: Path) -> None:
    headers = {71: -100, 73: 1000 + 20 * np.arange(6), 77: 100}
    path = write_segy(tmp_path / "a.sgy", headers=headers)
    whole = path.read_bytes()

    def patched(at: int, new: bytes) -> bytes:
        return whole[:at] + new + whole[at + len(new) :]

    cases: list[tuple[bytes, dict[str, Any], str]] = [
        (b"", {}, "an empty file"),
        (whole[:3500], {}, "expected SEG-Y headers of 3600 bytes, found 3500 bytes"),
        (whole[:3600], {}, "traces: expected at least one, found none"),
        (
            whole[:-7],
            {},
            "traces: expected a whole number, found 5 and a part of one; read the whole",
        ),
        (patched(3224, b"\0\4"), {}, "binary header, sample format: expected 1 (IBM float), 2 (int32), 3"),
        (patched(3220, b"\0\0"), {}, "binary header, samples a trace: expected at least 2, found 0"),
        (patched(3220, b"\0\14"), {}, "traces: expected a whole number, found 5 and a part of one"),
        (patched(3504, b"\xff\xff"), {}, "binary header, extended text headers: expected a number of them, found -1"),
        (patched(3504, b"\0\1"), {}, "traces: expected at least one, found none"),
        (whole, {"sample_interval_ns": -1.0}, "sample interval: expected a number above zero, found -1"),
        (whole, {"time_zero_ns": float("nan")}, "time zero: expected a number, found nan"),
        (
            whole,
            {"utm_zone": "32N"},
            "coordinates: expected UTM metres (easting 100000 to 900000, northing 0 to 10000000), found eastings 10",
        ),
        (whole, {"length_m": -2.0}, "length_m: expected a length above zero, found -2"),
        (whole, {"place": SurveyOrigin(95.0, 0.0, 0.0)}, "latitude_deg: expected degrees from -90 to 90, found 95"),
    ]
    for data, options, words in cases:
        path.write_bytes(data)
        with pytest.raises(InputError) as caught:
            import_segy(path, output=tmp_path / "a.drive.h5", **({"place": _PLACE} | options))
        assert words in str(caught.value)
        assert "\n" not in str(caught.value)
        assert list(tmp_path.iterdir()) == [path]
