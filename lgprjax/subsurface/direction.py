"""A tile as a live scan's track filter would leave it.

Live scans lose a running mean over what lies behind them, maps one over both sides. The first moves ground of
wavelength w forward by about w²/(2 pi² length), so that matches of one with the other lie centimetres ahead. With the
live filter over the tile too, in the direction of travel, both are moved alike.
"""

from functools import partial

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from lgprjax.subsurface.tile import Tile


@partial(jax.jit, static_argnames="direction")
def filter_along(tile: Tile, length_m: Float[Array, ""], *, direction: int) -> Tile:
    """The tile less the causal running mean along its axis.

    Args:
        tile: of a map, filtered to both sides.
        length_m: of the live filter.
        direction: 1 for travel along the tile's axis, -1 against it.
    """
    # The live filter's mean forgets over half its length (radar.run_live_filter).
    forget = 1.0 - jnp.exp(-tile.cell_m[0] / (0.5 * length_m))

    def step(mean: Array, row: tuple[Array, Array]) -> tuple[Array, Array]:
        value, valid = row
        mean = mean + jnp.where(valid[:, None], forget * (value - mean), 0.0)
        return mean, jnp.where(valid[:, None], value - mean, 0.0)

    # What lies before the tile is not known; the map's own filter has left its mean near zero.
    start = jnp.zeros(tile.coefficients.shape[1:], jnp.float32)
    _, value = jax.lax.scan(step, start, (tile.coefficients, tile.valid), reverse=direction < 0)
    return tile._replace(coefficients=value, power=jnp.sum(value**2, axis=-1))
