"""Scans as a radar sends them: its description, and its frames as numbers that a matrix turns into profiles.

A radar of finished traces describes itself with ``radar_description`` and sends ``radar_scan``. A stepped-frequency
radar describes itself with ``radar_sweep_description`` and ``radar_lookup`` and sends ``radar_sweep``; the calibration
channel is divided out and the look-up subtracted here, by the same function as in a drive log.
"""

from functools import cache
from typing import NamedTuple, Protocol

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Complex, Float

from lgprjax.errors import InputError
from lgprjax.formats import SweepLayout, SweepRecording, complex_rows
from lgprjax.radar import (
    ChainSettings,
    ChannelResponse,
    LookUp,
    calibrate_sweeps,
    find_dead_channels,
    stacked,
    stretched_operator,
    sweep_operator,
    trace_operators,
)
from lgprjax.registration import Operators
from lgprjax.wire import Frame

SCAN_MESSAGES = ("radar_scan", "radar_sweep")
"""Messages with a scan."""
HEAD_SCANS = 64
"""Scans by which dead channels are found, as in a drive log."""
_BAND_SHARE = 0.5
"""Sweeps that cover less than this share of a map's band are refused."""

Recorded = tuple[Float[np.ndarray, "scan channel recorded"], Bool[np.ndarray, "scan channel"]]


class RadarDescription(NamedTuple):
    """Scans of finished traces; times in ns, the period in s."""

    channels: int
    samples: int
    sample_interval_ns: float
    time_zero_ns: float
    zero_level: float
    scan_period_s: float

    @property
    def kind(self) -> str:
        """Kind of recording in a map's provenance."""
        return "traces"

    @property
    def recorded(self) -> int:
        """Numbers of a channel that its matrix takes."""
        return self.samples


class SweepDescription(NamedTuple):
    """Scans of stepped-frequency sweeps; frequencies in Hz, the period in s.

    Attributes:
        channels, steps: number of channels, without the calibration channel, and of frequency steps.
        first_hz, step_hz: first frequency and step.
        group_delay_ns: group delay of the calibration channel's path.
        scan_period_s: period of the scans.
    """

    channels: int
    steps: int
    first_hz: float
    step_hz: float
    group_delay_ns: float
    scan_period_s: float

    @property
    def kind(self) -> str:
        """Kind of recording in a map's provenance."""
        return "sweeps"

    @property
    def recorded(self) -> int:
        """Number of inputs of a channel's matrix: real parts, then imaginary parts."""
        return 2 * self.steps

    @property
    def frequencies_hz(self) -> Float[np.ndarray, " frequency"]:
        """Frequency of each step, Hz."""
        return self.first_hz + self.step_hz * np.arange(self.steps)

    @property
    def layout(self) -> SweepLayout:
        """Layout of the sweeps, for comparison with a calibration."""
        return SweepLayout(self.channels, self.frequencies_hz, self.group_delay_ns)


AnyDescription = RadarDescription | SweepDescription


class LookUpSweeps(NamedTuple):
    """Sweeps of the array in empty space, with their calibration sweep."""

    sweeps: Complex[np.ndarray, "channel frequency"]
    calibration: Complex[np.ndarray, " frequency"]


class RadarSelf:
    """Self-description of a radar, message by message.

    Args:
        calibrated: whether a calibration file replaces the look-up of a stepped-frequency radar.

    Attributes:
        description: received description; ``None`` before.
        lookup: look-up of a stepped-frequency radar, unless it is replaced.
    """

    def __init__(self, *, calibrated: bool = False) -> None:
        self._calibrated = calibrated
        self.description: AnyDescription | None = None
        self.lookup: LookUpSweeps | None = None

    @property
    def complete(self) -> bool:
        """Whether its scans can be read."""
        described = self.description
        return described is not None and (self._calibrated or described.kind == "traces" or self.lookup is not None)

    def take(self, frame: Frame) -> None:
        """Take a frame of its line.

        Raises:
            ValueError: the frame describes other scans than before, for which the compiled programs are wrong.
        """
        found: AnyDescription | None = None
        if frame.name == "radar_description":
            found = description_of(frame)
        elif frame.name == "radar_sweep_description":
            found = SweepDescription(
                int(frame.number("channels")),
                int(frame.number("steps")),
                1e3 * frame.number("first_khz"),
                1e3 * frame.number("step_khz"),
                frame.number("group_delay_ps") / 1e3,
                frame.number("scan_period_us") / 1e6,
            )
        elif frame.name == "radar_lookup" and not self._calibrated:
            rows = complex_rows(frame)
            lookup = LookUpSweeps(rows[:-1], rows[-1])
            if self.lookup is not None and not np.array_equal(self.lookup.sweeps, lookup.sweeps):
                raise ValueError("the radar's look-up changed")
            self.lookup = lookup
        if found is not None:
            if self.description is not None and found != self.description:
                raise ValueError(f"the radar's description changed: {found}")
            self.description = found


def description_of(frame: Frame) -> RadarDescription:
    """Read a radar_description."""
    return RadarDescription(
        int(frame.number("channels")),
        int(frame.number("samples")),
        frame.number("sample_interval_ps") / 1e3,
        frame.number("time_zero_ps") / 1e3,
        frame.number("zero_level"),
        frame.number("scan_period_us") / 1e6,
    )


class ScanReader(Protocol):
    """Frames of a radar to the numbers that its matrix takes."""

    def read(self, frames: list[Frame]) -> Recorded:
        """Scans, and which channels of each hold data."""

    def operators(self, settings: ChainSettings, kept: int, height_m: float) -> Operators:
        """The matrices from these numbers to a map's profiles, by time scale."""


