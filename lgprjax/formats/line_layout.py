"""Parallel lines laid side by side: every line becomes a channel of one wide array that drives straight ahead."""

import hashlib
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float, Num

from lgprjax.errors import ArgumentError, InputError
from lgprjax.formats.drive import DriveDescription, DriveWriter, NavigationTrack, OdometryTrack, TraceRecording
from lgprjax.formats.profile import Assumed, Profile
from lgprjax.formats.survey_track import (
    CLOCK_ASSUMED,
    SURVEY_SPEED_MPS,
    TRACK_ASSUMED,
    SurveyOrigin,
    distances_m,
    path_headings_deg,
    straight_track,
    track,
)
from lgprjax.radar.array import ArrayGeometry

# Time zeros closer than this are the same (8 ps at 0.4 ns a sample); beyond this share, another recording.
_SAME_TIME_ZERO_SAMPLES = 0.02
_LARGEST_SHIFT = 0.05
# Places closer than this share of a step to a grid of even steps were rounded from it.
_ROUNDED = 0.01
# A gap of more usual steps than this is left open, not bridged; a line with more steps per trace is refused.
_LARGEST_GAP_STEPS = 3.0
_STEPS_A_TRACE = 20
_LARGEST_STEP_M = 10.0


def write_lines(
    lines: Sequence[Profile],
    *,
    left_m: Float[np.ndarray, " line"] | None = None,
    forward_m: Float[np.ndarray, " line"] | None = None,
    place: SurveyOrigin,
    output: str | Path,
    provenance: dict[str, object],
    assumed: Assumed,
    length_m: float | None = None,
    along_m: Sequence[Float[np.ndarray, " _"]] | None = None,
    force: bool = False,
) -> Assumed:
    """Write lines of one channel each as one drive log that leaves ``place`` straight along its heading.

    Args:
        lines: the lines, leftmost first.
        left_m, forward_m: place of each line's antenna in the body frame, m; ``None``: on the axis, at the origin.
        place: origin and direction.
        output: path of the drive log.
        provenance: provenance of the drive log; the resampling of the lines is added.
        assumed: assumptions of the caller; take precedence over those made here for any straight line.
        length_m: spread every line evenly over this length (both ends on the tape) and resample it to the common
            step. Without it lines keep the spacing and start of their headers and may end early.
        along_m: position of each line's traces ahead of ``place``, rising, where known from another source.
        force: whether to replace an existing output.

    Returns:
        All assumptions, as stored in the provenance.

    Raises:
        InputError: the lines do not belong together, or an option is invalid.
    """
    place.check()
    check_length(length_m)
    check_alike(lines)
    time_zero_ns = float(np.median([line.time_zero_ns for line in lines]))
    check_time_zeros(lines, time_zero_ns)

    along = [_along_m(lines, i, length_m) for i in range(len(lines))] if along_m is None else along_m
    along = [_on_own_grid(each) for each in along]
    for line, own in zip(lines, along, strict=True):
        check_steps(line, own)
    step_m = _common_step_m(lines, along, length_m)
    start_m = min(float(a[0]) for a in along)
    # Scans are on one grid from the origin, so that lines surveyed on it stay as recorded.
    first = int(np.floor(start_m / step_m + 1e-6))
    scan_m = np.arange(first, int(np.floor(max(a[-1] for a in along) / step_m + 1e-6)) + 1) * step_m
    columns = [_resampled(line, a, scan_m, time_zero_ns) for line, a in zip(lines, along, strict=True)]
    traces = np.stack([column for column, _ in columns], axis=1)
    if traces.dtype.kind == "f":
        traces = traces.astype(np.float32)
    valid = np.stack([covered for _, covered in columns], axis=1)

    travel_m = scan_m - scan_m[0]
    time_s = travel_m / SURVEY_SPEED_MPS
    by_tape, by_header = f"evenly over {length_m or 0.0:g} m", "trace spacing or positions of the header"
    whole: Assumed = {
        **CLOCK_ASSUMED,
        "odometry": by_header if length_m is None else by_tape,
        "position": "straight from the origin",
        "heading": f"{place.heading_deg:g} degrees all along",
        "height": "taken as 0",
        **TRACK_ASSUMED,
        **assumed,
    }
    middle = np.zeros(len(lines))
    _write(
        lines,
        traces,
        valid,
        time_zero_ns=time_zero_ns,
        array=ArrayGeometry(
            middle if forward_m is None else forward_m, middle if left_m is None else left_m, middle, 0.0
        ),
        navigation=straight_track(scan_m, place, time_s),
        travel_m=travel_m,
        output=output,
        provenance=provenance
        | {
            "length_m": length_m,
            "scan_step_m": step_m,
            "assumed": whole,
            "line_time_zero_ns": [line.time_zero_ns for line in lines],
        },
        force=force,
    )
    return whole


