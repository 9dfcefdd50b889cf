"""Events of a tick for the mode machine: what watches, navigation, processes and the limiter say."""

from typing import NamedTuple

from lgprjax.autopilot import Event, Limited, Mode, Place
from lgprjax.autopilot.watch_findings import REFUSING, Severity, Watch
from lgprjax.navigation import PlanCode, Reaction

_PLACES = {
    PlanCode.FOLLOWING: Event.ROUTE_NEAR,
    PlanCode.AT_CUSP: Event.ROUTE_NEAR,
    PlanCode.DONE: Event.ROUTE_OFF,
    PlanCode.OFF_ROUTE: Event.ROUTE_OFF,
    PlanCode.AMBIGUOUS: Event.ROUTE_AMBIGUOUS,
    PlanCode.WRONG_HEADING: Event.ROUTE_WRONG_HEADING,
    PlanCode.LOST: Event.ROUTE_OFF,
    PlanCode.NON_FINITE: Event.ROUTE_OFF,
}
_PLACE_OF = {
    Event.ROUTE_NEAR: Place.NEAR,
    Event.ROUTE_OFF: Place.OFF_ROUTE,
    Event.ROUTE_AMBIGUOUS: Place.AMBIGUOUS,
    Event.ROUTE_WRONG_HEADING: Place.WRONG_HEADING,
    Event.ROUTE_GONE: Place.NO_PATH,
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


class Told(NamedTuple):
    """What the mode machine was told last of what it is told by changes.

    Attributes:
        sources, health, error, line: as told; ``None`` before the first time.
        overruns: ticks that began late, of the last ones.
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
        code: of the plan or of the search for a place.
        reaction: a ``Reaction`` of navigation's health.
        sources: everything that engaging needs is there.
        watch: findings; severity: their largest.
        limited: bits of the limiter.
        late: the control loop missed its period too often.
        recorder_lost: the recording is mandatory and cannot be kept.
    """

    mode: Mode
    place: Place
    started: bool
    code: PlanCode
    reaction: int
    sources: bool
    watch: Watch
    severity: Severity
    limited: int
    late: bool
    recorder_lost: bool


_LINE = Watch.LINE_SILENT | Watch.BAD_FRAMES | Watch.BUS_OFF | Watch.DEFAULTS_ACT | Watch.SECOND_SENDER


def events_of(told: Told, seen: Seen) -> tuple[Told, list[Event]]:
    """What has changed since the last tick, as events in the order in which they weigh."""
    engaged = seen.mode in (Mode.STEERING, Mode.SPEED)
    events: list[Event] = []
    line = not seen.watch & _LINE
    if line is not told.line:
        events.append(Event.DRIVE_BY_WIRE_RELAUNCHED if line else Event.DRIVE_BY_WIRE_DIED)
    # Watches that ask for manual are an error while the autopilot drives. While a person drives they only refuse.
    severe = seen.severity >= Severity.MANUAL and bool(seen.watch & ~_LINE)
    failed = bool(seen.limited & Limited.MANUAL_REQUESTED) or seen.late
    error = (engaged and (severe or failed)) or (told.error and severe)
    if error is not told.error:
        events.append(Event.ERROR_RAISED if error else Event.ERROR_CLEARED)
    place = _PLACES[seen.code] if seen.started else Event.ROUTE_GONE
    if seen.watch & Watch.HEADING_CONTRADICTED or (seen.watch & Watch.HEADING_UNCONFIRMED and not engaged):
        place = Event.ROUTE_WRONG_HEADING
    if _PLACE_OF[place] is not seen.place:
        events.append(place)
    sources = seen.sources and not seen.watch & REFUSING
    if sources is not told.sources:
        events.append(Event.SOURCES_PRESENT if sources else Event.SOURCE_MISSING)
    stops = seen.reaction == Reaction.STOP or seen.severity is Severity.STOP or seen.recorder_lost
    health = seen.started and not stops
    if health is not told.health:
        events.append(Event.HEALTH_GOOD if health else Event.HEALTH_STOP)
    return Told(sources, health, error, line), events
