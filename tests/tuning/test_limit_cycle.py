"""Limit cycles and thresholds found in drives made by plain NumPy; false alarms counted."""

import numpy as np
import pytest

from lgprjax.tuning import NotExcitedError, find_limit_cycle, fit_threshold
from refusals import refused
from tuning.swinging_drive import swinging_drive
from validation.vehicles.limit_cycles import (
    alarms_of_noise,
    check_obedient,
    check_slipping,
    check_thresholds,
    false_alarms,
)


def test_a_swing_is_measured_and_one_that_dies_away_is_none() -> None:
    time_s = np.arange(0.0, 200.0, 0.1)
    rng = np.random.default_rng(1)
    offset = 0.2 * np.sin(2.0 * np.pi * time_s / 12.5) + 0.01 * rng.normal(size=len(time_s)) + 0.3
    found = find_limit_cycle(time_s, offset)
    assert found.found
    assert found.peak_to_peak_m == pytest.approx(0.4, rel=0.05)
    assert found.period_s == pytest.approx(12.5, rel=0.02)
    assert found.periods == pytest.approx(16.0, rel=0.02)
    assert not find_limit_cycle(time_s, 0.3 * np.exp(-time_s / 40.0) * np.sin(time_s / 2.0)).found


def test_a_vehicle_with_a_threshold_swings_and_is_found() -> None:
    for seed in range(4):
        drive = swinging_drive(seed, threshold_mps=0.3 + 0.05 * (seed % 2))
        late = drive.time_s > 40.0
        assert find_limit_cycle(drive.time_s[late], drive.cross_m[late]).found


def test_no_alarm_without_a_threshold() -> None:
    assert false_alarms(6) == 0
    assert alarms_of_noise(20) == 0


@pytest.mark.parametrize("threshold_mps", [0.15, 0.3])
def test_the_threshold_is_found_with_an_interval_that_holds_it(threshold_mps: float) -> None:
    check_thresholds(threshold_mps, 4)


def test_a_vehicle_that_obeys_has_none() -> None:
    # What noise alone makes significant in a log cut elsewhere is no threshold.
    check_obedient(4)


@pytest.mark.parametrize("veer_radps", [0.005, 0.01, 0.02])
def test_small_commands_against_a_slip_are_not_ignored_ones(veer_radps: float) -> None:
    """A vehicle that obeys, and that only goes straight while it is steered a little."""
    check_slipping(0.0, veer_radps, 3)
    check_slipping(0.15, veer_radps, 1)


def test_logs_that_say_nothing_are_refused() -> None:
    time_s = np.arange(0.0, 60.0, 0.1)
    still = np.zeros(len(time_s))
    for bad, place, values in (
        ((time_s, still, still), "control threshold", (1,)),
        ((time_s[:50], still[:50], still[:50]), "control threshold", (50,)),
        ((time_s, np.full(len(time_s), np.nan), still), "control threshold", ()),
    ):
        with refused(place, *values, error=NotExcitedError):
            fit_threshold(*bad)
    with refused("limit cycle", 9.9, error=NotExcitedError):
        find_limit_cycle(time_s[:100], still[:100])
    with refused("limit cycle", error=NotExcitedError):
        find_limit_cycle(time_s, np.full(len(time_s), np.nan))
    assert not find_limit_cycle(time_s, still).found
