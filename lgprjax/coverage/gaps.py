"""Plans for what a record leaves: connected regions of cells, swaths that end where work is left, ways between them.

Each region is laid in strips of its own, those that cost least, and a swath is no longer than its gap and half a tool
at both ends. The vehicle goes from one to the next over ground that is worked, or beyond the field; only
places narrower than ``EDGE_M``, which a tool's edge leaves everywhere, count as no ground left.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import shapely
from jaxtyping import Bool, Float, Int
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
_ROUNDING = 1e-6
_ROWS = 32
"""Rows of a strip as wide as the spacing; the last strip of a region may have one row more, to save a strip."""
_SIZES = (32, 16)
_LAST = _ROWS + 1
_MOST_BINS = 2_000_000
_AROUND = 12
"""Headings over half a turn."""
_MOST_TURNED = 100_000
_MOST_MIXED = 12_000
"""Cells of a region whose strips may have any heading, and of one whose strips may have several."""
_MOST_TAKEN = 6
_MOST_LAID = 4
_BORDER = 3.0
"""Weight of a cell along a border, so that no strip narrower than a tool remains there."""
_COARSE = 16
"""Rows of a strip where one is taken after the other."""
_RATES = 4
"""Rounds of Dinkelbach's (1967) iteration for the largest ratio."""
_MOST_REGIONS = 500
_CONNECTED = np.ones((3, 3), bool)


