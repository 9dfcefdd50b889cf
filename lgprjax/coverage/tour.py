"""Swaths over any field within declared ground, in free order: keep-outs, concave fields, sides without room.

Strips of one heading cover what they can; what they leave is covered by swaths of other headings, along the border
among them. Which way round a swath is driven decides what of it can be reached where there is no room beyond its end:
the tool is ahead of the vehicle, so it works up to a wall and the vehicle backs out, but it cannot begin at one. The
swaths are then strung one by one, each next the cheapest that a way over worked ground or beyond the field leads to.
"""

import math
from collections.abc import Sequence
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
import shapely
from jaxtyping import Float
from scipy import ndimage

from lgprjax.coverage.field import Field, Outline, Tool
from lgprjax.coverage.ground import SafeGround, pose_on_line
from lgprjax.coverage.joints import REVERSE, Terrain, clear_ways, cusps, find_joint, leads_of, sample
from lgprjax.coverage.lattice import Lattice, Tree
from lgprjax.coverage.pattern import Pattern, pattern_of
from lgprjax.coverage.swaths import Line, PatternSettings, line_count, lines_heading_rad, to_lines
from lgprjax.coverage.turns import HeadlandTurn, Pieces, Pose
from lgprjax.errors import InputError

_SAFE_M = 0.01
_LEAST_LINE_M = 0.3
_SHORTEST_M = 0.15
"""Of a swath that the ground leaves of a longer one: a few rows of the route."""
_GAP_M2 = 0.1
_GAP_SHARE = 5e-4
"""Smallest gap that another swath is laid for, and as a share of the field."""
_MOST_GAP_SWATHS = 400
_NEXT = 6
"""Swaths tried in earnest each time."""
_MOST_STRETCHES = 32
"""Strips tried over a gap."""
_MOST_WALLS = 8
_APART_M = 2.0
"""Parts of a gap farther apart along a strip are worked by swaths of their own."""
_EDGES_M = (0.06, 0.0, -0.06, -0.12)
"""How far beyond a gap's edge the tool's own may lie."""
_HEADINGS = 3
_ENOUGH = 0.98
"""Share of what swaths were laid for that is worked, from which no other heading is tried."""
_ROUNDS = 3
_MOST_ENTRIES = 8
_WALL_PHASE = 3
_LATER_RADII = (0.0, 1.0, 2.0, 3.0)
"""By how many radii a swath that nothing leads to begins later: what is left before it is worked the other way."""


class TourSwath(NamedTuple):
    """A swath that may be driven.

    Attributes:
        start_m, end_m: of the tool's centre.
        either: it covers as much the other way round.
        phase: swaths of a lower one are driven before: headlands, strips, gaps, along walls.
        wall: beside it there is no room for the tail to swing: gentle arcs lead to it, or none.
    """

    start_m: Float[np.ndarray, "2"]
    end_m: Float[np.ndarray, "2"]
    either: bool
    phase: int = 1
    wall: bool = False

    def turned(self) -> "TourSwath":
        return self._replace(start_m=self.end_m, end_m=self.start_m)


class Tour(NamedTuple):
    """A plan within declared ground.

    Attributes:
        pattern: the way; its ``unreached`` no way leads to.
        target_m2: area of the field less what must be kept out of.
        worked_m2: of that, what the swaths pass.
        cusps: changes between forward and reverse.
    """

    pattern: Pattern
    target_m2: float
    worked_m2: float
    cusps: int


def plan_tour(
    field: Field,
    ground: SafeGround,
    keep_outs_m: Sequence[Float[np.ndarray, "_ 2"]],
    settings: PatternSettings,
    tool: Tool,
    outline: Outline,
    *,
    name: str,
) -> Tour:
    """Swaths over a field within ground that is declared safe, strung in free order.

    Args:
        field: to be covered.
        ground: see ``ground_of_sides``.
        keep_outs_m: rings, with their buffers.
        settings: of the pattern; its order and its turning room are not used. Without a heading the one with the
            least estimated cost is taken.
        tool: that works; outline: of vehicle and tool.
        name: of the field, or its file, for errors.

    Raises:
        InputError: no swath fits into the ground, or none of them can be begun.
    """
    target = shapely.Polygon(field.perimeter_m)
    if keep_outs_m:
        target = shapely.difference(target, shapely.union_all([shapely.Polygon(each) for each in keep_outs_m]))
    terrain = Terrain(ground, target, outline)
    layer = TourLayer(terrain, target, settings, tool)
    headings = [settings.heading_rad] if settings.heading_rad is not None else _headings(field, ground)
    laid = sorted((layer.lay(each) for each in headings), key=lambda each: each.cost_m)
    best: Tour | None = None
    untouched = terrain.unworked
    ways = _Ways(terrain, laid[0].heading_rad, settings)
    for each in laid[:_HEADINGS]:
        terrain.unworked = untouched.copy()
        swaths = layer.fill(each.swaths, headings)
        if not swaths:
            continue
        tour = string_swaths(field, terrain, layer, swaths, headings, settings, name, ways)
        if best is None or tour.worked_m2 > best.worked_m2 + 1e-3 * tour.target_m2:
            best = tour
        # Another heading helps where ways are missing, not where no swath of any heading fits.
        if best.worked_m2 >= _ENOUGH * layer.worked_m2(swaths):
            break
    if best is None:
        raise no_swath_fits(target, ground, outline, name)
    return best


