"""The vehicle's own navigation on a drive: odometer, and a GNSS/INS track with slow errors.

A GNSS/INS track's error is a slow Gauss-Markov process about a bias. Reflected signals (jumps) displace it for a
while without a word. In an outage the inertial sensors carry on from the last place and heading: the velocity's
error is a random walk (w m/s a root second) and so is the heading's (h rad a root second), each step of which turns
the rest of the path about the place where it came. After t seconds straight on at speed v the error has grown by
w t**1.5 / sqrt(3) along and sqrt(w**2 + v**2 h**2) t**1.5 / sqrt(3) across. When the signal is back, so is the fix.
"""

from dataclasses import dataclass
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int, PRNGKeyArray

from lgprjax.scene.motion import DriveMotion, poses_at
from lgprjax.vehicle.kinematics import VehiclePose

Intervals = tuple[tuple[float, float], ...]


@dataclass(frozen=True)
class NavigationErrors:
    """Errors of the navigation sensors. Events come at given times, and at random at a rate; none by default.

    Attributes:
        rate_hz, odometer_rate_hz: rates of the pose track and of the odometer (``None``: the same).
        position_sigma_m, position_bias_m: standard deviation of east and north, and constant bias (east, north).
        height_sigma_m, heading_sigma_rad, roll_sigma_rad: standard deviations of the other components.
        correlation_s: time constant of these errors: first-order Gauss-Markov, exp(-t / correlation).
        jump_start_s, jumps_per_hour, jump_held_s, jump_sigma_m: start times, rate, duration and standard deviation of
            jumps, which displace east and north at once.
        jump_sigma_factor: reported position sigmas during a jump, relative to those without; 1: the jump is not
            reported.
        outages_s, outages_per_hour, outage_held_s: (start, stop) intervals without GNSS.
        velocity_walk, heading_walk: random walks in an outage, m/s/√s (each of east, north and height) and rad/√s.
        odometer_scale_error, odometer_noise_m: distance reads (1 + scale) times the truth plus white noise.
        odometer_drift, odometer_drift_s: sigma and time constant of a slow part of the scale (Gauss-Markov).
        slips_s, slips_per_hour, slip_held_s: (start, stop) intervals in which the wheels slip.
        slip_fraction: share by which the wheels turn more than the ground passes.
        odometer_step_m: distance per count of the encoder; 0: continuous readings.
    """

    rate_hz: float = 100.0
    position_sigma_m: float = 0.05
    position_bias_m: tuple[float, float] = (0.0, 0.0)
    height_sigma_m: float = 0.05
    heading_sigma_rad: float = 0.3 * np.pi / 180
    roll_sigma_rad: float = 0.1 * np.pi / 180
    correlation_s: float = 20.0
    odometer_scale_error: float = 0.005
    odometer_noise_m: float = 0.002
    odometer_rate_hz: float | None = None
    jump_start_s: tuple[float, ...] = ()
    jumps_per_hour: float = 0.0
    jump_held_s: float = 10.0
    jump_sigma_m: float = 2.0
    jump_sigma_factor: float = 1.0
    outages_s: Intervals = ()
    outages_per_hour: float = 0.0
    outage_held_s: float = 30.0
    velocity_walk: float = 0.003
    heading_walk: float = 0.05 * np.pi / 180 / 60**0.5
    odometer_drift: float = 0.0
    odometer_drift_s: float = 60.0
    slips_s: Intervals = ()
    slips_per_hour: float = 0.0
    slip_held_s: float = 1.0
    slip_fraction: float = 0.1
    odometer_step_m: float = 0.0


class OdometerTrack(NamedTuple):
    """Distance run since the start, from the wheels."""

    time_s: Float[np.ndarray, " time"]
    distance_m: Float[np.ndarray, " time"]


class PoseTrack(NamedTuple):
    """Poses of the body origin (east_m, north_m, height_m, yaw_rad, roll_rad).

    ``sigma`` is the reported standard deviation of each, in the same units; ``None`` for an exactly known track.
    """

    time_s: Float[np.ndarray, " time"]
    pose: Float[np.ndarray, "time 5"]
    sigma: Float[np.ndarray, "time 5"] | None = None


