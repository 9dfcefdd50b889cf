"""The coverage plan ``X.cover.geojson``, with everything needed to drive it, and the work of earlier runs by a plan."""

import hashlib
import json
import math
import zipfile
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import shapely
from jaxtyping import Float

from lgprjax import __version__
from lgprjax.coverage.field import CellGrid, Field, Tool
from lgprjax.coverage.ground import SafeGround
from lgprjax.coverage.pattern import Pattern
from lgprjax.coverage.resume import Resumption, RoutePlace, WorkedStretch
from lgprjax.coverage.swaths import Line, PatternSettings
from lgprjax.coverage.turns import HeadlandTurn, Pose
from lgprjax.errors import InputError
from lgprjax.formats.geometries import continuous, geometry
from lgprjax.formats.schema import Finding, check_version, key_findings, load_schema
from lgprjax.formats.store import atomic_output
from lgprjax.formats.vehicle import flat_keys
from lgprjax.frames import LocalFrame

_SCHEMA = load_schema("cover_plan")
MEMBER = "lgprjax"
_LISTS = ("perimeter_m", "lines", "turns", "unreached")
_GROUND_LISTS = ("ground_m", "keep_outs_m", "rooms_m")
_OLD_VERSION = "1.0"
_GROUND_VERSION = "2.0"
_DIGEST = "sha256"
_COMPUTED = "computed_corner"


class CoverPlan(NamedTuple):
    """A field and its coverage plan.

    Attributes:
        name: name of the field.
        frame: local frame at the plan's anchor.
        pattern: pattern, including the field and the settings.
        tool: tool of the vehicle.
        vehicle_name, vehicle_sha256: name and SHA-256 of the vehicle's file.
        made_by: program and version.
        ground: ground declared safe to drive on; ``None``: around the field, as far as the plan's turns need.
        keep_outs_m: rings of the keep-outs, including their buffers.
        rooms_m: room declared safe outside each side of the field, from its first corner on; empty: not declared.
        computed_corner: index, from 0, of the perimeter's corner that is computed from three driven corners and was not
            visited; ``None``: all corners were given.
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
        path: path of ``X.cover.geojson``.
        plan: plan to write.
        turns_m: points along each of its turns, for display on a map.
        force: whether to replace an existing output.

    Raises:
        InputError: a value violates the schema, or the output exists (without ``force``) or cannot be written.
    """
    member = _member(plan)
    for finding in _member_findings(str(path), member):
        raise finding.error()
    collection = {"type": "FeatureCollection", MEMBER: member, "features": _features(plan, turns_m)}
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
        return _plan(collection[MEMBER])._replace(computed_corner=_computed_corner(collection["features"]))
    except (TypeError, ValueError, KeyError, IndexError) as error:
        raise InputError(file, MEMBER, "valid lines and turns", str(error)) from None


def cover_plan_findings(path: Path) -> Iterator[Finding]:
    """Every problem of a plan's file.

    Raises:
        InputError: the file cannot be read, or is not JSON.
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
    member = collection.get(MEMBER)
    if not isinstance(member, dict):
        expected = f"a coverage plan (lgprjax cover plan), with its member {MEMBER!r}"
        yield Finding(str(path), MEMBER, expected, "none")
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
    member = {name: value for name, value in collection[MEMBER].items() if name != _DIGEST}
    text = json.dumps({**collection, MEMBER: member}, sort_keys=True, separators=(",", ":"), ensure_ascii=False)
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
    """The oldest version whose readers drive the plan correctly.

    Old readers lay the fence around the field and do not support reverse: they must refuse plans that need more.
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
    perimeter = shapely.Polygon(_degrees(frame, pattern.field.perimeter_m))
    properties = {"kind": "perimeter", "name": plan.name, "area_m2": round(pattern.field.area_m2, 2)}
    features = [_feature(perimeter, properties)]
    if plan.computed_corner is not None:
        corner = pattern.field.perimeter_m[plan.computed_corner]
        properties = {
            "kind": _COMPUTED,
            "corner": plan.computed_corner + 1,
            "note": "computed from the other three corners: visit it",
        }
        features.append(_feature(shapely.Point(_degrees(frame, corner[None])[0]), properties))
    for ring in plan.keep_outs_m:
        features.append(_feature(shapely.Polygon(_degrees(frame, ring)), {"kind": "keep_out", "buffer_m": 0.0}))
    if plan.ground is not None:
        for part in plan.ground.polygons_m:
            outer, *holes = (_degrees(frame, each) for each in part)
            properties = {"kind": "ground", "clearance_m": plan.ground.clearance_m}
            features.append(_feature(shapely.Polygon(outer, holes), properties))
    for order, line in enumerate(pattern.lines):
        ends = _degrees(frame, np.stack([line.start_m, line.end_m]))
        along = line.end_m - line.start_m
        yaw = np.arctan2(along[1:], along[:1])
        heading = float(frame.heading_of_yaw(yaw, ends[:1, 0])[0])
        properties = {"kind": "line", "order": order, "number": line.number, "length_m": round(line.length_m, 3)}
        features.append(_feature(shapely.LineString(ends), {**properties, "heading_deg": round(heading, 3)}))
        if order < len(pattern.turns):
            turn = pattern.turns[order]
            properties = {"kind": "turn", "order": order, "length_m": round(turn.length_m, 3)}
            features.append(_feature(shapely.LineString(_degrees(frame, turns_m[order])), properties))
    return features


