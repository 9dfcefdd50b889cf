"""A recorded run as a drive log: what the vehicle recorded driving by itself maps and registers like any other."""

from datetime import UTC, datetime
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from lgprjax import __version__
from lgprjax.archive.run_signals import scan_frames, signals_of_run
from lgprjax.archive.run_tracks import RunTracks
from lgprjax.errors import InputError
from lgprjax.formats import (
    DriveDescription,
    DriveWriter,
    MapFile,
    TraceRecording,
    VehicleFile,
    VehicleLog,
    write_vehicle_log,
)
from lgprjax.formats.run_frames import frame_data, frame_type
from lgprjax.formats.run_log import RunReading, read_run
from lgprjax.radar import ArrayGeometry, uniform_array

_BLOCK_SCANS = 256


class RunDrive(NamedTuple):
    """What a drive log made of a run holds.

    Attributes:
        scans: in it.
        left_out: scans of the run that are not: their stamps do not rise, they are not as the radar described itself,
            or nothing tells where the vehicle was.
        seconds: from its first to its last record of navigation.
    """

    scans: int
    left_out: int
    seconds: float


def write_run_drive(
    run: str | Path | RunReading,
    output: str | Path,
    *,
    source: MapFile,
    vehicle: VehicleFile,
    position_sigma_m: float,
    force: bool = False,
) -> RunDrive:
    """Write what a run holds as a drive log; scans are streamed. Without two scans it is a log without radar.

    ``/gnss_ins`` is where GNSS/INS and odometry had the vehicle in the map's frame, the height the map's own.

    Args:
        run: its folder, or its reading.
        output: ``X.drive.h5``.
        source: the map that was driven on: its frame, its channels, its ground.
        vehicle: that drove: where its array is.
        position_sigma_m: of the positions, as the run was configured.
        force: replace an output that exists.

    Raises:
        InputError: there is no run, or neither navigation nor odometry in it; the vehicle file does not tell where
            the array is; the output exists (without ``force``) or cannot be written.
    """
    reading = run if isinstance(run, RunReading) else read_run(run)
    clock = reading.clock
    if clock is None:
        raise InputError(reading.folder, "segments", "a whole head, or run.json", "neither")
    signals = signals_of_run(reading)
    for place, rows in (("prior", signals.prior), ("drive_status", signals.box)):
        if len(rows) < 2:
            raise InputError(reading.folder, "segments", f"two whole records of {place} or more", str(len(rows)))
    name = Path(output).name.removesuffix(".drive.h5")
    t0_utc = datetime.fromtimestamp(clock[0] // 10**9, UTC).replace(microsecond=clock[0] % 10**9 // 1000).isoformat()
    tracks = RunTracks(signals, clock[1], source, position_sigma_m)
    provenance = _provenance(reading, source)
    kept = tracks.scans_kept()
    if np.count_nonzero(kept) < 2:
        log = VehicleLog(
            name=name,
            t0_utc=t0_utc,
            navigation=tracks.navigation,
            odometry=tracks.odometry,
            truth=None,
            vehicle=tracks.vehicle,
            serial_number=vehicle.serial_number,
            provenance=provenance,
            plan=tracks.plan,
        )
        write_vehicle_log(output, log, force=force)
        return RunDrive(0, len(kept), tracks.seconds)
    assert signals.radar is not None
    recording = TraceRecording(
        sample_interval_ns=1e-3 * float(signals.radar["sample_interval_ps"]),
        time_zero_ns=1e-3 * float(signals.radar["time_zero_ps"]),
        zero_level=float(signals.radar["zero_level"]),
        # The chain's filter spans a period and a half of it.
        centre_frequency_hz=1.5e9 / source.description.settings.dewow_ns,
        samples=int(signals.radar["samples"]),
    )
    array = _array(vehicle, source, signals.radar)
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
        serial_number=vehicle.serial_number,
        plan=tracks.plan,
    )
    with DriveWriter.create(output, description, channels=len(array.y_m), dtype=np.uint8, force=force) as writer:
        _write_scans(writer, reading, tracks.seconds_of(signals.scan_ns), kept, recording.samples)
        return RunDrive(writer.scans, len(kept) - writer.scans, tracks.seconds)


def _write_scans(
    writer: DriveWriter,
    reading: RunReading,
    time_s: Float[np.ndarray, " scan"],
    kept: np.ndarray,
    samples: int,
) -> None:
    block: list[bytes] = []
    times: list[float] = []

    def append() -> None:
        if not block:
            return
        heads = np.array([np.frombuffer(frame, frame_type("radar_scan"), 1)[0]["valid"] for frame in block], np.int64)
        data = np.frombuffer(b"".join(frame_data(frame, "radar_scan") for frame in block), np.uint8)
        traces = data.reshape(len(block), -1, samples)
        valid = (heads[:, None] >> np.arange(traces.shape[1])) & 1
        writer.append(np.array(times), traces, valid.astype(bool))
        block.clear()
        times.clear()

    for frame, at, keep in zip(scan_frames(reading), time_s, kept, strict=False):
        if keep:
            block.append(frame)
            times.append(float(at))
        if len(block) == _BLOCK_SCANS:
            append()
    append()


def _array(vehicle: VehicleFile, source: MapFile, radar: np.void) -> ArrayGeometry:
    place = vehicle.array
    if place.x_m is None or place.height_m is None:
        raise InputError(vehicle.name, "array", "x_m and height_m", "none")
    return uniform_array(
        int(radar["channels"]),
        source.description.channel_pitch_m,
        x_m=place.x_m,
        height_m=place.height_m,
        scan_period_s=1e-6 * float(radar["scan_period_us"]),
    )


def _provenance(reading: RunReading, source: MapFile) -> dict[str, object]:
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
        "map": source.description.name,
        "gnss_ins": "pose by GNSS/INS and odometry as the run fused them, in the map's frame; height of the map's "
        "ground; sigma of positions as configured, of height and roll assumed",
        "radar_time": "stamps of the radar's clock, behind their arrival by what the line held them up",
        "centre_frequency": "of the map",
    }
