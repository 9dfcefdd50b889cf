"""``lgprjax register``: drives against a map; fixes, summary and pictures."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import numpy as np
from tyro.conf import Positional, arg

from lgprjax.cli.errors import require_files
from lgprjax.cli.progress import console, progress_bar, working
from lgprjax.cli.search_options import check_region, check_search
from lgprjax.errors import InputError

if TYPE_CHECKING:
    from lgprjax.archive import FixExample, RegisteredDrive
    from lgprjax.formats import DriveLog, MapFile
    from lgprjax.registration import RegisterOptions
    from lgprjax.report import (
        CorrelationSurface,
        DriveResult,
        DriveSummary,
        MatchExample,
        ReportFigure,
        Section,
    )


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
    json: Path | None = None
    """also write the figures to this file"""
    force: bool = False
    """replace outputs that exist"""

    def run(self) -> None:
        """Register."""
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
        results = register_all(self.map, self.drives, self.output, options, force=self.force)
        summaries = [summary for _, summary, _ in results]
        console.print(summary_table(summaries))
        write_page(results, self.output, "Registration", force=self.force, options=options)
        if self.json is not None:
            write_figures(self.json, [summary.as_json() for summary in summaries], force=self.force)
        console.print(f"fixes, summary.json and pictures: {self.output}", highlight=False, markup=False, soft_wrap=True)
        console.print(
            f"report: {(self.output / 'report.html').resolve()}", highlight=False, markup=False, soft_wrap=True
        )


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
                result = drive_result(drive, source, impostor=drive.name in impostors)
                with working(f"drawing {path.name}"):
                    figures = _draw(result, drive, source, log, options, folder, force)
                summary = summarise(result)
                results.append((result, summary, drive_section(result, summary, figures)))
    write_figures(folder / "summary.json", [summary.as_json() for _, summary, _ in results], force=force)
    return results


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


def drive_result(drive: "RegisteredDrive", source: "MapFile", *, impostor: bool) -> "DriveResult":
    """The registered drive as the record that pictures are made from."""
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
        truth_east_m=None if truth is None else truth[:, 0],
        truth_north_m=None if truth is None else truth[:, 1],
        truth_yaw_rad=None if truth is None else truth[:, 3],
        correlation_at_truth=None if truth is None else drive.correlation_at_truth,
        baseline_tracks=tuple(source.pose[source.drive == number, :2] for number in numbers),
        impostor=impostor,
    )


def _draw(
    result: "DriveResult",
    drive: "RegisteredDrive",
    source: "MapFile",
    log: "DriveLog",
    options: "RegisterOptions",
    folder: Path,
    force: bool,
) -> list["ReportFigure"]:
    from lgprjax.archive import example_scan, fix_example
    from lgprjax.report import ReportFigure, draw_match, draw_surface, draw_trajectory

    figures = []
    trajectory = folder / f"{drive.name}-trajectory.png"
    draw_trajectory(result, trajectory, force=force)
    figures.append(ReportFigure(trajectory, "Trajectory and errors along the drive.", "plan view above error curves"))
    scan = example_scan(drive)
    example = None if scan is None else fix_example(source, log, drive, options, scan)
    if example is None:
        return figures
    match, surface = folder / f"{drive.name}-match.png", folder / f"{drive.name}-map.png"
    draw_match(_match(example, drive, options), match, force=force)
    draw_surface(_surface(example, options), surface, force=force)
    code = drive.table["code"].iloc[example.scan]
    figures.append(
        ReportFigure(match, f"Scan {example.scan}, {code}: the ground live and in the map.", "radargram strips")
    )
    figures.append(
        ReportFigure(surface, f"Scan {example.scan}, {code}: match over the search region.", "correlation map")
    )
    return figures


def _match(example: "FixExample", drive: "RegisteredDrive", options: "RegisterOptions") -> "MatchExample":
    from lgprjax.report import MatchExample

    strips, row = example.strips, drive.table.iloc[example.scan]
    distance = strips.distance_m - drive.track.travel_m[0]
    window = (distance[-1] - options.window_m, distance[-1]) if options.window_m else None
    return MatchExample(
        baseline=strips.baseline,
        live=strips.live,
        beside=strips.beside,
        beside_m=strips.beside_m,
        distance_m=distance,
        time_ns=strips.time_ns,
        channel=strips.channel,
        correlation=float(row["correlation"]),
        margin=float(row["margin"]),
        gain="depth gain of the map, limited to 2.5 RMS of the scan",
        lag_m=strips.lag_m,
        window_m=window,
    )


def _surface(example: "FixExample", options: "RegisterOptions") -> "CorrelationSurface":
    from lgprjax.report import CorrelationSurface

    def pair(place: "np.ndarray | None") -> tuple[float, float] | None:
        return None if place is None else (float(place[0]), float(place[1]))

    prior, best = pair(example.prior_m), pair(example.best_m)
    assert prior is not None
    assert best is not None
    return CorrelationSurface(
        x_m=example.surface.along_m,
        y_m=example.surface.cross_m,
        correlation=example.surface.strength,
        half_width_m=(options.search_m, options.search_m),
        prior=prior,
        prior_sigma_m=example.prior_sigma_m,
        best=best,
        second=None,
        truth=pair(example.truth_m),
        origin="the tile's frame on the route",
        axes=("along", "cross"),
    )


def _claim(folder: Path, names: Sequence[str], force: bool) -> None:
    """Refuse before any work what would be refused after it."""
    if folder.exists() and not folder.is_dir():
        raise InputError(folder, "output", "a folder", "a file")
    ends = (".fixes.csv", ".fixes.h5", "-trajectory.png", "-match.png", "-map.png")
    outputs = [f"{name}{end}" for name in names for end in ends]
    for output in [*outputs, "codes.png", "summary.json", "report.html"]:
        if (folder / output).exists() and not force:
            raise InputError(folder / output, "output", "a new file, or --force", "the file exists")
