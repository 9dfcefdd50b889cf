"""The filter beside the search by windows: ``python -m validation.worlds.heart`` (``PYTHONPATH=.:tests``).

The same drives of the same worlds by both, in one run: shares, errors, consistency, first fix and time a day; then
every drive over other worlds' maps, begun anew every four metres, where the least ``p_false`` of a piece should be
below x no more often than with the probability x. Worlds stay in the folder ``--keep``; figures are added to
``--record`` line by line. ``heart.jsonl`` holds days of 8 worlds and whole drives of 23 pairs.
"""

import argparse
import json
import pickle
import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.stats import beta

from lgprjax.batch.register import HeldGround, register_log
from lgprjax.errors import InputError
from lgprjax.formats import DriveLog, MapFile
from lgprjax.mapping import build_map
from lgprjax.recordings.drives import track_of_drive
from lgprjax.registration import RegisterOptions, Track
from validation.worlds.course import centreline_of
from validation.worlds.drives import Drive, ground_of, write_live, write_passes
from validation.worlds.figures import PIECE_M, DayFigures, figures_of, judge
from validation.worlds.parameters import World, read_worlds
from validation.worlds.small import SMALL_WORLDS

METHODS = ("search", "causal", "smoothed")
DAYS = ("clear", "snow", "rain", "gps_jump", "gps_jump_chords", "impostor")
FAR_APART = (0, 2, 4, 8, 16, 18, 22, 26)
LEVELS = (1e-2, 1e-3, 1e-4)


class MadeWorld(NamedTuple):
    """A world's files: its map's drives, and the days'."""

    world: World
    folder: Path
    passes: list[Drive]
    lives: dict[str, Drive]


def options_of(method: str) -> RegisterOptions:
    """Of a method by name."""
    assert method in METHODS
    return RegisterOptions(filter=None if method == "search" else method)  # type: ignore[arg-type]


def made(world: World, keep: Path) -> MadeWorld:
    """Drives and map of a world, from the folder or rendered now."""
    folder = keep / f"w{world.number:02d}"
    index = folder / "drives.pkl"
    if not index.exists():
        folder.mkdir(parents=True, exist_ok=True)
        line = centreline_of(world)
        ground = ground_of(world, line, "clear")
        passes = write_passes(world, ground, folder)
        lives = {day: write_live(world, ground, day, folder) for day in DAYS if day != "impostor"}
        lives["impostor"] = write_live(world, ground_of(world, line, "impostor"), "impostor", folder)
        build_map([drive.path for drive in passes], folder / "ground.map.h5", force=True)
        index.write_bytes(pickle.dumps((world, passes, lives)))
    return MadeWorld(world, folder, *pickle.loads(index.read_bytes())[1:])


def compared(
    one: MadeWorld, methods: Sequence[str], days: Sequence[str]
) -> Iterator[tuple[DayFigures, dict[str, object]]]:
    """Figures of days by each method; with the metres to the first fix, the least p_false and CPU time a scan.

    The first day's time includes compiling.
    """
    for method in methods:
        options = options_of(method)
        with MapFile.open(one.folder / "ground.map.h5") as source:
            held = HeldGround(source, options)
            for day in days:
                with DriveLog.open(one.lives[day].path) as log:
                    began = time.process_time()
                    found = register_log(source, log, options, held=held)
                    cpu_ms = 1e3 * (time.process_time() - began) / log.scans
                row = figures_of(one.world, day, found, one.passes, one.lives[day])
                judged = judge(one.world, found, one.passes, one.lives[day])
                p_false = np.nan_to_num(found.table["p_false"].to_numpy(), nan=1.0)
                travel_m = np.abs(found.track.travel_m - found.track.travel_m[0])
                first_m = float(travel_m[judged.ok][0]) if judged.ok.any() else float("nan")
                more = {"method": method, "first_m": first_m, "p_false": float(p_false.min()), "cpu_ms": cpu_ms}
                yield row, more


