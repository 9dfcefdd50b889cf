"""A field to be covered: a simple polygon in local metres, from three driven corners or from all of them."""

import math
from dataclasses import dataclass
from enum import IntEnum
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, UInt8

from lgprjax.errors import InputError

# A simple polygon on the host: area, inside test, distance from the sides, intersections.

Corners = Float[np.ndarray, "corner 2"]


def signed_area_m2(corners_m: Corners) -> float:
    """Area, positive where the corners run counter-clockwise."""
    shifted = corners_m - corners_m[0]
    return float(0.5 * np.sum(_cross(shifted, np.roll(shifted, -1, axis=0))))


def contains(corners_m: Corners, places_m: Float[np.ndarray, "place 2"]) -> Bool[np.ndarray, " place"]:
    """Whether places are inside: an odd number of sides to their right. On a side itself the result is arbitrary."""
    inside = np.zeros(len(places_m), bool)
    x, y = places_m.T
    for low, high in zip(corners_m, np.roll(corners_m, -1, axis=0), strict=True):
        spans = (low[1] > y) != (high[1] > y)
        if spans.any():
            inside[spans] ^= x[spans] < low[0] + (y[spans] - low[1]) * (high[0] - low[0]) / (high[1] - low[1])
    return inside


def side_distance_m(corners_m: Corners, places_m: Float[np.ndarray, "place 2"]) -> Float[np.ndarray, " place"]:
    """Distance of places from the nearest side, inside or outside."""
    nearest = np.full(len(places_m), np.inf)
    for start, end in zip(corners_m, np.roll(corners_m, -1, axis=0), strict=True):
        side, away = end - start, places_m - start
        share = np.clip(away @ side / (side @ side), 0.0, 1.0)
        nearest = np.minimum(nearest, np.hypot(*(away - share[:, None] * side).T))
    return nearest


def outside_m(corners_m: Corners, places_m: Float[np.ndarray, "place 2"]) -> Float[np.ndarray, " place"]:
    """Distance of places beyond the sides, m; 0 inside."""
    return np.where(contains(corners_m, places_m), 0.0, side_distance_m(corners_m, places_m))


def first_crossing(corners_m: Corners) -> tuple[int, int] | None:
    """Numbers of two sides, from 0, that cross, touch or fold back on each other; ``None`` where the polygon is simple.

    Side k leads from corner k to the next one.
    """
    starts = corners_m - corners_m[0]
    ends = np.roll(starts, -1, axis=0)
    sides = ends - starts
    following = np.roll(sides, -1, axis=0)
    folded = (_cross(sides, following) == 0.0) & (np.sum(sides * following, axis=1) < 0.0)
    count = len(starts)
    if folded.any():
        side = int(np.argmax(folded))
        return side, (side + 1) % count
    low, high = np.minimum(starts, ends), np.maximum(starts, ends)
    for side in range(count - 2):
        others = slice(side + 2, count - 1 if side == 0 else count)
        near = np.all((low[others] <= high[side]) & (high[others] >= low[side]), axis=1)
        apart = _cross(sides[side], starts[others] - starts[side]) * _cross(sides[side], ends[others] - starts[side])
        across = _cross(sides[others], starts[side] - starts[others]) * _cross(
            sides[others], ends[side] - starts[others]
        )
        meets = near & (apart <= 0.0) & (across <= 0.0)
        if meets.any():
            return side, side + 2 + int(np.argmax(meets))
    return None


def _cross(a: Float[np.ndarray, "..."], b: Float[np.ndarray, "..."]) -> Float[np.ndarray, "..."]:
    return np.asarray(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0])


