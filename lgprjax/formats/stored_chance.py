"""A map's chance in its file, and as text beside maps that hold none."""

import json
from pathlib import Path

import h5py
import numpy as np

from lgprjax.errors import InputError
from lgprjax.formats.schema import load_schema
from lgprjax.formats.store import attribute_of, write_array, write_attribute
from lgprjax.registration import Chance

CHANCE_METHOD = 5
"""Version of the measurement. Raise it with every change of search, noise floor or measurement that changes the scores
which foreign ground reaches: a chance of another version is measured again."""

_SCHEMA = load_schema("map")
_FIELDS = ("start", "share", "scale", "area_m2")


def write_chance(store: h5py.File, chance: Chance, windows_m: tuple[float, ...]) -> None:
    """Add the group ``/chance``, for windows of these lengths, to a map that is being written."""
    write_array(store, _SCHEMA, "/chance/window_m", np.asarray(windows_m))
    for name in _FIELDS:
        write_array(store, _SCHEMA, f"/chance/{name}", getattr(chance, name))
    for name, value in (("method", CHANCE_METHOD), ("pieces", chance.pieces), ("own", chance.own)):
        write_attribute(store["chance"], name, float(value))


def read_chance(store: h5py.File, path: Path, windows_m: tuple[float, ...]) -> Chance | None:
    """The chance that a map holds; None without one, and for one of another method or other windows than these.

    Raises:
        InputError: the group is damaged.
    """
    if "chance" not in store:
        return None
    group = store["chance"]
    told = {name: attribute_of(group, name) for name in ("method", "pieces", "own")}
    for name, value in told.items():
        if not isinstance(value, int | float):
            raise InputError(path, f"/chance@{name}", "a number", repr(value))
    if told["method"] != CHANCE_METHOD or not np.array_equal(group["window_m"][()], windows_m):
        return None
    fields = {name: group[name][()] for name in _FIELDS}
    return Chance(**fields, pieces=int(float(str(told["pieces"]))), own=bool(told["own"]))


def chance_as_text(chance: Chance) -> str:
    """The chance as JSON."""
    fields = {name: np.asarray(getattr(chance, name)).tolist() for name in _FIELDS}
    told = {"method": CHANCE_METHOD, **fields, "pieces": chance.pieces, "own": chance.own}
    return json.dumps(told, indent=1) + "\n"


def chance_of_text(text: str) -> Chance | None:
    """The chance of such a text; None where it is damaged or of another method."""
    try:
        told = json.loads(text)
        fields = {name: np.asarray(told[name], dtype=np.float64) for name in _FIELDS}
        chance = Chance(**fields, pieces=int(told["pieces"]), own=bool(told["own"]))
        known = told["method"] == CHANCE_METHOD
    except (ValueError, KeyError, TypeError):
        return None
    sound = all(field.shape == chance.start.shape and np.all(field > 0.0) for field in fields.values())
    return chance if known and sound and chance.start.ndim == 1 and bool(np.all(chance.share <= 1.0)) else None
