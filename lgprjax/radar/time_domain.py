"""Processing of one time trace: time zero, dewow, band-pass, decimation to the band.

Every step is linear and acts on the last axis, so that a whole chain is one matrix: it is built once by
passing the identity through the steps (``profile_operator``) and applied to any number of traces as a single
product. The steps carry the names that users of GPR software know (research: GPRPy, RGPR).
"""

from dataclasses import asdict, dataclass
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

WAVE_SPEED_M_PER_NS = 0.1
"""Nominal speed in soil (relative permittivity 9): used for length scales only, never for a position."""


@dataclass(frozen=True)
class ChainSettings:
    """Parameters of the time-domain chain; kept with every product made by it.

    Attributes:
        band_low_hz, band_high_hz: -6 dB corners of the zero-phase band-pass.
        dewow_ns: length of the running mean that dewow subtracts; 1.5 periods of the centre frequency.
        track_filter_m: length of the background removal along the track, metres of travel.
        step_m: spacing of map stations along the track, metres.
        wavelength_m: wavelength of the centre frequency in nominal soil, the unit of all lateral scales.
    """

    band_low_hz: float
    band_high_hz: float
    dewow_ns: float
    track_filter_m: float
    step_m: float
    wavelength_m: float

    @property
    def sample_interval_ns(self) -> float:
        """Sample interval of the profile: fine enough for the band and its upper edge, a third of an octave above."""
        return 1e9 / (2.0 * 1.3 * self.band_high_hz)

    def as_provenance(self) -> dict[str, float]:
        """The parameters as plain numbers."""
        return asdict(self)


def default_chain(centre_frequency_hz: float, scan_spacing_m: float) -> ChainSettings:
    """Settings that follow from the antenna: band 0.3 to 2 times the centre frequency.

    Background removal spans four metres, five wavelengths or sixteen scans, whichever is longest: a mean over
    fewer would take the ground away together with the surface return (measured on 50 MHz data at 1.2 m).
    """
    wavelength_m = WAVE_SPEED_M_PER_NS * 1e9 / centre_frequency_hz
    return ChainSettings(
        band_low_hz=0.3 * centre_frequency_hz,
        band_high_hz=2.0 * centre_frequency_hz,
        dewow_ns=1.5e9 / centre_frequency_hz,
        track_filter_m=max(4.0, 5.0 * wavelength_m, 16.0 * scan_spacing_m),
        step_m=max(wavelength_m / 10.0, scan_spacing_m),
        wavelength_m=wavelength_m,
    )


def profile_samples(samples: int, sample_interval_ns: float, time_zero_ns: float, settings: ChainSettings) -> int:
    """Samples of a recording's profile: those between travel time zero and the recording's end."""
    window_ns = samples * sample_interval_ns - time_zero_ns
    return max(2, int(window_ns / settings.sample_interval_ns))


def profile_operator(
    samples: int,
    sample_interval_ns: float,
    time_zero_ns: float,
    settings: ChainSettings,
    *,
    kept: int,
) -> Float[Array, "recorded sample"]:
    """The chain as one matrix: recorded samples to profile samples.

    For any interval and time zero of the recording, the profile has the chain's interval and begins at
    travel time zero, so that drives of different settings share one map.

    Args:
        samples: number of recorded samples per trace.
        sample_interval_ns: recorded sample interval.
        time_zero_ns: travel time zero, relative to the first sample (may be negative).
        settings: settings of the chain.
        kept: number of samples of the profile; zero beyond the recording's end.
    """
    # Twice the length as padding: neither the shift nor the filter may wrap the late end onto the surface.
    padded = 2 * samples
    frequencies_hz = np.fft.rfftfreq(padded, sample_interval_ns * 1e-9)
    identity = jnp.eye(samples, dtype=jnp.float32)
    traces = dewow(identity, half_width=max(1, round(settings.dewow_ns / sample_interval_ns / 2)))
    spectrum = np.fft.rfft(np.asarray(traces, dtype=np.float64), n=padded, axis=-1)
    time_ns = np.arange(kept) * settings.sample_interval_ns + time_zero_ns
    inverse = np.exp(2e-9j * np.pi * np.outer(frequencies_hz, time_ns))
    twice = np.where((frequencies_hz > 0) & (np.arange(len(frequencies_hz)) < padded // 2), 2.0, 1.0)
    weight = band_response(frequencies_hz, settings) * twice / padded
    # The transform is periodic in the padded length: a longer profile would repeat.
    recorded = time_ns < samples * sample_interval_ns
    return jnp.asarray(((spectrum * weight) @ inverse).real * recorded, dtype=jnp.float32)


@partial(jax.jit, static_argnames="half_width")
def dewow(traces: Float[Array, "*batch sample"], *, half_width: int) -> Float[Array, "*batch sample"]:
    """Subtract the running mean over ``2 half_width + 1`` samples (shorter at the ends)."""
    samples = traces.shape[-1]
    total = jnp.cumsum(traces, axis=-1)
    total = jnp.concatenate([jnp.zeros_like(total[..., :1]), total], axis=-1)
    first = np.maximum(np.arange(samples) - half_width, 0)
    last = np.minimum(np.arange(samples) + half_width + 1, samples)
    count = jnp.asarray((last - first).astype(np.float32))
    return traces - (total[..., last] - total[..., first]) / jnp.broadcast_to(count, traces.shape)


def band_response(
    frequencies_hz: Float[np.ndarray, " frequency"], settings: ChainSettings
) -> Float[np.ndarray, " frequency"]:
    """Zero-phase band-pass: half amplitude at both corners, cosine edges of a third of an octave a side."""
    octaves = np.log2(np.maximum(frequencies_hz, 1.0))
    rise = (octaves - np.log2(settings.band_low_hz)) / (2 / 3) + 0.5
    fall = (np.log2(settings.band_high_hz) - octaves) / (2 / 3) + 0.5
    edge = np.clip(np.minimum(rise, fall), 0.0, 1.0)
    return np.asarray(0.5 - 0.5 * np.cos(np.pi * edge))


@jax.jit
def apply_operator(
    traces: Float[Array, "scan channel recorded"], matrix: Float[Array, "recorded sample"]
) -> Float[Array, "scan channel sample"]:
    """Recorded traces to profile traces: one matrix product.

    In full float32 on every device: recordings without time gain span 60 dB over depth, and with the short mantissa
    that is the default on some devices, rounding of the surface return would exceed the deep ground.
    """
    return jnp.matmul(traces, matrix, precision=jax.lax.Precision.HIGHEST)
