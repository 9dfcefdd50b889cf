"""The closed loop, tick by tick: vehicle, sensors, fusion, health, planner, law, limiter, and round again.

A tick has two halves: ``move`` (what the world does: the last command drives the vehicle, the sensors see it) and
``decide`` (what runs on board: fusion, health, the drifting frame, the autopilot). Between them stands the radar:
registration of rendered scans, or fixes drawn from an error model. Both halves are one lane, more by ``vmap``; the
controller never sees the true pose; only the driver does, who brings the vehicle to where it may be engaged.
"""

from dataclasses import dataclass
from typing import Literal, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int, PRNGKeyArray

from lgprjax.autopilot import (
    AutopilotConfig,
    AutopilotInfo,
    AutopilotInputs,
    AutopilotState,
    Command,
    init_autopilot,
    step_autopilot,
)
from lgprjax.navigation import (
    FilterInfo,
    FilterModel,
    FilterState,
    FrameOffset,
    GateRules,
    GnssObservation,
    HeadingObservation,
    Health,
    HealthRules,
    HealthState,
    LgprObservation,
    Motion,
    Observations,
    OdometerObservation,
    PlannerState,
    Reaction,
    RoutePath,
    SlewLimits,
    SwitchSettings,
    SwitchState,
    anchor_frame,
    init_filter,
    init_health,
    init_switch,
    pose_of,
    slew_frame,
    step_filter,
    step_health,
    step_local,
    step_switch,
    to_global,
)
from lgprjax.scene import (
    LiveSensors,
    LiveSensorState,
    Plant,
    PlantState,
    Readings,
    SensorFaults,
    Terrain,
    init_live_sensors,
    init_plant,
    read_live_sensors,
    step_plant,
)
from lgprjax.vehicle import VehiclePose

TICK_S = 1.0 / 21.0
"""Of the loop: six scans of a 126 Hz radar, two when it records every third."""


@dataclass(frozen=True)
class LoopSpec:
    """What is the same for all lanes, and compiled in.

    Attributes:
        tick_s: of the loop.
        fusion: whose pose is driven by: the error-state filter, or LL's threshold switch.
        delay_slots: substeps of the servo's longest delay.
        reckons: a second filter runs beside the first, without LGPR: the GNSS/INS that a search starts from and that
            the switch falls back on.
    """

    tick_s: float = TICK_S
    fusion: Literal["filter", "switch"] = "filter"
    delay_slots: int = 5
    reckons: bool = True


class ReportedNoise(NamedTuple):
    """Variances that the fusion reckons with, a tick.

    The filter has no state for slow errors of headings: such an error counts as so much more white noise.

    Attributes:
        gnss_m2: of a position, an axis.
        heading_rad2: of an INS heading.
        odometer_m2ps2: of the odometer.
        lgpr_yaw_rad2: beside what a fix says of its own heading.
    """

    gnss_m2: Float[Array, "..."]
    heading_rad2: Float[Array, "..."]
    odometer_m2ps2: Float[Array, "..."]
    lgpr_yaw_rad2: Float[Array, "..."]


class LoopSetup(NamedTuple):
    """World and vehicle of a lane, and what runs on board."""

    plant: Plant
    terrain: Terrain
    sensors: LiveSensors
    faults: SensorFaults
    model: FilterModel
    gates: GateRules
    noise: ReportedNoise
    health: HealthRules
    slew: SlewLimits
    switch: SwitchSettings
    autopilot: AutopilotConfig
    set_speed_mps: Float[Array, "..."]
    settled_s: Float[Array, "..."]


class LoopState(NamedTuple):
    """Everything that a lane carries from tick to tick.

    Attributes:
        plant, sensors: the world's.
        filters: the one with every source and, where the loop reckons, the one without LGPR, along a leading axis.
        switch: LL's fusion.
        local: dead-reckoned pose that never jumps; frame: where the map lies in it.
        health, autopilot: as they stand.
        command: drives the next tick.
        gear: +1 or -1.
        engaged: the autopilot drives. Before, a driver does, who sees the road; he engages it when health has been
            without a complaint for ``LoopSetup.settled_s``.
        sound_s: for so long it has been.
        stopping: a stop was asked for: it goes on when its reason is gone, as in the mode machine.
        tick: how many have passed.
    """

    plant: PlantState
    sensors: LiveSensorState
    filters: FilterState
    switch: SwitchState
    local: VehiclePose
    frame: FrameOffset
    health: HealthState
    autopilot: AutopilotState
    command: Command
    gear: Float[Array, "..."]
    engaged: Bool[Array, "..."]
    sound_s: Float[Array, "..."]
    stopping: Bool[Array, "..."]
    tick: Int[Array, "..."]

    @property
    def fused(self) -> FilterState:
        """The filter with every source; of one lane."""
        first: FilterState = jax.tree.map(lambda leaf: leaf[0], self.filters)
        return first

    @property
    def reckoned(self) -> FilterState:
        """The filter without LGPR, or, where there is none, the only one; of one lane."""
        last: FilterState = jax.tree.map(lambda leaf: leaf[-1], self.filters)
        return last


