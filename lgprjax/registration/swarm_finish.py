"""The finish by particle swarm: about each coarse summit, in all five degrees of freedom, on the direct score.

The search of the first system of this kind (LL), kept beside Gauss-Newton: it asks for no derivative, so that it serves
whatever score there is.
"""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, UInt32

from lgprjax.pso import SwarmConfig, run_swarm
from lgprjax.registration.correlation import Template, score_poses
from lgprjax.registration.newton import PRIOR
from lgprjax.subsurface import Tile

_REACH_M = 0.12
"""About a summit the swarm explores what the coarse stage left open, no more: summits stay apart."""


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
    pull = jnp.asarray([0.0, 0.0, *PRIOR[2:5]], dtype=jnp.float32)
    key = jax.random.key(seed)

    def one(lane: tuple[Template, Array, Array, Array, Array, Array]) -> Float[Array, "6"]:
        single, centre, middle, width, known, number = lane
        reach = width[:5].at[:2].set(jnp.minimum(width[:2], _REACH_M))
        first, second = jax.random.split(jax.random.fold_in(key, number))
        cloud = jax.random.uniform(first, (config.particles, 5), minval=-1.0, maxval=1.0)
        cloud = jnp.where(free[None, :5], cloud, 0.0).at[0].set(0.0)

        def posterior(u: Float[Array, "particle 5"]) -> Float[Array, " particle"]:
            pose = centre[None, :5] + u * reach[None]
            score = score_poses(tile, single, pose, height_reference_m, angular_frequency_rad_per_ns, min_overlap)
            r = jnp.clip(score.correlation, 0.05, 0.999)
            away = (pose - middle[None, :5]) / width[None, :5]
            return score.strength - 0.5 * (1.0 - r**2) / (known * r) * jnp.sum(pull[None] * away**2, axis=-1)

        ended = run_swarm(second, cloud, posterior, free[:5], config=config)
        return jnp.concatenate([centre[:5] + ended.position * reach, centre[5:]])

    poses: Float[Array, "batch 6"] = jax.lax.map(one, (template, start, prior, half_width, numbers, lane_seed))
    return poses
