"""The worked area, live: for each cell the probability that the tool was over it, kept up ten times a second.

Each moment judges a patch of cells around the tool and no others, so its cost does not grow with the field. A cell
takes pose and error from the strip of the pass that it was crossed with, the beginning and the end from the pass so
far; its probability rises while the tool leaves it behind. The map keeps the largest value of any pass: the errors of
two passes are related, so their chances of missing a cell must not be multiplied.
"""

import math
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from lgprjax.coverage.cells import CellGrid
from lgprjax.coverage.pass_probability import Passing, pass_probability
from lgprjax.coverage.strips import STRIPS, RunningPass, init_pass, step_pass, way_curvatures
from lgprjax.coverage.tool import Tool, ToolMoment, tool_centre

_REACH_WIDTHS = 0.5
"""How far the patch reaches beyond the tool, in tool widths: errors that need more leave nothing worth claiming."""

_FIXED_SHARE = 0.97
"""Of a strip's variance aside, below which the present one is the better: less than rounding leaves as it was."""


class WorkedState(NamedTuple):
    """The map, and the pass that is being driven.

    Attributes:
        probability: that the tool was over the cell's centre, by the best pass so far.
        running: the pass.
    """

    probability: Float[Array, "north east"]
    running: RunningPass


def init_worked(grid: CellGrid) -> WorkedState:
    """Nothing worked yet."""
    return WorkedState(jnp.zeros(grid.shape, jnp.float32), init_pass())


@partial(jax.jit, static_argnames=("grid", "tool"), donate_argnames="state")
def step_worked(grid: CellGrid, tool: Tool, state: WorkedState, moment: ToolMoment) -> WorkedState:
    """The map with one more moment.

    Nothing is claimed for a moment that does not count (``step_pass`` says when), nor between moments that the tool
    cannot have swept between.

    Args:
        grid: of the map.
        tool: its rectangle, as plain numbers.
        state: before; it is given up.
        moment: one lane; more by ``vmap``.
    """
    return _step(grid, tool, state, moment)


@partial(jax.jit, static_argnames=("grid", "tool"))
def run_worked(grid: CellGrid, tool: Tool, moments: ToolMoment) -> WorkedState:
    """The map after moments with a leading axis of time: the same step, one after the other."""

    def step(state: WorkedState, moment: ToolMoment) -> tuple[WorkedState, None]:
        return _step(grid, tool, state, moment), None

    state: WorkedState = jax.lax.scan(step, init_worked(grid), moments)[0]
    return state


def _step(grid: CellGrid, tool: Tool, state: WorkedState, moment: ToolMoment) -> WorkedState:
    reach_m = 0.5 * math.hypot(tool.width_m, tool.length_m) + _REACH_WIDTHS * tool.width_m
    # The strips reach as far back as the patch does, whatever its corner.
    spacing_m = math.sqrt(2.0) * reach_m / (STRIPS - 2)
    running = step_pass(tool, spacing_m, state.running, moment)

    side = 2 * math.ceil(reach_m / grid.cell_m) + 1
    rows, columns = min(side, grid.north_cells), min(side, grid.east_cells)
    middle_x, middle_y = tool_centre(tool, running.now.x_m, running.now.y_m, running.now.yaw_rad)
    first_row = _first_cell(middle_y - grid.north_m, grid.cell_m, rows, grid.north_cells)
    first_column = _first_cell(middle_x - grid.east_m, grid.cell_m, columns, grid.east_cells)
    # From the slice's own corner, which the border may have moved: no cell is taken for another one.
    north = grid.north_m + grid.cell_m * (first_row.astype(jnp.float32) + jnp.arange(rows, dtype=jnp.float32) + 0.5)
    east = grid.east_m + grid.cell_m * (first_column.astype(jnp.float32) + jnp.arange(columns, dtype=jnp.float32) + 0.5)
    x = jnp.broadcast_to(east[None, :], (rows, columns)).ravel()
    y = jnp.broadcast_to(north[:, None], (rows, columns)).ravel()

    passing, known = _crossed(tool, spacing_m, running, x, y)
    claimed = jnp.where(known & running.going, pass_probability(tool, passing), 0.0).reshape(rows, columns)
    old = jax.lax.dynamic_slice(state.probability, (first_row, first_column), (rows, columns))
    new = jax.lax.dynamic_update_slice(state.probability, jnp.maximum(old, claimed), (first_row, first_column))
    return WorkedState(new, running)


