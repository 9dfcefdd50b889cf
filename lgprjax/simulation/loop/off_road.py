"""An off-road course made from a seed: curves, slopes, ruts, its ground, and the baseline drive that maps it."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from lgprjax.frames import LocalFrame
from lgprjax.radar import ArrayGeometry, uniform_array
from lgprjax.scene import (
    WEATHER,
    DrivePlan,
    Ground,
    GroundConfig,
    NavigationErrors,
    Road,
    RoadConfig,
    SweepPlan,
    Terrain,
    make_ground,
    make_road,
    simulate_drive,
)
from lgprjax.scene.motion import plan_motion, poses_at, scan_times
from lgprjax.scene.road import Waves, draw_waves, follow_centre
from lgprjax.simulation.drives import SITE_FRAME, write_drive

MILE_M = 1609.344
MPH_MPS = 0.44704
SCAN_HZ = 126.0
_APART_M = 15.0  # between stretches of the road that are not neighbours
_NEIGHBOURS_M = 60.0
_SURVEY = NavigationErrors(position_sigma_m=0.01, heading_sigma_rad=float(np.radians(0.1)))


@dataclass(frozen=True)
class OffRoad:
    """An off-road course. Bends, slopes and roughness are invented, of the size of a cross-country track.

    Attributes:
        seed: seed of all draws.
        length_m: length to be driven.
        scan_share: divisor of the 126 scans per second that are recorded, on the baseline too.
        array_x_m: centre of the array ahead of the rear axle.
        sweeps: sweep plan of a stepped-frequency radar, on the baseline too; ``None`` for a radar that records traces.
    """

    seed: int
    length_m: float = MILE_M
    scan_share: int = 1
    array_x_m: float = 6.2
    sweeps: SweepPlan | None = None

    @property
    def scan_hz(self) -> float:
        """Recorded scans per second."""
        return SCAN_HZ / self.scan_share


class Bare(NamedTuple):
    """A course without its ground: its effect on a vehicle.

    Attributes:
        spec: specification of the course.
        road: road in plan and profile.
        terrain: effect of the course on vehicles.
    """

    spec: OffRoad
    road: Road
    terrain: Terrain


class Laid(NamedTuple):
    """A course with its ground, without a recorded baseline.

    Attributes:
        spec, road, terrain: as in ``Bare``.
        ground: ground under the road.
        array: antenna array of the vehicles.
        plan: plan of the baseline, and spring motion of the vehicles.
    """

    spec: OffRoad
    road: Road
    terrain: Terrain
    ground: Ground
    array: ArrayGeometry
    plan: DrivePlan


class OffRoadCourse(NamedTuple):
    """A course with its ground, and its baseline with the true positions.

    Attributes:
        spec, road, terrain: as in ``Bare``.
        ground: ground under the road.
        array: antenna array of the vehicles.
        plan: plan of the baseline, and spring motion of the vehicles.
        baseline: path of the baseline's drive log.
        anchor_m: true positions of the array's centre on the baseline, in the scene's frame, one per scan.
    """

    spec: OffRoad
    road: Road
    terrain: Terrain
    ground: Ground
    array: ArrayGeometry
    plan: DrivePlan
    baseline: Path
    anchor_m: Float[np.ndarray, "scan 2"]


class SceneFrame(NamedTuple):
    """The map's level frame in the scene's: both are tangent planes a few metres apart."""

    origin_m: Float[np.ndarray, "2"]
    turn_rad: float

    def to_scene(self, place_m: Float[np.ndarray, "*place 2"]) -> Float[np.ndarray, "*place 2"]:
        """Places of the map's frame in the scene's."""
        cos, sin = np.cos(self.turn_rad), np.sin(self.turn_rad)
        return np.asarray(place_m @ np.array([[cos, sin], [-sin, cos]]) + self.origin_m)

    def to_map(self, place_m: Float[np.ndarray, "*place 2"]) -> Float[np.ndarray, "*place 2"]:
        """Places of the scene's frame in the map's."""
        cos, sin = np.cos(self.turn_rad), np.sin(self.turn_rad)
        return np.asarray((place_m - self.origin_m) @ np.array([[cos, -sin], [sin, cos]]))


def draw_course(spec: OffRoad) -> Bare:
    """Draw the road and its effect on vehicles."""
    road = _clear_road(spec)
    rng = np.random.default_rng([spec.seed, 21])
    grade = road.grade_m
    terrain = Terrain(
        # The road's height is a sum of sines; its slope is one too, a quarter of a wave on.
        _float32(Waves(grade.amplitude * grade.wave_rad_per_m, grade.wave_rad_per_m, grade.phase_rad + np.pi / 2)),
        _float32(road.bank_rad),
        _float32(draw_waves(rng, 0.003, (2.0, 15.0))),
        jnp.float32(1.0),
    )
    return Bare(spec, road, terrain)


def lay_course(spec: OffRoad) -> Laid:
    """Draw a course with its ground, and plan its baseline drive."""
    bare = draw_course(spec)
    ground = make_ground(spec.seed, GroundConfig(length_m=spec.length_m + 40.0))
    array = uniform_array(11, 0.127, x_m=spec.array_x_m, height_m=0.3, scan_period_s=1.0 / SCAN_HZ)
    plan = DrivePlan(
        start_m=0.0,
        stop_m=spec.length_m + 30.0,
        speed_mps=10.0 * MPH_MPS,
        scan_rate_hz=spec.scan_hz,
        wander_m=0.10,
        wander_wavelength_m=(20.0, 80.0),
        height_sigma_m=0.015,
        roll_sigma_rad=float(np.radians(0.8)),
    )
    return Laid(*bare, ground, array, plan)


def baseline_poses(laid: Laid) -> Float[np.ndarray, "scan 5"]:
    """True poses of the baseline: the rear axle in the scene's frame at every scan, including lost ones."""
    motion = plan_motion(laid.plan, laid.spec.seed, laid.road)
    return poses_at(motion, scan_times(motion))


