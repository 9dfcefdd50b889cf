"""The turn that the wheels should make against the gyro: rear wheels that are stuck. Fault 19.

Wheels that follow no longer show where the turn asks for another angle than the one they are stuck at: on a straight
line a rear axle stuck straight is none the worse, and is found in the next bend.
"""

import math
from typing import NamedTuple

from lgprjax.autopilot.watch_belief import ChassisBelief, curvature, yaw_gain
from lgprjax.autopilot.watch_dwell import Dwell, beyond, counted_step_s, step_dwell
from lgprjax.autopilot.watch_findings import Watch, as_watch

SLOWEST_MPS = 1.0
"""Below it the gyro's bias is as large as what a bend makes."""
SMOOTHED_S = 0.25
STUCK_S = 0.6
"""With the smoothing: found within 1 s."""
LOST_S = 0.1
RATE_RADPS = 0.012
CURVATURE_PER_M = 0.006
TURN_SHARE = 0.12
"""Gyro and model may differ by: bias and noise, what ruts add to a curvature, and a share of the turn itself for
calibration. A rear axle stuck straight takes almost four tenths of the turn."""


class ChassisWatchState(NamedTuple):
    """What is carried from tick to tick: smoothed yaw rates, rad/s, that the gyro exceeds the model by, and that the
    model expects; findings."""

    excess_radps: float = 0.0
    expected_radps: float = 0.0
    stuck: Dwell = Dwell()
    lost: Dwell = Dwell()


def step_chassis_watch(
    belief: ChassisBelief,
    state: ChassisWatchState,
    *,
    front_rad: float,
    yaw_rate_radps: float,
    speed_mps: float,
    speed_trusted: bool,
    step_s: float,
) -> tuple[ChassisWatchState, Watch]:
    """State and findings of a tick.

    Args:
        belief: steering geometry.
        state: of the last tick.
        front_rad: of the wheels as measured; not judged without one, which is a finding of its own.
        yaw_rate_radps: by the gyro, counter-clockwise.
        speed_mps: signed.
        speed_trusted: nothing is wrong with the odometer.
        step_s: since the last tick.
    """
    step_s = counted_step_s(step_s)
    lost = step_dwell(state.lost, not math.isfinite(yaw_rate_radps), step_s, on_s=LOST_S)
    judged = speed_trusted and abs(speed_mps) > SLOWEST_MPS and math.isfinite(front_rad)
    if not judged:
        stuck = step_dwell(state.stuck, False, step_s, on_s=STUCK_S)
        return ChassisWatchState(0.0, 0.0, stuck, lost), _bits(stuck, lost)
    if math.isfinite(yaw_rate_radps):
        expected = speed_mps * curvature(belief, front_rad) * yaw_gain(belief, speed_mps)
        share = min(step_s / SMOOTHED_S, 1.0)
        excess = state.excess_radps + share * (yaw_rate_radps - expected - state.excess_radps)
        expected = state.expected_radps + share * (expected - state.expected_radps)
    else:
        excess, expected = state.excess_radps, state.expected_radps
    bound = RATE_RADPS + CURVATURE_PER_M * abs(speed_mps) + TURN_SHARE * abs(expected)
    stuck = step_dwell(state.stuck, beyond(excess, bound), step_s, on_s=STUCK_S)
    return ChassisWatchState(excess, expected, stuck, lost), _bits(stuck, lost)


def _bits(stuck: Dwell, lost: Dwell) -> Watch:
    return as_watch(stuck.on * Watch.REAR_STUCK | lost.on * Watch.YAW_RATE_LOST)
