"""The ground of a world: layered random contrasts, continuous interfaces, point scatterers and dipping lines.

Units of time are nanoseconds of two-way travel within the soil on a clear day. The random layers are laid out along and
across the route, and what an antenna hears of them is limited by its beam: an echo from the angle theta in the soil
varies along the surface with the wavenumber 2 k sin(theta), so the spectrum of the layers is cut off as the beam is.
Scatterers have their exact two-way path instead: straight to the surface and from there, broken by Snell's law.
"""

from typing import NamedTuple

import numpy as np
import scipy.fft
import scipy.sparse
from jaxtyping import Float
from scipy.ndimage import gaussian_filter, gaussian_filter1d
from scipy.signal import fftconvolve, lfilter
from scipy.spatial import cKDTree

from validation.worlds.course import Centreline
from validation.worlds.parameters import World

LIGHT_M_PER_NS = 0.299792458
_CELLS_PER_WAVELENGTH = 5.0
_ENDS_M = 6.0
_HEAVY_TAIL_FREEDOM = 3.0
_WEAKEST = 0.04
_BLOCK_PAIRS = 65_536
_LOUDEST_SPIKE = 8.0  # its pulse peaks at half of it


class Scatterers(NamedTuple):
    """Point scatterers: place, depth and amplitude at one wavelength of path."""

    east_m: Float[np.ndarray, " point"]
    north_m: Float[np.ndarray, " point"]
    depth_m: Float[np.ndarray, " point"]
    amplitude: Float[np.ndarray, " point"]


class Ground(NamedTuple):
    """Reflectivity of a world's ground.

    Attributes:
        layers: of the random layers, [place along, place across] flattened, over soil time in recorded samples; the
            pulse makes an RMS of 1 of it.
        along_m, across_m: of the first place; ``step_m`` between places.
        shape: places along and across.
        points: scatterers.
    """

    layers: Float[np.ndarray, "place sample"]
    along_m: float
    across_m: float
    step_m: float
    shape: tuple[int, int]
    points: Scatterers


def pulse_of(world: World) -> Float[np.ndarray, " tap"]:
    """Zero-phase pulse of unit energy, an odd number of samples: Ricker, Gabor, or a compressed chirp."""
    reach = 2 * world.samples_per_period
    time = np.arange(-reach, reach + 1) / world.samples_per_period
    if world.pulse == "ricker":
        shape = (1.0 - 2.0 * (np.pi * time) ** 2) * np.exp(-((np.pi * time) ** 2))
    elif world.pulse == "gabor":
        shape = np.cos(2.0 * np.pi * time) * np.exp(-((time / 0.65) ** 2))
    else:
        # A sweep over one octave about the centre, compressed, its sidelobes held by a raised cosine.
        shape = np.cos(2.0 * np.pi * time) * np.sinc(0.9 * time) * np.cos(0.25 * np.pi * time) ** 2
    shape -= shape.mean()
    return np.asarray(shape / np.sqrt(np.sum(shape**2)))


