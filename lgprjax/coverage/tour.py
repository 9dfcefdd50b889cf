"""Swaths over any field within declared ground, in free order: keep-outs, concave fields, sides without room.

Swaths are laid (``layer``), strips of one heading and others over what these leave, along the border among them. They
are then strung one by one, each next the cheapest that a way over worked ground or beyond the field leads to.
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
from lgprjax.coverage.joints import REVERSE, Terrain, clear_ways, cusps, find_joint, leads_of, poses_ahead, sample
from lgprjax.coverage.lattice import Lattice, Tree
from lgprjax.coverage.layer import GAP_M2, TourLayer, TourSwath
from lgprjax.coverage.pattern import Pattern, pattern_of
from lgprjax.coverage.swaths import Line, PatternSettings, lines_heading_rad
from lgprjax.coverage.turns import HeadlandTurn, Pieces, Pose
from lgprjax.errors import InputError

_NEXT = 6
"""Swaths tried in earnest each time."""
_HEADINGS = 3
_ENOUGH = 0.985
"""Share of what the tool can be over that is worked, from which no other heading is tried."""
_ROUNDS = 3
_MOST_ENTRIES = 8
_CELL_M = 0.05
"""Cell of the raster of small ground, m: strips along walls are a larger share of a small field."""
_MUCH = 0.01
"""Share of what the tool can be over: more that no way leads to is sought by a finer lattice, or another beginning."""
_FIRSTS = 8
"""Swaths tried to begin with."""


class Tour(NamedTuple):
    """A plan within declared ground.

    Attributes:
        pattern: pattern of the tour; its ``unreached`` lines cannot be reached.
        target_m2: area of the field minus keep-outs.
        worked_m2: area of the target that the swaths pass.
        cusps: number of changes between forward and reverse.
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
    """Swaths over a field within safe ground, joined in free order.

    Args:
        field: field to cover.
        ground: safe ground, see ``ground_of_sides``.
        keep_outs_m: rings of the keep-outs, including their buffers.
        settings: settings of the pattern; its order and its turning room are not used. Without a heading the one with
            the least estimated cost is taken.
        tool: working tool.
        outline: outline of vehicle and tool.
        name: name of the field or its file, for errors.

    Raises:
        InputError: no swath fits into the ground, or none of them can be begun.
    """
    target = shapely.Polygon(field.perimeter_m)
    if keep_outs_m:
        target = shapely.difference(target, shapely.union_all([shapely.Polygon(each) for each in keep_outs_m]))
    terrain = Terrain(ground, target, outline, finest_m=_CELL_M)
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
        tour = string_swaths(field, layer, [*swaths, *each.apart], headings, name, ways)
        better = best is None or tour.worked_m2 > best.worked_m2 + 1e-3 * tour.target_m2
        best = tour if best is None or better else best
        # Where another heading is no better, what is left is not a matter of headings.
        if best.worked_m2 >= _ENOUGH * layer.reach_m2 or not better:
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


# Strung one after the other.


def string_swaths(
    field: Field,
    layer: TourLayer,
    swaths: list[TourSwath],
    headings: Sequence[float],
    name: str,
    ways: "_Ways | None" = None,
) -> Tour:
    """A tour of swaths, always the cheapest next, with more swaths over the work left by unreachable ones.

    Args:
        field: field to cover.
        layer: layer that lays swaths; worked cells are marked in its terrain.
        swaths: swaths to join; those in parts of the ground outside the layer's are left out.
        headings: headings of additional swaths.
        name: name of the field or its file, for errors.
        ways: search for ways, known from an earlier tour.
    """
    terrain, settings = layer.terrain, layer.settings
    ways = _Ways(terrain, headings[0], settings) if ways is None else ways
    apart = [each for each in swaths if layer.is_apart(each)]
    # If all of them are apart, the raster is too coarse for the fitting swaths.
    swaths = [each for each in swaths if not layer.is_apart(each)] or swaths
    lowest = min(each.phase for each in swaths)
    firsts = [entry for entry, _ in _firsts(terrain, [each for each in swaths if each.phase == lowest], ways.pose)]
    untouched = terrain.unworked.copy()
    best = _string(layer, ways, firsts, swaths, headings)
    if layer.gain_m2(best.left) > _MUCH * layer.reach_m2:
        # A neck that is open in the raster may be closed in fact: more may be reached from the other side.
        worked, terrain.unworked = terrain.unworked, untouched
        lowest = min(each.phase for each in best.left)
        begins = _firsts(terrain, [each for each in best.left if each.phase == lowest], ways.pose)
        others = [entry for entry, share in begins if share > 0.0]
        other = _string(layer, ways, others, swaths, headings) if others else best
        if layer.worked_m2(other.driven) > layer.worked_m2(best.driven):
            best = other
        else:
            terrain.unworked = worked
    lines = tuple(Line(number, each.start_m, each.end_m) for number, each in enumerate(best.driven, start=1))
    turns = []
    for way, before in zip(best.joints, best.driven, strict=False):
        x, y, yaw = ways.pose(before, at_end=True)
        turns.append(HeadlandTurn(Pose(float(x), float(y), float(yaw)), way))
    unreached = tuple(
        Line(number, each.start_m, each.end_m)
        for number, each in enumerate(_left(layer, [*apart, *best.left]), start=len(lines) + 1)
    )
    spacing_m = (1.0 - settings.overlap) * settings.tool_width_m
    pattern = pattern_of(field, settings, lines, tuple(turns), spacing_m, unreached=unreached, name=name)
    target_m2 = float(np.count_nonzero(terrain.target)) * terrain.cell_m**2
    return Tour(pattern, target_m2, layer.worked_m2(best.driven), sum(cusps(way) for way in best.joints))