class GapPlan(NamedTuple):
    """A plan for the gaps of a record.

    Attributes:
        pattern: pattern of the plan; its ``unreached`` lines cannot be reached.
        regions: number of planned regions.
        left_m2: area of the regions' cells.
        narrow_m2: area of cells in places narrower than the least width, which are not planned.
        shut_m2: area of cells that no swath passes, because vehicle and tool do not fit into the ground there.
        swath_m: length of the swaths within their gaps.
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
    """Swaths over the unworked cells of a field; ``None`` if no cells are left, or none wide enough.

    Args:
        field: field of the first plan.
        worked: mask of cells that count as worked.
        grid: grid of the cells.
        ground: ground that is safe to drive on, see ``ground_of_sides``.
        settings: settings of the pattern; its order and its turning room are not used.
        tool: working tool.
        outline: outline of vehicle and tool.
        least_width_m: width below which places are not planned.
        name: name of the record or its file, for errors.

    Raises:
        InputError: the map has not the grid's size, there are too many regions or strips, or no swath can be begun.
    """
    if worked.shape != grid.shape:
        raise InputError(name, "map", f"{grid.shape} cells", f"{worked.shape}")
    left = inside_cells(field, grid) & ~worked
    wide = wide_parts(left, least_width_m / grid.cell_m)
    if not wide.any():
        return None
    # Fragments nearer to each other than half a tool are one region: a swath serves both.
    near_m = ndimage.distance_transform_edt(~wide) * grid.cell_m
    labels, count = ndimage.label(near_m <= _NEAR_SHARE * settings.tool_width_m, _CONNECTED)
    if count > _MOST_REGIONS:
        raise InputError(name, "gaps", f"at most {_MOST_REGIONS} regions: use a larger least width", f"{count}")
    # Of regions within a tool's width one swath may serve several.
    groups, _ = ndimage.label(near_m <= 2.0 * _NEAR_SHARE * settings.tool_width_m, _CONNECTED)
    labels, groups = np.where(wide, labels, 0), np.where(wide, groups, 0)
    del near_m
    east_m, north_m = cell_centres(grid)
    terrain = Terrain(ground, _outline_of_cells(wide, grid), outline)
    # Not the eroded raster of a field: a gap is off limits to its edge.
    terrain.unworked[:] = False
    rows, columns = np.nonzero(wide_parts(left, EDGE_M / grid.cell_m))
    terrain.unworked[terrain.cells(np.stack([east_m[columns], north_m[rows]], axis=1))] = True
    lines_rad = lines_heading_rad(field, settings.heading_rad)
    layer = TourLayer(terrain, _outline_of_cells(wide, grid), settings, tool)
    swaths: list[TourSwath] = []
    headings: list[float] = []
    swath_m = 0.0
    for number, part in enumerate(ndimage.find_objects(groups), start=1):
        rows, columns = np.nonzero(groups[part] == number)
        places = np.stack([east_m[part[1]][columns], north_m[part[0]][rows]], axis=1)
        regions = labels[part][rows, columns]
        several = [places[regions == each] for each in np.unique(regions)]
        works = [_work(field, layer, each, lines_rad, grid.cell_m, settings, tool, name) for each in several]
        best = [each for each in works if each.swaths]
        if len(several) > 1:
            one = _work(field, layer, places, lines_rad, grid.cell_m, settings, tool, name)
            if (-one.passed, one.cost_m) < (-sum(each.passed for each in works), sum(each.cost_m for each in works)):
                best = [one]
        for each in best:
            swaths += each.swaths
            headings.append(each.heading_rad)
            swath_m += each.needed_m
    if not swaths:
        raise no_swath_fits(_outline_of_cells(wide, grid), ground, outline, name)
    if len(swaths) > MOST_LINES:
        raise InputError(name, "gaps", f"at most {MOST_LINES} strips", f"{len(swaths)}")
    ways = list(dict.fromkeys([lines_rad, lines_rad + 0.5 * math.pi, *headings]))[:4]
    tour = string_swaths(field, layer, swaths, ways, name)
    cell_m2 = grid.cell_m2
    rows, columns = np.nonzero(wide)
    places = np.stack([east_m[columns], north_m[rows]], axis=1)
    passed = _passed((*tour.pattern.lines, *tour.pattern.unreached), places, tool)
    return GapPlan(
        tour.pattern,
        count,
        float(np.count_nonzero(wide)) * cell_m2,
        float(np.count_nonzero(left & ~wide)) * cell_m2,
        float(np.count_nonzero(~passed)) * cell_m2,
        swath_m,
    )


def _passed(
    lines: Sequence[Line | TourSwath], places_m: Float[np.ndarray, "cell 2"], tool: Tool
) -> Bool[np.ndarray, " cell"]:
    """Mask of places, in rows from south to north, that a tool passes on lines."""
    passed = np.zeros(len(places_m), bool)
    half_m, more_m = 0.5 * tool.width_m, 0.5 * tool.length_m
    for line in lines:
        length_m = float(np.hypot(*(line.end_m - line.start_m)))
        along = (line.end_m - line.start_m) / max(length_m, 1e-9)
        # Most of a map is far from any one line.
        low, high = sorted((float(line.start_m[1]), float(line.end_m[1])))
        reach_m = half_m + more_m
        part = slice(*(int(each) for each in np.searchsorted(places_m[:, 1], (low - reach_m, high + reach_m))))
        x, y = (places_m[part] - line.start_m).T
        ahead, aside = x * along[0] + y * along[1], y * along[0] - x * along[1]
        passed[part] |= (ahead >= -more_m) & (ahead <= length_m + more_m) & (np.abs(aside) <= half_m + 1e-6)
    return passed


def wide_parts(cells: Bool[np.ndarray, "north east"], width: float) -> Bool[np.ndarray, "north east"]:
    """Mask of cells within a square of ``width`` cells that consists of masked cells only."""
    side = math.ceil(width - 1e-9)
    if side <= 1:
        return cells
    # Cells beyond the map are unknown: the border must not make a wide place narrow, nor a narrow place wide.
    opened: Bool[np.ndarray, "north east"] = ndimage.binary_opening(np.pad(cells, side), np.ones((side, side), bool))
    return opened[side:-side, side:-side]


def _headings(places_m: Float[np.ndarray, "cell 2"], lines_rad: float, given: bool) -> list[float]:
    """Headings to try: of the lines, of a region's own sides and, for small regions, all round; only one if given."""
    found = [lines_rad]
    if given or len(places_m) < 3:
        return found
    box = shapely.minimum_rotated_rectangle(shapely.MultiPoint(places_m))
    own = []
    if box.geom_type == "Polygon":
        sides = np.diff(shapely.get_coordinates(box), axis=0)[:2]
        own = [math.atan2(*side[::-1]) for side in sides[np.argsort(-np.hypot(*sides.T))]]
    count = _AROUND if len(places_m) <= _MOST_TURNED else 1
    around = [lines_rad + math.pi * each / count for each in range(1, count)]
    for heading in (*own, lines_rad + 0.5 * math.pi, *around):
        if all(abs(math.sin(heading - other)) > 0.02 for other in found):
            found.append(heading)
    return found


