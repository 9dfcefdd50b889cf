"""Storage of a map's rows: quantised differences between stations; coded traces; false-match statistics.

Neighbouring stations are similar, so their positions are stored in few bytes, as differences in whole numbers of a
small unit. The differences restart every ``UNIT`` stations, so that a long map can be read in parts.
"""

import json
import math
from collections.abc import Callable
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

import h5py
import numpy as np
from jaxtyping import Bool, Float, Float16, Int, Int8

from lgprjax.errors import InputError
from lgprjax.formats.schema import load_schema
from lgprjax.formats.store import attribute_of, reading, write_array, write_attribute
from lgprjax.registration import Chance
from lgprjax.subsurface import StationBlock, StationPositions

UNIT = 1024
"""Stations that are read together; also those of a chunk."""
PLACE_UNITS = np.array([1e-4, 1e-4, 1e-4, 1e-5, 1e-5, 1e-4, 1.0, 1e-4])
"""Units of the columns east, north, height (m), yaw, roll (rad), ground_up (m), drive, time (s)."""
ANTENNA_UNIT_M = 1e-4
_ANTENNA_STEP = 5
"""Step of antenna positions, in units: half a millimetre; each channel is at the vehicle's position when the switch
matrix reached it, and finer steps would store the odometer's noise.
"""


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
    """Rows stored as differences; the last ones read are cached.

    Args:
        dataset: dataset of whole numbers.
        path: path of the file, for messages.
        keep: number of units held in memory.
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
    """Stored form of rows: each minus the previous one, except the first of every unit.

    Args:
        values: the rows, whole numbers.
        before: row before the first of them; ``None`` without one.
        first: number of the first of them.
    """
    earlier = np.concatenate([np.zeros_like(values[:1]) if before is None else before[None], values[:-1]])
    begins = (first + np.arange(len(values))) % UNIT == 0
    return np.where(begins.reshape(-1, *[1] * (values.ndim - 1)), values, values - earlier)


def antenna_codes(
    antenna_m: Float[np.ndarray, "scan channel 3"], pose: Float[np.ndarray, "scan 5"]
) -> Int[np.ndarray, "scan channel 3"]:
    """Antennas in the body's frame: forward, left, and up relative to height and roll; whole units."""
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


# Coding of a map's traces: orthonormal components of the gained traces, in few bits each.
#
# Registration uses the gained samples of a trace. They are transformed into components that are uncorrelated over the
# map (Karhunen and Loève), all of which are kept, so that a later drive may differ, and each is rounded to whole steps.
# One step is used for all components of a station: noise of equal power everywhere costs the fewest bits for its effect
# (reverse water-filling, Cover and Thomas, ch. 10). The step is a share of the station's own RMS, so that weak ground
# is kept as well as strong ground. Components below the step become zeros and cost almost nothing.
#
# The noise of rounding is step²/12 in each component that is not zero (Widrow 1961), so that a station's correlation
# with itself as it was falls to about 1 / sqrt(1 + step_rms²/12). Gridding takes the mean of several stations: the
# noise that remains in a tile is a fraction of that.

_MOST = 127
_LEAST_GAIN = 1e-9
"""Share of the largest: depths below it hold no data."""


class MapPrecision(NamedTuple):
    """Precision of stored traces.

    Attributes:
        name: name of the setting.
        step_rms: rounding step in RMS values of a station's gained samples; ``None`` for samples as 16-bit floats.
    """

    name: str
    step_rms: float | None


FULL = MapPrecision("full", None)
STANDARD = MapPrecision("standard", 0.5)
SMALL = MapPrecision("small", 1.0)
MAP_PRECISIONS = {precision.name: precision for precision in (FULL, STANDARD, SMALL)}


class TraceCode(NamedTuple):
    """Definition of a map's codes.

    Attributes:
        step_rms: see ``MapPrecision``.
        gain: depth gain of each profile sample.
        basis: orthonormal components of gained traces.
        level: RMS of the profiles at each depth before they were coded.
    """

    step_rms: float
    gain: Float[np.ndarray, " sample"]
    basis: Float[np.ndarray, "component sample"]
    level: Float[np.ndarray, " sample"]


