"""The fence of a field, which no part of the vehicle may cross: host geometry, and prediction (``edge_ahead``)."""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from lgprjax.coverage.field import Tool, first_crossing, outside_m
from lgprjax.coverage.guidance import CoverRoute
from lgprjax.errors import InputError
from lgprjax.vehicle.kinematics import VehiclePose, WheelSpeeds, drive_skid_arc

FENCE_SLOTS = 32
"""Corners of a padded fence: fields of up to this many, including bevelled ones, share a program."""
_LONGEST_MITRE = 2.0


def pad_fence(corners_m: Float[np.ndarray, "corner 2"]) -> Float[Array, "slot 2"]:
    """Corners padded for the step: the last one is repeated, which makes sides of no length.

    Raises:
        InputError: fewer than three corners, too many, non-finite numbers, or sides that cross.
    """
    corners = np.asarray(corners_m, np.float64)
    if not 3 <= len(corners) <= FENCE_SLOTS:
        raise InputError("fence", "corners", f"3 to {FENCE_SLOTS}", f"{len(corners)}")
    if not np.isfinite(corners).all():
        raise InputError("fence", "corners", "numbers", "others")
    if first_crossing(corners) is not None:
        raise InputError("fence", "sides", "sides that do not cross", "two that do")
    padding = np.repeat(corners[-1:], FENCE_SLOTS - len(corners), axis=0)
    return jnp.asarray(np.concatenate([corners, padding]).astype(np.float32))


def fence_around(perimeter_m: Float[np.ndarray, "corner 2"], room_m: float) -> Float[np.ndarray, "side 2"]:
    """A perimeter offset outward by ``room_m``; corners that would extend farther than twice that are bevelled.

    Args:
        perimeter_m: counter-clockwise and simple.
        room_m: not negative.

    Raises:
        InputError: the offset sides cross: a notch of the field is narrower than the room.
    """
    points = np.asarray(perimeter_m, np.float64)
    ahead = np.roll(points, -1, axis=0) - points
    ahead /= np.hypot(*ahead.T)[:, None]
    grown: list[Float[np.ndarray, 2]] = []
    for corner, before, after in zip(points, np.roll(ahead, 1, axis=0), ahead, strict=True):
        turn = float(before[0] * after[1] - before[1] * after[0])
        share = 1.0 + float(before @ after)
        out_before, out_after = np.array([before[1], -before[0]]), np.array([after[1], -after[0]])
        # The mitre is longer than the room by the root of two over the share.
        if turn > 0.0 and share < 2.0 / _LONGEST_MITRE**2:
            grown += [corner + room_m * (out_before + before), corner + room_m * (out_after - after)]
        else:
            grown.append(corner + room_m * (out_before + out_after) / share)
    fence = np.array(grown)
    if first_crossing(fence) is not None:
        raise InputError("fence", "room", "less than the notches of the field are wide", f"{room_m:.2f} m")
    return fence


def room_of_route(perimeter_m: Float[np.ndarray, "corner 2"], route: CoverRoute, tool: Tool) -> float:
    """Largest distance of reference point and tool beyond a perimeter on a route, metres: the room that a fence must
    leave.
    """
    rows = np.asarray(route.rows, np.float64)[: int(route.count)]
    front, rear, left, right = (float(side) for side in vehicle_outline(tool, jnp.float32(0.0)))
    outline = np.array([(front, left), (rear, left), (rear, right), (front, right)])
    cos, sin = np.cos(rows[:, 2]), np.sin(rows[:, 2])
    places = [rows[:, :2] + np.stack([cos * x - sin * y, sin * x + cos * y], axis=1) for x, y in outline]
    return float(outside_m(np.asarray(perimeter_m, np.float64), np.concatenate(places)).max())


def fence_of_route(
    perimeter_m: Float[np.ndarray, "corner 2"], route: CoverRoute, tool: Tool, *, spare_m: float
) -> Float[Array, "slot 2"]:
    """The padded fence of a field: the room that its route needs beyond the perimeter, plus ``spare_m``.

    The spare room must hold the margins of ``StopRules``, the stopping distance and the tracking error: some 0.8 m.

    Raises:
        InputError: as ``fence_around`` and ``pad_fence``.
    """
    return pad_fence(fence_around(perimeter_m, room_of_route(perimeter_m, route, tool) + spare_m))


def vehicle_outline(
    tool: Tool, margin_m: Float[Array, "..."]
) -> tuple[Float[Array, "..."], Float[Array, "..."], Float[Array, "..."], Float[Array, "..."]]:
    """Front, rear, left and right of the rectangle that holds reference point and tool, grown by a margin."""
    return (
        jnp.maximum(tool.ahead_m + 0.5 * tool.length_m, 0.0) + margin_m,
        jnp.minimum(tool.ahead_m - 0.5 * tool.length_m, 0.0) - margin_m,
        jnp.maximum(tool.left_m + 0.5 * tool.width_m, 0.0) + margin_m,
        jnp.minimum(tool.left_m - 0.5 * tool.width_m, 0.0) - margin_m,
    )


