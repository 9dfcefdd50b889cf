"""A particle swarm at work on one fix: where its particles stand, and what the best and the median of them know."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.image import AxesImage

from lgprjax.report.style import (
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
)

_SHARES = (0.0, 0.125, 1.0 / 3.0, 1.0)
"""Of the iterations, at which the cloud is shown: a swarm gathers early."""


@dataclass(frozen=True, kw_only=True)
class SwarmPicture:
    """A swarm's search for one fix.

    Attributes:
        x_m, y_m: evenly spaced positions, relative to ``origin``.
        score: what the swarm climbs over them, the rest of the pose as the swarm left it; NaN where there is none.
        particle_m: where the particles stood at the start and after each iteration.
        best_m: the best place that any of them had met by then.
        best_score: the best score that each of them had met by then; not finite before it met any.
        milliseconds: that a scan of the drive took.
        origin: what the zero of the axes is.
        axes: names of x and y.
        truth: position, where it is known.
    """

    x_m: Float[np.ndarray, " i"]
    y_m: Float[np.ndarray, " j"]
    score: Float[np.ndarray, "i j"]
    particle_m: Float[np.ndarray, "iteration particle 2"]
    best_m: Float[np.ndarray, "iteration 2"]
    best_score: Float[np.ndarray, "iteration particle"]
    milliseconds: float
    origin: str
    axes: tuple[str, str] = ("along", "cross")
    truth: tuple[float, float] | None = None


def draw_swarm(swarm: SwarmPicture, path: str | Path, *, force: bool = False) -> None:
    """Draw the cloud at four moments over the score, and below the best and the median score over the iterations.

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
        # Outside, or it would hide what it explains.
        above.legend(*clouds[-1].get_legend_handles_labels(), loc="outside lower center", ncols=3, frameon=False)
        _draw_scores(below.subplots(), swarm, moments)
        figure.suptitle(
            f"Swarm of {particles} particles, {iterations} iterations: {particles * (iterations + 1)} evaluations; "
            f"{swarm.milliseconds:.3g} ms a scan"
        )
        miss = "" if swarm.truth is None else f" Best to truth: {np.hypot(*(swarm.best_m[-1] - swarm.truth)):.3f} m."
        write_caption(
            figure,
            f"Metres relative to {swarm.origin}. Colours: the score over position, the rest of the pose as the swarm "
            "left it; the particles differ in that too. The time is that of the whole registration, coarse stage "
            f"included.{miss}",
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


def _draw_scores(axes: Axes, swarm: SwarmPicture, moments: list[int]) -> None:
    known = np.isfinite(swarm.best_score)
    iteration = np.arange(len(known))
    # A particle that met nothing counts in the median as the worst, and has no place in the picture.
    score = np.where(known, swarm.best_score, -np.inf)
    best, middle = score.max(axis=1), np.sort(score, axis=1)[:, (score.shape[1] - 1) // 2]
    for moment in moments:
        axes.axvline(moment, color=MUTED, linewidth=0.9, linestyle=":")
    for values, colour, style, label in ((best, BLUE, "-", "best"), (middle, ORANGE, "--", "median")):
        axes.plot(iteration, np.where(np.isfinite(values), values, np.nan), style, color=colour, lw=2.0, label=label)
    if not known.any():
        axes.text(0.5, 0.5, "no particle met the map", transform=axes.transAxes, ha="center", va="center", color=INK)
    axes.set_xlim(-0.02 * max(len(known) - 1, 1), max(1.02 * (len(known) - 1), 1.0))
    axes.set_xlabel("iteration (dotted: the clouds above)")
    axes.set_ylabel("best score met\nby a particle")
    axes.spines[["top", "right"]].set_visible(False)
    axes.legend(loc="lower right", edgecolor="none")
