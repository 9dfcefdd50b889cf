"""Ticks that began more than a period late. Fault 26."""

_TICK_NS = 20_000_000
_MOST, _WINDOW = 3, 50


class LateTicks:
    """Late ticks of the last second.

    Attributes:
        last_ns: begin of the last tick; 0 before the first.
    """

    def __init__(self) -> None:
        self.last_ns = 0
        self._late: list[int] = []

    def count(self, tick: int, now_ns: int) -> None:
        """A tick begins."""
        if self.last_ns and now_ns - self.last_ns > 2 * _TICK_NS:
            self._late.append(tick)
        self.last_ns = now_ns
        self._late = [late for late in self._late if late > tick - _WINDOW]

    @property
    def too_many(self) -> bool:
        """The loop misses its period too often."""
        return len(self._late) >= _MOST
