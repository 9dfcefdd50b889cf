"""Changes found by a map's new baseline: matches on each old baseline alone, verdicts, and marks of stations."""

from itertools import pairwise
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from lgprjax.batch.chance import KeptStations
from lgprjax.formats import MapFile
from lgprjax.mapping.matching import match_stations, signal_about
from lgprjax.mapping.verify import WEAK_REPEATS
from lgprjax.recordings.verdicts import runs
from lgprjax.registration import Code, RegisterOptions, ground_map_for
from lgprjax.subsurface import GroundMap, SpatialIndex, coherence_lags

# Changed ground, decided place by place along a new baseline, from its matches with each of the others.
#
# A single drive that does not match may have recorded snow, water or a fault. The old ground is retired only
# where a second drive, also newer, agrees with the new one. Until then the new drive's own stations there are held
# back: nothing shows that they are better than those they contradict.

PLACE_M = 0.5
"""Spacing of places along a baseline: neighbours share about half of their ground's detail."""

_DIFFERS = 0.6  # of the drive's usual score: on other ground the best of a small search reaches half of it
_AGREES = 0.75
_PLACED_M = 0.2  # a match farther off than this shows that the labels do not agree, whatever the ground
_LEAST_M = 1.5  # of ground that differs
_BRIDGED = 2  # places: chance may raise one or two among those that differ
_HALF = 0.5  # share of the places of a stretch that must be conclusive


class Evidence(NamedTuple):
    """Evidence of a new baseline's places about the earlier baselines.

    Attributes:
        at_m: position of each place along the new baseline.
        score: score of the place's match on each baseline's ground alone; NaN without ground, or without a signal.
        apart_m: distance of the match from its label.
        in_force: whether that baseline's ground is in force there.
        sure: whether the place is known from fixes before and after it, and its signal is ground.
        newer: whether drive (row) is newer than drive (column), by their dates; the last one is the new baseline. False
            without dates.
    """

    at_m: Float[np.ndarray, " place"]
    score: Float[np.ndarray, "drive place"]
    apart_m: Float[np.ndarray, "drive place"]
    in_force: Bool[np.ndarray, "drive place"]
    sure: Bool[np.ndarray, " place"]
    newer: Bool[np.ndarray, "drive_and_new drive_and_new"]


class ChangedGround(NamedTuple):
    """A stretch where the new baseline does not match an old one.

    Attributes:
        start_m, stop_m: start and end along the new baseline.
        first, last: numbers of the first and last place, both included.
        drive: number of the old baseline.
        score: median score of the matches there.
        agreeing: newer baselines that the new one matches there: together they outvote the old one. Empty if the ground
            may be changed or only disturbed.
    """

    start_m: float
    stop_m: float
    first: int
    last: int
    drive: int
    score: float
    agreeing: tuple[int, ...]


class GroundVerdict(NamedTuple):
    """Verdict on a new baseline's evidence.

    Attributes:
        changed: stretches, by old baseline.
        held: places of the new baseline that only contradict others, and are held back.
        confirmed: places of each old baseline that the new one agrees with: held-back stations there come into force.
        usual: score of the new baseline's matches; NaN where it matches nothing.
    """

    changed: tuple[ChangedGround, ...]
    held: Bool[np.ndarray, " place"]
    confirmed: Bool[np.ndarray, "drive place"]
    usual: float


def usual_score(score: Float[np.ndarray, "drive place"], sure: Bool[np.ndarray, " place"]) -> float:
    """Median, over the known places, of the best match there; NaN without any."""
    best = np.max(np.where(np.isfinite(score), score, -np.inf), axis=0, initial=-np.inf)
    best = best[sure & np.isfinite(best)]
    return float(np.median(best)) if len(best) else float("nan")


def differing(score: Float[np.ndarray, "drive place"], usual: float) -> Bool[np.ndarray, "drive place"]:
    """Places whose matches, like those of their neighbours, are so weak that the ground must differ."""
    return np.asarray(_median_of_three(score) < _DIFFERS * usual)


