"""GNSS/INS receivers: NMEA sentences and UBX messages from a byte stream, and their samples."""

import math
import re
from collections import Counter
from collections.abc import Callable
from enum import IntEnum
from functools import reduce
from itertools import accumulate
from operator import xor
from typing import Any, NamedTuple

from pynmeagps import NMEAReader
from pyubx2 import UBXReader

from lgprjax.runtime.stamps import GnssTimeScale
from lgprjax.wire import KEPT, RefusalReason, RefusedBytes

# Samples of GNSS/INS receivers, in the units of this project.


class Quality(IntEnum):
    """Quality of a position."""

    NONE = 0
    SINGLE = 1
    FLOAT = 2
    FIXED = 3


class GnssPosition(NamedTuple):
    """A position of the antenna or of the receiver's configured point.

    Attributes:
        tow_s: time of week or day, on the sample's scale.
        latitude_deg, longitude_deg, height_m: WGS-84, ellipsoidal; NaN if the quality is ``NONE``, the height also if
            the receiver states no geoid separation.
        sigma_m: horizontal standard deviation per axis; NaN if not stated.
        quality: quality of the position.
    """

    tow_s: float
    latitude_deg: float
    longitude_deg: float
    height_m: float
    sigma_m: float
    quality: Quality


class Accuracy(NamedTuple):
    """Sigma of the position of the same time, of one axis, from a separate message (NMEA GST)."""

    tow_s: float
    sigma_m: float


class GnssAttitude(NamedTuple):
    """Attitude of the vehicle.

    Attributes:
        tow_s: time of week or day; NaN if the message has none.
        heading_deg: clockwise from true north, in [0, 360).
        roll_deg: positive right side down; NaN if not stated.
        sigma_heading_deg: NaN if not stated.
    """

    tow_s: float
    heading_deg: float
    roll_deg: float
    sigma_heading_deg: float


class Rate(NamedTuple):
    """Turn rate of the vehicle.

    Attributes:
        tow_s: time of week or day; NaN if the message has none.
        yaw_rate_radps: counter-clockwise positive, seen from above.
    """

    tow_s: float
    yaw_rate_radps: float


class GnssSample(NamedTuple):
    """Contents of one message; exactly one part is present.

    Attributes:
        scale: time scale of the part's ``tow_s``.
    """

    scale: GnssTimeScale
    position: GnssPosition | None = None
    accuracy: Accuracy | None = None
    attitude: GnssAttitude | None = None
    rate: Rate | None = None


def read_gnss(raw: bytes) -> GnssSample | None:
    """Sample of a message; ``None`` if it has nothing of use, or is invalid. Never raises."""
    try:
        if raw[:1] == b"$":
            read = _NMEA.get(raw[1:6] if raw[1:2] == b"P" else raw[3:6])
            return read(NMEAReader.parse(raw)) if read else None
        length, read = _UBX.get(raw[2:4], (0, None))
        # The library reads missing data at the end as zeros.
        return read(UBXReader.parse(raw)) if read and len(raw) == length + 8 else None
    # The libraries raise any error of their conversions; a message that they cannot read is ignored.
    except Exception:
        return None


def is_position(raw: bytes) -> bool:
    """Whether a message is of a kind that holds a position; of the others nothing needs to be decoded."""
    return raw[3:6] == b"GGA" if raw[:1] == b"$" else raw[2:4] == _NAV_PVT


class _InvalidError(ValueError):
    """A field that is missing, not a number or out of its range."""


def _within(value: Any, low: float, high: float) -> float:
    if isinstance(value, int | float) and low <= value <= high:
        return float(value)
    raise _InvalidError


def _or_nan(value: Any, low: float, high: float) -> float:
    try:
        return _within(value, low, high)
    except _InvalidError:
        return math.nan


def _week_s(message: Any) -> float:
    return _within(message.iTOW, 0.0, GnssTimeScale.GPS_WEEK * 1e3 - 1.0) / 1e3


def _day_s(message: Any) -> float:
    # By hand: the library has no time for a leap second.
    text = message.payload[0]
    minutes = int(text[:2]) * 60 + int(text[2:4])
    if not text[:6].isdecimal() or int(text[:2]) > 23 or int(text[2:4]) > 59:
        raise _InvalidError
    return 60 * minutes + _within(float(text[4:]), 0.0, 60.999999)


def _heading(value: Any) -> float:
    return _within(value, 0.0, 360.0) % 360.0


