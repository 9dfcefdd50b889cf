"""Counter-steer pure pursuit: the front angle that takes the anchor through a goal on one arc.

Goal as seen from the anchor in the body frame: ahead X = D cos η, left Y = D sin η. The anchor, l ahead of the rear
axle, reaches the goal on the arc about the turn centre exactly when (LL eq. 2)

    (D/2 + l cos η) tan φ + (D/2 + (l − L) cos η) tan ψ(φ) = L sin η / G,

G being the yaw gain of the speed, fed forward. With tan kφ ≈ k tan φ it has a closed form (LL eq. 3), which is the
start of a fixed number of Newton steps. k = 0 is LL eq. 1; its printed minus counts φ and η in opposite senses.
"""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from lgprjax.vehicle.kinematics import Chassis, ProportionalRear, WheelSpeeds, rear_angle

NEWTON_STEPS = 4


class Steering(NamedTuple):
    """Command of a pursuit law to the front wheels.

    Attributes:
        front_rad: angle, never beyond the largest.
        reachable: an arc within the largest angle leads through the goal; else the angle is the largest one towards the
            goal.
    """

    front_rad: Float[Array, "..."]
    reachable: Bool[Array, "..."]


class _Arms(NamedTuple):
    """Factors of tan φ and tan ψ, and the right side of the equation."""

    front: Float[Array, "..."]
    rear: Float[Array, "..."]
    wanted: Float[Array, "..."]


def _arms(
    chassis: Chassis, ahead_m: Float[Array, "..."], left_m: Float[Array, "..."], gain: Float[Array, "..."]
) -> _Arms:
    """The equation times D, so that the goal's angle is not needed."""
    square = ahead_m * ahead_m + left_m * left_m
    return _Arms(
        0.5 * square + chassis.anchor_m * ahead_m,
        0.5 * square + (chassis.anchor_m - chassis.wheelbase_m) * ahead_m,
        chassis.wheelbase_m * left_m / gain,
    )


def steer_closed(
    chassis: Chassis, ahead_m: Float[Array, "..."], left_m: Float[Array, "..."], gain: Float[Array, "..."]
) -> Float[Array, "..."]:
    """Front angle by the closed form (LL eq. 3), clipped to the largest.

    Its error is at most 1.9 % for k = 0.63 up to 30° with the anchor at or before the front axle and the goal ahead of
    it; behind, and with the anchor near the rear axle, it is much larger. With a measured ψ its slope at φ = 0 is k.

    Args:
        chassis: geometry and limits.
        ahead_m, left_m: goal from the anchor, in the body frame.
        gain: G_ss of the speed; 1 without feed-forward.
    """
    arms = _arms(chassis, ahead_m, left_m, gain)
    if isinstance(chassis.rear, ProportionalRear):
        ratio = chassis.rear.ratio
    else:
        ratio = rear_angle(chassis.rear, jnp.zeros_like(left_m))[1]
    return jnp.clip(
        jnp.arctan2(arms.wanted, arms.front + ratio * arms.rear), -chassis.largest_angle_rad, chassis.largest_angle_rad
    )


def steer_exact(
    chassis: Chassis, ahead_m: Float[Array, "..."], left_m: Float[Array, "..."], gain: Float[Array, "..."]
) -> Steering:
    """Front angle by LL eq. 2: four Newton steps from the closed form, start and iterates clipped to the largest angle.

    A goal is reachable when the left side of the equation rises with φ at 0 and at the largest angle and, there, is
    not short of the right side. Otherwise the wheels go to the largest angle on the goal's side, and the flag is False.

    Args:
        chassis: geometry and limits.
        ahead_m, left_m: goal from the anchor, in the body frame.
        gain: G_ss of the speed; 1 without feed-forward.
    """
    arms = _arms(chassis, ahead_m, left_m, gain)
    largest = jnp.broadcast_to(chassis.largest_angle_rad, left_m.shape)
    front = steer_closed(chassis, ahead_m, left_m, gain)
    for _ in range(NEWTON_STEPS):
        value, slope = _left_side(chassis, arms, front)
        step = jnp.where(slope > 0.0, (value - arms.wanted) / jnp.where(slope > 0.0, slope, 1.0), 0.0)
        front = jnp.clip(front - step, -largest, largest)
    # The left side is odd in φ for k; a measured ψ is evaluated on the goal's own side.
    side = jnp.where(left_m < 0.0, -1.0, 1.0)
    at_largest, slope_at_largest = _left_side(chassis, arms, side * largest)
    _, slope_straight = _left_side(chassis, arms, jnp.zeros_like(left_m))
    reachable = (slope_straight > 0.0) & (slope_at_largest > 0.0) & (side * arms.wanted <= side * at_largest)
    # The sign of a NaN goal is NaN too: a missing goal must not become full lock.
    return Steering(jnp.where(reachable, front, jnp.sign(left_m) * largest), reachable)


