"""The record of a worked field ``X.worked.h5``: written at once, read and validated against
``data_schema/worked.toml``.
"""

import csv
import json
import math
import tempfile
import zipfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple, TypeVar
from xml.etree import ElementTree

import h5py
import numpy as np
import shapely
from jaxtyping import Float, Float32, Int32, UInt8, UInt16, UInt32

from lgprjax.coverage import Tool
from lgprjax.errors import InputError
from lgprjax.formats.geometries import DECIMALS, cut, geometry
from lgprjax.formats.schema import load_schema
from lgprjax.formats.store import (
    atomic_output,
    attribute_of,
    create_store,
    open_store,
    reading,
    validate_store,
    write_array,
    write_attribute,
)
from lgprjax.frames import LocalFrame

# Contents of the record of a worked field: cells, measurements over time, passes, stops, events.

FULL = 65535
"""The stored number of probability 1."""


class WorkedCells(NamedTuple):
    """Ground cells, row 0 southmost.

    Attributes:
        east_m, north_m: south-west corner of the grid.
        cell_m: side of a cell.
        probability: probability that a cell was worked in its best pass, rounded down to 1/``FULL``.
        level: confidence levels, rising.
        state: ``coverage.CellState`` of each cell at each level.
    """

    east_m: float
    north_m: float
    cell_m: float
    probability: UInt16[np.ndarray, "north east"]
    level: Float[np.ndarray, " level"]
    state: UInt8[np.ndarray, "level north east"]


class CoverChannels(NamedTuple):
    """Moments, ten per second, run after run; names and units as in ``cover`` of ``data_schema/run_log.toml``.

    Attributes:
        time_s: time since the record's ``t0_utc``; rises within a run.
        run: number of the run.
    """

    time_s: Float[np.ndarray, " moment"]
    run: UInt16[np.ndarray, " moment"]
    x_m: Float[np.ndarray, " moment"]
    y_m: Float[np.ndarray, " moment"]
    yaw_rad: Float[np.ndarray, " moment"]
    covariance: Float32[np.ndarray, "moment 3 3"]
    speed_mps: Float32[np.ndarray, " moment"]
    left_mps: Float32[np.ndarray, " moment"]
    right_mps: Float32[np.ndarray, " moment"]
    tool: UInt8[np.ndarray, " moment"]
    depth_m: Float32[np.ndarray, " moment"]
    mode: UInt8[np.ndarray, " moment"]
    line: Int32[np.ndarray, " moment"]
    stop: UInt16[np.ndarray, " moment"]
    gnss_quality: UInt8[np.ndarray, " moment"]


class CoverPasses(NamedTuple):
    """Stretches of one swath over which cells counted. Times since ``t0_utc``; depth and speed as measured."""

    run: UInt16[np.ndarray, " pass"]
    line: Int32[np.ndarray, " pass"]
    begin_s: Float[np.ndarray, " pass"]
    end_s: Float[np.ndarray, " pass"]
    length_m: Float[np.ndarray, " pass"]
    width_m: Float[np.ndarray, " pass"]
    depth_mean_m: Float[np.ndarray, " pass"]
    depth_least_m: Float[np.ndarray, " pass"]
    speed_mean_mps: Float[np.ndarray, " pass"]
    speed_largest_mps: Float[np.ndarray, " pass"]


class CoverSwaths(NamedTuple):
    """Tracks of the tool's centre, pass after pass: ``number`` is that of the pass."""

    number: UInt32[np.ndarray, " point"]
    east_m: Float[np.ndarray, " point"]
    north_m: Float[np.ndarray, " point"]


class CoverStops(NamedTuple):
    """Stretches of time with a reason to stop; the place is that of its beginning, NaN if unknown."""

    run: UInt16[np.ndarray, " stop"]
    begin_s: Float[np.ndarray, " stop"]
    end_s: Float[np.ndarray, " stop"]
    east_m: Float[np.ndarray, " stop"]
    north_m: Float[np.ndarray, " stop"]
    reasons: UInt16[np.ndarray, " stop"]


