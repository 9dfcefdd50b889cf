"""Recorded runs, cut down to what a replay and a record of worked ground need, by ``data_schema/run_log.toml`` alone.

Two runs stand in ``data/``: ``course``, a counter-steered vehicle that finds itself by radar, is engaged and speeds up;
``field``, a skid-steer vehicle that begins a plan, loses GNSS for four seconds and goes on. Each was recorded from

    XLA_FLAGS=--xla_cpu_max_isa=SSE4_2 lgprjax run CONFIG.run.toml --simulate --for-s 24

with ``--lockstep``: ``onboard/simulated.run.toml`` (60 m, a sixth of the scans), and ``onboard/field.run.toml`` (GNSS
off from 16 to 20 s, ``--for-s 32``). Another recording is another run, and is made only where a meant change makes the
control loop decide otherwise. Then

    PYTHONPATH=.:tests python -m frozen.recordings NAME RUN_FOLDER TICKS FILE...

cuts it down to its first ticks and lays it, with the files that it was driven with, into ``data/NAME/``.
"""

import hashlib
import json
import lzma
import re
import struct
import sys
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import lgprjax
from frozen.harness import DATA

_SYNC = bytes([0x9D, 0x52, 0x65, 0x63])
_HEAD = struct.Struct("<IQBQ")
_DATA_HEAD = struct.Struct("<BBHIQ")
_SEGMENT = struct.Struct("<8sHHI16sQQQ")
_CONTROL_LOG = 1
_HEADER, _CONTROL, _COVER = 1, 10, 13
# port_in, port_out, tick, fix, event, monitor, request: what the control loop was told and what it sent.
_REPLAYED = (2, 3, 5, 6, 8, 10, 11)
_RECORDS = "records.xz"
_DROPPED = json.dumps({"dropped": {"control_log": 0, "registration_log": 0, "supervisor_log": 0}}).encode()
_ENDED = json.dumps({"end": "ended"}).encode()


_SEGMENT_BYTES = 2 * (_SEGMENT.size + 4)


class Part(NamedTuple):
    """A record: index of its origin and its data."""

    origin: int
    data: bytes


def parts_of(segment: bytes) -> Iterator[Part]:
    """Records of a whole segment."""
    at = _SEGMENT_BYTES
    while at < len(segment):
        assert segment[at : at + 4] == _SYNC
        length, _, origin, _ = _HEAD.unpack_from(segment, at + 4)
        begin = at + 4 + _HEAD.size
        yield Part(origin, segment[begin : begin + length])
        at = begin + length + 4


def segment_of(head: bytes, parts: list[Part]) -> bytes:
    """A first segment with the head's run and clocks and these records, numbered anew."""
    magic, version, _, _, run, utc_ns, mono_ns, _ = _SEGMENT.unpack_from(head)
    begun = _SEGMENT.pack(magic, version, 0, 0, run, utc_ns, mono_ns, 0)
    begun += struct.pack("<I", zlib.crc32(begun))
    seed, out, position = zlib.crc32(run), [begun, begun], 0
    for number, part in enumerate(parts):
        position += len(part.data) if part.origin else 0
        body = _HEAD.pack(len(part.data), number, part.origin, position if part.origin else 0) + part.data
        out.append(_SYNC + body + struct.pack("<I", zlib.crc32(body, seed)))
    return b"".join(out)


def pack_parts(head: bytes, parts: list[Part]) -> bytes:
    """Head and records without the numbers and check sums between them, which do not pack."""
    lengths = b"".join(struct.pack("<BI", part.origin, len(part.data)) for part in parts)
    data = b"".join(part.data for part in parts)
    return lzma.compress(head[:_SEGMENT_BYTES] + struct.pack("<I", len(parts)) + lengths + data, preset=9)


