"""Field files of offices and map programs: encodings, commas, empty and several polygons, the antimeridian."""

import json
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely

from canon.commands import run, succeed
from lgprjax.coverage import Field, PatternSettings, SafeGround, Tool, plan_pattern
from lgprjax.formats import CoverPlan, read_cover_plan, read_field, write_geojson, write_kml
from lgprjax.formats.geometries import continuous, cut
from lgprjax.formats.worked import GeoLayer
from lgprjax.frames import LocalFrame
from lgprjax.worked.plans import save_cover_plan
from refusals import refused

_RING = [(19.0, 47.5), (19.00015927, 47.5), (19.00015927, 47.50008095), (19.0, 47.50008095)]
_VEHICLE = Path(__file__).parents[2] / "onboard" / "made_up_flail.vehicle.toml"


def _kml(*rings: str, names: tuple[str, ...] = (), head: str = '<?xml version="1.0" encoding="UTF-8"?>') -> str:
    marks = "".join(
        f"<Placemark><name>{name}</name><Polygon><outerBoundaryIs><LinearRing><coordinates>{ring}</coordinates>"
        "</LinearRing></outerBoundaryIs></Polygon></Placemark>"
        for name, ring in zip(names or ("border",) * len(rings), rings, strict=True)
    )
    return f'{head}<kml xmlns="http://www.opengis.net/kml/2.2"><Document><name>Feld</name>{marks}</Document></kml>'


def _tuples(ring: list[tuple[float, float]] = _RING, more: str = "", comma: str = ",") -> str:
    return " ".join(f"{x:.8f}{comma}{y:.8f}{more}" for x, y in [*ring, ring[0]])


def _check(path: Path, ring: list[tuple[float, float]] = _RING, polygon: str | None = None) -> tuple[str, ...]:
    places = read_field(path, polygon=polygon)
    np.testing.assert_allclose(places.longitude_deg, [x for x, _ in ring], atol=1e-11)
    np.testing.assert_allclose(places.latitude_deg, [y for _, y in ring], atol=1e-11)
    assert np.all(places.height_m == 0.0)
    return places.notes


_HEAD = '<?xml version="1.0" encoding="{}"?>'


@pytest.mark.parametrize(
    ("declared", "written"),
    [
        *((each, each) for each in ("ISO-8859-1", "windows-1252", "iso-8859-2", "UTF-8", "utf-16", "shift_jis")),
        ("UTF-8", "utf-8-sig"),
        ("utf-16", "utf-8"),  # as some libraries declare whatever they write
    ],
)
def test_a_kml_is_in_the_encoding_that_it_declares(declared: str, written: str, tmp_path: Path) -> None:
    name = "\u7551" if declared == "shift_jis" else "K\u00f6z\u00e9p"
    text = _kml(_tuples(), names=(name,), head=_HEAD.format(declared))
    (tmp_path / "f.kml").write_bytes(text.encode(written))
    assert _check(tmp_path / "f.kml", polygon=name) == ()
    for wrong in ("UTF-8", "no-such-code"):
        (tmp_path / "f.kml").write_bytes(_kml(_tuples(), names=("\u00f6",), head=_HEAD.format(wrong)).encode("latin-1"))
        with refused("file", wrong.upper()):
            read_field(tmp_path / "f.kml")


def test_heights_that_are_not_used_are_not_judged(tmp_path: Path) -> None:
    path = tmp_path / "f.kml"
    for height, notes in ((",nan", 1), (",", 0), (",-9999", 1), (",0", 0), (",0.000", 0), (",x", 1)):
        path.write_text(_kml(_tuples(more=height)))
        assert len(_check(path)) == notes
    path.write_text(_kml(_tuples().replace(",", ", ")))  # blanks that KML forbids
    assert _check(path) == ()
    path = tmp_path / "f.geojson"
    for heights, notes in (([1.5, None, 2.0, 3.0], 1), ([None] * 4, 0), ([float("nan"), 1.0, 1.0, 1.0], 1)):
        ring = [[x, y, z] for (x, y), z in zip([*_RING, _RING[0]], [*heights, heights[0]], strict=True)]
        path.write_text(json.dumps({"type": "Polygon", "coordinates": [ring]}))
        assert len(_check(path)) == notes


