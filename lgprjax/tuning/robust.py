"""Robust straight lines and other linear fits, with intervals that hold: bisquare weights, scale by median deviation.

The weights of Tukey's bisquare take outliers away altogether, started from the fit of least absolute deviations and its
scale. The covariance is that of an M-estimate with Huber's correction for few records; Student's t does the rest. Where
records belong to groups (stretches, pauses) or follow one another with memory, their scores are summed over the group,
or the count of records is brought down to that of independent ones.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

# A number found from a log, with the interval that it can be defended by.


class Estimate(NamedTuple):
    """A fitted number.

    Attributes:
        value: in the unit of its name.
        sigma: standard error.
        low, high: 95 % interval.
    """

    value: float
    sigma: float
    low: float
    high: float


class NotExcitedError(ValueError):
    """A log lacks what a fit needs; the message gives expected and found."""

    def __init__(self, what: str, expected: str, found: str) -> None:
        super().__init__(f"{what}: expected {expected}, found {found}")
        self.what, self.expected, self.found = what, expected, found


BISQUARE = 4.685
ROUNDS = 60
START_ROUNDS = 8


class RobustFit(NamedTuple):
    """A linear fit.

    Attributes:
        coefficients: one a column of the design.
        covariance: of them.
        scale: sigma of a record about the fit, outliers aside.
        degrees: of freedom that the intervals are taken with.
        weight: of each record, 0 for one that was taken away.
    """

    coefficients: Float[np.ndarray, " coefficient"]
    covariance: Float[np.ndarray, "coefficient coefficient"]
    scale: float
    degrees: float
    weight: Float[np.ndarray, " record"]


def robust_fit(
    design: Float[np.ndarray, "record coefficient"],
    y: Float[np.ndarray, " record"],
    *,
    group: Int[np.ndarray, " record"] | None = None,
    serial: bool = False,
) -> RobustFit:
    """Fits ``y = design @ coefficients``.

    Args:
        design: one column a coefficient.
        y: measured, finite.
        group: number of the group that a record belongs to: errors are independent between groups, not within.
        serial: the records stand in order of time and their errors have memory, shorter by far than the record.

    Raises:
        NotExcitedError: fewer than three independent records more than coefficients, or columns that depend on each
            other.
    """
    records, columns = design.shape
    _need_records(records, columns)
    base, triangle = np.linalg.qr(design)
    pivots = np.abs(np.diag(triangle))
    if not (pivots > 1e-9 * np.linalg.norm(design, axis=0)).all():
        raise NotExcitedError("fit", f"{columns} quantities that vary independently", "dependent quantities")
    fitted, scale = _least_absolute(base, y)
    scale = max(scale, 1e-12 * float(np.max(np.abs(y))), 1e-300)
    for _ in range(ROUNDS):
        before, fitted = fitted, _weighted(base, y, _bisquare((y - base @ fitted) / scale))
        if np.max(np.abs(fitted - before)) <= 1e-4 * scale:
            break
    score = (y - base @ fitted) / scale
    weight = _bisquare(score)
    covariance, degrees = _covariance(base, score, group, serial)
    back = scale * np.linalg.inv(triangle)
    return RobustFit(np.linalg.solve(triangle, fitted), back @ covariance @ back.T, scale, degrees, weight)


def robust_line(
    x: Float[np.ndarray, " record"],
    y: Float[np.ndarray, " record"],
    *,
    group: Int[np.ndarray, " record"] | None = None,
    serial: bool = False,
) -> RobustFit:
    """A straight line: coefficients (value at x = 0, slope). Arguments and errors as for ``robust_fit``."""
    return robust_polynomial(x, y, 1, group=group, serial=serial)


def robust_polynomial(
    x: Float[np.ndarray, " record"],
    y: Float[np.ndarray, " record"],
    degree: int,
    *,
    group: Int[np.ndarray, " record"] | None = None,
    serial: bool = False,
) -> RobustFit:
    """A polynomial, coefficients from the constant up; degree 0 is a robust mean. The rest as for ``robust_fit``."""
    return robust_fit(np.vander(x, degree + 1, increasing=True), y, group=group, serial=serial)


def combine(fit: RobustFit, row: Float[np.ndarray, " coefficient"]) -> Estimate:
    """The linear combination ``row @ coefficients``: a coefficient, or the fit's value where ``row`` is its design."""
    sigma = float(np.sqrt(row @ fit.covariance @ row))
    return estimate(float(row @ fit.coefficients), sigma, fit.degrees)


