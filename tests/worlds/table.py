"""The table of the worlds: ``python -m worlds.table`` (from the repository, ``PYTHONPATH=.:tests``).

Registers every day of every world with defaults only and prints a table a day, with what all worlds give together and
the worst world by name.
"""

import argparse
import json
import multiprocessing
import sys
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path

import numpy as np

from worlds.drives import DAYS
from worlds.figures import DayFigures, pooled_nees, world_figures
from worlds.parameters import World, read_worlds

WORKERS = 2
NEES_DAYS = ("clear", "clear_beside", "snow", "rain", "gps_jump", "gps_jump_chords")
"""Days whose ground is the map's own: consistency is asked of their fixes."""


def all_figures(
    worlds: Sequence[World], days: Sequence[str] | None = None, keep: Path | None = None, workers: int = WORKERS
) -> Iterator[list[DayFigures]]:
    """Figures of each world as it is done, every one in a process of its own, so that its memory goes with it.

    Raises:
        ExceptionGroup: after all others are done, where worlds could not be registered.
    """
    failed: list[Exception] = []
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(workers, mp_context=context, max_tasks_per_child=1) as pool:
        jobs = [pool.submit(world_figures, world, days, None, keep) for world in worlds]
        for job in as_completed(jobs):
            error = job.exception()
            if isinstance(error, Exception):
                failed.append(error)
                continue
            yield job.result()
    if failed:
        raise ExceptionGroup(f"{len(failed)} worlds could not be registered", failed)


def day_table(rows: Sequence[DayFigures]) -> str:
    """One day: a line a world, one for all together, and the worst."""
    head = (
        "world ch  SNR  scans    ok% right% wrong  max along cross   RMS along cross   NEES  place  n"
        "  window  p_false   ms  declined"
    )
    lines = [head]
    for row in sorted(rows, key=lambda row: row.world):
        declined = " ".join(f"{code}:{count}" for code, count in sorted(row.declined.items()))
        name = f"{row.world}{'*' if row.beyond else ''}"
        lines.append(
            f"{name:>5} {row.channels:2d} {row.signal_db:4.0f} {row.scans:6d} {100 * row.ok_share:6.1f} "
            f"{100 * row.right / max(row.scans, 1):6.1f} {row.wrong:5d}     {row.largest_along_m:6.3f} "
            f"{row.largest_cross_m:6.3f}    {row.rms_along_m:6.3f} {row.rms_cross_m:6.3f} {row.nees:6.2f} "
            f"{row.nees_place:6.2f} {row.nees_pieces:2d}  {row.median_window_m:6.2f} {row.largest_p_false:8.1e} "
            f"{row.milliseconds:4.1f}  {declined}"
        )
    for title, group in (
        ("6 channels or more", [row for row in rows if not row.beyond and row.channels >= 6]),
        ("1 to 5 channels", [row for row in rows if not row.beyond and row.channels < 6]),
        ("beyond half a wavelength*", [row for row in rows if row.beyond]),
    ):
        if group:
            lines.append(_together(title, group))
    return "\n".join(lines)


def _together(title: str, rows: Sequence[DayFigures]) -> str:
    scans, ok = sum(row.scans for row in rows), sum(row.ok for row in rows)
    pieces = sum(row.pieces for row in rows)
    worst = min(rows, key=lambda row: np.nan_to_num(row.ok_share))
    nees = pooled_nees(rows)
    declined: Counter[str] = sum((Counter(row.declined) for row in rows), Counter())
    return (
        f"{title}: {len(rows)} worlds, {scans} scans, ok {100 * ok / max(scans, 1):.2f} %, "
        f"wrong {sum(row.wrong for row in rows)} in {pieces} pieces (bound {3 / max(pieces, 1):.1e}), "
        f"NEES {nees.mean:.2f} of {nees.pieces}; lowest ok world {worst.world} ({100 * worst.ok_share:.1f} %), "
        f"most wrong world {max(rows, key=lambda row: row.wrong).world}; declined {dict(declined)}"
    )


def consistency_table(rows: Sequence[DayFigures]) -> str:
    """NEES against labels of each world over the days on its own ground, beside its 99.9 % interval."""
    own = [row for row in rows if row.day in NEES_DAYS]
    lines = ["world   NEES  pieces  99.9 % interval"]
    for number in sorted({row.world for row in own}):
        nees = pooled_nees([row for row in own if row.world == number])
        outside = "" if nees.low <= nees.mean <= nees.high else "  outside"
        lines.append(f"{number:5d} {nees.mean:6.2f} {nees.pieces:7d}  {nees.low:.2f} to {nees.high:.2f}{outside}")
    total = pooled_nees(own)
    return "\n".join([*lines, f"  all {total.mean:6.2f} {total.pieces:7d}"])


def main(arguments: Sequence[str] | None = None) -> int:
    """The command."""
    known = read_worlds()
    parser = argparse.ArgumentParser(prog="python -m worlds.table", description="Register the worlds, defaults only.")
    parser.add_argument("--worlds", type=int, nargs="+", metavar="N", help="by number; all without")
    parser.add_argument("--days", nargs="+", choices=DAYS, help="by name; all without")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write every figure")
    parser.add_argument("--keep", type=Path, metavar="FOLDER", help="keep drives and maps there")
    chosen = parser.parse_args(arguments)
    numbers = chosen.worlds if chosen.worlds is not None else [world.number for world in known]
    missing = sorted(set(numbers) - {world.number for world in known})
    if missing:
        parser.error(f"worlds are numbered 0 to {known[-1].number}, not {missing}")
    rows: list[DayFigures] = []
    began = time.perf_counter()
    for done, found in enumerate(all_figures([known[n] for n in numbers], chosen.days, chosen.keep), 1):
        rows += found
        seconds = time.perf_counter() - began
        print(f"{done} of {len(numbers)} worlds, {seconds:.0f} s", file=sys.stderr, flush=True)
        if chosen.json:
            # After each world: a run that is stopped leaves what it has.
            chosen.json.write_text(json.dumps([row.as_record() for row in rows], indent=1), encoding="utf-8")
    for day in DAYS:
        of_day = [row for row in rows if row.day == day]
        if of_day:
            print(f"\n{day}\n{day_table(of_day)}")
    print(f"\nconsistency\n{consistency_table(rows)}")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
