"""The map as used by registration: tiles of any extent, gridded on first use."""

from collections import OrderedDict
from functools import cached_property
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Float32, Int

from lgprjax.radar import CoefficientBasis, air_delay_ns, coefficient_basis, shift_travel_time, to_coefficients
from lgprjax.subsurface.grid import GridSpec, Tile, TraceSet, filter_along, grid_spec, grid_traces, leading_components
from lgprjax.subsurface.stations import SpatialIndex, StationSource, track_extents

# Stations of a map as coefficients at one antenna height, computed once for all tiles that share them.

_BLOCK = 256
"""Stations that are read and levelled together; chunk size of the traces on disk."""
_HELD_BYTES = 64e6


class LevelledStations(NamedTuple):
    """Stations, one row each.

    Attributes:
        coefficients: coefficients of every trace, at the common antenna height; zeros if it is not valid.
        place_m: east and north of every antenna.
        yaw_rad: yaw of the array.
        weight: weight of every trace in gridding; 0 if it is not valid.
    """

    coefficients: Float32[np.ndarray, "scan channel coefficient"]
    place_m: Float[np.ndarray, "scan channel 2"]
    yaw_rad: Float[np.ndarray, " scan"]
    weight: Float32[np.ndarray, "scan channel"]


class Levelling:
    """Reads and levels stations block by block, and caches the most recent.

    Neighbouring tiles share most of their stations. The cache is bounded, except for what one call needs.

    Args:
        source: the database.
        basis: coefficients of its profiles.
        height_m: antenna height that all traces are reduced to.
    """

    def __init__(self, source: StationSource, basis: CoefficientBasis, height_m: float) -> None:
        self._source = source
        self._basis = basis
        self._height_m = height_m
        self._held: OrderedDict[int, LevelledStations] = OrderedDict()

    def read(self, stations: Int[np.ndarray, " scan"]) -> LevelledStations:
        """Stations with these rising numbers.

        Raises:
            InputError: a part of them is damaged.
        """
        numbers = stations // _BLOCK
        # Without any, the shapes are those of the first block.
        blocks = np.unique(numbers) if len(stations) else np.zeros(1, np.int64)
        bounds = np.append(np.searchsorted(numbers, blocks), len(stations))
        parts = []
        for block, low, high in zip(blocks, bounds[:-1], bounds[1:], strict=True):
            own = stations[low:high] - block * _BLOCK
            parts.append([field[own] for field in self._block(int(block))])
        held_bytes = len(self._held) * max(block.coefficients.nbytes for block in self._held.values())
        while held_bytes > _HELD_BYTES and len(self._held) > len(blocks):
            held_bytes -= self._held.popitem(last=False)[1].coefficients.nbytes
        return LevelledStations(*(np.concatenate(field) for field in zip(*parts, strict=True)))

    def _block(self, number: int) -> LevelledStations:
        if number in self._held:
            self._held.move_to_end(number)
        else:
            self._held[number] = self._levelled(number)
        return self._held[number]

    def _levelled(self, number: int) -> LevelledStations:
        stations = np.arange(number * _BLOCK, min((number + 1) * _BLOCK, len(self._source.places)))
        read, places = self._source.read_stations(stations), self._source.places.read(stations)
        above_m = read.antenna_m[..., 2] - self._height_m
        # The map's last block is filled up: one shape, one compile.
        filled = (_filled(field) for field in (read.profile, read.valid, above_m.astype(np.float32)))
        known = self._source.description.weight
        weight = np.asarray(known, np.float32)[places.drive] if known else np.ones(len(stations), np.float32)
        return LevelledStations(
            coefficients=np.asarray(_levelled_coefficients(*filled, self._basis))[: len(stations)],
            place_m=places.pose[:, None, :2] + read.antenna_m[..., :2],
            yaw_rad=places.pose[:, 3],
            weight=np.where(read.valid, weight[:, None], np.float32(0.0)),
        )


def _filled(values: np.ndarray) -> np.ndarray:
    return np.pad(values, [(0, _BLOCK - len(values)), *[(0, 0)] * (values.ndim - 1)])


@jax.jit
def _levelled_coefficients(
    profile: Float[Array, "scan channel sample"],
    valid: Bool[Array, "scan channel"],
    above_m: Float[Array, "scan channel"],
    basis: CoefficientBasis,
) -> Float[Array, "scan channel coefficient"]:
    """Coefficients of profiles, shifted earlier for antennas ``above_m`` the common height: 6.67 ns a metre."""
    return shift_travel_time(
        to_coefficients(profile, valid, basis), -air_delay_ns(above_m), basis.angular_frequency_rad_per_ns
    )


