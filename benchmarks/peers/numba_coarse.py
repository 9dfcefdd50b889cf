"""The control's coarse stage in Numba: what the array hears at every coarse place, and the best two places."""

# Numba finds the types of the kernels itself.
# mypy: allow-untyped-defs, allow-untyped-calls

import numpy as np
from jaxtyping import Float
from numba import njit, prange

_BLOCK = 64
_NOWHERE = np.float32(-1e30)
VECTORS = 32
"""Rows are padded to so many numbers: four vectors of eight, the step of the unrolled loop."""


def aligned_zeros(rows: int, numbers: int) -> Float[np.ndarray, "rows numbers"]:
    """Zeros that begin at a cache line, so that no vector lies across two."""
    raw = np.zeros(rows * numbers + 16, np.float32)
    skip = (-raw.ctypes.data % 64) // 4
    return raw[skip : skip + rows * numbers].reshape(rows, numbers)


@njit(fastmath=True, parallel=True)
def stack_columns(projected, power, along, across, offset, cross, columns):
    """What the array hears at each coarse place at zero heading, over the norm of all that it hears.

    Args:
        projected: numbers of each node in the map's eigenbasis.
        power: sum of squares of all numbers of each node.
        along, across: nodes of the coarse places.
        offset: nodes across from the array's centre to each channel.
        cross: nodes across the map.
        columns: [place, channel × number and pad], filled.
    """
    rank = projected.shape[1]
    for i in prange(len(along)):
        for j in range(len(across)):
            place = i * len(across) + j
            total = np.float32(1e-30)
            for channel in range(len(offset)):
                total += power[along[i] * cross + across[j] + offset[channel]]
            scale = np.float32(1.0) / np.sqrt(total)
            for channel in range(len(offset)):
                node = along[i] * cross + across[j] + offset[channel]
                for k in range(rank):
                    columns[place, channel * rank + k] = projected[node, k] * scale


@njit(fastmath=True)
def _two_places(first, second, features, low, high, surface, place):
    a, b, c = np.float32(0.0), np.float32(0.0), np.float32(0.0)
    d, e, f = np.float32(0.0), np.float32(0.0), np.float32(0.0)
    for k in range(len(first)):
        a += first[k] * low[k]
        b += first[k] * features[k]
        c += first[k] * high[k]
        d += second[k] * low[k]
        e += second[k] * features[k]
        f += second[k] * high[k]
    surface[0, place], surface[1, place], surface[2, place] = a, b, c
    surface[0, place + 1], surface[1, place + 1], surface[2, place + 1] = d, e, f


@njit(fastmath=True, parallel=True)
def one_surface(features, columns, parts, surface):
    """[height, place] of one scan at three heights: a product too thin for a BLAS, places in parallel by two."""
    pairs = len(columns) // 2
    for part in prange(parts):
        for pair in range(np.int64(part) * pairs // parts, (np.int64(part) + 1) * pairs // parts):
            place = 2 * pair
            _two_places(columns[place], columns[place + 1], features[1], features[0], features[2], surface, place)
    if len(columns) % 2:
        last = len(columns) - 1
        _two_places(columns[last - 1], columns[last], features[1], features[0], features[2], surface, last - 1)


@njit(fastmath=True)
def _highest(value):
    """Index of the largest: block maxima first, since a search for an index is not done in vectors."""
    best, where = _NOWHERE, 0
    for begin in range(0, len(value), _BLOCK):
        end = min(begin + _BLOCK, len(value))
        top = _NOWHERE
        for n in range(begin, end):
            top = max(top, value[n])
        if top > best:
            best, where = top, begin
    for n in range(where, min(where + _BLOCK, len(value))):
        if value[n] == best:
            return n
    return where


@njit(fastmath=True)
def two_starts(surface, along_m, across_m, height_m, apart_m, starts):
    """Along, cross and height of the best place and of the best at least ``apart_m`` from it; fills [2, 3]."""
    value = np.empty(surface.shape[1], np.float32)
    for n in range(surface.shape[1]):
        value[n] = max(surface[0, n], max(surface[1, n], surface[2, n]))
    for start in range(2):
        place = _highest(value)
        east, north = along_m[place // len(across_m)], across_m[place % len(across_m)]
        level = 0
        for h in range(surface.shape[0]):
            if surface[h, place] > surface[level, place]:
                level = h
        starts[start, 0], starts[start, 1], starts[start, 2] = east, north, height_m[level]
        for i in range(len(along_m)):
            if abs(along_m[i] - east) < apart_m:
                for j in range(len(across_m)):
                    if (along_m[i] - east) ** 2 + (across_m[j] - north) ** 2 < apart_m * apart_m:
                        value[i * len(across_m) + j] = _NOWHERE
