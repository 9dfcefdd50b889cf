"""The step in which a skid-steer vehicle's command is born: filter, health, guidance, fence, and the limiter last."""

from typing import Literal, NamedTuple, TypeVar

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int32

from lgprjax.autopilot.edge_ahead import edge_ahead
from lgprjax.autopilot.skid_health import judge_skid_health
from lgprjax.autopilot.skid_limiter import (
    SkidCommand,
    SkidLimiterState,
    init_skid_limiter,
    limit_skid_command,
    slowed,
)
from lgprjax.autopilot.skid_setup import SkidSetup
from lgprjax.coverage.carrot import CarrotPlan, CarrotState, init_carrot, step_carrot
from lgprjax.coverage.cover_route import CoverRoute
from lgprjax.coverage.route_pursuit import pursuit_along
from lgprjax.navigation.reaction import Reaction
from lgprjax.navigation.skid_filter import SkidFilterInfo, SkidFilterState, init_skid_filter, step_skid_filter
from lgprjax.navigation.skid_model import SCALE, SLIP_LEFT, SLIP_RIGHT, TURN_SCALE, SkidEstimate, skid_pose
from lgprjax.navigation.skid_observations import SkidMotion, SkidObservations
from lgprjax.vehicle.arc import VehiclePose
from lgprjax.vehicle.control_threshold import PulseState, init_pulses, settle_pulses, step_pulses
from lgprjax.vehicle.skid_steer import WheelSpeeds, wheel_speeds

_Tree = TypeVar("_Tree")

Guidance = Literal["carrot", "pursuit"]
"""MF's PID on a carrot, or the pursuit law; both on the same route."""


class SkidState(NamedTuple):
    """What is carried from step to step.

    Attributes:
        filter, carrot, pulses, limiter: of the parts.
        edge: the fence was foretold to be crossed; it stays until nothing is engaged.
    """

    filter: SkidFilterState
    carrot: CarrotState
    pulses: PulseState
    limiter: SkidLimiterState
    edge: Bool[Array, "..."]


class SkidOrders(NamedTuple):
    """What modes, watches and operator say to a step.

    Attributes:
        engaged: the computer has the vehicle; drives: and may move it, with the tool on where the route wants it.
        stop: a controlled stop, whatever navigation says. That it goes on when its reason is gone is for the mode
            machine to see to.
        speed_cap_mps: beside what navigation allows; may be infinite.
        set_speed_mps: that the operator locked.
        age_s: of the newest motion behind the pose.
        left_mps, right_mps: wheels as measured; may be no number.
    """

    engaged: Bool[Array, "..."]
    drives: Bool[Array, "..."]
    stop: Bool[Array, "..."]
    speed_cap_mps: Float[Array, "..."]
    set_speed_mps: Float[Array, "..."]
    age_s: Float[Array, "..."]
    left_mps: Float[Array, "..."]
    right_mps: Float[Array, "..."]


class SkidInfo(NamedTuple):
    """What a step found out.

    Attributes:
        filter: of the observations.
        plan: of the guidance.
        limited: bits of ``SkidLimited``; the one that asks for manual is an error to the mode machine.
        reaction, reasons: of navigation's health.
        sigma_m: standard deviation of the position, larger axis.
        edge_predicted: a stop would have crossed the fence, now or since it was engaged.
        stops: the vehicle is being stopped, or held.
    """

    filter: SkidFilterInfo
    plan: CarrotPlan
    limited: Int32[Array, "..."]
    reaction: Int32[Array, "..."]
    reasons: Int32[Array, "..."]
    sigma_m: Float[Array, "..."]
    edge_predicted: Bool[Array, "..."]
    stops: Bool[Array, "..."]


def init_skid(setup: SkidSetup, x_m: Float[Array, ""], y_m: Float[Array, ""]) -> SkidState:
    """Standing, at a position known within the model's sigma; the heading is unknown."""
    zero = jnp.zeros_like(x_m)
    return SkidState(
        init_skid_filter(setup.model, x_m, y_m),
        init_carrot(),
        init_pulses(zero),
        init_skid_limiter(zero, zero, setup.depth_m),
        jnp.asarray(False),
    )


