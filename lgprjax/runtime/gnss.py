"""GNSS/INS receivers: NMEA sentences and UBX messages cut out of a stream of bytes."""

import re
from collections import Counter
from functools import reduce
from itertools import accumulate
from operator import xor

from lgprjax.runtime.gnss_samples import Accuracy, Attitude, GnssSample, Position, Quality, Rate, read_gnss
from lgprjax.runtime.refused import KEPT, Reason, Refused

__all__ = ["Accuracy", "Attitude", "GnssParser", "GnssSample", "Position", "Quality", "Rate", "read_gnss"]

_UBX = b"\xb5\x62"
_UBX_AROUND = 8  # sync, class, number, length, then two of checksum
_LARGEST_UBX = 4096
_LONGEST_NMEA = 256
_BEGIN = re.compile(rb"\$|\xb5\x62?")
_BODY = re.compile(rb"[ -#%-)+-~]*")  # printable, without $ and *


class GnssParser:
    """Cuts whole messages whose checksums hold out of a stream of bytes. It holds back one message at most.

    Attributes:
        counts: how often something was refused, by reason.
    """

    def __init__(self) -> None:
        self._buffer = bytearray()
        self.counts: Counter[Reason] = Counter()

    def feed(self, data: bytes) -> list[bytes | Refused]:
        """Messages that are whole now, sentences without their line's end, and what was refused, in their order."""
        buffer = self._buffer
        buffer += data
        found: list[bytes | Refused] = []
        at = 0
        while at < len(buffer):
            if buffer[at] in b"\r\n":
                at += 1
                continue
            what = _message_at(buffer, at)
            if what is None:
                break
            if isinstance(what, int):
                end = what
                found.append(bytes(buffer[at:end]))
            else:
                begin = _BEGIN.search(buffer, at + 1)
                end = begin.start() if begin else len(buffer)
                found.append(Refused(what[0], bytes(buffer[at : min(end, at + KEPT)])))
                self.counts[what[0]] += 1
            at = end
        del buffer[:at]
        return found


def _message_at(buffer: bytearray, at: int) -> int | tuple[Reason] | None:
    """Where the message ends that begins at ``at``, why there is none, or ``None`` where it is not whole yet."""
    if buffer[at] == ord("$"):
        return _sentence_at(buffer, at)
    if buffer.startswith(_UBX[: len(buffer) - at], at):
        return _ubx_at(buffer, at)
    return (Reason.NO_SYNC,)


def _sentence_at(buffer: bytearray, at: int) -> int | tuple[Reason] | None:
    body = _BODY.match(buffer, at + 1)
    star = body.end() if body else at + 1
    if star - at > _LONGEST_NMEA:
        return (Reason.LENGTH,)
    if star == len(buffer):
        return None
    if buffer[star] != ord("*"):
        return (Reason.CUT,)
    end = star + 3
    if len(buffer) < end:
        return None
    given = bytes(buffer[star + 1 : end])
    return end if given.upper() == b"%02X" % reduce(xor, buffer[at + 1 : star], 0) else (Reason.CRC,)


def _ubx_at(buffer: bytearray, at: int) -> int | tuple[Reason] | None:
    if len(buffer) - at < _UBX_AROUND - 2:
        return None
    length = int.from_bytes(buffer[at + 4 : at + 6], "little")
    if length > _LARGEST_UBX:
        return (Reason.LENGTH,)
    end = at + _UBX_AROUND + length
    if len(buffer) < end:
        return None
    body = buffer[at + 2 : end - 2]
    # The sum alone sorts out nearly all garbage, at a tenth of the cost of the sum of sums.
    holds = sum(body) & 0xFF == buffer[end - 2] and sum(accumulate(body)) & 0xFF == buffer[end - 1]
    return end if holds else (Reason.CRC,)
