"""Waypoints of a route, written for other programs: CSV, GeoJSON, GPX."""

import csv
import json
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple
from xml.etree import ElementTree

import numpy as np
from jaxtyping import Float, Int

from lgprjax import __version__
from lgprjax.errors import InputError
from lgprjax.formats.atomic import atomic_output

_NAMESPACE = "http://www.topografix.com/GPX/1/1"
# Of a column each: 1e-10 degrees are a hundredth of a millimetre.
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
    """Write waypoints; the file's suffix says how.

    A CSV has one row a waypoint; GeoJSON one LineString a leg, its other columns as lists among the properties; GPX
    one track segment a leg with the other columns as extensions. Positions have ten decimals of a degree.

    Args:
        path: ``.csv``, ``.geojson`` or ``.gpx``.
        name: of the route.
        waypoints: to be written.
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
            # GPX counts elevation from sea level, which nothing here knows: the height goes with the extensions.
            place = {"lat": texts.pop("latitude_deg"), "lon": texts.pop("longitude_deg")}
            extensions = ElementTree.SubElement(ElementTree.SubElement(segment, "trkpt", place), "extensions")
            for column, text in texts.items():
                ElementTree.SubElement(extensions, column).text = text
    ElementTree.ElementTree(root).write(path, encoding="utf-8", xml_declaration=True)


def _legs(waypoints: Waypoints) -> Iterator[Waypoints]:
    for leg in np.unique(waypoints.leg):
        yield Waypoints(*(column[waypoints.leg == leg] for column in waypoints))
