"""The tool's shape at a level, live: against errors drawn one by one, and against the source's cached shapes."""

import jax.numpy as jnp
import numpy as np
import pytest
import shapely

from benchmarks.cached_shapes import choose_shape, make_shapes
from lgprjax.coverage import Tool, ToolMoment
from lgprjax.coverage.shape import ClaimedShape, claimed_shape
from swept_draws import drawn_errors

TOOL = Tool(width_m=1.2, length_m=0.4, ahead_m=1.1, left_m=0.1)
_YAW_RAD = 0.7
ERRORS = {
    "fixed": ((0.02, 0.02, np.radians(0.5)), 0.3),
    "after an outage": ((0.05, 0.03, np.radians(1.5)), -0.5),
    "one sure axis": ((0.06, 0.01, np.radians(0.3)), 0.6),
}


def covariance_of(sigmas: tuple[float, float, float], related: float) -> np.ndarray:
    """Of forward, left and yaw."""
    whole = np.array([[1.0, related, 0.5 * related], [related, 1.0, related], [0.5 * related, related, 1.0]])
    scaled: np.ndarray = np.diag(sigmas) @ whole @ np.diag(sigmas)
    return scaled


def shape_of(body: np.ndarray, level: float, *, shared_m: float = 0.0, on: bool = True) -> ClaimedShape:
    """Of a vehicle whose covariance is stated in the body's axes; it points elsewhere than east."""
    cos, sin = np.cos(_YAW_RAD), np.sin(_YAW_RAD)
    axes = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
    numbers = (jnp.float32(3.0), jnp.float32(-2.0), jnp.float32(_YAW_RAD))
    moment = ToolMoment(*numbers, jnp.asarray(axes @ body @ axes.T, jnp.float32), jnp.asarray(on))
    shape: ClaimedShape = claimed_shape(TOOL, moment, jnp.float32(level), jnp.float32(shared_m))
    return shape


def over_now(errors: np.ndarray, places: np.ndarray) -> np.ndarray:
    """Share of the draws in which the tool is over each place of the body's axes: plain geometry in float64."""
    cos, sin = np.cos(errors[:, 2, None]), np.sin(errors[:, 2, None])
    x, y = (places[None, :, axis] - errors[:, axis, None] for axis in (0, 1))
    over = np.abs(cos * x + sin * y - TOOL.ahead_m) <= 0.5 * TOOL.length_m
    over &= np.abs(cos * y - sin * x - TOOL.left_m) <= 0.5 * TOOL.width_m
    share: np.ndarray = over.mean(axis=0)
    return share


@pytest.mark.parametrize("level", [0.9, 0.95, 0.996])
@pytest.mark.parametrize("name", ERRORS)
def test_its_border_is_where_the_level_is_reached(name: str, level: float) -> None:
    body = covariance_of(*ERRORS[name])
    border = np.asarray(shape_of(body, level).border_m, np.float64)
    drawn = over_now(drawn_errors(body, 16, 5), border)
    assert np.abs(drawn - level).max() < 0.15 * (1.0 - level) + 1e-3
    # Convex, so that its corners speak for it; a little beyond them the level is missed, within it is reached.
    polygon = shapely.Polygon(border)
    assert polygon.area > 0.98 * polygon.convex_hull.area
    centre = np.array([TOOL.ahead_m, TOOL.left_m])
    errors = drawn_errors(body, 16, 6)
    assert np.all(over_now(errors, centre + 0.9 * (border - centre)) > level)
    assert np.all(over_now(errors, centre + 1.1 * (border - centre)) < level)


def test_a_pass_claims_the_width_that_draws_tell() -> None:
    """Of a straight pass only what is aside counts; the tool ahead swings with the heading."""
    body = covariance_of(*ERRORS["after an outage"])
    shape = shape_of(body, 0.95)
    errors = drawn_errors(body, 16, 7)
    for side in (float(shape.right_m), float(shape.left_m)):
        # The tool's nearest and farthest end pass a place at different offsets: one of them is enough.
        offsets = [errors[:, 1] + (TOOL.ahead_m + r) * errors[:, 2] - side for r in (-0.2, 0.2)]
        reached = np.min(np.abs(offsets), axis=0) <= 0.5 * TOOL.width_m
        assert np.mean(reached) == pytest.approx(0.95, abs=0.004)


def test_it_holds_the_sources_shapes_and_little_more() -> None:
    """MF: the cached shape of the smallest errors that are not smaller; the exact one is larger, for errors between."""
    position_m, heading_rad = np.array([0.01, 0.02, 0.04]), np.radians([0.25, 0.5, 1.0])
    cache = make_shapes(TOOL, 0.95, position_m, heading_rad, draws=4000)
    ahead, left = (
        size * (np.arange(parts + 1) / parts - 0.5) for size, parts in ((TOOL.length_m, 16), (TOOL.width_m, 48))
    )
    areas = []
    for share in (0.55, 0.8, 1.0):
        body = covariance_of((0.04 * share, 0.04 * share, np.radians(1.0) * share), 0.0)
        cached = choose_shape(cache, body * (1.0 - 1e-9))
        assert cached is not None
        exact = shapely.Polygon(np.asarray(shape_of(body, 0.95).border_m, np.float64))
        x, y = np.meshgrid(TOOL.ahead_m + ahead, TOOL.left_m + left, indexing="ij")
        cells = shapely.box(x[:-1, :-1], y[:-1, :-1], x[1:, 1:], y[1:, 1:])[cached]
        stamped = shapely.union_all(cells)
        assert stamped.difference(exact).area < 0.004 * exact.area
        areas.append((stamped.area, exact.area))
    (first, *_, last), exact_areas = areas, [area for _, area in areas]
    # Where the cache has these very errors both are the same but for its coarse parts.
    assert last[0] > 0.8 * last[1]
    assert first[0] < 0.85 * first[1]
    assert exact_areas == sorted(exact_areas, reverse=True)


def test_what_cannot_count_has_no_shape() -> None:
    good = covariance_of(*ERRORS["fixed"])
    assert np.isfinite(np.asarray(shape_of(good, 0.95).border_m)).all()
    shrunk = shape_of(good, 0.95, shared_m=0.05)
    assert float(shrunk.left_m) < float(shape_of(good, 0.95).left_m) - 0.05
    vague = good + np.diag([0.0, 0.0, 0.1**2])
    broken = good.copy()
    broken[0, 0] = np.nan
    for covariance in (vague, broken, good + np.diag([0.3**2, 0.0, 0.0])):
        assert np.isnan(np.asarray(shape_of(covariance, 0.95).border_m)).all()
    assert float(shape_of(vague, 0.95).left_m) == float(shape_of(vague, 0.95).right_m) == 0.0
