"""The vehicles of closed loops: actuators and chassis under commands, on ground that slopes and pushes."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int, PRNGKeyArray

from lgprjax.scene.road import Waves
from lgprjax.vehicle.actuators import (
    DriveState,
    Pedals,
    Servo,
    ServoState,
    init_drive,
    init_servo,
    step_drive,
    step_servo,
    torque_share,
)
from lgprjax.vehicle.kinematics import (
    Chassis,
    VehiclePose,
    WheelSpeeds,
    body_rates,
    drive_arc,
    drive_skid_arc,
    turn_of,
    yaw_gain,
)
from lgprjax.vehicle.pursuit import obeyed_wheels

GRAVITY_MPS2 = 9.81
SUBSTEPS = 3
"""Steps of the vehicle within one of the control loop."""
CORNERING_MPS2_PER_RAD = 80.0
"""Side force of all tyres over mass and slip angle, of the order of a truck's: a lean of the ground makes it crab."""


class Plant(NamedTuple):
    """The true vehicle. Fields are scalars or one value per batch element."""

    chassis: Chassis
    servo: Servo
    pedals: Pedals
    supply_v: Float[Array, "..."]


class Terrain(NamedTuple):
    """Effects of the ground on a vehicle, as functions of the distance.

    Attributes:
        grade: rise over run.
        bank: radians, positive where the left side is the higher one.
        ruts: curvature, 1/m, that the ground adds to the vehicle's own, to the left.
        direction: +1 along it, -1 against: uphill is then downhill, left is right.
    """

    grade: Waves
    bank: Waves
    ruts: Waves
    direction: Float[Array, "..."]


class PlantState(NamedTuple):
    """State of the vehicle and pending commands.

    Attributes:
        pose: true pose of the rear axle.
        servo, drive: states of steering servo and pedals.
        travel_m: signed distance travelled.
        along_m: position along the terrain.
        yaw_rate_radps, speed_mps: signed means over the last step.
    """

    pose: VehiclePose
    servo: ServoState
    drive: DriveState
    travel_m: Float[Array, "..."]
    along_m: Float[Array, "..."]
    yaw_rate_radps: Float[Array, "..."]
    speed_mps: Float[Array, "..."]


def init_plant(
    pose: VehiclePose, speed_mps: Float[Array, "..."], along_m: Float[Array, "..."], *, delay_slots: int
) -> PlantState:
    """Initial state at a pose and a speed, wheels straight. ``delay_slots``: substeps of the servo's longest delay."""
    zero = jnp.zeros_like(pose.x_m)
    drive = init_drive(speed_mps)
    return PlantState(
        pose=pose,
        servo=init_servo(zero, delay_slots=delay_slots),
        drive=drive,
        travel_m=zero,
        along_m=along_m,
        yaw_rate_radps=zero,
        speed_mps=speed_mps,
    )


