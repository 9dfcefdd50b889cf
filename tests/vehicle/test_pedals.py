"""Pedals: onset, dead zone and lag against their definitions, driving against an independent integration."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import Array, Float
from scipy.integrate import solve_ivp

from lgprjax.vehicle import Pedal, Pedals, init_drive, step_drive

THROTTLE = (0.12, 0.05, 3.0, 0.6)
BRAKE = (0.18, 0.06, 6.0, 0.25)


def pedals_with(
    throttle: tuple[float, ...] = THROTTLE, brake: tuple[float, ...] = BRAKE, rolling: float = 0.15, drag: float = 0.03
) -> Pedals:
    made = [Pedal(*(jnp.float32(value) for value in pedal)) for pedal in (throttle, brake)]
    return Pedals(made[0], made[1], jnp.float32(rolling), jnp.float32(drag))


@jax.jit
def drive(
    pedals: Pedals, throttle: Float[Array, " step"], brake: Float[Array, " step"], step_s: Float[Array, ""]
) -> Float[Array, "3 step"]:
    """Speed, way and throttle's effect after each step, from standstill."""

    def step(carry, told):  # type: ignore[no-untyped-def]
        state, way_m = carry
        state, gone_m = step_drive(state, pedals, told[0], told[1], step_s)
        return (state, way_m + gone_m), jnp.stack([state.speed_mps, way_m + gone_m, state.throttle.effect_mps2])

    still = (init_drive(jnp.float32(0.0)), jnp.float32(0.0))
    driven: Float[Array, "step 3"] = jax.lax.scan(step, still, (throttle, brake))[1]
    return driven.T


def driven(
    pedals: Pedals, throttle: Float[np.ndarray, " step"], brake: Float[np.ndarray, " step"], step_s: float
) -> Float[np.ndarray, "3 step"]:
    told = (jnp.asarray(signal, jnp.float32) for signal in (throttle, brake))
    return np.asarray(drive(pedals, *told, jnp.float32(step_s)), np.float64)


def test_below_the_pre_tension_nothing_answers_and_above_it_the_effect_is_the_gains() -> None:
    for command, effect in ((0.05, 0.0), (0.12, 0.0), (0.32, 0.6), (1.0, 2.64)):
        found = driven(pedals_with(), np.full(400, command), np.zeros(400), 0.02)[2, -1]
        assert found == pytest.approx(effect, abs=2e-5)


def test_the_effect_comes_with_the_lag() -> None:
    found = driven(pedals_with(), np.full(400, 0.32), np.zeros(400), 0.01)[2]
    np.testing.assert_allclose(found, 0.6 * (1.0 - np.exp(-0.01 * np.arange(1, 401) / 0.6)), atol=1e-6)


def test_a_reversal_within_the_dead_zone_has_no_effect() -> None:
    quick = pedals_with(throttle=(0.12, 0.05, 3.0, 0.0))
    told = np.append(np.repeat([0.5, 0.46, 0.40, 0.43, 0.48, 0.0], 66), np.zeros(4))
    effect = driven(quick, told, np.zeros(told.size), 0.01)[2, 65:396:66]
    # Held at 0.38; within 0.05 back still; at 0.40 dragged along to 0.33; up again still until 0.45; on; free.
    np.testing.assert_allclose(effect, 3.0 * np.array([0.38, 0.38, 0.33, 0.33, 0.36, 0.0]), atol=1e-5)


def test_rolling_resistance_holds_the_vehicle() -> None:
    throttle = np.full(400, 0.12 + 0.049)  # just short of 0.05 m/s² times three
    assert (driven(pedals_with(), throttle, np.zeros(400), 0.01)[:2] == 0.0).all()


def integrate(throttle: float, brake_from_s: float, brake: float, until_s: float) -> tuple[float, float]:
    """Way and speed by an integrator of its own; the effects have their closed forms."""

    def rate(time_s: float, state: Float[np.ndarray, "2"]) -> list[float]:
        thrust = 3.0 * (throttle - 0.12) * (1.0 - np.exp(-time_s / 0.6))
        gone_s = max(time_s - brake_from_s, 0.0)
        if gone_s > 0.0:
            thrust = 3.0 * (throttle - 0.12) * (1.0 - np.exp(-brake_from_s / 0.6)) * np.exp(-gone_s / 0.6)
        slowed = 6.0 * max(brake - 0.18, 0.0) * (1.0 - np.exp(-gone_s / 0.25))
        net = thrust - slowed - 0.15 - 0.03 * state[1]
        return [state[1], net if state[1] > 0.0 or net > 0.0 else 0.0]

    def stops(time_s: float, state: Float[np.ndarray, "2"]) -> float:
        return float(state[1]) if time_s > brake_from_s else 1.0

    stops.terminal = True  # type: ignore[attr-defined]
    solved = solve_ivp(rate, (0.0, until_s), [0.0, 0.0], rtol=1e-9, atol=1e-10, max_step=0.002, events=stops)
    return float(solved.y[0, -1]), max(float(solved.y[1, -1]), 0.0)


@pytest.mark.parametrize(("until_s", "step_s", "error_m"), [(4.5, 0.01, 5e-4), (9.0, 0.1, 0.01)])
def test_driving_off_and_stopping_are_those_of_an_integrator(until_s: float, step_s: float, error_m: float) -> None:
    count = round(until_s / step_s)
    time_s = step_s * np.arange(count)
    throttle, brake = np.where(time_s < 4.0 - 1e-9, 0.4, 0.0), np.where(time_s < 4.0 - 1e-9, 0.0, 0.5)
    found = driven(pedals_with(), throttle, brake, step_s)
    way_m, speed = integrate(0.4, 4.0, 0.5, until_s)
    assert found[1, -1] == pytest.approx(way_m, abs=error_m)
    assert found[0, -1] == pytest.approx(speed, abs=2 * error_m)
    assert (found[0, -1] == 0.0) == (until_s == 9.0)


def test_the_derivative_of_the_way_by_every_number_is_finite_and_right() -> None:
    throttle, brake = np.repeat([0.4, 0.3, 0.0, 0.0], 100), np.repeat([0.0, 0.0, 0.4, 0.3], 100)
    start = pedals_with(rolling=0.1)

    def way(pedals: Pedals) -> Float[Array, ""]:
        told = (jnp.asarray(signal, jnp.float32) for signal in (throttle, brake))
        gone: Float[Array, ""] = drive(pedals, *told, jnp.float32(0.01))[1, 280]
        return gone

    slopes, tree = jax.tree.flatten(jax.grad(way)(start))
    values = [float(value) for value in jax.tree.leaves(start)]
    for index, slope in enumerate(slopes):
        step = 0.01 * values[index]
        ends = []
        for side in (-1.0, 1.0):
            moved = [jnp.float32(value + side * step * (i == index)) for i, value in enumerate(values)]
            ends.append(float(way(jax.tree.unflatten(tree, moved))))
        assert float(slope) == pytest.approx((ends[1] - ends[0]) / (2.0 * step), rel=0.02, abs=2e-3)
