"""Ways from one pose to another within safe ground, forwards and in reverse, many tried at once.

Words are those of Dubins (1957), the same in reverse, and the three arcs with two cusps of Reeds and Shepp (1990), each
after a straight piece back along the swath just driven, or on along it, and before a straight piece into the next.
Ways that a raster accepts are checked exactly before use.
"""

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import shapely
from jaxtyping import Bool, Float, Int
from scipy import ndimage

from lgprjax.coverage.field import Outline, Tool
from lgprjax.coverage.ground import SafeGround, swept_of_turn
from lgprjax.coverage.turns import HeadlandTurn, Pieces, Pose, chords, forward_words, poses_along, whole_turn

_EDGE_M = 0.05
_STEP_M = 0.2
_OUTLINE_M = 0.3
_SLACK_M = 0.1
"""Largest error of the raster, m: half a cell's diagonal, and the gap between two sampled points of the outline."""
_MOST_CELLS = 600_000
_HEADINGS = 64
"""Number of headings of the table of allowed poses."""
_FINEST_M = 0.1
_FEW_CELLS = 250_000
"""Cells of a raster that is finer than that."""
_BATCH = 96
_MOST_TRIED = 768
_EXACT = 40
WIDE_RADII = (3.0, 8.0)
"""Radii of gentle arcs, in smallest radii, for use along a wall, towards which the tail swings out of a tight arc."""
CUSP_M = 1.5
"""Cost of a change between forward and reverse, as way."""
REVERSE = 1.3
"""Cost of a metre in reverse."""
_OFF_M = 1e-6
_UNWORKED = 4.0
"""Cost of a metre over ground not yet worked, where the vehicle lines up with its swath."""