class _Strung(NamedTuple):
    """Swaths in driving order, the ways between them, and swaths that no way led to."""

    driven: list[TourSwath]
    joints: list[Pieces]
    left: list[TourSwath]


def _string(
    layer: TourLayer,
    ways: "_Ways",
    firsts: Sequence[TourSwath],
    swaths: Sequence[TourSwath],
    headings: Sequence[float],
) -> _Strung:
    """Swaths strung from the first of ``firsts`` from which a way leads on; see ``string_swaths``."""
    terrain, untouched = layer.terrain, layer.terrain.unworked
    # The best of them, should nothing lead on from any.
    for swath in (*firsts, firsts[0]):
        terrain.unworked = untouched.copy()
        layer.mark(terrain.unworked, swath)
        remaining = [each for each in swaths if each is not swath and not _same(each, swath)]
        # Out of a place with no room to turn nothing leads on.
        if ways.following([swath], [], list(enumerate(remaining))) is not None:
            break
    driven, joints = [swath], list[Pieces]()
    failed, left = list[TourSwath](), list[TourSwath]()
    # Unreachable and remaining work is tried with other swaths: a few times, along walls, and then in smaller gaps.
    again: list[tuple[float | None, float]] = [(None, layer.gaps_m2[0])] * (_ROUNDS - 1)
    fills = [*again, *((each, least_m2) for least_m2 in layer.gaps_m2 for each in (None, *layer.wall_swings_m))]
    while remaining or fills:
        found = ways.following(driven, joints, list(enumerate(remaining)))
        if found is not None:
            _, number, swath, pieces = found
            driven.append(swath)
            joints.append(pieces)
            del remaining[number]
            layer.mark(terrain.unworked, swath)
            continue
        if layer.gain_m2(remaining) > _MUCH * layer.reach_m2 and ways.refine():
            continue
        failed += [each for swath in remaining for each in (swath, swath.back) if each is not None]
        left += remaining
        if not remaining:
            # Gaps of that size remain only along walls.
            fills = [each for each in fills if each not in again]
        if not fills:
            break
        remaining = layer.fill(driven, headings, failed, *fills.pop(0))[len(driven) :]
    return _Strung(driven, joints, left)


def _left(layer: TourLayer, given_up: Sequence[TourSwath]) -> list[TourSwath]:
    """Unreachable swaths that would still work something that no other swath has worked."""
    terrain = layer.terrain
    found = list[TourSwath]()
    before, terrain.unworked = terrain.unworked, terrain.unworked.copy()
    for each in sorted(given_up, key=lambda each: -layer.gain_m2([each])):
        if layer.gain_m2([each]) > GAP_M2:
            found.append(each)
            layer.mark(terrain.unworked, each)
    terrain.unworked = before
    return found


def _firsts(terrain: Terrain, swaths: list[TourSwath], pose: Any) -> list[tuple[TourSwath, float]]:
    """Swaths to begin with, the best first: the vehicle starts off the field, with room to turn, far out.

    With each comes the size of the ground off the field from which it begins, as a share of the largest: from a narrow
    way between hedges no other swath can be reached.
    """
    found = list[tuple[tuple[float, float], TourSwath, float]]()
    middle = np.mean([0.5 * (each.start_m + each.end_m) for each in swaths], axis=0)
    rooms, _ = ndimage.label(~terrain.unworked & (terrain.away_m > terrain.ground.clearance_m))
    sizes = np.bincount(rooms.ravel())
    sizes[0] = 0
    for each in swaths:
        for entry in each.entries():
            at = pose(entry)
            row, column = terrain.cells(at[None, :2])
            size = float(sizes[rooms[row, column][0]]) / max(int(sizes.max()), 1)
            along = (each.end_m - each.start_m) / max(float(np.hypot(*(each.end_m - each.start_m))), 1e-9)
            aside = abs(float((each.start_m - middle) @ np.array([-along[1], along[0]])))
            value = (min(2.0 * size, 1.0), aside + 0.01 * float(np.hypot(*(each.end_m - each.start_m))))
            found.append((value, entry, size))
    return [each[1:] for each in sorted(found, key=lambda each: each[0], reverse=True)][:_FIRSTS]


def _about_m(here: np.ndarray, there: np.ndarray, radius_m: float) -> float:
    """About what a way costs at least."""
    apart_m = float(np.hypot(*(there - here)[:2]))
    turned = abs(math.remainder(there[2] - here[2], 2.0 * math.pi))
    return max(apart_m, turned * radius_m)


