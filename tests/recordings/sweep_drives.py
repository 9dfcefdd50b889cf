"""The traces of a generated drive as a stepped-frequency radar would have recorded them."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from lgprjax.formats import DriveLog, DriveWriter, SweepRecording, TraceRecording
from lgprjax.scene import RadarConfig
from lgprjax.scene.render import ReceiverConfig, time_gain

FREQUENCIES_HZ = np.linspace(100e6, 400e6, 61)  # 5 MHz: 200 ns
CABLE_NS = 3.7


def late(delay_ns: float | np.ndarray) -> np.ndarray:
    return np.asarray(np.exp(-2e-9j * np.pi * np.multiply.outer(delay_ns, FREQUENCIES_HZ)))


def write_sweeps(
    source: Path, target: Path, day: int, *, scans: int | None = None, changes: dict[str, Any] | None = None
) -> Path:
    """A drive of traces as sweeps: time gain taken off, transformed, with what the instrument does to them.

    Receiver gain and phase drift by a fifth and by half a radian along the drive, and were others when the look-up
    was taken; channels have gains, delays, coupling and reflections of the vehicle; the calibration path has a delay
    and a ripple; noise lies 80 dB below the coupling. ``changes`` replace fields of the recording.
    """
    rng, hardware = np.random.default_rng(day), np.random.default_rng(99)
    with DriveLog.open(source) as log:
        known, channels = log.description.recording, log.channels
        assert isinstance(known, TraceRecording)
        traces, _ = log.read_traces(0, scans or log.scans)
        time_ns = np.arange(known.samples) * known.sample_interval_ns - known.time_zero_ns
        field = (traces / time_gain(RadarConfig(), ReceiverConfig())) @ late(time_ns)
        gain, delay_ns = 1 + 0.1 * hardware.normal(size=channels), 0.1 * hardware.normal(size=channels)
        own = gain[:, None] * late(delay_ns)
        coupling = (hardware.normal(size=(channels, 3)) * [20.0, 5.0, 2.0]) @ late(np.array([0.5, 4.0, 11.0]))
        path = 30.0 * (1 + 0.2 * np.sin(FREQUENCIES_HZ / 23e6)) * late(CABLE_NS)
        elsewhere = 0.6 * np.exp(0.9j)
        recording = SweepRecording(
            FREQUENCIES_HZ,
            (elsewhere * own * coupling).astype(np.complex64),
            (elsewhere * path).astype(np.complex64),
            CABLE_NS,
            gain / gain.mean(),
            delay_ns - delay_ns.mean(),
        )
        part = np.linspace(0.0, 1.0, len(traces))
        drift = (1 + 0.2 * np.sin(2 * np.pi * part + day)) * np.exp(0.5j * np.cos(5.0 * part))
        noise = 2e-3 * (rng.normal(size=field.shape) + 1j * rng.normal(size=field.shape))
        sweeps = drift[:, None, None] * (own * (field + coupling) + noise)
        description = replace(log.description, recording=replace(recording, **(changes or {})))
        with DriveWriter.create(target, description, channels=channels, dtype=np.complex64, force=True) as writer:
            calibration = (drift[:, None] * path).astype(np.complex64)
            writer.append_sweeps(log.scan_time_s[: len(traces)], sweeps.astype(np.complex64), calibration)
    return target
