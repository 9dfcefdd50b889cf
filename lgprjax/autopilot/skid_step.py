"""The control step of a skid-steer vehicle: filter, health, guidance, fence, and the limiter last."""

from typing import Literal, NamedTuple, TypeVar

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int32

from lgprjax.autopilot.fence import StopRules, edge_ahead
from lgprjax.autopilot.limiter import (
    LimiterState,
    SkidCommand,
    SkidLimiterRules,
    init_limiter,
    limit_while_engaged,
    slowed,
)
from lgprjax.coverage.field import Outline, Tool, outline_of
from lgprjax.coverage.guidance import (
    CarrotPlan,
    CarrotSettings,
    CarrotState,
    CoverRoute,
    default_carrot,
    gear_at,
    init_carrot,
    pursuit_along,
    step_carrot,
)
from lgprjax.navigation.health import STOPPING, Reaction, Reason
from lgprjax.navigation.observations import GNSS, HEADING, GateRules, GateState
from lgprjax.navigation.skid_filter import (
    SkidFilterInfo,
    SkidFilterState,
    init_skid_filter,
    skid_rules,
    step_skid_filter,
)
from lgprjax.navigation.skid_model import (
    SCALE,
    SLIP_LEFT,
    SLIP_RIGHT,
    TURN_SCALE,
    YAW,
    SkidEstimate,
    SkidModel,
    SkidMotion,
    SkidObservations,
    X,
    Y,
    skid_pose,
)
from lgprjax.vehicle.kinematics import SkidSteer, VehiclePose, WheelSpeeds, wheel_speeds
from lgprjax.vehicle.pursuit import PulseState, init_pulses, settle_pulses, step_pulses

# Health of a skid-steer vehicle's navigation: one of three reactions, and why. See ``navigation/health``.
#
# Loss of GNSS is no reason to stop: wheels and INS propagate the pose, and its uncertainty decides how fast to drive,
# and when to wait.


class SkidHealthRules(NamedTuple):
    """Limits, float32 scalars.

    Attributes:
        gnss_silent_s, heading_silent_s: times without an observation after which a source counts as silent.
        slow_sigma_m, degrade_sigma_m: standard deviations of the position, larger axis, from which the vehicle slows
            down, and at which it waits for a position.
        stop_sigma_m: standard deviation that stops the vehicle until the operator engages it again.
        longest_step_s: longest valid tick.
        degraded_mps: speed cap while degraded.
        least_mps: slowest speed; below it the vehicle waits.
    """

    gnss_silent_s: Float[Array, "..."]
    heading_silent_s: Float[Array, "..."]
    slow_sigma_m: Float[Array, "..."]
    degrade_sigma_m: Float[Array, "..."]
    stop_sigma_m: Float[Array, "..."]
    longest_step_s: Float[Array, "..."]
    degraded_mps: Float[Array, "..."]
    least_mps: Float[Array, "..."]


class SkidHealth(NamedTuple):
    """Request to the vehicle.

    Attributes:
        reaction: a ``Reaction``.
        reasons: bits of ``Reason``.
        speed_cap_mps: infinite, the degraded speed, or 0 for a stop.
        sigma_m: standard deviation of the position, larger axis.
    """

    reaction: Int32[Array, ""]
    reasons: Int32[Array, ""]
    speed_cap_mps: Float[Array, ""]
    sigma_m: Float[Array, ""]


def default_skid_health() -> SkidHealthRules:
    """Limits for GNSS at 1 Hz and an INS at 10 Hz; the stop is at the fault list's 0.3 m of dead reckoning."""
    return SkidHealthRules(*(jnp.float32(value) for value in (1.5, 0.5, 0.06, 0.1, 0.3, 0.2, 0.3, 0.05)))


