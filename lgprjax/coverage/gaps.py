"""Plans for what a record leaves: connected regions of cells, swaths that end where work is left, ways between them.

Each region is laid in strips of its own, of the heading that costs least, and a swath is no longer than its gap and
half a tool at both ends. The vehicle goes from one to the next over ground that is worked, or beyond the field; only
places narrower than ``EDGE_M``, which a tool's edge leaves everywhere, count as no ground left.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import shapely
from jaxtyping import Bool, Float
from scipy import ndimage

from lgprjax.coverage.field import CellGrid, Field, Outline, Tool, cell_centres, inside_cells
from lgprjax.coverage.ground import SafeGround
from lgprjax.coverage.joints import Terrain
from lgprjax.coverage.layer import TourLayer, TourSwath
from lgprjax.coverage.pattern import Pattern
from lgprjax.coverage.swaths import (
    MOST_LINES,
    Line,
    PatternSettings,
    join_spans,
    lines_heading_rad,
    strip_pieces,
    to_lines,
)
from lgprjax.coverage.tour import no_swath_fits, string_swaths
from lgprjax.errors import InputError

EDGE_M = 0.1
"""Ground left in places narrower than this is driven over, not round: the border of every map has them."""
_TURN_SHARE = 0.5
_NEAR_SHARE = 0.25
_STRETCH_SHARE = 0.03
"""By which the last strip of a region may be wider, rather than one more driven."""
_ROUNDING_M = 1e-6
_MOST_REGIONS = 500
_CONNECTED = np.ones((3, 3), bool)


class GapPlan(NamedTuple):
    """A plan for what a record leaves.

    Attributes:
        pattern: the way; its ``unreached`` no way leads to.
        regions: that were planned for.
        left_m2: area of their cells.
        narrow_m2: of cells in places narrower than the least width, for which nothing is planned.
        shut_m2: of cells that no swath passes: vehicle and tool do not fit into the ground there.
        swath_m: of the swaths without what they go beyond their gaps.
    """

    pattern: Pattern
    regions: int
    left_m2: float
    narrow_m2: float
    shut_m2: float
    swath_m: float


def plan_gaps(
    field: Field,
    worked: Bool[np.ndarray, "north east"],
    grid: CellGrid,
    ground: SafeGround,
    settings: PatternSettings,
    tool: Tool,
    outline: Outline,
    *,
    least_width_m: float = 0.0,
    name: str,
) -> GapPlan | None:
    """Swaths over the cells of a field that were not worked; ``None`` where none was left, or none wide enough.

    Args:
        field: of the first plan.
        worked: cells that count as worked.
        grid: of the cells.
        ground: that is safe to drive on, see ``ground_of_sides``.
        settings: of the pattern; its order and its turning room are not used.
        tool: that works; outline: of vehicle and tool.
        least_width_m: places narrower than this are left as they are.
        name: of the record, or its file, for errors.

    Raises:
        InputError: a map that is not of the grid's size, too many regions or strips, or no swath can be begun.
    """
    if worked.shape != grid.shape:
        raise InputError(name, "map", f"{grid.shape} cells", f"{worked.shape}")
    left = inside_cells(field, grid) & ~worked
    wide = wide_parts(left, least_width_m / grid.cell_m)
    if not wide.any():
        return None
    # Fragments nearer to each other than half a tool are one region: a swath serves both.
    near = ndimage.distance_transform_edt(~wide) * grid.cell_m <= _NEAR_SHARE * settings.tool_width_m
    labels, count = ndimage.label(near, _CONNECTED)
    labels = np.where(wide, labels, 0)
    if count > _MOST_REGIONS:
        raise InputError(name, "gaps", f"at most {_MOST_REGIONS} regions: a larger least width", f"{count}")
    east_m, north_m = cell_centres(grid)
    terrain = Terrain(ground, _outline_of_cells(wide, grid), outline)
    # Not the eroded raster of a field: a gap is off limits to its edge.
    terrain.unworked[:] = False
    rows, columns = np.nonzero(wide_parts(left, EDGE_M / grid.cell_m))
    terrain.unworked[terrain.cells(np.stack([east_m[columns], north_m[rows]], axis=1))] = True
    lines_rad = lines_heading_rad(field, settings.heading_rad)
    swaths: list[TourSwath] = []
    headings: list[float] = []
    swath_m = 0.0
    for number, part in enumerate(ndimage.find_objects(labels), start=1):
        rows, columns = np.nonzero(labels[part] == number)
        places = np.stack([east_m[part[1]][columns], north_m[part[0]][rows]], axis=1)
        best: tuple[float, list[TourSwath], float, float] | None = None
        layer = TourLayer(terrain, _outline_of_cells(labels == number, grid), settings, tool)
        for heading in _headings(places, lines_rad, settings.heading_rad is not None):
            found, needed_m = _strips_of_region(field, layer, places, heading, grid.cell_m, settings, name)
            turn_m = _TURN_SHARE * 2.0 * math.pi * settings.smallest_radius_m
            cost_m = sum(float(np.hypot(*(each.end_m - each.start_m))) for each in found) + turn_m * len(found)
            if found and (best is None or cost_m < best[0] - 1e-6):
                best = cost_m, found, heading, needed_m
        if best is not None:
            swaths += best[1]
            headings.append(best[2])
            swath_m += best[3]
    if not swaths:
        raise no_swath_fits(_outline_of_cells(wide, grid), ground, outline, name)
    if len(swaths) > MOST_LINES:
        raise InputError(name, "gaps", f"at most {MOST_LINES} strips", f"{len(swaths)}")
    layer = TourLayer(terrain, _outline_of_cells(wide, grid), settings, tool)
    ways = list(dict.fromkeys([lines_rad, lines_rad + 0.5 * math.pi, *headings]))[:4]
    tour = string_swaths(field, terrain, layer, swaths, ways, settings, name)
    cell_m2 = grid.cell_m2
    lines = (*tour.pattern.lines, *tour.pattern.unreached)
    reached = _passed(lines, wide, grid, 0.5 * tool.width_m, 0.5 * tool.length_m)
    return GapPlan(
        tour.pattern,
        count,
        float(np.count_nonzero(wide)) * cell_m2,
        float(np.count_nonzero(left & ~wide)) * cell_m2,
        float(np.count_nonzero(wide & ~reached)) * cell_m2,
        swath_m,
    )


def _passed(
    lines: Sequence[Line], cells: Bool[np.ndarray, "north east"], grid: CellGrid, half_m: float, more_m: float
) -> Bool[np.ndarray, "north east"]:
    """Of cells, those whose centres a tool passes on lines."""
    rows, columns = np.nonzero(cells)
    east_m, north_m = cell_centres(grid)
    x, y = east_m[columns], north_m[rows]
    under = np.zeros(len(rows), bool)
    for line in lines:
        along = (line.end_m - line.start_m) / max(line.length_m, 1e-9)
        # Rows are sorted: most of a map is far from any one line.
        reach_m = half_m + more_m
        low, high = sorted((line.start_m[1], line.end_m[1]))
        part = slice(*(int(each) for each in np.searchsorted(y, (low - reach_m, high + reach_m))))
        ahead = (x[part] - line.start_m[0]) * along[0] + (y[part] - line.start_m[1]) * along[1]
        aside = (y[part] - line.start_m[1]) * along[0] - (x[part] - line.start_m[0]) * along[1]
        within = (ahead >= -more_m) & (ahead <= line.length_m + more_m)
        under[part] |= within & (np.abs(aside) <= half_m + 1e-6)
    passed = np.zeros_like(cells)
    passed[rows[under], columns[under]] = True
    return passed


def wide_parts(cells: Bool[np.ndarray, "north east"], width: float) -> Bool[np.ndarray, "north east"]:
    """Cells that lie in a square of so many cells' width which is all of such cells."""
    side = math.ceil(width - 1e-9)
    if side <= 1:
        return cells
    # Beyond the map nothing is told: the border must not make a narrow place of a wide one, nor the other way round.
    opened: Bool[np.ndarray, "north east"] = ndimage.binary_opening(np.pad(cells, side), np.ones((side, side), bool))
    return opened[side:-side, side:-side]


