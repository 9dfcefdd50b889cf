"""Logs that are sure of themselves, and wrong: ``python -m validation.worlds.wrong_logs 6 11 16``.

Attitudes with so much added at a told 0.3 degrees of heading, in windows of 4 m and by default, and odometers that
miscount by 3 %; on the clear day of worlds, scans after the first 4 m. A few minutes a world. ``--filter causal`` or
``smoothed``: by the Bayes filter, which has no windows.
"""

import argparse
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Literal, NamedTuple, get_args

import numpy as np

from benchmarks.page import condition_table
from benchmarks.records import Record, kept_text
from lgprjax.batch import RegisteredDrive, register_log
from lgprjax.formats import DriveLog, MapFile
from lgprjax.mapping import build_map
from lgprjax.registration import RegisterOptions, Track
from validation.worlds.course import centreline_of
from validation.worlds.drives import ground_of, write_live, write_passes
from validation.worlds.figures import PIECE_M, START_M, WRONG_M
from validation.worlds.parameters import World, read_worlds

ATTITUDES = ((0.0, 0.0, 0.0), (0.2, -6.0, 4.0), (-0.2, 6.0, -4.0), (0.0, 12.0, 0.0))
"""Height in metres, heading and roll in degrees."""
SCALES = (1.0, 0.97, 1.03)
Method = Literal["causal", "smoothed"]


class Wrong(NamedTuple):
    """What a registered drive shows: shares, RMS in m and degrees, and fixes that are wrong.

    Attributes:
        outside: of the ok fixes those with heading, roll or height outside four sigma.
        nees: of height, heading and roll, a degree of freedom, one fix a piece.
    """

    ok: float
    height_m: float
    heading_deg: float
    roll_deg: float
    along_m: float
    outside: float
    nees: float
    wrong: int


def turned(height_m: float, heading_deg: float, roll_deg: float) -> Callable[[Track], Track]:
    """A log with so much added."""

    def led_to(track: Track) -> Track:
        pose = track.pose.copy()
        pose[:, 2:] += np.array([height_m, np.radians(heading_deg), np.radians(roll_deg)])
        return track._replace(pose=pose, sigma_yaw_rad=np.full(len(pose), np.radians(0.3)))

    return led_to


def miscounting(scale: float) -> Callable[[Track], Track]:
    """A log whose odometer tells so many metres for one."""
    return lambda track: track._replace(travel_m=scale * track.travel_m, speed_mps=scale * track.speed_mps)


def judged(drive: RegisteredDrive) -> Wrong:
    """Against the truth; the labels' own error is in it."""
    assert drive.truth is not None
    ok = drive.table["code"].to_numpy() == "ok"
    covariance = np.asarray(drive.fix.covariance, np.float64)
    error = np.asarray(drive.fix.pose, np.float64) - drive.truth
    error[:, 3] = np.mod(error[:, 3] + np.pi, 2.0 * np.pi) - np.pi
    sigma = np.sqrt(np.einsum("sii->si", covariance))
    travel_m = np.abs(drive.track.travel_m - drive.track.travel_m[0])
    late = travel_m > START_M
    use = np.flatnonzero(ok & late)
    _, first, count = np.unique(np.floor(travel_m[use] / PIECE_M), return_index=True, return_counts=True)
    square = [error[i, 2:] @ np.linalg.solve(covariance[i, 2:, 2:], error[i, 2:]) for i in use[first + count // 2]]
    yaw = drive.truth[use, 3]
    along_m = np.cos(yaw) * error[use, 0] + np.sin(yaw) * error[use, 1]
    height_m, heading, roll = np.sqrt(np.mean(error[use, 2:] ** 2, axis=0))
    return Wrong(
        float(ok[late].mean()),
        float(height_m),
        float(np.degrees(heading)),
        float(np.degrees(roll)),
        float(np.sqrt(np.mean(along_m**2))),
        float(np.mean(np.any(np.abs(error[use, 2:]) > 4.0 * sigma[use, 2:], axis=1))),
        float(np.mean(square)) / 3.0,
        int(np.sum(np.hypot(error[ok, 0], error[ok, 1]) > WRONG_M)),
    )


def rows_of(world: World, folder: Path, method: Method | None) -> Iterator[tuple[str, Wrong]]:
    """A row a log."""
    ground = ground_of(world, centreline_of(world), "clear")
    passes, live = write_passes(world, ground, folder), write_live(world, ground, "clear", folder)
    del ground
    build_map([drive.path for drive in passes], folder / "ground.map.h5")
    lengths = (4.0, None) if method is None else (None,)
    logs = [("{} m, {}°, {}°".format(*each), turned(*each), window) for window in lengths for each in ATTITUDES]
    logs += [(f"odometer × {scale}", miscounting(scale), None) for scale in SCALES]
    for name, led_to, window_m in logs:
        with MapFile.open(folder / "ground.map.h5") as source, DriveLog.open(live.path) as log:
            options = RegisterOptions(window_m=window_m, filter=method)
            found = judged(register_log(source, log, options, led_to=led_to))
        window = method or "by default" if window_m is None else f"windows of {window_m:g} m"
        yield f"{world.number}, {window}, {name}", found


def records_of(row: str, found: Wrong) -> list[Record]:
    """Of a row, with what is asked of windows of 4 m and wrong attitudes."""
    asked = "windows" in row
    return [
        Record(f"{row}: `ok`", 100.0 * found.ok, "%", "higher", 90.0 if asked else None),
        Record(f"{row}: wrong by over 0.3 m", found.wrong, "", "lower", 0.0),
        Record(f"{row}: heading, RMS", found.heading_deg, "°", "lower", 0.7 if asked else None),
        Record(f"{row}: roll, RMS", found.roll_deg, "°", "lower", 1.0 if asked else None),
        Record(f"{row}: height, RMS", 100.0 * found.height_m, "cm", "lower"),
        Record(f"{row}: outside 4 sigma", 100.0 * found.outside, "%", "lower", 0.1),
        Record(f"{row}: NEES", found.nees, "", "lower"),
        Record(f"{row}: along, RMS", 100.0 * found.along_m, "cm", "lower"),
    ]


def main() -> None:
    """The program."""
    parser = argparse.ArgumentParser(prog="validation.worlds.wrong_logs")
    parser.add_argument("worlds", type=int, nargs="+")
    parser.add_argument("--filter", choices=get_args(Method), help="by the Bayes filter")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write every figure, and what is asked beside it")
    chosen = parser.parse_args()
    records: list[Record] = []
    for world in read_worlds():
        if world.number in chosen.worlds:
            with tempfile.TemporaryDirectory() as folder:
                for row, found in rows_of(world, Path(folder), chosen.filter):
                    records += records_of(row, found)
                    print(row, *(f"{record.value:.4g} {record.unit}" for record in records_of(row, found)), flush=True)
    if chosen.json:
        chosen.json.write_text(kept_text("python -m validation.worlds.wrong_logs", records), encoding="utf-8")
    else:
        print(condition_table(records))


if __name__ == "__main__":
    main()
