"""``lgprjax locate``: where drives begin on a map, without a prior position."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from rich.table import Table
from tyro.conf import Positional, arg

from lgprjax.cli.terminal import console, require_files, say, verdict, working
from lgprjax.errors import InputError
from lgprjax.files import make_folder


@dataclass(frozen=True)
class Locate:
    """Find where drives begin on a map, from their radar scans and their travel alone.

    Logged positions are not used. A start is ok when the probability that it is false falls below 1e-6; it is given up
    after 20 m of travel.
    """

    map: Annotated[Positional[Path], arg(metavar="MAP", help="map, M.map.h5")]
    drives: Annotated[Positional[tuple[Path, ...]], arg(metavar="DRIVE...", help="drive logs, X.drive.h5")]
    output: Annotated[Path, arg(aliases=["-o"], metavar="DIR", help="folder for DRIVE.located.csv, a row per start")]
    every_m: float | None = None
    """distance between starts, in metres; default: one start, at the beginning of each drive"""
    force: bool = False
    """replace existing outputs of these drives"""

    def run(self) -> int:
        """Locate. Returns the exit status."""
        from lgprjax.batch.locate import MapLines, check_every, locate_log
        from lgprjax.formats import DriveLog, MapFile
        from lgprjax.recordings import recording_of, track_of_drive

        require_files(self.drives, "drives")
        check_every(self.every_m)
        names = [path.name.removesuffix(".drive.h5") for path in self.drives]
        for name in names:
            if names.count(name) > 1:
                raise InputError(name, "drives", "different drive names: the outputs use them", "this name twice")
            target = self.output / f"{name}.located.csv"
            if target.exists() and not self.force:
                raise InputError(target, "output", "a new file, or --force", "an existing file")
        located, starts = 0, 0
        table = Table("drive", "start", "driven_m", "p_false", "hypotheses", "code", title="starts")
        with MapFile.open(self.map) as source:
            for path in self.drives:
                with DriveLog.open(path) as log:
                    recording_of(log).operator(source.description.settings, len(source.description.gain))
                    track_of_drive(log, source.description.frame)
            make_folder(self.output)
            with working("reading the map"):
                held = MapLines(source)
            for path in self.drives:
                with DriveLog.open(path) as log, working(f"locating {path.name}"):
                    found = locate_log(held, log, self.every_m)
                say(str(found.save(self.output, force=self.force)))
                for row in found.table.itertuples():
                    cells = (f"{row.driven_m:.1f}", f"{row.p_false:.1e}", str(row.hypotheses), str(row.code))
                    table.add_row(found.name, f"scan {row.start_scan}", *cells)
                starts += len(found.table)
                located += int((found.table["code"] == "ok").sum())
        console.print(table)
        verdict(f"{located} of {starts} starts located", f"register {self.map} {self.drives[0]} -o DIR")
        return 0