_SAMPLED = 300
_HELD = 0.99
"""Share of the map's power in its leading components, which are all that the coarse stage uses."""


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
        # Common to what tiles share; each tile's own reference is near it.
        self.height_m = float(np.median(source.height_reference_m))
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

    @cached_property
    def levelling(self) -> Levelling:
        return Levelling(self.source, self.basis, self.height_m)

    def tile_near(self, point_m: Float[np.ndarray, "2"], within_m: float) -> int | None:
        """Number of the tile whose frame is nearest to a point, if the map comes within ``within_m`` of it."""
        return self._frames.nearest(point_m, within_m + self._spacing_m)

    def tile_holding(self, current: int | None, point_m: Float[np.ndarray, "2"], reach_m: float) -> int | None:
        """The tile in use as long as it serves, else the one whose frame is nearest, to change tiles rarely.

        It serves while everything within ``reach_m`` of the point is in its extent, or beyond an end of the map itself.
        Ground that comes back into reach beyond such an end is not the tile's: the nearest frame must be in its extent,
        too.

        Args:
            current: number of the tile in use; None for none.
            point_m: east and north.
            reach_m: radius around the point in which ground is needed.

        Returns:
            number of a tile; None where the map does not come within ``reach_m`` of the point.
        """
        nearest = self.tile_near(point_m, reach_m)
        if current is None or nearest is None:
            return nearest
        return current if self.serves(current, nearest, point_m, reach_m) else nearest

    def serves(self, current: int, nearest: int, point_m: Float[np.ndarray, "2"], reach_m: float) -> bool:
        """Whether a tile is as good as the nearest one, see ``tile_holding``."""
        if nearest == current:
            return True
        low_m, high_m = self._low_m[current], self._high_m[current]
        east, north, yaw = self.frame(current)
        turn = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
        point, frame = (np.stack([point_m, self.frame(nearest)[:2]]) - np.array([east, north])) @ turn
        # A side not cut by the requested extent is an end of the map itself. A grid may be larger than requested, but
        # only the requested extent is sure to hold all of the map's ground.
        serves = ((point - reach_m >= low_m) | (low_m > -self._half_m)) & (frame >= low_m)
        serves &= ((point + reach_m <= high_m) | (high_m < self._half_m)) & (frame <= high_m)
        return bool(np.all(serves))

    def ground_up_at(self, points_m: Float[np.ndarray, "point 2"]) -> Float[np.ndarray, " point"]:
        """Local height of the ground at the station nearest to each point; NaN far from the map."""
        station = self.source.places.nearest(points_m, 16.0)
        number, where = np.unique(station[station >= 0], return_inverse=True)
        up = np.full(len(points_m), np.nan)
        up[station >= 0] = self.source.places.read(number).ground_up_m[where]
        return up

    def baselines_across(self, tile: int) -> Float[np.ndarray, "drive 2"]:
        """Lowest and highest place across the tile's axis that each baseline's array covers near its frame.

        NaN for a baseline that does not pass.
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
        """Grid of a tile and the position of its first cell: the requested extent, no larger than the whole map."""
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
        # The ladder's grid may be larger than requested: centred on the frame where the map reaches that far.
        origin = np.where(size_m >= high - low, 0.5 * (low + high) - 0.5 * size_m, -0.5 * size_m)
        inside = np.clip(-0.5 * size_m, low, np.maximum(high - size_m, low))
        return spec, np.where(size_m >= high - low, origin, inside)

    def tile(self, number: int, direction: int = 0) -> Tile:
        """The tile, from the cache or gridded now.

        Args:
            number: number of the tile.
            direction: direction of the live scans, 1 along its axis and -1 against it (see ``filter_along``); 0 for the
                ground as stored in the map.
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
        half = 0.5 * np.array([spec.along_cell_m * spec.along_cells, spec.cross_cell_m * spec.cross_cells])
        middle = origin_m + half
        turn = np.array([[np.cos(yaw), np.sin(yaw)], [-np.sin(yaw), np.cos(yaw)]])
        centre = np.array([east, north]) + middle @ turn
        room = 0.5 * self.description.channels * self.description.channel_pitch_m + 4.0 * spec.cross_spread_m
        places = self.source.places
        near = places.near(centre, float(np.hypot(*half)) + room)
        apart = (places.read(near).pose[:, :2] - centre) @ turn.T
        return near[np.all(np.abs(apart) <= half + room, axis=1)]

    def _grid(self, number: int) -> Tile:
        spec, origin_m = self.grid_of(number)
        east, north, yaw = self.frame(number)
        stations = self.stations_under(number)
        levelled = self.levelling.read(stations)
        coefficients = levelled.coefficients.reshape(levelled.weight.size, -1)
        # Tiles' references differ by centimetres: one rotation for all traces of the tile.
        above_m = float(self.source.height_reference_m[number]) - self.height_m
        if above_m != 0.0:
            coefficients = coefficients @ self._raising(above_m)
        cos, sin = np.cos(yaw), np.sin(yaw)
        from_east, from_north = levelled.place_m[..., 0] - east, levelled.place_m[..., 1] - north
        turn = np.broadcast_to((levelled.yaw_rad - yaw)[:, None], levelled.weight.shape)
        position = (from_east * cos + from_north * sin, from_north * cos - from_east * sin)
        traces = TraceSet(
            coefficients=coefficients,
            position_m=np.stack(position).astype(np.float32).reshape(2, -1),
            direction=np.stack([np.cos(turn), np.sin(turn)]).astype(np.float32).reshape(2, -1),
            weight=levelled.weight.reshape(-1),
        )
        return grid_traces(traces, origin_m, spec=spec)

    def _raising(self, above_m: float) -> Float[np.ndarray, "coefficient coefficient"]:
        """Matrix that brings coefficients from the common antenna height to one ``above_m`` higher."""
        one = jnp.eye(self.basis.matrix.shape[1], dtype=jnp.float32)
        delay_ns = jnp.full(len(one), air_delay_ns(jnp.float32(above_m)))
        return np.asarray(shift_travel_time(one, delay_ns, self.basis.angular_frequency_rad_per_ns))

    def _extents(self) -> tuple[Float[np.ndarray, "tile 2"], Float[np.ndarray, "tile 2"]]:
        """Extent of the ground around every tile in its frame, with room for the array to both sides.

        A map is a narrow band along its routes: a tile as wide as it is long would be empty for the most part.
        """
        low, high = track_extents(self.source.tile_frame, self.source.places, self._half_m)
        room = self.description.channel_pitch_m * (0.5 * self.description.channels + 1.0)
        return np.maximum(low - room, -self._half_m), np.minimum(high + room, self._half_m)
