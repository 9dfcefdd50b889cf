"""Array columns: what the whole array would hear at every coarse place of a tile, ready for one matrix product.

Correlation is linear in the map. With the numbers that every antenna would see at a place stacked into one column, the
correlation of any scan with all places is one product of scans and columns: exhaustive, and without a gather. Columns
are made once a tile and heading. In depth they hold the map's leading components only, which is nearly all of its
power; the finish asks the whole coefficients.
"""

from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from lgprjax.subsurface import Tile


class ArrayColumns(NamedTuple):
    """Columns of one tile for one attitude of the array.

    Attributes:
        value: components of every channel at each place, one channel after the other; 0 off the map.
        power: of each place's ground, over the channels on the map.
        overlap: share of the channels on the map.
        origin_m: along and cross of place (0, 0).
        step_m: from place to place.
    """

    value: Float[Array, "along cross channel_component"]
    power: Float[Array, "along cross"]
    overlap: Float[Array, "along cross"]
    origin_m: Float[Array, "2"]
    step_m: Float[Array, "2"]


@partial(jax.jit, static_argnames=("stride", "margin"))
def make_columns(
    tile: Tile,
    components: Float[Array, "coefficient component"],
    offset_m: Float[Array, "channel 2"],
    *,
    stride: tuple[int, int],
    margin: tuple[int, int],
) -> ArrayColumns:
    """Columns of a tile.

    Each channel stands at the same offset from every place, so that its ground is the tile moved as a whole: four
    slices with the weights of a bilinear sample.

    Args:
        tile: the ground.
        components: orthonormal directions of the coefficients that hold the map's power.
        offset_m: along and cross of each channel from the array's centre, in the tile's frame.
        stride: cells from place to place, along and across.
        margin: cells that an antenna may stand outside the tile.
    """
    size = tile.valid.shape
    border = [(m, m + 1) for m in margin]
    ground = jnp.pad(jnp.moveaxis(tile.coefficients @ components, -1, 0), [(0, 0), *border])
    valid = jnp.pad(tile.valid.astype(jnp.float32), border)
    reach = jnp.asarray(margin, dtype=jnp.int32)
    cells = offset_m / tile.cell_m[None]
    low = jnp.clip(jnp.floor(cells).astype(jnp.int32), -reach[None], reach[None] - 1)
    part = cells - low.astype(jnp.float32)
    first = [s // 2 for s in stride]

    def channel(lane: tuple[Array, Array]) -> tuple[Array, Array]:
        base, (u, v) = lane[0] + reach, lane[1]

        def moved(planes: Float[Array, "plane _ _"]) -> Float[Array, "plane _ _"]:
            start = (0, base[0], base[1])
            window = jax.lax.dynamic_slice(planes, start, (len(planes), size[0] + 1, size[1] + 1))
            near, far = window[:, first[0] : -1 : stride[0]], window[:, first[0] + 1 :: stride[0]]
            along = (1.0 - u) * near + u * far
            left, right = along[:, :, first[1] : -1 : stride[1]], along[:, :, first[1] + 1 :: stride[1]]
            between: Float[Array, "plane _ _"] = (1.0 - v) * left + v * right
            return between

        # A place between cells is on the map where all of them are.
        on_map = (moved(valid[None]) > 1.0 - 1e-4).astype(jnp.float32)
        return moved(ground) * on_map, on_map[0]

    values, masks = jax.lax.map(channel, (low, part))
    # A place's numbers stand together, so that some places are read without the others.
    value = jnp.moveaxis(values.reshape(-1, *values.shape[2:]), 0, -1)
    return ArrayColumns(
        value=value,
        power=jnp.sum(value**2, axis=-1),
        overlap=jnp.mean(masks, axis=0),
        origin_m=tile.origin_m + jnp.asarray(first, dtype=jnp.float32) * tile.cell_m,
        step_m=tile.cell_m * jnp.asarray(stride, dtype=jnp.float32),
    )
