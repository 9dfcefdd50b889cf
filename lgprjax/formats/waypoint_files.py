"""Waypoints of routes in files of other programs (CSV, GeoJSON, GPX), and turning points of a perimeter (CSV)."""

import csv
import json
import math
from collections.abc import Iterable, Iterator
from itertools import zip_longest
from pathlib import Path
from typing import Any, NamedTuple
from xml.etree import ElementTree

import numpy as np
from jaxtyping import Float, Int
from pyproj import Geod

from lgprjax import __version__
from lgprjax.errors import InputError
from lgprjax.formats.store import atomic_output

_NAMESPACE = "http://www.topografix.com/GPX/1/1"
# Decimals of each column: 1e-10 degrees are a hundredth of a millimetre.
_DECIMALS = (0, 0, 4, 10, 10, 4, 6, 7, 4)


class Waypoints(NamedTuple):
    """A route in the order of driving.

    Attributes:
        leg: number of the leg, from 0.
        gear: 1 forward, -1 reversing.
        arc_m: distance along the leg.
        latitude_deg, longitude_deg: WGS-84 position of the array's centre.
        height_m: ellipsoidal height of the ground.
        heading_deg: direction of travel, clockwise from true north; opposite to the body's heading if the gear is -1.
        curvature_radpm: curvature, positive to the left.
        speed_mps: highest speed.
    """

    leg: Int[np.ndarray, " row"]
    gear: Int[np.ndarray, " row"]
    arc_m: Float[np.ndarray, " row"]
    latitude_deg: Float[np.ndarray, " row"]
    longitude_deg: Float[np.ndarray, " row"]
    height_m: Float[np.ndarray, " row"]
    heading_deg: Float[np.ndarray, " row"]
    curvature_radpm: Float[np.ndarray, " row"]
    speed_mps: Float[np.ndarray, " row"]


class WaypointTrack(NamedTuple):
    """A track of a file, in the order of driving.

    Attributes:
        name: name of the track, or of the file if the track has none.
        latitude_deg, longitude_deg: WGS-84 position.
        height_m: ellipsoidal height, or the file's height; NaN without one.
        heading_deg: direction of travel, clockwise from true north; NaN if the file has none.
        gear: 1 forward, -1 reversing.
    """

    name: str
    latitude_deg: Float[np.ndarray, " point"]
    longitude_deg: Float[np.ndarray, " point"]
    height_m: Float[np.ndarray, " point"]
    heading_deg: Float[np.ndarray, " point"]
    gear: Int[np.ndarray, " point"]


def write_waypoints(path: str | Path, name: str, waypoints: Waypoints, *, force: bool = False) -> None:
    """Write waypoints in the format of the file's suffix.

    A CSV has one row per waypoint; GeoJSON one LineString per leg, with the other columns as lists among the
    properties; GPX one track segment per leg with the other columns as extensions. Positions have ten decimals of a
    degree.

    Args:
        path: path that ends in ``.csv``, ``.geojson`` or ``.gpx``.
        name: name of the route.
        waypoints: waypoints to write.
        force: whether to replace an existing output.

    Raises:
        InputError: the suffix is another, or the output cannot be written.
    """
    write = {".csv": _csv, ".geojson": _geojson, ".gpx": _gpx}.get(Path(path).suffix.lower())
    if write is None:
        raise InputError(path, "output", "a file name with suffix .csv, .geojson or .gpx", repr(Path(path).name))
    with atomic_output(path, force) as temporary:
        write(temporary, name, waypoints)


def _csv(path: Path, _: str, waypoints: Waypoints) -> None:
    with path.open("w", newline="", encoding="utf-8") as stream:
        table = csv.writer(stream)
        table.writerow(Waypoints._fields)
        for row in zip(*waypoints, strict=True):
            table.writerow([f"{value:.{decimals}f}" for value, decimals in zip(row, _DECIMALS, strict=True)])


def _geojson(path: Path, name: str, waypoints: Waypoints) -> None:
    features = []
    for leg in _legs(waypoints):
        columns = {
            column: np.round(values, decimals).tolist()
            for column, values, decimals in zip(Waypoints._fields, leg, _DECIMALS, strict=True)
        }
        places = np.stack([columns.pop("longitude_deg"), columns.pop("latitude_deg"), columns.pop("height_m")], axis=1)
        properties = {"name": name, "leg": columns.pop("leg")[0], "gear": columns.pop("gear")[0], **columns}
        features.append(
            {
                "type": "Feature",
                "geometry": {"type": "LineString", "coordinates": places.tolist()},
                "properties": properties,
            }
        )
    collection = {"type": "FeatureCollection", "features": features}
    path.write_text(json.dumps(collection) + "\n", encoding="utf-8")


