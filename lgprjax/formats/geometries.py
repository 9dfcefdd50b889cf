"""Shapes in degrees, longitude first: files cut them at the antimeridian (RFC 7946, 3.1.9), fields are whole."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import shapely
import shapely.affinity
from jaxtyping import Float

# 1e-10 degrees are a hundredth of a millimetre.
DECIMALS = 10
# A corner that a cut added is closer to its side than this, degrees: a centimetre.
_ON_SIDE_DEG = 1e-7

Ring = Float[np.ndarray, "corner 3"]
"""Latitude, longitude and height of each corner; the height is NaN if missing."""


def continuous(longitude_deg: Float[np.ndarray, " place"], around_deg: float) -> Float[np.ndarray, " place"]:
    """Longitudes within half a turn of one of them, beyond 180 degrees where they must be."""
    turns = np.rint((longitude_deg - around_deg) / 360.0)
    return np.where(turns == 0.0, longitude_deg, longitude_deg - 360.0 * turns)


def cut(shape: Any) -> Any:
    """A shape of continuous longitudes as its parts within 180 degrees west and east."""
    west, _, east, _ = shape.bounds
    if west >= -180.0 and east <= 180.0:
        return shape
    turn = 360.0 if west < -180.0 else -360.0
    inside = shapely.intersection(shape, shapely.box(-180.0, -90.0, 180.0, 90.0))
    beyond = shapely.intersection(shape, shapely.box(-180.0 - turn, -90.0, 180.0 - turn, 90.0))
    both = (inside, shapely.affinity.translate(beyond, turn))
    same = (part for each in both for part in shapely.get_parts(each) if part.geom_type == shape.geom_type)
    parts = [part for part in same if not part.is_empty]
    if shape.geom_type == "Point" or len(parts) == 1:
        return parts[0]
    if shape.geom_type == "LineString":
        return shapely.MultiLineString(parts)
    return shapely.MultiPolygon([shapely.geometry.polygon.orient(part, 1.0) for part in parts])


def geometry(shape: Any) -> dict[str, Any]:
    """A shape of continuous longitudes as a GeoJSON geometry, rounded to a hundredth of a millimetre."""
    shape = cut(shape)
    parts = [_coordinates(part) for part in shapely.get_parts(shape)]
    multiple = shape.geom_type.startswith("Multi")
    return {"type": shape.geom_type, "coordinates": parts if multiple else parts[0]}


def _coordinates(shape: Any) -> list[Any]:
    if shape.geom_type == "Point":
        return list(_places(shape)[0])
    if shape.geom_type == "LineString":
        return _places(shape)
    return [_places(ring) for ring in (shape.exterior, *shape.interiors)]


def _places(line: Any) -> list[Any]:
    return [[round(x, DECIMALS), round(y, DECIMALS)] for x, y in line.coords]


def joined(parts: Sequence[Sequence[Ring]]) -> list[Ring] | None:
    """Polygons, each an outer ring and its holes, closed, that were cut apart at the antimeridian as one such polygon;
    ``None``: they were not.
    """
    if not all(np.any(np.abs(part[0][:, 1]) == 180.0) for part in parts):
        return None
    # Around the antimeridian, where both of its sides are one.
    turned = [[np.stack([ring[:, 1] % 360.0, ring[:, 0]], axis=1) for ring in part] for part in parts]
    flat = [ring for part in turned for ring in part]
    if any(len(ring) < 3 or np.abs(ring[:, 1]).max() > 90.0 for ring in flat):
        return None
    try:
        whole = shapely.unary_union([shapely.Polygon(outer, holes) for outer, *holes in turned])
    except shapely.errors.GEOSException:  # sides that cross
        return None
    if whole.geom_type != "Polygon":
        return None
    heights = {
        (float(lon), float(lat)): float(height)
        for part, flat in zip(parts, turned, strict=True)
        for ring, corners in zip(part, flat, strict=True)
        for (lon, lat), height in zip(corners, ring[:, 2], strict=True)
    }
    first = turned[0][0]
    clockwise = not shapely.LinearRing(first).is_ccw
    whole = shapely.geometry.polygon.orient(whole, -1.0 if clockwise else 1.0)
    rings = []
    for each in (whole.exterior, *whole.interiors):
        corners = _without_cuts(np.array(each.coords)[:-1])
        if len(corners) < 3:
            return None
        rings.append(np.array([[lat, lon, heights.get((float(lon), float(lat)), np.nan)] for lon, lat in corners]))
    begin = next((i for lon, lat in first for i in np.flatnonzero((rings[0][:, :2] == (lat, lon)).all(axis=1))), 0)
    rings[0] = np.roll(rings[0], -int(begin), axis=0)
    return [np.concatenate([ring, ring[:1]]) for ring in rings]


def _without_cuts(corners: Float[np.ndarray, "corner 2"]) -> Float[np.ndarray, "corner 2"]:
    """Corners of a ring without those on the antimeridian that are on a side."""
    before, after = np.roll(corners, 1, axis=0), np.roll(corners, -1, axis=0)
    way, own = after - before, corners - before
    off = np.abs(way[:, 0] * own[:, 1] - way[:, 1] * own[:, 0]) / np.maximum(np.hypot(*way.T), 1e-12)
    return np.asarray(corners[(corners[:, 0] != 180.0) | (off > _ON_SIDE_DEG)])
