"""Signal of an antenna above the ground: single (Born) scattering by buried objects, on refracted rays.

Units: a field of 1 is the radiated field at 1 m in air. A ray tube that spreads over p one way returns l / p**2
from a stone of scattering length l, G / (2 p) from a flat mirror of reflection coefficient G, and
G sqrt(r / (r + n p)) / (2 p) from a cylinder of radius r (in ground of index n the wave's own radius is n p); all
lose exp(-2 a R) on the way R in the ground and the two passages of the surface.

A positive reflectivity is a step to a lighter (faster) material; a positive scattering length is a small object denser
than the soil: it returns the pulse upright, an interface to denser soil turns it over (tests/physics).

Not modelled: multiple scattering, polarisation, the separation of transmitter and receiver (12.7 cm: 0.03 ns
at 0.5 m), waves that run along the surface, and the antenna's near field (0.3 m is a quarter of a wavelength at
250 MHz: echoes come 0.25 ns later straight below in three dimensions, and in two 0.28 ns later still from 0.6 m aside).
One velocity holds for the whole column: a layer's depth is its optical depth.
"""

from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int, PRNGKeyArray, UInt8

from lgprjax.scene.day import Day
from lgprjax.scene.ground import device_value_at
from lgprjax.scene.propagation import (
    LIGHT_M_PER_NS,
    GroundSlice,
    RadarConfig,
    Ray,
    band_spectrum,
    passage,
    refract,
    trace_matrix,
)

Echoes = tuple[Float[Array, "trace echo"], Float[Array, "trace echo"]]
"""Times after transmission (ns) and fields."""


def render_traces(
    ground: GroundSlice, antenna_m: Float[Array, "trace 3"], *, radar: RadarConfig
) -> Float[Array, "trace sample"]:
    """Noise-free traces of the buried ground: no direct coupling, no surface, no receiver.

    Args:
        antenna_m: (along, cross, height above the ground) of each trace, about the slice's origin.
    """
    matrix = trace_matrix(
        radar,
        velocity_m_per_ns=float(ground.velocity_m_per_ns),
        attenuation_per_m=float(ground.attenuation_per_m),
        dispersive_share=float(ground.dispersive_share),
    )
    delay_ns = jnp.zeros(antenna_m.shape[0], antenna_m.dtype)
    return convolve_echoes(_ground_echoes(ground, antenna_m, delay_ns, radar=radar), jnp.asarray(matrix))


def convolve_echoes(
    echoes: Float[Array, "trace bin"], matrix: Float[Array, "bin recorded"]
) -> Float[Array, "trace recorded"]:
    """Converts echoes in time bins to the recorded signal."""
    return jnp.matmul(echoes, matrix, precision=jax.lax.Precision.HIGHEST)


def place_ground_echoes(
    ground: GroundSlice,
    antenna_m: Float[Array, "trace 3"],
    delay_ns: Float[Array, " trace"],
    *,
    radar: RadarConfig,
) -> Float[Array, "trace bin"]:
    """Echoes of all that is buried in time bins, before the wavelet; ``delay_ns`` is the antenna's own."""
    snow_ns, snow_loss, lift_m = snow_over(ground, antenna_m)
    antenna_m = antenna_m.at[:, 2].add(lift_m)
    groups = (
        _stone_echoes(ground, antenna_m, radar),
        _utility_echoes(ground, antenna_m, radar),
        _layer_echoes(ground, antenna_m),
    )
    time_ns = jnp.concatenate([time for time, _ in groups], axis=1)
    field = jnp.concatenate([field for _, field in groups], axis=1)
    return place_echoes(time_ns + (delay_ns + snow_ns)[:, None], field * snow_loss[:, None], radar=radar)


def snow_over(
    ground: GroundSlice, antenna_m: Float[Array, "trace 3"]
) -> tuple[Float[Array, " trace"], Float[Array, " trace"], Float[Array, " trace"]]:
    """Effect of snow: delay of everything below it, its loss, and how much it raises the antenna."""
    index, attenuation, lift, _ = jnp.asarray(ground.cover)
    thickness_m = jnp.maximum(device_value_at(ground.cover_m, antenna_m[:, :2]), 0.0)
    # Near the vertical; snow's index is low, and what comes from far aside is faint.
    return (
        2.0 * thickness_m * (index - 1.0) / LIGHT_M_PER_NS,
        jnp.exp(-2.0 * attenuation * thickness_m),
        lift * thickness_m,
    )