def _write(
    lines: Sequence[Profile],
    traces: Num[np.ndarray, "scan channel sample"],
    valid: Bool[np.ndarray, "scan channel"] | None,
    *,
    time_zero_ns: float,
    array: ArrayGeometry,
    navigation: NavigationTrack,
    travel_m: Float[np.ndarray, " scan"],
    output: str | Path,
    provenance: dict[str, object],
    force: bool,
) -> None:
    """Write traces of lines as a drive; the vendors' clocks are not UTC: the epoch means that the time is unknown."""
    frequencies = [line.centre_frequency_hz for line in lines if line.centre_frequency_hz is not None]
    description = DriveDescription(
        name=Path(output).name.split(".")[0],
        t0_utc="1970-01-01T00:00:00Z",
        array=array,
        recording=TraceRecording(
            lines[0].sample_interval_ns, time_zero_ns, 0.0, frequencies[0] if frequencies else None, traces.shape[2]
        ),
        navigation=navigation,
        odometry=OdometryTrack(navigation.time_s, travel_m),
        truth=None,
        vehicle=None,
        provenance=provenance,
    )
    with DriveWriter.create(output, description, channels=traces.shape[1], dtype=traces.dtype, force=force) as writer:
        writer.append(navigation.time_s, traces, valid)


def inputs_of(paths: Sequence[str | Path]) -> list[dict[str, str]]:
    """Names and SHA-256 of input files, for the provenance."""
    return [{"file": Path(p).name, "sha256": hashlib.sha256(Path(p).read_bytes()).hexdigest()} for p in paths]


def check_length(length_m: float | None) -> None:
    """Raise ``ArgumentError`` for an invalid length of a line."""
    if length_m is not None and not (np.isfinite(length_m) and length_m > 0):
        raise ArgumentError("length_m", "a length above zero", f"{length_m:g}")


def check_alike(lines: Sequence[Profile]) -> None:
    """Raise ``InputError`` unless lines have one channel each, and the samples of the first."""
    first = lines[0]
    for line in lines:
        if len(line.channels) < 2:
            raise InputError(line.path, "traces", "at least 2", str(len(line.channels)))
        if line.channels.shape[2] != first.channels.shape[2]:
            expected = f"{first.channels.shape[2]} as in {first.path.name}"
            raise InputError(line.path, "samples a trace", expected, str(line.channels.shape[2]))
        if abs(line.sample_interval_ns / first.sample_interval_ns - 1) > 1e-3:
            expected = f"{first.sample_interval_ns:g} ns as in {first.path.name}"
            raise InputError(line.path, "sample interval", expected, f"{line.sample_interval_ns:g} ns")


def check_time_zeros(lines: Sequence[Profile], time_zero_ns: float) -> None:
    """Raise ``InputError`` for a line whose time zero is far from a common one: another recording."""
    for line in lines:
        shift = abs(line.time_zero_ns - time_zero_ns) / line.sample_interval_ns
        if shift > _LARGEST_SHIFT * line.channels.shape[2]:
            raise InputError(line.path, "time zero", f"about {time_zero_ns:g} ns", f"{line.time_zero_ns:g} ns")


def _along_m(lines: Sequence[Profile], index: int, length_m: float | None) -> Float[np.ndarray, " trace"]:
    """Position of each trace along the drive, rising."""
    starts = [0.0 if other.positions_m is None else float(other.positions_m[0]) for other in lines]
    start_m = 0.0 if length_m is not None else starts[index] - min(starts)
    return np.asarray(start_m + own_distances_m(lines[index], length_m))


