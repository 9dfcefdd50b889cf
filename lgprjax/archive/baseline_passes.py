"""Baselines cut where they come back to their own ground, and which earlier pass each place is compared with.

A pass never meets itself: a lap of a closed course, or the way back after a turn, is a pass of its own and is matched
with the one before like any other baseline.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Int

from lgprjax.archive.map_route import places_of_drives
from lgprjax.formats import MapFile
from lgprjax.subsurface import SpatialIndex

STEP_M = 1.0
"""From match to match along a pass: farther than neighbouring matches share noise."""

_SAME_PASS_M = 20.0  # of path; what lies nearer behind is the same passage, round however tight a bend


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
        source: the map.
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
    """Which earlier passes each place is matched with: of those that come by the last, and the 2nd, 4th, 8th last.

    So the work grows with the logarithm of the number of passes, and any two passes over the same ground are joined by
    few steps.

    Args:
        source: the map.
        passes: of it.
        search_m: half side of the search about a label.
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
