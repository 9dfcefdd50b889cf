"""Survey of a map along its routes: ground, signal, self-similarity and agreement of its baselines at each place."""

from collections.abc import Callable, Iterator
from datetime import UTC, datetime
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from lgprjax.batch.chance import OtherBaselines
from lgprjax.formats import MapFile
from lgprjax.mapping.matching import (
    DrivePlaces,
    MapRoute,
    Matches,
    RouteGround,
    ground_at,
    mask_of,
    match_stations,
    passes_at,
    places_of_drives,
    route_of,
    signal_about,
)
from lgprjax.mapping.weights import moment_of
from lgprjax.registration import Code, RegisterOptions, ground_map_for, to_tile
from lgprjax.subsurface import GroundMap, SpatialIndex, coherence_lags

STEP_M = 1.0


class Signal(NamedTuple):
    """Signal of the map's own traces at each place of the route; NaN without a station.

    Attributes:
        power: mean square of the gained traces around the place.
        repeats: correlation of the traces with those an eighth of a wavelength farther, which is the share of ground.
        likeness: score of the best rival of the place's own scan within the search region, divided by its own score.
        ambiguous: whether that scan, registered on the map, is rejected because of its rival.
    """

    power: Float[np.ndarray, " route"]
    repeats: Float[np.ndarray, " route"]
    likeness: Float[np.ndarray, " route"]
    ambiguous: Bool[np.ndarray, " route"]


class Agreement(NamedTuple):
    """Baselines against the ground of all others, one row for each place of a baseline where both exist.

    Attributes:
        drive: number of the baseline.
        route: nearest place of the route.
        match: match of its station.
    """

    drive: Int[np.ndarray, " row"]
    route: Int[np.ndarray, " row"]
    match: Matches


class MapSurvey(NamedTuple):
    """All measurements along a map.

    Attributes:
        route, ground, signal: route, ground and signal at each place.
        agreement: agreement of the baselines.
        beside: correlation of each channel with its right neighbour, over a whole baseline.
    """

    route: MapRoute
    ground: RouteGround
    signal: Signal
    agreement: Agreement
    beside: Float[np.ndarray, "drive pair"]