def _gpx(path: Path, name: str, waypoints: Waypoints) -> None:
    root = ElementTree.Element("gpx", {"xmlns": _NAMESPACE, "version": "1.1", "creator": f"lgprjax {__version__}"})
    track = ElementTree.SubElement(root, "trk")
    ElementTree.SubElement(track, "name").text = name
    for leg in _legs(waypoints):
        segment = ElementTree.SubElement(track, "trkseg")
        for row in zip(*leg, strict=True):
            texts = {
                column: f"{value:.{decimals}f}"
                for column, value, decimals in zip(Waypoints._fields, row, _DECIMALS, strict=True)
            }
            # GPX elevations are above sea level, which is unknown here: the height goes into the extensions.
            place = {"lat": texts.pop("latitude_deg"), "lon": texts.pop("longitude_deg")}
            extensions = ElementTree.SubElement(ElementTree.SubElement(segment, "trkpt", place), "extensions")
            for column, text in texts.items():
                ElementTree.SubElement(extensions, column).text = text
    ElementTree.ElementTree(root).write(path, encoding="utf-8", xml_declaration=True)


def _legs(waypoints: Waypoints) -> Iterator[Waypoints]:
    for leg in np.unique(waypoints.leg):
        yield Waypoints(*(column[waypoints.leg == leg] for column in waypoints))


# Tracks of other programs, read.

_Row = dict[str, Any]


def read_waypoints(path: str | Path) -> list[WaypointTrack]:
    """Tracks of a file; of one that ``write_waypoints`` wrote, headings and gears too. Speeds are not read.

    Args:
        path: ``.csv`` with columns ``latitude_deg`` and ``longitude_deg``; ``.geojson`` with LineStrings, those of one
            name being one track; ``.gpx`` with tracks or routes.

    Raises:
        InputError: another suffix, the file cannot be read, it has no track, or a position is not one.
    """
    file = Path(path)
    read = {".csv": _csv_rows, ".geojson": _geojson_rows, ".gpx": _gpx_rows}.get(file.suffix.lower())
    if read is None:
        raise InputError(file, "file name", "waypoints with suffix .csv, .geojson or .gpx", repr(file.name))
    try:
        tracks = dict(read(file))
    except OSError as error:
        raise InputError(file, "file", "a readable file", error.strerror or str(error)) from None
    except UnicodeDecodeError as error:
        raise InputError(file, "file", "text in UTF-8", str(error)) from None
    except (ElementTree.ParseError, json.JSONDecodeError) as error:
        raise InputError(file, "file", f"a {file.suffix} file", str(error)) from None
    if not tracks or any(len(rows) < 2 for rows in tracks.values()):
        found = ", ".join(f"{name}: {len(rows)}" for name, rows in tracks.items()) or "no track"
        raise InputError(file, "waypoints", "tracks of two waypoints or more", found)
    return [_track(file, name, rows) for name, rows in tracks.items()]


_BOUNDS = {"latitude_deg": 90.0, "longitude_deg": 180.0}


def _track(file: Path, name: str, rows: list[_Row]) -> WaypointTrack:
    latitude, longitude, height, heading, gear = (
        np.array([_number(file, name, at, row, column) for at, row in enumerate(rows, 1)])
        for column in ("latitude_deg", "longitude_deg", "height_m", "heading_deg", "gear")
    )
    gear = np.where(np.isfinite(gear), gear, 1.0)
    if set(np.unique(gear)) - {-1.0, 1.0}:
        raise InputError(file, f"{name}: gear", "1 or -1", f"{gear[np.abs(gear) != 1.0][0]:g}")
    return WaypointTrack(name, latitude, longitude, height, heading, gear.astype(np.int64))


def _number(file: Path, name: str, at: int, row: _Row, column: str) -> float:
    """A number of a waypoint; NaN for one that is not needed and not there."""
    value, largest = row.get(column), _BOUNDS.get(column, math.inf)
    if value in (None, "") and column not in _BOUNDS:
        return math.nan
    try:
        number = float(value)  # type: ignore[arg-type]  # None is caught
    except (TypeError, ValueError):
        number = math.nan
    if not (math.isfinite(number) and abs(number) <= largest):
        expected = f"degrees of at most {largest:g}" if column in _BOUNDS else "a finite number"
        raise InputError(file, f"{name}, waypoint {at}: {column}", expected, repr(value))
    return number


def _csv_rows(file: Path) -> Iterator[tuple[str, list[_Row]]]:
    table = csv.DictReader(file.read_text(encoding="utf-8-sig").splitlines(), skipinitialspace=True)
    missing = set(_BOUNDS) - set(table.fieldnames or [])
    if missing:
        found = ", ".join(table.fieldnames or []) or "none"
        raise InputError(file, "columns", " and ".join(sorted(missing)), found)
    yield file.stem, list(table)


