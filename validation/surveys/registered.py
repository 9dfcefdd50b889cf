"""Every real recording registered as its owner would: imported without options, mapped, and located by default.

``python -m validation.surveys.registered FOLDER`` (``PYTHONPATH=.:tests``) prints the table; FOLDER is that of the real
recordings.
"""

import argparse
import sys
import tempfile
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np

from benchmarks.archive import cut_drive
from benchmarks.records import Record, kept_text
from lgprjax.batch import RegisteredDrive, register_log
from lgprjax.formats import DriveLog, DriveWriter, MapFile, TraceRecording, import_lines
from lgprjax.mapping import build_map
from lgprjax.registration import RegisterOptions

_DECLINED = ("edge", "low_correlation", "low_overlap", "ambiguous", "non_finite")
WINDOWS = RegisterOptions(window_m=4.0)
"""Forced windows of 4 m: what the recordings' page states its figures for."""


class Row(NamedTuple):
    """One drive or several on one map.

    Attributes:
        name: of recordings, map and drive.
        tried: scans with a window on the map.
        ok: of these.
        right: ok, and no farther from their labels than ``within_m`` along and across.
        within_m: what labels are good for.
        along_m, cross_m: medians of what the ok are off, and ``largest_m`` the largest of either.
        declined: the others by code.
        told: how traces were changed to be the map's.
    """

    name: str
    tried: int
    ok: int
    right: int
    within_m: float
    along_m: float
    cross_m: float
    largest_m: float
    declined: dict[str, int]
    told: str


def judge(name: str, drives: Sequence[RegisteredDrive], within_m: float = 0.3) -> Row:
    """Compare with where the survey says that the lines were: the prior, which no registration sees the inside of."""
    along, cross, codes = [], [], []
    for drive in drives:
        pose, prior = np.asarray(drive.fix.pose), drive.track.pose
        off = pose[:, :2] - prior[:, :2]
        cos, sin = np.cos(prior[:, 3]), np.sin(prior[:, 3])
        along.append(cos * off[:, 0] + sin * off[:, 1])
        cross.append(cos * off[:, 1] - sin * off[:, 0])
        codes.append(drive.table["code"].to_numpy())
    off_along, off_cross, code = np.concatenate(along), np.concatenate(cross), np.concatenate(codes)
    ok = code == "ok"
    worst = np.maximum(np.abs(off_along), np.abs(off_cross))[ok]
    told = "; ".join(sorted({drive.alignment.told for drive in drives if drive.alignment.told}))
    return Row(
        name=name,
        tried=int(np.sum(~np.isin(code, ("no_window", "off_map")))),
        ok=int(ok.sum()),
        right=int(np.sum(worst <= within_m)),
        within_m=within_m,
        along_m=float(np.median(off_along[ok])) if ok.any() else np.nan,
        cross_m=float(np.median(off_cross[ok])) if ok.any() else np.nan,
        largest_m=float(worst.max()) if ok.any() else np.nan,
        declined={str(key): count for key, count in Counter(code[~ok].tolist()).items()},
        told=told,
    )


def register(database: Path, drive: Path, options: RegisterOptions | None = None) -> RegisteredDrive:
    """One drive on one map."""
    with MapFile.open(database) as source, DriveLog.open(drive) as log:
        return register_log(source, log, options or RegisterOptions())


def halves(line: Path, folder: Path) -> tuple[Path, Path]:
    """Odd traces of a line as a map, even ones as a drive: two noises of one ground, half a step apart."""
    whole, odd, even = (folder / f"{line.stem}-{part}.drive.h5" for part in ("whole", "odd", "even"))
    import_lines([line], output=whole)
    for target, first in ((odd, 1), (even, 0)):
        with DriveLog.open(whole) as log:
            recording = log.description.recording
            assert isinstance(recording, TraceRecording)
            traces, valid = log.read_traces(0, log.scans)
            with DriveWriter.create(target, log.description, channels=log.channels, dtype=np.float32) as writer:
                writer.append(
                    log.scan_time_s[first::2], traces[first::2] + np.float32(recording.zero_level), valid[first::2]
                )
    database = folder / f"{line.stem}.map.h5"
    build_map([odd], database)
    return database, even


