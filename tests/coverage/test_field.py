"""Fields of three driven corners and of polygons: what is taken, what is squared, what is refused."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from matplotlib.path import Path as Outline

from lgprjax.coverage import Field, field_of_corners, field_of_polygon
from lgprjax.coverage.field import SQUARED_M, contains, first_crossing, outside_m, side_distance_m
from refusals import refused

NOTCHED = np.array(
    [[0.0, 0.0], [30.0, 0.0], [30.0, 20.0], [20.0, 20.0], [20.0, 8.0], [10.0, 8.0], [10.0, 20.0], [0.0, 20.0]]
)


def angles_deg(field: Field) -> np.ndarray:
    sides = np.roll(field.perimeter_m, -1, axis=0) - field.perimeter_m
    yaw = np.arctan2(sides[:, 1], sides[:, 0])
    return np.asarray(np.degrees(np.mod(np.roll(yaw, -1) - yaw, 2.0 * np.pi)))


@settings(deadline=None, max_examples=15)
@given(
    yaw=st.floats(-math.pi, math.pi),
    sides=st.tuples(st.floats(3.0, 300.0), st.floats(3.0, 300.0)),
    moved=st.floats(-0.99 * SQUARED_M, 0.99 * SQUARED_M),
    hand=st.sampled_from([1.0, -1.0]),
)
def test_three_corners_driven_in_either_sense_make_the_rectangle(
    yaw: float, sides: tuple[float, float], moved: float, hand: float
) -> None:
    ahead = np.array([math.cos(yaw), math.sin(yaw)])
    left = hand * np.array([-ahead[1], ahead[0]])
    first = np.array([12.0, -7.0])
    second, square = first + sides[0] * ahead, first + sides[0] * ahead + sides[1] * left
    # Where the lean of three metres is a turn too wide for tolerance in degrees, metres still count.
    field = field_of_corners(np.stack([first, second, square + moved * ahead]), name="corners")
    np.testing.assert_allclose(angles_deg(field), 90.0, atol=1e-6)
    assert math.isclose(field.area_m2, sides[0] * sides[1], rel_tol=1e-9)
    driven = {tuple(np.round(corner, 6)) for corner in (first, second)}
    assert driven == {tuple(np.round(corner, 6)) for corner in field.perimeter_m[:2]}
    away = np.hypot(*(field.perimeter_m - square).T)
    assert away.min() < 1e-6


def test_corners_further_from_square_keep_their_places_and_make_a_parallelogram() -> None:
    corners = np.array([[0.0, 0.0], [30.0, 0.0], [30.0 + SQUARED_M + 0.01, 20.0]])
    field = field_of_corners(corners, name="corners")
    np.testing.assert_array_equal(field.perimeter_m[:3], corners)
    np.testing.assert_allclose(field.perimeter_m[3], [SQUARED_M + 0.01, 20.0])
    assert math.isclose(field.area_m2, 600.0)


@pytest.mark.parametrize(
    ("corners", "place", "values"),
    [
        ([[0.0, 0.0], [10.0, 0.0], [20.0, 0.0]], "corner 2", (30, 150, "0.0 degrees")),
        ([[0.0, 0.0], [10.0, 0.0], [20.0, 5.0]], "corner 2", ("26.6 degrees",)),
        ([[0.0, 0.0], [10.0, 0.0], [2.0, 0.5]], "corner 2", ("176.4 degrees",)),
        ([[0.0, 0.0], [0.0, 0.0], [10.0, 5.0]], "corners", ()),
        ([[0.0, 0.0], [30.0, 0.0], [30.0, 200e3]], "corners", ("2 km", "200.0 km")),
        ([[90e3, 0.0], [90e3, 30.0], [90.02e3, 30.0]], "corners", ("10 km", "90.0 km")),
        ([[0.0, 0.0], [30.0, math.nan], [30.0, 20.0]], "corner 2", ("nan",)),
        ([[0.0, 0.0], [0.5, 0.0], [0.5, 0.6]], "perimeter", ("1 m²", "0.30 m²")),
    ],
)
def test_bad_corners_are_refused_with_the_reason(
    corners: list[list[float]], place: str, values: tuple[object, ...]
) -> None:
    with refused(place, *values, file="mine-07"):
        field_of_corners(np.array(corners), name="mine-07")


def test_a_polygon_is_turned_counter_clockwise_about_its_first_side() -> None:
    ring = np.concatenate([NOTCHED, NOTCHED[:1]])
    np.testing.assert_array_equal(field_of_polygon(ring, name="ring").perimeter_m, NOTCHED)
    clockwise = field_of_polygon(ring[::-1], name="ring").perimeter_m
    # Its first side led from (0, 0) to (0, 20).
    np.testing.assert_array_equal(clockwise[:2], [[0.0, 20.0], [0.0, 0.0]])
    np.testing.assert_array_equal(np.roll(clockwise, -1, axis=0), NOTCHED)
    assert math.isclose(field_of_polygon(ring[::-1], name="ring").area_m2, 480.0)


@pytest.mark.parametrize(
    ("points", "place", "values"),
    [
        ([], "corners", (0,)),
        ([[0.0, 0.0], [5.0, 5.0], [0.0, 0.0]], "corners", (2,)),
        ([[0.0, 0.0], [10.0, 0.0], [20.0, 0.04], [5.0, 0.03]], "corners", ("0.04 m",)),
        ([[0.0, 0.0], [20.0, 20.0], [20.0, 0.0], [0.0, 20.0]], "perimeter", (1, 3)),
        ([[0.0, 0.0], [20.0, 0.0], [20.0, 10.0], [10.0, 0.0], [0.0, 10.0]], "perimeter", (1, 3)),
        ([[0.0, 0.0], [20.0, 0.0], [20.0, 10.0], [20.0, 5.0], [0.0, 10.0]], "perimeter", (2, 3)),
    ],
)
def test_bad_polygons_are_refused_with_the_reason(
    points: list[list[float]], place: str, values: tuple[object, ...]
) -> None:
    with refused(place, *values, file="field"):
        field_of_polygon(np.array(points, np.float64).reshape(-1, 2), name="field")


@settings(deadline=None, max_examples=15)
@given(seed=st.integers(0, 2**31))
def test_inside_and_distances_agree_with_other_means(seed: int) -> None:
    rng = np.random.default_rng(seed)
    # A star about the origin: simple, and mostly concave.
    yaw = np.linspace(0.0, 2.0 * np.pi, 9, endpoint=False) + rng.uniform(0.0, 0.6, 9)
    corners = rng.uniform(3.0, 20.0, 9)[:, None] * np.stack([np.cos(yaw), np.sin(yaw)], axis=1)
    places = rng.uniform(-22.0, 22.0, (300, 2))
    inside = Outline(np.concatenate([corners, corners[:1]])).contains_points(places)
    np.testing.assert_array_equal(contains(corners, places), inside)
    share = np.linspace(0.0, 1.0, 400)[:, None, None]
    dense = (corners + share * (np.roll(corners, -1, axis=0) - corners)).reshape(-1, 2)
    nearest = np.min(np.hypot(*(places[:, None] - dense).transpose(2, 0, 1)), axis=1)
    found = side_distance_m(corners, places)
    assert np.all(found <= nearest + 1e-9)
    np.testing.assert_allclose(found, nearest, atol=0.06)
    np.testing.assert_array_equal(outside_m(corners, places), np.where(inside, 0.0, found))
    assert first_crossing(corners) is None


@settings(deadline=None, max_examples=15)
@given(st.integers(4, 12), st.integers(0, 11), st.floats(0.2, 1.0))
def test_two_corners_of_a_convex_polygon_changed_for_each_other_cross(count: int, place: int, flat: float) -> None:
    yaw = 2.0 * np.pi * np.arange(count) / count
    corners = 10.0 * np.stack([np.cos(yaw), flat * np.sin(yaw)], axis=1)
    assert first_crossing(corners) is None
    swapped = corners.copy()
    swapped[[place % count, (place + 1) % count]] = corners[[(place + 1) % count, place % count]]
    assert first_crossing(swapped) is not None
