"""A drive as map stations: profiles at equal steps along the track, surface return removed.

Scans are equally spaced in time, the map in metres. A station is the kernel-weighted mean of the scans around its
place; this is also the low-pass along the track without which a noisy map draws matches to the middle between its
traces (interpolation pull). Streaming: only the stretch under the background removal is in memory.
"""

from collections.abc import Callable, Iterable, Iterator
from itertools import pairwise
from typing import NamedTuple, Protocol, runtime_checkable

import numpy as np
from jaxtyping import Bool, Float, Int

from lgprjax.frames import LocalFrame
from lgprjax.radar import ChainSettings, zero_phase_filter

_KERNEL = 0.5  # standard deviation of the station kernel, in steps
_REACH = 1.25  # the kernel is cut off here, in steps


class ScanBlock(NamedTuple):
    """Profiled scans of a drive, in order, with their positions.

    Attributes:
        profile: profile traces before background removal.
        valid: mask of channels with data.
        travel_m: distance travelled since the start of the drive; falls in reverse.
        pose: array centre (east_m, north_m, height_m above ground, yaw_rad, roll_rad), the yaw unwrapped.
        ground_up_m: local height of the ground under the array.
        antenna_m: antennas (east and north offset from the pose, height above ground).
        time_s: scan times.
    """

    profile: Float[np.ndarray, "scan channel sample"]
    valid: Bool[np.ndarray, "scan channel"]
    travel_m: Float[np.ndarray, " scan"]
    pose: Float[np.ndarray, "scan 5"]
    ground_up_m: Float[np.ndarray, " scan"]
    antenna_m: Float[np.ndarray, "scan channel 3"]
    time_s: Float[np.ndarray, " scan"]


class StationBlock(NamedTuple):
    """Stations of a baseline, in order; the fields of ``ScanBlock`` at equal steps, profile filtered."""

    profile: Float[np.ndarray, "scan channel sample"]
    valid: Bool[np.ndarray, "scan channel"]
    pose: Float[np.ndarray, "scan 5"]
    ground_up_m: Float[np.ndarray, " scan"]
    antenna_m: Float[np.ndarray, "scan channel 3"]
    time_s: Float[np.ndarray, " scan"]


class Coherence(NamedTuple):
    """Running sums behind the depth gain.

    Attributes:
        power: power of the traces.
        lagged, distant: product with the traces a short and a long lag farther on (see ``coherence_lags``).
        traces, lagged_pairs, distant_pairs: number of traces and pairs summed.
    """

    power: Float[np.ndarray, " sample"]
    lagged: Float[np.ndarray, " sample"]
    distant: Float[np.ndarray, " sample"]
    traces: int
    lagged_pairs: int
    distant_pairs: int

    @staticmethod
    def empty(samples: int) -> "Coherence":
        """Sums without data."""
        return Coherence(np.zeros(samples), np.zeros(samples), np.zeros(samples), 0, 0, 0)

    def add(self, block: StationBlock, lags: tuple[int, int]) -> "Coherence":
        """The sums after one more block."""
        lagged, lagged_pairs = _products(block, lags[0])
        distant, distant_pairs = _products(block, lags[1])
        return Coherence(
            self.power + np.sum(block.profile.astype(np.float64) ** 2, axis=(0, 1)),
            self.lagged + lagged,
            self.distant + distant,
            self.traces + int(block.valid.sum()),
            self.lagged_pairs + lagged_pairs,
            self.distant_pairs + distant_pairs,
        )

    @property
    def means(self) -> tuple[Float[np.ndarray, " sample"], Float[np.ndarray, " sample"], Float[np.ndarray, " sample"]]:
        """Means of power, lagged and distant product."""
        return (
            self.power / max(self.traces, 1),
            self.lagged / max(self.lagged_pairs, 1),
            self.distant / max(self.distant_pairs, 1),
        )


