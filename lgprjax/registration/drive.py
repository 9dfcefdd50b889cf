"""A whole drive against a map: scans or windows, grouped by tile, in batches of one shape."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from lgprjax.radar import ArrayGeometry
from lgprjax.registration.fix import Code, Fix
from lgprjax.registration.integrity import Thresholds, default_thresholds
from lgprjax.registration.live import LiveChain, LiveScans, Track, templates_of, window_ends
from lgprjax.registration.search import Problem, Region, SearchSpec, register_batch, score_truth
from lgprjax.subsurface import GroundMap, StationSource

BLOCK_SCANS = 512
_PRODUCTS = 16_000_000  # traces x cells of one batch: 64 MB of float32


@dataclass(frozen=True)
class RegisterOptions:
    """What a user decides about a registration.

    Attributes:
        search_m: half side of the search square about the prior.
        window_m: length of the window of scans that is matched as one; 0 for single scans.
        height_m, roll_deg: half widths of the search in height and roll. That in heading follows the prior:
            three sigma, no less than one degree and no more than five.
        time_scale: how much longer the wave's way in the ground takes today than on the map's day (rain: above 1).
        own_thresholds: what a fix must reach; without them the defaults for scans or windows.
        seed: of the swarm.
    """

    search_m: float = 1.5
    window_m: float = 0.0
    height_m: float = 0.08
    roll_deg: float = 1.5
    time_scale: float = 1.0
    own_thresholds: Thresholds | None = None
    seed: int = 0

    @property
    def thresholds(self) -> Thresholds:
        """What a fix must reach."""
        if self.own_thresholds is not None:
            return self.own_thresholds
        return default_thresholds(self.window_m)


class LiveBlock(NamedTuple):
    """Consecutive scans of a drive.

    Attributes:
        traces: as recorded, in whatever numbers the drive's operator takes.
        valid: channels that hold data.
        track: of the scans.
        truth: true poses of the array's centre where they are known, to score them beside the fixes.
    """

    traces: Float[np.ndarray, "scan channel recorded"]
    valid: Bool[np.ndarray, "scan channel"]
    track: Track
    truth: Float[np.ndarray, "scan 5"] | None = None


class DriveFixes(NamedTuple):
    """Fixes of consecutive scans, poses and covariances in the map's frame (see ``Fix``).

    Attributes:
        scan: numbers in the drive.
        fix: of each.
        correlation_at_truth: what the score says at the true pose: how hard the ground is. NaN where no truth
            is known or the scan was not tried.
    """

    scan: Int[np.ndarray, " scan"]
    fix: Fix
    correlation_at_truth: Float[np.ndarray, " scan"]


def ground_map_for(source: StationSource, options: RegisterOptions) -> GroundMap:
    """Tiles large enough for the search, the window and the way to the nearest tile frame."""
    description = source.description
    way_m = 0.5 * description.tile_spacing_m
    array_m = 0.5 * description.channels * description.channel_pitch_m
    return GroundMap(
        source,
        half_along_m=options.search_m + options.window_m + way_m + array_m,
        half_cross_m=options.search_m + options.window_m + way_m + array_m,
    )


def live_chain(
    ground: GroundMap, operator: Float[Array, "recorded sample"], channels: int, window_m: float
) -> LiveChain:
    """The chain that brings recorded scans to this map's coefficients.

    Args:
        ground: the map.
        operator: recorded numbers of a trace to profile samples, for the map's settings and as many samples.
        channels: of the drive.
        window_m: longest window that will be asked for.
    """
    return LiveChain(
        operator,
        ground.basis,
        track_filter_m=ground.description.settings.track_filter_m,
        channels=channels,
        history_m=window_m + 1.0,
    )


def register_drive(
    ground: GroundMap,
    operator: Float[Array, "recorded sample"],
    array: ArrayGeometry,
    blocks: Iterable[LiveBlock],
    options: RegisterOptions,
) -> Iterator[DriveFixes]:
    """Fixes of every scan, block by block; memory does not grow with the drive.

    A scan without a fix of its own (inside a window) has code ``no_window``. A fix depends on its scan or window,
    what the track filter saw before, its prior and the map: neither block nor batch changes it.

    Args:
        ground: from ``ground_map_for`` with the same options.
        operator: recorded numbers of a trace to profile samples, for the map's settings and as many samples.
        array: geometry of the drive.
        blocks: its scans in order, at most ``BLOCK_SCANS`` each.
        options: the search.
    """
    chain = live_chain(ground, operator, len(array.x_m), options.window_m)
    start_m: float | None = None
    for block in blocks:
        scans, first = chain.feed(block.traces, block.valid, block.track, BLOCK_SCANS)
        start_m = float(scans.path_m[first]) if start_m is None else start_m
        if options.window_m > 0.0:
            ends = window_ends(scans, first, options.window_m, start_m)
        else:
            ends = np.arange(first, len(scans.number))
        fixes = _blank(len(scans.number) - first)
        fixes.code[ends - first] = Code.OFF_MAP
        at_truth = np.full(len(fixes.code), np.nan)
        for tile, at in _by_tile(ground, scans, ends, options):
            truth = None if block.truth is None else block.truth[at - first]
            found, scored = _register_at(ground, tile, scans, at, truth, array, options)
            for whole, part in zip(fixes, found, strict=True):
                whole[at - first] = part
            at_truth[at - first] = scored
        yield DriveFixes(scans.number[first:], fixes, at_truth)


def _blank(scans: int) -> Fix:
    def empty(*shape: int) -> Float[np.ndarray, "..."]:
        return np.full((scans, *shape), np.nan, np.float64)

    return Fix(
        pose=empty(5),
        covariance=empty(5, 5),
        correlation=empty(),
        runner_up=empty(),
        margin=empty(),
        overlap_channels=np.zeros(scans, np.int32),
        overlap=np.zeros(scans, np.float32),
        evaluations=np.zeros(scans, np.int32),
        code=np.full(scans, Code.NO_WINDOW, np.int32),
    )


def _by_tile(
    ground: GroundMap, scans: LiveScans, ends: Int[np.ndarray, " end"], options: RegisterOptions
) -> list[tuple[int, Int[np.ndarray, " _"]]]:
    groups: dict[int, list[int]] = {}
    for end in ends:
        tile = ground.tile_near(scans.track.pose[end, :2], options.search_m)
        if tile is not None:
            groups.setdefault(tile, []).append(int(end))
    return [(tile, np.asarray(at)) for tile, at in groups.items()]


def search_spec_for(ground: GroundMap, tile: int, array: ArrayGeometry, options: RegisterOptions) -> SearchSpec:
    """Shape of the search on a tile: the whole region as far as the grid goes."""
    spec, _ = ground.grid_of(tile)
    array_reach_m = float(np.hypot(np.ptp(array.x_m), np.ptp(array.y_m))) + 0.5
    cells_m = (spec.along_cell_m, spec.cross_cell_m)
    sizes = (spec.along_cells, spec.cross_cells)
    lattice = [min(2 * int(options.search_m / c) + 3, n) for c, n in zip(cells_m, sizes, strict=True)]
    margin = [int(np.ceil((options.window_m + array_reach_m) / c)) + 1 for c in cells_m]
    return SearchSpec(lattice=(lattice[0], lattice[1]), margin=(margin[0], margin[1]))


def _register_at(
    ground: GroundMap,
    tile: int,
    scans: LiveScans,
    at: Int[np.ndarray, " end"],
    truth: Float[np.ndarray, "end 5"] | None,
    array: ArrayGeometry,
    options: RegisterOptions,
) -> tuple[Fix, Float[np.ndarray, " end"]]:
    """Fixes of the templates that end at ``at``, all on one tile, and the correlations at the truth."""
    description = ground.description
    spec, _ = ground.grid_of(tile)
    search = search_spec_for(ground, tile, array, options)
    step_m = description.settings.step_m
    channels = len(array.x_m)
    traces = (1 + round(options.window_m / step_m)) * channels
    batch = max(1, min(32, 1 << int(np.log2(_PRODUCTS / (traces * spec.along_cells * spec.cross_cells) + 1))))
    region = Region(
        apart_m=jnp.float32(0.6 * description.settings.wavelength_m),
        # One channel sees no roll, and one trace no heading.
        free=jnp.asarray([True, True, True, traces > 1, channels > 1]),
    )
    frame = ground.frame(tile)
    height_reference_m = jnp.float32(ground.source.height_reference_m[tile])
    parts: list[Fix] = []
    scored = np.full(len(at), np.nan)
    for low in range(0, len(at), batch):
        chosen = at[low : low + batch]
        lanes = np.concatenate([chosen, np.full(batch - len(chosen), chosen[0])])
        template = templates_of(scans, lanes, array, window_m=options.window_m, step_m=step_m)
        fixes = register_batch(
            jax.random.key(options.seed),
            ground.tile(tile),
            Problem(
                template=template,
                prior=jnp.asarray(to_tile(scans.track.pose[lanes], frame), dtype=jnp.float32),
                half_width=jnp.asarray(_half_width(scans.track, lanes, options), dtype=jnp.float32),
                finite=jnp.mean(template.valid, axis=-1, dtype=jnp.float32) >= options.thresholds.overlap,
                number=jnp.asarray(scans.number[lanes], dtype=jnp.uint32),
            ),
            region,
            height_reference_m,
            ground.basis.angular_frequency_rad_per_ns,
            Thresholds(*(jnp.float32(value) for value in options.thresholds)),
            spec=search,
        )
        if truth is not None:
            true_pose = truth[np.minimum(np.arange(low, low + batch), len(at) - 1)]
            scored[low : low + batch] = score_truth(
                ground.tile(tile),
                template,
                jnp.asarray(to_tile(true_pose, frame), dtype=jnp.float32),
                height_reference_m,
                ground.basis.angular_frequency_rad_per_ns,
            )[: len(chosen)]
        parts.append(Fix(*(np.asarray(field)[: len(chosen)] for field in fixes)))
    return _to_map(Fix(*(np.concatenate(field) for field in zip(*parts, strict=True))), frame), scored


def _half_width(
    track: Track, lanes: Int[np.ndarray, " batch"], options: RegisterOptions
) -> Float[np.ndarray, "batch 5"]:
    yaw = np.clip(3.0 * track.sigma_yaw_rad[lanes], np.radians(1.0), np.radians(5.0))
    fixed = np.array([options.search_m, options.search_m, options.height_m, 0.0, np.radians(options.roll_deg)])
    out = np.tile(fixed, (len(lanes), 1))
    out[:, 3] = yaw
    return out


def to_tile(pose: Float[np.ndarray, "batch 5"], frame: Float[np.ndarray, "3"]) -> Float[np.ndarray, "batch 5"]:
    """Poses of the map's frame in that of a tile."""
    east, north, yaw = frame
    cos, sin = np.cos(yaw), np.sin(yaw)
    out = pose.copy()
    out[:, 0] = cos * (pose[:, 0] - east) + sin * (pose[:, 1] - north)
    out[:, 1] = cos * (pose[:, 1] - north) - sin * (pose[:, 0] - east)
    out[:, 3] = np.mod(pose[:, 3] - yaw + np.pi, 2 * np.pi) - np.pi
    return out


def _to_map(fix: Fix, frame: Float[np.ndarray, "3"]) -> Fix:
    east, north, yaw = frame
    cos, sin = np.cos(yaw), np.sin(yaw)
    turn = np.eye(5)
    turn[:2, :2] = [[cos, -sin], [sin, cos]]
    pose = np.asarray(fix.pose, dtype=np.float64) @ turn.T
    pose += np.array([east, north, 0.0, yaw, 0.0])
    return fix._replace(pose=pose, covariance=turn @ np.asarray(fix.covariance, dtype=np.float64) @ turn.T)
