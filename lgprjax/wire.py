"""The wire protocol: building, extracting, parsing and checking frames; one end of a link and its numbering."""

import math
import secrets
import struct
import tomllib
import zlib
from collections import Counter, deque
from collections.abc import Mapping
from enum import IntEnum
from typing import Any, NamedTuple

from lgprjax.files import schema_text

# The messages of the lines, from ``data_schema/wire.toml``.

CODES = {"u8": "B", "u16": "H", "u32": "I", "u64": "Q", "i32": "i", "f32": "f", "f64": "d"}
"""Types of the description as ``struct`` codes."""


class MessageField(NamedTuple):
    """A number of a message: its name and its type in the description."""

    name: str
    kind: str


class Message(NamedTuple):
    """A kind of frame.

    Attributes:
        type: number in the header.
        sender: ``host`` or ``device``.
        line: line of the message.
        numbers: fields in their order.
        layout: binary layout of the numbers.
        bulk: name of the bytes after them, ``""`` without any.
        axes: fields whose product is the length of ``bulk``.
    """

    type: int
    name: str
    sender: str
    line: str
    numbers: tuple[MessageField, ...]
    layout: struct.Struct
    bulk: str
    axes: tuple[str, ...]


def _message(table: dict[str, Any]) -> Message:
    numbers, bulk, axes = [], "", ()
    for field in table["fields"]:
        if "[" in field["type"]:
            bulk, axes = field["name"], tuple(field["type"][len("u8[") : -1].split("*"))
        else:
            numbers.append(MessageField(field["name"], field["type"]))
    layout = struct.Struct("<" + "".join(CODES[field.kind] for field in numbers))
    return Message(
        type=table["type"],
        name=table["name"],
        sender=table["from"],
        line=table["line"],
        numbers=tuple(numbers),
        layout=layout,
        bulk=bulk,
        axes=axes,
    )


_TABLE = tomllib.loads(schema_text("wire"))
RULES: dict[str, int] = _TABLE["rules"]
"""Rules of a receiver."""
MESSAGES: dict[str, Message] = {table["name"]: _message(table) for table in _TABLE["message"]}
"""Every message by its name."""
MESSAGE_OF_TYPE = {message.type: message for message in MESSAGES.values()}
"""The same by the number in the header."""
SYNC = bytes(_TABLE["frame"]["sync"])
VERSION: int = _TABLE["frame"]["version"]
LARGEST_PAYLOAD: int = _TABLE["frame"]["largest_payload"]
HEAD_FIELDS = tuple(MessageField(field["name"], field["type"]) for field in _TABLE["frame"]["header"][1:])
"""Layout of the header after the sync."""
HEAD = struct.Struct(f"<{len(SYNC)}s" + "".join(CODES[field.kind] for field in HEAD_FIELDS))
CRC = struct.Struct("<I")


# Bytes received over a line that are refused, and the reason.

KEPT = 64
"""Number of refused bytes that are kept."""


class RefusalReason(IntEnum):
    """Reasons why bytes are not a message. ``FrameVerdict`` continues from 32 with reasons to refuse a whole frame."""

    NO_SYNC = 1
    """No message begins here."""
    VERSION = 2
    """Of an unknown protocol."""
    LENGTH = 3
    """Longer than allowed, or of the wrong length for the message."""
    CRC = 4
    """The CRC or checksum is not that of the bytes."""
    TYPE = 5
    """A complete frame with an unknown message."""
    PAYLOAD = 6
    """A complete frame with an inconsistent payload."""
    CUT = 7
    """A truncated sentence, or one without a checksum."""


class RefusedBytes(NamedTuple):
    """Refused bytes.

    Attributes:
        reason: ``RefusalReason`` or ``FrameVerdict``.
        data: the first ``KEPT`` bytes.
    """

    reason: int
    data: bytes


# Frames between the onboard computer and its devices, by ``data_schema/wire.toml``.

Value = int | float | bytes


class Frame(NamedTuple):
    """A complete frame with a valid CRC.

    Attributes:
        name: name of the message.
        mode, flags, session, sequence, stamp_us, ttl_ms: fields of the header.
        fields: fields of the payload.
        raw: received bytes of the frame.
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
    """Encode a frame of the message ``name``.

    Raises:
        ValueError: a field is missing, unknown, out of the range of its type, or not finite.
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
    """Decode ``raw`` as one frame.

    Raises:
        ValueError: it is not one complete frame, its CRC is wrong, or its message is unknown.
    """
    whole = len(raw) >= HEAD.size and _wrong_head(raw, 0) is None and len(raw) == _size(raw, 0)
    if whole and _crc_holds(memoryview(raw)):
        found = _opened(raw)
        if isinstance(found, Frame):
            return found
    raise ValueError(f"not one complete frame: {raw[:KEPT].hex()}")


