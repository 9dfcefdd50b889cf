"""A non-blocking queue between two processes: one writer, one reader, a file in memory.

The writer never waits: messages that do not fit are dropped and counted. Either side may be killed at any byte and
restarted; queued messages stay. An entry holds its length and a CRC, so that half-written bytes are never read.
"""

import mmap
import os
import struct
import zlib
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

_MAGIC = b"LGPRRING"
_HEAD = 64  # magic, size, then head and tail, eight bytes each
_SIZE, _WRITTEN, _READ, _LOST = 8, 16, 24, 32
_U64 = struct.Struct("<Q")
_PLACE = struct.Struct("<II")


class Waiting(NamedTuple):
    """Messages that wait in a ring, oldest first.

    Attributes:
        messages: each with its end, in bytes from the ring's beginning.
        end: start of the next one; argument of ``release`` once all of them are safe.
    """

    messages: list[tuple[int, bytes]]
    end: int


class Ring:
    """One end of a ring. Bytes written and read are counted from the ring's beginning and never decrease.

    Args:
        path: file of the ring.

    Attributes:
        damaged: number of entries that this end found damaged and skipped.
    """

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        self.damaged = 0
        self._doubted = -1
        with self.path.open("r+b") as file:
            self._map = mmap.mmap(file.fileno(), 0)
        if self._map[:8] != _MAGIC:
            raise ValueError(f"{path}: no ring")
        self._size = self._get(_SIZE)

    @classmethod
    def create(cls, path: str | Path, size: int) -> "Ring":
        """A new, empty ring of ``size`` bytes; an existing one is kept."""
        target = Path(path)
        if not target.exists():
            fresh = target.with_name(f"{target.name}.{os.getpid()}")
            with fresh.open("wb") as file:
                file.truncate(_HEAD + size)
                file.seek(0)
                file.write(_MAGIC + _U64.pack(size))
            # A link fails if another process was first: a rename would replace its ring.
            with suppress(FileExistsError):
                target.hardlink_to(fresh)
            fresh.unlink()
        return cls(target)

    @property
    def lost(self) -> int:
        """Messages dropped since the ring was created."""
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
        self._copy_in(written, _PLACE.pack(len(message), _crc(message)) + message)
        # The entry is complete before it is counted.
        self._set(_WRITTEN, written + need)
        return True

    def take(self, most: int = 1 << 30) -> list[bytes]:
        """Reader: all messages that wait, oldest first, of at most about ``most`` bytes together."""
        waiting = self.peek(most)
        self.release(waiting.end)
        return [message for _, message in waiting.messages]

    def peek(self, most: int = 1 << 30) -> Waiting:
        """Reader: the same, but they stay in the ring until they are released."""
        messages: list[tuple[int, bytes]] = []
        read, written = self._get(_READ), self._get(_WRITTEN)
        taken = 0
        while read + _PLACE.size <= written and taken < most:
            length, crc = _PLACE.unpack(self._copy_out(read, _PLACE.size))
            after = read + _PLACE.size + length
            message = self._copy_out(read + _PLACE.size, length) if after <= written else b""
            if after > written or _crc(message) != crc:
                # A processor may show the count before the bytes: checked twice before it is skipped.
                if self._doubted != read:
                    self._doubted = read
                    break
                self.damaged += 1
                read = min(after, written)
                continue
            messages.append((after, message))
            taken += length
            read = after
        return Waiting(messages, read)

    def release(self, end: int) -> None:
        """Reader: release everything before ``end``; no effect if it is not waiting."""
        if self._get(_READ) < end <= self._get(_WRITTEN):
            self._set(_READ, end)

    def latest(self) -> bytes | None:
        """Reader: the newest message; earlier ones are released. ``None`` if nothing waits."""
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


def _crc(message: bytes) -> int:
    # Starts with the length: eight zero bytes are no message.
    return zlib.crc32(message, ~len(message) & 0xFFFFFFFF)
