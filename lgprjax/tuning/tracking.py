"""How well a drive followed its path: RMS by speed, settling, overshoot, limit cycle, gains; by who steered."""

from itertools import pairwise
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from lgprjax.tuning.look_ahead import LimitCycle, find_limit_cycle
from lgprjax.tuning.robust import Estimate, NotExcitedError, combine, independent_share, robust_fit, student_95
from lgprjax.vehicle.path import Path, path_from_points, path_point, project

TOLERANCE_M = 0.10
"""Within it the vehicle has settled."""
STEPS_M = (0.0, 3.0, -3.0)
"""Offsets at which steering is engaged, to which those of a drive are assigned."""
NEAR_M = 1.2
NEAR_PATH_M = 5.0
SPEED_EDGES_MPS = (0.3, 1.5, 3.0, 4.5, 6.0, 8.0, 12.0, 20.0)
_LINEAR_M = 1.0
_STRAIGHT_RADPM = 0.004
_AHEAD_S = 3.0
LEAST_S = 8.0
"""Of driving at a speed, by one who steers: less gives no RMS."""


class TrackedDrive(NamedTuple):
    """A drive and its path, on even ticks.

    Attributes:
        time_s: of the ticks.
        offset_m: of the point that follows the path, to its left; sigma_m: of it.
        heading_error_rad: of the body against the path, to the left.
        curvature_radpm: of the path.
        answer_radpm: curvature that was commanded, or without commands that of the vehicle's way; NaN for neither.
        speed_mps: along the body.
        engaged: the autopilot steered.
    """

    time_s: Float[np.ndarray, " tick"]
    offset_m: Float[np.ndarray, " tick"]
    sigma_m: Float[np.ndarray, " tick"]
    heading_error_rad: Float[np.ndarray, " tick"]
    curvature_radpm: Float[np.ndarray, " tick"]
    answer_radpm: Float[np.ndarray, " tick"]
    speed_mps: Float[np.ndarray, " tick"]
    engaged: Bool[np.ndarray, " tick"]


class SpeedBand(NamedTuple):
    """RMS of the offset by one who steers at a speed.

    Attributes:
        engaged: by the autopilot, else by the driver.
        low_mps, high_mps: of the band.
        rms_m: with its 95 % interval.
        seconds: driven so; records: independent ones among them.
    """

    engaged: bool
    low_mps: float
    high_mps: float
    rms_m: Estimate
    seconds: float
    records: float


class Engagement(NamedTuple):
    """What followed when the autopilot began to steer.

    Attributes:
        step_m: 0, 3 or -3.
        offset_m: at that moment.
        speed_mps: mean, until settled.
        settled: the offset came to stay within the tolerance; settling_s, settling_m: after this time and way.
        overshoot_m: furthest on the other side; 0 for a start at 0.
    """

    step_m: float
    offset_m: float
    speed_mps: float
    settled: bool
    settling_s: float
    settling_m: float
    overshoot_m: float


class Gains(NamedTuple):
    """Curvature that answers offset and heading error, where the path has none itself.

    Attributes:
        offset_per_m2, heading_per_m: rad/m a metre, and a radian.
        look_ahead_m: of the pursuit law with these gains, their quotient.
    """

    offset_per_m2: Estimate
    heading_per_m: Estimate
    look_ahead_m: float


class Tracking(NamedTuple):
    """Tracking figures of a drive.

    Attributes:
        bands: RMS by speed and by who steered.
        engagements: in their order.
        cycle: limit cycle of the longest stretch of the autopilot; None if none is long enough.
        gains: of the autopilot; None if it hardly left the path.
    """

    bands: tuple[SpeedBand, ...]
    engagements: tuple[Engagement, ...]
    cycle: LimitCycle | None
    gains: Gains | None


@jax.jit
def _follow(
    path: Path, start_m: Float[Array, ""], x_m: Float[Array, " tick"], y_m: Float[Array, " tick"]
) -> tuple[Float[Array, " tick"], Float[Array, " tick"]]:
    """Arc length and offset of every place, each sought near the last one's."""

    def step(near: Float[Array, ""], place: tuple[Array, Array]) -> tuple[Array, tuple[Array, Array]]:
        for _ in range(4):
            foot = project(path, near, *place)
            near = foot.arc_m
        return near, (foot.arc_m, foot.offset_m)

    found: tuple[Float[Array, " tick"], Float[Array, " tick"]] = jax.lax.scan(step, start_m, (x_m, y_m))[1]
    return found


