"""Positions by GNSS beside the way by odometer: what both watches of the way over ground compare.

A position is held against the odometer at the time for which it holds, which is up to half a second ago.
"""

import math
from typing import NamedTuple

from lgprjax.autopilot.watch_dwell import wrap_rad

REMEMBERED_S = 0.6
FASTEST_MPS = 12.0
LEAP_M = 0.5
"""Positions further apart than the fastest vehicle goes, and this, are a leap of GNSS."""
STUCK_M = 1e-4
"""A receiver that repeats its position exactly says nothing; health tells of it."""
APART_S = 0.6
"""Positions further apart in time are not compared."""


class Position(NamedTuple):
    """A new position by GNSS.

    Attributes:
        time_s: for which it holds, on the clock of the ticks.
        x_m, y_m: in any level frame that stays.
        sigma_m: an axis, as the receiver says.
    """

    time_s: float
    x_m: float
    y_m: float
    sigma_m: float


class Wheeled(NamedTuple):
    """Odometer, m, and heading, rad counter-clockwise from x, at a time."""

    time_s: float
    odometer_m: float
    heading_rad: float


class Leg(NamedTuple):
    """From one position to the next.

    Attributes:
        time_s: at its end.
        forward_m: way along the heading by GNSS.
        travel_m: way by odometer.
        sigma_m: of either position, the larger.
    """

    time_s: float
    forward_m: float
    travel_m: float
    sigma_m: float


class Placed(NamedTuple):
    """A position, and what the wheels said then."""

    position: Position
    wheeled: Wheeled


def remember(history: tuple[Wheeled, ...], now: Wheeled) -> tuple[Wheeled, ...]:
    """The readings of the last while with one more; none where the odometer is no number."""
    if not math.isfinite(now.odometer_m):
        return ()
    history = (*history, now)
    return history[1:] if history[0].time_s < now.time_s - REMEMBERED_S else history


def place(history: tuple[Wheeled, ...], position: Position) -> Placed | None:
    """A position with the wheels' reading at its time; none where they do not reach so far back or it is no number."""
    if not all(map(math.isfinite, position)):
        return None
    at_s = position.time_s
    for before, after in zip(reversed(history[:-1]), reversed(history[1:]), strict=True):
        if before.time_s <= at_s <= after.time_s:
            span_s = after.time_s - before.time_s
            share = (at_s - before.time_s) / span_s if span_s > 0.0 else 0.0
            turned = wrap_rad(after.heading_rad - before.heading_rad)
            odometer_m = before.odometer_m + share * (after.odometer_m - before.odometer_m)
            return Placed(position, Wheeled(at_s, odometer_m, before.heading_rad + share * turned))
    return None


def leg_between(start: Placed, end: Placed) -> Leg | None:
    """The way from one to the other; none where GNSS leapt, stuck or paused, or there is no heading."""
    first, last = start.position, end.position
    duration_s = last.time_s - first.time_s
    east_m, north_m = last.x_m - first.x_m, last.y_m - first.y_m
    way_m = math.hypot(east_m, north_m)
    turned = wrap_rad(end.wheeled.heading_rad - start.wheeled.heading_rad)
    heading = start.wheeled.heading_rad + 0.5 * turned
    leaps = way_m > FASTEST_MPS * duration_s + LEAP_M
    if not 0.0 < duration_s <= APART_S or leaps or way_m < STUCK_M or not math.isfinite(heading):
        return None
    forward_m = math.cos(heading) * east_m + math.sin(heading) * north_m
    travel_m = end.wheeled.odometer_m - start.wheeled.odometer_m
    return Leg(last.time_s, forward_m, travel_m, max(first.sigma_m, last.sigma_m))
