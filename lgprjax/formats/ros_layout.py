"""ROS 2 message definitions as recordings carry them (``ros2msg``), and messages of them in CDR.

A definition is laid out flat once; a message then decodes by the fields that its own recording defines, in whatever
order they stand. Source: OMG DDS-XTypes 1.3, section 7.4.3 (plain CDR, version 1), and the ROS 2 interface definition.
"""

import re
import struct
from collections.abc import Iterator, Mapping
from itertools import islice
from typing import Any, NamedTuple

import numpy as np

_CODES = {
    **{"bool": "?", "byte": "B", "char": "B", "float32": "f", "float64": "d", "string": "s"},
    **{"int8": "b", "uint8": "B", "int16": "h", "uint16": "H"},
    **{"int32": "i", "uint32": "I", "int64": "q", "uint64": "Q"},
}
# Recorders leave these out of the definitions, or not.
_KNOWN = {
    "builtin_interfaces/Time": "int32 sec\nuint32 nanosec",
    "builtin_interfaces/Duration": "int32 sec\nuint32 nanosec",
}
_NUMBERS = {order + code: struct.Struct(order + code) for order in "<>" for code in _CODES.values() if code != "s"}
_TYPE = re.compile(r"([A-Za-z][\w/]*)(?:<=\d+)?(?:\[((?:<=)?)(\d*)\])?")
# Of a definition that nests itself, or each part twice: no message is that deep or that wide.
_MOST_NESTED = 16
_MOST_FIELDS = 4096


class Field(NamedTuple):
    """One primitive member of a message whose nested messages are laid out flat.

    Attributes:
        path: names from the message down to the member, joined by dots.
        code: type of an element as ``struct`` has it; ``s`` is a text.
        size: elements of a fixed array; 0 of a sequence, which tells its own length; ``None`` of a single value.
    """

    path: str
    code: str
    size: int | None


class Layout(NamedTuple):
    """The members of a message in the order in which they are serialised."""

    fields: tuple[Field, ...]

    def decode(self, data: bytes) -> dict[str, Any]:
        """Values of a message by the paths of its members; arrays are views of ``data``.

        Raises:
            ValueError: the bytes are no such message.
        """
        cursor = _Cursor(data)
        try:
            return {path: cursor.member(code, size) for path, code, size in self.fields}
        except (struct.error, OverflowError) as error:
            raise ValueError(f"a message that ends too early ({error})") from None

    def encode(self, values: Mapping[str, Any]) -> bytes:
        """A little-endian message of these values; members that are not named are zero or empty.

        Raises:
            KeyError: a name is no member's.
            ValueError: a fixed array has another size.
        """
        unknown = set(values) - {field.path for field in self.fields}
        if unknown:
            raise KeyError(", ".join(sorted(unknown)))
        out = bytearray(b"\0\1\0\0")
        for path, code, size in self.fields:
            if code == "s":
                texts = [values.get(path, "")] if size is None else values.get(path, [])
                if size is not None:
                    _put(out, "I", len(texts))
                for text in texts:
                    _put(out, "I", len(text.encode()) + 1)
                    out += text.encode() + b"\0"
            elif size is None:
                _put(out, code, values.get(path, 0))
            else:
                array = np.asarray(values.get(path, np.zeros(size)), dtype=f"<{code}").reshape(-1)
                if size == 0:
                    _put(out, "I", array.size)
                elif array.size != size:
                    raise ValueError(f"{path}: expected {size} elements, found {array.size}")
                if array.size:
                    _align(out, array.itemsize)
                    out += array.tobytes()
        return bytes(out)


def layout_of(name: str, definition: str) -> Layout:
    """Layout of a message from its definition with those of its nested messages, as recordings carry them.

    Args:
        name: package and name, such as ``sensor_msgs/msg/Imu``.
        definition: its own members, then each nested message after a line of equals signs and ``MSG: package/Name``.

    Raises:
        ValueError: the definition cannot be read, or holds what is not supported (arrays of messages, wide texts).
    """
    own, *nested = re.split(r"^={8,}[ \t\r]*$", definition, flags=re.MULTILINE)
    bodies = _KNOWN | {short_name(name): own}
    for part in nested:
        head, _, body = part.strip().partition("\n")
        if not head.startswith("MSG:"):
            raise ValueError(f"no name of a nested message in {head[:40]!r}")
        bodies[short_name(head[4:])] = body
    fields = tuple(islice(_fields(short_name(name), "", bodies, 0), _MOST_FIELDS + 1))
    if len(fields) > _MOST_FIELDS:
        raise ValueError("a definition without end")
    return Layout(fields)


def short_name(name: str) -> str:
    """``package/Name`` of ``package/msg/Name``, which say the same."""
    parts = name.strip().split("/")
    return f"{parts[0]}/{parts[-1]}"


def _fields(name: str, prefix: str, bodies: Mapping[str, str], depth: int) -> Iterator[Field]:
    if name not in bodies or depth > _MOST_NESTED:
        raise ValueError(f"no definition of {name}")
    empty = True
    for line in bodies[name].splitlines():
        code = line.partition("#")[0]
        words = code.split(None, 2)
        if not words:
            continue
        member = words[1].partition("=")[0] if len(words) > 1 else ""
        if "=" in code and member.isupper():
            continue  # a constant, which no message carries
        found = _TYPE.fullmatch(words[0])
        if found is None or not member.isidentifier():
            raise ValueError(f"no member in {line.strip()[:60]!r}")
        base, bound, digits = found.groups()
        size = None if digits is None else 0 if bound or not digits else int(digits)
        empty = False
        if base in _CODES:
            yield Field(prefix + member, _CODES[base], size)
        elif size is not None:
            raise ValueError(f"{member}: an array of messages")
        else:
            package = name.partition("/")[0] if base != "Header" else "std_msgs"
            nested = base if "/" in base else f"{package}/{base}"
            yield from _fields(short_name(nested), f"{prefix}{member}.", bodies, depth + 1)
    if empty:
        # IDL knows no empty structures: ROS 2 gives them this member.
        yield Field(f"{prefix}structure_needs_at_least_one_member", "B", None)


class _Cursor:
    """A place in a serialised message; alignment counts from the end of the four bytes that stand before it."""

    def __init__(self, data: bytes) -> None:
        if len(data) < 4 or data[0] != 0 or data[1] > 1:
            raise ValueError("no message in plain CDR")
        self._data = data
        self._order = "<" if data[1] else ">"
        self._at = 4

    def member(self, code: str, size: int | None) -> Any:
        if size is None:
            return self._text() if code == "s" else self._number(code)
        count = size or self._number("I")
        if code == "s":
            return [self._text() for _ in range(count)]
        dtype = np.dtype(self._order + code)
        if count == 0:
            return np.zeros(0, dtype)
        self._at += -(self._at - 4) % dtype.itemsize
        array = np.frombuffer(self._data, dtype, count, self._at)
        self._at += array.nbytes
        return array

    def _number(self, code: str) -> Any:
        number = _NUMBERS[self._order + code]
        self._at += -(self._at - 4) % number.size
        (value,) = number.unpack_from(self._data, self._at)
        self._at += number.size
        return value

    def _text(self) -> str:
        length = self._number("I")
        text = self._data[self._at : self._at + length]
        if len(text) < length:
            raise ValueError("a text that ends too early")
        self._at += length
        return text.rstrip(b"\0").decode()


def _align(out: bytearray, size: int) -> None:
    out += bytes(-(len(out) - 4) % size)


def _put(out: bytearray, code: str, value: Any) -> None:
    number = _NUMBERS[f"<{code}"]
    _align(out, number.size)
    out += number.pack(value)
