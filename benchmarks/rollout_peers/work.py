"""What every program of the rollout benchmark does alike: arguments, clocks, results."""

import argparse
import json
import resource
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from benchmarks.process import hold_to


def arguments(name: str) -> argparse.Namespace:
    """OUT, problem, steps, threads, repeats; FINALS to be written."""
    parser = argparse.ArgumentParser(prog=f"benchmarks.rollout_peers.{name}")
    parser.add_argument("out", type=Path)
    parser.add_argument("problem", type=Path)
    parser.add_argument("finals", type=Path)
    parser.add_argument("--steps", type=int, required=True)
    parser.add_argument("--threads", type=int, required=True)
    parser.add_argument("--repeats", type=int, default=5)
    chosen = parser.parse_args()
    hold_to(chosen.threads)
    return chosen


def seconds(action: Callable[[], Any], repeats: int) -> list[float]:
    """Of each repeat, after one that is not counted."""
    action()
    taken = []
    for _ in range(repeats):
        begin = time.perf_counter()
        action()
        taken.append(time.perf_counter() - begin)
    return taken


def peak_rss_mb() -> float:
    """Of this process so far."""
    # Kilobytes on Linux, bytes on macOS.
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / (1e6 if sys.platform == "darwin" else 1e3)


def finish(
    chosen: argparse.Namespace,
    taken_s: list[float],
    lanes: int,
    pose: Float[np.ndarray, "4 lane"],
    rms_m: Float[np.ndarray, " lane"],
    **more: float,
) -> None:
    """Write final x, y, cosine, sine and the RMS error, and the figures."""
    with chosen.finals.open("wb") as file:
        np.savez(file, pose=np.asarray(pose), rms_m=np.asarray(rms_m))
    figures = {
        "best_s": min(taken_s),
        "median_s": float(np.median(taken_s)),
        "vehicle_steps": lanes * chosen.steps,
        "threads": chosen.threads,
        "peak_rss_mb": peak_rss_mb(),
        **more,
    }
    chosen.out.write_text(json.dumps(figures), encoding="utf-8")