def beside_path(
    path: Path,
    *,
    time_s: Float[np.ndarray, " tick"],
    x_m: Float[np.ndarray, " tick"],
    y_m: Float[np.ndarray, " tick"],
    yaw_rad: Float[np.ndarray, " tick"],
    sigma_m: Float[np.ndarray, " tick"],
    anchor_m: float,
    speed_mps: Float[np.ndarray, " tick"],
    answer_radpm: Float[np.ndarray, " tick"],
    engaged: Bool[np.ndarray, " tick"],
) -> TrackedDrive:
    """A drive relative to a path; ticks before its beginning and after its end are left out.

    Args:
        path: that was to be followed.
        time_s, x_m, y_m, yaw_rad, sigma_m: of the rear axle, smoothed.
        anchor_m: of the point that follows, ahead of the rear axle.
        speed_mps: of the body.
        answer_radpm: as in ``TrackedDrive``.
        engaged: by the autopilot.

    Raises:
        NotExcitedError: the drive is nowhere near the path.
    """
    ahead_x, ahead_y = x_m + anchor_m * np.cos(yaw_rad), y_m + anchor_m * np.sin(yaw_rad)
    rows = np.asarray(path.rows, np.float64)[1:-1]
    first = int(np.argmin(np.hypot(rows[:, 0] - ahead_x[0], rows[:, 1] - ahead_y[0])))
    start = jnp.float32(first * float(path.spacing_m))
    arc, offset = _follow(path, start, jnp.asarray(ahead_x, jnp.float32), jnp.asarray(ahead_y, jnp.float32))
    at = path_point(path, arc)
    length = float(path.length_m)
    along, away = np.asarray(arc, np.float64), np.asarray(offset, np.float64)
    on = (along > 0.0) & (along < length) & (np.abs(away) < 20.0)
    near = np.abs(away) < NEAR_PATH_M
    if np.count_nonzero(on) < 20 or np.count_nonzero(on & near) < 0.5 * len(away):
        raise NotExcitedError(
            "path", f"a drive within {NEAR_PATH_M:g} m of it", f"{np.mean(on & near):.0%} of the drive"
        )
    error = yaw_rad - np.arctan2(np.asarray(at.sin, np.float64), np.asarray(at.cos, np.float64))
    parts = (
        time_s,
        away,
        sigma_m,
        np.arctan2(np.sin(error), np.cos(error)),
        np.asarray(at.curvature_radpm, np.float64),
    )
    return TrackedDrive(*(part[on] for part in (*parts, answer_radpm, speed_mps, engaged)))


def path_of_feet(
    x_m: Float[np.ndarray, " tick"],
    y_m: Float[np.ndarray, " tick"],
    yaw_rad: Float[np.ndarray, " tick"],
    offset_m: Float[np.ndarray, " tick"],
) -> Path:
    """The path that a drive's own offsets were measured from.

    Args:
        x_m, y_m: of the point that follows.
        yaw_rad: of the body, the first guess of the path's direction.
        offset_m: to the left of the path, finite.
    """
    direction = yaw_rad
    for _ in range(4):
        foot_x, foot_y = x_m + np.sin(direction) * offset_m, y_m - np.cos(direction) * offset_m
        kept = _apart(foot_x, foot_y, 0.5)
        way = np.append(0.0, np.cumsum(np.hypot(np.diff(foot_x[kept]), np.diff(foot_y[kept]))))
        heading = np.unwrap(np.arctan2(np.gradient(foot_y[kept]), np.gradient(foot_x[kept])))
        direction = np.interp(np.interp(np.arange(len(x_m)), kept, way), way, heading)
    return path_from_points(_smoothed(np.stack([foot_x[kept], foot_y[kept]], axis=1)))


def path_of_drive(x_m: Float[np.ndarray, " tick"], y_m: Float[np.ndarray, " tick"]) -> Path:
    """The path along the places of a drive."""
    kept = _apart(x_m, y_m, 0.5)
    return path_from_points(_smoothed(np.stack([x_m[kept], y_m[kept]], axis=1)))


def _apart(x_m: np.ndarray, y_m: np.ndarray, least_m: float) -> np.ndarray:
    """Numbers of places that are each so far from the last one kept."""
    way = np.append(0.0, np.cumsum(np.hypot(np.diff(x_m), np.diff(y_m))))
    return np.asarray(np.unique(np.searchsorted(way, np.arange(0.0, way[-1], least_m))))


def _smoothed(points: np.ndarray) -> np.ndarray:
    """Centimetres of noise would be curvature: a parabola over two metres, at both ends as they are."""
    if len(points) < 5:
        return points
    weights = np.array([-3.0, 12.0, 17.0, 12.0, -3.0]) / 35.0
    inner = sum(w * points[i : len(points) - 4 + i] for i, w in enumerate(weights))
    return np.concatenate([points[:2], np.asarray(inner), points[-2:]])


def track(drives: list[TrackedDrive]) -> list[Tracking]:
    """The figures of each drive."""
    return [Tracking(tuple(_bands(one)), tuple(_engagements(one)), _cycle(one), _gains(one)) for one in drives]


