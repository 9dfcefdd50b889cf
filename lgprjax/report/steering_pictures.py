"""Pictures of the steering's sensors, its servo and the palm tree: from a drive and its fit to a PNG."""

from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float

from lgprjax.report.encoder_fit import EncoderPicture, draw_encoder_fit
from lgprjax.report.fitted_curve import Curve, Points, draw_fitted_curve
from lgprjax.report.palm_tree import Branch, draw_palm_tree
from lgprjax.report.servo_steps import ServoResponse, draw_servo_steps
from lgprjax.tuning import DriveSignals
from lgprjax.tuning.arcs import Arcs
from lgprjax.tuning.encoder import EncoderFit, fitted_volts
from lgprjax.tuning.servo_fit import ServoFit
from lgprjax.tuning.straight import StraightFit
from lgprjax.tuning.wheel_angle import WheelAngleFit, front_angle, front_band

_STEPS = 201


def draw_straight(fit: StraightFit, path: str | Path, *, force: bool = False) -> None:
    """Potentiometer over curvature, a point a window of the way.

    Raises:
        InputError: the file exists (without ``force``) or cannot be written.
    """
    value, slope = fit.potentiometer_v, fit.slope_vm
    bend = np.linspace(fit.curvature_radpm.min(), fit.curvature_radpm.max(), _STEPS)
    half = np.hypot(0.5 * (value.high - value.low), 0.5 * (slope.high - slope.low) * bend)
    line = value.value + slope.value * bend
    used = fit.weight > 0.0
    series = [_window_points(fit, used, "windows of 5 m")]
    if not used.all():
        series.append(_window_points(fit, ~used, "taken away as outliers"))
    draw_fitted_curve(
        series,
        Curve("robust line", 1e3 * bend, line, line - half, line + half),
        path,
        title=f"Straight potentiometer value: {value.value:.4f} V, {value.low:.4f} to {value.high:.4f} V",
        x_label="curvature by heading over way (1/km)",
        y_label="potentiometer (V)",
        residual_label="residual (mV)",
        residual_scale=1e3,
        caption=f"The value is the line's at curvature 0. Windows left out because they turned: {fit.turning}.",
        force=force,
    )


def draw_encoder(
    signals: DriveSignals, fit: EncoderFit, v_per_rad: float | None, path: str | Path, *, force: bool = False
) -> None:
    """Encoder against potentiometer, with play and residuals.

    Raises:
        InputError: the file exists (without ``force``) or cannot be written.
    """
    assert signals.encoder_counts is not None
    assert signals.potentiometer_v is not None
    pauses = fit.pauses
    known = np.isfinite(signals.encoder_counts + signals.potentiometer_v)
    counts = np.linspace(pauses.counts.min(), pauses.counts.max(), _STEPS)
    one = np.ones_like(counts)
    shown = EncoderPicture(
        signals.encoder_counts[known],
        signals.potentiometer_v[known],
        pauses.counts,
        pauses.potentiometer_v,
        pauses.direction > 0.0,
        fitted_volts(fit, pauses.counts, pauses.direction),
        counts,
        fitted_volts(fit, counts, one),
        fitted_volts(fit, counts, -one),
        v_per_rad,
    )
    per_v, play = fit.counts_per_v, fit.hysteresis_counts
    caption = (
        f"{per_v.value:.1f} counts a volt ({per_v.low:.1f} to {per_v.high:.1f}), play {play.value:.1f} counts "
        f"({play.low:.1f} to {play.high:.1f}); {fit.why}."
    )
    draw_encoder_fit(shown, path, caption=caption, force=force)


def draw_arcs(signals: DriveSignals, arcs: Arcs, fit: WheelAngleFit, path: str | Path, *, force: bool = False) -> None:
    """The palm tree of a drive, coloured by the front angle that the fit gives.

    Raises:
        InputError: the file exists (without ``force``) or cannot be written.
    """
    branches = []
    front_rad = front_angle(fit.map, arcs.stretches.steering)
    for first, stop, bend, front in zip(
        arcs.stretches.start, arcs.stretches.stop, arcs.curvature_radpm, front_rad, strict=True
    ):
        here = slice(first, stop)
        fixed = np.isfinite(signals.east_m[here] + signals.north_m[here])
        east_m, north_m, way_m = (v[here][fixed] for v in (signals.east_m, signals.north_m, signals.travel_m))
        branches.append(Branch(east_m, north_m, way_m, float(bend), float(front)))
    draw_palm_tree(branches, path, dropped=fit.dropped, force=force)


def draw_wheel_angle(fit: WheelAngleFit, path: str | Path, *, force: bool = False) -> None:
    """Front angle over the potentiometer: settings, map with its band, residuals.

    Raises:
        InputError: the file exists (without ``force``) or cannot be written.
    """
    volts = np.linspace(-1.0, 1.0, _STEPS) * fit.map.half_span + fit.map.middle
    low, high = front_band(fit.map, volts)
    left_deg = np.degrees(fit.residual_rad)
    draw_fitted_curve(
        [
            Points(
                "settings of the steering wheel",
                fit.steering,
                np.degrees(fit.front_rad),
                np.degrees(fit.sigma_rad),
                np.degrees(fit.front_rad - fit.residual_rad),
            )
        ],
        Curve("map", volts, np.degrees(front_angle(fit.map, volts)), np.degrees(low), np.degrees(high)),
        path,
        title=f"Steering angle to wheel angle: residuals {np.sqrt(np.mean(left_deg**2)):.2f}° rms",
        x_label="potentiometer (V)",
        y_label="front wheel angle (degrees)",
        residual_label="measured − map (degrees)",
        caption=(
            f"Front wheel angle that the arcs of each setting give, with its 95 % interval, and a cubic through "
            f"{len(fit.steering)} settings. Scatter that the arcs do not explain: {np.degrees(fit.extra_rad):.2f}°."
        ),
        force=force,
    )


def draw_servo(
    signals: DriveSignals,
    measured_rad: Float[np.ndarray, " record"],
    fit: ServoFit,
    path: str | Path,
    *,
    force: bool = False,
) -> None:
    """Responses of the servo, measured and by the model.

    Raises:
        InputError: the file exists (without ``force``) or cannot be written.
    """
    assert signals.command_rad is not None
    shown = ServoResponse(signals.time_s, signals.command_rad, measured_rad, fit.model_rad)
    caption = (
        f"Lag {1e3 * fit.lag_s.value:.0f} ms ({1e3 * fit.lag_s.low:.0f} to {1e3 * fit.lag_s.high:.0f}), delay "
        f"{1e3 * fit.delay_s.value:.0f} ms, dead band {np.degrees(fit.dead_band_rad.value):.2f}°, rate "
        f"{np.degrees(fit.rate_radps.value):.1f}°/s, left faster than the mean by {100.0 * fit.asymmetry.value:.1f} %. "
        f"Play of {np.degrees(float(fit.servo.backlash_rad)):.2f}° taken as given."
    )
    draw_servo_steps(shown, path, title="Steering servo", caption=caption, force=force)


def _window_points(fit: StraightFit, chosen: Bool[np.ndarray, " window"], label: str) -> Points:
    bend, volts = fit.curvature_radpm[chosen], fit.window_v[chosen]
    line = fit.potentiometer_v.value + fit.slope_vm.value * bend
    return Points(label, 1e3 * bend, volts, np.zeros_like(volts), line)
