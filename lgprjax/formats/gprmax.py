"""gprMax results (``.out`` of version 3, ``.h5`` of version 4): single traces or a merged B-scan, as one line.

Only the files are read, by the layout that gprMax publishes; gprMax itself is not needed.
"""

import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Float

from lgprjax.errors import InputError
from lgprjax.formats.band_limited import PASSBAND, resample, share_above
from lgprjax.formats.gprmax_file import GprMaxTraces, read_gprmax_file
from lgprjax.formats.parallel_lines import inputs_of, write_lines
from lgprjax.formats.profile import Profile
from lgprjax.formats.survey_track import Place

# Sample intervals to choose from, ns: the coarsest that keeps all but this share of the energy is taken.
_INTERVALS_NS = (1.0, 0.5, 0.25, 0.2, 0.1, 0.05, 0.025, 0.02, 0.01)
_LOST_ENERGY = 1e-4


def read_gprmax(
    paths: Sequence[str | Path],
    *,
    component: str | None = None,
    receiver: int = 1,
    sample_interval_ns: float | None = None,
    time_zero_ns: float = 0.0,
    start_m: float = 0.0,
    step_m: float | None = None,
) -> Profile:
    """Read the files of single traces of one B-scan, in the order of their numbers, or one merged B-scan.

    A single trace lies midway between its source and receiver; the midpoints must lie in a line, and the position
    is the distance along it. A merged file has lost them: ``start_m`` and ``step_m`` say them. The simulation's
    interval, some picoseconds, is resampled without aliases.

    Args:
        paths: the files, in any order.
        component: field component; without it ``Ez``, or the only one there is.
        receiver: number of the receiver, from 1.
        sample_interval_ns: interval to resample to; without it the coarsest of 0.01 to 1 ns that keeps 99.99 % of
            the energy.
        time_zero_ns: time of the simulation that counts as zero, such as the delay of the source's pulse.
        start_m, step_m: position of the first trace and distance between traces of a merged file.

    Raises:
        InputError: a file is missing, damaged or another format, or the files are no B-scan.
    """
    files = _in_order(paths)
    if not files:
        raise InputError("files", "gprMax files", "at least one", "none")
    _check_options(files[0], receiver, sample_interval_ns, time_zero_ns, start_m, step_m)
    read = [read_gprmax_file(file, receiver, component) for file in files]
    first = read[0]
    for file, trace in zip(files, read, strict=True):
        if len(files) > 1 and len(trace.traces) > 1:
            raise InputError(file, "traces", "one a file when several files are given", str(len(trace.traces)))
        same = (trace.traces.shape[1], trace.component) == (first.traces.shape[1], first.component)
        if not same or abs(trace.dt_s / first.dt_s - 1) > 1e-9 or abs(trace.start_s - first.start_s) > 1e-15:
            raise InputError(file, "recording", f"{_told(first)} as in {files[0].name}", _told(trace))
    traces = np.concatenate([trace.traces for trace in read])
    merged = len(files) == 1 and len(traces) > 1
    if merged and step_m is None:
        raise InputError(files[0], "positions", "--step-m (a merged file has lost them)", "none")
    if not merged and step_m is not None:
        raise InputError(files[0], "--step-m", "a merged B-scan", "files that say their positions")
    positions_m = start_m + np.arange(len(traces)) * (step_m or 0.0) if merged else _positions_m(files, read)
    steps = np.diff(positions_m)
    even = len(steps) > 0 and bool(np.all(np.abs(steps - steps.mean()) < 1e-3 * steps.mean()))

    dt_ns = first.dt_s * 1e9
    interval_ns = _chosen_interval_ns(traces, dt_ns) if sample_interval_ns is None else sample_interval_ns
    if interval_ns < dt_ns * (1 - 1e-9):
        raise InputError(files[0], "sample interval", f"at least the simulation's {dt_ns:.6g} ns", f"{interval_ns:g}")
    coarse = resample(traces, dt_ns, interval_ns)
    return Profile(
        path=files[0],
        channels=coarse[:, None, :].astype(np.float32),
        sample_interval_ns=interval_ns,
        time_zero_ns=time_zero_ns - first.start_s * 1e9,
        spacing_m=float(steps.mean()) if even else None,
        centre_frequency_hz=first.centre_frequency_hz,
        positions_m=positions_m,
        metadata={
            "component": first.component,
            "receiver": receiver,
            "simulated_interval_ns": dt_ns,
            "sample_interval_ns": interval_ns,
            "energy_above_passband": share_above(traces, dt_ns, PASSBAND / interval_ns),
            "positions": "given" if merged else "midpoints of source and receiver",
        },
    )