class CoverEvents(NamedTuple):
    """Events of the programs on board, each as one line of JSON."""

    run: UInt16[np.ndarray, " event"]
    time_s: Float[np.ndarray, " event"]
    east_m: Float[np.ndarray, " event"]
    north_m: Float[np.ndarray, " event"]
    text: tuple[str, ...]


class WorkedRecord(NamedTuple):
    """The record of a worked field.

    Attributes:
        name: name of the field.
        frame: local frame at the plan's anchor.
        perimeter_m: corners, counter-clockwise.
        tool: tool that worked.
        t0_utc: origin of times, ISO 8601.
        cells, channels, passes, swaths, stops, events: contents.
        provenance: program and inputs with their SHA-256.
    """

    name: str
    frame: LocalFrame
    perimeter_m: Float[np.ndarray, "corner 2"]
    tool: Tool
    t0_utc: str
    cells: WorkedCells
    channels: CoverChannels
    passes: CoverPasses
    swaths: CoverSwaths
    stops: CoverStops
    events: CoverEvents
    provenance: dict[str, Any]


_STOPS = {
    1: "operator or remote link",
    2: "predicted crossing of the field edge",
    4: "tool off or at a wrong depth",
    8: "position too uncertain",
    16: "heading not known",
    32: "wheels or their sensors",
    64: "box or its connection",
    128: "computer",
    256: "recording",
    512: "off the line",
}


def stop_words(reasons: int) -> str:
    """Why a vehicle stopped, in words, from the bits of ``data_schema/run_log.toml``."""
    known = [words for bit, words in _STOPS.items() if reasons & bit]
    rest = reasons & ~sum(_STOPS)
    return ", ".join([*known, *([f"reason {rest:#x}"] if rest else [])]) or "none"


_SCHEMA = load_schema("worked")
_PLACED = ("run", "time_s", "east_m", "north_m")
_Table = TypeVar("_Table", CoverChannels, CoverPasses, CoverStops)


def write_worked(path: str | Path, record: WorkedRecord, *, force: bool = False) -> None:
    """Write a record.

    Raises:
        InputError: something in it does not match the schema, or the output exists (without ``force``) or cannot be
            written. Nothing is left behind then.
    """
    cells, frame = record.cells, record.frame
    attributes: dict[str, str | float] = {
        "name": record.name,
        "provenance": json.dumps(record.provenance),
        "t0_utc": record.t0_utc,
        "anchor_latitude_deg": frame.latitude_deg,
        "anchor_longitude_deg": frame.longitude_deg,
        "anchor_height_m": frame.height_m,
        "cell_m": cells.cell_m,
        "east_m": cells.east_m,
        "north_m": cells.north_m,
        **{f"tool_{name}": value for name, value in record.tool._asdict().items()},
    }
    events = record.events
    arrays: dict[str, np.ndarray] = {
        "/field/perimeter_m": record.perimeter_m,
        "/cells/probability": cells.probability,
        "/cells/level": cells.level,
        "/cells/state": cells.state,
        "/swaths/pass": record.swaths.number,
        "/swaths/east_m": record.swaths.east_m,
        "/swaths/north_m": record.swaths.north_m,
        **{f"/events/{name}": getattr(events, name) for name in _PLACED},
        "/events/text": np.frombuffer("".join(f"{line}\n" for line in events.text).encode(), np.uint8),
    }
    for group, table in (("time", record.channels), ("passes", record.passes), ("stops", record.stops)):
        arrays |= {f"/{group}/{name}": values for name, values in table._asdict().items()}
    with create_store(path, _SCHEMA, force) as (store, _):
        for name, value in attributes.items():
            write_attribute(store, name, value)
        for each in _SCHEMA.groups:
            store.create_group(each.path)
        for place, values in arrays.items():
            write_array(store, _SCHEMA, place, values)
        for finding in validate_store(store, path, _SCHEMA, bulk=True):
            if finding.severity == "error":
                raise finding.error()


def read_worked(path: str | Path) -> WorkedRecord:
    """A record from its file.

    Raises:
        InputError: the file is missing, damaged, of another format or of a newer major version; something in it is not
            as the schema says.
    """
    file = Path(path)
    with open_store(file) as store:
        for finding in validate_store(store, file, _SCHEMA):
            if finding.severity == "error":
                raise finding.error()
        with reading(file, "contents"):
            return _record(store, file)


