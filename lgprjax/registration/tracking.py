"""A drive tracked scan after scan: each search starts from the last fix, its size follows the correlation.

Batch registration searches every scan alike about the log's prior. Here a fix that is ok is carried on by odometry and
heading to the next scan, and what is searched about it is a rung of a ladder (``policy``): few places where the lock
is good, many where it is lost. The region is data, the counts are shapes; each shape is compiled ahead.
"""

from collections.abc import Iterable, Iterator
from typing import NamedTuple

import jax
import numpy as np
from jaxtyping import Float, Int

from lgprjax.radar import ArrayGeometry, centre_of
from lgprjax.registration.batches import Batch, to_tile
from lgprjax.registration.drive import (
    BLOCK_SCANS,
    LiveBlock,
    blank_fixes,
    fixes_to_map,
    live_chain,
)
from lgprjax.registration.fix import Code, Fix
from lgprjax.registration.labels import covariance_beside_match, with_covariance
from lgprjax.registration.live import LiveScans, Operators, Track
from lgprjax.registration.match import score_truth
from lgprjax.registration.near import Search, match_near, search_of
from lgprjax.registration.options import RegisterOptions
from lgprjax.registration.policy import Outcome, Policy, Turn, first_lock, next_lock, next_turn
from lgprjax.registration.prepared import Aspect, PreparedGround
from lgprjax.registration.tracking_ground import in_map, one_of_each_size
from lgprjax.subsurface import GroundMap


class TrackedFixes(NamedTuple):
    """Fixes of consecutive scans as ``DriveFixes`` has them, and the rung that each was searched on.

    Attributes:
        beside_match: see ``DriveFixes``.
        rung: number in the ladder; -1 where the scan was not searched.
    """

    scan: Int[np.ndarray, " scan"]
    fix: Fix
    correlation_at_truth: Float[np.ndarray, " scan"]
    beside_match: Float[np.ndarray, "scan 2 2"]
    rung: Int[np.ndarray, " scan"]


class _Anchor(NamedTuple):
    """The last ok fix: where the rear axle was, and what dead reckoning said there."""

    axle_m: Float[np.ndarray, "2"]
    reckoned_m: Float[np.ndarray, "2"]