def observe_drive(motion: DriveMotion, errors: NavigationErrors, seed: int) -> tuple[OdometerTrack, PoseTrack]:
    """Odometer and GNSS/INS over the drive and one sample past its end, so that every scan is between samples.

    Every effect draws from its own random stream, so switching one on does not change the others.

    Raises:
        ValueError: a rate is not positive, or an outage or a slip does not end after it starts.
    """
    odometer_hz = errors.rate_hz if errors.odometer_rate_hz is None else errors.odometer_rate_hz
    if not (errors.rate_hz > 0 and odometer_hz > 0):
        raise ValueError(f"rates of {errors.rate_hz} and {odometer_hz} Hz must be positive")
    for start_s, stop_s in errors.outages_s + errors.slips_s:
        if not start_s < stop_s:
            raise ValueError(f"an interval from {start_s} s to {stop_s} s does not end after it starts")
    rng = np.random.default_rng([seed, 3])
    time_s, wheel_s = (_sample_times(motion, rate_hz) for rate_hz in (errors.rate_hz, odometer_hz))
    white = rng.normal(size=time_s.size)
    if odometer_hz != errors.rate_hz:  # the draw above remains, for the pose errors that follow in its stream
        white = _stream(seed, 1).normal(size=wheel_s.size)
    sigma = _component_sigma(errors)
    keep = float(np.exp(-1.0 / (errors.rate_hz * errors.correlation_s)))
    wrong = gauss_markov(rng, sigma, keep, time_s.size)
    wrong[:, :2] += np.asarray(errors.position_bias_m)
    pose, reported = poses_at(motion, time_s), np.tile(sigma, (time_s.size, 1))
    _add_jumps(wrong, reported, time_s, errors, seed)
    _coast_outages(wrong, reported, time_s, pose, errors, seed)
    distance_m = _read_odometer(motion, wheel_s, white, errors, seed)
    return OdometerTrack(wheel_s, distance_m), PoseTrack(time_s, pose + wrong, reported)


def gauss_markov(
    rng: np.random.Generator, sigma: Float[np.ndarray, " state"], keep: float, steps: int
) -> Float[np.ndarray, "step state"]:
    """Stationary first-order Gauss-Markov process: x' = keep x + sqrt(1 - keep**2) sigma w."""
    value: Float[np.ndarray, "step state"] = rng.normal(size=(steps, sigma.size)) * sigma
    value[1:] *= np.sqrt(1 - keep**2)
    for step in range(1, steps):
        value[step] += keep * value[step - 1]
    return value


def _stream(seed: int, effect: int) -> np.random.Generator:
    return np.random.default_rng([seed, 3, effect])


def _sample_times(motion: DriveMotion, rate_hz: float) -> Float[np.ndarray, " time"]:
    return np.arange(int(np.ceil(motion.duration_s * rate_hz)) + 2) / rate_hz


def _component_sigma(errors: NavigationErrors) -> Float[np.ndarray, "5"]:
    position = errors.position_sigma_m
    return np.array([position, position, errors.height_sigma_m, errors.heading_sigma_rad, errors.roll_sigma_rad])


def _draw_starts(rng: np.random.Generator, per_hour: float, duration_s: float) -> Float[np.ndarray, " event"]:
    """A Poisson process over the drive."""
    return np.asarray(rng.uniform(0.0, duration_s, rng.poisson(per_hour * duration_s / 3600)))


def _list_intervals(given_s: Intervals, start_s: Float[np.ndarray, " event"], held_s: float) -> Intervals:
    """Given intervals and those that start at random, in order, overlapping ones joined."""
    joined: list[tuple[float, float]] = []
    for start, stop in sorted([*given_s, *((float(s), float(s) + held_s) for s in start_s)]):
        if joined and start <= joined[-1][1]:
            joined[-1] = (joined[-1][0], max(stop, joined[-1][1]))
        else:
            joined.append((start, stop))
    return tuple(joined)


