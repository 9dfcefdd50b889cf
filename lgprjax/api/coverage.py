"""Plans of fields that are worked in parallel swaths."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np

from lgprjax.api.inputs import PathLike, axes_or_new, path_of, told_as_arguments
from lgprjax.errors import InputError
from lgprjax.formats import CoverPlan

if TYPE_CHECKING:
    from matplotlib.axes import Axes


@dataclass(frozen=True, eq=False)
class CoveragePlan:
    """Swaths over a field in driving order, and the headland turns that join them.

    Attributes:
        plan: the plan in local metres; ``plan.pattern`` has swaths, turns and settings.
        path: of its file; None while it has not been saved.
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
        """Write ``X.cover.geojson``, which map programs draw; returns the plan of that file.

        Raises:
            InputError: the name ends otherwise, or the file exists (without ``force``) or cannot be written.
        """
        from lgprjax.worked import save_cover_plan

        target = path_of(path, "plan")
        if not target.name.endswith(".cover.geojson"):
            raise InputError(target, "file name", "a name that ends in .cover.geojson", repr(target.name))
        with told_as_arguments():
            save_cover_plan(target, self.plan, force=force)
        return CoveragePlan(self.plan, target.absolute())

    def plot(self, *, ax: "Axes | None" = None) -> "Axes":
        """Draw the field's perimeter and the way over it, in metres east and north, and return the axes."""
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
        axes.set_title(repr(self))
        axes.legend()
        return axes


def plan_coverage(
    field: PathLike,
    vehicle: PathLike,
    *,
    overlap: float = 0.2,
    order: Literal["zamboni", "boustrophedon"] = "zamboni",
    turning_room_m: float | None = None,
    heading_deg: float | None = None,
    gaps_of: PathLike | None = None,
    level: float = 0.95,
) -> CoveragePlan:
    """Lay parallel swaths over a field, in driving order, with headland turns that the vehicle can drive.

    Args:
        field: a GeoJSON polygon on WGS-84, a CSV file of three corners, or the folder of a run in which three corners
            were marked.
        vehicle: a skid-steer vehicle, open or its file: its tool and its smallest radius.
        overlap: least share of the tool's width that neighbouring swaths both work, 0 to below 1.
        order: ``zamboni``: first, middle, second, ... with wide turns to one hand; ``boustrophedon``: each swath next
            to the last.
        turning_room_m: how far beyond the perimeter the vehicle may go; by default as far as the turns need.
        heading_deg: of the first swath, clockwise from true north; by default along the first side.
        gaps_of: record of worked area, ``R.worked.h5``: plan only what it leaves below the level.
        level: probability that a cell needs to be left out.

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
    from lgprjax.formats import read_worked
    from lgprjax.worked import PlanOptions, make_cover_plan

    if not 0.5 < level < 1.0:
        raise InputError("call", "level", "above 0.5 and below 1", f"{level:g}")
    record = None if gaps_of is None else path_of(gaps_of, "record")
    with told_as_arguments():
        plan = make_cover_plan(
            path_of(field, "field"),
            path_of(vehicle, "vehicle"),
            PlanOptions(overlap, order, turning_room_m, heading_deg),
            worked=None if record is None else read_worked(record),
            level=level,
        )
    if plan is None:
        raise InputError(str(record), "gaps", "cells that are not worked", f"none below {100.0 * level:g} %")
    return CoveragePlan(plan)
