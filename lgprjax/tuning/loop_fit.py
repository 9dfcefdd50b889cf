"""Numbers of the steering loop identified from drives: values with intervals, and whether torque is missing."""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from lgprjax.tuning.loop import (
    ASYMMETRY,
    BY_FACTOR,
    NAMES,
    ODOMETER_SHARE,
    RATE,
    RATIO,
    SLIP,
    STEP_S,
    LoopLogs,
    LoopPosterior,
    LoopPrior,
    identify,
)
from lgprjax.tuning.robust import Estimate, NotExcitedError, student_95

LEAST_S = 10.0
TOLD_SHARE = 0.5
"""Posterior width over prior width up to which a number counts as identified by the drives."""
_LARGEST_LEFT = 0.5
_BETWEEN = 16
"""Places between two rates of the grid."""


class LoopFit(NamedTuple):
    """The loop, estimated from the drives with the vehicle file as prior.

    Attributes:
        numbers: by name, with 95 % intervals.
        told: names of the identified numbers, at most half as wide as before.
        narrowed: width over that before the drives, by name.
        rate_bounded: the drives only give a lower bound of the servo's rate.
        limit_share: highest share of the servo's largest rate that a drive reached.
        scale: of the residuals: front angle and yaw rate of each drive.
        place: mean of the posterior, in units of the prior's width.
        posterior, prior: for draws.
    """

    numbers: dict[str, Estimate]
    told: tuple[str, ...]
    narrowed: dict[str, float]
    rate_bounded: bool
    limit_share: Float[np.ndarray, " drive"]
    scale: Float[np.ndarray, "drive 2"]
    place: Float[Array, " number"]
    posterior: LoopPosterior
    prior: LoopPrior


def fit_loop(prior: LoopPrior, logs: LoopLogs) -> LoopFit:
    """Identify the loop.

    Raises:
        NotExcitedError: too little is left of the drives, or the fit does not come to rest on them.
    """
    seconds = float(np.sum(np.asarray(logs.front_used))) * STEP_S
    if seconds < LEAST_S:
        raise NotExcitedError("loop", f"{LEAST_S:g} s of commands and wheel angles while driving", f"{seconds:.1f} s")
    posterior = identify(prior, logs)
    left = float(posterior.left)
    if not left <= _LARGEST_LEFT:
        expected = f"a fit that converges to within {_LARGEST_LEFT:g} standard errors"
        raise NotExcitedError("loop", expected, f"{left:.2g} standard errors remaining")
    return summarise(prior, posterior)


def summarise(prior: LoopPrior, posterior: LoopPosterior) -> LoopFit:
    """Numbers with intervals from a posterior."""
    place, weight, root = (np.asarray(part, np.float64) for part in posterior[:3])
    value, width = np.asarray(prior.value, np.float64), np.asarray(prior.width, np.float64)
    t95 = student_95(max(float(posterior.blocks) - len(NAMES), 3.0))
    mean = weight @ place
    variance = weight @ (np.einsum("rpq,rpq->rp", root, root) + (place - mean) ** 2)
    found = value + width * mean
    variance[RATIO] += (ODOMETER_SHARE * (1.0 + found[RATIO]) / width[RATIO]) ** 2
    variance[SLIP] += (2.0 * ODOMETER_SHARE * found[SLIP] / width[SLIP]) ** 2
    numbers, narrowed = {}, {}
    for number, name in enumerate(NAMES):
        half = t95 * np.sqrt(variance[number])
        low, middle, high = mean[number] - half, mean[number], mean[number] + half
        if number == RATE:
            low, high = _bounds_of_rate(place[:, RATE], weight, 0.025 * (t95 / 1.96) ** -2)
        bounds = [
            float(
                value[number] * np.exp(width[number] * at) if BY_FACTOR[number] else value[number] + width[number] * at
            )
            for at in (low, middle, high)
        ]
        numbers[name] = Estimate(bounds[1], 0.5 * (bounds[2] - bounds[0]) / t95, bounds[0], bounds[2])
        narrowed[name] = float(np.sqrt(variance[number]))
    told = tuple(name for name in NAMES if narrowed[name] <= TOLD_SHARE)
    return LoopFit(
        numbers=numbers,
        told=told,
        narrowed=narrowed,
        rate_bounded="rate_radps" not in told,
        limit_share=np.asarray(posterior.limit_share, np.float64),
        scale=np.asarray(posterior.scale, np.float64),
        place=jnp.asarray(mean, jnp.float32),
        posterior=posterior,
        prior=prior,
    )


