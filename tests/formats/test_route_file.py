"""The route file and waypoints: there and back, and one clear line for each thing that is wrong."""

import csv
import json
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

from lgprjax.formats import (
    RouteFile,
    Waypoints,
    load_schema,
    read_route,
    read_waypoints,
    route_findings,
    write_route,
    write_waypoints,
)
from refusals import refused


def chosen(folder: Path) -> RouteFile:
    return RouteFile(folder / "m.map.h5", "ab" * 32, 'a "road"', 3.5, 80.25, "against", 4.0, 1.5, None)


def test_what_is_written_is_read_and_paths_follow_the_file(tmp_path: Path) -> None:
    (tmp_path / "routes").mkdir()
    route = chosen(tmp_path)._replace(vehicle=tmp_path / "v.vehicle.toml")
    path = tmp_path / "routes" / "x.route.toml"
    write_route(path, route)
    assert 'map = "../m.map.h5"' in path.read_text()
    read = read_route(path)
    assert read.map.resolve() == route.map.resolve()
    assert read.vehicle is not None
    assert read.vehicle.resolve() == (tmp_path / "v.vehicle.toml").resolve()
    assert read._replace(map=route.map, vehicle=route.vehicle) == route
    with refused("output", "--force"):
        write_route(path, route)
    write_route(path, route._replace(vehicle=None), force=True)
    assert read_route(path).vehicle is None
    # The schema tells every key.
    assert [entry.path for entry in load_schema("route").keys] == list(RouteFile._fields)


_WRONG: list[tuple[str, str, str, tuple[object, ...]]] = [
    ('schema = "lgprjax.route"', 'schema = "lgprjax.vehicle"', "@schema", ("lgprjax.route",)),
    ('schema_version = "1.1"', 'schema_version = "2.0"', "@schema_version", ("2.0",)),
    ("from_m = 3.5", "from_m = -1", "from_m", (-1,)),
    ("from_m = 3.5", "from_m = 90", "to_m", (90, 80.25)),
    ("to_m = 80.25", "to_m = nan", "to_m", ("nan",)),
    ("cruise_mps = 4.0", "", "cruise_mps", (0, 50, "none")),
    ('direction = "against"', 'direction = "back"', "direction", ("along", "against", "back")),
    ("lateral_mps2 = 1.5", "lateral_mps2 = 1.5\nlane = 2", "lane", ("data_schema/route.toml",)),
    ("abab", "xy", "map_sha256", (64,)),
    ("to_m = 80.25", "to_m = ", "file", ("TOML",)),
]


def test_a_wrong_file_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "x.route.toml"
    write_route(path, chosen(tmp_path))
    text = path.read_text()
    for old, new, place, values in _WRONG:
        path.write_text(text.replace(old, new, 1))
        with refused(place, *values, file=path):
            read_route(path)


def test_findings_name_every_problem(tmp_path: Path) -> None:
    path = tmp_path / "x.route.toml"
    write_route(path, chosen(tmp_path))
    assert list(route_findings(path)) == []
    text = path.read_text().replace("from_m = 3.5", "from_m = -1").replace("cruise_mps = 4.0", "cruise_mps = 0")
    path.write_text(text)
    assert [finding.place for finding in route_findings(path)] == ["from_m", "cruise_mps"]
    with refused("file", file="none.route.toml"):
        read_route(tmp_path / "none.route.toml")


@pytest.fixture
def waypoints() -> Waypoints:
    count = 7
    along = np.arange(count, dtype=np.float64)
    return Waypoints(
        np.array([0, 0, 0, 0, 1, 1, 1]),
        np.array([1, 1, 1, 1, -1, -1, -1]),
        0.25 * along,
        42.0 + 1.23456789e-6 * along,
        -71.0 - 3.21e-6 * along,
        30.0 + 0.01 * along,
        90.0 + along,
        0.01 * along,
        np.full(count, 4.47),
    )


def test_csv_holds_ten_decimals_of_a_degree(tmp_path: Path, waypoints: Waypoints) -> None:
    path = tmp_path / "w.csv"
    write_waypoints(path, "road", waypoints)
    with path.open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    for name, values in zip(Waypoints._fields, waypoints, strict=True):
        np.testing.assert_allclose([float(row[name]) for row in rows], values, rtol=0.0, atol=6e-5, err_msg=name)
    for name, values in (("latitude_deg", waypoints.latitude_deg), ("longitude_deg", waypoints.longitude_deg)):
        assert all(len(row[name].partition(".")[2]) >= 9 for row in rows)
        np.testing.assert_allclose([float(row[name]) for row in rows], values, rtol=0.0, atol=1e-10)


def test_geojson_has_a_line_a_leg(tmp_path: Path, waypoints: Waypoints) -> None:
    path = tmp_path / "w.geojson"
    write_waypoints(path, "road", waypoints)
    held = json.loads(path.read_text())
    assert held["type"] == "FeatureCollection"
    assert [each["geometry"]["type"] for each in held["features"]] == ["LineString"] * 2
    assert [each["properties"]["gear"] for each in held["features"]] == [1, -1]
    places = np.concatenate([each["geometry"]["coordinates"] for each in held["features"]])
    np.testing.assert_allclose(places[:, 0], waypoints.longitude_deg, rtol=0.0, atol=1e-10)
    np.testing.assert_allclose(places[:, 1], waypoints.latitude_deg, rtol=0.0, atol=1e-10)
    for name in ("heading_deg", "arc_m", "curvature_radpm", "speed_mps"):
        values = np.concatenate([each["properties"][name] for each in held["features"]])
        np.testing.assert_allclose(values, getattr(waypoints, name), atol=1e-5, err_msg=name)


