"""Changes from day to day: weather, roadworks, and the receiver's own errors."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from lgprjax.scene.ground import (
    Ground,
    GroundConfig,
    Scatterers,
    SineField,
    chosen,
    constant_field,
    draw_field,
    draw_layer,
    draw_stones,
    joined,
    stack_layers,
)

WAVES = 12  # of each of the day's fields
_COVER_WAVELENGTH_M = (0.6, 8.0)


@dataclass(frozen=True)
class Cover:
    """Snow on the ground: the wave is slower in it than in air, and the wheels ride up on it.

    Attributes:
        thickness_m, relief_m: mean and rms of the thickness.
        index: refractive index (dry snow 1.25, wet 1.5 and more).
        attenuation_per_m: one-way attenuation of the amplitude.
        lift: share of the thickness by which the packed snow raises the vehicle.
        reflectivity: reflectivity of its top, seen from the air.
    """

    thickness_m: float
    relief_m: float
    index: float = 1.35
    attenuation_per_m: float = 0.4
    lift: float = 0.4
    reflectivity: float = -0.15


@dataclass(frozen=True)
class Skin:
    """The top of the ground in another state: soaked by rain, or frozen.

    Attributes:
        thickness_m, relief_m: mean and rms of the thickness.
        slowness: relative change of the wave's slowness in it (+ wet, - frozen).
        reflectivity: reflectivity of its lower front, seen from above.
    """

    thickness_m: float
    relief_m: float
    slowness: float
    reflectivity: float


@dataclass(frozen=True)
class Trench:
    """A trench that was dug and refilled: stones, roots and layers in it are gone, other ground fills it.

    Pipes stay.

    Attributes:
        along_m, cross_m: start and end along and across the road.
        depth_m: depth of the trench; deeper ground is unchanged.
    """

    along_m: tuple[float, float]
    cross_m: tuple[float, float] = (-5.0, 5.0)
    depth_m: float = 1.2


@dataclass(frozen=True)
class Day:
    """Changes from day to day. The defaults are a clear day (see below).

    Attributes:
        seed: seed of all draws below.
        noise_field: rms of the receiver's noise within its band, before the time gain.
        gain_spread: sigma of a channel's gain about 1, constant over a drive.
        delay_spread_ns: sigma of a channel's own delay, constant over a drive.
        coupling_spread: sigma of a channel's coupling and surface echo, relative, constant over a drive.
        velocity_factor, velocity_spread: factors of the wave's velocity in the ground: the factor, and
            1 + spread * normal.
        attenuation_factor: factor of the ground's attenuation.
        moisture_rms, moisture_wavelength_m: rms and wavelengths of the day's relative change of slowness with place;
            wavelengths ``None``: those of the ground's own moisture.
        clutter_per_m2, clutter_depth_m, clutter_strength_m: density, depths and strength of small shallow objects that
            are present on this day only.
        moved_share: share of the ground's stones shallower than ``moved_depth_m`` that were replaced by others.
        cover, skin, trenches: snow, changed top of the ground, and trenches.
    """

    seed: int = 1
    noise_field: float = 3.3e-4
    gain_spread: float = 0.03
    delay_spread_ns: float = 0.03
    coupling_spread: float = 0.02
    velocity_factor: float = 1.0
    velocity_spread: float = 0.002
    attenuation_factor: float = 1.0
    moisture_rms: float = 0.0025
    moisture_wavelength_m: tuple[float, float] | None = None
    clutter_per_m2: float = 7.0
    clutter_depth_m: tuple[float, float] = (0.03, 0.5)
    clutter_strength_m: float = 0.0065
    moved_share: float = 0.0
    moved_depth_m: float = 0.6
    cover: Cover | None = None
    skin: Skin | None = None
    trenches: tuple[Trench, ...] = ()


class Conditions(NamedTuple):
    """A day's ground conditions, input of ``slice_ground``.

    Attributes:
        velocity_factor, attenuation_factor: factors of the ground's velocity and attenuation.
        moisture: the day's relative change of slowness over place.
        skin_m, skin_slowness: thickness of the skin over place, and its relative slowness.
        cover_m: thickness of the snow over place.
        cover: index, attenuation, lift and reflectivity of the snow.
        trenches: (from along, to along, from cross, to cross, depth), one row per trench.
    """

    velocity_factor: float
    attenuation_factor: float
    moisture: SineField
    skin_m: SineField
    skin_slowness: float
    cover_m: SineField
    cover: Cover
    trenches: Float[np.ndarray, "trench 5"]


_BARE = Cover(0.0, 0.0, index=1.0, attenuation_per_m=0.0, lift=0.0, reflectivity=0.0)


def usual_conditions(velocity_factor: float = 1.0) -> Conditions:
    """The ground of its config, without moisture of the day, skin and snow."""
    none = constant_field(0.0, WAVES)
    return Conditions(
        velocity_factor=velocity_factor,
        attenuation_factor=1.0,
        moisture=none,
        skin_m=none,
        skin_slowness=0.0,
        cover_m=none,
        cover=_BARE,
        trenches=np.zeros((0, 5)),
    )


def ground_on(ground: Ground, day: Day) -> tuple[Ground, Conditions]:
    """The ground as it is on a day, and the day's conditions."""
    velocity, moisture, skin, cover = (np.random.default_rng([day.seed, 5, stream]) for stream in range(4))
    trenches = np.array([[*t.along_m, *t.cross_m, t.depth_m] for t in day.trenches]).reshape(-1, 5)
    config = ground.config
    scatterers = _dug(_aged(ground.scatterers, config, day), config, day, trenches)
    scatterers = _littered(scatterers, config, day)
    layers = ground.layers
    skin_m = constant_field(0.0, WAVES)
    if day.skin is not None:
        s = day.skin
        front = draw_layer(skin, config, depth_m=s.thickness_m, relief_m=s.relief_m, reflectivity=s.reflectivity)
        layers = stack_layers([layers, front])
        # The visible front is the one at which the wave's speed changes.
        skin_m = SineField(front.depth_m[0], front.relief_m[0], front.wave_rad_per_m[0], front.relief_phase_rad[0])
    cover_m = constant_field(0.0, WAVES)
    if day.cover is not None:
        c = day.cover
        cover_m = draw_field(cover, rms=c.relief_m, wavelength_m=_COVER_WAVELENGTH_M, waves=WAVES, mean=c.thickness_m)
    wavelength_m = config.wavelength_m if day.moisture_wavelength_m is None else day.moisture_wavelength_m
    conditions = Conditions(
        velocity_factor=day.velocity_factor * (1 + day.velocity_spread * float(velocity.normal())),
        attenuation_factor=day.attenuation_factor,
        moisture=draw_field(moisture, rms=day.moisture_rms, wavelength_m=wavelength_m, waves=WAVES),
        skin_m=skin_m,
        skin_slowness=0.0 if day.skin is None else day.skin.slowness,
        cover_m=cover_m,
        cover=_BARE if day.cover is None else day.cover,
        trenches=trenches,
    )
    return ground._replace(scatterers=scatterers, layers=layers), conditions