def _add_jumps(
    wrong: Float[np.ndarray, "time 5"],
    reported: Float[np.ndarray, "time 5"],
    time_s: Float[np.ndarray, " time"],
    errors: NavigationErrors,
    seed: int,
) -> None:
    given_s = np.asarray(errors.jump_start_s, np.float64)
    drawn_s = _draw_starts(_stream(seed, 2), errors.jumps_per_hour, time_s[-1])
    size = np.concatenate(
        [_stream(seed, 3).normal(size=(given_s.size, 2)), _stream(seed, 4).normal(size=(drawn_s.size, 2))]
    )
    in_jump = np.zeros(time_s.size, bool)
    for start_s, east_north in zip(np.append(given_s, drawn_s), size, strict=True):
        held = (time_s >= start_s) & (time_s < start_s + errors.jump_held_s)
        wrong[held, :2] += errors.jump_sigma_m * east_north
        in_jump |= held
    reported[in_jump, :2] *= errors.jump_sigma_factor


def _coast_outages(
    wrong: Float[np.ndarray, "time 5"],
    reported: Float[np.ndarray, "time 5"],
    time_s: Float[np.ndarray, " time"],
    pose: Float[np.ndarray, "time 5"],
    errors: NavigationErrors,
    seed: int,
) -> None:
    starts_s = _draw_starts(_stream(seed, 5), errors.outages_per_hour, time_s[-1])
    white = _stream(seed, 6).normal(size=(time_s.size, 4)) / np.sqrt(errors.rate_hz)
    white *= [errors.velocity_walk, errors.velocity_walk, errors.velocity_walk, errors.heading_walk]
    for start_s, stop_s in _list_intervals(errors.outages_s, starts_s, errors.outage_held_s):
        first, last = np.searchsorted(time_s, [start_s, stop_s])
        if first == last:
            continue
        out = slice(first, last)
        away_s, away_m = time_s[out] - time_s[first], pose[out, :2] - pose[first, :2]
        # A step of the heading's error displaces what follows across: by -north in east, by east in north.
        levers = np.stack([away_s, away_s, away_s, -away_m[:, 1], away_m[:, 0]], axis=1)
        source = [0, 1, 2, 3, 3]
        step = white[out][:, source]
        step[0] = 0.0  # at the last fix the error has not grown yet
        grown = levers * np.cumsum(step, axis=0) - np.cumsum(step * levers, axis=0)
        variance = _sum_squares(levers) * np.array([errors.velocity_walk] * 3 + [errors.heading_walk] * 2) ** 2
        variance /= errors.rate_hz
        # Roll is held by gravity; the rest carries on from the error at the last fix.
        wrong[out, :3] = wrong[first, :3] + grown[:, :3]
        wrong[out, :2] += grown[:, 3:]
        wrong[out, 3] = wrong[first, 3] + np.cumsum(step[:, 3])
        reported[out, :3] = np.sqrt(reported[first, :3] ** 2 + variance[:, :3])
        reported[out, :2] = np.sqrt(reported[out, :2] ** 2 + variance[:, 3:])
        reported[out, 3] = np.sqrt(reported[first, 3] ** 2 + errors.heading_walk**2 * away_s)


def _sum_squares(lever: Float[np.ndarray, "time source"]) -> Float[np.ndarray, "time source"]:
    """Sum over the steps j so far of (lever - lever_j)**2; the first, where the lever is 0, is not a step."""
    count = np.arange(len(lever), dtype=np.float64)[:, None]
    total = count * lever**2 - 2 * lever * np.cumsum(lever, axis=0) + np.cumsum(lever**2, axis=0)
    return np.asarray(np.maximum(total, 0.0))  # rounding may leave a zero below zero


