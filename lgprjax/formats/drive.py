"""The drive log: its description, read at once; its radar data, read by ranges of scans; its writer."""

import json
import reprlib
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import dataclass, fields, replace
from pathlib import Path
from types import TracebackType
from typing import Any

import h5py
import numpy as np
import numpy.typing as npt
from jaxtyping import Bool, Complex, Float, Num

from lgprjax.errors import ArgumentError, InputError
from lgprjax.formats.schema import load_schema
from lgprjax.formats.store import (
    GuardedFile,
    attribute_of,
    create_array,
    create_store,
    open_store,
    reading,
    validate_store,
    write_array,
    write_attribute,
)
from lgprjax.frames import LocalFrame
from lgprjax.radar.array import ArrayGeometry, ChannelResponse

# Contents of a drive log except its radar data: where, when, with which array and recording.


@dataclass(frozen=True)
class NavigationTrack:
    """Poses of the body origin (rear axle), WGS-84. Sigmas that were not stated are ``None``, like those of a true
    track.

    Attributes:
        time_s: seconds since the drive's ``t0_utc``, strictly increasing.
        latitude_deg, longitude_deg: position.
        height_m: ellipsoidal height of the ground-contact plane at the body origin.
        heading_deg: clockwise from true north.
        roll_deg: positive right side down.
    """

    time_s: Float[np.ndarray, " navigation"]
    latitude_deg: Float[np.ndarray, " navigation"]
    longitude_deg: Float[np.ndarray, " navigation"]
    height_m: Float[np.ndarray, " navigation"]
    heading_deg: Float[np.ndarray, " navigation"]
    roll_deg: Float[np.ndarray, " navigation"]
    sigma_east_m: Float[np.ndarray, " navigation"] | None = None
    sigma_north_m: Float[np.ndarray, " navigation"] | None = None
    sigma_height_m: Float[np.ndarray, " navigation"] | None = None
    sigma_heading_deg: Float[np.ndarray, " navigation"] | None = None
    sigma_roll_deg: Float[np.ndarray, " navigation"] | None = None


@dataclass(frozen=True)
class OdometryTrack:
    """Signed cumulative travel ``distance_m`` (it falls in reverse) at ``time_s`` since the drive's ``t0_utc``."""

    time_s: Float[np.ndarray, " odometry"]
    distance_m: Float[np.ndarray, " odometry"]


@dataclass(frozen=True)
class TraceRecording:
    """Recording of traces: sample i is at travel time ``i * sample_interval_ns - time_zero_ns``.

    Attributes:
        sample_interval_ns: two-way travel time between samples.
        time_zero_ns: time zero, relative to sample 0.
        zero_level: stored value of no signal (128 for unsigned bytes).
        centre_frequency_hz: nominal centre frequency, ``None`` when unknown.
        samples: number of samples per trace.
    """

    sample_interval_ns: float
    time_zero_ns: float
    zero_level: float
    centre_frequency_hz: float | None
    samples: int


@dataclass(frozen=True)
class SweepRecording:
    """Recording of stepped-frequency sweeps, with the look-up sweeps taken in empty space.

    Attributes:
        frequencies_hz: frequencies of the steps.
        lookup_sweeps, lookup_calibration_sweep: sweeps of every channel and of the calibration channel in empty space.
        group_delay_ns: delay of the calibration channel's path, which division by it subtracts from every echo.
        channel_gain, channel_delay_ns: gain and delay of each channel relative to the array's mean; ``None`` if not
            measured, meaning gains of 1 and delays of 0.
        channel_valid: false for channels that could not be calibrated, whose data are not used; ``None``: all are
            valid. A drive log stores it with the scans.
    """

    frequencies_hz: Float[np.ndarray, " frequency"]
    lookup_sweeps: Complex[np.ndarray, "channel frequency"]
    lookup_calibration_sweep: Complex[np.ndarray, " frequency"]
    group_delay_ns: float = 0.0
    channel_gain: Float[np.ndarray, " channel"] | None = None
    channel_delay_ns: Float[np.ndarray, " channel"] | None = None
    channel_valid: Bool[np.ndarray, " channel"] | None = None

    @property
    def response(self) -> ChannelResponse:
        """Gain and delay of each channel, with defaults if they were not measured."""
        channels = len(self.lookup_sweeps)
        return ChannelResponse(
            np.ones(channels) if self.channel_gain is None else self.channel_gain,
            np.zeros(channels) if self.channel_delay_ns is None else self.channel_delay_ns,
        )


