"""Register a drive log against a map, streaming, and write its fixes."""

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path
from typing import NamedTuple

import jax
import numpy as np
import pandas as pd
from jaxtyping import Bool, Float
from scipy.special import chdtrc

from lgprjax import __version__
from lgprjax.batch.assumptions import away_in_words, is_baseline, is_place_assumed
from lgprjax.batch.chance import chance_of
from lgprjax.batch.foreign import likelihood_of
from lgprjax.batch.on_board import Agreement, agreement, on_board_of, placed, searches_of
from lgprjax.errors import ArgumentError
from lgprjax.files import file_hash
from lgprjax.formats import DriveLog, MapFile, TraceRecording, assumed_of, write_fixes
from lgprjax.frames import LocalFrame, along_cross
from lgprjax.machine import compile_clock
from lgprjax.pso import SwarmConfig
from lgprjax.radar import ArrayGeometry, uniform_array
from lgprjax.recordings.drives import (
    AS_STATED,
    Alignment,
    DriveTrack,
    live_operators,
    poses_of,
    recording_of,
    scaled_travel,
    track_of_drive,
    travel_line,
    travel_scale,
)
from lgprjax.registration import (
    BLOCK_SCANS,
    PIECE_M,
    Code,
    DriveFixes,
    EvidenceSearch,
    Fix,
    LiveBlock,
    LiveScans,
    PreparedGround,
    RegisterOptions,
    Registration,
    Thresholds,
    Track,
    carry_back,
    ground_map_for,
    live_chain,
    log_p_foreign,
    register_drive,
    sigmas_along_cross,
)
from lgprjax.registration.bayes import Likelihood
from lgprjax.registration.bayes.smoothed import smooth_drive
from lgprjax.registration.queries import SearchSizes
from lgprjax.subsurface import GroundMap

# A map's ground cached between drives: drives on one road use the same tiles.

_BANKS = 3  # template banks for each tile held
_ROOM_M = 0.5  # by which a lattice extends beyond the region on each side, so that priors may move


class HeldGround:
    """Tiles of a map for one search, its chance, and the template banks of the last array.

    Args:
        source: the map; must stay open.
        options: the search.
        tiles: held in memory, and three times as many template banks: a bend has several headings in one tile.
    """

    def __init__(self, source: MapFile, options: RegisterOptions, *, tiles: int = 8) -> None:
        self.ground = ground_map_for(source, options, keep=tiles)
        self.chance = chance_of(source)
        self._tiles = tiles
        self._prepared: PreparedGround | None = None
        self._options = options
        self._likelihoods: dict[int, Likelihood] = {}

    def prepared_for(self, array: ArrayGeometry) -> PreparedGround:
        """Template banks for an array: the cached ones, or empty ones for a new array."""
        if self._prepared is None or not _alike(self._prepared.array, array):
            self._prepared = PreparedGround(self.ground, array, keep=_BANKS * self._tiles)
        return self._prepared

    def likelihood_for(self, array: ArrayGeometry, source: MapFile) -> Likelihood:
        """Scores of foreign ground for an array's number of channels, measured once."""
        channels = len(array.x_m)
        if channels not in self._likelihoods:
            self._likelihoods[channels] = likelihood_of(source, self.ground, array, self._options)
        return self._likelihoods[channels]


_MOST_POINTS = 400
"""Largest number of lattice points to a side; memory and time grow with the square."""


_NUMBERS = ["search_m", "window_m", "risk", "time_scale", "height_m", "roll_deg", "pitch_deg", "odometer_sigma", "seed"]
"""Options of a search that are numbers, or nothing."""


