"""Plans of fields: from corners on a map to swaths and turns in metres, and for the gaps of a record."""

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np
import shapely
from jaxtyping import Float

from lgprjax.coverage import (
    CellGrid,
    Field,
    Outline,
    Pattern,
    PatternSettings,
    SafeGround,
    Tool,
    check_drivable,
    field_of_polygon,
    ground_of_sides,
    inside_cells,
    lay_pattern,
    lines_heading_rad,
    plan_gaps,
    plan_pattern,
    turn_points,
)
from lgprjax.coverage.field import contains, outside_m
from lgprjax.coverage.ground import breaches, ground_around, pose_on_line, room_needed_m
from lgprjax.coverage.pattern import driving_time_s
from lgprjax.coverage.swaths import ORDERS, Order
from lgprjax.coverage.tour import plan_tour
from lgprjax.errors import ArgumentError, InputError
from lgprjax.files import file_hash
from lgprjax.formats import CoverPlan, read_cover_plan, read_vehicle, write_cover_plan
from lgprjax.formats.field_files import FieldPlaces, read_field
from lgprjax.formats.worked import FULL, WorkedRecord
from lgprjax.frames import LocalFrame
from lgprjax.recordings.vehicles import outline_of_vehicle, pattern_settings_of, skid_setup_of, tool_of
from lgprjax.worked.corners import check_same_field, counter_clockwise, east_north, field_of_places, keep_out_of
from lgprjax.worked.predicted import predicted_width

# Turning room if none is given: more than any field needs.
_ANY_ROOM_M = 1000.0
SPARE_M = 0.8
"""Distance of the fence from the ground that a plan without declared ground needs; ``[coverage] spare_m`` of a run."""


_BEGINS_WITHIN = "the first swath starts inside the field: bring the vehicle there"

PlanOrder = Literal["zamboni", "boustrophedon", "racetrack", "free", "best"]


class PlanOptions(NamedTuple):
    """Options of a pattern.

    Attributes:
        overlap: least share of the tool's width in which neighbouring swaths overlap.
        order: order of the swaths; ``best``: the order that takes the least time.
        turning_room_m: distance that the vehicle may go beyond the perimeter; ``None``: as far as the turns need.
        heading_deg: heading of the first swath, clockwise from true north; ``None``: along the first side.
        sides: safe ground outside the sides, m, such as ``2:none``, ``3-5:4.5`` or ``rest:6``. Side 1 runs from the
            file's first corner to its second. If any is given, the way keeps to the declared ground.
        keep_out_buffer_m: buffer around keep-outs whose file states none.
        clearance_m: distance of vehicle and tool from the border of declared ground.
        speed_mps: speed on straight ways, for times.
        confidence: confidence that one pass reaches every place; it sets the overlap, and swaths beyond the border
            where the ground outside allows. ``None``: ``overlap`` as given, and swaths flush with the border.
        drop_out_s: with ``confidence``, longest GNSS outage to allow for.
        least_width_m: in a plan for gaps, width below which a gap is not planned.
        polygon: name or number of the field's polygon, in a file with several.
    """

    overlap: float = 0.2
    order: PlanOrder = "zamboni"
    turning_room_m: float | None = None
    heading_deg: float | None = None
    sides: tuple[str, ...] = ()
    keep_out_buffer_m: float = 0.5
    clearance_m: float = 0.25
    speed_mps: float = 0.3
    confidence: float | None = None
    drop_out_s: float = 0.0
    least_width_m: float = 0.1
    polygon: str | None = None


class OrderCost(NamedTuple):
    """Cost of an order of the swaths.

    Attributes:
        order: order of the swaths.
        heading_deg: heading of the swaths, clockwise from true north.
        swath_m, way_m: length of the swaths, and of the whole way.
        time_s: driving time at the set speed, reduced in bends and at cusps.
        ground_m: largest distance of vehicle and tool beyond the perimeter.
        refused: reason why there is no such plan; empty if there is one.
    """

    order: str
    heading_deg: float
    swath_m: float
    way_m: float
    time_s: float
    ground_m: float
    refused: str


