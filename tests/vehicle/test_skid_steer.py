"""Skid-steer motion against an integration of its rates, and the geometry that MF section 2 says in words."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from lgprjax.vehicle import VehiclePose, WheelSpeeds, body_rates, drive_skid_arc, wheel_speeds

TRACK_M = 1.2
f32 = jnp.float32
# Both sides forward, hardly apart, backwards, on the spot, one side standing, nothing at all.
WHEELS = [(0.6, 0.9), (0.5, 0.5), (0.5, 0.5001), (-0.8, -0.5), (-0.4, 0.4), (0.0, 0.7), (0.0, 0.0), (2.0, -0.3)]
POSE = (12.0, -7.0, 2.5)


@jax.jit
def arc(left: jax.Array, right: jax.Array, step_s: jax.Array) -> VehiclePose:
    return drive_skid_arc(VehiclePose(*map(f32, POSE)), f32(TRACK_M), WheelSpeeds(left, right), step_s)


def driven(left: float, right: float, step_s: float) -> np.ndarray:
    return np.asarray(arc(f32(left), f32(right), f32(step_s)), np.float64)


@pytest.mark.parametrize("step_s", [0.02, 3.0, -2.0])
def test_an_arc_is_the_integral_of_its_rates(step_s: float) -> None:
    for left, right in WHEELS:

        def rates(_: float, pose: np.ndarray, left: float = left, right: float = right) -> list[float]:
            speed = (left + right) / 2
            return [speed * np.cos(pose[2]), speed * np.sin(pose[2]), (right - left) / TRACK_M]

        expected = solve_ivp(rates, (0.0, step_s), POSE, rtol=1e-11, atol=1e-12).y[:, -1]
        np.testing.assert_allclose(driven(left, right, step_s), expected, atol=3e-6, err_msg=f"{left}, {right}")


def test_wheels_and_rates_undo_each_other() -> None:
    rng = np.random.default_rng(3)
    wheels = WheelSpeeds(*(jnp.asarray(rng.uniform(-2.0, 2.0, 100), jnp.float32) for _ in range(2)))
    speed, rate = body_rates(f32(TRACK_M), wheels)
    np.testing.assert_allclose(np.asarray(wheel_speeds(f32(TRACK_M), speed, rate)), np.asarray(wheels), atol=1e-6)
    # Counter-clockwise when the right side is the faster one.
    np.testing.assert_array_equal(np.asarray(rate) > 0.0, np.asarray(wheels.right_mps) > np.asarray(wheels.left_mps))


def test_lanes_drive_alone_and_slopes_are_finite() -> None:
    """Many lanes are as one each; the derivative by a wheel is finite on the straight line too."""
    pose = VehiclePose(*(jnp.full(len(WHEELS), value, jnp.float32) for value in POSE))
    left, right = jnp.asarray(WHEELS, jnp.float32).T
    many = np.asarray(drive_skid_arc(pose, f32(TRACK_M), WheelSpeeds(left, right), f32(1.0)))
    alone = np.stack([driven(float(a), float(b), 1.0) for a, b in WHEELS], axis=1)
    np.testing.assert_allclose(many, alone, atol=2e-6)

    def aside(right_mps: jax.Array) -> jax.Array:
        start = VehiclePose(f32(0.0), f32(0.0), f32(0.0))
        return drive_skid_arc(start, f32(TRACK_M), WheelSpeeds(f32(0.5), right_mps), f32(1.0)).y_m

    # Straight ahead for 0.5 m: a turn of dv / track swings the end by half of that times the way.
    assert float(jax.grad(aside)(f32(0.5))) == pytest.approx(0.5 * 0.5 / TRACK_M, rel=1e-4)
