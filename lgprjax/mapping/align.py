"""Alignment of a map's baselines: labels are corrected until they agree; no signal changes."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from lgprjax import __version__
from lgprjax.batch.chance import KeptStations, measure_chance
from lgprjax.files import file_hash
from lgprjax.formats import MapFile, MapWriter, copy_stations
from lgprjax.mapping.build import MEASURING
from lgprjax.mapping.matching import places_of_drives, register_stations
from lgprjax.navigation.pose_graph import FixEdges, GraphSolution, LabelChain, LabelModel, misfit, solve_graph
from lgprjax.registration import Code, RegisterOptions, ground_map_for
from lgprjax.subsurface import SpatialIndex, TilePlacer

# Baselines cut where they return to their own ground, and the earlier pass that each place is compared with.
#
# A pass never overlaps itself: a lap of a closed course, or the return after a turn, is a pass of its own and is
# matched with the previous one like any other baseline.

STEP_M = 1.0
"""Spacing of matches along a pass: larger than the distance over which matches share noise."""

_SAME_PASS_M = 20.0  # of path; places closer behind belong to the same pass, even around a tight bend


class Passes(NamedTuple):
    """A map's baselines as passes, numbered in the order of driving.

    Attributes:
        of_station: pass of every station.
        station, number: places along all baselines, in order: station and its pass.
    """

    of_station: Int[np.ndarray, " scan"]
    station: Int[np.ndarray, " place"]
    number: Int[np.ndarray, " place"]


class PassPairs(NamedTuple):
    """Places to match on the ground of an earlier pass, in order of ground, pass and place.

    Attributes:
        station, number: the place's station and pass.
        ground: the earlier pass.
    """

    station: Int[np.ndarray, " pair"]
    number: Int[np.ndarray, " pair"]
    ground: Int[np.ndarray, " pair"]


def passes_of(source: MapFile, reach_m: float) -> Passes:
    """Cut a map's baselines into passes.

    Args:
        source: map.
        reach_m: places whose labels are nearer than this may be the same ground.
    """
    lag = round(_SAME_PASS_M / STEP_M)
    of_station = np.zeros(len(source.drive), np.int64)
    stations, numbers, count = [], [], 0
    pose, drive = source.pose, source.drive
    for baseline, places in enumerate(places_of_drives(source, STEP_M)):
        index = SpatialIndex(places.pose[:, :2], 8.0)
        number, start = np.zeros(len(places.pose), np.int64), 0
        starts = [0]
        for n, place in enumerate(places.pose[:, :2]):
            near = index.near(place, reach_m)
            if np.any((near >= start) & (near < n - lag)):
                start = n
                starts.append(n)
            number[n] = count + len(starts) - 1
        held = places.station >= 0
        stations.append(places.station[held])
        numbers.append(number[held])
        # A pass begins at its first place's own ground, half a step ahead of the place.
        own = np.flatnonzero(drive == baseline)
        path = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(pose[own, :2], axis=0).T))]) if len(own) else own
        of_station[own] = count + np.searchsorted(np.array(starts[1:]) * STEP_M, path, side="right")
        count += len(starts)
    return Passes(of_station, np.concatenate(stations), np.concatenate(numbers))


def pairs_of(source: MapFile, passes: Passes, search_m: float) -> PassPairs:
    """Pairs of places and earlier passes to match: of the passes nearby the last, and the 2nd, 4th, 8th last.

    The work thus grows with the logarithm of the number of passes, and any two passes over the same ground are
    connected by few steps.

    Args:
        source: map.
        passes: passes of the map.
        search_m: half side of the search around a label.
    """
    point_m = source.pose[passes.station, :2]
    index, reach_m = SpatialIndex(point_m, 8.0), search_m + 0.5 * source.description.array_width_m
    rows = []
    for n, number in enumerate(passes.number):
        by = np.unique(passes.number[index.near(point_m[n], reach_m)])
        by = by[by < number][::-1]
        for rank in (1 << k for k in range(len(by).bit_length())):
            rows.append((passes.station[n], number, by[rank - 1]))
    table = np.array(rows, np.int64).reshape(-1, 3)
    table = table[np.lexsort((table[:, 0], table[:, 1], table[:, 2]))]
    return PassPairs(table[:, 0], table[:, 1], table[:, 2])


# Baselines registered on each other: every place of a pass on the ground of earlier passes, one at a time.
#
# One pass per match, so that each fix connects exactly two passes: the combined ground of all others is meaningless
# where their labels disagree.

UNKNOWN_SIGMA_M = 0.5
"""Sigma of labels that state none."""
LEAST_SIGMA_M = 0.05
"""Least sigma of a label: receivers' own sigmas leave out errors that they do not observe."""

