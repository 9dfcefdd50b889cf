"""gprMax results (``.out`` of version 3, ``.h5`` of version 4): single traces or a merged B-scan, as one line.

Only the files are read, by the layout that gprMax publishes; gprMax itself is not needed.
"""

import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import h5py
import numpy as np
from jaxtyping import Float

from lgprjax.errors import InputError
from lgprjax.formats.line_layout import inputs_of, write_lines
from lgprjax.formats.profile import Profile
from lgprjax.formats.store import DAMAGE
from lgprjax.formats.survey_track import SurveyOrigin

# One file of gprMax: the traces of a receiver, their interval, and the places of source and receiver.

# Models are metres in size: positions beyond this are damage.
_FARTHEST_M = 1e6


class GprMaxTraces(NamedTuple):
    """Contents of one file.

    Attributes:
        traces: one trace, or those of a merged B-scan.
        dt_s: simulated interval between samples.
        start_s: time of the first sample.
        midpoint_m: midpoint between source and receiver; ``None`` in a merged file, which lacks it.
        centre_frequency_hz: centre frequency of the source's pulse, if known (version 4).
        component: field component.
    """

    traces: Float[np.ndarray, "trace sample"]
    dt_s: float
    start_s: float
    midpoint_m: Float[np.ndarray, " 3"] | None
    centre_frequency_hz: float | None
    component: str


def read_gprmax_file(file: Path, receiver: int, component: str | None) -> GprMaxTraces:
    """Read a component (``None``: Ez, or the only one) of a receiver (from 1). Raises ``InputError``."""
    with _opened(file) as store:
        if not isinstance(store.get("rxs"), h5py.Group):
            raise InputError(file, "rxs", "the receivers of a gprMax file", "none")
        group = store["rxs"].get(f"rx{receiver}")
        if not isinstance(group, h5py.Group):
            raise InputError(file, f"rxs/rx{receiver}", f"one of {', '.join(store['rxs']) or 'no receivers'}", "none")
        there = [name for name, item in group.items() if isinstance(item, h5py.Dataset)]
        name = component or ("Ez" if "Ez" in there else there[0] if len(there) == 1 else "Ez")
        if name not in there:
            raise InputError(file, f"rxs/rx{receiver}/{name}", f"one of {', '.join(there) or 'no components'}", "none")
        data = group[name]
        if data.ndim not in (1, 2) or data.dtype.kind != "f" or data.shape[0] < 2 or 0 in data.shape:
            expected = "numbers [sample] or [sample, trace]"
            raise InputError(file, data.name, expected, f"{data.dtype} of shape {data.shape}")
        with np.errstate(invalid="ignore", over="ignore"):
            values = np.asarray(data[()], dtype=np.float64)
        traces = values[None, :] if values.ndim == 1 else values.T
        if not np.all(np.isfinite(traces)):
            raise InputError(file, data.name, "finite numbers", "non-finite numbers (the simulation diverged?)")
        dt_s = _number(file, data.attrs.get("SampleInterval", store.attrs.get("dt")), "dt")
        if not dt_s > 0:
            raise InputError(file, "dt", "seconds above zero", f"{dt_s:g}")
        # Magnetic fields and currents are half a step before the electric ones.
        offset_s = data.attrs.get("TimeSampleOffset", -0.5 * dt_s if name[0] in "HI" else 0.0)
        excitation = store.get("srcs/src1/excitation")
        frequency = None if excitation is None else excitation.attrs.get("WaveformFrequency")
        return GprMaxTraces(
            np.ascontiguousarray(traces),
            dt_s,
            _number(file, offset_s, "TimeSampleOffset"),
            _midpoint_m(file, store, group) if values.ndim == 1 else None,
            None if frequency is None else _number(file, frequency, "WaveformFrequency"),
            name,
        )


