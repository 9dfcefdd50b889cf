"""``lgprjax bench``: measurements beside other programs, on this machine."""

import tempfile
from dataclasses import dataclass
from json import loads
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from rich.console import Console
from rich.status import Status
from tyro.conf import Positional, arg

from lgprjax.cli.progress import console
from lgprjax.errors import InputError

if TYPE_CHECKING:
    from lgprjax.bench.registration import Outcome


@dataclass(frozen=True)
class Bench:
    """Measure this project beside others' programs, on the same problems on this machine.

    registration: the search for a scan's pose, on hard generated ground. Each peer runs in a process of its own with
    the number of threads that suits it best. Goals that are not met are printed as plainly as those that are; the
    exit status does not depend on them. Peers come with pip install "lgprjax[bench]".
    """

    name: Annotated[Positional[Literal["registration"]], arg(metavar="NAME", help="registration")]
    quick: bool = False
    """few problems, about two minutes: rough figures"""
    json: Path | None = None
    """also write machine, peers and records to this file"""
    figure: Path | None = None
    """also measure success against coarse step and correlation length of the ground and draw it (PNG); minutes more"""
    force: bool = False
    """replace outputs that exist"""

    def run(self) -> None:
        """Run, print, write."""
        from lgprjax.bench.registration import FULL, QUICK, run_registration

        for path in (self.json, self.figure):
            if path is not None and path.exists() and not self.force:
                raise InputError(path, "output", "a new file, or --force", "the file exists")
            if path is not None and not path.absolute().parent.is_dir():
                raise InputError(path, "output", "a file in a folder that exists", "no such folder")
        with tempfile.TemporaryDirectory() as folder, _sign("starting") as status:
            outcome = run_registration(QUICK if self.quick else FULL, Path(folder), status.update)
        self._print(outcome)
        self._write(outcome)
        if self.figure is not None:
            self._draw(self.figure)

    def _print(self, outcome: "Outcome") -> None:
        from lgprjax.bench import text_table
        from lgprjax.bench.peer_table import peer_table

        _say(outcome.machine)
        if self.quick:
            _say("quick: few problems and one number of threads; the figures are rough, and none is to be quoted")
        _say("")
        _say("Times a scan, 369 samples of 11 channels to pose, map prepared; threads in brackets.")
        _say(peer_table(outcome.peers))
        _say("A ratio says how many times faster this project is than what stands after the stroke.")
        _say(text_table(outcome.records).rstrip())
        for line in outcome.not_measured:
            _say(f"not measured: {line}")

    def _write(self, outcome: "Outcome") -> None:
        from lgprjax.bench import records_as_json
        from lgprjax.bench.peer_table import peers_as_data
        from lgprjax.cli.figures import write_figures

        if self.json is None:
            return
        figures = {
            "machine": outcome.machine,
            "quick": self.quick,
            "peers": peers_as_data(outcome.peers),
            "records": loads(records_as_json(outcome.records)),
            "not_measured": outcome.not_measured,
        }
        write_figures(self.json, figures, force=self.force)

    def _draw(self, path: Path) -> None:
        from lgprjax.bench.figure import QUICK_SWEEP, SWEEP, draw_sweeps, measure_sweeps

        sweep = QUICK_SWEEP if self.quick else SWEEP
        with tempfile.TemporaryDirectory() as folder, _sign("figure") as status:
            strides, grounds = measure_sweeps(sweep, Path(folder), status.update)
        draw_sweeps(strides, grounds, path, usual_m=sweep.hard_set.correlation_m, force=self.force)
        _say(f"figure: {path}")


def _sign(what: str) -> Status:
    """A sign of life on standard error whose text can change."""
    return Console(stderr=True).status(what)


def _say(text: str) -> None:
    console.print(text, highlight=False, markup=False, soft_wrap=True)
