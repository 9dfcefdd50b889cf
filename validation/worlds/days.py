"""Recordings of a world's days: echoes of its ground as the receiver of that day writes them.

Time runs from the antenna: direct wave, surface, then the soil's time, stretched by the day's factor. What belongs to
the day alone (snow, wet top soil, clutter, noise, the channels' gains) is drawn anew for each drive.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import scipy.fft
from jaxtyping import Float
from scipy.ndimage import gaussian_filter1d

from validation.worlds.course import Motion, wander
from validation.worlds.ground import (
    LIGHT_M_PER_NS,
    Ground,
    cubic_weights,
    layer_traces,
    point_echoes,
    pulse_of,
    spread_spikes,
    spreading,
)
from validation.worlds.parameters import World

_BLOCK_TRACES = 8192


@dataclass(frozen=True)
class Weather:
    """What a day does to the waves: 0 and 1 throughout on a clear one."""

    delay_ns: float = 0.0
    loss_db: float = 0.0
    noise_db: float = 0.0
    snow_clutter: float = 0.0
    time_scale: float = 1.0
    drift: float = 0.0
    loss_factor: float = 1.0
    wet_top: bool = False


class Recording(NamedTuple):
    """Traces as stored, and how.

    Attributes:
        traces: uint8 or int16.
        zero_level: stored value of no signal.
        time_zero_ns: travel time zero after the first sample.
        time_scale: the day's factor at every scan.
        signal_db: ground over noise, RMS over the soil's time, in decibels.
    """

    traces: np.ndarray
    zero_level: float
    time_zero_ns: float
    time_scale: Float[np.ndarray, " scan"]
    signal_db: Float[np.ndarray, " sample"]


def weather_of(world: World, day: str) -> Weather:
    """Of a day by name; days without weather are clear."""
    if day == "snow":
        return Weather(world.snow_delay_ns, world.snow_loss_db, world.snow_noise_db, world.snow_clutter)
    if day == "rain":
        return Weather(
            time_scale=world.rain_scale, drift=world.rain_drift, loss_factor=world.rain_loss, wet_top=True, noise_db=0.5
        )
    return Weather()


def time_zero_ns(world: World) -> float:
    """A period and a half is recorded before the pulse leaves."""
    return 1.5 * world.period_ns


def decay(world: World, soil_ns: np.ndarray, loss_factor: float) -> np.ndarray:
    """Loss of an echo, without its spreading, by the path that it took in the soil."""
    wavelengths = soil_ns / world.period_ns
    return np.asarray(10.0 ** (-world.loss_db_per_wavelength * loss_factor * wavelengths / 20.0))


def noise_level(world: World) -> float:
    """RMS of the noise of a clear day, before the receiver's gain."""
    half_ns = 0.5 * world.samples * world.sample_interval_ns
    signal = decay(world, np.asarray(half_ns), 1.0) * spreading(world, half_ns)
    return float(signal * np.hypot(1.0, world.points_share) * 10.0 ** (-world.snr_half_db / 20.0))


def record(world: World, ground: Ground, motion: Motion, weather: Weather, rng: np.random.Generator) -> Recording:
    """The traces of a drive.

    Args:
        world: its radar and soil.
        ground: that it passes over.
        motion: where its antennas are.
        weather: of the day.
        rng: of everything that is this drive's own.
    """
    scans, channels = motion.antenna_left_m.shape
    along = motion.antenna_at_m[:, 0] / world.route_m
    scale = weather.time_scale + weather.drift * np.sin(2.0 * np.pi * (along + rng.uniform()))
    permanent = np.random.default_rng([world.seed, 3])
    echoes = _ground_echoes(world, ground, motion, weather, scale, rng)
    echoes += _direct_and_surface(world, motion, weather, permanent, rng)
    gain = np.exp(0.08 * permanent.standard_normal(channels) + 0.05 * rng.standard_normal(channels))
    jitter = 0.01 * permanent.standard_normal(channels) + 0.008 * rng.standard_normal(channels)
    late_ns = np.asarray(world.period_ns * jitter)
    received = _through_pulse(world, echoes.reshape(scans, channels, -1), gain, late_ns)[..., : world.samples]
    level = noise_level(world) * 10.0 ** (weather.noise_db / 20.0)
    received += level * _noise(world, rng, received.shape)
    loud = rng.uniform(size=scans) < 0.006
    received[loud] += 12.0 * level * _noise(world, rng, received[loud].shape)
    axis_ns = np.arange(world.samples) * world.sample_interval_ns - time_zero_ns(world)
    soil_ns = np.maximum(axis_ns - 2.0 * world.height_m / LIGHT_M_PER_NS, 0.0)
    signal = decay(world, soil_ns, weather.loss_factor) * spreading(world, soil_ns) * np.hypot(1.0, world.points_share)
    signal_db = 20.0 * np.log10(signal / level) - weather.loss_db
    stored, zero = _stored(world, received, soil_ns)
    return Recording(stored, zero, time_zero_ns(world), scale, signal_db)


