"""Positions of survey lines in files next to them: topography as text, and files of satellite receivers."""

import math
import re
from array import array
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from lgprjax.errors import InputError
from lgprjax.formats.plausible import on_earth, plausible_positions, reach_in_time_m
from lgprjax.formats.profile import read_bytes

PositionKind = Literal["local metres", "grid metres", "degrees", "along metres"]
HeightReference = Literal["ellipsoid", "sea level", "unstated"]

_ROWS_MISSING, _ROWS_OVER = 0.02, 0.1
"""Shares of a line's traces that a table may lack (it is then extrapolated) or have in excess."""


@dataclass(frozen=True, kw_only=True)
class SidePositions:
    """Rows of a side file, in the order of the traces.

    Attributes:
        path: path of the file.
        kind: ``degrees`` (x longitude, y latitude), ``grid metres`` (x easting, y northing of an unnamed grid),
            ``local metres`` (x easting, y northing of the site's own grid) or ``along metres`` (x distance along the
            line, y zero).
        trace: index of each row's trace, from 0, rising.
        numbered: whether the file states the traces of its rows. Otherwise ``trace`` counts the rows, which belong to
            the traces only if their numbers are about equal.
        x, y: positions.
        z: heights in m; NaN for rows without one.
        height: reference of the heights; ``unstated`` if the file does not say.
        time_s: UTC since midnight of rows measured by a receiver; ``None`` in topography, as the next three.
        quality, satellites, hdop: code of the fix as in NMEA's GGA, satellites in use, horizontal dilution of
            precision; NaN if missing in a row.
        counts: rows read and left out. Topography: ``rows``. Receivers: ``rows``, ``traces`` (named in
            the file), ``without fix`` and ``repeated`` (rows with the time of the row before: the receiver had
            nothing new); of NMEA also ``sentences``, ``failed checksum`` and ``cut``; and implausible ones by reason.
    """

    path: Path
    kind: PositionKind
    trace: Float[np.ndarray, " row"]
    numbered: bool
    x: Float[np.ndarray, " row"]
    y: Float[np.ndarray, " row"]
    z: Float[np.ndarray, " row"]
    height: HeightReference = "unstated"
    time_s: Float[np.ndarray, " row"] | None = None
    quality: Float[np.ndarray, " row"] | None = None
    satellites: Float[np.ndarray, " row"] | None = None
    hdop: Float[np.ndarray, " row"] | None = None
    counts: dict[str, int]


# A site's own grid does not extend this far from its origin; coordinates of a national grid do.
_SITE_M = 10_000.0


def metres_kind(x: Float[np.ndarray, " row"], y: Float[np.ndarray, " row"]) -> Literal["local metres", "grid metres"]:
    """Whether metres count from a site's own origin or from that of a grid."""
    return "grid metres" if any(np.median(np.abs(values)) > _SITE_M for values in (x, y)) else "local metres"


def about_as_many(rows: int, traces: int, *, cut: bool) -> bool:
    """Whether unnumbered rows belong to the traces one by one; of a truncated line there may be any number more."""
    off = rows - traces
    return rows > 1 and -max(2, _ROWS_MISSING * traces) <= off and (cut or off <= max(2, _ROWS_OVER * traces))


class TracePlaces(NamedTuple):
    """Position of each trace; NaN before the first and after the last measured one.

    Attributes:
        x, y, z: as in ``SidePositions``.
        measured: whether the trace has its own row with a new position; the others are interpolated.
    """

    x: Float[np.ndarray, " trace"]
    y: Float[np.ndarray, " trace"]
    z: Float[np.ndarray, " trace"]
    measured: Bool[np.ndarray, " trace"]


def places_of_traces(positions: SidePositions, traces: int) -> TracePlaces:
    """Places of a number of traces, linear between the measured ones.

    Rows that repeat the time of the previous row are not measurements: the vehicle moved on without a new fix.
    """
    use = positions.trace < traces
    if positions.time_s is not None:
        use &= np.concatenate([[True], np.diff(positions.time_s) != 0])
    at, index = positions.trace[use], np.arange(traces, dtype=np.float64)
    # Degrees are interpolated the short way across the date line.
    turns = positions.kind == "degrees"
    x = _between(index, at, np.unwrap(positions.x[use], period=360.0) if turns else positions.x[use])
    x = (x + 180.0) % 360.0 - 180.0 if turns else x
    y, z = (_between(index, at, values[use]) for values in (positions.y, positions.z))
    return TracePlaces(x, y, z, np.isin(index, at))


