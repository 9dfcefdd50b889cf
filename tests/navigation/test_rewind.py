"""Late observations: put back where they belong they give what order would have given."""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from lgprjax.errors import InputError
from lgprjax.navigation import (
    SOURCES,
    FilterInfo,
    History,
    InsertCode,
    MotionInput,
    Observations,
    default_model,
    default_rules,
    init_filter,
    init_history,
    insert,
    no_observations,
    step_history,
)
from lgprjax.vehicle import VehiclePose
from navigation.drawn_drives import draw_drives

TICKS, KEPT, LONGEST = 63, 21, 15
MODEL = default_model(zero_slip_m=1.4, gnss_x_m=0.8, gnss_y_m=0.3, array_x_m=6.0, array_y_m=-0.1)


class Machine(NamedTuple):
    """Both functions compiled, how often each was traced, and a drive's motions and observations by tick."""

    step: Callable[[History, MotionInput, Observations], tuple[History, FilterInfo]]
    insert: Callable[[History, Observations, jax.Array], tuple[History, jax.Array]]
    traced: list[str]
    start: History
    motions: list[MotionInput]
    observations: list[Observations]


@pytest.fixture(scope="module")
def machine() -> Machine:
    rules, traced = default_rules(), []

    def stepped(history: History, motion: MotionInput, observations: Observations) -> tuple[History, FilterInfo]:
        traced.append("step")
        return step_history(MODEL, rules, history, motion, observations)

    def inserted(history: History, late: Observations, ticks_ago: jax.Array) -> tuple[History, jax.Array]:
        traced.append("insert")
        return insert(MODEL, rules, history, late, ticks_ago)

    drawn = draw_drives(MODEL, runs=1, ticks=TICKS, seed=4)
    at = jnp.asarray(drawn.start[0], jnp.float32)
    start = init_history(init_filter(MODEL, VehiclePose(at[0], at[1], at[2]), at[3]), KEPT)
    ticks = [
        jax.tree.map(lambda leaf, t=tick: leaf[t, 0], (drawn.motions, drawn.observations)) for tick in range(TICKS)
    ]
    return Machine(
        jax.jit(stepped), jax.jit(inserted), traced, start, [tick[0] for tick in ticks], [tick[1] for tick in ticks]
    )


@pytest.fixture(scope="module")
def in_order(machine: Machine) -> History:
    history = machine.start
    for motion, observations in zip(machine.motions, machine.observations, strict=True):
        history, _ = machine.step(history, motion, observations)
    return history


def only(observations: Observations, sources: tuple[int, ...]) -> Observations:
    """The slots of some sources, the others empty."""
    kept = {name: observations[index] for index, name in enumerate(SOURCES) if index in sources}
    return no_observations()._replace(**kept)  # type: ignore[arg-type]


def as_drawn(history: History, expected: History) -> None:
    mean, wanted = (np.asarray(part.state.estimate.mean) for part in (history, expected))
    spread = np.asarray(expected.state.estimate.covariance, np.float64)
    sigma = np.sqrt(np.diagonal(spread))
    np.testing.assert_allclose(mean, wanted, rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(
        np.asarray(history.state.estimate.covariance) / np.outer(sigma, sigma),
        spread / np.outer(sigma, sigma),
        atol=1e-5,
    )
    for part, other in zip(history.state.gates, expected.state.gates, strict=True):
        np.testing.assert_allclose(np.asarray(part), np.asarray(other), rtol=1e-6, atol=1e-5)


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_late_observations_give_what_order_gives(machine: Machine, in_order: History, seed: int) -> None:
    """GNSS up to 15 ticks late, LGPR up to 15, several of them in one tick, in any order."""
    rng = np.random.default_rng(seed)
    delays = {(tick, source): int(rng.integers(0, LONGEST + 1)) for tick in range(TICKS) for source in (0, 3)}
    delays = {key: min(delay, TICKS - 1 - key[0]) for key, delay in delays.items()}
    history, late = machine.start, 0
    for tick in range(TICKS):
        now = tuple(source for source in (0, 3) if delays[tick, source] == 0)
        history, _ = machine.step(history, machine.motions[tick], only(machine.observations[tick], (1, 2, *now)))
        due = [key for key, delay in delays.items() if delay > 0 and key[0] + delay == tick]
        for place in rng.permutation(len(due)):
            taken, source = due[place]
            observations = only(machine.observations[taken], (source,))
            history, code = machine.insert(history, observations, jnp.int32(tick - taken))
            there = bool(observations[source].valid)
            assert int(code) == (InsertCode.TAKEN if there else InsertCode.EMPTY)
            late += there
    assert late > 40
    as_drawn(history, in_order)
    assert not np.any(np.asarray(history.dropped))
    assert not np.any(np.asarray(history.duplicates))


def test_what_is_later_than_the_ticks_kept_is_counted_and_dropped(machine: Machine, in_order: History) -> None:
    odometer = only(machine.observations[5], (2,))
    assert bool(odometer.odometer.valid)
    for ticks_ago in (KEPT, KEPT + 30, -1):
        history, code = machine.insert(in_order, odometer, jnp.int32(ticks_ago))
        assert int(code) == InsertCode.TOO_LATE
        np.testing.assert_array_equal(np.asarray(history.dropped), [0, 0, 1, 0])
        np.testing.assert_array_equal(np.asarray(history.duplicates), 0)
        for part, other in zip(jax.tree.leaves(history.state), jax.tree.leaves(in_order.state), strict=True):
            np.testing.assert_array_equal(np.asarray(part), np.asarray(other))


def test_before_the_first_tick_there_is_nothing_to_put_it_in(machine: Machine) -> None:
    history, _ = machine.step(machine.start, machine.motions[0], no_observations())
    _, code = machine.insert(history, only(machine.observations[1], (2,)), jnp.int32(0))
    assert int(code) == InsertCode.TAKEN
    refused, code = machine.insert(history, only(machine.observations[1], (2,)), jnp.int32(1))
    assert int(code) == InsertCode.TOO_LATE
    assert int(refused.dropped[2]) == 1


def test_a_duplicate_is_counted_once_and_changes_nothing(machine: Machine, in_order: History) -> None:
    ago = next(ago for ago in range(KEPT) if bool(machine.observations[TICKS - 1 - ago].lgpr.valid))
    again = only(machine.observations[TICKS - 1 - ago], (3,))
    history, code = machine.insert(in_order, again, jnp.int32(ago))
    assert int(code) == InsertCode.DUPLICATE
    np.testing.assert_array_equal(np.asarray(history.duplicates), [0, 0, 0, 1])
    np.testing.assert_array_equal(np.asarray(history.dropped), 0)
    for part, other in zip(jax.tree.leaves(history.state), jax.tree.leaves(in_order.state), strict=True):
        np.testing.assert_array_equal(np.asarray(part), np.asarray(other))


def test_each_function_is_traced_once(machine: Machine, in_order: History) -> None:
    for ticks_ago in (0, 3, 40):
        machine.insert(in_order, machine.observations[7], jnp.int32(ticks_ago))
    assert sorted(machine.traced) == ["insert", "step"]


def test_a_history_keeps_a_tick_at_least(machine: Machine) -> None:
    with pytest.raises(InputError, match="at least 1"):
        init_history(machine.start.state, 0)