def no_swath_fits(target: Any, ground: SafeGround, outline: Outline, name: str) -> InputError:
    length_m, width_m = outline.front_m - outline.rear_m, outline.left_m - outline.right_m
    expected = f"room for a vehicle of {length_m:.2f} x {width_m:.2f} m, {ground.clearance_m:.2f} m within the ground"
    widest_m = 2.0 * float(shapely.maximum_inscribed_circle(ground.shape).length)
    return InputError(name, "field", expected, f"{target.area:.1f} m², at most {widest_m:.2f} m wide: no swath fits")


def _headings(field: Field, ground: SafeGround) -> list[float]:
    """Directions worth trying: of the longest sides of field and ground, and across them."""
    lengths: dict[int, float] = {}
    for ring in (field.perimeter_m, *(ring for part in ground.polygons_m for ring in part)):
        sides = np.roll(ring, -1, axis=0) - ring
        for side in sides:
            degree = round(math.degrees(math.atan2(side[1], side[0]))) % 180
            lengths[degree] = lengths.get(degree, 0.0) + float(np.hypot(*side))
    best = sorted(lengths, key=lambda degree: -lengths[degree])[:4]
    exact = lines_heading_rad(field, None)
    found = [exact, exact + 0.5 * math.pi]
    for degree in best:
        for each in (degree, degree + 90):
            heading = math.radians(each)
            if all(abs(math.sin(heading - other)) > math.sin(math.radians(3.0)) for other in found):
                found.append(heading)
    return found


class _Laid(NamedTuple):
    heading_rad: float
    swaths: list[TourSwath]
    cost_m: float


