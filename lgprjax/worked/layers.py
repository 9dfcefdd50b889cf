"""Layers and figures of a worked record for GIS programs and reports."""

import json
import math
from collections.abc import Iterable, Sequence
from datetime import datetime, timedelta
from typing import Any, NamedTuple

import numpy as np
import shapely
from jaxtyping import Bool, Float

from lgprjax.coverage import CellGrid, CellState, Field, cell_states, inside_cells
from lgprjax.coverage.field import HIGHEST_LEVEL
from lgprjax.errors import ArgumentError
from lgprjax.formats.geometries import continuous
from lgprjax.formats.worked import FULL, GeoLayer, WorkedRecord, stop_words

METHOD = "mechanical: one pass of a machine, recorded by GNSS and INS"
_CART = "a cart, recorded by GNSS only; tool operation was not measured"
STATUS = "processed by machine; not searched, not released"
_QUALITY = {0: "none", 1: "single", 2: "float", 3: "fixed"}
_NO_AREA_M2 = 1e-9


def evidence_of(record: WorkedRecord) -> dict[str, Any]:
    """Evidence in the provenance of a record; empty for older records."""
    told = record.provenance.get("evidence", {})
    return told if isinstance(told, dict) else {}


def told_of_work(record: WorkedRecord) -> dict[str, str]:
    """Task, hazard area, machine and operator, as far as they are known."""
    told = evidence_of(record)
    return {name: str(told[name]) for name in ("task", "hazard_area", "machine", "operator") if told.get(name)}


_DRIVEN = {3: "by the computer", 4: "by the computer"}
_BY_HAND = "by hand or remote control"


def driver_of_pass(record: WorkedRecord, number: int) -> str:
    """Driver of a pass; all its moments have one mode."""
    channels, passes = record.channels, record.passes
    of_run = channels.run == passes.run[number]
    near = np.flatnonzero(of_run)[int(np.argmin(np.abs(channels.time_s[of_run] - passes.begin_s[number])))]
    return _DRIVEN.get(int(channels.mode[near]), _BY_HAND)


def way_by_driver(record: WorkedRecord) -> dict[str, float]:
    """Total length of the passes of each driver, m."""
    found: dict[str, float] = {}
    for number, length_m in enumerate(record.passes.length_m):
        words = driver_of_pass(record, number)
        found[words] = found.get(words, 0.0) + float(length_m)
    return found


def tool_measured(record: WorkedRecord) -> bool:
    """Whether the operation of the tool was measured in all runs."""
    return all("tool" not in run for run in record.provenance["runs"])


def method_of(record: WorkedRecord) -> str:
    """Description of how the ground was worked and recorded."""
    carts = ["tool" in run for run in record.provenance["runs"]]
    return "; ".join([*([METHOD] if not all(carts) else []), *([_CART] if any(carts) else [])])


def layer_name(level: float) -> str:
    """Name of the layer of processed ground: ``processed_p95``, ``processed_p996``."""
    return f"processed_p{100.0 * level:g}".replace(".", "")


def checked_levels(confidence: Sequence[float]) -> tuple[float, ...]:
    """Levels of confidence for the layers of a record, in rising order.

    Raises:
        ArgumentError: there is no level, one is out of range, or two would give layers of the same name.
    """
    levels = tuple(sorted(confidence))
    names = {layer_name(level) for level in levels}
    possible = all(0.5 < level <= HIGHEST_LEVEL for level in levels)
    if levels and possible and len(names) == len(levels):
        return levels
    found = ", ".join(f"{level:g}" for level in levels) or "none"
    raise ArgumentError("confidence", f"different levels above 0.5, {HIGHEST_LEVEL:g} at most", found)


def at_levels(record: WorkedRecord, levels: Sequence[float]) -> WorkedRecord:
    """The record with its cells classified at other levels; cells keep their probabilities, so any level is possible.

    Args:
        record: record to classify.
        levels: levels from ``checked_levels``.
    """
    cells = record.cells
    states = [cell_states(cells.probability / FULL, level) for level in levels]
    return record._replace(cells=cells._replace(level=np.array(levels), state=np.stack(states)))


