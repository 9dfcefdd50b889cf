"""A walk along the routes of a map: ground, signal, likeness to itself, agreement of its baselines, place by place."""

from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from lgprjax.archive.map_matching import Matches, OtherBaselines, match_stations, signal_about
from lgprjax.archive.map_route import (
    DrivePlaces,
    Ground,
    Route,
    ground_at,
    mask_of,
    passes_at,
    places_of_drives,
    route_of,
)
from lgprjax.formats import MapFile
from lgprjax.registration import Code, RegisterOptions, ground_map_for, to_tile
from lgprjax.subsurface import GroundMap, SpatialIndex, coherence_lags

STEP_M = 1.0


class Signal(NamedTuple):
    """What the map's own traces say at each place of the route; NaN where no station is.

    Attributes:
        power: mean square of the gained traces about the place.
        repeats: their correlation with those an eighth of a wavelength farther: the share that is ground.
        likeness: strength of the best rival of the place's own scan within the search region, over its own.
        ambiguous: that scan, registered on the map, is declined for its rival.
    """

    power: Float[np.ndarray, " route"]
    repeats: Float[np.ndarray, " route"]
    likeness: Float[np.ndarray, " route"]
    ambiguous: Bool[np.ndarray, " route"]


class Agreement(NamedTuple):
    """Baselines against the ground of all others, one row a place of a baseline where both are.

    Attributes:
        drive: number of the baseline.
        route: nearest place of the route.
        match: of its station.
    """

    drive: Int[np.ndarray, " row"]
    route: Int[np.ndarray, " row"]
    match: Matches


class MapSurvey(NamedTuple):
    """Everything that was measured along a map.

    Attributes:
        route, ground, signal: place by place.
        agreement: of the baselines.
        beside: correlation of each channel with its right neighbour, over a whole baseline.
    """

    route: Route
    ground: Ground
    signal: Signal
    agreement: Agreement
    beside: Float[np.ndarray, "drive pair"]


def survey_map(source: MapFile, progress: Callable[[int], None] = lambda _: None) -> MapSurvey:
    """Walk along every baseline of a map.

    Tiles are gridded where they are needed and few are held; a few hundred bytes a place are kept.

    Args:
        source: the database.
        progress: told the number of places done since the last call, of ``places_of``.
    """
    options = RegisterOptions(search_m=1.5)
    drives = places_of_drives(source, STEP_M)
    route = route_of(drives, STEP_M)
    ground = ground_map_for(source, options)
    size = len(route.at_m)
    width, overlap = np.zeros(size), np.zeros(size)
    power, repeats, likeness = (np.full(size, np.nan) for _ in range(3))
    ambiguous = np.zeros(size, bool)
    for tile, at in _by_tile(ground, route.pose, options):
        mask = mask_of(ground.tile(tile))
        description = source.description
        for number, pose in zip(at, _in_tile(route.pose[at], ground.frame(tile)), strict=True):
            width[number], overlap[number] = ground_at(mask, pose, description.channels, description.channel_pitch_m)
        station = np.array([drives[route.drive[n]].station[route.place[n]] for n in at])
        held = station >= 0
        if held.any():
            match = match_stations(source, ground, tile, station[held], options)
            likeness[at[held]] = np.maximum(match.rival, 0.0) / np.maximum(match.strength, 1e-3)
            ambiguous[at[held]] = match.code == Code.AMBIGUOUS
        progress(len(at))
    beside = np.zeros((len(drives), max(source.description.channels - 1, 0), 2))
    nearest = SpatialIndex(route.pose[:, :2], 8.0)
    rows: list[Agreement] = []
    reach = max(1, round(0.5 * STEP_M / source.description.settings.step_m))
    lag = coherence_lags(source.description.settings, 0.0)[0]
    for drive, places in enumerate(drives):
        index_of = {int(place): n for n, place in enumerate(route.place) if route.drive[n] == drive}
        for place in np.flatnonzero(places.station >= 0):
            signal = signal_about(source, ground, int(places.station[place]), reach, lag)
            beside[drive] += signal.beside
            if int(place) in index_of:
                power[index_of[int(place)]], repeats[index_of[int(place)]] = signal.power, signal.repeats
        rows += _agreement(source, drive, places, nearest, options, progress)
    return MapSurvey(
        route,
        Ground(passes_at(source, route), width, overlap),
        Signal(power, repeats, likeness, ambiguous),
        _joined(rows),
        beside[..., 0] / np.maximum(beside[..., 1], 1e-30),
    )


def places_of(source: MapFile) -> int:
    """Places that ``survey_map`` reports as progress: those of the route, then those of every baseline."""
    drives = places_of_drives(source, STEP_M)
    return sum(int(places.fresh.sum()) + len(places.station) for places in drives)


def _agreement(
    source: MapFile,
    drive: int,
    places: DrivePlaces,
    nearest: SpatialIndex,
    options: RegisterOptions,
    progress: Callable[[int], None],
) -> list[Agreement]:
    """One baseline against the ground of all others, wherever one of them came by."""
    others = OtherBaselines(source, drive)
    rows: list[Agreement] = []
    if others.kept.any():
        index, radius_m = SpatialIndex(source.pose[others.kept, :2], 8.0), source.description.array_width_m
        near = np.array([index.nearest(point, radius_m) is not None for point in places.pose[:, :2]], dtype=bool)
        both = np.flatnonzero(near & (places.station >= 0))
        ground = ground_map_for(others, options)
        for tile, at in _by_tile(ground, places.pose[both], options):
            chosen = both[at]
            match = match_stations(source, ground, tile, places.station[chosen], options)
            route = [nearest.nearest(point, 2.0 * radius_m + STEP_M) for point in places.pose[chosen, :2]]
            numbers = np.array([-1 if number is None else number for number in route])
            rows.append(Agreement(np.full(len(chosen), drive), numbers, match))
    progress(len(places.station))
    return rows


def _joined(rows: list[Agreement]) -> Agreement:
    if not rows:
        none = np.zeros(0)
        whole = np.zeros(0, np.int64)
        return Agreement(whole, whole, Matches(none, none, none, none, none, none, none, whole))
    match = Matches(*(np.concatenate(field) for field in zip(*(row.match for row in rows), strict=True)))
    return Agreement(np.concatenate([row.drive for row in rows]), np.concatenate([row.route for row in rows]), match)


def _by_tile(
    ground: GroundMap, pose: Float[np.ndarray, "place 3"], options: RegisterOptions
) -> Iterator[tuple[int, Int[np.ndarray, " at"]]]:
    """Runs of neighbouring places on one tile, in order."""
    number = np.array(
        [-1 if (n := ground.tile_near(p, options.search_half_m())) is None else n for p in pose[:, :2]], int
    )
    if not len(number):
        return
    for run in np.split(np.arange(len(number)), np.flatnonzero(np.diff(number)) + 1):
        if number[run[0]] >= 0:
            yield int(number[run[0]]), run


def _in_tile(pose: Float[np.ndarray, "place 3"], frame: Float[np.ndarray, "3"]) -> Float[np.ndarray, "place 3"]:
    whole = np.zeros((len(pose), 5))
    whole[:, [0, 1, 3]] = pose
    return to_tile(whole, frame)[:, [0, 1, 3]]
