"""Velocity control in closed loop with the pedal model: steps, grades, saturation, stops, and what may never happen."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import Array, Float

from lgprjax.autopilot import (
    Pressed,
    VelocitySettings,
    VelocityState,
    default_velocity,
    init_velocity,
    step_stop,
    step_velocity,
)
from lgprjax.vehicle import Pedals, init_drive, step_drive
from made_up_pedals import pedals_with

STEP_S = 0.05
STEPS = 1600
CRUISE_MPS = 4.47
GRAVITY_MPS2 = 9.81


class Told(NamedTuple):
    """What happens in a drive, a value each step."""

    wanted_mps: Float[np.ndarray, " step"]
    grade: Float[np.ndarray, " step"]
    active: Float[np.ndarray, " step"]
    stop: Float[np.ndarray, " step"]
    offset_mps: Float[np.ndarray, " step"]


class Driven(NamedTuple):
    """What came of it, a value each step."""

    speed_mps: Float[np.ndarray, " step"]
    throttle: Float[np.ndarray, " step"]
    brake: Float[np.ndarray, " step"]
    way_m: Float[np.ndarray, " step"]
    reference_mps: Float[np.ndarray, " step"]
    integral_mps2: Float[np.ndarray, " step"]


@jax.jit
def close_loop(
    controller: VelocitySettings,
    believed: Pedals,
    true: Pedals,
    speed_mps: Float[Array, ""],
    told: Float[Array, "step 5"],
) -> Float[Array, "step 6"]:
    """Speed, throttle, brake, way, reference and integral after each step. A grade acts as rolling resistance does."""

    def step(carry, now):  # type: ignore[no-untyped-def]
        vehicle, state, way_m = carry
        wanted, grade, active, stop, offset = now
        seen = vehicle.speed_mps + offset
        held = step_velocity(controller, believed, state, wanted, seen, active > 0.0, jnp.float32(STEP_S))
        stopped = step_stop(controller, believed, state, seen, jnp.float32(STEP_S))
        state, throttle, brake = jax.tree.map(lambda one, two: jnp.where(stop > 0.0, one, two), stopped, held)
        hill = true._replace(rolling_mps2=true.rolling_mps2 + GRAVITY_MPS2 * grade)
        vehicle, gone_m = step_drive(vehicle, hill, throttle, brake, STEP_S)
        way_m = way_m + gone_m
        kept = (vehicle.speed_mps, throttle, brake, way_m, state.reference_mps, state.integral_mps2)
        return (vehicle, state, way_m), jnp.stack(kept)

    start = (init_drive(speed_mps), init_velocity(speed_mps), jnp.float32(0.0))
    driven: Float[Array, "step 6"] = jax.lax.scan(step, start, told)[1]
    return driven


def drive(
    start_mps: float = 0.0,
    controller: VelocitySettings | None = None,
    true: Pedals | None = None,
    **told: float | Float[np.ndarray, " step"],
) -> Driven:
    names = {"wanted_mps": CRUISE_MPS, "grade": 0.0, "active": 1.0, "stop": 0.0, "offset_mps": 0.0} | told
    signals = np.stack([np.broadcast_to(np.asarray(names[name], np.float64), STEPS) for name in Told._fields], axis=1)
    found = close_loop(
        controller or default_velocity(),
        pedals_with(),
        true or pedals_with(),
        jnp.float32(start_mps),
        jnp.asarray(signals, jnp.float32),
    )
    return Driven(*np.asarray(found, np.float64).T)


def from_s(time_s: float, after: float, before: float = 0.0) -> Float[np.ndarray, " step"]:
    return np.where(STEP_S * np.arange(STEPS) < time_s, before, after)


def at(time_s: float) -> int:
    return round(time_s / STEP_S)


def test_from_standstill_to_ten_miles_an_hour() -> None:
    speed = drive().speed_mps
    assert speed.max() < 1.03 * CRUISE_MPS
    assert np.abs(speed[at(20.0) :] - CRUISE_MPS).max() < 0.05
    # No faster than the reference may rise.
    assert np.diff(speed).max() <= 1.3 * 0.8 * STEP_S


@pytest.mark.parametrize("grade", [0.05, -0.05])
def test_a_hill_is_only_felt_for_a_while(grade: float) -> None:
    driven = drive(start_mps=CRUISE_MPS, grade=from_s(20.0, grade))
    wrong = np.abs(driven.speed_mps - CRUISE_MPS)
    assert wrong[at(20.0) :].max() < 0.6
    assert wrong[at(50.0) :].max() < 0.06
    assert (driven.brake[at(50.0) :] > 0.0).all() == (grade < 0.0)
    assert wrong[at(15.0) : at(20.0)].max() < 0.03


@pytest.mark.parametrize(("gain", "rolling", "lag_s"), [(2.0, 0.3, 0.6), (4.5, 0.05, 0.6), (3.0, 0.15, 1.2)])
def test_pedals_that_are_not_as_believed_are_learnt(gain: float, rolling: float, lag_s: float) -> None:
    speed = drive(true=pedals_with(gain, rolling, lag_s)).speed_mps
    assert speed.max() < 1.10 * CRUISE_MPS
    assert np.abs(speed[at(50.0) :] - CRUISE_MPS).max() < 0.1


def test_after_thirty_seconds_of_full_throttle_the_speed_hardly_overshoots() -> None:
    hill = from_s(10.0, 0.32) - from_s(40.0, 0.32)
    driven = drive(start_mps=CRUISE_MPS, grade=hill)
    assert (driven.throttle[at(20.0) : at(40.0)] == 1.0).all()
    assert driven.speed_mps[at(39.0)] < 0.5 * CRUISE_MPS
    assert CRUISE_MPS - 0.05 < driven.speed_mps[at(40.0) :].max() < 1.10 * CRUISE_MPS


def test_the_first_throttle_is_the_one_that_keeps_the_speed() -> None:
    driven = drive(start_mps=3.0, wanted_mps=3.0)
    assert driven.throttle[0] == pytest.approx(0.12 + (0.15 + 0.03 * 3.0) / 3.0, abs=1e-6)


def test_engaging_while_rolling_is_without_a_jolt() -> None:
    """The operator lets the vehicle roll out; what the controller then does begins with the speed that is."""
    driven = drive(start_mps=4.0, wanted_mps=3.0, active=from_s(2.0, 1.0))
    assert (driven.throttle[: at(2.0)] == 0.0).all()
    assert (driven.integral_mps2[: at(2.0)] == 0.0).all()
    np.testing.assert_allclose(driven.reference_mps[1 : at(2.0)], driven.speed_mps[: at(2.0) - 1], atol=1e-6)
    after = driven.speed_mps[at(2.0) :]
    assert np.abs(np.diff(after[: at(1.0)])).max() < 1.1 * STEP_S
    assert np.abs(after[at(20.0) :] - 3.0).max() < 0.05


def test_a_wanted_speed_of_zero_stops_and_holds() -> None:
    driven = drive(start_mps=CRUISE_MPS, wanted_mps=from_s(2.0, 0.0, CRUISE_MPS))
    way = 0.5 * CRUISE_MPS**2 / 1.0
    assert driven.way_m[-1] - driven.way_m[at(2.0)] == pytest.approx(way, rel=0.15)
    assert driven.speed_mps[-1] == 0.0
    assert (driven.brake[at(15.0) :] == np.float32(0.4)).all()
    assert (driven.throttle[at(15.0) :] == 0.0).all()


def test_from_the_hold_it_drives_off_again() -> None:
    driven = drive(wanted_mps=from_s(5.0, 2.0))
    assert (driven.speed_mps[: at(5.0)] == 0.0).all()
    assert np.abs(driven.speed_mps[at(25.0) :] - 2.0).max() < 0.05
    assert driven.speed_mps.max() < 2.2


def ramp_stop_m(speed_mps: float) -> float:
    """Way of a stop whose deceleration rises at 1.5 m/s³ to 1.5 m/s², with the brake's lag of 0.25 s behind it.

    Rolling resistance and drag act at once and are counted in what the brake is asked for in the end.
    """
    speed, way, brake, asked, step = speed_mps, 0.0, 0.0, 0.0, 1e-4
    while speed > 0.0:
        resisted = 0.15 + 0.03 * speed
        asked = min(asked + 1.5 * step, 1.5 - resisted)
        brake += (asked - brake) * step / 0.25
        way += speed * step
        speed -= (brake + resisted) * step
    return way


@pytest.mark.parametrize(("speed", "offset"), [(1.5, 0.0), (CRUISE_MPS, np.nan)])
def test_a_controlled_stop_takes_the_way_of_its_ramp_also_without_a_speed(speed: float, offset: float) -> None:
    driven = drive(start_mps=speed, active=0.0, stop=1.0, offset_mps=offset)
    way = ramp_stop_m(speed)
    # Without a speed the brake does not leave out what rolling resistance and drag do.
    assert driven.way_m[-1] == pytest.approx(way, rel=0.02 if offset == 0.0 else 0.15)
    assert driven.speed_mps[-1] == 0.0
    assert (driven.throttle == 0.0).all()
    assert np.diff(driven.brake).max() <= 1.5 * STEP_S / 6.0 + 0.19 + 1e-6
    assert driven.brake[-1] == pytest.approx(0.18 + 1.5 / 6.0 if offset != 0.0 else 0.43, abs=0.03)


def test_a_controlled_stop_begins_where_the_brake_is_and_does_not_end_by_itself() -> None:
    driven = drive(start_mps=CRUISE_MPS, wanted_mps=from_s(0.5, 0.0, CRUISE_MPS), stop=from_s(2.5, 1.0))
    first, before = driven.brake[at(2.5)], driven.brake[at(2.5) - 1]
    assert before > 0.18
    assert first - before == pytest.approx(1.5 * STEP_S / 6.0, abs=1e-5)
    assert (np.diff(driven.brake[at(2.5) :]) > -1e-7).all()


def test_never_both_pedals_nor_a_command_or_a_state_that_is_no_number() -> None:
    """2,000 states and inputs at once, of wild numbers and of those that are none."""
    rng, count = np.random.default_rng(3), 2000
    wild = np.array([np.nan, np.inf, -np.inf, 0.0, -0.0, 1e-40, 3.4e38, -3.4e38, 1e-3], np.float32)

    def some(low: float, high: float, wild_share: float = 0.0) -> Float[Array, " lane"]:
        drawn = rng.uniform(low, high, count)
        return jnp.asarray(np.where(rng.random(count) < wild_share, rng.choice(wild, count), drawn), jnp.float32)

    braking, side = some(-0.75, 0.75), jnp.asarray(rng.choice([-1.0, 1.0], count), jnp.float32)
    presses = (Pressed(jnp.maximum(sign * braking, 0.0), side) for sign in (1.0, -1.0))
    pedal = jnp.asarray(rng.integers(-1, 2, count), jnp.int32)
    state = VelocityState(some(0.0, 10.0), some(0.0, 10.0), some(-3.0, 3.0), pedal, *presses)
    active = rng.random(count) < 0.5
    wanted, speed = some(-10.0, 20.0, 0.4), some(-10.0, 20.0, 0.4)
    controller, pedals, step_s = default_velocity(), pedals_with(), jnp.float32(STEP_S)
    held = jax.jit(jax.vmap(step_velocity, in_axes=(None, None, 0, 0, 0, 0, None)))(
        controller, pedals, state, wanted, speed, jnp.asarray(active), step_s
    )
    stopped = jax.jit(jax.vmap(step_stop, in_axes=(None, None, 0, 0, None)))(controller, pedals, state, speed, step_s)
    for after, throttle, brake in (held, stopped):
        assert (np.asarray(throttle) * np.asarray(brake) == 0.0).all()
        assert ((np.asarray(throttle) >= 0.0) & (np.asarray(throttle) <= 1.0)).all()
        assert ((np.asarray(brake) >= 0.0) & (np.asarray(brake) <= 1.0)).all()
        assert all(np.isfinite(np.asarray(part)).all() for part in jax.tree.leaves(after))
    assert (np.asarray(held[1])[~active] == 0.0).all()
    assert (np.asarray(held[2])[~active] == 0.0).all()


def test_a_speed_that_is_missing_for_a_moment_leaves_no_trace() -> None:
    gap = np.where((np.arange(STEPS) >= at(30.0)) & (np.arange(STEPS) < at(30.1)), np.nan, 0.0)
    driven = drive(offset_mps=gap)
    missing = np.isnan(gap)
    assert (driven.throttle[missing] == 0.0).all()
    assert (driven.brake[missing] == 0.0).all()
    assert driven.integral_mps2[at(30.0)] == driven.integral_mps2[at(30.0) - 1]
    assert np.abs(driven.speed_mps[at(30.0) :] - CRUISE_MPS).max() < 0.1


def test_every_setting_changes_what_is_done() -> None:
    """A drive with a start, a hill down, a stop under control to a hold, and a controlled stop at the end of it."""
    wanted = from_s(30.0, 1.0, CRUISE_MPS) - from_s(45.0, 1.0) + from_s(55.0, 3.0)
    # The gear's other way by a little: at rest, for a vehicle that stands below more than that.
    offset = 0.06 * (from_s(50.0, 1.0) - from_s(55.0, 1.0))
    grade = from_s(12.0, 0.25) - from_s(20.0, 0.30) + from_s(30.0, 0.05)
    told = {"wanted_mps": wanted, "grade": grade, "stop": from_s(70.0, 1.0), "offset_mps": offset}
    usual, first = default_velocity(), drive(**told)
    for name in VelocitySettings._fields:
        second = drive(controller=usual._replace(**{name: getattr(usual, name) * 1.5}), **told)
        changed = [np.abs(one - two).max() for one, two in zip(first[1:3], second[1:3], strict=True)]
        assert max(changed) > 0.01, name
