"""``lgprjax register``: drives against a map; fixes, summary and pictures."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import numpy as np
from tyro.conf import Positional, arg

from lgprjax.cli.drive_pictures import ENDS, draw_drive
from lgprjax.cli.errors import require_files
from lgprjax.cli.progress import console, progress_bar, working
from lgprjax.cli.search_options import check_region, check_search
from lgprjax.errors import InputError

if TYPE_CHECKING:
    from lgprjax.archive import RegisteredDrive
    from lgprjax.formats import MapFile
    from lgprjax.registration import RegisterOptions
    from lgprjax.report import (
        DriveResult,
        DriveSummary,
        Section,
    )

_FEW = 0.1


@dataclass(frozen=True)
class Register:
    """Locate drives by the ground beneath them: fixes, summary and pictures."""

    map: Annotated[Positional[Path], arg(metavar="MAP", help="subsurface database, M.map.h5")]
    drives: Annotated[Positional[tuple[Path, ...]], arg(metavar="DRIVE...", help="drive logs, X.drive.h5")]
    output: Annotated[Path, arg(aliases=["-o"], help="folder for DRIVE.fixes.csv, summary, pictures, report.html")]
    search_m: float = 1.5
    """half side of the search square about the position that GNSS/INS gives"""
    window_m: float = 0.0
    """match windows of this length instead of single scans"""
    time_scale: float | Literal["auto"] = 1.0
    """how much longer the wave's way in the ground takes today than on the map's day (after rain about 1.05);
    auto finds it along the drive"""
    thresholds: Path | None = None
    """what a fix must reach, from lgprjax thresholds with the same --window-m; without it the defaults"""
    track: bool = False
    """each search starts from the last fix carried on by odometry; its region follows the correlation"""
    workers: int | None = None
    """register by so many processes, all results in one folder with one table and page (no pictures of each drive);
    what is there already is not done again"""
    threads: int | None = None
    """that each worker is held to; with equal threads the fixes are the same to the bit"""
    scheduler: str | None = None
    """the same on a cluster: address of a dask scheduler, tcp://HOST:8786"""
    json: Path | None = None
    """also write the figures to this file"""
    force: bool = False
    """replace outputs that exist"""

    def run(self) -> int:
        """Register; the exit status."""
        from lgprjax.cli.figures import write_figures
        from lgprjax.formats import read_thresholds
        from lgprjax.registration import RegisterOptions, Thresholds
        from lgprjax.report import summary_table

        require_files(self.drives, "drives")
        check_search(self.search_m, self.window_m, self.time_scale)
        if self.json is not None and self.json.exists() and not self.force:
            raise InputError(self.json, "output", "a new file, or --force", "the file exists")
        held = None if self.thresholds is None else read_thresholds(self.thresholds, self.window_m)
        options = RegisterOptions(
            search_m=self.search_m,
            window_m=self.window_m,
            time_scale=None if self.time_scale == "auto" else self.time_scale,
            own_thresholds=None if held is None else Thresholds(**held),
            track=self.track,
        )
        if (self.workers, self.threads, self.scheduler) != (None, None, None):
            from lgprjax.cli.register_many import Workforce, register_many

            workforce = Workforce(self.workers, self.threads, self.scheduler)
            return register_many(
                self.map, self.drives, self.output, options, workforce, json=self.json, force=self.force
            )
        results = register_all(self.map, self.drives, self.output, options, force=self.force)
        summaries = [summary for _, summary, _ in results]
        console.print(summary_table(summaries))
        _advise(summaries)
        write_page(results, self.output, "Registration", force=self.force, options=options)
        if self.json is not None:
            write_figures(self.json, [summary.as_json() for summary in summaries], force=self.force)
        console.print(f"fixes, summary.json and pictures: {self.output}", highlight=False, markup=False, soft_wrap=True)
        console.print(
            f"report: {(self.output / 'report.html').resolve()}", highlight=False, markup=False, soft_wrap=True
        )
        return 0


Registered = tuple["DriveResult", "DriveSummary", "Section"]


def register_all(
    map_path: Path,
    drives: Sequence[Path],
    folder: Path,
    options: "RegisterOptions",
    *,
    force: bool,
    impostors: Sequence[str] = (),
) -> list[Registered]:
    """Register drives one after the other; fixes and pictures go to ``folder``.

    Everything that can be refused is refused before the first drive is worked on.

    Args:
        impostors: names of drives that are known to lie on other ground.
    """
    from lgprjax.archive import passes_over, recording_of, register_log, track_of_drive, write_registered
    from lgprjax.archive.tracks import gnss_gaps
    from lgprjax.cli.figures import write_figures
    from lgprjax.formats import DriveLog, MapFile
    from lgprjax.report import drive_section, summarise

    names = [path.name.removesuffix(".drive.h5") for path in drives]
    for name in names:
        if names.count(name) > 1:
            raise InputError(name, "drives", "drives of different names", "this name twice")
    _claim(folder, names, force)
    # Every input is opened once before any is worked on: a broken last drive must not cost the first.
    with MapFile.open(map_path) as source:
        check_region(options.search_m, source)
        for path in drives:
            with DriveLog.open(path) as log:
                recording_of(log).operator(source.description.settings, len(source.description.gain))
                track_of_drive(log, source.description.frame)
    folder.mkdir(parents=True, exist_ok=True)
    results: list[Registered] = []
    with MapFile.open(map_path) as source:
        for path in drives:
            with DriveLog.open(path) as log:
                with progress_bar(f"registering {path.name}", log.scans * passes_over(options)) as progress:
                    drive = register_log(source, log, options, progress)
                if drive.rung is not None:
                    _print_rungs(drive.name, drive.rung)
                write_registered(drive, source, log, options, folder, force)
                impostor = drive.name in impostors
                result = drive_result(drive, source, impostor=impostor, gnss_gap=gnss_gaps(log))
                with working(f"drawing {path.name}"):
                    figures = draw_drive(result, drive, source, log, options, folder, force)
                summary = summarise(result)
                results.append((result, summary, drive_section(result, summary, figures)))
    write_figures(folder / "summary.json", [summary.as_json() for _, summary, _ in results], force=force)
    return results


