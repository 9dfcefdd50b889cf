"""A simulated drive as a drive log."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict, replace
from pathlib import Path

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from lgprjax import __version__
from lgprjax.formats import (
    DriveDescription,
    DriveWriter,
    NavigationTrack,
    OdometryTrack,
    SweepRecording,
    TraceRecording,
)
from lgprjax.frames import LocalFrame
from lgprjax.radar import ChannelResponse, LookUp, calibrate_sweeps, estimate_channel_response, find_dead_channels
from lgprjax.scene import PoseTrack, SimulatedDrive, SweepPlan, iterate_sweeps, iterate_traces, start_of_day

# Receiver description of a stepped-frequency drive log: frequencies, look-up, and each channel's gain and delay.


def describe_sweeps(drive: SimulatedDrive, plan: SweepPlan) -> SweepRecording:
    """The recording of a drive's sweeps, from the recordings at the start of its day.

    As in the field: the array in empty space is the look-up, and gains and delays are measured over a metal plate,
    noise included; the truth about the channels stays in the scene.
    """
    start = start_of_day(plan, drive.radar, drive.response, drive.day.noise_field, drive.day.seed)
    frequencies_hz = plan.frequency_mhz * 1e6
    channels = len(start.empty)
    plate, _ = calibrate_sweeps(
        jnp.asarray(start.plate[None]),
        jnp.asarray(start.plate_calibration[None]),
        LookUp(jnp.asarray(start.empty), jnp.asarray(start.empty_calibration)),
        ChannelResponse(jnp.ones(channels), jnp.zeros(channels)),
        jnp.asarray(frequencies_hz, jnp.float32),
    )
    dead = find_dead_channels(
        np.stack([start.empty, start.plate]), np.stack([start.empty_calibration, start.plate_calibration])
    )
    response = estimate_channel_response(np.asarray(plate[0]), frequencies_hz, dead)
    return SweepRecording(
        frequencies_hz=frequencies_hz,
        lookup_sweeps=start.empty,
        lookup_calibration_sweep=start.empty_calibration,
        group_delay_ns=plan.calibration_delay_ns,
        channel_gain=np.asarray(response.gain, np.float64),
        channel_delay_ns=np.asarray(response.delay_ns, np.float64),
    )


SITE_FRAME = LocalFrame(latitude_deg=42.0, longitude_deg=-71.0, height_m=30.0)
"""Default place of generated sites on the globe."""

_T0_UTC = "2026-01-01T00:00:00+00:00"


def describe_drive(
    name: str,
    drive: SimulatedDrive,
    *,
    frame: LocalFrame = SITE_FRAME,
    sweeps: SweepPlan | None = None,
    provenance: Mapping[str, object] | None = None,
) -> DriveDescription:
    """Description of a simulated drive without its radar data, including the truth.

    Args:
        frame: local frame at the start of the road.
        sweeps: sweep plan of a stepped-frequency radar; ``None`` for a radar that records traces.
        provenance: provenance of the site, added to the drive's own.
    """
    radar = drive.radar
    traces = TraceRecording(
        sample_interval_ns=radar.sample_step_ns,
        time_zero_ns=radar.time_zero_ns,
        zero_level=128.0,
        centre_frequency_hz=0.5e6 * (radar.band_mhz[0] + radar.band_mhz[1]),
        samples=radar.samples,
    )
    own = {"program": f"lgprjax {__version__}", "synthetic": True, "drive_seed": drive.seed, "day": asdict(drive.day)}
    # A log's height is that of the road below the vehicle: it includes navigation's error and excludes the springs.
    wrong_m = drive.navigation.pose[:, 2] - drive.navigation_springs_m
    return DriveDescription(
        name=name,
        t0_utc=_T0_UTC,
        array=drive.array,
        recording=traces if sweeps is None else describe_sweeps(drive, sweeps),
        navigation=_navigation(drive.navigation, drive.navigation_up_m + wrong_m, frame),
        odometry=OdometryTrack(drive.odometer.time_s, drive.odometer.distance_m),
        truth=_navigation(PoseTrack(drive.scan_time_s, drive.pose), drive.ground_up_m, frame),
        vehicle=None,
        provenance={**own, **(provenance or {})},
    )


def write_drive(
    path: Path,
    drive: SimulatedDrive,
    *,
    frame: LocalFrame = SITE_FRAME,
    sweeps: SweepPlan | None = None,
    provenance: Mapping[str, object] | None = None,
    force: bool = False,
    progress: Callable[[int], None] = lambda _: None,
) -> None:
    """Render a simulated drive into a drive log, streaming; arguments as of ``describe_drive``.

    A drive that fails leaves nothing behind.

    Raises:
        InputError: the output exists or cannot be written.
    """
    name = path.name.removesuffix(".drive.h5")
    description = describe_drive(name, drive, frame=frame, sweeps=sweeps, provenance=provenance)
    dtype = np.uint8 if sweeps is None else np.complex64
    channels = len(drive.array.y_m)
    with DriveWriter.create(path, description, channels=channels, dtype=dtype, force=force) as writer:
        for scans in _record(writer, drive, sweeps):
            progress(scans)


def write_drives(
    drives: Mapping[str, SimulatedDrive],
    folder: Path,
    *,
    force: bool = False,
    progress: Callable[[int], None] = lambda _: None,
) -> dict[str, Path]:
    """Write every drive of a site to ``NAME.drive.h5`` in a folder; returns the paths by name."""
    paths = {name: folder / f"{name}.drive.h5" for name in drives}
    for name, drive in drives.items():
        write_drive(paths[name], drive, force=force, progress=progress)
    return paths


def _record(writer: DriveWriter, drive: SimulatedDrive, sweeps: SweepPlan | None) -> Iterator[int]:
    """Append chunk by chunk; yields the number of scans in each."""
    if sweeps is None:
        for traces in iterate_traces(drive):
            writer.append(drive.scan_time_s[writer.scans : writer.scans + len(traces)], traces)
            yield len(traces)
        return
    for recorded, calibration in iterate_sweeps(drive, sweeps):
        time_s = drive.scan_time_s[writer.scans : writer.scans + len(recorded)]
        writer.append_sweeps(time_s, recorded, calibration)
        yield len(recorded)


def _navigation(track: PoseTrack, up_m: Float[np.ndarray, " time"], frame: LocalFrame) -> NavigationTrack:
    pose, sigma = track.pose, track.sigma
    latitude, longitude, height = frame.to_geodetic(pose[:, 0], pose[:, 1], up_m)
    known = NavigationTrack(
        time_s=track.time_s,
        latitude_deg=latitude,
        longitude_deg=longitude,
        height_m=height,
        heading_deg=frame.heading_of_yaw(pose[:, 3], longitude),
        roll_deg=np.degrees(pose[:, 4]),
    )
    if sigma is None:
        return known
    return replace(
        known,
        sigma_east_m=sigma[:, 0],
        sigma_north_m=sigma[:, 1],
        sigma_height_m=sigma[:, 2],
        sigma_heading_deg=np.degrees(sigma[:, 3]),
        sigma_roll_deg=np.degrees(sigma[:, 4]),
    )
