"""Pictures of a drive: the plan, and its errors and correlation over distance."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Shaped
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.collections import PathCollection
from matplotlib.figure import Figure

from lgprjax.report.results import LEAST_P, DriveResult, track_errors
from lgprjax.report.style import (
    BLUE,
    ERROR_MAP,
    FAINT,
    GAP,
    GREEN,
    INK,
    MUTED,
    ORANGE,
    SKY,
    VERMILLION,
    label_decades,
    picture,
    runs_of,
    write_caption,
    write_stretch_caption,
)
from lgprjax.report.summary import WRONG_M

# The plan view of a drive: along the road with a stated cross exaggeration, or on the map if the road bends.

# A road that deviates from its axis by less than this share of its length is drawn along that axis.
_STRAIGHT = 0.15
_LEAST_HALF_WIDTH_M = 1.0
# White is error 0: the background must not be white.
_GROUND = "#cfcfcf"


@dataclass(frozen=True)
class PlanFrame:
    """Axes of the plan: a rotation about a point, and whether the picture may stretch across.

    Attributes:
        centre: east_m, north_m of the plan's zero.
        yaw_rad: direction of the plan's first axis, counter-clockwise from east; 0 on the map.
        along_road: whether the first axis follows the road.
    """

    centre: tuple[float, float]
    yaw_rad: float
    along_road: bool

    def __call__(
        self, east_m: Float[np.ndarray, " point"], north_m: Float[np.ndarray, " point"]
    ) -> tuple[Float[np.ndarray, " point"], Float[np.ndarray, " point"]]:
        """East and north to the plan's own axes, in metres."""
        cos, sin = np.cos(self.yaw_rad), np.sin(self.yaw_rad)
        east, north = east_m - self.centre[0], north_m - self.centre[1]
        return cos * east + sin * north, cos * north - sin * east


def reference_track(result: DriveResult) -> Float[np.ndarray, "scan 2"]:
    """East and north of the truth where it is known, else of the prior."""
    prior = np.stack([result.prior_east_m, result.prior_north_m], axis=1)
    if result.truth_east_m is None or result.truth_north_m is None:
        return prior
    truth = np.stack([result.truth_east_m, result.truth_north_m], axis=1)
    return np.where(np.isfinite(truth).all(axis=1, keepdims=True), truth, prior)


def plan_frame(track: Float[np.ndarray, "scan 2"]) -> PlanFrame:
    """Follow a straight road from its start; anything else is drawn on the map."""
    track = track[np.isfinite(track).all(axis=1)]
    if len(track) < 2:
        return PlanFrame((0.0, 0.0), 0.0, along_road=False)
    # The principal axis, not the line from first to last point: a prior's ends drift.
    middle = track.mean(axis=0)
    axis = np.linalg.svd(track - middle, full_matrices=False)[2][0]
    way = axis if axis @ (track[-1] - track[0]) >= 0.0 else -axis
    start = middle + way * ((track[0] - middle) @ way)
    frame = PlanFrame((float(start[0]), float(start[1])), float(np.arctan2(way[1], way[0])), along_road=True)
    along, cross = frame(track[:, 0], track[:, 1])
    if np.ptp(along) == 0.0 or np.ptp(cross) > _STRAIGHT * np.ptp(along):
        return PlanFrame((0.0, 0.0), 0.0, along_road=False)
    return frame


