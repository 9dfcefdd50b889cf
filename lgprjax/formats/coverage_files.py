"""The field file and the coverage plan ``X.cover.geojson``: GeoJSON, with everything needed to drive the plan."""

import csv
import hashlib
import json
import math
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any, NamedTuple
from xml.etree import ElementTree

import numpy as np
from jaxtyping import Float

from lgprjax import __version__
from lgprjax.coverage.field import Field, Tool
from lgprjax.coverage.ground import SafeGround
from lgprjax.coverage.pattern import Pattern
from lgprjax.coverage.swaths import Line, PatternSettings
from lgprjax.coverage.turns import HeadlandTurn, Pose
from lgprjax.errors import InputError
from lgprjax.formats.schema import Finding, check_version, key_findings, load_schema
from lgprjax.formats.store import atomic_output
from lgprjax.formats.vehicle import flat_keys
from lgprjax.frames import LocalFrame

_SCHEMA = load_schema("cover_plan")
_MEMBER = "lgprjax"
_LISTS = ("perimeter_m", "lines", "turns", "unreached")
_GROUND_LISTS = ("ground_m", "keep_outs_m", "rooms_m")
_OLD_VERSION = "1.0"
_GROUND_VERSION = "2.0"
_DIGEST = "sha256"
_COMPUTED = "computed_corner"
# 1e-10 degrees are a hundredth of a millimetre.
_DECIMALS = 10


class CoverPlan(NamedTuple):
    """A field and how it is covered.

    Attributes:
        name: of the field.
        frame: local metres around the plan's anchor.
        pattern: including the field and the settings.
        tool: of the vehicle.
        vehicle_name, vehicle_sha256: of that vehicle's file.
        made_by: program and version.
        ground: declared safe to drive on; ``None``: around the field, as far as the plan's turns need.
        keep_outs_m: rings, with their buffers, that nothing may reach into.
        rooms_m: declared to be safe outside each side of the field, from its first corner on; empty: none was declared.
        computed_corner: of the perimeter's, from 0, the one that follows from three that were driven to; ``None``: all
            were given. Nobody was there yet.
    """

    name: str
    frame: LocalFrame
    pattern: Pattern
    tool: Tool
    vehicle_name: str
    vehicle_sha256: str
    made_by: str = f"lgprjax {__version__}"
    ground: SafeGround | None = None
    keep_outs_m: tuple[Float[np.ndarray, "_ 2"], ...] = ()
    rooms_m: tuple[float, ...] = ()
    computed_corner: int | None = None


def write_cover_plan(
    path: str | Path, plan: CoverPlan, turns_m: Sequence[Float[np.ndarray, "_ 2"]], *, force: bool = False
) -> None:
    """Write a plan.

    Args:
        path: ``X.cover.geojson``.
        plan: to write.
        turns_m: points along each of its turns, for display on a map.
        force: replace an output that exists.

    Raises:
        InputError: a value is not as the schema says, or the output exists (without ``force``) or cannot be written.
    """
    member = _member(plan)
    for finding in _member_findings(str(path), member):
        raise finding.error()
    collection = {"type": "FeatureCollection", _MEMBER: member, "features": _features(plan, turns_m)}
    member[_DIGEST] = _digest(collection)
    with atomic_output(path, force) as temporary:
        temporary.write_text(json.dumps(collection, ensure_ascii=False, allow_nan=False) + "\n", encoding="utf-8")


def read_cover_plan(path: str | Path) -> CoverPlan:
    """A plan from its file, exactly as it was written.

    Raises:
        InputError: the file is missing, not JSON, not a plan, of a newer major version, or was changed after writing.
    """
    file = Path(path)
    collection = _load(file)
    for finding in _problems(file, collection):
        raise finding.error()
    try:
        return _plan(collection[_MEMBER])._replace(computed_corner=_computed_corner(collection["features"]))
    except (TypeError, ValueError, KeyError, IndexError) as error:
        raise InputError(file, _MEMBER, "valid lines and turns", str(error)) from None


