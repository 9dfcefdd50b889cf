"""Calibration 6: pre-tension, dead zone, gain and lag of throttle and brake, from steps of their commands.

The log is cut at standstills into runs. A run's way by odometer is what the pedals' model makes of the commands: all
parameters of both pedals are fitted to all runs at once, by damped Gauss-Newton steps with Huber weights on the
derivative of the model itself. Where the log has fixes they say what a metre of the odometer is worth.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from lgprjax.tuning.estimate import Estimate, NotExcitedError
from lgprjax.tuning.pedal_runs import PEDAL_NAMES, PedalRuns, cut_runs, odometer_scale, predict_way
from lgprjax.tuning.pedal_start import pedal_start
from lgprjax.tuning.robust import estimate, independent_share
from lgprjax.vehicle.signals import DriveSignals

WHAT = "throttle and brake"
ROUNDS = 60
HUBER = 2.0
POSITIVE = np.array([name.endswith((".gain_mps2", ".lag_s")) for name in PEDAL_NAMES])
LARGEST_CHANGE = np.array([0.05, 0.05, 0.5, 0.5, 0.05, 0.05, 0.5, 0.5, 0.1, 0.1])
# Without any dead zone a rising command would have two derivatives by it.
LEAST = np.array([0.0, 1e-3, 1e-3, 1e-3, 0.0, 1e-3, 1e-3, 1e-3, -1.0, -1.0])
MOST = np.array([0.9, 0.9, 50.0, 5.0, 0.9, 0.9, 50.0, 5.0, 5.0, 1.0])
LARGEST_SIGMA = np.array([0.05, 0.05, 1.0, 0.3, 0.05, 0.05, 2.0, 0.3, 0.2, 0.1])


class PedalFit(NamedTuple):
    """One pedal, named as ``lgprjax.vehicle.Pedal``: commands are 0 to 1."""

    pre_tension: Estimate
    dead_zone: Estimate
    gain_mps2: Estimate
    lag_s: Estimate


class PedalsFit(NamedTuple):
    """Both pedals.

    Attributes:
        throttle, brake: of each.
        rolling_mps2, drag_per_s: what slows the vehicle without them.
        metres_per_odometer_metre: by the fixes; None where the log has none, and accelerations are in the odometer's
            metres.
        rms_m: of the way in a run about the model's.
        runs: number of runs from standstill to standstill that were used.
    """

    throttle: PedalFit
    brake: PedalFit
    rolling_mps2: Estimate
    drag_per_s: Estimate
    metres_per_odometer_metre: Estimate | None
    rms_m: float
    runs: int


class WayFit(NamedTuple):
    """Parameters fitted to the ways of several lanes, in the order of ``PEDAL_NAMES``.

    Attributes:
        value: of each parameter.
        sigma: standard error.
        degrees: of freedom.
        rms_m: of the residuals.
    """

    value: Float[np.ndarray, "lane parameter"]
    sigma: Float[np.ndarray, "lane parameter"]
    degrees: Float[np.ndarray, " lane"]
    rms_m: Float[np.ndarray, " lane"]


def fit_pedals(signals: DriveSignals) -> PedalsFit:
    """Throttle and brake, from runs that start at standstill with steps of either command.

    Each command must be stepped to two values at least, and part of one be taken back, for the dead zone to show.

    Args:
        signals: of the log: commands and odometer, and fixes with heading where there are any.

    Raises:
        NotExcitedError: a signal is missing, the vehicle did not move or did not stand between, or the steps leave a
            parameter open: the message names it.
    """
    runs = cut_runs(signals, WHAT)
    fit = fit_way(runs, signals.travel_m[None, runs.record])
    value, sigma = fit.value[0], fit.sigma[0]
    way_m = float(np.ptp(signals.travel_m[runs.record]))
    if fit.rms_m[0] > 0.05 * way_m:
        raise NotExcitedError(WHAT, "a way that follows from the commands", f"{fit.rms_m[0]:.2f} m beside it")
    # A parameter at its limit, or with no finite error, is as open as one with a large error.
    known = (sigma < LARGEST_SIGMA) & (value < MOST)
    if not known.all():
        open_names = ", ".join(name for name, told in zip(PEDAL_NAMES, known, strict=True) if not told)
        raise NotExcitedError(WHAT, "steps that tell every parameter", f"these left open: {open_names}")
    scale = odometer_scale(signals)
    found = [
        _in_metres(name, estimate(float(v), float(s), fit.degrees[0]), scale, fit.degrees[0])
        for name, v, s in zip(PEDAL_NAMES, value, sigma, strict=True)
    ]
    return PedalsFit(
        PedalFit(*found[:4]), PedalFit(*found[4:8]), found[8], found[9], scale, float(fit.rms_m[0]), runs.runs
    )


def fit_way(runs: PedalRuns, travel_m: Float[np.ndarray, "lane record"]) -> WayFit:
    """Fits the parameters to the ways of lanes that have been given the same commands.

    Args:
        runs: commands and runs, from ``cut_runs``.
        travel_m: by odometer, at the records of ``runs``.
    """
    lanes = travel_m.shape[0]
    value = np.tile(pedal_start(runs, travel_m[0], WHAT), (lanes, 1))
    damping = np.full(lanes, 1e-3)
    way, slope = predict_way(runs, value)
    raw = travel_m - way
    residual = _levelled(runs, raw, np.ones_like(raw))
    for _ in range(ROUNDS):
        weight = _huber(residual)
        residual, level_slope = _levelled(runs, raw, weight), _levelled(runs, slope, weight[:, None])
        unit_slope = level_slope * _unit(value)[..., None]
        # A damped step is small wherever it was damped; the undamped one is the way to the end that can be seen.
        settled = _small(_step(unit_slope, residual, weight, np.full(lanes, 1e-10)), unit_slope, residual)
        if (settled | (damping > 1e9)).all():
            break
        # A step that a limit would cut is taken along the limit: those that press against it stay out.
        step = _step(unit_slope, residual, weight, damping)
        pressed = ((value <= LEAST) & (step < 0.0)) | ((value >= MOST) & (step > 0.0))
        step = _step(np.where(pressed[..., None], 0.0, unit_slope), residual, weight, damping)
        trial = _moved(value, step)
        way, trial_slope = predict_way(runs, trial)
        trial_raw = travel_m - way
        trial_residual = _levelled(runs, trial_raw, weight)
        better = (weight * trial_residual**2).sum(axis=1) < (weight * residual**2).sum(axis=1)
        value, slope, raw, residual = _take(
            better, (trial, trial_slope, trial_raw, trial_residual), (value, slope, raw, residual)
        )
        damping = np.where(better, 0.1 * damping, 5.0 * damping)
    weight = _huber(residual)
    return _way_fit(runs, value, _levelled(runs, slope, weight[:, None]), _levelled(runs, raw, weight))


def _in_metres(name: str, odometer: Estimate, scale: Estimate | None, degrees: float) -> Estimate:
    """Accelerations in metres of the fixes; what else there is does not depend on the odometer's."""
    if scale is None or not name.endswith("_mps2"):
        return odometer
    sigma = float(np.hypot(odometer.sigma * scale.value, odometer.value * scale.sigma))
    return estimate(odometer.value * scale.value, sigma, degrees)