def check_search(options: RegisterOptions) -> None:
    """Refuse a length, a scale or a risk that no search can have. Raises ``ArgumentError``."""
    for name, kind in (("swarm", SwarmConfig), ("search_swarm", SwarmConfig), ("own_thresholds", Thresholds)):
        if not isinstance(getattr(options, name), kind | None):
            raise ArgumentError(name, kind.__name__, repr(getattr(options, name))[:60])
    for name in _NUMBERS:
        value = getattr(options, name)
        if isinstance(value, bool) or not isinstance(value, int | float | np.number | None):
            raise ArgumentError(name, "a number", repr(value)[:60])
    lengths = (
        ("search_m", options.search_m, 1e-3, "a length in metres, above zero"),
        ("window_m", options.window_m, 0.0, "a length in metres, or 0 for single scans"),
    )
    for name, value, least, expected in lengths:
        if value is not None and not (np.isfinite(value) and least <= value <= 1e4):
            expected = "a length in metres, up to 10000" if value > 1e4 else expected
            raise ArgumentError(name, expected, f"{value:g}")
    bounds = (
        ("height_m", options.height_m, 1e-3, 5.0, "a half width in metres"),
        ("roll_deg", options.roll_deg, 1e-2, 45.0, "a half width in degrees"),
        ("pitch_deg", options.pitch_deg, 0.0, 45.0, "a half width in degrees"),
        ("odometer_sigma", options.odometer_sigma, 0.0, 0.5, "a fraction of the travelled distance"),
        ("seed", options.seed, 0, 2**31 - 1, "a whole number"),
    )
    for name, value, least, most, what in bounds:
        if value is None or not least <= value <= most or (name == "seed" and value != int(value)):
            raise ArgumentError(name, f"{what}, {least:g} to {most:g}", f"{value}")
    if options.time_scale is not None and not 0.5 <= options.time_scale <= 2.0:
        raise ArgumentError("time_scale", "auto, or a factor of 0.5 to 2, such as 1.05", f"{options.time_scale:g}")
    if options.filter not in (None, "causal", "smoothed"):
        raise ArgumentError("filter", "causal, smoothed or None", repr(options.filter)[:60])
    windowed = (options.window_m, options.own_thresholds, options.swarm, options.search_swarm)
    if options.filter is not None and any(each is not None for each in windowed):
        raise ArgumentError("filter", "no window, thresholds or swarm beside it", options.filter)
    if options.filter == "smoothed" and options.track:
        raise ArgumentError("filter", "causal with track: a vehicle does not know what lies ahead", "smoothed")
    if options.risk is None or not 1e-9 <= options.risk <= 0.01:
        raise ArgumentError("risk", "a probability of 1e-9 to 0.01, such as 1e-4", f"{options.risk}")


def check_region(search_m: float | None, source: MapFile) -> None:
    """Refuse a region no wider than a match itself, which leaves no room for rivals that a fix is measured by, and one
    whose lattice does not fit into memory. Raises ``ArgumentError``."""
    if search_m is None:
        return
    least_m = 0.9 * source.description.settings.wavelength_m
    if search_m < least_m:
        raise ArgumentError("search_m", f"{least_m:.2g} or more on this map", f"{search_m:g}")
    points = _lattice_points(source, search_m)
    if points > _MOST_POINTS:
        most_m = search_m * _MOST_POINTS / points
        expected = f"at most about {most_m:.2g} on this map, {_MOST_POINTS} lattice points to a side"
        raise ArgumentError("search_m", expected, f"{search_m:g}, {points} points")


def _lattice_points(source: MapFile, search_m: float) -> int:
    """Points along the longer side of the search lattice on a map, for a search square of this half side."""
    description, options = source.description, RegisterOptions()
    array = uniform_array(description.channels, description.channel_pitch_m)
    return max(
        SearchSizes.of(PreparedGround(ground_map_for(source, options), array), options).points(search_m + _ROOM_M)
    )


def _alike(one: ArrayGeometry, other: ArrayGeometry) -> bool:
    return all(np.array_equal(np.asarray(a), np.asarray(b)) for a, b in zip(one, other, strict=True))


# Fixes of a drive as a table for users: WGS-84 positions, sigmas along and across the heading.


