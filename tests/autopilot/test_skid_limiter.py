"""The skid-steer limiter against a plain one, step by step; every number used is a sum of powers of two."""

import math
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import Array, Float, Int32

from lgprjax.autopilot import (
    LimiterState,
    SkidCommand,
    SkidLimited,
    SkidLimiterRules,
    init_limiter,
    limit_command,
)

LANES, STEPS = 300, 24
RULES = (0.5, 1.0, 0.25, 0.25, 0.5)


class Plain(NamedTuple):
    """A limiter in plain Python: what was sent last, bad commands in a row."""

    left: float = 0.0
    right: float = 0.0
    tool: float = 0.0
    depth: float = 0.0
    bad: int = 0


def limit_plainly(
    rules: tuple[float, ...], state: Plain, told: tuple[float, ...], age_s: float, step_s: float
) -> tuple[Plain, SkidLimited]:
    largest, rate, deepest, oldest, release = rules
    step_s = step_s if step_s > 0.0 else 0.0
    bits = SkidLimited(0)
    if not all(map(math.isfinite, told)):
        bits |= SkidLimited.NOT_FINITE
    if not 0.0 <= age_s <= oldest:
        bits |= SkidLimited.STALE
    if state.bad == 2 or (bits and state.bad == 1):
        fastest = max(abs(state.left), abs(state.right))
        share = 1.0 - release * step_s / fastest if fastest > release * step_s else 0.0
        slowed = Plain(share * state.left, share * state.right, 0.0, state.depth, 2)
        return slowed, bits | SkidLimited.MANUAL_REQUESTED
    if bits:
        return state._replace(bad=1), bits
    wheels = []
    limits = (
        (SkidLimited.LEFT_RANGE, SkidLimited.LEFT_RATE, told[0], state.left),
        (SkidLimited.RIGHT_RANGE, SkidLimited.RIGHT_RATE, told[1], state.right),
    )
    for too_fast, too_quick, wanted, last in limits:
        wheel = wanted
        if abs(wheel) > largest:
            wheel, bits = math.copysign(largest, wheel), bits | too_fast
        if abs(wheel - last) > rate * step_s:
            wheel, bits = last + math.copysign(rate * step_s, wheel - last), bits | too_quick
        wheels.append(wheel)
    tool = 1.0 if told[2] >= 1.0 else 0.0
    depth = min(max(told[3], 0.0), deepest)
    bits |= SkidLimited.TOOL_RANGE if tool != told[2] else SkidLimited(0)
    bits |= SkidLimited.DEPTH_RANGE if depth != told[3] else SkidLimited(0)
    return Plain(wheels[0], wheels[1], tool, depth), bits


@jax.jit
def drive(
    rules: SkidLimiterRules, start: LimiterState[SkidCommand], told: Float[Array, "step 6 lane"]
) -> tuple[Float[Array, "step 5 lane"], Int32[Array, "step lane"]]:
    """What is sent and the count of bad ones, and the bits; each step told left, right, tool, depth, age and step."""

    def step(state, now):  # type: ignore[no-untyped-def]
        state, sent, bits = limit_command(rules, state, SkidCommand(*now[:4]), now[4], now[5])
        return state, (jnp.stack([*sent, jnp.where(state.failed, 2.0, jnp.where(state.missed, 1.0, 0.0))]), bits)

    driven: tuple[Float[Array, "step 5 lane"], Int32[Array, "step lane"]] = jax.lax.scan(step, start, told)[1]
    return driven


