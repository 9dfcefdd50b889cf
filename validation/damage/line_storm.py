"""Frames, garbage and lies over each kind of line: nothing wrong is ever acted upon."""

import random
from functools import reduce
from itertools import pairwise
from operator import xor

from lgprjax.runtime.gnss import GnssParser, read_gnss
from lgprjax.runtime.stamps import StampClock
from lgprjax.wire import KEPT, FrameParser, FrameVerdict, Receiver, RefusedBytes
from runtime.line_vectors import MESSAGES, frame_of, good_frames, head_of, payload_of
from validation.damage.line_oracle import Oracle, head_of_right_bytes

MS = 1_000_000
_PAYLOADS = [(vector["name"], payload_of(vector["name"], vector["fields"])) for vector in good_frames()]
_OF_LINE = {
    "radar": ("radar_scan", "radar_health", "radar_sweep", "radar_lookup"),
    "drive_by_wire": ("drive_status",),
    "controller": ("controller_",),
}

Piece = tuple[int, bytes, bool]


class Stream:
    """What comes over a line: chunks with their arrivals, and whether they are of the true sender and whole."""

    def __init__(self, line: str, seed: int) -> None:
        self.random = random.Random(seed)
        of_line = [(name, payload) for name, payload in _PAYLOADS if name.startswith(_OF_LINE[line])]
        if line == "radar":
            full = bytes.fromhex("00000000 0b00 7101 ff070000") + self.random.randbytes(11 * 369)
            of_line = of_line * 20 + [("radar_scan", full)]
        self.payloads = [(name, payload) for name, payload in of_line if name != "controller_light"]
        self.session, self.sequence, self.now_ms = 100, 0, 5000
        self.sent: list[bytes] = [b"\0"]

    def frame(self, *, session: int, sequence: int, stamp_ms: int, foreign: bool = False) -> bytes:
        name, payload = self.random.choice(_PAYLOADS if foreign else self.payloads)
        ttl_ms = self.random.choice([0, 20, 100, 200])
        return frame_of(MESSAGES[name][0], payload, head_of(session, sequence % 2**32, stamp_ms * 1000, ttl_ms))

    def true_frame(self) -> bytes:
        self.sequence += self.random.choice([1, 1, 1, 1, 3])
        raw = self.frame(session=self.session, sequence=self.sequence, stamp_ms=self.now_ms - 1000)
        self.sent.append(raw)
        return raw

    def lie(self) -> bytes:
        """Bytes that must not be acted upon, but for luck; each is of a kind of its own."""
        chosen, now = self.random, self.now_ms - 1000
        old = bytearray(chosen.choice(self.sent[-500:]))
        match chosen.randrange(10):
            case 0:
                return chosen.randbytes(chosen.randrange(1, 200))
            case 1:
                for _ in range(chosen.randrange(1, 4)):
                    old[chosen.randrange(len(old))] ^= 1 << chosen.randrange(8)
                return bytes(old)
            case 2:
                return bytes(old[: chosen.randrange(len(old))])
            case 3:
                return bytes(old)
            case 4:
                return self.frame(session=chosen.choice([0, 1, 2, 3, 99]), sequence=self.sequence, stamp_ms=now)
            case 5:
                late = self.frame(session=self.session, sequence=self.sequence + 1, stamp_ms=max(0, now - 5000))
                return late + late
            case 6:
                return self.frame(session=self.session, sequence=self.sequence + 1, stamp_ms=now + 10_000)
            case 7:
                return self.frame(session=self.session, sequence=self.sequence, stamp_ms=now, foreign=True)
            case 8:
                return b"\xa5\x5a\x01" + chosen.randbytes(chosen.randrange(40))
            case _:
                at = chosen.randrange(len(old))
                return bytes(old[:at]) + chosen.randbytes(3) + bytes(old[at:])

    def pieces(self, total: int) -> list[Piece]:
        """Chunks of ``total`` bytes together, cut anywhere."""
        found: list[Piece] = []
        count = 0
        while count < total:
            self.now_ms += self.random.choice([1, 5, 10, 20])
            kind = self.random.randrange(1000)
            if kind < 5:
                # The sender starts anew, after a silence or at once; the old one may be heard again.
                self.now_ms += self.random.choice([0, 190, 210, 1000])
                self.session += 1
                self.sequence = self.random.choice([0, 2**32 - 20, 2**31 - 5])
            lie = kind % 5 < 2
            raw = self.lie() if lie else self.true_frame()
            cut = self.random.randrange(len(raw) + 1) if self.random.random() < 0.3 else 0
            found += [(self.now_ms, part, False) for part in (raw[:cut],) if part]
            found.append((self.now_ms + (cut > 0), raw[cut:], not lie))
            self.now_ms += cut > 0
            count += len(raw)
        return found


