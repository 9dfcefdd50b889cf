"""Vehicles driven along a path in closed loop: foot, goal, law, servo, arc; so many steps, one lane or a million.

All functions work on lanes of any shape, so a batch is a leading axis of every field and ``vmap`` gives the same.
"""

from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Bool, Float

from lgprjax.vehicle.chassis import Chassis, rear_angle, yaw_gain
from lgprjax.vehicle.lane_law import LaneLaw, prepare_law, steer_lane
from lgprjax.vehicle.lanes import RolloutLane, RolloutSpec, RolloutState, RolloutTrace
from lgprjax.vehicle.look_ahead import look_ahead_m
from lgprjax.vehicle.metrics import MetricSums, RolloutMetrics, finish_metrics, init_metrics, step_metrics
from lgprjax.vehicle.path import Path, Projection, path_point, project
from lgprjax.vehicle.pursuit import Steering, steer_closed
from lgprjax.vehicle.servo import ServoPace, servo_pace, torque_share, turn_servo
from lgprjax.vehicle.stanley import steer_stanley
from lgprjax.vehicle.tangent import tangent


class _Prepared(NamedTuple):
    """What of a lane does not change from step to step."""

    law: LaneLaw
    ahead_m: Float[Array, "..."]
    way_m: Float[Array, "..."]
    gain: Float[Array, "..."]
    believed_gain: Float[Array, "..."]
    pace: ServoPace


@partial(jax.jit, static_argnums=0)
def roll_out(
    spec: RolloutSpec, path: Path, lane: RolloutLane, start: RolloutState
) -> tuple[RolloutState, RolloutMetrics]:
    """Drive, and say how well.

    Gradients are taken through all steps, each recomputed on the way back so that only states are kept.

    Args:
        spec: the same for all lanes; a new one compiles anew.
        path: for all lanes.
        lane: one, or many along a leading axis.
        start: from ``start_rollout``, with the shape of the lanes.

    Returns:
        State after the last step, and metrics over all steps.
    """
    (final, sums), _ = _run(spec, path, lane, start, traced=False)
    travel_m = jnp.abs(lane.speed_mps) * (spec.step_s * spec.steps) + jnp.zeros_like(start.x_m)
    return final, finish_metrics(sums, spec.steps, travel_m)


@partial(jax.jit, static_argnums=0)
def roll_out_traced(
    spec: RolloutSpec, path: Path, lane: RolloutLane, start: RolloutState
) -> tuple[RolloutState, RolloutMetrics, RolloutTrace]:
    """The same with every step kept: for a few lanes."""
    (final, sums), trace = _run(spec, path, lane, start, traced=True)
    assert trace is not None
    travel_m = jnp.abs(lane.speed_mps) * (spec.step_s * spec.steps) + jnp.zeros_like(start.x_m)
    return final, finish_metrics(sums, spec.steps, travel_m), trace


def _run(
    spec: RolloutSpec, path: Path, lane: RolloutLane, start: RolloutState, *, traced: bool
) -> tuple[tuple[RolloutState, MetricSums], RolloutTrace | None]:
    fixed = _prepare(spec, lane)

    def step(
        carried: tuple[RolloutState, MetricSums], number: Float[Array, ""]
    ) -> tuple[tuple[RolloutState, MetricSums], RolloutTrace | None]:
        state, sums = carried
        after, seen = _step(spec, path, lane, fixed, state)
        # Metres still to go decide what is late: the last step always is.
        late = (spec.steps - number) * jnp.abs(fixed.way_m) < spec.tail_m
        travelled_m = number * jnp.abs(fixed.way_m)
        moved = jnp.abs(after.servo.wheel_rad - state.servo.wheel_rad)
        sums = step_metrics(sums, seen.offset_m, travelled_m, late, moved, seen.reachable, tolerance_m=spec.tolerance_m)
        return (after, sums), _trace(state, after, seen) if traced else None

    numbers = jnp.arange(1, spec.steps + 1, dtype=start.x_m.dtype)
    return lax.scan(jax.checkpoint(step, prevent_cse=False), (start, init_metrics(start.x_m)), numbers)


class _Seen(NamedTuple):
    """What a step found out on its way."""

    offset_m: Float[Array, "..."]
    command_rad: Float[Array, "..."]
    reachable: Bool[Array, "..."]


def _prepare(spec: RolloutSpec, lane: RolloutLane) -> _Prepared:
    believed_gain = yaw_gain(lane.believed.characteristic_speed_mps, lane.speed_mps)
    # Reversing, the goal lies behind along the path.
    ahead = jnp.where(lane.speed_mps < 0.0, -1.0, 1.0) * look_ahead_m(lane.look_ahead, lane.speed_mps)
    return _Prepared(
        prepare_law(lane.believed, believed_gain),
        ahead,
        lane.speed_mps * spec.step_s,
        yaw_gain(lane.chassis.characteristic_speed_mps, lane.speed_mps),
        believed_gain,
        servo_pace(lane.servo, torque_share(lane.servo, lane.supply_v), spec.step_s),
    )


