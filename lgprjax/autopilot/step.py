"""The control step: planner, pursuit, velocity control, and the limiter last.

In addition to navigation, the inputs hold the measured angle of the front wheels: while nothing is engaged the
limiter follows it, so that the first command after engaging starts from where the wheels are.
"""

import math
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int32

from lgprjax.autopilot.limiter import (
    Command,
    LimiterRules,
    LimiterState,
    init_limiter,
    limit_while_engaged,
    released,
)
from lgprjax.autopilot.speed import (
    VelocitySettings,
    VelocityState,
    default_velocity,
    follow_speed,
    init_velocity,
    step_stop,
    step_velocity,
)
from lgprjax.navigation import (
    FilterModel,
    Fusion,
    MotionInput,
    Navigated,
    NavigatorSetup,
    NavigatorState,
    Observations,
    Plan,
    PlanCode,
    PlannerSettings,
    PlannerState,
    Reaction,
    RoutePath,
    SlewLimits,
    default_rules,
    health_rules,
    planner_settings,
    step_navigator,
    step_planner,
    switch_settings,
)
from lgprjax.vehicle import (
    Chassis,
    LookAhead,
    Pedals,
    VehiclePose,
    look_ahead_m,
    steer_exact,
    step_slack,
    stretched_look_ahead,
    yaw_gain,
)


class AutopilotConfig(NamedTuple):
    """The model of the vehicle, and the settings.

    Attributes:
        chassis, pedals: vehicle; with pedals ``None`` the operator has throttle and brake.
        look_ahead: look-ahead over the commanded speed; it replaces the planner's constant one.
        planner, velocity, limiter: settings of the parts.
        weak_exponent, least_share: exponent of the look-ahead's growth with falling torque of the servo, and least
            share of torque considered; 0 and 1: no growth.
        slack_rad: dead band and half of the play of the steering, which the command compensates.
    """

    chassis: Chassis
    pedals: Pedals | None
    look_ahead: LookAhead
    planner: PlannerSettings
    velocity: VelocitySettings
    limiter: LimiterRules
    weak_exponent: float | Float[Array, ""] = 0.0
    least_share: float | Float[Array, ""] = 1.0
    slack_rad: float | Float[Array, ""] = 0.0


class AutopilotState(NamedTuple):
    """State of the autopilot from step to step: the parts' states, and the middle of the last turn of the wheels."""

    planner: PlannerState
    velocity: VelocityState
    limiter: LimiterState[Command]
    middle_rad: Float[Array, ""]


class AutopilotInputs(NamedTuple):
    """Inputs of a step.

    Attributes:
        pose_route: pose of the rear axle in the route's frame.
        speed_mps: speed, forward positive.
        reaction: ``Reaction`` of the health. The mode machine continues a stop without its reason, as ``stopping``.
        speed_cap_mps: limit by navigation; may be infinite.
        age_s: age of the pose.
        steering_engaged, speed_engaged: whether steering and speed are engaged; the second requires the first.
        set_speed_mps: speed locked by the operator.
        front_rad: measured angle of the front wheels.
        torque_share: measured remaining share of the servo's torque.
    """

    pose_route: VehiclePose
    speed_mps: Float[Array, ""]
    reaction: Int32[Array, ""]
    speed_cap_mps: Float[Array, ""]
    age_s: Float[Array, ""]
    steering_engaged: Bool[Array, ""]
    speed_engaged: Bool[Array, ""]
    set_speed_mps: Float[Array, ""]
    front_rad: Float[Array, ""]
    torque_share: float | Float[Array, ""] = 1.0


class AutopilotInfo(NamedTuple):
    """Diagnostics of a step.

    Attributes:
        plan: plan of the planner, with the required gear.
        limited: bits of ``Limited``; the bit that requests manual mode is an error for the mode machine.
        wanted_mps: speed being held or approached; 0 in a stop. Without pedals the fastest that navigation and route
            allow.
        reachable: whether the goal is on an arc within the wheels' limits.
        look_ahead_m: look-ahead used, lengthened for a weak servo.
    """

    plan: Plan
    limited: Int32[Array, ""]
    wanted_mps: Float[Array, ""]
    reachable: Bool[Array, ""]
    look_ahead_m: Float[Array, ""]


