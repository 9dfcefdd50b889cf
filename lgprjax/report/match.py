"""The match view: live radargram against the map where it was matched, and against the map a little off."""

from pathlib import Path

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.image import AxesImage
from matplotlib.patches import Rectangle

from lgprjax.report.results import MatchExample
from lgprjax.report.style import AMPLITUDE_MAP, VERMILLION, exaggeration, outer_edges, picture, write_caption

_LIMIT_PERCENTILE = 99.0


def draw_match(example: MatchExample, path: str | Path, *, force: bool = False) -> None:
    """Draw map, live scan and their difference in one column, the same against the negative in the other.

    Raises:
        InputError: the file exists (without ``force``) or cannot be written.
    """
    limit = _amplitude_limit(example)
    columns = (("at the matched place", example.baseline), (f"{example.beside_m:.2g} m beside it", example.beside))
    with picture(path, 11.0, 8.4, force) as figure:
        grid = figure.subplots(3, 2, sharex=True, sharey=True)
        for column, (place, strip) in enumerate(columns):
            difference = example.live - strip
            titles = (
                f"map {place}",
                "live scan" if column == 0 else "live scan (the same)",
                f"live − map: {_residual(difference, example.live)}, r = {_strip_correlation(example.live, strip):.2f}",
            )
            for axes, values, title in zip(grid[:, column], (strip, example.live, difference), titles, strict=True):
                image = _draw_strip(axes, values, example, limit)
                axes.set_title(title)
            grid[2, column].set_xlabel("along-track distance (m)")
        for axes in grid[:, 0]:
            axes.set_ylabel("two-way travel time (ns)")
        for axes in grid[:, 1]:
            _add_depth_axis(axes, example.wave_speed_m_per_ns)
        if example.window_m is not None:
            for axes in grid[:2, 0]:
                _box_window(axes, example)
        figure.colorbar(image, ax=grid, shrink=0.5, pad=0.02, label="amplitude")
        figure.suptitle(
            f"Match of channel {example.channel}: correlation {example.correlation:.3f}, "
            f"margin {example.margin:.3f}, lag {example.lag_m:+.3f} m"
        )
        caption = (
            f"Gain: {example.gain}; the same for all panels. Grey limits: 0 ± the {_LIMIT_PERCENTILE:.0f}th percentile "
            "of map and live amplitudes. r over a difference is this channel's alone, over the strip shown."
        )
        if example.window_m is not None:
            caption += " Box: the scans that the fix was made from."
        # Twice, because the caption states a stretch that its own height changes.
        for _ in range(2):
            factor = exaggeration(grid[0, 0]) * 2.0 / example.wave_speed_m_per_ns
            write_caption(figure, f"{caption} Depth drawn ×{factor:.1f}.")


def _draw_strip(
    axes: Axes, values: Float[np.ndarray, "trace sample"], example: MatchExample, limit: float
) -> AxesImage:
    distance, time = outer_edges(example.distance_m), outer_edges(example.time_ns)
    return axes.imshow(
        values.T,
        cmap=AMPLITUDE_MAP,
        vmin=-limit,
        vmax=limit,
        aspect="auto",
        interpolation="antialiased",
        extent=(distance[0], distance[1], time[1], time[0]),
    )


def _amplitude_limit(example: MatchExample) -> float:
    amplitudes = np.abs(np.concatenate([example.baseline.ravel(), example.live.ravel()]))
    finite = amplitudes[np.isfinite(amplitudes)]
    # A silent strip still needs limits that differ.
    return float(np.percentile(finite, _LIMIT_PERCENTILE)) or 1.0 if finite.size else 1.0


def _strip_correlation(first: Float[np.ndarray, "trace sample"], second: Float[np.ndarray, "trace sample"]) -> float:
    both = np.isfinite(first) & np.isfinite(second)
    a, b = first[both].astype(np.float64), second[both].astype(np.float64)
    norm = np.sqrt((a @ a) * (b @ b))
    return float(a @ b / norm) if norm > 0 else 0.0


def _residual(difference: Float[np.ndarray, "trace sample"], live: Float[np.ndarray, "trace sample"]) -> str:
    finite = np.isfinite(difference)
    energy = float(np.sum(live[finite].astype(np.float64) ** 2))
    left = float(np.sum(difference[finite].astype(np.float64) ** 2))
    return f"{100.0 * left / energy:.0f} % of the live energy" if energy > 0 else "no energy"


def _add_depth_axis(axes: Axes, wave_speed_m_per_ns: float) -> None:
    axis = axes.secondary_yaxis(
        "right",
        functions=(
            lambda time_ns: np.multiply(time_ns, wave_speed_m_per_ns / 2.0),
            lambda depth_m: np.divide(depth_m, wave_speed_m_per_ns / 2.0),
        ),
    )
    axis.set_ylabel(f"depth (m), v = {wave_speed_m_per_ns:.2f} m/ns")


def _box_window(axes: Axes, example: MatchExample) -> None:
    assert example.window_m is not None
    first, last = example.window_m
    top, bottom = outer_edges(example.time_ns)
    # Inside the frame, or the axes would clip half of the line.
    inset = 0.015 * (bottom - top)
    corner, height = (first, top + inset), bottom - top - 2.0 * inset
    axes.add_patch(Rectangle(corner, last - first, height, fill=False, edgecolor=VERMILLION, linewidth=2.0))