def _headings(places_m: Float[np.ndarray, "cell 2"], lines_rad: float, given: bool) -> list[float]:
    """Of the lines, and of a region's own sides unless a heading was asked for."""
    found = [lines_rad]
    if given or len(places_m) < 3:
        return found
    box = shapely.minimum_rotated_rectangle(shapely.MultiPoint(places_m))
    own = []
    if box.geom_type == "Polygon":
        sides = np.diff(shapely.get_coordinates(box), axis=0)[:2]
        own = [math.atan2(*side[::-1]) for side in sides[np.argsort(-np.hypot(*sides.T))]]
    for heading in (*own, lines_rad + 0.5 * math.pi):
        if all(abs(math.sin(heading - other)) > 0.02 for other in found):
            found.append(heading)
    return found


def _strips_of_region(
    field: Field,
    layer: TourLayer,
    places_m: Float[np.ndarray, "cell 2"],
    heading_rad: float,
    cell_m: float,
    settings: PatternSettings,
    name: str,
) -> tuple[list[TourSwath], float]:
    """Fewest strips of a heading over a region, and the length of what they must work."""
    half_m = 0.5 * cell_m * (abs(math.cos(heading_rad)) + abs(math.sin(heading_rad)))
    width_m = settings.tool_width_m
    spacing_m = (1.0 - settings.overlap) * width_m
    corners_m = to_lines(field.perimeter_m, heading_rad)
    swaths: list[TourSwath] = []
    needed_m = 0.0
    for across_m, along_m in _strips(to_lines(places_m, heading_rad), half_m, spacing_m, name):
        cells = np.unique(along_m)
        gaps = join_spans([(float(each) - half_m, float(each) + half_m) for each in cells], width_m)
        pieces = strip_pieces(corners_m, across_m, width_m)
        for low, high in gaps:
            needed_m += high - low
            within = [piece for piece in pieces if piece[0] < high and piece[1] > low]
            if within:
                # A pass is sure of a place only some way after it begins, and before it ends.
                low = max(low - 0.5 * width_m, within[0][0])
                high = min(high + 0.5 * width_m, within[-1][1])
            swaths += _either_way(layer.single(heading_rad, across_m, low, high))
    return swaths, needed_m