def step_plant(
    plant: Plant,
    terrain: Terrain,
    state: PlantState,
    front_rad: Float[Array, "..."],
    throttle: Float[Array, "..."],
    brake: Float[Array, "..."],
    gear: Float[Array, "..."],
    step_s: float,
) -> PlantState:
    """The vehicle after ``step_s`` of constant commands, in ``SUBSTEPS`` arcs.

    Args:
        plant: vehicle.
        terrain: terrain under the vehicle.
        state: state before the step.
        front_rad, throttle, brake: commands.
        gear: +1 forward, -1 reverse.
        step_s: step of the control loop.
    """
    small_s = step_s / SUBSTEPS
    share = torque_share(plant.servo, plant.supply_v)
    before = state
    for _ in range(SUBSTEPS):
        servo = step_servo(state.servo, plant.servo, front_rad, share, small_s)
        grade, bank, rut = (terrain.direction * wave_at(waves, state.along_m) for waves in terrain[:3])
        slope = GRAVITY_MPS2 * gear * grade
        resisted = plant.pedals._replace(rolling_mps2=plant.pedals.rolling_mps2 + slope)
        drive, way = step_drive(state.drive, resisted, throttle, brake, small_s)
        signed = gear * way
        turn = turn_of(plant.chassis, servo.wheel_rad)
        gain = yaw_gain(plant.chassis.characteristic_speed_mps, drive.speed_mps)
        pose = drive_arc(state.pose, signed, turn, gain)
        # The ground turns the vehicle about its rear axle and, leaning, lets it slide downhill.
        pushed = rut * signed
        slide = -bank * (GRAVITY_MPS2 / CORNERING_MPS2_PER_RAD) * jnp.abs(signed)
        cos, sin = jnp.cos(pose.yaw_rad), jnp.sin(pose.yaw_rad)
        pose = VehiclePose(pose.x_m - sin * slide, pose.y_m + cos * slide, pose.yaw_rad + pushed)
        along_m = state.along_m + terrain.direction * signed
        state = state._replace(pose=pose, servo=servo, drive=drive, travel_m=state.travel_m + signed, along_m=along_m)
    return state._replace(
        yaw_rate_radps=(state.pose.yaw_rad - before.pose.yaw_rad) / step_s,
        speed_mps=(state.travel_m - before.travel_m) / step_s,
    )


def wave_at(waves: Waves, along_m: Float[Array, "..."]) -> Float[Array, "..."]:
    """``wave_value`` on the device, wave after wave; batches have any shape."""
    total = jnp.zeros_like(along_m)
    for number in range(len(waves.amplitude)):
        turns = along_m * waves.wave_rad_per_m[number] + waves.phase_rad[number]
        total += waves.amplitude[number] * jnp.sin(turns)
    return total


# The true skid-steer vehicle: delayed hydraulics, a control threshold, sides that slip, turns that slide.


class SkidPlant(NamedTuple):
    """A skid-steer vehicle. Fields are float32 scalars or one value per batch element.

    Attributes:
        track_m: effective track width on this ground.
        delay_s: dead time from a command to its first effect.
        lag_s: time constant of a side's speed after the delay.
        threshold_mps: difference of the commanded wheel speeds below which the vehicle does not turn; 0: none.
        slip_sigma, slip_m: standard deviation and correlation distance of each side's slip, the share by which the
            ground passes slower than the wheel: a Gauss-Markov process over the side's distance.
        slide_m: distance ahead of the track's midpoint of the point without sideways motion in a turn.
        wander: random walk of the heading by stones and ruts, rad/√m.
        along, aside: random walk of the position by stones and ruts, m/√m.
    """

    track_m: Float[Array, "..."]
    delay_s: Float[Array, "..."]
    lag_s: Float[Array, "..."]
    threshold_mps: Float[Array, "..."]
    slip_sigma: Float[Array, "..."]
    slip_m: Float[Array, "..."]
    slide_m: Float[Array, "..."]
    wander: Float[Array, "..."]
    along: Float[Array, "..."]
    aside: Float[Array, "..."]


class SkidPlantState(NamedTuple):
    """State of the vehicle and pending commands.

    Attributes:
        pose: true pose of the track's midpoint.
        wheels: actual wheel speeds.
        waiting: delayed commands, newest first; slots for the longest delay and one more.
        slip: slip of the left and the right side.
        left_m, right_m: distances turned by the wheels.
        speed_mps, yaw_rate_radps: means over the last step.
    """

    pose: VehiclePose
    wheels: WheelSpeeds
    waiting: Float[Array, "slot 2"]
    slip: Float[Array, "2"]
    left_m: Float[Array, ""]
    right_m: Float[Array, ""]
    speed_mps: Float[Array, ""]
    yaw_rate_radps: Float[Array, ""]


def default_skid_plant(*, track_m: float) -> SkidPlant:
    """A small tracked machine with a hydraulic drive; usual sizes, no maker's figures, no control threshold."""
    values = (track_m, 0.1, 0.2, 0.0, 0.015, 10.0, 0.05, 0.003, 0.0, 0.0)
    return SkidPlant(*(jnp.float32(value) for value in values))


