"""Fields worked in sessions that are killed at random moments, and the maps of what was worked.

Each session begins as a new run does: its filter knows neither place nor heading, its map is what was taken up, its
route the rest of the plan. What it leaves behind are the moments that were recorded until it was killed.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from lgprjax.coverage import (
    CellGrid,
    Pattern,
    PatternSettings,
    Tool,
    ToolMoment,
    cell_states,
    field_of_polygon,
    grid_of_field,
    init_worked,
    inside_cells,
    lay_pattern,
    plan_pattern,
    run_worked,
)
from lgprjax.coverage.resume import (
    Resumption,
    RoutePlace,
    place_of_tool,
    resume_place,
    route_from,
    worked_stretches,
)
from lgprjax.simulation.field_loop import (
    FieldLoopSpec,
    made_up_field_world,
    made_up_tool,
    rectangle_course,
    run_fields,
)

TOOL = made_up_tool()
AT_ONCE = 4096


class Worked(NamedTuple):
    """What sessions came to.

    Attributes:
        kills: sessions that were killed.
        repeated_m: way over a line worked before, of each session but the first.
        omitted_m: of all lines together, way that the tool's rectangle never was on.
        share: of the field processed at 95 %.
    """

    kills: int
    repeated_m: list[float]
    omitted_m: float
    share: float


def work_in_sessions(
    length_m: float, width_m: float, *, kills: int, cell_m: float, seed: int, off_s: float = 0.0
) -> Worked:
    """A field worked to its end by sessions of which the first ones are killed."""
    settings = PatternSettings(1.2, 0.2, "boustrophedon", 1.5, 8.0, 1.2)
    course = rectangle_course(length_m, width_m, settings, TOOL)
    corners = np.array([[0.0, 0.0], [length_m, 0.0], [length_m, width_m], [0.0, width_m]])
    pattern = plan_pattern(field_of_polygon(corners, name="field"), settings, name="field")
    route = lay_pattern(pattern)
    grid = grid_of_field(course.field, cell_m, 1.2)
    world = made_up_field_world(off_s=off_s)
    rng = np.random.default_rng(seed)
    way_m = float(route.length_m)
    # As long as an average session and half as long again: those that are killed end somewhere within.
    moments = int(10.0 * (1.5 * way_m / (kills + 1) / float(world.set_speed_mps) + 90.0))
    probability = np.zeros(grid.shape, np.float32)
    spans: list[list[tuple[float, float]]] = [[] for _ in pattern.lines]
    place, repeated, killed = RoutePlace(0, 0.0), list[float](), 0
    for session in range(3 * kills + 6):
        stretches = worked_stretches(pattern, grid, cell_states(probability, 0.95) == 2, TOOL, after=place)
        rest = route_from(route, pattern, Resumption(place, stretches))
        key = jax.random.key(1000 * seed + session)[None]
        kept = run_fields(FieldLoopSpec(moments=moments), world, rest, course.fence, key)
        kept = jax.tree.map(lambda leaf: np.asarray(leaf)[:, 0], kept)
        done = bool(kept.done.any())
        until = int(np.argmax(kept.done)) if done else moments
        if killed < kills:
            until, done = int(rng.uniform(0.15, 0.75) * moments), False
            killed += 1
        kept = jax.tree.map(lambda leaf, end=until: leaf[:end], kept)
        on = (kept.tool > 0.5) & kept.engaged
        again_m = 0.0
        for number in np.unique(kept.line[on & (kept.line >= 0)]):
            low, high = span_of(pattern, kept, on & (kept.line == number), int(number))
            again_m += sum(max(min(high, b) - max(low, a), 0.0) for a, b in spans[number])
            spans[number].append((low, high))
        if session:
            repeated.append(again_m)
        probability = np.maximum(probability, map_of(grid, TOOL, kept, on))
        if done:
            break
        counted = np.flatnonzero(on & (kept.line >= 0))
        if len(counted):
            at = counted[-1]
            pose = tuple(float(each[at]) for each in (kept.believed.x_m, kept.believed.y_m, kept.believed.yaw_rad))
            following = resume_place(
                pattern, place_of_tool(pattern, TOOL, int(kept.line[at]), (pose[0], pose[1], pose[2]))
            )
            if following is None:
                break
            place = following
    omitted_m = sum(hole_m(spans[number], line.length_m) for number, line in enumerate(pattern.lines))
    inside = inside_cells(course.field, grid)
    return Worked(killed, repeated, omitted_m, float(np.mean(cell_states(probability, 0.95)[inside] == 2)))


def span_of(pattern: Pattern, kept, on: np.ndarray, number: int) -> tuple[float, float]:  # type: ignore[no-untyped-def]
    """From where to where along a line the tool's true rectangle was."""
    line = pattern.lines[number]
    along = (line.end_m - line.start_m) / line.length_m
    x, y = (
        kept.x_m[on] + TOOL.ahead_m * np.cos(kept.yaw_rad[on]),
        kept.y_m[on] + TOOL.ahead_m * np.sin(kept.yaw_rad[on]),
    )
    ahead = (x - line.start_m[0]) * along[0] + (y - line.start_m[1]) * along[1]
    half_m = 0.5 * TOOL.length_m
    return max(float(ahead.min()) - half_m, 0.0), min(float(ahead.max()) + half_m, line.length_m)


def hole_m(spans: list[tuple[float, float]], length_m: float) -> float:
    reached = hole = 0.0
    for low, high in sorted(spans):
        hole += max(low - reached, 0.0)
        reached = max(reached, high)
    return hole + max(length_m - reached, 0.0)


def map_of(  # type: ignore[no-untyped-def]
    grid: CellGrid, tool: Tool, kept, on: np.ndarray, shared_sigma_m: float = 0.0
) -> np.ndarray:
    """Probability of each cell by the moments of a drive at which the tool was on."""
    told = np.flatnonzero(on | np.roll(on, 1))
    state = init_worked(grid)
    for first in range(0, len(told), AT_ONCE):
        part = told[first : first + AT_ONCE]
        fill = np.append(part, np.full(AT_ONCE - len(part), part[-1]))
        count = on[fill] & (np.arange(AT_ONCE) < len(part))
        x, y, yaw = (jnp.asarray(each[fill]) for each in (kept.believed.x_m, kept.believed.y_m, kept.believed.yaw_rad))
        moment = ToolMoment(x, y, yaw, jnp.asarray(kept.covariance[fill]), jnp.asarray(count))
        state = run_worked(grid, tool, state, moment, shared_sigma_m)
    return np.asarray(state.probability)
