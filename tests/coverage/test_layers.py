"""Claims at a level: never rounded upwards, and no claim of what is no number."""

import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lgprjax.coverage import LEVELS, CellState, cell_states


def test_states_by_the_level() -> None:
    probability = jnp.asarray([[0.0, 0.04, 0.06], [0.94, 0.951, 1.0]], jnp.float32)
    expected = [
        [CellState.NOT_PROCESSED, CellState.NOT_PROCESSED, CellState.UNCERTAIN],
        [CellState.UNCERTAIN, CellState.PROCESSED, CellState.PROCESSED],
    ]
    np.testing.assert_array_equal(cell_states(probability, 0.95), expected)


def test_a_level_rounded_down_to_float32_does_not_let_a_cell_in() -> None:
    below = np.float32(0.996)
    assert float(below) < 0.996
    assert cell_states(np.full((1, 1), below), 0.996)[0, 0] == CellState.UNCERTAIN
    above = np.nextafter(below, np.float32(1.0))
    assert cell_states(np.full((1, 1), above), 0.996)[0, 0] == CellState.PROCESSED


@given(st.lists(st.floats(0.0, 1.0, width=32), min_size=6, max_size=6))
def test_what_a_higher_level_claims_a_lower_one_does_too(values: list[float]) -> None:
    probability = np.asarray(values, np.float32).reshape(2, 3)
    low, high = (cell_states(probability, level) for level in LEVELS)
    assert np.all(low[high == CellState.PROCESSED] == CellState.PROCESSED)
    assert np.all(low[high == CellState.NOT_PROCESSED] == CellState.NOT_PROCESSED)


def test_what_is_no_number_is_not_processed() -> None:
    states = cell_states(np.full((2, 3), np.nan, np.float32), 0.95)
    assert np.all(states == CellState.NOT_PROCESSED)


def test_what_is_no_level_is_refused() -> None:
    for level in (0.5, 1.0, float("nan"), 95.0):
        with pytest.raises(ValueError, match="level"):
            cell_states(np.zeros((2, 3), np.float32), level)
