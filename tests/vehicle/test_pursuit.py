"""Steering geometry and pursuit law against plain float64 geometry, in the float32 that is shipped."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import brentq

import rollout_lanes
from lgprjax.vehicle import (
    Chassis,
    MeasuredRear,
    ProportionalRear,
    VehiclePose,
    body_point,
    drive_arc,
    rear_angle,
    reverse_look_ahead_m,
    steer_closed,
    steer_exact,
    turn_of,
    yaw_gain,
    zero_slip_point,
)

L, ANCHOR, K = 3.8, 6.5, 0.63
ONE = jnp.float32(1.0)
steered = jax.jit(steer_exact)


def chassis(k: float = K, length: float = L, anchor: float = ANCHOR, largest_deg: float = 40.0) -> Chassis:
    body = rollout_lanes.chassis(k, anchor, largest_rad=np.radians(largest_deg))
    return body._replace(wheelbase_m=jnp.float32(length))


def goal(distance: float, bearing: float) -> tuple[jax.Array, jax.Array]:
    return jnp.float32(distance * np.cos(bearing)), jnp.float32(distance * np.sin(bearing))


def wheel_rollout(front: float, k: float, length: float, travel: float, steps: int = 400) -> np.ndarray:
    """Rear axle's x, y and yaw by Runge-Kutta from the wheels' directions alone, float64."""

    def slope(state: np.ndarray) -> np.ndarray:
        rear = np.tan(k * front)
        yaw_rate = (np.tan(front) + rear) / length
        cos, sin = np.cos(state[2]), np.sin(state[2])
        return np.array([cos + rear * sin, sin - rear * cos, yaw_rate])

    state, h = np.zeros(3), travel / steps
    for _ in range(steps):
        a = slope(state)
        b = slope(state + h / 2 * a)
        c = slope(state + h / 2 * b)
        state = state + h / 6 * (a + 2 * b + 2 * c + slope(state + h * c))
    return state


def goal_of_angle(front: float, distance: float, k: float, length: float, anchor: float) -> float:
    """Bearing of the goal at a distance on the anchor's circle."""
    tangents = np.tan(front) + np.tan(k * front)
    x_c, y_c = length * np.tan(k * front) / tangents, length / tangents
    return float(np.arctan((anchor - x_c) / y_c) + np.arcsin(distance / (2 * np.hypot(anchor - x_c, y_c))))


@pytest.mark.parametrize("k", [0.0, 0.63, 1.0])
def test_anchor_passes_through_the_goal(k: float) -> None:
    """The angle of the law, driven by the wheels' directions alone, comes to the goal within 0.2 mm (float32)."""
    rng = np.random.default_rng(3)
    tried = 0
    for _ in range(30):
        length, anchor = rng.uniform(2, 6), rng.uniform(0, 12)
        distance, bearing = rng.uniform(2, 15), rng.uniform(-1, 1)
        steering = steered(chassis(k, length, anchor), *goal(distance, bearing), ONE)
        front = float(steering.front_rad)
        if not steering.reachable or abs(front) < 1e-3:
            continue
        tried += 1
        tangents = np.tan(front) + np.tan(k * front)
        x_c, kappa = length * np.tan(k * front) / tangents, tangents / length
        travel = 2 * (bearing - np.arctan((anchor - x_c) * kappa)) / kappa
        x, y, yaw = wheel_rollout(front, k, length, travel)
        miss = np.hypot(
            x + anchor * np.cos(yaw) - anchor - distance * np.cos(bearing),
            y + anchor * np.sin(yaw) - distance * np.sin(bearing),
        )
        assert miss < 2e-4
    assert tried > 15


@pytest.mark.parametrize(("degrees", "distance", "error"), [(10, 3, -0.15), (30, 3, -1.37), (30, 12, -2.44)])
def test_command_error_of_the_closed_form(degrees: int, distance: float, error: float) -> None:
    front = np.radians(degrees)
    at = goal(distance, goal_of_angle(front, distance, K, L, ANCHOR))
    assert float(steered(chassis(), *at, ONE).front_rad) == pytest.approx(front, rel=2e-6)
    assert 100 * (float(steer_closed(chassis(), *at, ONE)) / front - 1) == pytest.approx(error, abs=0.01)


def test_arc_is_that_of_the_wheels() -> None:
    """Any angle, zero and hardly any included, forwards and in reverse."""
    start = VehiclePose(jnp.float32(0.0), jnp.float32(0.0), jnp.float32(0.0))
    drive = jax.jit(lambda k, front, travel: drive_arc(start, travel, turn_of(_with_ratio(k), front)))
    for front, k, travel in (
        (0.0, 0.63, 8.0), (1e-6, 0.63, -8.0), (0.625, 1.0, 8.0), (-0.6, 0.0, 5.0), (-0.3, 0.63, -8.0), (0.4, 0.3, 0.05),
    ):  # fmt: skip
        pose = drive(jnp.float32(k), jnp.float32(front), jnp.float32(travel))
        np.testing.assert_allclose([float(v) for v in pose], wheel_rollout(front, k, L, travel), atol=2e-5)


def _with_ratio(k: jax.Array) -> Chassis:
    return chassis()._replace(rear=ProportionalRear(k))


