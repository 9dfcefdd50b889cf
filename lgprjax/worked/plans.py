"""Plans of fields: from corners on a map to swaths and turns in metres, and for the gaps of a record."""

import math
from collections.abc import Callable
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np

from lgprjax.batch.vehicles import pattern_settings_of, tool_of
from lgprjax.coverage import (
    CellGrid,
    Field,
    Pattern,
    PatternSettings,
    field_of_corners,
    field_of_polygon,
    lay_pattern,
    plan_gaps,
    plan_pattern,
    turn_points,
)
from lgprjax.coverage.field import outside_m
from lgprjax.errors import ArgumentError, InputError
from lgprjax.files import file_hash
from lgprjax.formats import CoverPlan, read_cover_plan, read_vehicle, write_cover_plan
from lgprjax.formats.coverage_files import FieldPlaces, read_field
from lgprjax.formats.worked import FULL, WorkedRecord
from lgprjax.frames import LocalFrame

# Largest difference between the perimeters of a record and of a plan for its gaps.
_SAME_FIELD_M = 0.05
# Turning room used when none is given: more than any field needs.
_ANY_ROOM_M = 1000.0


class PlanOptions(NamedTuple):
    """Options of a pattern.

    Attributes:
        overlap: least share of the tool's width in which neighbouring swaths overlap.
        order: of the swaths.
        turning_room_m: distance that the vehicle may go beyond the perimeter; ``None``: as far as the turns need.
        heading_deg: of the first swath, clockwise from true north; ``None``: along the first side.
    """

    overlap: float = 0.2
    order: Literal["zamboni", "boustrophedon"] = "zamboni"
    turning_room_m: float | None = None
    heading_deg: float | None = None


def check_plan_options(options: PlanOptions, level: float) -> None:
    """Refuse what no pattern can have, and a level of gaps that is none. Raises ``ArgumentError``."""
    if not 0.0 <= options.overlap < 1.0:
        raise ArgumentError("overlap", "a fraction from 0 to below 1", f"{options.overlap:g}")
    if options.turning_room_m is not None and not 0.0 <= options.turning_room_m <= 1000.0:
        raise ArgumentError("turning_room_m", "0 to 1000", f"{options.turning_room_m:g}")
    if options.heading_deg is not None and not 0.0 <= options.heading_deg <= 360.0:
        raise ArgumentError("heading_deg", "0 to 360", f"{options.heading_deg:g}")
    if not 0.5 < level < 1.0:
        raise ArgumentError("level", "above 0.5 and below 1", f"{level:g}")


class PlanFile(NamedTuple):
    """A plan on disk; runs refer to it by its SHA-256."""

    path: Path
    sha256: str
    plan: CoverPlan


def open_cover_plan(path: str | Path) -> PlanFile:
    """A plan and the hash of its file. Raises ``InputError`` as ``read_cover_plan`` does."""
    return PlanFile(Path(path), file_hash(path), read_cover_plan(path))


def make_cover_plan(
    field_file: str | Path,
    vehicle_file: str | Path,
    options: PlanOptions,
    *,
    worked: WorkedRecord | None = None,
    level: float = 0.95,
) -> CoverPlan | None:
    """The plan of a field for a vehicle.

    Args:
        field_file: see ``read_field``.
        vehicle_file: of a skid-steer vehicle.
        options: of the pattern.
        worked: plan only for the cells that this record leaves below the level; the field must be the same.
        level: probability from which a cell is left out.

    Returns:
        The plan; ``None`` if the record leaves no gap.

    Raises:
        InputError: an unusable file, corners that form no field, a pattern that does not fit.
    """
    places, vehicle = read_field(field_file), read_vehicle(vehicle_file)
    tool = tool_of(vehicle, vehicle_file)
    name = Path(field_file).resolve().name.split(".")[0]
    if worked is None:
        first = (float(each[0]) for each in (places.latitude_deg, places.longitude_deg, places.height_m))
        frame = LocalFrame(*first)
        field = _field_of(places, frame, str(field_file))
    else:
        frame = worked.frame
        field = _field_of(places, frame, str(field_file))
        _check_same_field(field, worked, field_file)
    longitude = np.array([frame.longitude_deg])
    heading = options.heading_deg
    heading_rad = None if heading is None else float(frame.yaw_of_heading(np.array([heading]), longitude)[0])

    def settings_for(room_m: float) -> PatternSettings:
        return pattern_settings_of(
            vehicle,
            vehicle_file,
            overlap=options.overlap,
            order=options.order,
            turning_room_m=room_m,
            heading_rad=heading_rad,
        )

    def lay(settings: PatternSettings) -> Pattern | None:
        if worked is None:
            return plan_pattern(field, settings, name=str(field_file))
        cells = worked.cells
        grid = CellGrid(cells.east_m, cells.north_m, cells.cell_m, *cells.probability.shape)
        return plan_gaps(field, cells.probability >= level * FULL, grid, settings, name=str(field_file))

    pattern = _lay_within(lay, settings_for, field, options.turning_room_m)
    if pattern is None:
        return None
    return CoverPlan(name, frame, pattern, tool, vehicle.name, file_hash(vehicle_file))


def save_cover_plan(path: str | Path, plan: CoverPlan, *, force: bool = False) -> None:
    """Write a plan including points along its turns.

    Raises:
        InputError: the output exists (without ``force``) or cannot be written.
    """
    write_cover_plan(path, plan, [turn_points(turn) for turn in plan.pattern.turns], force=force)


def _lay_within(
    lay: Callable[[PatternSettings], Pattern | None],
    settings_for: Callable[[float], PatternSettings],
    field: Field,
    room_m: float | None,
) -> Pattern | None:
    """The pattern within a turning room; without one, within the room that its turns need."""
    if room_m is not None:
        return lay(settings_for(room_m))
    pattern = lay(settings_for(_ANY_ROOM_M))
    if pattern is None:
        return None
    route = lay_pattern(pattern)
    way = np.asarray(route.rows[: int(route.count), :2], np.float64)
    needed_m = math.ceil(10.0 * float(outside_m(field.perimeter_m, way).max()) + 0.1) / 10.0
    return lay(settings_for(needed_m))


def _field_of(places: FieldPlaces, frame: LocalFrame, name: str) -> Field:
    east, north, _ = frame.to_local(places.latitude_deg, places.longitude_deg, places.height_m)
    corners = np.stack([east, north], axis=1)
    return field_of_corners(corners, name=name) if places.driven else field_of_polygon(corners, name=name)


def _check_same_field(field: Field, worked: WorkedRecord, field_file: str | Path) -> None:
    here, there = field.perimeter_m, worked.perimeter_m
    apart_m = math.inf
    if here.shape == there.shape:
        turned = [np.roll(there, shift, axis=0) for shift in range(len(there))]
        apart_m = min(float(np.hypot(*(here - each).T).max()) for each in turned)
    if apart_m > _SAME_FIELD_M:
        found = "another number of corners" if math.isinf(apart_m) else f"corners up to {apart_m:.2f} m from its own"
        raise InputError(field_file, "perimeter", f"the field of the record, {worked.name}", found)
