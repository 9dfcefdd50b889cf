"""Closed loop, tick by tick: vehicle, sensors, fusion, health, planner, law and limiter.

A tick has two halves: ``move`` (the world: the last command drives the vehicle, the sensors measure it) and ``decide``
(the onboard step ``step_onboard``, as on the vehicle). Between them is the radar: registration of rendered scans, or
fixes drawn from an error model. Both halves are one batch element, more by ``vmap``; the controller never sees the true
pose; only the driver does, who brings the vehicle to where the autopilot may be engaged.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int, PRNGKeyArray

from lgprjax.autopilot import (
    AutopilotInfo,
    AutopilotInputs,
    AutopilotState,
    Command,
    OnboardSetup,
    Orders,
    step_autopilot,
    step_onboard,
)
from lgprjax.navigation import (
    GnssObservation,
    HeadingObservation,
    LgprObservation,
    MotionInput,
    Observations,
    OdometerObservation,
    Reaction,
    RoutePath,
    pose_of,
    position_sigma_m,
)
from lgprjax.navigation.counter_steer_model import YAW, X, Y
from lgprjax.navigation.kalman import wrap_yaw
from lgprjax.navigation.route import leg_project
from lgprjax.scene import Readings, read_live_sensors, step_plant
from lgprjax.simulation.handover import step_handover
from lgprjax.simulation.loop.loop_setup import FOOT_M, Decision, LoopSetup, LoopSpec, LoopState


def move(spec: LoopSpec, setup: LoopSetup, state: LoopState, key: PRNGKeyArray) -> tuple[LoopState, Readings]:
    """The world's half of a tick."""
    plant = step_plant(
        setup.plant,
        setup.terrain,
        state.plant,
        state.command.front_rad,
        state.command.throttle,
        state.command.brake,
        state.gear,
        spec.tick_s,
    )
    tick = state.tick + 1
    sensors, readings = read_live_sensors(
        setup.sensors,
        setup.faults,
        state.sensors,
        key,
        plant.pose,
        plant.speed_mps,
        plant.yaw_rate_radps,
        tick,
        spec.tick_s,
    )
    return state._replace(plant=plant, sensors=sensors, tick=tick), readings


def decide(
    spec: LoopSpec,
    setup: LoopSetup,
    route: RoutePath,
    state: LoopState,
    readings: Readings,
    lgpr: LgprObservation,
    p_false: Float[Array, ""],
) -> tuple[LoopState, Decision]:
    """The onboard half of a tick.

    Args:
        spec, setup, route: settings, setup and route of the drive.
        state: state after ``move``.
        readings: sensor readings of this tick.
        lgpr: this tick's fix, if there is one.
        p_false: probability that its match is false, see ``step_health``; NaN without a match.
    """
    step_s = jnp.float32(spec.tick_s)
    engaged, stopping = state.handover
    # Measured by the potentiometer, whose errors are small compared with the servo's play.
    front_rad = state.plant.servo.wheel_rad
    orders = Orders(
        steering_engaged=engaged,
        speed_engaged=engaged,
        stop=stopping,
        speed_cap_mps=jnp.float32(jnp.inf),
        set_speed_mps=setup.set_speed_mps,
        front_rad=front_rad,
        age_s=jnp.float32(0.0),
    )
    onboard, command, info = step_onboard(
        OnboardSetup(setup.navigator, setup.autopilot),
        route,
        state.onboard,
        MotionInput(readings.yaw_rate_radps, step_s),
        observe(setup, readings, lgpr),
        p_false,
        orders,
        fusion=spec.fusion,
    )
    health = info.navigated.health
    driver, by_hand, seen = _drive_by_hand(setup, route, state, step_s)
    pose_route, command, why = jax.tree.map(
        lambda ours, his: jnp.where(engaged, ours, his),
        (info.navigated.pose_route, command, info.autopilot),
        (state.plant.pose, by_hand, seen),
    )
    sound_s = jnp.where(health.reaction == Reaction.CONTINUE, state.sound_s + step_s, 0.0)
    state = state._replace(
        onboard=onboard,
        driver=driver,
        command=command,
        gear=why.plan.gear,
        sound_s=sound_s,
        handover=step_handover(state.handover, sound=sound_s > setup.settled_s, stop=health.reaction == Reaction.STOP),
    )
    return state, Decision(engaged, pose_route, info.navigated, why)


