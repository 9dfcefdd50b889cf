"""Loss, dispersion and band against the integral over frequency written out."""

import numpy as np
import pytest

from lgprjax.scene import RadarConfig, make_wavelet
from lgprjax.scene.propagation import band_spectrum, sweep_matrix, trace_matrix

RADAR = RadarConfig()
SOIL = {"velocity_m_per_ns": 0.1, "attenuation_per_m": 0.7, "dispersive_share": 0.5}
STEP_NS, ZERO_NS = RADAR.sample_step_ns, RADAR.time_zero_ns


def edge(frequency_mhz: float) -> float:
    """The default band's spectrum: from 100 to 400 MHz, edges of 100 MHz."""
    if not 100 < frequency_mhz < 400:
        return 0.0
    return float(np.sin(np.pi / 2 * min(frequency_mhz - 100, 400 - frequency_mhz, 100) / 100) ** 2)


@pytest.mark.parametrize("at_bin", [10, 300])
def test_an_echo_is_dulled_and_hurried_as_its_way_in_the_ground_demands(at_bin: int) -> None:
    """alpha(f) = a (1 - s + s f / f0); phase velocity v (1 + ln(f / f0) / (pi Q)), Q = pi f0 / (s a v)."""
    time_ns = at_bin * STEP_NS - ZERO_NS
    way_m = 2 * 0.1 * max(time_ns - 2 * 0.3 / 0.299792458, 0.0) / 2
    quality = np.pi * 0.25 / (0.5 * 0.7 * 0.1)
    sample_ns = np.arange(369) * STEP_NS - ZERO_NS
    frequency_mhz = np.arange(100.5, 400.0, 1.0)
    weights = [edge(float(f)) for f in frequency_mhz]
    expected = np.zeros(369)
    for f, weight in zip(frequency_mhz * 1e-3, weights, strict=True):
        more_loss = np.exp(-0.5 * 0.7 * (f / 0.25 - 1) * way_m)
        arrives_ns = time_ns - way_m / 0.1 * np.log(f / 0.25) / (np.pi * quality)
        expected += weight * more_loss * np.cos(2 * np.pi * f * (sample_ns - arrives_ns))
    found = trace_matrix(RADAR, **SOIL)[at_bin]
    np.testing.assert_allclose(found, expected / sum(weights), atol=2e-3 * np.abs(expected).max() / sum(weights))


def test_the_wavelet_keeps_to_its_band() -> None:
    taps = make_wavelet(RADAR)
    power = np.abs(np.fft.rfft(taps, 8192)) ** 2
    frequency_mhz = np.fft.rfftfreq(8192, STEP_NS * 1e-3)
    inside = (frequency_mhz >= 100) & (frequency_mhz <= 400)
    assert power[~inside].sum() < 1e-3 * power.sum()
    assert taps[taps.size // 2] == pytest.approx(1.0)
    np.testing.assert_allclose(taps, taps[::-1], atol=1e-12)


def test_the_spectrum_is_flat_between_cosine_edges() -> None:
    frequency_mhz = np.array([50.0, 100.0, 150.0, 200.0, 250.0, 300.0, 350.0, 400.0, 500.0])
    np.testing.assert_allclose(band_spectrum(RADAR, frequency_mhz), [0, 0, 0.5, 1, 1, 1, 0.5, 0, 0], atol=1e-12)


def test_sweeps_and_traces_are_the_same_echo() -> None:
    """A sweep, weighted with the band and summed over its frequencies, is the trace."""
    frequency_mhz = np.arange(100.0, 401.0, 2.5)
    matrix = sweep_matrix(RADAR, frequency_mhz, **SOIL)
    steps = frequency_mhz.size
    weight = np.array([edge(f) for f in frequency_mhz])
    sample_ns = np.arange(369) * STEP_NS - ZERO_NS
    for at in (40, 200):
        sweep = matrix[at, :steps] + 1j * matrix[at, steps:]
        trace = np.real(sweep * weight @ np.exp(2e-3j * np.pi * np.outer(frequency_mhz, sample_ns))) / weight.sum()
        np.testing.assert_allclose(trace, trace_matrix(RADAR, **SOIL)[at], atol=3e-3)


def test_sweeps_repeat_after_their_unambiguous_time() -> None:
    """Steps of 25 MHz: 40 ns, 250 bins of 0.16 ns."""
    frequency_mhz = np.arange(100.0, 401.0, 25.0)
    matrix = sweep_matrix(RADAR, frequency_mhz, **{**SOIL, "dispersive_share": 0.0})
    np.testing.assert_allclose(matrix[300], matrix[50], atol=1e-5)
    assert np.abs(matrix[300] - matrix[175]).max() > 0.5
