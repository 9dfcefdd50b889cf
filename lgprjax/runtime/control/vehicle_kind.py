"""What a kind of vehicle brings to the control loop, and what the loop asks of it in a tick."""

import math
from enum import IntFlag
from typing import Any, NamedTuple, Protocol, runtime_checkable

from lgprjax.autopilot import Check, Event, Limited, Mode, PathOffset, SkidLimited
from lgprjax.autopilot.monitors import Severity, Watch, describe
from lgprjax.navigation import Reaction, Reason
from lgprjax.run_records import Record, RecordKind
from lgprjax.runtime.config import RuntimeConfig
from lgprjax.runtime.control.modes import CheckItem

# Events of a tick for the mode machine: what watches, navigation, processes and the limiter say.

_PLACE_OF = {
    Event.ROUTE_NEAR: PathOffset.NEAR,
    Event.ROUTE_OFF: PathOffset.OFF_ROUTE,
    Event.ROUTE_AMBIGUOUS: PathOffset.AMBIGUOUS,
    Event.ROUTE_WRONG_HEADING: PathOffset.WRONG_HEADING,
    Event.ROUTE_GONE: PathOffset.NO_PATH,
}
DIED = {
    "control": Event.CONTROL_DIED,
    "registration": Event.REGISTRATION_DIED,
    "recorder": Event.RECORDER_DIED,
    "display": Event.DISPLAY_DIED,
    "monitor": Event.MONITOR_DIED,
}
RELAUNCHED = {
    "control": Event.CONTROL_RELAUNCHED,
    "registration": Event.REGISTRATION_RELAUNCHED,
    "recorder": Event.RECORDER_RELAUNCHED,
    "display": Event.DISPLAY_RELAUNCHED,
    "monitor": Event.MONITOR_RELAUNCHED,
}


class ReportedState(NamedTuple):
    """What the mode machine was told last of what it is told by changes.

    Attributes:
        sources, health, error, line: as told; ``None`` before the first time.
    """

    sources: bool | None = None
    health: bool | None = None
    error: bool = False
    line: bool = True


class Seen(NamedTuple):
    """What there is to tell of a tick.

    Attributes:
        mode: as driven; place: as the mode machine has it.
        started: there is a pose.
        route: one of the events ``ROUTE_*``: where the vehicle is beside what it is to follow.
        doubtful: the heading is not confirmed yet, which matters until something is engaged.
        reaction: a ``Reaction`` of navigation's health.
        sources: everything that engaging needs is there.
        line: the box and its line are sound.
        severity: the largest of the findings.
        manual: findings beside the line's ask for manual or more.
        failed: the limiter, or a control loop that is late, asks for manual.
        recorder_lost: the recording is mandatory and cannot be kept.
    """

    mode: Mode
    place: PathOffset
    started: bool
    route: Event
    doubtful: bool
    reaction: int
    sources: bool
    line: bool
    severity: Severity
    manual: bool
    failed: bool
    recorder_lost: bool


def events_of(told: ReportedState, seen: Seen) -> tuple[ReportedState, list[Event]]:
    """What has changed since the last tick, as events in the order in which they weigh."""
    engaged = seen.mode in (Mode.STEERING, Mode.SPEED)
    events: list[Event] = []
    if seen.line is not told.line:
        events.append(Event.DRIVE_BY_WIRE_RELAUNCHED if seen.line else Event.DRIVE_BY_WIRE_DIED)
    # Watches that ask for manual are an error while the autopilot drives. While a person drives they only refuse.
    error = (engaged and (seen.manual or seen.failed)) or (told.error and seen.manual)
    if error is not told.error:
        events.append(Event.ERROR_RAISED if error else Event.ERROR_CLEARED)
    route = seen.route if seen.started else Event.ROUTE_GONE
    if seen.doubtful and not engaged:
        route = Event.ROUTE_WRONG_HEADING
    if _PLACE_OF[route] is not seen.place:
        events.append(route)
    if seen.sources is not told.sources:
        events.append(Event.SOURCES_PRESENT if seen.sources else Event.SOURCE_MISSING)
    stops = seen.reaction == Reaction.STOP or seen.severity is Severity.STOP or seen.recorder_lost
    health = seen.started and not stops
    if health is not told.health:
        events.append(Event.HEALTH_GOOD if health else Event.HEALTH_STOP)
    return ReportedState(seen.sources, health, error, seen.line), events