def init_autopilot(planner: PlannerState, speed_mps: Float[Array, ""], front_rad: Float[Array, ""]) -> AutopilotState:
    """State with a start found by the planner, at a speed (its magnitude), with the present front angle."""
    return AutopilotState(planner, init_velocity(speed_mps), init_limiter(released(front_rad)), front_rad)


def step_autopilot(
    config: AutopilotConfig, route: RoutePath, state: AutopilotState, inputs: AutopilotInputs, step_s: Float[Array, ""]
) -> tuple[AutopilotState, Command, AutopilotInfo]:
    """State, command and diagnostics of one step. Unbatched; ``vmap`` for many.

    The anchor is steered along the route with the yaw gain of the speed fed forward. Speed is the least of the
    operator's setting and the limits of navigation and route. In a stop the throttle is idle, the brake ramped, and the
    wheels steer on along the route as long as there is a pose; the same applies if the vehicle rolls against the
    planned gear. Without a known place on the route the wheels keep their angle. Without pedals neither is pressed, and
    the set speed is ignored.

    A NaN pose or speed makes a NaN command, which the limiter handles. Only in a stop may the speed be missing.

    Args:
        config: vehicle and settings.
        route: route to drive.
        state: state of the last step.
        inputs: inputs of this step.
        step_s: time since the last step.
    """
    pose = inputs.pose_route
    schedule = stretched_look_ahead(
        config.look_ahead,
        jnp.asarray(config.weak_exponent, jnp.float32),
        jnp.asarray(inputs.torque_share, jnp.float32),
        jnp.asarray(config.least_share, jnp.float32),
    )
    ahead_m = look_ahead_m(schedule, state.velocity.reference_mps)
    settings = config.planner._replace(look_ahead_m=ahead_m)
    planner, plan = step_planner(route, settings, config.chassis, state.planner, pose, inputs.speed_mps)
    engaged = inputs.steering_engaged
    along_mps = inputs.speed_mps * plan.gear
    stops = (inputs.reaction == Reaction.STOP) | (along_mps < -config.velocity.standing_mps)
    wanted = jnp.minimum(inputs.speed_cap_mps, plan.speed_limit_mps)
    if config.pedals is not None:
        wanted = jnp.minimum(inputs.set_speed_mps, wanted)

    middle = jnp.where(engaged, state.middle_rad, state.limiter.last.front_rad)
    front, middle, reachable = _steer(config, plan, inputs.speed_mps, stops, state.limiter.last.front_rad, middle)
    pose_is_one = jnp.isfinite(pose.x_m) & jnp.isfinite(pose.y_m) & jnp.isfinite(pose.yaw_rad)
    front = jnp.where(pose_is_one, front, jnp.nan)

    velocity, throttle, brake = _drive(config, state.velocity, inputs, wanted, along_mps, stops, step_s)

    command = Command(front, throttle, brake)
    limiter, limited = limit_while_engaged(
        config.limiter,
        state.limiter,
        command,
        inputs.age_s,
        step_s,
        engaged,
        released(inputs.front_rad),
    )
    info = AutopilotInfo(plan, limited, jnp.where(stops, 0.0, wanted), reachable, ahead_m)
    return AutopilotState(planner, velocity, limiter, middle), limiter.last, info