def _ground_echoes(
    world: World,
    ground: Ground,
    motion: Motion,
    weather: Weather,
    scale: Float[np.ndarray, " scan"],
    rng: np.random.Generator,
) -> Float[np.ndarray, "trace sample"]:
    """Reflectivity over recorded time: layers and scatterers, and what the day puts among them."""
    scans, channels = motion.antenna_left_m.shape
    dt, size = world.sample_interval_ns, (scans * channels, world.samples)
    antenna = motion.antenna_m.reshape(-1, 3)
    surface_ns = 2.0 * antenna[:, 2] / LIGHT_M_PER_NS + weather.delay_ns
    stretch = np.repeat(scale, channels)
    begin = (time_zero_ns(world) + surface_ns) / dt
    echoes = np.empty(size, dtype=np.float32)
    for low in range(0, size[0], _BLOCK_TRACES):
        part = slice(low, low + _BLOCK_TRACES)
        layers = layer_traces(ground, motion.antenna_at_m.ravel()[part], motion.antenna_left_m.ravel()[part])
        echoes[part] = _stretched(layers, begin[part], stretch[part])
    sample = (np.arange(world.samples)[None] - begin[:, None]) / stretch[:, None]
    periods = np.maximum(sample, 0.0).astype(np.float32) / world.samples_per_period
    below = sample >= 0.0
    near = world.wavelength_m / world.scan_spacing_m
    if weather.wet_top:
        # The wetting front: what lies above it sounds new, for two periods or so.
        share = np.where(below, 0.9 * np.exp(-((periods / 2.5) ** 2)), 0.0).astype(np.float32)
        echoes = np.sqrt(1.0 - share**2) * echoes + share * _day_field(world, rng, scans, channels, 0.5 * near)
    clutter = world.clutter * _day_field(world, rng, scans, channels, 0.4 * near)
    if weather.snow_clutter:
        envelope = weather.snow_clutter * np.exp(-periods / 2.0)
        clutter += np.where(below, envelope, 0.0) * _day_field(world, rng, scans, channels, 0.3 * near)
    soil_ns = periods * np.float32(world.period_ns)
    echoes = (echoes + clutter * below) * spreading(world, soil_ns) * decay(world, soil_ns, weather.loss_factor)
    found = point_echoes(world, ground.points, antenna, stretch)
    lost = decay(world, found.soil_ns / stretch[found.trace], weather.loss_factor)
    at = (time_zero_ns(world) + weather.delay_ns + found.air_ns + found.soil_ns) / dt
    echoes += spread_spikes(size, found.trace, at, found.amplitude * lost)
    return np.asarray(echoes * 10.0 ** (-weather.loss_db / 20.0), dtype=np.float32)


def _stretched(
    layers: Float[np.ndarray, "trace sample"], begin: Float[np.ndarray, " trace"], stretch: Float[np.ndarray, " trace"]
) -> Float[np.ndarray, "trace sample"]:
    """Layers on recorded time: soil sample u is heard at ``begin + stretch * u``; nothing before the surface."""
    samples = layers.shape[1]
    at = (np.arange(samples)[None] - begin[:, None]) / stretch[:, None]
    low = np.floor(at).astype(np.int32)
    weights = cubic_weights(at - low)
    out = np.zeros(layers.shape)
    for tap in range(4):
        index = low + tap - 1
        known = (index >= 0) & (index < samples)
        out += np.where(known, weights[..., tap], 0.0) * np.take_along_axis(layers, np.clip(index, 0, samples - 1), 1)
    return out


def _day_field(
    world: World, rng: np.random.Generator, scans: int, channels: int, smooth: float
) -> Float[np.ndarray, "trace sample"]:
    """Reflectivity that belongs to this drive: alike over ``smooth`` scans and as far across; RMS as the layers'."""
    field = rng.standard_normal((scans, channels, world.samples), dtype=np.float32)
    field = gaussian_filter1d(field, max(smooth, 0.5), axis=0)
    across = smooth * world.scan_spacing_m / world.pitch_m
    if channels > 1 and across > 0.3:
        field = gaussian_filter1d(field, across, axis=1)
    return np.asarray(field / np.float32(field.std())).reshape(scans * channels, world.samples)


