"""Lines of a survey, or an array's files, as one drive log.

The steps: files are read as lines, positions are found for every line (``line_positions``), lines are laid out
(``survey_layout``), their time zeros, signs, directions and starts are estimated (``line_findings``), and the drive is
written (``line_layout``).
"""

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np
from jaxtyping import Float

from lgprjax.errors import ArgumentError, InputError
from lgprjax.formats.line_findings import FoundLine, LineFinding, Reversed, TimeZero, find_lines
from lgprjax.formats.line_layout import check_alike, check_length, inputs_of, write_lines, write_positioned_lines
from lgprjax.formats.line_positions import (
    RECEIVERS,
    find_side_files,
    read_side_file,
    strangers,
    unread_notes,
)
from lgprjax.formats.plausible import IMPLAUSIBLE, left_out_in_words, lengths_disagree, path_length_m
from lgprjax.formats.profile import Assumed, Profile, check_channel
from lgprjax.formats.survey_layout import SurveyLayout, SurveyLine, check_fit, header_positions, lay_out, places_traces
from lgprjax.formats.survey_track import UNUSED_PLACE, SurveyOrigin, path_lengths_m, unused_zone, utm_projection
from lgprjax.formats.vendors.line_files import read_dt1, read_dzt, read_iprb, read_iprb_array, read_mala
from lgprjax.formats.vendors.segy import SampleFormat, read_segy

_SAME_LINE_M = 0.005
_FARTHEST_LINES_M = 100.0

READERS = {
    ".dt1": read_dt1,
    ".dzt": read_dzt,
    ".rd3": read_mala,
    ".rd7": read_mala,
    ".iprb": read_iprb,
    ".sgy": read_segy,
    ".segy": read_segy,
}


def read_profile(
    path: str | Path,
    *,
    channel: int | None = None,
    sample_interval_ns: float | None = None,
    sample_format: SampleFormat | None = None,
    partial: bool = False,
) -> Profile:
    """Read a vendor's file by its suffix, one of ``READERS``.

    Args:
        path: path of the file.
        channel: only channel to read, from 0.
        sample_interval_ns, sample_format: of SEG-Y only, see ``read_segy``.
        partial: whether to read the intact part of a truncated file.

    Raises:
        InputError: the file cannot be read, or is not of a format that has these options.
    """
    suffix = Path(path).suffix
    reader = READERS.get(suffix.lower())
    if (sample_interval_ns is not None or sample_format is not None) and reader is not read_segy:
        expected = "SEG-Y (the only format with --sample-interval-ns and --sample-format)"
        raise InputError(path, "file name", expected, repr(suffix))
    if reader is None and Path(path).is_dir():
        raise InputError(path, "file", "a recording", "a folder")
    if reader is None:
        raise InputError(path, "file name", "a suffix among " + ", ".join(READERS), repr(suffix))
    if reader is read_dzt:
        return read_dzt(path, channel=channel, partial=partial)
    check_channel(Path(path), channel, channels=1)
    if reader is read_segy:
        return read_segy(path, sample_interval_ns=sample_interval_ns, sample_format=sample_format, partial=partial)
    return reader(path, partial=partial)


class Survey(NamedTuple):
    """Result of ``import_lines``.

    Attributes:
        lines: findings on each line, from left to right, or in driving order.
        placed_by: source of positions: ``tape``, ``topography``, ``receiver`` or ``header``.
        assumed: assumptions for unrecorded quantities, by quantity.
        notes: notes on unused and suspicious input, one line each.
    """

    lines: tuple[LineFinding, ...]
    placed_by: str
    assumed: Assumed
    notes: tuple[str, ...]