def _between(
    index: Float[np.ndarray, " trace"], at: Float[np.ndarray, " row"], values: Float[np.ndarray, " row"]
) -> Float[np.ndarray, " trace"]:
    known = ~np.isnan(values)
    if not known.any():
        return np.full(len(index), np.nan)
    places: Float[np.ndarray, " trace"] = np.interp(index, at[known], values[known], left=np.nan, right=np.nan)
    return places


# Tables of places surveyed along a line: topography as text.

# No place on the earth has a larger coordinate: such a value is damaged.
_LARGEST_M = 1e8
_NAMES = {
    **dict.fromkeys(("e", "x", "east", "easting"), "x"),
    **dict.fromkeys(("n", "y", "north", "northing"), "y"),
    **dict.fromkeys(("z", "h", "elev", "elevation", "height", "altitude"), "z"),
    **dict.fromkeys(("lon", "long", "longitude"), "longitude"),
    **dict.fromkeys(("lat", "latitude"), "latitude"),
    **dict.fromkeys(("position", "distance", "along"), "along"),
}
_PLANES: tuple[tuple[str, ...], ...] = (("x", "y"), ("longitude", "latitude"), ("along",))
_WORD = re.compile(r"[a-z]+")


def read_topography(path: str | Path) -> SidePositions:
    """Read a table of places: one row per trace, or points along the line.

    Columns are separated by semicolons, tabs, commas or blanks; with the first two a comma is the decimal sign. A first
    row of names gives the order (``N,E,Z``, ``x y z``, ``lat,lon,height``, ``position;elevation``; columns of other
    names are left out). Without it three columns are easting, northing and elevation, and two are the distance along
    the line and the elevation.

    Raises:
        InputError: the file is missing, a row is not numeric, or there are no rows.
    """
    file = Path(path)
    columns: dict[str, int] = {}
    width = 0
    # A flat array, and a line at a time: lists of lines and floats would need many times the size of the file.
    values = array("d")
    for line, cells in _rows(read_bytes(file).decode("utf-8-sig", errors="replace")):
        if not width:
            columns, width = _columns(file, line, cells), len(cells)
            if not _is_number(cells[0]):
                continue
        if len(cells) != width:
            raise InputError(file, f"line {line}", f"{width} columns", f"{len(cells)}")
        for at in columns.values():
            value = _number(cells[at])
            if not abs(value) <= _LARGEST_M:
                raise InputError(file, f"line {line}", "numbers", repr(cells[at][:40]))
            values.append(value)
    if not values:
        raise InputError(file, "rows", "at least one position", "none")
    table = np.frombuffer(values).reshape(-1, len(columns))
    return _positions(file, {name: table[:, at].copy() for at, name in enumerate(columns)})


def begins_as_topography(path: Path) -> bool:
    """Whether the first row of a text file is one that ``read_topography`` accepts."""
    try:
        with path.open("rb") as stream:
            line, cells = next(_rows(stream.read(1000).decode("utf-8-sig", errors="replace")))
        return bool(_columns(path, line, cells))
    except (OSError, StopIteration, InputError):
        return False


def _rows(text: str) -> Iterator[tuple[int, list[str]]]:
    """Numbered lines as cells, without blank ones and comments (#)."""
    separator: str | None = None
    first = True
    for line, row in _lines(text):
        if not row or row.startswith("#"):
            continue
        if first:
            separator = next((each for each in (";", "\t", ",") if each in row), None)
            first = False
        if separator in (";", "\t"):
            row = row.replace(",", ".")
        # Spreadsheets end rows with empty cells.
        yield line, [cell.strip().strip('"') for cell in row.rstrip(separator).split(separator)]


def _lines(text: str) -> Iterator[tuple[int, str]]:
    """Numbered lines, without blanks at their ends; a line ends as on any system, or as two of them mixed."""
    for line, match in enumerate(re.finditer(r"([^\r\n]*)(?:\r{0,2}\n|\r|$)", text), start=1):
        yield line, match[1].strip()


