"""The map as registration sees it: tiles of any extent, gridded when first asked for."""

from collections import OrderedDict
from functools import cached_property
from typing import NamedTuple, Protocol, runtime_checkable

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from lgprjax.frames import LocalFrame
from lgprjax.radar import ChainSettings, CoefficientBasis, coefficient_basis, to_coefficients
from lgprjax.subsurface.grid import GridSpec, TraceSet, grid_spec, grid_traces
from lgprjax.subsurface.index import SpatialIndex
from lgprjax.subsurface.tile import Tile


class MapDescription(NamedTuple):
    """What holds for a whole map.

    Attributes:
        name: of the map.
        frame: its local frame.
        settings: the chain that its baselines went through, and live scans must.
        channel_pitch_m: spacing of the array's channels.
        channels: largest number of channels of a baseline.
        tile_spacing_m: no station is farther than half of this from a tile frame.
        gain: depth gain of each profile sample.
    """

    name: str
    frame: LocalFrame
    settings: ChainSettings
    channel_pitch_m: float
    channels: int
    tile_spacing_m: float
    gain: Float[np.ndarray, " sample"]


class Stations(NamedTuple):
    """Stations read from a database; antennas as east and north offset from the pose, height above ground."""

    profile: Float[np.ndarray, "scan channel sample"]
    valid: Bool[np.ndarray, "scan channel"]
    antenna_m: Float[np.ndarray, "scan channel 3"]


@runtime_checkable
class StationSource(Protocol):
    """A subsurface database, open for reading. Poses are in memory, profiles are read when needed."""

    @property
    def description(self) -> MapDescription:
        """What holds for the whole map."""
        ...

    @property
    def pose(self) -> Float[np.ndarray, "scan 5"]:
        """Of every station."""
        ...

    @property
    def ground_up_m(self) -> Float[np.ndarray, " scan"]:
        """Local height of the ground at every station."""
        ...

    @property
    def tile_frame(self) -> Float[np.ndarray, "tile 3"]:
        """East, north and yaw of every tile."""
        ...

    @property
    def height_reference_m(self) -> Float[np.ndarray, " tile"]:
        """Antenna height that each tile is brought to."""
        ...

    def read_stations(self, stations: Int[np.ndarray, " scan"]) -> Stations:
        """Profiles of the stations with these (rising) numbers."""
        ...


