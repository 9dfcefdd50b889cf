"""Swaths laid where vehicle and tool fit: strips of one heading over what they can cover, others over what they leave.

Which way round a swath is driven decides what of it can be reached where there is no room beyond its end: the tool is
ahead of the vehicle, so it works up to a wall and the vehicle backs out, but it cannot begin at one.
"""

import math
from collections.abc import Iterable, Sequence
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
import shapely
from jaxtyping import Float
from scipy import ndimage

from lgprjax.coverage.field import Tool
from lgprjax.coverage.joints import WIDE_RADII, Terrain
from lgprjax.coverage.parts import workable_cells
from lgprjax.coverage.swaths import PatternSettings, join_spans, line_count, to_lines

_SAFE_M = 0.004
_LEAST_LINE_M = 0.3
_SLIVER_M2 = 1e-9
_SHORTEST_M = 0.15
"""Shortest swath that remains of a longer one within the ground, m: a few rows of the route."""
GAP_M2 = 0.1
"""Smallest unreachable gap reported, m²."""
_LEAST_GAP_M2 = 0.03
_GAP_SHARES = (5e-4, 2e-4)
"""Smallest gap that another swath is laid for, and as a share of the field: at first, and when those are worked."""
_MOST_GAP_SWATHS = 400
_MOST_STRETCHES = 32
"""Strips tried over a gap."""
_MOST_WALLS = 8
_APART_M = 2.0
"""Parts of a gap farther apart along a strip are worked by swaths of their own."""
_EDGES_M = (0.06, 0.0, -0.06, -0.12)
"""Distances of the tool's edge beyond a gap's edge that are tried, m."""
_WALL_PHASE = 3
_LATER_RADII = (0.0, 1.0, 2.0, 3.0)
"""Shifts of an unreachable swath's start, in radii; the rest before it is worked in the other direction."""


class TourSwath(NamedTuple):
    """A candidate swath.

    Attributes:
        start_m, end_m: start and end of the tool's centre.
        either: whether it covers as much in the other direction.
        phase: driving order, lower first: headlands, strips, gaps, swaths along walls.
        wall: whether there is no room for the tail to swing, so that only gentle arcs, or none, lead to it.
        back: alternative in the other direction if the swath itself cannot be reached.
    """

    start_m: Float[np.ndarray, "2"]
    end_m: Float[np.ndarray, "2"]
    either: bool
    phase: int = 1
    wall: bool = False
    back: "TourSwath | None" = None

    def entries(self) -> list["TourSwath"]:
        """The swath in the directions that cover as much."""
        return [self, self._replace(start_m=self.end_m, end_m=self.start_m)] if self.either else [self]


class Laid(NamedTuple):
    """Strips of one heading.

    Attributes:
        heading_rad: heading of the strips.
        swaths: swaths in the planned part of the ground.
        cost_m: approximate cost of driving the swaths.
        apart: swaths in other parts.
    """

    heading_rad: float
    swaths: list[TourSwath]
    cost_m: float
    apart: list[TourSwath]


