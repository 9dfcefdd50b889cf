"""Write a drive log scan by scan; the file appears under its name only when it is whole and valid."""

import json
from contextlib import ExitStack
from dataclasses import fields
from pathlib import Path
from types import TracebackType
from typing import Any

import h5py
import numpy as np
import numpy.typing as npt
from jaxtyping import Bool, Complex, Float, Num

from lgprjax.errors import InputError
from lgprjax.formats.drive_description import (
    DriveDescription,
    NavigationTrack,
    OdometryTrack,
    SweepRecording,
    TraceRecording,
)
from lgprjax.formats.hdf5_output import GuardedFile, create_store
from lgprjax.formats.schema import load_schema
from lgprjax.formats.store import create_array, validate_store, write_array, write_attribute

_SCHEMA = load_schema("drive")


class DriveWriter:
    """A drive log being written; a context manager.

    Leaving the block closes the file, holds it against the schema and renames it onto its name. An exception
    leaves nothing behind.
    """

    def __init__(
        self, path: Path, store: h5py.File, output: GuardedFile, cleanup: ExitStack, description: DriveDescription
    ) -> None:
        self.path = path
        self.scans = 0
        self._store = store
        self._output = output
        self._cleanup = cleanup
        self._recording = description.recording
        self._last_time_s = -np.inf

    @classmethod
    def create(
        cls,
        path: str | Path,
        description: DriveDescription,
        *,
        channels: int,
        dtype: npt.DTypeLike,
        force: bool = False,
    ) -> "DriveWriter":
        """Begin a drive log.

        Args:
            path: the file; it must not exist unless ``force``.
            description: everything but the radar data.
            channels: channels a scan.
            dtype: stored type of the traces: uint8, int16, int32 or float32 (complex64 for sweeps).
            force: replace a file that exists.

        Raises:
            InputError: the output cannot be written, or the description is not as the schema says.
        """
        target = Path(path)
        with ExitStack() as cleanup:
            store, output = cleanup.enter_context(create_store(target, _SCHEMA, force))
            _write_description(store, target, description, channels, np.dtype(dtype))
            for finding in validate_store(store, target, _SCHEMA, complete=False):
                if finding.severity == "error":
                    raise finding.error()
            return cls(target, store, output, cleanup.pop_all(), description)
        raise AssertionError("unreachable: the stack passes exceptions on")

    def __enter__(self) -> "DriveWriter":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if error is not None:
            self._cleanup.__exit__(kind, error, trace)
            return
        with self._cleanup:
            for finding in validate_store(self._store, self.path, _SCHEMA):
                if finding.severity == "error":
                    raise finding.error()

    def append(
        self,
        scan_time_s: Float[np.ndarray, " scan"],
        traces: Num[np.ndarray, "scan channel sample"],
        valid: Bool[np.ndarray, "scan channel"] | None = None,
    ) -> None:
        """Append scans in the stored type and with the stored zero level; without ``valid`` all channels are.

        Raises:
            InputError: the log is one of sweeps, a shape or the order of the times is wrong, or the disk is full.
        """
        if not isinstance(self._recording, TraceRecording):
            raise InputError(self.path, "/radar/sweeps", "stepped-frequency sweeps", "traces")
        if valid is None:
            valid = np.ones(traces.shape[:2], dtype=bool)
        self._append(scan_time_s, {"/radar/traces": traces, "/radar/valid": valid})

    def append_sweeps(
        self,
        scan_time_s: Float[np.ndarray, " scan"],
        sweeps: Complex[np.ndarray, "scan channel frequency"],
        calibration_sweeps: Complex[np.ndarray, "scan frequency"],
        valid: Bool[np.ndarray, "scan channel"] | None = None,
    ) -> None:
        """Append scans of stepped-frequency sweeps, with the calibration sweep of each; without ``valid`` all are.

        Raises:
            InputError: the log is one of traces, a shape or the order of the times is wrong, or the disk is full.
        """
        if not isinstance(self._recording, SweepRecording):
            raise InputError(self.path, "/radar/traces", "traces", "stepped-frequency sweeps")
        if valid is None:
            valid = np.ones(sweeps.shape[:2], dtype=bool)
        arrays = {"/radar/sweeps": sweeps, "/radar/calibration_sweeps": calibration_sweeps, "/radar/valid": valid}
        self._append(scan_time_s, arrays)

    def _append(self, scan_time_s: np.ndarray, arrays: dict[str, np.ndarray]) -> None:
        times = np.asarray(scan_time_s, dtype=np.float64)
        steps = np.diff(times, prepend=self._last_time_s)
        if times.ndim != 1 or not np.all(np.isfinite(times)) or not np.all(steps > 0):
            found = f"others among the {len(times)} after scan {self.scans}"
            raise InputError(self.path, "/radar/time_s", "finite, strictly increasing times", found)
        for name, values in arrays.items():
            due = (len(times), *self._store[name].shape[1:])
            if values.shape != due:
                raise InputError(self.path, name, f"shape {due}", f"shape {values.shape}")
            if not np.can_cast(values.dtype, self._store[name].dtype, "same_kind"):
                raise InputError(self.path, name, f"type {self._store[name].dtype}", f"type {values.dtype}")
        if not len(times):
            return
        stop = self.scans + len(times)
        for name, values in {"/radar/time_s": times, **arrays}.items():
            dataset = self._store[name]
            dataset.resize(stop, axis=0)
            dataset[self.scans : stop] = values
        self._output.check()
        self.scans = stop
        self._last_time_s = times[-1]