def coherence_lags(settings: ChainSettings, scan_spacing_m: float) -> tuple[int, int]:
    """Lags in stations: traces that agree over the first are called ground, over the second they are not.

    A signal that agrees over an eighth of a wavelength is no noise; one that still agrees over a whole wavelength (the
    rest of the surface return, flat layers) does not identify the place. Where stations are means of several scans,
    neighbours share noise, and the short lag is two at least.
    """
    shares_scans = scan_spacing_m < 0.9 * settings.step_m
    short = max(2 if shares_scans else 1, round(settings.wavelength_m / 8.0 / settings.step_m))
    return short, max(short + 1, round(settings.wavelength_m / settings.step_m))


def _products(block: StationBlock, lag: int) -> tuple[Float[np.ndarray, " sample"], int]:
    both = block.valid[lag:] & block.valid[:-lag]
    product = np.where(both[..., None], block.profile[lag:] * block.profile[:-lag], 0.0)
    return np.asarray(np.sum(product, axis=(0, 1), dtype=np.float64)), int(both.sum())


def stations_of_drive(
    blocks: Iterable[ScanBlock], settings: ChainSettings, scan_spacing_m: float
) -> Iterator[StationBlock]:
    """Convert scans of one drive to its stations, streaming.

    Scans at standstill add nothing and reverse is left out: a station uses scans only from the vehicle's first pass. A
    station without a scan nearby is skipped. The background removal restarts across gaps longer than its length, as
    between the lines of a survey, because the backgrounds there are unrelated.

    Args:
        blocks: scans of the drive in order.
        settings: settings of the chain, with the step and the length of the background removal.
        scan_spacing_m: typical distance between scans; if it is no finer than the step, a station is its nearest scan.

    Yields:
        Blocks of filtered stations, each station once.
    """
    filter_stations = max(3, round(settings.track_filter_m / settings.step_m))
    halo = filter_stations // 2
    smooth = scan_spacing_m < 0.9 * settings.step_m
    pending: StationBlock | None = None
    before, end = 0, 0
    for block, number in _uniform(blocks, settings.step_m, smooth):
        leaps = np.flatnonzero(np.diff(number, prepend=end) > filter_stations)
        edges = [0, *leaps.tolist(), len(number)]
        for first, last in pairwise(edges):
            if first in leaps and pending is not None:
                if len(pending.pose) > before:
                    yield _filtered(pending, before, len(pending.pose), filter_stations)
                pending, before = None, 0
            if first == last:
                continue
            part = _slice(block, first, last)
            pending = part if pending is None else _concatenate(pending, part)
            ready = len(pending.pose) - halo
            if ready - before >= 256:
                yield _filtered(pending, before, ready, filter_stations)
                cut = max(ready - halo, 0)
                pending, before = _slice(pending, cut, len(pending.pose)), ready - cut
        end = int(number[-1]) if len(number) else end
    if pending is not None and len(pending.pose) > before:
        yield _filtered(pending, before, len(pending.pose), filter_stations)


def _filtered(block: StationBlock, first: int, last: int, stations: int) -> StationBlock:
    filtered = block._replace(profile=zero_phase_filter(block.profile, block.valid, stations))
    return _slice(filtered, first, last)


def _uniform(
    blocks: Iterable[ScanBlock], step_m: float, smooth: bool
) -> Iterator[tuple[StationBlock, Int[np.ndarray, " station"]]]:
    """Unfiltered stations and their numbers; holds back the scans that later stations still need."""
    held: ScanBlock | None = None
    farthest, next_station = -np.inf, 0
    origin: float | None = None
    for block in blocks:
        if origin is None:
            origin = float(block.travel_m[0])
        block = block._replace(travel_m=block.travel_m - origin)
        reach = np.maximum.accumulate(np.maximum(block.travel_m, farthest))
        fresh = np.diff(reach, prepend=farthest if np.isfinite(farthest) else -1.0) > 0.0
        farthest = float(reach[-1])
        block = ScanBlock(*(field[fresh] for field in block))
        held = block if held is None else ScanBlock(*(np.concatenate(f) for f in zip(held, block, strict=True)))
        complete = int(np.floor(farthest / step_m - _REACH)) + 1
        if complete > next_station:
            yield _stations(held, np.arange(next_station, complete), step_m, smooth)
            next_station = complete
            keep = held.travel_m >= (next_station - _REACH) * step_m
            held = ScanBlock(*(field[keep] for field in held))
    if held is not None and len(held.travel_m):
        rest = np.arange(next_station, int(np.floor(farthest / step_m + 0.5)) + 1)
        yield _stations(held, rest, step_m, smooth)


