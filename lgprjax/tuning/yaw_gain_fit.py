"""The characteristic speed V of the yaw gain, from turning tests at several speeds.

G = (yaw rate) / (v κ) = 1 / (1 + (v/V)²), so that 1/G is a straight line in v². A wheel angle that is some per cent
wrong multiplies 1/G at all speeds alike, and one that is turned by a constant moves left and right turns apart: both
are fitted beside the slope, 1/V².
"""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from lgprjax.tuning.arcs import Arcs
from lgprjax.tuning.estimate import Estimate, NotExcitedError
from lgprjax.tuning.robust import estimate
from lgprjax.tuning.weighted import weighted_fit
from lgprjax.vehicle.chassis import Chassis, turn_of

_LEAST_TURN = 0.1
"""κL of a turn that is used."""
_LEAST_SPEEDS = 2.0
"""Fastest over slowest speed."""
_LEAST_TURNS = 6
_STEP_RAD = 0.01


class YawGainFit(NamedTuple):
    """What turning tests say of the yaw gain.

    Attributes:
        characteristic_speed_mps: V; its interval has no upper end where no loss at all would do as well.
        inverse_square_s2pm2: 1/V², whose interval is the symmetric one.
        scale: geometric over true curvature at no speed: 1 where the wheel angles are right.
        offset_rad: by which the front angles read too far to the left; 0 where all turns are to one side.
        speed_mps, gain, sigma_gain: of each stretch used.
        extra: scatter of 1/G beyond what the arcs explain.
    """

    characteristic_speed_mps: Estimate
    inverse_square_s2pm2: Estimate
    scale: Estimate
    offset_rad: float
    speed_mps: Float[np.ndarray, " stretch"]
    gain: Float[np.ndarray, " stretch"]
    sigma_gain: Float[np.ndarray, " stretch"]
    extra: float


def fit_yaw_gain(
    arcs: Arcs,
    chassis: Chassis,
    front_rad: Float[np.ndarray, " stretch"],
    sigma_front_rad: Float[np.ndarray, " stretch"],
) -> YawGainFit:
    """Fit V.

    Args:
        arcs: of turning tests.
        chassis: wheelbase and rear wheels; its characteristic speed is what is sought.
        front_rad, sigma_front_rad: front angle of each stretch, measured or by the steering map from the steering
            signal, and the standard error of it.

    Raises:
        NotExcitedError: too few turns, or speeds that span too little.
    """
    geometry = _geometry(chassis, front_rad)
    used = np.abs(geometry.bend) * float(chassis.wheelbase_m) >= _LEAST_TURN
    if used.sum() < _LEAST_TURNS:
        raise NotExcitedError("turning tests", f"{_LEAST_TURNS} turns or more", f"{used.sum()}")
    geometry = _Geometry(*(part[used] for part in geometry))
    curvature, front = arcs.curvature_radpm[used], front_rad[used]
    # The axle's path is bent by c = Gκ / √(1 + (G tan ψ)²).
    left = np.sqrt(np.maximum(geometry.bend**2 - (curvature * geometry.tangent) ** 2, 1e-12))
    gain, sigma_gain = np.abs(curvature) / left, arcs.sigma_radpm[used] * geometry.bend**2 / left**3
    sigma_gain = np.hypot(sigma_gain, gain * geometry.turned * sigma_front_rad[used])
    speed = arcs.speed_mps[used] / np.hypot(1.0, gain * geometry.tangent)
    if speed.max() < _LEAST_SPEEDS * speed.min():
        wanted = f"speeds of which the fastest is {_LEAST_SPEEDS:g} times the slowest"
        raise NotExcitedError("turning tests", wanted, f"{speed.min():.1f} to {speed.max():.1f} m/s")
    columns = [np.ones(len(speed)), speed**2]
    if front.min() < 0.0 < front.max():
        columns.append(geometry.turned / gain)
    fit = weighted_fit(np.stack(columns, axis=1), 1.0 / gain, sigma_gain / gain**2)
    scale, slope = fit.coefficients[:2]
    by_both = np.array([-slope / scale**2, 1.0 / scale])
    sigma = float(np.sqrt(by_both @ fit.covariance[:2, :2] @ by_both))
    inverse_square = estimate(float(slope / scale), sigma, fit.degrees)
    return YawGainFit(
        _speed(inverse_square),
        inverse_square,
        estimate(float(scale), float(np.sqrt(fit.covariance[0, 0])), fit.degrees),
        float(fit.coefficients[2] / scale) if len(columns) == 3 else 0.0,
        speed,
        gain,
        sigma_gain,
        fit.extra,
    )


class _Geometry(NamedTuple):
    """Curvature of the turn, tan ψ, and the share of the curvature that a radian of the front angle makes."""

    bend: Float[np.ndarray, " stretch"]
    tangent: Float[np.ndarray, " stretch"]
    turned: Float[np.ndarray, " stretch"]


def _geometry(chassis: Chassis, front_rad: Float[np.ndarray, " stretch"]) -> _Geometry:
    front = jnp.asarray(front_rad, jnp.float32)
    (low, _), (bend, tangent), (high, _) = (
        (np.asarray(part, np.float64) for part in turn_of(chassis, front + jnp.float32(away)))
        for away in (-_STEP_RAD, 0.0, _STEP_RAD)
    )
    return _Geometry(bend, tangent, (high - low) / (2.0 * _STEP_RAD * np.where(bend == 0.0, np.inf, bend)))


def _speed(inverse_square: Estimate) -> Estimate:
    """V of 1/V²: infinite where the latter is not above 0."""
    value, low, high = (
        number**-0.5 if number > 0.0 else float("inf")
        for number in (inverse_square.value, inverse_square.high, inverse_square.low)
    )
    sigma = 0.5 * value**3 * inverse_square.sigma if value < float("inf") else float("inf")
    return Estimate(value, sigma, low, high)