def _step(
    spec: RolloutSpec, path: Path, lane: RolloutLane, fixed: _Prepared, state: RolloutState
) -> tuple[RolloutState, _Seen]:
    lead = lane.chassis.anchor_m
    anchor_x, anchor_y = state.x_m + lead * state.cos_yaw, state.y_m + lead * state.sin_yaw
    foot = project(path, state.arc_m + state.advance_m, anchor_x, anchor_y)
    if spec.law == "stanley":
        steering = _steer_stanley(spec, path, lane, state, foot)
    else:
        goal = path_point(path, foot.arc_m + fixed.ahead_m)
        east, north = goal.x_m - anchor_x, goal.y_m - anchor_y
        # Quotients, for the same reason as in ``project``.
        base = lane.believed.wheelbase_m
        ahead = (east * state.cos_yaw + north * state.sin_yaw) / base
        left = (north * state.cos_yaw - east * state.sin_yaw) / base
        steering = _steer(spec, lane, fixed, ahead, left)
    servo = turn_servo(state.servo, fixed.pace, steering.front_rad)
    x, y, cos, sin = _drive(lane.chassis, state, servo.wheel_rad, fixed.way_m, fixed.gain)
    after = RolloutState(x, y, cos, sin, foot.arc_m, foot.arc_m - state.arc_m, servo)
    return after, _Seen(foot.offset_m, steering.front_rad, steering.reachable)


def _steer(
    spec: RolloutSpec, lane: RolloutLane, fixed: _Prepared, ahead: Float[Array, "..."], left: Float[Array, "..."]
) -> Steering:
    if spec.law == "exact":
        return steer_lane(fixed.law, ahead, left)
    base = lane.believed.wheelbase_m
    front = steer_closed(lane.believed, ahead * base, left * base, fixed.believed_gain)
    return Steering(front, jnp.abs(front) < lane.believed.largest_angle_rad)


def _steer_stanley(spec: RolloutSpec, path: Path, lane: RolloutLane, state: RolloutState, foot: Projection) -> Steering:
    at = path_point(path, foot.arc_m)
    error = jnp.arctan2(
        at.sin * state.cos_yaw - at.cos * state.sin_yaw, at.cos * state.cos_yaw + at.sin * state.sin_yaw
    )
    front = steer_stanley(lane.believed, error, -foot.offset_m, lane.speed_mps, spec.stanley_gain_ps)
    return Steering(front, jnp.abs(front) < lane.believed.largest_angle_rad)


def _drive(
    chassis: Chassis,
    state: RolloutState,
    wheel_rad: Float[Array, "..."],
    way_m: Float[Array, "..."],
    gain: Float[Array, "..."],
) -> tuple[Float[Array, "..."], Float[Array, "..."], Float[Array, "..."], Float[Array, "..."]]:
    """``drive_arc`` with the heading as cosine and sine: position and heading after an arc of up to half a radian."""
    rear_tangent = tangent(rear_angle(chassis.rear, wheel_rad)[0])
    change = gain * (tangent(wheel_rad) + rear_tangent) / chassis.wheelbase_m * way_m
    square = change * change
    along = 1.0 - square / 6.0 * (1.0 - square / 20.0 * (1.0 - square / 42.0))
    aside = 0.5 * change * (1.0 - square / 12.0 * (1.0 - square / 30.0))
    drift = -gain * way_m * rear_tangent
    forward, left = along * way_m - aside * drift, aside * way_m + along * drift
    cos, sin = state.cos_yaw, state.sin_yaw
    turned_cos, turned_sin = 1.0 - aside * change, along * change
    new_cos, new_sin = cos * turned_cos - sin * turned_sin, sin * turned_cos + cos * turned_sin
    # One Newton step of 1/√: rounding would change the length of the heading over thousands of steps.
    unit = 1.5 - 0.5 * (new_cos * new_cos + new_sin * new_sin)
    return (
        state.x_m + cos * forward - sin * left,
        state.y_m + sin * forward + cos * left,
        new_cos * unit,
        new_sin * unit,
    )


def _trace(state: RolloutState, after: RolloutState, seen: _Seen) -> RolloutTrace:
    return RolloutTrace(
        state.x_m,
        state.y_m,
        jnp.arctan2(state.sin_yaw, state.cos_yaw),
        after.arc_m,
        seen.offset_m,
        seen.command_rad,
        after.servo.wheel_rad,
        seen.reachable,
    )