def estimate(value: float, sigma: float, degrees: float) -> Estimate:
    """An estimate whose 95 % interval is Student's."""
    half = student_95(degrees) * sigma
    return Estimate(value, sigma, value - half, value + half)


def student_95(degrees: float) -> float:
    """Student's t that 95 % of draws stay within.

    Raises:
        ValueError: fewer than three degrees of freedom: an interval from so little says nothing.
    """
    if not degrees >= 3.0:
        raise ValueError(f"an interval wants three degrees of freedom, not {degrees}")
    from scipy.special import stdtrit  # those who draw pictures import this module and need not wait for it

    return float(stdtrit(degrees, 0.975))


def clipped_mean(values: Float[np.ndarray, " record"]) -> float:
    """Mean of the values within four scales of the median: nearly as good as the mean, untouched by spikes."""
    middle = median(values)
    away = np.abs(values - middle)
    return float(values[away <= 4.0 / 0.6745 * median(away)].mean())


def median(values: Float[np.ndarray, " record"]) -> float:
    """Median of finite values; NumPy's own takes ten times as long over a few records."""
    ordered = np.sort(values)
    return float(0.5 * (ordered[(ordered.size - 1) // 2] + ordered[ordered.size // 2]))


def independent_share(score: Float[np.ndarray, " record"], fitted: int = 1) -> float:
    """Share of independent records among those of a series with memory: 1 / (1 + 2 Σ ρ), at most 1.

    Autocorrelations are summed in pairs up to the first pair that is not positive: beyond it there is only noise. A fit
    takes some of the memory with it: of each lag, as much as a coefficient has of the whole.

    Args:
        score: residuals, in order of time.
        fitted: number of coefficients that they are residuals of, a mean being one.
    """
    centred = score - np.mean(score)
    size = 1 << (2 * centred.size - 1).bit_length()
    spectrum = np.abs(np.fft.rfft(centred, size)) ** 2
    memory = np.fft.irfft(spectrum, size)[: centred.size]
    if memory[0] <= 0.0:
        return 1.0
    pairs = memory[: centred.size // 2 * 2].reshape(-1, 2).sum(axis=1) / memory[0]
    positive = pairs > 0.0
    last = int(np.argmin(positive)) if not positive.all() else positive.size
    length = max(2.0 * float(pairs[:last].sum()) - 1.0, 1.0)
    taken = fitted * length / centred.size
    return float(1.0 / (length + 2.0 * max(2 * last - 1, 0) * taken * (length > 1.0)))


def _need_records(records: int | float, columns: int) -> None:
    if records < columns + 3:
        raise NotExcitedError("fit", f"{columns + 3} independent records or more", f"{records:.0f}")


def _weighted(
    base: Float[np.ndarray, "record coefficient"], y: Float[np.ndarray, " record"], weight: Float[np.ndarray, " record"]
) -> Float[np.ndarray, " coefficient"]:
    """Weighted least squares on orthonormal columns; a hair of ridge answers where too few records have weight."""
    heavy = base.T * weight
    ridge = 1e-12 * float(weight.sum()) + 1e-300
    return np.asarray(np.linalg.solve(heavy @ base + ridge * np.eye(base.shape[1]), heavy @ y))


def _least_absolute(
    base: Float[np.ndarray, "record coefficient"], y: Float[np.ndarray, " record"]
) -> tuple[Float[np.ndarray, " coefficient"], float]:
    """Fit of least absolute deviations, and the scale of its residuals: as a start only."""
    fitted = base.T @ y
    for _ in range(START_ROUNDS):
        away = np.abs(y - base @ fitted)
        typical = median(away)
        before, fitted = fitted, _weighted(base, y, 1.0 / np.maximum(away, max(0.05 * typical, 1e-300)))
        if np.max(np.abs(fitted - before)) <= 0.05 * typical:
            break
    # As many residuals as there are coefficients are nearly zero: the median is that of the others.
    away = np.sort(np.abs(y - base @ fitted))[base.shape[1] :]
    return fitted, median(away) / 0.6745


def _bisquare(score: Float[np.ndarray, " record"]) -> Float[np.ndarray, " record"]:
    return np.maximum(1.0 - (score / BISQUARE) ** 2, 0.0) ** 2


def _covariance(
    base: Float[np.ndarray, "record coefficient"],
    score: Float[np.ndarray, " record"],
    group: Int[np.ndarray, " record"] | None,
    serial: bool,
) -> tuple[Float[np.ndarray, "coefficient coefficient"], float]:
    """Covariance of coefficients of orthonormal columns, in squared scales, and the intervals' degrees of freedom."""
    records, columns = base.shape
    share = np.minimum((score / BISQUARE) ** 2, 1.0)
    pull = score * (1.0 - share) ** 2
    steep = (1.0 - share) * (1.0 - 5.0 * share)
    mean_steep = float(np.mean(steep))
    factor = ((1.0 + columns / records * float(np.var(steep)) / mean_steep**2) / mean_steep) ** 2
    if group is not None:
        covariance, free = _grouped(base, pull, group)
        return factor * covariance, free
    independent = independent_share(pull, columns) if serial else 1.0
    # A record counts with its weight: one of weight a half is half a record.
    degrees = independent * float(np.sum((1.0 - share) ** 2)) - columns
    _need_records(degrees + columns, columns)
    spread = float(np.sum(pull**2)) / (records * independent - columns)
    return factor * spread * np.eye(columns), degrees


def _grouped(
    base: Float[np.ndarray, "record coefficient"], pull: Float[np.ndarray, " record"], group: Int[np.ndarray, " record"]
) -> tuple[Float[np.ndarray, "coefficient coefficient"], float]:
    """Covariance of the groups' scores, each enlarged by the leverage of the fit: (1 − M)^-½, M the group's own.

    A fit follows each of a few groups; their residuals as they are would promise too much. The degrees of freedom are
    those of the coefficient that rests on the fewest groups.
    """
    columns = base.shape[1]
    numbers = np.unique(group)
    _need_records(numbers.size, columns)
    total, leverage = np.zeros((columns, columns)), np.zeros((numbers.size, columns))
    for index, number in enumerate(numbers):
        inside = base[group == number]
        own = inside.T @ inside
        values, vectors = np.linalg.eigh(np.eye(columns) - own)
        larger = (vectors / np.sqrt(np.maximum(values, 0.01))) @ vectors.T
        scored = larger @ (inside.T @ pull[group == number])
        total += np.outer(scored, scored)
        leverage[index] = np.diag(own)
    free = min(float(numbers.size - columns), float(np.min(1.0 / np.sum(leverage**2, axis=0))))
    return total, max(free, 3.0)


# Linear fits to a few numbers, each with a standard error of its own that may be too small.
#
# Scatter beyond the standard errors is modelled as a common further variance (Paule and Mandel, 1982); the
# intervals are Student's with the scatter that is left (Hartung and Knapp, 2001): they hold with a dozen numbers,
# where normal intervals of known variances do not.

_CLIP = 2.5
"""Standard errors beyond which a residual is clipped; one in eighty is clipped in good data."""
_CLEAR = 2.0
"""Standard deviations by which the squares must be too large before a further variance is added."""
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
        raise NotExcitedError("fit", f"{columns} quantities that vary independently", "dependent quantities")
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
