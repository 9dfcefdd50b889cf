"""Baselines registered on each other: every place of a pass on the ground of earlier passes, one at a time.

One ground a match, so that each fix ties two passes and two only: the ground of all others together is nobody's where
their labels disagree.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from lgprjax.archive.baseline_passes import Passes, PassPairs, pairs_of, passes_of
from lgprjax.archive.map_matching import KeptStations
from lgprjax.archive.station_matching import register_stations
from lgprjax.formats import MapFile
from lgprjax.registration import Code, RegisterOptions, ground_map_for
from lgprjax.subsurface import SpatialIndex

UNKNOWN_SIGMA_M = 0.5
"""Of labels that say nothing of themselves."""
LEAST_SIGMA_M = 0.05
"""No label is trusted better than this: what receivers say of themselves leaves out what they do not see."""

_SEARCH_SIGMAS = 3.0
_SEARCH_M = (1.0, 4.0)  # half side, at least and at most
_BESIDE = 5  # places to each side, of the same two passes, that speak for a match
_LEAST_SHARE = 1.0 / 3.0  # of the places tried there that are matched too; on other ground hardly one in a hundred is
_LEAST_MATCHES = 3
_AGAIN_M = 0.5  # half side of the search the second time
_NO_GROUND = (Code.OFF_MAP, Code.LOW_OVERLAP, Code.NON_FINITE, Code.NO_WINDOW)


class MatchPlan(NamedTuple):
    """What is matched with what: the search, the passes, and the pairs of place and earlier pass."""

    options: RegisterOptions
    passes: Passes
    pairs: PassPairs


class PassMatches(NamedTuple):
    """Places matched on the ground of earlier passes, one row each.

    Attributes:
        station, number: the place's station and its pass.
        ground: nearest station of the pass it was matched with.
        on: that pass.
        found: east_m, north_m, yaw_rad by the ground's labels.
        covariance: of ``found``.
        code: of registration.
    """

    station: Int[np.ndarray, " row"]
    number: Int[np.ndarray, " row"]
    ground: Int[np.ndarray, " row"]
    on: Int[np.ndarray, " row"]
    found: Float[np.ndarray, "row 3"]
    covariance: Float[np.ndarray, "row 3 3"]
    code: Int[np.ndarray, " row"]


def label_sigmas(source: MapFile) -> Float[np.ndarray, " drive"]:
    """What each baseline's labels are taken to be off by, metres, in east and in north."""
    said = np.asarray(source.description.label_sigma_m, np.float64)
    return np.asarray(np.where(said > 0.0, np.maximum(said, LEAST_SIGMA_M), UNKNOWN_SIGMA_M))


def plan_matches(source: MapFile) -> MatchPlan:
    """What to match: every place with passes that came by before, within three sigmas of two labels' difference."""
    apart_m = _SEARCH_SIGMAS * np.sqrt(2.0) * float(label_sigmas(source).max())
    options = RegisterOptions(search_m=float(np.clip(apart_m, *_SEARCH_M)))
    passes = passes_of(source, source.description.array_width_m + options.search_half_m())
    return MatchPlan(options, passes, pairs_of(source, passes, options.search_half_m()))


def match_passes(source: MapFile, plan: MatchPlan, progress: Callable[[int], None] = lambda _: None) -> PassMatches:
    """Match places of a map's baselines with the passes that came by before, whole arrays, far about their labels.

    One tile is gridded at a time.

    Args:
        source: the map.
        plan: what to match.
        progress: told the number of matches done since the last call.
    """
    return _matched(source, plan, np.zeros((len(source.pose), 3)), progress, near=False)


def match_again(
    source: MapFile,
    plan: MatchPlan,
    correction: Float[np.ndarray, "scan 3"],
    progress: Callable[[int], None] = lambda _: None,
) -> PassMatches:
    """The same where labels are known to some decimetres, and nearby.

    Only the part of an array that lies over the other pass's ground takes part: passes side by side are matched as
    well, and none is drawn sideways to where more of the array would be.

    Args:
        source, plan, progress: as for ``match_passes``.
        correction: what to add to the labels' east_m, north_m and yaw_rad of every station.
    """
    near = plan._replace(options=RegisterOptions(search_m=_AGAIN_M))
    return _matched(source, near, correction, progress, near=True)


def supported(matches: PassMatches) -> Bool[np.ndarray, " row"]:
    """Which matches are ok and not alone.

    Ground that two passes share is found at most of its places. Where only few of the places about a match are matched,
    on the same pass, the match is chance: it ties nothing.
    """
    order = np.lexsort((matches.station, matches.on, matches.number))
    ok = (matches.code == Code.OK)[order]
    tried = ~np.isin(matches.code, _NO_GROUND)[order]
    pair = np.stack([matches.number[order], matches.on[order]], axis=1)
    starts = np.flatnonzero(np.any(np.diff(pair, axis=0, prepend=-1), axis=1))
    held = np.zeros(len(order), bool)
    for low, high in zip(starts, np.append(starts, len(order))[1:], strict=True):
        at = np.arange(low, high)
        first, last = np.maximum(at - _BESIDE, low), np.minimum(at + _BESIDE + 1, high)
        found, asked = (np.concatenate([[0], np.cumsum(field[low:high])]) for field in (ok, tried))
        found, asked = found[last - low] - found[first - low], asked[last - low] - asked[first - low]
        held[low:high] = ok[low:high] & (found >= _LEAST_MATCHES) & (found >= _LEAST_SHARE * asked)
    out = np.zeros(len(order), bool)
    out[order] = held
    return out