def flagogna(data: Path, folder: Path) -> Iterator[Row]:
    """One ground on two days: lines 0.25 m apart."""
    made: dict[tuple[int, ...], Path] = {}

    def drive(*numbers: int, lines_at_m: Sequence[float] | None = None) -> Path:
        if numbers not in made or lines_at_m is not None:
            paths = [data / "flagogna" / f"XLINE{number:03d}.DT1" for number in numbers]
            made[numbers] = folder / f"f{numbers[0]}-{numbers[-1]}-{len(numbers)}.drive.h5"
            # Lines that all ran one way do not say which: the survey's sheet does, odd ones were walked back.
            one_way = len({number % 2 for number in numbers}) == 1
            import_lines(
                paths,
                lines_at_m=lines_at_m,
                reversed_lines="odd" if one_way else "auto",
                output=made[numbers],
                force=True,
            )
        return made[numbers]

    def mapped(*numbers: int) -> Path:
        database = folder / f"f{numbers[0]}-{numbers[-1]}-{len(numbers)}.map.h5"
        if not database.exists():
            build_map([drive(*numbers)], database)
        return database

    first, second, odd = mapped(*range(50, 67)), mapped(*range(67, 84)), mapped(*range(21, 67, 2))
    for options, how in ((None, "by default"), (WINDOWS, "windows of 4 m")):
        for database, number, name in ((first, 67, "50-66"), (second, 66, "67-83"), (first, 68, "50-66")):
            yield judge(f"Flagogna {number} on {name}, {how}", [register(database, drive(number), options)], 0.5)
        beyond = [register(first, drive(number), options) for number in (69, 70)]
        yield judge(f"Flagogna 69 and 70 on 50-66, {how}", beyond, 0.5)
    single = [register(odd, drive(number)) for number in range(22, 66, 4)]
    yield judge("Flagogna even lines on odd ones, one channel", single, 0.5)
    arrays = [register(odd, drive(*range(first, first + 16, 2))) for first in (22, 36, 50)]
    yield judge("Flagogna even lines on odd ones, eight channels", arrays, 0.5)
    # Other ground, put where the map's is: lines of the first by tape, at the places of lines 20 to 40.
    other = folder / "other.map.h5"
    paths = [data / "flagogna" / f"XLINE{number:03d}.DT1" for number in range(20, 41)]
    import_lines(paths, line_spacing_m=0.25, output=folder / "other.drive.h5")
    build_map([folder / "other.drive.h5"], other)
    false = [register(other, drive(number, lines_at_m=[0.25 * (number - 80) % 5.0])) for number in range(80, 104)]
    yield judge("Flagogna 80-103 led onto 20-40: other ground", false, 0.5)


def parallel_lines(data: Path, folder: Path) -> Iterator[Row]:
    """GPR-O: map of the odd lines, three even lines at a time are live."""
    lines = [data / "gpr_o_parallel_lines" / f"XLINE{number:02d}.DT1" for number in range(25)]
    odd, database = folder / "odd.drive.h5", folder / "odd.map.h5"
    import_lines(lines[1::2], line_spacing_m=0.4, first_line_m=0.2, output=odd)
    build_map([odd], database)
    drives = []
    for first in range(0, 22, 2):
        live = folder / f"even{first}.drive.h5"
        import_lines(lines[first : first + 5 : 2], line_spacing_m=0.4, first_line_m=0.2 * first, output=live)
        drives.append(register(database, live))
    yield judge("GPR-O even lines on odd ones, three channels", drives)


