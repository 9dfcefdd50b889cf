"""What a map's new baseline says of the old ones: matched on each alone, judged, and put into marks of stations."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from lgprjax.archive.baseline_strengths import BaselinePlaces, NearPlaces, repeats_at, strengths_on
from lgprjax.archive.ground_changes import Evidence, GroundVerdict, differing, judge_ground, usual_strength
from lgprjax.archive.map_findings import WEAK_REPEATS
from lgprjax.formats import MapFile
from lgprjax.registration import RegisterOptions, ground_map_for

_UNKNOWN_M = 1.5  # that labels which no fix has corrected may be off by, to be laid over other ground


class StationMarks(NamedTuple):
    """Which stations of a map are out of force, and since when.

    Attributes:
        retired: number of the update that took each station out of force, 0 while it is in force.
        added_by: number of the update that each baseline came with, 0 for those that the map was built from. A station
            that its own update took out is held back, and may come into force later.
    """

    retired: Int[np.ndarray, " scan"]
    added_by: tuple[int, ...]

    def held_back(self, drive: Int[np.ndarray, " scan"]) -> Bool[np.ndarray, " scan"]:
        """Stations, of these baselines, that wait for a second drive to agree with them."""
        return np.asarray((self.retired > 0) & (self.retired == np.asarray(self.added_by)[drive]))


class BaselineChanges(NamedTuple):
    """Outcome of an update's look at the ground.

    Attributes:
        verdict: by place of the new baseline.
        marks: after the update.
        retired: stations taken out of force, of the old baselines.
        released: stations that were held back and are in force now.
        strength: of the new baseline's places on each old one's ground alone.
    """

    verdict: GroundVerdict
    marks: StationMarks
    retired: int
    released: int
    strength: Float[np.ndarray, "drive place"]


def find_changes(
    source: MapFile,
    places: BaselinePlaces,
    corrected: Bool[np.ndarray, " place"],
    between: Bool[np.ndarray, " place"],
    marks: StationMarks,
    newer: Bool[np.ndarray, "drive drive"],
) -> BaselineChanges:
    """Compare a map's last baseline with each of the others, and mark what follows.

    Args:
        source: the map with the new baseline, all of its stations in force.
        places: of the new baseline.
        corrected: places whose labels fixes have corrected.
        between: those of them with fixes before and after.
        marks: before the update; for all stations and baselines of ``source``, the new one's in force.
        newer: which baseline (row) was recorded later than which (column).
    """
    new, drive = places.drive, source.drive
    update = marks.added_by[new]
    near = NearPlaces(source, places)
    usable = (marks.retired == 0) | marks.held_back(drive)
    count = len(places.at_m)
    strength, apart_m = np.full((2, new, count), np.nan)
    in_force = np.zeros((new, count), bool)
    nearest = np.full((new, count), -1)
    for other in range(new):
        kept = usable & (drive == other)
        nearest[other] = near.nearest_stations(kept, near.width_m)
        beside = np.flatnonzero((nearest[other] >= 0) & corrected)
        strength[other, beside], apart_m[other, beside] = strengths_on(source, places.station[beside], kept)
        in_force[other] = (nearest[other] >= 0) & (marks.retired[np.maximum(nearest[other], 0)] == 0)
    strength, sure = _with_signal(source, places, nearest, strength, between)
    verdict = judge_ground(Evidence(places.at_m, strength, apart_m, in_force, sure, newer))
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
    # A place that is not known would be laid over the ground of another.
    old = (drive != new) & (marks.retired == 0)
    unknown = ~corrected & (near.nearest_stations(old, near.width_m + _UNKNOWN_M) >= 0)
    stations, place = places.of_station
    retired[stations[(verdict.held | unknown)[place]]] = update
    taken = int(np.count_nonzero((retired == update) & (drive != new)))
    return BaselineChanges(verdict, marks._replace(retired=retired), taken, released, strength)


def _with_signal(
    source: MapFile,
    places: BaselinePlaces,
    nearest: Int[np.ndarray, "drive place"],
    strength: Float[np.ndarray, "drive place"],
    between: Bool[np.ndarray, " place"],
) -> tuple[Float[np.ndarray, "drive place"], Bool[np.ndarray, " place"]]:
    """Matches and places of which noise is not the reason that they differ."""
    low = differing(strength, usual_strength(strength, between)) & between
    if not low.any():
        return strength, between
    ground = ground_map_for(source, RegisterOptions(search_m=1.5))
    at = np.flatnonzero(low.any(axis=0))
    sure, out = between.copy(), strength.copy()
    sure[at] &= repeats_at(source, ground, places.station[at]) >= WEAK_REPEATS
    for drive, place in zip(*np.nonzero(low & sure), strict=True):
        if repeats_at(source, ground, nearest[drive, place : place + 1])[0] < WEAK_REPEATS:
            out[drive, place] = np.nan
    return out, sure
