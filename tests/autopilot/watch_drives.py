"""Drives of the made-up vehicle at 50 Hz for the watches: servo, pedals, slopes, ruts, and sensors with their noise."""

import tomllib
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from lgprjax.autopilot import default_velocity, init_velocity, step_velocity
from lgprjax.autopilot.monitors import ChassisBelief, Knots, PedalBelief, PedalsBelief, WheelBelief, proportional_rear
from lgprjax.autopilot.speed import VelocityState
from lgprjax.scene import (
    LiveSensorState,
    Plant,
    PlantState,
    Terrain,
    TrueVehicle,
    init_live_sensors,
    init_plant,
    live_sensors,
    no_faults,
    read_live_sensors,
    step_plant,
)
from lgprjax.scene.road import Waves, draw_waves
from lgprjax.scene.vehicle_drive import chassis_of, pedals_of, servo_of
from lgprjax.vehicle import VehiclePose
from lgprjax.vehicle.kinematics import MeasuredRear

TICK_S = 0.02
TICKS, CHUNK, LANES = 6000, 100, 20
"""Of a drive of two minutes; driven at a time, and how many side by side."""
_TRUE = TrueVehicle()
_SENSORS = live_sensors(tick_s=TICK_S, gnss_x_m=1.0, gnss_slow_m=0.3)
_ZERO_COUNTS = -31_234.0


class Wrong(NamedTuple):
    """What is wrong with the vehicle: supply that acts on the servo, speed at which the servo runs away (0: it does
    not), share of the rear steering and where the rear wheels stand beside it, throttle that it is stuck at (below 0:
    free), and share of the brake that acts."""

    supply_v: Float[Array, "..."]
    runaway_radps: Float[Array, "..."]
    rear_share: Float[Array, "..."]
    rear_rad: Float[Array, "..."]
    throttle_at: Float[Array, "..."]
    brake_share: Float[Array, "..."]


class Plan(NamedTuple):
    """What is asked in each tick, and who drives."""

    front_rad: Float[Array, " tick"]
    speed_mps: Float[Array, " tick"]
    gear: Float[Array, " tick"]
    steering: Float[Array, " tick"]
    pedals: Float[Array, " tick"]


class World(NamedTuple):
    """Everything that is carried."""

    plant: PlantState
    sensors: LiveSensorState
    velocity: VelocityState
    sent_rad: Float[Array, ""]
    told: Float[Array, " pedal"]
    positions: Float[Array, " pedal"]
    odometer_m: Float[Array, ""]
    drive: Array
    tick: Array


class Row(NamedTuple):
    """What the control loop hears in a tick, and what it sent in the one before."""

    potentiometer_v: float
    encoder_counts: float
    supply_v: float
    throttle: float
    brake: float
    odometer_m: float
    speed_mps: float
    yaw_rate_radps: float
    heading_rad: float
    gnss_x_m: float
    gnss_y_m: float
    gnss_valid: float
    sent_rad: float
    sent_throttle: float
    sent_brake: float
    steering: float
    pedals: float
    wheel_rad: float
    true_mps: float


def nothing_wrong() -> Wrong:
    """A sound vehicle."""
    return Wrong(*(jnp.float32(value) for value in (24.0, 0.0, 1.0, 0.0, -1.0, 1.0)))


@cache
def healthy_drives(drives: int) -> tuple[World, list[Row]]:
    """The states at every tick's begin, and what was heard at its end, drive after drive."""
    state, plans = jax.vmap(_start)(jnp.arange(drives)), _plans(drives)
    worlds, rows = [], []
    for at in range(0, TICKS, CHUNK):
        plan = jax.tree.map(lambda leaf, at=at: leaf.reshape(drives, -1)[:, at : at + CHUNK], plans)
        state, world, row = _run(state, nothing_wrong(), plan)
        worlds.append(world)
        rows.append(row)
    every: World = jax.tree.map(lambda *parts: np.concatenate(parts, axis=1).reshape(-1, *parts[0].shape[2:]), *worlds)
    heard = np.concatenate(rows, axis=1)
    return every, rows_of(heard.reshape(-1, heard.shape[-1]))


def drives_with(drives: int, wrong: Wrong, onsets: list[int]) -> list[list[Row]]:
    """What is heard in a chunk from each onset on, one drive after another numbered as in ``healthy_drives``."""
    worlds, _ = healthy_drives(drives)
    starts = jax.tree.map(lambda leaf: jnp.asarray(leaf[np.asarray(onsets)]), worlds)
    plans = jax.tree.map(lambda leaf: jnp.stack([leaf[at : at + CHUNK] for at in onsets]), _plans(drives))
    return [rows_of(lane) for lane in _run(starts, wrong, plans)[2]]


