"""A drive log, and its fixes, as a recording of ROS 2 messages (MCAP), streaming.

Needs the optional package mcap (``pip install lgprjax[log]``).
"""

import json
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import IO, Any, NamedTuple

import numpy as np
import pandas as pd
from jaxtyping import Float, Int

from lgprjax import __version__
from lgprjax.errors import InputError
from lgprjax.formats.drive import DriveLog, NavigationTrack, OdometryTrack, TraceRecording
from lgprjax.formats.fixes import read_fix_poses, read_fixes
from lgprjax.formats.mcap_recording import SWEEPS, ScanForm, array_values, require_mcap, scan_values
from lgprjax.formats.ros import (
    COVARIANCE_KNOWN,
    COVARIANCE_UNKNOWN,
    DRIVE_METADATA,
    PITCH_VARIANCE,
    TOPICS,
    MessageLayout,
    definition_of,
    layout_to_write,
    pose_covariance,
    quaternion_of,
)
from lgprjax.formats.store import atomic_output, utc_ns, utc_text
from lgprjax.frames import LocalFrame, wrap_angle

# Fixes of a drive as messages: a pose and a position of every fix that is ok, the quality of every one.

_ANCHOR = ("anchor_latitude_deg", "anchor_longitude_deg", "anchor_height_m")
# The drive's clock is stored to the microsecond.
_SAME_TIME_S = 1e-6


class ExportedFixes(NamedTuple):
    """Fixes that belong to a drive.

    Attributes:
        table: columns of ``data_schema/fixes.toml``.
        place_m: east, north and up of the array's centre in the map's frame.
        angle_rad: yaw from the map's east, and roll.
        covariance: of east, north, height, yaw, roll.
        turn_rad: rotation of the map's axes relative to true east and north at the fix.
        has_pose: ok, with a pose.
        map: name and anchor of the map, as texts.
    """

    table: pd.DataFrame
    place_m: Float[np.ndarray, "fix 3"]
    angle_rad: Float[np.ndarray, "fix 2"]
    covariance: Float[np.ndarray, "fix 5 5"]
    turn_rad: Float[np.ndarray, " fix"]
    has_pose: np.ndarray
    map: dict[str, str]

    def scan(self) -> Int[np.ndarray, " fix"]:
        """Number of each fix's scan in the drive."""
        return self.table["scan"].to_numpy()


def fixes_of(path: str | Path, log: DriveLog) -> ExportedFixes:
    """Read the fixes of a drive from ``X.fixes.h5``.

    Raises:
        InputError: it is not a file of fixes, has no poses, or its fixes are not of this drive.
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
    has_pose = (table["code"].to_numpy() == "ok") & finite
    up = np.full(len(table), np.nan)
    up[has_pose] = frame.to_local(latitude[has_pose], longitude[has_pose], height[has_pose])[2]
    return ExportedFixes(
        table=table,
        place_m=np.stack([pose_m[:, 0], pose_m[:, 1], up], axis=1),
        angle_rad=pose_m[:, 3:],
        covariance=covariance.astype(np.float64),
        turn_rad=wrap_angle(pose_m[:, 3] - np.radians(90.0 - heading)),
        has_pose=has_pose,
        map={"map": str(table.attrs.get("map", "")), **dict(zip(_ANCHOR, map(repr, anchor), strict=True))},
    )


def fix_messages(fixes: ExportedFixes, number: int) -> Iterator[tuple[str, str, dict[str, Any]]]:
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
    # A fix that is not ok has no pose: no subscriber may mistake it for one.
    if not fixes.has_pose[number]:
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
    """Fixes refer to their scans, and both files hold the origin of their times."""
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


MAP_METADATA = "lgprjax.map"
"""Name of the metadata with the place of the map's frame on the earth."""
_BLOCK_SCANS = 256
_BODY = "base_link"
# Seconds of a stamp are an int32.
_LATEST_NS = (1 << 31) * 1_000_000_000
_NOT_MEASURED = np.array([-1.0, *[0.0] * 8])
"""As a covariance in an ``Imu``: there is no such measurement."""


class ExportedDrive(NamedTuple):
    """What was written: scans, poses of fixes, and parts of the drive without a message."""

    scans: int
    poses: int
    left_out: tuple[str, ...]


