"""Calibration 2 on simulated logs: pauses, line or polynomial, hysteresis, intervals over many draws, refusals."""

from dataclasses import replace

import jax
import numpy as np
import pytest
from jaxtyping import Float

from lgprjax.scene.motion import drive_straight, half_turn_angles, turn_standing
from lgprjax.scene.vehicle_drive import TrueVehicle, VehicleSensors, drive_manoeuvre, read_vehicle
from lgprjax.tuning import DriveSignals, NotExcitedError, find_pauses, fit_encoder, potentiometer_of_counts

DEGREE = np.pi / 180.0
DRAWS = 2000
VEHICLE = TrueVehicle()
STILL = turn_standing(VEHICLE.largest_angle_rad, 5.0, pause_s=2.0)
TRUTH = drive_manoeuvre(VEHICLE, STILL)
PLAY_COUNTS = VEHICLE.backlash_rad * VEHICLE.encoder_counts_per_rad


def log(seed: int = 0, sensors: VehicleSensors | None = None) -> DriveSignals:
    return read_vehicle(VEHICLE, STILL, TRUTH, sensors or VehicleSensors(record_hz=25.0), seed)


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


@pytest.mark.parametrize(
    "spike_share", [pytest.param(0.0, id="white", marks=pytest.mark.campaign), pytest.param(0.04, id="spikes")]
)
def test_the_intervals_cover(spike_share: float) -> None:
    sensors = VehicleSensors(record_hz=10.0, spike_share=spike_share)
    draws = DRAWS if spike_share == 0.0 else 500
    logs = [log(seed, sensors) for seed in range(draws)]
    fits = [fit_encoder(signals, 2.43) for signals in logs]
    # The zero is another one in every draw: it is what the counts are at straight.
    zeros = np.array([zero_counts(signals) for signals in logs])
    for found, truth in (
        (np.array([fit.counts_per_v for fit in fits]), 6000.0),
        (np.array([fit.hysteresis_counts for fit in fits]), PLAY_COUNTS),
        (np.array([fit.reference_counts for fit in fits]), zeros),
    ):
        covered = np.mean((found[:, 2] <= truth) & (found[:, 3] >= truth))
        low, high = (0.93, 0.97) if draws == DRAWS else (0.92, 0.98)
        assert low <= covered <= high, covered
    assert np.mean([fit.why.startswith("straight line") for fit in fits]) > 0.99


def zero_counts(signals: DriveSignals) -> float:
    """The encoder's zero, from what it reads against the truth: within the rounding, the same at all stops."""
    assert signals.encoder_counts is not None
    step = np.rint(signals.time_s * 100.0).astype(int)
    away: Float[np.ndarray, " record"] = signals.encoder_counts - VEHICLE.encoder_counts_per_rad * TRUTH.motor_rad[step]
    return float(0.5 * (away.min() + away.max()))


@pytest.mark.parametrize("bend", [0.0, -0.35], ids=["line", "bent"])
def test_the_fit_is_right_to_a_tenth_of_a_degree_at_the_wheel(bend: float) -> None:
    vehicle = replace(VEHICLE, potentiometer_per_rad_v=(2.0, 0.0, bend))
    fit = fit_encoder(read_vehicle(vehicle, STILL, TRUTH, VehicleSensors(), 5), 2.43)
    assert fit.why.startswith("polynomial of degree 3" if bend else "straight line")
    steering = np.linspace(-0.99, 0.99, 41) * VEHICLE.largest_angle_rad
    volts = 2.43 + 2.0 * steering + bend * steering**3
    counts = fit.reference_counts.value + VEHICLE.encoder_counts_per_rad * steering
    wrong_rad = (potentiometer_of_counts(fit, counts) - volts) / 2.0
    assert np.abs(wrong_rad).max() < 0.1 * DEGREE
    assert fit.largest_counts / VEHICLE.encoder_counts_per_rad < 0.1 * DEGREE
    assert fit.rms_counts <= fit.largest_counts


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
    made = [
        (read_vehicle(VEHICLE, told, drive_manoeuvre(VEHICLE, told), VehicleSensors(), 0), expected)
        for told, expected in (
            (straight, "a wheel turned at standstill"),
            (half, "three pauses or more from either side"),
        )
    ]
    made += [
        (signals._replace(potentiometer_v=None), "potentiometer voltages, found none in the log"),
        (signals._replace(encoder_counts=None), "encoder counts, found none in the log"),
        (signals._replace(encoder_counts=np.full(count, 7.0)), "a wheel turned at standstill, found 0 counts"),
        (signals._replace(potentiometer_v=np.full(count, 2.4)), "a potentiometer that follows the wheel"),
        (signals._replace(potentiometer_v=noise), "expected voltages that follow the counts"),
        (jax.tree.map(lambda part: part[:300], signals), "8 pauses of a wheel turned"),
        (signals._replace(travel_m=5.0 * signals.time_s), "one that moves in every record"),
    ]
    for refused, expected in made:
        with pytest.raises(NotExcitedError) as caught:
            fit_encoder(refused)
        assert expected in str(caught.value)
        assert "\n" not in str(caught.value)
    with pytest.raises(NotExcitedError, match="no such voltage near"):
        fit_encoder(signals, 9.0)
