"""Smooth random functions of the place: sums of sinusoids over a band of wavelengths, closed form."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float


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