class FrameParser:
    """Extracts frames from a stream of bytes. It buffers one frame at most.

    Attributes:
        counts: number of refusals, by reason.
    """

    def __init__(self) -> None:
        self._buffer = bytearray()
        self.counts: Counter[RefusalReason] = Counter()

    def feed(self, data: bytes) -> list[Frame | RefusedBytes]:
        """Complete frames, and refused bytes, in the order of the stream."""
        buffer = self._buffer
        buffer += data
        found: list[Frame | RefusedBytes] = []
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
                    wrong = RefusalReason.CRC
            if wrong is None:
                item = _opened(bytes(buffer[at : at + size]))
                end = at + size
            else:
                # The rest of the refused bytes is included, up to the next possible start of a frame.
                end = _next_sync(buffer, at + 1)
                item = RefusedBytes(wrong, bytes(buffer[at : min(end, at + KEPT)]))
            if isinstance(item, RefusedBytes):
                self.counts[RefusalReason(item.reason)] += 1
            found.append(item)
            at = end
        del buffer[:at]
        return found


def _packed(message: str, field: MessageField, value: Value) -> bytes:
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


def _size(buffer: bytes | bytearray, at: int) -> int:
    length: int = HEAD.unpack_from(buffer, at)[3]
    return HEAD.size + length + CRC.size


def _wrong_head(buffer: bytes | bytearray, at: int) -> RefusalReason | None:
    """Error of the header that begins at ``at``, as far as received."""
    if not buffer.startswith(SYNC[: len(buffer) - at], at):
        return RefusalReason.NO_SYNC
    if len(buffer) - at < HEAD.size:
        return None
    _, version, kind, length, *_ = HEAD.unpack_from(buffer, at)
    if version != VERSION:
        return RefusalReason.VERSION
    message = MESSAGE_OF_TYPE.get(kind)
    # An impossible length is detected in the header: a flipped bit must not delay later frames.
    fits = message is None or length == message.layout.size or (message.bulk and length >= message.layout.size)
    return None if length <= LARGEST_PAYLOAD and fits else RefusalReason.LENGTH


def _crc_holds(frame: memoryview) -> bool:
    expected: int = CRC.unpack(frame[-CRC.size :])[0]
    holds = zlib.crc32(frame[len(SYNC) : -CRC.size]) == expected
    frame.release()
    return holds


def _opened(raw: bytes) -> Frame | RefusedBytes:
    _, _, kind, _, mode, flags, session, sequence, stamp_us, ttl_ms = HEAD.unpack_from(raw)
    message = MESSAGE_OF_TYPE.get(kind)
    if message is None:
        return RefusedBytes(RefusalReason.TYPE, raw[:KEPT])
    numbers = message.layout.unpack_from(raw, HEAD.size)
    fields: dict[str, Value] = {field.name: value for field, value in zip(message.numbers, numbers, strict=True)}
    if message.bulk:
        bulk = raw[HEAD.size + message.layout.size : -CRC.size]
        if len(bulk) != math.prod(int(fields[axis]) for axis in message.axes):
            return RefusedBytes(RefusalReason.PAYLOAD, raw[:KEPT])
        fields[message.bulk] = bulk
    return Frame(
        name=message.name,
        mode=mode,
        flags=flags,
        session=session,
        sequence=sequence,
        stamp_us=stamp_us,
        ttl_ms=ttl_ms,
        fields=fields,
        raw=raw,
    )


_DRIFT = 5000
"""Clocks drift by at most one part in this: 200 ppm."""


class LeastDelay:
    """Least difference between arrivals and stamps: the offset of two clocks without delays.

    It falls at once and rises no faster than clocks drift, so that a growing delay of the line is visible.

    Args:
        difference_ns: arrival minus stamp of the first message, ns.
        now_ns: arrival of the first message, ns.
    """

    def __init__(self, difference_ns: int, now_ns: int) -> None:
        self._least_ns = difference_ns
        self._at_ns = now_ns

    def at(self, now_ns: int) -> int:
        """Present estimate, ns."""
        return self._least_ns + max(0, now_ns - self._at_ns) // _DRIFT

    def feed(self, difference_ns: int, now_ns: int) -> int:
        """Estimate after one more message, ns: never above that message's own difference."""
        self._least_ns = min(self.at(now_ns), difference_ns)
        self._at_ns = max(now_ns, self._at_ns)
        return self._least_ns


_SILENT_NS = RULES["silent_ms"] * 1_000_000
_FUTURE_NS = RULES["future_ms"] * 1_000_000
_U32 = 1 << 32


class FrameVerdict(IntEnum):
    """Verdict on a frame; all except ``ACCEPTED`` are reasons of refusal."""

    ACCEPTED = 0
    WRONG_LINE = 32
    """Its message does not belong to this line, or to that end."""
    NO_SESSION = 33
    """Its session is 0."""
    SECOND_SENDER = 34
    """Of another session, while the line is alive."""
    REMEMBERED_SESSION = 35
    """Of a session that has ended."""
    REPEATED = 36
    """Its sequence number is not new."""
    STALE = 37
    """It arrived later than its time to live allows."""
    FROM_FUTURE = 38
    """Its stamp is ahead of the sender's clock."""