def place_echoes(
    time_ns: Float[Array, "trace echo"], field: Float[Array, "trace echo"], *, radar: RadarConfig
) -> Float[Array, "trace bin"]:
    """Adds each echo to the two bins about its time, in linear shares.

    Linear shares keep an echo's time; half-way between bins they cost 1 - cos(pi f step) of its amplitude: at
    0.16 ns 0.8 % in the middle of the band, 2 % at its upper end.
    """
    traces, bins = time_ns.shape[0], radar.bins
    position = (time_ns + radar.time_zero_ns) / radar.sample_step_ns
    below = jnp.clip(jnp.floor(position), 0.0, bins - 2.0)
    share = position - below
    inside = (share >= 0.0) & (share <= 1.0)  # clipped values are outside the trace
    field = jnp.where(inside, field, 0.0)
    index = below.astype(jnp.int32) + bins * jnp.arange(traces, dtype=jnp.int32)[:, None]
    flat = jnp.zeros(traces * bins, field.dtype)
    flat = flat.at[index.ravel()].add((field * (1.0 - share)).ravel(), mode="promise_in_bounds")
    flat = flat.at[index.ravel() + 1].add((field * share).ravel(), mode="promise_in_bounds")
    return flat.reshape(traces, bins)


def _stone_echoes(ground: GroundSlice, antenna_m: Float[Array, "trace 3"], radar: RadarConfig) -> Echoes:
    stone_m = jnp.asarray(ground.stone_m)
    aside_m = jnp.sqrt(jnp.sum((antenna_m[:, None, :2] - stone_m[None, :, :2]) ** 2, axis=-1))
    ray = refract(aside_m, antenna_m[:, 2:3], stone_m[None, :, 2], _index(ground))
    field = jnp.asarray(ground.stone_strength_m)[None, :] * _way(ground, ray, aside_m, radar)
    field /= ray.spread_m[0] * ray.spread_m[1]
    return _time_ns(ground, ray, jnp.asarray(ground.stone_slowness)[None, :]), field


def _utility_echoes(ground: GroundSlice, antenna_m: Float[Array, "trace 3"], radar: RadarConfig) -> Echoes:
    pipe = ground.utilities
    apart_m = antenna_m[:, None, :2] - jnp.asarray(pipe.centre_m)[None]
    direction = jnp.asarray(pipe.direction)[None]
    beyond_m = jnp.abs(jnp.sum(apart_m * direction, axis=-1)) - jnp.asarray(pipe.half_length_m)[None]
    aside_m = jnp.abs(apart_m[..., 0] * direction[..., 1] - apart_m[..., 1] * direction[..., 0])
    # The ray that meets the wall at a right angle is the one to the axis, less the radius.
    index, radius_m = _index(ground), jnp.asarray(pipe.radius_m)[None]
    depth_m = jnp.broadcast_to(jnp.asarray(pipe.depth_m)[None], aside_m.shape)
    ray = refract(aside_m, antenna_m[:, 2:3], depth_m, index)
    ray = ray._replace(ground_m=jnp.maximum(ray.ground_m - radius_m, 0.05))
    spread_m = ray.air_m + ray.ground_m / index
    ends = jnp.clip(0.5 - beyond_m / 0.3, 0.0, 1.0)  # a cylinder's echo fades out over its end
    shape = jnp.sqrt(radius_m / (radius_m + index * spread_m)) / (2.0 * spread_m)
    field = jnp.asarray(pipe.reflectivity)[None] * ends * shape * _way(ground, ray, aside_m, radar)
    return _time_ns(ground, ray, _slowness_below(ground, antenna_m[:, :2], depth_m)), field


