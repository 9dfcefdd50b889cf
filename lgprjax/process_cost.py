"""Cost of a process so far: programs compiled, and memory."""

import re
from collections.abc import Callable
from pathlib import Path

import jax

_EVENT = "/jax/core/compile/backend_compile_duration"


def count_compiles() -> Callable[[], int]:
    """Count the programs that this process compiles, or loads from the cache, from this call on."""
    counted = 0

    def listen(event: str, duration_secs: float, **_: str | int) -> None:
        nonlocal counted
        counted += event == _EVENT and duration_secs >= 0.0

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
