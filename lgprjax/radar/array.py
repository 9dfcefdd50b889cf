"""Geometry of an antenna array: where each channel is, when it is sampled, and its gain."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Array, Bool, Complex, Float


class ArrayGeometry(NamedTuple):
    """Antenna positions in the body frame (x forward, y left, origin at the rear axle), and how it moves. Channel 0 is
    leftmost.

    Attributes:
        x_m: forward position of each channel's phase centre, metres.
        y_m: leftward position of each channel's phase centre, metres; falling with the channel number.
        time_offset_s: delay of each channel after the scan's own time, seconds (the switch matrix steps
            through the channels within one scan).
        height_m: nominal height of the array above the ground, metres.
        zero_slip_m: forward position of the point that moves along the body's axis, metres: of a vehicle whose rear
            wheels steer the other way it is ahead of the rear axle, which slips sideways in a turn.
    """

    x_m: Float[np.ndarray, " channel"]
    y_m: Float[np.ndarray, " channel"]
    time_offset_s: Float[np.ndarray, " channel"]
    height_m: float
    zero_slip_m: float = 0.0


def centre_of(array: ArrayGeometry) -> tuple[float, float]:
    """Centre (x_m, y_m) of the array in the body frame: the point a fix's position refers to."""
    return float(np.mean(array.x_m)), float(np.mean(array.y_m))


def uniform_array(
    channels: int, pitch_m: float, *, x_m: float = 0.0, height_m: float = 0.0, scan_period_s: float = 0.0
) -> ArrayGeometry:
    """Evenly spaced array centred on the body's x axis, its channels switched evenly over ``scan_period_s``."""
    index = np.arange(channels, dtype=np.float64)
    return ArrayGeometry(
        x_m=np.full(channels, x_m),
        y_m=((channels - 1) / 2 - index) * pitch_m,
        time_offset_s=index / channels * scan_period_s,
        height_m=height_m,
    )


# Gain and delay of each channel of a stepped-frequency array, and detection of dead channels.

_FAR_BELOW = 0.05
_STILL = 1e-3
_COHERENT = 0.35


class ChannelResponse(NamedTuple):
    """Gain and delay of each channel relative to the array's mean: a channel receives gain * exp(-2 pi i f delay) times
    the signal of an average one.
    """

    gain: Float[np.ndarray, " channel"] | Float[Array, " channel"]
    delay_ns: Float[np.ndarray, " channel"] | Float[Array, " channel"]


def estimate_channel_response(
    reference: Complex[np.ndarray, "channel frequency"],
    frequencies_hz: Float[np.ndarray, " frequency"],
    dead: Bool[np.ndarray, " channel"] | None = None,
) -> ChannelResponse:
    """Gain and delay of each channel from a recording over a flat reflector that is equally far from all of them.

    For example a metal plate under the array: sweeps divided by the calibration channel, look-up subtracted, averaged
    over scans. Each channel is first aligned with the array's mean by the highest correlation over all delays, so that
    no phase wraps; the rest is the slope of its phase, each frequency weighted with its power. The gain is the ratio of
    the magnitudes in phase with the mean.

    Args:
        reference: the calibrated sweep of each channel.
        frequencies_hz: frequencies in equal steps.
        dead: channels to leave out (``find_dead_channels``); they get gain 1 and delay 0.

    Raises:
        ValueError: all channels are dead.
    """
    alive = np.ones(len(reference), bool) if dead is None else ~dead
    if not alive.any():
        raise ValueError("a channel response needs a live channel")
    spectra = reference[alive].astype(np.complex128)
    # Within a sixteenth of the shortest period, a phase is at most 0.4 rad and cannot wrap.
    half_range_ns = 0.5e9 / float(np.diff(frequencies_hz).min())
    lags_ns = np.arange(-half_range_ns, half_range_ns, 1e9 / (8.0 * frequencies_hz[-1]))
    lay = np.exp(2e-9j * np.pi * np.outer(frequencies_hz, lags_ns))
    against = spectra[np.argmax(np.sum(np.abs(spectra) ** 2, axis=1))]
    for _ in range(3):
        cross = spectra * np.conj(against)
        best = np.argmax(np.real(cross @ lay), axis=1)
        left = np.angle(cross * lay[:, best].T)
        weight = np.abs(cross) * frequencies_hz
        slope_s = np.sum(weight * left, axis=1) / (2.0 * np.pi * np.sum(weight * frequencies_hz, axis=1))
        delay_ns = lags_ns[best] - 1e9 * slope_s
        delay_ns -= delay_ns.mean()
        laid = spectra * np.exp(2e-9j * np.pi * np.outer(delay_ns, frequencies_hz))
        ratio = np.real(laid @ np.conj(against)) / np.sum(np.abs(against) ** 2)
        gain = ratio / ratio.mean()
        against = laid.mean(axis=0)
    full_gain, full_delay_ns = np.ones(len(reference)), np.zeros(len(reference))
    full_gain[alive], full_delay_ns[alive] = gain, delay_ns
    return ChannelResponse(full_gain, full_delay_ns)


def find_dead_channels(
    sweeps: Complex[np.ndarray, "scan channel frequency"], calibration: Complex[np.ndarray, "scan frequency"]
) -> Bool[np.ndarray, " channel"]:
    """Channels without a signal, from a look-up, a plate or a stretch of a drive.

    A channel is dead when one of these holds:

    - it is not finite in more than half of the scans;
    - it is stuck: from scan to scan it changes by less than a thousandth of the change of the median channel (where
    that one changes at all);
    - divided by the calibration channel, its level is below a twentieth (26 dB) of the median channel's: no energy,
      a broken cable;
    - divided by the calibration channel, it is noise: neighbouring frequencies agree by less than 0.35. Direct coupling
    and the surface return arrive early in the unambiguous range, so that their phase turns little from step to step;
    the phases of noise are random.

    Args:
        sweeps: recorded sweeps, the look-up *not* subtracted: with it subtracted a dead channel would show the missing
            coupling. Scans times frequencies should be a hundred or more, or noise may agree by chance.
        calibration: calibration sweep of each scan; scans where it is zero or not finite do not count.
    """
    known = np.isfinite(calibration).all(axis=1) & (calibration != 0).all(axis=1)
    finite = np.isfinite(sweeps).all(axis=2) & known[:, None]
    raw = np.where(finite[..., None], sweeps, 0.0).astype(np.complex128)
    ratio = raw / np.where(known[:, None], calibration, 1.0)[:, None, :]
    count = np.maximum(finite.sum(axis=0), 1)
    power = np.sum(np.abs(ratio) ** 2, axis=(0, 2)) / count
    both = finite[1:] & finite[:-1]
    change = np.sum(np.abs(np.diff(raw, axis=0)) ** 2 * both[..., None], axis=(0, 2)) / np.maximum(both.sum(axis=0), 1)
    low, high = ratio[..., :-1], ratio[..., 1:]
    agree = np.abs(np.sum(high * np.conj(low), axis=(0, 2)))
    of = np.sqrt(np.sum(np.abs(high) ** 2, axis=(0, 2)) * np.sum(np.abs(low) ** 2, axis=(0, 2)))
    lost = 2 * finite.sum(axis=0) < max(int(known.sum()), 1)
    silent = power <= _FAR_BELOW**2 * np.median(power)
    stuck = change < _STILL**2 * np.median(change)
    return np.asarray(lost | silent | stuck | (agree < _COHERENT * of))
