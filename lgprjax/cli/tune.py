"""``lgprjax tune``: a study of a vehicle's logs, from its file to a new vehicle file."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from rich.table import Table
from tyro.conf import Positional, arg

from lgprjax.cli.progress import console, working
from lgprjax.errors import InputError

if TYPE_CHECKING:
    from lgprjax.archive.studies import FinishedStudy


@dataclass(frozen=True)
class Tune:
    """Run a study on a vehicle's logs: a calibration, or the choice of the look-ahead.

    The study file says what is to be found, with which vehicle file and on which drive logs. What comes out is a new
    vehicle file, with the 95 % interval of every number that was found, and pictures. The old file stays as it is. A
    log that does not hold what the fit needs is refused. tuning/ has studies to start from.
    """

    study: Annotated[Positional[Path], arg(metavar="STUDY.toml", help="the study file")]
    output: Annotated[Path, arg(aliases=["-o"], metavar="DIR", help="folder for the new vehicle file and pictures")]
    json: Path | None = None
    """also write the numbers found, with their intervals, to this file"""
    force: bool = False
    """replace outputs that exist"""

    def run(self) -> None:
        """Run the study."""
        from lgprjax.archive.studies import run_study
        from lgprjax.cli.figures import write_figures
        from lgprjax.formats import read_study, write_vehicle
        from lgprjax.report.study_pictures import study_pictures

        study = read_study(self.study)
        target = self.output / study.vehicle.name
        if self.output.exists() and not self.output.is_dir():
            raise InputError(self.output, "output", "a folder", "a file")
        if target.resolve() == study.vehicle.resolve():
            raise InputError(target, "output", "another folder than that of the study's vehicle file", "the same")
        draw = study_pictures(study.kind)
        pictures = {name: self.output / f"{study.name}.{name}.png" for name in draw}
        for path in (target, *pictures.values(), *([] if self.json is None else [self.json])):
            if path.exists() and not self.force:
                raise InputError(path, "output", "a new file, or --force", "the file exists")
        with working(f"fitting {study.name}"):
            finished = run_study(study)
            self.output.mkdir(parents=True, exist_ok=True)
            for name, path in pictures.items():
                draw[name](finished.outcome.detail, path, self.force)
        write_vehicle(target, finished.vehicle, force=self.force)
        if self.json is not None:
            write_figures(self.json, figures_of(finished), force=self.force)
        _print(finished)
        console.print(f"vehicle file: {target}", highlight=False, markup=False, soft_wrap=True)
        for path in pictures.values():
            console.print(f"picture: {path}", highlight=False, markup=False, soft_wrap=True)


def figures_of(finished: "FinishedStudy") -> dict[str, object]:
    """Numbers of a study as JSON: found with intervals, set without, and how well the fit holds."""
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
        "figures": [figure._asdict() for figure in outcome.figures],
        "notes": list(outcome.notes),
    }


def _print(finished: "FinishedStudy") -> None:
    from lgprjax.formats import load_schema

    units = {entry.path: entry.unit for entry in load_schema("vehicle").keys}
    table = Table("number", "value", "95 % interval", title=f"{finished.study.name} ({finished.study.kind})")
    for path, found in finished.outcome.found.items():
        for number, one in enumerate(found if isinstance(found, list) else [found]):
            if isinstance(found, list) and number not in (0, len(found) // 2, len(found) - 1):
                continue  # a long list: its ends and middle here, all of it in the file
            place = f"{path}[{number}]" if isinstance(found, list) else path
            table.add_row(place, f"{one.value:.5g} {units[path]}".strip(), f"{one.low:.5g} to {one.high:.5g}")
    for path, value in finished.outcome.fixed.items():
        table.add_row(path, f"{value:.5g} {units[path]}".strip(), "set, not measured")
    console.print(table)
    for figure in finished.outcome.figures:
        console.print(f"{figure.name}: {figure.value:.3g} {figure.unit}", highlight=False, markup=False)
    for note in finished.outcome.notes:
        console.print(note, highlight=False, markup=False)
