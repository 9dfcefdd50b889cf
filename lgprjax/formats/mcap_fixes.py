"""Fixes of a drive as messages: a pose and a position of every fix that is ok, the quality of every one."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from jaxtyping import Float, Int

from lgprjax.errors import InputError
from lgprjax.formats.drive_log import DriveLog
from lgprjax.formats.fixes import read_fix_poses, read_fixes
from lgprjax.formats.ros_messages import COVARIANCE_KNOWN, pose_covariance, quaternion_of
from lgprjax.formats.utc import utc_ns
from lgprjax.frames import LocalFrame, wrap_angle

_ANCHOR = ("anchor_latitude_deg", "anchor_longitude_deg", "anchor_height_m")
# The drive's clock is stored to the microsecond.
_SAME_TIME_S = 1e-6


class DriveFixes(NamedTuple):
    """Fixes that belong to a drive.

    Attributes:
        table: columns of ``data_schema/fixes.toml``.
        place_m: east, north and up of the array's centre in the map's frame.
        angle_rad: yaw from the map's east, and roll.
        covariance: of east, north, height, yaw, roll.
        turn_rad: by which the map's axes are turned from true east and north at the fix.
        told: ok, with a pose.
        map: name and anchor of the map, as texts.
    """

    table: pd.DataFrame
    place_m: Float[np.ndarray, "fix 3"]
    angle_rad: Float[np.ndarray, "fix 2"]
    covariance: Float[np.ndarray, "fix 5 5"]
    turn_rad: Float[np.ndarray, " fix"]
    told: np.ndarray
    map: dict[str, str]

    def scan(self) -> Int[np.ndarray, " fix"]:
        """Number of each fix's scan in the drive."""
        return self.table["scan"].to_numpy()


def fixes_of(path: str | Path, log: DriveLog) -> DriveFixes:
    """Read the fixes of a drive from ``X.fixes.h5``.

    Raises:
        InputError: the file is no such file, holds no poses, or its fixes are not of this drive.
    """
    file = Path(path)
    if not file.name.endswith(".fixes.h5"):
        raise InputError(file, "file name", "a name that ends in .fixes.h5", repr(file.name))
    table = read_fixes(file)
    pose_m, covariance = read_fix_poses(file)
    anchor = [each for each in map(table.attrs.get, _ANCHOR) if isinstance(each, float)]
    if pose_m is None or covariance is None or len(anchor) < len(_ANCHOR):
        raise InputError(file, "/pose_m, /covariance and the anchor", "those that lgprjax register writes", "none")
    _check_drive(file, table, log)
    frame = LocalFrame(*anchor)
    latitude, longitude, height, heading = (
        table[name].to_numpy(np.float64) for name in ("latitude_deg", "longitude_deg", "height_m", "heading_deg")
    )
    finite = np.isfinite(pose_m).all(axis=1) & np.isfinite(covariance).all(axis=(1, 2)) & np.isfinite(height)
    told = (table["code"].to_numpy() == "ok") & finite
    up = np.full(len(table), np.nan)
    up[told] = frame.to_local(latitude[told], longitude[told], height[told])[2]
    return DriveFixes(
        table=table,
        place_m=np.stack([pose_m[:, 0], pose_m[:, 1], up], axis=1),
        angle_rad=pose_m[:, 3:],
        covariance=covariance.astype(np.float64),
        turn_rad=wrap_angle(pose_m[:, 3] - np.radians(90.0 - heading)),
        told=told,
        map={"map": str(table.attrs.get("map", "")), **dict(zip(_ANCHOR, map(repr, anchor), strict=True))},
    )


def fix_messages(fixes: DriveFixes, number: int) -> Iterator[tuple[str, str, dict[str, Any]]]:
    """Part of ``TOPICS``, frame and members but the header's of each message that tells a fix."""
    row = fixes.table.iloc[number]
    yield (
        "fix quality",
        "map",
        {
            "scan": int(row["scan"]),
            "code": str(row["code"]),
            "correlation": float(row["correlation"]),
            "margin": float(row["margin"]),
            "overlap_channels": int(row["overlap_channels"]),
        },
    )
    # A place that is not ok is no place: nobody who listens to poses shall take it for one.
    if not fixes.told[number]:
        return
    covariance = fixes.covariance[number]
    members = {f"pose.pose.position.{axis}": float(v) for axis, v in zip("xyz", fixes.place_m[number], strict=True)}
    turn = quaternion_of(*map(float, fixes.angle_rad[number]))
    members |= {f"pose.pose.orientation.{axis}": value for axis, value in turn.items()}
    yield "fix pose", "map", {**members, "pose.covariance": pose_covariance(covariance)}
    cos, sin = np.cos(fixes.turn_rad[number]), np.sin(fixes.turn_rad[number])
    to_true = np.array([[cos, sin, 0.0], [-sin, cos, 0.0], [0.0, 0.0, 1.0]])
    yield (
        "fix position",
        "radar_array",
        {
            "latitude": float(row["latitude_deg"]),
            "longitude": float(row["longitude_deg"]),
            "altitude": float(row["height_m"]),
            "position_covariance": to_true @ covariance[:3, :3] @ to_true.T,
            "position_covariance_type": COVARIANCE_KNOWN,
        },
    )


def _check_drive(file: Path, table: pd.DataFrame, log: DriveLog) -> None:
    """Fixes name their scans, and both files the moment that their times count from."""
    scan, time_s = table["scan"].to_numpy(), table["time_s"].to_numpy()
    try:
        same = utc_ns(str(table.attrs["t0_utc"])) == utc_ns(log.description.t0_utc)
    except (KeyError, ValueError):
        same = False
    if not same:
        raise InputError(file, "@t0_utc", log.description.t0_utc, str(table.attrs.get("t0_utc")))
    apart_s = np.abs(time_s - log.scan_time_s[np.minimum(scan, log.scans - 1)])
    if scan[-1] >= log.scans or np.any(apart_s > _SAME_TIME_S):
        raise InputError(file, "time_s", f"those of the scans of {log.path.name}", "others")