class Terrain:
    """Raster of the ground: distance from its border, and cells not yet worked.

    Args:
        ground: safe ground.
        target: shapely geometry to be worked.
        outline: outline of vehicle and tool.
        finest_m: cell of the raster of small ground.

    Attributes:
        cell_m, origin_m: cell and origin of the raster.
        away_m: distance of each cell from the ground's border, 0 beyond it.
        unworked: mask of the target's cells that no swath has passed.
    """

    def __init__(self, ground: SafeGround, target: Any, outline: Outline, *, finest_m: float = _FINEST_M) -> None:
        self.ground, self.outline = ground, outline
        low, high = np.split(np.array(shapely.total_bounds(ground.shape)), 2)
        few_m, most_m = (math.sqrt(float(np.prod(high - low)) / count) for count in (_FEW_CELLS, _MOST_CELLS))
        self.cell_m = max(min(finest_m, _FINEST_M), min(few_m, _FINEST_M), most_m)
        self.origin_m = low - 2.0 * self.cell_m
        columns, rows = (int(each) for each in np.ceil((high - low) / self.cell_m) + 4)
        self.east_m = self.origin_m[0] + self.cell_m * (np.arange(columns) + 0.5)
        self.north_m = self.origin_m[1] + self.cell_m * (np.arange(rows) + 0.5)
        x, y = np.meshgrid(self.east_m, self.north_m)
        shapely.prepare(ground.shape)
        inside = shapely.contains_xy(ground.shape, x, y)
        self.away_m = (ndimage.distance_transform_edt(inside) * self.cell_m).astype(np.float32)
        shapely.prepare(target)
        self.target = shapely.contains_xy(target, x, y)
        # Errors of drawing and driving to corners do not count as unworked ground.
        self.unworked = ndimage.binary_erosion(self.target, iterations=max(round(_EDGE_M / self.cell_m), 1))
        shapely.prepare(ground.kept)
        front, rear, left, right = outline
        along, across = _samples(rear, front, _OUTLINE_M), _samples(right, left, _OUTLINE_M)[1:-1]
        edge = [(each, side) for side in (left, right) for each in along]
        edge += [(end, each) for end in (front, rear) for each in across]
        self._edge_m = np.array(edge)
        # Displacement of the farthest corner by half a step of heading.
        turned_m = math.pi / _HEADINGS * float(np.hypot(*self._edge_m.T).max())
        self._may_stand = self.standing(self._least_m - turned_m)
        self._stands = self.standing(ground.clearance_m + 0.5 * self.cell_m)

    @property
    def _least_m(self) -> float:
        return self.ground.clearance_m - _SLACK_M - 0.7 * max(self.cell_m - _FINEST_M, 0.0)

    def standing(self, least_m: float, *, every: int = 1) -> Bool[np.ndarray, "heading row column"]:
        """Table of the cells in which the reference point may be, at each of evenly spaced headings.

        Args:
            least_m: least distance of the outline from the border of the ground.
            every: number of cells per cell of the table.
        """
        cell_m = every * self.cell_m
        reach = math.ceil(float(np.hypot(*self._edge_m.T).max()) / cell_m) + 1
        away_m = self.away_m[::every, ::every]
        wide = np.pad(away_m > max(least_m, 0.0), reach)
        rows, columns = away_m.shape
        standing = np.ones((_HEADINGS, rows, columns), bool)
        for number in range(_HEADINGS):
            angle = 2.0 * math.pi * number / _HEADINGS
            cos, sin = math.cos(angle), math.sin(angle)
            shifts = np.rint(self._edge_m @ np.array([[sin, cos], [cos, -sin]]) / cell_m).astype(int) + reach
            for row, column in np.unique(shifts, axis=0):
                standing[number] &= wide[row : row + rows, column : column + columns]
        return standing

    def stands(self, poses: Float[np.ndarray, "*shape 3"], *, surely: bool = False) -> Bool[np.ndarray, "*shape"]:
        """Whether the outline is within the ground, by one look-up per pose.

        Args:
            poses: poses of the reference point.
            surely: ``True``: only poses that are almost certainly within pass; ``False``: only poses that are certainly
                not within fail.
        """
        heading = np.rint(poses[..., 2] * (_HEADINGS / (2.0 * math.pi))).astype(np.int64) % _HEADINGS
        held = self._stands if surely else self._may_stand
        return np.asarray(held[(heading, *self.cells(poses[..., :2]))])

    def under(self, tool: Tool) -> Bool[np.ndarray, "row column"]:
        """Cells that a tool can be over with the outline within the ground, at some heading of the ladder."""
        return cells_under(self._stands[::2], tool, self.cell_m)

    def cells(self, places_m: Float[np.ndarray, "*shape 2"]) -> tuple[np.ndarray, np.ndarray]:
        """Row and column of places; those beyond the raster are taken to its border, which is not safe."""
        index = ((places_m - self.origin_m) / self.cell_m).astype(np.int64)
        return np.clip(index[..., 1], 0, len(self.north_m) - 1), np.clip(index[..., 0], 0, len(self.east_m) - 1)

    def in_rectangle(
        self, start_m: Float[np.ndarray, "2"], end_m: Float[np.ndarray, "2"], half_m: float, more_m: float = 0.0
    ) -> tuple[tuple[slice, slice], Bool[np.ndarray, "row column"]]:
        """Part of the raster, and mask of its cells with centres within half a width of a way extended at both ends."""
        along = (end_m - start_m) / max(float(np.hypot(*(end_m - start_m))), 1e-9)
        reach_m = half_m + max(more_m, 0.0) + self.cell_m
        low = np.minimum(start_m, end_m) - reach_m
        high = np.maximum(start_m, end_m) + reach_m
        (row, other_row), (column, other_column) = (each.tolist() for each in self.cells(np.stack([low, high])))
        part = slice(row, other_row + 1), slice(column, other_column + 1)
        x, y = self.east_m[None, part[1]] - start_m[0], self.north_m[part[0], None] - start_m[1]
        length_m = float(np.hypot(*(end_m - start_m)))
        ahead, aside = x * along[0] + y * along[1], y * along[0] - x * along[1]
        return part, (ahead >= -more_m) & (ahead <= length_m + more_m) & (np.abs(aside) <= half_m)

    def fits(self, poses: Float[np.ndarray, "*shape 3"]) -> Bool[np.ndarray, "*shape"]:
        """Whether the outline may be within the ground at poses: never no where it is."""
        cos, sin = np.cos(poses[..., 2, None]), np.sin(poses[..., 2, None])
        x, y = self._edge_m.T
        places = np.stack([poses[..., 0, None] + cos * x - sin * y, poses[..., 1, None] + sin * x + cos * y], axis=-1)
        good: Bool[np.ndarray, "*shape"] = (self.away_m[self.cells(places)] > max(self._least_m, 0.0)).all(axis=-1)
        return good

    def leads_exactly(self, start: Float[np.ndarray, "3"], pieces: Pieces, end: Float[np.ndarray, "3"]) -> bool:
        """Whether a way leads from one pose to another, and passes the check that the plan will be held against."""
        turn = HeadlandTurn(Pose(*(float(each) for each in start)), pieces)
        off = poses_along(turn.start, pieces, np.array([turn.length_m]))[0] - end
        if float(np.hypot(*off[:2])) > _OFF_M or abs(math.sin(0.5 * off[2])) > _OFF_M:
            return False
        return self.keeps_exactly(start, pieces)

    def keeps_exactly(self, start: Float[np.ndarray, "3"], pieces: Pieces) -> bool:
        """Whether a way passes the check that the plan will be held against."""
        turn = HeadlandTurn(Pose(*(float(each) for each in start)), pieces)
        return bool(shapely.covers(self.ground.kept, swept_of_turn(turn, self.outline)).all())