class _Ahead(NamedTuple):
    """Frames from the future, received while nothing was accepted, that agree with each other."""

    difference_ns: int
    least_ns: int
    since_ns: int


class Receiver:
    """Accepts or refuses the frames of one line by ``data_schema/wire.toml``. Time is an argument, so that a replay
    gives the same verdicts.

    Args:
        line: name of the line.
        sender: expected sending end.

    Attributes:
        counts: number of frames by verdict.
        missed: number of missing sequence numbers.
        session: session of the sender; 0 before the first frame.
        last_accepted_ns: arrival of the last accepted frame, ns.
    """

    def __init__(self, line: str, sender: str = "device") -> None:
        self._names = {name for name, message in MESSAGES.items() if (message.line, message.sender) == (line, sender)}
        self._remembered: deque[int] = deque(maxlen=RULES["sessions_remembered"])
        self._least = LeastDelay(0, 0)  # of the session
        self._ahead: _Ahead | None = None
        self._sequence = 0
        self.counts: Counter[FrameVerdict] = Counter()
        self.missed = 0
        self.session = 0
        self.last_accepted_ns = 0

    def accept(self, frame: Frame, arrival_ns: int) -> FrameVerdict:
        """Whether the frame is acted upon. ``arrival_ns`` is the receiver's monotonic clock and must not fall."""
        verdict = self._judge(frame, arrival_ns)
        self.counts[verdict] += 1
        if verdict is FrameVerdict.ACCEPTED:
            self.last_accepted_ns = arrival_ns
            self._ahead = None
        return verdict

    def silent(self, now_ns: int) -> bool:
        """Whether the line is dead: nothing accepted for too long."""
        return self.session == 0 or now_ns - self.last_accepted_ns >= _SILENT_NS

    def _judge(self, frame: Frame, arrival_ns: int) -> FrameVerdict:
        if frame.name not in self._names:
            return FrameVerdict.WRONG_LINE
        if frame.session == 0:
            return FrameVerdict.NO_SESSION
        if frame.session != self.session:
            return self._other_session(frame, arrival_ns)
        step = (frame.sequence - self._sequence) % _U32
        if not 0 < step < _U32 // 2:
            return FrameVerdict.REPEATED
        self._sequence = frame.sequence
        self.missed += step - 1
        return self._age(frame, arrival_ns)

    def _other_session(self, frame: Frame, arrival_ns: int) -> FrameVerdict:
        if not self.silent(arrival_ns):
            return FrameVerdict.SECOND_SENDER
        if frame.session in self._remembered:
            return FrameVerdict.REMEMBERED_SESSION
        self._remembered.append(frame.session)
        self.session = frame.session
        self._sequence = frame.sequence
        self._least = LeastDelay(arrival_ns - frame.stamp_us * 1000, arrival_ns)
        return FrameVerdict.ACCEPTED

    def _age(self, frame: Frame, arrival_ns: int) -> FrameVerdict:
        difference = arrival_ns - frame.stamp_us * 1000
        age = difference - self._least.at(arrival_ns)
        if frame.ttl_ms and age > frame.ttl_ms * 1_000_000:
            return FrameVerdict.STALE
        if age < -_FUTURE_NS:
            if not self._set_ahead(difference, arrival_ns):
                return FrameVerdict.FROM_FUTURE
        else:
            self._least.feed(difference, arrival_ns)
        return FrameVerdict.ACCEPTED

    def _set_ahead(self, difference_ns: int, arrival_ns: int) -> bool:
        """Whether the sender's clock was set ahead: nothing else arrived for the time after which a line is silent."""
        ahead = self._ahead
        if ahead is None or abs(difference_ns - ahead.difference_ns) > _FUTURE_NS:
            self._ahead = _Ahead(difference_ns, difference_ns, arrival_ns)
            return False
        self._ahead = ahead._replace(least_ns=min(ahead.least_ns, difference_ns))
        if arrival_ns - ahead.since_ns < _SILENT_NS:
            return False
        self._least = LeastDelay(self._ahead.least_ns, arrival_ns)
        return True


def draw_session() -> int:
    """A session's number: random, not 0."""
    return secrets.randbelow(_U32 - 1) + 1


class Sender:
    """Numbers and stamps the frames of this end.

    Args:
        session: session number of this start of the program, from ``draw_session``.
    """

    def __init__(self, session: int) -> None:
        self._session = session
        self._sequence = 0

    def frame(self, name: str, fields: Mapping[str, Value], *, mode: int, mono_ns: int, ttl_ms: int = 0) -> bytes:
        """The next frame; ``mono_ns`` is the present time of this computer's monotonic clock.

        Raises:
            ValueError: by ``wire.encode``, without using up a sequence number.
        """
        stamp_us = mono_ns // 1000
        raw = encode(
            name, fields, mode=mode, session=self._session, sequence=self._sequence, stamp_us=stamp_us, ttl_ms=ttl_ms
        )
        self._sequence = (self._sequence + 1) % _U32
        return raw
