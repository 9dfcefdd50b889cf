"""Where a field is: a GeoJSON polygon, a CSV of three corners, or the corners that were marked on a run."""

import csv
import json
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from lgprjax.errors import InputError

CORNERS_FILE = "corners.csv"
"""Beside the segments of a run in which corners were marked."""
_CORNERS = 3
_COLUMNS = ("latitude_deg", "longitude_deg")
# Every name under which files of the time before RFC 7946 say longitude and latitude on WGS-84.
_WGS84 = ("urn:ogc:def:crs:OGC:1.3:CRS84", "urn:ogc:def:crs:OGC::CRS84", "EPSG:4326", "urn:ogc:def:crs:EPSG::4326")


class FieldPlaces(NamedTuple):
    """Corners of a field on WGS-84.

    Attributes:
        latitude_deg, longitude_deg, height_m: of each; the height is ellipsoidal, 0 where the file tells none.
        driven: three corners that were driven to; the fourth is to be found. Else all of them.
    """

    latitude_deg: Float[np.ndarray, " corner"]
    longitude_deg: Float[np.ndarray, " corner"]
    height_m: Float[np.ndarray, " corner"]
    driven: bool


def read_field(path: str | Path) -> FieldPlaces:
    """Corners from a file, or from the folder of a run.

    Args:
        path: ``.geojson`` or ``.json`` with one polygon; ``.csv`` with three rows of ``latitude_deg``,
            ``longitude_deg`` and, if known, ``height_m``; a folder with ``corners.csv``.

    Raises:
        InputError: the file cannot be read, is of another kind, holds no or several polygons, holes, coordinates that
            are not degrees, or not three corners.
    """
    file = Path(path)
    if file.is_dir():
        marked = file / CORNERS_FILE
        if not marked.is_file():
            raise InputError(file, "corners", f"three corners marked while driving ({CORNERS_FILE})", "none")
        return _from_csv(marked)
    readers = {".csv": _from_csv, ".geojson": _from_geojson, ".json": _from_geojson}
    reader = readers.get(file.suffix.lower())
    if reader is None:
        expected = "a .geojson polygon, a .csv of three corners, or the folder of a run"
        raise InputError(file, "file name", expected, repr(file.name))
    return reader(file)


def _text(file: Path) -> str:
    try:
        return file.read_text(encoding="utf-8-sig")
    except OSError as error:
        raise InputError(file, "file", "a readable file", error.strerror or str(error)) from None
    except UnicodeDecodeError as error:
        raise InputError(file, "file", "text in UTF-8", str(error)) from None


def _from_csv(file: Path) -> FieldPlaces:
    reader = csv.DictReader(_text(file).splitlines(), skipinitialspace=True)
    names = reader.fieldnames or []
    for name in _COLUMNS:
        if name not in names:
            raise InputError(file, name, f"a column {name}", ", ".join(names) or "an empty file")
    rows = list(reader)
    if len(rows) != _CORNERS:
        raise InputError(file, "corners", "three rows, one a corner", str(len(rows)))
    values = np.zeros((_CORNERS, 3))
    for number, row in enumerate(rows):
        for column, name in enumerate((*_COLUMNS, "height_m")):
            if name in names:
                values[number, column] = _number(file, f"row {number + 1}, {name}", row[name])
    return _checked(file, values, driven=True)


def _number(file: Path, place: str, text: str | None) -> float:
    try:
        value = float(text or "")
    except ValueError:
        value = float("nan")
    if not np.isfinite(value):
        raise InputError(file, place, "a number", repr(text))
    return value


def _from_geojson(file: Path) -> FieldPlaces:
    try:
        table = json.loads(_text(file))
    except json.JSONDecodeError as error:
        raise InputError(file, "file", "GeoJSON", f"no JSON ({error.msg}, line {error.lineno})") from None
    if not isinstance(table, dict):
        raise InputError(file, "file", "a GeoJSON object", type(table).__name__)
    told = table.get("crs")
    name = told.get("properties", {}).get("name") if isinstance(told, dict) else told
    if told is not None and name not in _WGS84:
        raise InputError(file, "crs", "WGS-84 longitude and latitude (save the layer as EPSG:4326)", repr(name)[:60])
    polygons = [each for each in _geometries(table) if each.get("type") in ("Polygon", "MultiPolygon")]
    if len(polygons) != 1:
        raise InputError(file, "geometry", "one Polygon", f"{len(polygons) or 'none'}")
    (polygon,) = polygons
    rings = polygon.get("coordinates")
    if polygon["type"] == "MultiPolygon":
        if not isinstance(rings, list) or len(rings) != 1:
            raise InputError(file, "geometry", "one Polygon", "a MultiPolygon of several, or of none")
        rings = rings[0]
    if not isinstance(rings, list) or not rings or not rings[0]:
        raise InputError(file, "geometry", "a Polygon with corners", "an empty one")
    if len(rings) > 1:
        raise InputError(file, "geometry", "a Polygon without holes", f"{len(rings) - 1} of them")
    values = np.array([_position(file, number, each) for number, each in enumerate(rings[0])])
    if len(values) > 1 and np.array_equal(values[0], values[-1]):
        values = values[:-1]
    return _checked(file, values, driven=False)


def _geometries(table: dict[str, Any]) -> list[dict[str, Any]]:
    """Geometries of a GeoJSON object, whatever kind it is."""
    kind = table.get("type")
    members = {"FeatureCollection": "features", "GeometryCollection": "geometries"}.get(str(kind))
    if members is not None:
        inner = table.get(members)
        each = [item for item in inner if isinstance(item, dict)] if isinstance(inner, list) else []
        return [geometry for item in each for geometry in _geometries(item)]
    if kind == "Feature":
        geometry = table.get("geometry")
        return _geometries(geometry) if isinstance(geometry, dict) else []
    return [table]


def _position(file: Path, number: int, position: object) -> tuple[float, float, float]:
    """Latitude, longitude and height of a GeoJSON position."""
    place = f"corner {number + 1}"
    if not isinstance(position, list) or len(position) < 2:
        raise InputError(file, place, "longitude and latitude", repr(position)[:40])
    longitude, latitude, height = (_number(file, place, str(each)) for each in (*position, 0.0)[:3])
    return latitude, longitude, height


def _checked(file: Path, values: Float[np.ndarray, "corner 3"], *, driven: bool) -> FieldPlaces:
    latitude, longitude, height = values.T
    beyond = (np.abs(latitude) > 90.0) | (np.abs(longitude) > 180.0)
    if beyond.any():
        corner = int(np.argmax(beyond))
        found = f"{latitude[corner]:.10g} and {longitude[corner]:.10g}"
        if np.all(np.abs(longitude) <= 90.0) and np.all(np.abs(latitude) <= 180.0):
            found += ", which look swapped"
        elif abs(latitude[corner]) > 360.0 or abs(longitude[corner]) > 360.0:
            found += ", which look like metres of a projection"
        raise InputError(file, f"corner {corner + 1}", "latitude (-90 to 90) and longitude (-180 to 180)", found)
    return FieldPlaces(latitude, longitude, height, driven)
