"""Pictures of fits of the steering's sensors, its servo and the palm tree."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection
from matplotlib.colors import ListedColormap, Normalize

from lgprjax.report.style import BLUE, FAINT, INK, MUTED, ORANGE, SKY, VERMILLION, picture, write_caption
from lgprjax.tuning import DriveSignals
from lgprjax.tuning.arcs import Arcs
from lgprjax.tuning.sensors import EncoderFit, StraightFit, fitted_volts
from lgprjax.tuning.servo import ServoFit
from lgprjax.tuning.steering import WheelAngleFit, front_angle, front_band

# Measured points, the fitted curve with its band, and residuals: one picture for several calibrations.

_SERIES = ((BLUE, "o"), (VERMILLION, "s"), (ORANGE, "^"))


@dataclass(frozen=True)
class Points:
    """Measured values, drawn as one series.

    Attributes:
        label: label in the legend.
        x, y: coordinates of each point.
        sigma: standard error of y; zeros if unknown.
        fitted: value of the curve at x.
    """

    label: str
    x: Float[np.ndarray, " point"]
    y: Float[np.ndarray, " point"]
    sigma: Float[np.ndarray, " point"]
    fitted: Float[np.ndarray, " point"]


@dataclass(frozen=True)
class Curve:
    """A fitted curve.

    Attributes:
        label: label in the legend.
        x, y: points along the curve, x rising.
        low, high: 95 % band at each x.
    """

    label: str
    x: Float[np.ndarray, " step"]
    y: Float[np.ndarray, " step"]
    low: Float[np.ndarray, " step"]
    high: Float[np.ndarray, " step"]


def draw_fitted_curve(
    points: list[Points],
    curve: Curve,
    path: str | Path,
    *,
    title: str,
    x_label: str,
    y_label: str,
    residual_label: str,
    caption: str,
    residual_scale: float = 1.0,
    force: bool = False,
) -> None:
    """Draw points and curve above, residuals with the same x below.

    Args:
        points: up to three series.
        curve: fitted curve.
        path: path of the PNG.
        title, x_label, y_label, residual_label, caption: texts.
        residual_scale: factor from the unit of y to that of the residual axis.
        force: whether to replace an existing file.

    Raises:
        InputError: the file exists (without ``force``) or cannot be written.
    """
    with picture(path, 7.6, 6.4, force) as figure:
        above, below = figure.subplots(2, 1, sharex=True, height_ratios=(2.2, 1.0))
        above.fill_between(curve.x, curve.low, curve.high, color=SKY, alpha=0.45, linewidth=0, label="95 % band")
        above.plot(curve.x, curve.y, color=INK, linewidth=1.2, label=curve.label)
        # The band is visible in the residuals: above, it is often thinner than the line.
        half = residual_scale * (curve.high - curve.y), residual_scale * (curve.low - curve.y)
        below.fill_between(curve.x, half[1], half[0], color=SKY, alpha=0.45, linewidth=0)
        below.axhline(0.0, color=INK, linewidth=0.8)
        for series, (colour, marker) in zip(points, _SERIES, strict=False):
            _draw_series(above, series.x, series.y, series.sigma, colour, marker, series.label)
            left = residual_scale * (series.y - series.fitted)
            _draw_series(below, series.x, left, residual_scale * series.sigma, colour, marker, "_")
        above.set_ylabel(y_label)
        below.set_ylabel(residual_label)
        below.set_xlabel(x_label)
        for axes in (above, below):
            axes.grid(color=MUTED, alpha=0.2, linewidth=0.6)
        above.legend(loc="best")
        figure.suptitle(title)
        write_caption(figure, caption)


def _draw_series(
    axes: Axes,
    x: Float[np.ndarray, " point"],
    y: Float[np.ndarray, " point"],
    sigma: Float[np.ndarray, " point"],
    colour: str,
    marker: str,
    label: str,
) -> None:
    bars = 1.96 * sigma if np.any(sigma > 0.0) else None
    axes.errorbar(x, y, bars, fmt=marker, color=colour, markersize=4, elinewidth=1.0, capsize=2, alpha=0.9, label=label)


# Encoder against potentiometer, standing still: the fit, the play between both, and residuals.


@dataclass(frozen=True)
class EncoderPicture:
    """Contents of the picture of an encoder fit.

    Attributes:
        counts, potentiometer_v: encoder counts and potentiometer voltage of every record, finite.
        pause_counts, pause_v: means of each pause.
        rising: mask of pauses reached with rising counts.
        fitted_v: potentiometer voltage by the fit at each pause, its turning direction included.
        line_counts, line_rising_v, line_falling_v: the fit for either direction.
        v_per_rad: change of the potentiometer with the wheel angle, for residuals in degrees; ``None`` if unknown.
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
            "both turning directions, as an angle of the wheels if volts can be converted; the distance "
            "between the lines is the play.",
        )


