"""The ground comes from its seed alone, and slices of it are honest."""

import jax
import numpy as np
import pytest

from lgprjax.scene import GroundConfig, make_ground, slice_ground

CONFIG = GroundConfig(length_m=30.0)


def test_the_same_seed_makes_the_same_ground_and_another_seed_another() -> None:
    first, again, other = make_ground(4, CONFIG), make_ground(4, CONFIG), make_ground(5, CONFIG)
    for a, b in zip(jax.tree.leaves(first[1:]), jax.tree.leaves(again[1:]), strict=True):
        np.testing.assert_array_equal(a, b)
    assert not np.array_equal(first.stone_m, other.stone_m)
    assert not np.array_equal(first.layers.relief_phase_rad, other.layers.relief_phase_rad)


def test_stones_have_the_density_depth_and_polarity_asked_for() -> None:
    ground = make_ground(1, CONFIG)
    along, cross, depth = ground.stone_m.T
    assert len(along) == round(54.0 * 8.0 * CONFIG.stones_per_m2)
    assert np.all(np.diff(along) >= 0)
    assert np.abs(cross).max() <= CONFIG.half_width_m
    assert 0.15 <= depth.min() <= depth.max() <= 2.5
    assert np.mean(depth < 1.325) > 0.6  # denser near the top
    assert np.mean(ground.stone_strength_m > 0) == pytest.approx(0.5, abs=0.03)
    log_size = np.log(np.abs(ground.stone_strength_m))
    assert np.median(log_size) == pytest.approx(np.log(CONFIG.stone_strength_m), abs=0.05)
    assert log_size.std() == pytest.approx(CONFIG.stone_strength_spread, rel=0.05)


def test_interfaces_have_the_relief_and_reflectivity_asked_for() -> None:
    layers = make_ground(2, CONFIG).layers
    rng = np.random.default_rng(0)
    place = rng.uniform(-500.0, 500.0, (4000, 2))
    angle = np.einsum("np,lwp->nlw", place, layers.wave_rad_per_m)
    relief = np.sum(layers.relief_m * np.sin(angle + layers.relief_phase_rad), axis=-1)
    waves = np.sum(layers.reflectivity * np.sin(angle + layers.reflectivity_phase_rad), axis=-1)
    np.testing.assert_allclose(relief.std(axis=0), CONFIG.layer_relief_m, rtol=0.1)
    total = np.sqrt(np.mean((layers.reflectivity_mean + waves) ** 2, axis=0))
    np.testing.assert_allclose(total, CONFIG.layer_reflectivity, rtol=0.1)
    wavelength_m = 2 * np.pi / np.linalg.norm(layers.wave_rad_per_m, axis=-1)
    assert 0.3 <= wavelength_m.min() < 1.0
    assert 5.0 < wavelength_m.max() <= 10.0


def test_a_slice_holds_exactly_its_window_about_its_origin() -> None:
    ground = make_ground(1, CONFIG)
    piece = slice_ground(ground, 3.0, 5.0, stones=512, origin_m=(4.0, 1.0), velocity_factor=0.9)
    inside = ground.stone_m[(ground.stone_m[:, 0] >= 3.0) & (ground.stone_m[:, 0] < 5.0)]
    np.testing.assert_allclose(piece.stone_m[: len(inside)], inside - [4.0, 1.0, 0.0], atol=1e-6)
    assert not piece.stone_strength_m[len(inside) :].any()
    assert piece.velocity_m_per_ns == pytest.approx(0.09)
    assert all(leaf.dtype == np.float32 for leaf in jax.tree.leaves(piece))


def test_a_slice_too_small_for_its_stones_is_refused() -> None:
    with pytest.raises(ValueError, match="more than 16"):
        slice_ground(make_ground(1, CONFIG), 3.0, 5.0, stones=16)
