"""Calibration 2: the encoder against the potentiometer, standing still, the wheel turned both ways with pauses.

Each pause is one point: the mean voltage over the counts at which the wheel was held. The voltage lies on one line
where the wheel came from the right and on another where it came from the left: the play between encoder and
potentiometer keeps them apart, by so many counts. The zero of the encoder is another one at every start, the
potentiometer is not: the pair of a reference voltage and its counts is what carries over.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from lgprjax.tuning.estimate import Estimate, NotExcitedError
from lgprjax.tuning.pauses import Pauses, find_pauses
from lgprjax.tuning.robust import RobustFit, combine, estimate, robust_fit, student_95
from lgprjax.vehicle.signals import DriveSignals

WHAT = "encoder against potentiometer"
LEAST_PAUSES = 8
LARGEST_DEGREE = 3
LARGEST_SCATTER = 0.05


class EncoderFit(NamedTuple):
    """The encoder's counts over the potentiometer's volts.

    Attributes:
        counts_per_v: at the reference voltage.
        reference_v: voltage that the counts are referred to; taken as given.
        reference_counts: at which the potentiometer reads it, in the middle of the play.
        hysteresis_counts: by which the two directions lie apart: the play.
        volts: polynomial of the voltage in counts from ``reference_counts``, from the constant up.
        why: the degree of the polynomial, and why it is that, in words.
        rms_counts, largest_counts: of the pauses about the fit, outliers aside.
        pauses: the points.
        weight: of each in the fit, 0 for one taken away as an outlier.
    """

    counts_per_v: Estimate
    reference_v: float
    reference_counts: Estimate
    hysteresis_counts: Estimate
    volts: Float[np.ndarray, " coefficient"]
    why: str
    rms_counts: float
    largest_counts: float
    pauses: Pauses
    weight: Float[np.ndarray, " pause"]


def fit_encoder(signals: DriveSignals, reference_v: float | None = None) -> EncoderFit:
    """Encoder against potentiometer, from a log of the wheel turned at standstill.

    A straight line is fitted; a polynomial up to the third degree where the line's residuals leave no doubt.

    Args:
        signals: of the log.
        reference_v: as a rule the straight potentiometer value; None for the middle of the voltages seen.

    Raises:
        NotExcitedError: a signal is missing or stuck, the vehicle moved, there are too few pauses, pauses from one
            side only, or the voltages do not follow the counts.
    """
    pauses = find_pauses(signals, WHAT)
    rising, falling = np.count_nonzero(pauses.direction > 0), np.count_nonzero(pauses.direction < 0)
    if rising + falling < LEAST_PAUSES:
        raise NotExcitedError(WHAT, f"{LEAST_PAUSES} pauses of a wheel turned at standstill", f"{rising + falling}")
    if min(rising, falling) < 3:
        raise NotExcitedError(WHAT, "three pauses or more from either side", f"{rising} and {falling}")
    if np.ptp(pauses.potentiometer_v) < 1e-9 * np.max(np.abs(pauses.potentiometer_v)):  # a mean is rounded
        raise NotExcitedError(WHAT, "a potentiometer that follows the wheel", "one voltage at every pause")
    centre, half = float(np.mean(pauses.counts)), 0.5 * float(np.ptp(pauses.counts))
    place = (pauses.counts - centre) / half
    fit, why = _choose_degree(place, pauses)
    if fit.scale > LARGEST_SCATTER * abs(float(fit.coefficients[1])):
        raise NotExcitedError(
            WHAT,
            "voltages that follow the counts",
            f"a scatter of {fit.scale:.3f} V over {np.ptp(pauses.potentiometer_v):.3f} V",
        )
    return _result(fit, why, centre, half, pauses, reference_v)


def potentiometer_of_counts(fit: EncoderFit, counts: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
    """Voltage at counts of the same start, in the middle of the play."""
    return np.asarray(np.polynomial.polynomial.polyval(counts - fit.reference_counts.value, fit.volts))


def _design(
    place: Float[np.ndarray, " pause"], direction: Float[np.ndarray, " pause"], degree: int
) -> Float[np.ndarray, "pause coefficient"]:
    """Powers of the place, then the side that the wheel came from."""
    return np.column_stack([np.vander(place, degree + 1, increasing=True), 0.5 * direction])


def _choose_degree(place: Float[np.ndarray, " pause"], pauses: Pauses) -> tuple[RobustFit, str]:
    """The highest degree whose last coefficient is beyond doubt (twice its 95 % interval), else the straight line."""
    for degree in range(LARGEST_DEGREE, 1, -1):
        if place.size < degree + 5:
            continue
        fit = robust_fit(_design(place, pauses.direction, degree), pauses.potentiometer_v)
        last, sigma = float(fit.coefficients[degree]), float(np.sqrt(fit.covariance[degree, degree]))
        if abs(last) > 2.0 * student_95(fit.degrees) * sigma:
            return fit, f"polynomial of degree {degree}: a straight line is off by {abs(last):.4f} V at the ends"
    return robust_fit(
        _design(place, pauses.direction, 1), pauses.potentiometer_v
    ), "straight line: nothing speaks for more"


def _result(
    fit: RobustFit, why: str, centre: float, half: float, pauses: Pauses, reference_v: float | None
) -> EncoderFit:
    degree = fit.coefficients.size - 2
    curve = np.polynomial.Polynomial(fit.coefficients[:-1])
    if reference_v is None:
        reference_v = float(curve(0.0))
    at = _solve(curve, reference_v)
    slope_row = np.append([power * at ** max(power - 1, 0) for power in range(degree + 1)], 0.0) / half
    slope = combine(fit, slope_row)
    inverse = sorted([1.0 / slope.low, 1.0 / slope.high])
    counts_per_v = Estimate(1.0 / slope.value, slope.sigma / slope.value**2, inverse[0], inverse[1])
    value = combine(fit, np.append(at ** np.arange(degree + 1.0), 0.0))
    # The wheel is behind the motor: coming up in counts it reads the voltage of fewer.
    apart = -fit.coefficients[-1] / slope.value
    apart_row = np.append(np.zeros(degree + 1), -1.0 / slope.value) - apart / slope.value * slope_row
    residual = (
        pauses.potentiometer_v - _design((pauses.counts - centre) / half, pauses.direction, degree) @ fit.coefficients
    )
    kept = np.abs(residual[fit.weight > 0.0] / slope.value)
    return EncoderFit(
        counts_per_v,
        reference_v,
        estimate(centre + half * at, value.sigma / abs(slope.value), fit.degrees),
        estimate(float(apart), float(np.sqrt(apart_row @ fit.covariance @ apart_row)), fit.degrees),
        np.asarray(curve(np.polynomial.Polynomial([at, 1.0 / half])).coef),
        why,
        float(np.sqrt(np.mean(kept**2))),
        float(np.max(kept)),
        pauses,
        fit.weight,
    )


def _solve(curve: np.polynomial.Polynomial, volts: float) -> float:
    """Place at which the curve has the voltage: the one nearest to the middle.

    Raises:
        NotExcitedError: it has it nowhere in twice the range that was turned through.
    """
    roots = (curve - volts).roots()
    real = np.real(roots[np.abs(np.imag(roots)) < 1e-9])
    near = real[np.abs(real) < 2.0]
    if near.size == 0:
        raise NotExcitedError(WHAT, f"a wheel turned about the reference of {volts:.3f} V", "no such voltage near")
    return float(near[np.argmin(np.abs(near))])


def fitted_volts(
    fit: EncoderFit, counts: Float[np.ndarray, " record"], direction: Float[np.ndarray, " record"]
) -> Float[np.ndarray, " record"]:
    """Voltage at counts reached in a direction (+1 rising): the middle of the play and half of it to either side."""
    half_v = 0.5 * fit.hysteresis_counts.value / fit.counts_per_v.value
    return np.asarray(potentiometer_of_counts(fit, counts) - direction * half_v)
