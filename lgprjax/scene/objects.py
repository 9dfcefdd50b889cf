"""What is buried: stones, roots (chains of small scatterers), pipes and cables."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float


class Scatterers(NamedTuple):
    """Points that scatter: (along, cross, depth), sorted along; scattering length, positive for denser than soil."""

    place_m: Float[np.ndarray, "scatterer 3"]
    strength_m: Float[np.ndarray, " scatterer"]


class Utilities(NamedTuple):
    """Straight horizontal cylinders.

    Attributes:
        centre_m: (along, cross) of the middle.
        direction: unit vector along the cylinder.
        half_length_m, depth_m, radius_m: depth of the axis.
        reflectivity: of its top: -1 for metal, above zero for an empty plastic pipe.
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
    """Roots of trees beside the road: they wander inwards, thinner and deeper as they go; wood is moist: positive."""
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
    # An empty pipe thinner than some 4 cm returns next to nothing at these wavelengths.
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
    """Those that ``keep`` says."""
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