def draw_plan(
    axes: Axes, result: DriveResult, frame: PlanFrame, error_m: Float[np.ndarray, " scan"], limit_m: float
) -> PathCollection:
    """Draw baselines, truth, prior and the fixes coloured by ``error_m``; return the fixes for the colour bar."""
    axes.set_facecolor(_GROUND)
    for number, track in enumerate(result.baseline_tracks):
        label = "baseline drives" if number == 0 else "_"
        axes.plot(*frame(track[:, 0], track[:, 1]), color="white", linewidth=2.5, label=label, zorder=1)
    drawn = [frame(result.prior_east_m, result.prior_north_m)]
    axes.plot(*drawn[0], color=BLUE, linewidth=1.2, linestyle=(0, (3, 2)), label="prior", zorder=2)
    if result.truth_east_m is not None and result.truth_north_m is not None:
        drawn.append(frame(result.truth_east_m, result.truth_north_m))
        # Stretched, fixes are next to the truth and would hide it; on a map they are on it, and it would hide them.
        over = 5.0 if frame.along_road else 3.0
        axes.plot(*drawn[1], color=INK, linewidth=0.9, label="truth", zorder=over)
    declined = result.tried & ~result.ok
    if declined.any():
        place = frame(result.prior_east_m[declined], result.prior_north_m[declined])
        axes.plot(*place, "x", color=MUTED, markersize=4, mew=1.0, label="declined (at the prior)", zorder=2.5)
    drawn.append(frame(result.east_m[result.ok], result.north_m[result.ok]))
    known = np.isfinite(error_m)
    judged, blind = result.ok & known, result.ok & ~known
    if blind.any():
        place = frame(result.east_m[blind], result.north_m[blind])
        axes.plot(*place, "o", color=MUTED, markersize=4, mew=0.0, label="ok fixes, true pose unknown", zorder=4)
    fixes = frame(result.east_m[judged], result.north_m[judged])
    points = axes.scatter(
        *fixes, c=error_m[judged], s=16, cmap=ERROR_MAP, vmin=-limit_m, vmax=limit_m, linewidth=0, zorder=4
    )
    if judged.any():
        axes.plot([], [], "o", color=colormaps[ERROR_MAP](0.85), markersize=5, label="ok fixes, coloured by error")
    _set_limits(axes, frame, drawn)
    axes.legend(
        loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=5, facecolor=_GROUND, framealpha=1.0, edgecolor="none"
    )
    return points


def name_axes(axes: Axes, result: DriveResult, frame: PlanFrame) -> str:
    """Label the axes; return a sentence for the caption."""
    anchor = f"{result.origin[0]:.6f}°, {result.origin[1]:.6f}°"
    if not frame.along_road:
        axes.set_xlabel("east (m)")
        axes.set_ylabel("north (m)")
        return f"Plan: metres about latitude, longitude {anchor}; equal aspect."
    bearing = np.degrees(np.pi / 2.0 - frame.yaw_rad) % 360.0
    axes.set_xlabel(f"along the road (m), towards {bearing:.0f}°")
    axes.set_ylabel("left (m)")
    return (
        f"Plan: along and left of the road from east {frame.centre[0]:.2f} m, north {frame.centre[1]:.2f} m about "
        f"latitude, longitude {anchor}."
    )


def _set_limits(
    axes: Axes, frame: PlanFrame, drawn: list[tuple[Float[np.ndarray, " _"], Float[np.ndarray, " _"]]]
) -> None:
    """Frame the drive, not the map: baselines may continue for kilometres."""
    along = np.concatenate([x for x, _ in drawn])
    cross = np.concatenate([y for _, y in drawn])
    for values, setter in ((along, axes.set_xlim), (cross, axes.set_ylim)):
        finite = values[np.isfinite(values)]
        low, high = (float(finite.min()), float(finite.max())) if finite.size else (0.0, 0.0)
        half = max(0.5 * (high - low) * 1.08, _LEAST_HALF_WIDTH_M)
        # auto: an equal aspect may widen what is set here.
        setter(0.5 * (low + high) - half, 0.5 * (low + high) + half, auto=not frame.along_road)
    if not frame.along_road:
        axes.set_aspect("equal", adjustable="datalim")


_LEAST_LIMIT_M = 0.02
_LEAST_LIMIT_DEG = 0.5


