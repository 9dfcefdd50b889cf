"""Label errors of many drives from fixes between them: a pose graph, solved by robust sparse least squares.

Each stretch of a drive is a chain of nodes, whose corrections to the labels (east, north, yaw) follow the label process
(below); this takes the place of odometry between neighbours, and of the weak prior with long correlation that fixes the
gauge: no node is fixed. A fix is the pose of one chain's place in the labels of another (or of the same, if a drive
passes twice). With corrections c at the place and at the ground it was found on,

    r = place + c_place - [ground + c_ground + R(yaw of c_ground) (found - ground)],   yaw alike, wrapped.

Wrong fixes are found by graduated non-convexity (Yang, Antonante, Tzoumas & Carlone 2020; of switched edges as
Sünderhauf & Protzel 2012 asked for): the Geman-McClure loss c² r² / (mu c² + r²) with mu halved from a convex start to
1. Here it is divided by mu against theirs, so that a fix never costs more than c²: at first the chains are stiff
against all fixes, and a run of wrong ones that agree with each other is outvoted by the ground on both sides before it
can bend a chain. At the end a fix is used in full or not at all, and the covariances are those of least squares.

Host, float64. Not imported by the package: onboard programs do not load SciPy.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy import sparse
from scipy.sparse.linalg import SuperLU, splu

# Errors of a recorded drive's labels: a process along its path, estimated at nodes and interpolated between them.
#
# A GNSS/INS label drifts slowly: over metres its shape is right, over hundreds of metres it is anywhere within its
# sigma. East, north and yaw are each a Gauss-Markov process of the second order (Matérn 3/2: a value and its slope,
# Hartikainen & Särkkä 2010) plus a small random walk for errors that are not smooth. Being Markov, it links each node
# with the next one only, and being stationary, it is the label's own prior, counted once however dense the nodes.
#
# The slope is held in units of the value (times ``length / sqrt(3)``), so that both have the label's sigma.

STATES = 6
"""Of a node: value and slope of the corrections in east_m, north_m and yaw_rad."""


@dataclass(frozen=True)
class LabelModel:
    """Model of a label's error along its drive.

    Attributes:
        length_m: of correlation.
        walk_m, walk_yaw_rad: random walk a root metre of path, in east and in north, and in yaw.
        sigma_yaw_rad: of the labels' yaw; that of their positions is each chain's own.
        node_m: from node to node, at most.
    """

    length_m: float = 100.0
    walk_m: float = 0.01
    walk_yaw_rad: float = np.radians(0.03)
    sigma_yaw_rad: float = np.radians(0.5)
    node_m: float = 2.0


class LabelChain(NamedTuple):
    """A stretch of a drive with connected labels.

    Attributes:
        start_m, stop_m: along the drive's path.
        sigma_m: of the labels' east and north.
    """

    start_m: float
    stop_m: float
    sigma_m: float


class Nodes(NamedTuple):
    """Nodes of all chains, one chain after the other.

    Attributes:
        at_m: along the chain's path.
        chain: that each belongs to, rising.
        sigma: of the errors' values in east, north and yaw.
        first: first node of each chain, and the number of nodes.
    """

    at_m: Float[np.ndarray, " node"]
    chain: Int[np.ndarray, " node"]
    sigma: Float[np.ndarray, "node 3"]
    first: Int[np.ndarray, " edge"]


def lay_nodes(chains: tuple[LabelChain, ...], model: LabelModel) -> Nodes:
    """Nodes at equal steps along each chain, two at least."""
    at, number, sigma = [], [], []
    for index, chain in enumerate(chains):
        stop_m = max(chain.stop_m, chain.start_m + model.node_m)
        count = 1 + int(np.ceil((stop_m - chain.start_m) / model.node_m - 1e-9))
        at.append(np.linspace(chain.start_m, stop_m, count))
        number.append(np.full(count, index))
        sigma.append(np.tile([chain.sigma_m, chain.sigma_m, model.sigma_yaw_rad], (count, 1)))
    first = np.cumsum([0, *(len(part) for part in at)])
    return Nodes(np.concatenate(at), np.concatenate(number), np.concatenate(sigma), first)


def prior_rows(nodes: Nodes, model: LabelModel) -> sparse.csr_array:
    """Rows [row, state] whose sum of squares, times the states, is the cost of corrections by the labels alone.

    The first node of each chain has its sigma, every other one follows from the previous node.
    """
    starts = nodes.first[:-1]
    later = np.setdiff1d(np.arange(len(nodes.at_m)), starts)
    gap_m = nodes.at_m[later] - nodes.at_m[later - 1]
    follow = transition(gap_m, model)
    states = STATES * len(nodes.at_m)
    parts = []
    for axis, walk in enumerate((model.walk_m, model.walk_m, model.walk_yaw_rad)):
        root = np.linalg.cholesky(noise(gap_m, nodes.sigma[later, axis], walk, model))
        whiten = np.linalg.inv(root)
        before, after = _columns(later - 1, axis), _columns(later, axis)
        parts.append(_block_rows(np.concatenate([-whiten @ follow, whiten], axis=2), [before, after], states))
        held = np.eye(2) / nodes.sigma[starts, axis][:, None, None]
        parts.append(_block_rows(held, [_columns(starts, axis)], states))
    return sparse.csr_array(sparse.vstack(parts, format="csr"))


def place_rows(
    nodes: Nodes, chain: Int[np.ndarray, " place"], at_m: Float[np.ndarray, " place"], model: LabelModel
) -> sparse.csr_array:
    """Rows [3 place, state] that give the corrections in east, north and yaw at places, in this order, from the nodes.

    Between two nodes it is their conditional mean; beyond a chain's ends it is that of the end.

    Args:
        nodes: of the chains.
        chain: that each place lies on.
        at_m: along its path.
        model: of the labels' error.
    """
    low, high = nodes.first[chain], nodes.first[chain + 1] - 1
    # Chains lie one after the other in one rising list: each shifted beyond the one before it.
    step = 1.0 + float(np.ptp(nodes.at_m))
    line = nodes.at_m + nodes.chain * step
    held = np.clip(at_m, nodes.at_m[low], nodes.at_m[high])
    before = np.clip(np.searchsorted(line, held + chain * step, side="right") - 1, low, high - 1)
    gap_m, ahead_m = nodes.at_m[before + 1] - nodes.at_m[before], held - nodes.at_m[before]
    parts = []
    for axis, walk in enumerate((model.walk_m, model.walk_m, model.walk_yaw_rad)):
        weight = _between(gap_m, ahead_m, nodes.sigma[before, axis], walk, model)
        columns = [_columns(before, axis), _columns(before + 1, axis)]
        parts.append(_block_rows(weight[:, None, :], columns, STATES * len(nodes.at_m)))
    order = np.arange(3 * len(at_m)).reshape(3, -1).T.reshape(-1)
    return sparse.csr_array(sparse.vstack(parts, format="csr")[order])


def transition(gap_m: Float[np.ndarray, " gap"], model: LabelModel) -> Float[np.ndarray, "gap 2 2"]:
    """Value and scaled slope after a gap, from those before it."""
    d = np.sqrt(3.0) * gap_m / model.length_m
    rows = np.stack([np.stack([1.0 + d, d], axis=-1), np.stack([-d, 1.0 - d], axis=-1)], axis=-2)
    return np.asarray(np.exp(-d)[:, None, None] * rows)


def noise(
    gap_m: Float[np.ndarray, " gap"], sigma: Float[np.ndarray, " gap"], walk: float, model: LabelModel
) -> Float[np.ndarray, "gap 2 2"]:
    """Covariance that a gap adds: the noise that keeps the smooth process stationary, and the walk of the value."""
    follow = transition(gap_m, model)
    added = sigma[:, None, None] ** 2 * (np.eye(2) - follow @ follow.transpose(0, 2, 1))
    added[:, 0, 0] += walk**2 * gap_m
    return np.asarray(added)


def _between(
    gap_m: Float[np.ndarray, " place"],
    ahead_m: Float[np.ndarray, " place"],
    sigma: Float[np.ndarray, " place"],
    walk: float,
    model: LabelModel,
) -> Float[np.ndarray, "place 4"]:
    """Weights of value and slope before and after, for the value ``ahead_m`` into the gap: its conditional mean."""
    here, rest = transition(ahead_m, model), transition(gap_m - ahead_m, model)
    cross = noise(ahead_m, sigma, walk, model) @ rest.transpose(0, 2, 1)
    gain = np.linalg.solve(noise(gap_m, sigma, walk, model), cross.transpose(0, 2, 1)).transpose(0, 2, 1)
    first = here - gain @ transition(gap_m, model)
    return np.concatenate([first[:, 0], gain[:, 0]], axis=1)


def _columns(node: Int[np.ndarray, " row"], axis: int) -> Int[np.ndarray, "row 2"]:
    return np.asarray(STATES * node[:, None] + 2 * axis + np.arange(2))


def _block_rows(
    values: Float[np.ndarray, "block row column"], columns: list[Int[np.ndarray, "block 2"]], states: int
) -> sparse.csr_array:
    """Blocks of rows below each other, each at columns of its own."""
    blocks, rows, _ = values.shape
    column = np.concatenate(columns, axis=1)
    row = np.arange(blocks * rows).reshape(blocks, rows)
    place = np.broadcast_to(column[:, None, :], values.shape), np.broadcast_to(row[:, :, None], values.shape)
    return sparse.csr_array(
        (values.reshape(-1), (place[1].reshape(-1), place[0].reshape(-1))), shape=(blocks * rows, states)
    )


_BOUND2 = 16.27  # of chi-square with three degrees of freedom, 999 in 1000 lie below
_LOSS2 = 3.0  # largest cost of a fix during the search for wrong ones: a smaller one outvotes longer runs
_MEDIAN2 = 2.366  # and half lie below this
_SETTLED_ROUNDS = 8  # iterations of adding and removing fixes at the end
_STEPS = 2  # of Gauss-Newton in each of them: except for a degree of yaw the problem is linear


class FixEdges(NamedTuple):
    """Fixes of places on the ground of other places.

    Attributes:
        chain: of the matched place, and of the ground it was matched on.
        at_m: of both, along their chains' paths.
        label: east_m, north_m, yaw_rad of both by their labels.
        found: pose of the place by the ground's labels.
        covariance: of ``found``.
    """

    chain: Int[np.ndarray, "edge 2"]
    at_m: Float[np.ndarray, "edge 2"]
    label: Float[np.ndarray, "edge 2 3"]
    found: Float[np.ndarray, "edge 3"]
    covariance: Float[np.ndarray, "edge 3 3"]


@dataclass(frozen=True)
class GraphSolution:
    """Corrections for which labels agree.

    Attributes:
        nodes, model: of the chains.
        state: of all nodes.
        kept: fixes that were used.
        noise_scale: factor from the fixes' sigmas to their actual errors; at least 1.
        information: of the states, sparse.
    """

    nodes: Nodes
    model: LabelModel
    state: Float[np.ndarray, " state"]
    kept: Bool[np.ndarray, " edge"]
    noise_scale: float
    information: sparse.csc_array

    def correction(
        self, chain: Int[np.ndarray, " place"], at_m: Float[np.ndarray, " place"]
    ) -> Float[np.ndarray, "place 3"]:
        """What to add to the labels' east_m, north_m and yaw_rad at places."""
        rows = place_rows(self.nodes, chain, at_m, self.model)
        return np.asarray(rows @ self.state).reshape(-1, 3)

    def covariance(
        self, chain: Int[np.ndarray, " place"], at_m: Float[np.ndarray, " place"]
    ) -> Float[np.ndarray, "row row"]:
        """Of the corrections at a few places: rows east, north, yaw of the first, then of the second, and so on."""
        rows = place_rows(self.nodes, chain, at_m, self.model)
        return np.asarray(rows @ self._factor.solve(rows.T.toarray()))

    @cached_property
    def _factor(self) -> SuperLU:
        return _factor(self.information)


