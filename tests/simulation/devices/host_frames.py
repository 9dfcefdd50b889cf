"""A host made by hand: frames put together and taken apart with struct and zlib alone."""

import struct
import zlib
from typing import NamedTuple

MS = 1_000_000
HEADER = "<2sBBHBBIIQH"
STATUS = "<IBHHfiffBffdf"


class Told(NamedTuple):
    """A device's frame."""

    kind: int
    mode: int
    session: int
    sequence: int
    stamp_us: int
    payload: bytes


class Status(NamedTuple):
    """A ``drive_status``."""

    command_sequence: int
    engaged: int
    state: int
    refused: int
    potentiometer_v: float
    encoder_counts: int
    supply_v: float
    torque_nm: float
    pedals: int
    throttle: float
    brake: float
    odometer_m: float
    speed_mps: float


def host_frame(
    kind: int,
    payload: bytes,
    sequence: int,
    now_ns: int,
    *,
    mode: int = 2,
    session: int = 77,
    ttl_ms: int = 200,
) -> bytes:
    """A frame of the host, stamped with its clock, which is 5 s ahead."""
    stamp_us = now_ns // 1000 + 5_000_000
    head = struct.pack("<BBHBBIIQH", 1, kind, len(payload), mode, 0, session, sequence, stamp_us, ttl_ms)
    return b"\xa5\x5a" + head + payload + struct.pack("<I", zlib.crc32(head + payload))


def drive_command(
    sequence: int,
    now_ns: int,
    engage: int,
    *,
    front_rad: float = 0.1,
    throttle: float = 0.2,
    brake: float = 0.0,
    mode: int = 2,
    session: int = 77,
) -> bytes:
    """A ``drive_command``."""
    payload = struct.pack("<fffB", front_rad, throttle, brake, engage)
    return host_frame(0x20, payload, sequence, now_ns, mode=mode, session=session)


def read_frame(data: bytes) -> Told:
    """The one frame that these bytes are, its CRC held against zlib's."""
    sync, version, kind, length, mode, flags, session, sequence, stamp_us, _ = struct.unpack_from(HEADER, data)
    assert (sync, version, flags) == (b"\xa5\x5a", 1, 0)
    assert len(data) == 26 + length + 4
    assert struct.unpack_from("<I", data, 26 + length)[0] == zlib.crc32(data[2 : 26 + length])
    return Told(kind, mode, session, sequence, stamp_us, data[26 : 26 + length])


def read_status(data: bytes) -> Status:
    """The ``drive_status`` that these bytes are."""
    told = read_frame(data)
    assert told.kind == 0x21
    return Status(*struct.unpack(STATUS, told.payload))
