"""Noises of the navigation filter, errors of fixes and thresholds, fitted to logged drives.

The ascent is that of Berndt, Hall, Hall and Hausman, damped. Intervals rest on slopes summed over stretches of time,
so that what is left of serial correlation, because no model is quite right, makes them wider (White 1982).
"""

from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int
from scipy.ndimage import uniform_filter1d

from lgprjax.navigation.counter_steer_filter import (
    FilterInfo,
    filter_drive,
    gnss_innovation,
    heading_innovation,
    init_filter,
    lgpr_innovation,
    odometer_innovation,
    predict,
)
from lgprjax.navigation.counter_steer_model import FilterModel, NavEstimate
from lgprjax.navigation.kalman import correct, weigh
from lgprjax.navigation.observations import GNSS, HEADING, LGPR, ODOMETER, SOURCES, GateRules, MotionInput, Observations
from lgprjax.tuning.arcs import serial_memory
from lgprjax.tuning.robust import Estimate, NotExcitedError, student_95
from lgprjax.vehicle import VehiclePose

# How well a filter's noises explain a logged drive: the likelihood of its innovations, tick by tick, and its slopes.
#
# If the noises are right, innovations are independent in time: so are the likelihood's slopes, and the sum of their
# squares is the information in the drives about the noises (Berndt, Hall, Hall and Hausman 1974).

# Slopes are differences of lanes: forward differentiation takes twice as long to compile and five times as long to
# run. So wide that float32 leaves 0.004 of a tick's slope, and so narrow that the most likely logarithm moves by less
# than a thousandth.
_ASIDE = 0.05


class NavigationDrives(NamedTuple):
    """Logged drives on ticks, leading axis drive; a shorter one ends in ticks of no length without observations.

    Attributes:
        start: pose of the rear axle before the first tick.
        speed_mps: then.
        motions, observations: axes drive, tick.
    """

    start: VehiclePose
    speed_mps: Float[Array, " drive"]
    motions: MotionInput
    observations: Observations


class Slopes(NamedTuple):
    """Log-likelihood of each tick's innovations, and its slopes by the logarithms of the noises."""

    value: Float[np.ndarray, "drive tick"]
    slope: Float[np.ndarray, "drive tick noise"]


def innovation_slopes(
    model: FilterModel, names: tuple[str, ...], logarithms: Float[np.ndarray, " noise"], drives: NavigationDrives
) -> Slopes:
    """Log-likelihood and slopes at noises.

    Args:
        model: everything but the noises named.
        names: fields of the model.
        logarithms: natural, of their values.
        drives: outliers taken out: every valid observation is used.
    """
    value, slope = _slopes(model, names, jnp.asarray(logarithms, jnp.float32), drives)
    return Slopes(np.asarray(value, np.float64), np.asarray(slope, np.float64))


def with_noises(model: FilterModel, names: tuple[str, ...], values: Float[Array | np.ndarray, " noise"]) -> FilterModel:
    """The model with other noises."""
    return model._replace(**{name: jnp.asarray(values[i], jnp.float32) for i, name in enumerate(names)})


@partial(jax.jit, static_argnames="names")
def _slopes(
    model: FilterModel, names: tuple[str, ...], logarithms: Float[Array, " noise"], drives: NavigationDrives
) -> tuple[Float[Array, "drive tick"], Float[Array, "drive tick noise"]]:
    def values(logs: Float[Array, " noise"]) -> Float[Array, "drive tick"]:
        noisy = with_noises(model, names, jnp.exp(logs))
        found: Float[Array, "drive tick"] = jax.vmap(lambda drive: _log_likelihood(noisy, drive))(drives)
        return found

    aside = _ASIDE * jnp.eye(len(names), dtype=jnp.float32)
    points = logarithms[None, :] + jnp.concatenate([jnp.zeros((1, len(names)), jnp.float32), aside, -aside])
    at, above, below = jnp.split(jax.vmap(values)(points), [1, 1 + len(names)])
    return at[0], jnp.moveaxis((above - below) / (2.0 * _ASIDE), 0, -1)