def fixes_table(fix: Fix, time_s: Float[np.ndarray, " scan"], frame: LocalFrame, ground: GroundMap) -> pd.DataFrame:
    """The columns of the fixes CSV except the time scale: WGS-84 positions, sigmas along and across the heading."""
    pose = np.asarray(fix.pose)
    found = np.isfinite(pose[:, 0])
    # Fixes may be metres from a station; the height of the ground is that of the nearest one.
    up = np.zeros(len(pose))
    up[found] = np.nan_to_num(ground.ground_up_at(pose[found, :2]))
    latitude, longitude, height = frame.to_geodetic(
        np.where(found, pose[:, 0], 0.0), np.where(found, pose[:, 1], 0.0), np.where(found, up + pose[:, 2], 0.0)
    )
    blank = np.where(found, 1.0, np.nan)
    along, cross = sigmas_along_cross(np.asarray(fix.covariance), pose[:, 3])
    return pd.DataFrame(
        {
            "scan": np.arange(len(time_s)),
            "time_s": time_s,
            "latitude_deg": latitude * blank,
            "longitude_deg": longitude * blank,
            "height_m": height * blank,
            "heading_deg": frame.heading_of_yaw(pose[:, 3], longitude),
            "roll_deg": np.degrees(pose[:, 4]),
            "sigma_along_m": along,
            "sigma_cross_m": cross,
            "correlation": fix.correlation,
            "margin": fix.margin,
            "overlap_channels": fix.overlap_channels,
            "code": [Code(int(code)).label for code in fix.code],
            "p_false": fix.p_false,
            "window_m": fix.window_m,
        }
    )


# Polarity, time zero, gain and direction of a survey line relative to a map, found from the match itself.
#
# Antennas of hand-drawn radars get turned around, recorders are set up anew every morning, and a line's start is noted
# by hand. Against a map of another day or instrument such a drive scores zero, or less. A few stretches of it are
# matched with each of a few hypotheses; wrong ones score like foreign ground, so that the combined probability of all
# pieces (Fisher's method) identifies the right one, if there is one.

_STRETCHES, _STRETCH_M = 3, 16.0
_SHIFT_PERIODS = 0.2
"""Step between hypotheses of the time zero; a match is wider."""
_FARTHEST = 8
_SHARE = 0.01
"""Share of the risk allowed for a hypothesis caused by foreign ground."""
_MAIN_LOBE = 3.0
"""Lead of the best sign and direction over the others, from which no other time zeros are tried."""
_ALIKE = 0.8
_CLEAR = 1.4
"""Lead of the best hypothesis over any that is not its neighbour. A wave of a narrow band half a period off, with the
other sign, has up to two thirds of the evidence of the true one."""


class _Evidence(NamedTuple):
    """Combined evidence of a drive's pieces: Fisher's chi-square, its probability, number of usable ``pieces``."""

    total: float
    chance: float
    pieces: int


def may_be_misaligned(log: DriveLog) -> bool:
    """Whether a drive was imported from survey lines, whose headers are filled in by hand."""
    return "lines" in log.description.provenance and isinstance(log.description.recording, TraceRecording)


def reversed_track(track: Track) -> Track:
    """The same way from its other end, as driven by a reversing vehicle: antennas keep their sides.

    Travel is the odometer's, in the order of time. A scan is as far from the other end as it was thought to be from the
    first one, whatever the speeds.
    """
    way_m = np.maximum.accumulate(np.asarray(track.travel_m, np.float64))
    at_m = way_m[-1] - (way_m - way_m[0])

    def there(values: Float[np.ndarray, " scan"]) -> Float[np.ndarray, " scan"]:
        return np.asarray(np.interp(at_m, way_m, values))

    pose = np.array(track.pose, np.float64)
    pose[:, 3] = np.unwrap(pose[:, 3])
    return track._replace(
        pose=np.stack([there(column) for column in pose.T], axis=1),
        travel_m=-track.travel_m,
        speed_mps=-track.speed_mps,
        sigma_m=there(track.sigma_m),
        sigma_yaw_rad=there(track.sigma_yaw_rad),
    )