class TourLayer:
    """Lays swaths where vehicle and tool fit."""

    def __init__(self, terrain: Terrain, target: Any, settings: PatternSettings, tool: Tool) -> None:
        self.terrain, self.settings, self._target = terrain, settings, target
        self._half_length_m = 0.5 * tool.length_m
        # Nearer to the border of the ground than the clearance no tool gets.
        self._open = terrain.target & (terrain.away_m > terrain.ground.clearance_m + 0.5 * terrain.cell_m)
        outline = terrain.outline
        half_m = 0.5 * settings.tool_width_m
        # What the tool must stay off where the vehicle is wider than it, or has to keep clear.
        wider_m = max(outline.left_m - settings.tool_left_m, settings.tool_left_m - outline.right_m) - half_m
        # Turning away from a wall the tail swings towards it.
        side_m = settings.smallest_radius_m + max(outline.left_m, -outline.right_m)
        swing_m = math.hypot(side_m, outline.rear_m) - side_m
        self._swing_m = swing_m
        edge_m = max(wider_m, 0.0) + _SAFE_M
        self._within = shapely.intersection(target, terrain.ground.kept.buffer(-edge_m, join_style="mitre"))
        self._turned: dict[float, tuple[Any, Any]] = {}

    def lay(self, heading_rad: float) -> _Laid:
        """Strips of a heading over the whole field, and about what driving them costs."""
        settings = self.settings
        within, _ = self._in_axes(heading_rad)
        if within.is_empty:
            return _Laid(heading_rad, [], math.inf)
        low_m, high_m = float(shapely.bounds(within)[1]), float(shapely.bounds(within)[3])
        width_m = settings.tool_width_m
        if high_m - low_m <= width_m:
            places = np.array([0.5 * (low_m + high_m)])
        else:
            count = line_count(high_m - low_m, width_m, settings.overlap)
            places = np.linspace(low_m + 0.5 * width_m, high_m - 0.5 * width_m, count)
        swaths: list[TourSwath] = []
        missed_m = 0.0
        for across_m in places:
            found, missed = self.strip(heading_rad, float(across_m))
            swaths += found
            missed_m += missed
        way_m = sum(float(np.hypot(*(each.end_m - each.start_m))) * (1.0 if each.either else 1.5) for each in swaths)
        # What strips miss takes swaths of its own, each with a turn.
        turn_m = 2.0 * math.pi * settings.smallest_radius_m
        return _Laid(heading_rad, swaths, way_m + turn_m * len(swaths) + 3.0 * missed_m if swaths else math.inf)

    def strip(
        self, heading_rad: float, across_m: float, low_m: float = -math.inf, high_m: float = math.inf
    ) -> tuple[list[TourSwath], float]:
        """Swaths of one strip between two places along it, and the length of what they do not reach."""
        settings, outline = self.settings, self.terrain.outline
        half_m = 0.5 * settings.tool_width_m
        target, kept = self._in_axes(heading_rad, whole=True)
        wanted = _extents(shapely.intersection(target, _box(target, across_m - half_m, across_m + half_m)))
        wanted = [(max(a, low_m), min(b, high_m)) for a, b in wanted]
        swaths, missed_m = [], 0.0
        left, right = outline.left_m - settings.tool_left_m, outline.right_m - settings.tool_left_m
        wide_m = max(left, -right) + self._swing_m
        free: dict[bool, list[tuple[float, float]]] = {}
        for forward in (True, False):
            # The outline about the tool's centre, in the strip's axes.
            bottom, top = (across_m + right, across_m + left) if forward else (across_m - left, across_m - right)
            band = _box(kept, bottom, top)
            shut = _extents(shapely.difference(band, kept))
            ahead, behind = outline.front_m - settings.tool_ahead_m, outline.rear_m - settings.tool_ahead_m
            low, high = (behind, ahead) if forward else (-ahead, -behind)
            free[forward] = [
                (a - low + _SAFE_M, b - high - _SAFE_M) for a, b in _between(shut, band) if b - a > high - low
            ]
        for a, b in wanted:
            if b - a < 1e-6:
                continue
            spans = {forward: [(max(a, low), min(b, high)) for low, high in free[forward]] for forward in free}
            # The tool works its own length at any moment.
            reach = self._half_length_m
            for forward in spans:
                spans[forward] = [(low, high) for low, high in spans[forward] if high - low > -2.0 * reach]
            covered = {forward: sum(max(high - low, 0.0) for low, high in spans[forward]) for forward in spans}
            best = covered[True] >= covered[False]
            chosen = [(low, high) for low, high in spans[best] if high - low >= _LEAST_LINE_M]
            for low, high in chosen:
                same = any(x <= low + 0.05 and y >= high - 0.05 for x, y in spans[not best])
                ends = (low, high) if best else (high, low)
                start, end = (self._out(heading_rad, along, across_m) for along in ends)
                rear, front = (behind, ahead) if best else (-ahead, -behind)
                body = shapely.box(low + rear, across_m - wide_m, high + front, across_m + wide_m)
                swaths.append(TourSwath(start, end, same, wall=not kept.covers(body)))
            missed_m += b - a - sum(high - low for low, high in chosen)
        return swaths, missed_m

    def fill(
        self,
        swaths: Sequence[TourSwath],
        headings: Sequence[float],
        banned: Sequence[TourSwath] = (),
        *,
        to_wall: bool = False,
    ) -> list[TourSwath]:
        """The swaths, and more of them over what they leave and a tool can reach; none like those that are banned.

        Args:
            swaths: laid before.
            headings: to be tried.
            banned: what nothing leads to.
            to_wall: leave the tail no room to swing: only gentle arcs, or none, lead to such a swath.
        """
        terrain, settings = self.terrain, self.settings
        half_m = 0.5 * settings.tool_width_m
        open_cells = self._open.copy()
        for each in swaths:
            self.mark(open_cells, each)
        every = list(swaths)
        cell_m2 = terrain.cell_m**2
        least = max(_GAP_M2, _GAP_SHARE * float(self._target.area)) / cell_m2
        ways = list(headings[:4])
        swing_m = 0.0 if to_wall else self._swing_m
        for _ in range(_MOST_GAP_SWATHS):
            labels, count = ndimage.label(open_cells)
            if count == 0:
                break
            sizes = np.bincount(labels.ravel())
            sizes[0] = 0
            largest = int(np.argmax(sizes))
            if sizes[largest] < least:
                break
            rows, columns = np.nonzero(labels == largest)
            places = np.stack([terrain.east_m[columns], terrain.north_m[rows]], axis=1)
            best: tuple[float, TourSwath] | None = None
            stretches = self._stretches(places, ways, swing_m, least)
            for tried, (most, heading, across_m, low, high) in enumerate(stretches):
                # About what it would be worth whole: the rest is worth less.
                if best is not None and (most < best[0] or tried >= _MOST_STRETCHES):
                    break
                for swath in self._other_starts(self.single(heading, across_m, low, high, swing_m), banned):
                    part, within = terrain.in_rectangle(swath.start_m, swath.end_m, half_m, self._half_length_m)
                    gain = float(np.count_nonzero(open_cells[part] & within))
                    worth = gain / (float(np.hypot(*(swath.end_m - swath.start_m))) + 6.0)
                    if gain >= 0.5 * least and (best is None or worth > best[0]):
                        best = (worth, swath)
            if best is None:
                open_cells[rows, columns] = False
                continue
            self.mark(open_cells, best[1])
            every.append(best[1]._replace(phase=_WALL_PHASE, wall=True) if to_wall else best[1]._replace(phase=2))
        return every

    def _stretches(
        self, places: Float[np.ndarray, "cell 2"], ways: Sequence[float], swing_m: float, least: float
    ) -> list[tuple[float, float, float, float, float]]:
        """Strips over a gap, those worth most first: about their worth, heading, place across, and span along."""
        width_m, cell_m = self.settings.tool_width_m, self.terrain.cell_m
        strips = self._walls_near(places, swing_m)
        headings = list(ways)
        for heading, _ in strips:
            if len(headings) < len(ways) + 4 and all(abs(math.sin(heading - other)) > 0.02 for other in headings):
                headings.append(heading)
        for heading in headings:
            y = np.sort(places @ np.array([-math.sin(heading), math.cos(heading)]))
            # Where a tool's width holds most of the gap: of a long gap around a bend one limb.
            held = np.searchsorted(y, y + width_m, side="right") - np.arange(len(y))
            begin = int(np.argmax(held))
            low, high = float(y[begin]), float(y[begin + held[begin] - 1])
            # In the middle of it, or with an edge of the tool about at one of its edges.
            edges = (high - 0.5 * width_m, low + 0.5 * width_m)
            shifts = [0.5 * (low + high)]
            shifts += [at + sign * more for at, sign in zip(edges, (1.0, -1.0), strict=True) for more in _EDGES_M]
            if y[-1] - y[0] > width_m:
                shifts += [float(y[0]) + 0.5 * width_m, float(y[-1]) - 0.5 * width_m]
            strips += [(heading, shift) for shift in shifts]
        found = []
        for heading, across_m in strips:
            x, y = to_lines(places, heading).T
            near = np.sort(x[np.abs(y - across_m) <= 0.5 * width_m])
            for run in np.split(near, np.flatnonzero(np.diff(near) > _APART_M) + 1):
                if len(run) < 0.5 * least:
                    continue
                low, high = float(run[0]) - 0.5 * cell_m, float(run[-1]) + 0.5 * cell_m
                if high - low < _LEAST_LINE_M:
                    low, high = low - 0.5 * _LEAST_LINE_M, high + 0.5 * _LEAST_LINE_M
                found.append((len(run) / (high - low + 6.0), heading, across_m, low, high))
        return sorted(found, key=lambda each: -each[0])

    def _other_starts(self, swaths: Sequence[TourSwath], banned: Sequence[TourSwath]) -> list[TourSwath]:
        """Swaths none of which is like those that are banned: one that is begins further on, with room to turn in."""
        if not banned:
            return list(swaths)
        starts = np.array([each.start_m for each in banned])
        ways = np.array([each.end_m - each.start_m for each in banned])
        ways = ways / np.maximum(np.hypot(*ways.T), 1e-9)[:, None]
        found = []
        for swath in swaths:
            way = swath.end_m - swath.start_m
            length_m = float(np.hypot(*way))
            for radii in _LATER_RADII:
                later_m = radii * self.settings.smallest_radius_m
                if later_m > 0.0 and length_m - later_m < 2.0 * _LEAST_LINE_M:
                    break
                moved = swath._replace(start_m=swath.start_m + later_m / length_m * way)
                alike = (np.hypot(*(starts - moved.start_m).T) < 0.5) & (ways @ way > 0.95 * length_m)
                if not alike.any():
                    found.append(moved)
                    break
        return found

    def single(
        self, heading_rad: float, across_m: float, low_m: float, high_m: float, swing_m: float | None = None
    ) -> list[TourSwath]:
        """Swaths either way round over a stretch of a strip, whatever is to be worked there.

        Args:
            heading_rad, across_m: of the strip; low_m, high_m: along it.
            swing_m: kept clear to both sides; ``None`` for what the tail swings in a tight turn.
        """
        swing_m = self._swing_m if swing_m is None else swing_m
        settings, outline = self.settings, self.terrain.outline
        _, kept = self._in_axes(heading_rad, whole=True)
        found = []
        for forward in (True, False):
            left, right = outline.left_m - settings.tool_left_m, outline.right_m - settings.tool_left_m
            bottom, top = (across_m + right, across_m + left) if forward else (across_m - left, across_m - right)
            length_m = outline.front_m - outline.rear_m + 0.5
            # A swath along a wall with no room for the tail to swing is one that nothing leads to.
            bottom, top = bottom - swing_m, top + swing_m
            band = shapely.box(low_m - length_m, bottom, high_m + length_m, top)
            shut = _extents(shapely.difference(band, kept))
            ahead, behind = outline.front_m - settings.tool_ahead_m, outline.rear_m - settings.tool_ahead_m
            low, high = (behind, ahead) if forward else (-ahead, -behind)
            for a, b in _between(shut, band):
                start, end = max(low_m, a - low + _SAFE_M), min(high_m, b - high - _SAFE_M)
                if end - start < _SHORTEST_M:
                    continue
                ends = (start, end) if forward else (end, start)
                first, last = (self._out(heading_rad, each, across_m) for each in ends)
                found.append(TourSwath(first, last, False))
        return found

    def mark(self, cells: np.ndarray, swath: TourSwath) -> None:
        """Take out of cells what a swath works."""
        half_m = 0.5 * self.settings.tool_width_m
        part, within = self.terrain.in_rectangle(swath.start_m, swath.end_m, half_m, self._half_length_m)
        cells[part] &= ~within

    def worked_m2(self, swaths: Sequence[TourSwath]) -> float:
        """Area of the target that swaths work."""
        left = self.terrain.target.copy()
        for each in swaths:
            self.mark(left, each)
        return float(np.count_nonzero(self.terrain.target & ~left)) * self.terrain.cell_m**2

    def gain(self, swath: TourSwath) -> int:
        """How many cells not yet worked a swath works."""
        half_m = 0.5 * self.settings.tool_width_m
        part, within = self.terrain.in_rectangle(swath.start_m, swath.end_m, half_m, self._half_length_m)
        return int(np.count_nonzero(self.terrain.unworked[part] & within))

    def _walls_near(self, places: Float[np.ndarray, "cell 2"], swing_m: float) -> list[tuple[float, float]]:
        """Heading and place across of strips beside the sides of the ground next to a gap, as near as they may be."""
        settings, outline = self.settings, self.terrain.outline
        starts, ends = self._border
        middle = places.mean(axis=0)
        reach_m = 2.0 * settings.tool_width_m + min(float(np.hypot(*(places - middle).T).max()), 12.0)
        ways = ends - starts
        lengths = np.hypot(*ways.T)
        share = np.clip(((middle - starts) * ways).sum(axis=1) / lengths**2, 0.0, 1.0)
        near = np.hypot(*(starts + share[:, None] * ways - middle).T) <= reach_m
        order = np.flatnonzero(near & (lengths > _LEAST_LINE_M))
        found = []
        for side in order[np.argsort(-lengths[order])][:_MOST_WALLS]:
            heading = math.atan2(ways[side, 1], ways[side, 0]) % math.pi
            at_m = float(starts[side] @ np.array([-math.sin(heading), math.cos(heading)]))
            for left_m in {outline.left_m - settings.tool_left_m, settings.tool_left_m - outline.right_m}:
                away_m = left_m + swing_m + 2.0 * _SAFE_M
                found += [(heading, at_m - away_m), (heading, at_m + away_m)]
        return found

    @cached_property
    def _border(self) -> tuple[Float[np.ndarray, "side 2"], Float[np.ndarray, "side 2"]]:
        """Sides of the ground that may be planned on: where they begin and end."""
        starts, ends = [], []
        for part in shapely.get_parts(shapely.simplify(self.terrain.ground.kept, 0.5 * _SAFE_M)):
            for ring in (part.exterior, *part.interiors):
                corners = shapely.get_coordinates(ring)
                starts.append(corners[:-1])
                ends.append(corners[1:])
        return np.concatenate(starts), np.concatenate(ends)

    def _in_axes(self, heading_rad: float, *, whole: bool = False) -> tuple[Any, Any]:
        """What is to be worked (as far as the tool gets beside a wall, or whole) and where the outline may be."""
        key = heading_rad if whole else heading_rad + 100.0
        if key not in self._turned:
            cos, sin = math.cos(heading_rad), math.sin(heading_rad)
            axes = np.array([[cos, -sin], [sin, cos]])
            first = self._target if whole else self._within
            held = tuple(shapely.transform(each, lambda xy: xy @ axes) for each in (first, self.terrain.ground.kept))
            self._turned[key] = (held[0], held[1])
        return self._turned[key]

    def _out(self, heading_rad: float, along_m: float, across_m: float) -> Float[np.ndarray, "2"]:
        cos, sin = math.cos(heading_rad), math.sin(heading_rad)
        return np.array([along_m * cos - across_m * sin, along_m * sin + across_m * cos])


