"""Registration of a whole drive against a map: fixes of every scan, block by block."""

from collections.abc import Callable, Iterable, Iterator
from typing import NamedTuple

import jax
import numpy as np
from jaxtyping import Bool, Float, Int

from lgprjax.frames import body_to_local
from lgprjax.radar import ArrayGeometry, centre_of
from lgprjax.registration.bayes.causal import FilterSearch
from lgprjax.registration.bayes.likelihood import Likelihood
from lgprjax.registration.evidence import EvidenceSearch
from lgprjax.registration.fix import Code, Fix, blank_fixes
from lgprjax.registration.judge import POOLED, Chance, RegisterOptions
from lgprjax.registration.lattice import decoy_reach_m
from lgprjax.registration.queries import SETTLED, LiveChain, LiveScans, Operators, Track, rotation
from lgprjax.registration.swarm_search import SwarmSearch
from lgprjax.registration.template_bank import PreparedGround
from lgprjax.subsurface import GroundMap, StationSource

BLOCK_SCANS = 512
_NEEDS_GROUND = (Code.LOW_CORRELATION, Code.AMBIGUOUS, Code.NO_WINDOW)  # codes that more ground may change
_WARM = 4.0  # filter lengths before a stretch that give its background as in the drive
_MOST_SCANS = 4096  # largest number of scans to each side of a place, at a standstill
_AGREED_M = 0.3  # largest distance between the places of both directions
TRACK_SCANS = 4
"""Largest number of scans that a vehicle searches at once."""


class LiveBlock(NamedTuple):
    """Consecutive scans of a drive.

    Attributes:
        traces: recorded traces, in the form of the drive's operator.
        valid: mask of channels with data.
        track: prior poses and motion of the scans.
        truth: true poses of the array's centre, if known, scored for comparison.
    """

    traces: Float[np.ndarray, "scan channel recorded"]
    valid: Bool[np.ndarray, "scan channel"]
    track: Track
    truth: Float[np.ndarray, "scan 5"] | None = None

    def part(self, scans: slice) -> "LiveBlock":
        """The block of some of its scans."""
        track = Track(*(field[scans] for field in self.track))
        return LiveBlock(
            self.traces[scans], self.valid[scans], track, None if self.truth is None else self.truth[scans]
        )


class DriveFixes(NamedTuple):
    """Fixes of consecutive scans, poses and covariances in the map's frame (see ``Fix``).

    Attributes:
        scan: numbers of the scans in the drive.
        fix: fix of each scan.
        map_odometry_covariance: part of the east and north covariances due to the map's own positions and the
            odometer's scale.
        time_scale: time scale of each scan's match.
        searched: mask of scans that were searched; the others propagate the previous fix.
        correlation_at_truth: score of the scan alone at its true pose, a measure of the difficulty of the ground; NaN
            without a known truth or for scans that were not searched.
    """

    scan: Int[np.ndarray, " scan"]
    fix: Fix
    map_odometry_covariance: Float[np.ndarray, "scan 2 2"]
    time_scale: Float[np.ndarray, " scan"]
    searched: Bool[np.ndarray, " scan"]
    correlation_at_truth: Float[np.ndarray, " scan"]


def ground_map_for(source: StationSource, options: RegisterOptions, *, keep: int = 8) -> GroundMap:
    """The map in tiles long enough to drive on for a while; ``keep`` of them stay in memory."""
    description = source.description
    array_m = 0.5 * description.channels * description.channel_pitch_m
    reach_m = 1.5 * (options.search_half_m() + 0.5) + array_m
    along_m = reach_m + decoy_reach_m(description.settings.wavelength_m)
    return GroundMap(source, half_along_m=along_m, half_cross_m=reach_m + 2.0, keep=keep)


def live_chain(ground: GroundMap, operators: Operators, array: ArrayGeometry, recorded: int) -> LiveChain:
    """Chain that converts recorded scans to this map's coefficients.

    Args:
        ground: map.
        operators: matrices from recorded numbers of a trace to profile samples, with the map's settings and number of
            samples.
        array: array of the drive.
        recorded: recorded numbers per trace.
    """
    return LiveChain(
        operators,
        ground.basis,
        track_filter_m=ground.description.settings.track_filter_m,
        channels=len(array.x_m),
        recorded=recorded,
        zero_slip_m=array.zero_slip_m,
    )


