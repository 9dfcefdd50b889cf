"""Refracted rays against a search for the quickest path, a traced fan of rays and textbook Fresnel, in float64."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import Float

from lgprjax.scene.propagation import Ray, passage, refract
from scene.bare_ground import LIGHT_M_PER_NS, fermat

RNG = np.random.default_rng(2)
CASES = np.column_stack([RNG.uniform(0.0, 2.0, 300), RNG.uniform(0.1, 0.8, 300), RNG.uniform(0.03, 3.0, 300)])
CASES[:30, 0] *= 1e-3  # straight down, too
CASES[30:60, 2] = RNG.uniform(0.03, 0.1, 30)  # shallow and far aside: near the critical angle


def rays(index: float, cases: Float[np.ndarray, "case 3"] = CASES) -> Ray:
    aside, height, depth = (jnp.asarray(c) for c in cases.T)
    return refract(aside, height, depth, jnp.asarray(index))


@pytest.mark.parametrize("index", [1.5, 3.0, 5.0])
def test_the_ray_is_the_quickest_path(index: float) -> None:
    found = rays(index)
    expected = np.array([fermat(a, h, d, index) for a, h, d in CASES.tolist()])
    time_ns = (np.asarray(found.air_m, np.float64) + index * np.asarray(found.ground_m, np.float64)) / LIGHT_M_PER_NS
    np.testing.assert_allclose(time_ns, expected[:, 0], atol=2e-5, rtol=1e-6)  # float32
    np.testing.assert_allclose(found.air_m, expected[:, 1], atol=2e-3)
    np.testing.assert_allclose(found.cos_air, CASES[:, 1] / np.asarray(found.air_m), rtol=1e-5)
    np.testing.assert_allclose(found.cos_ground, CASES[:, 2] / np.asarray(found.ground_m), rtol=1e-5)


def test_in_float64_the_root_is_within_what_is_documented() -> None:
    with jax.enable_x64(True):
        for index in (1.5, 2.5, 5.0):
            found = rays(index)
            path_m = np.asarray(found.air_m) + index * np.asarray(found.ground_m)
            expected_ns = np.array([fermat(a, h, d, index)[0] for a, h, d in CASES.tolist()])
            assert np.abs(path_m / LIGHT_M_PER_NS - expected_ns).max() < 2e-6


@pytest.mark.parametrize("index", [1.5, 3.0])
def test_the_ray_tube_spreads_as_a_traced_fan_does(index: float) -> None:
    step = 1e-6
    angle = np.linspace(0.05, 1.3, 40)
    height, depth = 0.3, np.linspace(0.1, 2.0, 40)

    def aside(air_rad: Float[np.ndarray, " ray"]) -> Float[np.ndarray, " ray"]:
        return np.asarray(height * np.tan(air_rad) + depth * np.tan(np.arcsin(np.sin(air_rad) / index)))

    ground_rad = np.arcsin(np.sin(angle) / index)
    between = (aside(angle + step) - aside(angle - step)) / (2 * step)
    in_plane = between * np.cos(ground_rad)  # across the ray
    out_of_plane = aside(angle) / np.sin(angle)  # a turn about the vertical, per angle between the rays
    with jax.enable_x64(True):
        found = rays(index, np.column_stack([aside(angle), np.full(40, height), depth]))
        np.testing.assert_allclose(found.spread_m[0], out_of_plane, rtol=1e-4)
        np.testing.assert_allclose(found.spread_m[1], in_plane, rtol=2e-3)


@pytest.mark.parametrize("index", [1.5, 3.0])
def test_the_surface_lets_through_what_fresnel_says(index: float) -> None:
    with jax.enable_x64(True):
        found = rays(index)
        straight = refract(jnp.asarray(0.0), jnp.asarray(0.3), jnp.asarray(1.0), jnp.asarray(index))
        assert float(passage(straight, jnp.asarray(index))) == pytest.approx(1 - ((index - 1) / (index + 1)) ** 2)
        air_rad, ground_rad = np.arccos(np.asarray(found.cos_air)), np.arccos(np.asarray(found.cos_ground))
        aslant = air_rad > 0.05  # the sines' form is 0 / 0 straight down
        reflected = np.sin((air_rad - ground_rad)[aslant]) / np.sin((air_rad + ground_rad)[aslant])
        expected = 1 - reflected**2
        np.testing.assert_allclose(np.asarray(passage(found, jnp.asarray(index)))[aslant], expected, atol=5e-3)
        assert expected.min() < 0.6  # grazing rays are among them
