"""The planner: the vehicle's place on its route, and the lookahead point for the pursuit law.

The closest point is searched in a window around the point predicted by the vehicle's own motion, never on the whole
route: at a crossing it stays on its branch. Without a known place it does not guess; ``find_starts`` begins,
explicitly.
"""

from enum import IntEnum
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Bool, Float, Int

from lgprjax.navigation.kalman import wrap_yaw
from lgprjax.navigation.route import RoutePath, leg_point, leg_project, leg_row
from lgprjax.vehicle import Chassis, PathPoint, VehiclePose, anchor_lead_m, body_point, reverse_look_ahead_m

# Settings, state and output of the planner: plan and code.


class PlanCode(IntEnum):
    """Status of a plan. ``OFF_ROUTE`` to ``LOST`` stay until a start is found again, ``DONE`` as well."""

    FOLLOWING = 0
    OFF_ROUTE = 1
    AMBIGUOUS = 2
    WRONG_HEADING = 3
    LOST = 4
    AT_CUSP = 5
    DONE = 6
    NON_FINITE = 7


class PlannerSettings(NamedTuple):
    """Float32 scalars, or one value per batch element.

    Attributes:
        look_ahead_m: along the route, of the commanded speed: the caller sets it from its schedule each step.
        search_m: search distance for the closest point, to either side of the expected one.
        position_threshold_m: a closest point whose motion differs from the vehicle's by more than this is rejected;
            starts that differ by more along the route are two.
        ambiguity_m: a second start no farther than this beyond the nearest makes the choice the operator's.
        heading_gate_rad: largest error of heading at a start.
        off_route_m: distance from the route beyond which it is not followed, and no start is found.
        arrive_m: distance from the end of a leg within which the vehicle stops.
        standing_mps: below it the vehicle stands, and the gear may change.
        stop_mps2: deceleration towards a leg's end, independent of the look-ahead.
        creep_mps: least speed limit until it has arrived.
    """

    look_ahead_m: Float[Array, "..."]
    search_m: Float[Array, "..."]
    position_threshold_m: Float[Array, "..."]
    ambiguity_m: Float[Array, "..."]
    heading_gate_rad: Float[Array, "..."]
    off_route_m: Float[Array, "..."]
    arrive_m: Float[Array, "..."]
    standing_mps: Float[Array, "..."]
    stop_mps2: Float[Array, "..."]
    creep_mps: Float[Array, "..."]


class PlannerState(NamedTuple):
    """State of the planner.

    Attributes:
        leg, arc_m: of the closest point.
        travel: 1 along the route as recorded, -1 against it.
        facing: 1 where the body points as it did when recorded, -1 turned round. The gear is the leg's recorded one
            times both.
        pose: of the rear axle in the last step, in the route's frame.
        code: of ``PlanCode``.
    """

    leg: Int[Array, "..."]
    arc_m: Float[Array, "..."]
    travel: Float[Array, "..."]
    facing: Float[Array, "..."]
    pose: VehiclePose
    code: Int[Array, "..."]


class Plan(NamedTuple):
    """Output of one step; signs are those of the direction of travel.

    Attributes:
        ahead_m, left_m: goal from the anchor in the body frame, behind when reversing.
        offset_m: of the anchor from the route, positive to the left of travel.
        heading_error_rad: of the body relative to its heading when the anchor follows the route here without slip,
            counter-clockwise.
        curvature_radpm: of the route here, positive to the left of travel.
        speed_limit_mps: magnitude; 0 unless the route is being followed.
        to_go_m: to the end of the leg, where the vehicle stops.
        gear: 1 forward, -1 reverse.
        code: of ``PlanCode``.
    """

    ahead_m: Float[Array, "..."]
    left_m: Float[Array, "..."]
    offset_m: Float[Array, "..."]
    heading_error_rad: Float[Array, "..."]
    curvature_radpm: Float[Array, "..."]
    speed_limit_mps: Float[Array, "..."]
    to_go_m: Float[Array, "..."]
    gear: Float[Array, "..."]
    code: Int[Array, "..."]


def planner_settings(look_ahead_m: float, *, off_route_m: float = 10.0, ambiguity_m: float = 1.5) -> PlannerSettings:
    """Settings for a vehicle of a few metres; 10 m from the route is LL's limit for steering."""
    numbers = (look_ahead_m, 3.0, 2.0, ambiguity_m, jnp.pi / 4.0, off_route_m, 0.3, 0.1, 0.5, 0.3)
    return PlannerSettings(*(jnp.float32(value) for value in numbers))


