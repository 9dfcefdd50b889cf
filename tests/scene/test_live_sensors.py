"""Sensors of the closed loop: their errors have the sizes they say, and their faults come when they are asked for."""

from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from lgprjax.scene import (
    LiveSensors,
    Readings,
    SensorFaults,
    init_live_sensors,
    live_sensors,
    no_faults,
    read_live_sensors,
)
from lgprjax.vehicle import VehiclePose

_TICK_S = 1.0 / 21.0
_TICKS = 420
_SPEED = 4.0
Run = Callable[[SensorFaults], Readings]


@pytest.fixture(scope="module")
def model() -> LiveSensors:
    return live_sensors(tick_s=_TICK_S, gnss_x_m=1.0, gnss_slow_m=0.1, gnss_hz=7.0)


@pytest.fixture(scope="module")
def run(model: LiveSensors) -> Run:
    """400 drives eastward at 4 m/s, by faults; readings [drive, tick]."""

    def one(faults: SensorFaults, key: jax.Array) -> Readings:
        zero = jnp.float32(0.0)

        def step(state, tick):  # type: ignore[no-untyped-def]
            pose = VehiclePose(_SPEED * _TICK_S * tick.astype(jnp.float32), zero, zero)
            noise = jax.random.fold_in(key, tick)
            return read_live_sensors(model, faults, state, noise, pose, jnp.float32(_SPEED), zero, tick, _TICK_S)

        readings: Readings = jax.lax.scan(step, init_live_sensors(model, key), jnp.arange(1, _TICKS + 1))[1]
        return readings

    many = jax.jit(jax.vmap(one, in_axes=(None, 0)))
    keys = jax.random.split(jax.random.key(0), 400)

    def read(faults: SensorFaults) -> Readings:
        readings: Readings = jax.tree.map(lambda leaf: np.asarray(leaf, np.float64), many(faults, keys))
        return readings

    return read


_TIME_S = np.arange(1, _TICKS + 1) * _TICK_S
_EAST_M = 1.0 + _SPEED * _TIME_S


def test_errors_have_their_sizes(run: Run, model: LiveSensors) -> None:
    found = run(no_faults())
    due = found.gnss_valid[0] > 0
    assert np.flatnonzero(due).tolist() == list(range(2, _TICKS, 3))
    wrong = found.gnss_m[:, due, 0] - _EAST_M[due]
    # Within a drive the slow error hardly changes: 400 numbers tell a sigma to 3.5 %.
    assert wrong.std() == pytest.approx(np.hypot(0.1, 0.01), rel=0.11)
    # Slow: two seconds apart (14 positions) it has kept exp(-2 / 60) of itself.
    kept = np.mean(wrong[:, :-14] * wrong[:, 14:]) / np.mean(wrong**2)
    assert kept == pytest.approx(np.exp(-2.0 / 60.0) * 0.1**2 / (0.1**2 + 0.01**2), abs=0.02)
    scale = (found.odometer_mps / _SPEED - 1.0).mean(axis=1)
    assert scale.std() == pytest.approx(float(model.odometer_scale), rel=0.12)
    assert found.yaw_rate_radps.mean(axis=1).std() == pytest.approx(float(model.rate_bias_radps), rel=0.12)
    assert found.heading_rad.mean(axis=1).std() == pytest.approx(float(model.heading_slow_rad), rel=0.15)


def test_faults_come_and_go(run: Run) -> None:
    def between(low: float, high: float) -> jax.Array:
        return jnp.asarray([low, high], jnp.float32)

    faults = no_faults()._replace(
        gnss_lost_s=between(2.0, 4.0),
        heading_lost_s=between(3.0, 5.0),
        odometer_lost_s=between(6.0, 7.0),
        slip_s=between(8.0, 9.0),
        slip=jnp.float32(0.2),
    )
    found = run(faults)
    for valid, low, high in (
        (found.gnss_valid, 2.0, 4.0),
        (found.heading_valid, 3.0, 5.0),
        (found.odometer_valid, 6.0, 7.0),
    ):
        inside = (low <= _TIME_S) & (high > _TIME_S)
        assert not valid[:, inside].any()
        assert valid[:, ~inside].any(axis=1).all()
    slipping = (_TIME_S >= 8.0) & (_TIME_S < 9.0)
    ratio = found.odometer_mps[:, slipping].mean() / found.odometer_mps[:, _TIME_S < 6.0].mean()
    assert ratio == pytest.approx(1.2, abs=0.002)


def test_a_jump_stays_a_drift_grows_and_a_frozen_receiver_repeats(run: Run) -> None:
    clean = run(no_faults()).gnss_m
    jumped = run(no_faults()._replace(gnss_jump_s=jnp.float32(5.0), gnss_jump_m=jnp.asarray([3.0, -4.0]))).gnss_m
    after = (_TIME_S >= 5.1) & (np.arange(1, _TICKS + 1) % 3 == 0)
    assert (jumped - clean)[:, after] == pytest.approx(np.broadcast_to([3.0, -4.0], (400, after.sum(), 2)), abs=1e-4)
    drift = run(no_faults()._replace(gnss_drift_s=jnp.float32(5.0), gnss_drift_mps=jnp.asarray([0.0, 0.1]))).gnss_m
    assert (drift - clean)[:, after, 1] == pytest.approx(
        np.broadcast_to(0.1 * (_TIME_S[after] - 5.0), (400, after.sum())), abs=1e-4
    )
    frozen = run(no_faults()._replace(gnss_frozen_s=jnp.asarray([5.0, jnp.inf]))).gnss_m
    assert np.all(frozen[:, _TIME_S >= 5.0] == frozen[:, _TIME_S >= 5.0][:, :1])


def test_a_receiver_that_is_frozen_from_the_start_has_nothing_to_repeat(run: Run) -> None:
    frozen, later = (run(no_faults()._replace(gnss_frozen_s=jnp.asarray([from_s, 5.0]))) for from_s in (0.0, 1.0))
    assert not frozen.gnss_valid[:, _TIME_S < 5.0].any()
    assert frozen.gnss_valid[:, _TIME_S >= 5.0].any()
    assert later.gnss_valid[:, _TIME_S < 5.0].any()
