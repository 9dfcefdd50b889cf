"""The carrot of MF section 2: a goal that waits on the route, then moves on as fast as the vehicle, and a PID.

The error is the angle between the goal line and the way from the vehicle to the carrot. The goal line leads from the
vehicle's foot on the route to the carrot: on a line of the pattern it is that line itself, as in MF; on an end arc it
is the chord, so that a vehicle on the arc has no error. With the offset y, the carrot d ahead and the heading ψ the
error is −y/d, and its change a metre of way −ψ/d; the derivative is taken from this geometry and not from differences,
so that a fix which moves the estimate is no kick. Gains count by way, not by time: they serve every speed. The law is

    κ = κ_route + P e + I ∫ e ds + D de/ds,

hence s² + (D/d) s + P/d about a line: pure pursuit is P = 2/d, I = 0, D = 2.
"""

import math
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int, Int32

from lgprjax.coverage.pattern import Pattern
from lgprjax.coverage.turns import Pose, poses_along
from lgprjax.errors import InputError
from lgprjax.vehicle.kinematics import VehiclePose

# The route of a coverage pattern as a table at even spacing, for guidance: the path of the vehicle's reference point.
#
# Each row's curvature is the mean to the next row, so headings join exactly; where an arc begins within a row the
# place is off by at most a quarter of the spacing's square over the arc's radius: 0.4 mm at 5 cm and 1.5 m. Rows are
# padded to sizes from a ladder: another pattern of like length is the same to the compiler.

SPACING_M = 0.05
LEAST_ROWS = 1024


class CoverRoute(NamedTuple):
    """A route in the plan's local frame.

    Attributes:
        rows: x_m, y_m, yaw_rad (not wrapped), curvature_radpm and tool_on (0 or 1) of the reference point, each valid
            to the next row. The tool is on if any part of the row's way is on a line. Padding continues straight, tool
            off.
        line: number of the row's line, in driving order from 0; -1 in turns and padding.
        spacing_m: distance between rows.
        length_m: length of the route.
        count: number of rows in use; the last is the route's end.
        legs: leg of each row, as in ``RouteLeg``; ``None`` if all is driven forwards. In reverse the yaw of a row is
            that of the way, opposite to the body's, and so is its curvature.
    """

    rows: Float[Array, "row 5"]
    line: Int32[Array, " row"]
    spacing_m: Float[Array, ""]
    length_m: Float[Array, ""]
    count: Int32[Array, ""]  # type: ignore[assignment]  # of rows, not the method of tuples
    legs: Float[Array, "row 4"] | None = None


class RouteLeg(NamedTuple):
    """A part of a route that is driven in one direction.

    Attributes:
        gear: 1 forward, -1 in reverse.
        first, last: numbers of its first and last row.
        end_m: arc length of its end; beyond it the leg continues straight.
    """

    gear: Float[Array, "..."]
    first: Float[Array, "..."]
    last: Float[Array, "..."]
    end_m: Float[Array, "..."]


def leg_at(route: CoverRoute, arc_m: Float[Array, "..."]) -> RouteLeg | None:
    """The leg at an arc length; ``None`` on a route that is driven forwards as a whole."""
    if route.legs is None:
        return None
    number = jnp.clip(jnp.floor(arc_m / route.spacing_m).astype(jnp.int32), 0, route.count - 1)
    leg = route.legs.at[number].get(mode="promise_in_bounds")
    return RouteLeg(leg[..., 0], leg[..., 1], leg[..., 2], leg[..., 3])


def gear_at(route: CoverRoute, arc_m: Float[Array, "..."]) -> Float[Array, "..."] | float:
    """1 where a route is driven forwards, -1 where it is driven in reverse."""
    leg = leg_at(route, arc_m)
    return 1.0 if leg is None else leg.gear


