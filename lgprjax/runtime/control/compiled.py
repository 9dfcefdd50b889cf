"""Compiled steps of the control loop: one vector of numbers in, one out, so that a tick is one call and one copy."""

from collections.abc import Iterable
from functools import partial
from typing import Any, NamedTuple, cast

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Bool, Float, Int

from lgprjax.autopilot import OnboardSetup, OnboardState, Orders, init_autopilot, step_onboard
from lgprjax.navigation import (
    Fusion,
    GnssObservation,
    HeadingObservation,
    LgprObservation,
    MotionInput,
    Observations,
    OdometerObservation,
    PlanCode,
    PlannerState,
    RoutePath,
    acquire,
    choose,
    find_starts,
    init_navigator,
    lost_planner,
    pose_of,
    position_sigma_m,
)
from lgprjax.navigation.counter_steer_model import YAW
from lgprjax.vehicle import VehiclePose

# Numbers of a tick on their way into a compiled step and out of it, for every vehicle.


def as_vector(numbers: tuple[float, ...]) -> Float[np.ndarray, " number"]:
    """Numbers as the input vector of a compiled step."""
    return np.array(numbers, np.float32)


def named_numbers(names: type[tuple[float, ...]], numbers: Float[Array, " number"]) -> tuple[Any, Any]:
    """Traced numbers under the names of plain ones, and the same as flags."""
    return names(*numbers), names(*(numbers > 0.5))


def gnss_of(inputs: Any, yes: Any) -> GnssObservation:
    """The position among ``named_numbers``."""
    covariance = inputs.gnss_m2 * jnp.eye(2, dtype=jnp.float32)
    return GnssObservation(inputs.gnss_x_m, inputs.gnss_y_m, covariance, inputs.gnss_age_s, yes.gnss_valid)


def bits_of(flags: Bool[Array, " source"]) -> Int[Array, ""]:
    """Flags as one number, the first being its lowest bit."""
    return jnp.sum(jnp.where(flags, 1 << jnp.arange(flags.shape[-1]), 0))


def as_row(numbers: Iterable[ArrayLike]) -> Float[Array, " number"]:
    """Results of a compiled step as one row, to be fetched at once."""
    return jnp.stack([jnp.asarray(number).astype(jnp.float32) for number in numbers])


# The compiled step of a counter-steered vehicle.


class TickNumbers(NamedTuple):
    """Inputs of a tick as plain numbers; see ``MotionInput``, ``Observations`` and ``Orders``. Flags are 0 or 1."""

    step_s: float
    yaw_rate_radps: float
    gnss_valid: float
    gnss_x_m: float
    gnss_y_m: float
    gnss_m2: float
    gnss_age_s: float
    heading_valid: float
    heading_rad: float
    heading_rad2: float
    heading_age_s: float
    odometer_valid: float
    odometer_mps: float
    odometer_m2ps2: float
    fix_valid: float
    fix_x_m: float
    fix_y_m: float
    fix_yaw_rad: float
    fix_xx: float
    fix_xy: float
    fix_yy: float
    fix_xyaw: float
    fix_yyaw: float
    fix_yawyaw: float
    fix_age_s: float
    p_false: float
    steering_engaged: float
    speed_engaged: float
    stop: float
    speed_cap_mps: float
    set_speed_mps: float
    front_rad: float
    age_s: float
    torque_share: float


class TickResult(NamedTuple):
    """Results of a tick as plain numbers.

    Attributes:
        x_m, y_m, yaw_rad: pose used for control, rear axle, map's frame.
        fused_x_m, fused_y_m, fused_yaw_rad: pose of the filter.
        reckoned_x_m ... reckoned_yaw_sigma_rad: pose without LGPR, and standard deviation of its heading.
        search_x_m, search_y_m, search_yaw_rad: start pose of the search on the map.
        speed_mps: forward speed.
        sigma_along_m, sigma_cross_m: standard deviations of the filter's position.
        reaction, reasons, cap_mps, bounded, gnss_bounded, frame_left_m: health.
        accepted, offered: bits of the sources.
        ahead_m ... gear: the plan, see ``Plan``.
        leg, arc_m, travel: place of the plan, see ``PlannerState``.
        front_rad, throttle, brake, limited: the command and the limiter's bits.
        wanted_mps, reachable, look_ahead_m: see ``AutopilotInfo``.
    """

    x_m: float
    y_m: float
    yaw_rad: float
    fused_x_m: float
    fused_y_m: float
    fused_yaw_rad: float
    reckoned_x_m: float
    reckoned_y_m: float
    reckoned_yaw_rad: float
    reckoned_yaw_sigma_rad: float
    search_x_m: float
    search_y_m: float
    search_yaw_rad: float
    speed_mps: float
    sigma_along_m: float
    sigma_cross_m: float
    reaction: float
    reasons: float
    cap_mps: float
    bounded: float
    gnss_bounded: float
    frame_left_m: float
    accepted: float
    offered: float
    offset_m: float
    heading_error_rad: float
    to_go_m: float
    gear: float
    code: float
    leg: float
    arc_m: float
    travel: float
    front_rad: float
    throttle: float
    brake: float
    limited: float
    wanted_mps: float
    reachable: float
    look_ahead_m: float