def _levelled(
    runs: PedalRuns, signal: Float[np.ndarray, "... record"], weight: Float[np.ndarray, "... record"]
) -> Float[np.ndarray, "... record"]:
    """Less its mean over each run: where a run begins is not known better than its records."""
    starts = np.flatnonzero(np.diff(runs.run, prepend=-1))
    mean = np.add.reduceat(weight * signal, starts, axis=-1) / np.add.reduceat(weight, starts, axis=-1)
    return np.asarray(signal - np.repeat(mean, np.diff(np.append(starts, runs.run.size)), axis=-1))


def _scale(residual: Float[np.ndarray, "lane record"]) -> Float[np.ndarray, "lane 1"]:
    return np.asarray(np.maximum(np.median(np.abs(residual), axis=1, keepdims=True) / 0.6745, 1e-9))


def _huber(residual: Float[np.ndarray, "lane record"]) -> Float[np.ndarray, "lane record"]:
    return np.asarray(np.minimum(1.0, HUBER * _scale(residual) / np.maximum(np.abs(residual), 1e-300)))


def _unit(value: Float[np.ndarray, "lane parameter"]) -> Float[np.ndarray, "lane parameter"]:
    """What a step of 1 changes: gains and lags step by their logarithm, and so stay positive."""
    return np.where(POSITIVE, value, 1.0)