def survey_map(source: MapFile, progress: Callable[[int], None] = lambda _: None) -> MapSurvey:
    """Survey every baseline of a map.

    Tiles are gridded when needed and few are cached; a few hundred bytes per place are kept.

    Args:
        source: the database.
        progress: called with the number of places done since the last call, out of ``places_of``.
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
            likeness[at[held]] = np.maximum(match.rival, 0.0) / np.maximum(match.score, 1e-3)
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
        RouteGround(passes_at(source, route), width, overlap),
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
    """One baseline against the ground of all others, where one of them is nearby."""
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
        return Agreement(
            whole,
            whole,
            Matches(
                along_m=none,
                cross_m=none,
                sigma_m=none,
                correlation=none,
                score=none,
                rival=none,
                share=none,
                code=whole,
            ),
        )
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


# Passes over each cell of a map's ground, the newest of them, and holes: along the route and across it.

_STATIONS = 256  # read at a time
_REACH = 1.5  # array widths to each side: baselines farther off have a route of their own
_PARTS = 4  # of a cell along the route, each of which a pass must have touched
_DAY_S = 86400.0


class GroundPasses(NamedTuple):
    """Cells of ``STEP_M`` along the route, two channels wide, in the order of the route and from right to left.

    Attributes:
        at_m, across_m: middles of the cells, along the route and to its left.
        passes: number of baselines that touch every part of a cell with valid channels.
        newest_day: recording day of the newest of them, days since 1970-01-01 UTC; NaN without a known date.
        hole: mask of cells well within the array of a drive along the route, without any pass.
    """

    at_m: Float[np.ndarray, " place"]
    across_m: Float[np.ndarray, " cell"]
    passes: Int[np.ndarray, "place cell"]
    newest_day: Float[np.ndarray, "place cell"]
    hole: Bool[np.ndarray, "place cell"]


def ground_passes(source: MapFile, route: MapRoute) -> GroundPasses:
    """Mark the cells that the antennas of every baseline touch.

    Memory: a few hundred bytes per metre of route. Stations out of use and dead channels do not count.

    Args:
        source: map.
        route: route of the map, in steps of ``STEP_M``.

    Raises:
        InputError: a part of the map is damaged.
    """
    description, width_m = source.description, source.description.array_width_m
    cell_m = 2.0 * max(description.channel_pitch_m, description.settings.step_m)
    beside = int(np.ceil(_REACH * width_m / cell_m))
    across_m = cell_m * np.arange(-beside, beside + 1)
    parts = int(np.clip(0.5 * STEP_M / description.settings.step_m, 1, _PARTS))
    # The last cell of a stretch may be longer than its ground.
    follows = (np.diff(route.drive) == 0) & (np.diff(route.place) == 1)
    last = np.append(~follows, True)
    days = _days(source)
    passes = np.zeros((len(route.at_m), len(across_m)), np.int64)
    newest = np.full(passes.shape, np.nan)
    for drive, day in enumerate(days):
        touched = np.zeros((len(route.at_m), parts, len(across_m)), bool)
        _touch(touched, source, np.flatnonzero(source.drive == drive), route, cell_m)
        covered = np.where(last[:, None], touched.any(axis=1), touched.all(axis=1))
        passes += covered
        newest = np.where(covered, np.fmax(newest, day), newest)
    under = np.abs(across_m) <= max(0.5 * width_m - cell_m, 0.0)
    return GroundPasses(route.at_m, across_m, passes, newest, under & (passes == 0))


def half_like_m(survey: MapSurvey, pitch_m: float) -> float | None:
    """Distance across the track at which the correlation of the ground's signal has halved, noise included.

    From the correlation of neighbouring channels, extrapolated as exp(-d²/(2 l²)). None for a single channel, or where
    neighbours are uncorrelated.
    """
    known = survey.beside[survey.beside > 0.0]
    alike = float(np.median(known)) if known.size else 0.0
    return pitch_m * float(np.sqrt(np.log(2.0) / -np.log(alike))) if 0.0 < alike < 1.0 else None


def _touch(
    touched: Bool[np.ndarray, "place part cell"],
    source: MapFile,
    stations: Int[np.ndarray, " scan"],
    route: MapRoute,
    cell_m: float,
) -> None:
    """Mark the cells under the antennas of some stations, each at its nearest place of the route."""
    _, parts, cells = touched.shape
    reach_m = float(np.hypot(0.5 * cells * cell_m, STEP_M))
    index = SpatialIndex(route.pose[:, :2], max(reach_m, 1.0))
    for low in range(0, len(stations), _STATIONS):
        numbers = stations[low : low + _STATIONS]
        read = source.read_stations(numbers)
        antenna_m = (source.pose[numbers, None, :2] + read.antenna_m[..., :2])[read.valid]
        antenna, place = index.near_each(antenna_m, reach_m)
        apart = antenna_m[antenna] - route.pose[place, :2]
        order = np.lexsort((np.sum(apart**2, axis=1), antenna))
        nearest = order[np.unique(antenna[order], return_index=True)[1]]
        apart, place = apart[nearest], place[nearest]
        cos, sin = np.cos(route.pose[place, 2]), np.sin(route.pose[place, 2])
        along, across = cos * apart[:, 0] + sin * apart[:, 1], cos * apart[:, 1] - sin * apart[:, 0]
        part = np.clip(((along / STEP_M + 0.5) * parts).astype(int), 0, parts - 1)
        cell = np.rint(across / cell_m).astype(int) + cells // 2
        inside = (cell >= 0) & (cell < cells)
        touched[place[inside], part[inside], cell[inside]] = True


def _days(source: MapFile) -> list[float]:
    """Recording date of each baseline, days since 1970; NaN where unknown."""
    inputs = source.provenance.get("inputs")
    rows = inputs if isinstance(inputs, list) else []
    said = [moment_of(row.get("t0_utc")) if isinstance(row, dict) else None for row in rows]
    said += [None] * (int(source.drive.max()) + 1 - len(said))
    start = datetime(1970, 1, 1, tzinfo=UTC)
    return [float("nan") if moment is None else (moment - start).total_seconds() / _DAY_S for moment in said]
