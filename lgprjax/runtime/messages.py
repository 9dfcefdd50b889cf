"""Records that processes exchange and the recorder keeps, with a head of 16 bytes; time stamps of two clocks."""

import math
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


# Stamps of a device's clock as monotonic times of this computer.

_DRIFT = 5000
"""Clocks run apart by one part in this at most: 200 ppm."""
_NEAR_NS = 50_000_000
"""Differences between arrival and stamp that lie within this are one clock's. Less than the least one by more than
this: a stamp from the future."""
_ENOUGH = 5
_ENOUGH_NS = 100_000_000
"""So many samples in a row, over so long, establish a clock that was set."""


class LeastDelay:
    """Least difference between arrivals and stamps: what lies between two clocks when nothing holds a message up.

    It falls at once and rises no faster than clocks drift, so that a line that grows late shows.

    Args:
        difference_ns: arrival less stamp of the first message.
        now_ns: its arrival.
    """

    def __init__(self, difference_ns: int, now_ns: int) -> None:
        self._least_ns = difference_ns
        self._at_ns = now_ns

    def at(self, now_ns: int) -> int:
        """What it is believed to be now, ns."""
        return self._least_ns + max(0, now_ns - self._at_ns) // _DRIFT

    def feed(self, difference_ns: int, now_ns: int) -> int:
        """What it is believed to be now that one more message came, ns: never above that message's own."""
        self._least_ns = min(self.at(now_ns), difference_ns)
        self._at_ns = max(now_ns, self._at_ns)
        return self._least_ns


class _Run(NamedTuple):
    """Rejected stamps in a row that agree with each other: of a clock that may have been set."""

    difference_ns: int
    least_ns: int
    since_ns: int
    last_stamp_ns: int
    samples: int


class StampClock:
    """Times of one kind of sample, told by the device's stamps and never later than their arrival.

    A stamp is rejected when it does not grow, when it is from the future, or when it came more than ``late_s`` late. A
    clock that was set, forward or back, is believed once enough samples in a row agree. A line that holds its messages
    up looks different, as its stamps go on growing, and is never taken for a clock that was set.

    Args:
        delay_s: from what a sample tells of to its arrival, at the fastest.
        late_s: how much later than the fastest a sample may come.

    Attributes:
        rejected: samples so far.
        settings: how often the clock was set.
    """

    def __init__(self, delay_s: float = 0.0, late_s: float = 0.2) -> None:
        self._delay_ns = round(delay_s * 1e9)
        self._late_ns = round(late_s * 1e9)
        self._least: LeastDelay | None = None
        self._run: _Run | None = None
        self._last_stamp_ns = 0
        self._last_told_ns: int | None = None
        self.rejected = 0
        self.settings = 0

    def feed(self, stamp_us: int, arrival_ns: int) -> int | None:
        """Monotonic time, ns, of the sample stamped ``stamp_us``; ``None`` where it is rejected.

        Times grow from sample to sample and are never later than ``arrival_ns``, which must not fall.
        """
        told = self._time_of(stamp_us * 1000, arrival_ns)
        if told is None or (self._last_told_ns is not None and told <= self._last_told_ns):
            self.rejected += 1
            return None
        self._last_told_ns = told
        return told

    def expected_us(self, arrival_ns: int) -> int | None:
        """Stamp, us, of a sample that comes now and was not held up; ``None`` before the first."""
        return None if self._least is None else (arrival_ns - self._least.at(arrival_ns)) // 1000

    def _time_of(self, stamp_ns: int, arrival_ns: int) -> int | None:
        difference = arrival_ns - stamp_ns
        if self._least is None:
            self._least = LeastDelay(difference, arrival_ns)
        elif not self._believed(stamp_ns, difference, self._least.at(arrival_ns)):
            run = self._run
            if run is None or run.samples < _ENOUGH or arrival_ns - run.since_ns < _ENOUGH_NS:
                return None
            self._least = LeastDelay(run.least_ns, arrival_ns)
            self.settings += 1
        self._run = None
        self._last_stamp_ns = stamp_ns
        return stamp_ns + self._least.feed(difference, arrival_ns) - self._delay_ns

    def _believed(self, stamp_ns: int, difference_ns: int, least_ns: int) -> bool:
        """Whether the sample is one of the clock as it is; else it is noted, should the clock have been set."""
        late = difference_ns - least_ns
        grows = stamp_ns > self._last_stamp_ns
        run = self._run
        goes_on = (
            run is not None
            and stamp_ns > run.last_stamp_ns
            and abs(difference_ns - run.difference_ns) <= _NEAR_NS  # of the run's first
        )
        # Stamps that grow again after having gone back look late, and are the set clock's.
        if grows and -_NEAR_NS <= late <= self._late_ns and (late <= _NEAR_NS or not goes_on):
            return True
        if run is not None and goes_on:
            self._run = run._replace(
                least_ns=min(run.least_ns, difference_ns), last_stamp_ns=stamp_ns, samples=run.samples + 1
            )
        elif not grows or late < -_NEAR_NS:
            self._run = _Run(difference_ns, difference_ns, stamp_ns + difference_ns, stamp_ns, 1)
        else:
            self._run = None
        return False


class GnssTimeScale(IntEnum):
    """Seconds after which a GNSS time begins anew; ``NONE`` where a message carries no time."""

    NONE = 0
    UTC_DAY = 86_400
    GPS_WEEK = 604_800


class WeekClock:
    """A ``StampClock`` for times of week or of day: they begin anew, and leap seconds set the day's back.

    Args:
        scale: of the times; not ``NONE``.
        delay_s, late_s: the ``StampClock``'s.

    Attributes:
        clock: the ``StampClock``.
    """

    def __init__(self, scale: GnssTimeScale, delay_s: float = 0.0, late_s: float = 0.2) -> None:
        self.clock = StampClock(delay_s, late_s)
        self._period_us = scale * 1_000_000
        # The last minute of a day may have 61 seconds.
        self._end_s = scale + (scale is GnssTimeScale.UTC_DAY)

    def feed(self, time_s: float, arrival_ns: int) -> int | None:
        """Monotonic time, ns, of the sample of ``time_s`` seconds of the week or day; ``None`` where it is rejected."""
        if not (math.isfinite(time_s) and 0.0 <= time_s < self._end_s):
            self.clock.rejected += 1
            return None
        stamp_us = round(time_s * 1e6)
        expected_us = self.clock.expected_us(arrival_ns)
        if expected_us is not None:
            stamp_us += (expected_us - stamp_us + self._period_us // 2) // self._period_us * self._period_us
        return self.clock.feed(stamp_us, arrival_ns)
