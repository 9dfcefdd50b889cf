"""Arcs of a drive: stretches of constant steering, the circle fitted to each, how the body stood on it."""

from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from lgprjax.tuning.robust import NotExcitedError
from lgprjax.vehicle.sensors import DriveSignals

# Circles through noisy points, many at once, with the straight line as one of them.
#
# A circle is parametrised by its point nearest to the origin and its curvature there: offset e along the left normal,
# direction θ and curvature κ. With (ξ, η) the point in that frame its distance to the circle is
#
#     d = (2η − κ(ξ² + η²)) / (1 + s),    s² = (1 − κη)² + (κξ)²,
#
# positive towards the centre, and neither it nor its derivatives divide by κ.

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
        offset_m=offset,
        direction_rad=direction,
        curvature_radpm=curvature,
        variance_m2=variance,
        covariance=variance[:, None, None] * np.linalg.inv(np.einsum("arp,arq->apq", masked, masked)),
        used=valid,
        residual_m=distance,
        tangent_rad=tangent,
        arc_m=arc,
        scatter_m=scale,
    )


def huber_spread(
    residual: Float[np.ndarray, "arc record"], valid: Bool[np.ndarray, "arc record"], scale: Float[np.ndarray, " arc"]
) -> tuple[Float[np.ndarray, "arc record"], Float[np.ndarray, " arc"]]:
    """Residuals clipped by Huber's weights, and the share not clipped."""
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


# Stretches of constant steering in a drive: the parts of a palm tree or a turning test.

_AROUND_S = 0.25
"""Speed and change of steering are taken over twice this time."""
_STANDING_MPS = 0.1
_MEDIAN_RECORDS = 5
_STEADY_SHARE = 0.002
_SAME_SHARE = 0.01
"""Of the span of the steering signal: the change that is none, and how far values of one setting may lie apart."""


@dataclass(frozen=True)
class StretchRules:
    """Requirements of a stretch.

    Attributes:
        least_length_m: way of the rear axle.
        least_records: with a position.
        longest_gap_s: without a fix; a longer one ends a stretch.
    """

    least_length_m: float = 3.0
    least_records: int = 12
    longest_gap_s: float = 2.5


class Stretches(NamedTuple):
    """Stretches of a drive, in its order.

    Attributes:
        start, stop: first record of each, and the one after its last.
        sense: 1 forward, -1 in reverse.
        steering, sigma_steering: mean of the steering signal, in its unit, and the standard error of that.
        setting: number of the setting of the steering wheel; stretches that follow each other on one setting share it.
        dropped: how many were left out, by reason.
    """

    start: Int[np.ndarray, " stretch"]
    stop: Int[np.ndarray, " stretch"]
    sense: Float[np.ndarray, " stretch"]
    steering: Float[np.ndarray, " stretch"]
    sigma_steering: Float[np.ndarray, " stretch"]
    setting: Int[np.ndarray, " stretch"]
    dropped: dict[str, int]


