"""ImpulseRadar lines: ``.iprb`` samples (int16 or int32) with an ``.iprh`` text header, one file a channel."""

import itertools
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from lgprjax.errors import InputError
from lgprjax.formats.profile import Profile, TextHeader, companion, read_bytes

_DTYPE: dict[float, np.dtype[Any]] = {16: np.dtype("<i2"), 32: np.dtype("<i4")}


def read_iprb(path: str | Path) -> Profile:
    """Read one ``.iprb`` file, one channel, with the ``.iprh`` beside it.

    ``DATA VERSION`` is the number of bits a sample, ``FREQUENCY`` the sampling rate in MHz, ``TIMEWINDOW`` in ns,
    ``ZERO LEVEL`` the sample of time zero. ``DISTANCE INTERVAL`` is the distance between traces as the wheel
    measured it; ``USER DISTANCE INTERVAL`` is the nominal one that was asked for, and is not used. A line triggered
    by time has no spacing.

    Raises:
        InputError: a file is missing, cut short or another format, or header and file size disagree.
    """
    return _read(Path(path))[0]


def read_iprb_array(paths: Sequence[str | Path]) -> Profile:
    """Read the channels of one line, ``NAME_001_A01.iprb``, ``NAME_001_A02.iprb`` ..., as one profile.

    ``CH_X_OFFSET`` counts to the right of the positioning's reference, ``CH_Y_OFFSET`` forwards; channels are
    returned from left to right. A single file has no place in an array.

    Raises:
        InputError: a file cannot be read, or the channels are no array: another recording, or two in one place.
    """
    if not paths:
        raise InputError("files", "channels", "at least one .iprb file", "none")
    read = [_read(Path(path)) for path in paths]
    if len(read) == 1:
        return read[0][0]
    offsets = [(header.number("CH_X_OFFSET"), header.number("CH_Y_OFFSET")) for _, header in read]
    order = sorted(range(len(read)), key=lambda i: offsets[i][0])
    first, header = read[order[0]]
    for left, right in itertools.pairwise(order):
        if offsets[right][0] - offsets[left][0] < 1e-4:
            found = f"{offsets[right][0]:g} m in {read[left][1].path.name} too"
            raise InputError(read[right][1].path, "CH_X_OFFSET", "another place than every other channel", found)
    for i in order[1:]:
        _check_same_recording(read[i][0], read[i][1], first, header)
    return Profile(
        path=first.path,
        channels=np.concatenate([read[i][0].channels for i in order], axis=1),
        sample_interval_ns=first.sample_interval_ns,
        time_zero_ns=first.time_zero_ns,
        spacing_m=first.spacing_m,
        centre_frequency_hz=first.centre_frequency_hz,
        positions_m=first.positions_m,
        metadata=first.metadata,
        left_m=np.array([-offsets[i][0] for i in order]),
        forward_m=np.array([offsets[i][1] for i in order]),
    )


def _read(file: Path) -> tuple[Profile, TextHeader]:
    if file.suffix.lower() != ".iprb":
        raise InputError(file, "file name", "the suffix .iprb", repr(file.suffix))
    header = TextHeader(companion(file, ".iprh"), ":")
    bits = header.number("DATA VERSION", default=16.0)
    dtype = _DTYPE.get(bits)
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
    held = len(data) / (samples * dtype.itemsize)
    traces = header.number("LAST TRACE", default=float(np.ceil(held)))
    if held != traces:
        expected = f"{traces:g} traces of {samples} samples of {bits:g} bits as {header.path.name} says"
        raise InputError(file, "size", expected, f"{len(data)} bytes ({held:.6g} traces)")
    frequency_mhz = re.search(r"(\d+(?:\.\d+)?)\s*MHz", header.values.get("ANTENNA", ""), re.IGNORECASE)
    channels = np.frombuffer(data, dtype=dtype).reshape(-1, 1, samples).astype(dtype.newbyteorder("="))
    profile = Profile(
        path=file,
        channels=channels,
        sample_interval_ns=interval_ns,
        time_zero_ns=zero_sample * interval_ns,
        spacing_m=spacing_m or None,
        centre_frequency_hz=float(frequency_mhz[1]) * 1e6 if frequency_mhz else None,
        positions_m=np.arange(len(channels)) * spacing_m if spacing_m else None,
        metadata=dict(header.values),
    )
    return profile, header


def _check_same_recording(profile: Profile, header: TextHeader, first: Profile, other: TextHeader) -> None:
    if profile.channels.shape != first.channels.shape or profile.channels.dtype != first.channels.dtype:
        expected = f"{_size(first)} as in {first.path.name}"
        raise InputError(profile.path, "recording", expected, _size(profile))
    for name in ("TIMEWINDOW", "DISTANCE INTERVAL", "ANTENNA"):
        if header.values.get(name) != other.values.get(name):
            expected = f"{other.values.get(name)} as in {other.path.name}"
            raise InputError(header.path, name, expected, str(header.values.get(name)))


def _size(profile: Profile) -> str:
    traces, _, samples = profile.channels.shape
    return f"{traces} traces of {samples} samples of {8 * profile.channels.dtype.itemsize} bits"
