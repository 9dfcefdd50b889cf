"""ROS messages that this project writes and reads: definitions, topics, and angles.

Axes are those of ROS (REP 103): x forward, y left, z up; maps and orientations count from east, counter-clockwise.
"""

import math
import re
import struct
from collections.abc import Iterator, Mapping
from functools import lru_cache
from itertools import islice
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

# ROS 2 message definitions in recordings (``ros2msg``), and their messages in CDR.
#
# A definition is flattened once; a message is then decoded by the fields defined in its own recording, in their order.
# Source: OMG DDS-XTypes 1.3, section 7.4.3 (plain CDR, version 1), and the ROS 2 interface definition.

_CODES = {
    **{"bool": "?", "byte": "B", "char": "B", "float32": "f", "float64": "d", "string": "s"},
    **{"int8": "b", "uint8": "B", "int16": "h", "uint16": "H"},
    **{"int32": "i", "uint32": "I", "int64": "q", "uint64": "Q"},
}
# Some recorders leave these out of the definitions.
_KNOWN = {
    "builtin_interfaces/Time": "int32 sec\nuint32 nanosec",
    "builtin_interfaces/Duration": "int32 sec\nuint32 nanosec",
}
_NUMBERS = {order + code: struct.Struct(order + code) for order in "<>" for code in _CODES.values() if code != "s"}
_TYPE = re.compile(r"([A-Za-z][\w/]*)(?:<=\d+)?(?:\[((?:<=)?)(\d*)\])?")
# Limits for definitions that nest themselves, beyond any real message.
_MOST_NESTED = 16
_MOST_FIELDS = 4096


class RosField(NamedTuple):
    """One primitive member of a flattened message.

    Attributes:
        path: names from the message down to the member, joined by dots.
        code: type of an element as in ``struct``; ``s`` is a text.
        size: elements of a fixed array; 0 for a sequence, which holds its own length; ``None`` for a single value.
    """

    path: str
    code: str
    size: int | None


class MessageLayout(NamedTuple):
    """The members of a message in the order in which they are serialised."""

    fields: tuple[RosField, ...]

    def decode(self, data: bytes) -> dict[str, Any]:
        """Values of a message by the paths of its members; arrays are views of ``data``.

        Raises:
            ValueError: the bytes are not such a message.
        """
        cursor = _Cursor(data)
        try:
            return {path: cursor.member(code, size) for path, code, size in self.fields}
        except (struct.error, OverflowError) as error:
            raise ValueError(f"a message that ends too early ({error})") from None

    def encode(self, values: Mapping[str, Any]) -> bytes:
        """A little-endian message of these values; missing members are zero or empty.

        Raises:
            KeyError: a name is not a member.
            ValueError: a fixed array has another size.
        """
        unknown = set(values) - {field.path for field in self.fields}
        if unknown:
            raise KeyError(", ".join(sorted(unknown)))
        out = bytearray(b"\0\1\0\0")
        for path, code, size in self.fields:
            if code == "s":
                texts = [values.get(path, "")] if size is None else values.get(path, [])
                if size is not None:
                    _put(out, "I", len(texts))
                for text in texts:
                    _put(out, "I", len(text.encode()) + 1)
                    out += text.encode() + b"\0"
            elif size is None:
                _put(out, code, values.get(path, 0))
            else:
                array = np.asarray(values.get(path, np.zeros(size)), dtype=f"<{code}").reshape(-1)
                if size == 0:
                    _put(out, "I", array.size)
                elif array.size != size:
                    raise ValueError(f"{path}: expected {size} elements, found {array.size}")
                if array.size:
                    _align(out, array.itemsize)
                    out += array.tobytes()
        return bytes(out)


def layout_of(name: str, definition: str) -> MessageLayout:
    """Layout of a message from its definition with those of its nested messages, as in recordings.

    Args:
        name: package and name, such as ``sensor_msgs/msg/Imu``.
        definition: its own members, then each nested message after a line of equals signs and ``MSG: package/Name``.

    Raises:
        ValueError: the definition cannot be read, or uses unsupported features (arrays of messages, wide texts).
    """
    own, *nested = re.split(r"^={8,}[ \t\r]*$", definition, flags=re.MULTILINE)
    bodies = _KNOWN | {short_name(name): own}
    for part in nested:
        head, _, body = part.strip().partition("\n")
        if not head.startswith("MSG:"):
            raise ValueError(f"no name of a nested message in {head[:40]!r}")
        bodies[short_name(head[4:])] = body
    fields = tuple(islice(_fields(short_name(name), "", bodies, 0), _MOST_FIELDS + 1))
    if len(fields) > _MOST_FIELDS:
        raise ValueError("a definition without end")
    return MessageLayout(fields)


def short_name(name: str) -> str:
    """``package/Name`` of ``package/msg/Name``, which is equivalent."""
    parts = name.strip().split("/")
    return f"{parts[0]}/{parts[-1]}"


