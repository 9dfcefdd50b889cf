"""The correlation over position: where the search looked, what it chose, and what it chose it over."""

import math
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.patches import Ellipse, Rectangle

from lgprjax.report.results import CorrelationSurface
from lgprjax.report.style import CORRELATION_MAP, UNSCORED, VERMILLION, outer_edges, picture, write_caption

# White over a dark edge stays visible on every shade of the map; the shapes tell the marks apart in print.
_MARK: dict[str, Any] = {"color": "white", "markeredgecolor": "black", "linestyle": "none"}


def draw_surface(surface: CorrelationSurface, path: str | Path, *, force: bool = False) -> None:
    """Draw the correlation 0 to 1 with search box, prior, best, runner-up and truth, at equal aspect.

    Raises:
        InputError: the file exists (without ``force``) or cannot be written.
    """
    # A search box wider than the surface must stay in sight.
    limits = [
        _span(outer_edges(centres), prior - half, prior + half)
        for centres, prior, half in zip((surface.x_m, surface.y_m), surface.prior, surface.half_width_m, strict=True)
    ]
    width, height = (high - low for low, high in limits)
    with picture(path, 7.6, 2.2 + float(np.clip(5.6 * height / width, 2.5, 8.0)), force) as figure:
        axes = figure.subplots()
        axes.set_facecolor(UNSCORED)
        image = axes.imshow(
            surface.correlation.T,
            cmap=colormaps[CORRELATION_MAP].with_extremes(bad=UNSCORED),
            vmin=0.0,
            vmax=1.0,
            origin="lower",
            aspect="equal",
            interpolation="nearest",
            extent=(*outer_edges(surface.x_m), *outer_edges(surface.y_m)),
        )
        figure.colorbar(image, ax=axes, label="correlation", extend="min", shrink=0.8)
        _draw_prior(axes, surface)
        _draw_marks(axes, surface)
        axes.set_xlim(*limits[0])
        axes.set_ylim(*limits[1])
        axes.set_xlabel(f"{surface.axes[0]} (m)")
        axes.set_ylabel(f"{surface.axes[1]} (m)")
        highest = surface.correlation[np.isfinite(surface.correlation)]
        peak = f"highest {highest.max():.3f}" if highest.size else "all of it off the map"
        figure.suptitle(f"Correlation over position: {peak}")
        axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.14), ncols=3, facecolor="#b8b8b8", framealpha=1.0)
        miss = "" if surface.truth is None else f" Best to truth: {math.dist(surface.best, surface.truth):.3f} m."
        write_caption(
            figure,
            f"Metres relative to {surface.origin}. Ellipses: prior, 1 and 3 σ.{miss} Grey: off the map or not scored.",
        )


def _draw_prior(axes: Axes, surface: CorrelationSurface) -> None:
    (x, y), (half_x, half_y), (sigma_x, sigma_y) = surface.prior, surface.half_width_m, surface.prior_sigma_m
    box = Rectangle((x - half_x, y - half_y), 2 * half_x, 2 * half_y, fill=False, edgecolor="white", linewidth=1.8)
    box.set_label("search box")
    axes.add_patch(box)
    for number in (1.0, 3.0):
        size = (2 * number * sigma_x, 2 * number * sigma_y)
        ellipse = Ellipse((x, y), *size, angle=np.degrees(surface.prior_tilt_rad), fill=False, edgecolor="white")
        ellipse.set_linestyle((0, (4, 2)))
        ellipse.set_label("prior" if number == 1.0 else "_")
        axes.add_patch(ellipse)


def _draw_marks(axes: Axes, surface: CorrelationSurface) -> None:
    axes.plot(*surface.prior, marker="+", color="white", markersize=12, linestyle="none", label="prior, centre")
    if surface.second is not None:
        axes.plot(*surface.second, marker="s", markersize=9, label="second best", **_MARK)
    if surface.truth is not None:
        axes.plot(
            *surface.truth, marker="x", color=VERMILLION, markersize=9, mew=2.0, ls="none", label="truth", zorder=4
        )
    axes.plot(*surface.best, marker="*", markersize=15, label="best", zorder=3, **_MARK)


def _span(edges: tuple[float, float], low: float, high: float) -> tuple[float, float]:
    margin = 0.03 * (high - low)
    return min(edges[0], low - margin), max(edges[1], high + margin)
