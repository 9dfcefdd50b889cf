"""Segments of a recorded run: bytes of their heads and records, recoverable from a cut or damaged file.

The layout is in ``data_schema/run_log.toml``. Standard library only: the recorder must start at once.
"""

import os
import struct
import zlib
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

SUFFIX = ".lgprun"
OWN = 0
"""Origin of the recorder's own records, JSON; the others are rings, numbered from 1 as in ``ORIGINS``."""
ORIGINS = ("recorder", "control_log", "registration_log", "supervisor_log")

_MAGIC = b"LGPRRUN\0"
_VERSION = 1
_HEAD = struct.Struct("<8sHHI16sQQQ")
_SYNC = b"\x9dRec"
_RECORD = struct.Struct("<4sIQBQ")
_CRC = struct.Struct("<I")
_LARGEST = 32 << 20
_COPY = _HEAD.size + _CRC.size
_BLOCK = 1 << 20
_SECTOR = 4096

HEADS_SIZE = 2 * _COPY
"""Bytes before a segment's first record: its head, twice."""


class SegmentHead(NamedTuple):
    """Head of a segment.

    Attributes:
        run: the run's UUID, 16 bytes.
        segment: number in the run, from 0.
        utc_ns, mono_ns: the computer's two clocks when it was begun.
        number: of its first record.
    """

    run: bytes
    segment: int
    utc_ns: int
    mono_ns: int
    number: int


class SegmentRecord(NamedTuple):
    """An intact record of a segment.

    Attributes:
        start, stop: its bytes in the file.
        number: arrival number, consecutive over the run.
        origin: index in ``ORIGINS``.
        position: end in its ring, bytes since the ring's beginning; 0 for the recorder's own.
        data: as received.
    """

    start: int
    stop: int
    number: int
    origin: int
    position: int
    data: bytes


def segment_path(folder: Path, segment: int) -> Path:
    """File of a segment."""
    return folder / f"{segment:04d}{SUFFIX}"


def segments_of(folder: Path) -> dict[int, Path]:
    """Files of a run by segment number, rising."""
    found = {int(path.stem): path for path in folder.glob(f"*{SUFFIX}") if path.stem.isdecimal()}
    return dict(sorted(found.items()))


def pack_head(head: SegmentHead) -> bytes:
    """A head as stored in the file: twice, each with its CRC."""
    packed = _HEAD.pack(_MAGIC, _VERSION, 0, head.segment, head.run, head.utc_ns, head.mono_ns, head.number)
    return 2 * (packed + _CRC.pack(zlib.crc32(packed)))


def pack_record(run: bytes, number: int, origin: int, position: int, data: bytes) -> bytes:
    """A record as stored in the file.

    Raises:
        ValueError: it is larger than a segment's reader accepts.
    """
    if len(data) > _LARGEST:
        raise ValueError(f"a record of at most {_LARGEST} bytes was expected, found {len(data)}")
    body = _RECORD.pack(_SYNC, len(data), number, origin, position) + data
    return body + _CRC.pack(_crc(run, body))


def read_head(path: Path) -> tuple[SegmentHead | None, list[int]]:
    """The head of a segment, ``None`` without an intact copy, and the start of a damaged copy."""
    head, damaged = None, []
    with path.open("rb", buffering=0) as file:
        data = b"".join(_blocks(file.fileno(), 0, HEADS_SIZE))
    for at in (0, _COPY):
        copy = data[at : at + _COPY]
        good = len(copy) == _COPY and _CRC.unpack(copy[_HEAD.size :])[0] == zlib.crc32(copy[: _HEAD.size])
        magic, version, _, segment, run, *rest = _HEAD.unpack(copy[: _HEAD.size]) if good else (b"", 0, 0, 0, b"")
        if magic == _MAGIC and version == _VERSION:
            head = SegmentHead(run, segment, *rest)
        else:
            damaged.append(at)
    return head, damaged


def scan_records(path: Path, run: bytes) -> Iterator[SegmentRecord]:
    """Every intact record of a segment, in file order.

    Anything else is skipped byte by byte to the next sync mark with a valid CRC. Memory is
    bounded by the largest record. Sectors that cannot be read count as zeros.
    """
    with path.open("rb", buffering=0) as file:
        blocks = _blocks(file.fileno(), HEADS_SIZE, None)
        buffer, base, at = bytearray(), HEADS_SIZE, 0

        def holds(size: int) -> bool:
            while len(buffer) - at < size:
                block = next(blocks, b"")
                if not block:
                    return False
                buffer.extend(block)
            return True

        while holds(_RECORD.size):
            if at > _BLOCK:
                del buffer[:at]
                base, at = base + at, 0
            if not buffer.startswith(_SYNC, at):
                found = buffer.find(_SYNC, at)
                # The mark may begin in the last bytes read.
                at = found if found >= 0 else len(buffer) - len(_SYNC) + 1
                continue
            _, length, number, origin, position = _RECORD.unpack_from(buffer, at)
            body = _RECORD.size + length
            if length <= _LARGEST and origin < len(ORIGINS) and holds(body + _CRC.size):
                data = bytes(buffer[at : at + body])
                if _CRC.unpack_from(buffer, at + body)[0] == _crc(run, data):
                    stop = at + body + _CRC.size
                    yield SegmentRecord(base + at, base + stop, number, origin, position, data[_RECORD.size :])
                    at = stop
                    continue
            at += 1


def _crc(run: bytes, body: bytes) -> int:
    # Starts with the run's UUID: remains of an older run on the same sectors are not accepted.
    return zlib.crc32(body[len(_SYNC) :], zlib.crc32(run))


def _blocks(file: int, start: int, stop: int | None) -> Iterator[bytes]:
    end = os.fstat(file).st_size
    at, end = start, end if stop is None else min(end, stop)
    while at < end:
        to_sector = min(_SECTOR - at % _SECTOR, end - at)
        for size in (min(_BLOCK, end - at), to_sector):
            with suppress(OSError):
                block = os.pread(file, size, at)
                break
        else:
            block = bytes(to_sector)
        if not block:
            return
        at += len(block)
        yield block