def own_distances_m(line: Profile, length_m: float | None) -> Float[np.ndarray, " trace"]:
    """Distance of each trace from its line's first, rising. Raises ``InputError`` if the line does not have it."""
    traces = len(line.channels)
    if length_m is not None:
        return np.linspace(0.0, length_m, traces)
    if line.spacing_m is not None:
        return np.arange(traces) * line.spacing_m
    if line.positions_m is None:
        found = f"none (coordinates: {line.metadata['coordinates']})" if "coordinates" in line.metadata else "none"
        raise InputError(line.path, "trace spacing", "a spacing in the header, or --length-m", found)
    own = np.asarray(line.positions_m - line.positions_m[0])
    own = -own if own[-1] < 0.0 else own
    check_rising(line, own)
    return own


def check_rising(line: Profile, place_m: Float[np.ndarray, " trace"]) -> None:
    """Raise ``InputError`` unless places rise from trace to trace, in similar steps."""
    steps_m = np.diff(place_m)
    usual_m = float(np.median(steps_m))
    if np.any(steps_m <= 0):
        bad = int(np.argmax(steps_m <= 0))
        expected = "positions that rise from trace to trace, or --length-m"
    elif place_m[-1] - place_m[0] > _STEPS_A_TRACE * len(place_m) * usual_m:
        bad = int(np.argmax(steps_m))
        expected = f"steps near the usual {usual_m:g} m"
    else:
        return
    raise InputError(line.path, f"position of trace {bad + 1}", expected, f"a step of {steps_m[bad]:g} m")


def check_steps(line: Profile, place_m: Float[np.ndarray, " trace"]) -> None:
    """Raise ``InputError`` where most traces are farther apart than any radar records them: places in another unit."""
    usual_m = float(np.median(np.diff(place_m)))
    if usual_m > _LARGEST_STEP_M:
        expected = f"metres, traces up to {_LARGEST_STEP_M:g} m apart (are the positions in millimetres?)"
        raise InputError(line.path, "trace spacing", expected, f"{usual_m:g} m from trace to trace")


def _on_own_grid(along_m: Float[np.ndarray, " trace"]) -> Float[np.ndarray, " trace"]:
    """Positions that are whole numbers of one step apart, rounded to them exactly; others are unchanged.

    Headers round places: a step between two of them is off by more than the step that all of them have.
    """
    steps_m = np.diff(along_m)
    usual_m = float(np.median(steps_m))
    if not usual_m > 0.0:
        return along_m
    number = np.concatenate([[0.0], np.cumsum(np.rint(steps_m / usual_m))])
    step_m = float(number @ (along_m - along_m[0]) / (number @ number))
    even = along_m[0] + number * step_m
    return even if np.all(np.abs(even - along_m) < _ROUNDED * step_m) else along_m


def _common_step_m(lines: Sequence[Profile], along: Sequence[Float[np.ndarray, " _"]], length_m: float | None) -> float:
    if length_m is not None:
        return length_m / (max(len(line.channels) for line in lines) - 1)
    return min(
        float(np.median(np.diff(a))) if line.spacing_m is None else line.spacing_m
        for line, a in zip(lines, along, strict=True)
    )


def _resampled(
    line: Profile,
    along_m: Float[np.ndarray, " trace"],
    scan_m: Float[np.ndarray, " scan"],
    time_zero_ns: float,
) -> tuple[Num[np.ndarray, "scan sample"], Bool[np.ndarray, " scan"]]:
    """One line at the common scans and the common time zero; as recorded if nothing has to be moved.

    Scans beyond the line's ends and within its gaps are not covered.
    """
    traces = at_time_zero(line, time_zero_ns)
    steps_m = np.diff(along_m)
    margin_m = 1e-3 * float(np.median(steps_m))
    covered = (scan_m > along_m[0] - margin_m) & (scan_m < along_m[-1] + margin_m)
    before = np.clip(np.searchsorted(along_m, scan_m, side="right") - 1, 0, len(steps_m) - 1)
    inside = (scan_m > along_m[before] + margin_m) & (scan_m < along_m[before + 1] - margin_m)
    covered &= ~(inside & (steps_m[before] > _LARGEST_GAP_STEPS * np.median(steps_m)))
    at = np.interp(scan_m[covered], along_m, np.arange(len(along_m)))
    nearest = np.rint(at)
    moved = traces[nearest.astype(np.intp)] if np.all(np.abs(at - nearest) < 1e-3) else _interpolated(traces, at)
    column = np.zeros((len(scan_m), traces.shape[1]), dtype=moved.dtype)
    column[covered] = moved
    return column, covered


