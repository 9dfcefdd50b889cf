"""Array columns against the tile sampled at every place."""

import jax.numpy as jnp
import numpy as np

from lgprjax.registration import make_columns
from lgprjax.subsurface import sample_tile
from registration.synthetic_tile import CELL_M, CELLS, HALF, ORIGIN_M, make_tile, random_ground

STRIDE = (3, 2)
LEFT_M = (2.5 - np.arange(6)) * 0.127


def test_columns_hold_what_the_turned_array_hears() -> None:
    valid = np.random.default_rng(2).uniform(size=CELLS) > 0.03
    tile = make_tile(random_ground(4), valid)
    components = np.linalg.qr(np.random.default_rng(3).normal(size=(2 * HALF, 5)))[0].astype(np.float32)
    angle = np.radians(20.0)
    offset = np.stack([-np.sin(angle) * LEFT_M, np.cos(angle) * LEFT_M], axis=-1).astype(np.float32)
    columns = make_columns(tile, jnp.asarray(components), jnp.asarray(offset), stride=STRIDE, margin=(4, 6))
    along = ORIGIN_M[0] + CELL_M[0] * np.arange(STRIDE[0] // 2, CELLS[0], STRIDE[0])
    cross = ORIGIN_M[1] + CELL_M[1] * np.arange(STRIDE[1] // 2, CELLS[1], STRIDE[1])
    np.testing.assert_allclose(columns.origin_m, [along[0], cross[0]], atol=1e-6)
    np.testing.assert_allclose(columns.step_m, CELL_M * STRIDE, atol=1e-6)
    place = np.stack(np.meshgrid(along, cross, indexing="ij"), axis=-1)
    position = (place[:, :, None] + offset).astype(np.float32)
    ground, on_map = sample_tile(tile, jnp.asarray(position))
    heard = np.where(np.asarray(on_map)[..., None], np.asarray(ground, np.float64) @ components, 0.0)
    value = np.moveaxis(np.asarray(columns.value), -1, 0).reshape(6, 5, len(along), len(cross))
    np.testing.assert_allclose(value, np.moveaxis(heard, (2, 3), (0, 1)), atol=2e-5)
    np.testing.assert_allclose(columns.power, np.sum(heard**2, axis=(2, 3)), rtol=1e-4, atol=1e-4)
    share = np.mean(on_map, axis=2)
    np.testing.assert_allclose(columns.overlap, share, atol=1e-6)
    assert (share == 1.0).any()
    assert (share == 0.0).any()
