"""The road of a scene: arcs and transitions in plan, grade, bank and a rough surface; host, float64.

The *road frame* is (along, cross): ``along`` is the horizontal length of the centreline from the road's start,
``cross`` the horizontal distance left of it. The ground is drawn in this frame, so a place has the same ground on every
drive. A true length along the road is ``1 - curvature * cross`` times that of the frame: within an antenna's aperture
of two metres, the difference is 3 % at a radius of 60 m.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

# Smooth random functions of the place: sums of sinusoids over a band of wavelengths, closed form.


class Waves(NamedTuple):
    """A smooth random function of the along-track place."""

    amplitude: Float[np.ndarray, " wave"]
    wave_rad_per_m: Float[np.ndarray, " wave"]
    phase_rad: Float[np.ndarray, " wave"]


class Roughness(NamedTuple):
    """A smooth random function of (along, cross)."""

    amplitude_m: Float[np.ndarray, " wave"]
    wave_rad_per_m: Float[np.ndarray, "wave 2"]
    phase_rad: Float[np.ndarray, " wave"]


def draw_waves(rng: np.random.Generator, rms: float, wavelength_m: tuple[float, float], waves: int = 8) -> Waves:
    """Waves of equal amplitude, one in each of equal bands of the logarithm of the wavelength."""
    wavelength = _draw_wavelength(rng, wavelength_m, waves)
    phase = rng.uniform(0.0, 2 * np.pi, waves)
    return Waves(np.full(waves, rms * np.sqrt(2 / waves)), 2 * np.pi / wavelength, phase)


def wave_value(waves: Waves, along_m: Float[np.ndarray, "*place"]) -> Float[np.ndarray, "*place"]:
    """The function at each place."""
    angle = along_m[..., None] * waves.wave_rad_per_m + waves.phase_rad
    return np.asarray(np.sin(angle) @ waves.amplitude)


def wave_slope(waves: Waves, along_m: Float[np.ndarray, "*place"]) -> Float[np.ndarray, "*place"]:
    """The function's derivative by the along-track place."""
    angle = along_m[..., None] * waves.wave_rad_per_m + waves.phase_rad
    return np.asarray(np.cos(angle) @ (waves.amplitude * waves.wave_rad_per_m))


def draw_roughness(
    rng: np.random.Generator, rms_m: float, wavelength_m: tuple[float, float], waves: int = 32
) -> Roughness:
    """Waves in all directions, their power falling as the square of the spatial frequency."""
    wavelength = _draw_wavelength(rng, wavelength_m, waves)
    # Power per spatial frequency n falls as n**-2, a band of ln(n) is n wide: power goes with the wavelength.
    amplitude = rms_m * np.sqrt(2 * wavelength / wavelength.sum())
    direction = rng.uniform(0.0, 2 * np.pi, waves)
    wave = (2 * np.pi / wavelength)[:, None] * np.stack([np.cos(direction), np.sin(direction)], axis=-1)
    return Roughness(amplitude, wave, rng.uniform(0.0, 2 * np.pi, waves))


def roughness_value(
    roughness: Roughness, along_m: Float[np.ndarray, "*place"], cross_m: Float[np.ndarray, "*place"]
) -> Float[np.ndarray, "*place"]:
    """The function at each place, wave by wave: antennas are many."""
    rough = np.zeros(np.shape(along_m))
    if np.any(roughness.amplitude_m):
        for amplitude, (wave_along, wave_cross), phase in zip(*roughness, strict=True):
            rough += amplitude * np.sin(wave_along * along_m + wave_cross * cross_m + phase)
    return rough


def _draw_wavelength(
    rng: np.random.Generator, wavelength_m: tuple[float, float], waves: int
) -> Float[np.ndarray, " wave"]:
    low, high = np.log(wavelength_m)
    return np.asarray(np.exp(low + (high - low) * (np.arange(waves) + rng.uniform(size=waves)) / waves))


