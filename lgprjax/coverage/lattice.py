"""Ways through a lattice of poses, where a single word does not suffice: forwards and in reverse, around obstacles.

Nodes are places of a square grid with sixteen headings each (a state lattice: Pivtoraik, Knepper and Kelly 2009). Edges
are Dubins' forward words between nodes near each other, of the vehicle's own radius, and each of them in reverse. Which
of them the ground allows is found once for all nodes; which of them lead over ground not yet worked, at each search.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy import sparse

from lgprjax.coverage.joints import REVERSE, WIDE_RADII, Joint, Terrain, clear_ways, joined, sample
from lgprjax.coverage.turns import Pieces, forward_words

_HEADINGS = 16
_MOST_TURNED = 2
"""Headings from one node to the next."""
_MOST_PLACES = 6000
_FIRST_M = 0.6
_FINER = 2.0 / 3.0
_FINEST_M = 0.25
_KEPT = 3
"""Words kept for each change of heading."""
_LONGER = 1.3
"""Longest word, in distances of its ends."""
_STEP_M = 0.2
_JOIN_TURNED = 3
_MOST_BEND_RAD = 0.75 * math.pi
"""Largest bend of a word between a lead and a node."""
_LIMITS_M = (15.0, 40.0, math.inf)
"""Limits of the search for ways, tried in order."""
_AGAINST_M = 0.1
"""Cost of an edge in reverse beyond its length: many short ones are many changes of direction."""
_TRIED = 12
"""Number of ways checked exactly before a swath is abandoned."""
_SEARCHES = 8
"""Searches again without what the exact check did not let pass, at most, for one swath."""
_UNSURE_M = 2.0
"""Cost of a way between a pose and a node that the raster does not let pass for certain."""


class Links(NamedTuple):
    """Ways between one pose and nodes: the cheapest for each node.

    Attributes:
        node: numbers; lead: of the pose of each; cost_m: with the lead's own; pieces: of a word: length and curvature.
    """

    node: Int[np.ndarray, " link"]
    lead: Int[np.ndarray, " link"]
    cost_m: Float[np.ndarray, " link"]
    pieces: Float[np.ndarray, "link 3 2"]

    def where(self, good: Bool[np.ndarray, " link"]) -> "Links":
        return Links(*(each[good] for each in self))


class Lattice:
    """Poses of a lattice within safe ground, and the ways between neighbours.

    Args:
        terrain: raster of the ground.
        heading_rad: heading of the lattice's rows.
        radius_m: radius of every arc.
        step_m: distance between places; ``None``: by the size of the ground.
    """

    def __init__(self, terrain: Terrain, heading_rad: float, radius_m: float, step_m: float | None = None) -> None:
        self.terrain, self.radius_m = terrain, radius_m
        rows, columns = np.nonzero(terrain.away_m > terrain.ground.clearance_m)
        places = np.stack([terrain.east_m[columns], terrain.north_m[rows]], axis=1)
        cos, sin = math.cos(heading_rad), math.sin(heading_rad)
        self._axes = np.array([[cos, sin], [-sin, cos]])
        turned = places @ self._axes.T
        low, high = turned.min(axis=0), turned.max(axis=0)
        self._least_m = math.sqrt(float(np.prod(high - low)) / _MOST_PLACES)
        self.step_m = max(_FIRST_M, self._least_m) if step_m is None else step_m
        count = np.ceil((high - low) / self.step_m).astype(int) + 1
        self._low, self._shape = low, (int(count[1]), int(count[0]))
        y, x = np.mgrid[: count[1], : count[0]]
        grid = (np.stack([x, y], axis=-1).reshape(-1, 2) * self.step_m + low) @ self._axes
        self._heading_rad = heading_rad
        yaw = heading_rad + np.arange(_HEADINGS) * 2.0 * math.pi / _HEADINGS
        # [place, heading] as one number.
        self.poses = np.concatenate([np.repeat(grid, _HEADINGS, axis=0), np.tile(yaw, len(grid))[:, None]], axis=1)
        self.free = terrain.stands(self.poses, surely=True)
        self._seen: np.ndarray | None = None
        self._grow()
        # Result of the exact check of each edge: 0 unchecked, 1 allowed, -1 not allowed.
        self._exact = np.zeros(len(self.source), np.int8)

    def finer(self) -> "Lattice | None":
        """The same with places nearer to each other; ``None`` where these would be too many."""
        step_m = _FINER * self.step_m
        if step_m < max(_FINEST_M, self._least_m):
            return None
        return Lattice(self.terrain, self._heading_rad, self.radius_m, step_m)

    def _grow(self) -> None:
        """Edges between free nodes that the ground allows."""
        lengths, bends, moves = _primitives(self.step_m, self.radius_m)
        rows, columns = self._shape
        source, target, word, passed = [], [], [], []
        free = self.free.reshape(rows, columns, _HEADINGS)
        for number, (heading, across, up, turned) in enumerate(moves.tolist()):
            after = (heading + turned) % _HEADINGS
            inner = free[max(0, -up) : rows - max(0, up), max(0, -across) : columns - max(0, across), heading]
            there = free[max(0, up) : rows - max(0, -up), max(0, across) : columns - max(0, -across), after]
            row, column = np.nonzero(inner & there)
            if len(row) == 0:
                continue
            row, column = row + max(0, -up), column + max(0, -across)
            begin = (row * columns + column) * _HEADINGS + heading
            way_m = float(np.abs(lengths[number]).sum())
            arc_m = np.linspace(0.0, way_m, math.ceil(way_m / _STEP_M) + 1)[None]
            start = np.array([0.0, 0.0, self._heading_rad + heading * 2.0 * math.pi / _HEADINGS])
            along = sample(start, lengths[number : number + 1], bends[number : number + 1], arc_m)[0]
            poses = along[None] + self.poses[begin, None] * np.array([1.0, 1.0, 0.0])
            good = self.terrain.stands(poses, surely=True).all(axis=1)
            source.append(begin[good])
            target.append(((row + up) * columns + column + across)[good] * _HEADINGS + after)
            word.append(np.full(int(good.sum()), number))
            cell = self.terrain.cells(poses[good, :, :2])
            flat = cell[0] * len(self.terrain.east_m) + cell[1]
            # Words differ in length: the last place of the short ones again.
            passed.append(flat)
        most = max((each.shape[1] for each in passed), default=1)
        self.source, self.target, self.word = (
            np.concatenate(each) if each else np.zeros(0, int) for each in (source, target, word)
        )
        self._passed = (
            np.concatenate([np.pad(each, ((0, 0), (0, most - each.shape[1])), mode="edge") for each in passed]).astype(
                np.int32
            )
            if passed
            else np.zeros((0, 1), np.int32)
        )
        self.words = np.stack([lengths, bends], axis=2)
        way_m = np.abs(lengths).sum(axis=1)[self.word]
        edge = np.arange(len(self.source))
        begin, end = np.concatenate([self.source, self.target]), np.concatenate([self.target, self.source])
        cost = np.concatenate([way_m, REVERSE * way_m + _AGAINST_M])
        # In order of rows, and of several ways between two nodes the cheapest: a sparse matrix would add them.
        order = np.lexsort((cost, end, begin))
        first = np.diff(begin[order] * len(self.poses) + end[order], prepend=-1) > 0
        order = order[first]
        self._begin, self._end = begin[order].astype(np.int32), end[order].astype(np.int32)
        self._cost_m = cost[order]
        self.edge = np.concatenate([edge, edge])[order]
        self.reverse = order >= len(edge)

    def search(self, links: Links) -> "Tree":
        """Cheapest ways from a pose's links to all nodes, over worked ground alone."""
        unworked = self.terrain.unworked
        if self._seen is not unworked:
            self._seen, self._worked = unworked, np.zeros(len(self.source), bool)
        # Worked cells remain worked.
        closed = np.flatnonzero(~self._worked)
        self._worked[closed] = ~unworked.ravel()[self._passed[closed]].any(axis=1)
        kept = np.flatnonzero((self._worked & (self._exact >= 0))[self.edge])
        count = len(self.poses)
        # The pose itself is one more node, after all others.
        rows = np.concatenate([np.bincount(self._begin[kept], minlength=count), [len(links.node)]])
        cost = np.concatenate([self._cost_m[kept], links.cost_m + 1e-3])
        ends = np.concatenate([self._end[kept], links.node.astype(np.int32)])
        begins = np.concatenate([[0], np.cumsum(rows)]).astype(np.int32)
        graph = sparse.csr_matrix((cost, ends, begins), shape=(count + 1, count + 1))
        return Tree(self, links, graph, kept)

    def may_pass(self, edge: int) -> bool:
        """Whether an edge passes the exact check, made once for each."""
        if self._exact[edge] == 0:
            good = self.terrain.keeps_exactly(self.poses[self.source[edge]], self.words[self.word[edge]])
            self._exact[edge] = 1 if good else -1
        return bool(self._exact[edge] > 0)

    def links(
        self,
        leads: Float[np.ndarray, "lead 3"],
        lead_cost_m: Float[np.ndarray, " lead"],
        end: Float[np.ndarray, "*each 3"],
        band: tuple[float, float],
        *,
        inward: bool,
        among: Bool[np.ndarray, " node"],
        wide: bool = False,
    ) -> Links:
        """Words from leads to nearby nodes, or from nearby nodes to leads, that the ground allows now.

        Args:
            leads: poses that the vehicle can reach.
            lead_cost_m: cost to reach each lead.
            end: pose of the next swath, common or per lead.
            band: see ``find_joint``.
            inward: whether words lead from nodes to the leads; the cheapest for each next swath, not for all together.
            among: mask of nodes that count.
            wide: see ``find_joint``.
        """
        reach_m = max(1.5 * self.step_m, min(1.2 * self.radius_m, 2.5 * self.step_m)) + 1e-6
        middle = (leads[:, :2] @ self._axes.T - self._low) / self.step_m
        span = math.ceil(reach_m / self.step_m)
        about = np.arange(-span, span + 1)
        column = np.rint(middle[:, 0]).astype(int)[:, None, None] + about[None, None]
        row = np.rint(middle[:, 1]).astype(int)[:, None, None] + about[None, :, None]
        row, column = np.broadcast_arrays(row, column)
        lead = np.broadcast_to(np.arange(len(leads))[:, None, None], row.shape)
        good = (row >= 0) & (row < self._shape[0]) & (column >= 0) & (column < self._shape[1])
        lead, place = lead[good], (row * self._shape[1] + column)[good]
        heading = np.rint((leads[lead, 2] - self._heading_rad) * _HEADINGS / (2.0 * math.pi)).astype(int)
        turned = np.arange(-_JOIN_TURNED, _JOIN_TURNED + 1)
        node = (place[:, None] * _HEADINGS + (heading[:, None] + turned) % _HEADINGS).ravel()
        lead = np.repeat(lead, len(turned))
        good = among[node] & (np.hypot(*(self.poses[node, :2] - leads[lead, :2]).T) <= reach_m)
        node, lead = node[good], lead[good]
        one, other = leads[lead], self.poses[node]
        if inward:
            one, other = other, one
        lengths, bends, word = self._short_words(one, other, wide)
        node, lead = node[word], lead[word]
        cost = np.where(lengths < 0.0, -REVERSE * lengths, lengths).sum(axis=1) + lead_cost_m[lead]
        # The cheapest few for each node, of each of the ends.
        if inward:
            ends = np.broadcast_to(end, leads.shape)
            goal = np.cumsum((np.diff(ends, axis=0, prepend=ends[:1]) != 0.0).any(axis=1))
            key = goal[lead] * len(self.poses) + node
        else:
            ends, key = np.broadcast_to(end, leads.shape), node
        order = np.lexsort((cost, key))
        rank = np.arange(len(order)) - np.searchsorted(key[order], key[order])
        order = order[rank < (4 * _KEPT if wide else _KEPT)]
        node, lead, key, lengths, bends, cost = (each[order] for each in (node, lead, key, lengths, bends, cost))
        if len(node):
            starts = self.poses[node] if inward else leads[lead]
            good, extra_m = clear_ways(self.terrain, starts, lengths, bends, ends[lead], band)
            arc_m = np.abs(lengths).sum(axis=1)[:, None] * np.linspace(0.0, 1.0, 12)[None]
            sure = self.terrain.stands(sample(starts, lengths, bends, arc_m), surely=True).all(axis=1)
            node, lead, key, lengths, bends, cost = (
                each[good] for each in (node, lead, key, lengths, bends, cost + extra_m + _UNSURE_M * ~sure)
            )
        order = np.lexsort((cost, key))
        first = order[np.diff(key[order], prepend=-1) > 0]
        return Links(node[first], lead[first], cost[first], np.stack([lengths, bends], axis=2)[first])

    def _short_words(
        self, starts: Float[np.ndarray, "way 3"], ends: Float[np.ndarray, "way 3"], wide: bool
    ) -> tuple[Float[np.ndarray, "word 3"], Float[np.ndarray, "word 3"], Int[np.ndarray, " word"]]:
        """Lengths and curvatures of words not much longer than the way straight on, and which way each is of."""
        half = np.array([0.0, 0.0, math.pi])
        most_m = _LONGER * np.hypot(*(ends - starts)[:, :2].T) + self.step_m
        lengths, bends, ways = [], [], []
        for radius_m in self.radius_m * np.array((1.0, *WIDE_RADII) if wide else (1.0,)):
            for sign, turned in ((1.0, 0.0), (-1.0, 1.0)):
                words, hands = forward_words(starts + turned * half, ends + turned * half, radius_m, straight=True)
                arcs_m = words[..., 0] + words[..., 2]
                good = (arcs_m + words[..., 1] <= most_m[:, None]) & (arcs_m < _MOST_BEND_RAD * radius_m)
                way, word = np.nonzero(good)
                lengths.append(sign * words[way, word])
                bends.append(sign * hands[word] / radius_m)
                ways.append(way)
        return np.concatenate(lengths), np.concatenate(bends), np.concatenate(ways)


