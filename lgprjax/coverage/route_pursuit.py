"""The pursuit law on a coverage route: one arc that leads the reference point through the carrot."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from lgprjax.coverage.carrot import CarrotPlan, CarrotSettings, CarrotState, lead, plan_of
from lgprjax.coverage.cover_route import CoverRoute
from lgprjax.vehicle.arc import VehiclePose


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
    state, goal = lead(settings, route, state, pose, speed_mps, step_s)
    way_x, way_y = goal.way_m
    aside = jnp.cos(pose.yaw_rad) * way_y - jnp.sin(pose.yaw_rad) * way_x
    curvature = 2.0 * aside / jnp.maximum(way_x * way_x + way_y * way_y, 0.01)
    return state, plan_of(settings, route, state, goal.foot, curvature, speed_mps)
