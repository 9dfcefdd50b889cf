"""Registration of a whole drive against a map: fixes of every scan, block by block."""

from collections.abc import Iterable, Iterator
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from lgprjax.frames import body_to_local
from lgprjax.radar import ArrayGeometry, centre_of
from lgprjax.registration.coarse import decoy_reach_m
from lgprjax.registration.evidence import EvidenceSearch
from lgprjax.registration.fix import Fix, blank_fixes
from lgprjax.registration.judge import POOLED, Chance, RegisterOptions
from lgprjax.registration.queries import LiveChain, LiveScans, Operators, Track
from lgprjax.registration.swarm_search import SwarmSearch
from lgprjax.registration.template_bank import PreparedGround
from lgprjax.subsurface import GroundMap, StationSource

BLOCK_SCANS = 512
TRACK_SCANS = 4
"""Largest number of scans that a vehicle searches at once."""


class LiveBlock(NamedTuple):
    """Consecutive scans of a drive.

    Attributes:
        traces: as recorded, in the form that the drive's operator takes.
        valid: channels that hold data.
        track: of the scans.
        truth: true poses of the array's centre where they are known, scored for comparison.
    """

    traces: Float[np.ndarray, "scan channel recorded"]
    valid: Bool[np.ndarray, "scan channel"]
    track: Track
    truth: Float[np.ndarray, "scan 5"] | None = None

    def part(self, scans: slice) -> "LiveBlock":
        """Some of its scans."""
        track = Track(*(field[scans] for field in self.track))
        return LiveBlock(
            self.traces[scans], self.valid[scans], track, None if self.truth is None else self.truth[scans]
        )


class DriveFixes(NamedTuple):
    """Fixes of consecutive scans, poses and covariances in the map's frame (see ``Fix``).

    Attributes:
        scan: numbers in the drive.
        fix: of each.
        map_odometry_covariance: the part of the east and north covariances due to the map's own positions and the
            odometer's scale.
        time_scale: that each scan was matched at.
        searched: scans that were searched; the others propagate the previous fix.
        correlation_at_truth: score of the scan alone at its true pose, a measure of how difficult the ground is; NaN
            where no truth is known or the scan was not searched.
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


def live_chain(ground: GroundMap, operators: Operators, channels: int, recorded: int) -> LiveChain:
    """The chain that converts recorded scans to this map's coefficients.

    Args:
        ground: the map.
        operators: matrices from recorded numbers of a trace to profile samples, with the map's settings and number of
            samples.
        channels: of the drive.
        recorded: numbers of a trace.
    """
    return LiveChain(
        operators,
        ground.basis,
        track_filter_m=ground.description.settings.track_filter_m,
        channels=channels,
        recorded=recorded,
    )


class Registration:
    """The search of one drive, fed with its scans in order: a whole drive, or the last few of a vehicle.

    A scan is searched every few centimetres of travel; in between, a fix is propagated by odometry and heading.

    Args:
        ground: from ``ground_map_for`` with the same options.
        operators: of the drive's recording at a time scale, with the map's settings.
        array: geometry of the drive.
        options: of the search.
        chance: of the map.
        recorded: numbers of a trace.
        prepared: of ground and array, shared between drives; None to make one.
        block_scans: largest block that ``feed`` is given; a compiled shape.
    """

    def __init__(
        self,
        ground: GroundMap,
        operators: Operators,
        array: ArrayGeometry,
        options: RegisterOptions,
        *,
        chance: Chance = POOLED,
        recorded: int,
        prepared: PreparedGround | None = None,
        block_scans: int = BLOCK_SCANS,
    ) -> None:
        self._block_scans = block_scans
        self._centre = centre_of(array)
        self._chain = live_chain(ground, operators, len(array.x_m), recorded)
        self.prepared = PreparedGround(ground, array) if prepared is None else prepared
        search = EvidenceSearch if options.search_swarm is None else SwarmSearch
        self.search = search(self.prepared, self._chain, options, chance, block_scans)
        self._last: tuple[Fix, np.ndarray, np.ndarray, float] | None = None

    def feed(self, block: LiveBlock) -> DriveFixes:
        """Fixes of the scans of a block."""
        scans = self._chain.feed(block.traces, block.valid, block.track, self._block_scans)
        stops, fix, beside, scale = self.search.feed(scans)
        at_truth = np.full(len(scans.number), np.nan)
        if block.truth is not None:
            at_truth[stops] = self.search.score_at(scans, stops, block.truth[stops])
        spread = self._spread(scans, stops, fix, beside, scale)
        return spread._replace(correlation_at_truth=at_truth)

    def _spread(
        self,
        scans: LiveScans,
        stops: Int[np.ndarray, " stop"],
        fix: Fix,
        beside: Float[np.ndarray, "stop 2 2"],
        scale: Float[np.ndarray, " stop"],
    ) -> DriveFixes:
        """Fixes of all scans: those of searched scans, propagated by odometry and heading to the others."""
        yaw, nothing = scans.track.pose[:, 3], np.full(len(scans.number), np.nan)
        still = np.zeros(len(yaw))
        place = scans.dead_reckoned_m + np.stack(body_to_local(still, still, yaw, *self._centre), axis=1)
        leg, searched = scans.track.leg, np.zeros(len(yaw), bool)
        searched[stops] = True
        here = np.concatenate([place[stops], yaw[stops, None], leg[stops, None]], axis=1)
        if self._last is not None:
            fix = Fix(*(np.concatenate([a, b]) for a, b in zip(self._last[0], fix, strict=True)))
            here, beside = np.concatenate([self._last[1], here]), np.concatenate([self._last[2], beside])
            scale = np.concatenate([[self._last[3]], scale])
        before = 0 if self._last is None else 1
        owner = np.searchsorted(stops, np.arange(len(yaw)), side="right") - 1 + before
        if not len(fix.code):
            return DriveFixes(
                scans.number,
                blank_fixes(len(yaw)),
                np.full((len(yaw), 2, 2), np.nan),
                np.ones(len(yaw)),
                searched,
                nothing,
            )
        known = np.maximum(owner, 0)
        spread = Fix(*(np.array(field[known]) for field in fix))
        # The travel from one leg to the next is unknown.
        apart = (owner < 0) | (here[known, 3] != leg)
        blank = blank_fixes(len(yaw))
        for whole, none in zip(spread, blank, strict=True):
            whole[apart] = none[apart]
        pose = np.array(spread.pose)
        # The matched heading turns the little travel since, where the prior's is wrong.
        off = np.mod(pose[:, 3] - here[known, 2] + np.pi, 2.0 * np.pi) - np.pi
        moved = place - here[known, :2]
        cos, sin = np.cos(off), np.sin(off)
        pose[:, 0] += cos * moved[:, 0] - sin * moved[:, 1]
        pose[:, 1] += sin * moved[:, 0] + cos * moved[:, 1]
        pose[:, 3] += yaw - here[known, 2]
        spread = spread._replace(pose=pose)
        self._last = (
            Fix(*(field[-1:] for field in fix)),
            here[-1:],
            beside[-1:],
            float(scale[-1]),
        )
        return DriveFixes(scans.number, spread, beside[known], scale[known], searched, nothing)


def register_drive(
    ground: GroundMap,
    operators: Operators,
    array: ArrayGeometry,
    blocks: Iterable[LiveBlock],
    options: RegisterOptions,
    *,
    chance: Chance = POOLED,
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
        recorded=recorded,
        prepared=prepared,
        block_scans=scans,
    )
    for block in blocks:
        for low in range(0, len(block.traces), scans):
            yield search.feed(block.part(slice(low, low + scans)))
