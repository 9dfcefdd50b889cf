"""Random fields over the ground as sums of sinusoids: smooth, reproducible, the same at any distance from the start."""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float


class Field(NamedTuple):
    """value(place) = mean + sum(amplitude * sin(k . place + phase)), place = (along, cross)."""

    mean: Float[np.ndarray | Array, ""]
    amplitude: Float[np.ndarray | Array, " wave"]
    wave_rad_per_m: Float[np.ndarray | Array, "wave 2"]
    phase_rad: Float[np.ndarray | Array, " wave"]


def constant_field(mean: float, waves: int) -> Field:
    """The same everywhere, in the shape of a field of ``waves`` waves."""
    return Field(np.asarray(mean, np.float64), np.zeros(waves), np.zeros((waves, 2)), np.zeros(waves))


def draw_field(
    rng: np.random.Generator,
    *,
    rms: float,
    wavelength_m: tuple[float, float],
    waves: int,
    mean: float = 0.0,
    repeat_m: float | None = None,
) -> Field:
    """A fractal field: in every octave the amplitude grows with the root of the wavelength.

    The long undulations are the high ones, as in soil moisture.
    """
    wave_rad_per_m, wavelength = draw_wave_vectors(rng, waves, wavelength_m, repeat_m)
    amplitude = np.sqrt(wavelength)
    amplitude *= rms / np.sqrt(np.sum(amplitude**2) / 2)
    return Field(np.asarray(mean, np.float64), amplitude, wave_rad_per_m, rng.uniform(0.0, 2 * np.pi, waves))


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


def value_at(field: Field, place_m: Float[np.ndarray, "*place 2"]) -> Float[np.ndarray, "*place"]:
    """The field at places: host, float64."""
    angle = place_m @ np.asarray(field.wave_rad_per_m).T + field.phase_rad
    return np.asarray(field.mean + np.sin(angle) @ field.amplitude)


def device_value_at(field: Field, place_m: Float[Array, "place 2"]) -> Float[Array, " place"]:
    """The field at places inside a compiled function."""
    angle = place_m @ jnp.asarray(field.wave_rad_per_m).T + jnp.asarray(field.phase_rad)[None, :]
    return jnp.asarray(field.mean) + jnp.sin(angle) @ jnp.asarray(field.amplitude)


def field_about(field: Field, origin_m: Float[np.ndarray, "2"]) -> Field:
    """The same field for places counted from ``origin_m``, in float32: the turn is taken out in float64."""
    turn = np.asarray(field.wave_rad_per_m) @ origin_m
    moved = field._replace(phase_rad=np.mod(field.phase_rad + turn, 2 * np.pi))
    return Field(*(np.asarray(a, np.float32) for a in moved))