def import_lines(
    paths: Sequence[str | Path],
    *,
    output: str | Path,
    line_spacing_m: float | None = None,
    lines_at_m: Sequence[float] | None = None,
    first_line_m: float = 0.0,
    length_m: float | None = None,
    time_zero: TimeZero = "auto",
    polarity: Literal["auto", "keep"] = "auto",
    reversed_lines: Reversed = "auto",
    channel: int | None = None,
    sample_interval_ns: float | None = None,
    sample_format: SampleFormat | None = None,
    utm_zone: str | None = None,
    partial: bool = False,
    latitude_deg: float = 0.0,
    longitude_deg: float = 0.0,
    heading_deg: float = 90.0,
    force: bool = False,
) -> Survey:
    """Write the lines of a survey as one drive log.

    With tape geometry (``line_spacing_m`` or ``lines_at_m``) every line is a channel of one array that drives along
    ``heading_deg`` from the origin. Without it positions come from the side files of the lines, or from the coordinates
    in their trace headers: metres of the site, whose x axis then points along ``heading_deg``, or latitudes and
    longitudes, with which lines become consecutive passes of one channel. A single line without any runs straight from
    the origin.

    Time zeros, signs, directions and starts are estimated from the traces (``survey_layout``).

    Args:
        paths: vendor files, from left to right. A single file of several channels counts as that many lines, placed by
            tape.
        output: the drive log.
        line_spacing_m: distance between lines.
        lines_at_m: position of each line, to the right of the origin.
        first_line_m: with ``line_spacing_m``, distance of the first line to the right of the origin.
        length_m: length over which every line is spread evenly (both ends on the tape) and resampled to the common
            step. Without it lines keep the spacing and start of their headers and may end early.
        time_zero, polarity, reversed_lines: see ``find_lines``.
        channel: only channel to read of files with several, from 0.
        sample_interval_ns, sample_format: sample interval and format of SEG-Y files, see ``read_segy``.
        utm_zone: zone of positions in metres of a UTM grid, such as ``33N``.
        partial: whether to read the intact traces of truncated files.
        latitude_deg, longitude_deg: origin, WGS-84.
        heading_deg: direction of the lines, clockwise from true north.
        force: whether to replace an existing output.

    Raises:
        InputError: a file cannot be read, or the lines do not belong together.
    """
    if utm_zone is not None:
        utm_projection(utm_zone)  # a wrong zone is refused where nothing needs one, too
    place = SurveyOrigin(latitude_deg, longitude_deg, heading_deg)
    taped = line_spacing_m is not None or lines_at_m is not None
    reading: dict[str, Any] = {
        "channel": channel,
        "sample_interval_ns": sample_interval_ns,
        "sample_format": sample_format,
        "partial": partial,
    }
    lines = _read_lines(paths, reading, output, taped=taped)
    place.check()
    check_length(length_m)
    check_alike(lines)
    if not isinstance(reversed_lines, str) and any(not 0 <= i < len(lines) for i in reversed_lines):
        bad = next(i for i in reversed_lines if not 0 <= i < len(lines))
        raise ArgumentError("reversed_lines", f"numbers from 0 to {len(lines) - 1}", str(bad))
    right_m = _tape(len(lines), line_spacing_m, lines_at_m, first_line_m)
    if length_m is None:
        survey, unusable = _with_positions(lines, surveyed=taped)
    else:
        survey, unusable = [SurveyLine(line, None) for line in lines], []
    survey, lengths = _with_believed_lengths(survey, length_m)
    layout = lay_out(survey, right_m, place, utm_zone)
    notes = (*unusable, *lengths, *_notes(survey, layout, place, utm_zone, length_m))
    # From left to right, so that neighbours are compared; lines driven one by one keep their order.
    order = np.argsort(-layout.left_m, kind="stable")
    if not isinstance(reversed_lines, str):
        reversed_lines = [int(np.flatnonzero(order == i)[0]) for i in reversed_lines]
    found = find_lines(
        [survey[i].profile for i in order],
        time_zero=time_zero,
        polarity=polarity,
        reversed_lines=reversed_lines,
        length_m=length_m,
        topography_m=None if layout.along_m is None else [layout.along_m[i] for i in order],
        topography_from="header" if layout.source == "header" else "topography",
        on_earth_by=None if layout.on_earth is None else layout.source,
    )
    provenance: dict[str, object] = {
        "made_by": "lgprjax import lines",
        "inputs": inputs_of(paths),
        "positions_from": layout.source,
        "lines": [line.finding.as_record() for line in found],
        "readings": {
            line.path.name: line.metadata["reading"]
            for line in (survey[i].profile for i in order)
            if "reading" in line.metadata
        },
        "beside": [
            {"file": side.path.name, "kind": side.kind, **side.counts} for _, side in survey if side is not None
        ],
    }
    assumed = _assumed(found, layout, place, utm_zone)
    profiles = [line.profile for line in found]
    if layout.on_earth is not None:
        assumed = write_positioned_lines(
            profiles,
            latitude_deg=[latitude for latitude, _ in layout.on_earth],
            longitude_deg=[longitude for _, longitude in layout.on_earth],
            travel_m=[line.along_m - line.along_m[0] for line in found],
            output=output,
            provenance=provenance,
            assumed=assumed,
            force=force,
        )
    else:
        assumed = write_lines(
            profiles,
            left_m=layout.left_m[order],
            place=layout.place,
            output=output,
            provenance=provenance,
            assumed=assumed,
            length_m=length_m,
            along_m=[line.along_m for line in found],
            force=force,
        )
    return Survey(tuple(line.finding for line in found), layout.source, assumed, notes)


