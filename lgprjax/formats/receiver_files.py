"""Files of satellite receivers that accompany survey lines: NMEA sentences, ``.GPS``, ``.DZG`` and ``.cor``."""

import math
import re
from array import array
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np

from lgprjax.errors import InputError
from lgprjax.formats.plausible import plausible_positions, reach_in_time_m
from lgprjax.formats.profile import read_bytes
from lgprjax.formats.side_positions import HeightReference, SidePositions

# Fixes in the NMEA sentences written by recorders: complete sentences only, the rest is counted.

_WHOLE = re.compile(r"\$([^*$]*)\*([0-9A-Fa-f]{2})")
_ANGLE = {"latitude": (re.compile(r"(\d{2})(\d{2}(?:\.\d{1,12})?)", re.ASCII), "NS", 90.0)}
_ANGLE["longitude"] = (re.compile(r"(\d{3})(\d{2}(?:\.\d{1,12})?)", re.ASCII), "EW", 180.0)
_CLOCK = re.compile(r"(\d{2})(\d{2})(\d{2}(?:\.\d{1,9})?)", re.ASCII)
# Single, differential, encrypted, fixed and float. The other codes mean: no fix, dead reckoning, manual, simulated.
_MEASURED = ("1", "2", "3", "4", "5")


class NmeaFix(NamedTuple):
    """A receiver's fix; NaN for values missing in the sentence.

    Attributes:
        latitude_deg, longitude_deg: WGS-84 position.
        altitude_m: height above sea level.
        separation_m: height of sea level above the ellipsoid.
        time_s: UTC since midnight.
        quality: code of GGA, 1 to 5.
        satellites: number of satellites in use.
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
    """The kind, ``GGA`` or ``RMC``, and the fix of the text from one ``$`` to the next or to the end of the line.

    The fix is ``None`` if the sentence states none; the result is ``None`` for other kinds and damaged sentences.
    ``tally`` counts all under ``sentences``, and of them those without the end that holds the checksum (``cut``) and
    those with a wrong checksum (``failed checksum``).
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
        altitude_m=_nmea_number(fields[8], -1e4, 1e5) if fields[9] == "M" else math.nan,
        separation_m=_nmea_number(fields[10], -200.0, 200.0) if fields[11] == "M" else math.nan,
        time_s=_clock(fields[0]),
        quality=float(fields[5]),
        satellites=_nmea_number(fields[6], 0.0, 200.0),
        hdop=_nmea_number(fields[7], 0.0, 1e3),
    )


def _rmc(fields: list[str]) -> NmeaFix:
    if fields[1] != "A":
        raise ValueError
    latitude, longitude = _angle("latitude", fields[2], fields[3]), _angle("longitude", fields[4], fields[5])
    unsaid = math.nan
    return NmeaFix(
        latitude_deg=latitude,
        longitude_deg=longitude,
        altitude_m=unsaid,
        separation_m=unsaid,
        time_s=_clock(fields[0]),
        quality=unsaid,
        satellites=unsaid,
        hdop=unsaid,
    )


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


def _nmea_number(text: str, low: float, high: float) -> float:
    """The number within its range; NaN for an empty field. Raises ``ValueError``."""
    if not text:
        return math.nan
    value = float(text)
    if not low <= value <= high:
        raise ValueError
    return value


# Files of satellite receivers, trace by trace: ``.GPS``, ``.DZG`` and ``.cor``.

_GPS_TRACE = re.compile(r"\s?Trace #(\d{1,9}) at position \S{1,40}\s?", re.ASCII)
_DZG_SCAN = re.compile(r"\$GSSIS,\s?(\d{1,9})\s?(?:,|$)", re.ASCII)
_THREE_LETTERS = re.compile(r"[a-z]{3}")
_TALLIED = ("sentences", "failed checksum", "cut")
_COR_ROW = re.compile(
    r"(\d{1,9}) \d{4}-\d\d-\d\d (\d\d):(\d\d):(\d\d(?:\.\d{1,9})?) (\d{1,2}(?:\.\d{1,15})?) ([NS]) "
    r"(\d{1,3}(?:\.\d{1,15})?) ([EW]) (-?\d{1,5}(?:\.\d{1,15})?) M(?: (\d{1,4}(?:\.\d{1,15})?))?",
    re.ASCII,
)


