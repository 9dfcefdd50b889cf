"""The planner: where the vehicle stands on its route, and the goal that the pursuit law is to reach.

The closest point is looked for in a window about where the vehicle's own way has taken it, never on the whole route: at
a crossing it stays on its branch. Where nothing is known it does not guess; ``find_starts`` begins, explicitly.
"""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from lgprjax.navigation.arc_reach import wrap_yaw
from lgprjax.navigation.plan import Plan, PlanCode, PlannerSettings, PlannerState
from lgprjax.navigation.route_path import RoutePath, leg_point, leg_project, leg_row
from lgprjax.vehicle import Chassis, PathPoint, VehiclePose, anchor_lead_m, body_point, reverse_look_ahead_m

ENDLESS_M = 1e6
"""What is left to go on a closed leg."""
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
    """One step: the closest point moves on, and the goal is laid off from it in the direction of travel.

    One lane of scalars; ``vmap`` for many, the route for all of them or one each.

    Args:
        route: to be followed.
        settings: thresholds and the look-ahead of the commanded speed. Reversing, it is at least 1.2 times
            2 |l − x_c|.
        chassis: scalars; its anchor follows the route.
        state: of the last step, or from ``acquire``.
        pose_route: rear axle in the route's frame. What is no number leaves the state as it is.
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
    # Beyond the leg's end the goal stands on its straight continuation: never on the other side of a cusp.
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
    # An error of heading is told, but is no place lost: the next step may be right again.
    kept = jnp.where(finite & (code != PlanCode.WRONG_HEADING), code, state.code)
    return PlannerState(leg, arc, state.travel, state.facing, pose, kept), plan


def body_yaw(chassis: Chassis, here: PathPoint, facing: Float[Array, ""]) -> Float[Array, ""]:
    """Yaw of the body when its anchor drives along a path without slip: the path's heading less asin((l − x_c) κ).

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
    """The leg beyond a cusp and the arc length there of a vehicle that stands short of the cusp, or beyond it."""
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
    # Of a path that comes back on itself within the window, the part that leads elsewhere is left out.
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
    """The code of a step from that of the step before: the worse comes later and wins."""
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