def _samples(low: float, high: float, step: float) -> Float[np.ndarray, " place"]:
    return np.linspace(low, high, max(math.ceil((high - low) / step), 1) + 1)


def cells_under(
    stands: Bool[np.ndarray, "heading row column"], tool: Tool, cell_m: float
) -> Bool[np.ndarray, "row column"]:
    """Mask of cells that a tool covers while the reference point is in allowed cells.

    Args:
        stands: mask of allowed cells at each of evenly spaced headings, the first along x.
        tool: tool of the vehicle.
        cell_m: cell of the raster.
    """
    half_m = 0.5 * tool.width_m
    along = tool.ahead_m + _samples(-0.5 * tool.length_m, 0.5 * tool.length_m, 1.5 * cell_m)
    across = tool.left_m + _samples(-half_m, half_m, 1.5 * cell_m)
    x, y = (each.ravel() for each in np.meshgrid(along, across))
    headings, rows, columns = stands.shape
    reach = math.ceil(float(np.hypot(x, y).max()) / cell_m) + 1
    over = np.zeros((rows + 2 * reach, columns + 2 * reach), bool)
    for number in range(headings):
        angle = 2.0 * math.pi * number / headings
        places = np.stack([x * math.sin(angle) + y * math.cos(angle), x * math.cos(angle) - y * math.sin(angle)], 1)
        for row, column in np.unique(np.rint(places / cell_m).astype(int) + reach, axis=0):
            over[row : row + rows, column : column + columns] |= stands[number]
    inner: Bool[np.ndarray, "row column"] = over[reach : reach + rows, reach : reach + columns]
    return inner


class Joint(NamedTuple):
    """A way from one swath to the next.

    Attributes:
        pieces: pieces of the way.
        cost_m: length of the way plus costs of cusps and reverse.
    """

    pieces: Pieces
    cost_m: float


