"""Recordings of a made-up stepped-frequency array, with numpy alone: channels of known gain and delay, direct coupling
that differs from channel to channel, a receiver that warms up, noise and a converter of 16 bits.
"""

import struct
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from formats.run_log_sample import head_bytes, own_bytes, record_bytes
from recordings.run_sample import MONO_NS, frame, record

LIGHT_M_PER_NS = 0.299792458
_COUNTS = 32767


@dataclass(frozen=True)
class StandingArray:
    """An array drawn from a seed. Levels are relative to the direct coupling.

    Attributes:
        channels, low_mhz, high_mhz, steps: of its sweeps.
        gain_spread: sigma of the logarithm of the channels' gains; delay_spread: sigma of delays, in periods of the
            centre frequency.
        drift, turn_rad: change of the receiver's gain and phase over a recording.
        own_drift: sigma of what the calibration channel does not see of it, channel by channel.
        shape: RMS of each channel's own ripple over frequency, about gain and delay.
        noise: RMS of an entry. full_scale: of the converter.
    """

    seed: int
    channels: int = 11
    low_mhz: float = 100.0
    high_mhz: float = 400.0
    steps: int = 61
    gain_spread: float = 0.25
    delay_spread: float = 0.1
    drift: float = 0.05
    turn_rad: float = 0.15
    own_drift: float = 0.002
    shape: float = 0.02
    noise: float = 4e-3
    full_scale: float = 16.0
    cable_ns: float = 6.25
    hz: np.ndarray = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "hz", np.linspace(1e6 * self.low_mhz, 1e6 * self.high_mhz, self.steps))

    @property
    def period_ns(self) -> float:
        return 2e3 / (self.low_mhz + self.high_mhz)

    def late(self, delay_ns: float | np.ndarray) -> np.ndarray:
        return np.asarray(np.exp(-2e-9j * np.pi * np.multiply.outer(delay_ns, self.hz)))

    def _drawn(self, number: int) -> np.random.Generator:
        return np.random.default_rng([self.seed, number])

    @property
    def gain(self) -> np.ndarray:
        return np.asarray(np.exp(self.gain_spread * self._drawn(1).normal(size=self.channels)))

    @property
    def delay_ns(self) -> np.ndarray:
        return np.asarray(self.delay_spread * self.period_ns * self._drawn(2).normal(size=self.channels))

    @property
    def coupling(self) -> np.ndarray:
        level = np.array([1.0, -0.5, 0.2]) * (1.0 + 0.3 * self._drawn(3).normal(size=(self.channels, 3)))
        return np.asarray(level @ self.late(self.period_ns * np.array([0.2, 1.1, 2.6])))

    def _ripple(self, number: int) -> np.ndarray:
        rng, place = self._drawn(number), np.linspace(0.0, 2.0 * np.pi, self.steps)
        waves = (np.cos(np.outer(rng.uniform(1, 4, 3), place) + rng.uniform(0, 6.28, (3, 1))) for _ in range(2))
        return np.asarray(np.exp(sum(part.sum(axis=0) * unit for part, unit in zip(waves, (0.1, 0.1j), strict=True))))

    @property
    def own(self) -> np.ndarray:
        """What each channel does to an echo: gain, delay and ripple; the ripple has neither of them left in it."""
        rng, place = self._drawn(6), np.linspace(0.0, 2.0 * np.pi, self.steps)
        phase = rng.uniform(0.0, 6.28, (2, self.channels, 1))
        waves = [np.cos(turns * place + part) for turns, part in zip((3.0, 4.0), phase, strict=True)]
        return np.asarray(
            self.gain[:, None] * self.late(self.delay_ns) * np.exp(self.shape * (waves[0] + 1j * waves[1]))
        )

    def plate(self, distance_m: float, level: float = 1.5) -> np.ndarray:
        """Echo of a metal plate under the array."""
        return np.asarray(-level * np.tile(self.late(2.0 * distance_m / LIGHT_M_PER_NS), (self.channels, 1)))

    def record(self, echo: np.ndarray | float, scans: int, day: int) -> np.ndarray:
        """Counts of the converter [scan, row, step, part]: all channels, then the calibration channel.

        Args:
            echo: of each channel [channel, step] or of each scan and channel; 0 in empty space.
            scans: number of scans.
            day: draws noise, and the state of the receiver at the beginning.
        """
        rng, course = self._drawn(100 + day), np.linspace(0.0, 1.0, scans)
        state = (0.7 + 0.5 * rng.uniform()) * np.exp(2j * np.pi * rng.uniform())
        warm = state * (1.0 + self.drift * course) * np.exp(1j * self.turn_rad * np.sqrt(course))
        common = self._ripple(4) * self.late(11.0 * self.period_ns)
        heard = np.empty((scans, self.channels + 1, self.steps), np.complex128)
        drift = 1.0 + self.own_drift * rng.normal(size=self.channels) * course[:, None]
        heard[:, :-1] = self.own * (self.coupling + echo) * drift[..., None]
        heard[:, -1] = 2.0 * self._ripple(5) * self.late(self.cable_ns)
        rows = heard * common * warm[:, None, None]
        rows = rows + self.noise * np.sqrt(0.5) * (rng.normal(size=rows.shape) + 1j * rng.normal(size=rows.shape))
        parts = np.stack([rows.real, rows.imag], axis=-1) / self.scale
        return np.asarray(np.clip(np.round(parts), -_COUNTS - 1, _COUNTS).astype("<i2"))

    @property
    def scale(self) -> float:
        """Of a count."""
        return self.full_scale / _COUNTS

    def write_run(self, folder: Path, counts: np.ndarray, *, valid: int | None = None, described: bool = True) -> Path:
        """A run in mode record of a radar that has no look-up of its own."""
        folder.mkdir()
        step_khz = 1e-3 * float(self.hz[1] - self.hz[0])
        told = struct.pack(
            "<HHIIiI",
            *(counts.shape[1] - 1, self.steps, round(1e3 * self.low_mhz), round(step_khz)),
            *(round(1e3 * self.cable_ns), 7937),
        )
        bits = (1 << (counts.shape[1] - 1)) - 1 if valid is None else valid
        sent = [frame(0x16, told, session=9, sequence=0, stamp_us=1)] if described else []
        for number, rows in enumerate(counts):
            head = struct.pack("<IHHHIf", number, rows.shape[0], rows.shape[1], 4, bits, self.scale)
            stamp_us = 1_000_000 + 7937 * number
            sent.append(frame(0x15, head + rows.tobytes(), session=9, sequence=number + 1, stamp_us=stamp_us))
        parts = [head_bytes(0, 0, mono_ns=MONO_NS), own_bytes(0, dropped={"registration_log": 0})]
        for number, raw in enumerate(sent):
            parts.append(record_bytes(number + 1, record(2, 4, MONO_NS + 7_937_000 * number, raw).data))
        parts.append(own_bytes(len(sent) + 1, end="ended"))
        (folder / "0000.lgprun").write_bytes(b"".join(parts))
        return folder

    def numbers(self, counts: np.ndarray) -> np.ndarray:
        """Sweeps [scan, row, step] that counts stand for."""
        return np.asarray((counts[..., 0] + 1j * counts[..., 1].astype(np.float64)) * self.scale, np.complex64)
