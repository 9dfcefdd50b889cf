"""Sweeps to profiles against formulas: reflectors, cables, drift, coupling, all written out in float64."""

import jax.numpy as jnp
import numpy as np
import pytest

from lgprjax.radar import (
    ChannelResponse,
    LookUp,
    apply_operator,
    calibrate_sweeps,
    default_chain,
    depth_window_ns,
    profile_operator,
    stacked,
    sweep_chain,
    sweep_operator,
    sweep_samples,
    sweep_step_hz,
    sweep_window,
    unambiguous_ns,
)

FREQUENCIES_HZ = np.linspace(100e6, 400e6, 101)  # 3 MHz: 333 ns
SETTINGS = sweep_chain(FREQUENCIES_HZ, 0.035)
SCANS, CHANNELS, KEPT = 24, 3, 56
CABLE_NS = 12.6
PATH = 40.0 * (1.0 + 0.3 * np.cos(FREQUENCIES_HZ / 31e6))  # attenuator with a ripple


def late(delay_ns: float | np.ndarray, frequencies_hz: np.ndarray = FREQUENCIES_HZ) -> np.ndarray:
    return np.asarray(np.exp(-2e-9j * np.pi * np.multiply.outer(delay_ns, frequencies_hz)))


class Scene:
    """What an instrument records of some echoes: each scan at the gain of its moment."""

    def __init__(self, drift: np.ndarray, own: ChannelResponse | None = None, cable_ns: float = CABLE_NS) -> None:
        rng = np.random.default_rng(3)
        travel_ns = np.array([9.3, 21.7, 38.2])
        strength = rng.normal(size=(SCANS, CHANNELS, 3)) * [1.0, 0.3, 0.1]
        self.ground = strength @ late(travel_ns)
        coupling = 100.0 * rng.normal(size=(CHANNELS, 2)) @ late(np.array([0.4, 3.1]))
        self.own = own or ChannelResponse(np.ones(CHANNELS), np.zeros(CHANNELS))
        response = np.asarray(self.own.gain)[:, None] * late(np.asarray(self.own.delay_ns))
        path = PATH * late(cable_ns)
        # The instrument's transfer function, the same for every channel; it is what the drift multiplies.
        instrument = np.exp(1j * FREQUENCIES_HZ / 45e6)
        self.sweeps = drift[:, None, None] * instrument * response * (self.ground + coupling)
        self.calibration = drift[:, None] * instrument * path
        elsewhere = 0.25 * np.exp(2.1j) * instrument  # the look-up was taken at another gain
        self.lookup = (elsewhere * response * coupling, elsewhere * path)
        self.expected = self.ground / path

    def calibrate(
        self, calibration: np.ndarray | None = None, sweeps: np.ndarray | None = None
    ) -> tuple[np.ndarray, np.ndarray]:
        found, valid = calibrate_sweeps(
            jnp.asarray(self.sweeps if sweeps is None else sweeps, jnp.complex64),
            jnp.asarray(self.calibration if calibration is None else calibration, jnp.complex64),
            LookUp(*(jnp.asarray(part, jnp.complex64) for part in self.lookup)),
            ChannelResponse(*(jnp.asarray(part, jnp.float32) for part in self.own)),
            jnp.asarray(FREQUENCIES_HZ, jnp.float32),
        )
        return np.asarray(found), np.asarray(valid)


STEADY = np.ones(SCANS)
PHASE = np.linspace(0.0, 1.2, SCANS)
DRIFT = (1.0 + 0.2 * np.sin(np.linspace(0.0, 5.0, SCANS))) * np.exp(1j * PHASE)


def profile_of(sweeps: np.ndarray, cable_ns: float = CABLE_NS, kept: int = KEPT) -> np.ndarray:
    matrix = sweep_operator(FREQUENCIES_HZ, SETTINGS, group_delay_ns=cable_ns, kept=kept)
    return np.asarray(apply_operator(stacked(jnp.asarray(sweeps, jnp.complex64)), matrix), np.float64)


def far(found: np.ndarray, expected: np.ndarray) -> float:
    """RMS of the difference, relative."""
    return float(np.sqrt(np.mean(np.abs(found - expected) ** 2) / np.mean(np.abs(expected) ** 2)))


def test_drift_cancels_with_the_calibration_channel_and_only_with_it() -> None:
    scene = Scene(DRIFT)
    steady = profile_of(Scene(STEADY).calibrate()[0])
    assert far(profile_of(scene.calibrate()[0]), steady) < 0.01
    first_only = np.broadcast_to(scene.calibration[:1], scene.calibration.shape)
    assert far(profile_of(scene.calibrate(first_only)[0]), steady) > 1.0
    # Phase alone does it too: it is not the amplitude that the channel is for.
    phase = Scene(np.exp(1j * PHASE))
    assert far(profile_of(phase.calibrate()[0]), steady) < 0.01
    assert (
        far(profile_of(phase.calibrate(np.broadcast_to(phase.calibration[:1], scene.calibration.shape))[0]), steady) > 1
    )


