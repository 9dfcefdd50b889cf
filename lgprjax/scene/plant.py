"""The vehicle in a closed loop: servo, pedals and chassis under commands, on ground that slopes, leans and pushes."""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float

from lgprjax.scene.road_waves import Waves
from lgprjax.vehicle.arc import VehiclePose, drive_arc
from lgprjax.vehicle.chassis import Chassis, turn_of, yaw_gain
from lgprjax.vehicle.pedals import DriveState, Pedals, init_drive, step_drive
from lgprjax.vehicle.servo import Servo, ServoState, init_servo, step_servo, torque_share

GRAVITY_MPS2 = 9.81
SUBSTEPS = 3
"""Steps of the vehicle within one of the control loop."""
CORNERING_MPS2_PER_RAD = 80.0
"""Side force of all tyres over mass and slip angle, of the order of a truck's: a lean of the ground makes it crab."""


class Plant(NamedTuple):
    """The vehicle as it is. Fields are scalars or one value a lane."""

    chassis: Chassis
    servo: Servo
    pedals: Pedals
    supply_v: Float[Array, "..."]


class Terrain(NamedTuple):
    """What the ground does to a vehicle, as functions of the way along it.

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
    """Where the vehicle is and what it waits for.

    Attributes:
        pose: of the rear axle, true.
        servo, drive: wheels and pedals.
        travel_m: signed way.
        along_m: place on the terrain.
        yaw_rate_radps, speed_mps: over the last step, signed.
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
    """At a pose and a speed, wheels straight. ``delay_slots``: substeps of the servo's longest delay."""
    zero = jnp.zeros_like(pose.x_m)
    drive = init_drive(speed_mps)
    return PlantState(pose, init_servo(zero, delay_slots=delay_slots), drive, zero, along_m, zero, speed_mps)


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
        plant: the vehicle.
        terrain: under it.
        state: before.
        front_rad, throttle, brake: commands.
        gear: +1 forward, -1 reverse.
        step_s: of the control loop.
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
    """``wave_value`` on the device, wave after wave: lanes have any shape."""
    total = jnp.zeros_like(along_m)
    for number in range(len(waves.amplitude)):
        turns = along_m * waves.wave_rad_per_m[number] + waves.phase_rad[number]
        total += waves.amplitude[number] * jnp.sin(turns)
    return total
