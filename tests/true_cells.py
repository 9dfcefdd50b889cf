"""Where a tool truly was: cells by plain geometry in float64, apart from the code that claims them."""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

from lgprjax.coverage import CellGrid, CellState, Tool, ToolMoment, cell_states, init_worked, run_worked


def true_cells(
    grid: CellGrid, tool: Tool, poses: Float[np.ndarray, "moment 3"], on: Bool[np.ndarray, " moment"]
) -> Bool[np.ndarray, "north east"]:
    """Cells whose centre some moment's rectangle holds, and no interpolation between moments: rather too few."""
    over = np.zeros(grid.shape, bool)
    x, y, yaw = poses[on].T
    cos, sin = np.cos(yaw), np.sin(yaw)
    middle_x, middle_y = x + cos * tool.ahead_m - sin * tool.left_m, y + sin * tool.ahead_m + cos * tool.left_m
    reach = int(np.ceil(0.5 * np.hypot(tool.width_m, tool.length_m) / grid.cell_m)) + 1
    near = np.arange(-reach, reach + 1)
    rows = np.floor((middle_y - grid.north_m) / grid.cell_m).astype(int)[:, None] + near
    columns = np.floor((middle_x - grid.east_m) / grid.cell_m).astype(int)[:, None] + near
    away_y = (grid.north_m + grid.cell_m * (rows + 0.5) - middle_y[:, None])[:, :, None]
    away_x = (grid.east_m + grid.cell_m * (columns + 0.5) - middle_x[:, None])[:, None, :]
    cos, sin = cos[:, None, None], sin[:, None, None]
    holds = np.abs(cos * away_x + sin * away_y) <= 0.5 * tool.length_m
    holds &= np.abs(cos * away_y - sin * away_x) <= 0.5 * tool.width_m
    holds &= ((rows >= 0) & (rows < grid.north_cells))[:, :, None]
    holds &= ((columns >= 0) & (columns < grid.east_cells))[:, None, :]
    moment, row, column = np.nonzero(holds)
    over[rows[moment, row], columns[moment, column]] = True
    return over


def claims_and_truth(
    tool: Tool,
    pose: Float[np.ndarray, "moment 3"],
    covariance: Float[np.ndarray, "moment 3 3"],
    on: Bool[np.ndarray, " moment"],
    truth: Float[np.ndarray, "moment 3"],
    truly_on: Bool[np.ndarray, " moment"],
    *,
    levels: tuple[float, ...] = (0.95, 0.996),
) -> Float[np.ndarray, "level 3"]:
    """Cells of 10 cm claimed at each level, those of them that are true, and those worked, of one drive."""
    size = 150.0
    grid = CellGrid(-0.5 * size, -0.5 * size, 0.1, round(size / 0.1), round(size / 0.1))
    middle = np.append(truth[:, :2].mean(axis=0), 0.0)
    x, y, yaw = (jnp.asarray(each, jnp.float32) for each in (pose - middle).T)
    moments = ToolMoment(x, y, yaw, jnp.asarray(covariance, jnp.float32), jnp.asarray(on))
    probability = np.asarray(run_worked(grid, tool, init_worked(grid), moments).probability)
    over = true_cells(grid, tool, truth - middle, truly_on)
    claimed = [cell_states(probability, level) == CellState.PROCESSED for level in levels]
    return np.array([(each.sum(), (each & over).sum(), over.sum()) for each in claimed], np.float64)