def step_skid(
    setup: SkidSetup,
    route: CoverRoute,
    fence: Float[Array, "corner 2"],
    state: SkidState,
    motion: SkidMotion,
    observations: SkidObservations,
    orders: SkidOrders,
    *,
    guidance: Guidance = "carrot",
) -> tuple[SkidState, SkidCommand, SkidInfo]:
    """State, command and what was found out, of one step. One lane; ``vmap`` for many.

    The tool is off unless the vehicle is engaged, drives, is not being stopped and knows its heading. A stop slows both
    wheels in proportion: the vehicle stays on its arc, which is what the fence was held against. The carrot stands
    still while nothing is engaged: engaged again, the vehicle goes on where it left the route. Not engaged, the command
    follows the wheels as measured, so that the first one after engaging starts from there.

    A pose or an order that is no number makes a command that is none: the limiter knows what to do with it.

    Args:
        setup: vehicle and settings.
        route: to be driven.
        fence: from ``pad_fence``.
        state: of the last step.
        motion, observations: of the filter.
        orders: see there.
        guidance: law, compiled in.
    """
    step_s, last = motion.step_s, state.limiter.last
    filtered, found = step_skid_filter(setup.model, setup.rules, state.filter, motion, observations)
    pose = skid_pose(filtered.estimate)
    health = judge_skid_health(setup.health, filtered.estimate, filtered.gates, found, step_s)
    drives = orders.engaged & orders.drives

    grip = _grip(filtered.estimate)
    now = 0.5 * (last.left_mps * grip.left_mps + last.right_mps * grip.right_mps)
    change = setup.rise_mps2 * jnp.fmax(step_s, 0.0)
    wanted_mps = jnp.minimum(jnp.minimum(orders.set_speed_mps, orders.speed_cap_mps), health.speed_cap_mps)
    # A ramp's step nearer to the wanted speed, and never backwards.
    speed = jnp.maximum(jnp.clip(wanted_mps, now - change, now + change), 0.0)
    law = step_carrot if guidance == "carrot" else pursuit_along
    carrot, plan = law(setup.carrot, route, state.carrot, pose, speed, step_s)
    slower = jnp.minimum(speed, jnp.maximum(plan.speed_limit_mps, now - change))
    track = setup.model.track_m / _near_one(filtered.estimate.mean[TURN_SCALE])
    asked = _asked_wheels(setup, grip, wheel_speeds(track, speed, plan.yaw_rate_radps), slower / _positive(speed))
    pulses, told = step_pulses(setup.threshold_mps, state.pulses, asked, step_s)

    measured = WheelSpeeds(
        *(jnp.where(jnp.isfinite(wheel), wheel, 0.0) for wheel in (orders.left_mps, orders.right_mps))
    )
    edge = orders.engaged & (state.edge | _edge(setup, fence, pose, (asked, measured), drives, health.sigma_m))
    stops = orders.stop | (health.reaction == Reaction.STOP) | edge | ~drives
    halted = WheelSpeeds(*slowed(last.left_mps, last.right_mps, setup.stop.stop_mps2 * jnp.fmax(step_s, 0.0)))
    wheels = _chosen(stops, halted, told)
    tool = jnp.where(~stops & found.heading_known & plan.tool_on, 1.0, 0.0)
    wanted = SkidCommand(wheels.left_mps, wheels.right_mps, tool, setup.depth_m)

    limiter, _, limited = limit_skid_command(setup.limiter, state.limiter, wanted, orders.age_s, step_s)
    # Not engaged, nothing is told to anybody: the limiter stands where the operator has the wheels.
    free = init_skid_limiter(measured.left_mps, measured.right_mps, setup.depth_m)
    limiter = _chosen(orders.engaged, limiter, free)
    sent = WheelSpeeds(limiter.last.left_mps, limiter.last.right_mps)
    pulses = settle_pulses(setup.threshold_mps, pulses, asked, sent, step_s)
    pulses = _chosen(stops, init_pulses(speed), pulses)
    carrot = _chosen(orders.engaged, carrot, state.carrot)
    info = SkidInfo(
        found,
        plan,
        jnp.where(orders.engaged, limited, 0),
        health.reaction,
        health.reasons,
        health.sigma_m,
        edge,
        stops,
    )
    return SkidState(filtered, carrot, pulses, limiter, edge), limiter.last, info


def _grip(estimate: SkidEstimate) -> WheelSpeeds:
    """What passes under either side for a metre that its wheels turn, as the filter has learnt it.

    It is taken out of the commands: guidance would find out only by being beside the line.
    """
    mean = estimate.mean
    return WheelSpeeds(_near_one(mean[SCALE] + mean[SLIP_LEFT]), _near_one(mean[SCALE] + mean[SLIP_RIGHT]))


def _asked_wheels(setup: SkidSetup, grip: WheelSpeeds, ground: WheelSpeeds, share: Float[Array, ""]) -> WheelSpeeds:
    """Wheels for a share of both sides' speeds over ground, less where the faster one's limit says so."""
    left, right = ground.left_mps / grip.left_mps, ground.right_mps / grip.right_mps
    allowed = setup.vehicle.largest_wheel_mps / _positive(jnp.maximum(jnp.abs(left), jnp.abs(right)))
    share = jnp.minimum(jnp.minimum(allowed, share), 1.0)
    return WheelSpeeds(share * left, share * right)


def _positive(value: Float[Array, ""]) -> Float[Array, ""]:
    """A divisor: one where it would be zero."""
    return jnp.where(value > 0.0, value, 1.0)


def _near_one(part: Float[Array, ""]) -> Float[Array, ""]:
    """One and a learnt part, of which no more than 30 % is believed."""
    return 1.0 + jnp.clip(part, -0.3, 0.3)


def _edge(
    setup: SkidSetup,
    fence: Float[Array, "corner 2"],
    pose: VehiclePose,
    arcs: tuple[WheelSpeeds, WheelSpeeds],
    drives: Bool[Array, ""],
    sigma_m: Float[Array, ""],
) -> Bool[Array, ""]:
    """Whether a stop along the asked or the measured arc would cross the fence.

    The asked one counts while the vehicle drives; wheels that are no number are the limiter's business.
    """
    asked, measured = arcs
    track, rules = setup.vehicle.track_m, setup.stop
    along_asked = edge_ahead(rules, fence, setup.tool, track, pose, asked, sigma_m)
    along_measured = edge_ahead(rules, fence, setup.tool, track, pose, measured, sigma_m)
    some = jnp.isfinite(asked.left_mps + asked.right_mps)
    return (drives & some & along_asked) | along_measured


def _chosen(choice: Bool[Array, ""], chosen: _Tree, other: _Tree) -> _Tree:
    picked: _Tree = jax.tree.map(lambda one, two: jnp.where(choice, one, two), chosen, other)
    return picked