def anchor_of(poses: Float[np.ndarray, "scan 5"], array_x_m: float) -> Float[np.ndarray, "scan 2"]:
    """The array's centre at ``baseline_poses``, so far ahead of the rear axle."""
    yaw = poses[:, 3]
    return np.asarray(poses[:, :2] + array_x_m * np.stack([np.cos(yaw), np.sin(yaw)], axis=1))


def make_course(spec: OffRoad, folder: Path) -> OffRoadCourse:
    """Draw a course with its ground and write the log of its baseline drive into a folder."""
    laid = lay_course(spec)
    day = WEATHER["clear"](100 * spec.seed)
    drive = simulate_drive(laid.ground, laid.plan, day, spec.seed, road=laid.road, array=laid.array, errors=_SURVEY)
    path = folder / "baseline.drive.h5"
    write_drive(path, drive, sweeps=spec.sweeps)
    return OffRoadCourse(*laid, path, drive.antenna_m[..., :2].mean(axis=1))


def scene_frame_of(frame: LocalFrame) -> SceneFrame:
    """A map's frame in the scene's."""
    at = np.array([0.0, 1000.0])
    up = np.zeros(2)
    east, north, _ = SITE_FRAME.to_local(*frame.to_geodetic(at, np.zeros(2), up))
    return SceneFrame(np.array([east[0], north[0]]), float(np.arctan2(north[1] - north[0], east[1] - east[0])))


def _clear_road(spec: OffRoad) -> Road:
    """A road that does not come near itself: of seeds in order, the first."""
    config = RoadConfig(
        length_m=spec.length_m + 40.0,
        curvature_rms_per_m=1.0 / 60.0,
        arc_length_m=(25.0, 80.0),
        min_radius_m=25.0,
        transition_m=15.0,
        grade_rms=0.04,
        grade_wavelength_m=(40.0, 300.0),
        bank_rms_rad=float(np.radians(2.0)),
        bank_wavelength_m=(30.0, 200.0),
        roughness_rms_m=0.006,
    )
    along = np.arange(-config.margin_m, config.length_m + config.margin_m, 4.0)
    apart = np.abs(along[:, None] - along[None]) > _NEIGHBOURS_M
    for attempt in range(1000):
        road = make_road(1000 * spec.seed + attempt, replace(config))
        centre = follow_centre(road, along)
        place = centre.east_m + 1j * centre.north_m
        if not np.any((np.abs(place[:, None] - place[None]) < _APART_M) & apart):
            return road
    raise ValueError(f"no road of {spec.length_m} m that stays clear of itself was drawn")


def _float32(waves: Waves) -> Waves:
    return Waves(*(np.asarray(part, np.float32) for part in waves))