class _Work(NamedTuple):
    """Swaths over a region.

    Attributes:
        swaths: swaths of the region.
        needed_m: length that the swaths must work.
        cost_m: length of the swaths and of their turns.
        passed: number of the region's cells that the swaths pass.
        heading_rad: heading of the longest swath.
    """

    swaths: list[TourSwath]
    needed_m: float
    cost_m: float
    passed: int
    heading_rad: float


def _work(
    field: Field,
    layer: TourLayer,
    places_m: Float[np.ndarray, "cell 2"],
    lines_rad: float,
    cell_m: float,
    settings: PatternSettings,
    tool: Tool,
    name: str,
) -> _Work:
    """The cheapest swaths over a region that pass all of it, or of a few tried those that pass most."""
    best: _Work | None = None
    headings = _headings(places_m, lines_rad, settings.heading_rad is not None)
    for layout in _layouts(places_m, headings, cell_m, settings, name)[:_MOST_LAID]:
        swaths: list[TourSwath] = []
        for each in layout:
            swaths += _laid(field, layer, each, settings.tool_width_m)
        passed = int(np.count_nonzero(_passed(swaths, places_m, tool)))
        longest = max(layout, key=lambda each: each.length_m)
        cost_m, needed_m = _cost_m(layout, settings), sum(each.length_m for each in layout)
        work = _Work(swaths, needed_m, cost_m, passed, longest.heading_rad)
        if best is None or work.passed > best.passed:
            best = work
        if best.passed == len(places_m):
            break
    assert best is not None
    return best


# Strips of a region.


class _Stretch(NamedTuple):
    """Stretch of a strip that a swath must work.

    Attributes:
        heading_rad: heading of the strip.
        across_m: position of the strip's middle across the heading.
        low_m, high_m: start and end of the stretch along the strip.
    """

    heading_rad: float
    across_m: float
    low_m: float
    high_m: float

    @property
    def length_m(self) -> float:
        return self.high_m - self.low_m


def _cost_m(layout: Sequence[_Stretch], settings: PatternSettings) -> float:
    """Way over a region: half a tool beyond each end of a stretch, and a share of the turns."""
    return sum(each.length_m for each in layout) + _each_m(settings) * len(layout)


def _each_m(settings: PatternSettings) -> float:
    return settings.tool_width_m + _TURN_SHARE * 2.0 * math.pi * settings.smallest_radius_m


def _layouts(
    places_m: Float[np.ndarray, "cell 2"],
    headings: Sequence[float],
    cell_m: float,
    settings: PatternSettings,
    name: str,
) -> list[list[_Stretch]]:
    """Stretches that work a region together, the cheapest first.

    Candidates are parallel stretches of each heading and, for small regions, a greedy selection of the stretch that
    works most for its cost, with parallel ones over the rest, so that each limb of a region gets its own heading.
    """
    turned = [to_lines(places_m, heading) for heading in headings]
    found = [_parallel(each, way, cell_m, settings, name) for each, way in zip(turned, headings, strict=True)]
    if len(headings) > 1 and len(places_m) <= _MOST_MIXED:
        rest, taken = np.ones(len(places_m), bool), list[_Stretch]()
        while rest.any() and len(taken) < _MOST_TAKEN:
            taken.append(_worth_most(places_m, turned, headings, rest, cell_m, settings))
            rest &= ~_holds(taken[-1], places_m, 0.5 * _spacing_m(settings) - 0.25 * cell_m)
            others = [
                _parallel(each[rest], way, cell_m, settings, name)
                for each, way in zip(turned, headings, strict=True)
                if rest.any()
            ]
            found.append([*taken, *min(others, key=lambda each: _cost_m(each, settings), default=[])])
        found = [_shortened(each, places_m, cell_m, settings) for each in found]
    return sorted(found, key=lambda each: _cost_m(each, settings))


