"""``lgprjax map``: build a subsurface database, tell what one covers and whether it can be trusted."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import numpy as np
import tyro
from rich.table import Table
from rich.text import Text
from tyro.conf import Positional, arg

from lgprjax.cli.errors import UsageError, require_files
from lgprjax.cli.map_info import MapInfo, print_info
from lgprjax.cli.map_pictures import draw_map_passes
from lgprjax.cli.map_refine import MapRefine
from lgprjax.cli.map_update import MapUpdate
from lgprjax.cli.progress import console, progress_bar
from lgprjax.errors import InputError

if TYPE_CHECKING:
    from lgprjax.archive import MapHealth, RouteInterval
    from lgprjax.formats import MapFile

_VERDICT_STYLE = {"good": "green", "look": "yellow", "bad": "bold red"}
_INTERVALS = 4  # named in the table; all of them are in the JSON
_OUTPUTS = ("places.csv", "agreement.csv", "strips.png", "passes.png", "findings.json")


@dataclass(frozen=True)
class MapBuild:
    """Build a subsurface database from drive logs over the same ground."""

    drives: Annotated[
        Positional[tuple[Path, ...]],
        arg(metavar="DRIVE...", help="drive logs; the first gives the map its origin and its processing"),
    ]
    output: Annotated[Path, arg(aliases=["-o"], help="database to write, M.map.h5")]
    centre_frequency_mhz: float | None = None
    """centre frequency of the antennas, where the log does not say"""
    travel_time_ns: float | None = None
    """how deep the profiles go at most; without it to the recording's end, of sweeps fifteen periods"""
    precision: Literal["full", "standard", "small"] = "standard"
    """how closely traces are stored: full as 16-bit samples, standard in some two bits a number, small in fewer"""
    force: bool = False
    """replace an output that exists"""

    def run(self) -> None:
        """Build."""
        from lgprjax.archive import build_map
        from lgprjax.formats import MAP_PRECISIONS, DriveLog, locked_map

        require_files(self.drives, "drives")
        if self.centre_frequency_mhz is not None and not 1.0 <= self.centre_frequency_mhz <= 1e4:
            raise UsageError(f"--centre-frequency-mhz: expected 1 to 10000, found {self.centre_frequency_mhz:g}")
        if self.travel_time_ns is not None and not 1.0 <= self.travel_time_ns <= 1e5:
            raise UsageError(f"--travel-time-ns: expected 1 to 100000, found {self.travel_time_ns:g}")
        scans = 0
        for path in self.drives:
            with DriveLog.open(path) as log:
                scans += log.scans
        frequency = None if self.centre_frequency_mhz is None else 1e6 * self.centre_frequency_mhz
        with locked_map(self.output), progress_bar("building map", scans) as progress:
            build_map(
                self.drives,
                self.output,
                centre_frequency_hz=frequency,
                travel_time_ns=self.travel_time_ns,
                precision=MAP_PRECISIONS[self.precision],
                force=self.force,
                progress=progress,
                stage=progress.stage,
            )
        console.print(f"wrote {self.output}", highlight=False, markup=False, soft_wrap=True)
        print_info(self.output)


@dataclass(frozen=True)
class MapVerify:
    """Can this map be trusted: coverage, holes, weak or ambiguous ground, baselines that disagree."""

    file: Annotated[Positional[Path], arg(metavar="MAP", help="the database, M.map.h5")]
    output: Annotated[
        Path | None, arg(aliases=["-o"], help="folder for strips.png, passes.png, two tables and findings.json")
    ] = None
    json: Path | None = None
    """also write the findings to this file"""
    force: bool = False
    """replace outputs that exist"""

    def run(self) -> None:
        """Measure and judge; findings are findings, not failures."""
        from lgprjax.archive import places_of, verify_map
        from lgprjax.cli.figures import write_figures
        from lgprjax.formats import MapFile

        outputs = [] if self.output is None else [self.output / name for name in _OUTPUTS]
        for path in [*outputs, *([] if self.json is None else [self.json])]:
            if path.exists() and not self.force:
                raise InputError(path, "output", "a new file, or --force", "the file exists")
        if self.output is not None and self.output.exists() and not self.output.is_dir():
            raise InputError(self.output, "output", "a folder", "a file")
        with MapFile.open(self.file) as source:
            with progress_bar("verifying map", places_of(source)) as progress:
                health = verify_map(source, progress)
            _print_health(self.file, health)
            if self.output is not None:
                self.output.mkdir(parents=True, exist_ok=True)
                _write_health(self.output, source, health, self.force)
                console.print(f"pictures and tables: {self.output}", highlight=False, markup=False, soft_wrap=True)
        if self.json is not None:
            write_figures(self.json, health.as_json(), force=self.force)