class TourLayer:
    """Lays swaths where vehicle and tool fit.

    Attributes:
        reach_m2: area of the target that the tool can cover at any heading, in the planned part.
        gaps_m2: smallest gaps for which swaths are laid, in order of the rounds.
        wall_swings_m: swing of the tail without an arc, and in arcs gentler than the tightest: room next to a wall.
    """

    def __init__(self, terrain: Terrain, target: Any, settings: PatternSettings, tool: Tool) -> None:
        self.terrain, self.settings, self._target = terrain, settings, target
        self._half_length_m = 0.5 * tool.length_m
        self._over = terrain.target & terrain.under(tool)
        self._open = self._over & workable_cells(terrain, tool)
        self.reach_m2 = float(np.count_nonzero(self._open)) * terrain.cell_m**2
        least_m2 = (max(_LEAST_GAP_M2, share * float(target.area)) for share in _GAP_SHARES)
        self.gaps_m2 = tuple(dict.fromkeys(least_m2))
        outline = terrain.outline
        half_m = 0.5 * settings.tool_width_m
        # A cell with only its centre worked has an unworked seam; swaths of one heading overlap anyway.
        self._seam_m = min(0.5 * terrain.cell_m, 0.5 * settings.overlap * settings.tool_width_m)
        # Distance of the tool from the border where the vehicle is wider than it, or needs clearance.
        wider_m = max(outline.left_m - settings.tool_left_m, settings.tool_left_m - outline.right_m) - half_m
        # In a turn away from a wall the tail swings towards it.
        sides_m = [
            times * settings.smallest_radius_m + max(outline.left_m, -outline.right_m)
            for times in (1.0, *sorted(WIDE_RADII))
        ]
        swings_m = [math.hypot(side_m, outline.rear_m) - side_m for side_m in sides_m]
        self._swing_m = swings_m[0]
        self.wall_swings_m = (0.0, *swings_m[:0:-1])
        # The first strips are left in gentle arcs; the rest along a wall is worked last.
        edge_m = max(wider_m, 0.0) + max(_SAFE_M, self.wall_swings_m[1] + _SAFE_M)
        self._within = shapely.intersection(target, terrain.ground.kept.buffer(-edge_m, join_style="mitre"))
        self._turned: dict[float, tuple[Any, Any]] = {}

    def lay(self, heading_rad: float) -> Laid:
        """Strips of a heading over the whole field, and about what driving them costs."""
        settings = self.settings
        within, _ = self._in_axes(heading_rad)
        if within.is_empty:
            return Laid(heading_rad, [], math.inf, [])
        low_m, high_m = float(shapely.bounds(within)[1]), float(shapely.bounds(within)[3])
        width_m = settings.tool_width_m
        if high_m - low_m <= width_m:
            places = np.array([0.5 * (low_m + high_m)])
        else:
            count = line_count(high_m - low_m, width_m, settings.overlap)
            places = np.linspace(low_m + 0.5 * width_m, high_m - 0.5 * width_m, count)
        swaths, apart = list[TourSwath](), list[TourSwath]()
        missed_m = 0.0
        for across_m in places:
            found, missed = self.strip(heading_rad, float(across_m))
            for each in found:
                (apart if self.is_apart(each) else swaths).append(each)
            missed_m += missed
        way_m = sum(float(np.hypot(*(each.end_m - each.start_m))) * (1.0 if each.either else 1.5) for each in swaths)
        # Ground missed by strips takes separate swaths, each with a turn.
        turn_m = 2.0 * math.pi * settings.smallest_radius_m
        cost_m = way_m + turn_m * len(swaths) + 3.0 * missed_m if swaths else math.inf
        return Laid(heading_rad, swaths, cost_m, apart)

    def is_apart(self, swath: TourSwath) -> bool:
        """Whether most of what a swath works is in parts of the ground that the plan is not for."""
        half_m = 0.5 * self.settings.tool_width_m
        part, within = self.terrain.in_rectangle(swath.start_m, swath.end_m, half_m, self._half_length_m)
        return bool(2 * np.count_nonzero(self._open[part] & within) < np.count_nonzero(self._over[part] & within))

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
                (a - low + _SAFE_M, b - high - _SAFE_M)
                for a, b in _between(shut, *shapely.bounds(band)[[0, 2]].tolist())
                if b - a > high - low
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
            others = [(low, high) for low, high in spans[not best] if high - low >= _LEAST_LINE_M]
            for low, high in chosen:
                same = any(x <= low + 0.05 and y >= high - 0.05 for x, y in spans[not best])
                ends = (low, high) if best else (high, low)
                start, end = (self._out(heading_rad, along, across_m) for along in ends)
                rear, front = (behind, ahead) if best else (-ahead, -behind)
                body = shapely.box(low + rear, across_m - wide_m, high + front, across_m + wide_m)
                swath = TourSwath(start, end, same, wall=not kept.covers(body))
                if not same and others:
                    common_m, x, y = max((min(y, high) - max(x, low), x, y) for x, y in others)
                    if common_m > 0.5 * (high - low):
                        first, last = (self._out(heading_rad, each, across_m) for each in ((y, x) if best else (x, y)))
                        swath = swath._replace(back=TourSwath(first, last, False, wall=True))
                swaths.append(swath)
            missed_m += b - a - sum(high - low for low, high in chosen)
        return swaths, missed_m

    def fill(
        self,
        swaths: Sequence[TourSwath],
        headings: Sequence[float],
        banned: Sequence[TourSwath] = (),
        swing_m: float | None = None,
        least_m2: float | None = None,
    ) -> list[TourSwath]:
        """The swaths, and more over the reachable rest; none like the banned ones.

        Args:
            swaths: swaths laid before.
            headings: headings to try.
            banned: swaths that cannot be reached.
            swing_m: room left for the tail to swing, of ``wall_swings_m``: only gentle arcs, or none, lead to such a
                swath. ``None``: the swing in a tight turn.
            least_m2: smallest gap; ``None``: the first of ``gaps_m2``.
        """
        terrain, settings = self.terrain, self.settings
        half_m = 0.5 * settings.tool_width_m - self._seam_m
        open_cells = self._open.copy()
        for each in swaths:
            self.mark(open_cells, each, self._seam_m)
        every = list(swaths)
        cell_m2 = terrain.cell_m**2
        least = (self.gaps_m2[0] if least_m2 is None else least_m2) / cell_m2
        ways = list(headings[:4])
        starts = np.array([each.start_m for each in banned]).reshape(-1, 2)
        along = np.array([each.end_m for each in banned]).reshape(-1, 2) - starts
        begins = starts, along / np.maximum(np.hypot(*along.T), 1e-9)[:, None]
        wall, swing_m = swing_m is not None, self._swing_m if swing_m is None else swing_m
        phase = _WALL_PHASE if wall else 2
        # Cells of gaps that no swath was found for as a whole: what winds along walls is tried piece by piece.
        parts = np.zeros_like(open_cells)
        near = math.ceil(settings.tool_width_m / terrain.cell_m)
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
            piecewise = bool(parts[rows[0], columns[0]])
            if piecewise:
                close = (rows - rows[0] <= 2 * near) & (np.abs(columns - columns[0]) <= near)
                rows, columns = rows[close], columns[close]
            places = np.stack([terrain.east_m[columns], terrain.north_m[rows]], axis=1)
            best: tuple[float, TourSwath] | None = None
            stretches = self._stretches(places, ways, swing_m, least)
            for begin in range(0, len(stretches), _MOST_STRETCHES):
                several = stretches[begin : begin + _MOST_STRETCHES]
                # About what it would be worth whole: the rest is worth less.
                if best is not None:
                    break
                found = self._singles([each[1:] for each in several], swing_m)
                for (most, *_), alike in zip(several, found, strict=True):
                    if best is not None and most < best[0]:
                        break
                    for swath in self._other_starts(alike, begins):
                        part, within = terrain.in_rectangle(swath.start_m, swath.end_m, half_m, self._half_length_m)
                        gain = float(np.count_nonzero(open_cells[part] & within))
                        worth = gain / (float(np.hypot(*(swath.end_m - swath.start_m))) + 6.0)
                        if gain >= 0.5 * least and (best is None or worth > best[0]):
                            best = (worth, swath)
            if best is None:
                if wall and not piecewise:
                    parts[rows, columns] = True
                else:
                    open_cells[rows, columns] = False
                continue
            self.mark(open_cells, best[1], self._seam_m)
            back = None if best[1].back is None else best[1].back._replace(phase=phase, wall=wall)
            every.append(best[1]._replace(phase=phase, wall=wall, back=back))
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
        along: dict[float, tuple[np.ndarray, np.ndarray]] = {}
        for heading, across_m in strips:
            if heading not in along:
                x, y = to_lines(places, heading).T
                order = np.argsort(x)
                along[heading] = x[order], y[order]
            x, y = along[heading]
            near = x[np.abs(y - across_m) <= 0.5 * width_m]
            cuts = (np.flatnonzero(near[1:] - near[:-1] > _APART_M) + 1).tolist()
            for first, last in zip([0, *cuts], [*cuts, len(near)], strict=True):
                if last - first < max(0.5 * least, 1.0):
                    continue
                low, high = float(near[first]) - 0.5 * cell_m, float(near[last - 1]) + 0.5 * cell_m
                if high - low < _LEAST_LINE_M:
                    low, high = low - 0.5 * _LEAST_LINE_M, high + 0.5 * _LEAST_LINE_M
                found.append(((last - first) / (high - low + 6.0), heading, across_m, low, high))
        return sorted(found, key=lambda each: -each[0])

    def _other_starts(
        self, swaths: Sequence[TourSwath], banned: tuple[Float[np.ndarray, "swath 2"], Float[np.ndarray, "swath 2"]]
    ) -> list[TourSwath]:
        """Swaths none of which is like those that are banned: one that is begins further on, with room to turn in.

        Args:
            swaths: wanted; banned: places where others begin, and the directions of these.
        """
        starts, ways = banned
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

    def single(self, heading_rad: float, across_m: float, low_m: float, high_m: float) -> list[TourSwath]:
        """Swaths in either direction over a stretch of a strip, independent of the work there; see ``_singles``."""
        return self._singles([(heading_rad, across_m, low_m, high_m)], self._swing_m)[0]

    def _singles(self, stretches: Sequence[tuple[float, float, float, float]], swing_m: float) -> list[list[TourSwath]]:
        """Swaths in either direction over each of several stretches of strips, independent of the work there.

        Args:
            stretches: heading and place across of each, and from where to where along it.
            swing_m: kept clear to both sides: what the tail swings in a tight turn, or nothing.
        """
        settings, outline = self.settings, self.terrain.outline
        # A swath along a wall with no room for the tail to swing is one that nothing leads to.
        left = outline.left_m - settings.tool_left_m + swing_m
        right = outline.right_m - settings.tool_left_m - swing_m
        ahead, behind = outline.front_m - settings.tool_ahead_m, outline.rear_m - settings.tool_ahead_m
        length_m = outline.front_m - outline.rear_m + 0.5
        heading, across, low, high = np.repeat(np.array(stretches), 2, axis=0).T
        forward = np.arange(len(heading)) % 2 == 0
        bottom, top = across + np.where(forward, right, -left), across + np.where(forward, left, -right)
        bands = shapely.box(low - length_m, bottom, high + length_m, top)
        kept = np.array([self._in_axes(float(each), whole=True)[1] for each in heading], object)
        parts, of = shapely.get_parts(shapely.difference(bands, kept), return_index=True)
        solid = shapely.area(parts) >= _SLIVER_M2
        shut: list[list[tuple[float, float]]] = [[] for _ in bands]
        for number, (start, _, end, _) in zip(of[solid].tolist(), shapely.bounds(parts[solid]).tolist(), strict=True):
            shut[number].append((start, end))
        found: list[list[TourSwath]] = [[] for _ in stretches]
        for number, spans in enumerate(shut):
            rear, front = (behind, ahead) if forward[number] else (-ahead, -behind)
            for a, b in _between(join_spans(spans, 0.0), float(low[number]) - length_m, float(high[number]) + length_m):
                start, end = max(float(low[number]), a - rear + _SAFE_M), min(float(high[number]), b - front - _SAFE_M)
                if end - start < _SHORTEST_M:
                    continue
                ends = (start, end) if forward[number] else (end, start)
                first, last = (self._out(float(heading[number]), each, float(across[number])) for each in ends)
                found[number // 2].append(TourSwath(first, last, False))
        return [_paired(each) for each in found]

    def mark(self, cells: np.ndarray, swath: TourSwath, seam_m: float = 0.0) -> None:
        """Take out of cells what a swath works, less a seam to both sides."""
        half_m = 0.5 * self.settings.tool_width_m - seam_m
        part, within = self.terrain.in_rectangle(swath.start_m, swath.end_m, half_m, self._half_length_m)
        cells[part] &= ~within

    def worked_m2(self, swaths: Sequence[TourSwath]) -> float:
        """Area of the target that swaths work."""
        left = self.terrain.target.copy()
        for each in swaths:
            self.mark(left, each)
        return float(np.count_nonzero(self.terrain.target & ~left)) * self.terrain.cell_m**2

    def gain_m2(self, swaths: Iterable[TourSwath]) -> float:
        """Area not yet worked that swaths work together."""
        half_m = 0.5 * self.settings.tool_width_m
        gained = np.zeros_like(self.terrain.unworked)
        for each in swaths:
            part, within = self.terrain.in_rectangle(each.start_m, each.end_m, half_m, self._half_length_m)
            gained[part] |= within
        return float(np.count_nonzero(gained & self.terrain.unworked)) * self.terrain.cell_m**2

    def _walls_near(self, places: Float[np.ndarray, "cell 2"], swing_m: float) -> list[tuple[float, float]]:
        """Heading and position across of strips as near as allowed to the ground's sides next to a gap."""
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
        """Target (as far as the tool reaches near a wall, or whole) and area for the outline, in axes of a heading."""
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


def _paired(swaths: list[TourSwath]) -> list[TourSwath]:
    """Swaths of one strip, each with that the other way round which has most of the way in common."""
    found = []
    for one in swaths:
        way = one.end_m - one.start_m
        length_m = float(np.hypot(*way))
        best_m, back = 0.5 * length_m, None
        for other in swaths:
            low_m, high_m = sorted(
                float((each - one.start_m) @ way) / length_m for each in (other.start_m, other.end_m)
            )
            common_m = min(high_m, length_m) - max(low_m, 0.0)
            if float((other.end_m - other.start_m) @ way) < 0.0 and common_m > best_m:
                best_m, back = common_m, other
        found.append(one._replace(back=back))
    return found


def _extents(shape: Any) -> list[tuple[float, float]]:
    """Extents of a geometry's parts along x; overlapping ones are merged."""
    parts = shapely.get_parts(shape)
    bounds = shapely.bounds(parts[shapely.area(parts) >= _SLIVER_M2])
    return list(join_spans([(low, high) for low, _, high, _ in bounds.tolist()], 0.0))


def _between(shut: Sequence[tuple[float, float]], begin: float, end: float) -> list[tuple[float, float]]:
    """Free parts of a span."""
    free = []
    for low, high in shut:
        if low > begin:
            free.append((begin, low))
        begin = max(begin, high)
    if begin < end:
        free.append((begin, end))
    return free
