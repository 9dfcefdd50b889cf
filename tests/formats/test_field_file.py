"""Where a field is: what map programs and people write, and one clear line for each thing that is wrong."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from lgprjax.errors import InputError
from lgprjax.formats import read_field

_RING = [[-100.0, 40.0], [-99.9997, 40.0], [-99.9997, 40.0002], [-100.0, 40.0002], [-100.0, 40.0]]
_POLYGON: dict[str, Any] = {"type": "Polygon", "coordinates": [_RING]}
_LINE = {"type": "LineString", "coordinates": _RING[:2]}


def _feature(geometry: dict[str, Any] | None) -> dict[str, Any]:
    return {"type": "Feature", "properties": {}, "geometry": geometry}


def _write(folder: Path, table: object) -> Path:
    path = folder / "f.geojson"
    path.write_text(json.dumps(table))
    return path


@pytest.mark.parametrize(
    "table",
    [
        _POLYGON,
        _feature(_POLYGON),
        {"type": "FeatureCollection", "features": [_feature(_LINE), _feature(_POLYGON), _feature(None)]},
        {"type": "MultiPolygon", "coordinates": [[_RING]]},
        {**_feature(_POLYGON), "crs": {"type": "name", "properties": {"name": "urn:ogc:def:crs:OGC:1.3:CRS84"}}},
    ],
)
def test_a_polygon_is_found_wherever_it_is(tmp_path: Path, table: dict[str, Any]) -> None:
    places = read_field(_write(tmp_path, table))
    assert not places.driven
    np.testing.assert_array_equal(places.longitude_deg, [each[0] for each in _RING[:-1]])
    np.testing.assert_array_equal(places.latitude_deg, [each[1] for each in _RING[:-1]])
    np.testing.assert_array_equal(places.height_m, 0.0)


@pytest.mark.parametrize(
    ("table", "message"),
    [
        ({"type": "Polygon", "coordinates": []}, "geometry: expected a Polygon with corners, found an empty one"),
        ({"type": "Polygon", "coordinates": [[]]}, "found an empty one"),
        (_LINE, "geometry: expected one Polygon, the border of the field, found none"),
        (
            {"type": "FeatureCollection", "features": [_feature(_POLYGON)] * 2},
            "one Polygon, the border of the field, found 2",
        ),
        ({"type": "MultiPolygon", "coordinates": [[_RING], [_RING]]}, "a MultiPolygon of several"),
        ([1], "file: expected a GeoJSON object, found list"),
        (
            {**_POLYGON, "crs": {"type": "name", "properties": {"name": "urn:ogc:def:crs:EPSG::32614"}}},
            "crs: expected WGS-84 longitude and latitude (save the layer as EPSG:4326)",
        ),
        (
            {"type": "Polygon", "coordinates": [[[512345.6, 4428123.4], [512375.6, 4428123.4], [512375.6, 4428143.4]]]},
            "which look like metres of a projection",
        ),
        ({"type": "Polygon", "coordinates": [[[y, x] for x, y in _RING]]}, "look swapped"),
        ({"type": "Polygon", "coordinates": [[[1.0, "a"], [2.0, 3.0], [4.0, 5.0]]]}, "corner 1: expected a number"),
        ({"type": "Polygon", "coordinates": [[[1.0], [2.0, 3.0], [4.0, 5.0]]]}, "corner 1: expected longitude and"),
    ],
)
def test_what_is_no_field_is_one_line(tmp_path: Path, table: object, message: str) -> None:
    path = _write(tmp_path, table)
    with pytest.raises(InputError) as refused:
        read_field(path)
    line = str(refused.value)
    assert message in line
    assert line.startswith(f"{path}: ")
    assert "\n" not in line


def test_three_corners_are_read_from_a_table_or_a_run(tmp_path: Path) -> None:
    text = "latitude_deg, longitude_deg, sigma_m\n40.0, -100.0, 0.02\n40.0, -99.9997, 0.02\n40.0002, -99.9997, 0.03\n"
    (tmp_path / "c.csv").write_text("\ufeff" + text, encoding="utf-8")
    run = tmp_path / "run"
    run.mkdir()
    (run / "corners.csv").write_text(text)
    for path in (tmp_path / "c.csv", run):
        places = read_field(path)
        assert places.driven
        np.testing.assert_array_equal(places.latitude_deg, [40.0, 40.0, 40.0002])
        np.testing.assert_array_equal(places.longitude_deg, [-100.0, -99.9997, -99.9997])


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            "latitude_deg,longitude_deg\n40,-100\n40,-99\n",
            "corners: expected three rows or more, one a corner, found 2",
        ),
        ("lat,lon\n1,2\n", "latitude_deg: expected a column latitude_deg, found lat, lon"),
        ("", "found an empty file"),
        ("latitude_deg,longitude_deg\n40,-100\n40,x\n40,-99\n", "row 2, longitude_deg: expected a number, found 'x'"),
        ("latitude_deg,longitude_deg\n40,-100\n40,nan\n40,-99\n", "row 2, longitude_deg: expected a number"),
        ("latitude_deg,longitude_deg\n40,-100\n40\n40,-99\n", "row 2, longitude_deg: expected a number, found None"),
        ("latitude_deg,longitude_deg\n-100,40\n-99.9997,40\n-99.9997,40.0002\n", "which look swapped"),
    ],
)
def test_a_wrong_table_is_one_line(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "c.csv"
    path.write_text(text)
    with pytest.raises(InputError) as refused:
        read_field(path)
    assert message in str(refused.value)


def test_other_files_are_refused(tmp_path: Path) -> None:
    (tmp_path / "empty").mkdir()
    (tmp_path / "f.geojson").write_text("{")
    (tmp_path / "g.geojson").write_bytes(b"\xff\xfe")
    for name, message in (
        ("f.gpx", "a .geojson, .kml, .shp or .csv of corners"),
        ("none.csv", "a readable file"),
        ("empty", "three corners marked while driving"),
        ("f.geojson", "expected GeoJSON, found no JSON"),
        ("g.geojson", "text in UTF-8"),
    ):
        with pytest.raises(InputError, match=message):
            read_field(tmp_path / name)


def test_holes_and_polygons_of_their_kind_are_kept_out_of(tmp_path: Path) -> None:
    inner = [[-99.99995, 40.00005], [-99.9999, 40.00005], [-99.9999, 40.0001], [-99.99995, 40.00005]]
    pond = {
        "type": "Feature",
        "properties": {"kind": "keep_out", "buffer_m": 1.5},
        "geometry": {"type": "Polygon", "coordinates": [inner]},
    }
    field = {"type": "Feature", "properties": {}, "geometry": {"type": "Polygon", "coordinates": [_RING, inner]}}
    path = tmp_path / "f.geojson"
    path.write_text(json.dumps({"type": "FeatureCollection", "features": [pond, field]}))
    places = read_field(path)
    assert len(places.latitude_deg) == len(_RING) - 1
    assert [each.buffer_m for each in places.keep_outs] == [None, 1.5]
    assert places.keep_outs[0].longitude_deg.tolist() == [each[0] for each in inner[:-1]]
    assert places.notes == ("2 keep-outs",)


def test_a_kml_and_a_table_of_all_corners_are_the_same_field(tmp_path: Path) -> None:
    text = " ".join(f"{longitude},{latitude},310" for longitude, latitude in _RING)
    (tmp_path / "f.kml").write_text(
        '<?xml version="1.0"?><kml xmlns="http://www.opengis.net/kml/2.2"><Placemark><Polygon><outerBoundaryIs>'
        f"<LinearRing><coordinates>{text}</coordinates></LinearRing></outerBoundaryIs></Polygon></Placemark></kml>"
    )
    rows = [f"{latitude},{longitude}" for longitude, latitude in _RING[:-1]]
    (tmp_path / "f.csv").write_text("\n".join(["latitude_deg,longitude_deg", *rows]) + "\n")
    one, other = read_field(tmp_path / "f.kml"), read_field(tmp_path / "f.csv")
    for each in ("latitude_deg", "longitude_deg", "height_m"):
        assert getattr(one, each).tolist() == getattr(other, each).tolist()
    assert not one.driven
    assert one.notes == ("heights of the KML left out: they do not count from the ellipsoid",)
    (tmp_path / "g.kml").write_text("<kml>")
    with pytest.raises(InputError, match="expected KML, found no XML"):
        read_field(tmp_path / "g.kml")


def test_a_shapefile_is_read(tmp_path: Path) -> None:
    pyogrio, shapely = pytest.importorskip("pyogrio"), pytest.importorskip("shapely")
    shapes = shapely.to_wkb(np.array([shapely.Polygon(_RING)], object))
    pyogrio.raw.write(tmp_path / "f.shp", shapes, [], [], crs="EPSG:4326", geometry_type="Polygon")
    places = read_field(tmp_path / "f.shp")
    assert sorted(places.latitude_deg.tolist()) == sorted(each[1] for each in _RING[:-1])
