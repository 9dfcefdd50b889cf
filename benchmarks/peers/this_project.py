"""This project: scans as surfaces over prior errors, Gauss-Newton or (``--swarm``) its swarm from the best place."""

import argparse
import os
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int, Int8

from benchmarks.peers.worker import Peer, arguments, work
from benchmarks.registration import CHANNEL_LEFT_M, HEIGHT_REFERENCE_M, HardSet
from lgprjax.pso import SwarmConfig
from lgprjax.radar import LIGHT_SPEED_M_PER_NS
from lgprjax.registration import MIN_OVERLAP, ArrayColumns, Region, Template, finish_best, make_columns
from lgprjax.registration.coarse import Peaks, ScanBatch, WindowBatch, scan_surfaces, window_peaks
from lgprjax.subsurface import Tile, leading_components

CHUNK = 57  # half of a tile's scans at 3.5 cm
CHUNK_ON_ACCELERATOR = 2048
_HELD = 0.6
_APART_M = 0.25
_DECOYS = 384
_FINISH = 4
"""Scores that the climb from a place to its peak takes."""


class Space(NamedTuple):
    """The space of prior errors that a chunk of scans is searched in.

    Attributes:
        at_m: along and cross of the lattice's first point.
        step_m: of the lattice, the same both ways.
        heights_m: tried at every place.
        decoys_m: from the lattice's first point: places beyond the region.
        centre: lattice point of the prior.
        half_m: half side of the region.
        offset_m: of the channels.
        region: of the finish.
    """

    at_m: Float[Array, "2"]
    step_m: Float[Array, ""]
    heights_m: Float[Array, " height"]
    decoys_m: Float[Array, "decoy 2"]
    centre: Float[Array, "2"]
    half_m: Float[Array, ""]
    offset_m: Float[Array, "channel 2"]
    region: Region


class Search:
    """The peer's state: tiles as given, columns of the maps prepared so far."""

    def __init__(
        self, hard_set: HardSet, stride: tuple[int, int], threads: int = 1, swarm: SwarmConfig | None = None
    ) -> None:
        self.hard_set, self.stride, self.swarm = hard_set, stride, swarm
        self.pool = ThreadPoolExecutor(threads)
        self.chunk = CHUNK if jax.default_backend() == "cpu" else CHUNK_ON_ACCELERATOR
        self.scans = hard_set.scans.astype(np.int8)  # as the radar gives them
        self.basis = jnp.asarray(hard_set.basis, dtype=jnp.float32)
        self.omega = jnp.asarray(hard_set.omega, dtype=jnp.float32)
        sample = hard_set.ground.reshape(-1, hard_set.ground.shape[-1])[::97]
        self.components = jnp.asarray(leading_components(sample, _HELD))
        self.tiles = [_tile(hard_set, place) for place in range(len(hard_set.ground))]
        self.columns: dict[int, ArrayColumns] = {}
        step_m = float(np.min(hard_set.cell_m * np.array(stride)))
        self.points = 2 * int(np.ceil(float(np.max(hard_set.half_width[:2])) / step_m)) + 1
        self.spaces = {count: _space(hard_set, step_m, self.points, count) for count in (1, self.chunk)}

    @property
    def places(self) -> int:
        """Poses that are scored before the finish."""
        return self.points**2 * len(self.spaces[1].heights_m)

    def prepare(self, place: int) -> None:
        """Columns of a map."""
        offset_m = self.spaces[1].offset_m
        columns = make_columns(self.tiles[place], self.components, offset_m, stride=self.stride, margin=(1, 12))
        self.columns[place] = jax.block_until_ready(columns)

    def locate(self, place: int, scan: Float[np.ndarray, "channel sample"]) -> Float[np.ndarray, " 5"]:
        """Pose of one scan."""
        return np.asarray(self.found(place, scan[None].astype(np.int8), 1)[0])

    def locate_all(self, problems: Int[np.ndarray, " problem"]) -> Float[np.ndarray, "problem 5"]:
        """Poses in chunks, as many in flight as there are threads."""
        maps = self.hard_set.map_index[problems]
        chunks: list[Int[np.ndarray, " chunk"]] = []
        for place in np.unique(maps):
            rows = np.flatnonzero(maps == place)
            chunks += [rows[low : low + self.chunk] for low in range(0, len(rows), self.chunk)]

        def some(rows: Int[np.ndarray, " chunk"]) -> Float[np.ndarray, "chunk 5"]:
            full = problems[np.resize(rows, self.chunk)]
            return np.asarray(self.found(int(maps[rows[0]]), self.scans[full], self.chunk))[: len(rows)]

        out = np.empty((len(problems), 5), np.float32)
        for rows, pose in zip(chunks, self.pool.map(some, chunks), strict=True):
            out[rows] = pose
        return out

    def found(self, place: int, scans: Int8[np.ndarray | Array, "scan channel sample"], count: int) -> Array:
        """Poses of a chunk, or of one scan."""
        pose: Array = _locate(
            scans,
            self.basis,
            self.columns[place],
            self.components,
            self.tiles[place],
            self.spaces[count],
            self.omega,
            points=self.points,
            swarm=self.swarm,
        )
        return pose


