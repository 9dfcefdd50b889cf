"""The swarm as a finish: watched, it is the one that runs; and the highest summit beside the best place."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from lgprjax.pso import SwarmConfig
from lgprjax.registration import SurfacePicture, Template, rival_of, watch_finish
from lgprjax.registration.refine import swarm_poses
from registration.synthetic_tile import HALF_WIDTH, OMEGA, REFERENCE_M, make_problem, make_tile, random_ground

CONFIG = SwarmConfig(particles=24, iterations=12)


def test_a_watched_finish_is_the_one_that_runs() -> None:
    ground = random_ground(3)
    truth = np.array([[0.11, -0.07, 0.31, np.radians(1.0), np.radians(0.4)]])
    problem = make_problem(ground, truth, truth + np.array([[0.3, 0.2, 0.01, 0.005, 0.0]]), noise=0.3)
    start = jnp.asarray([[0.15, -0.12, 0.3, 0.0, 0.0, 0.0]], dtype=jnp.float32)
    prior = jnp.pad(problem.prior, [(0, 0), (0, 1)])
    width = jnp.asarray([[*HALF_WIDTH, 1.0]], dtype=jnp.float32)
    tile = make_tile(ground)
    omega = jnp.asarray(OMEGA, dtype=jnp.float32)
    setting = (tile, jnp.float32(REFERENCE_M), omega, jnp.float32(0.6))
    free = jnp.asarray([True, True, True, True, True, False])
    numbers, seed, lane = jnp.full(1, 200.0, jnp.float32), jnp.uint32(7), jnp.full(1, 5, jnp.uint32)
    ended = jax.jit(swarm_poses, static_argnames="config")(
        *setting, problem.template, start, prior, width, numbers, free, seed, lane, config=CONFIG
    )
    single = Template(*(field[0] for field in problem.template))
    view = watch_finish(*setting, single, start[0], prior[0], width[0], numbers[0], free, seed, lane[0], config=CONFIG)
    rows = CONFIG.iterations + 1
    assert view.place_m.shape == (rows, CONFIG.particles, 2)
    np.testing.assert_allclose(view.best_m[-1], ended[0, :2], atol=1e-6)
    np.testing.assert_allclose(view.best_attitude[-1], ended[0, 2:5] - prior[0, 2:5], atol=1e-6)
    # The first particle starts on the summit of the coarse stage, the others about it.
    np.testing.assert_allclose(view.place_m[0, 0], start[0, :2], atol=1e-6)
    assert np.max(np.abs(np.asarray(view.place_m) - np.asarray(start[0, :2]))) <= 0.12 + 1e-6
    assert np.hypot(*(np.asarray(view.best_m[-1]) - truth[0, :2])) < 0.02
    # The surface is what the swarm climbs: highest where the swarm ended, and as high as it said.
    score = np.asarray(view.score)
    i, j = np.unravel_index(int(np.argmax(score)), score.shape)
    top = np.array([view.along_m[i], view.cross_m[j]])
    assert np.hypot(*(top - np.asarray(view.best_m[-1]))) < 0.02
    assert score.max() == pytest.approx(float(np.max(view.best_score[-1])), abs=0.02)


def surface() -> SurfacePicture:
    along, cross = np.linspace(-1.0, 1.0, 41), np.linspace(-0.5, 0.5, 21)
    x, y = np.meshgrid(along, cross, indexing="ij")

    def hill(height: float, at: tuple[float, float]) -> np.ndarray:
        return np.asarray(height * np.exp(-((x - at[0]) ** 2 + (y - at[1]) ** 2) / 0.02))

    strength = hill(0.8, (0.2, 0.1)) + hill(0.6, (-0.6, -0.3)) + hill(0.5, (0.8, 0.4))
    strength[:, 0] = np.nan
    return SurfacePicture(along, cross, strength)


def test_the_rival_is_the_highest_other_summit() -> None:
    found = rival_of(surface(), np.array([0.2, 0.1]), 0.25)
    assert found is not None
    np.testing.assert_allclose(found, [-0.6, -0.3], atol=1e-9)
    nearer = rival_of(surface(), np.array([-0.6, -0.3]), 0.25)
    assert nearer is not None
    np.testing.assert_allclose(nearer, [0.2, 0.1], atol=1e-9)


def test_a_flank_is_no_rival() -> None:
    shown = surface()
    one = shown._replace(score=0.7 - np.hypot(shown.along_m[:, None] - 0.2, shown.cross_m[None, :] - 0.1))
    assert rival_of(one, np.array([0.2, 0.1]), 0.25) is None
    blind = shown._replace(score=np.full_like(shown.score, np.nan))
    assert rival_of(blind, np.array([0.2, 0.1]), 0.25) is None
