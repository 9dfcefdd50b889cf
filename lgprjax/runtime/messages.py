"""Records that processes exchange and the recorder keeps: a head of 16 bytes and a payload."""

import struct
from enum import IntEnum, IntFlag
from typing import NamedTuple

import numpy as np

_HEAD = struct.Struct("<BBHIQ")


class RecordKind(IntEnum):
    """What a record's payload is."""

    HEADER = 1
    """JSON: everything that a replay needs, the first record of a process."""
    PORT_IN = 2
    """A whole message as it came over a line: a frame, or a NMEA or UBX message. The control loop's carry the tick in
    which they were used."""
    PORT_OUT = 3
    """A frame as it was sent."""
    REFUSED = 4
    """Bytes that came over a line and were refused: u8 reason, then the bytes."""
    TICK = 5
    """Begin of a tick of the control loop; mono_ns is its time."""
    FIX = 6
    """``FIX``: a scan that was searched."""
    PRIOR = 7
    """``PRIOR``: where GNSS/INS have the vehicle."""
    EVENT = 8
    """JSON: something happened: modes, faults, processes."""
    STATE = 9
    """JSON: what the display shows."""
    MONITOR = 10
    """JSON: memory, storage, temperatures."""
    REQUEST = 11
    """JSON: what somebody asked for on the display."""
    PLAN = 12
    """``PLAN``: what a tick decided."""
    COVER = 13
    """``COVER``: ten times a second, where a skid-steer vehicle is and what its tool does."""
    SKID_PLAN = 14
    """``SKID_PLAN``: what a tick of a skid-steer vehicle decided."""
    WORKED = 15
    """JSON: what of the field is worked, for the display."""
    CORNER = 16
    """JSON: a corner of a field that the operator marked."""


class Source(IntEnum):
    """Where a record comes from: a line, or a process."""

    DRIVE_BY_WIRE = 1
    CONTROLLER = 2
    GNSS = 3
    RADAR = 4
    CONTROL = 10
    REGISTRATION = 11
    RECORDER = 12
    DISPLAY = 13
    MONITOR = 14
    SUPERVISOR = 15
    COVERAGE = 16


class Record(NamedTuple):
    """A record.

    Attributes:
        kind, source: what and whence.
        tick: of the control loop; 0 where none belongs to it.
        mono_ns: monotonic clock of the computer: for PORT_IN the arrival.
        payload: by its kind.
    """

    kind: RecordKind
    source: Source
    tick: int
    mono_ns: int
    payload: bytes


FIX = np.dtype(
    [
        ("scan_ns", "<i8"),  # monotonic time of the scan
        ("scan", "<u4"),
        ("code", "<u1"),
        ("window_dm", "<i1"),  # decimetres of scans that were matched as one; -1 where nothing was matched
        ("waiting", "<u2"),  # scans that were waiting when this one was taken
        ("correlation", "<f4"),
        ("margin", "<f4"),
        ("strength", "<f4"),  # correlation times the root of the overlap
        ("overlap_channels", "<f4"),
        ("pose", "<f8", 5),  # east_m, north_m, height_m, yaw_rad, roll_rad of the array's centre, map frame
        ("covariance", "<f8", (5, 5)),
        ("p_false", "<f4"),  # probability that ground which is not the map's would have passed the same search
    ]
)
_P_FALSE_BYTES = FIX["p_false"].itemsize
PRIOR = np.dtype(
    [
        ("time_ns", "<i8"),  # monotonic time that it holds for
        ("valid", "<u1"),
        ("pose", "<f8", 3),  # x_m, y_m, yaw_rad of the rear axle in the map frame, by GNSS/INS and odometry
        ("roll_rad", "<f8"),
        ("sigma_yaw_rad", "<f8"),
        ("speed_mps", "<f8"),
        ("yaw_rate_radps", "<f8"),
        ("travel_m", "<f8"),  # signed, by odometry
    ]
)
PLAN = np.dtype(
    [
        ("mode", "<u1"),
        ("reaction", "<u1"),
        ("code", "<u1"),  # of the plan
        ("reasons", "<u4"),
        ("limited", "<u4"),
        ("pose", "<f8", 3),  # x_m, y_m, yaw_rad of the rear axle in the map frame, as driven by
        ("sigma_cross_m", "<f4"),
        ("speed_mps", "<f4"),
        ("wanted_mps", "<f4"),
        ("cross_track_m", "<f4"),
        ("to_go_m", "<f4"),
        ("front_rad", "<f4"),  # measured
        ("command", "<f4", 3),  # front_rad, throttle, brake
        ("engage", "<u1"),
        ("watch", "<u4"),  # findings of the watches
        ("severity", "<u1"),
    ]
)
COVER = np.dtype(
    [
        ("x_m", "<f8"),
        ("y_m", "<f8"),
        ("yaw_rad", "<f8"),
        ("covariance", "<f4", (3, 3)),
        ("speed_mps", "<f4"),
        ("left_mps", "<f4"),
        ("right_mps", "<f4"),
        ("tool", "<u1"),  # ToolBits
        ("depth_m", "<f4"),
        ("mode", "<u1"),
        ("line", "<i4"),
        ("stop", "<u2"),  # StopBits
        ("gnss_quality", "<u1"),
    ]
)
SKID_PLAN = np.dtype(
    [
        ("mode", "<u1"),
        ("reaction", "<u1"),
        ("known", "<u1"),
        ("reasons", "<u4"),
        ("limited", "<u4"),
        ("pose", "<f8", 3),
        ("sigma", "<f4", 3),
        ("speed_mps", "<f4"),
        ("cross_m", "<f4"),
        ("heading_error_rad", "<f4"),
        ("to_go_m", "<f4"),
        ("line", "<i4"),
        ("command", "<f4", 2),
        ("tool", "<u1"),
        ("depth_m", "<f4"),
        ("engage", "<u1"),
        ("watch", "<u4"),
        ("found", "<u4"),
        ("severity", "<u1"),
    ]
)


class ToolBits(IntFlag):
    """``COVER.tool``."""

    TOLD_ON = 1
    TURNS = 2
    DEPTH_RIGHT = 4
    COUNTS = 8


class StopBits(IntFlag):
    """``COVER.stop``: why the vehicle stops or is not driven."""

    OPERATOR = 1
    EDGE = 2
    TOOL = 4
    POSITION = 8
    HEADING = 16
    WHEELS = 32
    BOX = 64
    COMPUTER = 128
    RECORDING = 256
    OFF_LINE = 512


def fix_row(payload: bytes) -> np.void:
    """A row of ``FIX``; ``p_false`` is NaN, not known, where a run of layout 1.1 or older ends before it.

    Raises:
        ValueError: no fix of either layout.
    """
    if len(payload) == FIX.itemsize - _P_FALSE_BYTES:
        payload += np.float32(np.nan).tobytes()
    row: np.void = np.frombuffer(payload, FIX)[0]
    return row


def pack(record: Record) -> bytes:
    """A record as bytes."""
    return _HEAD.pack(record.kind, record.source, 0, record.tick & 0xFFFFFFFF, record.mono_ns) + record.payload


def unpack(data: bytes) -> Record:
    """A record from bytes.

    Raises:
        ValueError: it is shorter than its head, or of a kind or source that there is not.
    """
    if len(data) < _HEAD.size:
        raise ValueError(f"a record of {_HEAD.size} bytes or more was expected, found {len(data)}")
    kind, source, _, tick, mono_ns = _HEAD.unpack_from(data)
    return Record(RecordKind(kind), Source(source), tick, mono_ns, data[_HEAD.size :])
