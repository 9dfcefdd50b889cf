"""Pictures of a field worked by a simulated mini-flail: its plan, the ground worked, and the probability of it."""

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap
from matplotlib.image import AxesImage
from matplotlib.patches import Patch, Polygon
from scipy.special import ndtr

from lgprjax.coverage import (
    CellGrid,
    Field,
    Pattern,
    PatternSettings,
    ToolMoment,
    cell_states,
    grid_of_field,
    init_worked,
    inside_cells,
    plan_pattern,
    run_worked,
)
from lgprjax.coverage.field import field_of_polygon
from lgprjax.report.coverage import COLOURS, level_colours
from lgprjax.simulation.field_loop import (
    FieldLoopSpec,
    FieldMoment,
    made_up_field_world,
    made_up_tool,
    rectangle_course,
    run_fields,
)
from pictures.style import BLUE, GREEN, INK, MUTED, VERMILLION, chart, mark_figure

LENGTH_M, WIDTH_M, TOOL_M, OVERLAP_M = 20.0, 12.0, 1.2, 0.15
OFF_S, EVERY_S = 60.0, 120.0
_SEED = 11
_CELL_M = 0.1
_MOMENTS = 7_400
"""The field is not finished: the picture shows ground that is not worked yet."""
_LEVELS = (0.95, 0.99)


@dataclass(frozen=True)
class Worked:
    """A field that was worked.

    Attributes:
        field, pattern: the plan.
        grid: of the cells.
        probability: that the tool was over each cell.
        inside: cells of the field.
        track_m: estimated places of the vehicle, of the moments that the tool worked.
        heard: GNSS was received, at these moments.
    """

    field: Field
    pattern: Pattern
    grid: CellGrid
    probability: Float[np.ndarray, "north east"]
    inside: Bool[np.ndarray, "north east"]
    track_m: Float[np.ndarray, "moment 2"]
    heard: Bool[np.ndarray, " moment"]


class SampleField:
    """A rectangle of 20 x 12 m, partly worked in closed loop with GNSS off for half of the time."""

    @cached_property
    def worked(self) -> Worked:
        """The drive, and the ground that it worked."""
        settings = PatternSettings(TOOL_M, OVERLAP_M / TOOL_M, "zamboni", 1.5, 8.0, 1.2)
        tool = made_up_tool()
        course = rectangle_course(LENGTH_M, WIDTH_M, settings, tool)
        world = made_up_field_world(off_s=OFF_S, every_s=EVERY_S)
        spec = FieldLoopSpec(moments=_MOMENTS)
        key = jax.random.split(jax.random.key(_SEED), 1)
        lanes = run_fields(spec, world, course.route, course.fence, key)
        kept: FieldMoment = jax.tree.map(lambda leaf: np.asarray(leaf)[:, 0], lanes)
        on = np.asarray(kept.engaged & ~kept.done & (kept.tool > 0.5))
        grid = grid_of_field(course.field, _CELL_M, TOOL_M)
        moments = ToolMoment(
            jnp.asarray(kept.believed.x_m),
            jnp.asarray(kept.believed.y_m),
            jnp.asarray(kept.believed.yaw_rad),
            jnp.asarray(kept.covariance),
            jnp.asarray(on),
        )
        state = run_worked(grid, tool, init_worked(grid), moments)
        corners = np.array([[0.0, 0.0], [LENGTH_M, 0.0], [LENGTH_M, WIDTH_M], [0.0, WIDTH_M]])
        pattern = plan_pattern(field_of_polygon(corners, name="field"), settings, name="field")
        return Worked(
            field=course.field,
            pattern=pattern,
            grid=grid,
            probability=np.asarray(state.probability),
            inside=inside_cells(course.field, grid),
            track_m=np.stack([kept.believed.x_m, kept.believed.y_m], axis=1)[on],
            heard=np.asarray(kept.heard)[on],
        )


def _frame(axes: Axes, worked: Worked) -> None:
    axes.add_patch(Polygon(worked.field.perimeter_m, fill=False, edgecolor=INK, linewidth=2.0))
    axes.set_aspect("equal")
    axes.set_xlim(-1.6, LENGTH_M + 1.6)
    axes.set_ylim(-0.6, WIDTH_M + 0.6)
    axes.set_ylabel("north (m)")


