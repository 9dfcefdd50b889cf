"""Corners of a field: a polygon as GeoJSON, KML, shapefile or CSV, three corners as CSV, or those marked in a run."""

import csv
import io
import json
import re
import zipfile
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any, NamedTuple
from xml.etree import ElementTree

import numpy as np
import shapely
from jaxtyping import Float

from lgprjax.errors import InputError
from lgprjax.formats.coverage_files import MEMBER, read_cover_plan
from lgprjax.formats.geometries import Ring, continuous, joined
from lgprjax.formats.signal_tables import number_of, separator_of

CORNERS_FILE = "corners.csv"
"""Next to the segments of a run in which corners were marked."""
_CORNERS = 3
_COLUMNS = ("latitude_deg", "longitude_deg")
_HEIGHT = "height_m"
# Names of WGS-84 longitude and latitude in files from before RFC 7946.
_WGS84 = ("urn:ogc:def:crs:OGC:1.3:CRS84", "urn:ogc:def:crs:OGC::CRS84", "EPSG:4326", "urn:ogc:def:crs:EPSG::4326")
# A field's border takes some kilobytes: what unpacks to more is none.
_LARGEST_KML_BYTES = 100_000_000


class KeepOut(NamedTuple):
    """A ring on WGS-84 that nothing may reach into; ``buffer_m`` around it, ``None`` where the file states none."""

    latitude_deg: Float[np.ndarray, " corner"]
    longitude_deg: Float[np.ndarray, " corner"]
    height_m: Float[np.ndarray, " corner"]
    buffer_m: float | None


class PlacedGround(NamedTuple):
    """Ground that a plan declares safe, on WGS-84.

    Attributes:
        parts: outer ring, then holes, of each part: latitude, longitude and height of each corner.
        clearance_m: see ``SafeGround``.
    """

    parts: tuple[tuple[Float[np.ndarray, "_ 3"], ...], ...]
    clearance_m: float


class FieldPlaces(NamedTuple):
    """Corners of a field on WGS-84.

    Attributes:
        latitude_deg, longitude_deg, height_m: position of each corner; longitudes continue beyond 180 degrees across
            the antimeridian; the height is ellipsoidal, 0 if the file has none.
        driven: whether three corners were driven to, and the fourth is computed. Else all are given.
        keep_outs: holes of the polygon, and polygons of kind ``keep_out``.
        rooms_m: declared room outside each side, if the file is a plan with it.
        ground: ground declared safe, if the file is a plan with such ground.
        notes: notes on corners left out or changed.
    """

    latitude_deg: Float[np.ndarray, " corner"]
    longitude_deg: Float[np.ndarray, " corner"]
    height_m: Float[np.ndarray, " corner"]
    driven: bool
    keep_outs: tuple[KeepOut, ...] = ()
    rooms_m: tuple[float, ...] = ()
    ground: PlacedGround | None = None
    notes: tuple[str, ...] = ()


class _Shape(NamedTuple):
    """A polygon, or several, of one feature: its name, and of each the outer ring and the holes."""

    name: str
    polygons: list[list[Ring]]


def read_field(path: str | Path, *, polygon: str | None = None) -> FieldPlaces:
    """Corners from a file, or from the folder of a run.

    Args:
        path: ``.geojson`` or ``.json`` with a polygon, its holes and polygons of kind ``keep_out``; ``.kml`` or
            ``.kmz``; ``.shp`` (needs the extra ``gis``); ``.csv`` with rows of ``latitude_deg``, ``longitude_deg`` and,
            if known, ``height_m``: three driven corners, or all corners of a polygon; a folder with ``corners.csv``.
        polygon: name, or number from 1, of the polygon to read of a file with several.

    Raises:
        InputError: the file cannot be read, is of another kind, has no polygon or several and none is chosen,
            coordinates that are not degrees, or fewer than three corners.
    """
    file = Path(path)
    if file.is_dir():
        marked = file / CORNERS_FILE
        if not marked.is_file():
            raise InputError(file, "corners", f"three corners marked while driving ({CORNERS_FILE})", "none")
        return _from_csv(marked)
    suffix = file.suffix.lower()
    if suffix == ".csv":
        return _from_csv(file)
    reader = {
        ".geojson": _from_geojson,
        ".json": _from_geojson,
        ".kml": _from_kml,
        ".kmz": _from_kml,
        ".shp": _from_shapefile,
    }.get(suffix)
    if reader is None:
        expected = "a .geojson, .kml, .kmz, .shp or .csv of corners, or the folder of a run"
        raise InputError(file, "file name", expected, repr(file.name))
    return reader(file, polygon)


