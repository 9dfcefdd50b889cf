"""A vehicle driven through a manoeuvre, with servo, play and pedals in the loop: the truth of it, and its log."""

from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from lgprjax.scene.manoeuvres import STEP_S, Manoeuvre
from lgprjax.scene.vehicle_sensors import DriveTruth, VehicleSensors, read_sensors
from lgprjax.vehicle.arc import VehiclePose, drive_arc
from lgprjax.vehicle.chassis import Chassis, MeasuredRear, ProportionalRear, rear_angle, turn_of, yaw_gain
from lgprjax.vehicle.linkage import Linkage, shaft_angle, straight_slope
from lgprjax.vehicle.pedals import Pedal, Pedals, init_drive, step_drive
from lgprjax.vehicle.servo import Servo, ideal_servo, init_servo, step_servo, torque_share
from lgprjax.vehicle.signals import DriveSignals
from lgprjax.vehicle.steering_sensors import Encoder, Potentiometer

DEGREE = np.pi / 180.0


@dataclass(frozen=True)
class TrueVehicle:
    """A vehicle as it is, for simulated drives. The numbers are made up: no vehicle's own.

    Attributes:
        wheelbase_m, largest_angle_rad, characteristic_speed_mps: as in ``Chassis``.
        rear: k, or a measured map.
        linkage: between the steering shaft, which potentiometer and encoder see, and the front wheels; None for a
            proportional one.
        lag_s, rate_radps, delay_s, dead_band_rad, backlash_rad, asymmetry, nominal_v, stall_v: as in ``Servo``.
        potentiometer_straight_v, potentiometer_per_rad_v: as in ``Potentiometer``.
        encoder_counts_per_rad: as in ``Encoder``.
        lock_to_lock_turns: of the steering wheel.
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
    """A simulated drive: what its log holds, and how it was."""

    signals: DriveSignals
    truth: DriveTruth


def chassis_of(vehicle: TrueVehicle, anchor_m: float = 0.0) -> Chassis:
    """The vehicle's chassis, with an anchor for those who follow a path."""
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
    """Drives the manoeuvre and logs it.

    Args:
        vehicle: as it is.
        manoeuvre: what it is told.
        sensors: their noise and faults; None for the usual ones.
        seed: of all noise, and of the encoder's unknown zero.
    """
    truth = drive_manoeuvre(vehicle, manoeuvre)
    return VehicleDrive(read_vehicle(vehicle, manoeuvre, truth, sensors or VehicleSensors(), seed), truth)


def drive_manoeuvre(vehicle: TrueVehicle, manoeuvre: Manoeuvre) -> DriveTruth:
    """How the drive goes, at 100 Hz; nothing in it is random.

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
        time_s,
        east,
        north,
        yaw,
        np.cumsum(step_m),
        speed,
        wheel,
        rear,
        _steering_angle(vehicle, motor),
        _steering_angle(vehicle, wheel),
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
    """At the length of a compiled loop, the last value going on."""
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
    # A command holds from its time on: what came of it is seen one step later.
    motor, wheel = (np.append(wanted_rad[0], np.asarray(part, np.float64)[: wanted_rad.size - 1]) for part in turned)
    return motor, wheel


@partial(jax.jit, static_argnames="slots")
def _scan_servo(
    servo: Servo, wanted_rad: Float[Array, " steps"], share: Float[Array, " steps"], slots: int
) -> tuple[Float[Array, " steps"], Float[Array, " steps"]]:
    def step(state, told):  # type: ignore[no-untyped-def]
        state = step_servo(state, servo, told[0], told[1], jnp.float32(STEP_S))
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
    # A command holds from its time on: what came of it is seen one step later.
    return (
        np.append(0.0, np.asarray(speed, np.float64)[: count - 1]),
        np.append(0.0, np.asarray(step_m, np.float64)[: count - 1]),
    )


@jax.jit
def _scan_pedals(
    pedals: Pedals, throttle: Float[Array, " steps"], brake: Float[Array, " steps"]
) -> tuple[Float[Array, " steps"], Float[Array, " steps"]]:
    def step(state, told):  # type: ignore[no-untyped-def]
        state, way_m = step_drive(state, pedals, told[0], told[1], jnp.float32(STEP_S))
        return state, (state.speed_mps, way_m)

    driven: tuple[Float[Array, " steps"], Float[Array, " steps"]] = jax.lax.scan(
        step, init_drive(jnp.float32(0.0)), (throttle, brake)
    )[1]
    return driven
