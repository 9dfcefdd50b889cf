"""Drives and recordings that the tests of MCAP write: ours, and one as a ROS 2 user's recorder leaves it."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pandas as pd
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from mcap_ros2.writer import Writer

from formats.samples import make_description
from lgprjax.formats import DriveDescription, DriveWriter, NavigationTrack, OdometryTrack, SweepRecording, write_fixes
from lgprjax.formats.ros import RADAR_ARRAY, RADAR_SCAN, definition_of
from lgprjax.frames import LocalFrame

CHANNELS, SAMPLES, SCANS = 3, 8, 300


def curved_description(*, sweeps: bool = False, scans: int = SCANS) -> DriveDescription:
    """A drive on a circle, rolling, reversing at its end, at the edge of the western hemisphere."""
    rng = np.random.default_rng(5)
    time_s = np.arange(0.0, scans / 100.0 + 0.2, 0.05) - 0.1
    heading = np.mod(350.0 + 8.0 * time_s, 360.0)
    navigation = NavigationTrack(
        time_s,
        -33.9 + 5e-7 * np.cumsum(rng.normal(1.0, 0.2, len(time_s))),
        -70.6 - 5e-7 * np.cumsum(rng.normal(1.0, 0.2, len(time_s))),
        540.0 + 0.1 * np.sin(time_s),
        heading,
        3.0 * np.sin(3.0 * time_s),
        *(rng.uniform(0.01, 0.3, (5, len(time_s)))),
    )
    odometer_s = np.arange(0.0, scans / 100.0 + 0.1, 0.02) - 0.05
    distance_m = 40.0 + np.where(odometer_s < 2.0, 1.5 * odometer_s, 6.0 - 1.5 * odometer_s)
    made = make_description(channels=CHANNELS, samples=SAMPLES, sweeps=sweeps)
    return replace(
        made,
        name="a curved drive",
        array=made.array._replace(zero_slip_m=1.4),
        t0_utc="2024-05-01T12:00:00.250000Z",
        navigation=navigation,
        odometry=OdometryTrack(odometer_s, distance_m),
    )


def write_curved(path: Path, dtype: str = "uint8", *, scans: int = SCANS) -> tuple[np.ndarray, np.ndarray]:
    """Write the curved drive with random traces or sweeps; the signal and what of it is valid."""
    rng = np.random.default_rng(6)
    shape = (scans, CHANNELS, SAMPLES)
    signal: np.ndarray
    if dtype == "complex64":
        signal = (rng.normal(size=shape) + 1j * rng.normal(size=shape)).astype(np.complex64)
    elif dtype == "float32":
        signal = rng.normal(size=shape).astype(np.float32)
        signal[3, 1, 2] = np.nan
    else:
        low, high = np.iinfo(dtype).min, np.iinfo(dtype).max
        signal = rng.integers(low, high, shape, dtype=dtype, endpoint=True)
    valid = rng.random((scans, CHANNELS)) > 0.1
    description = curved_description(sweeps=dtype == "complex64", scans=scans)
    time_s = np.arange(scans) / 100.0
    with DriveWriter.create(path, description, channels=CHANNELS, dtype=dtype) as writer:
        if isinstance(description.recording, SweepRecording):
            writer.append_sweeps(time_s, signal, signal[:, 0] + 1.0, valid)
        else:
            writer.append(time_s, signal, valid)
    return signal, valid


def curved_fixes(
    folder: Path, name: str = "a", *, turned_deg: float = 0.0, scans: int = SCANS
) -> tuple[Path, LocalFrame, np.ndarray]:
    """Fixes of the curved drive, every third one ok; the map's anchor lies degrees of longitude away."""
    rng = np.random.default_rng(9)
    frame = LocalFrame(-33.9, -70.6 - turned_deg, 500.0)
    root = rng.normal(size=(scans, 5, 5)) * 0.02
    covariance = (root @ root.transpose(0, 2, 1)).astype(np.float32)
    latitude, longitude = -33.9 + 1e-5 * rng.random(scans), -70.6 + 1e-5 * rng.random(scans)
    height, heading = 540.0 + rng.random(scans), 360.0 * rng.random(scans)
    east, north, _ = frame.to_local(latitude, longitude, height)
    yaw = frame.yaw_of_heading(heading, longitude)
    pose = np.stack([east, north, rng.random(scans), yaw, rng.normal(size=scans) * 0.05], axis=1)
    table = pd.DataFrame(
        {
            "scan": np.arange(scans),
            "time_s": np.arange(scans) / 100.0,
            "latitude_deg": latitude,
            "longitude_deg": longitude,
            "height_m": height,
            "heading_deg": heading,
            "roll_deg": np.degrees(pose[:, 4]),
            "sigma_along_m": 0.1,
            "sigma_cross_m": 0.1,
            "correlation": rng.random(scans),
            "margin": np.where(np.arange(scans) % 7, rng.random(scans), np.nan),
            "overlap_channels": 3,
            "code": np.where(np.arange(scans) % 3, "ambiguous", "ok"),
        }
    )
    attributes = {
        "t0_utc": "2024-05-01T12:00:00.250000+00:00",
        "map": "somewhere",
        "anchor_latitude_deg": frame.latitude_deg,
        "anchor_longitude_deg": frame.longitude_deg,
        "anchor_height_m": frame.height_m,
    }
    paths = folder / f"{name}.fixes.csv", folder / f"{name}.fixes.h5"
    write_fixes(*paths, table, attributes=attributes, pose_m=pose, covariance=covariance)
    return paths[1], frame, covariance.astype(np.float64)