def _computed_corner(features: list[dict[str, Any]]) -> int | None:
    """Index of the computed corner, stored as a feature for map programs and older readers; ``None`` without one."""
    found = [each["properties"]["corner"] for each in features if each["properties"].get("kind") == _COMPUTED]
    return int(found[0]) - 1 if found else None


def _feature(shape: Any, properties: dict[str, Any]) -> dict[str, Any]:
    return {"type": "Feature", "geometry": geometry(shape), "properties": properties}


def _degrees(frame: LocalFrame, points_m: Float[np.ndarray, "point 2"]) -> Float[np.ndarray, "point 2"]:
    """Longitude and latitude of places on the plan's level, across the antimeridian without a jump."""
    latitude, longitude, _ = frame.to_geodetic(points_m[:, 0], points_m[:, 1], np.zeros(len(points_m)))
    return np.stack([continuous(longitude, frame.longitude_deg), latitude], axis=1)


# Work of earlier runs: place, worked stretches and the worked map, one file in a run's folder.

_TAKEN_UP_VERSION = 1


class TakenUp(NamedTuple):
    """Work of earlier runs by a plan.

    Attributes:
        plan_sha256: SHA-256 of the plan.
        resumption: place of resumption, and worked stretches beyond it.
        grid: grid of the map.
        probability: probability of each cell, by the best pass of any run.
        runs: UUID and number of moments, ``UUID:MOMENTS``, of the runs included; files of older programs have the UUID
            alone.
        shared_sigma_m: standard deviation per axis of the shared error used for the map; NaN if a file of an older
            program does not state it.
    """

    plan_sha256: str
    resumption: Resumption
    grid: CellGrid
    probability: Float[np.ndarray, "north east"]
    runs: tuple[str, ...]
    shared_sigma_m: float


def write_taken_up(path: Path, held: TakenUp) -> None:
    """Write the file atomically.

    Raises:
        InputError: the file cannot be written.
    """
    head = {
        "version": _TAKEN_UP_VERSION,
        "plan_sha256": held.plan_sha256,
        "line": held.resumption.place.line,
        "along_m": held.resumption.place.along_m,
        "worked": [list(each) for each in held.resumption.worked],
        "grid": asdict(held.grid),
        "runs": list(held.runs),
        "shared_sigma_m": held.shared_sigma_m,
    }
    with atomic_output(path, force=True) as temporary, temporary.open("wb") as file:
        np.savez_compressed(file, head=np.array(json.dumps(head)), probability=held.probability.astype(np.float32))


def read_taken_up(path: Path) -> TakenUp:
    """Read it.

    Raises:
        InputError: missing, damaged, or of another version.
    """
    try:
        # NumPy leaves a damaged file open that it is given by name.
        with path.open("rb") as opened, np.load(opened, allow_pickle=False) as file:
            head: dict[str, Any] = json.loads(str(file["head"]))
            probability = np.asarray(file["probability"], np.float32)
        if head["version"] != _TAKEN_UP_VERSION:
            raise InputError(path, "version", str(_TAKEN_UP_VERSION), str(head["version"]))
        grid = CellGrid(**head["grid"])
        worked = tuple(WorkedStretch(int(line), float(low), float(high)) for line, low, high in head["worked"])
        place = RoutePlace(int(head["line"]), float(head["along_m"]))
        shared_m = float(head.get("shared_sigma_m", "nan"))
        runs = tuple(head["runs"])
        held = TakenUp(str(head["plan_sha256"]), Resumption(place, worked), grid, probability, runs, shared_m)
    except FileNotFoundError:
        raise InputError(path, "file", "the worked area of earlier runs", "no such file") from None
    except (OSError, ValueError, KeyError, TypeError, zipfile.BadZipFile, EOFError) as error:
        raise InputError(
            path, "file", "the worked area of earlier runs, written by run --resume", repr(error)
        ) from None
    if held.probability.shape != held.grid.shape:
        raise InputError(path, "probability", f"{held.grid.shape} cells", f"{held.probability.shape}")
    return held
