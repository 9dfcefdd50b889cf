"""A path as a table over arc length: arcs of one length and constant curvature, continued straight beyond both ends.

Headings join by construction. Positions join exactly where a path was made of curvatures, and within a few hundredths
of a millimetre where it was laid through points. Arc length is float32: a path of ten kilometres still resolves a
millimetre.
"""

import math
from typing import Literal, NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from lgprjax.errors import InputError

SPACING_M = 0.25
"""Usual length of an arc of the table."""
_LEAST_POINTS = 3
_FINE = 16


class Path(NamedTuple):
    """A path in level local metres.

    Attributes:
        rows: x, y, cosine and sine of the heading at an arc's start, and its curvature. The first row leads straight up
            to the path's start, the last straight away from its end. One row holds all data of a look-up, because rows
            are fetched whole.
        spacing_m: length of an arc.
        length_m: length of the path.
        laps_per_m: inverse of the length for a closed path, 0 for an open one.
    """

    rows: Float[Array, "row 5"]
    spacing_m: Float[Array, ""]
    length_m: Float[Array, ""]
    laps_per_m: Float[Array, ""]


class PathPoint(NamedTuple):
    """A point of the path.

    Attributes:
        x_m, y_m: position.
        cos, sin: cosine and sine of its heading.
        curvature_radpm: curvature of its arc, positive to the left.
    """

    x_m: Float[Array, "..."]
    y_m: Float[Array, "..."]
    cos: Float[Array, "..."]
    sin: Float[Array, "..."]
    curvature_radpm: Float[Array, "..."]


class Projection(NamedTuple):
    """A point's position relative to the path.

    Attributes:
        arc_m: arc length of its foot point.
        offset_m: offset from the foot point, positive to the left of the path.
    """

    arc_m: Float[Array, "..."]
    offset_m: Float[Array, "..."]


def path_point(path: Path, arc_m: Float[Array, "..."]) -> PathPoint:
    """The path's point at an arc length; before 0 and after the end, on the straight continuation."""
    beyond, (x, y, cos, sin, curvature) = _fetch(path, arc_m)
    # An arc of the table turns by a few tenths of a radian at the most: series, no trigonometry.
    turn = curvature * beyond
    square = turn * turn
    along = beyond * (1.0 - square / 6.0 * (1.0 - square / 20.0))
    aside = beyond * turn * (0.5 - square / 24.0 * (1.0 - square / 30.0))
    turned_cos = 1.0 - square * (0.5 - square / 24.0)
    turned_sin = turn * (1.0 - square / 6.0 * (1.0 - square / 20.0))
    return PathPoint(
        x + cos * along - sin * aside,
        y + sin * along + cos * aside,
        cos * turned_cos - sin * turned_sin,
        sin * turned_cos + cos * turned_sin,
        curvature,
    )


def project(path: Path, near_m: Float[Array, "..."], x_m: Float[Array, "..."], y_m: Float[Array, "..."]) -> Projection:
    """Foot of a point, on the arc of the table at an arc length close to it.

    On that arc and its continuation as a circle the foot is exact. It does not search elsewhere on the path, so that
    the foot stays on its own branch where a path crosses itself; repeated calls with the previous result move on to the
    next arcs.

    Args:
        path: path to project on.
        near_m: arc length near the foot, from the last step.
        x_m, y_m: coordinates of the point.
    """
    beyond, (x, y, cos, sin, curvature) = _fetch(path, near_m)
    east, north = x_m - x, y_m - y
    along, aside = east * cos + north * sin, north * cos - east * sin
    # A point near the centre of curvature or beyond it has no foot on this arc; the result is bounded.
    share = jnp.maximum(1.0 - curvature * aside, 0.1)
    way = along / share
    angle = curvature * way
    square = angle * angle
    # Both lengths are quotients: XLA computes shared divisions once, other shared expressions again in every use.
    turned = curvature * along
    bent = aside - 0.5 * curvature * (along * along + aside * aside)
    offset = 2.0 * bent / (1.0 + jnp.sqrt(turned * turned + share * share))
    return Projection(near_m - beyond + way * (1.0 - square * (1.0 / 3.0 - square / 5.0)), offset)