class RoutePoint(NamedTuple):
    """A point of the route.

    Attributes:
        x_m, y_m: position of the reference point.
        yaw_rad: direction of the way, not wrapped.
        curvature_radpm: curvature of the way, positive to the left.
        tool_on: 1 if the tool works, else 0.
        line: as in ``CoverRoute``.
    """

    x_m: Float[Array, "..."]
    y_m: Float[Array, "..."]
    yaw_rad: Float[Array, "..."]
    curvature_radpm: Float[Array, "..."]
    tool_on: Float[Array, "..."]
    line: Int[Array, "..."]


def lay_pattern(pattern: Pattern, *, spacing_m: float = SPACING_M) -> CoverRoute:
    """The route along a pattern: its lines and turns in driving order.

    Args:
        pattern: pattern from ``plan_pattern`` or ``plan_gaps``.
        spacing_m: largest spacing of rows; the spacing used divides the route.

    Raises:
        InputError: the spacing is not above zero, or longer than half the tightest radius.
    """
    longest_m = min(1.0, 0.5 * pattern.tightest_radius_m)
    if not 0.0 < spacing_m <= longest_m:
        raise InputError("route", "spacing_m", f"above 0 and at most {longest_m:.3f} m", f"{spacing_m:g}")
    ways = [np.array([[pattern.lines[0].length_m, 0.0]])]
    for turn, after in zip(pattern.turns, pattern.lines[1:], strict=True):
        ways += [turn.pieces, np.array([[after.length_m, 0.0]])]
    lengths_m = np.array([np.abs(way[:, 0]).sum() for way in ways])
    pieces = np.concatenate(ways)
    ends_m = np.cumsum(lengths_m)
    count = max(math.ceil(ends_m[-1] / spacing_m), 1) + 1
    step_m = float(ends_m[-1]) / (count - 1)
    size = LEAST_ROWS
    while size < count:
        size *= 2
    poses = poses_along(_route_start(pattern), pieces, step_m * np.arange(size))
    curvature = np.zeros(size)
    curvature[: count - 1] = np.diff(poses[:count, 2]) / step_m
    legs = _legs(pieces, step_m, count, size)
    if legs is not None:
        in_reverse = legs[:, 0] < 0.0
        poses[in_reverse, 2] += math.pi
        curvature[legs[:, 2].astype(int)] = 0.0
    line = np.full(size, -1, np.int32)
    rounding = 1e-6
    for number in range(len(pattern.lines)):
        begin, end = ends_m[2 * number] - lengths_m[2 * number], ends_m[2 * number]
        line[math.floor(begin / step_m + rounding) : math.ceil(end / step_m - rounding)] = number
    if legs is not None:
        # A turn that ends in reverse has its last row within a step of the line.
        line[in_reverse] = -1
    rows = np.concatenate([poses, np.stack([curvature, line >= 0], axis=1)], axis=1)
    return CoverRoute(
        jnp.asarray(rows.astype(np.float32)),
        jnp.asarray(line),
        jnp.float32(step_m),
        jnp.float32(ends_m[-1]),
        jnp.int32(count),
        None if legs is None else jnp.asarray(legs.astype(np.float32)),
    )


def _legs(
    pieces: Float[np.ndarray, "piece 2"], step_m: float, count: int, size: int
) -> Float[np.ndarray, "row 4"] | None:
    """The leg of every row: gear, first and last row, end."""
    gears = np.where(pieces[:, 0] < 0.0, -1.0, 1.0)
    if (gears > 0.0).all():
        return None
    ends_m = np.cumsum(np.abs(pieces[:, 0]))
    changes = np.flatnonzero(gears[1:] != gears[:-1])
    borders = [*ends_m[changes].tolist(), float(ends_m[-1])]
    legs = np.zeros((size, 4))
    first = 0
    for number, end_m in enumerate(borders):
        gear = gears[changes[number]] if number < len(changes) else gears[-1]
        # A row on the border itself is the next leg's first.
        last = count - 1 if number == len(borders) - 1 else max(math.ceil(end_m / step_m - 1e-6) - 1, first)
        until = size if number == len(borders) - 1 else last + 1
        legs[first:until] = gear, first, last, end_m
        first = last + 1
    return legs


