"""The ground comes from its seed alone."""

import jax
import numpy as np
import pytest

from lgprjax.scene import GroundConfig, make_ground
from lgprjax.scene.ground import value_at

CONFIG = GroundConfig(length_m=30.0)


def test_the_same_seed_makes_the_same_ground_and_another_seed_another() -> None:
    first, again, other = make_ground(4, CONFIG), make_ground(4, CONFIG), make_ground(5, CONFIG)
    for a, b in zip(jax.tree.leaves(first[1:]), jax.tree.leaves(again[1:]), strict=True):
        np.testing.assert_array_equal(a, b)
    assert not np.array_equal(first.scatterers.strength_m[:50], other.scatterers.strength_m[:50])
    assert not np.array_equal(first.layers.relief_phase_rad, other.layers.relief_phase_rad)
    assert not np.array_equal(first.moisture.phase_rad, other.moisture.phase_rad)


def test_one_kind_of_thing_does_not_change_another() -> None:
    """Each kind draws from its own stream: pulling out the trees leaves stones, pipes and layers as they were."""
    wooded, bare = (make_ground(4, GroundConfig(length_m=30.0, trees_per_100m=t)) for t in (6.0, 0.0))
    kept = np.isin(wooded.scatterers.strength_m, bare.scatterers.strength_m)
    assert not kept.all()
    np.testing.assert_array_equal(wooded.scatterers.place_m[kept], bare.scatterers.place_m)
    np.testing.assert_array_equal(wooded.utilities.centre_m, bare.utilities.centre_m)
    np.testing.assert_array_equal(wooded.layers.relief_phase_rad, bare.layers.relief_phase_rad)


def test_interfaces_have_the_relief_and_reflectivity_asked_for_of_what_is_not_too_fine() -> None:
    """Shallow ones keep nearly all of it; waves inside the Fresnel zone are damped, the deeper the more."""
    config = GroundConfig(length_m=30.0, layer_depth_m=(0.05, 0.05, 1.7))
    layers = make_ground(2, config).layers
    place = np.random.default_rng(0).uniform(-500.0, 500.0, (4000, 2))
    angle = np.einsum("np,lwp->nlw", place, layers.wave_rad_per_m)
    relief = np.sum(layers.relief_m * np.sin(angle + layers.relief_phase_rad), axis=-1)
    waves = np.sum(layers.reflectivity * np.sin(angle + layers.reflectivity_phase_rad), axis=-1)
    np.testing.assert_allclose(relief.std(axis=0), config.layer_relief_m, rtol=0.1)
    total = np.sqrt(np.mean((layers.reflectivity_mean + waves) ** 2, axis=0))
    np.testing.assert_allclose(total[:2], config.layer_reflectivity, rtol=0.1)
    assert 0.7 * config.layer_reflectivity < total[2] < 0.95 * config.layer_reflectivity


def test_damping_follows_the_second_order_of_the_phase_over_the_fresnel_zone() -> None:
    """A wave of wavenumber q at depth d turns by q**2 d / 4k against the mirror; k of 250 MHz in the ground."""
    layers = make_ground(2, CONFIG).layers
    for depth, wave, size in zip(layers.depth_m, layers.wave_rad_per_m, layers.reflectivity, strict=True):
        phase = np.sum(wave**2, axis=-1) * depth / (4 * 2 * np.pi * 0.25 / CONFIG.velocity_m_per_ns)
        np.testing.assert_allclose(size, CONFIG.layer_reflectivity / np.sqrt(24) * np.exp(-0.5 * phase**2), rtol=1e-9)


def test_repeated_ground_has_the_same_things_a_length_on() -> None:
    ground = make_ground(3, GroundConfig(length_m=30.0, repeat_m=5.0, utilities_along=2))
    along, cross, depth = ground.scatterers.place_m.T
    windows = [np.column_stack([along - at, cross, depth])[(along >= at) & (along < at + 5.0)] for at in (0.0, 15.0)]
    np.testing.assert_allclose(windows[1], windows[0], atol=1e-9)
    place = np.random.default_rng(1).uniform(-4.0, 4.0, (200, 2))
    moved = value_at(ground.moisture, place + [15.0, 0.0])
    np.testing.assert_allclose(moved, value_at(ground.moisture, place), atol=1e-9)
    assert np.all(ground.utilities.direction == [1.0, 0.0])
    # Lines along the road are under all of it, not under the first lengths alone.
    reach_m = ground.utilities.half_length_m
    assert np.all(ground.utilities.centre_m[:, 0] - reach_m <= -12.0)
    assert np.all(ground.utilities.centre_m[:, 0] + reach_m >= 42.0)


@pytest.mark.parametrize("repeat_m", [0.0, float("nan")])
def test_a_length_to_repeat_after_must_be_above_zero(repeat_m: float) -> None:
    with pytest.raises(ValueError, match="repeat_m"):
        make_ground(1, GroundConfig(length_m=30.0, repeat_m=repeat_m))
