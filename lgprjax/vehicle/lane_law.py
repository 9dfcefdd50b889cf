"""The exact pursuit law as a rollout solves it: what a lane's geometry gives is worked out once, before its steps.

The equation, the limits and the sense of ``reachable`` are those of ``steer_exact``. Lengths are in wheelbases,
tangents are quotients of polynomials, and only the last Newton step carries a gradient: at a root its gradient is the
root's.
"""

from typing import NamedTuple

import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Bool, Float

from lgprjax.vehicle.chassis import Chassis, Rear, rear_angle
from lgprjax.vehicle.pursuit import NEWTON_STEPS, Steering
from lgprjax.vehicle.tangent import tangent


class LaneLaw(NamedTuple):
    """A lane's pursuit law.

    Attributes:
        rear: how the rear wheels follow.
        lead: anchor ahead of the rear axle, in wheelbases.
        loss: one over the yaw gain that is fed forward.
        largest_rad: of the front wheels.
        slope_straight: dψ/dφ with straight wheels.
        left, right: what the wheels do at the largest angle to either side.
    """

    rear: Rear
    lead: Float[Array, "..."]
    loss: Float[Array, "..."]
    largest_rad: Float[Array, "..."]
    slope_straight: Float[Array, "..."]
    left: "_Lock"
    right: "_Lock"


class _Lock(NamedTuple):
    """tan φ and tan ψ at a largest angle, and how fast both rise with φ."""

    front: Float[Array, "..."]
    rear: Float[Array, "..."]
    front_slope: Float[Array, "..."]
    rear_slope: Float[Array, "..."]


def prepare_law(chassis: Chassis, gain: Float[Array, "..."]) -> LaneLaw:
    """The law of a chassis as it is believed, at a believed yaw gain."""
    largest = chassis.largest_angle_rad
    return LaneLaw(
        chassis.rear,
        chassis.anchor_m / chassis.wheelbase_m,
        1.0 / gain,
        largest,
        rear_angle(chassis.rear, jnp.zeros_like(largest))[1],
        _lock(chassis.rear, largest),
        _lock(chassis.rear, -largest),
    )


def steer_lane(law: LaneLaw, ahead: Float[Array, "..."], left: Float[Array, "..."]) -> Steering:
    """Front angle that takes the anchor through a goal.

    Args:
        law: from ``prepare_law``.
        ahead, left: goal from the anchor in the body frame, in wheelbases.
    """
    half_square = 0.5 * (ahead * ahead + left * left)
    front_arm = half_square + law.lead * ahead
    rear_arm = half_square + (law.lead - 1.0) * ahead
    wanted = left * law.loss
    largest = law.largest_rad
    lock = jnp.sign(left) * largest
    rise = front_arm + law.slope_straight * rear_arm
    # The closed form with the arc tangent's continued fraction, cut early: it need only be near.
    ratio = wanted / jnp.where(rise > 0.0, rise, 1.0)
    square = ratio * ratio
    start = jnp.where(rise > 0.0, ratio * (15.0 + 4.0 * square) / (15.0 + 9.0 * square), lock)
    front = lax.stop_gradient(jnp.clip(start, -largest, largest))
    for last in (False,) * (NEWTON_STEPS - 1) + (True,):
        step = _newton_step(law.rear, front_arm, rear_arm, wanted, front)
        front = jnp.clip(front - (step if last else lax.stop_gradient(step)), -largest, largest)
    side = jnp.where(left < 0.0, -1.0, 1.0)
    most, slope = _at_lock(law, front_arm, rear_arm, left < 0.0)
    reachable = (rise > 0.0) & (slope > 0.0) & (side * wanted <= side * most)
    return Steering(jnp.where(reachable, front, lock), reachable)


def _newton_step(
    rear: Rear,
    front_arm: Float[Array, "..."],
    rear_arm: Float[Array, "..."],
    wanted: Float[Array, "..."],
    front_rad: Float[Array, "..."],
) -> Float[Array, "..."]:
    behind, slope = rear_angle(rear, front_rad)
    front_tangent, rear_tangent = tangent(front_rad), tangent(behind)
    value = front_arm * front_tangent + rear_arm * rear_tangent - wanted
    rise = front_arm * (1.0 + front_tangent * front_tangent) + rear_arm * (1.0 + rear_tangent * rear_tangent) * slope
    # The slope's own gradient would only move the iterate, not the root.
    rise = lax.stop_gradient(rise)
    return jnp.where(rise > 0.0, value / jnp.where(rise > 0.0, rise, 1.0), 0.0)


def _lock(rear: Rear, front_rad: Float[Array, "..."]) -> _Lock:
    behind, slope = rear_angle(rear, front_rad)
    front, follow = tangent(front_rad), tangent(behind)
    return _Lock(front, follow, 1.0 + front * front, (1.0 + follow * follow) * slope)


def _at_lock(
    law: LaneLaw, front_arm: Float[Array, "..."], rear_arm: Float[Array, "..."], right: Bool[Array, "..."]
) -> tuple[Float[Array, "..."], Float[Array, "..."]]:
    """Left side of the equation and its slope at the largest angle on the goal's side."""
    front, rear, front_slope, rear_slope = (
        jnp.where(right, at_right, at_left) for at_right, at_left in zip(law.right, law.left, strict=True)
    )
    return front_arm * front + rear_arm * rear, front_arm * front_slope + rear_arm * rear_slope
