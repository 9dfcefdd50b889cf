"""``lgprjax register --workers N`` and ``--scheduler ADDRESS``: many drives, one folder of results."""

import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float
from rich.table import Table

from lgprjax.cli.register import check_region, hold_ground, search_in_words
from lgprjax.cli.terminal import BAD_INPUT, UsageError, console, progress_bar, working
from lgprjax.errors import InputError

if TYPE_CHECKING:
    from lgprjax.batch import ArchiveRun, ArchiveSums, BadPlace, CellTally, Job, JobOutcome, JobRecord, WorkerShare
    from lgprjax.formats import MapFile
    from lgprjax.frames import LocalFrame
    from lgprjax.registration import RegisterOptions
    from lgprjax.report import ArchiveDrives, ArchivePlaces, ReportFigure


# An archive as people see it: the table in the terminal, ``archive.csv``, ``archive.html``.

_FEW = 10

Cells = Mapping[tuple[int, int], Sequence[tuple[str, "CellTally"]]]


def write_views(run: "ArchiveRun") -> "ArchiveSums":
    """Write table and page of all that a folder holds on the run's map; the sums over it."""
    from lgprjax.batch import cell_sums, records_of, shares_of, sums_of, worst_places, write_table
    from lgprjax.formats import MapFile
    from lgprjax.report import ArchivePage, write_archive_page

    records = records_of(run.folder, run.map_sha256)
    write_table(run.folder, records)
    sums, cells = sums_of(records), cell_sums(records)
    worst = worst_places(cells, _FEW)
    with MapFile.open(run.map_path) as source, TemporaryDirectory() as pictures:
        name, frame = source.description.name, source.description.frame
        spread, plan = _draw(Path(pictures), _drives(records, sums, name), _places(cells, worst, source))
        page = ArchivePage(
            title=f"Drives on {name}",
            intro=_intro(records),
            facts=tuple(facts_of(sums)),
            places=tuple(_place_row(number, place, frame) for number, place in enumerate(worst, start=1)),
            drives=tuple(_drive_row(record) for record in _worst_drives(records)),
            failed=tuple((record.name, record.error) for record in records if record.state == "failed"),
            workers=tuple(_worker_row(share) for share in shares_of(records)[:_FEW]),
            spread=spread,
            plan=plan,
        )
        write_archive_page(run.folder / "archive.html", page, force=True)
    return sums


def print_sums(sums: "ArchiveSums") -> None:
    """The sums as a table in the terminal."""
    table = Table("quantity", "value", title="All drives of the folder")
    for quantity, value in facts_of(sums):
        table.add_row(quantity, value)
    console.print(table)


def facts_of(sums: "ArchiveSums") -> list[tuple[str, str]]:
    """Quantity and value of an archive's sums."""
    declined = ", ".join(f"{n} {c}" for c, n in sums.counts.items() if n and c not in ("ok", "no_window"))
    wrong = "–" if sums.wrong is None else f"{sums.wrong} of {sums.judged} judged"
    return [
        ("drives registered, failed", f"{sums.drives}, {sums.failed}"),
        ("way driven", f"{1e-3 * sums.way_m:.2f} km"),
        ("scans, of these searched", f"{sums.scans}, {sums.tried}"),
        ("ok", f"{sums.counts['ok']} ({_percent(sums.counts['ok'], sums.tried)} of the searched)"),
        ("declined", declined or "none"),
        ("ok but wrong (more than 0.3 m off)", wrong),
        ("RMS error across, along", f"{_number(sums.rms_cross_m, 3, ' m')}, {_number(sums.rms_along_m, 3, ' m')}"),
        ("largest error of an ok fix", _number(sums.largest_m, 3, " m")),
        ("time a scan, median drive", _number(sums.milliseconds_per_scan, 2, " ms")),
    ]


def _intro(records: Sequence["JobRecord"]) -> str:
    told = {search_in_words(record.settings) for record in records}
    if not told:
        return "No drive could be registered."
    how = told.pop() if len(told) == 1 else f"Registered with {len(told)} different searches: see archive.csv."
    return f"Every fix is a line of NAME.fixes.csv; every drive is a line of archive.csv.\n\n{how}"