def _fetch(path: Path, arc_m: Float[Array, "..."]) -> tuple[Float[Array, "..."], tuple[Float[Array, "..."], ...]]:
    """Distance of an arc length beyond the start of its row, and the row."""
    lap_m = arc_m - jnp.floor(arc_m * path.laps_per_m) * path.length_m
    row = jnp.clip(jnp.floor(lap_m / path.spacing_m).astype(jnp.int32) + 1, 0, len(path.rows) - 1)
    beyond = lap_m - jnp.maximum(row - 1, 0).astype(arc_m.dtype) * path.spacing_m
    fetched = path.rows.at[row].get(mode="promise_in_bounds")
    return beyond, tuple(fetched[..., column] for column in range(5))


def path_from_curvature(
    curvature_radpm: Float[np.ndarray, " arc"],
    *,
    spacing_m: float = SPACING_M,
    start: tuple[float, float, float] = (0.0, 0.0, 0.0),
    closed: bool = False,
) -> Path:
    """A path of consecutive arcs of one length.

    Args:
        curvature_radpm: curvature of each arc.
        spacing_m: length of each arc.
        start: x_m, y_m and heading in radians of the start.
        closed: whether the path ends at its start, as the curvatures must ensure to a millimetre.

    Raises:
        InputError: there are no arcs, numbers are not finite, an arc turns by more than half a radian, or a closed path
            does not end at its start.
    """
    curvature = np.asarray(curvature_radpm, np.float64)
    if len(curvature) == 0 or not np.all(np.isfinite(curvature)):
        raise InputError("path", "curvatures", "at least one, all finite", f"{len(curvature)} arcs")
    turn = curvature * spacing_m
    if np.abs(turn).max() > 0.5:
        raise InputError("path", "curvatures", "at most 0.5 rad an arc", f"{np.abs(turn).max():.2f} rad")
    heading = start[2] + np.concatenate([[0.0], np.cumsum(turn)])
    chord_m = spacing_m * np.sinc(turn / (2.0 * np.pi))
    middle = heading[:-1] + turn / 2.0
    x = start[0] + np.concatenate([[0.0], np.cumsum(chord_m * np.cos(middle))])
    y = start[1] + np.concatenate([[0.0], np.cumsum(chord_m * np.sin(middle))])
    if closed and np.hypot(x[-1] - x[0], y[-1] - y[0]) > 1e-3:
        raise InputError(
            "path", "end", "the start, for a closed path", f"{x[-1] - x[0]:.3f}, {y[-1] - y[0]:.3f} m away"
        )
    return _table(x, y, heading, curvature, spacing_m, closed)


def path_from_points(
    points_m: Float[np.ndarray, "point 2"], *, spacing_m: float = SPACING_M, closed: bool = False
) -> Path:
    """A path through points: cubic pieces whose headings join, resampled to arcs of one length.

    Points closer together than half an arc are thinned, so that centimetres of noise do not affect the heading.
    Positions follow the noise only as far as the pieces do: a noisier log should be smoothed first.

    Args:
        points_m: points in driving order; a closed path's first point is not repeated at its end.
        spacing_m: wanted length of an arc; the length used divides the path.
        closed: whether the last point leads to the first.

    Raises:
        InputError: there are fewer than three separate points, or numbers are not finite.
    """
    points = np.asarray(points_m, np.float64)
    if not np.all(np.isfinite(points)):
        place = int(np.flatnonzero(~np.all(np.isfinite(points), axis=1))[0])
        raise InputError("path", f"point {place}", "finite numbers", f"{points[place].tolist()}")
    points = _thin(points, 0.5 * spacing_m, closed)
    if len(points) < _LEAST_POINTS:
        raise InputError("path", "points", f"at least {_LEAST_POINTS} distinct points", f"{len(points)}")
    fine_m, fine, direction = _cubic_pieces(points, closed)
    count = max(round(float(fine_m[-1]) / spacing_m), 1)
    arcs_m = np.linspace(0.0, fine_m[-1], count + 1)
    x, y = np.interp(arcs_m, fine_m, fine[:, 0]), np.interp(arcs_m, fine_m, fine[:, 1])
    heading = np.interp(arcs_m, fine_m, np.unwrap(np.arctan2(direction[:, 1], direction[:, 0])))
    step_m = float(fine_m[-1]) / count
    return _table(x, y, heading, np.diff(heading) / step_m, step_m, closed)