def _read_odometer(
    motion: DriveMotion,
    time_s: Float[np.ndarray, " time"],
    white: Float[np.ndarray, " time"],
    errors: NavigationErrors,
    seed: int,
) -> Float[np.ndarray, " time"]:
    step_s = np.diff(time_s)
    drift = np.zeros(step_s.size)
    if errors.odometer_drift > 0:
        keep = float(np.exp(-step_s[0] / errors.odometer_drift_s))
        drift = gauss_markov(_stream(seed, 7), np.array([errors.odometer_drift]), keep, step_s.size)[:, 0]
    starts_s = _draw_starts(_stream(seed, 8), errors.slips_per_hour, time_s[-1])
    slipped_s = np.zeros(time_s.size)
    for start_s, stop_s in _list_intervals(errors.slips_s, starts_s, errors.slip_held_s):
        slipped_s += np.clip(time_s - start_s, 0.0, stop_s - start_s)
    scale = 1 + errors.odometer_scale_error
    extra_s = drift * step_s + errors.slip_fraction * (scale + drift) * np.diff(slipped_s)
    noise_m = errors.odometer_noise_m * white
    noise_m[0] = 0.0  # the odometer is set to zero at the start
    distance_m = motion.plan.speed_mps * time_s * scale
    distance_m += motion.plan.speed_mps * np.append(0.0, np.cumsum(extra_s))
    distance_m += noise_m
    if errors.odometer_step_m > 0:
        distance_m = np.floor(distance_m / errors.odometer_step_m) * errors.odometer_step_m
    return np.asarray(distance_m)


# Fixes without ground or radar: registration errors drawn from a model calibrated on real searches.
#
# The error of a fix hardly changes from scan to scan, because neighbouring scans see the same ground: it is a
# Gauss-Markov process over distance, plus a white part. Fixes fail in stretches, where the ground is poor.


class FixErrors(NamedTuple):
    """Errors of fixes along, across and in heading, and gaps between fixes. Scalars or one value per batch element.

    Attributes:
        slow_sigma: standard deviations of the slow error: along_m, cross_m, yaw_rad.
        slow_m: correlation distance of the slow error.
        white_sigma: standard deviations of the error that is independent between fixes.
        bias: constant error.
        reported_sigma: standard deviations reported by a fix.
        found_m, lost_m: mean lengths of stretches with and without fixes.
        strength: correlation times the root of the overlap in stretches with fixes.
        p_false: probability that ground outside the map would match as well, in stretches with fixes.
    """

    slow_sigma: Float[Array, "... 3"]
    slow_m: Float[Array, "..."]
    white_sigma: Float[Array, "... 3"]
    bias: Float[Array, "... 3"]
    reported_sigma: Float[Array, "... 3"]
    found_m: Float[Array, "..."]
    lost_m: Float[Array, "..."]
    strength: Float[Array, "..."]
    p_false: Float[Array, "..."]


class FixErrorState(NamedTuple):
    """The slow part, and whether the ground gives fixes here."""

    slow: Float[Array, "... 3"]
    found: Bool[Array, "..."]


def init_fix_errors(model: FixErrors, key: PRNGKeyArray) -> FixErrorState:
    """Drawn from the stationary distribution; one batch element."""
    draw, place = jax.random.split(key)
    share = model.found_m / (model.found_m + model.lost_m)
    return FixErrorState(model.slow_sigma * jax.random.normal(draw, (3,)), jax.random.uniform(place) < share)


def step_fix_errors(
    model: FixErrors, state: FixErrorState, key: PRNGKeyArray, way_m: Float[Array, ""]
) -> tuple[FixErrorState, Float[Array, "3"]]:
    """The state after some way, and the error of a fix there: along_m, cross_m, yaw_rad; one batch element."""
    slow_key, white_key, change_key = jax.random.split(key, 3)
    way_m = jnp.abs(way_m)
    keep = jnp.exp(-way_m / model.slow_m)
    fresh = jnp.sqrt(jnp.maximum(1.0 - keep * keep, 0.0)) * model.slow_sigma
    slow = keep * state.slow + fresh * jax.random.normal(slow_key, (3,))
    chance = jax.random.uniform(change_key)
    stays = jnp.exp(-way_m / jnp.where(state.found, model.found_m, model.lost_m))
    found = jnp.where(chance < stays, state.found, ~state.found)
    error = model.bias + slow + model.white_sigma * jax.random.normal(white_key, (3,))
    return FixErrorState(slow, found), error


# Error models of fixes on days of the generated off-road course, measured in drives with full registration.
#
# ``python -m benchmarks closed-loop`` drives the courses and measures the numbers again (``benchmarks.accuracy``).

