"""Turning points of a perimeter as a table: where each is, and bearing and distance that lead there."""

import csv
from pathlib import Path

import numpy as np
from jaxtyping import Float
from pyproj import Geod

from lgprjax.formats.atomic import atomic_output

DATUM = "WGS 84"
_COLUMNS = (
    "point",
    "latitude_deg",
    "longitude_deg",
    "datum",
    "bearing_from_benchmark_deg",
    "distance_from_benchmark_m",
    "bearing_to_next_deg",
    "distance_to_next_m",
)
# A millimetre of distance, and a bearing that is as good at 100 m.
_DEGREES, _BEARING, _METRES = 10, 4, 3


def write_turning_points(
    path: str | Path,
    latitude_deg: Float[np.ndarray, " corner"],
    longitude_deg: Float[np.ndarray, " corner"],
    benchmark_deg: tuple[float, float] | None,
    *,
    force: bool = False,
) -> None:
    """Write the benchmark and the turning points TP1, TP2, ... in the perimeter's order.

    Bearings are true, clockwise from north, and with the distances those of the geodesic on the ellipsoid.

    Args:
        path: CSV file.
        latitude_deg, longitude_deg: of the corners.
        benchmark_deg: its latitude and longitude; ``None``: the first turning point serves as such.
        force: replace an output that exists.

    Raises:
        InputError: the output exists (without ``force``) or cannot be written.
    """
    ellipsoid = Geod(ellps="WGS84")
    mark = (float(latitude_deg[0]), float(longitude_deg[0])) if benchmark_deg is None else benchmark_deg

    def way(start: tuple[float, float], end: tuple[float, float]) -> tuple[str, str]:
        bearing, _, distance_m = ellipsoid.inv(start[1], start[0], end[1], end[0])
        told = round(float(bearing) % 360.0, _BEARING) % 360.0
        return f"{told:.{_BEARING}f}" if distance_m > 0.0 else "", f"{distance_m:.{_METRES}f}"

    corners = [(float(one), float(other)) for one, other in zip(latitude_deg, longitude_deg, strict=True)]
    first = "BM" if benchmark_deg is not None else "BM (first turning point)"
    rows = [[first, *_place(mark), DATUM, "", "", *way(mark, corners[0])]]
    for number, corner in enumerate(corners):
        following = corners[(number + 1) % len(corners)]
        rows.append([f"TP{number + 1}", *_place(corner), DATUM, *way(mark, corner), *way(corner, following)])
    with atomic_output(path, force) as temporary, temporary.open("w", newline="", encoding="utf-8") as stream:
        table = csv.writer(stream)
        table.writerow(_COLUMNS)
        table.writerows(rows)


def _place(place: tuple[float, float]) -> list[str]:
    return [f"{value:.{_DEGREES}f}" for value in place]
