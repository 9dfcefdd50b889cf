"""Pictures for each kind of study, and the functions that draw them."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Bool, Float

from lgprjax.report.loop_pictures import draw_logged_look_ahead, draw_loop, draw_tracking
from lgprjax.report.motion_pictures import (
    draw_look_ahead_sweep,
    draw_pedals,
    draw_rear_ratio_angles,
    draw_rear_ratio_heading,
    draw_yaw_gain,
)
from lgprjax.report.steering_pictures import draw_arcs, draw_encoder, draw_servo, draw_straight, draw_wheel_angle
from lgprjax.report.style import BLUE, FAINT, GREEN, MUTED, VERMILLION, picture, write_caption

# Fit of the navigation filter to a drive: innovations by source with their band, and errors of the track.

# 95 % of a chi-square of one, two and three degrees of freedom.
_BAND = {1: 3.841, 2: 5.991, 3: 7.815}
# Above this ratio errors are drawn on a scale that shows small ones too.
_FAR_M = 0.5
_SOURCES = (("gnss", 2), ("heading", 1), ("odometer", 1), ("lgpr", 3))
_COLOURS = {"filter": BLUE, "smoother": GREEN, "threshold switch": VERMILLION}


@dataclass(frozen=True)
class FusionPicture:
    """Results of the filter on a drive.

    Attributes:
        time_s: tick times.
        nis: normalised innovation squared of GNSS, heading, odometer and LGPR.
        offered: whether there was an observation.
        accepted: whether the gate accepted it.
        error_m: distance from the truth by name of the estimator; empty without truth.
    """

    time_s: Float[np.ndarray, " tick"]
    nis: Float[np.ndarray, "tick 4"]
    offered: Bool[np.ndarray, "tick 4"]
    accepted: Bool[np.ndarray, "tick 4"]
    error_m: Mapping[str, Float[np.ndarray, " tick"]]


def draw_fusion_fit(shown: FusionPicture, path: str | Path, *, caption: str, force: bool = False) -> None:
    """Draw innovations over time and their distribution, and below them the errors of the track.

    Raises:
        InputError: the file exists (without ``force``) or cannot be written.
    """
    rows = len(_SOURCES) + bool(shown.error_m)
    with picture(path, 9.6, 1.7 * rows + 1.4, force) as figure:
        grid = figure.subplots(rows, 2, width_ratios=(3.0, 1.0), squeeze=False)
        for row, (source, parts) in enumerate(_SOURCES):
            over_time, spread = grid[row]
            here = shown.offered[:, row]
            nis, band = shown.nis[here, row], _BAND[parts]
            top = 2.5 * band
            over_time.plot(shown.time_s[here], np.minimum(nis, top), ".", color=BLUE, markersize=2.5)
            over_time.axhline(band, color=VERMILLION, linewidth=1.0)
            over_time.set_ylim(0.0, top)
            over_time.set_ylabel(f"{source}\nNIS")
            over_time.set_title(_summary(nis, shown.accepted[here, row], parts))
            spread.hist(np.minimum(nis, top), bins=30, range=(0.0, top), density=True, color=FAINT)
            level = np.linspace(0.02 * top, top, 200)
            spread.plot(level, _chi_square(level, parts), color=VERMILLION, linewidth=1.2)
            spread.set_ylim(0.0, 1.0 if parts == 1 else 0.5)
        if shown.error_m:
            errors, shares = grid[-1]
            for name, error in shown.error_m.items():
                label = f"{name}, {100.0 * np.sqrt(np.mean(error**2)):.1f} cm rms"
                errors.plot(shown.time_s, 100.0 * error, color=_COLOURS[name], linewidth=1.0, label=label)
                ordered = np.sort(100.0 * error)
                shares.plot(ordered, np.arange(1, error.size + 1) / error.size, color=_COLOURS[name], linewidth=1.2)
            errors.set_ylabel("error (cm)")
            if max(float(error.max()) for error in shown.error_m.values()) > _FAR_M:
                errors.set_yscale("symlog", linthresh=10.0)
                shares.set_xscale("symlog", linthresh=10.0)
            errors.set_ylim(bottom=0.0)
            errors.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=3, columnspacing=1.0, handlelength=1.2)
            shares.set_xlabel("error (cm)")
            shares.set_ylabel("share")
            shares.axhline(0.95, color=MUTED, linewidth=0.8)
        grid[-1, 0].set_xlabel("time (s)")
        grid[len(_SOURCES) - 1, 1].set_xlabel("NIS")
        figure.suptitle("Innovations of the navigation filter")
        write_caption(figure, caption)


def _summary(nis: Float[np.ndarray, " seen"], accepted: Bool[np.ndarray, " seen"], parts: int) -> str:
    """Share of all within the band, mean of the accepted ones."""
    if not nis.size:
        return "none"
    shut_out = int((~accepted).sum())
    mean = nis[accepted].mean() / parts if accepted.any() else np.nan
    inside = 100.0 * np.mean(nis <= _BAND[parts])
    return f"{inside:.1f} % within 95 %, {shut_out} rejected, mean of the others {mean:.2f} a component"


def _chi_square(level: Float[np.ndarray, " level"], parts: int) -> Float[np.ndarray, " level"]:
    """Density of chi-square of one to three degrees of freedom."""
    scale = {1: np.sqrt(2.0 * np.pi), 2: 2.0, 3: np.sqrt(2.0 * np.pi)}[parts]
    return np.asarray(level ** (0.5 * parts - 1.0) * np.exp(-0.5 * level) / scale)


def study_pictures(kind: str) -> dict[str, Callable[[Any, Path, bool], None]]:
    """Pictures of a kind of study by name: each draws a study's detail to a path, optionally replacing a file."""
    return _PICTURES[kind]