def _log_likelihood(model: FilterModel, drive: NavigationDrives) -> Float[Array, " tick"]:
    def step(estimate: NavEstimate, tick: tuple[MotionInput, Observations]) -> tuple[NavEstimate, Float[Array, ""]]:
        motion, seen = tick
        estimate = predict(model, estimate, motion)
        total = jnp.float32(0.0)
        for source in range(4):
            # Each source is linearised where those before it have led.
            innovation = (
                lambda e: gnss_innovation(model, e, motion, seen.gnss),
                lambda e: heading_innovation(e, motion, seen.heading),
                lambda e: odometer_innovation(e, seen.odometer),
                lambda e: lgpr_innovation(model, e, motion, seen.lgpr),
            )[source](estimate)
            weighed = weigh(estimate, innovation)
            size = len(innovation.rows)
            misfit = weighed.nis + _log_determinant(weighed.covariance) + size * jnp.log(2.0 * jnp.pi)
            total = total - jnp.where(innovation.offered, 0.5 * misfit, 0.0)
            estimate = correct(estimate, innovation, weighed, innovation.offered)
        return estimate, total

    start = init_filter(model, drive.start, drive.speed_mps).estimate
    values: Float[Array, " tick"] = jax.lax.scan(step, start, (drive.motions, drive.observations))[1]
    return values


def _log_determinant(covariance: Float[Array, "part part"]) -> Float[Array, ""]:
    """Of one to three components, scaled before the products: metres and radians differ."""
    count = covariance.shape[0]
    variance = jnp.diagonal(covariance)
    sigma = jnp.sqrt(variance)
    scaled = covariance / (sigma[:, None] * sigma[None, :])
    left = jnp.float32(1.0)
    if count == 2:
        left = 1.0 - scaled[0, 1] ** 2
    if count == 3:
        a, b, c = scaled[0, 1], scaled[0, 2], scaled[1, 2]
        left = 1.0 + 2.0 * a * b * c - a * a - b * b - c * c
    return jnp.log(variance).sum() + jnp.log(left)


NOISES = (
    "yaw_rate_noise",
    "acceleration_noise",
    "side_noise",
    "rate_bias_walk",
    "odometer_scale_walk",
    "gnss_error_sigma_m",
    "gnss_error_s",
    "lgpr_error_sigma_m",
    "lgpr_error_m",
)
"""Fields of the model that drives can tell."""
ROUNDS = 40
LARGEST_SIGMA = 0.75
"""Standard error of a logarithm above which a noise is called open: known to no better than a factor of four."""
LARGEST_REJECTED = 0.02
_LARGEST_STEP = 0.7
_WIDEST = 5.0  # by which a logarithm may leave the start: a factor of 150
_SETTLED = 0.05  # of log-likelihood that the next step would gain
_BLIND_SIGMA = 1.0
_LEAST_DEGREES = 10


class FusionFit(NamedTuple):
    """Noises found.

    Attributes:
        model: with them; those that the drives leave open are as they were.
        found: by name, with 95 % intervals.
        left_open: names of those that the drives do not tell.
        gained: log-likelihood, over that of the start.
        rejected: observations that the gates of the start model kept out, by source.
    """

    model: FilterModel
    found: dict[str, Estimate]
    left_open: tuple[str, ...]
    gained: float
    rejected: dict[str, int]


class _Ascent(NamedTuple):
    """Result of an ascent: logarithms, slopes there, and the gain."""

    logarithms: Float[np.ndarray, " noise"]
    slope: Float[np.ndarray, "drive tick noise"]
    gained: float


def fit_fusion(
    model: FilterModel,
    rules: GateRules,
    drives: NavigationDrives,
    *,
    names: tuple[str, ...] = NOISES,
    stretch_s: float = 5.0,
) -> FusionFit:
    """The noises of the model, from drives.

    Args:
        model: to begin with; its noises rather too large than too small, as its gates choose what is an outlier.
        rules: of the gates that do.
        drives: of one vehicle.
        names: of the noises to be found.
        stretch_s: slopes are summed over so long before they count as independent.

    Raises:
        NotExcitedError: the start model rejects too much, the ascent does not settle, or the drives are too short.
    """
    stretch = _stretch_numbers(np.asarray(drives.motions.step_s, np.float64), stretch_s)
    stretches = sum(int(lane.max(initial=-1)) + 1 for lane in stretch)
    degrees = stretches - len(names)
    if degrees < _LEAST_DEGREES:
        raise NotExcitedError("drives", f"{len(names) + _LEAST_DEGREES} stretches of {stretch_s:g} s", str(stretches))
    drives, rejected = without_outliers(model, rules, drives)
    ascent = _climb(model, names, drives)
    scores = _summed(ascent.slope, stretch)
    observable = _observable(ascent.slope)
    if not observable.any():
        raise NotExcitedError("drives", "a drive that determines the noise parameters", "no such drive")
    square = _information(ascent.slope)[np.ix_(observable, observable)]
    inverse = np.linalg.inv(square)
    spread = scores[:, observable].T @ scores[:, observable] * stretches / degrees
    sigma = np.sqrt(np.diag(inverse @ spread @ inverse))
    half = student_95(float(degrees)) * sigma
    found = {}
    for name, log, error, wide in zip(
        _named(names, observable), ascent.logarithms[observable], sigma, half, strict=True
    ):
        value = float(np.exp(log))
        found[name] = Estimate(value, value * float(error), value * float(np.exp(-wide)), value * float(np.exp(wide)))
    fitted = with_noises(model, tuple(found), np.array([one.value for one in found.values()]))
    return FusionFit(fitted, found, _named(names, ~observable), ascent.gained, rejected)


