"""The sweep of the look-ahead: error and oscillation over look-ahead and speed, and what was chosen."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure

from lgprjax.report.style import CORRELATION_MAP, FAINT, INK, VERMILLION, picture, write_caption


@dataclass(frozen=True)
class LookAheadSweep:
    """What the picture shows.

    Attributes:
        look_ahead_m, speed_mps: axes of the sweep, rising.
        error_m: RMS distance of the anchor from the path; not-a-number where no run ended well.
        oscillation: what is left to and fro, in ``oscillation_label``'s unit; not-a-number as above.
        oscillation_label: what it is, with its unit.
        chosen_mps, chosen_m: the look-ahead over speed that was chosen.
        stable_m: shortest look-ahead that is stable at each speed; not-a-number where all of the sweep is.
    """

    look_ahead_m: Float[np.ndarray, " look"]
    speed_mps: Float[np.ndarray, " speed"]
    error_m: Float[np.ndarray, "look speed"]
    oscillation: Float[np.ndarray, "look speed"]
    oscillation_label: str
    chosen_mps: Float[np.ndarray, " step"]
    chosen_m: Float[np.ndarray, " step"]
    stable_m: Float[np.ndarray, " speed"]


def draw_look_ahead(sweep: LookAheadSweep, path: str | Path, *, title: str, caption: str, force: bool = False) -> None:
    """Draw both surfaces side by side, logarithmic colours, with the look-ahead chosen over speed.

    Raises:
        InputError: the file exists (without ``force``) or cannot be written.
    """
    with picture(path, 10.4, 5.2, force) as figure:
        left, right = figure.subplots(1, 2, sharey=True)
        _draw_surface(figure, left, sweep, 100.0 * sweep.error_m, "RMS error of the anchor (cm)")
        _draw_surface(figure, right, sweep, sweep.oscillation, sweep.oscillation_label)
        # A sweep may hold speeds at which nothing was stable.
        error = np.where(np.isfinite(sweep.error_m), sweep.error_m, np.inf)
        stable = np.isfinite(error).any(axis=0)
        left.plot(
            sweep.speed_mps[stable],
            sweep.look_ahead_m[np.argmin(error, axis=0)[stable]],
            "o",
            color="white",
            markeredgecolor=INK,
            markersize=5,
            label="least error of each speed",
        )
        left.set_ylabel("look-ahead (m)")
        left.legend(loc="upper left")
        figure.suptitle(title)
        write_caption(figure, caption)


def _draw_surface(
    figure: Figure, axes: Axes, sweep: LookAheadSweep, value: Float[np.ndarray, "look speed"], label: str
) -> None:
    axes.set_facecolor(FAINT)
    known = value[np.isfinite(value) & (value > 0.0)]
    low, high = (float(known.min()), float(known.max())) if known.size else (0.1, 1.0)
    # One corner, diverging or dead calm, must not take all of the colours.
    low = max(low, high / 300.0)
    mesh = axes.pcolormesh(
        sweep.speed_mps,
        sweep.look_ahead_m,
        np.ma.masked_invalid(value),
        norm=LogNorm(low, max(high, 1.01 * low)),
        cmap=colormaps[CORRELATION_MAP],
        shading="nearest",
    )
    figure.colorbar(mesh, ax=axes, label=label, extend="both")
    axes.plot(sweep.chosen_mps, sweep.chosen_m, color=VERMILLION, linewidth=2.0, label="chosen")
    if np.isfinite(sweep.stable_m).any():
        axes.plot(sweep.speed_mps, sweep.stable_m, color=INK, linewidth=1.6, linestyle="--", label="stability limit")
    axes.set_xlabel("speed (m/s)")
    axes.set_title(label.partition(" (")[0])
