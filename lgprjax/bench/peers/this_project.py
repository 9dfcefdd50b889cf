"""This project: array columns, one product, Gauss-Newton; or, with ``--swarm``, its swarm about the coarse summits."""

import argparse
import os
from concurrent.futures import ThreadPoolExecutor
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from lgprjax.bench.hard_set import CHANNEL_LEFT_M, HEIGHT_REFERENCE_M, HardSet
from lgprjax.bench.peers.worker import Peer, arguments, work
from lgprjax.pso import SwarmConfig
from lgprjax.registration import ArrayColumns, Ends, MatchSpec, Rules, ScanSet, Thresholds, make_columns, match_scans
from lgprjax.subsurface import Tile, leading_components

CHUNK = 57  # half of a tile's scans at 3.5 cm
_HELD = 0.6
STARTS = 2


class Search:
    """The peer's state: tiles as given, columns of the maps prepared so far."""

    def __init__(self, hard_set: HardSet, spec: MatchSpec, stride: tuple[int, int], threads: int = 1) -> None:
        self.hard_set, self.spec, self.stride = hard_set, spec, stride
        self.pool = ThreadPoolExecutor(threads)
        self.basis = jnp.asarray(hard_set.basis, dtype=jnp.float32)
        self.omega = jnp.asarray(hard_set.omega, dtype=jnp.float32)
        sample = hard_set.ground.reshape(-1, hard_set.ground.shape[-1])[::97]
        self.components = jnp.asarray(leading_components(sample, _HELD))
        self.tiles = [_tile(hard_set, place) for place in range(len(hard_set.ground))]
        self.columns: dict[int, ArrayColumns] = {}
        self.offset_m = jnp.asarray(np.stack([np.zeros_like(CHANNEL_LEFT_M), CHANNEL_LEFT_M], 1), dtype=jnp.float32)
        width = np.append(hard_set.half_width, np.deg2rad(1.0))
        nothing = Thresholds(*(jnp.float32(value) for value in (0.0, 0.0, 0.0, 0.5)))
        free = jnp.asarray([True, True, True, True, True, False])
        self.rules = Rules(jnp.float32(0.25), free, nothing, jnp.uint32(0))
        self.ends = {count: _ends(hard_set, self.offset_m, width, count) for count in (1, CHUNK)}

    def prepare(self, place: int) -> None:
        """Columns of a map."""
        columns = make_columns(self.tiles[place], self.components, self.offset_m, stride=self.stride, margin=(1, 12))
        self.columns[place] = jax.block_until_ready(columns)

    def locate(self, place: int, scan: Float[np.ndarray, "channel sample"]) -> Float[np.ndarray, " 5"]:
        """Pose of one scan."""
        return np.asarray(self._found(place, scan[None], 1)[0])

    def locate_all(self, problems: Int[np.ndarray, " problem"]) -> Float[np.ndarray, "problem 5"]:
        """Poses in chunks, as many in flight as there are threads."""
        maps = self.hard_set.map_index[problems]
        chunks: list[Int[np.ndarray, " chunk"]] = []
        for place in np.unique(maps):
            rows = np.flatnonzero(maps == place)
            chunks += [rows[low : low + CHUNK] for low in range(0, len(rows), CHUNK)]

        def some(rows: Int[np.ndarray, " chunk"]) -> Float[np.ndarray, "chunk 5"]:
            full = problems[np.resize(rows, CHUNK)]
            return np.asarray(self._found(int(maps[rows[0]]), self.hard_set.scans[full], CHUNK))[: len(rows)]

        out = np.empty((len(problems), 5), np.float32)
        for rows, pose in zip(chunks, self.pool.map(some, chunks), strict=True):
            out[rows] = pose
        return out

    def _found(self, place: int, scans: Float[np.ndarray, "scan channel sample"], count: int) -> Array:
        pose: Array = _locate(
            scans,
            self.basis,
            self.columns[place],
            self.components,
            self.tiles[place],
            self.ends[count],
            self.rules,
            self.omega,
            spec=self.spec,
        )
        return pose


