"""An error model of fixes from a drive whose truth is known: slow and white parts, and where there were none."""

from itertools import pairwise
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

_BINS_M = (0.15, 0.3, 0.5, 0.8, 1.2, 1.8, 2.5, 3.5, 5.0)
_FEWEST = 50


class FixErrorFit(NamedTuple):
    """What fixes of a drive were wrong by; along (m), across (m), in heading (rad).

    Attributes:
        bias: mean.
        slow_sigma, white_sigma: of the part that neighbouring fixes share, and of the rest.
        slow_m: way over which the slow part is lost, of the cross-track errors.
        found_m, lost_m: mean lengths of stretches with fixes and without.
        strength, p_false: medians of the ok fixes' matches.
    """

    bias: Float[np.ndarray, "3"]
    slow_sigma: Float[np.ndarray, "3"]
    white_sigma: Float[np.ndarray, "3"]
    slow_m: float
    found_m: float
    lost_m: float
    strength: float
    p_false: float


def fit_fix_errors(
    travel_m: Float[np.ndarray, " scan"],
    ok: Bool[np.ndarray, " scan"],
    error: Float[np.ndarray, "scan 3"],
    strength: Float[np.ndarray, " scan"],
    p_false: Float[np.ndarray, " scan"],
) -> FixErrorFit:
    """Moments of a drive's errors.

    The covariance of two fixes of a drive falls with the way between them as σ² exp(−d / L); what it is short of the
    variance at no distance is white. Level and length are fitted by least squares on the logarithm, over distances at
    which the covariance is clearly above zero.

    Args:
        travel_m: way driven at each scan.
        ok: there was a fix.
        error: of it; what stands where there was none is not used.
        strength, p_false: of its match.

    Raises:
        ValueError: fewer than 50 fixes.
    """
    if int(ok.sum()) < _FEWEST:
        raise ValueError(f"{int(ok.sum())} fixes are too few for an error model, {_FEWEST} are needed")
    place, wrong = travel_m[ok], error[ok]
    bias = wrong.mean(axis=0)
    rest = wrong - bias
    variance = rest.var(axis=0)
    shared = np.array([_shared(place, rest, low, high) for low, high in pairwise(_BINS_M)])
    middle = 0.5 * (np.array(_BINS_M[1:]) + np.array(_BINS_M[:-1]))
    slow_m = _length(middle, shared[:, 1], variance[1])
    slow = np.clip(shared[0] * np.exp(middle[0] / slow_m), 0.0, variance)
    found_m, lost_m = _stretches(travel_m, ok)
    matched = float(np.median(strength[ok])), float(np.median(p_false[ok]))
    return FixErrorFit(bias, np.sqrt(slow), np.sqrt(variance - slow), slow_m, found_m, lost_m, *matched)


def _shared(
    place_m: Float[np.ndarray, " fix"], rest: Float[np.ndarray, "fix 3"], low_m: float, high_m: float
) -> Float[np.ndarray, "3"]:
    """Mean product of errors of fixes between two distances apart."""
    first = np.searchsorted(place_m, place_m + low_m)
    last = np.searchsorted(place_m, place_m + high_m)
    sums = np.concatenate([np.zeros((1, rest.shape[1])), np.cumsum(rest, axis=0)])
    products = rest * (sums[last] - sums[first])
    return np.asarray(products.sum(axis=0) / max(int((last - first).sum()), 1))


def _length(distance_m: Float[np.ndarray, " bin"], shared: Float[np.ndarray, " bin"], variance: float) -> float:
    """Way over which a covariance falls by a factor of e."""
    clear = shared > 0.05 * variance
    until = len(clear) if clear.all() else int(np.argmin(clear))
    if until < 2:
        return float(distance_m[0])
    slope = np.polyfit(distance_m[:until], np.log(shared[:until]), 1)[0]
    return float(np.clip(-1.0 / slope, distance_m[0], distance_m[-1])) if slope < 0.0 else float(distance_m[-1])


def _stretches(travel_m: Float[np.ndarray, " scan"], ok: Bool[np.ndarray, " scan"]) -> tuple[float, float]:
    """Mean lengths of the stretches with fixes and without."""
    changes = np.flatnonzero(np.diff(ok.astype(int)))
    step_m = float(np.median(np.diff(travel_m)))
    runs = max((len(changes) + 1) / 2.0, 1.0)
    share = float(ok.mean())
    return share * len(ok) * step_m / runs, max((1.0 - share) * len(ok) * step_m / runs, 0.1 * step_m)
