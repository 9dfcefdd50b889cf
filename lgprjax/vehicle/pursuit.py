"""Counter-steer pure pursuit: the front angle that takes the anchor through a goal on one arc.

Goal as seen from the anchor in the body frame: ahead X = D cos η, left Y = D sin η. The anchor, l ahead of the rear
axle, comes to the goal on the arc about the turn centre exactly when (LL eq. 2)

    (D/2 + l cos η) tan φ + (D/2 + (l − L) cos η) tan ψ(φ) = L sin η / G,

G being the yaw gain of the speed, fed forward. With tan kφ ≈ k tan φ it has a closed form (LL eq. 3), which is the
start of a fixed number of Newton steps. k = 0 is LL eq. 1; its printed minus counts φ and η in opposite senses.
"""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from lgprjax.vehicle.chassis import Chassis, ProportionalRear, rear_angle

NEWTON_STEPS = 4


class Steering(NamedTuple):
    """What a pursuit law asks of the front wheels.

    Attributes:
        front_rad: angle, never beyond the largest.
        reachable: an arc within the largest angle leads through the goal; else the angle is the largest towards the
            goal's side.
    """

    front_rad: Float[Array, "..."]
    reachable: Bool[Array, "..."]


class _Arms(NamedTuple):
    """Factors of tan φ and tan ψ, and the side that they must reach."""

    front: Float[Array, "..."]
    rear: Float[Array, "..."]
    wanted: Float[Array, "..."]


def _arms(
    chassis: Chassis, ahead_m: Float[Array, "..."], left_m: Float[Array, "..."], gain: Float[Array, "..."]
) -> _Arms:
    """The equation times D: no angle is ever taken of the goal."""
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
    not short of the right side. Where it is not the wheels go to the largest angle on the goal's side, and the flag
    says so.

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
    # The left side is odd in φ for k; a measured ψ is taken on the goal's own side.
    side = jnp.where(left_m < 0.0, -1.0, 1.0)
    at_largest, slope_at_largest = _left_side(chassis, arms, side * largest)
    _, slope_straight = _left_side(chassis, arms, jnp.zeros_like(left_m))
    reachable = (slope_straight > 0.0) & (slope_at_largest > 0.0) & (side * arms.wanted <= side * at_largest)
    # The sign of a goal that is no number is none either: nothing asked is not full lock.
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
