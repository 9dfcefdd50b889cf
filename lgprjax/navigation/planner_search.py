"""Where on a route a drive begins: asked for explicitly, over the whole route, and never guessed.

Only here is the whole route searched. Two places that lie equally near are the operator's to choose from.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Bool, Float, Int

from lgprjax.navigation.arc_reach import wrap_yaw
from lgprjax.navigation.plan import PlanCode, PlannerSettings, PlannerState
from lgprjax.navigation.planner import body_yaw
from lgprjax.navigation.route_path import RoutePath, leg_point, leg_project
from lgprjax.vehicle import Chassis, PathPoint, VehiclePose, body_point

CANDIDATES = 8


class Starts(NamedTuple):
    """Places where a vehicle could begin, nearest first.

    Attributes:
        leg, arc_m: of the place.
        distance_m: of the anchor from it.
        travel: 1 along the route as recorded, -1 against it.
        facing: 1 where the body points as it did when recorded, -1 turned round.
        valid: the place is near enough, and the heading fits.
        pose: of the rear axle, as the search was told.
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
    """Nearest places of every stretch of the route, each with the direction of travel that the vehicle's heading says.

    One lane of scalars. Facing as recorded the vehicle travels along the route, turned round against it; with gear -1
    the other way, every leg backwards.

    Args:
        route: searched on all its legs.
        settings: thresholds.
        chassis: scalars; its anchor is to be on the route.
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
        leg,
        arc,
        distance,
        facing * gear,
        facing,
        valid & finite,
        pose_route,
        jnp.where(finite, code, PlanCode.NON_FINITE).astype(jnp.int32),
    )


def acquire(starts: Starts) -> tuple[PlannerState, Int[Array, ""]]:
    """Begin at the nearest place, where it is the only one. Otherwise the state follows nothing and its code says why.

    Args:
        starts: from ``find_starts``, one lane.

    Returns:
        The state for ``step_planner``, and its code.
    """
    return _begin(starts, jnp.int32(0), starts.code), starts.code


def choose(starts: Starts, number: int | Int[Array, ""]) -> tuple[PlannerState, Int[Array, ""]]:
    """Begin at the place that the operator chose. A number that is none of a valid place begins nothing.

    Args:
        starts: from ``find_starts``, one lane.
        number: of the place, from 0.
    """
    place = jnp.clip(number, 0, CANDIDATES - 1)
    good = starts.valid[place] & (number == place)
    refusal = jnp.where(starts.code == PlanCode.FOLLOWING, PlanCode.LOST, starts.code)
    code = jnp.where(good, PlanCode.FOLLOWING, refusal).astype(jnp.int32)
    return _begin(starts, place, code), code


def replace_route(
    old: RoutePath, new: RoutePath, settings: PlannerSettings, chassis: Chassis, state: PlannerState
) -> tuple[PlannerState, Int[Array, ""]]:
    """Go on with another route where it holds the place and the heading that the old one had.

    Args:
        old, new: routes in one frame.
        settings: a place within the position threshold is the same.
        chassis: scalars.
        state: on the old route.

    Returns:
        The state on the new route and its code: as it was; ``LOST`` where the new route does not lead by here;
        ``AMBIGUOUS`` where it does so more than once and nowhere at the arc length that the old one had.
    """
    here = leg_point(old, state.leg, state.arc_m)
    faces = state.facing * old.gear[state.leg]
    yaw = body_yaw(chassis, here, faces)
    lead = chassis.anchor_m
    on_route = VehiclePose(here.x_m - lead * jnp.cos(yaw), here.y_m - lead * jnp.sin(yaw), yaw)
    starts = find_starts(new, settings, chassis, on_route)
    holds = starts.valid & (starts.distance_m <= settings.position_threshold_m)
    same = holds & (starts.leg == state.leg) & (jnp.abs(starts.arc_m - state.arc_m) <= settings.position_threshold_m)
    place = jnp.where(jnp.any(same), jnp.argmax(same), jnp.argmax(holds))
    others = jnp.any(holds & _elsewhere(new, settings, starts.leg, starts.arc_m))
    code = jnp.where(jnp.any(same) | ~others, state.code, PlanCode.AMBIGUOUS)
    code = jnp.where(jnp.any(holds), code, PlanCode.LOST)
    lost = (state.code >= PlanCode.OFF_ROUTE) & (state.code <= PlanCode.LOST)
    code = jnp.where(lost, state.code, code).astype(jnp.int32)
    begun = _begin(starts, place, code)
    # The way on stays what it was on the ground, however the new route was recorded.
    travel = state.travel * faces * begun.facing * new.gear[begun.leg]
    return begun._replace(travel=travel, pose=state.pose), code


def _begin(starts: Starts, place: Int[Array, ""], code: Int[Array, ""]) -> PlannerState:
    return PlannerState(
        starts.leg[place],
        starts.arc_m[place],
        starts.travel[place],
        starts.facing[place],
        # What is no number must not be carried on as the last good pose.
        VehiclePose(*(jnp.where(jnp.isfinite(each), each, 0.0) for each in starts.pose)),
        code,
    )


def _nearest(
    route: RoutePath, x_m: Float[Array, ""], y_m: Float[Array, ""]
) -> tuple[Int[Array, " candidate"], Float[Array, " candidate"], Bool[Array, " candidate"]]:
    """Leg and arc length of the nearest local minima of distance over all rows, and whether there are so many."""
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
    # A foot that ran away belongs to a curve about the vehicle: the row itself is near enough.
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