def init_skid_plant(plant: SkidPlant, pose: VehiclePose, key: PRNGKeyArray, *, delay_slots: int) -> SkidPlantState:
    """Standing at a pose, slips drawn; one batch element. ``delay_slots``: steps of the longest delay."""
    zero = jnp.zeros_like(pose.x_m)
    slip = plant.slip_sigma * jax.random.normal(key, (2,))
    waiting = jnp.zeros((delay_slots + 1, 2), jnp.float32)
    return SkidPlantState(
        pose=pose,
        wheels=WheelSpeeds(zero, zero),
        waiting=waiting,
        slip=slip,
        left_m=zero,
        right_m=zero,
        speed_mps=zero,
        yaw_rate_radps=zero,
    )


def turn_wheels(
    plant: SkidPlant, state: SkidPlantState, command: WheelSpeeds, step_s: float
) -> tuple[Float[Array, "slot 2"], WheelSpeeds]:
    """Commands that wait, and the wheels as they turn after a step: delay, threshold and lag of the hydraulics."""
    waiting = jnp.concatenate([jnp.stack(command)[None], state.waiting[:-1]])
    late = jnp.clip(jnp.round(plant.delay_s / step_s).astype(jnp.int32), 0, waiting.shape[0] - 1)
    executed = obeyed_wheels(plant.threshold_mps, WheelSpeeds(waiting[late, 0], waiting[late, 1]))
    slow = plant.lag_s > 0.0
    share = jnp.where(slow, 1.0 - jnp.exp(-step_s / jnp.where(slow, plant.lag_s, 1.0)), 1.0)
    return waiting, WheelSpeeds(*(was + share * (now - was) for was, now in zip(state.wheels, executed, strict=True)))


def step_skid_plant(
    plant: SkidPlant, state: SkidPlantState, command: WheelSpeeds, key: PRNGKeyArray, step_s: float
) -> SkidPlantState:
    """The vehicle after ``step_s`` of a constant command; one batch element, more by ``vmap``.

    Args:
        plant: vehicle.
        state: state before the step.
        command: commanded wheel speeds.
        key: random key of this step's noise.
        step_s: step of the control loop.
    """
    noise = jax.random.normal(key, (5,))
    waiting, (left, right) = turn_wheels(plant, state, command, step_s)
    ways = jnp.abs(jnp.stack([left, right])) * step_s
    keep = jnp.exp(-ways / plant.slip_m)
    slip = keep * state.slip + plant.slip_sigma * jnp.sqrt(1.0 - keep * keep) * noise[:2]
    ground = WheelSpeeds(left * (1.0 - slip[0]), right * (1.0 - slip[1]))
    speed, yaw_rate = body_rates(plant.track_m, ground)
    pose = drive_skid_arc(state.pose, plant.track_m, ground, jnp.float32(step_s))
    # About a point ahead of the midpoint the midpoint itself swings out.
    root_m = jnp.sqrt(jnp.abs(speed) * step_s)
    pushed = plant.along * root_m * noise[3]
    slid = plant.aside * root_m * noise[4] - plant.slide_m * yaw_rate * step_s
    yaw, turned = pose.yaw_rad, plant.wander * root_m * noise[2]
    cos, sin = jnp.cos(yaw), jnp.sin(yaw)
    pose = VehiclePose(pose.x_m + cos * pushed - sin * slid, pose.y_m + sin * pushed + cos * slid, yaw + turned)
    return SkidPlantState(
        pose=pose,
        wheels=WheelSpeeds(left, right),
        waiting=waiting,
        slip=slip,
        left_m=state.left_m + left * step_s,
        right_m=state.right_m + right * step_s,
        speed_mps=speed,
        yaw_rate_radps=(pose.yaw_rad - state.pose.yaw_rad) / step_s,
    )


# Sensors of a skid-steer vehicle (MF section 2): wheels, an INS that measures turns, RTK GNSS at 1 Hz.