def find_alignment(
    source: MapFile, log: DriveLog, track: Track, options: RegisterOptions, held: HeldGround
) -> Alignment:
    """The hypothesis that agrees with the drive's ground, if there is one; else ``AS_STATED``.

    The stated values need no evidence. Another hypothesis is accepted only if foreign ground would hardly ever lead to
    it, and this probability, over all hypotheses tried, is added to that of its fixes.

    Args:
        source: map.
        log: log of a drive of traces.
        track: track of the drive in the map's frame.
        options: options of the search.
        held: ground of the map.
    """
    settings = source.description.settings
    period_ns = 2e9 / (settings.band_low_hz + settings.band_high_hz)
    search = replace(options, time_scale=1.0, window_m=None, own_thresholds=None)

    def evidence(alignment: Alignment) -> _Evidence:
        return _evidence(source, log, track, search, held, alignment)

    assumed = log.description.provenance.get("assumed")
    either = (False, True) if isinstance(assumed, dict) and "direction" in assumed else (False,)
    found: dict[Alignment, _Evidence] = {}

    def look(levels: Sequence[bool], steps: Sequence[int]) -> Alignment:
        """Try more hypotheses and return the best so far."""
        for sign, levelled, step, back in product((1, -1), levels, steps, either):
            alignment = Alignment(sign, step * _SHIFT_PERIODS * period_ns, levelled, back)
            if alignment not in found:
                found[alignment] = evidence(alignment)
        return max(found, key=lambda key: found[key].total)

    best = look((False,), (0,))
    if found[best].pieces == 0:
        return AS_STATED
    # A wave resembles itself a period later, and with the other sign half a period later. At its true delay it has one
    # sign and scores highest; where that is not evident, every time zero is tried.
    plain = found[best].total >= _MAIN_LOBE * max(each.total for key, each in found.items() if key != best)
    for sign, periods in product((1, -1), (-1.0, -0.5, 0.5, 1.0)) if plain else ():
        beside = best._replace(sign=sign * best.sign, later_ns=periods * period_ns)
        found[beside] = evidence(beside)
        plain &= found[beside].total < found[best].total
    if not plain:
        best = look((False,), range(-_FARTHEST, _FARTHEST + 1))
    if found[best].chance * len(found) > _SHARE * options.risk:
        best = look((True,), (0,))
    if best != AS_STATED:
        for part in (-0.5, 0.5):
            near = best._replace(later_ns=best.later_ns + part * _SHIFT_PERIODS * period_ns)
            found[near] = evidence(near)
        best = max(found, key=lambda key: found[key].total)
    # Height shifts a wave as well: among neighbours that are about as good, take the one nearest to the stated value.
    alike = [
        key
        for key, each in found.items()
        if key._replace(later_ns=best.later_ns) == best
        and abs(key.later_ns - best.later_ns) < 1.1 * _SHIFT_PERIODS * period_ns
        and each.total >= _ALIKE * found[best].total
    ]
    best = min(alike, key=lambda key: abs(key.later_ns))
    others = [
        each.total
        for key, each in found.items()
        if (key.sign, key.reversed) != (best.sign, best.reversed)
        or abs(key.later_ns - best.later_ns) > 2.1 * _SHIFT_PERIODS * period_ns
    ]
    tried = len(found)
    chance = found[best].chance * tried
    if chance > _SHARE * options.risk:
        told = f"polarity and time zero as stated: none of {tried} alternatives matches the map better than chance"
        return AS_STATED._replace(told=told)
    if found[best].total < _CLEAR * max(others, default=0.0):
        return AS_STATED._replace(told=f"polarity and time zero as stated: {tried} alternatives are ambiguous")
    if best == AS_STATED:
        return AS_STATED
    parts = [
        "inverted" if best.sign < 0 else "",
        f"time zero {best.later_ns:+.2f} ns" if best.later_ns else "",
        "depth levels adjusted to the map" if best.levelled else "",
        "driven in the opposite direction" if best.reversed else "",
    ]
    told = ", ".join(part for part in parts if part)
    return best._replace(chance=chance, told=f"relative to the map: {told} (best of {tried} alternatives)")


