"""Positions recorded beside a line: which files lie there, and one door to their readers."""

import re
from collections.abc import Callable
from pathlib import Path

from lgprjax.errors import InputError
from lgprjax.formats.receiver_files import read_cor, read_dzg, read_gps
from lgprjax.formats.side_positions import SidePositions
from lgprjax.formats.topography import begins_as_topography, read_topography

# Topography first: it was surveyed, where a receiver's fixes beside a line are those of a hand-held one as a rule.
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
    """Files beside a line that hold its positions, in whatever case: topography first, then a receiver's.

    For ``NAME.DT1`` these are ``topo_NAME.txt``, ``NAME.xyz``, ``NAME.csv``, ``NAME.txt`` (where it begins with a row
    of topography and not with notes), ``NAME.GPS``, ``NAME.DZG`` and ``NAME.cor``; for ``NAME_A01.iprb`` also those of
    ``NAME``, which all channels share.
    """
    line = Path(path)
    stem = line.stem.lower()
    # A channel's own file comes before the one that all channels share.
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


def read_side_file(path: str | Path) -> SidePositions:
    """Read the positions of a file by its suffix, one of ``SIDE_READERS``.

    Raises:
        InputError: the file is missing, another format, or holds no position at all.
    """
    reader = SIDE_READERS.get(Path(path).suffix.lower())
    if reader is None:
        raise InputError(path, "file name", "a suffix among " + ", ".join(SIDE_READERS), repr(Path(path).suffix))
    return reader(path)
