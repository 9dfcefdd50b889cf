"""Read a drive log: its description at once, its radar data by ranges of scans."""

import json
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from types import TracebackType
from typing import Any

import h5py
import numpy as np
from jaxtyping import Bool, Complex, Float, Num

from lgprjax.errors import InputError
from lgprjax.formats.drive_description import (
    DriveDescription,
    NavigationTrack,
    OdometryTrack,
    SweepRecording,
    TraceRecording,
)
from lgprjax.formats.drive_writer import DriveWriter
from lgprjax.formats.schema import load_schema
from lgprjax.formats.store import attribute_of, open_store, reading, validate_store
from lgprjax.radar.array import ArrayGeometry

__all__ = [
    "DriveDescription",
    "DriveLog",
    "DriveWriter",
    "NavigationTrack",
    "OdometryTrack",
    "SweepRecording",
    "TraceRecording",
]


# What these importers wrote for every survey up to format 1.4; that of recordings, for headings that follow the path.
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
        description: everything but the radar data.
        scan_time_s: float64 [scan], seconds since ``description.t0_utc``, strictly increasing.
        scans, channels: sizes of the recording.
        samples: samples a trace, or frequencies a sweep.
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
        """Open a drive log and check everything but the radar data themselves.

        Raises:
            InputError: the file is missing, damaged, of another format or of a newer major version, or a dataset,
                attribute, unit, shape or small value is not as ``data_schema/drive.toml`` says, or it holds no radar
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
        """Close the file; what has been read stays."""
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
            InputError: the log holds sweeps, the range lies outside the drive, or the data are damaged.
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

        As recorded, but what is not finite: a sweep is marked invalid and reads as zeros, a calibration sweep
        reads as zeros and makes its whole scan invalid.

        Raises:
            InputError: the log holds traces, the range lies outside the drive, or the data are damaged.
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

        Type and zero level are those of the file, what is not finite stays. Of sweeps, those of the calibration
        channel come third.

        Raises:
            InputError: the range lies outside the drive, or the data are damaged.
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
        ),
        recording=_read_recording(store["/radar"]),
        navigation=without_invented(read_track(store["/gnss_ins"]), provenance_of(store)),
        odometry=OdometryTrack(store["/odometry/time_s"][:], store["/odometry/distance_m"][:]),
        truth=None if truth is None else read_track(truth),
        vehicle=read_arrays(vehicle),
        provenance=provenance_of(store),
        serial_number=serial_number_of(vehicle),
        plan=read_arrays(store.get("/plan")),
    )


def read_arrays(group: Any) -> dict[str, np.ndarray] | None:
    """Arrays of a group by name; ``None`` where there is no group."""
    return None if group is None else {name: group[name][:] for name in group}


def serial_number_of(vehicle: Any) -> str | None:
    """Serial number that the group of a vehicle's signals names, ``None`` where there is no group or no number."""
    number = None if vehicle is None else attribute_of(vehicle, "serial_number")
    return None if number is None else str(number)


def read_track(group: Any) -> NavigationTrack:
    """A track from its group."""
    names = NavigationTrack.__dataclass_fields__
    return NavigationTrack(**{name: group[name][:] for name in names if name in group})


def provenance_of(store: h5py.File) -> dict[str, object]:
    """Which steps, parameters and inputs made the file."""
    held: dict[str, object] = json.loads(str(attribute_of(store, "provenance")))
    return held


def without_invented(track: NavigationTrack, provenance: dict[str, object]) -> NavigationTrack:
    """The track without the sigmas that importers wrote up to format 1.4 although no survey stated them."""
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
