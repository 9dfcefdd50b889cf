"""Properties estimated from the traces of survey lines: time and sign of the direct wave, and direction.

Headers of lines are filled in by hand or by default: time zeros are left at zero, antennas get turned around, every
second line is walked back. The traces have the information: the direct wave arrives first, and neighbouring lines
cross much the same ground.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int, Num
from scipy.ndimage import uniform_filter1d

_ONSET = 0.05
"""Share of the direct wave's amplitude that defines its first break: above the ringing of band-limited receivers."""
_QUIET_SAMPLES = 3
"""Samples needed before the first break to detect it: with fewer the record began too late."""
_BAND = (0.3, 2.0)
"""Band of an antenna's echoes, relative to the centre frequency."""
_BACKGROUND_M = 8.0
_PERIODS = (1.5, 20.0)
"""After the first break, in periods: the part that is neither direct wave nor noise, used to compare neighbours."""
_LEAST = 16
"""Least traces and samples of a line to be compared."""
_LARGEST_LAG_M = 4.0
"""Largest error of a line's start, which is set by a tape, a rope or a mark."""


class DirectWave(NamedTuple):
    """The direct wave of a line, in samples from the first.

    Attributes:
        first_break: beginning of the wave; NaN if the record begins later.
        strongest: middle of its strongest lobe, of either sign.
        sign: sign of its first lobe: +1 or -1; 0 if it is not detected.
    """

    first_break: float
    strongest: float
    sign: int


class Neighbours(NamedTuple):
    """Alignment of a line with its neighbour.

    Attributes:
        correlation: correlation of the two at the best lag, signed, -1 to 1.
        reversed: whether the line ran in the opposite direction.
        lag_m: offset to add to its distances, in its neighbour's direction.
        certainty: margin of the best correlation over the other direction's, in standard deviations over all other
            lags.
        sign_certainty: margin over the other sign, in the same unit.
    """

    correlation: float
    reversed: bool
    lag_m: float
    certainty: float
    sign_certainty: float


def pick_direct_wave(
    traces: Num[np.ndarray, "trace sample"], sample_interval_ns: float, centre_frequency_hz: float | None
) -> DirectWave:
    """The direct wave of a line's median trace; clipping does not shift it.

    Args:
        traces: signed traces, with zero for no signal.
        sample_interval_ns: sample interval.
        centre_frequency_hz: centre frequency of the antennas; a twentieth of the Nyquist frequency if unknown.
    """
    median = np.median(traces, axis=0)
    frequency_hz = centre_frequency_hz or 0.05 * 0.5e9 / sample_interval_ns
    # Values before the break are receiver noise: the trace's zero level is its most frequent sample.
    level = np.median(median)
    strength = np.abs(median - level)
    peak = strength.max()
    if not peak > 0.0:
        return DirectWave(np.nan, np.nan, 0)
    above = np.flatnonzero(strength > _ONSET * peak)
    first = int(above[0])
    period = max(2, round(1e9 / (frequency_hz * sample_interval_ns)))
    window = strength[first : first + 2 * period]
    # A clipped lobe is flat: use its middle.
    loud = first + np.flatnonzero(window >= 0.999 * window.max())
    sign_here = np.sign(median[loud[0]] - level)
    lobe = [loud[0]]
    for sample in loud[1:]:
        if sample != lobe[-1] + 1 or np.sign(median[sample] - level) != sign_here:
            break
        lobe.append(sample)
    strongest = float(np.mean(lobe))
    if first < _QUIET_SAMPLES:
        return DirectWave(np.nan, strongest, 0)
    before, after = strength[first - 1], strength[first]
    first_break = first - 1 + (_ONSET * peak - before) / (after - before)
    return DirectWave(float(first_break), strongest, int(np.sign(median[first] - level)))


