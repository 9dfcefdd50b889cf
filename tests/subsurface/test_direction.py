"""A tile filtered as a live scan's track filter would leave it."""

import jax.numpy as jnp
import numpy as np
import pytest

from lgprjax.radar import init_live_filter, run_live_filter
from lgprjax.subsurface import Tile
from lgprjax.subsurface.grid import filter_along

CELL_M, LENGTH_M, CELLS = 0.05, 2.0, 400


def tile_of(value: np.ndarray, valid: np.ndarray | None = None) -> Tile:
    held = np.ones(value.shape[:2], bool) if valid is None else valid
    return Tile(
        coefficients=jnp.asarray(value, dtype=jnp.float32),
        power=jnp.asarray(np.sum(value**2, axis=-1), dtype=jnp.float32),
        valid=jnp.asarray(held),
        origin_m=jnp.zeros(2, jnp.float32),
        cell_m=jnp.asarray([CELL_M, 0.06], dtype=jnp.float32),
    )


def filtered(value: np.ndarray, direction: int, valid: np.ndarray | None = None) -> np.ndarray:
    return np.asarray(filter_along(tile_of(value, valid), jnp.float32(LENGTH_M), direction=direction).coefficients)


@pytest.mark.parametrize("direction", [1, -1])
def test_it_is_the_live_filter_in_the_direction_of_travel(direction: int) -> None:
    """Against the filter of live scans, fed cell by cell the same way, past its start."""
    rng = np.random.default_rng(0)
    value = rng.normal(size=(CELLS, 1, 4))
    live = value[::direction].transpose(0, 1, 2)
    _, expected = run_live_filter(
        init_live_filter(1, 4),
        jnp.asarray(live, dtype=jnp.float32),
        jnp.ones((CELLS, 1), bool),
        jnp.full(CELLS, CELL_M, jnp.float32),
        jnp.float32(LENGTH_M),
    )
    found = filtered(value, direction)[::direction]
    settled = int(5 * LENGTH_M / CELL_M)
    np.testing.assert_allclose(found[settled:], np.asarray(expected)[settled:], atol=0.01)


def test_holes_keep_the_mean_and_stay_empty() -> None:
    value = np.ones((CELLS, 2, 3))
    valid = np.ones((CELLS, 2), bool)
    valid[200:240, 0] = False
    found = filtered(np.where(valid[..., None], value, 0.0), 1, valid)
    assert np.all(found[200:240, 0] == 0.0)
    # A constant has been taken out before the hole, and is still after it.
    assert np.abs(found[199, 0]).max() < 1e-3
    assert np.abs(found[240, 0]).max() < 1e-3
