"""Validate any of the project's files against its schema and report every problem."""

from collections.abc import Callable, Iterator
from pathlib import Path

import h5py
import numpy as np

from lgprjax.errors import InputError
from lgprjax.formats.coverage_files import cover_plan_findings
from lgprjax.formats.fixes import parse_cells, read_cells, table_findings
from lgprjax.formats.map_file import MapFile
from lgprjax.formats.map_layout import UNIT
from lgprjax.formats.plausible import plausible_positions, reach_in_time_m
from lgprjax.formats.route_files import route_findings
from lgprjax.formats.schema import Finding, Schema, load_schema
from lgprjax.formats.store import DAMAGE, attribute_of, open_store, validate_store
from lgprjax.formats.vehicle import vehicle_findings

# Checks of a map beyond its schema: whether its parts agree with each other.

_SCHEMA = load_schema("map")
_SLACK_M = 1e-6


def map_findings(path: Path) -> Iterator[Finding]:
    """Findings of a subsurface database; all of it is read, and its stretches are compared with its places."""
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
    """Stations outside their stretch would never be found; drives in several parts would be split."""
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
            yield Finding(file, "/baselines", "stations sorted by drive", f"another order near station {start}")
        before = int(where.drive[-1])
    if astray:
        yield Finding(file, "/stretches/reach_m", "stretches that contain their stations", f"{astray} stations outside")


def _check_drive(path: Path) -> Iterator[Finding]:
    """Findings of a drive log: against its schema, and whether a vehicle can have been at all of its positions."""
    found = list(_check_store(load_schema("drive"))(path))
    yield from found
    if any(finding.severity == "error" for finding in found):
        return
    with open_store(path) as store:
        time_s, latitude, longitude = (
            store[f"/gnss_ins/{name}"][:] for name in ("time_s", "latitude_deg", "longitude_deg")
        )
        sigma_m = store["/gnss_ins/sigma_east_m"][:] if "/gnss_ins/sigma_east_m" in store else None
    judged = plausible_positions(latitude, longitude, reach_in_time_m(time_s), sigma_m)
    if judged.left_out:
        counts = ", ".join(f"{count} of {len(time_s)} {reason}" for reason, count in judged.left_out.items())
        first = f"{counts}, the first at index {int(np.argmin(judged.kept))}"
        yield Finding(str(path), "/gnss_ins", "positions that one vehicle can reach", first)


def check_file(path: str | Path) -> list[Finding]:
    """Findings of a file, by its suffix: ``.drive.h5``, ``.map.h5``, ``.vehicle.toml`` and others with a schema.

    An HDF5 file with another suffix is validated against the schema that it names itself. Radar data are read block by
    block, so that memory stays small. An empty list means that the file is valid.

    Raises:
        InputError: the file's name has none of these suffixes, and it names no schema.
    """
    file = Path(path)
    named = file.name.lower()
    suffix = next((each for each in _CHECKS if named.endswith(each)), None) or _suffix_by_schema(file)
    if suffix is None:
        raise InputError(path, "file name", "a suffix among " + ", ".join(_CHECKS), repr(file.name))
    try:
        return list(_CHECKS[suffix](file))
    except InputError as error:
        return [Finding(error.file, error.place, error.expected, error.found)]


def _suffix_by_schema(file: Path) -> str | None:
    """The suffix that an HDF5 file should have, by the schema that it names; None for other files."""
    if not (file.is_file() and h5py.is_hdf5(file)):
        return None
    try:
        with open_store(file) as store:
            named = str(attribute_of(store, "schema"))
    except (InputError, *DAMAGE):
        return None
    suffix = f".{named.removeprefix('lgprjax.')}.h5"
    return suffix if suffix in _CHECKS else None


def _check_store(schema: Schema) -> Callable[[Path], Iterator[Finding]]:
    def check(path: Path) -> Iterator[Finding]:
        with open_store(path) as store:
            yield from validate_store(store, path, schema, bulk=True)

    return check


def _check_fixes_csv(path: Path) -> Iterator[Finding]:
    table, findings = parse_cells(path, read_cells(path))
    yield from findings
    # A column that could not be read is reported above, not again as missing.
    named = " ".join(finding.place for finding in findings)
    yield from (f for f in table_findings(path, table) if f.found != "none" or f.place not in named)


_CHECKS: dict[str, Callable[[Path], Iterator[Finding]]] = {
    ".drive.h5": _check_drive,
    ".map.h5": map_findings,
    ".fixes.h5": _check_store(load_schema("fixes")),
    ".fixes.csv": _check_fixes_csv,
    ".route.toml": route_findings,
    ".vehicle.toml": vehicle_findings,
    ".cover.geojson": cover_plan_findings,
    ".worked.h5": _check_store(load_schema("worked")),
    ".radar.h5": _check_store(load_schema("radar")),
}
