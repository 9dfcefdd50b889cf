"""Drives of one analytic ground give the same stations, however they were driven."""

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np
import pytest

from lgprjax.radar import ChainSettings
from lgprjax.subsurface import Coherence, ScanBlock, StationBlock, coherence_lags, stations_of_drive

CHANNELS, SAMPLES = 2, 4
SETTINGS = ChainSettings(
    band_low_hz=60e6, band_high_hz=400e6, dewow_ns=7.5, track_filter_m=4.0, step_m=0.05, wavelength_m=0.5
)
SPACING_M = 0.035
SURFACE = 30.0


def ground(place_m: np.ndarray) -> np.ndarray:
    """Traces along the track: waves of 0.6 to 1.7 m over a surface return that never changes."""
    wavelength_m = np.array([[0.6, 0.8, 1.1, 1.7], [0.7, 0.9, 1.3, 1.5]])
    phase = np.arange(CHANNELS * SAMPLES).reshape(CHANNELS, SAMPLES)
    return np.asarray(SURFACE + np.sin(2 * np.pi * place_m[:, None, None] / wavelength_m + phase))


def scans(travel_m: np.ndarray, valid: np.ndarray | None = None) -> ScanBlock:
    n = len(travel_m)
    pose = np.stack([travel_m, 2.0 * travel_m, np.full(n, 0.3), np.full(n, 0.4), np.zeros(n)], axis=1)
    antenna = np.tile([[0.1, 0.2, 0.3], [0.1, -0.2, 0.3]], (n, 1, 1))
    return ScanBlock(
        profile=ground(travel_m).astype(np.float32),
        valid=np.ones((n, CHANNELS), bool) if valid is None else valid,
        travel_m=travel_m - travel_m[0],
        pose=pose,
        ground_up_m=0.01 * travel_m,
        antenna_m=antenna,
        time_s=np.arange(n) / 126.0,
    )


def in_blocks(drive: ScanBlock, size: int) -> Iterator[ScanBlock]:
    for first in range(0, len(drive.travel_m), size):
        yield ScanBlock(*(field[first : first + size] for field in drive))


def collect(drive: ScanBlock, block: int = 200, spacing_m: float = SPACING_M) -> StationBlock:
    parts = list(stations_of_drive(in_blocks(drive, block), SETTINGS, spacing_m))
    return StationBlock(*(np.concatenate(fields) for fields in zip(*parts, strict=True)))


def interior(block: StationBlock, low_m: float = 3.0, high_m: float = 27.0) -> np.ndarray:
    return np.asarray((block.pose[:, 0] > low_m) & (block.pose[:, 0] < high_m))


def constant() -> np.ndarray:
    return np.arange(0.0, 30.0, SPACING_M)


def varying() -> np.ndarray:
    """Between 1.5 and 4.5 cm a scan."""
    path = np.cumsum(0.03 + 0.015 * np.sin(np.arange(2000) / 90.0))
    return np.asarray((path - path[0])[path - path[0] < 30.0])


def standing() -> np.ndarray:
    there = constant()
    return np.concatenate([there[:300], np.full(400, there[299]), there[300:]])


def reversing() -> np.ndarray:
    """Forward to 14 m, back to 9 m, and on over the same ground, at places in between."""
    there = constant()
    back = np.arange(there[400], 9.0, -0.028)
    again = np.arange(9.0, 30.0, 0.041)
    return np.concatenate([there[:400], back, again])


@pytest.fixture(scope="module")
def steady() -> StationBlock:
    return collect(scans(constant()))


def test_stations_stand_at_equal_steps_each_once(steady: StationBlock) -> None:
    np.testing.assert_allclose(np.diff(steady.pose[:, 0])[2:-2], SETTINGS.step_m, atol=0.012)
    assert len(steady.pose) == 601  # from 0 to 29.995 m, both ends
    np.testing.assert_allclose(steady.pose[:, 1], 2 * steady.pose[:, 0], atol=1e-9)
    np.testing.assert_allclose(steady.ground_up_m, 0.01 * steady.pose[:, 0], atol=1e-9)
    np.testing.assert_allclose(steady.antenna_m, np.tile([[0.1, 0.2, 0.3], [0.1, -0.2, 0.3]], (len(steady.pose), 1, 1)))
    assert np.all(np.diff(steady.time_s) > 0.0)


def test_a_station_is_the_ground_where_it_says_it_is(steady: StationBlock) -> None:
    """Oracle: the analytic ground less its mean over four metres, blurred a little by the kernel."""
    inner = interior(steady)
    place_m = steady.pose[inner, 0]
    around = np.linspace(-2.0, 2.0, 81)
    mean = np.mean([ground(place_m + d) for d in around], axis=0)
    expected = ground(place_m) - mean
    for channel in range(CHANNELS):
        for sample in range(SAMPLES):
            r = np.corrcoef(steady.profile[inner, channel, sample], expected[:, channel, sample])[0, 1]
            assert r > 0.995
    assert np.sqrt(np.mean((steady.profile[inner] - expected) ** 2)) < 0.06
    assert abs(float(np.mean(steady.profile))) < 0.05
    assert np.abs(steady.profile).max() < 1.6