def _assumed(found: Sequence[FoundLine], layout: SurveyLayout, place: SurveyOrigin, utm_zone: str | None) -> Assumed:
    """Assumptions about quantities that neither a file nor the user states."""
    assumed: Assumed = place.assumed() if layout.place_assumed else {}
    if layout.on_earth is not None:
        return {"odometry": "trace spacing or positions of the header", **assumed}
    if all(line.finding.direction_from in ("assumed", "neighbours") for line in found):
        assumed["direction"] = "as stored"
    if layout.along_m is not None:
        assumed["odometry"] = f"along the {_OF_SOURCE.get(layout.source, 'topography')}"
        if layout.source in _OF_SOURCE:
            metres = "the site's own metres" if layout.place[:2] == place[:2] else f"metres of UTM zone {utm_zone}"
            assumed["position"] = f"from the {_OF_SOURCE[layout.source]}, in {metres}"
    return assumed


_OF_SOURCE = {"topography": "topography", "header": "coordinates of the headers"}


def import_iprb(
    paths: Sequence[str | Path],
    *,
    place: SurveyOrigin,
    length_m: float | None = None,
    partial: bool = False,
    output: str | Path,
    force: bool = False,
) -> str | None:
    """Write the ImpulseRadar files of one line, one per channel, as one drive log.

    Several files are an array, placed by ``CH_X_OFFSET`` and ``CH_Y_OFFSET`` of their headers; the leftmost becomes
    channel 0, in any order of the files. A single file is a single channel on the line.

    Args:
        paths: the ``.iprb`` files of the channels.
        place: origin and direction of the line.
        length_m: length of the line, if measured by tape.
        partial: read the intact traces of truncated files.
        output: the drive log.
        force: whether to replace an existing output.

    Returns:
        How many traces of truncated files were read; ``None``: all.

    Raises:
        InputError: a file cannot be read, or the channels do not belong together.
    """
    array = read_iprb_array(paths, partial=partial)
    write_lines(
        array.by_channel(),
        left_m=array.left_m,
        forward_m=array.forward_m,
        place=place,
        output=output,
        provenance={"made_by": "lgprjax import iprb", "inputs": inputs_of(paths), "header": array.metadata},
        assumed=place.assumed(),
        length_m=length_m,
        force=force,
    )
    return array.cut


def _read_lines(
    paths: Sequence[str | Path], reading: Mapping[str, Any], output: str | Path, *, taped: bool
) -> list[Profile]:
    """The lines of some files. Several channels of one file are lines only if placed by tape: of two antennas in one
    place, one is chosen.

    Raises:
        InputError: a file is given twice or cannot be read, or none is given.
    """
    seen: set[Path] = set()
    for path in map(Path, paths):
        if path.resolve() in seen:
            raise InputError(path, "lines", "each file once", "this file twice")
        seen.add(path.resolve())
    lines = [read_profile(path, **reading) for path in paths]
    if not lines:
        raise InputError(output, "lines", "at least one file", "none")
    if len(lines) == 1 and taped:
        return lines[0].by_channel()
    for line in lines:
        if (channels := line.channels.shape[1]) > 1:
            names = line.metadata.get("antennas")
            antennas = f" ({', '.join(map(repr, names))})" if isinstance(names, tuple) and any(names) else ""
            expected = "--channel for one of them (side by side: one file, lgprjax import lines --line-spacing-m)"
            raise InputError(line.path, "channels", expected, f"{channels}{antennas}")
    return lines