@contextmanager
def _opened(file: Path) -> Iterator[h5py.File]:
    try:
        store = h5py.File(file, "r")
    except FileNotFoundError:
        raise InputError(file, "file", "a readable file", "No such file") from None
    except OSError as error:
        if file.is_dir():
            found = "a folder"
        elif not file.stat().st_size:
            found = "an empty file"
        else:
            found = f"a truncated file ({error})" if h5py.is_hdf5(file) else "another format"
        raise InputError(file, "file", "a complete gprMax file (HDF5)", found) from None
    with store:
        try:
            yield store
        except InputError:
            raise
        except DAMAGE as error:
            raise InputError(file, "file", "a complete gprMax file (HDF5)", f"a damaged file ({error})") from None


def _number(file: Path, value: Any, place: str) -> float:
    array = np.asarray(np.nan if value is None else value)
    if array.size != 1 or array.dtype.kind not in "fiu" or not np.isfinite(array).all():
        raise InputError(file, f"@{place}", "a number", "none" if value is None else repr(value))
    return float(array.reshape(()))


def _midpoint_m(file: Path, store: h5py.File, receiver: h5py.Group) -> Float[np.ndarray, " 3"]:
    """Midway between the receiver and its source: the only one, be it a dipole or a transmission line."""
    sources = [store[kind][name] for kind in ("srcs", "tls") if kind in store for name in store[kind]]
    if len(sources) != 1:
        raise InputError(file, "sources", "exactly one (the position is midway to the receiver)", str(len(sources)))
    ends = []
    for item in (sources[0], receiver):
        place = np.asarray(item.attrs.get("Position", ()), dtype=np.float64)
        if place.shape != (3,) or not np.all(np.abs(place) < _FARTHEST_M):
            raise InputError(file, f"{item.name}@Position", "three numbers, metres", str(place.tolist()))
        ends.append(place)
    middle: np.ndarray = (ends[0] + ends[1]) / 2
    return middle


# Traces at a coarser sample interval without aliasing, by a windowed sinc.

# Half the filter's length in output samples, and the Kaiser window of 80 dB. Its transition is 0.21 of the output
# rate wide: it passes up to 0.29 of the output rate unchanged and stops at the output's Nyquist frequency.
_HALF_SAMPLES = 12
_BETA = 7.857
_CUTOFF = 0.395
PASSBAND = 0.29
_BLOCK_SAMPLES = 256


def resample(
    traces: Float[np.ndarray, "trace sample"], interval: float, new_interval: float
) -> Float[np.ndarray, "trace new_sample"]:
    """Traces at ``new_interval``, which is at least ``interval``, from the same first sample on; unchanged if the
    intervals are equal.

    Frequencies up to 0.29 of the new rate keep amplitude and phase, those above its Nyquist frequency are 80 dB
    down. Before its first sample a trace is taken as zero, after its last one as the last value.

    Raises:
        ValueError: the new interval is finer than the old.
    """
    if new_interval < interval * (1 - 1e-9):
        raise ValueError("resampling to a finer interval")
    ratio = new_interval / interval
    if ratio <= 1 + 1e-9:
        return traces
    half = int(np.ceil(_HALF_SAMPLES * ratio))
    count = int(np.floor((traces.shape[1] - 1) / ratio + 1e-9)) + 1
    padded = np.concatenate([np.zeros((len(traces), half)), traces, np.repeat(traces[:, -1:], half, axis=1)], axis=1)
    blocks = []
    for start in range(0, count, _BLOCK_SAMPLES):
        at = np.arange(start, min(start + _BLOCK_SAMPLES, count)) * ratio + half
        low, high = int(np.floor(at[0])) - half, min(int(np.ceil(at[-1])) + half + 1, padded.shape[1])
        away = (np.arange(max(low, 0), high)[None, :] - at[:, None]) / ratio
        window = np.i0(_BETA * np.sqrt(np.clip(1 - (away / _HALF_SAMPLES) ** 2, 0, None))) / np.i0(_BETA)
        kernel = np.where(np.abs(away) <= _HALF_SAMPLES, np.sinc(2 * _CUTOFF * away) * window, 0.0)
        blocks.append(padded[:, max(low, 0) : high] @ (kernel / kernel.sum(axis=1, keepdims=True)).T)
    return np.concatenate(blocks, axis=1)


