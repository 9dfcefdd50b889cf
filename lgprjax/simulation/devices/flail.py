"""The skid-steer vehicle behind the devices: plant and navigation sensors stepped in one compiled call."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int, PRNGKeyArray

from lgprjax.scene.skid_plant import SkidPlant, SkidPlantState, default_skid_plant, init_skid_plant, step_skid_plant
from lgprjax.scene.skid_sensors import (
    SkidSensors,
    SkidSensorState,
    default_skid_sensors,
    init_skid_sensors,
    read_skid_sensors,
)
from lgprjax.vehicle.arc import VehiclePose
from lgprjax.vehicle.skid_steer import WheelSpeeds

TICK_S = 0.01
_DELAY_SLOTS = 12


class FlailMoved(NamedTuple):
    """The vehicle at a tick's end, in the plan's frame, and what its sensors say.

    Attributes:
        x_m, y_m, yaw_rad, speed_mps: true, of the reference point.
        left_mps, right_mps: of the tracks, as measured.
        gnss_east_m, gnss_north_m, gnss_sigma_m, gnss_age_s, gnss_valid: of the antenna.
        turn_rad, span_s, turn_valid: by the INS since it last spoke.
    """

    x_m: float
    y_m: float
    yaw_rad: float
    speed_mps: float
    left_mps: float
    right_mps: float
    gnss_east_m: float
    gnss_north_m: float
    gnss_sigma_m: float
    gnss_age_s: float
    gnss_valid: float
    turn_rad: float
    span_s: float
    turn_valid: float


class Flail:
    """A vehicle that stands at a pose.

    Args:
        track_m: effective.
        gnss_x_m, gnss_y_m: antenna in the body.
        threshold_mps: its control threshold; 0 obeys everything.
        start: pose of the reference point in the plan's frame.
        wheel_scale: what the tracks' sensors read too much by, as a share.
        seed: of slips and errors.
    """

    def __init__(
        self,
        *,
        track_m: float,
        gnss_x_m: float,
        gnss_y_m: float,
        threshold_mps: float,
        start: tuple[float, float, float],
        wheel_scale: float,
        seed: int,
    ) -> None:
        plant = default_skid_plant(track_m=track_m)._replace(threshold_mps=jnp.float32(threshold_mps))
        sensors = default_skid_sensors(tick_s=TICK_S, gnss_x_m=gnss_x_m, gnss_y_m=gnss_y_m)
        # NumPy's, as a compiled function takes them: a transfer of each would cost as much as the call.
        self._fixed: tuple[SkidPlant, SkidSensors] = jax.tree.map(np.asarray, (plant, sensors))
        slips, errors, self._noise = jax.random.split(jax.random.key(seed), 3)
        pose = VehiclePose(*(jnp.float32(number) for number in start))
        self._plant = init_skid_plant(plant, pose, slips, delay_slots=_DELAY_SLOTS)
        drawn = init_skid_sensors(sensors, pose.yaw_rad, errors)
        self._sensors = drawn._replace(scale=jnp.float32(wheel_scale))
        self._tick = 0

    def step(self, left_mps: float, right_mps: float) -> FlailMoved:
        """The vehicle a tick later."""
        self._tick += 1
        told = np.array([left_mps, right_mps], np.float32)
        self._plant, self._sensors, row = _step(
            self._fixed, self._plant, self._sensors, told, self._noise, np.int32(self._tick)
        )
        return FlailMoved._make(np.asarray(row, np.float64).tolist())


@jax.jit
def _step(
    fixed: tuple[SkidPlant, SkidSensors],
    plant: SkidPlantState,
    sensors: SkidSensorState,
    told: Float[Array, "2"],
    noise: PRNGKeyArray,
    tick: Int[Array, ""],
) -> tuple[SkidPlantState, SkidSensorState, Float[Array, " number"]]:
    moves, reads = jax.random.split(jax.random.fold_in(noise, tick))
    plant = step_skid_plant(fixed[0], plant, WheelSpeeds(told[0], told[1]), moves, TICK_S)
    sensors, readings = read_skid_sensors(fixed[1], sensors, plant, tick, reads, TICK_S)
    row = [
        *plant.pose,
        plant.speed_mps,
        readings.left_mps,
        readings.right_mps,
        readings.gnss_m[0],
        readings.gnss_m[1],
        readings.gnss_sigma_m,
        readings.gnss_age_s,
        readings.gnss_valid,
        readings.turn_rad,
        readings.span_s,
        readings.turn_valid,
    ]
    return plant, sensors, jnp.stack([jnp.asarray(number).astype(jnp.float32) for number in row])
