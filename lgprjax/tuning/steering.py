"""How the vehicle turns: wheel angle, rear ratio (k), yaw gain, drift of the axle.

Each setting of the steering wheel is driven as an arc forward and back. Its curvature is that of the rear axle's path;
with wheelbase and k it gives the front angle. The intervals are those of the arcs: an error of k or of the wheelbase
is not in them (0.01 of k is 0.6 % of the angle).
"""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

from lgprjax.tuning.arcs import Arcs, serial_memory
from lgprjax.tuning.robust import (
    Estimate,
    NotExcitedError,
    combine,
    estimate,
    robust_fit,
    robust_line,
    student_95,
    weighted_fit,
)
from lgprjax.vehicle.kinematics import Chassis, MeasuredRear, ProportionalRear, turn_of, yaw_gain
from lgprjax.vehicle.sensors import DriveSignals

# The characteristic speed V of the yaw gain, from turning tests at several speeds.
#
# G = (yaw rate) / (v κ) = 1 / (1 + (v/V)²), so that 1/G is a straight line in v². A wheel angle that is some per cent
# wrong multiplies 1/G at all speeds alike, and one that is turned by a constant moves left and right turns apart: both
# are fitted with the slope, 1/V².

_LEAST_TURN, _LEAST_TESTED_TURN = 0.1, 0.06
"""κL of a turn that is used. In turning tests front wheels alone make 0.1 of the 6 degrees that a crew is asked for."""
LEAST_SPEEDS = 2.0
"""Fastest over slowest speed."""
_LEAST_TURNS = 6
_STEP_RAD = 0.01


class YawGainFit(NamedTuple):
    """Yaw gain from turning tests.

    Attributes:
        characteristic_speed_mps: V; its interval has no upper end where no loss at all would do as well.
        inverse_square_s2pm2: 1/V², whose interval is the symmetric one.
        scale: geometric over true curvature at no speed: 1 where the wheel angles are right.
        offset_rad: by which the front angles read too far to the left; 0 where all turns are to one side.
        speed_mps, gain, sigma_gain: of each stretch used.
        extra: scatter of 1/G beyond what the arcs explain.
    """

    characteristic_speed_mps: Estimate
    inverse_square_s2pm2: Estimate
    scale: Estimate
    offset_rad: float
    speed_mps: Float[np.ndarray, " stretch"]
    gain: Float[np.ndarray, " stretch"]
    sigma_gain: Float[np.ndarray, " stretch"]
    extra: float


def fit_yaw_gain(
    arcs: Arcs,
    chassis: Chassis,
    front_rad: Float[np.ndarray, " stretch"],
    sigma_front_rad: Float[np.ndarray, " stretch"],
) -> YawGainFit:
    """Fit V.

    Args:
        arcs: of turning tests.
        chassis: wheelbase and rear wheels; its characteristic speed is what is sought.
        front_rad, sigma_front_rad: front angle of each stretch, measured or by the steering map from the steering
            signal, and the standard error of it.

    Raises:
        NotExcitedError: too few turns, or speeds that span too little.
    """
    geometry = _geometry(chassis, front_rad)
    used = np.abs(geometry.bend) * float(chassis.wheelbase_m) >= _LEAST_TESTED_TURN
    if used.sum() < _LEAST_TURNS:
        raise NotExcitedError("turning tests", f"{_LEAST_TURNS} turns or more", f"{used.sum()}")
    geometry = _Geometry(*(part[used] for part in geometry))
    curvature, front = arcs.curvature_radpm[used], front_rad[used]
    # The axle's path is bent by c = Gκ / √(1 + (G tan ψ)²).
    left = np.sqrt(np.maximum(geometry.bend**2 - (curvature * geometry.tangent) ** 2, 1e-12))
    gain, sigma_gain = np.abs(curvature) / left, arcs.sigma_radpm[used] * geometry.bend**2 / left**3
    sigma_gain = np.hypot(sigma_gain, gain * geometry.turned * sigma_front_rad[used])
    speed = arcs.speed_mps[used] / np.hypot(1.0, gain * geometry.tangent)
    if speed.max() < LEAST_SPEEDS * speed.min():
        wanted = f"speeds of which the fastest is {LEAST_SPEEDS:g} times the slowest"
        raise NotExcitedError("turning tests", wanted, f"{speed.min():.1f} to {speed.max():.1f} m/s")
    columns = [np.ones(len(speed)), speed**2]
    if front.min() < 0.0 < front.max():
        columns.append(geometry.turned / gain)
    fit = weighted_fit(np.stack(columns, axis=1), 1.0 / gain, sigma_gain / gain**2)
    scale, slope = fit.coefficients[:2]
    by_both = np.array([-slope / scale**2, 1.0 / scale])
    sigma = float(np.sqrt(by_both @ fit.covariance[:2, :2] @ by_both))
    inverse_square = estimate(float(slope / scale), sigma, fit.degrees)
    return YawGainFit(
        characteristic_speed_mps=_speed(inverse_square),
        inverse_square_s2pm2=inverse_square,
        scale=estimate(float(scale), float(np.sqrt(fit.covariance[0, 0])), fit.degrees),
        offset_rad=float(fit.coefficients[2] / scale) if len(columns) == 3 else 0.0,
        speed_mps=speed,
        gain=gain,
        sigma_gain=sigma_gain,
        extra=fit.extra,
    )


