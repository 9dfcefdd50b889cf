"""The map as registration sees it: tiles of any extent, gridded when first asked for."""

from collections import OrderedDict
from functools import cached_property

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from lgprjax.radar import CoefficientBasis, coefficient_basis, to_coefficients
from lgprjax.subsurface.components import leading_components
from lgprjax.subsurface.direction import filter_along
from lgprjax.subsurface.extents import track_extents
from lgprjax.subsurface.grid import GridSpec, TraceSet, grid_spec, grid_traces
from lgprjax.subsurface.index import SpatialIndex
from lgprjax.subsurface.station_source import Stations, StationSource
from lgprjax.subsurface.tile import Tile

_SAMPLED = 300
_HELD = 0.99
"""Share of the map's power that its leading components hold: the coarse stage asks for no more."""


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
        chosen = np.unique(np.linspace(0, len(self.source.places) - 1, _SAMPLED).astype(int))
        stations = self.source.read_stations(chosen)
        valid = jnp.asarray(stations.valid)
        coefficients = np.asarray(to_coefficients(jnp.asarray(stations.profile), valid, self.basis))
        return jnp.asarray(leading_components(coefficients[stations.valid], _HELD))

    def tile_near(self, point_m: Float[np.ndarray, "2"], within_m: float) -> int | None:
        """Number of the tile whose frame is nearest to a point, if the map comes within ``within_m`` of it."""
        return self._frames.nearest(point_m, within_m + self._spacing_m)

    def tiles_near(self, points_m: Float[np.ndarray, "point 2"], within_m: float) -> Int[np.ndarray, " point"]:
        """What ``tile_near`` finds of many points at once; -1 for none."""
        return self._frames.nearest_each(points_m, within_m + self._spacing_m)

    def ground_up_at(self, points_m: Float[np.ndarray, "point 2"]) -> Float[np.ndarray, " point"]:
        """Local height of the ground at the station nearest to each point; NaN far from the map."""
        station = self.source.places.nearest(points_m, 16.0)
        number, where = np.unique(station[station >= 0], return_inverse=True)
        up = np.full(len(points_m), np.nan)
        up[station >= 0] = self.source.places.read(number).ground_up_m[where]
        return up

    def lanes(self, tile: int) -> Float[np.ndarray, "drive 2"]:
        """Lowest and highest place across the tile's axis that each baseline's array covers near its frame.

        NaN for a baseline that does not come by.
        """
        east, north, yaw = self.frame(tile)
        places = self.source.places
        near = places.read(places.near(np.array([east, north]), 0.75 * self._spacing_m))
        apart = near.pose[:, :2] - np.array([east, north])
        cross = apart @ np.array([-np.sin(yaw), np.cos(yaw)])
        half_m = 0.5 * self.description.channel_pitch_m * self.description.channels
        out = np.full((len(self.description.label_sigma_m), 2), np.nan)
        for drive in np.unique(near.drive):
            own = cross[near.drive == drive]
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
        return self.source.places.near(*self._about(number))

    def padded_under(self, number: int) -> int:
        """Stations that a tile's set is padded to: few sizes, each a compile; told without reading a station."""
        most = self.source.places.most_near(*self._about(number))
        return max(64, 1 << max(0, (most - 1).bit_length()))

    def _about(self, number: int) -> tuple[Float[np.ndarray, "2"], float]:
        """Middle of a tile, and how far from it a station's outermost antennas still reach into the tile."""
        spec, origin_m = self.grid_of(number)
        east, north, yaw = self.frame(number)
        corner = np.array([spec.along_cell_m * spec.along_cells, spec.cross_cell_m * spec.cross_cells])
        middle = origin_m + 0.5 * corner
        cos, sin = np.cos(yaw), np.sin(yaw)
        centre = np.array([east + cos * middle[0] - sin * middle[1], north + sin * middle[0] + cos * middle[1]])
        array_m = 0.5 * self.description.channels * self.description.channel_pitch_m
        return centre, 0.5 * float(np.hypot(*corner)) + array_m + 4.0 * spec.cross_spread_m

    def _grid(self, number: int) -> Tile:
        spec, origin_m = self.grid_of(number)
        east, north, yaw = self.frame(number)
        chosen = self.stations_under(number)
        stations, places = self.source.read_stations(chosen), self.source.places.read(chosen)
        traces = _trace_set(
            stations,
            places.pose,
            (east, north, yaw),
            float(self.source.height_reference_m[number]),
            self.basis,
            self.padded_under(number),
            self._weight(places.drive),
        )
        tile: Tile = grid_traces(
            traces,
            self.basis.angular_frequency_rad_per_ns,
            jnp.asarray(origin_m, dtype=jnp.float32),
            spec=spec,
        )
        return tile

    def _weight(self, drive: Int[np.ndarray, " scan"]) -> Float[np.ndarray, " scan"]:
        """Of stations of these baselines."""
        known = self.description.weight
        return np.asarray(known, np.float64)[drive] if known else np.ones(len(drive))

    def _extents(self) -> tuple[Float[np.ndarray, "tile 2"], Float[np.ndarray, "tile 2"]]:
        """Extent of the ground about every tile in its frame, with room for the array to both sides.

        A map is a narrow band along its routes: a tile as wide as it is long would be empty for the most part.
        """
        low, high = track_extents(self.source.tile_frame, self.source.places, self._half_m)
        room = self.description.channel_pitch_m * (0.5 * self.description.channels + 1.0)
        return np.maximum(low - room, -self._half_m), np.minimum(high + room, self._half_m)


def _trace_set(
    stations: Stations,
    pose: Float[np.ndarray, "scan 5"],
    frame: tuple[float, float, float],
    height_reference_m: float,
    basis: CoefficientBasis,
    rung: int,
    weight: Float[np.ndarray, " scan"],
) -> TraceSet:
    """Station traces in a tile's frame, padded to ``rung`` stations, each with the weight of its station."""
    east, north, yaw = frame
    scans, channels = stations.valid.shape
    position = pose[:, None, :2] + stations.antenna_m[..., :2] - np.array([east, north])
    cos, sin = np.cos(yaw), np.sin(yaw)
    along = position[..., 0] * cos + position[..., 1] * sin
    cross = position[..., 1] * cos - position[..., 0] * sin
    turn = np.broadcast_to((pose[:, 3] - yaw)[:, None], along.shape)

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
        weight=jnp.where(valid, padded(weight)[:, None], jnp.float32(0.0)).reshape(-1),
    )
