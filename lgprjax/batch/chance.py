"""Statistics of matches on a map, measured on itself: scores of foreign ground, and errors of right matches."""

import os
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.spatial import cKDTree

from lgprjax.errors import InputError
from lgprjax.files import file_hash
from lgprjax.formats import MapFile, atomic_output, chance_as_text, chance_of_text
from lgprjax.radar import to_coefficients, uniform_array
from lgprjax.registration import (
    LADDER_M,
    LEAST_INDEPENDENT,
    PIECE_M,
    Chance,
    Code,
    EvidenceSearch,
    LiveChain,
    LiveScans,
    PreparedGround,
    RegisterOptions,
    Track,
    fit_chance,
    fit_sigma_scale,
    ground_map_for,
    pooled_chance,
)
from lgprjax.subsurface import GroundMap, MapDescription, StationPlaces, Stations

_PIECES = 240
_WIDEST_M = 1.6
_STRETCH_M = max(LADDER_M) + 5.0 * PIECE_M  # of wavelengths up to a metre
_SEED = 1
_TRIES = 400
_LEFT_OUT = 6
"""Baselines left out one by one, spread over the map: each asks for tiles of its own."""
_LEFT_OUT_PIECES = 60
_LEAST_LEFT_OUT = 5
_STRETCHES_TRIED = 40
_PLACES_LOOKED_AT = 4000
_COVERED = 0.5  # of the channels, over the ground of the others
_BETWEEN = 0.6  # of the distance between map traces
# wavelengths to each side, no more than 2.5 m: chances scale with the area, so that a small one suffices
_REGION = 6.25
_RESEMBLES = 2.5  # wavelengths over which ground resembles itself: layers and lenses, not single stones


class _Swapped(NamedTuple):
    """A stretch of a baseline's poses with the traces of another stretch, or with its own.

    Attributes:
        poses, traces: numbers of their stations.
        under, channel: first channel of the poses, and of the traces.
    """

    poses: Int[np.ndarray, " scan"]
    traces: Int[np.ndarray, " scan"]
    under: int
    channel: int


class _StationChain(LiveChain):
    """Chain of stations, which are profiles already and need no processing."""

    def __init__(self, ground: GroundMap) -> None:
        self._ground = ground

    def coefficients(
        self,
        filtered: Float[np.ndarray, "scan channel sample"],
        valid: Bool[np.ndarray, "scan channel"],
        time_scale: float,
    ) -> Float[np.ndarray, "scan channel coefficient"]:
        """Coefficients of profiles; a map has only its own time scale."""
        assert time_scale == 1.0
        rows = max(16, 1 << max(0, len(filtered) - 1).bit_length())
        pad = [(0, rows - len(filtered)), (0, 0)]
        gained = to_coefficients(
            jnp.asarray(np.pad(filtered, [*pad, (0, 0)]), dtype=jnp.float32),
            jnp.asarray(np.pad(valid, pad)),
            self._ground.basis,
        )
        return np.asarray(gained)[: len(filtered)]


def measure_chance(source: MapFile) -> Chance:
    """Match pieces of a map's baselines at other places of it, and fit the tail of their best scores; then leave out
    baselines, register them on the others, and scale the sigmas to the errors of those matches.

    Every piece is searched like a drive without a stated position sigma, in all windows of the ladder. A map too small
    for some dozens of pieces gets the tail pooled over many grounds.
    """
    description = source.description
    wavelength_m = description.settings.wavelength_m
    half_m = min(RegisterOptions().search_half_m(), _REGION * wavelength_m)
    options = RegisterOptions(search_m=half_m, time_scale=1.0)
    # Survey lines are no array: as many of them as an array has channels are matched together.
    channels = int(np.clip(round(_WIDEST_M / description.channel_pitch_m), 1, description.channels))
    tail = _false_tail(source, options, channels)
    spacing_m = _line_spacing_m(source)
    # Between lines of one channel a gap is twice as wide without the line; arrays overlap where they can be compared.
    left_out_m = 2.0 * spacing_m if description.channels == 1 else spacing_m
    errors, apart_m2 = _left_out_errors(source, options, channels, tail)
    scale, left_out = fit_sigma_scale(errors, spacing_m, left_out_m, wavelength_m)
    return tail._replace(sigma_scale=scale, left_out=left_out, label_scatter_m=_label_scatter_m(apart_m2))


