"""The vehicle behind the devices: plant and navigation sensors stepped in one compiled call, faults in its parts."""

import math
from collections.abc import Iterable
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int, PRNGKeyArray

from lgprjax.formats.store import atomic_output
from lgprjax.scene import (
    LiveSensors,
    LiveSensorState,
    Plant,
    PlantState,
    Terrain,
    init_live_sensors,
    init_plant,
    live_sensors,
    no_faults,
    read_live_sensors,
    step_plant,
)
from lgprjax.scene.motion import STEP_S as MOTION_STEP_S
from lgprjax.scene.motion import Manoeuvre
from lgprjax.scene.plant import SUBSTEPS
from lgprjax.scene.vehicle_drive import TrueVehicle, chassis_of, pedals_of, servo_of
from lgprjax.simulation.devices.boxes import ActuatorOrders, DriveCommandMessage
from lgprjax.simulation.devices.faults import RunningFaults, ScriptItem
from lgprjax.simulation.devices.world import CourseWorld, Sample, Start
from lgprjax.simulation.loop.loop_setup import cross_track_m
from lgprjax.vehicle.kinematics import MeasuredRear, VehiclePose

GNSS_X_M = 1.0
"""Antenna ahead of the rear axle."""
GNSS_SLOW_M = 0.3
"""Sigma of the slow error of positions against the map, an axis."""
_HAND_LAG_S, _HAND_RATE_RADPS = 0.05, 1.0


class Acting(NamedTuple):
    """Inputs acting on the vehicle for a tick.

    Attributes:
        by_hand: whether the driver turns the wheels, not the servo.
        front_rad: commanded angle of the front wheels.
        throttle, brake: acting throttle and brake.
        supply_v: supply voltage of the servo.
        runaway_radps: rate of a servo that turns regardless of commands; 0 for a sound one.
        rear_rad: angle of stuck rear wheels; NaN for sound ones.
        gear: +1 forward, -1 reverse.
    """

    by_hand: bool
    front_rad: float
    throttle: float
    brake: float
    supply_v: float
    runaway_radps: float
    rear_rad: float
    gear: float = 1.0


class Moved(NamedTuple):
    """The vehicle at a tick's end, pose in the map's frame, and the slow errors of its sensors.

    Attributes:
        x_m, y_m, yaw_rad: pose of the rear axle.
        travel_m, along_m, speed_mps: signed distance, position along the terrain, present speed.
        front_rad, motor_rad: angle of the front wheels, and of the servo as a wheel angle.
        rate_bias_radps, heading_slow_rad, odometer_scale: slow errors of gyro, INS heading and odometer.
        gnss_east_m, gnss_north_m, gnss_valid: measured position of the antenna, and whether it is new.
    """

    x_m: float
    y_m: float
    yaw_rad: float
    travel_m: float
    along_m: float
    speed_mps: float
    front_rad: float
    motor_rad: float
    rate_bias_radps: float
    heading_slow_rad: float
    odometer_scale: float
    gnss_east_m: float
    gnss_north_m: float
    gnss_valid: float