def _draw_rear_ratio(detail: Any, path: Path, force: bool) -> None:
    # Found by heading it has arcs, else both wheel angles.
    if "arcs" in detail._fields:
        draw_rear_ratio_heading(detail.arcs, detail.chassis, detail.fit, path, force=force)
    else:
        draw_rear_ratio_angles(detail.front_rad, detail.rear_rad, detail.fit, path, force=force)


def _draw_fusion(detail: Any, path: Path, force: bool) -> None:
    """Draw the first drive that judges the fit."""
    one = detail.judged[0]
    errors = {}
    if one.truth is not None:
        tracks = {"filter": one.filtered.mean, "smoother": one.smoothed.mean, "threshold switch": one.switched}
        errors = {
            name: np.hypot(*(np.asarray(track, np.float64)[:, :2] - one.truth[:, :2]).T)
            for name, track in tracks.items()
        }
    info = one.info
    offered, accepted = np.asarray(info.offered), np.asarray(info.accepted)
    shown = FusionPicture(one.time_s, np.asarray(info.nis, np.float64), offered, accepted, errors)
    draw_fusion_fit(shown, path, caption=f"{one.name} with the fitted noises; 5 % are above the red line.", force=force)


def _draw_look_ahead(detail: Any, path: Path, force: bool) -> None:
    # A study from logs has the fit, else the sweep.
    if "fit" in detail._fields:
        draw_logged_look_ahead(detail, path, force)
        return
    draw_look_ahead_sweep(
        detail.tuned,
        detail.swept,
        detail.look_ahead_m,
        detail.speed_mps,
        detail.trials.least_margin_rad,
        path,
        force=force,
    )


_PICTURES: dict[str, dict[str, Callable[[Any, Path, bool], None]]] = {
    "straight": {"windows": lambda d, path, force: draw_straight(d, path, force=force)},
    "encoder": {
        "encoder": lambda d, path, force: draw_encoder(d.signals, d.fit, d.v_per_rad, path, force=force),
    },
    "pedals": {
        "pedals": lambda d, path, force: draw_pedals(d.signals, d.runs, d.model_m, d.fit, path, force=force),
    },
    "rear_ratio": {"rear_ratio": _draw_rear_ratio},
    "tracking": {"tracking": draw_tracking},
    "loop": {"loop": draw_loop},
    "look_ahead": {"look_ahead": _draw_look_ahead},
    "yaw_gain": {"yaw_gain": lambda d, path, force: draw_yaw_gain(d.fit, path, force=force)},
    "servo": {"servo": lambda d, path, force: draw_servo(d.signals, d.measured_rad, d.fit, path, force=force)},
    "fusion": {"innovations": _draw_fusion},
    "threshold": {},
    "wheel_angle": {
        "palm_tree": lambda d, path, force: draw_arcs(d.signals, d.arcs, d.fit, path, force=force),
        "wheel_angle": lambda d, path, force: draw_wheel_angle(d.fit, path, force=force),
    },
}