def _steer(
    config: AutopilotConfig,
    plan: Plan,
    speed_mps: Float[Array, ""],
    stops: Bool[Array, ""],
    last_rad: Float[Array, ""],
    middle_rad: Float[Array, ""],
) -> tuple[Float[Array, ""], Float[Array, ""], Bool[Array, ""]]:
    """Front angle, the middle of its last turn, and whether it reaches the goal."""
    # In a stop without a speed use the geometry alone: a gain of 1.
    speed = jnp.where(stops & ~jnp.isfinite(speed_mps), 0.0, speed_mps)
    gain = yaw_gain(config.chassis.characteristic_speed_mps, speed)
    steering = steer_exact(config.chassis, plan.ahead_m, plan.left_m, gain)
    blind = (plan.code == PlanCode.AMBIGUOUS) | (plan.code == PlanCode.LOST)
    # ``steer_exact`` returns a number for NaN; here NaN must remain visible.
    middle, front = step_slack(config.slack_rad, middle_rad, steering.front_rad)
    front = jnp.where(jnp.isfinite(gain), front, jnp.nan)
    middle = jnp.where(blind | ~jnp.isfinite(middle), middle_rad, middle)
    return jnp.where(blind, last_rad, front), middle, steering.reachable & ~blind


_Driven = tuple[VelocityState, Float[Array, "..."], Float[Array, "..."]]


def _drive(
    config: AutopilotConfig,
    state: VelocityState,
    inputs: AutopilotInputs,
    wanted_mps: Float[Array, ""],
    along_mps: Float[Array, ""],
    stops: Bool[Array, ""],
    step_s: Float[Array, ""],
) -> _Driven:
    """State of the velocity control, throttle and brake."""
    if config.pedals is None:
        free = jnp.zeros_like(along_mps)
        return follow_speed(state, along_mps), free, free
    engaged = inputs.steering_engaged
    drives = engaged & inputs.speed_engaged
    held, throttle, brake = step_velocity(config.velocity, config.pedals, state, wanted_mps, along_mps, drives, step_s)
    throttle = jnp.where(drives & ~jnp.isfinite(wanted_mps + along_mps), jnp.nan, throttle)
    stopped = step_stop(config.velocity, config.pedals, state, jnp.abs(inputs.speed_mps), step_s)
    return _pick(engaged & stops, stopped, (held, throttle, brake))


def _pick(choice: Bool[Array, ""], chosen: _Driven, other: _Driven) -> _Driven:
    picked: _Driven = jax.tree.map(lambda one, two: jnp.where(choice, one, two), chosen, other)
    return picked


# The whole onboard tick as one pure step: navigation, then the autopilot.


class OnboardSetup(NamedTuple):
    """Models and settings of both."""

    navigator: NavigatorSetup
    autopilot: AutopilotConfig


def onboard_setup(
    *,
    model: FilterModel,
    chassis: Chassis,
    pedals: Pedals | None,
    look_ahead: LookAhead,
    front_rate_radps: Float[Array, "..."],
    tick_s: float,
    gnss_period_s: float,
    risk: float,
    has_lgpr: bool = True,
    weak_exponent: float = 0.0,
    least_share: float = 1.0,
    slack_rad: float | Float[Array, ""] = 0.0,
) -> OnboardSetup:
    """Settings of a vehicle with heading and odometer every tick; settings without an argument are common to all.

    Args:
        model: model of the filter.
        chassis, pedals: models of chassis and pedals; pedals ``None``: the operator has throttle and brake.
        look_ahead: look-ahead over the commanded speed.
        front_rate_radps: largest rate of the front wheels.
        tick_s: tick of the loop.
        gnss_period_s: period of positions.
        risk: largest accepted probability of a false match.
        has_lgpr: whether there are LGPR fixes.
        weak_exponent, least_share, slack_rad: as in ``AutopilotConfig``.
    """
    one = jnp.float32
    navigator = NavigatorSetup(
        model,
        default_rules(),
        switch_settings(risk, zero_slip_m=model.zero_slip_m, array_x_m=model.array_x_m, array_y_m=model.array_y_m),
        SlewLimits(one(0.5), one(0.05)),
        health_rules(
            gnss_period_s=gnss_period_s,
            heading_period_s=tick_s,
            odometer_period_s=tick_s,
            # Fixes come in stretches: a metre or two of poor ground is normal.
            lgpr_period_s=0.5 if has_lgpr else math.inf,
            risk=risk,
        ),
    )
    # The limiter of a vehicle without pedals lets none be pressed, whatever the command says.
    throttle_rate, brake_rate, default_brake = (0.0, 0.0, 0.0) if pedals is None else (2.0, 4.0, 0.5)
    limits = LimiterRules(
        largest_front_rad=chassis.largest_angle_rad,
        front_rate_radps=front_rate_radps,
        throttle_rate_per_s=one(throttle_rate),
        brake_rate_per_s=one(brake_rate),
        oldest_s=one(0.2),
        default_brake=one(default_brake),
        release_rate_radps=one(0.1),
    )
    # Slopes of some per cent ask for a firmer hand than a road.
    velocity = default_velocity()._replace(proportional_per_s=one(1.5), integral_per_s2=one(0.4))
    steered = (one(weak_exponent), one(least_share), jnp.asarray(slack_rad, jnp.float32))
    return OnboardSetup(
        navigator, AutopilotConfig(chassis, pedals, look_ahead, planner_settings(2.0), velocity, limits, *steered)
    )


