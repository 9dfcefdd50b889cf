"""Noises of the navigation filter from logged drives: those under which the innovations are most likely.

The ascent is that of Berndt, Hall, Hall and Hausman, damped. Intervals rest on slopes summed over stretches of time,
so that what is left of serial correlation, because no model is quite right, makes them wider (White 1982).
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Int

from lgprjax.navigation.filter import FilterInfo, init_filter
from lgprjax.navigation.filter_model import FilterModel, NavEstimate
from lgprjax.navigation.gates import GateRules
from lgprjax.navigation.observations import GNSS, HEADING, LGPR, ODOMETER, SOURCES, Observations
from lgprjax.navigation.smoother import filter_drive
from lgprjax.tuning.estimate import Estimate, NotExcitedError
from lgprjax.tuning.innovations_likelihood import NavigationDrives, innovation_slopes, with_noises
from lgprjax.tuning.robust import student_95

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
    """Where an ascent ended: logarithms, slopes there, and what was gained."""

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
    told = _told(ascent.slope)
    if not told.any():
        raise NotExcitedError("drives", "a way that tells the noises", "none that does")
    square = _information(ascent.slope)[np.ix_(told, told)]
    inverse = np.linalg.inv(square)
    spread = scores[:, told].T @ scores[:, told] * stretches / degrees
    sigma = np.sqrt(np.diag(inverse @ spread @ inverse))
    half = student_95(float(degrees)) * sigma
    found = {}
    for name, log, error, wide in zip(_named(names, told), ascent.logarithms[told], sigma, half, strict=True):
        value = float(np.exp(log))
        found[name] = Estimate(value, value * float(error), value * float(np.exp(-wide)), value * float(np.exp(wide)))
    fitted = with_noises(model, tuple(found), np.array([one.value for one in found.values()]))
    return FusionFit(fitted, found, _named(names, ~told), ascent.gained, rejected)


def filter_drives(model: FilterModel, rules: GateRules, drives: NavigationDrives) -> tuple[NavEstimate, FilterInfo]:
    """The filter over all drives; axes drive, tick."""
    # One by one, so that any number of drives of a length is compiled once.
    lanes = [jax.tree.map(lambda leaf, i=i: np.asarray(leaf)[i], drives) for i in range(drives.speed_mps.shape[0])]
    driven = [_filtered(model, rules, lane) for lane in lanes]
    many: tuple[NavEstimate, FilterInfo] = jax.tree.map(lambda *leaves: jnp.asarray(np.stack(leaves)), *driven)
    return many


def mean_nis(info: FilterInfo) -> dict[str, float]:
    """Mean normalised innovation squared of what was accepted, by source, a component: 1 where the noises are right."""
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
    """The drives without the observations that a model's gates reject, and how many those are by source.

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
            raise NotExcitedError(f"{source} at the start model", "2 % rejected at most", f"{count} of {of}")
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
        # A noise of which there is next to no trace stays where it is: its slope is rounding.
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
    raise NotExcitedError("ascent", f"to settle within {ROUNDS} rounds", "it does not")


def _information(slope: Float[np.ndarray, "drive tick noise"]) -> Float[np.ndarray, "noise noise"]:
    flat = slope.reshape(-1, slope.shape[-1])
    return np.asarray(flat.T @ flat)


def _told(slope: Float[np.ndarray, "drive tick noise"]) -> Bool[np.ndarray, " noise"]:
    """Noises that the drives tell, the least known taken out one by one."""
    square = _information(slope)
    told = np.ones(len(square), bool)
    while told.any():
        part = square[np.ix_(told, told)]
        length = np.maximum(np.sqrt(np.diag(part)), 1e-9)
        sigma = np.sqrt(np.diag(np.linalg.inv(part / np.outer(length, length) + 1e-9 * np.eye(len(part))))) / length
        if sigma.max() <= LARGEST_SIGMA:
            break
        told[np.flatnonzero(told)[int(np.argmax(sigma))]] = False
    return told


def _stretch_numbers(step_s: Float[np.ndarray, "drive tick"], stretch_s: float) -> list[Int[np.ndarray, " driven"]]:
    """Of each drive the number of the stretch that each of its ticks lies in; ticks of no length are left out."""
    return [(np.cumsum(lane[lane > 0.0]) / stretch_s - 1e-6).astype(int) for lane in step_s]


def _summed(
    slope: Float[np.ndarray, "drive tick noise"], stretch: list[Int[np.ndarray, " driven"]]
) -> Float[np.ndarray, "stretch noise"]:
    """Slopes summed over stretches of every drive."""
    sums = [
        np.add.reduceat(lane[: number.size], np.flatnonzero(np.diff(number, prepend=-1)), axis=0)
        for lane, number in zip(slope, stretch, strict=True)
    ]
    return np.concatenate(sums)


def _named(names: tuple[str, ...], mask: Bool[np.ndarray, " noise"]) -> tuple[str, ...]:
    return tuple(name for name, told in zip(names, mask, strict=True) if told)
