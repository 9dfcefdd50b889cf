"""Rows of a map's datasets, one a station: written as differences, read where they are needed.

Neighbouring stations stand alike: as whole numbers of a small unit, each less the one before it, their places take few
bytes. Every ``UNIT`` stations begin anew, so that a long map is read in parts.
"""

from collections.abc import Callable
from functools import lru_cache
from pathlib import Path

import h5py
import numpy as np
from jaxtyping import Float, Int

from lgprjax.formats.store import reading

UNIT = 1024
"""Stations that are read together; also those of a chunk."""
PLACE_UNITS = np.array([1e-4, 1e-4, 1e-4, 1e-5, 1e-5, 1e-4, 1.0, 1e-4])
"""Of the columns east, north, height (m), yaw, roll (rad), ground_up (m), drive, time (s)."""
ANTENNA_UNIT_M = 1e-4
_ANTENNA_STEP = 5
"""In units: channels stand where the vehicle had come when the switch matrix reached them, to half a millimetre; finer
steps would store the odometer's noise."""


def read_rows(dataset: h5py.Dataset, path: Path, stations: Int[np.ndarray, " scan"]) -> np.ndarray:
    """Rows of the stations with these rising numbers, run by run.

    Raises:
        InputError: a part of them is damaged; names the dataset and the stations.
    """
    if not len(stations):
        return np.zeros((0, *dataset.shape[1:]), dataset.dtype)
    runs = np.split(stations, np.flatnonzero(np.diff(stations) > 1) + 1)
    return np.concatenate([_read(dataset, path, int(run[0]), int(run[-1]) + 1) for run in runs])


class SummedRows:
    """Rows that are stored as differences; those read last are held.

    Args:
        dataset: of whole numbers.
        path: of the file, for what is said of damage.
        keep: units held in memory.
    """

    def __init__(self, dataset: h5py.Dataset, path: Path, keep: int) -> None:
        self._dataset, self._path = dataset, path
        self._unit: Callable[[int], np.ndarray] = lru_cache(keep)(self._summed)

    def read(self, stations: Int[np.ndarray, " scan"]) -> np.ndarray:
        """Rows of the stations with these rising numbers, in units of the dataset."""
        out = np.zeros((len(stations), *self._dataset.shape[1:]), self._dataset.dtype)
        for unit in np.unique(stations // UNIT):
            own = stations // UNIT == unit
            out[own] = self._unit(int(unit))[stations[own] - unit * UNIT]
        return out

    def _summed(self, unit: int) -> np.ndarray:
        rows = _read(self._dataset, self._path, unit * UNIT, min((unit + 1) * UNIT, len(self._dataset)))
        return np.cumsum(rows, axis=0, dtype=rows.dtype)


def differences(values: np.ndarray, before: np.ndarray | None, first: int) -> np.ndarray:
    """What is stored of rows: each less the one before it, but for the first of every unit.

    Args:
        values: the rows, whole numbers.
        before: the row before the first of them; None where there is none.
        first: number of the first of them.
    """
    earlier = np.concatenate([np.zeros_like(values[:1]) if before is None else before[None], values[:-1]])
    begins = (first + np.arange(len(values))) % UNIT == 0
    return np.where(begins.reshape(-1, *[1] * (values.ndim - 1)), values, values - earlier)


def antenna_codes(
    antenna_m: Float[np.ndarray, "scan channel 3"], pose: Float[np.ndarray, "scan 5"]
) -> Int[np.ndarray, "scan channel 3"]:
    """Antennas in the body's frame: forward, left, and up from where height and roll put them; whole units."""
    cos, sin = np.cos(pose[:, 3:4]), np.sin(pose[:, 3:4])
    east, north, up = np.moveaxis(antenna_m.astype(np.float64), -1, 0)
    left = cos * north - sin * east
    body_m = np.stack([cos * east + sin * north, left, up - pose[:, 2:3] - left * np.sin(pose[:, 4:5])], axis=-1)
    return _ANTENNA_STEP * np.rint(body_m / (_ANTENNA_STEP * ANTENNA_UNIT_M)).astype(np.int32)


def antennas_of_codes(
    codes: Int[np.ndarray, "scan channel 3"], pose: Float[np.ndarray, "scan 5"]
) -> Float[np.ndarray, "scan channel 3"]:
    """East and north of antennas from the array's centre, and their height above the ground."""
    cos, sin = np.cos(pose[:, 3:4]), np.sin(pose[:, 3:4])
    forward, left, off = np.moveaxis(ANTENNA_UNIT_M * codes, -1, 0)
    up = pose[:, 2:3] + left * np.sin(pose[:, 4:5]) + off
    return np.stack([cos * forward - sin * left, sin * forward + cos * left, up], axis=-1).astype(np.float32)


def _read(dataset: h5py.Dataset, path: Path, start: int, stop: int) -> np.ndarray:
    with reading(path, f"{dataset.name}, stations {start} to {stop - 1}"):
        return np.asarray(dataset[start:stop])
