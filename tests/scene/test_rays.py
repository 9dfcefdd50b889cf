"""Refracted rays against a search for the quickest path, a traced fan of rays and textbook Fresnel, in float64."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import Float

from lgprjax.scene.propagation import Ray, passage, refract
from scene.bare_ground import LIGHT_M_PER_NS, fermat

RNG = np.random.default_rng(2)
CASES = np.column_stack([RNG.uniform(0.0, 2.0, 80), RNG.uniform(0.1, 0.8, 80), RNG.uniform(0.03, 3.0, 80)])
CASES[:10, 0] *= 1e-3  # straight down, too
CASES[10:30, 2] = RNG.uniform(0.03, 0.1, 20)  # shallow and far aside: near the critical angle


_refract, _passage = jax.jit(refract), jax.jit(passage)


def rays(index: float, cases: Float[np.ndarray, "case 3"] = CASES) -> Ray:
    aside, height, depth = (jnp.asarray(c) for c in cases.T)
    traced: Ray = _refract(aside, height, depth, jnp.asarray(index))
    return traced


@pytest.mark.parametrize("index", [1.5, 5.0])
def test_the_ray_is_the_quickest_path(index: float) -> None:
    expected = np.array([fermat(a, h, d, index) for a, h, d in CASES.tolist()])
    found = rays(index)
    time_ns = (np.asarray(found.air_m, np.float64) + index * np.asarray(found.ground_m, np.float64)) / LIGHT_M_PER_NS
    np.testing.assert_allclose(time_ns, expected[:, 0], atol=2e-5, rtol=1e-6)  # float32
    np.testing.assert_allclose(found.air_m, expected[:, 1], atol=2e-3)
    np.testing.assert_allclose(found.cos_air, CASES[:, 1] / np.asarray(found.air_m), rtol=1e-5)
    np.testing.assert_allclose(found.cos_ground, CASES[:, 2] / np.asarray(found.ground_m), rtol=1e-5)
    with jax.enable_x64(True):  # the root is within what is documented
        found = rays(index)
        path_m = np.asarray(found.air_m) + index * np.asarray(found.ground_m)
        assert np.abs(path_m / LIGHT_M_PER_NS - expected[:, 0]).max() < 2e-6


@pytest.mark.parametrize("index", [1.5, 5.0])
def test_the_ray_tube_spreads_as_a_traced_fan_does(index: float) -> None:
    step = 1e-6
    angle = np.linspace(0.05, 1.3, 80)
    height, depth = 0.3, np.linspace(0.1, 2.0, 80)

    def aside(air_rad: Float[np.ndarray, " ray"]) -> Float[np.ndarray, " ray"]:
        return np.asarray(height * np.tan(air_rad) + depth * np.tan(np.arcsin(np.sin(air_rad) / index)))

    ground_rad = np.arcsin(np.sin(angle) / index)
    between = (aside(angle + step) - aside(angle - step)) / (2 * step)
    in_plane = between * np.cos(ground_rad)  # across the ray
    out_of_plane = aside(angle) / np.sin(angle)  # a turn about the vertical, per angle between the rays
    with jax.enable_x64(True):
        found = rays(index, np.column_stack([aside(angle), np.full(80, height), depth]))
        np.testing.assert_allclose(found.spread_m[0], out_of_plane, rtol=1e-4)
        np.testing.assert_allclose(found.spread_m[1], in_plane, rtol=2e-3)


@pytest.mark.parametrize("index", [1.5, 5.0])
def test_the_surface_lets_through_what_fresnel_says(index: float) -> None:
    with jax.enable_x64(True):
        found = rays(index)
        straight = np.asarray(_passage(rays(index, np.tile([0.0, 0.3, 1.0], (80, 1))), jnp.asarray(index)))
        np.testing.assert_allclose(straight, 1 - ((index - 1) / (index + 1)) ** 2, rtol=1e-6)
        air_rad, ground_rad = np.arccos(np.asarray(found.cos_air)), np.arccos(np.asarray(found.cos_ground))
        aslant = air_rad > 0.05  # the sines' form is 0 / 0 straight down
        reflected = np.sin((air_rad - ground_rad)[aslant]) / np.sin((air_rad + ground_rad)[aslant])
        expected = 1 - reflected**2
        np.testing.assert_allclose(np.asarray(_passage(found, jnp.asarray(index)))[aslant], expected, atol=5e-3)
        assert expected.min() < 0.6  # grazing rays are among them
