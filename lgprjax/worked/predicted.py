"""Predicted uncertainty of the tool's position, and the overlap and border that a confidence requires."""

import math
from statistics import NormalDist
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from lgprjax.coverage import Tool
from lgprjax.errors import ArgumentError
from lgprjax.navigation import (
    SkidFilterState,
    SkidModel,
    SkidMotion,
    SkidObservations,
    init_skid_filter,
    skid_rules,
    step_skid_filter,
)
from lgprjax.navigation.observations import GnssObservation
from lgprjax.navigation.skid_model import DeltaHeading, skid_pose_covariance
from lgprjax.worked.evidence import UNCHECKED_SIGMA_M

_STEP_S = 0.1
_SETTLED_S = 120.0
_LONGEST_OFF_S = 180.0
_GNSS_SIGMA_M = 0.02
TRACKING_M = 0.05
"""Assumed distance of the tool from its line. In closed loop the simulated flail kept 2 cm RMS, and 11 cm at most on
short ways in reverse."""


class PredictedWidth(NamedTuple):
    """Predicted useful width of a pass.

    Attributes:
        sigma_m: largest standard deviation of the tool across its line.
        overlap: least overlap of neighbouring swaths, as a share of the tool's width.
        border_m: least distance of the tool's edge outside the border.
    """

    sigma_m: float
    overlap: float
    border_m: float


def predicted_width(
    model: SkidModel,
    tool: Tool,
    *,
    confidence: float,
    drop_out_s: float,
    speed_mps: float,
    shared_sigma_m: float = UNCHECKED_SIGMA_M,
) -> PredictedWidth:
    """Overlap and border from the covariance of the onboard filter.

    A place at offset e from the middle of the tool's pass counts where Φ((h − e)/σ) − Φ((−h − e)/σ) ≥ p: for a half
    width h well above σ, |e| ≤ h − z σ. The tracking error is subtracted as well.

    Args:
        model: model of vehicle and sensors.
        tool: tool of the vehicle.
        confidence: probability p, above 0.5 and below 1.
        drop_out_s: longest GNSS outage to allow for.
        speed_mps: working speed.
        shared_sigma_m: standard deviation per axis of the error shared by all positions; the record adds it as well.

    Raises:
        ArgumentError: a number is out of range, or the errors leave nothing of the tool's width.
    """
    if not 0.5 < confidence < 1.0:
        raise ArgumentError("confidence", "above 0.5 and below 1", f"{confidence:g}")
    if not 0.0 <= drop_out_s <= _LONGEST_OFF_S:
        raise ArgumentError("drop_out_s", f"0 to {_LONGEST_OFF_S:g}", f"{drop_out_s:g}")
    sigma_m = math.hypot(_sigma_m(model, tool, drop_out_s, speed_mps), shared_sigma_m)
    margin_m = NormalDist().inv_cdf(confidence) * sigma_m + TRACKING_M
    if 2.0 * margin_m > 0.8 * tool.width_m:
        expected = f"errors that leave at least a fifth of the tool width, {tool.width_m:g} m"
        raise ArgumentError("drop_out_s", expected, f"{sigma_m:.2f} m across after {drop_out_s:g} s")
    return PredictedWidth(sigma_m, 2.0 * margin_m / tool.width_m, margin_m)


def _sigma_m(model: SkidModel, tool: Tool, drop_out_s: float, speed_mps: float) -> float:
    """Largest standard deviation of the tool across a straight line: fixes once a second, then none."""
    settled, off = round(_SETTLED_S / _STEP_S), round(drop_out_s / _STEP_S)
    steps = settled + round(_LONGEST_OFF_S / _STEP_S)
    across = np.asarray(_variances(model, jnp.float32(speed_mps), jnp.int32(settled), steps), np.float64)
    ahead = tool.ahead_m
    variance = across[:, 0] + 2.0 * ahead * across[:, 1] + ahead * ahead * across[:, 2]
    # Sigma grows between two fixes as well.
    return float(np.sqrt(variance[settled - round(1.0 / _STEP_S) : settled + off + 1].max()))


def _variances(
    model: SkidModel, speed_mps: Float[Array, ""], settled: Int[Array, ""], steps: int
) -> Float[Array, "step 3"]:
    zero = jnp.float32(0.0)
    rules = skid_rules()

    def step(state: SkidFilterState, number: Array) -> tuple[SkidFilterState, Array]:
        x = speed_mps * _STEP_S * (number + 1).astype(jnp.float32)
        fix = GnssObservation(
            x + model.gnss_x_m,
            zero + model.gnss_y_m,
            _GNSS_SIGMA_M**2 * jnp.eye(2, dtype=jnp.float32),
            zero,
            (number % 10 == 9) & (number < settled),
        )
        turn = DeltaHeading(zero, jnp.float32(_STEP_S), jnp.asarray(True))
        motion = SkidMotion(speed_mps, speed_mps, jnp.float32(_STEP_S))
        state, _ = step_skid_filter(model, rules, state, motion, SkidObservations(fix, turn))
        covariance = skid_pose_covariance(state.estimate)
        return state, jnp.stack([covariance[1, 1], covariance[1, 2], covariance[2, 2]])

    begun = init_skid_filter(model, zero, zero)
    across: Float[Array, "step 3"] = jax.jit(lambda: jax.lax.scan(step, begun, jnp.arange(steps))[1])()
    return across
