"""The route of a pattern: continuous, on its lines and turns, of one shape for like patterns."""

import math
from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from lgprjax.coverage import (
    CoverRoute,
    Pattern,
    PatternSettings,
    field_of_polygon,
    lay_pattern,
    plan_pattern,
    route_point,
)
from lgprjax.coverage.swaths import Order
from lgprjax.coverage.turns import poses_along
from refusals import refused

FLAIL = PatternSettings(
    tool_width_m=1.2, overlap=0.1, order="zamboni", smallest_radius_m=1.5, turning_room_m=8.0, tool_ahead_m=1.0
)
POINT = jax.jit(route_point)


def pattern_of_box(along_m: float, order: Order = "zamboni") -> Pattern:
    corners = np.array([[-4.0, 2.0], [-4.0 + 0.8 * along_m, 2.0 + 0.6 * along_m]])
    corners = np.concatenate([corners, corners[::-1] + 12.0 * np.array([-0.6, 0.8])])
    return plan_pattern(field_of_polygon(corners, name="box"), replace(FLAIL, order=order), name="box")


@pytest.fixture(scope="module", params=["zamboni", "boustrophedon"])
def laid(request: pytest.FixtureRequest) -> tuple[Pattern, CoverRoute]:
    pattern = pattern_of_box(20.0, request.param)
    return pattern, lay_pattern(pattern)


def test_rows_are_evenly_spaced_and_headings_join(laid: tuple[Pattern, CoverRoute]) -> None:
    pattern, route = laid
    rows = np.asarray(route.rows, np.float64)
    count, step = int(route.count), float(route.spacing_m)
    assert step <= 0.05
    np.testing.assert_allclose(step * (count - 1), pattern.length_m, rtol=1e-6)
    np.testing.assert_allclose(route.length_m, pattern.length_m, rtol=1e-6)
    # The next row is where this row's arc leads, padding included: straight on from the end.
    turn = rows[:-1, 3] * step
    chord = step * np.sinc(turn / 2.0 / np.pi)
    led = rows[:-1, :2] + chord[:, None] * np.stack(
        [np.cos(rows[:-1, 2] + turn / 2), np.sin(rows[:-1, 2] + turn / 2)], axis=1
    )
    assert np.hypot(*(led - rows[1:, :2]).T).max() < step**2 / 4.0 / pattern.tightest_radius_m + 2e-5
    assert np.abs(rows[:-1, 2] + turn - rows[1:, 2]).max() < 1e-4
    assert np.all(rows[count - 1 :, 3:] == 0.0)
    assert np.abs(rows[:, 3]).max() <= 1.0 / pattern.tightest_radius_m + 1e-3


def test_the_tool_is_on_over_whole_lines_and_off_in_turns(laid: tuple[Pattern, CoverRoute]) -> None:
    pattern, route = laid
    rows, line = np.asarray(route.rows, np.float64), np.asarray(route.line)
    np.testing.assert_array_equal(rows[:, 4], line >= 0)
    step = float(route.spacing_m)
    numbers = line[line >= 0]
    np.testing.assert_array_equal(numbers[np.flatnonzero(np.diff(numbers, prepend=-1))], np.arange(len(pattern.lines)))
    for number, each in enumerate(pattern.lines):
        own = np.flatnonzero(line == number)
        assert np.all(np.diff(own) == 1)
        yaw = rows[own, 2]
        centre = rows[own, :2] + FLAIL.tool_ahead_m * np.stack([np.cos(yaw), np.sin(yaw)], axis=1)
        way = (each.end_m - each.start_m) / each.length_m
        along = (centre - each.start_m) @ way
        aside = (centre - each.start_m) @ np.array([-way[1], way[0]])
        # From at the latest the line's start to at the earliest its end, a row's way more at the most.
        assert -step < along[0] <= 1e-4
        assert each.length_m - 1e-4 <= along[-1] + step < each.length_m + step
        assert np.abs(aside[1:]).max() < 1e-3


def test_points_between_rows_are_those_of_the_exact_way(laid: tuple[Pattern, CoverRoute]) -> None:
    pattern, route = laid
    pieces = [np.array([[pattern.lines[0].length_m, 0.0]])]
    for turn, each in zip(pattern.turns, pattern.lines[1:], strict=True):
        pieces += [turn.pieces, np.array([[each.length_m, 0.0]])]
    first = pattern.turns[0].start
    start = poses_along(first, np.array([[1.0, 0.0]]), np.array([-pattern.lines[0].length_m]))[0]
    arc = np.random.default_rng(3).uniform(-5.0, pattern.length_m + 5.0, 2000)
    exact = poses_along(type(first)(*start), np.concatenate(pieces), arc)
    found = POINT(route, jnp.asarray(arc.astype(np.float32)))
    away = np.hypot(np.asarray(found.x_m) - exact[:, 0], np.asarray(found.y_m) - exact[:, 1])
    assert away.max() < 1e-3
    assert np.abs(np.asarray(found.yaw_rad) - exact[:, 2]).max() < 0.5 * 0.05 / pattern.tightest_radius_m
    beyond = (arc < 0.0) | (arc > pattern.length_m)
    assert beyond.sum() > 20
    assert np.all(np.asarray(found.tool_on)[beyond] == 0.0)
    assert np.all(np.asarray(found.line)[beyond] == -1)
    assert np.all(np.asarray(found.curvature_radpm)[beyond] == 0.0)


def test_like_patterns_share_one_compile_and_what_is_no_number_stays_in_its_lane() -> None:
    routes = [lay_pattern(pattern_of_box(along_m)) for along_m in (20.0, 21.0)]
    assert routes[0].rows.shape == routes[1].rows.shape
    assert math.log2(routes[0].rows.shape[0]).is_integer()
    arc = jnp.linspace(-1.0, 200.0, 2000)
    points = [np.stack(POINT(route, arc)[:5]) for route in routes]
    assert not np.allclose(points[0], points[1])
    ill = np.stack(POINT(routes[0], arc.at[2].set(jnp.nan))[:5])
    assert np.isnan(ill[0, 2])
    np.testing.assert_allclose(np.delete(ill, 2, axis=1), np.delete(points[0], 2, axis=1), atol=1e-5)


def test_a_spacing_that_makes_no_route_is_refused() -> None:
    for spacing_m in (0.0, 1.5, math.nan):
        with refused("spacing_m", file="route", found=f"{spacing_m:g}"):
            lay_pattern(pattern_of_box(20.0), spacing_m=spacing_m)