def judge_ground(evidence: Evidence) -> GroundVerdict:
    """Decide which stretches have changed, and which of the new baseline's places are held back."""
    score = _median_of_three(evidence.score)
    usual = usual_score(evidence.score, evidence.sure)
    low = (score < _DIFFERS * usual) & evidence.sure
    high = (score >= _AGREES * usual) & (evidence.apart_m <= _PLACED_M)
    confirmed = high.copy()
    # Ground that agrees with a baseline of that date or older has not changed since: a weak match has another reason.
    count = len(score)
    dated = evidence.newer[count, :count]
    for old in np.flatnonzero(dated):
        as_old = dated & ~evidence.newer[:count, old]
        low[old] &= ~np.any((high & evidence.in_force)[as_old], axis=0)
    in_force, contradicted = evidence.in_force.copy(), np.zeros(len(evidence.at_m), bool)
    changed = []
    for drive in range(len(score)):
        for first, last in runs(_bridged(low[drive])):
            span = slice(first, last + 1)
            if (last + 1 - first) * PLACE_M < _LEAST_M or not in_force[drive, span].any():
                continue
            agreeing = _agreeing(evidence, score[:, span], evidence.apart_m[:, span], usual, drive)
            start_m, stop_m = float(evidence.at_m[first]) - PLACE_M / 2, float(evidence.at_m[last]) + PLACE_M / 2
            middle = float(np.nanmedian(score[drive, span]))
            changed.append(
                ChangedGround(
                    start_m=start_m, stop_m=stop_m, first=first, last=last, drive=drive, score=middle, agreeing=agreeing
                )
            )
            in_force[drive, span] &= not agreeing
            for other in agreeing:
                confirmed[other, span] |= np.isfinite(score[other, span])
                in_force[other, span] |= confirmed[other, span]
            contradicted[span] |= not agreeing
    held = contradicted & ~np.any(high & in_force, axis=0)
    return GroundVerdict(tuple(changed), held, confirmed & ~held, usual)


def _agreeing(
    evidence: Evidence,
    score: Float[np.ndarray, "drive part"],
    apart_m: Float[np.ndarray, "drive part"],
    usual: float,
    old: int,
) -> tuple[int, ...]:
    """Baselines newer than an old one that the new one, newer too, matches over most of a stretch."""
    new = len(score)
    out = []
    for drive in np.flatnonzero(evidence.newer[:new, old] & evidence.newer[new, old]):
        known_match = np.isfinite(score[drive])
        if known_match.mean() < _HALF or np.median(apart_m[drive, known_match]) > _PLACED_M:
            continue
        if np.median(score[drive, known_match]) >= _AGREES * usual:
            out.append(int(drive))
    return tuple(out)


def _median_of_three(score: Float[np.ndarray, "drive place"]) -> Float[np.ndarray, "drive place"]:
    """Median of each place and its two neighbours, the lower one of two; NaN stays NaN."""
    padded = np.pad(score, [(0, 0), (1, 1)], constant_values=np.nan)
    about = np.sort(np.stack([padded[:, :-2], padded[:, 1:-1], padded[:, 2:]]), axis=0)  # NaN goes last
    known = np.isfinite(about).sum(axis=0)
    middle = np.take_along_axis(about, (np.maximum(known - 1, 0) // 2)[None], axis=0)[0]
    return np.asarray(np.where(np.isfinite(score), middle, np.nan))


def _bridged(low: Bool[np.ndarray, " place"]) -> Bool[np.ndarray, " place"]:
    """Stretches that differ, joined across few places."""
    out, stretches = low.copy(), runs(low)
    for (_, before), (after, _) in pairwise(stretches):
        if after - before - 1 <= _BRIDGED:
            out[before:after] = True
    return out


# Matches of one baseline's stations on the ground of another alone, place by place along the first.

_SEARCH_M = 0.5
"""Half side of the search around labels known to decimetres: on other ground the best of few places scores low."""
_LEAST_SHARE = 0.35  # of the array over the other's ground
_REACH_M = 0.5  # to each side of a place, whose signal is used


class BaselinePlaces(NamedTuple):
    """Places along one baseline, half a metre apart.

    Attributes:
        drive: number of the baseline.
        at_m: position along its track.
        station: station nearest to each place.
        pose: pose of that station.
        of_station: all stations of the baseline, and the place of each.
    """

    drive: int
    at_m: Float[np.ndarray, " place"]
    station: Int[np.ndarray, " place"]
    pose: Float[np.ndarray, "place 5"]
    of_station: tuple[Int[np.ndarray, " scan"], Int[np.ndarray, " scan"]]


def lay_places(source: MapFile, drive: int) -> BaselinePlaces:
    """Places along a baseline, none in gaps of its stations."""
    own = np.flatnonzero(source.drive == drive)
    pose = source.pose[own]
    path = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(pose[:, :2], axis=0).T))])
    cell = (path / PLACE_M).astype(np.int64)
    held, place = np.unique(cell, return_inverse=True)
    at_m = (held + 0.5) * PLACE_M
    # The middle station of each cell.
    first = np.searchsorted(cell, held)
    last = np.searchsorted(cell, held, side="right")
    middle = (first + last) // 2
    return BaselinePlaces(drive, at_m, own[middle], pose[middle], (own, place))