def find_joint(
    terrain: Terrain,
    start: Float[np.ndarray, "3"],
    ends: Float[np.ndarray, "end 3"],
    radius_m: float,
    *,
    back_m: float,
    out_m: float,
    in_m: float,
    band: tuple[float, float],
    wide: bool = False,
) -> tuple[int, Joint] | None:
    """The cheapest way from a pose to one of several poses that keeps to the ground and off unworked cells.

    Args:
        terrain: raster with the cells worked so far.
        start: x_m, y_m, yaw_rad of the start.
        ends: x_m, y_m, yaw_rad of each swath that may come next.
        radius_m: radius of every arc.
        back_m: length straight back from the start that is known to be worked.
        out_m, in_m: lengths straight on from the start, and straight into the end, that are tried as well.
        band: half the width of the end's own swath, and distance before it in which the vehicle may be on unworked
            cells of that swath.
        wide: whether arcs of ``WIDE_RADII`` times the radius are tried as well.

    Returns:
        The number of the end and the way to it; ``None`` if there is none.
    """
    leads, ins = leads_of(back_m, out_m, in_m, radius_m)
    lead, into = (each.ravel() for each in np.meshgrid(leads, ins, indexing="ij"))
    starts = np.tile(poses_ahead(start, lead), (len(ends), 1))
    goals = np.concatenate([poses_ahead(end, -into) for end in ends])
    radii = radius_m * np.array((1.0, *WIDE_RADII) if wide else (1.0,))
    ways, radius = len(starts), np.repeat(radii, len(starts))
    middle, hands = _words(np.tile(starts, (len(radii), 1)), np.tile(goals, (len(radii), 1)), radius)
    lead, into = np.tile(lead, len(ends) * len(radii)), np.tile(into, len(ends) * len(radii))
    cost = _cost_m((lead[:, None], *np.moveaxis(middle, 2, 0), into[:, None]))
    cost = np.where(np.isfinite(cost), cost, math.inf)
    # Of each end the cheapest ways, and then all of them in order.
    words = middle.shape[1]
    end_of = np.repeat(np.tile(np.repeat(np.arange(len(ends)), ways // len(ends)), len(radii)), words)
    flat = cost.ravel()
    order = np.concatenate([_cheapest(flat, np.flatnonzero(end_of == end), _MOST_TRIED) for end in range(len(ends))])
    order = order[np.argsort(flat[order], kind="stable")]
    way, word = np.divmod(order, words)
    zero = np.zeros(len(order))
    lengths = np.column_stack([lead[way], middle[way, word], into[way]])
    bends = np.column_stack([zero, hands[word] / radius[way, None], zero])
    cost, end_of = flat[order], end_of[order]
    exact = np.zeros(len(ends), int)
    best: tuple[int, Joint] | None = None
    for first in range(0, len(order), _MOST_TRIED):
        # Where pieces join first: most ways fail there already.
        part = np.arange(first, min(first + _MOST_TRIED, len(order)))
        joins = np.cumsum(np.abs(lengths[part]), axis=1)
        places = np.concatenate([joins, joins - 0.5 * np.abs(lengths[part])], axis=1)
        part = part[_clear(terrain, start, lengths[part], bends[part], places, ends[end_of[part]], band)[0]]
        for begin in range(0, len(part), _BATCH):
            chosen = part[begin : begin + _BATCH]
            if best is not None and cost[chosen[0]] >= best[1].cost_m:
                return best
            good, extra_m = clear_ways(terrain, start, lengths[chosen], bends[chosen], ends[end_of[chosen]], band)
            full = cost[chosen] + _UNWORKED * extra_m
            for number in np.argsort(full):
                end = int(end_of[chosen[number]])
                if not good[number] or exact[end] >= _EXACT:
                    continue
                if best is not None and full[number] >= best[1].cost_m:
                    break
                exact[end] += 1
                pieces = joined(np.stack([lengths[chosen[number]], bends[chosen[number]]], axis=1))
                if terrain.leads_exactly(start, pieces, ends[end]):
                    best = (end, Joint(pieces, float(full[number])))
                    break
    return best


def _cheapest(cost: Float[np.ndarray, " way"], among: Int[np.ndarray, " one"], count: int) -> Int[np.ndarray, " least"]:
    """Numbers of the cheapest, in no order; of those that cost anything finite."""
    among = among[cost[among] < math.inf]
    return among[np.argpartition(cost[among], count)[:count]] if len(among) > count else among


def joined(pieces: Pieces) -> Pieces:
    """Pieces without those of no length; straight ones that follow each other in one direction are one."""
    kept: list[list[float]] = []
    for length, curvature in pieces.tolist():
        if abs(length) < 1e-9:
            continue
        if kept and curvature == kept[-1][1] and (length > 0.0) == (kept[-1][0] > 0.0):
            kept[-1][0] += length
        else:
            kept.append([length, curvature])
    return np.array(kept).reshape(-1, 2)


def cusps(pieces: Pieces) -> int:
    """Number of changes between forward and reverse from the end of a swath to the beginning of the next."""
    signs = np.concatenate([[1.0], np.sign(pieces[:, 0]), [1.0]])
    return int(np.count_nonzero(signs[1:] != signs[:-1]))


def leads_of(
    back_m: float, out_m: float, in_m: float, radius_m: float
) -> tuple[Float[np.ndarray, " lead"], Float[np.ndarray, " into"]]:
    """Ways straight on from the start, negative straight back, and ways straight into the end; see ``find_joint``."""
    backs = [-each for each in (0.7, 1.5, 2.5, 4.0, 6.0, 9.0, 14.0, 22.0, 40.0, 80.0) if each < back_m]
    # Back to where the swath began, and on beyond it: out of a field whose far side has no room.
    beyond = [-back_m - more * radius_m for more in (0.0, 0.7, 1.5, 2.5, 3.5)] if back_m > 0.5 else []
    leads = [0.0, *dict.fromkeys((out_m, out_m + radius_m)), *backs, *beyond]
    ins = dict.fromkeys((0.0, in_m, in_m + 0.5 * radius_m, in_m + radius_m, in_m + 2.0 * radius_m))
    return np.array(leads), np.array(list(ins))


def poses_ahead(pose: Float[np.ndarray, "3"], ahead_m: Float[np.ndarray, " way"]) -> Float[np.ndarray, "way 3"]:
    yaw = np.full_like(ahead_m, pose[2])
    return np.stack([pose[0] + ahead_m * np.cos(yaw), pose[1] + ahead_m * np.sin(yaw), yaw], axis=1)


def _cost_m(pieces: Sequence[Float[np.ndarray, "..."]]) -> Float[np.ndarray, "..."]:
    """Cost of ways from the signed lengths of their pieces, m."""
    cost, last = np.zeros(()), np.ones(())
    for piece in pieces:
        sign = np.where(np.abs(piece) < 1e-9, last, np.sign(piece))
        cost = cost + np.maximum(piece, -REVERSE * piece) + CUSP_M * (sign != last)
        last = sign
    # Every swath begins forwards.
    return np.asarray(cost + CUSP_M * (last < 0.0))


def clear_ways(
    terrain: Terrain,
    start: Float[np.ndarray, "*way 3"],
    lengths: Float[np.ndarray, "way piece"],
    bends: Float[np.ndarray, "way piece"],
    end: Float[np.ndarray, "*each 3"],
    band: tuple[float, float],
) -> tuple[Bool[np.ndarray, " way"], Float[np.ndarray, " way"]]:
    """Mask of ways that the raster accepts, and length of each over unworked ground of the next swath.

    Args:
        terrain: raster with the cells worked so far.
        start: x_m, y_m, yaw_rad of the start, common or per way.
        lengths, bends: signed lengths and curvatures of the pieces.
        end: pose of the next swath, common or per way.
        band: see ``find_joint``.
    """
    way_m = np.abs(lengths).sum(axis=1)
    count = int(np.ceil(way_m.max() / _STEP_M)) + 2
    arc_m = way_m[:, None] * np.linspace(0.0, 1.0, count)[None]
    good, over = _clear(terrain, start, lengths, bends, arc_m, end, band)
    return good, over * way_m / count


def _clear(
    terrain: Terrain,
    start: Float[np.ndarray, "*way 3"],
    lengths: Float[np.ndarray, "way piece"],
    bends: Float[np.ndarray, "way piece"],
    arc_m: Float[np.ndarray, "way place"],
    end: Float[np.ndarray, "*each 3"],
    band: tuple[float, float],
) -> tuple[Bool[np.ndarray, " way"], Float[np.ndarray, " way"]]:
    """Which ways are clear at all of their places, and at how many of them on unworked ground of the swath to come."""
    poses = sample(start, lengths, bends, arc_m)
    raw = terrain.unworked[terrain.cells(poses[..., :2])]
    x, y = poses[..., 0] - end[..., :1], poses[..., 1] - end[..., 1:2]
    cos, sin = np.cos(end[..., 2:]), np.sin(end[..., 2:])
    ahead, aside = x * cos + y * sin, y * cos - x * sin
    own = (np.abs(aside) <= band[0]) & (ahead <= 0.0) & (ahead >= -band[1])
    good = ~(raw & ~own).any(axis=1)
    for fits in (terrain.stands, terrain.fits):
        few = np.flatnonzero(good)
        if len(few):
            good[few] = fits(poses[few]).all(axis=1)
    return good, (raw & own).sum(axis=1).astype(np.float64)


def sample(
    start: Float[np.ndarray, "*way 3"],
    lengths: Float[np.ndarray, "way piece"],
    bends: Float[np.ndarray, "way piece"],
    arc_m: Float[np.ndarray, "way place"],
) -> Float[np.ndarray, "way place 3"]:
    """Poses along ways that begin at one pose, or each at its own."""
    ways, count = lengths.shape
    first_x, first_y, first_yaw = np.broadcast_to(start, (ways, 3)).T[..., None]
    turned = np.cumsum(np.concatenate([first_yaw, lengths * bends], axis=1), axis=1)
    x, y = chords(turned[:, :-1], lengths, bends)
    knots_x = np.cumsum(np.concatenate([first_x, x], axis=1), axis=1)
    knots_y = np.cumsum(np.concatenate([first_y, y], axis=1), axis=1)
    begins = np.cumsum(np.concatenate([np.zeros((ways, 1)), np.abs(lengths)], axis=1), axis=1)
    number = np.clip((arc_m[:, :, None] >= begins[:, None, 1:]).sum(axis=2), 0, count - 1)
    row = np.arange(ways)[:, None]
    within = (arc_m - begins[row, number]) * np.where(lengths[row, number] < 0.0, -1.0, 1.0)
    bend, yaw = bends[row, number], turned[row, number]
    x, y = chords(yaw, within, bend)
    return np.stack([knots_x[row, number] + x, knots_y[row, number] + y, yaw + within * bend], axis=-1)


def _words(
    starts: Float[np.ndarray, "way 3"], ends: Float[np.ndarray, "way 3"], radius_m: Float[np.ndarray, " way"]
) -> tuple[Float[np.ndarray, "way word 3"], Float[np.ndarray, "word 3"]]:
    """Signed lengths of the three pieces of every word, NaN without a solution, and the direction of each."""
    turned = np.array([0.0, 0.0, math.pi])
    both, hands = forward_words(
        np.concatenate([starts, starts + turned]), np.concatenate([ends, ends + turned]), np.tile(radius_m, 2)
    )
    forward, reverse = np.split(both, 2)
    cusped, more = _three_arcs(starts, ends, radius_m)
    return np.concatenate([forward, -reverse, cusped], axis=1), np.concatenate([hands, -hands, more])


def _three_arcs(
    starts: Float[np.ndarray, "way 3"], ends: Float[np.ndarray, "way 3"], radius_m: Float[np.ndarray, " way"]
) -> tuple[Float[np.ndarray, "way 4 3"], Float[np.ndarray, "4 3"]]:
    """Lengths of Reeds and Shepp's words of three arcs with two cusps: forward, reverse, forward, and the like."""
    cos, sin = np.cos(starts[:, 2]), np.sin(starts[:, 2])
    east, north = (ends - starts)[:, :2].T / radius_m
    x, y, turned = east * cos + north * sin, north * cos - east * sin, ends[:, 2] - starts[:, 2]
    across, ahead = np.sin(turned), np.cos(turned)
    words, hands = np.empty((len(starts), 4, 3)), list[tuple[float, float, float]]()
    for gear in (1.0, -1.0):
        for hand in (1.0, -1.0):
            yaw = gear * hand * turned
            xi, eta = gear * (x - hand * across), hand * y - 1.0 + ahead
            with np.errstate(invalid="ignore"):
                rise = np.arccos(np.hypot(xi, eta) / 4.0)
            first = _half_turn(rise + np.arctan2(eta, xi) + 0.5 * np.pi)
            second = whole_turn(np.pi - 2.0 * rise)
            third = _half_turn(yaw - first - second)
            words[:, len(hands)] = np.stack([gear * first, -gear * second, gear * third], axis=1)
            hands.append((hand, -hand, hand))
    words *= np.reshape(radius_m, (-1, 1, 1))
    return words, np.array(hands)


def _half_turn(angle: Float[np.ndarray, " way"]) -> Float[np.ndarray, " way"]:
    return np.asarray(angle - 2.0 * np.pi * np.rint(angle * (0.5 / np.pi)))