def test_decimal_commas_of_a_kml_are_told(tmp_path: Path) -> None:
    path = tmp_path / "f.kml"
    for more, places in (("", 8), (",0", 8), (",0,5", 3), (",312", 1)):
        cells = (f"{x:.{places}f},{y:.{places}f}".replace(".", ",") + more for x, y in [*_RING, _RING[0]])
        path.write_text(_kml(" ".join(cells)))
        with refused("corner 1", found="comma"):
            read_field(path)


def _geojson(path: Path, *geometries: dict[str, Any] | None, names: tuple[str, ...] = ()) -> Path:
    features = [
        {"type": "Feature", "properties": {"NAME": name} if names else {}, "geometry": geometry}
        for name, geometry in zip(names or ("",) * len(geometries), geometries, strict=True)
    ]
    path.write_text(json.dumps({"type": "FeatureCollection", "features": features}), encoding="utf-8")
    return path


def _polygon(ring: list[tuple[float, float]] = _RING) -> dict[str, Any]:
    return {"type": "Polygon", "coordinates": [[list(each) for each in (*ring, ring[0])]]}


_EMPTY: list[dict[str, Any]] = [
    {"type": "Polygon", "coordinates": []},
    {"type": "Polygon", "coordinates": [[]]},
    {"type": "MultiPolygon", "coordinates": []},
    {"type": "MultiPolygon", "coordinates": [[]]},
]


def test_polygons_without_corners_are_told_or_left_out(tmp_path: Path) -> None:
    for text in ("", "\n\t", "   "):
        (tmp_path / "f.kml").write_text(_kml(text))
        with refused("geometry", file="f.kml"):
            read_field(tmp_path / "f.kml")
        (tmp_path / "f.kml").write_text(_kml(text, _tuples()))
        assert len(_check(tmp_path / "f.kml")) == 1
    for empty in _EMPTY:
        with refused("geometry"):
            read_field(_geojson(tmp_path / "f.geojson", empty))
        assert len(_check(_geojson(tmp_path / "f.geojson", empty, None, _polygon()))) == 1
    pyogrio = pytest.importorskip("pyogrio")
    for shapes, notes in (([None, shapely.Polygon(_RING)], 0), ([shapely.Polygon(), shapely.Polygon(_RING)], None)):
        names = np.array(["a", "b"], object)
        wkb = np.array([None if each is None else shapely.to_wkb(each) for each in shapes], object)
        pyogrio.raw.write(tmp_path / "f.shp", wkb, [names], ["name"], crs="EPSG:4326", geometry_type="Polygon")
        places = read_field(tmp_path / "f.shp")
        assert sorted(places.latitude_deg.tolist()) == sorted(y for _, y in _RING)
        assert notes is None or len(places.notes) == notes


_OTHER = [(x + 0.001, y) for x, y in _RING]


