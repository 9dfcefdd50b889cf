"""A bounded particle swarm with ring neighbourhoods.

Independent of radar: it maximises any batched objective over the box [-1, 1]^dim. Constants are the constriction of
Clerc & Kennedy (2002) in inertia form. The topology is a ring unless a single global best is configured, which lost
about a fifth of hard problems to premature convergence where both were measured. Particles that cross a wall are
reflected and their speed on that axis is turned and halved, because clipping glues small swarms to walls. A score that
is not finite never becomes a best.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple, TypeVar

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Key

Objective = Callable[[Float[Array, "particle dim"]], Float[Array, " particle"]]
"""Scores of a batch of positions in the box; higher is better; -inf or NaN where there is nothing."""

Kept = TypeVar("Kept")


@dataclass(frozen=True)
class SwarmConfig:
    """Static settings of a swarm.

    Attributes:
        particles, iterations: number of particles and of iterations; each pair is compiled separately.
        neighbours: number of neighbours to each side on the ring; ``None``: all are neighbours, the single global best.
        inertia, attraction: w and c1 = c2 of the constriction.
        velocity_cap: largest step, as a share of the box's width.
    """

    particles: int
    iterations: int
    neighbours: int | None = 2
    inertia: float = 0.7298
    attraction: float = 1.49618
    velocity_cap: float = 0.25


class SwarmState(NamedTuple):
    """State of the loop."""

    position: Float[Array, "particle dim"]
    velocity: Float[Array, "particle dim"]
    best_position: Float[Array, "particle dim"]
    best_score: Float[Array, " particle"]


class SwarmResult(NamedTuple):
    """The best place found.

    Attributes:
        position: position in the box.
        score: score of the position; -inf if no particle ever scored.
        history: best score after the start and after each iteration.
    """

    position: Float[Array, " dim"]
    score: Float[Array, ""]
    history: Float[Array, " iteration"]


class SwarmTrail(NamedTuple):
    """Every particle at the start and after each iteration."""

    position: Float[Array, "iteration particle dim"]
    best_position: Float[Array, "iteration particle dim"]
    best_score: Float[Array, "iteration particle"]


def init_swarm(key: Key[Array, ""], start: Float[Array, "particle dim"], objective: Objective) -> SwarmState:
    """Score the start positions; they are the first personal bests. The key is consumed."""
    score = _finite(objective(start))
    velocity = 0.5 * (jax.random.permutation(key, start) - start)
    return SwarmState(start, velocity, start, score)


def step_swarm(
    key: Key[Array, ""],
    state: SwarmState,
    objective: Objective,
    free: Bool[Array, " dim"],
    *,
    config: SwarmConfig,
) -> SwarmState:
    """One synchronous update. The key is consumed.

    Args:
        state: state before the update.
        objective: objective to maximise.
        free: mask of free degrees of freedom; the others keep their start values.
    """
    pull = jax.random.uniform(key, (2, *state.position.shape)) * config.attraction
    leader = _ring_best(state, config.neighbours)
    velocity = (
        config.inertia * state.velocity
        + pull[0] * (state.best_position - state.position)
        + pull[1] * (leader - state.position)
    )
    cap = 2.0 * config.velocity_cap
    velocity = jnp.where(free[None, :], jnp.clip(velocity, -cap, cap), 0.0)
    moved = state.position + velocity
    crossed = jnp.abs(moved) > 1.0
    position = jnp.clip(jnp.where(crossed, jnp.sign(moved) * 2.0 - moved, moved), -1.0, 1.0)
    velocity = jnp.where(crossed, -0.5 * velocity, velocity)
    score = _finite(objective(position))
    better = score > state.best_score
    return SwarmState(
        position,
        velocity,
        jnp.where(better[:, None], position, state.best_position),
        jnp.where(better, score, state.best_score),
    )


def run_swarm(
    key: Key[Array, ""],
    start: Float[Array, "particle dim"],
    objective: Objective,
    free: Bool[Array, " dim"],
    *,
    config: SwarmConfig,
) -> SwarmResult:
    """Maximise an objective over the box [-1, 1]^dim by a particle swarm. The key is consumed.

    A pure function, for jit and vmap. The position is chosen by comparisons alone, so it has no gradient; the score has
    the objective's gradient at the position found, which at a maximum is the gradient of the maximum.

    Args:
        key: random key.
        start: first positions, in the box.
        objective: function of positions [particle, dim] to scores, higher is better; -inf or NaN for no score.
        free: mask of free degrees of freedom; the others keep their start values.
        config: sizes and constants.

    Returns:
        SwarmResult: position, score and history.
    """
    end, history = _run(key, start, objective, free, lambda state: jnp.max(state.best_score), config=config)
    winner = jnp.argmax(end.best_score)
    return SwarmResult(end.best_position[winner], end.best_score[winner], history)


def watch_swarm(
    key: Key[Array, ""],
    start: Float[Array, "particle dim"],
    objective: Objective,
    free: Bool[Array, " dim"],
    *,
    config: SwarmConfig,
) -> SwarmTrail:
    """Run the swarm as ``run_swarm`` does and keep its whole history. The key is consumed."""
    return _run(
        key,
        start,
        objective,
        free,
        lambda state: SwarmTrail(state.position, state.best_position, state.best_score),
        config=config,
    )[1]


def _run(
    key: Key[Array, ""],
    start: Float[Array, "particle dim"],
    objective: Objective,
    free: Bool[Array, " dim"],
    keep: Callable[[SwarmState], Kept],
    *,
    config: SwarmConfig,
) -> tuple[SwarmState, Kept]:
    """Final state of the swarm, and the stacked results of ``keep`` at the start and after each iteration."""
    keys = jax.random.split(key, config.iterations + 1)
    state = init_swarm(keys[0], start, objective)

    def body(carry: SwarmState, step_key: Key[Array, ""]) -> tuple[SwarmState, Kept]:
        after = step_swarm(step_key, carry, objective, free, config=config)
        return after, keep(after)

    end, later = jax.lax.scan(body, state, keys[1:])
    kept: Kept = jax.tree.map(lambda first, rest: jnp.concatenate([first[None], rest]), keep(state), later)
    return end, kept


def _ring_best(state: SwarmState, neighbours: int | None) -> Float[Array, "particle dim"]:
    """Best personal best among each particle and its neighbours on the ring; shifts, no gather of a table."""
    if neighbours is None:
        return jnp.broadcast_to(state.best_position[jnp.argmax(state.best_score)], state.best_position.shape)
    leader, score = state.best_position, state.best_score
    for shift in [s for n in range(1, neighbours + 1) for s in (-n, n)]:
        other = jnp.roll(state.best_score, shift)
        better = other > score
        leader = jnp.where(better[:, None], jnp.roll(state.best_position, shift, axis=0), leader)
        score = jnp.where(better, other, score)
    return leader


def _finite(score: Float[Array, " particle"]) -> Float[Array, " particle"]:
    return jnp.where(jnp.isfinite(score), score, -jnp.inf)
