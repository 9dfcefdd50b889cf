"""The map prepared for one array: tiles filtered like its scans, and templates for its heading and speed."""

from collections import OrderedDict
from collections.abc import Iterator
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from lgprjax.radar import ArrayGeometry, centre_of
from lgprjax.registration.refine import FEW_CHANNELS
from lgprjax.subsurface import GroundMap, StationSource, Tile

# The template bank: the signal of the whole array at every coarse place of a tile, ready for one matrix product.
#
# Correlation is linear in the map. With the signals of all antennas at a place stacked into one column, the correlation
# of any scan with all places is one product of scans and columns: exhaustive, and without a gather. Columns are
# computed once for a tile and heading. In depth they hold the map's leading components only, nearly all of its power;
# refinement uses all coefficients.


class ArrayColumns(NamedTuple):
    """Columns of one tile for one attitude of the array.

    Attributes:
        value: components of every channel at each place, one channel after the other; 0 off the map.
        power: power of each place's ground, over the channels on the map.
        overlap: share of the channels on the map.
        origin_m: along and cross of place (0, 0).
        step_m: distance between places, along and cross.
    """

    value: Float[Array, "along cross channel_component"]
    power: Float[Array, "along cross"]
    overlap: Float[Array, "along cross"]
    origin_m: Float[Array, "2"]
    step_m: Float[Array, "2"]