def lost_planner() -> PlannerState:
    """A planner without a known place."""
    zero = jnp.float32(0.0)
    one = jnp.float32(1.0)
    return PlannerState(jnp.int32(0), zero, one, one, VehiclePose(zero, zero, zero), jnp.int32(PlanCode.LOST))


ENDLESS_M = 1e6
"""Remaining distance on a closed leg."""
_SIDE = 6
_REVERSE_SHARE = 1.2
_TURNED_ROUND_RAD = 2.1
_LEAST_SHARE = 0.2


def step_planner(
    route: RoutePath,
    settings: PlannerSettings,
    chassis: Chassis,
    state: PlannerState,
    pose_route: VehiclePose,
    speed_mps: Float[Array, ""],
) -> tuple[PlannerState, Plan]:
    """One step: update the closest point, and place the goal ahead of it in the direction of travel.

    Unbatched; ``vmap`` for many, with a common route or one each.

    Args:
        route: to follow.
        settings: thresholds and the look-ahead of the commanded speed. Reversing, it is at least 1.2 times
            2 |l − x_c|.
        chassis: scalars; its anchor follows the route.
        state: of the last step, or from ``acquire``.
        pose_route: rear axle in the route's frame. Non-finite numbers leave the state unchanged.
        speed_mps: as measured, signed.

    Returns:
        State and plan.
    """
    finite = jnp.isfinite(pose_route.x_m) & jnp.isfinite(pose_route.y_m) & jnp.isfinite(pose_route.yaw_rad)
    pose = VehiclePose(*(jnp.where(finite, new, old) for new, old in zip(pose_route, state.pose, strict=True)))
    turning = finite & (state.code == PlanCode.AT_CUSP) & (jnp.abs(speed_mps) < settings.standing_mps)
    leg, arc = _next_leg(route, state, turning)
    x, y = body_point(pose, chassis.anchor_m)
    arc, offset, distance = _track(route, settings, chassis, state, leg, arc, pose, x, y)

    here = leg_point(route, leg, arc)
    facing = state.facing * route.gear[leg]
    gear = facing * state.travel
    error = wrap_yaw(pose.yaw_rad - body_yaw(chassis, here, facing))
    length, closed = route.legs.length_m[leg], route.legs.laps_per_m[leg] > 0.0
    to_go = jnp.where(closed, ENDLESS_M, jnp.where(state.travel > 0.0, length - arc, arc))

    least = _REVERSE_SHARE * reverse_look_ahead_m(chassis)
    ahead = jnp.where(gear < 0.0, jnp.maximum(settings.look_ahead_m, least), settings.look_ahead_m)
    # Beyond the leg's end the goal is on its straight continuation, never beyond a cusp.
    goal = leg_point(route, leg, arc + state.travel * ahead)
    east, north = goal.x_m - x, goal.y_m - y
    cos, sin = jnp.cos(pose.yaw_rad), jnp.sin(pose.yaw_rad)

    last = jnp.where(state.travel > 0.0, leg == route.leg_count - 1, leg == 0)
    code = _code(settings, state.code, to_go, last, distance, error)
    blind = _is_blind(code)
    row, _ = leg_row(route, leg, arc)
    approach = jnp.maximum(
        jnp.sqrt(2.0 * settings.stop_mps2 * jnp.maximum(to_go - settings.arrive_m, 0.0)), settings.creep_mps
    )
    drives = finite & (code == PlanCode.FOLLOWING)
    plan = Plan(
        ahead_m=jnp.where(blind, gear * ahead, east * cos + north * sin),
        left_m=jnp.where(blind, 0.0, north * cos - east * sin),
        offset_m=jnp.where(blind, 0.0, state.travel * offset),
        heading_error_rad=jnp.where(blind, 0.0, error),
        curvature_radpm=jnp.where(blind, 0.0, state.travel * here.curvature_radpm),
        speed_limit_mps=jnp.where(drives, jnp.minimum(route.speed_mps[leg, row], approach), 0.0),
        to_go_m=jnp.where(blind, 0.0, to_go),
        gear=gear,
        code=jnp.where(finite, code, PlanCode.NON_FINITE),
    )
    # An error of heading is reported, but the place is not lost: the next step may be right again.
    kept = jnp.where(finite & (code != PlanCode.WRONG_HEADING), code, state.code)
    return PlannerState(leg, arc, state.travel, state.facing, pose, kept), plan