class Decision(NamedTuple):
    """What a tick decided, and why."""

    pose_route: VehiclePose
    info: FilterInfo
    health: Health
    frame_left_m: Float[Array, "..."]
    autopilot: AutopilotInfo


def start_loop(
    spec: LoopSpec,
    setup: LoopSetup,
    planner: PlannerState,
    pose: VehiclePose,
    believed: VehiclePose,
    speed_mps: Float[Array, ""],
    along_m: Float[Array, ""],
    key: PRNGKeyArray,
) -> LoopState:
    """A vehicle that its driver drives along the route until navigation is sound, one lane.

    Args:
        spec, setup: of the lane.
        planner: from ``acquire``.
        pose: true, of the rear axle.
        believed: what the fusion starts from.
        speed_mps: true and believed.
        along_m: place on the terrain.
        key: of the sensors' errors.
    """
    zero = jnp.zeros_like(pose.x_m)
    both = [init_filter(setup.model, believed, speed_mps)] * (2 if spec.reckons else 1)
    filters: FilterState = jax.tree.map(lambda *leaves: jnp.stack(leaves), *both)
    local = VehiclePose(zero, zero, zero)
    return LoopState(
        init_plant(pose, speed_mps, along_m, delay_slots=spec.delay_slots),
        init_live_sensors(setup.sensors, key),
        filters,
        init_switch(believed),
        local,
        anchor_frame(believed, local),
        init_health(),
        init_autopilot(planner, speed_mps, zero),
        Command(zero, zero, zero),
        jnp.ones_like(zero),
        jnp.asarray(False),
        zero,
        jnp.asarray(False),
        jnp.int32(0),
    )


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
    strength: Float[Array, ""],
) -> tuple[LoopState, Decision]:
    """The half that runs on board.

    Args:
        spec, setup, route: of the lane.
        state: after ``move``.
        readings: of this tick.
        lgpr: this tick's fix, if there is one.
        strength: of its match; NaN where no scan was matched.
    """
    step_s = jnp.float32(spec.tick_s)
    motion = Motion(readings.yaw_rate_radps, step_s)
    observations = observe(setup, readings, lgpr)
    # One program for both filters: only whether the fix is there differs.
    told = jnp.asarray([True, False] if spec.reckons else [True])

    def filtered(held: FilterState, fix: Bool[Array, ""]) -> tuple[FilterState, FilterInfo]:
        known = observations._replace(lgpr=observations.lgpr._replace(valid=observations.lgpr.valid & fix))
        return step_filter(setup.model, setup.gates, held, motion, known)

    filters, infos = jax.vmap(filtered)(state.filters, told)
    info: FilterInfo = jax.tree.map(lambda leaf: leaf[0], infos)
    state = state._replace(filters=filters)
    fused, reckoned = state.fused, state.reckoned
    speed = fused.estimate.mean[3]
    rate = readings.yaw_rate_radps - fused.estimate.mean[4]
    switch = step_switch(setup.switch, state.switch, motion, speed, pose_of(reckoned.estimate), lgpr, strength)
    pose_map = pose_of(fused.estimate) if spec.fusion == "filter" else switch.pose
    local = step_local(state.local, speed, rate, setup.model.zero_slip_m, step_s)
    frame, left_m = slew_frame(state.frame, anchor_frame(pose_map, local), local, setup.slew, step_s)
    health, judged = step_health(setup.health, state.health, fused, info, observations, strength, left_m, step_s)
    sound_s = jnp.where(judged.reaction == Reaction.CONTINUE, state.sound_s + step_s, 0.0)
    engaged = state.engaged | (sound_s > setup.settled_s)
    true = state.plant.pose
    pose_route = VehiclePose(
        *(jnp.where(engaged, ours, his) for ours, his in zip(to_global(frame, local), true, strict=True))
    )
    stopping = state.stopping | (engaged & (judged.reaction == Reaction.STOP))
    inputs = AutopilotInputs(
        pose_route,
        speed,
        jnp.where(stopping, Reaction.STOP.value, jnp.where(engaged, judged.reaction, 0)).astype(jnp.int32),
        jnp.where(engaged, judged.speed_cap_mps, jnp.inf).astype(jnp.float32),
        jnp.float32(0.0),
        jnp.asarray(True),
        jnp.asarray(True),
        setup.set_speed_mps,
        # Measured by the potentiometer, whose errors are small beside the servo's play.
        state.plant.servo.wheel_rad,
    )
    autopilot, command, why = step_autopilot(setup.autopilot, route, state.autopilot, inputs, step_s)
    state = state._replace(
        switch=switch,
        local=local,
        frame=frame,
        health=health,
        autopilot=autopilot,
        command=command,
        gear=why.plan.gear,
        engaged=engaged,
        sound_s=sound_s,
        stopping=stopping,
    )
    return state, Decision(pose_route, info, judged, left_m, why)


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
