"""``lgprjax cover``: plan a field, record what was worked of it, hand the record over."""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro
from rich.table import Table
from tyro.conf import Positional, arg

from lgprjax.cli.cover_export import CoverExport
from lgprjax.cli.cover_words import print_cover_figures, refuse_existing, say
from lgprjax.cli.errors import UsageError, require_files
from lgprjax.cli.progress import console, progress_bar, working
from lgprjax.errors import InputError

if TYPE_CHECKING:
    from lgprjax.formats import CoverPlan

_PLAN, _RECORD = ".cover.geojson", ".worked.h5"


@dataclass(frozen=True)
class CoverPlanVerb:
    """Lay parallel lines over a field, in driving order, with turns that the vehicle can drive.

    FIELD is a GeoJSON polygon on WGS-84, a CSV of three corners (latitude_deg,longitude_deg, in the order in which they
    were driven to), or the folder of a run in which three corners were marked. With --gaps only what a record leaves is
    planned for.
    """

    field: Annotated[Positional[Path], arg(metavar="FIELD", help="X.geojson, X.csv, or the folder of a run")]
    output: Annotated[Path, arg(aliases=["-o"], metavar="X.cover.geojson", help="plan to write")]
    vehicle: Path
    """vehicle file of a skid-steer vehicle: its tool and its smallest radius"""
    overlap: float = 0.2
    """least share of the tool's width that neighbouring lines both work"""
    order: Literal["zamboni", "boustrophedon"] = "zamboni"
    """zamboni: first, middle, second, ... with wide turns to one hand; boustrophedon: each line next to the last"""
    turning_room_m: float | None = None
    """how far beyond the perimeter the vehicle may go, on safe ground; without it as far as the turns need"""
    heading_deg: float | None = None
    """compass heading of the first line; without it along the first side"""
    gaps: Annotated[Path | None, arg(metavar="R.worked.h5")] = None
    """record of this field: plan what it leaves below the level"""
    level: float = 0.95
    """with --gaps: probability that a cell needs to be left out"""
    json: Path | None = None
    """also write the figures to this file"""
    force: bool = False
    """replace outputs that exist"""

    def run(self) -> None:
        """Plan."""
        from lgprjax.archive.cover_plans import PlanOptions, make_cover_plan, save_cover_plan
        from lgprjax.cli.figures import write_figures
        from lgprjax.formats import read_worked

        _check_suffix("--output", self.output, _PLAN)
        if not 0.0 <= self.overlap < 1.0:
            raise UsageError(f"--overlap: expected a fraction from 0 to below 1, found {self.overlap:g}")
        if self.turning_room_m is not None and not 0.0 <= self.turning_room_m <= 1000.0:
            raise UsageError(f"--turning-room-m: expected 0 to 1000, found {self.turning_room_m:g}")
        if self.heading_deg is not None and not 0.0 <= self.heading_deg <= 360.0:
            raise UsageError(f"--heading-deg: expected 0 to 360, found {self.heading_deg:g}")
        if not 0.5 < self.level < 1.0:
            raise UsageError(f"--level: expected above 0.5 and below 1, found {self.level:g}")
        refuse_existing((self.output, self.json), self.force)
        worked = None if self.gaps is None else read_worked(self.gaps)
        options = PlanOptions(self.overlap, self.order, self.turning_room_m, self.heading_deg)
        with working("laying lines and turns"):
            plan = make_cover_plan(self.field, self.vehicle, options, worked=worked, level=self.level)
        if plan is None:
            found = f"none below {100.0 * self.level:g} %: nothing to plan"
            raise InputError(str(self.gaps), "gaps", "cells that are not worked", found)
        save_cover_plan(self.output, plan, force=self.force)
        figures = _plan_figures(plan)
        _print_table(self.output.name, figures)
        room_m = plan.pattern.settings.turning_room_m
        say(f"the vehicle turns up to {room_m:g} m beyond the perimeter: that ground must be safe to drive on")
        if plan.pattern.unreached:
            say(f"not reached within that room: {len(plan.pattern.unreached)} lines, in the plan as unreached")
        say(f"wrote {self.output}")
        if self.json is not None:
            write_figures(self.json, figures, force=self.force)