class TraceReader:
    """Finished traces of one byte a sample."""

    def __init__(self, radar: RadarDescription) -> None:
        self._radar = radar

    def read(self, frames: list[Frame]) -> Recorded:
        """Traces, and which channels of each hold data."""
        shape = (self._radar.channels, self._radar.samples)
        traces = np.zeros((len(frames), *shape), np.float32)
        valid = np.zeros((len(frames), self._radar.channels), bool)
        for number, frame in enumerate(frames):
            data = frame.fields["data"]
            assert isinstance(data, bytes)
            # A scan of another size is none: its channels stay invalid.
            if (int(frame.number("channels")), int(frame.number("samples"))) == shape:
                traces[number] = np.frombuffer(data, np.uint8).reshape(shape) - np.float32(self._radar.zero_level)
                valid[number] = _valid_of(frame, self._radar.channels)
        return traces, valid

    def operators(self, settings: ChainSettings, kept: int, height_m: float) -> Operators:
        """The matrices of its traces."""
        radar = self._radar
        return trace_operators(
            radar.samples, radar.sample_interval_ns, radar.time_zero_ns, settings, kept, height_m=height_m
        )


class SweepReader:
    """Stepped-frequency sweeps: divided by the calibration channel, look-up subtracted, channels equalised.

    Args:
        radar: description of the radar.
        known: look-up, and gain and delay of each channel.
        block: largest number of scans read at once; a compiled shape.
        place: path or address, for messages.

    Raises:
        InputError: the look-up's calibration sweep has zeros, or has other sizes than the scans.
    """

    def __init__(self, radar: SweepDescription, known: SweepRecording, block: int, place: str) -> None:
        self._radar, self._block, self._place = radar, block, place
        expected = (radar.channels, radar.steps)
        sweeps, calibration = known.lookup_sweeps, known.lookup_calibration_sweep
        if sweeps.shape != expected:
            raise InputError(place, "radar_lookup", f"{expected} channels and steps", str(sweeps.shape))
        if not np.all(calibration):
            zeros = f"{np.count_nonzero(calibration == 0)} zeros"
            raise InputError(place, "radar_lookup", "a calibration sweep with non-zero values", zeros)
        self._lookup = LookUp(jnp.asarray(sweeps), jnp.asarray(calibration))
        self._response = ChannelResponse(*(jnp.asarray(part, jnp.float32) for part in known.response))
        self._frequencies = jnp.asarray(radar.frequencies_hz, jnp.float32)
        self._head: list[Complex[np.ndarray, "row frequency"]] = []
        self._calibrated = np.ones(radar.channels, bool) if known.channel_valid is None else known.channel_valid
        self._alive = self._calibrated

    def read(self, frames: list[Frame]) -> Recorded:
        """Calibrated sweeps, stacked, and which channels of each hold data; dead channels are invalid."""
        shape = (self._radar.channels + 1, self._radar.steps)
        scans = np.zeros((self._block, *shape), np.complex64)
        stated = np.zeros((len(frames), self._radar.channels), bool)
        for number, frame in enumerate(frames):
            # A scan of another size, or of numbers of another, is none: its channels stay invalid.
            rows = _rows_of(frame)
            if rows is not None and rows.shape == shape:
                scans[number], stated[number] = rows, _valid_of(frame, self._radar.channels)
                self._look_for_dead(rows)
        ground, usable = calibrate_sweeps(
            jnp.asarray(scans[:, :-1]), jnp.asarray(scans[:, -1]), self._lookup, self._response, self._frequencies
        )
        kept = slice(0, len(frames))
        return np.asarray(stacked(ground))[kept], stated & np.asarray(usable)[kept] & self._alive

    def operators(self, settings: ChainSettings, kept: int, height_m: float) -> Operators:
        """Matrices of the sweeps.

        Raises:
            InputError: the sweeps miss most of the map's band.
        """
        frequencies_hz, delay_ns = self._radar.frequencies_hz, self._radar.group_delay_ns
        low_hz, high_hz = settings.band_low_hz, settings.band_high_hz
        within = (frequencies_hz > low_hz) & (frequencies_hz < high_hz)
        if np.count_nonzero(within) * self._radar.step_hz < _BAND_SHARE * (high_hz - low_hz):
            expected = f"half of the map's band, {low_hz / 1e6:.4g} to {high_hz / 1e6:.4g} MHz, or more"
            found = f"{frequencies_hz[0] / 1e6:.4g} to {frequencies_hz[-1] / 1e6:.4g} MHz"
            raise InputError(self._place, "radar_sweep_description", expected, found)

        def profiles(samples: int) -> Float[Array, "recorded sample"]:
            return sweep_operator(frequencies_hz, settings, group_delay_ns=delay_ns, kept=samples)

        @cache
        def operator(time_scale: float) -> Float[Array, "recorded sample"]:
            return stretched_operator(profiles, kept, settings.sample_interval_ns, scale=time_scale, height_m=height_m)

        return operator

    def _look_for_dead(self, rows: Complex[np.ndarray, "row frequency"]) -> None:
        """Detect dead channels once, by the first scans."""
        if len(self._head) == HEAD_SCANS:
            return
        self._head.append(rows)
        if len(self._head) == HEAD_SCANS:
            head = np.stack(self._head)
            self._alive = self._calibrated & ~find_dead_channels(head[:, :-1], head[:, -1])


def _rows_of(frame: Frame) -> Complex[np.ndarray, "row frequency"] | None:
    """The sweeps of a radar_sweep; ``None`` for an unknown number format."""
    try:
        return complex_rows(frame)
    except ValueError:
        return None


def _valid_of(frame: Frame, channels: int) -> Bool[np.ndarray, " channel"]:
    return (int(frame.number("valid")) >> np.arange(channels) & 1).astype(bool)
