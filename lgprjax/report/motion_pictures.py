"""Pictures of fits of turning, acceleration and path following."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure

from lgprjax.report.steering_pictures import Curve, Points, draw_fitted_curve
from lgprjax.report.style import BLUE, CORRELATION_MAP, FAINT, GREEN, INK, MUTED, VERMILLION, picture, write_caption
from lgprjax.tuning import DriveSignals
from lgprjax.tuning.arcs import Arcs
from lgprjax.tuning.look_ahead import LookAheadCosts, TunedLookAhead
from lgprjax.tuning.pedals import PedalRuns, PedalsFit, levelled
from lgprjax.tuning.steering import RearRatioFit, YawGainFit, rear_axle_slip
from lgprjax.vehicle import Chassis

# Runs of throttle and brake: commands, measured and modelled speed, and residuals of distance.

# Speed is averaged over this time: that of single records is the odometer's noise.
_AROUND_S = 0.25


@dataclass(frozen=True)
class PedalPicture:
    """Records of runs from standstill to standstill.

    Attributes:
        time_s: record times.
        run: number of each record's run.
        throttle, brake: commands, 0 to 1.
        measured_m, model_m: measured and modelled distance, each relative to its mean over the run.
    """

    time_s: Float[np.ndarray, " record"]
    run: Int[np.ndarray, " record"]
    throttle: Float[np.ndarray, " record"]
    brake: Float[np.ndarray, " record"]
    measured_m: Float[np.ndarray, " record"]
    model_m: Float[np.ndarray, " record"]


def draw_pedal_runs(shown: PedalPicture, path: str | Path, *, caption: str, force: bool = False) -> None:
    """Draw commands, speeds and residuals of distance over time.

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
        rest.set_ylabel("distance, measured − model (cm)")
        rest.set_xlabel("time (s)")
        for axes in (commands, speeds):
            axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5))
        for axes in (commands, speeds, rest):
            axes.grid(color=MUTED, alpha=0.2, linewidth=0.6)
        figure.suptitle(
            f"Throttle and brake: distance within {100.0 * np.sqrt(np.mean(left_m**2)):.2f} cm rms of the model"
        )
        write_caption(figure, caption)


def _speed(time_s: Float[np.ndarray, " record"], way_m: Float[np.ndarray, " record"]) -> Float[np.ndarray, " record"]:
    before, after = np.maximum(time_s - _AROUND_S, time_s[0]), np.minimum(time_s + _AROUND_S, time_s[-1])
    gone_m = np.interp(after, time_s, way_m) - np.interp(before, time_s, way_m)
    return np.asarray(gone_m / (after - before))


# The sweep of the look-ahead: error and oscillation over look-ahead and speed, and what was chosen.


