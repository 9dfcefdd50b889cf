"""What is kept of a closed loop: figures of a tick, and sums over the ticks of a lane."""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from lgprjax.navigation import LgprObservation, Reaction, RoutePath, pose_of, position_sigma_m
from lgprjax.navigation.arc_reach import wrap_yaw
from lgprjax.navigation.filter_model import YAW, X, Y
from lgprjax.navigation.route_path import leg_project
from lgprjax.simulation.loop.loop_state import Decision, LoopSetup, LoopState
from lgprjax.simulation.loop.tracking_error import FOOT_M


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
    plan = decision.autopilot.plan
    switch, gnss_ins = state.navigator.switch, pose_of(state.navigator.reckoned.estimate)
    return LoopTick(
        pose.x_m,
        pose.y_m,
        pose.yaw_rad,
        planner.travel * foot.offset_m,
        jnp.stack(_along_cross(driven.x_m - pose.x_m, driven.y_m - pose.y_m, pose.yaw_rad)),
        wrap_yaw(driven.yaw_rad - pose.yaw_rad),
        position_sigma_m(state.navigator.fused.estimate)[1],
        *_nees(state),
        state.plant.speed_mps,
        decision.autopilot.wanted_mps,
        state.command.front_rad,
        state.plant.servo.wheel_rad,
        state.command.throttle,
        state.command.brake,
        decision.navigated.health.reaction,
        decision.navigated.health.reasons,
        decision.navigated.info.accepted,
        lgpr.valid,
        plan.code,
        plan.to_go_m,
        state.engaged,
        state.stopping,
        switch.on_lgpr,
        _along_cross(switch.pose.x_m - pose.x_m, switch.pose.y_m - pose.y_m, pose.yaw_rad)[1],
        _along_cross(gnss_ins.x_m - pose.x_m, gnss_ins.y_m - pose.y_m, pose.yaw_rad)[1],
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


def _along_cross(
    east_m: Float[Array, ""], north_m: Float[Array, ""], yaw_rad: Float[Array, ""]
) -> tuple[Float[Array, ""], Float[Array, ""]]:
    cos, sin = jnp.cos(yaw_rad), jnp.sin(yaw_rad)
    return cos * east_m + sin * north_m, cos * north_m - sin * east_m


def _nees(state: LoopState) -> tuple[Float[Array, ""], Float[Array, ""]]:
    """Normalized squares of the filter's position, two degrees of freedom, and of its heading."""
    (mean, covariance), pose = state.navigator.fused.estimate, state.plant.pose
    east, north, turn = mean[X] - pose.x_m, mean[Y] - pose.y_m, wrap_yaw(mean[YAW] - pose.yaw_rad)
    xx, xy, yy = covariance[0, 0], covariance[0, 1], covariance[1, 1]
    position = (yy * east * east - 2.0 * xy * east * north + xx * north * north) / (xx * yy - xy * xy)
    return position, turn * turn / covariance[YAW, YAW]
