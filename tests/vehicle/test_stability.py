"""Limits of stability by simulation of the full loop, and the formulas beside them."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import rollout_lanes
from lgprjax.vehicle import (
    Chassis,
    Servo,
    ServoState,
    VehiclePose,
    body_point,
    damping,
    drive_arc,
    ideal_servo,
    init_servo,
    phase_margin_rad,
    steer_exact,
    step_servo,
    turn_of,
)

L, K = 3.8, 0.63
X_C = K * L / (1 + K)
STEP_S = 0.01


def lag_limit_s(look_ahead_m: float, lead_m: float, speed_mps: float) -> float:
    """Largest first-order lag of the steering, (D + a)/v, by Routh's criterion."""
    return (look_ahead_m + lead_m) / speed_mps


def delay_limit_s(look_ahead_m: float, lead_m: float, speed_mps: float, lag_s: float) -> float:
    """Largest pure delay beside a lag: a delay of a second costs as much margin as the loop crosses over at, rad/s."""

    def margin_rad(delay_s: float) -> float:
        look_ahead, lead, speed, lag, delay = jnp.asarray(
            (look_ahead_m, lead_m, speed_mps, lag_s, delay_s), jnp.float32
        )
        return float(phase_margin_rad(look_ahead, lead, speed, lag, delay))

    return margin_rad(0.0) / (margin_rad(0.0) - margin_rad(1.0))


def chassis(lead: float) -> Chassis:
    return rollout_lanes.chassis(K, X_C + lead, largest_rad=0.7)


@jax.jit
def offsets(
    body: Chassis, servo: Servo, look_ahead_m: jax.Array, speed_mps: jax.Array, start_m: jax.Array
) -> jax.Array:
    """Anchor's offset from the x axis over 6,000 steps of 10 ms: law, servo and exact arcs, one lane a servo."""
    lanes = servo.lag_s.shape
    state = init_servo(jnp.zeros(lanes), delay_slots=200)
    pose = VehiclePose(jnp.zeros(lanes), jnp.broadcast_to(start_m, lanes), jnp.zeros(lanes))

    def step(carry: tuple[VehiclePose, ServoState], _: jax.Array) -> tuple[tuple[VehiclePose, ServoState], jax.Array]:
        pose, state = carry
        _, y = body_point(pose, body.anchor_m)
        ahead = jnp.sqrt(jnp.maximum(look_ahead_m**2 - y**2, 0.01 * look_ahead_m**2))
        cos, sin = jnp.cos(pose.yaw_rad), jnp.sin(pose.yaw_rad)
        wanted = steer_exact(body, cos * ahead - sin * y, -sin * ahead - cos * y, jnp.ones(lanes)).front_rad
        state = step_servo(state, servo, wanted, 1.0, STEP_S)
        return (drive_arc(pose, speed_mps * STEP_S, turn_of(body, state.wheel_rad)), state), y

    track: jax.Array = jax.lax.scan(step, (pose, state), jnp.arange(6_000))[1]
    return track


def servos(lag_s: np.ndarray, delay_s: np.ndarray) -> Servo:
    plain = Servo(*(jnp.broadcast_to(field, (len(lag_s),)) for field in ideal_servo()))
    return plain._replace(lag_s=jnp.asarray(lag_s, jnp.float32), delay_s=jnp.asarray(delay_s, jnp.float32))


def grows(track: np.ndarray) -> np.ndarray:
    """Whether each lane's swing in the last quarter is larger than in the second."""
    quarter = len(track) // 4
    return np.asarray(np.ptp(track[3 * quarter :], axis=0) > np.ptp(track[quarter : 2 * quarter], axis=0))


def limit(values: np.ndarray, track: np.ndarray) -> float:
    """Middle between the largest value that decays and the smallest that grows."""
    unstable = grows(track)
    assert not unstable[0]
    assert unstable[-1]
    first = int(np.argmax(unstable))
    assert unstable[first:].all()
    return float(0.5 * (values[first - 1] + values[first]))


def test_lag_and_delay_limits() -> None:
    """A small offset dies out below the limits of the formulas and grows above them, within 3 %."""
    share, look_ahead, lead = np.linspace(0.9, 1.1, 21), 8.0, 5.03
    at = (look_ahead, lead, 4.47)
    lag_s, delay_s = lag_limit_s(*at) * share, delay_limit_s(*at, 0.0) * share
    run = (jnp.float32(look_ahead), jnp.float32(4.47), jnp.float32(0.01))
    lagging = np.asarray(offsets(chassis(lead), servos(lag_s, 0 * lag_s), *run))
    assert limit(share, lagging) == pytest.approx(1.0, abs=0.03)
    delayed = np.asarray(offsets(chassis(lead), servos(0 * delay_s, delay_s), *run))
    assert limit(share, delayed) == pytest.approx(1.0, abs=0.03)


@pytest.mark.parametrize(("look_ahead", "lead", "part"), [(5.0, 0.0, 0.8), (5.0, 5.03, 0.2)])
def test_lag_and_delay_together(look_ahead: float, lead: float, part: float) -> None:
    """With a share of the largest lag, the delay that is left is that of the formula within 3 %."""
    at = (jnp.float32(look_ahead), jnp.float32(lead), jnp.float32(4.47))
    lag_s = jnp.float32(part * lag_limit_s(look_ahead, lead, 4.47))
    share = np.linspace(0.9, 1.1, 21)
    delay_s = delay_limit_s(look_ahead, lead, 4.47, float(lag_s)) * share
    margin = phase_margin_rad(*at, lag_s, jnp.asarray(delay_s, jnp.float32))
    np.testing.assert_array_equal(np.asarray(margin) > 1e-5, share < 0.9999)
    track = np.asarray(
        offsets(
            chassis(lead), servos(np.full(21, float(lag_s)), delay_s), jnp.float32(look_ahead), at[2], jnp.float32(0.01)
        )
    )
    assert limit(share, track) == pytest.approx(1.0, abs=0.03)


def linear_loop(look_ahead: float, lead: float) -> np.ndarray:
    """Offset and heading error of pure pursuit, linear, in units of the way."""
    m = look_ahead / 2 + lead
    return np.array([[-lead / (m * look_ahead), 1 - lead / m], [-1 / (m * look_ahead), -1 / m]])


def test_damping_is_that_of_the_linear_loop() -> None:
    """From its eigenvalues, float64; the anchor may trail by less than half of the look-ahead."""
    for lead, expected in ((0.0, 0.707), (5.03, 0.817)):
        values = np.linalg.eigvals(linear_loop(5.0, lead))
        zeta = -values.real.sum() / (2 * np.sqrt(np.prod(values).real))
        assert float(damping(jnp.float32(5.0), jnp.float32(lead))) == pytest.approx(zeta, rel=1e-5)
        assert zeta == pytest.approx(expected, abs=2e-3)
    assert np.linalg.eigvals(linear_loop(5.0, -3.0)).real.max() == pytest.approx(1.15, abs=0.005)
    assert np.isnan(float(damping(jnp.float32(5.0), jnp.float32(-3.0))))
