"""Three baselines of a generated road whose labels disagree, made consistent, and a live drive before and after."""

import time
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

from benchmarks.accuracy import Labels, accuracy_of
from lgprjax.batch import register_log
from lgprjax.batch.register import true_poses
from lgprjax.formats import DriveLog, MapFile
from lgprjax.formats.map_layout import PLACE_UNITS
from lgprjax.mapping import build_map, verify_map
from lgprjax.mapping.align import AgreedBaselines, plan_matches, refine_map
from lgprjax.registration import RegisterOptions
from lgprjax.scene import (
    Day,
    DrivePlan,
    GroundConfig,
    NavigationErrors,
    PoseTrack,
    RoadConfig,
    SimulatedDrive,
    make_ground,
    make_road,
    simulate_drive,
)
from lgprjax.simulation import write_drive

RTK = NavigationErrors(position_sigma_m=0.01, heading_sigma_rad=np.radians(0.1))
SLOW = NavigationErrors(position_sigma_m=0.5, heading_sigma_rad=np.radians(0.3), correlation_s=60.0)
SPEED_MPS = 5.0


class Road(NamedTuple):
    """Drive logs of one road, and the map of its baselines."""

    baselines: list[Path]
    live: Path
    map: Path


def with_slow_error(drive: SimulatedDrive, seed: int, rms_m: float) -> SimulatedDrive:
    """Labels wrong by a sum of waves of 200 to 900 m; they say how much."""
    rng = np.random.default_rng(seed)
    track = drive.navigation
    path_m = track.time_s * SPEED_MPS
    wave = 2.0 * np.pi / rng.uniform(200.0, 900.0, 30)
    value = np.cos(path_m[:, None, None] * wave + rng.uniform(0.0, 2.0 * np.pi, (2, 30))) * rng.normal(size=(2, 30))
    wrong = value.sum(axis=2)
    wrong *= rms_m / np.sqrt(np.mean(wrong**2, axis=0))
    pose = track.pose.copy()
    pose[:, :2] += wrong
    assert track.sigma is not None
    sigma = track.sigma.copy()
    sigma[:, :2] = rms_m
    return drive._replace(navigation=PoseTrack(track.time_s, pose, sigma))


def make_road_map(folder: Path, length_m: float, errors: str) -> Road:
    """A road that bends; two baselines along it, one against, on two days; a live drive on a third."""
    folder.mkdir()
    road = make_road(3, RoadConfig(length_m=length_m, curvature_rms_per_m=0.005))
    ground = make_ground(3, GroundConfig(length_m=length_m))
    days = [Day(seed=31), Day(seed=32), Day(seed=31), Day(seed=33)]
    plans = [
        DrivePlan(0.0, length_m - 6.0, speed_mps=SPEED_MPS, lane_m=0.15),
        DrivePlan(6.0, length_m - 6.0, speed_mps=SPEED_MPS, lane_m=-0.1, direction=-1),
        DrivePlan(0.0, length_m - 6.0, speed_mps=SPEED_MPS, lane_m=-0.15),
        DrivePlan(6.0, length_m - 12.0, speed_mps=SPEED_MPS, lane_m=0.05),
    ]
    paths = []
    for number, (plan, day) in enumerate(zip(plans, days, strict=True)):
        navigation = SLOW if errors == "rough" and number < 3 else RTK
        drive = simulate_drive(ground, plan, day, 40 + number, road=road, errors=navigation)
        if errors == "smooth" and number < 3:
            drive = with_slow_error(drive, 70 + number, 0.5)
        if number == 3:
            bias = NavigationErrors(position_bias_m=(0.8, 0.6))
            drive = simulate_drive(ground, plan, day, 40 + number, road=road, errors=bias)
        paths.append(folder / f"drive{number}.drive.h5")
        write_drive(paths[-1], drive)
    build_map(paths[:3], folder / "road.map.h5")
    return Road(paths[:3], paths[3], folder / "road.map.h5")