def _run(starts: World, wrong: Wrong, plans: Plan) -> tuple[World, World, Float[np.ndarray, "lane tick heard"]]:
    """Lanes over a chunk, all in one program: states after it, states before its ticks, and what was heard."""
    lanes = len(plans.front_rad)

    def fill(leaf: Array) -> Array:
        return jnp.concatenate([leaf, jnp.repeat(leaf[-1:], LANES - lanes, axis=0)])

    wrongs = jax.tree.map(lambda leaf: jnp.broadcast_to(leaf, (LANES,)), wrong)
    after, (worlds, rows) = _DRIVES(jax.tree.map(fill, starts), wrongs, jax.tree.map(fill, plans), _terrain())
    return (
        jax.tree.map(lambda leaf: leaf[:lanes], after),
        jax.tree.map(lambda leaf: np.asarray(leaf)[:lanes], worlds),
        np.asarray(rows)[:lanes],
    )


def rows_of(heard: Float[np.ndarray, "tick heard"]) -> list[Row]:
    """Rows as plain floats."""
    return [Row(*values) for values in np.asarray(heard, np.float64).tolist()]


@cache
def believed() -> tuple[WheelBelief, ChassisBelief, PedalsBelief]:
    """The vehicle as its calibration found it."""
    path = Path(__file__).parents[2] / "tuning" / "tuned.vehicle.toml"
    table = tomllib.loads(path.read_text(encoding="utf-8"))
    steering, wheel_map = table["steering"], table["wheel_map"]
    names = ("lag_s", "delay_s", "dead_band_rad", "backlash_rad", "nominal_v", "stall_v", "encoder_counts_per_rad")
    wheel = WheelBelief(
        angle_of_volts=Knots(wheel_map["first_v"], wheel_map["step_v"], tuple(wheel_map["front_rad"])),
        largest_rad=steering["largest_wheel_angle_rad"],
        rate_radps=steering["largest_wheel_rate_radps"],
        **{name: steering[name] for name in names},
    )
    chassis = ChassisBelief(
        table["chassis"]["wheelbase_m"],
        proportional_rear(steering["rear_ratio"]),
        steering["characteristic_speed_mps"],
    )
    pedals = PedalsBelief(
        PedalBelief(**table["throttle"]),
        PedalBelief(**table["brake"]),
        table["resistance"]["rolling_mps2"],
        table["resistance"]["drag_per_s"],
    )
    return wheel, chassis, pedals


@cache
def _plans(drives: int) -> Plan:
    """Of all drives, one after another."""
    plans = [_plan(drive) for drive in range(drives)]
    return Plan(*(jnp.asarray(np.concatenate(parts), jnp.float32) for parts in zip(*plans, strict=True)))