def at_time_zero(line: Profile, time_zero_ns: float) -> Num[np.ndarray, "trace sample"]:
    """Traces of a line's first channel at another time zero; as recorded if it is the same."""
    shift = (line.time_zero_ns - time_zero_ns) / line.sample_interval_ns
    if abs(shift) <= _SAME_TIME_ZERO_SAMPLES:
        return line.traces
    samples = line.channels.shape[2]
    return _interpolated(line.traces.T, np.clip(np.arange(samples) + shift, 0, samples - 1)).T


def _interpolated(
    rows: Num[np.ndarray, "row column"], at: Float[np.ndarray, " place"]
) -> Float[np.ndarray, "place column"]:
    """Rows at fractional row numbers, linear between neighbours; float32."""
    low = np.minimum(at.astype(np.intp), len(rows) - 2)
    weight = (at - low)[:, None].astype(np.float32)
    values = rows.astype(np.float32)
    between: np.ndarray = (1 - weight) * values[low] + weight * values[low + 1]
    return between


# Lines with a place on the earth for each trace, one after another as passes of one drive log.

_BETWEEN_LINES_M = 100.0
"""Travel recorded from a line's end to the next one's start: longer than any filter along the track, so that none
joins the two.
"""


def write_positioned_lines(
    lines: Sequence[Profile],
    *,
    latitude_deg: Sequence[Float[np.ndarray, " _"]],
    longitude_deg: Sequence[Float[np.ndarray, " _"]],
    travel_m: Sequence[Float[np.ndarray, " _"]],
    output: str | Path,
    provenance: dict[str, object],
    assumed: Assumed,
    force: bool = False,
) -> Assumed:
    """Write lines of one channel each as one drive log of one channel, traces as they were recorded.

    Args:
        lines: lines in the order of driving.
        latitude_deg, longitude_deg: WGS-84 positions of the traces.
        travel_m: travel of the traces along their line, never falling.
        output: path of the drive log.
        provenance: provenance of the drive log.
        assumed: assumptions of the caller; those made here for any such line are added.
        force: whether to replace an existing output.

    Returns:
        All assumptions, as stored in the provenance.

    Raises:
        InputError: a line never moves or has one trace, or the output cannot be written.
    """
    begin_m, times, travels, headings = 0.0, [], [], []
    for line, latitude, longitude, own in zip(lines, latitude_deg, longitude_deg, travel_m, strict=True):
        traces = len(line.channels)
        if traces < 2:
            raise InputError(line.path, "traces", "at least 2", str(traces))
        check_steps(line, distances_m(latitude, longitude))
        try:
            headings.append(path_headings_deg(latitude, longitude, own))
        except ValueError:
            raise InputError(line.path, "positions", "positions along a line", "one position") from None
        travels.append(begin_m + own - own[0])
        # Traces may repeat a position (at standstill, or with coarse coordinates), but a clock must rise.
        length_m = float(own[-1] - own[0])
        times.append((begin_m + np.arange(traces) * length_m / (traces - 1)) / SURVEY_SPEED_MPS)
        begin_m += length_m + _BETWEEN_LINES_M
    time_s = np.concatenate(times)
    time_zero_ns = float(np.median([line.time_zero_ns for line in lines]))
    channels = np.concatenate([at_time_zero(line, time_zero_ns) for line in lines])[:, None, :]
    whole: Assumed = {
        **CLOCK_ASSUMED,
        "heading": "along the path",
        **TRACK_ASSUMED,
        **assumed,
        "height": "taken as 0",
    }
    _write(
        lines,
        channels,
        None,
        time_zero_ns=time_zero_ns,
        array=ArrayGeometry(np.zeros(1), np.zeros(1), np.zeros(1), 0.0),
        navigation=track(time_s, np.concatenate(latitude_deg), np.concatenate(longitude_deg), np.concatenate(headings)),
        travel_m=np.concatenate(travels),
        output=output,
        provenance=provenance | {"assumed": whole},
        force=force,
    )
    return whole