_SEARCH_SIGMAS = 3.0
_SEARCH_M = (1.0, 4.0)  # half side, at least and at most
_BESIDE = 5  # places to each side, of the same two passes, that support a match
# share share of the places tried there that are matched too; on other ground hardly one in a hundred is
_LEAST_SHARE = 1.0 / 3.0
_LEAST_MATCHES = 3
_AGAIN_M = 0.5  # half side of the search the second time
_NO_GROUND = (Code.OFF_MAP, Code.LOW_OVERLAP, Code.NON_FINITE, Code.NO_WINDOW)


class MatchPlan(NamedTuple):
    """Plan of the matches: the search, the passes, and the pairs of place and earlier pass."""

    options: RegisterOptions
    passes: Passes
    pairs: PassPairs


class PassMatches(NamedTuple):
    """Places matched on the ground of earlier passes, one row each.

    Attributes:
        station, number: station of the place, and its pass.
        ground: nearest station of the pass on which it was matched.
        on: number of that pass.
        found: east_m, north_m, yaw_rad by the ground's labels.
        covariance: covariance of ``found``.
        code: code of registration.
    """

    station: Int[np.ndarray, " row"]
    number: Int[np.ndarray, " row"]
    ground: Int[np.ndarray, " row"]
    on: Int[np.ndarray, " row"]
    found: Float[np.ndarray, "row 3"]
    covariance: Float[np.ndarray, "row 3 3"]
    code: Int[np.ndarray, " row"]


def label_sigmas(source: MapFile) -> Float[np.ndarray, " drive"]:
    """Assumed sigma of each baseline's labels, metres, in east and in north."""
    said = np.asarray(source.description.label_sigma_m, np.float64)
    return np.asarray(np.where(said > 0.0, np.maximum(said, LEAST_SIGMA_M), UNKNOWN_SIGMA_M))


def plan_matches(source: MapFile) -> MatchPlan:
    """Plan matches of every place with earlier passes nearby, within three sigmas of two labels' difference."""
    apart_m = _SEARCH_SIGMAS * np.sqrt(2.0) * float(label_sigmas(source).max())
    options = RegisterOptions(search_m=float(np.clip(apart_m, *_SEARCH_M)))
    passes = passes_of(source, source.description.array_width_m + options.search_half_m())
    return MatchPlan(options, passes, pairs_of(source, passes, options.search_half_m()))


def match_passes(source: MapFile, plan: MatchPlan, progress: Callable[[int], None] = lambda _: None) -> PassMatches:
    """Match places of a map's baselines with earlier passes: whole arrays, in a wide region around their labels.

    One tile is gridded at a time.

    Args:
        source: map.
        plan: plan of the matches.
        progress: function called with the number of matches done since the last call.
    """
    return _matched(source, plan, np.zeros((len(source.pose), 3)), progress, near=False)


def match_again(
    source: MapFile,
    plan: MatchPlan,
    correction: Float[np.ndarray, "scan 3"],
    progress: Callable[[int], None] = lambda _: None,
) -> PassMatches:
    """Match again where labels are known to some decimetres, in a small region.

    Only the part of an array over the other pass's ground is used, so that adjacent passes are matched as well, without
    a bias sideways towards more overlap.

    Args:
        source, plan, progress: as for ``match_passes``.
        correction: correction of the labels' east_m, north_m and yaw_rad of every station.
    """
    near = plan._replace(options=RegisterOptions(search_m=_AGAIN_M))
    return _matched(source, near, correction, progress, near=True)