def _bounds_of_rate(
    place: Float[np.ndarray, " rate"], weight: Float[np.ndarray, " rate"], tail: float
) -> tuple[float, float]:
    """Places below and above which that share of the posterior lies.

    The logarithm of its density is linear between rates of the grid: were all of a rate's weight spread evenly to its
    neighbours, tails would be too heavy.
    """
    logarithm = np.log(np.maximum(weight / np.gradient(place), 1e-30))
    at, nodes = np.linspace(0.0, len(place) - 1.0, _BETWEEN * (len(place) - 1) + 1), np.arange(len(place))
    fine, between = np.interp(at, nodes, place), np.exp(np.interp(at, nodes, logarithm))
    below = np.concatenate([[0.0], np.cumsum(0.5 * (between[1:] + between[:-1]) * np.diff(fine))])
    low, high = np.interp([tail, 1.0 - tail], below / below[-1], fine)
    return float(low), float(high)


_MISSING = 0.3
"""Share of the torque that is looked for."""
_FALSE = 0.005
"""How often a verdict may be wrong by the errors of the drives."""


def torque_verdict(fit: LoopFit) -> str:
    """``weak``, ``full`` or ``not observable``: whether 30 % of the torque are missing against the vehicle file.

    By the likelihood of the drives (its interval: Wilks, 1938), since the file is the yardstick: what it says of the
    rate is taken out of the posterior. Full torque and 30 % less are parted half-way, at the root of 0.7: for files
    whose rate is right to within 16 %. Drives that turn fast to one side identify the rate to that side, not the
    mean of both: the best known rate is compared, to a side or between the two.
    """
    from scipy.special import stdtrit  # those who draw pictures import this module and need not wait for it

    place, weight, root = (np.asarray(part, np.float64) for part in fit.posterior[:3])
    width = np.asarray(fit.prior.width, np.float64)
    step = np.gradient(place[:, RATE])
    likelihood = np.log(np.maximum(weight / step, 1e-30)) + 0.5 * place[:, RATE] ** 2
    likelihood -= np.max(likelihood)
    rate, uneven = width[RATE] * place[:, RATE], width[ASYMMETRY] * place[:, ASYMMETRY]
    own = width[ASYMMETRY] * np.linalg.norm(root[:, ASYMMETRY], axis=1)
    share = step * np.exp(likelihood)
    share /= np.sum(share)
    away = uneven - share @ uneven
    side = np.clip(-(share @ (away * rate)) / (share @ (away**2 + own**2)), -1.0, 1.0)
    at, nodes = np.linspace(0.0, len(rate) - 1.0, _BETWEEN * len(rate)), np.arange(len(rate))
    told, above, spread = (
        np.interp(at, nodes, part)
        for part in (likelihood, rate + side * uneven - 0.5 * np.log1p(-_MISSING), np.abs(side) * own + 1e-6)
    )
    # Of the likeliest rate below, and of the likeliest above: against the likeliest of all.
    sides = np.array([np.max(told - 0.5 * (np.maximum(sign * above, 0.0) / spread) ** 2) for sign in (1.0, -1.0)])
    # Quantiles of both tails are wider where few blocks show what the noise is.
    freedom = max(float(fit.posterior.blocks) - len(NAMES), 3.0)
    not_below, not_above = sides < -0.5 * float(stdtrit(freedom, 1.0 - _FALSE)) ** 2
    if not_below == not_above:
        return "not observable"
    return "full" if not_below else "weak"