def check_line(line: str, total: int) -> int:
    """Send so many bytes over a line of frames; how many frames were accepted."""
    pieces = Stream(line, seed=11).pieces(total)
    parser, receiver, oracle = FrameParser(), Receiver(line), Oracle(line)
    accepted, whole = 0, 0
    for at_ms, data, true in pieces:
        whole += true
        for item in parser.feed(data):
            if isinstance(item, RefusedBytes):
                assert 0 < len(item.data) <= KEPT
            elif receiver.accept(item, at_ms * MS) is FrameVerdict.ACCEPTED:
                oracle.check(item.raw, at_ms * MS)
                accepted += 1
            else:
                head_of_right_bytes(item.raw)
        assert len(parser._buffer) <= 26 + 8192 + 4
    assert accepted > 0.4 * whole
    assert parser.counts.total() > total // 1000
    assert set(receiver.counts) == set(FrameVerdict)
    return accepted


def _right(raw: bytes) -> bool:
    """Whether a GNSS message's checksum is right, by the book."""
    if raw[:1] == b"$":
        return raw[-3:-2] == b"*" and int(raw[-2:], 16) == reduce(xor, raw[1:-3], 0)
    a = b = 0
    for byte in raw[2:-2]:
        a = (a + byte) % 256
        b = (b + a) % 256
    return raw[:2] == b"\xb5\x62" and len(raw) == 8 + raw[4] + 256 * raw[5] and raw[-2:] == bytes([a, b])


def check_gnss(most: int) -> int:
    """Send so many bytes of GNSS messages, right and wrong; how many came out whole."""
    chosen = random.Random(13)
    messages = [b"$GPHDT,12.5,T*03\r\n", b"$GNROT,-60.0,A*34\r\n"]
    for kind, size in ((b"\x01\x07", 92), (b"\x01\x05", 32), (b"\x10\x15", 36), (b"\x02\x15", 600)):
        for _ in range(10):
            body = kind + bytes([size % 256, size // 256]) + chosen.randbytes(size)
            a = sum(body) % 256
            b = sum((len(body) - at) * byte for at, byte in enumerate(body)) % 256
            messages.append(b"\xb5\x62" + body + bytes([a, b]))
    parser, clock = GnssParser(), StampClock()
    total, whole, read = 0, 0, 0
    told: list[int] = []
    while total < most:
        data = bytearray(chosen.choice(messages))
        for _ in range(chosen.choice([0, 0, 0, 1, 2])):
            match chosen.randrange(4):
                case 0:
                    data[chosen.randrange(len(data))] ^= 1 << chosen.randrange(8)
                case 1:
                    data = data[: chosen.randrange(1, len(data) + 1)]
                case 2:
                    data += chosen.randbytes(chosen.randrange(60))
                case _:
                    data += b"\xb5\x62\x01\x07" + chosen.randbytes(2)
        total += len(data)
        for item in parser.feed(bytes(data)):
            if isinstance(item, RefusedBytes):
                assert 0 < len(item.data) <= KEPT
                continue
            assert _right(item)
            whole += 1
            # Every fourth is read too: random fields behind right checksums.
            if whole % 4 == 0 and (sample := read_gnss(item)) is not None:
                read += 1
                part = sample.position or sample.attitude or sample.rate
                assert part is not None
                if part.tow_s == part.tow_s:
                    time = clock.feed(round(part.tow_s * 1e6), total * 10_000)
                    told += [] if time is None else [time]
        assert len(parser._buffer) <= 4096 + 8
    assert whole > most // 400
    assert read > most // 20_000
    assert parser.counts.total() > most // 1000
    assert all(left < right for left, right in pairwise(told))
    return whole
