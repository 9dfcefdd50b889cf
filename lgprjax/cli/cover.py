"""``lgprjax cover``: plan a field, record what was worked of it, hand the record over."""

import math
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
import tyro
from rich.table import Table
from tyro.conf import Positional, arg

from lgprjax.cli.terminal import UsageError, console, progress_bar, require_files, working
from lgprjax.errors import InputError

if TYPE_CHECKING:
    from lgprjax.formats import CoverPlan, WorkedRecord
    from lgprjax.report import ReportFigure
    from lgprjax.worked.layers import CoverFigures


# What the verbs of ``lgprjax cover`` say alike.


def refuse_existing(outputs: tuple[Path | None, ...], force: bool) -> None:
    """Refuse, before any work, outputs that are there already. Raises ``InputError`` for the first."""
    for path in outputs:
        if path is not None and path.exists() and not force:
            raise InputError(path, "output", "a new file, or --force", "the file exists")


def print_cover_figures(title: str, figures: "CoverFigures") -> None:
    """Print what a record says, and what it does not."""
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
    say("A machine pass is not clearance: the ground is to be searched before it is released.")


def say(text: str) -> None:
    """Print a line as it is."""
    console.print(text, highlight=False, markup=False, soft_wrap=True)


# ``lgprjax cover export``: a record of a worked field in the forms in which it is handed over.

_RECORD = ".worked.h5"
_SUFFIXES = (".gpkg", ".geojson", ".kml", ".turning_points.csv", ".html")


@dataclass(frozen=True)
class CoverExport:
    """Hand a record over: GeoPackage, GeoJSON, KML, turning points as CSV, and a report to be signed.

    Layers: perimeter, swaths, processed ground at each confidence, gaps, stops, events; all on WGS-84.
    """

    record: Annotated[Positional[Path], arg(metavar="R.worked.h5", help="record of a worked field")]
    output: Annotated[Path, arg(aliases=["-o"], metavar="DIR", help="folder for the outputs; made if need be")]
    organisation: str = "not stated"
    """who is responsible, as every shape and the report name it"""
    benchmark_deg: Annotated[tuple[float, float] | None, arg(metavar="LATITUDE LONGITUDE")] = None
    """a marked point that bearings and distances count from; without it the first corner"""
    json: Path | None = None
    """also write the figures to this file"""
    force: bool = False
    """replace outputs that exist"""

    def run(self) -> None:
        """Export."""
        from lgprjax.cli.figures import write_figures
        from lgprjax.formats import read_worked, write_geojson, write_geopackage, write_kml, write_turning_points
        from lgprjax.worked.layers import cover_figures, cover_layers

        mark = self.benchmark_deg
        if mark is not None and not (abs(mark[0]) <= 90.0 and abs(mark[1]) <= 180.0):
            raise UsageError(f"--benchmark-deg: expected a latitude and a longitude, found {mark[0]:g} {mark[1]:g}")
        if self.output.exists() and not self.output.is_dir():
            raise InputError(self.output, "output", "a folder", "a file")
        stem = self.record.name.removesuffix(_RECORD)
        outputs = tuple(self.output / f"{stem}{suffix}" for suffix in _SUFFIXES)
        refuse_existing((*outputs, self.json), self.force)
        record = read_worked(self.record)
        figures = cover_figures(record)
        with working("drawing layers and report"):
            layers = cover_layers(record, self.organisation)
            self.output.mkdir(parents=True, exist_ok=True)
            package, collection, markup, table, page = outputs
            metadata = _metadata(self.record, record, self.organisation)
            write_geopackage(package, layers, metadata, force=self.force)
            write_geojson(collection, layers, metadata, force=self.force)
            write_kml(markup, layers, metadata, colours=_colours(record), force=self.force)
            latitude, longitude = _corners(record)
            write_turning_points(table, latitude, longitude, mark, force=self.force)
            _write_page(page, self.record, record, figures, self.organisation, self.force)
        print_cover_figures(self.record.name, figures)
        for path in outputs:
            say(f"wrote {path}")
        if self.json is not None:
            write_figures(self.json, figures.as_json(), force=self.force)


