"""Closed loop of a worked field: vehicle, sensors, and the onboard step; whole fields are one compiled program.

A driver drives the vehicle straight towards the route, and engages near its start once the heading is known and the
health is sound; the computer does the rest. A requested stop persists, as in the mode machine: that element stays
stopped.
"""

from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Bool, Float, Int, Key, PRNGKeyArray

from lgprjax.autopilot.fence import fence_of_ground
from lgprjax.autopilot.limiter import SkidCommand
from lgprjax.autopilot.skid_step import (
    Guidance,
    SkidInfo,
    SkidOrders,
    SkidSetup,
    SkidState,
    init_skid,
    skid_setup,
    step_skid,
)
from lgprjax.coverage.field import Field, Tool, field_of_polygon, outline_of
from lgprjax.coverage.ground import ground_of_plan
from lgprjax.coverage.guidance import (
    CarrotSettings,
    CoverRoute,
    RoutePoint,
    beside,
    lay_pattern,
    route_foot,
    route_point,
)
from lgprjax.coverage.pattern import plan_pattern
from lgprjax.coverage.swaths import PatternSettings
from lgprjax.navigation.health import Reaction
from lgprjax.navigation.observations import GNSS, GnssObservation
from lgprjax.navigation.skid_model import (
    DeltaHeading,
    SkidMotion,
    SkidObservations,
    default_skid_model,
    skid_pose,
    skid_pose_covariance,
)
from lgprjax.scene.other_laws import (
    LawState,
    OtherLaws,
    draw_other_laws,
    init_law_state,
    read_other_sensors,
    step_other_plant,
)
from lgprjax.scene.plant import (
    SkidPlant,
    SkidPlantState,
    SkidReadings,
    SkidSensors,
    SkidSensorState,
    default_skid_plant,
    default_skid_sensors,
    init_skid_plant,
    init_skid_sensors,
    read_skid_sensors,
    step_skid_plant,
)
from lgprjax.simulation.environment import EnvState, init_env, run_env
from lgprjax.simulation.handover import Handover, init_handover, step_handover
from lgprjax.vehicle.kinematics import SkidSteer, VehiclePose, WheelSpeeds, wheel_speeds

# A field to be worked in simulation: the world, what runs on board, the route and its fence.

TICK_S = 0.02
MOMENT_TICKS = 5
"""Rate of the recorded moments: ten per second."""
SPARE_M = 0.8
"""Spare room between the route's need beyond the perimeter and the fence."""
_TRACK_M = 1.1
_GNSS_X_M = 0.2


@dataclass(frozen=True)
class FieldLoopSpec:
    """Static settings, the same for all batch elements.

    Attributes:
        moments: number of moments of 0.1 s.
        guidance: guidance law.
        delay_slots: longest delay of the plant, ticks.
        run_up_m: distance before the route at which the driver starts, to drive straight until the heading is known.
    """

    moments: int
    guidance: Guidance = "carrot"
    delay_slots: int = 30
    run_up_m: float = 16.0


class FieldWorld(NamedTuple):
    """World, vehicle and onboard setup; every batch element draws its own track width, slips and sensor errors.

    Attributes:
        plant, sensors: plant and sensors of the world.
        track_sigma: relative standard deviation of the track width between batch elements.
        setup: setup of the onboard step.
        set_speed_mps: speed locked by the operator.
        largest_base_m: largest base error under the error laws of ``scene.other_laws``; ``None``: error laws of the
            filter.
    """

    plant: SkidPlant
    sensors: SkidSensors
    track_sigma: Float[Array, ""]
    setup: SkidSetup
    set_speed_mps: Float[Array, ""]
    largest_base_m: Float[Array, ""] | None = None


class FieldCourse(NamedTuple):
    """A field, the route over it and its fence."""

    field: Field
    route: CoverRoute
    fence: Float[Array, "side 2 2"]


def made_up_tool() -> Tool:
    """A flail of 1.2 m before the tracks."""
    return Tool(1.2, 0.3, 1.2, 0.0)


def made_up_field_world(*, set_speed_mps: float = 0.45, off_s: float = 0.0, every_s: float = 90.0) -> FieldWorld:
    """A simulated mini-flail with invented numbers.

    Args:
        set_speed_mps: speed locked by the operator (MF: 0.11 to 0.45 m/s).
        off_s, every_s: outage and period of GNSS outages: no fixes in the last ``off_s`` of every ``every_s``.
    """
    one = jnp.float32
    sensors = default_skid_sensors(tick_s=TICK_S, gnss_x_m=_GNSS_X_M, gnss_y_m=0.0)
    vehicle = SkidSteer(one(_TRACK_M), one(0.9), one(0.8), one(1.5))
    model = default_skid_model(track_m=_TRACK_M, gnss_x_m=_GNSS_X_M, gnss_y_m=0.0)
    return FieldWorld(
        default_skid_plant(track_m=_TRACK_M)._replace(
            slide_m=one(0.08), wander=one(0.004), along=one(0.003), aside=one(0.005)
        ),
        sensors._replace(off_s=one(off_s), every_s=one(every_s)),
        one(0.12),
        skid_setup(vehicle, made_up_tool(), model, depth_m=0.15, deepest_m=0.3),
        one(set_speed_mps),
    )


