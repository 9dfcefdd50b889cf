"""A receiver that records traces: noise, gain with time, eight bits."""

from dataclasses import dataclass
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int, PRNGKeyArray, UInt8

from lgprjax.scene.hardware import Response, ScanErrors, heard_echoes
from lgprjax.scene.propagation import RadarConfig, band_spectrum
from lgprjax.scene.rays import LIGHT_M_PER_NS
from lgprjax.scene.render import convolve_echoes
from lgprjax.scene.slices import GroundSlice

ZERO_LEVEL = 128


@dataclass(frozen=True)
class ReceiverConfig:
    """Time gain and quantisation.

    The surface is heard a hundred to a thousand times louder than what is buried at 2 m; in eight bits the
    ground would be lost. So the receiver amplifies with time before it quantises (time-varying gain): the
    gain follows p**2 exp(2 a R), the loss of an echo that spread over p = height + R / n after a way R in the ground,
    up to ``gain_limit`` times its value at the surface. It is the same for every trace of every drive.
    """

    counts_per_field: float = 900.0
    velocity_m_per_ns: float = 0.1
    attenuation_per_m: float = 0.7
    gain_limit: float = 300.0


def time_gain(radar: RadarConfig, receiver: ReceiverConfig) -> Float[np.ndarray, " sample"]:
    """Counts per field at each sample."""
    height_m = radar.height_m
    in_ground_ns = np.maximum(radar.bin_ns[: radar.samples] - 2 * height_m / LIGHT_M_PER_NS, 0.0)
    range_m = 0.5 * receiver.velocity_m_per_ns * in_ground_ns
    index = LIGHT_M_PER_NS / receiver.velocity_m_per_ns
    rise = (1 + range_m / (index * height_m)) ** 2 * np.exp(2 * receiver.attenuation_per_m * range_m)
    return np.asarray(receiver.counts_per_field * height_m**2 * np.minimum(rise, receiver.gain_limit))


@partial(jax.jit, static_argnames=("radar", "receiver"))
def record_scans(
    key: PRNGKeyArray,
    first_scan: Int[Array, ""],
    ground: GroundSlice,
    antenna_m: Float[Array, "scan channel 3"],
    response: Response,
    errors: ScanErrors,
    noise_field: Float[Array, ""],
    matrix: Float[Array, "bin sample"],
    *,
    radar: RadarConfig,
    receiver: ReceiverConfig,
) -> UInt8[Array, "scan channel sample"]:
    """Records a block of scans.

    Args:
        key: of the drive's noise, the same for every block; scan ``first_scan + i`` draws from its own fold.
        antenna_m: (along, cross, height above the ground) of every antenna at its own instant, about the
            slice's origin.
        errors: of these scans.
        noise_field: rms of the noise before the time gain.
        matrix: from ``trace_matrix``.

    Returns:
        Bytes, 128 for silence.
    """
    scans, channels, _ = antenna_m.shape
    echoes = heard_echoes(ground, antenna_m.reshape(-1, 3), response, radar=radar)
    traces = convolve_echoes(echoes, matrix).reshape(scans, channels, radar.samples)

    # Noise of the band: a stepped-frequency receiver hears nothing outside it.
    keys = jax.vmap(jax.random.fold_in, (None, 0))(key, first_scan + jnp.arange(scans, dtype=jnp.int32))
    colours = _noise_matrix(radar)
    white = jax.vmap(lambda k: jax.random.normal(k, (channels, colours.shape[0]), jnp.float32))(keys)
    traces += noise_field * jnp.matmul(white, colours, precision=jax.lax.Precision.HIGHEST)

    phase = jax.vmap(lambda k: jax.random.uniform(jax.random.fold_in(k, 1), (channels,)))(keys)
    time_ns = jnp.asarray(radar.bin_ns[: radar.samples], jnp.float32)
    cycles = errors.interference_mhz[:, None, None] * 1e-3 * time_ns[None, None, :] + phase[..., None]
    connected = (jnp.asarray(response.gain) != 0).astype(traces.dtype)[None, :, None]
    traces += errors.interference[:, None, None] * connected * jnp.cos(2 * jnp.pi * cycles)

    traces *= errors.gain[:, None, None]
    counts = ZERO_LEVEL + traces * jnp.asarray(time_gain(radar, receiver), jnp.float32)[None, None, :]
    return jnp.clip(jnp.round(counts), 0.0, 255.0).astype(jnp.uint8)


def _noise_matrix(radar: RadarConfig) -> Float[np.ndarray, "number sample"]:
    """Unit white numbers to noise of unit rms with the band's spectrum (5 MHz apart: it repeats after 200 ns)."""
    low, high = radar.band_mhz
    frequency_mhz = np.arange(low, high, 5.0) + 2.5
    spectrum = band_spectrum(radar, frequency_mhz)
    angle = 2e-3 * np.pi * np.outer(frequency_mhz, radar.bin_ns[: radar.samples])
    waves = np.concatenate([np.cos(angle) * spectrum[:, None], np.sin(angle) * spectrum[:, None]])
    return np.asarray(waves / np.linalg.norm(spectrum), np.float32)