def _moved(
    value: Float[np.ndarray, "lane parameter"], step: Float[np.ndarray, "lane parameter"]
) -> Float[np.ndarray, "lane parameter"]:
    """After a step, of bounded length and within the limits."""
    step = step / np.maximum(1.0, np.max(np.abs(step) / LARGEST_CHANGE, axis=1, keepdims=True))
    trial = np.clip(np.where(POSITIVE, value * np.exp(step), value + step), LEAST, MOST)
    return np.asarray(trial)


def _step(
    slope: Float[np.ndarray, "lane parameter record"],
    residual: Float[np.ndarray, "lane record"],
    weight: Float[np.ndarray, "lane record"],
    damping: Float[np.ndarray, " lane"],
) -> Float[np.ndarray, "lane parameter"]:
    heavy = slope * weight[:, None]
    square = heavy @ slope.swapaxes(1, 2)
    length = np.sqrt(np.maximum(np.einsum("lpp->lp", square), 1e-12))
    unit = square / (length[:, :, None] * length[:, None, :]) + damping[:, None, None] * np.eye(length.shape[1])
    side = np.einsum("lpr,lr->lp", heavy, residual) / length
    return np.asarray(np.linalg.solve(unit, side[..., None])[..., 0] / length)


def _small(
    step: Float[np.ndarray, "lane parameter"],
    slope: Float[np.ndarray, "lane parameter record"],
    residual: Float[np.ndarray, "lane record"],
) -> Bool[np.ndarray, " lane"]:
    """The step moves the way by less than a fifth of the error that one parameter makes."""
    moved = np.einsum("lp,lpr->lr", step, slope)
    allowed = 0.2 * _scale(residual)[:, 0] / np.sqrt(residual.shape[1])
    return np.asarray(np.sqrt(np.mean(moved**2, axis=1)) < allowed)


def _take(
    better: Bool[np.ndarray, " lane"], new: tuple[np.ndarray, ...], old: tuple[np.ndarray, ...]
) -> tuple[np.ndarray, ...]:
    def choose(a: np.ndarray, b: np.ndarray) -> np.ndarray:
        return np.where(better.reshape(-1, *[1] * (a.ndim - 1)), a, b)

    return tuple(choose(a, b) for a, b in zip(new, old, strict=True))


def _way_fit(
    runs: PedalRuns,
    value: Float[np.ndarray, "lane parameter"],
    slope: Float[np.ndarray, "lane parameter record"],
    residual: Float[np.ndarray, "lane record"],
) -> WayFit:
    """Errors of an M-estimate whose records count as many as are independent."""
    scale = _scale(residual)
    pull = np.clip(residual / scale, -HUBER, HUBER)
    steep = np.mean(np.abs(residual) < HUBER * scale, axis=1)
    share = np.array([independent_share(lane) for lane in pull])
    degrees = share * residual.shape[1] - value.shape[1] - runs.runs
    variance = scale[:, 0] ** 2 * np.sum(pull**2, axis=1) / (np.maximum(degrees, 1e-9) * steep**2)
    square = slope @ slope.swapaxes(1, 2)
    length = np.sqrt(np.maximum(np.einsum("lpp->lp", square), 1e-12))
    # The ridge leaves what no record tells with an error as large as that.
    inverse = np.linalg.inv(square / (length[:, :, None] * length[:, None, :]) + 1e-10 * np.eye(length.shape[1]))
    sigma = np.sqrt(variance[:, None] * np.einsum("lpp->lp", inverse)) / length
    return WayFit(value, sigma, np.maximum(degrees, 3.0), np.sqrt(np.mean(residual**2, axis=1)))
