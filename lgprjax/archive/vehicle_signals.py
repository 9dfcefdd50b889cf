"""Signals of a drive log on the vehicle's clock, in local metres: what calibrations work on."""

import numpy as np
from jaxtyping import Bool, Float

from lgprjax.errors import InputError
from lgprjax.formats import NavigationTrack, VehicleLog
from lgprjax.frames import LocalFrame
from lgprjax.vehicle import DriveSignals

# A sensor that is silent for longer than this many of its usual steps has a gap: nothing is drawn across it.
_GAP_STEPS = 3.0

SIGNAL_NAMES = {
    "command_rad": "steering_command_rad",
    "front_rad": "wheel_angle_rad",
    "rear_rad": "rear_wheel_angle_rad",
    "potentiometer_v": "steering_potentiometer_v",
    "encoder_counts": "encoder_counts",
    "supply_v": "supply_v",
    "throttle": "throttle",
    "brake": "brake",
}
"""Name in a drive log's /vehicle of each optional signal."""


def signals_of(log: VehicleLog, path: str = "drive log") -> DriveSignals:
    """Signals at the records of the vehicle, those outside the odometry's time or in a gap of it left out.

    Each position of the navigation is given to one record, the nearest, moved to its time between neighbours: a value
    drawn at every record would show the noise of one fix many times. Records without a position of their own, and
    those beside a gap, hold not-a-number. Metres are about the first position.

    Args:
        log: the drive.
        path: what errors call it.

    Raises:
        InputError: the log holds no signals of the vehicle, or none while navigation and odometry were there.
    """
    if log.vehicle is None:
        raise InputError(path, "/vehicle", "signals of the vehicle", "none")
    time_s = np.asarray(log.vehicle["time_s"], np.float64)
    told = ~_in_gap(log.odometry.time_s, time_s)
    if np.count_nonzero(told) < 2:
        raise InputError(path, "/vehicle/time_s", "two records or more within the odometry's time", "fewer")
    time_s = time_s[told]
    track = log.navigation
    frame = LocalFrame(*(float(values[0]) for values in (track.latitude_deg, track.longitude_deg, track.height_m)))
    east_m, north_m, _ = frame.to_local(track.latitude_deg, track.longitude_deg, track.height_m)
    yaw_rad = np.unwrap(frame.yaw_of_heading(track.heading_deg, track.longitude_deg))
    owned = _own_fix(track.time_s, time_s)
    optional = {
        signal: None if name not in log.vehicle else np.asarray(log.vehicle[name], np.float64)[told]
        for signal, name in SIGNAL_NAMES.items()
    }
    return DriveSignals(
        time_s=time_s,
        east_m=np.where(owned, np.interp(time_s, track.time_s, east_m), np.nan),
        north_m=np.where(owned, np.interp(time_s, track.time_s, north_m), np.nan),
        sigma_position_m=np.interp(time_s, track.time_s, _position_sigma_m(track)),
        yaw_rad=np.where(owned, np.interp(time_s, track.time_s, yaw_rad), np.nan),
        sigma_yaw_rad=np.interp(time_s, track.time_s, np.radians(_sigma(track.sigma_heading_deg, track))),
        travel_m=np.interp(time_s, log.odometry.time_s, log.odometry.distance_m),
        **optional,
    )


def _position_sigma_m(track: NavigationTrack) -> Float[np.ndarray, " navigation"]:
    """Of each of east and north, as one number."""
    east_m, north_m = _sigma(track.sigma_east_m, track), _sigma(track.sigma_north_m, track)
    return np.asarray(np.sqrt(0.5 * (east_m**2 + north_m**2)))


def _sigma(values: np.ndarray | None, track: NavigationTrack) -> Float[np.ndarray, " navigation"]:
    return np.zeros(len(track.time_s)) if values is None else np.asarray(values, np.float64)


def _in_gap(known_s: Float[np.ndarray, " known"], time_s: Float[np.ndarray, " record"]) -> Bool[np.ndarray, " record"]:
    """Times before or after everything known, or between two known times that are too far apart."""
    steps = np.diff(known_s)
    after = np.clip(np.searchsorted(known_s, time_s, side="left"), 1, len(known_s) - 1)
    wide = steps[after - 1] > _GAP_STEPS * np.median(steps)
    # At either end of a gap there is a known value.
    at_end = (time_s == known_s[after]) | (time_s == known_s[after - 1])
    return np.asarray((time_s < known_s[0]) | (time_s > known_s[-1]) | (wide & ~at_end))


def _own_fix(fix_s: Float[np.ndarray, " fix"], time_s: Float[np.ndarray, " record"]) -> Bool[np.ndarray, " record"]:
    """Records that are the nearest of all to some fix and have fixes close by on both sides."""
    after = np.clip(np.searchsorted(time_s, fix_s), 1, len(time_s) - 1)
    nearest = np.where(fix_s - time_s[after - 1] <= time_s[after] - fix_s, after - 1, after)
    owned = np.zeros(len(time_s), dtype=bool)
    owned[nearest] = True
    return np.asarray(owned & ~_in_gap(fix_s, time_s))