class _Geometry(NamedTuple):
    """Curvature of the turn, tan ψ, and the share of the curvature that a radian of the front angle makes."""

    bend: Float[np.ndarray, " stretch"]
    tangent: Float[np.ndarray, " stretch"]
    turned: Float[np.ndarray, " stretch"]


def _geometry(chassis: Chassis, front_rad: Float[np.ndarray, " stretch"]) -> _Geometry:
    front = jnp.asarray(front_rad, jnp.float32)
    (low, _), (bend, tangent), (high, _) = (
        (np.asarray(part, np.float64) for part in turn_of(chassis, front + jnp.float32(away)))
        for away in (-_STEP_RAD, 0.0, _STEP_RAD)
    )
    return _Geometry(bend, tangent, (high - low) / (2.0 * _STEP_RAD * np.where(bend == 0.0, np.inf, bend)))


def _speed(inverse_square: Estimate) -> Estimate:
    """V of 1/V²: infinite where the latter is not above 0."""
    value, low, high = (
        number**-0.5 if number > 0.0 else float("inf")
        for number in (inverse_square.value, inverse_square.high, inverse_square.low)
    )
    sigma = 0.5 * value**3 * inverse_square.sigma if value < float("inf") else float("inf")
    return Estimate(value, sigma, low, high)


# The path of the rear axle that wheel angles make, and wheel angles from it.
#
# The axle moves at the angle −atan(G tan ψ) to the body, G being the yaw gain of the speed, so that its path is less
# bent than the turn is: by Gκ / √(1 + (G tan ψ)²). With G = 1 that is 1 / √(y_c² + x_c²) of the turn centre (x_c,
# y_c).

_POINTS = 601
_BEYOND = 1.3
"""Of the largest angle, to both sides: a curvature with noise has an angle too."""


class AxleTrack(NamedTuple):
    """Table over front angles.

    Attributes:
        front_rad: rising.
        curvature_radpm: of the rear axle's path.
        slip_rad: its direction less the body's.
    """

    front_rad: Float[np.ndarray, " angle"]
    curvature_radpm: Float[np.ndarray, "stretch angle"]
    slip_rad: Float[np.ndarray, "stretch angle"]


def axle_track(chassis: Chassis, speed_mps: Float[np.ndarray, " stretch"]) -> AxleTrack:
    """Path of the rear axle over front angles, at each speed of the axle along its path."""
    largest = _BEYOND * float(chassis.largest_angle_rad)
    front = jnp.linspace(-largest, largest, _POINTS)
    turn = turn_of(chassis, front)
    bend, tangent = (np.asarray(part, np.float64)[None] for part in turn)
    forward = np.broadcast_to(speed_mps[:, None], (len(speed_mps), _POINTS))
    for _ in range(2):
        gain = np.asarray(yaw_gain(chassis.characteristic_speed_mps, jnp.asarray(forward, jnp.float32)), np.float64)
        forward = speed_mps[:, None] / np.hypot(1.0, gain * tangent)
    return AxleTrack(
        np.asarray(front, np.float64), gain * bend / np.hypot(1.0, gain * tangent), -np.arctan(gain * tangent)
    )


