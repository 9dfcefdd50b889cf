"""A vehicle driven through a manoeuvre, with servo, play and pedals in the loop: the truth of it, and its log."""

from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int, PRNGKeyArray

from lgprjax.scene.motion import STEP_S, Manoeuvre
from lgprjax.scene.sensors import FixErrors, FixErrorState, Intervals, gauss_markov, init_fix_errors, step_fix_errors
from lgprjax.vehicle.actuators import (
    Pedal,
    Pedals,
    Servo,
    ideal_servo,
    init_drive,
    init_servo,
    step_drive,
    step_servo,
    torque_share,
)
from lgprjax.vehicle.kinematics import (
    Chassis,
    Linkage,
    MeasuredRear,
    ProportionalRear,
    VehiclePose,
    drive_arc,
    rear_angle,
    shaft_angle,
    straight_slope,
    turn_of,
    yaw_gain,
)
from lgprjax.vehicle.sensors import DriveSignals, Encoder, Potentiometer, read_encoder, read_potentiometer

# Signals of a vehicle's log: navigation, steering sensors and odometer, with their noise and faults.

DEGREE = np.pi / 180.0


class DriveTruth(NamedTuple):
    """True motion of a drive at the simulation's steps.

    Attributes:
        time_s: times from 0.
        east_m, north_m, yaw_rad: pose of the rear axle; the drive starts at the origin, along the x axis.
        travel_m, speed_mps: distance and speed along the body axis; negative speed in reverse.
        front_rad, rear_rad: wheel angles, counter-clockwise positive.
        motor_rad: steering angle at the encoder, before the play.
        steering_rad: steering angle at the potentiometer, behind it.
    """

    time_s: Float[np.ndarray, " step"]
    east_m: Float[np.ndarray, " step"]
    north_m: Float[np.ndarray, " step"]
    yaw_rad: Float[np.ndarray, " step"]
    travel_m: Float[np.ndarray, " step"]
    speed_mps: Float[np.ndarray, " step"]
    front_rad: Float[np.ndarray, " step"]
    rear_rad: Float[np.ndarray, " step"]
    motor_rad: Float[np.ndarray, " step"]
    steering_rad: Float[np.ndarray, " step"]


@dataclass(frozen=True)
class VehicleSensors:
    """Rates, noise and faults of the sensors. Sigmas are of white noise unless stated otherwise.

    Attributes:
        record_hz: rate of the log; the simulation's 100 Hz or a whole part of it.
        gnss_hz: rate of the fixes; records between have no position.
        position_sigma_m: white error of east and of north.
        position_wander_m, position_wander_s: sigma and time constant of a slow error of each (Gauss-Markov) against
            the true frame; navigation does not report it: its sigma is that of the white part.
        heading_sigma_rad, heading_wander_rad, heading_wander_s: white and slow errors of the INS heading, at every
            record.
        heading_bias_rad: misalignment of the INS.
        front_sigma_rad, rear_sigma_rad, potentiometer_sigma_v: white noise of the steering sensors.
        odometer_scale_error, odometer_sigma_m: distance reads (1 + scale) times the truth plus noise.
        yaw_rate_noise: white noise of the gyro, rad/s/√Hz.
        yaw_rate_bias_radps, yaw_rate_bias_walk: bias of the gyro at the start, and its random walk in rad/s/√s.
        fix_hz: rate of the radar's fixes, in drives with fixes; the simulation's 100 Hz or a whole part of it.
        outlier_share, outlier_m: share of fixes that are displaced, by a normal deviate of this sigma.
        spike_share, spike_v: share of potentiometer readings that are displaced, by a normal deviate of this sigma.
        gnss_gaps_s: (start, stop) intervals without fixes.
        record_gaps_s: (start, stop) intervals without any records.
    """

    record_hz: float = 50.0
    gnss_hz: float = 10.0
    position_sigma_m: float = 0.02
    position_wander_m: float = 0.0
    position_wander_s: float = 60.0
    heading_sigma_rad: float = 0.05 * DEGREE
    heading_wander_rad: float = 0.0
    heading_wander_s: float = 60.0
    heading_bias_rad: float = 0.0
    front_sigma_rad: float = 0.1 * DEGREE
    rear_sigma_rad: float = 0.1 * DEGREE
    potentiometer_sigma_v: float = 0.004
    odometer_scale_error: float = 0.005
    odometer_sigma_m: float = 0.002
    yaw_rate_noise: float = 5e-4
    yaw_rate_bias_radps: float = 0.0
    yaw_rate_bias_walk: float = 0.0
    fix_hz: float = 10.0
    outlier_share: float = 0.0
    outlier_m: float = 2.0
    spike_share: float = 0.0
    spike_v: float = 0.5
    gnss_gaps_s: Intervals = ()
    record_gaps_s: Intervals = ()


