"""GSSI lines: ``.DZT`` files with a binary header a channel."""

import re
import struct
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Num

from lgprjax.errors import InputError
from lgprjax.formats.profile import Profile, count_traces, read_bytes

_HEADER_BYTES = 1024
_MARK_SAMPLES = 2
# No quantity of a header is as large or, above zero, as small: such a value is damaged.
_LARGEST, _SMALLEST = 1e12, 1e-12
# Stored type, and the value in it that stands for no signal.
_STORED: dict[int, tuple[np.dtype[Any], int]] = {
    8: (np.dtype("u1"), 128),
    16: (np.dtype("<u2"), 32768),
    32: (np.dtype("<i4"), 0),
}


class _Header(NamedTuple):
    tag: int
    data: int
    samples: int
    bits: int
    scans_per_second: float
    scans_per_m: float
    m_per_mark: float
    position_ns: float
    range_ns: float
    channels: int
    permittivity: float
    antenna: str


def read_dzt(path: str | Path, *, partial: bool = False) -> Profile:
    """Read one ``.DZT`` file of one or several channels.

    8- and 16-bit samples are offset binary, 32-bit ones signed; all are returned signed. The first two samples of
    a trace are marks: they read as zero. Channels are interleaved trace by trace. No scans a metre means recorded
    by time, and the antenna's name may be empty.

    Args:
        path: the file.
        partial: read the whole traces (of all channels) of a file that ends too early; ``Profile.cut``
            then says how many there are.

    Raises:
        InputError: the file is missing, cut short or another format, or its header makes no sense.
    """
    file = Path(path)
    data = read_bytes(file)
    header = _read_header(file, data, 0)
    _check_header(file, header)
    offset = _data_offset(file, header)
    for channel in range(1, header.channels):
        other = _read_header(file, data, channel)
        shared = ("samples", "bits", "position_ns", "range_ns")
        wrong = [name for name in shared if getattr(other, name) != getattr(header, name)]
        if wrong:
            place = f"header of channel {channel}, {wrong[0]}"
            raise InputError(file, place, f"{getattr(header, wrong[0])} as in channel 0", f"{getattr(other, wrong[0])}")
    dtype, _ = _STORED[header.bits]
    scan_bytes = header.channels * header.samples * dtype.itemsize
    whole, cut = count_traces(file, len(data) - offset, scan_bytes, said=None, partial=partial)
    values = np.frombuffer(data, dtype=dtype, offset=offset, count=whole * header.channels * header.samples)
    stored = values.reshape(whole, header.channels, header.samples)
    spacing_m = 1.0 / header.scans_per_m if header.scans_per_m else None
    return Profile(
        path=file,
        channels=_signed(stored, header.bits),
        sample_interval_ns=header.range_ns / header.samples,
        time_zero_ns=0.0 - header.position_ns,
        spacing_m=spacing_m,
        centre_frequency_hz=_centre_frequency_hz(header.antenna),
        positions_m=None if spacing_m is None else np.arange(len(stored)) * spacing_m,
        metadata=header._asdict(),
        cut=cut,
    )


def _read_header(file: Path, data: bytes, channel: int) -> _Header:
    start = channel * _HEADER_BYTES
    block = data[start : start + _HEADER_BYTES]
    if len(block) < _HEADER_BYTES:
        raise InputError(file, f"header of channel {channel}", f"{_HEADER_BYTES} bytes", f"{len(block)} bytes")
    tag, word, samples, bits = struct.unpack_from("<4H", block, 0)
    per_second, per_m, per_mark, position_ns, range_ns = struct.unpack_from("<5f", block, 10)
    (channels,) = struct.unpack_from("<H", block, 52)
    (permittivity,) = struct.unpack_from("<f", block, 54)
    antenna = block[98:112].split(b"\0")[0].decode("latin-1").strip()
    return _Header(
        tag, word, samples, bits, per_second, per_m, per_mark, position_ns, range_ns, channels, permittivity, antenna
    )


def _check_header(file: Path, header: _Header) -> None:
    # The low byte of the tag is all ones or all zeros (old files); the high byte varies with the recorder.
    if header.tag & 0xFF not in (0x00, 0xFF) or header.bits not in _STORED:
        found = f"tag {header.tag:#06x} with {header.bits} bits a sample"
        raise InputError(file, "header", "a DZT header of 8, 16 or 32 bits a sample", found)
    if header.samples <= _MARK_SAMPLES:
        raise InputError(file, "header, samples", f"more than {_MARK_SAMPLES}", f"{header.samples}")
    if not 1 <= header.channels <= 16:
        raise InputError(file, "header, channels", "1 to 16", f"{header.channels}")
    if not (_SMALLEST <= header.range_ns <= _LARGEST):
        raise InputError(file, "header, range_ns", "a number above zero", f"{header.range_ns:g}")
    if not abs(header.position_ns) <= _LARGEST:
        raise InputError(file, "header, position_ns", "a finite number", f"{header.position_ns:g}")
    if not (header.scans_per_m == 0 or _SMALLEST <= header.scans_per_m <= _LARGEST):
        raise InputError(file, "header, scans_per_m", "zero or more", f"{header.scans_per_m:g}")


def _data_offset(file: Path, header: _Header) -> int:
    """Where the samples begin: small words count header blocks, large ones bytes (one block a channel at least)."""
    if header.data < _HEADER_BYTES:
        offset = _HEADER_BYTES * header.data
    else:
        offset = max(header.data, _HEADER_BYTES * header.channels)
    if offset < _HEADER_BYTES * header.channels:
        expected = f"one header of {_HEADER_BYTES} bytes a channel before the data"
        raise InputError(file, "header, data offset", expected, f"{offset} bytes for {header.channels} channels")
    return offset


def _signed(stored: Num[np.ndarray, "trace channel sample"], bits: int) -> Num[np.ndarray, "trace channel sample"]:
    zero_level = _STORED[bits][1]
    signed = stored.astype(np.int32)
    signed -= zero_level
    signed[:, :, :_MARK_SAMPLES] = 0
    return signed if bits == 32 else signed.astype(np.int16)


def _centre_frequency_hz(antenna: str) -> float | None:
    """Centre frequency from an antenna's name (``400MHz``, ``1.5/1.6GHz``, ``HS350US``); model numbers say nothing."""
    named = re.search(r"(\d+(?:\.\d+)?)\s*([MG])Hz", antenna, re.IGNORECASE)
    if named:
        return float(named[1]) * (1e9 if named[2].upper() == "G" else 1e6)
    hyper_stacking = re.search(r"HS\s*(\d{3})|(\d{3})\s*HS", antenna)
    return float(hyper_stacking[1] or hyper_stacking[2]) * 1e6 if hyper_stacking else None