def body_yaw(chassis: Chassis, here: PathPoint, facing: Float[Array, ""]) -> Float[Array, ""]:
    """Yaw of the body when its anchor drives along a path without slip: the path's heading minus asin((l − x_c) κ).

    Args:
        chassis: scalars.
        here: point of the path.
        facing: 1 where the body points along the path, -1 where it points against it, whatever the gear.
    """
    swing = jnp.clip(facing * anchor_lead_m(chassis) * here.curvature_radpm, -0.95, 0.95)
    return jnp.arctan2(facing * here.sin, facing * here.cos) - jnp.arcsin(swing)


def _next_leg(
    route: RoutePath, state: PlannerState, turning: Bool[Array, ""]
) -> tuple[Int[Array, ""], Float[Array, ""]]:
    """The leg beyond a cusp and the arc length there of a vehicle short of the cusp, or beyond it."""
    short = jnp.where(state.travel > 0.0, route.legs.length_m[state.leg] - state.arc_m, state.arc_m)
    leg = jnp.where(turning, jnp.clip(state.leg + state.travel.astype(jnp.int32), 0, route.leg_count - 1), state.leg)
    arc = jnp.where(state.travel > 0.0, short, route.legs.length_m[leg] - short)
    return leg, jnp.where(turning, arc, state.arc_m)


def _track(
    route: RoutePath,
    settings: PlannerSettings,
    chassis: Chassis,
    state: PlannerState,
    leg: Int[Array, ""],
    arc_m: Float[Array, ""],
    pose: VehiclePose,
    x_m: Float[Array, ""],
    y_m: Float[Array, ""],
) -> tuple[Float[Array, ""], Float[Array, ""], Float[Array, ""]]:
    """Arc length of the closest point, the offset left of the leg, and the distance from the leg's stretch."""
    was = leg_point(route, leg, arc_m)
    was_x, was_y = body_point(state.pose, chassis.anchor_m)
    aside = (was_y - was.y_m) * was.cos - (was_x - was.x_m) * was.sin
    share = jnp.maximum(1.0 - was.curvature_radpm * aside, _LEAST_SHARE)
    expected = arc_m + ((x_m - was_x) * was.cos + (y_m - was_y) * was.sin) / share

    arcs = expected + settings.search_m * jnp.linspace(-1.0, 1.0, 2 * _SIDE + 1, dtype=arc_m.dtype)
    points = jax.vmap(lambda at: leg_point(route, leg, at))(arcs)
    # On a path that returns within the window, the part with another direction is left out.
    along = (points.cos * jnp.cos(pose.yaw_rad) + points.sin * jnp.sin(pose.yaw_rad)) * state.facing * route.gear[leg]
    square = (points.x_m - x_m) ** 2 + (points.y_m - y_m) ** 2
    gated = jnp.where(along > 0.0, square, jnp.inf)
    near = jnp.where(jnp.any(along > 0.0), arcs[jnp.argmin(gated)], expected)
    foot = leg_project(route, leg, leg_project(route, leg, near, x_m, y_m).arc_m, x_m, y_m)
    taken = jnp.abs(foot.arc_m - expected) <= settings.position_threshold_m
    arc = jnp.where(taken, foot.arc_m, expected)

    closed = route.legs.laps_per_m[leg] > 0.0
    on_leg = jnp.where(closed, arc, jnp.clip(arc, 0.0, route.legs.length_m[leg]))
    place, point = leg_point(route, leg, on_leg), leg_point(route, leg, arc)
    offset = (y_m - point.y_m) * point.cos - (x_m - point.x_m) * point.sin
    return arc, offset, jnp.hypot(x_m - place.x_m, y_m - place.y_m)


def _code(
    settings: PlannerSettings,
    before: Int[Array, ""],
    to_go_m: Float[Array, ""],
    last: Bool[Array, ""],
    distance_m: Float[Array, ""],
    error_rad: Float[Array, ""],
) -> Int[Array, ""]:
    """The code of a step from the previous one: later, worse conditions win."""
    arrived = to_go_m <= settings.arrive_m
    code = jnp.where(arrived, jnp.where(last, PlanCode.DONE, PlanCode.AT_CUSP), PlanCode.FOLLOWING)
    code = jnp.where(before == PlanCode.DONE, PlanCode.DONE, code)
    code = jnp.where(jnp.abs(error_rad) > _TURNED_ROUND_RAD, PlanCode.WRONG_HEADING, code)
    code = jnp.where(distance_m > settings.off_route_m, PlanCode.OFF_ROUTE, code)
    stays = (before >= PlanCode.OFF_ROUTE) & (before <= PlanCode.LOST)
    return jnp.where(stays, before, code).astype(jnp.int32)