def draw_trajectory(result: DriveResult, path: str | Path, *, force: bool = False) -> None:
    """Draw the plan coloured by cross-track error; below it the errors and the correlation over distance.

    Without truth the differences from the prior are drawn instead of errors, and labelled so.

    Raises:
        InputError: the file exists (without ``force``) or cannot be written.
    """
    errors = track_errors(result)
    word = "error" if result.has_truth else "fix − prior"
    heading = result.yaw_rad is not None and result.truth_yaw_rad is not None
    frame = plan_frame(reference_track(result))
    heights = [3.0 if frame.along_road else 5.0, 2.0, 2.0] + [1.5] * heading + [1.9]
    with picture(path, 11.0, 2.0 + sum(heights), force) as figure:
        plan, *panels = figure.subplots(len(heights), 1, height_ratios=heights)
        # The plan runs over coordinates, the others over travel: only these share an axis.
        for panel in panels[1:]:
            panel.sharex(panels[0])
        for panel in panels[:-1]:
            panel.tick_params(labelbottom=False)
        panels[-1].set_xlabel("distance driven (m)")
        _limit_distance(panels[0], result.distance_m)

        limit = _colour_limit(errors.cross_m[result.ok])
        points = draw_plan(plan, result, frame, errors.cross_m, limit)
        figure.colorbar(points, ax=plan, label=f"cross-track {word} (m)", extend="both", pad=0.01, aspect=15)

        _draw_error(panels[0], result, errors.cross_m, result.sigma_cross_m)
        panels[0].set_ylabel(f"cross-track\n{word} (m)\nleft positive")
        _draw_error(panels[1], result, errors.along_m, result.sigma_along_m)
        panels[1].set_ylabel(f"along-track\n{word} (m)\nahead positive")
        if heading:
            _draw_heading_error(panels[2], result)
        _draw_correlation(panels[-1], result)
        for panel in panels:
            _hatch_gnss_gaps(panel, result)
            _shade_declined(panel, result)
        for panel in (panels[0], panels[-1]):
            if panel.get_legend_handles_labels()[0]:
                panel.legend(loc="lower right", bbox_to_anchor=(1.0, 0.97), ncols=4, frameon=False)
        figure.align_ylabels([plan, *panels])

        _set_title(figure, result)
        notes = [] if result.has_truth else ["True poses unknown: differences from the prior, not errors."]
        blind = int((result.ok & ~np.isfinite(errors.cross_m)).sum())
        if blind:
            notes.append(f"The true pose of {blind} ok fixes is unknown; their errors are not drawn.")
        notes.append("Shaded: tried scans without an ok fix.")
        if result.gnss_gap is not None and result.gnss_gap.any():
            notes.append("Hatched at the bottom: GNSS/INS silent for a second, or its sigma three times its best.")
        caption = " ".join([name_axes(plan, result, frame), *notes])
        if frame.along_road:
            write_stretch_caption(plan, caption, "Across")
        else:
            write_caption(figure, caption)


def _set_title(figure: Figure, result: DriveResult) -> None:
    kind = " (impostor: other ground)" if result.impostor else ""
    ok, tried = int(result.ok.sum()), int(result.tried.sum())
    figure.suptitle(f"{result.name}{kind} on {result.map_name}: {ok} of {tried} tried scans have an ok fix")


def _draw_error(
    axes: Axes, result: DriveResult, error_m: Float[np.ndarray, " scan"], sigma_m: Float[np.ndarray, " scan"]
) -> None:
    axes.axhline(0.0, color=MUTED, linewidth=0.8)
    shown = error_m[result.ok]
    if not np.isfinite(shown).any():
        text = "true poses of the ok fixes unknown" if len(shown) else "no ok fix"
        axes.set_ylim(-1.0, 1.0)
        axes.text(0.5, 0.72, text, transform=axes.transAxes, ha="center", va="center", color=MUTED, fontsize=12)
        return
    distance, ok = result.distance_m[result.tried], result.ok[result.tried]
    sigma = np.where(ok, sigma_m[result.tried], np.nan)
    _draw_bands(axes, distance, sigma)
    axes.plot(result.distance_m[result.ok], shown, ".", color=INK, markersize=_dot_size(shown), label="ok fixes")
    limit = _error_limit(shown, sigma, _LEAST_LIMIT_M)
    axes.set_ylim(-limit, limit)


def _draw_bands(axes: Axes, distance_m: Float[np.ndarray, " tried"], sigma: Float[np.ndarray, " tried"]) -> None:
    for number, shade in ((3.0, 0.22), (1.0, 0.45)):
        label = f"± {number:.0f} σ of the fix"
        axes.fill_between(distance_m, -number * sigma, number * sigma, color=SKY, alpha=shade, linewidth=0, label=label)