def cover_plan_findings(path: Path) -> Iterator[Finding]:
    """Every problem of a plan's file.

    Raises:
        InputError: it cannot be read, or is not JSON.
    """
    return _problems(path, _load(path))


def _load(path: Path) -> dict[str, Any]:
    try:
        table = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise InputError(path, "file", "a readable file", error.strerror or str(error)) from None
    except (json.JSONDecodeError, UnicodeDecodeError) as error:
        raise InputError(path, "file", "GeoJSON", str(error)) from None
    return table if isinstance(table, dict) else {}


def _problems(path: Path, collection: dict[str, Any]) -> Iterator[Finding]:
    member = collection.get(_MEMBER)
    if not isinstance(member, dict):
        expected = f"a coverage plan (lgprjax cover plan), with its member {_MEMBER!r}"
        yield Finding(str(path), _MEMBER, expected, "none")
        return
    problems = list(_member_findings(str(path), {name: value for name, value in member.items() if name != _DIGEST}))
    yield from problems
    if not problems and member.get(_DIGEST) != _digest(collection):
        expected = "an unchanged plan (to change the perimeter, plan again from a new field)"
        yield Finding(str(path), _DIGEST, expected, "a changed plan")


def _member_findings(file: str, member: dict[str, Any]) -> Iterator[Finding]:
    refusal = check_version(_SCHEMA, member.get("schema"), member.get("schema_version"))
    if refusal is not None:
        yield Finding(file, *refusal)
        return
    for name in _LISTS:
        if not isinstance(member.get(name), list):
            yield Finding(file, name, "a list", "none" if name not in member else repr(member[name])[:40])
    for name in _GROUND_LISTS:
        if name in member and not isinstance(member[name], list):
            yield Finding(file, name, "a list", repr(member[name])[:40])
    if ("ground" in member) != ("ground_m" in member):
        yield Finding(file, "ground_m", "both ground_m and ground.clearance_m, or neither", "one of them")
    known = ("schema", "schema_version", *_LISTS, *_GROUND_LISTS)
    left = {name: value for name, value in member.items() if name not in known}
    yield from key_findings(_SCHEMA, file, flat_keys(left))


def _digest(collection: dict[str, Any]) -> str:
    """SHA-256 of a collection without this number, independent of white space and the order of names."""
    member = {name: value for name, value in collection[_MEMBER].items() if name != _DIGEST}
    text = json.dumps({**collection, _MEMBER: member}, sort_keys=True, separators=(",", ":"), ensure_ascii=False)
    return hashlib.sha256(text.encode()).hexdigest()


def _member(plan: CoverPlan) -> dict[str, Any]:
    pattern, frame = plan.pattern, plan.frame
    tightest_m = pattern.tightest_radius_m
    figures = {name: float(getattr(pattern, name)) for name in ("spacing_m", "length_m", "line_length_m")}
    return {
        "schema": _SCHEMA.name,
        "schema_version": _version_of(plan),
        "name": plan.name,
        "made_by": plan.made_by,
        "anchor": {
            "latitude_deg": frame.latitude_deg,
            "longitude_deg": frame.longitude_deg,
            "height_m": frame.height_m,
        },
        "vehicle": {"name": plan.vehicle_name, "sha256": plan.vehicle_sha256},
        "tool": plan.tool._asdict(),
        "settings": {name: value for name, value in asdict(pattern.settings).items() if value is not None},
        "pattern": figures | ({"tightest_radius_m": float(tightest_m)} if math.isfinite(tightest_m) else {}),
        "perimeter_m": pattern.field.perimeter_m.tolist(),
        "lines": [_numbers(line) for line in pattern.lines],
        "turns": [{"start": list(turn.start), "pieces": turn.pieces.tolist()} for turn in pattern.turns],
        "unreached": [_numbers(line) for line in pattern.unreached],
        **_ground_member(plan),
    }


