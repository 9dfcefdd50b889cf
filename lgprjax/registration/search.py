"""Registration of a batch of templates against one tile: coarse surface, swarm on each mode, judgement."""

from dataclasses import dataclass, field
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int, Key, UInt32

from lgprjax.pso import SwarmConfig, run_swarm
from lgprjax.radar import air_delay_ns, shift_travel_time
from lgprjax.registration.coarse import CoarseSurface, Modes, coarse_surface, find_modes, trace_products
from lgprjax.registration.correlation import Score, Template, score_poses
from lgprjax.registration.fix import Fix
from lgprjax.registration.integrity import PRIOR, Thresholds, judge, noise_scale, peak_covariance, stencil_poses
from lgprjax.subsurface import Tile


@dataclass(frozen=True)
class SearchSpec:
    """Static shape of a search: one compile each.

    Attributes:
        lattice: points of the coarse stage along and cross.
        margin: cells that an antenna may stand outside the tile.
        modes: places that the swarm refines; the best two make the margin.
        swarm: the swarm on each mode.
    """

    lattice: tuple[int, int]
    margin: tuple[int, int]
    modes: int = 2
    swarm: SwarmConfig = field(default_factory=lambda: SwarmConfig(particles=24, iterations=16))


class Region(NamedTuple):
    """How to search: data, not shape.

    Attributes:
        apart_m: two places nearer than this are one.
        free: degrees of freedom that are searched.
    """

    apart_m: Float[Array, ""]
    free: Bool[Array, "5"]


class Problem(NamedTuple):
    """A batch of templates with their priors.

    Attributes:
        template: batched.
        prior: along_m, cross_m, height_m above ground, yaw_rad, roll_rad in the tile's frame.
        half_width: of the search region about the prior, in the same order.
        finite: enough finite traces to try.
        number: of the scan; seeds the swarm, so that a fix depends on nothing around it.
    """

    template: Template
    prior: Float[Array, "batch 5"]
    half_width: Float[Array, "batch 5"]
    finite: Bool[Array, " batch"]
    number: UInt32[Array, " batch"]


@partial(jax.jit, static_argnames="spec")
def register_batch(
    key: Key[Array, ""],
    tile: Tile,
    problem: Problem,
    region: Region,
    height_reference_m: Float[Array, ""],
    angular_frequency_rad_per_ns: Float[Array, " half"],
    thresholds: Thresholds,
    *,
    spec: SearchSpec,
) -> Fix:
    """Fixes of a batch, poses in the tile's frame. The key is consumed.

    Lanes share one matrix product and are then worked off one by one: a vmap over them would turn every
    slice into a gather (measured twenty times slower than this loop), and no lane can touch another.
    """
    sane = problem.finite[:, None] & problem.template.valid
    template = problem.template._replace(
        coefficients=jnp.where(sane[..., None], problem.template.coefficients, 0.0), valid=sane
    )
    # The coarse stage has the prior's height and roll: antennas to the tile's reference, as in score_poses.
    height_m = problem.prior[:, 2, None] + template.offset_m[..., 1] * jnp.sin(problem.prior[:, 4, None])
    levelled = shift_travel_time(
        template.coefficients, -air_delay_ns(height_m - height_reference_m), angular_frequency_rad_per_ns
    )
    products = trace_products(tile, template._replace(coefficients=levelled))

    def one(lane: tuple[Template, Array, Array, Array, Array, Array]) -> Fix:
        lane_template, lane_products, prior, half_width, finite, number = lane
        return _register(
            jax.random.fold_in(key, number),
            tile,
            lane_template,
            lane_products,
            prior,
            half_width,
            finite,
            region,
            height_reference_m,
            angular_frequency_rad_per_ns,
            thresholds,
            spec,
        )

    fixes: Fix = jax.lax.map(
        one, (template, products, problem.prior, problem.half_width, problem.finite, problem.number)
    )
    return fixes


@jax.jit
def score_truth(
    tile: Tile,
    template: Template,
    pose: Float[Array, "batch 5"],
    height_reference_m: Float[Array, ""],
    angular_frequency_rad_per_ns: Float[Array, " half"],
) -> Float[Array, " batch"]:
    """Correlation of each template at one pose of its own, in the tile's frame; NaN where it is off the map."""

    def one(lane: tuple[Template, Float[Array, "5"]]) -> Float[Array, ""]:
        score = score_poses(
            tile, lane[0], lane[1][None], height_reference_m, angular_frequency_rad_per_ns, jnp.float32(0.5)
        )
        r = score.correlation[0]
        return jnp.where(r > -1.5, r, jnp.nan)

    scores: Float[Array, " batch"] = jax.lax.map(one, (template, pose))
    return scores


