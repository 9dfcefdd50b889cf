"""Travel as recorded: jumps detected, then bridged or left open; scale by the fixes of the drive; noise of positions.

The odometry of some logs is the distance between positions. Where the positions jump, such a record jumps with them. A
jump is detected from the record alone: around it, the travel before and after is one smooth curve (a cubic) except for
a step. The largest step that a vehicle's own motion can imitate follows exactly from the weights of that fit: they
annul every cubic, so that their sum over any travel is the integral of its acceleration times their Peano kernel.
Smaller steps, and those within the noise of the record, do not count.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.linalg import cho_solve_banded, cholesky_banded

_ACCELERATION_MPS2 = 6.0
"""Acceleration when starting and braking. The kernel is odd, so that an acceleration of 6 that begins or ends anywhere
imitates no larger step than one of 3 that changes sign at the worst place.
"""
_ONE_WAY_S = 1.0  # no vehicle starts and brakes that hard within a second; within two it may
_NOISE_SIGMAS = 6.0
_LEAST_JUMP_M = 0.1
_CELL_S = 0.05
"""Records that come faster are averaged over this time."""
_SHAPES = ((1, 3), (1, 6), (2, 6), (2, 8), (4, 8), (6, 8), (12, 12))
"""Cells from the last one before a gap to the first one after it, and cells to each side."""
_REACH_CELLS = 2 * max(across + side for across, side in _SHAPES)
"""A step affects fits this far away; farther steps are treated at the same time, nearer ones after it."""
_LONGEST_GAP_S = 0.7  # except for a single interval of records: a jump smoothed by a receiver takes half a second
# Locating a jump: gaps near the one found, no longer than receivers smooth, and the cells fitted on each side.
_LONGEST_S, _LONGEST_STEPS, _MOST_CELLS, _LEAST_SIDE, _MOST_SIDE = 0.75, 2.5, 16, 6, 14
_REGION_CELLS = 44
_SHORTER = 0.04  # of the residual of a bridge, per cell: a longer bridge also smooths noise away
_SUDDEN = 0.75
_NOISE_CELLS = 256
_AT_ONCE = 4096
_MOST_ROUNDS = 12
_APART_CELLS = 2  # with fewer cells between them, jumps leave no measured speed between
_BRIDGED_S, _BRIDGED_M = 1.05, 1.0
_MOST_PIECES = 3
_SILENT_STEPS = 3.0  # slow records miss one or two of their steps, as a receiver at 1 Hz does


class Jump(NamedTuple):
    """A step of the record that is no travel: its time interval and size."""

    start_s: float
    stop_s: float
    metres: float


class MendedTravel(NamedTuple):
    """Travel without its jumps.

    Attributes:
        distance_m: signed cumulative travel at the records, steps removed, bridged at local speed.
        bridged: jumps whose gaps are short (a second, or a metre of travel).
        broken: jumps with longer or repeated gaps: the travel across them is unknown.
    """

    distance_m: Float[np.ndarray, " odometry"]
    bridged: tuple[Jump, ...]
    broken: tuple[Jump, ...]


class _Cells(NamedTuple):
    """Means of consecutive records, and the first and last record of each."""

    time_s: Float[np.ndarray, " cell"]
    distance_m: Float[np.ndarray, " cell"]
    first: Int[np.ndarray, " cell"]
    last: Int[np.ndarray, " cell"]


class _Steps(NamedTuple):
    """Steps found by the fits around some gaps: metres, what acceleration can imitate, gain of noise."""

    metres: Float[np.ndarray, " gap"]
    feigned_m: Float[np.ndarray, " gap"]
    noise_gain: Float[np.ndarray, " gap"]


def mend_travel(time_s: Float[np.ndarray, " odometry"], distance_m: Float[np.ndarray, " odometry"]) -> MendedTravel:
    """Find the jumps of an odometer's record and remove them.

    Args:
        time_s: strictly increasing.
        distance_m: signed cumulative travel.
    """
    own = _informative(distance_m)
    mended, jumps = _without_jumps(time_s[own], distance_m[own])
    # A held value gets the correction of the record that it repeats.
    source = np.searchsorted(own, np.arange(len(time_s)), side="right") - 1
    whole = distance_m + (mended - distance_m[own])[source] if jumps else distance_m
    bridged: list[Jump] = []
    broken: list[Jump] = []
    for jump, pieces in jumps:
        way_m = abs(float(np.diff(np.interp([jump.start_s, jump.stop_s], time_s[own], mended))[0]))
        short = jump.stop_s - jump.start_s <= _BRIDGED_S or way_m <= _BRIDGED_M
        (bridged if short and pieces <= _MOST_PIECES else broken).append(jump)
    return MendedTravel(whole, tuple(bridged), tuple(broken))


def legs_of(time_s: Float[np.ndarray, " scan"], gaps: tuple[Jump, ...]) -> Int[np.ndarray, " scan"]:
    """Leg of each scan: a new one after every open gap, in any order."""
    leg = np.zeros(len(time_s), np.int64)
    for jump in gaps:
        # A scan within the gap is a leg of its own: its distance from either side is unknown.
        leg[1:] += (time_s[1:] > jump.start_s) & (time_s[:-1] < jump.stop_s)
    return np.cumsum(leg > 0)


def silences(time_s: Float[np.ndarray, " odometry"], distance_m: Float[np.ndarray, " odometry"]) -> tuple[Jump, ...]:
    """Gaps for ``legs_of`` where the record is silent: travel there is interpolated, or held at its ends.

    A gap within the record counts if it is longer than a second and than three usual steps. Odometers that send only
    while wheels turn are silent at standstill: a gap without travel does not count. All scans before the record share
    a leg, and all scans after it; those within a twentieth of a second, or a usual step, of its ends belong to it.
    """
    step_s = np.diff(time_s)
    usual_s = float(np.median(step_s))
    silent = (step_s > max(_BRIDGED_S, _SILENT_STEPS * usual_s)) & (np.abs(np.diff(distance_m)) > _LEAST_JUMP_M)
    inside = [Jump(float(time_s[at]), float(time_s[at + 1]), 0.0) for at in np.flatnonzero(silent)]
    beside_s = min(usual_s, _CELL_S)
    # A moment between two neighbouring numbers parts scans once, even if one of them is at it.
    ends = [float(time_s[0]) - beside_s, float(time_s[-1]) + beside_s]
    return (*inside, *(Jump(end_s, float(np.nextafter(end_s, np.inf)), 0.0) for end_s in ends))


def _informative(distance_m: Float[np.ndarray, " odometry"]) -> Int[np.ndarray, " own"]:
    """Records with new values, where a slow source's values are held in between; else all."""
    changed = np.flatnonzero(np.diff(distance_m)) + 1
    if len(changed) < 2 or np.median(np.diff(changed)) < 2:
        return np.arange(len(distance_m))
    return np.unique(np.concatenate([[0], changed]))


