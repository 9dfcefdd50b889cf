"""The loop of drives with a noisy odometer, at one speed and at several, against a plain plant that draws its truth."""

import jax.numpy as jnp
import numpy as np
import pytest

from lgprjax.tuning.loop import NAMES, PADDING, RATE, STEP_S, WIDTH, LoopLogs, LoopPosterior, LoopPrior, identify
from lgprjax.tuning.loop_fit import LoopFit, fit_loop, summarise, torque_verdict

BASE_M, LAG_S = 2.6, 0.3
RATE_BEFORE, RATIO_BEFORE, SLIP_BEFORE = 0.5, 0.45, 1.0 / 25.0**2


def fit_of(
    draw: np.random.Generator,
    speed: np.ndarray,
    ratio: float,
    slip: float,
    *,
    command: np.ndarray | None = None,
    rate_radps: float = np.inf,
    start_rad: float = 0.0,
) -> LoopFit:
    """Fit a drive; speeds err by 0.6 %, as long as the window that they are taken over.

    Args:
        draw: noise.
        speed: at every step.
        ratio, slip: of the chassis.
        command: steps to both sides unless told.
        rate_radps: of the servo.
        start_rad: where it stands as commands begin, unlike its first reading.
    """
    if command is None:
        command = np.repeat(draw.uniform(-0.45, 0.45, PADDING // 256), 256)
    wheel = np.full(PADDING, start_rad)
    keep = np.exp(-STEP_S / LAG_S)
    for step in range(1, PADDING):
        turned = (command[step - 1] - wheel[step - 1]) * (1.0 - keep)
        wheel[step] = wheel[step - 1] + np.clip(turned, -rate_radps * STEP_S, rate_radps * STEP_S)
    rate = speed * (np.tan(wheel) + np.tan(ratio * wheel)) / BASE_M / (1.0 + slip * speed**2)
    # The mean of 20 steps: 0.4 s of an odometer's records.
    jitter = np.convolve(draw.normal(size=PADDING + 19), np.ones(20), mode="valid") / 20.0**0.5

    def lanes(values: np.ndarray) -> jnp.ndarray:
        return jnp.asarray(np.stack([values, values]), jnp.float32)

    used = np.stack([np.arange(PADDING) > 0, np.zeros(PADDING, bool)])
    seen = wheel + np.radians(0.1) * draw.normal(size=PADDING)
    seen[0] = 0.0
    logs = LoopLogs(
        lanes(command),
        lanes(np.ones(PADDING)),
        lanes(speed * (1.0 + 0.006 * jitter)),
        lanes(seen),
        lanes(rate + np.radians(0.15) * draw.normal(size=PADDING)),
        jnp.asarray(used),
        jnp.asarray(used),
        jnp.asarray(np.arange(PADDING) + np.zeros((2, 1)) == 0),
    )
    before = jnp.asarray([0.15, 0.06, RATE_BEFORE, 0.002, 0.0, RATIO_BEFORE, SLIP_BEFORE, 0.0, 0.0], jnp.float32)
    return fit_loop(LoopPrior(before, jnp.asarray(WIDTH, jnp.float32), jnp.float32(BASE_M), jnp.float32(0.0)), logs)


def test_at_one_speed_the_odometers_noise_is_not_taken_for_slip() -> None:
    draw = np.random.default_rng(3)
    ratio = draw.uniform(0.3, 0.6)
    fit = fit_of(draw, np.full(PADDING, 1.8), ratio, 0.0)
    found = fit.numbers["rear_ratio"]
    assert "slip_s2pm2" not in fit.told
    assert found.low < ratio < found.high
    assert abs(found.value - ratio) < 0.02
    # The interval is that of a slip which nobody knows: (1 + k) times 1.96 widths of it, at 1.8 m/s.
    assert 0.5 * (found.high - found.low) > 0.6 * 1.96 * (1.0 + ratio) * WIDTH[6] * 1.8**2


def test_at_several_speeds_ratio_and_slip_are_both_told() -> None:
    draw = np.random.default_rng(4)
    ratio, slip = draw.uniform(0.3, 0.6), draw.uniform(12.0, 20.0) ** -2.0
    speed = 4.75 + 3.25 * np.sin(2.0 * np.pi * STEP_S * np.arange(PADDING) / 37.0)
    fit = fit_of(draw, speed, ratio, slip)
    for name, truth in (("rear_ratio", ratio), ("slip_s2pm2", slip)):
        found = fit.numbers[name]
        assert name in fit.told
        assert found.low < truth < found.high


def test_memory_is_that_of_one_rate_of_the_grid() -> None:
    """About 500 bytes a step of a drive: ten derivatives of two outputs, some times over."""
    drives, steps = 2, PADDING
    columns = [jnp.zeros((drives, steps))] * 5 + [jnp.ones((drives, steps), bool)] * 3
    prior = LoopPrior(jnp.ones(len(NAMES)), jnp.asarray(WIDTH, jnp.float32), jnp.float32(BASE_M), jnp.float32(0.0))
    held = identify.lower(prior, LoopLogs(*columns)).compile().memory_analysis()
    assert held is not None
    assert held.temp_size_in_bytes < 700 * drives * steps


def test_where_the_servo_begins_is_not_taken_for_its_rate() -> None:
    draw = np.random.default_rng(5)
    # One turn at the rate's limit, as the drive begins, and 0.6° from where the wheels read.
    command = np.where(np.arange(PADDING) < 60, 0.35, 0.05 * np.sin(0.4 * STEP_S * np.arange(PADDING)))
    speed = 3.0 + np.sin(0.2 * STEP_S * np.arange(PADDING))
    fit = fit_of(draw, speed, RATIO_BEFORE, SLIP_BEFORE, command=command, rate_radps=0.4, start_rad=0.01)
    found = fit.numbers["rate_radps"]
    assert "rate_radps" in fit.told
    assert found.low < 0.4 < found.high
    assert 0.5 * (found.high - found.low) < 0.05 * 0.4


def turned_once(most: float, rate_radps: float) -> LoopFit:
    """A drive with one turn, to the left, and a gentle rest: the mean of the rates to both sides is not known."""
    command = np.where(np.arange(PADDING) < 60, most, 0.02 * np.sin(0.4 * STEP_S * np.arange(PADDING)))
    speed = 3.0 + np.sin(0.2 * STEP_S * np.arange(PADDING))
    return fit_of(np.random.default_rng(6), speed, RATIO_BEFORE, SLIP_BEFORE, command=command, rate_radps=rate_radps)


@pytest.mark.parametrize(("share", "verdict"), [(0.93, "full"), (0.75, "weak")])
def test_torque_is_told_by_the_side_that_was_turned_to(share: float, verdict: str) -> None:
    assert torque_verdict(turned_once(0.35, share * RATE_BEFORE)) == verdict


def test_a_limit_that_is_touched_leaves_every_higher_one_open() -> None:
    # Lag turns it at 1.03 times the rate as the command comes, and below it from 9 ms on.
    fit = turned_once(1.03 * LAG_S * RATE_BEFORE, RATE_BEFORE)
    assert np.max(fit.limit_share) > 0.75
    assert fit.numbers["rate_radps"].low < RATE_BEFORE
    assert fit.numbers["rate_radps"].high > 1.5 * RATE_BEFORE
    assert fit.rate_bounded
    assert torque_verdict(fit) != "weak"


def summed_up(place: np.ndarray, weight: np.ndarray) -> LoopFit:
    """A posterior that is a grid of places, each of them certain."""
    count = len(NAMES)
    posterior = LoopPosterior(
        place=jnp.asarray(place, jnp.float32),
        weight=jnp.asarray(weight / weight.sum(), jnp.float32),
        root=jnp.zeros((len(place), count, count)),
        scale=jnp.ones((2, 2)),
        memory=jnp.ones(count),
        blocks=jnp.float32(1e4),
        limit_share=jnp.ones(2),
        left=jnp.float32(0.0),
    )
    value = jnp.full(count, 0.01).at[RATE].set(1.0)
    return summarise(LoopPrior(value, jnp.asarray(WIDTH, jnp.float32), jnp.float32(3.0), jnp.float32(0.0)), posterior)


def test_the_interval_of_a_normal_rate_is_that_of_the_normal_distribution() -> None:
    """The grid is coarse: its steps must not widen what it stands for."""
    middle, sigma = 0.2, 0.05
    node = middle + sigma * np.concatenate([np.linspace(-4.0, 4.0, 13), np.geomspace(6.0, 30.0, 4)])
    place = np.zeros((len(node), len(NAMES)))
    place[:, RATE] = node
    weight = np.gradient(node) * np.exp(-0.5 * ((node - middle) / sigma) ** 2)
    found = summed_up(place, weight).numbers["rate_radps"]
    bounds = np.log([found.low, found.high]) / WIDTH[RATE]
    np.testing.assert_allclose(bounds, middle + 1.96 * sigma * np.array([-1.0, 1.0]), atol=0.02 * sigma)


def test_what_the_odometers_scale_hides_is_in_the_intervals() -> None:
    """Half a per cent of speed is half a per cent of 1 + k, and a whole one of 1 / V_CHAR squared."""
    place = np.zeros((3, len(NAMES)))
    place[:, RATE] = [-1.0, 0.0, 1.0]
    found = summed_up(place, np.ones(3)).numbers
    half = [0.5 * (found[name].high - found[name].low) for name in ("rear_ratio", "slip_s2pm2", "lag_s")]
    np.testing.assert_allclose(half, [1.96 * 0.005 * 1.01, 1.96 * 0.01 * 0.01, 0.0], rtol=2e-3)