class CodedTraces(NamedTuple):
    """Traces of stations in steps, and the step of each station."""

    codes: Int8[np.ndarray, "scan component channel"]
    scale: Float[np.ndarray, " scan"]


def trace_code(
    products: Float[np.ndarray, "sample sample"], traces: int, gain: Float[np.ndarray, " sample"], step_rms: float
) -> TraceCode:
    """The code that suits a map's traces.

    Args:
        products: sum over all traces of the product of each two samples, before the gain.
        traces: number of traces summed.
        gain: gain of the map.
        step_rms: rounding step.
    """
    weight = gain.astype(np.float64)
    _, vector = np.linalg.eigh(weight[:, None] * products * weight)
    level = np.sqrt(np.diag(products) / max(traces, 1))
    basis = np.ascontiguousarray(vector[:, ::-1].T)
    return TraceCode(step_rms, gain.astype(np.float32), basis.astype(np.float32), level.astype(np.float32))


def encode(
    code: TraceCode, profile: Float[np.ndarray, "scan channel sample"], valid: Bool[np.ndarray, "scan channel"]
) -> CodedTraces:
    """Traces in steps. A station with a spike beyond 127 steps gets a larger step: nothing is clipped."""
    gained = np.where(valid[..., None], profile, 0.0).astype(np.float32) * code.gain
    component = gained @ code.basis.T
    numbers = np.maximum(valid.sum(axis=1), 1) * profile.shape[2]
    rms = np.sqrt(np.sum(gained.astype(np.float64) ** 2, axis=(1, 2)) / numbers)
    peak = np.abs(component).max(axis=(1, 2), initial=0.0)
    # Few bits of the step itself, rounded up, so that it costs little.
    part, power = np.frexp(np.maximum(code.step_rms * rms, peak / _MOST))
    scale = np.ldexp(np.ceil(256.0 * part) / 256.0, power).astype(np.float32)
    steps = np.rint(component / np.where(scale > 0.0, scale, 1.0)[:, None, None])
    return CodedTraces(np.moveaxis(steps, 1, 2).astype(np.int8), scale)


def decode(code: TraceCode, coded: CodedTraces) -> Float[np.ndarray, "scan channel sample"]:
    """Profiles before the depth gain; zero where the gain is."""
    kept = code.gain > _LEAST_GAIN * float(code.gain.max())
    synthesis = code.basis * np.where(kept, 1.0 / np.where(kept, code.gain, 1.0), 0.0).astype(np.float32)
    steps = np.moveaxis(coded.codes, 1, 2).astype(np.float32) * coded.scale[:, None, None]
    return np.asarray(steps @ synthesis)


# Stations as stored in a map: copied unchanged from map to map, or made from profiles.

BLOCK = 256
"""Stations of a block of codes: one chunk, read and checked as a whole."""


class StoredStations(NamedTuple):
    """Consecutive stations in the numbers of the file.

    Attributes:
        place: rows in ``PLACE_UNITS``.
        antenna: see ``antenna_codes``.
        valid: mask of channels with data, whether or not the station is retired.
        traces: traces as samples, or as codes.
    """

    place: Int[np.ndarray, "scan 8"]
    antenna: Int[np.ndarray, "scan channel 3"]
    valid: Bool[np.ndarray, "scan channel"]
    traces: Float16[np.ndarray, "scan channel sample"] | CodedTraces


def stored_block(block: StationBlock, drive: int) -> StoredStations:
    """Stations of a baseline with their traces as samples."""
    place = place_rows(block.pose, block.ground_up_m, np.full(len(block.pose), drive), block.time_s)
    pose = places_of_rows(place).pose
    profile = np.where(block.valid[..., None], block.profile, 0.0).astype(np.float16)
    return StoredStations(place, antenna_codes(block.antenna_m, pose), block.valid, profile)


def place_rows(
    pose: Float[np.ndarray, "scan 5"],
    ground_up_m: Float[np.ndarray, " scan"],
    drive: Int[np.ndarray, " scan"],
    time_s: Float[np.ndarray, " scan"],
) -> Int[np.ndarray, "scan 8"]:
    """Places and times of stations, in whole units."""
    whole = np.concatenate([pose, np.stack([ground_up_m, drive, time_s], axis=1)], axis=1)
    return np.asarray(np.rint(whole / PLACE_UNITS).astype(np.int64))