def _box(shape: Any, bottom_m: float, top_m: float) -> Any:
    low, _, high, _ = shapely.bounds(shape)
    return shapely.box(low - 100.0, bottom_m, high + 100.0, top_m)


def _extents(shape: Any) -> list[tuple[float, float]]:
    """From where to where the parts of a geometry reach along x, those that overlap as one."""
    spans: list[tuple[float, float]] = []
    for part in shapely.get_parts(shape):
        if part.area < 1e-9:
            continue
        low, _, high, _ = shapely.bounds(part)
        spans.append((float(low), float(high)))
    merged: list[tuple[float, float]] = []
    for low, high in sorted(spans):
        if merged and low <= merged[-1][1]:
            merged[-1] = (merged[-1][0], max(merged[-1][1], high))
        else:
            merged.append((low, high))
    return merged


def _between(shut: list[tuple[float, float]], band: Any) -> list[tuple[float, float]]:
    """Where a band is free."""
    low, _, high, _ = shapely.bounds(band)
    free, begin = [], float(low)
    for start, end in shut:
        if start > begin:
            free.append((begin, start))
        begin = max(begin, end)
    if begin < high:
        free.append((begin, float(high)))
    return free


# Strung one after the other.


def string_swaths(
    field: Field,
    terrain: Terrain,
    layer: TourLayer,
    swaths: list[TourSwath],
    headings: Sequence[float],
    settings: PatternSettings,
    name: str,
    ways: "_Ways | None" = None,
) -> Tour:
    ways = _Ways(terrain, headings[0], settings) if ways is None else ways
    remaining = list(range(len(swaths)))
    lowest = min(each.phase for each in swaths)
    first = _first(terrain, [each for each in swaths if each.phase == lowest], ways.pose)
    if first is None:
        raise no_swath_fits(shapely.Polygon(field.perimeter_m), terrain.ground, terrain.outline, name)
    swath = first[1]
    number = next(number for number, each in enumerate(swaths) if each is swath or _same(each, swath))
    driven, joints = [(number, swath)], list[Pieces]()
    remaining.remove(number)
    layer.mark(terrain.unworked, swath)
    rounds, failed, walls = 0, list[TourSwath](), False
    given_up: list[TourSwath] = []
    while remaining or not walls:
        if not remaining:
            walls = True
            done = [each for _, each in driven]
            fresh = layer.fill(done, headings, failed, to_wall=True)[len(done) :]
            remaining = list(range(len(swaths), len(swaths) + len(fresh)))
            swaths = [*swaths, *fresh]
            continue
        found = ways.following([each for _, each in driven], joints, [(each, swaths[each]) for each in remaining])
        if found is None:
            # What no way leads to is tried by other swaths.
            rounds += 1
            failed += [swaths[each] for each in remaining]
            given_up += [swaths[each] for each in remaining]
            remaining = []
            if walls:
                break
            if rounds > _ROUNDS:
                continue
            done = [each for _, each in driven]
            fresh = layer.fill(done, headings, failed)[len(done) :]
            remaining = list(range(len(swaths), len(swaths) + len(fresh)))
            swaths = [*swaths, *fresh]
            continue
        _, number, swath, pieces = found
        driven.append((number, swath))
        joints.append(pieces)
        remaining.remove(number)
        layer.mark(terrain.unworked, swath)
    lines = tuple(Line(number + 1, swath.start_m, swath.end_m) for number, swath in driven)
    turns = []
    for way, (_, before) in zip(joints, driven, strict=False):
        x, y, yaw = ways.pose(before, at_end=True)
        turns.append(HeadlandTurn(Pose(float(x), float(y), float(yaw)), way))
    unreached = tuple(
        Line(len(driven) + number + 1, each.start_m, each.end_m) for number, each in enumerate(_left(layer, given_up))
    )
    spacing_m = (1.0 - settings.overlap) * settings.tool_width_m
    pattern = pattern_of(field, settings, lines, tuple(turns), spacing_m, unreached=unreached, name=name)
    target_m2 = float(np.count_nonzero(terrain.target)) * terrain.cell_m**2
    worked_m2 = layer.worked_m2([each for _, each in driven])
    return Tour(pattern, target_m2, worked_m2, sum(cusps(way) for way in joints))