def _stations(
    scans: ScanBlock, number: Int[np.ndarray, " station"], step_m: float, smooth: bool
) -> tuple[StationBlock, Int[np.ndarray, " seen"]]:
    """Stations with a scan nearby, and their numbers."""
    at_m = number * step_m
    apart = scans.travel_m[None, :] - at_m[:, None]
    if smooth:
        weight = np.where(np.abs(apart) <= _REACH * step_m, np.exp(-0.5 * (apart / (_KERNEL * step_m)) ** 2), 0.0)
    else:
        nearest = np.abs(apart).argmin(axis=1)
        near = np.abs(apart[np.arange(len(at_m)), nearest]) <= 0.75 * step_m
        weight = np.zeros_like(apart)
        weight[np.arange(len(at_m)), nearest] = near
    seen = weight.sum(axis=1) > 0.05
    weight = weight[seen]
    of_channel = weight[:, :, None] * scans.valid[None]
    total = of_channel.sum(axis=1)
    share = of_channel / np.maximum(total, 1e-9)[:, None, :]
    weight = weight / weight.sum(axis=1, keepdims=True)
    profile = np.einsum("kns,nst->kst", share, scans.profile, optimize=True)
    found = StationBlock(
        profile=profile.astype(np.float32),
        valid=total > 0.05,
        pose=weight @ scans.pose,
        ground_up_m=weight @ scans.ground_up_m,
        antenna_m=np.einsum("kn,ncd->kcd", weight, scans.antenna_m),
        time_s=weight @ scans.time_s,
    )
    return found, number[seen]


def _concatenate(a: StationBlock, b: StationBlock) -> StationBlock:
    return StationBlock(*(np.concatenate(fields) for fields in zip(a, b, strict=True)))


def _slice(block: StationBlock, first: int, last: int) -> StationBlock:
    return StationBlock(*(field[first:last] for field in block))


# Points near a point: a hash of square cells, so that a look-up costs the same on a map of any length.


class SpatialIndex:
    """Points of the plane by square cells.

    Args:
        points_m: east and north of each point, metres.
        cell_m: side of a cell; best close to the radius of the queries.
    """

    def __init__(self, points_m: Float[np.ndarray, "point 2"], cell_m: float) -> None:
        self._points_m = points_m
        self._cell_m = cell_m
        key = _key(*np.floor(points_m / cell_m).astype(np.int64).T)
        self._order = np.argsort(key, kind="stable")
        self._key = key[self._order]

    def near(self, point_m: Float[np.ndarray, "2"], radius_m: float) -> Int[np.ndarray, " found"]:
        """Indices, rising, of the points within ``radius_m``."""
        low = np.floor((point_m - radius_m) / self._cell_m).astype(np.int64)
        high = np.floor((point_m + radius_m) / self._cell_m).astype(np.int64)
        rows = np.arange(low[0], high[0] + 1)
        # Cells of one column are neighbours in the order of keys: one range a column.
        first = np.searchsorted(self._key, _key(rows, low[1:]), "left")
        last = np.searchsorted(self._key, _key(rows, high[1:]), "right")
        found = np.concatenate([self._order[a:b] for a, b in zip(first, last, strict=True)])
        apart = self._points_m[found] - point_m
        return np.asarray(np.sort(found[np.sum(apart**2, axis=1) <= radius_m**2]))

    def near_each(
        self, points_m: Float[np.ndarray, "query 2"], radius_m: float
    ) -> tuple[Int[np.ndarray, " found"], Int[np.ndarray, " found"]]:
        """``near`` for many places: number of the place, rising, and index, in no order."""
        low = np.floor((points_m - radius_m) / self._cell_m).astype(np.int64)
        high = np.floor((points_m + radius_m) / self._cell_m).astype(np.int64)
        rows = low[:, :1] + np.arange(1 + int(np.max(high[:, 0] - low[:, 0], initial=0)))
        first = np.searchsorted(self._key, _key(rows, low[:, 1:]), "left")
        last = np.searchsorted(self._key, _key(rows, high[:, 1:]), "right")
        count = np.where(rows <= high[:, :1], last - first, 0)
        before = np.cumsum(count.ravel()) - count.ravel()
        taken = np.repeat(first.ravel() - before, count.ravel()) + np.arange(int(count.sum()))
        query, found = np.repeat(np.arange(len(points_m)), count.sum(axis=1)), self._order[taken]
        east, north = (self._points_m[found] - points_m[query]).T
        within = east**2 + north**2 <= radius_m**2
        return query[within], found[within]

    def nearest(self, point_m: Float[np.ndarray, "2"], radius_m: float) -> int | None:
        """Index of the nearest point within ``radius_m`` (the lowest of equals), or None."""
        found = self.near(point_m, radius_m)
        if not len(found):
            return None
        return int(found[np.argmin(np.sum((self._points_m[found] - point_m) ** 2, axis=1))])