def _draw_heading_error(axes: Axes, result: DriveResult) -> None:
    assert result.yaw_rad is not None
    assert result.truth_yaw_rad is not None
    off = result.yaw_rad - result.truth_yaw_rad
    error_deg = np.degrees(np.arctan2(np.sin(off), np.cos(off)))
    axes.axhline(0.0, color=MUTED, linewidth=0.8)
    sigma_deg = np.full(len(error_deg), np.nan)
    if result.sigma_yaw_rad is not None:
        sigma_deg = np.where(result.ok, np.degrees(result.sigma_yaw_rad), np.nan)
        _draw_bands(axes, result.distance_m[result.tried], sigma_deg[result.tried])
    axes.plot(result.distance_m[result.ok], error_deg[result.ok], ".", color=INK, markersize=_dot_size(error_deg))
    limit = _error_limit(error_deg[result.ok], sigma_deg, _LEAST_LIMIT_DEG)
    axes.set_ylim(-limit, limit)
    axes.set_ylabel("heading\nerror (°)\nleft positive")


def _draw_correlation(axes: Axes, result: DriveResult) -> None:
    if result.correlation_at_truth is not None:
        # Known at the searched scans, between which a continuous line is drawn.
        known = np.isfinite(result.correlation_at_truth)
        at_truth = result.correlation_at_truth[known]
        axes.plot(result.distance_m[known], at_truth, color=MUTED, linewidth=1.0, label="at the truth")
    declined = result.tried & ~result.ok
    for scans, marker, colour, size, label in (
        (declined, "x", VERMILLION, 4.0, "declined"),
        (result.ok, ".", BLUE, _dot_size(result.code), "ok fixes"),
    ):
        axes.plot(result.distance_m[scans], result.correlation[scans], marker, color=colour, ms=size, label=label)
    axes.set_ylim(0.0, 1.02)
    axes.set_ylabel("correlation")


def _shade_declined(axes: Axes, result: DriveResult) -> None:
    """Shade each run of tried scans without an ok fix, out to half-way to its neighbours."""
    spans = _spans(result.distance_m[result.tried], ~result.ok[result.tried])
    if spans:
        # Height in shares of the panel, so that the limits of the errors do not change.
        axes.broken_barh(spans, (0.0, 1.0), transform=axes.get_xaxis_transform(), facecolor=GAP, zorder=0)


def _hatch_gnss_gaps(axes: Axes, result: DriveResult) -> None:
    """Hatch the bottom of a panel where there was no GNSS: this is where fixes matter."""
    spans = [] if result.gnss_gap is None else _spans(result.distance_m, result.gnss_gap)
    if spans:
        at = axes.get_xaxis_transform()
        axes.broken_barh(spans, (0.0, 0.1), transform=at, facecolor="none", hatch="////", edgecolor=ORANGE, lw=0.0)


def _spans(distance_m: Float[np.ndarray, " scan"], held: Bool[np.ndarray, " scan"]) -> list[tuple[float, float]]:
    """Start and length of each run of held scans, out to half-way to its neighbours."""
    middle = 0.5 * (distance_m[1:] + distance_m[:-1])
    edge = np.concatenate([distance_m[:1], middle, distance_m[-1:]])
    return [(float(edge[first]), float(edge[last] - edge[first])) for first, last in runs_of(held)]


def _limit_distance(axes: Axes, distance_m: Float[np.ndarray, " scan"]) -> None:
    finite = distance_m[np.isfinite(distance_m)]
    low, high = (float(finite.min()), float(finite.max())) if finite.size else (0.0, 0.0)
    pad = 0.01 * (high - low) or 0.5
    axes.set_xlim(low - pad, high + pad)


def _colour_limit(error_m: Float[np.ndarray, " fix"]) -> float:
    finite = np.abs(error_m[np.isfinite(error_m)])
    return max(float(np.percentile(finite, 98.0)), _LEAST_LIMIT_M) if finite.size else _LEAST_LIMIT_M


def _error_limit(error: Float[np.ndarray, " fix"], sigma: Float[np.ndarray, " tried"], least: float) -> float:
    """Every ok fix stays visible, however wrong; the bands only as far as they do not flatten the errors."""
    errors, sigmas = (np.abs(values[np.isfinite(values)]) for values in (error, sigma))
    largest = float(errors.max()) if errors.size else 0.0
    band = 3.0 * float(np.percentile(sigmas, 95.0)) if sigmas.size else 0.0
    return 1.15 * max(largest, min(band, 5.0 * largest), least)


def _dot_size(values: Shaped[np.ndarray, " fix"]) -> float:
    """Points; thousands of dots shrink, or they would hide the bands behind them."""
    return float(np.clip(110.0 / np.sqrt(max(len(values), 1)), 1.0, 3.5))