def unpack_parts(packed: bytes) -> tuple[bytes, list[Part]]:
    """What ``pack_parts`` packed."""
    raw = lzma.decompress(packed)
    (count,) = struct.unpack_from("<I", raw, _SEGMENT_BYTES)
    at = _SEGMENT_BYTES + 4
    lengths = list(struct.iter_unpack("<BI", raw[at : at + 5 * count]))
    at, parts = at + 5 * count, []
    for origin, length in lengths:
        parts.append(Part(origin, raw[at : at + length]))
        at += length
    return raw[:_SEGMENT_BYTES], parts


def cut_down(segments: list[bytes], ticks: int) -> list[Part]:
    """The part of a recording that a replay reads, of its first ticks."""
    kept = [Part(0, _DROPPED)]
    for part in (part for segment in segments for part in parts_of(segment)):
        if part.origin == _CONTROL_LOG:
            kind, source, _, tick, _ = _DATA_HEAD.unpack_from(part.data)
            header = kind == _HEADER and source == _CONTROL
            if header or (kind in (*_REPLAYED, _COVER) and 0 < tick <= ticks):
                kept.append(part)
    return [*kept, Part(0, _ENDED)]


def lay_out(name: str, folder: Path) -> Path:
    """Lay a recording and its files into a folder, as if it had been driven there by this version; the run's folder.

    Version and place of the configuration are put into the control loop's header: a replay refuses others.
    """
    run = folder / "run"
    run.mkdir(parents=True)
    for path in sorted((DATA / name).iterdir()):
        if path.name != _RECORDS:
            data = lzma.decompress(path.read_bytes()) if path.suffix == ".xz" else path.read_bytes()
            target = run if path.name in ("config.toml", "run.json") else folder
            (target / path.name.removesuffix(".xz")).write_bytes(data)
    config = folder / "driven.run.toml"
    config.write_bytes((run / "config.toml").read_bytes())
    head, parts = unpack_parts((DATA / name / _RECORDS).read_bytes())
    (run / "0000.lgprun").write_bytes(segment_of(head, [_here(part, config) for part in parts]))
    return run


def _here(part: Part, config: Path) -> Part:
    if part.origin != _CONTROL_LOG or part.data[0] != _HEADER:
        return part
    header = json.loads(part.data[_DATA_HEAD.size :])
    header |= {"version": lgprjax.__version__, "config": str(config)}
    return part._replace(data=part.data[: _DATA_HEAD.size] + json.dumps(header).encode())


def keep(name: str, run: Path, files: list[Path], ticks: int) -> None:
    """Cut a run down and lay it into ``data/``; paths become the names of the files beside it."""
    target = DATA / name
    target.mkdir(parents=True, exist_ok=True)
    segments = [path.read_bytes() for path in sorted(run.glob("*.lgprun"))]
    hashes = {path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in files}
    parts = []
    for part in cut_down(segments, ticks):
        if part.origin == _CONTROL_LOG and part.data[0] == _HEADER:
            header = json.loads(part.data[_DATA_HEAD.size :])
            header["hashes"] = {Path(key).name: digest for key, digest in header["hashes"].items()}
            assert header["hashes"] == hashes, "the run was driven with other files"
            header["config"] = "driven.run.toml"
            part = part._replace(data=part.data[: _DATA_HEAD.size] + json.dumps(header).encode())
        parts.append(part)
    (target / _RECORDS).write_bytes(pack_parts(segments[0], parts))
    config = (run / "config.toml").read_text(encoding="utf-8")
    (target / "config.toml").write_text(re.sub(r'"/(?!dev/)[^"]*/([^"/]+)"', r'"\1"', config), encoding="utf-8")
    for path in files:
        data = path.read_bytes()
        packed = path.suffix == ".h5"
        (target / (path.name + ".xz" * packed)).write_bytes(lzma.compress(data) if packed else data)
    about = json.loads((run / "run.json").read_text(encoding="utf-8"))
    about = {key: about[key] for key in ("uuid", "lgprjax", "clocks")} | {"config": "driven.run.toml"}
    (target / "run.json").write_text(json.dumps(about, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    keep(sys.argv[1], Path(sys.argv[2]), [Path(each) for each in sys.argv[4:]], int(sys.argv[3]))
