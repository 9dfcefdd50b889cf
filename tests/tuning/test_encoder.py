"""Calibration 2 on simulated logs: pauses, line or polynomial, hysteresis, intervals over many draws, refusals."""

from dataclasses import replace

import jax
import numpy as np
import pytest

from lgprjax.scene.motion import drive_straight, half_turn_angles
from lgprjax.scene.vehicle_drive import VehicleSensors, drive_manoeuvre, read_vehicle
from lgprjax.tuning import DriveSignals, NotExcitedError, find_pauses, fit_encoder, potentiometer_of_counts
from refusals import refused
from turning_drives import covered_band
from validation.vehicles.intervals import STILL, VEHICLE, encoder_shares, still_truth
from validation.vehicles.intervals import standing_log as log

DEGREE = np.pi / 180.0
DRAWS = 150


def test_pauses_are_where_the_wheel_was_held() -> None:
    signals = log()
    pauses = find_pauses(signals, "test")
    angles = half_turn_angles(VEHICLE.largest_angle_rad, 5.0)
    stops = np.concatenate([angles[::-1], angles[1:]])[1:]
    turned = (pauses.counts - pauses.counts.mean()) / VEHICLE.encoder_counts_per_rad
    np.testing.assert_allclose(turned, stops - stops.mean(), atol=1e-4)
    np.testing.assert_array_equal(pauses.direction, np.repeat([1.0, -1.0], 10))
    behind = stops - 0.5 * VEHICLE.backlash_rad * pauses.direction
    np.testing.assert_allclose(pauses.potentiometer_v, 2.43 + 2.0 * behind, atol=0.003)


def test_the_intervals_cover() -> None:
    covered, lines = encoder_shares(DRAWS, spike_share=0.04)
    low, high = covered_band(DRAWS)
    assert all(low <= share <= high for share in covered.values()), covered
    assert lines > 0.99


@pytest.mark.parametrize("bend", [0.0, -0.35], ids=["line", "bent"])
def test_the_fit_is_right_to_a_tenth_of_a_degree_at_the_wheel(bend: float) -> None:
    vehicle = replace(VEHICLE, potentiometer_per_rad_v=(2.0, 0.0, bend))
    fit = fit_encoder(read_vehicle(vehicle, STILL, still_truth(), VehicleSensors(), 5), 2.43)
    assert len(fit.volts) == (4 if bend else 2)
    steering = np.linspace(-0.99, 0.99, 41) * VEHICLE.largest_angle_rad
    volts = 2.43 + 2.0 * steering + bend * steering**3
    counts = fit.reference_counts.value + VEHICLE.encoder_counts_per_rad * steering
    wrong_rad = (potentiometer_of_counts(fit, counts) - volts) / 2.0
    assert np.abs(wrong_rad).max() < 0.1 * DEGREE
    assert fit.largest_counts / VEHICLE.encoder_counts_per_rad < 0.1 * DEGREE
    assert fit.rms_counts <= fit.largest_counts


def test_the_play_of_a_bent_potentiometer_is_the_same_number_of_counts_everywhere() -> None:
    """In volts it is a seventh less at the ends than in the middle."""
    vehicle = replace(VEHICLE, potentiometer_per_rad_v=(2.0, 0.0, -0.35))
    due = VEHICLE.backlash_rad * VEHICLE.encoder_counts_per_rad
    fits = [
        fit_encoder(read_vehicle(vehicle, STILL, still_truth(), VehicleSensors(), seed), 2.43) for seed in range(30)
    ]
    pulls = [(fit.hysteresis_counts.value - due) / fit.hysteresis_counts.sigma for fit in fits]
    assert abs(np.mean(pulls)) < 0.7
    inside = [fit.hysteresis_counts.low <= due <= fit.hysteresis_counts.high for fit in fits]
    assert sum(inside) >= 26


def test_without_a_reference_the_middle_is_taken() -> None:
    fit = fit_encoder(log())
    assert fit.reference_v == pytest.approx(2.43, abs=0.02)
    at = potentiometer_of_counts(fit, np.array([fit.reference_counts.value]))
    assert at[0] == pytest.approx(fit.reference_v, abs=1e-9)


def test_a_pause_with_a_wrong_voltage_is_taken_away() -> None:
    signals = log()
    assert signals.potentiometer_v is not None
    held = (signals.time_s > 20.0) & (signals.time_s < 22.0)
    fit = fit_encoder(signals._replace(potentiometer_v=np.where(held, 4.0, signals.potentiometer_v)), 2.43)
    assert 1 <= np.count_nonzero(fit.weight == 0.0) <= 2
    assert fit.counts_per_v.value == pytest.approx(6000.0, abs=5.0)


def test_lost_seconds_cost_a_pause_at_most() -> None:
    fit = fit_encoder(log(1, VehicleSensors(record_gaps_s=((11.0, 14.0), (30.0, 31.0)))), 2.43)
    assert fit.counts_per_v.value == pytest.approx(6000.0, abs=5.0)
    assert fit.pauses.counts.size >= 17


def test_logs_that_cannot_tell_are_refused() -> None:
    signals = log()
    count = signals.time_s.size
    straight = drive_straight(60.0, 4.0)
    one_way = STILL.time_s < 0.5 * STILL.time_s[-1]
    half = STILL._replace(
        **{name: getattr(STILL, name)[one_way] for name in ("time_s", "wanted_rad", "speed_mps", "supply_v")}
    )
    noise = np.random.default_rng(0).uniform(0.0, 5.0, count)
    made: list[tuple[DriveSignals, tuple[int, ...]]] = [
        (read_vehicle(VEHICLE, told, drive_manoeuvre(VEHICLE, told), VehicleSensors(), 0), values)
        for told, values in ((straight, ()), (half, (10, 0)))
    ]
    made += [
        (signals._replace(potentiometer_v=None), ()),
        (signals._replace(encoder_counts=None), ()),
        (signals._replace(encoder_counts=np.full(count, 7.0)), (0,)),
        (signals._replace(potentiometer_v=np.full(count, 2.4)), ()),
        (signals._replace(potentiometer_v=noise), ()),
        (jax.tree.map(lambda part: part[:300], signals), (8,)),
        (signals._replace(travel_m=5.0 * signals.time_s), ()),
    ]
    for refusal, values in made:
        with refused("encoder against potentiometer", *values, error=NotExcitedError):
            fit_encoder(refusal)
    with refused("encoder against potentiometer", 9.0, error=NotExcitedError):
        fit_encoder(signals, 9.0)