class NearPlaces:
    """Stations of a map near the places of one baseline.

    Args:
        source: map.
        places: places of the baseline.
    """

    def __init__(self, source: MapFile, places: BaselinePlaces) -> None:
        self._source, self._places = source, places
        self.width_m = source.description.array_width_m
        self._index = SpatialIndex(places.pose[:, :2], 8.0)

    def nearest_stations(self, kept: Bool[np.ndarray, " scan"], within_m: float) -> Int[np.ndarray, " place"]:
        """Nearest of some stations to each place; -1 if none is close enough."""
        numbers = np.flatnonzero(kept)
        if not len(numbers):
            return np.full(len(self._places.at_m), -1)
        index = SpatialIndex(self._source.pose[numbers, :2], 8.0)
        found = [index.nearest(point, within_m) for point in self._places.pose[:, :2]]
        return np.array([-1 if number is None else numbers[number] for number in found], np.int64)

    def stations_at(self, chosen: Bool[np.ndarray, " place"], kept: Bool[np.ndarray, " scan"]) -> Int[np.ndarray, " _"]:
        """The stations whose nearest place, within an array's width, is one of the chosen."""
        if not chosen.any():
            return np.zeros(0, np.int64)
        around = self._places.pose[chosen, :2]
        pose = self._source.pose[:, :2]
        low, high = around.min(axis=0) - self.width_m, around.max(axis=0) + self.width_m
        near = np.flatnonzero(kept & np.all((pose >= low) & (pose <= high), axis=1))
        place = [self._index.nearest(point, self.width_m) for point in pose[near]]
        taken = np.array([number is not None and bool(chosen[number]) for number in place], bool)
        return np.asarray(near[taken])


class Scores(NamedTuple):
    """Best matches of stations; NaN if less than a third of the array is over the ground.

    Attributes:
        score: correlation times the root of the overlap.
        apart_m: distance from the station's label.
    """

    score: Float[np.ndarray, " place"]
    apart_m: Float[np.ndarray, " place"]


def scores_on(source: MapFile, stations: Int[np.ndarray, " place"], kept: Bool[np.ndarray, " scan"]) -> Scores:
    """Match stations on the ground of others, around their labels.

    Args:
        source: map.
        stations: stations in order along their baseline.
        kept: mask of the stations that form the ground.
    """
    score, apart_m = np.full(len(stations), np.nan), np.full(len(stations), np.nan)
    if not kept.any() or not len(stations):
        return Scores(score, apart_m)
    options = RegisterOptions(search_m=_SEARCH_M)
    ground = ground_map_for(KeptStations(source, kept), options)
    point_m = source.pose[stations, :2]
    tile = np.array([-1 if (n := ground.tile_near(point, _SEARCH_M)) is None else n for point in point_m], np.int64)
    for run in np.split(np.arange(len(tile)), np.flatnonzero(np.diff(tile)) + 1):
        if tile[run[0]] < 0:
            continue
        match = match_stations(source, ground, int(tile[run[0]]), stations[run], options)
        known_match = (match.share >= _LEAST_SHARE) & (match.code != Code.OFF_MAP) & (match.code != Code.NON_FINITE)
        score[run] = np.where(known_match, match.score, np.nan)
        apart_m[run] = np.where(known_match, np.hypot(match.along_m, match.cross_m), np.nan)
    return Scores(score, apart_m)