def _record(store: h5py.File, file: Path) -> WorkedRecord:
    text = store["events/text"][()].tobytes().decode("utf-8", "replace").split("\n")[:-1]
    events = len(store["events/run"])
    if len(text) != events:
        raise InputError(file, "/events/text", f"{events} lines, one an event", str(len(text)))
    runs = np.concatenate([store[f"{group}/run"][()] for group in ("time", "passes", "stops", "events")])
    provenance: dict[str, Any] = json.loads(str(attribute_of(store, "provenance")))
    told = provenance.get("runs")
    if not isinstance(told, list) or (len(runs) and runs.max() >= len(told)):
        found = len(told) if isinstance(told, list) else "none"
        raise InputError(file, "/@provenance", "every run that the record names", f"{found}")
    return WorkedRecord(
        name=str(attribute_of(store, "name")),
        frame=LocalFrame(*(_number(store, f"anchor_{name}") for name in ("latitude_deg", "longitude_deg", "height_m"))),
        perimeter_m=store["field/perimeter_m"][()],
        tool=Tool(*(_number(store, f"tool_{name}") for name in Tool._fields)),
        t0_utc=str(attribute_of(store, "t0_utc")),
        cells=WorkedCells(
            east_m=_number(store, "east_m"),
            north_m=_number(store, "north_m"),
            cell_m=_number(store, "cell_m"),
            probability=store["cells/probability"][()],
            level=store["cells/level"][()],
            state=store["cells/state"][()],
        ),
        channels=_table(CoverChannels, store["time"]),
        passes=_table(CoverPasses, store["passes"]),
        swaths=CoverSwaths(*(store[f"swaths/{name}"][()] for name in ("pass", "east_m", "north_m"))),
        stops=_table(CoverStops, store["stops"]),
        events=CoverEvents(**{name: store[f"events/{name}"][()] for name in _PLACED}, text=tuple(text)),
        provenance=provenance,
    )


def _table(kind: type[_Table], group: h5py.Group) -> _Table:
    return kind(**{name: group[name][()] for name in kind._fields})


def _number(store: h5py.File, name: str) -> float:
    # The schema ensures that it is one.
    return float(str(attribute_of(store, name)))


# Layers of shapes on WGS-84, written for map programs: GeoPackage, GeoJSON, KML.
#
# The GeoPackage needs the optional package pyogrio (``pip install lgprjax[gis]``).

_CRS = "EPSG:4326"
_KML = "http://www.opengis.net/kml/2.2"


class GeoLayer(NamedTuple):
    """Shapes of one kind with the same properties each.

    Attributes:
        name: name of the layer.
        kind: ``Polygon``, ``LineString`` or ``Point``.
        shapes: shapely geometries in degrees, longitude first; polygons with their outer ring counter-clockwise.
        properties: properties of each shape; ``None`` for unknown numbers.
    """

    name: str
    kind: str
    shapes: tuple[Any, ...]
    properties: tuple[dict[str, Any], ...]


def write_geopackage(
    path: str | Path, layers: Sequence[GeoLayer], metadata: dict[str, str], *, force: bool = False
) -> None:
    """Write layers to a GeoPackage, empty ones too.

    Args:
        path: path of the output.
        layers: layers in the order of the file.
        metadata: metadata of the whole file.
        force: whether to replace an existing output.

    Raises:
        InputError: pyogrio is missing, or the output exists (without ``force``) or cannot be written.
    """
    pyogrio = _pyogrio(path)
    with (
        atomic_output(path, force) as temporary,
        # The library detects the format by the file's suffix, which the temporary name lacks.
        tempfile.TemporaryDirectory(dir=Path(path).parent, prefix=".export-") as folder,
    ):
        whole = Path(folder) / "layers.gpkg"
        for layer in layers:
            names = list(layer.properties[0]) if layer.properties else []
            pyogrio.raw.write(
                whole,
                geometry=np.array([shape.wkb for shape in layer.shapes], object),
                field_data=[_column([row[name] for row in layer.properties]) for name in names],
                fields=names,
                layer=layer.name,
                driver="GPKG",
                geometry_type=layer.kind,
                crs=_CRS,
                dataset_metadata=metadata,
            )
        whole.replace(temporary)