def _spacing_m(settings: PatternSettings) -> float:
    return (1.0 - settings.overlap) * settings.tool_width_m


def _half_m(heading_rad: float, cell_m: float) -> float:
    """Half extent of a cell along a heading (and across it), m."""
    return 0.5 * cell_m * (abs(math.cos(heading_rad)) + abs(math.sin(heading_rad)))


def _parallel(
    places_m: Float[np.ndarray, "cell 2"],
    heading_rad: float,
    cell_m: float,
    settings: PatternSettings,
    name: str,
) -> list[_Stretch]:
    """The cheapest parallel stretches over cells, no strip wider than the spacing.

    Cells are sorted into rows along the heading, a fraction of the spacing wide; strips are runs of rows. Dynamic
    programming from the last row back selects the strip that is cheapest with all strips beyond it.

    Args:
        places_m: positions of cells along and across the heading.
        heading_rad: heading of the strips.
        cell_m: side of a cell.
        settings: settings of the pattern.
        name: name of the record, for errors.
    """
    half_m = _half_m(heading_rad, cell_m)
    along, across = places_m.T
    # A cell counts by its centre, so that the outermost are half there; the others are whole, lest strips overlap less.
    origin_m, top_m = float(across.min()), float(across.max())
    row_m = _spacing_m(settings) / _ROWS
    low_m, high_m = np.maximum(across - half_m, origin_m), np.minimum(across + half_m, top_m)
    first = np.floor((low_m - origin_m) / row_m + _ROUNDING).astype(np.int64)
    beyond = np.maximum(np.ceil((high_m - origin_m) / row_m - _ROUNDING).astype(np.int64), first + 1)
    rows = int(beyond.max())
    if rows > MOST_LINES * _ROWS:
        raise InputError(name, "gaps", f"at most {MOST_LINES} strips", f"{rows // _ROWS}")
    length_m = float(np.ptp(along)) + cell_m
    bin_m = max(cell_m, rows * length_m / _MOST_BINS)
    place = ((along - along.min()) / bin_m + _ROUNDING).astype(np.int64)
    columns = int(place.max()) + 1
    entered, left = (
        np.bincount(row * columns + place, minlength=(rows + 1) * columns).reshape(rows + 1, columns)
        for row in (first, beyond)
    )
    held = np.cumsum(entered - left, axis=0)[:-1]
    upto = np.concatenate([np.zeros((1, columns), np.int64), np.cumsum(held > 0, axis=0)])
    empty = np.asarray(~(held > 0).any(axis=1))
    ways = [(size, _costs_m(upto, size, bin_m, settings).tolist()) for size in (*_SIZES, _LAST)]
    cost_m, taken = [0.0] * (rows + 1), [0] * rows
    for row in reversed(range(rows)):
        if empty[row]:
            cost_m[row], taken[row] = cost_m[row + 1], 1
            continue
        cost_m[row], taken[row] = min(
            (each[row] + cost_m[min(row + size, rows)], size)
            for size, each in ways
            if size < _LAST or row + size >= rows
        )
    # Strips that follow each other share their ground evenly, where this costs nothing.
    edges, even, row = list[tuple[float, float]](), list[tuple[float, float]](), 0
    while row < rows:
        begin = row
        while row < rows and not empty[row]:
            edges.append((row, row + taken[row]))
            row += taken[row]
        count = len(edges) - len(even)
        width = min((min(row, rows) - begin) / count, _ROWS) if count else 0.0
        low = 0.5 * (begin + min(row, rows) - count * width)
        even += [(low + width * part, low + width * (part + 1)) for part in range(count)]
        row += 1
    layouts = []
    for bands in (even, edges):
        layout: list[_Stretch] = []
        for bottom, top in bands:
            inner = (first < top - _ROUNDING) & (beyond > bottom + _ROUNDING)
            if not inner.any():
                continue
            across_m = origin_m + 0.5 * (bottom + top) * row_m
            if bands is edges:
                low_edge_m = max(origin_m + bottom * row_m, float(low_m[inner].min()))
                across_m = 0.5 * (low_edge_m + min(origin_m + top * row_m, float(high_m[inner].max())))
            ends = np.sort(along[inner])
            cuts = np.flatnonzero(np.diff(ends) >= settings.tool_width_m + 2.0 * half_m)
            for one, other in zip(np.append(0, cuts + 1), np.append(cuts, len(ends) - 1), strict=True):
                layout.append(_Stretch(heading_rad, across_m, float(ends[one]) - half_m, float(ends[other]) + half_m))
        layouts.append(layout)
    return min(layouts, key=lambda each: _cost_m(each, settings))


