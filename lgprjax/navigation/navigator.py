"""Navigation of one tick: fusion, the drifting frame, health. One step for simulator and vehicle.

Two filters run side by side: one with every source, and one without LGPR, which is the GNSS/INS solution that a search
of the map starts from and the threshold switch falls back on.
"""

from typing import Literal, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from lgprjax.navigation.counter_steer_filter import FilterInfo, FilterState, init_filter, step_filter
from lgprjax.navigation.counter_steer_model import (
    RATE_BIAS,
    SPEED,
    FilterModel,
    FrameOffset,
    SlewLimits,
    anchor_frame,
    pose_of,
    slew_frame,
    step_local,
    to_global,
)
from lgprjax.navigation.health import (
    OF_GNSS,
    Health,
    HealthRules,
    HealthState,
    SwitchSettings,
    SwitchState,
    init_health,
    init_switch,
    step_health,
    step_switch,
)
from lgprjax.navigation.kalman import wrap_yaw
from lgprjax.navigation.observations import GateRules, MotionInput, Observations
from lgprjax.vehicle import VehiclePose

Fusion = Literal["filter", "switch"]
"""Source of the pose used for control: the error-state filter, or LL's threshold switch."""


class NavigatorSetup(NamedTuple):
    """Model and settings of the parts."""

    model: FilterModel
    gates: GateRules
    switch: SwitchSettings
    slew: SlewLimits
    health: HealthRules


class NavigatorState(NamedTuple):
    """State of navigation from tick to tick.

    Attributes:
        filters: the one with every source and, if used, the one without LGPR, along a leading axis.
        switch: LL's fusion.
        local: dead-reckoned pose that never jumps; frame: the map's pose in it.
        health: its state.
        search_off: from the pose of GNSS/INS to that which a search of the map starts from: x, y and yaw.
    """

    filters: FilterState
    switch: SwitchState
    local: VehiclePose
    frame: FrameOffset
    health: HealthState
    search_off: VehiclePose

    @property
    def fused(self) -> FilterState:
        """The filter with every source; unbatched."""
        first: FilterState = jax.tree.map(lambda leaf: leaf[0], self.filters)
        return first

    @property
    def reckoned(self) -> FilterState:
        """The filter without LGPR, or, where there is none, the only one; unbatched."""
        last: FilterState = jax.tree.map(lambda leaf: leaf[-1], self.filters)
        return last

    @property
    def search_pose(self) -> VehiclePose:
        """Rear axle that a search of the map starts from: GNSS/INS, or what LGPR has held while GNSS was bad."""
        reckoned = pose_of(self.reckoned.estimate)
        return VehiclePose(*(own + off for own, off in zip(reckoned, self.search_off, strict=True)))


class Navigated(NamedTuple):
    """Result of a tick.

    Attributes:
        pose_route: of the rear axle in the map's frame, by the slewed frame, for control.
        speed_mps: forward, by the filter.
        info: of the filter with every source.
        health: request to the vehicle.
        frame_left_m: remaining motion of the slewed frame.
    """

    pose_route: VehiclePose
    speed_mps: Float[Array, "..."]
    info: FilterInfo
    health: Health
    frame_left_m: Float[Array, "..."]


def init_navigator(
    setup: NavigatorSetup, believed: VehiclePose, speed_mps: Float[Array, ""], *, reckons: bool = True
) -> NavigatorState:
    """At a pose and a speed known within the model's sigmas; unbatched."""
    zero = jnp.zeros_like(believed.x_m)
    both = [init_filter(setup.model, believed, speed_mps)] * (2 if reckons else 1)
    filters: FilterState = jax.tree.map(lambda *leaves: jnp.stack(leaves), *both)
    local = VehiclePose(zero, zero, zero)
    return NavigatorState(filters, init_switch(believed), local, anchor_frame(believed, local), init_health(), local)


