"""Where a field is: what map programs and people write, and one clear line for each thing that is wrong."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from lgprjax.formats import read_field
from refusals import refused

_RING = [[-100.0, 40.0], [-99.9997, 40.0], [-99.9997, 40.0002], [-100.0, 40.0002], [-100.0, 40.0]]
_POLYGON: dict[str, Any] = {"type": "Polygon", "coordinates": [_RING]}
_LINE = {"type": "LineString", "coordinates": _RING[:2]}


def _feature(geometry: dict[str, Any] | None) -> dict[str, Any]:
    return {"type": "Feature", "properties": {}, "geometry": geometry}


def _write(folder: Path, table: object) -> Path:
    path = folder / "f.geojson"
    path.write_text(json.dumps(table))
    return path


def test_a_polygon_is_found_wherever_it_is(tmp_path: Path) -> None:
    crs = {"type": "name", "properties": {"name": "urn:ogc:def:crs:OGC:1.3:CRS84"}}
    for table in (
        _POLYGON,
        {"type": "FeatureCollection", "features": [_feature(_LINE), _feature(_POLYGON), _feature(None)]},
        {"type": "MultiPolygon", "coordinates": [[_RING]]},
        {**_feature(_POLYGON), "crs": crs},
    ):
        places = read_field(_write(tmp_path, table))
        assert not places.driven
        np.testing.assert_array_equal(places.longitude_deg, [each[0] for each in _RING[:-1]])
        np.testing.assert_array_equal(places.latitude_deg, [each[1] for each in _RING[:-1]])
        np.testing.assert_array_equal(places.height_m, 0.0)


def _polygon(*corners: object) -> dict[str, Any]:
    return {"type": "Polygon", "coordinates": [list(corners)]}


_UTM = {"type": "name", "properties": {"name": "urn:ogc:def:crs:EPSG::32614"}}


_NO_FIELDS: list[tuple[object, str, tuple[object, ...]]] = [
    ({"type": "Polygon", "coordinates": []}, "geometry", ()),
    (_polygon(), "geometry", ()),
    (_LINE, "geometry", ("none",)),
    ({"type": "FeatureCollection", "features": [_feature(_POLYGON)] * 2}, "geometry", (2,)),
    ({"type": "MultiPolygon", "coordinates": [[_RING], [_RING]]}, "geometry", ("MultiPolygon",)),
    ([1], "file", ("list",)),
    ({**_POLYGON, "crs": _UTM}, "crs", ("EPSG:4326", "32614")),
    (_polygon([512345.6, 4428123.4], [512375.6, 4428123.4], [512375.6, 4428143.4]), "corner 1", (512345.6,)),
    (_polygon(*([y, x] for x, y in _RING)), "corner 1", (-100,)),
    (_polygon([1.0, "a"], [2.0, 3.0], [4.0, 5.0]), "corner 1", ("'a'",)),
    (_polygon([1.0], [2.0, 3.0], [4.0, 5.0]), "corner 1", ()),
]


def test_what_is_no_field_is_refused(tmp_path: Path) -> None:
    for table, place, values in _NO_FIELDS:
        path = _write(tmp_path, table)
        with refused(place, *values, file=path):
            read_field(path)


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


_HEAD = "latitude_deg,longitude_deg\n"


_WRONG_TABLES: list[tuple[str, str, tuple[object, ...]]] = [
    (_HEAD + "40,-100\n40,-99\n", "corners", ("2",)),
    ("lat,lon\n1,2\n", "latitude_deg", ("lat, lon",)),
    ("", "latitude_deg", ()),
    (_HEAD + "40,-100\n40,x\n40,-99\n", "row 2, longitude_deg", ("'x'",)),
    (_HEAD + "40,-100\n40,nan\n40,-99\n", "row 2, longitude_deg", ("nan",)),
    (_HEAD + "40,-100\n40\n40,-99\n", "row 2, longitude_deg", ("None",)),
    (_HEAD + "-100,40\n-99.9997,40\n-99.9997,40.0002\n", "corner 1", (-100,)),
]


def test_a_wrong_table_is_refused(tmp_path: Path) -> None:
    for text, place, values in _WRONG_TABLES:
        path = tmp_path / "c.csv"
        path.write_text(text)
        with refused(place, *values, file=path):
            read_field(path)


def test_other_files_are_refused(tmp_path: Path) -> None:
    (tmp_path / "empty").mkdir()
    (tmp_path / "f.geojson").write_text("{")
    (tmp_path / "g.geojson").write_bytes(b"\xff\xfe")
    (tmp_path / "g.kml").write_text("<kml>")
    for name, place, value in (
        ("f.gpx", "file name", ".geojson"),
        ("none.csv", "file", ""),
        ("empty", "corners", "corners.csv"),
        ("f.geojson", "file", "JSON"),
        ("g.geojson", "file", "UTF-8"),
        ("g.kml", "file", "KML"),
    ):
        with refused(place, value):
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
    (note,) = places.notes
    assert "2" in note


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
    assert len(one.notes) == 1  # its heights do not count from the ellipsoid


def test_a_shapefile_is_read(tmp_path: Path) -> None:
    pyogrio, shapely = pytest.importorskip("pyogrio"), pytest.importorskip("shapely")
    shapes = shapely.to_wkb(np.array([shapely.Polygon(_RING)], object))
    pyogrio.raw.write(tmp_path / "f.shp", shapes, [], [], crs="EPSG:4326", geometry_type="Polygon")
    places = read_field(tmp_path / "f.shp")
    assert sorted(places.latitude_deg.tolist()) == sorted(each[1] for each in _RING[:-1])
