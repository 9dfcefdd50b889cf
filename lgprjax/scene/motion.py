"""Where the vehicle and each of its antennas are at any time of a drive along a road: host, float64."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from lgprjax.radar.array import ArrayGeometry
from lgprjax.scene.road import Road, follow_centre, local_to_road, road_to_local, straight_road, surface_up
from lgprjax.scene.road_waves import Waves, draw_waves, roughness_value, wave_slope, wave_value

ARC_STEP_M = 0.02


@dataclass(frozen=True)
class DrivePlan:
    """How a drive is driven, in the road frame (``scene/road.py``).

    Attributes:
        start_m, stop_m: along-track interval of the body origin, start < stop.
        direction: +1 drives from start to stop, -1 from stop to start.
        speed_mps, scan_rate_hz: constant over the drive; the speed is that of the body origin along its path.
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


class Motion(NamedTuple):
    """A drive's course: everything ``poses_at`` needs."""

    plan: DrivePlan
    wander: Waves
    height: Waves
    roll: Waves
    arc_along_m: Float[np.ndarray, " node"]
    arc_length_m: Float[np.ndarray, " node"]
    road: Road

    @property
    def duration_s(self) -> float:
        """Time from one end to the other."""
        return float(self.arc_length_m[-1]) / self.plan.speed_mps


def plan_motion(plan: DrivePlan, seed: int, road: Road | None = None) -> Motion:
    """Draws wander and bounce from the seed and measures the path's length, slopes included.

    Args:
        road: the one driven along; None for a straight, flat, smooth one to the east.

    Raises:
        ValueError: start is not before stop, the direction is not +1 or -1, speed or scan rate is not positive,
            the drive leaves the road, or its lane passes beyond the centre of a curve.
    """
    if not plan.start_m < plan.stop_m:
        raise ValueError(f"start_m {plan.start_m} is not before stop_m {plan.stop_m}")
    if plan.direction not in (-1, 1):
        raise ValueError(f"direction is +1 or -1, not {plan.direction}")
    if not (plan.speed_mps > 0 and plan.scan_rate_hz > 0):
        raise ValueError(f"speed {plan.speed_mps} m/s and scan rate {plan.scan_rate_hz} Hz must be positive")
    if road is None:
        road = straight_road(max(plan.stop_m, 1.0))
    elif plan.start_m < road.along_m[0] or plan.stop_m > road.along_m[-1]:
        raise ValueError(f"the drive leaves the road, [{road.along_m[0]:.1f}, {road.along_m[-1]:.1f}] m along")
    rng = np.random.default_rng([seed, 2])
    wander = draw_waves(rng, plan.wander_m, plan.wander_wavelength_m)
    height = draw_waves(rng, plan.height_sigma_m, plan.bounce_wavelength_m)
    roll = draw_waves(rng, plan.roll_sigma_rad, plan.bounce_wavelength_m)
    nodes = max(2, int(np.ceil((plan.stop_m - plan.start_m) / ARC_STEP_M)) + 1)
    along = np.linspace(plan.start_m, plan.stop_m, nodes)
    middle = 0.5 * (along[1:] + along[:-1])
    forward = 1.0 - follow_centre(road, middle).curvature_per_m * (plan.lane_m + wave_value(wander, middle))
    if np.any(forward <= 0.0):
        raise ValueError(f"the lane at {plan.lane_m} m passes beyond the centre of a curve")
    rise = np.diff(surface_up(road, along, plan.lane_m + wave_value(wander, along))) / np.diff(along)
    stretch = np.hypot(np.hypot(forward, wave_slope(wander, middle)), rise)
    length = np.append(0.0, np.cumsum(stretch * np.diff(along)))
    return Motion(plan, wander, height, roll, along, length, road)


def scan_times(motion: Motion) -> Float[np.ndarray, " scan"]:
    """Each scan's own time: the first at 0, the last no later than the drive's end."""
    rate = motion.plan.scan_rate_hz
    return np.arange(int(np.floor(motion.duration_s * rate)) + 1) / rate