def repeats_at(source: MapFile, ground: GroundMap, stations: Int[np.ndarray, " place"]) -> Float[np.ndarray, " place"]:
    """Share of the signal around stations that is ground, i.e. repeats an eighth of a wavelength farther."""
    settings = source.description.settings
    reach, lag = max(1, round(_REACH_M / settings.step_m)), coherence_lags(settings, 0.0)[0]
    found = [signal_about(source, ground, int(station), reach, lag).repeats for station in stations]
    return np.array(found, np.float64)


_UNKNOWN_M = 1.5  # largest error of labels without a fix, to be compared with other ground


class StationMarks(NamedTuple):
    """Stations of a map that are out of force, and since when.

    Attributes:
        retired: number of the update that retired each station, 0 while it is in force.
        added_by: number of the update that added each baseline, 0 for those that the map was built from. A station
            retired by its own update is held back and may come into force later.
    """

    retired: Int[np.ndarray, " scan"]
    added_by: tuple[int, ...]

    def held_back(self, drive: Int[np.ndarray, " scan"]) -> Bool[np.ndarray, " scan"]:
        """Stations of these baselines held back until a second drive agrees with them."""
        return np.asarray((self.retired > 0) & (self.retired == np.asarray(self.added_by)[drive]))


class BaselineChanges(NamedTuple):
    """Result of an update's comparison of the ground.

    Attributes:
        verdict: verdict for each place of the new baseline.
        marks: marks after the update.
        retired: number of stations of the old baselines taken out of force.
        released: number of stations that were held back and are in force now.
        score: score of the new baseline's places on each old one's ground alone.
    """

    verdict: GroundVerdict
    marks: StationMarks
    retired: int
    released: int
    score: Float[np.ndarray, "drive place"]


def find_changes(
    source: MapFile,
    places: BaselinePlaces,
    corrected: Bool[np.ndarray, " place"],
    between: Bool[np.ndarray, " place"],
    marks: StationMarks,
    newer: Bool[np.ndarray, "drive drive"],
) -> BaselineChanges:
    """Compare a map's last baseline with each of the others, and mark stations accordingly.

    Args:
        source: map with the new baseline, all of its stations in force.
        places: places of the new baseline.
        corrected: mask of places whose labels fixes have corrected.
        between: mask of corrected places with fixes before and after.
        marks: marks before the update, for all stations and baselines of ``source``, the new one's in force.
        newer: whether baseline (row) was recorded later than baseline (column).
    """
    new, drive = places.drive, source.drive
    update = marks.added_by[new]
    near = NearPlaces(source, places)
    usable = (marks.retired == 0) | marks.held_back(drive)
    count = len(places.at_m)
    score, apart_m = np.full((2, new, count), np.nan)
    in_force = np.zeros((new, count), bool)
    nearest = np.full((new, count), -1)
    for other in range(new):
        kept = usable & (drive == other)
        nearest[other] = near.nearest_stations(kept, near.width_m)
        beside = np.flatnonzero((nearest[other] >= 0) & corrected)
        score[other, beside], apart_m[other, beside] = scores_on(source, places.station[beside], kept)
        in_force[other] = (nearest[other] >= 0) & (marks.retired[np.maximum(nearest[other], 0)] == 0)
    score, sure = _with_signal(source, places, nearest, score, between)
    verdict = judge_ground(Evidence(places.at_m, score, apart_m, in_force, sure, newer))
    retired = marks.retired.copy()
    released = 0
    for other in range(new):
        freed = near.stations_at(verdict.confirmed[other], (drive == other) & marks.held_back(drive))
        released += len(freed)
        retired[freed] = 0
    for ground in verdict.changed:
        if ground.agreeing:
            chosen = np.zeros(count, bool)
            chosen[ground.first : ground.last + 1] = True
            retired[near.stations_at(chosen, (drive == ground.drive) & (marks.retired == 0))] = update
    # An unknown place would be compared with the ground of another.
    old = (drive != new) & (marks.retired == 0)
    unknown = ~corrected & (near.nearest_stations(old, near.width_m + _UNKNOWN_M) >= 0)
    stations, place = places.of_station
    retired[stations[(verdict.held | unknown)[place]]] = update
    taken = int(np.count_nonzero((retired == update) & (drive != new)))
    return BaselineChanges(verdict, marks._replace(retired=retired), taken, released, score)


