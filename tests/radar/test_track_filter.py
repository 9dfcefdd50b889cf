"""The track filter against loops over scans."""

import jax.numpy as jnp
import numpy as np
import pytest

from lgprjax.radar import LiveFilterState, init_live_filter, run_live_filter, zero_phase_filter

SCANS, CHANNELS, SAMPLES = 60, 3, 5
LENGTH_M = 2.0


def run(
    profile: np.ndarray, valid: np.ndarray, travel_m: np.ndarray, state: LiveFilterState | None = None
) -> tuple[LiveFilterState, np.ndarray]:
    state = init_live_filter(CHANNELS, SAMPLES) if state is None else state
    after, out = run_live_filter(
        state,
        jnp.asarray(profile, dtype=jnp.float32),
        jnp.asarray(valid),
        jnp.asarray(travel_m, dtype=jnp.float32),
        jnp.float32(LENGTH_M),
    )
    return after, np.asarray(out)


def oracle(profile: np.ndarray, valid: np.ndarray, travel_m: np.ndarray) -> np.ndarray:
    """Weights of all scans so far, spelt out: each travel fades the past by exp(-|d| / (L/2))."""
    out = np.zeros_like(profile)
    for channel in range(CHANNELS):
        weights: list[float] = []
        traces: list[np.ndarray] = []
        for n in range(len(profile)):
            if not valid[n, channel]:
                continue
            fade = np.exp(-abs(travel_m[n]) / (LENGTH_M / 2))
            # The first scan counts for its own travel, or a little where there was none.
            new = max(1 - fade, 1e-3) if not weights else 1 - fade
            weights = [w * fade for w in weights] + [new]
            traces.append(profile[n, channel])
            mean = sum(w * t for w, t in zip(weights, traces, strict=True)) / sum(weights)
            out[n, channel] = profile[n, channel] - mean
    return out


@pytest.fixture
def drive() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Forward, standing, in reverse, forward; channel 1 fails for a while, channel 2 at random."""
    rng = np.random.default_rng(0)
    travel_m = np.concatenate([np.full(20, 0.1), np.zeros(8), np.full(12, -0.07), np.full(20, 0.15)])
    valid = np.ones((SCANS, CHANNELS), bool)
    valid[15:35, 1] = False
    valid[:, 2] = rng.random(SCANS) > 0.3
    profile = rng.normal(size=(SCANS, CHANNELS, SAMPLES)) + 3.0
    profile[~valid] = 1e6
    return profile, valid, travel_m


def test_live_filter_is_the_faded_mean_written_out(drive: tuple[np.ndarray, np.ndarray, np.ndarray]) -> None:
    """Standing freezes the mean, reverse is travel too, and an invalid channel keeps its mean and gives zeros."""
    _, out = run(*drive)
    np.testing.assert_allclose(out, oracle(*drive), atol=2e-5)


def test_blocks_make_no_difference(drive: tuple[np.ndarray, np.ndarray, np.ndarray]) -> None:
    profile, valid, travel_m = drive
    whole_state, whole = run(*drive)
    state, parts = init_live_filter(CHANNELS, SAMPLES), []
    for first in range(0, SCANS, 20):
        block = slice(first, first + 20)
        state, out = run(profile[block], valid[block], travel_m[block], state)
        parts.append(out)
    np.testing.assert_array_equal(np.concatenate(parts), whole)
    for a, b in zip(state, whole_state, strict=True):
        np.testing.assert_array_equal(a, b)


def test_after_a_leap_to_another_line_the_mean_begins_anew() -> None:
    """A second line in one log is filtered as if it were the first, in each channel from its own first scan on."""
    rng = np.random.default_rng(4)
    line = rng.normal(size=(SCANS, CHANNELS, SAMPLES))
    valid = np.ones((SCANS, CHANNELS), bool)
    valid[:5, 1] = False
    step = np.full(SCANS, 0.05)
    step[0] = 0.0
    _, alone = run(line, valid, step)
    leap = np.where(np.arange(SCANS) == 0, 100.0, step)
    before = line + 7.0
    _, after = run(np.concatenate([before, line]), np.concatenate([valid, valid]), np.concatenate([step, leap]))
    np.testing.assert_allclose(after[SCANS:], alone, atol=2e-3)


@pytest.mark.parametrize("stations", [4, 9, 200])
def test_zero_phase_filter_is_a_centred_mean_of_what_there_is(stations: int) -> None:
    rng = np.random.default_rng(3)
    profile = (rng.normal(size=(40, CHANNELS, SAMPLES)) + 5.0).astype(np.float32)
    valid = rng.random((40, CHANNELS)) > 0.25
    valid[10:22, 1] = False
    half = stations // 2
    expected = np.zeros(profile.shape)
    for n in range(40):
        for channel in range(CHANNELS):
            if valid[n, channel]:
                around = [m for m in range(max(0, n - half), min(40, n + half + 1)) if valid[m, channel]]
                mean = np.mean([profile[m, channel].astype(float) for m in around], axis=0)
                expected[n, channel] = profile[n, channel] - mean
    profile[~valid] = 1e3
    np.testing.assert_allclose(zero_phase_filter(profile, valid, stations), expected, atol=2e-6)