def test_yaw_gain_keeps_the_zero_slip_point() -> None:
    """Loss of yaw: x_c moves along the body axis all the same, and the yaw is less by G."""
    body, front = chassis()._replace(characteristic_speed_mps=jnp.float32(20.0)), jnp.float32(0.2)
    gain = yaw_gain(body.characteristic_speed_mps, jnp.float32(4.47))
    assert float(gain) == pytest.approx(0.952, abs=5e-4)
    start = VehiclePose(jnp.float32(0.0), jnp.float32(0.0), jnp.float32(0.0))
    travel = jnp.float32(0.05)
    pose = drive_arc(start, travel, turn_of(body, front), gain)
    whole = drive_arc(start, travel, turn_of(body, front))
    assert float(pose.yaw_rad / whole.yaw_rad) == pytest.approx(float(gain), rel=1e-5)
    x_c = zero_slip_point(body, front)
    _, before = body_point(start, x_c)
    _, after = body_point(pose, x_c)
    assert abs(float(after - before)) < 0.05 * 0.5 * float(pose.yaw_rad) + 1e-6


def test_feed_forward_asks_for_what_the_gain_takes() -> None:
    body = chassis()
    gain, at = jnp.float32(0.9), goal(6.0, 0.4)
    front = steered(body, *at, gain).front_rad
    assert float(gain * turn_of(body, front).curvature_radpm) == pytest.approx(
        2 * np.sin(0.4) / (6.0 + 2 * (ANCHOR - float(zero_slip_point(body, front))) * np.cos(0.4)), rel=1e-5
    )


def brent_angle(distance: float, bearing: float, anchor: float, largest: float) -> float | None:
    """Root of LL eq. 2 within the wheels' limits on the goal's side, where the left side rises at both ends."""
    a, b = distance / 2 + anchor * np.cos(bearing), distance / 2 + (anchor - L) * np.cos(bearing)

    def left(front: float) -> float:
        return float(a * np.tan(front) + b * np.tan(K * front) - L * np.sin(bearing))

    end = np.sign(bearing) * largest
    rises = a + K * b > 0 and a / np.cos(largest) ** 2 + K * b / np.cos(K * largest) ** 2 > 0
    if not rises or left(end) * np.sign(bearing) < 0:
        return None
    return float(brentq(left, 0.0, end, xtol=1e-13))


def test_every_goal_is_reached_or_flagged() -> None:
    """3,000 goals all round: Brent's root where there is one, else the largest angle and a flag."""
    rng = np.random.default_rng(11)
    distance, bearing = rng.uniform(1, 20, 3_000), rng.uniform(-np.pi, np.pi, 3_000)
    body = chassis(largest_deg=35.0)
    ahead, left = (jnp.asarray(distance * f(bearing), jnp.float32) for f in (np.cos, np.sin))
    steering = steered(body, ahead, left, jnp.ones_like(ahead))
    front, reachable = np.asarray(steering.front_rad), np.asarray(steering.reachable)
    expected = [brent_angle(d, e, ANCHOR, np.radians(35.0)) for d, e in zip(distance, bearing, strict=True)]
    found = np.array([value is not None for value in expected])
    # At the very limit float32 and float64 may differ.
    assert np.mean(found != reachable) < 5e-4
    both = found & reachable
    error = np.abs(front[both] - np.array([v for v, ok in zip(expected, both, strict=True) if ok], dtype=float))
    assert error.max() < 5e-5
    assert 0.2 < found.mean() < 0.95
    np.testing.assert_array_equal(np.abs(front[~reachable]), np.float32(np.radians(35.0)))
    np.testing.assert_array_equal(np.sign(front[~reachable]), np.sign(bearing[~reachable]))


def test_no_goal_is_no_command() -> None:
    """A goal that is no number gives no number: the limiter's business. One at the anchor asks for nothing."""
    nan, zero = jnp.float32(np.nan), jnp.float32(0.0)
    assert np.isnan(float(steered(chassis(), nan, nan, ONE).front_rad))
    here = steered(chassis(), zero, zero, ONE)
    assert float(here.front_rad) == 0.0
    assert not here.reachable


def test_measured_rear_takes_the_place_of_k() -> None:
    """sin ψ = 0.6 sin φ as knots: the law solves eq. 2 with it, and between knots it is linear."""
    knots = np.linspace(-0.8, 0.8, 65)
    rear = MeasuredRear(
        jnp.float32(-0.8), jnp.float32(knots[1] - knots[0]), jnp.asarray(np.arcsin(0.6 * np.sin(knots)), jnp.float32)
    )
    body = chassis()._replace(rear=rear)
    assert float(rear_angle(rear, jnp.float32(np.radians(30)))[0]) == pytest.approx(np.arcsin(0.3), abs=2e-5)

    def left(front: float) -> float:
        tangent = np.tan(np.arcsin(0.6 * np.sin(front)))
        a, b = 3.0 + ANCHOR * np.cos(0.6), 3.0 + (ANCHOR - L) * np.cos(0.6)
        return float(a * np.tan(front) + b * tangent - L * np.sin(0.6))

    steering = steered(body, *goal(6.0, 0.6), ONE)
    assert steering.reachable
    assert float(steering.front_rad) == pytest.approx(brentq(left, 0.0, 0.7), abs=2e-4)
    # Beyond the last knot it goes on with the last slope.
    assert float(rear_angle(rear, jnp.float32(1.0))[0]) > float(rear.rear_rad[-1])


def test_reversing_needs_twice_the_lead() -> None:
    """Behind the anchor, a goal a little farther than 2 |l − x_c| is steered to; a nearer one cannot be."""
    body = chassis()
    least = float(reverse_look_ahead_m(body))
    assert least == pytest.approx(2 * (ANCHOR - K * L / (1 + K)), rel=1e-6)
    bearing = np.pi - 0.02
    far, near = (steered(body, *goal(share * least, bearing), ONE) for share in (1.1, 0.9))
    assert far.reachable
    assert not near.reachable
