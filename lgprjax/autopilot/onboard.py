"""All that is computed on board in a tick, as one pure step: navigation, then the autopilot."""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from lgprjax.autopilot.limiter import Command
from lgprjax.autopilot.step import AutopilotConfig, AutopilotInfo, AutopilotInputs, AutopilotState, step_autopilot
from lgprjax.navigation import (
    Fusion,
    Motion,
    Navigated,
    NavigatorSetup,
    NavigatorState,
    Observations,
    Reaction,
    RoutePath,
    step_navigator,
)


class OnboardSetup(NamedTuple):
    """Models and settings of both."""

    navigator: NavigatorSetup
    autopilot: AutopilotConfig


class OnboardState(NamedTuple):
    """What is carried from tick to tick."""

    navigator: NavigatorState
    autopilot: AutopilotState


class Orders(NamedTuple):
    """What modes, watches and operator say to a tick.

    Attributes:
        steering_engaged, speed_engaged: from the mode.
        stop: a controlled stop, whatever navigation says.
        speed_cap_mps: beside what navigation allows; may be infinite.
        set_speed_mps: that the operator locked.
        front_rad: of the front wheels as measured; may be no number.
        age_s: of the motion that the pose was carried on by.
    """

    steering_engaged: Bool[Array, ""]
    speed_engaged: Bool[Array, ""]
    stop: Bool[Array, ""]
    speed_cap_mps: Float[Array, ""]
    set_speed_mps: Float[Array, ""]
    front_rad: Float[Array, ""]
    age_s: Float[Array, ""]


class OnboardInfo(NamedTuple):
    """What both found out."""

    navigated: Navigated
    autopilot: AutopilotInfo


def step_onboard(
    setup: OnboardSetup,
    route: RoutePath,
    state: OnboardState,
    motion: Motion,
    observations: Observations,
    p_false: Float[Array, ""],
    orders: Orders,
    *,
    fusion: Fusion = "filter",
) -> tuple[OnboardState, Command, OnboardInfo]:
    """One tick; one lane.

    Args:
        setup: of the vehicle.
        route: that is driven, or would be.
        state: of the last tick.
        motion, observations, p_false: see ``step_navigator``.
        orders: see there.
        fusion: whose pose is driven by.
    """
    navigator, navigated = step_navigator(
        setup.navigator, state.navigator, motion, observations, p_false, fusion=fusion
    )
    health = navigated.health
    reaction = jnp.where(orders.stop, Reaction.STOP.value, health.reaction).astype(jnp.int32)
    inputs = AutopilotInputs(
        navigated.pose_route,
        navigated.speed_mps,
        reaction,
        jnp.minimum(health.speed_cap_mps, orders.speed_cap_mps),
        orders.age_s,
        orders.steering_engaged,
        orders.speed_engaged,
        orders.set_speed_mps,
        orders.front_rad,
    )
    autopilot, command, info = step_autopilot(setup.autopilot, route, state.autopilot, inputs, motion.step_s)
    return OnboardState(navigator, autopilot), command, OnboardInfo(navigated, info)
