"""Channel responses from a plate against injected ones; dead channels of every kind, and none where all live."""

import numpy as np
import pytest

from lgprjax.radar import estimate_channel_response, find_dead_channels

FREQUENCIES_HZ = np.linspace(100e6, 400e6, 101)
CHANNELS = 11


def late(delay_ns: np.ndarray | float) -> np.ndarray:
    return np.asarray(np.exp(-2e-9j * np.pi * np.multiply.outer(delay_ns, FREQUENCIES_HZ)))


def noise(rng: np.random.Generator, *shape: int) -> np.ndarray:
    return np.asarray((rng.normal(size=shape) + 1j * rng.normal(size=shape)) / np.sqrt(2.0))


@pytest.mark.parametrize("spread_ns", [0.05, 3.0])
def test_gain_and_delay_of_a_plate_come_back(spread_ns: float) -> None:
    """40 dB over the noise; delays of several periods do not wrap. 5 ps and half a per cent."""
    for seed in range(10):
        rng = np.random.default_rng(seed)
        gain, delay_ns = rng.uniform(0.7, 1.3, CHANNELS), rng.normal(size=CHANNELS) * spread_ns
        gain, delay_ns = gain / gain.mean(), delay_ns - delay_ns.mean()
        # The plate, and something behind it: the array's common answer is no single echo.
        plate = late(2.1) + 0.4 * late(7.7)
        plate = plate / np.sqrt(np.mean(np.abs(plate) ** 2))
        seen = gain[:, None] * late(delay_ns) * plate + 0.01 * noise(rng, CHANNELS, len(FREQUENCIES_HZ))
        found = estimate_channel_response(seen, FREQUENCIES_HZ)
        assert np.abs(found.delay_ns - delay_ns).max() < 5e-3
        assert np.abs(found.gain / gain - 1.0).max() < 5e-3


def test_a_dead_channel_does_not_pull_the_others() -> None:
    rng = np.random.default_rng(1)
    gain, delay_ns = np.array([1.1, 0.9, 1.0, 1.0]), np.array([0.1, -0.1, 0.0, 0.0])
    seen = gain[:, None] * late(delay_ns) * late(2.0)
    seen[3] = 50.0 * noise(rng, len(FREQUENCIES_HZ))
    found = estimate_channel_response(seen, FREQUENCIES_HZ, np.array([False, False, False, True]))
    np.testing.assert_allclose(found.gain, [1.1, 0.9, 1.0, 1.0], atol=1e-9)
    np.testing.assert_allclose(found.delay_ns, [0.1, -0.1, 0.0, 0.0], atol=1e-9)
    with pytest.raises(ValueError, match="live"):
        estimate_channel_response(seen, FREQUENCIES_HZ, np.ones(4, bool))


def recording(scans: int = 20, seed: int = 0, level: float = 0.01) -> tuple[np.ndarray, np.ndarray]:
    """Coupling, a surface, ground that changes, noise, a receiver that drifts."""
    rng = np.random.default_rng(seed)
    echoes = rng.uniform(0.5, 1.5, (scans, CHANNELS, 3)) * [1.0, 0.3, 0.05]
    echoes[:, :, :2] = echoes[:1, :, :2]
    heard = echoes @ late(np.array([0.5, 4.0, 22.0])) + level * noise(rng, scans, CHANNELS, len(FREQUENCIES_HZ))
    drift = np.linspace(1.0, 1.2, scans) * np.exp(1j * np.linspace(0.0, 0.5, scans))
    return drift[:, None, None] * heard, drift[:, None] * late(9.0) * 3.0


def test_a_sound_array_has_no_dead_channels() -> None:
    for seed in range(20):
        assert not find_dead_channels(*recording(seed=seed)).any()
        assert not find_dead_channels(*recording(1, seed)).any()
    # Without noise and movement no channel changes, and none is stuck.
    still = tuple(np.repeat(part[:1], 5, axis=0) for part in recording(level=0.0))
    assert not find_dead_channels(*still).any()


# One scan, a look-up say, cannot tell whether a channel changes.
@pytest.mark.parametrize(
    ("fault", "scans"),
    [
        ("zero", 1),
        ("far below", 1),
        ("far below", 20),
        ("noise", 1),
        ("noise", 20),
        ("loud noise", 20),
        ("nan", 20),
        ("stuck", 20),
    ],
)
def test_a_dead_channel_is_found(fault: str, scans: int) -> None:
    rng = np.random.default_rng(2)
    sweeps, calibration = recording(scans)
    shape = (scans, len(FREQUENCIES_HZ))
    sweeps[:, 4] = {
        "zero": np.zeros(shape),
        "far below": 0.02 * sweeps[:, 4],
        "stuck": np.repeat(sweeps[:1, 4], scans, axis=0),
        "noise": noise(rng, *shape),
        "loud noise": 30.0 * noise(rng, *shape),
        "nan": np.full(shape, np.nan),
    }[fault]
    np.testing.assert_array_equal(np.flatnonzero(find_dead_channels(sweeps, calibration)), [4])


def test_a_few_bad_scans_kill_no_channel() -> None:
    sweeps, calibration = recording()
    sweeps[3:8, 2] = np.nan
    calibration[10:14] = 0.0
    calibration[15] = np.nan
    assert not find_dead_channels(sweeps, calibration).any()


def test_most_channels_dead_leaves_the_living() -> None:
    rng = np.random.default_rng(3)
    sweeps, calibration = recording()
    sweeps[:, 2:] = 1e-3 * noise(rng, *sweeps[:, 2:].shape)
    np.testing.assert_array_equal(find_dead_channels(sweeps, calibration), [False] * 2 + [True] * 9)
