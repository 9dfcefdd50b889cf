"""Circles through noisy points, many at once, with the straight line as one of them.

A circle is told by where it passes the origin and how it bends there: offset e along the left normal, direction θ and
curvature κ. With (ξ, η) the point in that frame its distance to the circle is

    d = (2η − κ(ξ² + η²)) / (1 + s),    s² = (1 − κη)² + (κξ)²,

positive towards the centre, and neither it nor its derivatives divide by κ.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

HUBER = 1.345
_STEPS = 10
_NEAR_M = 0.3
"""Of the median of five neighbours: far beyond the noise of positions worth a fit, below what misleads one."""
_PRATT = np.array([[0.0, 0.0, 0.0, -0.5], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [-0.5, 0.0, 0.0, 0.0]])


class Circles(NamedTuple):
    """Fitted circles; the origin of each is a point near the middle of its records.

    Attributes:
        offset_m, direction_rad, curvature_radpm: e, θ, κ; θ is the direction of motion, κ > 0 turns left.
        variance_m2: of a position across the circle, as it bears on the fit.
        covariance: of (e, θ, κ) for white noise of this variance.
        used: records that were points and no outliers beyond doubt.
        residual_m: d of every record; 0 where it is not used.
        tangent_rad: direction of motion on the circle at every record.
        arc_m: way along the circle at every record, from the origin.
        scatter_m: robust scale of the residuals.
    """

    offset_m: Float[np.ndarray, " arc"]
    direction_rad: Float[np.ndarray, " arc"]
    curvature_radpm: Float[np.ndarray, " arc"]
    variance_m2: Float[np.ndarray, " arc"]
    covariance: Float[np.ndarray, "arc 3 3"]
    used: Bool[np.ndarray, "arc record"]
    residual_m: Float[np.ndarray, "arc record"]
    tangent_rad: Float[np.ndarray, "arc record"]
    arc_m: Float[np.ndarray, "arc record"]
    scatter_m: Float[np.ndarray, " arc"]


def fit_circles(
    x_m: Float[np.ndarray, "arc record"], y_m: Float[np.ndarray, "arc record"], valid: Bool[np.ndarray, "arc record"]
) -> Circles:
    """Fit each row: algebraically (Pratt), then Gauss-Newton on the distances with Huber weights.

    Args:
        x_m, y_m: points in the order of motion, padded at the end.
        valid: those that are points; at least six a row.
    """
    rows, last = np.arange(len(x_m)), valid.sum(axis=1)[:, None] - 1
    middle = np.clip(last // 2 + np.arange(-2, 3)[None, :], 0, last)
    valid = _near_neighbours(x_m, y_m, valid)
    count = valid.sum(axis=1)
    x = np.where(valid, x_m - np.median(x_m[rows[:, None], middle], axis=1)[:, None], 0.0)
    y = np.where(valid, y_m - np.median(y_m[rows[:, None], middle], axis=1)[:, None], 0.0)
    offset, direction, curvature = _algebraic(x, y, valid)
    backward = _moves_backward(x, y, valid, offset, direction, curvature)
    turned = np.where(backward, -1.0, 1.0)
    offset, curvature, direction = offset * turned, curvature * turned, direction + np.where(backward, np.pi, 0.0)
    for _ in range(_STEPS):
        distance, slopes, _, _ = _distance(x, y, offset, direction, curvature)
        scale = _scale(distance, valid, count)
        weight = np.where(valid, np.minimum(1.0, HUBER * scale[:, None] / np.maximum(np.abs(distance), 1e-12)), 0.0)
        weighted = slopes * weight[..., None]
        step = np.linalg.solve(
            np.einsum("arp,arq->apq", weighted, slopes), np.einsum("arp,ar->ap", weighted, distance)[..., None]
        )[..., 0]
        offset, direction, curvature = offset - step[:, 0], direction - step[:, 1], curvature - step[:, 2]
    distance, slopes, tangent, arc = _distance(x, y, offset, direction, curvature)
    distance = np.where(valid, distance, 0.0)
    scale = _scale(distance, valid, count)
    variance, masked = _variance(distance, valid, count, scale), np.where(valid[..., None], slopes, 0.0)
    return Circles(
        offset,
        direction,
        curvature,
        variance,
        variance[:, None, None] * np.linalg.inv(np.einsum("arp,arq->apq", masked, masked)),
        valid,
        distance,
        tangent,
        arc,
        scale,
    )


def huber_spread(
    residual: Float[np.ndarray, "arc record"], valid: Bool[np.ndarray, "arc record"], scale: Float[np.ndarray, " arc"]
) -> tuple[Float[np.ndarray, "arc record"], Float[np.ndarray, " arc"]]:
    """Residuals clipped as Huber's weights clip them, and the share of them that is not clipped."""
    limit = HUBER * scale[:, None]
    inside = np.sum(valid & (np.abs(residual) <= limit), axis=1) / valid.sum(axis=1)
    return np.where(valid, np.clip(residual, -limit, limit), 0.0), inside


