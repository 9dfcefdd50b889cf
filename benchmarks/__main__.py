"""``python -m benchmarks``: measurements beside other programs, on this machine."""

import sys
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from json import loads
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, NamedTuple

import tyro
from rich.console import Console
from rich.status import Status
from tyro.conf import Positional, arg

from lgprjax.cli.command import keep_compiled
from lgprjax.cli.terminal import console, run_verb
from lgprjax.errors import InputError

if TYPE_CHECKING:
    from benchmarks.records import Record

Name = Literal["registration", "drive", "rollouts", "tuning", "closed-loop", "runtime", "coverage", "archive"]
Say = Callable[[str], None]


class Measured(NamedTuple):
    """What a benchmark found, as the command line shows it.

    Attributes:
        machine: what it ran on.
        lead: lines and tables above the records.
        records: figures, goals among them.
        not_measured: what did not run, and why.
        more: further data for the JSON file.
    """

    machine: str
    lead: list[str]
    records: "list[Record]"
    not_measured: list[str]
    more: dict[str, Any]


@dataclass(frozen=True)
class Bench:
    """Measure this project beside others' programs, on the same problems on this machine.

    registration: the search for a scan's pose, on hard generated ground.
    drive: a drive of ten minutes registered from end to end: what a scan costs, and where the time goes; half an hour.
    rollouts: vehicles driven along a path in closed loop, very many at once.
    tuning: a whole study, the look-ahead from twenty logs, beside SciPy's fit and NumPy's rollouts.
    closed-loop: a mile off road driven by the autopilot with full registration, in each of seven conditions, about
    twenty minutes; and a thousand kilometres with an error model of fixes.
    runtime: the onboard runtime in real time against simulated devices, a mile with 126 scans a second.
    coverage: the worked area of a hectare kept up live, beside the source's cached shapes and brute force.
    archive: a thousand drives registered by one worker process and by several, one of them killed; about half an hour.

    Each peer runs in a process of its own with the number of threads that suits it best. Goals that are not met are
    printed as plainly as those that are; the exit status does not depend on them. Peers come with pip install
    "lgprjax[bench]".
    """

    name: Annotated[
        Positional[Name],
        arg(metavar="NAME", help="registration, drive, rollouts, tuning, closed-loop, runtime, coverage or archive"),
    ]
    device: Literal["cpu", "gpu"] = "cpu"
    """gpu: registration, rollouts or drive on an accelerator beside two cores of its machine, and whether both agree"""
    quick: bool = False
    """few problems, about two minutes: rough figures"""
    json: Path | None = None
    """also write machine, peers and records to this file"""
    figure: Path | None = None
    """registration: also measure success against coarse step and correlation length of the ground and draw it (PNG);
    minutes more. closed-loop: also draw the first drive. runtime: also draw the times from scan to command"""
    force: bool = False
    """replace outputs that exist"""

    def run(self) -> None:
        """Run, print, write."""
        if self.figure is not None and self.name not in ("registration", *_DRAWN):
            raise InputError("--figure", "option", "the benchmark registration, closed-loop or runtime", self.name)
        if self.device == "gpu" and (self.name not in ("registration", "rollouts", "drive") or self.figure is not None):
            raise InputError("--device", "option", "registration, rollouts or drive, without --figure", self.name)
        for path in (self.json, self.figure):
            if path is not None and path.exists() and not self.force:
                raise InputError(path, "output", "a new file, or --force", "one that exists")
            if path is not None and not path.absolute().parent.is_dir():
                raise InputError(path, "output", "a file in a folder that exists", "no such folder")
        with tempfile.TemporaryDirectory() as folder, _sign("starting") as status:
            # These pictures are of drives that are measured anyhow, the other one of measurements of its own.
            if self.device == "gpu":
                measured = _accelerator(self.name, self.quick, Path(folder), status.update)
            elif self.figure is not None and self.name in _DRAWN:
                measured = _DRAWN[self.name](self.quick, Path(folder), status.update, self.figure)
            else:
                measured = _BENCHMARKS[self.name](self.quick, Path(folder), status.update)
        self._print(measured)
        self._write(measured)
        if self.figure is not None and self.name == "registration":
            self._draw(self.figure)

    def _print(self, measured: Measured) -> None:
        from benchmarks import text_table

        _say(measured.machine)
        if self.quick:
            _say("quick: few problems, few repeats; the figures are rough, and none is to be quoted")
        _say("")
        for line in measured.lead:
            _say(line)
        _say(text_table(measured.records).rstrip())
        for line in measured.not_measured:
            _say(f"not measured: {line}")

    def _write(self, measured: Measured) -> None:
        from benchmarks.records import date_and_commit, records_as_json
        from lgprjax.cli.figures import write_figures

        if self.json is None:
            return
        figures = {
            "machine": measured.machine,
            "command": f"python -m benchmarks {self.name}" + (" --device gpu" if self.device == "gpu" else ""),
            **date_and_commit(),
            "quick": self.quick,
            **measured.more,
            "records": loads(records_as_json(measured.records)),
            "not_measured": measured.not_measured,
        }
        write_figures(self.json, figures, force=self.force)

    def _draw(self, path: Path) -> None:
        from benchmarks.figure import QUICK_SWEEP, SWEEP, draw_sweeps, measure_sweeps

        sweep = QUICK_SWEEP if self.quick else SWEEP
        with tempfile.TemporaryDirectory() as folder, _sign("figure") as status:
            strides, grounds = measure_sweeps(sweep, Path(folder), status.update)
        draw_sweeps(strides, grounds, path, usual_m=sweep.hard_set.correlation_m, force=self.force)
        _say(f"figure: {path}")