@dataclass(frozen=True)
class OnBoardSearch:
    """The search of a run on board.

    Attributes:
        frame: frame of the map.
        scans: inputs and results of each scan's search, by the names of ``/on_board``.
    """

    frame: LocalFrame
    scans: dict[str, np.ndarray]


@dataclass(frozen=True)
class DriveDescription:
    """Description of a drive without its radar data.

    Attributes:
        name: name of the drive.
        t0_utc: origin of every ``time_s``, ISO 8601.
        array: antenna positions in the body frame.
        recording: traces over travel time, or stepped-frequency sweeps.
        navigation: GNSS/INS poses, with the sigmas stated by the recording.
        odometry: signed travel.
        truth: true poses (synthetic, or RTK), without sigmas.
        vehicle: signals by name, including ``time_s``.
        provenance: steps, parameters and inputs of the log; must be JSON.
        serial_number: serial number of the vehicle, stored with its signals; ``None`` if unknown.
        plan: decisions of the autopilot, by name, including ``time_s``.
        on_board: search of the run on board.
    """

    name: str
    t0_utc: str
    array: ArrayGeometry
    recording: TraceRecording | SweepRecording
    navigation: NavigationTrack
    odometry: OdometryTrack
    truth: NavigationTrack | None
    vehicle: dict[str, np.ndarray] | None
    provenance: dict[str, object]
    serial_number: str | None = None
    plan: dict[str, np.ndarray] | None = None
    on_board: OnBoardSearch | None = None


# Write a drive log scan by scan; the file appears under its name only when it is complete and valid.

_SCHEMA = load_schema("drive")


class DriveWriter:
    """A drive log being written; a context manager.

    Leaving the block closes the file, validates it against the schema and renames it to its name. An exception leaves
    nothing behind.
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
            description: everything except the radar data.
            channels: channels a scan.
            dtype: stored type of the traces: uint8, int16, int32 or float32 (complex64 for sweeps).
            force: replace a file that exists.

        Raises:
            InputError: the output cannot be written, or the description does not match the schema.
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
        arrays = {"/radar/traces": _numbers("traces", traces)}
        self._append(scan_time_s, arrays, valid)

    def append_sweeps(
        self,
        scan_time_s: Float[np.ndarray, " scan"],
        sweeps: Complex[np.ndarray, "scan channel frequency"],
        calibration_sweeps: Complex[np.ndarray, "scan frequency"],
        valid: Bool[np.ndarray, "scan channel"] | None = None,
    ) -> None:
        """Append scans of stepped-frequency sweeps, with the calibration sweep of each; without ``valid`` all are.
        Channels that the recording's ``channel_valid`` excludes are stored as invalid.

        Raises:
            InputError: the log is one of traces, a shape or the order of the times is wrong, or the disk is full.
        """
        if not isinstance(self._recording, SweepRecording):
            raise InputError(self.path, "/radar/traces", "traces", "stepped-frequency sweeps")
        arrays = {
            "/radar/sweeps": _numbers("sweeps", sweeps),
            "/radar/calibration_sweeps": _numbers("calibration_sweeps", calibration_sweeps),
        }
        calibrated = self._recording.channel_valid
        if calibrated is not None:
            every = np.ones((len(arrays["/radar/sweeps"]), len(calibrated)), bool)
            valid = (every if valid is None else valid) & calibrated
        self._append(scan_time_s, arrays, valid)

    def _append(self, scan_time_s: np.ndarray, arrays: dict[str, np.ndarray], valid: np.ndarray | None) -> None:
        times = _numbers("scan_time_s", scan_time_s).astype(np.float64)
        if times.ndim != 1:
            raise InputError(self.path, "/radar/time_s", "one time for each scan", f"shape {times.shape}")
        every = np.ones((len(times), self._store["/radar/valid"].shape[1]), dtype=bool)
        arrays["/radar/valid"] = every if valid is None else _numbers("valid", valid)
        if not np.all(np.isfinite(times)) or not np.all(np.diff(times, prepend=self._last_time_s) > 0):
            found = f"others in the {len(times)} times after scan {self.scans}"
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


def _numbers(argument: str, given: npt.ArrayLike) -> np.ndarray:
    """A caller's argument as an array. Raises ``ArgumentError`` if it does not hold numbers."""
    try:
        made = np.asarray(given)
    except ValueError:  # rows of different lengths
        made = np.asarray(None)
    if made.dtype.kind not in "biufc":
        raise ArgumentError(argument, "an array of numbers", reprlib.repr(given))
    return made


