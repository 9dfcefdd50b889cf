"""Readers of line files: GSSI (DZT), Sensors & Software (DT1), MALA (rd3, rd7), ImpulseRadar (iprb)."""

import itertools
import re
import struct
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float, Num

from lgprjax.errors import InputError
from lgprjax.formats.line_layout import at_time_zero, check_time_zeros
from lgprjax.formats.profile import (
    Profile,
    TextHeader,
    check_channel,
    companion,
    count_traces,
    named_frequency_hz,
    read_bytes,
)

_HEADER_BYTES = 1024
_MARK_SAMPLES = 2
_CHOICE = ", or --channel for one of them"
# No quantity of a header is as large or, above zero, as small: such a value is damaged.
_LARGEST, _SMALLEST = 1e12, 1e-12
# Stored type, and its value for no signal.
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


def read_dzt(path: str | Path, *, channel: int | None = None, partial: bool = False) -> Profile:
    """Read one ``.DZT`` file of one or several channels.

    8- and 16-bit samples are offset binary, 32-bit ones signed; all are returned signed. The first two samples of a
    trace are marks, which are read as zero. Channels are interleaved trace by trace. A line without scans per metre was
    recorded by time, and the antenna's name may be empty. The first header replaces an empty header of a later channel
    (``Profile.notes``).

    Args:
        path: path of the file.
        channel: only channel to read, from 0; two antennas may have different time ranges.
        partial: whether to read the intact traces (of all channels) of a file that ends too early; ``Profile.cut`` then
            gives their number.

    Raises:
        InputError: the file is missing, truncated or of another format, its header is invalid, channels have different
            time ranges and none is chosen, or there is no such channel.
    """
    file = Path(path)
    data = read_bytes(file)
    header = _read_header(file, data, 0)
    _check_header(file, header)
    offset = _data_offset(file, header)
    check_channel(file, channel, header.channels)
    chosen = range(header.channels) if channel is None else range(channel, channel + 1)
    headers, notes = [], []
    for each in chosen:
        own = _read_header(file, data, each)
        if not _is_filled_in(own):
            notes.append(f"{file.name}: the header of channel {each} is not filled in: that of channel 0 was used")
            own = header._replace(antenna=own.antenna)
        headers.append(own)
    for each, own in zip(chosen, headers, strict=True):
        for name, choice in (("samples", ""), ("bits", ""), ("position_ns", _CHOICE), ("range_ns", _CHOICE)):
            first = getattr(headers[0] if choice else header, name)
            if getattr(own, name) != first:
                place = f"header of channel {each}, {name}"
                raise InputError(file, place, f"{first} as in channel 0{choice}", f"{getattr(own, name)}")
    dtype, _ = _STORED[header.bits]
    scan_bytes = header.channels * header.samples * dtype.itemsize
    whole, cut = count_traces(file, len(data) - offset, scan_bytes, said=None, partial=partial)
    values = np.frombuffer(data, dtype=dtype, offset=offset, count=whole * header.channels * header.samples)
    stored = values.reshape(whole, header.channels, header.samples)[:, chosen.start : chosen.stop]
    own = headers[0]
    spacing_m = 1.0 / header.scans_per_m if header.scans_per_m else None
    return Profile(
        path=file,
        channels=_signed(stored, header.bits),
        sample_interval_ns=own.range_ns / header.samples,
        time_zero_ns=0.0 - own.position_ns,
        spacing_m=spacing_m,
        centre_frequency_hz=_centre_frequency_hz(own.antenna),
        positions_m=None if spacing_m is None else np.arange(len(stored)) * spacing_m,
        metadata={**own._asdict(), "antennas": tuple(each.antenna for each in headers)},
        cut=cut,
        notes=tuple(notes),
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
        tag=tag,
        data=word,
        samples=samples,
        bits=bits,
        scans_per_second=per_second,
        scans_per_m=per_m,
        m_per_mark=per_mark,
        position_ns=position_ns,
        range_ns=range_ns,
        channels=channels,
        permittivity=permittivity,
        antenna=antenna,
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


def _is_filled_in(own: _Header) -> bool:
    """Whether a later channel's header is one."""
    layout = own.tag & 0xFF in (0x00, 0xFF) and own.bits in _STORED and own.samples > _MARK_SAMPLES
    return layout and _SMALLEST <= own.range_ns <= _LARGEST and abs(own.position_ns) <= _LARGEST


def _data_offset(file: Path, header: _Header) -> int:
    """Offset of the samples, bytes: small words count header blocks, large ones bytes (a block per channel or more)."""
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
    """Centre frequency from an antenna's name (``400MHz``, ``1.5/1.6GHz``, ``HS350US``); model numbers are ignored."""
    named = re.search(r"(\d+(?:\.\d+)?)\s*([MG])Hz", antenna, re.IGNORECASE)
    if named:
        return float(named[1]) * (1e9 if named[2].upper() == "G" else 1e6)
    hyper_stacking = re.search(r"HS\s*(\d{3})|(\d{3})\s*HS", antenna)
    return float(hyper_stacking[1] or hyper_stacking[2]) * 1e6 if hyper_stacking else None


# Sensors & Software pulseEKKO and Noggin lines: ``.DT1`` traces with an ``.HD`` text header.

_TRACE_HEADER_BYTES = 128
_UNIT_M = {"m": 1.0, "metres": 1.0, "meters": 1.0, "ft": 0.3048, "feet": 0.3048, "foot": 0.3048}


def read_dt1(path: str | Path, *, partial: bool = False) -> Profile:
    """Read one ``.DT1`` file with its ``.HD``.

    Every trace is a header of 32 float32 words (word 1 its position, word 2 its samples, word 5 bytes a sample)
    and samples: int16 of two bytes, or float32 of four. Positions may be in feet; time zero is a fractional sample
    number counted from sample 0. A line whose positions skip a stretch, or go back, has no spacing, only positions.

    Args:
        path: the file.
        partial: read the intact traces of a file that ends too early; ``Profile.cut`` then gives their number.

    Raises:
        InputError: a file is missing, truncated or of another format, or header, traces and file size disagree.
    """
    file = Path(path)
    header = TextHeader(companion(file, ".hd"), "=")
    samples = header.count("NUMBER OF PTS/TRC")
    traces = header.count("NUMBER OF TRACES")
    step = header.positive("STEP SIZE USED")
    interval_ns = header.positive("TOTAL TIME WINDOW") / samples
    unit = header.values.get("POSITION UNITS", "m").lower()
    if unit not in _UNIT_M:
        raise InputError(header.path, "POSITION UNITS", "m or ft", repr(unit[:40]))

    data = read_bytes(file)
    first = np.frombuffer(data[:_TRACE_HEADER_BYTES].ljust(_TRACE_HEADER_BYTES, b"\0"), "<f4")
    if len(data) >= _TRACE_HEADER_BYTES and not (2 <= first[2] <= 65536 and first[5] in (0.0, 2.0, 4.0)):
        found = "other numbers: the file is damaged, or of another format"
        raise InputError(file, "header of trace 0", f"{samples} samples of 2 or 4 bytes", found)
    stored = np.dtype("<f4") if first[5] == 4.0 else np.dtype("<i2")
    record_bytes = _TRACE_HEADER_BYTES + samples * stored.itemsize
    whole, cut = count_traces(file, len(data), record_bytes, said=(traces, header.path), partial=partial)
    record = np.dtype([("header", "<f4", 32), ("samples", stored, samples)])
    records = np.frombuffer(data, record, count=whole)
    words = records["header"]
    # Some NaN bit patterns raise a flag when converted; they are detected here.
    with np.errstate(invalid="ignore"):
        bytes_a_sample = np.where(words[:, 5] == 0.0, 2.0, words[:, 5])
        wrong = np.flatnonzero((words[:, 2] != samples) | (bytes_a_sample != stored.itemsize))
        positions_m = words[:, 1].astype(np.float64) * _UNIT_M[unit]
    if wrong.size:
        found = f"{words[wrong[0], 2]:g} samples of {words[wrong[0], 5]:g} bytes"
        raise InputError(file, f"header of trace {wrong[0]}", f"{samples} samples of {stored.itemsize} bytes", found)
    if not np.all(np.isfinite(positions_m)):
        bad = int(np.argmin(np.isfinite(positions_m)))
        raise InputError(file, f"header of trace {bad}", "a finite position", f"{words[bad, 1]}")
    frequency_mhz = header.number("NOMINAL FREQUENCY", default=0.0)
    return Profile(
        path=file,
        channels=records["samples"][:, None, :].astype(stored.newbyteorder("=")),
        sample_interval_ns=interval_ns,
        time_zero_ns=header.number("TIMEZERO AT POINT", default=0.0) * interval_ns,
        spacing_m=step * _UNIT_M[unit] if _are_even(positions_m) else None,
        centre_frequency_hz=frequency_mhz * 1e6 if frequency_mhz > 0 else None,
        positions_m=positions_m,
        metadata=dict(header.values),
        cut=cut,
    )


def _are_even(positions_m: Float[np.ndarray, " trace"]) -> bool:
    """Whether positions go one way in similar steps, or are all the same: those of a line triggered by time."""
    steps_m = np.diff(positions_m)
    if not steps_m.any():
        return True
    usual_m = float(np.median(steps_m))
    return bool(np.all(np.abs(steps_m - usual_m) < 0.5 * abs(usual_m)))


# MALA lines: ``.rd3`` (int16) or ``.rd7`` (int32) samples with a ``.rad`` text header.

_DTYPE: dict[str, np.dtype[Any]] = {".rd3": np.dtype("<i2"), ".rd7": np.dtype("<i4")}


def read_mala(path: str | Path, *, partial: bool = False) -> Profile:
    """Read one ``.rd3`` or ``.rd7`` file with its ``.rad``.

    ``FREQUENCY`` is the sampling rate in MHz and ``TIMEWINDOW`` is in ns. The header has no time zero in samples:
    sample 0 is used. A ``DISTANCE INTERVAL`` of zero means recorded by time.

    Args:
        path: the file.
        partial: read the intact traces of a file that ends too early; ``Profile.cut`` then gives their number.

    Raises:
        InputError: a file is missing, truncated or of another format, or header and file size disagree.
    """
    file = Path(path)
    dtype = _DTYPE.get(file.suffix.lower())
    if dtype is None:
        raise InputError(file, "file name", "the suffix .rd3 or .rd7", repr(file.suffix))
    header = TextHeader(companion(file, ".rad"), ":")
    samples = header.count("SAMPLES")
    interval_ns = 1000.0 / header.positive("FREQUENCY")
    window_ns = header.number("TIMEWINDOW", default=samples * interval_ns)
    if abs(window_ns - samples * interval_ns) > 0.01 * samples * interval_ns:
        expected = f"{samples} samples at FREQUENCY, {samples * interval_ns:.6g} ns"
        raise InputError(header.path, "TIMEWINDOW", expected, f"{window_ns:g}")
    spacing_m = header.number("DISTANCE INTERVAL", default=0.0)
    if spacing_m < 0:
        raise InputError(header.path, "DISTANCE INTERVAL", "zero or more", f"{spacing_m:g}")

    data = read_bytes(file)
    said = (header.count("LAST TRACE"), header.path) if "LAST TRACE" in header.values else None
    whole, cut = count_traces(file, len(data), samples * dtype.itemsize, said=said, partial=partial)
    stored = np.frombuffer(data, dtype=dtype, count=whole * samples)
    channels = stored.reshape(whole, 1, samples).astype(dtype.newbyteorder("="))
    start_m = header.number("START POSITION", default=0.0)
    return Profile(
        path=file,
        channels=channels,
        sample_interval_ns=interval_ns,
        time_zero_ns=0.0,
        spacing_m=spacing_m or None,
        centre_frequency_hz=named_frequency_hz(header.values.get("ANTENNAS", "")),
        positions_m=start_m + np.arange(len(channels)) * spacing_m if spacing_m else None,
        metadata=dict(header.values),
        cut=cut,
    )


# ImpulseRadar lines: ``.iprb`` samples (int16 or int32) with an ``.iprh`` text header, one file a channel.

_IPRB_DTYPE: dict[float, np.dtype[Any]] = {16: np.dtype("<i2"), 32: np.dtype("<i4")}


def read_iprb(path: str | Path, *, partial: bool = False) -> Profile:
    """Read one ``.iprb`` file, one channel, with its ``.iprh``.

    ``DATA VERSION`` is the number of bits a sample, ``FREQUENCY`` the sampling rate in MHz, ``TIMEWINDOW`` in ns,
    ``ZERO LEVEL`` the sample of time zero. ``DISTANCE INTERVAL`` is the distance between traces measured by the wheel;
    ``USER DISTANCE INTERVAL`` is the nominal setting, and is not used. A line triggered by time has no spacing.

    Args:
        path: the file.
        partial: read the intact traces of a file that ends too early; ``Profile.cut`` then gives their number.

    Raises:
        InputError: a file is missing, truncated or of another format, or header and file size disagree.
    """
    return _read(Path(path), partial=partial)[0]


def read_iprb_array(paths: Sequence[str | Path], *, partial: bool = False) -> Profile:
    """Read the channels of one line, ``NAME_001_A01.iprb``, ``NAME_001_A02.iprb`` ..., as one profile.

    ``CH_X_OFFSET`` is to the right of the position reference, ``CH_Y_OFFSET`` forward; channels are returned from left
    to right. ``ZERO LEVEL`` is each channel's own: all are shifted to the middle one. A single file has no position in
    an array.

    Args:
        paths: paths of the files, in any order.
        partial: whether to read, if channels end too early, the traces that are intact in all of them;
            ``Profile.cut`` then gives their number.

    Raises:
        InputError: a file cannot be read, or the channels are not an array: different recordings, time zeros farther
            apart than a twentieth of the trace, or two at one position.
    """
    if not paths:
        raise InputError("files", "channels", "at least one .iprb file", "none")
    read = [_read(Path(path), partial=partial) for path in paths]
    if len(read) == 1:
        return read[0][0]
    offsets = [(header.number("CH_X_OFFSET"), header.number("CH_Y_OFFSET")) for _, header in read]
    order = sorted(range(len(read)), key=lambda i: offsets[i][0])
    first, header = read[order[0]]
    for left, right in itertools.pairwise(order):
        if offsets[right][0] - offsets[left][0] < 1e-4:
            found = f"{offsets[right][0]:g} m in {read[left][1].path.name} too"
            raise InputError(read[right][1].path, "CH_X_OFFSET", "an offset that no other channel has", found)
    for i in order[1:]:
        _check_same_recording(read[i][0], read[i][1], first, header)
    whole = min(len(profile.channels) for profile, _ in read)
    ordered = [read[i][0] for i in order]
    # That of a channel, not between two: whole samples are moved without smoothing them.
    time_zero_ns = sorted(profile.time_zero_ns for profile in ordered)[len(ordered) // 2]
    check_time_zeros(ordered, time_zero_ns)
    return Profile(
        path=first.path,
        channels=np.stack([at_time_zero(profile, time_zero_ns)[:whole] for profile in ordered], axis=1),
        sample_interval_ns=first.sample_interval_ns,
        time_zero_ns=time_zero_ns,
        spacing_m=first.spacing_m,
        centre_frequency_hz=first.centre_frequency_hz,
        positions_m=None if first.positions_m is None else first.positions_m[:whole],
        metadata=first.metadata,
        left_m=np.array([-offsets[i][0] for i in order]),
        forward_m=np.array([offsets[i][1] for i in order]),
        cut=next((profile.cut for profile, _ in read if profile.cut and len(profile.channels) == whole), None),
    )


def _read(file: Path, *, partial: bool) -> tuple[Profile, TextHeader]:
    if file.suffix.lower() != ".iprb":
        raise InputError(file, "file name", "the suffix .iprb", repr(file.suffix))
    header = TextHeader(companion(file, ".iprh"), ":")
    bits = header.number("DATA VERSION", default=16.0)
    dtype = _IPRB_DTYPE.get(bits)
    if dtype is None:
        raise InputError(header.path, "DATA VERSION", "16 or 32 (bits a sample)", f"{bits:g}")
    samples = header.count("SAMPLES")
    interval_ns = header.positive("TIMEWINDOW") / samples
    rate_mhz = header.number("FREQUENCY", default=1000.0 / interval_ns)
    if abs(rate_mhz * interval_ns / 1000.0 - 1) > 0.01:
        expected = f"{1000.0 / interval_ns:.6g} MHz, {samples} samples in the TIMEWINDOW"
        raise InputError(header.path, "FREQUENCY", expected, f"{rate_mhz:g}")
    by_time = header.values.get("TRIG SOURCE", "").lower() == "time"
    spacing_m = 0.0 if by_time else header.number("DISTANCE INTERVAL", default=0.0)
    if spacing_m < 0:
        raise InputError(header.path, "DISTANCE INTERVAL", "zero or more", f"{spacing_m:g}")
    zero_sample = header.number("ZERO LEVEL", default=0.0)
    if not 0 <= zero_sample < samples:
        raise InputError(header.path, "ZERO LEVEL", f"a sample from 0 to {samples - 1}", f"{zero_sample:g}")

    data = read_bytes(file)
    said = (header.count("LAST TRACE"), header.path) if "LAST TRACE" in header.values else None
    whole, cut = count_traces(file, len(data), samples * dtype.itemsize, said=said, partial=partial)
    stored = np.frombuffer(data, dtype=dtype, count=whole * samples)
    channels = stored.reshape(whole, 1, samples).astype(dtype.newbyteorder("="))
    profile = Profile(
        path=file,
        channels=channels,
        sample_interval_ns=interval_ns,
        time_zero_ns=zero_sample * interval_ns,
        spacing_m=spacing_m or None,
        centre_frequency_hz=named_frequency_hz(header.values.get("ANTENNA", "")),
        positions_m=np.arange(len(channels)) * spacing_m if spacing_m else None,
        metadata=dict(header.values),
        cut=cut,
    )
    return profile, header


def _check_same_recording(profile: Profile, header: TextHeader, first: Profile, other: TextHeader) -> None:
    shorter, longer = sorted((profile, first), key=lambda each: len(each.channels))
    length_differs = len(shorter.channels) < len(longer.channels) and shorter.cut is None
    same_samples = profile.channels.shape[1:] == first.channels.shape[1:]
    if length_differs or not same_samples or profile.channels.dtype != first.channels.dtype:
        expected = f"{_size(first)} as in {first.path.name}"
        raise InputError(profile.path, "recording", expected, _size(profile))
    for name in ("TIMEWINDOW", "DISTANCE INTERVAL", "ANTENNA", "LAST TRACE"):
        if header.values.get(name) != other.values.get(name):
            expected = f"{other.values.get(name)} as in {other.path.name}"
            raise InputError(header.path, name, expected, str(header.values.get(name)))


def _size(profile: Profile) -> str:
    traces, _, samples = profile.channels.shape
    return f"{traces} traces of {samples} samples of {8 * profile.channels.dtype.itemsize} bits"
