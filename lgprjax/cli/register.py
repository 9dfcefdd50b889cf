"""``lgprjax register``: drives against a map; fixes, summary and pictures."""

from collections.abc import Mapping, Sequence
from contextlib import nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import numpy as np
from tyro.conf import Positional, arg

from lgprjax.cli.drive_pictures import ENDS, draw_drive
from lgprjax.cli.maps import UNSTATED
from lgprjax.cli.terminal import UsageError, console, progress_bar, require_files, working
from lgprjax.errors import InputError

if TYPE_CHECKING:
    from lgprjax.batch import HeldGround, RegisteredDrive
    from lgprjax.formats import MapFile
    from lgprjax.registration import RegisterOptions
    from lgprjax.report import DriveResult, DriveSummary, Section


# Options of a search that several verbs share: checked in one place, told in the same words.

_MOST_POINTS = 400
"""Of the search lattice to a side; memory and time grow with the square."""


def check_search(search_m: float | None, window_m: float | None, time_scale: float | str, risk: float) -> None:
    """Raise ``UsageError`` on a length, a scale or a risk that no search can have."""
    for name, value, least in (("--search-m", search_m, 1e-3), ("--window-m", window_m, 0.0)):
        if value is not None and not (np.isfinite(value) and least <= value <= 1e4):
            raise UsageError(f"{name}: expected a length in metres, found {value:g}")
    if not isinstance(time_scale, str) and not 0.5 <= time_scale <= 2.0:
        raise UsageError(f"--time-scale: expected auto or 0.5 to 2, found {time_scale:g}")
    if not 1e-9 <= risk <= 0.01:
        raise UsageError(f"--risk: expected a probability of 1e-9 to 0.01, found {risk:g}")


def check_region(search_m: float | None, source: "MapFile") -> None:
    """Raise ``UsageError`` on a region no wider than a match itself, which leaves no room for rivals that a fix is
    measured by, and on one whose lattice does not fit into memory."""
    from lgprjax.batch import lattice_points

    if search_m is None:
        return
    least_m = 0.9 * source.description.settings.wavelength_m
    if search_m < least_m:
        raise UsageError(f"--search-m: expected {least_m:.2g} or more on this map, found {search_m:g}")
    points = lattice_points(source, search_m)
    if points > _MOST_POINTS:
        most_m = search_m * _MOST_POINTS / points
        expected = f"at most about {most_m:.2g} on this map, {_MOST_POINTS} lattice points to a side"
        raise UsageError(f"--search-m: expected {expected}, found {search_m:g}, {points} points")


def hold_ground(source: "MapFile", options: "RegisterOptions") -> "HeldGround":
    """The map's ground for a search; says so where its noise floor has to be measured first."""
    from lgprjax.batch import HeldGround
    from lgprjax.mapping import MEASURING

    with working(MEASURING) if source.chance is None else nullcontext():
        return HeldGround(source, options)


def search_in_words(settings: Mapping[str, object]) -> str:
    """The search that drives were registered with, for a page: a line from the settings (``settings_of``)."""
    from lgprjax.registration import LADDER_M, PIECE_M

    search_m, window_m, scale = settings["search_m"], settings["window_m"], settings["time_scale"]
    lengths = ", ".join(f"{length:g}" for length in LADDER_M[1:])
    region = "within what the log states of its own position (2.5 m where it states nothing)"
    windows = f"the shortest window that reaches the risk, of a single scan, {lengths} m"
    parts = [
        f"Search: {region if search_m is None else f'{search_m:g} m to each side of the prior'}",
        windows if window_m is None else f"windows of {window_m:g} m" if window_m else "single scans",
        "time scale found along the drive" if scale is None else f"time scale {scale:g}",
    ]
    # Records of an older version in the same folder know of no risk.
    risk = settings.get("risk")
    judged = "fixed thresholds" if risk is None else f"risk {risk:g} in each {PIECE_M:g} m of travel"
    return "; ".join([*parts, "thresholds of one's own drives" if settings["own_thresholds"] else judged]) + "."


