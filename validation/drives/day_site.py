"""A road, its two baselines at 5 mph, and live drives of every kind over it; figures of each."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from benchmarks.accuracy import DriveAccuracy, Labels, accuracy_of, labels_of
from lgprjax.batch import RegisteredDrive, register_log
from lgprjax.formats import DriveLog, MapFile
from lgprjax.mapping import build_map
from lgprjax.registration import RegisterOptions
from lgprjax.scene import (
    WEATHER,
    DrivePlan,
    GroundConfig,
    NavigationErrors,
    RoadConfig,
    SimulatedDrive,
    make_ground,
    make_road,
    simulate_drive,
)
from lgprjax.simulation import write_drive

MPH = 0.44704
SURVEY = NavigationErrors(position_sigma_m=0.01, heading_sigma_rad=np.radians(0.1))
METRE_OFF = NavigationErrors(position_bias_m=(0.8, 0.6))
ROAD = RoadConfig(curvature_rms_per_m=1 / 200, grade_rms=0.02, bank_rms_rad=np.radians(1.0), roughness_rms_m=0.0015)


class DaySite:
    """A generated road with its map; live drives are rendered, registered and measured on demand.

    Args:
        repeat_m: the ground repeats itself after this length.
    """

    def __init__(self, folder: Path, seed: int, length_m: float, repeat_m: float | None = None) -> None:
        folder.mkdir(exist_ok=True)
        config = GroundConfig(length_m=length_m, repeat_m=repeat_m)
        self.folder, self.seed, self.length_m = folder, seed, length_m
        self.ground, self.other = make_ground(seed, config), make_ground(seed + 1000, config)
        self.road = make_road(seed, RoadConfig(**{**vars(ROAD), "length_m": length_m}))
        self.map = folder / "road.map.h5"
        baselines = []
        for number, lane_m in enumerate((0.3, -0.3)):
            plan = DrivePlan(0.0, length_m - 5.0, lane_m=lane_m, speed_mps=5 * MPH)
            drive = simulate_drive(
                self.ground, plan, WEATHER["clear"](100 * seed + number), number, road=self.road, errors=SURVEY
            )
            baselines.append(self._write(f"baseline_{number}", drive))
        build_map(baselines, self.map)
        with MapFile.open(self.map) as source:
            self.labels: Labels = labels_of(_opened(baselines), source.description.frame)

    def drive(
        self, day: str, *, impostor: bool = False, direction: int = 1, speed_mps: float = 4.5, lane_m: float = 0.2
    ) -> Path:
        """Render a live drive, its GNSS wrong by a metre, on a day of its own seed."""
        name = f"{'impostor_' if impostor else ''}{day}_{direction:+d}_{speed_mps:.1f}_{lane_m:+.1f}"
        plan = DrivePlan(2.0, self.length_m - 8.0, lane_m=lane_m, direction=direction, speed_mps=speed_mps)
        weather = WEATHER[day](100 * self.seed + 10 + list(WEATHER).index(day))
        if (path := self.folder / f"{name}.drive.h5").exists():
            return path
        ground = self.other if impostor else self.ground
        drive = simulate_drive(ground, plan, weather, self.seed + 7, road=self.road, errors=METRE_OFF)
        return self._write(name, drive)

    def register(self, path: Path, options: RegisterOptions) -> tuple[RegisteredDrive, DriveAccuracy]:
        """Register a drive against the map."""
        with MapFile.open(self.map) as source, DriveLog.open(path) as log:
            registered = register_log(source, log, options)
        return registered, accuracy_of(registered, self.labels)

    def on_map(self, pose: np.ndarray) -> np.ndarray:
        """Whether a station of the map lies within 0.5 m of each pose."""
        with MapFile.open(self.map) as source:
            stations = source.pose[:, :2]
        apart = np.abs((pose[:, :2] @ [1.0, 1j])[:, None] - (stations @ [1.0, 1j])[None])
        return np.asarray(np.min(apart, axis=1) < 0.5)

    def _write(self, name: str, drive: SimulatedDrive) -> Path:
        path = self.folder / f"{name}.drive.h5"
        write_drive(path, drive)
        return path


def strength_of(drive: RegisteredDrive) -> np.ndarray:
    """What the threshold asks of: correlation times the root of the overlap."""
    strength: np.ndarray = np.asarray(drive.fix.correlation) * np.sqrt(np.asarray(drive.fix.overlap))
    return strength


def _opened(paths: list[Path]) -> Iterator[DriveLog]:
    for path in paths:
        with DriveLog.open(path) as log:
            yield log