def cover_layers(record: WorkedRecord, organisation: str) -> tuple[GeoLayer, ...]:
    """Layers of a record, in degrees of longitude and latitude.

    Processed ground is the union of the cells that are processed at a level, clipped to the perimeter; it contains no
    other ground. Gaps are the field minus the processed ground of the lowest level, one shape per area.

    Args:
        record: record to export.
        organisation: responsible organisation, stored with every shape.
    """
    field = shapely.Polygon(record.perimeter_m)
    shapely.prepare(field)
    told = told_of_work(record)
    common = {"organisation": organisation, "method": method_of(record), "status": STATUS, **told, **_dates(record)}
    layers = [_perimeter(record, field, common), _swaths(record, common)]
    levels = list(zip(record.cells.level.tolist(), record.cells.state, strict=True))
    for level, state in levels:
        ground = _polygons(shapely.intersection(cells_union(record, state == CellState.PROCESSED), field))
        properties = {**common, "state": "processed", "level": level}
        layers.append(_areas(record, layer_name(level), [(each, properties) for each in ground]))
    layers.append(_gaps(record, field, levels[0], common))
    layers += [_stops(record, common), _events(record, common), _finds(record, common)]
    return tuple(layers)


def cells_union(record: WorkedRecord, chosen: Bool[np.ndarray, "north east"]) -> Any:
    """The area of chosen cells as one exact shape, with corners at corners of cells.

    Args:
        record: record with the cells.
        chosen: mask of the chosen cells.
    """
    cells = record.cells
    faces = shapely.get_parts(shapely.polygonize(shapely.linestrings(_edges(chosen))))
    # Holes are faces too: a face is ground if the cell at a point inside it is chosen.
    inner = shapely.point_on_surface(faces)
    column, row = (np.floor(get(inner)).astype(np.int64) for get in (shapely.get_x, shapely.get_y))
    ground = shapely.multipolygons(faces[chosen[row, column]])
    corner = np.array([cells.east_m, cells.north_m])
    # Coordinates in whole cells are exact; they are converted to metres last.
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
        # Edges of one line are in order: the n-th start of an edge belongs to the n-th end.
        line, first = np.nonzero(edges & corners[:, :-1])
        last = np.nonzero(edges & corners[:, 1:])[1] + 1
        ends = np.stack([np.stack([line, first], axis=1), np.stack([line, last], axis=1)], axis=1)
        parts.append(ends[..., list(order)])
    return np.concatenate(parts).astype(np.float64)


def _perimeter(record: WorkedRecord, field: Any, common: dict[str, Any]) -> GeoLayer:
    properties = {**common, "name": record.name, "corners": len(record.perimeter_m), "length_m": round(field.length, 2)}
    return _areas(record, "perimeter", [(field, properties)])


def _swaths(record: WorkedRecord, common: dict[str, Any]) -> GeoLayer:
    passes, swaths = record.passes, record.swaths
    rows = []
    for number in range(len(passes.run)):
        of = swaths.number == number
        way = np.stack([swaths.east_m[of], swaths.north_m[of]], axis=1)
        figures = {
            name: _rounded(float(getattr(passes, name)[number]))
            for name in passes._fields
            if name not in ("run", "line", "begin_s", "end_s")
        }
        times = {name: utc_of(record, float(getattr(passes, f"{name}_s")[number])) for name in ("begin", "end")}
        own = {"pass": number + 1, "run": _run(record, passes.run[number]), "line": int(passes.line[number]) + 1}
        own["driven"] = driver_of_pass(record, number)
        rows.append(
            (
                shapely.LineString(way if len(way) > 1 else np.repeat(way, 2, axis=0)),
                {**common, **own, **times, **figures},
            )
        )
    return _layer(record, "swaths", "LineString", rows)


def _rounded(value: float) -> float | None:
    """The rounded value; ``None`` for unmeasured values such as a cart's depth, because JSON has no NaN."""
    return round(value, 3) if math.isfinite(value) else None


