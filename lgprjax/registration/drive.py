"""A whole drive against a map: scans or windows, grouped by tile, in batches of one shape."""

from collections.abc import Iterable, Iterator
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from lgprjax.radar import ArrayGeometry
from lgprjax.registration.batches import WindowLayout, to_tile
from lgprjax.registration.finish import Rules, rules_of
from lgprjax.registration.fix import Code, Fix
from lgprjax.registration.labels import covariance_beside_match, with_covariance
from lgprjax.registration.live import LiveChain, LiveScans, Operators, Track
from lgprjax.registration.match import match_scans, score_truth
from lgprjax.registration.options import RegisterOptions
from lgprjax.registration.prepared import Aspect, PreparedGround
from lgprjax.subsurface import GroundMap, StationSource

BLOCK_SCANS = 512
_PROBES = 4


class LiveBlock(NamedTuple):
    """Consecutive scans of a drive.

    Attributes:
        traces: as recorded, in whatever numbers the drive's operator takes.
        valid: channels that hold data.
        track: of the scans.
        truth: true poses of the array's centre where they are known, to score them beside the fixes.
        time_scale: of each scan, few different ones; None for 1.
    """

    traces: Float[np.ndarray, "scan channel recorded"]
    valid: Bool[np.ndarray, "scan channel"]
    track: Track
    truth: Float[np.ndarray, "scan 5"] | None = None
    time_scale: Float[np.ndarray, " scan"] | None = None


class DriveFixes(NamedTuple):
    """Fixes of consecutive scans, poses and covariances in the map's frame (see ``Fix``).

    Attributes:
        scan: numbers in the drive.
        fix: of each.
        correlation_at_truth: what the score says at the true pose: how hard the ground is. NaN where no truth
            is known or the scan was not tried.
        beside_match: part of the covariances of east and north that is not the match's: the map's own positions and
            the odometer's scale.
    """

    scan: Int[np.ndarray, " scan"]
    fix: Fix
    correlation_at_truth: Float[np.ndarray, " scan"]
    beside_match: Float[np.ndarray, "scan 2 2"]


def ground_map_for(source: StationSource, options: RegisterOptions, *, keep: int = 4) -> GroundMap:
    """Tiles large enough for the search, the window and the way to the nearest tile frame; ``keep`` are held."""
    description = source.description
    way_m = 0.5 * description.tile_spacing_m
    array_m = 0.5 * description.channels * description.channel_pitch_m
    return GroundMap(
        source,
        half_along_m=options.search_m + options.window_m + way_m + array_m,
        half_cross_m=options.search_m + options.window_m + way_m + array_m,
        keep=keep,
    )


def live_chain(ground: GroundMap, operators: Operators, channels: int, window_m: float) -> LiveChain:
    """The chain that brings recorded scans to this map's coefficients.

    Args:
        ground: the map.
        operators: recorded numbers of a trace to profile samples, for the map's settings and as many samples.
        channels: of the drive.
        window_m: longest window that will be asked for.
    """
    return LiveChain(
        operators,
        ground.basis,
        track_filter_m=ground.description.settings.track_filter_m,
        channels=channels,
        # The farthest scan of a window may stand half a step beyond it.
        history_m=window_m + 1.0 + ground.description.settings.step_m,
    )


def register_drive(
    ground: GroundMap,
    operators: Operators,
    array: ArrayGeometry,
    blocks: Iterable[LiveBlock],
    options: RegisterOptions,
    prepared: PreparedGround | None = None,
) -> Iterator[DriveFixes]:
    """Fixes of every scan, block by block; memory does not grow with the drive.

    With a window every scan has a fix that ends with it; the first scans, before a window is full, have code
    ``no_window``. A fix depends on its scan or window, what the track filter saw before, its prior and the map:
    neither block nor batch changes it.

    Args:
        ground: from ``ground_map_for`` with the same options.
        operators: recorded numbers of a trace to profile samples, for the map's settings and as many samples.
        array: geometry of the drive.
        blocks: its scans in order, at most ``BLOCK_SCANS`` each.
        options: the search.
        prepared: of ground and array, held from drive to drive; without it one of its own.
    """
    chain = live_chain(ground, operators, len(array.x_m), options.window_m)
    prepared = PreparedGround(ground, array) if prepared is None else prepared
    start_m: float | None = None
    for block in blocks:
        scans, first = chain.feed(block.traces, block.valid, block.track, BLOCK_SCANS, block.time_scale)
        start_m = float(scans.path_m[first]) if start_m is None else start_m
        ends = first + np.flatnonzero(scans.path_m[first:] - start_m + 1e-6 >= options.window_m)
        fixes = blank_fixes(len(scans.number) - first)
        fixes.code[ends - first] = Code.OFF_MAP
        at_truth, beside = np.full(len(fixes.code), np.nan), np.full((len(fixes.code), 2, 2), np.nan)
        for aspect, at in _by_aspect(prepared, scans, ends, options):
            truth = None if block.truth is None else block.truth[at - first]
            found, scored = register_at(prepared, aspect, scans, at, truth, options)
            beside[at - first] = covariance_beside_match(prepared, aspect, found, options)
            found = with_covariance(found, beside[at - first])
            for whole, part in zip(fixes, found, strict=True):
                whole[at - first] = part
            at_truth[at - first] = scored
        yield DriveFixes(scans.number[first:], fixes, at_truth, beside)


