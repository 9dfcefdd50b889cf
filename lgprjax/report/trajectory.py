"""A drive as it went: the plan, and its errors and correlation against the distance driven."""

from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float, Shaped
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from lgprjax.report.plan import draw_plan, name_axes, plan_frame, reference_track
from lgprjax.report.results import DriveResult, track_errors
from lgprjax.report.style import BLUE, GAP, INK, MUTED, ORANGE, SKY, VERMILLION, picture, runs_of, write_caption

_LEAST_LIMIT_M = 0.02
_LEAST_LIMIT_DEG = 0.5


def draw_trajectory(result: DriveResult, path: str | Path, *, force: bool = False) -> None:
    """Draw the plan coloured by cross-track error; below it the errors and the correlation over distance.

    Without truth the differences from the prior stand in the errors' place, and are called so.

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
        notes = [] if result.has_truth else ["No truth: what is drawn are differences from the prior, not errors."]
        notes.append("Shaded: tried, but no ok fix.")
        if result.gnss_gap is not None and result.gnss_gap.any():
            notes.append("Hatched at the foot: GNSS/INS silent for a second, or its sigma three times its best.")
        # Twice, because the caption states a stretch that its own height changes.
        for _ in range(2):
            write_caption(figure, " ".join([name_axes(plan, result, frame), *notes]))


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
        axes.set_ylim(-1.0, 1.0)
        axes.text(0.5, 0.72, "no ok fix", transform=axes.transAxes, ha="center", va="center", color=MUTED, fontsize=12)
        return
    distance, ok = result.distance_m[result.tried], result.ok[result.tried]
    sigma = np.where(ok, sigma_m[result.tried], np.nan)
    _draw_bands(axes, distance, sigma)
    reach = 0.0
    if result.prior_sigma_m is not None and not result.has_truth:
        reach = result.prior_sigma_m
        for sign, label in ((1.0, "± σ of the prior"), (-1.0, "_")):
            axes.axhline(sign * reach, color=MUTED, linewidth=1.0, linestyle=":", label=label)
    axes.plot(result.distance_m[result.ok], shown, ".", color=INK, markersize=_dot_size(shown), label="ok fixes")
    limit = _error_limit(shown, sigma, reach, _LEAST_LIMIT_M)
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
    limit = _error_limit(error_deg[result.ok], sigma_deg, 0.0, _LEAST_LIMIT_DEG)
    axes.set_ylim(-limit, limit)
    axes.set_ylabel("heading\nerror (°)\nleft positive")


def _draw_correlation(axes: Axes, result: DriveResult) -> None:
    if result.correlation_at_truth is not None:
        # Known at the scans that were searched, between which a line without a gap is drawn.
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
        # Height in shares of the panel, so that the limits of the errors stay theirs.
        axes.broken_barh(spans, (0.0, 1.0), transform=axes.get_xaxis_transform(), facecolor=GAP, zorder=0)


def _hatch_gnss_gaps(axes: Axes, result: DriveResult) -> None:
    """Hatch the foot of a panel where there was no GNSS: what the fixes are like there is what they are for."""
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


def _error_limit(
    error: Float[np.ndarray, " fix"], sigma: Float[np.ndarray, " tried"], reach: float, least: float
) -> float:
    """Every ok fix stays in sight, however wrong; the bands as far as they do not flatten the errors."""
    errors, sigmas = (np.abs(values[np.isfinite(values)]) for values in (error, sigma))
    largest = float(errors.max()) if errors.size else 0.0
    band = max(3.0 * float(np.percentile(sigmas, 95.0)) if sigmas.size else 0.0, reach)
    return 1.15 * max(largest, min(band, 5.0 * largest), least)


def _dot_size(values: Shaped[np.ndarray, " fix"]) -> float:
    """Points; thousands of dots shrink, or they would hide the bands behind them."""
    return float(np.clip(110.0 / np.sqrt(max(len(values), 1)), 1.0, 3.5))