def place_on_road(
    motion: Motion, time_s: Float[np.ndarray, "*time"]
) -> tuple[Float[np.ndarray, "*time"], Float[np.ndarray, "*time"]]:
    """(along_m, cross_m) of the body origin."""
    plan = motion.plan
    run_m = plan.speed_mps * np.asarray(time_s)
    length_m = run_m if plan.direction > 0 else motion.arc_length_m[-1] - run_m
    along = np.interp(length_m, motion.arc_length_m, motion.arc_along_m)
    # A channel's own instant may fall just past the last node; the road goes on.
    beyond_m = np.minimum(length_m, 0.0) + np.maximum(length_m - motion.arc_length_m[-1], 0.0)
    along += beyond_m / (1.0 - follow_centre(motion.road, along).curvature_per_m * plan.lane_m)
    return along, plan.lane_m + wave_value(motion.wander, along)


def poses_at(motion: Motion, time_s: Float[np.ndarray, "*time"]) -> Float[np.ndarray, "*time 5"]:
    """The body origin's pose (east_m, north_m, height_m, yaw_rad, roll_rad).

    The body origin is the rear axle, which runs along its own heading: yaw is the path's tangent (of any branch).
    Height is that above the vehicle's place at rest on the road, which carries it up and down hills
    (``ground_up_at``); roll is the vehicle's own and the road's bank.
    """
    plan = motion.plan
    along, cross = place_on_road(motion, time_s)
    centre = follow_centre(motion.road, along)
    east, north, _ = road_to_local(motion.road, along, cross)
    slope = plan.direction * wave_slope(motion.wander, along)
    forward = plan.direction * (1.0 - centre.curvature_per_m * cross)
    yaw = centre.yaw_rad + np.arctan2(slope, forward)
    roll = plan.direction * (wave_value(motion.roll, along) + wave_value(motion.road.bank_rad, along))
    return np.stack([east, north, wave_value(motion.height, along), yaw, roll], axis=-1)


def ground_up_at(motion: Motion, time_s: Float[np.ndarray, "*time"]) -> Float[np.ndarray, "*time"]:
    """Height, above the road's start, of the ground below the body origin: what the ellipsoidal height adds up from."""
    return surface_up(motion.road, *place_on_road(motion, time_s))


def place_antennas(
    poses: Float[np.ndarray, "scan channel 5"], array: ArrayGeometry
) -> Float[np.ndarray, "scan channel 3"]:
    """(east_m, north_m, height) of each channel, given the body's pose at its instant.

    Height is h + y sin(roll) (docs/conventions.md): roll is positive right side down, so the left end rises. On a
    flat road it is that above the ground; ``antennas_on_road`` says it for any.
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


def antennas_on_road(
    motion: Motion, time_s: Float[np.ndarray, " scan"], array: ArrayGeometry
) -> Float[np.ndarray, "scan channel 3"]:
    """(along_m, cross_m, height above the ground) of each channel at its own instant, for the renderer.

    Each antenna is brought to the road by itself: ahead of the rear axle a curve leads away from under it. The
    vehicle stands on the road's plane, so grade and bank leave the height alone; the roughness below the antenna,
    the same on every drive and in both directions, does not.
    """
    instant_s = time_s[:, None] + array.time_offset_s[None]
    poses = poses_at(motion, instant_s)
    along, _ = place_on_road(motion, instant_s)
    antenna_m = place_antennas(poses, array)
    guess_m = along + motion.plan.direction * array.x_m[None]
    road_along, road_cross = local_to_road(motion.road, antenna_m[..., 0], antenna_m[..., 1], guess_m)
    bank = motion.plan.direction * wave_value(motion.road.bank_rad, along)
    height = array.height_m + poses[..., 2] + array.y_m[None] * np.sin(poses[..., 4] - bank)
    return np.stack(
        [road_along, road_cross, height - roughness_value(motion.road.roughness, road_along, road_cross)], -1
    )