class SimulatedVehicle:
    """A simulated counter-steered vehicle, initially at standstill.

    Args:
        true: true vehicle.
        terrain: terrain under the vehicle.
        tick_s: step.
        start: pose of the rear axle in the map's frame.
        along_m: position along the terrain.
        seed: seed of the sensors' errors.
        gnss_slow_m: standard deviation per axis of the slow position error.
    """

    def __init__(
        self,
        true: TrueVehicle,
        terrain: Terrain,
        *,
        tick_s: float,
        start: tuple[float, float, float],
        along_m: float,
        seed: int,
        gnss_slow_m: float = GNSS_SLOW_M,
    ) -> None:
        self._true, self._tick_s = true, tick_s
        # Linear between knots and beyond them, so that sound and stuck wheels share one compiled program.
        rear = true.rear
        if not isinstance(rear, MeasuredRear):
            rear = MeasuredRear(jnp.float32(-1.0), jnp.float32(2.0), jnp.array([-rear, rear], jnp.float32))
        self._rear: Any = jax.tree.map(np.asarray, rear)
        self.sensors = live_sensors(tick_s=tick_s, gnss_x_m=GNSS_X_M, gnss_slow_m=gnss_slow_m)
        # NumPy arrays, which a compiled function takes directly: transfers of each would cost as much as the call.
        self._fixed = jax.tree.map(np.asarray, (terrain, self.sensors))
        plant = Plant(chassis_of(true, true.array_x_m), servo_of(true), pedals_of(true), jnp.float32(true.nominal_v))
        self._sound: Plant = jax.tree.map(np.asarray, plant)
        self._pose = VehiclePose(*(jnp.float32(number) for number in start))
        begin, self._noise = jax.random.split(jax.random.key(seed))
        slots = int(np.ceil(true.delay_s * SUBSTEPS / tick_s)) + 1
        zero = jnp.float32(0.0)
        self._plant = init_plant(self._pose, zero, jnp.float32(along_m), delay_slots=slots)
        self._errors = init_live_sensors(self.sensors, begin)
        self._tick = 0

    def step(self, acting: Acting) -> Moved:
        """The vehicle a tick later."""
        self._tick += 1
        told = np.array([self._target(acting), acting.throttle, acting.brake, acting.gear], np.float32)
        self._plant, self._errors, row = _step(
            self._fixed,
            self._plant_of(acting),
            self._plant,
            self._errors,
            told,
            self._noise,
            np.int32(self._tick),
            self._tick_s,
        )
        return Moved._make(np.asarray(row, np.float64).tolist())

    def _target(self, acting: Acting) -> float:
        largest = self._true.largest_angle_rad
        if acting.runaway_radps and not acting.by_hand:
            return float(np.copysign(largest, acting.runaway_radps))
        return float(np.clip(acting.front_rad, -largest, largest))

    def _plant_of(self, acting: Acting) -> Plant:
        sound, one = self._sound, np.float32
        servo: Any = sound.servo
        if acting.by_hand:
            zero = one(0.0)
            servo = servo._replace(
                lag_s=one(_HAND_LAG_S),
                rate_radps=one(_HAND_RATE_RADPS),
                delay_s=zero,
                dead_band_rad=zero,
                asymmetry=zero,
            )
        elif acting.runaway_radps:
            servo = servo._replace(lag_s=one(0.02), rate_radps=one(abs(acting.runaway_radps)), delay_s=one(0.0))
        rear = self._rear
        if not np.isnan(acting.rear_rad):
            rear = rear._replace(rear_rad=np.full_like(rear.rear_rad, -acting.rear_rad))
        supply: Any = one(self._true.nominal_v if acting.by_hand else acting.supply_v)
        return sound._replace(servo=servo, chassis=sound.chassis._replace(rear=rear), supply_v=supply)


@partial(jax.jit, static_argnames="tick_s")
def _step(
    fixed: tuple[Terrain, LiveSensors],
    plant: Plant,
    state: PlantState,
    errors: LiveSensorState,
    told: Float[Array, "4"],
    noise: PRNGKeyArray,
    tick: Int[Array, ""],
    tick_s: float,
) -> tuple[PlantState, LiveSensorState, Float[Array, " number"]]:
    terrain, sensors = fixed
    state = step_plant(plant, terrain, state, told[0], told[1], told[2], told[3], tick_s)
    errors, readings = read_live_sensors(
        sensors,
        no_faults(),
        errors,
        jax.random.fold_in(noise, tick),
        state.pose,
        state.speed_mps,
        state.yaw_rate_radps,
        tick,
        tick_s,
    )
    row = [
        *state.pose,
        state.travel_m,
        state.along_m,
        told[3] * state.drive.speed_mps,
        state.servo.wheel_rad,
        state.servo.motor_rad,
        errors.rate_bias_radps,
        errors.heading_slow_rad,
        errors.odometer_scale,
        readings.gnss_m[0],
        readings.gnss_m[1],
        readings.gnss_valid.astype(jnp.float32),
    ]
    return state, errors, jnp.stack(row)


# The driver: sees the road, keeps the vehicle on the baseline without autopilot, and plays a script.

SCRIPT: dict[str, tuple[str, ...]] = {
    "drive": ("speed_mps",),
    "stand": (),
    "press": ("button",),
    "brake_tap": (),
    "torque": ("nm",),
}
"""Items of a script, and their parameters."""

SCRIPT_LASTS_S = {"press": 0.3, "brake_tap": 0.3, "torque": 0.5}
BUTTONS = ("steering", "plus", "minus", "override", "estop")

