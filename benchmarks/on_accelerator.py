"""One problem on whatever device JAX finds; a program (``python -m benchmarks.on_accelerator``).

Run once held to two cores and once where JAX sees the accelerator, it answers the same questions of both.
"""

import argparse
import json
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from benchmarks.peers import this_project
from benchmarks.process import hold_to
from benchmarks.registration import HardSet, load_hard_set, success
from benchmarks.rollout_operations import bytes_a_step
from benchmarks.rollout_peers.work import seconds
from benchmarks.rollout_problem import as_rollout, load_problem
from lgprjax.batch import register_log
from lgprjax.formats import DriveLog, MapFile
from lgprjax.machine import usable_cores
from lgprjax.registration import RegisterOptions
from lgprjax.vehicle import roll_out, roll_out_many

_REPEATS = 5
_COPIED = {"cpu": 1 << 26, "gpu": 1 << 29}
"""Numbers that are copied: many times what caches hold."""


def registration(files: list[Path]) -> tuple[dict[str, Any], dict[str, Any]]:
    """Scans from the host's bytes to poses on the host, and one chunk whose samples are on the device."""
    hard_set = load_hard_set(files[0])
    search = this_project.Search(hard_set, (3, 2), usable_cores())
    for place in range(len(hard_set.ground)):
        search.prepare(place)
    every = np.arange(len(hard_set.truth))
    poses = search.locate_all(every)
    chunk = search.chunk
    some = jnp.asarray(search.scans[np.resize(np.flatnonzero(hard_set.map_index == 0), chunk)])
    there_s = best_s(lambda: jax.block_until_ready(search.found(0, some, chunk)))
    figures = {
        "scans": len(every),
        "right": int(success(poses, hard_set.truth).sum()),
        "chunk": chunk,
        "host_to_host_us": 1e6 * best_s(lambda: search.locate_all(every)) / len(every),
        "on_device_us": 1e6 * there_s / chunk,
        **_least_of(search, hard_set),
    }
    return figures, {"pose": poses}


def _least_of(search: this_project.Search, hard_set: HardSet) -> dict[str, float]:
    """Bytes and operations of a scan: surfaces written once and read once, products with every place of the tile."""
    channels, samples = hard_set.scans.shape[1:]
    along, cross, size = search.columns[0].value.shape
    space = search.spaces[1]
    heights = len(space.heights_m)
    planes = heights + 2
    surface = planes * (search.points**2 + len(space.decoys_m)) * 4
    return {
        "bytes": channels * samples + 2 * surface,
        "operations": 2.0 * channels * samples * hard_set.basis.shape[1] + 2.0 * heights * along * cross * size,
    }


def rollouts(files: list[Path]) -> tuple[dict[str, Any], dict[str, Any]]:
    """Lanes from the host to metrics on the host, and the same with lanes that are on the device."""
    problem = load_problem(files[0])
    steps = int(files[1].read_text(encoding="utf-8"))
    spec, path, lane, start = as_rollout(problem, steps)
    there_s = float("nan")
    if jax.default_backend() != "cpu":
        there_s = best_s(lambda: jax.block_until_ready(roll_out(spec, path, lane, start)))
    held = bytes_a_step(jax.make_jaxpr(roll_out, static_argnums=0)(spec, path, lane, start), len(start.x_m))
    lane, start = jax.tree.map(np.asarray, (lane, start))
    final, metrics = roll_out_many(spec, path, lane, start)
    count = len(start.x_m)
    figures = {
        "vehicle_steps": count * steps,
        "host_to_host_s": best_s(lambda: roll_out_many(spec, path, lane, start)),
        "on_device_s": there_s,
        "bytes": held,
    }
    return figures, {"pose": np.stack([final.x_m, final.y_m]), "rms_m": np.asarray(metrics.rms_m)}


def drive(files: list[Path]) -> tuple[dict[str, Any], dict[str, Any]]:
    """A drive registered by default, twice: the first time compiles."""
    road, live = files
    each_ms, taken_s = [], []
    for _ in range(2):
        with MapFile.open(road) as source, DriveLog.open(live) as log:
            begin = time.perf_counter()
            found = register_log(source, log, RegisterOptions())
            taken_s.append(time.perf_counter() - begin)
            each_ms.append(found.milliseconds_per_scan)
    figures = {"scans": len(found.table), "first_s": taken_s[0], "each_ms": each_ms[1]}
    return figures, {"code": found.table["code"].to_numpy(str), "pose": np.asarray(found.fix.pose)}


_PROBLEMS: dict[str, Callable[[list[Path]], tuple[dict[str, Any], dict[str, Any]]]] = {
    "registration": registration,
    "rollouts": rollouts,
    "drive": drive,
}


def best_s(action: Callable[[], Any]) -> float:
    """Least seconds of a few runs."""
    return min(seconds(action, _REPEATS))


def bandwidth() -> float:
    """Bytes a second that the device reads and writes when it copies an array much larger than its caches."""
    numbers = jnp.zeros(_COPIED[jax.default_backend()], jnp.float32)
    copy = jax.jit(lambda values: values + 1.0)
    return 2.0 * numbers.nbytes / best_s(lambda: jax.block_until_ready(copy(numbers)))


def main() -> None:
    """The program."""
    parser = argparse.ArgumentParser(prog="benchmarks.on_accelerator")
    parser.add_argument("out", type=Path)
    parser.add_argument("problem", choices=tuple(_PROBLEMS))
    parser.add_argument("results", type=Path)
    parser.add_argument("files", type=Path, nargs="+")
    parser.add_argument("--threads", type=int, required=True)
    chosen = parser.parse_args()
    hold_to(chosen.threads)
    figures, arrays = _PROBLEMS[chosen.problem](chosen.files)
    with chosen.results.open("wb") as file:
        np.savez(file, **arrays)
    device = jax.devices()[0]
    figures |= {"platform": device.platform, "device": device.device_kind, "bandwidth": bandwidth()}
    chosen.out.write_text(json.dumps(figures) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
