"""``lgprjax check``, ``export``, ``compare`` and ``recover``: validate, convert and compare files, recover runs."""

import json
import shutil
from contextlib import suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from rich.table import Table
from rich.text import Text
from tyro.conf import Positional, arg

from lgprjax.cli.figures import check_outputs, write_figures
from lgprjax.cli.recognised import recording_suffixes
from lgprjax.cli.terminal import (
    UsageError,
    advice,
    console,
    counted,
    progress_bar,
    require_files,
    say,
    verdict,
    working,
)
from lgprjax.errors import InputError
from lgprjax.files import examples_folder

if TYPE_CHECKING:
    from lgprjax.formats import RunSummary
    from lgprjax.formats.schema import Finding
    from lgprjax.recordings import Comparison, DriveHealth, Stretch
    from lgprjax.runtime.config import RuntimeConfig


_VERDICT_STYLE = {"good": "green", "look": "yellow", "bad": "bold red", "not recorded": "dim"}
_NOTHING = "–"
_CHECKED_BY = {
    ".run.toml": "lgprjax run {} --preflight checks the configuration of a run",
    ".lgprun": "lgprjax events and lgprjax recover read the folder of a run",
    ".toml": "lgprjax simulate {0} -o DIR checks a site file, lgprjax tune {0} -o DIR a study",
    ".geojson": "lgprjax cover plan {} -o X.cover.geojson --vehicle V.vehicle.toml checks a field",
    **dict.fromkeys(recording_suffixes().split(", "), "import it first: lgprjax import {} -o X.drive.h5"),
}
"""Commands that check other file types, by suffix."""
_STRETCHES = 3  # listed in the table; all of them are in the JSON


@dataclass(frozen=True)
class CheckVerb:
    """Validate files against the data schema; list every violation with its place."""

    files: Annotated[
        Positional[tuple[Path, ...]],
        arg(
            metavar="FILE...",
            help=".drive.h5, .map.h5, .fixes.h5, .fixes.csv, .route.toml, .vehicle.toml, .cover.geojson, .worked.h5, "
            ".radar.h5; other HDF5 files by their schema attribute",
        ),
    ]
    health: bool = False
    """also measure the recording quality of drive logs: radar, clock, odometry, GNSS"""
    json: Path | None = None
    """JSON file for the findings, with --health also for the figures; - for standard output"""
    force: bool = False
    """replace existing outputs"""

    def run(self) -> int:
        """Check; status 1 if a file has errors."""
        from lgprjax.formats import check_file

        require_files(self.files, "files")
        check_outputs(self.json, force=self.force)
        others = [path.name for path in self.files if not path.name.lower().endswith(".drive.h5")]
        if self.health and others:
            raise UsageError(f"--health: expected drive logs, X.drive.h5, found {others[0]}")
        findings, reports = [], []
        for path in self.files:
            try:
                with working(f"checking {path}"):
                    found = check_file(path)
            except InputError as error:
                if path.is_dir() or not path.exists():
                    raise InputError(path, "file", "a file", "a folder" if path.is_dir() else "none") from None
                verb = next((words for end, words in _CHECKED_BY.items() if path.name.lower().endswith(end)), "")
                elsewhere = f"; {verb.format(path)}" if verb else ""
                raise InputError(path, error.place, error.expected, f"{error.found}{elsewhere}") from None
            findings += found
            for finding in found:
                say(f"{finding}{advice(finding.error())}")
            if not found:
                say(f"{path}: ok")
            whole = not any(finding.severity == "error" for finding in found)
            if whole and path.name.lower().endswith(".drive.h5"):
                _tell_assumed(path)
            if self.health and whole:
                reports.append({"file": str(path), **_measure(path).as_json()})
        if self.json is not None:
            plain = [asdict(finding) for finding in findings]
            figures: object = {"findings": plain, "health": reports} if self.health else plain
            write_figures(self.json, figures, force=self.force)
        return self._conclude(findings, reports)

    def _conclude(self, findings: "list[Finding]", reports: list[dict[str, Any]]) -> int:
        """Print the verdict over all files; the exit status."""
        wrong = sorted({finding.file for finding in findings if finding.severity == "error"})
        warnings = sum(finding.severity != "error" for finding in findings)
        text = f"{counted(len(self.files), 'file')}, {len(wrong)} with errors"
        text += f", {counted(warnings, 'warning')}" if warnings else ""
        if self.health:
            text += "".join(f"; {each['file']}: {_HEALTH[each['verdict']]}" for each in reports)
        drives = [str(path) for path in self.files if path.name.lower().endswith(".drive.h5")]
        following = ""
        if drives and not wrong:
            following = f"map build {drives[0]} -o M.map.h5" if self.health else f"check {drives[0]} --health"
        verdict(text, following)
        return int(bool(wrong))