def _version_of(plan: CoverPlan) -> str:
    """The oldest version whose readers drive the plan as it is meant.

    They lay the fence around the field and know no way in reverse: what needs more they must refuse.
    """
    old = plan.ground is None and not plan.keep_outs_m and plan.pattern.settings.order in ("zamboni", "boustrophedon")
    if old and not plan.rooms_m:
        return _OLD_VERSION
    return _SCHEMA.version if plan.rooms_m else _GROUND_VERSION


def _ground_member(plan: CoverPlan) -> dict[str, Any]:
    if plan.ground is None and not plan.keep_outs_m:
        return {}
    keep_outs: dict[str, Any] = {"keep_outs_m": [ring.tolist() for ring in plan.keep_outs_m]}
    if plan.rooms_m:
        keep_outs["rooms_m"] = list(plan.rooms_m)
    if plan.ground is None:
        return keep_outs
    rings = [[ring.tolist() for ring in part] for part in plan.ground.polygons_m]
    return {"ground": {"clearance_m": float(plan.ground.clearance_m)}, "ground_m": rings, **keep_outs}


def _numbers(line: Line) -> list[int | float]:
    return [line.number, *line.start_m.tolist(), *line.end_m.tolist()]


def _line(numbers: list[int | float]) -> Line:
    number, *places = numbers
    start_east, start_north, end_east, end_north = (float(value) for value in places)
    return Line(int(number), np.array([start_east, start_north]), np.array([end_east, end_north]))


def _plan(member: dict[str, Any]) -> CoverPlan:
    anchor, stated = member["anchor"], member["pattern"]
    pattern = Pattern(
        field=Field(np.array(member["perimeter_m"], np.float64)),
        settings=PatternSettings(**member["settings"]),
        lines=tuple(_line(numbers) for numbers in member["lines"]),
        turns=tuple(
            HeadlandTurn(
                Pose(*(float(value) for value in turn["start"])), np.array(turn["pieces"], np.float64).reshape(-1, 2)
            )
            for turn in member["turns"]
        ),
        spacing_m=float(stated["spacing_m"]),
        length_m=float(stated["length_m"]),
        line_length_m=float(stated["line_length_m"]),
        tightest_radius_m=float(stated.get("tightest_radius_m", math.inf)),
        unreached=tuple(_line(numbers) for numbers in member["unreached"]),
    )
    return CoverPlan(
        name=member["name"],
        frame=LocalFrame(*(float(anchor[name]) for name in ("latitude_deg", "longitude_deg", "height_m"))),
        pattern=pattern,
        tool=Tool(**{name: float(value) for name, value in member["tool"].items()}),
        vehicle_name=member["vehicle"]["name"],
        vehicle_sha256=member["vehicle"]["sha256"],
        made_by=member["made_by"],
        ground=_ground(member),
        keep_outs_m=tuple(np.array(ring, np.float64).reshape(-1, 2) for ring in member.get("keep_outs_m", [])),
        rooms_m=tuple(float(room_m) for room_m in member.get("rooms_m", [])),
    )


def _ground(member: dict[str, Any]) -> SafeGround | None:
    if "ground_m" not in member:
        return None
    parts = tuple(tuple(np.array(ring, np.float64).reshape(-1, 2) for ring in part) for part in member["ground_m"])
    if not parts or any(len(part) == 0 or any(len(ring) < 3 for ring in part) for part in parts):
        raise ValueError("ground without corners")
    return SafeGround(parts, float(member["ground"]["clearance_m"]))