def read_sensors(
    truth: DriveTruth,
    manoeuvre: Manoeuvre,
    sensors: VehicleSensors,
    potentiometer: Potentiometer,
    encoder: Encoder,
    seed: int,
) -> DriveSignals:
    """The log of a drive. The encoder's zero is drawn: it is unknown at every start.

    Every effect draws from its own random stream, so switching one on does not change the others.

    Raises:
        ValueError: the record rate is no whole part of the simulation's, or fixes come faster than records.
    """
    record = _record_steps(truth, sensors)
    count = record.size
    time_s = truth.time_s[record]
    place = np.stack([truth.east_m[record], truth.north_m[record]], axis=1)
    place += _noise(seed, 1, (count, 2), sensors.position_sigma_m)
    place += _wander(seed, 2, (count, 2), sensors.position_wander_m, sensors.position_wander_s, sensors.record_hz)
    displaced = _stream(seed, 3).random(count) < sensors.outlier_share
    place += displaced[:, None] * _noise(seed, 4, (count, 2), sensors.outlier_m)
    place[~_fixed(time_s, sensors)] = np.nan
    yaw = truth.yaw_rad[record] + sensors.heading_bias_rad + _noise(seed, 5, (count,), sensors.heading_sigma_rad)
    yaw += _wander(seed, 6, (count, 1), sensors.heading_wander_rad, sensors.heading_wander_s, sensors.record_hz)[:, 0]
    volts = read_potentiometer(potentiometer, truth.steering_rad[record])
    volts = volts + _noise(seed, 7, (count,), sensors.potentiometer_sigma_v)
    volts += (_stream(seed, 8).random(count) < sensors.spike_share) * _noise(seed, 9, (count,), sensors.spike_v)
    zero_counts = float(_stream(seed, 10).integers(-100_000, 100_000)) + float(_stream(seed, 11).random())
    travel = (1.0 + sensors.odometer_scale_error) * truth.travel_m[record]
    heading_sigma = np.hypot(sensors.heading_sigma_rad, sensors.heading_wander_rad)
    log = DriveSignals(
        time_s=time_s,
        east_m=place[:, 0],
        north_m=place[:, 1],
        sigma_position_m=np.full(count, sensors.position_sigma_m),
        yaw_rad=yaw,
        sigma_yaw_rad=np.full(count, heading_sigma),
        travel_m=travel + _noise(seed, 12, (count,), sensors.odometer_sigma_m),
        command_rad=None if manoeuvre.by_hand else manoeuvre.wanted_rad[record],
        front_rad=truth.front_rad[record] + _noise(seed, 13, (count,), sensors.front_sigma_rad),
        rear_rad=truth.rear_rad[record] + _noise(seed, 14, (count,), sensors.rear_sigma_rad),
        potentiometer_v=volts,
        encoder_counts=read_encoder(encoder._replace(zero_counts=zero_counts), truth.motor_rad[record]),
        supply_v=manoeuvre.supply_v[record],
        throttle=None if manoeuvre.throttle is None else manoeuvre.throttle[record],
        brake=None if manoeuvre.brake is None else manoeuvre.brake[record],
    )
    kept = ~_within(time_s, sensors.record_gaps_s)
    lasting: DriveSignals = jax.tree.map(lambda signal: signal[kept], log)
    return lasting


def read_yaw_rate(truth: DriveTruth, sensors: VehicleSensors, seed: int) -> Float[np.ndarray, " record"]:
    """Yaw rate by gyro, rad/s counter-clockwise, at the records of ``read_sensors``.

    A record's noise is such that the sum over the records has the sensor's density.

    Raises:
        ValueError: as ``read_sensors``.
    """
    record = _record_steps(truth, sensors)
    walk = np.cumsum(_noise(seed, 15, (record.size,), sensors.yaw_rate_bias_walk / np.sqrt(sensors.record_hz)))
    rate = np.gradient(truth.yaw_rad, STEP_S)[record] + sensors.yaw_rate_bias_radps + walk
    rate += _noise(seed, 16, (record.size,), sensors.yaw_rate_noise * np.sqrt(sensors.record_hz))
    return np.asarray(rate[~_within(truth.time_s[record], sensors.record_gaps_s)])


