"""A radar recording block by block, reduced to levels that show its health.

Blocks are about a second long; a few numbers are kept for each channel, never the signal. Time traces and the complex
time profiles of stepped-frequency sweeps share the reduction.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Complex, Float, Inexact, Int

from lgprjax.radar.time_domain import WAVE_SPEED_M_PER_NS
from lgprjax.recordings.verdicts import BlockStretches, Findings, HealthFigure, figure, median_of

LATE = 0.1  # share of the record, at its end, taken as noise
_EARLY = 0.25  # the direct wave is the strongest steady signal in this first share of the record
_BURST = 16.0  # power of a scan's noise over the block's median that no Gaussian noise of tens of samples reaches


class RecordingTraits(NamedTuple):
    """Properties of a recording that the reduction needs.

    Attributes:
        samples: number of samples per trace.
        interval_ns: sample interval.
        frequency_hz: centre frequency of the antennas.
        rails: limits of the receiver's values, zero level removed; ``None`` if the stored type has none.
        half_count: half the quantisation step: noise below it cannot be measured.
    """

    samples: int
    interval_ns: float
    frequency_hz: float
    rails: tuple[float, float] | None
    half_count: float

    @property
    def period_samples(self) -> float:
        """Samples of one period of the centre frequency."""
        return 1e9 / self.frequency_hz / self.interval_ns


class BlockRow(NamedTuple):
    """Levels of one block; see ``SignalBlocks``."""

    direct: Complex[np.ndarray, " channel"]
    level: Float[np.ndarray, " channel"]
    noise: Float[np.ndarray, " channel"]
    repeated: Int[np.ndarray, " channel"]
    clipped: Int[np.ndarray, " channel"]
    used: Int[np.ndarray, " channel"]
    invalid: int
    non_finite: int
    bursts: int


class SignalBlocks(NamedTuple):
    """Levels of a recording, one row per block.

    Attributes:
        first: first scan of each block, and the number of scans as the last entry.
        direct: direct wave relative to the array's at the start; 1 without change.
        level: RMS of the steady signal in the direct wave's window, in counts.
        noise: RMS of the late part of the record, from differences of neighbouring scans; NaN where there are none.
        repeated: traces identical to the previous one.
        clipped: traces clipped outside the direct wave's window.
        used: valid traces.
        invalid: number of scans with a channel marked invalid.
        non_finite: number of scans with NaN or infinite samples.
        bursts: scans with far more noise than the block.
        clipped_direct: clipped samples per trace within the direct wave's window.
        variance, noise_variance: variance of the samples about their block's mean, and its noise part.
        noise_spectrum: power of the differences of scans over frequency.
        polarity: correlation of each channel's steady signal with the array's typical one.
        recorded: the recording.
    """

    first: Int[np.ndarray, " edge"]
    direct: Complex[np.ndarray, "block channel"]
    level: Float[np.ndarray, "block channel"]
    noise: Float[np.ndarray, "block channel"]
    repeated: Int[np.ndarray, "block channel"]
    clipped: Int[np.ndarray, "block channel"]
    used: Int[np.ndarray, "block channel"]
    invalid: Int[np.ndarray, " block"]
    non_finite: Int[np.ndarray, " block"]
    bursts: Int[np.ndarray, " block"]
    clipped_direct: float
    variance: Float[np.ndarray, " sample"]
    noise_variance: Float[np.ndarray, " sample"]
    noise_spectrum: Float[np.ndarray, " frequency"]
    polarity: Float[np.ndarray, " channel"]
    recorded: RecordingTraits


def block_edges(scans: int) -> list[int]:
    """First scan of each block, and the number of scans: a second of an array's recording, less in short drives."""
    size = int(np.clip(scans // 16, 16, 128))
    # A remainder of less than half a block joins the last one.
    return [*range(0, max(scans - size // 2, 1), size), scans]


def regular_scans(time_s: Float[np.ndarray, " scan"]) -> Bool[np.ndarray, " scan"]:
    """Scans without a gap in time before them."""
    interval = np.diff(time_s)
    return np.concatenate([[False], interval < 1.5 * np.median(interval)])


class SignalReducer:
    """Reduces blocks of scans, fed in order.

    Args:
        channels: number of channels of the recording.
        recorded: properties of the recording.
    """

    def __init__(self, channels: int, recorded: RecordingTraits) -> None:
        self._recorded = recorded
        self._window: slice | None = None
        self._wave: Inexact[np.ndarray, " early"] = np.zeros(1)
        self._last: np.ndarray | None = None
        self._rows: list[BlockRow] = []
        self._variance, self._noise_variance = np.zeros(recorded.samples), np.zeros(recorded.samples)
        self._pairs = 0
        self._spectrum: np.ndarray | float = 0.0
        self._mean = np.zeros((channels, recorded.samples), np.complex128)
        self._clipped_direct = 0

    def feed(
        self,
        traces: Inexact[np.ndarray, "scan channel sample"],
        valid: Bool[np.ndarray, "scan channel"],
        non_finite: int,
        regular: Bool[np.ndarray, " scan"],
    ) -> None:
        """Take the next block.

        Args:
            traces: zero where not valid.
            valid: traces that hold data.
            non_finite: scans of the block with non-finite samples.
            regular: scans without a gap in time before them.
        """
        total = np.sum(traces, axis=0, dtype=np.complex128 if np.iscomplexobj(traces) else np.float64)
        mean = total / np.maximum(valid.sum(axis=0), 1)[:, None]
        self._mean += total
        self._variance += np.sum(np.where(valid[..., None], np.abs(traces - mean) ** 2, 0.0), axis=(0, 1))
        clips = self._clips(traces) & valid[..., None]
        if self._window is None:
            self._set_reference(mean, clips)
        assert self._window is not None
        direct, level = self._direct(mean)
        self._clipped_direct += int(clips[..., self._window].sum())
        clips[..., self._window] = False
        noise, bursts = self._noise(traces, valid, regular)
        before = traces[:1] if self._last is None else self._last
        same = np.all(traces == np.concatenate([before, traces[:-1]]), axis=2) & valid
        same[0] &= self._last is not None
        self._last = traces[-1:].copy()
        absent = int((~valid).any(axis=1).sum())
        self._rows.append(
            BlockRow(
                direct=direct,
                level=level,
                noise=noise,
                repeated=same.sum(axis=0),
                clipped=clips.any(axis=2).sum(axis=0),
                used=valid.sum(axis=0),
                invalid=max(absent - non_finite, 0),
                non_finite=non_finite,
                bursts=bursts,
            )
        )

    def _clips(self, traces: np.ndarray) -> Bool[np.ndarray, "scan channel sample"]:
        rails = self._recorded.rails
        return (
            np.zeros(traces.shape, bool) if rails is None else np.asarray((traces <= rails[0]) | (traces >= rails[1]))
        )

    def _set_reference(
        self, mean: Inexact[np.ndarray, "channel sample"], clips: Bool[np.ndarray, "scan channel sample"]
    ) -> None:
        """The array's direct wave: one and a quarter periods to each side of its strongest steady signal."""
        array = _typical(mean - mean.mean(axis=1, keepdims=True))
        early = max(8, int(_EARLY * len(array)))
        peak, half = int(np.argmax(np.abs(array[:early]))), max(4, round(1.25 * self._recorded.period_samples))
        self._window = slice(max(peak - half, 0), peak + half + 1)
        wave = array[self._window] - np.mean(array[self._window])
        # Clipped samples carry no information on the gain.
        self._wave = np.where(clips[..., self._window].mean(axis=(0, 1)) > 0.01, 0.0, wave)

    def _direct(
        self, mean: Inexact[np.ndarray, "channel sample"]
    ) -> tuple[Complex[np.ndarray, " channel"], Float[np.ndarray, " channel"]]:
        steady = mean[:, self._window]
        steady = steady - steady.mean(axis=1, keepdims=True)
        energy = float(np.sum(np.abs(self._wave) ** 2))
        direct = steady @ np.conj(self._wave) / (energy or 1.0)
        return direct.astype(np.complex128), np.sqrt(np.mean(np.abs(steady) ** 2, axis=1))

    def _noise(
        self, traces: np.ndarray, valid: Bool[np.ndarray, "scan channel"], regular: Bool[np.ndarray, " scan"]
    ) -> tuple[Float[np.ndarray, " channel"], int]:
        """RMS of the noise of every channel, and the number of scans with a burst.

        Second differences along the track: the ground changes smoothly from scan to scan, noise does not. The remainder
        of the ground makes the figure an upper bound.
        """
        if len(traces) < 3:
            return np.full(valid.shape[1], np.nan), 0
        difference = (traces[2:] - 2.0 * traces[1:-1] + traces[:-2]) / np.sqrt(6.0)
        together = valid[2:] & valid[1:-1] & valid[:-2] & (regular[2:] & regular[1:-1])[:, None]
        difference = np.where(together[..., None], difference, 0.0)
        self._pairs += int(together.sum())
        self._noise_variance += np.sum(np.abs(difference) ** 2, axis=(0, 1))
        quiet = np.mean(np.abs(difference[..., int((1.0 - LATE) * difference.shape[2]) :]) ** 2, axis=2)
        # The median: bursts are counted separately.
        usual = np.array([np.median(p[ok]) if ok.any() else np.nan for p, ok in zip(quiet.T, together.T, strict=True)])
        least = np.maximum(np.nan_to_num(usual), max(self._recorded.half_count**2, 1e-30))
        loud = quiet / (_BURST * least)
        calm = together & (loud <= 1.0)
        transform = np.fft.fft if np.iscomplexobj(difference) else np.fft.rfft
        spectrum = transform(np.where(calm[..., None], difference, 0.0) * np.hanning(difference.shape[2]), axis=2)
        self._spectrum = self._spectrum + np.sum(np.abs(spectrum) ** 2, axis=(0, 1))
        # One noisy scan affects three differences, its own most.
        scan = np.pad(np.where(together, loud, 0.0).max(axis=1), 1)
        peak = (scan[1:-1] > 1.0) & (scan[1:-1] >= scan[:-2]) & (scan[1:-1] >= scan[2:])
        return np.sqrt(usual), int(peak.sum())

    def result(self, first: list[int]) -> SignalBlocks:
        """Levels of all blocks, ``first`` holds the first scans, and the number of scans at its end."""
        columns = {name: np.asarray([getattr(row, name) for row in self._rows]) for name in BlockRow._fields}
        used = max(float(columns["used"].sum()), 1.0)
        early = (self._mean - self._mean.mean(axis=1, keepdims=True))[:, self._window or slice(None)]
        unit = early / np.maximum(np.linalg.norm(early, axis=1, keepdims=True), 1e-30)
        typical = _typical(unit)
        size = max(float(np.linalg.norm(typical)), 1e-30)
        return SignalBlocks(
            first=np.asarray(first),
            **columns,
            clipped_direct=self._clipped_direct / used,
            variance=self._variance / used,
            noise_variance=self._noise_variance / max(self._pairs, 1),
            noise_spectrum=np.atleast_1d(np.asarray(self._spectrum, dtype=np.float64)),
            polarity=np.real(unit @ np.conj(typical)) / size,
            recorded=self._recorded,
        )


def _typical(traces: Inexact[np.ndarray, "channel sample"]) -> Inexact[np.ndarray, " sample"]:
    """Median over the channels, of real and imaginary part separately."""
    middle = np.median(traces.real, axis=0)
    return np.asarray(middle + 1j * np.median(traces.imag, axis=0) if np.iscomplexobj(traces) else middle)


# Figures of a drive's noise: the receiver's own, and interference.

_GROUND_AT_END = "the end of the record has more ground signal than noise"


def noise(blocks: SignalBlocks, place: BlockStretches) -> Findings:
    """Receiver noise: level, where it rises, the noisiest channel, and the depth to which the ground is received."""
    names = ("noise_rise", "noisy_channel", "heard_time")
    level = median_of(blocks.noise.T)
    middle = float(np.nanmedian(level)) if np.isfinite(level).any() else 0.0
    wavelength_m = WAVE_SPEED_M_PER_NS * 1e9 / blocks.recorded.frequency_hz
    if place.step_m > wavelength_m / 8.0 or middle <= 0.0:
        why = f"scans {place.step_m:.2g} m apart change with the ground (spacing above an eighth of a wavelength)"
        why = why if middle > 0.0 else "neighbouring scans do not differ"
        return [], [(name, why) for name in names]
    # Noise and ground in equal parts: twice the noise. Smoothed over a period, as a zero crossing means nothing.
    width = min(max(3, round(blocks.recorded.period_samples)), len(blocks.variance))
    kernel = np.full(width, 1.0 / width)
    above_noise = np.convolve(blocks.variance, kernel, "same") >= 2.0 * np.convolve(
        blocks.noise_variance, kernel, "same"
    )
    figures = [
        figure(
            "heard_time",
            float(np.sum(above_noise)) / blocks.recorded.period_samples,
            "periods",
            (6.0, 2.0),
            "travel time with a ground signal at least as strong as the noise, in periods of the centre frequency",
        )
    ]
    if not _quiet_end(blocks):
        return figures, [(name, _GROUND_AT_END) for name in ("noise_rise", "noisy_channel")]
    own = median_of(blocks.noise)
    channel_db = 20.0 * np.log10(np.maximum(own, 1e-30) / max(float(np.nanmedian(own)), 1e-30))
    rise_db = 20.0 * np.log10(np.maximum(level, 1e-30) / middle)
    figures += [
        figure(
            "noise_rise",
            float(np.nanmax(rise_db)),
            "dB",
            (3.0, 10.0),
            f"highest noise of a block over the drive's median of {middle:.3g} counts RMS (end of the record)",
            place.of(np.nan_to_num(rise_db) >= 3.0),
        ),
        figure(
            "noisy_channel",
            float(np.nanmax(channel_db)),
            "dB",
            (3.0, 6.0),
            "noise of the noisiest channel over the channels' median",
            place.of_channels((blocks.used > 0) & (np.nan_to_num(channel_db) >= 3.0)[None]),
        ),
    ]
    return figures, []


def _quiet_end(blocks: SignalBlocks) -> bool:
    """Whether the record's end holds more noise than ground, so that differences there are the receiver's own."""
    late = slice(int((1.0 - LATE) * len(blocks.variance)), None)
    return bool(np.mean(blocks.variance[late]) < 2.0 * np.mean(blocks.noise_variance[late]))


def interference(blocks: SignalBlocks, place: BlockStretches) -> Findings:
    """Interference: scans in which the noise jumps, and narrow lines of its spectrum."""
    scans = np.diff(blocks.first)
    power = blocks.noise_spectrum
    figures: list[HealthFigure] = []
    missing: list[tuple[str, str]] = []
    if _quiet_end(blocks):
        figures.append(
            figure(
                "bursts",
                100.0 * float(blocks.bursts.sum() / scans.sum()),
                "%",
                (1.0, 5.0),
                "scans with a channel whose noise is 12 dB above its block's median",
                place.of(blocks.bursts >= np.maximum(2.0, 0.01 * scans)),
            )
        )
    else:
        missing.append(("bursts", _GROUND_AT_END))
    if len(power) < 16 or not np.all(np.isfinite(power)) or power.max() <= 0.0:
        return figures, [*missing, ("interference_line", "too few frequencies, or no noise")]
    figures.append(
        figure(
            "interference_line",
            line_db(power),
            "dB",
            (10.0, 20.0),
            "strongest narrow line of the noise spectrum over the median of its neighbours",
        )
    )
    return figures, missing


def line_db(power: Float[np.ndarray, " frequency"]) -> float:
    """Level of the strongest narrow line above the median of the eight neighbouring bins."""
    away = np.concatenate([np.arange(-6, -2), np.arange(3, 7)])
    index = np.clip(np.arange(len(power))[:, None] + away[None], 0, len(power) - 1)
    floor = np.maximum(np.median(power[index], axis=1), 1e-6 * power.max())
    return float(10.0 * np.log10(np.max(power / floor)))
