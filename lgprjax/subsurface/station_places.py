"""Where a map's stations stand: short stretches are held in memory, the stations themselves read where they are needed.

A stretch takes 56 bytes for up to sixteen stations, so that a map of any length is opened at once; whoever needs the
stations about a point reads those of the few stretches that come near it.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from lgprjax.subsurface.index import SpatialIndex

_STATIONS = 16
_GAP = 4.0
"""Stations this many usual steps apart belong to two stretches."""
_CELL_M = 8.0
_NEARER = (1.0 / 16.0, 0.25, 1.0)
"""Of the radius, one after the other: most points lie beside a track."""
_POINTS = 256


class Places(NamedTuple):
    """Where stations stand.

    Attributes:
        pose: east_m, north_m, height_m above the ground, yaw_rad and roll_rad of the array's centre.
        ground_up_m: up coordinate of the ground under the array.
        drive: number of the baseline.
    """

    pose: Float[np.ndarray, "scan 5"]
    ground_up_m: Float[np.ndarray, " scan"]
    drive: Int[np.ndarray, " scan"]


class Stretches(NamedTuple):
    """Consecutive stations of one baseline, up to sixteen, without a gap.

    Attributes:
        first: number of the first station; a stretch ends where the next one begins.
        chord_m: east and north of the first and of the last station.
        reach_m: no station of the stretch is farther than this from the middle of the chord.
    """

    first: Int[np.ndarray, " stretch"]
    chord_m: Float[np.ndarray, "stretch 2 2"]
    reach_m: Float[np.ndarray, " stretch"]


def stretches_of(place_m: Float[np.ndarray, "scan 2"], drive: Int[np.ndarray, " scan"], first: int = 0) -> Stretches:
    """Consecutive stations in stretches.

    Args:
        place_m: east and north of the stations.
        drive: their baselines.
        first: number of the first of them.
    """
    stations = np.arange(len(place_m))
    step_m = np.hypot(*np.diff(place_m, axis=0).T)
    begins = np.ones(len(place_m), bool)
    if len(step_m):
        begins[1:] = (step_m > _GAP * np.median(step_m)) | (np.diff(drive) != 0)
    run = np.maximum.accumulate(np.where(begins, stations, 0))
    starts = np.flatnonzero((stations - run) % _STATIONS == 0)
    ends = np.append(starts[1:], len(place_m))
    chord_m = np.stack([place_m[starts], place_m[ends - 1]], axis=1)
    middle_m = np.repeat(chord_m.mean(axis=1), ends - starts, axis=0)
    apart_m = np.hypot(*(place_m - middle_m).T)
    return Stretches(first + starts, chord_m, np.maximum.reduceat(apart_m, starts))


class StationPlaces:
    """All stations of a map by their places.

    Args:
        stretches: of the map, rising.
        stations: of the map.
        read: places of the stations with these rising numbers.
    """

    def __init__(self, stretches: Stretches, stations: int, read: Callable[[Int[np.ndarray, " scan"]], Places]) -> None:
        self.stretches = stretches
        self._bounds = np.append(stretches.first, stations)
        self._middle_m = stretches.chord_m.mean(axis=1)
        self._index = SpatialIndex(self._middle_m, _CELL_M)
        self._longest_m = float(stretches.reach_m.max(initial=0.0))
        self._read = read

    @staticmethod
    def held(places: Places) -> "StationPlaces":
        """Places that are in memory."""
        stretches = stretches_of(places.pose[:, :2], places.drive)
        return StationPlaces(
            stretches, len(places.pose), lambda stations: Places(*(field[stations] for field in places))
        )

    def __len__(self) -> int:
        """Stations of the map."""
        return int(self._bounds[-1])

    def read(self, stations: Int[np.ndarray, " scan"]) -> Places:
        """Places of the stations with these rising numbers."""
        return self._read(stations)

    def near(self, point_m: Float[np.ndarray, "2"], radius_m: float) -> Int[np.ndarray, " found"]:
        """Numbers, rising, of the stations within ``radius_m`` of a point."""
        numbers = self._stations_of(np.sort(self.stretches_near(point_m[None], radius_m)[1]))
        apart = self.read(numbers).pose[:, :2] - point_m
        return np.asarray(numbers[np.sum(apart**2, axis=1) <= radius_m**2])

    def nearest(self, points_m: Float[np.ndarray, "point 2"], radius_m: float) -> Int[np.ndarray, " point"]:
        """Number of the station nearest to each point (the lowest of equals), -1 where none is within ``radius_m``."""
        out = np.full(len(points_m), -1)
        for share in _NEARER:
            left = np.flatnonzero(out < 0)
            for low in range(0, len(left), _POINTS):
                some = left[low : low + _POINTS]
                out[some] = self._nearest(points_m[some], share * radius_m)
        return out

    def stretches_near(
        self, points_m: Float[np.ndarray, "point 2"], radius_m: float
    ) -> tuple[Int[np.ndarray, " found"], Int[np.ndarray, " found"]]:
        """Stretches that may hold a station within ``radius_m`` of points: number of point (rising) and stretch."""
        point, stretch = self._index.near_each(points_m, radius_m + self._longest_m)
        apart_m = np.hypot(*(self._middle_m[stretch] - points_m[point]).T)
        within = apart_m <= radius_m + self.stretches.reach_m[stretch]
        return point[within], stretch[within]

    def _nearest(self, points_m: Float[np.ndarray, "point 2"], radius_m: float) -> Int[np.ndarray, " point"]:
        point, stretch = self.stretches_near(points_m, radius_m)
        station = self._stations_of(stretch)
        point = np.repeat(point, self._bounds[stretch + 1] - self._bounds[stretch])
        number, where = np.unique(station, return_inverse=True)
        square = np.sum((self.read(number).pose[where, :2] - points_m[point]) ** 2, axis=1)
        order = np.lexsort((station, square, point))
        order = order[square[order] <= radius_m**2]
        found, first = np.unique(point[order], return_index=True)
        out = np.full(len(points_m), -1)
        out[found] = station[order[first]]
        return out

    def _stations_of(self, stretch: Int[np.ndarray, " found"]) -> Int[np.ndarray, " scan"]:
        first = self._bounds[stretch]
        count = self._bounds[stretch + 1] - first
        before = np.cumsum(count) - count
        return np.asarray(np.repeat(first - before, count) + np.arange(int(count.sum())))
