"""Work taken up again: the rest of a route lies on the whole one, begins at the place, and works all that is left."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from lgprjax.coverage import (
    CellGrid,
    CoverRoute,
    Pattern,
    PatternSettings,
    Tool,
    field_of_polygon,
    grid_of_field,
    lay_pattern,
    plan_pattern,
    route_point,
)
from lgprjax.coverage.resume import (
    Resumption,
    RoutePlace,
    WorkedStretch,
    line_arcs_m,
    place_of_tool,
    resume_place,
    route_from,
    worked_stretches,
)

POINT = jax.jit(route_point)
TOOL = Tool(1.2, 0.3, 1.2, 0.0)
SETTINGS = PatternSettings(1.2, 0.2, "boustrophedon", 1.5, 8.0, 1.2, heading_rad=0.3)


@pytest.fixture(scope="module")
def plan() -> tuple[Pattern, CoverRoute, CellGrid]:
    corners = np.array([[0.0, 0.0], [12.0, 1.0], [11.0, 9.0], [-1.0, 8.0]])
    field = field_of_polygon(corners, name="field")
    pattern = plan_pattern(field, SETTINGS, name="field")
    return pattern, lay_pattern(pattern), grid_of_field(field, 0.1, 1.2)


@pytest.mark.parametrize(("line", "along_m"), [(0, 0.0), (2, 3.37)])
def test_the_rest_of_a_route_is_that_of_the_whole(
    plan: tuple[Pattern, CoverRoute, CellGrid], line: int, along_m: float
) -> None:
    pattern, route, _ = plan
    rest = route_from(route, pattern, Resumption(RoutePlace(line, along_m), ()))
    assert rest.rows.shape == route.rows.shape
    begin_m = line_arcs_m(pattern)[line] + along_m
    shift_m = float(route.length_m) - float(rest.length_m)
    assert begin_m - 0.051 <= shift_m <= begin_m + 1e-3
    # At last a place before it, and the place where it begins.
    arcs = jnp.append(jnp.linspace(0.0, float(rest.length_m), 400), jnp.array([-5.0, begin_m - shift_m]))
    found, other = POINT(rest, arcs), POINT(route, arcs + jnp.float32(shift_m))
    one, other = (jax.tree.map(lambda part: np.asarray(part)[:400], each) for each in (found, other))
    np.testing.assert_allclose(np.hypot(one.x_m - other.x_m, one.y_m - other.y_m), 0.0, atol=2e-3)
    apart = np.abs(np.asarray(arcs)[:400] % float(route.spacing_m) - 0.5 * float(route.spacing_m)) < 0.02
    np.testing.assert_array_equal(np.asarray(one.line)[apart], np.asarray(other.line)[apart])
    np.testing.assert_array_equal(np.asarray(one.tool_on)[apart], np.asarray(other.tool_on)[apart])
    # Before it the way is straight and the tool off; the tool's centre is at the place where it begins.
    assert float(found.tool_on[-2]) == 0.0
    pose = (float(found.x_m[-1]), float(found.y_m[-1]), float(found.yaw_rad[-1]))
    assert place_of_tool(pattern, TOOL, line, pose).along_m == pytest.approx(along_m, abs=2e-3)


def test_what_another_machine_worked_is_passed_with_the_tool_off(plan: tuple[Pattern, CoverRoute, CellGrid]) -> None:
    pattern, route, _ = plan
    last = len(pattern.lines) - 1
    whole = tuple(WorkedStretch(each, 0.0, pattern.lines[each].length_m) for each in (last - 1, last))
    part = WorkedStretch(2, 4.0, 8.0)
    rest = route_from(route, pattern, Resumption(RoutePlace(1, 0.0), (part, *whole)))
    step_m, arcs = float(rest.spacing_m), line_arcs_m(pattern)
    begin_row = int(arcs[1] / step_m + 1e-6)
    on, line = np.asarray(rest.rows)[: int(rest.count), 4] > 0.5, np.asarray(rest.line)[: int(rest.count)]
    along = (np.arange(len(on)) + begin_row) * step_m - arcs[2]
    inner = (line == 2) & (along > 4.0) & (along < 7.9)
    assert not on[inner].any()
    assert on[(line == 2) & ~((along > 3.9) & (along < 8.1))].all()
    # Nothing is driven for what is done at the end.
    assert set(line[on]) == set(range(1, last - 1))
    end_m = arcs[last - 2] + pattern.lines[last - 2].length_m - begin_row * step_m
    assert float(rest.length_m) == pytest.approx(end_m, abs=0.11)


def test_worked_stretches_are_those_whose_own_cells_are(plan: tuple[Pattern, CoverRoute, CellGrid]) -> None:
    pattern, _, grid = plan
    line = pattern.lines[3]
    along = (line.end_m - line.start_m) / line.length_m
    north, east = np.mgrid[: grid.north_cells, : grid.east_cells] + 0.5
    places = np.stack([grid.east_m + east * 0.1, grid.north_m + north * 0.1], axis=-1) - line.start_m
    ahead, aside = places @ along, places @ np.array([-along[1], along[0]])
    worked = (np.abs(aside) < 0.56) & (ahead < 6.0)
    (found,) = worked_stretches(pattern, grid, worked, TOOL)
    assert (found.line, found.low_m) == (3, 0.0)
    assert found.high_m == pytest.approx(5.4, abs=0.2)
    assert worked_stretches(pattern, grid, worked, TOOL, after=RoutePlace(4, 0.0)) == ()
    # One cell that is not worked parts it; a narrower strip is none.
    hole = worked & ~((np.abs(ahead - 3.0) < 0.06) & (np.abs(aside) < 0.06))
    assert worked_stretches(pattern, grid, hole, TOOL) == ()
    assert worked_stretches(pattern, grid, worked & (np.abs(aside) < 0.4), TOOL) == ()


def test_the_place_to_go_on_from(plan: tuple[Pattern, CoverRoute, CellGrid]) -> None:
    pattern, _, _ = plan
    assert resume_place(pattern, RoutePlace(2, 5.0)) == RoutePlace(2, 4.0)
    assert resume_place(pattern, RoutePlace(2, 0.4)) == RoutePlace(2, 0.0)
    assert resume_place(pattern, RoutePlace(2, pattern.lines[2].length_m)) == RoutePlace(3, 0.0)
    last = len(pattern.lines) - 1
    assert resume_place(pattern, RoutePlace(last, pattern.lines[last].length_m)) is None