def supported(matches: PassMatches) -> Bool[np.ndarray, " row"]:
    """Select the matches that are ok and supported by others nearby.

    Ground that two passes share is found at most of its places. Where only few places around a match are matched on the
    same pass, the match is due to chance and is not used.
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
        found, tried_sums = (np.concatenate([[0], np.cumsum(field[low:high])]) for field in (ok, tried))
        found, tried_sums = found[last - low] - found[first - low], tried_sums[last - low] - tried_sums[first - low]
        held[low:high] = ok[low:high] & (found >= _LEAST_MATCHES) & (found >= _LEAST_SHARE * tried_sums)
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
        return PassMatches(
            station=none,
            number=none,
            ground=none,
            on=none,
            found=np.zeros((0, 3)),
            covariance=np.zeros((0, 3, 3)),
            code=none,
        )
    return PassMatches(*(np.concatenate(field) for field in zip(*rows, strict=True)))


class _PassGround:
    """The ground of one pass, placed by its labels."""

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
        """Poses of other passes' stations on this ground, by its labels, if both are corrected."""
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
        """Tile of each pose; -1 off the map."""
        near = [self._ground.tile_near(point, self._options.search_half_m()) for point in pose[:, :2]]
        return np.array([-1 if number is None else number for number in near], np.int64)

    def match(
        self, tile: int, station: Int[np.ndarray, " row"], pose: Float[np.ndarray, "row 5"], *, near: bool
    ) -> PassMatches:
        """Match stations of other passes on one tile; the caller fills in the passes."""
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
        """Nearest station of the pass; the first if none is near, or the point is not finite."""
        near = [index.nearest(point, self._reach_m) if np.all(np.isfinite(point)) else None for point in point_m]
        return np.array([number or 0 for number in near], np.int64)


# A map's baselines and the matches between them as a pose graph, and its solution for each baseline.

_BREAK_M = 1.0
"""Neighbouring stations farther apart than this are a gap or a jump of the labels: both sides are independent."""

_MATCH_SIGMA_M = 0.01
"""Error of a match in addition to its own covariance: from gridding and the shape of the labels within a tile."""
_MATCH_SIGMA_RAD = np.radians(0.1)

_SIGMA_PLACES = 20  # of a baseline, at which its sigmas are computed


class StationChains(NamedTuple):
    """A map's stations along connected chains of labels.

    Attributes:
        chains: stretches of baselines without a break.
        chain, at_m: chain of each station, and its place along the baseline's path.
    """

    chains: tuple[LabelChain, ...]
    chain: Int[np.ndarray, " scan"]
    at_m: Float[np.ndarray, " scan"]


class BaselineChange(NamedTuple):
    """Effect of the alignment on one baseline.

    Attributes:
        drive: number of the baseline.
        matches, kept: number of matches of its places and on its ground, and of those used; without any it is not
            modified.
        moved_rms_m, moved_max_m: RMS and largest change of its labels.
        sigma_before_m, sigma_after_m: standard deviations of its labels' east and north, root mean square; NaN after,
            if it is not connected.
    """

    drive: int
    matches: int
    kept: int
    moved_rms_m: float
    moved_max_m: float
    sigma_before_m: float
    sigma_after_m: float


class Consistency(NamedTuple):
    """Distance of matches from their labels, over the matches that are ok and supported.

    Attributes:
        rms_m: root mean square over the matches used.
        median_m: median over all matches.
    """

    rms_m: float
    median_m: float


class AgreedBaselines(NamedTuple):
    """A map's stations after the alignment of its baselines.

    Attributes:
        pose: pose of all stations.
        tried, matched, used, kept: number of places of passes tried on earlier passes; of matches with code ok; of
            supported ones; of those kept by the graph.
        noise_scale: see ``GraphSolution``.
        before, after: distance of the matches from the labels.
        baselines: change of each baseline.
        solution: solution of the graph.
        stations: chains of the graph.
    """

    pose: Float[np.ndarray, "scan 5"]
    tried: int
    matched: int
    used: int
    kept: int
    noise_scale: float
    before: Consistency
    after: Consistency
    baselines: tuple[BaselineChange, ...]
    solution: GraphSolution
    stations: StationChains


def chains_of(source: MapFile) -> StationChains:
    """Chains of a map's baselines: cut where a baseline ends and where neighbouring stations are far apart."""
    pose, drive = source.pose, source.drive
    sigma_m = label_sigmas(source)
    step_m = np.hypot(*np.diff(pose[:, :2], axis=0).T)
    path_m = np.concatenate([[0.0], np.cumsum(step_m)])
    break_m = max(_BREAK_M, 5.0 * source.description.settings.step_m)
    cut = np.flatnonzero((step_m > break_m) | (np.diff(drive) != 0)) + 1
    starts, stops = np.concatenate([[0], cut]), np.concatenate([cut, [len(pose)]]) - 1
    chains = tuple(
        LabelChain(float(path_m[a]), float(path_m[b]), float(sigma_m[drive[a]]))
        for a, b in zip(starts, stops, strict=True)
    )
    return StationChains(chains, np.repeat(np.arange(len(chains)), stops - starts + 1), path_m)


