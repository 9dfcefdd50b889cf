"""What was measured while a field was worked: depth, speed and the position's uncertainty over time, with the stops."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float
from matplotlib.axes import Axes
from matplotlib.ticker import NullFormatter

from lgprjax.report.style import BLUE, FAINT, GREEN, INK, MUTED, ORANGE, picture, runs_of, write_caption

# Between two recordings hours may pass: on the picture a second does.
_LONGEST_STEP_S = 1.0


@dataclass(frozen=True, kw_only=True)
class CoverChannelsPicture:
    """Channels over the moments of a record.

    Attributes:
        time_s: of each moment.
        depth_m, speed_mps: measured.
        sigma_m: of the position, along the worse axis.
        counts: cells counted.
        fixed: the GNSS position was a fixed one.
        stopped: there was a reason to stop.
    """

    time_s: Float[np.ndarray, " moment"]
    depth_m: Float[np.ndarray, " moment"]
    speed_mps: Float[np.ndarray, " moment"]
    sigma_m: Float[np.ndarray, " moment"]
    counts: Bool[np.ndarray, " moment"]
    fixed: Bool[np.ndarray, " moment"]
    stopped: Bool[np.ndarray, " moment"]


def draw_cover_channels(channels: CoverChannelsPicture, path: str | Path, *, force: bool = False) -> None:
    """Draw the channels over minutes of recording.

    Raises:
        InputError: the file exists (without ``force``) or cannot be written.
    """
    step_s = np.clip(np.diff(channels.time_s, prepend=channels.time_s[:1]), 0.0, _LONGEST_STEP_S)
    minutes = np.cumsum(step_s) / 60.0
    with picture(path, 9.0, 6.6, force) as figure:
        depth, speed, sigma = figure.subplots(3, 1, sharex=True)
        rows = (
            (depth, 100.0 * channels.depth_m, "depth (cm)", BLUE),
            (speed, channels.speed_mps, "speed (m/s)", GREEN),
            (sigma, 100.0 * channels.sigma_m, "position sigma (cm)", INK),
        )
        for axes, values, label, colour in rows:
            _shade(axes, minutes, channels.stopped, ORANGE, 0.45)
            axes.plot(minutes, np.where(channels.counts, values, np.nan), color=colour, linewidth=1.2)
            axes.plot(minutes, np.where(channels.counts, np.nan, values), color=FAINT, linewidth=0.9)
            axes.set_ylabel(label)
            axes.spines[["top", "right"]].set_visible(False)
        depth.invert_yaxis()
        if np.nanmax(channels.sigma_m, initial=0.0) > 0.0:
            sigma.set_yscale("log")
            sigma.yaxis.set_major_formatter("{x:g}")
            sigma.yaxis.set_minor_formatter(NullFormatter())
        _shade(sigma, minutes, ~channels.fixed, MUTED, 0.25)
        sigma.set_xlabel("minutes of recording")
        figure.suptitle("Measured while working")
        write_caption(
            figure,
            "Coloured: cells counted (tool told on, turning, at its depth, heading known); light grey: they did not. "
            "Orange: a reason to stop. Grey, below: no fixed GNSS position. Sigma: as the filter on board had it, "
            "along the worse axis.",
        )


def _shade(
    axes: Axes, minutes: Float[np.ndarray, " moment"], held: Bool[np.ndarray, " moment"], colour: str, alpha: float
) -> None:
    for first, last in runs_of(held):
        axes.axvspan(minutes[first], minutes[min(last, len(minutes) - 1)], color=colour, alpha=alpha, linewidth=0)