NODE_STEP_M = 0.1
CONVERGED_M = 1e-9
# Three-point Gauss-Legendre on [0, 1]: over one piece its error is below float64's rounding.
GAUSS_PLACE = 0.5 + 0.5 * np.sqrt(0.6) * np.array([-1.0, 0.0, 1.0])
GAUSS_WEIGHT = np.array([5.0, 8.0, 5.0]) / 18.0


@dataclass(frozen=True)
class RoadConfig:
    """Shape of a road. The defaults are a straight, flat, smooth road to the east.

    Attributes:
        length_m, margin_m: the road is along in [-margin, length + margin]; along = 0 is at the local origin.
        heading_deg: compass heading at along = 0.
        arcs: (length_m, curvature_per_m) one after another from along = 0, curvature positive to the left;
            the first and the last go on to the road's ends. Empty: drawn from the seed.
        curvature_rms_per_m, arc_length_m: rms of the drawn curvatures before the limit, and range of the arcs' lengths.
        min_radius_m: smallest radius of an arc.
        transition_m: length of the linear change of curvature from one arc to the next (a clothoid).
        grade_rms, grade_wavelength_m: slope of the centreline (rise over horizontal run).
        bank_rms_rad, bank_wavelength_m: superelevation, positive where the left side is the higher one.
        roughness_rms_m, roughness_wavelength_m: undulations too short for a vehicle to follow, the same on each
            drive. Power falls as the square of the spatial frequency, like ISO 8608's; over the default
            wavelengths its classes A, B, C have an rms of 0.8, 1.5, 3 mm.
    """

    length_m: float = 200.0
    margin_m: float = 12.0
    heading_deg: float = 90.0
    arcs: tuple[tuple[float, float], ...] = ()
    curvature_rms_per_m: float = 0.0
    arc_length_m: tuple[float, float] = (40.0, 150.0)
    min_radius_m: float = 60.0
    transition_m: float = 20.0
    grade_rms: float = 0.0
    grade_wavelength_m: tuple[float, float] = (100.0, 600.0)
    bank_rms_rad: float = 0.0
    bank_wavelength_m: tuple[float, float] = (60.0, 300.0)
    roughness_rms_m: float = 0.0
    roughness_wavelength_m: tuple[float, float] = (0.3, 4.0)


class Road(NamedTuple):
    """A road: the centreline at nodes ``NODE_STEP_M`` apart, the surface as waves.

    Between nodes the curvature is linear; outside, the end pieces go on.

    Attributes:
        along_m, curvature_per_m: position along the road and curvature of each node.
        turn_rad: yaw of each node minus the yaw at along = 0.
        lag_m, aside_m: position of each node seen from along = 0 in the direction there: along + lag ahead, and aside
            to
            the left. Zero on a straight, so that a straight road adds no rounding.
        grade_m, bank_rad, roughness: height, bank and roughness of the surface.
    """

    config: RoadConfig
    along_m: Float[np.ndarray, " node"]
    curvature_per_m: Float[np.ndarray, " node"]
    turn_rad: Float[np.ndarray, " node"]
    lag_m: Float[np.ndarray, " node"]
    aside_m: Float[np.ndarray, " node"]
    grade_m: Waves
    bank_rad: Waves
    roughness: Roughness


class Centreline(NamedTuple):
    """Position, yaw (counter-clockwise from east) and curvature (positive to the left) of the centreline."""

    east_m: Float[np.ndarray, "*place"]
    north_m: Float[np.ndarray, "*place"]
    yaw_rad: Float[np.ndarray, "*place"]
    curvature_per_m: Float[np.ndarray, "*place"]


def straight_road(length_m: float) -> Road:
    """A straight, flat, smooth road to the east: east is along, north is cross."""
    return make_road(0, RoadConfig(length_m=length_m))


