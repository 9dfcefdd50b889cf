"""A course driven in closed loop: where it led, how far from the baseline, and what navigation knew meanwhile."""

from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float
from matplotlib.axes import Axes
from matplotlib.collections import PathCollection

from lgprjax.report.style import BLUE, FAINT, GAP, GREEN, INK, MUTED, ORANGE, SKY, VERMILLION, picture, write_caption

_FOOT_CM = 30.48
_SHADE = 0.25


class DrivenResult(NamedTuple):
    """A drive, tick by tick; lengths in metres.

    Attributes:
        name: in the title.
        baseline_m: true track of the baseline's anchor.
        track_m: true track of the anchor.
        way_m: driven so far.
        engaged: the autopilot drove.
        tracking_m: anchor from the baseline's line, left positive.
        located_m: cross-track error of the pose that was driven by; sigma_m of it, as the filter says.
        switch_m, gnss_ins_m: of the threshold switch and of GNSS/INS without LGPR, run beside it.
        speed_mps: true; limit_mps: wanted.
        front_rad: of the front wheels.
        fix: there was an ok fix.
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
    """Draw the plan, and below it tracking, errors of the position, speed and steering against the way driven.

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
        steering.set_xlabel("way driven (m)")
        figure.align_ylabels([tracking, located, speed, steering])
        figure.suptitle(result.name)
        share = float(np.mean(result.fix[on]))
        write_caption(
            figure,
            f"Grey: a driver brings the vehicle on its way. A fix in {share:.0%} of the autopilot's ticks. The shade "
            "about zero is twice the sigma of the filter. Threshold switch and GNSS/INS ran beside it and steered "
            "nothing.",
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