def _plan(drive: int) -> tuple[Float[np.ndarray, " tick"], ...]:
    """Speeds with stops and some reverse, gentle and violent steering, and a person who takes over now and then."""
    rng = np.random.default_rng([7, drive])
    time_s = np.arange(TICKS) * TICK_S
    speed, gear = np.zeros(TICKS), np.ones(TICKS)
    at, direction = 0, 1.0
    while at < TICKS:
        length = int(rng.uniform(12.0, 25.0) / TICK_S)
        speed[at : at + length] = rng.choice([1.2, 2.0, 3.0, 4.47, 4.47]) if direction > 0 else 1.5
        gear[at : at + length] = direction
        at += length
        if rng.random() < 0.3:
            pause = int(rng.uniform(6.0, 10.0) / TICK_S)
            speed[at : at + pause], gear[at : at + pause] = 0.0, direction
            at += pause
            direction = -1.0 if direction > 0 and rng.random() < 0.4 else 1.0
    gentle = sum(
        0.08 * np.sin(2 * np.pi * time_s / period + phase)
        for period, phase in zip((41.0, 23.0, 11.0, 5.0), rng.uniform(0, 6, 4), strict=True)
    )
    jumps = np.repeat(rng.uniform(-0.5, 0.5, 1 + TICKS // 75), 75)[:TICKS]
    violent = np.repeat(rng.random(1 + TICKS // 500) < 0.35, 500)[:TICKS]
    front = np.where(violent, jumps, gentle) * np.clip(2.0 / np.maximum(speed, 0.1), 0.4, 1.0)
    steering, pedals = np.zeros(TICKS), np.zeros(TICKS)
    at = 150
    while at < TICKS:
        length = int(rng.uniform(15.0, 50.0) / TICK_S)
        steering[at : at + length] = 1.0
        late = int(rng.uniform(0.0, 4.0) / TICK_S)
        pedals[at + late : at + length] = 1.0
        at += length + int(rng.uniform(1.0, 9.0) / TICK_S)
    return front, speed, gear, steering, pedals


@cache
def _terrain() -> Terrain:
    rng = np.random.default_rng(3)
    grade, bank, ruts = (
        Waves(*(np.asarray(part, np.float32) for part in draw_waves(rng, rms, wavelength_m)))
        for rms, wavelength_m in ((0.04, (40.0, 300.0)), (0.035, (30.0, 200.0)), (0.003, (2.0, 15.0)))
    )
    return Terrain(grade, bank, ruts, jnp.float32(1.0))


def _start(drive: Array) -> World:
    zero = jnp.float32(0.0)
    pose = VehiclePose(zero, zero, 0.7 + 0.9 * drive.astype(jnp.float32))
    plant = init_plant(pose, zero, 150.0 * drive.astype(jnp.float32), delay_slots=10)
    sensors = init_live_sensors(_SENSORS, jax.random.fold_in(jax.random.key(1), drive))
    both = jnp.zeros(2, jnp.float32)
    return World(plant, sensors, init_velocity(zero), zero, both, both, zero, drive, jnp.int32(0))


def _plant_with(wrong: Wrong) -> Plant:
    chassis, servo = chassis_of(_TRUE, 6.2), servo_of(_TRUE)
    ends = jnp.array([-1.0, 1.0], jnp.float32)
    rear = MeasuredRear(ends[0], ends[1] - ends[0], wrong.rear_share * 0.63 * ends + wrong.rear_rad)
    runs = wrong.runaway_radps != 0.0
    servo = servo._replace(
        rate_radps=jnp.where(runs, jnp.abs(wrong.runaway_radps), servo.rate_radps),
        lag_s=jnp.where(runs, 0.01, servo.lag_s),
        delay_s=jnp.where(runs, 0.0, servo.delay_s),
    )
    return Plant(chassis._replace(rear=rear), servo, pedals_of(_TRUE), wrong.supply_v)


def _tick(
    wrong: Wrong, terrain: Terrain, world: World, plan: Plan
) -> tuple[World, tuple[World, Float[Array, " heard"]]]:
    """A tick: the vehicle under the commands of the last one, what is heard of it, and the next commands."""
    noise = jax.random.split(jax.random.fold_in(jax.random.key(5), world.drive * TICKS + world.tick), 2)
    tick = world.tick + 1
    throttle = jnp.where(wrong.throttle_at >= 0.0, wrong.throttle_at, world.told[0])
    brake = world.told[1] * wrong.brake_share
    servo_rad = jnp.where(wrong.runaway_radps == 0.0, world.sent_rad, 0.6 * jnp.sign(wrong.runaway_radps))
    plant = step_plant(_plant_with(wrong), terrain, world.plant, servo_rad, throttle, brake, plan.gear, TICK_S)
    sensors, heard = read_live_sensors(
        _SENSORS, no_faults(), world.sensors, noise[0], plant.pose, plant.speed_mps, plant.yaw_rate_radps, tick, TICK_S
    )
    positions = world.positions + 0.2 * (jnp.stack([throttle, brake]) - world.positions)
    wheel = plant.servo.wheel_rad
    extra = jax.random.normal(noise[1], (4,))
    volts = 2.43 + 2.0 * wheel + 0.002 * extra[0]
    speed = heard.odometer_mps
    odometer = world.odometer_m + speed * TICK_S
    row = jnp.stack(
        [
            volts,
            jnp.round(_ZERO_COUNTS + 12_000.0 * plant.servo.motor_rad),
            24.0 + 0.1 * extra[1],
            jnp.maximum(positions[0] + 0.005 * extra[2], 0.0),
            jnp.maximum(positions[1] + 0.005 * extra[3], 0.0),
            odometer,
            speed,
            heard.yaw_rate_radps,
            heard.heading_rad,
            heard.gnss_m[0],
            heard.gnss_m[1],
            heard.gnss_valid.astype(jnp.float32),
            world.sent_rad,
            world.told[0],
            world.told[1],
            plan.steering,
            plan.pedals,
            wheel,
            plant.speed_mps,
        ]
    )
    velocity, throttle, brake = step_velocity(
        default_velocity()._replace(proportional_per_s=jnp.float32(1.5), integral_per_s2=jnp.float32(0.4)),
        pedals_of(_TRUE),
        world.velocity,
        plan.speed_mps,
        speed * plan.gear,
        jnp.asarray(True),
        jnp.float32(TICK_S),
    )
    # A driver's hands know no limiter; the autopilot's first command starts from where the wheels are.
    turn = 0.5 * TICK_S
    limited = jnp.clip(plan.front_rad, world.sent_rad - turn, world.sent_rad + turn)
    sent = jnp.where(plan.steering > 0.0, limited, jnp.clip(plan.front_rad, wheel - 0.1, wheel + 0.1))
    following = World(
        plant, sensors, velocity, sent, jnp.stack([throttle, brake]), positions, odometer, world.drive, tick
    )
    return following, (world, row)


_Chunk = tuple[World, tuple[World, Float[Array, "... heard"]]]


def _drive(world: World, wrong: Wrong, plan: Plan, terrain: Terrain) -> _Chunk:
    driven: _Chunk = jax.lax.scan(lambda carried, now: _tick(wrong, terrain, carried, now), world, plan)
    return driven


_DRIVES: Callable[[World, Wrong, Plan, Terrain], _Chunk] = jax.jit(jax.vmap(_drive, in_axes=(0, 0, 0, None)))