def _bytes(file: Path) -> bytes:
    try:
        return file.read_bytes()
    except OSError as error:
        raise InputError(file, "file", "a readable file", error.strerror or str(error)) from None


def _decoded(file: Path, data: bytes, encoding: str) -> str:
    try:
        return data.decode(encoding)
    except (UnicodeDecodeError, LookupError) as error:
        raise InputError(file, "file", f"text in {encoding.upper().removesuffix('-SIG')}", str(error)) from None


# Tables of corners.


def _from_csv(file: Path) -> FieldPlaces:
    data = _bytes(file)
    # Names of columns and numbers are the same in all encodings of one byte a letter; spreadsheets write others too.
    utf16 = data.startswith((b"\xff\xfe", b"\xfe\xff"))
    text = _decoded(file, data, "utf-16") if utf16 else data.decode("latin-1").removeprefix("\xef\xbb\xbf")
    separator = separator_of(text.partition("\n")[0])
    try:
        table = list(csv.reader(io.StringIO(text, newline=""), delimiter=separator, skipinitialspace=True))
    except csv.Error as error:
        raise InputError(file, "file", "a CSV file", str(error)) from None
    names = [name.strip() for name in table[0]] if table else []
    for name in _COLUMNS:
        if names.count(name) != 1:
            raise InputError(file, name, f"a column {name}", ", ".join(names)[:80] or "an empty file")
    rows = [(number, row) for number, row in enumerate(table[1:], start=1) if any(cell.strip() for cell in row)]
    if len(rows) < _CORNERS:
        raise InputError(file, "corners", "at least three rows, one per corner", str(len(rows)))
    corners = []
    for number, row in rows:
        if any(cell.strip() for cell in row[len(names) :]):
            hint = "; decimal commas need semicolons between the columns" if separator == "," else ""
            raise InputError(file, f"row {number}", f"{len(names)} columns", f"{len(row)}{hint}")
        cells = dict(zip(names, row, strict=False))
        latitude, longitude = (_finite(file, f"row {number}, {name}", cells.get(name), separator) for name in _COLUMNS)
        height = cells.get(_HEIGHT, "").strip()
        known = _finite(file, f"row {number}, {_HEIGHT}", height, separator) if height else np.nan
        corners.append((latitude, longitude, known))
    return _checked(file, np.array(corners), driven=len(rows) == _CORNERS)


def _finite(file: Path, place: str, text: str | None, separator: str = ",") -> float:
    value = number_of((text or "").strip(), separator)
    if value is None or not np.isfinite(value):
        raise InputError(file, place, "a number", repr(text)[:60])
    return value


# Polygons of map programs.


def _from_geojson(file: Path, polygon: str | None) -> FieldPlaces:
    text = _decoded(file, _bytes(file), "utf-8-sig")
    try:
        table = json.loads(text)
    except json.JSONDecodeError as error:
        raise InputError(file, "file", "GeoJSON", f"text that is not JSON ({error.msg}, line {error.lineno})") from None
    except (RecursionError, ValueError):
        raise InputError(file, "file", "GeoJSON", "text that nests too deep, or numbers that are too long") from None
    if not isinstance(table, dict):
        raise InputError(file, "file", "a GeoJSON object", type(table).__name__)
    stated = table.get("crs")
    inner = stated.get("properties") if isinstance(stated, dict) else None
    name = inner.get("name") if isinstance(inner, dict) else stated
    if stated is not None and name not in _WGS84:
        raise InputError(file, "crs", "WGS-84 longitude and latitude (save the layer as EPSG:4326)", repr(name)[:60])
    features = _geometries(table)
    every = [each for each in features if each[0].get("type") in ("Polygon", "MultiPolygon")]
    shapes = [
        _Shape(_name_in(properties), _polygons(file, each))
        for each, properties in every
        if properties.get("kind") not in ("ground", "keep_out")
    ]
    others = sorted({str(each.get("type")) for each, _ in features} - {"Polygon", "MultiPolygon"})
    (outer, *holes), notes = _chosen(file, shapes, polygon, others)
    keep_outs: list[tuple[Ring, float | None]] = [(ring, None) for ring in holes]
    for each, properties in every:
        if properties.get("kind") == "keep_out":
            buffer = properties.get("buffer_m")
            buffer_m = None if buffer is None else _finite(file, "buffer_m of a keep-out", str(buffer))
            keep_outs += [(rings[0], buffer_m) for rings in _whole(_polygons(file, each))]
    found = _field(file, outer, keep_outs, notes)
    if isinstance(table.get(MEMBER), dict):
        # A changed plan would declare ground without a declaration.
        plan = read_cover_plan(file)
        found = found._replace(rooms_m=plan.rooms_m)
        if plan.ground is not None:
            # The ground drawn on the map, with its corners at the height of the field's corners.
            drawn = (_polygons(file, each) for each, properties in every if properties.get("kind") == "ground")
            parts = tuple(
                tuple(np.nan_to_num(ring[:-1]) for ring in rings) for polygons in drawn for rings in _whole(polygons)
            )
            found = found._replace(ground=PlacedGround(parts, plan.ground.clearance_m))
    return found


