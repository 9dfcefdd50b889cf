"""A tile: the ground of a map stretch on a regular grid, and its sampling at any place."""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float


class Tile(NamedTuple):
    """Map coefficients on a regular grid in the frame of the tile.

    The frame's x axis (along) follows the route, its y axis (cross) points left. Cell (0, 0) lies at
    ``origin_m``. What no baseline came near is masked; masked cells hold zeros.

    Attributes:
        coefficients: of the ground at each cell, at the tile's height reference.
        power: sum of squares of the coefficients of each cell.
        valid: cells that a baseline covers.
        origin_m: along and cross of cell (0, 0).
        cell_m: spacing along and cross.
    """

    coefficients: Float[Array, "along cross coefficient"]
    power: Float[Array, "along cross"]
    valid: Bool[Array, "along cross"]
    origin_m: Float[Array, "2"]
    cell_m: Float[Array, "2"]


def sample_tile(
    tile: Tile, position_m: Float[Array, "*batch 2"]
) -> tuple[Float[Array, "*batch coefficient"], Bool[Array, "*batch"]]:
    """Bilinear sample of the tile; valid only where all four cells are.

    A gather out of range would clamp silently and score on the tile's rim again and again: the mask is what
    says that there is no ground.

    Args:
        position_m: along and cross in the tile's frame.
    """
    plane = (1,) * (position_m.ndim - 1) + (2,)
    cells = (position_m - tile.origin_m.reshape(plane)) / tile.cell_m.reshape(plane)
    low = jnp.floor(cells)
    part = cells - low
    size = jnp.asarray(tile.valid.shape, dtype=jnp.int32).reshape(plane)
    base = low.astype(jnp.int32)
    inside = jnp.all((base >= 0) & (base + 1 < size), axis=-1)
    base = jnp.clip(base, 0, size - 2)
    width = tile.valid.shape[1]
    flat = base[..., 0] * width + base[..., 1]
    rows = tile.coefficients.reshape(-1, tile.coefficients.shape[-1])
    mask = tile.valid.reshape(-1)
    along, cross = part[..., 0], part[..., 1]
    corners = (
        (flat, (1 - along) * (1 - cross)),
        (flat + 1, (1 - along) * cross),
        (flat + width, along * (1 - cross)),
        (flat + width + 1, along * cross),
    )
    value = sum((rows[index] * weight[..., None] for index, weight in corners), start=jnp.float32(0.0))
    covered = inside
    for index, _ in corners:
        covered = covered & mask[index]
    return jnp.where(covered[..., None], value, 0.0), covered