def _features(plan: CoverPlan, turns_m: Sequence[Float[np.ndarray, "_ 2"]]) -> list[dict[str, Any]]:
    """Perimeter, then swaths and turns alternately in driving order."""
    pattern, frame = plan.pattern, plan.frame
    ring = np.concatenate([pattern.field.perimeter_m, pattern.field.perimeter_m[:1]])
    properties = {"kind": "perimeter", "name": plan.name, "area_m2": round(pattern.field.area_m2, 2)}
    features = [_feature("Polygon", [_positions(frame, ring)], properties)]
    if plan.computed_corner is not None:
        corner = pattern.field.perimeter_m[plan.computed_corner]
        properties = {
            "kind": _COMPUTED,
            "corner": plan.computed_corner + 1,
            "note": "computed from the other three corners: visit it",
        }
        features.append(_feature("Point", _positions(frame, corner[None])[0], properties))
    for ring in plan.keep_outs_m:
        closed = _positions(frame, np.concatenate([ring, ring[:1]]))
        features.append(_feature("Polygon", [closed], {"kind": "keep_out", "buffer_m": 0.0}))
    if plan.ground is not None:
        for part in plan.ground.polygons_m:
            rings = [_positions(frame, np.concatenate([each, each[:1]])) for each in part]
            features.append(_feature("Polygon", rings, {"kind": "ground", "clearance_m": plan.ground.clearance_m}))
    for order, line in enumerate(pattern.lines):
        ends = _positions(frame, np.stack([line.start_m, line.end_m]))
        along = line.end_m - line.start_m
        yaw = np.arctan2(along[1:], along[:1])
        heading = float(frame.heading_of_yaw(yaw, np.array([ends[0][0]]))[0])
        properties = {"kind": "line", "order": order, "number": line.number, "length_m": round(line.length_m, 3)}
        features.append(_feature("LineString", ends, {**properties, "heading_deg": round(heading, 3)}))
        if order < len(pattern.turns):
            turn = pattern.turns[order]
            properties = {"kind": "turn", "order": order, "length_m": round(turn.length_m, 3)}
            features.append(_feature("LineString", _positions(frame, turns_m[order]), properties))
    return features


def _computed_corner(features: list[dict[str, Any]]) -> int | None:
    """It stands among the features, for map programs and so that older readers still drive the plan."""
    found = [each["properties"]["corner"] for each in features if each["properties"].get("kind") == _COMPUTED]
    return int(found[0]) - 1 if found else None


def _feature(kind: str, coordinates: list[Any], properties: dict[str, Any]) -> dict[str, Any]:
    return {"type": "Feature", "geometry": {"type": kind, "coordinates": coordinates}, "properties": properties}


def _positions(frame: LocalFrame, points_m: Float[np.ndarray, "point 2"]) -> list[list[float]]:
    """Longitude and latitude of places on the plan's level."""
    latitude, longitude, _ = frame.to_geodetic(points_m[:, 0], points_m[:, 1], np.zeros(len(points_m)))
    places = np.round(np.stack([longitude, latitude], axis=1), _DECIMALS)
    return [[float(each) for each in place] for place in places]


# Corners of a field: a polygon as GeoJSON, KML, shapefile or CSV, three corners as CSV, or corners marked during a run.

CORNERS_FILE = "corners.csv"
"""Next to the segments of a run in which corners were marked."""
_CORNERS = 3
_COLUMNS = ("latitude_deg", "longitude_deg")
# Names of WGS-84 longitude and latitude in files from before RFC 7946.
_WGS84 = ("urn:ogc:def:crs:OGC:1.3:CRS84", "urn:ogc:def:crs:OGC::CRS84", "EPSG:4326", "urn:ogc:def:crs:EPSG::4326")


class KeepOut(NamedTuple):
    """A ring on WGS-84 that nothing may reach into; ``buffer_m`` around it, ``None`` where the file states none."""

    latitude_deg: Float[np.ndarray, " corner"]
    longitude_deg: Float[np.ndarray, " corner"]
    height_m: Float[np.ndarray, " corner"]
    buffer_m: float | None


class PlacedGround(NamedTuple):
    """Ground that a plan declares safe, on WGS-84.

    Attributes:
        parts: of each its outer ring, then its holes: latitude, longitude and height of each corner.
        clearance_m: see ``SafeGround``.
    """

    parts: tuple[tuple[Float[np.ndarray, "_ 3"], ...], ...]
    clearance_m: float


