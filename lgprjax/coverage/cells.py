"""The cells that a field's record is made of: squares in rows from south to north."""

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from lgprjax.coverage.field import Field
from lgprjax.coverage.polygon import contains
from lgprjax.errors import InputError

MOST_CELLS = 100_000_000
"""Of one grid: 400 MB of probabilities, 25 hectares at 5 cm."""


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
        """Of arrays over the cells: rows, columns."""
        return self.north_cells, self.east_cells

    @property
    def cell_m2(self) -> float:
        """Area of a cell."""
        return self.cell_m**2


def grid_of_field(field: Field, cell_m: float, margin_m: float) -> CellGrid:
    """The grid that holds a field with a margin around it.

    Its corner lies on whole multiples of the cell, so that the cells of two fields with one anchor coincide.

    Args:
        field: to be held.
        cell_m: side of a cell.
        margin_m: at least so much beyond the perimeter; not negative.

    Raises:
        InputError: a cell or margin that is no such length, or more than ``MOST_CELLS`` cells.
    """
    if not (math.isfinite(cell_m) and cell_m > 0.0):
        raise InputError("grid", "cell", "a length above zero", f"{cell_m} m")
    if not (math.isfinite(margin_m) and margin_m >= 0.0):
        raise InputError("grid", "margin", "a length, zero or more", f"{margin_m} m")
    low = np.floor((field.perimeter_m.min(axis=0) - margin_m) / cell_m)
    high = np.ceil((field.perimeter_m.max(axis=0) + margin_m) / cell_m)
    east_cells, north_cells = (int(cells) for cells in high - low)
    if east_cells * north_cells > MOST_CELLS:
        expected = f"at most {MOST_CELLS / 1e6:g} million cells of {cell_m:g} m: take larger ones"
        raise InputError("grid", "cells", expected, f"{east_cells * north_cells / 1e6:.0f} million")
    return CellGrid(float(low[0] * cell_m), float(low[1] * cell_m), cell_m, north_cells, east_cells)


def cell_centres(grid: CellGrid) -> tuple[Float[np.ndarray, " east"], Float[np.ndarray, " north"]]:
    """East of the columns' and north of the rows' centres, metres."""
    east = grid.east_m + grid.cell_m * (np.arange(grid.east_cells) + 0.5)
    north = grid.north_m + grid.cell_m * (np.arange(grid.north_cells) + 0.5)
    return east, north


def inside_cells(field: Field, grid: CellGrid) -> Bool[np.ndarray, "north east"]:
    """Cells whose centre lies inside a field."""
    east, north = cell_centres(grid)
    inside = np.zeros(grid.shape, bool)
    columns = np.full(grid.east_cells, 0.0)
    # Row by row: all places of a hectare at once would be hundreds of megabytes.
    for row, y in enumerate(north):
        inside[row] = contains(field.perimeter_m, np.stack([east, columns + y], axis=1))
    return inside