def _columns(file: Path, line: int, cells: list[str]) -> dict[str, int]:
    """Positions of the columns, from a first row of names or numbers. Raises ``InputError``."""
    place = f"line {line}"
    if _is_number(cells[0]):
        unnamed: dict[int, tuple[str, ...]] = {2: ("along", "z"), 3: ("x", "y", "z")}
        if len(cells) not in unnamed:
            raise InputError(file, place, "two or three columns, or names such as N,E,Z", f"{len(cells)} columns")
        return {name: at for at, name in enumerate(unnamed[len(cells)])}
    columns: dict[str, int] = {}
    for at, cell in enumerate(cells):
        # A unit may follow, as in Z_m or easting (m).
        word = _WORD.match(cell.lower())
        name = _NAMES.get(word[0]) if word else None
        if name in columns:
            raise InputError(file, place, f"one column of {name}", f"two, {cell[:40]!r} the second")
        if name is not None:
            columns[name] = at
    if not any(set(plane) <= set(columns) for plane in _PLANES):
        raise InputError(file, place, "numbers, or names such as N,E,Z", repr(" ".join(cells)[:40]))
    return columns


def _positions(file: Path, table: dict[str, Float[np.ndarray, " row"]]) -> SidePositions:
    plane = next(names for names in _PLANES if set(names) <= set(table))
    x = table[plane[0]]
    y = table[plane[1]] if len(plane) == 2 else np.zeros_like(x)
    kind: PositionKind = "along metres"
    if plane == ("longitude", "latitude"):
        kind = "degrees"
        wrong = np.flatnonzero(~on_earth(y, x))
        if wrong.size:
            found = f"{x[wrong[0]]:g}, {y[wrong[0]]:g}"
            raise InputError(file, f"row {wrong[0] + 1}", "longitude and latitude in degrees", found)
    elif plane == ("x", "y"):
        kind = metres_kind(x, y)
    return SidePositions(
        path=file,
        kind=kind,
        trace=np.arange(len(x), dtype=np.float64),
        numbered=False,
        x=x,
        y=y,
        z=table.get("z", np.full_like(x, np.nan)),
        counts={"rows": len(x)},
    )


def _number(cell: str) -> float:
    """The number of a cell; NaN if it is not one."""
    try:
        # Overlong cells are damaged, and so are Python's digit groups (1_000).
        return float(cell) if len(cell) <= 40 and "_" not in cell else math.nan
    except ValueError:
        return math.nan


