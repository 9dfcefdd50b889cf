"""A drive log of either kind, traces or sweeps, as real numbers a trace and one matrix that makes profiles of them."""

from collections.abc import Iterator
from functools import lru_cache
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from lgprjax.errors import InputError
from lgprjax.formats import DriveLog, SweepRecording, TraceRecording
from lgprjax.radar import (
    ChainSettings,
    LookUp,
    calibrate_sweeps,
    default_chain,
    depth_window_ns,
    find_dead_channels,
    profile_operator,
    profile_samples,
    stacked,
    sweep_chain,
    sweep_operator,
    sweep_samples,
    sweep_step_hz,
)

_BAND_SHARE = 0.5
"""A recording that hears less than this share of a map's band is refused."""
_HEAD_SCANS = 64
"""Scans from which dead channels are told: the same for every reader of a drive, wherever it begins."""


class RecordedBlock(NamedTuple):
    """Consecutive scans from scan ``start`` on, ready for the matrix of their recording."""

    start: int
    recorded: Float[np.ndarray, "scan channel recorded"]
    valid: Bool[np.ndarray, "scan channel"]


class TraceDrive:
    """A drive log of traces."""

    kind = "traces"
    steps = ("time zero", "dewow", "band-pass", "decimate")

    def __init__(self, log: DriveLog, recording: TraceRecording) -> None:
        self._log = log
        self._recording = recording

    def chain(self, scan_spacing_m: float, centre_frequency_hz: float | None) -> ChainSettings:
        """Settings for a map that begins with this drive. Raises ``InputError`` where no frequency is known."""
        frequency_hz = self._recording.centre_frequency_hz if centre_frequency_hz is None else centre_frequency_hz
        if frequency_hz is None:
            place = "/radar/traces@centre_frequency_hz"
            raise InputError(self._log.path, place, "a frequency, or --centre-frequency-mhz", "none")
        return default_chain(frequency_hz, scan_spacing_m)

    def samples(self, settings: ChainSettings, travel_time_ns: float | None) -> int:
        """Samples of its profile: to the recording's end, or to ``travel_time_ns`` where that is earlier."""
        known = self._recording
        samples = profile_samples(known.samples, known.sample_interval_ns, known.time_zero_ns, settings)
        return samples if travel_time_ns is None else min(samples, _samples_within(travel_time_ns, settings))

    def operator(self, settings: ChainSettings, kept: int, later_ns: float = 0.0) -> Float[Array, "recorded sample"]:
        """Traces to ``kept`` profile samples, time zero so much later than stated.

        Raises ``InputError`` where the sampling cannot hold the band.
        """
        known = self._recording
        highest_hz = 0.5e9 / known.sample_interval_ns
        if highest_hz < _least_top_hz(settings):
            place = "/radar/traces@sample_interval_ns"
            raise InputError(
                self._log.path,
                place,
                f"at most {0.5e9 / _least_top_hz(settings):.3g} ns for half of the map's band, {_band(settings)}",
                f"{known.sample_interval_ns:.3g} ns",
            )
        return _trace_operator(known.samples, known.sample_interval_ns, known.time_zero_ns + later_ns, settings, kept)

    def blocks(self, scans: int, start: int = 0) -> Iterator[RecordedBlock]:
        """The drive from ``start`` on in blocks of ``scans``, the last one shorter."""
        for low in range(start, self._log.scans, scans):
            yield RecordedBlock(low, *self._log.read_traces(low, min(low + scans, self._log.scans)))


@lru_cache(maxsize=8)
def _trace_operator(
    samples: int, sample_interval_ns: float, time_zero_ns: float, settings: ChainSettings, kept: int
) -> Float[Array, "recorded sample"]:
    """Made once for all drives of a radar."""
    return profile_operator(samples, sample_interval_ns, time_zero_ns, settings, kept=kept)