def _metadata(path: Path, record: "WorkedRecord", organisation: str) -> dict[str, str]:
    from lgprjax.files import file_hash
    from lgprjax.worked.layers import METHOD, STATUS

    return {
        "field": record.name,
        "organisation": organisation,
        "method": METHOD,
        "status": STATUS,
        "datum": "WGS 84",
        "record": path.name,
        "record_sha256": file_hash(path),
        "plan_sha256": str(record.provenance["plan"]["sha256"]),
        "note": "A machine pass is not clearance. Processed ground is that of cells at the level named, no more.",
    }


def _colours(record: "WorkedRecord") -> dict[str, str]:
    from lgprjax.report.coverage import COLOURS
    from lgprjax.worked.layers import layer_name

    ground = {layer_name(float(level)): colour for level, colour in zip(record.cells.level, COLOURS[2:], strict=True)}
    return {**ground, "gaps": COLOURS[0]}


def _corners(record: "WorkedRecord") -> tuple[np.ndarray, np.ndarray]:
    corners = record.perimeter_m
    latitude, longitude, _ = record.frame.to_geodetic(corners[:, 0], corners[:, 1], np.zeros(len(corners)))
    return latitude, longitude


def _write_page(
    path: Path, source: Path, record: "WorkedRecord", figures: "CoverFigures", organisation: str, force: bool
) -> None:
    from lgprjax.formats import stop_words
    from lgprjax.report import CoveragePage, write_coverage_page
    from lgprjax.worked.layers import METHOD, percent, square_metres

    passes, stops, runs = record.passes, record.stops, record.provenance["runs"]
    time_s = record.channels.time_s
    latitude, longitude = _corners(record)
    facts = (
        ("method", METHOD),
        ("vehicle", str(record.provenance["vehicle"]["name"])),
        ("tool", f"{record.tool.width_m:g} m wide, {record.tool.length_m:g} m long"),
        ("field", square_metres(figures.area_m2)),
        ("passes", f"{figures.passes}, {figures.way_m:.0f} m"),
        ("depth, mean and least", f"{_centimetres(figures.depth_mean_m)}, {_centimetres(figures.depth_least_m)}"),
        ("runs", ", ".join(f"{run['folder']}{'' if run['complete'] else ' (incomplete)'}" for run in runs)),
        ("fixed GNSS position", f"{figures.fixed:.1%} of the time"),
    )
    rows = [
        (
            str(number + 1),
            str(runs[int(passes.run[number])]["folder"]),
            str(int(passes.line[number]) + 1),
            _clock(record, float(passes.begin_s[number])),
            f"{passes.length_m[number]:.1f}",
            f"{100.0 * passes.depth_mean_m[number]:.1f} / {100.0 * passes.depth_least_m[number]:.1f}",
            f"{passes.speed_mean_mps[number]:.2f} / {passes.speed_largest_mps[number]:.2f}",
        )
        for number in range(len(passes.run))
    ]
    with tempfile.TemporaryDirectory(dir=path.parent, prefix=".export-") as folder:
        page = CoveragePage(
            name=record.name,
            organisation=organisation,
            period=f"{_clock(record, float(time_s.min()))} to {_clock(record, float(time_s.max()))} UTC",
            sentences=tuple(layer.sentence for layer in figures.layers),
            facts=facts,
            layers=tuple(
                (
                    f"{100.0 * layer.level:g} %",
                    *(square_metres(each) for each in (layer.processed_m2, layer.uncertain_m2, layer.not_processed_m2)),
                    percent(layer.share),
                )
                for layer in figures.layers
            ),
            passes_header=(
                "pass",
                "run",
                "line",
                "begin (UTC)",
                "length m",
                "depth cm, mean / least",
                "m/s, mean / most",
            ),
            passes=tuple(rows),
            stops=tuple(
                (
                    str(runs[int(stops.run[number])]["folder"]),
                    _clock(record, float(stops.begin_s[number])),
                    f"{stops.end_s[number] - stops.begin_s[number]:.1f} s",
                    stop_words(int(stops.reasons[number])),
                )
                for number in range(len(stops.run))
            ),
            turning_points=tuple(
                (f"TP{number + 1}", f"{one:.9f}", f"{other:.9f}")
                for number, (one, other) in enumerate(zip(latitude, longitude, strict=True))
            ),
            hashes=_hashes(source, record),
            figures=_pictures(Path(folder), record),
        )
        write_coverage_page(path, page, force=force)


