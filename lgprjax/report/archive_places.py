"""Where on a map drives find themselves and where they do not: the plan of all drives in cells, the worst marked."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure

from lgprjax.report.style import CORRELATION_MAP, GAP, MUTED, VERMILLION, picture, write_caption

_MOST_CELLS = 240  # along the longer side: finer ones could not be seen
_WIDTH_IN = 11.0
_LEAST_SHAPE = 0.12  # height of a plan by its width
_ERROR_MAP = "magma_r"
_LIMIT_M = 0.3


@dataclass(frozen=True, kw_only=True)
class ArchivePlaces:
    """Scans of all drives in square cells of the map's plane.

    Attributes:
        name: of the map.
        cell_m: side of a cell.
        cell: number of each, its south-west corner east and north of the anchor in cells.
        tried, ok, judged: scans searched, with an ok fix, of these with a known truth.
        square_m2: sum of the squared errors of the judged.
        worst_m: middles of the worst places, in order.
        chords_m: of the map's baselines, stretch by stretch from end to end.
    """

    name: str
    cell_m: float
    cell: Int[np.ndarray, "cell 2"]
    tried: Int[np.ndarray, " cell"]
    ok: Int[np.ndarray, " cell"]
    judged: Int[np.ndarray, " cell"]
    square_m2: Float[np.ndarray, " cell"]
    worst_m: Float[np.ndarray, "place 2"]
    chords_m: Float[np.ndarray, "chord 2 2"]


def draw_archive_places(places: ArchivePlaces, path: str | Path, *, force: bool = False) -> None:
    """Draw the share of scans with an ok fix and, where truth is known, the errors; equal scale, north up.

    Raises:
        InputError: the file exists (without ``force``) or cannot be written.
    """
    low, high = places.cell.min(axis=0), places.cell.max(axis=0) + 1
    together = 1 << max(0, int(np.ceil(np.log2(np.max(high - low) / _MOST_CELLS))))
    cell_m = places.cell_m * together
    cell = np.floor_divide(places.cell, together)
    first = cell.min(axis=0)
    shape = tuple(int(n) for n in cell.max(axis=0) - first + 1)
    tried, ok, judged, square = (
        _gridded(cell - first, values, shape) for values in (places.tried, places.ok, places.judged, places.square_m2)
    )
    known = bool(judged.any())
    size_m = cell_m * np.array(shape)
    flat = float(np.clip(size_m[1] / size_m[0], _LEAST_SHAPE, 1.1))
    with picture(path, _WIDTH_IN, 1.4 + (1 + known) * (0.8 + 0.82 * _WIDTH_IN * flat), force) as figure:
        panels = figure.subplots(1 + known, 1, sharex=True, squeeze=False)[:, 0]
        edges = (cell_m * first[0], cell_m * first[1], *(cell_m * first + size_m))
        share = 100.0 * ok / np.where(tried > 0, tried, np.nan)
        _draw(figure, panels[0], share, edges, "scans with an ok fix (%)", CORRELATION_MAP, 100.0)
        if known:
            rms_m = np.sqrt(square / np.where(judged > 0, judged, np.nan))
            _draw(figure, panels[1], rms_m, edges, "RMS error of ok fixes (m)", _ERROR_MAP, _LIMIT_M)
        for axes in panels:
            _mark(axes, places)
            axes.set_ylabel("north of the anchor (m)")
            _set_limits(axes, edges)
        panels[-1].set_xlabel("east of the anchor (m)")
        figure.suptitle(f"Where drives on {places.name} find themselves")
        write_caption(
            figure,
            f"Cells of {cell_m:g} m; grey: no drive came by. Thin lines: the map's baselines. Numbered: the worst, "
            "as in the table. A scan counts where its truth is, or its ok fix, or its prior.",
        )


def _gridded(
    cell: Int[np.ndarray, "cell 2"], values: np.ndarray, shape: tuple[int, ...]
) -> Float[np.ndarray, "east north"]:
    grid = np.zeros(shape)
    np.add.at(grid, (cell[:, 0], cell[:, 1]), values)
    return grid


def _draw(
    figure: Figure,
    axes: Axes,
    values: Float[np.ndarray, "east north"],
    edges: tuple[float, ...],
    label: str,
    colours: str,
    limit: float,
) -> None:
    west, south, east, north = edges
    axes.set_facecolor(GAP)
    image = axes.imshow(
        np.ma.masked_invalid(values.T),
        cmap=colours,
        vmin=0.0,
        vmax=limit,
        origin="lower",
        extent=(west, east, south, north),
        interpolation="nearest",
        aspect="equal",
    )
    extend = "max" if np.nanmax(values, initial=0.0) > limit else "neither"
    figure.colorbar(image, ax=axes, label=label, pad=0.01, aspect=12, extend=extend)


def _mark(axes: Axes, places: ArchivePlaces) -> None:
    axes.add_collection(LineCollection(list(places.chords_m), colors=MUTED, linewidths=0.6))
    for number, (east, north) in enumerate(places.worst_m, start=1):
        axes.plot(east, north, "o", markersize=11, markerfacecolor="white", markeredgecolor=VERMILLION, mew=1.4)
        axes.text(east, north, str(number), ha="center", va="center", fontsize=7.5, clip_on=True)


def _set_limits(axes: Axes, edges: tuple[float, ...]) -> None:
    """A road is thin: beside it there is room for what is marked on it."""
    west, south, east, north = edges
    half_m = 0.53 * np.array([east - west, north - south])
    half_m = np.maximum(half_m, 0.5 * _LEAST_SHAPE * 2.0 * half_m.max())
    axes.set_xlim(0.5 * (west + east) - half_m[0], 0.5 * (west + east) + half_m[0])
    axes.set_ylim(0.5 * (south + north) - half_m[1], 0.5 * (south + north) + half_m[1])
