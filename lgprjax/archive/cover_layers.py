"""A record of a worked field as layers of shapes: perimeter, swaths, processed ground, gaps, stops, events.

Needs the optional package shapely (``pip install lgprjax[gis]``).
"""

import json
from collections.abc import Iterable
from datetime import datetime, timedelta
from typing import Any

import numpy as np
from jaxtyping import Bool, Float

from lgprjax.coverage import CellState
from lgprjax.errors import InputError
from lgprjax.formats.geo_layers import GeoLayer
from lgprjax.formats.worked_record import WorkedRecord, stop_words

METHOD = "mechanical: one pass of a machine, recorded by GNSS and INS"
STATUS = "processed by machine; not searched, not released"
_QUALITY = {0: "none", 1: "single", 2: "float", 3: "fixed"}
_NO_AREA_M2 = 1e-9


def layer_name(level: float) -> str:
    """Name of the layer of processed ground: ``processed_p95``, ``processed_p996``."""
    return f"processed_p{100.0 * level:g}".replace(".", "")


def cover_layers(record: WorkedRecord, organisation: str) -> tuple[GeoLayer, ...]:
    """Layers of a record, in degrees of longitude and latitude.

    Processed ground is the union of the cells that are processed at a level, cut at the perimeter: it never holds
    ground that no such cell covers. Gaps are the field without the processed ground of the lowest level, area by area.

    Args:
        record: to be shown.
        organisation: that is responsible, as every shape carries it.

    Raises:
        InputError: shapely is missing.
    """
    shapely = require_shapely()
    field = shapely.Polygon(record.perimeter_m)
    shapely.prepare(field)
    common = {"organisation": organisation, "method": METHOD, "status": STATUS, **_dates(record)}
    layers = [_perimeter(shapely, record, field, common), _swaths(shapely, record, common)]
    levels = list(zip(record.cells.level.tolist(), record.cells.state, strict=True))
    for level, state in levels:
        ground = _polygons(shapely, shapely.intersection(cells_union(record, state == CellState.PROCESSED), field))
        properties = {**common, "state": "processed", "level": level}
        layers.append(_areas(shapely, record, layer_name(level), [(each, properties) for each in ground]))
    layers.append(_gaps(shapely, record, field, levels[0], common))
    layers += [_stops(shapely, record, common), _events(shapely, record, common)]
    return tuple(layers)


def require_shapely() -> Any:
    """The package.

    Raises:
        InputError: it is missing.
    """
    try:
        import shapely
    except ImportError:
        raise InputError(
            "shapely", "export", "the optional package shapely (pip install lgprjax[gis])", "none"
        ) from None
    return shapely


def cells_union(record: WorkedRecord, chosen: Bool[np.ndarray, "north east"]) -> Any:
    """The ground of chosen cells as one shape, exact: its corners are corners of cells.

    Args:
        record: whose cells they are.
        chosen: which of them.
    """
    shapely = require_shapely()
    cells = record.cells
    faces = shapely.get_parts(shapely.polygonize(shapely.linestrings(_edges(chosen))))
    # Holes come as faces too: what is ground is told by the cell that a face has somewhere in it.
    inner = shapely.point_on_surface(faces)
    column, row = (np.floor(get(inner)).astype(np.int64) for get in (shapely.get_x, shapely.get_y))
    ground = shapely.multipolygons(faces[chosen[row, column]])
    corner = np.array([cells.east_m, cells.north_m])
    # In whole cells the ground is exact; metres come last.
    return shapely.transform(ground, lambda places: corner + cells.cell_m * places)


def _edges(chosen: Bool[np.ndarray, "north east"]) -> Float[np.ndarray, "edge 2 2"]:
    """Straight edges between chosen cells and others, from crossing to crossing of the grid's lines, in whole cells."""
    padded = np.pad(chosen, 1)
    level = padded[1:, 1:-1] != padded[:-1, 1:-1]
    upright = padded[1:-1, 1:] != padded[1:-1, :-1]
    meet = np.pad(level, ((0, 0), (0, 1))) | np.pad(level, ((0, 0), (1, 0)))
    meet &= np.pad(upright, ((0, 1), (0, 0))) | np.pad(upright, ((1, 0), (0, 0)))
    parts = []
    for edges, corners, order in ((level, meet, (1, 0)), (upright.T, meet.T, (0, 1))):
        # Edges of one line follow each other: the n-th that begins at a corner is ended by the n-th that ends at one.
        line, first = np.nonzero(edges & corners[:, :-1])
        last = np.nonzero(edges & corners[:, 1:])[1] + 1
        ends = np.stack([np.stack([line, first], axis=1), np.stack([line, last], axis=1)], axis=1)
        parts.append(ends[..., list(order)])
    return np.concatenate(parts).astype(np.float64)


def _perimeter(shapely: Any, record: WorkedRecord, field: Any, common: dict[str, Any]) -> GeoLayer:
    properties = {**common, "name": record.name, "corners": len(record.perimeter_m), "length_m": round(field.length, 2)}
    return _areas(shapely, record, "perimeter", [(field, properties)])


