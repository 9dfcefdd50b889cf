"""The ground made ready for one drive: tiles filtered as its scans are, and their array columns."""

from collections import OrderedDict
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, Int

from lgprjax.radar import ArrayGeometry, centre_of
from lgprjax.registration.columns import ArrayColumns, make_columns
from lgprjax.registration.finish import FEW_CHANNELS
from lgprjax.subsurface import GroundMap, Tile

_BIN_RAD = np.radians(6.0)
"""Headings this far apart have columns of their own: half of it moves the end channel of a wide array by 3 cm."""
_CARRIED_M = 0.04
_STRIDE = 0.3  # of the wavelength, from coarse place to coarse place


class Aspect(NamedTuple):
    """How scans look at a tile: what their columns depend on.

    Attributes:
        tile: its number.
        direction: 1 along the tile's axis, -1 against it, 0 across.
        heading: in bins, relative to the tile's axis.
        carried: in bins, how far the vehicle comes while the switch matrix steps through the channels.
    """

    tile: int
    direction: int
    heading: int
    carried: int


class PreparedTile(NamedTuple):
    """A tile and its columns for one aspect."""

    tile: Tile
    columns: ArrayColumns


class PreparedGround:
    """Columns of a map for one array, made when first asked for and kept for a while.

    Args:
        ground: the map's tiles.
        array: geometry of the drive.
        keep: columns held in memory.

    Attributes:
        stride: cells of a tile from place to place, along and across; ``step_m`` is the same in metres.
        places: of a tile.
        few_channels: the array has so few that its search takes every cell along.
    """

    def __init__(self, ground: GroundMap, array: ArrayGeometry, *, keep: int = 8) -> None:
        self.ground = ground
        self.array = array
        self._keep = keep
        self._held: OrderedDict[Aspect, PreparedTile] = OrderedDict()
        centre_x, centre_y = centre_of(array)
        self._body_m = np.stack([array.x_m - centre_x, array.y_m - centre_y], axis=1)
        self._late_s = float(np.max(np.abs(array.time_offset_s)))
        description = ground.description
        spec, _ = ground.grid_of(0)
        self._cell_m = np.array([spec.along_cell_m, spec.cross_cell_m])
        wavelength_m = description.settings.wavelength_m
        # A lane is at least a channel's pitch wide: places farther apart across could miss that of a lone channel.
        step_m = _STRIDE * wavelength_m
        steps_m = (step_m, min(step_m, description.channel_pitch_m))
        along, cross = (int(max(1, round(s / cell_m))) for s, cell_m in zip(steps_m, self._cell_m, strict=True))
        # Lines of few channels have few places across; their summits, of few traces, are narrow and many.
        self.few_channels = len(array.x_m) <= FEW_CHANNELS
        self.stride = (max(1, round(0.2 * wavelength_m / self._cell_m[0])) if self.few_channels else along, cross)
        self.step_m = self._cell_m * np.array(self.stride)
        array_m = float(np.max(np.hypot(*self._body_m.T))) + 0.5
        self._margin = tuple(int(np.ceil(array_m / cell_m)) + 1 for cell_m in self._cell_m)
        sides = zip((spec.along_cells, spec.cross_cells), self._margin, self.stride, strict=True)
        self.places = int(np.prod([-(-(cells + 2 * margin) // stride) for cells, margin, stride in sides]))

    def aspects(
        self,
        tile: Int[np.ndarray, " scan"],
        yaw_rad: Float[np.ndarray, " scan"],
        speed_mps: Float[np.ndarray, " scan"],
    ) -> list[tuple[Aspect, Int[np.ndarray, " _"]]]:
        """Scans grouped by how they look at which tile: their positions, in order."""
        yaw = yaw_rad - self.ground.source.tile_frame[tile, 2]
        turned = np.mod(yaw + np.pi, 2.0 * np.pi) - np.pi
        moving = np.where(speed_mps < 0.0, -1.0, 1.0) * np.cos(turned)
        direction = np.where(np.abs(moving) > 0.5, np.sign(moving), 0.0).astype(int)
        heading = np.round(turned / _BIN_RAD).astype(int)
        carried = np.round(speed_mps * self._late_s / _CARRIED_M).astype(int)
        key = np.stack([tile, direction, heading, carried], axis=1)
        rows, group = np.unique(key, axis=0, return_inverse=True)
        group = group.reshape(-1)
        return [(Aspect(*(int(v) for v in row)), np.flatnonzero(group == n)) for n, row in enumerate(rows)]

    def at(self, aspect: Aspect) -> PreparedTile:
        """Tile and columns, made now or held from before."""
        if aspect in self._held:
            self._held.move_to_end(aspect)
            return self._held[aspect]
        ready = self.make(aspect)
        self.hold(aspect, ready)
        return ready

    def holds(self, aspect: Aspect) -> bool:
        """Whether a tile is ready for an aspect."""
        return aspect in self._held

    def hold(self, aspect: Aspect, ready: PreparedTile) -> None:
        """Keep what ``make`` gave, here or elsewhere for the same map and array; the least used goes."""
        self._held[aspect] = ready
        if len(self._held) > self._keep:
            self._held.popitem(last=False)

    def make(self, aspect: Aspect) -> PreparedTile:
        """Tile and columns, made now."""
        tile = self.ground.tile(aspect.tile, aspect.direction)
        columns = make_columns(
            tile,
            self.ground.components,
            jnp.asarray(self._offsets(aspect), dtype=jnp.float32),
            stride=self.stride,
            margin=self._margin,
        )
        return PreparedTile(tile, columns)

    def _offsets(self, aspect: Aspect) -> Float[np.ndarray, "channel 2"]:
        body_m = self._body_m.copy()
        if self._late_s > 0.0:
            body_m[:, 0] += aspect.carried * _CARRIED_M * self.array.time_offset_s / self._late_s
        yaw = aspect.heading * _BIN_RAD
        cos, sin = np.cos(yaw), np.sin(yaw)
        return np.asarray(body_m @ np.array([[cos, sin], [-sin, cos]]))