def misfit(
    edges: FixEdges, place: Float[np.ndarray, "edge 3"], ground: Float[np.ndarray, "edge 3"]
) -> Float[np.ndarray, "edge 3"]:
    """Places minus their fixes, in east_m, north_m and yaw_rad, under corrections to both their labels."""
    lever_m = edges.found[:, :2] - edges.label[:, 1, :2]
    off = edges.label[:, 0] + place - ground
    off[:, :2] -= edges.label[:, 1, :2] + _turned(lever_m, ground[:, 2])
    off[:, 2] = np.mod(off[:, 2] - edges.found[:, 2] + np.pi, 2.0 * np.pi) - np.pi
    return np.asarray(off)


def solve_graph(chains: tuple[LabelChain, ...], edges: FixEdges, model: LabelModel) -> GraphSolution:
    """Corrections of all chains from the fixes between them.

    A chain without fixes keeps its labels: its correction is zero.

    Args:
        chains: stretches of drives.
        edges: fixes; may be empty.
        model: of the labels' errors.
    """
    nodes = lay_nodes(chains, model)
    graph = Graph(nodes, edges, model)
    state = np.zeros(graph.prior.shape[1])
    mu = max(1.0, 2.0 * float(np.max(graph.squared(state), initial=0.0)) / _LOSS2)
    while True:
        weight = (mu * _LOSS2 / (graph.squared(state) + mu * _LOSS2)) ** 2 / mu
        state = graph.step(state, weight)
        if mu == 1.0:
            break
        mu = max(1.0, 0.5 * mu)
    kept, scale2 = np.zeros(len(edges.found), bool), 1.0
    for round_number in range(_SETTLED_ROUNDS):
        squared = graph.squared(state)
        scale2 = max(1.0, float(np.median(squared)) / _MEDIAN2) if len(squared) else 1.0
        inside = squared <= scale2 * _BOUND2
        if round_number > 0 and np.array_equal(inside, kept):
            break
        kept = inside
        for _ in range(_STEPS):
            state = graph.step(state, kept / scale2)
    information = graph.information(state, kept / scale2)
    return GraphSolution(nodes, model, state, np.asarray(kept), float(np.sqrt(scale2)), information)


