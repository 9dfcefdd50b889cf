"""What the supervisor says of the other processes, and what that means to the modes."""

from typing import Any

from lgprjax.autopilot import Event
from lgprjax.runtime.config import RuntimeConfig
from lgprjax.runtime.control.happenings import DIED, RELAUNCHED

_SAYS = {
    "recorder": "nothing is being recorded",
    "coverage": "the map of what is worked is not being kept",
}


class Processes:
    """Which processes live.

    Args:
        config: of the run.

    Attributes:
        alive: by name, of those that were heard of.
        mandatory: without a recording the vehicle stops.
        radar: what the radar reports of itself, in words.
    """

    def __init__(self, config: RuntimeConfig) -> None:
        self.alive: dict[str, bool] = {}
        self.mandatory = config.recording.mandatory
        self.radar: list[str] = []
        self._beside = "registration" if config.coverage is None else "coverage"

    def take(self, note: dict[str, Any]) -> list[Event]:
        """A note of the supervisor, or of the radar; what it is to the modes."""
        if "radar" in note:
            self.radar = [str(text) for text in note["radar"]]
        died, left, ready = (str(note.get(key)) for key in ("died", "left", "ready"))
        if died in DIED or died == "coverage":
            known, self.alive[died] = self.alive.get(died), False
            return self._events(DIED, died) if known is not None else []
        if left in DIED or left == "coverage":
            # It is not started again. What that means was said with its deaths, or it ended in order.
            self.alive[left] = False
        elif ready in RELAUNCHED or ready == "coverage":
            known, self.alive[ready] = self.alive.get(ready), True
            return self._events(RELAUNCHED, ready) if known is False else []
        return []

    def silent(self, name: str) -> bool:
        """Whether a process is not there."""
        return not self.alive.get(name, False)

    @property
    def starting(self) -> bool:
        """The slowest one has not come up for the first time."""
        return self._beside not in self.alive

    @property
    def lost(self) -> bool:
        """The recording is mandatory and cannot be kept."""
        return self.mandatory and any(self.alive.get(name) is False for name in _SAYS)

    @property
    def slowly(self) -> bool:
        """What is worked cannot be followed live."""
        return self.alive.get("coverage") is False

    @property
    def warnings(self) -> list[str]:
        """What does not stop the vehicle and should be known."""
        return [*(text for name, text in _SAYS.items() if self.alive.get(name) is False), *self.radar]

    def _events(self, of: dict[str, Event], name: str) -> list[Event]:
        # A recording that need not be there does not take the vehicle from the autopilot by its deaths.
        if name not in of or (of is DIED and name == "recorder" and not self.mandatory):
            return []
        return [of[name]]
