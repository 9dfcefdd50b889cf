"""Layers of a worked field: they hold no more ground than its cells, and map programs open what is written."""

import json
import math
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest

from drawn_record import CELL_M, LEVELS, made_record
from lgprjax.formats import GeoLayer, WorkedRecord, write_geojson, write_geopackage, write_kml, write_turning_points
from lgprjax.worked.layers import at_levels, cells_union, checked_levels, cover_figures, cover_layers, layer_name
from refusals import refused

shapely = pytest.importorskip("shapely")
pyogrio = pytest.importorskip("pyogrio")
raw = pytest.importorskip("pyogrio.raw")

_NAMES = ["perimeter", "swaths", "processed_p95", "processed_p996", "gaps", "stops", "events", "finds"]


def local(record: WorkedRecord, layer: GeoLayer) -> list[Any]:
    """Shapes of a layer back in metres."""

    def to_metres(places: np.ndarray) -> np.ndarray:
        east, north, _ = record.frame.to_local(places[:, 1], places[:, 0], np.full(len(places), 900.0))
        return np.stack([east, north], axis=1)

    return [shapely.transform(shape, to_metres) for shape in layer.shapes]


def by_name(record: WorkedRecord) -> dict[str, GeoLayer]:
    return {layer.name: layer for layer in cover_layers(record, "us")}


def test_the_union_of_cells_is_the_cells() -> None:
    record = made_record()
    assert cells_union(record, np.zeros(record.cells.state.shape[1:], bool)).is_empty
    rows, columns = np.indices(record.cells.state.shape[1:])
    east = record.cells.east_m + CELL_M * (columns + 0.5)
    north = record.cells.north_m + CELL_M * (rows + 0.5)
    for share in (0.1, 0.5, 0.97):
        chosen = np.random.default_rng(0).random(rows.shape) < share
        union = cells_union(record, chosen)
        assert union.is_valid
        assert union.area == pytest.approx(np.count_nonzero(chosen) * CELL_M**2, rel=1e-12)
        np.testing.assert_array_equal(shapely.contains_xy(union, east, north), chosen)


@pytest.mark.parametrize("yaw_rad", [0.0, 0.4])
def test_processed_ground_is_within_the_perimeter_and_within_its_cells(yaw_rad: float) -> None:
    record = made_record(yaw_rad=yaw_rad)
    layers = by_name(record)
    assert list(layers) == _NAMES
    field = shapely.Polygon(record.perimeter_m)
    for number, level in enumerate(LEVELS):
        layer = layers[layer_name(level)]
        ground = shapely.union_all(local(record, layer))
        state = record.cells.state[number]
        assert shapely.difference(ground, field).area < 1e-6
        # Each piece lies on cells of its own level: none of them claims another cell's ground.
        rows, columns = np.nonzero(state != 2)
        east, north = (
            origin + CELL_M * axis for origin, axis in ((record.cells.east_m, columns), (record.cells.north_m, rows))
        )
        other = shapely.union_all(shapely.box(east, north, east + CELL_M, north + CELL_M))
        assert shapely.intersection(ground, other).area < 1e-6
        assert sum(row["area_m2"] for row in layer.properties) == pytest.approx(ground.area, abs=1e-3)
        if yaw_rad == 0.0:
            inside = state[4:20, 4:28]
            assert ground.area == pytest.approx(np.count_nonzero(inside == 2) * CELL_M**2, abs=1e-6)
    # What is not processed is a gap: nothing of the field is in neither or in both.
    gaps = shapely.union_all(local(record, layers["gaps"]))
    lowest = shapely.union_all(local(record, layers["processed_p95"]))
    assert gaps.area + lowest.area == pytest.approx(field.area, abs=1e-5)
    assert shapely.intersection(gaps, lowest).area < 1e-6
    assert len({row["state"] for row in layers["gaps"].properties}) == 2
    # Shapes are valid and wind as they must.
    for layer in layers.values():
        assert all(shape.is_valid for shape in layer.shapes), layer.name
        assert {shape.geom_type for shape in layer.shapes} <= {layer.kind}
        for shape in layer.shapes:
            if layer.kind == "Polygon":
                assert shape.exterior.is_ccw
                assert not any(ring.is_ccw for ring in shape.interiors)


