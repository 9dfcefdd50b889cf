"""Position files of survey lines: topography, and receiver files in the folder of a line."""

import math
import re
from array import array
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
from jaxtyping import Float

from lgprjax.errors import InputError
from lgprjax.formats.plausible import on_earth
from lgprjax.formats.profile import read_bytes
from lgprjax.formats.receiver_files import read_cor, read_dzg, read_gps
from lgprjax.formats.side_positions import PositionKind, SidePositions, metres_kind

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
    for line, match in enumerate(re.finditer(r"([^\r\n]*)(?:\r{0,2}\n|\r|$)", text), start=1):
        row = match[1].strip()
        if not row or row.startswith("#"):
            continue
        if first:
            separator = next((each for each in (";", "\t", ",") if each in row), None)
            first = False
        if separator in (";", "\t"):
            row = row.replace(",", ".")
        # Spreadsheets end rows with empty cells.
        yield line, [cell.strip().strip('"') for cell in row.rstrip(separator).split(separator)]


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
        height="unstated",
        time_s=None,
        quality=None,
        satellites=None,
        hdop=None,
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
