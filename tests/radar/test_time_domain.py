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
    out = np.zeros(kept)
    for k, f in enumerate(frequency_mhz):
        if f == 0.0 or k == padded // 2:
            continue
        # Half amplitude at 60 and 400 MHz; edges a third of an octave to each side.
        up = np.clip((np.log2(f / 60.0) + 1 / 3) / (2 / 3), 0, 1)
        down = np.clip((np.log2(400.0 / f) + 1 / 3) / (2 / 3), 0, 1)
        band = np.sin(np.pi / 2 * up) ** 2 * np.sin(np.pi / 2 * down) ** 2
        time_ns = np.arange(kept) * SETTINGS.sample_interval_ns + time_zero_ns
        out += band * 2 / padded * np.real(spectrum[k] * np.exp(2e-3j * np.pi * f * time_ns))
    return out


@pytest.mark.parametrize(("interval_ns", "time_zero_ns"), [(0.4, 0.0), (0.4, 7.13), (0.31, -3.3)])
def test_the_matrix_is_the_chain_written_out(interval_ns: float, time_zero_ns: float) -> None:
    trace = np.random.default_rng(0).normal(size=SAMPLES)
    kept = profile_samples(SAMPLES, interval_ns, time_zero_ns, SETTINGS)
    expected = oracle(trace, interval_ns, time_zero_ns, kept)
    np.testing.assert_allclose(profile_of(trace, interval_ns, time_zero_ns, kept), expected, atol=2e-5)


@pytest.mark.parametrize("time_zero_ns", [0.0, 5.0, 6.37, 11.111])
@pytest.mark.parametrize("interval_ns", [0.2, 0.37])
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


@pytest.mark.parametrize(
    ("frequency_mhz", "band"),
    [(60.0, 0.5), (120.0, 1.0), (200.0, 1.0), (300.0, 1.0), (400.0, 0.5), (510.0, 0.0), (700.0, 0.0), (45.0, 0.0)],
)
def test_the_band_has_its_corners_where_the_settings_say(frequency_mhz: float, band: float) -> None:
    """Amplitude of a long sinusoid away from the ends; dewow takes the share of a running mean away."""
    interval_ns, samples = 0.25, 800
    omega = 2e-3 * np.pi * frequency_mhz
    kept = profile_samples(samples, interval_ns, 0.0, SETTINGS)
    time_ns = np.arange(kept) * SETTINGS.sample_interval_ns
    profile = profile_of(np.sin(omega * np.arange(samples) * interval_ns), interval_ns, 0.0, kept)
    middle = (time_ns > 60.0) & (time_ns < 140.0)
    basis = np.stack([np.sin(omega * time_ns[middle]), np.cos(omega * time_ns[middle])], axis=1)
    in_phase, quadrature = np.linalg.lstsq(basis, profile[middle], rcond=None)[0]
    length = 2 * round(SETTINGS.dewow_ns / interval_ns / 2) + 1
    mean = np.sin(omega * interval_ns * length / 2) / (length * np.sin(omega * interval_ns / 2))
    assert in_phase == pytest.approx(band * (1 - mean), abs=0.02)
    assert quadrature == pytest.approx(0.0, abs=0.02)


def test_level_and_wow_are_removed() -> None:
    interval_ns, samples = 0.4, SAMPLES
    time_ns = np.arange(samples) * interval_ns
    kept = profile_samples(samples, interval_ns, 0.0, SETTINGS)
    inner = slice(12, kept - 12)
    echo = profile_of(wavelet(time_ns - 50.0), interval_ns, 0.0, kept)
    disturbances = (np.full(samples, 100.0), time_ns, 10.0 * np.sin(2e-3 * np.pi * 8.0 * time_ns))
    for disturbance, share in zip(disturbances, (1e-3, 0.1, 0.1), strict=True):
        profile = profile_of(wavelet(time_ns - 50.0) + disturbance, interval_ns, 0.0, kept)
        assert np.abs(profile - echo)[inner].max() < share * np.abs(echo).max()


def test_nothing_wraps_from_the_end_to_the_surface() -> None:
    interval_ns = 0.4
    trace = np.zeros(SAMPLES)
    trace[-3:] = [1.0, -2.0, 1.0]
    kept = profile_samples(SAMPLES, interval_ns, 0.0, SETTINGS)
    profile = np.abs(profile_of(trace, interval_ns, 0.0, kept))
    assert profile[: kept // 2].max() < 1e-3 * profile.max()
    assert profile[:4].max() < 1e-4 * profile.max()


def test_nothing_wraps_from_the_surface_to_the_end() -> None:
    """With travel time zero before the first sample, the profile begins with what was not recorded."""
    trace = np.zeros(SAMPLES)
    trace[:3] = [1.0, -2.0, 1.0]
    kept = profile_samples(SAMPLES, 0.4, -20.0, SETTINGS)
    profile = np.abs(profile_of(trace, 0.4, -20.0, kept))
    first = round(20.0 / SETTINGS.sample_interval_ns)
    assert abs(int(profile.argmax()) - first) <= 1
    assert profile[kept // 2 :].max() < 1e-3 * profile.max()


def test_beyond_the_recordings_end_there_is_nothing() -> None:
    """A short live recording against a deep map."""
    samples, interval_ns = 64, 0.4
    trace = wavelet(np.arange(samples) * interval_ns - 8.0)
    profile = np.abs(profile_of(trace, interval_ns, 0.0, 80))
    after = np.arange(80) * SETTINGS.sample_interval_ns > samples * interval_ns + 10.0
    assert profile[after].max() < 1e-3 * profile.max()


def test_recordings_of_different_settings_give_the_same_profile() -> None:
    def ground(time_ns: np.ndarray) -> np.ndarray:
        echoes = [(12.0, 1.0, 200e6), (19.7, -0.7, 180e6), (33.1, 0.5, 230e6), (47.9, -0.4, 200e6)]
        return np.asarray(sum(a * wavelet(time_ns - t, f) for t, a, f in echoes))

    kept = 55
    profiles = [
        profile_of(ground(np.arange(samples) * interval - zero), interval, zero, kept)
        for samples, interval, zero in [(512, 0.15, 0.0), (200, 0.4, 5.05), (150, 0.5, 0.33), (310, 0.27, -1.7)]
    ]
    for other, share in zip(profiles[1:], (0.01, 0.08, 0.02), strict=True):
        # At 0.5 ns an odd number of samples is 8.5 ns for the 7.5 of dewow: 0.06 where the others have 0.01.
        assert np.sqrt(np.mean((other - profiles[0]) ** 2)) < share * np.sqrt(np.mean(profiles[0] ** 2))


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


@pytest.mark.parametrize(("time_zero_ns", "kept"), [(0.0, 106), (10.0, 96), (101.0, 2)])
def test_a_profile_covers_travel_time_zero_to_the_end(time_zero_ns: float, kept: int) -> None:
    assert profile_samples(256, 0.4, time_zero_ns, SETTINGS) == kept
