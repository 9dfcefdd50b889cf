"""The course of the devices: its ground, radar, frames and baseline."""

from collections import deque
from typing import Literal, NamedTuple

import jax
import numpy as np
from jaxtyping import Complex64, Float

from lgprjax.frames import LocalFrame
from lgprjax.scene import WEATHER, LiveRadar, Terrain, draw_springs
from lgprjax.scene.propagation import RadarConfig
from lgprjax.scene.render import ReceiverFaults as RadarErrors
from lgprjax.scene.road import surface_up
from lgprjax.simulation.drives import SITE_FRAME
from lgprjax.simulation.loop.off_road import (
    SCAN_HZ,
    Laid,
    OffRoad,
    SceneFrame,
    anchor_of,
    baseline_poses,
    lay_course,
    scene_frame_of,
)

GAIN_DRIFT = RadarErrors().gain_drift
_DRIFTS_OVER_S = 1200.0
_LEVEL_TICK_S = 0.01
_EARTH_M = 6_378_137.0


class Start(NamedTuple):
    """Start of a drive: pose of the rear axle in the map's frame, and position along the road."""

    pose: tuple[float, float, float]
    along_m: float


class CourseWorld:
    """A course, in the frame of its map.

    Args:
        spec: specification of the course.
        local: frame of the map and of poses.
        weather: weather of the day, see ``WEATHER``.
        drive_seed: seed of the day, the radar's errors and the springs.
        gain_drift: gain drift of the radar's receiver while it warms up, see ``ReceiverFaults``: over 20 minutes, half
            of it in 4.
        level: whether the ground is level on all sides, for calibrations, with ticks of 10 ms and no radar data.
        in_view: view of the radar, see ``LiveRadar``.
    """

    def __init__(
        self,
        spec: OffRoad,
        local: LocalFrame,
        *,
        weather: str,
        drive_seed: int,
        gain_drift: float = GAIN_DRIFT,
        level: bool = False,
        in_view: Literal["ground", "empty", "plate"] = "ground",
    ) -> None:
        self.local, self._level = local, level
        self.laid: Laid = lay_course(spec)
        if level:
            flat = jax.tree.map(np.zeros_like, self.laid.terrain[:3])
            self.laid = self.laid._replace(terrain=Terrain(flat[0], flat[1], flat[2], self.laid.terrain.direction))
        self.frame: SceneFrame = scene_frame_of(local)
        poses = baseline_poses(self.laid)
        self._axle_m, self._axle_yaw = self.frame.to_map(poses[:, :2]), poses[:, 3] - self.frame.turn_rad
        self.baseline_m: Float[np.ndarray, "point 2"] = self.frame.to_map(anchor_of(poses, spec.array_x_m))
        tick = max(round(3 / spec.scan_share), 1)
        self.scans_a_tick, self.scan_period_s = tick, spec.scan_share / SCAN_HZ
        self.tick_s = _LEVEL_TICK_S if level else tick * self.scan_period_s
        self._numbers = int(_DRIFTS_OVER_S / self.scan_period_s)
        self._radar = LiveRadar(
            self.laid.ground,
            WEATHER[weather](7919 * spec.seed + drive_seed),
            self.laid.road,
            self.laid.array,
            draw_springs(self.laid.plan, drive_seed),
            scans=self._numbers,
            seed=drive_seed,
            faults=RadarErrors(gain_drift=gain_drift),
            sweeps=spec.sweeps,
            in_view=in_view,
        )

    @property
    def lookup(self) -> Complex64[np.ndarray, "row frequency"] | None:
        """A stepped-frequency radar's recording of empty space, its calibration channel last."""
        start = self._radar.start
        return None if start is None else np.concatenate([start.empty, start.empty_calibration[None]])

    @property
    def radar(self) -> RadarConfig:
        """Time axis of the scans."""
        return self._radar.radar

    def start(self, way_m: float) -> Start:
        """The baseline's pose after some way."""
        way = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(self._axle_m, axis=0).T))])
        at = int(np.searchsorted(way, way_m))
        x_m, y_m = self._axle_m[at]
        return Start((float(x_m), float(y_m), float(self._axle_yaw[at])), self.laid.plan.start_m + float(way[at]))

    def roll(self, place: tuple[float, float, float], along_m: float) -> float:
        """Roll of the body at a pose of the rear axle."""
        return 0.0 if self._level else float(self._radar.body_pose(np.array(place), np.array(along_m), 1)[4])

    def geodetic(self, x_m: float, y_m: float, along_m: float) -> tuple[float, float, float]:
        """Latitude and longitude (degrees) and ellipsoidal height of a place on the road."""
        place = self.frame.to_scene(np.array([[x_m, y_m]]))
        up = surface_up(self.laid.road, np.array([0.0 if self._level else along_m]), np.zeros(1))
        latitude, longitude, height = SITE_FRAME.to_geodetic(place[:, 0], place[:, 1], up)
        return float(latitude[0]), float(longitude[0]), float(height[0])

    def heading_deg(self, yaw_rad: float, x_m: float) -> float:
        """Compass heading of a yaw of the map's frame, so far east in it."""
        # Meridians converge by a thousandth of a degree in a hundred metres: a sphere is good enough.
        east = np.degrees(x_m / (_EARTH_M * np.cos(np.radians(self.local.latitude_deg))))
        longitude = np.array([self.local.longitude_deg + east])
        return float(self.local.heading_of_yaw(np.array([yaw_rad]), longitude)[0])

    def record(
        self,
        number: int,
        before: Float[np.ndarray, "3"],
        after: Float[np.ndarray, "3"],
        along_m: float,
        shift_m: tuple[float, float] = (0.0, 0.0),
    ) -> list[np.ndarray | None]:
        """Scans of a tick, along the true path between two poses of the rear axle; ``None`` for lost ones.

        Args:
            number: number of the first scan.
            before, after: poses at the start and the end of the tick, map frame.
            along_m: position of the rear axle along the road.
            shift_m: displacement along and left at which the ground is recorded.
        """
        first_s = np.arange(self.scans_a_tick) * self.scan_period_s
        share = (first_s[:, None] + self.laid.array.time_offset_s[None]) / self.tick_s
        pose = before + share[..., None] * (after - before)
        cos, sin = np.cos(pose[..., 2]), np.sin(pose[..., 2])
        moved = np.stack([cos * shift_m[0] - sin * shift_m[1], sin * shift_m[0] + cos * shift_m[1]], axis=-1)
        scene = self.frame.to_scene(pose[..., :2] + moved)
        place = np.concatenate([scene, pose[..., 2:] + self.frame.turn_rad], axis=-1)
        # Drifts run over minutes; in longer drives they repeat.
        wrapped = number % (self._numbers - self._numbers % self.scans_a_tick)
        about_m = along_m + shift_m[0] + self.laid.spec.array_x_m
        try:
            recorded = self._radar.record(wrapped, place, about_m)
        except ValueError:
            # The ground is drawn for the course only: next to it there is nothing to receive.
            return [None] * self.scans_a_tick
        pairs = zip(recorded.recorded, recorded.received, strict=True)
        return [data if received else None for data, received in pairs]


