"""Registration of any templates against one tile: every cell of the region scored, the best places finished.

The plain form of the search: it asks nothing of the templates (any traces anywhere) and needs no columns. Drives are
registered by ``match_scans``, whose coarse stage is the same product at a twentieth of the cost."""

from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, UInt32

from lgprjax.radar import ArrayGeometry, air_delay_ns, shift_travel_time
from lgprjax.registration.coarse import coarse_surface, find_modes, trace_products
from lgprjax.registration.correlation import Template
from lgprjax.registration.finish import Region, Rules, finish
from lgprjax.registration.fix import Fix
from lgprjax.registration.options import RegisterOptions
from lgprjax.registration.places import Summits
from lgprjax.subsurface import GroundMap, Tile


@dataclass(frozen=True)
class SearchSpec:
    """Static shape of a search: one compile each.

    Attributes:
        lattice: points of the coarse stage along and cross.
        margin: cells that an antenna may stand outside the tile.
        modes: places that are finished; the best two make the margin.
    """

    lattice: tuple[int, int]
    margin: tuple[int, int]
    modes: int = 2


def search_spec_for(ground: GroundMap, tile: int, array: ArrayGeometry, options: RegisterOptions) -> SearchSpec:
    """Shape of the search on a tile: the whole region as far as the grid goes."""
    spec, _ = ground.grid_of(tile)
    array_reach_m = float(np.hypot(np.ptp(array.x_m), np.ptp(array.y_m))) + 0.5
    cells_m = (spec.along_cell_m, spec.cross_cell_m)
    sizes = (spec.along_cells, spec.cross_cells)
    lattice = [min(2 * int(options.search_m / c) + 3, n) for c, n in zip(cells_m, sizes, strict=True)]
    margin = [int(np.ceil((options.window_m + array_reach_m) / c)) + 1 for c in cells_m]
    return SearchSpec(lattice=(lattice[0], lattice[1]), margin=(margin[0], margin[1]))


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
    tile: Tile,
    problem: Problem,
    rules: Rules,
    height_reference_m: Float[Array, ""],
    angular_frequency_rad_per_ns: Float[Array, " half"],
    *,
    spec: SearchSpec,
) -> Fix:
    """Fixes of a batch, poses in the tile's frame.

    Lanes share one matrix product and their surfaces are then made one by one: a vmap over them would turn every
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

    def one(lane: tuple[Template, Array, Array, Array]) -> Summits:
        single, lane_products, prior, half_width = lane
        surface = coarse_surface(
            tile,
            single,
            lane_products,
            prior,
            half_width[:2],
            rules.thresholds.overlap,
            lattice=spec.lattice,
            margin=spec.margin,
        )
        modes = find_modes(tile, surface, rules.apart_m, modes=spec.modes)
        none = jnp.zeros(spec.modes, jnp.int32)
        return Summits(modes.place_m, none, modes.strength, modes.floor, jnp.max(surface.overlap))

    found: Summits = jax.lax.map(one, (template, products, problem.prior, problem.half_width))
    level = [(0, 0), (0, 1)]
    return finish(
        tile,
        height_reference_m,
        angular_frequency_rad_per_ns,
        template,
        problem.finite,
        found,
        jnp.zeros(1, jnp.float32),
        # Pitch is not searched; its width divides.
        Region(jnp.pad(problem.prior, level), jnp.pad(problem.half_width, level, constant_values=1.0), problem.number),
        rules,
        spec.lattice[0] * spec.lattice[1],
    )