def step_navigator(
    setup: NavigatorSetup,
    state: NavigatorState,
    motion: MotionInput,
    observations: Observations,
    p_false: Float[Array, ""],
    *,
    fusion: Fusion = "filter",
) -> tuple[NavigatorState, Navigated]:
    """One tick; unbatched, use ``vmap`` for more.

    Args:
        setup: of the parts.
        state: of the last tick.
        motion: yaw rate of the gyro, and the tick's length.
        observations: of the tick, with their ages at its end.
        p_false: of the tick's match, see ``step_health``; NaN without a match.
        fusion: whose pose is driven by.
    """
    # One program for both filters: only whether the fix is there differs.
    has_fix = jnp.arange(state.filters.estimate.mean.shape[0]) == 0

    def filtered(held: FilterState, fix: Bool[Array, ""]) -> tuple[FilterState, FilterInfo]:
        known = observations._replace(lgpr=observations.lgpr._replace(valid=observations.lgpr.valid & fix))
        return step_filter(setup.model, setup.gates, held, motion, known)

    filters, infos = jax.vmap(filtered)(state.filters, has_fix)
    info: FilterInfo = jax.tree.map(lambda leaf: leaf[0], infos)
    state = state._replace(filters=filters)
    fused = state.fused
    speed = fused.estimate.mean[SPEED]
    rate = motion.yaw_rate_radps - fused.estimate.mean[RATE_BIAS]
    gnss_ins = pose_of(state.reckoned.estimate)
    switch = step_switch(setup.switch, state.switch, motion, speed, gnss_ins, observations.lgpr, p_false)
    pose_map = pose_of(fused.estimate) if fusion == "filter" else switch.pose
    local = step_local(state.local, speed, rate, setup.model.zero_slip_m, motion.step_s)
    frame, left_m = slew_frame(state.frame, anchor_frame(pose_map, local), local, setup.slew, motion.step_s)
    health, judged = step_health(setup.health, state.health, fused, info, observations, p_false, left_m, motion.step_s)
    off = _search_off(state.search_off, gnss_ins, pose_of(fused.estimate), judged, jnp.abs(speed) * motion.step_s)
    state = state._replace(switch=switch, local=local, frame=frame, health=health, search_off=off)
    return state, Navigated(to_global(frame, local), speed, info, judged, left_m)


_SEARCH_SLEW = 0.02
"""Metres a metre of way by which the search's start follows: the shape of a window of some metres stays the same to
centimetres."""
_SEARCH_TURN_RADPM = 0.002


def _search_off(
    off: VehiclePose, gnss_ins: VehiclePose, fused: VehiclePose, health: Health, way_m: Float[Array, ""]
) -> VehiclePose:
    """Start of a search relative to GNSS/INS, after a tick.

    GNSS/INS alone is where a search starts as long as GNSS is good: it does not depend on what was found before. Dead
    reckoning leaves the searched region after some hundreds of metres, and a coarse receiver wanders as far: then the
    start follows the fused pose while LGPR bounds its error, and stays at its distance from dead reckoning otherwise.
    """
    bad = (health.reasons & jnp.int32(OF_GNSS.value)) != 0
    follows = bad & health.bounded
    apart = VehiclePose(fused.x_m - gnss_ins.x_m, fused.y_m - gnss_ins.y_m, wrap_yaw(fused.yaw_rad - gnss_ins.yaw_rad))
    ahead = [
        jnp.where(follows, there, jnp.where(bad, here, 0.0)) - here for there, here in zip(apart, off, strict=True)
    ]
    limit = _SEARCH_SLEW * way_m
    share = jnp.minimum(1.0, limit / jnp.maximum(jnp.hypot(ahead[0], ahead[1]), 1e-9))
    turn = _SEARCH_TURN_RADPM * way_m
    return VehiclePose(
        off.x_m + share * ahead[0], off.y_m + share * ahead[1], off.yaw_rad + jnp.clip(ahead[2], -turn, turn)
    )
