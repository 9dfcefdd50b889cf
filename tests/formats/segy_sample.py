"""SEG-Y files that the tests write by segyio."""

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