def _either_way(found: Sequence[TourSwath]) -> list[TourSwath]:
    """Of swaths both ways round the longer ones, and one that may be driven either way where they are alike."""
    if len(found) == 2:
        forward, back = found
        if np.hypot(*(forward.start_m - back.end_m)) < 0.05 and np.hypot(*(forward.end_m - back.start_m)) < 0.05:
            return [forward._replace(either=True)]
    if not found:
        return []
    along = found[0].end_m - found[0].start_m
    ahead = [each for each in found if float((each.end_m - each.start_m) @ along) > 0.0]
    behind = [each for each in found if each not in ahead]
    lengths = [sum(float(np.hypot(*(each.end_m - each.start_m))) for each in way) for way in (ahead, behind)]
    return ahead if lengths[0] >= lengths[1] else behind


def _strips(
    places_m: Float[np.ndarray, "cell 2"], half_m: float, width_m: float, name: str
) -> list[tuple[float, Float[np.ndarray, " part"]]]:
    """Fewest strips of a width over cells: the middle of each, and where along it its cells are.

    A cell on the border of two strips is in both: strips need not begin where cells do.
    """
    ordered = places_m[np.argsort(places_m[:, 1])]
    across = ordered[:, 1]
    strips = []
    begin, last = float(across[0]) - half_m, float(across[-1]) + half_m
    while True:
        end = begin + width_m
        if last - end < _STRETCH_SHARE * width_m:
            end = last
        inner = slice(
            int(np.searchsorted(across, begin - half_m + _ROUNDING_M)),
            int(np.searchsorted(across, end + half_m - _ROUNDING_M)),
        )
        top = min(end, float(across[inner][-1]) + half_m)
        strips.append((0.5 * (begin + top), ordered[inner, 0]))
        following = int(np.searchsorted(across, end - half_m + _ROUNDING_M))
        if end >= last or following >= len(across):
            break
        begin = max(end, float(across[following]) - half_m)
        if len(strips) > MOST_LINES:
            raise InputError(name, "gaps", f"at most {MOST_LINES} strips", "more")
    return strips


def _outline_of_cells(cells: Bool[np.ndarray, "north east"], grid: CellGrid) -> shapely.Geometry:
    """Union of cells as a geometry."""
    edges = np.diff(np.pad(cells, ((0, 0), (1, 1))).astype(np.int8), axis=1)
    rows, firsts = np.nonzero(edges == 1)
    _, lasts = np.nonzero(edges == -1)
    low_x, high_x = grid.east_m + grid.cell_m * firsts, grid.east_m + grid.cell_m * lasts
    low_y = grid.north_m + grid.cell_m * rows
    return shapely.union_all(shapely.box(low_x, low_y, high_x, low_y + grid.cell_m), grid_size=1e-4)
