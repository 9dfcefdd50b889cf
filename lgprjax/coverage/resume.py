"""Work taken up again: the rest of a route, from line k and metre s on, with the tool off where the ground is worked.

A place is told by its line, in driving order, and how far along it the tool's centre is: it stays what it is when the
vehicle, the computer or the day changes. From the route's rows before it nothing is left but a straight way to it.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

from lgprjax.coverage.field import CellGrid, Tool
from lgprjax.coverage.guidance import CoverRoute
from lgprjax.coverage.pattern import Pattern
from lgprjax.coverage.swaths import Line
from lgprjax.frames import body_to_local

BACK_M = 1.0
"""By which work begins before the place where it ended: a pass is sure only some way after it begins."""
LEAST_STRETCH_M = 3.0
"""Shorter stretches of worked ground are not worth turning the tool off for."""
_INNER_M = 0.5
_STEP_M = 0.1


class RoutePlace(NamedTuple):
    """A place of a plan.

    Attributes:
        line: in driving order, from 0.
        along_m: of the tool's centre, from the line's start.
    """

    line: int
    along_m: float


class WorkedStretch(NamedTuple):
    """A stretch of a line that is worked: nothing is to be done there.

    Attributes:
        line: in driving order, from 0.
        low_m, high_m: along it.
    """

    line: int
    low_m: float
    high_m: float


class Resumption(NamedTuple):
    """What a plan's work is taken up with.

    Attributes:
        place: where; worked: what is done of the rest, by whichever machine.
    """

    place: RoutePlace
    worked: tuple[WorkedStretch, ...]


def place_of_tool(pattern: Pattern, tool: Tool, line: int, pose: tuple[float, float, float]) -> RoutePlace:
    """The place on a line of a vehicle's pose (x_m, y_m, yaw_rad)."""
    x_m, y_m, yaw_rad = (np.array([each], np.float64) for each in pose)
    (x,), (y,) = body_to_local(x_m, y_m, yaw_rad, tool.ahead_m, tool.left_m)
    of = pattern.lines[line]
    along = (of.end_m - of.start_m) / max(of.length_m, 1e-9)
    return RoutePlace(line, float(np.clip((np.array([x, y]) - of.start_m) @ along, 0.0, of.length_m)))


def resume_place(pattern: Pattern, last: RoutePlace, *, back_m: float = BACK_M) -> RoutePlace | None:
    """Where to go on after the last place worked; ``None`` after the last line's end.

    Args:
        pattern: the plan.
        last: place of the last moment that counted.
        back_m: overlap with what was worked.
    """
    line, along_m = last
    if along_m > pattern.lines[line].length_m - 1e-3:
        line, along_m = line + 1, 0.0
    return None if line >= len(pattern.lines) else RoutePlace(line, max(along_m - back_m, 0.0))


def worked_stretches(
    pattern: Pattern,
    grid: CellGrid,
    worked: Bool[np.ndarray, "north east"],
    tool: Tool,
    *,
    after: RoutePlace | None = None,
) -> tuple[WorkedStretch, ...]:
    """Stretches of lines over which all cells nearer to the line than to its neighbours are worked.

    Their ends are taken back by half a metre, and short ones are left out: the tool is rather on too long.

    Args:
        pattern: the plan.
        grid: of the cells.
        worked: cells that count as worked.
        tool: of the vehicle.
        after: only beyond this place.
    """
    # Of lines that overlap more than they need, each has to do its own middle alone.
    own_m = min(pattern.spacing_m, tool.width_m) if pattern.spacing_m > 0.0 else tool.width_m
    aside_m = np.linspace(-0.5 * own_m, 0.5 * own_m, 2 * math.ceil(own_m / grid.cell_m) + 1)
    found = []
    for number, line in enumerate(pattern.lines):
        if after is not None and number < after.line:
            continue
        begin_m = after.along_m if after is not None and number == after.line else 0.0
        done = _done_along(line, grid, worked, aside_m)
        edges = np.flatnonzero(np.diff(np.concatenate([[0], done.astype(np.int8), [0]])))
        for low, high in edges.reshape(-1, 2):
            # Nothing of the line is left before its start or after its end.
            low_m = 0.0 if low == 0 else low * _STEP_M + _INNER_M
            high_m = line.length_m if high == len(done) else (high - 1) * _STEP_M - _INNER_M
            low_m = max(low_m, begin_m)
            if high_m - low_m >= min(LEAST_STRETCH_M, line.length_m - 1e-3):
                found.append(WorkedStretch(number, float(low_m), float(high_m)))
    return tuple(found)


