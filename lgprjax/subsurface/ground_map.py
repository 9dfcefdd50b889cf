"""The map as registration sees it: tiles of any extent, gridded when first asked for."""

from collections import OrderedDict
from functools import cached_property
from typing import NamedTuple, Protocol, runtime_checkable

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from lgprjax.frames import LocalFrame
from lgprjax.radar import ChainSettings, CoefficientBasis, coefficient_basis, to_coefficients
from lgprjax.subsurface.components import leading_components
from lgprjax.subsurface.direction import filter_along
from lgprjax.subsurface.grid import GridSpec, TraceSet, grid_spec, grid_traces
from lgprjax.subsurface.index import SpatialIndex
from lgprjax.subsurface.tile import Tile

_SAMPLED = 300
_HELD = 0.99
"""Share of the map's power that its leading components hold: the coarse stage asks for no more."""


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
        label_sigma_m: of each baseline, what its navigation said of its positions, root mean square over the drive
            and over east and north; 0 where it said nothing.
    """

    name: str
    frame: LocalFrame
    settings: ChainSettings
    channel_pitch_m: float
    channels: int
    tile_spacing_m: float
    gain: Float[np.ndarray, " sample"]
    label_sigma_m: tuple[float, ...] = ()


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
    def drive(self) -> Int[np.ndarray, " scan"]:
        """Number of the baseline that each station comes from."""
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
        self._tiles: OrderedDict[tuple[int, int], Tile] = OrderedDict()
        self._stations = SpatialIndex(source.pose[:, :2], 8.0)
        self._frames = SpatialIndex(source.tile_frame[:, :2], 2.0 * self._spacing_m)
        self._low_m, self._high_m = self._extents()
        # One size for all tiles, so that one program serves the whole map.
        self._span_m = np.minimum(2.0 * self._half_m, np.max(self._high_m - self._low_m, axis=0))

    @cached_property
    def basis(self) -> CoefficientBasis:
        """Coefficients of this map's profiles."""
        return coefficient_basis(
            self.description.gain, self.description.settings.sample_interval_ns, self.description.settings
        )

    @cached_property
    def components(self) -> Float[Array, "coefficient component"]:
        """Leading components of the map's coefficients, from some hundred of its stations."""
        chosen = np.unique(np.linspace(0, len(self.source.pose) - 1, _SAMPLED).astype(int))
        stations = self.source.read_stations(chosen)
        valid = jnp.asarray(stations.valid)
        coefficients = np.asarray(to_coefficients(jnp.asarray(stations.profile), valid, self.basis))
        return jnp.asarray(leading_components(coefficients[stations.valid], _HELD))

    def tile_near(self, point_m: Float[np.ndarray, "2"], within_m: float) -> int | None:
        """Number of the tile whose frame is nearest to a point, if the map comes within ``within_m`` of it."""
        return self._frames.nearest(point_m, within_m + self._spacing_m)

    def ground_up_at(self, point_m: Float[np.ndarray, "2"]) -> float:
        """Local height of the ground at the station nearest to a point; NaN far from the map."""
        station = self._stations.nearest(point_m, 16.0)
        return float("nan") if station is None else float(self.source.ground_up_m[station])

    def lanes(self, tile: int) -> Float[np.ndarray, "drive 2"]:
        """Lowest and highest place across the tile's axis that each baseline's array covers near its frame.

        NaN for a baseline that does not come by.
        """
        east, north, yaw = self.frame(tile)
        near = self._stations.near(np.array([east, north]), 0.75 * self._spacing_m)
        apart = self.source.pose[near, :2] - np.array([east, north])
        cross = apart @ np.array([-np.sin(yaw), np.cos(yaw)])
        half_m = 0.5 * self.description.channel_pitch_m * self.description.channels
        out = np.full((len(self.description.label_sigma_m), 2), np.nan)
        for drive in np.unique(self.source.drive[near]):
            own = cross[self.source.drive[near] == drive]
            out[drive] = np.median(own) - half_m, np.median(own) + half_m
        return out

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

    def tile(self, number: int, direction: int = 0) -> Tile:
        """The tile, gridded now or held from before.

        Args:
            number: of the tile.
            direction: of live scans that it is for, 1 along its axis and -1 against it (see ``filter_along``); 0 for
                the ground as the map has it.
        """
        if (number, direction) in self._tiles:
            self._tiles.move_to_end((number, direction))
            return self._tiles[number, direction]
        if direction == 0:
            tile = self._grid(number)
        else:
            length_m = jnp.float32(self.description.settings.track_filter_m)
            tile = filter_along(self.tile(number), length_m, direction=direction)
        self._tiles[number, direction] = tile
        if len(self._tiles) > self._keep:
            self._tiles.popitem(last=False)
        return tile

    def stations_under(self, number: int) -> Int[np.ndarray, " scan"]:
        """Numbers of the stations whose outermost antennas still reach into a tile."""
        spec, origin_m = self.grid_of(number)
        east, north, yaw = self.frame(number)
        corner = np.array([spec.along_cell_m * spec.along_cells, spec.cross_cell_m * spec.cross_cells])
        middle = origin_m + 0.5 * corner
        cos, sin = np.cos(yaw), np.sin(yaw)
        centre = np.array([east + cos * middle[0] - sin * middle[1], north + sin * middle[0] + cos * middle[1]])
        array_m = 0.5 * self.description.channels * self.description.channel_pitch_m
        reach_m = 0.5 * float(np.hypot(*corner)) + array_m + 4.0 * spec.cross_spread_m
        return self._stations.near(centre, reach_m)

    def _grid(self, number: int) -> Tile:
        spec, origin_m = self.grid_of(number)
        east, north, yaw = self.frame(number)
        chosen = self.stations_under(number)
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

    def _extents(self) -> tuple[Float[np.ndarray, "tile 2"], Float[np.ndarray, "tile 2"]]:
        """Extent of the ground about every tile in its frame, with room for the array to both sides.

        A map is a narrow band along its routes: a tile as wide as it is long would be empty for the most part.
        """
        frame = self.source.tile_frame
        reach_m = float(np.hypot(*self._half_m))
        low, high = np.zeros((len(frame), 2)), np.zeros((len(frame), 2))
        for tile, (east, north, yaw) in enumerate(frame):
            near = self._stations.near(np.array([east, north]), reach_m)
            apart = self.source.pose[near, :2] - np.array([east, north])
            cos, sin = np.cos(yaw), np.sin(yaw)
            place = np.stack([apart @ [cos, sin], apart @ [-sin, cos]], axis=1)
            place = place[np.all(np.abs(place) <= self._half_m, axis=1)]
            if len(place):
                low[tile], high[tile] = place.min(axis=0), place.max(axis=0)
        room = self.description.channel_pitch_m * (0.5 * self.description.channels + 1.0)
        return np.maximum(low - room, -self._half_m), np.minimum(high + room, self._half_m)


def padded_stations(stations: int) -> int:
    """Stations that a tile's set is padded to: few sizes, each a compile."""
    return max(64, 1 << max(0, int(stations - 1).bit_length()))


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
    rung = padded_stations(scans)

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
