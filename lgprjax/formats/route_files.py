"""The route file ``X.route.toml`` and waypoints of other programs."""

import csv
import json
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Literal, NamedTuple
from xml.etree import ElementTree

import numpy as np
from jaxtyping import Float, Int

from lgprjax import __version__
from lgprjax.errors import InputError
from lgprjax.files import load_toml
from lgprjax.formats.schema import Finding, check_version, key_findings, load_schema
from lgprjax.formats.store import atomic_output

_SCHEMA = load_schema("route")
_DIGITS = 64


class RouteFile(NamedTuple):
    """Contents of a route file; paths are ready to open.

    Attributes:
        map: the subsurface database.
        map_sha256: of the database that the route was chosen from.
        route: name of the baseline.
        from_m, to_m: the stretch, along the baseline as recorded.
        direction: as recorded, or from the stretch's end to its beginning.
        cruise_mps: highest speed.
        lateral_mps2: highest lateral acceleration.
        vehicle: the vehicle file whose smallest radius the route was checked against.
    """

    map: Path
    map_sha256: str
    route: str
    from_m: float
    to_m: float
    direction: Literal["along", "against"]
    cruise_mps: float
    lateral_mps2: float
    vehicle: Path | None


def read_route(path: str | Path) -> RouteFile:
    """A route from its file; whether the map is unchanged is checked elsewhere (``mapping.require_map``).

    Raises:
        InputError: the file is missing, not TOML or of a newer major version; a key is unknown, missing, of a wrong
            type or out of its range.
    """
    file = Path(path)
    table = load_toml(file)
    for finding in _problems(file, table):
        raise finding.error()
    vehicle = table.get("vehicle")
    return RouteFile(
        file.parent / table["map"],
        table["map_sha256"],
        table["route"],
        float(table["from_m"]),
        float(table["to_m"]),
        table["direction"],
        float(table["cruise_mps"]),
        float(table["lateral_mps2"]),
        None if vehicle is None else file.parent / vehicle,
    )


def write_route(path: str | Path, route: RouteFile, *, force: bool = False) -> None:
    """Write a route to its file, each key with its description and paths relative to the file's folder.

    Raises:
        InputError: a value does not match the schema, or the output exists (without ``force``) or cannot be written.
    """
    folder = Path(path).parent
    values = {key: value for key, value in route._asdict().items() if value is not None}
    for key in ("map", "vehicle"):
        if key in values:
            # Not resolved: paths through a link stay as the user made them.
            values[key] = Path(os.path.relpath(values[key], folder)).as_posix()
    table = {"schema": _SCHEMA.name, "schema_version": _SCHEMA.version, **values}
    for finding in _problems(path, table):
        raise finding.error()
    described = {entry.path: entry.description for entry in _SCHEMA.keys}
    lines = []
    for key, value in table.items():
        # A JSON string is a TOML string, and a JSON number of Python's a TOML number.
        line = f"{key} = {json.dumps(value, ensure_ascii=False)}"
        lines.append(f"{line}  # {described[key]}" if key in described else line)
    with atomic_output(path, force) as temporary:
        temporary.write_text("\n".join(lines) + "\n", encoding="utf-8")


def route_findings(path: Path) -> Iterator[Finding]:
    """Every problem of a route file.

    Raises:
        InputError: it cannot be read, or is not TOML.
    """
    return _problems(path, load_toml(path))


def _problems(path: str | Path, table: dict[str, Any]) -> Iterator[Finding]:
    """Every problem of a table, header included; rules between numbers only where the numbers are valid."""
    refusal = check_version(_SCHEMA, table.get("schema"), table.get("schema_version"))
    if refusal is not None:
        yield Finding(str(path), *refusal)
        return
    values = {key: value for key, value in table.items() if key not in ("schema", "schema_version")}
    problems = list(key_findings(_SCHEMA, str(path), values))
    yield from problems
    if any(finding.found != "an unknown key" for finding in problems):
        return
    if table["to_m"] <= table["from_m"]:
        yield Finding(str(path), "to_m", f"more than from_m, {table['from_m']:g}", f"{table['to_m']:g}")
    digest = table["map_sha256"]
    if len(digest) != _DIGITS or set(digest) - set("0123456789abcdef"):
        yield Finding(str(path), "map_sha256", f"{_DIGITS} hexadecimal digits", repr(digest)[:_DIGITS])


# Waypoints of a route, written for other programs: CSV, GeoJSON, GPX.

_NAMESPACE = "http://www.topografix.com/GPX/1/1"
# Decimals of each column: 1e-10 degrees are a hundredth of a millimetre.
_DECIMALS = (0, 0, 4, 10, 10, 4, 6, 7, 4)


class Waypoints(NamedTuple):
    """A route in the order of driving.

    Attributes:
        leg: its number, from 0.
        gear: 1 forward, -1 reversing.
        arc_m: along the leg.
        latitude_deg, longitude_deg: WGS-84, of the array's centre.
        height_m: ellipsoidal, of the ground.
        heading_deg: of travel, clockwise from true north; the body points the other way where the gear is -1.
        curvature_radpm: positive to the left.
        speed_mps: highest.
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


def write_waypoints(path: str | Path, name: str, waypoints: Waypoints, *, force: bool = False) -> None:
    """Write waypoints in the format of the file's suffix.

    A CSV has one row a waypoint; GeoJSON one LineString a leg, its other columns as lists among the properties; GPX
    one track segment a leg with the other columns as extensions. Positions have ten decimals of a degree.

    Args:
        path: ``.csv``, ``.geojson`` or ``.gpx``.
        name: of the route.
        waypoints: to write.
        force: replace an output that exists.

    Raises:
        InputError: another suffix, or the output cannot be written.
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
