"""The worlds as a table: what each one is made of, drawn once by a seeded generator and kept in ``worlds.csv``.

``python -m validation.worlds.parameters`` (``PYTHONPATH=.:tests``) prints the table again; a test compares it with the
file. Lengths "in wavelengths" are those of the centre frequency in the world's own soil.
"""

import csv
import sys
from collections.abc import Callable, Sequence
from dataclasses import astuple, dataclass, fields
from pathlib import Path
from typing import Any, TextIO

import numpy as np

TABLE = Path(__file__).with_name("worlds.csv")
WORLDS = 30
BEYOND = 4
_SEED = 20_261_122


@dataclass(frozen=True)
class World:
    """One world: ground, radar, vehicle, and what the days add.

    Attributes:
        number: of the row; 30 to 33 are mapped more coarsely than half a wavelength.
        seed: of everything that is random in it.
        centre_mhz, velocity_m_per_ns: centre frequency, and speed of the wave in the ground.
        channels, pitch_m: the array.
        passes, pass_spacing_m: drives that make the map, and the distance between neighbouring ones.
        antenna_x_m, height_m: place of the array before the rear axle, and above the ground.
        pulse: ``ricker``, ``gabor`` or ``chirp`` (compressed).
        samples, samples_per_period: of a trace.
        encoding: ``uint8`` or ``int16``.
        gain_share: share of the ground's decay that the receiver's gain makes up for; 0 for none.
        loss_db_per_wavelength: of the path.
        beam_sine: sine of the angle in the soil at which an echo has lost 6 dB.
        law: of contrasts, ``gaussian`` or ``heavy``.
        correlation_wavelengths, anisotropy: of the contrasts along the route, and how much longer across it.
        vertical_periods: their correlation in travel time.
        horizons: continuous interfaces.
        points_per_wavelength2, rods: point scatterers a square wavelength; dipping lines a hundred of these.
        points_share: RMS of their echoes over that of the layered ground.
        coupling: direct wave and surface return over the ground's shallow RMS.
        clutter: echoes that belong to the day, over the ground's.
        snr_half_db: signal over noise on a clear day at half of the recorded time.
        coloured_noise: noise of the antenna's band instead of white noise.
        bounce_m, roll_deg: RMS.
        scan_spacing_m, speed_mps, route_m: of the drives.
        bend, radius_m: ``straight``, ``arc`` or ``s`` with this least radius.
        label_sigma_m: RMS, and stated sigma, of the map's positions.
        gnss_east_m, gnss_north_m, gnss_wander_m, gnss_sigma_m: live bias, wander, and what a log that states it says.
        gnss_stated: sigmas of live positions are written.
        heading_deg: RMS, and stated sigma, of live headings.
        odometer_scale: relative error of the live odometer.
        snow_delay_ns, snow_loss_db, snow_noise_db, snow_clutter: of the day of snow; clutter over the ground's.
        rain_scale, rain_drift, rain_loss: travel-time factor, half its drift, and loss relative to the clear day.
        lookalike_m, lookalike_memory: period of the ground that repeats itself, and correlation from one period to
            the next; 0 where the world has none.
    """

    number: int
    seed: int
    centre_mhz: float
    velocity_m_per_ns: float
    channels: int
    pitch_m: float
    passes: int
    pass_spacing_m: float
    antenna_x_m: float
    height_m: float
    pulse: str
    samples: int
    samples_per_period: int
    encoding: str
    gain_share: float
    loss_db_per_wavelength: float
    beam_sine: float
    law: str
    correlation_wavelengths: float
    anisotropy: float
    vertical_periods: float
    horizons: int
    points_per_wavelength2: float
    rods: int
    points_share: float
    coupling: float
    clutter: float
    snr_half_db: float
    coloured_noise: bool
    bounce_m: float
    roll_deg: float
    scan_spacing_m: float
    speed_mps: float
    route_m: float
    bend: str
    radius_m: float
    label_sigma_m: float
    gnss_east_m: float
    gnss_north_m: float
    gnss_wander_m: float
    gnss_sigma_m: float
    gnss_stated: bool
    heading_deg: float
    odometer_scale: float
    snow_delay_ns: float
    snow_loss_db: float
    snow_noise_db: float
    snow_clutter: float
    rain_scale: float
    rain_drift: float
    rain_loss: float
    lookalike_m: float
    lookalike_memory: float

    @property
    def wavelength_m(self) -> float:
        """Of the centre frequency in the soil."""
        return self.velocity_m_per_ns * self.period_ns

    @property
    def period_ns(self) -> float:
        """Of the centre frequency."""
        return 1e3 / self.centre_mhz

    @property
    def sample_interval_ns(self) -> float:
        """Of the recording."""
        return self.period_ns / self.samples_per_period

    @property
    def half_width_m(self) -> float:
        """From the route's middle to the outermost antenna of the map."""
        return 0.5 * ((self.passes - 1) * self.pass_spacing_m + (self.channels - 1) * self.pitch_m)

    @property
    def beyond(self) -> bool:
        """Whether the map is coarser than half a wavelength."""
        return WORLDS <= self.number < WORLDS + BEYOND