class FieldPlaces(NamedTuple):
    """Corners of a field on WGS-84.

    Attributes:
        latitude_deg, longitude_deg, height_m: of each; the height is ellipsoidal, 0 if the file has none.
        driven: the three corners were driven to, and the fourth is computed. Else all are given.
        keep_outs: holes of the polygon, and polygons of kind ``keep_out``.
        rooms_m: declared outside each side, where the file is a plan that knows it.
        ground: declared safe, where the file is a plan with such ground.
        notes: what reading left out or changed.
    """

    latitude_deg: Float[np.ndarray, " corner"]
    longitude_deg: Float[np.ndarray, " corner"]
    height_m: Float[np.ndarray, " corner"]
    driven: bool
    keep_outs: tuple[KeepOut, ...] = ()
    rooms_m: tuple[float, ...] = ()
    ground: PlacedGround | None = None
    notes: tuple[str, ...] = ()


def read_field(path: str | Path) -> FieldPlaces:
    """Corners from a file, or from the folder of a run.

    Args:
        path: ``.geojson`` or ``.json`` with one polygon, its holes and polygons of kind ``keep_out``; ``.kml`` with one
            polygon; ``.shp`` with one polygon (needs the extra ``gis``); ``.csv`` with rows of ``latitude_deg``,
            ``longitude_deg`` and, if known, ``height_m``: three driven corners, or all corners of a polygon; a folder
            with ``corners.csv``.

    Raises:
        InputError: the file cannot be read, is of another kind, has no polygon or several, coordinates that are not
            degrees, or fewer than three corners.
    """
    file = Path(path)
    if file.is_dir():
        marked = file / CORNERS_FILE
        if not marked.is_file():
            raise InputError(file, "corners", f"three corners marked while driving ({CORNERS_FILE})", "none")
        return _from_csv(marked)
    readers = {
        ".csv": _from_csv,
        ".geojson": _from_geojson,
        ".json": _from_geojson,
        ".kml": _from_kml,
        ".shp": _from_shapefile,
    }
    reader = readers.get(file.suffix.lower())
    if reader is None:
        expected = "a .geojson, .kml, .shp or .csv of corners, or the folder of a run"
        raise InputError(file, "file name", expected, repr(file.name))
    return reader(file)


def _text(file: Path) -> str:
    try:
        return file.read_text(encoding="utf-8-sig")
    except OSError as error:
        raise InputError(file, "file", "a readable file", error.strerror or str(error)) from None
    except UnicodeDecodeError as error:
        raise InputError(file, "file", "text in UTF-8", str(error)) from None


def _from_csv(file: Path) -> FieldPlaces:
    reader = csv.DictReader(_text(file).splitlines(), skipinitialspace=True)
    names = reader.fieldnames or []
    for name in _COLUMNS:
        if name not in names:
            raise InputError(file, name, f"a column {name}", ", ".join(names) or "an empty file")
    rows = list(reader)
    if len(rows) < _CORNERS:
        raise InputError(file, "corners", "at least three rows, one per corner", str(len(rows)))
    values = np.zeros((len(rows), 3))
    for number, row in enumerate(rows):
        for column, name in enumerate((*_COLUMNS, "height_m")):
            if name in names:
                values[number, column] = _number(file, f"row {number + 1}, {name}", row[name])
    return _checked(file, values, driven=len(rows) == _CORNERS)


def _number(file: Path, place: str, text: str | None) -> float:
    try:
        value = float(text or "")
    except ValueError:
        value = float("nan")
    if not np.isfinite(value):
        raise InputError(file, place, "a number", repr(text))
    return value


