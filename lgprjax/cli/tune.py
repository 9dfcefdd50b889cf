"""``lgprjax tune`` and ``lgprjax thresholds``: calibrations from drive logs, and vehicle files compared."""

from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from rich.table import Table
from tyro.conf import Positional, arg

from lgprjax.cli.figures import check_outputs, write_figures
from lgprjax.cli.terminal import UsageError, console, counted, progress_bar, require_files, say, verdict, working
from lgprjax.errors import InputError

if TYPE_CHECKING:
    from lgprjax.tuning.studies.fleet import Fleet
    from lgprjax.tuning.studies.steering import FinishedStudy


@dataclass(frozen=True)
class Tune:
    """Run a study on drive logs of a vehicle: calibration, tracking accuracy, or look-ahead.

    The study file names the parameters to fit, the vehicle file and the drive logs. The outputs are a new vehicle file
    with the 95 % interval of every fitted parameter, and pictures. The old vehicle file is unchanged. The command
    rejects logs without the needed signals or excitation, and writes no value that a held-out log contradicts.
    lgprjax examples copies example studies.
    """

    study: Annotated[Positional[Path], arg(metavar="STUDY.toml", help="study file")]
    output: Annotated[Path, arg(aliases=["-o"], metavar="DIR", help="folder for the new vehicle file and pictures")]
    json: Path | None = None
    """JSON file for the fitted values with intervals; - for standard output"""
    force: bool = False
    """replace existing outputs"""

    def run(self) -> None:
        """Run the study."""
        from lgprjax.formats import read_study, write_vehicle
        from lgprjax.report.study_pictures import study_pictures
        from lgprjax.tuning.studies.steering import run_study

        study = read_study(self.study)
        target = self.output / study.vehicle.name
        if self.output.exists() and not self.output.is_dir():
            raise InputError(self.output, "output", "a folder", "a file")
        if target.resolve() == study.vehicle.resolve():
            raise InputError(target, "output", "a folder other than that of the vehicle file", "the same folder")
        draw = study_pictures(study.kind)
        pictures = {name: self.output / f"{study.name}.{name}.png" for name in draw}
        for path in (target, *pictures.values()):
            if path.exists() and not self.force:
                raise InputError(path, "output", "a new file, or --force", "an existing file")
        check_outputs(self.json, force=self.force)
        with working(f"fitting {study.name}"):
            finished = run_study(study)
            self.output.mkdir(parents=True, exist_ok=True)
            for name, path in pictures.items():
                draw[name](finished.outcome.detail, path, self.force)
        if study.kind != "tracking":
            write_vehicle(target, finished.vehicle, force=self.force)
        if self.json is not None:
            write_figures(self.json, figures_of(finished), force=self.force)
        _print(finished)
        if study.kind != "tracking":
            say(f"vehicle file: {target}")
        for path in pictures.values():
            say(f"picture: {path}")
        fitted = counted(len(finished.outcome.found), "parameter")
        if study.kind == "tracking":
            verdict(f"{study.name}: {counted(len(pictures), 'picture')} in {self.output}")
        else:
            verdict(f"{study.name}: {fitted} fitted, wrote {target}", f"check {target}")


def figures_of(finished: "FinishedStudy") -> dict[str, object]:
    """Results of a study as JSON: fitted values with intervals, set values, quality of the fit."""
    outcome = finished.outcome
    return {
        "study": finished.study.name,
        "kind": finished.study.kind,
        "logs": [path.name for path in finished.study.logs],
        "held_out": [path.name for path in finished.study.held_out],
        "found": {
            path: [one._asdict() for one in found] if isinstance(found, list) else found._asdict()
            for path, found in outcome.found.items()
        },
        "set": outcome.fixed,
        "figures": [
            {name: value for name, value in figure._asdict().items() if value is not None} for figure in outcome.figures
        ],
        "notes": list(outcome.notes),
    }


