"""Courses: their geometry from the formulas of their names."""

import jax.numpy as jnp
import numpy as np
from scipy.special import fresnel

from lgprjax.vehicle import arc_course, clothoid_course, eight_course, line_course, path_point
from refusals import refused


def test_line_is_straight() -> None:
    path = line_course(100.1, heading_rad=0.5)
    at = path_point(path, jnp.float32(100.1))
    np.testing.assert_allclose((at.x_m, at.y_m), (100.1 * np.cos(0.5), 100.1 * np.sin(0.5)), atol=2e-5)
    np.testing.assert_allclose(path.length_m, 100.1, rtol=1e-6)


def test_an_arc_to_the_right_has_its_radius_and_a_whole_turn_repeats() -> None:
    path = arc_course(12.0, 1.5 * np.pi, "right")
    np.testing.assert_allclose(path.length_m, 18.0 * np.pi, rtol=1e-6)
    at = path_point(path, jnp.linspace(0.0, 56.0, 91, dtype=jnp.float32))
    np.testing.assert_allclose(np.hypot(at.x_m, at.y_m + 12.0), 12.0, atol=2e-5)
    assert float(path.laps_per_m) == 0.0
    assert float(arc_course(12.0, 2 * np.pi).laps_per_m) > 0.0


def test_clothoid_is_fresnels_and_the_whole_curve_turns_by_its_angle() -> None:
    path = clothoid_course(15.0, 1.2, 9.0, straight_m=10.0)
    # Position on a clothoid of rate 1/(R Lc): Fresnel integrals of the way from its start.
    way = np.linspace(0.0, 9.0, 31)
    scale = np.sqrt(np.pi * 15.0 * 9.0)
    sine, cosine = fresnel(way / scale)
    at = path_point(path, jnp.asarray(10.0 + way, jnp.float32))
    np.testing.assert_allclose(at.x_m, 10.0 + scale * cosine, atol=2e-3)
    np.testing.assert_allclose(at.y_m, scale * sine, atol=2e-3)
    end = path_point(path, path.length_m)
    np.testing.assert_allclose(np.arctan2(end.sin, end.cos), 1.2, atol=1e-5)
    np.testing.assert_allclose(np.abs(np.asarray(path.rows[:, 4])).max(), 1.0 / 15.0, rtol=1e-4)


def test_eight_crosses_itself_and_has_its_least_radius() -> None:
    path = eight_course(8.0)
    # Half of a lemniscate of half width a is 2.62206 a long.
    np.testing.assert_allclose(path.length_m, 2 * 2.62206 * 24.0, rtol=1e-4)
    np.testing.assert_allclose(1.0 / np.abs(np.asarray(path.rows[:, 4])).max(), 8.0, rtol=0.01)
    first, second = (path_point(path, path.length_m * share) for share in (0.25, 0.75))
    np.testing.assert_allclose((first.x_m, first.y_m, second.x_m, second.y_m), 0.0, atol=5e-3)
    np.testing.assert_allclose(abs(first.cos * second.sin - first.sin * second.cos), 1.0, atol=5e-3)


def test_courses_that_cannot_be_are_refused() -> None:
    with refused("clothoid_m", 0.5, found=8):
        clothoid_course(10.0, 0.5, 8.0)
    with refused("radius", 0.5, found=0.1):
        arc_course(0.1, 1.0)
    with refused("length_m", found="nan"):
        line_course(float("nan"))
