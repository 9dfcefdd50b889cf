"""Trajectories as other programs read them, and two registrations of a drive compared, against plain arithmetic."""

import json
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pandas as pd
import pytest

from lgprjax.formats import Trajectory, write_trajectory
from lgprjax.frames import LocalFrame
from lgprjax.recordings import compare_fixes
from refusals import refused

_FRAME = LocalFrame(42.0, -71.0, 30.0)


def _trajectory(east_m: np.ndarray, north_m: np.ndarray, heading_deg: float, roll_deg: float) -> Trajectory:
    latitude, longitude, height = _FRAME.to_geodetic(east_m, north_m, 0.25 * np.ones_like(east_m))
    count = len(east_m)
    angles = (np.full(count, heading_deg), np.full(count, roll_deg))
    properties = {"scan": np.arange(count), "code": np.full(count, "ok"), "margin": np.full(count, np.nan)}
    time_s = 0.5 * np.arange(count)
    return Trajectory("d", "made", "2026-01-01T00:00:00Z", time_s, latitude, longitude, height, *angles, properties)


@pytest.fixture
def drive() -> Trajectory:
    """Twenty metres east and forty north, heading 30 degrees, right side down by 5."""
    way = np.linspace(0.0, 20.0, 9)
    return _trajectory(way, 2.0 * way, 30.0, 5.0)


def _matrix(heading_deg: float, roll_deg: float) -> np.ndarray:
    """Columns: forward, left and up of the body in east, north and up, one axis at a time."""
    yaw, roll = np.radians(90.0 - heading_deg), np.radians(roll_deg)
    forward = np.array([np.cos(yaw), np.sin(yaw), 0.0])
    level_left, up = np.array([-np.sin(yaw), np.cos(yaw), 0.0]), np.array([0.0, 0.0, 1.0])
    # Right side down: the left side rises.
    left = np.cos(roll) * level_left + np.sin(roll) * up
    return np.stack([forward, left, np.cross(forward, left)], axis=1)


def test_tum_and_kitti_have_places_and_attitudes(drive: Trajectory, tmp_path: Path) -> None:
    write_trajectory(tmp_path / "d.tum", drive, _FRAME)
    rows = np.loadtxt(tmp_path / "d.tum")
    way = np.linspace(0.0, 20.0, 9)
    np.testing.assert_allclose(rows[:, 0], 1767225600.0 + 0.5 * np.arange(9), atol=1e-6)
    np.testing.assert_allclose(rows[:, 1:4], np.stack([way, 2.0 * way, np.full(9, 0.25)], axis=1), atol=1e-5)
    x, y, z, w = rows[0, 4:]
    turned = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    np.testing.assert_allclose(turned, _matrix(30.0, 5.0), atol=1e-5)
    write_trajectory(tmp_path / "d.kitti", drive, _FRAME)
    rows = np.loadtxt(tmp_path / "d.kitti").reshape(-1, 3, 4)
    np.testing.assert_allclose(rows[4, :, :3], _matrix(30.0, 5.0), atol=1e-5)
    np.testing.assert_allclose(rows[4, :, 3], [10.0, 20.0, 0.25], atol=1e-5)


def test_geojson_and_kml_are_on_the_earth(drive: Trajectory, tmp_path: Path) -> None:
    for name in ("d.geojson", "d.kml"):
        write_trajectory(tmp_path / name, drive, _FRAME)
    told = json.loads((tmp_path / "d.geojson").read_text())
    line, *points = told["features"]
    assert line["geometry"]["type"] == "LineString"
    assert len(points) == 9
    assert points[3]["properties"]["code"] == "ok"
    assert points[3]["properties"]["margin"] is None
    longitude, latitude, height = points[8]["geometry"]["coordinates"]
    # Of 42 N on the ellipsoid: 111.08 km a degree of latitude, 82.85 km one of longitude.
    assert (latitude - 42.0) * 111_080.0 == pytest.approx(40.0, abs=0.02)
    assert (longitude + 71.0) * 82_850.0 == pytest.approx(20.0, abs=0.02)
    assert height == pytest.approx(30.25, abs=0.001)
    space = {"k": "http://www.opengis.net/kml/2.2"}
    places = ElementTree.parse(tmp_path / "d.kml").findtext(".//k:coordinates", "", space).split()
    assert len(places) == 9
    assert [float(part) for part in places[8].split(",")] == pytest.approx([longitude, latitude])