@pytest.mark.parametrize("drive", [varying, standing, reversing])
def test_how_it_was_driven_makes_no_difference(steady: StationBlock, drive: Callable[[], np.ndarray]) -> None:
    other = collect(scans(drive()))
    assert len(other.pose) == pytest.approx(len(steady.pose), abs=2)
    assert np.all(np.diff(other.pose[:, 0]) > 0.0)
    inner = interior(other)
    for channel in range(CHANNELS):
        for sample in range(SAMPLES):
            expected = np.interp(other.pose[inner, 0], steady.pose[:, 0], steady.profile[:, channel, sample])
            difference = other.profile[inner, channel, sample] - expected
            assert np.sqrt(np.mean(difference**2)) < 0.03


@pytest.mark.parametrize(("drive", "block"), [(constant, 7), (constant, 5000), (reversing, 13)])
def test_the_size_of_the_blocks_makes_no_difference(drive: Callable[[], np.ndarray], block: int) -> None:
    for a, b in zip(collect(scans(drive()), block), collect(scans(drive())), strict=True):
        np.testing.assert_allclose(a, b, atol=1e-5)


def test_where_no_scan_came_near_there_is_no_station() -> None:
    travel = constant()
    gap = (travel > 12.0) & (travel < 15.0)
    other = collect(scans(travel[~gap]))
    place_m = other.pose[:, 0]
    assert not np.any((place_m > 12.05) & (place_m < 14.95))
    assert np.any(place_m < 12.0)
    assert np.any(place_m > 15.0)
    assert len(place_m) == pytest.approx(27.0 / SETTINGS.step_m, abs=5)


def test_an_invalid_channel_leaves_holes_in_itself_only(steady: StationBlock) -> None:
    travel = constant()
    valid = np.ones((len(travel), CHANNELS), bool)
    valid[(travel > 10.0) & (travel < 11.0), 1] = False
    drive = scans(travel, valid)
    drive.profile[~valid] = 1e6
    other = collect(drive)
    np.testing.assert_allclose(other.profile[:, 0], steady.profile[:, 0], atol=1e-5)
    assert other.valid[:, 0].all()
    hole = ~other.valid[:, 1]
    assert np.all((other.pose[hole, 0] > 9.9) & (other.pose[hole, 0] < 11.1))
    assert hole.sum() == pytest.approx(20, abs=3)
    assert not other.profile[hole, 1].any()
    assert np.abs(other.profile).max() < 2.0


def test_coarse_scans_are_stations_themselves() -> None:
    """Scans no finer than the step: the nearest one, unblurred."""
    travel = np.arange(200) * 0.05
    other = collect(scans(travel), spacing_m=0.05)
    np.testing.assert_allclose(other.pose[:, 0], travel, atol=1e-9)
    raw = ground(travel)
    expected = raw - np.array([raw[max(0, n - 40) : n + 41].mean(axis=0) for n in range(200)])
    np.testing.assert_allclose(other.profile, expected, atol=1e-4)


def test_coherence_means_are_those_of_the_whole_drive() -> None:
    rng = np.random.default_rng(0)
    profile = rng.normal(size=(30, CHANNELS, SAMPLES)).astype(np.float32)
    valid = rng.random((30, CHANNELS)) > 0.2
    profile[~valid] = 0.0
    empty = np.zeros((30, 1))
    block = StationBlock(profile, valid, empty, empty, empty, empty)
    total = Coherence.empty(SAMPLES).add(block, (2, 7))
    expected = []
    for lag in (0, 2, 7):
        products = [
            profile[n, channel].astype(float) * profile[n - lag, channel]
            for n in range(lag, 30)
            for channel in range(CHANNELS)
            if valid[n, channel] and valid[n - lag, channel]
        ]
        expected.append(np.mean(products, axis=0))
    np.testing.assert_allclose(total.means, expected, rtol=1e-4, atol=1e-5)
    np.testing.assert_allclose(total.add(block, (2, 7)).means, expected, rtol=1e-4, atol=1e-5)
    # A block shorter than the long lag has no pairs.
    short = Coherence.empty(SAMPLES).add(StationBlock(*(field[:5] for field in block)), (2, 7))
    assert short.distant_pairs == 0
    np.testing.assert_allclose(short.means[2], 0.0)


def test_the_short_lag_of_coherence_never_shares_scans_and_the_long_one_is_a_wavelength() -> None:
    assert coherence_lags(SETTINGS, 0.035) == (2, 10)
    assert coherence_lags(SETTINGS, 0.05) == (1, 10)
    assert coherence_lags(replace(SETTINGS, step_m=0.01), 0.01) == (6, 50)  # an eighth of 0.5 m, and all of it


def test_the_background_of_a_line_ends_with_it() -> None:
    """Two lines of one log, 100 m of travel apart, with direct waves that differ: nothing is left of either."""
    one = scans(constant())
    count = len(one.travel_m)
    level = np.full((count, CHANNELS, SAMPLES), 100.0, np.float32)
    both = ScanBlock(*(np.concatenate([field, field]) for field in one))._replace(
        profile=np.concatenate([level, level + 5.0]),
        travel_m=np.concatenate([one.travel_m, one.travel_m + one.travel_m[-1] + 100.0]),
    )
    found = collect(both, 64)
    assert len(found.pose) == pytest.approx(2 * len(collect(one).pose), abs=4)
    assert np.max(np.abs(found.profile)) < 1e-3