def _same(one: TourSwath, other: TourSwath) -> bool:
    return one.end_m is other.start_m and one.start_m is other.end_m


_Found = tuple[float, int, TourSwath, Pieces]


class _Ways:
    """Ways from the vehicle's pose to swaths not yet driven: one word if possible, else through a lattice.

    Args:
        terrain: raster with the cells worked so far.
        heading_rad: heading of the lattice.
        settings: settings of the pattern.
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
        """The lattice, built on first use: most fields need none."""
        if self._lattice is None:
            self._lattice = Lattice(self.terrain, self._heading_rad, self.radius_m)
        return self._lattice

    def refine(self) -> bool:
        """Refine the lattice if possible: narrow places may lead between its nodes."""
        finer = self.lattice.finer()
        self._lattice, self._tree = finer or self._lattice, None
        return finer is not None

    def pose(self, swath: TourSwath, *, at_end: bool = False) -> Float[np.ndarray, "3"]:
        """Pose of the reference point at the beginning, or the end, of a swath."""
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
        """The cheapest next swath of the lowest phase; ``None`` if none can be reached.

        Args:
            driven: driven swaths in order.
            joints: ways between the driven swaths.
            remaining: remaining swaths with their numbers.
        """
        last = driven[-1]
        here, length_m = self.pose(last, at_end=True), float(np.hypot(*(last.end_m - last.start_m)))
        back = _retraced(driven, joints)
        for phase in sorted({each.phase for _, each in remaining}):
            own = [(number, swath) for number, swath in remaining if swath.phase == phase]
            others = [(number, swath.back) for number, swath in own if swath.back is not None]
            for several in (own, others):
                entries = []
                for number, swath in several:
                    for entry in swath.entries():
                        entries.append((_about_m(here, self.pose(entry), self.radius_m), number, entry))
                entries.sort(key=lambda entry: entry[0])
                wide = last.wall or any(each.wall for _, _, each in entries[:_NEXT])
                found = self._direct(here, length_m, entries, wide)
                if found is None and entries:
                    found = self._through(here, length_m, back, entries, wide)
                if found is not None:
                    return found
        return None

    def _direct(
        self, here: np.ndarray, back_m: float, entries: list[tuple[float, int, TourSwath]], wide: bool
    ) -> _Found | None:
        """The cheapest of the nearest swaths that one word leads to."""
        for few in (entries[:_NEXT], entries[_NEXT:_MOST_ENTRIES]):
            if not few:
                break
            found = find_joint(
                self.terrain,
                here,
                np.stack([self.pose(entry) for _, _, entry in few]),
                self.radius_m,
                back_m=back_m,
                out_m=self.out_m,
                in_m=self.in_m,
                band=self.band,
                wide=wide,
            )
            if found is not None:
                _, number, entry = few[found[0]]
                return found[1].cost_m, number, entry, found[1].pieces
        return None

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
        for begin in range(0, len(entries), _NEXT):
            few = entries[begin : begin + _NEXT]
            if best is not None and (reached >= _NEXT or few[0][0] > best[0]):
                break
            # Into the swaths from behind: the same straight ways, from their beginnings backwards.
            goals = np.stack([self.pose(entry) for _, _, entry in few])
            into = np.concatenate([poses_ahead(goal, -ins_m) for goal in goals])
            ends, in_m = np.repeat(goals, len(ins_m), axis=0), np.tile(ins_m, len(goals))
            good, extra_m = clear_ways(self.terrain, into, in_m[:, None], np.zeros((len(in_m), 1)), ends, self.band)
            kept = np.flatnonzero(good)
            inward = lattice.links(
                into[kept], (in_m + extra_m)[kept], ends[kept], self.band, inward=True, among=tree.near, wide=wide
            )
            goal_of = kept[inward.lead] // len(ins_m)
            for number, (about_m, swath, entry) in enumerate(few):
                if best is not None and (reached >= _NEXT or about_m > best[0]):
                    break
                own = inward.where(goal_of == number)
                ways = [np.array([[in_m[each], 0.0]]) for each in kept]
                found = tree.joint(here, outs, own, ways, goals[number]) if len(own.node) else None
                if found is not None:
                    reached += 1
                    if best is None or found.cost_m < best[0]:
                        best = (found.cost_m, swath, entry, found.pieces)
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
        """Ways from a pose, with their end poses and costs.

        Args:
            start: start pose of all ways.
            ways: pieces of each way.
            check: pose with which the vehicle lines up: only ways that are clear, except for that swath's ground, are
                kept. ``None``: all ways are kept.
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
"""Distances back along the last way from which the lattice is tried, m."""


def _retraced(driven: Sequence[TourSwath], joints: Sequence[Pieces]) -> Pieces:
    """The last way in reverse: the same arcs with negative lengths and unchanged curvatures."""
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
    """The first ``length_m`` of a way."""
    way_m = np.abs(pieces[:, 0])
    ends = np.cumsum(way_m)
    share = np.clip((length_m - (ends - way_m)) / np.maximum(way_m, 1e-12), 0.0, 1.0)
    cut = pieces * np.stack([share, np.ones(len(pieces))], axis=1)
    return np.asarray(cut[share > 0.0])
