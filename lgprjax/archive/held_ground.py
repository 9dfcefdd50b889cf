"""A map's ground held from drive to drive: drives of one road come by the same tiles."""

import numpy as np

from lgprjax.archive.chance_cache import chance_of
from lgprjax.formats import MapFile
from lgprjax.radar import ArrayGeometry, uniform_array
from lgprjax.registration import PreparedGround, RegisterOptions, ground_map_for
from lgprjax.registration.stops import Plan

_ROOM_M = 0.5  # by which a lattice reaches beyond the region on each side, so that priors may wander


class HeldGround:
    """Tiles of a map for one search, its chance, and the template banks for the array seen last.

    Args:
        source: the map; stays open as long.
        options: the search.
        tiles: held in memory, and as many template banks.
    """

    def __init__(self, source: MapFile, options: RegisterOptions, *, tiles: int = 8) -> None:
        self.ground = ground_map_for(source, options, keep=tiles)
        self.chance = chance_of(source)
        self._tiles = tiles
        self._prepared: PreparedGround | None = None

    def prepared_for(self, array: ArrayGeometry) -> PreparedGround:
        """Template banks for an array: those held, or none yet where it is not the one before."""
        if self._prepared is None or not _alike(self._prepared.array, array):
            self._prepared = PreparedGround(self.ground, array, keep=self._tiles)
        return self._prepared


def lattice_points(source: MapFile, search_m: float) -> int:
    """Points to the longer side of the search lattice on a map, for a search square of this half side."""
    description, options = source.description, RegisterOptions()
    array = uniform_array(description.channels, description.channel_pitch_m)
    return max(Plan.of(PreparedGround(ground_map_for(source, options), array), options).points(search_m + _ROOM_M))


def _alike(one: ArrayGeometry, other: ArrayGeometry) -> bool:
    return all(np.array_equal(np.asarray(a), np.asarray(b)) for a, b in zip(one, other, strict=True))