def _is_blind(code: Int[Array, ""]) -> Bool[Array, ""]:
    """No place on the route is known."""
    return (code == PlanCode.AMBIGUOUS) | (code == PlanCode.LOST)


# Start of a drive on a route: searched explicitly, over the whole route, never guessed.
#
# Only here is the whole route searched. The operator chooses between two equally near places.

CANDIDATES = 8


class Starts(NamedTuple):
    """Places where a vehicle could begin, nearest first.

    Attributes:
        leg, arc_m: of the place.
        distance_m: of the anchor from it.
        travel: 1 along the route as recorded, -1 against it.
        facing: 1 where the body points as it did when recorded, -1 turned round.
        valid: the place is close enough, and the heading fits.
        pose: of the rear axle, as given to the search.
        code: of ``PlanCode``: ``FOLLOWING`` where the first place is the one, else ``AMBIGUOUS``, ``OFF_ROUTE``,
            ``WRONG_HEADING`` or ``NON_FINITE``.
    """

    leg: Int[Array, "... candidate"]
    arc_m: Float[Array, "... candidate"]
    distance_m: Float[Array, "... candidate"]
    travel: Float[Array, "... candidate"]
    facing: Float[Array, "... candidate"]
    valid: Bool[Array, "... candidate"]
    pose: VehiclePose
    code: Int[Array, "..."]


def find_starts(
    route: RoutePath,
    settings: PlannerSettings,
    chassis: Chassis,
    pose_route: VehiclePose,
    gear: float | Float[Array, ""] = 1.0,
) -> Starts:
    """Nearest places of every stretch of the route, each with the direction of travel from the vehicle's heading.

    Unbatched. Facing as recorded the vehicle travels along the route, turned round against it; with gear -1 the
    opposite, every leg backward.

    Args:
        route: all legs are searched.
        settings: thresholds.
        chassis: scalars; with the anchor that should be on the route.
        pose_route: rear axle in the route's frame.
        gear: 1 to drive each leg in the gear that it was recorded in, -1 in the other.
    """
    x, y = body_point(pose_route, chassis.anchor_m)
    leg, near_m, found = _nearest(route, x, y)
    arc, point = jax.vmap(lambda one, at: _refined(route, one, at, x, y))(leg, near_m)
    distance = jnp.where(found, jnp.hypot(point.x_m - x, point.y_m - y), jnp.inf)
    recorded = route.gear[leg]

    # The body as recorded points along the leg, or against it where it reversed.
    def yaw_error(at: PathPoint, faces: Float[Array, ""]) -> Float[Array, ""]:
        return wrap_yaw(pose_route.yaw_rad - body_yaw(chassis, at, faces))

    error, round_error = jax.vmap(yaw_error)(point, recorded), jax.vmap(yaw_error)(point, -recorded)
    facing = jnp.where(jnp.abs(error) <= jnp.abs(round_error), 1.0, -1.0)
    fits = jnp.minimum(jnp.abs(error), jnp.abs(round_error)) <= settings.heading_gate_rad
    close = distance <= settings.off_route_m

    order = jnp.argsort(jnp.where(close & fits, distance, distance + 1e6), stable=True)
    leg, arc, distance, facing, fits, close = (each[order] for each in (leg, arc, distance, facing, fits, close))
    valid = close & fits
    near = distance <= distance[0] + settings.ambiguity_m
    rival = valid & near & _elsewhere(route, settings, leg, arc)
    code = jnp.where(jnp.any(rival), PlanCode.AMBIGUOUS, PlanCode.FOLLOWING)
    code = jnp.where(valid[0], code, jnp.where(jnp.any(close), PlanCode.WRONG_HEADING, PlanCode.OFF_ROUTE))
    finite = jnp.isfinite(x) & jnp.isfinite(y)
    return Starts(
        leg=leg,
        arc_m=arc,
        distance_m=distance,
        travel=facing * gear,
        facing=facing,
        valid=valid & finite,
        pose=pose_route,
        code=jnp.where(finite, code, PlanCode.NON_FINITE).astype(jnp.int32),
    )


def acquire(starts: Starts) -> tuple[PlannerState, Int[Array, ""]]:
    """Begin at the nearest place, if it is the only one. Otherwise the state follows nothing and its code says why.

    Args:
        starts: from ``find_starts``, unbatched.

    Returns:
        The state for ``step_planner``, and its code.
    """
    return _begin(starts, jnp.int32(0), starts.code), starts.code