def _first_cell(offset_m: Float[Array, ""], cell_m: float, size: int, cells: int) -> Array:
    """First cell of a slice about an offset that lies within the grid."""
    first = jnp.round(offset_m / cell_m) - 0.5 * size
    return jnp.clip(first, 0.0, float(cells - size)).astype(jnp.int32)


def _crossed(
    tool: Tool,
    spacing_m: float,
    running: RunningPass,
    x_m: Float[Array, " place"],
    y_m: Float[Array, " place"],
) -> tuple[Passing, Bool[Array, " place"]]:
    """How the tool crossed places, by the strip whose axis each lies nearest to; and where the strips still tell."""
    strips, now = running.strips, running.now

    def joined(one: Float[Array, ""], many: Float[Array, " strip"]) -> Float[Array, " entry"]:
        return jnp.concatenate([one[None], many])

    yaw, along, turned = (
        joined(getattr(now, name), getattr(strips, name)) for name in ("yaw_rad", "along_m", "turned_rad")
    )
    covariance = jnp.concatenate([now.covariance[None], strips.covariance])
    centre_x, centre_y = tool_centre(tool, joined(now.x_m, strips.x_m), joined(now.y_m, strips.y_m), yaw)
    curvature = way_curvatures(tool, spacing_m, running)
    cos, sin = jnp.cos(yaw), jnp.sin(yaw)

    there = jnp.concatenate([jnp.ones(1, bool), jnp.arange(STRIPS) < running.strip_count])
    ahead = x_m[:, None] * cos[None] + y_m[:, None] * sin[None] - (cos * centre_x + sin * centre_y)[None]
    nearest = jnp.argmin(jnp.where(there[None], jnp.abs(ahead), jnp.inf), axis=1)
    # A fix that has just come tells of what is under the tool at this moment, though not of how it got there.
    aside = covariance[:, 1, 1] + tool.ahead_m * (2.0 * covariance[:, 1, 2] + tool.ahead_m * covariance[:, 2, 2])
    fixed = (jnp.abs(ahead[:, 0]) <= 0.5 * tool.length_m) & (aside[0] < _FIXED_SHARE * aside[nearest])
    nearest = jnp.where(fixed, 0, nearest)

    away_x, away_y = x_m - centre_x[nearest], y_m - centre_y[nearest]
    ahead_m = cos[nearest] * away_x + sin[nearest] * away_y
    left_m = cos[nearest] * away_y - sin[nearest] * away_x
    side = tool.left_m + left_m
    bend = curvature[nearest] / (1.0 - curvature[nearest] * side)

    def ahead_at(along_m: Float[Array, ""], turned_rad: Float[Array, ""]) -> Float[Array, " place"]:
        return ahead_m - (along_m - along[nearest]) + side * (turned_rad - turned[nearest])

    first = ahead_at(running.low.along_m, running.low.turned_rad)
    last = ahead_at(running.high.along_m, running.high.turned_rad)
    passing = Passing(
        covariance=covariance[nearest],
        left_m=left_m - bend * ahead_m * (tool.ahead_m + 0.5 * ahead_m),
        curvature_radpm=bend,
        first_m=jnp.where(fixed, ahead_m, first),
        last_m=jnp.where(fixed, ahead_m, last),
    )
    # Behind the oldest strip only the pass's beginning is known for what it was.
    lost = (nearest == running.strip_count) & ~running.begun_here & (ahead_m < -spacing_m)
    return passing, ~lost