def _write_description(
    store: h5py.File, target: Path, description: DriveDescription, channels: int, dtype: np.dtype[Any]
) -> None:
    write_attribute(store, "name", description.name)
    write_attribute(store, "t0_utc", description.t0_utc)
    write_attribute(store, "provenance", json.dumps(description.provenance))
    write_tracks(store, description.navigation, description.odometry, description.truth)
    write_signals(store, target, description.vehicle, description.serial_number)
    write_plan(store, target, description.plan)
    if description.on_board is not None:
        _write_named(store, target, "on_board", description.on_board.scans)
        for name, value in _anchor_of(description.on_board.frame).items():
            store["/on_board"].attrs[name] = value
    _write_recording(store, description.recording, channels, dtype)
    array = description.array
    for name in ("x_m", "y_m", "time_offset_s"):
        write_array(store, _SCHEMA, f"/array/{name}", getattr(array, name))
    store["/array"].attrs["height_m"] = array.height_m
    if array.zero_slip_m:
        write_attribute(store["/array"], "zero_slip_m", array.zero_slip_m)


def write_tracks(
    store: h5py.File, navigation: NavigationTrack, odometry: OdometryTrack, truth: NavigationTrack | None
) -> None:
    """Write navigation, odometry and, if known, truth of a drive."""
    _write_track(store, "/gnss_ins", navigation)
    write_array(store, _SCHEMA, "/odometry/time_s", odometry.time_s)
    write_array(store, _SCHEMA, "/odometry/distance_m", odometry.distance_m)
    if truth is not None:
        _write_track(store, "/truth", truth)


def write_signals(
    store: h5py.File, target: Path, signals: dict[str, np.ndarray] | None, serial_number: str | None
) -> None:
    """Write the signals of the vehicle by name, and its serial number.

    Raises:
        InputError: the format has no such signal.
    """
    _write_named(store, target, "vehicle", signals)
    if signals and serial_number is not None:
        write_attribute(store["/vehicle"], "serial_number", serial_number)


