"""``lgprjax cover``: plan a field, record the ground worked, export the record."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from rich.table import Table
from tyro.conf import Positional, arg

from lgprjax.cli.figures import check_outputs, write_figures
from lgprjax.cli.terminal import UsageError, console, progress_bar, require_files, working
from lgprjax.errors import InputError

if TYPE_CHECKING:
    from lgprjax.worked.layers import CoverFigures
    from lgprjax.worked.plans import FieldPlan


# Common parts of the verbs of ``lgprjax cover``.


def print_cover_figures(title: str, figures: "CoverFigures") -> None:
    """Print the statement of a record, and its limits."""
    from lgprjax.worked.layers import percent, square_metres

    table = Table("layer", "processed", "uncertain", "not processed", "of the field", title=title)
    for layer in figures.layers:
        areas = (square_metres(each) for each in (layer.processed_m2, layer.uncertain_m2, layer.not_processed_m2))
        table.add_row(f"{100.0 * layer.level:g} %", *areas, percent(layer.share))
    console.print(table)
    stops = sum(figures.stops.values())
    say(f"passes: {figures.passes}, {figures.way_m:.0f} m; stops: {stops}; {figures.hours:.2f} h")
    for layer in figures.layers:
        say(layer.sentence)
    say("A machine pass is not clearance: the ground must be searched before it is released.")


def say(text: str) -> None:
    """Print a line without markup."""
    console.print(text, highlight=False, markup=False, soft_wrap=True)


# ``lgprjax cover export``: export formats of a record of a worked field.


@dataclass(frozen=True)
class CoverExport:
    """Export a record: GeoPackage, GeoJSON, KML, turning points as CSV, and a report to sign.

    Layers: perimeter, swaths, processed ground at each confidence, gaps, stops, events; all on WGS-84.
    """

    record: Annotated[Positional[Path], arg(metavar="R.worked.h5", help="record of a worked field")]
    output: Annotated[Path, arg(aliases=["-o"], metavar="DIR", help="folder for the outputs, created if missing")]
    organisation: str = "not stated"
    """responsible organisation, named in every shape and in the report"""
    benchmark_deg: Annotated[tuple[float, float] | None, arg(metavar="LATITUDE LONGITUDE")] = None
    """marked reference point of bearings and distances; default: the first corner"""
    confidence: Annotated[tuple[float, ...], arg(metavar="LEVEL...")] = ()
    """probabilities at which ground counts as processed, such as 0.99; default: those of the record"""
    json: Path | None = None
    """also write the figures to this file, or - for standard output"""
    force: bool = False
    """replace outputs that exist"""

    def run(self) -> None:
        """Export."""
        from lgprjax.formats import read_worked
        from lgprjax.report.handover import hand_over, handover_files
        from lgprjax.worked.layers import at_levels, checked_levels, cover_figures

        levels = checked_levels(self.confidence) if self.confidence else None
        outputs = handover_files(self.record, self.output, self.benchmark_deg, force=self.force)
        check_outputs(self.json, force=self.force)
        record = read_worked(self.record)
        if levels is not None:
            record = at_levels(record, levels)
        figures = cover_figures(record)
        with working("drawing layers and report"):
            hand_over(
                self.record,
                record,
                self.output,
                organisation=self.organisation,
                benchmark_deg=self.benchmark_deg,
                force=self.force,
            )
        print_cover_figures(self.record.name, figures)
        for path in outputs:
            say(f"wrote {path}")
        if self.json is not None:
            write_figures(self.json, figures.as_json(), force=self.force)


@dataclass(frozen=True)
class CoverPlanVerb:
    """Plan parallel swaths over a field, in driving order, with turns that the vehicle can drive.

    FIELD is a polygon on WGS-84 (GeoJSON with its holes and polygons of kind keep_out, KML, shapefile, or a CSV of its
    corners), a CSV of three corners (latitude_deg,longitude_deg, in the order in which they were driven to), or the
    folder of a run in which three corners were marked. With --gaps only the gaps of a record are planned.
    """

    field: Annotated[
        Positional[Path], arg(metavar="FIELD", help="X.geojson, X.kml, X.shp, X.csv, or the folder of a run")
    ]
    output: Annotated[Path, arg(aliases=["-o"], metavar="X.cover.geojson", help="plan to write")]
    vehicle: Path
    """vehicle file of a skid-steer vehicle: its tool and its smallest radius"""
    overlap: float = 0.2
    """least overlap of neighbouring swaths, in tool widths"""
    order: Literal["zamboni", "boustrophedon", "racetrack", "free", "best"] = "zamboni"
    """zamboni: first, middle, second, ... with wide turns to one side; boustrophedon: each swath next to the last;
    racetrack: Zamboni in blocks; free: the cheapest next, around keep-outs and in reverse; best: the fastest of all"""
    turning_room_m: float | None = None
    """distance that the vehicle may go beyond the perimeter, on safe ground; default: as far as the turns need"""
    sides: Annotated[tuple[str, ...], arg(metavar="SIDE:ROOM...")] = ()
    """safe ground outside each side, in metres, or none; side 1 begins at the first corner: 1:none 3-5:4.5 rest:6"""
    keep_out_buffer_m: float = 0.5
    """distance kept from keep-outs for which the file states none"""
    clearance_m: float = 0.25
    """distance kept between vehicle or tool and the border of declared ground"""
    speed_mps: float = 0.3
    """speed on straights, to estimate times"""
    confidence: float | None = None
    """probability that one pass is to reach everywhere: sets the overlap, and adds swaths beyond the border"""
    drop_out_s: float = 0.0
    """with --confidence: longest GNSS outage to allow for"""
    heading_deg: float | None = None
    """compass heading of the first swath; default: along the first side"""
    gaps: Annotated[Path | None, arg(metavar="R.worked.h5")] = None
    """record of this field: plan only cells below --level"""
    level: float = 0.95
    """with --gaps: probability at which a cell counts as worked"""
    least_width_m: float = 0.1
    """with --gaps: skip narrower gaps"""
    picture: Path | None = None
    """also draw the plan to this PNG: swaths in their order, turns, keep-outs, fence"""
    json: Path | None = None
    """also write the figures to this file, or - for standard output"""
    force: bool = False
    """replace outputs that exist"""

    def run(self) -> None:
        """Plan."""
        from lgprjax.formats import read_worked
        from lgprjax.worked.plans import PlanOptions, check_plan_options, plan_field, save_cover_plan

        if self.gaps is None and (self.level, self.least_width_m) != (0.95, 0.1):
            raise UsageError("--level and --least-width-m: need --gaps as well")
        options = PlanOptions(
            self.overlap,
            self.order,
            self.turning_room_m,
            self.heading_deg,
            self.sides,
            self.keep_out_buffer_m,
            self.clearance_m,
            self.speed_mps,
            self.confidence,
            self.drop_out_s,
            self.least_width_m,
        )
        check_plan_options(options, self.level)
        check_outputs(self.output, self.json, self.picture, force=self.force)
        worked = None if self.gaps is None else read_worked(self.gaps)
        with working("laying lines and turns"):
            made = plan_field(self.field, self.vehicle, options, worked=worked, level=self.level)
        if made is None:
            wide = f" that are {self.least_width_m:g} m wide" if self.least_width_m > 0.0 else ""
            found = f"none below {100.0 * self.level:g} %{wide}: nothing to plan"
            raise InputError(str(self.gaps), "gaps", "cells that are not worked", found)
        plan = made.plan
        save_cover_plan(self.output, plan, force=self.force)
        figures = _plan_figures(made, self.speed_mps)
        _print_plan(self.output.name, figures)
        if len(made.costs) > 1:
            _print_costs(made)
        room = f"{made.ground_m:.2f} m beyond the perimeter"
        say(f"the whole vehicle with its tool, and the fence, keep within {room}: this ground must be safe to drive on")
        for note in made.notes:
            say(note)
        if plan.pattern.unreached:
            say(f"not reached within this room: {len(plan.pattern.unreached)} swaths, marked unreached in the plan")
        say(f"wrote {self.output}")
        if self.picture is not None:
            _draw(made, self.picture, figures, force=self.force)
            say(f"wrote {self.picture}")
        if self.json is not None:
            write_figures(self.json, figures, force=self.force)


@dataclass(frozen=True)
class CoverRecord:
    """Combine recorded runs into a record of the ground worked, cell by cell.

    A cell's probability is that of its best pass: the tool was over it, by the pose and its uncertainty at the time,
    switched on, turning and at its depth. Several runs combine by the largest probability. A machine pass is not
    clearance.
    """

    runs: Annotated[
        Positional[tuple[Path, ...]], arg(metavar="RUN...", help="folders of recorded runs; with --cart, receiver logs")
    ]
    plan: Annotated[
        tuple[Path, ...], arg(metavar="X.cover.geojson...", help="plan of the field, followed by those of its gaps")
    ]
    output: Annotated[Path, arg(aliases=["-o"], metavar="R.worked.h5", help="record to write")]
    evidence: Annotated[Path | None, arg(metavar="E.toml")] = None
    """task, hazard area, machine, operator, control points, finds and detonations; see docs/coverage.md"""
    cart: Annotated[Path | None, arg(metavar="V.vehicle.toml")] = None
    """vehicle file of a hand cart; RUN... are then logs of its GNSS receiver, NMEA or UBX. Its heading is taken from
    its smoothed course; whether the tool worked is not measured, and the record says so"""
    smooth: bool = False
    """smooth the poses of every run, forward and backward, from its recorded messages: smaller sigmas after GNSS
    outages, and no credit for what later evidence contradicts; needs the files that the run was driven with"""
    confidence: Annotated[tuple[float, ...], arg(metavar="LEVEL...")] = (0.95, 0.996)
    """probabilities at which cells are judged; those of the cells are kept, so the export can judge at others"""
    cell_m: float = 0.05
    """side length of a cell"""
    json: Path | None = None
    """also write the figures to this file, or - for standard output"""
    force: bool = False
    """replace outputs that exist"""

    def run(self) -> None:
        """Record."""
        from lgprjax.formats import write_worked
        from lgprjax.worked.evidence import read_evidence, shared_error_lines
        from lgprjax.worked.layers import checked_levels, cover_figures
        from lgprjax.worked.plans import open_cover_plan
        from lgprjax.worked.record import read_cover_run, record_cover

        require_files(self.runs, "runs")
        if not 0.01 <= self.cell_m <= 1.0:
            raise UsageError(f"--cell-m: expected 0.01 to 1, found {self.cell_m:g}")
        if self.cart is not None and self.smooth:
            raise UsageError("--smooth: not with --cart, which smooths")
        levels = checked_levels(self.confidence)
        check_outputs(self.output, self.json, force=self.force)
        evidence = None if self.evidence is None else read_evidence(self.evidence)
        plans = [open_cover_plan(path) for path in self.plan]
        runs = []
        for folder in self.runs:
            with working(f"reading {folder}"):
                if self.cart is None:
                    runs.append(read_cover_run(folder))
                else:
                    from lgprjax.runtime.cart import read_cart_run

                    runs.append(read_cart_run(folder, self.cart, plans[0]))
            if self.smooth:
                from lgprjax.runtime.smoothed import smooth_run

                with working(f"smoothing {folder}"):
                    runs[-1], _ = smooth_run(runs[-1])
        with progress_bar("working the cells", sum(len(run.rows) for run in runs), "ticks") as progress:
            record = record_cover(plans, runs, cell_m=self.cell_m, levels=levels, evidence=evidence, progress=progress)
        write_worked(self.output, record, force=self.force)
        figures = cover_figures(record)
        print_cover_figures(self.output.name, figures)
        for words, sentence in shared_error_lines(record.provenance["evidence"]):
            say(f"{words}: {sentence}")
        say(f"wrote {self.output}")
        if self.json is not None:
            write_figures(self.json, figures.as_json(), force=self.force)


def _plan_figures(made: "FieldPlan", speed_mps: float) -> dict[str, Any]:
    from lgprjax.coverage.pattern import driving_time_s

    plan = made.plan
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
        "safe_ground_m": round(made.ground_m, 2),
        "time_s": round(driving_time_s(pattern, speed_mps), 1),
        "keep_outs": len(plan.keep_outs_m),
        "unreached": len(pattern.unreached),
    }


def _draw(made: "FieldPlan", path: Path, figures: dict[str, Any], *, force: bool) -> None:
    import numpy as np

    from lgprjax.report.coverage import CoverPlanPicture, draw_cover_plan
    from lgprjax.runtime.coverage.overview import turn_ways

    plan, pattern, computed = made.plan, made.plan.pattern, made.plan.computed_corner
    ways = turn_ways(pattern)
    seconds = figures["time_s"]
    draw_cover_plan(
        CoverPlanPicture(
            title=f"{plan.name}: {len(pattern.lines)} swaths, {pattern.length_m:.0f} m, {seconds / 3600.0:.2f} h",
            caption=f"Order {pattern.settings.order}; the darker a swath, the earlier. Swaths are of the tool's "
            "centre, turns of the vehicle's reference point.",
            perimeter_m=pattern.field.perimeter_m,
            ground_m=tuple(ring for part in made.ground.polygons_m for ring in part),
            keep_outs_m=plan.keep_outs_m,
            swaths_m=tuple(np.stack([line.start_m, line.end_m]) for line in pattern.lines),
            forward_m=ways.forward_m,
            reverse_m=ways.reverse_m,
            width_m=plan.tool.width_m,
            computed_m=None if computed is None else pattern.field.perimeter_m[computed],
        ),
        path,
        force=force,
    )


def _print_costs(made: "FieldPlan") -> None:
    table = Table(
        "order", "heading", "swaths", "way", "time", "beyond the perimeter", title="orders, the chosen one first"
    )
    for cost in made.costs:
        heading = f"{cost.heading_deg:.0f}°" if math.isfinite(cost.heading_deg) else ""
        if cost.refused:
            table.add_row(cost.order, heading, "refused", "", "", "")
            continue
        hours = f"{cost.time_s / 3600.0:.2f} h"
        table.add_row(
            cost.order, heading, f"{cost.swath_m:.0f} m", f"{cost.way_m:.0f} m", hours, f"{cost.ground_m:.2f} m"
        )
    console.print(table)
    # One reason may stand for several orders and headings.
    orders: dict[str, list[str]] = {}
    for cost in made.costs:
        if cost.refused and cost.order not in orders.setdefault(cost.refused, []):
            orders[cost.refused].append(cost.order)
    for reason, names in orders.items():
        say(f"{', '.join(names)} refused: {reason}")


def _for_people(figures: dict[str, Any]) -> Iterator[tuple[str, str]]:
    """A plan's quantities in words, with their units."""
    yield "field", f"{figures['field']}, {figures['area_m2']:.1f} m²"
    yield "first corner, latitude and longitude", f"{figures['latitude_deg']:.7f}°, {figures['longitude_deg']:.7f}°"
    yield "vehicle", str(figures["vehicle"])
    yield "order", str(figures["order"])
    yield "swaths", f"{figures['lines']}, {figures['line_length_m']:.0f} m in all, {figures['spacing_m']:.2f} m apart"
    yield "whole way", f"{figures['length_m']:.0f} m, {figures['time_s'] / 3600.0:.2f} h"
    if figures["tightest_radius_m"] is not None:
        yield "tightest turn", f"{figures['tightest_radius_m']:.2f} m of radius"
    if figures["keep_outs"]:
        yield "keep-outs", str(figures["keep_outs"])
    if figures["unreached"]:
        yield "swaths that no way leads to", str(figures["unreached"])


def _print_plan(title: str, figures: dict[str, Any]) -> None:
    table = Table("quantity", "value", title=title)
    for name, value in _for_people(figures):
        table.add_row(name, value)
    console.print(table, highlight=False, markup=False)
