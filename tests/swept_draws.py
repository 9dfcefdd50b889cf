"""What a tool was over, by brute force: errors of the pose drawn, the rectangle moved, each place looked for in it.

Plain geometry in float64, apart from the code under test: a place is over when the rectangle is, at a way or an angle
between the beginning and the end of the pass that every side of the rectangle agrees to. The draws are Sobol's, whose
shares scatter several times less than those of as many random ones.
"""

import numpy as np
from jaxtyping import Float
from scipy.special import ndtri
from scipy.stats import qmc

from lgprjax.coverage import Tool

_AT_ONCE = 4096


def drawn_errors(covariance: Float[np.ndarray, "3 3"], power: int, seed: int) -> Float[np.ndarray, "draw 3"]:
    """Errors of x, y and yaw, two to the power of them."""
    standard = ndtri(qmc.Sobol(3, rng=np.random.default_rng(seed)).random_base2(power))
    return np.asarray(standard @ np.linalg.cholesky(covariance).T)


def straight_share(
    tool: Tool,
    start: tuple[float, float, float],
    length_m: float,
    errors: Float[np.ndarray, "draw 3"],
    places_m: Float[np.ndarray, "place 2"],
) -> Float[np.ndarray, " place"]:
    """Share of the draws in which a straight pass of the reference point took the tool over each place.

    Args:
        tool: its rectangle.
        start: pose of the reference point at the beginning, as it was estimated.
        length_m: of the pass.
        errors: of the pose, each held from the beginning to the end.
        places_m: east and north.
    """

    def hits(drawn: Float[np.ndarray, "part 3"]) -> Float[np.ndarray, " place"]:
        x, y, cos, sin = _seen_from(start, drawn, places_m)
        ahead, left = cos * x + sin * y - tool.ahead_m, cos * y - sin * x - tool.left_m
        by_front = _between((ahead - 0.5 * tool.length_m) / cos, (ahead + 0.5 * tool.length_m) / cos)
        by_side = _between((left - 0.5 * tool.width_m) / -sin, (left + 0.5 * tool.width_m) / -sin)
        low, high = np.maximum(by_front[0], by_side[0]), np.minimum(by_front[1], by_side[1])
        return np.asarray(np.sum(np.maximum(low, 0.0) <= np.minimum(high, length_m), axis=0, dtype=np.float64))

    return _share(hits, errors)


def arc_share(
    tool: Tool,
    start: tuple[float, float, float],
    radius_m: float,
    length_m: float,
    errors: Float[np.ndarray, "draw 3"],
    places_m: Float[np.ndarray, "place 2"],
) -> Float[np.ndarray, " place"]:
    """The same for an arc about a centre to the left (radius positive) or to the right; the tool is ahead."""
    turn, radius = np.sign(radius_m), abs(radius_m)

    def hits(drawn: Float[np.ndarray, "part 3"]) -> Float[np.ndarray, " place"]:
        x, y, _, _ = _seen_from(start, drawn, places_m)
        yaw = turn * drawn[:, 2, None]
        far, angle = np.hypot(x, radius - turn * y), np.arctan2(x, radius - turn * y)
        aside = radius * np.cos(yaw) - turn * tool.left_m
        front = [(tool.ahead_m + s * tool.length_m - radius * np.sin(yaw)) / far for s in (-0.5, 0.5)]
        side = [(aside - s * tool.width_m) / far for s in (-0.5, 0.5)]
        # A place farther from the centre than a side of the rectangle ever is has no angle there.
        by_front = [np.arcsin(np.clip(edge, -1.0, 1.0)) for edge in front]
        by_side = [np.arccos(np.clip(edge, -1.0, 1.0)) for edge in side]
        met = (side[1] < 1.0) & (side[0] > -1.0) & (front[0] < 1.0)
        low, high = np.maximum(by_front[0], by_side[0]), np.minimum(by_front[1], by_side[1])
        end = angle - yaw
        met &= np.maximum(low, end - length_m / radius) <= np.minimum(high, end)
        return np.asarray(np.sum(met, axis=0, dtype=np.float64))

    return _share(hits, errors)


def _seen_from(
    start: tuple[float, float, float], drawn: Float[np.ndarray, "part 3"], places_m: Float[np.ndarray, "place 2"]
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Places from the true start, along and left of the way; cosine and sine of the error of yaw."""
    x = places_m[None, :, 0] - start[0] - drawn[:, 0, None]
    y = places_m[None, :, 1] - start[1] - drawn[:, 1, None]
    cos, sin = np.cos(start[2]), np.sin(start[2])
    return cos * x + sin * y, cos * y - sin * x, np.cos(drawn[:, 2, None]), np.sin(drawn[:, 2, None])


def _between(one: np.ndarray, other: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return np.minimum(one, other), np.maximum(one, other)


def _share(hits, errors: Float[np.ndarray, "draw 3"]) -> Float[np.ndarray, " place"]:  # type: ignore[no-untyped-def]
    parts = [hits(errors[first : first + _AT_ONCE]) for first in range(0, len(errors), _AT_ONCE)]
    return np.asarray(sum(parts) / len(errors))