def filter_drives(model: FilterModel, rules: GateRules, drives: NavigationDrives) -> tuple[NavEstimate, FilterInfo]:
    """The filter over all drives; axes drive, tick."""
    # One by one, so that any number of drives of a length is compiled once.
    lanes = [jax.tree.map(lambda leaf, i=i: np.asarray(leaf)[i], drives) for i in range(drives.speed_mps.shape[0])]
    driven = [_filtered(model, rules, lane) for lane in lanes]
    many: tuple[NavEstimate, FilterInfo] = jax.tree.map(lambda *leaves: jnp.asarray(np.stack(leaves)), *driven)
    return many


def mean_nis(info: FilterInfo) -> dict[str, float]:
    """Mean normalised innovation squared of accepted observations, by source, per component: 1 if the noises are
    right.
    """
    sizes = dict(zip(SOURCES, (2, 1, 1, 3), strict=True))
    accepted, nis = np.asarray(info.accepted), np.asarray(info.nis, np.float64)
    return {
        source: float(nis[..., i][accepted[..., i]].mean()) / sizes[source]
        for i, source in enumerate(SOURCES)
        if accepted[..., i].any()
    }


def without_outliers(
    model: FilterModel, rules: GateRules, drives: NavigationDrives
) -> tuple[NavigationDrives, dict[str, int]]:
    """The drives without the observations that a model's gates reject, and their number by source.

    Raises:
        NotExcitedError: more than 2 % of a source: not outliers, but a model that is too narrow.
    """
    info = filter_drives(model, rules, drives)[1]
    offered, accepted = np.asarray(info.offered), np.asarray(info.accepted)
    rejected = {}
    for i, source in enumerate(SOURCES):
        count, of = int((offered & ~accepted)[..., i].sum()), int(offered[..., i].sum())
        rejected[source] = count
        if count > LARGEST_REJECTED * of:
            raise NotExcitedError(f"{source} at the start model", "at most 2 % rejected", f"{count} of {of}")
    gnss, heading, odometer, lgpr = drives.observations
    used = [jnp.asarray(accepted[..., i]) for i in range(len(SOURCES))]
    kept = Observations(
        gnss._replace(valid=used[GNSS]),
        heading._replace(valid=used[HEADING]),
        odometer._replace(valid=used[ODOMETER]),
        lgpr._replace(valid=used[LGPR]),
    )
    return drives._replace(observations=kept), rejected


@jax.jit
def _filtered(model: FilterModel, rules: GateRules, drive: NavigationDrives) -> tuple[NavEstimate, FilterInfo]:
    start = init_filter(model, drive.start, drive.speed_mps)
    return filter_drive(model, rules, start, drive.motions, drive.observations)


def _climb(model: FilterModel, names: tuple[str, ...], drives: NavigationDrives) -> _Ascent:
    begin = np.log([float(getattr(model, name)) for name in names])
    at, damping = begin, 0.1
    value, slope = innovation_slopes(model, names, at, drives)
    first = best = float(value.sum())
    for _ in range(ROUNDS):
        square, climb = _information(slope), slope.sum(axis=(0, 1))
        # A noise with almost no effect stays where it is: its slope is rounding.
        seen = np.diag(square) > 1.0 / _BLIND_SIGMA**2
        length = np.sqrt(np.where(seen, np.diag(square), 1.0))
        scaled = np.where(np.outer(seen, seen), square, 0.0) / np.outer(length, length)
        damped = scaled + (damping + 1e-9) * np.eye(len(at)) + np.diag(np.where(seen, 0.0, 1.0))
        step = np.linalg.solve(damped, np.where(seen, climb, 0.0) / length) / length
        step *= min(1.0, _LARGEST_STEP / max(float(np.max(np.abs(step))), 1e-12))
        trial = np.clip(at + step, begin - _WIDEST, begin + _WIDEST)
        step = trial - at
        if climb @ step < _SETTLED:
            return _Ascent(at, slope, best - first)
        value, trial_slope = innovation_slopes(model, names, trial, drives)
        gained = float(value.sum()) - best
        # Where the model is not quite right the information is not the curvature: a step that gains much less than it
        # promised went too far, even if it gained.
        promised = climb @ step - 0.5 * step @ (scaled * np.outer(length, length)) @ step
        damping = max(0.2 * damping, 1e-6) if gained > 0.5 * promised else 4.0 * damping + 0.1
        if np.isfinite(gained) and gained > 0.0:
            at, slope, best = trial, trial_slope, best + gained
    raise NotExcitedError("ascent", f"convergence within {ROUNDS} rounds", "no convergence")