SQUARED_M = 0.3
"""Largest shift of the third driven corner to make a rectangle, m: the error of driving to corners."""
LARGEST_M = 2000.0
"""Widest field: the level local frame and float32 metres are valid far beyond it; a larger one indicates a wrong
corner.
"""
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

    The first two keep their recorded positions and make the first side. If a shift of the third by at most
    ``SQUARED_M`` along that side makes a rectangle, the field is one; else the fourth corner completes a parallelogram
    through all three.

    Args:
        corners_m: east and north of the corners.
        name: name of the field or its file, for errors.

    Raises:
        InputError: a coordinate is not finite, the corners are nearly on a line, or the field is too small or too
            large.
    """
    corners = np.asarray(corners_m, np.float64)
    _check_places(corners, name)
    first, second, third = corners
    side, rise = second - first, third - second
    lengths = np.hypot(*side), np.hypot(*rise)
    if min(lengths) < _SAME_M:
        raise InputError(name, "corners", "three distinct corners", "two at the same position")
    along_m = float(side @ rise / lengths[0])
    bend = float(np.arccos(np.clip(along_m / lengths[1], -1.0, 1.0)))
    if not _LEAST_BEND_RAD <= bend <= np.pi - _LEAST_BEND_RAD:
        raise InputError(
            name,
            "corner 2",
            f"a turn of {np.degrees(_LEAST_BEND_RAD):.0f} to {180.0 - np.degrees(_LEAST_BEND_RAD):.0f} degrees",
            f"{np.degrees(bend):.1f} degrees: the corners are nearly on one line",
        )
    if abs(along_m) <= SQUARED_M:
        rise = rise - along_m * side / lengths[0]
    return field_of_polygon(np.stack([first, second, second + rise, first + rise]), name=name)


def field_of_polygon(points_m: Float[np.ndarray, "point 2"], *, name: str) -> Field:
    """The field inside a polygon, concave or not, its corners in either sense.

    Corners closer than a millimetre to the last one are dropped, so the first may be repeated at the end. A clockwise
    polygon is reversed with its first side kept first.

    Args:
        points_m: east and north of the corners.
        name: name of the field or its file, for errors.

    Raises:
        InputError: there are fewer than three separate corners, a coordinate is not finite, the corners are on one
            line, sides cross or touch, or the field is too small or too large.
    """
    points = np.asarray(points_m, np.float64)
    _check_places(points, name)
    corners = _separate(points)
    if len(corners) < 3:
        raise InputError(name, "corners", "at least three distinct corners", f"{len(corners)}")
    thin_m = _thickness_m(corners)
    if thin_m < _THINNEST_M:
        raise InputError(
            name, "corners", "corners that span an area", f"all corners on one line, within {thin_m:.2f} m"
        )
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
        raise InputError(name, f"corner {place + 1}", "finite numbers", f"{points[place].tolist()}")
    if len(points) == 0:
        return
    widest_m = float(np.hypot(*np.ptp(points, axis=0)))
    if widest_m > LARGEST_M:
        raise InputError(name, "corners", f"a field at most {LARGEST_M / 1e3:g} km wide", f"{widest_m / 1e3:.1f} km")
    farthest_m = float(np.hypot(*points.T).max())
    if farthest_m > _FARTHEST_M:
        expected = f"corners within {_FARTHEST_M / 1e3:g} km of the anchor"
        raise InputError(name, "corners", expected, f"a corner {farthest_m / 1e3:.1f} km away")


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


# The tool that works the ground: its rectangle, and its state ten times per second.


class Tool(NamedTuple):
    """The rectangle in which the tool works, in body axes. Plain numbers, because they set sizes of compiled arrays.

    Attributes:
        width_m: width across the vehicle.
        length_m: length along the vehicle. If the tool moves farther than this between two moments, nothing is claimed
            between.
        ahead_m, left_m: position of its centre relative to the vehicle's reference point.
    """

    width_m: float
    length_m: float
    ahead_m: float
    left_m: float


class Outline(NamedTuple):
    """Bounding rectangle of vehicle and tool, in body axes from the reference point, metres.

    Attributes:
        front_m, rear_m: front and rear edge, forward positive; the rear is negative.
        left_m, right_m: left and right edge, left positive; the right is negative.
    """

    front_m: float
    rear_m: float
    left_m: float
    right_m: float


def outline_of(tool: Tool, body: Outline | None = None, *, track_m: float = 0.0) -> Outline:
    """The rectangle around reference point, track, tool and, where it is known, the body."""
    front, rear, left, right = body if body is not None else (0.0, 0.0, 0.0, 0.0)
    half_m = 0.5 * track_m
    return Outline(
        max(tool.ahead_m + 0.5 * tool.length_m, front, 0.0),
        min(tool.ahead_m - 0.5 * tool.length_m, rear, 0.0),
        max(tool.left_m + 0.5 * tool.width_m, left, half_m),
        min(tool.left_m - 0.5 * tool.width_m, right, -half_m),
    )


class ToolMoment(NamedTuple):
    """The vehicle's estimated pose and its tool at one moment (ten per second), or with a leading axis of time.

    Attributes:
        x_m, y_m: east and north of the reference point.
        yaw_rad: yaw of the body, counter-clockwise from east.
        covariance: covariance of x, y (m) and yaw (rad).
        on: whether the tool is commanded on, measured on, and at the right depth. A missing moment counts as off.
    """

    x_m: Float[Array, "..."]
    y_m: Float[Array, "..."]
    yaw_rad: Float[Array, "..."]
    covariance: Float[Array, "... 3 3"]
    on: Bool[Array, "..."]


def tool_centre(
    tool: Tool, x_m: Float[Array, "..."], y_m: Float[Array, "..."], yaw_rad: Float[Array, "..."]
) -> tuple[Float[Array, "..."], Float[Array, "..."]]:
    """East and north of the tool's centre at poses of the reference point."""
    cos, sin = jnp.cos(yaw_rad), jnp.sin(yaw_rad)
    return x_m + cos * tool.ahead_m - sin * tool.left_m, y_m + sin * tool.ahead_m + cos * tool.left_m


