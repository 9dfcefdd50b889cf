"""In-band coefficients stand for the trace: products, delays, limits, gain."""

import jax.numpy as jnp
import numpy as np
import pytest

from lgprjax.radar import (
    CoefficientBasis,
    air_delay_ns,
    centre_of,
    coefficient_basis,
    coherence_gain,
    default_chain,
    shift_travel_time,
    to_coefficients,
    uniform_array,
)

SETTINGS = default_chain(200e6, 0.035)
SAMPLES = 80
INTERVAL_NS = SETTINGS.sample_interval_ns
TIME_NS = np.arange(SAMPLES) * INTERVAL_NS
ONES = np.ones((1, 4), bool)


@pytest.fixture(scope="module")
def basis() -> CoefficientBasis:
    return coefficient_basis(np.ones(SAMPLES), INTERVAL_NS, SETTINGS)


def packet(centre_ns: np.ndarray, frequency_mhz: float, width_ns: float = 5.0) -> np.ndarray:
    """Wave packets that fill no more than the band and die out before the ends."""
    t = TIME_NS - np.asarray(centre_ns)[..., None]
    return np.asarray(np.cos(2e-3 * np.pi * frequency_mhz * t) * np.exp(-0.5 * (t / width_ns) ** 2))


def coefficients(profile: np.ndarray, basis: CoefficientBasis, valid: np.ndarray = ONES) -> np.ndarray:
    return np.asarray(to_coefficients(jnp.asarray(profile, dtype=jnp.float32), jnp.asarray(valid), basis))


def test_what_lies_outside_the_band_or_at_the_ends_is_left_out(basis: CoefficientBasis) -> None:
    """Oracle: taper, keep the in-band bins of the FFT, go back; correlate the samples."""
    rng = np.random.default_rng(0)
    traces = rng.normal(size=(4, SAMPLES))
    taper = np.ones(SAMPLES)
    taper[:4] = [np.sin(np.pi / 2 * (i + 0.5) / 4) ** 2 for i in range(4)]
    taper[-4:] = taper[:4][::-1]
    spectrum = np.fft.rfft(traces * taper, axis=-1)
    frequency_mhz = np.fft.rfftfreq(SAMPLES, INTERVAL_NS * 1e-3)
    spectrum[:, (frequency_mhz < 60.0) | (frequency_mhz > 400.0)] = 0.0
    kept = np.fft.irfft(spectrum, n=SAMPLES, axis=-1)
    by_matrix = np.asarray(jnp.asarray(traces, dtype=jnp.float32) @ basis.matrix, dtype=np.float64)
    np.testing.assert_allclose(by_matrix @ by_matrix.T, kept @ kept.T, atol=2e-4)
    assert by_matrix.shape[1] == 2 * np.sum((frequency_mhz >= 60.0) & (frequency_mhz <= 400.0))


def test_a_shift_is_the_signal_that_much_later(basis: CoefficientBasis) -> None:
    centre_ns, delay_ns = np.array([35.0, 38.5, 40.0, 41.3]), np.array([-6.0, -0.37, 1.234, 8.8])
    early = jnp.asarray(packet(centre_ns, 210.0), dtype=jnp.float32) @ basis.matrix
    late = np.asarray(jnp.asarray(packet(centre_ns + delay_ns, 210.0), dtype=jnp.float32) @ basis.matrix)
    omega = basis.angular_frequency_rad_per_ns
    shifted = shift_travel_time(early, jnp.asarray(delay_ns, jnp.float32), omega)
    np.testing.assert_allclose(shifted, late, atol=2e-4 * np.abs(late).max())
    np.testing.assert_allclose(jnp.sum(shifted**2, axis=-1), jnp.sum(early**2, axis=-1), rtol=1e-5)


def test_the_limit_knows_no_scale(basis: CoefficientBasis) -> None:
    profile = np.random.default_rng(2).normal(size=(1, 4, SAMPLES))
    profile[0, 1, 30] = 40.0
    once = coefficients(profile, basis)
    for factor in (1e-6, 1024.0):
        scaled = coefficients(factor * profile, basis)
        np.testing.assert_allclose(scaled, factor * once, rtol=1e-4, atol=2e-5 * factor)


