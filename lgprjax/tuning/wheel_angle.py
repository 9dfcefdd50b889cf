"""Calibration 3, the palm tree: front wheel angle over the steering signal, from the arcs that it drove.

Each setting of the steering wheel is driven as an arc forward and back. Its curvature is that of the rear axle's path;
with wheelbase and k it gives the front angle. The intervals are those of the arcs: an error of k or of the wheelbase
is not in them (0.01 of k is 0.6 % of the angle).
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from lgprjax.tuning.arcs import Arcs
from lgprjax.tuning.axle_track import axle_track, front_of_curvature
from lgprjax.tuning.estimate import NotExcitedError
from lgprjax.tuning.robust import student_95
from lgprjax.tuning.weighted import weighted_fit
from lgprjax.vehicle.chassis import Chassis

_DEGREE = 3
_LEAST_SPAN = 0.2
"""Of the largest angle, on each side, that the settings must reach."""


class SteeringMap(NamedTuple):
    """Front angle as a polynomial of the steering signal, ``u = (signal - middle) / half_span``.

    Attributes:
        middle, half_span: of the signal over the settings driven, in its unit; the map is good within them.
        coefficients_rad: of 1, u, u², u³.
        covariance_rad2: of them.
        degrees: of freedom of the intervals.
    """

    middle: float
    half_span: float
    coefficients_rad: Float[np.ndarray, " coefficient"]
    covariance_rad2: Float[np.ndarray, "coefficient coefficient"]
    degrees: float


class WheelAngleFit(NamedTuple):
    """What a palm tree says of the steering.

    Attributes:
        map: front angle over the steering signal.
        steering: of each setting.
        front_rad, sigma_rad: angle that its arcs give, and the standard error of that.
        residual_rad: angle less map.
        extra_rad: scatter of the settings about the map beyond what the arcs explain: play, or a bend that the map has
            not.
        dropped: stretches left out, by reason.
    """

    map: SteeringMap
    steering: Float[np.ndarray, " setting"]
    front_rad: Float[np.ndarray, " setting"]
    sigma_rad: Float[np.ndarray, " setting"]
    residual_rad: Float[np.ndarray, " setting"]
    extra_rad: float
    dropped: dict[str, int]


def fit_wheel_angle(arcs: Arcs, chassis: Chassis) -> WheelAngleFit:
    """Fit the map from the steering signal to the front angle.

    Args:
        arcs: of a palm tree, driven slowly where the characteristic speed is not known.
        chassis: wheelbase, k or measured rear angles, largest angle, characteristic speed (infinite where unknown).

    Raises:
        NotExcitedError: too few settings, none to one side, or a map that does not rise or fall all along.
    """
    single, slope = front_of_curvature(axle_track(chassis, arcs.speed_mps), arcs.curvature_radpm)
    sigma = arcs.sigma_radpm * slope
    steering, sigma_steering, front, sigma = mean_of_settings(arcs, single, sigma)
    largest = float(chassis.largest_angle_rad)
    if front.min() > -_LEAST_SPAN * largest or front.max() < _LEAST_SPAN * largest:
        degrees = np.degrees(_LEAST_SPAN * largest)
        found = f"{np.degrees(front.min()):.1f}° to {np.degrees(front.max()):.1f}°"
        raise NotExcitedError("palm tree", f"turns beyond {degrees:.1f}° to either side", found)
    middle, half = 0.5 * float(steering.max() + steering.min()), 0.5 * float(np.ptp(steering))
    u = (steering - middle) / half
    # On long arcs the noise of the steering signal is the larger one.
    per_unit = (front[-1] - front[0]) / (steering[-1] - steering[0])
    sigma = np.hypot(sigma, per_unit * sigma_steering)
    fit = weighted_fit(np.vander(u, _DEGREE + 1, increasing=True), front, sigma)
    rise = np.diff(np.vander(np.linspace(-1.0, 1.0, 101), _DEGREE + 1, increasing=True) @ fit.coefficients)
    if not (np.all(rise > 0.0) or np.all(rise < 0.0)):
        raise NotExcitedError("palm tree", "an angle that rises or falls with the steering all along", "one that turns")
    found_map = SteeringMap(middle, half, fit.coefficients, fit.covariance, fit.degrees)
    return WheelAngleFit(found_map, steering, front, sigma, fit.residual, fit.extra, arcs.stretches.dropped)


def front_angle(steering_map: SteeringMap, steering: Float[np.ndarray, " record"]) -> Float[np.ndarray, " record"]:
    """Front angle at values of the steering signal."""
    front: Float[np.ndarray, " record"] = _rows(steering_map, steering) @ steering_map.coefficients_rad
    return front


def front_band(
    steering_map: SteeringMap, steering: Float[np.ndarray, " record"]
) -> tuple[Float[np.ndarray, " record"], Float[np.ndarray, " record"]]:
    """95 % interval of the front angle at each value of the steering signal, low and high."""
    rows = _rows(steering_map, steering)
    sigma = np.sqrt(np.einsum("rc,cd,rd->r", rows, steering_map.covariance_rad2, rows))
    middle, half = rows @ steering_map.coefficients_rad, student_95(steering_map.degrees) * sigma
    return middle - half, middle + half


def front_of_stretches(
    steering_map: SteeringMap, arcs: Arcs
) -> tuple[Float[np.ndarray, " stretch"], Float[np.ndarray, " stretch"]]:
    """Front angle of each stretch by the map, and its standard error by the noise of the steering signal alone."""
    held = arcs.stretches
    front, ahead = (front_angle(steering_map, held.steering + step) for step in (0.0, held.sigma_steering))
    return front, np.abs(ahead - front)


def mean_of_settings(
    arcs: Arcs, value: Float[np.ndarray, " stretch"], sigma: Float[np.ndarray, " stretch"]
) -> tuple[
    Float[np.ndarray, " setting"],
    Float[np.ndarray, " setting"],
    Float[np.ndarray, " setting"],
    Float[np.ndarray, " setting"],
]:
    """Steering signal and a value of the arcs, each with its standard error: weighted means of each setting."""
    setting = np.unique(arcs.stretches.setting, return_inverse=True)[1]
    precision = 1.0 / sigma**2
    total = np.bincount(setting, precision)
    steering = np.bincount(setting, precision * arcs.stretches.steering) / total
    sigma_steering = np.sqrt(np.bincount(setting, (precision * arcs.stretches.sigma_steering) ** 2)) / total
    return steering, sigma_steering, np.bincount(setting, precision * value) / total, 1.0 / np.sqrt(total)


def _rows(steering_map: SteeringMap, steering: Float[np.ndarray, " record"]) -> Float[np.ndarray, "record coefficient"]:
    at = (steering - steering_map.middle) / steering_map.half_span
    return np.vander(at, len(steering_map.coefficients_rad), increasing=True)
