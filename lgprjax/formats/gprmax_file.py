"""One file of gprMax: the traces of a receiver, their interval, and where source and receiver stood."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import h5py
import numpy as np
from jaxtyping import Float

from lgprjax.errors import InputError
from lgprjax.formats.store import DAMAGE

# Models are metres in size: positions beyond this are damage.
_FARTHEST_M = 1e6


class GprMaxTraces(NamedTuple):
    """What one file holds.

    Attributes:
        traces: one trace, or those of a merged B-scan.
        dt_s: simulated interval between samples.
        start_s: time of the first sample.
        midpoint_m: midway between source and receiver; ``None`` in a merged file, which has lost it.
        centre_frequency_hz: of the source's pulse, where the file says (version 4).
        component: the field component.
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
            raise InputError(file, data.name, "finite numbers", "others (the simulation diverged?)")
        dt_s = _number(file, data.attrs.get("SampleInterval", store.attrs.get("dt")), "dt")
        if not dt_s > 0:
            raise InputError(file, "dt", "seconds above zero", f"{dt_s:g}")
        # Magnetic fields and currents live half a step before the electric ones.
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
        found = "a folder" if file.is_dir() else f"one that is cut short or another format ({error})"
        raise InputError(file, "file", "a whole gprMax file (HDF5)", found) from None
    with store:
        try:
            yield store
        except InputError:
            raise
        except DAMAGE as error:
            raise InputError(file, "file", "a whole gprMax file (HDF5)", f"a damaged one ({error})") from None


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