def _record_steps(truth: DriveTruth, sensors: VehicleSensors) -> Int[np.ndarray, " record"]:
    every = _steps_between("record_hz", sensors.record_hz)
    if not 0.0 < sensors.gnss_hz <= sensors.record_hz:
        raise ValueError(f"gnss_hz is positive and at most record_hz, not {sensors.gnss_hz:g}")
    return np.arange(0, truth.time_s.size, every)


def _steps_between(name: str, rate_hz: float) -> int:
    every = round(1.0 / (STEP_S * rate_hz))
    if every < 1 or abs(every * STEP_S * rate_hz - 1.0) > 1e-9:
        raise ValueError(f"{name} is {1.0 / STEP_S:g} or a whole part of it, not {rate_hz:g}")
    return every


def _fixed(time_s: Float[np.ndarray, " record"], sensors: VehicleSensors) -> Bool[np.ndarray, " record"]:
    """Records with a fix: the first in each of its periods, but for the gaps."""
    period = np.floor(time_s * sensors.gnss_hz + 1e-6)
    return np.asarray((np.diff(period, prepend=-1.0) > 0) & ~_within(time_s, sensors.gnss_gaps_s))


def _within(time_s: Float[np.ndarray, " record"], intervals_s: Intervals) -> Bool[np.ndarray, " record"]:
    inside = np.zeros(time_s.size, bool)
    for start_s, stop_s in intervals_s:
        inside |= (time_s >= start_s) & (time_s < stop_s)
    return inside


def _stream(seed: int, effect: int) -> np.random.Generator:
    return np.random.default_rng([seed, 7, effect])


def _noise(seed: int, effect: int, shape: tuple[int, ...], sigma: float) -> Float[np.ndarray, "..."]:
    return sigma * _stream(seed, effect).normal(size=shape)


def _wander(
    seed: int, effect: int, shape: tuple[int, int], sigma: float, time_constant_s: float, rate_hz: float
) -> Float[np.ndarray, "record state"]:
    if sigma == 0.0:
        return np.zeros(shape)
    keep = float(np.exp(-1.0 / (rate_hz * time_constant_s)))
    return gauss_markov(_stream(seed, effect), np.full(shape[1], sigma), keep, shape[0])


@dataclass(frozen=True)
class TrueVehicle:
    """A true vehicle for simulated drives. The numbers are invented.

    Attributes:
        wheelbase_m, largest_angle_rad, characteristic_speed_mps: as in ``Chassis``.
        rear: rear ratio k, or a measured map of rear angles.
        linkage: linkage between the steering shaft, which potentiometer and encoder measure, and the front wheels;
            ``None``: proportional.
        lag_s, rate_radps, delay_s, dead_band_rad, backlash_rad, asymmetry, nominal_v, stall_v: as in ``Servo``.
        potentiometer_straight_v, potentiometer_per_rad_v: as in ``Potentiometer``.
        encoder_counts_per_rad: as in ``Encoder``.
        lock_to_lock_turns: turns of the steering wheel from lock to lock.
        throttle, brake: (pre-tension, dead zone, gain in m/s², lag in s), as in ``Pedal``.
        rolling_mps2, drag_per_s: as in ``Pedals``.
        array_x_m: centre of the radar's array ahead of the rear axle, on the centre line.
    """

    wheelbase_m: float = 3.8
    largest_angle_rad: float = 30.0 * DEGREE
    characteristic_speed_mps: float = 20.0
    rear: float | MeasuredRear = 0.63
    linkage: Linkage | None = None
    lag_s: float = 0.15
    rate_radps: float = 0.5
    delay_s: float = 0.06
    dead_band_rad: float = 0.2 * DEGREE
    backlash_rad: float = 0.3 * DEGREE
    asymmetry: float = 0.0
    nominal_v: float = 24.0
    stall_v: float = 10.0
    potentiometer_straight_v: float = 2.43
    potentiometer_per_rad_v: tuple[float, ...] = (2.0,)
    encoder_counts_per_rad: float = 12000.0
    lock_to_lock_turns: float = 5.0
    throttle: tuple[float, float, float, float] = (0.12, 0.05, 3.0, 0.6)
    brake: tuple[float, float, float, float] = (0.18, 0.06, 6.0, 0.25)
    rolling_mps2: float = 0.15
    drag_per_s: float = 0.03
    array_x_m: float = 6.2