def _matched(
    source: MapFile,
    plan: MatchPlan,
    correction: Float[np.ndarray, "scan 3"],
    progress: Callable[[int], None],
    *,
    near: bool,
) -> PassMatches:
    options, passes, pairs = plan
    rows: list[PassMatches] = []
    for on in np.unique(pairs.ground):
        ground = _PassGround(source, passes.of_station == on, correction, options)
        mine = np.flatnonzero(pairs.ground == on)
        expected = ground.expected(pairs.station[mine])
        tile = ground.tiles(expected)
        progress(int(np.sum(tile < 0)))
        for number in np.unique(tile[tile >= 0]):
            chosen = tile == number
            found = ground.match(int(number), pairs.station[mine[chosen]], expected[chosen], near=near)
            rows.append(found._replace(number=pairs.number[mine[chosen]], on=pairs.ground[mine[chosen]]))
            progress(int(chosen.sum()))
    if not rows:
        none = np.zeros(0, np.int64)
        return PassMatches(none, none, none, none, np.zeros((0, 3)), np.zeros((0, 3, 3)), none)
    return PassMatches(*(np.concatenate(field) for field in zip(*rows, strict=True)))


class _PassGround:
    """The ground of one pass, where its labels put it."""

    def __init__(
        self,
        source: MapFile,
        kept: Bool[np.ndarray, " scan"],
        correction: Float[np.ndarray, "scan 3"],
        options: RegisterOptions,
    ) -> None:
        self._source, self._options = source, options
        self._own = np.flatnonzero(kept)
        self._ground = ground_map_for(KeptStations(source, kept), options)
        self._correction = correction
        self._labelled = SpatialIndex(source.pose[self._own, :2], 8.0)
        self._corrected = SpatialIndex(source.pose[self._own, :2] + correction[self._own, :2], 8.0)
        self._reach_m = 4.0 * options.search_half_m() + source.description.array_width_m

    def expected(self, station: Int[np.ndarray, " row"]) -> Float[np.ndarray, "row 5"]:
        """Where stations of other passes lie on this ground, by its labels, if both are corrected."""
        pose = self._source.pose[station].copy()
        pose[:, [0, 1, 3]] += self._correction[station]
        under = self._own[self._nearest(self._corrected, pose[:, :2])]
        east, north, yaw = self._correction[under].T
        label = self._source.pose[under, :2]
        x, y = pose[:, 0] - label[:, 0] - east, pose[:, 1] - label[:, 1] - north
        pose[:, 0] = label[:, 0] + np.cos(yaw) * x + np.sin(yaw) * y
        pose[:, 1] = label[:, 1] + np.cos(yaw) * y - np.sin(yaw) * x
        pose[:, 3] -= yaw
        return np.asarray(pose)

    def tiles(self, pose: Float[np.ndarray, "row 5"]) -> Int[np.ndarray, " row"]:
        """Tile of each pose; -1 where the map does not reach."""
        near = [self._ground.tile_near(point, self._options.search_half_m()) for point in pose[:, :2]]
        return np.array([-1 if number is None else number for number in near], np.int64)

    def match(
        self, tile: int, station: Int[np.ndarray, " row"], pose: Float[np.ndarray, "row 5"], *, near: bool
    ) -> PassMatches:
        """Stations of other passes on one tile; the passes are for the caller to fill in."""
        fix = register_stations(self._source, self._ground, tile, station, pose, self._options, over_ground=near).fix
        east, north, yaw = self._ground.frame(tile)
        cos, sin = np.cos(yaw), np.sin(yaw)
        turn = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
        found = np.asarray(fix.pose, np.float64)[:, [0, 1, 3]] @ turn.T + np.array([east, north, yaw])
        covariance = np.asarray(fix.covariance, np.float64)[:, [0, 1, 3]][:, :, [0, 1, 3]]
        return PassMatches(
            station=station,
            number=station,
            ground=self._own[self._nearest(self._labelled, found[:, :2])],
            on=station,
            found=found,
            covariance=turn @ covariance @ turn.T,
            code=np.asarray(fix.code, np.int64),
        )

    def _nearest(self, index: SpatialIndex, point_m: Float[np.ndarray, "row 2"]) -> Int[np.ndarray, " row"]:
        """Nearest of the pass's stations; the first where none is near, or where the point is nowhere."""
        near = [index.nearest(point, self._reach_m) if np.all(np.isfinite(point)) else None for point in point_m]
        return np.array([number or 0 for number in near], np.int64)