def _register(
    key: Key[Array, ""],
    tile: Tile,
    template: Template,
    products: Float[Array, "trace along cross"],
    prior: Float[Array, "5"],
    half_width: Float[Array, "5"],
    finite: Bool[Array, ""],
    region: Region,
    height_reference_m: Float[Array, ""],
    angular_frequency_rad_per_ns: Float[Array, " half"],
    thresholds: Thresholds,
    spec: SearchSpec,
) -> Fix:
    surface: CoarseSurface = coarse_surface(
        tile,
        template,
        products,
        prior,
        half_width[:2],
        thresholds.overlap,
        lattice=spec.lattice,
        margin=spec.margin,
    )
    modes: Modes = find_modes(tile, surface, region.apart_m, modes=spec.modes)
    # About a mode the swarm explores what the coarse stage rounded off, no more: modes stay apart.
    reach = half_width.at[:2].set(jnp.minimum(1.5 * tile.cell_m, half_width[:2]))

    steps = jnp.concatenate([tile.cell_m, jnp.asarray([0.02, 0.01, 0.01], jnp.float32)])

    def score(pose: Float[Array, "particle 5"]) -> Score:
        return score_poses(tile, template, pose, height_reference_m, angular_frequency_rad_per_ns, thresholds.overlap)

    def refine(mode: Int[Array, ""]) -> tuple[Float[Array, "5"], Float[Array, ""]]:
        centre = jnp.concatenate([modes.place_m[mode], prior[2:]])
        first, second = jax.random.split(jax.random.fold_in(key, mode))
        start = jax.random.uniform(first, (spec.swarm.particles, 5), minval=-1.0, maxval=1.0)
        start = jnp.where(region.free[None, :], start, 0.0).at[0].set(0.0)
        # The summit of the posterior: heading and roll from the INS and the height of the array are known
        # beforehand, and one scan often tells less of them. Position has no such prior within its region.
        attitude = jnp.asarray([0.0, 0.0, *PRIOR[2:]], dtype=jnp.float32)
        worth = noise_scale(modes.strength[mode], modes.floor)

        def posterior(u: Float[Array, "particle 5"]) -> Float[Array, " particle"]:
            return score(centre[None] + u * reach[None]).strength - 0.5 * worth * jnp.sum(
                attitude[None] * u**2, axis=-1
            )

        found = run_swarm(second, start, posterior, region.free, config=spec.swarm)
        pose = centre + found.position * reach
        return pose, score(pose[None]).strength[0]

    poses, scores = jax.lax.map(refine, jnp.arange(spec.modes))
    scores = jnp.where(modes.strength > -1.0, scores, -1.0)
    # A rival at the map's rim may be scored by the coarse stage alone, which asks for fewer cells: it stays one.
    rivals = jnp.maximum(jnp.where(scores > -1.0, scores, modes.strength), -1.0)
    best = jnp.argmax(scores)
    pose, strength = poses[best], scores[best]
    runner_up = jnp.max(jnp.where(jnp.arange(spec.modes) == best, -1.0, rivals))
    peak = score(stencil_poses(pose, steps))
    covariance = peak_covariance(peak.correlation, steps, modes.floor, half_width)
    on_edge = jnp.any(jnp.abs(pose[:2] - prior[:2]) > half_width[:2] - tile.cell_m)
    best_overlap = jnp.max(surface.overlap)
    code = judge(strength, strength - runner_up, modes.floor, best_overlap, on_edge, finite, thresholds)
    found_any = finite & (strength > -1.0)
    covered = peak.covered[0]
    per_mode = spec.swarm.particles * (spec.swarm.iterations + 1)
    evaluations = spec.lattice[0] * spec.lattice[1] + spec.modes * per_mode + 31
    blank = jnp.float32(jnp.nan)
    return Fix(
        pose=jnp.where(found_any, pose, blank),
        covariance=jnp.where(found_any, covariance, blank),
        correlation=jnp.where(found_any, peak.correlation[0], blank),
        runner_up=jnp.where(found_any, runner_up, blank),
        margin=jnp.where(found_any, strength - runner_up, blank),
        overlap_channels=jnp.sum(covered & template.last_scan, dtype=jnp.int32),
        overlap=jnp.sum(covered, dtype=jnp.float32) / jnp.maximum(jnp.sum(template.valid, dtype=jnp.float32), 1.0),
        evaluations=jnp.int32(evaluations),
        code=code,
    )
