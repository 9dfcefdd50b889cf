"""Plans for gaps: every cell left out lies in a line's tool, or on the list of what is not reached."""

from dataclasses import replace

import numpy as np
import pytest

from lgprjax.coverage import (
    CellGrid,
    Field,
    Line,
    PatternSettings,
    field_of_polygon,
    grid_of_field,
    inside_cells,
    plan_gaps,
)
from lgprjax.coverage.field import outside_m
from lgprjax.coverage.turns import poses_along
from lgprjax.errors import InputError

FLAIL = PatternSettings(
    tool_width_m=1.2, overlap=0.1, order="zamboni", smallest_radius_m=1.5, turning_room_m=8.0, tool_ahead_m=1.0
)
CELL_M = 0.1


def field_and_grid(yaw_rad: float = 0.4) -> tuple[Field, CellGrid]:
    cos, sin = np.cos(yaw_rad), np.sin(yaw_rad)
    corners = np.array([[0.0, 0.0], [30.0, 0.0], [30.0, 20.0], [0.0, 20.0]]) @ np.array([[cos, sin], [-sin, cos]])
    field = field_of_polygon(corners, name="field")
    return field, grid_of_field(field, CELL_M, 1.0)


def centres(grid: CellGrid) -> np.ndarray:
    north, east = np.mgrid[: grid.north_cells, : grid.east_cells] + 0.5
    return np.stack([grid.east_m + east * grid.cell_m, grid.north_m + north * grid.cell_m], axis=-1)


def under_tool(lines: tuple[Line, ...], places: np.ndarray, spare_m: float = 0.0) -> np.ndarray:
    """Places in a line's tool, so far from its sides."""
    under = np.zeros(places.shape[:-1], bool)
    for line in lines:
        way = (line.end_m - line.start_m) / line.length_m
        along, aside = (places - line.start_m) @ way, (places - line.start_m) @ np.array([-way[1], way[0]])
        under |= (along > -1e-6) & (along < line.length_m + 1e-6) & (np.abs(aside) < FLAIL.tool_width_m / 2.0 - spare_m)
    return under


def test_nothing_left_out_needs_no_plan() -> None:
    field, grid = field_and_grid()
    assert plan_gaps(field, inside_cells(field, grid), grid, FLAIL, name="run") is None
    # What lies outside the field is no gap.
    with pytest.raises(InputError, match="run: map: expected"):
        plan_gaps(field, np.ones((3, 4), bool), grid, FLAIL, name="run")


@pytest.mark.parametrize("yaw_rad", [0.0, 0.4, 2.5])
def test_gaps_of_all_shapes_are_worked_and_little_else(yaw_rad: float) -> None:
    field, grid = field_and_grid(yaw_rad)
    places = centres(grid)
    local = places @ np.array([[np.cos(yaw_rad), -np.sin(yaw_rad)], [np.sin(yaw_rad), np.cos(yaw_rad)]])
    along, across = local[..., 0], local[..., 1]
    left = (
        ((along > 5.0) & (along < 15.0) & (across > 7.0) & (across < 7.3))
        | ((along > 20.0) & (along < 24.0) & (across > 12.0) & (across < 14.6))
        | ((along > 29.0) & (across > 19.2))
    ) & inside_cells(field, grid)
    pattern = plan_gaps(field, ~left, grid, FLAIL, name="run")
    assert pattern is not None
    assert pattern.unreached == ()
    assert np.all(under_tool(pattern.lines, places)[left])
    # The sliver: one line, in its middle, half a tool beyond each end.
    first = pattern.lines[0]
    assert first.length_m == pytest.approx(10.0 + 1.2, abs=0.3)
    ends = np.stack([first.start_m, first.end_m]) @ np.array(
        [[np.cos(yaw_rad), -np.sin(yaw_rad)], [np.sin(yaw_rad), np.cos(yaw_rad)]]
    )
    np.testing.assert_allclose(ends[:, 1], 7.15, atol=0.1)
    # The block: three lines of 4 m; the corner: one of 1 m.
    assert sum(line.length_m for line in pattern.lines) == pytest.approx(11.2 + 3 * 5.2 + 1.6, abs=1.0)
    assert len(pattern.turns) == len(pattern.lines) - 1
    for turn in pattern.turns:
        way = poses_along(turn.start, turn.pieces, np.linspace(0.0, turn.length_m, 300))[:, :2]
        assert outside_m(field.perimeter_m, way).max() <= FLAIL.turning_room_m + 1e-3
        assert turn.tightest_radius_m >= 1.5 - 1e-6


def test_gaps_of_one_strip_are_driven_straight_and_near_ones_are_one_line() -> None:
    field, grid = field_and_grid(0.0)
    places = centres(grid)
    along, across = places[..., 0], places[..., 1]
    strip = (across > 7.0) & (across < 7.5)
    left = strip & (
        ((along > 2.0) & (along < 5.0)) | ((along > 6.0) & (along < 9.0)) | ((along > 20.0) & (along < 22.0))
    )
    pattern = plan_gaps(field, ~left, grid, FLAIL, name="run")
    assert pattern is not None
    assert [round(line.length_m, 1) for line in pattern.lines] == [8.2, 3.2]
    np.testing.assert_array_equal(pattern.turns[0].pieces[:, 1], [0.0])
    assert pattern.turns[0].length_m == pytest.approx(11.0 - 1.2, abs=0.2)


def test_what_no_turn_leads_to_is_listed() -> None:
    field, grid = field_and_grid(0.0)
    places = centres(grid)
    along, across = places[..., 0], places[..., 1]
    # Two strips 3 m apart can be joined within 2.6 m of room, a third one beside the second cannot.
    left = (along > 5.0) & (along < 8.0) & (np.abs(across - 2.0) < 0.3)
    left |= (along > 5.0) & (along < 8.0) & (np.abs(across - 8.0) < 0.3)
    left |= (along > 5.0) & (along < 8.0) & (np.abs(across - 9.3) < 0.3)
    pattern = plan_gaps(field, ~left, grid, replace(FLAIL, turning_room_m=2.6), name="run")
    assert pattern is not None
    assert len(pattern.lines) + len(pattern.unreached) == 3
    assert len(pattern.unreached) == 1
    both = under_tool(pattern.lines, places) | under_tool(pattern.unreached, places)
    assert np.all(both[left])
    assert not np.all(under_tool(pattern.lines, places)[left])
    roomy = plan_gaps(field, ~left, grid, FLAIL, name="run")
    assert roomy is not None
    assert roomy.unreached == ()


def test_a_field_not_worked_at_all_is_planned_whole() -> None:
    field, grid = field_and_grid(0.4)
    pattern = plan_gaps(field, np.zeros(grid.shape, bool), grid, replace(FLAIL, overlap=0.0), name="run")
    assert pattern is not None
    assert pattern.unreached == ()
    inside = inside_cells(field, grid)
    # Whole cells, not their middles alone.
    half_m = 0.5 * CELL_M * (np.cos(0.4) + np.sin(0.4)) - 1e-6
    assert np.all(under_tool(pattern.lines, centres(grid), half_m)[inside])
    assert 17 <= len(pattern.lines) <= 20