@partial(jax.jit, static_argnames="spec")
def _locate(
    scans: Float[Array, "scan channel sample"],
    basis: Float[Array, "sample coefficient"],
    columns: ArrayColumns,
    components: Float[Array, "coefficient component"],
    tile: Tile,
    ends: Ends,
    rules: Rules,
    omega: Float[Array, " half"],
    *,
    spec: MatchSpec,
) -> Float[Array, "scan 5"]:
    heard = scans @ basis
    still = jnp.zeros(heard.shape[:2], jnp.float32)
    fix = match_scans(
        columns,
        components,
        tile,
        ScanSet(heard, jnp.ones(heard.shape[:2], bool), still),
        ends,
        rules,
        jnp.float32(HEIGHT_REFERENCE_M),
        omega,
        spec=spec,
    )
    return jnp.asarray(fix.pose)


def _tile(hard_set: HardSet, place: int) -> Tile:
    ground = hard_set.ground[place]
    return Tile(
        coefficients=jnp.asarray(ground),
        power=jnp.asarray(np.sum(ground**2, axis=-1)),
        valid=jnp.ones(ground.shape[:2], bool),
        origin_m=jnp.asarray(hard_set.origin_m, dtype=jnp.float32),
        cell_m=jnp.asarray(hard_set.cell_m, dtype=jnp.float32),
    )


def _ends(hard_set: HardSet, offset_m: Array, width: Float[np.ndarray, " 6"], count: int) -> Ends:
    prior = np.append(hard_set.prior[0], 0.0)
    own = jnp.arange(count, dtype=jnp.int32)[:, None]
    return Ends(
        member=own,
        shift=jnp.zeros((count, 1, 2), jnp.int32),
        fine=own,
        offset_m=jnp.tile(offset_m[None], (count, 1, 1)),
        prior=jnp.asarray(np.tile(prior, (count, 1)), dtype=jnp.float32),
        half_width=jnp.asarray(np.tile(width, (count, 1)), dtype=jnp.float32),
        number=jnp.arange(count, dtype=jnp.uint32),
    )


def main() -> None:
    """The program."""
    parser = arguments("this_project", 0, 0)
    parser.add_argument("--stride", type=int, nargs=2, default=(3, 2), help="cells from coarse place to place")
    parser.add_argument("--swarm", type=int, nargs=2, metavar=("PARTICLES", "ITERATIONS"))
    chosen = parser.parse_args()
    # A thread a chunk, and each chunk's work where it is called: threads that share a chunk, or wait for another to
    # do it, cost more than they bring.
    os.environ["XLA_FLAGS"] = "--xla_cpu_multi_thread_eigen=false"
    jax.config.update("jax_cpu_enable_async_dispatch", False)
    work(chosen, lambda hard_set: build(hard_set, chosen))


def build(hard_set: HardSet, chosen: argparse.Namespace) -> Peer:
    """The peer on a hard set."""
    swarm = SwarmConfig(*chosen.swarm) if chosen.swarm else None
    # A swarm takes the better coarse summit's side itself: one start more would double its cost.
    spec = MatchSpec(summits=STARTS, swarm=swarm)
    search = Search(hard_set, spec, tuple(chosen.stride), chosen.threads)
    name = "columns, swarm {}x{}".format(*chosen.swarm) if chosen.swarm else "columns, Gauss-Newton"
    places = np.prod([-(-side // step) for side, step in zip(hard_set.ground.shape[1:3], chosen.stride, strict=True)])
    finish = STARTS * (swarm.particles * (swarm.iterations + 1) if swarm else 4)
    evaluations = spec.heights * int(places) + finish
    return Peer("this_project", name, evaluations, search.prepare, search.locate, search.locate_all)


if __name__ == "__main__":
    main()