def probe_strengths(
    ground: GroundMap,
    operator: Float[Array, "recorded sample"],
    array: ArrayGeometry,
    blocks: Iterable[tuple[np.ndarray, np.ndarray, Track]],
    probes: Int[np.ndarray, " probe"],
    options: RegisterOptions,
) -> Float[np.ndarray, " probe"]:
    """Strength of the best match of the windows that end with some scans of a drive; 0 where there is none.

    Args:
        ground: from ``ground_map_for`` with the same options.
        operator: one matrix for the whole drive.
        array: geometry of the drive.
        blocks: recorded traces, valid channels and track, at most ``BLOCK_SCANS`` scans each.
        probes: rising numbers of the scans.
        options: the search.
    """
    chain = live_chain(ground, lambda _: operator, len(array.x_m), options.window_m)
    prepared = PreparedGround(ground, array)
    out = np.zeros(len(probes))
    for traces, valid, track in blocks:
        scans, first = chain.feed(traces, valid, track, BLOCK_SCANS)
        number = scans.number[first:]
        own = np.flatnonzero((probes >= number[0]) & (probes <= number[-1]))
        ends = first + probes[own] - int(number[0])
        for aspect, at in _by_aspect(prepared, scans, ends, options):
            fix, _ = register_at(prepared, aspect, scans, at, None, options, ends=_PROBES)
            strength = np.asarray(fix.correlation) * np.sqrt(np.asarray(fix.overlap))
            out[own[np.searchsorted(ends, at)]] = np.nan_to_num(strength)
    return out


def blank_fixes(scans: int) -> Fix:
    """Fixes of scans that have none of their own."""

    def empty(*shape: int) -> Float[np.ndarray, "..."]:
        return np.full((scans, *shape), np.nan, np.float64)

    return Fix(
        pose=empty(5),
        covariance=empty(5, 5),
        correlation=empty(),
        runner_up=empty(),
        margin=empty(),
        scatter=empty(),
        overlap_channels=np.zeros(scans, np.int32),
        overlap=np.zeros(scans, np.float32),
        evaluations=np.zeros(scans, np.int32),
        code=np.full(scans, Code.NO_WINDOW, np.int32),
    )


def _by_aspect(
    prepared: PreparedGround, scans: LiveScans, ends: Int[np.ndarray, " end"], options: RegisterOptions
) -> list[tuple[Aspect, Int[np.ndarray, " _"]]]:
    tiles = prepared.ground.tiles_near(scans.track.pose[ends, :2], options.search_m)
    at, tiles = ends[tiles >= 0], tiles[tiles >= 0]
    if not len(at):
        return []
    return [(aspect, at[which]) for aspect, which in prepared.aspects(tiles, scans.track, at)]


def register_at(
    prepared: PreparedGround,
    aspect: Aspect,
    scans: LiveScans,
    at: Int[np.ndarray, " end"],
    truth: Float[np.ndarray, "end 5"] | None,
    options: RegisterOptions,
    ends: int | None = None,
) -> tuple[Fix, Float[np.ndarray, " end"]]:
    """Fixes of the templates that end at ``at``, all of one aspect, and the correlations at the truth.

    ``ends`` is the number of templates a batch where that of the layout is too many.
    """
    ground = prepared.ground
    ready = prepared.at(aspect)
    frame = ground.frame(aspect.tile)
    height_reference_m = jnp.float32(ground.source.height_reference_m[aspect.tile])
    omega = ground.basis.angular_frequency_rad_per_ns
    layout = WindowLayout.of(prepared, options, ends)
    rules = rules_for(prepared, options)
    parts: list[Fix] = []
    scored: list[Float[np.ndarray, " end"]] = []
    for low, high in layout.chunks(scans, at):
        chosen = at[low:high]
        batch = layout.batch_of(prepared, scans, chosen, frame, float(height_reference_m), options)
        fixes = match_scans(
            ready.columns,
            ground.components,
            ready.tile,
            batch.scans,
            batch.ends,
            rules,
            height_reference_m,
            omega,
            spec=layout.spec,
        )
        if truth is not None:
            true_pose = truth[np.minimum(np.arange(low, low + layout.ends), len(at) - 1)]
            at_truth = score_truth(
                ready.tile,
                batch.scans,
                batch.ends,
                jnp.asarray(to_tile(true_pose, frame), dtype=jnp.float32),
                height_reference_m,
                omega,
            )
            scored.append(np.asarray(at_truth)[: high - low])
        parts.append(Fix(*(np.asarray(field)[: high - low] for field in fixes)))
    fix = fixes_to_map(Fix(*(np.concatenate(field) for field in zip(*parts, strict=True))), frame)
    return fix, np.concatenate(scored) if scored else np.full(len(at), np.nan)


def rules_for(prepared: PreparedGround, options: RegisterOptions) -> Rules:
    """What holds for every scan of a drive."""
    channels = len(prepared.array.x_m)
    traces = channels if options.window_m <= 0.0 else 2 * channels
    return rules_of(prepared.ground.description.settings.wavelength_m, channels, traces, options)


def fixes_to_map(fix: Fix, frame: Float[np.ndarray, "3"]) -> Fix:
    """Fixes of a tile's frame in that of the map."""
    east, north, yaw = frame
    cos, sin = np.cos(yaw), np.sin(yaw)
    turn = np.eye(5)
    turn[:2, :2] = [[cos, -sin], [sin, cos]]
    pose = np.asarray(fix.pose, dtype=np.float64) @ turn.T
    pose += np.array([east, north, 0.0, yaw, 0.0])
    return fix._replace(pose=pose, covariance=turn @ np.asarray(fix.covariance, dtype=np.float64) @ turn.T)
