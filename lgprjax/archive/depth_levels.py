"""How loud a recording is at each depth, and recordings of traces and of sweeps brought to one level.

Receivers of traces amplify with travel time, by up to 60 dB, and say nowhere by how much; sweeps are not amplified.
A map's depth gain levels what its own baselines recorded. A drive of the other kind first gets the levels over depth
that the map's traces have; a drive of the same kind is left as it is.
"""

from functools import cache
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from lgprjax.archive.recordings import SweepDrive, TraceDrive, recording_of
from lgprjax.formats import DriveLog, MapFile
from lgprjax.radar import apply_operator, stretched_operator
from lgprjax.registration import Operators, Track

_STRETCHES = 8
_SCANS = 128  # of a stretch
_REACH = 4 * _SCANS  # scans after its first
_STATIONS = 1024
_SMOOTH = 5


class Alignment(NamedTuple):
    """How a drive's traces are to be changed to be the map's.

    Attributes:
        sign: +1 or -1.
        later_ns: by how much its time zero lies later than stated.
        levelled: its depths are brought to the map's levels.
        reversed: the line ran the other way.
        chance: that foreign ground brings this about, of all that was tried; 0 where the drive is taken as stated.
        told: what was found, in a line; ``None`` where nothing had to be.
    """

    sign: int = 1
    later_ns: float = 0.0
    levelled: bool = False
    reversed: bool = False
    chance: float = 0.0
    told: str | None = None


AS_STATED = Alignment()


def depth_level(
    recording: TraceDrive | SweepDrive,
    operator: Float[Array, "recorded sample"],
    track: Track,
    stretch_m: float,
) -> Float[np.ndarray, " sample"]:
    """RMS at each depth of what changes along a drive: over eight stretches spread over it, each less its mean.

    Args:
        recording: the drive.
        operator: its matrix.
        track: of the drive; stretches are told by travel, not by time, as a vehicle that stands sees no ground.
        stretch_m: length of a stretch, that of the track filter.
    """
    path_m = np.cumsum(np.abs(np.diff(track.travel_m, prepend=track.travel_m[0])))
    power, traces = np.zeros(operator.shape[1]), 0
    for begin_m in np.linspace(0.0, max(path_m[-1] - stretch_m, 0.0), _STRETCHES):
        places_m = begin_m + np.arange(_SCANS) * (stretch_m / _SCANS)
        wanted = np.unique(np.minimum(np.searchsorted(path_m, places_m), len(path_m) - 1))
        first = int(wanted[0])
        # A stretch in which the vehicle crept or stood is shorter: what comes later is left out.
        wanted = wanted[wanted < first + _REACH]
        block = next(recording.blocks(_REACH, first))
        recorded, valid = block.recorded[wanted - first], block.valid[wanted - first]
        padded = np.pad(recorded, [(0, _SCANS - len(recorded)), (0, 0), (0, 0)])
        profile = np.asarray(apply_operator(jnp.asarray(padded), operator), dtype=np.float64)[: len(recorded)]
        seen = np.maximum(valid.sum(axis=0), 1)[:, None]
        change = np.where(valid[..., None], profile - np.sum(profile * valid[..., None], axis=0) / seen, 0.0)
        power += np.sum(change**2, axis=(0, 1))
        traces += int(valid.sum())
    return np.asarray(np.sqrt(power / max(traces, 1)))


def map_level(source: MapFile) -> Float[np.ndarray, " sample"]:
    """RMS at each depth of a map's stations: as it was before they were coded, or over a thousand of them."""
    if source.level is not None:
        return source.level.astype(np.float64)
    chosen = np.unique(np.linspace(0, len(source.places) - 1, _STATIONS).astype(int))
    stations = source.read_stations(chosen)
    power = np.sum(np.where(stations.valid[..., None], stations.profile, 0.0).astype(np.float64) ** 2, axis=(0, 1))
    return np.asarray(np.sqrt(power / max(int(stations.valid.sum()), 1)))


def level_ratio(
    wanted: Float[np.ndarray, " sample"], found: Float[np.ndarray, " sample"]
) -> Float[np.ndarray, " sample"]:
    """What to multiply each depth by, smoothed over five samples; 0 where nothing was found at all."""
    kernel = np.full(min(_SMOOTH, len(found)), 1.0 / min(_SMOOTH, len(found)))
    want, have = (np.sqrt(np.convolve(level**2, kernel, mode="same")) for level in (wanted, found))
    heard = found > 0.0
    return np.asarray(np.where(heard, want / np.where(heard, have, 1.0), 0.0))


def live_operators(source: MapFile, log: DriveLog, track: Track, alignment: Alignment = AS_STATED) -> Operators:
    """The matrices of a live drive for a map: its recording's own, at the map's levels where the kinds differ.

    Args:
        source: the map.
        log: the live drive.
        track: of the drive.
        alignment: sign, time zero and levels that are to be the map's.

    Returns:
        time scale (see ``RegisterOptions``) to matrix. It raises ``InputError`` where the recording cannot be used, or
        hears too little of the map's band.
    """
    recording, settings = recording_of(log), source.description.settings
    kept = len(source.description.gain)

    def profiles(samples: int) -> Float[Array, "recorded sample"]:
        if isinstance(recording, TraceDrive):
            return recording.operator(settings, samples, alignment.later_ns)
        return recording.operator(settings, samples)

    @cache
    def ratio() -> Float[np.ndarray, " sample"] | None:
        # Maps made before sweeps could be used do not say: they hold traces.
        if not alignment.levelled and recording.kind == source.provenance.get("recording", TraceDrive.kind):
            return None
        plain = profiles(kept)
        return level_ratio(map_level(source), depth_level(recording, plain, track, settings.track_filter_m))

    @cache
    def operator(time_scale: float) -> Float[Array, "recorded sample"]:
        matrix = stretched_operator(
            profiles,
            kept,
            settings.sample_interval_ns,
            scale=time_scale,
            height_m=log.description.array.height_m,
        )
        levels = ratio()
        matrix = matrix if alignment.sign > 0 else -matrix
        return matrix if levels is None else scaled(matrix, levels)

    return operator


def at_levels(
    operator: Float[Array, "recorded sample"],
    wanted: Float[np.ndarray, " sample"],
    found: Float[np.ndarray, " sample"],
) -> Float[Array, "recorded sample"]:
    """An operator whose profiles have the wanted levels over depth, up to one factor."""
    return scaled(operator, level_ratio(wanted, found))


def scaled(
    operator: Float[Array, "recorded sample"], ratio: Float[np.ndarray, " sample"]
) -> Float[Array, "recorded sample"]:
    """An operator with its samples in these proportions."""
    return operator * jnp.asarray(ratio / max(float(ratio.max()), 1e-30), dtype=jnp.float32)[None, :]