def _drive_by_hand(
    setup: LoopSetup, route: RoutePath, state: LoopState, step_s: Float[Array, ""]
) -> tuple[AutopilotState, Command, AutopilotInfo]:
    """The driver's tick: he steers and presses as the autopilot would, by the true pose."""
    yes, plant = jnp.asarray(True), state.plant
    seen = AutopilotInputs(
        pose_route=plant.pose,
        speed_mps=plant.speed_mps,
        reaction=jnp.int32(Reaction.CONTINUE.value),
        speed_cap_mps=jnp.float32(jnp.inf),
        age_s=jnp.float32(0.0),
        steering_engaged=yes,
        speed_engaged=yes,
        set_speed_mps=setup.set_speed_mps,
        front_rad=plant.servo.wheel_rad,
    )
    return step_autopilot(setup.autopilot, route, state.driver, seen, step_s)


def observe(setup: LoopSetup, readings: Readings, lgpr: LgprObservation) -> Observations:
    """Readings as the filter takes them, all at the tick's end."""
    zero = jnp.float32(0.0)
    noise = setup.noise
    covariance = lgpr.covariance + noise.lgpr_yaw_rad2 * jnp.diag(jnp.asarray([0.0, 0.0, 1.0], jnp.float32))
    return Observations(
        GnssObservation(
            readings.gnss_m[0],
            readings.gnss_m[1],
            noise.gnss_m2 * jnp.eye(2, dtype=jnp.float32),
            zero,
            readings.gnss_valid,
        ),
        HeadingObservation(readings.heading_rad, noise.heading_rad2, zero, readings.heading_valid),
        OdometerObservation(readings.odometer_mps, noise.odometer_m2ps2, readings.odometer_valid),
        lgpr._replace(covariance=covariance),
    )


# Records of a closed loop: figures of a tick, and sums over ticks.


class LoopSums(NamedTuple):
    """Sums while engaged; offsets of the true anchor from the route are weighted by distance.

    Attributes:
        way_m: distance driven.
        square_m3: integral of the squared offset over distance.
        largest_m: largest offset.
        beyond_foot_m: distance driven with an offset of more than a foot.
        steering_step_rad: largest change of the command within a tick.
        nees_position, nees_yaw: sums over ticks of the filter's normalized squared errors, two degrees of freedom and
            one.
        fixes: number of ticks with a fix.
        reactions: number of ticks with each ``Reaction``.
        reasons: bits of all ``Reason`` that occurred.
        ticks: number of ticks.
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
    """Record of a tick of a traced drive.

    Attributes:
        x_m, y_m, yaw_rad: true pose of the rear axle.
        offset_m: offset of the true anchor from the route, left of travel positive.
        error_m, error_yaw_rad: errors of the pose used for control, along and across, and in heading.
        sigma_cross_m: standard deviation across of the rear axle by the filter.
        nees_position, nees_yaw: normalized squared errors of the filter, two degrees of freedom and one.
        speed_mps, limit_mps: true speed, and the limit by route and health.
        command_rad, front_rad: commanded and actual angle of the front wheels.
        throttle, brake: pedal commands.
        reaction, reasons: reaction and reasons of the health.
        accepted: sources that the filter accepted.
        fix: whether there was a fix.
        code: code of the plan.
        to_go_m: distance to the route's end.
        engaged, stopping: whether the autopilot drives, and whether it has a stop command.
        on_lgpr: whether the threshold switch uses the LGPR.
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
    return LoopSums(
        way_m=zero,
        square_m3=zero,
        largest_m=zero,
        beyond_foot_m=zero,
        steering_step_rad=zero,
        nees_position=zero,
        nees_yaw=zero,
        fixes=none,
        reactions=jnp.zeros(3, jnp.int32),
        reasons=none,
        ticks=none,
    )


