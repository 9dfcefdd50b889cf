"""Simulated calibration drives: motion by wheel geometry in float64, manoeuvres as told, noise and faults by figure."""

from dataclasses import replace

import numpy as np
import pytest
from jaxtyping import Float
from scipy.integrate import solve_ivp

from lgprjax.scene.motion import (
    Manoeuvre,
    drive_palm_tree,
    drive_straight,
    drive_turns,
    half_turn_angles,
    step_pedals,
    step_steering,
    turn_standing,
)
from lgprjax.scene.vehicle_drive import (
    TrueVehicle,
    VehicleSensors,
    drive_manoeuvre,
    read_vehicle,
    read_yaw_rate,
    simulate_vehicle_drive,
)
from lgprjax.vehicle import Linkage

DEGREE = np.pi / 180.0
VEHICLE = TrueVehicle()
QUIET = VehicleSensors(
    position_sigma_m=0.0,
    heading_sigma_rad=0.0,
    front_sigma_rad=0.0,
    rear_sigma_rad=0.0,
    potentiometer_sigma_v=0.0,
    odometer_scale_error=0.0,
    odometer_sigma_m=0.0,
)
PALM = drive_palm_tree(3.8, 0.63, VEHICLE.largest_angle_rad, 5.0)


def test_the_rear_axle_goes_where_wheels_that_do_not_slip_lead_it() -> None:
    vehicle = replace(VEHICLE, characteristic_speed_mps=6.0)
    told = drive_turns([2.0, 4.0], [15.0 * DEGREE, -8.0 * DEGREE], hold_s=6.0)
    truth = drive_manoeuvre(vehicle, told)

    def rate(time_s: float, pose: Float[np.ndarray, "3"]) -> list[float]:
        speed, front = (np.interp(time_s, truth.time_s, part) for part in (truth.speed_mps, truth.front_rad))
        gain = 1.0 / (1.0 + (speed / 6.0) ** 2)
        aside = -gain * np.tan(0.63 * front)
        cos, sin = np.cos(pose[2]), np.sin(pose[2])
        turning = gain * (np.tan(front) + np.tan(0.63 * front)) / 3.8
        return [speed * (cos - sin * aside), speed * (sin + cos * aside), speed * turning]

    solved = solve_ivp(rate, (0.0, truth.time_s[-1]), [0.0, 0.0, 0.0], rtol=1e-8, atol=1e-8, max_step=0.02)
    found = [truth.east_m[-1], truth.north_m[-1], truth.yaw_rad[-1]]
    # The simulation holds an angle over each step of 10 ms.
    np.testing.assert_allclose(found[:2], solved.y[:2, -1], atol=0.05)
    assert found[2] == pytest.approx(solved.y[2, -1], abs=2e-3)


def test_wheels_and_sensors_follow_the_hand_behind_the_play() -> None:
    truth = drive_manoeuvre(VEHICLE, turn_standing(VEHICLE.largest_angle_rad, 5.0))
    np.testing.assert_allclose(np.abs(truth.motor_rad - truth.steering_rad).max(), 0.15 * DEGREE, atol=1e-6)
    np.testing.assert_allclose(truth.rear_rad, -0.63 * truth.front_rad, atol=1e-7)
    assert np.ptp(truth.travel_m) == np.ptp(truth.east_m) == 0.0


def test_a_linkage_lies_between_the_sensors_and_the_wheels() -> None:
    vehicle = replace(VEHICLE, linkage=Linkage(0.3, 0.4, 0.5))
    truth = drive_manoeuvre(vehicle, turn_standing(VEHICLE.largest_angle_rad, 5.0))
    shaft = np.arcsin(4.0 / 3.0 * np.sin(truth.front_rad)) / 0.5
    np.testing.assert_allclose(truth.steering_rad, 0.375 * shaft, atol=1e-6)
    assert np.abs(truth.steering_rad - truth.front_rad).max() > 0.5 * DEGREE


