"""Looking at one match: the correlation surface about a prior, and the ground under a path."""

from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from lgprjax.registration.coarse import coarse_surface, trace_products
from lgprjax.registration.correlation import Template
from lgprjax.subsurface import Tile, sample_tile


class SurfacePicture(NamedTuple):
    """Strength of the match over the search lattice, in the tile's frame; NaN off the map or the region."""

    along_m: Float[np.ndarray, " along"]
    cross_m: Float[np.ndarray, " cross"]
    strength: Float[np.ndarray, "along cross"]


def survey_surface(
    tile: Tile,
    template: Template,
    prior: Float[Array, "5"],
    half_width_m: Float[Array, "2"],
    min_overlap: float | Float[Array, ""],
    *,
    lattice: tuple[int, int],
    margin: tuple[int, int],
) -> SurfacePicture:
    """The coarse surface of one template (batch of one), as ``register_batch`` sees it."""
    strength, first = _surface(tile, template, prior, half_width_m, min_overlap, lattice=lattice, margin=margin)
    along, cross = (
        np.asarray(tile.origin_m)[axis] + (int(first[axis]) + np.arange(lattice[axis])) * np.asarray(tile.cell_m)[axis]
        for axis in range(2)
    )
    values = np.asarray(strength, dtype=np.float64)
    return SurfacePicture(along, cross, np.where(values > -1.5, values, np.nan))


@partial(jax.jit, static_argnames=("lattice", "margin"))
def _surface(
    tile: Tile,
    template: Template,
    prior: Float[Array, "5"],
    half_width_m: Float[Array, "2"],
    min_overlap: float | Float[Array, ""],
    *,
    lattice: tuple[int, int],
    margin: tuple[int, int],
) -> tuple[Array, Array]:
    single = jax.tree.map(lambda field: field[0], template)
    surface = coarse_surface(
        tile,
        single,
        trace_products(tile, template)[0],
        prior,
        half_width_m,
        min_overlap,
        lattice=lattice,
        margin=margin,
    )
    return surface.strength, surface.first_cell


def ground_under(
    tile: Tile, position_m: Float[np.ndarray, "trace 2"]
) -> tuple[Float[np.ndarray, "trace coefficient"], Bool[np.ndarray, " trace"]]:
    """Map coefficients under places (along, cross in the tile's frame), and which of them are on the map."""
    value, covered = sample_tile(tile, jnp.asarray(position_m, dtype=jnp.float32))
    return np.asarray(value), np.asarray(covered)


def rival_of(surface: SurfacePicture, best_m: Float[np.ndarray, "2"], apart_m: float) -> Float[np.ndarray, "2"] | None:
    """Highest summit of a surface at least ``apart_m`` from a place (along, cross); None where there is none."""
    strength = np.where(np.isfinite(surface.strength), surface.strength, -np.inf)
    rows, columns = strength.shape
    framed = np.pad(strength, 1, constant_values=-np.inf)
    around = np.max([framed[i : i + rows, j : j + columns] for i in range(3) for j in range(3)], axis=0)
    away = np.hypot(surface.along_m[:, None] - best_m[0], surface.cross_m[None, :] - best_m[1]) >= apart_m
    left = np.where(away & (strength >= around), strength, -np.inf)
    i, j = np.unravel_index(int(np.argmax(left)), left.shape)
    return np.array([surface.along_m[i], surface.cross_m[j]]) if np.isfinite(left[i, j]) else None