def _costs_m(
    upto: Int[np.ndarray, "edge column"], size: int, bin_m: float, settings: PatternSettings
) -> Float[np.ndarray, " row"]:
    """Cost of a strip that begins at each row, m.

    Args:
        upto: number of rows with cells before each edge of rows, per column.
        size: number of rows of the strip.
        bin_m: length of a column.
        settings: settings of the pattern.
    """
    rows, columns = upto.shape[0] - 1, upto.shape[1]
    held = upto[np.minimum(np.arange(rows) + size, rows)] > upto[:-1]
    number = np.arange(columns)
    latest = np.maximum.accumulate(np.where(held, number, -columns), axis=1)
    step_m = bin_m * (number[1:] - latest[:, :-1])
    step_m = np.where(step_m < settings.tool_width_m + bin_m, step_m, bin_m + _each_m(settings))
    whole = np.where(held[:, 1:], step_m, 0.0).sum(axis=1) + held[:, 0] * (bin_m + _each_m(settings))
    return np.asarray(whole)


def _worth_most(
    places_m: Float[np.ndarray, "cell 2"],
    turned_m: Sequence[Float[np.ndarray, "cell 2"]],
    headings: Sequence[float],
    rest: Bool[np.ndarray, " cell"],
    cell_m: float,
    settings: PatternSettings,
) -> _Stretch:
    """The stretch of any heading that works most of what is left for what it costs.

    Of each band of rows, at a rate, that span is the best which gains most over the rate times its length; the next
    rate is that of the best of all.
    """
    cells = np.rint((places_m[rest] - places_m[rest].min(axis=0)) / cell_m).astype(np.int64)
    inner = np.zeros(cells.max(axis=0) + 1, bool)
    inner[tuple(cells.T)] = True
    weight = np.where(ndimage.binary_erosion(inner)[tuple(cells.T)], 1.0, _BORDER)
    sums = []
    row_m = _spacing_m(settings) / _COARSE
    bin_m = 2.0 * cell_m
    for places in turned_m:
        along, across = (places[rest] - places[rest].min(axis=0)).T
        row, column = (across / row_m).astype(np.int64) + _COARSE, (along / bin_m).astype(np.int64)
        shape = int(row.max()) + 1, int(column.max()) + 1
        held = np.bincount(row * shape[1] + column, weight, shape[0] * shape[1]).reshape(shape)
        upto = np.cumsum(held, axis=0)
        bands = upto[_COARSE:] - upto[:-_COARSE]
        sums.append(np.concatenate([np.zeros((len(bands), 1)), np.cumsum(bands, axis=1)], axis=1))
    rate, best = 0.0, (0, 0, 0, 1)
    for _ in range(_RATES):
        value = -math.inf
        for number, each in enumerate(sums):
            way = each - rate * bin_m * np.arange(each.shape[1])
            least = np.minimum.accumulate(way, axis=1)
            gain = way - least
            band, end = divmod(int(np.argmax(gain)), each.shape[1])
            if gain[band, end] > value:
                value = float(gain[band, end])
                best = number, band, int(np.argmin(way[band, : end + 1])), end
        number, band, begin, end = best
        rate = (sums[number][band, end] - sums[number][band, begin]) / (bin_m * (end - begin) + _each_m(settings))
    number, band, begin, end = best
    low = turned_m[number][rest].min(axis=0)
    across_m = float(low[1]) + row_m * (band + 1 - 0.5 * _COARSE)
    return _Stretch(headings[number], across_m, float(low[0]) + bin_m * begin, float(low[0]) + bin_m * end)


