"""The finish by particle swarm: about each coarse summit, in all five degrees of freedom, on the direct score.

The search of the first system of this kind (LL), kept beside Gauss-Newton: it asks for no derivative, so that it serves
whatever score there is.
"""

from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Key, UInt32

from lgprjax.pso import Objective, SwarmConfig, run_swarm, watch_swarm
from lgprjax.registration.correlation import Template, score_poses
from lgprjax.registration.newton import PRIOR
from lgprjax.subsurface import Tile

_REACH_M = 0.12
"""About a summit the swarm explores what the coarse stage left open, no more: summits stay apart."""
_SEEN = 41
"""Positions to a side at which a watched swarm's score is shown."""

Lane = tuple[Template, Float[Array, "6"], Float[Array, "6"], Float[Array, "6"], Float[Array, ""], UInt32[Array, ""]]
"""One start: template, start, prior and half widths, independent numbers, seed."""


def swarm_poses(
    tile: Tile,
    height_reference_m: Float[Array, ""],
    angular_frequency_rad_per_ns: Float[Array, " half"],
    min_overlap: float | Float[Array, ""],
    template: Template,
    start: Float[Array, "batch 6"],
    prior: Float[Array, "batch 6"],
    half_width: Float[Array, "batch 6"],
    numbers: Float[Array, " batch"],
    free: Bool[Array, "6"],
    seed: UInt32[Array, ""],
    lane_seed: UInt32[Array, " batch"],
    *,
    config: SwarmConfig,
) -> Float[Array, "batch 6"]:
    """Best pose of a swarm about each start; arguments as for ``climb``, with a seed of each lane."""
    ground = (tile, height_reference_m, angular_frequency_rad_per_ns, min_overlap)

    def one(lane: Lane) -> Float[Array, "6"]:
        hunt = _hunt(ground, lane, free, seed, config)
        ended = run_swarm(hunt.key, hunt.cloud, hunt.posterior, free[:5], config=config)
        return jnp.concatenate([hunt.centre + ended.position * hunt.reach, lane[1][5:]])

    poses: Float[Array, "batch 6"] = jax.lax.map(one, (template, start, prior, half_width, numbers, lane_seed))
    return poses


class SwarmView(NamedTuple):
    """A swarm about one start, as it went; places along and across in the tile's frame.

    Attributes:
        place_m: where the particles stood at the start and after each iteration.
        best_m: the best place that any of them had met by then.
        best_score: the best score that each of them had met by then; -inf before it met any.
        along_m, cross_m, score: what the swarm climbs over positions, the rest of the pose as the swarm left it.
    """

    place_m: Float[Array | np.ndarray, "iteration particle 2"]
    best_m: Float[Array | np.ndarray, "iteration 2"]
    best_score: Float[Array | np.ndarray, "iteration particle"]
    along_m: Float[Array | np.ndarray, " along"]
    cross_m: Float[Array | np.ndarray, " cross"]
    score: Float[Array | np.ndarray, "along cross"]


@partial(jax.jit, static_argnames="config")
def watch_finish(
    tile: Tile,
    height_reference_m: Float[Array, ""],
    angular_frequency_rad_per_ns: Float[Array, " half"],
    min_overlap: float | Float[Array, ""],
    template: Template,
    start: Float[Array, "6"],
    prior: Float[Array, "6"],
    half_width: Float[Array, "6"],
    numbers: Float[Array, ""],
    free: Bool[Array, "6"],
    seed: UInt32[Array, ""],
    lane_seed: UInt32[Array, ""],
    *,
    config: SwarmConfig,
) -> SwarmView:
    """One lane of ``swarm_poses``, kept whole for looking at; ``template`` is a single one."""
    ground = (tile, height_reference_m, angular_frequency_rad_per_ns, min_overlap)
    hunt = _hunt(ground, (template, start, prior, half_width, numbers, lane_seed), free, seed, config)
    trail = watch_swarm(hunt.key, hunt.cloud, hunt.posterior, free[:5], config=config)
    rows = jnp.arange(len(trail.best_score))
    best = trail.best_position[rows, jnp.argmax(trail.best_score, axis=1)]
    side = jnp.linspace(-1.0, 1.0, _SEEN)
    along, cross = jnp.meshgrid(side, side, indexing="ij")
    seen = jnp.broadcast_to(best[-1][None], (_SEEN**2, 5))
    seen = seen.at[:, 0].set(along.reshape(-1)).at[:, 1].set(cross.reshape(-1))
    middle, reach = hunt.centre[:2], hunt.reach[:2]
    place = middle[None, None] + trail.position[..., :2] * reach[None, None]
    return SwarmView(
        place,
        middle[None] + best[:, :2] * reach[None],
        trail.best_score,
        middle[0] + side * reach[0],
        middle[1] + side * reach[1],
        hunt.posterior(seen).reshape(_SEEN, _SEEN),
    )


class _Hunt(NamedTuple):
    """What a swarm about one start is run with: its cloud stands in units of ``reach`` about ``centre``."""

    key: Key[Array, ""]
    cloud: Float[Array, "particle 5"]
    posterior: Objective
    centre: Float[Array, "5"]
    reach: Float[Array, "5"]


def _hunt(
    ground: tuple[Tile, Float[Array, ""], Float[Array, " half"], float | Float[Array, ""]],
    lane: Lane,
    free: Bool[Array, "6"],
    seed: UInt32[Array, ""],
    config: SwarmConfig,
) -> _Hunt:
    tile, height_reference_m, omega, min_overlap = ground
    template, start, prior, half_width, numbers, lane_seed = lane
    pull = jnp.asarray([0.0, 0.0, *PRIOR[2:5]], dtype=jnp.float32)
    centre, width = start[:5], half_width[:5]
    reach = width.at[:2].set(jnp.minimum(width[:2], _REACH_M))
    first, second = jax.random.split(jax.random.fold_in(jax.random.key(seed), lane_seed))
    cloud = jax.random.uniform(first, (config.particles, 5), minval=-1.0, maxval=1.0)
    cloud = jnp.where(free[None, :5], cloud, 0.0).at[0].set(0.0)

    def posterior(u: Float[Array, "particle 5"]) -> Float[Array, " particle"]:
        pose = centre[None] + u * reach[None]
        score = score_poses(tile, template, pose, height_reference_m, omega, min_overlap)
        r = jnp.clip(score.correlation, 0.05, 0.999)
        away = (pose - prior[None, :5]) / width[None]
        return score.strength - 0.5 * (1.0 - r**2) / (numbers * r) * jnp.sum(pull[None] * away**2, axis=-1)

    return _Hunt(second, cloud, posterior, centre, reach)
