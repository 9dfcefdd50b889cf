"""A simple polygon on the host: its area, what lies inside, how far a place is from its sides, where sides meet."""

import numpy as np
from jaxtyping import Bool, Float

Corners = Float[np.ndarray, "corner 2"]


def signed_area_m2(corners_m: Corners) -> float:
    """Area, positive where the corners run counter-clockwise."""
    shifted = corners_m - corners_m[0]
    return float(0.5 * np.sum(_cross(shifted, np.roll(shifted, -1, axis=0))))


def contains(corners_m: Corners, places_m: Float[np.ndarray, "place 2"]) -> Bool[np.ndarray, " place"]:
    """Whether places lie inside: an odd number of sides to their right. On a side itself it may be either."""
    inside = np.zeros(len(places_m), bool)
    x, y = places_m.T
    for low, high in zip(corners_m, np.roll(corners_m, -1, axis=0), strict=True):
        spans = (low[1] > y) != (high[1] > y)
        if spans.any():
            inside[spans] ^= x[spans] < low[0] + (y[spans] - low[1]) * (high[0] - low[0]) / (high[1] - low[1])
    return inside


def side_distance_m(corners_m: Corners, places_m: Float[np.ndarray, "place 2"]) -> Float[np.ndarray, " place"]:
    """Distance of places from the nearest side, inside or outside."""
    nearest = np.full(len(places_m), np.inf)
    for start, end in zip(corners_m, np.roll(corners_m, -1, axis=0), strict=True):
        side, away = end - start, places_m - start
        share = np.clip(away @ side / (side @ side), 0.0, 1.0)
        nearest = np.minimum(nearest, np.hypot(*(away - share[:, None] * side).T))
    return nearest


def outside_m(corners_m: Corners, places_m: Float[np.ndarray, "place 2"]) -> Float[np.ndarray, " place"]:
    """How far beyond the sides places lie; 0 inside."""
    return np.where(contains(corners_m, places_m), 0.0, side_distance_m(corners_m, places_m))


def first_crossing(corners_m: Corners) -> tuple[int, int] | None:
    """Numbers of two sides, from 0, that cross, touch or fold back on each other; ``None`` where the polygon is simple.

    Side k leads from corner k to the next one.
    """
    starts = corners_m - corners_m[0]
    ends = np.roll(starts, -1, axis=0)
    sides = ends - starts
    following = np.roll(sides, -1, axis=0)
    folded = (_cross(sides, following) == 0.0) & (np.sum(sides * following, axis=1) < 0.0)
    count = len(starts)
    if folded.any():
        side = int(np.argmax(folded))
        return side, (side + 1) % count
    low, high = np.minimum(starts, ends), np.maximum(starts, ends)
    for side in range(count - 2):
        others = slice(side + 2, count - 1 if side == 0 else count)
        near = np.all((low[others] <= high[side]) & (high[others] >= low[side]), axis=1)
        apart = _cross(sides[side], starts[others] - starts[side]) * _cross(sides[side], ends[others] - starts[side])
        across = _cross(sides[others], starts[side] - starts[others]) * _cross(
            sides[others], ends[side] - starts[others]
        )
        meets = near & (apart <= 0.0) & (across <= 0.0)
        if meets.any():
            return side, side + 2 + int(np.argmax(meets))
    return None


def _cross(a: Float[np.ndarray, "..."], b: Float[np.ndarray, "..."]) -> Float[np.ndarray, "..."]:
    return np.asarray(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0])