def places_of_rows(rows: Int[np.ndarray, "scan 8"]) -> StationPositions:
    """Positions of stations."""
    values = rows * PLACE_UNITS
    return StationPositions(values[:, :5], values[:, 5], rows[:, 6])


def moved(rows: Int[np.ndarray, "scan 8"], pose: Float[np.ndarray, "scan 5"]) -> Int[np.ndarray, "scan 8"]:
    """The rows with other poses."""
    return np.concatenate([np.rint(pose / PLACE_UNITS[:5]).astype(np.int64), rows[:, 5:]], axis=1)


# A map's chance in its file, and as text for maps without one.

CHANCE_METHOD = 6
"""Version of the measurement. Increase it with every change of search, noise floor or measurement that changes the
scores of foreign ground: a chance of another version is measured again.
"""

_SCHEMA = load_schema("map")
_FIELDS = ("start", "share", "scale", "area_m2")
_NUMBERS = ("pieces", "own", "sigma_scale", "left_out", "label_scatter_m")


def write_chance(store: h5py.File, chance: Chance, windows_m: tuple[float, ...]) -> None:
    """Add the group ``/chance``, for windows of these lengths, to a map that is being written."""
    write_array(store, _SCHEMA, "/chance/window_m", np.asarray(windows_m))
    for name in _FIELDS:
        write_array(store, _SCHEMA, f"/chance/{name}", getattr(chance, name))
    for name, value in (("method", CHANCE_METHOD), *((name, getattr(chance, name)) for name in _NUMBERS)):
        write_attribute(store["chance"], name, float(value))


def read_chance(store: h5py.File, path: Path, windows_m: tuple[float, ...]) -> Chance | None:
    """The chance that a map holds; None without one, or for another method or other windows.

    Raises:
        InputError: the group is damaged.
    """
    if "chance" not in store:
        return None
    group = store["chance"]
    numbers: dict[str, float] = {}
    for name in ("method", *_NUMBERS):
        value = attribute_of(group, name) if name in group.attrs else None
        if isinstance(value, int | float):
            numbers[name] = float(value)
        elif value is not None:
            raise InputError(path, f"/chance@{name}", "a number", repr(value))
    if numbers.get("method") != CHANCE_METHOD or not np.array_equal(group["window_m"][()], windows_m):
        return None
    return _chance_of({name: group[name][()] for name in _FIELDS}, numbers)


def _chance_of(fields: dict[str, np.ndarray], numbers: dict[str, float]) -> Chance:
    chance = Chance(
        start=fields["start"],
        share=fields["share"],
        scale=fields["scale"],
        area_m2=fields["area_m2"],
        pieces=int(numbers["pieces"]),
        own=bool(numbers["own"]),
        left_out=int(numbers.get("left_out", 0)),
        label_scatter_m=numbers.get("label_scatter_m", 0.0),
    )
    # Maps of schema 1.2 hold no scale of the sigmas: theirs is that of many grounds.
    return chance._replace(sigma_scale=numbers["sigma_scale"]) if "sigma_scale" in numbers else chance


def chance_as_text(chance: Chance) -> str:
    """The chance as JSON."""
    fields = {name: np.asarray(getattr(chance, name)).tolist() for name in _FIELDS}
    stated = {"method": CHANCE_METHOD, **fields, **{name: getattr(chance, name) for name in _NUMBERS}}
    return json.dumps(stated, indent=1) + "\n"


def chance_of_text(text: str) -> Chance | None:
    """The chance from such a text; None if it is damaged or of another method."""
    try:
        stated = json.loads(text)
        fields = {name: np.asarray(stated[name], dtype=np.float64) for name in _FIELDS}
        chance = _chance_of(fields, {name: float(stated[name]) for name in _NUMBERS if name in stated})
        known = stated["method"] == CHANCE_METHOD
    except (ValueError, KeyError, TypeError):
        return None
    sound = all(field.shape == chance.start.shape and np.all(field > 0.0) for field in fields.values())
    sound = sound and 0.0 < chance.sigma_scale < math.inf
    return chance if known and sound and chance.start.ndim == 1 and bool(np.all(chance.share <= 1.0)) else None
