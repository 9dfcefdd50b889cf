"""Latency of consecutive single scans in a box of tracking size; a program (``python -m benchmarks.latency``).

A drive of generated ground passes tiles as long as a map's are. The tiles are prepared ahead, as they are while a
vehicle comes near; the way from 369 samples of 11 channels to a pose is in every time.
"""

import argparse
import gc
import json
import resource
import sys
import time
from pathlib import Path

import numpy as np
from jaxtyping import Float

from benchmarks.peers import this_project
from benchmarks.peers.worker import Peer
from benchmarks.process import hold_to
from benchmarks.registration import CELL_M, HALF_CELLS, HardSet, HardSetConfig, make_hard_set, success

BOX_M = 0.5
_TILE_SPACING_M = 4.0
_ARRAY_M = 0.7
_SCANS_A_TILE = 114
_DIFFICULTY = HardSetConfig(maps=4, scans=_SCANS_A_TILE, half_width=(BOX_M, BOX_M, *HardSetConfig.half_width[2:]))
_WARM_UP = 200


def tracking_set(seed: int) -> HardSet:
    """Scans with their truth within the box, on tiles no larger than such a box needs."""
    wide = make_hard_set(seed, _DIFFICULTY)
    half_m = BOX_M + 0.5 * _TILE_SPACING_M + _ARRAY_M
    keep = np.minimum(np.ceil(half_m / CELL_M).astype(int), HALF_CELLS)
    first = np.array(HALF_CELLS) - keep
    ground = wide.ground[:, first[0] : first[0] + 2 * keep[0] + 1, first[1] : first[1] + 2 * keep[1] + 1]
    return wide._replace(ground=np.ascontiguousarray(ground), origin_m=-CELL_M * keep)


def measure(hard_set: HardSet, peer: Peer, scans: int) -> tuple[Float[np.ndarray, " scan"], int]:
    """Seconds that each of ``scans`` consecutive scans took, and how many were found.

    Tile follows tile; after the last one the drive begins again.
    """
    taken = np.empty(scans)
    poses = np.empty((scans, 5))
    order = np.arange(scans) % len(hard_set.truth)
    for n in range(_WARM_UP):
        peer.locate(int(hard_set.map_index[order[n % scans]]), hard_set.scans[order[n % scans]])
    gc.collect()
    gc.freeze()
    gc.disable()
    for n, problem in enumerate(order):
        place, samples = int(hard_set.map_index[problem]), hard_set.scans[problem]
        begin = time.perf_counter()
        poses[n] = peer.locate(place, samples)
        taken[n] = time.perf_counter() - begin
    gc.enable()
    return taken, int(np.sum(success(poses, hard_set.truth[order])))


def main() -> None:
    """The program."""
    parser = argparse.ArgumentParser(prog="benchmarks.latency")
    parser.add_argument("out", type=Path)
    parser.add_argument("--scans", type=int, required=True)
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--seed", type=int, default=0)
    chosen = parser.parse_args()
    hold_to(chosen.threads)
    hard_set = tracking_set(chosen.seed)
    peer = this_project.build(hard_set, argparse.Namespace(stride=(3, 2), swarm=None, threads=chosen.threads))
    prepared = []
    for place in [0, *range(len(hard_set.ground))]:
        begin = time.perf_counter()
        peer.prepare(place)
        prepared.append(time.perf_counter() - begin)
    taken, successes = measure(hard_set, peer, chosen.scans)
    p50, p99 = 1e3 * np.percentile(taken, [50, 99])
    figures = {
        "box_m": BOX_M,
        "scans": chosen.scans,
        "threads": chosen.threads,
        "successes": successes,
        "p50_ms": float(p50),
        "p99_ms": float(p99),
        "max_ms": float(1e3 * taken.max()),
        "preparation_ms": float(1e3 * np.median(prepared[1:])),
        "peak_rss_mb": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / (1e6 if sys.platform == "darwin" else 1e3),
    }
    chosen.out.write_text(json.dumps(figures) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
