"""Vehicles that follow a route by the planner and the exact law, with noise in what the planner is told."""

from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Float

from lgprjax.navigation import (
    Plan,
    PlannerSettings,
    PlannerState,
    RoutePath,
    RouteSpeeds,
    leg_point,
    make_route_path,
    step_planner,
)
from lgprjax.vehicle import Chassis, VehiclePose, body_point, drive_arc, path_from_curvature, steer_exact, turn_of
from rollout_lanes import ANCHOR_M, RATIO, WHEELBASE_M, chassis

STEP_S = 0.1
POSITION_M, YAW_RAD = 0.05, float(np.radians(0.3))
CHASSIS = chassis()
LEAD_M = ANCHOR_M - WHEELBASE_M * RATIO / (1.0 + RATIO)


class Driven(NamedTuple):
    """What every step of a drive left behind, [step, lane].

    Attributes:
        state, plan: of the planner.
        pose: true, of the rear axle, after the step.
        speed_mps: true, signed, after it.
        way_m: of the true anchor since the start.
    """

    state: PlannerState
    plan: Plan
    pose: VehiclePose
    speed_mps: Float[Array, "step lane"]
    way_m: Float[Array, "step lane"]


@partial(jax.jit, static_argnums=0)
def drive(
    steps: int,
    route: RoutePath,
    settings: PlannerSettings,
    chassis: Chassis,
    start: PlannerState,
    pose: VehiclePose,
    cruise_mps: Float[Array, " lane"],
    noise: Float[Array, ""],
    key: Array,
) -> Driven:
    """Drive lanes at the planner's limit, none faster than its cruise speed; the speed follows at 2 m/s²."""
    plans = jax.vmap(step_planner, in_axes=(None, None, None, 0, 0, 0))

    def step(carried: tuple[Driven, Array], _: None) -> tuple[tuple[Driven, Array], Driven]:
        before, key = carried
        key, draw = jax.random.split(key)
        error = noise * jax.random.normal(draw, (3, *before.speed_mps.shape))
        told = VehiclePose(
            before.pose.x_m + POSITION_M * error[0],
            before.pose.y_m + POSITION_M * error[1],
            before.pose.yaw_rad + YAW_RAD * error[2],
        )
        state, plan = plans(route, settings, chassis, before.state, told, before.speed_mps)
        wanted = jnp.minimum(plan.speed_limit_mps, cruise_mps) * plan.gear
        speed = before.speed_mps + jnp.clip(wanted - before.speed_mps, -2.0 * STEP_S, 2.0 * STEP_S)
        front = steer_exact(chassis, plan.ahead_m, plan.left_m, jnp.ones_like(speed)).front_rad
        after = drive_arc(before.pose, speed * STEP_S, turn_of(chassis, front))
        was, now = body_point(before.pose, chassis.anchor_m), body_point(after, chassis.anchor_m)
        driven = Driven(state, plan, after, speed, before.way_m + jnp.hypot(now[0] - was[0], now[1] - was[1]))
        return (driven, key), driven

    zero = jnp.zeros_like(cruise_mps)
    plan = Plan(zero, zero, zero, zero, zero, zero, zero, zero, start.code)
    _, driven = lax.scan(step, (Driven(start, plan, pose, zero, zero), key), None, length=steps)
    return driven


def beside(
    route: RoutePath, leg: int, arc_m: np.ndarray, facing: np.ndarray, offset_m: np.ndarray, error_rad: np.ndarray
) -> VehiclePose:
    """Rear axles of vehicles whose anchors stand beside a leg, pointing along it (facing 1) or against it (-1)."""
    at = jax.vmap(lambda arc: leg_point(route, jnp.int32(leg), arc))(jnp.asarray(arc_m, jnp.float32))
    cos, sin, bend = (np.asarray(each, np.float64) for each in (at.cos, at.sin, at.curvature_radpm))
    yaw = np.arctan2(facing * sin, facing * cos) - np.arcsin(facing * LEAD_M * bend) + error_rad
    x = np.asarray(at.x_m) - sin * offset_m - ANCHOR_M * np.cos(yaw)
    y = np.asarray(at.y_m) + cos * offset_m - ANCHOR_M * np.sin(yaw)
    return VehiclePose(*(jnp.asarray(each, jnp.float32) for each in (x, y, yaw)))


def twice_round() -> RoutePath:
    """A straight, a circle of 14 m gone round twice over the same ground, and on: 30 + 2 × 88 + 30 m."""
    bend = np.concatenate([np.zeros(120), np.full(704, 4.0 * np.pi / 176.0), np.zeros(120)])
    return make_route_path([path_from_curvature(bend)], [1], CHASSIS, RouteSpeeds(cruise_mps=5.0))