def write_plan(store: h5py.File, target: Path, plan: dict[str, np.ndarray] | None) -> None:
    """Write the decisions of the autopilot, by name.

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
        # A true track has no sigmas: its group has no datasets for them.
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


__all__ = [
    "DriveDescription",
    "DriveLog",
    "DriveWriter",
    "NavigationTrack",
    "OdometryTrack",
    "SweepRecording",
    "TraceRecording",
]


# Sigmas that these importers wrote for every survey up to format 1.4, and for recordings with headings from the path.
_INVENTORS = tuple(f"lgprjax import {name}" for name in ("cmu", "gprmax", "grounded", "iprb", "lines", "segy"))
_INVENTED = {
    **dict.fromkeys(("sigma_east_m", "sigma_north_m", "sigma_height_m"), 0.05),
    **dict.fromkeys(("sigma_heading_deg", "sigma_roll_deg"), 0.5),
}
_HEADING_OF_PATH = "heading from the path, roll taken as 0: no topic tells them"


class DriveLog:
    """A drive log open for reading; a context manager.

    Attributes:
        path: the file.
        description: everything except the radar data.
        scan_time_s: float64 [scan], seconds since ``description.t0_utc``, strictly increasing.
        scans, channels: sizes of the recording.
        samples: number of samples per trace, or of frequencies per sweep.
    """

    def __init__(self, path: Path, store: h5py.File) -> None:
        self.path = path
        self._store = store
        with reading(path, "description"):
            self.description = _read_description(store)
            self.scan_time_s: Float[np.ndarray, " scan"] = store["/radar/time_s"][:]
        recording = self.description.recording
        self.scans = len(self.scan_time_s)
        self.channels = len(self.description.array.y_m)
        self.samples = recording.samples if isinstance(recording, TraceRecording) else len(recording.frequencies_hz)
        self._non_finite = np.zeros(self.scans, dtype=bool)

    @classmethod
    def open(cls, path: str | Path) -> "DriveLog":
        """Open a drive log and check everything except the radar data themselves.

        Raises:
            InputError: the file is missing, damaged, of another format or of a newer major version, or a dataset,
                attribute, unit, shape or small value does not match ``data_schema/drive.toml``, or it has no radar
                recording (``VehicleLog`` reads such a file).
        """
        store = open_store(path)
        try:
            for finding in validate_store(store, path, load_schema("drive")):
                if finding.severity == "error":
                    raise finding.error()
            if "/radar" not in store:
                raise InputError(path, "/radar", "a radar recording", "a drive without radar (only for tune and check)")
            return cls(Path(path), store)
        except BaseException:
            store.close()
            raise

    def __enter__(self) -> "DriveLog":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Close the file; data already read stay valid."""
        self._store.close()

    @property
    def non_finite_scans(self) -> int:
        """Scans with NaN or infinite samples among those read so far."""
        return int(np.count_nonzero(self._non_finite))

    def read_traces(
        self, start: int, stop: int
    ) -> tuple[Float[np.ndarray, "scan channel sample"], Bool[np.ndarray, "scan channel"]]:
        """Traces of the scans from ``start`` to before ``stop``, zero level removed, and which of them are valid.

        A trace that is not finite is marked invalid and reads as zeros: a bad scan never stops a drive.

        Raises:
            InputError: the log holds sweeps, the range is outside the drive, or the data are damaged.
        """
        recording = self.description.recording
        if not isinstance(recording, TraceRecording):
            raise InputError(self.path, "/radar/traces", "traces", "stepped-frequency sweeps")
        self._check_range(start, stop)
        with reading(self.path, f"/radar/traces, scans {start} to {stop}"):
            traces = self._store["/radar/traces"][start:stop].astype(np.float32)
            valid = self._read_valid(start, stop)
        finite = np.isfinite(traces).all(axis=2)
        traces[~finite] = recording.zero_level
        valid &= finite
        self._non_finite[start:stop] |= ~finite.all(axis=1)
        traces -= np.float32(recording.zero_level)
        return traces, valid

    def read_sweeps(
        self, start: int, stop: int
    ) -> tuple[
        Complex[np.ndarray, "scan channel frequency"],
        Complex[np.ndarray, "scan frequency"],
        Bool[np.ndarray, "scan channel"],
    ]:
        """Sweeps of the scans from ``start`` to before ``stop``, the calibration sweep of each, and which are valid.

        As recorded, except for non-finite data: a sweep is marked invalid and reads as zeros; a calibration sweep reads
        as zeros and makes its whole scan invalid.

        Raises:
            InputError: the log holds traces, the range is outside the drive, or the data are damaged.
        """
        if not isinstance(self.description.recording, SweepRecording):
            raise InputError(self.path, "/radar/sweeps", "stepped-frequency sweeps", "traces")
        self._check_range(start, stop)
        with reading(self.path, f"/radar/sweeps, scans {start} to {stop}"):
            sweeps = self._store["/radar/sweeps"][start:stop]
            calibration = self._store["/radar/calibration_sweeps"][start:stop]
            valid = self._read_valid(start, stop)
        finite = np.isfinite(sweeps).all(axis=2)
        known = np.isfinite(calibration).all(axis=1)
        sweeps[~finite] = 0.0
        calibration[~known] = 0.0
        self._non_finite[start:stop] |= ~(finite.all(axis=1) & known)
        return sweeps, calibration, valid & finite & known[:, None]

    def read_stored(
        self, start: int, stop: int
    ) -> tuple[
        Num[np.ndarray, "scan channel sample"],
        Bool[np.ndarray, "scan channel"],
        Complex[np.ndarray, "scan sample"] | None,
    ]:
        """Traces or sweeps of the scans from ``start`` to before ``stop`` as stored, and which of them are valid.

        Type and zero level are those of the file, non-finite values stay. For sweeps, the third result is those of the
        calibration channel.

        Raises:
            InputError: the range is outside the drive, or the data are damaged.
        """
        self._check_range(start, stop)
        name = "/radar/traces" if isinstance(self.description.recording, TraceRecording) else "/radar/sweeps"
        with reading(self.path, f"{name}, scans {start} to {stop}"):
            stored = self._store[name][start:stop]
            calibration = None if name == "/radar/traces" else self._store["/radar/calibration_sweeps"][start:stop]
            return stored, self._read_valid(start, stop), calibration

    def chunks(
        self, scans_per_chunk: int
    ) -> Iterator[tuple[int, Float[np.ndarray, "scan channel sample"], Bool[np.ndarray, "scan channel"]]]:
        """The whole drive in order, as (first scan, traces, valid); the last chunk may be shorter."""
        for start in range(0, self.scans, scans_per_chunk):
            traces, valid = self.read_traces(start, min(start + scans_per_chunk, self.scans))
            yield start, traces, valid

    def _read_valid(self, start: int, stop: int) -> Bool[np.ndarray, "scan channel"]:
        if "/radar/valid" not in self._store:
            return np.ones((stop - start, self.channels), dtype=bool)
        return np.asarray(self._store["/radar/valid"][start:stop].astype(bool))

    def _check_range(self, start: int, stop: int) -> None:
        if not 0 <= start < stop <= self.scans:
            raise InputError(self.path, "scans", f"a range within 0 to {self.scans}", f"{start} to {stop}")