class FieldPlan(NamedTuple):
    """A plan of a field with notes, costs and the ground that it needs.

    Attributes:
        plan: plan of the field.
        notes: changes of the corners and unreachable places, one sentence each.
        costs: costs of the orders tried, the chosen one first.
        ground_m: largest distance beyond the perimeter of the ground that must be safe: the fence on board.
        ground: ground that must be safe to drive on.
    """

    plan: CoverPlan
    notes: tuple[str, ...]
    costs: tuple[OrderCost, ...]
    ground_m: float
    ground: SafeGround


def check_plan_options(options: PlanOptions, level: float) -> None:
    """Refuse options out of range for any pattern, and an invalid level of gaps. Raises ``ArgumentError``."""
    if not 0.0 <= options.overlap < 1.0:
        raise ArgumentError("overlap", "a fraction from 0 to below 1", f"{options.overlap:g}")
    if options.turning_room_m is not None and not 0.0 <= options.turning_room_m <= 1000.0:
        raise ArgumentError("turning_room_m", "0 to 1000", f"{options.turning_room_m:g}")
    if options.heading_deg is not None and not 0.0 <= options.heading_deg <= 360.0:
        raise ArgumentError("heading_deg", "0 to 360", f"{options.heading_deg:g}")
    if options.drop_out_s and options.confidence is None:
        raise ArgumentError("drop_out_s", "confidence as well", f"{options.drop_out_s:g} without confidence")
    if not 0.5 < level < 1.0:
        raise ArgumentError("level", "above 0.5 and below 1", f"{level:g}")
    if not 0.0 <= options.keep_out_buffer_m <= 100.0:
        raise ArgumentError("keep_out_buffer_m", "0 to 100", f"{options.keep_out_buffer_m:g}")
    if not 0.0 <= options.clearance_m <= 10.0:
        raise ArgumentError("clearance_m", "0 to 10", f"{options.clearance_m:g}")
    if not 0.0 <= options.least_width_m <= 10.0:
        raise ArgumentError("least_width_m", "0 to 10", f"{options.least_width_m:g}")
    if not 0.01 <= options.speed_mps <= 10.0:
        raise ArgumentError("speed_mps", "0.01 to 10", f"{options.speed_mps:g}")


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
    """The plan of ``plan_field`` alone; ``None`` if the record leaves no gap."""
    made = plan_field(field_file, vehicle_file, options, worked=worked, level=level)
    return None if made is None else made.plan


