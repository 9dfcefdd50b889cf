"""The odometer against GNSS and against what a vehicle can do: dead, reversed, slipping. Fault 14.

Above 1 m/s an odometer that dies, or turns its sign, makes a leap of speed that no brake makes: found within 0.1 s.
Slower, or where wheels slip, it is held against the way by GNSS over up to a second, less the one leg that differs
most: a leap of GNSS is no fault of the odometer.
"""

import math
from typing import NamedTuple

from lgprjax.autopilot.watch_dwell import Dwell, counted_step_s, step_dwell
from lgprjax.autopilot.watch_findings import Watch, as_watch
from lgprjax.autopilot.watch_ground import Leg, Placed, Position, Wheeled, leg_between, place, remember

WINDOW_S = 1.05
FEWEST_LEGS = 3
OFF_M, OFF_SIGMAS, OFF_SHARE = 0.25, 3.0, 0.1
"""GNSS and odometer may differ over a window by: what GNSS wanders, its own sigmas, a share of the way."""
LEAP_MPS = 1.0
LEAP_TICKS = 5
"""A change of speed within so many ticks that no brake makes."""
FOUND_S = 0.04
THRUST_MPS2 = 1.5
"""A throttle that pushes harder than the steepest slope holds, for ``PUSHED_S``, moves the vehicle."""
PUSHED_S = 1.0
STANDING_MPS = 0.1
BLIND_S = 0.6
"""Without a leg of GNSS for so long a bad odometer leaves no speed at all."""


_NOTHING = Watch(0)


class OdometerWatchState(NamedTuple):
    """What is carried from tick to tick.

    Attributes:
        history: odometer and heading of the last while.
        speeds_mps: of the last ticks, oldest first.
        last: the newest position.
        legs: of the window.
        verdict: of the newest window.
        time_s: of the newest tick, which never goes back.
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
    position: Position | None,
    thrust_mps2: float,
    step_s: float,
) -> tuple[OdometerWatchState, Watch]:
    """State and findings of a tick.

    Args:
        state: of the last tick.
        time_s: of this tick; positions hold for times on the same clock.
        odometer_m, speed_mps: signed, by the wheels.
        heading_rad: counter-clockwise from x.
        heading_confirmed: by ``watch_heading``; before, a sign that differs may be the heading's fault.
        position: a new one by GNSS; None where none came.
        thrust_mps2: what the throttle makes of its command, from ``watch_pedals``; 0 where a person drives.
        step_s: since the last tick.
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
    state = OdometerWatchState(history, speeds, last, legs, verdict, time_s, dead, turned, slips, pushed, unknown)
    bits = (
        dead.on * Watch.ODOMETER_DEAD
        | turned.on * Watch.ODOMETER_REVERSED
        | slips.on * Watch.ODOMETER_SLIPS
        | unknown.on * Watch.SPEED_UNKNOWN
    )
    return state, as_watch(bits)


def _window(legs: tuple[Leg, ...], leg: Leg | None) -> tuple[Leg, ...]:
    """Legs with one more; none where the way was broken."""
    return (*(one for one in legs if one.time_s > leg.time_s - WINDOW_S), leg) if leg is not None else ()


def _judge(legs: tuple[Leg, ...], heading_confirmed: bool) -> Watch:
    """What the legs say of the odometer."""
    if len(legs) < FEWEST_LEGS:
        return _NOTHING
    forward_m, travel_m = sum(leg.forward_m for leg in legs), sum(leg.travel_m for leg in legs)
    sign = -1.0 if not heading_confirmed and forward_m * travel_m < 0.0 else 1.0
    errors = [sign * leg.forward_m - leg.travel_m for leg in legs]
    off_m = abs(sum(errors) - max(errors, key=abs))
    bound_m = OFF_M + OFF_SIGMAS * max(leg.sigma_m for leg in legs)
    if off_m <= bound_m + OFF_SHARE * max(abs(forward_m), abs(travel_m)):
        return _NOTHING
    # What it is shows in the newest legs: the oldest may have been sound.
    forward_m = sign * sum(leg.forward_m for leg in legs[-FEWEST_LEGS + 1 :])
    travel_m = sum(leg.travel_m for leg in legs[-FEWEST_LEGS + 1 :])
    return _kind(forward_m, travel_m)


def _leap(then_mps: float, now_mps: float) -> Watch:
    """What a leap of the speed says; nothing where there was none or either is no number."""
    return _kind(then_mps, now_mps) if abs(now_mps - then_mps) > LEAP_MPS else _NOTHING


def _kind(true: float, told: float) -> Watch:
    """What an odometer is that tells a way or a speed instead of the true one."""
    if abs(told) < 0.25 * abs(true):
        return Watch.ODOMETER_DEAD
    return Watch.ODOMETER_REVERSED if true * told < 0.0 else Watch.ODOMETER_SLIPS
