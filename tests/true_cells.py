"""Where a tool truly was: cells by plain geometry in float64, apart from the code that claims them."""

import numpy as np
from jaxtyping import Bool, Float

from lgprjax.coverage import CellGrid, Tool


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
