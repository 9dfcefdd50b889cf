"""The devices' own end of the framed protocol, written from ``data_schema/wire.toml`` and from nothing else."""

import struct
import zlib
from collections import deque
from enum import Enum, IntEnum
from typing import NamedTuple

_HEADER = struct.Struct("<2sBBHBBIIQH")
_CRC = struct.Struct("<I")
_SYNC, _VERSION, _LARGEST_PAYLOAD = b"\xa5\x5a", 1, 8192
_SILENT_NS = 200_000_000
_SESSIONS_REMEMBERED = 16


class MessageType(IntEnum):
    """Types of messages."""

    RADAR_COMMAND = 0x10
    RADAR_SWEEP_PLAN = 0x11
    RADAR_SCAN = 0x12
    RADAR_HEALTH = 0x13
    RADAR_DESCRIPTION = 0x14
    DRIVE_COMMAND = 0x20
    DRIVE_STATUS = 0x21
    DRIVE_TEST = 0x22
    SKID_COMMAND = 0x24
    SKID_STATUS = 0x25
    CONTROLLER_STATUS = 0x30
    CONTROLLER_LIGHT = 0x31


_HOST_LENGTHS = {
    MessageType.RADAR_COMMAND: 5,
    MessageType.RADAR_SWEEP_PLAN: 10,
    MessageType.DRIVE_COMMAND: 13,
    MessageType.DRIVE_TEST: 1,
    MessageType.SKID_COMMAND: 14,
    MessageType.CONTROLLER_LIGHT: 1,
}


class DeviceFrame(NamedTuple):
    """A frame whose CRC holds; ``kind`` is a plain number where no message of the protocol has it."""

    kind: int
    mode: int
    session: int
    sequence: int
    stamp_us: int
    ttl_ms: int
    payload: bytes


def pack_frame(frame: DeviceFrame) -> bytes:
    """The bytes of a frame."""
    kind, mode, session, sequence, stamp_us, ttl_ms, payload = frame
    head = _HEADER.pack(_SYNC, _VERSION, kind, len(payload), mode, 0, session, sequence & 0xFFFFFFFF, stamp_us, ttl_ms)
    body = head[2:] + payload
    return _SYNC + body + _CRC.pack(zlib.crc32(body))


class FrameReader:
    """Finds the host's frames in a line's bytes."""

    def __init__(self) -> None:
        self._waiting = bytearray()

    def feed(self, data: bytes) -> list[DeviceFrame | None]:
        """Frames in the order they came; ``None`` stands for what looked like one and was not."""
        self._waiting += data
        found: list[DeviceFrame | None] = []
        held = self._waiting
        while True:
            at = held.find(_SYNC)
            if at < 0:
                # The last byte may be a sync's first.
                del held[: max(len(held) - 1, 0)]
                return found
            del held[:at]
            if len(held) < _HEADER.size:
                return found
            _, version, kind, length, mode, _, session, sequence, stamp_us, ttl_ms = _HEADER.unpack_from(held)
            end = _HEADER.size + length
            plausible = version == _VERSION and length <= _LARGEST_PAYLOAD and _HOST_LENGTHS.get(kind, length) == length
            if plausible and len(held) < end + _CRC.size:
                return found
            if plausible and _CRC.unpack_from(held, end)[0] == zlib.crc32(held[2:end]):
                payload = bytes(held[_HEADER.size : end])
                found.append(DeviceFrame(kind, mode, session, sequence, stamp_us, ttl_ms, payload))
                del held[: end + _CRC.size]
            else:
                found.append(None)
                del held[:1]


class Reception(Enum):
    """What a receiver makes of a whole frame."""

    TAKEN = "taken"
    SECOND_SENDER = "another sender while the line is alive"
    OLD_SESSION = "a session that was over"
    REPEATED = "a sequence number that is not new"
    TOO_OLD = "an age above its time to live"


class Acceptance:
    """The rules of session, sequence and age on one line.

    Attributes:
        taken_ns: when the last frame was accepted; ``None`` before the first.
        missing: sequence numbers that never came.
    """

    def __init__(self) -> None:
        self.taken_ns: int | None = None
        self.missing = 0
        self._session = 0
        self._sequence = 0
        self._least_us = 0
        self._seen: deque[int] = deque(maxlen=_SESSIONS_REMEMBERED)

    def silent(self, now_ns: int) -> bool:
        """Whether nothing was accepted for so long that the line counts as dead."""
        return self.taken_ns is None or now_ns - self.taken_ns >= _SILENT_NS

    def judge(self, frame: DeviceFrame, now_ns: int) -> Reception:
        """Whether to act on a frame that came at ``now_ns`` of the receiver's clock."""
        late_us = now_ns // 1000 - frame.stamp_us
        if frame.session != self._session or self.taken_ns is None:
            if not self.silent(now_ns):
                return Reception.SECOND_SENDER
            if frame.session in self._seen or frame.session == 0:
                return Reception.OLD_SESSION
            self._seen.append(frame.session)
            self._session, self._least_us = frame.session, late_us
        else:
            ahead = (frame.sequence - self._sequence) & 0xFFFFFFFF
            if not 0 < ahead < 1 << 31:
                return Reception.REPEATED
            self._least_us = min(self._least_us, late_us)
            if frame.ttl_ms and late_us - self._least_us > 1000 * frame.ttl_ms:
                return Reception.TOO_OLD
            self.missing += ahead - 1
        self._sequence, self.taken_ns = frame.sequence, now_ns
        return Reception.TAKEN


class DeviceSender:
    """Numbers and stamps a device's frames.

    Args:
        session: of this start.
        epoch_us: what the device's clock shows when the world's shows 0.
    """

    def __init__(self, session: int, epoch_us: int) -> None:
        self._session, self._epoch_us = session, epoch_us
        self._sequence = 0
        self.stuck = False
        """A fault: the counter repeats."""

    def frame(self, kind: MessageType, payload: bytes, stamp_ns: int, mode: int) -> bytes:
        """The next frame's bytes; ``stamp_ns`` is of the world's clock."""
        made = DeviceFrame(kind, mode, self._session, self._sequence, self._epoch_us + stamp_ns // 1000, 0, payload)
        if not self.stuck:
            self._sequence = (self._sequence + 1) & 0xFFFFFFFF
        return pack_frame(made)