def _direct_and_surface(
    world: World, motion: Motion, weather: Weather, permanent: np.random.Generator, rng: np.random.Generator
) -> Float[np.ndarray, "trace sample"]:
    """The direct wave with its ringing, drifting by some percent; the surface return, which moves with the bounce."""
    scans, channels = motion.antenna_left_m.shape
    size = (scans * channels, world.samples)
    trace = np.arange(size[0])
    dt, begin = world.sample_interval_ns, time_zero_ns(world) / world.sample_interval_ns
    out = np.zeros(size, dtype=np.float32)
    drift = 1.0 + 0.02 * wander(rng, scans, 0.25 * scans)
    for ring in range(4):
        strength = 0.8 * world.coupling * 0.35**ring * (1.0 + 0.2 * permanent.standard_normal(channels))
        late = ring * 0.8 + 0.05 * permanent.standard_normal(channels)
        at = np.tile(begin + world.samples_per_period * (0.1 + late), scans)
        out += spread_spikes(size, trace, at, (drift[:, None] * strength).ravel())
    height = motion.antenna_m[..., 2]
    rough = wander(rng, size[0], 2.0 * channels).reshape(scans, channels)
    returned = -world.coupling * (1.0 + 0.05 * rough) * (world.height_m / height) ** 0.5
    surface = np.asarray(returned).ravel()
    if weather.delay_ns:
        # Snow returns some of it early, from its own top.
        top = begin + (2.0 * height.ravel() / LIGHT_M_PER_NS - 2.0 * weather.delay_ns) / dt
        out += spread_spikes(size, trace, top, 0.3 * surface)
        surface = 0.7 * surface
    at = begin + (2.0 * height.ravel() / LIGHT_M_PER_NS + weather.delay_ns) / dt
    return np.asarray(out + spread_spikes(size, trace, at, surface))


def _through_pulse(
    world: World,
    echoes: Float[np.ndarray, "scan channel sample"],
    gain: Float[np.ndarray, " channel"],
    late_ns: Float[np.ndarray, " channel"],
) -> Float[np.ndarray, "scan channel sample"]:
    """Echoes as pulses, each channel with its own gain and delay."""
    pulse = pulse_of(world)
    padded = scipy.fft.next_fast_len(echoes.shape[-1] + len(pulse), real=True)
    centred = np.roll(np.pad(pulse, (0, padded - len(pulse))), -(len(pulse) // 2))
    turn = -2j * np.pi * np.outer(late_ns, scipy.fft.rfftfreq(padded, world.sample_interval_ns))
    response = (gain[:, None] * np.exp(turn) * scipy.fft.rfft(centred)).astype(np.complex64)
    out = np.empty_like(echoes)
    for low in range(0, len(echoes), 256):
        spectrum = scipy.fft.rfft(echoes[low : low + 256], n=padded, axis=-1)
        out[low : low + 256] = scipy.fft.irfft(spectrum * response, n=padded, axis=-1)[..., : echoes.shape[-1]]
    return out


def _noise(world: World, rng: np.random.Generator, shape: tuple[int, ...]) -> Float[np.ndarray, "scan channel sample"]:
    """Unit RMS: white, or of the antenna's band with a little of the low frequencies that dewow is there for."""
    noise = rng.standard_normal(shape, dtype=np.float32)
    if not world.coloured_noise or not noise.size:
        return noise
    frequency = scipy.fft.rfftfreq(shape[-1], world.sample_interval_ns) * world.period_ns
    band = np.exp(-(((frequency - 1.0) / 0.6) ** 2)) + 1.5 * np.exp(-((frequency / 0.08) ** 2))
    coloured = scipy.fft.irfft(scipy.fft.rfft(noise, axis=-1) * band.astype(np.float32), n=shape[-1], axis=-1)
    return np.asarray(coloured / coloured.std(), dtype=np.float32)


def _stored(
    world: World, received: Float[np.ndarray, "scan channel sample"], soil_ns: Float[np.ndarray, " sample"]
) -> tuple[np.ndarray, float]:
    """Through the receiver's gain over time into bytes or words; the strongest hundred-thousandth is clipped."""
    loss = decay(world, soil_ns, 1.0) * spreading(world, soil_ns)
    # A gain that went on rising would lift noise alone.
    floor = loss[int(0.7 * world.samples)]
    amplified = received * (np.maximum(loss, floor) ** -world.gain_share).astype(np.float32)
    kind = np.dtype(world.encoding)
    zero, most = (128.0, 127.0) if kind == np.uint8 else (0.0, 30_000.0)
    peak = np.quantile(np.abs(amplified[:: max(len(amplified) // 400, 1)]), 0.99999)
    return np.clip(np.rint(amplified * (most / peak)) + zero, *_limits(kind)).astype(kind), zero


def _limits(kind: np.dtype) -> tuple[int, int]:
    return np.iinfo(kind).min, np.iinfo(kind).max
