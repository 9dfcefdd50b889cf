"""The track of a recorded drive: navigation and odometry brought to the scans and to the array's centre."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from lgprjax.archive.travel import Jump, legs_of, mend_travel
from lgprjax.errors import InputError
from lgprjax.formats import DriveLog, NavigationTrack, OdometryTrack
from lgprjax.formats.survey_track import CHORD_M, path_headings_deg
from lgprjax.frames import LocalFrame, body_to_local
from lgprjax.radar import ArrayGeometry, centre_of
from lgprjax.registration import Track

_SILENT_S = 1.0
_SAME_DEG, _MOST = 0.01, 0.99  # headings that are the path's own agree with its chords, but where they were held
_LESS_SURE = 3.0


class DriveTrack(NamedTuple):
    """A drive's track in a local frame.

    Attributes:
        track: prior pose of the array's centre, travel and speed, at every scan.
        ground_up_m: up coordinate of the ground under the vehicle.
        jumps_bridged: jumps of the recorded travel that are taken out of the track's.
        breaks: jumps across which nobody knows the travel: legs of the track begin there.
    """

    track: Track
    ground_up_m: Float[np.ndarray, " scan"]
    jumps_bridged: int = 0
    breaks: int = 0


def poses_of(
    navigation: NavigationTrack, time_s: Float[np.ndarray, " scan"], frame: LocalFrame, array: ArrayGeometry
) -> tuple[Float[np.ndarray, "scan 5"], Float[np.ndarray, " scan"]]:
    """Poses of the array's centre (height above the ground) and the ground's up coordinate at given times."""
    east, north, up = frame.to_local(navigation.latitude_deg, navigation.longitude_deg, navigation.height_m)
    yaw = np.unwrap(frame.yaw_of_heading(navigation.heading_deg, navigation.longitude_deg))
    roll = np.radians(navigation.roll_deg)
    east, north, up, yaw, roll = (
        np.interp(time_s, navigation.time_s, values) for values in (east, north, up, yaw, roll)
    )
    x_m, y_m = body_to_local(east, north, yaw, *centre_of(array))
    return np.stack([x_m, y_m, np.full_like(x_m, array.height_m), yaw, roll], axis=1), up


def track_of_drive(log: DriveLog, frame: LocalFrame) -> DriveTrack:
    """Track of a drive log in a map's frame; travel that is none, as where positions jump, is taken out.

    Raises:
        InputError: navigation or odometry does not span the scans (more than a second is missing).
    """
    description = log.description
    time_s = log.scan_time_s
    for place, covered in (
        ("/gnss_ins/time_s", description.navigation.time_s),
        ("/odometry/time_s", description.odometry.time_s),
    ):
        if covered[0] > time_s[0] + 1.0 or covered[-1] < time_s[-1] - 1.0:
            raise InputError(
                log.path,
                place,
                f"times that span the scans, {time_s[0]:.2f} to {time_s[-1]:.2f} s",
                f"{covered[0]:.2f} to {covered[-1]:.2f} s",
            )
    navigation, odometry = description.navigation, description.odometry
    mended = mend_travel(odometry.time_s, odometry.distance_m)
    jumps = (*mended.bridged, *mended.broken)
    pose, up = poses_of(_turned_across(navigation, odometry, jumps), time_s, frame, description.array)
    travel = np.interp(time_s, odometry.time_s, mended.distance_m)
    sigma_deg = navigation.sigma_heading_deg
    sigma = np.full_like(time_s, 1.0) if sigma_deg is None else np.interp(time_s, navigation.time_s, sigma_deg)
    track = Track(
        pose=pose,
        travel_m=travel,
        speed_mps=_speed(travel, time_s),
        sigma_yaw_rad=np.radians(sigma),
        sigma_m=_position_sigma(navigation, time_s),
        leg=legs_of(time_s, mended.broken),
    )
    return DriveTrack(track, up, len(mended.bridged), len(mended.broken))


def jump_line(drive: DriveTrack) -> str | None:
    """What was done about jumps of the recorded travel, in a line; None where there are none."""
    if not drive.jumps_bridged + drive.breaks:
        return None
    told = f"travel jumps that no vehicle drives: {drive.jumps_bridged} bridged at local speed"
    return told if not drive.breaks else f"{told}, {drive.breaks} left open (no window reaches across)"


def _position_sigma(navigation: NavigationTrack, time_s: Float[np.ndarray, " scan"]) -> Float[np.ndarray, " scan"]:
    """Of one axis, root mean of the variances of east and north; NaN where the log does not state them."""
    if navigation.sigma_east_m is None or navigation.sigma_north_m is None:
        return np.full(len(time_s), np.nan)
    variance = 0.5 * (navigation.sigma_east_m**2 + navigation.sigma_north_m**2)
    return np.asarray(np.sqrt(np.interp(time_s, navigation.time_s, variance)))


def _turned_across(navigation: NavigationTrack, odometry: OdometryTrack, jumps: tuple[Jump, ...]) -> NavigationTrack:
    """Headings interpolated about jumps, where they are the directions of the very path that jumps."""
    if not jumps:
        return navigation
    travel = np.interp(navigation.time_s, odometry.time_s, odometry.distance_m)
    try:
        chords = path_headings_deg(navigation.latitude_deg, navigation.longitude_deg, travel)
    except ValueError:
        return navigation
    off_deg = np.abs((chords - navigation.heading_deg + 180.0) % 360.0 - 180.0)
    if np.mean(off_deg < _SAME_DEG) < _MOST:
        return navigation
    path_m = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(travel)))])
    bad = np.zeros(len(travel), bool)
    for jump in jumps:
        start_m, stop_m = np.interp([jump.start_s, jump.stop_s], navigation.time_s, path_m)
        bad |= (path_m > start_m - 0.5 * CHORD_M) & (path_m < stop_m + 0.5 * CHORD_M)
    if bad.all():
        return navigation
    heading = np.unwrap(navigation.heading_deg[~bad], period=360.0)
    return replace(navigation, heading_deg=np.interp(navigation.time_s, navigation.time_s[~bad], heading))


def scan_spacing_m(track: Track) -> float:
    """Typical distance between scans while the vehicle moves; 0 if it never does."""
    moved = np.abs(np.diff(track.travel_m))
    moving = moved[moved > 1e-4]
    return float(np.median(moving)) if len(moving) else 0.0


def antennas_of(track: Track, array: ArrayGeometry) -> Float[np.ndarray, "scan channel 3"]:
    """East and north of every antenna from the array's centre, and its height above the ground.

    Each channel stands where the vehicle had come when the switch matrix reached it.
    """
    centre_x, centre_y = centre_of(array)
    x = array.x_m - centre_x + track.speed_mps[:, None] * array.time_offset_s
    y = np.broadcast_to(array.y_m - centre_y, x.shape)
    cos, sin = np.cos(track.pose[:, 3])[:, None], np.sin(track.pose[:, 3])[:, None]
    height = track.pose[:, 2][:, None] + y * np.sin(track.pose[:, 4])[:, None]
    return np.stack([cos * x - sin * y, sin * x + cos * y, height], axis=-1)


def _speed(travel_m: Float[np.ndarray, " scan"], time_s: Float[np.ndarray, " scan"]) -> Float[np.ndarray, " scan"]:
    """Speed over about a tenth of a second: odometry is coarse from scan to scan."""
    half = max(1, int(0.05 / max(float(np.median(np.diff(time_s))), 1e-4)))
    index = np.arange(len(time_s))
    low, high = np.maximum(index - half, 0), np.minimum(index + half, len(time_s) - 1)
    return np.asarray((travel_m[high] - travel_m[low]) / (time_s[high] - time_s[low]))


def gnss_gaps(log: DriveLog) -> Bool[np.ndarray, " scan"]:
    """Scans at which GNSS/INS said nothing for a second, or was three times less sure than at its best.

    Best is the tenth part of the drive's scans at which its position's sigma is least.
    """
    navigation, time_s = log.description.navigation, log.scan_time_s
    # Before the first record and after the last one there is no interval.
    interval_s = np.diff(navigation.time_s, prepend=navigation.time_s[:1], append=navigation.time_s[-1:])
    gap = interval_s[np.searchsorted(navigation.time_s, time_s)] > _SILENT_S
    if navigation.sigma_east_m is not None and navigation.sigma_north_m is not None:
        sigma_m = np.maximum(navigation.sigma_east_m, navigation.sigma_north_m)
        at_scan = np.interp(time_s, navigation.time_s, sigma_m)
        gap = gap | (at_scan > _LESS_SURE * np.percentile(at_scan, 10.0))
    return np.asarray(gap)
