"""The match view: live radargram against the map where it was matched, and against the map nearby."""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.image import AxesImage
from matplotlib.patches import Ellipse, Rectangle

from lgprjax.report.results import CorrelationSurface, MatchExample
from lgprjax.report.style import (
    AMPLITUDE_MAP,
    BLUE,
    CORRELATION_MAP,
    INK,
    MUTED,
    ORANGE,
    UNSCORED,
    VERMILLION,
    outer_edges,
    picture,
    write_caption,
    write_stretch_caption,
)

_LIMIT_PERCENTILE = 99.0


def draw_match(example: MatchExample, path: str | Path, *, force: bool = False) -> None:
    """Draw map, live scan and their difference in one column, the same against the negative in the other.

    Raises:
        InputError: the file exists (without ``force``) or cannot be written.
    """
    limit = _amplitude_limit(example)
    columns = (("at the matched place", example.baseline), (f"{example.beside_m:.2g} m away", example.beside))
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
            "of map and live amplitudes. r above a difference: correlation of this channel over the strip."
        )
        if example.window_m is not None:
            caption += " Box: scans of the fix."
        write_stretch_caption(grid[0, 0], caption, "Depth", example.wave_speed_m_per_ns / 2.0)


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
    # A silent strip still needs different limits.
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


# A particle swarm searching for one fix: positions of its particles, and best and median score.

_SHARES = (0.0, 0.125, 1.0 / 3.0, 1.0)
"""Shares of the iterations at which the cloud is shown: a swarm converges early."""


@dataclass(frozen=True, kw_only=True)
class SwarmPicture:
    """A swarm's search for one fix.

    Attributes:
        x_m, y_m: evenly spaced positions, relative to ``origin``.
        score: the objective over them, with the rest of the pose as the swarm left it; NaN if missing.
        particle_m: positions of the particles at the start and after each iteration.
        best_m: the best place found by any of them so far.
        offset: height (m), heading and roll (degrees, counter-clockwise) of the particles, less the prior's.
        best_offset: offset of the best place.
        best_score: the best score found by each of them so far; not finite before the first.
        milliseconds: time per scan of the drive.
        origin: meaning of the axes' zero.
        axes: names of x and y.
        truth: position, if known.
    """

    x_m: Float[np.ndarray, " i"]
    y_m: Float[np.ndarray, " j"]
    score: Float[np.ndarray, "i j"]
    particle_m: Float[np.ndarray, "iteration particle 2"]
    best_m: Float[np.ndarray, "iteration 2"]
    offset: Float[np.ndarray, "iteration particle 3"]
    best_offset: Float[np.ndarray, "iteration 3"]
    best_score: Float[np.ndarray, "iteration particle"]
    milliseconds: float
    origin: str
    axes: tuple[str, str] = ("along", "cross")
    truth: tuple[float, float] | None = None


def draw_swarm(swarm: SwarmPicture, path: str | Path, *, force: bool = False) -> None:
    """Draw the cloud at four moments over the score; below, over the iterations, height, heading and roll of the
    particles, and the best and the median score.

    Raises:
        InputError: the file exists (without ``force``) or cannot be written.
    """
    iterations, particles = len(swarm.best_score) - 1, swarm.best_score.shape[1]
    moments = sorted({round(share * iterations) for share in _SHARES})
    with picture(path, 11.0, 6.6, force) as figure:
        above, below = figure.subfigures(2, 1, squeeze=False, height_ratios=(1.15, 1.0))[:, 0]
        clouds = above.subplots(1, len(moments), sharex=True, sharey=True, squeeze=False)[0]
        for axes, moment in zip(clouds, moments, strict=True):
            image = _draw_cloud(axes, swarm, moment)
        clouds[0].set_ylabel(f"{swarm.axes[1]} (m)")
        above.colorbar(image, ax=clouds, label="score", extend="min", shrink=0.8, pad=0.01)
        # Outside, or it would hide the picture.
        above.legend(*clouds[-1].get_legend_handles_labels(), loc="outside lower center", ncols=3, frameon=False)
        *spreads, scores = below.subplots(1, 4, gridspec_kw={"width_ratios": (1.0, 1.0, 1.0, 1.3)})
        for axis, (axes, label) in enumerate(zip(spreads, _OFFSETS, strict=True)):
            _draw_spread(axes, swarm.offset[..., axis], swarm.best_offset[:, axis], label)
        _draw_scores(scores, swarm, moments)
        evaluations = particles * (iterations + 1)
        took = f"; {swarm.milliseconds:.3g} ms per scan" if np.isfinite(swarm.milliseconds) else ""
        above.suptitle(f"Swarm of {particles} particles, {iterations} iterations: {evaluations} evaluations{took}")
        miss = (
            ""
            if swarm.truth is None
            else f" Error of the best position: {np.hypot(*(swarm.best_m[-1] - swarm.truth)):.3f} m."
        )
        write_caption(
            figure,
            f"Metres relative to {swarm.origin}. Colours: score over position at the swarm's final height, heading "
            "and roll; particles differ in these as well. Height, heading and roll: minus the log's values; bands hold "
            f"80 % and all of the particles. The time is for the whole registration.{miss}",
        )


