"""A closed loop made ready: a made-up vehicle, its sensors, and the settings that run on board."""

from dataclasses import dataclass, field, replace
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int, Key, PRNGKeyArray

from lgprjax.autopilot import (
    AutopilotConfig,
    AutopilotInfo,
    AutopilotState,
    Command,
    OnboardState,
    init_autopilot,
    onboard_setup,
)
from lgprjax.navigation import (
    Fusion,
    Navigated,
    NavigatorSetup,
    PlanCode,
    PlannerState,
    RoutePath,
    RouteSpeeds,
    RouteTrack,
    acquire,
    default_model,
    find_starts,
    init_navigator,
    legs_of_track,
    make_route_path,
)
from lgprjax.scene import (
    FixErrors,
    FixErrorState,
    LiveSensors,
    LiveSensorState,
    Plant,
    PlantState,
    SensorFaults,
    Terrain,
    TrueVehicle,
    init_fix_errors,
    init_live_sensors,
    init_plant,
    live_sensors,
    no_faults,
)
from lgprjax.scene.plant import SUBSTEPS
from lgprjax.scene.road import follow_centre
from lgprjax.scene.vehicle_drive import chassis_of, pedals_of, servo_of
from lgprjax.simulation.handover import Handover, init_handover
from lgprjax.simulation.loop.off_road import Bare
from lgprjax.vehicle import Chassis, LookAhead, VehiclePose

# Parts and state of a closed loop: spec, setup, state, decision.

TICK_S = 1.0 / 21.0
"""Tick of the loop: six scans of a 126 Hz radar, or two if it records every third."""


@dataclass(frozen=True)
class LoopSpec:
    """Static settings, the same for all batch elements.

    Attributes:
        tick_s: tick of the loop.
        fusion: pose source for control: the error-state filter, or LL's threshold switch.
        delay_slots: substeps of the servo's longest delay.
        reckons: whether a second filter runs without LGPR: the GNSS/INS pose from which a search starts, and the
            fallback of the switch.
    """

    tick_s: float = TICK_S
    fusion: Fusion = "filter"
    delay_slots: int = 5
    reckons: bool = True

    def __post_init__(self) -> None:
        if self.fusion == "switch" and not self.reckons:
            raise ValueError("the threshold switch falls back on GNSS/INS: a loop that drives by it must reckon")


class ReportedNoise(NamedTuple):
    """Variances per tick that the fusion assumes.

    The filter has no state for slow heading errors: they count as additional white noise.

    Attributes:
        gnss_m2: variance of a position, per axis.
        heading_rad2: variance of an INS heading.
        odometer_m2ps2: variance of the odometer's speed.
        lgpr_yaw_rad2: variance added to a fix's reported heading variance.
    """

    gnss_m2: Float[Array, "..."]
    heading_rad2: Float[Array, "..."]
    odometer_m2ps2: Float[Array, "..."]
    lgpr_yaw_rad2: Float[Array, "..."]


