"""Trajectories for other programs: TUM and KITTI for ``evo`` and its kin, GeoJSON and KML for GIS and globes."""

import json
from collections.abc import Mapping
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any, NamedTuple
from xml.etree import ElementTree

import numpy as np
from jaxtyping import Float

from lgprjax.errors import InputError
from lgprjax.formats.store import atomic_output
from lgprjax.frames import LocalFrame

_KML = "http://www.opengis.net/kml/2.2"


class Trajectory(NamedTuple):
    """Poses of an array's centre, one per scan; all of them known.

    Attributes:
        name: name of the drive.
        what: description of the source of the poses.
        t0_utc: origin of ``time_s``, ISO 8601.
        latitude_deg, longitude_deg, height_m: WGS-84 position.
        heading_deg: heading, clockwise from true north.
        roll_deg: roll, positive right side down.
        properties: further columns, for formats that have room for them.
    """

    name: str
    what: str
    t0_utc: str
    time_s: Float[np.ndarray, " scan"]
    latitude_deg: Float[np.ndarray, " scan"]
    longitude_deg: Float[np.ndarray, " scan"]
    height_m: Float[np.ndarray, " scan"]
    heading_deg: Float[np.ndarray, " scan"]
    roll_deg: Float[np.ndarray, " scan"]
    properties: Mapping[str, np.ndarray]


def write_trajectory(path: str | Path, trajectory: Trajectory, frame: LocalFrame, *, force: bool = False) -> None:
    """Write a trajectory in the format of the file's name.

    Args:
        path: path that ends in .tum, .kitti, .geojson or .kml.
        trajectory: trajectory of at least one pose.
        frame: frame of the metres of .tum and .kitti: x east, y north, z up.
        force: whether to replace an existing file.

    Raises:
        InputError: the name has another suffix, there is no pose, or the output exists (without ``force``) or cannot be
            written.
    """
    write = _WRITERS.get(Path(path).suffix.lower())
    if write is None:
        raise InputError(path, "file name", f"a name that ends in {', '.join(_WRITERS)}", f"{Path(path).suffix!r}")
    if not len(trajectory.time_s):
        raise InputError(path, "trajectory", f"at least one pose of {trajectory.what}", "none")
    with atomic_output(path, force) as temporary:
        temporary.write_text(write(trajectory, frame), encoding="utf-8", newline="\n")


def _poses(
    trajectory: Trajectory, frame: LocalFrame
) -> tuple[Float[np.ndarray, "scan 3"], Float[np.ndarray, "scan 4"]]:
    """Places, and quaternions x y z w of yaw and then roll: x forward, y left, z up."""
    place = frame.to_local(trajectory.latitude_deg, trajectory.longitude_deg, trajectory.height_m)
    yaw = 0.5 * frame.yaw_of_heading(trajectory.heading_deg, trajectory.longitude_deg)
    roll = 0.5 * np.radians(trajectory.roll_deg)
    quaternion = (
        np.cos(yaw) * np.sin(roll),
        np.sin(yaw) * np.sin(roll),
        np.sin(yaw) * np.cos(roll),
        np.cos(yaw) * np.cos(roll),
    )
    return np.stack(place, axis=1), np.stack(quaternion, axis=1)


def _tum(trajectory: Trajectory, frame: LocalFrame) -> str:
    began = datetime.fromisoformat(trajectory.t0_utc.replace("Z", "+00:00"))
    epoch_s = (began - datetime(1970, 1, 1, tzinfo=UTC)).total_seconds()
    place, quaternion = _poses(trajectory, frame)
    lines = [
        f"# {trajectory.name}, {trajectory.what}: timestamp tx ty tz qx qy qz qw",
        f"# metres east, north and up of {frame.latitude_deg:.9f} {frame.longitude_deg:.9f} {frame.height_m:.3f}",
    ]
    for time_s, row in zip(trajectory.time_s, np.concatenate([place, quaternion], axis=1), strict=True):
        lines.append(f"{epoch_s + time_s:.6f} " + " ".join(f"{value:.6f}" for value in row))
    return "\n".join(lines) + "\n"


def _kitti(trajectory: Trajectory, frame: LocalFrame) -> str:
    place, (x, y, z, w) = (lambda found: (found[0], found[1].T))(_poses(trajectory, frame))
    rows = np.stack(
        [
            *(1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w), place[:, 0]),
            *(2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w), place[:, 1]),
            *(2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y), place[:, 2]),
        ],
        axis=1,
    )
    # Adding 0 removes the sign of a zero.
    return "".join(" ".join(f"{value:.6f}" for value in row + 0.0) + "\n" for row in np.round(rows, 6))


def _geojson(trajectory: Trajectory, _: LocalFrame) -> str:
    places = [
        [round(float(longitude), 9), round(float(latitude), 9), round(float(height), 3)]
        for longitude, latitude, height in zip(
            trajectory.longitude_deg, trajectory.latitude_deg, trajectory.height_m, strict=True
        )
    ]
    columns = {"time_s": trajectory.time_s, "heading_deg": trajectory.heading_deg, **trajectory.properties}
    whole = {"name": trajectory.name, "what": trajectory.what, "t0_utc": trajectory.t0_utc}
    features = [_feature("LineString", places, whole)] if len(places) > 1 else []
    for number, place in enumerate(places):
        features.append(_feature("Point", place, {name: _plain(values[number]) for name, values in columns.items()}))
    return json.dumps({"type": "FeatureCollection", "features": features}, indent=None) + "\n"


def _feature(kind: str, coordinates: list[Any], properties: dict[str, Any]) -> dict[str, Any]:
    return {
        "type": "Feature",
        "geometry": {"type": kind, "coordinates": coordinates},
        "properties": properties,
    }


def _plain(value: Any) -> str | int | float | None:
    if isinstance(value, str):
        return str(value)
    if isinstance(value, np.integer):
        return int(value)
    return round(float(value), 6) if np.isfinite(value) else None


def _kml(trajectory: Trajectory, _: LocalFrame) -> str:
    began = datetime.fromisoformat(trajectory.t0_utc.replace("Z", "+00:00"))
    ElementTree.register_namespace("", _KML)
    root = ElementTree.Element(f"{{{_KML}}}kml")
    document = ElementTree.SubElement(root, f"{{{_KML}}}Document")
    mark = ElementTree.SubElement(document, f"{{{_KML}}}Placemark")
    ElementTree.SubElement(mark, f"{{{_KML}}}name").text = f"{trajectory.name}, {trajectory.what}"
    ElementTree.SubElement(
        mark, f"{{{_KML}}}description"
    ).text = (
        f"{len(trajectory.time_s)} poses from {(began + timedelta(seconds=float(trajectory.time_s[0]))).isoformat()}"
    )
    # KML's lines have two places or more.
    several = len(trajectory.time_s) > 1
    shape = ElementTree.SubElement(mark, f"{{{_KML}}}{'LineString' if several else 'Point'}")
    if several:
        ElementTree.SubElement(shape, f"{{{_KML}}}tessellate").text = "1"
    ElementTree.SubElement(shape, f"{{{_KML}}}coordinates").text = " ".join(
        f"{longitude:.9f},{latitude:.9f}"
        for longitude, latitude in zip(trajectory.longitude_deg, trajectory.latitude_deg, strict=True)
    )
    return '<?xml version="1.0" encoding="UTF-8"?>\n' + ElementTree.tostring(root, encoding="unicode") + "\n"


_WRITERS = {".tum": _tum, ".kitti": _kitti, ".geojson": _geojson, ".kml": _kml}
TRAJECTORY_SUFFIXES = tuple(_WRITERS)
