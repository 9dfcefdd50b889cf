"""Smooth random ground on a grid, and its value between the nodes."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

_PAD = 32
"""Cells beyond the grid: the field is drawn on a torus, and its opposite edges must not know each other."""
_TAPS = 10
"""Nodes to each side that a value between nodes is made of."""


@dataclass(frozen=True)
class Texture:
    """What the ground looks like in plan.

    Attributes:
        correlation_m: l of the autocorrelation exp(-d²/(2 l²)).
        decoy_share: of the power that repeats every ``decoy_pitch_m`` along the track.
    """

    correlation_m: float = 0.12
    decoy_share: float = 0.35
    decoy_pitch_m: float = 0.61


def draw_ground(
    rng: np.random.Generator,
    size: tuple[int, int],
    cell_m: Float[np.ndarray, " 2"],
    shaping: Float[np.ndarray, "coefficient coefficient"],
    texture: Texture,
) -> Float[np.ndarray, "along cross coefficient"]:
    """A Gaussian field plus a part that repeats along the track, of unit power together before shaping.

    Args:
        size: nodes along and cross.
        cell_m: between them.
        shaping: independent unit coefficients times this are the ground's.
        texture: correlation length and decoy.
    """
    length, numbers = texture.correlation_m, len(shaping)
    torus = (size[0] + _PAD, size[1] + _PAD)
    field = _smooth(rng.standard_normal((*torus, numbers)), cell_m, length)[: size[0], : size[1]]
    along = np.arange(size[0]) * cell_m[0]
    # The harmonic that does not change along the track is left out: a track filter takes such ground away.
    wave = 2.0 * np.pi * np.arange(1, 6) / texture.decoy_pitch_m
    weight = np.exp(-0.25 * (wave * length) ** 2)
    weight /= np.sqrt(np.sum(weight**2))
    phase = np.outer(along, wave)
    waves = np.concatenate([weight * np.cos(phase), weight * np.sin(phase)], axis=1)
    across = _smooth(rng.standard_normal((waves.shape[1], torus[1], numbers)), cell_m, length, axes=(1,))
    decoy = np.tensordot(waves, across[:, : size[1]], axes=1)
    share = texture.decoy_share
    return np.asarray((np.sqrt(1.0 - share) * field + np.sqrt(share) * decoy) @ shaping)


def sample_ground(
    ground: Float[np.ndarray, "along cross coefficient"], cells: Float[np.ndarray, "place 2"]
) -> Float[np.ndarray, "place coefficient"]:
    """Value between nodes by a Gaussian-windowed sinc: the field is band-limited well below the grid's own limit.

    Args:
        ground: the field at its nodes.
        cells: places in cells from node (0, 0), at least ``_TAPS`` cells from the rim.
    """
    low = np.floor(cells).astype(int)
    reach = np.arange(1 - _TAPS, _TAPS + 1)
    distance = (cells - low)[:, :, None] - reach
    kernel = np.sinc(distance) * np.exp(-0.5 * (distance / (0.3 * _TAPS)) ** 2)
    kernel /= np.sum(kernel, axis=-1, keepdims=True)
    patch = ground[(low[:, 0, None] + reach)[:, :, None], (low[:, 1, None] + reach)[:, None, :]].astype(np.float64)
    return np.asarray(np.einsum("pa,pc,pack->pk", kernel[:, 0], kernel[:, 1], patch, optimize=True))


def _smooth(
    white: Float[np.ndarray, "..."],
    cell_m: Float[np.ndarray, " 2"],
    correlation_m: float,
    axes: tuple[int, ...] = (0, 1),
) -> Float[np.ndarray, "..."]:
    """Unit white noise to unit power with autocorrelation exp(-d²/(2 l²)) over the given axes (0 along, 1 cross)."""
    spectrum = np.fft.fftn(white, axes=axes)
    for axis in axes:
        wave = 2.0 * np.pi * np.fft.fftfreq(white.shape[axis], cell_m[axis])
        root = np.exp(-0.25 * (wave * correlation_m) ** 2)
        shape = [1] * white.ndim
        shape[axis] = -1
        spectrum *= (root / np.sqrt(np.mean(root**2))).reshape(shape)
    return np.asarray(np.fft.ifftn(spectrum, axes=axes).real)