def edges_of(
    source: MapFile, stations: StationChains, matches: PassMatches, used: Bool[np.ndarray, " row"]
) -> FixEdges:
    """The used matches as edges between chains."""
    ends = np.stack([matches.station[used], matches.ground[used]], axis=1)
    own = np.diag([_MATCH_SIGMA_M**2, _MATCH_SIGMA_M**2, _MATCH_SIGMA_RAD**2])
    return FixEdges(
        chain=stations.chain[ends],
        at_m=stations.at_m[ends],
        label=source.pose[ends][..., [0, 1, 3]],
        found=matches.found[used],
        covariance=matches.covariance[used] + own,
    )


def agree_baselines(source: MapFile, matches: PassMatches, model: LabelModel | None = None) -> AgreedBaselines:
    """Correct a map's labels so that its baselines agree with each other.

    Args:
        source: map.
        matches: matches of its passes with each other.
        model: model of the labels' errors.
    """
    model, used = model or LabelModel(), supported(matches)
    stations = chains_of(source)
    edges = edges_of(source, stations, matches, used)
    solution = solve_graph(stations.chains, edges, model)
    correction = solution.correction(stations.chain, stations.at_m)
    pose = source.pose.copy()
    pose[:, [0, 1, 3]] += correction
    drives = source.drive[np.stack([matches.station[used], matches.ground[used]], axis=1)]
    return AgreedBaselines(
        pose=pose,
        tried=len(matches.code),
        matched=int(np.sum(matches.code == 0)),
        used=len(edges.found),
        kept=int(solution.kept.sum()),
        noise_scale=solution.noise_scale,
        before=_consistency(edges, np.zeros((2, len(edges.found), 3)), solution.kept),
        after=_consistency(edges, _corrections(edges, solution), solution.kept),
        baselines=tuple(
            _change(source, stations, drives, solution, correction, drive)
            for drive in range(1 + int(source.drive.max()))
        ),
        solution=solution,
        stations=stations,
    )


def _corrections(edges: FixEdges, solution: GraphSolution) -> Float[np.ndarray, "2 edge 3"]:
    return np.stack([solution.correction(edges.chain[:, end], edges.at_m[:, end]) for end in (0, 1)])


def _consistency(
    edges: FixEdges, correction: Float[np.ndarray, "2 edge 3"], kept: Bool[np.ndarray, " edge"]
) -> Consistency:
    """Distances between places and their fixes, both by corrected labels."""
    if not kept.any():
        return Consistency(float("nan"), float("nan"))
    apart = np.hypot(*misfit(edges, *correction)[:, :2].T)
    return Consistency(float(np.sqrt(np.mean(apart[kept] ** 2))), float(np.median(apart)))


def _change(
    source: MapFile,
    stations: StationChains,
    drives: Int[np.ndarray, "edge 2"],
    solution: GraphSolution,
    correction: Float[np.ndarray, "scan 3"],
    drive: int,
) -> BaselineChange:
    own = np.flatnonzero(source.drive == drive)
    mine = np.any(drives == drive, axis=1)
    kept = int(np.sum(mine & solution.kept))
    moved_m = np.hypot(correction[own, 0], correction[own, 1])
    after_m = float("nan")
    if kept:
        tried_sums = own[np.linspace(0, len(own) - 1, _SIGMA_PLACES).astype(int)]
        variance = np.diagonal(solution.covariance(stations.chain[tried_sums], stations.at_m[tried_sums])).reshape(
            -1, 3
        )
        after_m = float(np.sqrt(np.mean(variance[:, :2])))
    return BaselineChange(
        drive=drive,
        matches=int(mine.sum()),
        kept=kept,
        moved_rms_m=float(np.sqrt(np.mean(moved_m**2))) if len(own) else 0.0,
        moved_max_m=float(moved_m.max(initial=0.0)),
        sigma_before_m=float(label_sigmas(source)[drive]),
        sigma_after_m=after_m,
    )


_BLOCK = 256  # stations that share a height when tiles are placed


