"""The path table: positions and headings of curves known in closed form, feet by dense search, straight ends."""

import jax
import jax.numpy as jnp
import numpy as np
from scipy.integrate import cumulative_trapezoid

from lgprjax.vehicle import Path, path_from_curvature, path_from_points, path_point, project
from refusals import refused


def wavy() -> Path:
    return path_from_curvature(0.08 * np.sin(np.arange(400) / 40.0), start=(3.0, -2.0, 0.7))


def dense(path: Path, length_m: float, count: int = 400_001) -> tuple[np.ndarray, np.ndarray]:
    """Arc length and position by integrating the rows' curvatures in float64, none of the package's formulas."""
    rows = np.asarray(path.rows, np.float64)
    spacing = float(path.spacing_m)
    arc = np.linspace(0.0, length_m, count)
    row = np.minimum((arc / spacing).astype(int), len(rows) - 3) + 1
    heading = np.arctan2(rows[1, 3], rows[1, 2]) + cumulative_trapezoid(rows[row, 4], arc, initial=0.0)
    x = rows[1, 0] + cumulative_trapezoid(np.cos(heading), arc, initial=0.0)
    y = rows[1, 1] + cumulative_trapezoid(np.sin(heading), arc, initial=0.0)
    return arc, np.stack([x, y], axis=-1)


def test_points_of_a_table_of_arcs_are_those_of_its_integral() -> None:
    path = wavy()
    arc, position = dense(path, 100.0)
    found = path_point(path, jnp.asarray(arc[::1777], jnp.float32))
    np.testing.assert_allclose(found.x_m, position[::1777, 0], atol=3e-4)
    np.testing.assert_allclose(found.y_m, position[::1777, 1], atol=3e-4)
    np.testing.assert_allclose(np.hypot(found.cos, found.sin), 1.0, atol=2e-6)


def test_heading_is_continuous_across_rows() -> None:
    path = wavy()
    knots = np.arange(1, 400) * 0.25
    below, above = (path_point(path, jnp.asarray(knots + step, jnp.float32)) for step in (-1e-4, 1e-4))
    turned = np.asarray(below.cos) * np.asarray(above.sin) - np.asarray(below.sin) * np.asarray(above.cos)
    assert np.abs(turned).max() < 5e-5
    assert np.hypot(above.x_m - below.x_m, above.y_m - below.y_m).max() < 3e-4


def test_both_ends_go_on_straight() -> None:
    path = wavy()
    before = path_point(path, jnp.float32(-12.0))
    np.testing.assert_allclose(
        (before.x_m, before.y_m), (3.0 - 12.0 * np.cos(0.7), -2.0 - 12.0 * np.sin(0.7)), atol=1e-5
    )
    end, after = path_point(path, jnp.float32(100.0)), path_point(path, jnp.float32(130.0))
    np.testing.assert_allclose((after.x_m, after.y_m), (end.x_m + 30.0 * end.cos, end.y_m + 30.0 * end.sin), atol=3e-5)
    assert float(after.curvature_radpm) == 0.0


def test_foot_is_the_nearest_point_of_the_branch() -> None:
    path = wavy()
    _, position = dense(path, 100.0)
    rng = np.random.default_rng(3)
    arc = rng.uniform(5.0, 95.0, 60)
    offset = rng.uniform(-4.0, 4.0, 60)
    foot = path_point(path, jnp.asarray(arc, jnp.float32))
    x, y = np.asarray(foot.x_m - foot.sin * offset), np.asarray(foot.y_m + foot.cos * offset)
    found = project(path, jnp.asarray(arc + rng.uniform(-0.1, 0.1, 60), jnp.float32), jnp.asarray(x), jnp.asarray(y))
    # From up to 0.1 m away: at most one row further, whose curvature differs by a hundredth.
    np.testing.assert_allclose(found.arc_m, arc, atol=1e-3)
    nearest = np.array([np.min(np.hypot(position[:, 0] - a, position[:, 1] - b)) for a, b in zip(x, y, strict=True)])
    np.testing.assert_allclose(np.abs(found.offset_m), nearest, atol=2e-4)
    np.testing.assert_array_equal(np.sign(found.offset_m), np.sign(offset))


