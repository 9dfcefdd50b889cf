"""The vehicle behind the devices: plant and navigation sensors stepped in one compiled call, faults in its parts."""

from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int, PRNGKeyArray

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
from lgprjax.scene.plant import SUBSTEPS
from lgprjax.scene.vehicle_drive import TrueVehicle, chassis_of, pedals_of, servo_of
from lgprjax.vehicle.arc import VehiclePose
from lgprjax.vehicle.chassis import MeasuredRear

GNSS_X_M = 1.0
"""Antenna ahead of the rear axle."""
_GNSS_SLOW_M = 0.3
_HAND_LAG_S, _HAND_RATE_RADPS = 0.05, 1.0


class Acting(NamedTuple):
    """What acts on the vehicle for a tick.

    Attributes:
        by_hand: the wheels are turned by the driver, not by the servo.
        front_rad: where to.
        throttle, brake: as they act.
        supply_v: of the servo.
        runaway_radps: the servo turns at this rate whatever it is told; 0 for a sound one.
        rear_rad: where the rear wheels are stuck; NaN for sound ones.
    """

    by_hand: bool
    front_rad: float
    throttle: float
    brake: float
    supply_v: float
    runaway_radps: float
    rear_rad: float


class Moved(NamedTuple):
    """The vehicle at a tick's end, pose in the map's frame, and the slow errors of its sensors.

    Attributes:
        x_m, y_m, yaw_rad: of the rear axle.
        travel_m, along_m, speed_mps: signed way, place on the terrain, speed at this moment.
        front_rad, motor_rad: front wheels, and the servo as an angle of theirs.
        rate_bias_radps, heading_slow_rad, odometer_scale: slow errors.
        gnss_east_m, gnss_north_m, gnss_valid: what the receiver says of its antenna.
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


class Vehicle:
    """A vehicle that stands at a pose.

    Args:
        true: as it is; its rear wheels follow in proportion.
        terrain: under it.
        tick_s: step.
        start: pose of the rear axle in the map's frame.
        along_m: its place on the terrain.
        seed: of the sensors' errors.
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
    ) -> None:
        assert isinstance(true.rear, float)
        self._true, self._tick_s, self._ratio = true, tick_s, true.rear
        self.sensors = live_sensors(tick_s=tick_s, gnss_x_m=GNSS_X_M, gnss_slow_m=_GNSS_SLOW_M)
        # NumPy's, as a compiled function takes them: a transfer of each would cost as much as the call.
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
        told = np.array([self._target(acting), acting.throttle, acting.brake], np.float32)
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
        ends = np.array([-self._ratio, self._ratio]) if np.isnan(acting.rear_rad) else np.full(2, -acting.rear_rad)
        # Linear between knots and beyond them: both the sound wheels and stuck ones are of one program.
        rear: Any = MeasuredRear(one(-1.0), one(2.0), ends.astype(np.float32))  # type: ignore[arg-type]
        supply: Any = one(self._true.nominal_v if acting.by_hand else acting.supply_v)
        return sound._replace(servo=servo, chassis=sound.chassis._replace(rear=rear), supply_v=supply)


@partial(jax.jit, static_argnames="tick_s")
def _step(
    fixed: tuple[Terrain, LiveSensors],
    plant: Plant,
    state: PlantState,
    errors: LiveSensorState,
    told: Float[Array, "3"],
    noise: PRNGKeyArray,
    tick: Int[Array, ""],
    tick_s: float,
) -> tuple[PlantState, LiveSensorState, Float[Array, " number"]]:
    terrain, sensors = fixed
    state = step_plant(plant, terrain, state, told[0], told[1], told[2], jnp.float32(1.0), tick_s)
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
        state.drive.speed_mps,
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
