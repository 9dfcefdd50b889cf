"""The fence of a field, which no part of the vehicle may cross: host geometry, and prediction (``edge_ahead``)."""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from lgprjax.coverage.field import Outline, first_crossing
from lgprjax.coverage.ground import SafeGround
from lgprjax.errors import InputError
from lgprjax.vehicle.kinematics import VehiclePose, WheelSpeeds, drive_skid_arc

FENCE_SLOTS = (32, 128, 512, 4096)
"""Sides of a padded fence: fences of one size share a program."""


def pad_fence(*rings_m: Float[np.ndarray, "_ 2"]) -> Float[Array, "side 2 2"]:
    """Sides (start, end) of one or more rings, padded for the step with sides of no length.

    Places within an odd number of rings are inside: a ring within another one is a keep-out.

    Raises:
        InputError: a ring has fewer than three corners, there are too many sides, numbers are not finite, or sides
            cross.
    """
    sides = []
    for ring in rings_m:
        corners = np.asarray(ring, np.float64)
        if len(corners) < 3:
            raise InputError("fence", "corners", f"3 to {FENCE_SLOTS[-1]}", f"{len(corners)}")
        if not np.isfinite(corners).all():
            raise InputError("fence", "corners", "finite numbers", "values that are not finite")
        if first_crossing(corners) is not None:
            raise InputError("fence", "sides", "sides that do not cross", "two crossing sides")
        sides.append(np.stack([corners, np.roll(corners, -1, axis=0)], axis=1))
    every = np.concatenate(sides)
    size = next((slots for slots in FENCE_SLOTS if len(every) <= slots), None)
    if size is None:
        raise InputError("fence", "corners", f"3 to {FENCE_SLOTS[-1]}", f"{len(every)}")
    padding = np.broadcast_to(every[-1, 1], (size - len(every), 2, 2))
    return jnp.asarray(np.concatenate([every, padding]).astype(np.float32))


def fence_of_ground(ground: SafeGround) -> Float[Array, "side 2 2"]:
    """The padded fence of safe ground: all of its rings.

    Raises:
        InputError: as ``pad_fence``.
    """
    return pad_fence(*(ring for polygon in ground.polygons_m for ring in polygon))


# Whether a stop from here would cross the fence (fault 36), checked in each step.
#
# The stop is predicted: along an arc for the reaction time, then braked. At places along it the rectangle around
# vehicle and tool, grown by a margin, must be within the fence. It is within exactly if none of its sides crosses a
# side of the fence and one corner is inside.

_PLACES = 12


class StopRules(NamedTuple):
    """Model of a stop; float32 scalars.

    Attributes:
        reaction_s: time until the vehicle begins to slow down: age of the pose, tick, delay and lag of the wheels.
        stop_mps2: deceleration of the faster wheel after that.
        margin_m: margin to the fence, in addition to the pose's uncertainty.
        sigmas: number of sigmas of the position taken as uncertainty.
    """

    reaction_s: Float[Array, "..."]
    stop_mps2: Float[Array, "..."]
    margin_m: Float[Array, "..."]
    sigmas: Float[Array, "..."]


_MOST_SWING_RAD = 0.5
"""A heading that is less sure stops the vehicle anyway."""


