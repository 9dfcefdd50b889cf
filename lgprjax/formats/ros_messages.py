"""The messages of a recording that this project writes and reads: their definitions, topics, and angles in them.

Axes are those of ROS (REP 103): x forward, y left, z up; maps and orientations count from east, counter-clockwise.
"""

import math
import re
from functools import lru_cache

import numpy as np
from jaxtyping import Float

from lgprjax.formats.ros_layout import Layout, layout_of, short_name

RADAR_SCAN = "lgprjax_msgs/msg/RadarScan"
RADAR_ARRAY = "lgprjax_msgs/msg/RadarArray"
FIX_QUALITY = "lgprjax_msgs/msg/FixQuality"
NAV_SAT_FIX = "sensor_msgs/msg/NavSatFix"
IMU = "sensor_msgs/msg/Imu"
POSE = "geometry_msgs/msg/PoseWithCovarianceStamped"
ODOMETRY = "nav_msgs/msg/Odometry"

TOPICS = {
    "scan": ("/gpr/scan", RADAR_SCAN),
    "array": ("/gpr/array", RADAR_ARRAY),
    "position": ("/gnss/fix", NAV_SAT_FIX),
    "attitude": ("/gnss/imu", IMU),
    "odometry": ("/odometry", ODOMETRY),
    "fix pose": ("/lgpr/pose", POSE),
    "fix position": ("/lgpr/fix", NAV_SAT_FIX),
    "fix quality": ("/lgpr/quality", FIX_QUALITY),
}
"""Topic and type of each part of a drive, as written; on reading, the topic that is preferred among several."""

DRIVE_METADATA = "lgprjax.drive"
"""Name of the metadata that an exported drive leaves in the file: name, t0_utc, provenance."""
# A drive log has no pitch: a right angle either way.
PITCH_VARIANCE = (np.pi / 2) ** 2
COVARIANCE_UNKNOWN, COVARIANCE_KNOWN = 0, 3

_OWN = {
    RADAR_SCAN: """\
# One scan of a radar array.
std_msgs/Header header       # stamp: moment at which the first channel was heard
uint32 channels              # from left to right
uint32 samples               # of a trace, or frequencies of a sweep
string encoding              # of data, little-endian: uint8, int16, int32, float32 (traces), complex64 (sweeps)
float64 sample_interval_ns   # two-way travel time between samples; 0 of sweeps
float64 time_zero_ns         # time zero lies this long after the first sample
float64 zero_level           # value that stands for no signal
uint8[] valid                # one a channel, 0 where it was not heard; empty: all were
uint8[] data                 # channel after channel, sample after sample
uint8[] calibration          # sweep of the calibration channel, encoded like data; empty of traces
""",
    RADAR_ARRAY: """\
# Where the antennas of a radar array are, and what reading its scans needs beside them.
std_msgs/Header header               # frame_id: the vehicle; its origin is at the rear axle, on the ground
float64[] x_m                        # forward, one a channel
float64[] y_m                        # to the left, one a channel, falling
float64[] time_offset_s              # delay of each channel after the stamp of its scan
float64 height_m                     # of the array above the ground
float64 centre_frequency_hz          # 0: not known
float64[] frequencies_hz             # of sweeps; empty of traces, and so is all that follows
float64 group_delay_ns               # delay of the calibration channel's path
float32[] lookup_sweeps              # real, imaginary, of each channel and frequency: the array in empty space
float32[] lookup_calibration_sweep   # real, imaginary, of each frequency
float64[] channel_gain               # relative to the array's mean; empty: 1
float64[] channel_delay_ns           # relative to the array's mean; empty: 0
""",
    FIX_QUALITY: """\
# What is known of the match of one scan with the map. Only scans of code ok have a pose on the other topics.
std_msgs/Header header     # stamp: that of the scan
uint32 scan                # number in the drive
string code                # ok, low_correlation, ambiguous, edge, off_map, low_overlap, non_finite, no_window
float64 correlation
float64 margin             # correlation less that of the runner-up
uint32 overlap_channels    # channels that the map covers there
""",
}
_STANDARD = {
    NAV_SAT_FIX: """\
uint8 COVARIANCE_TYPE_UNKNOWN=0
uint8 COVARIANCE_TYPE_APPROXIMATED=1
uint8 COVARIANCE_TYPE_DIAGONAL_KNOWN=2
uint8 COVARIANCE_TYPE_KNOWN=3
std_msgs/Header header
sensor_msgs/NavSatStatus status
float64 latitude
float64 longitude
float64 altitude
float64[9] position_covariance
uint8 position_covariance_type
""",
    IMU: """\
std_msgs/Header header
geometry_msgs/Quaternion orientation
float64[9] orientation_covariance
geometry_msgs/Vector3 angular_velocity
float64[9] angular_velocity_covariance
geometry_msgs/Vector3 linear_acceleration
float64[9] linear_acceleration_covariance
""",
    POSE: "std_msgs/Header header\ngeometry_msgs/PoseWithCovariance pose\n",
    ODOMETRY: """\
std_msgs/Header header
string child_frame_id
geometry_msgs/PoseWithCovariance pose
geometry_msgs/TwistWithCovariance twist
""",
}
_NESTED = {
    "std_msgs/Header": "builtin_interfaces/Time stamp\nstring frame_id\n",
    "builtin_interfaces/Time": "int32 sec\nuint32 nanosec\n",
    "sensor_msgs/NavSatStatus": """\
int8 STATUS_NO_FIX=-1
int8 STATUS_FIX=0
int8 STATUS_SBAS_FIX=1
int8 STATUS_GBAS_FIX=2
int8 status
uint16 SERVICE_GPS=1
uint16 SERVICE_GLONASS=2
uint16 SERVICE_COMPASS=4
uint16 SERVICE_GALILEO=8
uint16 service
""",
    "geometry_msgs/Point": "float64 x\nfloat64 y\nfloat64 z\n",
    "geometry_msgs/Vector3": "float64 x\nfloat64 y\nfloat64 z\n",
    "geometry_msgs/Quaternion": "float64 x 0\nfloat64 y 0\nfloat64 z 0\nfloat64 w 1\n",
    "geometry_msgs/Pose": "geometry_msgs/Point position\ngeometry_msgs/Quaternion orientation\n",
    "geometry_msgs/Twist": "geometry_msgs/Vector3 linear\ngeometry_msgs/Vector3 angular\n",
    "geometry_msgs/PoseWithCovariance": "geometry_msgs/Pose pose\nfloat64[36] covariance\n",
    "geometry_msgs/TwistWithCovariance": "geometry_msgs/Twist twist\nfloat64[36] covariance\n",
}