def test_the_palm_tree_comes_back_to_its_root() -> None:
    truth = drive_manoeuvre(VEHICLE, PALM)
    standing = np.flatnonzero((truth.speed_mps == 0.0) & (np.abs(truth.travel_m) < 1e-3))
    assert np.hypot(truth.east_m[standing], truth.north_m[standing]).max() < 0.01
    outward = truth.speed_mps > 0.5
    reached = np.unique(PALM.wanted_rad[outward].round(6))
    np.testing.assert_allclose(reached, half_turn_angles(VEHICLE.largest_angle_rad, 5.0)[::-1], atol=1e-6)
    np.testing.assert_allclose(half_turn_angles(0.5, 2.5), [0.5, 0.4, 0.2, 0.0, -0.2, -0.4, -0.5], atol=1e-12)
    assert np.ptp(truth.yaw_rad) == pytest.approx(np.pi, rel=0.02)  # a quarter circle to either side


def test_the_servo_steers_where_the_hand_does_not() -> None:
    told = step_steering([0.1], hold_s=3.0, sweep_rad=0.05)
    drive = simulate_vehicle_drive(VEHICLE, told, QUIET)
    settled = np.searchsorted(drive.truth.time_s, 3.9)
    # Short of the command by the dead band and half the play.
    assert drive.truth.front_rad[settled] == pytest.approx(0.1 - (0.2 + 0.15) * DEGREE, abs=1e-4)
    assert drive.signals.command_rad is not None
    swept = (told.time_s > 10.0) & (told.time_s < 50.0)
    assert np.abs(told.wanted_rad[swept]).max() == pytest.approx(0.05, rel=1e-3)


def test_pedals_drive_the_vehicle_from_standstill_to_standstill() -> None:
    told = step_pedals([0.3, 0.5], [0.5, 0.6])
    drive = simulate_vehicle_drive(VEHICLE, told, QUIET)
    speed = drive.truth.speed_mps
    assert speed.max() > 2.0
    assert speed[0] == speed[-1] == 0.0
    np.testing.assert_allclose(drive.truth.travel_m, np.cumsum(speed) * 0.01, atol=0.05)
    assert drive.signals.throttle is not None


def test_without_noise_the_log_is_the_truth() -> None:
    signals, truth = simulate_vehicle_drive(VEHICLE, PALM, QUIET, seed=4)
    fixed = np.isfinite(signals.east_m)
    assert np.count_nonzero(fixed) == np.ceil(PALM.time_s[-1] * 10.0)
    every = slice(0, None, 2)
    np.testing.assert_allclose(signals.time_s, truth.time_s[every])
    np.testing.assert_allclose(signals.north_m[fixed], truth.north_m[every][fixed])
    np.testing.assert_allclose(signals.yaw_rad, truth.yaw_rad[every])
    np.testing.assert_allclose(signals.travel_m, truth.travel_m[every])
    assert signals.potentiometer_v is not None
    np.testing.assert_allclose(signals.potentiometer_v, 2.43 + 2.0 * truth.steering_rad[every])
    assert signals.encoder_counts is not None
    away = signals.encoder_counts - 12000.0 * truth.motor_rad[every]
    assert np.ptp(away) <= 1.0
    assert (signals.command_rad, signals.throttle) == (None, None)  # a hand steers and drives


STILL_LONG = Manoeuvre(*(np.zeros(60_000),) * 4, True)._replace(time_s=np.arange(60_000) * 0.01)


def test_noise_has_its_sigma() -> None:
    sensors = VehicleSensors(
        position_wander_m=0.1, position_wander_s=5.0, outlier_share=0.02, spike_share=0.05, heading_bias_rad=0.01
    )
    bare = simulate_vehicle_drive(VEHICLE, STILL_LONG, seed=2).signals
    noisy = simulate_vehicle_drive(VEHICLE, STILL_LONG, sensors, seed=2).signals
    fixed = np.isfinite(bare.east_m)
    assert np.std(bare.east_m[fixed]) == pytest.approx(0.02, rel=0.05)
    assert np.std(bare.yaw_rad) == pytest.approx(0.05 * DEGREE, rel=0.05)
    assert bare.potentiometer_v is not None
    assert np.std(bare.potentiometer_v) == pytest.approx(0.004, rel=0.05)
    added = (noisy.east_m - bare.east_m)[fixed]
    displaced = np.abs(added - np.median(added)) > 0.6
    assert np.mean(displaced) == pytest.approx(0.02 * 0.76, rel=0.3)  # most of a sigma of 2 m
    assert np.std(added[~displaced]) == pytest.approx(0.1, rel=0.35)
    assert noisy.potentiometer_v is not None
    assert np.mean(noisy.potentiometer_v != bare.potentiometer_v) == pytest.approx(0.05, rel=0.1)
    np.testing.assert_allclose(noisy.yaw_rad - bare.yaw_rad, 0.01, atol=1e-12)
    # Navigation knows nothing of its slow error.
    np.testing.assert_array_equal(noisy.sigma_position_m, 0.02)


