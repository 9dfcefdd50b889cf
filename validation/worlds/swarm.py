"""The unseeded swarm beside the exhaustive search: ``python -m validation.worlds.swarm`` (``PYTHONPATH=.:tests``).

The first metres of every world's clear day, registered by default and by ``search_swarm``, one process a world. Scans
after the first 4 m over the map; agreement also after the first 8 m, over which attitudes are learnt, which decide
whether a single scan may make a fix. A minute of a core a world.
"""

import argparse
import multiprocessing
import tempfile
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple
from unittest.mock import patch

import jax
import numpy as np

from lgprjax.batch import RegisteredDrive, register_log
from lgprjax.formats import DriveLog, MapFile
from lgprjax.mapping import build_map
from lgprjax.registration import SEARCH_SWARM, RegisterOptions, swarm_search
from lgprjax.registration.lattice import ErrorLattice, Surfaces
from validation.worlds.course import centreline_of
from validation.worlds.drives import ground_of, write_live, write_passes
from validation.worlds.figures import judge, wrong_fixes
from validation.worlds.parameters import World, read_worlds

ROUTE_M = 16.0
SETTLED_M = 8.0
NEAR_M = 0.02
HEAD = (
    "| world | channels | scans | `ok`: default, swarm | wrong | both: within 2 cm | after 8 m | within a sigma "
    "| the same window | of these within 2 cm | poses scored a scan: default, swarm | ms a scan |"
)


class Compared(NamedTuple):
    """One world by both searches; the default's figure first where there are two.

    Attributes:
        scans: that count.
        ok, wrong: of them.
        both: scans that are ok by both; ``near`` of them within 2 cm, ``within`` within one sigma of the default's.
        late, late_near: the same after the first 8 m.
        same: of ``both``, matched with windows of one length; ``same_near`` of them within 2 cm.
        poses: scored, a scan of the drive.
        milliseconds: a scan of the drive, without compiling.
    """

    world: int
    channels: int
    scans: int
    ok: tuple[int, int]
    wrong: tuple[int, int]
    both: int
    near: int
    late: int
    late_near: int
    within: int
    same: int
    same_near: int
    poses: tuple[float, float]
    milliseconds: tuple[float, float]


class _Work:
    """Poses scored, and seconds spent on compiling."""

    def __init__(self) -> None:
        self.poses, self.compiling_s = 0, 0.0
        jax.monitoring.register_event_duration_secs_listener(self._listen)

    def _listen(self, event: str, duration_secs: float, **_: str | int) -> None:
        if event.startswith("/jax/core/compile/"):
            self.compiling_s += duration_secs

    @contextmanager
    def counted(self) -> Iterator[None]:
        """Counts poses of both searches."""
        surfaces_of, search_region = ErrorLattice.surfaces_of, swarm_search.search_region

        def lattice(*given: Any, **named: Any) -> Surfaces:
            made = surfaces_of(*given, **named)
            self.poses += made.lattice[:, 2:].size
            return made

        def swarm(*given: Any, **named: Any) -> swarm_search.SwarmPeak:
            config = named["config"]
            self.poses += config.particles * ((config.iterations + 1) * (2 if named["rival"] else 1) + 1)
            found: swarm_search.SwarmPeak = search_region(*given, **named)
            return found

        with patch.object(ErrorLattice, "surfaces_of", lattice), patch.object(swarm_search, "search_region", swarm):
            yield