def front_of_curvature(
    track: AxleTrack, curvature_radpm: Float[np.ndarray, " stretch"]
) -> tuple[Float[np.ndarray, " stretch"], Float[np.ndarray, " stretch"]]:
    """Front angle of each curvature, and dφ/dc; at the ends of the table beyond it."""
    rows, last = np.arange(len(curvature_radpm)), _POINTS - 1
    after = np.clip(np.sum(track.curvature_radpm < curvature_radpm[:, None], axis=1), 1, last)
    low, high = track.curvature_radpm[rows, after - 1], track.curvature_radpm[rows, after]
    slope = (track.front_rad[after] - track.front_rad[after - 1]) / (high - low)
    front = track.front_rad[after - 1] + slope * (
        np.clip(curvature_radpm, *track.curvature_radpm[:, [0, last]].T) - low
    )
    return front, slope


def rear_axle_slip(
    chassis: Chassis, ratio: float, speed_mps: float, curvature_radpm: Float[np.ndarray, " step"]
) -> Float[np.ndarray, " step"]:
    """Direction of the rear axle's path less the body's, at curvatures of that path, were k the ratio."""
    track = axle_track(chassis._replace(rear=ProportionalRear(jnp.float32(ratio))), np.array([speed_mps]))
    return np.asarray(np.interp(curvature_radpm, track.curvature_radpm[0], track.slip_rad[0]))


_DEGREE = 3
_LEAST_SPAN = 0.2
"""Of the largest angle, on each side, that the settings must reach."""


class SteeringMap(NamedTuple):
    """Front angle as a polynomial of the steering signal, ``u = (signal - middle) / half_span``.

    Attributes:
        middle, half_span: of the signal over the settings driven, in its unit; the map is good within them.
        coefficients_rad: of 1, u, u², u³.
        covariance_rad2: of them.
        degrees: of freedom of the intervals.
    """

    middle: float
    half_span: float
    coefficients_rad: Float[np.ndarray, " coefficient"]
    covariance_rad2: Float[np.ndarray, "coefficient coefficient"]
    degrees: float


class WheelAngleFit(NamedTuple):
    """Steering map from a palm tree.

    Attributes:
        map: front angle over the steering signal.
        steering: of each setting.
        front_rad, sigma_rad: angle that its arcs give, and the standard error of that.
        residual_rad: angle less map.
        extra_rad: scatter of the settings about the map beyond what the arcs explain: play, or a bend that the map has
            not.
        dropped: stretches left out, by reason.
    """

    map: SteeringMap
    steering: Float[np.ndarray, " setting"]
    front_rad: Float[np.ndarray, " setting"]
    sigma_rad: Float[np.ndarray, " setting"]
    residual_rad: Float[np.ndarray, " setting"]
    extra_rad: float
    dropped: dict[str, int]