def _variance(
    distance: Float[np.ndarray, "arc record"],
    valid: Bool[np.ndarray, "arc record"],
    count: Int[np.ndarray, " arc"],
    scale: Float[np.ndarray, " arc"],
) -> Float[np.ndarray, " arc"]:
    """Huber's variance of an M-estimate for white noise, with his correction for few records."""
    clipped, inside = huber_spread(distance, valid, scale)
    correction = 1.0 + 3.0 / count * (1.0 - inside) / inside
    variance: Float[np.ndarray, " arc"] = np.sum(clipped**2, axis=1) / (count - 3) * (correction / inside) ** 2
    return variance


def _distance(
    x: Float[np.ndarray, "arc record"],
    y: Float[np.ndarray, "arc record"],
    offset: Float[np.ndarray, " arc"],
    direction: Float[np.ndarray, " arc"],
    curvature: Float[np.ndarray, " arc"],
) -> tuple[
    Float[np.ndarray, "arc record"],
    Float[np.ndarray, "arc record 3"],
    Float[np.ndarray, "arc record"],
    Float[np.ndarray, "arc record"],
]:
    """Distances, their derivatives by (e, θ, κ), tangents and ways."""
    cos, sin, bend = np.cos(direction)[:, None], np.sin(direction)[:, None], curvature[:, None]
    along, left = cos * x + sin * y, cos * y - sin * x - offset[:, None]
    aside, ahead = 1.0 - bend * left, bend * along
    reach = np.maximum(np.hypot(aside, ahead), 1e-9)
    distance = (2.0 * left - bend * (along**2 + left**2)) / (1.0 + reach)
    # On the far half of the circle the first form of the derivative by κ is 0/0, on the near half the second.
    near = aside > 0.0
    far_bend = np.where(near, 1.0, bend)
    by_curvature = np.where(
        near, -(along**2) / np.where(near, reach + aside, 1.0), -(reach - aside) / np.where(near, 1.0, far_bend**2)
    )
    slopes = np.stack([-aside, -(along + ahead * offset[:, None]), by_curvature], axis=-1) / reach[..., None]
    turned = np.arctan2(ahead, aside)
    straight = np.abs(turned) < 1e-9
    arc = np.where(straight, along, turned / np.where(np.abs(bend) < 1e-12, 1.0, bend))
    return distance, slopes, direction[:, None] + turned, arc


def _near_neighbours(
    x: Float[np.ndarray, "arc record"], y: Float[np.ndarray, "arc record"], valid: Bool[np.ndarray, "arc record"]
) -> Bool[np.ndarray, "arc record"]:
    """Points near the median of their neighbours. Clipping alone bears a point beyond an arc's ends badly: it pulls at
    a longer lever than any other, and squares, which the algebraic fit takes, bear no outlier at all."""
    at, last = np.arange(x.shape[1])[None, :], valid.sum(axis=1)[:, None] - 1
    # Mirrored at the ends of a row: the first and the last point bear on the curvature more than any other.
    mirrored = [np.maximum(last - np.abs(last - np.abs(at + step)), 0) for step in (-2, -1, 0, 1, 2)]
    away = np.zeros(x.shape)
    for axis in (x, y):
        around = np.sort(np.stack([np.take_along_axis(axis, index, axis=1) for index in mirrored]), axis=0)
        away = np.maximum(away, np.abs(axis - around[2]))
    spacing = row_median(np.hypot(np.diff(x, axis=1), np.diff(y, axis=1)), valid[:, 1:])
    kept = valid & (away < _NEAR_M + 2.0 * spacing[:, None])
    enough: Bool[np.ndarray, "arc record"] = np.where(kept.sum(axis=1)[:, None] >= 6, kept, valid)
    return enough


