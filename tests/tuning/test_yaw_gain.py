"""V_CHAR from turning tests at 1 to 8 m/s: its interval, and what it is not to be misled by."""

import numpy as np
import pytest

from lgprjax.scene.motion import drive_turns
from lgprjax.scene.vehicle_drive import TrueVehicle, VehicleSensors, simulate_vehicle_drive
from lgprjax.tuning import NotExcitedError
from refusals import refused
from turning_drives import Leg, Noise, covered_band, drive, measured
from validation.vehicles.intervals import SPEEDS_MPS, turns, yaw_gain_shares
from validation.vehicles.intervals import yaw_gain_of as fitted


def test_speed_without_noise_is_the_truth() -> None:
    fit = fitted(drive(turns(), characteristic_mps=20.0))
    assert fit.characteristic_speed_mps.value == pytest.approx(20.0, rel=1e-4)
    np.testing.assert_allclose(fit.gain, 1.0 / (1.0 + (fit.speed_mps / 20.0) ** 2), rtol=1e-4)


def test_speed_and_its_interval() -> None:
    draws = 40
    held, worst = yaw_gain_shares(draws, Noise(front_rad=np.radians(0.1)))
    low, high = covered_band(draws)
    assert low <= held <= high
    assert worst < 0.05


def test_wheel_angles_that_are_wrong_do_not_mislead() -> None:
    """Four per cent too large and 0.4° too far to the left: both are told."""
    noisy = measured(drive(turns(), characteristic_mps=20.0), Noise(), np.random.default_rng(1))
    assert noisy.front_rad is not None
    fit = fitted(noisy._replace(front_rad=1.04 * noisy.front_rad + 0.007))
    assert fit.characteristic_speed_mps.value == pytest.approx(20.0, rel=0.02)
    assert fit.scale.value == pytest.approx(1.04, abs=0.01)
    assert fit.offset_rad == pytest.approx(0.007, abs=7e-4)


def test_front_wheels_alone_at_the_angles_that_a_crew_is_asked_for() -> None:
    """Some 6 degrees: half of it, or twice as much, is no harm."""
    degree = np.pi / 180.0
    for angle in (4.5, 5.7, 12.0):
        told = drive_turns(SPEEDS_MPS, [angle * degree, -angle * degree])
        vehicle = TrueVehicle(rear=0.0, characteristic_speed_mps=18.0)
        found = fitted(simulate_vehicle_drive(vehicle, told, VehicleSensors(), seed=5).signals, ratio=0.0)
        assert found.characteristic_speed_mps.value == pytest.approx(18.0, rel=0.04), angle


def test_turns_to_one_side_and_no_loss_at_all() -> None:
    one_side = measured(drive(turns(sides=(1,)), characteristic_mps=20.0), Noise(), np.random.default_rng(2))
    fit = fitted(one_side)
    assert fit.offset_rad == 0.0
    assert fit.characteristic_speed_mps.value == pytest.approx(20.0, rel=0.05)
    rigid = drive(turns())
    none = [
        fitted(measured(rigid, Noise(), np.random.default_rng([seed, 4]))).characteristic_speed_mps
        for seed in range(10)
    ]
    assert sum(v.high == np.inf for v in none) >= 8
    assert min(v.low for v in none) > 60.0


def test_speed_of_a_simulated_vehicle_with_gaps_and_outliers() -> None:
    degree = np.pi / 180.0
    told = drive_turns(SPEEDS_MPS, [8.0 * degree, -8.0 * degree, 14.0 * degree, -14.0 * degree])
    faults = VehicleSensors(outlier_share=0.03, gnss_gaps_s=((100.0, 104.0),))
    fit = fitted(simulate_vehicle_drive(TrueVehicle(), told, faults, seed=4).signals)
    assert fit.characteristic_speed_mps.value == pytest.approx(20.0, rel=0.05)


def test_logs_that_cannot_tell_are_refused() -> None:
    with refused("turning tests", 2, error=NotExcitedError, found="4.0 to 6.0 m/s"):
        fitted(drive(turns(speeds=(4.0, 6.0)), characteristic_mps=20.0))
    with refused("turning tests", 6, error=NotExcitedError, found=0):
        fitted(drive([Leg(0.005 * n, 20.0, 2.0) for n in range(-3, 4)]))