def _position(
    scale: GnssTimeScale, tow_s: float, message: Any, height_m: Any, sigma_m: float, q: Quality
) -> GnssSample:
    if q is Quality.NONE:
        return GnssSample(scale, position=GnssPosition(tow_s, math.nan, math.nan, math.nan, math.nan, q))
    latitude, longitude = _within(message.lat, -90.0, 90.0), _within(message.lon, -180.0, 180.0)
    height = math.nan if math.isnan(height_m) else _within(height_m, -1e3, 2e4)
    return GnssSample(scale, position=GnssPosition(tow_s, latitude, longitude, height, sigma_m, q))


def _gga(message: Any) -> GnssSample:
    quality = {1: Quality.SINGLE, 2: Quality.SINGLE, 3: Quality.SINGLE, 4: Quality.FIXED, 5: Quality.FLOAT}
    q = quality.get(message.quality, Quality.NONE)
    height = _within(message.alt, -1e4, 1e5) if q else math.nan
    height += _within(message.sep, -200.0, 200.0) if message.sep != "" else math.nan
    return _position(GnssTimeScale.UTC_DAY, _day_s(message), message, height, math.nan, q)


def _gst(message: Any) -> GnssSample:
    sigma = math.hypot(_within(message.stdLat, 0.0, 1e5), _within(message.stdLong, 0.0, 1e5)) / math.sqrt(2.0)
    return GnssSample(GnssTimeScale.UTC_DAY, accuracy=Accuracy(_day_s(message), _within(sigma, 1e-4, 1e5)))


def _untimed_heading(value: Any, valid: bool) -> GnssSample | None:
    attitude = GnssAttitude(math.nan, _heading(value), math.nan, math.nan)
    return GnssSample(GnssTimeScale.NONE, attitude=attitude) if valid else None


def _rot(message: Any) -> GnssSample | None:
    # Degrees a minute, to starboard positive.
    rate = -math.radians(_within(message.rot, -6e4, 6e4)) / 60.0
    return GnssSample(GnssTimeScale.NONE, rate=Rate(math.nan, rate)) if message.valid == "A" else None


def _pashr(message: Any) -> GnssSample | None:
    if message.trueHdgInd != "T":
        return None
    roll, sigma = _or_nan(message.roll, -180.0, 180.0), _or_nan(message.hdgAcc, 1e-4, 180.0)
    attitude = GnssAttitude(_day_s(message), _heading(message.trueHdg), roll, sigma)
    return GnssSample(GnssTimeScale.UTC_DAY, attitude=attitude)


def _nav_pvt(message: Any) -> GnssSample:
    whole = message.gnssFixOk and message.fixType in (3, 4) and not message.invalidLlh
    q = {0: Quality.SINGLE, 1: Quality.FLOAT, 2: Quality.FIXED}.get(message.carrSoln, Quality.NONE)
    # hAcc is of both axes together: as the sigma of one it is conservative.
    sigma = _or_nan(message.hAcc / 1000.0, 1e-4, 1e5)
    height = message.height / 1000.0
    return _position(GnssTimeScale.GPS_WEEK, _week_s(message), message, height, sigma, q if whole else Quality.NONE)


def _nav_att(message: Any) -> GnssSample:
    # An accuracy of 0 means that the angle is unknown.
    sigma = _within(message.accHeading, 1e-5, 180.0)
    roll = _or_nan(message.roll, -180.0, 180.0) if message.accRoll else math.nan
    return GnssSample(
        GnssTimeScale.GPS_WEEK, attitude=GnssAttitude(_week_s(message), _heading(message.heading), roll, sigma)
    )


def _nav_relposned(message: Any) -> GnssSample | None:
    # Between two antennas of the vehicle, the base moving too; the direction to a fixed base is no heading.
    if not (message.relPosValid and message.relPosHeadingValid and message.isMoving and message.carrSoln == 2):
        return None
    sigma = _within(message.accHeading, 1e-5, 180.0)
    attitude = GnssAttitude(_week_s(message), _heading(message.relPosHeading), math.nan, sigma)
    return GnssSample(GnssTimeScale.GPS_WEEK, attitude=attitude)


def _esf_ins(message: Any) -> GnssSample | None:
    # Degrees a second about the axis that points down.
    rate = -math.radians(_within(message.zAngRate, -1000.0, 1000.0))
    return GnssSample(GnssTimeScale.GPS_WEEK, rate=Rate(_week_s(message), rate)) if message.zAngRateValid else None