def _without_jumps(
    time_s: Float[np.ndarray, " record"], distance_m: Float[np.ndarray, " record"]
) -> tuple[Float[np.ndarray, " record"], list[tuple[Jump, int]]]:
    first, last = _cell_edges(time_s)
    cells = _Cells(_means(time_s, first, last), _means(distance_m, first, last), first, last)
    distance = distance_m.copy()
    noise_m = [_noise(cells, shape) for shape in _SHAPES]
    gaps = np.arange(len(first))
    found: list[tuple[int, int, float]] = []
    for _ in range(_MOST_ROUNDS):
        chosen = _largest(cells, gaps, noise_m)
        if not chosen:
            break
        for gap in chosen:
            found.append(_bridge(time_s, distance, cells, gap, noise_m))
            cells = cells._replace(distance_m=_means(distance, first, last))
        near = np.concatenate([np.arange(gap - _REACH_CELLS, gap + _REACH_CELLS + 1) for gap in chosen])
        gaps = np.unique(near[(near >= 0) & (near < len(first))])
    return distance, _merged(found, time_s, first)


def _cell_edges(time_s: Float[np.ndarray, " record"]) -> tuple[Int[np.ndarray, " cell"], Int[np.ndarray, " cell"]]:
    """First and last record of every cell; records as slow as cells are cells of their own."""
    if float(np.median(np.diff(time_s))) >= _CELL_S:
        each = np.arange(len(time_s))
        return each, each
    number = np.floor((time_s - time_s[0]) / _CELL_S)
    first = np.flatnonzero(np.diff(number, prepend=-1.0) > 0)
    return first, np.append(first[1:], len(time_s)) - 1