def _aged(scatterers: Scatterers, config: GroundConfig, day: Day) -> Scatterers:
    """Some of the shallow stones gone, as many others come."""
    if day.moved_share <= 0:
        return scatterers
    rng = np.random.default_rng([day.seed, 6])
    shallow = scatterers.place_m[:, 2] < day.moved_depth_m
    gone = shallow & (rng.uniform(size=shallow.size) < day.moved_share)
    moved = scatterers.place_m[gone].copy()
    low, high = -config.margin_m, config.length_m + config.margin_m
    moved[:, 0] = rng.uniform(low, high, len(moved))
    moved[:, 1] = rng.uniform(-config.half_width_m, config.half_width_m, len(moved))
    strength = scatterers.strength_m[gone] * rng.choice([-1.0, 1.0], len(moved))
    return joined(chosen(scatterers, ~gone), Scatterers(moved, strength))


def _dug(scatterers: Scatterers, config: GroundConfig, day: Day, trenches: Float[np.ndarray, "trench 5"]) -> Scatterers:
    rng = np.random.default_rng([day.seed, 7])
    top, bottom = config.stone_depth_m
    # The fill is as stony as the ground that was dug out: stones of all depths, less those below the trench.
    above = np.exp(-np.array([top, bottom]) / config.stone_depth_scale_m)
    for low, high, right, left, deep in trenches:
        along, cross, depth = scatterers.place_m.T
        inside = (along >= low) & (along <= high) & (cross >= right) & (cross <= left) & (depth <= deep)
        lowest = min(max(float(deep), top), bottom)
        share = (above[0] - np.exp(-lowest / config.stone_depth_scale_m)) / (above[0] - above[1])
        fill = draw_stones(
            rng,
            (float(low), float(high)),
            half_width_m=config.half_width_m,
            per_m2=config.stones_per_m2 * float(share),
            depth_m=(top, lowest),
            depth_scale_m=config.stone_depth_scale_m,
            strength_m=config.stone_strength_m,
            strength_spread=config.stone_strength_spread,
        )
        between = (fill.place_m[:, 1] >= right) & (fill.place_m[:, 1] <= left)
        scatterers = joined(chosen(scatterers, ~inside), chosen(fill, between))
    return scatterers


