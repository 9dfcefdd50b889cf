"""Stations as a map stores them: what is copied from map to map without a change, and what profiles become."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Float16, Int

from lgprjax.formats.map_code import CodedTraces
from lgprjax.formats.map_rows import PLACE_UNITS, antenna_codes
from lgprjax.subsurface import Places, StationBlock

BLOCK = 256
"""Stations of a block of codes: one chunk, read and checked as a whole."""


class StoredStations(NamedTuple):
    """Consecutive stations in the numbers of the file.

    Attributes:
        place: in ``PLACE_UNITS``.
        antenna: see ``antenna_codes``.
        valid: channels that hold data, whether or not the station is retired.
        traces: as samples, or as codes.
    """

    place: Int[np.ndarray, "scan 8"]
    antenna: Int[np.ndarray, "scan channel 3"]
    valid: Bool[np.ndarray, "scan channel"]
    traces: Float16[np.ndarray, "scan channel sample"] | CodedTraces


def stored_block(block: StationBlock, drive: int) -> StoredStations:
    """Stations of a baseline with their traces as samples."""
    place = place_rows(block.pose, block.ground_up_m, np.full(len(block.pose), drive), block.time_s)
    pose = places_of_rows(place).pose
    profile = np.where(block.valid[..., None], block.profile, 0.0).astype(np.float16)
    return StoredStations(place, antenna_codes(block.antenna_m, pose), block.valid, profile)


def place_rows(
    pose: Float[np.ndarray, "scan 5"],
    ground_up_m: Float[np.ndarray, " scan"],
    drive: Int[np.ndarray, " scan"],
    time_s: Float[np.ndarray, " scan"],
) -> Int[np.ndarray, "scan 8"]:
    """Where and when stations stand, in whole units."""
    whole = np.concatenate([pose, np.stack([ground_up_m, drive, time_s], axis=1)], axis=1)
    return np.asarray(np.rint(whole / PLACE_UNITS).astype(np.int64))


def places_of_rows(rows: Int[np.ndarray, "scan 8"]) -> Places:
    """Where stations stand."""
    values = rows * PLACE_UNITS
    return Places(values[:, :5], values[:, 5], rows[:, 6])


def moved(rows: Int[np.ndarray, "scan 8"], pose: Float[np.ndarray, "scan 5"]) -> Int[np.ndarray, "scan 8"]:
    """The rows with other poses."""
    return np.concatenate([np.rint(pose / PLACE_UNITS[:5]).astype(np.int64), rows[:, 5:]], axis=1)
