"""Pictures of tracking, of the identified loop with logged runs, and of a look-ahead found from logs."""

import textwrap
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from lgprjax.report.style import BLUE, FAINT, GREEN, MUTED, VERMILLION, picture, write_caption

_MOST = 4
_LABEL_CHARACTERS = 24


def _legend_above(ax: Axes) -> None:
    """Draw the legend in one row next to the title, away from the curves."""
    ax.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=2, frameon=False)


def draw_tracking(detail: Any, path: Path, force: bool = False) -> None:
    """Offsets over time, steered by autopilot and by driver, and RMS by speed with its intervals.

    Raises:
        InputError: the file exists (without ``force``) or cannot be written.
    """
    shown = list(zip(detail.names, detail.drives, strict=True))[:_MOST]
    with picture(path, 9.6, 1.9 * (len(shown) + 1) + 0.8, force) as figure:
        axes = figure.subplots(len(shown) + 1, 1, squeeze=False)[:, 0]
        for ax, (name, one) in zip(axes, shown, strict=False):
            time_s = one.time_s - one.time_s[0]
            ax.axhline(0.0, color=MUTED, linewidth=0.8)
            ax.fill_between(time_s, one.offset_m - 2.0 * one.sigma_m, one.offset_m + 2.0 * one.sigma_m, color=FAINT)
            for who, colour, mask in (("autopilot", BLUE, one.engaged), ("driver", VERMILLION, ~one.engaged)):
                if mask.any():
                    ax.plot(time_s, np.where(mask, one.offset_m, np.nan), color=colour, linewidth=1.2, label=who)
            ax.set_ylabel("offset (m)")
            ax.set_title(name)
            _legend_above(ax)
        axes[len(shown) - 1].set_xlabel("time (s)")
        last = axes[-1]
        for engaged, colour, label in ((True, BLUE, "autopilot"), (False, VERMILLION, "driver")):
            bands = [band for band in detail.bands if band.engaged == engaged]
            if not bands:
                continue
            middle = np.array([0.5 * (band.low_mps + band.high_mps) for band in bands])
            rms = np.array([band.rms_m.value for band in bands])
            away = np.array([[band.rms_m.value - band.rms_m.low, band.rms_m.high - band.rms_m.value] for band in bands])
            last.errorbar(middle, rms, yerr=away.T, fmt="o", color=colour, capsize=3.0, label=label)
        last.set_ylim(bottom=0.0)
        last.set_xlabel("speed (m/s)")
        last.set_ylabel("rms (m)")
        if detail.bands:
            _legend_above(last)
        write_caption(figure, "Offsets from the path by smoothed fixes, left positive; bands and bars are 95 %.")


_LABELS = {
    "lag_s": "lag",
    "delay_s": "delay",
    "rate_radps": "rate",
    "rear_ratio": "rear ratio",
    "slip_s2pm2": "slip",
}


def draw_loop(detail: Any, path: Path, force: bool = False) -> None:
    """Draw the narrowing of each number by the drives, and logged stretches with their rollouts.

    Raises:
        InputError: the file exists (without ``force``) or cannot be written.
    """
    shown = detail.predicted[:_MOST]
    with picture(path, 9.6, 2.0 * (len(shown) + 1) + 0.8, force) as figure:
        axes = figure.subplots(len(shown) + 1, 1, squeeze=False)[:, 0]
        names = list(_LABELS)
        width = [min(detail.fit.narrowed[name], 1.0) for name in names]
        colours = [GREEN if name in detail.fit.told else VERMILLION for name in names]
        hatches = ["" if name in detail.fit.told else "//" for name in names]
        axes[0].bar(
            [_LABELS[name] for name in names], width, color=colours, hatch=hatches, edgecolor="white", width=0.6
        )
        axes[0].axhline(0.5, color=MUTED, linewidth=0.8)
        axes[0].set_ylim(0.0, 1.05)
        axes[0].set_ylabel("share left")
        axes[0].set_title("remaining uncertainty as a share of the prior; hatched: not determined by the drives")
        for ax, one in zip(axes[1:], shown, strict=True):
            ax.axhline(0.0, color=MUTED, linewidth=0.8)
            ax.plot(one.time_s, one.driven_m, color=BLUE, linewidth=1.4, label="driven")
            ax.plot(one.time_s, one.rolled_m, color=VERMILLION, linewidth=1.2, linestyle="--", label="rollout")
            ax.set_ylabel("offset (m)")
            ax.set_title(one.name)
            _legend_above(ax)
        if shown:
            axes[-1].set_xlabel("time (s)")
        write_caption(figure, "The rollout begins where the autopilot began to steer, with the fitted parameters.")


def draw_logged_look_ahead(detail: Any, path: Path, force: bool = False) -> None:
    """Draw the schedule over speed at each share of the torque, and the optima of vehicles that fit the logs.

    Raises:
        InputError: the file exists (without ``force``) or cannot be written.
    """
    tuned = detail.tuned
    held = tuned.schedule.look_ahead
    slow, fast = float(held.slow_mps), float(held.fast_mps)
    first, last = 0.5 * tuned.speeds_mps.min(), 1.2 * tuned.speeds_mps.max()
    speeds = np.clip([first, slow, fast, last], first, last)
    ahead = np.interp(speeds, [slow, fast], [float(held.short_m), float(held.long_m)])
    with picture(path, 9.6, 4.2, force) as figure:
        left, right = figure.subplots(1, 2)
        for share, colour in zip(tuned.shares, (BLUE, GREEN, VERMILLION, MUTED), strict=False):
            longer = share ** -float(tuned.schedule.exponent)
            left.plot(speeds, longer * ahead, color=colour, linewidth=1.6, label=f"{share:.0%}")
        away = np.stack([np.median(tuned.best_m, axis=0) - tuned.low_m, tuned.high_m - np.median(tuned.best_m, axis=0)])
        middle = np.median(tuned.best_m, axis=0)
        left.errorbar(tuned.speeds_mps, middle, yerr=np.maximum(away, 0.0), fmt="o", color=MUTED, capsize=3.0)
        left.set_xlabel("speed (m/s)")
        left.set_ylabel("look-ahead (m)")
        # Room above the curves for the legend.
        left.set_ylim(0.0, 1.3 * left.dataLim.ymax)
        short = {"handlelength": 1.2, "columnspacing": 1.0, "handletextpad": 0.5}
        left.legend(loc="upper left", ncols=4, title="share of the torque", frameon=False, **short)
        left.set_title("schedule, and each vehicle's best")
        names = [one.what.split(",")[0] for one in detail.experiments]
        right.barh(range(len(names)), [100.0 * one.narrows for one in detail.experiments], color=BLUE)
        right.set_yticks(range(len(names)), [textwrap.fill(name, _LABEL_CHARACTERS) for name in names])
        right.invert_yaxis()
        right.set_xlabel("narrows the interval by (%)")
        right.set_title("recommended next drives")
        write_caption(figure, "Dots and bars: best at full torque, 95 % of the vehicles that the logs allow.")
