"""``lgprjax recover``: what a recorded run still holds, and a drive log out of it."""

import json
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from rich.table import Table
from tyro.conf import Positional, arg

from lgprjax.cli.errors import UsageError
from lgprjax.cli.progress import console, working
from lgprjax.errors import InputError

if TYPE_CHECKING:
    from lgprjax.formats import RunSummary
    from lgprjax.runtime.config import RuntimeConfig

_SUFFIX = ".drive.h5"


@dataclass(frozen=True)
class Recover:
    """Save a recorded run, whole or cut short by a power cut: every whole record, as a drive log.

    Map and vehicle file are those of the run's configuration unless told otherwise.
    """

    folder: Annotated[Positional[Path], arg(metavar="RUN_FOLDER", help="folder of the run, with its .lgprun segments")]
    output: Annotated[Path, arg(aliases=["-o"], metavar="X.drive.h5", help="drive log to write")]
    map: Path | None = None
    """database that was driven on, where it lies elsewhere now"""
    vehicle: Path | None = None
    """vehicle file, where it lies elsewhere now"""
    force: bool = False
    """replace an output that exists"""

    def run(self) -> None:
        """Recover."""
        if not self.output.name.endswith(_SUFFIX):
            raise UsageError(f"--output: expected a file name that ends in {_SUFFIX}, found {self.output.name!r}")
        if self.output.exists() and not self.force:
            raise InputError(self.output, "output", "a new file, or --force", "the file exists")
        from lgprjax.archive import write_run_drive
        from lgprjax.formats import MapFile, read_run, read_vehicle

        reading = read_run(self.folder)
        with working(f"reading {self.folder}"):
            found = reading.summary
        _tell(found, self.folder)
        if not found.records:
            raise InputError(self.folder, "segments", "a whole record", "none: nothing can be saved")
        config = _config_of(self.folder)
        vehicle = read_vehicle(self.vehicle or config.path(config.vehicle))
        with MapFile.open(self.map or config.path(config.map)) as source, working(f"writing {self.output}"):
            drive = write_run_drive(
                reading,
                self.output,
                source=source,
                vehicle=vehicle,
                position_sigma_m=config.sensors.gnss_sigma_m,
                force=self.force,
            )
        left_out = f", {drive.left_out} left out" if drive.left_out else ""
        told = f"wrote {self.output}: {drive.seconds:.1f} s, {drive.scans} scans{left_out}"
        console.print(told, highlight=False, markup=False, soft_wrap=True)


def _config_of(folder: Path) -> "RuntimeConfig":
    """The run's configuration, its paths relative to the folder that it was read in."""
    from lgprjax.runtime.config import read_config

    config = read_config(folder / "config.toml")
    with suppress(OSError, ValueError, KeyError, TypeError):
        file = Path(json.loads((folder / "run.json").read_text(encoding="utf-8"))["config"])
        return config.model_copy(update={"file": file})
    return config


def _tell(found: "RunSummary", folder: Path) -> None:
    """One table: what is whole, what is not."""
    table = Table("recording", "found", title=str(folder))
    table.add_row("segments", str(found.segments))
    table.add_row("whole records", str(found.records))
    table.add_row("ended", "interrupted" if found.end is None else found.end)
    for each in found.cut:
        table.add_row("cut", f"{each.file} at byte {each.start}: {each.stop - each.start} bytes are no whole record")
    for each in found.damaged:
        table.add_row("damaged", f"{each.file}, bytes {each.start} to {each.stop - 1}")
    for lost in found.missing:
        table.add_row("lost", f"{lost.last - lost.first + 1} records, numbers {lost.first} to {lost.last}")
    for ring, count in found.dropped.items():
        if count:
            table.add_row("never recorded", f"{count} messages of {ring} found no room")
    table.add_row("complete", "yes" if found.complete else "no")
    console.print(table, highlight=False, markup=False)
