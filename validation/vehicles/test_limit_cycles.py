"""Limit cycles and thresholds in many drives."""

import pytest

from validation.vehicles.limit_cycles import (
    alarms_of_noise,
    check_obedient,
    check_slipping,
    check_thresholds,
    false_alarms,
)


def test_false_alarms() -> None:
    assert false_alarms(20) <= 1
    assert alarms_of_noise(100) <= 2


@pytest.mark.parametrize("threshold_mps", [0.15, 0.3])
def test_thresholds(threshold_mps: float) -> None:
    check_thresholds(threshold_mps, 8)


def test_vehicles_that_obey() -> None:
    check_obedient(10)


@pytest.mark.parametrize("veer_radps", [0.005, 0.01, 0.02, 0.04])
@pytest.mark.parametrize("threshold_mps", [0.0, 0.1, 0.3])
def test_vehicles_whose_sides_slip(threshold_mps: float, veer_radps: float) -> None:
    check_slipping(threshold_mps, veer_radps, 10)