def _fields(name: str, prefix: str, bodies: Mapping[str, str], depth: int) -> Iterator[RosField]:
    if name not in bodies or depth > _MOST_NESTED:
        raise ValueError(f"no definition of {name}")
    empty = True
    for line in bodies[name].splitlines():
        code = line.partition("#")[0]
        words = code.split(None, 2)
        if not words:
            continue
        member = words[1].partition("=")[0] if len(words) > 1 else ""
        if "=" in code and member.isupper():
            continue  # a constant, which is not serialised
        found = _TYPE.fullmatch(words[0])
        if found is None or not member.isidentifier():
            raise ValueError(f"no member in {line.strip()[:60]!r}")
        base, bound, digits = found.groups()
        size = None if digits is None else 0 if bound or not digits else int(digits)
        empty = False
        if base in _CODES:
            yield RosField(prefix + member, _CODES[base], size)
        elif size is not None:
            raise ValueError(f"{member}: an array of messages")
        else:
            package = name.partition("/")[0] if base != "Header" else "std_msgs"
            nested = base if "/" in base else f"{package}/{base}"
            yield from _fields(short_name(nested), f"{prefix}{member}.", bodies, depth + 1)
    if empty:
        # IDL knows no empty structures: ROS 2 gives them this member.
        yield RosField(f"{prefix}structure_needs_at_least_one_member", "B", None)


class _Cursor:
    """A position in a serialised message; alignment counts from the end of its four-byte header."""

    def __init__(self, data: bytes) -> None:
        if len(data) < 4 or data[0] != 0 or data[1] > 1:
            raise ValueError("no message in plain CDR")
        self._data = data
        self._order = "<" if data[1] else ">"
        self._at = 4

    def member(self, code: str, size: int | None) -> Any:
        if size is None:
            return self._text() if code == "s" else self._number(code)
        count = size or self._number("I")
        if code == "s":
            return [self._text() for _ in range(count)]
        dtype = np.dtype(self._order + code)
        if count == 0:
            return np.zeros(0, dtype)
        self._at += -(self._at - 4) % dtype.itemsize
        array = np.frombuffer(self._data, dtype, count, self._at)
        self._at += array.nbytes
        return array

    def _number(self, code: str) -> Any:
        number = _NUMBERS[self._order + code]
        self._at += -(self._at - 4) % number.size
        (value,) = number.unpack_from(self._data, self._at)
        self._at += number.size
        return value

    def _text(self) -> str:
        length = self._number("I")
        text = self._data[self._at : self._at + length]
        if len(text) < length:
            raise ValueError("a text that ends too early")
        self._at += length
        return text.rstrip(b"\0").decode()


def _align(out: bytearray, size: int) -> None:
    out += bytes(-(len(out) - 4) % size)


def _put(out: bytearray, code: str, value: Any) -> None:
    number = _NUMBERS[f"<{code}"]
    _align(out, number.size)
    out += number.pack(value)


RADAR_SCAN = "lgprjax_msgs/msg/RadarScan"
RADAR_ARRAY = "lgprjax_msgs/msg/RadarArray"
FIX_QUALITY = "lgprjax_msgs/msg/FixQuality"
NAV_SAT_FIX = "sensor_msgs/msg/NavSatFix"
IMU = "sensor_msgs/msg/Imu"
POSE = "geometry_msgs/msg/PoseWithCovarianceStamped"
ODOMETRY = "nav_msgs/msg/Odometry"
TRANSFORMS = "tf2_msgs/msg/TFMessage"
IMAGE = "sensor_msgs/msg/Image"

TOPICS = {
    "scan": ("/gpr/scan", RADAR_SCAN),
    "array": ("/gpr/array", RADAR_ARRAY),
    "position": ("/gnss/fix", NAV_SAT_FIX),
    "attitude": ("/gnss/imu", IMU),
    "odometry": ("/odometry", ODOMETRY),
    "fix pose": ("/lgpr/pose", POSE),
    "fix position": ("/lgpr/fix", NAV_SAT_FIX),
    "fix quality": ("/lgpr/quality", FIX_QUALITY),
    "transform": ("/tf", TRANSFORMS),
    "mounting": ("/tf_static", TRANSFORMS),
    "radargram": ("/gpr/radargram", IMAGE),
}
"""Topic and type of each part of a drive, as written; when reading, the preferred topic among several."""

DRIVE_METADATA = "lgprjax.drive"
"""Name of an exported drive's metadata in the file: name, t0_utc, provenance."""
# Variances that mean "unknown" in a covariance with known entries: a right angle either way, as for the pitch, which a
# drive log lacks; and a thousand kilometres. Variances from these on are read as unknown.
UNKNOWN_RAD2, UNKNOWN_M2 = (np.pi / 2) ** 2, 1e12
COVARIANCE_UNKNOWN, COVARIANCE_KNOWN = 0, 3

