"""The steering servo, one part at a time: analytic courses, a plain simulation of all parts, derivatives."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import Array, Float

from lgprjax.vehicle import Servo, ideal_servo, init_servo, step_servo, torque_share

STEP_S = 0.01
SLOTS = 12


@jax.jit
def run(servo: Servo, told: Float[Array, " step"], share: Float[Array, ""]) -> Float[Array, "2 step"]:
    """Motor and wheel after each step, from rest at 0."""

    def step(state, command):  # type: ignore[no-untyped-def]
        state = step_servo(state, servo, command, share, STEP_S)
        return state, jnp.stack([state.motor_rad, state.wheel_rad])

    turned: Float[Array, "step 2"] = jax.lax.scan(step, init_servo(jnp.float32(0.0), delay_slots=SLOTS), told)[1]
    return turned.T


def driven(told: Float[np.ndarray, " step"], share: float = 1.0, **parts: float) -> Float[np.ndarray, "2 step"]:
    servo = ideal_servo()._replace(**{name: jnp.float32(value) for name, value in parts.items()})
    return np.asarray(run(servo, jnp.asarray(told, jnp.float32), jnp.float32(share)), np.float64)


STEP_TO = np.full(100, 0.2)
AFTER_S = STEP_S * np.arange(1, 101)


def test_no_parts_follow_at_once_a_lag_is_the_exponential_and_a_rate_a_ramp() -> None:
    told = 0.3 * np.sin(np.arange(100) / 7.0)
    np.testing.assert_allclose(driven(told), np.stack([told, told]), atol=1e-7)
    np.testing.assert_allclose(driven(STEP_TO, lag_s=0.15)[1], 0.2 * (1.0 - np.exp(-AFTER_S / 0.15)), atol=1e-6)
    np.testing.assert_allclose(driven(STEP_TO, rate_radps=0.5)[1], np.minimum(0.5 * AFTER_S, 0.2), atol=1e-6)
    # A lag does not depend on the step.
    coarse = step_servo(init_servo(jnp.float32(0.0)), ideal_servo(lag_s=0.15), jnp.float32(0.2), 1.0, 10 * STEP_S)
    assert float(coarse.wheel_rad) == pytest.approx(0.2 * (1.0 - np.exp(-0.1 / 0.15)), abs=1e-6)


@pytest.mark.parametrize("delay_s", [0.03, 0.055, 0.12])
def test_a_delay_shifts_the_command_also_by_parts_of_a_step(delay_s: float) -> None:
    told = 0.1 * AFTER_S  # a ramp: shifted by a part of a step it has values of its own
    known_s = np.concatenate([[-1.0], AFTER_S])
    expected = np.interp(AFTER_S - delay_s, known_s, np.concatenate([[0.0], told]), left=0.0)
    found = driven(told, delay_s=delay_s)[1]
    # Before the ramp begins the line between the rest and its first value is one step long, not one second.
    begun = AFTER_S - delay_s >= STEP_S
    np.testing.assert_allclose(found[begun], expected[begun], atol=1e-7)
    np.testing.assert_allclose(found[AFTER_S - delay_s <= -1e-9], 0.0, atol=1e-9)


def test_a_dead_band_leaves_so_much_of_the_error_standing() -> None:
    wheel = driven(np.repeat([0.004, 0.1, 0.097, -0.1], 25), dead_band_rad=0.005)[1]
    np.testing.assert_allclose(wheel[[24, 49, 74, 99]], [0.0, 0.095, 0.095, -0.095], atol=1e-6)


def test_backlash_is_a_loop_as_wide_as_the_play() -> None:
    told = 0.2 * np.sin(2.0 * np.pi * np.arange(400) / 200.0)
    motor, wheel = driven(told, backlash_rad=0.02)
    rising, falling = np.gradient(told) > 1e-4, np.gradient(told) < -1e-4
    settled = (np.arange(400) > 200) & (np.abs(told) < 0.15)
    np.testing.assert_allclose((motor - wheel)[rising & settled], 0.01, atol=1e-6)
    np.testing.assert_allclose((motor - wheel)[falling & settled], -0.01, atol=1e-6)
    # Turned back by less than the play, the wheel stays.
    assert np.ptp(driven(np.concatenate([np.full(50, 0.1), np.full(50, 0.085)]), backlash_rad=0.02)[1, 40:]) < 1e-9


def test_left_is_faster_than_right_by_the_asymmetry() -> None:
    left = driven(np.full(100, 9.0), rate_radps=0.5, asymmetry=0.2)[1, -1]
    right = driven(np.full(100, -9.0), rate_radps=0.5, asymmetry=0.2)[1, -1]
    assert left == pytest.approx(0.5 * 1.2, rel=1e-5)
    assert right == pytest.approx(-0.5 * 0.8, rel=1e-5)


def test_less_torque_is_a_slower_rate_and_a_longer_lag() -> None:
    np.testing.assert_allclose(driven(STEP_TO, 0.5, rate_radps=0.5), driven(STEP_TO, rate_radps=0.25), atol=1e-6)
    np.testing.assert_allclose(driven(STEP_TO, 0.5, lag_s=0.15), driven(STEP_TO, lag_s=0.3), atol=1e-6)


def test_without_torque_nothing_moves() -> None:
    for parts in ({}, {"lag_s": 0.15}, {"lag_s": 0.15, "rate_radps": 0.5}):
        assert (driven(STEP_TO, 0.0, **parts) == 0.0).all()


def test_torque_falls_from_nominal_to_stall() -> None:
    servo = ideal_servo()._replace(nominal_v=jnp.float32(24.0), stall_v=jnp.float32(10.0))
    share = torque_share(servo, jnp.asarray([5.0, 10.0, 17.0, 24.0, 28.0], jnp.float32))
    np.testing.assert_allclose(share, [0.0, 0.0, 0.5, 1.0, 1.0], atol=1e-6)


ALL = {"lag_s": 0.12, "rate_radps": 0.6, "delay_s": 0.053, "dead_band_rad": 0.004, "backlash_rad": 0.01}


def simulate_plainly(told: Float[np.ndarray, " step"], share: float) -> Float[np.ndarray, " step"]:
    """All parts together, in float64, one step after the other."""
    known = np.concatenate([np.zeros(SLOTS + 1), told])
    motor, wheel, wheels = 0.0, 0.0, []
    for now in range(told.size):
        heard = np.interp(now + SLOTS + 1 - ALL["delay_s"] / STEP_S, np.arange(known.size), known)
        wrong = heard - motor
        wrong = np.sign(wrong) * max(abs(wrong) - ALL["dead_band_rad"], 0.0)
        moved = wrong * (1.0 - np.exp(-STEP_S * share / ALL["lag_s"]))
        most = ALL["rate_radps"] * share * STEP_S
        motor += min(max(moved, -most * (1.0 - 0.1)), most * (1.0 + 0.1))
        wheel = min(max(wheel, motor - 0.5 * ALL["backlash_rad"]), motor + 0.5 * ALL["backlash_rad"])
        wheels.append(wheel)
    return np.array(wheels)


@pytest.mark.parametrize("share", [1.0, 0.6])
def test_all_parts_together_are_the_plain_simulation(share: float) -> None:
    told = 0.25 * np.sign(np.sin(2.0 * np.pi * np.arange(400) / 260.0)) + 0.02 * np.sin(np.arange(400) / 9.0)
    found = driven(told, share, asymmetry=0.1, **ALL)[1]
    np.testing.assert_allclose(found, simulate_plainly(told, share), atol=2e-6)


def test_the_derivative_by_every_part_is_finite_and_right() -> None:
    told = 0.25 * np.sign(np.sin(2.0 * np.pi * np.arange(400) / 130.0))
    servo = ideal_servo()._replace(**{name: jnp.float32(value) for name, value in ALL.items()})

    def way(servo: Servo) -> Float[Array, ""]:
        return jnp.sum(run(servo, jnp.asarray(told, jnp.float32), jnp.float32(1.0))[1] ** 2)

    slope = jax.grad(way)(servo)
    for name in ALL:
        step = 2e-3 * ALL[name]
        ends = [float(np.sum(driven(told, **{**ALL, name: ALL[name] + side * step})[1] ** 2)) for side in (-1.0, 1.0)]
        assert float(getattr(slope, name)) == pytest.approx((ends[1] - ends[0]) / (2.0 * step), rel=0.03), name


def test_neutral_values_have_finite_derivatives() -> None:
    slope = jax.grad(lambda servo: jnp.sum(run(servo, jnp.full(400, 0.1, jnp.float32), jnp.float32(1.0))))(
        ideal_servo(lag_s=0.1, rate_radps=5.0)
    )
    assert all(np.isfinite(np.asarray(part)) for part in slope)