def _gaps(record: WorkedRecord, field: Any, lowest: tuple[float, np.ndarray], common: dict[str, Any]) -> GeoLayer:
    """The field minus the processed ground of the lowest level: uncertain ground, and the rest."""
    level, state = lowest
    processed = cells_union(record, state == CellState.PROCESSED)
    left = shapely.difference(field, processed)
    doubtful = shapely.intersection(left, cells_union(record, state == CellState.UNCERTAIN))
    parts = (("uncertain", doubtful), ("not processed", shapely.difference(left, doubtful)))
    rows = [(each, {**common, "state": word, "level": level}) for word, shape in parts for each in _polygons(shape)]
    return _areas(record, "gaps", rows)


def _stops(record: WorkedRecord, common: dict[str, Any]) -> GeoLayer:
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
    return _layer(record, "stops", "Point", rows)


def _events(record: WorkedRecord, common: dict[str, Any]) -> GeoLayer:
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
    return _layer(record, "events", "Point", rows)


def _finds(record: WorkedRecord, common: dict[str, Any]) -> GeoLayer:
    """Finds and detonations at their reported positions."""
    found = evidence_of(record).get("find", [])
    shapes = tuple(shapely.Point(float(each["longitude_deg"]), float(each["latitude_deg"])) for each in found)
    rows = tuple(
        {**common, "kind": str(each["kind"]), "time": str(each["time_utc"]), "note": str(each["note"])}
        for each in found
    )
    return GeoLayer("finds", "Point", shapes, rows)


def _areas(record: WorkedRecord, name: str, rows: Iterable[tuple[Any, dict[str, Any]]]) -> GeoLayer:
    measured = [(shape, {**properties, "area_m2": round(shape.area, 4)}) for shape, properties in rows]
    return _layer(record, name, "Polygon", measured)


def _layer(record: WorkedRecord, name: str, kind: str, rows: list[tuple[Any, dict[str, Any]]]) -> GeoLayer:
    def to_degrees(places: Float[np.ndarray, "place 2"]) -> Float[np.ndarray, "place 2"]:
        latitude, longitude, _ = record.frame.to_geodetic(places[:, 0], places[:, 1], np.zeros(len(places)))
        return np.stack([continuous(longitude, record.frame.longitude_deg), latitude], axis=1)

    shapes = [shapely.transform(shape, to_degrees) for shape, _ in rows]
    if kind == "Polygon":
        shapes = [shapely.geometry.polygon.orient(shape, 1.0) for shape in shapes]
    return GeoLayer(name, kind, tuple(shapes), tuple(properties for _, properties in rows))


def _polygons(shape: Any) -> list[Any]:
    """Polygons of a shape; lines and points left over by clipping have no area."""
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
    """An event as short text: names and values of its JSON."""
    event = json.loads(line)
    return ", ".join(f"{name} {value}" for name, value in event.items()) if isinstance(event, dict) else str(event)


# Figures of a record of a worked field, and the statement that they support.

PAC = 0.95
"""Probability with which the statement about a layer must hold."""


class LayerFigures(NamedTuple):
    """Figures of a layer at one level; areas count cells whose centre is inside the perimeter.

    Attributes:
        level: least probability of each processed cell.
        processed_m2, uncertain_m2, not_processed_m2: areas.
        share: processed share of the field.
        mean_miss: mean probability over the processed cells that the best pass missed the cell.
        worked_share: with probability ``PAC`` or more, at least this share of the processed area was worked.
        measured: whether the operation of the tool was measured in all runs.
    """

    level: float
    processed_m2: float
    uncertain_m2: float
    not_processed_m2: float
    share: float
    mean_miss: float
    worked_share: float
    measured: bool = True

    @property
    def sentence(self) -> str:
        """Statement about the layer, valid if the onboard filter's errors were as estimated."""
        if self.processed_m2 == 0.0:
            return f"No cell is processed at {100.0 * self.level:g} %."
        tool = "working tool" if self.measured else "tool (operation not measured)"
        return (
            f"The {tool} passed each cell of an area of {square_metres(self.processed_m2)}, {percent(self.share)} of "
            f"the field, with probability {100.0 * self.level:g} % or more. With probability {100.0 * PAC:g} % or "
            f"more, it passed at least {percent(self.worked_share)} of that area."
        )