_CROSS_PER_M = 0.4
_PREVIEW_S = 0.25
_STANDS_MPS = 0.05
_TAP_BRAKE, _HALT_BRAKE, _PARKED_BRAKE = 0.22, 0.45, 0.5
_USUAL_THROTTLE, _HILL_MPS2 = 0.7, 1.2
_END_M = 2.0
_BACK, _ON = 10, 200
_DOWN, _UP = 12, 6
"""Ticks of a tap of the brake, shorter than what takes over, and between two of them."""


class DriverInput(NamedTuple):
    """Actions of the driver.

    Attributes:
        front_rad: angle to which the front wheels are turned by hand.
        throttle, brake: pedals, 0 to 1.
        foot_on_brake: whether the brake is pressed by foot, not by the parking lever.
        torque_nm: torque on the steering wheel.
        buttons: buttons pressed on the controller.
        gear: +1 forward, -1 reverse.
    """

    front_rad: float
    throttle: float
    brake: float
    foot_on_brake: bool
    torque_nm: float
    buttons: frozenset[str]
    gear: float = 1.0


def counter_steer_rad(vehicle: TrueVehicle, front_rad: float) -> float:
    """Magnitude of the rear wheels' angle, with the sign of the front wheels'."""
    rear = vehicle.rear
    if not isinstance(rear, MeasuredRear):
        return rear * front_rad
    knots = np.asarray(rear.rear_rad, np.float64)
    return float(np.interp(front_rad, float(rear.first_rad) + float(rear.step_rad) * np.arange(len(knots)), knots))


def pedals_for_speed(vehicle: TrueVehicle, wanted_mps: float | None, speed_mps: float) -> tuple[float, float, bool]:
    """Throttle, brake, and whether the brake is pressed by foot, for a driver who holds a speed.

    Args:
        vehicle: true vehicle.
        wanted_mps: speed to hold; ``None``: stop, then park with the lever.
        speed_mps: present speed in the gear's direction.
    """
    if wanted_mps is None:
        parked = speed_mps < _STANDS_MPS
        return 0.0, _PARKED_BRAKE if parked else _HALT_BRAKE, not parked
    slow_mps = wanted_mps - speed_mps
    if slow_mps < -0.5:
        pre_tension, _, gain, _ = vehicle.brake
        return 0.0, float(np.clip(pre_tension - (slow_mps + 0.3) / gain, 0.0, 0.6)), True
    pre_tension, _, gain, _ = vehicle.throttle
    resistance = vehicle.rolling_mps2 + vehicle.drag_per_s * speed_mps
    # As far as a weak engine needs up a hill.
    most = min(max(_USUAL_THROTTLE, pre_tension + (_HILL_MPS2 + resistance) / gain), 1.0)
    return float(np.clip(pre_tension + (1.5 * slow_mps + resistance) / gain, 0.0, most)), 0.0, False


def scripted_input(
    items: Iterable[ScriptItem], front_rad: float, pedals: tuple[float, float, bool], gear: float = 1.0
) -> DriverInput:
    """Actions of a driver who steers and brakes so, with what the script adds: buttons, torque, taps of the brake."""
    running, (throttle, brake, foot) = list(items), pedals
    tapped = any(item.name == "brake_tap" for item in running)
    if tapped:
        brake, foot = max(brake, _TAP_BRAKE), True
    torque = sum(float(item.numbers["nm"]) for item in running if item.name == "torque")
    pressed = frozenset(str(item.numbers["button"]) for item in running if item.name == "press")
    # The pedal's switch is wired to the controller too.
    pressed |= {"brake_tap"} if tapped else set()
    return DriverInput(
        front_rad=front_rad,
        throttle=throttle,
        brake=brake,
        foot_on_brake=foot,
        torque_nm=torque,
        buttons=pressed,
        gear=gear,
    )


