"""The processing for pictures: what it takes away, what it leaves, and what it says of itself."""

import re

import numpy as np
import pytest

from lgprjax.radar import Radargram, clear_view


def radargram(amplitude: np.ndarray, interval_ns: float = 0.5, frequency_hz: float | None = 1e8) -> Radargram:
    return Radargram(
        name="a",
        amplitude=amplitude,
        along=np.arange(float(len(amplitude))),
        in_metres=True,
        time_ns=np.arange(amplitude.shape[1]) * interval_ns,
        centre_frequency_hz=frequency_hz,
    )


def test_level_wow_and_background_go_and_the_ground_stays() -> None:
    rng = np.random.default_rng(3)
    time_ns = np.arange(400) * 0.5
    wow, surface = 500.0 + 300.0 * np.sin(2 * np.pi * time_ns / 400.0), 100.0 * np.exp(-(((time_ns - 20.0) / 3.0) ** 2))
    ground = np.zeros((50, 400))
    ground[:, 100:300] = 0.1 * rng.normal(size=(50, 200))
    clear = clear_view(radargram(wow + surface + ground)).amplitude
    assert np.corrcoef(clear[:, 120:280].ravel(), ground[:, 120:280].ravel())[0, 1] > 0.95
    assert np.abs(clear.mean(axis=0)).max() < 1e-3 * clear.std()


@pytest.mark.parametrize("known", [True, False])
def test_it_says_what_it_did(known: bool) -> None:
    """The dewow's length and the largest gain."""
    rng = np.random.default_rng(4)
    time_ns = np.arange(400) * 0.5
    wave = np.cos(2 * np.pi * 0.1 * time_ns + rng.uniform(0.0, 6.0, (30, 1))) * np.exp(-time_ns / 40.0)
    dewow, _, gain = clear_view(radargram(wave, frequency_hz=1e8 if known else None)).steps
    assert "15 ns" in dewow
    told = re.search(r"(\d+) dB", gain)
    assert told is not None
    assert 25 <= int(told[1]) <= 45


def test_the_gain_never_raises_noise_to_the_ground() -> None:
    rng = np.random.default_rng(1)
    time_ns = np.arange(400) * 0.5
    ground = np.repeat(rng.normal(size=(20, 400)), 10, axis=0) * np.exp(-time_ns / 15.0)
    noisy = radargram(ground + 0.001 * rng.normal(size=ground.shape))
    clear = clear_view(noisy).amplitude
    late, middle = (float(np.std(clear[:, part])) for part in (slice(300, None), slice(60, 120)))
    assert late < 0.5 * middle


@pytest.mark.parametrize("frequency_hz", [1e8, None])
def test_silence_and_gaps_stay_what_they_are(frequency_hz: float | None) -> None:
    silent = clear_view(radargram(np.zeros((5, 30)), frequency_hz=frequency_hz))
    assert not silent.amplitude.any()
    gap = np.random.default_rng(2).normal(size=(5, 30))
    gap[2] = np.nan
    assert (
        np.isnan(clear_view(radargram(gap, frequency_hz=frequency_hz)).amplitude).all(axis=1) == [0, 0, 1, 0, 0]
    ).all()
    nothing = clear_view(radargram(np.full((5, 30), np.nan), frequency_hz=frequency_hz))
    assert np.isnan(nothing.amplitude).all()
