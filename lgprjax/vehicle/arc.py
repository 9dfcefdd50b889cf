"""Motion at constant wheel angles: an exact arc, with the straight line as its limit."""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float

from lgprjax.vehicle.chassis import Turn


class VehiclePose(NamedTuple):
    """Pose of the rear axle in a level local frame: a point that stays in the body, which the zero-slip point does not.

    Attributes:
        x_m, y_m: position, east and north or any other level axes.
        yaw_rad: counter-clockwise from x.
    """

    x_m: Float[Array, "..."]
    y_m: Float[Array, "..."]
    yaw_rad: Float[Array, "..."]


def drive_arc(
    pose: VehiclePose, travel_m: Float[Array, "..."], turn: Turn, gain: float | Float[Array, "..."] = 1.0
) -> VehiclePose:
    """Pose after ``travel_m`` (forward component of the way; negative in reverse) at constant wheel angles.

    The rear axle's way before rotation is (ds, −G ds tan ψ) and the yaw changes by Gκ ds: the loss of yaw G leaves the
    zero-slip point where it is. The chord is that of the exact arc; near a straight line its two factors are taken from
    their series, so nothing is divided by the curvature.

    Args:
        pose: before.
        travel_m: way of any point of the centre line along the body axis.
        turn: from ``turn_of``.
        gain: G_ss, from ``yaw_gain``.
    """
    change = gain * turn.curvature_radpm * travel_m
    small = jnp.abs(change) < 0.05
    safe = jnp.where(small, 1.0, change)
    square = change * change
    along = jnp.where(small, 1.0 - square / 6.0 * (1.0 - square / 20.0), jnp.sin(safe) / safe)
    aside = jnp.where(small, 0.5 * change * (1.0 - square / 12.0 * (1.0 - square / 30.0)), (1.0 - jnp.cos(safe)) / safe)
    forward, left = travel_m, -gain * travel_m * turn.rear_tangent
    x, y = along * forward - aside * left, aside * forward + along * left
    cos, sin = jnp.cos(pose.yaw_rad), jnp.sin(pose.yaw_rad)
    return VehiclePose(pose.x_m + cos * x - sin * y, pose.y_m + sin * x + cos * y, pose.yaw_rad + change)


def body_point(pose: VehiclePose, ahead_m: Float[Array, "..."]) -> tuple[Float[Array, "..."], Float[Array, "..."]]:
    """Position of a point of the centre line, metres ahead of the rear axle: anchor, front axle, array."""
    return pose.x_m + ahead_m * jnp.cos(pose.yaw_rad), pose.y_m + ahead_m * jnp.sin(pose.yaw_rad)
