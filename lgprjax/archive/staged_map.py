"""A map with one more baseline, nothing of it out of force: what an update compares before it decides."""

from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from lgprjax.archive.depth_levels import live_operators
from lgprjax.archive.located_drive import LocatedDrive
from lgprjax.archive.map_building import baseline_stations
from lgprjax.archive.tracks import scan_spacing_m
from lgprjax.formats import DriveLog, MapFile, MapWriter, copy_stations
from lgprjax.subsurface import TilePlacer


class StagedMap(NamedTuple):
    """A scratch map.

    Attributes:
        path: of the file.
        tile_frame, height_reference_m: the map's own, and what the new baseline needs beside them.
        time_s: of the new baseline's stations, in its drive.
    """

    path: Path
    tile_frame: Float[np.ndarray, "tile 3"]
    height_reference_m: Float[np.ndarray, " tile"]
    time_s: Float[np.ndarray, " scan"]


def stage_map(
    source: MapFile, log: DriveLog, located: LocatedDrive, path: Path, progress: Callable[[int], None]
) -> StagedMap:
    """Write a map with a drive as its last baseline.

    Tiles keep their places; the drive adds some where no tile serves it.

    Args:
        source: the map.
        log, located: the drive.
        path: of the scratch map.
        progress: told as scans are done.

    Raises:
        InputError: nothing was received along the drive, the map is damaged, or the output cannot be written.
    """
    description, track = source.description, located.track.track
    tiles = TilePlacer(description.tile_spacing_m)
    references: list[float] = []
    for frame, height_m in zip(source.tile_frame, source.height_reference_m, strict=True):
        pose = np.array([[frame[0], frame[1], height_m, frame[2], 0.0]])
        references += [float(height_m)] * tiles.place(pose)
    operator = live_operators(source, log, track, located.alignment)(1.0)
    blocks = baseline_stations(log, located.track, operator, description.settings, scan_spacing_m(track), progress)
    times = []
    with MapWriter.create(path) as writer:
        copy_stations(source, writer)
        for block in blocks:
            references += [float(np.median(block.pose[:, 2]))] * tiles.place(block.pose)
            writer.append(block, len(description.label_sigma_m))
            times.append(block.time_s)
        writer.finish(description._replace(weight=()), tiles.frames, np.asarray(references), source.provenance)
    return StagedMap(path, tiles.frames, np.asarray(references), np.concatenate(times))