def read_gps(path: str | Path) -> SidePositions:
    """Read a ``.GPS`` file of Sensors & Software: lines ``Trace #N at position P``, each before NMEA sentences.

    A trace has the place of its first GGA sentence with a fix, or of RMC where the file has no GGA. Sentences that are
    cut or have a wrong checksum are left out. Heights are ellipsoidal if every fix states its separation.

    Raises:
        InputError: the file is missing or another format, the numbers of its traces fall, or no trace has a fix.
    """
    return _read_sentences(Path(path), _trace_of_gps, "'Trace #N at position P' or a NMEA sentence")


def read_dzg(path: str | Path) -> SidePositions:
    """Read a ``.DZG`` file of GSSI: lines ``$GSSIS,scan,...``, each before NMEA sentences; scans count from 0.

    Sentences are read as by ``read_gps``.

    Raises:
        InputError: the file is missing or another format, the numbers of its scans fall, or no scan has a fix.
    """
    return _read_sentences(Path(path), _trace_of_dzg, "'$GSSIS,scan,...' or a NMEA sentence")


def read_cor(path: str | Path) -> SidePositions:
    """Read a ``.cor`` file of MALA: a row a fix of trace, date, time, latitude, N or S, longitude, E or W, height, M.

    Traces count from 1, or from 0 if the first row has 0. A tenth column is the dilution of precision.

    Raises:
        InputError: the file is missing, a row is malformed, the numbers of its traces fall, or no row has a fix.
    """
    file = Path(path)
    text = read_bytes(file).decode("latin-1")
    rows = _Rows(file)
    first: int | None = None
    for line, match in enumerate(re.finditer(r"([^\r\n]*)(?:\r{0,2}\n|\r|$)", text), start=1):
        cells = re.split(r"[\t,; ]+", match[1].strip())
        if cells == [""]:
            continue
        place = f"line {line}"
        parts = _COR_ROW.fullmatch(" ".join(cells))
        fix = None if parts is None else _fix_of_cor(parts)
        if parts is None or fix is None:
            expected = "trace, date, time, latitude, N or S, longitude, E or W, height, M"
            raise InputError(file, place, expected, repr(match[1][:60]))
        first = int(parts[1]) if first is None else first
        rows.begin(int(parts[1]) - min(first, 1), place)
        rows.add(fix)
    return rows.positions("unstated", {})


def _trace_of_gps(token: str) -> int | None:
    """Index of the trace in a line, ``None`` for a sentence. Raises ``ValueError`` for a damaged line."""
    named = _GPS_TRACE.fullmatch(token)
    if named is not None and int(named[1]) > 0:
        return int(named[1]) - 1
    # Sentences have no lower case. This was a damaged trace line, and its fix would go to the previous trace.
    if _THREE_LETTERS.search(token):
        raise ValueError
    return None


def _trace_of_dzg(token: str) -> int | None:
    """Trace number of a DZG token, as ``_trace_of_gps``."""
    if not token.startswith("$GSSIS"):
        return None
    named = _DZG_SCAN.match(token)
    if named is None:
        raise ValueError
    return int(named[1])