def _print_health(path: Path, health: "MapHealth") -> None:
    title = f"{path.name}: {health.length_m:.0f} m of route, {health.baselines} baselines"
    table = Table("finding", "value", "look / bad at", "verdict", "where along the route", title=title)
    for finding in health.findings:
        verdict = Text(finding.verdict, _VERDICT_STYLE[finding.verdict])
        limits = f"{finding.look:g} / {finding.bad:g}"
        value = f"{finding.value:.3g} {finding.unit}".strip()
        table.add_row(finding.kind, value, limits, verdict, _where(finding.where))
    console.print(table)
    for finding in health.findings:
        console.print(f"{finding.verdict}: {finding.kind}: {finding.text}", highlight=False, markup=False)
    per_km = 1e3 * health.seconds / health.length_m / 60.0
    took = f"took {health.seconds:.0f} s, {per_km:.1f} min a kilometre of route"
    console.print(f"{path}: map {health.verdict} ({took})", highlight=False, markup=False, soft_wrap=True)


def _where(intervals: "tuple[RouteInterval, ...]") -> str:
    """The longest intervals in metres along the route, in order."""
    longest = sorted(intervals, key=lambda each: each.start_m - each.stop_m)[:_INTERVALS]
    parts = []
    for each in sorted(longest, key=lambda each: each.start_m):
        named = [f"{what} {number}" for what, number in (("baseline", each.drive), ("channel", each.channel))]
        known = [name for name, number in zip(named, (each.drive, each.channel), strict=True) if number is not None]
        parts.append(f"{each.start_m:.0f}-{each.stop_m:.0f} m" + (f" ({', '.join(known)})" if known else ""))
    more = len(intervals) - len(longest)
    return ", ".join(parts) + (f", {more} more" if more > 0 else "")


def _write_health(folder: Path, source: "MapFile", health: "MapHealth", force: bool) -> None:
    from lgprjax.archive.map_findings import WEAK_REPEATS, WIDE_OFFSET_M
    from lgprjax.cli.figures import write_figures
    from lgprjax.formats import atomic_output
    from lgprjax.registration import MIN_OVERLAP
    from lgprjax.report import BaselineStrip, MapStrips, draw_map_strips

    for name, values in (("places.csv", health.places), ("agreement.csv", health.agreement)):
        with atomic_output(folder / name, force) as temporary:
            values.to_csv(temporary, index=False, float_format="%.12g")
    write_figures(folder / "findings.json", health.as_json(), force=force)
    draw_map_passes(source, health, folder / "passes.png", force=force)
    survey, agreement = health.survey, health.agreement
    strips = []
    for drive in sorted(set(agreement["baseline"])):
        mine = agreement[agreement["baseline"] == drive].sort_values("route_m")
        ok = mine["code"].to_numpy() == "ok"
        strips.append(
            BaselineStrip(
                at_m=mine["route_m"].to_numpy(),
                along_m=np.where(ok, mine["along_m"].to_numpy(), np.nan),
                cross_m=np.where(ok, mine["cross_m"].to_numpy(), np.nan),
                correlation=mine["correlation"].to_numpy(),
            )
        )
    draw_map_strips(
        MapStrips(
            name=health.name,
            at_m=survey.route.at_m,
            track_m=survey.route.pose[:, :2],
            width_m=survey.ground.width_m,
            array_m=source.description.array_width_m,
            overlap=survey.ground.overlap,
            passes=survey.ground.passes.astype(np.float64),
            repeats=survey.signal.repeats,
            likeness=survey.signal.likeness,
            ambiguous=survey.signal.ambiguous,
            baselines=tuple(strips),
            least_overlap=MIN_OVERLAP,
            least_repeats=WEAK_REPEATS,
            widest_offset_m=WIDE_OFFSET_M,
            marked=tuple((f.kind, each.start_m, each.stop_m) for f in health.findings for each in f.where),
        ),
        folder / "strips.png",
        force=force,
    )


MapVerb = (
    Annotated[MapBuild, tyro.conf.subcommand("build")]
    | Annotated[MapInfo, tyro.conf.subcommand("info")]
    | Annotated[MapVerify, tyro.conf.subcommand("verify")]
    | Annotated[MapRefine, tyro.conf.subcommand("refine")]
    | Annotated[MapUpdate, tyro.conf.subcommand("update")]
)