def _from_geojson(file: Path) -> FieldPlaces:
    try:
        table = json.loads(_text(file))
    except json.JSONDecodeError as error:
        raise InputError(file, "file", "GeoJSON", f"text that is not JSON ({error.msg}, line {error.lineno})") from None
    if not isinstance(table, dict):
        raise InputError(file, "file", "a GeoJSON object", type(table).__name__)
    stated = table.get("crs")
    name = stated.get("properties", {}).get("name") if isinstance(stated, dict) else stated
    if stated is not None and name not in _WGS84:
        raise InputError(file, "crs", "WGS-84 longitude and latitude (save the layer as EPSG:4326)", repr(name)[:60])
    every = [
        (each, properties) for each, properties in _geometries(table) if each.get("type") in ("Polygon", "MultiPolygon")
    ]
    polygons = [each for each, properties in every if properties.get("kind") not in ("ground", "keep_out")]
    if len(polygons) != 1:
        others = sorted({str(each.get("type")) for each, _ in _geometries(table)} - {"Polygon", "MultiPolygon"})
        count = f"{len(polygons)}" if polygons else f"none, but {', '.join(others)}" if others else "none"
        raise InputError(file, "geometry", "one Polygon, the border of the field", count)
    outer, *holes = _rings(file, polygons[0])
    keep_outs: list[tuple[Float[np.ndarray, "_ 3"], float | None]] = [(ring, None) for ring in holes]
    for each, properties in every:
        if properties.get("kind") == "keep_out":
            buffer = properties.get("buffer_m")
            stated = None if buffer is None else _number(file, "buffer_m of a keep-out", str(buffer))
            keep_outs.append((_rings(file, each)[0], stated))
    found = _field(file, outer, keep_outs)
    if isinstance(table.get(_MEMBER), dict):
        # A plan that was changed declares what nobody has declared.
        plan = read_cover_plan(file)
        found = found._replace(rooms_m=plan.rooms_m)
        if plan.ground is not None:
            # As drawn on the map: its corners lie on the level that those of the field lie on.
            drawn = (each for each, properties in every if properties.get("kind") == "ground")
            parts = tuple(tuple(ring[:-1] for ring in _rings(file, each)) for each in drawn)
            found = found._replace(ground=PlacedGround(parts, plan.ground.clearance_m))
    return found


def _rings(file: Path, polygon: dict[str, Any]) -> list[Float[np.ndarray, "_ 3"]]:
    """Latitude, longitude and height of a polygon's outer ring, and of its holes."""
    rings = polygon.get("coordinates")
    if polygon["type"] == "MultiPolygon":
        if not isinstance(rings, list) or len(rings) != 1:
            raise InputError(file, "geometry", "one Polygon", "a MultiPolygon with several polygons or none")
        rings = rings[0]
    if not isinstance(rings, list) or not rings or not all(isinstance(ring, list) and ring for ring in rings):
        raise InputError(file, "geometry", "a Polygon with corners", "an empty Polygon")
    return [np.array([_position(file, number, each) for number, each in enumerate(ring)]) for ring in rings]


def _field(
    file: Path,
    outer: Float[np.ndarray, "_ 3"],
    keep_outs: Sequence[tuple[Float[np.ndarray, "_ 3"], float | None]],
) -> FieldPlaces:
    """Checked rings; a first corner that is repeated at the end counts once."""

    def opened(ring: Float[np.ndarray, "_ 3"]) -> Float[np.ndarray, "_ 3"]:
        return ring[:-1] if len(ring) > 1 and np.array_equal(ring[0], ring[-1]) else ring

    places = _checked(file, opened(outer), driven=False)
    held = []
    for ring, buffer_m in keep_outs:
        checked = _checked(file, opened(ring), driven=False)
        if len(checked.latitude_deg) < _CORNERS:
            raise InputError(file, "keep-out", "at least three corners", str(len(checked.latitude_deg)))
        held.append(KeepOut(checked.latitude_deg, checked.longitude_deg, checked.height_m, buffer_m))
    notes = (f"{len(held)} keep-out{'' if len(held) == 1 else 's'}",) if held else ()
    return places._replace(keep_outs=tuple(held), notes=notes)