def _evidence(
    source: MapFile, log: DriveLog, track: Track, options: RegisterOptions, held: HeldGround, alignment: Alignment
) -> _Evidence:
    moved = reversed_track(track) if alignment.reversed else track
    operators = live_operators(source, log, moved, alignment)
    array = log.description.array
    prepared = held.prepared_for(array)
    wavelength_m = source.description.settings.wavelength_m
    piece_m = PIECE_M * max(1.0, wavelength_m)
    chances: list[float] = []  # logarithms
    for traces, valid, part in _stretches(log, moved, max(_STRETCH_M, 3.0 * piece_m)):
        chain = live_chain(held.ground, operators, array, int(operators(1.0).shape[0]))
        search = EvidenceSearch(prepared, chain, options, held.chance)
        scans: LiveScans = chain.feed(traces, valid, part, BLOCK_SCANS)
        path_m, z, area_m2 = search.highest(scans)
        chance = held.chance.for_windows(search.plan.windows_m, wavelength_m)
        log_p = log_p_foreign(np.nan_to_num(z, nan=0.0), area_m2, chance, float(len(search.plan.windows_m)))
        piece = np.floor((path_m - path_m[0]) / piece_m)
        for number in np.unique(piece):
            own = piece == number
            if np.isfinite(z[own]).any():
                chances.append(float(np.min(log_p[own][np.isfinite(z[own])])))
    total = -2.0 * float(np.sum(chances))
    # A probability that is no number any more is not none.
    chance_of_all = max(float(chdtrc(2 * len(chances), total)), np.finfo(float).tiny) if chances else 1.0
    return _Evidence(total, chance_of_all, len(chances))


def _stretches(log: DriveLog, track: Track, length_m: float) -> Iterator[tuple[np.ndarray, np.ndarray, Track]]:
    """Some stretches spread over a drive, no longer than a block."""
    path_m = np.cumsum(np.abs(np.diff(track.travel_m, prepend=track.travel_m[0])))
    wanted = min(_STRETCHES, max(1, int(path_m[-1] / length_m)))
    for begin_m in np.linspace(0.0, max(path_m[-1] - length_m, 0.0), wanted):
        first = int(np.searchsorted(path_m, begin_m))
        last = min(int(np.searchsorted(path_m, begin_m + length_m)) + 1, first + BLOCK_SCANS, len(path_m))
        block = next(recording_of(log).blocks(last - first, first))
        yield block.recorded, block.valid, Track(*(field[first:last] for field in track))


@dataclass(frozen=True)
class RegisteredDrive:
    """Result of registering a drive, one row per scan, in the map's frame.

    Attributes:
        table: columns of the fixes CSV.
        fix: poses, covariances and quality.
        track: prior poses and travel.
        travel_changed: one line about changes to the recorded travel; ``None`` without any.
        alignment: adjustment of its traces to the map's.
        truth: true poses of the array's centre, if the log holds them.
        correlation_at_truth: correlation at the true pose; NaN if unknown.
        time_scale: time scale of each scan's match.
        map_odometry_covariance: see ``DriveFixes``.
        milliseconds_per_scan: wall time per scan of the drive, including reading and all processing, without compiling.
        assumed: assumptions for unrecorded quantities of the drive, by quantity.
        away: description of the distance from the map; ``None`` if the drive comes close.
        place_assumed: whether the geographic position of the drive, or of the map, is assumed.
        is_baseline: whether the map was made from this very drive.
        channels: number of channels of the drive.
        carried_back: mask of scans whose place was found from the ground ahead of them.
        agreement: agreement with the fixes made during the run; ``None`` for other drives, or without ``track``.
    """

    name: str
    table: pd.DataFrame
    fix: Fix
    track: Track
    travel_changed: str | None
    alignment: Alignment
    truth: Float[np.ndarray, "scan 5"] | None
    correlation_at_truth: Float[np.ndarray, " scan"]
    time_scale: Float[np.ndarray, " scan"]
    map_odometry_covariance: Float[np.ndarray, "scan 2 2"]
    milliseconds_per_scan: float
    assumed: dict[str, str]
    away: str | None
    place_assumed: bool
    is_baseline: bool
    channels: int
    carried_back: Bool[np.ndarray, " scan"]
    agreement: Agreement | None = None


def live_blocks(
    log: DriveLog,
    track: Track,
    truth: Float[np.ndarray, "scan 5"] | None,
    start: int = 0,
    stop: int | None = None,
) -> Iterator[LiveBlock]:
    """Scans of a log from ``start`` up to ``stop``, or to its end, in blocks of ``BLOCK_SCANS``."""
    for low, recorded, valid in recording_of(log).blocks(BLOCK_SCANS, start):
        count = len(recorded) if stop is None else min(len(recorded), stop - low)
        if count <= 0:
            return
        recorded, valid, span = recorded[:count], valid[:count], slice(low, low + count)
        yield LiveBlock(
            recorded, valid, Track(*(field[span] for field in track)), None if truth is None else truth[span]
        )


