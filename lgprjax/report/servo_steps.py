"""Responses of the steering servo: command, what the wheels did, what the model says, and what is left."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float

from lgprjax.report.style import BLUE, MUTED, ORANGE, VERMILLION, picture, write_caption


@dataclass(frozen=True)
class ServoResponse:
    """Front wheel angles over time.

    Attributes:
        time_s: of the records.
        command_rad: what the servo was told.
        measured_rad: what the wheels did.
        model_rad: the identified servo under the same commands.
    """

    time_s: Float[np.ndarray, " record"]
    command_rad: Float[np.ndarray, " record"]
    measured_rad: Float[np.ndarray, " record"]
    model_rad: Float[np.ndarray, " record"]


def draw_servo_steps(
    response: ServoResponse, path: str | Path, *, title: str, caption: str, force: bool = False
) -> None:
    """Draw the whole drive, the largest step close by, and the residuals.

    Raises:
        InputError: the file exists (without ``force``) or cannot be written.
    """
    time_s = response.time_s
    left_deg = np.degrees(response.measured_rad - response.model_rad)
    at = _largest_step(response)
    with picture(path, 9.6, 6.6, force) as figure:
        grid = figure.add_gridspec(2, 2, height_ratios=(2.0, 1.0), width_ratios=(2.0, 1.0))
        whole, close = figure.add_subplot(grid[0, 0]), figure.add_subplot(grid[0, 1])
        rest = figure.add_subplot(grid[1, 0], sharex=whole)
        near = figure.add_subplot(grid[1, 1], sharex=close)
        for axes in (whole, close):
            axes.step(
                time_s, np.degrees(response.command_rad), where="post", color=ORANGE, linewidth=1.2, label="command"
            )
            axes.plot(time_s, np.degrees(response.measured_rad), ".", color=BLUE, markersize=2.5, label="measured")
            axes.plot(time_s, np.degrees(response.model_rad), color=VERMILLION, linewidth=1.2, label="model")
        for axes in (rest, near):
            axes.axhline(0.0, color=MUTED, linewidth=0.8)
            axes.plot(time_s, left_deg, ".", color=BLUE, markersize=2.5)
            axes.set_xlabel("time (s)")
        close.set_xlim(at - 0.3, at + 1.7)
        close.set_title("the largest step")
        whole.set_ylabel("front wheel angle (degrees)")
        rest.set_ylabel("measured − model (degrees)")
        whole.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=3, frameon=False)
        for axes in (whole, close, rest, near):
            axes.grid(color=MUTED, alpha=0.2, linewidth=0.6)
        figure.suptitle(f"{title}: residuals {np.sqrt(np.nanmean(left_deg**2)):.2f}° rms")
        write_caption(figure, caption)


def _largest_step(response: ServoResponse) -> float:
    """Time of the largest change of the command from one record to the next."""
    return float(response.time_s[np.argmax(np.abs(np.diff(response.command_rad))) + 1])
