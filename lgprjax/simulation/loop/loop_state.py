"""What a closed loop is made of and what it carries: spec, setup, state, decision."""

from dataclasses import dataclass
from typing import Literal, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int, PRNGKeyArray

from lgprjax.autopilot import (
    AutopilotConfig,
    AutopilotInfo,
    AutopilotState,
    Command,
    init_autopilot,
)
from lgprjax.navigation import (
    FilterInfo,
    FilterModel,
    FilterState,
    FrameOffset,
    GateRules,
    Health,
    HealthRules,
    HealthState,
    PlannerState,
    SlewLimits,
    SwitchSettings,
    SwitchState,
    anchor_frame,
    init_filter,
    init_health,
    init_switch,
)
from lgprjax.scene import (
    LiveSensors,
    LiveSensorState,
    Plant,
    PlantState,
    SensorFaults,
    Terrain,
    init_live_sensors,
    init_plant,
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

    def __post_init__(self) -> None:
        if self.fusion == "switch" and not self.reckons:
            raise ValueError("the threshold switch falls back on GNSS/INS: a loop that drives by it must reckon")


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
    """World and vehicle of a lane, and what runs on board.

    Attributes:
        plant, terrain, sensors, faults: the world's.
        model, gates, noise: of the filters; switch: of LL's fusion.
        health, slew, autopilot: settings of the parts.
        set_speed_mps: that the operator locked.
        settled_s: how long health must have been without a complaint before the driver engages the autopilot.
    """

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
