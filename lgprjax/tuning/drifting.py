"""Linear fits to numbers along a drive whose errors have a part that drifts: an INS heading between its corrections.

The errors are white, each of its own size, and a Gauss-Markov process. Its share and its time constant are not known
and cannot be found well from a few dozen numbers, so that they are averaged over by their likelihood (the restricted
one: that of what the fit leaves): the interval holds with a drift and without.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from lgprjax.tuning.estimate import NotExcitedError

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
        raise NotExcitedError("fit", f"{columns} quantities that vary independently", "ones that do not")
    share, drift_s = (grid.ravel() for grid in np.meshgrid(_SHARES, _DRIFT_S))
    # The last candidate is that of no drift, whatever its time constant.
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