def rectangle_course(
    length_m: float,
    width_m: float,
    settings: PatternSettings,
    tool: Tool,
) -> FieldCourse:
    """A rectangle with its south-west corner at the origin, lines along its length.

    Raises:
        InputError: the pattern does not fit.
    """
    corners = np.array([[0.0, 0.0], [length_m, 0.0], [length_m, width_m], [0.0, width_m]])
    field = field_of_polygon(corners, name="field")
    pattern = plan_pattern(field, settings, name="field")
    ground = ground_of_plan(pattern, None, outline_of(tool, track_m=_TRACK_M), spare_m=SPARE_M)
    return FieldCourse(field, lay_pattern(pattern), fence_of_ground(ground))


_BELIEVED_OFF_M = 0.3
_ENGAGE_M = 3.0
"""Largest distance before the route's start at which the driver engages, m; farther out is beyond the fence."""
_DRIVER = 0.3, 0.8, 0.1
"""The driver's steering by the true pose: yaw rate per metre aside and per radian turned, and its limit, rad/s."""


class FieldPlace(NamedTuple):
    """Vehicle and sensors of a batch element, as they are.

    Attributes:
        track_m: effective track width of the plant.
        plant, sensors: states of plant and sensors.
        laws: error laws that differ from the filter's, and their state; ``None``: error laws of the filter.
    """

    track_m: Float[Array, ""]
    plant: SkidPlantState
    sensors: SkidSensorState
    laws: tuple[OtherLaws, LawState] | None = None


class FieldOnboard(NamedTuple):
    """State of the onboard step, and of the handover to the computer."""

    skid: SkidState
    handover: Handover


FieldState = EnvState[FieldPlace, FieldOnboard, SkidCommand]
"""State of a batch element from tick to tick."""


class FieldMoment(NamedTuple):
    """Record of a moment, ten times per second.

    Attributes:
        x_m, y_m, yaw_rad: true pose of the reference point.
        believed: estimated pose of the reference point.
        covariance: covariance of the estimated x, y and yaw.
        cross_m: true lateral offset from the route, left positive.
        speed_mps: true speed.
        turn_mps: commanded speed difference of the wheels.
        tool: 1 if the tool is commanded on.
        line: line of the pattern, −1 in turns.
        to_go_m: distance to the route's end.
        heard: whether a GNSS fix arrived within the last 1.5 s.
        engaged, stopping, done: whether the computer drives, has a stop command, and has reached the route's end.
        edge: whether a crossing of the fence is predicted.
        reasons, limited: bits of ``Reason`` and of ``SkidLimited``.
        sigma_m: estimated standard deviation of the position.
        tool_m: error of the tool's mounting position, forward and left.
    """

    x_m: Float[Array, "..."]
    y_m: Float[Array, "..."]
    yaw_rad: Float[Array, "..."]
    believed: VehiclePose
    covariance: Float[Array, "... 3 3"]
    cross_m: Float[Array, "..."]
    speed_mps: Float[Array, "..."]
    turn_mps: Float[Array, "..."]
    tool: Float[Array, "..."]
    line: Int[Array, "..."]
    to_go_m: Float[Array, "..."]
    heard: Bool[Array, "..."]
    engaged: Bool[Array, "..."]
    stopping: Bool[Array, "..."]
    done: Bool[Array, "..."]
    edge: Bool[Array, "..."]
    reasons: Int[Array, "..."]
    limited: Int[Array, "..."]
    sigma_m: Float[Array, "..."]
    tool_m: Float[Array, "... 2"]


def run_fields(
    spec: FieldLoopSpec,
    world: FieldWorld,
    route: CoverRoute,
    fence: Float[Array, "side 2 2"],
    keys: Key[Array, " lane"],
) -> FieldMoment:
    """Drives of one field, one for each key; records have the axes moment and batch element.

    Args:
        spec: static settings.
        world, route, fence: world, route and fence of all batch elements.
        keys: random keys of the batch elements.

    Raises:
        ValueError: a fix would arrive when the next one is measured, or later.
    """
    late, period = int(world.sensors.late_ticks), int(world.sensors.gnss_ticks)
    if late >= period:
        raise ValueError(f"late_ticks is less than gnss_ticks, {period}, not {late}")
    kept: FieldMoment = _run_fields(spec, world, route, fence, keys)
    return kept


