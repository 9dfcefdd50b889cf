"""Closed loops with fixes from an error model: thousands of drives at once, compiled whole."""

from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Float, Int, Key, PRNGKeyArray

from lgprjax.navigation import LgprObservation, Reaction, RoutePath
from lgprjax.navigation.route_path import leg_project
from lgprjax.scene import FixErrors, FixErrorState, SensorFaults, during, step_fix_errors
from lgprjax.simulation.loop.closed_loop import Decision, LoopSetup, LoopSpec, LoopState, decide, move

FOOT_M = 0.3048
_FAILED = 0.6  # of the strength where the ground gives no fix
_LEAST_STRENGTH = 0.64  # below it a match is no fix


class LoopSums(NamedTuple):
    """What is kept of a lane while it is engaged; offsets are of the true anchor from the route, by the way driven.

    Attributes:
        way_m: driven.
        square_m3: integral of the offset's square.
        largest_m: offset.
        beyond_foot_m: way with an offset of more than a foot.
        steering_step_rad: largest change of the command within a tick.
        nees_position, nees_yaw: sums over ticks of the filter's normalized squares, two degrees of freedom and one.
        fixes: ticks with one.
        reactions: ticks with each ``Reaction``.
        reasons: bits of all ``Reason`` seen.
        ticks: how many.
    """

    way_m: Float[Array, "..."]
    square_m3: Float[Array, "..."]
    largest_m: Float[Array, "..."]
    beyond_foot_m: Float[Array, "..."]
    steering_step_rad: Float[Array, "..."]
    nees_position: Float[Array, "..."]
    nees_yaw: Float[Array, "..."]
    fixes: Int[Array, "..."]
    reactions: Int[Array, "... 3"]
    reasons: Int[Array, "..."]
    ticks: Int[Array, "..."]


class LoopTick(NamedTuple):
    """What is kept of a tick of a traced drive.

    Attributes:
        x_m, y_m, yaw_rad: true, of the rear axle.
        offset_m: of the true anchor from the route, left of travel positive.
        error_m, error_yaw_rad: of the pose that is driven by, against the truth, along, across and in heading.
        sigma_cross_m: what the filter owns to, of the rear axle.
        nees_position, nees_yaw: normalized squares of the filter's errors, two degrees of freedom and one.
        speed_mps, limit_mps: true, and what the route and the health allow.
        command_rad, front_rad: asked of the front wheels, and reached.
        throttle, brake: commands.
        reaction, reasons: of the health.
        accepted: sources.
        fix: there was one.
        code: of the plan.
        to_go_m: to the route's end.
        engaged: the autopilot drives; stopping: it was told to stop.
        on_lgpr: the threshold switch believes the LGPR.
        switch_cross_m, reckoned_cross_m: cross-track errors of the switch's pose and of GNSS/INS.
    """

    x_m: Float[Array, "..."]
    y_m: Float[Array, "..."]
    yaw_rad: Float[Array, "..."]
    offset_m: Float[Array, "..."]
    error_m: Float[Array, "... 2"]
    error_yaw_rad: Float[Array, "..."]
    sigma_cross_m: Float[Array, "..."]
    nees_position: Float[Array, "..."]
    nees_yaw: Float[Array, "..."]
    speed_mps: Float[Array, "..."]
    limit_mps: Float[Array, "..."]
    command_rad: Float[Array, "..."]
    front_rad: Float[Array, "..."]
    throttle: Float[Array, "..."]
    brake: Float[Array, "..."]
    reaction: Int[Array, "..."]
    reasons: Int[Array, "..."]
    accepted: Array
    fix: Array
    code: Int[Array, "..."]
    to_go_m: Float[Array, "..."]
    engaged: Array
    stopping: Array
    on_lgpr: Array
    switch_cross_m: Float[Array, "..."]
    reckoned_cross_m: Float[Array, "..."]


def blank_sums() -> LoopSums:
    """Before the first tick."""
    zero, none = jnp.float32(0.0), jnp.int32(0)
    return LoopSums(zero, zero, zero, zero, zero, zero, zero, none, jnp.zeros(3, jnp.int32), none, none)


@partial(jax.jit, static_argnums=(0, 8), static_argnames="traced")
def run_lane(
    spec: LoopSpec,
    setup: LoopSetup,
    route: RoutePath,
    errors: FixErrors,
    state: LoopState,
    fix_state: FixErrorState,
    sums: LoopSums,
    key: PRNGKeyArray,
    ticks: int,
    *,
    traced: bool = False,
) -> tuple[LoopState, FixErrorState, LoopSums, LoopTick | None]:
    """So many ticks of one drive."""
    lane = partial(_tick, spec, setup, route, errors, traced=traced)
    numbers = jnp.arange(ticks)
    (state, fix_state, sums), trace = lax.scan(
        lambda carried, number: lane(*carried, jax.random.fold_in(key, number)), (state, fix_state, sums), numbers
    )
    return state, fix_state, sums, trace


