"""Where all is linear the filter is that of an outside library in float64."""

import jax
import jax.numpy as jnp
import numpy as np
from filterpy.kalman import KalmanFilter

from lgprjax.navigation import (
    FilterModel,
    GnssObservation,
    MotionInput,
    NavEstimate,
    OdometerObservation,
    default_model,
    gnss_innovation,
    initial_sigmas,
    odometer_innovation,
    predict,
    update,
)

STEP_S = 1.0 / 21.0
f32 = jnp.float32


def test_a_linear_drive_is_that_of_filterpy() -> None:
    """Driving east with neither yaw nor bias nor scale in doubt: position, speed and GNSS error are linear."""
    model = default_model(zero_slip_m=1.4, gnss_x_m=0.8, gnss_y_m=0.3, array_x_m=6.0, array_y_m=0.0)._replace(
        initial_yaw_rad=f32(0.0),
        initial_rate_bias_radps=f32(0.0),
        initial_odometer_scale=f32(0.0),
        initial_position_m=f32(5.0),
        yaw_rate_noise=f32(0.0),
        rate_bias_walk=f32(0.0),
        odometer_scale_walk=f32(0.0),
        lgpr_error_sigma_m=f32(0.0),
    )
    m = FilterModel(*(np.float64(value) for value in model))  # type: ignore[arg-type]
    straight = MotionInput(f32(0.0), f32(STEP_S))
    ticks, rng = 420, np.random.default_rng(2)
    speeds = 4.0 + np.cumsum(rng.normal(0.0, 0.05, ticks))
    fixes = np.stack([np.cumsum(speeds) * STEP_S + 3.8, 0.3 + 0.5 * np.ones(ticks)], axis=1)
    fixes = fixes + rng.normal(0.0, 0.02, fixes.shape)
    wheels = speeds + rng.normal(0.0, 0.05, ticks)
    noise = np.array([[4e-4, 1e-4], [1e-4, 9e-4]])
    every = np.arange(ticks) % 4 == 0

    def tick(estimate: NavEstimate, given: tuple[jax.Array, jax.Array, jax.Array]) -> tuple[NavEstimate, NavEstimate]:
        fix, wheel, valid = given
        estimate = predict(model, estimate, straight)
        gnss = GnssObservation(fix[0], fix[1], f32(noise), f32(0.03), valid)
        estimate = update(estimate, gnss_innovation(model, estimate, straight, gnss))
        odometer = OdometerObservation(wheel, f32(0.0025), jnp.asarray(True))
        estimate = update(estimate, odometer_innovation(estimate, odometer))
        return estimate, estimate

    start = NavEstimate(jnp.zeros(13).at[3].set(4.0), jnp.diag(initial_sigmas(model) ** 2))
    given = (jnp.asarray(fixes, jnp.float32), jnp.asarray(wheels, jnp.float32), jnp.asarray(every))
    _, driven = jax.jit(lambda: jax.lax.scan(tick, start, given))()

    oracle = KalmanFilter(dim_x=5, dim_z=2)  # x, y, speed, GNSS error x and y
    fade = np.exp(-STEP_S / m.gnss_error_s)
    oracle.x = np.array([[0.0], [0.0], [4.0], [0.0], [0.0]])
    oracle.P = np.diag([25.0, 25.0, m.initial_speed_mps**2, m.gnss_error_sigma_m**2, m.gnss_error_sigma_m**2])
    oracle.F = np.diag([1.0, 1.0, 1.0, fade, fade])
    oracle.F[0, 2] = STEP_S
    wander = np.diag([0.0, 0.0, m.acceleration_noise**2 * STEP_S, 0.0, 0.0])
    errors = m.gnss_error_sigma_m**2 * (1.0 - fade**2)
    oracle.Q = oracle.F @ wander @ oracle.F.T + np.diag([0.0, m.side_noise**2 * STEP_S, 0.0, errors, errors])
    antenna = np.array([[1.0, 0.0, -0.03, 1.0, 0.0], [0.0, 1.0, 0.0, 0.0, 1.0]])
    kept = [0, 1, 3, 9, 10]
    for index in range(ticks):
        oracle.predict()
        if every[index]:
            oracle.update((fixes[index] - [m.gnss_x_m, m.gnss_y_m])[:, None], R=noise, H=antenna)
        oracle.update(wheels[index : index + 1, None], R=np.array([[0.0025]]), H=np.array([[0.0, 0.0, 1.0, 0.0, 0.0]]))
        sigma = np.sqrt(np.diagonal(oracle.P))
        mean = np.asarray(driven.mean[index], np.float64)[kept]
        covariance = np.asarray(driven.covariance[index], np.float64)[np.ix_(kept, kept)]
        np.testing.assert_allclose((mean - oracle.x[:, 0]) / sigma, 0.0, atol=0.02)
        np.testing.assert_allclose(covariance / np.outer(sigma, sigma), oracle.P / np.outer(sigma, sigma), atol=5e-3)
