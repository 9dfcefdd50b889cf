"""Swaths over any field within declared ground, in free order: keep-outs, concave fields, sides without room.

Strips of one heading cover what they can; what they leave is covered by swaths of other headings, along the border
among them. Which way round a swath is driven decides what of it can be reached where there is no room beyond its end:
the tool is ahead of the vehicle, so it works up to a wall and the vehicle backs out, but it cannot begin at one. The
swaths are then strung one by one, each next the cheapest that a way over worked ground or beyond the field leads to.
"""

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import shapely
from jaxtyping import Float
from scipy import ndimage

from lgprjax.coverage.field import Field, Outline, Tool
from lgprjax.coverage.ground import SafeGround, pose_on_line
from lgprjax.coverage.joints import Joint, Terrain, cusps, find_joint, joined
from lgprjax.coverage.pattern import Pattern, pattern_of
from lgprjax.coverage.swaths import Line, PatternSettings, line_count, lines_heading_rad
from lgprjax.coverage.turns import HeadlandTurn, Pieces, Pose
from lgprjax.errors import InputError

_SAFE_M = 0.01
_LEAST_LINE_M = 0.3
_GAP_M2 = 0.1
_GAP_SHARE = 5e-4
"""Smallest gap that another swath is laid for, and as a share of the field."""
_MOST_GAP_SWATHS = 400
_NEXT = 6
"""Swaths tried in earnest each time."""
_EDGES_M = (0.06, 0.0, -0.06, -0.12)
"""How far beyond a gap's edge the tool's own may lie."""
_HEADINGS = 3
_ENOUGH = 0.985
"""Share of what can be worked that is worked, from which no other heading is tried."""
_ROUNDS = 3
_MOST_ENTRIES = 24
_MOST_BACK = 5
_GOALS = 5
_HUBS = 12
_LAST_PHASE = 2


class TourSwath(NamedTuple):
    """A swath that may be driven.

    Attributes:
        start_m, end_m: of the tool's centre.
        either: it covers as much the other way round.
        phase: swaths of a lower one are driven before: headlands, strips, gaps.
    """

    start_m: Float[np.ndarray, "2"]
    end_m: Float[np.ndarray, "2"]
    either: bool
    phase: int = 1

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
    for each in laid[:_HEADINGS]:
        terrain.unworked = untouched.copy()
        swaths = layer.fill(each.swaths, headings)
        if not swaths:
            continue
        tour = string_swaths(field, terrain, layer, swaths, headings, settings, name)
        if best is None or tour.worked_m2 > best.worked_m2 + 1e-3 * tour.target_m2:
            best = tour
        if best.worked_m2 >= _ENOUGH * layer.open_m2:
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
    swaths: list[TourSwath]
    cost_m: float


