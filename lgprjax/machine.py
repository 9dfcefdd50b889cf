"""Resources of this machine, and the time that compiling took of them."""

import os
import sys
import time


def usable_cores() -> int:
    """CPU cores that this process may use."""
    return len(os.sched_getaffinity(0)) if sys.platform == "linux" else os.cpu_count() or 1


class CompileClock:
    """How long this process has compiled, so that a time can be told without: one clock, which begins when it is made.

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
