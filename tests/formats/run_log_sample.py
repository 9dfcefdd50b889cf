"""Recorded runs written by hand from data_schema/run_log.toml, for the tests."""

import json
import struct
import zlib
from pathlib import Path
from uuid import UUID

RUN = UUID("6f1c0f5e-93f1-4a4b-8a39-0d8f3c1f7a11")
HEADS = 120


def crc(data: bytes, start: int = 0) -> bytes:
    return struct.pack("<I", zlib.crc32(data, start))


def head_bytes(
    segment: int, number: int, *, utc_ns: int = 1_800_000_000_000_000_000, mono_ns: int = 10**12, run: UUID = RUN
) -> bytes:
    head = b"LGPRRUN\0" + struct.pack("<HHI", 1, 0, segment) + run.bytes + struct.pack("<QQQ", utc_ns, mono_ns, number)
    return 2 * (head + crc(head))


def record_bytes(number: int, data: bytes, *, origin: int = 1, run: UUID = RUN) -> bytes:
    covered = struct.pack("<IQBQ", len(data), number, origin, 0 if origin == 0 else 1000 * number) + data
    return b"\x9d\x52\x65\x63" + covered + crc(covered, zlib.crc32(run.bytes))


def own_bytes(number: int, *, run: UUID = RUN, **what: object) -> bytes:
    return record_bytes(number, json.dumps(what).encode(), origin=0, run=run)


def data_of(number: int, size: int) -> bytes:
    """A record of the runtime: kind 2, source 4, a tick, a time that rises by 10 ms, and bytes that tell the number."""
    head = struct.pack("<BBHIQ", 2, 4, 0, number, 10**12 + number * 10_000_000)
    return head + (number.to_bytes(4, "little") * (size // 4 + 1))[:size]


def write_run(folder: Path, segments: int = 1, records: int = 40, size: int = 60) -> dict[int, bytes]:
    """A run that was ended in order; returns its records by number."""
    folder.mkdir(exist_ok=True)
    number, held = 0, {}
    for segment in range(segments):
        parts = [head_bytes(segment, number), own_bytes(number, dropped={"control_log": 0})]
        number += 1
        for _ in range(records):
            held[number] = data_of(number, size + number % 7)
            parts.append(record_bytes(number, held[number], origin=1 + number % 2))
            number += 1
        if segment == segments - 1:
            parts.append(own_bytes(number, end="ended"))
        (folder / f"{segment:04d}.lgprun").write_bytes(b"".join(parts))
    return held