@dataclass(frozen=True)
class CoverRecord:
    """What the recorded runs worked of a field, cell by cell.

    A cell's probability is that of its best pass: the tool was over it, by the pose and its uncertainty at the time,
    told on, turning and at its depth. Several runs add up by the largest. A machine pass is not clearance.
    """

    runs: Annotated[Positional[tuple[Path, ...]], arg(metavar="RUN...", help="folders of recorded runs")]
    plan: Annotated[
        tuple[Path, ...], arg(metavar="X.cover.geojson...", help="plan of the field; then those of its gaps")
    ]
    output: Annotated[Path, arg(aliases=["-o"], metavar="R.worked.h5", help="record to write")]
    cell_m: float = 0.05
    """side of a cell"""
    json: Path | None = None
    """also write the figures to this file"""
    force: bool = False
    """replace outputs that exist"""

    def run(self) -> None:
        """Record."""
        from lgprjax.archive.cover_figures import cover_figures
        from lgprjax.archive.cover_plans import open_cover_plan
        from lgprjax.archive.cover_record import record_cover
        from lgprjax.archive.cover_runs import read_cover_run
        from lgprjax.cli.figures import write_figures
        from lgprjax.formats import write_worked

        require_files(self.runs, "runs")
        require_files(self.plan, "--plan")
        _check_suffix("--output", self.output, _RECORD)
        if not 0.01 <= self.cell_m <= 1.0:
            raise UsageError(f"--cell-m: expected 0.01 to 1, found {self.cell_m:g}")
        refuse_existing((self.output, self.json), self.force)
        plans = [open_cover_plan(path) for path in self.plan]
        runs = []
        for folder in self.runs:
            with working(f"reading {folder}"):
                runs.append(read_cover_run(folder))
        with progress_bar("working the cells", sum(len(run.rows) for run in runs)) as progress:
            record = record_cover(plans, runs, cell_m=self.cell_m, progress=progress)
        write_worked(self.output, record, force=self.force)
        figures = cover_figures(record)
        print_cover_figures(self.output.name, figures)
        say(f"wrote {self.output}")
        if self.json is not None:
            write_figures(self.json, figures.as_json(), force=self.force)


def _check_suffix(option: str, path: Path, suffix: str) -> None:
    if not path.name.endswith(suffix):
        raise UsageError(f"{option}: expected a file name that ends in {suffix}, found {path.name!r}")


def _plan_figures(plan: "CoverPlan") -> dict[str, object]:
    pattern, frame = plan.pattern, plan.frame
    tightest_m = pattern.tightest_radius_m
    return {
        "field": plan.name,
        "latitude_deg": frame.latitude_deg,
        "longitude_deg": frame.longitude_deg,
        "area_m2": round(pattern.field.area_m2, 2),
        "vehicle": plan.vehicle_name,
        "order": pattern.settings.order,
        "lines": len(pattern.lines),
        "spacing_m": round(pattern.spacing_m, 4),
        "line_length_m": round(pattern.line_length_m, 2),
        "length_m": round(pattern.length_m, 2),
        "tightest_radius_m": round(tightest_m, 3) if math.isfinite(tightest_m) else None,
        "turning_room_m": pattern.settings.turning_room_m,
        "unreached": len(pattern.unreached),
    }


def _print_table(title: str, figures: dict[str, object]) -> None:
    table = Table("quantity", "value", title=title)
    for name, value in figures.items():
        table.add_row(name, str(value))
    console.print(table)


CoverVerb = (
    Annotated[CoverPlanVerb, tyro.conf.subcommand("plan")]
    | Annotated[CoverRecord, tyro.conf.subcommand("record")]
    | Annotated[CoverExport, tyro.conf.subcommand("export")]
)
