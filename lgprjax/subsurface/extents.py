"""How far the ground of a map reaches about each of its tile frames."""

import numpy as np
from jaxtyping import Bool, Float

from lgprjax.subsurface.station_places import StationPlaces

_TILES = 2048
"""Frames that are looked at together: memory stays bounded on a long map."""
_LEAST_M = 1e-9


def track_extents(
    frames: Float[np.ndarray, "tile 3"], places: StationPlaces, half_m: Float[np.ndarray, "2"]
) -> tuple[Float[np.ndarray, "tile 2"], Float[np.ndarray, "tile 2"]]:
    """Lowest and highest place of the tracks in each tile's frame, within a box about it.

    Tracks are taken as the chords of their stretches: over sixteen stations a bend of 10 m leaves its chord by
    millimetres.

    Args:
        frames: east_m, north_m, yaw_rad of the tiles.
        places: of the stations.
        half_m: of the box, along and across.
    """
    low, high = np.full((len(frames), 2), np.inf), np.full((len(frames), 2), -np.inf)
    for begin in range(0, len(frames), _TILES):
        about = frames[begin : begin + _TILES]
        tile, stretch = places.stretches_near(about[:, :2], float(np.hypot(*half_m)))
        east, north = np.moveaxis(places.stretches.chord_m[stretch] - about[tile, None, :2], -1, 0)
        cos, sin = np.cos(about[tile, 2:]), np.sin(about[tile, 2:])
        chord = np.stack([cos * east + sin * north, cos * north - sin * east], axis=-1)
        inside, first, last = _clipped(chord, half_m)
        np.minimum.at(low, begin + tile[inside], np.minimum(first, last)[inside])
        np.maximum.at(high, begin + tile[inside], np.maximum(first, last)[inside])
    none = np.any(low > high, axis=1)
    low[none], high[none] = 0.0, 0.0
    return low, high


def _clipped(
    chord_m: Float[np.ndarray, "chord 2 2"], half_m: Float[np.ndarray, "2"]
) -> tuple[Bool[np.ndarray, " chord"], Float[np.ndarray, "chord 2"], Float[np.ndarray, "chord 2"]]:
    """Which chords come into a box about the origin, and both ends of what lies in it (Liang and Barsky 1984)."""
    start, way = chord_m[:, 0], chord_m[:, 1] - chord_m[:, 0]
    way = np.where(np.abs(way) < _LEAST_M, _LEAST_M, way)
    to_low, to_high = (-half_m - start) / way, (half_m - start) / way
    early, late = np.minimum(to_low, to_high), np.maximum(to_low, to_high)
    enter = np.maximum(np.maximum(early[:, 0], early[:, 1]), 0.0)
    leave = np.minimum(np.minimum(late[:, 0], late[:, 1]), 1.0)
    return enter <= leave, start + enter[:, None] * way, start + leave[:, None] * way