def hautefeuille(data: Path, folder: Path) -> Iterator[Row]:
    """A third of line 2 on line 1: half a metre beside a single line."""
    lines = [data / "hautefeuille" / f"FILE__00{number}.DZT" for number in (1, 2)]
    one, two, live = (folder / f"{name}.drive.h5" for name in ("one", "two", "live"))
    import_lines(lines[:1], lines_at_m=[0.0], length_m=30.0, output=one)
    import_lines(lines[1:], lines_at_m=[0.5], length_m=30.0, reversed_lines=(0,), output=two)
    build_map([one], folder / "one.map.h5")
    with DriveLog.open(two) as log:
        cut_drive(log, 0, log.scans // 3, live)
    yield judge("Hautefeuille a third of line 2 on line 1", [register(folder / "one.map.h5", live)])


def single_lines(data: Path, folder: Path, only: str = "") -> Iterator[Row]:
    """Odd traces are the map, even ones the drive; those lines whose name begins with ``only``."""
    for name, path in (
        ("Yosemite, 50 MHz", "gprpy_yosemite/XLINE00.DT1"),
        ("dune, 400 MHz", "gprpy_dune/FILE____032.DZT"),
        ("MALA utility line, 500 MHz", "gprpymini_mala500/utility_example.rd3"),
    ):
        if not name.startswith(only):
            continue
        database, even = halves(data / path, folder)
        yield judge(f"{name}: even traces on odd ones", [register(database, even)])


SETS: dict[str, Callable[[Path, Path], Iterator[Row]]] = {
    "flagogna": flagogna,
    "parallel-lines": parallel_lines,
    "hautefeuille": hautefeuille,
    "single-lines": single_lines,
}


def table(rows: Sequence[Row]) -> str:
    """Markdown table, a row for each drive and map."""
    lines = [
        "| drive and map | tried | `ok` | right | median off along, across | largest | declined |",
        "| --- | --- | --- | --- | --- | --- | --- |",
    ]
    for row in rows:
        declined = ", ".join(f"{code} {count}" for code, count in sorted(row.declined.items()))
        share = 100.0 * row.ok / max(row.tried, 1)
        off = f"{row.along_m:+.2f}, {row.cross_m:+.2f} m" if row.ok else "–"
        largest = f"{row.largest_m:.2f} m" if row.ok else "–"
        right = f"{row.right} within {row.within_m:g} m"
        lines.append(
            f"| {row.name} | {row.tried} | {row.ok} ({share:.0f} %) | {right} | {off} | {largest} | {declined} |"
        )
    return "\n".join(lines + [f"{row.name}: {row.told}" for row in rows if row.told])


def records_of(rows: Sequence[Row]) -> list[Record]:
    """The same as records. Asked of other ground: nothing ``ok``; of what is ``ok``: right."""
    records: list[Record] = []
    for row in rows:
        share = 100.0 * row.ok / max(row.tried, 1)
        other = row.name.endswith("other ground")
        figures: list[tuple[str, float, str, Literal["higher", "lower"], float | None]] = [
            ("tried", row.tried, "", "higher", None),
            ("`ok`", share, "%", "lower" if other else "higher", 0.0 if other else None),
            ("right, of the `ok`", 100.0 * row.right / row.ok if row.ok else np.nan, "%", "higher", None),
            ("within", row.within_m, "m", "lower", None),
            ("along, median", 100.0 * row.along_m, "cm", "lower", None),
            ("across, median", 100.0 * row.cross_m, "cm", "lower", None),
            ("largest", 100.0 * row.largest_m, "cm", "lower", None),
            *((code, row.declined.get(code, 0), "", "lower", None) for code in _DECLINED),
        ]
        records += [Record(f"{row.name}: {key}", value, unit, way, goal) for key, value, unit, way, goal in figures]
    return records


def main(arguments: Sequence[str] | None = None) -> int:
    """The command."""
    parser = argparse.ArgumentParser(
        prog="python -m validation.surveys.registered", description="Register the real recordings."
    )
    parser.add_argument("folder", type=Path, help="of the real recordings")
    parser.add_argument("--sets", nargs="+", choices=SETS, default=list(SETS))
    parser.add_argument("--json", type=Path, metavar="FILE", help="write every figure")
    chosen = parser.parse_args(arguments)
    rows: list[Row] = []
    for name in chosen.sets:
        with tempfile.TemporaryDirectory() as scratch:
            for row in SETS[name](chosen.folder, Path(scratch)):
                rows.append(row)
                print(table([row]).splitlines()[2], file=sys.stderr, flush=True)
    print(table(rows))
    if chosen.json:
        quick = list(chosen.sets) != list(SETS)
        chosen.json.write_text(
            kept_text("python -m validation.surveys.registered", records_of(rows), quick=quick), "utf-8"
        )
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