def _with_positions(lines: Sequence[Profile], *, surveyed: bool) -> tuple[list[SurveyLine], list[str]]:
    """Lines with the positions next to them, else in their headers; and notes on files that are no use.

    These are those of a line's topography, else a receiver's; of lines placed by tape, surveyed ones only. Metres of
    the site in headers place several lines only.
    """
    survey, notes = [], []
    for line in lines:
        side, refused = None, list[InputError]()
        for file in find_side_files(line.path):
            if surveyed and file.suffix.lower() in RECEIVERS:
                continue
            try:
                found = read_side_file(file)
                check_fit(line, found)
            except InputError as error:
                refused.append(error)
            else:
                side = found
                break
        # Without them the line has no place at all.
        if refused and side is None and not surveyed and (len(lines) > 1 or line.positions_m is None):
            raise refused[0]
        survey.append(SurveyLine(line, side))
        notes += [
            f"{Path(each.file).name}: not used: {each.place}: expected {each.expected}, found {each.found}"
            for each in refused
        ]
    if surveyed:
        return survey, notes
    placed = [header_positions(line) if side is None else None for line, side in survey]
    if len(lines) == 1 and placed[0] is not None and placed[0].kind == "local metres":
        return survey, notes
    return [
        each
        if header is None
        else SurveyLine(
            replace(each.profile, spacing_m=None, positions_m=path_lengths_m(header.kind, header.x, header.y)), header
        )
        for each, header in zip(survey, placed, strict=True)
    ], notes


def _notes(
    survey: Sequence[SurveyLine],
    layout: SurveyLayout,
    place: SurveyOrigin,
    utm_zone: str | None,
    length_m: float | None,
) -> tuple[str, ...]:
    """Notes on unused and suspicious input."""
    lines = [line for line, _ in survey]
    notes = list(dict.fromkeys(note for line in lines for note in line.notes))
    files = dict.fromkeys(line.path for line in lines)
    if length_m is not None:
        unused = [file for path in files for file in find_side_files(path)]
        notes += _of_files(unused, "not used: the given length positions the traces")
    notes += _of_files([file for path in files for file in unread_notes(path)], "not read: not a topography file")
    sides = [(line, side) for line, side in survey if side is not None]
    if not sides:
        first_file = next(iter(files))
        notes += _of_files(
            strangers(first_file), f"not read: the position file of {first_file.name} must have the same name"
        )
    notes += [
        f"{side.path.name}: {left_out_in_words(out, side.counts['rows'] + sum(out.values()))}"
        for _, side in sides
        if (out := {reason: side.counts[reason] for reason in IMPLAUSIBLE if reason in side.counts})
    ]
    for line in lines:
        source = str(line.metadata.get("coordinates", ""))
        notes += [f"{line.path.name}: coordinates from {source}"] if "left out" in source else []
    for line, side in sides:
        beyond = int(np.count_nonzero(side.trace >= len(line.channels))) if side.numbered and line.cut is None else 0
        if beyond:
            why = "if the radar paused, places behind the pause are wrong"
            notes.append(f"{side.path.name}: {beyond} of {len(side.trace)} positions after the last trace: {why}")
    points = [side.path for line, side in sides if not places_traces(line, side)]
    notes += _of_files(
        list(dict.fromkeys(points)), "not used for positions: it has fewer points than traces (heights only)"
    )
    for (line, _), rows in zip(sides, layout.along_m, strict=True) if layout.along_m is not None else ():
        header_m, rows_m = line.length_m(0, len(line.channels) - 1), float(abs(rows[-1] - rows[0]))
        if lengths_disagree(header_m, rows_m):
            said = f"the header says {header_m:.2f} m, the topography {rows_m:.2f} m: the topography is used"
            notes.append(f"{line.path.name}: {said}")
    dead = dict.fromkeys(line.path.name for line in lines if not np.ptp(line.traces))
    notes += [f"{name}: no signal was recorded: all samples are equal" for name in dead]
    first: dict[str, Path] = {}
    for line in lines:
        same = first.setdefault(hashlib.sha256(line.traces.tobytes()).hexdigest(), line.path)
        if same != line.path and line.path.name not in dead:
            notes.append(f"{line.path.name}: same traces as {same.name}: a copy?")
    if utm_zone is not None and all(side.kind != "grid metres" for _, side in sides):
        notes.append(unused_zone(utm_zone, "no positions are in grid metres"))
    if not place.assumed() and place[:2] != layout.place[:2]:
        notes.append(UNUSED_PLACE)
    return tuple(notes)


def _of_files(files: Sequence[Path], what: str) -> list[str]:
    """A note on the first of some files, and how many more there are."""
    more = f" (and {len(files) - 1} more)" if len(files) > 1 else ""
    return [f"{files[0].name}{more}: {what}"] if files else []


