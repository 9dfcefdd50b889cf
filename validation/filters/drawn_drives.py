"""Drives whose truth and sensors are drawn from the filter's own model, in float64 and apart from the filter's code."""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from lgprjax.navigation import (
    FilterModel,
    GnssObservation,
    HeadingObservation,
    LgprObservation,
    MotionInput,
    Observations,
    OdometerObservation,
    initial_sigmas,
)

STEP_S = 1.0 / 21.0
GNSS_COVARIANCE = np.array([[4e-4, 1e-4], [1e-4, 4e-4]])
LGPR_COVARIANCE = np.array([[9e-4, 2e-4, 5e-5], [2e-4, 9e-4, 0.0], [5e-5, 0.0, 1e-4]])
HEADING_VARIANCE, ODOMETER_VARIANCE = 1e-4, 2.5e-3


class Drawn(NamedTuple):
    """Drives of equal length.

    Attributes:
        truth: states after each tick.
        start: what the filters are told of the states before the first.
        motions, observations: leading axes tick and run.
    """

    truth: Float[np.ndarray, "tick run 13"]
    start: Float[np.ndarray, "run 13"]
    motions: MotionInput
    observations: Observations


def draw_drives(model: FilterModel, *, runs: int, ticks: int, seed: int, speed_mps: float = 4.0) -> Drawn:
    """Curves to both sides at wandering speed; sources at their own rates, with ages, drop-outs and two outages.

    GNSS comes every fourth tick and not between ticks 200 and 300, a heading every other tick, odometer and LGPR every
    tick, LGPR not between ticks 350 and 420; of each, some are missing at random.
    """
    rng = np.random.default_rng(seed)
    m = FilterModel(*(np.float64(value) for value in model))  # type: ignore[arg-type]
    sigmas = np.asarray(initial_sigmas(model), np.float64)
    start = np.zeros((runs, 13))
    start[:, :4] = [20.0, -10.0, 0.3, speed_mps]
    state = start + sigmas * rng.standard_normal((runs, 13))
    root = np.sqrt(STEP_S)
    gyro = np.where(np.arange(ticks) // 105 % 2 == 0, 0.25, -0.35) * np.sin(np.arange(ticks) * 0.03)
    truth, seen = [], []
    for tick in range(ticks):
        noise = rng.standard_normal((runs, 13))
        state = state.copy()
        state[:, 3] += m.acceleration_noise * root * noise[:, 3]
        state[:, 4] += m.rate_bias_walk * root * noise[:, 4]
        state[:, 5] += m.odometer_scale_walk * root * noise[:, 5]
        state[:, 6] += m.clock_walk * root * noise[:, 6]
        state[:, 7:9] += m.lever_walk * root * noise[:, 7:9]
        rate = gyro[tick] - state[:, 4]
        state[:, :3] = _moved(m, state, rate * STEP_S + m.yaw_rate_noise * root * noise[:, 2], STEP_S)
        side = m.side_noise * root * noise[:, 0]
        state[:, 0] -= np.sin(state[:, 2]) * side
        state[:, 1] += np.cos(state[:, 2]) * side
        fade = np.exp(-STEP_S / m.gnss_error_s)
        state[:, 9:11] = fade * state[:, 9:11] + m.gnss_error_sigma_m * np.sqrt(1 - fade**2) * noise[:, 9:11]
        fades = np.exp(-np.abs(state[:, 3:4]) * STEP_S / m.lgpr_error_m)
        state[:, 11:] = fades * state[:, 11:] + m.lgpr_error_sigma_m * np.sqrt(1 - fades**2) * noise[:, 11:]
        truth.append(state)
        seen.append(_observed(m, state, rate, tick, rng))
    columns = [
        [jnp.asarray(np.stack(part), _kind(part[0])) for part in zip(*slot, strict=True)]
        for slot in zip(*seen, strict=True)
    ]
    observations = Observations(
        GnssObservation(*columns[0]),
        HeadingObservation(*columns[1]),
        OdometerObservation(*columns[2]),
        LgprObservation(*columns[3]),
    )
    shape = (ticks, runs)
    motions = MotionInput(
        jnp.asarray(np.broadcast_to(gyro[:, None], shape), jnp.float32), jnp.full(shape, STEP_S, jnp.float32)
    )
    return Drawn(np.stack(truth), start, motions, observations)


def _moved(
    m: FilterModel, state: Float[np.ndarray, "run 13"], turn: Float[np.ndarray, " run"], step_s: float | np.ndarray
) -> Float[np.ndarray, "run 3"]:
    """Poses after a time: the point without slip along the arc's chord, and the rear axle behind it."""
    yaw, after = state[:, 2], state[:, 2] + turn
    chord = state[:, 3] * step_s * np.sinc(turn / (2.0 * np.pi))
    x = state[:, 0] + m.zero_slip_m * (np.cos(yaw) - np.cos(after)) + chord * np.cos(yaw + turn / 2.0)
    y = state[:, 1] + m.zero_slip_m * (np.sin(yaw) - np.sin(after)) + chord * np.sin(yaw + turn / 2.0)
    return np.stack([x, y, after], axis=1)


def _placed(
    pose: Float[np.ndarray, "run 3"], x_m: float | np.ndarray, y_m: float | np.ndarray
) -> Float[np.ndarray, "run 2"]:
    cos, sin = np.cos(pose[:, 2]), np.sin(pose[:, 2])
    return np.stack([pose[:, 0] + cos * x_m - sin * y_m, pose[:, 1] + sin * x_m + cos * y_m], axis=1)


def _observed(
    m: FilterModel,
    state: Float[np.ndarray, "run 13"],
    rate: Float[np.ndarray, " run"],
    tick: int,
    rng: np.random.Generator,
) -> tuple[tuple[np.ndarray, ...], ...]:
    runs = len(state)
    ages = rng.uniform(0.0, STEP_S, (3, runs))
    there = rng.uniform(size=(4, runs)) < np.array([[0.9], [0.8], [0.95], [0.8]])
    there &= np.array([tick % 4 == 0 and not 200 <= tick < 300, tick % 2 == 0, True, not 350 <= tick < 420])[:, None]
    poses = [_moved(m, state, -rate * age, -age) for age in (ages[0], ages[1], ages[2] + state[:, 6])]
    gnss = _placed(poses[0], float(m.gnss_x_m), float(m.gnss_y_m)) + state[:, 9:11]
    gnss = gnss + rng.multivariate_normal(np.zeros(2), GNSS_COVARIANCE, runs)
    heading = poses[1][:, 2] + np.sqrt(HEADING_VARIANCE) * rng.standard_normal(runs)
    speed = state[:, 3] * (1.0 + state[:, 5]) + np.sqrt(ODOMETER_VARIANCE) * rng.standard_normal(runs)
    error = rng.multivariate_normal(np.zeros(3), LGPR_COVARIANCE, runs)
    lgpr = (
        _placed(poses[2], float(m.array_x_m) + state[:, 7], float(m.array_y_m) + state[:, 8])
        + state[:, 11:]
        + error[:, :2]
    )
    # An empty slot holds what would poison a filter that looked.
    gnss[~there[0]], heading[~there[1]] = np.nan, np.nan
    return (
        (gnss[:, 0], gnss[:, 1], np.broadcast_to(GNSS_COVARIANCE, (runs, 2, 2)), ages[0], there[0]),
        (heading, np.full(runs, HEADING_VARIANCE), ages[1], there[1]),
        (speed, np.full(runs, ODOMETER_VARIANCE), there[2]),
        (
            lgpr[:, 0],
            lgpr[:, 1],
            poses[2][:, 2] + error[:, 2],
            np.broadcast_to(LGPR_COVARIANCE, (runs, 3, 3)),
            ages[2],
            there[3],
        ),
    )


def _kind(part: np.ndarray) -> type:
    return np.bool_ if part.dtype == np.bool_ else np.float32