def test_gpx_has_a_segment_a_leg(tmp_path: Path, waypoints: Waypoints) -> None:
    path = tmp_path / "w.gpx"
    write_waypoints(path, "a <road>", waypoints)
    space = {"g": "http://www.topografix.com/GPX/1/1"}
    root = ElementTree.parse(path).getroot()
    name = root.find("g:trk/g:name", space)
    assert name is not None
    assert name.text == "a <road>"
    assert [len(each) for each in root.findall("g:trk/g:trkseg", space)] == [4, 3]
    points = root.findall("g:trk/g:trkseg/g:trkpt", space)
    np.testing.assert_allclose(
        [float(each.attrib["lat"]) for each in points], waypoints.latitude_deg, rtol=0.0, atol=1e-10
    )
    headings = [each.findtext("g:extensions/g:heading_deg", None, space) for each in points]
    np.testing.assert_allclose([float(each or "nan") for each in headings], waypoints.heading_deg, atol=1e-5)


@pytest.mark.parametrize("suffix", ["csv", "geojson", "gpx"])
def test_waypoints_are_read_as_they_were_written(tmp_path: Path, waypoints: Waypoints, suffix: str) -> None:
    path = tmp_path / f"w.{suffix}"
    write_waypoints(path, "road", waypoints)
    (track,) = read_waypoints(path)
    assert track.name == ("w" if suffix == "csv" else "road")
    for name in ("latitude_deg", "longitude_deg"):
        np.testing.assert_allclose(getattr(track, name), getattr(waypoints, name), rtol=0.0, atol=1e-10)
    np.testing.assert_allclose(track.height_m, waypoints.height_m, atol=1e-4)
    np.testing.assert_allclose(track.heading_deg, waypoints.heading_deg, atol=1e-5)
    np.testing.assert_array_equal(track.gear, waypoints.gear)


def test_waypoints_of_other_programs_need_positions_alone(tmp_path: Path) -> None:
    texts = {
        "plain.csv": "longitude_deg, latitude_deg\n-71.0, 42.0\n-71.001, 42.001\n",
        "bare.geojson": '{"type": "LineString", "coordinates": [[-71.0, 42.0], [-71.001, 42.001]]}',
        "route.gpx": '<gpx><rte><rtept lat="42.0" lon="-71.0"/><rtept lat="42.001" lon="-71.001"/></rte></gpx>',
    }
    for name, text in texts.items():
        (tmp_path / name).write_text(text, encoding="utf-8")
        (track,) = read_waypoints(tmp_path / name)
        assert track.name == name.partition(".")[0]
        assert (track.latitude_deg.tolist(), track.longitude_deg.tolist()) == ([42.0, 42.001], [-71.0, -71.001])
        assert np.isnan(track.height_m).all()
        assert np.isnan(track.heading_deg).all()
        assert track.gear.tolist() == [1, 1]


@pytest.mark.parametrize(
    ("name", "text", "place", "values"),
    [
        ("w.csv", "lat,lon\n42,-71\n", "columns", ("latitude_deg and longitude_deg", "lat, lon")),
        ("w.csv", "latitude_deg,longitude_deg\n42,-71\n", "waypoints", ("two", "w: 1")),
        ("w.csv", "latitude_deg,longitude_deg\n42,-71\n91,-71\n", "w, waypoint 2: latitude_deg", (90, "91")),
        ("w.csv", "latitude_deg,longitude_deg\n42,-71\n42,\n", "w, waypoint 2: longitude_deg", (180,)),
        ("w.csv", "latitude_deg,longitude_deg,gear\n42,-71,1\n42,-71,2\n", "w: gear", ("1 or -1", 2)),
        ("w.gpx", "<gpx><trk>", "file", (".gpx",)),
        ("w.gpx", "<gpx/>", "waypoints", ("no track",)),
        ("w.geojson", "[1]", "waypoints", ("no track",)),
        ("w.geojson", '{"type": "LineString", "coordinates": [1, [2]]}', "w, waypoint 1: latitude_deg", (90,)),
        ("w.geojson", '{"features": [{"geometry": [1], "properties": 2}, 3]}', "waypoints", ("no track",)),
        ("w.kml", "", "file name", (".csv", ".geojson", ".gpx")),
    ],
)
def test_wrong_waypoints_are_refused(
    tmp_path: Path, name: str, text: str, place: str, values: tuple[object, ...]
) -> None:
    (tmp_path / name).write_text(text, encoding="utf-8")
    with refused(place, *values, file=tmp_path / name):
        read_waypoints(tmp_path / name)


def test_other_suffixes_and_standing_outputs_are_refused(tmp_path: Path, waypoints: Waypoints) -> None:
    with refused("output", ".csv", ".geojson", ".gpx"):
        write_waypoints(tmp_path / "w.kml", "road", waypoints)
    (tmp_path / "w.csv").write_text("mine")
    with refused("output", "--force"):
        write_waypoints(tmp_path / "w.csv", "road", waypoints)
    assert (tmp_path / "w.csv").read_text() == "mine"
