"""An array beside a single baseline: ``python -m validation.worlds.beside`` (``PYTHONPATH=.:tests``).

The village's array, 1.4 m wide, on other grounds of 36 m: the map is one drive along the lane's middle, each live drive
keeps so far to its left. Scans of the whole drive. A minute a ground.
"""

import argparse
import tempfile
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from lgprjax.batch import register_log
from lgprjax.formats import DriveLog, MapFile
from lgprjax.mapping import build_map
from lgprjax.registration import RegisterOptions
from lgprjax.simulation import read_site, site_file, write_drives
from lgprjax.simulation.site_tables import plan_drive, prepare_site

OFFSETS_M = (0.4, 0.6, 0.7, 0.8, 1.0)
GROUNDS = (2, 3, 4)
LENGTH_M = 36.0
WRONG_M = 0.3
HEAD = "| ground | metres beside | `ok` | wrong | across, RMS and largest | along, RMS | declined |"


class Beside(NamedTuple):
    """A drive beside the baseline: share of its scans, and errors of fixes in metres."""

    ground: int
    offset_m: float
    ok: float
    wrong: int
    across_m: float
    most_across_m: float
    along_m: float
    declined: dict[str, int]


def drives_beside(
    ground: int, offsets_m: Sequence[float], folder: Path, length_m: float = LENGTH_M
) -> tuple[Path, dict[float, Path]]:
    """A map of one drive along the middle, and drives at distances to its left; of the village's kind."""
    site = read_site(site_file("village"))
    baseline, live = site.drives[0], site.drives[2]

    wanted = [("baseline", 0.0), *((f"live{100 * each:.0f}", each) for each in offsets_m)]
    drives = tuple(
        replace(
            kind := baseline if number == 0 else live,
            name=name,
            seed=10 * ground + number,
            plan=replace(kind.plan, lane_m=lane_m, stop_m=length_m - (5.0 if number == 0 else 10.0)),
            day=replace(kind.day, seed=kind.day.seed + 10 * ground),
        )
        for number, (name, lane_m) in enumerate(wanted)
    )
    site = replace(
        site,
        header=replace(site.header, seed=ground),
        ground=replace(site.ground, length_m=length_m),
        road=replace(site.road, length_m=length_m),
        drives=drives,
    )
    scene = prepare_site(site)
    logs = write_drives({drive.name: plan_drive(scene, drive) for drive in site.drives}, folder)
    build_map([logs["baseline"]], folder / "single.map.h5")
    return folder / "single.map.h5", {each: logs[f"live{100 * each:.0f}"] for each in offsets_m}


def beside(ground: int, offsets_m: Sequence[float], folder: Path, length_m: float = LENGTH_M) -> Iterator[Beside]:
    """Every drive beside the baseline, registered by default."""
    database, logs = drives_beside(ground, offsets_m, folder, length_m)
    for offset_m, path in logs.items():
        with MapFile.open(database) as source, DriveLog.open(path) as log:
            found = register_log(source, log, RegisterOptions())
        assert found.truth is not None
        code = found.table["code"].to_numpy()
        ok, yaw = code == "ok", found.truth[:, 3]
        off_m = np.asarray(found.fix.pose, np.float64)[:, :2] - found.truth[:, :2]
        along_m = (np.cos(yaw) * off_m[:, 0] + np.sin(yaw) * off_m[:, 1])[ok]
        across_m = (np.cos(yaw) * off_m[:, 1] - np.sin(yaw) * off_m[:, 0])[ok]
        yield Beside(
            ground,
            offset_m,
            float(ok.mean()),
            int(np.sum(np.hypot(along_m, across_m) > WRONG_M)),
            float(np.sqrt(np.mean(across_m**2))) if ok.any() else 0.0,
            float(np.max(np.abs(across_m), initial=0.0)),
            float(np.sqrt(np.mean(along_m**2))) if ok.any() else 0.0,
            dict(Counter(code[~ok].tolist())),
        )


def main() -> None:
    """The program."""
    parser = argparse.ArgumentParser(prog="validation.worlds.beside")
    parser.add_argument("grounds", type=int, nargs="*", default=GROUNDS, help="seeds")
    chosen = parser.parse_args()
    print(HEAD)
    print("| --- " * HEAD.count(" | ") + "| --- |", flush=True)
    for ground in chosen.grounds:
        with tempfile.TemporaryDirectory() as folder:
            for row in beside(ground, OFFSETS_M, Path(folder)):
                declined = ", ".join(f"{code} {count}" for code, count in sorted(row.declined.items()))
                print(
                    f"| {row.ground} | {row.offset_m:g} | {row.ok:.1%} | {row.wrong} | {100.0 * row.across_m:.1f}, "
                    f"{100.0 * row.most_across_m:.1f} cm | {100.0 * row.along_m:.1f} cm | {declined} |",
                    flush=True,
                )


if __name__ == "__main__":
    main()