def make_road(seed: int, config: RoadConfig) -> Road:
    """Draws a road; each property has its own stream, and a longer road of the same seed begins alike.

    Raises:
        ValueError: a length, radius or transition is not positive, or an arc is tighter than the radius allowed.
    """
    if not min(config.length_m, config.min_radius_m, config.transition_m, config.arc_length_m[0]) > 0:
        raise ValueError("a road's length, smallest radius, transition and arcs must be longer than 0")
    # Effects count from 1, because a seed's trailing zero would not make a separate stream.
    rng_arcs, rng_grade, rng_bank, rng_rough = (np.random.default_rng([seed, 6, effect]) for effect in (1, 2, 3, 4))
    before = int(np.ceil(config.margin_m / NODE_STEP_M))
    after = int(np.ceil((config.length_m + config.margin_m) / NODE_STEP_M))
    along = np.arange(-before, after + 1) * NODE_STEP_M
    curvature = _design_curvature(_list_arcs(rng_arcs, config), along, config)
    turn = np.append(0.0, np.cumsum(0.5 * (curvature[1:] + curvature[:-1]) * np.diff(along)))
    turn -= turn[before]
    pieces = _run_piece(turn[:-1], curvature[:-1], np.diff(curvature) / NODE_STEP_M, np.diff(along))
    lag, aside = (np.append(0.0, np.cumsum(piece)) for piece in pieces)
    slope = draw_waves(rng_grade, config.grade_rms, config.grade_wavelength_m)
    return Road(
        config=config,
        along_m=along,
        curvature_per_m=curvature,
        turn_rad=turn,
        lag_m=lag - lag[before],
        aside_m=aside - aside[before],
        grade_m=slope._replace(amplitude=slope.amplitude / slope.wave_rad_per_m),
        bank_rad=draw_waves(rng_bank, config.bank_rms_rad, config.bank_wavelength_m),
        roughness=draw_roughness(rng_rough, config.roughness_rms_m, config.roughness_wavelength_m),
    )


def follow_centre(road: Road, along_m: Float[np.ndarray, "*place"]) -> Centreline:
    """The centreline at each place."""
    node = np.floor((along_m - road.along_m[0]) / NODE_STEP_M).astype(np.int64)
    node = np.clip(node, 0, road.along_m.size - 2)
    step = along_m - road.along_m[node]
    start, turn = road.curvature_per_m[node], road.turn_rad[node]
    change = (road.curvature_per_m[node + 1] - start) / NODE_STEP_M
    lag, aside = _run_piece(turn, start, change, step)
    ahead, left = along_m + (road.lag_m[node] + lag), road.aside_m[node] + aside
    yaw = np.pi / 2 - np.radians(road.config.heading_deg)
    return Centreline(
        east_m=ahead * np.cos(yaw) - left * np.sin(yaw),
        north_m=left * np.cos(yaw) + ahead * np.sin(yaw),
        yaw_rad=yaw + (turn + start * step + 0.5 * change * step**2),
        curvature_per_m=start + change * step,
    )


def surface_up(
    road: Road, along_m: Float[np.ndarray, "*place"], cross_m: Float[np.ndarray, "*place"]
) -> Float[np.ndarray, "*place"]:
    """Height of the surface, its roughness left out, above the centreline at along = 0."""
    start = float(wave_value(road.grade_m, np.zeros(1))[0])
    bank = wave_value(road.bank_rad, along_m)
    return np.asarray(wave_value(road.grade_m, along_m) - start + cross_m * np.tan(bank))


def road_to_local(
    road: Road, along_m: Float[np.ndarray, "*place"], cross_m: Float[np.ndarray, "*place"]
) -> tuple[Float[np.ndarray, "*place"], Float[np.ndarray, "*place"], Float[np.ndarray, "*place"]]:
    """East, north and up (``surface_up``) of places in the road frame."""
    centre = follow_centre(road, along_m)
    east = centre.east_m - cross_m * np.sin(centre.yaw_rad)
    north = centre.north_m + cross_m * np.cos(centre.yaw_rad)
    return east, north, surface_up(road, along_m, cross_m)