def register_log(
    source: MapFile,
    log: DriveLog,
    options: RegisterOptions,
    progress: Callable[[int], None] = lambda _: None,
    led_to: Callable[[Track], Track] = lambda track: track,
    held: HeldGround | None = None,
) -> RegisteredDrive:
    """Register every scan of a drive log.

    Traces are streamed in blocks; a few hundred bytes per scan are kept.

    Args:
        source: the database.
        log: the drive.
        options: the search.
        progress: called with the number of scans done since the last call.
        led_to: changes the priors, to test ground that cannot match.
        held: ground of the same map and search, cached between drives.

    Raises:
        InputError: navigation does not span the drive, or the recording misses most of the map's band.
    """
    frame = source.description.frame
    held, array = held or HeldGround(source, options), log.description.array
    moved: DriveTrack = track_of_drive(log, frame)
    moved = moved._replace(track=led_to(moved.track))
    searched = on_board_of(log, frame) if options.track else None
    truth = true_poses(log, frame)
    compiling, began = compile_clock(), time.perf_counter()
    stated = options.track or not may_be_misaligned(log)
    alignment = AS_STATED if stated else find_alignment(source, log, moved.track, options, held)
    if alignment.reversed:
        moved = moved._replace(track=reversed_track(moved.track))
    operators = live_operators(source, log, moved.track, alignment)
    recorded, prepared = int(operators(1.0).shape[0]), held.prepared_for(array)

    def search(blocks: Iterator[LiveBlock], told: Callable[[int], None] = progress) -> DriveFixes:
        """One search from its beginning to its end."""
        likelihood = None if options.filter is None else held.likelihood_for(array, source)
        if options.filter == "smoothed":
            assert likelihood is not None
            led = smooth_drive(
                held.ground,
                operators,
                array,
                blocks,
                options,
                likelihood=likelihood,
                sigma_scale=held.chance.sigma_scale,
                recorded=recorded,
                prepared=prepared,
            )
            told(len(led.scan))
            return led
        parts: list[DriveFixes] = []
        for fixes in register_drive(
            held.ground,
            operators,
            array,
            blocks,
            options,
            chance=held.chance,
            likelihood=likelihood,
            recorded=recorded,
            prepared=prepared,
        ):
            parts.append(fixes)
            told(len(fixes.scan))
        joined: DriveFixes = jax.tree.map(lambda *fields: np.concatenate(fields), *parts)
        return joined

    if searched is None:
        found = search(live_blocks(log, moved.track, truth))
        scale = travel_scale(moved.track, array, np.asarray(found.fix.pose), np.asarray(found.fix.code) == Code.OK)
        if scale is not None:
            moved = scaled_travel(moved, scale)
            found = search(live_blocks(log, moved.track, truth), lambda _: None)
    else:
        numbers, searches = zip(*searches_of(log, searched), strict=True)
        found = placed([search(blocks) for blocks in searches], list(numbers), log.scans)
    before = np.asarray(found.fix.code)
    forced = (
        options.track
        or options.filter is not None
        or options.window_m is not None
        or options.own_thresholds is not None
    )
    if not forced and options.search_swarm is None:
        found = carry_back(
            found,
            moved.track,
            lambda first, stop: live_blocks(log, moved.track, None, first, stop),
            lambda: Registration(
                held.ground, operators, array, options, chance=held.chance, recorded=recorded, prepared=prepared
            ),
        )
    fix = found.fix._replace(p_false=np.minimum(np.asarray(found.fix.p_false) + alignment.chance, 1.0))
    took_s = time.perf_counter() - began - compiling.seconds_since(began)
    time_scale = found.time_scale
    return RegisteredDrive(
        name=log.path.name.removesuffix(".drive.h5"),
        table=fixes_table(fix, log.scan_time_s, frame, held.ground).assign(
            time_scale=time_scale, **({"smoothed": 1} if options.filter == "smoothed" else {})
        ),
        fix=fix,
        track=moved.track,
        travel_changed=travel_line(moved),
        alignment=alignment,
        truth=truth,
        correlation_at_truth=found.correlation_at_truth,
        time_scale=time_scale,
        map_odometry_covariance=found.map_odometry_covariance,
        milliseconds_per_scan=1e3 * took_s / log.scans,
        assumed=assumed_of(log.description.provenance),
        away=away_in_words(source, log),
        place_assumed=is_place_assumed(source, log),
        is_baseline=is_baseline(source, log),
        channels=log.channels,
        carried_back=(np.asarray(fix.code) == Code.OK) & (before != Code.OK),
        agreement=None if searched is None else agreement(searched, fix),
    )


