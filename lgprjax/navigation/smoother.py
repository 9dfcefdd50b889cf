"""A whole drive at once: the filter forward, then back by Rauch, Tung and Striebel (1965).

For labelling baselines and for judging the filter: every tick's estimate rests on what came before it and after it. One
drive a call; several of equal length by ``vmap``. A drive is made longer by ticks of no length without observations,
which change nothing.
"""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool

from lgprjax.navigation.error_state import predict, transition_matrix, transition_of
from lgprjax.navigation.filter import FilterInfo, FilterState, step_filter
from lgprjax.navigation.filter_model import FilterModel, NavEstimate
from lgprjax.navigation.gates import GateRules
from lgprjax.navigation.observations import Motion, Observations

# Added to a correlation matrix, whose diagonal is 1: float32 knows its entries no better.
_RIDGE = 1e-6


def filter_drive(
    model: FilterModel, rules: GateRules, start: FilterState, motions: Motion, observations: Observations
) -> tuple[NavEstimate, FilterInfo]:
    """Estimates after each tick of a drive, and what became of the observations; leading axis tick.

    Args:
        model, rules: of the filter.
        start: before the first tick.
        motions, observations: leading axis tick.
    """

    def step(
        state: FilterState, tick: tuple[Motion, Observations]
    ) -> tuple[FilterState, tuple[NavEstimate, FilterInfo]]:
        state, info = step_filter(model, rules, state, *tick)
        return state, (state.estimate, info)

    driven: tuple[NavEstimate, FilterInfo] = jax.lax.scan(step, start, (motions, observations))[1]
    return driven


def smooth_drive(
    model: FilterModel, rules: GateRules, start: FilterState, motions: Motion, observations: Observations
) -> NavEstimate:
    """Estimate at the end of each tick from all observations of the drive; leading axis tick.

    What the gates of the forward pass reject takes no part. Where a source was re-acquired the filter had been wrong,
    and nothing is carried back across that tick.

    Args:
        model, rules: of the filter.
        start: before the first tick.
        motions, observations: leading axis tick.
    """
    filtered, info = filter_drive(model, rules, start, motions, observations)
    return smooth_estimates(model, filtered, motions, info.reacquired.any(axis=-1))


def smooth_estimates(
    model: FilterModel, filtered: NavEstimate, motions: Motion, restarted: Bool[Array, " tick"]
) -> NavEstimate:
    """The way back over estimates of a forward pass.

    Args:
        model: of the filter.
        filtered: after each tick.
        motions: of each tick.
        restarted: ticks across which nothing is carried back.
    """

    def back(later: NavEstimate, tick: tuple[NavEstimate, Motion, Bool[Array, ""]]) -> tuple[NavEstimate, NavEstimate]:
        smoothed = _step_back(model, later, *tick)
        return smoothed, smoothed

    last = jax.tree.map(lambda leaf: leaf[-1], filtered)
    before = jax.tree.map(lambda leaf: leaf[:-1], filtered)
    after = jax.tree.map(lambda leaf: leaf[1:], (motions, restarted))
    smoothed = jax.lax.scan(back, last, (before, *after), reverse=True)[1]
    whole: NavEstimate = jax.tree.map(lambda many, one: jnp.concatenate([many, one[None]]), smoothed, last)
    return whole


def _step_back(
    model: FilterModel, later: NavEstimate, filtered: NavEstimate, motion: Motion, restarted: Bool[Array, ""]
) -> NavEstimate:
    """The smoothed estimate a tick before ``later``; ``motion`` is that of the tick between."""
    predicted = predict(model, filtered, motion)
    transition = transition_matrix(transition_of(model, filtered, motion))
    noise = predict(model, filtered._replace(covariance=jnp.zeros_like(filtered.covariance)), motion).covariance
    sigma = jnp.sqrt(jnp.maximum(jnp.diagonal(predicted.covariance), 1e-20))
    identity = jnp.eye(sigma.size, dtype=sigma.dtype)
    correlation = predicted.covariance / (sigma[:, None] * sigma[None, :]) + _RIDGE * identity
    forward = transition @ filtered.covariance
    gain = jax.scipy.linalg.solve(correlation, forward / sigma[:, None], assume_a="pos").T / sigma[None, :]
    gain = jnp.where(restarted, 0.0, gain)
    # A sum of squares: rounding cannot make it indefinite, as the difference of the textbook's form would.
    kept = identity - gain @ transition
    covariance = kept @ filtered.covariance @ kept.T + gain @ (noise + later.covariance) @ gain.T
    mean = filtered.mean + gain @ (later.mean - predicted.mean)
    return NavEstimate(mean, 0.5 * (covariance + covariance.T))