def _is_number(cell: str) -> bool:
    return math.isfinite(_number(cell))


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
        time_s: UTC since midnight.
        altitude_m: height above sea level.
        separation_m: height of sea level above the ellipsoid.
        quality: code of GGA, 1 to 5.
        satellites: number of satellites in use.
        hdop: horizontal dilution of precision.
    """

    latitude_deg: float
    longitude_deg: float
    time_s: float
    altitude_m: float = math.nan
    separation_m: float = math.nan
    quality: float = math.nan
    satellites: float = math.nan
    hdop: float = math.nan


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
        time_s=_clock(fields[0]),
        altitude_m=_nmea_number(fields[8], -1e4, 1e5) if fields[9] == "M" else math.nan,
        separation_m=_nmea_number(fields[10], -200.0, 200.0) if fields[11] == "M" else math.nan,
        quality=float(fields[5]),
        satellites=_nmea_number(fields[6], 0.0, 200.0),
        hdop=_nmea_number(fields[7], 0.0, 1e3),
    )


def _rmc(fields: list[str]) -> NmeaFix:
    if fields[1] != "A":
        raise ValueError
    latitude, longitude = _angle("latitude", fields[2], fields[3]), _angle("longitude", fields[4], fields[5])
    return NmeaFix(latitude_deg=latitude, longitude_deg=longitude, time_s=_clock(fields[0]))


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
    for line, row in _lines(text):
        if not row:
            continue
        place = f"line {line}"
        parts = _COR_ROW.fullmatch(" ".join(re.split(r"[\t,; ]+", row)))
        fix = None if parts is None else _fix_of_cor(parts)
        if parts is None or fix is None:
            expected = "trace, date, time, latitude, N or S, longitude, E or W, height, M"
            raise InputError(file, place, expected, repr(row[:60]))
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
        time_s=3600.0 * hours + 60.0 * minutes + seconds,
        altitude_m=float(parts[9]),
        hdop=math.nan if parts[10] is None else float(parts[10]),
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
        steps_s = (np.diff(table[3], prepend=table[3, :1]) + 43_200.0) % 86_400.0 - 43_200.0
        judged = plausible_positions(table[1], table[2], reach_in_time_m(np.cumsum(steps_s)))
        counts = {"traces": self._traces, **counts, "without fix": self._without_fix, **judged.left_out}
        if not judged.kept.any():
            counts_text = ", ".join(f"{name} {count}" for name, count in counts.items())
            raise InputError(self._file, "positions", "at least one trace with a fix", f"none ({counts_text})")
        table = table[:, judged.kept]
        trace, latitude, longitude, time_s, z, separation, quality, satellites, hdop = table
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


# Files of a line's positions in its folder.

# Topography first: it was surveyed, whereas a receiver's fixes are usually those of a hand-held one.
SIDE_READERS: dict[str, Callable[[str | Path], SidePositions]] = {
    ".xyz": read_topography,
    ".csv": read_topography,
    ".txt": read_topography,
    ".gps": read_gps,
    ".dzg": read_dzg,
    ".cor": read_cor,
}

RECEIVERS = (".gps", ".dzg", ".cor")


def find_side_files(path: str | Path) -> list[Path]:
    """Files with a line's positions next to it, in upper or lower case: topography first, then a receiver's.

    For ``NAME.DT1`` these are ``topo_NAME.txt``, ``NAME.xyz``, ``NAME.csv``, ``NAME.txt`` (if it begins with a row of
    topography, not with notes), ``NAME.GPS``, ``NAME.DZG`` and ``NAME.cor``; for ``NAME_A01.iprb`` also those of
    ``NAME``, which all channels share.
    """
    line = Path(path)
    stem = line.stem.lower()
    # A channel's own file precedes the one shared by all channels.
    stems = list(dict.fromkeys((stem, re.sub(r"_a\d+$", "", stem))))
    order = list(SIDE_READERS)
    try:
        beside = [each for each in line.parent.iterdir() if each != line and each.is_file()]
    except OSError:
        return []
    found: list[tuple[int, int, Path]] = []
    for each in beside:
        name, suffix = each.stem.lower(), each.suffix.lower()
        surveyed = suffix == ".txt" and name.removeprefix("topo_") in stems and name not in stems
        if surveyed:
            found.append((-1, stems.index(name.removeprefix("topo_")), each))
        elif name in stems and suffix in SIDE_READERS and (suffix != ".txt" or begins_as_topography(each)):
            found.append((order.index(suffix), stems.index(name), each))
    return [each for _, _, each in sorted(found)]


def unread_notes(path: str | Path) -> list[Path]:
    """Text files named as a line that ``find_side_files`` leaves out, as they do not begin with a row of topography."""
    line, found = Path(path), set(find_side_files(path))
    return [
        each
        for each in sorted(line.parent.glob("*"))
        if each.stem.lower() == line.stem.lower() and each.suffix.lower() == ".txt" and each not in found
    ]


def strangers(path: str | Path) -> list[Path]:
    """Position files in a line's folder whose name matches no other file, so that their line is unknown."""
    files = [each for each in sorted(Path(path).parent.glob("*")) if each.is_file()]
    kinds = (".xyz", *RECEIVERS)
    others = {each.stem.lower() for each in files if each.suffix.lower() not in kinds}
    return [each for each in files if each.suffix.lower() in kinds and each.stem.lower() not in others]


def read_side_file(path: str | Path) -> SidePositions:
    """Read the positions of a file by its suffix, one of ``SIDE_READERS``.

    Raises:
        InputError: the file is missing, another format, or holds no position at all.
    """
    reader = SIDE_READERS.get(Path(path).suffix.lower())
    if reader is None:
        raise InputError(path, "file name", "a suffix among " + ", ".join(SIDE_READERS), repr(Path(path).suffix))
    return reader(path)