# The cells that a field's record is made of: squares in rows from south to north.

MOST_CELLS = 100_000_000
"""Largest number of cells of a grid: 400 MB of probabilities, 25 hectares at 5 cm."""


@dataclass(frozen=True)
class CellGrid:
    """Square cells over a rectangle; arrays over them are [north, east], row 0 southmost.

    Attributes:
        east_m, north_m: south-west corner, from the plan's anchor.
        cell_m: side of a cell.
        north_cells, east_cells: rows and columns.
    """

    east_m: float
    north_m: float
    cell_m: float
    north_cells: int
    east_cells: int

    @property
    def shape(self) -> tuple[int, int]:
        """Shape of arrays over the cells: rows, columns."""
        return self.north_cells, self.east_cells

    @property
    def cell_m2(self) -> float:
        """Area of a cell."""
        return self.cell_m**2


def grid_of_field(field: Field, cell_m: float, margin_m: float) -> CellGrid:
    """The grid of a field with a margin around it.

    Its corner is at whole multiples of the cell, so that the cells of two fields with one anchor coincide.

    Args:
        field: field to cover.
        cell_m: side of a cell.
        margin_m: least margin beyond the perimeter; not negative.

    Raises:
        InputError: the cell or the margin is out of range, or there are more than ``MOST_CELLS`` cells.
    """
    if not (math.isfinite(cell_m) and cell_m > 0.0):
        raise InputError("grid", "cell", "a length above zero", f"{cell_m} m")
    if not (math.isfinite(margin_m) and margin_m >= 0.0):
        raise InputError("grid", "margin", "a length, zero or more", f"{margin_m} m")
    low = np.floor((field.perimeter_m.min(axis=0) - margin_m) / cell_m)
    high = np.ceil((field.perimeter_m.max(axis=0) + margin_m) / cell_m)
    east_cells, north_cells = (int(cells) for cells in high - low)
    if east_cells * north_cells > MOST_CELLS:
        expected = f"at most {MOST_CELLS / 1e6:g} million cells of {cell_m:g} m: use larger cells"
        raise InputError("grid", "cells", expected, f"{east_cells * north_cells / 1e6:.0f} million")
    return CellGrid(float(low[0] * cell_m), float(low[1] * cell_m), cell_m, north_cells, east_cells)


def cell_centres(grid: CellGrid) -> tuple[Float[np.ndarray, " east"], Float[np.ndarray, " north"]]:
    """East of the columns' and north of the rows' centres, metres."""
    east = grid.east_m + grid.cell_m * (np.arange(grid.east_cells) + 0.5)
    north = grid.north_m + grid.cell_m * (np.arange(grid.north_cells) + 0.5)
    return east, north


def inside_cells(field: Field, grid: CellGrid) -> Bool[np.ndarray, "north east"]:
    """Cells whose centre is inside a field."""
    east, north = cell_centres(grid)
    inside = np.zeros(grid.shape, bool)
    columns = np.full(grid.east_cells, 0.0)
    # Row by row: all places of a hectare at once would be hundreds of megabytes.
    for row, y in enumerate(north):
        inside[row] = contains(field.perimeter_m, np.stack([east, columns + y], axis=1))
    return inside


# Claims of a probability map at a level: processed, uncertain or not processed, and the areas.

LEVELS = (0.95, 0.996)
"""Levels of a record: the usual one, and that of the old United Nations contract figure."""
HIGHEST_LEVEL = 0.9999
"""A cell's largest probability is 0.99994: no ground can be processed at a level beyond it."""


def offered_levels(own: float) -> list[float]:
    """Levels that the operator's page offers, rising; ``own``: that of the configuration."""
    return sorted({0.9, *LEVELS, 0.99, own})


class CellState(IntEnum):
    """State of a cell at a level. A processed cell is not cleared: the ground still has to be searched."""

    NOT_PROCESSED = 0
    UNCERTAIN = 1
    PROCESSED = 2


def cell_states(probability: Float[Array | np.ndarray, "north east"], level: float) -> UInt8[np.ndarray, "north east"]:
    """The state of every cell, as values of ``CellState``.

    A cell is processed if the tool passed it with at least the level's probability, not processed if it passed it with
    less than one minus the level, or if the probability is NaN, and otherwise uncertain.

    Args:
        probability: probability that the tool passed each cell.
        level: confidence level, 0.5 < level < 1.

    Raises:
        ValueError: the level is out of range.
    """
    if not 0.5 < level < 1.0:
        raise ValueError(f"a level between 0.5 and 1, not {level}")
    # In float64: the level rounded to float32 may be the smaller one.
    values = np.nan_to_num(np.asarray(probability, np.float64), nan=0.0)
    states = np.full(values.shape, CellState.UNCERTAIN, np.uint8)
    states[values >= level] = CellState.PROCESSED
    states[values < 1.0 - level] = CellState.NOT_PROCESSED
    return states