def test_one_of_several_polygons_is_chosen_by_its_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    _geojson(Path("f.geojson"), _polygon(), _polygon(_OTHER), names=("north", "2 s\u00fcd"))
    Path("f.kml").write_text(_kml(_tuples(), _tuples(_OTHER), names=("north", "2 s\u00fcd")), encoding="utf-8")
    with zipfile.ZipFile("f.kmz", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("files/icon.png", b"\x89PNG")
        archive.write("f.kml", "doc.kml")
    for path in (Path("f.geojson"), Path("f.kml"), Path("f.kmz")):
        with refused("geometry", "--polygon", "north", "s\u00fcd", file=path, found=2):
            read_field(path)
        _check(path, polygon="north")
        _check(path, _OTHER, polygon="2 s\u00fcd")
        _check(path, _OTHER, polygon="2")
        for none in ("south", "3", "0", ""):
            with refused("geometry", "north"):
                read_field(path, polygon=none)
    words = ("cover", "plan", "f.kmz", "-o", "x.cover.geojson", "--vehicle", _VEHICLE, "--order", "zamboni")
    run(*words).refusal.check("geometry", "--polygon")
    succeed(*words, "--polygon", "2 s\u00fcd")
    assert read_cover_plan("x.cover.geojson").frame.longitude_deg == pytest.approx(_OTHER[0][0])
    # Two of one name, or parts of one feature: by their number.
    both = {"type": "MultiPolygon", "coordinates": [_polygon()["coordinates"], _polygon(_OTHER)["coordinates"]]}
    with refused("geometry", found=2):
        read_field(_geojson(Path("m.geojson"), both, names=("north",)), polygon="north")
    _check(Path("m.geojson"), _OTHER, polygon="2")


def test_an_archive_that_is_no_kmz_is_told(tmp_path: Path) -> None:
    path = tmp_path / "f.kmz"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("doc.txt", "no map")
    whole = path.read_bytes()
    for data in (whole, whole[:20], b"PK\x03\x04", b"", b"<kml"):
        path.write_bytes(data)
        with refused("file", file=path):
            read_field(path)


_ROWS = [(y, x) for x, y in _RING]


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "cp1252"])
@pytest.mark.parametrize(("separator", "decimal"), [(";", ","), (";", "."), ("\t", ","), (",", ".")])
def test_tables_of_any_office_program(separator: str, decimal: str, encoding: str, tmp_path: Path) -> None:
    rows = [("Gr\u00f6\u00dfe", *(f"{each:.8f}".replace(".", decimal) for each in row), "") for row in _ROWS]
    head = ("note", " latitude_deg", "longitude_deg ", "height_m")
    blank = ("", "", "", "")
    text = "\r\n".join(separator.join(row) for row in (head, *rows, blank, blank)) + "\r\n\r\n"
    (tmp_path / "f.csv").write_bytes(text.encode(encoding))
    assert _check(tmp_path / "f.csv") == ()


def test_decimal_commas_between_commas_are_told(tmp_path: Path) -> None:
    """Read as they stand they were places of whole degrees."""
    head, path = "latitude_deg,longitude_deg", tmp_path / "f.csv"
    for cells in ("47,5,19,0", "47,5,19", "47,50008,19,00015,312"):
        path.write_text("\n".join([head, *[cells] * 4]))
        with refused("row 1", found="comma"):
            read_field(path)
    for cells in ('"47,5","19,0"', "47.5;19.0", "47.5"):
        path.write_text("\n".join([head, *[cells] * 4]))
        with refused(None, file=path):
            read_field(path)


# A field on both sides of the antimeridian.
_FAR = [(179.9998, -16.5), (-179.9998, -16.5), (-179.9998, -16.4998), (179.9998, -16.4998)]


def _local(places: Any) -> np.ndarray:
    frame = LocalFrame(-16.5, 179.9998, 0.0)
    return np.stack(frame.to_local(places.latitude_deg, places.longitude_deg, places.height_m)[:2], axis=1)


def test_a_field_across_the_antimeridian_is_one(tmp_path: Path) -> None:
    reach = [(x % 360.0, y) for x, y in _FAR]
    west = [(x - 360.0 if x > 0.0 else x, y) for x, y in _FAR]
    shape = cut(shapely.Polygon(reach))
    assert shape.geom_type == "MultiPolygon"
    assert all(abs(part.bounds[0]) <= 180.0 and abs(part.bounds[2]) <= 180.0 for part in shape.geoms)
    assert sum(part.area for part in shape.geoms) == pytest.approx(shapely.Polygon(reach).area)
    halves = {"type": "MultiPolygon", "coordinates": shapely.geometry.mapping(shape)["coordinates"]}
    kml = _kml(*(_tuples(list(part.exterior.coords)[:-1]) for part in shape.geoms))
    kml = kml.replace("</Placemark><Placemark><name>border</name>", "")
    (tmp_path / "h.kml").write_text(kml)
    expected = None
    for path in (
        _geojson(tmp_path / "a.geojson", _polygon(_FAR)),
        _geojson(tmp_path / "b.geojson", _polygon(reach)),
        _geojson(tmp_path / "c.geojson", _polygon(west)),
        _geojson(tmp_path / "d.geojson", json.loads(json.dumps(halves))),
        tmp_path / "h.kml",
    ):
        places = read_field(path)
        assert np.ptp(places.longitude_deg) == pytest.approx(0.0004)
        corners = _local(places)
        assert len(corners) == 4
        if expected is None:
            expected = corners
        # The same corners in the same sense; a cut ring may begin at another.
        begin = int(np.hypot(*(corners - expected[0]).T).argmin())
        np.testing.assert_allclose(np.roll(corners, -begin, axis=0), expected, atol=1e-5)
    # Parts that do not meet there are several.
    apart = {"type": "MultiPolygon", "coordinates": [_polygon()["coordinates"], _polygon(_FAR)["coordinates"]]}
    with refused("geometry", found=2):
        read_field(_geojson(tmp_path / "e.geojson", apart))


