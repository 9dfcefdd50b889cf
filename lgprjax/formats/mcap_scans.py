"""Scans of a radar array, and the array itself, as messages of a recording."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Complex, Float, Num

from lgprjax.errors import InputError
from lgprjax.formats.drive_description import SweepRecording, TraceRecording
from lgprjax.formats.ros_messages import RADAR_ARRAY
from lgprjax.radar.array import ArrayGeometry, uniform_array

SWEEPS = "complex64"
ENCODINGS = ("uint8", "int16", "int32", "float32", SWEEPS)


class ScanForm(NamedTuple):
    """What all scans of a recording have in common; see ``RadarScan`` in docs/transfer.md."""

    channels: int
    samples: int
    encoding: str
    sample_interval_ns: float
    time_zero_ns: float
    zero_level: float


class UniformArray(NamedTuple):
    """An array that a recording does not describe: evenly spaced channels centred on the vehicle's axis.

    Attributes:
        pitch_m: distance between neighbouring channels; ``None`` where there is but one.
        x_m: forward of the rear axle.
        height_m: above the ground.
    """

    pitch_m: float | None = None
    x_m: float = 0.0
    height_m: float = 0.0


class Scan(NamedTuple):
    """One scan: its signal, which channels were heard, and of sweeps that of the calibration channel."""

    form: ScanForm
    signal: Num[np.ndarray, "channel sample"]
    valid: Bool[np.ndarray, " channel"]
    calibration: Complex[np.ndarray, " sample"] | None


def scan_values(
    form: ScanForm,
    signal: Num[np.ndarray, "channel sample"],
    valid: Bool[np.ndarray, " channel"],
    calibration: Complex[np.ndarray, " sample"] | None,
) -> dict[str, Any]:
    """Members of a ``RadarScan`` but its header."""
    return {
        **form._asdict(),
        "valid": valid.astype(np.uint8),
        "data": _bytes_of(signal, form.encoding),
        "calibration": np.zeros(0, np.uint8) if calibration is None else _bytes_of(calibration, form.encoding),
    }


def read_scan(values: Mapping[str, Any]) -> Scan | None:
    """The scan of a ``RadarScan``; ``None`` where sizes do not agree or the encoding is not known."""
    try:
        return _scan_of(values)
    except (KeyError, ValueError, TypeError, AttributeError):
        return None


def array_values(array: ArrayGeometry, recording: TraceRecording | SweepRecording) -> dict[str, Any]:
    """Members of a ``RadarArray`` but its header."""
    values: dict[str, Any] = {
        "x_m": array.x_m,
        "y_m": array.y_m,
        "time_offset_s": array.time_offset_s,
        "height_m": array.height_m,
    }
    if isinstance(recording, TraceRecording):
        return values | {"centre_frequency_hz": recording.centre_frequency_hz or 0.0}
    return values | {
        "frequencies_hz": recording.frequencies_hz,
        "group_delay_ns": recording.group_delay_ns,
        "lookup_sweeps": recording.lookup_sweeps.astype("<c8").view("<f4"),
        "lookup_calibration_sweep": recording.lookup_calibration_sweep.astype("<c8").view("<f4"),
        "channel_gain": np.zeros(0) if recording.channel_gain is None else recording.channel_gain,
        "channel_delay_ns": np.zeros(0) if recording.channel_delay_ns is None else recording.channel_delay_ns,
    }


def geometry_of(
    path: Path, form: ScanForm, values: Mapping[str, Any] | None, told: UniformArray | None
) -> ArrayGeometry:
    """Geometry of the array as it is told, or else from a ``RadarArray``; a single channel is on the axis.

    Raises:
        InputError: neither tells that of so many channels.
    """
    if told is not None or values is None:
        told = told or UniformArray()
        if told.pitch_m is None and form.channels > 1:
            expected = f"a message of type {RADAR_ARRAY}, or --channel-pitch-m"
            raise InputError(path, "array", expected, f"neither for {form.channels} channels")
        return uniform_array(form.channels, told.pitch_m or 0.0, x_m=told.x_m, height_m=told.height_m)
    lists = {name: _numbers(path, values, name) for name in ("x_m", "y_m", "time_offset_s")}
    for name, numbers in lists.items():
        if len(numbers) != form.channels:
            expected = f"{form.channels} channels as the scans have"
            raise InputError(path, f"RadarArray, {name}", expected, str(len(numbers)))
    return ArrayGeometry(**lists, height_m=float(values.get("height_m", np.nan)))


def recording_of_form(path: Path, form: ScanForm, values: Mapping[str, Any] | None) -> TraceRecording | SweepRecording:
    """How scans were recorded, from what they have in common and the ``RadarArray`` where there is one.

    Raises:
        InputError: an interval makes no sense; or scans are sweeps and the array does not say what reading them needs.
    """
    if form.encoding != SWEEPS:
        if not (np.isfinite(form.sample_interval_ns) and form.sample_interval_ns > 0):
            found = f"{form.sample_interval_ns:g}"
            raise InputError(path, "RadarScan, sample_interval_ns", "a number above zero", found)
        frequency_hz = float((values or {}).get("centre_frequency_hz", 0.0))
        return TraceRecording(
            form.sample_interval_ns, form.time_zero_ns, form.zero_level, frequency_hz or None, form.samples
        )
    if values is None:
        raise InputError(path, "topics", "a RadarArray beside sweeps: frequencies and look-up", "none")
    frequencies_hz = _numbers(path, values, "frequencies_hz")
    lookup, calibration = (_numbers(path, values, n) for n in ("lookup_sweeps", "lookup_calibration_sweep"))
    due = {
        "frequencies_hz": (frequencies_hz, form.samples),
        "lookup_calibration_sweep": (calibration, 2 * form.samples),
        "lookup_sweeps": (lookup, 2 * form.samples * form.channels),
    }
    for name, (numbers, size) in due.items():
        if len(numbers) != size:
            raise InputError(path, f"RadarArray, {name}", f"{size} numbers, as the scans have it", str(len(numbers)))
    gain, delay_ns = (_numbers(path, values, name) for name in ("channel_gain", "channel_delay_ns"))
    return SweepRecording(
        frequencies_hz,
        lookup.astype(np.float32).view(np.complex64).reshape(form.channels, form.samples),
        calibration.astype(np.float32).view(np.complex64),
        float(values.get("group_delay_ns", 0.0)),
        gain if len(gain) else None,
        delay_ns if len(delay_ns) else None,
    )


def _numbers(path: Path, values: Mapping[str, Any], name: str) -> Float[np.ndarray, " number"]:
    numbers = values.get(name)
    if not isinstance(numbers, np.ndarray):
        raise InputError(path, f"RadarArray, {name}", "an array of numbers", "none")
    return numbers.astype(np.float64)


def _bytes_of(signal: np.ndarray, encoding: str) -> np.ndarray:
    little = np.dtype(encoding).newbyteorder("<")
    return np.ascontiguousarray(signal, dtype=little).reshape(-1).view(np.uint8)


def _scan_of(values: Mapping[str, Any]) -> Scan:
    form = ScanForm(**{name: values[name] for name in ScanForm._fields})
    if form.encoding not in ENCODINGS or form.channels < 1 or form.samples < 2:
        raise ValueError("no scan")
    dtype = np.dtype(form.encoding).newbyteorder("<")
    signal = values["data"].view(np.uint8).view(dtype).reshape(form.channels, form.samples)
    heard = values["valid"]
    valid = np.ones(form.channels, dtype=bool) if not len(heard) else heard.astype(bool).reshape(form.channels)
    calibration = None
    if form.encoding == SWEEPS:
        calibration = values["calibration"].view(np.uint8).view(dtype).reshape(form.samples)
    return Scan(form, signal, valid, calibration)
