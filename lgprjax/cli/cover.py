"""``lgprjax cover``: plan swaths over a field, record the area worked, export the record."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from rich.table import Table
from tyro.conf import Positional, arg

from lgprjax.cli.figures import check_outputs, write_figures
from lgprjax.cli.terminal import UsageError, console, counted, progress_bar, require_files, say, verdict, working
from lgprjax.errors import ArgumentError, InputError

if TYPE_CHECKING:
    from lgprjax.worked.layers import CoverFigures
    from lgprjax.worked.plans import FieldPlan


# Common parts of the commands of ``lgprjax cover``.


def print_cover_figures(title: str, figures: "CoverFigures") -> None:
    """Print the areas of a record and the limits of the statement."""
    from lgprjax.worked.layers import percent, square_metres

    table = Table("level", "processed", "uncertain", "not processed", "share of field", title=title)
    for layer in figures.layers:
        areas = (square_metres(each) for each in (layer.processed_m2, layer.uncertain_m2, layer.not_processed_m2))
        table.add_row(f"{100.0 * layer.level:g} %", *areas, percent(layer.share))
    console.print(table)
    stops = sum(figures.stops.values())
    say(f"passes: {figures.passes}, {figures.way_m:.0f} m; stops: {stops}; {figures.hours:.2f} h")
    for layer in figures.layers:
        say(layer.sentence)
    say("A machine pass is not clearance: the ground must be searched before it is released.")


def _cover_verdict(path: Path, figures: "CoverFigures") -> str:
    """Processed share at the first level of a record."""
    from lgprjax.worked.layers import percent

    layer = figures.layers[0]
    return f"{path}: {percent(layer.share)} of the field processed at {100.0 * layer.level:g} %"


def _levels(given: Sequence[float]) -> tuple[float, ...]:
    """Checked values of ``--level``, in rising order."""
    from lgprjax.worked.layers import checked_levels

    try:
        return checked_levels(given)
    except ArgumentError as error:
        raise ArgumentError("level", error.expected, error.found) from None


# ``lgprjax cover export``: export formats of a record.


@dataclass(frozen=True)
class CoverExport:
    """Export a record of the area worked: GeoPackage, GeoJSON, KML, turning points as CSV, and a report to sign.

    Layers in WGS-84: perimeter, swaths, processed ground at each level, gaps, stops, events.
    """

    record: Annotated[Positional[Path], arg(metavar="R.worked.h5", help="record of the area worked")]
    output: Annotated[Path, arg(aliases=["-o"], metavar="DIR", help="folder for the outputs, created if missing")]
    organisation: str = "not stated"
    """responsible organisation, in every layer and in the report"""
    benchmark_deg: Annotated[tuple[float, float] | None, arg(metavar="LATITUDE LONGITUDE")] = None
    """surveyed reference point for bearings and distances; default: the first corner"""
    level: Annotated[tuple[float, ...], arg(metavar="LEVEL...")] = ()
    """probabilities at which a cell counts as processed, such as 0.99; default: the levels of the record"""
    json: Path | None = None
    """JSON file for the figures; - for standard output"""
    force: bool = False
    """replace existing outputs"""

    def run(self) -> None:
        """Export."""
        from lgprjax.formats import read_worked
        from lgprjax.report.handover import hand_over, handover_files
        from lgprjax.worked.layers import at_levels, cover_figures

        levels = _levels(self.level) if self.level else None
        outputs = handover_files(self.record, self.output, self.benchmark_deg, force=self.force)
        check_outputs(self.json, force=self.force)
        record = read_worked(self.record)
        if levels is not None:
            record = at_levels(record, levels)
        figures = cover_figures(record)
        with working("writing layers and report"):
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
        verdict(f"{_cover_verdict(self.record, figures)}; {counted(len(outputs), 'file')} in {self.output}")


@dataclass(frozen=True)
class CoverPlanVerb:
    """Plan parallel swaths over a field, in driving order, with drivable turns.

    FIELD is a polygon in WGS-84 (GeoJSON with holes and polygons of kind keep_out, KML, KMZ, shapefile, CSV), a CSV of
    three corners (latitude_deg,longitude_deg, in driving order), or the folder of a run with marked corners.
    """

    field: Annotated[
        Positional[Path], arg(metavar="FIELD", help="X.geojson, X.kml, X.kmz, X.shp, X.csv, or a run's folder")
    ]
    output: Annotated[Path, arg(aliases=["-o"], metavar="X.cover.geojson", help="plan to write")]
    vehicle: Path
    """vehicle file of a skid-steer vehicle, with tool and smallest turning radius"""
    polygon: Annotated[str | None, arg(metavar="NAME")] = None
    """name or number of the field's polygon, of several"""
    overlap: float = 0.2
    """minimum overlap of neighbouring swaths, in tool widths"""
    order: Literal["zamboni", "boustrophedon", "racetrack", "free", "best"] = "best"
    """zamboni: first, middle, second, ... swath, wide turns to one side; boustrophedon: neighbouring swaths; racetrack:
    Zamboni in blocks; free: cheapest next swath, around keep-outs, with reversing; best: the fastest of these"""
    turning_room_m: float | None = None
    """width of safe ground outside the perimeter, for turns; default: as much as the turns need"""
    sides: Annotated[tuple[str, ...], arg(metavar="SIDE:ROOM...")] = ()
    """width of safe ground outside each side, in metres, or none; side 1 starts at corner 1: 1:none 3-5:4.5 rest:6"""
    keep_out_buffer_m: float = 0.5
    """distance to keep-outs without a distance in the field file"""
    clearance_m: float = 0.25
    """distance of vehicle and tool from the border of the safe ground"""
    speed_mps: float = 0.3
    """speed on straight swaths, for the time estimate"""
    confidence: float | None = None
    """probability that one pass covers every place: sets the overlap, and adds swaths outside the border"""
    drop_out_s: float = 0.0
    """with --confidence: longest GNSS outage"""
    heading_deg: float | None = None
    """compass heading of the first swath; default: along the first side"""
    gaps: Annotated[Path | None, arg(metavar="R.worked.h5")] = None
    """record of this field: plan only the cells below --level"""
    level: float = 0.95
    """with --gaps: probability at which a cell counts as processed"""
    least_width_m: float = 0.1
    """with --gaps: minimum width of a gap; narrower gaps are skipped"""
    picture: Path | None = None
    """draw the plan to this PNG: swaths in driving order, turns, keep-outs, fence"""
    json: Path | None = None
    """JSON file for the figures; - for standard output"""
    force: bool = False
    """replace existing outputs"""

    def run(self) -> None:
        """Plan."""
        from lgprjax.formats import read_worked
        from lgprjax.worked.plans import PlanOptions, check_plan_options, plan_field, save_cover_plan

        if self.gaps is None and (self.level, self.least_width_m) != (0.95, 0.1):
            raise UsageError("--level and --least-width-m: need --gaps as well")
        options = PlanOptions(
            overlap=self.overlap,
            order=self.order,
            turning_room_m=self.turning_room_m,
            heading_deg=self.heading_deg,
            sides=self.sides,
            keep_out_buffer_m=self.keep_out_buffer_m,
            clearance_m=self.clearance_m,
            speed_mps=self.speed_mps,
            confidence=self.confidence,
            drop_out_s=self.drop_out_s,
            least_width_m=self.least_width_m,
            polygon=self.polygon,
        )
        check_plan_options(options, self.level)
        check_outputs(self.output, self.json, self.picture, force=self.force)
        worked = None if self.gaps is None else read_worked(self.gaps)
        with working("planning swaths and turns"):
            made = plan_field(self.field, self.vehicle, options, worked=worked, level=self.level)
        if made is None:
            wide = f" and at least {self.least_width_m:g} m wide" if self.least_width_m > 0.0 else ""
            found = f"no gap below {100.0 * self.level:g} %{wide}"
            raise InputError(str(self.gaps), "gaps", "cells that are not processed", found)
        plan = made.plan
        save_cover_plan(self.output, plan, force=self.force)
        figures = _plan_figures(made, self.speed_mps)
        _print_plan(self.output.name, figures)
        if len(made.costs) > 1:
            _print_costs(made)
        say(f"safe ground needed for vehicle, tool and fence: up to {made.ground_m:.2f} m beyond the perimeter")
        for note in made.notes:
            say(note)
        if plan.pattern.unreached:
            say(f"not reachable on the safe ground: {len(plan.pattern.unreached)} swaths, marked unreached in the plan")
        if self.picture is not None:
            _draw(made, self.picture, figures, force=self.force)
            say(f"wrote {self.picture}")
        if self.json is not None:
            write_figures(self.json, figures, force=self.force)
        text = f"{counted(figures['lines'], 'swath')}, {figures['length_m']:.0f} m, {figures['time_s'] / 3600.0:.2f} h"
        verdict(f"wrote {self.output}: {text}", "run CONFIG.toml --preflight")