@partial(jax.jit, static_argnames=("stride", "margin"))
def make_columns(
    tile: Tile,
    components: Float[Array, "coefficient component"],
    offset_m: Float[Array, "channel 2"],
    *,
    stride: tuple[int, int],
    margin: tuple[int, int],
) -> ArrayColumns:
    """Columns of a tile.

    Each channel has the same offset from every place, so that its ground is the tile shifted as a whole: four slices
    with the weights of a bilinear sample.

    Args:
        tile: ground of the map.
        components: orthonormal directions of the coefficients that hold the map's power.
        offset_m: along and cross of each channel from the array's centre, in the tile's frame.
        stride: number of cells between places, along and across.
        margin: number of cells that an antenna may be outside the tile.
    """
    size, kept = tile.valid.shape, components.shape[1]
    border = [(m, m + 1) for m in margin]
    # The numbers of a place are contiguous, so that some places are read without the others.
    ground = jnp.pad(tile.coefficients @ components, [*border, (0, 0)])
    valid = jnp.pad(tile.valid.astype(jnp.float32), border)[..., None]
    # In memory before the channels begin: each would compute it again.
    ground, valid = jax.lax.optimization_barrier((ground, valid))
    reach = jnp.asarray(margin, dtype=jnp.int32)
    cells = offset_m / tile.cell_m[None]
    low = jnp.clip(jnp.floor(cells).astype(jnp.int32), -reach[None], reach[None] - 1)
    part = cells - low.astype(jnp.float32)
    first = [s // 2 for s in stride]

    def channel(number: Int[Array, ""], made: tuple[Array, Array]) -> tuple[Array, Array]:
        value, channels = made
        base, (u, v) = low[number] + reach, part[number]

        def moved(numbers: Float[Array, "_ _ number"]) -> Float[Array, "along cross number"]:
            window = jax.lax.dynamic_slice(
                numbers, (base[0], base[1], 0), (size[0] + 1, size[1] + 1, numbers.shape[-1])
            )
            near, far = window[first[0] : -1 : stride[0]], window[first[0] + 1 :: stride[0]]
            along = (1.0 - u) * near + u * far
            left, right = along[:, first[1] : -1 : stride[1]], along[:, first[1] + 1 :: stride[1]]
            between: Float[Array, "along cross number"] = (1.0 - v) * left + v * right
            return between

        # A place between cells is on the map where all of them are.
        on_map = (moved(valid) > 1.0 - 1e-4).astype(jnp.float32)
        value = jax.lax.dynamic_update_slice(value, moved(ground) * on_map, (0, 0, number * kept))
        return value, channels + on_map[..., 0]

    places = tuple(len(range(f, cells, step)) for f, cells, step in zip(first, size, stride, strict=True))
    blank = jnp.zeros((*places, len(offset_m) * kept), jnp.float32), jnp.zeros(places, jnp.float32)
    value, channels = jax.lax.fori_loop(0, len(offset_m), channel, blank)
    return ArrayColumns(
        value=value,
        power=jnp.sum(value**2, axis=-1),
        overlap=channels / len(offset_m),
        origin_m=tile.origin_m + jnp.asarray(first, dtype=jnp.float32) * tile.cell_m,
        step_m=tile.cell_m * jnp.asarray(stride, dtype=jnp.float32),
    )


_BIN_RAD = np.radians(6.0)
"""Spacing of the headings with columns of their own: half of it moves the end channel of a wide array by 3 cm."""
_CARRIED_M = 0.04
_STRIDE = 0.3  # of the wavelength: spacing of the coarse places
_NARROW = 2  # channels
_LOOKED_AT = 16


class TemplateKey(NamedTuple):
    """Key of a tile's columns: heading and travel of the scans.

    Attributes:
        tile: number of the tile.
        direction: 1 along the tile's axis, -1 against it, 0 across.
        heading: heading relative to the tile's axis, in bins.
        carried: travel of the vehicle while the switch matrix steps through the channels, in bins.
    """

    tile: int
    direction: int
    heading: int
    carried: int


class PreparedTile(NamedTuple):
    """A tile and its columns for one template key."""

    tile: Tile
    columns: ArrayColumns


class TileBatch(NamedTuple):
    """Scans of one tile that are processed together.

    Attributes:
        number: number of the tile.
        ready: prepared tile.
        rows: indices of the scans.
    """

    number: int
    ready: PreparedTile
    rows: Int[np.ndarray, " scan"]


class PreparedGround:
    """Columns of a map for one array, computed on first use and cached.

    Args:
        ground: the map's tiles.
        array: geometry of the drive.
        keep: columns held in memory.

    Attributes:
        stride: cells of a tile from place to place, along and across; ``step_m`` is the same in metres.
        places: number in a tile.
        few_channels: the array has so few channels that its search uses every cell along.
    """

    def __init__(self, ground: GroundMap, array: ArrayGeometry, *, keep: int = 8) -> None:
        self.ground = ground
        self.array = array
        self._keep = keep
        self._held: OrderedDict[TemplateKey, PreparedTile] = OrderedDict()
        centre_x, centre_y = centre_of(array)
        self._body_m = np.stack([array.x_m - centre_x, array.y_m - centre_y], axis=1)
        self._late_s = float(np.max(np.abs(array.time_offset_s)))
        description = ground.description
        spec, _ = ground.grid_of(0)
        self._cell_m = np.array([spec.along_cell_m, spec.cross_cell_m])
        wavelength_m = description.settings.wavelength_m
        # A baseline is a channel's pitch wide for each of its channels: places farther apart across could miss it. An
        # array of one or two channels has enough overlap on half a pitch alone.
        step_m = _STRIDE * wavelength_m
        narrow = description.channels <= len(array.x_m) <= _NARROW and _stand_alone(ground.source)
        widest_m = description.channel_pitch_m * (0.5 if narrow else 1.0)
        steps_m = (step_m, min(step_m, widest_m))
        along, cross = (int(max(1, round(s / cell_m))) for s, cell_m in zip(steps_m, self._cell_m, strict=True))
        # Lines of few channels have few places across; their peaks, of few traces, are narrow and many.
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
    ) -> list[tuple[TemplateKey, Int[np.ndarray, " _"]]]:
        """Scans grouped by template key: their positions, in order."""
        yaw = yaw_rad - self.ground.source.tile_frame[tile, 2]
        turned = np.mod(yaw + np.pi, 2.0 * np.pi) - np.pi
        moving = np.where(speed_mps < 0.0, -1.0, 1.0) * np.cos(turned)
        direction = np.where(np.abs(moving) > 0.5, np.sign(moving), 0.0).astype(int)
        heading = np.round(turned / _BIN_RAD).astype(int)
        carried = np.round(speed_mps * self._late_s / _CARRIED_M).astype(int)
        key = np.stack([tile, direction, heading, carried], axis=1)
        rows, group = np.unique(key, axis=0, return_inverse=True)
        group = group.reshape(-1)
        return [(TemplateKey(*(int(v) for v in row)), np.flatnonzero(group == n)) for n, row in enumerate(rows)]

    def batches(
        self,
        tile: Int[np.ndarray, " scan"],
        yaw_rad: Float[np.ndarray, " scan"],
        speed_mps: Float[np.ndarray, " scan"],
        size: int,
    ) -> Iterator[TileBatch]:
        """Scans on a tile (those with -1 have none) that share a template key, at most ``size`` together."""
        known = np.flatnonzero(tile >= 0)
        for aspect, rows in self.aspects(tile[known], yaw_rad[known], speed_mps[known]):
            ready, own = self.at(aspect), known[rows]
            for low in range(0, len(own), size):
                yield TileBatch(aspect.tile, ready, own[low : low + size])

    def at(self, aspect: TemplateKey) -> PreparedTile:
        """Tile and columns, from the cache or computed now."""
        if aspect in self._held:
            self._held.move_to_end(aspect)
            return self._held[aspect]
        ready = self.make(aspect)
        self.hold(aspect, ready)
        return ready

    def holds(self, aspect: TemplateKey) -> bool:
        """Whether a tile is prepared for a template key."""
        return aspect in self._held

    def hold(self, aspect: TemplateKey, ready: PreparedTile) -> None:
        """Cache what ``make`` returned, here or elsewhere, for this map and array; drops the least recently used."""
        self._held[aspect] = ready
        if len(self._held) > self._keep:
            self._held.popitem(last=False)

    def make(self, aspect: TemplateKey) -> PreparedTile:
        """Tile and columns, computed now."""
        tile = self.ground.tile(aspect.tile, aspect.direction)
        columns = make_columns(
            tile,
            self.ground.components,
            jnp.asarray(self._offsets(aspect), dtype=jnp.float32),
            stride=self.stride,
            margin=self._margin,
        )
        return PreparedTile(tile, columns)

    def _offsets(self, aspect: TemplateKey) -> Float[np.ndarray, "channel 2"]:
        body_m = self._body_m.copy()
        if self._late_s > 0.0:
            body_m[:, 0] += aspect.carried * _CARRIED_M * self.array.time_offset_s / self._late_s
        yaw = aspect.heading * _BIN_RAD
        cos, sin = np.cos(yaw), np.sin(yaw)
        return np.asarray(body_m @ np.array([[cos, sin], [-sin, cos]]))


