"""Coded traces: the noise of rounding against its closed form, what may not be lost, what must stay zero."""

import numpy as np
import pytest

from lgprjax.formats.map_layout import CodedTraces, TraceCode, decode, encode, trace_code

CHANNELS, SAMPLES = 6, 48


def drawn(stations: int, seed: int, spread: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """Gained traces that are white after a depth envelope of ``spread``, and a gain that is not flat."""
    rng = np.random.default_rng(seed)
    gain = np.geomspace(0.1, 30.0, SAMPLES).astype(np.float32)
    gained = rng.standard_normal((stations, CHANNELS, SAMPLES)) * np.exp(-spread * np.arange(SAMPLES))
    return (gained / gain).astype(np.float32), gain


def coded(profile: np.ndarray, gain: np.ndarray, step_rms: float) -> tuple[TraceCode, CodedTraces, np.ndarray]:
    flat = profile.reshape(-1, SAMPLES).astype(np.float64)
    code = trace_code(flat.T @ flat, len(flat), gain, step_rms)
    traces = encode(code, profile, np.ones(profile.shape[:2], bool))
    return code, traces, decode(code, traces)


def correlation(a: np.ndarray, b: np.ndarray) -> float:
    a, b = a.astype(np.float64), b.astype(np.float64)
    return float(np.sum(a * b) / np.sqrt(np.sum(a**2) * np.sum(b**2)))


@pytest.mark.parametrize("step_rms", [0.25, 1.0])
def test_correlation_falls_by_the_closed_form(step_rms: float) -> None:
    """White traces, rounded to steps of up to their RMS: noise of step²/12, uncorrelated with them (Widrow)."""
    profile, gain = drawn(400, seed=1)
    _, _, read = coded(profile, gain, step_rms)
    expected = 1.0 / np.sqrt(1.0 + step_rms**2 / 12.0)
    # The step itself has eight bits and is rounded up, by 0.2 % on average.
    assert correlation(read * gain, profile * gain) == pytest.approx(expected, abs=0.005 * (1.0 - expected) + 2e-4)


@pytest.mark.parametrize("step_rms", [0.5, 2.0])
def test_no_station_falls_below_the_bound(step_rms: float) -> None:
    """Traces whose power is in few components: what is less than a step is lost, and less than the noise would be."""
    profile, gain = drawn(300, seed=2, spread=0.15)
    _, _, read = coded(profile, gain, step_rms)
    found = [correlation(a * gain, b * gain) for a, b in zip(read, profile, strict=True)]
    assert min(found) > 1.0 / np.sqrt(1.0 + step_rms**2 / 12.0) - 0.02


def test_every_component_is_within_half_a_step() -> None:
    """In float64, by the stored basis alone."""
    profile, gain = drawn(50, seed=3, spread=0.1)
    code, traces, read = coded(profile, gain, 1.0)
    basis = code.basis.astype(np.float64)
    np.testing.assert_allclose(basis @ basis.T, np.eye(SAMPLES), atol=1e-6)
    off = (read.astype(np.float64) - profile) * gain @ basis.T
    assert np.all(np.abs(off).max(axis=(1, 2)) <= 0.5001 * traces.scale)
    by_hand = np.einsum("nkc,ks->ncs", traces.codes.astype(np.float64), basis) * traces.scale[:, None, None] / gain
    np.testing.assert_allclose(read, by_hand, rtol=1e-4, atol=1e-5)


def test_a_spike_is_kept_whole_and_quiet_ground_as_well_as_loud() -> None:
    profile, gain = drawn(40, seed=4)
    profile[7] *= 1e-4
    profile[9, 2, 20] = 4000.0
    _, traces, read = coded(profile, gain, 0.5)
    assert np.abs(traces.codes.astype(int)).max() <= 127
    loud, quiet = (correlation(read[n] * gain, profile[n] * gain) for n in (6, 7))
    assert quiet == pytest.approx(loud, abs=2e-3)
    assert read[9, 2, 20] == pytest.approx(4000.0, rel=0.03)


def test_what_is_not_there_stays_zero() -> None:
    """Absent channels whatever they hold, silent stations, depths without gain."""
    profile, gain = drawn(30, seed=5)
    gain[40:] = 0.0
    flat = profile.reshape(-1, SAMPLES).astype(np.float64)
    code = trace_code(flat.T @ flat, len(flat), gain, 1.0)
    valid = np.ones(profile.shape[:2], bool)
    valid[3, 2], profile[3, 2] = False, np.nan
    profile[5] = 0.0
    read = decode(code, encode(code, profile, valid))
    assert np.isfinite(read).all()
    assert not read[3, 2].any()
    assert not read[5].any()
    assert not read[..., 40:].any()
    assert correlation(read[4, :, :40] * gain[:40], profile[4, :, :40] * gain[:40]) > 0.9