def edge_ahead(
    rules: StopRules,
    fence: Float[Array, "side 2 2"],
    outline: Outline,
    track_m: Float[Array, ""],
    pose: VehiclePose,
    wheels: WheelSpeeds,
    sigma_m: Float[Array, ""],
    sigma_yaw_rad: Float[Array, ""],
) -> Bool[Array, ""]:
    """Whether vehicle or tool would cross the fence in a stop from now.

    Also true if they are beyond the fence already, or if anything is not finite. Unbatched.

    Args:
        rules: model of the stop.
        fence: fence from ``pad_fence``.
        outline: outline of vehicle and tool.
        track_m: effective track width.
        pose: pose of the reference point.
        wheels: commanded or measured wheel speeds, whose arc is kept to the end.
        sigma_m: standard deviation of the position.
        sigma_yaw_rad: standard deviation of the heading.
    """
    fastest = jnp.maximum(jnp.abs(wheels.left_mps), jnp.abs(wheels.right_mps))
    # At constant initial speed the braking distance takes half of its time.
    rolling_s = rules.reaction_s + 0.5 * fastest / rules.stop_mps2
    shares = jnp.linspace(0.0, 1.0, _PLACES, dtype=jnp.float32)
    reached = drive_skid_arc(pose, track_m, wheels, shares * rolling_s)
    # The farthest corner swings with the heading, and so does the way to the stop.
    reach_m = jnp.hypot(jnp.maximum(outline.front_m, -outline.rear_m), jnp.maximum(outline.left_m, -outline.right_m))
    swing_m = (reach_m + fastest * rolling_s) * jnp.minimum(sigma_yaw_rad, _MOST_SWING_RAD)
    margin = rules.margin_m + rules.sigmas * jnp.hypot(sigma_m, swing_m)
    front, rear = outline.front_m + margin, outline.rear_m - margin
    left, right = outline.left_m + margin, outline.right_m - margin
    ahead, aside = jnp.stack([front, rear, rear, front])[None], jnp.stack([left, left, right, right])[None]
    cos, sin = jnp.cos(reached.yaw_rad)[:, None], jnp.sin(reached.yaw_rad)[:, None]
    corners = jnp.stack(
        [reached.x_m[:, None] + cos * ahead - sin * aside, reached.y_m[:, None] + sin * ahead + cos * aside], axis=-1
    )
    # A keep-out smaller than the vehicle may be within its rectangle and cross none of its sides.
    away = fence[None, :, 0] - jnp.stack([reached.x_m, reached.y_m], axis=-1)[:, None]
    along, left_of = cos * away[..., 0] + sin * away[..., 1], cos * away[..., 1] - sin * away[..., 0]
    over = jnp.any((along <= front) & (along >= rear) & (left_of <= left) & (left_of >= right), axis=1)
    within = _inside(fence, corners[:, 0]) & ~_sides_cross(fence, corners) & ~over
    return ~jnp.all(within & jnp.isfinite(corners).all((1, 2)))


def _inside(fence: Float[Array, "side 2 2"], points: Float[Array, "place 2"]) -> Bool[Array, " place"]:
    """Mask of points inside the fence by the even-odd rule; sides of no length do not count."""
    x, y = points[:, :1], points[:, 1:]
    start, end = fence[None, :, 0], fence[None, :, 1]
    spans = (start[..., 1] > y) != (end[..., 1] > y)
    rise = jnp.where(spans, end[..., 1] - start[..., 1], 1.0)
    crossing = start[..., 0] + (y - start[..., 1]) * (end[..., 0] - start[..., 0]) / rise
    return jnp.sum(spans & (x < crossing), axis=1) % 2 == 1


def _sides_cross(fence: Float[Array, "side 2 2"], corners: Float[Array, "place 4 2"]) -> Bool[Array, " place"]:
    """Whether a side of a rectangle crosses or touches a side of the fence."""
    a, b = corners[:, :, None], jnp.roll(corners, -1, axis=1)[:, :, None]
    c, d = fence[None, None, :, 0], fence[None, None, :, 1]
    apart = (_beside(a, b, c) * _beside(a, b, d) > 0.0) | (_beside(c, d, a) * _beside(c, d, b) > 0.0)
    return jnp.any(~apart & jnp.any(c != d, axis=-1), axis=(1, 2))


def _beside(start: Float[Array, "..."], end: Float[Array, "..."], point: Float[Array, "..."]) -> Float[Array, "..."]:
    """Twice the area of the triangle: positive where the point is to the left of the way from start to end."""
    along, away = end - start, point - start
    return along[..., 0] * away[..., 1] - along[..., 1] * away[..., 0]