def _key(column: Int[np.ndarray, "..."], row: Int[np.ndarray, "..."]) -> Int[np.ndarray, "..."]:
    return np.asarray(column * (1 << 32) + row + (1 << 31))


class TilePlacer:
    """Places tile frames (east_m, north_m, yaw_rad) along drives, where earlier ones do not serve yet.

    A tile is centred on the drive, its axis along it. A frame within half the spacing serves a station, so a second
    drive over the same road, in either direction, adds hardly any.

    Args:
        spacing_m: twice the largest distance of a station from a frame.
    """

    def __init__(self, spacing_m: float) -> None:
        self._spacing_m = spacing_m
        self._frames: list[tuple[float, float, float]] = []
        self._cells: dict[tuple[int, int], list[int]] = {}

    @property
    def frames(self) -> Float[np.ndarray, "tile 3"]:
        """All frames so far."""
        return np.asarray(self._frames, dtype=np.float64).reshape(-1, 3)

    def place(self, pose: Float[np.ndarray, "scan 5"]) -> int:
        """Place frames for the next stations of a drive; returns how many were added."""
        before = len(self._frames)
        for east, north, _, yaw, _ in pose:
            if not self._served(float(east), float(north)):
                self._cells.setdefault(self._cell(east, north), []).append(len(self._frames))
                self._frames.append((float(east), float(north), float(yaw)))
        return len(self._frames) - before

    def _cell(self, east: float, north: float) -> tuple[int, int]:
        return int(east // self._spacing_m), int(north // self._spacing_m)

    def _served(self, east: float, north: float) -> bool:
        column, row = self._cell(east, north)
        for i in (column - 1, column, column + 1):
            for j in (row - 1, row, row + 1):
                for number in self._cells.get((i, j), ()):
                    x, y, _ = self._frames[number]
                    if np.hypot(east - x, north - y) <= 0.5 * self._spacing_m:
                        return True
        return False


# Positions of a map's stations: short stretches are in memory, the stations themselves are read when needed.
#
# A stretch takes 56 bytes for up to sixteen stations, so that a map of any length is opened at once; for the stations
# about a point only the few stretches near it are read.

_STATIONS = 16
_GAP = 4.0
"""Stations this many usual steps apart belong to two stretches."""
_CELL_M = 8.0
_NEARER = (1.0 / 16.0, 0.25, 1.0)
"""Shares of the radius, tried in turn: most points are close to a track."""
_POINTS = 256


class StationPositions(NamedTuple):
    """Positions of stations.

    Attributes:
        pose: east_m, north_m, height_m above the ground, yaw_rad and roll_rad of the array's centre.
        ground_up_m: up coordinate of the ground under the array.
        drive: number of the baseline.
    """

    pose: Float[np.ndarray, "scan 5"]
    ground_up_m: Float[np.ndarray, " scan"]
    drive: Int[np.ndarray, " scan"]


class StationRuns(NamedTuple):
    """Consecutive stations of one baseline, up to sixteen, without a gap.

    Attributes:
        first: number of the first station; a stretch ends where the next one begins.
        chord_m: east and north of the first and of the last station.
        reach_m: no station of the stretch is farther than this from the middle of the chord.
    """

    first: Int[np.ndarray, " stretch"]
    chord_m: Float[np.ndarray, "stretch 2 2"]
    reach_m: Float[np.ndarray, " stretch"]


def stretches_of(place_m: Float[np.ndarray, "scan 2"], drive: Int[np.ndarray, " scan"], first: int = 0) -> StationRuns:
    """Consecutive stations in stretches.

    Args:
        place_m: east and north of the stations.
        drive: baseline of each station.
        first: number of the first station.
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
    return StationRuns(first + starts, chord_m, np.maximum.reduceat(apart_m, starts))


class StationPlaces:
    """All stations of a map by their places.

    Args:
        stretches: stretches of the map, rising.
        stations: number of stations of the map.
        read: function that reads the places of stations with rising numbers.
    """

    def __init__(
        self, stretches: StationRuns, stations: int, read: Callable[[Int[np.ndarray, " scan"]], StationPositions]
    ) -> None:
        self.stretches = stretches
        self._bounds = np.append(stretches.first, stations)
        self._middle_m = stretches.chord_m.mean(axis=1)
        self._index = SpatialIndex(self._middle_m, _CELL_M)
        self._longest_m = float(stretches.reach_m.max(initial=0.0))
        self._read = read

    @staticmethod
    def held(places: StationPositions) -> "StationPlaces":
        """Places that are in memory."""
        stretches = stretches_of(places.pose[:, :2], places.drive)
        return StationPlaces(
            stretches, len(places.pose), lambda stations: StationPositions(*(field[stations] for field in places))
        )

    def __len__(self) -> int:
        """Number of stations of the map."""
        return int(self._bounds[-1])

    def read(self, stations: Int[np.ndarray, " scan"]) -> StationPositions:
        """Places of the stations with these rising numbers."""
        return self._read(stations)

    def near(self, point_m: Float[np.ndarray, "2"], radius_m: float) -> Int[np.ndarray, " found"]:
        """Numbers, rising, of the stations within ``radius_m`` of a point."""
        numbers = self._stations_of(np.sort(self.stretches_near(point_m[None], radius_m)[1]))
        apart = self.read(numbers).pose[:, :2] - point_m
        return np.asarray(numbers[np.sum(apart**2, axis=1) <= radius_m**2])

    def nearest(self, points_m: Float[np.ndarray, "point 2"], radius_m: float) -> Int[np.ndarray, " point"]:
        """Number of the station nearest to each point (the lowest of equals), -1 if none is within ``radius_m``."""
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


# The source of a map's ground: a subsurface database, on disk or in memory.


class MapDescription(NamedTuple):
    """Properties of a whole map.

    Attributes:
        name: name of the map.
        frame: local frame of the map.
        settings: settings of the processing chain of its baselines, and of live scans.
        channel_pitch_m: spacing of the array's channels.
        channels: largest number of channels of a baseline.
        tile_spacing_m: twice the largest distance of a station from a tile frame.
        gain: depth gain of each profile sample.
        label_sigma_m: standard deviation of each baseline's positions stated by its navigation, root mean square over
            the drive and over east and north; 0 if none was stated.
        weight: weight of each baseline's traces in gridding; empty if all weigh the same.
    """

    name: str
    frame: LocalFrame
    settings: ChainSettings
    channel_pitch_m: float
    channels: int
    tile_spacing_m: float
    gain: Float[np.ndarray, " sample"]
    label_sigma_m: tuple[float, ...] = ()
    weight: tuple[float, ...] = ()

    @property
    def array_width_m(self) -> float:
        """Width of the array, from half a pitch outside the first channel to half a pitch outside the last."""
        return self.channels * self.channel_pitch_m


class Stations(NamedTuple):
    """Stations read from a database; antennas as east and north offset from the pose, height above ground."""

    profile: Float[np.ndarray, "scan channel sample"]
    valid: Bool[np.ndarray, "scan channel"]
    antenna_m: Float[np.ndarray, "scan channel 3"]


@runtime_checkable
class StationSource(Protocol):
    """A subsurface database, open for reading.

    In memory are the properties of the whole map, its tile frames, and short stretches of its tracks (``places``).
    Poses and profiles are read for the stations that are needed: ``places.near(point_m, radius_m)`` gives numbers,
    ``places.read(numbers)`` pose, ground and baseline of each, ``read_stations(numbers)`` its profiles. A source whose
    poses are in memory has ``StationPlaces.held(Places(pose, ground_up_m, drive))``. Databases on disk
    (``formats.MapFile``) also have ``pose``, ``drive`` and ``ground_up_m`` of all stations, read whole on first use:
    registration must not use them.
    """

    @property
    def description(self) -> MapDescription:
        """Properties of the whole map."""
        ...

    @property
    def places(self) -> StationPlaces:
        """Positions of the stations."""
        ...

    @property
    def tile_frame(self) -> Float[np.ndarray, "tile 3"]:
        """East, north and yaw of every tile."""
        ...

    @property
    def height_reference_m(self) -> Float[np.ndarray, " tile"]:
        """Antenna height that each tile is reduced to."""
        ...

    def read_stations(self, stations: Int[np.ndarray, " scan"]) -> Stations:
        """Profiles of the stations with these (rising) numbers."""
        ...


# Extent of a map's ground around each of its tile frames.

_TILES = 2048
"""Frames processed together: memory stays bounded on a long map."""
_LEAST_M = 1e-9


def track_extents(
    frames: Float[np.ndarray, "tile 3"], places: StationPlaces, half_m: Float[np.ndarray, "2"]
) -> tuple[Float[np.ndarray, "tile 2"], Float[np.ndarray, "tile 2"]]:
    """Lowest and highest place of the tracks in each tile's frame, within a box about it.

    Tracks are taken as the chords of their stretches: over sixteen stations a bend of 10 m leaves its chord by
    millimetres.

    Args:
        frames: east_m, north_m, yaw_rad of the tiles.
        places: places of the stations.
        half_m: half widths of the box, along and across.
    """
    low, high = np.full((len(frames), 2), np.inf), np.full((len(frames), 2), -np.inf)
    for begin in range(0, len(frames), _TILES):
        about = frames[begin : begin + _TILES]
        tile, stretch = places.stretches_near(about[:, :2], float(np.hypot(*half_m)))
        east, north = np.moveaxis(places.stretches.chord_m[stretch] - about[tile, None, :2], -1, 0)
        cos, sin = np.cos(about[tile, 2:]), np.sin(about[tile, 2:])
        chord = np.stack([cos * east + sin * north, cos * north - sin * east], axis=-1)
        inside, first, last = _clipped(chord, half_m)
        np.minimum.at(low, begin + tile[inside], np.minimum(first, last)[inside])
        np.maximum.at(high, begin + tile[inside], np.maximum(first, last)[inside])
    none = np.any(low > high, axis=1)
    low[none], high[none] = 0.0, 0.0
    return low, high


def _clipped(
    chord_m: Float[np.ndarray, "chord 2 2"], half_m: Float[np.ndarray, "2"]
) -> tuple[Bool[np.ndarray, " chord"], Float[np.ndarray, "chord 2"], Float[np.ndarray, "chord 2"]]:
    """Chords clipped to a box around the origin: which intersect it, and both ends of the parts inside (Liang and
    Barsky 1984).
    """
    start, way = chord_m[:, 0], chord_m[:, 1] - chord_m[:, 0]
    way = np.where(np.abs(way) < _LEAST_M, _LEAST_M, way)
    to_low, to_high = (-half_m - start) / way, (half_m - start) / way
    early, late = np.minimum(to_low, to_high), np.maximum(to_low, to_high)
    enter = np.maximum(np.maximum(early[:, 0], early[:, 1]), 0.0)
    leave = np.minimum(np.minimum(late[:, 0], late[:, 1]), 1.0)
    return enter <= leave, start + enter[:, None] * way, start + leave[:, None] * way
