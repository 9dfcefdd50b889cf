"""Resources of this machine, and the time that compiling took of them."""

import os
import sys
import time
from pathlib import Path


def usable_cores() -> int:
    """CPU cores that this process may use."""
    return len(os.sched_getaffinity(0)) if sys.platform == "linux" else os.cpu_count() or 1


def keep_programs(folder: Path) -> None:
    """Keep compiled programs in a folder, in this process and those that it starts; before JAX is imported.

    Existing environment variables are kept. A program's key does not depend on the folder's path, so that a copied or
    shared folder serves as well.
    """
    for name, value in {
        "JAX_COMPILATION_CACHE_DIR": str(folder),
        # By default programs that compile within a second are not kept; many of those make a slow start.
        "JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS": "0",
        "JAX_PERSISTENT_CACHE_MIN_ENTRY_SIZE_BYTES": "-1",
        # XLA's own caches would put the path into the key.
        "JAX_PERSISTENT_CACHE_ENABLE_XLA_CACHES": "none",
    }.items():
        os.environ.setdefault(name, value)


class CompileClock:
    """Compilation time of this process since the clock's construction, so that timings can exclude compilation.

    JAX reports a step when it has ended; steps within others count once.
    """

    def __init__(self) -> None:
        import jax.monitoring

        self._spans: list[tuple[float, float]] = []
        jax.monitoring.register_event_duration_secs_listener(self._heard)

    def _heard(self, event: str, duration_secs: float, **_: str | int) -> None:
        if "/core/compile/" not in event:
            return
        end = time.perf_counter()
        begin = end - duration_secs
        while self._spans and self._spans[-1][0] >= begin:
            self._spans.pop()
        self._spans.append((max(begin, self._spans[-1][1] if self._spans else begin), end))

    def seconds_since(self, began: float) -> float:
        """Seconds compiled since a moment of ``time.perf_counter``."""
        return sum(end - max(begin, began) for begin, end in self._spans if end > began)


_clocks: list[CompileClock] = []


def compile_clock() -> CompileClock:
    """The clock of this process, which runs from the first call on."""
    if not _clocks:
        _clocks.append(CompileClock())
    return _clocks[0]
