"""Something that falls due again and again."""

_LATEST_NS = 100_000_000
"""What fell due longer ago is left out, as a device has no queue."""


class Beat:
    """Moments at an even distance.

    Args:
        first_ns, period_ns: of them.
    """

    def __init__(self, first_ns: int, period_ns: int) -> None:
        self._next_ns, self._period_ns = first_ns, period_ns

    def due(self, now_ns: int) -> list[int]:
        """Those that have come since the last call."""
        times = []
        while self._next_ns <= now_ns:
            if now_ns - self._next_ns <= _LATEST_NS:
                times.append(self._next_ns)
            self._next_ns += self._period_ns
        return times