def _advise(summaries: "Sequence[DriveSummary]") -> None:
    """What to look at where hardly a scan was located."""
    few = [summary.name for summary in summaries if (summary.ok_fraction or 0.0) < _FEW]
    if few:
        told = (
            f"few scans of {', '.join(few)} are ok: is it the map's ground, and --search-m no smaller than GNSS may be "
            "wrong? Windows find more (--window-m 2); lgprjax check --health looks at the drive"
        )
        console.print(told, highlight=False, soft_wrap=True)


def _print_rungs(name: str, rung: np.ndarray) -> None:
    """How many scans of a tracked drive were searched on which rung."""
    from lgprjax.registration import LADDER

    counts = ", ".join(f"{step.name} {np.sum(rung == number)}" for number, step in enumerate(LADDER))
    console.print(f"{name}, scans on each rung: {counts}", highlight=False, markup=False, soft_wrap=True)


def write_page(
    results: Sequence[Registered], folder: Path, title: str, *, force: bool, options: "RegisterOptions", intro: str = ""
) -> Path:
    """Write ``report.html``: overview, codes of all drives, a section each."""
    from lgprjax.report import ReportFigure, Section, draw_codes, overview_table, write_report

    codes = folder / "codes.png"
    draw_codes(
        [result for result, _, _ in results],
        codes,
        least_correlation=float(options.thresholds.strength),
        least_margin=float(options.thresholds.margin),
        by_chance=(float(options.thresholds.strength_by_chance), float(options.thresholds.margin_by_chance)),
        force=force,
    )
    figure = ReportFigure(
        codes,
        "Correlation and margin of all tried scans with the thresholds a fix must reach, and the codes given. The "
        "threshold stands where all traces lie on the map; with fewer on it the correlation must be higher.",
        "histograms of correlation and margin, bar of codes, one row a drive",
    )
    tables = (overview_table([summary for _, summary, _ in results]),)
    overview = Section("All drives", "", tables, (figure,))
    page = folder / "report.html"
    search = f"Search: {options.search_m:g} m to each side of the prior; "
    how = f"windows of {options.window_m:g} m." if options.window_m else "single scans."
    write_report(page, title, f"{intro}\n\n{search}{how}", [overview, *(s for _, _, s in results)], force)
    return page


def drive_result(
    drive: "RegisteredDrive", source: "MapFile", *, impostor: bool, gnss_gap: np.ndarray | None = None
) -> "DriveResult":
    """The registered drive as the record that pictures are made from; ``gnss_gap`` tells scans without GNSS."""
    from lgprjax.report import DriveResult

    pose, prior, truth = np.asarray(drive.fix.pose), drive.track.pose, drive.truth
    table, frame = drive.table, source.description.frame
    numbers = range(int(source.drive.max()) + 1)
    return DriveResult(
        name=drive.name,
        map_name=source.description.name,
        origin=(frame.latitude_deg, frame.longitude_deg),
        milliseconds_per_scan=drive.milliseconds_per_scan,
        time_s=table["time_s"].to_numpy(),
        distance_m=drive.track.travel_m - drive.track.travel_m[0],
        east_m=pose[:, 0],
        north_m=pose[:, 1],
        prior_east_m=prior[:, 0],
        prior_north_m=prior[:, 1],
        heading_rad=prior[:, 3],
        sigma_along_m=table["sigma_along_m"].to_numpy(),
        sigma_cross_m=table["sigma_cross_m"].to_numpy(),
        correlation=table["correlation"].to_numpy(),
        margin=table["margin"].to_numpy(),
        code=table["code"].to_numpy().astype(str),
        yaw_rad=pose[:, 3],
        sigma_yaw_rad=np.sqrt(np.asarray(drive.fix.covariance)[:, 3, 3]),
        gnss_gap=gnss_gap,
        truth_east_m=None if truth is None else truth[:, 0],
        truth_north_m=None if truth is None else truth[:, 1],
        truth_yaw_rad=None if truth is None else truth[:, 3],
        correlation_at_truth=None if truth is None else drive.correlation_at_truth,
        baseline_tracks=tuple(source.pose[source.drive == number, :2] for number in numbers),
        impostor=impostor,
    )


def _claim(folder: Path, names: Sequence[str], force: bool) -> None:
    """Refuse before any work what would be refused after it."""
    if folder.exists() and not folder.is_dir():
        raise InputError(folder, "output", "a folder", "a file")
    ends = (".fixes.csv", ".fixes.h5", *ENDS)
    outputs = [f"{name}{end}" for name in names for end in ends]
    for output in [*outputs, "codes.png", "summary.json", "report.html"]:
        if (folder / output).exists() and not force:
            raise InputError(folder / output, "output", "a new file, or --force", "the file exists")
