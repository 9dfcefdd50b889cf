"""Corners of a field, marked by the operator: where the reference point stands, and how well that is known."""

import json
import math

import numpy as np

from lgprjax.frames import LocalFrame
from lgprjax.runtime.control.skid.compiled import SkidResult
from lgprjax.runtime.gnss_samples import Quality


def corner_obstacle(result: SkidResult, quality: Quality, *, engaged: bool) -> str:
    """Why no corner can be marked now; empty where it can."""
    if engaged:
        return "a corner is marked while the operator drives"
    if not result.heading_known > 0.5:
        # Between antenna and reference point lies a lever that the heading turns.
        return "heading not known: drive straight by remote control"
    return "" if quality is Quality.FIXED else "no fixed position now"


def corner_row(number: int, result: SkidResult, frame: LocalFrame, up_m: float) -> bytes:
    """The ``CORNER`` record, JSON.

    Args:
        number: of the corner in this run, from 1.
        result: of the tick.
        frame: that the pose is in.
        up_m: height of the last position in it.
    """
    latitude, longitude, height = frame.to_geodetic(np.array([result.x_m]), np.array([result.y_m]), np.array([up_m]))
    corner = {
        "corner": number,
        "latitude_deg": float(latitude[0]),
        "longitude_deg": float(longitude[0]),
        "height_m": float(height[0]),
        "sigma_m": result.sigma_m,
        "yaw_rad": result.yaw_rad,
        "sigma_yaw_rad": math.sqrt(max(result.yawyaw, 0.0)),
        "covariance_m2": [[result.xx, result.xy], [result.xy, result.yy]],
    }
    return json.dumps(corner).encode()