def _algebraic(
    x: Float[np.ndarray, "arc record"], y: Float[np.ndarray, "arc record"], valid: Bool[np.ndarray, "arc record"]
) -> tuple[Float[np.ndarray, " arc"], Float[np.ndarray, " arc"], Float[np.ndarray, " arc"]]:
    """Pratt's circle A(x² + y²) + Bx + Cy + D = 0 with B² + C² − 4AD = 1, as (e, θ, κ)."""
    size = np.sqrt(np.sum(x**2 + y**2, axis=1) / valid.sum(axis=1))[:, None]
    u, v = x / size, y / size
    columns = np.stack([u**2 + v**2, u, v, np.ones_like(u)], axis=-1) * valid[..., None]
    value, vector = np.linalg.eig(_PRATT @ np.einsum("arp,arq->apq", columns, columns))
    chosen = np.argmin(np.where(value.real > -1e-9, value.real, np.inf), axis=1)
    a, b, c, d = np.take_along_axis(vector.real, chosen[:, None, None], axis=2)[..., 0].T
    norm = np.sqrt(np.maximum(b**2 + c**2 - 4.0 * a * d, 1e-12))
    a, b, c, d = a / norm, b / norm, c / norm, d / norm
    slope = np.hypot(b, c)
    # The left normal points where the form falls: towards the centre for A > 0.
    direction = np.arctan2(b, -c)
    return 2.0 * d / (1.0 + slope) * size[:, 0], direction, 2.0 * a / size[:, 0]


def _moves_backward(
    x: Float[np.ndarray, "arc record"],
    y: Float[np.ndarray, "arc record"],
    valid: Bool[np.ndarray, "arc record"],
    offset: Float[np.ndarray, " arc"],
    direction: Float[np.ndarray, " arc"],
    curvature: Float[np.ndarray, " arc"],
) -> Bool[np.ndarray, " arc"]:
    """Whether most points go against the direction; compared over a third of the records, where noise matters least."""
    _, _, tangent, _ = _distance(x, y, offset, direction, curvature)
    lag = max(int(valid.sum(axis=1).min()) // 6, 1)
    ahead = np.cos(tangent[:, :-lag]) * (x[:, lag:] - x[:, :-lag]) + np.sin(tangent[:, :-lag]) * (
        y[:, lag:] - y[:, :-lag]
    )
    return np.asarray(np.sum(np.where(valid[:, lag:], np.sign(ahead), 0.0), axis=1) < 0.0)


def _scale(
    distance: Float[np.ndarray, "arc record"], valid: Bool[np.ndarray, "arc record"], count: Int[np.ndarray, " arc"]
) -> Float[np.ndarray, " arc"]:
    """Median absolute residual as a standard deviation, corrected for the three numbers fitted."""
    scale: Float[np.ndarray, " arc"] = np.maximum(
        1.4826 * row_median(np.abs(distance), valid) * np.sqrt(count / (count - 3.0)), 1e-9
    )
    return scale


def row_median(
    value: Float[np.ndarray, "arc record"], valid: Bool[np.ndarray, "arc record"]
) -> Float[np.ndarray, " arc"]:
    """Median of the valid entries of each row, of which there is at least one."""
    ordered = np.sort(np.where(valid, value, np.inf), axis=1)
    rows, count = np.arange(len(ordered)), valid.sum(axis=1)
    median: Float[np.ndarray, " arc"] = 0.5 * (ordered[rows, (count - 1) // 2] + ordered[rows, count // 2])
    return median
