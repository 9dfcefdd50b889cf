"""Peak memory and time of very many rollouts (``python -m benchmarks.rollout_memory OUT --lanes N --steps N``)."""

import argparse
import json
import time
from pathlib import Path

import jax
import numpy as np

from benchmarks.process import hold_to
from benchmarks.rollout_peers.work import peak_rss_mb
from benchmarks.rollout_problem import as_rollout, make_problem
from lgprjax.vehicle import roll_out_many


def main() -> None:
    """The program."""
    parser = argparse.ArgumentParser(prog="benchmarks.rollout_memory")
    parser.add_argument("out", type=Path)
    parser.add_argument("--lanes", type=int, required=True)
    parser.add_argument("--steps", type=int, required=True)
    parser.add_argument("--threads", type=int, required=True)
    chosen = parser.parse_args()
    hold_to(chosen.threads)
    spec, path, lane, start = as_rollout(make_problem(chosen.lanes, chosen.steps, seed=1), chosen.steps)
    lane, start = jax.tree.map(np.asarray, (lane, start))
    begin = time.perf_counter()
    _, metrics = roll_out_many(spec, path, lane, start)
    figures = {
        "seconds": time.perf_counter() - begin,
        "peak_rss_mb": peak_rss_mb(),
        "finite_share": float(np.isfinite(metrics.rms_m).mean()),
    }
    chosen.out.write_text(json.dumps(figures), encoding="utf-8")


if __name__ == "__main__":
    main()