def fit_wheel_angle(arcs: Arcs, chassis: Chassis) -> WheelAngleFit:
    """Fit the map from the steering signal to the front angle.

    Args:
        arcs: of a palm tree, driven slowly where the characteristic speed is not known.
        chassis: wheelbase, k or measured rear angles, largest angle, characteristic speed (infinite where unknown).

    Raises:
        NotExcitedError: too few settings, none to one side, or a map that does not rise or fall all along.
    """
    single, slope = front_of_curvature(axle_track(chassis, arcs.speed_mps), arcs.curvature_radpm)
    sigma = arcs.sigma_radpm * slope
    steering, sigma_steering, front, sigma = mean_of_settings(arcs, single, sigma)
    largest = float(chassis.largest_angle_rad)
    if front.min() > -_LEAST_SPAN * largest or front.max() < _LEAST_SPAN * largest:
        degrees = np.degrees(_LEAST_SPAN * largest)
        found = f"{np.degrees(front.min()):.1f}° to {np.degrees(front.max()):.1f}°"
        raise NotExcitedError("palm tree", f"turns beyond {degrees:.1f}° to both sides", found)
    middle, half = 0.5 * float(steering.max() + steering.min()), 0.5 * float(np.ptp(steering))
    u = (steering - middle) / half
    # On long arcs the noise of the steering signal is the larger one.
    per_unit = (front[-1] - front[0]) / (steering[-1] - steering[0])
    sigma = np.hypot(sigma, per_unit * sigma_steering)
    fit = weighted_fit(np.vander(u, _DEGREE + 1, increasing=True), front, sigma)
    rise = np.diff(np.vander(np.linspace(-1.0, 1.0, 101), _DEGREE + 1, increasing=True) @ fit.coefficients)
    if not (np.all(rise > 0.0) or np.all(rise < 0.0)):
        raise NotExcitedError("palm tree", "an angle monotonic in the steering", "an angle that reverses")
    found_map = SteeringMap(middle, half, fit.coefficients, fit.covariance, fit.degrees)
    return WheelAngleFit(
        map=found_map,
        steering=steering,
        front_rad=front,
        sigma_rad=sigma,
        residual_rad=fit.residual,
        extra_rad=fit.extra,
        dropped=arcs.stretches.dropped,
    )


def front_angle(steering_map: SteeringMap, steering: Float[np.ndarray, " record"]) -> Float[np.ndarray, " record"]:
    """Front angle at values of the steering signal."""
    front: Float[np.ndarray, " record"] = _rows(steering_map, steering) @ steering_map.coefficients_rad
    return front


def front_band(
    steering_map: SteeringMap, steering: Float[np.ndarray, " record"]
) -> tuple[Float[np.ndarray, " record"], Float[np.ndarray, " record"]]:
    """95 % interval of the front angle at each value of the steering signal, low and high."""
    rows = _rows(steering_map, steering)
    sigma = np.sqrt(np.einsum("rc,cd,rd->r", rows, steering_map.covariance_rad2, rows))
    middle, half = rows @ steering_map.coefficients_rad, student_95(steering_map.degrees) * sigma
    return middle - half, middle + half


def mean_of_settings(
    arcs: Arcs, value: Float[np.ndarray, " stretch"], sigma: Float[np.ndarray, " stretch"]
) -> tuple[
    Float[np.ndarray, " setting"],
    Float[np.ndarray, " setting"],
    Float[np.ndarray, " setting"],
    Float[np.ndarray, " setting"],
]:
    """Steering signal and a value of the arcs, each with its standard error: weighted means of each setting."""
    setting = np.unique(arcs.stretches.setting, return_inverse=True)[1]
    precision = 1.0 / sigma**2
    total = np.bincount(setting, precision)
    steering = np.bincount(setting, precision * arcs.stretches.steering) / total
    sigma_steering = np.sqrt(np.bincount(setting, (precision * arcs.stretches.sigma_steering) ** 2)) / total
    return steering, sigma_steering, np.bincount(setting, precision * value) / total, 1.0 / np.sqrt(total)


def _rows(steering_map: SteeringMap, steering: Float[np.ndarray, " record"]) -> Float[np.ndarray, "record coefficient"]:
    at = (steering - steering_map.middle) / steering_map.half_span
    return np.vander(at, len(steering_map.coefficients_rad), increasing=True)


# Linear fits to numbers along a drive whose errors have a part that drifts: an INS heading between its corrections.
#
# The errors are white, each of its own size, and a Gauss-Markov process. Its share and its time constant are not known
# and cannot be found well from a few dozen numbers, so that they are averaged over by their likelihood (the restricted
# one: that of what the fit leaves): the interval holds with a drift and without.

_SHARES = np.array([1.0, 3.0, 10.0, 30.0, 100.0, 300.0])
"""Variance of the drift, over the median of those of the white errors."""
_NONE_ODDS = 4.0
_DRIFT_S = np.array([10.0, 30.0, 90.0, 270.0, 800.0])