def _left_side(
    chassis: Chassis, arms: _Arms, front_rad: Float[Array, "..."]
) -> tuple[Float[Array, "..."], Float[Array, "..."]]:
    behind, slope = rear_angle(chassis.rear, front_rad)
    front, rear = jnp.tan(front_rad), jnp.tan(behind)
    value = arms.front * front + arms.rear * rear
    return value, arms.front * (1.0 + front * front) + arms.rear * (1.0 + rear * rear) * slope


def reverse_look_ahead_m(chassis: Chassis) -> Float[Array, "..."]:
    """Least look-ahead when reversing, 2 |l − x_c|: with less the vehicle steers the wrong way."""
    slope = rear_angle(chassis.rear, jnp.zeros_like(chassis.anchor_m))[1]
    return 2.0 * jnp.abs(chassis.anchor_m - chassis.wheelbase_m * slope / (1.0 + slope))


# Distance of the goal along the path: a short constant at low speed, a long one at high speed (Leonard et al.).


class LookAhead(NamedTuple):
    """A look-ahead over speed. Fields are scalars or one value per batch element; equal speeds give a step.

    Attributes:
        short_m: look-ahead along the path at and below the slow speed.
        long_m: look-ahead at and above the fast speed.
        slow_mps, fast_mps: speeds between which it grows linearly.
    """

    short_m: Float[Array, "..."]
    long_m: Float[Array, "..."]
    slow_mps: Float[Array, "..."]
    fast_mps: Float[Array, "..."]


def look_ahead_m(schedule: LookAhead, speed_mps: Float[Array, "..."]) -> Float[Array, "..."]:
    """Look-ahead at a speed, the same forward and in reverse."""
    span = schedule.fast_mps - schedule.slow_mps
    above = jnp.abs(speed_mps) - schedule.slow_mps
    ramp = jnp.clip(above / jnp.where(span > 0.0, span, 1.0), 0.0, 1.0)
    step = jnp.where(above > 0.0, 1.0, 0.0)
    return schedule.short_m + (schedule.long_m - schedule.short_m) * jnp.where(span > 0.0, ramp, step)


def stretched_look_ahead(
    schedule: LookAhead,
    exponent: Float[Array, "..."],
    share: Float[Array, "..."],
    least_share: Float[Array, "..."],
) -> LookAhead:
    """The schedule of a servo with a remaining share of its torque: longer by the factor share to minus the exponent.

    Args:
        schedule: schedule at full torque.
        exponent: exponent of the growth; 0: none.
        share: share of the torque; values above 1 count as 1, values that are not finite as ``least_share``.
        least_share: share below which it does not grow further, because no study covers it.
    """
    held = jnp.clip(jnp.where(jnp.isfinite(share), share, least_share), least_share, 1.0)
    longer = held**-exponent
    return schedule._replace(short_m=schedule.short_m * longer, long_m=schedule.long_m * longer)


def constant_look_ahead(length_m: Float[Array, "..."]) -> LookAhead:
    """The same at every speed."""
    zero = jnp.zeros_like(length_m)
    return LookAhead(length_m, length_m, zero, zero)


# Stanley's law, for comparison: the front axle is steered onto the path by its own offset and heading error.
#
# It holds for counter-steered vehicles unchanged, since the front axle moves where the front wheels point (Hoffmann
# et al., American Control Conference 2007).

_STANDING_MPS = 0.5


def steer_stanley(
    chassis: Chassis,
    heading_error_rad: Float[Array, "..."],
    offset_m: Float[Array, "..."],
    speed_mps: Float[Array, "..."],
    gain_ps: float | Float[Array, "..."],
) -> Float[Array, "..."]:
    """Front angle, clipped to the largest.

    Args:
        chassis: limits of the chassis.
        heading_error_rad: direction of the path minus that of the body, at the front axle's projection.
        offset_m: offset of the path from the front axle, positive if the path is to the left.
        speed_mps: forward speed.
        gain_ps: decay rate of a small offset, 1/s.
    """
    front = heading_error_rad + jnp.arctan(gain_ps * offset_m / (jnp.abs(speed_mps) + _STANDING_MPS))
    return jnp.clip(front, -chassis.largest_angle_rad, chassis.largest_angle_rad)


# Dead band and play of the steering, and a command that compensates them.
#
# The wheels stay behind a command by the dead band and half of the play, on the side that they come from. When the
# command turns back they do not move until it has crossed both twice: a law without compensation waits for a large
# enough error, and swings about its path.
#
# The command leads the wanted angle by as much to the side of its motion. The lead follows the last small turn of the
# wanted angle, without a jump, so that noise does not flip it from side to side.

_TURN_SHARE, _LEAST_TURN_RAD = 0.25, 0.001
"""Turn of the wanted angle over which the lead changes sides, half of it: as a share of the lead, and at least."""


