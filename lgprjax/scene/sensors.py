"""What the vehicle's own navigation says of a drive: odometer, and a GNSS/INS track with slow errors."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from lgprjax.scene.motion import Motion, poses_at


@dataclass(frozen=True)
class NavigationErrors:
    """Errors of the navigation sensors.

    Attributes:
        rate_hz: of both tracks.
        position_sigma_m, position_bias_m: of east and of north; the bias (east, north) stays for the drive.
        height_sigma_m, heading_sigma_rad, roll_sigma_rad: of the other components.
        correlation_s: time constant of all of them: first-order Gauss-Markov, exp(-t / correlation).
        odometer_scale_error, odometer_noise_m: distance reads (1 + scale) times the truth plus white noise.
    """

    rate_hz: float = 100.0
    position_sigma_m: float = 0.05
    position_bias_m: tuple[float, float] = (0.0, 0.0)
    height_sigma_m: float = 0.05
    heading_sigma_rad: float = 0.3 * np.pi / 180
    roll_sigma_rad: float = 0.1 * np.pi / 180
    correlation_s: float = 20.0
    odometer_scale_error: float = 0.005
    odometer_noise_m: float = 0.002


class OdometerTrack(NamedTuple):
    """Distance run since the start, from the wheels."""

    time_s: Float[np.ndarray, " time"]
    distance_m: Float[np.ndarray, " time"]


class PoseTrack(NamedTuple):
    """Poses of the body origin (east_m, north_m, height_m, yaw_rad, roll_rad)."""

    time_s: Float[np.ndarray, " time"]
    pose: Float[np.ndarray, "time 5"]


def observe_drive(motion: Motion, errors: NavigationErrors, seed: int) -> tuple[OdometerTrack, PoseTrack]:
    """Odometer and GNSS/INS over the drive and one sample past its end: every scan lies between samples."""
    rng = np.random.default_rng([seed, 3])
    time_s = np.arange(int(np.ceil(motion.duration_s * errors.rate_hz)) + 2) / errors.rate_hz
    noise_m = errors.odometer_noise_m * rng.normal(size=time_s.size)
    noise_m[0] = 0.0  # the odometer is set to zero at the start
    distance_m = motion.plan.speed_mps * time_s * (1 + errors.odometer_scale_error) + noise_m
    position = errors.position_sigma_m
    sigma = [position, position, errors.height_sigma_m, errors.heading_sigma_rad, errors.roll_sigma_rad]
    keep = float(np.exp(-1.0 / (errors.rate_hz * errors.correlation_s)))
    wrong = gauss_markov(rng, np.asarray(sigma), keep, time_s.size)
    wrong[:, :2] += np.asarray(errors.position_bias_m)
    return OdometerTrack(time_s, distance_m), PoseTrack(time_s, poses_at(motion, time_s) + wrong)


def gauss_markov(
    rng: np.random.Generator, sigma: Float[np.ndarray, " state"], keep: float, steps: int
) -> Float[np.ndarray, "step state"]:
    """Stationary first-order Gauss-Markov process: x' = keep x + sqrt(1 - keep**2) sigma w."""
    value: Float[np.ndarray, "step state"] = rng.normal(size=(steps, sigma.size)) * sigma
    value[1:] *= np.sqrt(1 - keep**2)
    for step in range(1, steps):
        value[step] += keep * value[step - 1]
    return value
