"""Monitors of position and heading: GNSS, odometer and gyro compared with each other over ground.

A position is compared with the odometer at its time of validity, up to half a second ago.
"""

import math
from enum import Enum, auto
from typing import NamedTuple

from lgprjax.autopilot.monitors import Dwell, Watch, as_watch, counted_step_s, step_dwell, wrap_rad

REMEMBERED_S = 0.6
FASTEST_MPS = 12.0
LEAP_M = 0.5
"""Positions further apart than the fastest vehicle travels, plus this, are a jump of GNSS."""
STUCK_M = 1e-4
"""A receiver that repeats its position exactly is not used; health reports it."""
APART_S = 0.6
"""Positions further apart in time are not compared."""


class MonitoredPosition(NamedTuple):
    """A new position by GNSS.

    Attributes:
        time_s: time of validity, on the clock of the ticks.
        x_m, y_m: position in any fixed level frame.
        sigma_m: standard deviation per axis stated by the receiver.
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
    """Motion between two positions.

    Attributes:
        time_s: time of its end.
        forward_m: travel along the heading by GNSS.
        travel_m: travel by odometer.
        sigma_m: larger standard deviation of the two positions.
    """

    time_s: float
    forward_m: float
    travel_m: float
    sigma_m: float


class Placed(NamedTuple):
    """A position, and the wheels' reading at its time."""

    position: MonitoredPosition
    wheeled: Wheeled


def remember(history: tuple[Wheeled, ...], now: Wheeled) -> tuple[Wheeled, ...]:
    """The recent readings plus one; empty if the odometer is NaN."""
    if not math.isfinite(now.odometer_m):
        return ()
    history = (*history, now)
    return history[1:] if history[0].time_s < now.time_s - REMEMBERED_S else history


def place(history: tuple[Wheeled, ...], position: MonitoredPosition) -> Placed | None:
    """A position with the wheels' reading at its time; None if they do not reach back or it is NaN."""
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
    """The leg between two; None if GNSS jumped, stuck or paused, or there is no heading."""
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


# Whether the heading is the direction in which the vehicle drives, or its opposite. Fault 9.

TRAVEL_M = 1.5
TRAVEL_SIGMAS = 10.0
"""Least length of a course, in metres and in sigmas of its positions."""
TRAVEL_SHARE = 0.3
"""Allowed difference between the distances of GNSS and of the odometer over a course."""
JUMP_SIGMAS = 3.0
"""Difference allowed from one position to the next, in addition to ``LEAP_M``; a jump begins a new course."""
AGREES_RAD = math.radians(30.0)
CONTRADICTS_RAD = math.radians(90.0)
LONGEST_S = 20.0
"""A start older than this is dropped: GNSS drifts."""


class HeadingCheck(Enum):
    """Status of the heading."""

    UNCONFIRMED = auto()
    CONFIRMED = auto()
    CONTRADICTED = auto()


class HeadingWatchState(NamedTuple):
    """State between ticks.

    Attributes:
        check: present status.
        history: recent odometer and heading.
        start: start of the course.
        last: newest position.
        farthest_m: largest distance from the start by odometer; turning back restarts.
        time_s: time of the newest tick.
    """

    check: HeadingCheck = HeadingCheck.UNCONFIRMED
    history: tuple[Wheeled, ...] = ()
    start: Placed | None = None
    last: Placed | None = None
    farthest_m: float = 0.0
    time_s: float = -math.inf


