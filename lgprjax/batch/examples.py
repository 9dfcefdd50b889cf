"""One fix of a drive, for display: strips of ground under the path, and the correlation around the prior."""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from lgprjax.batch.register import RegisteredDrive, live_blocks
from lgprjax.formats import DriveLog, MapFile
from lgprjax.radar import ArrayGeometry, CoefficientBasis
from lgprjax.recordings.drives import live_operators
from lgprjax.registration import (
    BLOCK_SCANS,
    RegisterOptions,
    Stops,
    SurfacePicture,
    SwarmView,
    Template,
    ground_map_for,
    ground_under,
    least_overlap,
    live_chain,
    rival_of,
    stops_of,
    survey_surface,
    templates_of,
    to_tile,
    watch_finish,
)
from lgprjax.registration.judge import independent_numbers
from lgprjax.subsurface import GroundMap, Tile

# The particle swarm of one fix, run again for display.


def swarm_about(
    ground: GroundMap,
    tile_number: int,
    array: ArrayGeometry,
    template: Template,
    prior: Float[np.ndarray, "5"],
    surface: SurfacePicture,
    drive: RegisteredDrive,
    options: RegisterOptions,
    scan: int,
) -> SwarmView | None:
    """The swarm of a scan, run again; ``None`` without a swarm in the options, or without a place.

    A searching swarm begins anywhere in the region; the drive's own regions were often smaller. A finishing swarm
    begins at the highest place of the scan's surface; the drive's own began at the peaks of its coarse stage, on the
    template bank, a few centimetres away at most.

    Args:
        ground: map.
        tile_number: number of the tile on which the scan was searched.
        array: array of the drive.
        template: single template, in a batch of one.
        prior: along_m, cross_m, height_m above ground, yaw_rad, roll_rad in the tile's frame.
        surface: correlation surface of the scan over the search region.
        drive: drive of the scan.
        options: options of the search.
        scan: number of the scan in the drive.
    """
    noise_floor = float(np.asarray(drive.fix.noise_floor)[scan])
    config = options.search_swarm or options.swarm
    if config is None or not np.isfinite(noise_floor) or not np.isfinite(surface.score).any():
        return None
    i, j = np.unravel_index(int(np.nanargmax(surface.score)), surface.score.shape)
    whole, anywhere = np.append(prior, 0.0), options.search_swarm is not None
    start = whole if anywhere else np.array([surface.along_m[i], surface.cross_m[j], *whole[2:]])
    half_m = options.search_half_m(drive.track.sigma_m)
    half_width = options.half_width(drive.track.sigma_yaw_rad[[scan]], half_m)[0]

    def single(values: Float[np.ndarray, "6"]) -> jnp.ndarray:
        return jnp.asarray(values, dtype=jnp.float32)

    tile: Tile = ground.tile(tile_number)
    view: SwarmView = watch_finish(
        tile,
        jnp.float32(ground.source.height_reference_m[tile_number]),
        ground.basis.angular_frequency_rad_per_ns,
        jnp.float32(least_overlap(array, ground.description.settings.wavelength_m)),
        Template(*(field[0] for field in template)),
        single(start),
        single(whole),
        single(half_width),
        independent_numbers(jnp.float32(noise_floor)),
        jnp.asarray([True, True, True, template.valid.shape[1] > 1, drive.fix.overlap_channels.max() > 1, False]),
        jnp.uint32(options.seed),
        jnp.uint32(scan),
        *([jnp.float32(half_m)] if anywhere else []),
        config=config,
    )
    return SwarmView(*(np.asarray(field, np.float64) for field in view))


_STRIP_M = 4.0
_BESIDE_M = 1.0


class GroundStrips(NamedTuple):
    """Gained samples of one channel under a path, each strip in units of its own RMS.

    Attributes:
        live, baseline, beside: samples of the drive, of the map there, and of the map a metre farther on.
        distance_m: travel of each trace.
        time_ns: two-way travel time of the samples.
        channel: number of the channel.
        beside_m: distance of ``beside`` farther along the track.
        lag_m: shift along the track at which live and map strips agree best.
    """

    live: Float[np.ndarray, "trace sample"]
    baseline: Float[np.ndarray, "trace sample"]
    beside: Float[np.ndarray, "trace sample"]
    distance_m: Float[np.ndarray, " trace"]
    time_ns: Float[np.ndarray, " sample"]
    channel: int
    beside_m: float
    lag_m: float


