"""A simulated drive as a drive log."""

from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np

from lgprjax import __version__
from lgprjax.formats import DriveDescription, DriveWriter, NavigationTrack, OdometryTrack, TraceRecording
from lgprjax.frames import LocalFrame
from lgprjax.scene import PoseTrack, SimulatedDrive, iterate_traces

SITE_FRAME = LocalFrame(latitude_deg=42.0, longitude_deg=-71.0, height_m=30.0)
"""Where generated sites are put on the globe."""

_CENTRE_FREQUENCY_HZ = 250e6
_T0_UTC = "2026-01-01T00:00:00+00:00"


def describe_drive(name: str, drive: SimulatedDrive) -> DriveDescription:
    """Everything of a simulated drive but its traces; the truth included."""
    radar = drive.radar
    sigma = {"position_m": 0.05, "height_m": 0.05, "heading_deg": 0.3, "roll_deg": 0.1}
    return DriveDescription(
        name=name,
        t0_utc=_T0_UTC,
        array=drive.array,
        recording=TraceRecording(
            sample_interval_ns=radar.sample_step_ns,
            time_zero_ns=radar.time_zero_ns,
            zero_level=128.0,
            centre_frequency_hz=_CENTRE_FREQUENCY_HZ,
            samples=radar.samples,
        ),
        navigation=_navigation(drive.navigation, sigma),
        odometry=OdometryTrack(drive.odometer.time_s, drive.odometer.distance_m),
        truth=_navigation(PoseTrack(drive.scan_time_s, drive.pose), None),
        vehicle=None,
        provenance={"program": f"lgprjax {__version__}", "synthetic": True, "drive_seed": drive.seed},
    )


def write_drive(
    path: Path, drive: SimulatedDrive, *, force: bool = False, progress: Callable[[int], None] = lambda _: None
) -> None:
    """Render a simulated drive into a drive log, streaming.

    Raises:
        InputError: the output exists or cannot be written.
    """
    name = path.name.removesuffix(".drive.h5")
    done = 0
    with DriveWriter.create(
        path, describe_drive(name, drive), channels=len(drive.array.y_m), dtype=np.uint8, force=force
    ) as writer:
        for traces in iterate_traces(drive):
            writer.append(drive.scan_time_s[done : done + len(traces)], traces)
            done += len(traces)
            progress(len(traces))


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


def _navigation(track: PoseTrack, sigma: Mapping[str, float] | None) -> NavigationTrack:
    pose = track.pose
    # The generated road is level: the ground is as high as the site's anchor everywhere.
    latitude, longitude, height = SITE_FRAME.to_geodetic(pose[:, 0], pose[:, 1], np.zeros(len(pose)))

    def every(name: str) -> np.ndarray | None:
        return None if sigma is None else np.full(len(pose), sigma[name])

    return NavigationTrack(
        time_s=track.time_s,
        latitude_deg=latitude,
        longitude_deg=longitude,
        height_m=height,
        heading_deg=SITE_FRAME.heading_of_yaw(pose[:, 3], longitude),
        roll_deg=np.degrees(pose[:, 4]),
        sigma_east_m=every("position_m"),
        sigma_north_m=every("position_m"),
        sigma_height_m=every("height_m"),
        sigma_heading_deg=every("heading_deg"),
        sigma_roll_deg=every("roll_deg"),
    )