def tick_record(
    setup: LoopSetup,
    route: RoutePath,
    state: LoopState,
    decision: Decision,
    lgpr: LgprObservation,
) -> LoopTick:
    """Record of a tick."""
    pose, anchor = state.plant.pose, setup.plant.chassis.anchor_m
    navigator, planner = state.onboard.navigator, state.onboard.autopilot.planner
    anchor_x, anchor_y = pose.x_m + anchor * jnp.cos(pose.yaw_rad), pose.y_m + anchor * jnp.sin(pose.yaw_rad)
    foot = leg_project(route, planner.leg, planner.arc_m, anchor_x, anchor_y)
    foot = leg_project(route, planner.leg, foot.arc_m, anchor_x, anchor_y)
    driven = decision.pose_route
    plan = decision.autopilot.plan
    switch, gnss_ins = navigator.switch, pose_of(navigator.reckoned.estimate)
    return LoopTick(
        pose.x_m,
        pose.y_m,
        pose.yaw_rad,
        planner.travel * foot.offset_m,
        jnp.stack(_along_cross(driven.x_m - pose.x_m, driven.y_m - pose.y_m, pose.yaw_rad)),
        wrap_yaw(driven.yaw_rad - pose.yaw_rad),
        position_sigma_m(navigator.fused.estimate)[1],
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
        decision.engaged,
        state.handover.stopping,
        switch.on_lgpr,
        _along_cross(switch.pose.x_m - pose.x_m, switch.pose.y_m - pose.y_m, pose.yaw_rad)[1],
        _along_cross(gnss_ins.x_m - pose.x_m, gnss_ins.y_m - pose.y_m, pose.yaw_rad)[1],
    )


def add_tick(sums: LoopSums, tick: LoopTick, state: LoopState, before: LoopState, way_m: Float[Array, ""]) -> LoopSums:
    """Sums with one more tick."""
    way_m = jnp.abs(way_m)
    offset = jnp.abs(tick.offset_m)
    # Engaging, the limiter starts where the wheels are.
    held = before.onboard.autopilot.limiter.last
    grown = LoopSums(
        way_m=sums.way_m + way_m,
        square_m3=sums.square_m3 + offset * offset * way_m,
        largest_m=jnp.maximum(sums.largest_m, jnp.where(jnp.isfinite(offset), offset, jnp.inf)),
        beyond_foot_m=sums.beyond_foot_m + jnp.where(offset > FOOT_M, way_m, 0.0),
        steering_step_rad=jnp.maximum(sums.steering_step_rad, jnp.abs(state.command.front_rad - held.front_rad)),
        nees_position=sums.nees_position + tick.nees_position,
        nees_yaw=sums.nees_yaw + tick.nees_yaw,
        fixes=sums.fixes + tick.fix.astype(jnp.int32),
        reactions=sums.reactions + (jnp.arange(len(Reaction)) == tick.reaction).astype(jnp.int32),
        reasons=sums.reasons | tick.reasons,
        ticks=sums.ticks + 1,
    )
    # What the driver does before is not the loop's.
    return LoopSums(*(jnp.where(tick.engaged, new, old) for new, old in zip(grown, sums, strict=True)))


def _along_cross(
    east_m: Float[Array, ""], north_m: Float[Array, ""], yaw_rad: Float[Array, ""]
) -> tuple[Float[Array, ""], Float[Array, ""]]:
    cos, sin = jnp.cos(yaw_rad), jnp.sin(yaw_rad)
    return cos * east_m + sin * north_m, cos * north_m - sin * east_m


def _nees(state: LoopState) -> tuple[Float[Array, ""], Float[Array, ""]]:
    """Normalized squares of the filter's position, two degrees of freedom, and of its heading."""
    (mean, covariance), pose = state.onboard.navigator.fused.estimate, state.plant.pose
    east, north, turn = mean[X] - pose.x_m, mean[Y] - pose.y_m, wrap_yaw(mean[YAW] - pose.yaw_rad)
    xx, xy, yy = covariance[0, 0], covariance[0, 1], covariance[1, 1]
    position = (yy * east * east - 2.0 * xy * east * north + xx * north * north) / (xx * yy - xy * xy)
    return position, turn * turn / covariance[YAW, YAW]
