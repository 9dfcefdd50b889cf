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
_SURE = 2.0
"""Standard errors by which what is measured is raised."""
_TYPICAL, _GROUNDS, _STRETCHES = (0.04, 0.1), (0.5, 0.7), (0.3, 0.85)
"""Of arrays of one to three channels: variance of a stop, and, of several together, for each of them; scatter of their
logarithms between grounds; relative scatter between stretches of one ground, the largest seen."""
_ELSEWHERE = 12
"""Stretches of a map's own that those of other grounds count for in its tail."""
_TAILS = np.exp(-np.arange(0.5, 6.01, 0.25))
_RUNS = (1, 4, 16)
"""Stops over which the mean evidence of foreign ground must not exceed one."""


class Likelihood(NamedTuple):
    """What foreign ground scores on a map, for one array.

    Attributes:
        variance: of the correlation of a stop with foreign ground.
        memory: by how much the variance of a sum over stops exceeds that of independent ones.
        tail: share of stops that score like anything.
        stretches: of the map that it was measured on.
    """

    variance: float | Float[Array, ""]
    memory: float | Float[Array, ""]
    tail: float | Float[Array, ""]
    stretches: int = 0


def evidence(
    r: Float[Array, "*lattice"], rho: Float[Array, "*lattice"], numbers: Float[Array, "*lattice"]
) -> Float[Array, "*lattice"]:
    """Ratio of a correlation's likelihoods on the map's ground and on foreign ground; 1 where there are no numbers."""
    log = numbers * (0.5 * jnp.log1p(-(rho**2)) - jnp.log1p(-rho * jnp.minimum(r, _LARGEST_R)))
    return jnp.exp(jnp.clip(log, -60.0, 60.0))


def measure_likelihood(r: list[Float[np.ndarray, "stop place"]]) -> Likelihood:
    """Likelihood from correlations on foreign ground: of each stretch, stop after stop, at places that stay the same.

    The fewer stretches a map has, the more counts what other grounds have, and the more both are raised by what is not
    known: of 25 grounds and arrays, one in a hundred holds fewer numbers than is told from none to thirty stretches.
    The tail is the smallest for which the evidence of foreign ground, over one stop and over several, is one in the
    mean for every repeatability: then the probability that it ever exceeds x is at most 1/x (Ville, 1939).
    """
    run = min((_RUNS[-1], *(len(each) for each in r)))
    alone, _ = _typical([float(np.mean(each**2)) for each in r], 0)
    together, error = _typical([float(np.mean(_runs(each, run).sum(axis=1) ** 2)) / run for each in r], 1)
    together = max(together * np.exp(_SURE * error), alone)
    tail = float(_TAILS[0])
    # A share of three in so many stretches, each with its own ground, would not have been seen.
    unseen = 3.0 / (len(r) + _ELSEWHERE)
    for wanted in sorted(float(each) for each in _TAILS if each >= unseen):
        if all(_mean_evidence(r, rho, 1.0 / together, wanted, run) <= 1.0 for rho in RHOS for run in _RUNS):
            tail = wanted
            break
    return Likelihood(alone, together / alone, tail, len(r))


def _typical(measured: list[float], which: int) -> tuple[float, float]:
    """Mean of a ground, and its relative standard error, from its stretches and what is usual elsewhere."""
    usual, own = 1.0 / _GROUNDS[which] ** 2, len(measured) / _STRETCHES[which] ** 2
    log = usual * np.log(_TYPICAL[which]) + (own * np.log(np.mean(measured)) if measured else 0.0)
    return float(np.exp(log / (usual + own))), float(1.0 / np.sqrt(usual + own))


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