def _table(
    x: Float[np.ndarray, " knot"],
    y: Float[np.ndarray, " knot"],
    heading: Float[np.ndarray, " knot"],
    curvature: Float[np.ndarray, " arc"],
    spacing_m: float,
    closed: bool,
) -> Path:
    rows = np.stack([x, y, np.cos(heading), np.sin(heading), np.append(curvature, 0.0)], axis=-1)
    before = np.append(rows[0, :4], 0.0)
    length_m = spacing_m * len(curvature)
    return Path(
        jnp.asarray(np.concatenate([before[None], rows]).astype(np.float32)),
        jnp.float32(spacing_m),
        jnp.float32(length_m),
        jnp.float32(1.0 / length_m if closed else 0.0),
    )


def _thin(points: Float[np.ndarray, "point 2"], least_m: float, closed: bool) -> Float[np.ndarray, "kept 2"]:
    """The points without those too close to the last one kept; the end stays unless the path is closed."""
    kept = [0]
    for place in range(1, len(points)):
        if np.hypot(*(points[place] - points[kept[-1]])) >= least_m:
            kept.append(place)
    if closed and len(kept) > 1 and np.hypot(*(points[kept[-1]] - points[0])) < least_m:
        kept.pop()
    if not closed and len(kept) > 1:
        kept[-1] = len(points) - 1
    return points[kept]


def _cubic_pieces(
    points: Float[np.ndarray, "point 2"], closed: bool
) -> tuple[Float[np.ndarray, " fine"], Float[np.ndarray, "fine 2"], Float[np.ndarray, "fine 2"]]:
    """Arc length, position and derivative along cubic pieces over chord length, each cut in ``_FINE`` parts.

    The derivative at a point is that of the parabola through it and its two neighbours.
    """
    around = np.concatenate([points[-1:], points, points[:2]]) if closed else points
    chord = np.hypot(*np.diff(around, axis=0).T)
    slope = np.diff(around, axis=0) / chord[:, None]
    before, after = chord[:-1, None], chord[1:, None]
    inner = (slope[:-1] * after + slope[1:] * before) / (before + after)
    if closed:
        around, chord, tangents = around[1:-1], chord[1:-1], inner
    else:
        tangents = np.concatenate([2.0 * slope[:1] - inner[:1], inner, 2.0 * slope[-1:] - inner[-1:]])
    u = (np.arange(len(chord) * _FINE) % _FINE / _FINE)[:, None]
    piece = np.repeat(np.arange(len(chord)), _FINE)
    # The end belongs to the last piece, at u = 1.
    u, piece = np.concatenate([u, [[1.0]]]), np.append(piece, len(chord) - 1)
    low, high, wide = around[piece], around[piece + 1], chord[piece][:, None]
    at_low, at_high = tangents[piece] * wide, tangents[piece + 1] * wide
    position = low * (1 + 2 * u) * (1 - u) ** 2 + high * (3 - 2 * u) * u**2
    position += at_low * u * (1 - u) ** 2 - at_high * (1 - u) * u**2
    derivative = 6 * u * (1 - u) * (high - low) + at_low * (1 - u) * (1 - 3 * u) + at_high * u * (3 * u - 2)
    step = np.hypot(*np.diff(position, axis=0).T)
    return np.concatenate([[0.0], np.cumsum(step)]), position, derivative / wide


# The tangent of a wheel angle as a quotient of polynomials, which a compiler can vectorise.


def tangent(angle_rad: Float[Array, "..."]) -> Float[Array, "..."]:
    """tan by its continued fraction, truncated after the fifth term.

    Accurate to 3e-7 of its value, the rounding of float32, up to 1 rad; to 1e-5 up to 1.3 rad (74°), beyond any wheel's
    angle.
    """
    square = angle_rad * angle_rad
    return angle_rad * (945.0 - square * (105.0 - square)) / (945.0 - square * (420.0 - 15.0 * square))


# Test courses: line, arc, curve with clothoids, figure of eight.
#
# A logged route is a course too: ``path_from_points``.

Hand = Literal["left", "right"]
_EIGHT_POINTS = 800