def write_shapefiles(path: str | Path, layers: Sequence[GeoLayer], *, force: bool = False) -> None:
    """Write layers as shapefiles, one each, in a ZIP archive; names of columns are cut to ten characters, text to 254.

    Empty layers are left out: a shapefile of no shapes has no columns either.

    Raises:
        InputError: pyogrio is missing, or the output exists (without ``force``) or cannot be written.
    """
    pyogrio = _pyogrio(path)
    with (
        atomic_output(path, force) as temporary,
        tempfile.TemporaryDirectory(dir=Path(path).parent, prefix=".export-") as folder,
    ):
        for layer in layers:
            if not layer.shapes:
                continue
            names = list(layer.properties[0])
            pyogrio.raw.write(
                Path(folder) / f"{layer.name}.shp",
                geometry=np.array([shape.wkb for shape in layer.shapes], object),
                field_data=[_column([_cut(row[name]) for row in layer.properties]) for name in names],
                fields=_short(names),
                driver="ESRI Shapefile",
                geometry_type=layer.kind,
                crs=_CRS,
                encoding="UTF-8",
            )
        with zipfile.ZipFile(temporary, "w", zipfile.ZIP_DEFLATED) as archive:
            for each in sorted(Path(folder).iterdir()):
                archive.write(each, each.name)


def _cut(value: Any) -> Any:
    """A text as long as a shapefile's column, whole characters."""
    return value.encode()[:254].decode("utf-8", "ignore") if isinstance(value, str) else value


def _short(names: Sequence[str]) -> list[str]:
    """Names of ten characters at most, none twice."""
    found: list[str] = []
    for name in names:
        cut, number = name[:10], 1
        while cut in found:
            cut, number = f"{name[:8]}_{number}", number + 1
        found.append(cut)
    return found


def write_cells(path: str | Path, record: WorkedRecord, inside: np.ndarray, *, force: bool = False) -> None:
    """Write the cells of a field as CSV, row by row from the south-west.

    Args:
        path: path of the output.
        record: record with the cells.
        inside: mask of cells of the field.
        force: whether to replace an existing output.

    Raises:
        InputError: the output exists (without ``force``) or cannot be written.
    """
    cells = record.cells
    rows, columns = np.nonzero(inside)
    east_m = cells.east_m + cells.cell_m * (columns + 0.5)
    north_m = cells.north_m + cells.cell_m * (rows + 0.5)
    latitude, longitude, _ = record.frame.to_geodetic(east_m, north_m, np.zeros(len(rows)))
    # Rounded down, as in the record.
    probability = np.floor(1e5 * (cells.probability[rows, columns] / FULL)) / 1e5
    words = np.array(["not processed", "uncertain", "processed"])
    names = [f"state_p{100.0 * level:g}".replace(".", "") for level in cells.level]
    states = [words[state[rows, columns]] for state in cells.state]
    with atomic_output(path, force) as temporary, temporary.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(["latitude_deg", "longitude_deg", "east_m", "north_m", "probability", *names])
        for number in range(len(rows)):
            place = (
                f"{latitude[number]:.9f}",
                f"{longitude[number]:.9f}",
                f"{east_m[number]:.3f}",
                f"{north_m[number]:.3f}",
            )
            writer.writerow([*place, f"{probability[number]:.5f}", *(state[number] for state in states)])


def write_geojson(
    path: str | Path, layers: Sequence[GeoLayer], metadata: dict[str, str], *, force: bool = False
) -> None:
    """Write layers as one FeatureCollection (RFC 7946); each feature has its layer's name, the metadata are a member.

    Raises:
        InputError: the output exists (without ``force``) or cannot be written.
    """
    features = [
        {
            "type": "Feature",
            "geometry": geometry(shape),
            "properties": {"layer": layer.name, **properties},
        }
        for layer in layers
        for shape, properties in zip(layer.shapes, layer.properties, strict=True)
    ]
    collection = {"type": "FeatureCollection", "lgprjax": metadata, "features": features}
    with atomic_output(path, force) as temporary:
        temporary.write_text(json.dumps(collection, ensure_ascii=False, allow_nan=False) + "\n", encoding="utf-8")