_FEW = 0.1
_LONE = (
    "one channel on a map of one channel: fixes tell where along the line the drive is. The ground beside the line "
    "resembles that on it, so that across it they only say that the drive is near, and the cross-track sigma is a bound"
)
_USUAL_SCALE = 0.01
"""A time scale farther from 1 is worth a remark."""


@dataclass(frozen=True)
class Register:
    """Locate drives by the ground beneath them: fixes, summary and pictures."""

    map: Annotated[Positional[Path], arg(metavar="MAP", help="subsurface database, M.map.h5")]
    drives: Annotated[Positional[tuple[Path, ...]], arg(metavar="DRIVE...", help="drive logs, X.drive.h5")]
    output: Annotated[Path, arg(aliases=["-o"], help="folder for DRIVE.fixes.csv, summary, pictures, report.html")]
    search_m: float | None = None
    """search this far to each side of the position in the log, in metres; by default as far as the log says that its
    position may be wrong (4 sigma and 0.5 m), or 2.5 m where it says nothing, and farther where no place is found"""
    window_m: float | None = None
    """match this length of travel as one, 0 for single scans; by default as little of 0, 1, 2, 4 and 8 m as reaches the
    risk, scan by scan"""
    time_scale: float | Literal["auto"] = "auto"
    """two-way travel time in the ground today, relative to the map's day (wet ground: above 1, after rain about 1.05);
    auto finds it along the drive"""
    risk: float = 1e-4
    """accept a fix if other ground would have matched as well with no higher probability, in each 4 m of travel"""
    thresholds: Path | None = None
    """judge by thresholds from lgprjax thresholds, found with the same --window-m, instead of the map's noise floor
    and the risk"""
    workers: int | None = None
    """register with this many processes, all results in one folder with one table and page (no pictures of each drive);
    what is there already is not done again"""
    threads: int | None = None
    """limit of each process; with equal threads the fixes are the same to the bit"""
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
        check_search(self.search_m, self.window_m, self.time_scale, self.risk)
        if self.thresholds is not None and self.window_m is None:
            raise UsageError("--thresholds: expected --window-m beside it, the length that they were found for")
        if self.json is not None and self.json.exists() and not self.force:
            raise InputError(self.json, "output", "a new file, or --force", "the file exists")
        own = None if self.thresholds is None else read_thresholds(self.thresholds, self.window_m or 0.0)
        options = RegisterOptions(
            search_m=self.search_m,
            window_m=self.window_m,
            time_scale=None if self.time_scale == "auto" else self.time_scale,
            risk=self.risk,
            own_thresholds=None if own is None else Thresholds(**own),
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
        for summary in summaries:
            for remark in summary.remarks:
                console.print(f"{summary.name}: {remark}", highlight=False, markup=False, soft_wrap=True)
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
    from lgprjax.batch import recording_of, register_log, track_of_drive, write_registered
    from lgprjax.batch.recording import gnss_gaps
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
                summary = summarise(result)
                results.append((result, summary, drive_section(result, summary, figures)))
    write_figures(folder / "summary.json", [summary.as_json() for _, summary, _ in results], force=force)
    return results


def _advise(summaries: "Sequence[DriveSummary]") -> None:
    """What to do where hardly a scan was located, by what most of them were declined for."""
    from lgprjax.report import main_decline

    for summary in summaries:
        why = main_decline(summary)
        if why is not None and (summary.ok_fraction or 0.0) < _FEW:
            code, (meaning, action) = why
            told = f"few scans of {summary.name} are ok, most are {code}: {meaning}. To do: {action}"
            console.print(told, highlight=False, soft_wrap=True)


def write_page(
    results: Sequence[Registered], folder: Path, title: str, *, force: bool, options: "RegisterOptions", intro: str = ""
) -> Path:
    """Write ``report.html``: overview, codes of all drives, a section each."""
    from lgprjax.batch import settings_of
    from lgprjax.report import ReportFigure, Section, declines_table, draw_codes, overview_table, write_report

    codes = folder / "codes.png"
    draw_codes(
        [result for result, _, _ in results],
        codes,
        risk=options.risk,
        force=force,
    )
    figure = ReportFigure(
        codes,
        "Evidence of all tried scans with the risk that a fix must keep to, margin over the runner-up, and the codes "
        "given. A decade of evidence is a tenth of the probability that other ground matches as well.",
        "histograms of evidence and margin, bar of codes, one row a drive",
    )
    summaries = [summary for _, summary, _ in results]
    tables = [table for table in (overview_table(summaries), declines_table(summaries)) if table is not None]
    overview = Section("All drives", "", tuple(tables), (figure,))
    page = folder / "report.html"
    search = search_in_words(settings_of(options))
    write_report(page, title, f"{intro}\n\n{search}", [overview, *(s for _, _, s in results)], force)
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
        # Without a runner-up the lead is over the least possible score, and tells nothing.
        margin=np.where(np.asarray(drive.fix.runner_up) > -1.0, table["margin"].to_numpy(), np.nan),
        p_false=np.asarray(drive.fix.p_false),
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
        remarks=_remarks(drive, source),
        place_assumed=drive.place_assumed,
    )


