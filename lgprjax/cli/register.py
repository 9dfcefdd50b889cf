"""``lgprjax register``: locate drives on a map; fixes, summary and pictures."""

import sys
from collections.abc import Sequence
from contextlib import nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from rich.table import Table
from tyro.conf import Positional, arg

from lgprjax.cli.figures import check_outputs, write_figures
from lgprjax.cli.terminal import BAD_INPUT, UsageError, console, progress_bar, require_files, working
from lgprjax.errors import InputError
from lgprjax.files import make_folder

if TYPE_CHECKING:
    from lgprjax.batch import HeldGround
    from lgprjax.formats import MapFile
    from lgprjax.registration import RegisterOptions
    from lgprjax.report import DriveSummary
    from lgprjax.report.registered import Registered


def hold_ground(source: "MapFile", options: "RegisterOptions") -> "HeldGround":
    """The map's ground for a search; reports if its noise floor has to be measured first."""
    from lgprjax.batch import HeldGround
    from lgprjax.mapping import MEASURING

    with working(MEASURING) if source.chance is None else nullcontext():
        return HeldGround(source, options)


_FEW = 0.1


@dataclass(frozen=True)
class Register:
    """Locate drives by the ground beneath them: fixes, summary and pictures."""

    map: Annotated[Positional[Path], arg(metavar="MAP", help="subsurface database, M.map.h5")]
    drives: Annotated[Positional[tuple[Path, ...]], arg(metavar="DRIVE...", help="drive logs, X.drive.h5")]
    output: Annotated[
        Path, arg(aliases=["-o"], metavar="DIR", help="folder for DRIVE.fixes.csv, summary, pictures, report.html")
    ]
    search_m: float | None = None
    """search this far to each side of the position in the log, in metres; default: the uncertainty stated by the log
    (4 sigma plus 0.5 m), or 2.5 m if it states none, and farther where no place is found"""
    window_m: float | None = None
    """match windows of this length, 0 for single scans; default: the shortest of 0, 1, 2, 4 and 8 m that reaches the
    risk, scan by scan
    """
    time_scale: float | Literal["auto"] = "auto"
    """time-scale factor relative to the map: two-way travel time in the ground now over that on the map's day (wet
    ground: above 1, after rain about 1.05); auto estimates it along the drive
    """
    risk: float = 1e-4
    """largest accepted probability, in each 4 m of travel, that foreign ground would have matched as well as a fix"""
    search: Literal["exhaustive", "swarm"] = "exhaustive"
    """search every place of the region, or, as a check, by a particle swarm over all five dimensions: the same codes,
    tens of times slower
    """
    finish: Literal["newton", "swarm"] = "newton"
    """refine candidates to poses by Gauss-Newton, or by a particle swarm around each, which needs no derivatives and
    takes several times as long
    """
    track: bool = False
    """search as on board, where each fix uses only what was recorded before it. The drive log of a run (lgprjax
    recover) is searched with the scans, priors and options of that run: the fixes are those that it was driven by
    """
    thresholds: Path | None = None
    """judge by thresholds from lgprjax thresholds, calibrated with the same --window-m, instead of the map's noise
    floor and the risk
    """
    workers: int | None = None
    """run this many worker processes; all results go to one folder with one table and page (no pictures of each drive);
    existing results are not computed again"""
    threads: int | None = None
    """threads of each worker; with equal threads the fixes are identical to the bit"""
    scheduler: str | None = None
    """run the workers on a cluster: address of a dask scheduler, tcp://HOST:8786"""
    json: Path | None = None
    """also write the figures to this file, or - for standard output"""
    force: bool = False
    """replace outputs of these drives that exist; others in the folder stay"""

    def run(self) -> int:
        """Register; the exit status."""
        from lgprjax.batch import check_search
        from lgprjax.formats import read_thresholds
        from lgprjax.registration import FINISH_SWARM, SEARCH_SWARM, RegisterOptions, Thresholds
        from lgprjax.report import summary_table
        from lgprjax.report.registered import write_page

        require_files(self.drives, "drives")
        if self.thresholds is not None and self.window_m is None:
            raise UsageError("--thresholds: needs --window-m as well, the length that they were calibrated for")
        own = None if self.thresholds is None else read_thresholds(self.thresholds, self.window_m or 0.0)
        options = RegisterOptions(
            search_m=self.search_m,
            window_m=self.window_m,
            time_scale=None if self.time_scale == "auto" else self.time_scale,
            risk=self.risk,
            own_thresholds=None if own is None else Thresholds(**own),
            swarm=FINISH_SWARM if self.finish == "swarm" else None,
            search_swarm=SEARCH_SWARM if self.search == "swarm" else None,
            track=self.track,
        )
        if self.track:
            options = _options_of_run(self.drives, options)
        check_search(options)
        check_outputs(self.json, force=self.force)
        if (self.workers, self.threads, self.scheduler) != (None, None, None):
            return self._register_folder(options)
        results = register_all(self.map, self.drives, self.output, options, force=self.force)
        summaries = [summary for _, summary, _ in results]
        console.print(summary_table(summaries))
        for summary in summaries:
            for remark in summary.remarks:
                console.print(f"{summary.name}: {remark}", highlight=False, markup=False, soft_wrap=True)
        _advise(summaries)
        write_page(results, self.output, "Registration")
        if self.json is not None:
            write_figures(self.json, [summary.as_json() for summary in summaries], force=self.force)
        console.print(f"fixes, summary.json and pictures: {self.output}", highlight=False, markup=False, soft_wrap=True)
        console.print(
            f"report: {(self.output / 'report.html').resolve()}", highlight=False, markup=False, soft_wrap=True
        )
        return 0

    def _register_folder(self, options: "RegisterOptions") -> int:
        """By worker processes into one folder; the table over all that it holds. Returns the exit status."""
        from lgprjax.batch.folder import Workforce, register_folder
        from lgprjax.report.registered_folder import facts_of, write_views

        if self.workers is None and self.scheduler is None:
            raise UsageError("--threads: needs --workers or --scheduler as well")
        workforce, folder = Workforce(self.workers, self.threads, self.scheduler), self.output
        with (
            register_folder(
                self.map, self.drives, folder, options, workforce, force=self.force, bars=progress_bar
            ) as done,
            working("drawing"),
        ):
            sums = write_views(done.run)
        for error in done.failed:
            print(f"lgprjax: {error}", file=sys.stderr)
        table = Table("quantity", "value", title="All drives of the folder")
        for quantity, value in facts_of(sums):
            table.add_row(quantity, value)
        console.print(table)
        for line in (
            f"{len(self.drives)} drives: {done.registered} registered now, {done.kept} up to date, "
            f"{len(done.failed)} failed",
            f"fixes, archive.csv and the records of all jobs: {folder}",
            f"page: {(folder / 'archive.html').resolve()}",
        ):
            console.print(line, highlight=False, markup=False, soft_wrap=True)
        if self.json is not None:
            write_figures(self.json, sums._asdict(), force=self.force)
        return BAD_INPUT if done.failed else 0


