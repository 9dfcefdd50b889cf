"""The time-domain chain as one matrix, against SciPy in float64 and against formulas."""

import jax.numpy as jnp
import numpy as np
import pytest
import scipy.fft

from lgprjax.radar import ChainSettings, apply_operator, default_chain, profile_operator, profile_samples
from lgprjax.radar.time_domain import dewow

CENTRE_HZ = 200e6
SETTINGS = default_chain(CENTRE_HZ, 0.035)
SAMPLES = 256


def wavelet(time_ns: np.ndarray, centre_hz: float = CENTRE_HZ) -> np.ndarray:
    """Ricker wavelet about time zero."""
    arg = (np.pi * centre_hz * 1e-9 * time_ns) ** 2
    return np.asarray((1 - 2 * arg) * np.exp(-arg))


def profile_of(
    trace: np.ndarray, interval_ns: float, time_zero_ns: float, kept: int, settings: ChainSettings = SETTINGS
) -> np.ndarray:
    matrix = profile_operator(len(trace), interval_ns, time_zero_ns, settings, kept=kept)
    return np.asarray(trace, dtype=np.float64) @ np.asarray(matrix, dtype=np.float64)


def oracle(trace: np.ndarray, interval_ns: float, time_zero_ns: float, kept: int) -> np.ndarray:
    """Loop dewow; spectrum of the padded trace times the band; explicit sum of cosines at the profile's times."""
    half = max(1, round(SETTINGS.dewow_ns / interval_ns / 2))
    level = [np.mean(trace[max(0, i - half) : i + half + 1]) for i in range(len(trace))]
    padded = 2 * len(trace)
    spectrum = scipy.fft.rfft(trace - np.array(level), n=padded)
    frequency_mhz = scipy.fft.rfftfreq(padded, interval_ns * 1e-3)
    out, time_ns = np.zeros(kept), np.arange(kept) * SETTINGS.sample_interval_ns + time_zero_ns
    for k, f in enumerate(frequency_mhz):
        if f == 0.0 or k == padded // 2:
            continue
        # Half amplitude at 60 and 400 MHz; edges a third of an octave to each side.
        up = np.clip((np.log2(f / 60.0) + 1 / 3) / (2 / 3), 0, 1)
        down = np.clip((np.log2(400.0 / f) + 1 / 3) / (2 / 3), 0, 1)
        band = np.sin(np.pi / 2 * up) ** 2 * np.sin(np.pi / 2 * down) ** 2
        out += band * 2 / padded * np.real(spectrum[k] * np.exp(2e-3j * np.pi * f * time_ns))
    return np.where(time_ns < len(trace) * interval_ns, out, 0.0)


@pytest.mark.parametrize(("interval_ns", "time_zero_ns", "longer"), [(0.4, 7.13, 0), (0.31, -3.3, 20)])
def test_the_matrix_is_the_chain_written_out(interval_ns: float, time_zero_ns: float, longer: int) -> None:
    """Beyond the recording's end, where a live one is shorter than the map, too."""
    trace = np.random.default_rng(0).normal(size=SAMPLES)
    kept = profile_samples(SAMPLES, interval_ns, time_zero_ns, SETTINGS) + longer
    expected = oracle(trace, interval_ns, time_zero_ns, kept)
    np.testing.assert_allclose(profile_of(trace, interval_ns, time_zero_ns, kept), expected, atol=2e-5)


@pytest.mark.parametrize(("time_zero_ns", "interval_ns"), [(0.0, 0.2), (11.111, 0.37)])
def test_an_echo_arrives_at_its_travel_time_whatever_time_zero(time_zero_ns: float, interval_ns: float) -> None:
    travel_ns = 21.3
    trace = wavelet(np.arange(SAMPLES) * interval_ns - time_zero_ns - travel_ns)
    kept = 40
    profile = profile_of(trace, interval_ns, time_zero_ns, kept)
    # The chain is zero-phase, so the profile is symmetric about the echo: its energy is centred there.
    time_ns = np.arange(kept) * SETTINGS.sample_interval_ns
    centre_ns = np.sum(time_ns * profile**2) / np.sum(profile**2)
    assert centre_ns == pytest.approx(travel_ns, abs=0.02)
    fine_ns = np.arange(travel_ns - 1.0, travel_ns + 1.0, 0.01)
    resampled = np.sinc((fine_ns[:, None] - time_ns) / SETTINGS.sample_interval_ns) @ profile
    assert fine_ns[np.argmax(resampled)] == pytest.approx(travel_ns, abs=0.03)


def test_dewow_is_a_loop_of_means() -> None:
    traces = np.random.default_rng(1).normal(size=(3, 40)).astype(np.float32)
    for half in (1, 4, 60):
        expected = np.array(
            [[row[i] - row[max(0, i - half) : i + half + 1].mean() for i in range(40)] for row in traces.astype(float)]
        )
        np.testing.assert_allclose(dewow(jnp.asarray(traces), half_width=half), expected, atol=3e-6)


def test_the_operator_is_applied_trace_by_trace() -> None:
    rng = np.random.default_rng(2)
    traces = rng.normal(size=(4, 3, 64)).astype(np.float32)
    matrix = profile_operator(64, 0.4, 1.0, SETTINGS, kept=12)
    expected = [[trace.astype(float) @ np.asarray(matrix, float) for trace in scan] for scan in traces]
    np.testing.assert_allclose(apply_operator(jnp.asarray(traces), matrix), np.array(expected), atol=1e-4)


def test_default_settings_follow_from_the_antenna() -> None:
    fine, coarse = default_chain(200e6, 0.035), default_chain(50e6, 1.2)
    assert fine.wavelength_m == pytest.approx(0.5)
    assert fine.step_m == pytest.approx(0.05)
    assert fine.track_filter_m == pytest.approx(4.0)
    assert fine.dewow_ns == pytest.approx(7.5)
    assert coarse.step_m == pytest.approx(1.2)
    assert coarse.track_filter_m == pytest.approx(19.2)  # sixteen scans; five wavelengths are ten metres
    assert fine.sample_interval_ns == pytest.approx(1e3 / (2 * 1.3 * 400.0))


def test_a_profile_covers_travel_time_zero_to_the_end() -> None:
    kept = [profile_samples(256, 0.4, time_zero_ns, SETTINGS) for time_zero_ns in (0.0, 10.0, 101.0)]
    assert kept == [106, 96, 2]