def test_a_gyro_reads_the_yaw_rate_with_noise_of_its_density_and_a_bias_that_walks() -> None:
    truth = drive_manoeuvre(VEHICLE, drive_turns([2.0], [10.0 * DEGREE, -10.0 * DEGREE], hold_s=6.0))
    bare = read_yaw_rate(truth, replace(QUIET, yaw_rate_noise=0.0), 1)
    # What is read adds up to the turn.
    turned = np.append(0.0, np.cumsum(0.5 * (bare[1:] + bare[:-1]) * 0.02))
    np.testing.assert_allclose(turned, truth.yaw_rad[::2] - truth.yaw_rad[0], atol=1e-3)
    still = drive_manoeuvre(VEHICLE, STILL_LONG)
    noisy = read_yaw_rate(still, replace(QUIET, yaw_rate_noise=2e-3, yaw_rate_bias_radps=0.01), 1)
    assert noisy.size == 30_000
    # Summed over a second the noise is the density, whatever the rate of the records.
    summed = noisy.reshape(-1, 50).sum(axis=1) * 0.02
    assert summed.mean() == pytest.approx(0.01, abs=4 * 2e-3 / np.sqrt(600))
    assert summed.std() == pytest.approx(2e-3, rel=0.1)
    walking = read_yaw_rate(still, replace(QUIET, yaw_rate_noise=0.0, yaw_rate_bias_walk=1e-4), 1)
    steps = np.diff(walking[::50])
    assert steps.std() == pytest.approx(1e-4, rel=0.1)
    lost = replace(QUIET, record_gaps_s=((20.0, 21.0),))
    assert read_yaw_rate(still, lost, 1).size == noisy.size - 50


def test_lost_seconds_are_lost() -> None:
    sensors = VehicleSensors(gnss_gaps_s=((10.0, 12.0),), record_gaps_s=((20.0, 21.0),))
    signals = simulate_vehicle_drive(VEHICLE, STILL_LONG, sensors).signals
    within = (signals.time_s >= 10.0) & (signals.time_s < 12.0)
    assert np.isnan(signals.east_m[within]).all()
    assert np.isfinite(signals.yaw_rad[within]).all()
    assert not ((signals.time_s >= 20.0) & (signals.time_s < 21.0)).any()
    assert all(part is None or part.size == signals.time_s.size for part in signals)


def test_another_seed_is_another_noise_and_another_zero_of_the_encoder() -> None:
    truth = drive_manoeuvre(VEHICLE, PALM)
    one, same, other = (read_vehicle(VEHICLE, PALM, truth, VehicleSensors(), seed) for seed in (1, 1, 2))
    np.testing.assert_array_equal(one.yaw_rad, same.yaw_rad)
    assert one.encoder_counts is not None
    assert other.encoder_counts is not None
    assert abs(one.encoder_counts[0] - other.encoder_counts[0]) > 100.0
    assert (one.yaw_rad != other.yaw_rad).all()


def test_rates_that_do_not_fit_are_refused() -> None:
    short = drive_straight(5.0, 1.0)
    for sensors, value in (
        (VehicleSensors(record_hz=30.0), "30"),
        (VehicleSensors(record_hz=10.0, gnss_hz=20.0), "20"),
    ):
        with pytest.raises(ValueError, match=value):
            simulate_vehicle_drive(VEHICLE, short, sensors)