def _layer_echoes(ground: GroundSlice, antenna_m: Float[Array, "trace 3"]) -> Echoes:
    layers, index, place_m = ground.layers, _index(ground), antenna_m[:, :2]
    angle = jnp.einsum("tp,lwp->tlw", place_m, layers.wave_rad_per_m)
    relief_angle = angle + layers.relief_phase_rad[None]
    depth = jnp.asarray(layers.depth_m)[None] + jnp.sum(layers.relief_m[None] * jnp.sin(relief_angle), axis=-1)
    slope = jnp.einsum("tlw,lwp->tlp", layers.relief_m[None] * jnp.cos(relief_angle), layers.wave_rad_per_m)
    # The ray that meets the plane tangent to the interface below the antenna at a right angle: down the normal, bent
    # at the surface. Its angle in the ground is the slope's; a slope past the critical angle is not received.
    cosine = 1.0 / jnp.sqrt(1.0 + jnp.sum(slope**2, axis=-1))
    sine = jnp.minimum(index * jnp.sqrt(1.0 - cosine**2), 0.999)
    height = antenna_m[:, 2:3]
    cos_air = jnp.sqrt(1.0 - sine**2)
    air_m = height / cos_air
    # It runs uphill, where the plane is shallower: by so much at the point where the ray enters the ground.
    aside_m = height * sine / cos_air
    range_m = jnp.maximum(depth - aside_m * jnp.sqrt(1.0 - cosine**2) / cosine, 0.05) * cosine
    waves = layers.reflectivity[None] * jnp.sin(angle + layers.reflectivity_phase_rad[None])
    reflectivity = jnp.asarray(layers.reflectivity_mean)[None] + jnp.sum(waves, axis=-1)
    whole = 1.0 - _in_trench(ground, place_m, depth)
    spread_m = air_m + range_m / index
    ray = Ray(air_m, range_m, cos_air, cosine, (spread_m, spread_m))
    loss = passage(ray, index) * cos_air**2 * jnp.exp(-2.0 * ground.attenuation_per_m * range_m)
    slowness = _slowness_below(ground, place_m, depth)
    return _time_ns(ground, ray, slowness), reflectivity * whole * loss / (2.0 * spread_m)


def _slowness_below(
    ground: GroundSlice, place_m: Float[Array, "trace 2"], depth_m: Float[Array, "trace echo"]
) -> Float[Array, "trace echo"]:
    """Mean slowness of the ground from the surface at the place down to a depth, relative to the day's."""
    moisture = sum(device_value_at(m, place_m) for m in ground.moisture)
    skin_m = jnp.clip(device_value_at(ground.skin_m, place_m)[:, None], 0.0, depth_m)
    return 1.0 + jnp.asarray(moisture)[:, None] + ground.skin_slowness * skin_m / jnp.maximum(depth_m, 0.05)


def _in_trench(
    ground: GroundSlice, place_m: Float[Array, "trace 2"], depth_m: Float[Array, "trace layer"]
) -> Float[Array, "trace layer"]:
    """1 where an interface was dug away, 0 outside, over 0.3 m between."""
    low, high, right, left, deep = (c[None, :] for c in jnp.asarray(ground.trenches).T)
    along, cross = place_m[:, 0:1], place_m[:, 1:2]
    within = jnp.minimum(jnp.minimum(along - low, high - along), jnp.minimum(cross - right, left - cross))
    flat = jnp.clip(0.5 + within / 0.3, 0.0, 1.0)
    dug = jnp.where(depth_m[..., None] < deep[:, None, :], flat[:, None, :], 0.0)
    return jnp.max(dug, axis=-1)


def _index(ground: GroundSlice) -> Float[Array, ""]:
    return LIGHT_M_PER_NS / jnp.asarray(ground.velocity_m_per_ns)


def _way(
    ground: GroundSlice, ray: Ray, aside_m: Float[Array, "trace echo"], radar: RadarConfig
) -> Float[Array, "trace echo"]:
    """Antenna pattern (cosine each way, faded out at the aperture), surface and loss."""
    edge = jnp.clip(4.0 * (1.0 - aside_m / radar.aperture_m), 0.0, 1.0)
    pattern = ray.cos_air**2 * edge**2 * (3.0 - 2.0 * edge)
    return pattern * passage(ray, _index(ground)) * jnp.exp(-2.0 * ground.attenuation_per_m * ray.ground_m)


def _time_ns(ground: GroundSlice, ray: Ray, slowness: Float[Array, "#trace #echo"]) -> Float[Array, "trace echo"]:
    return 2.0 * ray.air_m / LIGHT_M_PER_NS + 2.0 * ray.ground_m * slowness / ground.velocity_m_per_ns


_ground_echoes = partial(jax.jit, static_argnames=("radar",))(place_ground_echoes)


# The radar's own errors: antennas and cables of the array, the day's spread, and what goes wrong during a drive.