def _false_tail(source: MapFile, options: RegisterOptions, channels: int) -> Chance:
    """The tail of the scores at false places."""
    description = source.description
    ground = ground_map_for(source, options)
    prepared = PreparedGround(ground, uniform_array(channels, description.channel_pitch_m), keep=8)
    piece_m = PIECE_M * max(1.0, description.settings.wavelength_m)
    steps = np.hypot(*np.diff(source.pose[:, :2], axis=0).T)[np.diff(source.drive) == 0]
    independent = float(steps.sum()) * max(1, description.channels // channels) / piece_m
    pooled = pooled_chance(description.settings.wavelength_m)
    if independent < LEAST_INDEPENDENT:
        return pooled._replace(pieces=int(independent))
    highest: list[Float[np.ndarray, " window"]] = []
    area_m2: list[Float[np.ndarray, " window"]] = []
    for swapped in _swapped(source, channels, options.search_half_m()):
        search = EvidenceSearch(prepared, _StationChain(ground), options, pooled)
        path_m, z, area = search.highest(_scans_of(source, swapped, channels))
        number = np.floor((path_m - path_m[0]) / piece_m)
        for piece in np.unique(number):
            own = number == piece
            if np.isfinite(z[own]).any():
                highest.append(np.nanmax(np.where(np.isfinite(z[own]), z[own], -np.inf), axis=0))
                area_m2.append(np.mean(area[own], axis=0))
        if len(highest) >= _PIECES:
            break
    if not highest:
        return pooled._replace(pieces=int(independent))
    z = np.stack(highest)
    return fit_chance(np.where(np.isfinite(z), z, np.nan), np.stack(area_m2), independent, pooled)


def _swapped(source: MapFile, channels: int, half_m: float) -> Iterator[_Swapped]:
    """Pairs of stretches, drawn in a fixed order; each pair at least a region apart over its whole length."""
    draw = np.random.default_rng(_SEED)
    settings = source.description.settings
    # The true place is then outside the region, which is a square that turns with the heading, and so is the ground
    # around it that resembles it.
    step_m, apart_m = settings.step_m, np.sqrt(2.0) * half_m + max(1.0, _RESEMBLES * settings.wavelength_m)
    drive = source.drive
    starts = np.flatnonzero(np.diff(drive, prepend=-1))
    ends = np.append(starts[1:], len(drive))
    piece_m = PIECE_M * max(1.0, settings.wavelength_m)
    most = int(_STRETCH_M * max(1.0, settings.wavelength_m) / step_m)
    for _ in range(_TRIES):
        a, b = draw.integers(len(starts), size=2)
        # Half a short baseline at most: two stretches of nearly all of it would be in the same place.
        shorter = min(ends[a] - starts[a], ends[b] - starts[b])
        count = min(most, max(shorter // 2, min(shorter, int(piece_m / step_m))))
        if count * step_m < 0.5 * piece_m:
            continue
        at = starts[a] + draw.integers(ends[a] - starts[a] - count + 1)
        of = starts[b] + draw.integers(ends[b] - starts[b] - count + 1)
        poses, traces = np.arange(at, at + count), np.arange(of, of + count)
        if draw.integers(2):
            traces = traces[::-1]
        under, channel = draw.integers(source.description.channels - channels + 1, size=2)
        place, origin = _places(source, poses, int(under), channels), _places(source, traces, int(channel), channels)
        away = np.linalg.norm(place - origin, axis=1) >= apart_m
        # The longest run of places far enough apart.
        edges = np.flatnonzero(np.diff(np.concatenate([[0], away.astype(int), [0]])))
        runs = edges.reshape(-1, 2)
        if len(runs):
            low, high = runs[np.argmax(runs[:, 1] - runs[:, 0])]
            if (high - low) * step_m >= 0.5 * piece_m:
                yield _Swapped(poses[low:high], traces[low:high], int(under), int(channel))


def _places(
    source: MapFile, stations: Int[np.ndarray, " scan"], first: int, channels: int
) -> Float[np.ndarray, "scan 2"]:
    """Centres of some neighbouring channels at some stations, channel 0 leftmost."""
    description = source.description
    left_m = (0.5 * (description.channels - 1) - first - 0.5 * (channels - 1)) * description.channel_pitch_m
    pose = source.pose[stations].astype(np.float64)
    return np.asarray(pose[:, :2] + left_m * np.stack([-np.sin(pose[:, 3]), np.cos(pose[:, 3])], axis=1))


def _scans_of(source: MapFile, swapped: _Swapped, channels: int) -> LiveScans:
    """The stretch as scans of a drive."""
    order = np.argsort(swapped.traces)
    stations = source.read_stations(swapped.traces[order])
    back = np.argsort(order)
    of = slice(swapped.channel, swapped.channel + channels)
    pose = source.pose[swapped.poses].astype(np.float64).copy()
    pose[:, :2] = _places(source, swapped.poses, swapped.under, channels)
    pose[:, 3] = np.unwrap(pose[:, 3])
    count, step_m = len(pose), source.description.settings.step_m
    path_m = np.cumsum(np.hypot(*np.diff(pose[:, :2], axis=0, prepend=pose[:1, :2]).T))
    track = Track(
        pose,
        path_m,
        np.full(count, step_m),
        np.full(count, np.radians(1.0)),
        np.full(count, np.nan),
        np.zeros(count, np.int64),
    )
    # The labels are the track of the stretch: the array's centre is the body's origin here.
    return LiveScans(
        number=np.arange(count),
        filtered=stations.profile[back, of].astype(np.float32),
        valid=stations.valid[back, of],
        track=track,
        path_m=path_m,
        dead_reckoned_m=pose[:, :2],
    )


# Leave one baseline out: the others are a map, and it is a drive whose place is known.


def _left_out_errors(
    source: MapFile, options: RegisterOptions, channels: int, chance: Chance
) -> tuple[Float[np.ndarray, " piece"], Float[np.ndarray, " line"]]:
    """Errors of left-out baselines' places on the others' ground, squared.

    Returns:
        in units of their matches' and labels' covariance, per degree of freedom, one fix a piece: a constant offset of
        a baseline's labels is no error of its matches; and mean of each baseline, m² an axis, less that of matches.
    """
    piece_m = PIECE_M * max(1.0, source.description.settings.wavelength_m)
    numbers = np.unique(source.drive[source.retired == 0])
    if len(numbers) < 2:
        return np.zeros(0), np.zeros(0)
    some = numbers[np.unique(np.linspace(0, len(numbers) - 1, _LEFT_OUT).round().astype(int))]
    most_m = _LEFT_OUT_PIECES / len(some) * piece_m
    alone = chance._replace(sigma_scale=1.0)
    label_m2 = np.nan_to_num(np.asarray(source.description.label_sigma_m)) ** 2
    out, apart_m2 = [], []
    for number in some:
        others = OtherBaselines(source, int(number))
        ground = ground_map_for(others, options)
        prepared = PreparedGround(ground, uniform_array(channels, source.description.channel_pitch_m), keep=8)
        error_m, covariance, match_m2, left_m = [], [], [], most_m
        # Labels wander independently along their baselines, so the difference of two includes both label errors.
        labels_m2 = label_m2[int(number)] + np.mean(label_m2[numbers[numbers != number]])
        for stretch, covered in _stretches_over_others(source, int(number), channels, piece_m):
            if left_m < piece_m:
                break
            scans = _scans_of(source, stretch, channels)
            scans = scans._replace(valid=scans.valid & covered)
            search = EvidenceSearch(prepared, _StationChain(ground), options, alone)
            stops, fix, beside, _ = search.feed(scans)
            left_m -= float(scans.path_m[-1])
            ok = np.flatnonzero(np.asarray(fix.code) == Code.OK)
            # The last of each piece.
            piece = np.floor(scans.path_m[stops[ok]] / piece_m)
            ok = ok[::-1][np.unique(piece[::-1], return_index=True)[1]]
            error_m.append(np.asarray(fix.pose)[ok, :2] - scans.track.pose[stops[ok], :2])
            match = np.asarray(fix.covariance)[ok, :2, :2] - beside[ok]
            match_m2.append(0.5 * np.trace(match, axis1=1, axis2=2))
            covariance.append(match + labels_m2 * np.eye(2))
        error = np.concatenate(error_m) if error_m else np.zeros((0, 2))
        if len(error) >= _LEAST_LEFT_OUT:
            apart = error - np.median(error, axis=0)
            solved = np.linalg.solve(np.concatenate(covariance), apart[..., None])[..., 0]
            # The median is of the same pieces.
            out.append(0.5 * np.sum(apart * solved, axis=1) * len(error) / (len(error) - 1))
            apart_m2.append(float(np.mean(error**2) - np.mean(np.concatenate(match_m2))))
    return np.concatenate(out) if out else np.zeros(0), np.array(apart_m2)


_LEAST_LINES = 3


def _label_scatter_m(apart_m2: Float[np.ndarray, " line"]) -> float:
    """Error of a baseline's labels, an axis, from those of each left-out baseline and of the others; 0: not known.

    The labels of the others are wrong as well, by less the more they are.
    """
    lines = len(apart_m2)
    if lines < _LEAST_LINES:
        return 0.0
    return float(np.sqrt(max(float(np.mean(apart_m2)), 0.0) / (1.0 + 1.0 / (lines - 1))))


def _stretches_over_others(
    source: MapFile, number: int, channels: int, least_m: float
) -> Iterator[tuple[_Swapped, Bool[np.ndarray, "scan channel"]]]:
    """Stretches of a baseline over the ground of others, in a fixed random order, and which of its traces are.

    The number examined is bounded for any length of the map, with only the antennas next to each.
    """
    description = source.description
    pitch_m, step_m = description.channel_pitch_m, description.settings.step_m
    in_force = source.retired == 0
    others = np.flatnonzero(in_force & (source.drive != number))
    own = np.flatnonzero(in_force & (source.drive == number))
    most = int(_STRETCH_M * max(1.0, description.settings.wavelength_m) / step_m)
    places = cKDTree(source.pose[others, :2])
    reach_m = 0.5 * most * step_m + description.array_width_m + pitch_m
    starts = np.random.default_rng(_SEED).permutation(np.arange(0, len(own), most))[:_STRETCHES_TRIED]
    for low in starts:
        stretch = own[low : low + most]
        middle = source.pose[stretch[len(stretch) // 2], :2]
        near = others[np.sort(np.asarray(places.query_ball_point(middle, reach_m), dtype=np.int64))]
        if not len(near):
            continue
        antennas = cKDTree(_antennas(source, near).reshape(-1, 2))
        away, _ = antennas.query(_antennas(source, stretch).reshape(-1, 2))
        over = away.reshape(len(stretch), -1) < _BETWEEN * max(pitch_m, step_m)
        for under in range(0, description.channels - channels + 1, channels):
            part = over[:, under : under + channels]
            enough = np.mean(part, axis=1) >= _COVERED
            edges = np.flatnonzero(np.diff(np.concatenate([[0], enough.astype(int), [0]])))
            for begin, end in edges.reshape(-1, 2):
                if (end - begin) * step_m >= least_m:
                    yield _Swapped(stretch[begin:end], stretch[begin:end], under, under), part[begin:end]


def _antennas(source: MapFile, stations: Int[np.ndarray, " scan"]) -> Float[np.ndarray, "scan channel 2"]:
    """Places of all channels at some stations."""
    channels = source.description.channels
    return np.stack([_places(source, stations, channel, 1) for channel in range(channels)], axis=1)


def _line_spacing_m(source: MapFile) -> float:
    """Distance between neighbouring lines of a map: of its channels, or of its baselines where those have one."""
    description = source.description
    numbers = np.unique(source.drive)
    if description.channels > 1 or len(numbers) < 2:
        return description.channel_pitch_m
    nearest = []
    every = max(1, len(source.pose) // _PLACES_LOOKED_AT)
    for number in numbers[np.unique(np.linspace(0, len(numbers) - 1, _LEFT_OUT).round().astype(int))]:
        others = cKDTree(source.pose[source.drive != number, :2])
        nearest.append(np.median(others.query(source.pose[source.drive == number, :2][::every])[0]))
    return float(np.median(nearest))


class KeptStations:
    """A database in which only some stations hold data: a ``StationSource``.

    All stations keep their places, so that tiles keep the shapes of the whole map and nothing is recompiled.

    Args:
        source: the database.
        kept: stations that hold data.
    """

    def __init__(self, source: MapFile, kept: Bool[np.ndarray, " scan"]) -> None:
        self._source = source
        self.kept: Bool[np.ndarray, " scan"] = kept
        self.description: MapDescription = source.description
        self.places: StationPlaces = source.places
        self.tile_frame: Float[np.ndarray, "tile 3"] = source.tile_frame
        self.height_reference_m: Float[np.ndarray, " tile"] = source.height_reference_m

    def read_stations(self, stations: Int[np.ndarray, " scan"]) -> Stations:
        """Profiles of the stations with these rising numbers; the others are not valid."""
        kept = self.kept[stations]
        read = self._source.read_stations(stations[kept])

        def spread(values: np.ndarray) -> np.ndarray:
            out = np.zeros((len(stations), *values.shape[1:]), values.dtype)
            out[kept] = values
            return out

        return Stations(*(spread(field) for field in read))


class OtherBaselines(KeptStations):
    """A database in which one baseline holds no data.

    Args:
        source: the database.
        left_out: number of the baseline.
    """

    def __init__(self, source: MapFile, left_out: int) -> None:
        super().__init__(source, np.asarray(source.drive != left_out))


# The chance of a map: from its file, else measured once and cached.


def chance_of(source: MapFile) -> Chance:
    """The chance of a map.

    Maps of older versions hold none: theirs is measured, which takes seconds to minutes, and kept in the user's cache
    folder under the hash of the map's file. A cache that cannot be read or written costs only time.
    """
    if source.chance is not None:
        return source.chance
    cache = cache_path(source)
    with suppress(OSError, UnicodeDecodeError):
        kept = chance_of_text(cache.read_text(encoding="utf-8"))
        if kept is not None:
            return kept
    chance = measure_chance(source)
    with suppress(OSError, InputError):
        cache.parent.mkdir(parents=True, exist_ok=True)
        with atomic_output(cache, force=True) as temporary:
            temporary.write_text(chance_as_text(chance), encoding="utf-8")
    return chance


def cache_path(source: MapFile) -> Path:
    """Cache file for the chance of a map that holds none: ``$XDG_CACHE_HOME/lgprjax``, or ``~/.cache/lgprjax``."""
    root = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    return root / "lgprjax" / f"chance-{file_hash(source.path)}.json"