def judge_skid_health(
    rules: SkidHealthRules,
    estimate: SkidEstimate,
    gates: GateState,
    info: SkidFilterInfo,
    step_s: Float[Array, ""],
) -> SkidHealth:
    """Health after a tick; unbatched, use ``vmap`` for more.

    Args:
        rules: limits.
        estimate, gates, info: results of the filter after the same tick.
        step_s: length of the tick.
    """
    finite = jnp.isfinite(estimate.mean).all() & jnp.isfinite(estimate.covariance).all()
    sigma_m = position_sigma(estimate)
    # The error grows with the way, not with the time: the less is known, the slower, and at last the vehicle waits.
    share = jnp.clip((rules.degrade_sigma_m - sigma_m) / (rules.degrade_sigma_m - rules.slow_sigma_m), 0.0, 1.0)
    waits = share * rules.degraded_mps < rules.least_mps
    seen = {
        Reason.NON_FINITE: ~finite,
        Reason.BAD_STEP: ~((step_s > 0.0) & (step_s <= rules.longest_step_s)),
        Reason.GNSS_SILENT: gates.since_offered_s[GNSS] > rules.gnss_silent_s,
        Reason.GNSS_REJECTED: gates.rejects[GNSS] > 0,
        Reason.HEADING_SILENT: gates.since_offered_s[HEADING] > rules.heading_silent_s,
        Reason.HEADING_REJECTED: gates.rejects[HEADING] > 1,
        Reason.UNCERTAIN: waits,
        Reason.HEADING_LOST: ~info.heading_known,
        # Written so that a NaN sigma stops.
        Reason.TOO_UNCERTAIN: ~(sigma_m <= rules.stop_sigma_m),
    }
    reasons = jnp.int32(0)
    for reason, holds in seen.items():
        reasons = reasons | jnp.where(holds, jnp.int32(reason.value), jnp.int32(0))
    stops = (reasons & jnp.int32(STOPPING.value)) != 0
    some = reasons != 0
    reaction = jnp.where(stops, Reaction.STOP.value, jnp.where(some, Reaction.DEGRADE.value, Reaction.CONTINUE.value))
    slower = jnp.where(waits, 0.0, share * rules.degraded_mps)
    # Also while fixes come: written so that a sigma that is no number slows down.
    unsure = some | ~(sigma_m < rules.slow_sigma_m)
    cap = jnp.where(stops, 0.0, jnp.where(unsure, slower, jnp.inf)).astype(jnp.float32)
    return SkidHealth(reaction.astype(jnp.int32), reasons, cap, sigma_m)


def position_sigma(estimate: SkidEstimate) -> Float[Array, ""]:
    """Standard deviation of the position along its larger axis, m."""
    covariance = estimate.covariance
    xx, xy, yy = covariance[X, X], covariance[X, Y], covariance[Y, Y]
    return jnp.sqrt(0.5 * (xx + yy) + jnp.hypot(0.5 * (xx - yy), xy))


# Setup of the control step of a skid-steer vehicle, and default settings.

_STOP_SHARE = 0.75
"""Share of the wheels' fastest change assumed for a stop, so that the real vehicle can achieve it."""
_RISE_SHARE = 0.5


class SkidSetup(NamedTuple):
    """The model of the vehicle, and the settings of the parts.

    Attributes:
        vehicle: limits of the vehicle.
        tool: rectangle of the tool.
        outline: outline of vehicle and tool, for the fence.
        model, rules: model of the filter and rules of its gates.
        health: limits at which navigation stops the vehicle.
        carrot: settings of the guidance.
        limiter: rules of the command limiter.
        stop: model of a stop, for the fence.
        rise_mps2: rate of raising the speed, and of lowering it without urgency.
        threshold_mps: speed difference of the wheels below which the vehicle ignores a turn, which is compensated; 0:
            none.
        depth_m: commanded depth of the tool.
    """

    vehicle: SkidSteer
    tool: Tool
    outline: Outline
    model: SkidModel
    rules: GateRules
    health: SkidHealthRules
    carrot: CarrotSettings
    limiter: SkidLimiterRules
    stop: StopRules
    rise_mps2: Float[Array, "..."]
    threshold_mps: Float[Array, "..."]
    depth_m: Float[Array, "..."]