def _draw(
    folder: Path, drives: "ArchiveDrives", places: "ArchivePlaces"
) -> "tuple[ReportFigure | None, ReportFigure | None]":
    from lgprjax.report import ReportFigure, draw_archive_drives, draw_archive_places

    if not len(drives.ok_share) or not len(places.cell):
        return None, None
    draw_archive_drives(drives, folder / "spread.png")
    draw_archive_places(places, folder / "plan.png")
    alt = "histograms of availability, error and time, bars of the codes"
    spread = ReportFigure(folder / "spread.png", "How the drives fared.", alt)
    alt = "plan of the map in coloured cells, the worst places numbered"
    return spread, ReportFigure(folder / "plan.png", "Where they found themselves, and where they did not.", alt)


def _drives(records: Sequence["JobRecord"], sums: "ArchiveSums", name: str) -> "ArchiveDrives":
    from lgprjax.report import ArchiveDrives

    figures = [record.figures for record in records if record.figures is not None]

    def each(values: list[float | None]) -> Float[np.ndarray, " drive"]:
        return np.array([np.nan if value is None else value for value in values], dtype=np.float64)

    return ArchiveDrives(
        name=name,
        ok_share=each([figure.ok_share for figure in figures]),
        rms_cross_m=each([figure.rms_cross_m for figure in figures]),
        rms_along_m=each([figure.rms_along_m for figure in figures]),
        milliseconds_per_scan=each([figure.milliseconds_per_scan for figure in figures]),
        counts=sums.counts,
    )


def _places(cells: Cells, worst: Sequence["BadPlace"], source: "MapFile") -> "ArchivePlaces":
    from lgprjax.batch import CELL_M, summed
    from lgprjax.report import ArchivePlaces

    sums = [summed([cell for _, cell in found]) for found in cells.values()]
    return ArchivePlaces(
        name=source.description.name,
        cell_m=CELL_M,
        cell=np.array([(cell.east, cell.north) for cell in sums], dtype=np.int64).reshape(-1, 2),
        tried=np.array([cell.tried for cell in sums], dtype=np.int64),
        ok=np.array([cell.ok for cell in sums], dtype=np.int64),
        judged=np.array([cell.judged for cell in sums], dtype=np.int64),
        square_m2=np.array([cell.square_m2 for cell in sums], dtype=np.float64),
        worst_m=np.array([(place.east_m, place.north_m) for place in worst], dtype=np.float64).reshape(-1, 2),
        chords_m=source.places.stretches.chord_m,
    )


def _worst_drives(records: Sequence["JobRecord"]) -> list["JobRecord"]:
    """Those with wrong ok fixes first, then those with the fewest fixes."""

    def how_bad(record: "JobRecord") -> tuple[int, float]:
        assert record.figures is not None
        return -(record.figures.wrong or 0), record.figures.ok_share

    return sorted((record for record in records if record.figures is not None), key=how_bad)[:_FEW]


def _place_row(number: int, place: "BadPlace", frame: "LocalFrame") -> tuple[str, ...]:
    cell = place.cell
    latitude, longitude, _ = frame.to_geodetic(np.array([place.east_m]), np.array([place.north_m]), np.zeros(1))
    return (
        str(number),
        f"{place.east_m:.1f}, {place.north_m:.1f}",
        f"{latitude[0]:.6f}°, {longitude[0]:.6f}°",
        str(cell.tried),
        _percent(cell.ok, cell.tried),
        f"{cell.largest_m:.3f} m" if cell.judged else "–",
        place.drive,
        f"{place.time_s:.2f}",
    )


def _drive_row(record: "JobRecord") -> tuple[str, ...]:
    figures = record.figures
    assert figures is not None
    return (
        record.name,
        str(figures.tried),
        _percent(figures.ok, figures.tried),
        "–" if figures.wrong is None else str(figures.wrong),
        *(_number(value, 3, " m") for value in (figures.rms_cross_m, figures.rms_along_m, figures.largest_m)),
        f"{figures.milliseconds_per_scan:.2f}",
    )


def _worker_row(share: "WorkerShare") -> tuple[str, ...]:
    own = (str(number) for number in (share.drives, share.compiled, share.late))
    return (share.worker, *own, f"{share.peak_rss_mb:.0f} MB", f"{share.seconds:.1f} s")


def _percent(part: int, whole: int) -> str:
    return f"{100.0 * part / whole:.1f} %" if whole else "–"


def _number(value: float | None, decimals: int, unit: str) -> str:
    return "–" if value is None else f"{value:.{decimals}f}{unit}"


