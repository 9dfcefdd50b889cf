"""Fixes without ground or radar: what registration would be wrong by, drawn from a model calibrated on real searches.

An error of a fix hardly changes from scan to scan: neighbouring scans hear the same ground. It is a Gauss-Markov
process over the way, beside a white part. Fixes fail in stretches, not one by one: where the ground is poor.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, PRNGKeyArray


class FixErrors(NamedTuple):
    """Errors of fixes along, across and in heading, and where there are none. Scalars or one value a lane.

    Attributes:
        slow_sigma: of the slowly changing part: along_m, cross_m, yaw_rad.
        slow_m: way over which it changes.
        white_sigma: of the part that is new with every fix.
        bias: that stays.
        reported_sigma: what a fix says of itself.
        found_m, lost_m: mean lengths of stretches with fixes, and without.
        strength: correlation times the root of the overlap where there are fixes.
        p_false: probability that ground which is not the map's would have matched as well, where there are fixes.
    """

    slow_sigma: Float[Array, "... 3"]
    slow_m: Float[Array, "..."]
    white_sigma: Float[Array, "... 3"]
    bias: Float[Array, "... 3"]
    reported_sigma: Float[Array, "... 3"]
    found_m: Float[Array, "..."]
    lost_m: Float[Array, "..."]
    strength: Float[Array, "..."]
    p_false: Float[Array, "..."]


class FixErrorState(NamedTuple):
    """The slow part, and whether the ground gives fixes here."""

    slow: Float[Array, "... 3"]
    found: Bool[Array, "..."]


def init_fix_errors(model: FixErrors, key: PRNGKeyArray) -> FixErrorState:
    """Drawn from the stationary distribution; one lane."""
    draw, place = jax.random.split(key)
    share = model.found_m / (model.found_m + model.lost_m)
    return FixErrorState(model.slow_sigma * jax.random.normal(draw, (3,)), jax.random.uniform(place) < share)


def step_fix_errors(
    model: FixErrors, state: FixErrorState, key: PRNGKeyArray, way_m: Float[Array, ""]
) -> tuple[FixErrorState, Float[Array, "3"]]:
    """The state after some way, and the error of a fix there: along_m, cross_m, yaw_rad; one lane."""
    slow_key, white_key, change_key = jax.random.split(key, 3)
    way_m = jnp.abs(way_m)
    keep = jnp.exp(-way_m / model.slow_m)
    fresh = jnp.sqrt(jnp.maximum(1.0 - keep * keep, 0.0)) * model.slow_sigma
    slow = keep * state.slow + fresh * jax.random.normal(slow_key, (3,))
    chance = jax.random.uniform(change_key)
    stays = jnp.exp(-way_m / jnp.where(state.found, model.found_m, model.lost_m))
    found = jnp.where(chance < stays, state.found, ~state.found)
    error = model.bias + slow + model.white_sigma * jax.random.normal(white_key, (3,))
    return FixErrorState(slow, found), error
