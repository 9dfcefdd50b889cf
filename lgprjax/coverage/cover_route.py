"""The route of a coverage pattern as a table at even spacing, for guidance: the way of the vehicle's reference point.

Each row's curvature is the mean to the next row, so headings join exactly; where an arc begins within a row the place
is off by at most a quarter of the spacing's square over the arc's radius: 0.4 mm at 5 cm and 1.5 m. Rows are padded to
sizes from a ladder: another pattern of like length is the same to the compiler.
"""

import math
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int, Int32

from lgprjax.coverage.end_arcs import Pose, poses_along
from lgprjax.coverage.pattern import Pattern
from lgprjax.errors import InputError

SPACING_M = 0.05
LEAST_ROWS = 1024


class CoverRoute(NamedTuple):
    """A route in the plan's local frame.

    Attributes:
        rows: x_m, y_m, yaw_rad (not wrapped), curvature_radpm and tool_on (0 or 1) of the reference point, each good to
            the next row. The tool is on wherever a line has part of the row's way. Padding goes straight on, tool off.
        line: number, in driving order from 0, of the line that the row is on; -1 in turns and padding.
        spacing_m: from row to row.
        length_m: of the route.
        count: rows in use; the last is the route's end.
    """

    rows: Float[Array, "row 5"]
    line: Int32[Array, " row"]
    spacing_m: Float[Array, ""]
    length_m: Float[Array, ""]
    count: Int32[Array, ""]  # type: ignore[assignment]  # of rows, not the method of tuples


class RoutePoint(NamedTuple):
    """A point of the route.

    Attributes:
        x_m, y_m: of the reference point.
        yaw_rad: of the way, not wrapped.
        curvature_radpm: of the way, positive to the left.
        tool_on: 1 where the tool works, else 0.
        line: as in ``CoverRoute``.
    """

    x_m: Float[Array, "..."]
    y_m: Float[Array, "..."]
    yaw_rad: Float[Array, "..."]
    curvature_radpm: Float[Array, "..."]
    tool_on: Float[Array, "..."]
    line: Int[Array, "..."]


def lay_pattern(pattern: Pattern, *, spacing_m: float = SPACING_M) -> CoverRoute:
    """The route along a pattern: its lines and turns in driving order.

    Args:
        pattern: from ``plan_pattern`` or ``plan_gaps``.
        spacing_m: the spacing used is at most this, so that it divides the route.

    Raises:
        InputError: a spacing that is not above zero, or is longer than half the tightest radius.
    """
    longest_m = min(1.0, 0.5 * pattern.tightest_radius_m)
    if not 0.0 < spacing_m <= longest_m:
        raise InputError("route", "spacing_m", f"above 0 and at most {longest_m:.3f} m", f"{spacing_m:g}")
    ways = [np.array([[pattern.lines[0].length_m, 0.0]])]
    for turn, after in zip(pattern.turns, pattern.lines[1:], strict=True):
        ways += [turn.pieces, np.array([[after.length_m, 0.0]])]
    lengths_m = np.array([way[:, 0].sum() for way in ways])
    ends_m = np.cumsum(lengths_m)
    count = max(math.ceil(ends_m[-1] / spacing_m), 1) + 1
    step_m = float(ends_m[-1]) / (count - 1)
    size = LEAST_ROWS
    while size < count:
        size *= 2
    poses = poses_along(_route_start(pattern), np.concatenate(ways), step_m * np.arange(size))
    curvature = np.zeros(size)
    curvature[: count - 1] = np.diff(poses[:count, 2]) / step_m
    line = np.full(size, -1, np.int32)
    rounding = 1e-6
    for number in range(len(pattern.lines)):
        begin, end = ends_m[2 * number] - lengths_m[2 * number], ends_m[2 * number]
        line[math.floor(begin / step_m + rounding) : math.ceil(end / step_m - rounding)] = number
    rows = np.concatenate([poses, np.stack([curvature, line >= 0], axis=1)], axis=1)
    return CoverRoute(
        jnp.asarray(rows.astype(np.float32)),
        jnp.asarray(line),
        jnp.float32(step_m),
        jnp.float32(ends_m[-1]),
        jnp.int32(count),
    )


def route_point(route: CoverRoute, arc_m: Float[Array, "..."]) -> RoutePoint:
    """The route's point at an arc length; before 0 and after the end straight on, with the tool off.

    Args:
        route: from ``lay_pattern``.
        arc_m: along it, metres.
    """
    number = jnp.clip(jnp.floor(arc_m / route.spacing_m).astype(jnp.int32), 0, route.count - 1)
    beyond_m = arc_m - number.astype(arc_m.dtype) * route.spacing_m
    row = route.rows.at[number].get(mode="promise_in_bounds")
    # The last row is straight with the tool off, as is what lies before the first.
    on_route = arc_m >= 0.0
    curvature = jnp.where(on_route, row[..., 3], 0.0)
    half = 0.5 * beyond_m * curvature
    chord_m = beyond_m * jnp.sinc(half / jnp.pi)
    yaw = row[..., 2]
    return RoutePoint(
        row[..., 0] + chord_m * jnp.cos(yaw + half),
        row[..., 1] + chord_m * jnp.sin(yaw + half),
        yaw + 2.0 * half,
        curvature,
        jnp.where(on_route, row[..., 4], 0.0),
        jnp.where(on_route, route.line.at[number].get(mode="promise_in_bounds"), -1),
    )


def _route_start(pattern: Pattern) -> Pose:
    """Pose of the reference point where the first line begins."""
    first, settings = pattern.lines[0], pattern.settings
    ahead = (first.end_m - first.start_m) / first.length_m
    left = np.array([-ahead[1], ahead[0]])
    x, y = first.start_m - settings.tool_ahead_m * ahead - settings.tool_left_m * left
    return Pose(float(x), float(y), math.atan2(ahead[1], ahead[0]))
