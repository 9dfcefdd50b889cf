"""The ground of a tracked drive: tiles for its widest rung, and those of them that are gridded in unlike shapes."""

from dataclasses import replace

import numpy as np
from jaxtyping import Float

from lgprjax.registration.drive import ground_map_for
from lgprjax.registration.options import RegisterOptions
from lgprjax.registration.policy import Policy
from lgprjax.subsurface import GroundMap, SpatialIndex, StationSource

_FEWEST_STATIONS = 64


def tracking_ground(source: StationSource, options: RegisterOptions) -> GroundMap:
    """Tiles large enough for the widest rung."""
    policy = Policy.of(options, source.description.settings.wavelength_m)
    return ground_map_for(source, replace(options, search_m=policy.ladder[-1].half_m))


def one_of_each_size(ground: GroundMap) -> list[int]:
    """A tile for every padded number of stations that a tile of the map is gridded from."""
    description, source = ground.description, ground.source
    index = SpatialIndex(source.pose[:, :2], 8.0)
    found: dict[int, int] = {}
    for tile, frame in enumerate(source.tile_frame):
        spec, origin_m = ground.grid_of(tile)
        size_m = np.array([spec.along_cell_m * spec.along_cells, spec.cross_cell_m * spec.cross_cells])
        array_m = 0.5 * description.channels * description.channel_pitch_m
        reach_m = 0.5 * float(np.hypot(*size_m)) + array_m + 4.0 * spec.cross_spread_m
        stations = len(index.near(in_map(origin_m + 0.5 * size_m, frame), reach_m))
        found.setdefault(max(_FEWEST_STATIONS, 1 << max(0, stations - 1).bit_length()), tile)
    return list(found.values())


def in_map(place_m: Float[np.ndarray, "2"], frame: Float[np.ndarray, "3"]) -> Float[np.ndarray, "2"]:
    """East and north of a place given along and across a tile's frame."""
    cos, sin = np.cos(frame[2]), np.sin(frame[2])
    return np.asarray(frame[:2] + np.array([[cos, -sin], [sin, cos]]) @ place_m)
