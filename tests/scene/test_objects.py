"""What is buried has the density, depth, size and shape asked for."""

import numpy as np
import pytest

from lgprjax.scene import GroundConfig, Scatterers, make_ground
from lgprjax.scene.ground import chosen, draw_roots, draw_utilities, joined, repeated

CONFIG = GroundConfig(length_m=30.0, trees_per_100m=0.0)


def test_stones_have_the_density_depth_and_size_asked_for() -> None:
    stones = make_ground(1, CONFIG).scatterers
    along, cross, depth = stones.place_m.T
    assert len(along) == round(54.0 * 8.0 * CONFIG.stones_per_m2)
    assert np.all(np.diff(along) >= 0)
    assert np.abs(cross).max() <= CONFIG.half_width_m
    assert 0.15 <= depth.min() <= depth.max() <= 2.5
    top, middle, bottom = np.exp(-np.array([0.15, 1.0, 2.5]) / CONFIG.stone_depth_scale_m)
    assert np.mean(depth < 1.0) == pytest.approx((top - middle) / (top - bottom), abs=0.02)
    assert np.mean(stones.strength_m > 0) == pytest.approx(0.5, abs=0.03)
    log_size = np.log(np.abs(stones.strength_m))
    assert np.median(log_size) == pytest.approx(np.log(CONFIG.stone_strength_m), abs=0.05)
    assert log_size.std() == pytest.approx(CONFIG.stone_strength_spread, rel=0.05)


def test_roots_are_chains_that_start_beside_the_road_and_thin_out_inwards() -> None:
    roots = draw_roots(np.random.default_rng(2), (0.0, 200.0), 4.0, 6.0)
    along, cross, depth = roots.place_m.T
    assert len(along) > 500
    assert np.all((along > 0.0) & (along <= 200.0) & (np.abs(cross) <= 4.0) & (depth >= 0.2))
    assert np.all(roots.strength_m > 0)  # wood is moist
    apart = np.linalg.norm(roots.place_m[:, None] - roots.place_m[None], axis=-1)
    np.fill_diagonal(apart, np.inf)
    assert np.median(apart.min(axis=1)) < 0.055  # a point every 5 cm
    outer, inner = (np.median(np.abs(roots.strength_m[m])) for m in (np.abs(cross) > 2.5, np.abs(cross) < 1.0))
    assert inner < 0.8 * outer


def test_pipes_cross_the_road_or_run_with_it() -> None:
    pipes = draw_utilities(np.random.default_rng(3), (0.0, 1000.0), 4.0, 5.0, 3)
    np.testing.assert_allclose(np.linalg.norm(pipes.direction, axis=1), 1.0, atol=1e-12)
    assert len(pipes.direction) - 3 == pytest.approx(50, abs=4 * np.sqrt(50))
    assert np.abs(pipes.direction[:-3, 1]).min() > 0.5
    assert np.all(pipes.half_length_m[:-3] == 8.0)  # from edge to edge of the corridor, at any angle
    assert np.abs(pipes.direction[-3:, 1]).max() < 0.01
    assert np.all(pipes.half_length_m[-3:] >= 500.0)
    assert np.all(pipes.depth_m - pipes.radius_m > 0.3)
    metal = pipes.reflectivity == -1.0
    assert 0.35 < metal.mean() < 0.85
    plastic, thin = pipes.reflectivity[~metal], pipes.radius_m[~metal] < 0.03
    assert 0 < plastic.min() <= plastic[thin].max() < plastic[~thin].min() <= plastic.max() <= 0.4


def test_groups_join_in_order_of_the_track() -> None:
    one = Scatterers(np.array([[0.0, 0, 1], [2.0, 0, 1]]), np.array([1.0, 2.0]))
    other = Scatterers(np.array([[1.0, 0, 1]]), np.array([3.0]))
    both = joined(one, other)
    np.testing.assert_array_equal(both.strength_m, [1.0, 3.0, 2.0])
    np.testing.assert_array_equal(chosen(both, both.strength_m > 1.5).place_m[:, 0], [1.0, 2.0])


def test_a_pattern_is_laid_end_to_end_up_to_the_stop() -> None:
    pattern = Scatterers(np.array([[-2.0, 0.5, 1], [1.0, 0, 2]]), np.array([1.0, 2.0]))
    laid = repeated(pattern, 4.0, 9.5)
    np.testing.assert_array_equal(laid.place_m[:, 0], [-2.0, 1.0, 2.0, 5.0, 6.0, 9.0])
    np.testing.assert_array_equal(laid.strength_m, [1.0, 2.0] * 3)
    none = Scatterers(np.zeros((0, 3)), np.zeros(0))
    assert len(repeated(none, 4.0, 9.5).strength_m) == 0
