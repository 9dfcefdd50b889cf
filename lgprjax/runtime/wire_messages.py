"""The messages of the lines, read from ``data_schema/wire.toml``."""

import struct
import tomllib
from importlib import resources
from pathlib import Path
from typing import Any, NamedTuple

CODES = {"u8": "B", "u16": "H", "u32": "I", "u64": "Q", "i32": "i", "f32": "f", "f64": "d"}
"""Types of the description as ``struct`` has them."""


class Field(NamedTuple):
    """A number of a message: its name and its type as the description has it."""

    name: str
    kind: str


class Message(NamedTuple):
    """A kind of frame.

    Attributes:
        type: number in the header.
        sender: ``host`` or ``device``.
        line: which line it travels on.
        numbers: fields in their order.
        layout: of the numbers.
        bulk: name of the bytes after them, ``""`` where there are none.
        axes: numbers whose product is the length of ``bulk``.
    """

    type: int
    name: str
    sender: str
    line: str
    numbers: tuple[Field, ...]
    layout: struct.Struct
    bulk: str
    axes: tuple[str, ...]


def _text() -> str:
    # Not by lgprjax.formats.schema: its room imports JAX, which the recorder and the display do without.
    packaged = resources.files("lgprjax").joinpath("data_schema", "wire.toml")
    if packaged.is_file():
        return packaged.read_text(encoding="utf-8")
    return (Path(__file__).resolve().parents[2] / "data_schema" / "wire.toml").read_text(encoding="utf-8")


def _message(table: dict[str, Any]) -> Message:
    numbers, bulk, axes = [], "", ()
    for field in table["fields"]:
        if "[" in field["type"]:
            bulk, axes = field["name"], tuple(field["type"][len("u8[") : -1].split("*"))
        else:
            numbers.append(Field(field["name"], field["type"]))
    layout = struct.Struct("<" + "".join(CODES[field.kind] for field in numbers))
    return Message(table["type"], table["name"], table["from"], table["line"], tuple(numbers), layout, bulk, axes)


_TABLE = tomllib.loads(_text())
RULES: dict[str, int] = _TABLE["rules"]
"""What a receiver goes by."""
MESSAGES: dict[str, Message] = {table["name"]: _message(table) for table in _TABLE["message"]}
"""Every message by its name."""
MESSAGE_OF_TYPE = {message.type: message for message in MESSAGES.values()}
"""The same by the number in the header."""
SYNC = bytes(_TABLE["frame"]["sync"])
VERSION: int = _TABLE["frame"]["version"]
LARGEST_PAYLOAD: int = _TABLE["frame"]["largest_payload"]
HEAD_FIELDS = tuple(Field(field["name"], field["type"]) for field in _TABLE["frame"]["header"][1:])
"""Of the header after the sync."""
HEAD = struct.Struct(f"<{len(SYNC)}s" + "".join(CODES[field.kind] for field in HEAD_FIELDS))
CRC = struct.Struct("<I")