def _read_sentences(file: Path, trace_of: Callable[[str], int | None], expected: str) -> SidePositions:
    text = read_bytes(file).decode("latin-1")
    tally: Counter[str] = Counter()
    gga, rmc = _Rows(file), _Rows(file)
    # A line may hold several sentences, the first of them cut; text before the first $ is the end of one.
    for match in re.finditer(r"\$[^$\r\n]*|[^$\r\n]+", text):
        try:
            trace = trace_of(match[0])
        except ValueError:
            line = text.count("\n", 0, match.start()) + 1
            raise InputError(file, f"line {line}", expected, repr(match[0][:40])) from None
        if trace is not None:
            gga.begin(trace, f"trace {trace}")
            rmc.begin(trace, f"trace {trace}")
        elif match[0].startswith("$"):
            read = fix_of_sentence(match[0], tally)
            if read is not None:
                (gga if read[0] == "GGA" else rmc).add(read[1])
    return (gga if gga.sentences else rmc).positions(None, {name: tally[name] for name in _TALLIED})


def _fix_of_cor(parts: re.Match[str]) -> NmeaFix | None:
    hours, minutes, seconds, latitude, longitude = (float(parts[at]) for at in (2, 3, 4, 5, 7))
    if hours > 23 or minutes > 59 or seconds >= 61 or latitude > 90 or longitude > 180:
        return None
    return NmeaFix(
        latitude_deg=latitude if parts[6] == "N" else -latitude,
        longitude_deg=longitude if parts[8] == "E" else -longitude,
        altitude_m=float(parts[9]),
        separation_m=np.nan,
        time_s=3600.0 * hours + 60.0 * minutes + seconds,
        quality=np.nan,
        satellites=np.nan,
        hdop=np.nan if parts[10] is None else float(parts[10]),
    )


class _Rows:
    """The first fix of each trace, in file order."""

    def __init__(self, file: Path) -> None:
        self._file = file
        self._trace: int | None = None
        self._filled = False
        self._traces = self._without_fix = self.sentences = 0
        # A flat array: Python's own objects would need many times the size of the file.
        self._values = array("d")

    def begin(self, trace: int, place: str) -> None:
        """Start a trace, or continue the last one. Raises ``InputError`` for an earlier one."""
        if trace == self._trace:
            return
        if self._trace is not None and trace < self._trace:
            raise InputError(self._file, place, f"a trace after {self._trace} (counted from 0)", f"{trace}")
        self._traces += 1
        self._trace, self._filled = trace, False

    def add(self, fix: NmeaFix | None) -> None:
        """Add a fix after the line of a trace; the first one is nearest in time. ``None`` means no fix."""
        self.sentences += 1
        if fix is None:
            self._without_fix += 1
        elif self._trace is not None and not self._filled:
            self._values.extend((self._trace, *fix))
            self._filled = True

    def positions(self, height: HeightReference | None, counts: dict[str, int]) -> SidePositions:
        """All rows; without ``height`` they are NMEA's. Raises ``InputError`` without any row."""
        table = np.array(self._values).reshape(-1, 1 + len(NmeaFix._fields)).T
        # Times of day: midnight is a step of some seconds.
        steps_s = (np.diff(table[5], prepend=table[5, :1]) + 43_200.0) % 86_400.0 - 43_200.0
        judged = plausible_positions(table[1], table[2], reach_in_time_m(np.cumsum(steps_s)))
        counts = {"traces": self._traces, **counts, "without fix": self._without_fix, **judged.left_out}
        if not judged.kept.any():
            counts_text = ", ".join(f"{name} {count}" for name, count in counts.items())
            raise InputError(self._file, "positions", "at least one trace with a fix", f"none ({counts_text})")
        table = table[:, judged.kept]
        trace, latitude, longitude, z, separation, time_s, quality, satellites, hdop = table
        if height is None:
            height = "sea level" if np.isnan(separation).any() else "ellipsoid"
            z = z + separation if height == "ellipsoid" else z
        repeated = int(np.count_nonzero(np.diff(time_s) == 0))
        return SidePositions(
            path=self._file,
            kind="degrees",
            trace=trace,
            numbered=True,
            x=longitude,
            y=latitude,
            z=z,
            height=height,
            time_s=time_s,
            quality=quality,
            satellites=satellites,
            hdop=hdop,
            counts={"rows": len(trace), **counts, "repeated": repeated},
        )
