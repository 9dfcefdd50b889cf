"""Lines over a field: their count and spacing in closed form, their pieces against a raster."""

import math
from itertools import pairwise

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from matplotlib.path import Path as Outline

from lgprjax.coverage import field_of_polygon
from lgprjax.coverage.swaths import (
    MOST_LINES,
    from_lines,
    join_spans,
    lay_strips,
    lines_heading_rad,
    strip_pieces,
    to_lines,
)
from refusals import refused

BOX = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])


@settings(deadline=None, max_examples=15)
@given(
    across_m=st.floats(2.0, 200.0),
    along_m=st.floats(2.0, 100.0),
    width_m=st.floats(0.5, 2.0),
    overlap=st.floats(0.0, 0.8),
)
def test_lines_of_a_rectangle_reach_both_edges_with_at_least_the_overlap(
    across_m: float, along_m: float, width_m: float, overlap: float
) -> None:
    laid = lay_strips(BOX * [along_m, across_m] + [5.0, -3.0], width_m, overlap, name="box")
    middles = np.array([strip.across_m for strip in laid.strips])
    assert all(strip.pieces_m == ((5.0, 5.0 + along_m),) for strip in laid.strips)
    largest = (1.0 - overlap) * width_m
    np.testing.assert_allclose([middles[0] - width_m / 2, middles[-1] + width_m / 2], [-3.0, across_m - 3.0], atol=1e-9)
    np.testing.assert_allclose(np.diff(middles), laid.spacing_m, atol=1e-9)
    assert laid.spacing_m <= largest + 1e-6
    # One line fewer would lie too far apart.
    if len(middles) > 2:
        assert (across_m - width_m) / (len(middles) - 2) > largest


def test_the_count_is_that_of_the_closed_form() -> None:
    for across_m, width_m, overlap, count in ((20.0, 1.0, 0.0, 20), (20.0, 1.0, 0.1, 23), (1.0, 1.0, 0.3, 1)):
        laid = lay_strips(BOX * [30.0, across_m], width_m, overlap, name="box")
        assert len(laid.strips) == count
        assert math.isclose(laid.spacing_m, (across_m - width_m) / (count - 1) if count > 1 else 0.0)


def test_a_field_narrower_than_the_tool_and_too_many_lines_are_refused() -> None:
    with refused("field", "1.20 m", file="strip", found="1.00 m"):
        lay_strips(BOX * [30.0, 1.0], 1.2, 0.1, name="strip")
    with refused("lines", MOST_LINES, file="wide", found=2999):
        lay_strips(BOX * [30.0, 1500.0], 1.0, 0.5, name="wide")


def test_lines_run_along_the_first_side_or_the_heading_asked_for() -> None:
    field = field_of_polygon(
        np.array([[1.0, 2.0], [1.0 + 10.0 * math.cos(2.0), 2.0 + 10.0 * math.sin(2.0)], [-20.0, 0.0]]), name="f"
    )
    assert math.isclose(lines_heading_rad(field, None), 2.0)
    assert lines_heading_rad(field, -0.4) == -0.4
    turned = to_lines(field.perimeter_m, 2.0)
    assert math.isclose(turned[0, 1], turned[1, 1])
    assert math.isclose(turned[1, 0] - turned[0, 0], 10.0)
    np.testing.assert_allclose(from_lines(turned, 2.0), field.perimeter_m, atol=1e-12)


@settings(deadline=None, max_examples=15)
@given(seed=st.integers(0, 2**31))
def test_the_pieces_of_a_strip_hold_the_fields_ground_in_it_and_no_more(seed: int) -> None:
    rng = np.random.default_rng(seed)
    yaw = np.linspace(0.0, 2.0 * np.pi, 11, endpoint=False) + rng.uniform(0.0, 0.5, 11)
    corners = rng.uniform(3.0, 20.0, 11)[:, None] * np.stack([np.cos(yaw), np.sin(yaw)], axis=1)
    middle, width = rng.uniform(-10.0, 10.0), rng.uniform(0.5, 3.0)
    step = 0.05
    along = np.arange(-21.0, 21.0, step)
    low, high = middle - width / 2.0, middle + width / 2.0
    # Ground comes to a tip at corners and at the strip's edges: there the raster looks closely.
    tips = np.concatenate([corners[:, 1] - 1e-6, corners[:, 1] + 1e-6, [low + 1e-6, high - 1e-6]])
    across = np.concatenate([np.linspace(low, high, 121)[1:-1], tips[(tips > low) & (tips < high)]])
    grid = np.stack(np.meshgrid(along, across, indexing="ij"), axis=-1)
    ground = (
        Outline(np.concatenate([corners, corners[:1]])).contains_points(grid.reshape(-1, 2)).reshape(grid.shape[:2])
    )
    found = ground.any(axis=1)
    pieces = strip_pieces(corners, middle, width)
    claimed = np.zeros(len(along), bool)
    for begin, end in pieces:
        claimed |= (along >= begin - 1e-9) & (along <= end + 1e-9)
    assert not np.any(found & ~claimed)
    # Where a piece has no ground of the raster: a gap that was closed.
    empty = claimed & ~found
    runs = np.diff(np.flatnonzero(np.diff(np.concatenate([[0], empty.astype(int), [0]]))))[::2] * step
    assert np.all(runs < width + 2 * step)
    assert all(later[0] - earlier[1] >= width for earlier, later in pairwise(pieces))


def test_intervals_closer_than_the_gap_are_one() -> None:
    assert join_spans([(5.0, 6.0), (0.0, 1.0), (1.5, 3.0), (2.0, 2.5)], 1.0) == ((0.0, 3.0), (5.0, 6.0))
    assert join_spans([], 1.0) == ()
