"""Whether the heading is the way that the vehicle drives, or its opposite. Fault 9."""

import math
from enum import Enum, auto
from typing import NamedTuple

from lgprjax.autopilot.watch_dwell import wrap_rad
from lgprjax.autopilot.watch_findings import Watch
from lgprjax.autopilot.watch_ground import Placed, Position, Wheeled, place, remember

TRAVEL_M = 1.5
TRAVEL_SIGMAS = 10.0
"""Way that a course needs, and at least so many sigmas of its positions."""
TRAVEL_SHARE = 0.3
"""By which the ways of GNSS and of the odometer may differ: a leap is no course."""
AGREES_RAD = math.radians(30.0)
CONTRADICTS_RAD = math.radians(90.0)
LONGEST_S = 20.0
"""A start older than this is given up: GNSS wanders."""


class HeadingCheck(Enum):
    """What is known of the heading."""

    UNCONFIRMED = auto()
    CONFIRMED = auto()
    CONTRADICTED = auto()


class HeadingWatchState(NamedTuple):
    """What is carried from tick to tick.

    Attributes:
        check: as it stands.
        history: odometer and heading of the last while.
        start: where the course is measured from.
        farthest_m: largest way from there by odometer; turning back starts anew.
        time_s: of the newest tick.
    """

    check: HeadingCheck = HeadingCheck.UNCONFIRMED
    history: tuple[Wheeled, ...] = ()
    start: Placed | None = None
    farthest_m: float = 0.0
    time_s: float = -math.inf


def step_heading_watch(
    state: HeadingWatchState,
    *,
    time_s: float,
    odometer_m: float,
    heading_rad: float,
    position: Position | None,
    fix_heading_rad: float | None,
) -> tuple[HeadingWatchState, Watch]:
    """State and findings of a tick.

    A heading that was confirmed stays so until the watch is begun anew, as it must be when the INS starts again: from
    then on a sign that changes is the odometer's.

    Args:
        state: of the last tick.
        time_s: of this tick; positions hold for times on the same clock.
        odometer_m: signed.
        heading_rad: counter-clockwise from x.
        position: a new one by GNSS; None where none came.
        fix_heading_rad: of a new LGPR fix with code ``ok``; None where none came.
    """
    if state.check is HeadingCheck.CONFIRMED:
        return state, Watch(0)
    if time_s > state.time_s:
        state = state._replace(time_s=time_s)
    state = state._replace(history=remember(state.history, Wheeled(state.time_s, odometer_m, heading_rad)))
    check = state.check
    if fix_heading_rad is not None:
        check = _compare(check, fix_heading_rad, heading_rad)
    placed = place(state.history, position) if position is not None else None
    if placed is not None:
        state, check = _take_position(state, placed, check)
    state = state._replace(check=check)
    if check is HeadingCheck.CONFIRMED:
        return state._replace(history=(), start=None), Watch(0)
    contradicted = check is HeadingCheck.CONTRADICTED
    return state, Watch.HEADING_CONTRADICTED if contradicted else Watch.HEADING_UNCONFIRMED


def _take_position(
    state: HeadingWatchState, placed: Placed, check: HeadingCheck
) -> tuple[HeadingWatchState, HeadingCheck]:
    """What a position at the end of a course says; after each the next course begins."""
    start, anew = state.start, state._replace(start=placed, farthest_m=0.0)
    if start is None or not 0.0 <= placed.position.time_s - start.position.time_s <= LONGEST_S:
        return anew, check
    travel_m = placed.wheeled.odometer_m - start.wheeled.odometer_m
    if abs(travel_m) < state.farthest_m - 0.1:
        return anew, check
    sigma_m = max(start.position.sigma_m, placed.position.sigma_m)
    if abs(travel_m) < max(TRAVEL_M, TRAVEL_SIGMAS * sigma_m):
        return state._replace(farthest_m=max(state.farthest_m, abs(travel_m))), check
    east_m, north_m = placed.position.x_m - start.position.x_m, placed.position.y_m - start.position.y_m
    if abs(math.hypot(east_m, north_m) - abs(travel_m)) > TRAVEL_SHARE * abs(travel_m):
        return anew, check
    sign = math.copysign(1.0, travel_m)
    course = math.atan2(sign * north_m, sign * east_m)
    turned = wrap_rad(placed.wheeled.heading_rad - start.wheeled.heading_rad)
    return anew, _compare(check, course, start.wheeled.heading_rad + 0.5 * turned)


def _compare(check: HeadingCheck, course_rad: float, heading_rad: float) -> HeadingCheck:
    """What is known after a course; one between, or no number, tells nothing new."""
    apart = abs(wrap_rad(course_rad - heading_rad))
    if apart <= AGREES_RAD:
        return HeadingCheck.CONFIRMED
    return HeadingCheck.CONTRADICTED if apart > CONTRADICTS_RAD else check