def test_foot_is_exact_on_a_circle_from_anywhere_on_its_row() -> None:
    path = path_from_curvature(np.full(200, 1.0 / 12.0))
    for offset in (-3.0, 0.0, 5.0):
        angle = 4.1 / 12.0
        x, y = (12.0 - offset) * np.sin(angle), 12.0 - (12.0 - offset) * np.cos(angle)
        found = project(path, jnp.float32(3.8), jnp.float32(x), jnp.float32(y))
        np.testing.assert_allclose((found.arc_m, found.offset_m), (4.1, offset), atol=4e-6)


def test_foot_stays_on_its_branch_where_the_path_crosses_itself() -> None:
    # Once round and across the start at a right angle.
    path = path_from_curvature(np.concatenate([np.zeros(80), np.full(120, 1.5 * np.pi / 30.0), np.zeros(120)]))
    crossing = 20.0 - 30.0 / (1.5 * np.pi)
    along = path_point(path, jnp.float32(crossing))
    found = project(path, jnp.float32(crossing - 0.05), along.x_m, along.y_m + 0.3)
    np.testing.assert_allclose((found.arc_m, found.offset_m), (crossing, 0.3), atol=1e-5)
    later = project(path, jnp.float32(50.0 + 30.0 / (1.5 * np.pi)), along.x_m, along.y_m + 0.3)
    assert float(later.arc_m) > 50.0
    np.testing.assert_allclose(later.offset_m, 0.0, atol=1e-4)


def test_closed_path_goes_round() -> None:
    count = 300
    path = path_from_curvature(np.full(count, 2 * np.pi / (count * 0.25)), closed=True)
    one, other = path_point(path, jnp.float32(11.3)), path_point(path, jnp.float32(11.3 - 2 * 75.0))
    np.testing.assert_allclose(np.asarray(one), np.asarray(other), atol=3e-5)


def test_path_through_points_of_a_circle_is_the_circle() -> None:
    rng = np.random.default_rng(0)
    angle = np.sort(np.arange(60) + rng.uniform(-0.2, 0.2, 60)) * 2 * np.pi / 60
    path = path_from_points(np.stack([12 * np.cos(angle), 12 * np.sin(angle)], axis=-1), closed=True)
    np.testing.assert_allclose(path.length_m, 24 * np.pi, rtol=2e-4)
    at = path_point(path, jnp.linspace(0.0, 100.0, 997, dtype=jnp.float32))
    np.testing.assert_allclose(np.hypot(at.x_m, at.y_m), 12.0, atol=3e-3)
    np.testing.assert_allclose(at.x_m * at.cos + at.y_m * at.sin, 0.0, atol=0.25)


def test_path_through_points_goes_through_them_and_its_heading_is_continuous() -> None:
    x = np.concatenate([np.arange(0.0, 50.0, 0.7), [50.0]])
    points = np.stack([x, 3.0 * np.sin(x / 9.0)], axis=-1)
    path = path_from_points(points)
    at = path_point(path, jnp.arange(0.0, float(path.length_m), 0.01, dtype=jnp.float32))
    curve = np.stack([at.x_m, at.y_m], axis=-1)
    for point in points:
        assert np.hypot(*(curve - point).T).min() < 6e-3
    heading = np.unwrap(np.arctan2(at.sin, at.cos))
    assert np.abs(np.diff(heading)).max() < 0.002
    slope = 3.0 / 9.0 * np.cos(curve[:, 0] / 9.0)
    np.testing.assert_allclose(np.tan(heading), slope, atol=0.01)


def test_look_up_has_the_headings_gradient() -> None:
    path = wavy()
    at = jnp.float32(33.33)
    point = path_point(path, at)
    slope = jax.grad(lambda arc: path_point(path, arc).y_m)(at)
    np.testing.assert_allclose(slope, point.sin, atol=2e-4)


def test_points_and_curvatures_that_are_no_path_are_refused() -> None:
    with refused("points", 3, found=2):
        path_from_points(np.array([[0.0, 0.0], [1.0, 0.0]]))
    with refused("point 1", found="nan"):
        path_from_points(np.array([[0.0, 0.0], [1.0, np.nan], [2.0, 0.0]]))
    # Those that lie too close together count once.
    with refused("points", 3, found=2):
        path_from_points(np.array([[0.0, 0.0], [0.01, 0.0], [0.02, 0.0], [5.0, 0.0]]))
    with refused("curvatures", 0.5, found=0.75):
        path_from_curvature(np.array([3.0]))
    with refused("curvatures", found=0):
        path_from_curvature(np.array([]))
    with refused("end", found="2.000"):
        path_from_curvature(np.zeros(8), closed=True)
