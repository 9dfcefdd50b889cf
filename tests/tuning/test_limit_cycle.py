"""Limit cycles and thresholds found in drives made by plain NumPy; false alarms counted."""

import numpy as np
import pytest

from lgprjax.tuning import NotExcitedError, find_limit_cycle, fit_threshold

from .swinging_drive import STEP_S, Drive, swinging_drive


def test_a_swing_is_measured() -> None:
    time_s = np.arange(0.0, 200.0, 0.1)
    rng = np.random.default_rng(1)
    offset = 0.2 * np.sin(2.0 * np.pi * time_s / 12.5) + 0.01 * rng.normal(size=len(time_s)) + 0.3
    found = find_limit_cycle(time_s, offset)
    assert found.found
    assert found.peak_to_peak_m == pytest.approx(0.4, rel=0.05)
    assert found.period_s == pytest.approx(12.5, rel=0.02)
    assert found.periods == pytest.approx(16.0, rel=0.02)


def test_a_swing_that_dies_away_is_none() -> None:
    time_s = np.arange(0.0, 200.0, 0.1)
    assert not find_limit_cycle(time_s, 0.3 * np.exp(-time_s / 40.0) * np.sin(time_s / 2.0)).found


@pytest.mark.parametrize("threshold_mps", [0.3, 0.35])
def test_a_vehicle_with_a_threshold_swings_and_is_found(threshold_mps: float) -> None:
    for seed in range(5):
        drive = swinging_drive(seed, threshold_mps=threshold_mps)
        late = drive.time_s > 40.0
        assert find_limit_cycle(drive.time_s[late], drive.cross_m[late]).found


def test_no_alarm_without_a_threshold() -> None:
    straight = [swinging_drive(seed, threshold_mps=0.0) for seed in range(20)]
    bends = 0.3 * np.sin(2.0 * np.pi * STEP_S * np.arange(2400) / 30.0)
    winding = [swinging_drive(100 + seed, threshold_mps=0.0, bend_radpm=bends) for seed in range(20)]
    late = straight[0].time_s > 40.0
    alarms = [find_limit_cycle(drive.time_s[late], drive.cross_m[late]).found for drive in straight]
    alarms += [
        find_limit_cycle(drive.time_s[late], drive.cross_m[late], bend_radpm=bends[late]).found for drive in winding
    ]
    assert sum(alarms) <= 1


def test_noise_alone_is_no_limit_cycle() -> None:
    time_s = np.arange(0.0, 200.0, 0.1)
    alarms = 0
    for seed in range(100):
        rng = np.random.default_rng(seed)
        white = rng.normal(size=len(time_s))
        slow = np.convolve(white, np.exp(-np.arange(200) / 20.0), mode="same")
        alarms += find_limit_cycle(time_s, 0.1 * slow).found + find_limit_cycle(time_s, 0.1 * white).found
    assert alarms <= 2


@pytest.mark.parametrize("threshold_mps", [0.15, 0.3])
def test_the_threshold_is_found_with_an_interval_that_holds_it(threshold_mps: float) -> None:
    fits = []
    for seed in range(8):
        drive = swinging_drive(seed, threshold_mps=threshold_mps)
        fits.append(fit_threshold(drive.time_s, drive.yaw_rad, drive.turn_mps))
    assert all(fit.found for fit in fits)
    holds = [fit.threshold_mps.low <= threshold_mps <= fit.threshold_mps.high for fit in fits]
    assert sum(holds) >= 7
    assert np.median([fit.threshold_mps.high - fit.threshold_mps.low for fit in fits]) < 0.2 * threshold_mps
    assert np.median([fit.threshold_mps.value for fit in fits]) == pytest.approx(threshold_mps, rel=0.05)


def test_a_vehicle_that_obeys_has_none() -> None:
    bends = 0.3 * np.sin(2.0 * np.pi * STEP_S * np.arange(2400) / 30.0)
    drives = [swinging_drive(seed, threshold_mps=0.0, bend_radpm=bends if seed % 2 else None) for seed in range(10)]
    # What noise alone makes significant in a log cut elsewhere is no threshold.
    drives += [Drive(*(column[50:] for column in drive)) for drive in drives]
    assert not any(fit_threshold(drive.time_s, drive.yaw_rad, drive.turn_mps).found for drive in drives)


def test_logs_that_say_nothing_are_refused() -> None:
    time_s = np.arange(0.0, 60.0, 0.1)
    still = np.zeros(len(time_s))
    with pytest.raises(NotExcitedError, match="commands of many sizes"):
        fit_threshold(time_s, still, still)
    with pytest.raises(NotExcitedError, match="records"):
        fit_threshold(time_s[:50], still[:50], still[:50])
    with pytest.raises(NotExcitedError, match="numbers"):
        fit_threshold(time_s, np.full(len(time_s), np.nan), still)
    with pytest.raises(NotExcitedError, match="a log of"):
        find_limit_cycle(time_s[:100], still[:100])
    with pytest.raises(NotExcitedError, match="finite"):
        find_limit_cycle(time_s, np.full(len(time_s), np.nan))
    assert not find_limit_cycle(time_s, still).found