class GroundMap:
    """Tiles of a subsurface database.

    Args:
        source: the database.
        half_along_m, half_cross_m: extent of a tile about its frame, before it is cut to the map's own.
        keep: gridded tiles held in memory.
    """

    def __init__(
        self,
        source: StationSource,
        *,
        half_along_m: float,
        half_cross_m: float,
        keep: int = 4,
    ) -> None:
        self.source = source
        self.description = source.description
        self._half_m = np.array([half_along_m, half_cross_m])
        self._spacing_m = self.description.tile_spacing_m
        self._keep = keep
        self._tiles: OrderedDict[int, Tile] = OrderedDict()
        self._stations = SpatialIndex(source.pose[:, :2], 8.0)
        self._frames = SpatialIndex(source.tile_frame[:, :2], 2.0 * self._spacing_m)
        self._low_m, self._high_m = self._extents(_bounding_box(source.pose))
        # One size for all tiles, so that one program serves the whole map.
        self._span_m = np.minimum(2.0 * self._half_m, np.max(self._high_m - self._low_m, axis=0))

    @cached_property
    def basis(self) -> CoefficientBasis:
        """Coefficients of this map's profiles."""
        return coefficient_basis(
            self.description.gain, self.description.settings.sample_interval_ns, self.description.settings
        )

    def tile_near(self, point_m: Float[np.ndarray, "2"], within_m: float) -> int | None:
        """Number of the tile whose frame is nearest to a point, if the map comes within ``within_m`` of it."""
        return self._frames.nearest(point_m, within_m + self._spacing_m)

    def ground_up_at(self, point_m: Float[np.ndarray, "2"]) -> float:
        """Local height of the ground at the station nearest to a point; NaN far from the map."""
        station = self._stations.nearest(point_m, 16.0)
        return float("nan") if station is None else float(self.source.ground_up_m[station])

    def frame(self, tile: int) -> Float[np.ndarray, "3"]:
        """East, north and yaw of a tile."""
        return np.asarray(self.source.tile_frame[tile])

    def grid_of(self, tile: int) -> tuple[GridSpec, Float[np.ndarray, "2"]]:
        """Grid of a tile and where its first cell lies: the asked extent, no larger than the whole map."""
        description = self.description
        low, high = self._low_m[tile], self._high_m[tile]
        spec = grid_spec(
            float(self._span_m[0]),
            float(self._span_m[1]),
            step_m=description.settings.step_m,
            pitch_m=description.channel_pitch_m,
            wavelength_m=description.settings.wavelength_m,
        )
        cell_m = np.array([spec.along_cell_m, spec.cross_cell_m])
        size_m = cell_m * (np.array([spec.along_cells, spec.cross_cells]) - 1)
        # The ladder's grid may be larger than asked: centred on the frame where the map reaches that far.
        origin = np.where(size_m >= high - low, 0.5 * (low + high) - 0.5 * size_m, -0.5 * size_m)
        inside = np.clip(-0.5 * size_m, low, np.maximum(high - size_m, low))
        return spec, np.where(size_m >= high - low, origin, inside)

    def tile(self, number: int) -> Tile:
        """The tile, gridded now or held from before."""
        if number in self._tiles:
            self._tiles.move_to_end(number)
            return self._tiles[number]
        tile = self._grid(number)
        self._tiles[number] = tile
        if len(self._tiles) > self._keep:
            self._tiles.popitem(last=False)
        return tile

    def _grid(self, number: int) -> Tile:
        spec, origin_m = self.grid_of(number)
        east, north, yaw = self.frame(number)
        corner = np.array([spec.along_cell_m * spec.along_cells, spec.cross_cell_m * spec.cross_cells])
        middle = origin_m + 0.5 * corner
        cos, sin = np.cos(yaw), np.sin(yaw)
        centre = np.array([east + cos * middle[0] - sin * middle[1], north + sin * middle[0] + cos * middle[1]])
        # Stations whose outermost antennas still reach into the tile.
        array_m = 0.5 * self.description.channels * self.description.channel_pitch_m
        reach_m = 0.5 * float(np.hypot(*corner)) + array_m + 4.0 * spec.cross_spread_m
        chosen = self._stations.near(centre, reach_m)
        stations = self.source.read_stations(chosen)
        traces = _trace_set(
            stations,
            self.source.pose[chosen],
            (east, north, yaw),
            float(self.source.height_reference_m[number]),
            self.basis,
        )
        tile: Tile = grid_traces(
            traces,
            self.basis.angular_frequency_rad_per_ns,
            jnp.asarray(origin_m, dtype=jnp.float32),
            spec=spec,
        )
        return tile

    def _extents(
        self, corners_m: Float[np.ndarray, "4 2"]
    ) -> tuple[Float[np.ndarray, "tile 2"], Float[np.ndarray, "tile 2"]]:
        """Extent of the whole map in every tile's frame, with room for the array to both sides."""
        frame = self.source.tile_frame
        apart = corners_m[None] - frame[:, None, :2]
        cos, sin = np.cos(frame[:, 2])[:, None], np.sin(frame[:, 2])[:, None]
        along, cross = apart[..., 0] * cos + apart[..., 1] * sin, apart[..., 1] * cos - apart[..., 0] * sin
        room = self.description.channel_pitch_m * self.description.channels
        low = np.stack([along.min(axis=1), cross.min(axis=1)], axis=1) - room
        return low, np.stack([along.max(axis=1), cross.max(axis=1)], axis=1) + room


def _bounding_box(pose: Float[np.ndarray, "scan 5"]) -> Float[np.ndarray, "4 2"]:
    low, high = pose[:, :2].min(axis=0), pose[:, :2].max(axis=0)
    return np.array([[low[0], low[1]], [low[0], high[1]], [high[0], low[1]], [high[0], high[1]]])


def _trace_set(
    stations: Stations,
    pose: Float[np.ndarray, "scan 5"],
    frame: tuple[float, float, float],
    height_reference_m: float,
    basis: CoefficientBasis,
) -> TraceSet:
    """Station traces in a tile's frame, padded."""
    east, north, yaw = frame
    scans, channels = stations.valid.shape
    position = pose[:, None, :2] + stations.antenna_m[..., :2] - np.array([east, north])
    cos, sin = np.cos(yaw), np.sin(yaw)
    along = position[..., 0] * cos + position[..., 1] * sin
    cross = position[..., 1] * cos - position[..., 0] * sin
    turn = np.broadcast_to((pose[:, 3] - yaw)[:, None], along.shape)
    # A rung of 64 · 2^n stations: few shapes are ever compiled.
    rung = max(64, 1 << max(0, int(scans - 1).bit_length()))

    def padded(values: np.ndarray) -> Array:
        full = np.zeros((rung, *values.shape[1:]), np.float32)
        full[:scans] = values
        return jnp.asarray(full)

    def by_trace(values: np.ndarray) -> Array:
        return padded(values).reshape(rung * channels, *values.shape[2:])

    valid = padded(stations.valid) > 0.0
    coefficients = to_coefficients(padded(stations.profile), valid, basis)
    return TraceSet(
        coefficients=coefficients.reshape(rung * channels, -1),
        position_m=by_trace(np.stack([along, cross], axis=-1)),
        direction=by_trace(np.stack([np.cos(turn), np.sin(turn)], axis=-1)),
        above_reference_m=by_trace(stations.antenna_m[..., 2] - height_reference_m),
        weight=valid.reshape(-1).astype(jnp.float32),
    )
