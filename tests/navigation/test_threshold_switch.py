"""The threshold switch against a loop in plain Python, and its rules one by one."""

import math
from collections.abc import Sequence

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from lgprjax.navigation.health import SwitchSettings, SwitchState, init_switch, step_switch, switch_settings
from lgprjax.navigation.observations import LgprObservation, MotionInput, no_observations
from lgprjax.vehicle import VehiclePose

_TICK_S, _ARRAY_M, _SLIP_M = 0.125, 6.0, 1.5
_ENTER, _STAY = 1e-6, 1e-4
_SETTINGS = SwitchSettings(*(jnp.float32(v) for v in (_ENTER, _STAY, 1.0, _SLIP_M, _ARRAY_M, 0.2)))
_step = jax.jit(step_switch)


def _pose(x_m: float, y_m: float, yaw_rad: float) -> VehiclePose:
    return VehiclePose(jnp.float32(x_m), jnp.float32(y_m), jnp.float32(yaw_rad))


def _fix(rear: tuple[float, float, float], *, age_s: float = 0.0, valid: bool = True) -> LgprObservation:
    """A fix of the array's centre of a vehicle whose rear axle is there."""
    x, y, yaw = rear
    c, s = math.cos(yaw), math.sin(yaw)
    at = (x + c * _ARRAY_M - s * 0.2, y + s * _ARRAY_M + c * 0.2, yaw)
    numbers = [jnp.float32(v) for v in at]
    return no_observations().lgpr._replace(
        x_m=numbers[0], y_m=numbers[1], yaw_rad=numbers[2], age_s=jnp.float32(age_s), valid=jnp.asarray(valid)
    )


def _run(
    chances: Sequence[float | None], *, elsewhere_m: float = 50.0, settings: SwitchSettings = _SETTINGS
) -> list[SwitchState]:
    """Standing at (3, 4): a fix that is false with each probability, or none; GNSS/INS says another place."""
    other = _pose(3.0 + elsewhere_m, 4.0, 0.3)
    motion = MotionInput(jnp.float32(0.0), jnp.float32(_TICK_S))
    state, states = init_switch(other), []
    for chance in chances:
        lgpr = _fix((3.0, 4.0, 0.3), valid=chance is not None)
        told = jnp.float32(math.nan if chance is None else chance)
        state = _step(settings, state, motion, jnp.float32(0.0), other, lgpr, told)
        states.append(state)
    return states


def test_gnss_ins_has_the_word_until_a_fix_is_good_enough() -> None:
    states = _run([None, 1.1e-6, 0.9e-6])
    assert [bool(state.on_lgpr) for state in states] == [False, False, True]
    assert float(states[1].pose.x_m) == pytest.approx(53.0)
    np.testing.assert_allclose([float(v) for v in states[2].pose], [3.0, 4.0, 0.3], atol=1e-5)


def test_what_stays_may_be_worse_than_what_enters() -> None:
    states = _run([1e-9] + [5e-5] * 30)
    assert all(bool(state.on_lgpr) for state in states)
    assert not any(bool(state.on_lgpr) for state in _run([5e-5] * 30))


def test_the_limits_follow_the_risk_that_is_asked_for() -> None:
    place = {"zero_slip_m": _SETTINGS.zero_slip_m, "array_x_m": _SETTINGS.array_x_m, "array_y_m": _SETTINGS.array_y_m}
    chances = [2e-5, 5e-8, 2e-5]
    loose, strict = (_run(chances, settings=switch_settings(risk, **place)) for risk in (1e-2, 1e-5))
    assert [bool(state.on_lgpr) for state in loose] == [True] * 3
    # At the stricter risk the second fix takes over; the third is too doubtful even to stay, and is not taken up.
    assert [bool(state.on_lgpr) for state in strict] == [False, True, True]
    assert float(strict[2].since_good_s) == pytest.approx(_TICK_S)


def test_a_fix_of_unknown_chance_never_takes_over() -> None:
    other = _pose(53.0, 4.0, 0.3)
    motion = MotionInput(jnp.float32(0.0), jnp.float32(_TICK_S))
    fix = _fix((3.0, 4.0, 0.3))
    state = _step(_SETTINGS, init_switch(other), motion, jnp.float32(0.0), other, fix, jnp.float32(math.nan))
    assert not bool(state.on_lgpr)


def test_the_last_good_fix_is_carried_for_the_hold_and_no_longer() -> None:
    states = _run([1e-9] + [1e-3] * 12 + [1e-5, 1e-9])
    held = [bool(state.on_lgpr) for state in states]
    # A second is eight ticks; a fix that would do to stay does not lead back.
    assert held == [True] * 9 + [False] * 5 + [True]
    assert float(states[12].pose.x_m) == pytest.approx(53.0)


def test_carried_pose_is_dead_reckoned_on_the_arc() -> None:
    speed, rate, age_s = 4.0, 0.3, 0.07
    other = _pose(100.0, 0.0, 0.0)
    motion = MotionInput(jnp.float32(rate), jnp.float32(_TICK_S))
    state = _step(
        _SETTINGS,
        init_switch(other),
        motion,
        jnp.float32(speed),
        other,
        _fix((1.0, 2.0, 0.4), age_s=age_s),
        jnp.float32(1e-9),
    )
    for _ in range(5):
        state = _step(
            _SETTINGS, state, motion, jnp.float32(speed), other, _fix((0.0, 0.0, 0.0), valid=False), jnp.float32(1.0)
        )
    # By many small straight steps of the point that moves along the body axis.
    x, y, yaw = 1.0 + _SLIP_M * math.cos(0.4), 2.0 + _SLIP_M * math.sin(0.4), 0.4
    steps = 20000
    dt = (age_s + 5 * _TICK_S) / steps
    for _ in range(steps):
        x += speed * dt * math.cos(yaw + 0.5 * rate * dt)
        y += speed * dt * math.sin(yaw + 0.5 * rate * dt)
        yaw += rate * dt
    x, y = x - _SLIP_M * math.cos(yaw), y - _SLIP_M * math.sin(yaw)
    np.testing.assert_allclose([float(v) for v in state.pose], [x, y, yaw], atol=2e-5)
    assert float(state.since_good_s) == pytest.approx(age_s + 5 * _TICK_S, abs=1e-6)


def test_a_fix_that_is_no_number_leaves_no_trace() -> None:
    """Neither in an empty slot nor called valid."""
    other, motion = _pose(1.0, 1.0, 0.0), MotionInput(jnp.float32(0.1), jnp.float32(_TICK_S))
    nothing: LgprObservation = jax.tree.map(
        lambda leaf: leaf if leaf.dtype == bool else leaf * jnp.nan, no_observations().lgpr
    )
    for fix, chance in ((nothing, math.nan), (_fix((math.nan, 4.0, 0.3)), 1e-9)):
        state = _step(_SETTINGS, init_switch(other), motion, jnp.float32(1.0), other, fix, jnp.float32(chance))
        assert not bool(state.on_lgpr)
        assert all(np.isfinite(float(v)) for v in (*state.pose, *state.carried))
