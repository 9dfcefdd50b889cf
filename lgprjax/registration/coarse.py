"""The coarse stage: every place of the search region on the grid's own cells, at the prior's attitude.

Correlation is linear in the map, so one matrix product of traces with cells holds every product that any
place needs; with the antennas rounded to whole cells a place's score is a sum of slices, one a trace, and no
gather. Exhaustive, it leaves no doubt where the best place and its rivals are: the swarm refines
them, and their difference is the margin on which integrity rests.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from lgprjax.registration.correlation import OFF_MAP_SCORE, Template, normalise, strength_of
from lgprjax.subsurface import Tile


class CoarseSurface(NamedTuple):
    """Correlation over the region's lattice, whose points are cells of the tile.

    Attributes:
        strength: at each point, see ``Score``; ``OFF_MAP_SCORE`` where overlap is missing.
        overlap: share of the template on the map.
        first_cell: the tile's cell of lattice point (0, 0).
    """

    strength: Float[Array, "along cross"]
    overlap: Float[Array, "along cross"]
    first_cell: Int[Array, "2"]


def trace_products(tile: Tile, templates: Template) -> Float[Array, "batch trace along cross"]:
    """Products of every trace of a batch of templates with every cell: one matrix product."""
    batch, traces, coefficients = templates.coefficients.shape
    product = templates.coefficients.reshape(-1, coefficients) @ tile.coefficients.reshape(-1, coefficients).T
    return product.reshape(batch, traces, *tile.valid.shape)


def coarse_surface(
    tile: Tile,
    template: Template,
    products: Float[Array, "trace along cross"],
    prior: Float[Array, "5"],
    half_width_m: Float[Array, "2"],
    min_overlap: float | Float[Array, ""],
    *,
    lattice: tuple[int, int],
    margin: tuple[int, int],
) -> CoarseSurface:
    """Correlation at every lattice point, heading and height as the prior has them.

    Args:
        tile, template: as for ``score_poses``.
        products: of this template, from ``trace_products``.
        prior: along_m, cross_m, height_m, yaw_rad, roll_rad; the lattice is centred there as far as the
            tile reaches.
        half_width_m: of the region along and cross; lattice points beyond it do not count.
        min_overlap: see ``score_poses``.
        lattice: points along and cross; at most the tile's cells.
        margin: cells that an antenna may stand outside the tile; farther ones count as off the map.
    """
    cells = jnp.asarray(tile.valid.shape, dtype=jnp.int32)
    size = jnp.asarray(lattice, dtype=jnp.int32)
    reach = jnp.asarray(margin, dtype=jnp.int32)
    centre = jnp.round((prior[:2] - tile.origin_m) / tile.cell_m).astype(jnp.int32)
    first = jnp.clip(centre - size // 2, 0, cells - size)
    cos, sin = jnp.cos(prior[3]), jnp.sin(prior[3])
    forward, left = template.offset_m[:, 0], template.offset_m[:, 1]
    offset_m = jnp.stack([cos * forward - sin * left, sin * forward + cos * left], axis=-1)
    offset = jnp.round(offset_m / tile.cell_m[None]).astype(jnp.int32)
    reached = template.valid & jnp.all(jnp.abs(offset) <= reach[None], axis=-1)
    start = (first + reach)[None] + jnp.clip(offset, -reach[None], reach[None])
    live_power = jnp.sum(template.coefficients**2, axis=-1)
    border = [(m, m) for m in margin]
    power = jnp.pad(tile.power, border)
    mask = jnp.pad(tile.valid.astype(jnp.float32), border)
    padded = jnp.pad(products, [(0, 0), *border])

    def add(trace: Int[Array, ""], total: Float[Array, "sum along cross"]) -> Float[Array, "sum along cross"]:
        use = reached[trace].astype(jnp.float32)

        def cut(plane: Array) -> Array:
            return jax.lax.dynamic_slice(plane, (start[trace, 0], start[trace, 1]), lattice)

        there = cut(mask)
        return total + use * jnp.stack(
            [
                jax.lax.dynamic_slice(padded, (trace, start[trace, 0], start[trace, 1]), (1, *lattice))[0],
                live_power[trace] * there,
                cut(power),
                there,
            ]
        )

    traces = template.valid.shape[0]
    total = jax.lax.fori_loop(0, traces, add, jnp.zeros((4, *lattice), jnp.float32))
    at_m = [
        (first[axis] + jnp.arange(lattice[axis])).astype(jnp.float32) * tile.cell_m[axis]
        + tile.origin_m[axis]
        - prior[axis]
        for axis in range(2)
    ]
    inside = (jnp.abs(at_m[0]) <= half_width_m[0])[:, None] & (jnp.abs(at_m[1]) <= half_width_m[1])[None, :]
    overlap = jnp.where(inside, total[3] / jnp.maximum(jnp.sum(template.valid, dtype=jnp.float32), 1.0), 0.0)
    correlation = normalise(total[0], total[1], total[2], overlap, min_overlap)
    return CoarseSurface(strength_of(correlation, overlap), overlap, first)


class Modes(NamedTuple):
    """The best lattice points that lie apart from each other.

    Attributes:
        place_m: along and cross.
        strength: there; ``OFF_MAP_SCORE`` where there was none left.
        floor: standard deviation of the strength away from the best: what ground that does not match
            gives by chance.
    """

    place_m: Float[Array, "mode 2"]
    strength: Float[Array, " mode"]
    floor: Float[Array, ""]


def find_modes(tile: Tile, surface: CoarseSurface, apart_m: Float[Array, ""], *, modes: int) -> Modes:
    """Best summits by repeated maximum, each at least ``apart_m`` from those before it.

    Summits only: the flank of the best one, just beyond ``apart_m``, is no rival.
    """
    shape = surface.strength.shape
    along = (surface.first_cell[0] + jnp.arange(shape[0])).astype(jnp.float32) * tile.cell_m[0] + tile.origin_m[0]
    cross = (surface.first_cell[1] + jnp.arange(shape[1])).astype(jnp.float32) * tile.cell_m[1] + tile.origin_m[1]
    around = jax.lax.reduce_window(surface.strength, -jnp.inf, jax.lax.max, (3, 3), (1, 1), "SAME")
    left = jnp.where(surface.strength >= around, surface.strength, OFF_MAP_SCORE)
    places, scores = [], []
    away = jnp.ones(shape, bool)
    for mode in range(modes):
        best = jnp.argmax(left)
        i, j = best // shape[1], best % shape[1]
        places.append(jnp.stack([along[i], cross[j]]))
        scores.append(left[i, j])
        near = ((along - along[i]) ** 2)[:, None] + ((cross - cross[j]) ** 2)[None, :] < apart_m**2
        left = jnp.where(near, OFF_MAP_SCORE, left)
        if mode == 0:
            away = ~near & (surface.strength > OFF_MAP_SCORE)
    count = jnp.maximum(jnp.sum(away, dtype=jnp.float32), 1.0)
    mean = jnp.sum(jnp.where(away, surface.strength, 0.0)) / count
    spread = jnp.sum(jnp.where(away, (surface.strength - mean) ** 2, 0.0)) / count
    # A handful of places away from the best tells nothing of chance: then as little is believed as can be.
    enough = jnp.sum(away) >= 16
    return Modes(jnp.stack(places), jnp.stack(scores), jnp.where(enough, jnp.sqrt(spread), 0.5))
