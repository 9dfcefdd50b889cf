"""A drive log, and its fixes, as a recording of ROS messages, streaming: MCAP, or a ROS bag.

Needs the optional package mcap (``pip install lgprjax[log]``), for bags rosbags (``pip install lgprjax[rosbag]``).
"""

import json
from collections import deque
from collections.abc import Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager
from pathlib import Path
from typing import IO, Any, NamedTuple

import jax.numpy as jnp
import numpy as np
import pandas as pd
from jaxtyping import Bool, Complex, Float, Int, Num

from lgprjax import __version__
from lgprjax.errors import InputError
from lgprjax.formats.drive import DriveLog, NavigationTrack, OdometryTrack, SweepRecording, TraceRecording
from lgprjax.formats.fixes import read_fix_poses, read_fixes, refuse_other_drive
from lgprjax.formats.mcap_recording import SWEEPS, ScanForm, array_values, require_mcap, scan_values
from lgprjax.formats.ros import (
    COVARIANCE_KNOWN,
    COVARIANCE_UNKNOWN,
    DRIVE_METADATA,
    TOPICS,
    TRANSFORMS,
    UNKNOWN_M2,
    UNKNOWN_RAD2,
    MessageLayout,
    definition_of,
    layout_to_write,
    pose_covariance,
    quaternion_of,
    rotation_of,
)
from lgprjax.formats.rosbag_recording import BAG_SUFFIXES, RosbagWriter, rosbag_writer
from lgprjax.formats.store import atomic_output, utc_ns, utc_text
from lgprjax.frames import LocalFrame, wrap_angle
from lgprjax.radar import (
    ArrayGeometry,
    ChannelResponse,
    LookUp,
    Radargram,
    calibrate_sweeps,
    centre_of,
    clear_view,
    depth_window_ns,
    stacked,
    sweep_chain,
    sweep_operator,
    sweep_samples,
    sweep_step_hz,
)