def route_point(route: CoverRoute, arc_m: Float[Array, "..."], leg: RouteLeg | None = None) -> RoutePoint:
    """The route's point at an arc length, extended straight before 0 and after the end, with the tool off.

    Args:
        route: route from ``lay_pattern``.
        arc_m: arc length along the route.
        leg: leg to stay on, extended straight before and after it.
    """
    number = jnp.clip(jnp.floor(arc_m / route.spacing_m).astype(jnp.int32), 0, route.count - 1)
    if leg is not None:
        return _leg_point(route, arc_m, leg)
    beyond_m = arc_m - number.astype(arc_m.dtype) * route.spacing_m
    row = route.rows.at[number].get(mode="promise_in_bounds")
    # The last row is straight with the tool off, as is the extension before the first.
    on_route = arc_m >= 0.0
    curvature = jnp.where(on_route, row[..., 3], 0.0)
    half = 0.5 * beyond_m * curvature
    chord_m = beyond_m * jnp.sinc(half / jnp.pi)
    yaw = row[..., 2]
    return RoutePoint(
        row[..., 0] + chord_m * jnp.cos(yaw + half),
        row[..., 1] + chord_m * jnp.sin(yaw + half),
        yaw + 2.0 * half,
        curvature,
        jnp.where(on_route, row[..., 4], 0.0),
        jnp.where(on_route, route.line.at[number].get(mode="promise_in_bounds"), -1),
    )


def _leg_point(route: CoverRoute, arc_m: Float[Array, "..."], leg: RouteLeg) -> RoutePoint:
    """A point of a leg: at the curvature of its row within it, straight before and after."""
    first, last = leg.first.astype(jnp.int32), leg.last.astype(jnp.int32)
    number = jnp.clip(jnp.floor(arc_m / route.spacing_m).astype(jnp.int32), first, last)
    row = route.rows.at[number].get(mode="promise_in_bounds")
    along_m = arc_m - number.astype(arc_m.dtype) * route.spacing_m
    bent_m = jnp.clip(
        along_m, 0.0, jnp.minimum(leg.end_m - number.astype(arc_m.dtype) * route.spacing_m, route.spacing_m)
    )
    on_leg = (along_m >= 0.0) & (arc_m <= leg.end_m)
    half = 0.5 * bent_m * row[..., 3]
    chord_m = bent_m * jnp.sinc(half / jnp.pi)
    yaw = row[..., 2] + 2.0 * half
    straight_m = along_m - bent_m
    return RoutePoint(
        row[..., 0] + chord_m * jnp.cos(row[..., 2] + half) + straight_m * jnp.cos(yaw),
        row[..., 1] + chord_m * jnp.sin(row[..., 2] + half) + straight_m * jnp.sin(yaw),
        yaw,
        jnp.where(on_leg, row[..., 3], 0.0),
        jnp.where(on_leg, row[..., 4], 0.0),
        jnp.where(on_leg, route.line.at[number].get(mode="promise_in_bounds"), -1),
    )


def _route_start(pattern: Pattern) -> Pose:
    """Pose of the reference point where the first line begins."""
    first, settings = pattern.lines[0], pattern.settings
    ahead = (first.end_m - first.start_m) / first.length_m
    left = np.array([-ahead[1], ahead[0]])
    x, y = first.start_m - settings.tool_ahead_m * ahead - settings.tool_left_m * left
    return Pose(float(x), float(y), math.atan2(ahead[1], ahead[0]))


# A vehicle's place relative to a coverage route: the foot is updated from the last one, never searched globally.
#
# Lines of a pattern are side by side and its turns cross them: the nearest point may belong to another line.