def test_the_ground_is_what_is_left_and_channels_are_brought_to_one_response() -> None:
    """Instrument, cable, ripple and drift divided out, coupling of a hundred times the ground subtracted."""
    own = ChannelResponse(np.array([0.8, 1.05, 1.15]), np.array([-0.21, 0.04, 0.17]))
    scene = Scene(DRIFT, own)
    found, valid = scene.calibrate()
    assert valid.all()
    assert far(found, scene.expected) < 1e-4
    scene.own = ChannelResponse(np.ones(CHANNELS), np.zeros(CHANNELS))
    assert far(scene.calibrate()[0], scene.expected) > 0.2


@pytest.mark.parametrize("value", [0.0, 1e-5, np.nan])
def test_a_bad_calibration_sweep_costs_its_own_scan(value: float) -> None:
    scene = Scene(DRIFT)
    calibration = scene.calibration.copy()
    calibration[7, 40] = value
    calibration[9] = value * 0.0 if np.isfinite(value) else value
    found, valid = scene.calibrate(calibration)
    due = np.ones((SCANS, CHANNELS), bool)
    due[[7, 9]] = False
    np.testing.assert_array_equal(valid, due)
    whole, _ = scene.calibrate()
    np.testing.assert_array_equal(found[due], whole[due])
    np.testing.assert_array_equal(found[~due], 0.0)


def test_a_bad_sweep_costs_its_own_trace_and_a_bad_look_up_all() -> None:
    scene = Scene(DRIFT)
    sweeps = scene.sweeps.copy()
    sweeps[5, 1, 3] = np.nan
    sweeps[6, 2, 90] = np.inf
    found, valid = scene.calibrate(sweeps=sweeps)
    due = np.ones((SCANS, CHANNELS), bool)
    due[5, 1] = due[6, 2] = False
    np.testing.assert_array_equal(valid, due)
    np.testing.assert_array_equal(found[due], scene.calibrate()[0][due])
    np.testing.assert_array_equal(found[~due], 0.0)
    scene.lookup[1][3] = 0.0
    found, valid = scene.calibrate()
    assert not valid.any()
    assert np.all(found == 0.0)


@pytest.mark.parametrize(("travel_ns", "cable_ns", "sign"), [(4.0, 0.0, 1.0), (17.31, 12.6, -1.0), (33.777, -3.2, 1.0)])
def test_a_reflector_arrives_at_its_travel_time(travel_ns: float, cable_ns: float, sign: float) -> None:
    """To a hundredth of a sample, with its amplitude and polarity, whatever the calibration path's delay."""
    echo = sign * 0.7 * late(travel_ns - cable_ns)
    profile = sign * profile_of(echo[None, None], cable_ns)[0, 0]
    interval_ns = SETTINGS.sample_interval_ns
    time_ns = np.arange(KEPT) * interval_ns
    # Between the samples the profile is the sum of the window's cosines: least squares over its own frequencies.
    fine_ns = travel_ns + np.arange(-0.4, 0.4, 1e-4)
    weight = sweep_window(FREQUENCIES_HZ, SETTINGS)
    expected = 0.7 * np.cos(2e-9 * np.pi * np.outer(time_ns - travel_ns, FREQUENCIES_HZ)) @ weight / weight.sum()
    np.testing.assert_allclose(profile, expected, atol=2e-6)
    spline = np.sinc((fine_ns[:, None] - time_ns) / interval_ns) @ profile
    if 8.0 < travel_ns < 0.8 * time_ns[-1]:  # the sinc needs samples to both sides
        assert fine_ns[np.argmax(spline)] == pytest.approx(travel_ns, abs=0.01 * interval_ns)
        assert spline.max() == pytest.approx(0.7, abs=2e-3)


def test_beyond_the_unambiguous_range_there_is_nothing() -> None:
    """Steps of 20 MHz repeat after 50 ns; a map may be deeper."""
    frequencies_hz = np.arange(100e6, 401e6, 20e6)
    settings = sweep_chain(frequencies_hz, 0.035)
    assert unambiguous_ns(frequencies_hz) == pytest.approx(50.0 - 2e3 / 300.0)
    matrix = np.asarray(sweep_operator(frequencies_hz, settings, group_delay_ns=0.0, kept=120))
    time_ns = np.arange(120) * settings.sample_interval_ns
    beyond = time_ns > 50.0 - 2e3 / 300.0
    assert np.all(matrix[:, beyond] == 0.0)
    assert np.all(np.abs(matrix[:, ~beyond]).max(axis=0) > 0.0)
    assert sweep_samples(frequencies_hz, settings, 1e4) == int(43.3333 / settings.sample_interval_ns)
    assert sweep_samples(frequencies_hz, settings, 30.0) == int(30.0 / settings.sample_interval_ns)