class VehicleDrive(NamedTuple):
    """A simulated drive: contents of its log, and the truth."""

    signals: DriveSignals
    truth: DriveTruth


def chassis_of(vehicle: TrueVehicle, anchor_m: float = 0.0) -> Chassis:
    """The vehicle's chassis, with an anchor for path following."""
    rear = vehicle.rear if isinstance(vehicle.rear, MeasuredRear) else ProportionalRear(jnp.float32(vehicle.rear))
    return Chassis(
        jnp.float32(vehicle.wheelbase_m),
        jnp.float32(anchor_m),
        rear,
        jnp.float32(vehicle.largest_angle_rad),
        jnp.float32(vehicle.characteristic_speed_mps),
    )


def servo_of(vehicle: TrueVehicle) -> Servo:
    """The vehicle's servo."""
    names = Servo._fields
    return Servo(*(jnp.float32(getattr(vehicle, name)) for name in names))


def pedals_of(vehicle: TrueVehicle) -> Pedals:
    """The vehicle's pedals."""
    throttle, brake = (Pedal(*(jnp.float32(number) for number in pedal)) for pedal in (vehicle.throttle, vehicle.brake))
    return Pedals(throttle, brake, jnp.float32(vehicle.rolling_mps2), jnp.float32(vehicle.drag_per_s))


def simulate_vehicle_drive(
    vehicle: TrueVehicle, manoeuvre: Manoeuvre, sensors: VehicleSensors | None = None, seed: int = 0
) -> VehicleDrive:
    """Simulate and log a manoeuvre.

    Args:
        vehicle: true vehicle.
        manoeuvre: commands to the vehicle.
        sensors: rates, noise and faults of the sensors; ``None``: the usual ones.
        seed: seed of all noise, and of the encoder's unknown zero.
    """
    truth = drive_manoeuvre(vehicle, manoeuvre)
    return VehicleDrive(read_vehicle(vehicle, manoeuvre, truth, sensors or VehicleSensors(), seed), truth)


def drive_manoeuvre(vehicle: TrueVehicle, manoeuvre: Manoeuvre) -> DriveTruth:
    """Simulate the drive at 100 Hz, without randomness.

    Servo and pedals step in float32; each step's arc is the vehicle's, the sum of the arcs is taken in float64.
    """
    time_s = manoeuvre.time_s
    chassis = chassis_of(vehicle)
    wanted = np.clip(manoeuvre.wanted_rad, -vehicle.largest_angle_rad, vehicle.largest_angle_rad)
    motor, wheel = _run_servo(vehicle, manoeuvre, wanted)
    if manoeuvre.throttle is None:
        speed = manoeuvre.speed_mps
        step_m = np.append(0.0, 0.5 * (speed[1:] + speed[:-1]) * STEP_S)
    else:
        speed, step_m = _run_pedals(vehicle, manoeuvre)
    steps = _loop_length(wheel.size)
    front = _padded(wheel, steps)
    gain = yaw_gain(chassis.characteristic_speed_mps, _padded(np.abs(speed), steps))
    zero = jnp.zeros_like(front)
    arcs = drive_arc(VehiclePose(zero, zero, zero), _padded(step_m, steps), turn_of(chassis, front), gain)
    forward, left, turned = (np.asarray(part, np.float64)[: wheel.size] for part in arcs)
    yaw = np.cumsum(turned)
    before = yaw - turned
    east = np.cumsum(np.cos(before) * forward - np.sin(before) * left)
    north = np.cumsum(np.sin(before) * forward + np.cos(before) * left)
    rear = -np.asarray(rear_angle(chassis.rear, front)[0], np.float64)[: wheel.size]
    return DriveTruth(
        time_s=time_s,
        east_m=east,
        north_m=north,
        yaw_rad=yaw,
        travel_m=np.cumsum(step_m),
        speed_mps=speed,
        front_rad=wheel,
        rear_rad=rear,
        motor_rad=_steering_angle(vehicle, motor),
        steering_rad=_steering_angle(vehicle, wheel),
    )


def read_vehicle(
    vehicle: TrueVehicle, manoeuvre: Manoeuvre, truth: DriveTruth, sensors: VehicleSensors, seed: int
) -> DriveSignals:
    """The log of a drive once driven: another seed is another day's noise."""
    potentiometer = Potentiometer(
        vehicle.potentiometer_straight_v, vehicle.potentiometer_per_rad_v, 1.5 * vehicle.largest_angle_rad
    )
    return read_sensors(truth, manoeuvre, sensors, potentiometer, Encoder(vehicle.encoder_counts_per_rad, 0.0), seed)


