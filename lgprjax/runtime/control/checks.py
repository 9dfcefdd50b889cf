"""System checks: what must be in order before anything can be engaged, tried for a while and then said."""

from collections.abc import Callable
from typing import NamedTuple

from lgprjax.autopilot import Check

_PATIENCE_S = 12.0
_BRAKE_TEST_EVERY_S = 2.0


class CheckItem(NamedTuple):
    """One check: which, whether it holds now, and why not."""

    check: Check
    good: bool
    reason: str


class SystemChecks:
    """A run of the checks: passed as soon as all hold, failed by the first that still does not after a while.

    Attributes:
        items: of the last look, in the order of the checks.
        running: a run is under way.
    """

    def __init__(self) -> None:
        self.items: list[CheckItem] = []
        self.running = False
        self._began_s = 0.0
        self._braked_s = 0.0

    def begin(self, time_s: float) -> None:
        """Begin, or begin again."""
        self.running, self._began_s, self._braked_s = True, time_s, 0.0

    def step(self, time_s: float, look: Callable[[], list[CheckItem]], *, starting: bool) -> CheckItem | bool | None:
        """``True`` where the run has passed, the failed item where it failed, ``None`` while it goes on.

        While processes are still ``starting`` for the first time nothing has failed yet: how long they may take is the
        supervisor's to say.
        """
        if not self.running:
            return None
        if starting:
            self._began_s = time_s
        self.items = look()
        failed = next((item for item in self.items if not item.good), None)
        if failed is None:
            self.running = False
            return True
        if time_s - self._began_s < _PATIENCE_S:
            return None
        self.running = False
        return failed

    def brake_test_due(self, time_s: float) -> bool:
        """Whether the box is to be asked for its braking test now."""
        waiting = self.running and any(item.check is Check.BRAKE and not item.good for item in self.items)
        if not waiting or time_s - self._braked_s < _BRAKE_TEST_EVERY_S:
            return False
        self._braked_s = time_s
        return True
