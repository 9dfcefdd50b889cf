"""The filter's algebra against float64 and numerical derivatives."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from lgprjax.navigation import (
    STATES,
    FilterModel,
    GnssObservation,
    HeadingObservation,
    LgprObservation,
    MotionInput,
    NavEstimate,
    OdometerObservation,
    default_model,
    gnss_innovation,
    heading_innovation,
    initial_sigmas,
    lgpr_innovation,
    odometer_innovation,
    predict,
    transition_matrix,
    transition_of,
    update,
)
from lgprjax.navigation.kalman import weigh

STEP_S = 1.0 / 21.0
f32 = jnp.float32


@pytest.fixture(scope="module")
def model() -> FilterModel:
    return default_model(zero_slip_m=1.4, gnss_x_m=0.8, gnss_y_m=0.3, array_x_m=6.0, array_y_m=-0.1)


def doubles(model: FilterModel) -> FilterModel:
    """The model's numbers as float64."""
    return FilterModel(*(np.float64(value) for value in model))  # type: ignore[arg-type]


# The same model once more in float64, by the point without slip instead of the rear axle, in steps of a thousandth.


def moved(m: FilterModel, state: np.ndarray, gyro: float, step_s: float, steps: int = 1000) -> np.ndarray:
    """States after a time, the point without slip stepped along the body axis at the middle of each small step."""
    out = np.array(state, np.float64)
    rate = gyro - state[4]
    x = state[0] + m.zero_slip_m * np.cos(state[2])
    y = state[1] + m.zero_slip_m * np.sin(state[2])
    yaw = state[2] + rate * step_s * (np.arange(steps) + 0.5) / steps
    x += np.sum(np.cos(yaw)) * state[3] * step_s / steps
    y += np.sum(np.sin(yaw)) * state[3] * step_s / steps
    out[2] = state[2] + rate * step_s
    out[0], out[1] = x - m.zero_slip_m * np.cos(out[2]), y - m.zero_slip_m * np.sin(out[2])
    return out


def placed(state: np.ndarray, x_m: float, y_m: float) -> np.ndarray:
    cos, sin = np.cos(state[2]), np.sin(state[2])
    return np.array([state[0] + cos * x_m - sin * y_m, state[1] + sin * x_m + cos * y_m])


def next_state(m: FilterModel, state: np.ndarray, gyro: float) -> np.ndarray:
    out = moved(m, state, gyro, STEP_S)
    out[9:11] *= np.exp(-STEP_S / m.gnss_error_s)
    out[11:13] *= np.exp(-abs(state[3]) * STEP_S / m.lgpr_error_m)
    return out


def seen_gnss(m: FilterModel, state: np.ndarray, gyro: float, age_s: float) -> np.ndarray:
    return np.asarray(placed(moved(m, state, gyro, -age_s), float(m.gnss_x_m), float(m.gnss_y_m)) + state[9:11])


def seen_lgpr(m: FilterModel, state: np.ndarray, gyro: float, age_s: float) -> np.ndarray:
    then = moved(m, state, gyro, -(age_s + state[6]))
    return np.append(placed(then, m.array_x_m + state[7], m.array_y_m + state[8]) + state[11:13], then[2])


def seen_heading(m: FilterModel, state: np.ndarray, gyro: float, age_s: float) -> np.ndarray:
    return moved(m, state, gyro, -age_s)[2:3]


def seen_odometer(_: FilterModel, state: np.ndarray, __: float, ___: float) -> np.ndarray:
    return np.asarray(state[3:4] * (1.0 + state[5]))


def slopes(function: object, m: FilterModel, state: np.ndarray, *args: float) -> np.ndarray:
    """Central differences of each component by each state."""
    columns = []
    for index in range(len(STATES)):
        step = np.zeros(len(STATES))
        step[index] = 1e-5
        high, low = function(m, state + step, *args), function(m, state - step, *args)  # type: ignore[operator]
        columns.append((high - low) / 2e-5)
    return np.stack(columns, axis=1)


class Case(NamedTuple):
    state: np.ndarray
    gyro: float
    age_s: float