def _information(slope: Float[np.ndarray, "drive tick noise"]) -> Float[np.ndarray, "noise noise"]:
    flat = slope.reshape(-1, slope.shape[-1])
    return np.asarray(flat.T @ flat)


def _observable(slope: Float[np.ndarray, "drive tick noise"]) -> Bool[np.ndarray, " noise"]:
    """Noises that the drives tell, the least known taken out one by one."""
    square = _information(slope)
    observable = np.ones(len(square), bool)
    while observable.any():
        part = square[np.ix_(observable, observable)]
        length = np.maximum(np.sqrt(np.diag(part)), 1e-9)
        sigma = np.sqrt(np.diag(np.linalg.inv(part / np.outer(length, length) + 1e-9 * np.eye(len(part))))) / length
        if sigma.max() <= LARGEST_SIGMA:
            break
        observable[np.flatnonzero(observable)[int(np.argmax(sigma))]] = False
    return observable


def _stretch_numbers(step_s: Float[np.ndarray, "drive tick"], stretch_s: float) -> list[Int[np.ndarray, " _"]]:
    """Number of the stretch of each tick, a drive each; ticks of no length are left out."""
    return [(np.cumsum(lane[lane > 0.0]) / stretch_s - 1e-6).astype(int) for lane in step_s]


def _summed(
    slope: Float[np.ndarray, "drive tick noise"], stretch: list[Int[np.ndarray, " _"]]
) -> Float[np.ndarray, "stretch noise"]:
    """Slopes summed over stretches of every drive."""
    sums = [
        np.add.reduceat(lane[: number.size], np.flatnonzero(np.diff(number, prepend=-1)), axis=0)
        for lane, number in zip(slope, stretch, strict=True)
    ]
    return np.concatenate(sums)


def _named(names: tuple[str, ...], mask: Bool[np.ndarray, " noise"]) -> tuple[str, ...]:
    return tuple(name for name, observable in zip(names, mask, strict=True) if observable)


# The control threshold from a logged drive: from commanded and executed turns.
#
# For every threshold the vehicle's yaw rate is that of the commands it would have obeyed, some time late and through a
# lag, times a gain, plus a slow bias: the sides slip by shares that change over metres, and the controller drives
# straight by a small command that turns nothing, as if it were ignored. Only what is quicker is compared. The
# threshold, delay and lag that leave the least of it unexplained are the vehicle's; the interval holds every threshold
# that explains it nearly as well. Residuals of a log remember each other, and so many of them count as one.

_CANDIDATES = 80
_DELAYS_S = np.arange(0.0, 1.01, 0.1)
_LAGS_S = np.array([0.0, 0.1, 0.2, 0.3, 0.4, 0.6, 0.8])
_LEAST_RECORDS = 200
_SLOW_S = 6.0
"""Yaw rates and commands are compared about their means over this time."""
_CHI_95 = 3.84
_CLEARLY = 1.05
"""What is left without a threshold over what is left with it: in a long log noise alone is significant, but small."""
_FEW = 20
"""Least number of independent records."""


class ThresholdFit(NamedTuple):
    """The fitted threshold.

    Attributes:
        found: the vehicle ignores small commands: no threshold explains the log clearly worse.
        threshold_mps: of the wheels' difference; the interval reaches over the commands that were not given.
        delay_s, lag_s: from a command to the turn.
        unexplained: share of the variance of the yaw rate's quick part that is left; without: the same for no
            threshold.
    """

    found: bool
    threshold_mps: Estimate
    delay_s: float
    lag_s: float
    unexplained: float
    without: float


