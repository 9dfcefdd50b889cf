"""Where the vehicle and each of its antennas are at any time of a drive: host, float64, closed form."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from lgprjax.radar.array import ArrayGeometry

ARC_STEP_M = 0.02


@dataclass(frozen=True)
class DrivePlan:
    """How a drive is driven, in the road frame (along = east, cross = north).

    Attributes:
        start_m, stop_m: along-track interval of the body origin, start < stop.
        direction: +1 drives from start to stop (yaw about 0), -1 from stop to start (yaw about pi).
        speed_mps, scan_rate_hz: constant over the drive.
        lane_m: mean cross-track place of the body origin, positive to the left of a vehicle driving +1.
        wander_m, wander_wavelength_m: rms of the lateral wander about the lane and its range of wavelengths.
        height_sigma_m, roll_sigma_rad, bounce_wavelength_m: smooth motion of the body on its springs.
    """

    start_m: float
    stop_m: float
    direction: int = 1
    speed_mps: float = 4.5
    scan_rate_hz: float = 126.0
    lane_m: float = 0.0
    wander_m: float = 0.03
    wander_wavelength_m: tuple[float, float] = (8.0, 40.0)
    height_sigma_m: float = 0.01
    roll_sigma_rad: float = 0.3 * np.pi / 180
    bounce_wavelength_m: tuple[float, float] = (3.0, 20.0)


class Waves(NamedTuple):
    """A smooth random function of the along-track place."""

    amplitude: Float[np.ndarray, " wave"]
    wave_rad_per_m: Float[np.ndarray, " wave"]
    phase_rad: Float[np.ndarray, " wave"]


class Motion(NamedTuple):
    """A drive's course: everything ``poses_at`` needs."""

    plan: DrivePlan
    wander: Waves
    height: Waves
    roll: Waves
    arc_along_m: Float[np.ndarray, " node"]
    arc_length_m: Float[np.ndarray, " node"]

    @property
    def duration_s(self) -> float:
        """Time from one end to the other."""
        return float(self.arc_length_m[-1]) / self.plan.speed_mps


def plan_motion(plan: DrivePlan, seed: int) -> Motion:
    """Draws wander and bounce from the seed and measures the path's length.

    Raises:
        ValueError: start is not before stop, the direction is not +1 or -1, or speed or scan rate is not
            positive.
    """
    if not plan.start_m < plan.stop_m:
        raise ValueError(f"start_m {plan.start_m} is not before stop_m {plan.stop_m}")
    if plan.direction not in (-1, 1):
        raise ValueError(f"direction is +1 or -1, not {plan.direction}")
    if not (plan.speed_mps > 0 and plan.scan_rate_hz > 0):
        raise ValueError(f"speed {plan.speed_mps} m/s and scan rate {plan.scan_rate_hz} Hz must be positive")
    rng = np.random.default_rng([seed, 2])
    wander = _draw_waves(rng, plan.wander_m, plan.wander_wavelength_m)
    height = _draw_waves(rng, plan.height_sigma_m, plan.bounce_wavelength_m)
    roll = _draw_waves(rng, plan.roll_sigma_rad, plan.bounce_wavelength_m)
    nodes = max(2, int(np.ceil((plan.stop_m - plan.start_m) / ARC_STEP_M)) + 1)
    along = np.linspace(plan.start_m, plan.stop_m, nodes)
    stretch = np.hypot(1.0, _slope(wander, 0.5 * (along[1:] + along[:-1])))
    return Motion(plan, wander, height, roll, along, np.append(0.0, np.cumsum(stretch * np.diff(along))))


def scan_times(motion: Motion) -> Float[np.ndarray, " scan"]:
    """Each scan's own time: the first at 0, the last no later than the drive's end."""
    rate = motion.plan.scan_rate_hz
    return np.arange(int(np.floor(motion.duration_s * rate)) + 1) / rate


def poses_at(motion: Motion, time_s: Float[np.ndarray, "*time"]) -> Float[np.ndarray, "*time 5"]:
    """The body origin's pose (east_m, north_m, height_m, yaw_rad, roll_rad), height above its place at rest.

    The body origin is the rear axle, which runs along its own heading: yaw is the path's tangent.
    """
    plan = motion.plan
    run_m = plan.speed_mps * np.asarray(time_s)
    length_m = run_m if plan.direction > 0 else motion.arc_length_m[-1] - run_m
    along = np.interp(length_m, motion.arc_length_m, motion.arc_along_m)
    # A channel's own instant may fall just past the last node; the road goes on.
    along += np.minimum(length_m, 0.0) + np.maximum(length_m - motion.arc_length_m[-1], 0.0)
    slope = plan.direction * _slope(motion.wander, along)
    yaw = np.arctan2(slope, plan.direction * np.ones_like(slope))
    roll = plan.direction * _value(motion.roll, along)
    north = plan.lane_m + _value(motion.wander, along)
    return np.stack([along, north, _value(motion.height, along), yaw, roll], axis=-1)


def place_antennas(
    poses: Float[np.ndarray, "scan channel 5"], array: ArrayGeometry
) -> Float[np.ndarray, "scan channel 3"]:
    """(east_m, north_m, height above the ground) of each channel, given the body's pose at its instant.

    Height is h + y sin(roll) (docs/conventions.md): roll is positive right side down, so the left end rises.
    """
    east, north, height, yaw, roll = np.moveaxis(poses, -1, 0)
    x_m, y_m = array.x_m[None], array.y_m[None] * np.cos(roll)
    return np.stack(
        [
            east + x_m * np.cos(yaw) - y_m * np.sin(yaw),
            north + x_m * np.sin(yaw) + y_m * np.cos(yaw),
            array.height_m + height + array.y_m[None] * np.sin(roll),
        ],
        axis=-1,
    )


def _draw_waves(rng: np.random.Generator, rms: float, wavelength_m: tuple[float, float], waves: int = 8) -> Waves:
    low, high = np.log(wavelength_m)
    bands = low + (high - low) * (np.arange(waves) + rng.uniform(size=waves)) / waves
    phase = rng.uniform(0.0, 2 * np.pi, waves)
    return Waves(np.full(waves, rms * np.sqrt(2 / waves)), 2 * np.pi / np.exp(bands), phase)


def _value(waves: Waves, along_m: Float[np.ndarray, "*time"]) -> Float[np.ndarray, "*time"]:
    angle = along_m[..., None] * waves.wave_rad_per_m + waves.phase_rad
    return np.asarray(np.sin(angle) @ waves.amplitude)


def _slope(waves: Waves, along_m: Float[np.ndarray, "*time"]) -> Float[np.ndarray, "*time"]:
    angle = along_m[..., None] * waves.wave_rad_per_m + waves.phase_rad
    return np.asarray(np.cos(angle) @ (waves.amplitude * waves.wave_rad_per_m))
