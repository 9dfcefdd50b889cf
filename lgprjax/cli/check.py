"""``lgprjax check``: hold files against their schema; measure whether a drive was recorded well."""

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from rich.table import Table
from rich.text import Text
from tyro.conf import Positional, arg

from lgprjax.cli.errors import UsageError, require_files
from lgprjax.cli.progress import console, progress_bar, working

if TYPE_CHECKING:
    from lgprjax.archive import DriveHealth, Stretch

_VERDICT_STYLE = {"good": "green", "look": "yellow", "bad": "bold red", "not recorded": "dim"}
_NOTHING = "–"
_STRETCHES = 3  # named in the table; all of them are in the JSON


@dataclass(frozen=True)
class Check:
    """Hold files against the data schema: every place that is not as it should be."""

    files: Annotated[
        Positional[tuple[Path, ...]],
        arg(
            metavar="FILE...",
            help=".drive.h5, .map.h5, .fixes.h5, .fixes.csv, .route.toml, .vehicle.toml, .cover.geojson, .worked.h5; "
            "HDF5 of any other name by the schema that it names",
        ),
    ]
    health: bool = False
    """also measure how well the drive logs were recorded: radar, clock, odometry, GNSS"""
    json: Path | None = None
    """also write the findings to this file (with --health: findings and figures)"""
    force: bool = False
    """replace that file if it exists"""

    def run(self) -> int:
        """Check; status 1 if any file cannot be used."""
        from lgprjax.cli.figures import write_figures
        from lgprjax.formats import check_file

        require_files(self.files, "files")
        if self.health and not all(path.name.lower().endswith(".drive.h5") for path in self.files):
            raise UsageError("--health: expected drive logs only, X.drive.h5")
        findings, reports = [], []
        for path in self.files:
            with working(f"checking {path}"):
                found = check_file(path)
            findings += found
            for finding in found:
                console.print(str(finding), highlight=False, soft_wrap=True, markup=False)
            if not found:
                console.print(f"{path}: ok", highlight=False, soft_wrap=True, markup=False)
            whole = not any(finding.severity == "error" for finding in found)
            if whole and path.name.lower().endswith(".drive.h5"):
                _tell_assumed(path)
            if self.health and whole:
                reports.append({"file": str(path), **_measure(path).as_json()})
        if self.json is not None:
            plain = [asdict(finding) for finding in findings]
            figures: object = {"findings": plain, "health": reports} if self.health else plain
            write_figures(self.json, figures, force=self.force)
        return int(any(finding.severity == "error" for finding in findings))


def _tell_assumed(path: Path) -> None:
    """What of a drive no instrument recorded."""
    from lgprjax.formats import DriveLog, assumed_in_words, assumed_of

    with DriveLog.open(path) as log:
        assumed = assumed_of(log.description.provenance)
    if assumed:
        told = f"{path}: assumed, as no instrument recorded it: {assumed_in_words(assumed)}"
        console.print(told, highlight=False, markup=False, soft_wrap=True)


def _measure(path: Path) -> "DriveHealth":
    from lgprjax.archive import drive_health
    from lgprjax.formats import DriveLog

    with DriveLog.open(path) as log, progress_bar(f"measuring {path.name}", log.scans) as progress:
        health = drive_health(log, progress)
    title = f"{path.name}: {health.scans} scans of {health.channels} channels, {health.travel_m:.1f} m"
    table = Table("figure", "value", "look / bad at", "verdict", "where", title=title)
    table.columns[0].no_wrap = True
    for entry in health.figures:
        value, limits = _NOTHING, _NOTHING
        if entry.verdict != "not recorded":
            value = f"{0.0 if abs(entry.value) < 1e-6 else entry.value:.3g} {entry.unit}".strip()
            limits = f"{entry.look:g} / {entry.bad:g}"
        verdict = Text(entry.verdict, _VERDICT_STYLE[entry.verdict])
        table.add_row(entry.name, value, limits, verdict, _where(entry.where))
    console.print(table)
    for entry in health.figures:
        if entry.verdict != "good":
            console.print(f"{entry.verdict}: {entry.name}: {entry.meaning}", highlight=False, markup=False)
    for name, why in health.not_measured:
        console.print(f"not measured: {name}: {why}", highlight=False, markup=False, style="dim")
    beside = f"; not recorded, and not judged: {', '.join(health.assumed)}" if health.assumed else ""
    console.print(f"{path}: recording {health.verdict}{beside}", highlight=False, markup=False, soft_wrap=True)
    return health


def _where(stretches: "tuple[Stretch, ...]") -> str:
    """The first stretches in metres of travel, channels named."""
    parts = []
    for stretch in stretches[:_STRETCHES]:
        channel = "" if stretch.channel is None else f"channel {stretch.channel}: "
        parts.append(f"{channel}{stretch.start_m:.1f}-{stretch.stop_m:.1f} m")
    more = len(stretches) - _STRETCHES
    return ", ".join(parts) + (f", {more} more" if more > 0 else "")
