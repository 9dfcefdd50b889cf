"""Events of a tick for the mode machine: what watches, navigation, processes and the limiter say."""

from typing import NamedTuple

from lgprjax.autopilot import Event, Mode, Place
from lgprjax.autopilot.watch_findings import Severity
from lgprjax.navigation import Reaction

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
    place: Place
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


def events_of(told: Told, seen: Seen) -> tuple[Told, list[Event]]:
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
    return Told(seen.sources, health, error, seen.line), events