def choose(starts: Starts, number: int | Int[Array, ""]) -> tuple[PlannerState, Int[Array, ""]]:
    """Begin at the place that the operator chose. An invalid number begins nothing.

    Args:
        starts: from ``find_starts``, unbatched.
        number: of the place, from 0.
    """
    place = jnp.clip(number, 0, CANDIDATES - 1)
    good = starts.valid[place] & (number == place)
    refusal = jnp.where(starts.code == PlanCode.FOLLOWING, PlanCode.LOST, starts.code)
    code = jnp.where(good, PlanCode.FOLLOWING, refusal).astype(jnp.int32)
    return _begin(starts, place, code), code


def _begin(starts: Starts, place: Int[Array, ""], code: Int[Array, ""]) -> PlannerState:
    return PlannerState(
        starts.leg[place],
        starts.arc_m[place],
        starts.travel[place],
        starts.facing[place],
        # A non-finite pose must not become the last good pose.
        VehiclePose(*(jnp.where(jnp.isfinite(each), each, 0.0) for each in starts.pose)),
        code,
    )


def _nearest(
    route: RoutePath, x_m: Float[Array, ""], y_m: Float[Array, ""]
) -> tuple[Int[Array, " candidate"], Float[Array, " candidate"], Bool[Array, " candidate"]]:
    """Leg and arc length of the nearest local minima of distance over all rows, and whether each exists."""
    legs = route.legs
    rows = legs.rows.shape[1]
    number = jnp.arange(rows)[None]
    ends = jnp.round(legs.length_m / legs.spacing_m).astype(jnp.int32)[:, None] + 1
    closed = legs.laps_per_m[:, None] > 0.0
    used = (jnp.arange(legs.rows.shape[0])[:, None] < route.leg_count) & (number >= 1) & (number <= ends)
    square = (legs.rows[..., 0] - x_m) ** 2 + (legs.rows[..., 1] - y_m) ** 2
    square = jnp.where(used & ~(closed & (number == ends)), square, jnp.inf)
    before, after = jnp.roll(square, 1, axis=1), jnp.roll(square, -1, axis=1)
    # Round a closed leg its first and last row are neighbours.
    last = jnp.take_along_axis(square, jnp.maximum(ends - 1, 0), axis=1)
    before = jnp.where(closed & (number == 1), last, before)
    after = jnp.where(closed & (number == ends - 1), square[:, 1:2], after)
    low = jnp.isfinite(square) & (square <= before) & (square < after)
    _, place = lax.top_k(-jnp.where(low, square, jnp.inf).ravel(), CANDIDATES)
    leg, row = (place // rows).astype(jnp.int32), (place % rows).astype(jnp.int32)
    arc = (row - 1).astype(x_m.dtype) * legs.spacing_m[leg]
    return leg, arc, low.ravel()[place]


def _refined(
    route: RoutePath, leg: Int[Array, ""], near_m: Float[Array, ""], x_m: Float[Array, ""], y_m: Float[Array, ""]
) -> tuple[Float[Array, ""], PathPoint]:
    """The foot near a row, and its point: on the leg itself, never on its straight continuation."""
    arc = leg_project(route, leg, leg_project(route, leg, near_m, x_m, y_m).arc_m, x_m, y_m).arc_m
    # A distant foot belongs to a curve around the vehicle: the row itself is near enough.
    spacing = route.legs.spacing_m[leg]
    arc = jnp.where(jnp.abs(arc - near_m) <= 2.0 * spacing, arc, near_m)
    closed = route.legs.laps_per_m[leg] > 0.0
    arc = jnp.where(closed, arc, jnp.clip(arc, 0.0, route.legs.length_m[leg]))
    return arc, leg_point(route, leg, arc)


def _elsewhere(
    route: RoutePath, settings: PlannerSettings, leg: Int[Array, " candidate"], arc_m: Float[Array, " candidate"]
) -> Bool[Array, " candidate"]:
    """Places that are not the first one: on another leg, or clearly farther along."""
    apart = jnp.abs(arc_m - arc_m[0])
    length = route.legs.length_m[leg]
    apart = jnp.where(route.legs.laps_per_m[leg] > 0.0, jnp.minimum(apart, jnp.abs(length - apart)), apart)
    return (leg != leg[0]) | (apart > settings.position_threshold_m)