# A course driven in closed loop: the track, its distance from the baseline, and the errors of navigation.

_FOOT_CM = 30.48
_SHADE = 0.25


class DrivenResult(NamedTuple):
    """A drive, tick by tick; lengths in metres.

    Attributes:
        name: name for the title.
        baseline_m: true track of the baseline's anchor.
        track_m: true track of the anchor.
        way_m: distance driven so far.
        engaged: whether the autopilot drove.
        tracking_m: offset of the anchor from the baseline's line, left positive.
        located_m, sigma_m: cross-track error of the pose used for control, and its sigma by the filter.
        switch_m, gnss_ins_m: cross-track errors of the threshold switch and of GNSS/INS without LGPR, run in parallel.
        speed_mps, limit_mps: true and commanded speed.
        front_rad: angle of the front wheels.
        fix: whether there was an ok fix.
    """

    name: str
    baseline_m: Float[np.ndarray, "point 2"]
    track_m: Float[np.ndarray, "tick 2"]
    way_m: Float[np.ndarray, " tick"]
    engaged: Bool[np.ndarray, " tick"]
    tracking_m: Float[np.ndarray, " tick"]
    located_m: Float[np.ndarray, " tick"]
    sigma_m: Float[np.ndarray, " tick"]
    switch_m: Float[np.ndarray, " tick"]
    gnss_ins_m: Float[np.ndarray, " tick"]
    speed_mps: Float[np.ndarray, " tick"]
    limit_mps: Float[np.ndarray, " tick"]
    front_rad: Float[np.ndarray, " tick"]
    fix: Bool[np.ndarray, " tick"]


def draw_driven_course(result: DrivenResult, path: str | Path, *, force: bool = False) -> None:
    """Draw the plan, and below it tracking, errors of the position, speed and steering over distance.

    Raises:
        InputError: the file exists (without ``force``) or cannot be written.
    """
    with picture(path, 11.0, 13.5, force) as figure:
        plan, tracking, located, speed, steering = figure.subplots(5, 1, height_ratios=[3.6, 2.0, 2.0, 1.3, 1.3])
        figure.colorbar(
            _draw_plan(plan, result),
            ax=plan,
            label="distance from the\nbaseline (cm)",
            extend="max",
            pad=0.01,
            aspect=18,
        )
        for panel in (located, speed, steering):
            panel.sharex(tracking)
        for panel in (tracking, located, speed):
            panel.tick_params(labelbottom=False)
        on = result.engaged
        for panel in (tracking, located, speed, steering):
            panel.grid(axis="y", color=GAP)
            if not on.all():
                panel.axvspan(0.0, result.way_m[np.argmax(on)], color=GAP, zorder=0)
        tracking.set_xlim(0.0, result.way_m[-1])
        for sign in (-1.0, 1.0):
            tracking.axhline(sign * _FOOT_CM, color=MUTED, linewidth=1.0, linestyle=(0, (4, 2)))
        tracking.plot(result.way_m, 100.0 * result.tracking_m, color=BLUE, linewidth=0.8)
        tracking.set_ylabel("anchor from the\nbaseline (cm)\nleft positive")
        rms = 100.0 * np.sqrt(np.mean(result.tracking_m[on] ** 2))
        largest = 100.0 * np.abs(result.tracking_m[on]).max()
        tracking.set_title(f"Tracking: {rms:.1f} cm RMS, at most {largest:.0f} cm; dashed: one foot")
        _draw_located(located, result)
        speed.plot(result.way_m, result.limit_mps, color=FAINT, linewidth=1.6, label="wanted")
        speed.plot(result.way_m, result.speed_mps, color=GREEN, linewidth=0.8, label="true")
        speed.set_ylabel("speed (m/s)")
        speed.set_ylim(bottom=0.0)
        speed.legend(loc="lower right", ncols=2, frameon=False)
        steering.plot(result.way_m, np.degrees(result.front_rad), color=INK, linewidth=0.7)
        steering.set_ylabel("front wheels (°)\nleft positive")
        steering.set_xlabel("distance driven (m)")
        figure.align_ylabels([tracking, located, speed, steering])
        figure.suptitle(result.name)
        share = float(np.mean(result.fix[on]))
        write_caption(
            figure,
            f"Grey: a driver brings the vehicle to the route. A fix in {share:.0%} of the autopilot's ticks. "
            "Shaded around zero: twice the sigma of the filter. Threshold switch and GNSS/INS ran in parallel "
            "without steering.",
        )