_HEALTH = {"good": "recording good", "look": "inspect the recording", "bad": "recording bad"} | {
    "not recorded": "nothing to judge"
}


def _tell_assumed(path: Path) -> None:
    """Print the quantities of a drive that no instrument recorded."""
    from lgprjax.formats import VehicleLog, assumed_in_words, assumed_of

    assumed = assumed_of(VehicleLog.open(path).provenance)
    if assumed:
        message = f"{path}: assumed, not recorded: {assumed_in_words(assumed)}"
        say(message)


def _measure(path: Path) -> "DriveHealth":
    from lgprjax.formats import DriveLog, VehicleLog
    from lgprjax.recordings import drive_health, has_radar, vehicle_health

    if has_radar(path):
        with DriveLog.open(path) as log, progress_bar(f"measuring {path.name}", log.scans) as progress:
            health = drive_health(log, progress)
        recorded = f"{health.scans} scans of {health.channels} channels"
    else:
        health, recorded = vehicle_health(VehicleLog.open(path)), "no radar"
    title = f"{path.name}: {recorded}, {health.travel_m:.1f} m"
    table = Table("quantity", "value", "look / bad at", "verdict", "where", title=title)
    table.columns[0].no_wrap = True
    for entry in health.figures:
        value, limits = _NOTHING, _NOTHING
        if entry.verdict != "not recorded":
            value = f"{0.0 if abs(entry.value) < 1e-6 else entry.value:.3g} {entry.unit}".strip()
            limits = f"{entry.look:g} / {entry.bad:g}"
        judged = Text(entry.verdict, _VERDICT_STYLE[entry.verdict])
        table.add_row(entry.name, value, limits, judged, _where(entry.where))
    console.print(table)
    for entry in health.figures:
        if entry.verdict != "good":
            console.print(f"{entry.verdict}: {entry.name}: {entry.meaning}", highlight=False, markup=False)
    for name, why in health.not_measured:
        console.print(f"not measured: {name}: {why}", highlight=False, markup=False, style="dim")
    skipped = f"; not recorded, skipped: {', '.join(health.assumed)}" if health.assumed else ""
    say(f"{path}: {_HEALTH[health.verdict]}{skipped}")
    return health


def _where(stretches: "tuple[Stretch, ...]") -> str:
    """The first sections in metres of travel, with channels."""
    parts = []
    for stretch in stretches[:_STRETCHES]:
        channel = "" if stretch.channel is None else f"channel {stretch.channel}: "
        parts.append(f"{channel}{stretch.start_m:.1f}-{stretch.stop_m:.1f} m")
    more = len(stretches) - _STRETCHES
    return ", ".join(parts) + (f", {more} more" if more > 0 else "")


# ``lgprjax export``: drives and fixes for other programs.