def _left(layer: TourLayer, given_up: Sequence[TourSwath]) -> list[TourSwath]:
    """Of swaths that nothing led to those that would still work something: others may have done instead."""
    found = []
    for each in given_up:
        if layer.gain(each) * layer.terrain.cell_m**2 > _GAP_M2:
            found.append(each)
    return found


def _first(terrain: Terrain, swaths: list[TourSwath], pose: Any) -> tuple[int, TourSwath] | None:
    """The swath to begin with: the vehicle stands before it off the field, with room to turn, and as far out as one.

    Ground off the field is the better the larger it is: out of a narrow way between hedges no other swath is reached.
    """
    best: tuple[tuple[float, float], int, TourSwath] | None = None
    middle = np.mean([0.5 * (each.start_m + each.end_m) for each in swaths], axis=0)
    rooms, _ = ndimage.label(~terrain.unworked & (terrain.away_m > terrain.ground.clearance_m))
    sizes = np.bincount(rooms.ravel())
    sizes[0] = 0
    for number, each in enumerate(swaths):
        for entry in (each, each.turned())[: 2 if each.either else 1]:
            at = pose(entry)
            row, column = terrain.cells(at[None, :2])
            size = float(sizes[rooms[row, column][0]]) / max(int(sizes.max()), 1)
            along = (each.end_m - each.start_m) / max(float(np.hypot(*(each.end_m - each.start_m))), 1e-9)
            aside = abs(float((each.start_m - middle) @ np.array([-along[1], along[0]])))
            value = (min(2.0 * size, 1.0), aside + 0.01 * float(np.hypot(*(each.end_m - each.start_m))))
            if best is None or value > best[0]:
                best = (value, number, entry)
    return None if best is None else (best[1], best[2])