def test_every_shape_says_whose_it_is_and_claims_nothing() -> None:
    for layer in cover_layers(made_record(), "Made-up Mine Action"):
        for row in layer.properties:
            assert row["organisation"] == "Made-up Mine Action"
            assert row["date_start"] == "2026-03-01T10:00:00.000+00:00"
            assert row["date_end"] == "2026-03-01T10:00:03.900+00:00"
            assert "cleared" not in str(row)
    layers = by_name(made_record())
    assert layers["events"].properties[1]["text"] == "event ruhe, Ä <b>"


@pytest.mark.parametrize("empty", [False, True])
def test_the_geopackage_opens_with_all_layers(tmp_path: Path, empty: bool) -> None:
    record, path = made_record(yaw_rad=0.4, empty=empty), tmp_path / "r.gpkg"
    layers = cover_layers(record, "us")
    write_geopackage(path, layers, {"record_sha256": "ab"})
    assert [each.name for each in tmp_path.iterdir()] == ["r.gpkg"]
    assert [str(name) for name, _ in pyogrio.list_layers(path)] == _NAMES
    for layer in layers:
        told, _, shapes, fields = raw.read(path, layer=layer.name)
        assert told["crs"] == "EPSG:4326"
        read = shapely.from_wkb(shapes)
        assert shapely.is_valid(read).all()
        assert len(read) == len(layer.shapes)
        assert all(one.equals(other) for one, other in zip(read, layer.shapes, strict=True))
        for name, values in zip(told["fields"], fields, strict=True):
            assert [str(each) for each in values] == [str(row[name]) for row in layer.properties]
    with refused("output", "--force", file="r.gpkg"):
        write_geopackage(path, layers, {})


def test_geojson_and_kml_hold_the_same_shapes(tmp_path: Path) -> None:
    record = made_record(yaw_rad=0.4)
    layers = cover_layers(record, "us")
    write_geojson(tmp_path / "r.geojson", layers, {"note": "n"})
    write_kml(tmp_path / "r.kml", layers, {"note": "n"}, colours={"gaps": "#D55E00"})
    collection = json.loads((tmp_path / "r.geojson").read_text(encoding="utf-8"))
    assert collection["lgprjax"] == {"note": "n"}
    _, _, shapes, _ = raw.read(tmp_path / "r.geojson")
    expected = [shape for layer in layers for shape in layer.shapes]
    assert all(one.equals_exact(other, 1e-9) for one, other in zip(shapely.from_wkb(shapes), expected, strict=True))
    assert shapely.is_valid(shapely.from_wkb(shapes)).all()
    space = {"k": "http://www.opengis.net/kml/2.2"}
    root = ElementTree.parse(tmp_path / "r.kml").getroot()
    folders = root.findall("k:Document/k:Folder", space)
    assert [each.findtext("k:name", None, space) for each in folders] == _NAMES
    assert [len(each.findall("k:Placemark", space)) for each in folders] == [len(layer.shapes) for layer in layers]
    # D55E00 with half its opacity, as KML turns colours round.
    assert root.findtext("k:Document/k:Style[@id='gaps']/k:PolyStyle/k:color", None, space) == "80005ED5"
    ring = folders[0].findtext("k:Placemark/k:Polygon/k:outerBoundaryIs/k:LinearRing/k:coordinates", None, space)
    places = np.array([[float(each) for each in pair.split(",")] for pair in (ring or "").split()])
    np.testing.assert_allclose(places, np.array(layers[0].shapes[0].exterior.coords), rtol=0.0, atol=1e-10)


def test_depths_that_a_cart_does_not_measure_are_no_numbers(tmp_path: Path) -> None:
    """A cart's passes have no depth: JSON knows no NaN, and programs for maps refuse a file with one."""
    record = made_record()
    unknown = np.full(len(record.passes.run), np.nan)
    record = record._replace(passes=record.passes._replace(depth_mean_m=unknown, depth_least_m=unknown))
    layers = cover_layers(record, "us")
    write_geojson(tmp_path / "r.geojson", layers, {})

    def refuse(name: str) -> None:
        raise AssertionError(name)

    collection = json.loads((tmp_path / "r.geojson").read_text(encoding="utf-8"), parse_constant=refuse)
    swaths = [each["properties"] for each in collection["features"] if each["properties"]["layer"] == "swaths"]
    assert swaths
    assert all(each["depth_mean_m"] is each["depth_least_m"] is None for each in swaths)
    assert all(each["length_m"] == 5.0 for each in swaths)
    write_kml(tmp_path / "r.kml", layers, {}, colours={})
    text = (tmp_path / "r.kml").read_text(encoding="utf-8")
    assert "length_m" in text
    assert "depth_mean_m" not in text
    # A column of numbers it stays, also where a later run measured them.
    of_swaths = next(layer for layer in layers if layer.name == "swaths")
    mixed = of_swaths._replace(
        properties=({**of_swaths.properties[0], "depth_mean_m": 0.15}, *of_swaths.properties[1:])
    )
    for number, layer in enumerate((of_swaths, mixed)):
        write_geopackage(tmp_path / f"{number}.gpkg", [layer], {})
        told, _, _, fields = raw.read(tmp_path / f"{number}.gpkg", layer="swaths")
        depths = fields[list(told["fields"]).index("depth_mean_m")]
        assert depths.dtype == np.float64
        np.testing.assert_array_equal(depths[1:], np.full(len(depths) - 1, np.nan))
        assert np.isnan(depths[0]) == (number == 0)


