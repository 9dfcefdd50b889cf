"""A radargram and light processing for display: NumPy only, for pictures, never for a fix.

The steps carry the names that users of GPR software know: dewow, background removal, gain over travel time.
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

_DEWOW_PERIODS = 1.5
_LEVEL_PERIODS = 3.0
_MOST_GAIN = 1e3
_ABOVE_NOISE = 3.0
"""The gain stops growing here: noise amplified to the level of the ground would hide where the ground ends."""
_LEAST_CYCLES = 4
"""Least number of cycles in the whole time window; slower signals are wow, at any power."""


@dataclass(frozen=True, kw_only=True)
class Radargram:
    """One channel of a line, its traces evenly spaced.

    Attributes:
        name: name for titles.
        amplitude: amplitudes, zero for no signal, NaN without a trace.
        along: position of each trace, metres along the line or, in recordings without positions, its number.
        in_metres: whether ``along`` is in metres.
        time_ns: two-way travel time of each sample, evenly spaced; 0 is time zero, samples before it are negative.
        centre_frequency_hz: nominal centre frequency; ``None`` if unknown.
        steps: descriptions of the processing steps applied to the amplitudes, in order.
    """

    name: str
    amplitude: Float[np.ndarray, "trace sample"]
    along: Float[np.ndarray, " trace"]
    in_metres: bool
    time_ns: Float[np.ndarray, " sample"]
    centre_frequency_hz: float | None = None
    steps: tuple[str, ...] = ()


def clear_view(radargram: Radargram) -> Radargram:
    """The radargram dewowed, without its mean trace and with a gain that only grows with travel time.

    Dewow subtracts the running mean over 1.5 periods, the background is the mean trace over the whole line, and the
    gain brings the RMS of each travel time to one level. A reflector that is stronger than all above it stays so: the
    gain follows the strongest later signal. It stops at 60 dB, or where the traces are three times as strong as their
    noise, which is estimated from the differences of neighbours.
    """
    if len(radargram.time_ns) < 2:
        return radargram
    interval_ns = float(radargram.time_ns[1] - radargram.time_ns[0])
    stated_hz = radargram.centre_frequency_hz
    frequency_hz = _loudest_hz(radargram.amplitude, interval_ns) if stated_hz is None else stated_hz
    period = 1e9 / frequency_hz / interval_ns
    traces = radargram.amplitude.astype(np.float64)
    traces = traces - _running_mean(traces, max(1, round(_DEWOW_PERIODS * period / 2.0)))
    held = np.isfinite(traces)
    count = held.sum(axis=0)
    traces = traces - np.where(held, traces, 0.0).sum(axis=0) / np.maximum(count, 1)
    power = np.where(held, traces**2, 0.0).sum(axis=0) / np.maximum(count, 1)
    differ = np.diff(traces, axis=0)
    pairs = np.isfinite(differ)
    noise = np.where(pairs, differ**2, 0.0).sum(axis=0) / np.maximum(2 * pairs.sum(axis=0), 1)
    gain = _rising_gain(power, noise, max(1, round(_LEVEL_PERIODS * period / 2.0)))
    dewow = f"dewow ({_DEWOW_PERIODS * 1e9 / frequency_hz:.3g} ns{'' if stated_hz else ', frequency estimated'})"
    most_db = round(20.0 * np.log10(gain[-1]))
    levelled = f"gain by the RMS of each travel time, up to {most_db} dB" if most_db else "no gain needed"
    return replace(
        radargram,
        amplitude=(traces * gain).astype(np.float32),
        steps=(*radargram.steps, dewow, "mean trace of the line removed", levelled),
    )


def _running_mean(values: Float[np.ndarray, "*row sample"], half: int) -> Float[np.ndarray, "*row sample"]:
    """Running mean over ``2 half + 1`` samples, fewer at the ends."""
    samples = values.shape[-1]
    total = np.concatenate([np.zeros_like(values[..., :1]), np.cumsum(values, axis=-1)], axis=-1)
    first = np.maximum(np.arange(samples) - half, 0)
    last = np.minimum(np.arange(samples) + half + 1, samples)
    return np.asarray((total[..., last] - total[..., first]) / (last - first))


def _rising_gain(
    power: Float[np.ndarray, " sample"], noise: Float[np.ndarray, " sample"], half: int
) -> Float[np.ndarray, " sample"]:
    level = np.sqrt(_running_mean(power, half))
    to_come = np.maximum.accumulate(level[::-1])[::-1]
    loudest = to_come[0]
    if not loudest > 0.0:
        return np.ones(len(power))
    # Before the first arrival a receiver may be quieter than at any later time.
    quietest = np.sqrt(_running_mean(noise, half)[int(np.argmax(level)) :].min())
    floor = min(max(_ABOVE_NOISE * quietest, loudest / _MOST_GAIN), loudest)
    return np.asarray(loudest / np.maximum(to_come, floor))


def _loudest_hz(amplitude: Float[np.ndarray, "trace sample"], interval_ns: float) -> float:
    """Frequency of most power in the signal that changes along the line."""
    finite = amplitude[np.isfinite(amplitude).all(axis=1)].astype(np.float64)
    samples = amplitude.shape[1]
    frequencies_hz = np.fft.rfftfreq(samples, interval_ns * 1e-9)
    slowest = min(_LEAST_CYCLES, len(frequencies_hz) - 1)
    if not len(finite):
        return float(frequencies_hz[slowest])
    changing = finite - finite.mean(axis=0) if len(finite) > 1 else finite
    power = np.mean(np.abs(np.fft.rfft(changing * np.hanning(samples), axis=1)) ** 2, axis=0)
    return float(frequencies_hz[slowest + int(np.argmax(power[slowest:]))])
