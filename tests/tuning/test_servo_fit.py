"""Identification of the servo on logs of one in plain NumPy: by gradient and by swarm, with intervals that cover."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import Float

from lgprjax.tuning import NotExcitedError
from lgprjax.tuning.servo import (
    NAMES,
    ServoFit,
    ServoSolution,
    fit_servo,
    from_box,
    per_box,
    servo_estimates,
    servo_log,
    solve_servo,
    to_box,
    wheel_angles,
)
from lgprjax.vehicle.actuators import Servo, ideal_servo, init_servo, step_servo
from lgprjax.vehicle.sensors import DriveSignals
from refusals import refused
from turning_drives import covered_band

STEP_S, RECORD_S, FINE_S = 0.01, 0.02, 0.001
NOISE_RAD = np.radians(0.1)
DRAWS = 400
TRUTH = np.array([0.15, 0.063, np.radians(0.2), 0.5, 0.05, 0.002])


class Truth(NamedTuple):
    """A servo that is no jax one."""

    lag_s: float = 0.15
    delay_s: float = 0.063
    dead_band_rad: float = float(np.radians(0.2))
    rate_radps: float = 0.5
    asymmetry: float = 0.05
    backlash_rad: float = float(np.radians(0.3))


def commands(seconds: float, seed: int = 1) -> Float[np.ndarray, " step"]:
    """Steps of several sizes, each held from half a second to a second and a half, on whole records."""
    rng, parts = np.random.default_rng(seed), [np.zeros(100)]
    while sum(map(len, parts)) * STEP_S < seconds:
        parts.append(np.full(2 * rng.integers(25, 75), rng.choice([0.05, 0.1, 0.2, 0.35]) * rng.choice([-1.0, 1.0])))
    return np.concatenate(parts)[: round(seconds / STEP_S)]


def turned(truth: Truth, command: Float[np.ndarray, " step"]) -> Float[np.ndarray, " step"]:
    """Wheel angle at each step, by one plain loop of millisecond steps: what a command does shows a step later."""
    motor = wheel = 0.0
    late = round(truth.delay_s / FINE_S)
    heard = np.concatenate([np.full(late, command[0]), np.repeat(command, round(STEP_S / FINE_S))])
    angles = np.zeros(round(STEP_S / FINE_S) * len(command))
    for n in range(len(angles) - 1):
        wrong = heard[n] - motor
        wrong -= min(max(wrong, -truth.dead_band_rad), truth.dead_band_rad)
        moved = wrong * (1.0 - np.exp(-FINE_S / truth.lag_s))
        most = truth.rate_radps * FINE_S
        motor += min(max(moved, -most * (1.0 - truth.asymmetry)), most * (1.0 + truth.asymmetry))
        wheel = min(max(wheel, motor - truth.backlash_rad / 2), motor + truth.backlash_rad / 2)
        angles[n + 1] = wheel
    return angles[:: round(STEP_S / FINE_S)]


def clean_log(truth: Truth, seconds: float) -> tuple[DriveSignals, Float[np.ndarray, " record"]]:
    command = commands(seconds)
    every = slice(None, None, round(RECORD_S / STEP_S))
    time_s = np.arange(len(command))[every] * STEP_S
    none = np.zeros(len(time_s))
    signals = DriveSignals(time_s, none, none, none, none, none, none, command_rad=command[every])
    return signals, turned(truth, command)[every] + TRUTH[5]


def given(backlash_rad: float = Truth().backlash_rad) -> Servo:
    return ideal_servo()._replace(backlash_rad=jnp.float32(backlash_rad))


def numbers(fit: ServoFit) -> Float[np.ndarray, "6"]:
    return np.array([getattr(fit, name).value for name in NAMES])


def test_model_is_the_vehicles_servo() -> None:
    """The delay is taken of the angles; step by step, with slots for late commands, it is the same."""
    signals, measured = clean_log(Truth(), 10.0)
    log = servo_log(signals, measured, given())._replace(start_rad=jnp.float32(TRUTH[5]))
    whole = np.where(np.arange(6) == 1, 0.06, TRUTH)
    servo = given()._replace(**{name: jnp.float32(value) for name, value in zip(NAMES[:5], whole, strict=False)})
    start, one, step_s = init_servo(jnp.float32(0.0), delay_slots=6), jnp.float32(1.0), jnp.float32(STEP_S)
    _, angles = jax.lax.scan(
        lambda state, command: (step_servo(state, servo, command, one, step_s), state.wheel_rad), start, log.command_rad
    )
    model = np.asarray(wheel_angles(log, jnp.asarray(to_box(whole), jnp.float32)))
    np.testing.assert_allclose(model[:499], np.array(angles)[:998:2] + TRUTH[5], atol=5e-6)


def test_box_and_back() -> None:
    u = to_box(TRUTH)
    np.testing.assert_allclose(np.asarray(from_box(jnp.asarray(u, jnp.float32))), TRUTH, rtol=1e-4, atol=1e-6)
    ahead = np.asarray(from_box(jnp.asarray(u + 0.01, jnp.float32))) - np.asarray(
        from_box(jnp.asarray(u - 0.01, jnp.float32))
    )
    np.testing.assert_allclose(ahead / 0.02, per_box(u), rtol=2e-3)


@pytest.fixture(scope="module")
def noisy() -> tuple[DriveSignals, Float[np.ndarray, " record"], ServoFit]:
    signals, clean = clean_log(Truth(), 40.0)
    measured = clean + np.random.default_rng(2).normal(size=len(clean)) * NOISE_RAD
    return signals, measured, fit_servo(signals, measured, given())


def test_numbers_are_found_and_both_searches_agree(
    noisy: tuple[DriveSignals, Float[np.ndarray, " record"], ServoFit],
) -> None:
    fit = noisy[2]
    np.testing.assert_array_less(np.abs(numbers(fit) - TRUTH), [0.01, 0.01, 1e-3, 0.01, 0.02, 1e-3])
    assert fit.agree
    assert fit.apart < 1.0
    np.testing.assert_allclose(fit.swarm, TRUTH, atol=0.01)
    assert fit.memory == 1.0
    assert fit.scale_rad == pytest.approx(NOISE_RAD, rel=0.1)
    assert float(fit.servo.lag_s) == pytest.approx(fit.lag_s.value)
    assert float(fit.servo.backlash_rad) == pytest.approx(Truth().backlash_rad)


def test_outliers_and_gaps_do_no_harm(noisy: tuple[DriveSignals, Float[np.ndarray, " record"], ServoFit]) -> None:
    signals, measured, _ = noisy
    rng = np.random.default_rng(3)
    spiked = np.where(rng.random(len(measured)) < 0.03, measured + rng.normal(size=len(measured)) * 0.3, measured)
    spiked[500:560] = np.nan
    assert signals.command_rad is not None
    lost = np.where((signals.time_s > 20.0) & (signals.time_s < 21.0), np.nan, signals.command_rad)
    through = fit_servo(signals._replace(command_rad=lost), spiked, given())
    np.testing.assert_array_less(np.abs(numbers(through) - TRUTH), [0.01, 0.01, 1e-3, 0.01, 0.02, 1e-3])
    assert through.agree


def test_intervals_cover() -> None:
    signals, clean = clean_log(Truth(), 12.0)
    log = servo_log(signals, clean, given())
    draws = clean[None] + np.random.default_rng(4).normal(size=(DRAWS, len(clean))) * NOISE_RAD
    start = jnp.asarray(to_box(TRUTH * np.array([1.1, 0.9, 1.2, 0.95, 0.8, 0.5])), jnp.float32)
    solved = jax.device_get(
        jax.vmap(lambda measured: solve_servo(log, measured, start, rounds=8))(jnp.asarray(draws, jnp.float32))
    )
    used, held = np.asarray(log.used), np.zeros(len(NAMES))
    for draw in range(len(draws)):
        estimates, _ = servo_estimates(ServoSolution(*(leaf[draw] for leaf in solved)), used)
        held += [e.low <= truth <= e.high for e, truth in zip(estimates, TRUTH, strict=True)]
    low, high = covered_band(DRAWS)
    shares = dict(zip(NAMES, held / len(draws), strict=True))
    assert all(low <= share <= high for share in shares.values()), shares


def test_play_that_is_not_given_is_taken_for_dead_band(
    noisy: tuple[DriveSignals, Float[np.ndarray, " record"], ServoFit],
) -> None:
    """Most of half the play, no more; and the residuals remember that something is not as the model."""
    signals, measured, fit = noisy
    without = fit_servo(signals, measured, given(0.0))
    taken = without.dead_band_rad.value - fit.dead_band_rad.value
    assert 0.5 < taken / (0.5 * Truth().backlash_rad) < 1.0
    assert without.memory > 1.0


def test_logs_that_do_not_show_the_servo_are_refused() -> None:
    signals, clean = clean_log(Truth(), 12.0)
    noise = np.random.default_rng(5).normal(size=len(clean)) * NOISE_RAD
    with refused("servo", error=NotExcitedError):
        fit_servo(signals._replace(command_rad=None), clean, given())
    with refused("servo", 0.02, error=NotExcitedError, found="0.0000"):
        fit_servo(signals._replace(command_rad=np.full(len(clean), 0.1)), clean, given())
    with refused("servo", 50, error=NotExcitedError, found=0):
        fit_servo(signals, np.full(len(clean), np.nan), given())
    with refused("servo", error=NotExcitedError):
        fit_servo(signals, noise, given())
    fast, small = Truth(rate_radps=50.0), 0.1 * commands(12.0)
    gentle = signals._replace(command_rad=small[:: round(RECORD_S / STEP_S)])
    clean = turned(fast, small)[:: round(RECORD_S / STEP_S)]
    with refused("servo", error=NotExcitedError, found="rate_radps"):
        fit_servo(gentle, clean + noise, given())