@partial(jax.jit, static_argnames="fusion")
def step_compiled(
    setup: OnboardSetup,
    route: RoutePath,
    state: OnboardState,
    numbers: Float[Array, " number"],
    *,
    fusion: Fusion,
) -> tuple[OnboardState, Float[Array, " result"]]:
    """``step_onboard`` on ``TickNumbers``, with ``TickResult`` as one row."""
    inputs, yes = named_numbers(TickNumbers, numbers)
    motion = MotionInput(inputs.yaw_rate_radps, inputs.step_s)
    covariance = jnp.stack(
        [
            jnp.stack([inputs.fix_xx, inputs.fix_xy, inputs.fix_xyaw]),
            jnp.stack([inputs.fix_xy, inputs.fix_yy, inputs.fix_yyaw]),
            jnp.stack([inputs.fix_xyaw, inputs.fix_yyaw, inputs.fix_yawyaw]),
        ]
    )
    observations = Observations(
        gnss_of(inputs, yes),
        HeadingObservation(inputs.heading_rad, inputs.heading_rad2, inputs.heading_age_s, yes.heading_valid),
        OdometerObservation(inputs.odometer_mps, inputs.odometer_m2ps2, yes.odometer_valid),
        LgprObservation(
            inputs.fix_x_m, inputs.fix_y_m, inputs.fix_yaw_rad, covariance, inputs.fix_age_s, yes.fix_valid
        ),
    )
    orders = Orders(
        steering_engaged=yes.steering_engaged,
        speed_engaged=yes.speed_engaged,
        stop=yes.stop,
        speed_cap_mps=inputs.speed_cap_mps,
        set_speed_mps=inputs.set_speed_mps,
        front_rad=inputs.front_rad,
        age_s=inputs.age_s,
        torque_share=inputs.torque_share,
    )
    state, command, info = step_onboard(
        setup, route, state, motion, observations, inputs.p_false, orders, fusion=fusion
    )
    navigated, plan = info.navigated, info.autopilot.plan
    fused, reckoned = state.navigator.fused.estimate, state.navigator.reckoned.estimate
    row = (
        *navigated.pose_route,
        *pose_of(fused),
        *pose_of(reckoned),
        jnp.sqrt(reckoned.covariance[YAW, YAW]),
        *state.navigator.search_pose,
        navigated.speed_mps,
        *position_sigma_m(fused),
        navigated.health.reaction,
        navigated.health.reasons,
        navigated.health.speed_cap_mps,
        navigated.health.bounded,
        navigated.health.gnss_bounded,
        navigated.frame_left_m,
        bits_of(navigated.info.accepted),
        bits_of(navigated.info.offered),
        plan.offset_m,
        plan.heading_error_rad,
        plan.to_go_m,
        plan.gear,
        plan.code,
        *state.autopilot.planner[:3],
        *command,
        info.autopilot.limited,
        info.autopilot.wanted_mps,
        info.autopilot.reachable,
        info.autopilot.look_ahead_m,
    )
    return state, as_row(row)


@jax.jit
def start_compiled(
    setup: OnboardSetup, pose: Float[Array, " 3"], speed_mps: Float[Array, ""], front_rad: Float[Array, ""]
) -> OnboardState:
    """Onboard state at a pose of the rear axle from GNSS/INS, without a place on a route."""
    navigator = init_navigator(setup.navigator, VehiclePose(*pose), speed_mps)
    return OnboardState(navigator, init_autopilot(lost_planner(), jnp.abs(speed_mps), front_rad))


class FoundPlaces(NamedTuple):
    """Places of the route at the vehicle, as rows of numbers, nearest first.

    Attributes:
        code: code of the search, or of the requested place.
        leg, arc_m, travel: as in ``PlannerState``.
        possible: 1 for places at most ``ambiguity_m`` farther than the nearest, with a fitting heading.
    """

    code: Float[np.ndarray, " candidate"]
    leg: Float[np.ndarray, " candidate"]
    arc_m: Float[np.ndarray, " candidate"]
    travel: Float[np.ndarray, " candidate"]
    possible: Float[np.ndarray, " candidate"]


@jax.jit
def acquire_compiled(
    setup: OnboardSetup, route: RoutePath, state: OnboardState, pose: Float[Array, " 3"], number: Int[Array, ""]
) -> tuple[OnboardState, Float[Array, "5 candidate"]]:
    """State with the planner placed on the route at the vehicle, and ``FoundPlaces``.

    Args:
        setup: setup of the vehicle.
        route: route to drive.
        state: state before.
        pose: pose of the rear axle.
        number: number of the place that the operator chose, from 0; -1: the only place.
    """
    config = setup.autopilot
    starts = find_starts(route, config.planner, config.chassis, VehiclePose(*pose))
    (alone, alone_code), (chosen, chosen_code) = acquire(starts), choose(starts, number)
    planner = jax.tree.map(lambda one, two: jnp.where(number < 0, one, two), alone, chosen)
    code = jnp.where(number < 0, alone_code, chosen_code)
    held = state.autopilot._replace(planner=_as(planner, state.autopilot.planner))
    possible = starts.valid & (starts.distance_m <= starts.distance_m[0] + config.planner.ambiguity_m)
    columns = (jnp.broadcast_to(code, possible.shape), starts.leg, starts.arc_m, starts.travel, possible)
    return state._replace(autopilot=held), as_row(columns)


def _as(planner: PlannerState, like: PlannerState) -> PlannerState:
    """Convert to the types of the loop, so that nothing is compiled twice."""
    cast_one = jax.tree.map(lambda new, old: jnp.asarray(new, old.dtype), planner, like)
    return cast("PlannerState", cast_one)


FOLLOWED = frozenset({int(PlanCode.FOLLOWING), int(PlanCode.AT_CUSP), int(PlanCode.DONE)})
"""Plan codes for a vehicle with a place on the route."""
