"""The search of a template, or of a few, on the places near their prior: a rung of the ladder as shapes."""

from dataclasses import dataclass, replace
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from lgprjax.registration.batches import WindowLayout
from lgprjax.registration.columns import ArrayColumns
from lgprjax.registration.drive import rules_for
from lgprjax.registration.finish import Rules
from lgprjax.registration.fix import Fix
from lgprjax.registration.match import Ends, MatchSpec, ScanSet, match_scans
from lgprjax.registration.options import RegisterOptions
from lgprjax.registration.policy import Rung
from lgprjax.registration.prepared import PreparedGround
from lgprjax.subsurface import Tile

_RIM_M = 2.0
"""Places about the search square that a rung scores too: what the strength scatters by is told from them."""


@dataclass(frozen=True)
class Search:
    """A rung as the search of a drive takes it.

    Attributes:
        options: with the rung's region and thresholds.
        rules: of the drive, with these thresholds.
        layout: as many templates at a time as are searched together, with the rung's counts.
        places: along and across that the coarse stage scores, no more than a tile has.
    """

    options: RegisterOptions
    rules: Rules
    layout: WindowLayout
    places: tuple[int, int]


@partial(jax.jit, static_argnames=("places", "spec"))
def match_near(
    columns: ArrayColumns,
    components: Float[Array, "coefficient component"],
    tile: Tile,
    scans: ScanSet,
    ends: Ends,
    rules: Rules,
    height_reference_m: Float[Array, ""],
    angular_frequency_rad_per_ns: Float[Array, " half"],
    *,
    places: tuple[int, int],
    spec: MatchSpec,
) -> Fix:
    """``match_scans`` of templates close to each other on the places nearest to the first one's prior."""
    near = cut_columns(columns, ends.prior[0, :2], places=places)
    fix: Fix = match_scans(
        near, components, tile, scans, ends, rules, height_reference_m, angular_frequency_rad_per_ns, spec=spec
    )
    return fix


def cut_columns(columns: ArrayColumns, centre_m: Float[Array, "2"], *, places: tuple[int, int]) -> ArrayColumns:
    """Columns of so many places along and across about a point, moved inward at the tile's rim.

    A tile with fewer places than asked for is taken whole.
    """
    size = tuple(min(wanted, held) for wanted, held in zip(places, columns.power.shape, strict=True))
    middle = jnp.round((centre_m - columns.origin_m) / columns.step_m).astype(jnp.int32)
    most = jnp.asarray([held - kept for held, kept in zip(columns.power.shape, size, strict=True)], dtype=jnp.int32)
    first = jnp.clip(middle - jnp.asarray(size, dtype=jnp.int32) // 2, 0, most)
    return ArrayColumns(
        value=jax.lax.dynamic_slice(columns.value, (0, first[0], first[1]), (len(columns.value), *size)),
        power=jax.lax.dynamic_slice(columns.power, (first[0], first[1]), size),
        overlap=jax.lax.dynamic_slice(columns.overlap, (first[0], first[1]), size),
        origin_m=columns.origin_m + first.astype(jnp.float32) * columns.step_m,
        step_m=columns.step_m,
    )


def search_of(rung: Rung, prepared: PreparedGround, options: RegisterOptions, ends: int = 1) -> Search:
    """Shapes of a rung for a map, an array and a window; ``ends`` templates are searched together."""
    swarm = options.swarm
    if swarm is not None:
        swarm = replace(swarm, particles=rung.particles, iterations=rung.iterations)
    whole = WindowLayout.of(prepared, options)
    spec = replace(whole.spec, heights=rung.heights, summits=rung.summits, swarm=swarm)
    members = 1
    if options.window_m > 0.0:
        members = 2 + int(options.window_m / whole.coarse_m) + int(options.window_m / whole.fine_m)
    layout = replace(whole, ends=ends, scans=1 << (members + ends - 2).bit_length(), spec=spec)
    # The scans of a window stand behind its last one, and their places must be among those that are scored.
    half_m = rung.half_m + _RIM_M + options.window_m
    along, cross = (2 * int(np.ceil(half_m / step_m)) + 1 for step_m in prepared.step_m)
    asked = options.thresholds
    thresholds = asked._replace(strength=float(asked.strength) + rung.more_strength)
    own = replace(options, search_m=rung.half_m, own_thresholds=thresholds, swarm=swarm)
    return Search(own, rules_for(prepared, own), layout, (along, cross))
