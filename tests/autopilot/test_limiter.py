"""The limiter against a plain one, step by step and to the bit: every number used is a sum of powers of two."""

import math
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import Array, Float, Int32

from lgprjax.autopilot import (
    Command,
    CommandRules,
    Limited,
    LimiterRules,
    LimiterState,
    init_limiter,
    limit_command,
    limit_while_engaged,
    released,
)

LANES, STEPS = 400, 24
RULES = (0.5, 0.5, 1.0, 2.0, 0.25, 0.375, 0.125)
STEP_S = 0.125
AGE_S = 0.0625


class Plain(NamedTuple):
    """A limiter in plain Python: what was sent last, bad commands in a row."""

    front: float = 0.0
    throttle: float = 0.0
    brake: float = 0.0
    bad: int = 0


def limit_plainly(
    rules: tuple[float, ...], state: Plain, told: tuple[float, ...], age_s: float, step_s: float
) -> tuple[Plain, Limited]:
    largest, turn, press, brakes, oldest, default_brake, release = rules
    step_s = step_s if step_s > 0.0 else 0.0
    bits = Limited(0)
    if not all(map(math.isfinite, told)):
        bits |= Limited.NOT_FINITE
    if not 0.0 <= age_s <= oldest:
        bits |= Limited.STALE
    if state.bad == 2 or (bits and state.bad == 1):
        if state.front > 0.0:
            front = max(state.front - release * step_s, 0.0)
        else:
            front = min(state.front + release * step_s, 0.0)
        brake = state.brake
        if brake < default_brake:
            brake = min(brake + brakes * step_s, default_brake)
        return Plain(front, 0.0, brake, 2), bits | Limited.MANUAL_REQUESTED
    if bits:
        return state._replace(bad=1), bits
    front, throttle, brake = told
    if abs(front) > largest:
        front, bits = math.copysign(largest, front), bits | Limited.FRONT_RANGE
    if abs(front - state.front) > turn * step_s:
        front, bits = state.front + math.copysign(turn * step_s, front - state.front), bits | Limited.FRONT_RATE
    if not 0.0 <= throttle <= 1.0:
        throttle, bits = min(max(throttle, 0.0), 1.0), bits | Limited.THROTTLE_RANGE
    if throttle > state.throttle + press * step_s:
        throttle, bits = state.throttle + press * step_s, bits | Limited.THROTTLE_RATE
    if not 0.0 <= brake <= 1.0:
        brake, bits = min(max(brake, 0.0), 1.0), bits | Limited.BRAKE_RANGE
    if brake > state.brake + brakes * step_s:
        brake, bits = state.brake + brakes * step_s, bits | Limited.BRAKE_RATE
    if brake > 0.0 and throttle > 0.0:
        throttle, bits = 0.0, bits | Limited.BOTH_PEDALS
    return Plain(front, throttle, brake), bits


@jax.jit
def drive(
    rules: LimiterRules, start: LimiterState[Command], told: Float[Array, "step 5 lane"]
) -> tuple[Float[Array, "step 4 lane"], Int32[Array, "step lane"]]:
    """What is sent and the count of bad ones, and the bits; each step told front, throttle, brake, age and step."""

    def step(state, now):  # type: ignore[no-untyped-def]
        state, sent, bits = limit_command(rules, state, Command(*now[:3]), now[3], now[4])
        return state, (jnp.stack([*sent, jnp.where(state.failed, 2.0, jnp.where(state.missed, 1.0, 0.0))]), bits)

    driven: tuple[Float[Array, "step 4 lane"], Int32[Array, "step lane"]] = jax.lax.scan(step, start, told)[1]
    return driven