def _residual_scale(v_per_rad: float | None) -> tuple[float, str]:
    """Factor from volts to the unit of the residuals, and the unit."""
    return (1e3, "mV") if v_per_rad is None else (float(np.degrees(1.0 / abs(v_per_rad))), "degrees")


# Responses of the steering servo: command, measured and modelled wheel angles, and residuals.


@dataclass(frozen=True)
class ServoResponse:
    """Front wheel angles over time.

    Attributes:
        time_s: record times.
        command_rad: command to the servo.
        measured_rad: measured wheel angles.
        model_rad: the identified servo under the same commands.
    """

    time_s: Float[np.ndarray, " record"]
    command_rad: Float[np.ndarray, " record"]
    measured_rad: Float[np.ndarray, " record"]
    model_rad: Float[np.ndarray, " record"]


def draw_servo_steps(
    response: ServoResponse, path: str | Path, *, title: str, caption: str, force: bool = False
) -> None:
    """Draw the whole drive, a detail of the largest step, and the residuals.

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
    """Time of the largest change of the command from one record to the next; unknown commands do not count."""
    return float(response.time_s[np.argmax(np.nan_to_num(np.abs(np.diff(response.command_rad)))) + 1])


# The palm tree: one branch for each setting of the steering, its positions and the fitted arc.

# The lightest tenth of the colour map cannot be distinguished from paper.
_ANGLE_MAP = ListedColormap(colormaps["viridis"](np.linspace(0.0, 0.9, 256)), name="steering")
_LABELS_PER_SIDE = 5
_OUTLIER_SCALES = 4.0


@dataclass(frozen=True)
class Branch:
    """One stretch of constant steering.

    Attributes:
        east_m, north_m: fixes of the rear axle, in the order of driving, finite.
        way_m: distance along the path at each fix, forward positive.
        curvature_radpm: fitted curvature of the rear axle's path; a left turn is positive, in reverse too.
        front_rad: fitted front wheel angle.
    """

    east_m: Float[np.ndarray, " fix"]
    north_m: Float[np.ndarray, " fix"]
    way_m: Float[np.ndarray, " fix"]
    curvature_radpm: float
    front_rad: float


def draw_palm_tree(
    branches: list[Branch], path: str | Path, *, dropped: dict[str, int] | None = None, force: bool = False
) -> None:
    """Draw branches coloured by front wheel angle, with the fitted arcs, on a map of equal aspect.

    Args:
        branches: one or more.
        path: the PNG.
        dropped: stretches left out of the fit, by reason, for the caption.
        force: replace a file that exists.

    Raises:
        InputError: the file exists (without ``force``) or cannot be written.
    """
    front_deg = np.degrees([branch.front_rad for branch in branches])
    scale = Normalize(*_span(float(front_deg.min()), float(front_deg.max())))
    fitted = [lay_arc(branch) for branch in branches]
    scatter_m = np.concatenate(
        [_misses(branch, arc) for branch, arc in zip(branches, fitted, strict=True)], dtype=np.float64
    )
    common = np.median([arc[0] for arc in fitted], axis=0)
    with picture(path, 7.6, 7.4, force) as figure:
        axes = figure.subplots()
        for branch, angle in zip(branches, front_deg, strict=True):
            axes.plot(branch.east_m, branch.north_m, ".", color=_ANGLE_MAP(scale(angle)), markersize=4.5, zorder=1)
        axes.add_collection(LineCollection([arc.tolist() for arc in fitted], colors=INK, linewidths=0.8, zorder=2))
        for index in _labelled(front_deg):
            end, onward = _tip(fitted[index], common)
            axes.annotate(
                f"{front_deg[index]:+.0f}°".replace("+0°", "0°").replace("-0°", "0°"),
                (float(end[0]), float(end[1])),
                textcoords="offset points",
                xytext=(float(12.0 * onward[0]), float(12.0 * onward[1])),
                fontsize=9.0,
                color=INK,
                ha="center",
                va="center",
            )
        axes.plot([], [], ".", color=_ANGLE_MAP(0.5), markersize=7, label="rear axle, positions")
        axes.plot([], [], color=INK, linewidth=0.8, label="fitted arcs")
        axes.legend(loc="best")
        figure.colorbar(
            ScalarMappable(scale, _ANGLE_MAP), ax=axes, label="front wheel angle by the fit (degrees)", shrink=0.8
        )
        axes.set_aspect("equal", adjustable="datalim")
        axes.set_xlabel("east (m)")
        axes.set_ylabel("north (m)")
        figure.suptitle(f"Palm tree: {len(branches)} stretches, {front_deg.min():+.1f}° to {front_deg.max():+.1f}°")
        left_out = ", ".join(f"{count} {why}" for why, count in (dropped or {}).items()) or "none"
        write_caption(
            figure,
            f"Each stretch of constant steering and the arc of its fitted curvature; median distance of a position "
            f"from its arc {100.0 * np.median(scatter_m):.1f} cm. Excluded stretches: {left_out}.",
        )


def lay_arc(branch: Branch) -> Float[np.ndarray, "fix 2"]:
    """East and north of the arc of a branch's curvature, aligned with its positions by rotation and shift."""
    way = branch.way_m - np.mean(branch.way_m)
    turned = branch.curvature_radpm * way
    # Chord of an arc from its middle, without dividing by the curvature.
    half = 0.5 * turned
    chord = way * np.sinc(half / np.pi)
    shape = np.stack([chord * np.cos(half), chord * np.sin(half)], axis=1)
    place = np.stack([branch.east_m, branch.north_m], axis=1)
    kept = np.ones(len(way), dtype=bool)
    arc = shape
    for _ in range(4):
        middle, centre = shape[kept].mean(axis=0), place[kept].mean(axis=0)
        cross = (shape[kept] - middle).T @ (place[kept] - centre)
        angle = np.arctan2(cross[0, 1] - cross[1, 0], cross[0, 0] + cross[1, 1])
        turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
        arc = (shape - middle) @ turn + centre
        away = np.hypot(*(place - arc).T)
        # An outlier of metres must not shift the picture.
        kept = away <= _OUTLIER_SCALES * max(1.4826 * float(np.median(away)), 1e-9)
    return np.asarray(arc)