HEADER = """\
================================================================================
MSG: std_msgs/Header
# Two-integer timestamp that is expressed as seconds and nanoseconds.
builtin_interfaces/Time stamp
string frame_id
================================================================================
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
"""
NAV_SAT_FIX = f"""\
# Navigation Satellite fix for any Global Navigation Satellite System
std_msgs/Header header
NavSatStatus status

# Latitude [degrees]. Positive is north of equator; negative is south.
float64 latitude
float64 longitude
float64 altitude
float64[9] position_covariance

uint8 COVARIANCE_TYPE_UNKNOWN = 0
uint8 COVARIANCE_TYPE_KNOWN = 3

uint8 position_covariance_type
================================================================================
MSG: sensor_msgs/NavSatStatus
int8 STATUS_NO_FIX =  -1        # unable to fix position
int8 STATUS_FIX =      0        # unaugmented fix

int8 status

uint16 SERVICE_GPS =     1
uint16 service
{HEADER}"""
_QUATERNION = """\
================================================================================
MSG: geometry_msgs/Quaternion
# This represents an orientation in free space in quaternion form.

float64 x 0
float64 y 0
float64 z 0
float64 w 1
================================================================================
MSG: geometry_msgs/Vector3
float64 x
float64 y
float64 z
"""
IMU = f"""\
std_msgs/Header header

geometry_msgs/Quaternion orientation
float64[9] orientation_covariance # Row major about x, y, z axes

geometry_msgs/Vector3 angular_velocity
float64[9] angular_velocity_covariance

geometry_msgs/Vector3 linear_acceleration
float64[9] linear_acceleration_covariance
{HEADER}{_QUATERNION}"""
ODOMETRY = f"""\
# This represents an estimate of a position and velocity in free space.
std_msgs/Header header
string child_frame_id
geometry_msgs/PoseWithCovariance pose
geometry_msgs/TwistWithCovariance twist
================================================================================
MSG: geometry_msgs/PoseWithCovariance
Pose pose
float64[36] covariance
================================================================================
MSG: geometry_msgs/Pose
Point position
Quaternion orientation
================================================================================
MSG: geometry_msgs/Point
float64 x
float64 y
float64 z
================================================================================
MSG: geometry_msgs/TwistWithCovariance
Twist twist
float64[36] covariance
================================================================================
MSG: geometry_msgs/Twist
Vector3  linear
Vector3  angular
{HEADER}{_QUATERNION}"""

T0_NS = 1_700_000_000_000_000_000
LATITUDE_DEG, LONGITUDE_DEG, METRE_DEG = 47.0, 8.0, 1.0 / 111_000.0


