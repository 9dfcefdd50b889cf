"""Calibration 6 on simulated runs: every number, its interval over many draws, gaps, the odometer's metre, refusals."""

from dataclasses import replace

import numpy as np
import pytest

from lgprjax.scene.motion import drive_straight, step_pedals
from lgprjax.scene.vehicle_drive import VehicleSensors, drive_manoeuvre, read_vehicle
from lgprjax.tuning import DriveSignals, NotExcitedError, fit_pedals
from lgprjax.tuning.pedals import PEDAL_NAMES, cut_runs, fit_way
from refusals import refused
from turning_drives import covered_band
from validation.vehicles.intervals import PEDALS as EXACT
from validation.vehicles.intervals import VEHICLE, pedal_shares
from validation.vehicles.intervals import pedal_log as log


def test_the_intervals_cover() -> None:
    covered = pedal_shares(200, 0.02)
    low, high = covered_band(200)
    assert ((covered >= low) & (covered <= high)).all(), covered


@pytest.mark.parametrize(
    "sensors",
    [
        VehicleSensors(record_hz=20.0),
        VehicleSensors(record_hz=20.0, odometer_scale_error=0.03, outlier_share=0.03, gnss_gaps_s=((10.0, 14.0),)),
    ],
    ids=["usual", "an odometer that reads too much"],
)
def test_every_number_is_found(sensors: VehicleSensors) -> None:
    signals = log(3, sensors)
    fit, runs = fit_pedals(signals), cut_runs(signals, "test")
    own = fit_way(runs, signals.travel_m[runs.record][None]).sigma[0]
    found = [*fit.throttle, *fit.brake, fit.rolling_mps2, fit.drag_per_s]
    for name, number, alone, exact in zip(PEDAL_NAMES, found, own, EXACT, strict=True):
        assert abs(number.value - exact) < 4.0 * number.sigma, name
        assert number.low < number.value < number.high
        assert alone < 0.04 * exact + 0.002, name
        # Beside the records' noise: commands that act up to 10 ms later.
        assert alone < number.sigma < 0.1 * exact + 0.005, name
    assert fit.runs == 3
    assert fit.rms_m == pytest.approx(0.002, rel=0.1)
    assert fit.metres_per_odometer_metre is not None
    scale = fit.metres_per_odometer_metre
    assert abs(scale.value - 1.0 / (1.0 + sensors.odometer_scale_error)) < 4.0 * scale.sigma


def test_another_vehicle_is_found_from_another_start() -> None:
    vehicle = replace(VEHICLE, throttle=(0.2, 0.1, 1.5, 1.5), brake=(0.1, 0.02, 4.0, 0.15), rolling_mps2=0.1)
    # Its throttle takes 1.5 s to answer and as long to let go: coasting shows after longer steps only.
    told = step_pedals([0.3, 0.4, 0.5, 0.6, 0.7], [0.4, 0.5, 0.6, 0.7, 0.8], hold_s=4.0)
    signals = read_vehicle(vehicle, told, drive_manoeuvre(vehicle, told), VehicleSensors(record_hz=20.0), 1)
    fit = fit_pedals(signals)
    for found, exact in ((fit.throttle, vehicle.throttle), (fit.brake, vehicle.brake)):
        for number, truth in zip(found, exact, strict=True):
            assert abs(number.value - truth) < 5.0 * number.sigma + 0.01 * truth


def test_friction_holds_the_brake_over_a_standstill() -> None:
    """A brake that has been let up from 1 to 0.5 at rest acts more than its command says until it is released."""
    told = step_pedals([0.3, 0.45, 0.6, 0.35, 0.5], [0.35, 0.5, 0.65, 0.4, 0.55])
    assert told.brake is not None
    brake = np.array(told.brake)
    pressed = np.flatnonzero(np.diff(np.asarray(brake == 1.0, dtype=int)) == 1) + 1
    for at in pressed:
        brake[at + 100 : at + 800] = 0.5
    told = told._replace(brake=brake)
    signals = read_vehicle(VEHICLE, told, drive_manoeuvre(VEHICLE, told), VehicleSensors(record_hz=100.0), 1)
    fit = fit_pedals(signals)
    found = [*fit.throttle, *fit.brake, fit.rolling_mps2, fit.drag_per_s]
    for name, number, exact in zip(PEDAL_NAMES, found, EXACT, strict=True):
        assert number.value == pytest.approx(exact, rel=0.03, abs=0.004), name
    assert fit.rms_m < 0.003


def test_a_run_with_lost_seconds_is_left_out() -> None:
    signals = log(2, VehicleSensors(record_hz=20.0, record_gaps_s=((18.0, 20.0),)))
    assert cut_runs(signals, "test").runs == 2
    assert cut_runs(log(2), "test").runs == 3


def test_logs_that_cannot_tell_are_refused() -> None:
    signals = log()
    count = signals.time_s.size
    straight = drive_straight(30.0, 3.0)
    one_level = step_pedals([0.4, 0.4, 0.4], [0.5, 0.5, 0.5], hold_s=3.0, back=0.0)
    assert signals.throttle is not None
    made: list[tuple[DriveSignals, tuple[object, ...]]] = [
        (read_vehicle(VEHICLE, straight, drive_manoeuvre(VEHICLE, straight), VehicleSensors(), 0), ("throttle",)),
        (read_vehicle(VEHICLE, one_level, drive_manoeuvre(VEHICLE, one_level), VehicleSensors(), 0), ("throttle", 0.4)),
        (signals._replace(brake=None), ("brake",)),
        (signals._replace(travel_m=np.full(count, 3.0)), ()),
        (signals._replace(travel_m=4.0 * signals.time_s), ()),
        (signals._replace(brake=np.zeros(count)), ("brake",)),
    ]
    for refusal, values in made:
        with refused("throttle and brake", *values, error=NotExcitedError):
            fit_pedals(refusal)
    # A dead zone that no step shows is named.
    plain = step_pedals([0.3, 0.45, 0.6], [0.35, 0.5, 0.65], hold_s=3.0, back=0.0)
    signals = read_vehicle(VEHICLE, plain, drive_manoeuvre(VEHICLE, plain), VehicleSensors(record_hz=20.0), 0)
    with refused("throttle and brake", "throttle.dead_zone", error=NotExcitedError):
        fit_pedals(signals)
