"""Processing of stepped-frequency sweeps: calibration channel, look-up, channel response, inverse transform.

A scan has one complex sweep a channel and one of the calibration channel, a path through an attenuator instead of
the ground. The order is LL's: divide by the calibration channel (what drifts is common to both), then subtract the
look-up, the array in empty space, which was itself divided by its own calibration sweep (direct coupling, vehicle).
Subtracting first would leave coupling times the drift. The window and the inverse transform are one matrix, as for
traces (``time_domain.py``), so that everything behind it is the same for both; background removal follows.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Complex, Float

from lgprjax.radar.array import ChannelResponse
from lgprjax.radar.time_domain import WAVE_SPEED_M_PER_NS, ChainSettings, band_response

_LEAST_CALIBRATION = 1e-3
"""A calibration sweep's entry below this share of its median (60 dB) is a fault: dividing by it is meaningless."""
_EDGE = 0.25
"""Share of a sweep's band that the window's edge takes at each end."""
_DEPTH_PERIODS = 15.0


class LookUp(NamedTuple):
    """Sweeps of the array pointed at empty space (direct coupling, vehicle), and their calibration sweep."""

    sweeps: Complex[Array, "channel frequency"]
    calibration: Complex[Array, " frequency"]


@jax.jit
def calibrate_sweeps(
    sweeps: Complex[Array, "scan channel frequency"],
    calibration: Complex[Array, "scan frequency"],
    lookup: LookUp,
    response: ChannelResponse,
    frequencies_hz: Float[Array, " frequency"],
) -> tuple[Complex[Array, "scan channel frequency"], Bool[Array, "scan channel"]]:
    """Calibrated sweeps of the ground alone: S/C - L/Lc, corrected for each channel's gain and delay.

    Args:
        sweeps: recorded sweeps S.
        calibration: calibration channel's sweep C of each scan.
        lookup: look-up L and Lc, at any gain of the receiver.
        response: response of each channel, from ``estimate_channel_response``.
        frequencies_hz: frequencies of the sweeps.

    Returns:
        The calibrated sweeps, and mask of valid ones. A scan whose calibration sweep is not finite or close to zero
        anywhere is invalid, as is a channel that is not finite; invalid entries are zero.
    """
    level = jnp.median(jnp.abs(lookup.calibration))
    divisible = _divisible(calibration, level)
    known = _divisible(lookup.calibration, level)
    empty = lookup.sweeps / jnp.where(known, lookup.calibration, 1.0)[None, :]
    ground = sweeps / jnp.where(divisible[:, None], calibration, 1.0)[:, None, :] - empty[None]
    # The phase turns up to some twenty times over a band: 2 pi f tau in float32 is good to 1e-5 rad.
    turns = 1e-9 * frequencies_hz[None, :] * response.delay_ns[:, None]
    own = jnp.exp(2j * jnp.pi * turns.astype(jnp.complex64)) / response.gain[:, None].astype(jnp.complex64)
    valid = jnp.all(jnp.isfinite(ground), axis=-1) & divisible[:, None] & known
    return jnp.where(valid[..., None], ground * own[None], 0.0), valid


def _divisible(calibration: Complex[Array, "*scan frequency"], level: Float[Array, ""]) -> Bool[Array, "*scan"]:
    size = jnp.abs(calibration)
    least = _LEAST_CALIBRATION * jnp.maximum(jnp.median(size, axis=-1, keepdims=True), level)
    # A NaN compares false, and so does an all-zero sweep.
    return jnp.all((size > least) & jnp.isfinite(size), axis=-1)


def sweep_chain(frequencies_hz: Float[np.ndarray, " frequency"], scan_spacing_m: float) -> ChainSettings:
    """Settings that follow from a sweep: its own band, lengths from its centre frequency as for traces.

    The corners are in the middle of the window's edges. A sweep has no offset and no wow; the dewow applied to traces
    of other recordings on a map of sweeps spans four periods of the lowest frequency and does not affect the band.
    """
    low_hz, high_hz = float(frequencies_hz[0]), float(frequencies_hz[-1])
    edge_hz = 0.5 * _EDGE * (high_hz - low_hz)
    wavelength_m = WAVE_SPEED_M_PER_NS * 1e9 / (0.5 * (low_hz + high_hz))
    return ChainSettings(
        band_low_hz=low_hz + edge_hz,
        band_high_hz=high_hz - edge_hz,
        dewow_ns=4e9 / low_hz,
        track_filter_m=max(4.0, 5.0 * wavelength_m, 16.0 * scan_spacing_m),
        step_m=max(wavelength_m / 10.0, scan_spacing_m),
        wavelength_m=wavelength_m,
    )


def sweep_step_hz(frequencies_hz: Float[np.ndarray, " frequency"]) -> float | None:
    """Step of a sweep's frequencies, Hz, allowing for missing steps (a notch); ``None`` if the steps are not equal.

    Steps are equal if all frequencies are within a twentieth of a step: 18 degrees at the end of the range.
    """
    gaps_hz = np.diff(frequencies_hz)
    number = np.concatenate([[0.0], np.cumsum(np.round(gaps_hz / gaps_hz.min()))])
    step_hz, first_hz = np.polyfit(number, frequencies_hz, 1)
    beside_hz = np.abs(frequencies_hz - first_hz - number * step_hz)
    return float(step_hz) if beside_hz.max() <= 0.05 * step_hz else None