_STEPS = 2
_FARTHEST_M = 0.5
"""Largest motion of the foot in a search step: estimates jump, places on a route do not."""


class RouteFoot(NamedTuple):
    """Place of a vehicle relative to its route.

    Attributes:
        arc_m: arc length of the foot; negative before the start.
        point: route's point at the foot.
        cross_m: lateral offset of the vehicle, positive to the left of the driving direction.
        heading_error_rad: heading minus that of the route.
    """

    arc_m: Float[Array, "..."]
    point: RoutePoint
    cross_m: Float[Array, "..."]
    heading_error_rad: Float[Array, "..."]


def route_foot(route: CoverRoute, near_m: Float[Array, ""], pose: VehiclePose) -> RouteFoot:
    """Foot of a pose near an arc length; unbatched, use ``vmap`` for more. A NaN pose does not change the arc
    length.
    """
    arc_m, leg = near_m, leg_at(route, near_m)
    pose = _along_way(leg, pose)
    for _ in range(_STEPS):
        point = route_point(route, arc_m, leg)
        along, left = beside(point, pose)
        # Near the centre of curvature there is no foot; it is kept from getting there.
        share = jnp.maximum(1.0 - point.curvature_radpm * left, 0.2)
        step_m = jnp.clip(along / share, -_FARTHEST_M, _FARTHEST_M)
        arc_m = arc_m + jnp.where(jnp.isfinite(step_m), step_m, 0.0)
        if leg is not None:
            arc_m = _within_leg(route, arc_m, leg)
    point = route_point(route, arc_m, leg)
    _, left = beside(point, pose)
    turned = pose.yaw_rad - point.yaw_rad
    return RouteFoot(arc_m, point, left, jnp.arctan2(jnp.sin(turned), jnp.cos(turned)))


def _along_way(leg: RouteLeg | None, pose: VehiclePose) -> VehiclePose:
    """The pose as it moves along a leg: in reverse its yaw is opposite to the body's."""
    if leg is None:
        return pose
    return pose._replace(yaw_rad=pose.yaw_rad + jnp.where(leg.gear < 0.0, jnp.pi, 0.0))


def _within_leg(route: CoverRoute, arc_m: Float[Array, "..."], leg: RouteLeg) -> Float[Array, "..."]:
    """An arc length that rounding takes to no other leg; the route's first and last lead straight on."""
    low = jnp.where(leg.first > 0.0, (leg.first + 0.25) * route.spacing_m, -jnp.inf)
    # The last row may be cut short by the leg's end.
    inner = leg.last.astype(jnp.int32) < route.count - 1
    high = jnp.where(inner, jnp.minimum(leg.end_m, (leg.last + 0.9) * route.spacing_m), jnp.inf)
    return jnp.clip(arc_m, low, jnp.maximum(low, high))


def beside(point: RoutePoint, pose: VehiclePose) -> tuple[Float[Array, ""], Float[Array, ""]]:
    """Position of a pose along and to the left of a point of the route."""
    east, north = pose.x_m - point.x_m, pose.y_m - point.y_m
    cos, sin = jnp.cos(point.yaw_rad), jnp.sin(point.yaw_rad)
    return cos * east + sin * north, cos * north - sin * east


DONE_M = 0.05
"""Distance before its end at which the route is done."""
_CREEP_MPS = 0.05
_CATCH_UP = 1.5
"""Speed factor, relative to the vehicle, at which a lookahead point that is too close moves on."""
_INTEGRAL_SHARE = 0.25
"""Limit of the integral, as a share of the largest curvature."""