def share_above(traces: Float[np.ndarray, "trace sample"], interval: float, frequency: float) -> float:
    """Share of the traces' energy above a frequency (in one over the interval's unit), without their mean."""
    spectrum = np.abs(np.fft.rfft(traces - traces.mean(axis=1, keepdims=True), axis=1)) ** 2
    frequencies = np.fft.rfftfreq(traces.shape[1], interval)
    total = float(spectrum.sum())
    return float(spectrum[:, frequencies > frequency].sum()) / total if total > 0 else 0.0


# Sample intervals to choose from, ns: the coarsest that loses at most this share of the energy is used.
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

    A single trace is midway between its source and receiver; the midpoints must be on a line, and the position is the
    distance along it. A merged file lacks them: give ``start_m`` and ``step_m``. The simulation's interval, some
    picoseconds, is resampled without aliases.

    Args:
        paths: the files, in any order.
        component: field component; by default ``Ez``, or the only one.
        receiver: number of the receiver, from 1.
        sample_interval_ns: interval to resample to; by default the coarsest of 0.01 to 1 ns that keeps 99.99 % of
            the energy.
        time_zero_ns: time of the simulation that counts as zero, such as the delay of the source's pulse.
        start_m, step_m: position of the first trace and distance between traces of a merged file.

    Raises:
        InputError: a file is missing, damaged or another format, or the files are not a B-scan.
    """
    files = _in_order(paths)
    if not files:
        raise InputError("files", "gprMax files", "at least one", "none")
    _check_options(files[0], receiver, sample_interval_ns, time_zero_ns, start_m, step_m)
    read = [read_gprmax_file(file, receiver, component) for file in files]
    first = read[0]
    for file, trace in zip(files, read, strict=True):
        if len(files) > 1 and len(trace.traces) > 1:
            raise InputError(file, "traces", "one trace per file, if there are several files", str(len(trace.traces)))
        same = (trace.traces.shape[1], trace.component) == (first.traces.shape[1], first.component)
        if not same or abs(trace.dt_s / first.dt_s - 1) > 1e-9 or abs(trace.start_s - first.start_s) > 1e-15:
            raise InputError(file, "recording", f"{_size_text(first)} as in {files[0].name}", _size_text(trace))
    traces = np.concatenate([trace.traces for trace in read])
    merged = len(files) == 1 and len(traces) > 1
    if merged and step_m is None:
        raise InputError(files[0], "positions", "--step-m (a merged file lacks positions)", "none")
    if not merged and step_m is not None:
        raise InputError(files[0], "--step-m", "a merged B-scan", "files with positions")
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
    place: SurveyOrigin,
    output: str | Path,
    force: bool = False,
) -> None:
    """Write a simulated B-scan as a drive log of one channel that leaves ``place`` straight along its heading.

    The arguments are those of ``read_gprmax``. Position 0 of the model is at the origin, so that passes over one model
    are placed consistently.

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
        raise InputError(files[0], "positions", "at least 2 traces at different positions", str(len(points)))
    direction = (points[-1] - points[0]) / length_m
    along: np.ndarray = points @ direction
    off_m = np.linalg.norm(points - points[0] - np.outer(along - along[0], direction), axis=1)
    worst = int(np.argmax(off_m))
    if off_m[worst] > 1e-3 * length_m + 1e-6:
        raise InputError(files[worst], "position", "midpoints on a line", f"{off_m[worst]:g} m off it")
    back = np.flatnonzero(np.diff(along) <= 0)
    if back.size:
        found = f"{along[back[0] + 1]:g} m after {along[back[0]]:g} m"
        raise InputError(files[back[0] + 1], "position", "positions that increase with the file number", found)
    return along


def _chosen_interval_ns(traces: Float[np.ndarray, "trace sample"], dt_ns: float) -> float:
    for interval_ns in _INTERVALS_NS:
        if interval_ns >= dt_ns and share_above(traces, dt_ns, PASSBAND / interval_ns) < _LOST_ENERGY:
            return interval_ns
    return dt_ns


def _size_text(trace: GprMaxTraces) -> str:
    return f"{trace.component} of {trace.traces.shape[1]} samples of {trace.dt_s * 1e9:.6g} ns"