# Whether a stop from here would cross the fence (fault 36), checked in each step.
#
# The stop is predicted: along an arc for the reaction time, then braked. At places along it the rectangle that holds
# reference point and tool, grown by a margin, must lie within the fence. It does so exactly where no side of it crosses
# a side of the fence and one corner is inside.

_PLACES = 12


class StopRules(NamedTuple):
    """Model of a stop; float32 scalars.

    Attributes:
        reaction_s: time until it begins to slow down: age of the pose, tick, delay and lag of the wheels.
        stop_mps2: deceleration of the faster wheel then.
        margin_m: to the fence, in addition to the pose's uncertainty.
        sigmas: number of sigmas of the position taken as uncertainty.
    """

    reaction_s: Float[Array, "..."]
    stop_mps2: Float[Array, "..."]
    margin_m: Float[Array, "..."]
    sigmas: Float[Array, "..."]


def edge_ahead(
    rules: StopRules,
    fence: Float[Array, "slot 2"],
    tool: Tool,
    track_m: Float[Array, ""],
    pose: VehiclePose,
    wheels: WheelSpeeds,
    sigma_m: Float[Array, ""],
) -> Bool[Array, ""]:
    """Whether reference point or tool would cross the fence before the vehicle stands, if it were stopped now.

    Also true if they are beyond the fence already, or if anything is not finite. Unbatched.

    Args:
        rules: of the stop.
        fence: from ``pad_fence``.
        tool: its rectangle.
        track_m: effective.
        pose: of the reference point.
        wheels: as commanded or as measured: their arc is held to the end.
        sigma_m: of the position.
    """
    fastest = jnp.maximum(jnp.abs(wheels.left_mps), jnp.abs(wheels.right_mps))
    # At constant initial speed the braking distance takes half of its time.
    rolling_s = rules.reaction_s + 0.5 * fastest / rules.stop_mps2
    shares = jnp.linspace(0.0, 1.0, _PLACES, dtype=jnp.float32)
    reached = drive_skid_arc(pose, track_m, wheels, shares * rolling_s)
    front, rear, left, right = vehicle_outline(tool, rules.margin_m + rules.sigmas * sigma_m)
    ahead, aside = jnp.stack([front, rear, rear, front])[None], jnp.stack([left, left, right, right])[None]
    cos, sin = jnp.cos(reached.yaw_rad)[:, None], jnp.sin(reached.yaw_rad)[:, None]
    corners = jnp.stack(
        [reached.x_m[:, None] + cos * ahead - sin * aside, reached.y_m[:, None] + sin * ahead + cos * aside], axis=-1
    )
    within = _inside(fence, corners[:, 0]) & ~_sides_cross(fence, corners)
    return ~jnp.all(within & jnp.isfinite(corners).all((1, 2)))


def _inside(fence: Float[Array, "slot 2"], points: Float[Array, "place 2"]) -> Bool[Array, " place"]:
    """By the even-odd rule; sides of no length do not count."""
    x, y = points[:, :1], points[:, 1:]
    start, end = fence[None], jnp.roll(fence, -1, axis=0)[None]
    spans = (start[..., 1] > y) != (end[..., 1] > y)
    rise = jnp.where(spans, end[..., 1] - start[..., 1], 1.0)
    crossing = start[..., 0] + (y - start[..., 1]) * (end[..., 0] - start[..., 0]) / rise
    return jnp.sum(spans & (x < crossing), axis=1) % 2 == 1


def _sides_cross(fence: Float[Array, "slot 2"], corners: Float[Array, "place 4 2"]) -> Bool[Array, " place"]:
    """Whether a side of a rectangle crosses or touches a side of the fence."""
    a, b = corners[:, :, None], jnp.roll(corners, -1, axis=1)[:, :, None]
    c, d = fence[None, None], jnp.roll(fence, -1, axis=0)[None, None]
    apart = (_beside(a, b, c) * _beside(a, b, d) > 0.0) | (_beside(c, d, a) * _beside(c, d, b) > 0.0)
    return jnp.any(~apart & jnp.any(c != d, axis=-1), axis=(1, 2))


def _beside(start: Float[Array, "..."], end: Float[Array, "..."], point: Float[Array, "..."]) -> Float[Array, "..."]:
    """Twice the area of the triangle: positive where the point is to the left of the way from start to end."""
    along, away = end - start, point - start
    return along[..., 0] * away[..., 1] - along[..., 1] * away[..., 0]