class _Messages:
    """Messages of one file; each topic is registered before its first message."""

    def __init__(self, stream: IO[bytes]) -> None:
        from mcap.writer import Writer

        self._writer = Writer(stream)
        self._writer.start(profile="ros2", library=f"lgprjax {__version__}")
        self._topics: dict[str, tuple[int, MessageLayout]] = {}

    def metadata(self, name: str, texts: dict[str, str]) -> None:
        self._writer.add_metadata(name, texts)

    def put(self, part: str, ns: int, frame: str, values: dict[str, Any]) -> None:
        if part not in self._topics:
            topic, kind = TOPICS[part]
            schema = self._writer.register_schema(kind, "ros2msg", definition_of(kind).encode())
            channel = self._writer.register_channel(topic, "cdr", schema)
            self._topics[part] = channel, layout_to_write(kind)
        channel, layout = self._topics[part]
        sec, nanosec = divmod(ns, 1_000_000_000)
        header = {"header.stamp.sec": sec, "header.stamp.nanosec": nanosec, "header.frame_id": frame}
        self._writer.add_message(channel, ns, layout.encode({**header, **values}), ns)

    def finish(self) -> None:
        self._writer.finish()


def export_mcap(
    drive: str | Path, output: str | Path, *, fixes: str | Path | None = None, force: bool = False
) -> ExportedDrive:
    """Write a drive log as a recording that ROS 2 tools and Foxglove read; docs/transfer.md has its topics.

    Scans are copied bit by bit, sweeps as well as traces; stamps are whole nanoseconds. Fixes that are ok become poses
    in the map's frame and positions; the quality of every fix is written.

    Args:
        drive: the drive log.
        output: the recording.
        fixes: ``X.fixes.h5`` of the drive.
        force: replace an output that exists.

    Raises:
        InputError: an input is missing or damaged, the fixes are not of this drive, the package mcap is missing, or
            the output exists (without ``force``) or cannot be written.
    """
    require_mcap(Path(output))
    with ExitStack() as stack:
        log = stack.enter_context(DriveLog.open(drive))
        found = None if fixes is None else fixes_of(fixes, log)
        times_ns = _times_ns(log, found)
        temporary = stack.enter_context(atomic_output(output, force))
        messages = _Messages(stack.enter_context(temporary.open("wb")))
        _write_head(messages, log, found, int(min(each[0] for each in times_ns.values())))
        description = log.description
        navigation = _NavigationValues(description.navigation)
        odometry = _OdometryValues(description.odometry, description.navigation)
        scans = _scan_values(log)
        # In order of time, as a recorder would have received them: readers then need little memory.
        moments = np.concatenate(list(times_ns.values()))
        source = np.repeat(np.arange(len(times_ns)), [len(each) for each in times_ns.values()])
        number = np.concatenate([np.arange(len(each)) for each in times_ns.values()])
        names = tuple(times_ns)
        for each in np.lexsort((source, moments)):
            ns, at, name = int(moments[each]), int(number[each]), names[source[each]]
            if name == "scan":
                messages.put("scan", ns, "radar_array", next(scans))
            elif name == "navigation":
                for part, values in navigation(at):
                    messages.put(part, ns, _BODY, values)
            elif name == "odometry":
                messages.put("odometry", ns, "odom", odometry(at))
            elif found is not None:
                for part, frame, values in fix_messages(found, at):
                    messages.put(part, ns, frame, values)
        messages.finish()
        beside = {"truth": description.truth, "vehicle": description.vehicle, "plan": description.plan}
        return ExportedDrive(
            log.scans,
            0 if found is None else int(np.count_nonzero(found.has_pose)),
            tuple(name for name, values in beside.items() if values is not None),
        )


def _times_ns(log: DriveLog, fixes: ExportedFixes | None) -> dict[str, np.ndarray]:
    """Times of all messages, Unix time."""
    description = log.description
    times_s = {
        "navigation": description.navigation.time_s,
        "odometry": description.odometry.time_s,
        "scan": log.scan_time_s,
    }
    if fixes is not None:
        times_s["fix"] = log.scan_time_s[fixes.scan()]
    t0_ns = utc_ns(description.t0_utc)
    first_s, last_s = (f(float(f(each)) for each in times_s.values()) for f in (min, max))
    if t0_ns + 1e9 * first_s < 0 or t0_ns + 1e9 * last_s >= _LATEST_NS:
        found = f"{description.t0_utc} and {first_s:g} to {last_s:g} s"
        raise InputError(log.path, "times", f"moments from {utc_text(0)} to {utc_text(_LATEST_NS)}", found)
    return {name: t0_ns + np.rint(1e9 * each).astype(np.int64) for name, each in times_s.items()}


