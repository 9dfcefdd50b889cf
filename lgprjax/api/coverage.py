"""Fields that are worked in parallel swaths: their plans, and records of what was worked."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np

from lgprjax.api.inputs import PathLike, axes_or_new, path_of, paths_of, require_number, told_as_arguments
from lgprjax.errors import ArgumentError, InputError
from lgprjax.formats import CoverPlan, WorkedRecord, read_worked

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes

    from lgprjax.worked import CoverFigures


@dataclass(frozen=True, eq=False)
class CoveragePlan:
    """Swaths over a field in driving order, with the headland turns between them.

    Attributes:
        plan: the plan in local metres; ``plan.pattern`` has swaths, turns and settings.
        path: path of the file; None before saving.
    """

    plan: CoverPlan
    path: Path | None = None

    def __repr__(self) -> str:
        pattern = self.plan.pattern
        left = f", {len(pattern.unreached)} not reached" if pattern.unreached else ""
        return (
            f"CoveragePlan of {self.plan.name!r} for {self.plan.vehicle_name!r}: {len(pattern.lines)} swaths{left}, "
            f"{pattern.length_m:.0f} m to drive over {pattern.field.area_m2:.0f} m2"
        )

    def save(self, path: PathLike, *, force: bool = False) -> "CoveragePlan":
        """Write ``X.cover.geojson``, which map programs can display; returns the plan of that file.

        Raises:
            InputError: the name has another suffix, or the file exists (without ``force``) or cannot be written.
        """
        from lgprjax.worked import save_cover_plan

        target = path_of(path, "plan")
        if not target.name.endswith(".cover.geojson"):
            raise InputError(target, "file name", "a name that ends in .cover.geojson", repr(target.name))
        with told_as_arguments():
            save_cover_plan(target, self.plan, force=force)
        return CoveragePlan(self.plan, target.absolute())

    def plot(self, *, ax: "Axes | None" = None) -> "Axes":
        """Draw perimeter and planned path in metres east and north. Returns the axes."""
        from lgprjax.coverage import lay_pattern

        axes = axes_or_new(ax, width_in=6.0, height_in=6.0)
        perimeter = np.asarray(self.plan.pattern.field.perimeter_m)
        closed = np.concatenate([perimeter, perimeter[:1]])
        axes.plot(closed[:, 0], closed[:, 1], color="0.4", linewidth=2.0, label="perimeter")
        route = lay_pattern(self.plan.pattern)
        way = np.asarray(route.rows)[: int(route.count), :2]
        axes.plot(way[:, 0], way[:, 1], linewidth=0.9, label="way")
        axes.plot(*way[0], "o", label="start")
        axes.set_aspect("equal", adjustable="datalim")
        axes.set_xlabel("east (m)")
        axes.set_ylabel("north (m)")
        pattern = self.plan.pattern
        axes.set_title(f"{self.plan.name}: {len(pattern.lines)} swaths, {pattern.length_m:.0f} m")
        axes.legend()
        return axes


def plan_coverage(
    field: PathLike,
    vehicle: PathLike,
    *,
    polygon: str | None = None,
    overlap: float = 0.2,
    order: Literal["zamboni", "boustrophedon", "racetrack", "free", "best"] = "zamboni",
    turning_room_m: float | None = None,
    heading_deg: float | None = None,
    sides: Sequence[str] = (),
    keep_out_buffer_m: float = 0.5,
    clearance_m: float = 0.25,
    speed_mps: float = 0.3,
    confidence: float | None = None,
    drop_out_s: float = 0.0,
    gaps_of: PathLike | None = None,
    level: float = 0.95,
) -> CoveragePlan:
    """Plan parallel swaths over a field, in driving order, with headland turns that the vehicle can drive.

    Args:
        field: polygon in WGS-84 as GeoJSON with holes, KML, KMZ, shapefile or CSV, CSV of three corners, or folder of a
            run with three marked corners.
        vehicle: skid-steer vehicle with tool and smallest radius, open or its file.
        polygon: name, or number from 1, of the polygon that is the field, if the file has several.
        overlap: minimum overlap of neighbouring swaths, in tool widths, 0 to below 1.
        order: ``zamboni`` (first, middle, second, ... swath, wide turns to one side), ``boustrophedon`` (neighbouring
            swaths), ``racetrack`` (Zamboni in blocks), ``free`` (cheapest next swath, around keep-outs, with
            reversing), or ``best`` (the fastest of these, as ``lgprjax cover plan``).
        turning_room_m: width of safe ground outside the perimeter, m; default: as much as the turns need.
        heading_deg: compass heading of the first swath, degrees from true north; default: along the first side.
        sides: width of safe ground outside each side, m or none, such as ``("1:none", "3-5:4.5", "rest:6")``.
        keep_out_buffer_m: distance to keep-outs without a distance in the file, m.
        clearance_m: distance of vehicle and tool from the border of the safe ground, m.
        speed_mps: speed on straight swaths, m/s, for the time estimate.
        confidence: probability that one pass covers every place: sets the overlap, and adds swaths outside the border.
        drop_out_s: with ``confidence``: longest GNSS outage, s.
        gaps_of: record of the area worked, open or its file: plan only the cells below ``level``.
        level: with ``gaps_of``: probability at which a cell counts as processed.

    Returns:
        CoveragePlan: ``save(path)`` writes it, ``plot()`` returns axes.

    Raises:
        InputError: a file cannot be used, the pattern does not fit the field, or the record leaves no gap.

    Example:
        plan = lx.plan_coverage("field.geojson", "made_up_flail.vehicle.toml", overlap=0.3)
        print(plan)                        # CoveragePlan of 'salt flat, 30 x 20 m' ...: 26 swaths, ...
        plan.save("field.cover.geojson", force=True)
        plan.plot()
    """
    from lgprjax.worked import PlanOptions, check_plan_options, make_cover_plan

    for name, value in (
        ("overlap", overlap),
        ("keep_out_buffer_m", keep_out_buffer_m),
        ("clearance_m", clearance_m),
        ("speed_mps", speed_mps),
        ("drop_out_s", drop_out_s),
        ("level", level),
    ):
        require_number(name, value, "a number", -np.inf, np.inf)
    for name, perhaps in (("turning_room_m", turning_room_m), ("heading_deg", heading_deg), ("confidence", confidence)):
        if perhaps is not None:
            require_number(name, perhaps, "a number", -np.inf, np.inf)
    if isinstance(sides, str) or not isinstance(sides, Iterable) or not all(isinstance(each, str) for each in sides):
        raise ArgumentError("sides", 'strings such as "1:none" or "rest:6"', repr(sides)[:60])
    options = PlanOptions(
        overlap=overlap,
        order=order,
        turning_room_m=turning_room_m,
        heading_deg=heading_deg,
        sides=tuple(sides),
        keep_out_buffer_m=keep_out_buffer_m,
        clearance_m=clearance_m,
        speed_mps=speed_mps,
        confidence=confidence,
        drop_out_s=drop_out_s,
        polygon=polygon,
    )
    check_plan_options(options, level)
    record = None if gaps_of is None else path_of(gaps_of, "record")
    with told_as_arguments():
        plan = make_cover_plan(
            path_of(field, "field"),
            path_of(vehicle, "vehicle"),
            options,
            worked=None if record is None else read_worked(record),
            level=level,
        )
    if plan is None:
        raise InputError(str(record), "gaps", "cells below the confidence level", f"no cell below {100.0 * level:g} %")
    return CoveragePlan(plan)


@dataclass(frozen=True, eq=False)
class WorkedArea:
    """Area worked by recorded runs, cell by cell. A machine pass is not clearance.

    Attributes:
        record: cells, passes, stops and channels, in metres east and north of the anchor of the field.
        path: path of the file.
    """

    record: WorkedRecord
    path: Path

    @cached_property
    def figures(self) -> "CoverFigures":
        """Areas by level, passes, stops, hours; ``sentence`` of a layer states its result."""
        from lgprjax.worked import cover_figures

        return cover_figures(self.record)

    @cached_property
    def table(self) -> "pd.DataFrame":
        """DataFrame with a row per level: areas in square metres, and shares of the field."""
        import pandas as pd

        return pd.DataFrame([layer._asdict() for layer in self.figures.layers])

    def __repr__(self) -> str:
        told = self.figures
        layers = ", ".join(
            f"{layer.processed_m2:.1f} m2 processed at {100.0 * layer.level:g} %" for layer in told.layers
        )
        return f"WorkedArea of {self.record.name!r}: {layers} of {told.area_m2:.1f} m2 ({self.path.name})"

    def at(self, *confidence: float) -> "WorkedArea":
        """The same cells at other levels, such as 0.99.

        Raises:
            InputError: a level is not a number between 0.5 and 0.9999.
        """
        from lgprjax.worked.layers import at_levels, checked_levels

        for level in confidence:
            require_number("confidence", level, "above 0.5, up to 0.9999", 0.5, 0.9999)
        with told_as_arguments():
            return WorkedArea(at_levels(self.record, checked_levels(confidence)), self.path)

    def export(
        self,
        folder: PathLike,
        *,
        organisation: str = "not stated",
        benchmark_deg: tuple[float, float] | None = None,
        force: bool = False,
    ) -> tuple[Path, ...]:
        """Write the handover files: GIS layers, cells and turning points as CSV, a report to sign.

        Args:
            folder: folder for the files, which have the name of the record; created if missing.
            organisation: responsible organisation, in every layer and in the report.
            benchmark_deg: latitude and longitude of the surveyed reference point for bearings and distances; default:
                the first corner.
            force: replace files that exist.

        Returns:
            The files: GeoPackage, GeoJSON, KML, zipped shapefiles, two CSV files, HTML report.

        Raises:
            InputError: a file exists (without ``force``) or cannot be written, the reference point is not a position,
                or the optional package pyogrio is missing.
        """
        from lgprjax.report.handover import hand_over

        with told_as_arguments():
            return hand_over(
                self.path,
                self.record,
                path_of(folder, "folder"),
                organisation=organisation,
                benchmark_deg=benchmark_deg,
                force=force,
            )

    def plot(self, *, ax: "Axes | None" = None) -> "Axes":
        """Draw processed, uncertain and not processed cells, in metres east and north. Returns the axes."""
        from lgprjax.report.coverage import draw_coverage_on
        from lgprjax.report.handover import cover_picture

        axes = axes_or_new(ax, width_in=6.0, height_in=6.0)
        draw_coverage_on(axes, cover_picture(self.record))
        return axes


def record_coverage(
    plans: PathLike | Iterable[PathLike],
    runs: PathLike | Iterable[PathLike],
    output: PathLike,
    *,
    cell_m: float = 0.05,
    force: bool = False,
) -> WorkedArea:
    """Compute the area worked from recorded runs, cell by cell.

    The probability of a cell is the maximum over all passes of all runs: the tool covered the cell, given the pose and
    its uncertainty at that time, and was on, turning and at depth.

    Args:
        plans: plan of the field, then plans of its gaps, open or their files.
        runs: folders of recorded runs of these plans.
        output: record to write, ``R.worked.h5``.
        cell_m: side length of a cell, 0.01 to 1 m.
        force: replace a file that exists.

    Raises:
        InputError: a run or plan cannot be used, a run does not belong to the plans, or the output cannot be written.

    Example:
        worked = lx.record_coverage("field/field.cover.geojson", "field/run", "field.worked.h5", force=True)
        print(worked)                      # WorkedArea of ...: ... m2 processed at 95 %, ...
        print(worked.table[["level", "processed_m2", "share"]])
        worked.plot()
        worked.at(0.99).export("handed_over/", organisation="Example", force=True)
    """
    from lgprjax.formats import write_worked
    from lgprjax.worked import open_cover_plan, read_cover_run, record_cover

    target = path_of(output, "record")
    if not target.name.endswith(".worked.h5"):
        raise InputError(target, "file name", "a name that ends in .worked.h5", repr(target.name))
    require_number("cell_m", cell_m, "0.01 to 1", 0.01, 1.0)
    if target.exists() and not force:
        raise InputError(target, "output", "a new file, or force=True", "an existing file")
    with told_as_arguments():
        opened = [open_cover_plan(path) for path in paths_of(plans, "plan")]
        record = record_cover(opened, [read_cover_run(path) for path in paths_of(runs, "run")], cell_m=cell_m)
        write_worked(target, record, force=force)
    return WorkedArea(record, target.absolute())


def open_worked(path: PathLike) -> WorkedArea:
    """Open a record of the area worked.

    Args:
        path: record, ``R.worked.h5``.

    Raises:
        InputError: the file is missing, damaged, or does not match data_schema/worked.toml.

    Example:
        worked = lx.open_worked("field.worked.h5")
        print(worked.figures.layers[0].sentence)
    """
    file = path_of(path, "record")
    return WorkedArea(read_worked(file), file.absolute())
