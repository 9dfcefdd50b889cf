"""Stations of a map as coefficients at one antenna height, made once for all tiles that share them."""

from collections import OrderedDict
from typing import NamedTuple

import jax
import numpy as np
from jaxtyping import Array, Bool, Float, Float32, Int

from lgprjax.radar import CoefficientBasis, air_delay_ns, shift_travel_time, to_coefficients
from lgprjax.subsurface.station_source import StationSource

_BLOCK = 256
"""Stations that are read and levelled together; traces on disk come in as many."""
_HELD_BYTES = 64e6


class LevelledStations(NamedTuple):
    """Stations, one row each.

    Attributes:
        coefficients: of every trace, at the common antenna height; zeros where it is not valid.
        place_m: east and north of every antenna.
        yaw_rad: of the array.
        weight: of every trace in gridding; 0 where it is not valid.
    """

    coefficients: Float32[np.ndarray, "scan channel coefficient"]
    place_m: Float[np.ndarray, "scan channel 2"]
    yaw_rad: Float[np.ndarray, " scan"]
    weight: Float32[np.ndarray, "scan channel"]


class Levelling:
    """Reads and levels stations block by block, and holds those asked for last.

    Neighbouring tiles share most of their stations. What is held is bounded, but for what one call needs.

    Args:
        source: the database.
        basis: coefficients of its profiles.
        height_m: antenna height that all traces are brought to.
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
    """Coefficients of profiles, those of antennas ``above_m`` the common height that much earlier: 6.67 ns a metre."""
    return shift_travel_time(
        to_coefficients(profile, valid, basis), -air_delay_ns(above_m), basis.angular_frequency_rad_per_ns
    )