_DAYS: dict[str, dict[str, tuple[float, ...]]] = {
    "clear": {
        "slow_sigma": (0.0195, 0.0195, 0.0040),
        "slow_m": (4.25,),
        "white_sigma": (0.026, 0.017, 0.0009),
        "bias": (0.0, 0.0, 0.0),
        "reported_sigma": (0.030, 0.033, 0.0058),
        "found_m": (2.33,),
        "lost_m": (0.26,),
        "strength": (0.784,),
        "p_false": (5e-7,),
    },
}


def calibrated_fixes(weather: str) -> FixErrors:
    """The error model of a day.

    Raises:
        KeyError: a day that was not measured.
    """
    day = _DAYS[weather]
    return FixErrors(
        *(jnp.float32(day[n][0]) if len(day[n]) == 1 else jnp.asarray(day[n], jnp.float32) for n in FixErrors._fields)
    )


# Faults of the sensors of a closed loop, with their times.


class SensorFaults(NamedTuple):
    """Faults by time since the start of the drive: intervals [from, to) in seconds, or start times without an end.

    Attributes:
        gnss_lost_s: interval without positions.
        gnss_frozen_s: interval in which the receiver repeats its last position, if it had one.
        gnss_jump_s, gnss_jump_m: start and size of a constant position error, east and north.
        gnss_drift_s, gnss_drift_mps: start and rate of a position drift, as by a spoofer, east and north.
        heading_lost_s: interval without INS heading.
        odometer_lost_s: interval without odometry.
        slip_s, slip: interval of slip, and share by which the wheels turn more than the ground passes.
        lgpr_lost_s: interval without scans.
        lgpr_wrong_s, lgpr_wrong_m: interval and size of wrong, overconfident fixes, east and north.
        lgpr_faded_s, lgpr_faded: interval and remaining share of the strength of matches; fixes fail if it falls too
            near
            the noise floor.
    """

    gnss_lost_s: Float[Array, "... 2"]
    gnss_frozen_s: Float[Array, "... 2"]
    gnss_jump_s: Float[Array, "..."]
    gnss_jump_m: Float[Array, "... 2"]
    gnss_drift_s: Float[Array, "..."]
    gnss_drift_mps: Float[Array, "... 2"]
    heading_lost_s: Float[Array, "... 2"]
    odometer_lost_s: Float[Array, "... 2"]
    slip_s: Float[Array, "... 2"]
    slip: Float[Array, "..."]
    lgpr_lost_s: Float[Array, "... 2"]
    lgpr_wrong_s: Float[Array, "... 2"]
    lgpr_wrong_m: Float[Array, "... 2"]
    lgpr_faded_s: Float[Array, "... 2"]
    lgpr_faded: Float[Array, "..."]


def no_faults() -> SensorFaults:
    """Faults that never occur; use ``_replace`` to set some."""
    never, nothing = jnp.full(2, jnp.inf, jnp.float32), jnp.zeros(2, jnp.float32)
    late, zero, one = jnp.float32(jnp.inf), jnp.float32(0.0), jnp.float32(1.0)
    return SensorFaults(
        gnss_lost_s=never,
        gnss_frozen_s=never,
        gnss_jump_s=late,
        gnss_jump_m=nothing,
        gnss_drift_s=late,
        gnss_drift_mps=nothing,
        heading_lost_s=never,
        odometer_lost_s=never,
        slip_s=never,
        slip=zero,
        lgpr_lost_s=never,
        lgpr_wrong_s=never,
        lgpr_wrong_m=nothing,
        lgpr_faded_s=never,
        lgpr_faded=one,
    )


def during(interval_s: Float[Array, "2"], time_s: Float[Array, ""]) -> Bool[Array, ""]:
    """Whether a time is in an interval."""
    return (time_s >= interval_s[0]) & (time_s < interval_s[1])


# Navigation sensors in a closed loop: GNSS, gyro, INS heading and wheel odometry, tick by tick, and their faults.
#
# The way is not known beforehand, so errors are drawn as it is driven. Every error is a first-order Gauss-Markov
# process, a random walk or white; one batch element, more by ``vmap``.


