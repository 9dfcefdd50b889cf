"""Frames between the onboard computer and its devices, as ``data_schema/wire.toml`` lays them out."""

import math
import struct
import zlib
from collections import Counter
from collections.abc import Mapping
from typing import NamedTuple

from lgprjax.runtime.refused import KEPT, Reason, Refused
from lgprjax.runtime.wire_messages import (
    CODES,
    CRC,
    HEAD,
    HEAD_FIELDS,
    LARGEST_PAYLOAD,
    MESSAGE_OF_TYPE,
    MESSAGES,
    SYNC,
    VERSION,
    Field,
)

Value = int | float | bytes


class Frame(NamedTuple):
    """A whole frame whose CRC holds.

    Attributes:
        name: of the message.
        mode, flags, session, sequence, stamp_us, ttl_ms: the header's.
        fields: of the payload.
        raw: the frame as it came.
    """

    name: str
    mode: int
    flags: int
    session: int
    sequence: int
    stamp_us: int
    ttl_ms: int
    fields: dict[str, Value]
    raw: bytes

    def number(self, name: str) -> float:
        """A field that is a number."""
        value = self.fields[name]
        if isinstance(value, bytes):
            raise TypeError(f"{self.name}.{name}: no number")
        return float(value)


def encode(
    name: str, fields: Mapping[str, Value], *, mode: int, session: int, sequence: int, stamp_us: int, ttl_ms: int
) -> bytes:
    """A frame of the message ``name``.

    Raises:
        ValueError: a field is missing, unknown, out of the range of its type, or no finite number.
    """
    message = MESSAGES.get(name)
    if message is None:
        raise ValueError(f"{name}: no such message")
    known = {field.name for field in message.numbers} | ({message.bulk} if message.bulk else set())
    if odd := known ^ fields.keys():
        raise ValueError(f"{name}.{min(odd)}: {'missing' if min(odd) in known else 'no such field'}")
    payload = b"".join(_packed(name, field, fields[field.name]) for field in message.numbers)
    if message.bulk:
        bulk = fields[message.bulk]
        expected = math.prod(int(fields[axis]) for axis in message.axes)
        if not isinstance(bulk, bytes) or len(bulk) != expected:
            raise ValueError(f"{name}.{message.bulk}: {expected} bytes expected")
        payload += bulk
    if len(payload) > LARGEST_PAYLOAD:
        raise ValueError(f"{name}: a payload of {len(payload)} bytes, {LARGEST_PAYLOAD} allowed")
    if session == 0:
        raise ValueError("header.session: 0")
    values = (VERSION, message.type, len(payload), mode, 0, session, sequence, stamp_us, ttl_ms)
    head = b"".join(_packed("header", field, value) for field, value in zip(HEAD_FIELDS, values, strict=True))
    return SYNC + head + payload + CRC.pack(zlib.crc32(head + payload))


def decode(raw: bytes) -> Frame:
    """The frame that ``raw`` is.

    Raises:
        ValueError: it is not one whole frame, its CRC does not hold, or its message is not known.
    """
    found = FrameParser().feed(raw)
    if len(found) == 1 and isinstance(found[0], Frame) and len(found[0].raw) == len(raw):
        return found[0]
    raise ValueError(f"not one whole frame: {raw[:KEPT].hex()}")


class FrameParser:
    """Cuts frames out of a stream of bytes. It holds back one frame at most.

    Attributes:
        counts: how often something was refused, by reason.
    """

    def __init__(self) -> None:
        self._buffer = bytearray()
        self.counts: Counter[Reason] = Counter()

    def feed(self, data: bytes) -> list[Frame | Refused]:
        """Frames that are whole now, and what was refused, in the order of the stream."""
        buffer = self._buffer
        buffer += data
        found: list[Frame | Refused] = []
        at = 0
        while at < len(buffer):
            wrong = _wrong_head(buffer, at)
            size = 0
            if wrong is None:
                if len(buffer) - at < HEAD.size:
                    break
                size = _size(buffer, at)
                if len(buffer) - at < size:
                    break
                if not _crc_holds(memoryview(buffer)[at : at + size]):
                    wrong = Reason.CRC
            if wrong is None:
                item = _opened(bytes(buffer[at : at + size]))
                end = at + size
            else:
                # The rest of what went wrong is told with it, up to where the next frame may begin.
                end = _next_sync(buffer, at + 1)
                item = Refused(wrong, bytes(buffer[at : min(end, at + KEPT)]))
            if isinstance(item, Refused):
                self.counts[Reason(item.reason)] += 1
            found.append(item)
            at = end
        del buffer[:at]
        return found


def _packed(message: str, field: Field, value: Value) -> bytes:
    try:
        if field.kind.startswith("f") and not math.isfinite(value):  # type: ignore[arg-type]
            raise ValueError(f"{message}.{field.name}: {value!r}")
        return struct.pack("<" + CODES[field.kind], value)
    except (struct.error, OverflowError, TypeError):
        raise ValueError(f"{message}.{field.name}: {value!r} is no {field.kind}") from None


def _next_sync(buffer: bytearray, start: int) -> int:
    at = buffer.find(SYNC, start)
    if at >= 0:
        return at
    half = len(buffer) - 1
    return half if half >= start and buffer[half] == SYNC[0] else len(buffer)


def _size(buffer: bytearray, at: int) -> int:
    length: int = HEAD.unpack_from(buffer, at)[3]
    return HEAD.size + length + CRC.size


def _wrong_head(buffer: bytearray, at: int) -> Reason | None:
    """What is wrong with the head that begins at ``at``, as far as it has come."""
    if not buffer.startswith(SYNC[: len(buffer) - at], at):
        return Reason.NO_SYNC
    if len(buffer) - at < HEAD.size:
        return None
    _, version, kind, length, *_ = HEAD.unpack_from(buffer, at)
    if version != VERSION:
        return Reason.VERSION
    message = MESSAGE_OF_TYPE.get(kind)
    # A length that cannot be is told from the head: a flipped bit must not hold back what follows.
    fits = message is None or length == message.layout.size or (message.bulk and length >= message.layout.size)
    return None if length <= LARGEST_PAYLOAD and fits else Reason.LENGTH


def _crc_holds(frame: memoryview) -> bool:
    expected: int = CRC.unpack(frame[-CRC.size :])[0]
    holds = zlib.crc32(frame[len(SYNC) : -CRC.size]) == expected
    frame.release()
    return holds


def _opened(raw: bytes) -> Frame | Refused:
    _, _, kind, _, mode, flags, session, sequence, stamp_us, ttl_ms = HEAD.unpack_from(raw)
    message = MESSAGE_OF_TYPE.get(kind)
    if message is None:
        return Refused(Reason.TYPE, raw[:KEPT])
    numbers = message.layout.unpack_from(raw, HEAD.size)
    fields: dict[str, Value] = {field.name: value for field, value in zip(message.numbers, numbers, strict=True)}
    if message.bulk:
        bulk = raw[HEAD.size + message.layout.size : -CRC.size]
        if len(bulk) != math.prod(int(fields[axis]) for axis in message.axes):
            return Refused(Reason.PAYLOAD, raw[:KEPT])
        fields[message.bulk] = bulk
    return Frame(message.name, mode, flags, session, sequence, stamp_us, ttl_ms, fields, raw)