def skid_setup(
    vehicle: SkidSteer,
    tool: Tool,
    model: SkidModel,
    *,
    depth_m: float,
    deepest_m: float,
    threshold_mps: float = 0.0,
    reaction_s: float = 0.5,
    carrot: CarrotSettings | None = None,
    outline: Outline | None = None,
) -> SkidSetup:
    """Settings for a small machine at walking speed; those of the parts follow from the vehicle's limits.

    Args:
        vehicle, tool, model: measured vehicle, tool and filter model.
        depth_m: commanded depth of the tool.
        deepest_m: largest commanded depth.
        threshold_mps: control threshold of the wheels' speed difference, or slightly more.
        reaction_s: time from a fix to the wheels: age of the pose, tick, delay and lag.
        carrot: settings of the guidance; ``None``: the default.
        outline: outline of vehicle and tool; ``None``: track and tool.
    """
    return SkidSetup(
        vehicle=vehicle,
        tool=tool,
        outline=outline_of(tool, track_m=float(vehicle.track_m)) if outline is None else outline,
        model=model,
        rules=skid_rules(),
        health=default_skid_health(),
        carrot=default_carrot(smallest_radius_m=float(vehicle.smallest_radius_m)) if carrot is None else carrot,
        limiter=SkidLimiterRules(
            vehicle.largest_wheel_mps,
            vehicle.wheel_rate_mps2,
            jnp.float32(deepest_m),
            jnp.float32(0.2),
            vehicle.wheel_rate_mps2,
        ),
        stop=StopRules(
            jnp.float32(reaction_s), _STOP_SHARE * vehicle.wheel_rate_mps2, jnp.float32(0.05), jnp.float32(3.0)
        ),
        rise_mps2=_RISE_SHARE * vehicle.wheel_rate_mps2,
        threshold_mps=jnp.float32(threshold_mps),
        depth_m=jnp.float32(depth_m),
    )


_Tree = TypeVar("_Tree")

OFF_LINE_M = 0.5
"""Distance from its line beyond which the tool does not work."""

Guidance = Literal["carrot", "pursuit"]
"""MF's PID on a lookahead point (the "carrot"), or the pursuit law; both on the same route."""


class SkidState(NamedTuple):
    """State carried from step to step.

    Attributes:
        filter, carrot, pulses, limiter: states of the parts.
        edge: whether a crossing of the fence was predicted; latched until nothing is engaged.
    """

    filter: SkidFilterState
    carrot: CarrotState
    pulses: PulseState
    limiter: LimiterState[SkidCommand]
    edge: Bool[Array, "..."]


class SkidOrders(NamedTuple):
    """Orders of modes, watches and operator to a step.

    Attributes:
        engaged: whether the computer controls the vehicle.
        drives: whether it may move the vehicle, with the tool on where the route requires it.
        stop: whether a controlled stop is commanded, independent of navigation. The mode machine continues it without
            its reason.
        speed_cap_mps: speed cap in addition to that of navigation; may be infinite.
        set_speed_mps: speed locked by the operator.
        age_s: age of the newest motion used for the pose.
        left_mps, right_mps: measured wheel speeds; may be NaN.
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
    """Diagnostics of a step.

    Attributes:
        filter: innovations and acceptance of the observations.
        plan: plan of the guidance.
        limited: bits of ``SkidLimited``; the bit that requests manual mode is an error for the mode machine.
        reaction, reasons: reaction and reasons of navigation's health.
        sigma_m: standard deviation of the position, larger axis.
        edge_predicted: whether a stop would have crossed the fence, now or since engaging.
        stops: whether the vehicle is being stopped, or held.
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
    """State at standstill, at a position known within the model's sigma; the heading is unknown."""
    zero = jnp.zeros_like(x_m)
    return SkidState(
        init_skid_filter(setup.model, x_m, y_m),
        init_carrot(),
        init_pulses(zero),
        init_limiter(SkidCommand(zero, zero, zero, setup.depth_m)),
        jnp.asarray(False),
    )


