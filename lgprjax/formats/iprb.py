"""ImpulseRadar lines: ``.iprb`` samples (int16 or int32) with an ``.iprh`` text header, one file a channel."""

import itertools
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from lgprjax.errors import InputError
from lgprjax.formats.profile import Profile, TextHeader, companion, count_traces, named_frequency_hz, read_bytes

_DTYPE: dict[float, np.dtype[Any]] = {16: np.dtype("<i2"), 32: np.dtype("<i4")}


def read_iprb(path: str | Path, *, partial: bool = False) -> Profile:
    """Read one ``.iprb`` file, one channel, with the ``.iprh`` beside it.

    ``DATA VERSION`` is the number of bits a sample, ``FREQUENCY`` the sampling rate in MHz, ``TIMEWINDOW`` in ns,
    ``ZERO LEVEL`` the sample of time zero. ``DISTANCE INTERVAL`` is the distance between traces as the wheel
    measured it; ``USER DISTANCE INTERVAL`` is the nominal one that was asked for, and is not used. A line triggered
    by time has no spacing.

    Args:
        path: the file.
        partial: read the whole traces of a file that ends too early; ``Profile.cut`` then says how many there are.

    Raises:
        InputError: a file is missing, cut short or another format, or header and file size disagree.
    """
    return _read(Path(path), partial=partial)[0]


def read_iprb_array(paths: Sequence[str | Path], *, partial: bool = False) -> Profile:
    """Read the channels of one line, ``NAME_001_A01.iprb``, ``NAME_001_A02.iprb`` ..., as one profile.

    ``CH_X_OFFSET`` counts to the right of the positioning's reference, ``CH_Y_OFFSET`` forwards; channels are
    returned from left to right. A single file has no place in an array.

    Args:
        paths: the files, in any order.
        partial: where channels end too early, read of all of them the traces that every one has whole;
            ``Profile.cut`` then says how many there are.

    Raises:
        InputError: a file cannot be read, or the channels are no array: another recording, or two in one place.
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
            raise InputError(read[right][1].path, "CH_X_OFFSET", "another place than every other channel", found)
    for i in order[1:]:
        _check_same_recording(read[i][0], read[i][1], first, header)
    whole = min(len(profile.channels) for profile, _ in read)
    return Profile(
        path=first.path,
        channels=np.concatenate([read[i][0].channels[:whole] for i in order], axis=1),
        sample_interval_ns=first.sample_interval_ns,
        time_zero_ns=first.time_zero_ns,
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