def plan_field(
    field_file: str | Path,
    vehicle_file: str | Path,
    options: PlanOptions,
    *,
    worked: WorkedRecord | None = None,
    level: float = 0.95,
) -> FieldPlan | None:
    """The plan of a field for a vehicle.

    Args:
        field_file: path of the field's file, see ``read_field``.
        vehicle_file: path of the file of a skid-steer vehicle.
        options: options of the pattern.
        worked: record of the same field; the plan covers only its cells below ``level``.
        level: probability from which a cell is left out.

    Returns:
        The plan; ``None`` if the record leaves no gap.

    Raises:
        InputError: a file is unusable, the corners form no field, or the pattern does not fit; the message names the
            place.
    """
    places, vehicle = read_field(field_file, polygon=options.polygon), read_vehicle(vehicle_file)
    tool, outline = tool_of(vehicle, vehicle_file), outline_of_vehicle(vehicle, vehicle_file)
    name = str(field_file)
    if worked is None:
        first = (float(each[0]) for each in (places.latitude_deg, places.longitude_deg, places.height_m))
        frame = LocalFrame(*first)
    else:
        frame = worked.frame
    field, notes, computed = field_of_places(places, frame, name)
    if not options.sides and places.rooms_m:
        options = options._replace(sides=tuple(f"{side}:{m:.6g}" for side, m in enumerate(places.rooms_m, start=1)))
        notes.append(f"room outside the sides as {Path(field_file).name} declares it (--sides: others)")
    carried: SafeGround | None = None
    if places.ground is not None and not options.sides and options.turning_room_m is None:
        parts_m = (tuple(east_north(ring, frame) for ring in part) for part in places.ground.parts)
        carried = SafeGround(tuple(parts_m), options.clearance_m)
        notes.append(f"within the ground that {Path(field_file).name} declares (--sides: other ground)")
        if options.clearance_m != places.ground.clearance_m:
            notes.append(f"{options.clearance_m:g} m of clearance; {places.ground.clearance_m:g} m there")
    if worked is not None:
        check_same_field(field, worked, field_file)
    if vehicle.body.rear_m is None:
        notes.append("the vehicle file has no [body]: the ground check covers only reference point, tracks and tool")
    keep_outs_m = tuple(keep_out_of(each, frame, options.keep_out_buffer_m) for each in places.keep_outs)
    declared = bool(options.sides or keep_outs_m or carried) or options.order in ("free", "best") or worked is not None
    field_names = FieldNames(
        field=field,
        keep_outs_m=keep_outs_m,
        frame=frame,
        file=name,
        title=Path(field_file).resolve().name.split(".")[0],
        tool=tool,
        outline=outline,
        declared=declared,
        carried=carried,
    )

    def settings_for(order: Order, room_m: float, heading_rad: float | None) -> PatternSettings:
        return pattern_settings_of(
            vehicle, vehicle_file, overlap=options.overlap, order=order, turning_room_m=room_m, heading_rad=heading_rad
        )

    if options.confidence is not None:
        parts = skid_setup_of(vehicle, vehicle_file)
        width = predicted_width(
            parts.model, tool, confidence=options.confidence, drop_out_s=options.drop_out_s, speed_mps=options.speed_mps
        )
        confidence = options.confidence
        options = options._replace(overlap=width.overlap)
        notes.append(
            f"{100.0 * confidence:g} % with one pass: sigma across {100.0 * width.sigma_m:.1f} cm, overlap "
            f"{width.overlap:.3f}, swaths {width.border_m:.2f} m beyond the border where there is room"
        )
        field_names = field_names._replace(border_m=width.border_m)
    maker = _Maker(field_names, options, settings_for, places)
    made = maker.gaps(worked, level) if worked is not None else maker.whole()
    if made is None:
        return None
    pattern, ground, costs, more = made
    if ground is None:
        ground_m = room_needed_m(field.perimeter_m, pattern, outline) + SPARE_M
    else:
        ground_m = _reach_m(ground, field)
    plan = CoverPlan(
        name=field_names.title,
        frame=frame,
        pattern=pattern,
        tool=tool,
        vehicle_name=vehicle.name,
        vehicle_sha256=file_hash(vehicle_file),
        ground=ground,
        keep_outs_m=keep_outs_m,
        rooms_m=maker.declared_m,
        computed_corner=computed,
    )
    fence = ground or ground_around(field.perimeter_m, ground_m, 0.0)
    return FieldPlan(plan, (*notes, *more), tuple(costs), ground_m, fence)


class FieldNames(NamedTuple):
    """A field on its way to a plan: geometry, frame, file and title, the vehicle's outline, whether its ground is
    declared, that ground where the plan that it comes from carries it, and how far swaths go beyond the border."""

    field: Field
    keep_outs_m: tuple[Float[np.ndarray, "_ 2"], ...]
    frame: LocalFrame
    file: str
    title: str
    tool: Tool
    outline: Outline
    declared: bool
    carried: SafeGround | None = None
    border_m: float = 0.0


_Made = tuple[Pattern, SafeGround | None, list[OrderCost], list[str]]


