"""The ground of a tracked drive: tiles for its widest rung, and those of them that are gridded in unlike shapes."""

from dataclasses import replace

import numpy as np
from jaxtyping import Float

from lgprjax.registration.drive import ground_map_for
from lgprjax.registration.options import RegisterOptions
from lgprjax.registration.policy import Policy
from lgprjax.subsurface import GroundMap, StationSource


def tracking_ground(source: StationSource, options: RegisterOptions, *, keep: int = 4) -> GroundMap:
    """Tiles large enough for the widest rung; ``keep`` are held."""
    policy = Policy.of(options, source.description.settings.wavelength_m)
    return ground_map_for(source, replace(options, search_m=policy.ladder[-1].half_m), keep=keep)


def one_of_each_size(ground: GroundMap) -> list[int]:
    """A tile for every padded number of stations that a tile of the map is gridded from."""
    found: dict[int, int] = {}
    for tile in range(len(ground.source.tile_frame)):
        found.setdefault(ground.padded_under(tile), tile)
    return list(found.values())


def in_map(place_m: Float[np.ndarray, "2"], frame: Float[np.ndarray, "3"]) -> Float[np.ndarray, "2"]:
    """East and north of a place given along and across a tile's frame."""
    cos, sin = np.cos(frame[2]), np.sin(frame[2])
    return np.asarray(frame[:2] + np.array([[cos, -sin], [sin, cos]]) @ place_m)