def speed_bands(drives: list[TrackedDrive]) -> tuple[SpeedBand, ...]:
    """RMS by speed over several drives together."""
    joined = TrackedDrive(*(np.concatenate(parts) for parts in zip(*drives, strict=True)))
    return tuple(_bands(joined))


def _bands(one: TrackedDrive) -> list[SpeedBand]:
    found = []
    tick_s = float(np.median(np.diff(one.time_s)))
    for engaged in (True, False):
        for low, high in pairwise(SPEED_EDGES_MPS):
            speed = np.abs(one.speed_mps)
            inside = (one.engaged == engaged) & (speed >= low) & (speed < high) & np.isfinite(one.offset_m)
            if np.count_nonzero(inside) * tick_s < LEAST_S:
                continue
            square = one.offset_m[inside] ** 2
            records = independent_share(square) * len(square)
            mean, spread = float(np.mean(square)), float(np.std(square))
            # The logarithm of a mean square is nearer to normal than the mean square.
            sigma = spread / np.sqrt(records) / max(mean, 1e-12)
            half = student_95(max(records - 1.0, 3.0)) * sigma
            root = np.sqrt(mean)
            interval = Estimate(root, 0.5 * sigma * root, root * np.exp(-0.5 * half), root * np.exp(0.5 * half))
            found.append(SpeedBand(engaged, low, high, interval, len(square) * tick_s, records))
    return found


def _engagements(one: TrackedDrive) -> list[Engagement]:
    begins = np.flatnonzero(one.engaged & ~np.append(False, one.engaged[:-1]))
    ends = np.flatnonzero(one.engaged & ~np.append(one.engaged[1:], False)) + 1
    found = []
    for begin, end in zip(begins, ends, strict=True):
        offset, time_s = one.offset_m[begin:end], one.time_s[begin:end]
        if time_s[-1] - time_s[0] < LEAST_S:
            continue
        step = STEPS_M[int(np.argmin([abs(at - offset[0]) for at in STEPS_M]))]
        if abs(step - offset[0]) > NEAR_M:
            continue
        outside = np.flatnonzero(np.abs(offset) > TOLERANCE_M)
        last = int(outside[-1]) + 1 if len(outside) else 0
        settled = last < len(offset)
        last = min(last, len(offset) - 1)
        way = np.append(0.0, np.cumsum(np.abs(one.speed_mps[begin + 1 : end]) * np.diff(time_s)))
        over = float(max(np.max(-np.sign(step) * offset), 0.0)) if step else 0.0
        speed = float(np.mean(np.abs(one.speed_mps[begin : begin + last + 1])))
        found.append(
            Engagement(
                step_m=step,
                offset_m=float(offset[0]),
                speed_mps=speed,
                settled=settled,
                settling_s=float(time_s[last] - time_s[0]),
                settling_m=float(way[last]),
                overshoot_m=over,
            )
        )
    return found


def _cycle(one: TrackedDrive) -> LimitCycle | None:
    cuts = np.flatnonzero((np.diff(one.engaged.astype(int)) != 0) | (np.diff(one.time_s) > 1.0)) + 1
    steered = [part for part in np.split(np.arange(len(one.time_s)), cuts) if one.engaged[part[0]]]
    if not steered:
        return None
    longest = max(steered, key=len)
    try:
        return find_limit_cycle(one.time_s[longest], one.offset_m[longest], bend_radpm=one.curvature_radpm[longest])
    except NotExcitedError:
        return None


def _gains(one: TrackedDrive) -> Gains | None:
    """Gains where the path is straight now and for seconds ahead: in a bend the law answers what lies ahead, too."""
    ahead = round(_AHEAD_S / float(np.median(np.diff(one.time_s))))
    bent = np.abs(np.append(one.curvature_radpm, np.full(ahead, np.nan)))
    windows = np.lib.stride_tricks.sliding_window_view(bent, ahead + 1)
    straight = np.nanmax(windows, axis=1) < _STRAIGHT_RADPM
    used = one.engaged & straight & np.isfinite(one.offset_m + one.answer_radpm) & (np.abs(one.offset_m) < _LINEAR_M)
    if np.count_nonzero(used) < 60 or float(np.std(one.offset_m[used])) < 0.02:
        return None
    design = np.stack([np.ones(len(used)), -one.offset_m, -one.heading_error_rad], axis=1)[used]
    try:
        fit = robust_fit(design, one.answer_radpm[used], serial=True)
    except NotExcitedError:
        return None
    offset, heading = (combine(fit, np.eye(3)[column]) for column in (1, 2))
    look = heading.value / offset.value if offset.low > 0.0 else float("nan")
    return Gains(offset, heading, look)