class Registration:
    """Search of one drive, fed with its scans in order: a whole drive, or the latest scans on board.

    A scan is searched every few centimetres of travel; in between, a fix is propagated by odometry and heading.

    Args:
        ground: map from ``ground_map_for`` with the same options.
        operators: operators of the drive's recording at a time scale, with the map's settings.
        array: array of the drive.
        options: options of the search.
        chance: chance of a false match on the map.
        likelihood: likelihood of map and array, for the filter (``options.filter``).
        recorded: recorded numbers per trace.
        prepared: ground prepared for the array, shared between drives; ``None``: prepared here.
        block_scans: largest block per call of ``feed``; a compiled shape.
    """

    def __init__(
        self,
        ground: GroundMap,
        operators: Operators,
        array: ArrayGeometry,
        options: RegisterOptions,
        *,
        chance: Chance = POOLED,
        likelihood: Likelihood | None = None,
        recorded: int,
        prepared: PreparedGround | None = None,
        block_scans: int = BLOCK_SCANS,
    ) -> None:
        self._block_scans = block_scans
        self._centre = centre_of(array)
        self._chain = live_chain(ground, operators, array, recorded)
        self.prepared = PreparedGround(ground, array) if prepared is None else prepared
        self.search: EvidenceSearch | FilterSearch
        if options.filter is not None:
            assert likelihood is not None
            self.search = FilterSearch(self.prepared, self._chain, options, likelihood, chance.sigma_scale, block_scans)
        else:
            search = EvidenceSearch if options.search_swarm is None else SwarmSearch
            self.search = search(self.prepared, self._chain, options, chance, block_scans)
        self._last: Searched | None = None

    def feed(self, block: LiveBlock) -> DriveFixes:
        """Fixes of the scans of a block."""
        scans = self._chain.feed(block.traces, block.valid, block.track, self._block_scans)
        stops, fix, beside, scale = self.search.feed(scans)
        at_truth = np.full(len(scans.number), np.nan)
        if block.truth is not None and isinstance(self.search, EvidenceSearch):
            at_truth[stops] = self.search.score_at(scans, stops, block.truth[stops])
        spread = self._spread(scans, stops, fix, beside, scale)
        return spread._replace(correlation_at_truth=at_truth)

    @property
    def track_filter_m(self) -> float:
        """Length of the background removal."""
        return float(self.prepared.ground.description.settings.track_filter_m)

    def feed_back(
        self,
        blocks: Iterable[LiveBlock],
        stretch: slice,
        path_m: float,
        start: tuple[Float[np.ndarray, "2"], float, float],
        offset: Float[np.ndarray, "3"],
    ) -> DriveFixes:
        """Fixes of a stretch of a drive, the last scan first: filtered in order, searched in reverse order.

        Args:
            blocks: blocks of the stretch, and of its surroundings as the background removal needs.
            stretch: scans of the stretch among these.
            path_m: travel of the drive at the first scan of the stretch.
            start: place of the last scan, negative travel up to which it is known, and time scale
                (``EvidenceSearch.begin_at``).
            offset: offsets of height, heading and roll there from the priors.
        """
        parts: list[LiveScans] = []
        background: np.ndarray | None = None
        read = 0
        for block in blocks:
            part = self._chain.feed(*block[:3], self._block_scans)
            background = part.background if background is None else background
            inside = slice(max(stretch.start - read, 0), max(stretch.stop - read, 0))
            read += len(part.number)
            if inside.start < min(inside.stop, len(part.number)):
                track = Track(*(field[inside] for field in part.track))
                kept = (part.number, part.filtered, part.valid, part.path_m, part.dead_reckoned_m)
                number, filtered, valid, path, reckoned_m = (field[inside] for field in kept)
                parts.append(
                    LiveScans(
                        number=number,
                        filtered=filtered,
                        valid=valid,
                        track=track,
                        path_m=path,
                        dead_reckoned_m=reckoned_m,
                        settled=part.settled,
                    )
                )
        # As in the drive: the first scans have the background of the metres behind them.
        for part in parts:
            if not part.settled:
                assert background is not None
                part.filtered[:] -= np.where(part.valid[..., None], background, np.float32(0.0))
        number, filtered, valid, path, reckoned_m = (
            np.concatenate([getattr(part, name) for part in parts])[::-1]
            for name in ("number", "filtered", "valid", "path_m", "dead_reckoned_m")
        )
        track = Track(*(np.concatenate(field)[::-1] for field in zip(*(part.track for part in parts), strict=True)))
        track = track._replace(pose=track.pose + np.pad(offset, (2, 0)))
        # Dead reckoning goes by the log's heading.
        reckoned_m = reckoned_m @ rotation(offset[1]).T
        scans = LiveScans(
            number=number,
            filtered=filtered,
            valid=valid,
            track=track._replace(leg=-track.leg),
            path_m=path[-1] - path - path_m,
            dead_reckoned_m=reckoned_m,
        )
        assert isinstance(self.search, EvidenceSearch)
        self.search.begin_at(*start)
        return self._spread(scans, *self.search.feed(scans))

    def _spread(
        self,
        scans: LiveScans,
        stops: Int[np.ndarray, " stop"],
        fix: Fix,
        beside: Float[np.ndarray, "stop 2 2"],
        scale: Float[np.ndarray, " stop"],
    ) -> DriveFixes:
        """Fixes of all scans: each that of the last searched one."""
        place = places_of(scans, self._centre)
        found = Searched(fix, place[stops], scans.track.leg[stops], beside, scale)
        owner = np.searchsorted(stops, np.arange(len(place)), side="right") - 1
        if self._last is not None:
            found = jax.tree.map(lambda *fields: np.concatenate(fields), self._last, found)
            owner = owner + 1
        if len(found.leg):
            self._last = jax.tree.map(lambda field: field[-1:], found)
        searched = np.zeros(len(place), bool)
        searched[stops] = True
        return propagate(scans, place, found, owner, searched)