def test_what_cannot_be_written_is_refused(drive: Trajectory, tmp_path: Path) -> None:
    with refused(None, ".tum", ".kitti", ".geojson", ".kml", file="d.txt"):
        write_trajectory(tmp_path / "d.txt", drive, _FRAME)
    with refused(file="d.tum"):
        write_trajectory(tmp_path / "d.tum", _trajectory(np.zeros(0), np.zeros(0), 0.0, 0.0), _FRAME)
    assert list(tmp_path.iterdir()) == []


def _fixes(east_m: np.ndarray, north_m: np.ndarray, code: list[str], sigma_m: float = 0.05) -> pd.DataFrame:
    latitude, longitude, _ = _FRAME.to_geodetic(east_m, north_m, np.zeros_like(east_m))
    return pd.DataFrame(
        {
            "time_s": np.arange(len(code), dtype=float),
            "latitude_deg": latitude,
            "longitude_deg": longitude,
            "heading_deg": 0.0,
            "sigma_along_m": sigma_m,
            "sigma_cross_m": sigma_m,
            "correlation": np.linspace(0.5, 0.9, len(code)),
            "code": code,
        }
    )


def test_two_registrations_are_compared_where_both_are_ok() -> None:
    north = np.arange(6.0)
    first = _fixes(np.zeros(6), north, ["ok"] * 5 + ["edge"])
    # Heading north: east is to the right, so across is minus east. Scan 4 is 0.5 m off, scan 1 has no fix.
    second = _fixes(np.array([0.03, 9.0, 0.03, 0.03, 0.5, 0.0]), north + 0.04, ["ok", "ambiguous"] + ["ok"] * 4)
    found = compare_fixes(first, second, "second")
    assert (found.scans, found.ok_first, found.ok_second, found.ok_both) == (6, 5, 5, 4)
    assert found.codes == {"ok → ambiguous": 1, "edge → ok": 1}
    assert found.rms_along_m == pytest.approx(0.04, abs=1e-4)
    assert found.rms_cross_m == pytest.approx(np.sqrt((3 * 0.03**2 + 0.5**2) / 4), abs=1e-4)
    assert found.largest_m == pytest.approx(np.hypot(0.5, 0.04), abs=1e-4)
    assert found.within_95 == 0.75
    assert (found.apart, found.apart_at) == (1, ((4, 4),))
    json.dumps(found.as_json())


def test_fixes_of_two_drives_are_not_compared() -> None:
    table = _fixes(np.zeros(3), np.arange(3.0), ["ok"] * 3)
    with refused("rows", 3, found=2, file="second"):
        compare_fixes(table, table.iloc[:2], "second")
    with refused("column time_s", file="second"):
        compare_fixes(table, table.assign(time_s=table["time_s"] + 1.0), "second")
    one, other = table.copy(), table.copy()
    for told, each in ((one, "a"), (other, "b")):
        told.attrs["provenance"] = json.dumps({"drive": {"sha256": each}})
    with refused("provenance", file="second"):
        compare_fixes(one, other, "second")
    nothing = table.assign(code="edge")
    assert compare_fixes(nothing, nothing, "second").rms_cross_m is None


def test_one_pose_is_a_point_in_kml(tmp_path: Path) -> None:
    write_trajectory(tmp_path / "d.kml", _trajectory(np.zeros(1), np.zeros(1), 30.0, 5.0), _FRAME)
    root = ElementTree.parse(tmp_path / "d.kml").getroot()
    kml = "{http://www.opengis.net/kml/2.2}"
    assert root.find(f".//{kml}LineString") is None
    coordinates = root.findtext(f".//{kml}Point/{kml}coordinates")
    assert coordinates is not None
    np.testing.assert_allclose([float(part) for part in coordinates.split(",")], [-71.0, 42.0], atol=1e-8)