class Driver:
    """Drives the array's centre along the baseline by the true pose, with the array's motion along the line.

    Args:
        vehicle: true vehicle.
        array_x_m: distance of the array ahead of the rear axle.
        line_m: true positions of the baseline's anchor, in driving order.
    """

    def __init__(self, vehicle: TrueVehicle, array_x_m: float, line_m: Float[np.ndarray, "point 2"]) -> None:
        # Share of the rear wheels' angle at usual steering angles.
        self._vehicle, self._share = vehicle, counter_steer_rad(vehicle, 0.1) / 0.1
        # Distance to the array from the point that moves along the body's axis.
        self._ahead_m = array_x_m - vehicle.wheelbase_m * self._share / (1.0 + self._share)
        self._array_x_m = array_x_m
        step = np.diff(line_m, axis=0)
        self._line_m, self._yaw = line_m, np.unwrap(np.arctan2(step[:, 1], step[:, 0]))
        self._way_m = np.concatenate([[0.0], np.cumsum(np.hypot(*step.T))])
        self._at = 0
        self._speed_mps: float | None = None
        self._braked = 0
        self._told: ScriptItem | None = None

    def step(self, running: Iterable[ScriptItem], at: Sample, orders: ActuatorOrders) -> DriverInput:
        """Actions of the driver.

        A held brake takes the steering back. So while it is engaged the driver brakes in taps, and at the end of the
        road drives on until the steering is handed over.

        Args:
            running: running items of the script.
            at: present truth.
            orders: commands of the box, which may hold the wheels or the pedals.
        """
        items = list(running)
        # The last order holds until another one.
        told = [item for item in items if item.name in ("drive", "stand")]
        if told and told[-1] is not self._told:
            self._told = told[-1]
            self._speed_mps = None if self._told.name == "stand" else float(self._told.numbers["speed_mps"])
        front, to_go_m = self._steer(at)
        wanted = self._speed_mps if to_go_m > _END_M or orders.steering else None
        free = (0.0, 0.0, False)
        pedals = free if orders.pedals else pedals_for_speed(self._vehicle, wanted, at.speed_mps)
        foot = pedals[2]
        self._braked = (self._braked + 1) % (_DOWN + _UP) if foot or self._braked >= _DOWN else 0
        if orders.steering and wanted is not None and self._braked >= _DOWN:
            pedals = free
        return scripted_input(items, front, pedals)

    def _steer(self, sample: Sample) -> tuple[float, float]:
        yaw_rad, along_m = sample.yaw_rad, self._array_x_m
        place = np.array([sample.x_m + along_m * np.cos(yaw_rad), sample.y_m + along_m * np.sin(yaw_rad)])
        low = max(self._at - _BACK, 0)
        near = self._line_m[low : self._at + _ON]
        self._at = at = min(low + int(np.argmin(np.sum((near - place) ** 2, axis=1))), len(self._yaw) - 1)
        gap, yaw = place - self._line_m[at], self._yaw[at]
        cross_m = float(np.cos(yaw) * gap[1] - np.sin(yaw) * gap[0])
        ahead_m = self._way_m[at] + sample.speed_mps * _PREVIEW_S
        way = float(np.interp(ahead_m, self._way_m[:-1], self._yaw))
        turn = math.remainder(way - yaw_rad, math.tau) - np.clip(_CROSS_PER_M * cross_m, -0.5, 0.5)
        curvature = np.tan(np.clip(turn, -1.2, 1.2)) / self._ahead_m
        front = curvature * self._vehicle.wheelbase_m / (1.0 + self._share)
        largest = 0.95 * self._vehicle.largest_angle_rad
        return float(np.clip(front, -largest, largest)), float(self._way_m[-1] - self._way_m[at])


class HandDriver:
    """Drives a calibration manoeuvre by hand, and plays a script; the manoeuvre waits for standstill.

    Args:
        vehicle: true vehicle.
        manoeuvre: manoeuvre to drive; after its end the vehicle stays at standstill.
        tick_s: tick of the devices.
    """

    def __init__(self, vehicle: TrueVehicle, manoeuvre: Manoeuvre, tick_s: float) -> None:
        self._vehicle, self._manoeuvre, self._tick_s = vehicle, manoeuvre, tick_s
        self._time_s, self._gear = 0.0, 1.0

    @property
    def finished(self) -> bool:
        """Whether the manoeuvre has been driven to its end."""
        return self._time_s >= float(self._manoeuvre.time_s[-1])

    def step(self, running: Iterable[ScriptItem], at: Sample, orders: ActuatorOrders) -> DriverInput:
        """Actions of the driver; see ``Driver.step``."""
        told = self._manoeuvre
        step = min(int(self._time_s / MOTION_STEP_S), len(told.time_s) - 1)
        wanted = float(told.speed_mps[step])
        stands = abs(at.speed_mps) < _STANDS_MPS
        if wanted and stands:
            self._gear = float(np.sign(wanted))
        if wanted or stands:
            self._time_s += self._tick_s
        halt = wanted * self._gear <= 0.0
        pedals = pedals_for_speed(self._vehicle, None if halt else abs(wanted), self._gear * at.speed_mps)
        held = (0.0, 0.0, False) if orders.pedals else pedals
        return scripted_input(running, float(told.wanted_rad[step]), held, self._gear)