def write_kml(
    path: str | Path,
    layers: Sequence[GeoLayer],
    metadata: dict[str, str],
    *,
    colours: dict[str, str],
    force: bool = False,
) -> None:
    """Write layers as KML 2.2, one folder per layer.

    Args:
        path: path of the output.
        layers: layers in the order of the file.
        metadata: metadata, written to the document's description.
        colours: ``#rrggbb`` by layer; polygons are filled with it, half transparent.
        force: whether to replace an existing output.

    Raises:
        InputError: the output exists (without ``force``) or cannot be written.
    """
    root = ElementTree.Element("kml", {"xmlns": _KML})
    document = ElementTree.SubElement(root, "Document")
    ElementTree.SubElement(document, "description").text = "\n".join(f"{n}: {text}" for n, text in metadata.items())
    for layer in layers:
        style = ElementTree.SubElement(document, "Style", {"id": layer.name})
        colour = colours.get(layer.name, "#222222")
        for element, opacity in (("IconStyle", "ff"), ("LineStyle", "ff"), ("PolyStyle", "80")):
            # KML counts opacity, blue, green, red.
            told = opacity + colour[5:7] + colour[3:5] + colour[1:3]
            ElementTree.SubElement(ElementTree.SubElement(style, element), "color").text = told
    for layer in layers:
        folder = ElementTree.SubElement(document, "Folder")
        ElementTree.SubElement(folder, "name").text = layer.name
        for shape, properties in zip(layer.shapes, layer.properties, strict=True):
            folder.append(_placemark(layer, shape, properties))
    with atomic_output(path, force) as temporary:
        ElementTree.ElementTree(root).write(temporary, encoding="utf-8", xml_declaration=True)


def _column(values: list[Any]) -> np.ndarray:
    """A column of a table: numbers, NaN for unknown ones, anything else as text."""
    kinds = {type(value) for value in values}
    if kinds <= {int}:
        return np.array(values)
    if kinds <= {float, type(None)}:
        return np.array([math.nan if value is None else value for value in values])
    return np.array([str(each) for each in values], object)


def _placemark(layer: GeoLayer, shape: Any, properties: dict[str, Any]) -> ElementTree.Element:
    placemark = ElementTree.Element("Placemark")
    ElementTree.SubElement(placemark, "name").text = layer.name
    ElementTree.SubElement(placemark, "styleUrl").text = f"#{layer.name}"
    extended = ElementTree.SubElement(placemark, "ExtendedData")
    for name, value in properties.items():
        if value is not None:
            ElementTree.SubElement(ElementTree.SubElement(extended, "Data", {"name": name}), "value").text = str(value)
    parts = shapely.get_parts(cut(shape))
    parent = placemark if len(parts) == 1 else ElementTree.SubElement(placemark, "MultiGeometry")
    for part in parts:
        drawn = ElementTree.SubElement(parent, layer.kind)
        if layer.kind != "Polygon":
            ElementTree.SubElement(drawn, "coordinates").text = _tuples(part)
            continue
        for boundary, ring in _rings(part):
            linear = ElementTree.SubElement(ElementTree.SubElement(drawn, boundary), "LinearRing")
            ElementTree.SubElement(linear, "coordinates").text = _tuples(ring)
    return placemark


def _rings(polygon: Any) -> Iterator[tuple[str, Any]]:
    yield "outerBoundaryIs", polygon.exterior
    for ring in polygon.interiors:
        yield "innerBoundaryIs", ring


def _tuples(line: Any) -> str:
    return " ".join(f"{x:.{DECIMALS}f},{y:.{DECIMALS}f}" for x, y in line.coords)


def _pyogrio(path: str | Path) -> Any:
    try:
        import pyogrio
        import pyogrio.raw
    except ImportError:
        raise InputError(path, "export", "the optional package pyogrio (pip install lgprjax[gis])", "none") from None
    return pyogrio
