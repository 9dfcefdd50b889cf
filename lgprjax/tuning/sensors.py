"""Calibration of steering sensors: encoder against potentiometer, and the straight-ahead voltage.

Each pause is one point: the mean voltage over the counts at which the wheel was held. The voltage lies on one line
where the wheel came from the right and on another where it came from the left: the play between encoder and
potentiometer keeps them apart, by so many counts. The zero of the encoder is another one at every start, the
potentiometer is not: the pair of a reference voltage and its counts is what carries over.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from lgprjax.tuning.robust import (
    Estimate,
    NotExcitedError,
    RobustFit,
    clipped_mean,
    combine,
    estimate,
    median,
    robust_fit,
    robust_line,
    student_95,
)
from lgprjax.vehicle.sensors import DriveSignals

# Calibration 1: reading of the potentiometer when the vehicle drives straight.
#
# The drive is cut into windows of its way. Each gives a mean voltage and, by the heading over the way, a curvature;
# those that turn are left out. The voltage at curvature zero is read off a robust line through the others, so that
# corrections of the driver that do not cancel do no harm. Windows, not records, count for the interval: a driver's
# hand is slow.

STRAIGHT_STUDY = "straight potentiometer value"
WINDOW_M = 5.0
LEAST_WINDOWS = 8
LARGEST_CURVATURE_RADPM = 0.005
LEAST_SPEED_MPS = 0.5
LARGEST_NOISE_V = 0.2


class StraightFit(NamedTuple):
    """The potentiometer where the vehicle runs straight.

    Attributes:
        potentiometer_v: at curvature zero.
        slope_vm: volts per rad/m of curvature; seldom well known, for a straight drive has little of it.
        curvature_radpm, window_v: of each straight window.
        weight: of each in the fit, 0 for one taken away as an outlier.
        turning: number of windows left out because they turned.
    """

    potentiometer_v: Estimate
    slope_vm: Estimate
    curvature_radpm: Float[np.ndarray, " window"]
    window_v: Float[np.ndarray, " window"]
    weight: Float[np.ndarray, " window"]
    turning: int


def fit_straight(signals: DriveSignals) -> StraightFit:
    """Potentiometer value of straight driving, from a drive along a straight line, in either direction.

    Args:
        signals: of it; the heading by INS, the way by odometer.

    Raises:
        NotExcitedError: no potentiometer, one that is stuck or all noise, a vehicle that stood or turned, or too short
            a way.
    """
    if signals.potentiometer_v is None:
        raise NotExcitedError(STRAIGHT_STUDY, "potentiometer voltages", "none in the log")
    volts = signals.potentiometer_v
    usable = np.isfinite(volts) & np.isfinite(signals.yaw_rad) & np.isfinite(signals.travel_m)
    moving = usable & (np.abs(speed_mps(signals)) > LEAST_SPEED_MPS)
    way_m = float(np.ptp(signals.travel_m[moving])) if moving.any() else 0.0
    if way_m < LEAST_WINDOWS * WINDOW_M:
        raise NotExcitedError(STRAIGHT_STUDY, f"{LEAST_WINDOWS * WINDOW_M:.0f} m of driving or more", f"{way_m:.1f} m")
    if np.ptp(volts[moving]) == 0.0:
        raise NotExcitedError(
            STRAIGHT_STUDY, "a potentiometer voltage that changes", f"{volts[moving][0]:.4f} V at every record"
        )
    window = _windows(signals, moving)
    curvature, mean_v, noise_v = _means(signals, volts, window)
    if mean_v.size and np.median(noise_v) > LARGEST_NOISE_V:
        raise NotExcitedError(
            STRAIGHT_STUDY,
            f"records within {LARGEST_NOISE_V} V of each other",
            f"a scatter of {np.median(noise_v):.2f} V",
        )
    straight = np.abs(curvature) < LARGEST_CURVATURE_RADPM
    if np.count_nonzero(straight) < LEAST_WINDOWS:
        raise NotExcitedError(
            STRAIGHT_STUDY,
            f"{LEAST_WINDOWS} stretches of {WINDOW_M:.0f} m with less than {LARGEST_CURVATURE_RADPM} rad/m",
            f"{np.count_nonzero(straight)} of {straight.size}",
        )
    fit = robust_line(curvature[straight], mean_v[straight])
    return StraightFit(
        combine(fit, np.array([1.0, 0.0])),
        combine(fit, np.array([0.0, 1.0])),
        curvature[straight],
        mean_v[straight],
        fit.weight,
        int(np.count_nonzero(~straight)),
    )


def speed_mps(signals: DriveSignals) -> Float[np.ndarray, " record"]:
    """Speed by odometer over half a second about each record: the noise of single records is no speed."""
    time_s = signals.time_s
    before, after = np.maximum(time_s - 0.25, time_s[0]), np.minimum(time_s + 0.25, time_s[-1])
    way_m = np.interp(after, time_s, signals.travel_m) - np.interp(before, time_s, signals.travel_m)
    return np.asarray(way_m / np.maximum(after - before, 1e-9))


def _windows(signals: DriveSignals, moving: Bool[np.ndarray, " record"]) -> Int[np.ndarray, " record"]:
    """Number of the window of each record, −1 for none: runs of moving records within the same stretch of way."""
    stretch = np.floor(signals.travel_m / WINDOW_M)
    fresh = (np.diff(stretch, prepend=np.nan) != 0.0) | (np.diff(signals.time_s, prepend=-np.inf) > 1.0)
    fresh |= moving & ~np.concatenate([[False], moving[:-1]])
    return np.where(moving, np.cumsum(fresh), -1)


def _means(
    signals: DriveSignals, volts: Float[np.ndarray, " record"], window: Int[np.ndarray, " record"]
) -> tuple[Float[np.ndarray, " window"], Float[np.ndarray, " window"], Float[np.ndarray, " window"]]:
    """Curvature, mean voltage and scatter of the voltage of every window with nearly complete travel."""
    found = []
    used = np.flatnonzero(window >= 0)
    for inside in np.split(used, np.flatnonzero(np.diff(window[used])) + 1):
        way = signals.travel_m[inside]
        if inside.size < 10 or np.ptp(way) < 0.8 * WINDOW_M:
            continue
        centred = way - np.mean(way)
        noise = median(np.abs(volts[inside] - median(volts[inside]))) / 0.6745
        found.append((centred @ signals.yaw_rad[inside] / (centred @ centred), clipped_mean(volts[inside]), noise))
    curvature, mean_v, noise_v = np.array(found).reshape(-1, 3).T
    return curvature, mean_v, noise_v


# Pauses of a steering wheel turned at standstill: their position, and the side of approach.

LEAST_PAUSE_S = 0.8
SETTLED_S = 0.2
JITTER_COUNTS = 2.0
LARGEST_SPEED_MPS = 0.1
LEAST_TURN = 0.01


class Pauses(NamedTuple):
    """Where the wheel was held.

    Attributes:
        time_s: middle of each pause.
        counts: encoder, mean.
        potentiometer_v: mean, spikes aside.
        direction: +1 where the counts rose before the pause, −1 where they fell.
    """

    time_s: Float[np.ndarray, " pause"]
    counts: Float[np.ndarray, " pause"]
    potentiometer_v: Float[np.ndarray, " pause"]
    direction: Float[np.ndarray, " pause"]


def find_pauses(signals: DriveSignals, what: str) -> Pauses:
    """Pauses at standstill, in order of time; the first, approached from an unknown side, is left out.

    Args:
        signals: of a log with encoder and potentiometer.
        what: is calibrated, for the error.

    Raises:
        NotExcitedError: encoder or potentiometer are missing, the vehicle did not stand, or the counts do not change.
    """
    if signals.encoder_counts is None or signals.potentiometer_v is None:
        missing = "encoder counts" if signals.encoder_counts is None else "potentiometer voltages"
        raise NotExcitedError(what, missing, "none in the log")
    counts, volts = signals.encoder_counts, signals.potentiometer_v
    usable = np.isfinite(counts) & np.isfinite(volts)
    standing = usable & (np.abs(speed_mps(signals)) < LARGEST_SPEED_MPS)
    if np.count_nonzero(standing) < 2:
        raise NotExcitedError(what, "a stationary vehicle", "a moving vehicle in every record")
    turned = float(np.ptp(counts[standing]))
    if turned < JITTER_COUNTS / LEAST_TURN:
        raise NotExcitedError(what, "a wheel turned at standstill", f"{turned:.0f} encoder counts")
    moved = np.abs(np.diff(counts, prepend=np.nan)) > JITTER_COUNTS
    late = np.diff(signals.time_s, prepend=-np.inf) > LEAST_PAUSE_S
    run = np.cumsum(moved | late | ~standing | ~np.concatenate([[False], standing[:-1]]))
    used = np.flatnonzero(standing)
    starts = np.flatnonzero(np.diff(run[used], prepend=-1))
    stops = np.append(starts[1:], used.size)
    found = []
    for start, stop in zip(starts, stops, strict=True):
        inside = used[start:stop]
        time_s = signals.time_s[inside]
        if time_s[-1] - time_s[0] < LEAST_PAUSE_S:
            continue
        held = inside[time_s >= time_s[0] + SETTLED_S]
        if held.size >= 5:
            found.append((signals.time_s[held].mean(), counts[held].mean(), clipped_mean(volts[held])))
    times, places, means = np.array(found).reshape(-1, 3).T
    change = np.diff(places)
    # A pause that a jump of a few counts cuts in two is still one place: it came from where the first part came from.
    arrived = np.abs(change) > LEAST_TURN * turned
    return Pauses(times[1:][arrived], places[1:][arrived], means[1:][arrived], np.sign(change)[arrived])


ENCODER_STUDY = "encoder against potentiometer"
LEAST_PAUSES = 8
LARGEST_DEGREE = 3
LARGEST_SCATTER = 0.05
_STEEPER_ROUNDS = 4


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
    pauses = find_pauses(signals, ENCODER_STUDY)
    rising, falling = np.count_nonzero(pauses.direction > 0), np.count_nonzero(pauses.direction < 0)
    if rising + falling < LEAST_PAUSES:
        raise NotExcitedError(
            ENCODER_STUDY, f"{LEAST_PAUSES} pauses of a wheel turned at standstill", f"{rising + falling}"
        )
    if min(rising, falling) < 3:
        raise NotExcitedError(ENCODER_STUDY, "three pauses or more from each side", f"{rising} and {falling}")
    if np.ptp(pauses.potentiometer_v) < 1e-9 * np.max(np.abs(pauses.potentiometer_v)):  # a mean is rounded
        raise NotExcitedError(
            ENCODER_STUDY, "a potentiometer voltage that follows the wheel", "one voltage at every pause"
        )
    centre, half = float(np.mean(pauses.counts)), 0.5 * float(np.ptp(pauses.counts))
    place = (pauses.counts - centre) / half
    curve, why = _choose_degree(place, pauses)
    if curve.fit.scale > LARGEST_SCATTER * abs(float(curve.fit.coefficients[1])):
        raise NotExcitedError(
            ENCODER_STUDY,
            "voltages proportional to the counts",
            f"a scatter of {curve.fit.scale:.3f} V over {np.ptp(pauses.potentiometer_v):.3f} V",
        )
    return _result(curve, why, centre, half, pauses, reference_v)


def potentiometer_of_counts(fit: EncoderFit, counts: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
    """Voltage at counts of the same start, in the middle of the play."""
    return np.asarray(np.polynomial.polynomial.polyval(counts - fit.reference_counts.value, fit.volts))


class _Curve(NamedTuple):
    """Voltage over the place, and the play.

    Attributes:
        fit: coefficients of the powers of the place, then the play as a voltage where the place is 0.
        design: rows of the pauses.
    """

    fit: RobustFit
    design: Float[np.ndarray, "pause coefficient"]


def _fit_curve(place: Float[np.ndarray, " pause"], pauses: Pauses, degree: int) -> _Curve:
    """Fit of a degree. The play is one number of counts: as a voltage it is larger where the curve is steeper."""
    steepness = np.ones(place.size)
    for _ in range(1 if degree == 1 else _STEEPER_ROUNDS):
        side = 0.5 * steepness * pauses.direction
        design = np.column_stack([np.vander(place, degree + 1, increasing=True), side])
        fit = robust_fit(design, pauses.potentiometer_v)
        slope = np.polynomial.Polynomial(fit.coefficients[:-1]).deriv()
        steepness = slope(place) / slope(0.0)
    return _Curve(fit, design)


def _choose_degree(place: Float[np.ndarray, " pause"], pauses: Pauses) -> tuple[_Curve, str]:
    """The highest degree whose last coefficient is beyond doubt (twice its 95 % interval), else the straight line."""
    for degree in range(LARGEST_DEGREE, 1, -1):
        if place.size < degree + 5:
            continue
        curve = _fit_curve(place, pauses, degree)
        fit = curve.fit
        last, sigma = float(fit.coefficients[degree]), float(np.sqrt(fit.covariance[degree, degree]))
        if abs(last) > 2.0 * student_95(fit.degrees) * sigma:
            return curve, f"polynomial of degree {degree}: a straight line is off by {abs(last):.4f} V at the ends"
    return _fit_curve(place, pauses, 1), "straight line: no evidence for a higher degree"


def _result(
    fitted: _Curve, why: str, centre: float, half: float, pauses: Pauses, reference_v: float | None
) -> EncoderFit:
    fit = fitted.fit
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
    steep = fit.coefficients[1] / half
    apart = -fit.coefficients[-1] / steep
    apart_row = np.append(np.zeros(degree + 1), -1.0 / steep)
    apart_row[1] = -apart / steep / half
    residual = pauses.potentiometer_v - fitted.design @ fit.coefficients
    kept = np.abs(residual[fit.weight > 0.0] / slope.value)
    return EncoderFit(
        counts_per_v=counts_per_v,
        reference_v=reference_v,
        reference_counts=estimate(centre + half * at, value.sigma / abs(slope.value), fit.degrees),
        hysteresis_counts=estimate(float(apart), float(np.sqrt(apart_row @ fit.covariance @ apart_row)), fit.degrees),
        volts=np.asarray(curve(np.polynomial.Polynomial([at, 1.0 / half])).coef),
        why=why,
        rms_counts=float(np.sqrt(np.mean(kept**2))),
        largest_counts=float(np.max(kept)),
        pauses=pauses,
        weight=fit.weight,
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
        raise NotExcitedError(
            ENCODER_STUDY, f"a wheel turned around the reference of {volts:.3f} V", "no such voltage near"
        )
    return float(near[np.argmin(np.abs(near))])


def fitted_volts(
    fit: EncoderFit, counts: Float[np.ndarray, " record"], direction: Float[np.ndarray, " record"]
) -> Float[np.ndarray, " record"]:
    """Voltage at counts reached in a direction (+1 rising): the middle of the play and half of it to either side."""
    return potentiometer_of_counts(fit, counts - 0.5 * direction * fit.hysteresis_counts.value)
