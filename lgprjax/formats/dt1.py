"""Sensors & Software pulseEKKO and Noggin lines: ``.DT1`` traces with an ``.HD`` text header."""

from pathlib import Path

import numpy as np

from lgprjax.errors import InputError
from lgprjax.formats.profile import Profile, TextHeader, companion, count_traces, read_bytes

_TRACE_HEADER_BYTES = 128
_UNIT_M = {"m": 1.0, "metres": 1.0, "meters": 1.0, "ft": 0.3048, "feet": 0.3048, "foot": 0.3048}


def read_dt1(path: str | Path, *, partial: bool = False) -> Profile:
    """Read one ``.DT1`` file with the ``.HD`` beside it.

    Every trace is a header of 32 float32 words (word 1 its position, word 2 its samples, word 5 bytes a sample)
    and int16 samples. Positions may be in feet; time zero is a fractional sample number counted from sample 0.

    Args:
        path: the file.
        partial: read the whole traces of a file that ends too early; ``Profile.cut`` then says how many there are.

    Raises:
        InputError: a file is missing, cut short or another format, or header, traces and file size disagree.
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
    record_bytes = _TRACE_HEADER_BYTES + 2 * samples
    whole, cut = count_traces(file, len(data), record_bytes, said=(traces, header.path), partial=partial)
    records = np.frombuffer(data, dtype=np.dtype([("header", "<f4", 32), ("samples", "<i2", samples)]), count=whole)
    words = records["header"]
    # Some bit patterns that are no number raise a flag when they are converted; they are looked for here.
    with np.errstate(invalid="ignore"):
        wrong = np.flatnonzero((words[:, 2] != samples) | ~np.isin(words[:, 5], (0.0, 2.0)))
        positions_m = words[:, 1].astype(np.float64) * _UNIT_M[unit]
    if wrong.size:
        found = f"{words[wrong[0], 2]:g} samples of {words[wrong[0], 5]:g} bytes"
        raise InputError(file, f"header of trace {wrong[0]}", f"{samples} samples of 2 bytes", found)
    if not np.all(np.isfinite(positions_m)):
        bad = int(np.argmin(np.isfinite(positions_m)))
        raise InputError(file, f"header of trace {bad}", "a finite position", f"{words[bad, 1]}")
    frequency_mhz = header.number("NOMINAL FREQUENCY", default=0.0)
    return Profile(
        path=file,
        channels=records["samples"][:, None, :].astype(np.int16),
        sample_interval_ns=interval_ns,
        time_zero_ns=header.number("TIMEZERO AT POINT", default=0.0) * interval_ns,
        spacing_m=step * _UNIT_M[unit],
        centre_frequency_hz=frequency_mhz * 1e6 if frequency_mhz > 0 else None,
        positions_m=positions_m,
        metadata=dict(header.values),
        cut=cut,
    )
