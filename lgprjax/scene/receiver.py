"""From echoes to the bytes of a recording: antenna errors, coupling, surface, noise, gain, 8 bits."""

from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int, PRNGKeyArray, UInt8

from lgprjax.scene.ground import GroundSlice
from lgprjax.scene.render import (
    LIGHT_M_PER_NS,
    RadarConfig,
    convolve_echoes,
    make_wavelet,
    place_echoes,
    place_ground_echoes,
)

ZERO_LEVEL = 128
# Direct coupling between neighbours, then two reflections of the vehicle: time after transmission and field.
COUPLING_NS = (0.42, 1.6, 3.1)
COUPLING_FIELD = (0.5, -0.2, 0.1)
HARDWARE_SEED = 20  # the same array on every day


@dataclass(frozen=True)
class Day:
    """What differs from day to day. The defaults are a clear day (see tests/scene/test_difficulty.py).

    Attributes:
        seed: of everything below.
        noise_field: rms of the receiver's noise within its band, before the time gain.
        gain_spread: sigma of a channel's gain about 1, constant over a drive.
        delay_spread_ns: sigma of a channel's own delay, constant over a drive.
        coupling_spread: sigma of a channel's coupling and surface echo, relative, constant over a drive.
        velocity_factor, velocity_spread: the wave's velocity is the ground's, times the factor, times
            1 + spread * normal.
        clutter_per_m2, clutter_depth_m, clutter_strength_m: small shallow things, there on this day only.
    """

    seed: int = 1
    noise_field: float = 7e-5
    gain_spread: float = 0.03
    delay_spread_ns: float = 0.03
    coupling_spread: float = 0.02
    velocity_factor: float = 1.0
    velocity_spread: float = 0.002
    clutter_per_m2: float = 5.0
    clutter_depth_m: tuple[float, float] = (0.03, 0.5)
    clutter_strength_m: float = 0.005


@dataclass(frozen=True)
class ReceiverConfig:
    """Time gain and quantisation.

    The surface is heard a hundred to a thousand times louder than what is buried at 2 m; in eight bits the
    ground would be lost. So the receiver amplifies with time before it quantises (time-varying gain): the
    gain follows p**2 exp(2 a (p - height)), the loss of an echo from path length
    p = height + velocity * (t - surface) / 2, up to ``gain_limit`` times its value at the surface. It is the
    same for every trace of every drive.
    """

    counts_per_field: float = 900.0
    height_m: float = 0.3
    velocity_m_per_ns: float = 0.1
    attenuation_per_m: float = 0.7
    gain_limit: float = 1000.0


class Response(NamedTuple):
    """Errors of each channel on one day."""

    gain: Float[np.ndarray, " channel"]
    delay_ns: Float[np.ndarray, " channel"]
    surface: Float[np.ndarray, " channel"]
    coupling: Float[np.ndarray, "channel path"]


def draw_response(day: Day, channels: int) -> Response:
    """The array's errors on a day: a part that belongs to the hardware (coupling) and a part of the day."""
    hardware = np.random.default_rng(HARDWARE_SEED)
    rng = np.random.default_rng([day.seed, 1])
    coupling = np.asarray(COUPLING_FIELD) * (1 + 0.1 * hardware.normal(size=(channels, len(COUPLING_FIELD))))
    response = Response(
        gain=1 + day.gain_spread * rng.normal(size=channels),
        delay_ns=day.delay_spread_ns * rng.normal(size=channels),
        surface=1 + day.coupling_spread * rng.normal(size=channels),
        coupling=coupling * (1 + day.coupling_spread * rng.normal(size=coupling.shape)),
    )
    return Response(*(a.astype(np.float32) for a in response))


def time_gain(radar: RadarConfig, receiver: ReceiverConfig) -> Float[np.ndarray, " sample"]:
    """Counts per field at each sample."""
    time_ns = np.arange(radar.samples) * radar.sample_step_ns - radar.time_zero_ns
    in_ground_ns = np.maximum(time_ns - 2 * receiver.height_m / LIGHT_M_PER_NS, 0.0)
    range_m = 0.5 * receiver.velocity_m_per_ns * in_ground_ns
    rise = (1 + range_m / receiver.height_m) ** 2 * np.exp(2 * receiver.attenuation_per_m * range_m)
    gain = receiver.counts_per_field * receiver.height_m**2 * np.minimum(rise, receiver.gain_limit)
    return np.asarray(gain)


@partial(jax.jit, static_argnames=("radar", "receiver"))
def record_scans(
    key: PRNGKeyArray,
    first_scan: Int[Array, ""],
    ground: GroundSlice,
    antenna_m: Float[Array, "scan channel 3"],
    response: Response,
    noise_field: Float[Array, ""],
    *,
    radar: RadarConfig,
    receiver: ReceiverConfig,
) -> UInt8[Array, "scan channel sample"]:
    """Records a block of scans.

    Args:
        key: of the drive's noise, the same for every block; scan ``first_scan + i`` draws from its own fold.
        antenna_m: (along, cross, height above the ground) of every antenna at its own instant, about the
            slice's origin.
        noise_field: rms of the noise before the time gain.

    Returns:
        Bytes, 128 for silence.
    """
    scans, channels, _ = antenna_m.shape
    place_m = antenna_m.reshape(-1, 3)
    delay_ns = jnp.tile(jnp.asarray(response.delay_ns), scans)
    echoes = place_ground_echoes(ground, place_m, delay_ns, radar=radar)

    height_m = place_m[:, 2:3]
    if not radar.surface_follows_height:
        height_m = jnp.full_like(height_m, receiver.height_m)
    surface = jnp.tile(jnp.asarray(response.surface), scans)[:, None]
    coupling = jnp.tile(jnp.asarray(response.coupling), (scans, 1))
    coupling_ns = jnp.broadcast_to(jnp.asarray(COUPLING_NS, jnp.float32)[None], coupling.shape)
    time_ns = jnp.concatenate([2.0 * height_m / LIGHT_M_PER_NS, coupling_ns], axis=1)
    field = jnp.concatenate([surface * radar.surface_reflection / (2.0 * height_m), coupling], axis=1)
    echoes += place_echoes(time_ns + delay_ns[:, None], field, radar=radar)
    echoes *= jnp.tile(jnp.asarray(response.gain), scans)[:, None]

    # Noise goes through the wavelet too: a stepped-frequency receiver hears nothing outside its band.
    keys = jax.vmap(jax.random.fold_in, (None, 0))(key, first_scan + jnp.arange(scans, dtype=jnp.int32))
    shape = (channels, echoes.shape[1])
    white = jax.vmap(lambda k: jax.random.normal(k, shape, jnp.float32))(keys)
    white_rms = noise_field / float(np.linalg.norm(make_wavelet(radar)))
    traces = convolve_echoes(echoes + white.reshape(echoes.shape) * white_rms, radar=radar)

    counts = ZERO_LEVEL + traces * jnp.asarray(time_gain(radar, receiver), jnp.float32)[None]
    return jnp.clip(jnp.round(counts), 0.0, 255.0).astype(jnp.uint8).reshape(scans, channels, radar.samples)
