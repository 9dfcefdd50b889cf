"""Ground that is declared safe to drive on, and the one check of whether a plan keeps vehicle and tool within it.

The planner, the preflight check and the control loop all call ``breaches``: what the one accepts no other refuses.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
import shapely
from jaxtyping import Float

from lgprjax.coverage.field import Corners, Outline
from lgprjax.coverage.pattern import Pattern
from lgprjax.coverage.swaths import Line
from lgprjax.coverage.turns import HeadlandTurn, poses_along
from lgprjax.errors import InputError

GRID_M = 1e-6
"""Grid of overlays, m, which joins points that differ by rounding."""
_TOLERANCE_M = 2e-3
"""Amount by which a way may undercut its clearance, m, because arcs of offsets are polygons."""
_MITRE = 2.0
_SLIVER_M2 = 1e-3
_ARC_RAD = 0.05


@dataclass(frozen=True, eq=False)
class SafeGround:
    """Ground that is declared safe to drive on.

    Attributes:
        polygons_m: outer ring, then holes, of each part; east and north.
        clearance_m: distance of a planned vehicle or tool from the border: uncertainty of the position, tracking error
            and stopping distance.
    """

    polygons_m: tuple[tuple[Float[np.ndarray, "_ 2"], ...], ...]
    clearance_m: float

    @cached_property
    def shape(self) -> Any:
        """The ground as a shapely geometry."""
        return shapely.union_all([shapely.Polygon(part[0], part[1:]) for part in self.polygons_m])

    @cached_property
    def kept(self) -> Any:
        """Area for planned vehicle and tool: the ground minus the clearance."""
        less_m = max(self.clearance_m - _TOLERANCE_M, 0.0)
        return self.shape.buffer(-less_m, join_style="mitre", mitre_limit=_MITRE)


class Breach(NamedTuple):
    """A place of a plan where vehicle or tool would be too near the border of the safe ground, or beyond it.

    Attributes:
        place: place in the plan.
        east_m, north_m: position of the worst corner of the outline.
        missing_m: missing clearance.
    """

    place: str
    east_m: float
    north_m: float
    missing_m: float


def safe_ground(shape: Any, clearance_m: float) -> SafeGround:
    """Ground of a shapely polygon or several; pieces and holes of next to no area are left out."""
    polygons = []
    for part in shapely.get_parts(shape):
        if part.geom_type == "Polygon" and part.area > _SLIVER_M2:
            # Overlays of sides that nearly coincide leave slivers, which are no holes.
            holes = [each for each in part.interiors if shapely.Polygon(each).area > _SLIVER_M2]
            polygons.append(tuple(_ring(each) for each in (part.exterior, *holes)))
    return SafeGround(tuple(polygons), clearance_m)


def _ring(ring: Any) -> Float[np.ndarray, "_ 2"]:
    corners: Float[np.ndarray, "_ 2"] = np.asarray(ring.coords, np.float64)[:-1, :2]
    return corners


def ground_around(perimeter_m: Corners, room_m: float, clearance_m: float) -> SafeGround:
    """A field and the ground within ``room_m`` of it; corners that would extend farther than twice that are cut.

    A notch of the field that is narrower than twice the room is within it, whole.
    """
    shape = shapely.Polygon(perimeter_m).buffer(room_m, join_style="mitre", mitre_limit=_MITRE)
    return safe_ground(shape, clearance_m)


def ground_of_sides(
    perimeter_m: Corners, rooms_m: Sequence[float], keep_outs_m: Sequence[Float[np.ndarray, "_ 2"]], clearance_m: float
) -> SafeGround:
    """Safe ground: a field and the declared room outside its sides, minus keep-outs.

    Ground straight in front of a side is safe only to the depth declared for that side (not at all without room), even
    if another side's room or a corner between deeper sides reaches there.

    Args:
        perimeter_m: corners of the field, counter-clockwise and simple.
        rooms_m: room outside each side, from its first corner on; 0: none.
        keep_outs_m: rings of the keep-outs, including their buffers.
        clearance_m: see ``SafeGround``.
    """
    field = shapely.Polygon(perimeter_m)
    starts, ends = perimeter_m, np.roll(perimeter_m, -1, axis=0)
    deepest_m = max(rooms_m, default=0.0)
    free: list[Any] = []
    shut: list[Any] = []
    for number, (start, end, room_m) in enumerate(zip(starts, ends, rooms_m, strict=True)):
        along = (end - start) / np.hypot(*(end - start))
        out = np.array([along[1], -along[0]])
        before_m = rooms_m[number - 1]
        if room_m > 0.0:
            free.append(shapely.Polygon([start, start + room_m * out, end + room_m * out, end]))
            if before_m > 0.0:
                free.append(shapely.Point(start).buffer(min(room_m, before_m), quad_segs=16))
        if room_m < deepest_m:
            near_m, far_m = room_m * out, deepest_m * out
            shut.append(shapely.Polygon([start + near_m, start + far_m, end + far_m, end + near_m]))
    outside = shapely.difference(shapely.union_all(free, grid_size=GRID_M), field, grid_size=GRID_M)
    if shut:
        outside = shapely.difference(outside, shapely.union_all(shut, grid_size=GRID_M), grid_size=GRID_M)
    # An overlay may return lines in addition to areas, and such a mixture cannot be joined to a field.
    parts = [each for each in shapely.get_parts(shapely.get_parts(outside)) if each.geom_type == "Polygon"]
    shape = shapely.union(field, shapely.multipolygons(parts), grid_size=GRID_M) if parts else field
    if keep_outs_m:
        away = shapely.union_all([shapely.Polygon(ring) for ring in keep_outs_m], grid_size=GRID_M)
        shape = shapely.difference(shape, away, grid_size=GRID_M)
    return safe_ground(shape, clearance_m)


def buffered(ring_m: Corners, buffer_m: float) -> Float[np.ndarray, "_ 2"]:
    """A keep-out grown by its buffer; its corners are cut at twice that.

    Raises:
        InputError: a ring that encloses nothing, or whose sides cross.
    """
    shape = shapely.Polygon(ring_m)
    if not shape.is_valid or shape.area <= 0.0:
        raise InputError("keep-out", "sides", "a ring whose sides do not cross", shapely.is_valid_reason(shape))
    grown = shape.buffer(buffer_m, join_style="mitre", mitre_limit=_MITRE) if buffer_m > 0.0 else shape
    return _ring(shapely.Polygon(grown.exterior).normalize().exterior)


# The check.


def ground_of_plan(pattern: Pattern, ground: SafeGround | None, outline: Outline, *, spare_m: float) -> SafeGround:
    """The declared ground of a plan; without one, the ground that vehicle and tool need, with spare room.

    Args:
        pattern: pattern of the plan.
        ground: ground declared in the plan.
        outline: outline of vehicle and tool.
        spare_m: spare room for the margins of ``StopRules``, the stopping distance and the tracking error: about 0.8 m.
    """
    if ground is not None:
        return ground
    perimeter_m = pattern.field.perimeter_m
    return ground_around(perimeter_m, room_needed_m(perimeter_m, pattern, outline) + spare_m, 0.0)


def room_needed_m(perimeter_m: Corners, pattern: Pattern, outline: Outline) -> float:
    """Largest distance of vehicle and tool beyond a perimeter on a pattern, metres."""
    shapes = [shape for _, shape in _swept(pattern, outline)]
    corners = shapely.points(shapely.get_coordinates(shapes))
    return float(np.max(shapely.distance(shapely.Polygon(perimeter_m), corners), initial=0.0))


def breaches(pattern: Pattern, ground: SafeGround, outline: Outline) -> list[Breach]:
    """Places where vehicle or tool would leave the safe ground minus its clearance; none if the plan can be driven.

    Args:
        pattern: pattern of the plan.
        ground: safe ground.
        outline: outline of vehicle and tool.
    """
    swept = _swept(pattern, outline)
    kept = ground.kept
    shapely.prepare(kept)
    shapes = np.array([shape for _, shape in swept], object)
    found: dict[str, Breach] = {}
    for number in np.flatnonzero(~shapely.covers(kept, shapes)):
        place = swept[number][0]
        corners = shapely.get_coordinates(shapes[number])
        away = shapely.distance(kept, shapely.points(corners))
        worst = int(np.argmax(away))
        # A border that bends in between two corners of the vehicle leaves all of them within.
        missing_m = max(float(away[worst]), _TOLERANCE_M)
        if place not in found or missing_m > found[place].missing_m:
            found[place] = Breach(place, float(corners[worst, 0]), float(corners[worst, 1]), missing_m)
    return list(found.values())


def check_drivable(pattern: Pattern, ground: SafeGround, outline: Outline, *, name: str) -> None:
    """Refuse a plan that does not keep to its ground.

    Raises:
        InputError: the plan leaves its ground; the message names the worst place.
    """
    found = breaches(pattern, ground, outline)
    if found:
        worst = max(found, key=lambda each: each.missing_m)
        expected = f"vehicle and tool {ground.clearance_m:.2f} m within the ground declared safe"
        where = f"{worst.missing_m:.2f} m short at {worst.east_m:.1f} m east, {worst.north_m:.1f} m north of the anchor"
        raise InputError(name, worst.place, expected, where)


def _swept(pattern: Pattern, outline: Outline) -> list[tuple[str, Any]]:
    """Place and swept polygon of each straight piece, and of small steps of each arc."""
    swept = []
    for number, line in enumerate(pattern.lines):
        start = pose_on_line(line, pattern.settings.tool_ahead_m, pattern.settings.tool_left_m)
        body = _straight(start[None], np.array([line.length_m]), outline)
        swept.append((f"line {line.number}", shapely.polygons(body)[0]))
        if number < len(pattern.turns):
            place = f"turn from line {line.number} to line {pattern.lines[number + 1].number}"
            swept += [(place, shape) for shape in swept_of_turn(pattern.turns[number], outline)]
    return swept


def pose_on_line(line: Line, ahead_m: float, left_m: float) -> Float[np.ndarray, "3"]:
    """Pose of the reference point (x_m, y_m, yaw_rad) where the tool's centre begins a line."""
    along = (line.end_m - line.start_m) / max(line.length_m, 1e-9)
    x, y = line.start_m - ahead_m * along - left_m * np.array([-along[1], along[0]])
    return np.array([x, y, math.atan2(along[1], along[0])])