class SkidSensors(NamedTuple):
    """Sensor properties; float32 scalars, ticks int32.

    Attributes:
        gnss_ticks: ticks between fixes.
        late_ticks: ticks from a fix's measurement to its arrival, fewer than ``gnss_ticks``.
        gnss_x_m, gnss_y_m: antenna in the body, forward and left.
        gnss_sigma_m: white error of a fix, per axis.
        slow_sigma_m, slow_s: standard deviation per axis and time constant of the slow error, a Gauss-Markov process.
        reported_sigma_m: standard deviation that a fix reports, per axis.
        bias_m: constant error, east and north.
        drift_mps: error that grows from the start on, east and north.
        off_s, every_s: outage and period of outages: no fixes in the last ``off_s`` of every ``every_s``.
        ins_ticks: ticks between delta headings.
        ins_noise_rad: noise of a delta heading.
        ins_drift_radps: size of the INS drift, with a drawn sign.
        wheel_scale: standard deviation of the wheels' relative scale error, the same on both sides.
        wheel_noise_mps: white noise of a tick's reading.
    """

    gnss_ticks: Int[Array, "..."]
    late_ticks: Int[Array, "..."]
    gnss_x_m: Float[Array, "..."]
    gnss_y_m: Float[Array, "..."]
    gnss_sigma_m: Float[Array, "..."]
    slow_sigma_m: Float[Array, "..."]
    slow_s: Float[Array, "..."]
    reported_sigma_m: Float[Array, "..."]
    bias_m: Float[Array, "... 2"]
    drift_mps: Float[Array, "... 2"]
    off_s: Float[Array, "..."]
    every_s: Float[Array, "..."]
    ins_ticks: Int[Array, "..."]
    ins_noise_rad: Float[Array, "..."]
    ins_drift_radps: Float[Array, "..."]
    wheel_scale: Float[Array, "..."]
    wheel_noise_mps: Float[Array, "..."]


class SkidSensorState(NamedTuple):
    """Present sensor errors.

    Attributes:
        slow_m: slow error of GNSS, east and north.
        measured_m: fix that was measured and has not arrived.
        drift_radps: drift of the INS.
        commanded_rad: true heading at the last delta heading of the INS.
        scale: scale error of the wheels.
    """

    slow_m: Float[Array, "2"]
    measured_m: Float[Array, "2"]
    drift_radps: Float[Array, ""]
    commanded_rad: Float[Array, ""]
    scale: Float[Array, ""]


class SkidReadings(NamedTuple):
    """Sensor readings at the end of a tick.

    Attributes:
        left_mps, right_mps: mean wheel speeds over the tick.
        gnss_m, gnss_sigma_m, gnss_age_s: position of the antenna, east and north, its reported sigma, and its age.
        gnss_valid: whether there is a new fix.
        turn_rad, span_s: turn and time since the last delta heading of the INS.
        turn_valid: whether there is a new delta heading.
    """

    left_mps: Float[Array, "..."]
    right_mps: Float[Array, "..."]
    gnss_m: Float[Array, "... 2"]
    gnss_sigma_m: Float[Array, "..."]
    gnss_age_s: Float[Array, "..."]
    gnss_valid: Bool[Array, "..."]
    turn_rad: Float[Array, "..."]
    span_s: Float[Array, "..."]
    turn_valid: Bool[Array, "..."]