def register_all(
    map_path: Path,
    drives: Sequence[Path],
    folder: Path,
    options: "RegisterOptions",
    *,
    force: bool,
    impostors: Sequence[str] = (),
) -> "list[Registered]":
    """Register drives one after the other; fixes and pictures go to ``folder``.

    All refusals happen before the first drive is processed.

    Args:
        impostors: names of drives known to be on other ground.
    """
    from lgprjax.batch import check_region, recording_of, register_log, track_of_drive, write_registered
    from lgprjax.batch.recording import gnss_gaps
    from lgprjax.formats import DriveLog, MapFile
    from lgprjax.report import drive_section
    from lgprjax.report.registered import draw_drive, drive_result, earlier_summaries, summarise_search

    names = [path.name.removesuffix(".drive.h5") for path in drives]
    for name in names:
        if names.count(name) > 1:
            raise InputError(
                name, "drives", "drives of different names, by which their fixes are named", "this name twice"
            )
    # Every input is opened once before any is processed: a broken last drive must not waste the work on the first.
    with MapFile.open(map_path) as source:
        check_region(options.search_m, source)
        for path in drives:
            with DriveLog.open(path) as log:
                recording_of(log).operator(source.description.settings, len(source.description.gain))
                track_of_drive(log, source.description.frame)
    _claim(folder, names, force)
    results: list[Registered] = []
    with MapFile.open(map_path) as source:
        held = hold_ground(source, options)
        for path in drives:
            with DriveLog.open(path) as log:
                with progress_bar(f"registering {path.name}", log.scans) as progress:
                    drive = register_log(source, log, options, progress, held=held)
                write_registered(drive, source, log, options, folder, force)
                impostor = drive.name in impostors
                result = drive_result(drive, source, impostor=impostor, gnss_gap=gnss_gaps(log))
                with working(f"drawing {path.name}"):
                    figures = draw_drive(result, drive, source, log, options, folder, force)
                summary = summarise_search(result, options)
                results.append((result, summary, drive_section(summary, figures)))
    summaries = [*earlier_summaries(folder, names), *(summary for _, summary, _ in results)]
    write_figures(folder / "summary.json", [summary.as_json() for summary in summaries], force=True)
    return results


def _options_of_run(drives: Sequence[Path], given: "RegisterOptions") -> "RegisterOptions":
    """The options that the runs were searched with on board; those given, for drives of which none is known."""
    from lgprjax.batch import options_on_board
    from lgprjax.formats import DriveLog
    from lgprjax.registration import RegisterOptions

    known = []
    for drive in drives:
        with DriveLog.open(drive) as log:
            known.append(options_on_board(log))
    if all(options is None for options in known):
        return given
    for drive, options in zip(drives, known, strict=True):
        if options is None or options != known[0]:
            raise UsageError(f"--track: expected runs of one search, found another in {drive}")
    if given != RegisterOptions(track=True):
        raise UsageError("--track: expected no other options of the search: a run is searched by its own")
    assert known[0] is not None
    return known[0]


def _advise(summaries: "Sequence[DriveSummary]") -> None:
    """Advice if hardly a scan was located, from the most frequent code."""
    from lgprjax.report import main_decline

    for summary in summaries:
        why = main_decline(summary)
        if why is not None and (summary.ok_fraction or 0.0) < _FEW:
            code, (meaning, action) = why
            advice = f"few scans of {summary.name} are ok, most are {code}: {meaning}. Advice: {action}"
            console.print(advice, highlight=False, soft_wrap=True)


def _claim(folder: Path, names: Sequence[str], force: bool) -> None:
    """Check outputs before any work. Other drives' results in the folder stay: page and summary cover them, too."""
    from lgprjax.report.html import PAGE
    from lgprjax.report.registered import ENDS, earlier_summaries

    if folder.exists() and not folder.is_dir():
        raise InputError(folder, "output", "a folder", "a file")
    ends = (".fixes.csv", ".fixes.h5", PAGE, *ENDS)
    outputs = [f"{name}{end}" for name in names for end in ends]
    for output in outputs:
        if (folder / output).exists() and not force:
            raise InputError(folder / output, "output", "a new file, or --force", "one that exists")
    earlier_summaries(folder, names)
    make_folder(folder)
