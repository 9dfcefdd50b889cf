"""The measured rear angle over the front angle, and how far a model of it is off: k, or the linkage of LL eq. 4."""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from lgprjax.tuning.arcs import serial_memory
from lgprjax.tuning.estimate import NotExcitedError
from lgprjax.tuning.rear_ratio import wheel_angle_blocks
from lgprjax.tuning.robust import robust_fit, student_95
from lgprjax.vehicle.chassis import MeasuredRear, Rear, rear_angle
from lgprjax.vehicle.signals import DriveSignals

_LEAST_SPAN_RAD = 0.1


class RearMapFit(NamedTuple):
    """ψ(φ) of a log; the zeros of both sensors are taken for right.

    Attributes:
        rear: for a chassis.
        front_rad: of its knots.
        low_rad, high_rad: 95 % interval of ψ at the knots.
        scale_rad: scatter of the records' means about it.
    """

    rear: MeasuredRear
    front_rad: Float[np.ndarray, " knot"]
    low_rad: Float[np.ndarray, " knot"]
    high_rad: Float[np.ndarray, " knot"]
    scale_rad: float


class RearComparison(NamedTuple):
    """Two rear maps side by side.

    Attributes:
        front_rad: where they were compared.
        first_rad, second_rad: ψ of each.
        rms_rad, largest_rad: of their difference.
    """

    front_rad: Float[np.ndarray, " angle"]
    first_rad: Float[np.ndarray, " angle"]
    second_rad: Float[np.ndarray, " angle"]
    rms_rad: float
    largest_rad: float


def fit_rear_map(signals: DriveSignals, *, knots: int = 9) -> RearMapFit:
    """Fit ψ(φ), linear between evenly spaced knots, to measured front and rear angles.

    Args:
        signals: with both wheel angles, turned over the range that the map is to cover.
        knots: of the map.

    Raises:
        NotExcitedError: an angle is missing, the front wheels were hardly turned, or a knot has no records near it.
    """
    front, rear = wheel_angle_blocks(signals)
    if np.ptp(front) < _LEAST_SPAN_RAD:
        raise NotExcitedError("front_rad", f"angles over {_LEAST_SPAN_RAD} rad", f"over {np.ptp(front):.3f} rad")
    knot_rad = np.linspace(front.min(), front.max(), knots)
    step_rad = float(knot_rad[1] - knot_rad[0])
    hats = np.maximum(1.0 - np.abs(front[:, None] - knot_rad[None, :]) / step_rad, 0.0)
    few = np.flatnonzero(hats.sum(axis=0) < 1.0)
    if few.size:
        raise NotExcitedError(
            "front_rad", f"records near each of {knots} knots", f"none near {np.degrees(knot_rad[few[0]]):.1f}°"
        )
    fit = robust_fit(hats, -rear)
    limit = 3.0 * fit.scale
    clipped = np.clip(-rear - hats @ fit.coefficients, -limit, limit)[None]
    memory = serial_memory(clipped, np.ones(clipped.shape, dtype=bool), knots)
    half = student_95(fit.degrees) * np.sqrt(memory * np.diag(fit.covariance))
    measured = MeasuredRear(jnp.float32(knot_rad[0]), jnp.float32(step_rad), jnp.asarray(fit.coefficients, jnp.float32))
    return RearMapFit(measured, knot_rad, fit.coefficients - half, fit.coefficients + half, fit.scale)


def compare_rears(first: Rear, second: Rear, largest_rad: float) -> RearComparison:
    """Both over front angles to either side, and the difference."""
    front = jnp.linspace(-largest_rad, largest_rad, 121)
    one, other = (np.asarray(rear_angle(rear, front)[0], np.float64) for rear in (first, second))
    away = one - other
    return RearComparison(
        np.asarray(front, np.float64), one, other, float(np.sqrt(np.mean(away**2))), float(np.max(np.abs(away)))
    )
