"""Format of an import by file name, and advice for files of unknown format."""

import re
from collections.abc import Sequence
from pathlib import Path

_BY_SUFFIX = {
    **dict.fromkeys((".dt1", ".dzt", ".rd3", ".rd7", ".sgy", ".segy", ".iprb"), "lines"),
    ".mcap": "mcap",
    ".bag": "rosbag",
    ".db3": "rosbag",
    ".out": "gprmax",
}
_BY_CONTENT = {"run.npy": "grounded", "gpr_meas.csv": "cmu", "metadata.yaml": "rosbag"}
"""Files that identify the format of a folder."""
_TAPE = ("--line-spacing-m", "--lines-at-m", "--first-line-m")
"""Options that only import lines has."""


def recognised(arguments: Sequence[str]) -> list[str]:
    """Arguments of ``import`` with the format inserted, if files are given without one.

    A single SEG-Y file and the channels of one ImpulseRadar line have formats of their own, unless tape options make
    them lines. Arguments without a known format are returned unchanged.
    """
    words = [str(word) for word in arguments]
    formats = ("dt1", "dzt", "mala", "iprb", "segy", "lines", "grounded", "cmu", "gprmax", "mcap", "rosbag", "signals")
    # A single word that is not a file is a misspelt format.
    if not words or words[0] in formats or (re.fullmatch(r"\w[\w-]*", words[0]) and not Path(words[0]).exists()):
        return words
    outputs = {i + 1 for i, word in enumerate(words) if word in ("-o", "--output")}
    found = [Path(word) for i, word in enumerate(words) if not word.startswith("-") and i not in outputs]
    taped = any(word.partition("=")[0].replace("_", "-") in _TAPE for word in words)
    for path in found:
        known = next((name for part, name in _BY_CONTENT.items() if (path / part).is_file()), None)
        known = known or _BY_SUFFIX.get(path.suffix.lower())
        if known is None and path.suffix.lower() == ".h5" and not path.name.endswith((".drive.h5", ".map.h5")):
            known = "gprmax"
        if known is None:
            continue
        files = [other for other in found if other.suffix.lower() == path.suffix.lower()]
        if taped:
            return [known, *words]
        if known == "lines" and path.suffix.lower() in (".sgy", ".segy") and len(files) == 1:
            known = "segy"
        if known == "lines" and path.suffix.lower() == ".iprb":
            lines = {re.sub(r"_A\d+$", "", file.stem, flags=re.IGNORECASE) for file in files}
            known = "iprb" if len(lines) == 1 else "lines"
        return [known, *words]
    return words


_GOES_WITH = {
    **{".hd": (".dt1",), ".rad": (".rd3", ".rd7"), ".iprh": (".iprb",)},
    **dict.fromkeys(
        (".xyz", ".csv", ".txt", ".gps", ".dzg", ".cor"), (".dt1", ".dzt", ".rd3", ".rd7", ".iprb", ".sgy")
    ),
}
"""Suffixes of companion files, and of their recordings."""
_INSTEAD = {
    ".dt": "an IDS recording: convert it to SEG-Y (docs/compatibility.md)",
    ".3dra": "a 3D-Radar recording: convert it to SEG-Y (docs/compatibility.md)",
    **dict.fromkeys((".npy", ".npz", ".mat"), "data: write them as a drive log (docs/own_radar.md)"),
    **dict.fromkeys((".csv", ".parquet"), "vehicle signals: lgprjax import signals FILE --columns COLUMNS.toml"),
    **dict.fromkeys((".xlsx", ".xls", ".ods"), "a spreadsheet: save it as CSV for lgprjax import signals"),
    **dict.fromkeys((".zip", ".gz", ".tar", ".7z"), "an archive: unpack it first"),
}


def told_instead(word: str) -> str:
    """Description of a file that is not a recording, with advice; empty if its type is unknown."""
    path = Path(word)
    suffix = path.suffix.lower()
    stem = path.stem.lower().removeprefix("topo_")
    try:
        if path.is_dir():
            there = sorted(each for each in path.iterdir() if each.suffix.lower() in _BY_SUFFIX)
            if there and all(each.suffix.lower() == ".db3" for each in there):
                return f"a ROS 2 bag without metadata.yaml: ros2 bag reindex {path} writes it"
            return f"a folder: name the files in it, such as {there[0]}" if there else "a folder without recordings"
        recordings = [
            each
            for each in sorted(path.parent.iterdir())
            if each.stem.lower() == stem and each.suffix.lower() in _GOES_WITH.get(suffix, ())
        ]
    except OSError:  # unreadable folder
        return ""
    if recordings:
        return f"a companion file of {recordings[0].name}: name that file"
    if path.name.endswith((".drive.h5", ".map.h5")):
        return f"{'a drive log' if path.name.endswith('.drive.h5') else 'a map'}, which needs no import"
    if suffix in _INSTEAD:
        return _INSTEAD[suffix]
    return "a companion file of a recording: name the recording" if suffix in _GOES_WITH and suffix != ".txt" else ""


def recording_suffixes() -> str:
    """Suffixes of the recognised recordings, in words."""
    return ", ".join(_BY_SUFFIX)
