"""The steering servo against its command: weak, stalled, running away, or short of supply. Faults 17 and 18.

A model of the servo as it is believed (delay, dead band, lag, rate, play) follows the commands; wheels that lag behind
it by more than timing and calibration explain are slow. A runaway needs no model: wheels that move away from every
command that could act on them now. Neither is judged before the servo has had time to answer to its first command
after engaging; until then the model follows the wheels.
"""

import math
from typing import NamedTuple

from lgprjax.autopilot.watch_belief import WheelBelief
from lgprjax.autopilot.watch_dwell import Dwell, beyond, counted_step_s, step_dwell
from lgprjax.autopilot.watch_findings import Watch, as_watch
from lgprjax.autopilot.watch_wheel_sensors import WheelAngles

LAG_RAD = 0.045
"""Wheels behind the model by more: 30 ms of wrong timing at full rate and a sag of the supply of 50 ms are less."""
WEAK_S = 0.2
WEAK_OFF_S = 5.0
STALL_RAD = 0.01
"""Wheels that have moved by less, for ``STALL_S`` behind the model, stand."""
STALL_S = 0.3
LOST_RAD = 0.2
LOST_S = 0.1
"""So far behind for so long: no look-ahead mends it."""
SUPPLY_SHARE = 0.6
"""Of the way from the stall voltage to the nominal one: below it the supply is low."""
SUPPLY_S = 0.2
AWAY_RAD = 0.02
AWAY_TICKS = 4
"""Wheels that moved away from their commands by more within so many ticks (0.25 rad/s) run away."""
AWAY_S = 0.04
LIMIT_RAD = 0.03
"""Wheels beyond their largest angle by more run away too."""
LATE_S = 0.06
"""Commands that may act now are those since the servo's delay, and so much more, ago."""
ANSWER_S = 0.1
"""Beside its delay: what a servo has to answer to the first command after engaging."""


class Sent(NamedTuple):
    """A command with the time at which it was sent."""

    time_s: float
    front_rad: float


class ServoWatchState(NamedTuple):
    """What is carried from tick to tick.

    Attributes:
        time_s: sum of the ticks.
        engaged_s: for so long the servo has been engaged.
        sent: commands that act or will, oldest first.
        motor_rad, wheel_rad: of the model.
        wheels: last ticks' angles, oldest first.
        stalled_rad: wheels where they last moved behind the model; not a number while they follow.
        weak, stalled, lost, supply, away: findings.
    """

    time_s: float = 0.0
    engaged_s: float = 0.0
    sent: tuple[Sent, ...] = ()
    motor_rad: float = math.nan
    wheel_rad: float = math.nan
    wheels: tuple[WheelAngles, ...] = ()
    stalled_rad: float = math.nan
    weak: Dwell = Dwell()
    stalled: Dwell = Dwell()
    lost: Dwell = Dwell()
    supply: Dwell = Dwell()
    away: Dwell = Dwell()


def step_servo_watch(
    belief: WheelBelief,
    state: ServoWatchState,
    wheels: WheelAngles,
    supply_v: float,
    *,
    engaged: bool,
    command_rad: float,
    step_s: float,
) -> tuple[ServoWatchState, Watch]:
    """State and findings of a tick.

    Args:
        belief: the servo.
        state: of the last tick.
        wheels: as measured now.
        supply_v: of the servo.
        engaged: the box holds the steering engaged.
        command_rad: as sent in the last tick.
        step_s: since the last tick.
    """
    step_s = counted_step_s(step_s)
    time_s = state.time_s + step_s
    engaged_s = state.engaged_s + step_s if engaged else 0.0
    # Without the potentiometer, which is a finding of its own, the encoder still tells whether the wheels turn.
    measured = wheels.front_rad if math.isfinite(wheels.front_rad) else wheels.encoder_rad
    low = belief.stall_v + SUPPLY_SHARE * (belief.nominal_v - belief.stall_v)
    supply = step_dwell(state.supply, not supply_v >= low, step_s, on_s=SUPPLY_S)
    recent = (*state.wheels[-AWAY_TICKS:], wheels)
    if engaged_s <= belief.delay_s + ANSWER_S:
        # What was sent while the servo was free acts no more; what was sent since is awaited.
        sent = (*state.sent, Sent(state.time_s, command_rad)) if engaged and math.isfinite(measured) else ()
        state = state._replace(time_s=time_s, engaged_s=engaged_s, sent=sent, motor_rad=measured, wheel_rad=measured)
        state = state._replace(wheels=recent, stalled_rad=math.nan, supply=supply)
        return _settle(state, behind=False, stands=False, lost=False, away=False, step_s=step_s)

    sent = (*state.sent, Sent(state.time_s, command_rad))
    while len(sent) > 1 and sent[1].time_s <= time_s - belief.delay_s - LATE_S:
        sent = sent[1:]
    motor, wheel = _follow(belief, state, _acting(sent, time_s - belief.delay_s), step_s)
    error = measured - wheel
    behind = beyond(error, LAG_RAD) or not math.isfinite(command_rad)
    stalled = state.stalled_rad
    moves = beyond(measured - stalled, STALL_RAD)
    if moves or not behind:
        stalled = measured if behind else math.nan
    state = ServoWatchState(
        time_s,
        engaged_s,
        sent,
        motor,
        wheel,
        recent,
        stalled,
        state.weak,
        state.stalled,
        state.lost,
        supply,
        state.away,
    )
    return _settle(
        state,
        behind=behind,
        stands=behind and not moves,
        lost=beyond(error, LOST_RAD),
        away=_runs_away(sent, recent) or abs(measured) > belief.largest_rad + LIMIT_RAD,
        step_s=step_s,
    )


