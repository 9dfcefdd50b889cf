"""How hard the default scene is for a plain chain without alignment: what another ground, place and speed cost."""

from functools import cache

import numpy as np
import pytest
from jaxtyping import Float
from scipy.ndimage import uniform_filter1d
from scipy.spatial import cKDTree

from lgprjax.scene import Day, DrivePlan, GroundConfig, SimulatedDrive, make_ground, render_drive, simulate_drive

LENGTH_M = 24.0
KERNEL_M = 0.55 * 0.127
FILTER_SCANS = round(5.0 / (4.5 / 126))


@cache
def drive(ground_seed: int, lane_m: float, day_seed: int, velocity_factor: float = 1.0) -> SimulatedDrive:
    ground = make_ground(ground_seed, GroundConfig(length_m=LENGTH_M + 5.0))
    day = Day(seed=day_seed, velocity_factor=velocity_factor)
    return simulate_drive(ground, DrivePlan(0.0, LENGTH_M, lane_m=lane_m), day, round(50 + 100 * lane_m))


def live(ground_seed: int = 1, velocity_factor: float = 1.0) -> SimulatedDrive:
    """Between the baselines at -0.3 and +0.3 m of day 1, on another day."""
    return drive(ground_seed, 0.2, 2, velocity_factor)


@cache
def profiles(
    ground_seed: int, lane_m: float, day_seed: int, velocity_factor: float = 1.0
) -> Float[np.ndarray, "scan channel sample"]:
    """Band-pass 80-440 MHz, then a zero-phase running mean of 5 m taken away."""
    scans = render_drive(drive(ground_seed, lane_m, day_seed, velocity_factor)).astype(np.float64) - 128
    frequency_mhz = np.fft.rfftfreq(512, 0.16e-3)
    spectrum = np.fft.rfft(scans, 512) * ((frequency_mhz >= 80) & (frequency_mhz <= 440))
    scans = np.fft.irfft(spectrum, 512)[..., :369]
    return np.asarray(scans - uniform_filter1d(scans, FILTER_SCANS, axis=0, mode="nearest"))


def correlate(
    ground_seed: int = 1, offset_m: tuple[float, float] = (0.0, 0.0), velocity_factor: float = 1.0
) -> Float[np.ndarray, " scan"]:
    """Correlation of single live scans with the gridded baselines, every scan displaced by ``offset_m``."""
    lanes = (-0.3, 0.3)
    maps = [profiles(1, lane, 1) for lane in lanes]
    rms = np.sqrt(np.mean([np.mean(p**2, axis=(0, 1)) for p in maps], axis=0)) + 1e-3
    traces = np.concatenate([p.reshape(-1, 369) for p in maps]) / rms
    places = np.concatenate([drive(1, lane, 1).antenna_m[..., :2].reshape(-1, 2) for lane in lanes])
    other_day = live(ground_seed, velocity_factor)
    chosen = np.arange(150, len(other_day.scan_time_s) - 150, 20)
    scans = profiles(ground_seed, 0.2, 2, velocity_factor)[chosen] / rms
    wanted = other_day.antenna_m[chosen][..., :2].reshape(-1, 2) + np.asarray(offset_m)
    grid = np.empty((len(wanted), 369))
    for row, near in enumerate(cKDTree(places).query_ball_point(wanted, 3 * KERNEL_M)):
        weight = np.exp(-np.sum((places[near] - wanted[row]) ** 2, axis=1) / (2 * KERNEL_M**2))
        grid[row] = weight @ traces[near] / weight.sum()
    grid = grid.reshape(scans.shape)
    across = np.sum(scans * grid, axis=(1, 2))
    return np.asarray(across / np.sqrt(np.sum(scans**2, axis=(1, 2)) * np.sum(grid**2, axis=(1, 2))))


def test_a_second_clear_day_correlates_by_three_quarters_at_the_truth() -> None:
    assert 0.68 < np.median(correlate()) < 0.82


@pytest.mark.parametrize("axis", [0, 1])
def test_the_ground_forgets_itself_within_a_few_decimetres(axis: int) -> None:
    """By half at some 0.3 m: refraction keeps the rays steep, so that what is heard lies nearly below the antenna."""
    at_truth = np.median(correlate())
    offsets = [(off, 0.0) if axis == 0 else (0.0, off) for off in (-0.08, -0.2, -0.4)]
    near, half, far = (np.median(correlate(offset_m=offset)) for offset in offsets)
    assert 0.8 * at_truth < near < 0.98 * at_truth
    assert 0.5 * at_truth < half < near - 0.05
    assert far < 0.5 * at_truth


def test_a_slower_wave_costs_most_of_it() -> None:
    """A travel time stretched by 5 % shifts echoes at 40 ns by 2 ns, half a period."""
    assert np.median(correlate(velocity_factor=1 / 1.05)) < 0.2


def test_another_ground_does_not_correlate() -> None:
    r = correlate(99)
    assert abs(r.mean()) < 0.05
    assert r.std() < 0.16


def test_what_is_buried_survives_eight_bits_and_the_surface_does_not_clip_much() -> None:
    counts = render_drive(live()).astype(np.float64) - 128
    moving = counts - counts.mean(axis=0)
    assert 4.0 < moving[..., 80:300].std() < 40.0
    assert np.mean((counts == -128) | (counts == 127)) < 0.01