class DriftingFit(NamedTuple):
    """A linear fit.

    Attributes:
        coefficients: one a column of the design.
        covariance: of them.
        degrees: of freedom of the intervals.
        drift: standard deviation of the drifting part, on average over what is likely.
    """

    coefficients: Float[np.ndarray, " coefficient"]
    covariance: Float[np.ndarray, "coefficient coefficient"]
    degrees: float
    drift: float


def drifting_fit(
    design: Float[np.ndarray, "number coefficient"],
    y: Float[np.ndarray, " number"],
    sigma: Float[np.ndarray, " number"],
    time_s: Float[np.ndarray, " number"],
    *,
    drift_seen: bool,
) -> DriftingFit:
    """Fit ``y = design @ coefficients``.

    Args:
        design: one column a coefficient.
        y: numbers.
        sigma: standard errors of their white parts.
        time_s: of the numbers.
        drift_seen: whether there is a sign of one elsewhere; without it none is held for more likely than not.

    Raises:
        NotExcitedError: fewer than three numbers more than coefficients, or columns that depend on each other.
    """
    numbers, columns = design.shape
    if numbers < columns + 3:
        raise NotExcitedError("fit", f"{columns + 3} stretches or more", f"{numbers}")
    if not np.linalg.cond(design / np.linalg.norm(design, axis=0)) < 1e8:
        raise NotExcitedError("fit", f"{columns} quantities that vary independently", "dependent quantities")
    share, drift_s = (grid.ravel() for grid in np.meshgrid(_SHARES, _DRIFT_S))
    # The last candidate has no drift, for any time constant.
    share, drift_s = np.append(share, 0.0), np.append(drift_s, 1.0)
    typical = float(np.median(sigma)) ** 2
    apart_s = np.abs(time_s[:, None] - time_s[None, :])
    drifting = typical * share[:, None, None] * np.exp(-apart_s / drift_s[:, None, None])
    inverse = np.linalg.inv(drifting + np.diag(sigma**2))
    information = design.T @ inverse @ design
    spread = np.linalg.inv(information)
    found = (spread @ (design.T @ inverse @ y)[..., None])[..., 0]
    residual = y - found @ design.T
    square = np.einsum("ci,cij,cj->c", residual, inverse, residual)
    free = numbers - columns
    log_likelihood = 0.5 * (np.linalg.slogdet(inverse)[1] - np.linalg.slogdet(information)[1] - free * np.log(square))
    likely = np.exp(log_likelihood - np.max(log_likelihood))
    if not drift_seen:
        likely[-1] *= _NONE_ODDS * (len(likely) - 1)
    likely /= np.sum(likely)
    mean = likely @ found
    away = found - mean
    within = np.einsum("c,cpq->pq", likely * square / free, spread)
    drift = float(np.sqrt(np.sum(likely * share * square / free) * typical))
    return DriftingFit(mean, within + (away * likely[:, None]).T @ away, float(free), drift)


# Calibration 4: k, the rear wheels' share of the front angle, by heading or by two measured wheel angles.
#
# The curvature of a turn gives (1 + k) φ and no more. k shows in the place of the turn's centre along the body,
# x_c: the rear axle moves at −ψ to the body, ψ = kφ, so that the direction of its path less the INS heading, over the
# curvature, is −x_c, which tends to −kL / (1 + k). An INS that is mounted askew adds a constant; left turns and right
# turns separate it from k. The other way is to measure both wheel angles.

_ONLY_CURVATURE = "turning curvature only, which gives (1 + k) φ and not k"
"""κL that turns to both sides must reach, and rad that measured front angles must span."""
_LARGEST_MISALIGNMENT_RAD = 0.5
_ROUNDS = 3
_STEP = 0.01
_BLOCK_S = 1.0


class RearRatioFit(NamedTuple):
    """k of a drive.

    Attributes:
        ratio: k.
        offset_rad: what the fit had to take off: by heading, how far INS headings are turned against the body's, to the
            left; by wheel angles, the rear angle where the front one is 0.
        drift_rad: drift of the headings, in addition to their white noise; 0 by wheel angles.
        numbers: stretches, or blocks of records, that the fit used.
    """

    ratio: Estimate
    offset_rad: Estimate
    drift_rad: float
    numbers: int