def refine_map(
    source: MapFile,
    plan: MatchPlan,
    output: str | Path,
    *,
    force: bool = False,
    progress: Callable[[int], None] = lambda _: None,
    stage: Callable[[str], None] = lambda _: None,
) -> AgreedBaselines:
    """Register a map's baselines on each other, make their labels consistent, and write the resulting map.

    Stations are copied as stored; their poses change, and with them the tiles. Baselines without connections are
    unchanged. The sigmas of the labels are those of the old map: if baselines agree on a mean of their labels, the mean
    of their sigmas, taken as independent, is the sigma of that mean.

    Args:
        source: map.
        plan: plan of the matches (``plan_matches``).
        output: path of the new map.
        force: whether to replace an existing output.
        progress: function called with the number of matches done since the last call; each is done twice.
        stage: function called with each step after the last match.

    Raises:
        InputError: the output exists or cannot be written, or the map holds damage.
    """
    # Hashed now: an update may replace the file while this one reads on in the open one.
    digest = file_hash(source.path)
    with MapWriter.create(output, force=force) as writer:
        agreed = agree_twice(source, plan, progress)
        copy_stations(source, writer, agreed.pose)
        frames, references_m = _tiles(agreed.pose, source.drive, source.description.tile_spacing_m)
        name = Path(output).name.removesuffix(".map.h5")
        writer.finish(
            source.description._replace(name=name),
            frames,
            references_m,
            _provenance(source, digest, agreed),
            retired=source.retired,
        )
        stage(MEASURING)
        writer.add_chance(measure_chance)
    return agreed


def agree_twice(source: MapFile, plan: MatchPlan, progress: Callable[[int], None] = lambda _: None) -> AgreedBaselines:
    """Align baselines by matches in a wide region around their labels, then by matches around the corrected labels.

    Args:
        source: map.
        plan: plan of the matches.
        progress: function called with the number of matches done since the last call; each is done twice.
    """
    first = agree_baselines(source, match_passes(source, plan, progress))
    correction = (first.pose - source.pose)[:, [0, 1, 3]]
    return agree_baselines(source, match_again(source, plan, correction, progress))


def _tiles(
    pose: Float[np.ndarray, "scan 5"], drive: Int[np.ndarray, " scan"], spacing_m: float
) -> tuple[Float[np.ndarray, "tile 3"], Float[np.ndarray, " tile"]]:
    """Tile frames along the corrected baselines, placed as when building a map, and the height of each."""
    placer = TilePlacer(spacing_m)
    references: list[float] = []
    for number in range(int(drive.max()) + 1):
        own = pose[drive == number]
        for low in range(0, len(own), _BLOCK):
            block = own[low : low + _BLOCK]
            references += [float(np.median(block[:, 2]))] * placer.place(block)
    return placer.frames, np.asarray(references)


def _provenance(source: MapFile, digest: str, agreed: AgreedBaselines) -> dict[str, object]:
    steps = source.provenance.get("steps")
    refined = {
        "map": source.path.name,
        "sha256": digest,
        "matches_used": agreed.used,
        "matches_kept": agreed.kept,
        "noise_scale": round(agreed.noise_scale, 3),
        "moved_rms_m": [round(change.moved_rms_m, 4) for change in agreed.baselines],
        "tied": [change.kept > 0 for change in agreed.baselines],
    }
    return {
        **source.provenance,
        "program": f"lgprjax {__version__}",
        "steps": [*(steps if isinstance(steps, list) else []), "labels made consistent by a pose graph"],
        "refined": refined,
    }


def baseline_files(source: MapFile) -> list[str]:
    """File names of the drives that a map was built from, if known."""
    inputs = source.provenance.get("inputs")
    rows = inputs if isinstance(inputs, list) else []
    said = [str(row["file"]) for row in rows if isinstance(row, dict) and "file" in row]
    drives = len(source.description.label_sigma_m)
    return said if len(said) == drives else ["unnamed in the map"] * drives


def agreement_in_words(agreed: AgreedBaselines, files: Sequence[str]) -> list[str]:
    """Description of the alignment, one line per result; ``files`` from ``baseline_files``."""
    share = 100.0 * (1.0 - agreed.kept / agreed.used) if agreed.used else 0.0
    before, after = agreed.before, agreed.after
    tried = (
        f"{agreed.tried} positions searched on earlier passes, {agreed.matched} matched, {agreed.used} of them "
        f"supported, {share:.1f} % of these rejected; their sigmas times {agreed.noise_scale:.2f}"
    )
    if not agreed.kept:
        return [tried, "no matches connect the baselines of this map: all labels are unchanged"]
    moved = (
        f"before: matches {before.rms_m:.3f} m RMS (median of all {before.median_m:.3f}) from their labels; after: "
        f"{after.rms_m:.3f} m ({after.median_m:.3f}) from the corrected labels"
    )
    return [
        tried,
        moved,
        *(
            f"baseline {change.drive} ({files[change.drive]}) is not connected: its labels are unchanged"
            for change in agreed.baselines
            if not change.kept
        ),
    ]
