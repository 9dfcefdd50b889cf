"""What the planner is told, remembers and says: settings, state, plan and its code."""

from enum import IntEnum
from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from lgprjax.vehicle import VehiclePose


class PlanCode(IntEnum):
    """Where a plan stands. ``OFF_ROUTE`` to ``LOST`` stay until a start is found again, ``DONE`` as well."""

    FOLLOWING = 0
    OFF_ROUTE = 1
    AMBIGUOUS = 2
    WRONG_HEADING = 3
    LOST = 4
    AT_CUSP = 5
    DONE = 6
    NON_FINITE = 7


class PlannerSettings(NamedTuple):
    """Float32 scalars, or one value a lane.

    Attributes:
        look_ahead_m: along the route, of the commanded speed: the caller sets it from its schedule each step.
        search_m: the closest point is looked for so far to either side of the expected one.
        position_threshold_m: a closest point that moved otherwise than the vehicle by more than this is not taken;
            starts that differ by more along the route are two.
        ambiguity_m: a second start no farther than this beyond the nearest makes the choice the operator's.
        heading_gate_rad: largest error of heading at a start.
        off_route_m: beyond this from the route nothing is followed, and no start found.
        arrive_m: nearer than this to the end of a leg the vehicle is to stand.
        standing_mps: below it the vehicle stands, and the gear may change.
        stop_mps2: deceleration towards a leg's end; the way that takes depends on no look-ahead.
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
    """What the planner remembers.

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
    """What one step asks for; signs are those of the direction of travel.

    Attributes:
        ahead_m, left_m: goal from the anchor in the body frame, behind when reversing.
        offset_m: of the anchor from the route, positive to the left of travel.
        heading_error_rad: of the body from where it points when the anchor drives the route here without slip,
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
    """A planner that knows no place yet."""
    zero = jnp.float32(0.0)
    one = jnp.float32(1.0)
    return PlannerState(jnp.int32(0), zero, one, one, VehiclePose(zero, zero, zero), jnp.int32(PlanCode.LOST))
