"""The cut of columns and a rung's shapes."""

import jax.numpy as jnp
import numpy as np
import pytest

from lgprjax.registration.columns import ArrayColumns
from lgprjax.registration.near import cut_columns

ALONG, CROSS = 40, 21
STEP_M = np.array([0.1, 0.2], np.float32)
ORIGIN_M = np.array([-2.0, -2.0], np.float32)


@pytest.fixture(scope="module")
def columns() -> ArrayColumns:
    rng = np.random.default_rng(5)
    return ArrayColumns(
        jnp.asarray(rng.standard_normal((6, ALONG, CROSS)), dtype=jnp.float32),
        jnp.asarray(rng.random((ALONG, CROSS)), dtype=jnp.float32),
        jnp.asarray(rng.random((ALONG, CROSS)), dtype=jnp.float32),
        jnp.asarray(ORIGIN_M),
        jnp.asarray(STEP_M),
    )


@pytest.mark.parametrize("centre_m", [(0.0, 0.0), (0.33, -0.5), (-2.0, 1.9), (9.0, -9.0)])
def test_cut_holds_the_nearest_places(columns: ArrayColumns, centre_m: tuple[float, float]) -> None:
    """Every place about the centre that the tile has, at the coordinates it had."""
    centre = np.array(centre_m)
    cut = cut_columns(columns, jnp.asarray(centre, dtype=jnp.float32), places=(11, 7))
    assert cut.power.shape == (11, 7)
    first = np.round((np.asarray(cut.origin_m) - ORIGIN_M) / STEP_M).astype(int)
    i, j = slice(first[0], first[0] + 11), slice(first[1], first[1] + 7)
    np.testing.assert_array_equal(cut.value, np.asarray(columns.value)[:, i, j])
    np.testing.assert_array_equal(cut.power, np.asarray(columns.power)[i, j])
    np.testing.assert_array_equal(cut.overlap, np.asarray(columns.overlap)[i, j])
    for axis, (kept, size) in enumerate(((11, ALONG), (7, CROSS))):
        place = ORIGIN_M[axis] + STEP_M[axis] * np.arange(size)
        near = np.abs(place - centre[axis]) <= (kept // 2 - 0.5) * STEP_M[axis]
        held = (np.arange(size) >= first[axis]) & (np.arange(size) < first[axis] + kept)
        assert held.sum() == kept
        assert np.all(held[near])


def test_small_tile_is_taken_whole(columns: ArrayColumns) -> None:
    cut = cut_columns(columns, jnp.asarray([1.0, 1.0], dtype=jnp.float32), places=(99, 99))
    for whole, part in zip(columns, cut, strict=True):
        np.testing.assert_array_equal(whole, part)
