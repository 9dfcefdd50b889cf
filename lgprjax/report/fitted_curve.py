"""Measured points, the curve fitted to them with its band, and what is left: one picture for several calibrations."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes

from lgprjax.report.style import BLUE, INK, MUTED, ORANGE, SKY, VERMILLION, picture, write_caption

_SERIES = ((BLUE, "o"), (VERMILLION, "s"), (ORANGE, "^"))


@dataclass(frozen=True)
class Points:
    """Measured values, drawn as one series.

    Attributes:
        label: in the legend.
        x, y: of each point.
        sigma: standard error of y; zeros where it is not known.
        fitted: the curve at x.
    """

    label: str
    x: Float[np.ndarray, " point"]
    y: Float[np.ndarray, " point"]
    sigma: Float[np.ndarray, " point"]
    fitted: Float[np.ndarray, " point"]


@dataclass(frozen=True)
class Curve:
    """A fitted curve.

    Attributes:
        label: in the legend.
        x, y: along the curve, x rising.
        low, high: 95 % band at each x.
    """

    label: str
    x: Float[np.ndarray, " step"]
    y: Float[np.ndarray, " step"]
    low: Float[np.ndarray, " step"]
    high: Float[np.ndarray, " step"]


def draw_fitted_curve(
    points: list[Points],
    curve: Curve,
    path: str | Path,
    *,
    title: str,
    x_label: str,
    y_label: str,
    residual_label: str,
    caption: str,
    residual_scale: float = 1.0,
    force: bool = False,
) -> None:
    """Draw points and curve above, residuals with the same x below.

    Args:
        points: up to three series.
        curve: what was fitted.
        path: the PNG.
        title, x_label, y_label, residual_label, caption: words.
        residual_scale: from the unit of y to that of the residual axis.
        force: replace a file that exists.

    Raises:
        InputError: the file exists (without ``force``) or cannot be written.
    """
    with picture(path, 7.6, 6.4, force) as figure:
        above, below = figure.subplots(2, 1, sharex=True, height_ratios=(2.2, 1.0))
        above.fill_between(curve.x, curve.low, curve.high, color=SKY, alpha=0.45, linewidth=0, label="95 % band")
        above.plot(curve.x, curve.y, color=INK, linewidth=1.2, label=curve.label)
        # The band is read off in the residuals: above, it is often thinner than the line.
        half = residual_scale * (curve.high - curve.y), residual_scale * (curve.low - curve.y)
        below.fill_between(curve.x, half[1], half[0], color=SKY, alpha=0.45, linewidth=0)
        below.axhline(0.0, color=INK, linewidth=0.8)
        for series, (colour, marker) in zip(points, _SERIES, strict=False):
            _draw_series(above, series.x, series.y, series.sigma, colour, marker, series.label)
            left = residual_scale * (series.y - series.fitted)
            _draw_series(below, series.x, left, residual_scale * series.sigma, colour, marker, "_")
        above.set_ylabel(y_label)
        below.set_ylabel(residual_label)
        below.set_xlabel(x_label)
        for axes in (above, below):
            axes.grid(color=MUTED, alpha=0.2, linewidth=0.6)
        above.legend(loc="best")
        figure.suptitle(title)
        write_caption(figure, caption)


def _draw_series(
    axes: Axes,
    x: Float[np.ndarray, " point"],
    y: Float[np.ndarray, " point"],
    sigma: Float[np.ndarray, " point"],
    colour: str,
    marker: str,
    label: str,
) -> None:
    bars = 1.96 * sigma if np.any(sigma > 0.0) else None
    axes.errorbar(x, y, bars, fmt=marker, color=colour, markersize=4, elinewidth=1.0, capsize=2, alpha=0.9, label=label)