def fit_threshold(
    time_s: Float[np.ndarray, " record"],
    yaw_rad: Float[np.ndarray, " record"],
    turn_mps: Float[np.ndarray, " record"],
) -> ThresholdFit:
    """Fit the control threshold of a drive.

    Args:
        time_s: increasing, evenly but for a few records.
        yaw_rad: of the body; full turns are taken out.
        turn_mps: commanded difference of the wheels, right less left.

    Raises:
        NotExcitedError: fewer than 200 records, something that is no number, or commands that never change.
    """
    if len(time_s) < _LEAST_RECORDS:
        raise NotExcitedError("control threshold", f"{_LEAST_RECORDS} records or more", f"{len(time_s)}")
    if not all(np.isfinite(column).all() for column in (time_s, yaw_rad, turn_mps)):
        raise NotExcitedError("control threshold", "finite numbers", "values that are not finite")
    sizes = np.unique(np.abs(turn_mps))
    if len(sizes) < _FEW:
        raise NotExcitedError("control threshold", "commands of many different sizes", f"{len(sizes)}")
    step_s = float(np.median(np.diff(time_s)))
    rate = np.diff(np.unwrap(yaw_rad)) / np.diff(time_s)
    # Half-way between the commands given; a finer resolution is not observable.
    places = np.unique(np.linspace(0, len(sizes) - 1, _CANDIDATES).round().astype(int))
    candidates = np.append(0.0, 0.5 * (sizes[places][1:] + sizes[places][:-1]))
    slow = max(round(_SLOW_S / step_s), 3)
    rate = _quick(rate, slow)
    # A delay and a lag may change places: the lag's recursion runs once for all delays.
    obeyed = [_quick(_obeyed(turn_mps[:-1], candidates, step_s, lag), slow) for lag in _LAGS_S]
    late = [round(delay / step_s) for delay in _DELAYS_S]
    left = np.array([[_unexplained(rate, _later(way, shift)) for way in obeyed] for shift in late])
    delay, lag, best = np.unravel_index(np.argmin(left), left.shape)
    profile = left.min(axis=(0, 1))
    residual = _residual(rate, _later(obeyed[lag], late[delay])[:, best])
    memory = serial_memory(residual[None], np.ones((1, len(residual)), bool), 2)
    independent = len(rate) / memory
    near = profile <= profile[best] * (1.0 + _CHI_95 / max(independent, 1.0))
    # A threshold between two candidates is like the nearer one: the interval ends at their neighbours.
    first, last = np.flatnonzero(near)[[0, -1]]
    low, high = candidates[max(first - 1, 0)], candidates[min(last + 1, len(candidates) - 1)]
    value = float(candidates[best])
    found = bool(not near[0] and value > 0.0 and independent > _FEW and profile[0] >= _CLEARLY * profile[best])
    return ThresholdFit(
        found,
        Estimate(value, float(high - low) / 3.92, float(low), float(high)),
        float(_DELAYS_S[delay]),
        float(_LAGS_S[lag]),
        float(profile[best]),
        float(profile[0]),
    )


def _obeyed(
    turn_mps: Float[np.ndarray, " record"], threshold_mps: Float[np.ndarray, " candidate"], step_s: float, lag_s: float
) -> Float[np.ndarray, "record candidate"]:
    """The commands passed by each threshold, filtered by a lag."""
    through = np.where(np.abs(turn_mps)[:, None] >= threshold_mps, turn_mps[:, None], 0.0)
    if lag_s == 0.0:
        return through
    keep = float(np.exp(-step_s / lag_s))
    value = np.zeros(len(threshold_mps))
    lagged = np.empty_like(through)
    for number, now in enumerate(through):
        value = now + keep * (value - now)
        lagged[number] = value
    return lagged


def _quick(values: Float[np.ndarray, "record ..."], records: int) -> Float[np.ndarray, "record ..."]:
    """About their running mean."""
    return np.asarray(values - uniform_filter1d(values, records, axis=0, mode="nearest"))


def _later(obeyed: Float[np.ndarray, "record candidate"], records: int) -> Float[np.ndarray, "record candidate"]:
    """Delayed by a number of records, zero before."""
    return np.concatenate([np.zeros((records, obeyed.shape[1])), obeyed[: len(obeyed) - records]])


def _unexplained(
    rate: Float[np.ndarray, " record"], obeyed: Float[np.ndarray, "record candidate"]
) -> Float[np.ndarray, " candidate"]:
    """Share of the yaw rate's variance that no gain explains."""
    x, y = obeyed - obeyed.mean(axis=0), rate - rate.mean()
    explained = (y @ x) ** 2 / np.maximum(np.sum(x * x, axis=0) * (y @ y), 1e-30)
    return np.asarray(1.0 - explained)


def _residual(rate: Float[np.ndarray, " record"], obeyed: Float[np.ndarray, " record"]) -> Float[np.ndarray, " record"]:
    x, y = obeyed - obeyed.mean(), rate - rate.mean()
    return np.asarray(y - (x @ y) / max(x @ x, 1e-30) * x)
