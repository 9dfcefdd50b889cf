"""Structure of files, without the numbers in them: what a reader of another program relies on."""

import hashlib
import json
import tomllib
from pathlib import Path
from typing import Any

import h5py
from mcap.reader import make_reader

from frozen.harness import ROOT

_VERSIONED = ("schema", "schema_version")
FILES = {
    "drive log, generated": "drives/live.drive.h5",
    "drive log, from messages": "again.drive.h5",
    "drive log of a vehicle": "vehicle/straight.drive.h5",
    "map": "m.map.h5",
    "map info": "info.json",
    "fixes": "default/live.fixes.h5",
    "fixes, table": "default/live.fixes.csv",
    "summary of a registration": "forced/summary.json",
    "table of many drives": "default/archive.csv",
    "figures of many drives": "default/archive.json",
    "findings of a check": "check.json",
    "route": "r.route.toml",
    "plan of a field": "p.cover.geojson",
    "worked area": "f.worked.h5",
    "figures of a worked area": "worked.json",
}
"""Kinds of files, and where the story has one."""


def messages_of(path: Path) -> dict[str, list[str]]:
    """Topics of a recording of ROS 2 messages: type and SHA-256 of its definition."""
    with path.open("rb") as stream:
        summary = make_reader(stream).get_summary()
    assert summary is not None
    found = {}
    for channel in summary.channels.values():
        schema = summary.schemas[channel.schema_id]
        found[channel.topic] = [schema.name, hashlib.sha256(schema.data).hexdigest()]
    return dict(sorted(found.items()))


def schema_digests() -> dict[str, str]:
    """SHA-256 of every file of ``data_schema/``."""
    files = sorted((ROOT / "data_schema").iterdir())
    return {path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in files if path.is_file()}


def structure_of(path: Path) -> Any:
    """Structure of a file by the end of its name.

    HDF5: datasets with type and number of dimensions, attributes by name, those that name the schema with their values.
    CSV: the header. JSON, GeoJSON and TOML: keys and types.
    """
    if path.suffix == ".h5":
        return _hdf5(path)
    text = path.read_text(encoding="utf-8")
    if path.suffix == ".csv":
        return text.splitlines()[0].split(",")
    if path.suffix == ".toml":
        return _keys(tomllib.loads(text))
    if path.suffix in (".json", ".geojson"):
        return _keys(json.loads(text))
    raise AssertionError(path)


def structures(folder: Path) -> dict[str, Any]:
    """Of all of them."""
    return {kind: structure_of(folder / name) for kind, name in FILES.items()}


def _hdf5(path: Path) -> dict[str, Any]:
    found: dict[str, Any] = {}

    def take(name: str, node: h5py.Group | h5py.Dataset) -> None:
        told: dict[str, Any] = {}
        if isinstance(node, h5py.Dataset):
            told = {"dtype": _dtype(node.dtype), "dimensions": node.ndim}
        attributes = {
            key: _text(node.attrs[key]) if key in _VERSIONED else _dtype(node.attrs.get_id(key).dtype)
            for key in sorted(node.attrs)
        }
        found["/" + name] = told | ({"attributes": attributes} if attributes else {})

    with h5py.File(path) as store:
        take("", store)
        store.visititems(take)
    return found


def _dtype(dtype: Any) -> str:
    """Strings of whatever length are strings."""
    if h5py.check_string_dtype(dtype) is not None:
        return "string"
    return str(dtype.descr if dtype.names else dtype)


def _text(value: Any) -> str:
    return value.decode() if isinstance(value, bytes) else str(value)


def _keys(value: Any) -> Any:
    """Keys with the types of their values; of a list, its different entries."""
    if isinstance(value, dict):
        return {key: str(each) if key in _VERSIONED else _keys(each) for key, each in sorted(value.items())}
    if isinstance(value, list):
        kinds: list[Any] = []
        for each in map(_keys, value):
            if each not in kinds:
                kinds.append(each)
        return kinds
    # A number that happens to be whole is a number.
    return "number" if type(value) in (int, float) else type(value).__name__
