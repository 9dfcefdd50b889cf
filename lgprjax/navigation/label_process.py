"""What a recorded drive's labels are wrong by: a process along its path, told at nodes, known between them.

A GNSS/INS label wanders slowly: over metres its shape is right, over hundreds of metres it is anywhere within its
sigma. East, north and yaw are each a Gauss-Markov process of the second order (Matérn 3/2: a value and its slope,
Hartikainen & Särkkä 2010) and a small random walk, what no smooth process follows. Being Markov it links each node
with the next one only, and being stationary it is the label's own prior: it is counted once, however dense the nodes.

The slope is held in units of the value (times ``length / sqrt(3)``), so that both have the label's sigma.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int
from scipy import sparse

STATES = 6
"""Of a node: value and slope of the corrections in east_m, north_m and yaw_rad."""


@dataclass(frozen=True)
class LabelModel:
    """How a label's error may change along its drive.

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
    """A stretch of a drive over which its labels hang together.

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
    """Rows [row, state] whose sum of squares, times the states, is what the labels alone say against corrections.

    Of each chain the first node stands within its sigma, every other one follows from the node before.
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

    Between two nodes it is what both make most likely; beyond a chain's ends it is that of the end.

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
    """Covariance that a gap adds: what keeps the smooth process stationary, and the walk in the value."""
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