def _image(axes: Axes, worked: Worked, values: np.ndarray, **style: Any) -> AxesImage:
    grid = worked.grid
    extent = (
        grid.east_m,
        grid.east_m + grid.east_cells * grid.cell_m,
        grid.north_m,
        grid.north_m + grid.north_cells * grid.cell_m,
    )
    shown = np.ma.masked_array(values, ~worked.inside)
    return axes.imshow(shown, origin="lower", extent=extent, interpolation="nearest", aspect="equal", **style)


def draw_field_coverage(field: SampleField, path: Path) -> None:
    """Draw the plan above the ground worked."""
    worked = field.worked
    with chart(path, 11.6) as figure:
        plan, done = figure.subplots(2, 1, sharex=True)
        order = np.linspace(0.0, 0.85, len(worked.pattern.lines))
        for number, (line, share) in enumerate(zip(worked.pattern.lines, order, strict=True)):
            (x0, y0), (x1, y1) = np.asarray(line.start_m), np.asarray(line.end_m)
            colour = (0.0, 0.27 + 0.5 * share, 0.42 + 0.5 * share)
            plan.annotate("", (x1, y1), (x0, y0), arrowprops={"arrowstyle": "-|>", "color": colour, "linewidth": 1.8})
            if number < 3:
                plan.text(
                    x0 + (-0.8 if x0 < x1 else 0.8), y0, str(number + 1), ha="center", va="center", fontweight="bold"
                )
        _frame(plan, worked)
        plan.set_title(f"Plan: {len(worked.pattern.lines)} swaths")
        colours = (*COLOURS[:2], *level_colours(2))
        states = [cell_states(worked.probability, level) for level in _LEVELS]
        kinds = states[0] + (states[1] == 2)
        _image(done, worked, kinds, cmap=ListedColormap(colours), vmin=-0.5, vmax=3.5)
        _frame(done, worked)
        done.plot(*worked.track_m[-1], ">", color="white", markeredgecolor=INK, markersize=18)
        done.set_xlabel("east (m)")
        done.set_title(f"Worked so far; GNSS off {OFF_S:g} s of every {EVERY_S:g} s")
        words = ("not worked", "uncertain", "worked to 95 %", "worked to 99 %")
        inside = kinds[worked.inside]
        patches = [
            Patch(facecolor=colour, edgecolor=MUTED, label=f"{word}: {100.0 * np.mean(inside == kind):.1f} %")
            for kind, (colour, word) in enumerate(zip(colours, words, strict=True))
        ]
        figure.legend(handles=patches[::-1], loc="outside lower center", ncols=2)
        mark_figure(figure)


_SIGMAS_M = (0.02, 0.1, 0.25)


def draw_worked_probability(field: SampleField, path: Path) -> None:
    """Draw the probability of every cell of the field, and that across one swath for three uncertainties."""
    worked = field.worked
    with chart(path, 9.8) as figure:
        plan, section = figure.subplots(2, 1, height_ratios=(1.6, 1.0))
        image = _image(plan, worked, worked.probability, cmap="viridis", vmin=0.0, vmax=1.0)
        figure.colorbar(image, ax=plan, location="bottom", aspect=30, pad=0.02)
        plan.set_title("Probability that the tool worked it")
        _frame(plan, worked)
        across = np.linspace(-1.1, 1.1, 441)
        for sigma_m, colour, style in zip(_SIGMAS_M, (BLUE, GREEN, VERMILLION), ("-", "--", "-."), strict=True):
            section.plot(
                across, _probability(across, sigma_m), style, color=colour, lw=3.0, label=f"{100.0 * sigma_m:g} cm"
            )
        section.axhline(_LEVELS[0], color=INK, linewidth=1.4, linestyle=":")
        section.text(-1.08, 0.92, "95 %", va="top")
        section.set_title("Across one swath, by position sigma")
        section.set_xlim(-1.1, 1.1)
        section.set_ylim(0.0, 1.03)
        section.set_xlabel("from the middle of a tool of 1.2 m (m)")
        section.set_ylabel("probability")
        section.legend(loc="lower center")
        mark_figure(figure)


def _probability(across_m: Float[np.ndarray, " place"], sigma_m: float) -> Float[np.ndarray, " place"]:
    """That a tool with a normal error across its swath passed a place."""
    half_m = 0.5 * TOOL_M
    return np.asarray(ndtr((half_m - across_m) / sigma_m) - ndtr((-half_m - across_m) / sigma_m))
