"""The table of the worlds: ``python -m validation.worlds.table`` (from the repository, ``PYTHONPATH=.:tests``).

Registers every day of every world with defaults only and prints a table a day, with what all worlds give together and
the worst world by name. With ``--json`` it keeps figures and goals as the benchmarks do: ``docs/records/worlds.json``,
from which the site makes a page.
"""

import argparse
import json
import multiprocessing
import sys
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import asdict
from pathlib import Path
from typing import NamedTuple

import numpy as np

from benchmarks.records import Record, kept_text
from validation.worlds.drives import DAYS
from validation.worlds.figures import DayFigures, Pooled, pooled_nees, world_figures
from validation.worlds.parameters import World, read_worlds

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
    for number, nees in _nees(own).items():
        outside = "" if nees.low <= nees.mean <= nees.high else "  outside"
        lines.append(f"{number:5d} {nees.mean:6.2f} {nees.pieces:7d}  {nees.low:.2f} to {nees.high:.2f}{outside}")
    total = pooled_nees(own)
    return "\n".join([*lines, f"  all {total.mean:6.2f} {total.pieces:7d}"])


class Goals(NamedTuple):
    """Shares of ok scans that are asked of a day, percent: of all worlds of a group, and of its worst."""

    title: str
    many: float
    worst: float
    few: float


GOALS = {
    "clear": Goals("clear", 99.0, 95.0, 80.0),
    "clear_beside": Goals("clear, other side of the lane", 99.0, 95.0, 80.0),
    "snow": Goals("snow", 99.0, 95.0, 80.0),
    "rain": Goals("rain, drifting time scale of 0.95 to 1.08", 95.0, 85.0, 80.0),
    "gps_jump": Goals("GNSS wrong by 1.5 m east and north over 8 m, odometer", 95.0, 85.0, 80.0),
    "gps_jump_chords": Goals("the same, travel from positions", 95.0, 85.0, 80.0),
}
"""Days on the map's own ground."""
_GROUPS = ("6 channels or more", "1 to 5 channels", "beyond half a wavelength")


def _group(row: DayFigures) -> str:
    return _GROUPS[2] if row.beyond else _GROUPS[0] if row.channels >= 6 else _GROUPS[1]


def _share(rows: Sequence[DayFigures]) -> float:
    """Scans that are ok, percent."""
    return 100.0 * sum(row.ok for row in rows) / max(sum(row.scans for row in rows), 1)


def records_of(rows: Sequence[DayFigures]) -> list[Record]:
    """Figures of all worlds beside what is asked of them."""
    records = []
    for day, goals in GOALS.items():
        for group, whole, worst in (
            (_GROUPS[0], goals.many, goals.worst),
            (_GROUPS[1], None, goals.few),
            (_GROUPS[2], None, None),
        ):
            of_day = [row for row in rows if row.day == day and _group(row) == group]
            if not of_day:
                continue
            least = min(of_day, key=lambda row: row.ok_share)
            note = f"{len(of_day)} worlds, {sum(row.scans for row in of_day)} scans"
            key = f"worlds/{group}/{day}"
            records.append(Record(f"{key}/ok", _share(of_day), "%", "higher", whole, note))
            records.append(
                Record(f"{key}/ok in the worst world", _share([least]), "%", "higher", worst, f"world {least.world}")
            )
    own = [row for row in rows if row.day in NEES_DAYS]
    pieces = sum(row.pieces for row in own)
    records.append(
        Record("worlds/wrong fixes that are ok", sum(row.wrong for row in own), "", "lower", 0, f"{pieces} pieces")
    )
    for day, name in (("impostor", "impostor"), ("lookalike", "look-alike")):
        of_day = [row for row in rows if row.day == day]
        scans = sum(row.scans for row in of_day)
        wrong = sum(row.wrong for row in of_day)
        records.append(Record(f"worlds/{name}: wrong fixes that are ok", wrong, "", "lower", 0, f"{scans} scans"))
    total = pooled_nees(own)
    records.append(Record("worlds/NEES", total.mean, "", "lower", 1.25, f"{total.pieces} pieces; 0.8 to 1.25"))
    outside = [number for number, nees in _nees(own).items() if not nees.low <= nees.mean <= nees.high]
    note = "worlds " + ", ".join(map(str, outside)) if outside else ""
    records.append(Record("worlds/NEES outside of its 99.9 % interval", len(outside), "worlds", "lower", 0, note))
    return records