class Searched(NamedTuple):
    """Searched scans.

    Attributes:
        fix: fix of each scan.
        place: see ``places_of``.
        leg: leg of each scan.
        beside: part of the covariance due to map and odometer.
        scale: time scale.
    """

    fix: Fix
    place: Float[np.ndarray, "stop 3"]
    leg: Int[np.ndarray, " stop"]
    beside: Float[np.ndarray, "stop 2 2"]
    scale: Float[np.ndarray, " stop"]


def places_of(scans: LiveScans, centre: tuple[float, float]) -> Float[np.ndarray, "scan 3"]:
    """The array's centre by dead reckoning, east and north, and the heading."""
    yaw = scans.track.pose[:, 3]
    still = np.zeros(len(yaw))
    return np.column_stack([scans.dead_reckoned_m + np.stack(body_to_local(still, still, yaw, *centre), axis=1), yaw])


def propagate(
    scans: LiveScans,
    place: Float[np.ndarray, "scan 3"],
    found: Searched,
    owner: Int[np.ndarray, " scan"],
    searched: Bool[np.ndarray, " scan"],
) -> DriveFixes:
    """Fixes of all scans: that of a searched one each (``owner``; -1: none), propagated by odometry and heading."""
    count, nothing = len(place), np.full(len(place), np.nan)
    blank = blank_fixes(count)
    if not len(found.leg):
        return DriveFixes(scans.number, blank, np.full((count, 2, 2), np.nan), np.ones(count), searched, nothing)
    known = np.maximum(owner, 0)
    spread = Fix(*(np.array(field[known]) for field in found.fix))
    # The travel from one leg to the next is unknown.
    apart = (owner < 0) | (found.leg[known] != scans.track.leg)
    for whole, none in zip(spread, blank, strict=True):
        whole[apart] = none[apart]
    pose, start = np.array(spread.pose), found.place[known]
    # The matched heading turns the little travel since, where the prior's is wrong.
    off = np.mod(pose[:, 3] - start[:, 2] + np.pi, 2.0 * np.pi) - np.pi
    moved = place - start
    cos, sin = np.cos(off), np.sin(off)
    pose[:, 0] += cos * moved[:, 0] - sin * moved[:, 1]
    pose[:, 1] += sin * moved[:, 0] + cos * moved[:, 1]
    pose[:, 3] += moved[:, 2]
    return DriveFixes(
        scans.number, spread._replace(pose=pose), found.beside[known], found.scale[known], searched, nothing
    )