def _with_signal(
    source: MapFile,
    places: BaselinePlaces,
    nearest: Int[np.ndarray, "drive place"],
    score: Float[np.ndarray, "drive place"],
    between: Bool[np.ndarray, " place"],
) -> tuple[Float[np.ndarray, "drive place"], Bool[np.ndarray, " place"]]:
    """Matches and places whose differences are not due to noise."""
    low = differing(score, usual_score(score, between)) & between
    if not low.any():
        return score, between
    ground = ground_map_for(source, RegisterOptions(search_m=1.5))
    at = np.flatnonzero(low.any(axis=0))
    sure, out = between.copy(), score.copy()
    sure[at] &= repeats_at(source, ground, places.station[at]) >= WEAK_REPEATS
    for drive, place in zip(*np.nonzero(low & sure), strict=True):
        if repeats_at(source, ground, nearest[drive, place : place + 1])[0] < WEAK_REPEATS:
            out[drive, place] = np.nan
    return out, sure


# Measures for the weights of a map's baselines, computed where missing: agreement in pairs, and signal.

_SAMPLES = 40
"""Places at which a pair of baselines is compared, spread over the shared stretch."""
_LEAST_SAMPLES = 5


def agreement_with(
    source: MapFile,
    in_force: Bool[np.ndarray, " scan"],
    known: Float[np.ndarray, "known known"],
    score: Float[np.ndarray, "drive place"],
) -> Float[np.ndarray, "drive_and_new drive_and_new"]:
    """Median score of the matches of every two baselines; NaN if they share less than a few metres.

    Args:
        source: map with the new baseline as the last one.
        in_force: mask of stations to compare.
        known: agreement of its first baselines, measured before, which is kept.
        score: score of the new baseline's places on the ground of each of the others.
    """
    drives = len(score)
    out = np.full((drives + 1, drives + 1), np.nan)
    measured = min(len(known), drives)
    out[:measured, :measured] = known[:measured, :measured]
    for later in range(max(measured, 1), drives):
        places = lay_places(source, later)
        near = NearPlaces(source, places)
        for earlier in range(later):
            kept = in_force & (source.drive == earlier)
            shared = (near.nearest_stations(kept, 0.5 * near.width_m) >= 0) & in_force[places.station]
            chosen = places.station[_spread(np.flatnonzero(shared))]
            out[later, earlier] = out[earlier, later] = _median_of_enough(scores_on(source, chosen, kept).score)
    out[drives, :drives] = out[:drives, drives] = [_median_of_enough(row) for row in score]
    return out


def _median_of_enough(score: Float[np.ndarray, " place"]) -> float:
    known_match = score[np.isfinite(score)]
    return float(np.median(known_match)) if len(known_match) >= _LEAST_SAMPLES else float("nan")


def repeats_of(
    source: MapFile, in_force: Bool[np.ndarray, " scan"], known: Float[np.ndarray, " drive"]
) -> Float[np.ndarray, " drive"]:
    """Median share of each baseline's signal that is ground; measured where it is NaN in ``known``."""
    out = known.copy()
    missing = np.flatnonzero(~np.isfinite(out))
    if len(missing):
        ground = ground_map_for(source, RegisterOptions(search_m=1.5))
        for drive in missing:
            stations = lay_places(source, int(drive)).station
            chosen = stations[_spread(np.flatnonzero(in_force[stations]))]
            if len(chosen):
                out[drive] = float(np.median(repeats_at(source, ground, chosen)))
    return out


def _spread(numbers: Int[np.ndarray, " place"]) -> Int[np.ndarray, " sample"]:
    """At most ``_SAMPLES`` of some numbers, spread from the first to the last."""
    if len(numbers) <= _SAMPLES:
        return numbers
    return np.asarray(numbers[np.linspace(0, len(numbers) - 1, _SAMPLES).astype(int)])