@partial(jax.jit, static_argnums=0)
def _run_fields(
    spec: FieldLoopSpec,
    world: FieldWorld,
    route: CoverRoute,
    fence: Float[Array, "side 2 2"],
    keys: Key[Array, " lane"],
) -> FieldMoment:
    states = jax.vmap(partial(_start, spec, world, route))(keys)

    env = FieldEnvironment(world, route, fence, spec.guidance)

    def moment(states: FieldState, number: Int[Array, ""]) -> tuple[FieldState, FieldMoment]:
        return jax.vmap(partial(_moment, env))(states, jax.vmap(lambda key: jax.random.fold_in(key, number))(keys))

    kept: FieldMoment = lax.scan(moment, states, jnp.arange(spec.moments))[1]
    return kept


def _start(spec: FieldLoopSpec, world: FieldWorld, route: CoverRoute, key: PRNGKeyArray) -> FieldState:
    """Initial state of one batch element: the vehicle is before the route's start, in the route's direction."""
    track_key, plant_key, sensor_key, place_key = jax.random.split(key, 4)
    begin = route_point(route, jnp.float32(-spec.run_up_m))
    track_m = world.plant.track_m * (1.0 + world.track_sigma * jnp.clip(jax.random.normal(track_key), -2.0, 2.0))
    pose = VehiclePose(begin.x_m, begin.y_m, begin.yaw_rad)
    off_m = _BELIEVED_OFF_M * jax.random.normal(place_key, (2,))
    skid = init_skid(world.setup, pose.x_m + off_m[0], pose.y_m + off_m[1])
    laws = None
    if world.largest_base_m is not None:
        laws = draw_other_laws(jax.random.fold_in(key, 1), largest_base_m=world.largest_base_m), init_law_state()
    place = FieldPlace(
        track_m,
        init_skid_plant(world.plant, pose, plant_key, delay_slots=spec.delay_slots),
        init_skid_sensors(world.sensors, pose.yaw_rad, sensor_key),
        laws,
    )
    begin = route_point(route, jnp.float32(0.0))
    return init_env(place, FieldOnboard(skid, init_handover()), _by_hand(world, begin, pose))


def _moment(env: "FieldEnvironment", state: FieldState, key: PRNGKeyArray) -> tuple[FieldState, FieldMoment]:
    state, infos = run_env(env, state, key, MOMENT_TICKS)
    info: SkidInfo = jax.tree.map(lambda leaf: leaf[-1], infos)
    return state, _kept(env.route, state, info)


class FieldEnvironment(NamedTuple):
    """A vehicle in a field, see ``Environment``: it drives by the computer, before by its driver."""

    world: FieldWorld
    route: CoverRoute
    fence: Float[Array, "side 2 2"]
    guidance: Guidance

    def move(
        self, place: FieldPlace, command: SkidCommand, tick: Int[Array, ""], key: PRNGKeyArray
    ) -> tuple[FieldPlace, SkidReadings]:
        """Plant and sensors a tick later."""
        plant_key, sensor_key = jax.random.split(key)
        world, laws = self.world, place.laws
        told = WheelSpeeds(command.left_mps, command.right_mps)
        held = world.plant._replace(track_m=place.track_m)
        if laws is None:
            plant = step_skid_plant(held, place.plant, told, plant_key, TICK_S)
            sensors, readings = read_skid_sensors(world.sensors, place.sensors, plant, tick, sensor_key, TICK_S)
        else:
            plant = step_other_plant(laws[0], held, place.plant, told, command.tool, plant_key, TICK_S)
            carried, sensors, readings = read_other_sensors(
                laws[0], laws[1], world.sensors, place.sensors, plant, tick, sensor_key, TICK_S
            )
            laws = laws[0], carried
        return FieldPlace(place.track_m, plant, sensors, laws), readings

    def decide(
        self, place: FieldPlace, onboard: FieldOnboard, readings: SkidReadings
    ) -> tuple[FieldOnboard, SkidCommand, SkidInfo]:
        """The onboard step; the driver engages, and drives until then, by the true pose."""
        begin, pose = route_point(self.route, jnp.float32(0.0)), place.plant.pose
        orders = SkidOrders(
            engaged=onboard.handover.engaged,
            drives=onboard.handover.engaged,
            stop=onboard.handover.stopping,
            speed_cap_mps=jnp.float32(jnp.inf),
            set_speed_mps=self.world.set_speed_mps,
            age_s=jnp.float32(0.0),
            left_mps=readings.left_mps,
            right_mps=readings.right_mps,
        )
        skid, command, info = step_skid(
            self.world.setup,
            self.route,
            self.fence,
            onboard.skid,
            *_observed(readings),
            orders,
            guidance=self.guidance,
        )
        apart_m = beside(begin, pose)[0]
        sound = info.filter.heading_known & (info.reaction != Reaction.STOP) & (apart_m >= -_ENGAGE_M)
        stop = (info.reaction == Reaction.STOP) | info.edge_predicted
        handover = step_handover(onboard.handover, sound=sound, stop=stop)
        by_hand = _by_hand(self.world, begin, pose)
        command = jax.tree.map(lambda ours, his: jnp.where(handover.engaged, ours, his), command, by_hand)
        return FieldOnboard(skid, handover), command, info