@partial(jax.jit, static_argnums=(0, 8))
def run_lanes(
    spec: LoopSpec,
    setup: LoopSetup,
    route: RoutePath,
    errors: FixErrors,
    state: LoopState,
    fix_state: FixErrorState,
    sums: LoopSums,
    keys: Key[Array, " lane"],
    ticks: int,
) -> tuple[LoopState, FixErrorState, LoopSums]:
    """The same for many drives: states, sums and keys have a leading axis, setup, route and errors are theirs all."""

    def step(
        carried: tuple[LoopState, FixErrorState, LoopSums], number: Int[Array, ""]
    ) -> tuple[tuple[LoopState, FixErrorState, LoopSums], None]:
        def one(
            state: LoopState, fix_state: FixErrorState, sums: LoopSums, key: PRNGKeyArray
        ) -> tuple[LoopState, FixErrorState, LoopSums]:
            return _tick(spec, setup, route, errors, state, fix_state, sums, jax.random.fold_in(key, number))[0]

        return jax.vmap(one)(*carried, keys), None

    (state, fix_state, sums), _ = lax.scan(step, (state, fix_state, sums), jnp.arange(ticks))
    return state, fix_state, sums


def _tick(
    spec: LoopSpec,
    setup: LoopSetup,
    route: RoutePath,
    errors: FixErrors,
    state: LoopState,
    fix_state: FixErrorState,
    sums: LoopSums,
    key: PRNGKeyArray,
    *,
    traced: bool = False,
) -> tuple[tuple[LoopState, FixErrorState, LoopSums], LoopTick | None]:
    sensor_key, fix_key = jax.random.split(key)
    before = state
    state, readings = move(spec, setup, state, sensor_key)
    way_m = state.plant.travel_m - before.plant.travel_m
    fix_state, error = step_fix_errors(errors, fix_state, fix_key, way_m)
    time_s = state.tick.astype(jnp.float32) * spec.tick_s
    lgpr, strength = draw_fix(setup, errors, fix_state, error, state, time_s)
    state, decision = decide(spec, setup, route, state, readings, lgpr, strength)
    tick = told_tick(setup, route, state, decision, lgpr)
    sums = add_tick(sums, tick, state, before, way_m)
    return (state, fix_state, sums), (tick if traced else None)


def draw_fix(
    setup: LoopSetup,
    errors: FixErrors,
    fix_state: FixErrorState,
    error: Float[Array, "3"],
    state: LoopState,
    time_s: Float[Array, ""],
) -> tuple[LgprObservation, Float[Array, ""]]:
    """A fix of this tick with its error, faults included, and the strength of its match."""
    pose, faults = state.plant.pose, setup.faults
    cos, sin = jnp.cos(pose.yaw_rad), jnp.sin(pose.yaw_rad)
    wrong = _wrong_place(faults, time_s)
    x = pose.x_m + cos * (setup.model.array_x_m + error[0]) - sin * error[1] + wrong[0]
    y = pose.y_m + sin * (setup.model.array_x_m + error[0]) + cos * error[1] + wrong[1]
    along, cross, yaw = (sigma * sigma for sigma in errors.reported_sigma)
    covariance = jnp.stack(
        [
            jnp.stack([cos * cos * along + sin * sin * cross, cos * sin * (along - cross), jnp.zeros_like(yaw)]),
            jnp.stack([cos * sin * (along - cross), sin * sin * along + cos * cos * cross, jnp.zeros_like(yaw)]),
            jnp.stack([jnp.zeros_like(yaw), jnp.zeros_like(yaw), yaw]),
        ]
    )
    lost = during(faults.lgpr_lost_s, time_s)
    fade = jnp.where(during(faults.lgpr_faded_s, time_s), faults.lgpr_faded, 1.0)
    strength = errors.strength * jnp.where(fix_state.found, 1.0, _FAILED) * fade
    valid = fix_state.found & ~lost & (strength >= _LEAST_STRENGTH)
    zero = jnp.float32(0.0)
    return LgprObservation(x, y, pose.yaw_rad + error[2], covariance, zero, valid), jnp.where(lost, jnp.nan, strength)


