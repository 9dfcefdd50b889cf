"""Time a scan on maps of any length, and what a tile's preparation costs.

A program (``python -m benchmarks.map_length``). In the time a scan are the look-up, gridding, columns and matching;
opening the map is told apart.
"""

import argparse
import json
import resource
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack
from itertools import pairwise
from pathlib import Path

import jax
import numpy as np
from jaxtyping import Float

from benchmarks.long_map import RepeatedRoad
from benchmarks.process import hold_to
from benchmarks.registration import SUCCESS_M
from lgprjax.formats import MapFile
from lgprjax.registration import BLOCK_SCANS, LiveBlock, RegisterOptions, Track, ground_map_for, register_drive
from lgprjax.registration.template_bank import PreparedGround
from lgprjax.subsurface import GroundMap, StationSource

SEARCH_M = 3.5
_WIDE_LANES = 6
"""A road as wide as the box and the array: nothing of a tile is empty."""
_WIDE_M = 40.0
_KILOMETRE_M = 1000.0
_PASSES = 3
_SLACK_M = 0.5  # that the search's lattice reaches beyond its region
_OPTIONS = RegisterOptions(search_m=SEARCH_M, time_scale=1.0)


def time_a_drive(length_m: float, scans: int, file: Path | None = None) -> dict[str, float]:
    """Register a drive in the middle of a map several times over.

    Args:
        length_m: of the map, in whole kilometres.
        scans: of the drive.
        file: of ``stored_road``, as long as the map; without it the map is in memory.

    Returns:
        Figures by name: ``scan_ms`` (the best pass), ``first_scan_ms``, ``open_s``, ``scan_cpu_ms`` and ``open_cpu_s``
        in processor time (where other work has a part of the cores), ``scans_a_tile``, ``success_share``, and the peak
        memory of the process after one block, ``block_rss_mb``, and in the end, ``peak_rss_mb``.
    """
    road = RepeatedRoad(length_m if file is None else _KILOMETRE_M)
    begin_m = _KILOMETRE_M * (length_m // _KILOMETRE_M // 2) + 0.3 * _KILOMETRE_M
    drive = road.live_block(begin_m, scans, seed=1)
    with ExitStack() as opened:
        start, cpu = time.perf_counter(), time.process_time()
        source: StationSource = road if file is None else opened.enter_context(MapFile.open(file))
        ground = ground_map_for(source, _OPTIONS)
        open_s, open_cpu_s = time.perf_counter() - start, time.process_time() - cpu
        warm = _cut(drive, 0, min(scans, BLOCK_SCANS))
        recorded = int(road.operator.shape[0])
        list(register_drive(ground, road.operators, road.array, [warm], _OPTIONS, recorded=recorded))
        block_mb = peak_rss_mb()
        passes, cpu_passes = [], []
        for _ in range(_PASSES):
            start, cpu = time.perf_counter(), time.process_time()
            blocks = _blocks(drive)
            found = list(register_drive(ground, road.operators, road.array, blocks, _OPTIONS, recorded=recorded))
            passes.append(time.perf_counter() - start)
            cpu_passes.append(time.process_time() - cpu)
    assert drive.truth is not None
    pose = np.concatenate([part.fix.pose for part in found])
    error_m = np.hypot(*(pose[:, :2] - drive.truth[:, :2]).T)
    return {
        "length_m": length_m,
        "search_m": SEARCH_M,
        "scans": scans,
        "scan_ms": 1e3 * min(passes) / scans,
        "first_scan_ms": 1e3 * passes[0] / scans,
        "scan_cpu_ms": 1e3 * min(cpu_passes) / scans,
        "open_s": open_s,
        "open_cpu_s": open_cpu_s,
        "scans_a_tile": scans / _served(ground, drive.truth[:, :2]),
        "success_share": float(np.mean(error_m <= SUCCESS_M)),
        "block_rss_mb": block_mb,
        "peak_rss_mb": peak_rss_mb(),
    }


def time_tiles() -> dict[str, float]:
    """Median milliseconds a tile of a road as wide as the box: reading and gridding, and its columns."""
    road = RepeatedRoad(_WIDE_M, _WIDE_M, _WIDE_LANES)
    ground = ground_map_for(road, _OPTIONS)
    prepared = PreparedGround(ground, road.array)
    middle = np.flatnonzero(np.hypot(*(road.tile_frame[:, :2] - [0.5 * _WIDE_M, 0.0]).T) < 0.3 * _WIDE_M)
    gridding, columns = [], []
    for tile in middle[:12]:
        yaw = ground.frame(int(tile))[2:]
        aspect = prepared.aspects(np.array([tile]), yaw, np.ones(1))[0][0]
        start = time.perf_counter()
        jax.block_until_ready(ground.tile(int(tile), aspect.direction))
        gridded = time.perf_counter()
        jax.block_until_ready(prepared.at(aspect).columns)
        columns.append(time.perf_counter() - gridded)
        gridding.append(gridded - start)
    spec, _ = ground.grid_of(0)
    # The first one compiles.
    return {
        "search_m": SEARCH_M,
        "gridding_ms": 1e3 * float(np.median(gridding[1:])),
        "columns_ms": 1e3 * float(np.median(columns[1:])),
        "cells": spec.along_cells * spec.cross_cells,
    }


def peak_rss_mb() -> float:
    """Largest memory of this process so far."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / (1e6 if sys.platform == "darwin" else 1e3)


def _served(ground: GroundMap, places_m: Float[np.ndarray, "scan 2"]) -> int:
    """Tiles that a drive comes by: one stays in use as long as it serves."""
    tile, seen = None, set[int | None]()
    for place in places_m:
        tile = ground.tile_holding(tile, place, SEARCH_M + _SLACK_M)
        seen.add(tile)
    return len(seen)


def _blocks(drive: LiveBlock) -> Iterator[LiveBlock]:
    scans = len(drive.traces)
    for low, high in pairwise([*range(0, scans, BLOCK_SCANS), scans]):
        yield _cut(drive, low, high)


def _cut(drive: LiveBlock, low: int, high: int) -> LiveBlock:
    return LiveBlock(drive.traces[low:high], drive.valid[low:high], Track(*(part[low:high] for part in drive.track)))


def main() -> None:
    """The program."""
    parser = argparse.ArgumentParser(prog="benchmarks.map_length")
    parser.add_argument("out", type=Path)
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--scans", type=int, default=2850)
    what = parser.add_mutually_exclusive_group(required=True)
    what.add_argument("--kilometres", type=int, help="time a drive on a map of this length")
    what.add_argument("--tiles", action="store_true", help="time the preparation of tiles")
    parser.add_argument("--file", type=Path, help="the map on disk, of stored_road; without it in memory")
    chosen = parser.parse_args()
    hold_to(chosen.threads)
    length_m = _KILOMETRE_M * (chosen.kilometres or 0)
    figures = time_tiles() if chosen.tiles else time_a_drive(length_m, chosen.scans, chosen.file)
    chosen.out.write_text(json.dumps(figures) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
