"""Calibration 1 on simulated drives: the value, its interval over many draws, and the logs that it refuses."""

from functools import cache

import numpy as np
import pytest

from lgprjax.scene.motion import drive_straight, drive_turns, turn_standing
from lgprjax.scene.vehicle_drive import DriveTruth, TrueVehicle, VehicleSensors, drive_manoeuvre, read_vehicle
from lgprjax.tuning import DriveSignals, NotExcitedError, fit_straight
from refusals import refused
from turning_drives import covered_band

DEGREE = np.pi / 180.0
DRAWS = 150
VEHICLE = TrueVehicle()
DRIVE = drive_straight(60.0, 5.0, weave_rad=0.2 * DEGREE)


@cache
def truth() -> DriveTruth:
    return drive_manoeuvre(VEHICLE, DRIVE)


def log(seed: int = 0, sensors: VehicleSensors | None = None) -> DriveSignals:
    return read_vehicle(VEHICLE, DRIVE, truth(), sensors or VehicleSensors(), seed)


@pytest.mark.parametrize(
    "sensors",
    [VehicleSensors(), VehicleSensors(spike_share=0.03, heading_wander_rad=0.05 * DEGREE, record_hz=25.0)],
    ids=["white", "spikes and a heading that wanders"],
)
def test_the_interval_covers(sensors: VehicleSensors) -> None:
    found = np.array([fit_straight(log(seed, sensors)).potentiometer_v for seed in range(DRAWS)])
    covered = np.mean((found[:, 2] <= 2.43) & (found[:, 3] >= 2.43))
    low, high = covered_band(DRAWS)
    assert low <= covered <= high
    assert np.abs(found[:, 0] - 2.43).max() < 0.002  # 2 mV are 0.06° at the wheel
    assert np.mean(found[:, 3] - found[:, 2]) < 0.002


def test_a_driver_who_pulls_to_one_side_at_the_end_does_not_shift_the_value() -> None:
    # Half a degree to the left over the last third: the mean voltage is off by 6 mV.
    told = DRIVE._replace(wanted_rad=np.where(DRIVE.time_s > 13.0, 0.5 * DEGREE, DRIVE.wanted_rad))
    signals = read_vehicle(VEHICLE, told, drive_manoeuvre(VEHICLE, told), VehicleSensors(), 1)
    assert signals.potentiometer_v is not None
    assert abs(np.mean(signals.potentiometer_v) - 2.43) > 0.003
    assert fit_straight(signals).potentiometer_v.value == pytest.approx(2.43, abs=0.001)


def test_turns_are_left_out_and_gaps_do_no_harm() -> None:
    there = drive_turns([4.0], [10.0 * DEGREE], hold_s=4.0)
    before = DRIVE._replace(
        time_s=np.arange(DRIVE.time_s.size + there.time_s.size) * 0.01,
        wanted_rad=np.append(DRIVE.wanted_rad, there.wanted_rad),
        speed_mps=np.append(DRIVE.speed_mps, there.speed_mps),
        supply_v=np.append(DRIVE.supply_v, there.supply_v),
    )
    driven = drive_manoeuvre(VEHICLE, before)
    sensors = VehicleSensors(record_gaps_s=((8.0, 10.0),), gnss_gaps_s=((0.0, 100.0),))
    fit = fit_straight(read_vehicle(VEHICLE, before, driven, sensors, 3))
    assert fit.turning >= 3
    assert np.abs(fit.curvature_radpm).max() < 0.005
    assert fit.potentiometer_v.low <= 2.43 <= fit.potentiometer_v.high


def test_the_slope_is_volts_over_the_curvature_that_the_wheels_make() -> None:
    drive = drive_straight(200.0, 4.0, weave_rad=0.6 * DEGREE, weave_m=60.0)
    fit = fit_straight(read_vehicle(VEHICLE, drive, drive_manoeuvre(VEHICLE, drive), VehicleSensors(), 2))
    gain = 1.0 / (1.0 + (4.0 / 20.0) ** 2)
    assert fit.slope_vm.value == pytest.approx(2.0 * 3.8 / 1.63 / gain, rel=0.05)


def test_logs_that_cannot_tell_are_refused() -> None:
    signals = log()
    still = turn_standing(0.5, 5.0)
    turning = drive_turns([4.0], [10.0 * DEGREE, -10.0 * DEGREE], hold_s=20.0)
    short = drive_straight(20.0, 3.0)
    noise = np.random.default_rng(0).uniform(0.0, 5.0, signals.time_s.size)
    made: list[tuple[DriveSignals, tuple[object, ...]]] = [
        (read_vehicle(VEHICLE, told, drive_manoeuvre(VEHICLE, told), VehicleSensors(), 0), values)
        for told, values in ((still, (40,)), (turning, (5,)), (short, (40,)))
    ]
    made += [
        (signals._replace(potentiometer_v=None), ()),
        (signals._replace(potentiometer_v=np.full(noise.size, 2.4)), (2.4,)),
        (signals._replace(potentiometer_v=noise), (0.2,)),
        (signals._replace(yaw_rad=np.full(noise.size, np.nan)), (40, 0.0)),
    ]
    for refusal, values in made:
        with refused("straight potentiometer value", *values, error=NotExcitedError):
            fit_straight(refusal)