class OnboardState(NamedTuple):
    """State carried from tick to tick."""

    navigator: NavigatorState
    autopilot: AutopilotState


class Orders(NamedTuple):
    """Orders of modes, watches and operator to a tick.

    Attributes:
        steering_engaged, speed_engaged: whether steering and speed are engaged.
        stop: whether a controlled stop is commanded, independent of navigation.
        speed_cap_mps: speed cap in addition to that of navigation; may be infinite.
        set_speed_mps: speed locked by the operator.
        front_rad: measured angle of the front wheels; may be NaN.
        age_s: age of the motion used to propagate the pose.
        torque_share: remaining share of the servo's torque; see ``step_torque``.
    """

    steering_engaged: Bool[Array, ""]
    speed_engaged: Bool[Array, ""]
    stop: Bool[Array, ""]
    speed_cap_mps: Float[Array, ""]
    set_speed_mps: Float[Array, ""]
    front_rad: Float[Array, ""]
    age_s: Float[Array, ""]
    torque_share: float | Float[Array, ""] = 1.0


class OnboardInfo(NamedTuple):
    """Diagnostics of both."""

    navigated: Navigated
    autopilot: AutopilotInfo


def step_onboard(
    setup: OnboardSetup,
    route: RoutePath,
    state: OnboardState,
    motion: MotionInput,
    observations: Observations,
    p_false: Float[Array, ""],
    orders: Orders,
    *,
    fusion: Fusion = "filter",
) -> tuple[OnboardState, Command, OnboardInfo]:
    """One tick; unbatched.

    Args:
        setup: setup of the vehicle.
        route: route to drive.
        state: state of the last tick.
        motion, observations, p_false: see ``step_navigator``.
        orders: see ``Orders``.
        fusion: source of the pose used for control.
    """
    navigator, navigated = step_navigator(
        setup.navigator, state.navigator, motion, observations, p_false, fusion=fusion
    )
    health = navigated.health
    reaction = jnp.where(orders.stop, Reaction.STOP.value, health.reaction).astype(jnp.int32)
    inputs = AutopilotInputs(
        pose_route=navigated.pose_route,
        speed_mps=navigated.speed_mps,
        reaction=reaction,
        speed_cap_mps=jnp.minimum(health.speed_cap_mps, orders.speed_cap_mps),
        age_s=orders.age_s,
        steering_engaged=orders.steering_engaged,
        speed_engaged=orders.speed_engaged,
        set_speed_mps=orders.set_speed_mps,
        front_rad=orders.front_rad,
        torque_share=orders.torque_share,
    )
    autopilot, command, info = step_autopilot(setup.autopilot, route, state.autopilot, inputs, motion.step_s)
    return OnboardState(navigator, autopilot), command, OnboardInfo(navigated, info)
