"""Interface between the control loop and a kind of vehicle."""

from typing import Any, NamedTuple, Protocol, runtime_checkable

from lgprjax.autopilot import Check, Event, Mode, PathOffset
from lgprjax.autopilot.monitors import FINDINGS, Severity, Watch, describe
from lgprjax.navigation import Reaction
from lgprjax.run_records import Record, RecordKind
from lgprjax.runtime.config import RuntimeConfig
from lgprjax.runtime.control.modes import CheckItem
from lgprjax.runtime.process import processes_of

# Events of a tick for the mode machine: from watches, navigation, processes and the limiter.

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
    """Last state reported to the mode machine, which receives changes only.

    Attributes:
        sources, health, error, line: reported states; ``None`` before the first report.
    """

    sources: bool | None = None
    health: bool | None = None
    error: bool = False
    line: bool = True


class Seen(NamedTuple):
    """Conditions of a tick to report.

    Attributes:
        mode: present mode.
        place: position relative to the route in the mode machine.
        started: whether there is a pose.
        route: one of the events ``ROUTE_*``: the vehicle's place relative to its route.
        doubtful: whether the heading is unconfirmed, which matters only until something is engaged.
        reaction: ``Reaction`` of navigation's health.
        sources: whether all inputs needed to engage are present.
        line: whether the box and its line are good.
        severity: largest severity of the findings.
        manual: whether findings other than the line's request manual mode or more.
        failed: whether the limiter, or a late control loop, requests manual mode.
        recorder_lost: whether the recording is mandatory and has failed.
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


def events_of(reported: ReportedState, seen: Seen) -> tuple[ReportedState, list[Event]]:
    """Changes since the last tick, as events in order of importance."""
    engaged = seen.mode in (Mode.STEERING, Mode.SPEED)
    events: list[Event] = []
    if seen.line is not reported.line:
        events.append(Event.DRIVE_BY_WIRE_RELAUNCHED if seen.line else Event.DRIVE_BY_WIRE_DIED)
    # Watches that request manual mode are an error while the autopilot drives. While a person drives they only inhibit.
    error = (engaged and (seen.manual or seen.failed)) or (reported.error and seen.manual)
    if error is not reported.error:
        events.append(Event.ERROR_RAISED if error else Event.ERROR_CLEARED)
    route = seen.route if seen.started else Event.ROUTE_GONE
    if seen.doubtful and not engaged:
        route = Event.ROUTE_WRONG_HEADING
    if _PLACE_OF[route] is not seen.place:
        events.append(route)
    if seen.sources is not reported.sources:
        events.append(Event.SOURCES_PRESENT if seen.sources else Event.SOURCE_MISSING)
    stops = seen.reaction == Reaction.STOP or seen.severity is Severity.STOP or seen.recorder_lost
    health = seen.started and not stops
    if health is not reported.health:
        events.append(Event.HEALTH_GOOD if health else Event.HEALTH_STOP)
    return ReportedState(seen.sources, health, error, seen.line), events


# Reports of the supervisor on the other processes, and their meaning for the modes.

_SAYS = {
    "display": "the operator's page is not available",
    "recorder": "nothing is being recorded",
    "coverage": "the map of worked ground is not being updated",
    "output": "the corrected position is not being sent",
}
_KEPT = ("recorder", "coverage")
"""Processes that are mandatory if the recording is."""
_BESIDE = ("coverage", "output")
"""Processes that the mode machine ignores."""


class Processes:
    """Running processes.

    Args:
        config: configuration of the run.

        Attributes:
        alive: whether each reported process is alive, by name.
        mandatory: whether the vehicle stops without a recording.
        radar: texts of the radar's reported state.
    """

    def __init__(self, config: RuntimeConfig) -> None:
        self.alive: dict[str, bool] = {}
        # A calibration needs its recording, and its crew reads the page.
        calibrates = config.mode == "calibrate"
        self.mandatory = config.recording.mandatory or calibrates
        self._kept = (*_KEPT, "display") if calibrates else _KEPT
        self.radar: list[str] = []
        running = processes_of(config)
        # The slowest to start.
        self._beside = next(name for name in ("registration", "coverage", "recorder") if name in running)

    def take(self, note: dict[str, Any]) -> list[Event]:
        """Take a note of the supervisor, or of the radar; returns its event for the modes."""
        if "radar" in note:
            self.radar = [str(text) for text in note["radar"]]
        died, left, ready = (str(note.get(key)) for key in ("died", "left", "ready"))
        if died in DIED or died in _BESIDE:
            known, self.alive[died] = self.alive.get(died), False
            return self._events(DIED, died) if known is not None else []
        if left in DIED or left in _BESIDE:
            # It is not restarted. The consequence was reported with its deaths, or it ended in order.
            self.alive[left] = False
        elif ready in RELAUNCHED or ready in _BESIDE:
            known, self.alive[ready] = self.alive.get(ready), True
            return self._events(RELAUNCHED, ready) if known is False else []
        return []

    def silent(self, name: str) -> bool:
        """Whether a process is not running."""
        return not self.alive.get(name, False)

    @property
    def starting(self) -> bool:
        """Whether the slowest one has not started for the first time."""
        return self._beside not in self.alive

    @property
    def lost(self) -> bool:
        """Whether the recording is mandatory and has failed."""
        return self.mandatory and any(self.alive.get(name) is False for name in self._kept)

    @property
    def slowly(self) -> bool:
        """Whether the worked map cannot be followed live."""
        return self.alive.get("coverage") is False

    @property
    def warnings(self) -> list[str]:
        """Warnings that do not stop the vehicle."""
        return [*(text for name, text in _SAYS.items() if self.alive.get(name) is False), *self.radar]

    def _events(self, of: dict[str, Event], name: str) -> list[Event]:
        # Deaths of an optional recorder do not disengage the autopilot.
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


def box_checks(bits: Watch, *, received: bool) -> list[CheckItem]:
    """Checks of the drive-by-wire box and its line, which every vehicle has."""
    line = bits & (Watch.LINE_SILENT | Watch.BAD_FRAMES | Watch.BUS_OFF | Watch.ACTUATOR_FAULT)
    said = "; ".join(describe(line, FINDINGS)) or "the drive-by-wire box is silent"
    second = bool(bits & Watch.SECOND_SENDER)
    return [
        CheckItem(Check.SECOND_MASTER, not second, "another sender commands the drive-by-wire box"),
        CheckItem(Check.DRIVE_BY_WIRE, received and not line, said),
    ]


class VehicleStatus(NamedTuple):
    """The vehicle's status for the modes.

    Attributes:
        started: whether there is a pose.
        place: one of the events ``ROUTE_*``.
        doubtful: whether the heading is unconfirmed.
        reaction: ``Reaction`` of navigation's health.
        ages_s: age of each input that engaging needs, by the text of its absence.
        line: whether the box's line is good, or the box has never been received.
        severity: largest severity of the findings; CONTINUE while the box has never been received.
        manual: whether findings other than the line's request manual mode or more.
        emergency: whether findings request cutting the power.
        refuses: whether findings inhibit engaging.
        failed: whether the limiter requests manual mode.
        why: texts of all findings, the most severe first.
    """

    started: bool
    place: Event
    doubtful: bool
    reaction: int
    ages_s: dict[str, float]
    line: bool
    severity: Severity
    manual: bool
    emergency: bool
    refuses: bool
    failed: bool
    why: list[str]


class Wish(NamedTuple):
    """Request of the modes for a tick.

    Attributes:
        engaged: whether the computer controls the vehicle.
        drives: whether it moves the vehicle.
        stop: whether a controlled stop runs.
        slowly: whether other processes require a slow speed.
        set_speed_mps: speed locked by the operator.
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
    """A vehicle in the control loop. Methods are called in this order in a tick.

    Attributes:
        speed_control: the computer can command its speed.
    """

    speed_control: bool

    @property
    def lock_mps(self) -> float:
        """Speed locked by a cruise button now."""

    def warm_up(self) -> None:
        """Compile all that a tick may need."""

    def take(self, record: Record, tick: int) -> None:
        """Take a message of a line other than the controller's, or a fix."""

    def update(self, operator: Operator, now_ns: int) -> list[Event]:
        """End of the messages: the watches judge them. Returns events of buttons and motion, in order."""

    def status(self, *, decided: bool) -> VehicleStatus:
        """Present status; ``decided``: including this tick's ``step``."""

    def checks(self, processes: Processes) -> list[CheckItem]:
        """Present state of every system check."""

    def step(self, wish: Wish, now_ns: int) -> None:
        """The compiled step."""

    def command(self, engage: int) -> OutgoingFrame:
        """Command to send, with these bits of the modes engaged."""

    def rows(self, now_ns: int, mode: int) -> list[tuple[RecordKind, bytes]]:
        """Rows of the tick for other processes and for the recording."""

    def state(self, tick: int) -> dict[str, Any]:
        """State for the display."""

    def warnings(self) -> list[str]:
        """Warnings to the operator, in words."""

    def inhibit_text(self) -> str:
        """Why nothing is engaged, if the kind has a better text than the modes; else empty."""

    def slow(self) -> list[str]:
        """Texts of the reasons of the present speed cap; empty without one."""

    def notes(self) -> list[dict[str, Any]]:
        """Notes of this tick to record as events."""

    def release(self, engage: int) -> OutgoingFrame:
        """The last command of all: nothing engaged but these bits."""

    def leave(self) -> None:
        """The operator drives: the place must be searched again."""

    def choose(self, name: str, place: str) -> bool:
        """Another route by its name, and the place on it where it passes the vehicle several times; whether they can be
        driven.
        """

    def next_place(self, by: int) -> dict[str, str] | None:
        """The request for the next of the places where the vehicle may be, 1, or the one before, -1; else ``None``."""