def local_to_road(
    road: Road,
    east_m: Float[np.ndarray, "*place"],
    north_m: Float[np.ndarray, "*place"],
    along_guess_m: Float[np.ndarray, "*place"],
) -> tuple[Float[np.ndarray, "*place"], Float[np.ndarray, "*place"]]:
    """Along and cross of local points, m: the closest point of the centreline near the guess, by Newton's method.

    Args:
        along_guess_m: initial position along the road, within about a quarter of the smallest radius.

    Raises:
        ValueError: no closest point is found, because a point is beyond a curve's centre or far from its guess.
    """
    along = np.asarray(along_guess_m, np.float64)
    for _ in range(20):
        centre = follow_centre(road, along)
        cos, sin = np.cos(centre.yaw_rad), np.sin(centre.yaw_rad)
        east, north = east_m - centre.east_m, north_m - centre.north_m
        cross = north * cos - east * sin
        stretch = 1.0 - centre.curvature_per_m * cross
        if np.any(stretch <= 0.0):
            break
        step = (east * cos + north * sin) / stretch
        along = along + step
        if np.all(np.abs(step) < CONVERGED_M):
            return along, cross
    raise ValueError("a point has no closest point of the road near its guess")


def _list_arcs(rng: np.random.Generator, config: RoadConfig) -> Float[np.ndarray, "arc 2"]:
    """(length, curvature) of each arc from along = 0."""
    tightest = 1.0 / config.min_radius_m
    if config.arcs:
        arcs = np.asarray(config.arcs, np.float64)
        if np.any(np.abs(arcs[:, 1]) > tightest * (1 + 1e-12)) or np.any(arcs[:, 0] <= 0):
            raise ValueError(f"an arc is tighter than a radius of {config.min_radius_m} m or has no length")
        return arcs
    drawn: list[tuple[float, float]] = []
    while sum(length for length, _ in drawn) < config.length_m + config.margin_m + config.transition_m:
        length = rng.uniform(*config.arc_length_m)
        drawn.append((length, float(np.clip(config.curvature_rms_per_m * rng.normal(), -tightest, tightest))))
    return np.asarray(drawn)


def _design_curvature(
    arcs: Float[np.ndarray, "arc 2"], along_m: Float[np.ndarray, " node"], config: RoadConfig
) -> Float[np.ndarray, " node"]:
    """Curvature at the nodes: the arcs' steps, averaged over a transition's length."""
    edge = np.append(0.0, np.cumsum(arcs[:, 0]))
    edge[0] = along_m[0] - config.transition_m
    edge[-1] = max(edge[-1], along_m[-1] + config.transition_m)
    turn = np.append(0.0, np.cumsum(arcs[:, 1] * np.diff(edge)))
    half = 0.5 * config.transition_m
    return np.asarray((np.interp(along_m + half, edge, turn) - np.interp(along_m - half, edge, turn)) / (2 * half))


def _run_piece(
    turn_rad: Float[np.ndarray, "*place"],
    curvature_per_m: Float[np.ndarray, "*place"],
    change_per_m2: Float[np.ndarray, "*place"],
    step_m: Float[np.ndarray, "*place"],
) -> tuple[Float[np.ndarray, "*place"], Float[np.ndarray, "*place"]]:
    """Integrals of cos(turn) - 1 and of sin(turn) over a step of linear curvature."""
    at = step_m[..., None] * GAUSS_PLACE
    angle = turn_rad[..., None] + curvature_per_m[..., None] * at + 0.5 * change_per_m2[..., None] * at**2
    lag = -2.0 * step_m * (np.sin(0.5 * angle) ** 2 @ GAUSS_WEIGHT)
    return lag, step_m * (np.sin(angle) @ GAUSS_WEIGHT)