def _stand_alone(source: StationSource) -> bool:
    """Whether a map's baselines are single, without neighbours, at most of the sampled places."""
    frames, description = source.tile_frame, source.description
    pitch_m, width_m = description.channel_pitch_m, description.array_width_m
    reach_m = width_m + max(pitch_m, description.settings.step_m)
    chosen = np.unique(np.linspace(0, len(frames) - 1, _LOOKED_AT).astype(int))
    alone = 0
    for east_m, north_m, yaw in frames[chosen]:
        point_m = np.array([east_m, north_m])
        apart_m = source.places.read(source.places.near(point_m, reach_m)).pose[:, :2] - point_m
        left_m = np.abs(np.cos(yaw) * apart_m[:, 1] - np.sin(yaw) * apart_m[:, 0])
        alone += not np.any((left_m > 0.5 * pitch_m) & (left_m < width_m + 0.5 * pitch_m))
    return 2 * alone > len(chosen)


# Poses in the frame of a tile, and back.


def to_tile(pose: Float[np.ndarray, "batch 5"], frame: Float[np.ndarray, "3"]) -> Float[np.ndarray, "batch 5"]:
    """Poses of the map's frame in that of a tile."""
    east, north, yaw = frame
    cos, sin = np.cos(yaw), np.sin(yaw)
    out = pose.copy()
    out[:, 0] = cos * (pose[:, 0] - east) + sin * (pose[:, 1] - north)
    out[:, 1] = cos * (pose[:, 1] - north) - sin * (pose[:, 0] - east)
    out[:, 3] = np.mod(pose[:, 3] - yaw + np.pi, 2 * np.pi) - np.pi
    return out


def fixes_to_map(
    pose: Float[np.ndarray, "end 5"], covariance: Float[np.ndarray, "end 5 5"], frame: Float[np.ndarray, "3"]
) -> tuple[Float[np.ndarray, "end 5"], Float[np.ndarray, "end 5 5"]]:
    """Poses of a tile's frame in that of the map."""
    east, north, yaw = frame
    cos, sin = np.cos(yaw), np.sin(yaw)
    turn = np.eye(5)
    turn[:2, :2] = [[cos, -sin], [sin, cos]]
    moved = np.asarray(pose, dtype=np.float64) @ turn.T + np.array([east, north, 0.0, yaw, 0.0])
    return moved, turn @ np.asarray(covariance, dtype=np.float64) @ turn.T
