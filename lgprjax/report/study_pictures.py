"""Pictures of studies: which a kind of study has, and all that draw them."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from lgprjax.report.fusion_fit import FusionPicture, draw_fusion_fit
from lgprjax.report.motion_pictures import (
    draw_look_ahead_sweep,
    draw_pedals,
    draw_rear_ratio_angles,
    draw_rear_ratio_heading,
    draw_yaw_gain,
)
from lgprjax.report.steering_pictures import draw_arcs, draw_encoder, draw_servo, draw_straight, draw_wheel_angle

__all__ = [
    "draw_arcs",
    "draw_encoder",
    "draw_look_ahead_sweep",
    "draw_pedals",
    "draw_rear_ratio_angles",
    "draw_rear_ratio_heading",
    "draw_servo",
    "draw_straight",
    "draw_wheel_angle",
    "draw_yaw_gain",
    "study_pictures",
]


def study_pictures(kind: str) -> dict[str, Callable[[Any, Path, bool], None]]:
    """Pictures of a kind of study by name: each draws a study's detail to a path, replacing a file if told so."""
    return _PICTURES[kind]


def _draw_rear_ratio(detail: Any, path: Path, force: bool) -> None:
    # Found by heading it holds arcs, else both wheel angles.
    if "arcs" in detail._fields:
        draw_rear_ratio_heading(detail.arcs, detail.chassis, detail.fit, path, force=force)
    else:
        draw_rear_ratio_angles(detail.front_rad, detail.rear_rad, detail.fit, path, force=force)


def _draw_fusion(detail: Any, path: Path, force: bool) -> None:
    """The first drive that judges the fit."""
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
    draw_fusion_fit(shown, path, caption=f"{one.name} by the noises found; beyond the red line lie 5 %.", force=force)


_PICTURES: dict[str, dict[str, Callable[[Any, Path, bool], None]]] = {
    "straight": {"windows": lambda d, path, force: draw_straight(d, path, force=force)},
    "encoder": {
        "encoder": lambda d, path, force: draw_encoder(d.signals, d.fit, d.v_per_rad, path, force=force),
    },
    "pedals": {
        "pedals": lambda d, path, force: draw_pedals(d.signals, d.runs, d.model_m, d.fit, path, force=force),
    },
    "rear_ratio": {"rear_ratio": _draw_rear_ratio},
    "look_ahead": {
        "look_ahead": lambda d, path, force: draw_look_ahead_sweep(
            d.tuned, d.swept, d.look_ahead_m, d.speed_mps, d.trials.least_margin_rad, path, force=force
        ),
    },
    "yaw_gain": {"yaw_gain": lambda d, path, force: draw_yaw_gain(d.fit, path, force=force)},
    "servo": {"servo": lambda d, path, force: draw_servo(d.signals, d.measured_rad, d.fit, path, force=force)},
    "fusion": {"innovations": _draw_fusion},
    "wheel_angle": {
        "palm_tree": lambda d, path, force: draw_arcs(d.signals, d.arcs, d.fit, path, force=force),
        "wheel_angle": lambda d, path, force: draw_wheel_angle(d.fit, path, force=force),
    },
}
