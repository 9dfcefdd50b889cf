"""A map of any length on disk: a kilometre of generated road is coded once, and copied to where it stands again.

A program (``python -m benchmarks.stored_road OUT.map.h5 --kilometres N``).
"""

import argparse
import tempfile
from pathlib import Path

import numpy as np

from benchmarks.long_map import RepeatedRoad
from lgprjax.formats import MAP_PRECISIONS, MapFile, MapPrecision, MapWriter, copy_stations
from lgprjax.subsurface import StationBlock

_KILOMETRE_M = 1000.0
_STATIONS = 1024


def write_road(path: Path, road: RepeatedRoad, times: int, precision: MapPrecision) -> None:
    """Write a road of one lane, one after the other so many times: what ``RepeatedRoad`` of that length holds.

    Args:
        path: of the map.
        road: as long as its ground repeats.
        times: it is laid.
        precision: of the map.
    """
    stations, step_m = len(road.pose), road.description.settings.step_m
    with tempfile.TemporaryDirectory(dir=path.parent) as folder:
        once = Path(folder) / "once.map.h5"
        with MapWriter.create(once, precision=precision) as writer:
            for start in range(0, stations, _STATIONS):
                chosen = np.arange(start, min(start + _STATIONS, stations))
                read, still = road.read_stations(chosen), np.zeros(len(chosen))
                pose = road.pose[chosen]
                writer.append(StationBlock(read.profile, read.valid, pose, still, read.antenna_m, still), 0)
            writer.finish(road.description, road.tile_frame, road.height_reference_m, {})
        frames = []
        with MapFile.open(once) as source, MapWriter.create(path) as writer:
            for turn in range(times):
                shift_m = np.array([turn * stations * step_m, 0.0, 0.0, 0.0, 0.0])
                copy_stations(source, writer, road.pose + shift_m)
                frames.append(road.tile_frame + shift_m[:3])
            references_m = np.tile(road.height_reference_m, times)
            writer.finish(source.description, np.concatenate(frames), references_m, {})


def main() -> None:
    """The program."""
    parser = argparse.ArgumentParser(prog="benchmarks.stored_road")
    parser.add_argument("out", type=Path)
    parser.add_argument("--kilometres", type=int, required=True)
    parser.add_argument("--precision", choices=MAP_PRECISIONS, default="standard")
    chosen = parser.parse_args()
    write_road(chosen.out, RepeatedRoad(_KILOMETRE_M), chosen.kilometres, MAP_PRECISIONS[chosen.precision])


if __name__ == "__main__":
    main()