class SweepDrive:
    """A drive log of stepped-frequency sweeps: calibrated, look-up subtracted, channels brought to one response."""

    kind = "sweeps"
    steps = (
        "divide by calibration channel",
        "subtract look-up",
        "gain and delay of channels",
        "window",
        "inverse transform",
    )

    def __init__(self, log: DriveLog, recording: SweepRecording) -> None:
        self._log = log
        self._recording = recording
        if sweep_step_hz(recording.frequencies_hz) is None:
            steps_mhz = np.diff(recording.frequencies_hz) / 1e6
            found = f"steps of {steps_mhz.min():.4g} to {steps_mhz.max():.4g} MHz"
            raise InputError(log.path, "/radar/frequencies_hz", "equal steps, or multiples of one step", found)
        if not np.all(recording.lookup_calibration_sweep):
            zeros = f"{np.count_nonzero(recording.lookup_calibration_sweep == 0)} zeros"
            raise InputError(log.path, "/radar/lookup_calibration_sweep", "values other than zero", zeros)

    def chain(self, scan_spacing_m: float, centre_frequency_hz: float | None) -> ChainSettings:
        """Settings for a map that begins with this drive: a sweep says its band, and no frequency is asked for."""
        if centre_frequency_hz is not None:
            expected = "no --centre-frequency-mhz: sweeps say their band"
            raise InputError(self._log.path, "/radar/frequencies_hz", expected, f"{centre_frequency_hz / 1e6:g} MHz")
        return sweep_chain(self._recording.frequencies_hz, scan_spacing_m)

    def samples(self, settings: ChainSettings, travel_time_ns: float | None) -> int:
        """Samples of its profile: as far as is unambiguous, at most ``travel_time_ns`` or fifteen periods."""
        limit_ns = depth_window_ns(settings) if travel_time_ns is None else travel_time_ns
        return sweep_samples(self._recording.frequencies_hz, settings, limit_ns)

    def operator(self, settings: ChainSettings, kept: int) -> Float[Array, "recorded sample"]:
        """Stacked sweeps to ``kept`` profile samples. Raises ``InputError`` where they miss most of the band."""
        frequencies_hz = self._recording.frequencies_hz
        step_hz = float(np.diff(frequencies_hz).min())
        within = (frequencies_hz > settings.band_low_hz) & (frequencies_hz < settings.band_high_hz)
        if np.count_nonzero(within) * step_hz < _BAND_SHARE * (settings.band_high_hz - settings.band_low_hz):
            raise InputError(
                self._log.path,
                "/radar/frequencies_hz",
                f"half of the map's band, {_band(settings)}, or more",
                f"{frequencies_hz[0] / 1e6:.4g} to {frequencies_hz[-1] / 1e6:.4g} MHz",
            )
        return sweep_operator(frequencies_hz, settings, group_delay_ns=self._recording.group_delay_ns, kept=kept)

    def blocks(self, scans: int, start: int = 0) -> Iterator[RecordedBlock]:
        """The drive from ``start`` on in blocks of ``scans``, the last one shorter; dead channels are invalid."""
        log, known = self._log, self._recording
        sweeps, calibration, _ = log.read_sweeps(0, min(_HEAD_SCANS, log.scans))
        alive = ~find_dead_channels(sweeps, calibration)
        lookup = LookUp(jnp.asarray(known.lookup_sweeps), jnp.asarray(known.lookup_calibration_sweep))
        response = known.response
        for low in range(start, log.scans, scans):
            sweeps, calibration, valid = log.read_sweeps(low, min(low + scans, log.scans))
            pad = [(0, scans - len(sweeps)), (0, 0)]  # one shape is compiled
            ground, usable = calibrate_sweeps(
                jnp.asarray(np.pad(sweeps, [*pad, (0, 0)])),
                jnp.asarray(np.pad(calibration, pad)),
                lookup,
                type(response)(*(jnp.asarray(part, dtype=jnp.float32) for part in response)),
                jnp.asarray(known.frequencies_hz, dtype=jnp.float32),
            )
            kept = slice(0, len(sweeps))
            yield RecordedBlock(low, np.asarray(stacked(ground))[kept], valid & np.asarray(usable)[kept] & alive)


def recording_of(log: DriveLog) -> TraceDrive | SweepDrive:
    """The radar data of a log, of whichever kind. Raises ``InputError`` for sweeps that no transform can be made of."""
    recording = log.description.recording
    return TraceDrive(log, recording) if isinstance(recording, TraceRecording) else SweepDrive(log, recording)


def _samples_within(travel_time_ns: float, settings: ChainSettings) -> int:
    return max(2, int(travel_time_ns / settings.sample_interval_ns))


def _least_top_hz(settings: ChainSettings) -> float:
    return settings.band_low_hz + _BAND_SHARE * (settings.band_high_hz - settings.band_low_hz)


def _band(settings: ChainSettings) -> str:
    return f"{settings.band_low_hz / 1e6:.4g} to {settings.band_high_hz / 1e6:.4g} MHz"