def test_a_plan_across_the_antimeridian_is_cut_for_map_programs(tmp_path: Path) -> None:
    """RFC 7946, section 3.1.9: no part of a geometry crosses; the plan itself is read exactly, and is a field again."""
    corners = np.array([[-20.0, 0.0], [30.0, 0.0], [30.0, 14.0], [-20.0, 14.0]])
    settings = PatternSettings(1.0, 0.1, "boustrophedon", 1.2, 12.0, 0.9, heading_rad=None)
    for longitude in (179.99999, -179.99999, 180.0, -180.0):
        frame = LocalFrame(-16.5, longitude, 0.0)
        pattern = plan_pattern(Field(corners), settings, name="f")
        keep_out = np.array([[-5.0, 4.0], [6.0, 4.0], [6.0, 9.0], [-5.0, 9.0]])
        around = np.array([[-40.0, -20.0], [50.0, -20.0], [50.0, 30.0], [-40.0, 30.0]])
        ground = SafeGround(((around, keep_out),), 0.25)
        plan = CoverPlan("f", frame, pattern, Tool(1.0, 0.4, 0.9, 0.0), "flail", "ab" * 32, ground=ground)
        plan = plan._replace(keep_outs_m=(keep_out,))
        path = tmp_path / "x.cover.geojson"
        save_cover_plan(path, plan, force=True)
        crossing = 0
        for feature in json.loads(path.read_text())["features"]:
            shape = shapely.geometry.shape(feature["geometry"])
            for part in shapely.get_parts(shape):
                assert part.is_valid
                west, _, east, _ = part.bounds
                assert -180.0 <= west <= east <= 180.0
                assert east - west < 0.01
            crossing += shape.geom_type.startswith("Multi")
        assert crossing > 8
        np.testing.assert_array_equal(read_cover_plan(path).pattern.field.perimeter_m, corners)
        places = read_field(path)
        east, north, _ = frame.to_local(places.latitude_deg, places.longitude_deg, places.height_m)
        begin = int(np.hypot(east - corners[0, 0], north - corners[0, 1]).argmin())
        np.testing.assert_allclose(np.roll(np.stack([east, north], axis=1), -begin, axis=0), corners, atol=1e-4)
        assert places.ground is not None
        assert [len(ring) for ring in places.ground.parts[0]] == [4, 4]
        assert len(places.keep_outs) == 1


def test_layers_across_the_antimeridian_are_cut_and_join_again(tmp_path: Path) -> None:
    ring = [(x % 360.0, y) for x, y in _FAR]
    layer = GeoLayer("perimeter", "Polygon", (shapely.Polygon(ring),), ({"area_m2": 1.0},))
    write_geojson(tmp_path / "x.geojson", [layer], {})
    write_kml(tmp_path / "x.kml", [layer], {}, colours={})
    line = GeoLayer("swaths", "LineString", (shapely.LineString(ring[:2]),), ({},))
    write_geojson(tmp_path / "l.geojson", [line], {})
    (feature,) = json.loads((tmp_path / "l.geojson").read_text())["features"]
    parts = sorted(feature["geometry"]["coordinates"])
    assert parts == [[[-180.0, -16.5], [-179.9998, -16.5]], [[179.9998, -16.5], [180.0, -16.5]]]
    (feature,) = json.loads((tmp_path / "x.geojson").read_text())["features"]
    for path in (_geojson(tmp_path / "x.geojson", feature["geometry"]), tmp_path / "x.kml"):
        assert len(read_field(path).latitude_deg) == 4


def test_longitudes_go_on_across_the_antimeridian() -> None:
    np.testing.assert_array_equal(
        continuous(np.array([179.0, -179.0, 181.0, -181.0]), 179.5), [179.0, 181.0, 181.0, 179.0]
    )
    np.testing.assert_array_equal(continuous(np.array([19.1, -20.0]), 0.0), [19.1, -20.0])
