"""Arcs of a drive: the curvature of each stretch of constant steering, and how the body stood on it."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from lgprjax.tuning.circle import Circles, fit_circles, huber_spread, row_median
from lgprjax.tuning.estimate import NotExcitedError
from lgprjax.tuning.stretches import Stretches, choose_stretches
from lgprjax.vehicle.signals import DriveSignals

_BROKEN = 3.0
"""Scatter about an arc, over that of the drive's arcs, above which it is none: a jump of the positions."""
_LONGEST_MEMORY = 100
_FIRST_LAGS = 10
_FEW_PAIRS = 50
_SEEN = 2.5
"""Serial correlation of residuals: records over which it is summed at most, those that show whether there is any, the
pairs that this wants, and the standard deviations from which it is believed."""


class Arcs(NamedTuple):
    """An arc a stretch. Signs are the body's: a left turn is positive, in reverse too.

    Attributes:
        stretches: that they were fitted to; broken ones are left out, and counted.
        curvature_radpm, sigma_radpm: of the rear axle's path, and its standard error.
        slip_rad, sigma_slip_rad: direction of the rear axle's path, forward along the body, less the INS heading, and
            its standard error for a heading of white noise; not a number without headings.
        speed_mps: of the rear axle along the arc, from positions, positive; its mean square with the weights that the
            fitted curvature gives to the parts of the arc.
        time_s: in the middle.
        scatter_m: robust scale of the positions about the arc.
        memory, heading_memory: records that stand for one, positions and headings being serially correlated: 1 for
            white noise.
    """

    stretches: Stretches
    curvature_radpm: Float[np.ndarray, " stretch"]
    sigma_radpm: Float[np.ndarray, " stretch"]
    slip_rad: Float[np.ndarray, " stretch"]
    sigma_slip_rad: Float[np.ndarray, " stretch"]
    speed_mps: Float[np.ndarray, " stretch"]
    time_s: Float[np.ndarray, " stretch"]
    scatter_m: Float[np.ndarray, " stretch"]
    memory: float
    heading_memory: float


def fit_arcs(signals: DriveSignals, stretches: Stretches) -> Arcs:
    """Fit a circle to the positions of each stretch.

    Args:
        signals: of the drive.
        stretches: of constant steering.

    Raises:
        NotExcitedError: no stretch is an arc.
    """
    longest = np.arange(int(np.max(stretches.stop - stretches.start)))[None, :]
    record = np.minimum(stretches.start[:, None] + longest, len(signals.time_s) - 1)
    inside = longest < (stretches.stop - stretches.start)[:, None]
    fixed = inside & np.isfinite(signals.east_m + signals.north_m)[record]
    # Fixes to the front of each row: GNSS is slower than the log.
    order = np.argsort(~fixed, axis=1, kind="stable")[:, : int(fixed.sum(axis=1).max())]
    record, fixed = np.take_along_axis(record, order, axis=1), np.take_along_axis(fixed, order, axis=1)
    circles = fit_circles(signals.east_m[record], signals.north_m[record], fixed)
    whole = circles.scatter_m <= _BROKEN * max(
        float(np.median(circles.scatter_m)), float(np.nanmedian(signals.sigma_position_m))
    )
    if not whole.any():
        raise NotExcitedError("positions", "arcs without jumps", f"none in {len(whole)} stretches")
    kept = choose_stretches(stretches, whole, "positions not on one arc")
    circles = Circles(*(column[whole] for column in circles))
    record, time_s = record[whole], signals.time_s[record[whole]]
    clipped, _ = huber_spread(circles.residual_m, circles.used, circles.scatter_m)
    memory = serial_memory(clipped / circles.scatter_m[:, None], circles.used, 3)
    way_m = _unwound(circles)
    count = circles.used.sum(axis=1)
    middle_m = np.sum(np.where(circles.used, way_m, 0.0), axis=1) / count
    slip, sigma_heading, heading_memory = _slips(
        signals.yaw_rad[record], circles, way_m - middle_m[:, None], kept.sense
    )
    # One receiver, one noise: few records of a short arc say less of it than the whole drive.
    pooled = float(np.sum((count - 3) * circles.variance_m2) / np.sum(count - 3))
    covariance = memory * circles.covariance * (pooled / circles.variance_m2)[:, None, None]
    sigma_tangent = np.sqrt(
        covariance[:, 1, 1] + 2.0 * middle_m * covariance[:, 1, 2] + middle_m**2 * covariance[:, 2, 2]
    )
    return Arcs(
        kept,
        kept.sense * circles.curvature_radpm,
        np.sqrt(covariance[:, 2, 2]),
        slip,
        np.hypot(sigma_heading, sigma_tangent),
        _paces(way_m, time_s, circles.used) * _unevenness(signals.travel_m[record], time_s, circles.used),
        np.sum(np.where(circles.used, time_s, 0.0), axis=1) / count,
        circles.scatter_m,
        memory,
        heading_memory,
    )


