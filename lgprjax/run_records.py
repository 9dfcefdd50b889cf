"""Records exchanged by processes and kept by the recorder: a head of 16 bytes and a payload.

The layout of heads and payloads is that of ``data_schema/run_log.toml``.
"""

import struct
import tomllib
from enum import IntEnum, IntFlag
from functools import cache
from typing import Any, NamedTuple

import numpy as np

from lgprjax.files import schema_text
from lgprjax.wire import CODES

_TABLE = tomllib.loads(schema_text("run_log"))
_HEAD = struct.Struct("<" + "".join(CODES[field["type"]] for field in _TABLE["data"]["head"]))


class RecordKind(IntEnum):
    """Kind of a record's payload."""

    HEADER = 1
    """JSON: everything that a replay needs, the first record of a process."""
    PORT_IN = 2
    """A complete message as received over a line: a frame, or a NMEA or UBX message. The control loop's carry the tick
    in which they were used.
    """
    PORT_OUT = 3
    """A sent frame."""
    REFUSED = 4
    """Bytes received over a line and refused: u8 reason, then the bytes."""
    TICK = 5
    """Begin of a tick of the control loop; mono_ns is its time."""
    FIX = 6
    """``FIX``: a scan that was searched."""
    PRIOR = 7
    """``PRIOR``: where GNSS/INS have the vehicle."""
    EVENT = 8
    """JSON: events of modes, faults, processes."""
    STATE = 9
    """JSON: state for the display."""
    MONITOR = 10
    """JSON: memory, storage, temperatures."""
    REQUEST = 11
    """JSON: a request from the display."""
    PLAN = 12
    """``PLAN``: decision of a tick."""
    COVER = 13
    """``COVER``: ten times per second, pose of a skid-steer vehicle and state of its tool."""
    SKID_PLAN = 14
    """``SKID_PLAN``: decision of a skid-steer vehicle's tick."""
    WORKED = 15
    """JSON: the worked map of the field, for the display."""
    CORNER = 16
    """JSON: a corner of a field that the operator marked."""
    POSE = 17
    """``POSE``: the corrected position for output; not recorded."""
    SEARCHED = 18
    """``SEARCHED``: what the search of a scan was given."""


class Source(IntEnum):
    """Source of a record: a line, or a process."""

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
        kind, source: of the record.
        tick: of the control loop; 0 without one.
        mono_ns: monotonic clock of the computer: for PORT_IN the arrival.
        payload: by its kind.
    """

    kind: RecordKind
    source: Source
    tick: int
    mono_ns: int
    payload: bytes


@cache
def payload_type(name: str) -> np.dtype[Any]:
    """Payload of a record of fixed layout: ``fix``, ``searched``, ``prior``, ``plan`` and others. ``KeyError`` else."""
    for payload in _TABLE["payload"]:
        if payload["name"] == name:
            return np.dtype([_field(**field) for field in payload["fields"]])
    raise KeyError(name)


def numpy_type(kind: str) -> str:
    """A type of ``data_schema`` as NumPy has it: ``u16`` is ``<u2``."""
    return f"<{kind[0]}{int(kind[1:]) // 8}"


def _field(name: str, type: str, **described: str) -> tuple[str, str, tuple[int, ...]]:
    del described
    kind, _, shape = type.rstrip("]").partition("[")
    return name, numpy_type(kind), tuple(int(size) for size in shape.split(",")) if shape else ()


FIX, PRIOR, PLAN, COVER, SKID_PLAN, POSE, SEARCHED = (
    payload_type(name) for name in ("fix", "prior", "plan", "cover", "skid_plan", "pose", "searched")
)
_P_FALSE_BYTES = FIX["p_false"].itemsize


LONGEST_COVER_STEP_NS = 150_000_000
"""Rows ``COVER`` come each tenth of a second. If one is missing, the operation of the tool is unknown."""


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
    """A row of ``FIX``; ``p_false`` is NaN (unknown) in a run of layout 1.1 or older, which lacks it.

    Raises:
        ValueError: not a fix of either layout.
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
        ValueError: it is shorter than its head, or of an unknown kind or source.
    """
    if len(data) < _HEAD.size:
        raise ValueError(f"a record of {_HEAD.size} bytes or more was expected, found {len(data)}")
    kind, source, _, tick, mono_ns = _HEAD.unpack_from(data)
    return Record(RecordKind(kind), Source(source), tick, mono_ns, data[_HEAD.size :])
