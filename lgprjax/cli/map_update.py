"""``lgprjax map update``: bring a map up to date by new drives."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from rich.table import Table
from tyro.conf import Positional, arg

from lgprjax.cli.errors import require_files
from lgprjax.cli.progress import console, progress_bar
from lgprjax.errors import InputError

if TYPE_CHECKING:
    from lgprjax.archive import DriveUpdate, UpdatedMap


@dataclass(frozen=True)
class MapUpdate:
    """Add drives to a map as baselines, weigh all of them, and retire ground that two newer drives find changed."""

    file: Annotated[Positional[Path], arg(metavar="MAP", help="the database, M.map.h5; without -o it is replaced")]
    drives: Annotated[Positional[tuple[Path, ...]], arg(metavar="DRIVE...", help="drive logs over its ground")]
    output: Annotated[Path | None, arg(aliases=["-o"], help="write a new database, NEW.map.h5")] = None
    json: Path | None = None
    """also write the figures to this file"""
    force: bool = False
    """replace outputs that exist"""

    def run(self) -> None:
        """Update."""
        from lgprjax.archive import UPDATE_PASSES, update_map
        from lgprjax.cli.figures import write_figures
        from lgprjax.formats import DriveLog

        require_files(self.drives, "drives")
        if self.json is not None and self.json.exists() and not self.force:
            raise InputError(self.json, "output", "a new file, or --force", "the file exists")
        scans = 0
        for path in self.drives:
            with DriveLog.open(path) as log:
                scans += log.scans
        with progress_bar("updating map", UPDATE_PASSES * scans) as progress:
            update = update_map(
                self.file, self.drives, self.output, force=self.force, progress=progress, stage=progress.stage
            )
        _print(update)
        _say(f"wrote {self.output or self.file}")
        if self.json is not None:
            write_figures(self.json, update.as_json(), force=self.force)


def _print(update: "UpdatedMap") -> None:
    for drive in update.drives:
        _say(
            f"{drive.name}: baseline {drive.baseline}, {drive.length_m:.0f} m, {drive.over_map_m:.0f} m of them over "
            f"the map's ground, {100 * drive.ok_share:.0f} % of the scans there ok"
        )
        _say(
            f"  labels moved by {drive.moved_rms_m:.3f} m RMS, {drive.moved_max_m:.3f} m at most, over "
            f"{drive.corrected_m:.0f} m; {drive.length_m - drive.corrected_m:.0f} m stay as given"
        )
        if drive.held_back:
            _say(
                f"  {drive.held_back} of {drive.stations} stations are held back: not located, or against the map "
                "until a second drive agrees with them"
            )
        for line in _changes(drive, update.files):
            _say(f"  {line}")
        if drive.retired or drive.released:
            _say(f"  {drive.retired} stations retired, {drive.released} that were held back are in force")
    table = Table("baseline", "weight", "reasons", title="weights of the baselines")
    for number, (file, weight) in enumerate(zip(update.files, update.weights, strict=True)):
        table.add_row(f"{number} {file}", f"{weight.weight:.2f}", weight.reasons)
    console.print(table)


def _changes(drive: "DriveUpdate", files: tuple[str, ...]) -> list[str]:
    lines = []
    for each in drive.changed:
        where = f"{each.start_m:.1f} to {each.stop_m:.1f} m ({each.start[0]:.7f}, {each.start[1]:.7f})"
        against = f"against {files[each.baseline]} (matches {each.strength:.2f}, usual {each.usual:.2f})"
        if each.agreeing:
            with_it = ", ".join(files[number] for number in each.agreeing)
            lines.append(f"{where}: changed, {against}; {with_it} agrees: the old ground is retired there")
        else:
            lines.append(f"{where}: changed or disturbed, {against}; nothing is retired")
    return lines


def _say(text: str) -> None:
    console.print(text, highlight=False, markup=False, soft_wrap=True)
