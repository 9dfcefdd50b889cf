"""Runs of throttle and brake: commands, speed measured and by the model, and what is left of the way."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int

from lgprjax.report.style import BLUE, GREEN, MUTED, VERMILLION, picture, write_caption

# Speed is drawn over this time: that of single records is the odometer's noise.
_AROUND_S = 0.25


@dataclass(frozen=True)
class PedalPicture:
    """Records of runs from standstill to standstill.

    Attributes:
        time_s: of each.
        run: number of its run.
        throttle, brake: commands, 0 to 1.
        measured_m, model_m: way, each about its mean over the run.
    """

    time_s: Float[np.ndarray, " record"]
    run: Int[np.ndarray, " record"]
    throttle: Float[np.ndarray, " record"]
    brake: Float[np.ndarray, " record"]
    measured_m: Float[np.ndarray, " record"]
    model_m: Float[np.ndarray, " record"]


def draw_pedal_runs(shown: PedalPicture, path: str | Path, *, caption: str, force: bool = False) -> None:
    """Draw commands, speeds and residuals of the way over time.

    Raises:
        InputError: the file exists (without ``force``) or cannot be written.
    """
    left_m = shown.measured_m - shown.model_m
    with picture(path, 9.6, 7.0, force) as figure:
        commands, speeds, rest = figure.subplots(3, 1, sharex=True, height_ratios=(1.0, 1.6, 1.0))
        for number in range(int(shown.run.max()) + 1):
            here = shown.run == number
            label = {name: name if number == 0 else "_" for name in ("throttle", "brake", "measured", "model")}
            time_s = shown.time_s[here]
            for name, values, colour in (("throttle", shown.throttle, GREEN), ("brake", shown.brake, VERMILLION)):
                commands.step(time_s, values[here], where="post", color=colour, linewidth=1.2, label=label[name])
            speeds.plot(
                time_s, _speed(time_s, shown.measured_m[here]), ".", color=BLUE, markersize=2.5, label=label["measured"]
            )
            speeds.plot(
                time_s, _speed(time_s, shown.model_m[here]), color=VERMILLION, linewidth=1.2, label=label["model"]
            )
            rest.plot(time_s, 100.0 * left_m[here], ".", color=BLUE, markersize=2.5)
        rest.axhline(0.0, color=MUTED, linewidth=0.8)
        commands.set_ylabel("command (0 to 1)")
        speeds.set_ylabel("speed (m/s)")
        rest.set_ylabel("way, measured − model (cm)")
        rest.set_xlabel("time (s)")
        for axes in (commands, speeds):
            axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5))
        for axes in (commands, speeds, rest):
            axes.grid(color=MUTED, alpha=0.2, linewidth=0.6)
        figure.suptitle(f"Throttle and brake: way within {100.0 * np.sqrt(np.mean(left_m**2)):.2f} cm rms of the model")
        write_caption(figure, caption)


def _speed(time_s: Float[np.ndarray, " record"], way_m: Float[np.ndarray, " record"]) -> Float[np.ndarray, " record"]:
    before, after = np.maximum(time_s - _AROUND_S, time_s[0]), np.minimum(time_s + _AROUND_S, time_s[-1])
    gone_m = np.interp(after, time_s, way_m) - np.interp(before, time_s, way_m)
    return np.asarray(gone_m / (after - before))