def _means(
    values: Float[np.ndarray, " record"], first: Int[np.ndarray, " cell"], last: Int[np.ndarray, " cell"]
) -> Float[np.ndarray, " cell"]:
    return np.asarray(np.add.reduceat(values, first) / (last - first + 1))


def _steps_at(cells: _Cells, gaps: Int[np.ndarray, " gap"], shape: tuple[int, int]) -> _Steps:
    """Steps across the gaps that begin after the given cells; zeros beyond the record."""
    across, side = shape
    metres, feigned, gain = np.zeros((3, len(gaps)))
    inside = (gaps - side + 1 >= 0) & (gaps + across + side - 1 < len(cells.time_s))
    where = np.flatnonzero(inside)
    offset = np.concatenate([np.arange(1 - side, 1), np.arange(across, across + side)])
    for low in range(0, len(where), _AT_ONCE):
        at = where[low : low + _AT_ONCE]
        index = gaps[at][:, None] + offset
        time_s, distance_m = cells.time_s[index], cells.distance_m[index]
        weight = _step_weights(time_s - 0.5 * (time_s[:, side - 1] + time_s[:, side])[:, None], side)
        metres[at] = np.sum(weight * (distance_m - distance_m[:, :1]), axis=1)
        feigned[at] = _feigned(time_s, weight)
        gain[at] = np.linalg.norm(weight, axis=1)
        long = (time_s[:, side] - time_s[:, side - 1] > _LONGEST_GAP_S) & (across > 1)
        metres[at[long]] = 0.0
    return _Steps(metres, feigned, gain)


def _step_weights(time_s: Float[np.ndarray, "gap point"], side: int) -> Float[np.ndarray, "gap point"]:
    """Weights of the points in the step of a least-squares fit of a cubic and a step after the first ``side``."""
    columns = _columns(time_s, side)
    gram = np.swapaxes(columns, 1, 2) @ columns
    return np.asarray((columns @ np.linalg.solve(gram, np.eye(5)[:, -1:]))[..., 0])


def _columns(time_s: Float[np.ndarray, "gap point"], side: int) -> Float[np.ndarray, "gap point 5"]:
    """A cubic, and a step after the first ``side`` points."""
    x = time_s / np.max(np.abs(time_s), axis=1, keepdims=True)
    step = np.broadcast_to(np.arange(2 * side) >= side, x.shape).astype(np.float64)
    return np.stack([np.ones_like(x), x, x**2, x**3, step], axis=-1)


def _feigned(
    time_s: Float[np.ndarray, "gap point"], weight: Float[np.ndarray, "gap point"]
) -> Float[np.ndarray, " gap"]:
    """Largest step, in metres, that a vehicle's own acceleration can imitate."""
    span_s = time_s[:, -1] - time_s[:, 0]
    share = np.clip((span_s - _ONE_WAY_S) / _ONE_WAY_S, 0.0, 1.0)
    return np.asarray(_ACCELERATION_MPS2 * (0.5 + 0.5 * share) * _kernel_integral(time_s, weight))


def _kernel_integral(
    time_s: Float[np.ndarray, "gap point"], weight: Float[np.ndarray, "gap point"]
) -> Float[np.ndarray, " gap"]:
    """Integral of the magnitude of the weights' Peano kernel: largest step, in metres, that 1 m/s² can imitate."""
    # Between points the kernel, the sum of weight times (t - s) over the points after s, is linear.
    later = np.cumsum(weight[:, ::-1], axis=1)[:, ::-1]
    moment = np.cumsum((weight * time_s)[:, ::-1], axis=1)[:, ::-1]
    kernel = moment - later * time_s
    a, b, width = np.abs(kernel[:, :-1]), np.abs(kernel[:, 1:]), np.diff(time_s, axis=1)
    crossing = kernel[:, :-1] * kernel[:, 1:] < 0.0
    area = np.where(crossing, (a**2 + b**2) / np.maximum(a + b, 1e-300), a + b)
    return np.asarray(np.sum(0.5 * area * width, axis=1))