class CarrotSettings(NamedTuple):
    """Settings of the lookahead point (the "carrot" of MF) and its PID, float32 scalars or one value per batch element.

    Attributes:
        distance_m: distance of the carrot ahead, and at which it begins to move; look-ahead of pursuit.
        proportional_per_m: P, curvature per radian of error.
        integral_per_m2: I, curvature per radian of error and metre of way.
        derivative: D, curvature per change of the error in radians per metre.
        largest_curvature_radpm: largest commanded curvature, to either side.
        lead_s: time ahead at which the route's curvature is taken, for delay and lag of the wheels.
        largest_yaw_rate_radps: largest yaw rate, to which the vehicle slows down where the route bends.
        slow_mps2: deceleration towards the route's end.
    """

    distance_m: Float[Array, "..."]
    proportional_per_m: Float[Array, "..."]
    integral_per_m2: Float[Array, "..."]
    derivative: Float[Array, "..."]
    largest_curvature_radpm: Float[Array, "..."]
    lead_s: Float[Array, "..."]
    largest_yaw_rate_radps: Float[Array, "..."]
    slow_mps2: Float[Array, "..."]


class CarrotState(NamedTuple):
    """State of the guidance from step to step.

    Attributes:
        arc_m: arc length of the vehicle's foot on the route.
        carrot_m: arc length of the carrot.
        begun: whether the vehicle has come near enough for the carrot to move, or has passed it.
        integral_rad_m: integral of the error over the way.
        done: whether the route's end was reached.
    """

    arc_m: Float[Array, "..."]
    carrot_m: Float[Array, "..."]
    begun: Bool[Array, "..."]
    integral_rad_m: Float[Array, "..."]
    done: Bool[Array, "..."]


class CarrotPlan(NamedTuple):
    """Command of the guidance, and the vehicle's place on its route.

    Attributes:
        yaw_rate_radps: commanded yaw rate at the given speed.
        cross_m: lateral offset of the reference point from the route, positive to the left of the driving direction.
        heading_error_rad: heading minus that of the route.
        speed_limit_mps: speed limit by bends and by the route's end, where it is 0.
        tool_on: whether the tool is to work here.
        line: line of the pattern; −1 in a turn.
        to_go_m: distance to the route's end.
        done: whether the route's end was reached.
    """

    yaw_rate_radps: Float[Array, "..."]
    cross_m: Float[Array, "..."]
    heading_error_rad: Float[Array, "..."]
    speed_limit_mps: Float[Array, "..."]
    tool_on: Bool[Array, "..."]
    line: Int32[Array, "..."]
    to_go_m: Float[Array, "..."]
    done: Bool[Array, "..."]


class Goal(NamedTuple):
    """Foot of the vehicle, carrot, and vectors to the carrot, in level metres.

    Attributes:
        foot: foot of the vehicle on the route.
        chord_m: vector from the foot to the carrot, east and north.
        way_m: vector from the vehicle to the carrot, east and north.
        yaw_rad: direction of the route at the carrot.
        moves: 1 if the carrot moves, 0 if it waits.
    """

    foot: RouteFoot
    chord_m: tuple[Float[Array, ""], Float[Array, ""]]
    way_m: tuple[Float[Array, ""], Float[Array, ""]]
    yaw_rad: Float[Array, ""]
    moves: Float[Array, ""]


def default_carrot(*, smallest_radius_m: float) -> CarrotSettings:
    """Settings for a small machine at walking speed: damping 0.9, a natural wavelength of 5.6 m.

    The curvature may exceed that of the smallest radius by a third, which leaves room for corrections on the tightest
    arc.
    """
    values = (1.2, 1.5, 0.0, 2.4, 4.0 / (3.0 * smallest_radius_m), 0.3, 0.2, 0.2)
    return CarrotSettings(*(jnp.float32(value) for value in values))


def init_carrot(arc_m: float = 0.0) -> CarrotState:
    """A carrot that waits at an arc length of the route, usually its start; one lane."""
    zero, no = jnp.float32(0.0), jnp.asarray(False)
    return CarrotState(jnp.float32(arc_m), jnp.float32(arc_m), no, zero, no)