# The vehicle's body under the box's orders and the driver's hands: inputs and measurements.

_THROTTLE_LAG_S = 0.05


class BodyTick(NamedTuple):
    """A tick of the body: what acted, how the vehicle moved, and the sample at the end."""

    acting: Acting
    moved: Moved
    sample: Sample


class Body:
    """The vehicle with its actuators, ticking.

    Args:
        true: true vehicle.
        world: world of the vehicle.
        start: start position.
        faults: running faults.
        seed: seed of the sensors' errors.
    """

    def __init__(
        self,
        true: TrueVehicle,
        world: CourseWorld,
        start: Start,
        faults: RunningFaults,
        seed: int,
        gnss_slow_m: float = GNSS_SLOW_M,
    ) -> None:
        self._true, self._world, self._faults = true, world, faults
        self.vehicle = SimulatedVehicle(
            true,
            world.laid.terrain,
            tick_s=world.tick_s,
            start=start.pose,
            along_m=start.along_m,
            seed=seed,
            gnss_slow_m=gnss_slow_m,
        )
        roll = world.roll(start.pose, start.along_m)
        still = dict.fromkeys(Sample._fields, 0.0)
        still |= dict(zip(("x_m", "y_m", "yaw_rad"), start.pose, strict=True))
        still |= {"roll_rad": roll, "along_m": start.along_m, "supply_v": true.nominal_v, "odometer_gain": 1.0}
        self.sample = Sample(**still)

    def step(self, orders: ActuatorOrders, hands: DriverInput) -> BodyTick:
        """The body a tick later."""
        acting, pressure = self._acting(orders, hands)
        moved = self.vehicle.step(acting)
        before, true = self.sample, self._true
        gain = self._odometer_gain(moved)
        self.sample = Sample(
            x_m=moved.x_m,
            y_m=moved.y_m,
            yaw_rad=moved.yaw_rad,
            roll_rad=self._world.roll((moved.x_m, moved.y_m, moved.yaw_rad), moved.along_m),
            travel_m=moved.travel_m,
            along_m=moved.along_m,
            speed_mps=moved.speed_mps,
            front_rad=moved.front_rad,
            motor_rad=moved.motor_rad,
            throttle=self._lagged(before.throttle, acting.throttle, _THROTTLE_LAG_S),
            brake=self._lagged(before.brake, pressure, true.brake[3]),
            supply_v=self._supply(),
            odometer_m=before.odometer_m + gain * (moved.travel_m - before.travel_m),
            odometer_gain=gain,
            rate_bias_radps=moved.rate_bias_radps,
            heading_slow_rad=moved.heading_slow_rad,
        )
        return BodyTick(acting, moved, self.sample)

    def _acting(self, orders: ActuatorOrders, hands: DriverInput) -> tuple[Acting, float]:
        """Acting inputs, and the pressure requested of the brake's hydraulics: the parking lever has none."""
        faults = self._faults
        throttle = orders.throttle if orders.pedals else hands.throttle
        throttle = faults.number("throttle_stuck", "at", throttle)
        foot = hands.brake if hands.foot_on_brake else 0.0
        box = 0.0 if faults.has("brake_dead") else orders.brake
        # Engaging the pedals by the box releases the parking lever.
        lever = 0.0 if hands.foot_on_brake or orders.pedals else hands.brake
        acting = Acting(
            by_hand=not orders.steering,
            front_rad=orders.front_rad if orders.steering else hands.front_rad,
            throttle=0.0 if orders.cut else float(np.clip(throttle, 0.0, 1.0)),
            brake=float(np.clip(max(box, foot, lever), 0.0, 1.0)),
            supply_v=self._true.stall_v if faults.has("servo_stalled") else self._supply(),
            runaway_radps=faults.number("servo_runaway", "radps", 0.0),
            rear_rad=faults.number("rear_stuck", "rad", float("nan")),
            gear=1.0 if orders.pedals else hands.gear,
        )
        return acting, max(box, foot)

    def _supply(self) -> float:
        weak = self._faults.number("servo_weak", "supply_v", self._true.nominal_v)
        return self._faults.number("supply_sag", "v", weak)

    def _odometer_gain(self, moved: Moved) -> float:
        faults = self._faults
        if faults.has("odometer_dead"):
            return 0.0
        sign = -1.0 if faults.has("odometer_reversed") else 1.0
        return sign * (1.0 + moved.odometer_scale) * (1.0 + faults.number("odometer_slip", "share", 0.0))

    def _lagged(self, before: float, wanted: float, lag_s: float) -> float:
        return wanted + float(np.exp(-self._world.tick_s / lag_s)) * (before - wanted)