def _steering_angle(vehicle: TrueVehicle, wheel_rad: Float[np.ndarray, " step"]) -> Float[np.ndarray, " step"]:
    """Steering angle, scaled to the wheels', at wheel angles."""
    if vehicle.linkage is None:
        return wheel_rad
    shaft = shaft_angle(vehicle.linkage, jnp.asarray(wheel_rad, jnp.float32))
    return np.asarray(shaft, np.float64) * float(straight_slope(vehicle.linkage))


def _padded(signal: Float[np.ndarray, " step"], steps: int) -> Float[Array, " steps"]:
    """A signal padded with its last value to the length of a compiled loop."""
    return jnp.asarray(np.pad(signal, (0, steps - signal.size), mode="edge"), jnp.float32)


def _loop_length(steps: int) -> int:
    """The next power of two: few lengths are compiled."""
    return max(4096, 1 << (steps - 1).bit_length())


def _run_servo(
    vehicle: TrueVehicle, manoeuvre: Manoeuvre, wanted_rad: Float[np.ndarray, " step"]
) -> tuple[Float[np.ndarray, " step"], Float[np.ndarray, " step"]]:
    """Motor and wheel angles. By hand the motor is turned as wanted; the play stays."""
    servo, slots = servo_of(vehicle), int(np.ceil(vehicle.delay_s / STEP_S))
    steps = _loop_length(wanted_rad.size)
    share = torque_share(servo, _padded(manoeuvre.supply_v, steps))
    if manoeuvre.by_hand:
        servo, slots = ideal_servo()._replace(backlash_rad=servo.backlash_rad), 0
        share = jnp.ones_like(share)
    turned = _scan_servo(servo, _padded(wanted_rad, steps), share, slots)
    # A command holds from its time on: its effect is visible one step later.
    motor, wheel = (np.append(wanted_rad[0], np.asarray(part, np.float64)[: wanted_rad.size - 1]) for part in turned)
    return motor, wheel


@partial(jax.jit, static_argnames="slots")
def _scan_servo(
    servo: Servo, wanted_rad: Float[Array, " steps"], share: Float[Array, " steps"], slots: int
) -> tuple[Float[Array, " steps"], Float[Array, " steps"]]:
    def step(state, inputs):  # type: ignore[no-untyped-def]
        state = step_servo(state, servo, inputs[0], inputs[1], jnp.float32(STEP_S))
        return state, (state.motor_rad, state.wheel_rad)

    start = init_servo(wanted_rad[0], delay_slots=slots)
    turned: tuple[Float[Array, " steps"], Float[Array, " steps"]] = jax.lax.scan(step, start, (wanted_rad, share))[1]
    return turned


def _run_pedals(
    vehicle: TrueVehicle, manoeuvre: Manoeuvre
) -> tuple[Float[np.ndarray, " step"], Float[np.ndarray, " step"]]:
    """Speed at each time, and the way since the one before."""
    assert manoeuvre.throttle is not None
    assert manoeuvre.brake is not None
    count = manoeuvre.throttle.size
    steps = _loop_length(count)
    speed, step_m = _scan_pedals(
        pedals_of(vehicle), _padded(manoeuvre.throttle, steps), _padded(manoeuvre.brake, steps)
    )
    # A command holds from its time on: its effect is visible one step later.
    return (
        np.append(0.0, np.asarray(speed, np.float64)[: count - 1]),
        np.append(0.0, np.asarray(step_m, np.float64)[: count - 1]),
    )


@jax.jit
def _scan_pedals(
    pedals: Pedals, throttle: Float[Array, " steps"], brake: Float[Array, " steps"]
) -> tuple[Float[Array, " steps"], Float[Array, " steps"]]:
    def step(state, inputs):  # type: ignore[no-untyped-def]
        state, way_m = step_drive(state, pedals, inputs[0], inputs[1], jnp.float32(STEP_S))
        return state, (state.speed_mps, way_m)

    driven: tuple[Float[Array, " steps"], Float[Array, " steps"]] = jax.lax.scan(
        step, init_drive(jnp.float32(0.0)), (throttle, brake)
    )[1]
    return driven


# Fixes of a simulated vehicle's drive, drawn from an error model: neither ground nor radar is behind them.

# Height and roll of a fix; level ground and a level vehicle.
_SIGMA_HEIGHT_M, _SIGMA_ROLL_RAD = 0.05, 0.002