def find_stretches(
    signals: DriveSignals, steering: Float[np.ndarray, " record"], rules: StretchRules | None = None
) -> Stretches:
    """Stretches in one driving direction at one setting of the steering.

    A record of the steering signal that is far off does not end a stretch, and neither does a short gap. A record
    without position or steering (NaN) is no record.

    Args:
        signals: of the drive.
        steering: any signal that follows the front wheels: volts, counts or radians.
        rules: what a stretch must have.

    Raises:
        NotExcitedError: there is no stretch at all.
    """
    rules = rules or StretchRules()
    known = np.flatnonzero(np.isfinite(signals.east_m + signals.north_m + signals.travel_m + steering))
    if len(known) < rules.least_records:
        raise NotExcitedError("drive", f"{rules.least_records} records with position and steering", f"{len(known)}")
    time_s, travel_m, value = signals.time_s[known], signals.travel_m[known], steering[known]
    level = _running_median(value)
    noise = 1.4826 * float(np.median(np.abs(np.diff(value, 2)))) / 6**0.5
    span = float(np.ptp(level))
    before, after = time_s - _AROUND_S, time_s + _AROUND_S
    elapsed = np.minimum(after, time_s[-1]) - np.maximum(before, time_s[0])
    speed = (np.interp(after, time_s, travel_m) - np.interp(before, time_s, travel_m)) / elapsed
    change = np.abs(np.interp(after, time_s, level) - np.interp(before, time_s, level))
    sense = np.where(np.abs(speed) > _STANDING_MPS, np.sign(speed), 0.0)
    still = change <= _STEADY_SHARE * span + 5.0 * noise
    label = np.where(still, sense, 0.0)
    ends = (label[1:] != label[:-1]) | (np.diff(time_s) > rules.longest_gap_s)
    edge = np.concatenate([[0], np.flatnonzero(ends) + 1, [len(known)]])
    dropped = {"short": 0, "steering not held": 0}
    kept: list[tuple[int, int, float, float, float]] = []
    for first, last in pairwise(edge):
        if label[first] == 0.0 or last - first < 3:
            continue
        held = level[first:last]
        if abs(travel_m[last - 1] - travel_m[first]) < rules.least_length_m or last - first < rules.least_records:
            dropped["short"] += 1
        elif np.ptp(held) > 2.0 * _SAME_SHARE * span + 8.0 * noise:
            dropped["steering not held"] += 1
        else:
            start, stop = int(known[first]), int(known[last - 1]) + 1
            kept.append((start, stop, float(label[first]), *_mean(steering[start:stop])))
    if not kept:
        found = ", ".join(f"{count} {reason}" for reason, count in dropped.items() if count) or "none"
        expected = f"stretches of {rules.least_length_m:g} m and {rules.least_records} records at one setting"
        raise NotExcitedError("steering", expected, found)
    starts, stops, senses, settings, sigmas = (np.asarray(column) for column in zip(*kept, strict=True))
    number = np.concatenate([[0], np.cumsum(np.abs(np.diff(settings)) > _SAME_SHARE * span + 3.0 * noise)])
    return Stretches(
        start=starts,
        stop=stops,
        sense=senses,
        steering=settings,
        sigma_steering=sigmas,
        setting=number,
        dropped={why: n for why, n in dropped.items() if n},
    )


def choose_stretches(stretches: Stretches, keep: Bool[np.ndarray, " all"], reason: str) -> Stretches:
    """Those that are to be kept; the others are counted under a reason."""
    dropped = dict(stretches.dropped)
    if not keep.all():
        dropped[reason] = dropped.get(reason, 0) + int(np.sum(~keep))
    columns = {name: getattr(stretches, name)[keep] for name in Stretches._fields[:-1]}
    return stretches._replace(**columns, dropped=dropped)


def _mean(value: Float[np.ndarray, " record"]) -> tuple[float, float]:
    """Mean without spikes, and its standard error, of a signal that is held: every record counts, with a fix or not."""
    known = value[np.isfinite(value)]
    away = np.abs(known - np.median(known))
    held = known[away <= 4.0 * 1.4826 * np.median(away)]
    return float(np.mean(held)), float(np.std(held)) / len(held) ** 0.5


def _running_median(value: Float[np.ndarray, " record"]) -> Float[np.ndarray, " record"]:
    half = _MEDIAN_RECORDS // 2
    padded = np.concatenate([np.full(half, value[0]), value, np.full(half, value[-1])])
    median: Float[np.ndarray, " record"] = np.median(
        np.lib.stride_tricks.sliding_window_view(padded, _MEDIAN_RECORDS), axis=1
    )
    return median


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
        raise NotExcitedError("positions", "arcs without position jumps", f"none in {len(whole)} stretches")
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
        stretches=kept,
        curvature_radpm=kept.sense * circles.curvature_radpm,
        sigma_radpm=np.sqrt(covariance[:, 2, 2]),
        slip_rad=slip,
        sigma_slip_rad=np.hypot(sigma_heading, sigma_tangent),
        speed_mps=_paces(way_m, time_s, circles.used) * _unevenness(signals.travel_m[record], time_s, circles.used),
        time_s=np.sum(np.where(circles.used, time_s, 0.0), axis=1) / count,
        scatter_m=circles.scatter_m,
        memory=memory,
        heading_memory=heading_memory,
    )


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
    # Unwrapping may have begun whole turns away from the origin of the circle, which is in the middle.
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