# The truth of a run: how the vehicle really went, tick by tick.

_COLUMNS = (
    "x_m",
    "y_m",
    "yaw_rad",
    "speed_mps",
    "front_rad",
    "rear_rad",
    "command_front_rad",
    "command_throttle",
    "command_brake",
    "engaged",
    "brake",
    "throttle",
)


class TruthRows:
    """Table of a run with one row per tick, at its end.

    Args:
        columns: names of the columns.
    """

    def __init__(self, columns: tuple[str, ...]) -> None:
        self._columns = columns
        self._times: list[int] = []
        self._rows: list[tuple[float, ...]] = []

    def add_row(self, time_ns: int, row: tuple[float, ...]) -> None:
        """A tick's row."""
        self._times.append(time_ns)
        self._rows.append(row)

    def arrays(self) -> dict[str, np.ndarray]:
        """Arrays by name: ``mono_ns`` and the columns."""
        table = np.array(self._rows, np.float64).reshape(-1, len(self._columns))
        columns: dict[str, np.ndarray] = dict(zip(self._columns, table.T, strict=True))
        return {"mono_ns": np.array(self._times, np.int64), **columns}

    def write(self, path: Path, figures: dict[str, float]) -> None:
        """Write a ``.npz`` of the arrays and of the run's figures, which are arrays of one number.

        Raises:
            InputError: the file cannot be written.
        """
        numbers = {name: np.asarray(value) for name, value in figures.items()}
        with atomic_output(path, force=True) as temporary, temporary.open("wb") as file:
            np.savez(file, allow_pickle=False, **self.arrays(), **numbers)


class Truth(TruthRows):
    """True motion of a vehicle on a course.

    Args:
        true: true vehicle.
        array_x_m: distance of the array ahead of the rear axle.
        baseline_m: true positions of the baseline's anchor.
    """

    def __init__(self, true: TrueVehicle, array_x_m: float, baseline_m: Float[np.ndarray, "point 2"]) -> None:
        super().__init__(_COLUMNS)
        self._true, self._array_x_m, self._baseline_m = true, array_x_m, baseline_m

    def add(self, time_ns: int, sample: Sample, acting: Acting, command: DriveCommandMessage, held: int) -> None:
        """A tick's row."""
        sound = -counter_steer_rad(self._true, sample.front_rad)
        rear = sound if np.isnan(acting.rear_rad) else acting.rear_rad
        row = (
            sample.x_m,
            sample.y_m,
            sample.yaw_rad,
            sample.speed_mps,
            sample.front_rad,
            rear,
            command.front_rad,
            command.throttle,
            command.brake,
            float(held),
            acting.brake,
            acting.throttle,
        )
        self.add_row(time_ns, row)

    def arrays(self) -> dict[str, np.ndarray]:
        """Everything by name: the columns, ``mono_ns``, ``cross_m`` of the array's centre, and ``baseline_m``."""
        columns = super().arrays()
        columns["engaged"] = columns["engaged"].astype(np.uint8)
        yaw = columns["yaw_rad"]
        anchor = np.stack(
            [columns["x_m"] + self._array_x_m * np.cos(yaw), columns["y_m"] + self._array_x_m * np.sin(yaw)], axis=1
        )
        return {**columns, "cross_m": cross_track_m(anchor, self._baseline_m), "baseline_m": self._baseline_m}