class LoopSetup(NamedTuple):
    """World and vehicle of a batch element, and its onboard setup.

    Attributes:
        plant, terrain, sensors, faults: plant, terrain, sensors and faults of the world.
        navigator, autopilot: settings of navigator and autopilot.
        noise: variances of the observations.
        set_speed_mps: speed locked by the operator.
        settled_s: time of sound health before the driver engages the autopilot.
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
    """State of a batch element from tick to tick.

    Attributes:
        plant, sensors: states of plant and sensors.
        onboard: state of the onboard step.
        driver: state of the driver before engagement: the same laws with the true pose.
        command: command for the next tick.
        gear: +1 or -1.
        sound_s: time of sound health; the driver engages after ``LoopSetup.settled_s``.
        handover: state of the handover to the computer.
        tick: number of ticks passed.
    """

    plant: PlantState
    sensors: LiveSensorState
    onboard: OnboardState
    driver: AutopilotState
    command: Command
    gear: Float[Array, "..."]
    sound_s: Float[Array, "..."]
    handover: Handover
    tick: Int[Array, "..."]


class Decision(NamedTuple):
    """Decision of a tick, with reasons.

    Attributes:
        engaged: whether the computer's command drives.
        pose_route: pose used for control: navigation's, or before engaging the true pose seen by the driver.
        navigated: result of navigation.
        autopilot: details of the autopilot's, or the driver's, step.
    """

    engaged: Bool[Array, "..."]
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
    """Initial state: the driver drives along the route until navigation is sound. One batch element.

    Args:
        spec, setup: settings and setup of the drive.
        planner: planner state from ``acquire``.
        pose: true pose of the rear axle.
        believed: initial pose of the fusion.
        speed_mps: true and estimated speed.
        along_m: position along the terrain.
        key: random key of the sensors' errors.
    """
    zero = jnp.zeros_like(pose.x_m)
    autopilot = init_autopilot(planner, speed_mps, zero)
    navigator = init_navigator(setup.navigator, believed, speed_mps, reckons=spec.reckons)
    return LoopState(
        plant=init_plant(pose, speed_mps, along_m, delay_slots=spec.delay_slots),
        sensors=init_live_sensors(setup.sensors, key),
        onboard=OnboardState(navigator, autopilot),
        driver=autopilot,
        command=Command(zero, zero, zero),
        gear=jnp.ones_like(zero),
        sound_s=zero,
        handover=init_handover(),
        tick=jnp.int32(0),
    )


_K_ERROR = -0.0008
_SPEED_ERROR_MPS = -0.07
"""Calibration errors of k and V_CHAR, estimated minus true, as in tuning/README.md."""

_FIX_SLOW_M, _FIX_SLOW_RAD, _FIX_CHANGES_M = 0.02, 0.004, 4.0
"""Common error of neighbouring fixes, and its correlation length."""
_LABEL_RAD, _LABEL_CHANGES_M = 0.00175, 90.0
"""Error of the map's own headings, and its correlation length: of a survey at 0.1° and 10 mph."""


@dataclass(frozen=True)
class LoopVehicle:
    """Vehicle and sensors of a closed loop, with invented numbers.

    Attributes:
        vehicle: true vehicle.
        anchor_m: distance ahead of the rear axle of the array's centre, which follows the route.
        set_speed_mps: speed locked by the operator.
        gnss_slow_m: standard deviation per axis of the slow GNSS error in the map's frame: 3 cm for RTK on one base.
        risk: largest accepted probability of a false match.
    """

    vehicle: TrueVehicle = field(default_factory=TrueVehicle)
    anchor_m: float = 6.2
    set_speed_mps: float = 4.4704
    gnss_slow_m: float = 0.3
    risk: float = 1e-4


