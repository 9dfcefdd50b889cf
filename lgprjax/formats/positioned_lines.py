"""Lines of which each trace has its own place on the earth, one after another as passes of one drive log."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Float

from lgprjax.errors import InputError
from lgprjax.formats.assumed import Assumed
from lgprjax.formats.drive_description import DriveDescription, OdometryTrack, TraceRecording
from lgprjax.formats.drive_writer import DriveWriter
from lgprjax.formats.parallel_lines import at_time_zero
from lgprjax.formats.profile import Profile
from lgprjax.formats.survey_track import CLOCK_ASSUMED, SURVEY_SPEED_MPS, TRACK_ASSUMED, path_headings_deg, track
from lgprjax.radar.array import ArrayGeometry

_BETWEEN_LINES_M = 100.0
"""Travel that is written down from a line's end to the next one's start: more than any filter along the track spans,
so that no filter takes the two for one."""


def write_positioned_lines(
    lines: Sequence[Profile],
    *,
    latitude_deg: Sequence[Float[np.ndarray, " _"]],
    longitude_deg: Sequence[Float[np.ndarray, " _"]],
    height_m: Sequence[Float[np.ndarray, " _"]] | None,
    travel_m: Sequence[Float[np.ndarray, " _"]],
    output: str | Path,
    provenance: dict[str, object],
    assumed: Assumed,
    force: bool = False,
) -> Assumed:
    """Write lines of one channel each as one drive log of one channel, traces as they were recorded.

    Args:
        lines: in the order in which they were driven.
        latitude_deg, longitude_deg, height_m: of the traces, WGS-84.
        travel_m: of the traces along their line, never falling.
        output: the drive log.
        provenance: what the drive log says about its making.
        assumed: what the caller assumed; what is assumed here of any such line is added.
        force: replace an output that exists.

    Returns:
        All that was assumed, as the provenance holds it.

    Raises:
        InputError: a line never moves or has one trace, or the output cannot be written.
    """
    begin_m, times, travels, headings = 0.0, [], [], []
    for line, latitude, longitude, own in zip(lines, latitude_deg, longitude_deg, travel_m, strict=True):
        traces = len(line.channels)
        if traces < 2:
            raise InputError(line.path, "traces", "at least 2", str(traces))
        try:
            headings.append(path_headings_deg(latitude, longitude, own))
        except ValueError:
            raise InputError(line.path, "positions", "a line that moves", "one place") from None
        travels.append(begin_m + own - own[0])
        # Traces may repeat a place (the antenna stood, or coordinates are coarse): a clock must rise all the same.
        length_m = float(own[-1] - own[0])
        times.append((begin_m + np.arange(traces) * length_m / (traces - 1)) / SURVEY_SPEED_MPS)
        begin_m += length_m + _BETWEEN_LINES_M
    time_s = np.concatenate(times)
    time_zero_ns = float(np.median([line.time_zero_ns for line in lines]))
    channels = np.concatenate([at_time_zero(line, time_zero_ns) for line in lines])[:, None, :]
    frequencies = [line.centre_frequency_hz for line in lines if line.centre_frequency_hz is not None]
    whole: Assumed = {**CLOCK_ASSUMED, "heading": "along the path", **TRACK_ASSUMED, **assumed}
    if height_m is None:
        whole["height"] = "taken as 0"
    description = DriveDescription(
        name=Path(output).name.split(".")[0],
        t0_utc="1970-01-01T00:00:00Z",  # the moment is not known
        array=ArrayGeometry(np.zeros(1), np.zeros(1), np.zeros(1), 0.0),
        recording=TraceRecording(
            lines[0].sample_interval_ns,
            time_zero_ns,
            0.0,
            frequencies[0] if frequencies else None,
            channels.shape[2],
        ),
        navigation=track(
            time_s,
            np.concatenate(latitude_deg),
            np.concatenate(longitude_deg),
            np.concatenate(headings),
            None if height_m is None else np.concatenate(height_m),
        ),
        odometry=OdometryTrack(time_s, np.concatenate(travels)),
        truth=None,
        vehicle=None,
        provenance=provenance | {"assumed": whole},
    )
    with DriveWriter.create(output, description, channels=1, dtype=channels.dtype, force=force) as writer:
        writer.append(time_s, channels)
    return whole
