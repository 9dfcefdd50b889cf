"""Remaining share of the steering servo's torque, by its supply voltage and by its rate under load.

The look-ahead grows with falling torque, within the limits set by its study. The estimate is slow on purpose, because a
jump of the look-ahead would steer.
"""

import math
from typing import NamedTuple

from lgprjax.autopilot.chassis_monitors import ServoWatchState
from lgprjax.autopilot.monitors import WheelBelief

_WINDOW_TICKS = 12
"""Window of the wheels' rate measurement, ticks: about a quarter of a second at 50 Hz."""
_BEHIND = 1.5
"""Distance behind the command, in what the servo turns in its lag at its rate, from which on it turns at its rate."""
_CLOSE_RAD = 0.01
_RATE_S = 0.5
_SHARE_S = 1.0
_RECOVERS_S = 60.0
_LEAST = 0.05


class TorqueState(NamedTuple):
    """State from tick to tick.

    Attributes:
        share: share of the torque used by the look-ahead.
        by_rate: share last measured by the rate; it recovers within a minute without a measurement.
        moved: time and front angle of the last ticks in which the servo was behind to one side; empty otherwise.
        side: side to which the servo is behind: 1, -1, or 0.
    """

    share: float = 1.0
    by_rate: float = 1.0
    moved: tuple[tuple[float, float], ...] = ()
    side: int = 0


def step_torque(
    belief: WheelBelief,
    state: TorqueState,
    servo: ServoWatchState,
    *,
    front_rad: float,
    supply_v: float,
    engaged: bool,
    step_s: float,
) -> TorqueState:
    """State after a tick.

    Args:
        belief: calibrated steering with its servo.
        state: state of the last tick.
        servo: state of the servo watch after this tick, with the commands that may act.
        front_rad: measured angle of the front wheels.
        supply_v: supply voltage of the servo; NaN changes nothing.
        engaged: whether the box holds the steering engaged.
        step_s: time since the last tick.
    """
    step_s = step_s if math.isfinite(step_s) and step_s > 0.0 else 0.0
    side = _behind(belief, servo, front_rad) if engaged else 0
    moved: tuple[tuple[float, float], ...] = ()
    by_rate = state.by_rate + (1.0 - state.by_rate) * min(step_s / _RECOVERS_S, 1.0)
    if side and math.isfinite(front_rad):
        kept = state.moved if side == state.side else ()
        moved = (*kept[-_WINDOW_TICKS:], (servo.time_s, front_rad))
        passed = moved[-1][0] - moved[0][0]
        if len(moved) > _WINDOW_TICKS and passed > 0.0:
            share = side * (moved[-1][1] - moved[0][1]) / passed / belief.rate_radps
            share = min(max(share, _LEAST), 1.0)
            by_rate = state.by_rate + (share - state.by_rate) * min(step_s / _RATE_S, 1.0)
    wanted = min(_by_supply(belief, supply_v, state.share), by_rate)
    share = state.share + (wanted - state.share) * min(step_s / _SHARE_S, 1.0)
    return TorqueState(min(max(share, _LEAST), 1.0), by_rate, moved, side)


def _by_supply(belief: WheelBelief, supply_v: float, last: float) -> float:
    if not math.isfinite(supply_v):
        return last
    return min(max((supply_v - belief.stall_v) / (belief.nominal_v - belief.stall_v), _LEAST), 1.0)


def _behind(belief: WheelBelief, servo: ServoWatchState, front_rad: float) -> int:
    """Side to which the servo is far behind every command that may act now; 0 for none."""
    acting = [sent.front_rad for sent in servo.sent if sent.time_s <= servo.time_s - belief.delay_s]
    if not acting or not all(math.isfinite(command) for command in (*acting, front_rad)):
        return 0
    least = _BEHIND * belief.rate_radps * belief.lag_s + _CLOSE_RAD
    away = [min(max(command, -belief.largest_rad), belief.largest_rad) - front_rad for command in acting]
    if min(away) > least:
        return 1
    return -1 if max(away) < -least else 0