def _draw_plan(axes: Axes, result: DrivenResult) -> PathCollection:
    on = result.engaged
    limit = max(float(np.percentile(np.abs(100.0 * result.tracking_m[on]), 99)), 1.0)
    axes.plot(*result.baseline_m.T, color=FAINT, linewidth=4.0, zorder=1, label="baseline")
    x, y = result.track_m[on].T
    colour = np.abs(100.0 * result.tracking_m[on])
    points = axes.scatter(x, y, c=colour, s=3.0, cmap="viridis", vmin=0.0, vmax=limit, zorder=2)
    first, last = result.track_m[np.argmax(on)], result.track_m[-1]
    axes.plot(*first, marker="o", color=GREEN, markersize=7.0, zorder=3, linestyle="", label="engaged")
    axes.plot(*last, marker="s", color=VERMILLION, markersize=7.0, zorder=3, linestyle="", label="end")
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_xlabel("east (m)")
    axes.set_ylabel("north (m)")
    axes.legend(loc="best", frameon=False)
    return points


def _draw_located(axes: Axes, result: DrivenResult) -> None:
    on = result.engaged
    axes.fill_between(
        result.way_m, -200.0 * result.sigma_m, 200.0 * result.sigma_m, color=SKY, alpha=_SHADE, linewidth=0.0
    )
    axes.plot(result.way_m, 100.0 * result.gnss_ins_m, color=FAINT, linewidth=1.0, label="GNSS/INS")
    axes.plot(result.way_m, 100.0 * result.switch_m, color=ORANGE, linewidth=0.7, label="threshold switch")
    axes.plot(result.way_m, 100.0 * result.located_m, color=BLUE, linewidth=0.9, label="filter")
    reach = 100.0 * float(np.percentile(np.abs(np.concatenate([result.switch_m[on], result.located_m[on]])), 99.5))
    axes.set_ylim(-2.0 * max(reach, 1.0), 2.0 * max(reach, 1.0))
    axes.set_ylabel("cross-track error of\nthe position (cm)")
    rms = [
        f"{name} {100.0 * np.sqrt(np.mean(values[on] ** 2)):.1f}"
        for name, values in (
            ("filter", result.located_m),
            ("threshold switch", result.switch_m),
            ("GNSS/INS", result.gnss_ins_m),
        )
    ]
    axes.set_title(f"Position, cm RMS: {', '.join(rms)}")
    axes.legend(loc="lower right", ncols=3, frameon=False)


# Reliability of fixes: stated and true errors, errors by evidence, and declined fixes.

_BINS = 8
_LEAST_IN_BIN = 20
_LEAST_CM = 0.1
_EVIDENCE_COLOURS = (SKY, BLUE, INK)


@dataclass(frozen=True, kw_only=True)
class StatedErrors:
    """Tried fixes with known truth, of any drives, one row per fix.

    Attributes:
        name: name of the drives.
        along_m, cross_m: fix minus truth; NaN without a pose.
        sigma_along_m, sigma_cross_m: standard deviations stated by the fix.
        evidence: −log₁₀ of the probability that foreign ground matches as well, decades.
        ok: whether the fix is accepted; the others are rejected.
    """

    name: str
    along_m: Float[np.ndarray, " fix"]
    cross_m: Float[np.ndarray, " fix"]
    sigma_along_m: Float[np.ndarray, " fix"]
    sigma_cross_m: Float[np.ndarray, " fix"]
    evidence: Float[np.ndarray, " fix"]
    ok: Bool[np.ndarray, " fix"]

    @property
    def total_m(self) -> Float[np.ndarray, " fix"]:
        """Distance from the truth."""
        return np.asarray(np.hypot(self.along_m, self.cross_m))