# Frames: the map, metres east, north and up of its anchor; the vehicle, its origin at the rear axle on the ground; the
# array, its origin at its centre, with the vehicle's axes.
_MAP, _BODY, _ARRAY = "map", "base_link", "radar_array"

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
        covariance: covariance of east, north, height, yaw, roll.
        turn_rad: rotation of the map's axes relative to true east and north at the fix.
        has_pose: whether the fix is ok, with a pose.
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
        InputError: the file is not a file of fixes, has no poses, or its fixes are of another drive.
    """
    file = Path(path)
    if not file.name.endswith(".fixes.h5"):
        raise InputError(file, "file name", "a name that ends in .fixes.h5", repr(file.name))
    table = read_fixes(file)
    pose_m, covariance = read_fix_poses(file)
    anchor = [each for each in map(table.attrs.get, _ANCHOR) if isinstance(each, float)]
    if pose_m is None or covariance is None or len(anchor) < len(_ANCHOR):
        raise InputError(file, "/pose_m, /covariance and the anchor", "fixes written by lgprjax register", "none")
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
        map=_map_texts(str(table.attrs.get("map", "")), frame),
    )


def fix_messages(fixes: ExportedFixes, number: int, array: ArrayGeometry) -> Iterator[tuple[str, str, dict[str, Any]]]:
    """Part of ``TOPICS``, frame, and members without the header's, of each message of a fix."""
    row = fixes.table.iloc[number]
    yield (
        "fix quality",
        _MAP,
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
    place_m, angle_rad = fixes.place_m[number], fixes.angle_rad[number]
    body_m = place_m - rotation_of(*map(float, angle_rad)) @ _centre_m(array)
    yield "transform", _MAP, _transform(_BODY, body_m, *map(float, angle_rad))
    members = {f"pose.pose.position.{axis}": float(v) for axis, v in zip("xyz", place_m, strict=True)}
    turn = quaternion_of(*map(float, angle_rad))
    members |= {f"pose.pose.orientation.{axis}": value for axis, value in turn.items()}
    yield "fix pose", _MAP, {**members, "pose.covariance": pose_covariance(covariance)}
    cos, sin = np.cos(fixes.turn_rad[number]), np.sin(fixes.turn_rad[number])
    to_true = np.array([[cos, sin, 0.0], [-sin, cos, 0.0], [0.0, 0.0, 1.0]])
    yield (
        "fix position",
        _ARRAY,
        {
            "latitude": float(row["latitude_deg"]),
            "longitude": float(row["longitude_deg"]),
            "altitude": float(row["height_m"]),
            "position_covariance": to_true @ covariance[:3, :3] @ to_true.T,
            "position_covariance_type": COVARIANCE_KNOWN,
        },
    )


def _map_texts(name: str, frame: LocalFrame) -> dict[str, str]:
    """Name and anchor of a map for metadata."""
    anchor = (frame.latitude_deg, frame.longitude_deg, frame.height_m)
    return {"map": name, **dict(zip(_ANCHOR, map(repr, anchor), strict=True))}


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
        raise InputError(file, "time_s", f"the scan times of {log.path.name}", "other times")
    refuse_other_drive(file, table, log.path)


MAP_METADATA = "lgprjax.map"
"""Name of the metadata with the place of the map's frame on the earth."""
_BLOCK_SCANS = 256
# Seconds of a stamp are an int32.
_LATEST_NS = (1 << 31) * 1_000_000_000
_NOT_MEASURED = np.array([-1.0, *[0.0] * 8])
"""Covariance in an ``Imu`` for a missing measurement."""


class ExportedDrive(NamedTuple):
    """Result of an export: number of scans and of poses of fixes, and parts of the drive without a message."""

    scans: int
    poses: int
    left_out: tuple[str, ...]


_MCAP_SUFFIX = ".mcap"
MESSAGE_SUFFIXES = (_MCAP_SUFFIX, *BAG_SUFFIXES)
# Of a topic that is kept for subscribers that come late, by the numbers that every version of ROS 2 reads: the last
# message, reliable, transient local.
_LATCHED_QOS = """\
- history: 1
  depth: 1
  reliability: 1
  durability: 1
  deadline: {sec: 0, nsec: 0}
  lifespan: {sec: 0, nsec: 0}
  liveliness: 1
  liveliness_lease_duration: {sec: 0, nsec: 0}
  avoid_ros_namespace_conventions: false
"""


class _McapWriter:
    """An MCAP file to write."""

    def __init__(self, stream: IO[bytes]) -> None:
        from mcap.writer import Writer

        self._writer = Writer(stream)
        self._writer.start(profile="ros2", library=f"lgprjax {__version__}")

    def metadata(self, name: str, texts: dict[str, str]) -> None:
        self._writer.add_metadata(name, texts)

    def topic(self, topic: str, kind: str, *, latched: bool) -> int:
        schema = self._writer.register_schema(kind, "ros2msg", definition_of(kind).encode())
        metadata = {"offered_qos_profiles": _LATCHED_QOS} if latched else {}
        return self._writer.register_channel(topic, "cdr", schema, metadata)

    def write(self, topic: int, ns: int, data: bytes) -> None:
        self._writer.add_message(topic, ns, data, ns)

    def finish(self) -> None:
        self._writer.finish()


@contextmanager
def _mcap_writer(path: Path, force: bool) -> Iterator[_McapWriter]:
    require_mcap(path)
    with atomic_output(path, force) as temporary, temporary.open("wb") as stream:
        writer = _McapWriter(stream)
        yield writer
        writer.finish()


def _message_file(path: Path, force: bool) -> AbstractContextManager[_McapWriter | RosbagWriter]:
    return _mcap_writer(path, force) if path.suffix.lower() == _MCAP_SUFFIX else rosbag_writer(path, force)


class _Messages:
    """Messages of one file; each topic begins with its first message."""

    def __init__(self, file: _McapWriter | RosbagWriter) -> None:
        self._file = file
        self._topics: dict[str, tuple[Any, MessageLayout, str]] = {}

    def put(self, part: str, ns: int, frame: str, values: dict[str, Any]) -> None:
        if part not in self._topics:
            topic, kind = TOPICS[part]
            # A transform's header is in the array of transforms.
            header = "transforms.header" if kind == TRANSFORMS else "header"
            self._topics[part] = (
                self._file.topic(topic, kind, latched=part == "mounting"),
                layout_to_write(kind),
                header,
            )
        topic, layout, header = self._topics[part]
        sec, nanosec = divmod(ns, 1_000_000_000)
        stamp = {f"{header}.stamp.sec": sec, f"{header}.stamp.nanosec": nanosec, f"{header}.frame_id": frame}
        self._file.write(topic, ns, layout.encode({**stamp, **values}))


def export_mcap(
    drive: str | Path, output: str | Path, *, fixes: str | Path | None = None, force: bool = False
) -> ExportedDrive:
    """Write a drive log as a recording that ROS tools and Foxglove read; docs/transfer.md has its topics.

    Scans are copied bit by bit, sweeps as well as traces; stamps are whole nanoseconds. Fixes that are ok become poses
    and transforms in the map's frame, and positions; the quality of every fix is written. Without fixes, transforms are
    those of the navigation as recorded, in metres from its first place.

    Args:
        drive: the drive log.
        output: the recording: ``X.mcap``, ``X.bag`` of ROS 1, or ``X.db3``, a folder, of ROS 2.
        fixes: ``X.fixes.h5`` of the drive.
        force: replace an output that exists.

    Raises:
        InputError: an input is missing or damaged, the fixes are not of this drive, the package for the output is
            missing, or the output has another name, exists (without ``force``) or cannot be written.
    """
    path = Path(output)
    if path.suffix.lower() not in MESSAGE_SUFFIXES:
        raise InputError(path, "file name", f"a name that ends in {', '.join(MESSAGE_SUFFIXES)}", repr(path.suffix))
    with ExitStack() as stack:
        log = stack.enter_context(DriveLog.open(drive))
        found = None if fixes is None else fixes_of(fixes, log)
        times_ns = _times_ns(log, found)
        description = log.description
        frame = _frame_of(description.navigation)
        file = stack.enter_context(_message_file(path, force))
        _write_head(file, log, _map_texts("", frame) if found is None else found.map)
        messages = _Messages(file)
        _write_mounting(messages, log, int(min(each[0] for each in times_ns.values())))
        navigation = _NavigationValues(description.navigation, frame if found is None else None)
        radargram = _RadargramImages(log)
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
                values, trace = next(scans)
                messages.put("scan", ns, _ARRAY, values)
                if (image := radargram.add(at, trace)) is not None:
                    messages.put("radargram", ns, _ARRAY, image)
            elif name == "navigation":
                for part, of, values in navigation(at):
                    messages.put(part, ns, of, values)
            elif name == "odometry":
                messages.put("odometry", ns, "odom", odometry(at))
            elif found is not None:
                for part, of, values in fix_messages(found, at, description.array):
                    messages.put(part, ns, of, values)
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


def _frame_of(navigation: NavigationTrack) -> LocalFrame:
    """The map's frame of a drive without fixes: metres from its first recorded place."""
    return LocalFrame(
        float(navigation.latitude_deg[0]), float(navigation.longitude_deg[0]), float(navigation.height_m[0])
    )


def _write_head(file: _McapWriter | RosbagWriter, log: DriveLog, map_texts: dict[str, str]) -> None:
    """Metadata of the whole file, written first, so that a truncated file keeps it."""
    description = log.description
    texts = {"name": description.name, "t0_utc": description.t0_utc, "provenance": json.dumps(description.provenance)}
    file.metadata(DRIVE_METADATA, texts)
    file.metadata(MAP_METADATA, map_texts)


def _write_mounting(messages: _Messages, log: DriveLog, begin_ns: int) -> None:
    """The array, and where it is on the vehicle."""
    array = log.description.array
    messages.put("array", begin_ns, _BODY, array_values(array, log.description.recording))
    messages.put("mounting", begin_ns, _BODY, _transform(_ARRAY, _centre_m(array), 0.0, 0.0))


def _centre_m(array: ArrayGeometry) -> Float[np.ndarray, "3"]:
    """The array's centre in the vehicle's frame: forward, left, above the ground."""
    return np.array([*centre_of(array), array.height_m])


def _transform(child: str, place_m: Float[np.ndarray, "3"], yaw_rad: float, roll_rad: float) -> dict[str, Any]:
    """Members of a transform, but its header's."""
    return {
        "transforms_count": 1,
        "transforms.child_frame_id": child,
        **{f"transforms.transform.translation.{axis}": float(v) for axis, v in zip("xyz", place_m, strict=True)},
        **{f"transforms.transform.rotation.{axis}": v for axis, v in quaternion_of(yaw_rad, roll_rad).items()},
    }


def _scan_values(log: DriveLog) -> Iterator[tuple[dict[str, Any], Float[np.ndarray, " sample"]]]:
    """Members of the scans one after the other, and the trace of the middle channel, read in blocks."""
    recording = log.description.recording
    for start in range(0, log.scans, _BLOCK_SCANS):
        stored, valid, calibration = log.read_stored(start, min(start + _BLOCK_SCANS, log.scans))
        if isinstance(recording, TraceRecording):
            numbers = (recording.sample_interval_ns, recording.time_zero_ns, recording.zero_level)
            form = ScanForm(log.channels, log.samples, stored.dtype.name, *numbers)
        else:
            form = ScanForm(log.channels, log.samples, SWEEPS, 0.0, 0.0, 0.0)
        middle = _middle_traces(recording, stored, valid, calibration)
        for row, signal in enumerate(stored):
            own = None if calibration is None else calibration[row]
            yield scan_values(form, signal, valid[row], own), middle[row]


# The middle channel as a picture that moves along.

_MOST_COLUMNS = 512
_COLUMNS_AN_IMAGE = 128
_GREY = 128
# The grey scale is symmetric, and ends at this percentile of the absolute amplitudes.
_LIMIT_PERCENTILE = 98.5


class _RadargramImages:
    """The last scans of the middle channel, processed for display by ``clear_view``.

    An image comes after every 128 columns, and after the last one; it is at most 512 columns wide, so that images hold
    at most four bytes a column and sample of the whole drive. Scans taken standing or in reverse are no columns.
    """

    def __init__(self, log: DriveLog) -> None:
        odometry = log.description.odometry
        travel_m = np.interp(log.scan_time_s, odometry.time_s, odometry.distance_m)
        onward = np.diff(np.maximum.accumulate(travel_m), prepend=-np.inf) > 0.0
        # A drive that does not move: every scan is one.
        self._onward = onward if np.count_nonzero(onward) > 1 else np.ones(log.scans, bool)
        columns = int(np.count_nonzero(self._onward))
        self._width = min(columns, _MOST_COLUMNS)
        self._last = int(np.flatnonzero(self._onward)[-1])
        self._time_ns, self._frequency_hz = _travel_times(log.description.recording)
        self._traces: deque[np.ndarray] = deque(maxlen=self._width)
        self._fresh = 0

    def add(self, scan: int, trace: Float[np.ndarray, " sample"]) -> dict[str, Any] | None:
        """Members, but the header's, of an image that is due with this scan."""
        if not self._onward[scan] or not len(trace):
            return None
        self._traces.append(trace)
        self._fresh += 1
        if self._fresh < _COLUMNS_AN_IMAGE and scan != self._last:
            return None
        self._fresh = 0
        return self._image()

    def _image(self) -> dict[str, Any]:
        """Travel time down, the newest scan at the right; grey where there is no trace."""
        view = clear_view(
            Radargram(
                name="",
                amplitude=np.stack(list(self._traces)),
                along=np.arange(len(self._traces), dtype=np.float64),
                in_metres=False,
                time_ns=self._time_ns,
                centre_frequency_hz=self._frequency_hz,
            )
        )
        held = np.isfinite(view.amplitude)
        level = np.where(held, view.amplitude, 0.0)
        limit = float(np.percentile(np.abs(level[held]), _LIMIT_PERCENTILE)) if held.any() else 0.0
        grey = np.clip(np.rint(_GREY + (_GREY - 1) * level / (limit or 1.0)), 0, 255).astype(np.uint8)
        image = np.full((len(self._time_ns), self._width), _GREY, np.uint8)
        image[:, self._width - len(grey) :] = grey.T
        height, width = image.shape
        return {"height": height, "width": width, "encoding": "mono8", "step": width, "data": image}


def _travel_times(
    recording: TraceRecording | SweepRecording,
) -> tuple[Float[np.ndarray, " sample"], float | None]:
    """Two-way travel time of each sample of ``_middle_traces``, and the nominal frequency if known."""
    if isinstance(recording, TraceRecording):
        time_ns = np.arange(recording.samples) * recording.sample_interval_ns - recording.time_zero_ns
        return time_ns, recording.centre_frequency_hz
    if not _can_be_transformed(recording):
        return np.zeros(0), None
    frequencies_hz = recording.frequencies_hz
    settings = sweep_chain(frequencies_hz, 0.0)
    samples = sweep_samples(frequencies_hz, settings, depth_window_ns(settings))
    centre_hz = 0.5 * float(frequencies_hz[0] + frequencies_hz[-1])
    return np.arange(samples) * settings.sample_interval_ns, centre_hz


def _middle_traces(
    recording: TraceRecording | SweepRecording,
    stored: Num[np.ndarray, "scan channel recorded"],
    valid: Bool[np.ndarray, "scan channel"],
    calibration: Complex[np.ndarray, "scan recorded"] | None,
) -> Float[np.ndarray, "scan sample"]:
    """Traces of the middle channel, zero level removed; NaN for missing traces; no samples if they are unavailable."""
    middle = stored.shape[1] // 2
    if isinstance(recording, TraceRecording):
        traces = stored[:, middle].astype(np.float32) - np.float32(recording.zero_level)
        held = valid[:, middle]
    elif calibration is None or not _can_be_transformed(recording):
        return np.zeros((len(stored), 0), np.float32)
    else:
        one = slice(middle, middle + 1)
        ground, usable = calibrate_sweeps(
            jnp.asarray(stored[:, one]),
            jnp.asarray(calibration),
            LookUp(jnp.asarray(recording.lookup_sweeps[one]), jnp.asarray(recording.lookup_calibration_sweep)),
            ChannelResponse(*(jnp.asarray(part[one], dtype=jnp.float32) for part in recording.response)),
            jnp.asarray(recording.frequencies_hz, dtype=jnp.float32),
        )
        settings = sweep_chain(recording.frequencies_hz, 0.0)
        samples = len(_travel_times(recording)[0])
        delay_ns = recording.group_delay_ns
        operator = sweep_operator(recording.frequencies_hz, settings, group_delay_ns=delay_ns, kept=samples)
        traces = np.asarray(stacked(ground)[:, 0] @ operator)
        held = valid[:, middle] & np.asarray(usable)[:, 0]
    held = held & np.isfinite(traces).all(axis=1)
    return np.where(held[:, None], traces, np.float32(np.nan))


def _can_be_transformed(recording: SweepRecording) -> bool:
    """Whether sweeps become traces: equal steps, and a calibration sweep to divide by."""
    return sweep_step_hz(recording.frequencies_hz) is not None and bool(np.all(recording.lookup_calibration_sweep))


class _NavigationValues:
    """Part, frame and members of the position and the attitude of each record, and of the transform in a frame."""

    def __init__(self, track: NavigationTrack, frame: LocalFrame | None) -> None:
        self._track = track
        self._body: tuple[Float[np.ndarray, "record 3"], Float[np.ndarray, " record"]] | None = None
        if frame is not None:
            place = frame.to_local(track.latitude_deg, track.longitude_deg, track.height_m)
            self._body = np.stack(place, axis=1), frame.yaw_of_heading(track.heading_deg, track.longitude_deg)
        self._yaw_rad, self._roll_rad = np.radians(90.0 - track.heading_deg), np.radians(track.roll_deg)
        self._place = _variances(UNKNOWN_M2, track.sigma_east_m, track.sigma_north_m, track.sigma_height_m)
        self._angle = _variances(UNKNOWN_RAD2, *map(_radians, (track.sigma_roll_deg, None, track.sigma_heading_deg)))

    def __call__(self, at: int) -> Iterator[tuple[str, str, dict[str, Any]]]:
        track = self._track
        if self._body is not None:
            place_m, yaw_rad = self._body
            yield "transform", _MAP, _transform(_BODY, place_m[at], float(yaw_rad[at]), float(self._roll_rad[at]))
        yield (
            "position",
            _BODY,
            {
                "latitude": float(track.latitude_deg[at]),
                "longitude": float(track.longitude_deg[at]),
                "altitude": float(track.height_m[at]),
                "position_covariance": np.zeros((3, 3)) if self._place is None else np.diag(self._place[at]),
                "position_covariance_type": COVARIANCE_UNKNOWN if self._place is None else COVARIANCE_KNOWN,
            },
        )
        turn = quaternion_of(float(self._yaw_rad[at]), float(self._roll_rad[at]))
        yield (
            "attitude",
            _BODY,
            {
                **{f"orientation.{axis}": value for axis, value in turn.items()},
                "orientation_covariance": np.zeros((3, 3)) if self._angle is None else np.diag(self._angle[at]),
                "angular_velocity_covariance": _NOT_MEASURED,
                "linear_acceleration_covariance": _NOT_MEASURED,
            },
        )


def _variances(unknown: float, *sigmas: Float[np.ndarray, " record"] | None) -> Float[np.ndarray, "record axis"] | None:
    """Squares side by side, with a variance for those that the drive does not state; ``None`` if it states none."""
    stated = next((each for each in sigmas if each is not None), None)
    if stated is None:
        return None
    whole = [np.full(len(stated), np.nan) if each is None else each for each in sigmas]
    return np.asarray(np.nan_to_num(np.stack(whole, axis=1) ** 2, nan=unknown))


def _radians(sigma_deg: Float[np.ndarray, " record"] | None) -> Float[np.ndarray, " record"] | None:
    return None if sigma_deg is None else np.radians(sigma_deg)


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