def share_of_lines(
    pattern: Pattern, worked: Sequence[WorkedStretch], last_line: int | None
) -> tuple[WorkedStretch, ...]:
    """Worked stretches with all lines after the last of a machine's share: they are another one's to do."""
    if last_line is None:
        return tuple(worked)
    own = [each for each in worked if each.line <= last_line]
    others = range(last_line + 1, len(pattern.lines))
    return (*own, *(WorkedStretch(number, 0.0, pattern.lines[number].length_m) for number in others))


def _done_along(
    line: Line, grid: CellGrid, worked: Bool[np.ndarray, "north east"], aside_m: Float[np.ndarray, " place"]
) -> Bool[np.ndarray, " step"]:
    """Whether the cells across a line are worked, at each step along it; beyond the map nothing is to be worked."""
    along = (line.end_m - line.start_m) / max(line.length_m, 1e-9)
    steps = np.arange(math.floor(line.length_m / _STEP_M) + 1) * _STEP_M
    places = line.start_m + steps[:, None, None] * along + aside_m[None, :, None] * np.array([-along[1], along[0]])
    columns = np.floor((places[..., 0] - grid.east_m) / grid.cell_m).astype(int)
    rows = np.floor((places[..., 1] - grid.north_m) / grid.cell_m).astype(int)
    within = (rows >= 0) & (rows < worked.shape[0]) & (columns >= 0) & (columns < worked.shape[1])
    rows, columns = np.clip(rows, 0, worked.shape[0] - 1), np.clip(columns, 0, worked.shape[1] - 1)
    done: Bool[np.ndarray, " step"] = (worked[rows, columns] | ~within).all(axis=1)
    return done


def line_arcs_m(pattern: Pattern) -> Float[np.ndarray, " line"]:
    """Arc length along the route at which each line begins."""
    turns_m = [turn.length_m for turn in pattern.turns]
    ways_m = [line.length_m + turn_m for line, turn_m in zip(pattern.lines, [*turns_m, 0.0], strict=True)]
    return np.concatenate([[0.0], np.cumsum(ways_m)[:-1]])


def route_from(route: CoverRoute, pattern: Pattern, taken_up: Resumption) -> CoverRoute:
    """What is left of a route: it begins at the place, and ends where nothing more is to be worked.

    Of the same size as before: the same to the compiler.

    Args:
        route: of the pattern, whole.
        pattern: the plan.
        taken_up: place and worked stretches.
    """
    arcs_m, step_m = line_arcs_m(pattern), float(route.spacing_m)
    rows, line = np.array(route.rows, np.float64), np.array(route.line)
    count = int(route.count)
    rows[:, 4] = _tool_on(rows[:, 4] > 0.5, line, arcs_m, step_m, taken_up.worked)
    first = min(max(math.floor((arcs_m[taken_up.place.line] + taken_up.place.along_m) / step_m + 1e-6), 0), count - 2)
    on = np.flatnonzero(rows[first:count, 4] > 0.5)
    # A row is good to the next one.
    left = min(int(on[-1]) + 2 if len(on) else 2, count - first)
    rows, line = np.roll(rows, -first, axis=0), np.roll(line, -first)
    end, beyond_m = rows[left - 1].copy(), step_m * np.arange(len(rows) - left + 1)
    rows[left - 1 :, 0] = end[0] + np.cos(end[2]) * beyond_m
    rows[left - 1 :, 1] = end[1] + np.sin(end[2]) * beyond_m
    rows[left - 1 :, 2] = end[2]
    rows[left - 1 :, 3:] = 0.0
    line[left - 1 :] = -1
    legs = None
    if route.legs is not None:
        legs = np.roll(np.array(route.legs, np.float64), -first, axis=0)
        legs[:, 1] = np.maximum(legs[:, 1] - first, 0.0)
        legs[:, 2] = np.minimum(legs[:, 2] - first, left - 1)
        legs[:, 3] = np.minimum(legs[:, 3] - first * step_m, (left - 1) * step_m)
        # Beyond the end the last leg goes straight on.
        legs[left:] = legs[left - 1]
    return CoverRoute(
        jnp.asarray(rows.astype(np.float32)),
        jnp.asarray(line),
        route.spacing_m,
        jnp.float32((left - 1) * step_m),
        jnp.int32(left),
        None if legs is None else jnp.asarray(legs.astype(np.float32)),
    )


def _tool_on(
    on: Bool[np.ndarray, " row"],
    line: np.ndarray,
    arcs_m: Float[np.ndarray, " line"],
    step_m: float,
    worked: Sequence[WorkedStretch],
) -> Bool[np.ndarray, " row"]:
    """Where the tool is to be on, less the worked stretches."""
    along = step_m * np.arange(len(on))
    kept = on.copy()
    for number, low_m, high_m in worked:
        at = along - arcs_m[number]
        # Rows at a line's ends are shared with its turns; elsewhere a stretch was taken back by more than a row.
        kept &= ~((line == number) & (at >= low_m - step_m) & (at <= high_m))
    return kept
