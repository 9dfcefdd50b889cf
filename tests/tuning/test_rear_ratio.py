"""k by heading and by wheel angles, the interval of each, the map of the rear wheels, and the logs that cannot tell."""

import numpy as np
import pytest

from lgprjax.scene.motion import drive_palm_tree
from lgprjax.scene.vehicle_drive import TrueVehicle, VehicleSensors, simulate_vehicle_drive
from lgprjax.tuning import NotExcitedError
from lgprjax.tuning.robust import student_95
from lgprjax.tuning.steering import drifting_fit, fit_rear_map, rear_ratio_by_angles, rear_ratio_by_heading
from lgprjax.vehicle.sensors import DriveSignals
from refusals import refused
from turning_drives import RATIO, Noise, arcs_of, chassis, covered_band, drive, gauss_markov, measured, palm_legs
from validation.vehicles.intervals import ratio_shares

DRAWS = 40


def test_ratio_without_noise_is_the_truth() -> None:
    fit = rear_ratio_by_heading(
        arcs_of(measured(drive(palm_legs()), Noise(*[0.0] * 8), np.random.default_rng(0))), chassis(0.0)
    )
    assert fit.ratio.value == pytest.approx(RATIO, abs=2e-5)


def test_ratio_and_its_interval() -> None:
    held, spread = ratio_shares(DRAWS, Noise())
    low, high = covered_band(DRAWS)
    assert low <= held <= high
    assert 2.0 * spread < 0.01


def test_interval_of_a_fit_with_drift_covers() -> None:
    """The last step alone, with the drift given as it is."""
    draws = 150
    rng, time_s = np.random.default_rng(3), np.arange(22) * 15.0
    design = np.stack([np.ones(22), np.linspace(0.23, -0.23, 22)], axis=1)
    sigma, held = np.linspace(0.4, 1.6, 22) * 1e-3, 0
    for _ in range(draws):
        error = rng.normal(size=22) * sigma + 1.7e-3 * gauss_markov(rng, 22, float(np.exp(-15.0 / 60.0)))
        fit = drifting_fit(design, error, sigma, time_s, drift_seen=True)
        held += abs(fit.coefficients[1]) <= student_95(fit.degrees) * fit.covariance[1, 1] ** 0.5
    low, high = covered_band(draws)
    assert low <= held / draws <= high


def test_heading_askew_is_told_apart_from_the_ratio() -> None:
    noisy = measured(drive(palm_legs()), Noise(), np.random.default_rng(4), 0.03)
    fit = rear_ratio_by_heading(arcs_of(noisy), chassis(0.0))
    assert fit.offset_rad.low <= 0.03 <= fit.offset_rad.high
    assert fit.offset_rad.value == pytest.approx(0.03, abs=2e-3)
    assert fit.ratio.value == pytest.approx(RATIO, abs=0.01)


def test_ratio_of_a_simulated_vehicle_that_loses_yaw() -> None:
    vehicle = TrueVehicle()
    told = drive_palm_tree(vehicle.wheelbase_m, 0.63, vehicle.largest_angle_rad, vehicle.lock_to_lock_turns)
    faults = VehicleSensors(outlier_share=0.03, heading_bias_rad=-0.02, gnss_gaps_s=((80.0, 85.0),))
    signals, _ = simulate_vehicle_drive(vehicle, told, faults, seed=3)
    fit = rear_ratio_by_heading(arcs_of(signals), chassis(0.0, vehicle.characteristic_speed_mps))
    assert fit.ratio.value == pytest.approx(0.63, abs=0.01)
    assert fit.ratio.low <= 0.63 <= fit.ratio.high
    angles = rear_ratio_by_angles(signals)
    assert angles.ratio.value == pytest.approx(0.63, abs=0.001)