def step_heading_watch(
    state: HeadingWatchState,
    *,
    time_s: float,
    odometer_m: float,
    heading_rad: float,
    position: MonitoredPosition | None,
    fix_heading_rad: float | None,
) -> tuple[HeadingWatchState, Watch]:
    """State and findings of a tick.

    A confirmed heading stays confirmed until the watch is restarted, as required when the INS restarts; a sign that
    changes later is attributed to the odometer.

    Args:
        state: state of the last tick.
        time_s: time of this tick; positions hold for times on the same clock.
        odometer_m: signed distance.
        heading_rad: heading counter-clockwise from x.
        position: new GNSS position; ``None`` without one.
        fix_heading_rad: heading of a new LGPR fix with code ``ok``; ``None`` without one.
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
        return state._replace(history=(), start=None, last=None), Watch(0)
    contradicted = check is HeadingCheck.CONTRADICTED
    return state, Watch.HEADING_CONTRADICTED if contradicted else Watch.HEADING_UNCONFIRMED


def _take_position(
    state: HeadingWatchState, placed: Placed, check: HeadingCheck
) -> tuple[HeadingWatchState, HeadingCheck]:
    """Evaluate a position at the end of a course; then the next course begins."""
    start, last, anew = state.start, state.last, state._replace(start=placed, last=placed, farthest_m=0.0)
    if start is None or last is None or not 0.0 <= placed.position.time_s - start.position.time_s <= LONGEST_S:
        return anew, check
    if _jumped(last, placed):
        return anew, check
    state = state._replace(last=placed)
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


def _jumped(last: Placed, now: Placed) -> bool:
    """Whether GNSS moved otherwise than the wheels: back by twice the course, it would seem to be driven in reverse."""
    gnss_m = math.hypot(now.position.x_m - last.position.x_m, now.position.y_m - last.position.y_m)
    travel_m = abs(now.wheeled.odometer_m - last.wheeled.odometer_m)
    noise_m = JUMP_SIGMAS * math.hypot(last.position.sigma_m, now.position.sigma_m)
    return abs(gnss_m - travel_m) > LEAP_M + noise_m


def _compare(check: HeadingCheck, course_rad: float, heading_rad: float) -> HeadingCheck:
    """Status after a course; an undecided one, or NaN, changes nothing."""
    apart = abs(wrap_rad(course_rad - heading_rad))
    if apart <= AGREES_RAD:
        return HeadingCheck.CONFIRMED
    return HeadingCheck.CONTRADICTED if apart > CONTRADICTS_RAD else check


# The odometer compared with GNSS and with a vehicle's limits: dead, reversed, slipping. Fault 14.
#
# Above 1 m/s an odometer that dies, or turns its sign, makes a jump of speed that no brake makes: found within 0.1 s.
# Slower, or with slipping wheels, it is compared with the distance by GNSS over up to a second, without the one leg
# that differs most: a jump of GNSS is no fault of the odometer.

WINDOW_S = 1.05
FEWEST_LEGS = 3
OFF_M, OFF_SIGMAS, OFF_SHARE = 0.25, 3.0, 0.1
"""Allowed difference of GNSS and odometer over a window: drift of GNSS, its own sigmas, a share of the distance."""
LEAP_MPS = 1.0
LEAP_TICKS = 5
"""A change of speed within this many ticks that no brake makes."""
FOUND_S = 0.04
THRUST_MPS2 = 1.5
"""A throttle that pushes harder than the steepest slope holds, for ``PUSHED_S``, moves the vehicle."""
PUSHED_S = 1.0
STANDING_MPS = 0.1
BLIND_S = 0.6
"""Time without a leg of GNSS after which a bad odometer leaves no speed at all."""


_NOTHING = Watch(0)


class OdometerWatchState(NamedTuple):
    """State between ticks.

    Attributes:
        history: recent odometer and heading.
        speeds_mps: speeds of the last ticks, oldest first.
        last: newest position.
        legs: legs of the window.
        verdict: verdict of the newest window.
        time_s: time of the newest tick, never decreasing.
        dead, reversed, slips, pushed, blind: findings.
    """

    history: tuple[Wheeled, ...] = ()
    speeds_mps: tuple[float, ...] = ()
    last: Placed | None = None
    legs: tuple[Leg, ...] = ()
    verdict: Watch = _NOTHING
    time_s: float = -math.inf
    dead: Dwell = Dwell()
    reversed: Dwell = Dwell()
    slips: Dwell = Dwell()
    pushed: Dwell = Dwell()
    blind: Dwell = Dwell()


def step_odometer_watch(
    state: OdometerWatchState,
    *,
    time_s: float,
    odometer_m: float,
    speed_mps: float,
    heading_rad: float,
    heading_confirmed: bool,
    position: MonitoredPosition | None,
    thrust_mps2: float,
    step_s: float,
) -> tuple[OdometerWatchState, Watch]:
    """State and findings of a tick.

    Args:
        state: state of the last tick.
        time_s: time of this tick; positions hold for times on the same clock.
        odometer_m, speed_mps: signed distance and speed by the wheels.
        heading_rad: heading counter-clockwise from x.
        heading_confirmed: whether ``step_heading_watch`` confirmed the heading; before, a wrong sign may be due to it.
        position: new GNSS position; ``None`` without one.
        thrust_mps2: acceleration by the throttle, from the pedals' monitor; 0 if a person drives.
        step_s: time since the last tick.
    """
    step_s = counted_step_s(step_s)
    known = math.isfinite(odometer_m) and math.isfinite(speed_mps)
    time_s = time_s if time_s > state.time_s else state.time_s
    history = remember(state.history, Wheeled(time_s, odometer_m, heading_rad))
    last, legs, verdict = state.last, state.legs, state.verdict
    placed = place(history, position) if position is not None else None
    if placed is not None:
        leg = leg_between(last, placed) if last is not None else None
        last, legs = placed, _window(legs, leg)
        verdict = _judge(legs, heading_confirmed) if leg is not None else verdict
    speeds = (*state.speeds_mps[-LEAP_TICKS:], speed_mps)
    leap = _leap(speeds[0], speed_mps)
    thrusts = thrust_mps2 > THRUST_MPS2 and not abs(speed_mps) > STANDING_MPS
    pushed = step_dwell(state.pushed, thrusts, step_s, on_s=PUSHED_S)
    kinds = (verdict, leap)
    dead = step_dwell(state.dead, not known or pushed.on or Watch.ODOMETER_DEAD in kinds, step_s, on_s=FOUND_S)
    turned = step_dwell(state.reversed, Watch.ODOMETER_REVERSED in kinds, step_s, on_s=FOUND_S)
    slips = step_dwell(state.slips, Watch.ODOMETER_SLIPS in kinds, step_s, on_s=FOUND_S)
    bad = dead.on or turned.on or slips.on
    blind = not legs or time_s - legs[-1].time_s > BLIND_S
    unknown = step_dwell(state.blind, bad and blind, step_s, on_s=FOUND_S)
    state = OdometerWatchState(
        history=history,
        speeds_mps=speeds,
        last=last,
        legs=legs,
        verdict=verdict,
        time_s=time_s,
        dead=dead,
        reversed=turned,
        slips=slips,
        pushed=pushed,
        blind=unknown,
    )
    bits = (
        dead.on * Watch.ODOMETER_DEAD
        | turned.on * Watch.ODOMETER_REVERSED
        | slips.on * Watch.ODOMETER_SLIPS
        | unknown.on * Watch.SPEED_UNKNOWN
    )
    return state, as_watch(bits)


def _window(legs: tuple[Leg, ...], leg: Leg | None) -> tuple[Leg, ...]:
    """Legs plus one; empty if the track was interrupted."""
    return (*(one for one in legs if one.time_s > leg.time_s - WINDOW_S), leg) if leg is not None else ()


def _judge(legs: tuple[Leg, ...], heading_confirmed: bool) -> Watch:
    """Verdict of the legs on the odometer."""
    if len(legs) < FEWEST_LEGS:
        return _NOTHING
    forward_m, travel_m = sum(leg.forward_m for leg in legs), sum(leg.travel_m for leg in legs)
    sign = -1.0 if not heading_confirmed and forward_m * travel_m < 0.0 else 1.0
    errors = [sign * leg.forward_m - leg.travel_m for leg in legs]
    off_m = abs(sum(errors) - max(errors, key=abs))
    bound_m = OFF_M + OFF_SIGMAS * max(leg.sigma_m for leg in legs)
    if off_m <= bound_m + OFF_SHARE * max(abs(forward_m), abs(travel_m)):
        return _NOTHING
    # The newest legs show its kind: the oldest may have been good.
    forward_m = sign * sum(leg.forward_m for leg in legs[-FEWEST_LEGS + 1 :])
    travel_m = sum(leg.travel_m for leg in legs[-FEWEST_LEGS + 1 :])
    return _kind(forward_m, travel_m)


def _leap(then_mps: float, now_mps: float) -> Watch:
    """Verdict of a jump of the speed; None without one, or if either speed is NaN."""
    return _kind(then_mps, now_mps) if abs(now_mps - then_mps) > LEAP_MPS else _NOTHING


def _kind(true: float, measured: float) -> Watch:
    """Kind of odometer fault, from a measured and a true distance or speed."""
    if abs(measured) < 0.25 * abs(true):
        return Watch.ODOMETER_DEAD
    return Watch.ODOMETER_REVERSED if true * measured < 0.0 else Watch.ODOMETER_SLIPS