@dataclass(frozen=True)
class Workforce:
    """Who registers the drives: processes of this machine, or a cluster.

    Attributes:
        workers: processes of this machine; None where a scheduler is named.
        threads: each is held to; None for an equal share of the cores, on a cluster for one.
        scheduler: address of a dask scheduler.
    """

    workers: int | None
    threads: int | None
    scheduler: str | None

    def check(self) -> None:
        """Raise ``UsageError`` where the options make no sense together."""
        if self.workers is not None and self.scheduler is not None:
            raise UsageError("--workers, --scheduler: expected one of them, found both")
        if self.workers is None and self.scheduler is None:
            raise UsageError("--threads: expected --workers or --scheduler beside it, found neither")
        for name, value in (("--workers", self.workers), ("--threads", self.threads)):
            if value is not None and not 1 <= value <= 4096:
                raise UsageError(f"{name}: expected 1 to 4096, found {value}")


def register_many(
    map_path: Path,
    drives: Sequence[Path],
    folder: Path,
    options: "RegisterOptions",
    workforce: Workforce,
    *,
    json: Path | None,
    force: bool,
) -> int:
    """Register what is missing or changed in a folder; table and page of all that it holds. Returns the exit status."""
    from lgprjax.batch import ArchiveRun, claimed, drive_name, note_failure, plan_jobs, stamp_of
    from lgprjax.batch.workers import gpus
    from lgprjax.files import file_hash
    from lgprjax.formats import MapFile
    from lgprjax.machine import usable_cores

    workforce.check()
    names = [drive_name(path) for path in drives]
    if len(set(names)) < len(names):
        twice = next(name for name in names if names.count(name) > 1)
        raise InputError(twice, "drives", "drives of different names", "this name twice")
    own_gpus = [] if workforce.scheduler else gpus()
    if own_gpus and (workforce.workers or 0) > len(own_gpus):
        raise UsageError(f"--workers: expected at most {len(own_gpus)}, one a GPU, found {workforce.workers}")
    with MapFile.open(map_path) as source:
        check_region(options.search_m, source)
        # Measured and remembered here, or each worker would measure for itself.
        hold_ground(source, options)
    stamp = stamp_of(map_path)
    with working(f"reading {map_path.name}"):
        map_sha256 = file_hash(map_path)
    threads = workforce.threads or (1 if workforce.workers is None else max(1, usable_cores() // workforce.workers))
    run = ArchiveRun(map_path.absolute(), map_sha256, stamp, options, folder.absolute(), threads)
    with claimed(run, names, force=force):
        with progress_bar("looking at drives", len(drives)) as progress:
            plan = plan_jobs(run, drives, force=force, progress=progress)
        failed = list(plan.unreadable)
        with (
            progress_bar("registering drives", len(plan.todo)) as progress,
            _done_by(workforce, run, own_gpus, plan.todo) as outcomes,
        ):
            for outcome in outcomes:
                if outcome.error is not None:
                    failed.append(outcome.error)
                    note_failure(run, outcome.job, outcome.error, outcome.attempts)
                progress(1)
        with working("drawing"):
            sums = write_views(run)
    for error in failed:
        print(f"lgprjax: {error}", file=sys.stderr)
    done = len(drives) - len(plan.done) - len(failed)
    print_sums(sums)
    _say(f"{len(drives)} drives: {done} registered now, {len(plan.done)} as they were, {len(failed)} failed")
    _say(f"fixes, archive.csv and the records of all jobs: {folder}")
    _say(f"page: {(folder / 'archive.html').resolve()}")
    if json is not None:
        from lgprjax.cli.figures import write_figures

        write_figures(json, sums._asdict(), force=force)
    return BAD_INPUT if failed else 0


@contextmanager
def _done_by(
    workforce: Workforce, run: "ArchiveRun", gpus: Sequence[str], jobs: Sequence["Job"]
) -> "Iterator[Iterator[JobOutcome]]":
    """Outcomes of jobs as they come; leaving the block ends what is still at work."""
    from lgprjax.batch import WorkerPool, run_on_scheduler

    if workforce.workers is not None:
        with WorkerPool(run, workforce.workers, gpus=gpus) as pool:
            yield pool.run(jobs)
    else:
        assert workforce.scheduler is not None
        outcomes = run_on_scheduler(workforce.scheduler, run, jobs)
        try:
            yield outcomes
        finally:
            outcomes.close()


def _say(text: str) -> None:
    console.print(text, highlight=False, markup=False, soft_wrap=True)