CASES = [
    Case(np.array([12.0, -7.0, 0.9, 4.5, 0.004, 0.02, 0.013, 0.04, -0.03, 0.08, -0.05, 0.02, 0.01]), 0.35, 0.031),
    Case(np.array([-30.0, 4.0, -2.5, -2.0, -0.01, -0.03, -0.02, 0.0, 0.05, 0.0, 0.1, 0.0, 0.03]), -0.2, 0.04),
    Case(np.array([5.0, 5.0, 3.1, 0.0, 0.01, 0.01, 0.02, 0.01, 0.0, 0.0, 0.0, 0.0, 0.0]), 0.01, 0.0),
]


def covariance_of(model: FilterModel) -> np.ndarray:
    """A covariance with every state correlated."""
    sigmas = np.asarray(initial_sigmas(model), np.float64)
    mixed = np.eye(13) + 0.2 * np.random.default_rng(5).standard_normal((13, 13))
    whole = mixed @ mixed.T
    scale = sigmas / np.sqrt(np.diagonal(whole))
    return np.asarray(whole * np.outer(scale, scale))


def estimate_of(case: Case, model: FilterModel) -> NavEstimate:
    return NavEstimate(jnp.asarray(case.state, jnp.float32), jnp.asarray(covariance_of(model), jnp.float32))


def motion_of(gyro: float) -> MotionInput:
    return MotionInput(f32(gyro), f32(STEP_S))