def swept_of_turn(turn: HeadlandTurn, outline: Outline) -> list[Any]:
    """Polygons that a turn sweeps: of each straight piece, and of small steps along each arc."""
    begins = np.concatenate([[0.0], np.cumsum(np.abs(turn.pieces[:, 0]))])
    knots = poses_along(turn.start, turn.pieces, begins)
    length_m, curvature = turn.pieces.T
    straight = np.flatnonzero(curvature == 0.0)
    # Of a knot between two pieces the yaw is that of both.
    corners = [_straight(knots[straight], length_m[straight], outline)]
    arcs = []
    for number in np.flatnonzero(curvature != 0.0):
        count = max(math.ceil(abs(length_m[number] * curvature[number]) / _ARC_RAD), 1) + 1
        arcs.append(np.linspace(begins[number], begins[number + 1], count))
    if arcs:
        corners.append(rectangles(poses_along(turn.start, turn.pieces, np.concatenate(arcs)), outline))
    return list(shapely.polygons(np.concatenate(corners)))


def _straight(
    starts: Float[np.ndarray, "way 3"], length_m: Float[np.ndarray, " way"], outline: Outline
) -> Float[np.ndarray, "way 4 2"]:
    """Corners of what the outline sweeps on straight ways from poses, those of negative length in reverse."""
    front, rear, left, right = outline
    ahead, behind = front + np.maximum(length_m, 0.0), rear + np.minimum(length_m, 0.0)
    x, y = np.stack([ahead, behind, behind, ahead], axis=1), np.array([left, left, right, right])
    return _placed(starts, x, y)


def rectangles(poses: Float[np.ndarray, "place 3"], outline: Outline) -> Float[np.ndarray, "place 4 2"]:
    """Corners of the outline at poses."""
    front, rear, left, right = outline
    return _placed(poses, np.array([front, rear, rear, front]), np.array([left, left, right, right]))


def _placed(
    poses: Float[np.ndarray, "place 3"], x: Float[np.ndarray, "*place 4"], y: Float[np.ndarray, "4"]
) -> Float[np.ndarray, "place 4 2"]:
    """Points of the body at poses."""
    cos, sin = np.cos(poses[:, 2:]), np.sin(poses[:, 2:])
    return np.stack([poses[:, :1] + cos * x - sin * y, poses[:, 1:2] + sin * x + cos * y], axis=-1)