def stated_errors(results: Sequence[DriveResult]) -> StatedErrors:
    """The tried fixes of drives with known truth.

    Impostors are left out, as their distances mean nothing, and scans outside the truth's time span.
    """
    judged = [result for result in results if result.has_truth and not result.impostor]
    parts: list[tuple[np.ndarray, ...]] = [tuple(np.zeros(0) for _ in range(5)) + (np.zeros(0, bool),)]
    for result in judged:
        assert result.truth_east_m is not None
        assert result.truth_north_m is not None
        errors = track_errors(result)
        known = result.tried & np.isfinite(result.truth_east_m + result.truth_north_m)
        columns = (*errors, result.sigma_along_m, result.sigma_cross_m, -np.log10(np.maximum(result.p_false, LEAST_P)))
        parts.append((*(np.asarray(column, np.float64)[known] for column in columns), result.ok[known]))
    along, cross, sigma_along, sigma_cross, evidence, ok = (np.concatenate(c) for c in zip(*parts, strict=True))
    return StatedErrors(
        name=", ".join(result.name for result in judged),
        along_m=along,
        cross_m=cross,
        sigma_along_m=sigma_along,
        sigma_cross_m=sigma_cross,
        evidence=evidence,
        ok=ok,
    )


def draw_confidence(stated: StatedErrors, path: str | Path, *, force: bool = False) -> None:
    """Draw the reliability of the sigmas, errors by evidence, and the effect of a smaller risk.

    Raises:
        InputError: the file exists (without ``force``) or cannot be written.
    """
    declined, tried = int((~stated.ok).sum()), len(stated.ok)
    share = f"{100.0 * declined / tried:.1f} % of {tried} tried fixes declined" if tried else "true pose unknown"
    with picture(path, 12.5, 5.0, force) as figure:
        reliability, by_evidence, by_risk = figure.subplots(1, 3)
        _draw_reliability(reliability, stated)
        _draw_by_evidence(by_evidence, stated)
        _draw_by_risk(by_risk, stated)
        figure.suptitle(f"{stated.name or 'No drive'}: {share}")
        write_caption(
            figure,
            "Left: ok fixes in bins of equal number; root mean square error over stated sigma; bars: 95 % for "
            "independent errors (errors within a drive are correlated). Right: a required evidence in addition to "
            f"the codes; wrong: error above {WRONG_M:g} m.",
        )


def _draw_reliability(axes: Axes, stated: StatedErrors) -> None:
    axes.set_title("stated and true error")
    rows = (
        ("along", stated.along_m, stated.sigma_along_m, BLUE, "o"),
        ("cross", stated.cross_m, stated.sigma_cross_m, ORANGE, "s"),
    )
    drawn: list[np.ndarray] = []
    for name, error_m, sigma_m, colour, marker in rows:
        good = stated.ok & np.isfinite(error_m) & (sigma_m > 0.0) & np.isfinite(sigma_m)
        if not good.any():
            continue
        error_cm, sigma_cm = 100.0 * error_m[good], 100.0 * sigma_m[good]
        bins = np.array_split(np.argsort(sigma_cm), max(1, min(_BINS, good.sum() // _LEAST_IN_BIN)))
        sigma = np.array([np.sqrt(np.mean(sigma_cm[b] ** 2)) for b in bins])
        rms = np.maximum([np.sqrt(np.mean(error_cm[b] ** 2)) for b in bins], 0.1 * _LEAST_CM)
        # The relative standard deviation of the root of a mean of n squares is 1/sqrt(2 n); in the exponent it stays
        # positive.
        factor = np.exp(1.96 / np.sqrt(2.0 * np.array([len(b) for b in bins])))
        within = [100.0 * float(np.mean(np.abs(error_cm) <= n * sigma_cm)) for n in (1.0, 3.0)]
        label = f"{name}: {within[0]:.0f} % within 1 σ, {within[1]:.1f} % within 3 σ"
        bars = [rms - rms / factor, rms * factor - rms]
        axes.errorbar(
            sigma, rms, yerr=bars, fmt=marker, color=colour, ecolor=colour, elinewidth=1.0, capsize=2.5, label=label
        )
        drawn += [sigma, rms / factor, rms * factor]
    if not drawn:
        _say_nothing(axes)
        return
    values = np.concatenate(drawn)
    span = np.array([0.7 * values.min(), 1.4 * values.max()])
    axes.plot(span, span, color=INK, linewidth=1.2, zorder=1)
    axes.fill_between(span, span / 2.0, span * 2.0, color=GAP, zorder=0)
    axes.set(xscale="log", yscale="log", xlim=span, ylim=span, aspect="equal")
    axes.text(0.04, 0.96, "too sure", transform=axes.transAxes, va="top", color=MUTED)
    axes.text(0.96, 0.04, "too modest", transform=axes.transAxes, ha="right", color=MUTED)
    label_decades(axes.xaxis)
    label_decades(axes.yaxis)
    axes.set_xlabel("stated σ (cm); shaded: within a factor of two")
    axes.set_ylabel("true error, RMS (cm)")
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.18), frameon=False, handletextpad=0.2)


def _draw_by_evidence(axes: Axes, stated: StatedErrors) -> None:
    axes.set_title("error by evidence")
    total_cm = np.maximum(100.0 * stated.total_m, _LEAST_CM)
    posed = np.isfinite(total_cm)
    good = np.flatnonzero(stated.ok & posed & np.isfinite(stated.evidence))
    thirds = np.array_split(good[np.argsort(stated.evidence[good])], min(len(_EVIDENCE_COLOURS), max(len(good), 1)))
    for members, colour in zip(thirds, _EVIDENCE_COLOURS, strict=False):
        if len(members):
            low, high = stated.evidence[members[[0, -1]]]
            _draw_distribution(axes, total_cm[members], colour, "-", f"ok, evidence {low:.1f} to {high:.1f}")
    declined = ~stated.ok & posed
    if declined.any():
        _draw_distribution(
            axes, total_cm[declined], VERMILLION, (0, (4, 2)), f"declined, with a pose: {int(declined.sum())}"
        )
    if not len(good) and not declined.any():
        _say_nothing(axes)
        return
    axes.axvline(100.0 * WRONG_M, color=MUTED, linewidth=1.0, linestyle=":")
    axes.set_xscale("log")
    label_decades(axes.xaxis)
    axes.set_ylim(0.0, 101.0)
    axes.set_xlabel(f"distance from the truth (cm); dotted: {100.0 * WRONG_M:g} cm")
    axes.set_ylabel("share of the fixes with at most this error (%)")
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.18), frameon=False)