def test_one_strong_reflector_is_limited_and_no_more(basis: CoefficientBasis) -> None:
    profile = np.random.default_rng(3).normal(size=(2, 4, SAMPLES))
    profile[0, 2, 40] = 100.0
    valid = np.array([[True, True, True, False], [True, True, False, False]])
    counted = np.where(valid[..., None], profile, 0.0)
    expected = np.empty((2, 4, SAMPLES))
    for scan in range(2):
        rms = np.sqrt(np.mean(profile[scan, valid[scan]] ** 2))
        expected[scan] = np.clip(counted[scan], -2.5 * rms, 2.5 * rms)
    result = coefficients(profile, basis, valid)
    np.testing.assert_allclose(result, expected @ np.asarray(basis.matrix, float), atol=2e-4)
    assert not result[~valid].any()


def test_invalid_traces_may_hold_anything(basis: CoefficientBasis) -> None:
    profile = np.random.default_rng(4).normal(size=(2, 4, SAMPLES))
    valid = np.array([[True, False, True, True], [False] * 4])
    clean = coefficients(profile, basis, valid)
    profile[~valid] = np.nan
    np.testing.assert_array_equal(coefficients(profile, basis, valid), clean)
    assert not clean[1].any()


def test_the_gain_weighs_the_depths() -> None:
    gain = np.linspace(0.5, 2.0, SAMPLES)
    gained = coefficient_basis(gain, INTERVAL_NS, SETTINGS)
    plain = coefficient_basis(np.ones(SAMPLES), INTERVAL_NS, SETTINGS)
    profile = np.sin(2e-3 * np.pi * 200.0 * TIME_NS) * np.ones((1, 4, 1))
    np.testing.assert_allclose(coefficients(profile, gained), coefficients(profile * gain, plain), atol=1e-5)


def test_the_gain_levels_ground_and_drops_noise() -> None:
    """Amplitude falls by 100 over depth; the lower third is noise that repeats nowhere."""
    rng = np.random.default_rng(5)
    amplitude = np.geomspace(1.0, 0.01, SAMPLES)
    ground = np.where(np.arange(SAMPLES) < 50, 1.0, 0.0)
    traces = amplitude * (ground * rng.normal(size=(20000, SAMPLES)))
    noise = [0.003 * rng.normal(size=traces.shape) for _ in range(2)]
    power = np.mean((traces + noise[0]) ** 2, axis=0)
    lagged = np.mean((traces + noise[0]) * (traces + noise[1]), axis=0)
    gain = coherence_gain(power, lagged, 0.0 * power)
    levelled = gain * np.sqrt(power)
    np.testing.assert_allclose(levelled[3:46], 1.0, atol=0.05)
    assert np.abs(levelled[54:-4]).max() < 0.05
    assert np.all(gain >= 0.0)


def test_the_gain_drops_what_is_the_same_a_wavelength_on() -> None:
    """The upper third holds the remains of a surface return, which change over metres; the rest is ground."""
    power = np.ones(SAMPLES)
    surface = np.where(np.arange(SAMPLES) < SAMPLES // 3, 1.0, 0.0)
    lagged, distant = np.full(SAMPLES, 0.95), 0.9 * surface - 0.1 * (1 - surface)
    gain = coherence_gain(power, lagged, distant)
    np.testing.assert_allclose(gain[3 : SAMPLES // 3 - 4], 0.05, atol=1e-6)
    np.testing.assert_allclose(gain[SAMPLES // 3 + 4 : -4], 0.95, atol=1e-6)
    assert np.all(np.isfinite(coherence_gain(np.zeros(SAMPLES), np.zeros(SAMPLES), np.zeros(SAMPLES))))


def test_a_metre_of_air_and_channels_from_the_left() -> None:
    np.testing.assert_allclose(air_delay_ns(jnp.asarray([1.0, -0.1, 0.0])), [6.6713, -0.66713, 0.0], rtol=1e-4)
    array = uniform_array(5, 0.2, x_m=3.0, height_m=0.3, scan_period_s=0.01)
    np.testing.assert_allclose(array.y_m, [0.4, 0.2, 0.0, -0.2, -0.4], atol=1e-12)
    np.testing.assert_allclose(array.time_offset_s, [0.0, 0.002, 0.004, 0.006, 0.008])
    assert centre_of(array) == pytest.approx((3.0, 0.0))
