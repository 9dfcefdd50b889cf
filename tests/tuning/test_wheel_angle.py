"""Palm tree: the steering map found from 2 cm positions, its band, and the logs that it refuses."""

import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import Bool, Float

from lgprjax.scene.motion import drive_palm_tree
from lgprjax.scene.vehicle_drive import TrueVehicle, VehicleSensors, chassis_of, simulate_vehicle_drive
from lgprjax.tuning import NotExcitedError
from lgprjax.tuning.arcs import Arcs, find_stretches, fit_arcs
from lgprjax.tuning.robust import student_95, weighted_fit
from lgprjax.tuning.steering import WheelAngleFit, fit_wheel_angle, front_angle, front_band
from lgprjax.vehicle.kinematics import Chassis, ProportionalRear
from lgprjax.vehicle.sensors import DriveSignals
from turning_drives import (
    LARGEST_RAD,
    PER_RAD_V,
    RATIO,
    STRAIGHT_V,
    WHEELBASE_M,
    Noise,
    covered_band,
    drive,
    measured,
    palm_legs,
)

AT_RAD = np.linspace(-0.98, 0.98, 9) * LARGEST_RAD


def chassis(characteristic_mps: float = np.inf) -> Chassis:
    return Chassis(
        jnp.float32(WHEELBASE_M),
        jnp.float32(0.0),
        ProportionalRear(jnp.float32(RATIO)),
        jnp.float32(LARGEST_RAD),
        jnp.float32(characteristic_mps),
    )


def arcs_of(signals: DriveSignals) -> Arcs:
    assert signals.potentiometer_v is not None
    return fit_arcs(signals, find_stretches(signals, signals.potentiometer_v))


def rms_deg(fit: WheelAngleFit) -> float:
    wrong = front_angle(fit.map, STRAIGHT_V + PER_RAD_V * AT_RAD) - AT_RAD
    return float(np.degrees(np.sqrt(np.mean(wrong**2))))


def band_holds(fit: WheelAngleFit) -> Bool[np.ndarray, " angle"]:
    low, high = front_band(fit.map, STRAIGHT_V + PER_RAD_V * AT_RAD)
    return np.asarray((low <= AT_RAD) & (high >= AT_RAD))


def drawn_bands(draws: int) -> tuple[Float[np.ndarray, " angle"], float]:
    """Share of draws in which the band holds at each angle, and the largest RMS in degrees."""
    clean, held, worst = drive(palm_legs()), np.zeros(len(AT_RAD)), 0.0
    for seed in range(draws):
        fit = fit_wheel_angle(arcs_of(measured(clean, Noise(), np.random.default_rng([seed, 1]))), chassis())
        held += band_holds(fit)
        worst = max(worst, rms_deg(fit))
    return held / draws, worst


def test_map_without_noise_is_the_truth() -> None:
    fit = fit_wheel_angle(arcs_of(drive(palm_legs())), chassis())
    assert rms_deg(fit) < 2e-4
    assert fit.extra_rad < 1e-9


def test_map_and_its_band_from_2_cm_positions() -> None:
    held, worst = drawn_bands(300)
    low, high = covered_band(300)
    assert np.all((low <= held) & (held <= high))
    assert worst <= 0.2


@pytest.mark.campaign
def test_band_of_the_map_in_2000_draws() -> None:
    held, worst = drawn_bands(2000)
    low, high = covered_band(2000)
    assert np.all((low <= held) & (held <= high))
    assert worst <= 0.2


def test_weighted_intervals_cover_2000_draws() -> None:
    """The last step of the map alone: eleven settings of unequal standard errors."""
    rng, u = np.random.default_rng(3), np.linspace(-1.0, 1.0, 11)
    design, truth = np.vander(u, 4, increasing=True), np.array([0.01, 0.5, -0.02, 0.03])
    sigma, rows = 0.0003 + 0.0015 * u**2, np.vander(np.linspace(-1.0, 1.0, 5), 4, increasing=True)
    held = np.zeros(len(rows))
    for _ in range(2000):
        fit = weighted_fit(design, design @ truth + rng.normal(size=11) * sigma, sigma)
        half = student_95(fit.degrees) * np.sqrt(np.einsum("rc,cd,rd->r", rows, fit.covariance, rows))
        held += np.abs(rows @ (fit.coefficients - truth)) <= half
    low, high = covered_band(2000)
    assert np.all((low <= held / 2000) & (held / 2000 <= high))


def test_scatter_that_the_arcs_do_not_explain_is_told() -> None:
    rng, u = np.random.default_rng(4), np.linspace(-1.0, 1.0, 40)
    design, sigma = np.vander(u, 2, increasing=True), np.full(40, 0.001)
    found = [weighted_fit(design, rng.normal(size=40) * np.hypot(sigma, 0.01), sigma).extra for _ in range(50)]
    assert np.sqrt(np.mean(np.square(found))) == pytest.approx(0.01, rel=0.08)


def test_loss_of_yaw_is_taken_off_at_speed() -> None:
    fast = arcs_of(drive(palm_legs(speed_mps=4.0), characteristic_mps=20.0))
    assert rms_deg(fit_wheel_angle(fast, chassis(20.0))) < 0.01
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
    with pytest.raises(
        NotExcitedError, match=r"palm tree: expected turns beyond 6.0° to either side, found 0.0° to 30.0°"
    ):
        fit_wheel_angle(arcs_of(drive(legs[:12])), chassis())
    with pytest.raises(NotExcitedError, match="fit: expected 7 settings or more, found 3"):
        fit_wheel_angle(arcs_of(drive(palm_legs(3))), chassis())
    folded = drive(legs)
    assert folded.front_rad is not None
    volts = 2.0 + np.abs(folded.front_rad + 0.01)
    with pytest.raises(NotExcitedError, match="rises or falls with the steering all along"):
        fit_wheel_angle(fit_arcs(folded, find_stretches(folded, volts)), chassis())