def definition_of(name: str) -> str:
    """Definition of a message and, below it, those of the messages in it, as recordings carry them."""
    text = (_OWN | _STANDARD)[name]
    parts, names = [text], _nested_in(text)
    for nested in names:
        parts.append(f"{'=' * 80}\nMSG: {nested}\n{_NESTED[nested]}")
        names += [each for each in _nested_in(_NESTED[nested]) if each not in names]
    return "".join(parts)


def layout_to_write(name: str) -> Layout:
    """Layout by which a message is written."""
    return layout_of(name, definition_of(name))


@lru_cache(maxsize=1024)
def is_kind(name: str, kind: str) -> bool:
    """Whether a type is the one meant; messages of the radar may stand in a package of any name."""
    if kind in _OWN:
        return name.rpartition("/")[2] == kind.rpartition("/")[2]
    return short_name(name) == short_name(kind)


def quaternion_of(yaw_rad: float, roll_rad: float) -> dict[str, float]:
    """Orientation without pitch: first the roll about x, then the yaw about z."""
    cos_yaw, sin_yaw = math.cos(0.5 * yaw_rad), math.sin(0.5 * yaw_rad)
    cos_roll, sin_roll = math.cos(0.5 * roll_rad), math.sin(0.5 * roll_rad)
    return {"x": cos_yaw * sin_roll, "y": sin_yaw * sin_roll, "z": sin_yaw * cos_roll, "w": cos_yaw * cos_roll}


def yaw_and_roll(x: float, y: float, z: float, w: float) -> tuple[float, float]:
    """Yaw and roll, radians, of an orientation; its pitch is put aside. NaN where it is none (length not about 1)."""
    length = x * x + y * y + z * z + w * w
    if not 0.9 < length < 1.1:
        return math.nan, math.nan
    yaw = math.atan2(2.0 * (w * z + x * y), w * w + x * x - y * y - z * z)
    roll = math.atan2(2.0 * (w * x + y * z), w * w - x * x - y * y + z * z)
    return yaw, roll


def pose_covariance(covariance: Float[np.ndarray, "5 5"]) -> Float[np.ndarray, "6 6"]:
    """Covariance of x, y, z, roll, pitch, yaw from that of east, north, height, yaw, roll."""
    places = np.array([0, 1, 2, 5, 3])
    reordered = np.zeros((6, 6))
    reordered[np.ix_(places, places)] = covariance
    reordered[4, 4] = PITCH_VARIANCE
    return reordered


def _nested_in(text: str) -> list[str]:
    return list(dict.fromkeys(re.findall(r"^(\w+/\w+) ", text, re.MULTILINE)))