def labels_of_map(path: Path, logs: list[Path]) -> tuple[Labels, np.ndarray]:
    """True places of a map's stations, and what their labels are wrong by; the baseline of each."""
    with MapFile.open(path) as source:
        pose, drive, frame = source.pose, source.drive, source.description.frame
        time_s = source.read_stored(np.arange(len(pose))).place[:, 7] * PLACE_UNITS[7]
    truth = np.zeros((len(pose), 2))
    for number, log_path in enumerate(logs):
        own = drive == number
        with DriveLog.open(log_path) as log:
            true = true_poses(log, frame)
            assert true is not None
            for axis in range(2):
                truth[own, axis] = np.interp(time_s[own], log.scan_time_s, true[:, axis])
    return Labels(truth, pose[:, :2] - truth), drive


def mutual_rms_m(labels: Labels, drive: np.ndarray) -> float:
    """Root mean square of the difference of two baselines' errors at the same ground, over all pairs of baselines."""
    apart = []
    for a in range(int(drive.max())):
        for b in range(a + 1, int(drive.max()) + 1):
            mine, other = np.flatnonzero(drive == a)[::20], np.flatnonzero(drive == b)
            for station in mine:
                away = np.hypot(*(labels.truth_m[other] - labels.truth_m[station]).T)
                if away.min() < 0.8:
                    apart.append(labels.error_m[station] - labels.error_m[other[np.argmin(away)]])
    return float(np.sqrt(np.mean(np.sum(np.square(apart), axis=1))))


def live_figures(road: Road, path: Path) -> str:
    """Availability and error of the live drive on a map, across, against the map's own labels and absolute."""
    labels, _ = labels_of_map(path, road.baselines)
    with MapFile.open(path) as source, DriveLog.open(road.live) as log:
        figures = accuracy_of(register_log(source, log, RegisterOptions(search_m=3.0)), labels)
    return (
        f"live: {figures.availability:.3f} ok, {figures.wrong} farther than 0.3 m from the truth, across "
        f"{figures.cross_rms_m:.3f} m RMS from the truth, {figures.relative_cross_mean_m:.3f} m mean from the map's "
        f"own frame, r at the truth {figures.correlation_at_truth:.2f}"
    )


def refined(road: Road, output: Path) -> AgreedBaselines:
    began = time.perf_counter()
    with MapFile.open(road.map) as source:
        agreed = refine_map(source, plan_matches(source), output)
    print(
        f"refined in {time.perf_counter() - began:.0f} s: {agreed.tried} tried, {agreed.matched} matched, "
        f"{agreed.used} used, {agreed.kept} kept; noise times {agreed.noise_scale:.2f}; {agreed.before}; {agreed.after}"
    )
    return agreed


@pytest.mark.parametrize("errors", ["smooth", "rough"])
def test_three_baselines_over_two_hundred_metres(tmp_path: Path, errors: str) -> None:
    """Rough: a Gauss-Markov process of the first order, which walks by 4 cm a root metre."""
    road = make_road_map(tmp_path / errors, 200.0, errors)
    output = tmp_path / f"{errors}.map.h5"
    refined(road, output)
    apart = [mutual_rms_m(*labels_of_map(path, road.baselines)) for path in (road.map, output)]
    print(f"{errors}: mutual {apart[0]:.3f} -> {apart[1]:.4f} m RMS", flush=True)
    for path in (road.map, output):
        print(live_figures(road, path), flush=True)
    for path in (road.map, output):
        with MapFile.open(path) as source:
            health = verify_map(source)
        for kind in ("offset", "disagreement"):
            found = health.finding(kind)
            print(kind, round(found.value, 3), found.verdict, found.text, flush=True)
    assert apart[0] > 0.3
    assert apart[1] <= (0.05 if errors == "smooth" else 0.1)


def test_three_baselines_over_two_kilometres(tmp_path: Path) -> None:
    road = make_road_map(tmp_path / "long", 2000.0, "smooth")
    output = tmp_path / "long.map.h5"
    refined(road, output)
    apart = [mutual_rms_m(*labels_of_map(path, road.baselines)) for path in (road.map, output)]
    print(f"two kilometres: mutual {apart[0]:.3f} -> {apart[1]:.4f} m RMS")
    for path in (road.map, output):
        print(live_figures(road, path))
    assert apart[0] > 0.5
    assert apart[1] <= 0.05