def line_course(length_m: float, *, heading_rad: float = 0.0) -> Path:
    """A straight line from the origin.

    Raises:
        InputError: a length that is not positive.
    """
    _check_positive("length_m", length_m)
    count = max(round(length_m / SPACING_M), 1)
    return path_from_curvature(np.zeros(count), spacing_m=length_m / count, start=(0.0, 0.0, heading_rad))


def arc_course(radius_m: float, turn_rad: float, hand: Hand = "left") -> Path:
    """An arc of one radius from the origin, eastward at its start. A whole turn is closed and repeats.

    Raises:
        InputError: radius or turn not positive, or a radius below half a metre.
    """
    _check_radius(radius_m)
    _check_positive("turn_rad", turn_rad)
    whole = math.isclose(turn_rad, 2.0 * math.pi)
    length_m = radius_m * turn_rad
    count = max(math.ceil(length_m / SPACING_M), 1)
    curvature = np.full(count, _sign(hand) / radius_m)
    return path_from_curvature(curvature, spacing_m=length_m / count, closed=whole)


def clothoid_course(
    radius_m: float, turn_rad: float, clothoid_m: float, hand: Hand = "left", *, straight_m: float = 20.0
) -> Path:
    """Straight, clothoid into an arc, clothoid out of it, straight: a road curve.

    Args:
        radius_m: radius of the arc.
        turn_rad: turn of the whole curve, clothoids included.
        clothoid_m: length of each clothoid, in which curvature grows in proportion to the distance.
        hand: side of the turn.
        straight_m: length of the straights before and after.

    Raises:
        InputError: a length is not positive, or the clothoids turn by more than the whole curve.
    """
    _check_radius(radius_m)
    for name, value in (("turn_rad", turn_rad), ("clothoid_m", clothoid_m), ("straight_m", straight_m)):
        _check_positive(name, value)
    arc_m = radius_m * turn_rad - clothoid_m
    if arc_m < 0.0:
        found = f"{clothoid_m:g} m, which turn by {clothoid_m / radius_m:.3f} rad"
        raise InputError("course", "clothoid_m", f"clothoids that turn by at most {turn_rad:.3f} rad", found)
    ends_m = np.cumsum([straight_m, clothoid_m, arc_m, clothoid_m, straight_m])
    count = math.ceil(ends_m[-1] / SPACING_M)
    step_m = float(ends_m[-1]) / count
    knots_m = np.linspace(0.0, ends_m[-1], count + 1)
    # The mean curvature of each arc of the table, from differences of its integral, so that the whole turn is exact.
    profile_m = np.unique(np.concatenate([[0.0], ends_m, knots_m]))
    shape = np.interp(profile_m, np.concatenate([[0.0], ends_m]), [0.0, 0.0, 1.0, 1.0, 0.0, 0.0])
    turned = np.concatenate([[0.0], np.cumsum(np.diff(profile_m) * 0.5 * (shape[1:] + shape[:-1]))]) / radius_m
    curvature = _sign(hand) * np.diff(np.interp(knots_m, profile_m, turned)) / step_m
    return path_from_curvature(curvature, spacing_m=step_m)


def eight_course(least_radius_m: float) -> Path:
    """A closed lemniscate that crosses itself at the origin; its curvature runs through zero there.

    Raises:
        InputError: a radius below half a metre.
    """
    _check_radius(least_radius_m)
    angle = np.linspace(0.0, 2.0 * np.pi, _EIGHT_POINTS, endpoint=False)
    # Bernoulli's: the least radius is a third of the half width.
    scale = 3.0 * least_radius_m / (1.0 + np.sin(angle) ** 2)
    points = np.stack([scale * np.cos(angle), scale * np.sin(angle) * np.cos(angle)], axis=-1)
    return path_from_points(points, closed=True)


def _sign(hand: Hand) -> float:
    return 1.0 if hand == "left" else -1.0


def _check_positive(name: str, value: float) -> None:
    if not (math.isfinite(value) and value > 0.0):
        raise InputError("course", name, "a positive number", f"{value:g}")


def _check_radius(radius_m: float) -> None:
    if not (math.isfinite(radius_m) and radius_m >= 2.0 * SPACING_M):
        raise InputError("course", "radius", f"at least {2.0 * SPACING_M:g} m", f"{radius_m:g} m")
