"""Starts on worlds without a prior position: ``python -m validation.worlds.starts 18 22`` (``PYTHONPATH=.:tests``).

Every start of every day of the worlds that ``validation.worlds.heart`` made (``--keep``): codes, metres driven, errors
against the truth, and their squares over the stated variances. Those of eight worlds are in ``starts.jsonl``.
"""

import argparse
import json
import tempfile
import time
from pathlib import Path

import numpy as np

from lgprjax.batch.locate import MapLines, locate_log
from lgprjax.batch.register import true_poses
from lgprjax.formats import DriveLog, MapFile
from validation.worlds.heart import DAYS, made
from validation.worlds.parameters import read_worlds


def starts_of(held: MapLines, path: Path, every_m: float) -> dict[str, object]:
    """Figures of the starts of a drive; the truth of an impostor's is another ground's, where none must be ok."""
    with DriveLog.open(path) as log:
        began = time.process_time()
        table = locate_log(held, log, every_m).table
        cpu_s = time.process_time() - began
        frame = held.source.description.frame
        truth = true_poses(log, frame)
    assert truth is not None
    ok = table[table["code"] == "ok"]
    latitude, longitude = ok[["latitude_deg", "longitude_deg"]].to_numpy().T
    east, north, _ = frame.to_local(latitude, longitude, np.zeros(len(ok)))
    error_m = np.hypot(np.asarray(east) - truth[ok["scan"], 0], np.asarray(north) - truth[ok["scan"], 1])
    variance_m2 = ok["sigma_along_m"] ** 2 + ok["sigma_cross_m"] ** 2
    return {
        "codes": {str(code): int(count) for code, count in table["code"].value_counts().items()},
        "driven_m": float(ok["driven_m"].median()),
        "furthest_m": float(ok["driven_m"].max()),
        "largest_error_m": float(np.max(error_m, initial=0.0)),
        "nees": float(np.mean(error_m**2 / variance_m2)) if len(ok) else float("nan"),
        "p_false": float(table["p_false"].min()),
        "cpu_s": cpu_s / len(table),
    }


def main() -> None:
    """The program."""
    parser = argparse.ArgumentParser(prog="validation.worlds.starts")
    parser.add_argument("worlds", type=int, nargs="+")
    parser.add_argument("--days", nargs="*", default=DAYS, choices=DAYS)
    parser.add_argument("--every-m", type=float, default=6.0)
    parser.add_argument("--keep", type=Path, help="folder that the worlds stay in")
    parser.add_argument("--record", type=Path, help="file that figures are added to, a line of JSON each")
    chosen = parser.parse_args()
    known = {world.number: world for world in read_worlds()}
    with tempfile.TemporaryDirectory() as scratch:
        for number in chosen.worlds:
            one = made(known[number], chosen.keep or Path(scratch))
            with MapFile.open(one.folder / "ground.map.h5") as source:
                held = MapLines(source)
                for day in chosen.days:
                    row = {"world": number, "day": day} | starts_of(held, one.lives[day].path, chosen.every_m)
                    print(json.dumps(row), flush=True)
                    if chosen.record is not None:
                        with chosen.record.open("a", encoding="utf-8") as file:
                            file.write(json.dumps(row) + "\n")


if __name__ == "__main__":
    main()
