"""The live worked area of a hectare beside the source's cached shapes and brute force; a program (``python -m``).

The tool drives lines of the field at 10 moments a second, the covariance growing and shrinking as with fixes that come
and go. Every program is given the same moments; what each claims at a level is counted at the end.
"""

import argparse
import gc
import json
import resource
import sys
import time
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

from benchmarks.cached_shapes import make_shapes, stamp_shape
from benchmarks.process import hold_to
from lgprjax.coverage import (
    LEVELS,
    CellGrid,
    CellState,
    Tool,
    ToolMoment,
    cell_centres,
    cell_states,
    init_worked,
    step_worked,
)

TOOL = Tool(1.2, 0.4, 1.1, 0.0)
"""A made-up small flail."""
_SIDE_M, _CELL_M = 100.0, 0.05
_MPS, _PERIOD_S, _SPACING_M = 0.4, 0.1, 1.0
_FIXES_S, _NONE_S = 60.0, 30.0
_POSITION_M = np.array([0.01, 0.015, 0.02, 0.025, 0.03, 0.04, 0.05, 0.06, 0.08, 0.10])
_HEADING_RAD = np.radians([0.25, 0.5, 0.75, 1.0, 1.5])
_TRANSIENT_MOMENTS = 200


def drive(moments: int) -> tuple[Float[np.ndarray, "moment 3"], Float[np.ndarray, "moment 3 3"]]:
    """Poses and covariances along lines of the field, one after the other; moments of the turns are left out."""
    way_m = _MPS * _PERIOD_S * np.arange(moments)
    line, along_m = np.divmod(way_m, _SIDE_M - 4.0)
    back = line % 2 == 1
    x = np.where(back, _SIDE_M - 2.0 - along_m, 2.0 + along_m)
    poses = np.stack([x, 2.0 + _SPACING_M * line, np.where(back, np.pi, 0.0)], axis=1)
    without_s = np.maximum(np.mod(_PERIOD_S * np.arange(moments), _FIXES_S + _NONE_S) - _FIXES_S, 0.0)
    heading = np.radians(0.4) * np.sqrt(1.0 + without_s / _NONE_S)
    side, ahead = 0.015 + 0.0015 * without_s, 0.015 + 0.0008 * without_s
    covariance = np.zeros((moments, 3, 3))
    covariance[:, 0, 0], covariance[:, 1, 1], covariance[:, 2, 2] = ahead**2, side**2, heading**2
    covariance[:, 1, 2] = covariance[:, 2, 1] = 0.3 * side * heading * np.where(back, -1.0, 1.0)
    return poses, covariance


def measure_ours(
    grid: CellGrid, poses: Float[np.ndarray, "moment 3"], covariances: Float[np.ndarray, "moment 3 3"]
) -> tuple[Float[np.ndarray, " moment"], Float[np.ndarray, "north east"]]:
    """Seconds of each step with what hands it over, and the map."""
    state = init_worked(grid)
    taken = np.empty(len(poses))
    for place, (pose, covariance) in enumerate(
        zip(poses.astype(np.float32), covariances.astype(np.float32), strict=True)
    ):
        begin = time.perf_counter()
        x, y, yaw = (jnp.asarray(part) for part in pose)
        moment = ToolMoment(x, y, yaw, jnp.asarray(covariance), jnp.asarray(True))
        state = jax.block_until_ready(step_worked(grid, TOOL, state, moment))
        taken[place] = time.perf_counter() - begin
    return taken, np.asarray(state.probability)


def measure_cached(
    grid: CellGrid, poses: Float[np.ndarray, "moment 3"], covariances: Float[np.ndarray, "moment 3 3"], level: float
) -> tuple[float, Float[np.ndarray, " moment"], Bool[np.ndarray, "north east"]]:
    """Seconds that the shapes of one level take, those of each moment, and the cells claimed."""
    begin = time.perf_counter()
    cache = make_shapes(TOOL, level, _POSITION_M, _HEADING_RAD)
    made_s = time.perf_counter() - begin
    claimed = np.zeros(grid.shape, bool)
    taken = np.empty(len(poses))
    for place, (pose, covariance) in enumerate(zip(poses, covariances, strict=True)):
        begin = time.perf_counter()
        stamp_shape(claimed, grid, cache, (float(pose[0]), float(pose[1]), float(pose[2])), covariance)
        taken[place] = time.perf_counter() - begin
    return made_s, taken, claimed


