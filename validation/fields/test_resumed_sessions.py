"""Fields worked in sessions that are killed: a small one, one by two machines, and a hectare killed ten times."""

from collections.abc import Callable

import jax
import numpy as np

from lgprjax.coverage import (
    PatternSettings,
    cell_states,
    field_of_polygon,
    grid_of_field,
    inside_cells,
    lay_pattern,
    plan_pattern,
)
from lgprjax.coverage.resume import (
    Resumption,
    RoutePlace,
    place_of_tool,
    resume_place,
    route_from,
    share_of_lines,
    worked_stretches,
)
from lgprjax.simulation.field_loop import FieldLoopSpec, made_up_field_world, rectangle_course, run_fields
from validation.fields.sessions import TOOL, hole_m, map_of, span_of, work_in_sessions


def test_a_small_field_killed_twice_is_worked_to_its_end() -> None:
    found = work_in_sessions(12.0, 5.0, kills=2, cell_m=0.1, seed=3)
    assert found.kills == 2
    assert max(found.repeated_m) < 2.0
    assert found.omitted_m < 0.05
    assert found.share > 0.95


def test_two_machines_on_one_field_leave_nothing_and_little_twice(
    record_property: Callable[[str, object], None],
) -> None:
    """Lines 1 to 3 and 4 to 5; both are cut short, hand over their maps, and go on side by side."""
    settings = PatternSettings(1.2, 0.2, "boustrophedon", 1.5, 8.0, 1.2)
    length_m, width_m = 12.0, 5.0
    course = rectangle_course(length_m, width_m, settings, TOOL)
    corners = np.array([[0.0, 0.0], [length_m, 0.0], [length_m, width_m], [0.0, width_m]])
    pattern = plan_pattern(field_of_polygon(corners, name="field"), settings, name="field")
    route, grid, world = lay_pattern(pattern), grid_of_field(course.field, 0.1, 1.2), made_up_field_world()
    assert len(pattern.lines) == 5
    spans: list[list[tuple[float, float]]] = [[] for _ in pattern.lines]
    probability = np.zeros(grid.shape, np.float32)
    places, repeated_m = [RoutePlace(0, 0.0), RoutePlace(3, 0.0)], 0.0
    # Moments before the power goes: the first machine in its second line, the other one in its first.
    cut = [1150, 700]
    for session in range(2):
        maps, before = [], probability.copy()
        for machine in range(2):
            place = places[machine]
            stretches = worked_stretches(pattern, grid, cell_states(before, 0.95) == 2, TOOL, after=place)
            stretches = share_of_lines(pattern, stretches, (2, None)[machine])
            rest = route_from(route, pattern, Resumption(place, stretches))
            key = jax.random.key(70 + 10 * session + machine)[None]
            kept = run_fields(FieldLoopSpec(moments=2400), world, rest, course.fence, key)
            kept = jax.tree.map(lambda leaf: np.asarray(leaf)[:, 0], kept)
            done = bool(kept.done.any())
            until = cut[machine] if session == 0 else int(np.argmax(kept.done))
            assert done or session == 0
            kept = jax.tree.map(lambda leaf, end=until: leaf[:end], kept)
            on = (kept.tool > 0.5) & kept.engaged
            for number in np.unique(kept.line[on & (kept.line >= 0)]):
                low, high = span_of(pattern, kept, on & (kept.line == number), int(number))
                repeated_m += sum(max(min(high, b) - max(low, a), 0.0) for a, b in spans[number])
                spans[number].append((low, high))
            maps.append(map_of(grid, TOOL, kept, on))
            at = np.flatnonzero(on & (kept.line >= 0))[-1]
            pose = tuple(float(each[at]) for each in (kept.believed.x_m, kept.believed.y_m, kept.believed.yaw_rad))
            last = place_of_tool(pattern, TOOL, int(kept.line[at]), (pose[0], pose[1], pose[2]))
            places[machine] = resume_place(pattern, last) or places[machine]
        probability = np.maximum(probability, np.maximum(*maps))
    omitted_m = sum(hole_m(spans[number], line.length_m) for number, line in enumerate(pattern.lines))
    share = float(np.mean(cell_states(probability, 0.95)[inside_cells(course.field, grid)] == 2))
    for name, value in (("repeated_m", repeated_m), ("omitted_m", omitted_m), ("share", share)):
        record_property(name, value)
    assert omitted_m < 0.05
    # A resumption each: a metre back, and half a tool.
    assert repeated_m < 2.0 * 2.0
    assert share > 0.95


def test_a_hectare_killed_ten_times_is_worked_to_its_end(record_property: Callable[[str, object], None]) -> None:
    """Some 15 minutes: 6.8 km of way, eleven sessions or more."""
    found = work_in_sessions(100.0, 100.0, kills=10, cell_m=0.1, seed=5)
    record_property("repeated_mean_m", float(np.mean(found.repeated_m)))
    record_property("repeated_most_m", max(found.repeated_m))
    record_property("omitted_m", found.omitted_m)
    record_property("share", found.share)
    assert found.kills == 10
    assert max(found.repeated_m) < 2.0
    assert found.omitted_m < 0.05