def told_tick(
    setup: LoopSetup,
    route: RoutePath,
    state: LoopState,
    decision: Decision,
    lgpr: LgprObservation,
) -> LoopTick:
    """What a tick is kept as."""
    pose, anchor = state.plant.pose, setup.plant.chassis.anchor_m
    planner = state.autopilot.planner
    anchor_x, anchor_y = pose.x_m + anchor * jnp.cos(pose.yaw_rad), pose.y_m + anchor * jnp.sin(pose.yaw_rad)
    foot = leg_project(route, planner.leg, planner.arc_m, anchor_x, anchor_y)
    foot = leg_project(route, planner.leg, foot.arc_m, anchor_x, anchor_y)
    driven = decision.pose_route
    turn = driven.yaw_rad - pose.yaw_rad
    plan = decision.autopilot.plan
    return LoopTick(
        pose.x_m,
        pose.y_m,
        pose.yaw_rad,
        planner.travel * foot.offset_m,
        jnp.stack(_along_cross(driven.x_m - pose.x_m, driven.y_m - pose.y_m, pose.yaw_rad)),
        turn - 2.0 * jnp.pi * jnp.round(turn / (2.0 * jnp.pi)),
        _cross_sigma(state),
        *_nees(state),
        state.plant.speed_mps,
        decision.autopilot.wanted_mps,
        state.command.front_rad,
        state.plant.servo.wheel_rad,
        state.command.throttle,
        state.command.brake,
        decision.health.reaction,
        decision.health.reasons,
        decision.info.accepted,
        lgpr.valid,
        plan.code,
        plan.to_go_m,
        state.engaged,
        state.stopping,
        state.switch.on_lgpr,
        _along_cross(state.switch.pose.x_m - pose.x_m, state.switch.pose.y_m - pose.y_m, pose.yaw_rad)[1],
        _along_cross(
            state.reckoned.estimate.mean[0] - pose.x_m, state.reckoned.estimate.mean[1] - pose.y_m, pose.yaw_rad
        )[1],
    )


def add_tick(sums: LoopSums, tick: LoopTick, state: LoopState, before: LoopState, way_m: Float[Array, ""]) -> LoopSums:
    """Sums with one more tick."""
    way_m = jnp.abs(way_m)
    offset = jnp.abs(tick.offset_m)
    grown = LoopSums(
        sums.way_m + way_m,
        sums.square_m3 + offset * offset * way_m,
        jnp.maximum(sums.largest_m, jnp.where(jnp.isfinite(offset), offset, jnp.inf)),
        sums.beyond_foot_m + jnp.where(offset > FOOT_M, way_m, 0.0),
        jnp.maximum(sums.steering_step_rad, jnp.abs(state.command.front_rad - before.command.front_rad)),
        sums.nees_position + tick.nees_position,
        sums.nees_yaw + tick.nees_yaw,
        sums.fixes + tick.fix.astype(jnp.int32),
        sums.reactions + (jnp.arange(len(Reaction)) == tick.reaction).astype(jnp.int32),
        sums.reasons | tick.reasons,
        sums.ticks + 1,
    )
    # What the driver does before is not the loop's; nor is the very first step after him.
    return LoopSums(*(jnp.where(before.engaged, new, old) for new, old in zip(grown, sums, strict=True)))


def _wrong_place(faults: SensorFaults, time_s: Float[Array, ""]) -> Float[Array, "2"]:
    return jnp.where(during(faults.lgpr_wrong_s, time_s), faults.lgpr_wrong_m, 0.0)


def _along_cross(
    east_m: Float[Array, ""], north_m: Float[Array, ""], yaw_rad: Float[Array, ""]
) -> tuple[Float[Array, ""], Float[Array, ""]]:
    cos, sin = jnp.cos(yaw_rad), jnp.sin(yaw_rad)
    return cos * east_m + sin * north_m, cos * north_m - sin * east_m


def _cross_sigma(state: LoopState) -> Float[Array, ""]:
    covariance, yaw = state.fused.estimate.covariance, state.fused.estimate.mean[2]
    cos, sin = jnp.cos(yaw), jnp.sin(yaw)
    square = sin * sin * covariance[0, 0] - 2.0 * cos * sin * covariance[0, 1] + cos * cos * covariance[1, 1]
    return jnp.sqrt(jnp.maximum(square, 0.0))


def _nees(state: LoopState) -> tuple[Float[Array, ""], Float[Array, ""]]:
    """Normalized squares of the filter's position, two degrees of freedom, and of its heading."""
    mean, covariance, pose = state.fused.estimate.mean, state.fused.estimate.covariance, state.plant.pose
    east, north, turn = mean[0] - pose.x_m, mean[1] - pose.y_m, mean[2] - pose.yaw_rad
    turn = turn - 2.0 * jnp.pi * jnp.round(turn / (2.0 * jnp.pi))
    xx, xy, yy = covariance[0, 0], covariance[0, 1], covariance[1, 1]
    position = (yy * east * east - 2.0 * xy * east * north + xx * north * north) / (xx * yy - xy * xy)
    return position, turn * turn / covariance[2, 2]