def _geometries(
    table: dict[str, Any], properties: dict[str, Any] | None = None
) -> list[tuple[dict[str, Any], dict[str, Any]]]:
    """Geometries of a GeoJSON object of any kind, with the properties of their features."""
    kind = table.get("type")
    members = {"FeatureCollection": "features", "GeometryCollection": "geometries"}.get(str(kind))
    if members is not None:
        inner = table.get(members)
        each = [item for item in inner if isinstance(item, dict)] if isinstance(inner, list) else []
        return [geometry for item in each for geometry in _geometries(item, properties)]
    if kind == "Feature":
        geometry, held = table.get("geometry"), table.get("properties")
        return _geometries(geometry, held if isinstance(held, dict) else {}) if isinstance(geometry, dict) else []
    return [(table, properties or {})]


def _name_in(properties: dict[str, Any]) -> str:
    return next((str(value) for key, value in properties.items() if key.lower() == "name" and value is not None), "")


def _polygons(file: Path, geometry: dict[str, Any]) -> list[list[Ring]]:
    """Polygons of a geometry, each an outer ring and its holes; those without corners are left out."""
    found = geometry.get("coordinates")
    several = found if geometry["type"] == "MultiPolygon" else [found]
    polygons = []
    for rings in several if isinstance(several, list) else ():
        if not isinstance(rings, list) or not all(isinstance(ring, list) for ring in rings):
            raise InputError(file, "geometry", "a Polygon with corners", repr(rings)[:40])
        if rings and rings[0]:
            polygons.append([_ring(file, ring) for ring in rings if ring])
    return polygons


def _ring(file: Path, positions: Sequence[object]) -> Ring:
    return np.array([_position(file, number, each) for number, each in enumerate(positions)])


def _position(file: Path, number: int, position: object) -> tuple[float, float, float]:
    """Latitude, longitude and height of a GeoJSON position; the height is NaN if it is not a number."""
    place = f"corner {number + 1}"
    if not isinstance(position, list) or len(position) < 2:
        raise InputError(file, place, "longitude and latitude", repr(position)[:40])
    longitude, latitude = (_finite(file, place, str(each)) for each in position[:2])
    height = position[2] if len(position) > 2 else None
    known = isinstance(height, int | float) and np.isfinite(height)
    return latitude, longitude, float(height) if known and height is not None else np.nan