@dataclass(frozen=True)
class Export:
    """Write a drive as ROS messages, or its trajectory for evo or GIS.

    Messages: .mcap for ROS 2 and Foxglove (needs: pip install lgprjax[log]), .bag for ROS 1 and .db3 for ROS 2 in a
    folder (need: pip install lgprjax[rosbag]). They contain scans, the middle channel as a radargram (Image), GNSS/INS
    (NavSatFix, Imu), odometry (Odometry), ok fixes (PoseWithCovarianceStamped in the map frame, NavSatFix) and
    transforms of the vehicle from the fixes, or from GNSS/INS without fixes. lgprjax import reads them.

    Trajectory of the array centre: from the ok fixes (--fixes), the true poses (--truth) or the recorded navigation.
    .tum and .kitti (evo) are in metres east, north and up from the first recorded position of the drive. .geojson
    (with code, correlation and sigmas per scan) and .kml are in WGS-84.
    """

    drive: Annotated[Positional[Path], arg(metavar="DRIVE", help="drive log, X.drive.h5")]
    output: Annotated[
        Path,
        arg(
            aliases=["-o"],
            metavar="X.SUFFIX",
            help="file to write: .mcap, .bag, .tum, .kitti, .geojson or .kml; folder to write: .db3",
        ),
    ]
    fixes: Annotated[Path | None, arg(metavar="X.fixes.h5")] = None
    """fixes of this drive, from lgprjax register"""
    truth: bool = False
    """export the true poses of a simulated drive as the trajectory"""
    force: bool = False
    """replace existing outputs"""

    def run(self) -> None:
        """Export."""
        from lgprjax.formats import MESSAGE_SUFFIXES, TRAJECTORY_SUFFIXES, export_mcap

        suffix = self.output.suffix.lower()
        if suffix in TRAJECTORY_SUFFIXES:
            self._write_trajectory()
            return
        if suffix not in MESSAGE_SUFFIXES:
            suffixes = ", ".join((*MESSAGE_SUFFIXES, *TRAJECTORY_SUFFIXES))
            raise UsageError(f"--output: expected a file name that ends in {suffixes}, found {self.output.name!r}")
        if self.truth:
            raise UsageError("--truth: expected a trajectory as output, found a message recording")
        with working(f"writing {self.output}"):
            exported = export_mcap(self.drive, self.output, fixes=self.fixes, force=self.force)
        poses = "" if self.fixes is None else f", {exported.poses} ok fixes"
        if exported.left_out:
            say(f"not exported, no message type: {', '.join(exported.left_out)}")
        verdict(f"wrote {self.output}: {exported.scans} scans{poses}")

    def _write_trajectory(self) -> None:
        if self.truth and self.fixes is not None:
            raise UsageError("--truth, --fixes: expected one of them")
        from lgprjax.formats import DriveLog, read_fixes, write_trajectory
        from lgprjax.recordings import frame_of_drive, trajectory_of_fixes, trajectory_of_track

        with DriveLog.open(self.drive) as log, working(f"writing {self.output}"):
            found = (
                trajectory_of_track(log, truth=self.truth)
                if self.fixes is None
                else trajectory_of_fixes(log, read_fixes(self.fixes), self.fixes)
            )
            write_trajectory(self.output, found, frame_of_drive(log), force=self.force)
        verdict(f"wrote {self.output}: {len(found.time_s)} poses, {found.what}")


# ``lgprjax compare``: two registrations of one drive.

_CODES_SHOWN, _RUNS_SHOWN = 6, 5