def foreign(drive: MadeWorld, over: MadeWorld, held: HeldGround, source: MapFile, method: str) -> list[float] | None:
    """Least p_false of each piece of a clear drive led along another world's route; None where the map refuses it."""
    with DriveLog.open(over.lives["clear"].path) as log:
        way = track_of_drive(log, source.description.frame).track
    way_m = np.cumsum(np.abs(np.diff(way.travel_m, prepend=way.travel_m[:1])))

    def led_to(track: Track) -> Track:
        path_m = np.cumsum(np.abs(np.diff(track.travel_m, prepend=track.travel_m[:1])))
        pose = np.stack([np.interp(np.mod(path_m, way_m[-1]), way_m, column) for column in way.pose.T], axis=1)
        pose[:, 2] = track.pose[:, 2]
        # Each piece, and each round, is a leg of its own: a fresh prior.
        leg = np.floor(path_m / PIECE_M).astype(int) + 10_000 * np.floor(path_m / way_m[-1]).astype(int)
        return track._replace(pose=pose, leg=leg)

    with DriveLog.open(drive.lives["clear"].path) as log:
        try:
            found = register_log(source, log, options_of(method), led_to=led_to, held=held)
        except InputError:
            return None
    p_false = np.nan_to_num(found.table["p_false"].to_numpy(), nan=1.0)
    return [float(p_false[found.track.leg == leg].min()) for leg in np.unique(found.track.leg)]


def bound(count: int, pieces: int) -> float:
    """Upper end of the 95 % interval of a share (Clopper and Pearson, 1934)."""
    return float(beta.ppf(0.95, count + 1, max(pieces - count, 1)))


def line_of(row: DayFigures, more: dict[str, object]) -> str:
    """One line of the table of days."""
    return (
        f"{row.world:3d} {row.day:15s} {more['method']!s:8s} {row.scans:5d} ok {100 * row.ok_share:5.1f} "
        f"wrong {row.wrong:3d}  along {100 * row.rms_along_m:5.2f} cross {100 * row.rms_cross_m:5.2f} cm  "
        f"NEES {row.nees:5.2f} of {row.nees_pieces:2d}  first {more['first_m']:5.2f} m  "
        f"least p_false {more['p_false']:.1e}  {more['cpu_ms']:6.2f} ms  {row.declined}"
    )


def foreign_pairs(worlds: Sequence[MadeWorld], method: str) -> Iterator[tuple[int, int, list[float]]]:
    """Drive, map and least p_false of its pieces, for all pairs of different worlds that share a band."""
    for over in worlds:
        with MapFile.open(over.folder / "ground.map.h5") as source:
            held = HeldGround(source, options_of(method))
            for drive in worlds:
                least = None if drive is over else foreign(drive, over, held, source, method)
                if least is not None:
                    yield drive.world.number, over.world.number, least


def main() -> None:
    """The program."""
    parser = argparse.ArgumentParser(prog="validation.worlds.heart")
    parser.add_argument("worlds", type=int, nargs="*", default=FAR_APART)
    parser.add_argument("--methods", nargs="+", default=METHODS, choices=METHODS)
    parser.add_argument("--days", nargs="*", default=DAYS, choices=DAYS)
    parser.add_argument("--foreign", action="store_true", help="the drives over each other's maps as well")
    parser.add_argument("--keep", type=Path, help="folder that the worlds stay in")
    parser.add_argument("--record", type=Path, help="file that figures are added to, a line of JSON each")
    chosen = parser.parse_args()
    known = {world.number: world for world in (*read_worlds(), *SMALL_WORLDS)}

    def kept(row: dict[str, object]) -> None:
        if chosen.record is not None:
            with chosen.record.open("a", encoding="utf-8") as file:
                file.write(json.dumps(row) + "\n")

    with tempfile.TemporaryDirectory() as scratch:
        worlds = [made(known[number], chosen.keep or Path(scratch)) for number in chosen.worlds]
        for one in worlds if chosen.days else ():
            for row, more in compared(one, chosen.methods, chosen.days):
                print(line_of(row, more), flush=True)
                kept({**asdict(row), **more})
        for method in chosen.methods if chosen.foreign else ():
            whole: list[float] = []
            for drive, over, least in foreign_pairs(worlds, method):
                whole += least
                kept({"method": method, "drive": drive, "map": over, "least": least})
                print(f"{drive:3d} over {over:3d} {method}: {min(least):.1e} of {len(least)}", flush=True)
            for level in LEVELS:
                count = sum(each < level for each in whole)
                most = bound(count, len(whole))
                print(f"{method}: below {level:g} {count} of {len(whole)}, at most {most:.1e}", flush=True)


if __name__ == "__main__":
    main()