def _tip(
    arc: Float[np.ndarray, "fix 2"], common: Float[np.ndarray, "2"]
) -> tuple[Float[np.ndarray, "2"], Float[np.ndarray, "2"]]:
    """The end of an arc farther from the start of the branches, and its direction there."""
    outward = arc if np.hypot(*(arc[-1] - common)) >= np.hypot(*(arc[0] - common)) else arc[::-1]
    onward = outward[-1] - outward[-1 - max(len(arc) // 5, 1)]
    return outward[-1], onward / max(float(np.hypot(*onward)), 1e-12)


def _misses(branch: Branch, arc: Float[np.ndarray, "fix 2"]) -> Float[np.ndarray, " fix"]:
    """Distance of each position from the arc, across it, which excludes the odometer's scale."""
    direction = np.gradient(arc, axis=0)
    direction /= np.maximum(np.hypot(*direction.T), 1e-12)[:, None]
    east, north = branch.east_m - arc[:, 0], branch.north_m - arc[:, 1]
    return np.asarray(np.abs(direction[:, 0] * north - direction[:, 1] * east))


def _labelled(front_deg: Float[np.ndarray, " branch"]) -> list[int]:
    """Branches to label with their angle: the outermost, the straightest and some between, once for each angle."""
    distinct = np.unique(np.round(front_deg, 0), return_index=True)[1]
    distinct = distinct[np.argsort(front_deg[distinct])]
    picked = np.unique(np.linspace(0, len(distinct) - 1, 2 * _LABELS_PER_SIDE + 1).round().astype(int))
    return [int(distinct[number]) for number in picked]


def _span(low: float, high: float) -> tuple[float, float]:
    return (low, high) if high > low else (low - 1.0, high + 1.0)


_STEPS = 201


def draw_straight(fit: StraightFit, path: str | Path, *, force: bool = False) -> None:
    """Potentiometer over curvature, one point for each window of travel.

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
        series.append(_window_points(fit, ~used, "removed as outliers"))
    draw_fitted_curve(
        series,
        Curve("robust line", 1e3 * bend, line, line - half, line + half),
        path,
        title=f"Straight potentiometer value: {value.value:.4f} V, {value.low:.4f} to {value.high:.4f} V",
        x_label="curvature by heading over distance (1/km)",
        y_label="potentiometer (V)",
        residual_label="residual (mV)",
        residual_scale=1e3,
        caption=f"Result: value of the line at curvature 0. Windows excluded as turns: {fit.turning}.",
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
        counts=signals.encoder_counts[known],
        potentiometer_v=signals.potentiometer_v[known],
        pause_counts=pauses.counts,
        pause_v=pauses.potentiometer_v,
        rising=pauses.direction > 0.0,
        fitted_v=fitted_volts(fit, pauses.counts, pauses.direction),
        line_counts=counts,
        line_rising_v=fitted_volts(fit, counts, one),
        line_falling_v=fitted_volts(fit, counts, -one),
        v_per_rad=v_per_rad,
    )
    per_v, play = fit.counts_per_v, fit.hysteresis_counts
    caption = (
        f"{per_v.value:.1f} counts per volt ({per_v.low:.1f} to {per_v.high:.1f}), play {play.value:.1f} counts "
        f"({play.low:.1f} to {play.high:.1f}); {fit.why}."
    )
    draw_encoder_fit(shown, path, caption=caption, force=force)


def draw_arcs(signals: DriveSignals, arcs: Arcs, fit: WheelAngleFit, path: str | Path, *, force: bool = False) -> None:
    """The palm tree of a drive, coloured by the fitted front angle.

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
            f"Front wheel angle from the arcs of each setting, with its 95 % interval, and a cubic through "
            f"{len(fit.steering)} settings. Scatter not explained by the arcs: {np.degrees(fit.extra_rad):.2f}°."
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
    """Responses of the servo, measured and modelled.

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