def _swaths(shapely: Any, record: WorkedRecord, common: dict[str, Any]) -> GeoLayer:
    passes, swaths = record.passes, record.swaths
    rows = []
    for number in range(len(passes.run)):
        of = swaths.number == number
        way = np.stack([swaths.east_m[of], swaths.north_m[of]], axis=1)
        figures = {
            name: round(float(getattr(passes, name)[number]), 3)
            for name in passes._fields
            if name not in ("run", "line", "begin_s", "end_s")
        }
        times = {name: utc_of(record, float(getattr(passes, f"{name}_s")[number])) for name in ("begin", "end")}
        own = {"pass": number + 1, "run": _run(record, passes.run[number]), "line": int(passes.line[number]) + 1}
        rows.append(
            (
                shapely.LineString(way if len(way) > 1 else np.repeat(way, 2, axis=0)),
                {**common, **own, **times, **figures},
            )
        )
    return _layer(shapely, record, "swaths", "LineString", rows)


def _gaps(
    shapely: Any, record: WorkedRecord, field: Any, lowest: tuple[float, np.ndarray], common: dict[str, Any]
) -> GeoLayer:
    """The field without what is processed at the lowest level: what is uncertain, and all else."""
    level, state = lowest
    processed = cells_union(record, state == CellState.PROCESSED)
    left = shapely.difference(field, processed)
    doubtful = shapely.intersection(left, cells_union(record, state == CellState.UNCERTAIN))
    parts = (("uncertain", doubtful), ("not processed", shapely.difference(left, doubtful)))
    rows = [
        (each, {**common, "state": word, "level": level}) for word, shape in parts for each in _polygons(shapely, shape)
    ]
    return _areas(shapely, record, "gaps", rows)


def _stops(shapely: Any, record: WorkedRecord, common: dict[str, Any]) -> GeoLayer:
    stops = record.stops
    rows = []
    for number in np.flatnonzero(np.isfinite(stops.east_m) & np.isfinite(stops.north_m)):
        begin_s, end_s = float(stops.begin_s[number]), float(stops.end_s[number])
        own = {
            "run": _run(record, stops.run[number]),
            "begin": utc_of(record, begin_s),
            "end": utc_of(record, end_s),
            "duration_s": round(end_s - begin_s, 1),
            "reasons": stop_words(int(stops.reasons[number])),
        }
        rows.append((shapely.Point(stops.east_m[number], stops.north_m[number]), {**common, **own}))
    return _layer(shapely, record, "stops", "Point", rows)


def _events(shapely: Any, record: WorkedRecord, common: dict[str, Any]) -> GeoLayer:
    events, channels = record.events, record.channels
    rows = []
    for number in np.flatnonzero(np.isfinite(events.east_m) & np.isfinite(events.north_m)):
        time_s = float(events.time_s[number])
        near = int(np.argmin(np.abs(channels.time_s - time_s)))
        quality = _QUALITY.get(int(channels.gnss_quality[near]), "unknown")
        own = {"run": _run(record, events.run[number]), "time": utc_of(record, time_s), "gnss": quality}
        rows.append(
            (
                shapely.Point(events.east_m[number], events.north_m[number]),
                {**common, **own, "text": _text(events.text[number])},
            )
        )
    return _layer(shapely, record, "events", "Point", rows)


def _areas(shapely: Any, record: WorkedRecord, name: str, rows: Iterable[tuple[Any, dict[str, Any]]]) -> GeoLayer:
    measured = [(shape, {**properties, "area_m2": round(shape.area, 4)}) for shape, properties in rows]
    return _layer(shapely, record, name, "Polygon", measured)


def _layer(
    shapely: Any, record: WorkedRecord, name: str, kind: str, rows: list[tuple[Any, dict[str, Any]]]
) -> GeoLayer:
    def to_degrees(places: Float[np.ndarray, "place 2"]) -> Float[np.ndarray, "place 2"]:
        latitude, longitude, _ = record.frame.to_geodetic(places[:, 0], places[:, 1], np.zeros(len(places)))
        return np.stack([longitude, latitude], axis=1)

    shapes = [shapely.transform(shape, to_degrees) for shape, _ in rows]
    if kind == "Polygon":
        shapes = [shapely.geometry.polygon.orient(shape, 1.0) for shape in shapes]
    return GeoLayer(name, kind, tuple(shapes), tuple(properties for _, properties in rows))


def _polygons(shapely: Any, shape: Any) -> list[Any]:
    """Polygons of a shape; lines and points that cutting leaves behind have no area."""
    parts = shapely.get_parts(shape)
    inner = [each for part in parts for each in shapely.get_parts(part)]
    return [each for each in inner if each.geom_type == "Polygon" and each.area > _NO_AREA_M2]


def _run(record: WorkedRecord, number: Any) -> str:
    return str(record.provenance["runs"][int(number)]["folder"])


def utc_of(record: WorkedRecord, time_s: float) -> str:
    """A time of a record as UTC, ISO 8601."""
    return (datetime.fromisoformat(record.t0_utc) + timedelta(seconds=time_s)).isoformat(timespec="milliseconds")


def _dates(record: WorkedRecord) -> dict[str, str]:
    time_s = record.channels.time_s
    return {"date_start": utc_of(record, float(time_s.min())), "date_end": utc_of(record, float(time_s.max()))}


def _text(line: str) -> str:
    """An event in a few words: names and values of its JSON."""
    told = json.loads(line)
    return ", ".join(f"{name} {value}" for name, value in told.items()) if isinstance(told, dict) else str(told)