def _read_description(store: h5py.File) -> DriveDescription:
    array = store["/array"]
    truth = store.get("/truth")
    vehicle = store.get("/vehicle")
    return DriveDescription(
        name=str(attribute_of(store, "name")),
        t0_utc=str(attribute_of(store, "t0_utc")),
        array=ArrayGeometry(
            x_m=array["x_m"][:],
            y_m=array["y_m"][:],
            time_offset_s=array["time_offset_s"][:],
            height_m=_number(array, "height_m"),
            zero_slip_m=_number(array, "zero_slip_m", 0.0),
        ),
        recording=_read_recording(store["/radar"]),
        navigation=without_invented(read_track(store["/gnss_ins"]), provenance_of(store)),
        odometry=OdometryTrack(store["/odometry/time_s"][:], store["/odometry/distance_m"][:]),
        truth=None if truth is None else read_track(truth),
        vehicle=read_arrays(vehicle),
        provenance=provenance_of(store),
        serial_number=serial_number_of(vehicle),
        plan=read_arrays(store.get("/plan")),
        on_board=_read_on_board(store.get("/on_board")),
    )


def _anchor_of(frame: LocalFrame) -> dict[str, float]:
    """The origin of a frame as attributes."""
    return {
        "anchor_latitude_deg": frame.latitude_deg,
        "anchor_longitude_deg": frame.longitude_deg,
        "anchor_height_m": frame.height_m,
    }


def _read_on_board(group: Any) -> OnBoardSearch | None:
    scans = read_arrays(group)
    if scans is None:
        return None
    parts = ("anchor_latitude_deg", "anchor_longitude_deg", "anchor_height_m")
    return OnBoardSearch(LocalFrame(*(_number(group, name) for name in parts)), scans)


def read_arrays(group: Any) -> dict[str, np.ndarray] | None:
    """Arrays of a group by name; ``None`` where there is no group."""
    return None if group is None else {name: group[name][:] for name in group}


def serial_number_of(vehicle: Any) -> str | None:
    """Serial number in the group of a vehicle's signals; ``None`` without the group or a number."""
    number = None if vehicle is None else attribute_of(vehicle, "serial_number")
    return None if number is None else str(number)


def read_track(group: Any) -> NavigationTrack:
    """A track from its group."""
    names = NavigationTrack.__dataclass_fields__
    return NavigationTrack(**{name: group[name][:] for name in names if name in group})


def provenance_of(store: h5py.File) -> dict[str, object]:
    """Steps, parameters and inputs of the file."""
    held: dict[str, object] = json.loads(str(attribute_of(store, "provenance")))
    return held


def without_invented(track: NavigationTrack, provenance: dict[str, object]) -> NavigationTrack:
    """The track without the sigmas that importers invented up to format 1.4."""
    maker, notes = provenance.get("made_by"), provenance.get("notes")
    if maker in _INVENTORS:
        suspect = _INVENTED
    elif maker == "lgprjax import mcap" and isinstance(notes, list) and _HEADING_OF_PATH in notes:
        suspect = {name: value for name, value in _INVENTED.items() if name.endswith("_deg")}
    else:
        return track
    held = {name: getattr(track, name) for name in suspect}
    invented = [name for name, each in held.items() if each is not None and np.allclose(each, suspect[name], 1e-9, 0.0)]
    unstated: dict[str, Any] = dict.fromkeys(invented)
    return replace(track, **unstated)


def _read_recording(radar: Any) -> TraceRecording | SweepRecording:
    if "sweeps" in radar:
        return SweepRecording(
            frequencies_hz=radar["frequencies_hz"][:],
            lookup_sweeps=radar["lookup_sweeps"][:],
            lookup_calibration_sweep=radar["lookup_calibration_sweep"][:],
            group_delay_ns=_number(radar["sweeps"], "group_delay_ns", 0.0),
            channel_gain=radar["channel_gain"][:] if "channel_gain" in radar else None,
            channel_delay_ns=radar["channel_delay_ns"][:] if "channel_delay_ns" in radar else None,
        )
    traces = radar["traces"]
    known = attribute_of(traces, "centre_frequency_hz") is not None
    return TraceRecording(
        sample_interval_ns=_number(traces, "sample_interval_ns"),
        time_zero_ns=_number(traces, "time_zero_ns"),
        zero_level=_number(traces, "zero_level"),
        centre_frequency_hz=_number(traces, "centre_frequency_hz") if known else None,
        samples=int(traces.shape[2]),
    )


def _number(holder: Any, name: str, absent: float = float("nan")) -> float:
    value = attribute_of(holder, name)
    return absent if value is None else float(np.float64(value))  # type: ignore[arg-type]  # held against the schema