def _settle(
    state: ServoWatchState, *, behind: bool, stands: bool, lost: bool, away: bool, step_s: float
) -> tuple[ServoWatchState, Watch]:
    """Findings of what holds in this tick."""
    state = state._replace(
        weak=step_dwell(state.weak, behind, step_s, on_s=WEAK_S, off_s=WEAK_OFF_S),
        stalled=step_dwell(state.stalled, stands, step_s, on_s=STALL_S),
        lost=step_dwell(state.lost, lost, step_s, on_s=LOST_S),
        away=step_dwell(state.away, away, step_s, on_s=AWAY_S),
    )
    bits = (
        state.weak.on * Watch.SERVO_WEAK
        | (state.stalled.on or state.lost.on) * Watch.SERVO_DEAD
        | state.supply.on * Watch.SUPPLY_LOW
        | state.away.on * Watch.STEERING_RUNAWAY
    )
    return state, as_watch(bits)


def _acting(sent: tuple[Sent, ...], until_s: float) -> float:
    """The newest command sent until a time; the oldest known where none was."""
    return next((command.front_rad for command in reversed(sent) if command.time_s <= until_s), sent[0].front_rad)


def _follow(belief: WheelBelief, state: ServoWatchState, target_rad: float, step_s: float) -> tuple[float, float]:
    """Motor and wheels of the model after a tick; they stay where the target is no number."""
    largest = belief.largest_rad
    wrong = min(max(target_rad, -largest), largest) - state.motor_rad
    wrong -= min(max(wrong, -belief.dead_band_rad), belief.dead_band_rad)
    turn = wrong * (1.0 - math.exp(-step_s / belief.lag_s)) if belief.lag_s > 0.0 else wrong
    most = belief.rate_radps * step_s
    motor = state.motor_rad + min(max(turn, -most), most) if math.isfinite(target_rad) else state.motor_rad
    play = 0.5 * belief.backlash_rad
    return motor, min(max(state.wheel_rad, motor - play), motor + play)


def _runs_away(sent: tuple[Sent, ...], recent: tuple[WheelAngles, ...]) -> bool:
    """Whether the wheels have left all commands that may act, by potentiometer and encoder alike where both tell."""
    before, now = recent[0], recent[-1]
    turned = beyond(now.front_rad - before.front_rad, AWAY_RAD)
    if not (turned and beyond(now.encoder_rad - before.encoder_rad, AWAY_RAD)):
        return False
    commands = [command.front_rad for command in sent if math.isfinite(command.front_rad)]
    if not commands:
        return False
    ways = [
        _away(then_rad, now_rad, min(commands), max(commands))
        for then_rad, now_rad in zip(before, now, strict=True)
        if math.isfinite(then_rad) and math.isfinite(now_rad)
    ]
    return bool(ways) and (min(ways) > AWAY_RAD or max(ways) < -AWAY_RAD)


def _away(then_rad: float, now_rad: float, low_rad: float, high_rad: float) -> float:
    """How far a wheel moved out of a range, signed; 0 within it or towards it."""
    return max(now_rad - max(then_rad, high_rad), 0.0) + min(now_rad - min(then_rad, low_rad), 0.0)
