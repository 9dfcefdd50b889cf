"""Throttle and brake against their commands, and the speed against both. Faults 21 and 22.

Positions are held against the commands of the last quarter of a second or so, which is what an actuator may take. The
speed is held against a model of the pedals through an observer that learns what slopes and calibration add: a push
that is not the pedals' shows as a speed ahead of it.
"""

import math
from typing import NamedTuple

from lgprjax.autopilot.watch_belief import PedalBelief, PedalsBelief
from lgprjax.autopilot.watch_dwell import Dwell, counted_step_s, step_dwell
from lgprjax.autopilot.watch_findings import Watch, as_watch

ANSWER_TICKS = 13
"""Commands of the last quarter of a second: a position is between them, or on its way."""
OPEN = 0.1
"""A throttle more open than any of these commands, for ``OPEN_S``, is stuck: found within 0.5 s."""
OPEN_S = 0.14
PRESSED = 0.1
HELD_SHARE = 0.4
DEAD_S = 0.04
"""A brake told ``PRESSED`` or more throughout, whose pressure is a smaller share of it, is dead: found within 0.3 s."""
UNREAD_S = 0.1
RISE_MPS = 0.3
RISE_S = 0.06
"""With a stuck throttle the speed may not rise by more."""
AHEAD_MPS = 0.35
AHEAD_S = 0.06
"""Speed ahead of the model by more: a push of 1.2 m/s², a slope of 12 %, that came at once, after half a second."""
BRAKING_MPS2 = 0.5
"""While the brake should make more, a push that is not the pedals' is a brake without effect."""
ROLLING_MPS = 0.3
LEARN_S = 1.5
"""After moving off or engaging: what the observer needs to learn the slope."""
LEAP_MPS = 0.25
"""Change of the speed within a tick that no throttle makes: wheels that slip, or an odometer at fault."""
SPEED_PER_S, PUSH_PER_S2 = 2.0, 2.0
"""Gains of the observer: damped by 0.7, at 1.4 rad/s."""


class PedalModel(NamedTuple):
    """A pedal as in ``vehicle.PedalState``: how far it acts, and the acceleration or deceleration that it makes."""

    pressed: float = 0.0
    effect_mps2: float = 0.0


class Observer(NamedTuple):
    """Speed that the model expects and speed as heard in the last tick, what pushes beside the pedals, and for how
    long the vehicle has rolled, engaged."""

    expected_mps: float = 0.0
    heard_mps: float = 0.0
    push_mps2: float = 0.0
    rolled_s: float = 0.0


class PedalWatchState(NamedTuple):
    """What is carried from tick to tick.

    Attributes:
        throttles, brakes: commands of the last ticks.
        throttle, brake: of the model.
        observer: of the speed.
        lowest_mps: since the throttle was found stuck.
        open, dead, ahead, unbraked, unread, rises: findings.
    """

    throttles: tuple[float, ...] = ()
    brakes: tuple[float, ...] = ()
    throttle: PedalModel = PedalModel()
    brake: PedalModel = PedalModel()
    observer: Observer = Observer()
    lowest_mps: float = math.inf
    open: Dwell = Dwell()
    dead: Dwell = Dwell()
    ahead: Dwell = Dwell()
    unbraked: Dwell = Dwell()
    unread: Dwell = Dwell()
    rises: Dwell = Dwell()


class PedalReading(NamedTuple):
    """Throttle and brake, 0 to 1: as sent, or as measured."""

    throttle: float
    brake: float