def _nees(own: Sequence[DayFigures]) -> dict[int, Pooled]:
    return {
        number: pooled_nees([row for row in own if row.world == number])
        for number in sorted({row.world for row in own})
    }


def markdown_of(rows: Sequence[DayFigures]) -> str:
    """Two Markdown tables for the record's page: days by groups of worlds, then all worlds."""
    lines = [
        "| day | " + " | ".join(f"{group}: `ok` | worst world" for group in _GROUPS) + " | wrong, of pieces |",
        "| --- " * 8 + "|",
    ]
    for day, goals in GOALS.items():
        of_day = [row for row in rows if row.day == day]
        cells = [goals.title]
        for group in _GROUPS:
            some = [row for row in of_day if _group(row) == group]
            least = min(some, key=lambda row: row.ok_share, default=None)
            cells += ["", ""] if least is None else [f"{_share(some):.2f} %", f"{least.world}: {_share([least]):.1f} %"]
        cells.append(f"{sum(row.wrong for row in of_day)} of {sum(row.pieces for row in of_day)}")
        lines.append("| " + " | ".join(cells) + " |")
    for day, name in (("impostor", "other ground below the same drive"), ("lookalike", "repetitive ground")):
        of_day = [row for row in rows if row.day == day]
        cells = [name]
        for group in _GROUPS:
            some = [row for row in of_day if _group(row) == group]
            cells += [f"{sum(row.ok for row in some)} of {sum(row.scans for row in some)} scans" if some else "", ""]
        cells.append(f"{sum(row.wrong for row in of_day)} of {sum(row.pieces for row in of_day)}")
        lines.append("| " + " | ".join(cells) + " |")
    short = ("clear", "other side", "snow", "rain", "GNSS wrong", "GNSS wrong, no odometer")
    lines += [
        "",
        "| world | channels | " + " | ".join(short) + " | wrong | NEES, its 99.9 % interval | declined |",
        "| --- " * 11 + "|",
    ]
    for number in sorted({row.world for row in rows}):
        of_world = [row for row in rows if row.world == number]
        own = [row for row in of_world if row.day in NEES_DAYS]
        nees = pooled_nees(own)
        days = {row.day: row for row in own}
        shares = [f"{_share([days[day]]):.1f}" if day in days else "" for day in GOALS]
        outside = "" if nees.low <= nees.mean <= nees.high else "**"
        declined: Counter[str] = sum((Counter(row.declined) for row in own), Counter())
        codes = ", ".join(f"{code} {count}" for code, count in declined.most_common(2))
        cells = [
            f"{number}{'*' if own[0].beyond else ''}",
            str(own[0].channels),
            *shares,
            str(sum(row.wrong for row in of_world)),
            f"{outside}{nees.mean:.2f}{outside}, {nees.low:.2f} to {nees.high:.2f}",
            codes,
        ]
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines) + "\n"


def read_figures(path: Path) -> list[DayFigures]:
    """Rows that ``--json`` has kept."""
    rows = json.loads(path.read_text(encoding="utf-8"))["figures"]
    return [DayFigures(**{**row, **{key: float("nan") for key, value in row.items() if value is None}}) for row in rows]


def _write(path: Path, rows: Sequence[DayFigures], quick: bool) -> None:
    figures = [
        {
            key: None if isinstance(value, float) and not np.isfinite(value) else value
            for key, value in asdict(row).items()
        }
        for row in sorted(rows, key=lambda row: (row.world, DAYS.index(row.day)))
    ]
    text = kept_text("python -m validation.worlds.table", records_of(rows), quick=quick, figures=figures)
    path.write_text(text, encoding="utf-8")


def main(arguments: Sequence[str] | None = None) -> int:
    """The command."""
    known = read_worlds()
    parser = argparse.ArgumentParser(
        prog="python -m validation.worlds.table", description="Register the worlds, defaults only."
    )
    parser.add_argument("--worlds", type=int, nargs="+", metavar="N", help="by number; all without")
    parser.add_argument("--days", nargs="+", choices=DAYS, help="by name; all without")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write every figure, and what is asked beside it")
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
            _write(chosen.json, rows, quick=chosen.worlds is not None or chosen.days is not None)
    for day in DAYS:
        of_day = [row for row in rows if row.day == day]
        if of_day:
            print(f"\n{day}\n{day_table(of_day)}")
    print(f"\nconsistency\n{consistency_table(rows)}")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
