"""Linear fits to a few numbers, each with a standard error of its own that may leave something out.

What the standard errors do not explain is taken as a further variance that all share (Paule and Mandel, 1982); the
intervals are Student's with the scatter that is left (Hartung and Knapp, 2001): they hold with a dozen numbers, where
normal intervals of known variances do not.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from lgprjax.tuning.estimate import NotExcitedError

_CLIP = 2.5
"""Standard errors from which on a number pulls no harder; one in eighty is clipped where nothing is wrong."""
_CLEAR = 2.0
"""Standard deviations by which the squares must be too large before a further variance is believed in."""
_ROUNDS = 4
_STEPS = 20


class WeightedFit(NamedTuple):
    """A linear fit.

    Attributes:
        coefficients: one a column of the design.
        covariance: of them.
        degrees: of freedom of the intervals.
        extra: further standard error that all numbers share.
        residual: number less fit.
        weight: 1, or less for a number that was clipped.
    """

    coefficients: Float[np.ndarray, " coefficient"]
    covariance: Float[np.ndarray, "coefficient coefficient"]
    degrees: float
    extra: float
    residual: Float[np.ndarray, " number"]
    weight: Float[np.ndarray, " number"]


def weighted_fit(
    design: Float[np.ndarray, "number coefficient"],
    y: Float[np.ndarray, " number"],
    sigma: Float[np.ndarray, " number"],
) -> WeightedFit:
    """Fit ``y = design @ coefficients``.

    Args:
        design: one column a coefficient.
        y, sigma: numbers and their standard errors.

    Raises:
        NotExcitedError: fewer than three numbers more than coefficients, or columns that depend on each other.
    """
    numbers, columns = design.shape
    if numbers < columns + 3:
        raise NotExcitedError("fit", f"{columns + 3} settings or more", f"{numbers}")
    scaled = design / np.linalg.norm(design, axis=0)
    if not np.linalg.cond(scaled) < 1e8:
        raise NotExcitedError("fit", f"{columns} quantities that vary independently", "ones that do not")
    clip, extra = np.ones(numbers), 0.0
    for _ in range(_ROUNDS):
        extra = _extra_variance(design, y, sigma, clip)
        precision = clip / (sigma**2 + extra)
        coefficients = _solve(design, y, precision)
        score = np.abs(y - design @ coefficients) / np.sqrt(sigma**2 + extra)
        clip = np.minimum(1.0, _CLIP / np.maximum(score, 1e-12))
    residual = y - design @ coefficients
    scatter = float(np.sum(precision * residual**2)) / (numbers - columns)
    covariance = scatter * np.linalg.inv((design * precision[:, None]).T @ design)
    return WeightedFit(coefficients, covariance, float(numbers - columns), extra**0.5, residual, clip)


def _solve(
    design: Float[np.ndarray, "number coefficient"],
    y: Float[np.ndarray, " number"],
    precision: Float[np.ndarray, " number"],
) -> Float[np.ndarray, " coefficient"]:
    normal = (design * precision[:, None]).T
    return np.asarray(np.linalg.solve(normal @ design, normal @ y))


def _extra_variance(
    design: Float[np.ndarray, "number coefficient"],
    y: Float[np.ndarray, " number"],
    sigma: Float[np.ndarray, " number"],
    clip: Float[np.ndarray, " number"],
) -> float:
    """The variance that brings the weighted squares to their expectation; 0 where they are not clearly above it."""
    numbers, columns = design.shape

    extra = 0.0
    for step in range(_STEPS):
        precision = clip / (sigma**2 + extra)
        square = (y - design @ _solve(design, y, precision)) ** 2
        excess = float(np.sum(precision * square)) - (numbers - columns)
        if step == 0 and excess <= _CLEAR * (2.0 * (numbers - columns)) ** 0.5:
            return 0.0
        # Newton's step; the squares fall ever slower with the variance, so that it comes from below.
        extra += excess / float(np.sum(precision**2 / clip * square))
        if excess < 1e-3:
            break
    return max(extra, 0.0)
