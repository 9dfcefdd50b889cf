"""Free plans taken up again: of what their swaths' edges work nothing is left out, and what is done is not driven."""

from functools import cache
from typing import NamedTuple

import numpy as np
import pytest
from jaxtyping import Bool, Float

from lgprjax.coverage import (
    CellGrid,
    CoverRoute,
    Field,
    Outline,
    Pattern,
    PatternSettings,
    Tool,
    field_of_polygon,
    grid_of_field,
    ground_of_sides,
    inside_cells,
    lay_pattern,
    outline_of,
    plan_gaps,
)
from lgprjax.coverage.field import cell_centres
from lgprjax.coverage.resume import Resumption, RoutePlace, route_from, worked_stretches
from lgprjax.coverage.tour import plan_tour
from validation.fields.random_fields import draw_field

TOOL = Tool(1.2, 0.3, 1.2, 0.0)
OUTLINE = outline_of(TOOL, Outline(1.4, -0.5, 0.65, -0.65), track_m=1.1)
BOX = np.array([[0.0, 0.0], [12.0, 0.0], [12.0, 7.0], [0.0, 7.0]])
L_SHAPE = np.array([[0, 0], [14, 0], [14, 6], [7, 6], [7, 11], [0, 11]], float)
EDGE_M = 0.09
"""Of the tool, on either side, that a pass leaves below 95 %."""


class FreePlan(NamedTuple):
    """A plan, and what was worked before it began."""

    pattern: Pattern
    tool: Tool
    grid: CellGrid
    before: Bool[np.ndarray, "north east"]


@cache
def free_plan(name: str) -> FreePlan:
    if name.startswith("drawn"):
        drawn = draw_field(int(name.split()[1]))
        tour = plan_tour(
            drawn.field, drawn.ground, drawn.keep_outs_m, drawn.settings, drawn.tool, drawn.outline, name=name
        )
        grid = grid_of_field(drawn.field, 0.1, drawn.tool.width_m)
        return FreePlan(tour.pattern, drawn.tool, grid, np.zeros(grid.shape, bool))
    field = field_of_polygon(L_SHAPE if name == "l" else BOX, name=name)
    grid = grid_of_field(field, 0.1, TOOL.width_m)
    before = np.zeros(grid.shape, bool)
    settings = PatternSettings(1.2, 0.35, "free", 1.5, 6.0, 1.2)
    rooms = [6.0] * len(field.perimeter_m)
    if name != "gaps":
        rooms[0] = rooms[2] = 0.0
        ground = ground_of_sides(field.perimeter_m, rooms, (), 0.25)
        return FreePlan(plan_tour(field, ground, (), settings, TOOL, OUTLINE, name=name).pattern, TOOL, grid, before)
    before = worked_before(field, grid)
    ground = ground_of_sides(field.perimeter_m, rooms, (), 0.25)
    made = plan_gaps(field, before, grid, ground, settings, TOOL, OUTLINE, name=name)
    assert made is not None
    return FreePlan(made.pattern, TOOL, grid, before)


def worked_before(field: Field, grid: CellGrid) -> Bool[np.ndarray, "north east"]:
    """All but rectangles turned any way."""
    east, north = np.meshgrid(*cell_centres(grid))
    rng = np.random.default_rng(5)
    before = np.ones(grid.shape, bool)
    for _ in range(7):
        x, y = rng.uniform(field.perimeter_m.min(axis=0), field.perimeter_m.max(axis=0))
        turned, length_m, width_m = rng.uniform(0.0, np.pi), rng.uniform(1.0, 6.0), rng.uniform(0.3, 1.5)
        ahead = (east - x) * np.cos(turned) + (north - y) * np.sin(turned)
        aside = (north - y) * np.cos(turned) - (east - x) * np.sin(turned)
        before &= ~((np.abs(ahead) < 0.5 * length_m) & (np.abs(aside) < 0.5 * width_m))
    return before


