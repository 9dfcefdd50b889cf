"""Grids of cells: where their corners lie, which cells are inside a field."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lgprjax.coverage import CellGrid, cell_centres, field_of_polygon, grid_of_field, inside_cells
from refusals import refused

NOTCHED = field_of_polygon(
    np.array([[0.0, 0.0], [10.0, 0.0], [10.0, 6.0], [6.0, 6.0], [6.0, 2.0], [4.0, 2.0], [4.0, 6.0], [0.0, 6.0]]),
    name="notched",
)


@settings(deadline=None, max_examples=25)
@given(
    east=st.floats(-500.0, 500.0),
    north=st.floats(-500.0, 500.0),
    cell=st.floats(0.05, 1.0),
    margin=st.floats(0.0, 5.0),
)
def test_a_grid_holds_its_field_and_margin_and_starts_on_whole_cells(
    east: float, north: float, cell: float, margin: float
) -> None:
    field = field_of_polygon(NOTCHED.perimeter_m + np.array([east, north]), name="moved")
    grid = grid_of_field(field, cell, margin)
    low, high = field.perimeter_m.min(axis=0) - margin, field.perimeter_m.max(axis=0) + margin
    for start, cells, least, most in (
        (grid.east_m, grid.east_cells, low[0], high[0]),
        (grid.north_m, grid.north_cells, low[1], high[1]),
    ):
        assert start / cell == pytest.approx(round(start / cell), abs=1e-6)
        assert least - cell - 1e-6 < start <= least + 1e-6
        assert most - 1e-6 <= start + cells * cell < most + cell + 1e-6


def test_a_concave_field_has_the_cells_of_its_area_and_none_of_its_notch() -> None:
    grid = grid_of_field(NOTCHED, 0.1, 1.0)
    inside = inside_cells(NOTCHED, grid)
    assert inside.shape == grid.shape == (80, 120)
    assert np.count_nonzero(inside) * grid.cell_m2 == pytest.approx(60.0 - 8.0)
    east, north = cell_centres(grid)
    column, row = int(np.argmin(np.abs(east - 5.05))), int(np.argmin(np.abs(north - 4.05)))
    assert not inside[row, column]
    assert inside[row, int(np.argmin(np.abs(east - 3.95)))]
    assert not inside[0].any()
    assert not inside[:, -1].any()


def test_row_0_is_southmost_and_column_0_westmost() -> None:
    east, north = cell_centres(CellGrid(-3.0, 7.0, 0.5, 2, 4))
    np.testing.assert_allclose(north, [7.25, 7.75])
    np.testing.assert_allclose(east, [-2.75, -2.25, -1.75, -1.25])


def test_what_makes_no_grid_is_refused_with_the_reason() -> None:
    for cell, margin, place, found in (
        (0.0, 1.0, "cell", "0.0 m"),
        (float("nan"), 1.0, "cell", "nan"),
        (0.1, -1.0, "margin", "-1.0 m"),
        (0.0005, 1.0, "cells", 384),
    ):
        with refused(place, file="grid", found=found):
            grid_of_field(NOTCHED, cell, margin)