@partial(jax.jit, static_argnames=("points", "swarm"))
def _locate(
    scans: Int8[Array, "scan channel sample"],
    basis: Float[Array, "sample coefficient"],
    columns: ArrayColumns,
    components: Float[Array, "coefficient component"],
    tile: Tile,
    space: Space,
    omega: Float[Array, " half"],
    *,
    points: int,
    swarm: SwarmConfig | None,
) -> Float[Array, "scan 5"]:
    heard = scans.astype(jnp.float32) @ basis
    surfaces = surfaces_at(columns, components, heard, space, omega, points=points)
    return poses_from(tile, heard, peaks_in(surfaces, space), space, omega, swarm=swarm)


def surfaces_at(
    columns: ArrayColumns,
    components: Float[Array, "coefficient component"],
    heard: Float[Array, "scan channel coefficient"],
    space: Space,
    omega: Float[Array, " half"],
    *,
    points: int,
) -> tuple[Array, Array, Array]:
    """Surface, decoys and power of each scan."""
    count, channels = heard.shape[:2]
    batch = ScanBatch(
        heard,
        jnp.ones((count, channels), bool),
        jnp.zeros((count, channels), jnp.float32),
        jnp.broadcast_to(space.at_m, (count, 2)),
    )
    axes_m = space.step_m * jnp.eye(2, dtype=jnp.float32)
    found: tuple[Array, Array, Array] = scan_surfaces(
        columns, components, batch, axes_m, space.decoys_m, space.heights_m, omega, points=(points, points)
    )
    return found


def peaks_in(surfaces: tuple[Array, Array, Array], space: Space) -> Peaks:
    """Peaks of the scans, each by itself."""
    count = len(surfaces[0])
    centre, half_m = jnp.broadcast_to(space.centre, (count, 2)), jnp.broadcast_to(space.half_m, (count,))
    # No place is carried on from scan to scan: the one near it is asked for a single point.
    lattice, decoys, power = (field[:, None] for field in surfaces)
    windows = WindowBatch(lattice, decoys, power, jnp.ones((count, 1), jnp.int32), centre, half_m, centre, 0.0 * half_m)
    step_m = jnp.broadcast_to(space.step_m, (2,))
    peaks, _ = window_peaks(windows, step_m, jnp.float32(_APART_M), jnp.float32(MIN_OVERLAP), near=(1, 1))
    return Peaks(*peaks)


