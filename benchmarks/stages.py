"""Where the time of a scan goes, and the least that it could take; a program (``python -m benchmarks.stages``).

One scan, or one chunk of scans: a batch's chunks run side by side, each on a thread of its own. The stages are timed
each by itself; what the whole takes beyond them is the finish and the call. The floor is that of the two
large products: their operations at the speed of a large matrix product on this machine, and the bytes of the columns
at the speed of reading memory.
"""

import argparse
import json
import time
from collections.abc import Callable
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from benchmarks.peers.this_project import Search, peaks_in, surfaces_at
from benchmarks.process import hold_to
from benchmarks.registration import CHANNELS, SAMPLES, load_hard_set
from lgprjax.registration.coarse import Peaks

_STRIDE = (3, 2)
_REPEATS = 40
_GEMM = 1024
_MEMORY_MB = 256


def profile(search: Search, count: int) -> dict[str, float]:
    """Milliseconds a scan of the stages of ``count`` scans on the first map, of the whole, and of the floor."""
    own = np.resize(np.flatnonzero(search.hard_set.map_index == 0), count)
    search.prepare(0)
    columns, space = search.columns[0], search.spaces[count]
    scans = search.hard_set.scans[own]

    @jax.jit
    def convert(samples: Array) -> Array:
        return jnp.asarray(samples @ search.basis)

    @jax.jit
    def surfaces(heard: Array) -> tuple[Array, Array, Array]:
        return surfaces_at(columns, search.components, heard, space, search.omega, points=search.points)

    @jax.jit
    def peaks(found: tuple[Array, Array, Array]) -> Peaks:
        return peaks_in(found, space)

    heard = convert(scans)
    found = surfaces(heard)

    def whole() -> object:
        return search.locate(0, scans[0]) if count == 1 else search.locate_all(own)

    taken = {
        "samples to coefficients": _best_s(lambda: convert(scans)),
        "products and surfaces": _best_s(lambda: surfaces(heard)),
        "peaks": _best_s(lambda: peaks(found)),
    }
    all_s = _best_s(whole)
    taken["finish, call"] = all_s - sum(taken.values())
    taken["whole"] = all_s
    size, along, cross = columns.value.shape
    heights = len(space.heights_m)
    operations = 2.0 * CHANNELS * SAMPLES * search.basis.shape[1] + 2.0 * heights * size * along * cross
    taken["floor from operations"] = count * operations / _operations_per_s()
    taken["floor from bytes"] = 4.0 * columns.value.size / _bytes_per_s()
    return {stage: 1e3 * seconds / count for stage, seconds in taken.items()}


def _best_s(work: Callable[[], object]) -> float:
    jax.block_until_ready(work())
    best = np.inf
    for _ in range(_REPEATS):
        start = time.perf_counter()
        jax.block_until_ready(work())
        best = min(best, time.perf_counter() - start)
    return float(best)


def _operations_per_s() -> float:
    """Of a large product, in the library that the stages use."""
    square = jnp.asarray(np.random.default_rng(0).standard_normal((_GEMM, _GEMM)), dtype=jnp.float32)
    product = jax.jit(lambda left: left @ left)
    return 2.0 * _GEMM**3 / _best_s(lambda: product(square))


def _bytes_per_s() -> float:
    """Of reading memory once, beyond every cache."""
    values = jnp.ones((_MEMORY_MB << 20) // 4, jnp.float32)
    total = jax.jit(jnp.sum)
    return values.size * 4.0 / _best_s(lambda: total(values))


def main() -> None:
    """The program."""
    parser = argparse.ArgumentParser(prog="benchmarks.stages")
    parser.add_argument("out", type=Path)
    parser.add_argument("hard_set", type=Path)
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--batch", action="store_true", help="a chunk of scans instead of one")
    chosen = parser.parse_args()
    hold_to(chosen.threads)
    search = Search(load_hard_set(chosen.hard_set), _STRIDE, chosen.threads)
    figures = profile(search, search.chunk if chosen.batch else 1)
    chosen.out.write_text(json.dumps(figures) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