class _Maker:
    """Plans one field in the requested orders."""

    def __init__(
        self,
        held: FieldNames,
        options: PlanOptions,
        settings_for: Callable[[Order, float, float | None], PatternSettings],
        places: FieldPlaces,
    ) -> None:
        self._held, self._options, self._settings_for = held, options, settings_for
        self._rooms = self._rooms_of(places)
        heading = options.heading_deg
        longitude = np.array([held.frame.longitude_deg])
        self._heading = None if heading is None else float(held.frame.yaw_of_heading(np.array([heading]), longitude)[0])
        self._ground: SafeGround | None = held.carried
        if held.declared and held.carried is None:
            rooms = self._rooms
            self._ground = ground_of_sides(held.field.perimeter_m, rooms, held.keep_outs_m, options.clearance_m)

        self._wider = self._with_border()

    @property
    def _bound(self) -> bool:
        """Whether the ground is declared, by sides or by a plan; then it is exactly the declared ground."""
        return bool(self._options.sides) or self._held.carried is not None

    @property
    def declared_m(self) -> tuple[float, ...]:
        """Room outside each side of the field, where it was declared."""
        return tuple(self._rooms) if self._options.sides else ()

    def _with_border(self) -> Field:
        """The field, widened where the ground is safe by the border that the confidence requires."""
        held = self._held
        if held.border_m <= 0.0:
            return held.field
        shape = shapely.Polygon(held.field.perimeter_m).buffer(held.border_m, join_style="mitre", mitre_limit=2.0)
        if self._ground is not None:
            if held.carried is None:
                whole = ground_of_sides(held.field.perimeter_m, self._rooms, (), 0.0).shape
            else:
                whole = shapely.union(held.carried.shape, shapely.Polygon(held.field.perimeter_m))
            shape = shapely.intersection(shape, whole)
        largest = max(shapely.get_parts(shape), key=lambda part: part.area)
        ring = np.asarray(shapely.simplify(largest, 1e-4).exterior.coords)[:-1]
        if not largest.exterior.is_ccw:
            ring = ring[::-1]
        # Lines run along the first side, so the side nearest to it comes first.
        first = 0.5 * (held.field.perimeter_m[0] + held.field.perimeter_m[1])
        sides = shapely.linestrings(np.stack([ring, np.roll(ring, -1, axis=0)], axis=1))
        nearest = int(np.argmin(shapely.distance(sides, shapely.Point(first))))
        return field_of_polygon(np.roll(ring, -nearest, axis=0), name=held.file)

    def _rooms_of(self, places: FieldPlaces) -> list[float]:
        held, options = self._held, self._options
        if held.carried is not None:
            return [_reach_m(held.carried, held.field)] * len(held.field.perimeter_m)
        settings = self._settings_for("free", 0.0, None)
        outline = held.outline
        # Room for a bulb turn between adjacent swaths, with the tool out of the field; unused room is removed later.
        radius_m = settings.smallest_radius_m
        corner_m = math.hypot(radius_m + max(outline.left_m, -outline.right_m), max(outline.front_m, -outline.rear_m))
        usual_m = max(settings.tool_ahead_m, 0.0) + math.sqrt(3.0) * radius_m + corner_m + options.clearance_m
        usual_m = math.ceil(10.0 * usual_m + 1.0) / 10.0
        default_m = usual_m if options.turning_room_m is None else options.turning_room_m
        count = len(held.field.perimeter_m)
        given = rooms_of_sides(options.sides, count, default_m)
        if given is None:
            return [default_m] * count
        # A reversed ring keeps its first side and has the others in reverse order.
        return given if counter_clockwise(places) else [given[0], *given[:0:-1]]

    def gaps(self, worked: WorkedRecord, level: float) -> _Made | None:
        held = self._held
        cells = worked.cells
        grid = CellGrid(cells.east_m, cells.north_m, cells.cell_m, *cells.probability.shape)
        done = cells.probability >= level * FULL
        for ring in held.keep_outs_m:
            done = done | inside_cells(Field(ring), grid)
        ground = self._ground
        assert ground is not None
        settings = self._settings_for("free", max(self._rooms), self._heading)
        least_m = self._options.least_width_m
        made = plan_gaps(
            held.field,
            done,
            grid,
            ground,
            settings,
            held.tool,
            held.outline,
            least_width_m=least_m,
            name=held.file,
        )
        if made is None:
            return None
        pattern = made.pattern
        check_drivable(pattern, ground, held.outline, name=held.file)
        parts = "1 connected region" if made.regions == 1 else f"{made.regions} connected regions"
        notes = [f"{parts} of {made.left_m2:.1f} m² in total; swaths cover only the work left", *_unreached(pattern)]
        if made.narrow_m2 > 0.0:
            notes.append(f"{made.narrow_m2:.1f} m² in places narrower than {least_m:g} m are not planned")
        if made.shut_m2 > 0.0:
            notes.append(f"{made.shut_m2:.1f} m² without room for a swath in the declared ground are not planned")
        if self._begins_within(pattern, settings):
            notes.append(_BEGINS_WITHIN)
        return pattern, self._smaller(pattern, ground), [], notes

    def _begins_within(self, pattern: Pattern, settings: PatternSettings) -> bool:
        at = pose_on_line(pattern.lines[0], settings.tool_ahead_m, settings.tool_left_m)
        return bool(contains(self._held.field.perimeter_m, at[None, :2])[0])

    @property
    def _room_m(self) -> float | None:
        return max(self._rooms) if self._held.declared else self._options.turning_room_m

    def whole(self) -> _Made:
        order = self._options.order
        orders: tuple[Order, ...] = ORDERS if order == "best" else (order,)
        tried = [self._tried(each, heading) for each in orders for heading in self._headings(each)]
        good = [each for each in tried if each[0] is not None]
        if not good:
            raise next(each[3] for each in tried if each[3] is not None)
        # Only patterns that work the most ground compete on cost.
        most = max(each[4] for each in good)
        good.sort(key=lambda each: (each[4] < most - 0.005, each[2].time_s))
        pattern, ground, cost, _, _, notes = good[0]
        assert pattern is not None
        others = [each[2] for each in tried if each[2] is not cost]
        return pattern, ground, [cost, *others], notes

    def _headings(self, order: Order) -> list[float | None]:
        """Headings to try: the first side's; for ``best`` those of up to three long sides; free order finds its own."""
        if self._heading is not None or order == "free" or self._options.order != "best":
            return [self._heading]
        perimeter_m = self._held.field.perimeter_m
        sides = np.roll(perimeter_m, -1, axis=0) - perimeter_m
        found: list[float | None] = []
        for side in sides[np.argsort(-np.hypot(*sides.T))]:
            heading = math.atan2(side[1], side[0])
            if all(each is None or abs(math.sin(heading - each)) > 0.1 for each in found):
                found.append(heading)
        return found[:3]

    def _tried(
        self, order: Order, heading_rad: float | None
    ) -> tuple[Pattern | None, SafeGround | None, OrderCost, InputError | None, float, list[str]]:
        held = self._held
        degrees = self._degrees(heading_rad)
        try:
            if order == "free":
                assert self._ground is not None
                settings = self._settings_for("free", max(self._rooms), heading_rad)
                tour = plan_tour(
                    self._wider, self._ground, held.keep_outs_m, settings, held.tool, held.outline, name=held.file
                )
                pattern, share = tour.pattern, tour.worked_m2 / tour.target_m2
                begun = [_BEGINS_WITHIN] if self._begins_within(pattern, settings) else []
                notes = [
                    *begun,
                    *_unreached(pattern),
                    f"the swaths cover {math.floor(1000.0 * share) / 10.0:.1f} % of the field",
                ]
                if tour.cusps:
                    notes.append(f"the path changes between forward and reverse {tour.cusps} times")
            else:

                def lay(settings: PatternSettings) -> Pattern:
                    return plan_pattern(self._wider, settings, name=held.file)

                if held.keep_outs_m:
                    raise InputError(
                        held.file, f"order {order}", "free (the order that drives around keep-outs)", order
                    )
                room_m = self._room_m if self._bound else self._options.turning_room_m
                laid = _lay_within(
                    lay, lambda within_m: self._settings_for(order, within_m, heading_rad), self._wider, room_m
                )
                assert laid is not None
                pattern, share, notes = laid, 1.0, []
            pattern = replace(pattern, field=held.field)
            # Without declared sides the fence is laid around the ground that an order needs.
            ground = self._ground if self._bound or held.keep_outs_m or order == "free" else None
            if ground is not None:
                check_drivable(pattern, ground, held.outline, name=held.file)
                ground = self._smaller(pattern, ground)
        except InputError as error:
            cost = OrderCost(
                order=order,
                heading_deg=degrees,
                swath_m=math.nan,
                way_m=math.nan,
                time_s=math.inf,
                ground_m=math.nan,
                refused=str(error),
            )
            return None, None, cost, error, 0.0, []
        cost = OrderCost(
            order=order,
            heading_deg=self._degrees(lines_heading_rad(held.field, heading_rad))
            if order != "free"
            else degrees_of(pattern, held.frame),
            swath_m=pattern.line_length_m,
            way_m=pattern.length_m,
            time_s=driving_time_s(pattern, self._options.speed_mps),
            ground_m=room_needed_m(held.field.perimeter_m, pattern, held.outline),
            refused="",
        )
        return pattern, ground, cost, None, share, notes

    def _degrees(self, heading_rad: float | None) -> float:
        if heading_rad is None:
            return math.nan
        frame = self._held.frame
        return float(frame.heading_of_yaw(np.array([heading_rad]), np.array([frame.longitude_deg]))[0])

    def _smaller(self, pattern: Pattern, ground: SafeGround) -> SafeGround:
        """The ground reduced to the part that the way uses, so that no other ground has to be safe."""
        held, options = self._held, self._options
        if self._bound:
            return ground
        needed_m = room_needed_m(held.field.perimeter_m, pattern, held.outline) + options.clearance_m + 0.01
        rooms = [min(each, needed_m) for each in self._rooms]
        less = ground_of_sides(held.field.perimeter_m, rooms, held.keep_outs_m, options.clearance_m)
        return ground if breaches(pattern, less, held.outline) else less


