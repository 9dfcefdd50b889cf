"""A map's ground held from drive to drive: drives of one road come by the same tiles."""

import numpy as np

from lgprjax.formats import MapFile
from lgprjax.radar import ArrayGeometry
from lgprjax.registration import PreparedGround, RegisterOptions, ground_map_for, tracking_ground
from lgprjax.registration.tracking_ground import one_of_each_size


class HeldGround:
    """Tiles of a map for one search, and their columns for the array seen last.

    Args:
        source: the map; stays open as long.
        options: the search.
        tiles: held in memory, and as many columns.
    """

    def __init__(self, source: MapFile, options: RegisterOptions, *, tiles: int = 4) -> None:
        make = tracking_ground if options.track else ground_map_for
        self.ground = make(source, options, keep=tiles)
        self._tiles = tiles
        self._prepared: PreparedGround | None = None

    def prepared_for(self, array: ArrayGeometry) -> PreparedGround:
        """Columns for an array: those held, or none yet where it is not the one before."""
        if self._prepared is None or not _alike(self._prepared.array, array):
            self._prepared = PreparedGround(self.ground, array, keep=self._tiles)
        return self._prepared

    def warm_up(self) -> None:
        """Compile the gridding of every size of station set that the map has: no later drive meets a new one."""
        for tile in one_of_each_size(self.ground):
            for direction in (0, 1, -1):
                self.ground.tile(tile, direction)


def _alike(one: ArrayGeometry, other: ArrayGeometry) -> bool:
    return all(np.array_equal(np.asarray(a), np.asarray(b)) for a, b in zip(one, other, strict=True))