def loop_setup(spec: LoopSpec, made_of: LoopVehicle, terrain: Terrain) -> LoopSetup:
    """Setup of a vehicle with a good, imperfect calibration.

    Raises:
        ValueError: the servo's delay is longer than the loop's slots.
    """
    true = made_of.vehicle
    longest_s = spec.delay_slots * spec.tick_s / SUBSTEPS
    if true.delay_s > longest_s * (1 + 1e-6):
        raise ValueError(
            f"delay_s is at most {longest_s:.4g} with {spec.delay_slots} delay_slots, not {true.delay_s:g}"
        )
    ratio = true.rear
    believed = replace(
        true,
        rear=ratio + _K_ERROR if isinstance(ratio, float) else ratio,
        characteristic_speed_mps=true.characteristic_speed_mps + _SPEED_ERROR_MPS,
    )
    chassis = chassis_of(true, made_of.anchor_m)
    share = believed.rear if isinstance(believed.rear, float) else 0.0
    zero_slip_m = true.wheelbase_m * share / (1.0 + share)
    sensors = live_sensors(tick_s=spec.tick_s, gnss_x_m=1.0, gnss_slow_m=made_of.gnss_slow_m)
    model = default_model(
        zero_slip_m=zero_slip_m, gnss_x_m=1.0, gnss_y_m=0.0, array_x_m=made_of.anchor_m, array_y_m=0.0
    )._replace(
        gnss_error_sigma_m=sensors.gnss_slow_m,
        gnss_error_s=sensors.gnss_slow_s,
        # Ground that leans lets the vehicle crab for seconds, ruts turn it about another point than its wheels do.
        side_noise=jnp.float32(0.05),
        lgpr_error_sigma_m=jnp.float32(_FIX_SLOW_M),
        lgpr_error_m=jnp.float32(_FIX_CHANGES_M),
        # Measured on the vehicle with a tape and a clock; at one speed the two cannot be distinguished from an offset.
        initial_lever_m=jnp.float32(0.02),
        initial_clock_s=jnp.float32(0.005),
    )
    # A heading error that lasts for a minute is modelled as this much more noise per tick.
    slow = 2.0 * sensors.heading_slow_s / spec.tick_s
    shared_rad2_m = _FIX_CHANGES_M * _FIX_SLOW_RAD**2 + _LABEL_CHANGES_M * _LABEL_RAD**2
    noise = ReportedNoise(
        sensors.gnss_sigma_m**2,
        sensors.heading_sigma_rad**2 + slow * sensors.heading_slow_rad**2,
        sensors.odometer_mps**2,
        jnp.float32(2.0 * shared_rad2_m / (made_of.set_speed_mps * spec.tick_s)),
    )
    onboard = onboard_setup(
        model=model,
        chassis=chassis_of(believed, made_of.anchor_m),
        pedals=pedals_of(true),
        # As the look-ahead study finds it for this vehicle.
        look_ahead=LookAhead(*(jnp.float32(value) for value in (1.18, 2.04, 2.76, 4.44))),
        front_rate_radps=jnp.float32(true.rate_radps),
        tick_s=spec.tick_s,
        gnss_period_s=sensors.gnss_ticks.item() * spec.tick_s,
        risk=made_of.risk,
        slack_rad=true.dead_band_rad + 0.5 * true.backlash_rad,
    )
    return LoopSetup(
        plant=Plant(chassis, servo_of(true), pedals_of(true), jnp.float32(true.nominal_v)),
        terrain=terrain,
        sensors=sensors,
        faults=no_faults(),
        navigator=onboard.navigator,
        noise=noise,
        autopilot=onboard.autopilot,
        set_speed_mps=jnp.float32(made_of.set_speed_mps),
        settled_s=jnp.float32(1.0),
    )


# Many drives of one course made ready: its centreline as the route, each drive with its own errors from the start.

_POINTS_M = 0.2
_STARTS_AT_M = 8.0
_START_MPS = 3.0
_BELIEVED_OFF = (0.3, 0.3, 0.01)


def route_of_road(course: Bare, chassis: Chassis, cruise_mps: float) -> RoutePath:
    """The centreline of a course's road as a route."""
    centre = follow_centre(course.road, np.arange(0.0, course.spec.length_m + 30.0, _POINTS_M))
    points = np.stack([centre.east_m, centre.north_m], axis=1)
    legs, gear = legs_of_track(RouteTrack("road", points, centre.yaw_rad))
    return make_route_path(legs, gear, chassis, RouteSpeeds(cruise_mps))


