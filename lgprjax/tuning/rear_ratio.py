"""Calibration 4: k, the rear wheels' share of the front angle, by heading or by two measured wheel angles.

The curvature of a turn gives (1 + k) φ and no more. What tells k is where the turn's centre lies along the body, x_c:
the rear axle moves at −ψ to the body, ψ = kφ, so that the direction of its path less the INS heading, over the
curvature, is −x_c, which tends to −kL / (1 + k). An INS that is mounted askew adds a constant; left turns and right
turns tell it from k. The other way is to measure both wheel angles.
"""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

from lgprjax.tuning.arcs import Arcs
from lgprjax.tuning.axle_track import axle_track, front_of_curvature
from lgprjax.tuning.drifting import drifting_fit
from lgprjax.tuning.estimate import Estimate, NotExcitedError
from lgprjax.tuning.robust import combine, estimate, robust_line
from lgprjax.vehicle.chassis import Chassis, ProportionalRear
from lgprjax.vehicle.signals import DriveSignals

_ONLY_CURVATURE = "turns alone, whose curvature gives only (1 + k) φ"
_LEAST_TURN = 0.1
"""κL that turns to either side must reach, and rad that measured front angles must span."""
_LARGEST_MISALIGNMENT_RAD = 0.5
_ROUNDS = 3
_STEP = 0.01
_BLOCK_S = 1.0


class RearRatioFit(NamedTuple):
    """k of a drive.

    Attributes:
        ratio: k.
        offset_rad: what the fit had to take off: by heading, how far INS headings are turned against the body's, to the
            left; by wheel angles, the rear angle where the front one is 0.
        drift_rad: of the headings, beside their white noise; 0 by wheel angles.
        numbers: stretches, or blocks of records, that the fit used.
    """

    ratio: Estimate
    offset_rad: Estimate
    drift_rad: float
    numbers: int


def rear_ratio_by_heading(arcs: Arcs, chassis: Chassis) -> RearRatioFit:
    """k from the arcs of a palm tree or of turning tests.

    Args:
        arcs: with headings.
        chassis: wheelbase, largest angle and characteristic speed; its rear wheels are what is sought.

    Raises:
        NotExcitedError: there are no headings, or headings of the motion; no turns to one side; too few stretches.
    """
    known = np.isfinite(arcs.slip_rad)
    if not known.any():
        raise NotExcitedError("k", "INS headings beside positions, or both wheel angles", _ONLY_CURVATURE)
    if np.any(np.abs(arcs.slip_rad[known]) > _LARGEST_MISALIGNMENT_RAD + float(chassis.largest_angle_rad)):
        raise NotExcitedError("INS heading", "that of the body", "one far off it, or that of the motion")
    bend = arcs.curvature_radpm * float(chassis.wheelbase_m)
    if bend[known].max() < _LEAST_TURN or bend[known].min() > -_LEAST_TURN:
        wanted = f"turns of {_LEAST_TURN / float(chassis.wheelbase_m):.3f} rad/m to either side"
        found = f"{arcs.curvature_radpm[known].min():.3f} to {arcs.curvature_radpm[known].max():.3f} rad/m"
        raise NotExcitedError("k", wanted, found)
    ratio = 0.5
    for step in range(_ROUNDS):
        model, ahead = (_slip_model(arcs, chassis, k, known) for k in (ratio, ratio + _STEP))
        # An error of the curvature, too, moves the slip that k foretells.
        lever_m = np.abs(model) / np.maximum(np.abs(arcs.curvature_radpm[known]), 1e-6)
        sigma = np.hypot(arcs.sigma_slip_rad[known], lever_m * arcs.sigma_radpm[known])
        design = np.stack([np.ones(len(model)), (ahead - model) / _STEP], axis=1)
        left = arcs.slip_rad[known] - model
        if step < _ROUNDS - 1:
            ratio += float(np.linalg.lstsq(design / sigma[:, None], left / sigma, rcond=None)[0][1])
            ratio = float(np.clip(ratio, 0.0, 2.0))
    # A drift shows within the stretches too: their headings remember.
    fit = drifting_fit(design, left, sigma, arcs.time_s[known], drift_seen=arcs.heading_memory > 1.0)
    ratio += float(fit.coefficients[1])
    sigma_offset, sigma_ratio = np.sqrt(np.diag(fit.covariance))
    return RearRatioFit(
        estimate(ratio, float(sigma_ratio), fit.degrees),
        estimate(-float(fit.coefficients[0]), float(sigma_offset), fit.degrees),
        fit.drift,
        len(left),
    )


def rear_ratio_by_angles(signals: DriveSignals) -> RearRatioFit:
    """k from measured front and rear wheel angles, moving or standing still.

    Raises:
        NotExcitedError: an angle is missing, the front wheels were hardly turned, or too few records.
    """
    front, rear = wheel_angle_blocks(signals)
    if np.ptp(front) < _LEAST_TURN:
        raise NotExcitedError("front_rad", f"angles over {_LEAST_TURN} rad", f"over {np.ptp(front):.3f} rad")
    fit = robust_line(front, rear, serial=True)
    offset, slope = combine(fit, np.array([1.0, 0.0])), combine(fit, np.array([0.0, 1.0]))
    ratio = Estimate(-slope.value, slope.sigma, -slope.high, -slope.low)
    return RearRatioFit(ratio, offset, 0.0, len(front))


def wheel_angle_blocks(
    signals: DriveSignals,
) -> tuple[Float[np.ndarray, " block"], Float[np.ndarray, " block"]]:
    """Means of measured front and rear angles over a second each: noise of the front angle would flatten the line.

    Raises:
        NotExcitedError: an angle is missing.
    """
    if signals.front_rad is None or signals.rear_rad is None:
        raise NotExcitedError("k", "both wheel angles, or INS headings beside positions", _ONLY_CURVATURE)
    known = np.isfinite(signals.front_rad + signals.rear_rad)
    if not known.any():
        raise NotExcitedError("k", "records with both wheel angles", "none")
    block = np.floor((signals.time_s[known] - signals.time_s[0]) / _BLOCK_S)
    start = np.concatenate([[0], np.flatnonzero(np.diff(block)) + 1])
    count = np.diff(np.append(start, len(block)))
    front, rear = (np.add.reduceat(angle[known], start) / count for angle in (signals.front_rad, signals.rear_rad))
    full = count >= 0.5 * np.median(count)
    return front[full], rear[full]


def _slip_model(
    arcs: Arcs, chassis: Chassis, ratio: float, known: Bool[np.ndarray, " stretch"]
) -> Float[np.ndarray, " known"]:
    """Direction of the rear axle's path to the body, at the curvatures measured, were k this."""
    trial = chassis._replace(rear=ProportionalRear(jnp.float32(ratio)))
    track = axle_track(trial, arcs.speed_mps[known])
    front, _ = front_of_curvature(track, arcs.curvature_radpm[known])
    rows = zip(front, track.slip_rad, strict=True)
    return np.array([np.interp(angle, track.front_rad, slip) for angle, slip in rows])
