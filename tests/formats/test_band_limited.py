"""Resampling to a coarser interval: passed and stopped frequencies, and SciPy's filter as an outside answer."""

import numpy as np
import pytest
import scipy.signal

from lgprjax.formats.vendors.gprmax import PASSBAND, resample, share_above


def _tone(frequency: float, count: int = 3000) -> np.ndarray:
    """A tone under a smooth envelope, in units of the input interval."""
    time = np.arange(count)
    envelope = np.exp(-0.5 * ((time - count / 2) / (count / 10)) ** 2)
    return np.asarray(envelope * np.cos(2 * np.pi * frequency * (time - count / 2)))[None, :]


@pytest.mark.parametrize("ratio", [1.0, 8.48])
def test_passed_tones_keep_amplitude_and_phase(ratio: float) -> None:
    for share in (0.05, PASSBAND - 0.01):
        tone = _tone(share / ratio)
        coarse = resample(tone, 1.0, ratio)
        at = np.arange(coarse.shape[1]) * ratio
        count = tone.shape[1]
        envelope = np.exp(-0.5 * ((at - count / 2) / (count / 10)) ** 2)
        due = envelope * np.cos(2 * np.pi * share / ratio * (at - count / 2))
        np.testing.assert_allclose(coarse[0], due, atol=1e-3)


def test_tones_above_the_new_nyquist_frequency_do_not_fold_back() -> None:
    for share in (0.51, 1.0, 1.9):
        assert np.abs(resample(_tone(share / 8.0), 1.0, 8.0)).max() < 3e-4
    # Plain decimation would have folded the last but one onto frequency 0 at full height.
    assert np.abs(_tone(1.0 / 8.0)[0, ::8]).max() > 0.99


def test_agrees_with_scipy_on_a_pulse() -> None:
    time = np.arange(4000) * 0.02359
    pulse = (1 - 2 * (np.pi * 0.4 * (time - 20)) ** 2) * np.exp(-((np.pi * 0.4 * (time - 20)) ** 2))
    ours = resample(pulse[None, :], 0.02359, 0.02359 * 10)[0]
    theirs = scipy.signal.resample_poly(pulse, 1, 10)
    np.testing.assert_allclose(ours, theirs, atol=2e-3)


def test_a_trace_that_ends_at_a_level_keeps_it_and_starts_from_zero() -> None:
    step = np.concatenate([np.zeros(500), np.full(500, 3.0)])[None, :]
    coarse = resample(step, 1.0, 7.0)[0]
    assert coarse[0] == pytest.approx(0.0, abs=1e-9)
    assert coarse[-1] == pytest.approx(3.0)
    assert len(coarse) == 999 // 7 + 1


def test_finer_is_refused() -> None:
    with pytest.raises(ValueError, match="resampling"):
        resample(np.ones((1, 9)), 1.0, 0.5)


def test_share_of_energy_above_a_frequency() -> None:
    both = _tone(0.02) + 0.5 * _tone(0.2)
    assert share_above(both, 1.0, 0.1) == pytest.approx(0.2, rel=1e-3)
    assert share_above(both, 0.5, 0.2) == pytest.approx(0.2, rel=1e-3)
    assert share_above(np.ones((2, 50)), 1.0, 0.1) == 0.0
