"""Many lanes on the host: chunks of one shape, as many at once as there are cores."""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import numpy as np
from jax.tree_util import tree_map
from jaxtyping import Float

from lgprjax.machine import usable_cores
from lgprjax.vehicle.chassis import MeasuredRear
from lgprjax.vehicle.lanes import RolloutLane, RolloutSpec, RolloutState
from lgprjax.vehicle.metrics import RolloutMetrics
from lgprjax.vehicle.path import Path
from lgprjax.vehicle.rollout import roll_out

CHUNK = 8192
"""Lanes at once: a step's numbers stay in a core's caches, and calls between the steps are few."""


def roll_out_many(
    spec: RolloutSpec, path: Path, lane: RolloutLane, start: RolloutState, *, chunk: int = CHUNK
) -> tuple[RolloutState, RolloutMetrics]:
    """``roll_out`` of any number of lanes in bounded memory: beside what goes in and comes out, a few chunks.

    Args:
        spec: the same for all.
        path: for all.
        lane: fields with one value a lane, or scalars for all; a measured ψ(φ) is for all.
        start: one value a lane.
        chunk: lanes at once. It changes the time, not the result.

    Returns:
        Final states and metrics, NumPy arrays with one value a lane.
    """
    count = len(start.x_m)
    size = min(chunk, count)
    bounds = [(low, min(low + size, count)) for low in range(0, count, size)]
    # On the host once: a cut of an array on the device would be compiled for every place.
    host_lane, host_start = _map_lanes(np.asarray, lane), tree_map(np.asarray, start)

    def run(low: int, high: int) -> tuple[RolloutState, RolloutMetrics]:
        cut_lane = _map_lanes(lambda leaf: _cut(leaf, low, high, size), host_lane)
        cut_start = tree_map(lambda leaf: _cut(leaf, low, high, size), host_start)
        done = roll_out(spec, path, cut_lane, cut_start)
        found: tuple[RolloutState, RolloutMetrics] = tree_map(lambda leaf: np.asarray(leaf)[..., : high - low], done)
        return found

    with ThreadPoolExecutor(usable_cores()) as pool:
        chunks = list(pool.map(lambda bound: run(*bound), bounds))
    joined: tuple[RolloutState, RolloutMetrics] = tree_map(lambda *parts: np.concatenate(parts, axis=-1), *chunks)
    return joined


Leaf = Float[np.ndarray, "..."]


def _map_lanes(change: Callable[[Leaf], Leaf], lane: RolloutLane) -> RolloutLane:
    """Every field that may have one value a lane; a measured ψ(φ) has none."""

    def measured(node: object) -> bool:
        return isinstance(node, MeasuredRear)

    changed: RolloutLane = tree_map(lambda leaf: leaf if measured(leaf) else change(leaf), lane, is_leaf=measured)
    return changed


def _cut(values: Leaf, low: int, high: int, size: int) -> Leaf:
    """Lanes from low to high, the last repeated up to the size; a scalar as it is. Lanes are the last axis."""
    if values.ndim == 0:
        return values
    part = values[..., low:high]
    return np.concatenate([part, np.repeat(part[..., -1:], size - (high - low), axis=-1)], axis=-1)