class Tree:
    """Cheapest ways from one pose to the nodes of a lattice.

    Args:
        lattice: lattice of the nodes.
        links: links from the pose.
        graph: graph of all open edges, with the pose as its last node.
        edges: edges of the lattice, in the graph's order.

    Attributes:
        near: mask of reachable nodes.
    """

    def __init__(
        self, lattice: Lattice, links: Links, graph: sparse.csr_matrix, edges: Int[np.ndarray, " edge"]
    ) -> None:
        self.lattice, self._links, self._graph, self._edges = lattice, links, graph, edges
        self.near = np.zeros(graph.shape[0], bool)
        self.near[sparse.csgraph.breadth_first_order(graph, graph.shape[0] - 1, return_predecessors=False)] = True
        self.near = self.near[:-1]
        self._limit, self._checked = 0, False
        self._cost_m: Float[np.ndarray, " node"] = np.zeros(0)
        self._before: Int[np.ndarray, " node"] = np.zeros(0, int)

    def _cost_to(self, node: Int[np.ndarray, " link"]) -> Float[np.ndarray, " link"]:
        """Costs of ways to nodes; the search extends until at least one is known."""
        while self._limit == 0 or not np.isfinite(self._cost_m[node]).any():
            if self._limit == len(_LIMITS_M):
                break
            self._cost_m, self._before = sparse.csgraph.dijkstra(
                self._graph, indices=len(self.near), return_predecessors=True, limit=_LIMITS_M[self._limit]
            )
            self._limit += 1
        return np.asarray(self._cost_m[node])

    def _way(self, node: int) -> tuple[list[int], Pieces]:
        """Edges of the way to a node in the graph's order, last first, and its pieces after the lead."""
        lattice, origin = self.lattice, len(self.near)
        parts, used = list[np.ndarray](), list[int]()
        while True:
            before = int(self._before[node])
            begin, end = self._graph.indptr[before], self._graph.indptr[before + 1]
            at = int(begin) + int(np.searchsorted(self._graph.indices[begin:end], node))
            used.append(at)
            if before == origin:
                parts.append(self._links.pieces[at - begin])
                return used, np.concatenate(parts[::-1])
            number = self._edges[at]
            pieces = lattice.words[lattice.word[lattice.edge[number]]]
            parts.append(pieces[::-1] * np.array([-1.0, 1.0]) if lattice.reverse[number] else pieces)
            node = before

    def _bar(self, used: Sequence[int], start: Float[np.ndarray, "3"], outs: Sequence[Pieces]) -> bool:
        """Whether something of a way does not pass the exact check; it is then not searched through again."""
        terrain, links = self.lattice.terrain, self._links
        first = int(self._graph.indptr[len(self.near)])
        barred = list[int]()
        for at in used:
            if at < first:
                if not self.lattice.may_pass(int(self.lattice.edge[self._edges[at]])):
                    barred.append(at)
            elif not self._checked:
                # Out of a narrow place all ways begin much alike: what one of them fails at others do too.
                whole = [np.concatenate([outs[lead], links.pieces[link]]) for link, lead in enumerate(links.lead)]
                bad = [first + link for link, way in enumerate(whole) if not terrain.keeps_exactly(start, joined(way))]
                self._checked = True
                barred += bad
        if barred:
            self._graph.data[barred] = np.inf
            self._limit = 0
        return bool(barred)

    def joint(
        self,
        start: Float[np.ndarray, "3"],
        outs: Sequence[Pieces],
        inward: Links,
        ins: Sequence[Pieces],
        end: Float[np.ndarray, "3"],
    ) -> Joint | None:
        """The cheapest way on to a swath that the exact check lets pass.

        Args:
            start: pose; outs: from it to each lead.
            inward: links to the leads of the swath; ins: from each of those to it; end: its pose.
        """
        first = int(self._graph.indptr[len(self.near)])
        for _ in range(_SEARCHES):
            cost = self._cost_to(inward.node) + inward.cost_m
            again = False
            for link in np.argsort(cost)[:_TRIED]:
                if not np.isfinite(cost[link]):
                    break
                used, pieces = self._way(int(inward.node[link]))
                lead = int(self._links.lead[used[-1] - first])
                whole = joined(np.concatenate([outs[lead], pieces, inward.pieces[link], ins[inward.lead[link]]]))
                if self.lattice.terrain.leads_exactly(start, whole, end):
                    return Joint(whole, float(cost[link]))
                again = self._bar(used, start, outs)
                if again:
                    break
            if not again:
                break
        return None


