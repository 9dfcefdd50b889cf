"""Potentiometer and encoder of the steering, each held against the other and against what it can say at all.

Faults 15 and 16. The encoder's zero is another one at every start: it is learnt against the potentiometer from the
first good readings, or given, where the box keeps it. A wheel refitted off by a tooth shows at once with a zero that
was kept, and else in the yaw rate (``watch_chassis``).
"""

import math
from typing import NamedTuple

from lgprjax.autopilot.watch_belief import WheelBelief, front_angle
from lgprjax.autopilot.watch_dwell import Dwell, beyond, counted_step_s, step_dwell
from lgprjax.autopilot.watch_findings import Watch, as_watch

RANGE_S = 0.06
"""Out of range for so long is open or shorted: found within 0.1 s; single spikes pass."""
MOVED_RAD = 0.025
"""Encoder way with which the potentiometer must have moved by more than ``STILL_RAD``; play and noise are less."""
STILL_RAD = 0.01
STUCK_S = 0.04
APART_RAD = 0.03
"""Largest disagreement: noise, play and errors of the map together are half of it."""
APART_S = 0.16
LEARN_TICKS = 10
LEAP_RAD = 0.03
"""Encoder way within a tick that no servo makes: a leap of the count, which says nothing of the potentiometer."""


class WheelSensorState(NamedTuple):
    """What is carried from tick to tick.

    Attributes:
        zero_counts: encoder reading at straight wheels; not a number until learnt.
        learnt: readings that went into ``learnt_counts``, the sum of their zeros.
        still_rad, since_rad: potentiometer where it last moved, and the encoder then.
        encoder_rad: last tick's.
        range, stuck, apart: findings.
    """

    zero_counts: float = math.nan
    learnt: int = 0
    learnt_counts: float = 0.0
    still_rad: float = math.nan
    since_rad: float = math.nan
    encoder_rad: float = math.nan
    range: Dwell = Dwell()
    stuck: Dwell = Dwell()
    apart: Dwell = Dwell()


class WheelAngles(NamedTuple):
    """Front wheel angle, rad, by potentiometer and by encoder; not a number where it says none."""

    front_rad: float
    encoder_rad: float


def init_wheel_sensors(zero_counts: float = math.nan) -> WheelSensorState:
    """At a start of the box: with the encoder's zero as it was kept, or, as a rule, unknown."""
    return WheelSensorState(zero_counts=zero_counts)


def step_wheel_sensors(
    belief: WheelBelief, state: WheelSensorState, potentiometer_v: float, encoder_counts: float, step_s: float
) -> tuple[WheelSensorState, WheelAngles, Watch]:
    """State, angles and findings of a tick.

    Args:
        belief: the steering.
        state: of the last tick.
        potentiometer_v, encoder_counts: of the box's newest status.
        step_s: since the last tick.
    """
    step_s = counted_step_s(step_s)
    front = front_angle(belief, potentiometer_v)
    zero, learnt, learnt_counts = state.zero_counts, state.learnt, state.learnt_counts
    counts_are = math.isfinite(encoder_counts)
    if learnt < LEARN_TICKS and not math.isfinite(zero) and counts_are and math.isfinite(front):
        learnt, learnt_counts = learnt + 1, learnt_counts + encoder_counts - belief.encoder_counts_per_rad * front
        zero = learnt_counts / learnt if learnt == LEARN_TICKS else zero
    encoder = (encoder_counts - zero) / belief.encoder_counts_per_rad if counts_are else math.nan
    judged = math.isfinite(zero) or not counts_are

    leapt = beyond(encoder - state.encoder_rad, LEAP_RAD)
    moved = beyond(front - state.still_rad, STILL_RAD)
    still, since = (front, encoder) if leapt or moved else (state.still_rad, state.since_rad)
    out = step_dwell(state.range, math.isnan(front), step_s, on_s=RANGE_S)
    stuck = step_dwell(state.stuck, abs(encoder - since) > MOVED_RAD, step_s, on_s=STUCK_S)
    apart = step_dwell(state.apart, judged and beyond(front - encoder, APART_RAD), step_s, on_s=APART_S)
    state = WheelSensorState(zero, learnt, learnt_counts, still, since, encoder, out, stuck, apart)
    bits = (
        out.on * Watch.POTENTIOMETER_RANGE | stuck.on * Watch.POTENTIOMETER_STUCK | apart.on * Watch.WHEEL_SENSORS_APART
    )
    return state, WheelAngles(front, encoder), as_watch(bits)