def _registration(quick: bool, folder: Path, say: Say) -> Measured:
    from benchmarks.records import peer_table, peers_as_data
    from benchmarks.registration import FULL, QUICK, run_registration

    outcome = run_registration(QUICK if quick else FULL, folder, say)
    lead = [
        "Times a scan, 369 samples of 11 channels to pose, map prepared; threads in brackets.",
        peer_table(outcome.peers),
        "A ratio says how many times faster this project is than what stands after the stroke.",
    ]
    more = {"peers": peers_as_data(outcome.peers)}
    return Measured(outcome.machine, lead, outcome.records, outcome.not_measured, more)


def _drive(quick: bool, folder: Path, say: Say) -> Measured:
    from benchmarks.whole_drive import FULL_DRIVE, QUICK_DRIVE, run_drive

    outcome = run_drive(QUICK_DRIVE if quick else FULL_DRIVE, folder, say)
    lead = ["11 x 369 samples a scan, two baselines as the map, defaults; every figure in a process of its own."]
    return Measured(outcome.machine, lead, outcome.records, outcome.not_measured, {})


def _rollouts(quick: bool, folder: Path, say: Say) -> Measured:
    from benchmarks.rollouts import FULL_ROLLOUTS, QUICK_ROLLOUTS, run_rollouts

    outcome = run_rollouts(QUICK_ROLLOUTS if quick else FULL_ROLLOUTS, folder, say)
    lead = ["One step of one vehicle is a step. A ratio says how many times faster this project is than the other."]
    return Measured(outcome.machine, lead, outcome.records, outcome.not_measured, {})


def _tuning(quick: bool, folder: Path, say: Say) -> Measured:
    from benchmarks.tuning import FULL_TUNING, QUICK_TUNING, run_tuning

    outcome = run_tuning(QUICK_TUNING if quick else FULL_TUNING, folder, say)
    lead = ["A ratio says how many times faster this project is than what stands after the stroke."]
    return Measured(outcome.machine, lead, outcome.records, outcome.not_measured, {})


def _accelerator(name: Any, quick: bool, folder: Path, say: Say) -> Measured:
    from benchmarks.accelerator import FULL_ACCELERATOR, QUICK_ACCELERATOR, run_accelerator

    outcome = run_accelerator(name, QUICK_ACCELERATOR if quick else FULL_ACCELERATOR, folder, say)
    return Measured(outcome.machine, [], outcome.records, outcome.not_measured, {})


def _closed_loop(quick: bool, _: Path, say: Say, figure: Path | None = None) -> Measured:
    from benchmarks.closed_loop import FULL_LOOP, QUICK_LOOP, run_closed_loop

    outcome = run_closed_loop(replace(QUICK_LOOP if quick else FULL_LOOP, picture=figure), say)
    lead = ["Tracking is the anchor's true track against the baseline anchor's true track, interpolated."]
    return Measured(outcome.machine, lead, outcome.records, outcome.not_measured, {"drives": outcome.drives})


def _runtime(quick: bool, folder: Path, say: Say, figure: Path | None = None) -> Measured:
    from benchmarks.runtime import FULL_RUNTIME, QUICK_RUNTIME, run_runtime

    outcome = run_runtime(replace(QUICK_RUNTIME if quick else FULL_RUNTIME, picture=figure), folder, say)
    lead = ["Radar at 126 scans a second, full registration, real time; the devices are simulated on the same machine."]
    return Measured(outcome.machine, lead, outcome.records, outcome.not_measured, {"run": outcome.figures})


def _coverage(quick: bool, _: Path, say: Say) -> Measured:
    from benchmarks.coverage import FULL_COVERAGE, QUICK_COVERAGE, run_coverage

    outcome = run_coverage(QUICK_COVERAGE if quick else FULL_COVERAGE, say)
    lead = ["A hectare of cells of 5 cm, ten moments a second; a step's time has the moment's hand-over in it."]
    return Measured(outcome.machine, lead, outcome.records, outcome.not_measured, {"worked_area": outcome.figures})


def _archive(quick: bool, folder: Path, say: Say) -> Measured:
    from benchmarks.archive import FULL_ARCHIVE, QUICK_ARCHIVE, run_archive

    outcome = run_archive(QUICK_ARCHIVE if quick else FULL_ARCHIVE, folder, say)
    lead = [
        "Drives of 2 s cut from one simulated drive; every run is a command of its own, its processes started afresh."
    ]
    return Measured(outcome.machine, lead, outcome.records, outcome.not_measured, {})


_BENCHMARKS: dict[Name, Callable[[bool, Path, Say], Measured]] = {
    "registration": _registration,
    "drive": _drive,
    "rollouts": _rollouts,
    "tuning": _tuning,
    "closed-loop": _closed_loop,
    "runtime": _runtime,
    "coverage": _coverage,
    "archive": _archive,
}

_DRAWN: dict[Name, Callable[[bool, Path, Say, Path | None], Measured]] = {
    "closed-loop": _closed_loop,
    "runtime": _runtime,
}


def _sign(what: str) -> Status:
    """A sign of life on standard error whose text can change."""
    return Console(stderr=True).status(what)


def _say(text: str) -> None:
    console.print(text, highlight=False, markup=False, soft_wrap=True)


def main(arguments: Sequence[str] | None = None) -> None:
    """The program."""
    keep_compiled()
    config = (tyro.conf.OmitArgPrefixes, tyro.conf.FlagCreatePairsOff)
    bench = tyro.cli(Bench, prog="python -m benchmarks", args=arguments, config=config)
    sys.exit(run_verb(bench.run))


if __name__ == "__main__":
    main()
