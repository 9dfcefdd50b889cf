"""The fence of a field: what no part of the vehicle may cross. Host geometry; ``edge_ahead`` foretells with it."""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from lgprjax.coverage.cover_route import CoverRoute
from lgprjax.coverage.polygon import first_crossing, outside_m
from lgprjax.coverage.tool import Tool
from lgprjax.errors import InputError

FENCE_SLOTS = 32
"""Corners of a padded fence: fields of up to so many, those that were cut off counted, share a program."""
_LONGEST_MITRE = 2.0


def pad_fence(corners_m: Float[np.ndarray, "corner 2"]) -> Float[Array, "slot 2"]:
    """Corners as the step takes them: the last one repeated, which makes sides of no length.

    Raises:
        InputError: fewer than three corners, too many, something that is no number, or sides that cross.
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
    """A perimeter moved outwards by ``room_m``; corners that would stick out farther than twice that are cut off.

    Args:
        perimeter_m: counter-clockwise and simple.
        room_m: not negative.

    Raises:
        InputError: the sides moved outwards cross: a notch of the field is narrower than the room.
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
    """How far beyond a perimeter reference point and tool go on a route, metres: what a fence must leave them."""
    rows = np.asarray(route.rows, np.float64)[: int(route.count)]
    front, rear, left, right = (float(side) for side in vehicle_outline(tool, jnp.float32(0.0)))
    outline = np.array([(front, left), (rear, left), (rear, right), (front, right)])
    cos, sin = np.cos(rows[:, 2]), np.sin(rows[:, 2])
    places = [rows[:, :2] + np.stack([cos * x - sin * y, sin * x + cos * y], axis=1) for x, y in outline]
    return float(outside_m(np.asarray(perimeter_m, np.float64), np.concatenate(places)).max())


def fence_of_route(
    perimeter_m: Float[np.ndarray, "corner 2"], route: CoverRoute, tool: Tool, *, spare_m: float
) -> Float[Array, "slot 2"]:
    """The padded fence of a field: what its route needs beyond the perimeter, and ``spare_m`` more.

    The spare room must hold the margins of ``StopRules``, the way to a stop and the error of tracking: some 0.8 m.

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