def test_interval_by_wheel_angles_covers() -> None:
    draws = 60
    rng, clean = np.random.default_rng(5), drive(palm_legs())
    assert clean.front_rad is not None
    assert clean.rear_rad is not None
    held, size = 0, len(clean.time_s)
    for _ in range(draws):
        noisy = clean._replace(
            front_rad=clean.front_rad + rng.normal(size=size) * 0.002,
            rear_rad=clean.rear_rad + 0.004 + rng.normal(size=size) * 0.002,
        )
        fit = rear_ratio_by_angles(noisy)
        held += fit.ratio.low <= RATIO <= fit.ratio.high
    assert fit.offset_rad.value == pytest.approx(0.004, abs=5e-4)
    low, high = covered_band(draws)
    assert low <= held / draws <= high


def test_curvature_alone_is_refused() -> None:
    clean = drive(palm_legs())
    blind = clean._replace(yaw_rad=np.full(len(clean.time_s), np.nan), rear_rad=None)
    with refused("k", "(1 + k) φ", error=NotExcitedError):
        rear_ratio_by_heading(arcs_of(blind), chassis(0.0))
    with refused("k", "(1 + k) φ", error=NotExcitedError):
        rear_ratio_by_angles(blind)


def test_logs_that_cannot_tell_the_ratio_are_refused() -> None:
    with refused("k", 0.026, error=NotExcitedError, found="to 0.2"):
        rear_ratio_by_heading(arcs_of(drive(palm_legs()[:12])), chassis(0.0))
    clean = drive(palm_legs())
    course = np.unwrap(np.arctan2(np.gradient(clean.north_m), np.gradient(clean.east_m)))
    with refused("INS heading", error=NotExcitedError):
        rear_ratio_by_heading(arcs_of(clean._replace(yaw_rad=course)), chassis(0.0))
    straight = clean._replace(front_rad=0.0 * clean.time_s, rear_rad=0.0 * clean.time_s)
    with refused("front_rad", 0.1, error=NotExcitedError, found=0.000):
        rear_ratio_by_angles(straight)


def test_interval_of_the_rear_map() -> None:
    rng, front = np.random.default_rng(7), 0.52 * np.sin(np.arange(0.0, 120.0, 0.1) / 6.0)
    clean, held = drive(palm_legs()), np.zeros(9)
    size = len(front)
    none = np.zeros(size)
    for _ in range(DRAWS):
        log = clean._replace(
            time_s=np.arange(size) * 0.1,
            east_m=none,
            front_rad=front + rng.normal(size=size) * 1e-4,
            rear_rad=-RATIO * front + rng.normal(size=size) * 0.002,
        )
        fit = fit_rear_map(log)
        held += (fit.low_rad <= RATIO * fit.front_rad) & (fit.high_rad >= RATIO * fit.front_rad)
    low, high = covered_band(DRAWS)
    assert np.all((low <= held / DRAWS) & (held / DRAWS <= high))


def test_map_of_the_rear_wheels_and_its_comparison() -> None:
    """A linkage in which sin ψ = 0.6 sin φ: k falls to 0.582 at 30°."""
    rng, front = np.random.default_rng(6), 0.52 * np.sin(np.arange(0.0, 120.0, 0.02) / 6.0)
    size = len(front)
    none = np.zeros(size)
    log = DriveSignals(
        np.arange(size) * 0.02,
        none,
        none,
        none,
        none,
        none,
        none,
        front_rad=front + rng.normal(size=size) * 0.002,
        rear_rad=-np.arcsin(0.6 * np.sin(front)) + rng.normal(size=size) * 0.002,
    )
    fit = fit_rear_map(log)
    truth = np.arcsin(0.6 * np.sin(fit.front_rad))
    # A curve between knots is not the chord that was fitted: that is the larger part of what is left.
    np.testing.assert_allclose(np.asarray(fit.rear.rear_rad), truth, atol=1e-3)
    with refused("front_rad", 9, error=NotExcitedError):
        fit_rear_map(log._replace(front_rad=np.where(np.arange(size) < size // 2, -0.5, 0.5)))