def step_skid(
    setup: SkidSetup,
    route: CoverRoute,
    fence: Float[Array, "side 2 2"],
    state: SkidState,
    motion: SkidMotion,
    observations: SkidObservations,
    orders: SkidOrders,
    *,
    guidance: Guidance = "carrot",
) -> tuple[SkidState, SkidCommand, SkidInfo]:
    """State, command and diagnostics of one step. Unbatched; ``vmap`` for many.

    The tool is off unless the vehicle is engaged, drives, is not being stopped, knows its heading and is within
    ``OFF_LINE_M`` of its line. A stop slows both wheels in proportion: the vehicle stays on its arc, for which the
    fence was checked. The lookahead point does not move while nothing is engaged: engaged again, the vehicle continues
    where it left the route. Not engaged, the command follows the wheels as measured, so that the first one after
    engaging starts from there.

    A NaN pose or order makes a NaN command, which the limiter handles.

    Args:
        setup: vehicle and settings.
        route: route to drive.
        fence: fence from ``pad_fence``.
        state: state of the last step.
        motion, observations: inputs of the filter.
        orders: see ``SkidOrders``.
        guidance: guidance law, a static argument.
    """
    step_s, last = motion.step_s, state.limiter.last
    filtered, found = step_skid_filter(setup.model, setup.rules, state.filter, motion, observations)
    pose = skid_pose(filtered.estimate)
    health = judge_skid_health(setup.health, filtered.estimate, filtered.gates, found, step_s)
    drives = orders.engaged & orders.drives

    grip = _grip(filtered.estimate)
    gear = gear_at(route, state.carrot.arc_m)
    # Along the way: in reverse the wheels turn backwards.
    now = gear * 0.5 * (last.left_mps * grip.left_mps + last.right_mps * grip.right_mps)
    change = setup.rise_mps2 * jnp.fmax(step_s, 0.0)
    wanted_mps = jnp.minimum(jnp.minimum(orders.set_speed_mps, orders.speed_cap_mps), health.speed_cap_mps)
    # A ramp's step closer to the wanted speed, never backward.
    speed = jnp.maximum(jnp.clip(wanted_mps, now - change, now + change), 0.0)
    law = step_carrot if guidance == "carrot" else pursuit_along
    carrot, plan = law(setup.carrot, route, state.carrot, pose, speed, step_s)
    slower = jnp.minimum(speed, jnp.maximum(plan.speed_limit_mps, now - change))
    track = setup.model.track_m / _near_one(filtered.estimate.mean[TURN_SCALE])
    requested = _requested_wheels(
        setup, grip, wheel_speeds(track, gear * speed, plan.yaw_rate_radps), slower / _positive(speed)
    )
    sigmas = health.sigma_m, jnp.sqrt(jnp.maximum(filtered.estimate.covariance[YAW, YAW], 0.0))
    requested = _slowed_at_edge(setup, fence, pose, requested, sigmas)
    pulses, pulsed = step_pulses(setup.threshold_mps, state.pulses, requested, step_s)

    measured = WheelSpeeds(
        *(jnp.where(jnp.isfinite(wheel), wheel, 0.0) for wheel in (orders.left_mps, orders.right_mps))
    )
    edge = orders.engaged & (state.edge | _edge(setup, fence, pose, (requested, measured), drives, sigmas))
    stops = orders.stop | (health.reaction == Reaction.STOP) | edge | ~drives
    halted = WheelSpeeds(*slowed(last.left_mps, last.right_mps, setup.stop.stop_mps2 * jnp.fmax(step_s, 0.0)))
    wheels = _chosen(stops, halted, pulsed)
    on_line = plan.tool_on & (jnp.abs(plan.cross_m) <= OFF_LINE_M)
    tool = jnp.where(~stops & found.heading_known & on_line, 1.0, 0.0)
    wanted = SkidCommand(wheels.left_mps, wheels.right_mps, tool, setup.depth_m)

    limiter, limited = limit_while_engaged(
        setup.limiter,
        state.limiter,
        wanted,
        orders.age_s,
        step_s,
        orders.engaged,
        SkidCommand(measured.left_mps, measured.right_mps, jnp.zeros_like(speed), setup.depth_m),
    )
    sent = WheelSpeeds(limiter.last.left_mps, limiter.last.right_mps)
    pulses = settle_pulses(setup.threshold_mps, pulses, requested, sent, step_s)
    pulses = _chosen(stops, init_pulses(speed), pulses)
    carrot = _chosen(orders.engaged, carrot, state.carrot)
    info = SkidInfo(
        filter=found,
        plan=plan,
        limited=limited,
        reaction=health.reaction,
        reasons=health.reasons,
        sigma_m=health.sigma_m,
        edge_predicted=edge,
        stops=stops,
    )
    return SkidState(filtered, carrot, pulses, limiter, edge), limiter.last, info


