"""A corridor of ground that never changes, everything from one seed.

The ground lives in the *road frame*: ``along`` the centreline, ``cross`` to its left, ``depth`` down from the
surface. It is host data in float64; ``slice_ground`` cuts the part a block of scans can see and brings it to
the block's own origin, so that float32 on the device resolves it after kilometres as at the start.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from lgprjax.scene.fields import Field, draw_field, draw_wave_vectors
from lgprjax.scene.objects import Scatterers, Utilities, draw_roots, draw_stones, draw_utilities, joined, repeated


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
        wavelength_m, waves: range and number of the sinusoids that make up relief, reflectivity and moisture.
        trees_per_100m: on both sides together; each sends roots under the road.
        utilities_per_100m: pipes and cables across the road; ``utilities_along`` more run with it.
        moisture_rms: relative change of the wave's slowness with place, fractal, the same every day.
        velocity_m_per_ns, attenuation_per_m: of the wave in the ground (amplitude, one way, at the band's middle).
        dispersive_share: of the attenuation: it grows with the frequency, the rest does not.
        repeat_m: the ground repeats itself after this length (slabs, sleepers); None for ground that never does.
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
    trees_per_100m: float = 6.0
    utilities_per_100m: float = 3.0
    utilities_along: int = 1
    moisture_rms: float = 0.01
    velocity_m_per_ns: float = 0.1
    attenuation_per_m: float = 0.7
    dispersive_share: float = 0.5
    repeat_m: float | None = None


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
    """The whole corridor, float64 on the host.

    Attributes:
        scatterers: stones and roots, sorted along the track.
        utilities: pipes and cables.
        layers: interfaces.
        moisture: relative change of the wave's slowness with place.
    """

    config: GroundConfig
    scatterers: Scatterers
    utilities: Utilities
    layers: Layers
    moisture: Field


def make_ground(seed: int, config: GroundConfig | None = None) -> Ground:
    """Draws a corridor of ground; the same seed and config give the same ground, bit for bit.

    Raises:
        ValueError: the length after which it should repeat itself is not above zero.
    """
    config = GroundConfig() if config is None else config
    if config.repeat_m is not None and not config.repeat_m > 0:
        raise ValueError(f"repeat_m must be above zero, not {config.repeat_m}")
    stones, layers, roots, utilities, moisture = (
        np.random.default_rng(s) for s in np.random.SeedSequence(seed).spawn(5)
    )
    low, high = -config.margin_m, config.length_m + config.margin_m
    # One length of the pattern is drawn and then laid end to end.
    span = (low, high) if config.repeat_m is None else (low, low + config.repeat_m)
    field = draw_stones(
        stones,
        span,
        half_width_m=config.half_width_m,
        per_m2=config.stones_per_m2,
        depth_m=config.stone_depth_m,
        depth_scale_m=config.stone_depth_scale_m,
        strength_m=config.stone_strength_m,
        strength_spread=config.stone_strength_spread,
    )
    if config.repeat_m is None:
        field = joined(field, draw_roots(roots, span, config.half_width_m, config.trees_per_100m))
        pipes = draw_utilities(utilities, span, config.half_width_m, config.utilities_per_100m, config.utilities_along)
    else:
        field = repeated(field, config.repeat_m, high)
        pipes = draw_utilities(utilities, span, config.half_width_m, 0.0, config.utilities_along)
        # What runs with the road runs exactly with it, or it would be elsewhere a length on.
        pipes = pipes._replace(direction=np.tile([1.0, 0.0], (config.utilities_along, 1)))
    return Ground(
        config,
        field,
        pipes,
        _draw_layers(layers, config),
        draw_field(
            moisture,
            rms=config.moisture_rms,
            wavelength_m=config.wavelength_m,
            waves=config.waves,
            repeat_m=config.repeat_m,
        ),
    )


def draw_layer(
    rng: np.random.Generator, config: GroundConfig, *, depth_m: float, relief_m: float, reflectivity: float
) -> Layers:
    """One interface; a negative reflectivity is a step to denser soil, as seen from above.

    Details finer than the Fresnel zone are not mirrored but scattered, and the specular echo that ``render``
    gives must not follow them: at wavenumber q and depth d waves are damped by exp(-(q**2 d / 4k)**2 / 2).
    """
    wave, wavelength = draw_wave_vectors(rng, config.waves, config.wavelength_m, config.repeat_m)
    k = 2 * np.pi * 0.25 / config.velocity_m_per_ns  # in the middle of the band, 0.25 GHz
    q2 = np.sum(wave**2, axis=-1)
    damping = np.exp(-0.5 * (q2 * depth_m / (4 * k)) ** 2)
    # Equal slope at every wavelength: the long undulations are high, the short ones a roughness.
    relief = wavelength / np.sqrt(np.sum(wavelength**2) / 2) * relief_m
    return Layers(
        depth_m=np.array([depth_m], np.float64),
        wave_rad_per_m=wave[None],
        relief_m=(relief * damping)[None],
        relief_phase_rad=rng.uniform(0.0, 2 * np.pi, (1, config.waves)),
        reflectivity_mean=np.array([reflectivity * np.sqrt(0.5)]),
        reflectivity=(np.abs(reflectivity) / np.sqrt(config.waves) * damping)[None],
        reflectivity_phase_rad=rng.uniform(0.0, 2 * np.pi, (1, config.waves)),
    )


def stack_layers(layers: list[Layers]) -> Layers:
    """Interfaces of one ground, in the order given."""
    return Layers(*(np.concatenate(parts) for parts in zip(*layers, strict=True)))


def _draw_layers(rng: np.random.Generator, config: GroundConfig) -> Layers:
    sign = rng.choice([-1.0, 1.0], len(config.layer_depth_m))
    return stack_layers(
        [
            draw_layer(
                rng,
                config,
                depth_m=depth,
                relief_m=config.layer_relief_m,
                reflectivity=float(s) * config.layer_reflectivity,
            )
            for depth, s in zip(config.layer_depth_m, sign, strict=True)
        ]
    )