def _print(finished: "FinishedStudy") -> None:
    from lgprjax.formats import load_schema

    units = {entry.path: entry.unit for entry in load_schema("vehicle").keys}
    table = Table("parameter", "value", "95 % interval", title=f"{finished.study.name} ({finished.study.kind})")
    for path, found in finished.outcome.found.items():
        for number, one in enumerate(found if isinstance(found, list) else [found]):
            if isinstance(found, list) and number not in (0, len(found) // 2, len(found) - 1):
                continue  # long list: first, middle and last value; the file has all
            place = f"{path}[{number}]" if isinstance(found, list) else path
            table.add_row(place, f"{one.value:.5g} {units[path]}".strip(), f"{one.low:.5g} to {one.high:.5g}")
    for path, value in finished.outcome.fixed.items():
        table.add_row(path, f"{value:.5g} {units[path]}".strip(), "set, not fitted")
    console.print(table)
    for figure in finished.outcome.figures:
        interval = "" if figure.low is None else f" ({figure.low:.3g} to {figure.high:.3g})"
        console.print(f"{figure.name}: {figure.value:.3g} {figure.unit}{interval}", highlight=False, markup=False)
    for note in finished.outcome.notes:
        console.print(note, highlight=False, markup=False)


# ``lgprjax tune compare``: several vehicle files side by side.


@dataclass(frozen=True)
class TuneCompare:
    """Compare vehicle files: numbers with their intervals, steering curves, drift.

    The command tests which numbers differ by more than chance among the vehicles; only numbers with a 95 % interval
    are tested. Files with the same serial number are one vehicle at different times, the oldest first: its drift from
    the first file to the last is tested. The command writes a table of all numbers and two pictures.
    """

    vehicles: Annotated[Positional[tuple[Path, ...]], arg(metavar="VEHICLE.toml...", help="vehicle files")]
    output: Annotated[Path, arg(aliases=["-o"], metavar="DIR", help="folder for the table and the pictures")]
    json: Path | None = None
    """JSON file for the differences and drifts; - for standard output"""
    force: bool = False
    """replace existing outputs"""

    def run(self) -> None:
        """Compare."""
        from lgprjax.formats import atomic_output, read_vehicle
        from lgprjax.report.fleet import draw_fleet_curves, draw_fleet_numbers
        from lgprjax.tuning.studies.fleet import compare_fleet, table_of_fleet

        require_files(self.vehicles, "vehicles")
        different = len({path.resolve() for path in self.vehicles})
        if different < len(self.vehicles) or different < 2:
            given = ", ".join(map(str, self.vehicles))
            raise UsageError(f"VEHICLE.toml: expected at least two vehicle files, each once, found {given}")
        fleet = compare_fleet({path: read_vehicle(path) for path in self.vehicles})
        if self.output.exists() and not self.output.is_dir():
            raise InputError(self.output, "output", "a folder", "a file")
        table, curves, numbers = (self.output / f"fleet.{end}" for end in ("csv", "curves.png", "numbers.png"))
        for path in (table, curves, numbers):
            if path.exists() and not self.force:
                raise InputError(path, "output", "a new file, or --force", "an existing file")
        check_outputs(self.json, force=self.force)
        self.output.mkdir(parents=True, exist_ok=True)
        with atomic_output(table, self.force) as temporary:
            table_of_fleet(fleet).to_csv(temporary, index=False, lineterminator="\n")
        draw_fleet_curves(fleet, curves, force=self.force)
        draw_fleet_numbers(fleet, numbers, force=self.force)
        if self.json is not None:
            write_figures(self.json, fleet_figures(fleet), force=self.force)
        _print_fleet(fleet)
        for path in (table, curves, numbers):
            say(f"wrote {path}")
        tested = [each for each in fleet.numbers if each.p == each.p]
        apart = [each.path for each in tested if each.differs]
        drifted = [f"{each.serial_number} {each.path}" for each in fleet.drifts if each.differs]
        told = f"{len(apart)} of {counted(len(tested), 'number')} differ by more than chance"
        verdict(told + (f"; drift: {', '.join(drifted)}" if drifted else ""))


def fleet_figures(fleet: "Fleet") -> dict[str, object]:
    """Tested numbers and drifts as JSON."""
    return {
        "vehicles": list(fleet.names),
        "numbers": [
            {
                "path": each.path,
                "values": [None if value != value else value for value in each.value.tolist()],
                "spread": each.spread,
                "p": each.p,
                "differs": each.differs,
            }
            for each in fleet.numbers
            if each.p == each.p
        ],
        "drifts": [each._asdict() for each in fleet.drifts],
    }


def _print_fleet(fleet: "Fleet") -> None:
    from lgprjax.formats import load_schema

    units = {entry.path: entry.unit for entry in load_schema("vehicle").keys}
    table = Table("number", *fleet.names, "p", title="numbers with intervals")
    for each in fleet.estimated:
        values = ("–" if value != value else f"{value:.4g}" for value in each.value)
        p = "–" if each.p != each.p else f"{each.p:.2g}{' *' * each.differs}"
        table.add_row(f"{each.path} {units[each.path]}".strip(), *values, p)
    if table.rows:
        console.print(table)
    else:
        say("no number has an interval: calibrate first (lgprjax tune STUDY.toml)")
    for drift in fleet.drifts:
        if drift.differs:
            say(
                f"{drift.serial_number}: {drift.path} changed by {drift.change:.3g} (sigma {drift.sigma:.2g}) "
                f"from {drift.first} to {drift.last}"
            )


# ``lgprjax thresholds``: acceptance thresholds of a fix, calibrated on drives.


@dataclass(frozen=True)
class ThresholdsVerb:
    """Calibrate the acceptance thresholds of fixes on drives with known positions.

    Every drive is matched at its true position and at other positions of the map. The thresholds accept a match at a
    wrong position with the probability --risk. A factor on all sigmas makes the errors at true positions agree with
    their covariances. Use the file for other drives: register --thresholds.
    """

    map: Annotated[Positional[Path], arg(metavar="MAP", help="map, M.map.h5")]
    drives: Annotated[Positional[tuple[Path, ...]], arg(metavar="DRIVE...", help="drive logs over the map")]
    output: Annotated[Path, arg(aliases=["-o"], metavar="X.toml", help="file to write")]
    window_m: float
    """length of the matched window of travel, in metres, 0 for single scans; register needs the same length"""
    search_m: float = 2.5
    """half width of the search region around the logged position, in metres"""
    time_scale: float | Literal["auto"] = "auto"
    """ratio of two-way travel time in the ground, drive to map; auto estimates it along the drive"""
    risk: float = 1e-4
    """largest accepted probability of a false fix: a match at a wrong position of the map that passes"""
    json: Path | None = None
    """JSON file for the figures; - for standard output"""
    force: bool = False
    """replace existing outputs"""

    def run(self) -> None:
        """Calibrate."""
        import numpy as np

        from lgprjax.batch import check_region, check_search, thresholds_from, try_drives
        from lgprjax.formats import DriveLog, MapFile, write_thresholds
        from lgprjax.registration import RegisterOptions, squared_errors

        require_files(self.drives, "drives")
        options = RegisterOptions(
            search_m=self.search_m,
            window_m=self.window_m,
            time_scale=None if self.time_scale == "auto" else float(self.time_scale),
        )
        check_search(replace(options, risk=self.risk))
        with ExitStack() as opened:
            source = opened.enter_context(MapFile.open(self.map))
            check_region(self.search_m, source)
            logs = [opened.enter_context(DriveLog.open(path)) for path in self.drives]
            check_outputs(self.output, self.json, force=self.force)
            scans = sum(log.scans for log in logs)
            with progress_bar("matching at true and wrong positions", 2 * scans) as advance:
                trials = try_drives(source, logs, options, advance)
        try:
            found = thresholds_from(trials, self.risk)
        except ValueError as error:
            raise InputError(self.map, "drives", "drives with enough matches", str(error)) from None
        right = trials.true.right
        score, lead = (values / trials.true.noise_floor for values in (trials.true.score, trials.true.margin))
        passed = right & (score >= found.strength_by_chance) & (lead >= found.margin_by_chance)
        nees = squared_errors(trials.true, float(found.sigma_scale))[right]
        figures = {
            "matches": len(right),
            "right": int(right.sum()),
            "pass": float(np.sum(passed) / max(int(right.sum()), 1)),
            "false": len(trials.false.score),
            "highest_false_strength": float(np.max(trials.false.score / trials.false.noise_floor)),
            "highest_false_lead": float(np.max(trials.false.margin / trials.false.noise_floor)),
            "errors_within_95": float(np.mean(nees <= 5.991)),
        }
        thresholds = {name: float(value) for name, value in found._asdict().items()}
        names = ", ".join(path.name for path in self.drives)
        write_thresholds(
            self.output,
            thresholds,
            window_m=self.window_m,
            search_m=self.search_m,
            found_on={"map": self.map.name, "drives": names, "risk": self.risk, **figures},
            force=self.force,
        )
        if self.json is not None:
            write_figures(self.json, {"thresholds": thresholds, **figures}, force=self.force)
        say(f"score >= {found.strength_by_chance:.2f} and margin >= {found.margin_by_chance:.2f} noise floors")
        say(f"factor on sigmas: {found.sigma_scale:.2f}")
        say(
            f"best of {figures['false']} wrong matches: score {figures['highest_false_strength']:.2f}, "
            f"margin {figures['highest_false_lead']:.2f}"
        )
        verdict(
            f"{figures['pass']:.1%} of {figures['right']} correct matches pass; wrote {self.output}",
            f"register {self.map} DRIVE... -o DIR --window-m {self.window_m:g} --thresholds {self.output}",
        )
