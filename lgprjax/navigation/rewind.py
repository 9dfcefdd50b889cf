"""Observations that come late: the last ticks are kept, and a late one is put in its tick and all is run again.

What comes out is what an orderly arrival would have given. An observation older than the ticks kept is counted and
dropped, and so is one whose slot is taken.
"""

from enum import IntEnum
from typing import NamedTuple, TypeVar

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Int

from lgprjax.errors import InputError
from lgprjax.navigation.counter_steer_filter import FilterInfo, FilterState, step_filter
from lgprjax.navigation.counter_steer_model import FilterModel
from lgprjax.navigation.observations import (
    SOURCES,
    GateRules,
    MotionInput,
    Observations,
    no_observations,
    valid_sources,
)

T = TypeVar("T")


class InsertCode(IntEnum):
    """What became of late observations."""

    TAKEN = 0
    TOO_LATE = 1
    DUPLICATE = 2
    EMPTY = 3


class History(NamedTuple):
    """The filter now, and a ring of the last ticks.

    Attributes:
        state: at the end of the last tick.
        before: at each kept tick's start; leading axis is the ring.
        motions, observations: of each kept tick.
        newest: place of the last tick in the ring.
        filled: ticks kept so far, at most the ring's length.
        dropped: observations that came too late, by source.
        duplicates: observations whose slot was taken, by source.
    """

    state: FilterState
    before: FilterState
    motions: MotionInput
    observations: Observations
    newest: Int[Array, "..."]
    filled: Int[Array, "..."]
    dropped: Int[Array, "... 4"]
    duplicates: Int[Array, "... 4"]


def init_history(state: FilterState, ticks: int) -> History:
    """A history without ticks.

    Args:
        state: where the filter starts.
        ticks: kept; at 21 Hz, 21 allow for observations a second late.

    Raises:
        InputError: not one tick.
    """
    if ticks < 1:
        raise InputError("history", "ticks", "at least 1", f"{ticks}")
    none = jnp.zeros(len(SOURCES), jnp.int32)
    first: tuple[FilterState, MotionInput, Observations]
    first = (state, MotionInput(jnp.float32(0.0), jnp.float32(0.0)), no_observations())
    before, motions, observations = jax.tree.map(lambda leaf: jnp.repeat(leaf[None], ticks, axis=0), first)
    return History(state, before, motions, observations, jnp.int32(ticks - 1), jnp.int32(0), none, none)


def step_history(
    model: FilterModel, rules: GateRules, history: History, motion: MotionInput, observations: Observations
) -> tuple[History, FilterInfo]:
    """One tick of the filter, remembered."""
    ticks = history.motions.step_s.shape[0]
    newest = (history.newest + 1) % ticks
    state, info = step_filter(model, rules, history.state, motion, observations)
    stepped = history._replace(
        state=state,
        before=_put(history.before, newest, history.state),
        motions=_put(history.motions, newest, motion),
        observations=_put(history.observations, newest, observations),
        newest=newest,
        filled=jnp.minimum(history.filled + 1, ticks),
    )
    return stepped, info


def insert(
    model: FilterModel, rules: GateRules, history: History, late: Observations, ticks_ago: Int[Array, ""]
) -> tuple[History, Int[Array, ""]]:
    """Puts late observations into their tick and runs all ticks from there again.

    Args:
        model, rules: of the filter, as in the ticks.
        history: of the last ticks.
        late: their ages count from the end of the tick they belong to.
        ticks_ago: that tick; 0 is the last one.

    Returns:
        The history, and an ``InsertCode``: ``TAKEN`` if any was taken, else why not.
    """
    ticks = history.motions.step_s.shape[0]
    kept = (ticks_ago >= 0) & (ticks_ago < history.filled)
    back = jnp.where(kept, ticks_ago, 0)
    first = (history.newest - back) % ticks
    offered, slots = valid_sources(late), _at(history.observations, first)
    occupied = valid_sources(slots)
    taken = offered & kept & ~occupied
    merged = Observations(
        *(
            jax.tree.map(lambda new, old, use=taken[source]: jnp.where(use, new, old), new, old)
            for source, (new, old) in enumerate(zip(late, slots, strict=True))
        )
    )
    observations = _put(history.observations, first, merged)

    def again(step: Int[Array, ""], run: tuple[FilterState, FilterState]) -> tuple[FilterState, FilterState]:
        state, before = run
        place = (first + step) % ticks
        before = _put(before, place, state)
        motion = _at(history.motions, place)
        return step_filter(model, rules, state, motion, _at(observations, place))[0], before

    # Without anything taken there is nothing to run, and the state stays what it is.
    steps = jnp.where(jnp.any(taken), back + 1, 0)
    start = jax.tree.map(lambda old, now: jnp.where(steps > 0, old, now), _at(history.before, first), history.state)
    state, before = jax.lax.fori_loop(0, steps, again, (start, history.before))
    inserted = history._replace(
        state=state,
        before=before,
        observations=observations,
        dropped=history.dropped + (offered & ~kept).astype(jnp.int32),
        duplicates=history.duplicates + (offered & kept & occupied).astype(jnp.int32),
    )
    return inserted, _code(offered, kept, taken)


def _code(offered: Bool[Array, " 4"], kept: Bool[Array, ""], taken: Bool[Array, " 4"]) -> Int[Array, ""]:
    refused = jnp.where(kept, int(InsertCode.DUPLICATE), int(InsertCode.TOO_LATE))
    refused = jnp.where(jnp.any(offered), refused, int(InsertCode.EMPTY))
    return jnp.where(jnp.any(taken), int(InsertCode.TAKEN), refused).astype(jnp.int32)


def _at(ring: T, place: Int[Array, ""]) -> T:
    picked: T = jax.tree.map(lambda leaf: leaf[place], ring)
    return picked


def _put(ring: T, place: Int[Array, ""], one: T) -> T:
    kept: T = jax.tree.map(lambda leaf, value: leaf.at[place].set(value), ring, one)
    return kept