# Direct coupling between neighbours, then two reflections of the vehicle: time after transmission and field.
COUPLING_NS = (0.42, 1.6, 3.1)
COUPLING_FIELD = (0.5, -0.2, 0.1)
HARDWARE_SEED = 20  # the same array on every day


@dataclass(frozen=True)
class ReceiverFaults:
    """Faults of the receiver during a drive.

    Attributes:
        gain_drift: relative change of the receiver's gain from the drive's start to its end (it warms up).
        phase_drift_rad: change of the receiver's phase (visible in sweeps only).
        dropped_share: share of scans lost between radar and recorder.
        clipped_share: share of scans received four times too strong.
        interference_share, interference_field: share of scans hit by a transmitter in the band, and its field.
        dead_channels: channels whose antenna is not connected.
    """

    gain_drift: float = 0.05
    phase_drift_rad: float = 0.1
    dropped_share: float = 0.001
    clipped_share: float = 0.001
    interference_share: float = 0.002
    interference_field: float = 0.01
    dead_channels: tuple[int, ...] = ()


NO_FAULTS = ReceiverFaults(
    gain_drift=0.0, phase_drift_rad=0.0, dropped_share=0.0, clipped_share=0.0, interference_share=0.0
)


class Response(NamedTuple):
    """Errors of each channel on one day."""

    gain: Float[np.ndarray, " channel"]
    delay_ns: Float[np.ndarray, " channel"]
    surface: Float[np.ndarray, " channel"]
    coupling: Float[np.ndarray, "channel path"]


class ScanErrors(NamedTuple):
    """Errors of each scan.

    Attributes:
        gain, phase_rad: gain and phase of the receiver.
        interference, interference_mhz: field, 0 for most scans, and frequency of the interference.
    """

    gain: Float[np.ndarray, " scan"]
    phase_rad: Float[np.ndarray, " scan"]
    interference: Float[np.ndarray, " scan"]
    interference_mhz: Float[np.ndarray, " scan"]


def draw_response(day: Day, channels: int, faults: ReceiverFaults) -> Response:
    """The array's errors on a day: a part that belongs to the hardware (coupling) and a part of the day."""
    hardware = np.random.default_rng(HARDWARE_SEED)
    rng = np.random.default_rng([day.seed, 1])
    coupling = np.asarray(COUPLING_FIELD) * (1 + 0.1 * hardware.normal(size=(channels, len(COUPLING_FIELD))))
    gain = 1 + day.gain_spread * rng.normal(size=channels)
    response = Response(
        gain=np.where(np.isin(np.arange(channels), faults.dead_channels), 0.0, gain),
        delay_ns=day.delay_spread_ns * rng.normal(size=channels),
        surface=1 + day.coupling_spread * rng.normal(size=channels),
        coupling=coupling * (1 + day.coupling_spread * rng.normal(size=coupling.shape)),
    )
    return Response(*(a.astype(np.float32) for a in response))


def draw_scan_errors(faults: ReceiverFaults, scans: int, band_mhz: tuple[float, float], seed: int) -> ScanErrors:
    """Drift over the drive, loud scans, interference."""
    rng = np.random.default_rng([seed, 8])
    course = np.linspace(0.0, 1.0, scans)
    # Warming up is quick at first.
    warm = (1 - np.exp(-3 * course)) / (1 - np.exp(-3))
    loud = np.where(rng.uniform(size=scans) < faults.clipped_share, 4.0, 1.0)
    hit = rng.uniform(size=scans) < faults.interference_share
    errors = ScanErrors(
        gain=(1 + faults.gain_drift * warm) * loud,
        phase_rad=faults.phase_drift_rad * warm,
        interference=np.where(hit, faults.interference_field * rng.exponential(size=scans), 0.0),
        interference_mhz=rng.uniform(*band_mhz, scans),
    )
    return ScanErrors(*(a.astype(np.float32) for a in errors))


def kept_scans(faults: ReceiverFaults, scans: int, seed: int) -> np.ndarray:
    """Numbers of the scans that reach the recorder; the first and the last always do."""
    lost = np.random.default_rng([seed, 9]).uniform(size=scans) < faults.dropped_share
    lost[[0, -1]] = False
    return np.flatnonzero(~lost)