def _littered(scatterers: Scatterers, config: GroundConfig, day: Day) -> Scatterers:
    if day.clutter_per_m2 <= 0:
        return scatterers
    litter = draw_stones(
        np.random.default_rng([day.seed, 4]),
        (-config.margin_m, config.length_m + config.margin_m),
        half_width_m=config.half_width_m,
        per_m2=day.clutter_per_m2,
        depth_m=day.clutter_depth_m,
        depth_scale_m=config.stone_depth_scale_m,
        strength_m=day.clutter_strength_m,
        strength_spread=config.stone_strength_spread,
    )
    return joined(scatterers, litter)


# Days by name. Their difficulty is fixed: tests/batch/test_days.py checks the correlation at the truth.


def clear_day(seed: int) -> Day:
    """Another clear day: new shallow clutter, channels and velocity a little off."""
    return Day(seed=seed)


def snow_day(seed: int) -> Day:
    """Eleven centimetres of snow, uneven, with its own echo; wheels ride up on what they pack."""
    return Day(
        seed=seed,
        attenuation_factor=1.1,
        moisture_rms=0.004,
        cover=Cover(thickness_m=0.11, relief_m=0.02, lift=0.3),
    )


def rain_day(seed: int) -> Day:
    """After a day of rain: travel time stretched by 5 %, twice the loss, puddles and soaked spots near the surface."""
    return Day(
        seed=seed,
        attenuation_factor=2.2,
        velocity_factor=1 / 1.05,
        moisture_rms=0.004,
        clutter_per_m2=12.0,
        clutter_strength_m=0.007,
    )


def frost_day(seed: int) -> Day:
    """Frozen to some 20 cm: fast above a front that mirrors."""
    return Day(
        seed=seed,
        attenuation_factor=0.95,
        skin=Skin(thickness_m=0.2, relief_m=0.03, slowness=-0.1, reflectivity=-0.03),
    )


def years_later(seed: int) -> Day:
    """A clear day years after: half of the shallow stones moved, moisture settled otherwise."""
    return Day(seed=seed, moisture_rms=0.005, velocity_factor=0.995, moved_share=0.5)


def repaired_day(seed: int) -> Day:
    """A clear day after the road was dug up across, two metres in every forty, from 20 m on."""
    return Day(seed=seed, trenches=tuple(Trench((20.0 + at, 22.0 + at)) for at in range(0, 2000, 40)))


WEATHER: dict[str, Callable[[int], Day]] = {
    "clear": clear_day,
    "snow": snow_day,
    "rain": rain_day,
    "frost": frost_day,
    "years": years_later,
    "repaired": repaired_day,
}
"""The day of each name, from its seed."""
