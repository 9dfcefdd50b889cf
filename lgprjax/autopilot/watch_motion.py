"""Standing, moving, or too fast to engage, for the mode machine. Fault 30."""

import math
from typing import NamedTuple

from lgprjax.autopilot.mode_events import MOTIONS, Event, Motion
from lgprjax.autopilot.watch_dwell import counted_step_s

STANDING_MPS, MOVING_MPS = 0.05, 0.12
SMOOTHED_S = 0.2
TOO_FAST_MARGIN_MPS = 0.2
UNKNOWN_S = 0.1

_EVENTS = {motion: event for event, motion in MOTIONS.items()}


class MotionState(NamedTuple):
    """What is carried from tick to tick: what was told last, the smoothed speed, and for how long none was known."""

    motion: Motion = Motion.UNKNOWN
    speed_mps: float = 0.0
    unknown_s: float = 0.0


def step_motion(
    state: MotionState, *, speed_mps: float, fastest_engage_mps: float, step_s: float
) -> tuple[MotionState, list[Event]]:
    """State, and an event where the motion changed.

    A speed that is no number for ``UNKNOWN_S`` counts as too fast: nothing is engaged with it.

    Args:
        state: of the last tick.
        speed_mps: signed.
        fastest_engage_mps: above which nothing is to be engaged.
        step_s: since the last tick.
    """
    step_s = counted_step_s(step_s)
    if math.isfinite(speed_mps):
        share = min(step_s / SMOOTHED_S, 1.0)
        speed, unknown_s = state.speed_mps + share * (speed_mps - state.speed_mps), 0.0
    else:
        speed, unknown_s = state.speed_mps, state.unknown_s + step_s
    fast = fastest_engage_mps - (TOO_FAST_MARGIN_MPS if state.motion is Motion.TOO_FAST else 0.0)
    still = STANDING_MPS if state.motion is Motion.MOVING else MOVING_MPS
    if unknown_s >= UNKNOWN_S or abs(speed) > fast:
        motion = Motion.TOO_FAST
    else:
        motion = Motion.STANDING if abs(speed) <= still else Motion.MOVING
    events = [_EVENTS[motion]] if motion is not state.motion else []
    return MotionState(motion, speed, unknown_s), events