def draw(seed: int) -> tuple[Float[np.ndarray, "rule lane"], Float[np.ndarray, "step 5 lane"]]:
    """Rules of each lane, and what it is told: mostly good commands about the limits, some bad in every way."""
    rng = np.random.default_rng(seed)
    size = (STEPS, LANES)
    rules = np.stack([rng.choice([0.5, 1.0, 2.0], LANES) * rule for rule in RULES])
    front, pedals = rng.integers(-40, 41, size) / 32.0, rng.integers(-8, 41, (2, *size)) / 32.0
    pedals *= rng.random((2, *size)) < 0.6  # often one or neither is told
    told = np.stack([front, *pedals], axis=1)
    bad = rng.random(told.shape) < 0.02
    told[bad] = rng.choice([np.nan, np.inf, -np.inf], bad.sum())
    # On the edge, beyond it, from the future, and no number at all.
    age = rng.choice([0.0, 0.5, 1.0, 1.0 + 2.0**-20, -(2.0**-20), np.nan], size, p=[0.3, 0.3, 0.3, 0.04, 0.03, 0.03])
    step = rng.choice([0.125, 0.0625, 0.0, -0.125, np.nan], size, p=[0.5, 0.3, 0.1, 0.05, 0.05])
    return rules, np.concatenate([told, (age * rules[4])[:, None], step[:, None]], axis=1)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_every_step_is_that_of_the_plain_limiter(seed: int) -> None:
    rules, told = draw(seed)
    begun = np.random.default_rng(seed + 100).integers(-16, 17, LANES) / 32.0
    start = init_limiter(released(jnp.asarray(begun, jnp.float32)))
    sent, bits = drive(LimiterRules(*jnp.asarray(rules, jnp.float32)), start, jnp.asarray(told, jnp.float32))
    found, limited = np.asarray(sent), np.asarray(bits)
    seen = Limited(0)
    for lane in range(LANES):
        state = Plain(front=begun[lane])
        lane_rules = tuple(rules[:, lane])
        for step in range(STEPS):
            now = told[step, :, lane]
            state, expected = limit_plainly(lane_rules, state, tuple(now[:3]), now[3], now[4])
            assert tuple(found[step, :, lane]) == state, (lane, step)
            assert Limited(int(limited[step, lane])) == expected, (lane, step)
            seen |= expected
    assert seen == Limited(2 ** len(Limited) - 1)


def test_without_pedals_none_is_ever_pressed() -> None:
    """Rules of a kit that only steers, and commands of every kind: neither they nor the default press one."""
    rules, told = draw(4)
    rules[[RULES.index(1.0), RULES.index(2.0), RULES.index(0.375)]] = 0.0
    start = init_limiter(released(jnp.zeros(LANES, jnp.float32)))
    sent, bits = drive(LimiterRules(*jnp.asarray(rules, jnp.float32)), start, jnp.asarray(told, jnp.float32))
    assert (np.asarray(sent)[:, 1:3] == 0.0).all()
    assert (np.asarray(sent)[:, 0] != 0.0).any()
    assert (np.asarray(bits) & Limited.MANUAL_REQUESTED).any()


class Sent(NamedTuple):
    """One lane's course: rows are front, throttle, brake, count."""

    values: Float[np.ndarray, "step 4"]
    bits: list[Limited]


def run(told: list[tuple[float, float, float]], ages_s: list[float] | None = None) -> Sent:
    """The course of one lane under ``RULES``, filled up to the steps of the others, so that nothing compiles twice."""
    rows = [(*now, age, STEP_S) for now, age in zip(told, ages_s or [AGE_S] * len(told), strict=True)]
    full = np.array(rows + [rows[-1]] * (STEPS - len(rows)))
    lanes = np.repeat(full[:, :, None], LANES, axis=2)
    rules = LimiterRules(*(jnp.full(LANES, rule, jnp.float32) for rule in RULES))
    sent, bits = drive(rules, init_limiter(released(jnp.zeros(LANES, jnp.float32))), jnp.asarray(lanes, jnp.float32))
    count = len(told)
    return Sent(np.asarray(sent)[:count, :, 0], [Limited(int(each)) for each in np.asarray(bits)[:count, 0]])