class LiveSensors(NamedTuple):
    """Sensor properties. Scalars or one value per batch element.

    Attributes:
        gnss_ticks: ticks between positions.
        gnss_x_m, gnss_y_m: antenna in the body, forward and left of the rear axle.
        gnss_sigma_m: white error of a position, per axis.
        gnss_slow_m, gnss_slow_s: standard deviation per axis and time constant of the slow error in the map's frame.
        yaw_rate_noise: white noise of the gyro, rad/s/√Hz.
        rate_bias_radps, rate_bias_walk: standard deviation of the gyro bias at the start, and its random walk,
            rad/s/√s.
        heading_sigma_rad: white error of the INS heading.
        heading_slow_rad, heading_slow_s: standard deviation and time constant of the slow heading error.
        odometer_mps: white error of the wheel speed.
        odometer_scale, odometer_scale_walk: standard deviation of the scale error at the start, and its random walk,
            1/√s.
    """

    gnss_ticks: Int[Array, "..."]
    gnss_x_m: Float[Array, "..."]
    gnss_y_m: Float[Array, "..."]
    gnss_sigma_m: Float[Array, "..."]
    gnss_slow_m: Float[Array, "..."]
    gnss_slow_s: Float[Array, "..."]
    yaw_rate_noise: Float[Array, "..."]
    rate_bias_radps: Float[Array, "..."]
    rate_bias_walk: Float[Array, "..."]
    heading_sigma_rad: Float[Array, "..."]
    heading_slow_rad: Float[Array, "..."]
    heading_slow_s: Float[Array, "..."]
    odometer_mps: Float[Array, "..."]
    odometer_scale: Float[Array, "..."]
    odometer_scale_walk: Float[Array, "..."]


class LiveSensorState(NamedTuple):
    """Present errors, and the last position that the receiver gave: a frozen one repeats it."""

    gnss_slow_m: Float[Array, "... 2"]
    rate_bias_radps: Float[Array, "..."]
    heading_slow_rad: Float[Array, "..."]
    odometer_scale: Float[Array, "..."]
    last_gnss_m: Float[Array, "... 2"]


class Readings(NamedTuple):
    """Sensor readings at the end of a tick.

    Attributes:
        gnss_m: position of the antenna, east and north.
        gnss_valid: whether there is a new position.
        yaw_rate_radps: mean yaw rate over the tick.
        heading_rad: yaw of the body.
        heading_valid: whether the INS gives a heading.
        odometer_mps: mean forward speed over the tick.
        odometer_valid: whether there is odometry.
    """

    gnss_m: Float[Array, "... 2"]
    gnss_valid: Bool[Array, "..."]
    yaw_rate_radps: Float[Array, "..."]
    heading_rad: Float[Array, "..."]
    heading_valid: Bool[Array, "..."]
    odometer_mps: Float[Array, "..."]
    odometer_valid: Bool[Array, "..."]


def live_sensors(
    *, tick_s: float, gnss_x_m: float = 0.0, gnss_y_m: float = 0.0, gnss_slow_m: float = 0.03, gnss_hz: float = 7.0
) -> LiveSensors:
    """RTK GNSS with a MEMS INS and wheel odometry of usual grades: assumed values, not a manufacturer's.

    Args:
        tick_s: tick of the loop.
        gnss_x_m, gnss_y_m: antenna in the body, forward and left.
        gnss_slow_m: standard deviation of the slow position error in the map's frame.
        gnss_hz: rate of positions, rounded to whole ticks.
    """
    one = jnp.float32
    return LiveSensors(
        gnss_ticks=jnp.int32(max(round(1.0 / (gnss_hz * tick_s)), 1)),
        gnss_x_m=one(gnss_x_m),
        gnss_y_m=one(gnss_y_m),
        gnss_sigma_m=one(0.01),
        gnss_slow_m=one(gnss_slow_m),
        gnss_slow_s=one(60.0),
        yaw_rate_noise=one(2e-4),
        rate_bias_radps=one(0.002),
        rate_bias_walk=one(1e-5),
        heading_sigma_rad=one(0.001),
        heading_slow_rad=one(0.002),
        heading_slow_s=one(60.0),
        odometer_mps=one(0.03),
        odometer_scale=one(0.005),
        odometer_scale_walk=one(1e-4),
    )