class Tracker:
    """One drive's search, scan after scan.

    Position is carried from the last ok fix by odometry and heading; before the first fix, and in turns when lost (see
    ``policy.next_turn``), it is the log's own prior. Heading, roll and height are always the log's. Only ok fixes move
    the prior. A wrong one is left again: the place it was taken for does not go on matching, the region widens with
    the scans that do not and with the travel, and it held the true place when the fix was made; where the ground
    repeats itself, the log's prior raises the doubt (see ``policy.next_lock``).

    Args:
        ground: from ``tracking_ground`` with the same options.
        operators: of the drive, for the map.
        array: geometry of the drive.
        options: the search; ``search_m`` is how far the log's prior may be wrong.
        block_scans: most scans that ``feed`` is given at once, a shape that is compiled: few on a vehicle.
        held_tiles: prepared tiles held in memory.
        together: scans of a block that are searched in one call, all from the last fix before them and on one rung: a
            call costs as much as a search.

    Attributes:
        lock: what the search knows of its own state.
        prepared: the ground as it is searched; a vehicle has tiles made ready ahead (``PreparedGround.hold``).
    """

    def __init__(
        self,
        ground: GroundMap,
        operators: Operators,
        array: ArrayGeometry,
        options: RegisterOptions,
        *,
        block_scans: int = BLOCK_SCANS,
        held_tiles: int = 4,
        together: int = 1,
    ) -> None:
        self._block_scans = block_scans
        self._ground = ground
        self._operators = operators
        self._array = array
        self._options = options
        self._policy = Policy.of(options, ground.description.settings.wavelength_m)
        self.prepared = PreparedGround(ground, array, keep=held_tiles)
        self._chain = live_chain(ground, operators, len(array.x_m), options.window_m)
        self._searches = [search_of(rung, self.prepared, options, together) for rung in self._policy.ladder]
        self._most = together
        self._centre = np.array(centre_of(array))
        self.lock = first_lock(self._policy)
        self._anchor: _Anchor | None = None
        self._start_m: float | None = None
        self._path_m = 0.0

    def warm_up(self, *, truth: bool = False) -> None:
        """Compile all that a drive will need: the chain, tiles of every size of station set, every rung.

        Args:
            truth: blocks will bring true poses.
        """
        channels, recorded = len(self._array.x_m), self._operators(1.0).shape[0]
        scans_in = self._block_scans
        still = np.zeros(scans_in)
        chain = live_chain(self._ground, self._operators, channels, self._options.window_m)
        tiles = one_of_each_size(self._ground)
        frame = self._ground.frame(tiles[0])
        pose = np.tile([frame[0], frame[1], self._array.height_m, frame[2], 0.0], (scans_in, 1))
        blank = np.zeros((scans_in, channels, recorded), np.float32)
        scans, _ = chain.feed(blank, np.ones((scans_in, channels), bool), Track(pose, still, still, still), scans_in)
        for tile in tiles:
            for direction in (0, 1, -1):
                self.prepared.at(Aspect(tile, direction, 0, 0))
        aspect = Aspect(tiles[0], 1, 0, 0)
        for search in self._searches:
            batch = self._batch(search, aspect, scans, np.array([0]))
            self._match(search, aspect, batch)
            if truth:
                self._at_truth(aspect, batch, pose[:1])

    def feed(self, block: LiveBlock) -> TrackedFixes:
        """Search every scan of a block, at most ``block_scans`` of them, each from what the one before it gave."""
        scans, first = self._chain.feed(block.traces, block.valid, block.track, self._block_scans, block.time_scale)
        if self._start_m is None:
            self._start_m = self._path_m = float(scans.path_m[first])
        count = len(scans.number) - first
        fixes, at_truth = blank_fixes(count), np.full(count, np.nan)
        rungs, tiles = np.full(count, -1), np.full(count, -1)
        logged = scans.track.pose
        tried = scans._replace(track=scans.track._replace(pose=logged.copy()))
        row = 0
        while row < count:
            at = first + row
            if scans.path_m[at] - self._start_m + 1e-6 < self._options.window_m:
                row += 1
                continue
            turn = next_turn(self.lock, self._policy)
            centre_m = self._centre_at(scans, at, turn)
            tile = self._ground.tile_near(centre_m, self._searches[turn.rung].options.search_m)
            if tile is None:
                rungs[row] = turn.rung
                fixes.code[row] = int(Code.OFF_MAP)
                self._advance(scans, at, Outcome(int(Code.OFF_MAP), -1.0, 0.0, 0.0))
                row += 1
                continue
            here, aspect = self._group(turn, tried, at, count - row if block.truth is None else 1, tile)
            search = self._searches[turn.rung]
            batch = self._batch(search, aspect, tried, here)
            found = self._match(search, aspect, batch)
            if block.truth is not None:
                at_truth[row] = self._at_truth(aspect, batch, block.truth[row : row + 1])
            for part, scan in enumerate(here):
                rungs[row], tiles[row] = turn.rung, tile
                for whole, one in zip(fixes, found, strict=True):
                    whole[row] = one[part]
                self._advance(scans, int(scan), self._outcome(found, part, tile, scans, int(scan), logged[scan]))
                row += 1
        variance = self._in_map(fixes, tiles)
        return TrackedFixes(scans.number[first:], fixes, at_truth, variance, rungs)

    def _group(
        self, turn: Turn, tried: LiveScans, at: int, left: int, tile: int
    ) -> tuple[Int[np.ndarray, " scan"], Aspect]:
        """Scans from ``at`` on that are searched in one call, and how they look at the tile: all of them alike."""
        many = min(self._most, left)
        here = np.arange(at, at + many)
        tried.track.pose[here, :2] = [self._centre_at(tried, int(scan), turn) for scan in here]
        looks = self.prepared.aspects(np.full(many, tile), tried.track, here)
        if len(looks) > 1:
            here = here[:1]
            looks = self.prepared.aspects(np.array([tile]), tried.track, here)
        return here, looks[0][0]

    def _outcome(
        self, found: Fix, part: int, tile: int, scans: LiveScans, scan: int, logged: Float[np.ndarray, "5"]
    ) -> Outcome:
        """What a search gave; an ok fix is what the next ones start from."""
        code, astray_m = int(found.code[part]), 0.0
        strength = float(found.correlation[part]) * float(found.overlap[part]) ** 0.5
        if code == Code.OK:
            place_m = in_map(np.asarray(found.pose[part, :2]), self._ground.frame(tile))
            astray_m = float(np.hypot(*(place_m - logged[:2])))
            self._anchor = _Anchor(self._axle(place_m, float(logged[3]), -1.0), scans.dead_reckoned_m[scan])
        return Outcome(code, strength, 0.0, astray_m)

    def _advance(self, scans: LiveScans, scan: int, outcome: Outcome) -> None:
        """The lock after a scan."""
        travelled_m = float(scans.path_m[scan]) - self._path_m
        self._path_m = float(scans.path_m[scan])
        self.lock = next_lock(self.lock, outcome._replace(travelled_m=travelled_m), self._policy)

    def _centre_at(self, scans: LiveScans, at: int, turn: Turn) -> Float[np.ndarray, "2"]:
        pose = np.asarray(scans.track.pose[at])
        if self._anchor is None or turn.about_log:
            return pose[:2]
        axle_m = self._anchor.axle_m + scans.dead_reckoned_m[at] - self._anchor.reckoned_m
        return self._axle(np.asarray(axle_m), float(pose[3]), 1.0)

    def _axle(self, place_m: Float[np.ndarray, "2"], yaw_rad: float, sign: float) -> Float[np.ndarray, "2"]:
        """From the rear axle to the array's centre, or back: odometry is the axle's."""
        x_m, y_m = sign * self._centre
        cos, sin = np.cos(yaw_rad), np.sin(yaw_rad)
        return np.asarray(place_m + np.array([cos * x_m - sin * y_m, sin * x_m + cos * y_m]))

    def _batch(self, search: Search, aspect: Aspect, scans: LiveScans, at: Int[np.ndarray, " scan"]) -> Batch:
        frame, height_m = self._ground.frame(aspect.tile), self._ground.source.height_reference_m[aspect.tile]
        return search.layout.batch_of(self.prepared, scans, at, frame, float(height_m), search.options)

    def _match(self, search: Search, aspect: Aspect, batch: Batch) -> Fix:
        ready = self.prepared.at(aspect)
        found: Fix = jax.device_get(
            match_near(
                ready.columns,
                self._ground.components,
                ready.tile,
                *batch,
                search.rules,
                np.float32(self._ground.source.height_reference_m[aspect.tile]),
                self._ground.basis.angular_frequency_rad_per_ns,
                places=search.places,
                spec=search.layout.spec,
            )
        )
        return found

    def _at_truth(self, aspect: Aspect, batch: Batch, truth: Float[np.ndarray, "1 5"]) -> float:
        scored = score_truth(
            self.prepared.at(aspect).tile,
            *batch,
            to_tile(truth, self._ground.frame(aspect.tile)).astype(np.float32),
            np.float32(self._ground.source.height_reference_m[aspect.tile]),
            self._ground.basis.angular_frequency_rad_per_ns,
        )
        return float(scored[0])

    def _in_map(self, fixes: Fix, tiles: Int[np.ndarray, " scan"]) -> Float[np.ndarray, "scan 2 2"]:
        """Bring fixes of tiles' frames to the map's, and say what their covariances hold beside the match's."""
        beside = np.full((len(tiles), 2, 2), np.nan)
        for tile in np.unique(tiles[tiles >= 0]):
            rows = np.flatnonzero(tiles == tile)
            part = fixes_to_map(Fix(*(np.asarray(field)[rows] for field in fixes)), self._ground.frame(int(tile)))
            aspect = Aspect(int(tile), 0, 0, 0)
            beside[rows] = covariance_beside_match(self.prepared, aspect, part, self._options)
            for whole, moved in zip(fixes, with_covariance(part, beside[rows]), strict=True):
                whole[rows] = moved
        return beside


def warm_up(
    ground: GroundMap, operators: Operators, array: ArrayGeometry, options: RegisterOptions, *, truth: bool = False
) -> None:
    """Compile every rung of a drive's search; arguments as for ``Tracker`` and its ``warm_up``."""
    Tracker(ground, operators, array, options).warm_up(truth=truth)


def track_drive(
    ground: GroundMap,
    operators: Operators,
    array: ArrayGeometry,
    blocks: Iterable[LiveBlock],
    options: RegisterOptions,
) -> Iterator[TrackedFixes]:
    """Fixes of every scan of a drive, tracked; block by block. Arguments as for ``Tracker``.

    What ``register_drive`` gives, but a fix depends on the fixes before it.
    """
    tracker = Tracker(ground, operators, array, options)
    for number, block in enumerate(blocks):
        if number == 0:
            tracker.warm_up(truth=block.truth is not None)
        yield tracker.feed(block)
