"""Stations copied from map to map as they are stored: no trace is rounded a second time."""

import numpy as np
from jaxtyping import Float

from lgprjax.errors import InputError
from lgprjax.formats.map_file import MapFile
from lgprjax.formats.map_rows import UNIT
from lgprjax.formats.map_stored import moved
from lgprjax.formats.map_writer import MapWriter


def copy_stations(source: MapFile, writer: MapWriter, pose: Float[np.ndarray, "scan 5"] | None = None) -> None:
    """Append all stations of a map to one that is being written, without loss.

    The writer takes on the source's precision: as its first stations, or after stations that are stored alike. What is
    appended later is stored in the same way. Of a map of version 1.0 poses are rounded to 0.1 mm and 10 microradians,
    antennas to 0.5 mm, times to 0.1 ms. Weights and retired stations are ``finish``'s to tell.

    Args:
        source: the map.
        writer: of the other.
        pose: of every station, in place of the source's; antennas turn and tilt with it.

    Raises:
        InputError: a part of the source is damaged, or the writer's stations are stored otherwise.
    """
    if writer.stations == 0:
        writer.use(source.precision, source.code)
    elif not _alike(source, writer):
        raise InputError(source.path, "/code/basis", "traces stored as those before them", "another precision or basis")
    for start in range(0, len(source.places), UNIT):
        stations = np.arange(start, min(start + UNIT, len(source.places)))
        stored = source.read_stored(stations)
        if pose is not None:
            stored = stored._replace(place=moved(stored.place, pose[stations]))
        writer.append_stored(stored)


def _alike(source: MapFile, writer: MapWriter) -> bool:
    if source.code is None or writer.code is None:
        return source.code is None and writer.code is None and writer.precision.step_rms is None
    return np.array_equal(source.code.basis, writer.code.basis) and np.array_equal(source.code.gain, writer.code.gain)