def import_gprmax(
    paths: Sequence[str | Path],
    *,
    component: str | None = None,
    receiver: int = 1,
    sample_interval_ns: float | None = None,
    time_zero_ns: float = 0.0,
    start_m: float = 0.0,
    step_m: float | None = None,
    place: Place,
    output: str | Path,
    force: bool = False,
) -> None:
    """Write a simulated B-scan as a drive log of one channel that leaves ``place`` straight along its heading.

    The arguments are those of ``read_gprmax``. Position 0 of the model stands at the origin, so that passes over one
    model lie where they belong.

    Raises:
        InputError: see ``read_gprmax``.
    """
    profile = read_gprmax(
        paths,
        component=component,
        receiver=receiver,
        sample_interval_ns=sample_interval_ns,
        time_zero_ns=time_zero_ns,
        start_m=start_m,
        step_m=step_m,
    )
    assert profile.positions_m is not None
    provenance = {
        "made_by": "lgprjax import gprmax",
        "inputs": inputs_of(_in_order(paths)),
        "first_position_m": float(profile.positions_m[0]),
        **profile.metadata,
    }
    write_lines(
        [profile],
        left_m=np.zeros(1),
        forward_m=np.zeros(1),
        place=place.ahead(float(profile.positions_m[0])),
        output=output,
        provenance=provenance,
        assumed={"odometry": "places of the traces in the model", **place.assumed()},
        force=force,
    )


def _in_order(paths: Sequence[str | Path]) -> list[Path]:
    """Files by the numbers in their names: 2 before 10."""

    def by_number(file: Path) -> list[tuple[int, str]]:
        return [(int(part), "") if part.isdecimal() else (-1, part) for part in re.split(r"(\d+)", file.name)]

    return sorted((Path(path) for path in paths), key=by_number)


def _check_options(
    file: Path,
    receiver: int,
    sample_interval_ns: float | None,
    time_zero_ns: float,
    start_m: float,
    step_m: float | None,
) -> None:
    if receiver < 1:
        raise InputError(file, "receiver", "a number from 1", str(receiver))
    for name, value in (("sample interval", sample_interval_ns), ("step", step_m)):
        if value is not None and not (np.isfinite(value) and value > 0):
            raise InputError(file, name, "a number above zero", f"{value:g}")
    for name, value in (("time zero", time_zero_ns), ("start", start_m)):
        if not np.isfinite(value):
            raise InputError(file, name, "a number", f"{value:g}")


def _positions_m(files: list[Path], read: list[GprMaxTraces]) -> Float[np.ndarray, " trace"]:
    """Distance of each midpoint along their line, from the origin of the model's axes."""
    points = np.stack([trace.midpoint_m for trace in read if trace.midpoint_m is not None])
    length_m = float(np.linalg.norm(points[-1] - points[0]))
    if len(points) < 2 or length_m == 0:
        raise InputError(files[0], "positions", "files of at least 2 traces in different places", str(len(points)))
    direction = (points[-1] - points[0]) / length_m
    along: np.ndarray = points @ direction
    off_m = np.linalg.norm(points - points[0] - np.outer(along - along[0], direction), axis=1)
    worst = int(np.argmax(off_m))
    if off_m[worst] > 1e-3 * length_m + 1e-6:
        raise InputError(files[worst], "position", "midpoints in a line", f"{off_m[worst]:g} m off it")
    back = np.flatnonzero(np.diff(along) <= 0)
    if back.size:
        found = f"{along[back[0] + 1]:g} m after {along[back[0]]:g} m"
        raise InputError(files[back[0] + 1], "position", "positions that rise with the number of the file", found)
    return along


def _chosen_interval_ns(traces: Float[np.ndarray, "trace sample"], dt_ns: float) -> float:
    for interval_ns in _INTERVALS_NS:
        if interval_ns >= dt_ns and share_above(traces, dt_ns, PASSBAND / interval_ns) < _LOST_ENERGY:
            return interval_ns
    return dt_ns


def _told(trace: GprMaxTraces) -> str:
    return f"{trace.component} of {trace.traces.shape[1]} samples of {trace.dt_s * 1e9:.6g} ns"