def _draw_cloud(axes: Axes, swarm: SwarmPicture, moment: int) -> AxesImage:
    axes.set_facecolor(UNSCORED)
    edges = (*outer_edges(swarm.x_m), *outer_edges(swarm.y_m))
    image = axes.imshow(
        swarm.score.T,
        cmap=colormaps[CORRELATION_MAP].with_extremes(bad=UNSCORED),
        vmin=0.0,
        vmax=1.0,
        origin="lower",
        aspect="equal",
        interpolation="nearest",
        extent=edges,
    )
    cloud = swarm.particle_m[moment]
    axes.plot(*cloud.T, "o", color="white", markeredgecolor="black", markersize=4.5, label="particle")
    if swarm.truth is not None:
        axes.plot(*swarm.truth, "x", color=VERMILLION, markersize=9, mew=2.0, label="truth", zorder=4)
    axes.plot(
        *swarm.best_m[moment], "*", color="white", markeredgecolor="black", markersize=15, label="best so far", zorder=3
    )
    axes.set_xlim(*edges[:2])
    axes.set_ylim(*edges[2:])
    axes.set_xlabel(f"{swarm.axes[0]} (m)")
    axes.set_title("start" if moment == 0 else f"iteration {moment}")
    return image


_OFFSETS = ("height (m)", "heading (°)", "roll (°)")


def _draw_spread(
    axes: Axes, value: Float[np.ndarray, "iteration particle"], best: Float[np.ndarray, " iteration"], label: str
) -> None:
    iteration = np.arange(len(value))
    for share, shade in ((0.0, 0.18), (0.1, 0.4)):
        low, high = np.quantile(value, [share, 1.0 - share], axis=1)
        axes.fill_between(iteration, low, high, color=BLUE, alpha=shade, linewidth=0.0)
    axes.plot(iteration, best, color=INK, linewidth=1.6)
    axes.set_title(label)
    axes.set_xlabel("line: best")
    axes.spines[["top", "right"]].set_visible(False)


def _draw_scores(axes: Axes, swarm: SwarmPicture, moments: list[int]) -> None:
    known = np.isfinite(swarm.best_score)
    iteration = np.arange(len(known))
    # A particle without a score counts as the worst in the median, and is not drawn.
    score = np.where(known, swarm.best_score, -np.inf)
    best, middle = score.max(axis=1), np.sort(score, axis=1)[:, (score.shape[1] - 1) // 2]
    for moment in moments:
        axes.axvline(moment, color=MUTED, linewidth=0.9, linestyle=":")
    for values, colour, style, label in ((best, BLUE, "-", "best"), (middle, ORANGE, "--", "median")):
        axes.plot(iteration, np.where(np.isfinite(values), values, np.nan), style, color=colour, lw=2.0, label=label)
    if not known.any():
        axes.text(0.5, 0.5, "no particle is on the map", transform=axes.transAxes, ha="center", va="center", color=INK)
    axes.set_xlim(-0.02 * max(len(known) - 1, 1), max(1.02 * (len(known) - 1), 1.0))
    axes.set_xlabel("iteration (dotted: the clouds above)")
    axes.set_title("best score found by a particle")
    axes.spines[["top", "right"]].set_visible(False)
    axes.legend(loc="lower right", edgecolor="none")


# The correlation over position: search region, choice, and rivals.

# White with a dark edge is visible on every shade of the map; the shapes distinguish the marks in print.
_MARK: dict[str, Any] = {"color": "white", "markeredgecolor": "black", "linestyle": "none"}


def draw_surface(surface: CorrelationSurface, path: str | Path, *, force: bool = False) -> None:
    """Draw the correlation 0 to 1 with search box, prior, best, runner-up and truth, at equal aspect.

    Raises:
        InputError: the file exists (without ``force``) or cannot be written.
    """
    # A search box wider than the surface must stay visible.
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
        peak = f"highest {highest.max():.3f}" if highest.size else "all outside the map"
        if surface.at_best is not None:
            peak = f"{surface.at_best:.3f} at the best position"
        figure.suptitle(f"Correlation over position: {peak}")
        axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.14), ncols=3, facecolor="#b8b8b8", framealpha=1.0)
        miss = (
            ""
            if surface.truth is None
            else f" Error of the best position: {math.dist(surface.best, surface.truth):.3f} m."
        )
        write_caption(
            figure,
            f"Metres relative to {surface.origin}. Heading, roll and height are the fix's. Ellipses: prior, 1 and 3 "
            f"σ.{miss} Grey: off the map, or outside of the search.",
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
