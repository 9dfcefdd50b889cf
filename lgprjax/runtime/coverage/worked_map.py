"""The worked map of a field: rows ``COVER`` in, cells out, by the same step as the later record."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from lgprjax.coverage import CellGrid, Tool, ToolMoment, WorkedState, init_worked, step_worked
from lgprjax.run_records import LONGEST_COVER_STEP_NS, ToolBits


class WorkedMap:
    """The map.

    Args:
        grid: of its cells.
        tool: of the vehicle.
        shared_sigma_m: an axis, of the error that all positions share.

    Attributes:
        moments: taken so far.
    """

    def __init__(self, grid: CellGrid, tool: Tool, shared_sigma_m: float) -> None:
        self._grid, self._tool, self._shared = grid, tool, jnp.float32(shared_sigma_m)
        self._state = init_worked(grid)
        self._last_ns = 0
        self.moments = 0

    def warm_up(self) -> None:
        """Compile; the map stays empty."""
        for _ in range(2):
            self._step(np.zeros(13, np.float32))
        jax.block_until_ready(self._state)
        self._state = init_worked(self._grid)

    def take_up(self, probability: Float[np.ndarray, "north east"]) -> None:
        """Continue from a saved map.

        Raises:
            ValueError: it is of another grid.
        """
        if probability.shape != self._grid.shape:
            raise ValueError(f"{self._grid.shape} cells expected, found {probability.shape}")
        self._state = self._state._replace(probability=jnp.asarray(probability, jnp.float32))

    def take(self, cover: np.void, mono_ns: int) -> None:
        """A row of ``COVER``.

        Args:
            cover: the row.
            mono_ns: its time; a gap since the previous row is not counted.
        """
        place = (cover["x_m"], cover["y_m"], cover["yaw_rad"], *cover["covariance"].ravel())
        if mono_ns - self._last_ns > LONGEST_COVER_STEP_NS:
            self._step(np.array([*place, False], np.float32))
        self._step(np.array([*place, bool(int(cover["tool"]) & ToolBits.COUNTS)], np.float32))
        self._last_ns = mono_ns
        self.moments += 1

    def probability(self) -> Float[np.ndarray, "north east"]:
        """Probability of each cell that the tool was over it."""
        return np.asarray(self._state.probability)

    def _step(self, numbers: Float[np.ndarray, "13"]) -> None:
        self._state = _step_cover(self._grid, self._tool, self._state, numbers, self._shared)


@partial(jax.jit, static_argnames=("grid", "tool"), donate_argnames="state")
def _step_cover(
    grid: CellGrid, tool: Tool, state: WorkedState, numbers: Float[Array, "13"], shared_sigma_m: Float[Array, ""]
) -> WorkedState:
    """One vector in: a transfer of each number would cost as much as the step."""
    moment = ToolMoment(numbers[0], numbers[1], numbers[2], jnp.reshape(numbers[3:12], (3, 3)), numbers[12] > 0.5)
    stepped: WorkedState = step_worked(grid, tool, state, moment, shared_sigma_m)
    return stepped


def worked_runs(
    worked: Bool[np.ndarray, "north east"], inside: Bool[np.ndarray, "north east"], most: int
) -> tuple[int, list[list[int]]]:
    """Worked blocks of cells, as runs for a page.

    A block counts as worked if all of its cells inside the field are: a coarse picture claims no more than the map.

    Args:
        worked: cells.
        inside: the field.
        most: blocks along the longer side, at most.

    Returns:
        cells along a block's side, and runs as row, first column and number of blocks; row 0 southmost.
    """
    side = max(1, -(-max(worked.shape) // most))
    rows, columns = (-(-cells // side) for cells in worked.shape)
    padding = [(0, size * side - cells) for size, cells in zip((rows, columns), worked.shape, strict=True)]

    def blocks(cells: Bool[np.ndarray, "north east"], outside: bool) -> Bool[np.ndarray, "..."]:
        return np.pad(cells, padding, constant_values=outside).reshape(rows, side, columns, side)

    some = blocks(inside, False).any(axis=(1, 3))
    whole = blocks(worked | ~inside, True).all(axis=(1, 3)) & some
    edges = np.diff(np.pad(whole, ((0, 0), (1, 1))).astype(np.int8), axis=1)
    row, first = np.nonzero(edges == 1)
    _, last = np.nonzero(edges == -1)
    return side, np.stack([row, first, last - first], axis=1).tolist()