def _from_kml(file: Path) -> FieldPlaces:
    try:
        root = ElementTree.fromstring(_text(file).encode())
    except ElementTree.ParseError as error:
        raise InputError(file, "file", "KML", f"text that is not XML ({error})") from None

    def named(element: ElementTree.Element, name: str) -> list[ElementTree.Element]:
        return [each for each in element.iter() if each.tag.rpartition("}")[2] == name]

    def ring(element: ElementTree.Element) -> Float[np.ndarray, "_ 3"]:
        text = " ".join((each.text or "") for each in named(element, "coordinates"))
        places = [_position(file, number, each.split(",")) for number, each in enumerate(text.split())]
        return np.array(places).reshape(-1, 3)

    polygons = named(root, "Polygon")
    if len(polygons) != 1:
        raise InputError(file, "Polygon", "one Polygon", f"{len(polygons) or 'none'}")
    outer = named(polygons[0], "outerBoundaryIs")
    if len(outer) != 1:
        raise InputError(file, "outerBoundaryIs", "one outer boundary", f"{len(outer) or 'none'}")
    holes = [(ring(each), None) for each in named(polygons[0], "innerBoundaryIs")]
    # Heights in KML count from the sea or from the ground, not from the ellipsoid.
    places = _field(file, ring(outer[0]), holes)
    level = np.zeros_like(places.height_m)
    flat = tuple(each._replace(height_m=np.zeros_like(each.height_m)) for each in places.keep_outs)
    dropped = ("KML heights ignored: they are not ellipsoidal heights",) if places.height_m.any() else ()
    return places._replace(height_m=level, keep_outs=flat, notes=(*places.notes, *dropped))


def _from_shapefile(file: Path) -> FieldPlaces:
    try:
        import pyogrio
    except ImportError:
        expected = 'pyogrio (pip install "lgprjax[gis]"), or the field as GeoJSON'
        raise InputError(file, "file", expected, "not installed") from None
    import shapely

    try:
        meta, _, shapes, _ = pyogrio.raw.read(file)
    except Exception as error:  # the library's errors have no common base
        raise InputError(file, "file", "a shapefile", str(error)) from None
    if meta["crs"] not in ("EPSG:4326", "OGC:CRS84"):
        expected = "WGS-84 longitude and latitude (save the layer as EPSG:4326)"
        raise InputError(file, "crs", expected, repr(meta["crs"])[:60])
    parts = [part for shape in shapely.from_wkb(shapes) for part in shapely.get_parts(shape)]
    polygons = [part for part in parts if part.geom_type == "Polygon"]
    if len(polygons) != 1:
        raise InputError(file, "geometry", "one Polygon, the border of the field", f"{len(polygons) or 'none'}")
    rings = [
        np.array([_position(file, number, list(each)) for number, each in enumerate(ring.coords)])
        for ring in (polygons[0].exterior, *polygons[0].interiors)
    ]
    return _field(file, rings[0], [(ring, None) for ring in rings[1:]])


def _geometries(
    table: dict[str, Any], properties: dict[str, Any] | None = None
) -> list[tuple[dict[str, Any], dict[str, Any]]]:
    """Geometries of a GeoJSON object, whatever kind it is, with the properties of their features."""
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


def _position(file: Path, number: int, position: object) -> tuple[float, float, float]:
    """Latitude, longitude and height of a GeoJSON position."""
    place = f"corner {number + 1}"
    if not isinstance(position, list) or len(position) < 2:
        raise InputError(file, place, "longitude and latitude", repr(position)[:40])
    longitude, latitude, height = (_number(file, place, str(each)) for each in (*position, 0.0)[:3])
    return latitude, longitude, height


def _checked(file: Path, values: Float[np.ndarray, "_ 3"], *, driven: bool) -> FieldPlaces:
    latitude, longitude, height = values.T
    beyond = (np.abs(latitude) > 90.0) | (np.abs(longitude) > 180.0)
    if beyond.any():
        corner = int(np.argmax(beyond))
        found = f"{latitude[corner]:.10g} and {longitude[corner]:.10g}"
        if np.all(np.abs(longitude) <= 90.0) and np.all(np.abs(latitude) <= 180.0):
            found += ", which look swapped"
        elif abs(latitude[corner]) > 360.0 or abs(longitude[corner]) > 360.0:
            found += ", which look like metres of a projection"
        raise InputError(file, f"corner {corner + 1}", "latitude (-90 to 90) and longitude (-180 to 180)", found)
    return FieldPlaces(latitude, longitude, height, driven)