def _geojson_rows(file: Path) -> Iterable[tuple[str, list[_Row]]]:
    held = json.loads(file.read_text(encoding="utf-8-sig"))
    features = held.get("features", [held]) if isinstance(held, dict) else []
    tracks: dict[str, list[_Row]] = {}
    for feature in features if isinstance(features, list) else []:
        known = feature if isinstance(feature, dict) else {}
        geometry, properties = known.get("geometry", known), known.get("properties")
        if not isinstance(geometry, dict) or geometry.get("type") != "LineString":
            continue
        properties = properties if isinstance(properties, dict) else {}
        rows = tracks.setdefault(str(properties.get("name") or file.stem), [])
        places, headings = (
            each if isinstance(each, list) else []
            for each in (geometry.get("coordinates"), properties.get("heading_deg"))
        )
        for place, heading in zip_longest(places, headings[: len(places)]):
            numbers = place if isinstance(place, list) else []
            row = dict(zip(("longitude_deg", "latitude_deg", "height_m"), numbers, strict=False))
            rows.append(row | {"heading_deg": heading, "gear": properties.get("gear")})
    return tracks.items()


def _gpx_rows(file: Path) -> Iterable[tuple[str, list[_Row]]]:
    tracks: dict[str, list[_Row]] = {}
    for line in ElementTree.parse(file).getroot():
        if _local(line) not in ("trk", "rte"):
            continue
        texts = {_local(each): each.text for each in line}
        rows = tracks.setdefault(str(texts.get("name") or file.stem), [])
        for point in line.iter():
            if _local(point) in ("trkpt", "rtept"):
                own = {_local(each): each.text for each in point.iter()}
                height = own.get("height_m", own.get("ele"))
                place = {"latitude_deg": point.get("lat"), "longitude_deg": point.get("lon"), "height_m": height}
                rows.append({**place, "heading_deg": own.get("heading_deg"), "gear": own.get("gear")})
    return tracks.items()


def _local(element: "ElementTree.Element") -> str:
    """Name of an element without its namespace."""
    return str(element.tag).rpartition("}")[2]


# Turning points of a perimeter as a table: position, and bearing and distance to each.

DATUM = "WGS 84"
_POINT_COLUMNS = (
    "point",
    "latitude_deg",
    "longitude_deg",
    "datum",
    "bearing_from_benchmark_deg",
    "distance_from_benchmark_m",
    "bearing_to_next_deg",
    "distance_to_next_m",
)
# A millimetre of distance, and a bearing of equal accuracy at 100 m.
_DEGREES, _BEARING, _METRES = 10, 4, 3


def write_turning_points(
    path: str | Path,
    latitude_deg: Float[np.ndarray, " corner"],
    longitude_deg: Float[np.ndarray, " corner"],
    benchmark_deg: tuple[float, float] | None,
    *,
    force: bool = False,
) -> None:
    """Write the benchmark and the turning points TP1, TP2, ... in the perimeter's order.

    Bearings (true, clockwise from north) and distances are those of the geodesic on the ellipsoid.

    Args:
        path: path of the CSV file.
        latitude_deg, longitude_deg: positions of the corners.
        benchmark_deg: latitude and longitude of the benchmark; ``None``: the first turning point.
        force: whether to replace an existing output.

    Raises:
        InputError: the output exists (without ``force``) or cannot be written.
    """
    ellipsoid = Geod(ellps="WGS84")
    mark = (float(latitude_deg[0]), float(longitude_deg[0])) if benchmark_deg is None else benchmark_deg

    def way(start: tuple[float, float], end: tuple[float, float]) -> tuple[str, str]:
        bearing, _, distance_m = ellipsoid.inv(start[1], start[0], end[1], end[0])
        told = round(float(bearing) % 360.0, _BEARING) % 360.0
        return f"{told:.{_BEARING}f}" if distance_m > 0.0 else "", f"{distance_m:.{_METRES}f}"

    corners = [(float(one), float(other)) for one, other in zip(latitude_deg, longitude_deg, strict=True)]
    first = "BM" if benchmark_deg is not None else "BM (first turning point)"
    rows = [[first, *_point(mark), DATUM, "", "", *way(mark, corners[0])]]
    for number, corner in enumerate(corners):
        following = corners[(number + 1) % len(corners)]
        rows.append([f"TP{number + 1}", *_point(corner), DATUM, *way(mark, corner), *way(corner, following)])
    with atomic_output(path, force) as temporary, temporary.open("w", newline="", encoding="utf-8") as stream:
        table = csv.writer(stream)
        table.writerow(_POINT_COLUMNS)
        table.writerows(rows)


def _point(place: tuple[float, float]) -> list[str]:
    return [f"{value:.{_DEGREES}f}" for value in place]
