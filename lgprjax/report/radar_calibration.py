"""Picture of a radar calibration: look-up, drift of the calibration channel, and the channels' gains and delays."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Complex, Float
from matplotlib.axes import Axes

from lgprjax.report.style import BLUE, FAINT, MUTED, VERMILLION, picture, write_caption

_PERIODS = 30.0
"""Travel time in which the plate is searched, in periods of the centre frequency."""


@dataclass(frozen=True)
class RadarCalibrationPicture:
    """A calibration and its recording.

    Attributes:
        name: name of the calibration.
        frequencies_hz: frequencies of the sweeps.
        group_delay_ns: delay of the calibration channel's path.
        empty: look-up divided by its calibration sweep.
        noise: RMS noise of a single scan's ratio.
        calibration: sweeps of the calibration channel, by group.
        echo: echo of the plate minus the look-up; ``None`` before one was recorded.
        gain, delay_ns: gain and delay of each channel; NaN for unused channels, ``None`` before they were measured.
    """

    name: str
    frequencies_hz: Float[np.ndarray, " frequency"]
    group_delay_ns: float
    empty: Complex[np.ndarray, "channel frequency"]
    noise: Float[np.ndarray, " channel"]
    calibration: Complex[np.ndarray, "group frequency"]
    echo: Complex[np.ndarray, "channel frequency"] | None = None
    gain: Float[np.ndarray, " channel"] | None = None
    delay_ns: Float[np.ndarray, " channel"] | None = None


def draw_radar_calibration(shown: RadarCalibrationPicture, path: str | Path, *, force: bool = False) -> None:
    """Draw look-up and drift, and below them the plate's echo and the channels' gains and delays, if measured.

    Raises:
        InputError: the file exists (without ``force``) or cannot be written.
    """
    measured = shown.echo is not None and shown.gain is not None and shown.delay_ns is not None
    with picture(path, 9.6, 7.4 if measured else 4.0, force) as figure:
        grid = figure.subplots(2 if measured else 1, 2, squeeze=False)
        _draw_empty(grid[0, 0], shown)
        _draw_drift(grid[0, 1], shown)
        caption = "Top left: look-up of each channel over its calibration sweep, and noise of a single scan."
        if shown.echo is not None and shown.gain is not None and shown.delay_ns is not None:
            _draw_echo(grid[1, 0], shown, shown.echo, shown.gain, shown.delay_ns)
            _draw_response(grid[1, 1], shown.gain, shown.delay_ns)
            caption += " Below: echo of the plate before and after correction; gain and delay of each channel."
        figure.suptitle(f"Radar calibration {shown.name}")
        write_caption(figure, caption)


def _draw_empty(axes: Axes, shown: RadarCalibrationPicture) -> None:
    mhz = shown.frequencies_hz / 1e6
    with np.errstate(divide="ignore"):
        axes.plot(mhz, 20.0 * np.log10(np.abs(shown.empty)).T, color=BLUE, linewidth=0.8)
        noise_db = 20.0 * np.log10(np.median(shown.noise))
    axes.axhline(noise_db, color=VERMILLION, linewidth=1.2, label="noise of a scan, median channel")
    axes.set(xlabel="frequency (MHz)", ylabel="level (dB)", title="Empty space")
    axes.legend(loc="best")


def _draw_drift(axes: Axes, shown: RadarCalibrationPicture) -> None:
    typical = np.nanmean(shown.calibration, axis=0)
    against = shown.calibration @ np.conj(typical) / np.sum(np.abs(typical) ** 2)
    number = np.arange(1, len(against) + 1)
    axes.plot(number, 20.0 * np.log10(np.abs(against)), ".-", color=BLUE)
    axes.set(xlabel="part of the recording", ylabel="magnitude (dB)", title="Drift of the calibration channel")
    axes.yaxis.label.set_color(BLUE)
    phase = axes.twinx()
    phase.plot(number, np.degrees(np.unwrap(np.angle(against))), ".--", color=VERMILLION)
    phase.set_ylabel("phase (°)", color=VERMILLION)


def _draw_echo(
    axes: Axes,
    shown: RadarCalibrationPicture,
    echo: Complex[np.ndarray, "channel frequency"],
    gain: Float[np.ndarray, " channel"],
    delay_ns: Float[np.ndarray, " channel"],
) -> None:
    used = np.isfinite(gain)
    turns = 1e-9 * np.outer(delay_ns[used], shown.frequencies_hz)
    alike = echo[used] * np.exp(2j * np.pi * turns) / gain[used, None]
    period_ns = 1e9 / float(np.mean(shown.frequencies_hz))
    time_ns = np.linspace(-3.0 * period_ns, _PERIODS * period_ns, 801)
    taper = np.hanning(len(shown.frequencies_hz) + 2)[1:-1]
    waves = np.exp(2e-9j * np.pi * np.outer(shown.frequencies_hz, time_ns - shown.group_delay_ns)) * taper[:, None]
    for values, colour, label in ((echo[used], FAINT, "as recorded"), (alike, BLUE, "corrected")):
        lines = axes.plot(time_ns, np.real(values @ waves).T / taper.sum(), color=colour, linewidth=0.8)
        lines[0].set_label(label)
    peak_ns = time_ns[np.argmax(np.abs(alike.mean(axis=0) @ waves))]
    axes.set_xlim(peak_ns - 3.0 * period_ns, peak_ns + 3.0 * period_ns)
    axes.set(xlabel="two-way travel time (ns)", ylabel="echo", title="Metal plate")
    axes.legend(loc="best")


def _draw_response(axes: Axes, gain: Float[np.ndarray, " channel"], delay_ns: Float[np.ndarray, " channel"]) -> None:
    channel = np.arange(len(gain))
    axes.plot(channel, 100.0 * (gain - 1.0), "o", color=BLUE)
    axes.axhline(0.0, color=MUTED, linewidth=0.8)
    axes.set(xlabel="channel", ylabel="gain over the mean (%)", title="Channels")
    axes.yaxis.label.set_color(BLUE)
    delay = axes.twinx()
    delay.plot(channel, delay_ns, "s", color=VERMILLION, fillstyle="none")
    delay.set_ylabel("delay over the mean (ns)", color=VERMILLION)
