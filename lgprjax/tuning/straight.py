"""Calibration 1: what the potentiometer reads where the vehicle runs straight.

The drive is cut into windows of its way. Each gives a mean voltage and, by the heading over the way, a curvature; those
that turn are left out. The voltage at curvature zero is read off a robust line through the others, so that corrections
of the driver that do not cancel do no harm. Windows, not records, count for the interval: a driver's hand is slow.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from lgprjax.tuning.estimate import Estimate, NotExcitedError
from lgprjax.tuning.robust import clipped_mean, combine, median, robust_line
from lgprjax.vehicle.signals import DriveSignals

WHAT = "straight potentiometer value"
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
        raise NotExcitedError(WHAT, "potentiometer voltages", "none in the log")
    volts = signals.potentiometer_v
    usable = np.isfinite(volts) & np.isfinite(signals.yaw_rad) & np.isfinite(signals.travel_m)
    moving = usable & (np.abs(speed_mps(signals)) > LEAST_SPEED_MPS)
    way_m = float(np.ptp(signals.travel_m[moving])) if moving.any() else 0.0
    if way_m < LEAST_WINDOWS * WINDOW_M:
        raise NotExcitedError(WHAT, f"{LEAST_WINDOWS * WINDOW_M:.0f} m of driving or more", f"{way_m:.1f} m")
    if np.ptp(volts[moving]) == 0.0:
        raise NotExcitedError(WHAT, "a potentiometer that answers", f"{volts[moving][0]:.4f} V at every record")
    window = _windows(signals, moving)
    curvature, mean_v, noise_v = _means(signals, volts, window)
    if mean_v.size and np.median(noise_v) > LARGEST_NOISE_V:
        raise NotExcitedError(
            WHAT, f"records within {LARGEST_NOISE_V} V of each other", f"a scatter of {np.median(noise_v):.2f} V"
        )
    straight = np.abs(curvature) < LARGEST_CURVATURE_RADPM
    if np.count_nonzero(straight) < LEAST_WINDOWS:
        raise NotExcitedError(
            WHAT,
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
    """Curvature, mean voltage and scatter of the voltage of every window whose way is nearly whole."""
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