def init_live_sensors(model: LiveSensors, key: PRNGKeyArray) -> LiveSensorState:
    """Errors at the start of a drive; one batch element."""
    slow, bias, heading, scale = jax.random.split(key, 4)
    return LiveSensorState(
        model.gnss_slow_m * jax.random.normal(slow, (2,)),
        model.rate_bias_radps * jax.random.normal(bias),
        model.heading_slow_rad * jax.random.normal(heading),
        model.odometer_scale * jax.random.normal(scale),
        jnp.zeros(2, jnp.float32),
    )


def read_live_sensors(
    model: LiveSensors,
    faults: SensorFaults,
    state: LiveSensorState,
    key: PRNGKeyArray,
    pose: VehiclePose,
    speed_mps: Float[Array, ""],
    yaw_rate_radps: Float[Array, ""],
    tick: Int[Array, ""],
    tick_s: float,
) -> tuple[LiveSensorState, Readings]:
    """Readings at the end of a tick; one batch element.

    Args:
        model, faults: properties and faults of the sensors.
        state: state of the sensors' errors.
        key: random key of this tick's noise.
        pose: true pose of the rear axle at the tick's end.
        speed_mps, yaw_rate_radps: true means over the tick.
        tick: number of this tick, from 1.
        tick_s: length of a tick.
    """
    noise = jax.random.normal(key, (10,))
    time_s = tick.astype(jnp.float32) * tick_s
    root_s = tick_s**0.5
    slow = _gauss_markov(state.gnss_slow_m, noise[:2], model.gnss_slow_m, tick_s / model.gnss_slow_s)
    heading_slow = _gauss_markov(
        state.heading_slow_rad, noise[2], model.heading_slow_rad, tick_s / model.heading_slow_s
    )
    bias = state.rate_bias_radps + model.rate_bias_walk * root_s * noise[3]
    scale = state.odometer_scale + model.odometer_scale_walk * root_s * noise[4]
    cos, sin = jnp.cos(pose.yaw_rad), jnp.sin(pose.yaw_rad)
    antenna = jnp.stack(
        [
            pose.x_m + cos * model.gnss_x_m - sin * model.gnss_y_m,
            pose.y_m + sin * model.gnss_x_m + cos * model.gnss_y_m,
        ]
    )
    wrong = jnp.where(time_s >= faults.gnss_jump_s, faults.gnss_jump_m, 0.0)
    drifting_s = jnp.maximum(time_s - faults.gnss_drift_s, 0.0)
    wrong += jnp.where(jnp.isfinite(faults.gnss_drift_s), faults.gnss_drift_mps * drifting_s, 0.0)
    reported_m = antenna + slow + model.gnss_sigma_m * noise[5:7] + wrong
    due = tick % model.gnss_ticks == 0
    frozen = during(faults.gnss_frozen_s, time_s)
    reported_m = jnp.where(frozen | ~due, state.last_gnss_m, reported_m)
    first_s = model.gnss_ticks.astype(jnp.float32) * tick_s
    nothing_yet = frozen & (faults.gnss_frozen_s[0] <= first_s)
    readings = Readings(
        gnss_m=reported_m,
        gnss_valid=due & ~nothing_yet & ~during(faults.gnss_lost_s, time_s),
        yaw_rate_radps=yaw_rate_radps + bias + model.yaw_rate_noise / root_s * noise[7],
        heading_rad=pose.yaw_rad + heading_slow + model.heading_sigma_rad * noise[8],
        heading_valid=~during(faults.heading_lost_s, time_s),
        odometer_mps=speed_mps * (1.0 + scale) * jnp.where(during(faults.slip_s, time_s), 1.0 + faults.slip, 1.0)
        + model.odometer_mps * noise[9],
        odometer_valid=~during(faults.odometer_lost_s, time_s),
    )
    return LiveSensorState(slow, bias, heading_slow, scale, reported_m), readings


def _gauss_markov(
    value: Float[Array, "*axis"], noise: Float[Array, "*axis"], sigma: Float[Array, ""], share: Float[Array, ""]
) -> Float[Array, "*axis"]:
    keep = jnp.exp(-share)
    return keep * value + jnp.sqrt(1.0 - keep * keep) * sigma * noise
