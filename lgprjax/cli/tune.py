"""``lgprjax tune`` and ``lgprjax thresholds``: studies of a vehicle's logs, thresholds from the user's drives."""

from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from rich.table import Table
from tyro.conf import Positional, arg

from lgprjax.cli.figures import check_outputs, write_figures
from lgprjax.cli.terminal import console, progress_bar, require_files, working
from lgprjax.errors import InputError

if TYPE_CHECKING:
    from lgprjax.studies.steering import FinishedStudy


@dataclass(frozen=True)
class Tune:
    """Run a study on a vehicle's logs: a calibration, how well it tracked, or the choice of the look-ahead.

    The study file gives the numbers to fit, the vehicle file and the drive logs. The result is a new vehicle file, with
    the 95 % interval of every fitted number, and pictures. The old file is not changed. A log that lacks what the fit
    needs is refused, and nothing is written that a held-out log contradicts. tuning/ has example studies.
    """

    study: Annotated[Positional[Path], arg(metavar="STUDY.toml", help="the study file")]
    output: Annotated[Path, arg(aliases=["-o"], metavar="DIR", help="folder for the new vehicle file and pictures")]
    json: Path | None = None
    """also write the fitted numbers, with their intervals, to this file, or - for standard output"""
    force: bool = False
    """replace outputs that exist"""

    def run(self) -> None:
        """Run the study."""
        from lgprjax.formats import read_study, write_vehicle
        from lgprjax.report.study_pictures import study_pictures
        from lgprjax.studies.steering import run_study

        study = read_study(self.study)
        target = self.output / study.vehicle.name
        if self.output.exists() and not self.output.is_dir():
            raise InputError(self.output, "output", "a folder", "a file")
        if target.resolve() == study.vehicle.resolve():
            raise InputError(target, "output", "another folder than that of the study's vehicle file", "the same")
        draw = study_pictures(study.kind)
        pictures = {name: self.output / f"{study.name}.{name}.png" for name in draw}
        for path in (target, *pictures.values()):
            if path.exists() and not self.force:
                raise InputError(path, "output", "a new file, or --force", "one that exists")
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
            console.print(f"vehicle file: {target}", highlight=False, markup=False, soft_wrap=True)
        for path in pictures.values():
            console.print(f"picture: {path}", highlight=False, markup=False, soft_wrap=True)


def figures_of(finished: "FinishedStudy") -> dict[str, object]:
    """Numbers of a study as JSON: fitted ones with intervals, chosen ones without, and the quality of the fit."""
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
    table = Table("number", "value", "95 % interval", title=f"{finished.study.name} ({finished.study.kind})")
    for path, found in finished.outcome.found.items():
        for number, one in enumerate(found if isinstance(found, list) else [found]):
            if isinstance(found, list) and number not in (0, len(found) // 2, len(found) - 1):
                continue  # a long list: ends and middle here, all of it in the file
            place = f"{path}[{number}]" if isinstance(found, list) else path
            table.add_row(place, f"{one.value:.5g} {units[path]}".strip(), f"{one.low:.5g} to {one.high:.5g}")
    for path, value in finished.outcome.fixed.items():
        table.add_row(path, f"{value:.5g} {units[path]}".strip(), "set, not measured")
    console.print(table)
    for figure in finished.outcome.figures:
        interval = "" if figure.low is None else f" ({figure.low:.3g} to {figure.high:.3g})"
        console.print(f"{figure.name}: {figure.value:.3g} {figure.unit}{interval}", highlight=False, markup=False)
    for note in finished.outcome.notes:
        console.print(note, highlight=False, markup=False)


# ``lgprjax thresholds``: thresholds of a fix, calibrated on the user's drives.


@dataclass(frozen=True)
class ThresholdsVerb:
    """Calibrate the thresholds of fixes on drives with known positions.

    Every drive is matched at its own place, and at other places of the same map, where no match can be right. With the
    thresholds found, a match of the second kind passes with the probability given by --risk; a factor on all sigmas
    makes the errors of the first kind consistent with their covariances. Use them on other drives: register
    --thresholds.
    """

    map: Annotated[Positional[Path], arg(metavar="MAP", help="subsurface database, M.map.h5")]
    drives: Annotated[Positional[tuple[Path, ...]], arg(metavar="DRIVE...", help="drive logs over its ground")]
    output: Annotated[Path, arg(aliases=["-o"], metavar="X.toml", help="file to write")]
    window_m: float
    """length of the windows in metres, 0 for single scans; thresholds are valid for one length, which register then
    needs
    """
    search_m: float = 2.5
    """search this far to each side of the position in the log, in metres"""
    time_scale: float | Literal["auto"] = "auto"
    """as for register"""
    risk: float = 1e-4
    """accepted probability that a match at a wrong place passes"""
    json: Path | None = None
    """also write the figures to this file, or - for standard output"""
    force: bool = False
    """replace outputs that exist"""

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
            with progress_bar("matching, at true places and at false ones", 2 * scans) as advance:
                trials = try_drives(source, logs, options, advance)
        try:
            found = thresholds_from(trials, self.risk)
        except ValueError as error:
            raise InputError(self.map, "drives", "drives that tell enough", str(error)) from None
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
        console.print(
            f"score >= {found.strength_by_chance:.2f} and margin >= {found.margin_by_chance:.2f} noise floors; sigmas "
            f"times {found.sigma_scale:.2f}\n"
            f"correct matches that pass: {figures['pass']:.1%} of {figures['right']}; highest of {figures['false']} "
            f"false ones: score {figures['highest_false_strength']:.2f}, margin {figures['highest_false_lead']:.2f}\n"
            f"thresholds: {self.output}",
            highlight=False,
            markup=False,
            soft_wrap=True,
        )