def rear_ratio_by_heading(arcs: Arcs, chassis: Chassis) -> RearRatioFit:
    """k from the arcs of a palm tree or of turning tests.

    Args:
        arcs: with headings.
        chassis: wheelbase, largest angle and characteristic speed; its rear wheels are what is sought.

    Raises:
        NotExcitedError: there are no headings, or headings of the motion; no turns to one side; too few stretches.
    """
    known = np.isfinite(arcs.slip_rad)
    if not known.any():
        raise NotExcitedError("k", "positions with INS headings, or both wheel angles", _ONLY_CURVATURE)
    if np.any(np.abs(arcs.slip_rad[known]) > _LARGEST_MISALIGNMENT_RAD + float(chassis.largest_angle_rad)):
        raise NotExcitedError(
            "INS heading", "the heading of the body", "a far larger offset, or the direction of motion"
        )
    bend = arcs.curvature_radpm * float(chassis.wheelbase_m)
    if bend[known].max() < _LEAST_TURN or bend[known].min() > -_LEAST_TURN:
        wanted = f"turns of {_LEAST_TURN / float(chassis.wheelbase_m):.3f} rad/m to both sides"
        found = f"{arcs.curvature_radpm[known].min():.3f} to {arcs.curvature_radpm[known].max():.3f} rad/m"
        raise NotExcitedError("k", wanted, found)
    ratio = 0.5
    for step in range(_ROUNDS):
        model, ahead = (_slip_model(arcs, chassis, k, known) for k in (ratio, ratio + _STEP))
        # An error of the curvature, too, moves the slip that k foretells.
        lever_m = np.abs(model) / np.maximum(np.abs(arcs.curvature_radpm[known]), 1e-6)
        sigma = np.hypot(arcs.sigma_slip_rad[known], lever_m * arcs.sigma_radpm[known])
        design = np.stack([np.ones(len(model)), (ahead - model) / _STEP], axis=1)
        left = arcs.slip_rad[known] - model
        if step < _ROUNDS - 1:
            ratio += float(np.linalg.lstsq(design / sigma[:, None], left / sigma, rcond=None)[0][1])
            ratio = float(np.clip(ratio, 0.0, 2.0))
    # A drift shows within the stretches too: their headings remember.
    fit = drifting_fit(design, left, sigma, arcs.time_s[known], drift_seen=arcs.heading_memory > 1.0)
    ratio += float(fit.coefficients[1])
    sigma_offset, sigma_ratio = np.sqrt(np.diag(fit.covariance))
    return RearRatioFit(
        estimate(ratio, float(sigma_ratio), fit.degrees),
        estimate(-float(fit.coefficients[0]), float(sigma_offset), fit.degrees),
        fit.drift,
        len(left),
    )


def rear_ratio_by_angles(signals: DriveSignals) -> RearRatioFit:
    """k from measured front and rear wheel angles, moving or standing still.

    Raises:
        NotExcitedError: an angle is missing, the front wheels were hardly turned, too few records, or front and rear
            wheels turn the same way.
    """
    front, rear = wheel_angle_blocks(signals)
    if np.ptp(front) < _LEAST_TURN:
        raise NotExcitedError("front_rad", f"angles over {_LEAST_TURN} rad", f"over {np.ptp(front):.3f} rad")
    fit = robust_line(front, rear, serial=True)
    offset, slope = combine(fit, np.array([1.0, 0.0])), combine(fit, np.array([0.0, 1.0]))
    ratio = Estimate(-slope.value, slope.sigma, -slope.high, -slope.low)
    if ratio.high < 0.0:
        expected = (
            "angles of rear wheels that counter-steer, left positive as in front; is a sign wrong (scale = -1.0)?"
        )
        raise NotExcitedError("rear_rad", expected, f"front and rear turn the same way (k = {ratio.value:.3f})")
    return RearRatioFit(ratio, offset, 0.0, len(front))


