"""A schedule over speed and torque is lengthened where too few of the drawn vehicles have the phase margin."""

from dataclasses import replace

import jax.numpy as jnp
import numpy as np
import pytest

from lgprjax.tuning.logged_look_ahead import (
    DrawnTuning,
    DrawnVehicles,
    WeakSchedule,
    _lengths,
    _needed_lengths,
    drawn_vehicles,
    lengthened,
    tune_on_draws,
)
from lgprjax.tuning.look_ahead import TrialCourses
from lgprjax.tuning.loop import NAMES, WIDTH, LoopPrior
from lgprjax.vehicle import Chassis, LookAhead, ProportionalRear, anchor_lead_m, line_course, phase_margin_rad

SPEEDS = np.array([2.235, 4.47, 6.5])
TRIALS = TrialCourses((line_course(100.0),), tuple(SPEEDS))
CONFIG = DrawnTuning(shares=(1.0, 0.43))


def vehicles(lag_s: float, count: int = 400) -> DrawnVehicles:
    """Their lags differ by a tenth."""
    base, anchor, ratio, largest, slip = (jnp.float32(v) for v in (2.2, 4.8, 0.4, 0.5, 21.0))
    believed = Chassis(base, anchor, ProportionalRear(ratio), largest, slip)
    value = jnp.asarray([lag_s, 0.035, 0.3, 0.004, 0.0, 0.4, 0.002, 0.0, 0.0], jnp.float32)
    prior = LoopPrior(value, jnp.asarray(WIDTH, jnp.float32), jnp.float32(2.2), jnp.float32(0.005))
    draws = np.tile(np.asarray(value), (count, 1))
    draws[:, NAMES.index("lag_s")] *= np.exp(0.1 * np.random.default_rng(2).normal(size=count))
    return drawn_vehicles(believed, prior, jnp.asarray(draws, jnp.float32))


def schedule(short_m: float, long_m: float, exponent: float) -> WeakSchedule:
    held = LookAhead(*(jnp.float32(v) for v in (short_m, long_m, SPEEDS[0], SPEEDS[-1])))
    return WeakSchedule(held, jnp.float32(exponent))


def long_enough(before: WeakSchedule, needed: np.ndarray) -> WeakSchedule:
    return lengthened(before, *(jnp.asarray(v, jnp.float32) for v in (needed, SPEEDS, CONFIG.shares)))


def lengths(of: WeakSchedule) -> np.ndarray:
    return np.asarray(_lengths(of, *(jnp.asarray(axis, jnp.float32) for axis in (SPEEDS, CONFIG.shares))))


def with_margin(drawn: DrawnVehicles, ahead_m: np.ndarray) -> np.ndarray:
    """Share of the vehicles that have it, by speed and share of the torque."""
    lag = np.asarray(drawn.servo.lag_s)[:, None, None] / np.array(CONFIG.shares)
    lead = np.asarray(anchor_lead_m(drawn.chassis))[:, None, None]
    numbers = (ahead_m, lead, SPEEDS[:, None], lag, 0.035)
    margin = phase_margin_rad(*(jnp.asarray(v, jnp.float32) for v in np.broadcast_arrays(*numbers)))
    return np.asarray(np.mean(np.asarray(margin) >= TRIALS.least_margin_rad, axis=0))


def test_what_is_long_enough_stays() -> None:
    drawn = vehicles(0.1)
    before = schedule(3.0, 9.0, 0.6)
    needed = _needed_lengths(drawn, TRIALS, CONFIG)
    assert np.all(needed < lengths(before))
    np.testing.assert_allclose(lengths(long_enough(before, needed)), lengths(before), rtol=1e-6)


@pytest.mark.parametrize(("short_m", "long_m", "exponent"), [(1.8, 4.0, 0.5), (4.0, 4.5, 0.0)])
def test_enough_have_the_margin_and_no_more_than_that(short_m: float, long_m: float, exponent: float) -> None:
    drawn = vehicles(0.24)
    before = schedule(short_m, long_m, exponent)
    assert np.min(with_margin(drawn, lengths(before))) < 0.95
    needed = _needed_lengths(drawn, TRIALS, CONFIG)
    after = lengths(long_enough(before, needed))
    assert np.all(with_margin(drawn, after) >= 0.95)
    # Somewhere it is as short as it may be.
    assert np.min(after / needed) == pytest.approx(1.0, abs=1e-3)
    if short_m == 1.8:
        # Only the fast end at the least torque was too short: at full torque the slow end has no reason to change.
        assert after[0, 0] == pytest.approx(1.8)


def test_a_lag_that_no_length_makes_good_is_told_with_where() -> None:
    with pytest.raises(ValueError, match=r"2\.235 m/s .* 100 m"):
        _needed_lengths(vehicles(60.0), TRIALS, CONFIG)


def test_the_tuner_moves_along_the_bound_of_the_margin() -> None:
    drawn, config = vehicles(0.24, 8), replace(CONFIG, steps=20, batch=8)
    tuned = tune_on_draws(drawn, replace(TRIALS, duration_s=8.0), config)
    needed, found = _needed_lengths(drawn, TRIALS, config), lengths(tuned.schedule)
    # At the fast end the margin decides; what is left at the other speeds is still made less, by the same draws.
    assert np.all(found >= needed)
    assert found[-1, -1] == pytest.approx(needed[-1, -1], rel=1e-3)
    assert tuned.history_m[-1] < 0.97 * tuned.history_m[0]