def brute_force(
    grid: CellGrid, pose: Float[np.ndarray, "3"], covariance: Float[np.ndarray, "3 3"], begin_m: float, draws: int
) -> Float[np.ndarray, " place"]:
    """What one moment of ``step_worked`` does on a straight line, by drawn errors: the share over each of its cells.

    Args:
        grid: of the map.
        pose: of the moment, along the x axis.
        covariance: of it.
        begin_m: way since the pass began.
        draws: of the errors.
    """
    reach = 0.5 * np.hypot(TOOL.width_m, TOOL.length_m) + 0.5 * TOOL.width_m
    middle = pose[:2] + np.array([np.cos(pose[2]), np.sin(pose[2])]) * TOOL.ahead_m
    east, north = cell_centres(grid)
    east, north = east[np.abs(east - middle[0]) <= reach], north[np.abs(north - middle[1]) <= reach]
    places = np.stack([part.ravel() for part in np.meshgrid(east, north)], axis=1) - pose[:2]
    errors = np.random.default_rng(0).standard_normal((draws, 3)) @ np.linalg.cholesky(covariance).T
    hits = np.zeros(len(places))
    for dx, dy, turn in errors:
        cos, sin = np.cos(pose[2] + turn), np.sin(pose[2] + turn)
        ahead = cos * (places[:, 0] - dx) + sin * (places[:, 1] - dy) - TOOL.ahead_m
        left = cos * (places[:, 1] - dy) - sin * (places[:, 0] - dx)
        back, aside = np.cos(turn), -np.sin(turn)
        ends = (left - 0.5 * TOOL.width_m) / aside, (left + 0.5 * TOOL.width_m) / aside
        first = np.maximum((ahead - 0.5 * TOOL.length_m) / back, np.minimum(*ends))
        last = np.minimum((ahead + 0.5 * TOOL.length_m) / back, np.maximum(*ends))
        hits += np.maximum(first, -begin_m) <= np.minimum(last, 0.0)
    return hits / draws


def main() -> None:
    """The program."""
    parser = argparse.ArgumentParser(prog="benchmarks.worked_area")
    parser.add_argument("out", type=Path)
    parser.add_argument("--moments", type=int, required=True)
    parser.add_argument("--draws", type=int, required=True)
    parser.add_argument("--threads", type=int, default=1)
    chosen = parser.parse_args()
    hold_to(chosen.threads)
    cells = round(_SIDE_M / _CELL_M)
    grid = CellGrid(0.0, 0.0, _CELL_M, cells, cells)
    poses, covariances = drive(chosen.moments)
    measure_ours(grid, poses[:_TRANSIENT_MOMENTS], covariances[:_TRANSIENT_MOMENTS])
    gc.collect()
    taken, probability = measure_ours(grid, poses, covariances)
    peak_mb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / (1e6 if sys.platform == "darwin" else 1e3)
    figures: dict[str, float] = {
        "cells": float(cells * cells),
        "moments": float(chosen.moments),
        "draws": float(chosen.draws),
        "p50_ms": float(1e3 * np.percentile(taken, 50)),
        "p99_ms": float(1e3 * np.percentile(taken, 99)),
        "max_ms": float(1e3 * taken.max()),
        "map_mb": probability.nbytes / 1e6,
        "peak_rss_mb": peak_mb,
    }
    for level in LEVELS:
        made_s, cached, claimed = measure_cached(grid, poses, covariances, level)
        ours = cell_states(probability, level) == CellState.PROCESSED
        figures |= {
            f"cached_made_s_{level:g}": made_s,
            f"cached_ms_{level:g}": float(1e3 * np.median(cached)),
            f"cached_m2_{level:g}": float(claimed.sum()) * grid.cell_m2,
            f"ours_m2_{level:g}": float(ours.sum()) * grid.cell_m2,
            f"cached_beyond_ours_cells_{level:g}": float(np.count_nonzero(claimed & ~ours)),
        }
    begin = time.perf_counter()
    brute_force(grid, poses[100], covariances[100], 100 * _MPS * _PERIOD_S, chosen.draws)
    figures["brute_force_ms"] = 1e3 * (time.perf_counter() - begin)
    chosen.out.write_text(json.dumps(figures) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
