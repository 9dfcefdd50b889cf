"""How well the stations of one baseline match the ground of another alone, place by place along the first."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from lgprjax.archive.ground_changes import PLACE_M
from lgprjax.archive.map_matching import KeptStations, match_stations, signal_about
from lgprjax.formats import MapFile
from lgprjax.registration import Code, RegisterOptions, ground_map_for
from lgprjax.subsurface import GroundMap, SpatialIndex, coherence_lags

_SEARCH_M = 0.5
"""Half side of the search about labels that are known to decimetres: the best of few places is low on other ground."""
_LEAST_SHARE = 0.35  # of the array over the other's ground
_REACH_M = 0.5  # to both sides of a place, whose signal is looked at


class BaselinePlaces(NamedTuple):
    """Places along one baseline, half a metre apart.

    Attributes:
        drive: number of the baseline.
        at_m: along its track.
        station: nearest to each place.
        pose: of that station.
        of_station: all of its stations, and the place that each belongs to.
    """

    drive: int
    at_m: Float[np.ndarray, " place"]
    station: Int[np.ndarray, " place"]
    pose: Float[np.ndarray, "place 5"]
    of_station: tuple[Int[np.ndarray, " scan"], Int[np.ndarray, " scan"]]


def lay_places(source: MapFile, drive: int) -> BaselinePlaces:
    """Places along a baseline; gaps of its stations have none."""
    own = np.flatnonzero(source.drive == drive)
    pose = source.pose[own]
    path = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(pose[:, :2], axis=0).T))])
    cell = (path / PLACE_M).astype(np.int64)
    held, place = np.unique(cell, return_inverse=True)
    at_m = (held + 0.5) * PLACE_M
    # The middle one of the stations of each cell.
    first = np.searchsorted(cell, held)
    last = np.searchsorted(cell, held, side="right")
    middle = (first + last) // 2
    return BaselinePlaces(drive, at_m, own[middle], pose[middle], (own, place))


class NearPlaces:
    """Which stations of a map stand near the places of one baseline.

    Args:
        source: the map.
        places: of the baseline.
    """

    def __init__(self, source: MapFile, places: BaselinePlaces) -> None:
        self._source, self._places = source, places
        self.width_m = source.description.array_width_m
        self._index = SpatialIndex(places.pose[:, :2], 8.0)

    def nearest_stations(self, kept: Bool[np.ndarray, " scan"], within_m: float) -> Int[np.ndarray, " place"]:
        """Nearest of some stations to each place; -1 where none is so near."""
        numbers = np.flatnonzero(kept)
        if not len(numbers):
            return np.full(len(self._places.at_m), -1)
        index = SpatialIndex(self._source.pose[numbers, :2], 8.0)
        found = [index.nearest(point, within_m) for point in self._places.pose[:, :2]]
        return np.array([-1 if number is None else numbers[number] for number in found], np.int64)

    def stations_at(self, chosen: Bool[np.ndarray, " place"], kept: Bool[np.ndarray, " scan"]) -> Int[np.ndarray, " _"]:
        """Those of some stations whose nearest place, within an array's width, is one of the chosen."""
        if not chosen.any():
            return np.zeros(0, np.int64)
        around = self._places.pose[chosen, :2]
        pose = self._source.pose[:, :2]
        low, high = around.min(axis=0) - self.width_m, around.max(axis=0) + self.width_m
        near = np.flatnonzero(kept & np.all((pose >= low) & (pose <= high), axis=1))
        place = [self._index.nearest(point, self.width_m) for point in pose[near]]
        taken = np.array([number is not None and bool(chosen[number]) for number in place], bool)
        return np.asarray(near[taken])


class Strengths(NamedTuple):
    """Best matches of stations; NaN where less than a third of the array is over the ground.

    Attributes:
        strength: correlation times the root of the overlap.
        apart_m: from where the labels put the station.
    """

    strength: Float[np.ndarray, " place"]
    apart_m: Float[np.ndarray, " place"]


def strengths_on(source: MapFile, stations: Int[np.ndarray, " place"], kept: Bool[np.ndarray, " scan"]) -> Strengths:
    """Match stations on the ground of others, about where their labels put them.

    Args:
        source: the map.
        stations: in order along their baseline.
        kept: the stations that make the ground.
    """
    strength, apart_m = np.full(len(stations), np.nan), np.full(len(stations), np.nan)
    if not kept.any() or not len(stations):
        return Strengths(strength, apart_m)
    options = RegisterOptions(search_m=_SEARCH_M)
    ground = ground_map_for(KeptStations(source, kept), options)
    point_m = source.pose[stations, :2]
    tile = np.array([-1 if (n := ground.tile_near(point, _SEARCH_M)) is None else n for point in point_m], np.int64)
    for run in np.split(np.arange(len(tile)), np.flatnonzero(np.diff(tile)) + 1):
        if tile[run[0]] < 0:
            continue
        match = match_stations(source, ground, int(tile[run[0]]), stations[run], options)
        told = (match.share >= _LEAST_SHARE) & (match.code != Code.OFF_MAP) & (match.code != Code.NON_FINITE)
        strength[run] = np.where(told, match.strength, np.nan)
        apart_m[run] = np.where(told, np.hypot(match.along_m, match.cross_m), np.nan)
    return Strengths(strength, apart_m)


def repeats_at(source: MapFile, ground: GroundMap, stations: Int[np.ndarray, " place"]) -> Float[np.ndarray, " place"]:
    """Share of the signal about stations that is ground: it repeats an eighth of a wavelength farther."""
    settings = source.description.settings
    reach, lag = max(1, round(_REACH_M / settings.step_m)), coherence_lags(settings, 0.0)[0]
    found = [signal_about(source, ground, int(station), reach, lag).repeats for station in stations]
    return np.array(found, np.float64)
