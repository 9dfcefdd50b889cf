"""A recorded run as a drive log, for mapping and registration like any other."""

from collections.abc import Callable, Iterator
from datetime import UTC, datetime
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from lgprjax import __version__
from lgprjax.errors import InputError
from lgprjax.formats import (
    ArrayTable,
    DriveDescription,
    DriveWriter,
    MapFile,
    NavigationTrack,
    OdometryTrack,
    OnBoardSearch,
    SweepLayout,
    SweepRecording,
    TraceRecording,
    VehicleFile,
    VehicleLog,
    complex_rows,
    read_radar_calibration,
    write_vehicle_log,
)
from lgprjax.formats.run_log import (
    RunReading,
    frame_data,
    frame_type,
    read_run,
)
from lgprjax.frames import LocalFrame
from lgprjax.radar import ArrayGeometry, uniform_array
from lgprjax.recordings.run_signals import RunSignals, scan_frames, signals_of_run
from lgprjax.recordings.vehicles import array_of_vehicle
from lgprjax.subsurface import SpatialIndex
from lgprjax.wire import decode

# Track and vehicle signals, in the form of a drive log.

# Not part of a run's poses: the height is taken from the map, and nothing measures the error of roll.
_SIGMA_HEIGHT_M, _SIGMA_ROLL_DEG = 0.1, 0.2
_CELL_M, _NEAR_M = 1.0, 16.0
_PLANNED = ("sigma_cross_m", "speed_mps", "wanted_mps", "cross_track_m", "to_go_m", "code", "reaction")


_HOLE_S = 1.0
"""Scans between poses farther apart have no place, in a run that only records."""


class RecordedTracks(NamedTuple):
    """Substitute for the map in a run without one: tracks from the receiver's messages, in seconds of the run's clock,
    and facts of the array that its radar does not state.

    Attributes:
        navigation: poses of the vehicle.
        odometry: travel along them, for runs without an odometer.
        origin: description of the source of headings.
        channel_pitch_m: spacing of the channels, if the vehicle file does not state their positions.
        centre_frequency_hz: centre frequency of the antennas.
        frame: frame of the autopilot's decisions; ``None`` without any.
    """

    navigation: NavigationTrack
    odometry: OdometryTrack
    origin: str
    channel_pitch_m: float | None = None
    centre_frequency_hz: float | None = None
    frame: LocalFrame | None = None