def _noise(cells: _Cells, shape: tuple[int, int]) -> Float[np.ndarray, " cell"]:
    """Noise of the record around every cell, metres, estimated from the steps that a shape finds there."""
    steps = _steps_at(cells, np.arange(len(cells.time_s)), shape)
    known = np.flatnonzero(steps.noise_gain)
    if not len(known):
        return np.zeros(len(cells.time_s))
    blocks = np.array_split(known, max(1, len(known) // _NOISE_CELLS))
    level = np.array([1.4826 * np.median(np.abs(steps.metres[b]) / steps.noise_gain[b]) for b in blocks])
    # Where a quiet stretch meets a noisy one, the noisy one counts.
    about = np.max(np.stack([level, np.append(level[1:], 0.0), np.append(0.0, level[:-1])]), axis=0)
    starts = np.array([b[0] for b in blocks])
    return np.asarray(about[np.clip(np.searchsorted(starts, np.arange(len(cells.time_s)), side="right") - 1, 0, None)])


def _largest(cells: _Cells, gaps: Int[np.ndarray, " gap"], noise_m: list[Float[np.ndarray, " cell"]]) -> list[int]:
    """Gaps with steps beyond what motion and noise can cause; the clearest at every place."""
    ratio = np.zeros((len(_SHAPES), len(gaps)))
    for row, shape in enumerate(_SHAPES):
        steps = _steps_at(cells, gaps, shape)
        limit = steps.feigned_m + _NOISE_SIGMAS * noise_m[row][gaps] * steps.noise_gain
        ratio[row] = np.abs(steps.metres) / np.maximum(limit, _LEAST_JUMP_M)
    best = ratio.max(axis=0)
    out: list[int] = []
    taken: Bool[np.ndarray, " cell"] = np.zeros(len(cells.time_s), bool)
    for at in np.argsort(-best):
        if best[at] <= 1.0:
            break
        gap = int(gaps[at])
        if not taken[gap]:
            out.append(gap)
            taken[max(gap - _REACH_CELLS, 0) : gap + _REACH_CELLS + 1] = True
    return out


def _extent(cells: _Cells, gap: int, noise_m: list[Float[np.ndarray, " cell"]]) -> tuple[int, int, int]:
    """Last cell before a jump, first one after it, and cells to each side for the fit.

    A step that is found may be the shoulder of a jump that a receiver has smoothed. Of all gaps nearby, the one counts
    whose bridge leaves the smallest steps around it.
    """
    low, high = max(gap - _REGION_CELLS, 0), min(gap + _REGION_CELLS + 1, len(cells.time_s))
    near = _Cells(*(field[low:high] for field in cells))
    detector = _detector(near, [noise[low:high] for noise in noise_m])
    usual_s = float(np.median(np.diff(cells.time_s)))
    best = (np.inf, gap, gap + 1, _SHAPES[0][1])
    for across in range(1, _MOST_CELLS + 1):
        side = int(np.clip(2 * across, _LEAST_SIDE, _MOST_SIDE))
        before = np.arange(gap - low - _MOST_CELLS, gap - low + _MOST_CELLS + 1)
        if gap - low < side - 1 or gap - low + across + side > len(near.time_s):
            side = _SHAPES[0][1]  # near an end of the record
        before = before[(before >= side - 1) & (before + across + side <= len(near.time_s))]
        span_s = near.time_s[before + across] - near.time_s[before]
        before = before[(span_s <= max(_LONGEST_S, _LONGEST_STEPS * usual_s)) | (across == 1)]
        if len(before):
            bridged = _bridged_cells(near, before, across, side)
            left = np.sum((bridged @ detector.T) ** 2, axis=1) * (1.0 + _SHORTER * across)
            least = int(np.argmin(left))
            start = int(before[least]) + low
            best = min(best, (float(left[least]), start, start + across, side))
    return best[1:]


def _detector(near: _Cells, noise_m: list[Float[np.ndarray, " cell"]]) -> Float[np.ndarray, "step cell"]:
    """Every step searched for among some cells, relative to its limit, as weights of their distances."""
    rows = []
    count = len(near.time_s)
    for shape, noise in zip(_SHAPES, noise_m, strict=True):
        across, side = shape
        gaps = np.arange(side - 1, count - across - side + 1)
        if not len(gaps):
            continue
        offset = np.concatenate([np.arange(1 - side, 1), np.arange(across, across + side)])
        index = gaps[:, None] + offset
        time_s = near.time_s[index]
        weight = _step_weights(time_s - 0.5 * (time_s[:, side - 1] + time_s[:, side])[:, None], side)
        limit = _feigned(time_s, weight)
        limit += _NOISE_SIGMAS * noise[gaps] * np.linalg.norm(weight, axis=1)
        row = np.zeros((len(gaps), count))
        np.put_along_axis(row, index, weight / np.maximum(limit, _LEAST_JUMP_M)[:, None], axis=1)
        rows.append(row)
    return np.concatenate(rows)


def _bridged_cells(
    near: _Cells, before: Int[np.ndarray, " gap"], across: int, side: int
) -> Float[np.ndarray, "gap cell"]:
    """Distances of some cells with one gap after the other bridged, from 0."""
    index = before[:, None] + np.concatenate([np.arange(1 - side, 1), np.arange(across, across + side)])
    middle_s = 0.5 * (near.time_s[before] + near.time_s[before + across])[:, None]
    time_s, distance_m = near.time_s[index] - middle_s, near.distance_m[index] - near.distance_m[0]
    scale_s = np.max(np.abs(time_s), axis=1, keepdims=True)
    columns = _columns(time_s, side)
    turned = np.swapaxes(columns, 1, 2)
    fitted = np.linalg.solve(turned @ columns, turned @ distance_m[..., None])[..., 0]
    number = np.arange(len(near.time_s))
    out = np.repeat((near.distance_m - near.distance_m[0])[None], len(before), axis=0)
    out -= np.where(number >= before[:, None] + across, fitted[:, 4:], 0.0)
    x = (near.time_s - middle_s) / scale_s
    smooth = fitted[:, :1] + x * (fitted[:, 1:2] + x * (fitted[:, 2:3] + x * fitted[:, 3:4]))
    inside = (number > before[:, None]) & (number < before[:, None] + across)
    return np.where(inside, smooth, out)


def _bridge(
    time_s: Float[np.ndarray, " record"],
    distance_m: Float[np.ndarray, " record"],
    cells: _Cells,
    gap: int,
    noise_m: list[Float[np.ndarray, " cell"]],
) -> tuple[int, int, float]:
    """Remove one step from the record, in place; returns the records before and after it, and its metres."""
    start, stop, side = _extent(cells, gap, noise_m)
    low, high = int(cells.first[start - side + 1]), int(cells.last[stop + side - 1]) + 1
    before, after = int(cells.last[start]), int(cells.first[stop])
    step_m, smooth = _fit(time_s, distance_m, low, before, after, high)
    # One step between two records holds most of a jump that no receiver has smoothed.
    inner = np.arange(cells.first[start], cells.last[stop] + 1)
    sudden = np.diff(distance_m[inner]) - np.diff(smooth(time_s[inner]))
    largest = int(np.argmax(np.abs(sudden)))
    if sudden[largest] / step_m > _SUDDEN:
        before, after = int(inner[largest]), int(inner[largest + 1])
        step_m, smooth = _fit(time_s, distance_m, low, before, after, high)
    distance_m[after:] -= step_m
    between = slice(before + 1, after)
    ends = distance_m[[before, after]] - smooth(time_s[[before, after]])
    distance_m[between] = smooth(time_s[between]) + np.interp(time_s[between], time_s[[before, after]], ends)
    return before, after, step_m


def _fit(
    time_s: Float[np.ndarray, " record"], distance_m: Float[np.ndarray, " record"], *edges: int
) -> tuple[float, np.polynomial.Polynomial]:
    """Step across a gap and the cubic around it, from records from ``low`` to ``before`` and ``after`` to ``high``."""
    low, before, after, high = edges
    index = np.concatenate([np.arange(low, before + 1), np.arange(after, high)])
    origin_s, origin_m = 0.5 * (time_s[before] + time_s[after]), distance_m[before]
    span_s = float(np.max(np.abs(time_s[index] - origin_s)))
    x = (time_s[index] - origin_s) / span_s
    columns = np.stack([np.ones_like(x), x, x**2, x**3, (index >= after).astype(np.float64)], axis=1)
    fitted = np.linalg.lstsq(columns, distance_m[index] - origin_m, rcond=None)[0]
    fitted[0] += origin_m
    domain = [origin_s - span_s, origin_s + span_s]
    return float(fitted[4]), np.polynomial.Polynomial(fitted[:4], domain=domain, window=[-1.0, 1.0])


def _merged(
    found: list[tuple[int, int, float]], time_s: Float[np.ndarray, " record"], first: Int[np.ndarray, " cell"]
) -> list[tuple[Jump, int]]:
    """Jumps in order, and the number of pieces of each; jumps without a measured speed between them are one."""
    cell = np.searchsorted(first, np.arange(len(time_s)), side="right") - 1
    out: list[tuple[int, int, float, int]] = []
    for before, after, metres in sorted(found):
        if out and cell[before] - cell[out[-1][1]] < _APART_CELLS:
            start, stop, so_far, pieces = out[-1]
            out[-1] = (start, max(after, stop), so_far + metres, pieces + 1)
        else:
            out.append((before, after, metres, 1))
    return [(Jump(float(time_s[a]), float(time_s[b]), metres), pieces) for a, b, metres, pieces in out]


# The scale of an odometer whose wheels are not as large as was thought, by a drive's own fixes.

_SCALE_PIECE_M, _SCALE_PIECES = 4.0, 5
_SCALE_SIGMAS, _SCALE_LEAST, _SCALE_MOST = 4.0, 0.01, 0.1


def scale_by_fixes(
    place_m: Float[np.ndarray, "scan 2"],
    yaw_rad: Float[np.ndarray, " scan"],
    travel_m: Float[np.ndarray, " scan"],
    leg: Int[np.ndarray, " scan"],
    ok: Bool[np.ndarray, " scan"],
) -> float | None:
    """Scale of the recorded travel, map metres per metre; ``None`` if it is 1 within errors, or fixes are too few.

    Chords between fixes some metres apart are compared with those of dead reckoning. A window laid out with a wrong
    scale displaces both ends of a chord alike.

    Args:
        place_m: position of the point whose travel is recorded, by each fix.
        yaw_rad: yaw of the vehicle; a constant error does not matter.
        travel_m, leg: signed travel, known within a leg.
        ok: mask of scans with a fix.
    """
    step_m = np.diff(travel_m, prepend=travel_m[:1])
    middle = yaw_rad - 0.5 * np.diff(yaw_rad, prepend=yaw_rad[:1])
    reckoned_m = np.cumsum(step_m[:, None] * np.stack([np.cos(middle), np.sin(middle)], axis=1), axis=0)
    piece = np.floor(np.cumsum(np.abs(step_m)) / _SCALE_PIECE_M)
    at = np.flatnonzero(ok)
    at = at[np.unique(piece[at], return_index=True)[1]]
    a, b = at[:-1], at[1:]
    near = (leg[a] == leg[b]) & (piece[b] - piece[a] == 1.0)
    a, b = a[near], b[near]
    by_map, by_odometer = (np.hypot(*(points[b] - points[a]).T) for points in (place_m, reckoned_m))
    long = by_odometer > 0.25 * _SCALE_PIECE_M
    if np.count_nonzero(long) < _SCALE_PIECES:
        return None
    ratio = by_map[long] / by_odometer[long]
    scale = float(np.median(ratio))
    sigma = 1.25 * 1.4826 * float(np.median(np.abs(ratio - scale))) / np.sqrt(len(ratio))
    off = abs(scale - 1.0)
    return scale if max(_SCALE_LEAST, _SCALE_SIGMAS * sigma) < off < _SCALE_MOST else None


# Travel from positions: white noise of theirs goes into every step of it, and is taken out by a smoothing spline.

_LEAST_RECORDS = 8
_RATIOS = np.arange(-8.0, 8.1, 0.5)
"""Decimal logarithms of the noise's weight relative to that of the acceleration between neighbouring records."""
_DOUBT = 2.0
"""Least advantage in log likelihood of noise over acceleration as the explanation of a record."""
_SCATTER = 1.5
"""The scatter of a short record is this uncertain."""
_SAMPLED = 24
_SPAN_M = 10.0


class SmoothedTravel(NamedTuple):
    """Travel with less noise than the positions that it comes from.

    Attributes:
        distance_m: signed cumulative travel at the records.
        step_sigma_m, span_sigma_m: remaining error of a step between records, and of 10 m, root mean square over the
            record, or an upper bound where noise and acceleration cannot be separated; NaN for short records.
    """

    distance_m: Float[np.ndarray, " record"]
    step_sigma_m: float
    span_sigma_m: float

    def in_words(self) -> str:
        """The source and noise of the travel, as text."""
        if not np.isfinite(self.step_sigma_m):
            return "from the positions"
        steps, span = (f"{100.0 * sigma_m:.2g} cm" for sigma_m in (self.step_sigma_m, self.span_sigma_m))
        return f"from the positions, smoothed: sigma {steps} a step, {span} over {_SPAN_M:g} m"


def smoothed_travel(time_s: Float[np.ndarray, " record"], distance_m: Float[np.ndarray, " record"]) -> SmoothedTravel:
    """Smooth travel that is the sum of steps between positions, except across jumps, which stay as they are.

    Model: white acceleration and white noise, whose ratio is that of the largest likelihood; the estimate is a cubic
    smoothing spline (Reinsch, 1967; de Jong and Ansley on its likelihood). Records without noise stay as they are.

    Args:
        time_s: strictly increasing, in any unit.
        distance_m: signed cumulative travel with the noise of the positions in it.
    """
    mended = mend_travel(time_s, distance_m) if len(time_s) >= _LEAST_RECORDS else None
    jumps = () if mended is None else (*mended.bridged, *mended.broken)
    pieces = _pieces(time_s, sorted(jumps))
    longest = max(pieces, key=lambda piece: piece.stop - piece.start)
    if longest.stop - longest.start < _LEAST_RECORDS:
        return SmoothedTravel(distance_m, np.nan, np.nan)
    fitted = _Spline.most_likely(time_s[longest], distance_m[longest])
    smooth = distance_m.copy()
    for piece in pieces:
        if piece.stop - piece.start >= _LEAST_RECORDS:
            spline = fitted if piece == longest else _Spline(time_s[piece], distance_m[piece], fitted.weight)
            smooth[piece] = spline.smooth()
    own = distance_m[longest]
    at = np.linspace(0, len(own) - 2, _SAMPLED).astype(int)
    far = [int(np.argmax(np.abs(own[i:] - own[i]) >= _SPAN_M)) for i in at]
    spans = [(int(i), int(i) + on) for i, on in zip(at, far, strict=True) if on] or [(0, len(own) - 1)]
    steps = [(int(i), int(i) + 1) for i in at]
    return SmoothedTravel(smooth, fitted.sigma_m(steps), fitted.sigma_m(spans))


def _pieces(time_s: Float[np.ndarray, " record"], jumps: list[Jump]) -> list[slice]:
    """Records between jumps."""
    begin, out = 0, []
    for jump in jumps:
        out.append(slice(begin, int(np.searchsorted(time_s, jump.start_s, side="right"))))
        begin = int(np.searchsorted(time_s, jump.stop_s, side="left"))
    return [*out, slice(begin, len(time_s))]


class _Spline:
    """Cubic smoothing spline of a record, by its second differences.

    Attributes:
        weight: variance of the noise divided by the spectral density of the acceleration.
        log_likelihood: log likelihood of the weight, with the best variance for it.
        noise_m: standard deviation of the noise with this weight.
    """

    def __init__(self, time_s: Float[np.ndarray, " record"], distance_m: Float[np.ndarray, " record"], weight: float):
        step = np.diff(time_s)
        self._distance_m, self.weight, self._bound_m = distance_m, weight, 0.0
        self._rows = np.stack([1.0 / step[:-1], -1.0 / step[:-1] - 1.0 / step[1:], 1.0 / step[1:]])
        low, mid, high = self._rows
        band = np.zeros((3, len(low)))
        band[2] = (step[:-1] + step[1:]) / 3.0 + weight * (self._rows**2).sum(axis=0)
        band[1, 1:] = step[1:-1] / 6.0 + weight * (mid[:-1] * low[1:] + high[:-1] * mid[1:])
        band[0, 2:] = weight * high[:-2] * low[2:]
        self._factor = cholesky_banded(band)
        bends = self._bends(distance_m)
        self._solved = self._solve(bends)
        density = max(float(bends @ self._solved) / len(bends), 1e-300)
        self.log_likelihood = -0.5 * len(bends) * np.log(density) - float(np.log(self._factor[2]).sum())
        self.noise_m = float(np.sqrt(weight * density))

    @classmethod
    def most_likely(cls, time_s: Float[np.ndarray, " record"], distance_m: Float[np.ndarray, " record"]) -> "_Spline":
        """The spline whose weight explains the record best."""
        usual = float(np.median(np.diff(time_s))) ** 3
        # Noise is everywhere, acceleration now and then: noise is at most what most second differences scatter by.
        most_m = 1.4826 * float(np.median(np.abs(np.diff(distance_m, 2)))) / np.sqrt(6.0)
        splines = [cls(time_s, distance_m, usual * 10.0**ratio) for ratio in _RATIOS]
        possible = [each for each in splines if each.noise_m <= _SCATTER * most_m] or splines[:1]
        best = max(possible, key=lambda spline: spline.log_likelihood)
        near = [each.noise_m for each in possible if each.log_likelihood >= best.log_likelihood - _DOUBT]
        # Acceleration between records hides the noise.
        best._bound_m = max((best.noise_m, *near, most_m if best.weight < usual else 0.0))
        return best

    def smooth(self) -> Float[np.ndarray, " record"]:
        """The record without its noise."""
        return np.asarray(self._distance_m - self.weight * self._spread(self._solved))

    def sigma_m(self, pairs: Sequence[tuple[int, int]]) -> float:
        """Error of the distance between pairs of records: by the model, or what the noise's upper bound leaves."""
        by_model, by_noise = [], []
        for i, j in pairs:
            pair = np.zeros(len(self._distance_m))
            pair[[i, j]] = -1.0, 1.0
            bends = self._bends(pair)
            solved = self._solve(bends)
            by_model.append(self.noise_m**2 * (2.0 - self.weight * float(bends @ solved)))
            by_noise.append(self._bound_m**2 * float(np.sum((pair - self.weight * self._spread(solved)) ** 2)))
        return float(np.sqrt(max(float(np.mean(by_model)), float(np.mean(by_noise)), 0.0)))

    def _solve(self, bends: Float[np.ndarray, " bend"]) -> Float[np.ndarray, " bend"]:
        return np.asarray(cho_solve_banded((self._factor, False), bends))

    def _bends(self, values: Float[np.ndarray, " record"]) -> Float[np.ndarray, " bend"]:
        """Differences of neighbouring slopes."""
        low, mid, high = self._rows
        return np.asarray(low * values[:-2] + mid * values[1:-1] + high * values[2:])

    def _spread(self, bends: Float[np.ndarray, " bend"]) -> Float[np.ndarray, " record"]:
        """Transpose of ``_bends``."""
        out = np.zeros(len(bends) + 2)
        for shift, row in enumerate(self._rows):
            out[shift : shift + len(bends)] += row * bends
        return out
