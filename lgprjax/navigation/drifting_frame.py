"""Two frames: a local one in which the vehicle moves smoothly, and the map's, whose place in it drifts (LL fig. 11).

The local pose is dead reckoning and nothing corrects it. What the filter learns moves the map's frame, and with it the
path, in the local frame: controllers see a path that moves at a limited rate and never a vehicle that jumps.
"""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float

from lgprjax.navigation.arc_reach import reach, turned, wrap_yaw
from lgprjax.vehicle import VehiclePose


class FrameOffset(NamedTuple):
    """Pose of the map frame's origin in the local frame.

    Attributes:
        x_m, y_m: position.
        yaw_rad: of the map's x axis, counter-clockwise from the local one.
    """

    x_m: Float[Array, "..."]
    y_m: Float[Array, "..."]
    yaw_rad: Float[Array, "..."]


class SlewLimits(NamedTuple):
    """How fast the path may move, as seen at the vehicle.

    Attributes:
        position_mps: of the path's point at the vehicle, in any direction.
        yaw_radps: of the path's direction there.
    """

    position_mps: Float[Array, "..."]
    yaw_radps: Float[Array, "..."]


def anchor_frame(pose_global: VehiclePose, pose_local: VehiclePose) -> FrameOffset:
    """The offset with which both poses are the same place."""
    yaw = wrap_yaw(pose_local.yaw_rad - pose_global.yaw_rad)
    x, y = turned(jnp.cos(yaw), jnp.sin(yaw), (pose_global.x_m, pose_global.y_m))
    return FrameOffset(pose_local.x_m - x, pose_local.y_m - y, yaw)


def to_local(frame: FrameOffset, pose_global: VehiclePose) -> VehiclePose:
    """A pose of the map's frame in the local one."""
    x, y = turned(jnp.cos(frame.yaw_rad), jnp.sin(frame.yaw_rad), (pose_global.x_m, pose_global.y_m))
    return VehiclePose(frame.x_m + x, frame.y_m + y, pose_global.yaw_rad + frame.yaw_rad)


def to_global(frame: FrameOffset, pose_local: VehiclePose) -> VehiclePose:
    """A pose of the local frame in the map's."""
    from_origin = (pose_local.x_m - frame.x_m, pose_local.y_m - frame.y_m)
    x, y = turned(jnp.cos(frame.yaw_rad), -jnp.sin(frame.yaw_rad), from_origin)
    return VehiclePose(x, y, pose_local.yaw_rad - frame.yaw_rad)


def step_local(
    pose_local: VehiclePose,
    speed_mps: Float[Array, "..."],
    yaw_rate_radps: Float[Array, "..."],
    zero_slip_m: Float[Array, "..."],
    step_s: Float[Array, "..."],
) -> VehiclePose:
    """Dead reckoning of the rear axle over a tick, on the exact arc; a negative tick goes back along it.

    Args:
        pose_local: before; any level frame serves.
        speed_mps: forward, of any point of the centre line along the body axis.
        yaw_rate_radps: of the body.
        zero_slip_m: x_c, from the rear axle forward to the point that moves along the body axis.
        step_s: length of the tick.
    """
    turn = yaw_rate_radps * step_s
    nowhere = jnp.zeros_like(zero_slip_m)
    way = reach(speed_mps * step_s, turn, zero_slip_m, nowhere, nowhere).at_m
    x, y = turned(jnp.cos(pose_local.yaw_rad), jnp.sin(pose_local.yaw_rad), way)
    return VehiclePose(pose_local.x_m + x, pose_local.y_m + y, pose_local.yaw_rad + turn)


def slew_frame(
    frame: FrameOffset,
    wanted: FrameOffset,
    pose_local: VehiclePose,
    limits: SlewLimits,
    step_s: Float[Array, "..."],
) -> tuple[FrameOffset, Float[Array, "..."]]:
    """Moves the map's frame, and the path with it, towards a wanted offset; the vehicle's local pose stays what it is.

    The path's point at the vehicle moves straight towards where it is wanted and the path turns about it, each within
    its limit; an offset within both limits is taken as it is.

    Args:
        frame: as it stands.
        wanted: where it shall go.
        pose_local: of the vehicle, at which the limits hold.
        limits: speeds of the path.
        step_s: length of the tick.

    Returns:
        The new offset, and how far the path's point at the vehicle still has to go, metres.
    """
    here = to_global(frame, pose_local)
    x, y = _missing(wanted, here, pose_local)
    turn = wrap_yaw(wanted.yaw_rad - frame.yaw_rad)
    distance = jnp.hypot(x, y)
    most_m, most_rad = limits.position_mps * step_s, limits.yaw_radps * step_s
    share = jnp.minimum(1.0, most_m / jnp.maximum(distance, 1e-9))
    target = VehiclePose(
        pose_local.x_m + share * x,
        pose_local.y_m + share * y,
        pose_local.yaw_rad + jnp.clip(turn, -most_rad, most_rad),
    )
    moved = anchor_frame(here, target)
    arrives = (distance <= most_m) & (jnp.abs(turn) <= most_rad)
    slewed = FrameOffset(*(jnp.where(arrives, to, by) for to, by in zip(wanted, moved, strict=True)))
    left = _missing(wanted, to_global(slewed, pose_local), pose_local)
    return slewed, jnp.where(arrives, 0.0, jnp.hypot(*left))


def _missing(
    wanted: FrameOffset, here: VehiclePose, pose_local: VehiclePose
) -> tuple[Float[Array, "..."], Float[Array, "..."]]:
    """From the vehicle to where the wanted offset puts the point of the map that is at the vehicle now."""
    there = to_local(wanted, here)
    return there.x_m - pose_local.x_m, there.y_m - pose_local.y_m