def choose_arcs(arcs: Arcs, keep: Bool[np.ndarray, " all"], reason: str) -> Arcs:
    """Those that are to be kept; the others are counted under a reason."""
    columns = {name: getattr(arcs, name)[keep] for name in Arcs._fields[1:-2]}
    return arcs._replace(stretches=choose_stretches(arcs.stretches, keep, reason), **columns)


def serial_memory(
    residual: Float[np.ndarray, "row record"], valid: Bool[np.ndarray, "row record"], fitted: int
) -> float:
    """1 + 2 Σρ of residuals of equally spaced records, until ρ is lost in its noise; 1 where there is no memory to see.

    Args:
        residual: each row about a fit of its own.
        valid: residuals that are some.
        fitted: numbers fitted to a row: they make the residuals of one row repel each other.
    """
    residual = np.where(valid, residual, 0.0)
    mean_square = float(np.sum(residual**2)) / max(int(valid.sum()), 1)
    repelled = fitted / float(np.mean(valid.sum(axis=1)))
    lags = range(1, min(_LONGEST_MEMORY, valid.shape[1] // 2) + 1)
    pairs = np.array([np.sum(valid[:, lag:] & valid[:, :-lag]) for lag in lags])
    if len(pairs) < _FIRST_LAGS or pairs[_FIRST_LAGS - 1] < _FEW_PAIRS or mean_square == 0.0:
        return 1.0
    product = np.array([np.sum(residual[:, lag:] * residual[:, :-lag]) for lag in lags])
    rho = product / np.maximum(pairs, 1) / mean_square + repelled
    noise = 1.0 / np.sqrt(np.maximum(pairs, 1))
    # A weak memory that lasts shows in the first few together, a short one in the first alone.
    together = float(np.sum(rho[:_FIRST_LAGS]) / np.sqrt(np.sum(noise[:_FIRST_LAGS] ** 2)))
    if max(rho[0] / noise[0], together) < _SEEN:
        return 1.0
    lost = rho < noise
    last = int(np.argmax(lost)) if lost.any() else len(rho)
    return 1.0 + 2.0 * float(np.sum(rho[:last]))


def _unwound(circles: Circles) -> Float[np.ndarray, "arc record"]:
    """Way along the circle at every used record, counted on over full turns."""
    count = circles.used.shape[1]
    last_used = np.maximum.accumulate(np.where(circles.used, np.arange(count)[None, :], 0), axis=1)
    turned = np.unwrap(np.take_along_axis(circles.tangent_rad, last_used, axis=1), axis=1)
    bent = np.abs(circles.curvature_radpm) > 1e-6
    way = (turned - circles.direction_rad[:, None]) / np.where(bent, circles.curvature_radpm, 1.0)[:, None]
    # Unwrapping may have begun whole turns away from the origin of the circle, which lies in the middle.
    whole = 2.0 * np.pi / np.maximum(np.abs(circles.curvature_radpm), 1e-12)
    way -= (np.round(row_median(way, circles.used) / whole) * whole)[:, None]
    return np.where(bent[:, None], way, circles.arc_m)


def _slips(
    yaw_rad: Float[np.ndarray, "arc record"],
    circles: Circles,
    from_middle_m: Float[np.ndarray, "arc record"],
    sense: Float[np.ndarray, " arc"],
) -> tuple[Float[np.ndarray, " arc"], Float[np.ndarray, " arc"], float]:
    """Path direction less heading in the middle of each arc, its standard error by the heading's scatter, and memory.

    A wrong curvature makes the difference run along the arc: its slope is fitted and let go.
    """
    known = circles.used & np.isfinite(yaw_rad)
    enough = known.sum(axis=1) >= 6
    if not enough.any():
        return np.full(len(sense), np.nan), np.full(len(sense), np.nan), 1.0
    known = np.where(enough[:, None], known, circles.used)
    raw = circles.tangent_rad - np.where(known, yaw_rad, 0.0) + np.where(sense > 0, 0.0, np.pi)[:, None]
    # About the mean direction, not about zero: half a turn wraps either way.
    about = np.angle(np.sum(np.where(known, np.exp(1j * raw), 0.0), axis=1))
    single = np.remainder(raw - about[:, None] + np.pi, 2.0 * np.pi) - np.pi
    lever = np.where(known, from_middle_m, 0.0)
    count, square = known.sum(axis=1), np.sum(lever**2, axis=1)
    centre, slope = row_median(single, known), np.zeros(len(sense))
    for _ in range(6):
        away = single - centre[:, None] - slope[:, None] * lever
        scale = np.maximum(1.4826 * row_median(np.abs(away), known), 1e-9)
        clipped, inside = huber_spread(away, known, scale)
        centre = centre + clipped.sum(axis=1) / count / inside
        slope = slope + np.sum(lever * clipped, axis=1) / square / inside
    memory = serial_memory(clipped[enough] / scale[enough, None], known[enough], 2)
    sigma = np.sqrt(memory * np.sum(clipped**2, axis=1) / (count - 2) / count) / inside
    slip = np.remainder(centre + about + np.pi, 2.0 * np.pi) - np.pi
    return np.where(enough, slip, np.nan), np.where(enough, sigma, np.nan), memory


def _paces(
    way_m: Float[np.ndarray, "arc record"],
    time_s: Float[np.ndarray, "arc record"],
    used: Bool[np.ndarray, "arc record"],
) -> Float[np.ndarray, " arc"]:
    """Mean speed from the first third to the last; medians, so that outliers along the arc have no say."""
    rank, count = np.cumsum(used, axis=1), used.sum(axis=1)[:, None]
    first, last = used & (3 * rank <= count), used & (3 * rank > 2 * count)
    elapsed = row_median(time_s, last) - row_median(time_s, first)
    pace: Float[np.ndarray, " arc"] = np.abs(row_median(way_m, last) - row_median(way_m, first)) / elapsed
    return pace


def _unevenness(
    travel_m: Float[np.ndarray, "arc record"],
    time_s: Float[np.ndarray, "arc record"],
    used: Bool[np.ndarray, "arc record"],
) -> Float[np.ndarray, " arc"]:
    """Root of the mean square speed, weighted, over the mean speed; by odometry, whose scale drops out.

    A bend at u, -1 to 1 along the arc, bears on the curvature that is fitted by (1 − u²)²: hardly at the ends, where
    the vehicle moves off and stops.
    """
    rows, last = np.arange(len(used))[:, None], used.shape[1] - 1 - np.argmax(used[:, ::-1], axis=1)[:, None]
    before = np.maximum(np.arange(used.shape[1])[None, :] - 2, 0)
    after = np.minimum(np.arange(used.shape[1])[None, :] + 2, last)
    before = np.minimum(before, after - 1)
    speed = (travel_m[rows, after] - travel_m[rows, before]) / (time_s[rows, after] - time_s[rows, before])
    first = travel_m[:, :1]
    at = np.clip(2.0 * (travel_m - first) / (travel_m[rows, last] - first) - 1.0, -1.0, 1.0)
    weight = np.where(used, np.abs(speed) * (1.0 - at**2) ** 2, 0.0)
    mean_square = np.sum(weight * speed**2, axis=1) / np.sum(weight, axis=1)
    shape: Float[np.ndarray, " arc"] = np.sqrt(mean_square) / _paces(travel_m, time_s, used)
    return shape
