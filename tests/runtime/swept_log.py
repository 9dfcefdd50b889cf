"""A drive log of a stepped-frequency radar."""

from pathlib import Path

import numpy as np

from formats.samples import make_track
from lgprjax.formats import DriveDescription, DriveWriter, OdometryTrack, SweepRecording
from lgprjax.radar import uniform_array


def write_swept_log(path: Path, sweeps: np.ndarray, calibration: np.ndarray, recording: SweepRecording) -> None:
    """Sweeps of every channel by scans at 126 a second, and those of the calibration channel."""
    time_s = np.arange(len(sweeps)) / 126.0
    channels = sweeps.shape[1]
    description = DriveDescription(
        name="swept",
        t0_utc="2026-01-01T00:00:00",
        array=uniform_array(channels, 0.127, height_m=0.3, scan_period_s=1.0 / 126.0),
        recording=recording,
        navigation=make_track(),
        odometry=OdometryTrack(np.array([0.0, 1.0]), np.array([0.0, 1.0])),
        truth=None,
        vehicle=None,
        provenance={"program": "test"},
    )
    with DriveWriter.create(path, description, channels=channels, dtype=np.complex64) as writer:
        writer.append_sweeps(time_s, sweeps, calibration)
