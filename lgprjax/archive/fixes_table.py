"""Fixes of a drive as the table that people read: WGS-84 positions, sigmas along and across the heading."""

import numpy as np
import pandas as pd
from jaxtyping import Float

from lgprjax.frames import LocalFrame
from lgprjax.registration import Code, Fix, sigmas_along_cross
from lgprjax.subsurface import GroundMap


def fixes_table(fix: Fix, time_s: Float[np.ndarray, " scan"], frame: LocalFrame, ground: GroundMap) -> pd.DataFrame:
    """The columns of the fixes CSV but the time scale: WGS-84 positions, sigmas along and across the heading."""
    pose = np.asarray(fix.pose)
    found = np.isfinite(pose[:, 0])
    # Fixes lie metres from a station; the ground between them is as high as at the nearest one.
    up = np.zeros(len(pose))
    up[found] = np.nan_to_num(ground.ground_up_at(pose[found, :2]))
    latitude, longitude, height = frame.to_geodetic(
        np.where(found, pose[:, 0], 0.0), np.where(found, pose[:, 1], 0.0), np.where(found, up + pose[:, 2], 0.0)
    )
    blank = np.where(found, 1.0, np.nan)
    along, cross = sigmas_along_cross(np.asarray(fix.covariance), pose[:, 3])
    return pd.DataFrame(
        {
            "scan": np.arange(len(time_s)),
            "time_s": time_s,
            "latitude_deg": latitude * blank,
            "longitude_deg": longitude * blank,
            "height_m": height * blank,
            "heading_deg": frame.heading_of_yaw(pose[:, 3], longitude),
            "roll_deg": np.degrees(pose[:, 4]),
            "sigma_along_m": along,
            "sigma_cross_m": cross,
            "correlation": fix.correlation,
            "margin": fix.margin,
            "overlap_channels": fix.overlap_channels,
            "code": [Code(int(code)).label for code in fix.code],
            "p_false": fix.p_false,
            "window_m": fix.window_m,
        }
    )
