"""MALA lines: ``.rd3`` (int16) or ``.rd7`` (int32) samples with a ``.rad`` text header."""

from pathlib import Path
from typing import Any

import numpy as np

from lgprjax.errors import InputError
from lgprjax.formats.profile import Profile, TextHeader, companion, count_traces, named_frequency_hz, read_bytes

_DTYPE: dict[str, np.dtype[Any]] = {".rd3": np.dtype("<i2"), ".rd7": np.dtype("<i4")}


def read_mala(path: str | Path, *, partial: bool = False) -> Profile:
    """Read one ``.rd3`` or ``.rd7`` file with the ``.rad`` beside it.

    ``FREQUENCY`` is the sampling rate in MHz and ``TIMEWINDOW`` is in ns. The header has no time zero in samples:
    it is taken as sample 0. A ``DISTANCE INTERVAL`` of zero means recorded by time.

    Args:
        path: the file.
        partial: read the whole traces of a file that ends too early; ``Profile.cut`` then says how many there are.

    Raises:
        InputError: a file is missing, cut short or another format, or header and file size disagree.
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