@dataclass(frozen=True)
class Compare:
    """Compare two registrations of a drive, scan by scan: codes, distances, agreement with the stated uncertainty.

    A and B are fixes files, or result folders of the same drives. The command lists scans that both call ok at
    positions more than 0.3 m apart: one of the two fixes is wrong.
    """

    first: Annotated[Positional[Path], arg(metavar="A", help="X.fixes.h5, X.fixes.csv, or a result folder")]
    second: Annotated[Positional[Path], arg(metavar="B", help="another registration of the same drives")]
    json: Path | None = None
    """JSON file for the figures; - for standard output"""
    force: bool = False
    """replace existing outputs"""

    def run(self) -> None:
        """Compare."""
        from lgprjax.formats import read_fixes
        from lgprjax.recordings import compare_fixes

        pairs = self._pairs()
        found = {
            name: compare_fixes(read_fixes(first), read_fixes(second), second)
            for name, (first, second) in pairs.items()
        }
        check_outputs(self.json, force=self.force)
        for name, comparison in found.items():
            _print_comparison(name, comparison)
        if self.json is not None:
            write_figures(self.json, {name: each.as_json() for name, each in found.items()}, force=self.force)
        apart, scans = (sum(getattr(each, name) for each in found.values()) for name in ("apart", "scans"))
        fixes = next(iter(pairs.values()))[0]
        verdict(
            f"{apart} of {scans} scans more than 0.3 m apart, both ok: " + ("one is wrong" if apart else "none wrong"),
            f"export DRIVE --fixes {fixes} -o X.geojson" if fixes.suffix == ".h5" else "",
        )

    def _pairs(self) -> dict[str, tuple[Path, Path]]:
        """Files of the common drives, by drive name."""
        for side in (self.first, self.second):
            if not side.exists():
                raise InputError(
                    side, "file", "X.fixes.h5, X.fixes.csv, or a result folder", "No such file or directory"
                )
        if self.first.is_dir() != self.second.is_dir():
            odd = self.second if self.first.is_dir() else self.first
            raise InputError(odd, "input", "a result folder, like the other input", "a file")
        if not self.first.is_dir():
            return {_drive_of(self.first): (self.first, self.second)}
        sides = [
            {_drive_of(path): path for path in sorted(side.glob("*.fixes.h5"))} for side in (self.first, self.second)
        ]
        common = [name for name in sides[0] if name in sides[1]]
        if not common:
            held = ", ".join(sides[0]) or "no X.fixes.h5"
            raise InputError(self.second, "drives", f"a drive of {self.first}: {held}", ", ".join(sides[1]) or "none")
        return {name: (sides[0][name], sides[1][name]) for name in common}


def _drive_of(path: Path) -> str:
    return path.name.partition(".fixes.")[0]


def _print_comparison(name: str, found: "Comparison") -> None:
    table = Table("quantity", "A", "B", title=f"{name}: {found.scans} scans")
    for column in (1, 2):
        table.columns[column].justify = "right"
    table.add_row("ok", str(found.ok_first), str(found.ok_second))
    table.add_row("ok in both", str(found.ok_both), "")
    correlations = (found.median_correlation_first, found.median_correlation_second)
    table.add_row("median correlation, ok fixes", *("–" if each is None else f"{each:.3f}" for each in correlations))
    console.print(table)
    lines = [f"{count} scans: {change}" for change, count in list(found.codes.items())[:_CODES_SHOWN]]
    if found.rms_cross_m is None or found.rms_along_m is None or found.largest_m is None or found.within_95 is None:
        lines.append("no scan is ok in both: no distances")
    else:
        lines.append(
            f"B - A, both ok: along {found.rms_along_m:.3f} m RMS, across {found.rms_cross_m:.3f} m RMS, "
            f"max {found.largest_m:.3f} m; {100.0 * found.within_95:.1f} % within the joint 95 % interval"
        )
    if found.apart:
        runs = ", ".join(
            f"{start}-{stop}" if stop > start else f"{start}" for start, stop in found.apart_at[:_RUNS_SHOWN]
        )
        more = len(found.apart_at) - _RUNS_SHOWN
        lines.append(
            f"more than 0.3 m apart, one fix is wrong: {found.apart} scans, {runs}"
            + (f", and {more} more places" if more > 0 else "")
        )
    for line in lines:
        say(line)


# ``lgprjax recover``: the intact records of a run as a drive log.