def _primitives(
    step_m: float, radius_m: float
) -> tuple[Float[np.ndarray, "word 3"], Float[np.ndarray, "word 3"], Int[np.ndarray, "word 4"]]:
    """Forward words from a node to its neighbours: lengths, curvatures, and heading, columns, rows and turn of each."""
    angle = 2.0 * math.pi / _HEADINGS
    reach_m = max(2.3 * step_m, 1.3 * radius_m)
    span = math.ceil(reach_m / step_m)
    row, column = (each.ravel() for each in np.mgrid[-span : span + 1, -span : span + 1])
    apart_m = np.hypot(row, column) * step_m
    near = (apart_m > 0.0) & (apart_m <= reach_m)
    row, column, apart_m = row[near], column[near], apart_m[near]
    lengths, bends, moves = [], [], []
    for heading in range(_HEADINGS):
        for turned in range(-_MOST_TURNED, _MOST_TURNED + 1):
            starts = np.tile([0.0, 0.0, heading * angle], (len(row), 1))
            ends = np.stack([column * step_m, row * step_m, np.full(len(row), (heading + turned) * angle)], axis=1)
            words, hands = forward_words(starts, ends, radius_m)
            way_m = np.where(np.isfinite(words).all(axis=2), words.sum(axis=2), np.inf)
            best = way_m.argmin(axis=1)
            least_m = way_m.min(axis=1)
            good = np.flatnonzero(least_m <= _LONGER * apart_m)
            for each in good[np.argsort(least_m[good])][: _KEPT if turned else _KEPT + 1]:
                lengths.append(words[each, best[each]])
                bends.append(hands[best[each]] / radius_m)
                moves.append((heading, int(column[each]), int(row[each]), turned))
    return np.array(lengths).reshape(-1, 3), np.array(bends).reshape(-1, 3), np.array(moves, int).reshape(-1, 4)
