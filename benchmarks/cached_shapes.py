"""The worked area as the source drew it: shapes for chosen errors, made beforehand, the next larger one stamped down.

MF section 3: a model too slow for the drive gives, for each of a few errors of position and heading, the places about
the tool that it is over with at least a level's probability. Under way the shape with the smallest errors that are not
smaller than the filter's is painted at every pose. It claims no more than ``worked`` does, mostly less:
errors are rounded up and taken as a circle, and a moment's rectangle knows nothing of the sweep. The live map is
compared with it.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from lgprjax.coverage.field import CellGrid, Tool

_NOISE_SIGMAS = 3.0
"""By which the share of a place's draws must exceed the level."""


class ShapeCache(NamedTuple):
    """Shapes by errors.

    Attributes:
        tool: that they are of.
        position_m, heading_rad: sigmas, ascending; of each axis of the reference point, and of yaw.
        shapes: the tool's rectangle in equal parts, and whether a part is claimed as a whole.
    """

    tool: Tool
    position_m: Float[np.ndarray, " position"]
    heading_rad: Float[np.ndarray, " heading"]
    shapes: Bool[np.ndarray, "position heading ahead left"]


def make_shapes(
    tool: Tool,
    level: float,
    position_m: Float[np.ndarray, " position"],
    heading_rad: Float[np.ndarray, " heading"],
    *,
    parts: tuple[int, int] = (16, 48),
    draws: int = 10_000,
    seed: int = 0,
) -> ShapeCache:
    """Shapes by brute force: errors drawn, the displaced rectangle asked for every place.

    Args:
        tool: its rectangle; only places inside it can be over it with more than half a chance.
        level: probability that a place must reach, above one half.
        position_m, heading_rad: sigmas to make shapes for, ascending.
        parts: of the rectangle along and across.
        draws: of the errors.
        seed: of them.
    """
    drawn = np.random.default_rng(seed).standard_normal((draws, 3))
    ahead = tool.length_m * (np.arange(parts[0] + 1) / parts[0] - 0.5)
    left = tool.width_m * (np.arange(parts[1] + 1) / parts[1] - 0.5)
    least = level + _NOISE_SIGMAS * np.sqrt(level * (1.0 - level) / draws)
    shapes = np.zeros((len(position_m), len(heading_rad), *parts), bool)
    for row, position in enumerate(position_m):
        for column, heading in enumerate(heading_rad):
            errors = drawn * (position, position, heading)
            corners = np.stack([_covered_share(tool, errors, place, left) >= least for place in ahead])
            # The claimed places of a rectangle with normal errors are a convex set: four corners speak for a part.
            shapes[row, column] = corners[1:, 1:] & corners[1:, :-1] & corners[:-1, 1:] & corners[:-1, :-1]
    return ShapeCache(tool, position_m, heading_rad, shapes)


def choose_shape(cache: ShapeCache, covariance: Float[np.ndarray, "3 3"]) -> Bool[np.ndarray, "ahead left"] | None:
    """The shape of the smallest cached errors that a pose's are not larger than; ``None`` where there is none.

    Position and heading may be correlated, which the cache knows nothing of: with ρ the largest correlation between
    them, the covariance is at most (1 + ρ) times that without it. The position's error is that of its worst direction.

    Args:
        cache: of shapes.
        covariance: of x, y (m) and yaw (rad), positive definite.
    """
    place, yaw, shared = covariance[:2, :2], covariance[2, 2], covariance[:2, 2]
    grown = 1.0 + np.sqrt(np.clip(shared @ np.linalg.solve(place, shared) / yaw, 0.0, 1.0))
    worst_m = np.sqrt(grown * np.linalg.eigvalsh(place)[1])
    row = int(np.searchsorted(cache.position_m, worst_m))
    column = int(np.searchsorted(cache.heading_rad, np.sqrt(grown * yaw)))
    if row == len(cache.position_m) or column == len(cache.heading_rad):
        return None
    shape: Bool[np.ndarray, "ahead left"] = cache.shapes[row, column]
    return shape


def stamp_shape(
    claimed: Bool[np.ndarray, "north east"],
    grid: CellGrid,
    cache: ShapeCache,
    pose: tuple[float, float, float],
    covariance: Float[np.ndarray, "3 3"],
) -> None:
    """Paint the shape of a moment into a map of claimed cells, in place.

    Args:
        claimed: the map.
        grid: of the map.
        cache: of shapes.
        pose: east, north (m) and yaw (rad) of the reference point.
        covariance: of them.
    """
    shape = choose_shape(cache, covariance)
    if shape is None:
        return
    tool, (x, y, yaw) = cache.tool, pose
    cos, sin = np.cos(yaw), np.sin(yaw)
    centre_x = x + cos * tool.ahead_m - sin * tool.left_m
    centre_y = y + sin * tool.ahead_m + cos * tool.left_m
    reach = 0.5 * np.hypot(tool.width_m, tool.length_m)
    rows = _cells_within(centre_y - grid.north_m, reach, grid.cell_m, grid.north_cells)
    columns = _cells_within(centre_x - grid.east_m, reach, grid.cell_m, grid.east_cells)
    away_y = (grid.north_m - centre_y + grid.cell_m * (rows + 0.5))[:, None]
    away_x = (grid.east_m - centre_x + grid.cell_m * (columns + 0.5))[None]
    ahead = np.floor(((cos * away_x + sin * away_y) / tool.length_m + 0.5) * shape.shape[0]).astype(int)
    left = np.floor(((cos * away_y - sin * away_x) / tool.width_m + 0.5) * shape.shape[1]).astype(int)
    within = (ahead >= 0) & (ahead < shape.shape[0]) & (left >= 0) & (left < shape.shape[1])
    claimed[rows[:, None], columns[None]] |= within & shape[np.where(within, ahead, 0), np.where(within, left, 0)]


def _covered_share(
    tool: Tool, errors: Float[np.ndarray, "draw 3"], ahead_m: float, left_m: Float[np.ndarray, " left"]
) -> Float[np.ndarray, " left"]:
    """Share of the draws in which the tool is over places of one row of its rectangle."""
    x = (tool.ahead_m + ahead_m - errors[:, 0])[:, None]
    y = (tool.left_m + left_m)[None] - errors[:, 1, None]
    cos, sin = np.cos(errors[:, 2, None]), np.sin(errors[:, 2, None])
    over = np.abs(cos * x + sin * y - tool.ahead_m) <= 0.5 * tool.length_m
    over &= np.abs(cos * y - sin * x - tool.left_m) <= 0.5 * tool.width_m
    share: Float[np.ndarray, " left"] = over.mean(axis=0)
    return share


def _cells_within(offset_m: float, reach_m: float, cell_m: float, cells: int) -> np.ndarray:
    """Cells of a row or column within a reach of an offset, those of the grid only."""
    first = max(int(np.floor((offset_m - reach_m) / cell_m)), 0)
    return np.arange(first, min(int(np.ceil((offset_m + reach_m) / cell_m)), cells))