def claimed(
    plan: FreePlan, number: int, along_m: Float[np.ndarray, " step"], step_m: float
) -> Bool[np.ndarray, "north east"]:
    """Cells that a pass over a line claims, its tool's centre driven on from each of these places by a step."""
    line = plan.pattern.lines[number]
    east, north = np.meshgrid(*cell_centres(plan.grid))
    along = (line.end_m - line.start_m) / line.length_m
    ahead = (east - line.start_m[0]) * along[0] + (north - line.start_m[1]) * along[1]
    aside = (north - line.start_m[1]) * along[0] - (east - line.start_m[0]) * along[1]
    before = np.searchsorted(along_m, ahead, side="right") - 1
    on = (before >= 0) & (ahead - along_m[np.maximum(before, 0)] <= step_m + 1e-3) & (ahead <= line.length_m)
    return np.asarray(on & (np.abs(aside) <= 0.5 * plan.tool.width_m - EDGE_M))


def driven(plan: FreePlan, route: CoverRoute, taken_up: Resumption) -> Bool[np.ndarray, "north east"]:
    """Cells that the rest of a route claims, by the rows that have the tool on."""
    pattern, tool = plan.pattern, plan.tool
    rest = route_from(route, pattern, taken_up)
    rows, line = np.asarray(rest.rows, np.float64)[: int(rest.count)], np.asarray(rest.line)[: int(rest.count)]
    found = np.zeros(plan.grid.shape, bool)
    for number, of in enumerate(pattern.lines):
        own = rows[(line == number) & (rows[:, 4] > 0.5)]
        if len(own):
            along = (of.end_m - of.start_m) / of.length_m
            centres = own[:, :2] + tool.ahead_m * along + tool.left_m * np.array([-along[1], along[0]])
            found |= claimed(plan, number, np.sort((centres - of.start_m) @ along), float(rest.spacing_m))
    return found


@pytest.mark.parametrize("name", ["l", "gaps", "drawn 11"])
def test_nothing_of_a_free_plan_is_left_out(name: str) -> None:
    plan = free_plan(name)
    inside = inside_cells(plan.pattern.field, plan.grid)
    route = lay_pattern(plan.pattern)
    worked = plan.before.copy()
    for number, line in enumerate(plan.pattern.lines):
        place = RoutePlace(number, 0.0)
        stretches = worked_stretches(plan.pattern, plan.grid, worked, plan.tool, after=place, edge_m=EDGE_M)
        left = inside & ~worked
        whole = driven(plan, route, Resumption(place, ())) & left
        np.testing.assert_array_equal(driven(plan, route, Resumption(place, stretches)) & left, whole)
        worked |= claimed(plan, number, np.zeros(1), line.length_m)


def test_swaths_that_another_machine_has_driven_are_passed_with_the_tool_off() -> None:
    plan = free_plan("l")
    worked = np.zeros(plan.grid.shape, bool)
    others = [number for number in range(len(plan.pattern.lines)) if number % 3 != 1]
    for number in others:
        worked |= claimed(plan, number, np.zeros(1), plan.pattern.lines[number].length_m)
    found = worked_stretches(plan.pattern, plan.grid, worked, plan.tool, edge_m=EDGE_M)
    off_m = sum(each.high_m - each.low_m for each in found if each.line in others)
    way_m = sum(plan.pattern.lines[number].length_m for number in others)
    assert off_m > 0.9 * way_m
    # Where the rest is another machine's share, its lines do none of one's own work.
    share = worked_stretches(plan.pattern, plan.grid, worked, plan.tool, last_line=1, edge_m=EDGE_M)
    assert {each.line for each in share} <= {0, 1}
    # With nothing left nothing is driven.
    everything = np.ones(plan.grid.shape, bool)
    found = worked_stretches(plan.pattern, plan.grid, everything, plan.tool, edge_m=EDGE_M)
    assert [(each.line, each.low_m, each.high_m) for each in found] == [
        (number, 0.0, line.length_m) for number, line in enumerate(plan.pattern.lines)
    ]
