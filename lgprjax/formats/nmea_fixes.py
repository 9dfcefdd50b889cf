"""Fixes in the NMEA sentences that recorders write beside their traces: whole sentences only, the rest is counted."""

import math
import re
from collections import Counter
from typing import NamedTuple

_WHOLE = re.compile(r"\$([^*$]*)\*([0-9A-Fa-f]{2})")
_ANGLE = {"latitude": (re.compile(r"(\d{2})(\d{2}(?:\.\d{1,12})?)", re.ASCII), "NS", 90.0)}
_ANGLE["longitude"] = (re.compile(r"(\d{3})(\d{2}(?:\.\d{1,12})?)", re.ASCII), "EW", 180.0)
_CLOCK = re.compile(r"(\d{2})(\d{2})(\d{2}(?:\.\d{1,9})?)", re.ASCII)
# Single, differential, encrypted, fixed and float. The other codes say: no fix, dead reckoning, typed in, simulated.
_MEASURED = ("1", "2", "3", "4", "5")


class NmeaFix(NamedTuple):
    """Where a receiver was; NaN for what its sentence does not say.

    Attributes:
        latitude_deg, longitude_deg: WGS-84.
        altitude_m: above sea level.
        separation_m: of sea level above the ellipsoid.
        time_s: UTC, since midnight.
        quality: code of GGA, 1 to 5.
        satellites: those in use.
        hdop: horizontal dilution of precision.
    """

    latitude_deg: float
    longitude_deg: float
    altitude_m: float
    separation_m: float
    time_s: float
    quality: float
    satellites: float
    hdop: float


def fix_of_sentence(text: str, tally: Counter[str]) -> tuple[str, NmeaFix | None] | None:
    """The kind, ``GGA`` or ``RMC``, and the fix of what stands from one ``$`` to the next or to the end of the line.

    The fix is ``None`` where the sentence states none; the whole is for other kinds and for damaged sentences.
    ``tally`` counts all under ``sentences``, and of them those without the end that holds the checksum (``cut``) and
    those that the checksum refutes (``failed checksum``).
    """
    tally["sentences"] += 1
    whole = _WHOLE.match(text)
    if whole is None:
        tally["cut"] += 1
        return None
    checksum = 0
    for character in whole[1].encode("latin-1"):
        checksum ^= character
    if checksum != int(whole[2], 16):
        tally["failed checksum"] += 1
        return None
    address, *fields = whole[1].split(",")
    kind = address[-3:]
    if len(address) != 5 or kind not in _FIX_OF:
        return None
    try:
        return kind, _FIX_OF[kind](fields)
    except (ValueError, IndexError):
        return kind, None


def _gga(fields: list[str]) -> NmeaFix:
    if fields[5] not in _MEASURED:
        raise ValueError
    return NmeaFix(
        latitude_deg=_angle("latitude", fields[1], fields[2]),
        longitude_deg=_angle("longitude", fields[3], fields[4]),
        altitude_m=_number(fields[8], -1e4, 1e5) if fields[9] == "M" else math.nan,
        separation_m=_number(fields[10], -200.0, 200.0) if fields[11] == "M" else math.nan,
        time_s=_clock(fields[0]),
        quality=float(fields[5]),
        satellites=_number(fields[6], 0.0, 200.0),
        hdop=_number(fields[7], 0.0, 1e3),
    )


def _rmc(fields: list[str]) -> NmeaFix:
    if fields[1] != "A":
        raise ValueError
    latitude, longitude = _angle("latitude", fields[2], fields[3]), _angle("longitude", fields[4], fields[5])
    unsaid = math.nan
    return NmeaFix(latitude, longitude, unsaid, unsaid, _clock(fields[0]), unsaid, unsaid, unsaid)


_FIX_OF = {"GGA": _gga, "RMC": _rmc}


def _angle(name: str, text: str, side: str) -> float:
    """Degrees of ``dddmm.mmmm`` and the letter of a side. Raises ``ValueError``."""
    form, sides, limit = _ANGLE[name]
    parts = form.fullmatch(text)
    if parts is None or side not in tuple(sides) or float(parts[2]) >= 60.0:
        raise ValueError
    degrees = int(parts[1]) + float(parts[2]) / 60.0
    if degrees > limit:
        raise ValueError
    return degrees if side == sides[0] else -degrees


def _clock(text: str) -> float:
    """Seconds since midnight; a leap second is the sixty-first. Raises ``ValueError``."""
    parts = _CLOCK.fullmatch(text)
    if parts is None or int(parts[1]) > 23 or int(parts[2]) > 59 or float(parts[3]) >= 61.0:
        raise ValueError
    return 3600.0 * int(parts[1]) + 60.0 * int(parts[2]) + float(parts[3])


def _number(text: str, low: float, high: float) -> float:
    """The number within its range; NaN for an empty field. Raises ``ValueError``."""
    if not text:
        return math.nan
    value = float(text)
    if not low <= value <= high:
        raise ValueError
    return value
