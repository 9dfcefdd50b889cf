"""The worked map of a field, or of ground without a plan: rows ``COVER`` in, cells out, as in the later record."""

import math
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from lgprjax.coverage import CellGrid, Tool, ToolMoment, WorkedState, init_worked, step_worked
from lgprjax.coverage.worked import WorkedStrip
from lgprjax.frames import body_to_local
from lgprjax.run_records import LONGEST_COVER_STEP_NS, ToolBits


class WorkedMap:
    """The map.

    Args:
        grid: grid of the cells.
        tool: tool of the vehicle.
        shared_sigma_m: standard deviation per axis of the error shared by all positions.

        Attributes:
        grid: grid of the cells.
        moments: number of moments taken so far.
        full: whether part of the worked ground has no cells.
    """

    full = False

    def __init__(self, grid: CellGrid, tool: Tool, shared_sigma_m: float) -> None:
        self.grid, self._tool, self._shared = grid, tool, jnp.float32(shared_sigma_m)
        self._state = init_worked(grid)
        self._last_ns = 0
        self.moments = 0

    def warm_up(self) -> None:
        """Compile; the map stays empty."""
        for _ in range(2):
            self._step(np.zeros(13, np.float32))
        jax.block_until_ready(self._state)
        self._state = init_worked(self.grid)

    def take_up(self, grid: CellGrid, probability: Float[np.ndarray, "north east"]) -> None:
        """Continue from a saved map.

        Raises:
            ValueError: the map has another grid.
        """
        if grid != self.grid or probability.shape != grid.shape:
            raise ValueError(f"cells of {self.grid} expected, found {grid}")
        self._state = self._state._replace(probability=jnp.asarray(probability, jnp.float32))

    def move(self, east_m: float, north_m: float, probability: Float[np.ndarray, "north east"]) -> None:
        """Move the grid: positions are reduced by the shift, and the cells are replaced.

        Args:
            east_m, north_m: shift of the grid.
            probability: probability of the cells at the new place.
        """

        def moved(at: WorkedStrip) -> WorkedStrip:
            return at._replace(x_m=at.x_m - east_m, y_m=at.y_m - north_m)

        running = self._state.running
        running = running._replace(
            now=moved(running.now), low=moved(running.low), high=moved(running.high), strips=moved(running.strips)
        )
        # The arrays are copies: the step gives its memory away.
        self._state = WorkedState(jnp.array(probability, jnp.float32), running)

    def take(self, cover: np.void, mono_ns: int) -> None:
        """Take a row of ``COVER``.

        Args:
            cover: row.
            mono_ns: time of the row, ns; nothing is claimed over a gap since the previous row.
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
        self._state = _step_cover(self.grid, self._tool, self._state, numbers, self._shared)


_WINDOW_TOOLS, _EDGE_TOOLS = 12.0, 2.0
"""Side of the window, and distance of the tool from its edge, in widths and lengths of the tool together."""
_MOST_CELLS = 16_000_000
"""Largest number of cells of an open map: four hectares at 5 cm, 64 MB."""


class OpenMap:
    """The map of ground without a plan: a ``WorkedMap`` that moves with the tool, over a growing grid of cells.

    Args:
        cell_m: side of a cell.
        tool, shared_sigma_m: see ``WorkedMap``.

    Attributes:
        grid: grid of the cells so far, relative to the anchor of the run.
        moments, full: see ``WorkedMap``.
    """

    def __init__(self, cell_m: float, tool: Tool, shared_sigma_m: float) -> None:
        size_m = tool.width_m + tool.length_m
        self._side, self._edge_m = math.ceil(_WINDOW_TOOLS * size_m / cell_m), _EDGE_TOOLS * size_m
        self._tool = tool
        self._window = WorkedMap(CellGrid(0.0, 0.0, cell_m, self._side, self._side), tool, shared_sigma_m)
        self.grid = CellGrid(0.0, 0.0, cell_m, 0, 0)
        self._probability = np.zeros(self.grid.shape, np.float32)
        self._first, self._placed = (0, 0), False
        self.full = False

    @property
    def moments(self) -> int:
        """Number of moments taken so far."""
        return self._window.moments

    def warm_up(self) -> None:
        """Compile; the map stays empty."""
        self._window.warm_up()

    def take_up(self, grid: CellGrid, probability: Float[np.ndarray, "north east"]) -> None:
        """Continue from a saved map.

        Raises:
            ValueError: the map's cells have another size.
        """
        if grid.cell_m != self.grid.cell_m or probability.shape != grid.shape:
            raise ValueError(f"cells of {self.grid.cell_m} m expected, found {grid}")
        self.grid, self._probability = grid, np.array(probability, np.float32)

    def take(self, cover: np.void, mono_ns: int) -> None:
        """A row of ``COVER``, as ``WorkedMap.take``."""
        row, cell_m = cover.copy(), self.grid.cell_m
        counts = bool(int(row["tool"]) & ToolBits.COUNTS)
        x, y, yaw = (float(row[name]) for name in ("x_m", "y_m", "yaw_rad"))
        place = np.array([x]), np.array([y]), np.array([yaw])
        east, north = body_to_local(*place, self._tool.ahead_m, self._tool.left_m)
        if counts and math.isfinite(east[0] + north[0]):
            self._reach(float(east[0]), float(north[0]))
        if counts and self.full:
            row["tool"] = int(row["tool"]) & ~ToolBits.COUNTS
        row["x_m"], row["y_m"] = x - self._first[1] * cell_m, y - self._first[0] * cell_m
        self._window.take(row, mono_ns)

    def probability(self) -> Float[np.ndarray, "north east"]:
        """Probability of the cells of ``grid``, as ``WorkedMap.probability``."""
        self._put_down()
        return self._probability

    def _reach(self, east_m: float, north_m: float) -> None:
        """Move the window if the tool is near its edge."""
        cell_m, side = self.grid.cell_m, self._side
        if self._placed:
            row, column = self._first
            within = (east_m - column * cell_m, north_m - row * cell_m)
            if all(self._edge_m <= each <= side * cell_m - self._edge_m for each in within):
                self.full = False
                return
        self._put_down()
        first = (round(north_m / cell_m) - side // 2, round(east_m / cell_m) - side // 2)
        self.full = not self._grow(first)
        if self.full:
            return
        (row, column), self._first, self._placed = self._first, first, True
        moved = ((first[1] - column) * cell_m, (first[0] - row) * cell_m)
        self._window.move(*moved, self._probability[self._place(first)])

    def _place(self, first: tuple[int, int]) -> tuple[slice, slice]:
        """Slices of a window in the cells."""
        row, column = first[0] - self._row0, first[1] - self._column0
        return slice(row, row + self._side), slice(column, column + self._side)

    @property
    def _row0(self) -> int:
        return round(self.grid.north_m / self.grid.cell_m)

    @property
    def _column0(self) -> int:
        return round(self.grid.east_m / self.grid.cell_m)

    def _put_down(self) -> None:
        if self._placed:
            place = self._place(self._first)
            self._probability[place] = np.maximum(self._probability[place], self._window.probability())

    def _grow(self, first: tuple[int, int]) -> bool:
        """Extend the cells to a window; whether the number of cells allows it."""
        grid, side = self.grid, self._side
        low, high = first, (first[0] + side, first[1] + side)
        if grid.east_cells:
            low = (min(low[0], self._row0), min(low[1], self._column0))
            high = (max(high[0], self._row0 + grid.north_cells), max(high[1], self._column0 + grid.east_cells))
        rows, columns = high[0] - low[0], high[1] - low[1]
        if rows * columns > _MOST_CELLS:
            return False
        if (rows, columns) != grid.shape:
            grown = np.zeros((rows, columns), np.float32)
            if grid.east_cells:
                row, column = self._row0 - low[0], self._column0 - low[1]
                grown[row : row + grid.north_cells, column : column + grid.east_cells] = self._probability
            self.grid = CellGrid(low[1] * grid.cell_m, low[0] * grid.cell_m, grid.cell_m, rows, columns)
            self._probability = grown
        return True


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

    A block counts as worked if all of its cells inside the field are: a coarse picture must not claim more than the
        map.

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