def echo_image(
    traces: Num[np.ndarray, "trace sample"],
    first_sample: float,
    sample_interval_ns: float,
    centre_frequency_hz: float | None,
    step_m: float,
) -> Float[np.ndarray, "trace row"]:
    """A line's echoes for comparison with a neighbour: band-passed, background removed, levels over depth equalised.

    Args:
        traces: traces, evenly ``step_m`` apart.
        first_sample: sample of the direct wave's first break.
        sample_interval_ns, centre_frequency_hz: see ``pick_direct_wave``.
        step_m: distance between traces.
    """
    from scipy.signal import butter, sosfiltfilt  # half a second, which only imports of lines need to wait for

    nyquist_hz = 0.5e9 / sample_interval_ns
    frequency_hz = centre_frequency_hz or 0.05 * nyquist_hz
    band = [share * frequency_hz for share in _BAND]
    band[1] = min(band[1], 0.9 * nyquist_hz)
    sections = butter(2, band, "bandpass", fs=2.0 * nyquist_hz, output="sos")
    period = 1e9 / (frequency_hz * sample_interval_ns)
    low, high = (int(first_sample + periods * period) for periods in _PERIODS)
    samples = traces.shape[1]
    low, high = min(low, samples // 2), min(high, samples)
    row_step = max(1, int(period / (2.5 * _BAND[1])))
    if min(traces.shape[0], high - low) < _LEAST:
        return np.zeros((len(traces), 1))
    echoes = sosfiltfilt(sections, traces.astype(np.float64), axis=1)[:, low:high:row_step]
    echoes -= uniform_filter1d(echoes, max(3, round(_BACKGROUND_M / step_m)), axis=0)
    level = np.sqrt(np.mean(echoes**2, axis=0))
    return np.asarray(echoes / np.where(level > 0.0, level, 1.0))


def compare_neighbours(
    line: Float[np.ndarray, "trace row"],
    neighbour: Float[np.ndarray, "neighbour_trace neighbour_row"],
    step_m: float,
    directions: Sequence[bool] = (False, True),
) -> Neighbours:
    """Direction, sign and start of a line relative to its neighbour.

    Args:
        line, neighbour: images from ``echo_image``.
        step_m: distance between traces.
        directions: directions to try, ``True`` for the opposite one.
    """
    rows = min(line.shape[1], neighbour.shape[1])
    line, neighbour = line[:, :rows], neighbour[:, :rows]
    reach = max(1, min(round(_LARGEST_LAG_M / step_m), min(len(line), len(neighbour)) // 4))
    found = {backwards: _lagged(line[::-1] if backwards else line, neighbour) for backwards in directions}
    near = {backwards: correlation[np.abs(lags) <= reach] for backwards, (lags, correlation) in found.items()}
    best = max(near, key=lambda backwards: float(np.abs(near[backwards]).max()))
    scatter = float(np.sqrt(np.mean([np.mean(correlation**2) for _, correlation in found.values()])))
    at = int(np.argmax(np.abs(near[best])))
    value = float(near[best][at])
    others = [float(np.abs(near[backwards]).max()) for backwards in directions if backwards != best]
    return Neighbours(
        correlation=value,
        reversed=best,
        lag_m=float((at - reach) * step_m),
        certainty=(abs(value) - max(others, default=0.0)) / max(scatter, 1e-9),
        sign_certainty=(abs(value) - float((-np.sign(value) * near[best]).max())) / max(scatter, 1e-9),
    )


def _lagged(
    line: Float[np.ndarray, "trace row"], neighbour: Float[np.ndarray, "neighbour_trace row"]
) -> tuple[Int[np.ndarray, " lag"], Float[np.ndarray, " lag"]]:
    """Correlation over the overlap when trace i of the line is next to trace i + lag of its neighbour."""
    size = len(line) + len(neighbour)
    spectra = [np.fft.rfft(image, size, axis=0) for image in (line, neighbour)]
    product = np.fft.irfft(np.sum(np.conj(spectra[0]) * spectra[1], axis=1), size)
    half = min(len(line), len(neighbour)) // 2
    lags = np.arange(-half, half + 1)
    energy = [np.concatenate([[0.0], np.cumsum(np.sum(image**2, axis=1))]) for image in (line, neighbour)]
    start = np.maximum(0, -lags)
    stop = np.minimum(len(line), len(neighbour) - lags)
    own = energy[0][stop] - energy[0][start]
    beside = energy[1][stop + lags] - energy[1][start + lags]
    return lags, product[lags] / np.sqrt(np.maximum(own * beside, 1e-12))