def read_worlds(path: Path = TABLE) -> list[World]:
    """The worlds as committed."""
    with path.open(newline="", encoding="utf-8") as stream:
        rows = list(csv.DictReader(stream))
    return [World(**{field.name: _parsed(row[field.name], str(field.type)) for field in fields(World)}) for row in rows]


def write_worlds(worlds: Sequence[World], stream: TextIO) -> None:
    """The table, one row a world."""
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(field.name for field in fields(World))
    writer.writerows(astuple(world) for world in worlds)


def draw_worlds() -> list[World]:
    """Thirty worlds spread over all ranges (a Latin hypercube: each quantity takes each thirtieth of its range once),
    and four with coarser maps."""
    rng = np.random.default_rng(_SEED)
    channels = [1, 1, 2, 2, 3, 3, 4, 4, 5, 5] + [6, 6, 7, 7, 8, 8, 9, 9, 10, 10, 11, 11, 11, 12, 12, 13, 14, 15, 16, 16]
    drawn = _drawn(rng, [channels[n] for n in rng.permutation(WORLDS)], (0.2, 0.5), 0)
    return drawn + _drawn(rng, [1, 3, 8, 12], (0.6, 1.2), WORLDS)


def _drawn(
    rng: np.random.Generator, channels: Sequence[int], spacing_wavelengths: tuple[float, float], first: int
) -> list[World]:
    count = len(channels)

    def spread(low: float, high: float) -> np.ndarray:
        return low + (high - low) * (rng.permutation(count) + rng.uniform(size=count)) / count

    def dealt(*kinds: str) -> list[str]:
        return [kinds[n % len(kinds)] for n in rng.permutation(count)]

    centre = 100.0 * 9.0 ** spread(0.0, 1.0)
    velocity = spread(0.06, 0.15)
    wavelength = velocity * 1e3 / centre
    pitch = wavelength * spread(*spacing_wavelengths)
    beside, offset = spread(0.55, 0.95), spread(0.0, 1.0)
    per_period, periods = spread(8.0, 12.0), spread(18.0, 33.0)
    gain, encoding = spread(0.7, 1.0), dealt("uint8", "uint8", "int16")
    loss, beam = spread(0.15, 0.7), spread(0.25, 0.45)
    law, pulse = dealt("gaussian", "heavy"), dealt("ricker", "gabor", "chirp")
    correlation, anisotropy = 0.2 * 10.0 ** spread(0.0, 1.0), 0.5 * 4.0 ** spread(0.0, 1.0)
    vertical, horizons = spread(0.05, 0.5), spread(0.0, 5.0)
    points, rods, share = spread(0.02, 0.15), spread(1.0, 5.0), spread(0.2, 1.0)
    coupling, clutter, snr = spread(4.0, 14.0), spread(0.05, 0.35), spread(9.0, 20.0)
    colour = dealt("white", "coloured")
    height, bounce, roll = spread(0.0, 1.0), spread(0.3, 1.0), spread(0.2, 0.8)
    spacing, speed, route = spread(0.06, 0.16), spread(1.0, 9.0), spread(40.0, 70.0)
    bend, radius = dealt("straight", "arc", "s"), 15.0 * 8.0 ** spread(0.0, 1.0)
    label = spread(0.0, 0.03)
    bias, azimuth, wander = spread(0.1, 1.5), spread(0.0, 2.0 * np.pi), spread(0.02, 0.2)
    stated = dealt("stated", "unstated")
    heading, odometer = spread(0.2, 1.0), spread(-0.005, 0.005)
    snow_delay, snow_loss, snow_noise = spread(0.05, 0.3), spread(1.0, 3.0), spread(1.0, 3.0)
    snow_clutter = spread(0.6, 1.5)
    scale, drift, rain_loss = spread(0.95, 1.08), spread(0.0, 0.01), spread(1.05, 1.3)
    alike, period = dealt("yes", "no", "no"), spread(1.0, 2.0)
    memory = dealt("1.0", "0.98", "0.95")
    worlds = []
    for n in range(count):
        array, straight = channels[n] >= 6, bend[n] == "straight"
        quantised = encoding[n] == "uint8"
        # Swaths of few channels lie side by side in the array's own pitch; arrays pass over each other's ground.
        lines = np.ceil(max(8.0 * pitch[n], 0.9) / (channels[n] * pitch[n]))
        passes = 2 + n % 2 if array else int(np.clip(lines, 4, 16))
        row = World(
            number=first + n,
            seed=1000 + first + n,
            centre_mhz=round(float(centre[n]), 1),
            velocity_m_per_ns=round(float(velocity[n]), 4),
            channels=channels[n],
            pitch_m=round(float(pitch[n]), 4),
            passes=passes,
            pass_spacing_m=round(float(channels[n] * pitch[n] * (beside[n] if array else 1.0)), 4),
            antenna_x_m=round(float((0.5 + 2.5 * offset[n]) if array else (0.3 + 0.7 * offset[n])), 3),
            height_m=round(float((0.10 + 0.22 * height[n]) if array else (0.02 + 0.06 * height[n])), 3),
            pulse=pulse[n],
            samples=int(round(per_period[n]) * periods[n]),
            samples_per_period=round(per_period[n]),
            encoding=encoding[n],
            # Eight bits hold the deep ground only with a gain; of the others every second receiver has one.
            gain_share=round(float(gain[n]), 3) if quantised or n % 2 else 0.0,
            loss_db_per_wavelength=round(float(loss[n]), 3),
            beam_sine=round(float(beam[n]), 3),
            law=law[n],
            correlation_wavelengths=round(float(correlation[n]), 3),
            anisotropy=round(float(anisotropy[n]), 3),
            vertical_periods=round(float(vertical[n]), 3),
            horizons=round(float(horizons[n])),
            points_per_wavelength2=round(float(points[n]), 3),
            rods=round(float(rods[n])),
            points_share=round(float(share[n]), 3),
            coupling=round(float(coupling[n]), 2),
            clutter=round(float(clutter[n]), 3),
            snr_half_db=round(float(snr[n]), 1),
            coloured_noise=colour[n] == "coloured",
            bounce_m=round(float(bounce[n] * (0.015 if array else 0.003)), 4),
            roll_deg=round(float(roll[n]), 2),
            scan_spacing_m=round(float(np.clip(wavelength[n] * spacing[n], 0.012, 0.1)), 4),
            speed_mps=round(float(speed[n] if straight else min(speed[n], 6.0)), 2),
            route_m=round(float(route[n]), 1),
            bend=bend[n],
            radius_m=0.0 if straight else round(float(radius[n]), 1),
            # Who surveys with a short wave does so with an instrument to match.
            label_sigma_m=round(float(min(label[n], 0.08 * wavelength[n])), 4),
            gnss_east_m=round(float(bias[n] * np.cos(azimuth[n])), 3),
            gnss_north_m=round(float(bias[n] * np.sin(azimuth[n])), 3),
            gnss_wander_m=round(float(wander[n]), 3),
            gnss_sigma_m=round(float(np.hypot(bias[n] / 1.5, wander[n])), 3),
            gnss_stated=stated[n] == "stated",
            heading_deg=round(float(heading[n]), 2),
            odometer_scale=round(float(odometer[n]), 5),
            snow_delay_ns=round(float(snow_delay[n]), 3),
            snow_loss_db=round(float(snow_loss[n]), 2),
            snow_noise_db=round(float(snow_noise[n]), 2),
            snow_clutter=round(float(snow_clutter[n]), 2),
            rain_scale=round(float(scale[n]), 4),
            rain_drift=round(float(drift[n]), 4),
            rain_loss=round(float(rain_loss[n]), 3),
            # A repeat nearer than the limit of a wrong fix would go unnoticed.
            lookalike_m=round(float(max(period[n] * wavelength[n], 0.4)), 3) if alike[n] == "yes" else 0.0,
            lookalike_memory=float(memory[n]) if alike[n] == "yes" else 0.0,
        )
        worlds.append(row)
    return worlds


def _parsed(text: str, kind: str) -> Any:
    kinds: dict[str, Callable[[str], Any]] = {
        "int": int,
        "float": float,
        "str": str,
        "bool": lambda word: word == "True",
    }
    for name, parse in kinds.items():
        if name in kind:
            return parse(text)
    raise TypeError(kind)


if __name__ == "__main__":
    write_worlds(draw_worlds(), sys.stdout)
