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
from lgprjax.cli.terminal import (
    BAD_INPUT,
    UsageError,
    console,
    counted,
    progress_bar,
    require_files,
    say,
    verdict,
    working,
)
from lgprjax.errors import InputError
from lgprjax.files import make_folder

if TYPE_CHECKING:
    from lgprjax.batch import HeldGround
    from lgprjax.formats import MapFile
    from lgprjax.registration import RegisterOptions
    from lgprjax.report import DriveSummary
    from lgprjax.report.registered import Registered


def hold_ground(source: "MapFile", options: "RegisterOptions") -> "HeldGround":
    """Map data for a search; shows a spinner if the noise floor has to be measured first."""
    from lgprjax.batch import HeldGround
    from lgprjax.mapping import MEASURING

    with working(MEASURING) if source.chance is None else nullcontext():
        return HeldGround(source, options)


_FEW = 0.1


@dataclass(frozen=True)
class Register:
    """Locate drives on a map by matching their radar scans: fixes, summary, pictures and report."""

    map: Annotated[Positional[Path], arg(metavar="MAP", help="map, M.map.h5")]
    drives: Annotated[Positional[tuple[Path, ...]], arg(metavar="DRIVE...", help="drive logs, X.drive.h5")]
    output: Annotated[
        Path, arg(aliases=["-o"], metavar="DIR", help="folder for DRIVE.fixes.csv, summary, pictures, report.html")
    ]
    search_m: float | None = None
    """half width of the search region around the logged position, in metres; default: 4 sigma plus 0.5 m, with the
    position sigma of the log, or 2.5 m without one; larger where no match is found"""
    window_m: float | None = None
    """length of the matched window of travel, in metres, 0 for single scans; default: for each scan the shortest of 0,
    1, 2, 4 and 8 m that meets the risk"""
    time_scale: float | Literal["auto"] = "auto"
    """ratio of two-way travel time in the ground, this drive to map (above 1 in wetter ground, about 1.05 after rain);
    auto estimates it along the drive"""
    risk: float = 1e-4
    """largest accepted probability of a false fix: probability, per 4 m of travel, that other ground matches as well as
    the fix"""
    search: Literal["exhaustive", "swarm", "filter"] = "exhaustive"
    """exhaustive: every position of the search region; swarm: a particle swarm, an independent check, 4 times slower
    (median of 30 simulated sites); filter: a Bayes filter over the whole drive (experimental)"""
    causal: bool = False
    """with --search filter: each fix from earlier scans alone, as on board"""
    finish: Literal["newton", "swarm"] = "newton"
    """refinement of candidate poses: newton (Gauss-Newton), or swarm (a particle swarm around each candidate, without
    derivatives, slower)"""
    track: bool = False
    """register causally, as on board: each fix uses earlier scans only. For the drive log of a run, use the scans,
    priors and options of the run and reproduce its fixes"""
    thresholds: Path | None = None
    """acceptance thresholds from lgprjax thresholds, calibrated with the same --window-m, in place of noise floor and
    risk"""
    workers: int | None = None
    """number of worker processes; results go to one folder with one table and one page, without pictures per drive;
    results that exist are kept"""
    threads: int | None = None
    """threads per worker; the same number of threads gives bit-identical fixes"""
    scheduler: str | None = None
    """address of a dask scheduler, tcp://HOST:8786, to run the workers on a cluster"""
    json: Path | None = None
    """JSON file for the figures; - for standard output"""
    force: bool = False
    """replace existing outputs of these drives; results of other drives are kept"""

    def run(self) -> int:
        """Register. Returns the exit status."""
        from lgprjax.batch import check_search
        from lgprjax.formats import read_thresholds
        from lgprjax.registration import FINISH_SWARM, SEARCH_SWARM, RegisterOptions, Thresholds
        from lgprjax.report import summary_table
        from lgprjax.report.registered import write_page

        require_files(self.drives, "drives")
        if self.thresholds is not None and self.window_m is None:
            raise UsageError("--thresholds: needs --window-m as well, the window length of the calibration")
        beside = {
            "--window-m": self.window_m is not None,
            "--thresholds": self.thresholds is not None,
            "--finish swarm": self.finish == "swarm",
        }
        if self.search == "filter" and any(beside.values()):
            found = ", ".join(option for option, given in beside.items() if given)
            raise UsageError(f"--search filter: expected no {', '.join(beside)} with it, found {found}")
        if self.causal and self.search != "filter":
            raise UsageError(f"--causal: expected --search filter with it, found --search {self.search}")
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
            filter=None if self.search != "filter" else "causal" if self.causal or self.track else "smoothed",
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
                say(f"{summary.name}: {remark}")
        _advise(summaries)
        write_page(results, self.output, "Registration")
        if self.json is not None:
            write_figures(self.json, [summary.as_json() for summary in summaries], force=self.force)
        say(f"fixes, summary.json and pictures: {self.output}")
        say(f"report: {(self.output / 'report.html').resolve()}")
        shares = (f"{each.name} {100.0 * (each.ok_fraction or 0.0):.1f} % ok" for each in summaries)
        verdict(", ".join(shares), self._following(summaries))
        return 0

    def _following(self, summaries: "Sequence[DriveSummary]") -> str:
        """Words of the next command: the map if hardly a scan was located, else the trajectory of the first drive."""
        if all((each.ok_fraction or 0.0) < _FEW for each in summaries):
            return f"map verify {self.map}"
        name = summaries[0].name
        return f"export {self.drives[0]} --fixes {self.output / name}.fixes.h5 -o {name}.geojson"

    def _register_folder(self, options: "RegisterOptions") -> int:
        """Register by worker processes into one folder; print the table of the folder. Returns the exit status."""
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
        table = Table("quantity", "value", title="all drives of the folder")
        for quantity, value in facts_of(sums):
            table.add_row(quantity, value)
        console.print(table)
        for line in (
            f"{len(self.drives)} drives: {done.registered} registered now, {done.kept} up to date, "
            f"{len(done.failed)} failed",
            f"fixes, archive.csv and job records: {folder}",
            f"page: {(folder / 'archive.html').resolve()}",
        ):
            say(line)
        if self.json is not None:
            write_figures(self.json, sums._asdict(), force=self.force)
        share = f"{100.0 * sums.counts['ok'] / max(sums.tried, 1):.1f} % of {sums.tried} scans ok"
        verdict(f"{counted(sums.drives, 'drive')}, {share}, {len(done.failed)} failed")
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

    All inputs are checked before the first drive is processed.

    Args:
        impostors: names of drives over other ground.
    """
    from lgprjax.batch import check_region, register_log, write_registered
    from lgprjax.formats import DriveLog, MapFile
    from lgprjax.recordings import recording_of, track_of_drive
    from lgprjax.recordings.drives import gnss_gaps
    from lgprjax.report import drive_section
    from lgprjax.report.registered import draw_drive, drive_result, earlier_summaries, summarise_search

    names = [path.name.removesuffix(".drive.h5") for path in drives]
    for name in names:
        if names.count(name) > 1:
            raise InputError(name, "drives", "different drive names: the fixes files use them", "this name twice")
    # All inputs are opened first: a damaged last drive stops the command before any work.
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
    """Search options of the recorded runs; the given options for drives without recorded ones."""
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
            raise UsageError(f"--track: expected runs with the same search options, found others in {drive}")
    if given != RegisterOptions(track=True):
        raise UsageError("--track: expected no other search options: the run defines them")
    assert known[0] is not None
    return known[0]


def _advise(summaries: "Sequence[DriveSummary]") -> None:
    """Print advice for the most frequent code if few scans are ok."""
    from lgprjax.report import main_decline

    for summary in summaries:
        why = main_decline(summary)
        if why is not None and (summary.ok_fraction or 0.0) < _FEW:
            code, (meaning, action) = why
            say(f"few scans of {summary.name} are ok, most are {code}: {meaning}. Advice: {action}")


def _claim(folder: Path, names: Sequence[str], force: bool) -> None:
    """Check outputs before any work. Results of other drives are kept: page and summary include them."""
    from lgprjax.report.html import PAGE
    from lgprjax.report.registered import ENDS, earlier_summaries

    if folder.exists() and not folder.is_dir():
        raise InputError(folder, "output", "a folder", "a file")
    ends = (".fixes.csv", ".fixes.h5", PAGE, *ENDS)
    outputs = [f"{name}{end}" for name in names for end in ends]
    for output in outputs:
        if (folder / output).exists() and not force:
            raise InputError(folder / output, "output", "a new file, or --force", "an existing file")
    earlier_summaries(folder, names)
    make_folder(folder)
