"""Days by name. Their difficulty is fixed: tests/archive/test_days.py holds the correlation at the truth to it."""

from collections.abc import Callable

from lgprjax.scene.day import Cover, Day, Skin, Trench


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
