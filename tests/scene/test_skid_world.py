"""The skid-steer vehicle as it is, and its sensors: delay, lag, threshold, drift, outages, against plain numbers."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import Float

from lgprjax.scene import (
    SkidPlant,
    SkidPlantState,
    SkidReadings,
    SkidSensors,
    default_skid_plant,
    default_skid_sensors,
    init_skid_plant,
    init_skid_sensors,
    read_skid_sensors,
    step_skid_plant,
)
from lgprjax.vehicle import VehiclePose, WheelSpeeds

TICK_S, TICKS = 0.02, 3000
KEY = jax.random.key(1)


@jax.jit
def drive(plant: SkidPlant, sensors: SkidSensors, wheels: WheelSpeeds) -> tuple[SkidPlantState, SkidReadings]:
    """A minute of constant commands; one program for every vehicle."""
    zero = jnp.float32(0.0)
    begun = init_skid_plant(plant, VehiclePose(zero, zero, zero), KEY, delay_slots=20)

    def tick(carried, number):  # type: ignore[no-untyped-def]
        state, errors = carried
        keys = jax.random.split(jax.random.fold_in(KEY, number))
        state = step_skid_plant(plant, state, wheels, keys[0], TICK_S)
        errors, readings = read_skid_sensors(sensors, errors, state, number + 1, keys[1], TICK_S)
        return (state, errors), (state, readings)

    errors = init_skid_sensors(sensors, zero, KEY)
    driven: tuple[SkidPlantState, SkidReadings] = jax.lax.scan(tick, (begun, errors), jnp.arange(TICKS))[1]
    return driven


def ideal() -> SkidPlant:
    return default_skid_plant(track_m=1.0)._replace(
        delay_s=jnp.float32(0.0),
        lag_s=jnp.float32(0.0),
        slip_sigma=jnp.float32(0.0),
        slide_m=jnp.float32(0.0),
        wander=jnp.float32(0.0),
    )


def run(
    plant: SkidPlant, left: float, right: float, **sensing: float | Float[np.ndarray, "2"]
) -> tuple[SkidPlantState, SkidReadings]:
    sensors = default_skid_sensors(tick_s=TICK_S, gnss_x_m=0.0, gnss_y_m=0.0)
    sensors = sensors._replace(**{name: jnp.asarray(value, jnp.float32) for name, value in sensing.items()})
    wheels = WheelSpeeds(jnp.float32(left), jnp.float32(right))
    driven: tuple[SkidPlantState, SkidReadings] = jax.tree.map(np.asarray, drive(plant, sensors, wheels))
    return driven


def test_without_faults_it_drives_the_circle_of_its_wheels() -> None:
    state, _ = run(ideal(), 0.3, 0.5)
    time_s = TICK_S * np.arange(1, TICKS + 1)
    # 0.4 m/s and 0.2 rad/s: a circle of 2 m.
    np.testing.assert_allclose(state.pose.x_m, 2.0 * np.sin(0.2 * time_s), atol=2e-3)
    np.testing.assert_allclose(state.pose.y_m, 2.0 * (1.0 - np.cos(0.2 * time_s)), atol=2e-3)
    np.testing.assert_allclose(state.pose.yaw_rad, 0.2 * time_s, rtol=1e-4)


def test_it_is_late_and_slow_and_slides_in_turns_about_a_point_ahead() -> None:
    state, _ = run(ideal()._replace(delay_s=jnp.float32(0.2), lag_s=jnp.float32(0.4)), 0.5, 0.5)
    time_s = TICK_S * np.arange(1, TICKS + 1)
    expected = 0.5 * (1.0 - np.exp(-np.maximum(time_s - 0.2, 0.0) / 0.4))
    np.testing.assert_allclose(state.wheels.left_mps, expected, atol=2e-3)
    # On the spot the midpoint itself circles about the point 0.1 m ahead.
    state, _ = run(ideal()._replace(slide_m=jnp.float32(0.1)), -0.1, 0.1)
    np.testing.assert_allclose(np.hypot(state.pose.x_m - 0.1, state.pose.y_m), 0.1, atol=2e-3)


def test_it_ignores_turns_below_its_threshold() -> None:
    for turn_mps, turned_rad in ((0.29, 0.0), (0.31, 0.31 * 60.0)):
        state, _ = run(ideal()._replace(threshold_mps=jnp.float32(0.3)), 0.4 - turn_mps / 2, 0.4 + turn_mps / 2)
        assert float(state.pose.yaw_rad[-1]) == pytest.approx(turned_rad, rel=1e-3)


def test_sides_slip_by_as_much_as_they_are_told_to() -> None:
    state, _ = run(ideal()._replace(slip_sigma=jnp.float32(0.02), slip_m=jnp.float32(0.05)), 0.5, 0.5)
    assert np.std(state.slip) == pytest.approx(0.02, rel=0.15)
    assert abs(np.corrcoef(state.slip.T)[0, 1]) < 0.2


def test_fixes_come_once_a_second_and_late_and_are_wrong_by_what_is_told() -> None:
    state, readings = run(
        ideal(), 0.5, 0.5, slow_sigma_m=0.0, bias_m=np.array([0.3, -0.1]), drift_mps=np.array([0.0, 0.01])
    )
    came = np.flatnonzero(readings.gnss_valid)
    np.testing.assert_array_equal(np.diff(came), 50)
    assert (came[0] + 1) % 50 == 5
    taken = came - 5
    wrong = readings.gnss_m[came] - np.stack([state.pose.x_m, state.pose.y_m], axis=1)[taken]
    wrong[:, 1] -= 0.01 * TICK_S * (taken + 1)
    np.testing.assert_allclose(wrong.mean(axis=0), [0.3, -0.1], atol=0.01)
    assert np.std(wrong) == pytest.approx(np.std([0.3, -0.1]), rel=0.05)
    np.testing.assert_allclose(readings.gnss_age_s, 0.1, rtol=1e-6)


def test_the_receiver_is_silent_for_as_long_as_it_is_told() -> None:
    _, readings = run(ideal(), 0.5, 0.5, off_s=10.0, every_s=30.0)
    time_s = TICK_S * (1 + np.flatnonzero(readings.gnss_valid))
    assert len(time_s) == pytest.approx(40, abs=2)
    assert ((time_s % 30.0) < 20.0).all()


def test_the_ins_tells_the_turn_and_drifts() -> None:
    state, readings = run(ideal(), 0.3, 0.5, ins_drift_radps=1e-3, ins_noise_rad=1e-5)
    speaks = np.flatnonzero(readings.turn_valid)
    np.testing.assert_array_equal(np.diff(speaks), 5)
    told = readings.turn_rad[speaks].sum()
    assert abs(told - float(state.pose.yaw_rad[speaks[-1]])) == pytest.approx(1e-3 * 60.0, rel=0.02)


def test_the_wheels_read_too_much_or_too_little() -> None:
    state, readings = run(ideal(), 0.4, 0.4, wheel_scale=0.02)
    share = float(np.mean(readings.left_mps[10:]) / np.mean(state.wheels.left_mps[10:]) - 1.0)
    other = float(np.mean(readings.right_mps[10:]) / np.mean(state.wheels.right_mps[10:]) - 1.0)
    assert 1e-4 < abs(share) < 0.06
    assert share == pytest.approx(other, abs=1e-3)