class TourLayer:
    """Lays swaths where vehicle and tool fit."""

    def __init__(self, terrain: Terrain, target: Any, settings: PatternSettings, tool: Tool) -> None:
        self.terrain, self.settings, self._target = terrain, settings, target
        self._half_length_m = 0.5 * tool.length_m
        # Nearer to the border of the ground than the clearance no tool gets.
        self._open = terrain.target & (terrain.away_m > terrain.ground.clearance_m + 0.5 * terrain.cell_m)
        self.open_m2 = float(np.count_nonzero(self._open)) * terrain.cell_m**2
        outline = terrain.outline
        half_m = 0.5 * settings.tool_width_m
        # What the tool must stay off where the vehicle is wider than it, or has to keep clear.
        wider_m = max(outline.left_m - settings.tool_left_m, settings.tool_left_m - outline.right_m) - half_m
        # Turning away from a wall the tail swings towards it.
        side_m = settings.smallest_radius_m + max(outline.left_m, -outline.right_m)
        swing_m = math.hypot(side_m, outline.rear_m) - side_m
        self._swing_m = swing_m
        edge_m = max(wider_m, 0.0) + swing_m + _SAFE_M
        self._within = shapely.intersection(target, terrain.ground.kept.buffer(-edge_m, join_style="mitre"))
        self._turned: dict[float, tuple[Any, Any]] = {}

    def lay(self, heading_rad: float) -> _Laid:
        """Strips of a heading over the whole field, and about what driving them costs."""
        settings = self.settings
        within, _ = self._in_axes(heading_rad)
        if within.is_empty:
            return _Laid([], math.inf)
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
        return _Laid(swaths, way_m + turn_m * len(swaths) + 3.0 * missed_m if swaths else math.inf)

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
        free: dict[bool, list[tuple[float, float]]] = {}
        for forward in (True, False):
            # The outline about the tool's centre, in the strip's axes.
            left, right = outline.left_m - settings.tool_left_m, outline.right_m - settings.tool_left_m
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
                swaths.append(TourSwath(start, end, same))
            missed_m += b - a - sum(high - low for low, high in chosen)
        return swaths, missed_m

    def fill(
        self, swaths: Sequence[TourSwath], headings: Sequence[float], banned: Sequence[TourSwath] = ()
    ) -> list[TourSwath]:
        """The swaths, and more of them over what they leave and a tool can reach; none like those that are banned."""
        terrain, settings = self.terrain, self.settings
        half_m = 0.5 * settings.tool_width_m
        open_cells = self._open.copy()
        for each in swaths:
            self.mark(open_cells, each)
        every = list(swaths)
        cell_m2 = terrain.cell_m**2
        least = max(_GAP_M2, _GAP_SHARE * float(self._target.area)) / cell_m2
        ways = list(headings[:4])
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
            for heading in self._ways_near(places, ways):
                along = np.array([math.cos(heading), math.sin(heading)])
                x, y = places @ along, places @ np.array([-along[1], along[0]])
                middle = 0.5 * (float(y.min()) + float(y.max()))
                shifts: tuple[float, ...]
                if np.ptp(y) > settings.tool_width_m:
                    shifts = (float(y.min()) + half_m, float(y.max()) - half_m)
                else:
                    # In the middle of the gap, or with an edge of the tool about at one of the gap's.
                    edges = (float(y.max()) - half_m, float(y.min()) + half_m)
                    shifts = (
                        middle,
                        *(at + sign * more for at, sign in zip(edges, (1.0, -1.0), strict=True) for more in _EDGES_M),
                    )
                for across_m in shifts:
                    near = np.abs(y - across_m) <= half_m
                    if not near.any():
                        continue
                    low, high = float(x[near].min()) - 0.5 * terrain.cell_m, float(x[near].max()) + 0.5 * terrain.cell_m
                    if high - low < _LEAST_LINE_M:
                        low, high = low - 0.5 * _LEAST_LINE_M, high + 0.5 * _LEAST_LINE_M
                    for swath in self.single(heading, across_m, low, high):
                        if any(_alike(swath, other) for other in banned):
                            continue
                        part, within = terrain.in_rectangle(swath.start_m, swath.end_m, half_m, self._half_length_m)
                        gain = float(np.count_nonzero(open_cells[part] & within))
                        worth = gain / (float(np.hypot(*(swath.end_m - swath.start_m))) + 6.0)
                        if gain >= 0.5 * least and (best is None or worth > best[0]):
                            best = (worth, swath)
            if best is None:
                open_cells[rows, columns] = False
                continue
            self.mark(open_cells, best[1])
            every.append(best[1]._replace(phase=2))
        return every

    def single(self, heading_rad: float, across_m: float, low_m: float, high_m: float) -> list[TourSwath]:
        """Swaths either way round over a stretch of a strip, whatever is to be worked there."""
        settings, outline = self.settings, self.terrain.outline
        _, kept = self._in_axes(heading_rad, whole=True)
        found = []
        for forward in (True, False):
            left, right = outline.left_m - settings.tool_left_m, outline.right_m - settings.tool_left_m
            bottom, top = (across_m + right, across_m + left) if forward else (across_m - left, across_m - right)
            length_m = outline.front_m - outline.rear_m + 0.5
            # A swath along a wall with no room for the tail to swing is one that nothing leads to.
            bottom, top = bottom - self._swing_m, top + self._swing_m
            band = shapely.box(low_m - length_m, bottom, high_m + length_m, top)
            shut = _extents(shapely.difference(band, kept))
            ahead, behind = outline.front_m - settings.tool_ahead_m, outline.rear_m - settings.tool_ahead_m
            low, high = (behind, ahead) if forward else (-ahead, -behind)
            for a, b in _between(shut, band):
                start, end = max(low_m, a - low + _SAFE_M), min(high_m, b - high - _SAFE_M)
                if end - start < 0.05:
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

    def _ways_near(self, places: Float[np.ndarray, "cell 2"], ways: Sequence[float]) -> list[float]:
        """The headings, and those of the ground's border next to a gap."""
        middle = places.mean(axis=0)
        radius_m = 1.0 + float(np.hypot(*(places - middle).T).max())
        near = shapely.intersection(self._border, shapely.Point(middle).buffer(min(radius_m, 12.0)))
        sides: list[tuple[float, float]] = []
        for line in shapely.get_parts(near):
            if line.geom_type != "LineString":
                continue
            corners = shapely.get_coordinates(line)
            for side in np.diff(corners, axis=0):
                sides.append((-float(np.hypot(*side)), math.atan2(side[1], side[0]) % math.pi))
        found = list(ways)
        for length, heading in sorted(sides)[:8]:
            if -length > 0.4 and all(abs(math.sin(heading - other)) > 0.02 for other in found):
                found.append(heading)
            if len(found) >= len(ways) + 4:
                break
        return found

    @property
    def _border(self) -> Any:
        if not hasattr(self, "_simple"):
            self._simple = shapely.simplify(self.terrain.ground.kept, 0.08).boundary
        return self._simple

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