@dataclass(frozen=True)
class CoverRecord:
    """Compute the area worked from recorded runs, cell by cell.

    The probability of a cell is the maximum over all passes of all runs: the tool covered the cell, given the pose and
    its uncertainty at that time, and was on, turning and at depth. A machine pass is not clearance.
    """

    runs: Annotated[
        Positional[tuple[Path, ...]],
        arg(metavar="RUN...", help="folders of recorded runs; with --cart, GNSS logs"),
    ]
    output: Annotated[Path, arg(aliases=["-o"], metavar="R.worked.h5", help="record to write")]
    plan: Annotated[tuple[Path, ...], arg(metavar="X.cover.geojson...")] = ()
    """plan of the field, then plans of its gaps; default: the convex outline of the passes of runs without a plan"""
    evidence: Annotated[Path | None, arg(metavar="E.toml")] = None
    """task, hazard area, machine, operator, control points, finds, detonations; see docs/coverage.md"""
    cart: Annotated[Path | None, arg(metavar="V.vehicle.toml")] = None
    """vehicle file of a hand cart; RUN... are logs of its GNSS receiver, NMEA or UBX. The heading comes from the
    smoothed course. The record states that the tool state was not measured"""
    smooth: bool = False
    """smooth the poses of every run, forward and backward, from its recorded messages: smaller sigmas after GNSS
    outages, and corrections by later measurements; needs the configuration files of the run"""
    level: Annotated[tuple[float, ...], arg(metavar="LEVEL...")] = (0.95, 0.996)
    """probabilities at which a cell counts as processed; cover export can use other levels"""
    cell_m: float = 0.05
    """side length of a cell"""
    json: Path | None = None
    """JSON file for the figures; - for standard output"""
    force: bool = False
    """replace existing outputs"""

    def run(self) -> None:
        """Record."""
        from lgprjax.formats import write_worked
        from lgprjax.worked.evidence import read_evidence, shared_error_lines
        from lgprjax.worked.layers import cover_figures
        from lgprjax.worked.plans import open_cover_plan
        from lgprjax.worked.record import read_cover_run, record_cover

        require_files(self.runs, "runs")
        if not 0.01 <= self.cell_m <= 1.0:
            raise UsageError(f"--cell-m: expected 0.01 to 1, found {self.cell_m:g}")
        if self.cart is not None and self.smooth:
            raise UsageError("--smooth: not with --cart, which already smooths")
        levels = _levels(self.level)
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

                    if not plans:
                        raise UsageError("--cart: needs --plan as well")

                    runs.append(read_cart_run(folder, self.cart, plans[0]))
            for note in runs[-1].provenance.get("notes", ()):
                say(f"{folder}: {note}")
            if self.smooth:
                from lgprjax.runtime.cart import smooth_cart_run
                from lgprjax.runtime.smoothed import smooth_run

                with working(f"smoothing {folder}"):
                    # Only the runs of a cart say of the tool that it was not measured.
                    cart = "tool" in runs[-1].provenance
                    runs[-1] = smooth_cart_run(runs[-1]) if cart else smooth_run(runs[-1])[0]
        with progress_bar("computing cells", sum(len(run.rows) for run in runs), "ticks") as progress:
            record = record_cover(plans, runs, cell_m=self.cell_m, levels=levels, evidence=evidence, progress=progress)
        write_worked(self.output, record, force=self.force)
        figures = cover_figures(record)
        print_cover_figures(self.output.name, figures)
        for words, sentence in shared_error_lines(record.provenance["evidence"]):
            say(f"{words}: {sentence}")
        if self.json is not None:
            write_figures(self.json, figures.as_json(), force=self.force)
        verdict(f"wrote {_cover_verdict(self.output, figures)}", f"cover export {self.output} -o DIR")


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
            caption=f"Order {pattern.settings.order}; dark swaths come first. Swaths: path of the tool centre. Turns: "
            "path of the vehicle's reference point.",
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
        "order", "heading", "swaths", "distance", "time", "beyond the perimeter", title="orders, selected one first"
    )
    for cost in made.costs:
        heading = f"{cost.heading_deg:.0f}°" if math.isfinite(cost.heading_deg) else ""
        if cost.refused:
            table.add_row(cost.order, heading, "rejected", "", "", "")
            continue
        hours = f"{cost.time_s / 3600.0:.2f} h"
        table.add_row(
            cost.order, heading, f"{cost.swath_m:.0f} m", f"{cost.way_m:.0f} m", hours, f"{cost.ground_m:.2f} m"
        )
    console.print(table)
    # Several orders and headings may have the same reason.
    orders: dict[str, list[str]] = {}
    for cost in made.costs:
        if cost.refused and cost.order not in orders.setdefault(cost.refused, []):
            orders[cost.refused].append(cost.order)
    for reason, names in orders.items():
        say(f"{', '.join(names)} rejected: {reason}")


def _rows(figures: dict[str, Any]) -> Iterator[tuple[str, str]]:
    """Quantities of a plan with units."""
    yield "field", f"{figures['field']}, {figures['area_m2']:.1f} m²"
    yield "first corner, latitude, longitude", f"{figures['latitude_deg']:.7f}°, {figures['longitude_deg']:.7f}°"
    yield "vehicle", str(figures["vehicle"])
    yield "order", str(figures["order"])
    yield "swaths", f"{figures['lines']}, {figures['line_length_m']:.0f} m in total, {figures['spacing_m']:.2f} m apart"
    yield "total distance, time", f"{figures['length_m']:.0f} m, {figures['time_s'] / 3600.0:.2f} h"
    if figures["tightest_radius_m"] is not None:
        yield "tightest turn", f"{figures['tightest_radius_m']:.2f} m radius"
    if figures["keep_outs"]:
        yield "keep-outs", str(figures["keep_outs"])
    if figures["unreached"]:
        yield "unreachable swaths", str(figures["unreached"])


def _print_plan(title: str, figures: dict[str, Any]) -> None:
    table = Table("quantity", "value", title=title)
    for name, value in _rows(figures):
        table.add_row(name, value)
    console.print(table, highlight=False, markup=False)