def start_lanes(
    spec: LoopSpec, setup: LoopSetup, course: Bare, route: RoutePath, errors: FixErrors, keys: Key[Array, " drive"]
) -> tuple[LoopState, FixErrorState]:
    """Initial states, one per key: anchor at the route's start, each fusion with initial errors of decimetres."""
    at = follow_centre(course.road, np.array([_STARTS_AT_M]))
    east, north, yaw = (float(part[0]) for part in (at.east_m, at.north_m, at.yaw_rad))
    lead = float(setup.plant.chassis.anchor_m)
    pose = VehiclePose(*(jnp.float32(v) for v in (east - lead * np.cos(yaw), north - lead * np.sin(yaw), yaw)))
    planner, code = acquire(find_starts(route, setup.autopilot.planner, setup.autopilot.chassis, pose))
    if int(code) != PlanCode.FOLLOWING:
        raise ValueError(f"the vehicles do not find their start: {PlanCode(int(code)).name}")
    along_m = jnp.float32(_STARTS_AT_M - lead)

    def one(key: PRNGKeyArray) -> tuple[LoopState, FixErrorState]:
        off_key, sensor_key, fix_key = jax.random.split(key, 3)
        off: Float[Array, 3] = jnp.asarray(_BELIEVED_OFF, jnp.float32) * jax.random.normal(off_key, (3,))
        believed = VehiclePose(pose.x_m + off[0], pose.y_m + off[1], pose.yaw_rad + off[2])
        state = start_loop(spec, setup, planner, pose, believed, jnp.float32(_START_MPS), along_m, sensor_key)
        return state, init_fix_errors(errors, fix_key)

    begun: tuple[LoopState, FixErrorState] = jax.jit(jax.vmap(one))(keys)
    return begun


# How well a course was driven: the anchor's true track against the baseline anchor's true track, interpolated.
#
# Both tracks are the truth of the scene: what the map's labels or the fusion are wrong by is in the figure, as it is
# in the vehicle's track. The distance is to the baseline's line, not to its nearest point, which would overstate it.

FOOT_M = 0.3048
_BACK, _ON = 60, 240
"""Points of the baseline searched behind and ahead of the last nearest one."""


class TrackingError(NamedTuple):
    """Figures of one drive.

    Attributes:
        rms_m: root mean square over the way driven.
        largest_m: anywhere.
        within_foot: share of the way with less than a foot.
        way_m: driven.
    """

    rms_m: float
    largest_m: float
    within_foot: float
    way_m: float


def cross_track_m(
    track_m: Float[np.ndarray, "tick 2"], baseline_m: Float[np.ndarray, "point 2"]
) -> Float[np.ndarray, " tick"]:
    """Distance of every position of a track from the line through a baseline, left positive; float64.

    The search continues from the last nearest piece, so that a baseline that crosses itself is followed.

    Args:
        track_m: positions in driving order, beginning near the baseline's start.
        baseline_m: positions in driving order, at most a few decimetres apart.
    """
    pieces = np.diff(baseline_m, axis=0)
    square = np.maximum(np.sum(pieces**2, axis=1), 1e-12)
    out = np.empty(len(track_m))
    at = 0
    for number, place in enumerate(track_m):
        low, high = max(at - _BACK, 0), min(at + _ON, len(pieces))
        from_start = place - baseline_m[low:high]
        share = np.clip(np.sum(from_start * pieces[low:high], axis=1) / square[low:high], 0.0, 1.0)
        gap = from_start - share[:, None] * pieces[low:high]
        nearest = int(np.argmin(np.sum(gap**2, axis=1)))
        at = low + nearest
        side = pieces[at, 0] * gap[nearest, 1] - pieces[at, 1] * gap[nearest, 0]
        out[number] = np.copysign(np.hypot(*gap[nearest]), side)
    return out


def tracking_error(
    track_m: Float[np.ndarray, "tick 2"],
    baseline_m: Float[np.ndarray, "point 2"],
    counts: Bool[np.ndarray, " tick"],
) -> TrackingError:
    """Figures of a track relative to a baseline, each position weighted by the distance to the next.

    Args:
        track_m, baseline_m: positions as for ``cross_track_m``.
        counts: mask of positions that count.
    """
    cross = cross_track_m(track_m, baseline_m)[counts]
    way = np.append(np.hypot(*np.diff(track_m, axis=0).T), 0.0)[counts]
    total = max(float(way.sum()), 1e-9)
    return TrackingError(
        float(np.sqrt(np.sum(cross**2 * way) / total)),
        float(np.abs(cross).max()),
        float(np.sum(way[np.abs(cross) < FOOT_M]) / total),
        total,
    )