class RunTracks:
    """Tracks of a drive log, in seconds since a reference time.

    Args:
        signals: signals of the run.
        mono_ns: reference time on the computer's monotonic clock, ns.
        source: map of the run, or the tracks of a run that only records.
        position_sigma_m: standard deviation of the positions.

    Attributes:
        navigation: poses of the vehicle from GNSS/INS and odometry.
        odometry: odometry of the drive-by-wire box.
        vehicle: signals of the vehicle, ``None`` without a status of the box; commands only where a control tick ran.
        plan: decisions of the control ticks, where they ran.
        seconds: time from the first to the last record of navigation.
    """

    def __init__(
        self, signals: RunSignals, mono_ns: int, source: MapFile | RecordedTracks, position_sigma_m: float
    ) -> None:
        self._signals, self._mono_ns = signals, mono_ns
        self.odometry = OdometryTrack(self.seconds_of(signals.box_ns), signals.travel_m)
        self.vehicle = self._vehicle()
        if isinstance(source, RecordedTracks):
            self.navigation, self.plan, self._longest_s = source.navigation, self._plan(source.frame), _HOLE_S
            # A silent odometer would end the drive there.
            box_s, nav_s = self.odometry.time_s, self.navigation.time_s
            whole = len(box_s) > 1 and box_s[0] < nav_s[0] + _HOLE_S and box_s[-1] > nav_s[-1] - _HOLE_S
            self.odometry = self.odometry if whole else source.odometry
        else:
            self.navigation = self._navigation(source, position_sigma_m)
            self.plan = self._plan(source.description.frame)
            self._longest_s = np.inf
        self.seconds = float(self.navigation.time_s[-1] - self.navigation.time_s[0])

    def seconds_of(self, times_ns: np.ndarray) -> Float[np.ndarray, " row"]:
        """Times in seconds of the log."""
        return np.asarray(1e-9 * (times_ns - self._mono_ns).astype(np.float64))

    def scans_kept(self) -> Bool[np.ndarray, " scan"]:
        """Scans with both navigation and odometry at their time."""
        time_s = self.seconds_of(self._signals.scan_ns)
        first = max(self.navigation.time_s[0], self.odometry.time_s[0])
        last = min(self.navigation.time_s[-1], self.odometry.time_s[-1])
        after = np.clip(np.searchsorted(self.navigation.time_s, time_s), 1, len(self.navigation.time_s) - 1)
        near = np.diff(self.navigation.time_s)[after - 1] <= self._longest_s
        return np.asarray(self._signals.scan_kept & (time_s >= first) & (time_s <= last) & near)

    def _navigation(self, source: MapFile, position_sigma_m: float) -> NavigationTrack:
        prior, frame = self._signals.prior, source.description.frame
        east, north, yaw = prior["pose"].T.astype(np.float64)
        latitude, longitude, height = frame.to_geodetic(east, north, _ground_up_m(source, east, north))
        sigma_m = np.full(len(prior), position_sigma_m)
        return NavigationTrack(
            time_s=self.seconds_of(self._signals.prior_ns),
            latitude_deg=latitude,
            longitude_deg=longitude,
            height_m=height,
            heading_deg=frame.heading_of_yaw(yaw, longitude),
            roll_deg=np.degrees(prior["roll_rad"]),
            sigma_east_m=sigma_m,
            sigma_north_m=sigma_m,
            sigma_height_m=np.full(len(prior), _SIGMA_HEIGHT_M),
            sigma_heading_deg=np.degrees(np.abs(prior["sigma_yaw_rad"])),
            sigma_roll_deg=np.full(len(prior), _SIGMA_ROLL_DEG),
        )

    def _plan(self, frame: LocalFrame | None) -> dict[str, np.ndarray] | None:
        plan = self._signals.plan
        if not len(plan) or frame is None:
            return None
        east, north, yaw = plan["pose"].T.astype(np.float64)
        latitude, longitude, _ = frame.to_geodetic(east, north, np.zeros_like(east))
        return {
            "time_s": self.seconds_of(self._signals.plan_ns),
            "latitude_deg": latitude,
            "longitude_deg": longitude,
            "heading_deg": frame.heading_of_yaw(yaw, longitude),
            **{name: plan[name] for name in _PLANNED},
        }

    def _vehicle(self) -> dict[str, np.ndarray] | None:
        """Measurements of the box, and the commands at that time from the first control tick on: that of the steering
        as it was decided, those of the pedals as the box had taken them.
        """
        known, plan = self._signals, self._signals.plan
        told = known.box_ns >= known.plan_ns[0] if len(plan) else np.ones(len(known.box_ns), bool)
        at, box = known.box_ns[told], known.box[told]
        if not len(box):
            return None
        measured = {
            "time_s": self.seconds_of(at),
            "steering_potentiometer_v": box["potentiometer_v"].astype(np.float64),
            "encoder_counts": box["encoder_counts"],
            "supply_v": box["supply_v"].astype(np.float64),
        }
        if not len(plan):
            return measured
        held = plan[np.searchsorted(known.plan_ns, at, side="right") - 1]
        taken = known.pedals[told]
        # A box may take its first command after the recording begins.
        pedals = np.where(np.isfinite(taken), taken, held["command"][:, 1:].astype(np.float64))
        if len(known.prior_ns):
            measured["yaw_rate_radps"] = np.interp(at, known.prior_ns, known.prior["yaw_rate_radps"])
        return {
            **measured,
            "wheel_angle_rad": held["front_rad"].astype(np.float64),
            "steering_command_rad": held["command"][:, 0].astype(np.float64),
            "throttle": pedals[:, 0],
            "brake": pedals[:, 1],
            "mode": held["mode"].astype(np.int8),
        }


