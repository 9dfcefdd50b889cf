"""Long windows of an antenna whose heading is not known as well as they are long."""

import jax.numpy as jnp
import numpy as np
import pytest

from lgprjax.registration import Finished, Region, Template, finish_best
from lgprjax.registration.refine import trial_headings
from lgprjax.subsurface import Tile
from registration.synthetic_tile import CELL_M, OMEGA, REFERENCE_M, random_ground, stacked

WINDOWS = 12
BACK_M = np.arange(54) * -0.15
OFFSET_M = np.stack([BACK_M, np.zeros(len(BACK_M))], axis=-1)
CELLS, ORIGIN_M = (200, 40), np.array([-9.0, -1.2])
PRIOR = np.array([0.0, 0.0, REFERENCE_M, 0.0, 0.0, 0.0])
HALF_WIDTH = np.array([0.5, 0.5, 0.03, np.radians(6.0), 0.02, 0.02])


@pytest.fixture(scope="module")
def case() -> tuple[Tile, Template, np.ndarray]:
    """Windows of 8 m over one ground, turned by up to 5 degrees about the middle of the prior's."""
    ground, rng = random_ground(11), np.random.default_rng(12)
    along, cross = (ORIGIN_M[axis] + np.arange(CELLS[axis]) * CELL_M[axis] for axis in range(2))
    value = stacked(ground(np.stack(np.meshgrid(along, cross, indexing="ij"), axis=-1)))
    tile = Tile(
        coefficients=jnp.asarray(value, dtype=jnp.float32),
        power=jnp.asarray(np.sum(value**2, axis=-1), dtype=jnp.float32),
        valid=jnp.ones(CELLS, bool),
        origin_m=jnp.asarray(ORIGIN_M, dtype=jnp.float32),
        cell_m=jnp.asarray(CELL_M, dtype=jnp.float32),
    )
    yaw = np.radians(np.linspace(-5.0, 5.0, WINDOWS))
    middle = OFFSET_M.mean(axis=0)[0]
    truth = np.stack([middle * (1.0 - np.cos(yaw)), -middle * np.sin(yaw), yaw], axis=-1)
    place = truth[:, None, :2] + BACK_M[None, :, None] * np.stack([np.cos(yaw), np.sin(yaw)], axis=-1)[:, None]
    heard = stacked(ground(place))
    heard += np.sqrt(0.5) * rng.normal(size=heard.shape)
    several = (WINDOWS, len(BACK_M))
    scan = np.broadcast_to(np.arange(len(BACK_M), dtype=np.int32), several)
    template = Template(
        jnp.asarray(heard, dtype=jnp.float32),
        jnp.asarray(np.broadcast_to(OFFSET_M, (*several, 2)), dtype=jnp.float32),
        jnp.ones(several, bool),
        jnp.asarray(scan),
    )
    return tile, template, truth


def finish(tile: Tile, template: Template, headings: int) -> Finished:
    rows = [np.tile(row, (WINDOWS, 1)) for row in (PRIOR, HALF_WIDTH)]
    prior, half_width = (jnp.asarray(row, dtype=jnp.float32) for row in rows)
    found: Finished = finish_best(
        tile,
        jnp.float32(REFERENCE_M),
        jnp.asarray(OMEGA, dtype=jnp.float32),
        template,
        prior,
        Region(prior, half_width, jnp.arange(WINDOWS, dtype=jnp.uint32)),
        jnp.full(WINDOWS, 0.05, jnp.float32),
        jnp.float32(0.5),
        heading=True,
        pitch=False,
        headings=np.int32(headings),
    )
    return found


def off_m(found: Finished, truth: np.ndarray) -> np.ndarray:
    return np.asarray(np.hypot(*(np.asarray(found.pose)[:, :2] - truth[:, :2]).T))


def test_a_long_window_is_turned_before_it_climbs(case: tuple[Tile, Template, np.ndarray]) -> None:
    tile, template, truth = case
    alone, turned = (finish(tile, template, headings) for headings in (1, 17))
    far = np.abs(truth[:, 2]) > np.radians(3.0)
    assert np.median(off_m(alone, truth)[far]) > 0.1
    assert off_m(turned, truth).max() < 0.03
    yaw = np.asarray(turned.pose)[:, 3]
    np.testing.assert_allclose(yaw, truth[:, 2], atol=np.radians(0.3))


def test_what_is_short_or_sure_is_tried_at_its_own_heading_alone() -> None:
    assert trial_headings(0.0, 0.2) == 1
    assert trial_headings(np.radians(3.0) * 0.5, 0.2) == 1
    assert trial_headings(np.radians(0.3) * 4.0, 0.2) == 1
    assert trial_headings(np.radians(1.0) * 4.0, 0.2) == 5
    assert trial_headings(np.radians(5.0) * 4.0, 0.1) == 17
