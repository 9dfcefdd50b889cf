"""V_CHAR from turning tests at 1 to 8 m/s: its interval, and what it is not to be misled by."""

import jax.numpy as jnp
import numpy as np
import pytest

from lgprjax.scene.motion import drive_turns
from lgprjax.scene.vehicle_drive import TrueVehicle, VehicleSensors, simulate_vehicle_drive
from lgprjax.tuning import NotExcitedError
from lgprjax.tuning.arcs import find_stretches, fit_arcs
from lgprjax.tuning.steering import YawGainFit, fit_yaw_gain
from lgprjax.vehicle.kinematics import Chassis, ProportionalRear
from lgprjax.vehicle.sensors import DriveSignals
from turning_drives import LARGEST_RAD, RATIO, WHEELBASE_M, Leg, Noise, covered_band, drive, measured

SPEEDS_MPS = (1.0, 2.0, 4.0, 6.0, 8.0)
CHASSIS = Chassis(
    jnp.float32(WHEELBASE_M),
    jnp.float32(0.0),
    ProportionalRear(jnp.float32(RATIO)),
    jnp.float32(LARGEST_RAD),
    jnp.float32(np.inf),
)


def turns(speeds: tuple[float, ...] = SPEEDS_MPS, sides: tuple[int, ...] = (1, -1)) -> list[Leg]:
    angles = np.radians([8.0, 14.0])
    return [Leg(side * angle, 12.0 * speed, speed) for speed in speeds for angle in angles for side in sides]


def fitted(signals: DriveSignals) -> YawGainFit:
    assert signals.front_rad is not None
    arcs = fit_arcs(signals, find_stretches(signals, signals.front_rad))
    return fit_yaw_gain(arcs, CHASSIS, arcs.stretches.steering, arcs.stretches.sigma_steering)


def drawn(draws: int, noise: Noise) -> tuple[float, float]:
    """Share of draws in which the interval holds, and the largest relative error."""
    clean, found = drive(turns(), characteristic_mps=20.0), []
    for seed in range(draws):
        found.append(fitted(measured(clean, noise, np.random.default_rng([seed, 3]))).characteristic_speed_mps)
    held = np.mean([v.low <= 20.0 <= v.high for v in found])
    return float(held), float(np.max(np.abs([v.value / 20.0 - 1.0 for v in found])))


def test_speed_without_noise_is_the_truth() -> None:
    fit = fitted(drive(turns(), characteristic_mps=20.0))
    assert fit.characteristic_speed_mps.value == pytest.approx(20.0, rel=1e-4)
    np.testing.assert_allclose(fit.gain, 1.0 / (1.0 + (fit.speed_mps / 20.0) ** 2), rtol=1e-4)


def test_speed_and_its_interval() -> None:
    held, worst = drawn(300, Noise(front_rad=np.radians(0.1)))
    low, high = covered_band(300)
    assert low <= held <= high
    assert worst < 0.05


@pytest.mark.campaign
def test_interval_of_the_speed_in_2000_draws() -> None:
    held, worst = drawn(2000, Noise(front_rad=np.radians(0.1)))
    low, high = covered_band(2000)
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


def test_turns_to_one_side_and_no_loss_at_all() -> None:
    one_side = measured(drive(turns(sides=(1,)), characteristic_mps=20.0), Noise(), np.random.default_rng(2))
    fit = fitted(one_side)
    assert fit.offset_rad == 0.0
    assert fit.characteristic_speed_mps.value == pytest.approx(20.0, rel=0.05)
    rigid = drive(turns())
    none = [
        fitted(measured(rigid, Noise(), np.random.default_rng([seed, 4]))).characteristic_speed_mps
        for seed in range(20)
    ]
    assert sum(v.high == np.inf for v in none) >= 17
    assert min(v.low for v in none) > 60.0


def test_speed_of_a_simulated_vehicle_with_gaps_and_outliers() -> None:
    degree = np.pi / 180.0
    told = drive_turns(SPEEDS_MPS, [8.0 * degree, -8.0 * degree, 14.0 * degree, -14.0 * degree])
    faults = VehicleSensors(outlier_share=0.03, gnss_gaps_s=((100.0, 104.0),))
    fit = fitted(simulate_vehicle_drive(TrueVehicle(), told, faults, seed=4).signals)
    assert fit.characteristic_speed_mps.value == pytest.approx(20.0, rel=0.05)


def test_logs_that_cannot_tell_are_refused() -> None:
    with pytest.raises(NotExcitedError, match=r"the fastest is 2 times the slowest, found 4.0 to 6.0 m/s"):
        fitted(drive(turns(speeds=(4.0, 6.0)), characteristic_mps=20.0))
    with pytest.raises(NotExcitedError, match="turning tests: expected 6 turns or more, found 0"):
        fitted(drive([Leg(0.005 * n, 20.0, 2.0) for n in range(-3, 4)]))
