"""A corridor of ground that never changes, everything from one seed.

The ground lives in the *road frame*: ``along`` the centreline, ``cross`` to its left, ``depth`` down from the
surface. It is host data in float64; ``slice_ground`` cuts the part a block of scans can see and brings it to
the block's own origin, so that float32 on the device resolves it after kilometres as at the start.
"""

from dataclasses import dataclass
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

# Random fields over the ground as sums of sinusoids: smooth, reproducible, the same at any distance from the start.


class SineField(NamedTuple):
    """value(place) = mean + sum(amplitude * sin(k . place + phase)), place = (along, cross)."""

    mean: Float[np.ndarray | Array, ""]
    amplitude: Float[np.ndarray | Array, " wave"]
    wave_rad_per_m: Float[np.ndarray | Array, "wave 2"]
    phase_rad: Float[np.ndarray | Array, " wave"]


def constant_field(mean: float, waves: int) -> SineField:
    """The same everywhere, in the shape of a field of ``waves`` waves."""
    return SineField(np.asarray(mean, np.float64), np.zeros(waves), np.zeros((waves, 2)), np.zeros(waves))


def draw_field(
    rng: np.random.Generator,
    *,
    rms: float,
    wavelength_m: tuple[float, float],
    waves: int,
    mean: float = 0.0,
    repeat_m: float | None = None,
) -> SineField:
    """A fractal field: in every octave the amplitude grows with the root of the wavelength.

    The long undulations are the high ones, as in soil moisture.
    """
    wave_rad_per_m, wavelength = draw_wave_vectors(rng, waves, wavelength_m, repeat_m)
    amplitude = np.sqrt(wavelength)
    amplitude *= rms / np.sqrt(np.sum(amplitude**2) / 2)
    return SineField(np.asarray(mean, np.float64), amplitude, wave_rad_per_m, rng.uniform(0.0, 2 * np.pi, waves))


def draw_wave_vectors(
    rng: np.random.Generator, waves: int, wavelength_m: tuple[float, float], repeat_m: float | None
) -> tuple[Float[np.ndarray, "wave 2"], Float[np.ndarray, " wave"]]:
    """Wave vectors of random direction, and their wavelengths, evenly spread over the logarithm.

    ``repeat_m`` rounds them along the track to whole waves in that length, so that the field repeats itself.
    """
    low, high = np.log(wavelength_m)
    wavelength = np.exp(rng.uniform(low, high, waves))
    direction = rng.uniform(0.0, 2 * np.pi, waves)
    wave = (2 * np.pi / wavelength)[:, None] * np.stack([np.cos(direction), np.sin(direction)], axis=-1)
    if repeat_m is not None:
        wave[:, 0] = np.round(wave[:, 0] * repeat_m / (2 * np.pi)) * (2 * np.pi / repeat_m)
    return wave, wavelength


def value_at(field: SineField, place_m: Float[np.ndarray, "*place 2"]) -> Float[np.ndarray, "*place"]:
    """The field at places: host, float64."""
    angle = place_m @ np.asarray(field.wave_rad_per_m).T + field.phase_rad
    return np.asarray(field.mean + np.sin(angle) @ field.amplitude)


def device_value_at(field: SineField, place_m: Float[Array, "place 2"]) -> Float[Array, " place"]:
    """The field at places inside a compiled function."""
    angle = place_m @ jnp.asarray(field.wave_rad_per_m).T + jnp.asarray(field.phase_rad)[None, :]
    return jnp.asarray(field.mean) + jnp.sin(angle) @ jnp.asarray(field.amplitude)


def field_about(field: SineField, origin_m: Float[np.ndarray, "2"]) -> SineField:
    """The same field for places counted from ``origin_m``, in float32: the turn is taken out in float64."""
    turn = np.asarray(field.wave_rad_per_m) @ origin_m
    moved = field._replace(phase_rad=np.mod(field.phase_rad + turn, 2 * np.pi))
    return SineField(*(np.asarray(a, np.float32) for a in moved))


# Buried objects: stones, roots (chains of small scatterers), pipes and cables.


class Scatterers(NamedTuple):
    """Points that scatter: (along, cross, depth), sorted along; scattering length, positive for denser than soil."""

    place_m: Float[np.ndarray, "scatterer 3"]
    strength_m: Float[np.ndarray, " scatterer"]


class Utilities(NamedTuple):
    """Straight horizontal cylinders.

    Attributes:
        centre_m: (along, cross) of the middle.
        direction: unit vector along the cylinder.
        half_length_m, depth_m, radius_m: half length, depth of the axis, and radius.
        reflectivity: reflectivity of its top: -1 for metal, above zero for an empty plastic pipe.
    """

    centre_m: Float[np.ndarray, "utility 2"]
    direction: Float[np.ndarray, "utility 2"]
    half_length_m: Float[np.ndarray, " utility"]
    depth_m: Float[np.ndarray, " utility"]
    radius_m: Float[np.ndarray, " utility"]
    reflectivity: Float[np.ndarray, " utility"]


def draw_stones(
    rng: np.random.Generator,
    span_m: tuple[float, float],
    *,
    half_width_m: float,
    per_m2: float,
    depth_m: tuple[float, float],
    depth_scale_m: float,
    strength_m: float,
    strength_spread: float,
) -> Scatterers:
    """Stones over the span and the corridor's width, of random polarity (lighter or denser than the soil)."""
    low, high = span_m
    count = round((high - low) * 2 * half_width_m * per_m2)
    along = np.sort(rng.uniform(low, high, count))
    cross = rng.uniform(-half_width_m, half_width_m, count)
    # Inverse of the truncated exponential's distribution function.
    top, bottom = np.exp(-np.asarray(depth_m) / depth_scale_m)
    depth = -depth_scale_m * np.log(top - rng.uniform(size=count) * (top - bottom))
    size = strength_m * np.exp(strength_spread * rng.normal(size=count))
    return Scatterers(np.stack([along, cross, depth], axis=1), size * rng.choice([-1.0, 1.0], count))