def _from_kml(file: Path, polygon: str | None) -> FieldPlaces:
    root = _xml(file, _bytes(file))

    def named(element: ElementTree.Element, name: str) -> list[ElementTree.Element]:
        return [each for each in element.iter() if each.tag.rpartition("}")[2] == name]

    heights = False

    def ring(element: ElementTree.Element) -> Ring:
        nonlocal heights
        text = " ".join((each.text or "") for each in named(element, "coordinates"))
        tuples = [each.rstrip(",") for each in text.split()]
        if not all("," in each for each in tuples):  # blanks behind commas, which KML forbids
            tuples = re.sub(r"\s*,\s*", ",", text).split()
        places = []
        for number, each in enumerate(tuples):
            cells = each.split(",")
            if len(cells) > 3:
                expected = "longitude,latitude[,height], with decimal points"
                raise InputError(file, f"corner {number + 1}", expected, f"{each[:60]} (decimal commas?)")
            heights |= len(cells) > 2 and cells[2].strip("-+0.") != ""
            # Heights in KML count from the sea or from the ground, not from the ellipsoid.
            places.append(_position(file, number, list(cells[:2])))
        return np.array(places).reshape(-1, 3)

    def rings(element: ElementTree.Element) -> list[Ring]:
        outer = named(element, "outerBoundaryIs")
        if len(outer) != 1:
            raise InputError(file, "outerBoundaryIs", "one outer boundary", f"{len(outer) or 'none'}")
        found = [ring(each) for each in (outer[0], *named(element, "innerBoundaryIs"))]
        return [each for each in found if len(each)] if len(found[0]) else []

    marks = named(root, "Placemark") or [root]
    shapes = []
    for mark in marks:
        name = next((each.text or "" for each in mark if each.tag.rpartition("}")[2] == "name"), "")
        found = [rings(each) for each in named(mark, "Polygon")]
        if found:
            shapes.append(_Shape(name.strip(), [each for each in found if each]))
    others = sorted({name for name in ("Point", "LineString") if named(root, name)})
    (outer, *holes), notes = _chosen(file, shapes, polygon, others)
    dropped = ("KML heights ignored: they are not ellipsoidal heights",) if heights else ()
    return _field(file, outer, [(each, None) for each in holes], (*notes, *dropped))


def _xml(file: Path, data: bytes) -> ElementTree.Element:
    """Root of a KML document, packed (KMZ) or plain, in the encoding that it declares."""
    if data.startswith(b"PK"):
        try:
            with zipfile.ZipFile(io.BytesIO(data)) as archive:
                found = [each for each in archive.infolist() if each.filename.lower().endswith(".kml")]
                if not found or found[0].file_size > _LARGEST_KML_BYTES:
                    expected = f"a KMZ with a .kml of up to {_LARGEST_KML_BYTES} bytes"
                    raise InputError(file, "file", expected, f"{found[0].file_size} bytes" if found else "none")
                data = archive.read(found[0])
        except InputError:
            raise
        except Exception as error:  # archives and decompression fail in many ways
            raise InputError(file, "file", "a KMZ", f"a damaged or encrypted archive ({str(error)[:80]})") from None
    declared = re.match(rb"""(?:\xef\xbb\xbf)?\s*<\?xml[^>]*?encoding\s*=\s*["']([\w.:-]+)""", data)
    encoding = declared[1][:40].decode() if declared else "utf-8-sig"
    if data.startswith((b"\xff\xfe", b"\xfe\xff")):
        encoding = "utf-16"
    elif re.fullmatch("utf-?(8|16|32)(le|be)?", encoding.lower()):
        encoding = "utf-8-sig"  # one that can be read as ASCII is of no wider letters, whatever it declares
    text = _decoded(file, data, encoding)
    try:
        return ElementTree.fromstring(text)
    except (ElementTree.ParseError, ValueError) as error:
        raise InputError(file, "file", "KML", f"text that is not XML ({error})") from None


def _from_shapefile(file: Path, polygon: str | None) -> FieldPlaces:
    try:
        import pyogrio
    except ImportError:
        expected = 'pyogrio (pip install "lgprjax[gis]"), or the field as GeoJSON'
        raise InputError(file, "file", expected, "not installed") from None
    try:
        meta, _, shapes, columns = pyogrio.raw.read(file)
    except Exception as error:  # the library's errors have no common base
        raise InputError(file, "file", "a shapefile", str(error)) from None
    if meta["crs"] not in ("EPSG:4326", "OGC:CRS84"):
        expected = "WGS-84 longitude and latitude (save the layer as EPSG:4326)"
        raise InputError(file, "crs", expected, repr(meta["crs"])[:60])
    names = list(meta["fields"])
    found, others = [], set()
    for number, shape in enumerate(shapely.from_wkb(shapes)):
        if shape is None:
            continue
        parts = [part for part in shapely.get_parts(shape) if not part.is_empty]
        others |= {part.geom_type for part in parts} - {"Polygon"}
        properties = {name: column[number] for name, column in zip(names, columns, strict=True)}
        polygons = [
            [_ring(file, [list(each) for each in ring.coords]) for ring in (part.exterior, *part.interiors)]
            for part in parts
            if part.geom_type == "Polygon"
        ]
        if polygons or shape.geom_type in ("Polygon", "MultiPolygon"):
            found.append(_Shape(_name_in(properties), polygons))
    (outer, *holes), notes = _chosen(file, found, polygon, sorted(others))
    return _field(file, outer, [(ring, None) for ring in holes], notes)