# The true vehicle over the last moments, at any time of them.

_KEPT = 16


class Sample(NamedTuple):
    """The truth at a moment; pose of the rear axle in the map's frame.

    Attributes:
        x_m, y_m, yaw_rad, roll_rad: pose.
        travel_m, along_m, speed_mps: signed distance, position along the terrain, speed.
        front_rad, motor_rad: angle of the front wheels, and of the servo as a wheel angle.
        throttle, brake: throttle position and brake pressure, as equivalent commands.
        supply_v: supply voltage of the servo.
        odometer_m, odometer_gain: distance by the wheels, and ratio of indicated to true speed.
        rate_bias_radps, heading_slow_rad: slow errors of the INS.
    """

    x_m: float
    y_m: float
    yaw_rad: float
    roll_rad: float
    travel_m: float
    along_m: float
    speed_mps: float
    front_rad: float
    motor_rad: float
    throttle: float
    brake: float
    supply_v: float
    odometer_m: float
    odometer_gain: float
    rate_bias_radps: float
    heading_slow_rad: float


class Trajectory:
    """Samples at the ticks' ends, the newest last; between them everything runs straight."""

    def __init__(self) -> None:
        self._times: deque[int] = deque(maxlen=_KEPT)
        self._rows: deque[np.ndarray] = deque(maxlen=_KEPT)

    def add(self, time_ns: int, sample: Sample) -> None:
        """The next sample."""
        self._rows.append(np.array(sample))
        self._times.append(time_ns)

    @property
    def last(self) -> Sample:
        """The newest sample."""
        return Sample._make(self._rows[-1].tolist())

    @property
    def known_ns(self) -> int:
        """Time up to which the truth is known."""
        return self._times[-1]

    def at(self, time_ns: int) -> Sample:
        """The truth at a time; the oldest, or newest, sample outside the known range."""
        times = self._times
        at = len(times) - 1
        while at > 0 and times[at] > time_ns:
            at -= 1
        if time_ns <= times[at] or at == len(times) - 1:
            return Sample._make(self._rows[at].tolist())
        share = (time_ns - times[at]) / (times[at + 1] - times[at])
        row = self._rows[at] + share * (self._rows[at + 1] - self._rows[at])
        return Sample._make(row.tolist())
