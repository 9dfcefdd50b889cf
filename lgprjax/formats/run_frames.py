"""Records of a recorded run taken apart: their heads, frames of the lines, and what the processes put down.

What they consist of stands in ``data_schema/run_log.toml`` and ``data_schema/wire.toml``.
"""

import struct
import tomllib
import zlib
from functools import cache
from typing import Any, NamedTuple

import numpy as np

from lgprjax.formats.schema import schema_text

_RUN = tomllib.loads(schema_text("run_log"))
_WIRE = tomllib.loads(schema_text("wire"))
_KINDS = {entry["code"]: name for name, entry in _RUN["kinds"].items()}
_SOURCES = {code: name for name, code in _RUN["sources"].items()}
_MESSAGES = {message["type"]: message["name"] for message in _WIRE["message"]}
_HEAD = struct.Struct("<BBHIQ")
_CRC = struct.Struct("<I")
_TYPES = {"u8": "u1", "i8": "i1", **{f"{k}{8 * n}": f"<{k}{n}" for k in "uif" for n in (2, 4, 8)}}


class RunRecord(NamedTuple):
    """A record of a run.

    Attributes:
        kind, source: as ``data_schema/run_log.toml`` names them.
        tick: of the control loop; 0 where none belongs to it.
        mono_ns: monotonic clock of the computer; of ``port_in`` the arrival.
        payload: by its kind.
    """

    kind: str
    source: str
    tick: int
    mono_ns: int
    payload: bytes


def read_run_record(data: bytes) -> RunRecord | None:
    """A record's parts; ``None`` for one that this version does not know."""
    if len(data) < _HEAD.size:
        return None
    kind, source, _, tick, mono_ns = _HEAD.unpack_from(data)
    if kind not in _KINDS or source not in _SOURCES:
        return None
    return RunRecord(_KINDS[kind], _SOURCES[source], tick, mono_ns, data[_HEAD.size :])


@cache
def payload_type(name: str) -> np.dtype[Any]:
    """Payload of a ``fix``, ``prior`` or ``plan`` record. ``KeyError`` for another."""
    return np.dtype(_fields(_named(_RUN["payload"], name)["fields"]))


@cache
def frame_type(name: str) -> np.dtype[Any]:
    """A frame of ``data_schema/wire.toml`` from its sync to its last field of fixed size. ``KeyError`` for another."""
    fields = _named(_WIRE["message"], name)["fields"]
    return np.dtype(_fields(_WIRE["frame"]["header"]) + _fields([each for each in fields if "*" not in each["type"]]))


def frame_name(frame: bytes) -> str | None:
    """Message that whole bytes are a frame of; ``None`` where they are none, or their CRC is wrong."""
    header = header_type()
    if len(frame) < header.itemsize + _CRC.size or frame[:2] != bytes(_WIRE["frame"]["sync"]):
        return None
    if _CRC.unpack(frame[-_CRC.size :])[0] != zlib.crc32(frame[2 : -_CRC.size]):
        return None
    name = _MESSAGES.get(frame[3])
    return name if name is not None and len(frame) >= frame_type(name).itemsize + _CRC.size else None


@cache
def header_type() -> np.dtype[Any]:
    """What every frame begins with."""
    return np.dtype(_fields(_WIRE["frame"]["header"]))


def frame_data(frame: bytes, name: str) -> bytes:
    """What follows the fields of fixed size: a scan's samples."""
    return frame[frame_type(name).itemsize : -_CRC.size]


def _fields(entries: list[dict[str, str]]) -> list[tuple[Any, ...]]:
    fields: list[tuple[Any, ...]] = []
    for entry in entries:
        kind, _, shape = entry["type"].rstrip("]").partition("[")
        sizes = tuple(int(size) for size in shape.split(",")) if shape else ()
        fields.append((entry["name"], _TYPES[kind], sizes))
    return fields


def _named(entries: list[dict[str, Any]], name: str) -> dict[str, Any]:
    for entry in entries:
        if entry["name"] == name:
            return entry
    raise KeyError(name)