class Graph:
    """Residuals of fixes, their derivatives, and Gauss-Newton's step."""

    def __init__(self, nodes: Nodes, edges: FixEdges, model: LabelModel) -> None:
        self.prior = prior_rows(nodes, model)
        self._edges = edges
        ends = np.concatenate([edges.chain[:, 0], edges.chain[:, 1]])
        self._ends = place_rows(nodes, ends, np.concatenate([edges.at_m[:, 0], edges.at_m[:, 1]]), model)
        self._prior_information = self.prior.T @ self.prior
        self._whiten = np.linalg.inv(np.linalg.cholesky(edges.covariance))
        # Columns of an edge's block: the three corrections of its place, then those of its ground.
        count = len(edges.found)
        row = np.arange(3 * count).reshape(count, 3, 1)
        column = np.concatenate([row[:, :, 0], row[:, :, 0] + 3 * count], axis=1)[:, None, :]
        self._where = np.broadcast_arrays(row, column)

    def squared(self, state: Float[np.ndarray, " state"]) -> Float[np.ndarray, " edge"]:
        """Squared residuals in units of the fixes' covariances."""
        return np.asarray(np.sum(self.residual(state) ** 2, axis=1))

    def residual(self, state: Float[np.ndarray, " state"]) -> Float[np.ndarray, "edge 3"]:
        """Whitened residuals."""
        return np.asarray(np.einsum("eij,ej->ei", self._whiten, misfit(self._edges, *self._corrections(state))))

    def jacobian(self, state: Float[np.ndarray, " state"]) -> sparse.csr_array:
        """Derivative of the whitened residuals, edge by edge, after the states."""
        edges = self._edges
        _, ground = self._corrections(state)
        lever = _turned(edges.found[:, :2] - edges.label[:, 1, :2], ground[:, 2])
        block = np.tile(np.concatenate([np.eye(3), -np.eye(3)], axis=1), (len(lever), 1, 1))
        block[:, 0, 5], block[:, 1, 5] = lever[:, 1], -lever[:, 0]
        values = self._whiten @ block
        row, column = self._where
        shape = (3 * len(lever), self._ends.shape[0])
        return sparse.csr_array((values.reshape(-1), (row.reshape(-1), column.reshape(-1))), shape=shape) @ self._ends

    def information(self, state: Float[np.ndarray, " state"], weight: Float[np.ndarray, " edge"]) -> sparse.csc_array:
        """Of the states: that of the labels and of the weighted fixes."""
        return self._weighed(self.jacobian(state), weight)

    def step(
        self, state: Float[np.ndarray, " state"], weight: Float[np.ndarray, " edge"]
    ) -> Float[np.ndarray, " state"]:
        """The states after one step of weighted Gauss-Newton."""
        jacobian = self.jacobian(state)
        slope = self._prior_information @ state
        slope = slope + jacobian.T @ (self.residual(state) * weight[:, None]).reshape(-1)
        return np.asarray(state - _factor(self._weighed(jacobian, weight)).solve(slope))

    def _weighed(self, jacobian: sparse.csr_array, weight: Float[np.ndarray, " edge"]) -> sparse.csc_array:
        root = sparse.dia_array((np.sqrt(np.repeat(weight, 3))[None], [0]), shape=(jacobian.shape[0],) * 2)
        whitened = root @ jacobian
        return sparse.csc_array(self._prior_information + whitened.T @ whitened)

    def _corrections(
        self, state: Float[np.ndarray, " state"]
    ) -> tuple[Float[np.ndarray, "edge 3"], Float[np.ndarray, "edge 3"]]:
        both = np.asarray(self._ends @ state).reshape(2, -1, 3)
        return both[0], both[1]


def _turned(
    vector_m: Float[np.ndarray, "edge 2"], angle_rad: Float[np.ndarray, " edge"]
) -> Float[np.ndarray, "edge 2"]:
    cos, sin = np.cos(angle_rad), np.sin(angle_rad)
    x, y = vector_m.T
    return np.stack([cos * x - sin * y, sin * x + cos * y], axis=1)


def _factor(information: sparse.csc_array) -> SuperLU:
    # Symmetric and positive definite: the diagonal is a sound pivot, and the order may be chosen for sparsity alone.
    return splu(information, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})