def _alike(one: TourSwath, other: TourSwath) -> bool:
    """Whether two swaths end at about the same place and heading."""
    a, b = one.end_m - one.start_m, other.end_m - other.start_m
    lengths = float(np.hypot(*a) * np.hypot(*b))
    return bool(np.hypot(*(one.start_m - other.start_m)) < 0.5 and float(a @ b) > 0.95 * lengths)


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
) -> Tour:
    ahead_m, left_m = settings.tool_ahead_m, settings.tool_left_m
    outline, radius_m = terrain.outline, settings.smallest_radius_m
    half_m = 0.5 * settings.tool_width_m + 0.05
    band = (half_m, max(ahead_m, 0.0) + radius_m)

    def pose(swath: TourSwath, at_end: bool = False) -> Float[np.ndarray, "3"]:
        at = pose_on_line(Line(1, swath.start_m, swath.end_m), ahead_m, left_m)
        if at_end:
            at[:2] += swath.end_m - swath.start_m
        return at

    def joint(start: np.ndarray, back_m: float, swath: TourSwath, limit_m: float = math.inf) -> Joint | None:
        return find_joint(
            terrain,
            start,
            pose(swath),
            radius_m,
            back_m=back_m,
            out_m=max(ahead_m, 0.0) + 0.1,
            in_m=max(-ahead_m, 0.0) + 0.1,
            band=band,
            limit_m=limit_m,
        )

    remaining = list(range(len(swaths)))
    lowest = min(each.phase for each in swaths)
    first = _first(terrain, [each for each in swaths if each.phase == lowest], pose)
    if first is None:
        raise no_swath_fits(shapely.Polygon(field.perimeter_m), terrain.ground, outline, name)
    _, swath = first
    number = next(number for number, each in enumerate(swaths) if each is swath or _same(each, swath))
    driven, ways = [(number, swath)], list[Pieces]()
    remaining.remove(number)
    layer.mark(terrain.unworked, swath)
    rounds, failed = 0, list[TourSwath]()
    while remaining:
        phase = min(swaths[each].phase for each in remaining)
        found = None
        for phases in range(phase, _LAST_PHASE + 1):
            chosen = [each for each in remaining if swaths[each].phase == phases]
            found = _next(terrain, driven, ways, [(each, swaths[each]) for each in chosen], pose, joint, radius_m)
            if found is not None:
                break
        if found is None:
            # What no way leads to is tried by other swaths.
            rounds += 1
            failed += [swaths[each] for each in remaining]
            if rounds > _ROUNDS:
                break
            done = [each for _, each in driven]
            fresh = layer.fill(done, headings, failed)[len(done) :]
            if not fresh:
                break
            remaining = list(range(len(swaths), len(swaths) + len(fresh)))
            swaths = [*swaths, *fresh]
            continue
        _, number, swath, pieces = found
        driven.append((number, swath))
        ways.append(pieces)
        remaining.remove(number)
        layer.mark(terrain.unworked, swath)
    lines = tuple(Line(number + 1, swath.start_m, swath.end_m) for number, swath in driven)
    turns = []
    for way, (_, before) in zip(ways, driven, strict=False):
        x, y, yaw = pose(before, at_end=True)
        turns.append(HeadlandTurn(Pose(float(x), float(y), float(yaw)), way))
    unreached = tuple(Line(number + 1, swaths[number].start_m, swaths[number].end_m) for number in remaining)
    spacing_m = (1.0 - settings.overlap) * settings.tool_width_m
    pattern = pattern_of(field, settings, lines, tuple(turns), spacing_m, unreached=unreached, name=name)
    left = terrain.target.copy()
    for _, swath in driven:
        layer.mark(left, swath)
    cell_m2 = terrain.cell_m**2
    target_m2 = float(np.count_nonzero(terrain.target)) * cell_m2
    worked_m2 = target_m2 - float(np.count_nonzero(left)) * cell_m2
    return Tour(pattern, target_m2, worked_m2, sum(cusps(way) for way in ways))