def step_carrot(
    settings: CarrotSettings,
    route: CoverRoute,
    state: CarrotState,
    pose: VehiclePose,
    speed_mps: Float[Array, ""],
    step_s: Float[Array, ""],
) -> tuple[CarrotState, CarrotPlan]:
    """One step of the PID; one batch element, more by ``vmap``.

    Args:
        settings: settings of carrot and PID.
        route: route to drive.
        state: state of the last step.
        pose: pose of the reference point.
        speed_mps: forward speed for which the yaw rate is computed.
        step_s: time since the last step.
    """
    leg = leg_at(route, state.arc_m)
    state, goal = lead(settings, route, state, pose, speed_mps, step_s)
    pose = _along_way(leg, pose)
    (chord_x, chord_y), (way_x, way_y) = goal.chord_m, goal.way_m
    error = jnp.arctan2(chord_x * way_y - chord_y * way_x, chord_x * way_x + chord_y * way_y)
    change = _turning(goal.way_m, pose.yaw_rad, goal) - _turning(goal.chord_m, goal.foot.point.yaw_rad, goal)
    way_m = jnp.maximum(speed_mps, 0.0) * step_s
    gain, learns = settings.integral_per_m2, settings.integral_per_m2 > 0.0
    most = jnp.where(learns, _INTEGRAL_SHARE * settings.largest_curvature_radpm / jnp.where(learns, gain, 1.0), 0.0)
    grown = jnp.clip(state.integral_rad_m + jnp.where(state.begun, error * way_m, 0.0), -most, most)
    bend = route_point(route, goal.foot.arc_m + jnp.maximum(speed_mps, 0.0) * settings.lead_s, leg).curvature_radpm
    wanted = bend + settings.proportional_per_m * error + gain * grown + settings.derivative * change
    within = jnp.abs(wanted) <= settings.largest_curvature_radpm
    # Turns beyond the vehicle's limit must not be integrated.
    integral = jnp.where(within, grown, state.integral_rad_m)
    return state._replace(integral_rad_m=integral), plan_of(settings, route, state, goal.foot, wanted, speed_mps, leg)


def lead(
    settings: CarrotSettings,
    route: CoverRoute,
    state: CarrotState,
    pose: VehiclePose,
    speed_mps: Float[Array, ""],
    step_s: Float[Array, ""],
) -> tuple[CarrotState, Goal]:
    """The foot and the carrot, carried on by a step."""
    foot, leg = route_foot(route, state.arc_m, pose), leg_at(route, state.arc_m)
    waits = route_point(route, state.carrot_m, leg)
    distance = jnp.hypot(waits.x_m - pose.x_m, waits.y_m - pose.y_m)
    # A vehicle that has passed its lookahead point, waiting or while the operator drove on, would be steered away from
    # its line by a point behind it: it is moved ahead at once.
    passed = foot.arc_m > state.carrot_m
    begun = state.begun | passed | (distance <= settings.distance_m)
    furthest = state.carrot_m + _CATCH_UP * jnp.maximum(speed_mps, 0.0) * step_s
    furthest = jnp.where(passed, foot.arc_m + settings.distance_m, furthest)
    moved = jnp.clip(foot.arc_m + settings.distance_m, state.carrot_m, jnp.maximum(furthest, state.carrot_m))
    carrot_m = jnp.where(begun, moved, state.carrot_m)
    carrot = route_point(route, carrot_m, leg)
    goal = Goal(
        foot,
        (carrot.x_m - foot.point.x_m, carrot.y_m - foot.point.y_m),
        (carrot.x_m - pose.x_m, carrot.y_m - pose.y_m),
        carrot.yaw_rad,
        jnp.where(begun, 1.0, 0.0),
    )
    done = state.done | (begun & (route.length_m - foot.arc_m <= DONE_M))
    arc_m = foot.arc_m
    if leg is not None:
        # At a cusp the next leg is taken up; the vehicle turns its wheels round by way of standstill.
        last = leg.last.astype(jnp.int32) >= route.count - 1
        over = begun & ~last & (leg.end_m - foot.arc_m <= jnp.maximum(DONE_M, route.spacing_m))
        next_m = (leg.last + 1.25) * route.spacing_m
        arc_m = jnp.where(over, next_m, arc_m)
        carrot_m = jnp.where(over, next_m + settings.distance_m, carrot_m)
        done = state.done | (begun & last & (route.length_m - foot.arc_m <= DONE_M))
    return CarrotState(arc_m, carrot_m, begun, state.integral_rad_m, done), goal