def wheel_angle_blocks(
    signals: DriveSignals,
) -> tuple[Float[np.ndarray, " block"], Float[np.ndarray, " block"]]:
    """Means of measured front and rear angles over a second each: noise of the front angle would flatten the line.

    Raises:
        NotExcitedError: an angle is missing.
    """
    if signals.front_rad is None or signals.rear_rad is None:
        raise NotExcitedError("k", "both wheel angles, or positions with INS headings", _ONLY_CURVATURE)
    known = np.isfinite(signals.front_rad + signals.rear_rad)
    if not known.any():
        raise NotExcitedError("k", "records with both wheel angles", "none")
    block = np.floor((signals.time_s[known] - signals.time_s[0]) / _BLOCK_S)
    start = np.concatenate([[0], np.flatnonzero(np.diff(block)) + 1])
    count = np.diff(np.append(start, len(block)))
    front, rear = (np.add.reduceat(angle[known], start) / count for angle in (signals.front_rad, signals.rear_rad))
    full = count >= 0.5 * np.median(count)
    return front[full], rear[full]


def _slip_model(
    arcs: Arcs, chassis: Chassis, ratio: float, known: Bool[np.ndarray, " stretch"]
) -> Float[np.ndarray, " known"]:
    """Direction of the rear axle's path to the body, at the curvatures measured, were k this."""
    trial = chassis._replace(rear=ProportionalRear(jnp.float32(ratio)))
    track = axle_track(trial, arcs.speed_mps[known])
    front, _ = front_of_curvature(track, arcs.curvature_radpm[known])
    rows = zip(front, track.slip_rad, strict=True)
    return np.array([np.interp(angle, track.front_rad, slip) for angle, slip in rows])


# The measured rear angle over the front angle, and how far a model of it is off: k, or the linkage of LL eq. 4.

_LEAST_SPAN_RAD = 0.1


class RearMapFit(NamedTuple):
    """ψ(φ) of a log; the zeros of both sensors are taken for right.

    Attributes:
        rear: for a chassis.
        front_rad: of its knots.
        low_rad, high_rad: 95 % interval of ψ at the knots.
        scale_rad: scatter of the records' means about it.
    """

    rear: MeasuredRear
    front_rad: Float[np.ndarray, " knot"]
    low_rad: Float[np.ndarray, " knot"]
    high_rad: Float[np.ndarray, " knot"]
    scale_rad: float


def fit_rear_map(signals: DriveSignals, *, knots: int = 9) -> RearMapFit:
    """Fit ψ(φ), linear between evenly spaced knots, to measured front and rear angles.

    Args:
        signals: with both wheel angles, turned over the range that the map is to cover.
        knots: of the map.

    Raises:
        NotExcitedError: an angle is missing, the front wheels were hardly turned, or a knot has no records near it.
    """
    front, rear = wheel_angle_blocks(signals)
    if np.ptp(front) < _LEAST_SPAN_RAD:
        raise NotExcitedError("front_rad", f"angles over {_LEAST_SPAN_RAD} rad", f"over {np.ptp(front):.3f} rad")
    knot_rad = np.linspace(front.min(), front.max(), knots)
    step_rad = float(knot_rad[1] - knot_rad[0])
    hats = np.maximum(1.0 - np.abs(front[:, None] - knot_rad[None, :]) / step_rad, 0.0)
    few = np.flatnonzero(hats.sum(axis=0) < 1.0)
    if few.size:
        raise NotExcitedError(
            "front_rad", f"records near each of {knots} knots", f"none near {np.degrees(knot_rad[few[0]]):.1f}°"
        )
    fit = robust_fit(hats, -rear)
    limit = 3.0 * fit.scale
    clipped = np.clip(-rear - hats @ fit.coefficients, -limit, limit)[None]
    memory = serial_memory(clipped, np.ones(clipped.shape, dtype=bool), knots)
    half = student_95(fit.degrees) * np.sqrt(memory * np.diag(fit.covariance))
    measured = MeasuredRear(jnp.float32(knot_rad[0]), jnp.float32(step_rad), jnp.asarray(fit.coefficients, jnp.float32))
    return RearMapFit(measured, knot_rad, fit.coefficients - half, fit.coefficients + half, fit.scale)