def _first(terrain: Terrain, swaths: list[TourSwath], pose: Any) -> tuple[int, TourSwath] | None:
    """The swath to begin with: one that the vehicle stands before, off the field, as far out as there is one."""
    best: tuple[tuple[bool, float], int, TourSwath] | None = None
    middle = np.mean([0.5 * (each.start_m + each.end_m) for each in swaths], axis=0)
    for number, each in enumerate(swaths):
        for entry in (each, each.turned())[: 2 if each.either else 1]:
            at = pose(entry)
            row, column = terrain.cells(at[None, :2])
            off = not bool(terrain.unworked[row, column][0])
            along = (each.end_m - each.start_m) / max(float(np.hypot(*(each.end_m - each.start_m))), 1e-9)
            aside = abs(float((each.start_m - middle) @ np.array([-along[1], along[0]])))
            value = (off, aside + 0.01 * float(np.hypot(*(each.end_m - each.start_m))))
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


def _next(
    terrain: Terrain,
    driven: list[tuple[int, TourSwath]],
    ways: list[Pieces],
    remaining: list[tuple[int, TourSwath]],
    pose: Any,
    joint: Any,
    radius_m: float,
) -> _Found | None:
    """The cheapest swath to go on with. Where none can be reached from here, the way that led here is driven back."""
    retraced: list[Pieces] = []
    retraced_m = 0.0
    for depth in range(min(len(driven), _MOST_BACK)):
        last = driven[-1 - depth][1]
        here, length_m = pose(last, at_end=True), float(np.hypot(*(last.end_m - last.start_m)))
        entries = []
        for number, swath in remaining:
            for entry in (swath, swath.turned())[: 2 if swath.either else 1]:
                entries.append((_about_m(here, pose(entry), radius_m), number, entry))
        entries.sort(key=lambda entry: entry[0])
        if depth > 0:
            entries = entries[:_NEXT]
        best = _direct(here, length_m, entries, joint)
        if best is None and depth == 0:
            best = _by_hub(terrain, here, length_m, entries, driven, pose, joint, radius_m)
        if best is not None:
            if not retraced:
                return best
            return best[0] + retraced_m, best[1], best[2], joined(np.concatenate([*retraced, best[3]]))
        if depth >= len(ways):
            break
        # The same arcs the other way: a negative length, the curvature as it was.
        back = np.concatenate([[[-length_m, 0.0]], ways[-1 - depth][::-1] * np.array([-1.0, 1.0])])
        retraced.append(back)
        retraced_m += float(np.abs(back[:, 0]).sum())
    return None


def _direct(here: np.ndarray, back_m: float, entries: list[tuple[float, int, TourSwath]], joint: Any) -> _Found | None:
    """The cheapest of the nearest swaths that one way leads to."""
    best: _Found | None = None
    for tried, (about_m, number, entry) in enumerate(entries[:_MOST_ENTRIES]):
        if best is not None and (tried >= _NEXT or about_m > best[0]):
            break
        found = joint(here, back_m, entry, math.inf if best is None else best[0])
        if found is not None and (best is None or found.cost_m < best[0]):
            best = (found.cost_m, number, entry, found.pieces)
    return best


def _by_hub(
    terrain: Terrain,
    here: np.ndarray,
    back_m: float,
    entries: list[tuple[float, int, TourSwath]],
    driven: list[tuple[int, TourSwath]],
    pose: Any,
    joint: Any,
    radius_m: float,
) -> _Found | None:
    """By way of a pose on a swath driven before, either way round: where no single way leads."""
    hubs = []
    for _, swath in driven:
        start, end = pose(swath), pose(swath, at_end=True)
        for share in (0.0, 0.5, 1.0):
            at = start + share * (end - start)
            hubs += [at, at + np.array([0.0, 0.0, math.pi])]
    held = np.array(hubs)
    held = held[terrain.fits(held)]
    for _, number, entry in entries[:_GOALS]:
        goal = pose(entry)
        apart_m = np.hypot(*(held[:, :2] - goal[:2]).T)
        near = held[np.argsort(apart_m)[:_HUBS]]
        # From the goal's side first: few hubs lead on to it.
        for hub in near:
            second = joint(hub, 0.0, entry, math.inf)
            if second is None:
                continue
            first = find_joint(
                terrain, here, hub, radius_m, back_m=back_m, out_m=radius_m, in_m=radius_m, band=(0.0, 0.0)
            )
            if first is not None:
                pieces = joined(np.concatenate([first.pieces, second.pieces]))
                return first.cost_m + second.cost_m, number, entry, pieces
    return None