def _reach_m(ground: SafeGround, field: Field) -> float:
    """Largest distance of ground beyond a field, m."""
    corners = shapely.points(shapely.get_coordinates(ground.shape))
    return float(shapely.distance(shapely.Polygon(field.perimeter_m), corners).max())


def degrees_of(pattern: Pattern, frame: LocalFrame) -> float:
    """Compass heading of the longest swath, degrees."""
    longest = max(pattern.lines, key=lambda line: line.length_m)
    along = longest.end_m - longest.start_m
    yaw = np.array([math.atan2(along[1], along[0])])
    return float(frame.heading_of_yaw(yaw, np.array([frame.longitude_deg]))[0])


def _unreached(pattern: Pattern) -> list[str]:
    if not pattern.unreached:
        return []
    at = pattern.unreached[0].start_m
    where = f"the first at {at[0]:.1f} m east, {at[1]:.1f} m north of the anchor"
    return [f"no path leads to {len(pattern.unreached)} swaths, {where}"]


def rooms_of_sides(sides: Sequence[str], count: int, default_m: float) -> list[float] | None:
    """Room outside each side, metres, from texts such as ``2:none``, ``3-5:4.5`` and ``rest:6``.

    Raises:
        ArgumentError: a text has another form, or names a side that does not exist.
    """
    if not sides:
        return None
    rooms: dict[int, float] = {}
    rest_m = default_m
    for text in sides:
        which, _, what = text.partition(":")
        expected = "SIDE:ROOM, such as 2:none, 3-5:4.5 or rest:6"
        try:
            room_m = 0.0 if what == "none" else float(what)
            low, _, high = which.partition("-")
            chosen = range(0) if which == "rest" else range(int(low), int(high or low) + 1)
        except ValueError:
            raise ArgumentError("sides", expected, repr(text)) from None
        if not 0.0 <= room_m <= 1000.0 or (which != "rest" and not (chosen and chosen[0] >= 1 and chosen[-1] <= count)):
            raise ArgumentError("sides", f"{expected}; sides 1 to {count}, rooms of 0 to 1000 m", repr(text))
        if which == "rest":
            rest_m = room_m
        rooms |= dict.fromkeys(chosen, room_m)
    return [rooms.get(number + 1, rest_m) for number in range(count)]


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
    """The pattern within a turning room; without a given room, within the room that its turns need."""
    if room_m is not None:
        return lay(settings_for(room_m))
    pattern = lay(settings_for(_ANY_ROOM_M))
    if pattern is None:
        return None
    route = lay_pattern(pattern)
    way = np.asarray(route.rows[: int(route.count), :2], np.float64)
    needed_m = math.ceil(10.0 * float(outside_m(field.perimeter_m, way).max()) + 0.1) / 10.0
    return lay(settings_for(needed_m))
