"""What a probability map claims at a level: processed, uncertain or not processed, and the area of it."""

from enum import IntEnum

import numpy as np
from jaxtyping import Array, Bool, Float, UInt8

from lgprjax.coverage.cells import CellGrid

LEVELS = (0.95, 0.996)
"""Levels of a record: the usual one, and that of the old United Nations contract figure."""


class CellState(IntEnum):
    """Of a cell at a level. A cell that is processed is not thereby cleared: the ground has to be searched after it."""

    NOT_PROCESSED = 0
    UNCERTAIN = 1
    PROCESSED = 2


def cell_states(probability: Float[Array | np.ndarray, "north east"], level: float) -> UInt8[np.ndarray, "north east"]:
    """The state of every cell, as values of ``CellState``.

    Processed is what the tool passed with at least the level's probability, not processed what it passed with less
    than one minus the level; all else is uncertain. What is no number is not processed.

    Args:
        probability: that the tool passed the cell.
        level: 0.5 < level < 1.

    Raises:
        ValueError: another level.
    """
    if not 0.5 < level < 1.0:
        raise ValueError(f"a level between 0.5 and 1, not {level}")
    # In float64: the level rounded to float32 may be the smaller one.
    values = np.nan_to_num(np.asarray(probability, np.float64), nan=0.0)
    states = np.full(values.shape, CellState.UNCERTAIN, np.uint8)
    states[values >= level] = CellState.PROCESSED
    states[values < 1.0 - level] = CellState.NOT_PROCESSED
    return states


def processed_area_m2(
    probability: Float[Array | np.ndarray, "north east"],
    grid: CellGrid,
    level: float,
    inside: Bool[np.ndarray, "north east"],
) -> float:
    """Area of the cells inside a perimeter that are processed at a level, square metres.

    Raises:
        ValueError: a level that is none, as in ``cell_states``.
    """
    processed = cell_states(probability, level) == CellState.PROCESSED
    return float(np.count_nonzero(processed & inside)) * grid.cell_m2
