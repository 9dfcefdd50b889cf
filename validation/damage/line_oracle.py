"""What may be acted upon of a line's frames, told a second time: with struct and zlib, from wire.toml's words."""

import struct
import zlib
from typing import NamedTuple

_SENT_OVER = {"radar": {0x12, 0x13, 0x14, 0x15, 0x16, 0x17}, "drive_by_wire": {0x21, 0x25}, "controller": {0x30}}
_LENGTHS = {
    **{0x10: 5, 0x11: 10, 0x13: 11, 0x14: 20, 0x16: 20, 0x20: 13, 0x21: 46, 0x22: 1, 0x24: 14, 0x25: 46},
    **{0x30: 2, 0x31: 1},
}


class Head(NamedTuple):
    """A frame's header, of a frame whose bytes are right."""

    kind: int
    session: int
    sequence: int
    stamp_us: int
    ttl_ms: int


def head_of_right_bytes(raw: bytes) -> Head:
    """The header of one whole frame; ``AssertionError`` where its bytes are not right."""
    sync, version, kind, length, _, _, session, sequence, stamp_us, ttl_ms = struct.unpack_from("<HBBHBBIIQH", raw)
    assert (sync, version) == (0x5AA5, 1)
    assert len(raw) == 26 + length + 4 <= 26 + 8192 + 4
    assert struct.unpack("<I", raw[-4:])[0] == zlib.crc32(raw[2:-4])
    if kind == 0x12:
        channels, samples = struct.unpack_from("<HH", raw, 30)
        assert length == 12 + channels * samples
    elif kind in (0x15, 0x17):
        # Rows, steps and width of a number stand behind the scan's number, or first.
        rows, steps, width = struct.unpack_from("<HHH", raw, 30 if kind == 0x15 else 26)
        assert length == (18 if kind == 0x15 else 10) + rows * steps * width
    else:
        assert length == _LENGTHS[kind]
    return Head(kind, session, sequence, stamp_us, ttl_ms)


class Oracle:
    """Follows what a port acted upon, and says where it must not have."""

    def __init__(self, line: str) -> None:
        self._kinds = _SENT_OVER[line]
        self._sessions: list[int] = []
        self._sequences: set[tuple[int, int]] = set()
        self._last = 0
        self._last_ns = 0
        self._differences: list[tuple[int, int]] = []

    def check(self, raw: bytes, arrival_ns: int) -> None:
        """``AssertionError`` where the frame, coming now, must not be acted upon."""
        head = head_of_right_bytes(raw)
        assert head.kind in self._kinds
        assert head.session != 0
        difference = arrival_ns - head.stamp_us * 1000
        if not self._sessions or head.session != self._sessions[-1]:
            assert not self._sessions or arrival_ns - self._last_ns >= 200_000_000
            assert head.session not in self._sessions[-16:]
            self._sessions.append(head.session)
            self._differences = []
        else:
            assert 0 < (head.sequence - self._last) % 2**32 < 2**31
            # Least since the session began, one part in 5000 more for each ns since: never over that.
            least = min(delay + (arrival_ns - at) // 5000 for at, delay in self._differences)
            assert head.ttl_ms == 0 or difference - least <= head.ttl_ms * 1_000_000 + 1000
        assert (head.session, head.sequence) not in self._sequences
        self._sequences.add((head.session, head.sequence))
        self._last, self._last_ns = head.sequence, arrival_ns
        # Only those that may still be the least one are kept.
        self._differences = [
            (at, delay) for at, delay in self._differences if delay + (arrival_ns - at) // 5000 < difference
        ] + [(arrival_ns, difference)]