def true_poses(log: DriveLog, frame: LocalFrame) -> Float[np.ndarray, "scan 5"] | None:
    """True poses of the array's centre; NaN outside the time span of the truth."""
    known, time_s = log.description.truth, log.scan_time_s
    if known is None:
        return None
    pose = poses_of(known, time_s, frame, log.description.array)[0]
    # Half a scan period of tolerance: the truth's clock may end a rounding error before the last scan.
    slack_s = 0.5 * float(np.median(np.diff(time_s)))
    reached = (time_s >= known.time_s[0] - slack_s) & (time_s <= known.time_s[-1] + slack_s)
    return np.where(reached[:, None], pose, np.nan)


def write_registered(
    drive: RegisteredDrive,
    source: MapFile,
    log: DriveLog,
    options: RegisterOptions,
    folder: Path,
    force: bool,
    sha256: tuple[str, str] | None = None,
) -> None:
    """Write ``DRIVE.fixes.csv`` and ``DRIVE.fixes.h5``; both appear, or neither.

    ``sha256`` is that of the map's file and of the log's where both are known; else it is computed.
    """
    map_sha256, drive_sha256 = sha256 or (file_hash(source.path), file_hash(log.path))
    own = options.own_thresholds
    thresholds = None if own is None else {name: float(value) for name, value in own._asdict().items()}
    provenance = {
        "program": f"lgprjax {__version__}",
        "map": {"file": source.path.name, "sha256": map_sha256},
        "drive": {"file": log.path.name, "sha256": drive_sha256},
        "search_m": "from the log's own sigma" if options.search_m is None else options.search_m,
        "window_m": "shortest that reaches the risk" if options.window_m is None else options.window_m,
        "risk": options.risk,
        "time_scale": "found along the drive" if options.time_scale is None else options.time_scale,
        "seed": options.seed,
        "track": options.track,
        **({} if options.filter is None else {"filter": options.filter}),
        "thresholds": thresholds,
        "against_the_map": drive.alignment._asdict(),
        "chain": source.description.settings.as_provenance(),
    }
    frame = source.description.frame
    attributes = {
        "name": drive.name,
        "map": source.description.name,
        "t0_utc": log.description.t0_utc,
        "anchor_latitude_deg": frame.latitude_deg,
        "anchor_longitude_deg": frame.longitude_deg,
        "anchor_height_m": frame.height_m,
        "provenance": provenance,
    }
    write_fixes(
        folder / f"{drive.name}.fixes.csv",
        folder / f"{drive.name}.fixes.h5",
        drive.table,
        attributes=attributes,
        pose_m=np.asarray(drive.fix.pose),
        covariance=np.asarray(drive.fix.covariance, dtype=np.float32),
        force=force,
    )


def true_errors(drive: RegisteredDrive) -> Float[np.ndarray, "scan 2"]:
    """Fix minus truth along and across the true heading, m; NaN without an ok fix or without truth."""
    if drive.truth is None:
        return np.full((len(drive.table), 2), np.nan)
    ok = np.asarray(drive.fix.code) == Code.OK
    error = np.where(ok[:, None], np.asarray(drive.fix.pose)[:, :2] - drive.truth[:, :2], np.nan)
    return np.stack(along_cross(error[:, 0], error[:, 1], drive.truth[:, 3]), axis=1)
