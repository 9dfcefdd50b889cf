"""Encoder against potentiometer, standing still: the fit, the play between both, and what is left."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float

from lgprjax.report.style import BLUE, FAINT, INK, MUTED, VERMILLION, picture, write_caption


@dataclass(frozen=True)
class EncoderPicture:
    """What the picture shows.

    Attributes:
        counts, potentiometer_v: of every record, finite.
        pause_counts, pause_v: mean of each pause.
        rising: pauses that were reached with rising counts.
        fitted_v: potentiometer by the fit at each pause, its turning direction included.
        line_counts, line_rising_v, line_falling_v: the fit for either direction.
        v_per_rad: change of the potentiometer with the wheel angle, for residuals in degrees; ``None`` if not known.
    """

    counts: Float[np.ndarray, " record"]
    potentiometer_v: Float[np.ndarray, " record"]
    pause_counts: Float[np.ndarray, " pause"]
    pause_v: Float[np.ndarray, " pause"]
    rising: Bool[np.ndarray, " pause"]
    fitted_v: Float[np.ndarray, " pause"]
    line_counts: Float[np.ndarray, " step"]
    line_rising_v: Float[np.ndarray, " step"]
    line_falling_v: Float[np.ndarray, " step"]
    v_per_rad: float | None


def draw_encoder_fit(shown: EncoderPicture, path: str | Path, *, caption: str, force: bool = False) -> None:
    """Draw encoder over potentiometer above; below, distance from the middle of both directions: play and residuals.

    Raises:
        InputError: the file exists (without ``force``) or cannot be written.
    """
    scale, unit = _residual_scale(shown.v_per_rad)
    middle = 0.5 * (shown.line_rising_v + shown.line_falling_v)
    with picture(path, 7.6, 6.8, force) as figure:
        above, below = figure.subplots(2, 1, sharex=True, height_ratios=(1.8, 1.2))
        above.plot(shown.counts / 1e3, shown.potentiometer_v, ".", color=FAINT, markersize=1.5, label="records")
        above.plot(shown.line_counts / 1e3, middle, color=INK, linewidth=1.0, label="fit, middle of both directions")
        for rising, colour, marker, words in ((True, BLUE, "^", "rising"), (False, VERMILLION, "v", "falling")):
            chosen = shown.rising == rising
            at = shown.pause_counts[chosen]
            label = f"pauses after {words} counts"
            above.plot(at / 1e3, shown.pause_v[chosen], marker, color=colour, markersize=6, label=label)
            line = shown.line_rising_v if rising else shown.line_falling_v
            below.plot(shown.line_counts / 1e3, scale * (line - middle), color=colour, linewidth=1.0)
            away = shown.pause_v[chosen] - np.interp(at, shown.line_counts, middle)
            below.plot(at / 1e3, scale * away, marker, color=colour, markersize=6)
        below.axhline(0.0, color=MUTED, linewidth=0.8)
        above.set_ylabel("potentiometer (V)")
        below.set_ylabel(f"from the middle ({unit})")
        below.set_xlabel("encoder (1000 counts)")
        for axes in (above, below):
            axes.grid(color=MUTED, alpha=0.2, linewidth=0.6)
        above.legend(loc="best")
        left = scale * (shown.pause_v - shown.fitted_v)
        figure.suptitle(f"Encoder and potentiometer: residuals {np.sqrt(np.mean(left**2)):.3g} {unit} rms")
        write_caption(
            figure,
            f"{caption} Below: distance of the {len(left)} pauses (markers) and of the fit (lines) from the middle of "
            "both turning directions, as an angle of the wheels where volts can be told as one; what lies between the "
            "lines is the play.",
        )


def _residual_scale(v_per_rad: float | None) -> tuple[float, str]:
    """From volts to what residuals are drawn in."""
    return (1e3, "mV") if v_per_rad is None else (float(np.degrees(1.0 / abs(v_per_rad))), "degrees")