def poses_from(
    tile: Tile,
    heard: Float[Array, "scan channel coefficient"],
    peaks: Peaks,
    space: Space,
    omega: Float[Array, " half"],
    *,
    swarm: SwarmConfig | None,
) -> Float[Array, "scan 5"]:
    """Poses of the scans, climbed to from their best places."""
    count, channels = heard.shape[:2]
    everywhere = jnp.ones((count, channels), bool)
    one_scan = jnp.zeros((count, channels), jnp.int32)
    template = Template(heard, jnp.broadcast_to(space.offset_m, (count, channels, 2)), everywhere, one_scan)
    place_m = space.at_m[None] + peaks.point[:, 0] * space.step_m
    prior = space.region.prior
    height_m = prior[:, 2] + space.heights_m[peaks.height[:, 0]]
    start = jnp.concatenate([place_m, height_m[:, None], prior[:, 3:]], axis=1)
    found = finish_best(
        tile,
        jnp.float32(HEIGHT_REFERENCE_M),
        omega,
        template,
        start,
        space.region,
        jnp.where(peaks.floor > 0.0, peaks.floor, peaks.region_floor)[:, 0],
        jnp.float32(MIN_OVERLAP),
        heading=True,
        pitch=False,
        swarm=swarm,
        seed=jnp.uint32(0),
    )
    return jnp.asarray(found.pose)


def _tile(hard_set: HardSet, place: int) -> Tile:
    ground = hard_set.ground[place]
    return Tile(
        coefficients=jnp.asarray(ground),
        power=jnp.asarray(np.sum(ground**2, axis=-1)),
        valid=jnp.ones(ground.shape[:2], bool),
        origin_m=jnp.asarray(hard_set.origin_m, dtype=jnp.float32),
        cell_m=jnp.asarray(hard_set.cell_m, dtype=jnp.float32),
    )


def _space(hard_set: HardSet, step_m: float, points: int, count: int) -> Space:
    half_width = hard_set.half_width
    prior = np.append(hard_set.prior[0], 0.0)
    # Half a step of height is a twentieth of a period at the centre of the band, as in a drive's search.
    period_ns = 2.0 * np.pi / float(np.mean(hard_set.omega))
    heights = int(np.ceil(half_width[2] / (LIGHT_SPEED_M_PER_NS * period_ns / 40.0)))
    heights_m = half_width[2] * (np.arange(heights) * (2.0 / heights) + (1.0 / heights - 1.0))
    corner = prior[:2] - (points // 2) * step_m
    rng = np.random.default_rng(0)
    # Ahead and behind of the region, as far to the sides as it is.
    ahead = rng.choice([-1.0, 1.0], _DECOYS) * (half_width[0] + rng.uniform(0.3, 3.0, _DECOYS))
    decoys_m = np.stack([ahead, rng.uniform(-1.0, 1.0, _DECOYS) * half_width[1]], axis=1) + prior[:2] - corner

    def single(value: Float[np.ndarray, "..."] | float) -> Array:
        return jnp.asarray(value, dtype=jnp.float32)

    return Space(
        at_m=single(corner),
        step_m=single(step_m),
        heights_m=single(heights_m),
        decoys_m=single(decoys_m),
        centre=jnp.full(2, points // 2, jnp.float32),
        half_m=single(float(np.max(half_width[:2]))),
        offset_m=single(np.stack([np.zeros_like(CHANNEL_LEFT_M), CHANNEL_LEFT_M], 1)),
        region=Region(
            single(np.tile(prior, (count, 1))),
            single(np.tile(np.append(half_width, np.deg2rad(1.0)), (count, 1))),
            jnp.arange(count, dtype=jnp.uint32),
        ),
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
    search = Search(hard_set, tuple(chosen.stride), chosen.threads, swarm)
    name = "surfaces, swarm {}x{}".format(*chosen.swarm) if chosen.swarm else "surfaces, Gauss-Newton"
    evaluations = search.places + (swarm.particles * (swarm.iterations + 1) if swarm else _FINISH)
    return Peer("this_project", name, evaluations, search.prepare, search.locate, search.locate_all)


if __name__ == "__main__":
    main()
