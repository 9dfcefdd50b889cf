"""Registration of any templates against one tile: every cell of the region scored, the best place finished.

The plain form of the search: it asks nothing of the templates (any traces anywhere) and needs no template bank. Drives
are registered by ``Registration``, whose coarse stage is the same product at a twentieth of the cost.
"""

from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from lgprjax.radar import ArrayGeometry, air_delay_ns, shift_travel_time
from lgprjax.registration.chance import POOLED, Chance
from lgprjax.registration.coarse import Modes, coarse_surface, find_modes, trace_products
from lgprjax.registration.correlation import OFF_MAP_SCORE, Template
from lgprjax.registration.finish import Region, finish_best
from lgprjax.registration.fix import Fix
from lgprjax.registration.integrity import MIN_OVERLAP, Thresholds, judge, thresholds_at
from lgprjax.registration.options import RegisterOptions
from lgprjax.subsurface import GroundMap, Tile


@dataclass(frozen=True)
class SearchSpec:
    """Static shape of a search: one compile each.

    Attributes:
        lattice: points of the coarse stage along and cross.
        margin: cells that an antenna may stand outside the tile.
    """

    lattice: tuple[int, int]
    margin: tuple[int, int]


def search_spec_for(
    ground: GroundMap, tile: int, array: ArrayGeometry, *, search_m: float, window_m: float
) -> SearchSpec:
    """Shape of the search on a tile: the whole region as far as the grid goes."""
    spec, _ = ground.grid_of(tile)
    array_reach_m = float(np.hypot(np.ptp(array.x_m), np.ptp(array.y_m))) + 0.5
    cells_m = (spec.along_cell_m, spec.cross_cell_m)
    sizes = (spec.along_cells, spec.cross_cells)
    lattice = [min(2 * int(search_m / c) + 3, n) for c, n in zip(cells_m, sizes, strict=True)]
    margin = [int(np.ceil((window_m + array_reach_m) / c)) + 1 for c in cells_m]
    return SearchSpec(lattice=(lattice[0], lattice[1]), margin=(margin[0], margin[1]))


class Problem(NamedTuple):
    """A batch of templates with their priors.

    Attributes:
        template: batched.
        prior: along_m, cross_m, height_m above ground, yaw_rad, roll_rad in the tile's frame.
        half_width: of the search region about the prior, in the same order.
        finite: enough finite traces to try.
    """

    template: Template
    prior: Float[Array, "batch 5"]
    half_width: Float[Array, "batch 5"]
    finite: Bool[Array, " batch"]


class Rules(NamedTuple):
    """What holds for a whole batch.

    Attributes:
        apart_m: two places nearer than this are one.
        thresholds: to reach.
    """

    apart_m: Float[Array, ""]
    thresholds: Thresholds


def rules_of(wavelength_m: float, options: RegisterOptions, window_m: float, chance: Chance = POOLED) -> Rules:
    """Rules for templates of a length, each matched once in a region as large as the options have it."""
    own = options.own_thresholds
    if own is None:
        own = thresholds_at(options.risk, window_m, (2.0 * options.search_half_m()) ** 2, wavelength_m, chance)
    return Rules(jnp.float32(0.6 * wavelength_m), Thresholds(*(jnp.float32(value) for value in own)))


@partial(jax.jit, static_argnames="spec")
def register_batch(
    tile: Tile,
    problem: Problem,
    rules: Rules,
    height_reference_m: Float[Array, ""],
    angular_frequency_rad_per_ns: Float[Array, " half"],
    *,
    spec: SearchSpec,
) -> Fix:
    """Fixes of a batch, poses in the tile's frame.

    The templates share one matrix product and their surfaces are then made one by one: a vmap over them would turn
    every slice into a gather (measured twenty times slower than this loop), and none can touch another.
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

    def one(each: tuple[Template, Array, Array, Array]) -> tuple[Modes, Array]:
        single, own, prior, half_width = each
        surface = coarse_surface(
            tile,
            single,
            own,
            prior,
            half_width[:2],
            jnp.float32(MIN_OVERLAP),
            lattice=spec.lattice,
            margin=spec.margin,
        )
        return find_modes(tile, surface, rules.apart_m, modes=2), jnp.max(surface.overlap)

    modes, overlap = jax.lax.map(one, (template, products, problem.prior, problem.half_width))
    # Pitch is not searched; its width divides.
    level = [(0, 0), (0, 1)]
    start = jnp.concatenate([modes.place_m[:, 0], problem.prior[:, 2:], jnp.zeros_like(problem.prior[:, :1])], axis=1)
    region = Region(
        jnp.pad(problem.prior, level),
        jnp.pad(problem.half_width, level, constant_values=1.0),
        jnp.zeros(len(start), jnp.uint32),
    )
    found = finish_best(
        tile,
        height_reference_m,
        angular_frequency_rad_per_ns,
        template,
        start,
        region,
        modes.floor,
        jnp.float32(MIN_OVERLAP),
        heading=template.valid.shape[1] > 1,
        pitch=False,
    )
    any_found = problem.finite & (modes.strength[:, 0] > OFF_MAP_SCORE) & jnp.isfinite(found.correlation)
    away = jnp.abs(found.pose[:, :2] - problem.prior[:, :2])
    on_edge = jnp.any(away > problem.half_width[:, :2] - tile.cell_m[None], axis=1) | found.unfinished
    # Both where the lattice has them: a best place that was climbed and a rival that was not are no fair pair.
    score = jnp.where(any_found, modes.strength[:, 0], -1.0)
    rival = jnp.maximum(modes.strength[:, 1], -1.0)
    code = judge(score, rival, modes.floor, overlap, on_edge, problem.finite, rules.thresholds)
    nothing = jnp.where(any_found, 0.0, jnp.nan)
    return Fix(
        pose=found.pose + nothing[:, None],
        covariance=found.covariance * rules.thresholds.sigma_scale**2 + nothing[:, None, None],
        correlation=found.correlation + nothing,
        runner_up=rival + nothing,
        margin=score - rival + nothing,
        scatter=modes.floor + nothing,
        overlap_channels=found.overlap_channels,
        overlap=found.overlap,
        code=code,
        p_false=jnp.where(code == 0, 0.0, 1.0),
        window_m=nothing,
    )