def default_skid_sensors(*, tick_s: float, gnss_x_m: float, gnss_y_m: float) -> SkidSensors:
    """RTK at 1 Hz and 2 cm, an INS at 10 Hz that drifts 1.8 µrad in 0.1 s (MF), wheels off by 2 %; no outages.

    Three fifths of the fix's variance are white, the rest stays for a minute; a fix is 0.1 s old when it comes.
    """
    one, nothing = jnp.float32, jnp.zeros(2, jnp.float32)
    return SkidSensors(
        gnss_ticks=jnp.int32(round(1.0 / tick_s)),
        late_ticks=jnp.int32(round(0.1 / tick_s)),
        gnss_x_m=one(gnss_x_m),
        gnss_y_m=one(gnss_y_m),
        gnss_sigma_m=one(0.02 * 0.6**0.5),
        slow_sigma_m=one(0.02 * 0.4**0.5),
        slow_s=one(60.0),
        reported_sigma_m=one(0.02),
        bias_m=nothing,
        drift_mps=nothing,
        off_s=one(0.0),
        every_s=one(90.0),
        ins_ticks=jnp.int32(round(0.1 / tick_s)),
        ins_noise_rad=one(3e-5),
        ins_drift_radps=one(1.8e-5),
        wheel_scale=one(0.02),
        wheel_noise_mps=one(0.005),
    )


def init_skid_sensors(model: SkidSensors, yaw_rad: Float[Array, ""], key: PRNGKeyArray) -> SkidSensorState:
    """Errors at the start; one batch element."""
    slow, drift, scale = jax.random.split(key, 3)
    return SkidSensorState(
        model.slow_sigma_m * jax.random.normal(slow, (2,)),
        jnp.zeros(2, jnp.float32),
        model.ins_drift_radps * jax.random.rademacher(drift, (), jnp.float32),
        yaw_rad,
        model.wheel_scale * jax.random.normal(scale),
    )


def read_skid_sensors(
    model: SkidSensors,
    state: SkidSensorState,
    plant: SkidPlantState,
    tick: Int[Array, ""],
    key: PRNGKeyArray,
    tick_s: float,
) -> tuple[SkidSensorState, SkidReadings]:
    """Readings at the end of a tick; one batch element, more by ``vmap``.

    Args:
        model, state: properties and state of the sensors.
        plant: true state at the tick's end.
        tick: number of this tick, from 1.
        key: random key of this tick's noise.
        tick_s: length of a tick.
    """
    noise = jax.random.normal(key, (7,))
    time_s = tick.astype(jnp.float32) * tick_s
    keep = jnp.exp(-tick_s / model.slow_s)
    slow = keep * state.slow_m + jnp.sqrt(1.0 - keep * keep) * model.slow_sigma_m * noise[:2]
    pose = plant.pose
    cos, sin = jnp.cos(pose.yaw_rad), jnp.sin(pose.yaw_rad)
    antenna = jnp.stack(
        [
            pose.x_m + cos * model.gnss_x_m - sin * model.gnss_y_m,
            pose.y_m + sin * model.gnss_x_m + cos * model.gnss_y_m,
        ]
    )
    wrong = slow + model.gnss_sigma_m * noise[2:4] + model.bias_m + model.drift_mps * time_s
    measured = jnp.where(tick % model.gnss_ticks == 0, antenna + wrong, state.measured_m)
    arrives = (tick % model.gnss_ticks == model.late_ticks % model.gnss_ticks) & (tick > model.late_ticks)
    hears = time_s % model.every_s < model.every_s - model.off_s
    speaks = tick % model.ins_ticks == 0
    span_s = model.ins_ticks.astype(jnp.float32) * tick_s
    turn = pose.yaw_rad - state.commanded_rad + state.drift_radps * span_s + model.ins_noise_rad * noise[4]
    left, right = (
        wheel * (1.0 + state.scale) + model.wheel_noise_mps * error
        for wheel, error in zip(plant.wheels, noise[5:], strict=True)
    )
    readings = SkidReadings(
        left_mps=left,
        right_mps=right,
        gnss_m=measured,
        gnss_sigma_m=model.reported_sigma_m,
        gnss_age_s=model.late_ticks.astype(jnp.float32) * tick_s,
        gnss_valid=arrives & hears,
        turn_rad=turn,
        span_s=span_s,
        turn_valid=speaks,
    )
    executed = jnp.where(speaks, pose.yaw_rad, state.commanded_rad)
    return SkidSensorState(slow, measured, state.drift_radps, executed, state.scale), readings