def _write_description(
    store: h5py.File, target: Path, description: DriveDescription, channels: int, dtype: np.dtype[Any]
) -> None:
    write_attribute(store, "name", description.name)
    write_attribute(store, "t0_utc", description.t0_utc)
    write_attribute(store, "provenance", json.dumps(description.provenance))
    write_tracks(store, description.navigation, description.odometry, description.truth)
    write_signals(store, target, description.vehicle, description.serial_number)
    write_plan(store, target, description.plan)
    _write_recording(store, description.recording, channels, dtype)
    array = description.array
    for name in ("x_m", "y_m", "time_offset_s"):
        write_array(store, _SCHEMA, f"/array/{name}", getattr(array, name))
    store["/array"].attrs["height_m"] = array.height_m


def write_tracks(
    store: h5py.File, navigation: NavigationTrack, odometry: OdometryTrack, truth: NavigationTrack | None
) -> None:
    """Write where a drive went, as navigation, odometry and, where it is known, truth say."""
    _write_track(store, "/gnss_ins", navigation)
    write_array(store, _SCHEMA, "/odometry/time_s", odometry.time_s)
    write_array(store, _SCHEMA, "/odometry/distance_m", odometry.distance_m)
    if truth is not None:
        _write_track(store, "/truth", truth)


def write_signals(
    store: h5py.File, target: Path, signals: dict[str, np.ndarray] | None, serial_number: str | None
) -> None:
    """Write the signals of the vehicle by name, and whose they are.

    Raises:
        InputError: the format has no such signal.
    """
    _write_named(store, target, "vehicle", signals)
    if signals and serial_number is not None:
        write_attribute(store["/vehicle"], "serial_number", serial_number)


def write_plan(store: h5py.File, target: Path, plan: dict[str, np.ndarray] | None) -> None:
    """Write what the autopilot decided, by name.

    Raises:
        InputError: the format has no such array.
    """
    _write_named(store, target, "plan", plan)


def _write_named(store: h5py.File, target: Path, group: str, arrays: dict[str, np.ndarray] | None) -> None:
    for name, values in (arrays or {}).items():
        try:
            write_array(store, _SCHEMA, f"/{group}/{name}", values)
        except KeyError:
            within = f"/{group}/"
            known = ", ".join(e.path[len(within) :] for e in _SCHEMA.datasets if e.path.startswith(within))
            raise InputError(target, group, f"signals among {known}", name) from None


def _write_track(store: h5py.File, group: str, track: NavigationTrack) -> None:
    known = {entry.path for entry in _SCHEMA.datasets}
    for field in fields(track):
        values = getattr(track, field.name)
        # A true track has no sigmas: its group has no place for them.
        if values is not None and f"{group}/{field.name}" in known:
            write_array(store, _SCHEMA, f"{group}/{field.name}", values)


def _write_recording(
    store: h5py.File, recording: TraceRecording | SweepRecording, channels: int, dtype: np.dtype[Any]
) -> None:
    create_array(store, _SCHEMA, "/radar/time_s", ())
    create_array(store, _SCHEMA, "/radar/valid", (channels,))
    if isinstance(recording, SweepRecording):
        frequencies = len(recording.frequencies_hz)
        sweeps = create_array(store, _SCHEMA, "/radar/sweeps", (channels, frequencies), dtype)
        write_attribute(sweeps, "group_delay_ns", float(recording.group_delay_ns))
        create_array(store, _SCHEMA, "/radar/calibration_sweeps", (frequencies,))
        write_array(store, _SCHEMA, "/radar/lookup_sweeps", recording.lookup_sweeps)
        write_array(store, _SCHEMA, "/radar/lookup_calibration_sweep", recording.lookup_calibration_sweep)
        write_array(store, _SCHEMA, "/radar/frequencies_hz", recording.frequencies_hz)
        for name in ("channel_gain", "channel_delay_ns"):
            if getattr(recording, name) is not None:
                write_array(store, _SCHEMA, f"/radar/{name}", getattr(recording, name))
        return
    traces = create_array(store, _SCHEMA, "/radar/traces", (channels, recording.samples), dtype)
    for name in ("sample_interval_ns", "time_zero_ns", "zero_level", "centre_frequency_hz"):
        value = getattr(recording, name)
        if value is not None:
            traces.attrs[name] = float(value)