def _draw_distribution(
    axes: Axes, values: Float[np.ndarray, " fix"], colour: str, style: str | tuple[int, tuple[int, int]], label: str
) -> None:
    share = 100.0 * np.arange(1, len(values) + 1) / len(values)
    # Starts at zero, or a single fix would have no line.
    x, y = np.concatenate([[values.min()], np.sort(values)]), np.concatenate([[0.0], share])
    axes.plot(x, y, color=colour, linestyle=style, linewidth=1.8, drawstyle="steps-post", label=label)


def _draw_by_risk(axes: Axes, stated: StatedErrors) -> None:
    axes.set_title("fixes lost at a smaller risk")
    total_m, tried = stated.total_m, len(stated.ok)
    held = stated.ok & np.isfinite(total_m) & np.isfinite(stated.evidence)
    if not held.any():
        _say_nothing(axes)
        return
    evidence = np.sort(stated.evidence[held])
    least = np.concatenate([[min(0.0, evidence[0])], evidence])
    kept = held.sum() - np.searchsorted(evidence, least, "left")
    wrong = np.sort(stated.evidence[held & (total_m > WRONG_M)])
    left_wrong = len(wrong) - np.searchsorted(wrong, least, "left")
    axes.plot(
        least, 100.0 * (1.0 - kept / tried), color=BLUE, lw=2.0, drawstyle="steps-pre", label="declined, of all tried"
    )
    shares = 100.0 * left_wrong / np.maximum(kept, 1)
    label = f"wrong, of the accepted: {len(wrong)} now"
    axes.plot(least, shares, color=VERMILLION, lw=2.0, linestyle="--", drawstyle="steps-pre", label=label)
    axes.axvline(evidence[0], color=FAINT, linewidth=1.0, zorder=0)
    axes.set_ylim(-1.0, 101.0)
    axes.set_xlabel("required evidence (decades); grey: least ok")
    axes.set_ylabel("share (%)")
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.18), frameon=False)


def _say_nothing(axes: Axes) -> None:
    axes.set(xticks=[], yticks=[])
    axes.text(0.5, 0.5, "no fix to show", transform=axes.transAxes, ha="center", va="center", color=MUTED)