def make_ground(world: World, line: Centreline, seed: int, period_m: float = 0.0, memory: float = 0.0) -> Ground:
    """The ground under a route; with ``period_m`` it repeats itself along the route.

    Args:
        world: what it is made of.
        line: the route's middle.
        seed: of this ground.
        period_m: of the repetition, rounded to whole cells.
        memory: correlation of the contrasts from one period to the next.
    """
    rng = np.random.default_rng([world.seed, 2, seed])
    step = world.wavelength_m / _CELLS_PER_WAVELENGTH
    swing = 0.0 if world.radius_m == 0.0 else world.antenna_x_m**2 / (2.0 * world.radius_m)
    side = world.half_width_m + weave_m(world) + swing + 0.1 * world.half_width_m + 4.0 * step
    start = -_ENDS_M
    shape = (int((world.route_m + 2.0 * _ENDS_M) / step), int(2.0 * side / step))
    cells = round(period_m / step)
    layers = _random_layers(world, rng, step, shape, cells, memory)
    if not cells:
        _add_horizons(world, rng, layers, shape)
    layers = np.ascontiguousarray(np.moveaxis(layers, 0, -1)).reshape(shape[0] * shape[1], -1)
    heard = fftconvolve(layers[:: max(len(layers) // 2000, 1)], pulse_of(world)[None], mode="same", axes=1)
    layers /= np.float32(np.sqrt(np.mean(heard**2)))
    points = _draw_points(world, rng, line, (start, world.route_m + _ENDS_M), side, cells * step, memory)
    ground = Ground(layers, start, -side, step, shape, points)
    return ground._replace(points=_balanced(world, line, ground))


def weave_m(world: World) -> float:
    """How far drives swing to each side of their line: a fraction of what lies between the map's lines."""
    return float(np.clip(0.3 * world.pitch_m, 0.01, 0.05))


def layer_traces(
    ground: Ground, at_m: Float[np.ndarray, " trace"], left_m: Float[np.ndarray, " trace"]
) -> Float[np.ndarray, "trace sample"]:
    """Reflectivity of the layers below places beside the route, by cubic convolution between the four nearest each way.

    Raises:
        ValueError: a place lies beyond the ground.
    """
    along, across = (at_m - ground.along_m) / ground.step_m, (left_m - ground.across_m) / ground.step_m
    rows, columns = np.floor(along).astype(int), np.floor(across).astype(int)
    for cell, size in ((rows, ground.shape[0]), (columns, ground.shape[1])):
        if cell.min() < 1 or cell.max() > size - 3:
            raise ValueError(f"places in cells {cell.min()} to {cell.max()} of {size}")
    down, beside = cubic_weights(along - rows), cubic_weights(across - columns)
    weights = (down[:, :, None] * beside[:, None, :]).reshape(len(rows), 16)
    taps = np.arange(-1, 3)
    index = (rows[:, None] + taps)[:, :, None] * ground.shape[1] + (columns[:, None] + taps)[:, None, :]
    starts = np.arange(0, 16 * len(rows) + 1, 16)
    matrix = scipy.sparse.csr_array(
        (weights.astype(np.float32).ravel(), index.ravel(), starts), shape=(len(rows), len(ground.layers))
    )
    return np.asarray(matrix @ ground.layers)


def cubic_weights(part: np.ndarray) -> np.ndarray:
    """Weights of the four neighbours (Keys, a = -1/2) of points a ``part`` of a step past the second."""
    p = part[..., None]
    near, far = np.concatenate([p, 1.0 - p], axis=-1), np.concatenate([1.0 + p, 2.0 - p], axis=-1)
    inner = 1.5 * near**3 - 2.5 * near**2 + 1.0
    outer = -0.5 * far**3 + 2.5 * far**2 - 4.0 * far + 2.0
    return np.concatenate([outer[..., :1], inner, outer[..., 1:]], axis=-1)


def two_way_path(
    offset_m: np.ndarray, depth_m: np.ndarray, height_m: np.ndarray, velocity_m_per_ns: np.ndarray | float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """From an antenna in air to a point in the soil and back.

    Args:
        offset_m, depth_m: the point's distance along the surface, and depth.
        height_m: of the antenna.
        velocity_m_per_ns: in the soil.

    Returns:
        time in air and time in the soil, both ways, and the sine of the angle in the soil.
    """
    ratio = velocity_m_per_ns / LIGHT_M_PER_NS
    # The offset is concave in the slope of the path in air: from its tangent at zero, Newton climbs to the root.
    slope = offset_m / (height_m + depth_m * ratio)
    for _ in range(6):
        root = np.sqrt(1.0 + slope**2)
        sine = ratio * slope / root
        cosine = np.sqrt(1.0 - sine**2)
        reached = height_m * slope + depth_m * sine / cosine
        rate = height_m + depth_m * ratio / (root**3 * cosine**3)
        slope = slope + (offset_m - reached) / rate
    root = np.sqrt(1.0 + slope**2)
    sine = ratio * slope / root
    air = 2.0 * height_m * root / LIGHT_M_PER_NS
    return air, 2.0 * depth_m / (np.sqrt(1.0 - sine**2) * velocity_m_per_ns), sine


class Echoes(NamedTuple):
    """Echoes of scatterers: in which trace, times in air and in the soil, amplitude before loss."""

    trace: np.ndarray
    air_ns: np.ndarray
    soil_ns: np.ndarray
    amplitude: np.ndarray


def point_echoes(
    world: World,
    points: Scatterers,
    antenna_m: Float[np.ndarray, "trace 3"],
    time_scale: Float[np.ndarray, " trace"],
) -> Echoes:
    """Echoes of every scatterer in every trace whose beam reaches it; spreading falls with the path's length.

    Args:
        world: the beam and the speed.
        points: the scatterers.
        antenna_m: east, north and height above the ground.
        time_scale: how much slower the wave is than on a clear day.
    """
    steepest = 0.99 * world.velocity_m_per_ns / LIGHT_M_PER_NS
    widest = min(world.beam_sine * np.sqrt(-np.log2(_WEAKEST)), steepest)
    # In air a refracted path runs flatter; what an antenna this low gains by it is a few heights.
    reach = points.depth_m * widest / np.sqrt(1.0 - widest**2) + 2.0 * antenna_m[:, 2].max()
    near = cKDTree(antenna_m[:, :2]).query_ball_point(np.stack([points.east_m, points.north_m], axis=-1), reach)
    counts = np.array([len(found) for found in near])
    points_heard = np.repeat(np.arange(len(counts)), counts)
    traces = np.concatenate([np.asarray(found, dtype=int) for found in near])
    parts = []
    for low in range(0, len(traces), _BLOCK_PAIRS):
        trace, point = traces[low : low + _BLOCK_PAIRS], points_heard[low : low + _BLOCK_PAIRS]
        offset = np.hypot(antenna_m[trace, 0] - points.east_m[point], antenna_m[trace, 1] - points.north_m[point])
        velocity = world.velocity_m_per_ns / time_scale[trace]
        air, soil, sine = two_way_path(offset, points.depth_m[point], antenna_m[trace, 2], velocity)
        path = 0.5 * (air * LIGHT_M_PER_NS + soil * velocity)
        beam = 0.5 ** ((sine / world.beam_sine) ** 2)
        amplitude = points.amplitude[point] * beam * world.wavelength_m / np.maximum(path, 0.5 * world.wavelength_m)
        parts.append((air, soil, amplitude))
    if not parts:
        return Echoes(traces, np.zeros(0), np.zeros(0), np.zeros(0))
    return Echoes(traces, *(np.concatenate(column) for column in zip(*parts, strict=True)))


def spread_spikes(
    size: tuple[int, int], trace: np.ndarray, sample: np.ndarray, amplitude: np.ndarray
) -> Float[np.ndarray, "trace sample"]:
    """Spikes between samples, each as the four samples whose band-limited sum it is."""
    first = np.floor(sample).astype(int)
    inside = (first >= 1) & (first < size[1] - 2)
    trace, first, amplitude = trace[inside], first[inside], amplitude[inside]
    weights = cubic_weights(sample[inside] - first) * amplitude[:, None]
    index = (trace * size[1] + first - 1)[:, None] + np.arange(4)
    summed = np.bincount(index.ravel(), weights.ravel(), minlength=size[0] * size[1])
    return summed.reshape(size).astype(np.float32)


def _random_layers(
    world: World, rng: np.random.Generator, step: float, shape: tuple[int, int], cells: int, memory: float
) -> Float[np.ndarray, "sample along across"]:
    """Contrasts whose spectrum along the surface is von Karman's (exponent 1/2), cut off by the beam."""
    length = world.correlation_wavelengths * world.wavelength_m
    padded = tuple(scipy.fft.next_fast_len(size + int(2.0 * length / step) + 8, real=True) for size in shape)
    along = 2.0 * np.pi * np.fft.fftfreq(padded[0], step)[:, None]
    across = 2.0 * np.pi * np.fft.rfftfreq(padded[1], step)[None, :]
    karman = (1.0 + (along * length) ** 2 + (across * length * world.anisotropy) ** 2) ** -0.75
    sine = np.hypot(along, across) * world.wavelength_m / (4.0 * np.pi)
    response = (karman * 0.5 ** ((sine / world.beam_sine) ** 2)).astype(np.float32)
    # What is the same under the whole route says nothing of a place.
    response[0, 0] = 0.0
    keep = np.exp(-1.0 / (world.vertical_periods * world.samples_per_period))
    strengths = _strengths(world, rng)
    layers = np.empty((world.samples, *shape), dtype=np.float32)
    last = np.zeros(padded, dtype=np.float32)
    patches = [_patches(rng, shape, length / step) for _ in range(2)] if world.law == "heavy" else []
    every = 2 * world.samples_per_period
    for sample in range(world.samples):
        noise = _noise(world, rng, padded, cells, memory)
        fresh = scipy.fft.irfft2(scipy.fft.rfft2(noise) * response, s=padded)
        last = np.float32(keep) * last + np.float32(np.sqrt(1.0 - keep**2)) * fresh
        layers[sample] = last[: shape[0], : shape[1]] * strengths[sample]
        if patches and not cells:
            part = (sample % every) / every
            if sample and sample % every == 0:
                patches = [patches[1], _patches(rng, shape, length / step)]
            layers[sample] *= np.exp((1.0 - part) * patches[0] + part * patches[1])
    return layers


def _noise(
    world: World, rng: np.random.Generator, shape: tuple[int, ...], cells: int, memory: float
) -> Float[np.ndarray, "along across"]:
    heavy = world.law == "heavy"
    if not cells:
        drawn = rng.standard_t(_HEAVY_TAIL_FREEDOM, shape) if heavy else rng.standard_normal(shape, dtype=np.float32)
        return np.asarray(drawn, dtype=np.float32)
    # Each period is the one before, with a share that is new.
    periods = -(-shape[0] // cells)
    drawn = rng.standard_normal((periods, cells, shape[1]), dtype=np.float32)
    drawn[1:] *= np.float32(np.sqrt(1.0 - memory**2))
    repeated = lfilter([1.0], [1.0, -memory], drawn, axis=0)
    return np.asarray(repeated.reshape(-1, shape[1])[: shape[0]], dtype=np.float32)


def _patches(rng: np.random.Generator, shape: tuple[int, int], cells: float) -> Float[np.ndarray, "along across"]:
    """Logarithm of the strength of contrasts from place to place, of deviation 0.7."""
    smooth = gaussian_filter(rng.standard_normal(shape, dtype=np.float32), 2.0 * cells + 2.0, mode="wrap")
    return np.asarray(0.7 * smooth / max(float(smooth.std()), 1e-6), dtype=np.float32)


def _strengths(world: World, rng: np.random.Generator) -> Float[np.ndarray, " sample"]:
    """Of the contrasts over depth: strata of two to eight periods, each of its own strength."""
    strength = np.empty(world.samples, dtype=np.float32)
    sample = 0
    while sample < world.samples:
        thick = int(rng.uniform(2.0, 8.0) * world.samples_per_period)
        strength[sample : sample + thick] = np.exp(0.45 * rng.standard_normal())
        sample += thick
    return np.asarray(gaussian_filter1d(strength, 0.3 * world.samples_per_period))


def _add_horizons(
    world: World,
    rng: np.random.Generator,
    layers: Float[np.ndarray, "sample along across"],
    shape: tuple[int, int],
) -> None:
    """Continuous interfaces, gently undulating, of varying strength: three to five times the contrasts about them."""
    level = float(np.sqrt(np.mean(layers[:: max(world.samples // 16, 1)] ** 2)))
    places = np.indices(shape)
    for _ in range(world.horizons):
        depth = rng.uniform(2.0, 0.75 * world.samples / world.samples_per_period) * world.samples_per_period
        undulation, strength = (_surface(rng, shape, 3.0 * _CELLS_PER_WAVELENGTH) for _ in range(2))
        at = depth + 0.35 * world.samples_per_period * undulation
        low = np.clip(np.floor(at).astype(int), 0, world.samples - 2)
        amplitude = rng.choice([-1.0, 1.0]) * rng.uniform(3.0, 5.0) * level * (1.0 + 0.6 * strength)
        part = at - low
        layers[low, places[0], places[1]] += (amplitude * (1.0 - part)).astype(np.float32)
        layers[low + 1, places[0], places[1]] += (amplitude * part).astype(np.float32)


def _surface(rng: np.random.Generator, shape: tuple[int, int], cells: float) -> Float[np.ndarray, "along across"]:
    """Smooth noise of unit variance."""
    smooth = gaussian_filter(rng.standard_normal([size + int(8 * cells) for size in shape]), cells, mode="wrap")
    return np.asarray((smooth / smooth.std())[: shape[0], : shape[1]])


def _draw_points(
    world: World,
    rng: np.random.Generator,
    line: Centreline,
    along: tuple[float, float],
    side: float,
    period_m: float,
    memory: float,
) -> Scatterers:
    """Stones anywhere, and lines of points (pipes, roots, cable trenches) that dip by up to 25 degrees."""
    wavelength, (low, high) = world.wavelength_m, along
    window_m = 0.5 * world.samples * world.sample_interval_ns * world.velocity_m_per_ns
    side, length = side + 2.0 * wavelength, high - low
    span = period_m or length
    count = max(int(world.points_per_wavelength2 * span * 2.0 * side / wavelength**2), 1)
    at, left = low + span * rng.uniform(size=count), rng.uniform(-side, side, count)
    depth = rng.uniform(0.5 * wavelength, 0.8 * window_m, count)
    amplitude = rng.choice([-1.0, 1.0], count) * np.exp(0.6 * rng.standard_normal(count))
    parts = [(at, left, depth, amplitude)]
    rods = rng.poisson(world.rods * span * 2.0 * side / (100.0 * wavelength**2))
    for _ in range(rods):
        reach = rng.uniform(1.0, 4.0) * wavelength
        beside = np.arange(-0.5 * reach, 0.5 * reach, wavelength / 4.0)
        strike, dip = rng.uniform(-np.pi, np.pi), np.radians(rng.uniform(-25.0, 25.0))
        middle = (low + span * rng.uniform(), rng.uniform(-side, side), rng.uniform(wavelength, 0.6 * window_m))
        strength = rng.choice([-1.0, 1.0]) * 0.6 * np.exp(0.4 * rng.standard_normal())
        rod = middle[2] + np.sin(dip) * beside
        parts.append(
            (
                middle[0] + np.cos(dip) * np.cos(strike) * beside,
                middle[1] + np.cos(dip) * np.sin(strike) * beside,
                np.maximum(rod, 0.3 * wavelength),
                np.full(len(beside), strength),
            )
        )
    at, left, depth, amplitude = (np.concatenate(column) for column in zip(*parts, strict=True))
    if period_m:
        repeats = int(length / period_m) + 1
        fresh = rng.choice([-1.0, 1.0], (repeats, len(at))) * np.abs(amplitude)
        fresh[0] = amplitude
        fresh[1:] *= np.sqrt(1.0 - memory**2)
        amplitude = lfilter([1.0], [1.0, -memory], fresh, axis=0).ravel()
        at = (at + period_m * np.arange(repeats)[:, None]).ravel()
        left, depth = np.tile(left, repeats), np.tile(depth, repeats)
    east, north, _ = line.place(at, left)
    return Scatterers(east, north, depth, amplitude)


def _balanced(world: World, line: Centreline, ground: Ground) -> Scatterers:
    """The scatterers, their echoes brought to the share of the layers' RMS that the world says.

    Compared where both spread alike, along the route's middle. Where few are heard the typical one is not raised above
    some four times the layers' RMS: one stone must not be the whole ground.
    """
    at = np.linspace(0.0, world.route_m, 200)
    east, north, _ = line.place(at, np.zeros_like(at))
    antenna = np.stack([east, north, np.full_like(at, world.height_m)], axis=-1)
    echoes = point_echoes(world, ground.points, antenna, np.ones(len(at)))
    heard = echoes.soil_ns < world.samples * world.sample_interval_ns
    amplitude = np.abs(echoes.amplitude / spreading(world, echoes.soil_ns))[heard]
    if not len(amplitude):
        return ground.points
    # The pulse has unit energy: a spike's power is its square.
    scale = world.points_share / np.sqrt(np.sum(amplitude**2) / (len(at) * world.samples))
    scale = min(scale, _LOUDEST_SPIKE / float(np.median(amplitude)))
    return ground.points._replace(amplitude=ground.points.amplitude * scale)


def spreading(world: World, soil_ns: np.ndarray | float) -> np.ndarray:
    """Of the layers' echoes: one over the path, from two wavelengths (the reach of the near field) on."""
    near = 2.0 * world.wavelength_m
    return np.asarray(near / (near + 0.5 * np.asarray(soil_ns) * world.velocity_m_per_ns))
