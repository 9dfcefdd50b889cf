"""Thousands of drives with an error model (``python -m benchmarks.many_drives OUT --lanes N --length-m L ...``)."""

import argparse
import json
import time
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np

from benchmarks.process import hold_to
from benchmarks.rollout_peers.work import peak_rss_mb
from lgprjax.scene import calibrated_fixes
from lgprjax.simulation.loop import (
    LoopSpec,
    LoopSums,
    LoopVehicle,
    OffRoad,
    blank_sums,
    draw_course,
    loop_setup,
    route_of_road,
    run_lanes,
    start_lanes,
)

_BLOCK_TICKS = 500


def main() -> None:
    """The program."""
    parser = argparse.ArgumentParser(prog="benchmarks.many_drives")
    parser.add_argument("out", type=Path)
    parser.add_argument("--lanes", type=int, required=True)
    parser.add_argument("--length-m", type=float, required=True)
    parser.add_argument("--weather", default="clear")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--threads", type=int, required=True)
    chosen = parser.parse_args()
    hold_to(chosen.threads)
    spec = LoopSpec(reckons=False)
    course = draw_course(OffRoad(chosen.seed, chosen.length_m))
    setup = loop_setup(spec, LoopVehicle(), course.terrain)
    route = route_of_road(course, setup.autopilot.chassis, float(setup.set_speed_mps))
    errors = calibrated_fixes(chosen.weather)
    keys = jax.random.split(jax.random.key(chosen.seed), chosen.lanes)
    state, fix_state = start_lanes(spec, setup, course, route, errors, keys)
    sums = jax.tree.map(lambda leaf: jnp.broadcast_to(leaf, (chosen.lanes, *leaf.shape)), blank_sums())
    ticks = int(chosen.length_m / float(setup.set_speed_mps) / spec.tick_s)
    blocks = -(-ticks // _BLOCK_TICKS)
    began = time.perf_counter()
    compiled_s = 0.0
    for number in range(blocks):
        block_keys = jax.vmap(lambda key, n=number: jax.random.fold_in(key, n))(keys)
        state, fix_state, sums = run_lanes(spec, setup, route, errors, state, fix_state, sums, block_keys, _BLOCK_TICKS)
        jax.block_until_ready(sums)
        if number == 0:
            compiled_s = time.perf_counter() - began
    seconds = time.perf_counter() - began
    chosen.out.write_text(json.dumps(figures_of(sums, spec, seconds, compiled_s)), encoding="utf-8")


def figures_of(sums: LoopSums, spec: LoopSpec, seconds: float, first_s: float) -> dict[str, float]:
    """Figures over all drives."""
    told: LoopSums = jax.tree.map(lambda leaf: np.asarray(leaf, np.float64), sums)
    way = told.way_m.sum()
    driven_s = float(told.ticks.sum()) * spec.tick_s
    rms = np.sqrt(told.square_m3 / np.maximum(told.way_m, 1e-9))
    return {
        "kilometres": float(way) / 1e3,
        "seconds": seconds,
        "first_block_s": first_s,
        "times_real_time": driven_s / seconds,
        "rms_m": float(np.sqrt(told.square_m3.sum() / way)),
        "rms_95_m": float(np.percentile(rms, 95)),
        "largest_m": float(told.largest_m.max()),
        "within_foot": 1.0 - float(told.beyond_foot_m.sum() / way),
        "nees_position": float(told.nees_position.sum() / told.ticks.sum() / 2.0),
        "nees_yaw": float(told.nees_yaw.sum() / told.ticks.sum()),
        "fix_share": float(told.fixes.sum() / told.ticks.sum()),
        "stopped": float(np.mean(told.reactions[:, 2] > 0)),
        "degraded_share": float(told.reactions[:, 1].sum() / told.ticks.sum()),
        "peak_rss_mb": peak_rss_mb(),
    }


if __name__ == "__main__":
    main()