def test_shallow_echoes_do_not_ring_over_deep_ones() -> None:
    profile = np.abs(profile_of(late(8.0 - CABLE_NS)[None, None], kept=100)[0, 0])
    after_ns = np.arange(100) * SETTINGS.sample_interval_ns - 8.0
    for beyond_ns, level_db in ((20.0, -33.0), (30.0, -48.0), (40.0, -54.0)):
        assert 20 * np.log10(profile[after_ns > beyond_ns].max()) < level_db


def test_a_notch_is_left_out() -> None:
    """Frequencies that must not be radiated leave a hole, not another time axis."""
    steps = np.arange(100e6, 400.1e6, 3e6)
    notched = steps[(steps < 322e6) | (steps > 336e6)]
    assert sweep_step_hz(notched) == pytest.approx(3e6)
    settings = sweep_chain(notched, 0.035)
    matrix = np.asarray(sweep_operator(notched, settings, group_delay_ns=0.0, kept=60))
    echo = late(20 * settings.sample_interval_ns, notched)
    profile = np.concatenate([echo.real, echo.imag]) @ matrix
    assert profile.argmax() == 20
    assert profile.max() == pytest.approx(1.0, abs=1e-6)


def test_frequencies_without_a_common_step_are_told() -> None:
    rng = np.random.default_rng(1)
    assert sweep_step_hz(FREQUENCIES_HZ) == pytest.approx(3e6)
    assert sweep_step_hz(FREQUENCIES_HZ + rng.uniform(-3e4, 3e4, 101)) == pytest.approx(3e6, rel=1e-3)
    assert sweep_step_hz(np.geomspace(100e6, 400e6, 101)) is None
    with pytest.raises(ValueError, match="frequencies"):
        sweep_samples(np.geomspace(100e6, 400e6, 101), SETTINGS, 60.0)


def test_settings_follow_from_the_sweep() -> None:
    assert SETTINGS.band_low_hz == pytest.approx(137.5e6)
    assert SETTINGS.band_high_hz == pytest.approx(362.5e6)
    assert SETTINGS.wavelength_m == pytest.approx(0.4)
    assert SETTINGS.track_filter_m == pytest.approx(4.0)
    assert depth_window_ns(SETTINGS) == pytest.approx(60.0)
    window = sweep_window(FREQUENCIES_HZ, SETTINGS)
    assert np.interp(137.5e6, FREQUENCIES_HZ, window) == pytest.approx(0.5, abs=0.05)
    assert np.interp(362.5e6, FREQUENCIES_HZ, window) == pytest.approx(0.5, abs=0.05)
    assert window[0] < 0.02
    assert window[-1] < 0.02


@pytest.mark.parametrize("by", ["traces", "sweeps"])
def test_the_same_ground_as_traces_and_as_sweeps(by: str) -> None:
    """On the settings of either kind; the ground fills the band of both."""
    settings = default_chain(250e6, 0.035) if by == "traces" else SETTINGS
    rng = np.random.default_rng(5)
    travel_ns, strength = rng.uniform(6.0, 45.0, 30), rng.normal(size=30)
    interval_ns, zero_ns, samples, kept = 0.16, 4.0, 400, 50
    time_ns = np.arange(samples) * interval_ns - zero_ns
    fine_hz = np.linspace(101e6, 399e6, 300)
    shape = np.sin(np.pi * (fine_hz - 100e6) / 300e6) ** 2  # spectrum of the wavelet: zero at the band's ends
    trace = np.cos(2e-9 * np.pi * (time_ns[:, None, None] - travel_ns[:, None]) * fine_hz) @ shape @ strength
    sweep = strength @ late(travel_ns - CABLE_NS) * np.sin(np.pi * (FREQUENCIES_HZ - 100e6) / 300e6) ** 2
    from_trace = trace @ np.asarray(profile_operator(samples, interval_ns, zero_ns, settings, kept=kept), np.float64)
    matrix = np.asarray(sweep_operator(FREQUENCIES_HZ, settings, group_delay_ns=CABLE_NS, kept=kept), np.float64)
    from_sweep = np.concatenate([sweep.real, sweep.imag]) @ matrix
    correlation = from_trace @ from_sweep / np.sqrt(np.sum(from_trace**2) * np.sum(from_sweep**2))
    assert correlation > 0.99