# The polygon that is the field, and its corners.


def _whole(polygons: list[list[Ring]]) -> list[list[Ring]]:
    """Polygons of a feature; those that the antimeridian cut apart are one."""
    one = joined(polygons) if len(polygons) > 1 else None
    return polygons if one is None else [one]


def _chosen(
    file: Path, shapes: Sequence[_Shape], polygon: str | None, others: Sequence[str]
) -> tuple[list[Ring], tuple[str, ...]]:
    """Rings of the only polygon, or of the chosen one, and a note on those without corners."""
    every = [(shape.name, rings) for shape in shapes for rings in _whole(shape.polygons)]
    empty = sum(not shape.polygons for shape in shapes)
    notes = (f"{empty} polygon{'' if empty == 1 else 's'} without corners left out",) if empty else ()
    if polygon is None:
        found = every
    else:
        found = [each for each in every if each[0] == polygon]
        if not found and polygon.isdecimal() and 1 <= int(polygon) <= len(every):
            found = [every[int(polygon) - 1]]
    if len(found) == 1:
        return found[0][1], notes
    if not every:
        count = "one without corners" if empty else f"none, but {', '.join(others)}" if others else "none"
        raise InputError(file, "geometry", "one Polygon, the border of the field", count)
    names = ", ".join(repr(name[:40]) if name else str(number) for number, (name, _) in enumerate(every[:9], start=1))
    parts = " (parts of a MultiPolygon count)" if len(every) > len(shapes) else ""
    expected = "one Polygon, or its name or number from 1 with lgprjax cover plan --polygon"
    raise InputError(file, "geometry", expected, f"{len(every)}: {names}{', ...' if len(every) > 9 else ''}{parts}")


def _field(
    file: Path, outer: Ring, keep_outs: Iterable[tuple[Ring, float | None]], notes: tuple[str, ...]
) -> FieldPlaces:
    """Checked rings; a first corner that is repeated at the end counts once."""

    def opened(ring: Ring) -> Ring:
        return ring[:-1] if len(ring) > 1 and np.array_equal(ring[0, :2], ring[-1, :2]) else ring

    places = _checked(file, opened(outer), driven=False)
    held = []
    for ring, buffer_m in keep_outs:
        checked = _checked(file, opened(ring), driven=False)
        if len(checked.latitude_deg) < _CORNERS:
            raise InputError(file, "keep-out", "at least three corners", str(len(checked.latitude_deg)))
        held.append(KeepOut(checked.latitude_deg, checked.longitude_deg, checked.height_m, buffer_m))
    told = (f"{len(held)} keep-out{'' if len(held) == 1 else 's'}",) if held else ()
    return places._replace(keep_outs=tuple(held), notes=(*told, *notes, *places.notes))


def _checked(file: Path, values: Ring, *, driven: bool) -> FieldPlaces:
    latitude, longitude, height = values.T
    beyond = (np.abs(latitude) > 90.0) | (np.abs(longitude) > 360.0)
    if beyond.any():
        corner = int(np.argmax(beyond))
        found = f"{latitude[corner]:.10g} and {longitude[corner]:.10g}"
        if np.all(np.abs(longitude) <= 90.0) and np.all(np.abs(latitude) <= 180.0):
            found += ", which look swapped"
        elif abs(latitude[corner]) > 360.0 or abs(longitude[corner]) > 360.0:
            found += ", which look like metres of a projection"
        raise InputError(file, f"corner {corner + 1}", "latitude (-90 to 90) and longitude (-180 to 180)", found)
    first = continuous(longitude[:1], 0.0)[0] if len(longitude) else 0.0
    some = np.isfinite(height)
    notes = ("heights left out: not every corner has one",) if some.any() and not some.all() else ()
    level = height if some.all() else np.zeros(len(height))
    return FieldPlaces(
        latitude_deg=latitude, longitude_deg=continuous(longitude, first), height_m=level, driven=driven, notes=notes
    )