def header_of(time_s: float) -> dict[str, Any]:
    ns = T0_NS + round(1e9 * time_s)
    return {"stamp": {"sec": ns // 10**9, "nanosec": ns % 10**9}, "frame_id": "robot"}


def scan_of(time_s: float, data: np.ndarray) -> dict[str, Any]:
    return {
        "header": header_of(time_s),
        "channels": data.shape[0],
        "samples": data.shape[1],
        "encoding": data.dtype.name,
        "sample_interval_ns": 0.25,
        "time_zero_ns": 1.5,
        "zero_level": 0.0,
        "valid": b"",
        "data": data.tobytes(),
        "calibration": b"",
    }


def position_of(time_s: float, north_m: float, **other: object) -> dict[str, Any]:
    return {
        "header": header_of(time_s),
        "status": {"status": 0, "service": 1},
        "latitude": LATITUDE_DEG + north_m * METRE_DEG,
        "longitude": LONGITUDE_DEG,
        "altitude": 430.0,
        "position_covariance": [0.04, 0.0, 0.0, 0.0, 0.09, 0.0, 0.0, 0.0, 0.25],
        "position_covariance_type": 2,
        **other,
    }


def orientation_of(yaw_rad: float) -> dict[str, float]:
    return {"x": 0.0, "y": 0.0, "z": float(np.sin(yaw_rad / 2)), "w": float(np.cos(yaw_rad / 2))}


def attitude_of(time_s: float, yaw_rad: float, **other: object) -> dict[str, Any]:
    return {
        "header": header_of(time_s),
        "orientation": orientation_of(yaw_rad),
        "orientation_covariance": [1e-4, 0.0, 0.0, 0.0, 1e-4, 0.0, 0.0, 0.0, 4e-4],
        "angular_velocity": {},
        "angular_velocity_covariance": [0.0] * 9,
        "linear_acceleration": {},
        "linear_acceleration_covariance": [0.0] * 9,
        **other,
    }


def odometry_of(time_s: float, x_m: float, speed_mps: float = 0.0, **other: object) -> dict[str, Any]:
    """The odometer was switched on while the vehicle looked along its x axis."""
    return {
        "header": header_of(time_s),
        "child_frame_id": "robot",
        "pose": {"pose": {"position": {"x": x_m, "y": 0.0, "z": 0.0}, "orientation": orientation_of(0.0)}},
        "twist": {"twist": {"linear": {"x": speed_mps}}},
        **other,
    }


VECTOR3_STAMPED = f"""\
std_msgs/Header header
Vector3 vector
{HEADER}{_QUATERNION}"""
JOINT_STATE = f"""\
std_msgs/Header header

string[] name
float64[] position
float64[] velocity
float64[] effort
{HEADER}"""
BATTERY_STATE = f"""\
uint8 POWER_SUPPLY_STATUS_UNKNOWN = 0

std_msgs/Header  header
float32 voltage          # Voltage in Volts (Mandatory)
bool    present
float32[] cell_voltage
string serial_number
{HEADER}"""
ACKERMANN = f"""\
std_msgs/Header header
AckermannDrive  drive
================================================================================
MSG: ackermann_msgs/AckermannDrive
# The steering_angle is positive to the left
float32 steering_angle
float32 speed
{HEADER}"""

READ_ONLY = {
    "geometry_msgs/msg/Vector3Stamped": VECTOR3_STAMPED,
    "sensor_msgs/msg/JointState": JOINT_STATE,
    "sensor_msgs/msg/BatteryState": BATTERY_STATE,
    "ackermann_msgs/msg/AckermannDriveStamped": ACKERMANN,
}
"""Definitions of messages that are read and never written."""
DEFINITIONS = {
    "sensor_msgs/msg/NavSatFix": NAV_SAT_FIX,
    "sensor_msgs/msg/Imu": IMU,
    "nav_msgs/msg/Odometry": ODOMETRY,
    "my_msgs/msg/RadarScan": definition_of(RADAR_SCAN),
    "my_msgs/msg/RadarArray": definition_of(RADAR_ARRAY),
}
Message = tuple[str, str, float, dict[str, Any]]
"""Topic, type, moment of recording in s, members."""


def rover_messages(scans: int = 50) -> list[Message]:
    """A rover that drives north at 1 m/s: scans at 20 Hz, positions at 5, orientations at 50, odometry at 10."""
    rng = np.random.default_rng(7)
    messages: list[Message] = []
    last_s = (scans - 1) / 20.0
    for number in range(scans):
        data = rng.integers(-3000, 3000, (2, 16)).astype(np.int16)
        messages.append(("/rover/gpr", "my_msgs/msg/RadarScan", number / 20.0, scan_of(number / 20.0, data)))
    for time_s in np.arange(0.0, last_s + 0.2, 0.2):
        messages.append(("/rover/gps", "sensor_msgs/msg/NavSatFix", time_s, position_of(time_s, time_s)))
    for time_s in np.arange(0.0, last_s + 0.2, 0.02):
        messages.append(("/rover/imu", "sensor_msgs/msg/Imu", time_s, attitude_of(time_s, np.pi / 2)))
    for time_s in np.arange(0.0, last_s + 0.2, 0.1):
        messages.append(("/rover/odom", "nav_msgs/msg/Odometry", time_s, odometry_of(time_s, time_s, 1.0)))
    return sorted(messages, key=lambda message: message[2])


def write_recording(path: Path, messages: list[Message], *, lag_s: float = 0.02, chunk_size: int = 4096) -> Path:
    """Write messages with the library that ROS users have; ``lag_s`` after their moments they are recorded."""
    with path.open("wb") as stream:
        writer = Writer(stream, chunk_size=chunk_size)
        schemas: dict[str, Any] = {}
        for topic, kind, time_s, values in messages:
            if kind not in schemas:
                schemas[kind] = writer.register_msgdef(kind, {**DEFINITIONS, **READ_ONLY}[kind])
            log_ns = T0_NS + round(1e9 * (time_s + lag_s))
            writer.write_message(topic, schemas[kind], values, log_time=log_ns, publish_time=log_ns)
        writer.finish()
    return path


def changed(messages: list[Message], topic: str, change: Callable[[int, dict[str, Any]], Any]) -> list[Message]:
    """Messages with those of a topic changed, by their number; ``None`` leaves a message out."""
    number, out = 0, []
    for each in messages:
        if each[0] != topic:
            out.append(each)
            continue
        values = change(number, dict(each[3]))
        number += 1
        if values is not None:
            out.append((*each[:3], values))
    return out


def decoded(path: Path) -> dict[str, list[tuple[int, SimpleNamespace]]]:
    """Time of recording and message, by topic, as the library decodes them."""
    found: dict[str, list[tuple[int, SimpleNamespace]]] = {}
    with path.open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True, decoder_factories=[DecoderFactory()])
        for _, channel, message, values in reader.iter_decoded_messages():
            found.setdefault(channel.topic, []).append((message.log_time, values))
    return found