def compare(world: World) -> Compared:
    """Both searches on the clear day of a world."""
    work = _Work()
    drives: list[RegisteredDrive] = []
    poses, milliseconds = [], []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        ground = ground_of(world, centreline_of(world), "clear")
        passes, live = write_passes(world, ground, folder), write_live(world, ground, "clear", folder)
        del ground
        build_map([drive.path for drive in passes], folder / "ground.map.h5")
        for options in (RegisterOptions(), RegisterOptions(search_swarm=SEARCH_SWARM)):
            work.poses, work.compiling_s = 0, 0.0
            begun_s = time.perf_counter()
            with work.counted(), MapFile.open(folder / "ground.map.h5") as source, DriveLog.open(live.path) as log:
                drives.append(register_log(source, log, options))
            seconds, scans = time.perf_counter() - begun_s - work.compiling_s, len(drives[-1].table)
            poses.append(work.poses / scans)
            milliseconds.append(1e3 * seconds / scans)
    judged = [judge(world, drive, passes, live) for drive in drives]
    counts = judged[0].counts
    ok = [each.ok & counts for each in judged]
    both = ok[0] & ok[1]
    apart_m = (np.asarray(drives[1].fix.pose) - np.asarray(drives[0].fix.pose))[both, :2]
    off_m = np.hypot(*apart_m.T)
    covariance = np.asarray(drives[0].fix.covariance, np.float64)[both, :2, :2]
    squared = np.einsum("si,si->s", apart_m, np.linalg.solve(covariance, apart_m[..., None])[..., 0])
    travel_m = drives[0].track.travel_m
    late = np.abs(travel_m - travel_m[0])[both] >= SETTLED_M
    same = np.isclose(*(np.asarray(drive.fix.window_m)[both] for drive in drives))
    return Compared(
        world.number,
        world.channels,
        int(counts.sum()),
        (int(ok[0].sum()), int(ok[1].sum())),
        (int((wrong_fixes(judged[0]) & counts).sum()), int((wrong_fixes(judged[1]) & counts).sum())),
        int(both.sum()),
        int(np.sum(off_m < NEAR_M)),
        int(late.sum()),
        int(np.sum(off_m[late] < NEAR_M)),
        int(np.sum(squared < 1.0)),
        int(same.sum()),
        int(np.sum(off_m[same] < NEAR_M)),
        (poses[0], poses[1]),
        (milliseconds[0], milliseconds[1]),
    )


def row_of(found: Compared) -> str:
    """A line of the table."""

    def share(part: int, whole: int) -> str:
        return f"{part / whole:.1%}" if whole else ""

    return (
        f"| {found.world} | {found.channels} | {found.scans} | {share(found.ok[0], found.scans)}, "
        f"{share(found.ok[1], found.scans)} | {found.wrong[0]}, {found.wrong[1]} | {share(found.near, found.both)} | "
        f"{share(found.late_near, found.late)} | {share(found.within, found.both)} | {share(found.same, found.both)} | "
        f"{share(found.same_near, found.same)} | {found.poses[0]:,.0f}, {found.poses[1]:,.0f} | "
        f"{found.milliseconds[0]:.1f}, {found.milliseconds[1]:.1f} |"
    )


def together(rows: Sequence[Compared]) -> Compared:
    """All worlds, scan by scan; of the work the mean over worlds."""

    def total(field: str) -> Any:
        values = np.array([getattr(row, field) for row in rows])
        summed = values.sum(axis=0)
        return tuple(int(each) for each in summed) if values.ndim > 1 else int(summed)

    def mean(field: str) -> tuple[float, float]:
        first, second = np.mean([getattr(row, field) for row in rows], axis=0)
        return float(first), float(second)

    counted = ("scans", "ok", "wrong", "both", "near", "late", "late_near", "within", "same", "same_near")
    return Compared(
        -1, 0, **{field: total(field) for field in counted}, poses=mean("poses"), milliseconds=mean("milliseconds")
    )


def main() -> None:
    """The program."""
    parser = argparse.ArgumentParser(prog="validation.worlds.swarm")
    parser.add_argument("worlds", type=int, nargs="*", help="by number; without any all 30 that are mapped finely")
    parser.add_argument("--metres", type=float, default=ROUTE_M, help="of each world's route (default: %(default)g)")
    chosen = parser.parse_args()
    worlds = [
        replace(each, route_m=min(each.route_m, chosen.metres))
        for each in read_worlds()
        if (each.number in chosen.worlds if chosen.worlds else not each.beyond)
    ]
    print(HEAD)
    print("| --- " * HEAD.count(" | ") + "| --- |", flush=True)
    rows: list[Compared] = []
    # Compiled programs of one world are no use to the next, and would fill the memory.
    with ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("spawn"), max_tasks_per_child=1) as pool:
        for row in pool.map(compare, worlds):
            rows.append(row)
            print(row_of(row), flush=True)
    print(row_of(together(rows)).replace("| -1 | 0 |", "| all | |"))


if __name__ == "__main__":
    main()