@pytest.mark.parametrize("mark", [None, (-20.501, 30.249)])
def test_turning_points_lead_from_the_benchmark(tmp_path: Path, mark: tuple[float, float] | None) -> None:
    record = made_record(yaw_rad=0.4)
    latitude, longitude, _ = record.frame.to_geodetic(record.perimeter_m[:, 0], record.perimeter_m[:, 1], np.zeros(4))
    write_turning_points(tmp_path / "t.csv", latitude, longitude, mark)
    head, first, *rows = (line.split(",") for line in (tmp_path / "t.csv").read_text().splitlines())
    assert head[:4] == ["point", "latitude_deg", "longitude_deg", "datum"]
    assert first[0] == ("BM" if mark else "BM (first turning point)")
    assert [row[0] for row in rows] == ["TP1", "TP2", "TP3", "TP4"]
    start = (float(first[1]), float(first[2]))
    assert start == pytest.approx(mark or (latitude[0], longitude[0]), abs=1e-9)
    # On a sphere with the ellipsoid's own radii the same ways come out, to a millimetre at such distances.
    sin = math.sin(math.radians(-20.5))
    share = 1.0 - 6.69437999014e-3 * sin**2
    north_m = math.radians(1.0) * 6378137.0 * (1.0 - 6.69437999014e-3) / share**1.5
    east_m = math.radians(1.0) * 6378137.0 / math.sqrt(share) * math.cos(math.radians(-20.5))
    for row, lat, lon in zip(rows, latitude, longitude, strict=True):
        assert (float(row[1]), float(row[2])) == pytest.approx((lat, lon), abs=1e-9)
        assert row[3] == "WGS 84"
        way = (lon - start[1]) * east_m, (lat - start[0]) * north_m
        assert float(row[5]) == pytest.approx(math.hypot(*way), abs=5e-3)
        if math.hypot(*way) > 1.0:
            assert float(row[4]) == pytest.approx(math.degrees(math.atan2(*way)) % 360.0, abs=0.05)
    for row, length_m in zip(rows, (6.0, 4.0, 6.0, 4.0), strict=True):
        assert float(row[7]) == pytest.approx(length_m * (1.0 - 900.0 / 6.37e6), abs=2e-3)


def test_a_record_is_judged_at_any_level() -> None:
    record = made_record()
    same = at_levels(record, LEVELS)
    np.testing.assert_array_equal(same.cells.state, record.cells.state)
    np.testing.assert_array_equal(same.cells.level, record.cells.level)
    other = at_levels(record, checked_levels((0.999, 0.99)))
    assert other.cells.level.tolist() == [0.99, 0.999]
    value = record.cells.probability / 65535
    for level, state in zip((0.99, 0.999), other.cells.state, strict=True):
        np.testing.assert_array_equal(state, np.where(value >= level, 2, np.where(value < 1.0 - level, 0, 1)))
    assert [layer.name for layer in cover_layers(other, "us")][2:5] == ["processed_p99", "processed_p999", "gaps"]
    # The same cells, asked for more: less is processed, and more is uncertain.
    asked, usual = cover_figures(other).layers, cover_figures(record).layers
    assert usual[0].processed_m2 > asked[0].processed_m2 > usual[1].processed_m2 >= asked[1].processed_m2
    assert "99.9 %" in asked[1].sentence


def test_levels_that_nothing_can_be_said_at_are_refused() -> None:
    nan = float("nan")
    for levels in ((), (0.5,), (1.0,), (0.99995,), (95.0,), (0.9, 0.9), (0.95, 0.9500001), (0.9, nan, 0.95)):
        with refused("confidence", "0.5", "0.9999", file="call"):
            checked_levels(levels)
