"""False alarms and thresholds over drives drawn in plain NumPy."""

import numpy as np

from lgprjax.tuning import find_limit_cycle, fit_threshold
from tuning.swinging_drive import STEP_S, Drive, swinging_drive


def bends() -> np.ndarray:
    return np.asarray(0.3 * np.sin(2.0 * np.pi * STEP_S * np.arange(2400) / 30.0))


def false_alarms(drives: int) -> int:
    """Limit cycles found in so many straight and as many winding drives of a vehicle that obeys."""
    alarms = 0
    for seed in range(drives):
        straight = swinging_drive(seed, threshold_mps=0.0)
        winding = swinging_drive(100 + seed, threshold_mps=0.0, bend_radpm=bends())
        late = straight.time_s > 40.0
        alarms += find_limit_cycle(straight.time_s[late], straight.cross_m[late]).found
        alarms += find_limit_cycle(winding.time_s[late], winding.cross_m[late], bend_radpm=bends()[late]).found
    return alarms


def alarms_of_noise(records: int) -> int:
    """Limit cycles found in so many records of slow noise, and as many of white noise."""
    time_s, alarms = np.arange(0.0, 200.0, 0.1), 0
    for seed in range(records):
        white = np.random.default_rng(seed).normal(size=len(time_s))
        slow = np.convolve(white, np.exp(-np.arange(200) / 20.0), mode="same")
        alarms += find_limit_cycle(time_s, 0.1 * slow).found + find_limit_cycle(time_s, 0.1 * white).found
    return alarms


def check_thresholds(threshold_mps: float, drives: int) -> None:
    """It is found in every drive, and its interval holds it in all but one."""
    fits = []
    for seed in range(drives):
        drive = swinging_drive(seed, threshold_mps=threshold_mps)
        fits.append(fit_threshold(drive.time_s, drive.yaw_rad, drive.turn_mps))
    assert all(fit.found for fit in fits)
    holds = [fit.threshold_mps.low <= threshold_mps <= fit.threshold_mps.high for fit in fits]
    assert sum(holds) >= drives - 1
    assert np.median([fit.threshold_mps.high - fit.threshold_mps.low for fit in fits]) < 0.2 * threshold_mps
    assert abs(np.median([fit.threshold_mps.value for fit in fits]) / threshold_mps - 1.0) < 0.05


def check_obedient(drives: int) -> None:
    """No threshold is found in drives of a vehicle that obeys, nor in the same logs cut elsewhere."""
    for seed in range(drives):
        drive = swinging_drive(seed, threshold_mps=0.0, bend_radpm=bends() if seed % 2 else None)
        for part in (drive, Drive(*(column[50:] for column in drive))):
            assert not fit_threshold(part.time_s, part.yaw_rad, part.turn_mps).found


def check_slipping(threshold_mps: float, veer_radps: float, drives: int) -> None:
    """Sides that slip unequally bring no threshold, and hide none."""
    for seed in range(drives):
        drive = swinging_drive(seed, threshold_mps=threshold_mps, veer_radps=veer_radps)
        fit = fit_threshold(drive.time_s, drive.yaw_rad, drive.turn_mps)
        assert fit.found == (threshold_mps > 0.0)
        assert not fit.found or fit.threshold_mps.low <= threshold_mps <= fit.threshold_mps.high
