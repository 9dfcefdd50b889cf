"""Layers of shapes on WGS-84, written for map programs: GeoPackage, GeoJSON, KML.

The GeoPackage needs the optional packages shapely and pyogrio (``pip install lgprjax[gis]``).
"""

import json
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple
from xml.etree import ElementTree

import numpy as np

from lgprjax.errors import InputError
from lgprjax.formats.atomic import atomic_output

_CRS = "EPSG:4326"
_KML = "http://www.opengis.net/kml/2.2"
_DECIMALS = 10


class GeoLayer(NamedTuple):
    """Shapes of one kind with the same properties each.

    Attributes:
        name: of the layer.
        kind: ``Polygon``, ``LineString`` or ``Point``.
        shapes: of shapely, in degrees, longitude first; polygons with their outer ring counter-clockwise.
        properties: of each shape.
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
        path: the output.
        layers: in the order of the file.
        metadata: of the file as a whole.
        force: replace an output that exists.

    Raises:
        InputError: pyogrio is missing, or the output exists (without ``force``) or cannot be written.
    """
    pyogrio = _pyogrio(path)
    with (
        atomic_output(path, force) as temporary,
        # The library judges a format by the file's name, which the temporary one has not.
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


def write_geojson(
    path: str | Path, layers: Sequence[GeoLayer], metadata: dict[str, str], *, force: bool = False
) -> None:
    """Write layers as one FeatureCollection (RFC 7946); each feature names its layer, the metadata are a member.

    Raises:
        InputError: the output exists (without ``force``) or cannot be written.
    """
    features = [
        {
            "type": "Feature",
            "geometry": {"type": layer.kind, "coordinates": coordinates(shape)},
            "properties": {"layer": layer.name, **properties},
        }
        for layer in layers
        for shape, properties in zip(layer.shapes, layer.properties, strict=True)
    ]
    collection = {"type": "FeatureCollection", "lgprjax": metadata, "features": features}
    with atomic_output(path, force) as temporary:
        temporary.write_text(json.dumps(collection, ensure_ascii=False) + "\n", encoding="utf-8")


def write_kml(
    path: str | Path,
    layers: Sequence[GeoLayer],
    metadata: dict[str, str],
    *,
    colours: dict[str, str],
    force: bool = False,
) -> None:
    """Write layers as KML 2.2, a folder each.

    Args:
        path: the output.
        layers: in the order of the file.
        metadata: told in the document's description.
        colours: ``#rrggbb`` by layer; polygons are filled with it, half see-through.
        force: replace an output that exists.

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


def coordinates(shape: Any) -> list[Any]:
    """Coordinates of a point, a line or a polygon as GeoJSON nests them, rounded to a hundredth of a millimetre."""
    if shape.geom_type == "Point":
        return list(_places(shape)[0])
    if shape.geom_type == "LineString":
        return _places(shape)
    return [_places(ring) for ring in (shape.exterior, *shape.interiors)]


def _places(line: Any) -> list[list[float]]:
    return [[round(x, _DECIMALS), round(y, _DECIMALS)] for x, y in line.coords]


def _column(values: list[Any]) -> np.ndarray:
    """A column of a table: numbers as they are, anything else as text."""
    kinds = {type(value) for value in values}
    return np.array(values) if kinds <= {int} or kinds <= {float} else np.array([str(each) for each in values], object)


def _placemark(layer: GeoLayer, shape: Any, properties: dict[str, Any]) -> ElementTree.Element:
    placemark = ElementTree.Element("Placemark")
    ElementTree.SubElement(placemark, "name").text = layer.name
    ElementTree.SubElement(placemark, "styleUrl").text = f"#{layer.name}"
    extended = ElementTree.SubElement(placemark, "ExtendedData")
    for name, value in properties.items():
        ElementTree.SubElement(ElementTree.SubElement(extended, "Data", {"name": name}), "value").text = str(value)
    drawn = ElementTree.SubElement(placemark, layer.kind)
    if layer.kind != "Polygon":
        ElementTree.SubElement(drawn, "coordinates").text = _tuples(shape)
        return placemark
    for boundary, ring in _rings(shape):
        linear = ElementTree.SubElement(ElementTree.SubElement(drawn, boundary), "LinearRing")
        ElementTree.SubElement(linear, "coordinates").text = _tuples(ring)
    return placemark


def _rings(polygon: Any) -> Iterator[tuple[str, Any]]:
    yield "outerBoundaryIs", polygon.exterior
    for ring in polygon.interiors:
        yield "innerBoundaryIs", ring


def _tuples(line: Any) -> str:
    return " ".join(f"{x:.{_DECIMALS}f},{y:.{_DECIMALS}f}" for x, y in line.coords)


def _pyogrio(path: str | Path) -> Any:
    try:
        import pyogrio
        import pyogrio.raw
    except ImportError:
        raise InputError(path, "export", "the optional package pyogrio (pip install lgprjax[gis])", "none") from None
    return pyogrio