def step_slack(
    slack_rad: float | Float[Array, "..."], middle_rad: Float[Array, "..."], wanted_rad: Float[Array, "..."]
) -> tuple[Float[Array, "..."], Float[Array, "..."]]:
    """Middle of the last turn, carried to the next step, and the command that brings the wheels to the wanted angle.

    Args:
        slack_rad: dead band and half of the play; 0: no compensation.
        middle_rad: middle from the last step; at first the wheels' angle.
        wanted_rad: wanted angle of the front wheels.
    """
    turn = jnp.maximum(_TURN_SHARE * jnp.asarray(slack_rad, jnp.float32), _LEAST_TURN_RAD)
    middle = jnp.clip(middle_rad, wanted_rad - turn, wanted_rad + turn)
    return middle, wanted_rad + slack_rad * (wanted_rad - middle) / turn


# Vehicles that ignore small turn commands (MF section 4), and pulses that compensate for it.
#
# The turn command is the difference of the wheel speeds, right minus left. Below the threshold the vehicle drives
# straight on at the wheels' mean speed; from the threshold on it follows fully. A feedback controller does not know
# that: it waits until its error is large enough, then turns too far.
#
# The compensation accumulates the turn that was commanded and not executed. When half a pulse is due, one pulse just
# above the threshold is sent; on average the vehicle turns as commanded. An upper bound of the threshold suffices:
# higher pulses are fewer.

PULSE_S = 0.06
"""Length of a pulse, a few ticks: longer pulses delay the guidance."""
_ABOVE = 1.05
"""Height of a pulse above the threshold, so that rounding does not suppress it."""


class PulseState(NamedTuple):
    """State of the compensation from step to step.

    Attributes:
        owed_m: distance that the right side must still gain on the left one: commanded and not executed.
        side: 1 in a pulse to the left, −1 to the right, 0 in none.
        left_s: remaining time of the pulse.
    """

    owed_m: Float[Array, "..."]
    side: Float[Array, "..."]
    left_s: Float[Array, "..."]


def obeyed_wheels(threshold_mps: Float[Array, "..."], wheels: WheelSpeeds) -> WheelSpeeds:
    """Wheel speeds that a vehicle with a threshold of their difference executes; 0 executes everything."""
    mean = 0.5 * (wheels.left_mps + wheels.right_mps)
    obeys = jnp.abs(wheels.right_mps - wheels.left_mps) >= threshold_mps
    return WheelSpeeds(jnp.where(obeys, wheels.left_mps, mean), jnp.where(obeys, wheels.right_mps, mean))


def init_pulses(like: Float[Array, "..."]) -> PulseState:
    """Initial state without a pending turn; one value for each of ``like``."""
    zero = jnp.zeros_like(like)
    return PulseState(zero, zero, zero)


def step_pulses(
    threshold_mps: Float[Array, "..."], state: PulseState, commanded: WheelSpeeds, step_s: Float[Array, "..."]
) -> tuple[PulseState, WheelSpeeds]:
    """State and the wheel speeds to send to a vehicle with a threshold; call ``settle_pulses`` after sending them.

    A turn above the threshold passes unchanged. At standstill there are no pulses and nothing stays pending.

    Args:
        threshold_mps: threshold of the wheels' speed difference, or slightly more; 0: no pulses.
        state: state of the last step.
        commanded: commanded wheel speeds.
        step_s: time step.
    """
    mean, turn = 0.5 * (commanded.left_mps + commanded.right_mps), commanded.right_mps - commanded.left_mps
    small = (jnp.abs(turn) < threshold_mps) & (mean != 0.0)
    height = _ABOVE * threshold_mps
    goes_on = small & (state.left_s > 0.0)
    owed = state.owed_m + turn * step_s
    starts = small & ~goes_on & (jnp.abs(owed) >= 0.5 * height * PULSE_S)
    side = jnp.where(goes_on, state.side, jnp.where(starts, jnp.sign(owed), 0.0))
    left_s = jnp.where(goes_on, state.left_s, jnp.where(starts, PULSE_S, 0.0)) - step_s
    pulsed = jnp.where(small, side * height, turn)
    kept = PulseState(jnp.where(mean != 0.0, state.owed_m, 0.0), side, jnp.maximum(left_s, 0.0))
    return kept, WheelSpeeds(mean - 0.5 * pulsed, mean + 0.5 * pulsed)


def settle_pulses(
    threshold_mps: Float[Array, "..."],
    state: PulseState,
    commanded: WheelSpeeds,
    sent: WheelSpeeds,
    step_s: Float[Array, "..."],
) -> PulseState:
    """The accumulated turn after a step: commanded minus executed.

    A limiter's ramp may keep a pulse below the threshold for some steps; this is accounted for. Never more than one
    pulse is due: turns beyond the limits of the wheels are not compensated later.
    """
    obeyed = obeyed_wheels(threshold_mps, sent)
    missing = (commanded.right_mps - commanded.left_mps) - (obeyed.right_mps - obeyed.left_mps)
    most = _ABOVE * threshold_mps * PULSE_S
    moves = commanded.left_mps + commanded.right_mps != 0.0
    return state._replace(owed_m=jnp.where(moves, jnp.clip(state.owed_m + missing * step_s, -most, most), 0.0))