def _about_m(here: np.ndarray, there: np.ndarray, radius_m: float) -> float:
    """About what a way costs at least."""
    apart_m = float(np.hypot(*(there - here)[:2]))
    turned = abs(math.remainder(there[2] - here[2], 2.0 * math.pi))
    return max(apart_m, turned * radius_m)


def _same(one: TourSwath, other: TourSwath) -> bool:
    return one.end_m is other.start_m and one.start_m is other.end_m


_Found = tuple[float, int, TourSwath, Pieces]


class _Ways:
    """Ways from where the vehicle is to swaths not yet driven: one word where it can be, else through a lattice.

    Args:
        terrain: with what is worked so far.
        heading_rad: of the lattice.
        settings: of the pattern.
    """

    def __init__(self, terrain: Terrain, heading_rad: float, settings: PatternSettings) -> None:
        self.terrain, self.radius_m = terrain, settings.smallest_radius_m
        self.out_m = max(settings.tool_ahead_m, 0.0) + 0.1
        self.in_m = max(-settings.tool_ahead_m, 0.0) + 0.1
        half_m = 0.5 * settings.tool_width_m + 0.05
        self.band = (half_m, max(settings.tool_ahead_m, 0.0) + self.radius_m)
        self._tool_m = settings.tool_ahead_m, settings.tool_left_m
        self._heading_rad = heading_rad
        self._lattice: Lattice | None = None
        self._tree: tuple[Pieces, bool, list[Pieces], Tree | None] | None = None

    @property
    def lattice(self) -> Lattice:
        """Made when it is first needed: most fields are driven without."""
        if self._lattice is None:
            self._lattice = Lattice(self.terrain, self._heading_rad, self.radius_m)
        return self._lattice

    def pose(self, swath: TourSwath, *, at_end: bool = False) -> Float[np.ndarray, "3"]:
        """Of the reference point where a swath begins, or ends."""
        at = pose_on_line(Line(1, swath.start_m, swath.end_m), *self._tool_m)
        if at_end:
            at[:2] += swath.end_m - swath.start_m
        return at

    def following(
        self,
        driven: Sequence[TourSwath],
        joints: Sequence[Pieces],
        remaining: Sequence[tuple[int, TourSwath]],
    ) -> _Found | None:
        """The cheapest swath of the lowest phase to go on with; ``None`` where none can be reached.

        Args:
            driven: in order; joints: between them.
            remaining: their numbers and themselves.
        """
        last = driven[-1]
        here, length_m = self.pose(last, at_end=True), float(np.hypot(*(last.end_m - last.start_m)))
        back = _retraced(driven, joints)
        for phase in sorted({each.phase for _, each in remaining}):
            entries = []
            for number, swath in remaining:
                if swath.phase == phase:
                    for entry in (swath, swath.turned())[: 2 if swath.either else 1]:
                        entries.append((_about_m(here, self.pose(entry), self.radius_m), number, entry))
            entries.sort(key=lambda entry: entry[0])
            wide = last.wall or any(each.wall for _, _, each in entries[:_NEXT])
            found = self._direct(here, length_m, entries, wide)
            if found is None:
                found = self._through(here, length_m, back, entries, wide)
            if found is not None:
                return found
        return None

    def _direct(
        self, here: np.ndarray, back_m: float, entries: list[tuple[float, int, TourSwath]], wide: bool
    ) -> _Found | None:
        """The cheapest of the nearest swaths that one word leads to."""
        best: _Found | None = None
        for tried, (about_m, number, entry) in enumerate(entries[:_MOST_ENTRIES]):
            if best is not None and (tried >= _NEXT or about_m > best[0]):
                break
            found = find_joint(
                self.terrain,
                here,
                self.pose(entry),
                self.radius_m,
                back_m=back_m,
                out_m=self.out_m,
                in_m=self.in_m,
                band=self.band,
                limit_m=math.inf if best is None else best[0],
                wide=wide,
            )
            if found is not None:
                best = (found.cost_m, number, entry, found.pieces)
        return best

    def _through(
        self, here: np.ndarray, back_m: float, back: Pieces, entries: list[tuple[float, int, TourSwath]], wide: bool
    ) -> _Found | None:
        """The cheapest of the nearest swaths that a way through the lattice leads to."""
        lattice = self.lattice
        _, ins_m = leads_of(back_m, self.out_m, self.in_m, self.radius_m)
        if self._tree is None or self._tree[0] is not back or self._tree[1] != wide:
            self._tree = (back, wide, *self._outward(here, back_m, back, wide))
        outs, tree = self._tree[2:]
        if tree is None:
            return None
        best: _Found | None = None
        reached = 0
        for about_m, number, entry in entries:
            if best is not None and (reached >= _NEXT or about_m > best[0]):
                break
            goal = self.pose(entry)
            # Into the swath from behind: the same straight ways, from the goal backwards.
            ins, poses, cost = self._ends(goal, [np.array([[-each, 0.0]]) for each in ins_m], check=goal)
            inward = lattice.links(poses, cost / REVERSE, goal, self.band, inward=True, among=tree.near, wide=wide)
            found = tree.joint(here, outs, inward, [-each[::-1] for each in ins]) if len(inward.node) else None
            if found is not None:
                reached += 1
                if best is None or found.cost_m < best[0]:
                    best = (found.cost_m, number, entry, found.pieces)
        return best

    def _outward(self, here: np.ndarray, back_m: float, back: Pieces, wide: bool) -> tuple[list[Pieces], Tree | None]:
        """Ways to poses that the lattice is tried from, and where it leads to from there."""
        lattice = self.lattice
        leads, _ = leads_of(back_m, self.out_m, self.in_m, self.radius_m)
        outs = [np.array([[each, 0.0]]) for each in leads]
        outs, poses, cost = self._ends(here, outs, check=here)
        # The way that led here has been driven, and can be driven back: also where it lined up with a swath.
        whole_m = float(np.abs(back[:, 0]).sum())
        more, more_poses, more_cost = self._ends(here, [_first_part(back, each) for each in _BACK_M if each < whole_m])
        outs, poses, cost = [*outs, *more], np.concatenate([poses, more_poses]), np.concatenate([cost, more_cost])
        outward = lattice.links(poses, cost, here, (0.0, 0.0), inward=False, among=lattice.free, wide=wide)
        return outs, lattice.search(outward) if len(outward.node) else None

    def _ends(
        self, start: np.ndarray, ways: list[Pieces], *, check: np.ndarray | None = None
    ) -> tuple[list[Pieces], Float[np.ndarray, "way 3"], Float[np.ndarray, " way"]]:
        """Ways from a pose, with the poses that they end in and their costs.

        Args:
            start: of all ways; ways: pieces of each.
            check: only those that are clear, but for the ground where the vehicle lines up with this pose.
        """
        if not ways:
            return [], np.zeros((0, 3)), np.zeros(0)
        most = max(len(way) for way in ways)
        padded = np.stack([np.pad(way, ((0, most - len(way)), (0, 0))) for way in ways])
        lengths, bends = padded[..., 0], padded[..., 1]
        poses = sample(start, lengths, bends, np.abs(lengths).sum(axis=1)[:, None])[:, 0]
        cost = np.where(lengths < 0.0, -REVERSE * lengths, lengths).sum(axis=1)
        if check is None:
            return ways, poses, cost
        good, extra_m = clear_ways(self.terrain, start, lengths, bends, check, self.band)
        kept = np.flatnonzero(good)
        return [ways[each] for each in kept], poses[kept], (cost + extra_m)[kept]


