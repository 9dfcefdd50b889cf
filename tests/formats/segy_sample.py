"""SEG-Y files that the tests write, by segyio or byte by byte."""

import struct
from pathlib import Path
from typing import Any

import numpy as np
import segyio

COUNTS = np.random.default_rng(5).integers(-30000, 30000, (6, 10))


def write_segy(
    path: Path,
    traces: np.ndarray = COUNTS,
    *,
    code: int = 3,
    interval: int = 400,
    trace_interval: int | None = None,
    revision: int = 1,
    headers: dict[int, Any] | None = None,
    endian: str = "big",
    units: int = 1,
) -> Path:
    """A file by segyio; ``headers`` are words of the trace headers, one for all traces or one each."""
    spec = segyio.spec()
    spec.format, spec.samples, spec.tracecount, spec.endian = code, np.arange(traces.shape[1]), len(traces), endian
    dtype = {1: "f4", 2: "i4", 3: "i2", 5: "f4", 8: "i1"}[code]
    with segyio.create(str(path), spec) as store:
        store.bin.update({3217: interval, 3255: units, 3501: revision})
        for index, trace in enumerate(traces):
            store.trace[index] = trace.astype(dtype)
            words = {k: int(np.broadcast_to(v, len(traces))[index]) for k, v in (headers or {}).items()}
            store.header[index] = {117: interval if trace_interval is None else trace_interval, **words}
    return path


def segy_bytes(
    traces: np.ndarray,
    *,
    order: str = ">",
    code: int = 3,
    revision: bytes = b"\0\0",
    extended: int = 0,
    additional: int = 0,
    unused: int = 0,
    trailers: int = 0,
    states: dict[tuple[int, str], float] | None = None,
    words: dict[tuple[int, str], np.ndarray] | None = None,
) -> bytes:
    """A file by its words, whose places count from 1 as in the standard.

    ``unused`` are bytes between the headers and the first trace; ``states`` are words of the binary header, ``words``
    of the trace headers, one for each trace.
    """
    binary = bytearray(400)
    stated = {(3217, "H"): 400, (3221, "H"): traces.shape[1], (3225, "h"): code, (3505, "h"): extended}
    for (place, kind), value in (stated | (states or {})).items():
        struct.pack_into(order + kind, binary, place - 3201, value)
    binary[300:302] = revision
    parts = [b"\x40" * 3200, bytes(binary), b"\x41" * 3200 * extended, b"\xaa" * unused]
    for index, trace in enumerate(traces):
        header = bytearray(240)
        struct.pack_into(f"{order}HH", header, 114, traces.shape[1], 400)
        for (place, kind), values in (words or {}).items():
            struct.pack_into(order + kind, header, place - 1, values[index])
        parts += [bytes(header), b"\x55" * 240 * additional, trace.astype(order + trace.dtype.str[1:]).tobytes()]
    return b"".join(parts) + b"\x42" * 3200 * trailers