_EDGE_SHARES = (1.0, 0.8, 0.65, 0.5, 0.4, 0.3, 0.22, 0.15, 0.1)
"""Shares of the speed tried near the fence, the largest first."""
_LATE = 3.0
"""Factor on the reaction time of a stop, so that the wheels slow down before the stop itself would come."""


def _grip(estimate: SkidEstimate) -> WheelSpeeds:
    """Ground distance of either side per metre of its wheels, as learnt by the filter.

    Compensated in the commands: guidance would react only to a lateral error.
    """
    mean = estimate.mean
    return WheelSpeeds(_near_one(mean[SCALE] + mean[SLIP_LEFT]), _near_one(mean[SCALE] + mean[SLIP_RIGHT]))


def _requested_wheels(setup: SkidSetup, grip: WheelSpeeds, ground: WheelSpeeds, share: Float[Array, ""]) -> WheelSpeeds:
    """Wheels for a share of both sides' speeds over ground, reduced to the limit of the faster one."""
    left, right = ground.left_mps / grip.left_mps, ground.right_mps / grip.right_mps
    allowed = setup.vehicle.largest_wheel_mps / _positive(jnp.maximum(jnp.abs(left), jnp.abs(right)))
    share = jnp.minimum(jnp.minimum(allowed, share), 1.0)
    return WheelSpeeds(share * left, share * right)


def _positive(value: Float[Array, ""]) -> Float[Array, ""]:
    """A divisor: one instead of zero."""
    return jnp.where(value > 0.0, value, 1.0)


def _near_one(part: Float[Array, ""]) -> Float[Array, ""]:
    """One plus a learnt part, limited to 30 %."""
    return 1.0 + jnp.clip(part, -0.3, 0.3)


def _slowed_at_edge(
    setup: SkidSetup,
    fence: Float[Array, "side 2 2"],
    pose: VehiclePose,
    requested: WheelSpeeds,
    sigmas: tuple[Float[Array, ""], Float[Array, ""]],
) -> WheelSpeeds:
    """The same arc at the largest speed from which even a late stop stays within the fence; else the least one.

    A plan turns close to walls: the arc of one moment, held for as long as a stop at full speed takes, would cross
    them.
    """
    late = setup.stop._replace(reaction_s=_LATE * setup.stop.reaction_s)

    def crosses(share: Float[Array, ""]) -> Bool[Array, ""]:
        arc = WheelSpeeds(share * requested.left_mps, share * requested.right_mps)
        return edge_ahead(late, fence, setup.outline, setup.vehicle.track_m, pose, arc, *sigmas)

    shares = jnp.asarray(_EDGE_SHARES, jnp.float32)
    share = jnp.max(jnp.where(jax.vmap(crosses)(shares), shares[-1], shares))
    return WheelSpeeds(share * requested.left_mps, share * requested.right_mps)


def _edge(
    setup: SkidSetup,
    fence: Float[Array, "side 2 2"],
    pose: VehiclePose,
    arcs: tuple[WheelSpeeds, WheelSpeeds],
    drives: Bool[Array, ""],
    sigmas: tuple[Float[Array, ""], Float[Array, ""]],
) -> Bool[Array, ""]:
    """Whether a stop along the commanded or the measured arc would cross the fence.

    The commanded one counts while the vehicle drives; the limiter handles NaN wheels.
    """
    requested, measured = arcs
    track, rules = setup.vehicle.track_m, setup.stop
    along_requested = edge_ahead(rules, fence, setup.outline, track, pose, requested, *sigmas)
    along_measured = edge_ahead(rules, fence, setup.outline, track, pose, measured, *sigmas)
    some = jnp.isfinite(requested.left_mps + requested.right_mps)
    return (drives & some & along_requested) | along_measured


def _chosen(choice: Bool[Array, ""], chosen: _Tree, other: _Tree) -> _Tree:
    picked: _Tree = jax.tree.map(lambda one, two: jnp.where(choice, one, two), chosen, other)
    return picked
