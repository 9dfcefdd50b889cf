"""Figures of a drive's noise: the receiver's own, and what others transmit."""

import numpy as np
from jaxtyping import Float

from lgprjax.archive.signal_blocks import LATE, SignalBlocks
from lgprjax.archive.verdicts import Findings, HealthFigure, Places, figure, median_of
from lgprjax.radar.time_domain import WAVE_SPEED_M_PER_NS

_GROUND_AT_END = "the end of the record holds more ground than noise"


def noise(blocks: SignalBlocks, place: Places) -> Findings:
    """How much the receiver adds, where it rises, which channel adds most, and how deep the ground is heard."""
    names = ("noise_rise", "noisy_channel", "heard_time")
    level = median_of(blocks.noise.T)
    middle = float(np.nanmedian(level)) if np.isfinite(level).any() else 0.0
    wavelength_m = WAVE_SPEED_M_PER_NS * 1e9 / blocks.recorded.frequency_hz
    if place.step_m > wavelength_m / 8.0 or middle <= 0.0:
        why = f"scans {place.step_m:.2g} m apart change with the ground (more than an eighth of a wavelength)"
        why = why if middle > 0.0 else "neighbouring scans do not differ"
        return [], [(name, why) for name in names]
    # Noise and ground in equal parts: twice the noise. Smoothed over a period, as one zero crossing says nothing.
    width = min(max(3, round(blocks.recorded.period_samples)), len(blocks.variance))
    kernel = np.full(width, 1.0 / width)
    heard = np.convolve(blocks.variance, kernel, "same") >= 2.0 * np.convolve(blocks.noise_variance, kernel, "same")
    figures = [
        figure(
            "heard_time",
            float(np.sum(heard)) / blocks.recorded.period_samples,
            "periods",
            (6.0, 2.0),
            "travel time over which what changes along the track is at least as strong as the noise, in periods of the "
            "centre frequency",
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
    """The record's end holds more noise than ground, so that differences there are the receiver's own."""
    late = slice(int((1.0 - LATE) * len(blocks.variance)), None)
    return bool(np.mean(blocks.variance[late]) < 2.0 * np.mean(blocks.noise_variance[late]))


def interference(blocks: SignalBlocks, place: Places) -> Findings:
    """What others transmit: scans in which the noise jumps, and narrow lines of its spectrum."""
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
    """How far the strongest narrow line stands above the median of the eight bins beside it."""
    away = np.concatenate([np.arange(-6, -2), np.arange(3, 7)])
    index = np.clip(np.arange(len(power))[:, None] + away[None], 0, len(power) - 1)
    floor = np.maximum(np.median(power[index], axis=1), 1e-6 * power.max())
    return float(10.0 * np.log10(np.max(power / floor)))