@pytest.fixture(scope="module")
def predicted(model: FilterModel) -> list[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """Prediction of every case: transition, mean and covariance."""

    @jax.jit
    def run(estimate: NavEstimate, motion: MotionInput) -> tuple[jax.Array, NavEstimate]:
        return transition_matrix(transition_of(model, estimate, motion)), predict(model, estimate, motion)

    found = []
    for case in CASES:
        matrix, after = run(estimate_of(case, model), motion_of(case.gyro))
        found.append(tuple(np.asarray(part, np.float64) for part in (matrix, *after)))
    return found  # type: ignore[return-value]


@pytest.mark.parametrize("index", range(len(CASES)))
def test_a_tick_moves_mean_and_covariance(
    index: int, model: FilterModel, predicted: list[tuple[np.ndarray, np.ndarray, np.ndarray]]
) -> None:
    case, m = CASES[index], doubles(model)
    matrix, mean, covariance = predicted[index]
    np.testing.assert_allclose(mean, next_state(m, case.state, case.gyro), rtol=3e-7, atol=3e-6)
    expected = slopes(next_state, m, case.state, case.gyro)
    # How far the LGPR error fades hangs on the speed too; the errors are small and the filter leaves that out.
    expected[11:13, 3] = 0.0
    np.testing.assert_allclose(matrix, expected, rtol=1e-5, atol=1e-6)
    walks = np.zeros(13)
    walks[3:7] = m.acceleration_noise, m.rate_bias_walk, m.odometer_scale_walk, m.clock_walk
    walks[7:9] = m.lever_walk
    # A turn of the gyro's noise is a turn the other way of its bias.
    turn = -expected[:, 4] / STEP_S
    turn[3:] = 0.0
    side = np.zeros(13)
    side[:2] = -np.sin(mean[2]), np.cos(mean[2])
    errors = np.zeros(13)
    errors[9:11] = m.gnss_error_sigma_m**2 * (1.0 - np.exp(-2.0 * STEP_S / m.gnss_error_s))
    errors[11:13] = m.lgpr_error_sigma_m**2 * (1.0 - np.exp(-2.0 * abs(case.state[3]) * STEP_S / m.lgpr_error_m))
    after = expected @ (covariance_of(model) + np.diag(walks**2 * STEP_S)) @ expected.T
    after += STEP_S * (m.yaw_rate_noise**2 * np.outer(turn, turn) + m.side_noise**2 * np.outer(side, side))
    after += np.diag(errors)
    sigma = np.sqrt(np.diagonal(after))
    np.testing.assert_allclose(covariance / np.outer(sigma, sigma), after / np.outer(sigma, sigma), atol=2e-6)
    np.testing.assert_array_equal(covariance, covariance.T)


NOISES = {
    "gnss": np.array([[4e-4, 1e-4], [1e-4, 9e-4]]),
    "heading": np.array([[1e-4]]),
    "odometer": np.array([[4e-4]]),
    "lgpr": np.array([[4e-4, 1e-4, 2e-5], [1e-4, 9e-4, 0.0], [2e-5, 0.0, 1e-5]]),
}
SEEN = {"gnss": seen_gnss, "heading": seen_heading, "odometer": seen_odometer, "lgpr": seen_lgpr}
OFF = {"gnss": [0.3, -0.2], "heading": [0.04], "odometer": [0.2], "lgpr": [0.1, 0.2, -0.02]}


@pytest.fixture(scope="module", params=sorted(SEEN))
def updated(request: pytest.FixtureRequest, model: FilterModel) -> tuple[str, list[tuple[np.ndarray, ...]]]:
    """A source's update of every case, and that of an empty slot: NIS, mean and covariance."""
    name: str = request.param

    @jax.jit
    def run(
        estimate: NavEstimate, motion: MotionInput, parts: jax.Array, age_s: jax.Array, valid: jax.Array
    ) -> tuple[jax.Array, NavEstimate]:
        noise = f32(NOISES[name])
        if name == "gnss":
            gnss = GnssObservation(parts[0], parts[1], noise, age_s, valid)
            innovation = gnss_innovation(model, estimate, motion, gnss)
        elif name == "heading":
            heading = HeadingObservation(parts[0], noise[0, 0], age_s, valid)
            innovation = heading_innovation(estimate, motion, heading)
        elif name == "odometer":
            innovation = odometer_innovation(estimate, OdometerObservation(parts[0], noise[0, 0], valid))
        else:
            lgpr = LgprObservation(parts[0], parts[1], parts[2], noise, age_s, valid)
            innovation = lgpr_innovation(model, estimate, motion, lgpr)
        return weigh(estimate, innovation).nis, update(estimate, innovation)

    found = []
    for case in CASES:
        at = SEEN[name](doubles(model), case.state, case.gyro, case.age_s) + np.asarray(OFF[name])
        if name == "heading":
            at = at + 2.0 * np.pi
        given = (estimate_of(case, model), motion_of(case.gyro), jnp.asarray(at, jnp.float32), f32(case.age_s))
        (nis, after), (_, unused) = (run(*given, jnp.asarray(valid)) for valid in (True, False))
        found.append(tuple(np.asarray(part, np.float64) for part in (nis, *after, *unused)))
    return name, found


def test_an_observation_updates_as_the_textbook_says(
    model: FilterModel, updated: tuple[str, list[tuple[np.ndarray, ...]]]
) -> None:
    """Numerical derivatives and the covariance form P − K S Kᵀ in float64; with age, clock, levers, full turns."""
    name, found = updated
    before = covariance_of(model)
    sigma = np.sqrt(np.diagonal(before))
    residual = np.asarray(OFF[name])
    for case, (nis, mean, covariance, unused_mean, unused_covariance) in zip(CASES, found, strict=True):
        row = slopes(SEEN[name], doubles(model), case.state, case.gyro, case.age_s)
        spread = row @ before @ row.T + NOISES[name]
        gain = before @ row.T @ np.linalg.inv(spread)
        assert nis == pytest.approx(residual @ np.linalg.solve(spread, residual), rel=1e-3)
        after = before - gain @ spread @ gain.T
        np.testing.assert_allclose((mean - case.state) / sigma, gain @ residual / sigma, atol=2e-4)
        np.testing.assert_allclose(covariance / np.outer(sigma, sigma), after / np.outer(sigma, sigma), atol=2e-5)
        np.testing.assert_allclose((covariance - covariance.T) / np.outer(sigma, sigma), 0.0, atol=1e-6)
        np.testing.assert_array_equal(unused_mean, np.float32(case.state))
        np.testing.assert_array_equal(unused_covariance, np.float32(before))


def test_a_fix_whose_covariance_is_none_is_not_taken(model: FilterModel) -> None:
    zero, estimate = jnp.float32(0.0), estimate_of(CASES[0], model)
    for noise, offered in (
        (np.diag([1e-4, 1e-4, 1e-6]), True),
        (np.zeros((3, 3)), False),
        (-1e-2 * np.eye(3), False),
        (np.array([[1e-4, 2e-4, 0.0], [2e-4, 1e-4, 0.0], [0.0, 0.0, 1e-6]]), False),
    ):
        lgpr = LgprObservation(zero, zero, zero, jnp.asarray(noise, jnp.float32), zero, jnp.asarray(True))
        innovation = lgpr_innovation(model, estimate, MotionInput(zero, jnp.float32(0.02)), lgpr)
        assert bool(innovation.offered) is offered