def plan_of(
    settings: CarrotSettings,
    route: CoverRoute,
    state: CarrotState,
    foot: RouteFoot,
    curvature_radpm: Float[Array, ""],
    speed_mps: Float[Array, ""],
    leg: RouteLeg | None,
) -> CarrotPlan:
    """The plan that follows from a wanted curvature."""
    largest = settings.largest_curvature_radpm
    to_go = route.length_m - foot.arc_m
    to_stop = to_go if leg is None else leg.end_m - foot.arc_m
    slow = jnp.sqrt(2.0 * settings.slow_mps2 * jnp.maximum(to_stop, 0.0))
    # Half-way to the lookahead point: slow down for a bend before it begins.
    bend = jnp.maximum(
        jnp.abs(foot.point.curvature_radpm),
        jnp.abs(route_point(route, foot.arc_m + 0.5 * settings.distance_m, leg).curvature_radpm),
    )
    slow = jnp.minimum(slow, settings.largest_yaw_rate_radps / jnp.maximum(bend, 1e-6))
    return CarrotPlan(
        yaw_rate_radps=speed_mps * jnp.clip(curvature_radpm, -largest, largest),
        cross_m=foot.cross_m,
        heading_error_rad=foot.heading_error_rad,
        speed_limit_mps=jnp.where(state.done, 0.0, jnp.maximum(slow, _CREEP_MPS)),
        tool_on=(foot.point.tool_on > 0.5) & state.begun & ~state.done,
        line=foot.point.line,
        to_go_m=to_go,
        done=state.done,
    )


def _turning(
    vector_m: tuple[Float[Array, ""], Float[Array, ""]], yaw_rad: Float[Array, ""], goal: Goal
) -> Float[Array, ""]:
    """Turn of a vector to the carrot per metre of way, if its foot moves along ``yaw_rad`` and the carrot as fast."""
    east = goal.moves * jnp.cos(goal.yaw_rad) - jnp.cos(yaw_rad)
    north = goal.moves * jnp.sin(goal.yaw_rad) - jnp.sin(yaw_rad)
    square = vector_m[0] * vector_m[0] + vector_m[1] * vector_m[1]
    return (vector_m[0] * north - vector_m[1] * east) / jnp.maximum(square, 0.01)


# The pursuit law on a coverage route: one arc that leads the reference point through the carrot.


def pursuit_along(
    settings: CarrotSettings,
    route: CoverRoute,
    state: CarrotState,
    pose: VehiclePose,
    speed_mps: Float[Array, ""],
    step_s: Float[Array, ""],
) -> tuple[CarrotState, CarrotPlan]:
    """One step of the law, in place of ``step_carrot``: same carrot, same arguments, no gains; one lane.

    With the carrot at distance D and bearing η in the body frame the arc's curvature is 2 sin η / D.
    """
    leg = leg_at(route, state.arc_m)
    state, goal = lead(settings, route, state, pose, speed_mps, step_s)
    pose = _along_way(leg, pose)
    way_x, way_y = goal.way_m
    aside = jnp.cos(pose.yaw_rad) * way_y - jnp.sin(pose.yaw_rad) * way_x
    curvature = 2.0 * aside / jnp.maximum(way_x * way_x + way_y * way_y, 0.01)
    return state, plan_of(settings, route, state, goal.foot, curvature, speed_mps, leg)
