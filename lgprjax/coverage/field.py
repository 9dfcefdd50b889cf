"""A field to be covered: a simple polygon in local metres, from three driven corners or from all of them."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from lgprjax.coverage.polygon import first_crossing, signed_area_m2
from lgprjax.errors import InputError

SQUARED_M = 0.3
"""How far the third driven corner may be moved to make a rectangle of three corners: what driving to them leaves."""
LARGEST_M = 2000.0
"""Widest field: the level local frame and float32 metres hold far beyond it, a mistaken corner does not."""
_FARTHEST_M = 10_000.0
_LEAST_M2 = 1.0
_THINNEST_M = 0.1
_SAME_M = 1e-3
_LEAST_BEND_RAD = np.radians(30.0)


@dataclass(frozen=True, eq=False)
class Field:
    """Ground to be covered.

    Attributes:
        perimeter_m: corners, east and north of the plan's anchor, counter-clockwise; no side crosses another. The
            first side is the one that lines run along unless the settings say otherwise.
    """

    perimeter_m: Float[np.ndarray, "corner 2"]

    @property
    def area_m2(self) -> float:
        """Area inside the perimeter."""
        return signed_area_m2(self.perimeter_m)


def field_of_corners(corners_m: Float[np.ndarray, "3 2"], *, name: str) -> Field:
    """The rectangle or parallelogram of three corners in the order in which they were driven to (MF section 2).

    The first two stay where they were recorded and make the first side. Where a rectangle needs the third moved by no
    more than ``SQUARED_M`` along that side, it is one; else the fourth corner completes a parallelogram through all
    three.

    Args:
        corners_m: east and north.
        name: of the field, or its file, for errors.

    Raises:
        InputError: corners that are no numbers, lie nearly on a line, or make too small or too large a field.
    """
    corners = np.asarray(corners_m, np.float64)
    _check_places(corners, name)
    first, second, third = corners
    side, rise = second - first, third - second
    lengths = np.hypot(*side), np.hypot(*rise)
    if min(lengths) < _SAME_M:
        raise InputError(name, "corners", "three separate ones", "two in one place")
    along_m = float(side @ rise / lengths[0])
    bend = float(np.arccos(np.clip(along_m / lengths[1], -1.0, 1.0)))
    if not _LEAST_BEND_RAD <= bend <= np.pi - _LEAST_BEND_RAD:
        raise InputError(
            name,
            "corner 2",
            f"a turn of {np.degrees(_LEAST_BEND_RAD):.0f} to {180.0 - np.degrees(_LEAST_BEND_RAD):.0f} degrees",
            f"{np.degrees(bend):.1f} degrees: the corners lie nearly on one line",
        )
    if abs(along_m) <= SQUARED_M:
        rise = rise - along_m * side / lengths[0]
    return field_of_polygon(np.stack([first, second, second + rise, first + rise]), name=name)


def field_of_polygon(points_m: Float[np.ndarray, "point 2"], *, name: str) -> Field:
    """The field inside a polygon, concave or not, its corners in either sense.

    Corners closer than a millimetre to the last one are dropped, so the first may be repeated at the end. A clockwise
    polygon is turned round so that its first side stays the first.

    Args:
        points_m: east and north.
        name: of the field, or its file, for errors.

    Raises:
        InputError: fewer than three separate corners, something that is no number, corners on one line, sides that
            cross or touch, or too small or too large a field.
    """
    points = np.asarray(points_m, np.float64)
    _check_places(points, name)
    corners = _separate(points)
    if len(corners) < 3:
        raise InputError(name, "corners", "at least three separate ones", f"{len(corners)}")
    thin_m = _thickness_m(corners)
    if thin_m < _THINNEST_M:
        raise InputError(name, "corners", "corners that span an area", f"all on one line, within {thin_m:.2f} m")
    crossing = first_crossing(corners)
    if crossing is not None:
        found = f"side {crossing[0] + 1} meets side {crossing[1] + 1}"
        raise InputError(name, "perimeter", "sides that meet at their corners only", found)
    area_m2 = signed_area_m2(corners)
    if abs(area_m2) < _LEAST_M2:
        raise InputError(name, "perimeter", f"an area of at least {_LEAST_M2:g} m²", f"{abs(area_m2):.2f} m²")
    return Field(corners if area_m2 > 0.0 else np.roll(corners[::-1], 2, axis=0))


def _check_places(points: Float[np.ndarray, "point 2"], name: str) -> None:
    finite = np.all(np.isfinite(points), axis=1)
    if not finite.all():
        place = int(np.argmin(finite))
        raise InputError(name, f"corner {place + 1}", "numbers", f"{points[place].tolist()}")
    if len(points) == 0:
        return
    widest_m = float(np.hypot(*np.ptp(points, axis=0)))
    if widest_m > LARGEST_M:
        raise InputError(name, "corners", f"a field at most {LARGEST_M / 1e3:g} km wide", f"{widest_m / 1e3:.1f} km")
    farthest_m = float(np.hypot(*points.T).max())
    if farthest_m > _FARTHEST_M:
        expected = f"places within {_FARTHEST_M / 1e3:g} km of the anchor"
        raise InputError(name, "corners", expected, f"one {farthest_m / 1e3:.1f} km away")


def _separate(points: Float[np.ndarray, "point 2"]) -> Float[np.ndarray, "corner 2"]:
    """The points but those in the place of the last one kept, around the ring."""
    kept: list[np.ndarray] = []
    for point in points:
        if not kept or np.hypot(*(point - kept[-1])) >= _SAME_M:
            kept.append(point)
    while len(kept) > 1 and np.hypot(*(kept[-1] - kept[0])) < _SAME_M:
        kept.pop()
    return np.array(kept).reshape(-1, 2)


def _thickness_m(corners: Float[np.ndarray, "corner 2"]) -> float:
    """Extent across the direction in which the corners extend most."""
    shifted = corners - corners.mean(axis=0)
    across = np.linalg.svd(shifted, full_matrices=False)[2][1]
    return float(np.ptp(shifted @ across))