def _holds(stretch: _Stretch, places_m: Float[np.ndarray, "cell 2"], half_m: float) -> Bool[np.ndarray, " cell"]:
    """Which places a stretch of half a width holds."""
    along, across = to_lines(places_m, stretch.heading_rad).T
    held = (np.abs(across - stretch.across_m) <= half_m) & (along >= stretch.low_m) & (along <= stretch.high_m)
    return np.asarray(held)


def _shortened(
    layout: Sequence[_Stretch],
    places_m: Float[np.ndarray, "cell 2"],
    cell_m: float,
    settings: PatternSettings,
) -> list[_Stretch]:
    """Stretches shortened to the work that the others leave, without stretches that have none.

    Args:
        layout: all stretches.
        places_m: positions of the cells.
        cell_m: side of a cell.
        settings: settings of the pattern.
    """
    half_m = 0.5 * (1.0 + 1.0 / _ROWS) * _spacing_m(settings) + _ROUNDING
    held = np.array([_holds(each, places_m, half_m) for each in layout])
    times = held.sum(axis=0)
    kept = []
    for each, own in zip(layout, held, strict=True):
        alone = own & (times == 1)
        times -= own
        if alone.any():
            along = to_lines(places_m[alone], each.heading_rad)[:, 0]
            more_m = _half_m(each.heading_rad, cell_m)
            each = each._replace(low_m=float(along.min()) - more_m, high_m=float(along.max()) + more_m)
            kept.append(each)
            times += _holds(each, places_m, half_m)
    return kept


def _laid(field: Field, layer: TourLayer, stretch: _Stretch, width_m: float) -> list[TourSwath]:
    """Swaths over a stretch, half a tool longer at both ends where the field extends so far."""
    heading, across_m, low, high = stretch
    pieces = strip_pieces(to_lines(field.perimeter_m, heading), across_m, width_m)
    within = [piece for piece in pieces if piece[0] < high and piece[1] > low]
    if within:
        # A pass is sure of a place only some way after it begins, and before it ends.
        low = max(low - 0.5 * width_m, within[0][0])
        high = min(high + 0.5 * width_m, within[-1][1])
    return _either_way(layer.single(heading, across_m, low, high))


def _either_way(found: Sequence[TourSwath]) -> list[TourSwath]:
    """The longer swaths of the two directions, or one swath for either direction if both are alike."""
    if len(found) == 2:
        forward, back = found
        if np.hypot(*(forward.start_m - back.end_m)) < 0.05 and np.hypot(*(forward.end_m - back.start_m)) < 0.05:
            return [forward._replace(either=True)]
    if not found:
        return []
    along = found[0].end_m - found[0].start_m
    ahead: list[TourSwath] = []
    behind: list[TourSwath] = []
    for each in found:
        (ahead if float((each.end_m - each.start_m) @ along) > 0.0 else behind).append(each)
    lengths = [sum(float(np.hypot(*(each.end_m - each.start_m))) for each in way) for way in (ahead, behind)]
    return ahead if lengths[0] >= lengths[1] else behind


def _outline_of_cells(cells: Bool[np.ndarray, "north east"], grid: CellGrid) -> shapely.Geometry:
    """Union of cells as a geometry."""
    edges = np.diff(np.pad(cells, ((0, 0), (1, 1))).astype(np.int8), axis=1)
    rows, firsts = np.nonzero(edges == 1)
    _, lasts = np.nonzero(edges == -1)
    low_x, high_x = grid.east_m + grid.cell_m * firsts, grid.east_m + grid.cell_m * lasts
    low_y = grid.north_m + grid.cell_m * rows
    return shapely.union_all(shapely.box(low_x, low_y, high_x, low_y + grid.cell_m), grid_size=1e-4)
