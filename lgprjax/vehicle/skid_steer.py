"""Skid-steer motion: two sides of wheels, the rates of the body by them, and the exact arc they drive (MF 2)."""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float

from lgprjax.vehicle.arc import VehiclePose


class SkidSteer(NamedTuple):
    """What limits a skid-steer vehicle. Fields are scalars or one value a lane.

    Attributes:
        track_m: effective track: the speeds' difference over it is the yaw rate. Wheels that scrub aside turn the
            body less than their distance says, so it is wider than that.
        largest_wheel_mps: of either side, both ways.
        wheel_rate_mps2: fastest change of a side's speed.
        smallest_radius_m: of the arcs that it may be asked to drive.
    """

    track_m: Float[Array, "..."]
    largest_wheel_mps: Float[Array, "..."]
    wheel_rate_mps2: Float[Array, "..."]
    smallest_radius_m: Float[Array, "..."]


class WheelSpeeds(NamedTuple):
    """Speeds of both sides over ground, negative backwards."""

    left_mps: Float[Array, "..."]
    right_mps: Float[Array, "..."]


def body_rates(track_m: Float[Array, "..."], wheels: WheelSpeeds) -> tuple[Float[Array, "..."], Float[Array, "..."]]:
    """Forward speed of the track's midpoint, m/s, and yaw rate, rad/s, without slip."""
    speed_mps = 0.5 * (wheels.left_mps + wheels.right_mps)
    return speed_mps, (wheels.right_mps - wheels.left_mps) / track_m


def wheel_speeds(
    track_m: Float[Array, "..."], speed_mps: Float[Array, "..."], yaw_rate_radps: Float[Array, "..."]
) -> WheelSpeeds:
    """Speeds of both sides that give the midpoint a forward speed and the body a yaw rate: ``body_rates`` undone."""
    apart = 0.5 * track_m * yaw_rate_radps
    return WheelSpeeds(speed_mps - apart, speed_mps + apart)


def drive_skid_arc(
    pose: VehiclePose, track_m: Float[Array, "..."], wheels: WheelSpeeds, step_s: Float[Array, "..."]
) -> VehiclePose:
    """Pose of the track's midpoint after a time at constant wheel speeds (MF section 2, simplified).

    The turn centre lies on the line through the midpoint across the heading. The way is the arc's chord, in the
    direction of half the turn: nothing is divided by the yaw rate, so the straight line is its limit, and a turn on
    the spot stays where it is.

    Args:
        pose: of the midpoint, before.
        track_m: effective.
        wheels: over ground.
        step_s: how long; a negative time goes back along the arc.
    """
    speed_mps, yaw_rate_radps = body_rates(track_m, wheels)
    turn = yaw_rate_radps * step_s
    chord = speed_mps * step_s * jnp.sinc(turn / (2.0 * jnp.pi))
    direction = pose.yaw_rad + 0.5 * turn
    return VehiclePose(
        pose.x_m + chord * jnp.cos(direction), pose.y_m + chord * jnp.sin(direction), pose.yaw_rad + turn
    )
