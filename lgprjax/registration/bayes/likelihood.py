"""From correlation to evidence: how many times likelier a correlation is on the map's ground than on foreign ground.

A stop holds N independent numbers. On foreign ground its correlation scatters about zero with variance 1/N; on the
map's own ground, repeated with a correlation rho, the ratio of the two likelihoods, gain and noise projected out, is
(1 - rho²)^(N/2) / (1 - rho r)^N. N is measured on the map, whose scans are led over other places of it, and never more
than the drive's own scatter far from its place allows. Correlations have a tail (a stone resembles a stone): at every
place, and on foreign ground, a share ``tail`` of stops is taken to say what was believed before, whatever they say. No
stop changes the odds of two places, or of foreign ground, by more than 1/tail.
"""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

RHOS = (0.2, 0.45, 0.7, 0.9)
"""Correlations with which the map's ground may repeat itself on another day."""
_LARGEST_R = 0.98
_LEAST_STRETCHES = 12
_CAUTIOUS = 2.0
"""Factor on variance and memory of a map that is too short to measure its own."""
_SURE = 2.0
"""Standard errors by which the measured memory is raised."""
_TAILS = np.exp(-np.arange(0.5, 6.01, 0.25))
_RUNS = (1, 4, 16)
"""Stops over which the mean evidence of foreign ground must not exceed one."""


class Likelihood(NamedTuple):
    """What foreign ground scores on a map, for one array.

    Attributes:
        variance: of the correlation of a stop with foreign ground.
        memory: by how much the variance of a sum over stops exceeds that of independent ones.
        tail: share of stops that score like anything.
        stretches: of the map that it was measured on; 0: borrowed.
    """

    variance: float | Float[Array, ""]
    memory: float | Float[Array, ""]
    tail: float | Float[Array, ""]
    stretches: int = 0


BORROWED = Likelihood(0.05, 2.0, 0.22)


def evidence(
    r: Float[Array, "*lattice"], rho: Float[Array, "*lattice"], numbers: Float[Array, "*lattice"]
) -> Float[Array, "*lattice"]:
    """Ratio of a correlation's likelihoods on the map's ground and on foreign ground; 1 where there are no numbers."""
    log = numbers * (0.5 * jnp.log1p(-(rho**2)) - jnp.log1p(-rho * jnp.minimum(r, _LARGEST_R)))
    return jnp.exp(jnp.clip(log, -60.0, 60.0))


def measure_likelihood(r: list[Float[np.ndarray, "stop place"]]) -> Likelihood:
    """Likelihood from correlations on foreign ground: of each stretch, stop after stop, at places that stay the same.

    The tail is the smallest for which the evidence of foreign ground, over one stop and over several, is one in the
    mean for every repeatability: then the probability that it ever exceeds x is at most 1/x (Ville, 1939).
    """
    if len(r) < _LEAST_STRETCHES:
        if not r:
            return BORROWED
        known = measure_likelihood(r * -(-_LEAST_STRETCHES // len(r)))
        tail = max(float(known.tail), float(BORROWED.tail))
        return Likelihood(_CAUTIOUS * float(known.variance), _CAUTIOUS * float(known.memory), tail, 0)
    variance = float(np.mean([np.mean(each**2) for each in r]))
    run = min(_RUNS[-1], min(len(each) for each in r))
    summed = [np.mean(_runs(each, run).sum(axis=1) ** 2) / run for each in r]
    # What so few stretches may have shown too small.
    most = float(np.mean(summed) + _SURE * np.std(summed, ddof=1) / np.sqrt(len(summed)))
    memory = max(most / variance, 1.0)
    tail = float(_TAILS[0])
    # A share of three in so many stretches, each with its own ground, would not have been seen.
    unseen = 3.0 / len(r)
    numbers = 1.0 / (variance * memory)
    for wanted in sorted(float(each) for each in _TAILS if each >= unseen):
        if all(_mean_evidence(r, rho, numbers, wanted, run) <= 1.0 for rho in RHOS for run in _RUNS):
            tail = wanted
            break
    return Likelihood(variance, memory, tail, len(r))


def _runs(each: Float[np.ndarray, "stop place"], length: int) -> Float[np.ndarray, "run length place"]:
    count = len(each) // length
    return each[: count * length].reshape(count, length, -1)


def _mean_evidence(r: list[np.ndarray], rho: float, numbers: float, tail: float, length: int) -> float:
    """Mean over foreign stretches and places of the evidence of so many stops together."""
    means = []
    for each in r:
        if len(each) < length:
            continue
        log = numbers * (0.5 * np.log1p(-(rho**2)) - np.log1p(-rho * np.minimum(each, _LARGEST_R)))
        capped = log - np.logaddexp(np.log1p(-tail), np.log(tail) + log)
        means.append(np.mean(np.exp(_runs(capped, length).sum(axis=1))))
    return float(np.mean(means)) if means else 0.0
