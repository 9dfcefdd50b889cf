"""Ground left out, drawn: of each kind places as far apart in size, place and heading as records leave them."""

from collections.abc import Callable

import numpy as np
from jaxtyping import Bool, Float
from scipy import ndimage

SPACING_M, OVERLAP_M = 0.96, 0.24

Places = Float[np.ndarray, "north east"]
Cells = Bool[np.ndarray, "north east"]


def _turned(along: Places, across: Places, at: tuple[float, float], yaw: float, half: tuple[float, float]) -> Cells:
    """Cells of a rectangle about a place."""
    x, y = along - at[0], across - at[1]
    ahead, aside = np.cos(yaw) * x + np.sin(yaw) * y, np.cos(yaw) * y - np.sin(yaw) * x
    return np.asarray((np.abs(ahead) < half[0]) & (np.abs(aside) < half[1]))


def _blocks(rng: np.random.Generator, along: Places, across: Places, size: tuple[float, float]) -> Cells:
    """What a day leaves, or ground that was shut: a few blocks along the lines."""
    left = np.zeros(along.shape, bool)
    for _ in range(rng.integers(1, 4)):
        half = rng.uniform(2.5, 0.25 * size[0]), rng.uniform(2.0, 0.25 * size[1])
        left |= _turned(along, across, (rng.uniform(0.0, size[0]), rng.uniform(0.0, size[1])), 0.0, half)
    return left


def _missed(rng: np.random.Generator, along: Places, across: Places, size: tuple[float, float]) -> Cells:
    """Between swaths that were driven apart: narrow and long."""
    left = np.zeros(along.shape, bool)
    for lane in rng.permutation(int(size[1] / 2.0))[: rng.integers(4, 10)]:
        half = rng.uniform(2.0, 0.4 * size[0]), 0.5 * rng.uniform(0.1, 0.5)
        left |= _turned(along, across, (rng.uniform(0.0, size[0]), 2.0 * lane + 1.0), 0.0, half)
    return left


def _stripes(rng: np.random.Generator, along: Places, across: Places, size: tuple[float, float]) -> Cells:
    """Of some neighbouring swaths the part that was driven without fixes, less what their neighbours worked of it."""
    left = np.zeros(along.shape, bool)
    for _ in range(rng.integers(2, 6)):
        width = int(rng.integers(1, 5)) * SPACING_M - OVERLAP_M + rng.uniform(0.05, 0.2)
        half = rng.uniform(2.0, 0.25 * size[0]), 0.5 * width
        left |= _turned(along, across, (rng.uniform(0.0, size[0]), rng.uniform(0.0, size[1])), 0.0, half)
    return left


def _rectangles(rng: np.random.Generator, along: Places, across: Places, size: tuple[float, float]) -> Cells:
    """Small and large ones turned any way."""
    left = np.zeros(along.shape, bool)
    for _ in range(round(26 * size[0] * size[1] / 1e4)):
        at = rng.uniform(0.0, size[0]), rng.uniform(0.0, size[1])
        half = 0.5 * rng.uniform(0.2, 12.0), 0.5 * rng.uniform(0.15, 3.0)
        left |= _turned(along, across, at, rng.uniform(0.0, np.pi), half)
    return left


def _branched(rng: np.random.Generator, along: Places, across: Places, size: tuple[float, float]) -> Cells:
    """Limbs of two to four headings from one place each."""
    left = np.zeros(along.shape, bool)
    for _ in range(rng.integers(2, 6)):
        at = np.array([rng.uniform(0.0, size[0]), rng.uniform(0.0, size[1])])
        for _ in range(rng.integers(2, 5)):
            yaw, half = rng.uniform(-np.pi, np.pi), (rng.uniform(1.5, 6.0), 0.5 * rng.uniform(0.5, 2.5))
            x, y = at + half[0] * np.array([np.cos(yaw), np.sin(yaw)])
            left |= _turned(along, across, (x, y), yaw, half)
    return left


def _blobs(rng: np.random.Generator, along: Places, across: Places, size: tuple[float, float]) -> Cells:
    """Without straight sides: the highest twentieth of smooth noise."""
    smooth = ndimage.gaussian_filter(rng.normal(size=along.shape), 10.0 * rng.uniform(0.6, 2.5))
    within = (along > 0.0) & (along < size[0]) & (across > 0.0) & (across < size[1])
    return np.asarray(within & (smooth > np.quantile(smooth[within], 1.0 - rng.uniform(0.03, 0.08))))


KINDS: dict[str, Callable[[np.random.Generator, Places, Places, tuple[float, float]], Cells]] = {
    "blocks": _blocks,
    "stripes": _stripes,
    "rectangles": _rectangles,
    "branched": _branched,
    "blobs": _blobs,
    "missed": _missed,
}