_Reader = Callable[[Any], GnssSample | None]
_NMEA: dict[bytes, _Reader] = {
    b"GGA": _gga,
    b"GST": _gst,
    b"HDT": lambda message: _untimed_heading(message.headingT, message.headingTu == "T"),
    b"THS": lambda message: _untimed_heading(message.headt, message.mi == "A"),
    b"ROT": _rot,
    b"PASHR": _pashr,
}
_NAV_PVT = b"\x01\x07"
_UBX: dict[bytes, tuple[int, _Reader]] = {  # with the length of the payload
    _NAV_PVT: (92, _nav_pvt),
    b"\x01\x05": (32, _nav_att),
    b"\x01\x3c": (64, _nav_relposned),
    b"\x10\x15": (36, _esf_ins),
}


__all__ = [
    "Accuracy",
    "GnssAttitude",
    "GnssParser",
    "GnssPosition",
    "GnssSample",
    "Quality",
    "Rate",
    "is_position",
    "read_gnss",
]

_GNSS_UBX = b"\xb5\x62"
_UBX_AROUND = 8  # sync, class, number, length, then two of checksum
_LARGEST_UBX = 4096
_LONGEST_NMEA = 256
_BEGIN = re.compile(rb"\$|\xb5\x62?")
_BODY = re.compile(rb"[ -#%-)+-~]*")  # printable, without $ and *


class GnssParser:
    """Extracts complete messages with valid checksums from a stream of bytes. It buffers one message at most.

    Attributes:
        counts: number of refusals, by reason.
    """

    def __init__(self) -> None:
        self._buffer = bytearray()
        self.counts: Counter[RefusalReason] = Counter()

    def feed(self, data: bytes) -> list[bytes | RefusedBytes]:
        """Complete messages, sentences without line ends, and refused bytes, in order."""
        self._buffer += data
        return self._take(ended=False)

    def finish(self) -> list[bytes | RefusedBytes]:
        """The rest at the end of a file: an unfinished message is refused, and the messages within it are found."""
        return self._take(ended=True)

    def _take(self, *, ended: bool) -> list[bytes | RefusedBytes]:
        buffer = self._buffer
        found: list[bytes | RefusedBytes] = []
        at = 0
        while at < len(buffer):
            if buffer[at] in b"\r\n":
                at += 1
                continue
            what = _message_at(buffer, at) or ((RefusalReason.CUT,) if ended else None)
            if what is None:
                break
            if isinstance(what, int):
                end = what
                found.append(bytes(buffer[at:end]))
            else:
                begin = _BEGIN.search(buffer, at + 1)
                end = begin.start() if begin else len(buffer)
                found.append(RefusedBytes(what[0], bytes(buffer[at : min(end, at + KEPT)])))
                self.counts[what[0]] += 1
            at = end
        del buffer[:at]
        return found


def _message_at(buffer: bytearray, at: int) -> int | tuple[RefusalReason] | None:
    """End of the message that begins at ``at``, the reason of its refusal, or ``None`` if it is incomplete."""
    if buffer[at] == ord("$"):
        return _sentence_at(buffer, at)
    if buffer.startswith(_GNSS_UBX[: len(buffer) - at], at):
        return _ubx_at(buffer, at)
    return (RefusalReason.NO_SYNC,)


def _sentence_at(buffer: bytearray, at: int) -> int | tuple[RefusalReason] | None:
    body = _BODY.match(buffer, at + 1)
    star = body.end() if body else at + 1
    if star - at > _LONGEST_NMEA:
        return (RefusalReason.LENGTH,)
    if star == len(buffer):
        return None
    if buffer[star] != ord("*"):
        return (RefusalReason.CUT,)
    end = star + 3
    if len(buffer) < end:
        return None
    given = bytes(buffer[star + 1 : end])
    return end if given.upper() == b"%02X" % reduce(xor, buffer[at + 1 : star], 0) else (RefusalReason.CRC,)


def _ubx_at(buffer: bytearray, at: int) -> int | tuple[RefusalReason] | None:
    if len(buffer) - at < _UBX_AROUND - 2:
        return None
    length = int.from_bytes(buffer[at + 4 : at + 6], "little")
    if length > _LARGEST_UBX:
        return (RefusalReason.LENGTH,)
    end = at + _UBX_AROUND + length
    if len(buffer) < end:
        return None
    body = buffer[at + 2 : end - 2]
    # The sum alone sorts out nearly all garbage, at a tenth of the cost of the sum of sums.
    holds = sum(body) & 0xFF == buffer[end - 2] and sum(accumulate(body)) & 0xFF == buffer[end - 1]
    return end if holds else (RefusalReason.CRC,)