def _ground_up_m(source: MapFile, east_m: np.ndarray, north_m: np.ndarray) -> Float[np.ndarray, " prior"]:
    """Up coordinate of the map's ground where the vehicle was; off the map, that of the last place on it."""
    cells, member = np.unique(
        np.floor(np.stack([east_m, north_m], axis=1) / _CELL_M).astype(np.int64), axis=0, return_inverse=True
    )
    stations = SpatialIndex(source.pose[:, :2], 8.0)
    nearest = [stations.nearest((cell + 0.5) * _CELL_M, _NEAR_M) for cell in cells]
    up = np.array([np.nan if station is None else source.ground_up_m[station] for station in nearest])[member.ravel()]
    index, known = np.arange(len(up)), np.isfinite(up)
    if not known.any():
        return np.full(len(up), float(np.median(source.ground_up_m)))
    return np.asarray(np.interp(index, index[known], up[known]))


_BLOCK_SCANS = 256


class RunDrive(NamedTuple):
    """Contents of a drive log made from a run.

    Attributes:
        scans: number of scans in the log.
        left_out: number of the run's scans left out: their stamps do not rise, their shape is not that of the radar's
            description, the radar sent another description or look-up before them, or the vehicle's position is
            unknown.
        seconds: time from the first to the last record of navigation.
    """

    scans: int
    left_out: int
    seconds: float