def step_pedal_watch(
    belief: PedalsBelief,
    state: PedalWatchState,
    *,
    engaged: bool,
    command: PedalReading,
    measured: PedalReading,
    speed_mps: float,
    speed_trusted: bool,
    step_s: float,
) -> tuple[PedalWatchState, Watch]:
    """State and findings of a tick; ``throttle.effect_mps2`` of the state is what the odometer's watch asks for.

    Args:
        belief: both pedals.
        state: of the last tick.
        engaged: the box holds the pedals engaged.
        command: as sent in the last tick.
        measured: positions; while a person drives they stand for the command.
        speed_mps: signed.
        speed_trusted: nothing is wrong with the odometer.
        step_s: since the last tick.
    """
    step_s = counted_step_s(step_s)
    unread = step_dwell(
        state.unread, not (math.isfinite(measured.throttle) and math.isfinite(measured.brake)), step_s, on_s=UNREAD_S
    )
    acting = command if engaged else measured
    throttle = _press(belief.throttle, state.throttle, acting.throttle, step_s)
    brake = _press(belief.brake, state.brake, acting.brake, step_s)
    pushed_mps2 = throttle.effect_mps2 - brake.effect_mps2 - belief.rolling_mps2
    observer, ahead_mps = _observe(
        state.observer, pushed_mps2, belief.drag_per_s, speed_mps, engaged=engaged, trusted=speed_trusted, step_s=step_s
    )
    throttles = (*state.throttles[-ANSWER_TICKS:], command.throttle) if engaged else ()
    brakes = (*state.brakes[-ANSWER_TICKS:], command.brake) if engaged else ()
    answered = len(brakes) > ANSWER_TICKS
    opens = answered and not measured.throttle <= max(throttles) + OPEN
    pressed = min(brakes) if answered else 0.0
    fails = pressed >= PRESSED and not measured.brake >= HELD_SHARE * pressed
    brakes_now = brake.effect_mps2 > BRAKING_MPS2
    too_fast = ahead_mps > AHEAD_MPS
    opened = step_dwell(state.open, opens, step_s, on_s=OPEN_S)
    dead = step_dwell(state.dead, fails, step_s, on_s=DEAD_S)
    ahead = step_dwell(state.ahead, too_fast and not brakes_now, step_s, on_s=AHEAD_S)
    stuck = opened.on or ahead.on
    # A throttle that is known to push against the brake says nothing of the brake.
    unbraked = step_dwell(state.unbraked, too_fast and brakes_now and not stuck, step_s, on_s=AHEAD_S)
    lowest = _lower(state.lowest_mps, abs(speed_mps)) if stuck else math.inf
    rises = step_dwell(state.rises, stuck and abs(speed_mps) > lowest + RISE_MPS, step_s, on_s=RISE_S)
    state = PedalWatchState(
        throttles, brakes, throttle, brake, observer, lowest, opened, dead, ahead, unbraked, unread, rises
    )
    bits = (
        stuck * Watch.THROTTLE_STUCK
        | (dead.on or unbraked.on) * Watch.BRAKE_DEAD
        | unread.on * Watch.PEDAL_UNREAD
        | rises.on * Watch.SPEED_RISES
    )
    return state, as_watch(bits)


def _lower(lowest_mps: float, speed_mps: float) -> float:
    """The lower speed; no number changes nothing."""
    return speed_mps if speed_mps < lowest_mps else lowest_mps


def _observe(
    observer: Observer,
    pushed_mps2: float,
    drag_per_s: float,
    speed_mps: float,
    *,
    engaged: bool,
    trusted: bool,
    step_s: float,
) -> tuple[Observer, float]:
    """The observer after a tick, and by how much the speed is ahead of it: 0 where it cannot tell."""
    speed = abs(speed_mps)
    if not (trusted and speed > ROLLING_MPS):
        known = speed if math.isfinite(speed) else 0.0
        return Observer(known, known), 0.0
    if abs(speed - observer.heard_mps) > LEAP_MPS:
        return observer._replace(expected_mps=speed, heard_mps=speed), 0.0
    expected = observer.expected_mps + (pushed_mps2 - drag_per_s * speed + observer.push_mps2) * step_s
    ahead = speed - expected
    rolled_s = observer.rolled_s + step_s if engaged else 0.0
    observer = Observer(
        expected + SPEED_PER_S * step_s * ahead, speed, observer.push_mps2 + PUSH_PER_S2 * step_s * ahead, rolled_s
    )
    return observer, ahead if rolled_s > LEARN_S else 0.0


def _press(belief: PedalBelief, pedal: PedalModel, position: float, step_s: float) -> PedalModel:
    """A pedal after a tick at a position; it stays where that is no number."""
    if not math.isfinite(position):
        return pedal
    taut = position - belief.pre_tension
    pressed = max(min(max(pedal.pressed, taut), taut + belief.dead_zone), 0.0)
    wanted = belief.gain_mps2 * pressed
    left = math.exp(-step_s / belief.lag_s) if belief.lag_s > 0.0 else 0.0
    return PedalModel(pressed, wanted + left * (pedal.effect_mps2 - wanted))