_BACK_M = (*np.arange(1.0, 16.0, 1.0), *np.arange(17.0, 60.0, 3.0))
"""How far back along the way that led here the lattice is tried from."""


def _retraced(driven: Sequence[TourSwath], joints: Sequence[Pieces]) -> Pieces:
    """The way that led here, backwards: the same arcs, a negative length, the curvature as it was."""
    parts: list[np.ndarray] = []
    length_m = 0.0
    for number, swath in reversed(list(enumerate(driven))):
        parts.append(np.array([[-float(np.hypot(*(swath.end_m - swath.start_m))), 0.0]]))
        if number > 0:
            parts.append(joints[number - 1][::-1] * np.array([-1.0, 1.0]))
        length_m += sum(float(np.abs(each[:, 0]).sum()) for each in parts[-2:])
        if length_m > _BACK_M[-1]:
            break
    return np.concatenate(parts)


def _first_part(pieces: Pieces, length_m: float) -> Pieces:
    """As much of the beginning of a way."""
    way_m = np.abs(pieces[:, 0])
    ends = np.cumsum(way_m)
    share = np.clip((length_m - (ends - way_m)) / np.maximum(way_m, 1e-12), 0.0, 1.0)
    cut = pieces * np.stack([share, np.ones(len(pieces))], axis=1)
    return np.asarray(cut[share > 0.0])