def write_run_drive(
    run: str | Path | RunReading,
    output: str | Path,
    *,
    source: MapFile | RecordedTracks,
    vehicle: VehicleFile | None,
    position_sigma_m: float,
    registration: dict[str, object] | None = None,
    calibration: str | Path | None = None,
    force: bool = False,
) -> RunDrive:
    """Write a run as a drive log; scans are streamed. With fewer than two scans it is a log without radar.

    ``/gnss_ins`` holds the vehicle's poses from GNSS/INS and odometry in the map's frame, with the map's height.

    Args:
        run: folder of the run, or an open run.
        output: path of ``X.drive.h5``.
        source: map of the run, for frame, channels and ground; for a run that only records, its tracks.
        vehicle: vehicle of the run, for the position of its array; ``None``: the array is assumed at the antenna.
        position_sigma_m: standard deviation of the positions from the run's configuration.
        calibration: calibration of the radar, in place of the radar's own look-up and of the vehicle file's gains and
            delays.
        force: whether to replace an existing output.

    Raises:
        InputError: there is no run, or neither navigation nor odometry in it; the vehicle file lacks the array's
            position; the calibration is of other sweeps; the output exists (without ``force``) or cannot be written.
    """
    reading = run if isinstance(run, RunReading) else read_run(run)
    clock = reading.clock
    if clock is None:
        raise InputError(reading.folder, "segments", "a complete segment header, or run.json", "neither")
    signals = signals_of_run(reading, own_lookup=calibration is None)
    needed = (("prior", signals.prior), ("drive_status", signals.box))
    for place, rows in () if isinstance(source, RecordedTracks) else needed:
        if len(rows) < 2:
            raise InputError(reading.folder, "segments", f"at least two complete records of {place}", str(len(rows)))
    name = Path(output).name.removesuffix(".drive.h5")
    t0_utc = datetime.fromtimestamp(clock[0] // 10**9, UTC).replace(microsecond=clock[0] % 10**9 // 1000).isoformat()
    tracks = RunTracks(signals, clock[1], source, position_sigma_m)
    provenance = _provenance(reading, source) | ({} if registration is None else {"registration": registration})
    provenance |= {} if calibration is None else {"calibration": Path(calibration).name}
    kept = tracks.scans_kept()
    if np.count_nonzero(kept) < 2:
        log = VehicleLog(
            name=name,
            t0_utc=t0_utc,
            navigation=tracks.navigation,
            odometry=tracks.odometry,
            truth=None,
            vehicle=tracks.vehicle,
            serial_number=None if vehicle is None else vehicle.serial_number,
            provenance=provenance,
            plan=tracks.plan,
        )
        write_vehicle_log(output, log, force=force)
        return RunDrive(0, len(kept), tracks.seconds)
    assert signals.radar is not None
    recording = _recording(signals, source, vehicle, calibration)
    on_board = None if isinstance(source, RecordedTracks) else _on_board(signals, kept, source)
    pitch_m = (source if isinstance(source, RecordedTracks) else source.description).channel_pitch_m
    array = _array(vehicle, pitch_m, signals.radar, reading.folder)
    description = DriveDescription(
        name=name,
        t0_utc=t0_utc,
        array=array,
        recording=recording,
        navigation=tracks.navigation,
        odometry=tracks.odometry,
        truth=None,
        vehicle=tracks.vehicle,
        provenance=provenance,
        serial_number=None if vehicle is None else vehicle.serial_number,
        plan=tracks.plan,
        on_board=on_board,
    )
    dtype = np.uint8 if isinstance(recording, TraceRecording) else np.complex64
    with DriveWriter.create(output, description, channels=len(array.y_m), dtype=dtype, force=force) as writer:
        traces = isinstance(recording, TraceRecording)
        frames = scan_frames(reading, "radar_scan" if traces else "radar_sweep")
        append = _append_traces if traces else _append_sweeps
        _write_scans(writer, append, frames, tracks.seconds_of(signals.scan_ns), kept)
        return RunDrive(writer.scans, len(kept) - writer.scans, tracks.seconds)


def _recording(
    signals: RunSignals, source: MapFile | RecordedTracks, vehicle: VehicleFile | None, calibration: str | Path | None
) -> TraceRecording | SweepRecording:
    """The recording's description from the radar's messages."""
    radar = signals.radar
    assert radar is not None
    layout = layout_of(radar)
    if layout is None:
        if calibration is not None:
            raise InputError(calibration, "sweeps", "a radar of stepped-frequency sweeps", "a radar of finished traces")
        return TraceRecording(
            sample_interval_ns=1e-3 * float(radar["sample_interval_ps"]),
            time_zero_ns=1e-3 * float(radar["time_zero_ps"]),
            zero_level=float(radar["zero_level"]),
            # The chain's filter spans one and a half periods of it. A radar does not state it.
            centre_frequency_hz=source.centre_frequency_hz
            if isinstance(source, RecordedTracks)
            else 1.5e9 / source.description.settings.dewow_ns,
            samples=int(radar["samples"]),
        )
    place = ArrayTable() if vehicle is None else vehicle.array
    gain = None if place.channel_gain is None else np.array(place.channel_gain)
    delay_ns = None if place.channel_delay_ns is None else np.array(place.channel_delay_ns)
    if calibration is not None:
        return read_radar_calibration(calibration, layout, gain=gain, delay_ns=delay_ns)
    assert signals.lookup is not None
    lookup = complex_rows(signals.lookup)
    return SweepRecording(
        frequencies_hz=layout.frequencies_hz,
        lookup_sweeps=lookup[:-1],
        lookup_calibration_sweep=lookup[-1],
        group_delay_ns=layout.group_delay_ns,
        channel_gain=gain,
        channel_delay_ns=delay_ns,
    )


def layout_of(radar: np.void) -> SweepLayout | None:
    """Layout of the sweeps of a ``radar_sweep_description``; ``None`` for a ``radar_description``."""
    if "steps" not in (radar.dtype.names or ()):
        return None
    first_hz, step_hz = (1e3 * float(radar[name]) for name in ("first_khz", "step_khz"))
    frequencies_hz = first_hz + step_hz * np.arange(int(radar["steps"]))
    return SweepLayout(int(radar["channels"]), frequencies_hz, 1e-3 * float(radar["group_delay_ps"]))


def _on_board(signals: RunSignals, kept: Bool[np.ndarray, " scan"], source: MapFile) -> OnBoardSearch | None:
    """The search as it was made on board, of the scans that are kept; ``None`` for a run that did not record it."""
    at = signals.searched_scan
    # Without one of its scans a search cannot be made again from there on, up to the next beginning.
    number = np.cumsum(kept) - 1
    begins = signals.searched["begins"] != 0
    broken = np.cumsum(~kept[at] | (np.diff(at, prepend=-1) <= 0))
    start = np.maximum.accumulate(np.where(begins, np.arange(len(at)), -1))
    before = np.where(start > 0, broken[np.maximum(start, 1) - 1], 0)
    whole = (start >= 0) & (broken == before)
    if not whole.any():
        return None
    given, found = signals.searched[whole], signals.found[whole]
    channels = np.arange(source.description.channels)
    searched = {
        "scan": number[at[whole]],
        "begins": given["begins"],
        "valid": ((given["valid"].astype(np.int64)[:, None] >> channels) & 1).astype(np.uint8),
        "pose_m": given["pose"].astype(np.float64),
        "travel_m": given["travel_m"].astype(np.float64),
        "speed_mps": given["speed_mps"].astype(np.float64),
        "sigma_yaw_rad": given["sigma_yaw_rad"].astype(np.float64),
        "code": found["code"].astype(np.int8),
        "fix_m": found["pose"][:, :2].astype(np.float64),
    }
    return OnBoardSearch(source.description.frame, searched)


def _append_traces(writer: DriveWriter, times: list[float], frames: list[bytes]) -> None:
    heads = np.array([np.frombuffer(frame, frame_type("radar_scan"), 1)[0] for frame in frames])
    data = np.frombuffer(b"".join(frame_data(frame, "radar_scan") for frame in frames), np.uint8)
    traces = data.reshape(len(frames), int(heads[0]["channels"]), -1)
    writer.append(np.array(times), traces, _valid(heads, traces.shape[1]))


def _append_sweeps(writer: DriveWriter, times: list[float], frames: list[bytes]) -> None:
    heads = np.array([np.frombuffer(frame, frame_type("radar_sweep"), 1)[0] for frame in frames])
    rows = np.stack([complex_rows(decode(frame)) for frame in frames])
    writer.append_sweeps(np.array(times), rows[:, :-1], rows[:, -1], _valid(heads, rows.shape[1] - 1))


def _valid(heads: np.ndarray, channels: int) -> Bool[np.ndarray, "scan channel"]:
    return np.asarray((heads["valid"].astype(np.int64)[:, None] >> np.arange(channels)) & 1, bool)


def _write_scans(
    writer: DriveWriter,
    append: Callable[[DriveWriter, list[float], list[bytes]], None],
    scans: Iterator[bytes],
    time_s: Float[np.ndarray, " scan"],
    kept: np.ndarray,
) -> None:
    frames: list[bytes] = []
    times: list[float] = []
    for frame, at, keep in zip(scans, time_s, kept, strict=False):
        if keep:
            frames.append(frame)
            times.append(float(at))
        if len(frames) == _BLOCK_SCANS:
            append(writer, times, frames)
            frames, times = [], []
    if frames:
        append(writer, times, frames)


def _array(vehicle: VehicleFile | None, pitch_m: float | None, radar: np.void, folder: Path) -> ArrayGeometry:
    """Positions of the channels.

    Raises:
        InputError: the spacing of the channels is unknown.
    """
    channels, period_s = int(radar["channels"]), 1e-6 * float(radar["scan_period_us"])
    if pitch_m is None and channels > 1 and (vehicle is None or vehicle.array.channel_y_m is None):
        expected = "radar.channel_pitch_m in the configuration, or array.channel_y_m in the vehicle file"
        raise InputError(folder, "radar", expected, f"{channels} channels of unknown spacing")
    if vehicle is None:
        return uniform_array(channels, pitch_m or 0.0, scan_period_s=period_s)
    return array_of_vehicle(vehicle, vehicle.name, channels=channels, pitch_m=pitch_m or 0.0, scan_period_s=period_s)


def _provenance(reading: RunReading, source: MapFile | RecordedTracks) -> dict[str, object]:
    found = reading.summary
    return {
        "program": f"lgprjax {__version__}",
        "step": "recover",
        "run": str(found.run),
        "recording": {
            "ended": found.end,
            "records": found.records,
            "numbers_missing": sum(lost.last - lost.first + 1 for lost in found.missing),
            "bytes_damaged": sum(lost.stop - lost.start for lost in (*found.damaged, *found.cut)),
            "messages_dropped": found.dropped,
        },
        "radar_time": "stamps of the radar's clock: arrival minus the delay of the line",
        **_origin(source),
    }


def _origin(source: MapFile | RecordedTracks) -> dict[str, object]:
    """Sources of poses and frequency, for the provenance."""
    if isinstance(source, RecordedTracks):
        return {"gnss_ins": source.origin, "centre_frequency": "as configured"}
    return {
        "map": source.description.name,
        "gnss_ins": "pose from GNSS/INS and odometry as fused during the run, in the map's frame; height of the "
        "map's ground; sigma of positions as configured, of height and roll assumed",
        "centre_frequency": "of the map",
    }
