"""Windows of which a part lies on ground that the map does not have: the errors of their poses, and what they claim."""

import jax.numpy as jnp
import numpy as np
import pytest

from lgprjax.registration import Template
from lgprjax.registration.refine import FAR_STEPS, Finished, Region, finish_best
from lgprjax.subsurface import Tile
from registration.synthetic_tile import HALF, OMEGA, REFERENCE_M, Ground, random_ground, stacked

WINDOWS = 48
SCANS, CHANNELS = 16, 6
BACK_M = np.repeat(-0.25 * np.arange(SCANS), CHANNELS)
OFFSET_M = np.stack([BACK_M, np.tile((2.5 - np.arange(CHANNELS)) * 0.127, SCANS)], axis=-1)
CELL_M, ORIGIN_M = 0.03, np.array([-4.2, -1.0])
HALF_WIDTH = np.array([1.0, 1.0, 0.02, np.radians(3.0), np.radians(0.5), np.radians(0.5)])
NOISE = 1.0
# Noise is white in all coefficients of all traces.
NUMBERS = len(BACK_M) * 2 * HALF
FOREIGN = {
    "none": BACK_M > 9.0,
    "all but the first quarter": BACK_M > -3.0,
    "the middle": np.abs(BACK_M + 2.0) < 0.8,
}


@pytest.fixture(scope="module")
def tile() -> Tile:
    along, cross = (ORIGIN_M[axis] + np.arange(size) * CELL_M for axis, size in enumerate((180, 68)))
    value = stacked(GROUND(np.stack(np.meshgrid(along, cross, indexing="ij"), axis=-1)))
    return Tile(
        coefficients=jnp.asarray(value, dtype=jnp.float32),
        power=jnp.asarray(np.sum(value**2, axis=-1), dtype=jnp.float32),
        valid=jnp.ones(value.shape[:2], bool),
        origin_m=jnp.asarray(ORIGIN_M, dtype=jnp.float32),
        cell_m=jnp.full(2, CELL_M, jnp.float32),
    )


GROUND: Ground = random_ground(21)
OTHER: Ground = random_ground(22)


def register(tile: Tile, foreign: np.ndarray) -> tuple[Finished, np.ndarray]:
    """Each window at its own pose; where it is foreign the ground is another one, three times as loud."""
    rng = np.random.default_rng(5)
    yaw = HALF_WIDTH[3] / 3.0 * rng.normal(size=WINDOWS)
    truth = np.zeros((WINDOWS, 6))
    truth[:, :2], truth[:, 2], truth[:, 3] = rng.uniform(-0.04, 0.04, (WINDOWS, 2)), REFERENCE_M, yaw
    turn = np.stack([np.cos(yaw), -np.sin(yaw), np.sin(yaw), np.cos(yaw)], axis=-1).reshape(-1, 1, 2, 2)
    place = truth[:, None, :2] + (turn @ OFFSET_M[None, :, :, None])[..., 0]
    heard = np.where(foreign[None, :, None], 3.0 * OTHER(place), GROUND(place))
    live = stacked(heard) + NOISE * np.sqrt(0.5) * rng.normal(size=(*place.shape[:2], 2 * HALF))
    traces = (WINDOWS, len(BACK_M))
    template = Template(
        jnp.asarray(live, dtype=jnp.float32),
        jnp.asarray(np.broadcast_to(OFFSET_M, (*traces, 2)), dtype=jnp.float32),
        jnp.ones(traces, bool),
        jnp.asarray(np.broadcast_to(np.repeat(np.arange(SCANS, dtype=np.int32), CHANNELS), traces)),
    )
    prior = np.tile([0.0, 0.0, REFERENCE_M, 0.0, 0.0, 0.0], (WINDOWS, 1)).astype(np.float32)
    # A coarse place is where what matches does so best with the prior's heading.
    middle = OFFSET_M[~foreign].mean(axis=0)
    start = prior.copy()
    start[:, :2] = truth[:, :2] + (turn[:, 0] @ middle) - middle + rng.uniform(-0.03, 0.03, (WINDOWS, 2))
    width = jnp.asarray(np.tile(HALF_WIDTH, (WINDOWS, 1)), dtype=jnp.float32)
    found: Finished = finish_best(
        tile,
        jnp.float32(REFERENCE_M),
        jnp.asarray(OMEGA, dtype=jnp.float32),
        template,
        start,
        Region(jnp.asarray(prior), width, jnp.arange(WINDOWS, dtype=jnp.uint32)),
        jnp.full(WINDOWS, NUMBERS**-0.5, jnp.float32),
        jnp.float32(0.5),
        heading=True,
        pitch=False,
        headings=np.int32(1),
        steps=np.int32(FAR_STEPS),
    )
    return found, np.asarray(found.pose)[:, [0, 1, 3]] - truth[:, [0, 1, 3]]


@pytest.mark.parametrize("name", FOREIGN)
def test_a_window_partly_on_other_ground_errs_as_it_says(tile: Tile, name: str) -> None:
    found, error = register(tile, FOREIGN[name])
    # One that has not converged is no fix.
    ended = ~np.asarray(found.unfinished)
    assert np.mean(ended) > 0.9
    covariance = np.asarray(found.covariance, np.float64)[:, [[0], [1], [3]], [0, 1, 3]][ended]
    squared = np.einsum("wi,wij,wj->w", error[ended], np.linalg.inv(covariance), error[ended]) / 3.0
    # Of 144 numbers: their mean square lies within 0.35 of 1 by three standard errors.
    assert 0.65 < np.mean(squared) < 1.35