# What the supervisor says of the other processes, and what that means to the modes.

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


class Operator(NamedTuple):
    """The operator's controller since the last tick: buttons of every status, oldest first, and the newest one's age.

    The age is infinite before the first.
    """

    statuses: tuple[int, ...]
    age_s: float


LINE = Watch.LINE_SILENT | Watch.BAD_FRAMES | Watch.BUS_OFF | Watch.DEFAULTS_ACT | Watch.SECOND_SENDER
"""Findings of the box's line: they are its own fault, not one of the vehicle."""


def box_checks(bits: Watch, *, heard: bool) -> list[CheckItem]:
    """Checks of the drive-by-wire box and its line, which every vehicle has."""
    line = bits & (Watch.LINE_SILENT | Watch.BAD_FRAMES | Watch.BUS_OFF | Watch.ACTUATOR_FAULT)
    said = "; ".join(describe(line)) or "the drive-by-wire box is silent"
    second = bool(bits & Watch.SECOND_SENDER)
    return [
        CheckItem(Check.SECOND_MASTER, not second, "another sender commands the drive-by-wire box"),
        CheckItem(Check.DRIVE_BY_WIRE, heard and not line, said),
    ]


def whole(number: float, unknown: int = 0) -> int:
    """A number that is a whole one where it is a number at all."""
    return int(number) if math.isfinite(number) else unknown


def reason_words(reasons: float) -> list[str]:
    """Reasons of navigation's health, as words."""
    return [_words(reason) for reason in Reason(whole(reasons))]


def limited_words(limited: Limited | SkidLimited) -> list[str]:
    """What the limiter held back because it was no sound command, as words."""
    kind = type(limited)
    bad = limited & (kind.NOT_FINITE | kind.STALE | kind.MANUAL_REQUESTED)
    return [f"command: {_words(bit)}" for bit in bad]


def _words(bit: IntFlag) -> str:
    return str(bit.name).lower().replace("_", " ")


class VehicleStatus(NamedTuple):
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


class OutgoingFrame(NamedTuple):
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

    def update(self, operator: Operator, now_ns: int) -> list[Event]:
        """End of what came: the watches judge it. Events of buttons and motion, in their order."""

    def status(self, *, decided: bool) -> VehicleStatus:
        """As it is now; ``decided``: with what this tick's ``step`` found."""

    def checks(self, processes: Processes) -> list[CheckItem]:
        """Every system check as it stands."""

    def step(self, wish: Wish, now_ns: int) -> None:
        """The compiled step."""

    def command(self, engage: int) -> OutgoingFrame:
        """What is sent, with these bits of the modes engaged."""

    def rows(self, now_ns: int, mode: int) -> list[tuple[RecordKind, bytes]]:
        """What the tick leaves for others and for the recording."""

    def state(self, tick: int) -> dict[str, Any]:
        """What the display shows of it."""

    def warnings(self) -> list[str]:
        """What the operator should know, in words."""

    def refusal_text(self) -> str:
        """Why nothing is engaged, where the kind can say it better than the modes; else empty."""

    def notes(self) -> list[dict[str, Any]]:
        """What happened in this tick that is to be recorded as an event."""

    def release(self, engage: int) -> OutgoingFrame:
        """The last command of all: nothing engaged but these bits."""

    def leave(self) -> None:
        """The operator drives: where he then is, is to be found anew."""

    def choose(self, name: str) -> bool:
        """Another route by its name; whether it can be driven."""