# Drawn for a multiple of this many scans: few lengths are compiled. The draws of a scan do not depend on it.
_BLOCK_SCANS = 1024


class VehicleFixes(NamedTuple):
    """Fixes of the array's centre in the drive's frame, one per scan.

    Attributes:
        time_s: scan times.
        found: whether the scan has a fix; poses of other scans are NaN.
        pose: east_m, north_m, height_m, yaw_rad, roll_rad.
        covariance: reported covariance of the pose.
        sigma_m: reported standard deviation along and across the fix's heading.
        strength: correlation of the fixes.
        p_false: probability that a fix's match is false.
    """

    time_s: Float[np.ndarray, " scan"]
    found: Bool[np.ndarray, " scan"]
    pose: Float[np.ndarray, "scan 5"]
    covariance: Float[np.ndarray, "scan 5 5"]
    sigma_m: tuple[float, float]
    strength: float
    p_false: float


def draw_vehicle_fixes(
    truth: DriveTruth, errors: FixErrors, *, array_x_m: float, rate_hz: float, seed: int
) -> VehicleFixes:
    """Draw the fixes of a drive's scans.

    Args:
        truth: true motion of the drive.
        errors: error model of the fixes.
        array_x_m: distance of the array's centre ahead of the rear axle, on the centre line.
        rate_hz: rate of the scans, the simulation's 100 Hz or a whole part of it.
        seed: seed of all draws.

    Raises:
        ValueError: the rate is no whole part of the simulation's.
    """
    every = _steps_between("rate_hz", rate_hz)
    scan = np.arange(0, truth.time_s.size, every)
    way_m = np.append(0.0, np.abs(np.diff(truth.travel_m[scan])))
    way_m = np.pad(way_m, (0, -scan.size % _BLOCK_SCANS))
    drawn = _drawn(errors, jax.random.key(seed), jnp.asarray(way_m, jnp.float32))
    found, error = np.asarray(drawn[0])[: scan.size], np.asarray(drawn[1], np.float64)[: scan.size]
    yaw = truth.yaw_rad[scan]
    cos, sin = np.cos(yaw), np.sin(yaw)
    along, aside = array_x_m + error[:, 0], error[:, 1]
    level = np.zeros(scan.size)
    east = truth.east_m[scan] + cos * along - sin * aside
    north = truth.north_m[scan] + sin * along + cos * aside
    pose = np.stack([east, north, level, yaw + error[:, 2], level], axis=1)
    reported = np.asarray(errors.reported_sigma, np.float64)
    # Reported along and across the heading of the fix itself.
    cos, sin = np.cos(pose[:, 3]), np.sin(pose[:, 3])
    turned = np.stack([np.stack([cos, -sin], axis=1), np.stack([sin, cos], axis=1)], axis=1)
    covariance = np.zeros((scan.size, 5, 5))
    covariance[:, :2, :2] = turned @ np.diag(reported[:2] ** 2) @ np.swapaxes(turned, 1, 2)
    covariance[:, 2, 2], covariance[:, 3, 3] = _SIGMA_HEIGHT_M**2, reported[2] ** 2
    covariance[:, 4, 4] = _SIGMA_ROLL_RAD**2
    pose[~found], covariance[~found] = np.nan, np.nan
    sigma_m = (float(reported[0]), float(reported[1]))
    return VehicleFixes(
        time_s=truth.time_s[scan],
        found=found,
        pose=pose,
        covariance=covariance,
        sigma_m=sigma_m,
        strength=float(errors.strength),
        p_false=float(errors.p_false),
    )


@jax.jit
def _drawn(
    errors: FixErrors, key: PRNGKeyArray, way_m: Float[Array, " scan"]
) -> tuple[Bool[Array, " scan"], Float[Array, "scan 3"]]:
    start, steps = jax.random.split(key)

    def step(
        state: FixErrorState, inputs: tuple[PRNGKeyArray, Float[Array, ""]]
    ) -> tuple[FixErrorState, tuple[Bool[Array, ""], Float[Array, "3"]]]:
        state, error = step_fix_errors(errors, state, *inputs)
        return state, (state.found, error)

    inputs = (jax.random.split(steps, way_m.size), way_m)
    drawn: tuple[Bool[Array, " scan"], Float[Array, "scan 3"]] = jax.lax.scan(
        step, init_fix_errors(errors, start), inputs
    )[1]
    return drawn
