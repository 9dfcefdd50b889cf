"""Traces at another, coarser sample interval, without aliases: a windowed sinc evaluated where samples are wanted."""

import numpy as np
from jaxtyping import Float

# Half the filter's length in output samples, and the Kaiser window of 80 dB. Its transition is 0.21 of the output
# rate wide: it passes up to 0.29 of the output rate unchanged and stops at the output's Nyquist frequency.
_HALF_SAMPLES = 12
_BETA = 7.857
_CUTOFF = 0.395
PASSBAND = 0.29
_BLOCK_SAMPLES = 256


def resample(
    traces: Float[np.ndarray, "trace sample"], interval: float, new_interval: float
) -> Float[np.ndarray, "trace new_sample"]:
    """Traces at ``new_interval``, which is at least ``interval``, from the same first sample on; unchanged if equal.

    Frequencies up to 0.29 of the new rate keep amplitude and phase, those above its Nyquist frequency are 80 dB
    down. Before its first sample a trace is taken for zero, after its last one for the last value.

    Raises:
        ValueError: the new interval is finer than the old.
    """
    if new_interval < interval * (1 - 1e-9):
        raise ValueError("resampling to a finer interval")
    ratio = new_interval / interval
    if ratio <= 1 + 1e-9:
        return traces
    half = int(np.ceil(_HALF_SAMPLES * ratio))
    count = int(np.floor((traces.shape[1] - 1) / ratio + 1e-9)) + 1
    padded = np.concatenate([np.zeros((len(traces), half)), traces, np.repeat(traces[:, -1:], half, axis=1)], axis=1)
    blocks = []
    for start in range(0, count, _BLOCK_SAMPLES):
        at = np.arange(start, min(start + _BLOCK_SAMPLES, count)) * ratio + half
        low, high = int(np.floor(at[0])) - half, min(int(np.ceil(at[-1])) + half + 1, padded.shape[1])
        away = (np.arange(max(low, 0), high)[None, :] - at[:, None]) / ratio
        window = np.i0(_BETA * np.sqrt(np.clip(1 - (away / _HALF_SAMPLES) ** 2, 0, None))) / np.i0(_BETA)
        kernel = np.where(np.abs(away) <= _HALF_SAMPLES, np.sinc(2 * _CUTOFF * away) * window, 0.0)
        blocks.append(padded[:, max(low, 0) : high] @ (kernel / kernel.sum(axis=1, keepdims=True)).T)
    return np.concatenate(blocks, axis=1)


def share_above(traces: Float[np.ndarray, "trace sample"], interval: float, frequency: float) -> float:
    """Share of the traces' energy above a frequency (in one over the interval's unit), without their mean."""
    spectrum = np.abs(np.fft.rfft(traces - traces.mean(axis=1, keepdims=True), axis=1)) ** 2
    frequencies = np.fft.rfftfreq(traces.shape[1], interval)
    total = float(spectrum.sum())
    return float(spectrum[:, frequencies > frequency].sum()) / total if total > 0 else 0.0
