"""Parallel lines of a survey, or an array's files, as one drive log."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from lgprjax.errors import InputError
from lgprjax.formats.dt1 import read_dt1
from lgprjax.formats.dzt import read_dzt
from lgprjax.formats.iprb import read_iprb, read_iprb_array
from lgprjax.formats.mala import read_mala
from lgprjax.formats.parallel_lines import inputs_of, write_lines
from lgprjax.formats.profile import Profile
from lgprjax.formats.segy import read_segy
from lgprjax.formats.survey_track import Place

READERS = {
    ".dt1": read_dt1,
    ".dzt": read_dzt,
    ".rd3": read_mala,
    ".rd7": read_mala,
    ".iprb": read_iprb,
    ".sgy": read_segy,
    ".segy": read_segy,
}


def read_profile(path: str | Path) -> Profile:
    """Read a vendor's file by its suffix, one of ``READERS``. Raises ``InputError``."""
    reader = READERS.get(Path(path).suffix.lower())
    if reader is None:
        raise InputError(path, "file name", "a suffix among " + ", ".join(READERS), repr(Path(path).suffix))
    return reader(path)


def import_lines(
    paths: Sequence[str | Path],
    *,
    line_spacing_m: float,
    first_line_m: float = 0.0,
    length_m: float | None = None,
    reversed_lines: Sequence[int] = (),
    sample_interval_ns: float | None = None,
    latitude_deg: float = 0.0,
    longitude_deg: float = 0.0,
    heading_deg: float = 90.0,
    output: str | Path,
    force: bool = False,
) -> None:
    """Write parallel lines as one drive log, one channel a line, the first line leftmost.

    The vehicle drives along ``heading_deg`` from the origin; line i lies ``first_line_m + i * line_spacing_m`` to
    its right. A single file of several channels counts as that many lines.

    Args:
        paths: vendor files, from left to right.
        line_spacing_m: distance between lines.
        first_line_m: distance of the first line to the right of the origin.
        length_m: spread every line evenly over this length (both ends on the tape) and resample it to the common
            step. Without it lines keep the spacing and start of their headers and may end early.
        reversed_lines: numbers of the lines that were recorded backwards; a reversed line ends at the start.
        sample_interval_ns: two-way travel time between samples of SEG-Y files, whose headers may not say it.
        latitude_deg, longitude_deg: origin, WGS-84.
        heading_deg: direction of the lines, clockwise from true north.
        output: the drive log.
        force: replace an output that exists.

    Raises:
        InputError: a file cannot be read, or the lines do not belong together.
    """
    lines = [_read(path, sample_interval_ns) for path in paths]
    if not lines:
        raise InputError(output, "lines", "at least one file", "none")
    if len(lines) == 1:
        lines = _channels(lines[0])
    if len(lines) > 1 and not (np.isfinite(line_spacing_m) and line_spacing_m > 0):
        raise InputError(output, "line spacing", "a length above zero", f"{line_spacing_m:g} m")
    write_lines(
        lines,
        left_m=-(first_line_m + np.arange(len(lines)) * line_spacing_m),
        forward_m=np.zeros(len(lines)),
        place=Place(latitude_deg, longitude_deg, heading_deg),
        output=output,
        provenance={
            "made_by": "lgprjax import lines",
            "inputs": inputs_of(paths),
            "line_spacing_m": line_spacing_m,
            "first_line_m": first_line_m,
            "readings": {line.path.name: line.metadata["reading"] for line in lines if "reading" in line.metadata},
        },
        length_m=length_m,
        reversed_lines=reversed_lines,
        force=force,
    )


def import_iprb(
    paths: Sequence[str | Path],
    *,
    place: Place,
    length_m: float | None = None,
    output: str | Path,
    force: bool = False,
) -> None:
    """Write the ImpulseRadar files of one line, one a channel, as one drive log.

    Several files are an array, placed as ``CH_X_OFFSET`` and ``CH_Y_OFFSET`` of their headers say; the leftmost
    becomes channel 0 in whatever order they are named. A single file is a single channel on the line.

    Args:
        paths: the ``.iprb`` files of the channels.
        place: origin and direction of the line.
        length_m: length of the line, where it was measured by tape.
        output: the drive log.
        force: replace an output that exists.

    Raises:
        InputError: a file cannot be read, or the channels do not belong together.
    """
    array = read_iprb_array(paths)
    lines = _channels(array)
    write_lines(
        lines,
        left_m=np.zeros(1) if array.left_m is None else array.left_m,
        forward_m=np.zeros(1) if array.forward_m is None else array.forward_m,
        place=place,
        output=output,
        provenance={"made_by": "lgprjax import iprb", "inputs": inputs_of(paths), "header": array.metadata},
        length_m=length_m,
        force=force,
    )


def _read(path: str | Path, sample_interval_ns: float | None) -> Profile:
    if sample_interval_ns is None:
        return read_profile(path)
    if READERS.get(Path(path).suffix.lower()) is not read_segy:
        raise InputError(path, "file name", "SEG-Y, as a sample interval is given", repr(Path(path).suffix))
    return read_segy(path, sample_interval_ns=sample_interval_ns)


def _channels(profile: Profile) -> list[Profile]:
    """Each channel as a line of its own."""
    return [
        replace(profile, channels=profile.channels[:, c : c + 1], left_m=None, forward_m=None)
        for c in range(profile.channels.shape[1])
    ]
