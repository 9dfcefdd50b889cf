"""How much longer the wave's way in the ground takes today than on the map's day, slowly varying along a drive.

Rain stretches travel time and drought shrinks it, by a few per cent that change over tens of metres. A window every few
metres is matched at each of some scales; what its neighbours say is added, and the best scale is where the sum is
highest. The fixes themselves are then registered at the scale of their place.
"""

from collections.abc import Callable

import numpy as np
from jaxtyping import Float

from lgprjax.archive.recordings import recording_of
from lgprjax.formats import DriveLog, MapFile
from lgprjax.registration import BLOCK_SCANS, Operators, RegisterOptions, Track, ground_map_for, probe_strengths

SCALES = np.arange(0.925, 1.1301, 0.015)
_STEP = 0.0025  # of the scale of a scan: a fortieth of a wavelength at forty wavelengths' depth
_EVERY_M = 4.0
_WINDOW_M = 2.0
_NEIGHBOURHOOD_M = 15.0
_LEAST_GAIN = 0.02
"""A scale other than 1 must raise the mean strength by this much: scatter alone prefers one scale or another."""


def find_time_scales(
    source: MapFile,
    log: DriveLog,
    track: Track,
    operators: Operators,
    options: RegisterOptions,
    progress: Callable[[int], None] = lambda _: None,
) -> Float[np.ndarray, " scan"]:
    """Time scale of every scan of a drive.

    Args:
        source: the map.
        log: the drive.
        track: of the drive.
        operators: of the drive, from ``live_operators``.
        options: the search; its window, if it is longer than the two metres that are matched here otherwise.
        progress: told the number of scans done since the last call, over all scales.
    """
    search = RegisterOptions(search_m=options.search_m, window_m=max(options.window_m, _WINDOW_M))
    ground = ground_map_for(source, search)
    path_m = np.cumsum(np.abs(np.diff(track.travel_m, prepend=track.travel_m[0])))
    wanted_m = np.arange(search.window_m, path_m[-1], _EVERY_M)
    probes = np.unique(np.searchsorted(path_m, wanted_m))
    if not len(probes):
        return np.ones(log.scans)
    strength = np.zeros((len(SCALES), len(probes)))
    for row, scale in enumerate(SCALES):
        blocks = (
            (recorded, valid, Track(*(field[low : low + len(recorded)] for field in track)))
            for low, recorded, valid in recording_of(log).blocks(BLOCK_SCANS)
        )
        strength[row] = probe_strengths(ground, operators(float(scale)), log.description.array, blocks, probes, search)
        progress(log.scans)
    found = _best_scales(strength, path_m[probes])
    return np.asarray(np.round(np.interp(path_m, path_m[probes], found) / _STEP) * _STEP)


def _best_scales(
    strength: Float[np.ndarray, "scale probe"], at_m: Float[np.ndarray, " probe"]
) -> Float[np.ndarray, " probe"]:
    """The scale at each probe where the strengths of its neighbourhood are highest together."""
    weight = np.maximum(1.0 - np.abs(at_m[:, None] - at_m[None]) / _NEIGHBOURHOOD_M, 0.0)
    pooled = strength @ weight / weight.sum(axis=0)
    dry = pooled[int(np.argmin(np.abs(SCALES - 1.0)))]
    best = np.argmax(pooled, axis=0)
    inner = np.clip(best, 1, len(SCALES) - 2)
    probe = np.arange(len(at_m))
    before, here, after = (pooled[inner + k, probe] for k in (-1, 0, 1))
    bend = before + after - 2.0 * here
    beside = np.where(bend < 0.0, np.clip(0.5 * (before - after) / np.where(bend < 0.0, bend, 1.0), -0.5, 0.5), 0.0)
    scale = SCALES[inner] + beside * (SCALES[1] - SCALES[0])
    return np.where(pooled[best, probe] > dry + _LEAST_GAIN, scale, 1.0)