@dataclass(frozen=True)
class LookAheadSweep:
    """Contents of the picture of a look-ahead sweep.

    Attributes:
        look_ahead_m, speed_mps: axes of the sweep, rising.
        error_m: RMS distance of the anchor from the path; NaN without a successful run.
        oscillation: remaining oscillation, in ``oscillation_label``'s unit; NaN without a successful run.
        oscillation_label: name of the oscillation, with the unit.
        chosen_mps, chosen_m: speeds and look-aheads of the chosen schedule.
        stable_m: shortest stable look-ahead at each speed; NaN if the whole sweep is stable.
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
        # A sweep may contain speeds without a stable look-ahead.
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
    # One corner, diverging or without oscillation, must not use up all colours.
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


_STEPS = 201


def draw_rear_ratio_heading(
    arcs: Arcs, chassis: Chassis, fit: RearRatioFit, path: str | Path, *, force: bool = False
) -> None:
    """Direction of the rear axle's path relative to the heading, over curvature, with the fit of k.

    Raises:
        InputError: the file exists (without ``force``) or cannot be written.
    """
    known = np.isfinite(arcs.slip_rad)
    bend, slip = arcs.curvature_radpm[known], np.degrees(arcs.slip_rad[known] + fit.offset_rad.value)
    sigma = np.degrees(np.hypot(arcs.sigma_slip_rad[known], fit.drift_rad))
    curve = np.linspace(bend.min(), bend.max(), _STEPS)
    speed = float(np.median(arcs.speed_mps[known]))
    middle, low, high = (
        np.degrees(rear_axle_slip(chassis, k, speed, curve)) for k in (fit.ratio.value, fit.ratio.low, fit.ratio.high)
    )
    ratio, forward = fit.ratio, arcs.stretches.sense[known] > 0
    series = [
        Points(label, bend[chosen], slip[chosen], sigma[chosen], np.interp(bend[chosen], curve, middle))
        for label, chosen in (("stretches driven forward", forward), ("in reverse", ~forward))
        if chosen.any()
    ]
    draw_fitted_curve(
        series,
        Curve(f"k = {ratio.value:.4f}", curve, middle, np.minimum(low, high), np.maximum(low, high)),
        path,
        title=f"Rear over front wheel angle: k = {ratio.value:.4f}, {ratio.low:.4f} to {ratio.high:.4f}",
        x_label="curvature of the rear axle's path (1/m), left positive",
        y_label="path minus heading (degrees)",
        residual_label="residual (degrees)",
        caption=(
            "Direction in which the rear axle moves, minus the body's heading, equal to minus the rear wheels' "
            f"angle. The INS heading was assumed to be rotated by {np.degrees(fit.offset_rad.value):.2f}°; bars "
            "include its drift."
        ),
        force=force,
    )


def draw_rear_ratio_angles(
    front_rad: Float[np.ndarray, " block"],
    rear_rad: Float[np.ndarray, " block"],
    fit: RearRatioFit,
    path: str | Path,
    *,
    force: bool = False,
) -> None:
    """Measured rear over front wheel angle, with the line of k.

    Raises:
        InputError: the file exists (without ``force``) or cannot be written.
    """
    front = np.linspace(front_rad.min(), front_rad.max(), _STEPS)
    ratio, offset = fit.ratio, fit.offset_rad
    line = offset.value - ratio.value * front
    half = np.hypot(0.5 * (offset.high - offset.low), 0.5 * (ratio.high - ratio.low) * front)
    draw_fitted_curve(
        [
            Points(
                "means over a second",
                np.degrees(front_rad),
                np.degrees(rear_rad),
                np.zeros_like(rear_rad),
                np.degrees(offset.value - ratio.value * front_rad),
            )
        ],
        Curve(f"k = {ratio.value:.4f}", *(np.degrees(v) for v in (front, line, line - half, line + half))),
        path,
        title=f"Rear over front wheel angle: k = {ratio.value:.4f}, {ratio.low:.4f} to {ratio.high:.4f}",
        x_label="front wheel angle (degrees)",
        y_label="rear wheel angle (degrees)",
        residual_label="residual (degrees)",
        caption="Both measured; a robust line. Systematic deviations from the line require a rear map instead of k.",
        force=force,
    )


def draw_yaw_gain(fit: YawGainFit, path: str | Path, *, force: bool = False) -> None:
    """Yaw gain over speed, one point per turn.

    Raises:
        InputError: the file exists (without ``force``) or cannot be written.
    """
    speed, found = np.linspace(0.0, 1.05 * float(fit.speed_mps.max()), _STEPS), fit.characteristic_speed_mps
    # The fit's scale belongs to the wheel angles, not to the gain.
    gain = fit.gain * fit.scale.value
    lines = [1.0 / (1.0 + (speed / v) ** 2) for v in (found.value, found.low, found.high)]
    at_points = 1.0 / (1.0 + (fit.speed_mps / found.value) ** 2)
    draw_fitted_curve(
        [Points("turns", fit.speed_mps, gain, fit.sigma_gain, at_points)],
        Curve(f"V = {found.value:.1f} m/s", speed, *lines),
        path,
        title=f"Yaw gain: characteristic speed {found.value:.1f} m/s, {found.low:.1f} to {found.high:.1f}",
        x_label="speed (m/s)",
        y_label="yaw rate over geometric yaw rate",
        residual_label="residual",
        caption=(
            f"Gains times {fit.scale.value:.4f}, the ratio of the wheel angles' curvature to the true one at "
            f"zero speed. Front angles read {np.degrees(fit.offset_rad):.2f}° too far to the left; turns to "
            "either side differ by it."
        ),
        force=force,
    )


def draw_pedals(
    signals: DriveSignals,
    runs: PedalRuns,
    model_m: Float[np.ndarray, " record"],
    fit: PedalsFit,
    path: str | Path,
    *,
    force: bool = False,
) -> None:
    """Runs of throttle and brake, with the model.

    Raises:
        InputError: the file exists (without ``force``) or cannot be written.
    """
    measured_m = levelled(runs, signals.travel_m[runs.record])
    shown = PedalPicture(signals.time_s[runs.record], runs.run, runs.throttle, runs.brake, measured_m, model_m)
    parts = [
        f"{name}: from {pedal.pre_tension.value:.3f} on, dead zone {pedal.dead_zone.value:.3f}, "
        f"{pedal.gain_mps2.value:.2f} m/s² per unit, lag {pedal.lag_s.value:.2f} s"
        for name, pedal in (("throttle", fit.throttle), ("brake", fit.brake))
    ]
    draw_pedal_runs(shown, path, caption="; ".join(parts).capitalize() + ".", force=force)


def draw_look_ahead_sweep(
    tuned: TunedLookAhead,
    swept: LookAheadCosts,
    look_m: Float[np.ndarray, " look"],
    speed_mps: Float[np.ndarray, " speed"],
    least_margin_rad: float,
    path: str | Path,
    *,
    force: bool = False,
) -> None:
    """Error and oscillation over look-ahead and speed, with what was chosen.

    Raises:
        InputError: the file exists (without ``force``) or cannot be written.
    """
    steady = np.asarray(swept.margin_rad) >= least_margin_rad
    error = np.where(steady, np.asarray(swept.error_m, np.float64), np.nan)
    # Below a millimetre nothing is visible.
    cycle_cm = np.where(steady, 100.0 * np.maximum(np.asarray(swept.cycle_m, np.float64), 1e-3), np.nan)
    short, long, slow, fast = (float(value) for value in tuned.schedule)
    chosen = np.linspace(speed_mps.min(), speed_mps.max(), _STEPS)
    shown = LookAheadSweep(
        look_ahead_m=look_m,
        speed_mps=speed_mps,
        error_m=error,
        oscillation=cycle_cm,
        oscillation_label="oscillation left, amplitude (cm)",
        chosen_mps=chosen,
        chosen_m=np.interp(chosen, [slow, fast], [short, long]),
        stable_m=stability_limit(look_m, np.asarray(swept.margin_rad, np.float64)),
    )
    draw_look_ahead(
        shown,
        path,
        title=f"Look-ahead: {short:.1f} m up to {slow:.1f} m/s, {long:.1f} m from {fast:.1f} m/s on",
        caption=(
            "Means over the courses, and over initial offsets to both sides. Grey: lag and delay leave less than "
            f"{np.degrees(least_margin_rad):.0f}° of phase margin."
        ),
        force=force,
    )


def stability_limit(
    look_m: Float[np.ndarray, " look"], margin_rad: Float[np.ndarray, "look speed"]
) -> Float[np.ndarray, " speed"]:
    """Look-ahead of each speed at which the phase margin is used up; NaN where the sweep does not cross it."""
    unstable = margin_rad <= 0.0
    last = len(look_m) - 1 - np.argmax(unstable[::-1], axis=0)
    crossed = unstable.any(axis=0) & ~unstable[-1]
    low = np.where(crossed, last, 0)
    speed = np.arange(margin_rad.shape[1])
    below, above = margin_rad[low, speed], margin_rad[low + 1, speed]
    share = np.where(crossed, below / np.where(crossed, below - above, 1.0), 0.0)
    return np.asarray(np.where(crossed, look_m[low] + share * (look_m[low + 1] - look_m[low]), np.nan))
