"""Resources of this machine, and what this process used of them: programs compiled, their time, and memory."""

import os
import re
import sys
import time
from collections.abc import Callable
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


def count_compiles() -> Callable[[], int]:
    """Count the programs that this process compiles, or loads from the cache, from this call on."""
    import jax.monitoring

    counted = 0

    def listen(event: str, duration_secs: float, **_: str | int) -> None:
        nonlocal counted
        counted += event == "/jax/core/compile/backend_compile_duration" and duration_secs >= 0.0

    jax.monitoring.register_event_duration_secs_listener(listen)
    return lambda: counted


def peak_rss_mb() -> float:
    """Largest memory of this process so far, 10⁶ bytes."""
    status = Path("/proc/self/status")
    if not status.exists():
        try:
            import resource
        except ImportError:  # Windows
            return float("nan")
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1e-6
    # On Linux getrusage includes the memory of the parent process.
    found = re.search(r"VmHWM:\s*(\d+) kB", status.read_text(encoding="ascii"))
    assert found is not None
    return int(found.group(1)) * 1.024e-3