def test_a_good_command_passes_untouched() -> None:
    found = run([(0.03125, 0.0625, 0.0), (0.0625, 0.125, 0.0), (0.0, 0.0, 0.25)])
    np.testing.assert_array_equal(found.values[:, :3], [(0.03125, 0.0625, 0.0), (0.0625, 0.125, 0.0), (0.0, 0.0, 0.25)])
    assert found.bits == [Limited(0)] * 3


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("place", [0, 1, 2])
def test_one_bad_command_is_bridged_and_two_ask_for_manual(bad: float, place: int) -> None:
    good = (0.0625, 0.125, 0.0)
    broken = tuple(bad if index == place else value for index, value in enumerate(good))
    assert len(broken) == 3
    found = run([good, broken, good, broken, broken, good, good])
    np.testing.assert_array_equal(found.values[:4, :3], [good] * 4)
    assert found.bits[:4] == [Limited(0), Limited.NOT_FINITE, Limited(0), Limited.NOT_FINITE]
    # From here on the default, whatever comes: idle at once, wheels by 1/64 rad a step to straight, brake to 0.375.
    np.testing.assert_array_equal(found.values[4:, 0], [0.046875, 0.03125, 0.015625])
    np.testing.assert_array_equal(found.values[4:, 1], 0.0)
    np.testing.assert_array_equal(found.values[4:, 2], [0.25, 0.375, 0.375])
    assert found.bits[4:] == [Limited.NOT_FINITE | Limited.MANUAL_REQUESTED] + [Limited.MANUAL_REQUESTED] * 2


def test_an_old_pose_makes_an_old_command() -> None:
    good = (0.0625, 0.125, 0.0)
    found = run([good] * 4, [0.25, 0.26, 0.25, -0.01])
    assert found.bits == [Limited(0), Limited.STALE, Limited(0), Limited.STALE]
    np.testing.assert_array_equal(found.values[:, 3], [0.0, 1.0, 0.0, 1.0])


def test_a_hard_brake_is_not_let_go_by_the_default() -> None:
    found = run([(0.0, 0.0, 1.0)] * 4 + [(0.0, math.nan, 0.0)] * 4)
    np.testing.assert_array_equal(found.values[:, 2], [0.25, 0.5, 0.75, 1.0, 1.0, 1.0, 1.0, 1.0])


def test_a_limiter_starts_with_the_wheels_where_they_are_and_nothing_pressed() -> None:
    state = init_limiter(released(jnp.float32(0.25)))
    assert [float(part) for part in state.last] == [0.25, 0.0, 0.0]
    assert not state.missed
    assert not state.failed
    assert [flag.value for flag in Limited] == [2**place for place in range(10)]


def test_not_engaged_the_limiter_follows_the_wheels_as_far_as_they_are_measured() -> None:
    rules, no = LimiterRules(*(jnp.float32(rule) for rule in RULES)), jnp.asarray(False)
    state = LimiterState(Command(*(jnp.float32(value) for value in (0.125, 0.5, 0.0))), jnp.asarray(True), ~no)
    age, step, wanted = jnp.float32(AGE_S), jnp.float32(STEP_S), released(jnp.float32(0.5))

    def after(engaged: jax.Array, measured_rad: float) -> tuple[LimiterState[Command], int]:
        measured = released(jnp.float32(measured_rad))
        found, bits = limit_while_engaged(rules, state, wanted, age, step, engaged, measured)
        return found, int(bits)

    followed, bits = after(no, 0.375)
    assert [float(part) for part in followed.last] == [0.375, 0.0, 0.0]
    assert (bool(followed.missed), bool(followed.failed), bits) == (False, False, 0)
    unknown, _ = after(no, math.nan)
    assert [float(part) for part in unknown.last] == [0.125, 0.0, 0.0]
    # Engaged, a failed limiter stays with its default.
    failed, bits = after(~no, 0.375)
    assert [float(part) for part in failed.last] == [0.109375, 0.0, 0.25]
    assert (bool(failed.failed), Limited(bits)) == (True, Limited.MANUAL_REQUESTED)


def test_rules_of_any_vehicle_are_an_age_and_two_functions() -> None:
    """What a new vehicle must bring: the age is read as a value, as the field of a record is."""
    members = {name: value for name, value in vars(CommandRules).items() if not name.startswith("_")}
    assert set(members) == {"oldest_s", "within", "default"}
    assert isinstance(members["oldest_s"], property)
    assert "oldest_s" in LimiterRules._fields
