"""A queue between two processes that neither can hold up: one writer, one reader, a file in memory.

The writer never waits: what does not fit is dropped and counted. Either side may be killed at any byte and started
again; what was put stays there. A place holds its length and a CRC, so that bytes half written are never taken.
"""

import mmap
import os
import struct
import zlib
from pathlib import Path

_MAGIC = b"LGPRRING"
_HEAD = 64  # magic, size, then head and tail each on a line of its own of eight bytes
_SIZE, _WRITTEN, _READ, _LOST = 8, 16, 24, 32
_U64 = struct.Struct("<Q")
_PLACE = struct.Struct("<II")


class Ring:
    """One end of a ring. Bytes written and read are counted from the ring's beginning and never fall.

    Args:
        path: its file.
    """

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        with self.path.open("r+b") as file:
            self._map = mmap.mmap(file.fileno(), 0)
        if self._map[:8] != _MAGIC:
            raise ValueError(f"{path}: no ring")
        self._size = self._get(_SIZE)

    @classmethod
    def create(cls, path: str | Path, size: int) -> "Ring":
        """A new, empty ring of ``size`` bytes; one that is there already stays as it is."""
        target = Path(path)
        if not target.exists():
            fresh = target.with_name(f"{target.name}.{os.getpid()}")
            with fresh.open("wb") as file:
                file.truncate(_HEAD + size)
                file.seek(0)
                file.write(_MAGIC + _U64.pack(size))
            fresh.rename(target)
        return cls(target)

    @property
    def lost(self) -> int:
        """Messages that did not fit since the ring was made."""
        return self._get(_LOST)

    @property
    def waiting(self) -> int:
        """Bytes that wait to be read."""
        return self._get(_WRITTEN) - self._get(_READ)

    def put(self, message: bytes) -> bool:
        """Writer: whether the message fitted."""
        need = _PLACE.size + len(message)
        written = self._get(_WRITTEN)
        if need > self._size - (written - self._get(_READ)):
            self._set(_LOST, self.lost + 1)
            return False
        self._copy_in(written, _PLACE.pack(len(message), zlib.crc32(message)) + message)
        # What is counted is there: the place is whole before this.
        self._set(_WRITTEN, written + need)
        return True

    def take(self, most: int = 1 << 30) -> list[bytes]:
        """Reader: all messages that wait, oldest first, of at most about ``most`` bytes together."""
        messages: list[bytes] = []
        read, written = self._get(_READ), self._get(_WRITTEN)
        taken = 0
        while read + _PLACE.size <= written and taken < most:
            length, crc = _PLACE.unpack(self._copy_out(read, _PLACE.size))
            if length > self._size or read + _PLACE.size + length > written:
                read = written  # a writer killed in the middle of counting: nothing of this can be trusted
                break
            message = self._copy_out(read + _PLACE.size, length)
            read += _PLACE.size + length
            taken += length
            if zlib.crc32(message) == crc:
                messages.append(message)
        self._set(_READ, read)
        return messages

    def latest(self) -> bytes | None:
        """Reader: the newest message; those before it are let go. ``None`` where nothing waits."""
        messages = self.take()
        return messages[-1] if messages else None

    def _get(self, at: int) -> int:
        value: int = _U64.unpack_from(self._map, at)[0]
        return value

    def _set(self, at: int, value: int) -> None:
        # Eight aligned bytes in one copy.
        self._map[at : at + 8] = _U64.pack(value)

    def _copy_in(self, at: int, data: bytes) -> None:
        start = at % self._size
        first = min(len(data), self._size - start)
        self._map[_HEAD + start : _HEAD + start + first] = data[:first]
        if first < len(data):
            self._map[_HEAD : _HEAD + len(data) - first] = data[first:]

    def _copy_out(self, at: int, length: int) -> bytes:
        start = at % self._size
        first = min(length, self._size - start)
        data = self._map[_HEAD + start : _HEAD + start + first]
        return data if first == length else data + self._map[_HEAD : _HEAD + length - first]
