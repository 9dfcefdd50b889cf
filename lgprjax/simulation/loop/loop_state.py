"""What a closed loop is made of and what it carries: spec, setup, state, decision."""

from dataclasses import dataclass
from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int, PRNGKeyArray

from lgprjax.autopilot import (
    AutopilotConfig,
    AutopilotInfo,
    AutopilotState,
    Command,
    init_autopilot,
)
from lgprjax.navigation import Fusion, Navigated, NavigatorSetup, NavigatorState, PlannerState, init_navigator
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
    fusion: Fusion = "filter"
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
        navigator, autopilot: settings of the parts; noise: of the observations.
        set_speed_mps: that the operator locked.
        settled_s: how long health must have been without a complaint before the driver engages the autopilot.
    """

    plant: Plant
    terrain: Terrain
    sensors: LiveSensors
    faults: SensorFaults
    navigator: NavigatorSetup
    noise: ReportedNoise
    autopilot: AutopilotConfig
    set_speed_mps: Float[Array, "..."]
    settled_s: Float[Array, "..."]


class LoopState(NamedTuple):
    """Everything that a lane carries from tick to tick.

    Attributes:
        plant, sensors: the world's.
        navigator, autopilot: as they stand.
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
    navigator: NavigatorState
    autopilot: AutopilotState
    command: Command
    gear: Float[Array, "..."]
    engaged: Bool[Array, "..."]
    sound_s: Float[Array, "..."]
    stopping: Bool[Array, "..."]
    tick: Int[Array, "..."]


class Decision(NamedTuple):
    """What a tick decided, and why.

    Attributes:
        pose_route: that was driven by: navigation's, or before engaging the driver's own eyes.
        navigated: what navigation gave.
        autopilot: what the autopilot found out.
    """

    pose_route: VehiclePose
    navigated: Navigated
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
    return LoopState(
        init_plant(pose, speed_mps, along_m, delay_slots=spec.delay_slots),
        init_live_sensors(setup.sensors, key),
        init_navigator(setup.navigator, believed, speed_mps, reckons=spec.reckons),
        init_autopilot(planner, speed_mps, zero),
        Command(zero, zero, zero),
        jnp.ones_like(zero),
        jnp.asarray(False),
        zero,
        jnp.asarray(False),
        jnp.int32(0),
    )