def _clock(record: "WorkedRecord", time_s: float) -> str:
    from lgprjax.worked.layers import utc_of

    return utc_of(record, time_s)[:19].replace("T", " ")


def _centimetres(depth_m: float | None) -> str:
    return "none" if depth_m is None else f"{100.0 * depth_m:.1f} cm"


def _hashes(source: Path, record: "WorkedRecord") -> tuple[tuple[str, str], ...]:
    from lgprjax.files import file_hash

    plans: list[dict[str, Any]] = [record.provenance["plan"], *record.provenance["other_plans"]]
    return (
        (source.name, file_hash(source)),
        *((str(plan["file"]), str(plan["sha256"])) for plan in plans),
        *(
            (f"{run['folder']}/{segment['file']}", str(segment["sha256"]))
            for run in record.provenance["runs"]
            for segment in run["segments"]
        ),
    )


def _pictures(folder: Path, record: "WorkedRecord") -> tuple["ReportFigure", ...]:
    from lgprjax.report import CoverChannelsPicture, CoverPicture, ReportFigure, draw_cover_channels, draw_coverage
    from lgprjax.worked.layers import inside_of

    cells, channels, swaths, stops = record.cells, record.channels, record.swaths, record.stops
    ways = [swaths.number == number for number in range(len(record.passes.run))]
    above = CoverPicture(
        name=record.name,
        perimeter_m=record.perimeter_m,
        east_m=cells.east_m,
        north_m=cells.north_m,
        cell_m=cells.cell_m,
        inside=inside_of(record),
        levels=(float(cells.level[0]), float(cells.level[-1])),
        states=cells.state[[0, -1]],
        swaths_m=tuple(np.stack([swaths.east_m[of], swaths.north_m[of]], axis=1) for of in ways),
        stops_m=np.stack([stops.east_m, stops.north_m], axis=1),
    )
    position = np.nan_to_num(channels.covariance[:, :2, :2].astype(np.float64))
    measured = CoverChannelsPicture(
        time_s=channels.time_s,
        depth_m=channels.depth_m.astype(np.float64),
        speed_mps=channels.speed_mps.astype(np.float64),
        sigma_m=np.sqrt(np.clip(np.linalg.eigvalsh(position)[:, 1], 0.0, None)),
        counts=(channels.tool & 8) != 0,
        fixed=channels.gnss_quality == 3,
        stopped=channels.stop != 0,
    )
    draw_coverage(above, folder / "map.png")
    draw_cover_channels(measured, folder / "channels.png")
    return (
        ReportFigure(
            folder / "map.png", "The field from above.", "Map of what was processed, uncertain and not processed"
        ),
        ReportFigure(
            folder / "channels.png", "Depth, speed and uncertainty.", "Depth, speed and uncertainty over time"
        ),
    )


_PLAN, _COVER_RECORD = ".cover.geojson", ".worked.h5"


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
        from lgprjax.cli.figures import write_figures
        from lgprjax.formats import read_worked
        from lgprjax.worked.plans import PlanOptions, make_cover_plan, save_cover_plan

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
        from lgprjax.cli.figures import write_figures
        from lgprjax.formats import write_worked
        from lgprjax.worked.layers import cover_figures
        from lgprjax.worked.plans import open_cover_plan
        from lgprjax.worked.record import read_cover_run, record_cover

        require_files(self.runs, "runs")
        require_files(self.plan, "--plan")
        _check_suffix("--output", self.output, _COVER_RECORD)
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
