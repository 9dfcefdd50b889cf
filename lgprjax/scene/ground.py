"""A corridor of ground that never changes: stones and rough layers, everything from one seed.

The ground lives in the *road frame*: ``along`` points local east, ``cross`` local north, ``depth`` down from
a flat surface. It is host data in float64; ``slice_ground`` cuts the part a block of scans can see and brings
it to the block's own origin, so that float32 on the device resolves it after kilometres as at the start.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Float


@dataclass(frozen=True)
class GroundConfig:
    """What the ground is made of. Strengths are in the units of ``render`` (field relative to 1 m of air).

    Attributes:
        length_m, margin_m, half_width_m: the corridor is along in [-margin, length + margin], cross in
            [-half_width, half_width].
        stones_per_m2: stones under a square metre of surface, all depths together.
        stone_depth_m: shallowest and deepest stone; between them the density falls as exp(-depth / scale).
        stone_strength_m: median scattering length; log-normal with ``stone_strength_spread`` (sigma of ln).
        layer_depth_m: mean depths of the interfaces.
        layer_relief_m: rms of an interface's depth about its mean; the slopes are alike at every wavelength.
        layer_reflectivity: rms reflection coefficient; half its power is the mean, half changes with place.
        wavelength_m, waves: range and number of the sinusoids that make up relief and reflectivity.
        velocity_m_per_ns, attenuation_per_m: of the wave in the ground (amplitude, one way).
    """

    length_m: float = 200.0
    margin_m: float = 12.0
    half_width_m: float = 4.0
    stones_per_m2: float = 14.0
    stone_depth_m: tuple[float, float] = (0.15, 2.5)
    stone_depth_scale_m: float = 1.5
    stone_strength_m: float = 0.012
    stone_strength_spread: float = 0.6
    layer_depth_m: tuple[float, ...] = (0.45, 0.95, 1.7)
    layer_relief_m: float = 0.08
    layer_reflectivity: float = 0.025
    wavelength_m: tuple[float, float] = (0.3, 10.0)
    waves: int = 24
    velocity_m_per_ns: float = 0.1
    attenuation_per_m: float = 0.7


class Layers(NamedTuple):
    """Interfaces as sums of sinusoids: value = mean + sum(amplitude * sin(k . place + phase))."""

    depth_m: Float[np.ndarray, " layer"]
    wave_rad_per_m: Float[np.ndarray, "layer wave 2"]
    relief_m: Float[np.ndarray, "layer wave"]
    relief_phase_rad: Float[np.ndarray, "layer wave"]
    reflectivity_mean: Float[np.ndarray, " layer"]
    reflectivity: Float[np.ndarray, "layer wave"]
    reflectivity_phase_rad: Float[np.ndarray, "layer wave"]


class Ground(NamedTuple):
    """The whole corridor, float64 on the host. Stones are (along, cross, depth), sorted along the track."""

    config: GroundConfig
    stone_m: Float[np.ndarray, "stone 3"]
    stone_strength_m: Float[np.ndarray, " stone"]
    layers: Layers


class GroundSlice(NamedTuple):
    """What a block of scans sees, float32, about the block's origin; stones of strength 0 are padding.

    The arrays are NumPy's on the host and JAX's inside a compiled function.
    """

    stone_m: Float[np.ndarray, "stone 3"]
    stone_strength_m: Float[np.ndarray, " stone"]
    layers: Layers
    velocity_m_per_ns: Float[np.ndarray, ""]
    attenuation_per_m: Float[np.ndarray, ""]


def make_ground(seed: int, config: GroundConfig | None = None) -> Ground:
    """Draws a corridor of ground; the same seed and config give the same ground, bit for bit."""
    config = GroundConfig() if config is None else config
    rng_stones, rng_layers = (np.random.default_rng(s) for s in np.random.SeedSequence(seed).spawn(2))
    stone_m, strength_m = draw_stones(
        rng_stones,
        config,
        per_m2=config.stones_per_m2,
        depth_m=config.stone_depth_m,
        strength_m=config.stone_strength_m,
    )
    return Ground(config, stone_m, strength_m, _draw_layers(rng_layers, config))


def draw_stones(
    rng: np.random.Generator,
    config: GroundConfig,
    *,
    per_m2: float,
    depth_m: tuple[float, float],
    strength_m: float,
) -> tuple[Float[np.ndarray, "stone 3"], Float[np.ndarray, " stone"]]:
    """Stones over the whole corridor, sorted along, of random polarity (lighter or denser than the soil)."""
    low, high = -config.margin_m, config.length_m + config.margin_m
    count = round((high - low) * 2 * config.half_width_m * per_m2)
    along = np.sort(rng.uniform(low, high, count))
    cross = rng.uniform(-config.half_width_m, config.half_width_m, count)
    # Inverse of the truncated exponential's distribution function.
    scale = config.stone_depth_scale_m
    top, bottom = np.exp(-np.asarray(depth_m) / scale)
    depth = -scale * np.log(top - rng.uniform(size=count) * (top - bottom))
    size = strength_m * np.exp(config.stone_strength_spread * rng.normal(size=count))
    return np.stack([along, cross, depth], axis=1), size * rng.choice([-1.0, 1.0], count)


def add_stones(
    ground: Ground, stone_m: Float[np.ndarray, "added 3"], strength_m: Float[np.ndarray, " added"]
) -> Ground:
    """The same ground with more stones in it (what lies about on one day only)."""
    places = np.concatenate([ground.stone_m, stone_m])
    order = np.argsort(places[:, 0], kind="stable")
    strengths = np.concatenate([ground.stone_strength_m, strength_m])
    return ground._replace(stone_m=places[order], stone_strength_m=strengths[order])


def count_stones(ground: Ground, from_m: Float[np.ndarray, " block"], to_m: Float[np.ndarray, " block"]) -> int:
    """Most stones found in any of the windows [from, to] along the track."""
    along = ground.stone_m[:, 0]
    return int(np.max(np.searchsorted(along, to_m) - np.searchsorted(along, from_m)))


def slice_ground(
    ground: Ground,
    from_m: float,
    to_m: float,
    *,
    stones: int,
    origin_m: tuple[float, float] = (0.0, 0.0),
    velocity_factor: float = 1.0,
) -> GroundSlice:
    """Cuts the window [from, to] along the track out of the ground, about ``origin_m`` (along, cross).

    Args:
        stones: rows of the result, the same for every block of a drive so that nothing is compiled anew.
        velocity_factor: wave velocity relative to the config's (moisture slows the wave).

    Raises:
        ValueError: the window holds more stones than ``stones``.
    """
    along = ground.stone_m[:, 0]
    first, last = (int(i) for i in np.searchsorted(along, [from_m, to_m]))
    if last - first > stones:
        raise ValueError(f"window [{from_m}, {to_m}] holds {last - first} stones, more than {stones}")
    origin = np.asarray(origin_m)
    place = np.zeros((stones, 3), np.float32)
    place[:, 2] = 1.0  # padding lies at a harmless depth: no division by zero
    place[: last - first] = ground.stone_m[first:last] - np.append(origin, 0.0)
    strength = np.zeros(stones, np.float32)
    strength[: last - first] = ground.stone_strength_m[first:last]
    turn = ground.layers.wave_rad_per_m @ origin
    layers = ground.layers._replace(
        relief_phase_rad=np.mod(ground.layers.relief_phase_rad + turn, 2 * np.pi),
        reflectivity_phase_rad=np.mod(ground.layers.reflectivity_phase_rad + turn, 2 * np.pi),
    )
    return GroundSlice(
        stone_m=place,
        stone_strength_m=strength,
        layers=Layers(*(a.astype(np.float32) for a in layers)),
        velocity_m_per_ns=np.asarray(ground.config.velocity_m_per_ns * velocity_factor, np.float32),
        attenuation_per_m=np.asarray(ground.config.attenuation_per_m, np.float32),
    )


def _draw_layers(rng: np.random.Generator, config: GroundConfig) -> Layers:
    layers, waves = len(config.layer_depth_m), config.waves
    log_low, log_high = np.log(config.wavelength_m)
    wavelength = np.exp(rng.uniform(log_low, log_high, (layers, waves)))
    direction = rng.uniform(0.0, 2 * np.pi, (layers, waves))
    wave = (2 * np.pi / wavelength)[..., None] * np.stack([np.cos(direction), np.sin(direction)], axis=-1)
    # Equal slope at every wavelength: the long undulations are high, the short ones a roughness.
    relief = wavelength / np.sqrt(np.sum(wavelength**2, axis=1, keepdims=True) / 2) * config.layer_relief_m
    sign = rng.choice([-1.0, 1.0], layers)
    return Layers(
        depth_m=np.asarray(config.layer_depth_m, np.float64),
        wave_rad_per_m=wave,
        relief_m=relief,
        relief_phase_rad=rng.uniform(0.0, 2 * np.pi, (layers, waves)),
        reflectivity_mean=sign * config.layer_reflectivity * np.sqrt(0.5),
        reflectivity=np.full((layers, waves), config.layer_reflectivity / np.sqrt(waves)),
        reflectivity_phase_rad=rng.uniform(0.0, 2 * np.pi, (layers, waves)),
    )