@dataclass(frozen=True)
class Recover:
    """Write the intact records of a run as a drive log, after a complete run or a power cut.

    Map and vehicle file come from the configuration of the run unless they are given.
    """

    folder: Annotated[Positional[Path], arg(metavar="RUN_FOLDER", help="folder of the run, with .lgprun segments")]
    output: Annotated[Path, arg(aliases=["-o"], metavar="X.drive.h5", help="drive log to write")]
    map: Path | None = None
    """map of the run, if it has moved"""
    vehicle: Path | None = None
    """vehicle file of the run, if it has moved"""
    calibration: Annotated[Path | None, arg(metavar="X.radar.h5")] = None
    """calibration of a stepped-frequency radar, instead of that in the configuration of the run"""
    force: bool = False
    """replace existing outputs"""

    def run(self) -> None:
        """Recover."""
        from lgprjax.formats import read_run
        from lgprjax.runtime.drive_log import drive_of_run

        reading = read_run(self.folder)
        check_outputs(self.output, force=self.force)
        with working(f"reading {self.folder}"):
            found = reading.summary
        _print_recording(found, self.folder)
        if not found.records:
            raise InputError(self.folder, "segments", "an intact record", "none: nothing can be recovered")
        config = config_of_run(self.folder)
        if config.coverage is not None:
            expected = "a run with radar and map (use lgprjax cover record for runs of a field plan)"
            raise InputError(self.folder, "run", expected, "a run of a field plan, without radar")
        with working(f"writing {self.output}"):
            drive = drive_of_run(
                reading,
                config,
                self.output,
                map_file=self.map,
                vehicle_file=self.vehicle,
                calibration=self.calibration,
                force=self.force,
            )
        left_out = f", {drive.left_out} left out" if drive.left_out else ""
        verdict(
            f"wrote {self.output}: {drive.seconds:.1f} s, {drive.scans} scans{left_out}",
            f"check {self.output} --health",
        )


def config_of_run(folder: Path) -> "RuntimeConfig":
    """Configuration of the run, with paths relative to its original folder."""
    from lgprjax.runtime.config import read_config

    config = read_config(folder / "config.toml")
    with suppress(OSError, ValueError, KeyError, TypeError):
        file = Path(json.loads((folder / "run.json").read_text(encoding="utf-8"))["config"])
        return config.model_copy(update={"file": file})
    return config


def _print_recording(found: "RunSummary", folder: Path) -> None:
    """Print a table of the intact and damaged parts."""
    table = Table("recording", "found", title=str(folder))
    table.add_row("segments", str(found.segments))
    table.add_row("intact records", str(found.records))
    table.add_row("ended", "interrupted" if found.end is None else found.end)
    for each in found.cut:
        table.add_row(
            "cut", f"{each.file} at byte {each.start}: {each.stop - each.start} bytes are not an intact record"
        )
    for each in found.damaged:
        table.add_row("damaged", f"{each.file}, bytes {each.start} to {each.stop - 1}")
    for lost in found.missing:
        table.add_row("lost", f"{lost.last - lost.first + 1} records, numbers {lost.first} to {lost.last}")
    for ring, count in found.dropped.items():
        if count:
            table.add_row("not recorded", f"{count} messages of {ring} dropped, buffer full")
    table.add_row("complete", "yes" if found.complete else "no")
    console.print(table, highlight=False, markup=False)


_EXAMPLES = ("onboard", "sites", "tuning")


@dataclass(frozen=True)
class Examples:
    """Copy the example files into a folder: synthetic sites, studies with their drives, onboard configurations."""

    output: Annotated[Path, arg(aliases=("-o",), metavar="DIR")] = Path("lgprjax-examples")
    """folder to write to, created if missing"""
    force: bool = False
    """replace existing outputs"""

    def run(self) -> None:
        """Copy; without ``force`` nothing is written if one of the files exists."""
        files = [
            (folder, path)
            for folder in _EXAMPLES
            for path in sorted(examples_folder(folder).iterdir())
            if path.is_file()
        ]
        for folder, path in files:
            if (self.output / folder / path.name).exists() and not self.force:
                raise InputError(
                    self.output / folder / path.name, "output", "a new file, or --force", "an existing file"
                )
        for folder, path in files:
            (self.output / folder).mkdir(parents=True, exist_ok=True)
            shutil.copyfile(path, self.output / folder / path.name)
        for folder in _EXAMPLES:
            names = ", ".join(path.name for at, path in files if at == folder)
            say(f"{self.output / folder}: {names}")
        verdict(
            f"copied {counted(len(files), 'file')} to {self.output}",
            "simulate village -o drives",
        )