def _tape(
    lines: int,
    line_spacing_m: float | None,
    lines_at_m: Sequence[float] | None,
    first_line_m: float,
) -> Float[np.ndarray, " line"] | None:
    """Places of lines to the right of the origin, if measured by tape."""
    if lines_at_m is not None:
        if line_spacing_m is not None or first_line_m != 0.0:
            other = "first_line_m" if line_spacing_m is None else "line_spacing_m"
            raise ArgumentError(f"lines_at_m, {other}", "one of them", "both")
        right_m = np.asarray(lines_at_m, dtype=np.float64)
        if len(right_m) != lines or not np.all(np.isfinite(right_m)):
            expected = f"{lines} distances in metres, one for each line" if lines > 1 else "one distance, for one line"
            found = " ".join(f"{each:g}" for each in right_m[:12]) + (" ..." if len(right_m) > 12 else "")
            raise ArgumentError("lines_at_m", expected, f"{len(right_m)}: {found}")
        apart_m = np.diff(np.sort(right_m))
        if np.any(apart_m < _SAME_LINE_M):
            raise ArgumentError("lines_at_m", "lines at different distances", f"two within {apart_m.min():g} m")
        if np.any(apart_m > _FARTHEST_LINES_M):
            expected = f"metres, neighbours up to {_FARTHEST_LINES_M:g} m apart"
            raise ArgumentError("lines_at_m", expected, f"two {apart_m.max():g} m apart")
        return right_m
    if line_spacing_m is None:
        if first_line_m != 0.0:
            raise ArgumentError("first_line_m", "--line-spacing-m as well", "none")
        return None
    if lines > 1 and not 0.0 < line_spacing_m <= _FARTHEST_LINES_M:
        expected = f"metres, above 0 and up to {_FARTHEST_LINES_M:g}"
        raise ArgumentError("line_spacing_m", expected, f"{line_spacing_m:g}")
    return first_line_m + np.arange(lines) * line_spacing_m


_FIX_SIGMA_M = {4: 0.05, 5: 0.5, 2: 2.0}
"""Sigma of a receiver's positions by their quality as in GGA; 5 m for any other, or where it is not stated."""
_SURE_SIGMAS = 4.0


def _with_believed_lengths(survey: Sequence[SurveyLine], length_m: float | None) -> tuple[list[SurveyLine], list[str]]:
    """Lines with the length of the more reliable source and usable positions, and notes on disagreements.

    A receiver is preferred to a header if their difference is far beyond its noise, because spacings are typed in by
    hand. A receiver at standstill while the header's traces continue is not used.
    """
    believed, notes = list(survey), []
    for i, (line, side) in enumerate(survey):
        name, header_m = line.path.name, line.length_m(0, len(line.channels) - 1)
        if length_m is not None and lengths_disagree(header_m, length_m):
            notes.append(f"{name}: the header says {header_m:.2f} m, the given length is {length_m:.2f} m: it is used")
        if side is None or side.kind != "degrees" or not side.numbered or side.path == line.path:
            continue
        own = side.trace < len(line.channels)
        first, last = (int(side.trace[own][end]) for end in (0, -1))
        header_m = line.length_m(first, last)
        quality = np.nan if side.quality is None else float(np.median(side.quality[own]))
        sigma_m = _FIX_SIGMA_M.get(int(np.nan_to_num(quality)), 5.0)
        receiver_m = path_length_m(side.y[own], side.x[own], 10.0 * sigma_m)
        sure_m = _SURE_SIGMAS * sigma_m
        if not lengths_disagree(header_m, receiver_m) or abs(receiver_m - header_m) < sure_m:
            continue
        if receiver_m < sure_m:
            believed[i] = SurveyLine(line, None)
            used = "the header is used, the receiver stood still"
        else:
            scale = receiver_m / header_m
            scaled = replace(
                line,
                spacing_m=None if line.spacing_m is None else line.spacing_m * scale,
                positions_m=None if line.positions_m is None else line.positions_m * scale,
            )
            believed[i] = SurveyLine(scaled, side)
            used = f"the receiver is used, all spacings times {scale:.4g}"
        traces = f"from trace {first} to {last}"
        notes.append(f"{name}: {traces} the header says {header_m:.2f} m, {side.path.name} {receiver_m:.2f} m: {used}")
    return believed, notes
