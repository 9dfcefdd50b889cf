"""What a schema cannot say of a map: whether its parts agree with each other."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from lgprjax.errors import InputError
from lgprjax.formats.findings import Finding
from lgprjax.formats.map_file import MapFile
from lgprjax.formats.map_rows import UNIT
from lgprjax.formats.schema import load_schema
from lgprjax.formats.store import open_store, validate_store

_SCHEMA = load_schema("map")
_SLACK_M = 1e-6


def map_findings(path: Path) -> Iterator[Finding]:
    """Findings of a subsurface database; all of it is read, and its stretches are held against its places."""
    with open_store(path) as store:
        found = list(validate_store(store, path, _SCHEMA, bulk=True))
    yield from found
    if any(finding.severity == "error" for finding in found):
        return
    try:
        with MapFile.open(path) as source:
            yield from _contents(source)
    except InputError as error:
        yield Finding(error.file, error.place, error.expected, error.found)


def _contents(source: MapFile) -> Iterator[Finding]:
    """Stations that their stretch does not reach would never be found; drives that come again would be cut in two."""
    file, stretches = str(source.path), source.places.stretches
    middle_m = stretches.chord_m.mean(axis=1)
    astray, before = 0, 0
    for start in range(0, len(source.places), UNIT):
        stations = np.arange(start, min(start + UNIT, len(source.places)))
        where = source.places.read(stations)
        own = np.searchsorted(stretches.first, stations, "right") - 1
        apart_m = np.hypot(*(where.pose[:, :2] - middle_m[own]).T)
        astray += int(np.sum(apart_m > stretches.reach_m[own] + _SLACK_M))
        if np.any(np.diff(where.drive, prepend=before) < 0):
            yield Finding(file, "/baselines", "drives one after the other", f"another order about station {start}")
        before = int(where.drive[-1])
    if astray:
        yield Finding(file, "/stretches/reach_m", "stretches that reach their stations", f"{astray} stations beyond")