def draw_roots(
    rng: np.random.Generator, span_m: tuple[float, float], half_width_m: float, trees_per_100m: float
) -> Scatterers:
    """Roots of roadside trees, which grow inwards, thinner and deeper; wood is moist: positive strength."""
    low, high = span_m
    places, strengths = [np.zeros((0, 3))], [np.zeros(0)]
    for _ in range(rng.poisson((high - low) * trees_per_100m / 100)):
        side = rng.choice([-1.0, 1.0])
        trunk = np.array([rng.uniform(low, high), side * rng.uniform(2.0, half_width_m)])
        for _ in range(rng.integers(3, 7)):
            points = int(rng.uniform(1.5, 4.0) / 0.05)
            heading = -side * np.pi / 2 + rng.normal(scale=0.7) + np.cumsum(rng.normal(scale=0.12, size=points))
            path = trunk + np.cumsum(0.05 * np.stack([np.cos(heading), np.sin(heading)], axis=1), axis=0)
            depth = 0.2 + np.abs(np.cumsum(rng.normal(scale=0.012, size=points))) + 0.1 * rng.uniform()
            taper = np.linspace(1.0, 0.2, points)
            inside = (np.abs(path[:, 1]) <= half_width_m) & (path[:, 0] >= low) & (path[:, 0] <= high)
            places.append(np.column_stack([path, depth])[inside])
            strengths.append((0.002 * taper * np.exp(0.3 * rng.normal()))[inside])
    return _sorted(np.concatenate(places), np.concatenate(strengths))


def draw_utilities(
    rng: np.random.Generator, span_m: tuple[float, float], half_width_m: float, per_100m: float, along: int
) -> Utilities:
    """Pipes and cables: ``per_100m`` across the road, ``along`` with it over its whole length."""
    low, high = span_m
    across = int(rng.poisson((high - low) * per_100m / 100))
    count = across + along
    angle = np.concatenate([np.pi / 2 + rng.normal(scale=0.25, size=across), rng.normal(scale=0.002, size=along)])
    centre = np.column_stack([rng.uniform(low, high, count), rng.uniform(-0.3, 0.3, count)])
    centre[across:] = np.column_stack([np.full(along, (low + high) / 2), rng.uniform(-1.5, 1.5, along)])
    radius = rng.uniform(0.01, 0.08, count)
    # An empty pipe thinner than some 4 cm returns almost nothing at these wavelengths.
    plastic = np.minimum(radius / 0.08, 1.0) ** 2 * 0.4
    return Utilities(
        centre_m=centre,
        direction=np.column_stack([np.cos(angle), np.sin(angle)]),
        half_length_m=np.concatenate([np.full(across, 2 * half_width_m), np.full(along, high - low)]),
        depth_m=rng.uniform(0.4, 1.4, count),
        radius_m=radius,
        reflectivity=np.where(rng.uniform(size=count) < 0.6, -1.0, plastic),
    )


def joined(*groups: Scatterers) -> Scatterers:
    """Several groups as one."""
    return _sorted(np.concatenate([g.place_m for g in groups]), np.concatenate([g.strength_m for g in groups]))


def chosen(scatterers: Scatterers, keep: Bool[np.ndarray, " scatterer"]) -> Scatterers:
    """The scatterers selected by the mask ``keep``."""
    return Scatterers(scatterers.place_m[keep], scatterers.strength_m[keep])


def repeated(pattern: Scatterers, repeat_m: float, stop_m: float) -> Scatterers:
    """The pattern laid end to end up to ``stop_m``."""
    if not len(pattern.strength_m):
        return pattern
    times = int(np.ceil((stop_m - pattern.place_m[0, 0]) / repeat_m)) + 1
    shift = np.repeat(np.arange(times) * repeat_m, len(pattern.strength_m))
    place = np.tile(pattern.place_m, (times, 1))
    place[:, 0] += shift
    everywhere = Scatterers(place, np.tile(pattern.strength_m, times))
    return chosen(everywhere, place[:, 0] <= stop_m)


def _sorted(place_m: Float[np.ndarray, "scatterer 3"], strength_m: Float[np.ndarray, " scatterer"]) -> Scatterers:
    order = np.argsort(place_m[:, 0], kind="stable")
    return Scatterers(place_m[order], strength_m[order])


@dataclass(frozen=True)
class GroundConfig:
    """Composition of the ground. Strengths are in the units of ``render`` (field relative to 1 m of air).

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
        velocity_m_per_ns, attenuation_per_m: velocity and attenuation of the wave in the ground (amplitude, one way, at
            the band's middle).
        dispersive_share: share of the attenuation that grows with the frequency.
        repeat_m: length after which the ground repeats (slabs, sleepers), without trees and pipes across; ``None``: no
            repetition.
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
    moisture: SineField


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
        # Lines along the road follow it exactly, or they would be elsewhere after one length; and over all of it.
        pipes = pipes._replace(
            centre_m=np.column_stack([np.full(config.utilities_along, (low + high) / 2), pipes.centre_m[:, 1]]),
            direction=np.tile([1.0, 0.0], (config.utilities_along, 1)),
            half_length_m=np.full(config.utilities_along, high - low),
        )
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
    """Draw one interface; a negative reflectivity is a step to denser soil, seen from above.

    Details finer than the Fresnel zone are scattered, not mirrored, and the specular echo of ``render`` must not follow
    them: at wavenumber q and depth d waves are damped by exp(-(q**2 d / 4k)**2 / 2).
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