def _by_hand(world: FieldWorld, begin: RoutePoint, pose: VehiclePose) -> SkidCommand:
    """The driver's command while driving to the route's start: levers, tool off."""
    aside, turned, largest = _DRIVER
    _, left_m = beside(begin, pose)
    yaw_rate = -aside * left_m - turned * jnp.sin(pose.yaw_rad - begin.yaw_rad)
    wheels = wheel_speeds(world.plant.track_m, world.set_speed_mps, jnp.clip(yaw_rate, -largest, largest))
    return SkidCommand(*wheels, jnp.zeros_like(yaw_rate), world.setup.depth_m)


def _observed(readings: SkidReadings) -> tuple[SkidMotion, SkidObservations]:
    """Readings as the filter takes them."""
    variance = readings.gnss_sigma_m * readings.gnss_sigma_m
    gnss = GnssObservation(
        readings.gnss_m[0],
        readings.gnss_m[1],
        variance * jnp.eye(2, dtype=jnp.float32),
        readings.gnss_age_s,
        readings.gnss_valid,
    )
    turn = DeltaHeading(readings.turn_rad, readings.span_s, readings.turn_valid)
    return SkidMotion(readings.left_mps, readings.right_mps, jnp.float32(TICK_S)), SkidObservations(gnss, turn)


def _kept(route: CoverRoute, state: FieldState, info: SkidInfo) -> FieldMoment:
    (skid, handover), (_, plant, _, laws) = state.onboard, state.world
    estimate, true, sent = skid.filter.estimate, plant.pose, skid.limiter.last
    return FieldMoment(
        true.x_m,
        true.y_m,
        true.yaw_rad,
        skid_pose(estimate),
        skid_pose_covariance(estimate),
        route_foot(route, skid.carrot.arc_m, true).cross_m,
        plant.speed_mps,
        sent.right_mps - sent.left_mps,
        sent.tool,
        info.plan.line,
        info.plan.to_go_m,
        skid.filter.gates.since_offered_s[GNSS] < 1.5,
        *handover,
        info.plan.done,
        info.edge_predicted,
        info.reasons,
        info.limited,
        info.sigma_m,
        jnp.zeros(2, jnp.float32) if laws is None else laws[0].tool_m,
    )


# The vehicle of MF section 4: one that ignores small commands to turn, along one straight line, with three PIDs.

THRESHOLD_MPS = 0.3
"""Threshold of the wheels' speed difference, below which the vehicle does not turn: its least turn is 0.27 rad/s."""
_LATE_S = 0.4
_WHEEL_RATE_MPS2 = 2.0

PIDS = {
    "P 3, D 2": (1.2, 3.0, 0.0, 2.0),
    "P 4, D 2.5": (1.5, 4.0, 0.0, 2.5),
    "P 3, I 0.3, D 2": (1.2, 3.0, 0.3, 2.0),
}
"""Carrot's distance (m), P (1/m), I (1/m²) and D of three settings that track well where every command is obeyed."""


def threshold_world(pid: tuple[float, float, float, float], *, threshold_mps: float, believed_mps: float) -> FieldWorld:
    """A flail at 1 mph whose hydraulics have 0.4 s of dead time and as much lag.

    Args:
        pid: one of ``PIDS``.
        threshold_mps: control threshold of the vehicle; 0: none.
        believed_mps: threshold that the controller compensates; 0: none.
    """
    world, one = made_up_field_world(), jnp.float32
    carrot = CarrotSettings(*(one(value) for value in pid), *world.setup.carrot[len(pid) :])
    setup = world.setup._replace(
        carrot=carrot,
        limiter=world.setup.limiter._replace(wheel_rate_mps2=one(_WHEEL_RATE_MPS2)),
        threshold_mps=one(believed_mps),
    )
    plant = world.plant._replace(delay_s=one(_LATE_S), lag_s=one(_LATE_S), threshold_mps=one(threshold_mps))
    return world._replace(plant=plant, setup=setup)