def draw(seed: int) -> tuple[Float[np.ndarray, "rule lane"], Float[np.ndarray, "step 6 lane"]]:
    """Rules of each lane, and what it is told: mostly good commands about the limits, some bad in every way."""
    rng = np.random.default_rng(seed)
    size = (STEPS, LANES)
    rules = np.stack([rng.choice([0.5, 1.0, 2.0], LANES) * rule for rule in RULES])
    wheels = rng.integers(-40, 41, (2, *size)) / 32.0
    tool = rng.choice([0.0, 1.0, 0.5, 2.0], size, p=[0.4, 0.5, 0.05, 0.05])
    depth = rng.integers(-2, 20, size) / 32.0
    told = np.stack([*wheels, tool, depth], axis=1)
    bad = rng.random(told.shape) < 0.02
    told[bad] = rng.choice([np.nan, np.inf, -np.inf], bad.sum())
    age = rng.choice([0.0, 0.5, 1.0, 1.0 + 2.0**-20, -(2.0**-20), np.nan], size, p=[0.3, 0.3, 0.3, 0.04, 0.03, 0.03])
    step = rng.choice([0.125, 0.0625, 0.0, -0.125, np.nan], size, p=[0.5, 0.3, 0.1, 0.05, 0.05])
    return rules, np.concatenate([told, (age * rules[3])[:, None], step[:, None]], axis=1)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_every_step_is_that_of_the_plain_limiter(seed: int) -> None:
    rules, told = draw(seed)
    begun = np.random.default_rng(seed + 100).integers(-16, 17, (2, LANES)) / 32.0
    depth = np.full(LANES, 0.125)
    still = np.zeros(LANES)
    start = init_limiter(SkidCommand(*(jnp.asarray(value, jnp.float32) for value in (*begun, still, depth))))
    sent, bits = drive(SkidLimiterRules(*jnp.asarray(rules, jnp.float32)), start, jnp.asarray(told, jnp.float32))
    found, limited = np.asarray(sent), np.asarray(bits)
    seen = SkidLimited(0)
    for lane in range(LANES):
        state = Plain(left=begun[0, lane], right=begun[1, lane], depth=0.125)
        lane_rules = tuple(rules[:, lane])
        for step in range(STEPS):
            now = told[step, :, lane]
            state, expected = limit_plainly(lane_rules, state, tuple(now[:4]), now[4], now[5])
            # The proportional stop divides: there the last digits are the device's own.
            np.testing.assert_allclose(found[step, :, lane], state, rtol=3e-6, atol=1e-7, err_msg=str((lane, step)))
            assert SkidLimited(int(limited[step, lane])) == expected, (lane, step)
            seen |= expected
    assert seen == SkidLimited(2 ** len(SkidLimited) - 1)


def test_a_failed_limiter_stops_on_its_arc_with_the_tool_off_and_stays_so() -> None:
    told = np.full((STEPS, 6), np.nan)
    told[:, 4], told[:, 5] = 0.0, 0.125
    told[0] = (0.25, 0.5, 1.0, 0.125, 0.0, 0.125)
    told[-6:] = told[0]
    lanes = np.repeat(told[:, :, None], LANES, axis=2)
    rules = SkidLimiterRules(*(jnp.full(LANES, rule, jnp.float32) for rule in RULES))
    begun = init_limiter(SkidCommand(*(jnp.full(LANES, value, jnp.float32) for value in (0.25, 0.5, 0.0, 0.125))))
    sent, bits = drive(rules, begun, jnp.asarray(lanes, jnp.float32))
    found = np.asarray(sent)[:, :, 0]
    np.testing.assert_array_equal(found[:2, 2], 1.0)
    np.testing.assert_array_equal(found[2:, 2], 0.0)
    np.testing.assert_allclose(found[2:9, 0], 0.5 * found[2:9, 1], rtol=1e-5)
    np.testing.assert_allclose(np.diff(found[1:9, 1]), -0.0625, rtol=1e-4)
    np.testing.assert_array_equal(found[9:, :2], 0.0)
    assert all(int(each) & SkidLimited.MANUAL_REQUESTED for each in np.asarray(bits)[2:, 0])


def test_every_reason_has_a_bit_of_its_own_as_recorded() -> None:
    """Bits are in records of runs: one each, from the lowest on, in this order."""
    names = "LEFT_RANGE LEFT_RATE RIGHT_RANGE RIGHT_RATE TOOL_RANGE DEPTH_RANGE NOT_FINITE STALE MANUAL_REQUESTED"
    assert {flag.name: flag.value for flag in SkidLimited} == {name: 1 << n for n, name in enumerate(names.split())}
