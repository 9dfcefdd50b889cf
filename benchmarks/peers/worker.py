"""What every peer's program does alike: its arguments, its clocks, its result."""

import argparse
import json
import os
import resource
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from benchmarks.registration import HardSet, error_m, load_hard_set, success

_REPEATS = 5
_BUDGET_S = 4.0


class Peer(NamedTuple):
    """A search on one hard set.

    Attributes:
        name, setting: for the table.
        evaluations: of the score a scan.
        prepare: what can be done for a map before scans come; may be called again.
        locate: pose of one scan of int8 values on a map.
        locate_all: poses of these problems in the way that is fastest for many; None where there is no such way.
    """

    name: str
    setting: str
    evaluations: int
    prepare: Callable[[int], None]
    locate: Callable[[int, Float[np.ndarray, "channel sample"]], Float[np.ndarray, " 5"]]
    locate_all: Callable[[Int[np.ndarray, " problem"]], Float[np.ndarray, "problem 5"]] | None


def arguments(name: str, particles: int, iterations: int) -> argparse.ArgumentParser:
    """The arguments that all peers know."""
    parser = argparse.ArgumentParser(prog=f"benchmarks.peers.{name}")
    parser.add_argument("hard_set", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("--count", type=int, required=True, help="problems, spread evenly over the set")
    parser.add_argument("--threads", type=int, default=1)
    if particles:
        parser.add_argument("--particles", type=int, default=particles)
        parser.add_argument("--iterations", type=int, default=iterations)
        parser.add_argument("--full", action="store_true", help="369 samples a trace instead of the band's numbers")
    return parser


def work(chosen: argparse.Namespace, build: Callable[[HardSet], Peer]) -> None:
    """Pin, load, warm up, measure, write the result."""
    if sys.platform == "linux":
        allowed = sorted(os.sched_getaffinity(0))
        os.sched_setaffinity(0, allowed[-chosen.threads :])
    hard_set = load_hard_set(chosen.hard_set)
    problems = np.unique(np.linspace(0, len(hard_set.truth) - 1, chosen.count).round().astype(int))
    peer = build(hard_set)
    preparation_s = _prepare(peer, np.unique(hard_set.map_index[problems]))
    poses, single_s, batch_s = _measure(peer, hard_set, problems)
    truth = hard_set.truth[problems]
    right = success(poses, truth)
    median_m = float(np.median(error_m(poses, truth)[right])) if right.any() else float("nan")
    result = {
        "name": peer.name,
        "setting": peer.setting,
        "problems": len(problems),
        "successes": int(right.sum()),
        "median_error_m": median_m,
        "single_ms": 1e3 * single_s,
        "batch_ms": 1e3 * batch_s,
        "evaluations": peer.evaluations,
        "preparation_ms": 1e3 * preparation_s,
        # Kilobytes on Linux, bytes on macOS.
        "peak_rss_mb": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / (1e6 if sys.platform == "darwin" else 1e3),
        "single_threads": chosen.threads,
        "batch_threads": chosen.threads,
    }
    chosen.out.write_text(json.dumps(result) + "\n", encoding="utf-8")


def _prepare(peer: Peer, maps: Int[np.ndarray, " map"]) -> float:
    """Median seconds a map, the first call of all left out."""
    peer.prepare(int(maps[0]))
    taken = []
    for place in maps:
        begin = time.perf_counter()
        peer.prepare(int(place))
        taken.append(time.perf_counter() - begin)
    return float(np.median(taken))


def _measure(
    peer: Peer, hard_set: HardSet, problems: Int[np.ndarray, " problem"]
) -> tuple[Float[np.ndarray, "problem 5"], float, float]:
    """Poses, median single latency and batch time a scan; the best of a few passes where they are short."""

    def one(problem: int) -> Float[np.ndarray, " 5"]:
        return peer.locate(int(hard_set.map_index[problem]), hard_set.scans[problem])

    for problem in problems[:3]:
        one(problem)
    medians: list[float] = []
    begin = time.perf_counter()
    while not medians or (len(medians) < _REPEATS and time.perf_counter() - begin < _BUDGET_S):
        taken, poses = [], []
        for problem in problems:
            start = time.perf_counter()
            poses.append(one(problem))
            taken.append(time.perf_counter() - start)
        medians.append(float(np.median(taken)))
    if peer.locate_all is None:
        return np.stack(poses), min(medians), float(np.mean(taken))
    found = peer.locate_all(problems)
    passes: list[float] = []
    begin = time.perf_counter()
    while not passes or (len(passes) < _REPEATS and time.perf_counter() - begin < _BUDGET_S):
        start = time.perf_counter()
        found = peer.locate_all(problems)
        passes.append(time.perf_counter() - start)
    return found, min(medians), min(passes) / len(problems)