class FixExample(NamedTuple):
    """A fix for display, places along and across in the frame of the tile that it was searched on.

    Attributes:
        scan: number of the scan in the drive.
        strips: strips of the ground, live and in the map.
        surface: correlation over the search region, with the rest of the pose from the fix.
        prior_m, best_m, second_m, truth_m: start of the search, its result, the highest other peak of the surface, and
            the truth, if known.
        prior_sigma_m: standard deviation of the prior, east and north; 0 if the drive states none.
        frame: east_m, north_m, yaw_rad of the tile's frame in the map's.
        swarm: swarm of the fix, if the options have one.
    """

    scan: int
    strips: GroundStrips
    surface: SurfacePicture
    prior_m: Float[np.ndarray, "2"]
    prior_sigma_m: tuple[float, float]
    best_m: Float[np.ndarray, "2"]
    second_m: Float[np.ndarray, "2"] | None
    truth_m: Float[np.ndarray, "2"] | None
    frame: Float[np.ndarray, "3"]
    swarm: SwarmView | None


def example_scan(drive: RegisteredDrive) -> int | None:
    """The tried scan nearest to the middle of the drive whose fix is ok, by ground behind it where there is one, else
    any tried; None without one.
    """
    code = drive.table["code"].to_numpy()
    ok = code == "ok"
    for wanted in (
        ok & ~drive.carried_back,
        ok,
        (code != "no_window") & np.isfinite(drive.table["correlation"].to_numpy()),
    ):
        scans = np.flatnonzero(wanted)
        if len(scans):
            return int(scans[np.argmin(np.abs(scans - len(code) // 2))])
    return None


def fix_example(
    source: MapFile, log: DriveLog, drive: RegisteredDrive, options: RegisterOptions, scan: int
) -> FixExample | None:
    """Strips and surface of one fix; None without a tile nearby.

    The drive is read again from far enough before the scan for the background removal to have settled.
    """
    ground, search_m = ground_map_for(source, options), options.search_half_m(drive.track.sigma_m)
    tile_number = ground.tile_near(drive.track.pose[scan, :2], search_m)
    if tile_number is None:
        return None
    tile, frame = ground.tile(tile_number), ground.frame(tile_number)
    description = source.description
    array = log.description.array
    window_m = float(np.nan_to_num(drive.fix.window_m[scan]))
    reach_m = max(_STRIP_M, window_m)
    travel = drive.track.travel_m
    settled = np.flatnonzero(np.abs(travel - travel[scan]) < 2.0 * description.settings.track_filter_m + reach_m)
    operators = live_operators(source, log, drive.track, drive.alignment)
    chain = live_chain(ground, operators, array, int(operators(1.0).shape[0]))
    start, read = int(settled[0]), []
    for block in live_blocks(log, drive.track, None, start):
        scans = chain.feed(block.traces, block.valid, block.track, BLOCK_SCANS)
        read.append(stops_of(scans, np.arange(len(scans.number)), array, ground.basis))
        if start + int(scans.number[-1]) >= scan:
            break
    stops = Stops(*(np.concatenate(field) for field in zip(*read, strict=True)))
    near = np.flatnonzero(stops.path_m >= stops.path_m[scan - start] - reach_m - 1.0)
    stops = Stops(*(field[near] for field in stops))
    at = int(np.flatnonzero(stops.number == scan - start)[0])
    made = chain.coefficients(stops.filtered, stops.valid, float(drive.time_scale[scan]))
    stops = stops._replace(coefficients=made)
    step_m = description.settings.step_m
    template = _template_of(stops, array, at, window_m, step_m)
    prior = to_tile(drive.track.pose[[scan]], frame)[0]
    pose = to_tile(np.asarray(drive.fix.pose)[[scan]], frame)[0]
    surface = survey_surface(
        tile,
        template,
        pose,
        prior,
        search_m,
        ground.source.height_reference_m[tile_number],
        ground.basis.angular_frequency_rad_per_ns,
        least_overlap(array, description.settings.wavelength_m),
    )
    strip = max(_STRIP_M if log.channels > 1 else 0.0, window_m, 1.0)
    stripe = _template_of(stops, array, at, strip, step_m)
    channel = log.channels // 2
    offset = np.asarray(stripe.offset_m)[0].reshape(-1, log.channels, 2)[:, channel]
    live = np.asarray(stripe.coefficients)[0].reshape(len(offset), log.channels, -1)[:, channel]
    under, _ = ground_under(tile, _placed(offset, pose))
    ahead, _ = ground_under(tile, _placed(offset - np.array([_BESIDE_M, 0.0]), pose))
    # Templates count backward from the scan; strips forward.
    strips = GroundStrips(
        live=_levelled(_samples(live, ground.basis))[::-1],
        baseline=_levelled(_samples(under, ground.basis))[::-1],
        beside=_levelled(_samples(ahead, ground.basis))[::-1],
        distance_m=(travel[scan] + offset[:, 0])[::-1],
        time_ns=np.arange(len(description.gain)) * description.settings.sample_interval_ns,
        channel=channel,
        beside_m=_BESIDE_M,
        lag_m=_lag(live, tile, offset, pose),
    )
    truth = None if drive.truth is None else to_tile(drive.truth[[scan]], frame)[0][:2]
    return FixExample(
        scan=scan,
        strips=strips,
        surface=surface,
        prior_m=prior[:2],
        prior_sigma_m=_prior_sigma(log, scan),
        best_m=pose[:2],
        second_m=rival_of(surface, pose[:2], 0.6 * description.settings.wavelength_m),
        truth_m=truth,
        frame=frame,
        swarm=swarm_about(ground, tile_number, array, template, prior, surface, drive, options, scan),
    )


def _lag(
    live: Float[np.ndarray, "trace coefficient"],
    tile: Tile,
    offset_m: Float[np.ndarray, "trace 2"],
    pose: Float[np.ndarray, "5"],
) -> float:
    """Along-track shift, of at most 0.3 m, at which the strip correlates best with the map."""
    lags = np.arange(-0.3, 0.3001, 0.01)
    # All lags in one call: each call costs more than the lookups of its traces.
    shifted = offset_m[None] + np.stack([lags, np.zeros_like(lags)], axis=1)[:, None]
    under, covered = ground_under(tile, _placed(shifted.reshape(-1, 2), pose))
    under, covered = under.reshape(len(lags), *live.shape), covered.reshape(len(lags), -1)
    heard = np.sum(np.sum(live**2, axis=1) * covered, axis=1)
    power = heard * np.sum(under**2, axis=(1, 2))
    scores = np.sum(live * under, axis=(1, 2)) / np.sqrt(np.maximum(power, 1e-30))
    return float(lags[int(np.argmax(scores))])


def _prior_sigma(log: DriveLog, scan: int) -> tuple[float, float]:
    navigation = log.description.navigation
    sigmas = (navigation.sigma_east_m, navigation.sigma_north_m)
    time_s = log.scan_time_s[scan]
    known = [float(np.interp(time_s, navigation.time_s, s)) for s in sigmas if s is not None]
    return (known[0], known[1]) if len(known) == 2 else (0.0, 0.0)


def _template_of(stops: Stops, array: ArrayGeometry, at: int, window_m: float, step_m: float) -> Template:
    """The window of stops that ends at one, a step apart, as a batch of one."""
    wanted_m = stops.path_m[at] - np.arange(1 + int(window_m / step_m)) * step_m
    member = np.clip(np.searchsorted(stops.path_m, wanted_m - 1e-6), 0, at)[None]
    member[0, 0] = at
    return templates_of(stops, array, np.array([at]), member, np.ones(member.shape, bool))


def _placed(offset_m: Float[np.ndarray, "trace 2"], pose: Float[np.ndarray, "5"]) -> Float[np.ndarray, "trace 2"]:
    cos, sin = np.cos(pose[3]), np.sin(pose[3])
    turn = np.array([[cos, sin], [-sin, cos]])
    return np.asarray(offset_m @ turn + pose[:2])


def _levelled(samples: Float[np.ndarray, "trace sample"]) -> Float[np.ndarray, "trace sample"]:
    """A drive is in counts of its receiver, a map in units of its drive's RMS: correlation depends on neither."""
    return np.asarray(samples / max(float(np.sqrt(np.mean(samples**2))), 1e-30))


def _samples(
    coefficients: Float[np.ndarray, "trace coefficient"], basis: CoefficientBasis
) -> Float[np.ndarray, "trace sample"]:
    return np.asarray(coefficients @ np.asarray(basis.matrix).T)
