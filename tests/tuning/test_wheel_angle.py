"""Palm tree: the steering map found from 2 cm positions, its band, and the logs that it refuses."""

import numpy as np
import pytest

from lgprjax.scene.motion import drive_palm_tree
from lgprjax.scene.vehicle_drive import TrueVehicle, VehicleSensors, chassis_of, simulate_vehicle_drive
from lgprjax.tuning import NotExcitedError
from lgprjax.tuning.arcs import find_stretches, fit_arcs
from lgprjax.tuning.robust import student_95, weighted_fit
from lgprjax.tuning.steering import fit_wheel_angle, front_angle
from refusals import refused
from turning_drives import arcs_of, chassis, covered_band, drive, palm_legs
from validation.vehicles.intervals import band_shares, rms_deg


def test_map_without_noise_is_the_truth() -> None:
    fit = fit_wheel_angle(arcs_of(drive(palm_legs())), chassis())
    assert rms_deg(fit) < 2e-4
    assert fit.extra_rad < 1e-9


def test_map_and_its_band_from_2_cm_positions() -> None:
    draws = 40
    held, worst = band_shares(draws)
    low, high = covered_band(draws)
    assert np.all((low <= held) & (held <= high))
    assert worst <= 0.2


def test_weighted_intervals_cover() -> None:
    """The last step of the map alone: eleven settings of unequal standard errors."""
    draws = 200
    rng, u = np.random.default_rng(3), np.linspace(-1.0, 1.0, 11)
    design, truth = np.vander(u, 4, increasing=True), np.array([0.01, 0.5, -0.02, 0.03])
    sigma, rows = 0.0003 + 0.0015 * u**2, np.vander(np.linspace(-1.0, 1.0, 5), 4, increasing=True)
    held = np.zeros(len(rows))
    for _ in range(draws):
        fit = weighted_fit(design, design @ truth + rng.normal(size=11) * sigma, sigma)
        half = student_95(fit.degrees) * np.sqrt(np.einsum("rc,cd,rd->r", rows, fit.covariance, rows))
        held += np.abs(rows @ (fit.coefficients - truth)) <= half
    low, high = covered_band(draws)
    assert np.all((low <= held / draws) & (held / draws <= high))


def test_scatter_that_the_arcs_do_not_explain_is_told() -> None:
    rng, u = np.random.default_rng(4), np.linspace(-1.0, 1.0, 40)
    design, sigma = np.vander(u, 2, increasing=True), np.full(40, 0.001)
    found = [weighted_fit(design, rng.normal(size=40) * np.hypot(sigma, 0.01), sigma).extra for _ in range(50)]
    assert np.sqrt(np.mean(np.square(found))) == pytest.approx(0.01, rel=0.08)


def test_loss_of_yaw_is_taken_off_at_speed() -> None:
    fast = arcs_of(drive(palm_legs(speed_mps=4.0), characteristic_mps=20.0))
    assert rms_deg(fit_wheel_angle(fast, chassis(characteristic_mps=20.0))) < 0.01
    assert rms_deg(fit_wheel_angle(fast, chassis())) > 0.3


def test_map_of_a_simulated_vehicle_with_gaps_and_outliers() -> None:
    vehicle = TrueVehicle(potentiometer_per_rad_v=(2.0, 0.15, -0.3))
    told = drive_palm_tree(vehicle.wheelbase_m, 0.63, vehicle.largest_angle_rad, vehicle.lock_to_lock_turns)
    faults = VehicleSensors(outlier_share=0.03, gnss_gaps_s=((60.0, 66.0), (150.0, 151.0)), spike_share=0.01)
    signals, truth = simulate_vehicle_drive(vehicle, told, faults, seed=2)
    fit = fit_wheel_angle(arcs_of(signals), chassis_of(vehicle))
    volts = 2.43 + 2.0 * truth.front_rad + 0.15 * truth.front_rad**2 - 0.3 * truth.front_rad**3
    wrong = np.degrees(front_angle(fit.map, volts) - truth.front_rad)
    assert np.sqrt(np.mean(wrong**2)) < 0.2
    assert len(fit.steering) == 11


def test_logs_that_hold_no_palm_tree_are_refused() -> None:
    legs = palm_legs()
    with refused("palm tree", "6.0°", error=NotExcitedError, found="30.0°"):
        fit_wheel_angle(arcs_of(drive(legs[:12])), chassis())
    with refused("fit", 7, error=NotExcitedError, found=3):
        fit_wheel_angle(arcs_of(drive(palm_legs(3))), chassis())
    folded = drive(legs)
    assert folded.front_rad is not None
    volts = 2.0 + np.abs(folded.front_rad + 0.01)
    with refused("palm tree", error=NotExcitedError):
        fit_wheel_angle(fit_arcs(folded, find_stretches(folded, volts)), chassis())
