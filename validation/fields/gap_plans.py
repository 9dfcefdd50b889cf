"""Plans for gaps of rectangles, what their lines work, what their ways cross, and how long they are."""

from typing import NamedTuple

import numpy as np
import shapely
from scipy import ndimage

from lgprjax.coverage import (
    CellGrid,
    Field,
    Line,
    PatternSettings,
    Tool,
    check_drivable,
    field_of_polygon,
    grid_of_field,
    ground_of_sides,
    inside_cells,
    lay_pattern,
    outline_of,
    plan_gaps,
)
from lgprjax.coverage.gaps import GapPlan
from validation.fields.drawn_gaps import KINDS

FLAIL = PatternSettings(
    tool_width_m=1.2, overlap=0.2, order="free", smallest_radius_m=1.5, turning_room_m=5.5, tool_ahead_m=1.2
)
TOOL = Tool(1.2, 0.3, 1.2, 0.0)
OUTLINE = outline_of(TOOL, track_m=1.1)
CELL_M = 0.1
SPACING_M = 0.96


class Sample(NamedTuple):
    field: Field
    grid: CellGrid
    east_m: np.ndarray
    north_m: np.ndarray
    inside: np.ndarray


def sample(length_m: float = 30.0, width_m: float = 20.0, yaw_rad: float = 0.0, cell_m: float = CELL_M) -> Sample:
    """A rectangle, turned, with places of its cells along and across its sides."""
    cos, sin = np.cos(yaw_rad), np.sin(yaw_rad)
    corners = np.array([[0.0, 0.0], [length_m, 0.0], [length_m, width_m], [0.0, width_m]])
    field = field_of_polygon(corners @ np.array([[cos, sin], [-sin, cos]]), name="field")
    grid = grid_of_field(field, cell_m, 1.0)
    north, east = np.mgrid[: grid.north_cells, : grid.east_cells] + 0.5
    east, north = grid.east_m + east * cell_m, grid.north_m + north * cell_m
    return Sample(field, grid, cos * east + sin * north, cos * north - sin * east, inside_cells(field, grid))


def plan(held: Sample, left: np.ndarray, *, least_width_m: float = 0.0, room_m: float = 5.5) -> GapPlan | None:
    ground = ground_of_sides(held.field.perimeter_m, [room_m] * 4, (), 0.25)
    made = plan_gaps(
        held.field, ~left, held.grid, ground, FLAIL, TOOL, OUTLINE, least_width_m=least_width_m, name="run"
    )
    if made is not None:
        check_drivable(made.pattern, ground, OUTLINE, name="run")
    return made


def under_tool(lines: tuple[Line, ...], held: Sample) -> np.ndarray:
    """Cells in a line's tool, by their centres."""
    grid = held.grid
    north, east = np.mgrid[: grid.north_cells, : grid.east_cells] + 0.5
    places = np.stack([grid.east_m + east * grid.cell_m, grid.north_m + north * grid.cell_m], axis=-1)
    under = np.zeros(grid.shape, bool)
    for line in lines:
        way = (line.end_m - line.start_m) / line.length_m
        along, aside = (places - line.start_m) @ way, (places - line.start_m) @ np.array([-way[1], way[0]])
        reach_m = 0.5 * TOOL.length_m + 1e-6
        under |= (along > -reach_m) & (along < line.length_m + reach_m) & (np.abs(aside) < 0.5 * TOOL.width_m)
    return under


def crossed(made: GapPlan, held: Sample, left: np.ndarray) -> float:
    """Length of turns, of the reference point, over cells not worked by then, but in the swath that comes next."""
    grid, rest = held.grid, left.copy()
    route = lay_pattern(made.pattern)
    rows, line = np.asarray(route.rows)[: int(route.count)], np.asarray(route.line)[: int(route.count)]
    total, last = 0.0, -1
    for row, number in zip(rows, line, strict=True):
        if number >= 0:
            if number != last:
                rest &= ~under_tool((made.pattern.lines[number],), held)
                last = int(number)
            continue
        column = int((row[0] - grid.east_m) / grid.cell_m)
        north = int((row[1] - grid.north_m) / grid.cell_m)
        if not (0 <= north < rest.shape[0] and 0 <= column < rest.shape[1]) or not rest[north, column]:
            continue
        following = made.pattern.lines[last + 1]
        way = (following.end_m - following.start_m) / following.length_m
        away = row[:2] - following.start_m
        aside, ahead = abs(float(away @ np.array([-way[1], way[0]]))), float(away @ way)
        if not (aside <= 0.5 * TOOL.width_m + CELL_M and -TOOL.ahead_m - 1.7 < ahead < 0.2):
            total += float(route.spacing_m)
    return total


# How long swaths are, of ground drawn by kind.

MOST_RATIO = {"blocks": 1.15, "stripes": 1.15, "rectangles": 1.3, "branched": 1.45, "blobs": 1.3, "missed": 5.0}
"""Median of swaths over area by spacing: 1.15 where what is left is about as wide as swaths are, or wide."""
MOST_OVER_BOUND = {"blocks": 1.15, "stripes": 1.15, "rectangles": 1.3, "branched": 1.45, "blobs": 1.3, "missed": 1.05}


def least_m(left: np.ndarray, cell_m: float) -> float:
    """A bound on swaths, each with a tool's width more: of each region its area by the spacing, or how far it reaches.

    A swath and the tool's width cannot reach farther than the two together; regions that are a tool's width apart share
    no part of a swath.
    """
    near = ndimage.distance_transform_edt(~left) * cell_m <= 0.5 * TOOL.width_m
    labels = np.where(left, ndimage.label(near, np.ones((3, 3)))[0], 0)
    total_m = 0.0
    for number in np.unique(labels[left]):
        places = np.argwhere(labels == number) * cell_m
        corners = shapely.get_coordinates(shapely.convex_hull(shapely.MultiPoint(places)))
        reach_m = max(float(np.hypot(*(corners - each).T).max()) for each in corners)
        total_m += max(reach_m, len(places) * cell_m**2 / SPACING_M)
    return total_m


def drawn_lengths(kind: str, seeds: range, length_m: float, width_m: float) -> np.ndarray:
    """Of each seed: swaths over area by spacing, and over the bound; area by spacing, and bound; lines, and the way."""
    rows = []
    for seed in seeds:
        rng = np.random.default_rng([seed, list(KINDS).index(kind)])
        held = sample(length_m, width_m, yaw_rad=float(rng.uniform(0.0, 3.0)))
        left = KINDS[kind](rng, held.east_m, held.north_m, (length_m, width_m)) & held.inside
        made = plan(held, left)
        assert made is not None
        assert np.all(under_tool((*made.pattern.lines, *made.pattern.unreached), held)[left])
        assert len(made.pattern.unreached) <= 1
        assert crossed(made, held, left) <= 0.3
        area_m, bound_m = made.left_m2 / SPACING_M, least_m(left, CELL_M)
        way_m = made.pattern.line_length_m + sum(each.length_m for each in made.pattern.turns)
        rows.append((made.swath_m / area_m, made.swath_m / bound_m, len(made.pattern.lines), way_m))
    return np.array(rows)
