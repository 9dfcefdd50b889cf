"""What a kind of vehicle brings to the control loop, and what the loop asks of it in a tick."""

from typing import Any, NamedTuple, Protocol, runtime_checkable

from lgprjax.autopilot import Event
from lgprjax.autopilot.watch_findings import Severity
from lgprjax.runtime.control.checks import CheckItem
from lgprjax.runtime.control.processes import Processes
from lgprjax.runtime.records import Kind, Record


class Operator(NamedTuple):
    """The operator's controller since the last tick: buttons of every status, oldest first, and the newest one's age.

    The age is infinite before the first.
    """

    statuses: tuple[int, ...]
    age_s: float


class Look(NamedTuple):
    """The vehicle as the modes take it.

    Attributes:
        started: there is a pose.
        place: one of the events ``ROUTE_*``; ``doubtful``: the heading is not confirmed yet.
        reaction: a ``Reaction`` of navigation's health.
        oldest_s: age of the oldest thing that engaging needs.
        line: the box's line is sound, or the box has never been heard.
        severity: the largest that findings ask for; CONTINUE while the box has never been heard.
        manual: findings beside the line's ask for manual or more.
        emergency: findings ask for the power to be cut.
        refuses: findings with which nothing may be engaged.
        failed: the limiter asks for manual.
        why: all of it in words, the weightiest first.
    """

    started: bool
    place: Event
    doubtful: bool
    reaction: int
    oldest_s: float
    line: bool
    severity: Severity
    manual: bool
    emergency: bool
    refuses: bool
    failed: bool
    why: list[str]


class Wish(NamedTuple):
    """What the modes want of a tick.

    Attributes:
        engaged: the computer holds the vehicle.
        drives: and moves it.
        stop: a controlled stop runs.
        slowly: what is there beside the vehicle asks for no more than a slow speed.
        set_speed_mps: that the operator locked.
    """

    engaged: bool
    drives: bool
    stop: bool
    slowly: bool
    set_speed_mps: float


class Frame(NamedTuple):
    """A frame for the box: its message and fields."""

    name: str
    fields: dict[str, int | float]


@runtime_checkable
class VehicleKind(Protocol):
    """A vehicle in the control loop. Calls of a tick come in the order in which they stand here."""

    @property
    def lock_mps(self) -> float:
        """Speed that a cruise button locks now."""

    def warm_up(self) -> None:
        """Compile all that a tick may need."""

    def take(self, record: Record, tick: int) -> None:
        """A message of a line other than the controller's, or a fix."""

    def feel(self, operator: Operator, now_ns: int) -> list[Event]:
        """End of what came: the watches judge it. Events of buttons and motion, in their order."""

    def look(self, *, decided: bool) -> Look:
        """As it is now; ``decided``: with what this tick's ``decide`` found."""

    def checks(self, processes: Processes) -> list[CheckItem]:
        """Every system check as it stands."""

    def decide(self, wish: Wish, now_ns: int) -> None:
        """The compiled step."""

    def command(self, engage: int) -> Frame:
        """What is sent, with these bits of the modes engaged."""

    def rows(self, now_ns: int, mode: int) -> list[tuple[Kind, bytes]]:
        """What the tick leaves for others and for the recording."""

    def state(self, tick: int) -> dict[str, Any]:
        """What the display shows of it."""

    def warnings(self) -> list[str]:
        """What the operator should know, in words."""

    def refusal_text(self) -> str:
        """Why nothing is engaged, where the kind can say it better than the modes; else empty."""

    def notes(self) -> list[dict[str, Any]]:
        """What happened in this tick that is to be recorded as an event."""

    def release(self, engage: int) -> Frame:
        """The last command of all: nothing engaged but these bits."""

    def leave(self) -> None:
        """The operator drives: where he then is, is to be found anew."""

    def choose(self, name: str) -> bool:
        """Another route by its name; whether it can be driven."""