def register_drive(
    ground: GroundMap,
    operators: Operators,
    array: ArrayGeometry,
    blocks: Iterable[LiveBlock],
    options: RegisterOptions,
    *,
    chance: Chance = POOLED,
    likelihood: Likelihood | None = None,
    recorded: int,
    prepared: PreparedGround | None = None,
) -> Iterator[DriveFixes]:
    """Fixes of every scan, block by block; memory does not grow with the drive. Arguments as for ``Registration``."""
    scans = TRACK_SCANS if options.track else BLOCK_SCANS
    search = Registration(
        ground,
        operators,
        array,
        options,
        chance=chance,
        likelihood=likelihood,
        recorded=recorded,
        prepared=prepared,
        block_scans=scans,
    )
    for block in blocks:
        for low in range(0, len(block.traces), scans):
            yield search.feed(block.part(slice(low, low + scans)))


def carry_back(
    found: DriveFixes,
    track: Track,
    blocks: Callable[[int, int], Iterator[LiveBlock]],
    begin: Callable[[], Registration],
) -> DriveFixes:
    """Fixes of a drive, with fixes of scans that were rejected before a place was found ahead of them.

    From some metres ahead of each such place the same scans are searched in reverse order, about the place alone, so
    that windows reach ahead. Each fix must still hold against the whole region. If both orders have fixes they must
    agree, or nothing is taken. Ground without a place found is not searched again.

    Args:
        found: fixes of every scan.
        track: prior poses and motion of the drive.
        blocks: function that returns the scans between two numbers in blocks.
        begin: function that starts a new search.
    """
    out: DriveFixes = jax.tree.map(np.array, found)
    code, leg = np.asarray(out.fix.code), track.leg
    path_m = np.cumsum(np.abs(np.diff(track.travel_m, prepend=track.travel_m[:1])))
    low = len(code)
    while low > 1:
        declined, ok = np.isin(code[:low], _NEEDS_GROUND), code[:low] == Code.OK
        places = np.flatnonzero(declined[:-1] & ok[1:] & (leg[: low - 1] == leg[1:low])) + 1
        if not len(places):
            break
        place = int(places[-1])
        search = begin()
        assert isinstance(search.search, EvidenceSearch)
        window_m = max(search.search.plan.windows_m)
        near = (leg == leg[place]) & (np.abs(path_m - path_m[place]) <= window_m)
        beside = np.flatnonzero(near & (np.abs(np.arange(len(leg)) - place) < _MOST_SCANS))
        low, high = int(beside[0]), int(np.flatnonzero((code == Code.OK)[: beside[-1] + 1])[-1]) + 1
        start = np.asarray(out.fix.pose)[high - 1, :2], -float(path_m[place]), float(out.time_scale[place])
        known = np.flatnonzero(code[low:high] == Code.OK) + low
        off = np.asarray(out.fix.pose)[known, 2:5] - track.pose[known, 2:5]
        off[:, 1] = np.mod(off[:, 1] + np.pi, 2.0 * np.pi) - np.pi
        warm = int(np.searchsorted(path_m, path_m[low] - _WARM * search.track_filter_m))
        warm = max(warm, low - 4 * _MOST_SCANS)
        settled = int(np.searchsorted(path_m, path_m[warm] + SETTLED * search.track_filter_m)) + 2
        back = search.feed_back(
            blocks(warm, max(high, settled)),
            slice(low - warm, high - warm),
            float(path_m[low]),
            start,
            np.median(off, axis=0),
        )
        row = high - 1 - np.arange(high - low)
        again = np.asarray(back.fix.code) == Code.OK
        both = again & (np.asarray(found.fix.code)[row] == Code.OK)
        off_m = np.asarray(back.fix.pose)[both, :2] - np.asarray(found.fix.pose)[row[both], :2]
        taken = again & np.isin(code[row], _NEEDS_GROUND) & (row < place)
        if np.any(np.hypot(*off_m.T) > _AGREED_M) or not taken.any():
            low = min(low, place - 1)
            continue
        for whole, part in zip(
            (*out.fix, out.map_odometry_covariance, out.time_scale),
            (*back.fix, back.map_odometry_covariance, back.time_scale),
            strict=True,
        ):
            whole[row[taken]] = part[taken]
        # Farther back from there, where the search reached its end with a place.
        low = int(row[taken].min()) + 1
    return out
