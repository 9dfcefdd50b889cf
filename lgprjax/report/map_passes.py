"""The ground of a map from above, straightened along its route: how often it was passed, how long ago, its holes."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float, Int
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.colors import BoundaryNorm, Colormap, ListedColormap, Normalize
from matplotlib.image import AxesImage

from lgprjax.report.style import (
    CORRELATION_MAP,
    FAINT,
    INK,
    MUTED,
    VERMILLION,
    outer_edges,
    picture,
    runs_of,
    write_caption,
)

PASSES = tuple(colormaps[CORRELATION_MAP](share) for share in (0.95, 0.75, 0.55, 0.35, 0.1))
"""One pass, two, and so on; the last one and more: darker the more often."""
_MARGIN = 0.06
"""Of the route's length, to its left: room for the scale bar."""


@dataclass(frozen=True, kw_only=True)
class MapPasses:
    """Cells of a map's ground, along its route and across it.

    Attributes:
        name: of the map.
        at_m, across_m: middles of the evenly spaced cells, along the route and to its left.
        passes: baselines that cover the whole of a cell; 0 where there is no ground.
        age_days: since the newest of them; NaN where there is no ground, or its day is not known.
        hole: cells under the route's array that no baseline covers.
        half_like_m: distance across at which the ground's signal has lost half of its likeness; None if not known.
        today: the day that ages are counted to.
    """

    name: str
    at_m: Float[np.ndarray, " place"]
    across_m: Float[np.ndarray, " cell"]
    passes: Int[np.ndarray, "place cell"]
    age_days: Float[np.ndarray, "place cell"]
    hole: Bool[np.ndarray, "place cell"]
    half_like_m: float | None
    today: str


def draw_passes(ground: MapPasses, path: str | Path, *, force: bool = False) -> None:
    """Draw passes above and age below, holes hatched, the distance of likeness as a bar across.

    Raises:
        InputError: the file exists (without ``force``) or cannot be written.
    """
    with picture(path, 11.0, 5.6, force) as figure:
        above, below = figure.subplots(2, 1, sharex=True, sharey=True)
        norm = BoundaryNorm(np.arange(0.5, len(PASSES) + 1.0), len(PASSES))
        counted = np.minimum(ground.passes, len(PASSES)).astype(np.float64)
        levels = _draw_cells(above, ground, np.where(ground.passes > 0, counted, np.nan), ListedColormap(PASSES), norm)
        ticks = [*map(str, range(1, len(PASSES))), f"≥ {len(PASSES)}"]
        bar = figure.colorbar(levels, ax=above, label="passes", pad=0.01, aspect=12)
        bar.set_ticks(list(range(1, len(PASSES) + 1)), labels=ticks)

        oldest = float(np.nanmax(ground.age_days)) if np.isfinite(ground.age_days).any() else 0.0
        span = Normalize(0.0, max(oldest, 1.0))
        newest = np.where(ground.passes > 0, ground.age_days, np.nan)
        ages = _draw_cells(below, ground, newest, colormaps[CORRELATION_MAP].reversed(), span)
        figure.colorbar(ages, ax=below, label="days since the newest pass", pad=0.01, aspect=12)

        for axes in (above, below):
            _hatch_holes(axes, ground)
            axes.set_ylabel("across (m)\nleft positive")
        _draw_scale(above, ground)
        low, high = outer_edges(ground.at_m)
        below.set_xlim(low - _MARGIN * (high - low), high)
        below.set_ylim(*_rows_in_sight(ground))
        below.set_xlabel("along the route (m)")
        holes = f"{int(ground.hole.any(axis=1).sum())} of {len(ground.at_m)} places with a hole"
        figure.suptitle(f"Map {ground.name}: {holes}")
        write_caption(figure, " ".join([*_notes(ground), f"Ages to {ground.today}."]))


def _rows_in_sight(ground: MapPasses) -> tuple[float, float]:
    """Across, from a cell beside the outermost ground, or hole, to a cell beside that on the other side."""
    low, high = outer_edges(ground.across_m)
    held = np.flatnonzero(((ground.passes > 0) | ground.hole).any(axis=0))
    if not len(held):
        return low, high
    cell_m = (high - low) / len(ground.across_m)
    return max(low + (held[0] - 1) * cell_m, low), min(low + (held[-1] + 2) * cell_m, high)


def _notes(ground: MapPasses) -> list[str]:
    low, high = outer_edges(ground.at_m)
    step_m = (high - low) / len(ground.at_m)
    notes = [f"Cells of {step_m:g} m along the route, straightened; a pass counts where it covers all of a cell."]
    if ground.hole.any():
        notes.append("Hatched, and marked above: holes under the route's array.")
    if ground.half_like_m is not None:
        notes.append("Bar: as far across, the ground's signal has lost half of its likeness to itself.")
    if not np.isfinite(ground.age_days[ground.passes > 0]).all():
        notes.append("Grey: the map does not say when that ground was passed.")
    return notes


def _draw_cells(
    axes: Axes, ground: MapPasses, value: Float[np.ndarray, "place cell"], cmap: Colormap, norm: Normalize
) -> AxesImage:
    along, across = outer_edges(ground.at_m), outer_edges(ground.across_m)
    # Ground of unknown value is grey, and no ground is white.
    known = np.where(ground.passes > 0, 1.0, np.nan)
    layers = ((known, ListedColormap([FAINT]), Normalize(0.0, 1.0)), (value, cmap, norm))
    for values, colours, scale in layers:
        image = axes.imshow(
            values.T,
            cmap=colours,
            norm=scale,
            origin="lower",
            aspect="auto",
            interpolation="nearest",
            extent=(*along, *across),
        )
    return image


def _hatch_holes(axes: Axes, ground: MapPasses) -> None:
    along, across = outer_edges(ground.at_m), outer_edges(ground.across_m)
    step_m, row_m = (along[1] - along[0]) / len(ground.at_m), (across[1] - across[0]) / len(ground.across_m)
    for row, held in enumerate(ground.hole.T):
        runs = [(along[0] + first * step_m, (last - first) * step_m) for first, last in runs_of(held)]
        if runs:
            rows = (across[0] + row * row_m, row_m)
            axes.broken_barh(runs, rows, facecolor="none", hatch="////", edgecolor=VERMILLION, linewidth=0.0)
    # A hole of a metre is no dot wide on a long route.
    for first, last in runs_of(np.asarray(ground.hole.any(axis=1))):
        middle = along[0] + 0.5 * (first + last) * step_m
        axes.plot(middle, 1.0, "v", color=VERMILLION, ms=6, transform=axes.get_xaxis_transform(), clip_on=False)


def _draw_scale(axes: Axes, ground: MapPasses) -> None:
    if ground.half_like_m is None:
        return
    low, high = outer_edges(ground.at_m)
    x, half = low - 0.6 * _MARGIN * (high - low), 0.5 * ground.half_like_m
    axes.errorbar([x], [0.0], yerr=[half], color=INK, elinewidth=2.0, capsize=4.0, fmt="none")
    axes.annotate(
        f"{ground.half_like_m:.2f} m",
        (x, half),
        xytext=(0, 5),
        textcoords="offset points",
        ha="center",
        fontsize=9.0,
        color=MUTED,
    )