def unambiguous_ns(frequencies_hz: Float[np.ndarray, " frequency"]) -> float:
    """Unambiguous travel time of a sweep: 1/step, minus two over the band as a guard.

    The transform repeats after 1/step; ringing before an echo at the surface appears within the guard.
    """
    step_hz = sweep_step_hz(frequencies_hz)
    if step_hz is None:
        raise ValueError("the frequencies of a sweep must keep to equal steps")
    return 1e9 / step_hz - 2e9 / float(frequencies_hz[-1] - frequencies_hz[0])


def depth_window_ns(settings: ChainSettings) -> float:
    """Default travel time of a profile of sweeps: fifteen periods of the centre frequency.

    60 ns at 250 MHz, 3 m of nominal soil: the depth down to which LGPR has been shown to work. Losses
    grow with the frequency, so that the depth is best counted in periods.
    """
    return _DEPTH_PERIODS * settings.wavelength_m / WAVE_SPEED_M_PER_NS


def sweep_samples(
    frequencies_hz: Float[np.ndarray, " frequency"], settings: ChainSettings, travel_time_ns: float
) -> int:
    """Samples of the profile of sweeps: travel times from zero to ``travel_time_ns``, as far as they are unambiguous.

    Raises:
        ValueError: the frequencies are not in equal steps.
    """
    return max(2, int(min(travel_time_ns, unambiguous_ns(frequencies_hz)) / settings.sample_interval_ns))


def sweep_operator(
    frequencies_hz: Float[np.ndarray, " frequency"],
    settings: ChainSettings,
    *,
    group_delay_ns: float,
    kept: int,
) -> Float[Array, "recorded sample"]:
    """Window and inverse transform as one matrix: calibrated sweeps (``stacked``) to profile samples.

    The window is flat with cosine edges: the chain's band, as for traces, tapered at the sweep's ends over a quarter of
    its band, whichever is less. Its side lobes must fall as fast as the echoes of the ground, or shallow stones ring
    over deep ones: from 100 to 400 MHz they are at -34 dB after 20 ns and -50 dB after 30 ns, where echoes from soil
    that attenuates 6 dB a metre each way are 37 and 50 dB down. With edges of a tenth they are at -40 dB there; a
    Kaiser window of -60 dB costs a third of the frequencies that this one keeps.

    Dividing by the calibration channel has removed the delay of its path from every echo; it is restored, so that
    travel time zero of the antennas' phase centres is sample 0. A reflector of amplitude a that fills the band
    has the peak a in the profile (in units of the calibration path).

    Args:
        frequencies_hz: frequencies of the sweeps, in equal steps; steps may be left out.
        settings: settings of the chain.
        group_delay_ns: delay of the calibration channel's path.
        kept: number of samples of the profile; beyond the unambiguous range they are zero, never a repetition.

    Raises:
        ValueError: the frequencies are not in equal steps.
    """
    time_ns = np.arange(kept) * settings.sample_interval_ns
    phase = 2e-9 * np.pi * np.outer(frequencies_hz, time_ns - group_delay_ns)
    window = sweep_window(frequencies_hz, settings)
    weight = (window / max(float(window.sum()), 1e-30))[:, None] * (time_ns < unambiguous_ns(frequencies_hz))
    return jnp.asarray(np.concatenate([weight * np.cos(phase), -weight * np.sin(phase)]), dtype=jnp.float32)


def sweep_window(
    frequencies_hz: Float[np.ndarray, " frequency"], settings: ChainSettings
) -> Float[np.ndarray, " frequency"]:
    """Weight of each frequency: band of the chain or edge of the sweep, whichever is less, times the dewow's response.

    Dewow has nothing to remove here, but it shapes the band of every trace in a map or matched with it.
    """
    low_hz, high_hz = frequencies_hz[0], frequencies_hz[-1]
    # Half a step outside, so that the first and the last step still count.
    half_hz = 0.5 * float(np.diff(frequencies_hz).min())
    inside_hz = np.minimum(frequencies_hz - low_hz, high_hz - frequencies_hz) + half_hz
    edge = 0.5 - 0.5 * np.cos(np.pi * np.clip(inside_hz / (_EDGE * (high_hz - low_hz) + half_hz), 0.0, 1.0))
    dewow = 1.0 - np.sinc(1e-9 * frequencies_hz * settings.dewow_ns)
    return np.asarray(np.minimum(edge, band_response(frequencies_hz, settings)) * dewow)


@jax.jit
def stacked(sweeps: Complex[Array, "scan channel frequency"]) -> Float[Array, "scan channel recorded"]:
    """Complex sweeps as real numbers: all real parts, then all imaginary parts."""
    return jnp.concatenate([jnp.real(sweeps), jnp.imag(sweeps)], axis=-1)