class CoverFigures(NamedTuple):
    """Figures of a record.

    Attributes:
        area_m2: area of the field.
        layers: figures per level, in rising order.
        passes, way_m: number and total length of the passes.
        depth_mean_m, depth_least_m: mean and least tool depth while cells counted; ``None`` if not measured.
        stops: number of stops by reason.
        hours: time from the first to the last moment.
        moments: number of moments, ten per second.
        fixed: share of moments with a fixed GNSS position.
    """

    area_m2: float
    layers: tuple[LayerFigures, ...]
    passes: int
    way_m: float
    depth_mean_m: float | None
    depth_least_m: float | None
    stops: dict[str, int]
    hours: float
    moments: int
    fixed: float

    def as_json(self) -> dict[str, object]:
        """The figures as JSON."""
        layers = [{**layer._asdict(), "sentence": layer.sentence} for layer in self.layers]
        return {**self._asdict(), "layers": layers, "pac": PAC}


def cover_figures(record: WorkedRecord) -> CoverFigures:
    """Figures of a record."""
    cells, channels, passes = record.cells, record.channels, record.passes
    inside = inside_of(record)
    reasons = [stop_words(int(each)) for each in record.stops.reasons]
    deep = np.isfinite(passes.depth_mean_m)
    known = bool(deep.any())
    weight = passes.length_m[deep] if known and passes.length_m[deep].sum() > 0.0 else np.ones(np.count_nonzero(deep))
    return CoverFigures(
        area_m2=Field(record.perimeter_m).area_m2,
        layers=tuple(
            _figures_layer(record, float(level), state[inside], inside)
            for level, state in zip(cells.level, cells.state, strict=True)
        ),
        passes=len(passes.run),
        way_m=float(passes.length_m.sum()),
        depth_mean_m=float(np.average(passes.depth_mean_m[deep], weights=weight)) if known else None,
        depth_least_m=float(passes.depth_least_m[deep].min()) if known else None,
        stops={reason: reasons.count(reason) for reason in sorted(set(reasons))},
        hours=float(channels.time_s.max() - channels.time_s.min()) / 3600.0,
        moments=len(channels.time_s),
        fixed=float(np.mean(channels.gnss_quality == 3)),
    )


def grid_of(record: WorkedRecord) -> CellGrid:
    """The grid of a record's cells."""
    cells = record.cells
    return CellGrid(cells.east_m, cells.north_m, cells.cell_m, *cells.probability.shape)


def inside_of(record: WorkedRecord) -> Bool[np.ndarray, "north east"]:
    """Mask of cells whose centre is inside the perimeter."""
    return inside_cells(Field(record.perimeter_m), grid_of(record))


def square_metres(area_m2: float) -> str:
    """An area, rounded down to a tenth of a square metre."""
    return f"{math.floor(10.0 * area_m2 + 1e-6) / 10.0:.1f} m²"


def percent(share: float) -> str:
    """A share in per cent, rounded down to two decimals."""
    return f"{math.floor(1e4 * share + 1e-9) / 100.0:.2f} %"


def _figures_layer(
    record: WorkedRecord, level: float, state: np.ndarray, inside: Bool[np.ndarray, "north east"]
) -> LayerFigures:
    cell_m2 = record.cells.cell_m**2
    counts = {each: int(np.count_nonzero(state == each)) for each in CellState}
    processed = counts[CellState.PROCESSED]
    miss = _misses(record.cells.probability[inside][state == CellState.PROCESSED])
    mean_miss = float(miss.mean()) if processed else 1.0
    # Markov: whatever the correlation between the errors of cells, P(missed share > d) <= E[missed share] / d.
    worked = max(1.0 - mean_miss / (1.0 - PAC), 0.0)
    return LayerFigures(
        level=level,
        processed_m2=processed * cell_m2,
        uncertain_m2=counts[CellState.UNCERTAIN] * cell_m2,
        not_processed_m2=counts[CellState.NOT_PROCESSED] * cell_m2,
        share=processed / max(len(state), 1),
        mean_miss=mean_miss,
        worked_share=worked,
        measured=tool_measured(record),
    )


def _misses(numbers: np.ndarray) -> Float[np.ndarray, " cell"]:
    return np.asarray(1.0 - numbers.astype(np.float64) / FULL)
