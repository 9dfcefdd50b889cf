"""What a satellite receiver wrote trace by trace beside a line: ``.GPS``, ``.DZG`` and ``.cor``."""

import re
from array import array
from collections import Counter
from collections.abc import Callable
from pathlib import Path

import numpy as np

from lgprjax.errors import InputError
from lgprjax.formats.nmea_fixes import NmeaFix, fix_of_sentence
from lgprjax.formats.profile import read_bytes
from lgprjax.formats.side_positions import HeightReference, SidePositions

_GPS_TRACE = re.compile(r"\s?Trace #(\d{1,9}) at position \S{1,40}\s?", re.ASCII)
_DZG_SCAN = re.compile(r"\$GSSIS,\s?(\d{1,9})\s?(?:,|$)", re.ASCII)
_WORD = re.compile(r"[a-z]{3}")
_TALLIED = ("sentences", "failed checksum", "cut")
_COR_ROW = re.compile(
    r"(\d{1,9}) \d{4}-\d\d-\d\d (\d\d):(\d\d):(\d\d(?:\.\d{1,9})?) (\d{1,2}(?:\.\d{1,15})?) ([NS]) "
    r"(\d{1,3}(?:\.\d{1,15})?) ([EW]) (-?\d{1,5}(?:\.\d{1,15})?) M(?: (\d{1,4}(?:\.\d{1,15})?))?",
    re.ASCII,
)


def read_gps(path: str | Path) -> SidePositions:
    """Read a ``.GPS`` file of Sensors & Software: lines ``Trace #N at position P``, each before NMEA sentences.

    A trace has the place of its first GGA sentence with a fix, or of RMC where the file has no GGA. Sentences that
    are cut or that their checksum refutes are left out. Heights are ellipsoidal if every fix states its separation.

    Raises:
        InputError: the file is missing or another format, the numbers of its traces fall, or no trace has a fix.
    """
    return _read_sentences(Path(path), _trace_of_gps, "'Trace #N at position P' or a NMEA sentence")


def read_dzg(path: str | Path) -> SidePositions:
    """Read a ``.DZG`` file of GSSI: lines ``$GSSIS,scan,...``, each before NMEA sentences; scans count from 0.

    Sentences are taken as ``read_gps`` takes them.

    Raises:
        InputError: the file is missing or another format, the numbers of its scans fall, or no scan has a fix.
    """
    return _read_sentences(Path(path), _trace_of_dzg, "'$GSSIS,scan,...' or a NMEA sentence")


def read_cor(path: str | Path) -> SidePositions:
    """Read a ``.cor`` file of MALA: a row a fix of trace, date, time, latitude, N or S, longitude, E or W, height, M.

    Traces count from 1, or from 0 where the first row says 0. A tenth column is taken for the dilution of precision.
    Rows at latitude and longitude zero are without fix.

    Raises:
        InputError: the file is missing, a row is no such row, the numbers of its traces fall, or no row has a fix.
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
        rows.add(fix if fix.latitude_deg or fix.longitude_deg else None)
    return rows.positions("unstated", {})


def _trace_of_gps(token: str) -> int | None:
    """Index of the trace that a line names, ``None`` for a sentence. Raises ``ValueError`` for a damaged line."""
    named = _GPS_TRACE.fullmatch(token)
    if named is not None and int(named[1]) > 0:
        return int(named[1]) - 1
    # Sentences have no small letters. This named a trace, and what follows would go to the one before.
    if _WORD.search(token):
        raise ValueError
    return None


def _trace_of_dzg(token: str) -> int | None:
    """As ``_trace_of_gps``."""
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
    # A line may hold several sentences, of which the first was cut; what stands before the first $ is the end of one.
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
    """The first fix of each trace, as the lines of a file come."""

    def __init__(self, file: Path) -> None:
        self._file = file
        self._trace: int | None = None
        self._filled = False
        self._traces = self._without_fix = self.sentences = 0
        # A flat array: Python's own objects would need many times the size of the file.
        self._values = array("d")

    def begin(self, trace: int, place: str) -> None:
        """Start a trace, or go on with the last one. Raises ``InputError`` for one that lies before it."""
        if trace == self._trace:
            return
        if self._trace is not None and trace < self._trace:
            raise InputError(self._file, place, f"a trace after {self._trace} (counted from 0)", f"{trace}")
        self._traces += 1
        self._trace, self._filled = trace, False

    def add(self, fix: NmeaFix | None) -> None:
        """Take what follows the line of a trace: the first fix is nearest to it in time. ``None`` states no fix."""
        self.sentences += 1
        if fix is None:
            self._without_fix += 1
        elif self._trace is not None and not self._filled:
            self._values.extend((self._trace, *fix))
            self._filled = True

    def positions(self, height: HeightReference | None, counts: dict[str, int]) -> SidePositions:
        """All rows; without ``height`` they are NMEA's. Raises ``InputError`` when there is none."""
        counts = {"traces": self._traces, **counts, "without fix": self._without_fix}
        if not self._values:
            told = ", ".join(f"{name} {count}" for name, count in counts.items())
            raise InputError(self._file, "positions", "at least one trace with a fix", f"none ({told})")
        table = np.frombuffer(self._values).reshape(-1, 1 + len(NmeaFix._fields)).T.copy()
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