def received_echoes(
    ground: GroundSlice,
    place_m: Float[Array, "trace 3"],
    response: Response,
    *,
    radar: RadarConfig,
) -> Float[Array, "trace bin"]:
    """The whole signal of a channel, in time bins: ground, surface, snow, coupling; its gain and delay included.

    Args:
        place_m: (along, cross, height above the ground) of every trace, scan after scan.
    """
    scans = place_m.shape[0] // response.gain.shape[0]
    delay_ns = jnp.tile(jnp.asarray(response.delay_ns), scans)
    echoes = place_ground_echoes(ground, place_m, delay_ns, radar=radar)

    index, _, _, snow_reflectivity = jnp.asarray(ground.cover)
    snow_ns, snow_loss, lift_m = snow_over(ground, place_m)
    height_m = place_m[:, 2] + lift_m
    thickness_m = snow_ns * LIGHT_M_PER_NS / (2.0 * jnp.maximum(index - 1.0, 1e-6))
    moisture = sum(device_value_at(m, place_m[:, :2]) for m in ground.moisture)
    soil = LIGHT_M_PER_NS / ground.velocity_m_per_ns * (1.0 + jnp.asarray(moisture))
    strength = jnp.tile(jnp.asarray(response.surface), scans)
    surface = strength * (index - soil) / (index + soil) * snow_loss / (2.0 * height_m)
    top_m = jnp.maximum(height_m - thickness_m, 0.02)
    snow = strength * snow_reflectivity / (2.0 * top_m)

    coupling = jnp.tile(jnp.asarray(response.coupling), (scans, 1))
    coupling_ns = jnp.broadcast_to(jnp.asarray(COUPLING_NS, jnp.float32)[None], coupling.shape)
    above_ns = jnp.stack([2.0 * height_m / LIGHT_M_PER_NS + snow_ns, 2.0 * top_m / LIGHT_M_PER_NS], axis=1)
    time_ns = jnp.concatenate([above_ns, coupling_ns], axis=1)
    field = jnp.concatenate([jnp.stack([surface, snow], axis=1), coupling], axis=1)
    echoes += place_echoes(time_ns + delay_ns[:, None], field, radar=radar)
    return echoes * jnp.tile(jnp.asarray(response.gain), scans)[:, None]


# A receiver that records traces: noise, gain with time, eight bits.

ZERO_LEVEL = 128


@dataclass(frozen=True)
class ReceiverConfig:
    """Time gain and quantisation.

    The surface echo is a hundred to a thousand times stronger than echoes from 2 m depth; eight bits would lose the
    ground. So the receiver amplifies with time before it quantises (time-varying gain): the gain follows
    p**2 exp(2 a R), the loss of an echo that spread over p = height + R / n after a way R in the ground, up to
    ``gain_limit`` times its value at the surface. It is the same for every trace of every drive.
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
        key: random key of the drive's noise, the same for every block; scan ``first_scan + i`` draws from its own fold.
        antenna_m: (along, cross, height above the ground) of every antenna at its own instant, relative to the slice's
            origin.
        errors: errors of these scans.
        noise_field: rms of the noise before the time gain.
        matrix: matrix from ``trace_matrix``.

    Returns:
        Samples as bytes; 128 is zero signal.
    """
    scans, channels, _ = antenna_m.shape
    echoes = received_echoes(ground, antenna_m.reshape(-1, 3), response, radar=radar)
    traces = convolve_echoes(echoes, matrix).reshape(scans, channels, radar.samples)

    # Noise of the band: a stepped-frequency receiver has no noise outside it.
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


NOISE_STEP_MHZ = 5.0
"""Between the frequencies of the noise: it repeats after 200 ns."""


def _noise_matrix(radar: RadarConfig) -> Float[np.ndarray, "number sample"]:
    """Unit white numbers to noise of unit rms with the band's spectrum."""
    low, high = radar.band_mhz
    frequency_mhz = np.arange(low, high, NOISE_STEP_MHZ) + 0.5 * NOISE_STEP_MHZ
    spectrum = band_spectrum(radar, frequency_mhz)
    angle = 2e-3 * np.pi * np.outer(frequency_mhz, radar.bin_ns[: radar.samples])
    waves = np.concatenate([np.cos(angle) * spectrum[:, None], np.sin(angle) * spectrum[:, None]])
    return np.asarray(waves / np.linalg.norm(spectrum), np.float32)
