"""Resumed work: the rest of a route, from line k and metre s on, with the tool off where the ground is worked.

A place is given by its line, in driving order, and the position of the tool's centre along it, independent of vehicle,
computer and day. The route's rows before it are replaced by a straight way to it.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

from lgprjax.coverage.field import CellGrid, Tool, cell_centres, inside_cells
from lgprjax.coverage.guidance import CoverRoute
from lgprjax.coverage.pattern import Pattern
from lgprjax.frames import body_to_local

BACK_M = 1.0
"""Distance before the last worked place at which work resumes, m: a pass is certain only some way after its start."""
LEAST_STRETCH_M = 3.0
"""Shorter stretches of worked ground are not worth turning the tool off for."""
_INNER_M = 0.5
_STEP_M = 0.1
_PIECE_M = 10.0


class RoutePlace(NamedTuple):
    """A place of a plan.

    Attributes:
        line: number of the line in driving order, from 0.
        along_m: distance of the tool's centre from the line's start.
    """

    line: int
    along_m: float


class WorkedStretch(NamedTuple):
    """A worked stretch of a line.

    Attributes:
        line: number of the line in driving order, from 0.
        low_m, high_m: start and end along the line.
    """

    line: int
    low_m: float
    high_m: float


class Resumption(NamedTuple):
    """Start of resumed work on a plan.

    Attributes:
        place: place at which work resumes.
        worked: worked stretches of the rest, by any machine.
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
    """Place at which to resume after the last place worked; ``None`` after the last line's end.

    Args:
        pattern: pattern of the plan.
        last: place of the last moment that counted.
        back_m: overlap with the work done.
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
    last_line: int | None = None,
    edge_m: float = 0.0,
) -> tuple[WorkedStretch, ...]:
    """Stretches of lines without unworked cells that belong to the line.

    Each unworked cell of the field belongs to one of the remaining lines that pass it: the one with the nearest middle.
    The ends of stretches are shortened by half a metre, and short stretches are left out, so that the tool is on too
    long rather than too short.

    Args:
        pattern: pattern of the plan.
        grid: grid of the cells.
        worked: mask of cells that count as worked.
        tool: tool of the vehicle.
        after: place beyond which stretches count; ``None``: all.
        last_line: last line to drive, in driving order from 0; ``None``: all.
        edge_m: width of the tool's edge, on either side, that does not reach the level: cells there need no drive.
    """
    begin = RoutePlace(0, 0.0) if after is None else after
    numbers = range(begin.line, len(pattern.lines) if last_line is None else last_line + 1)
    # Parallel lines share the field evenly: each has to work only its own middle, however much they overlap. Many free
    # swaths exist only for cells under their edge.
    half_m = 0.5 * tool.width_m - edge_m
    if pattern.settings.order != "free" and pattern.spacing_m > 0.0:
        half_m = 0.5 * min(pattern.spacing_m, tool.width_m)
    ends_m = max(0.5 * tool.length_m - edge_m, 0.0)
    left = inside_cells(pattern.field, grid) & ~worked
    found = []
    for number, to_do in _to_do(pattern, numbers, begin.along_m, grid, left, (half_m, ends_m)).items():
        line = pattern.lines[number]
        begin_m = begin.along_m if number == begin.line else 0.0
        edges = np.flatnonzero(np.diff(np.concatenate([[1], to_do.astype(np.int8), [1]])))
        for low, high in edges.reshape(-1, 2):
            # Nothing of the line is left before its start or after its end.
            low_m = 0.0 if low == 0 else low * _STEP_M + _INNER_M
            high_m = line.length_m if high == len(to_do) else (high - 1) * _STEP_M - _INNER_M
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


def _to_do(
    pattern: Pattern,
    numbers: range,
    begin_m: float,
    grid: CellGrid,
    left: Bool[np.ndarray, "north east"],
    reach_m: tuple[float, float],
) -> dict[int, Bool[np.ndarray, " step"]]:
    """Mask of steps along each line with work to do.

    Args:
        pattern: pattern of the plan.
        numbers: numbers of the lines to drive; the first of them from ``begin_m`` on.
        begin_m: start along the first line.
        grid: grid of the cells.
        left: mask of cells to be worked.
        reach_m: reach of a line to the side, and beyond its ends.
    """
    half_m, ends_m = reach_m
    east_m, north_m = cell_centres(grid)
    nearest_m, owner = np.full(grid.shape, np.inf), np.full(grid.shape, -1)
    for number in numbers:
        line = pattern.lines[number]
        low_m = (begin_m if number == numbers[0] else 0.0) - ends_m
        high_m = line.length_m + ends_m
        along = (line.end_m - line.start_m) / max(line.length_m, 1e-9)
        # Piece by piece: all cells between the corners of a slanting line would be most of the field.
        for piece_m in np.arange(low_m, high_m, _PIECE_M):
            ends = line.start_m + np.array([[piece_m], [min(piece_m + _PIECE_M, high_m)]]) * along
            box = tuple(
                slice(*np.searchsorted(places, [part.min() - half_m, part.max() + half_m]))
                for places, part in ((north_m, ends[:, 1]), (east_m, ends[:, 0]))
            )
            x, y = east_m[None, box[1]] - line.start_m[0], north_m[box[0], None] - line.start_m[1]
            ahead_m, aside_m = x * along[0] + y * along[1], np.abs(y * along[0] - x * along[1])
            own = left[box] & (aside_m <= half_m) & (ahead_m >= low_m) & (ahead_m <= high_m)
            own &= aside_m < nearest_m[box]
            nearest_m[box] = np.where(own, aside_m, nearest_m[box])
            owner[box] = np.where(own, number, owner[box])
    rows, columns = np.nonzero(owner >= 0)
    of = owner[rows, columns]
    found = {}
    for number in numbers:
        line = pattern.lines[number]
        along = (line.end_m - line.start_m) / max(line.length_m, 1e-9)
        steps = np.zeros(math.floor(line.length_m / _STEP_M) + 1, bool)
        own = of == number
        away = np.stack([east_m[columns[own]], north_m[rows[own]]], axis=1) - line.start_m
        before = np.floor(away @ along / _STEP_M).astype(int)
        steps[np.clip([before, before + 1], 0, len(steps) - 1)] = True
        found[number] = steps
    return found


def line_arcs_m(pattern: Pattern) -> Float[np.ndarray, " line"]:
    """Arc length along the route at which each line begins."""
    turns_m = [turn.length_m for turn in pattern.turns]
    ways_m = [line.length_m + turn_m for line, turn_m in zip(pattern.lines, [*turns_m, 0.0], strict=True)]
    return np.concatenate([[0.0], np.cumsum(ways_m)[:-1]])


def route_from(route: CoverRoute, pattern: Pattern, taken_up: Resumption) -> CoverRoute:
    """The rest of a route, from the place of resumption to the end of the last work.

    Its arrays keep their size, so nothing is recompiled.

    Args:
        route: whole route of the pattern.
        pattern: pattern of the plan.
        taken_up: place and worked stretches.
    """
    arcs_m, step_m = line_arcs_m(pattern), float(route.spacing_m)
    rows, line = np.array(route.rows, np.float64), np.array(route.line)
    count = int(route.count)
    rows[:, 4] = _tool_on(rows[:, 4] > 0.5, line, arcs_m, step_m, taken_up.worked)
    first = min(max(math.floor((arcs_m[taken_up.place.line] + taken_up.place.along_m) / step_m + 1e-6), 0), count - 2)
    on = np.flatnonzero(rows[first:count, 4] > 0.5)
    # A row is valid to the next one.
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
    """Mask of rows with the tool on, without the worked stretches."""
    along = step_m * np.arange(len(on))
    kept = on.copy()
    for number, low_m, high_m in worked:
        at = along - arcs_m[number]
        # Rows at a line's ends are shared with its turns; elsewhere a stretch was taken back by more than a row.
        kept &= ~((line == number) & (at >= low_m - step_m) & (at <= high_m))
    return kept
