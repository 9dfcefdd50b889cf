"""Parallel lines of a survey as one drive of a wide array: every line becomes a channel."""

import hashlib
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyproj
from jaxtyping import Bool, Float, Num

from lgprjax.errors import InputError
from lgprjax.formats.drive_description import DriveDescription, NavigationTrack, OdometryTrack, TraceRecording
from lgprjax.formats.drive_writer import DriveWriter
from lgprjax.formats.dt1 import read_dt1
from lgprjax.formats.dzt import read_dzt
from lgprjax.formats.mala import read_mala
from lgprjax.formats.profile import Profile
from lgprjax.radar.array import ArrayGeometry

READERS = {".dt1": read_dt1, ".dzt": read_dzt, ".rd3": read_mala, ".rd7": read_mala}
# A survey has no clock that matters: scans are timed as if walked at this speed.
SURVEY_SPEED_MPS = 1.0
_SIGMA_M = 0.05
_SIGMA_DEG = 0.5
# Time zeros closer than this are the same (8 ps at 0.4 ns a sample); farther than this share, another recording.
_SAME_TIME_ZERO_SAMPLES = 0.02
_LARGEST_SHIFT = 0.05


def read_profile(path: str | Path) -> Profile:
    """Read a vendor's file by its suffix: ``.dt1``, ``.dzt``, ``.rd3`` or ``.rd7``. Raises ``InputError``."""
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
        latitude_deg, longitude_deg: origin, WGS-84.
        heading_deg: direction of the lines, clockwise from true north.
        output: the drive log.
        force: replace an output that exists.

    Raises:
        InputError: a file cannot be read, or the lines do not belong together.
    """
    profiles = [read_profile(path) for path in paths]
    if not profiles:
        raise InputError(output, "lines", "at least one file", "none")
    if len(profiles) == 1:
        only = profiles[0]
        lines = [replace(only, channels=only.channels[:, c : c + 1]) for c in range(only.channels.shape[1])]
    else:
        lines = profiles
    _check_arguments(output, len(lines), line_spacing_m, length_m, reversed_lines)
    _check_lines(lines)

    time_zero_ns = float(np.median([line.time_zero_ns for line in lines]))
    along = [_along_m(lines, i, length_m, i in reversed_lines) for i in range(len(lines))]
    step_m = _common_step_m(lines, length_m)
    scan_m = np.arange(int(np.floor(max(a.max() for a in along) / step_m + 1e-6)) + 1) * step_m
    columns = [
        _resampled(line, a, scan_m, time_zero_ns, i in reversed_lines)
        for i, (line, a) in enumerate(zip(lines, along, strict=True))
    ]
    traces = np.stack([column for column, _ in columns], axis=1)
    if traces.dtype.kind == "f":
        traces = traces.astype(np.float32)
    valid = np.stack([covered for _, covered in columns], axis=1)

    offsets_m = first_line_m + np.arange(len(lines)) * line_spacing_m
    frequencies = [line.centre_frequency_hz for line in lines if line.centre_frequency_hz is not None]
    description = DriveDescription(
        name=Path(output).name.split(".")[0],
        # The vendors' clocks are no UTC: the epoch says that the moment is not known.
        t0_utc="1970-01-01T00:00:00Z",
        array=ArrayGeometry(np.zeros(len(lines)), -offsets_m, np.zeros(len(lines)), 0.0),
        recording=TraceRecording(
            lines[0].sample_interval_ns, time_zero_ns, 0.0, frequencies[0] if frequencies else None, traces.shape[2]
        ),
        navigation=_straight_track(scan_m, latitude_deg, longitude_deg, heading_deg),
        odometry=OdometryTrack(scan_m / SURVEY_SPEED_MPS, scan_m),
        truth=None,
        vehicle=None,
        provenance={
            "made_by": "lgprjax import lines",
            "inputs": [{"file": Path(p).name, "sha256": _sha256(Path(p))} for p in paths],
            "line_spacing_m": line_spacing_m,
            "first_line_m": first_line_m,
            "length_m": length_m,
            "reversed_lines": list(reversed_lines),
            "scan_step_m": step_m,
            "assumed_survey_speed_mps": SURVEY_SPEED_MPS,
            "line_time_zero_ns": [line.time_zero_ns for line in lines],
        },
    )
    with DriveWriter.create(output, description, channels=len(lines), dtype=traces.dtype, force=force) as writer:
        writer.append(scan_m / SURVEY_SPEED_MPS, traces, valid)


def _sha256(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


def _check_arguments(
    output: str | Path, lines: int, line_spacing_m: float, length_m: float | None, reversed_lines: Sequence[int]
) -> None:
    if lines > 1 and not (np.isfinite(line_spacing_m) and line_spacing_m > 0):
        raise InputError(output, "line spacing", "a length above zero", f"{line_spacing_m:g} m")
    if length_m is not None and not (np.isfinite(length_m) and length_m > 0):
        raise InputError(output, "line length", "a length above zero", f"{length_m:g} m")
    for index in reversed_lines:
        if not 0 <= index < lines:
            raise InputError(output, "reversed lines", f"numbers from 0 to {lines - 1}", str(index))


def _check_lines(lines: list[Profile]) -> None:
    first = lines[0]
    time_zero_ns = float(np.median([line.time_zero_ns for line in lines]))
    for line in lines:
        if line.channels.shape[1] != 1:
            found = str(line.channels.shape[1])
            raise InputError(line.path, "channels", "one a file when several files are given", found)
        if len(line.channels) < 2:
            raise InputError(line.path, "traces", "at least 2", str(len(line.channels)))
        if line.channels.shape[2] != first.channels.shape[2]:
            expected = f"{first.channels.shape[2]} as in {first.path.name}"
            raise InputError(line.path, "samples a trace", expected, str(line.channels.shape[2]))
        if abs(line.sample_interval_ns / first.sample_interval_ns - 1) > 1e-3:
            expected = f"{first.sample_interval_ns:g} ns as in {first.path.name}"
            raise InputError(line.path, "sample interval", expected, f"{line.sample_interval_ns:g} ns")
        shift = abs(line.time_zero_ns - time_zero_ns) / line.sample_interval_ns
        if shift > _LARGEST_SHIFT * line.channels.shape[2]:
            raise InputError(line.path, "time zero", f"about {time_zero_ns:g} ns", f"{line.time_zero_ns:g} ns")


def _along_m(lines: list[Profile], index: int, length_m: float | None, backwards: bool) -> Float[np.ndarray, " trace"]:
    """Position of each trace along the drive, rising; a line recorded backwards is flipped before."""
    line = lines[index]
    traces = len(line.channels)
    if length_m is not None:
        return np.linspace(0.0, length_m, traces)
    if line.spacing_m is None:
        raise InputError(line.path, "trace spacing", "a spacing in the header, or the length of the line", "none")
    starts = [0.0 if other.positions_m is None else float(other.positions_m[0]) for other in lines]
    start_m = 0.0 if backwards else starts[index] - min(starts)
    return start_m + np.arange(traces) * line.spacing_m


def _common_step_m(lines: list[Profile], length_m: float | None) -> float:
    if length_m is not None:
        return length_m / (max(len(line.channels) for line in lines) - 1)
    return min(line.spacing_m for line in lines if line.spacing_m is not None)


def _resampled(
    line: Profile,
    along_m: Float[np.ndarray, " trace"],
    scan_m: Float[np.ndarray, " scan"],
    time_zero_ns: float,
    backwards: bool,
) -> tuple[Num[np.ndarray, "scan sample"], Bool[np.ndarray, " scan"]]:
    """One line at the common scans and the common time zero; as recorded where nothing has to be moved."""
    traces = line.traces[::-1] if backwards else line.traces
    shift = (line.time_zero_ns - time_zero_ns) / line.sample_interval_ns
    if abs(shift) > _SAME_TIME_ZERO_SAMPLES:
        traces = _interpolated(traces.T, np.clip(np.arange(traces.shape[1]) + shift, 0, traces.shape[1] - 1)).T
    place = (scan_m - along_m[0]) / (along_m[1] - along_m[0])
    covered = (place > -1e-3) & (place < len(traces) - 1 + 1e-3)
    nearest = np.rint(place[covered])
    rows = nearest.astype(np.intp) if np.all(np.abs(place[covered] - nearest) < 1e-3) else None
    moved = traces[rows] if rows is not None else _interpolated(traces, np.clip(place[covered], 0, len(traces) - 1))
    column = np.zeros((len(scan_m), traces.shape[1]), dtype=moved.dtype)
    column[covered] = moved
    return column, covered


def _interpolated(
    rows: Num[np.ndarray, "row column"], at: Float[np.ndarray, " place"]
) -> Float[np.ndarray, "place column"]:
    """Rows at fractional row numbers, linear between neighbours; float32."""
    low = np.minimum(at.astype(np.intp), len(rows) - 2)
    weight = (at - low)[:, None].astype(np.float32)
    values = rows.astype(np.float32)
    between: np.ndarray = (1 - weight) * values[low] + weight * values[low + 1]
    return between


def _straight_track(
    along_m: Float[np.ndarray, " scan"], latitude_deg: float, longitude_deg: float, heading_deg: float
) -> NavigationTrack:
    count = len(along_m)
    longitude, latitude, heading = (np.full(count, v) for v in (longitude_deg, latitude_deg, heading_deg))
    longitudes, latitudes, back = pyproj.Geod(ellps="WGS84").fwd(longitude, latitude, heading, along_m)
    zeros = np.zeros(count)
    sigma_m, sigma_deg = np.full(count, _SIGMA_M), np.full(count, _SIGMA_DEG)
    return NavigationTrack(
        time_s=along_m / SURVEY_SPEED_MPS,
        latitude_deg=np.asarray(latitudes),
        longitude_deg=np.asarray(longitudes),
        height_m=zeros,
        heading_deg=(np.asarray(back) + 180.0) % 360.0,
        roll_deg=zeros,
        sigma_east_m=sigma_m,
        sigma_north_m=sigma_m,
        sigma_height_m=sigma_m,
        sigma_heading_deg=sigma_deg,
        sigma_roll_deg=sigma_deg,
    )
