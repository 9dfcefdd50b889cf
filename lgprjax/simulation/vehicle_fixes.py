"""Fixes beside a simulated vehicle's log: files like those of registration, drawn from an error model of fixes."""

from pathlib import Path

import numpy as np
import pandas as pd

from lgprjax import __version__
from lgprjax.formats import write_fixes
from lgprjax.frames import LocalFrame
from lgprjax.scene.drive import default_array
from lgprjax.scene.vehicle_fixes import VehicleFixes

# What the error model calls a stretch without fixes: the ground is poor there.
_NO_FIX = "low_correlation"


def fixes_paths(folder: Path, name: str) -> tuple[Path, Path]:
    """The CSV and the HDF5 file of a drive's fixes."""
    return folder / f"{name}.fixes.csv", folder / f"{name}.fixes.h5"


def write_vehicle_fixes(
    folder: Path,
    name: str,
    fixes: VehicleFixes,
    frame: LocalFrame,
    *,
    t0_utc: str,
    provenance: dict[str, object],
    force: bool = False,
) -> None:
    """Write the fixes of a drive; all channels of the array are over the map.

    Args:
        folder, name: of the drive's log.
        fixes: from ``draw_vehicle_fixes``.
        frame: of the drive; it stands for the map's.
        t0_utc: of the log.
        provenance: beside the program's.
        force: replace files that exist.

    Raises:
        InputError: an output exists (without ``force``) or cannot be written.
    """
    east, north, height, yaw, roll = fixes.pose.T
    latitude, longitude, height = frame.to_geodetic(east, north, height)
    scans = fixes.time_s.size

    def where_found(value: float) -> np.ndarray:
        return np.where(fixes.found, value, np.nan)

    columns = {
        "scan": np.arange(scans),
        "time_s": fixes.time_s,
        "latitude_deg": latitude,
        "longitude_deg": longitude,
        "height_m": height,
        "heading_deg": frame.heading_of_yaw(yaw, longitude),
        "roll_deg": np.degrees(roll),
        "sigma_along_m": where_found(fixes.sigma_m[0]),
        "sigma_cross_m": where_found(fixes.sigma_m[1]),
        "correlation": where_found(fixes.strength),
        "margin": np.full(scans, np.nan),
        "overlap_channels": np.where(fixes.found, default_array().x_m.size, 0),
        "code": np.where(fixes.found, "ok", _NO_FIX),
    }
    attributes = {
        "name": name,
        "map": "none: fixes from an error model",
        "t0_utc": t0_utc,
        "anchor_latitude_deg": frame.latitude_deg,
        "anchor_longitude_deg": frame.longitude_deg,
        "anchor_height_m": frame.height_m,
        "provenance": {"program": f"lgprjax {__version__}", "synthetic": True, **provenance},
    }
    write_fixes(
        *fixes_paths(folder, name),
        pd.DataFrame(columns),
        attributes=attributes,
        pose_m=fixes.pose,
        covariance=fixes.covariance.astype(np.float32),
        force=force,
    )