_OWN = {
    RADAR_SCAN: """\
# One scan of a radar array.
std_msgs/Header header       # stamp: time of the first channel
uint32 channels              # number of channels, from left to right
uint32 samples               # samples of a trace, or frequencies of a sweep
string encoding              # type of data, little-endian: uint8, int16, int32, float32 (traces), complex64 (sweeps)
float64 sample_interval_ns   # two-way travel time between samples; sweeps: 0
float64 time_zero_ns         # delay of time zero after the first sample
float64 zero_level           # value of zero signal
uint8[] valid                # one per channel, 0: channel missing; empty: all channels valid
uint8[] data                 # channel after channel, sample after sample
uint8[] calibration          # sweep of the calibration channel, encoded like data; traces: empty
""",
    RADAR_ARRAY: """\
# Antenna positions of a radar array, and parameters for reading its scans.
std_msgs/Header header               # frame_id: the vehicle; origin at the rear axle, on the ground
float64[] x_m                        # forward position of each channel
float64[] y_m                        # leftward position of each channel, decreasing
float64[] time_offset_s              # delay of each channel after the stamp of its scan
float64 height_m                     # height of the array above the ground
float64 zero_slip_m                  # distance ahead of the rear axle: the point that moves along the body axis
float64 centre_frequency_hz          # 0: unknown
float64[] frequencies_hz             # frequencies of sweeps; traces: empty, like all fields below
float64 group_delay_ns               # delay of the calibration path
float32[] lookup_sweeps              # real, imaginary, per channel and frequency: array pointed at empty space
float32[] lookup_calibration_sweep   # real, imaginary, per frequency
float64[] channel_gain               # relative to the array's mean; empty: 1
float64[] channel_delay_ns           # relative to the array's mean; empty: 0
""",
    FIX_QUALITY: """\
# Quality of the match of one scan with the map. Only scans with code ok have a pose on the other topics.
std_msgs/Header header     # stamp: time of the scan
uint32 scan                # number in the drive
string code                # ok, low_correlation, ambiguous, edge, off_map, low_overlap, non_finite, no_window
float64 correlation
float64 margin             # correlation minus the runner-up's correlation
uint32 overlap_channels    # channels over the map at the fix
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
    TRANSFORMS: "geometry_msgs/TransformStamped[] transforms\n",
    IMAGE: """\
std_msgs/Header header
uint32 height
uint32 width
string encoding
uint8 is_bigendian
uint32 step
uint8[] data
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
    "geometry_msgs/Transform": "geometry_msgs/Vector3 translation\ngeometry_msgs/Quaternion rotation\n",
    "geometry_msgs/TransformStamped": """\
std_msgs/Header header
string child_frame_id
geometry_msgs/Transform transform
""",
}


def definition_of(name: str) -> str:
    """Definition of a message and, below it, those of its nested messages, as in recordings."""
    text = (_OWN | _STANDARD)[name]
    parts, names = [text], _nested_in(text)
    for nested in names:
        parts.append(f"{'=' * 80}\nMSG: {nested}\n{_NESTED[nested]}")
        names += [each for each in _nested_in(_NESTED[nested]) if each not in names]
    return "".join(parts)


def layout_to_write(name: str) -> MessageLayout:
    """Layout for writing a message; an array of messages is written with one element.

    In CDR such an array is its length, then its elements: here a member of the array's name and ``_count``, to be 1,
    and the members of the only element.
    """
    single = re.sub(r"^(\w+/\w+)\[\] (\w+)$", r"uint32 \2_count\n\1 \2", definition_of(name), flags=re.MULTILINE)
    return layout_of(name, single)


@lru_cache(maxsize=1024)
def is_kind(name: str, kind: str) -> bool:
    """Whether a type matches; messages of the radar may be in a package of any name."""
    if kind in _OWN:
        return name.rpartition("/")[2] == kind.rpartition("/")[2]
    return short_name(name) == short_name(kind)


def quaternion_of(yaw_rad: float, roll_rad: float) -> dict[str, float]:
    """Orientation without pitch: first the roll about x, then the yaw about z."""
    cos_yaw, sin_yaw = math.cos(0.5 * yaw_rad), math.sin(0.5 * yaw_rad)
    cos_roll, sin_roll = math.cos(0.5 * roll_rad), math.sin(0.5 * roll_rad)
    return {"x": cos_yaw * sin_roll, "y": sin_yaw * sin_roll, "z": sin_yaw * cos_roll, "w": cos_yaw * cos_roll}


def rotation_of(yaw_rad: float, roll_rad: float) -> Float[np.ndarray, "3 3"]:
    """Matrix of ``quaternion_of``: from the turned axes, forward, left and up, to those that are turned."""
    cos_yaw, sin_yaw, cos_roll, sin_roll = math.cos(yaw_rad), math.sin(yaw_rad), math.cos(roll_rad), math.sin(roll_rad)
    return np.array(
        [
            [cos_yaw, -sin_yaw * cos_roll, sin_yaw * sin_roll],
            [sin_yaw, cos_yaw * cos_roll, -cos_yaw * sin_roll],
            [0.0, sin_roll, cos_roll],
        ]
    )


def yaw_and_roll(x: float, y: float, z: float, w: float) -> tuple[float, float]:
    """Yaw and roll, radians, of an orientation; its pitch is ignored. NaN if invalid (length not about 1)."""
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
    reordered[4, 4] = UNKNOWN_RAD2
    return reordered


def _nested_in(text: str) -> list[str]:
    return list(dict.fromkeys(re.findall(r"^(\w+/\w+)(?:\[\])? ", text, re.MULTILINE)))