def _write_head(messages: _Messages, log: DriveLog, fixes: ExportedFixes | None, begin_ns: int) -> None:
    """Metadata of the whole file, written first, so that a truncated file keeps it."""
    description = log.description
    texts = {"name": description.name, "t0_utc": description.t0_utc, "provenance": json.dumps(description.provenance)}
    messages.metadata(DRIVE_METADATA, texts)
    if fixes is not None:
        messages.metadata(MAP_METADATA, fixes.map)
    messages.put("array", begin_ns, _BODY, array_values(description.array, description.recording))


def _scan_values(log: DriveLog) -> Iterator[dict[str, Any]]:
    """Members of the scans one after the other, read in blocks."""
    recording = log.description.recording
    for start in range(0, log.scans, _BLOCK_SCANS):
        stored, valid, calibration = log.read_stored(start, min(start + _BLOCK_SCANS, log.scans))
        if isinstance(recording, TraceRecording):
            numbers = (recording.sample_interval_ns, recording.time_zero_ns, recording.zero_level)
            form = ScanForm(log.channels, log.samples, stored.dtype.name, *numbers)
        else:
            form = ScanForm(log.channels, log.samples, SWEEPS, 0.0, 0.0, 0.0)
        for row, signal in enumerate(stored):
            yield scan_values(form, signal, valid[row], None if calibration is None else calibration[row])


class _NavigationValues:
    """Members of the position and the attitude of each record."""

    def __init__(self, track: NavigationTrack) -> None:
        self._track = track
        self._yaw_rad, self._roll_rad = np.radians(90.0 - track.heading_deg), np.radians(track.roll_deg)
        self._place = _variances(track.sigma_east_m, track.sigma_north_m, track.sigma_height_m)
        self._angle = _variances(track.sigma_roll_deg, track.sigma_heading_deg)

    def __call__(self, at: int) -> Iterator[tuple[str, dict[str, Any]]]:
        track = self._track
        yield (
            "position",
            {
                "latitude": float(track.latitude_deg[at]),
                "longitude": float(track.longitude_deg[at]),
                "altitude": float(track.height_m[at]),
                "position_covariance": np.zeros((3, 3)) if self._place is None else np.diag(self._place[at]),
                "position_covariance_type": COVARIANCE_UNKNOWN if self._place is None else COVARIANCE_KNOWN,
            },
        )
        attitude = np.zeros((3, 3))
        if self._angle is not None:
            roll, yaw = self._angle[at] * np.radians(1.0) ** 2
            attitude = np.diag([roll, PITCH_VARIANCE, yaw])
        turn = quaternion_of(float(self._yaw_rad[at]), float(self._roll_rad[at]))
        yield (
            "attitude",
            {
                **{f"orientation.{axis}": value for axis, value in turn.items()},
                "orientation_covariance": attitude,
                "angular_velocity_covariance": _NOT_MEASURED,
                "linear_acceleration_covariance": _NOT_MEASURED,
            },
        )


def _variances(*sigmas: Float[np.ndarray, " record"] | None) -> Float[np.ndarray, "record axis"] | None:
    """Squares side by side; None if the drive does not state them all, as a covariance must."""
    stated = [each for each in sigmas if each is not None]
    return np.stack(stated, axis=1) ** 2 if len(stated) == len(sigmas) else None


class _OdometryValues:
    """Members of each record: dead reckoning by the travel along the headings of the navigation, and the speed."""

    def __init__(self, track: OdometryTrack, navigation: NavigationTrack) -> None:
        own = np.unwrap(np.radians(90.0 - navigation.heading_deg))
        self._yaw_rad = np.interp(track.time_s, navigation.time_s, own)
        halfway = self._yaw_rad[:-1] + 0.5 * wrap_angle(np.diff(self._yaw_rad))
        steps_m = np.diff(track.distance_m)
        self._x_m = np.concatenate([[0.0], np.cumsum(steps_m * np.cos(halfway))])
        self._y_m = np.concatenate([[0.0], np.cumsum(steps_m * np.sin(halfway))])
        self._speed_mps: Float[np.ndarray, " odometry"] = np.gradient(track.distance_m, track.time_s)

    def __call__(self, at: int) -> dict[str, Any]:
        turn = quaternion_of(float(self._yaw_rad[at]), 0.0)
        return {
            "child_frame_id": _BODY,
            "pose.pose.position.x": float(self._x_m[at]),
            "pose.pose.position.y": float(self._y_m[at]),
            **{f"pose.pose.orientation.{axis}": value for axis, value in turn.items()},
            "twist.twist.linear.x": float(self._speed_mps[at]),
        }
