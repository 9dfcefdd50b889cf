"""How hard the default scene is for a plain chain: what Day's defaults were set by."""

from functools import cache

import numpy as np
import pytest
from jaxtyping import Float
from scipy.ndimage import uniform_filter1d
from scipy.spatial import cKDTree

from lgprjax.scene import (
    Day,
    DrivePlan,
    GroundConfig,
    SimulatedDrive,
    make_ground,
    render_drive,
    simulate_drive,
)

LENGTH_M = 24.0
KERNEL_M = 0.55 * 0.127
FILTER_SCANS = round(5.0 / (4.5 / 126))


@cache
def drives(ground_seed: int) -> tuple[list[SimulatedDrive], SimulatedDrive]:
    """Two baselines at -0.3 and +0.3 m on one day, a live drive between them at +0.2 m on another."""
    ground = make_ground(ground_seed, GroundConfig(length_m=LENGTH_M + 5.0))
    base = [
        simulate_drive(ground, DrivePlan(0.0, LENGTH_M, lane_m=lane), Day(seed=1), 10 + i)
        for i, lane in enumerate((-0.3, 0.3))
    ]
    return base, simulate_drive(ground, DrivePlan(0.0, LENGTH_M, lane_m=0.2), Day(seed=2), 20)


def profiles(drive: SimulatedDrive) -> Float[np.ndarray, "scan channel sample"]:
    """Band-pass 80-440 MHz, then a zero-phase running mean of 5 m taken away."""
    scans = render_drive(drive).astype(np.float64) - 128
    frequency_mhz = np.fft.rfftfreq(512, 0.16e-3)
    spectrum = np.fft.rfft(scans, 512) * ((frequency_mhz >= 80) & (frequency_mhz <= 440))
    scans = np.fft.irfft(spectrum, 512)[..., :369]
    return np.asarray(scans - uniform_filter1d(scans, FILTER_SCANS, axis=0, mode="nearest"))


def correlate_at(
    base: list[SimulatedDrive], live: SimulatedDrive, offset_m: tuple[float, float]
) -> Float[np.ndarray, " scan"]:
    """Correlation of single live scans with the gridded baselines, every scan displaced by ``offset_m``."""
    maps = [profiles(drive) for drive in base]
    rms = np.sqrt(np.mean([np.mean(p**2, axis=(0, 1)) for p in maps], axis=0)) + 1e-3
    traces = np.concatenate([p.reshape(-1, 369) for p in maps]) / rms
    places = np.concatenate([drive.antenna_m[..., :2].reshape(-1, 2) for drive in base])
    chosen = np.arange(150, len(live.scan_time_s) - 150, 20)
    scans = profiles(live)[chosen] / rms
    wanted = live.antenna_m[chosen][..., :2].reshape(-1, 2) + np.asarray(offset_m)
    grid = np.empty((len(wanted), 369))
    for row, near in enumerate(cKDTree(places).query_ball_point(wanted, 3 * KERNEL_M)):
        weight = np.exp(-np.sum((places[near] - wanted[row]) ** 2, axis=1) / (2 * KERNEL_M**2))
        grid[row] = weight @ traces[near] / weight.sum()
    grid = grid.reshape(scans.shape)
    across = np.sum(scans * grid, axis=(1, 2))
    return np.asarray(across / np.sqrt(np.sum(scans**2, axis=(1, 2)) * np.sum(grid**2, axis=(1, 2))))


def test_a_second_clear_day_correlates_by_three_quarters_at_the_truth() -> None:
    base, live = drives(1)
    assert 0.68 < np.median(correlate_at(base, live, (0.0, 0.0))) < 0.82


@pytest.mark.parametrize("axis", [0, 1])
def test_the_ground_forgets_itself_within_ten_to_twenty_centimetres(axis: int) -> None:
    base, live = drives(1)
    at_truth = np.median(correlate_at(base, live, (0.0, 0.0)))
    near, far = (tuple(np.eye(2)[axis] * -off) for off in (0.08, 0.2))
    assert np.median(correlate_at(base, live, near)) > 0.5 * at_truth
    assert np.median(correlate_at(base, live, far)) < 0.5 * at_truth


def test_another_ground_does_not_correlate() -> None:
    base, _ = drives(1)
    _, impostor = drives(99)
    r = correlate_at(base, impostor, (0.0, 0.0))
    assert abs(r.mean()) < 0.05
    assert r.std() < 0.12