def _remarks(drive: "RegisteredDrive", source: "MapFile") -> tuple[str, ...]:
    """What a reader of the fixes must know beside them."""
    labels = None if any(source.description.label_sigma_m) else f"labels: {UNSTATED}"
    lines = (labels, drive.alignment.told, drive.jumps, _windows(drive), _time_scales(drive), *_unknowns(drive, source))
    return tuple(line for line in lines if line is not None)


def _unknowns(drive: "RegisteredDrive", source: "MapFile") -> tuple[str | None, ...]:
    """What is not there to be known: what was made up at import, a map that is elsewhere, ground beside a line."""
    from lgprjax.formats import assumed_in_words

    assumed = f"assumed in this drive: {assumed_in_words(drive.assumed)}" if drive.assumed else None
    lone = drive.channels == 1 and source.description.channels == 1 and drive.away is None
    return assumed, drive.away, _LONE if lone else None


def _windows(drive: "RegisteredDrive") -> str | None:
    """How much travel the ok fixes needed."""
    window_m = np.asarray(drive.fix.window_m)[drive.table["code"].to_numpy() == "ok"]
    if not len(window_m):
        return None
    lengths, counts = np.unique(window_m, return_counts=True)
    named = ["single scans" if length == 0.0 else f"{length:g} m" for length in lengths]
    shares = [f"{name} {100.0 * count / len(window_m):.0f} %" for name, count in zip(named, counts, strict=True)]
    return f"windows of the ok fixes: {', '.join(shares)}"


def _time_scales(drive: "RegisteredDrive") -> str | None:
    """The time scales of the drive, where they are not those of the map's day."""
    scale = drive.time_scale[drive.table["code"].to_numpy() == "ok"]
    if not len(scale) or np.max(np.abs(scale - 1.0)) < _USUAL_SCALE:
        return None
    return f"time scale of the ok fixes: {scale.min():.3f} to {scale.max():.3f}, median {np.median(scale):.3f}"


def _claim(folder: Path, names: Sequence[str], force: bool) -> None:
    """Refuse before any work what would be refused after it."""
    if folder.exists() and not folder.is_dir():
        raise InputError(folder, "output", "a folder", "a file")
    ends = (".fixes.csv", ".fixes.h5", *ENDS)
    outputs = [f"{name}{end}" for name in names for end in ends]
    for output in [*outputs, "codes.png", "summary.json", "report.html"]:
        if (folder / output).exists() and not force:
            raise InputError(folder / output, "output", "a new file, or --force", "the file exists")
