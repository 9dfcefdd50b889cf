"""Skid-steer vehicle and sensors with error laws that the filter does not assume, to test its stated uncertainty.

The filter's errors are normal, decorrelate over distance or time, and do not depend on the ground. Here sides slip on
slopes and under the tool's load, in patches of soil; the body crabs downhill; stones kick it. GNSS has unreported
bursts of multipath, tails of Student's t, a misplaced base, misplaced antenna and tool, and fixes with wrong times. The
INS drifts as it warms up and during the day, and has a scale error; wheels are counted in whole pulses. Every field
draws its own numbers, uniform over a range.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int, PRNGKeyArray

from lgprjax.scene.plant import (
    SkidPlant,
    SkidPlantState,
    SkidReadings,
    SkidSensors,
    SkidSensorState,
    turn_wheels,
)
from lgprjax.vehicle.kinematics import VehiclePose, WheelSpeeds, body_rates, drive_skid_arc

_WAVES = 6
_TAIL_FREEDOM = 3.0
_STONES_PER_M = 0.02
_PULSE_M = 0.0002


class OtherLaws(NamedTuple):
    """Error parameters of one field, vehicle and day.

    Attributes:
        wave_radpm, wave_phase: wave vectors and phases of the ground's height, six plane waves.
        slope: slope of each wave, rise over run.
        soil_radpm, soil_phase: wave vectors and phases of the patches of soil, three waves.
        loose: increase of all slips on loose soil.
        slip_grade, slip_load, slip_bank: slip of a side per slope along, with the tool in the ground, and of the lower
            side per slope across.
        crab: sideways motion per distance and slope across.
        stone_yaw_rad, stone_m: size of the kicks of stones in heading and position.
        burst_every_s, burst_s: mean time between bursts of multipath, and mean duration.
        burst_m, burst_period_s: size and oscillation period of a burst's error.
        tail_m: scale of the fixes' white error.
        base_m: error of the base, east and north.
        mount_m, tool_m: error of the antenna's and of the tool's position in the body, forward and left.
        jitter_s: standard deviation of the fixes' time.
        warm_radps, warm_s: drift of the INS that fades as it warms up, and its time constant.
        day_radps, day_s: oscillating drift of the INS, and its period.
        turn_scale: scale error of the INS.
        wheel_scale: scale error of the wheels, left and right.
    """

    wave_radpm: Float[Array, "wave 2"]
    wave_phase: Float[Array, " wave"]
    slope: Float[Array, " wave"]
    soil_radpm: Float[Array, "3 2"]
    soil_phase: Float[Array, "3"]
    loose: Float[Array, ""]
    slip_grade: Float[Array, ""]
    slip_load: Float[Array, ""]
    slip_bank: Float[Array, ""]
    crab: Float[Array, ""]
    stone_yaw_rad: Float[Array, ""]
    stone_m: Float[Array, ""]
    burst_every_s: Float[Array, ""]
    burst_s: Float[Array, ""]
    burst_m: Float[Array, ""]
    burst_period_s: Float[Array, ""]
    tail_m: Float[Array, ""]
    base_m: Float[Array, "2"]
    mount_m: Float[Array, "2"]
    tool_m: Float[Array, "2"]
    jitter_s: Float[Array, ""]
    warm_radps: Float[Array, ""]
    warm_s: Float[Array, ""]
    day_radps: Float[Array, ""]
    day_s: Float[Array, ""]
    turn_scale: Float[Array, ""]
    wheel_scale: Float[Array, "2"]


class LawState(NamedTuple):
    """State of the error laws between ticks.

    Attributes:
        burst_left_s: remaining time of the present burst; 0 without one.
        burst_aside: direction of the burst's error.
        burst_begun_s: start time of the burst.
        pulse_m: distance driven and not yet counted, per wheel.
    """

    burst_left_s: Float[Array, ""]
    burst_aside: Float[Array, "2"]
    burst_begun_s: Float[Array, ""]
    pulse_m: Float[Array, "2"]


def draw_other_laws(key: PRNGKeyArray, *, largest_base_m: float | Float[Array, ""] = 0.10) -> OtherLaws:
    """Draw the error parameters of one field.

    Args:
        key: random key.
        largest_base_m: largest position error of the base.
    """
    keys = iter(jax.random.split(key, 40))

    def flat(low: float, high: float, shape: tuple[int, ...] = ()) -> Array:
        return jax.random.uniform(next(keys), shape, jnp.float32, low, high)

    def waves(count: int, shortest_m: float, longest_m: float) -> Array:
        length = jnp.exp(flat(float(np.log(shortest_m)), float(np.log(longest_m)), (count,)))
        turn = flat(0.0, 2.0 * np.pi, (count,))
        return (2.0 * jnp.pi / length)[:, None] * jnp.stack([jnp.cos(turn), jnp.sin(turn)], axis=1)

    steepest = flat(0.0, 0.1)
    around, away = flat(0.0, 2.0 * np.pi), jnp.sqrt(flat(0.0, 1.0)) * largest_base_m
    return OtherLaws(
        wave_radpm=waves(_WAVES, 10.0, 80.0),
        wave_phase=flat(0.0, 2.0 * np.pi, (_WAVES,)),
        slope=steepest * flat(0.2, 1.0, (_WAVES,)) * (2.0 / _WAVES) ** 0.5,
        soil_radpm=waves(3, 6.0, 30.0),
        soil_phase=flat(0.0, 2.0 * np.pi, (3,)),
        loose=flat(1.0, 2.5),
        slip_grade=flat(0.05, 0.2),
        slip_load=flat(0.0, 0.03),
        slip_bank=flat(0.0, 0.05),
        crab=flat(0.0, 0.1),
        stone_yaw_rad=flat(0.0, 0.01),
        stone_m=flat(0.0, 0.015),
        burst_every_s=flat(60.0, 400.0),
        burst_s=flat(3.0, 20.0),
        burst_m=flat(0.02, 0.10),
        burst_period_s=flat(15.0, 90.0),
        tail_m=flat(0.005, 0.012),
        base_m=away * jnp.stack([jnp.cos(around), jnp.sin(around)]),
        mount_m=flat(-0.01, 0.01, (2,)),
        tool_m=flat(-0.02, 0.02, (2,)),
        jitter_s=flat(0.0, 0.05),
        warm_radps=flat(-1e-4, 1e-4),
        warm_s=flat(200.0, 900.0),
        day_radps=flat(0.0, 3e-5),
        day_s=flat(600.0, 3600.0),
        turn_scale=flat(-0.002, 0.002),
        wheel_scale=flat(-0.03, 0.03) + flat(-0.005, 0.005, (2,)),
    )


def init_law_state() -> LawState:
    """Initial state without a burst; one batch element."""
    zero, none = jnp.float32(0.0), jnp.zeros(2, jnp.float32)
    return LawState(zero, none, zero, none)


def step_other_plant(
    laws: OtherLaws,
    plant: SkidPlant,
    state: SkidPlantState,
    command: WheelSpeeds,
    tool_on: Float[Array, ""],
    key: PRNGKeyArray,
    step_s: float,
) -> SkidPlantState:
    """The vehicle after a step with the other laws; hydraulics are those of ``plant``. One batch element.

    Args:
        laws: error parameters of the field.
        plant: vehicle, whose track, hydraulics and slide are used, and whose slips and walks are not.
        state: state before the step.
        command: commanded wheel speeds.
        tool_on: 1 with the tool in the ground.
        key: random key of this step's noise.
        step_s: step of the control loop.
    """
    waiting, wheels = turn_wheels(plant, state, command, step_s)
    pose = state.pose
    cos, sin = jnp.cos(pose.yaw_rad), jnp.sin(pose.yaw_rad)
    rise = jnp.cos(laws.wave_radpm[:, 0] * pose.x_m + laws.wave_radpm[:, 1] * pose.y_m + laws.wave_phase) * laws.slope
    unit = laws.wave_radpm / jnp.linalg.norm(laws.wave_radpm, axis=1, keepdims=True)
    east, north = jnp.sum(rise * unit[:, 0]), jnp.sum(rise * unit[:, 1])
    # Up ahead, and up to the left.
    grade, bank = cos * east + sin * north, cos * north - sin * east
    soil = jnp.sum(jnp.sin(laws.soil_radpm[:, 0] * pose.x_m + laws.soil_radpm[:, 1] * pose.y_m + laws.soil_phase))
    traction = jnp.where(soil > 0.5, laws.loose, 1.0)
    ahead = jnp.sign(wheels.left_mps + wheels.right_mps)
    common = traction * (laws.slip_grade * grade * ahead + laws.slip_load * tool_on)
    lower = traction * laws.slip_bank * bank
    slips = jnp.clip(jnp.stack([common - lower, common + lower]), -0.3, 0.3)
    ground = WheelSpeeds(wheels.left_mps * (1.0 - slips[0]), wheels.right_mps * (1.0 - slips[1]))
    speed, yaw_rate = body_rates(plant.track_m, ground)
    moved = drive_skid_arc(pose, plant.track_m, ground, jnp.float32(step_s))
    way_m = jnp.abs(speed) * step_s
    hit_key, kick_key, side_key = jax.random.split(key, 3)
    hits = jax.random.uniform(hit_key) < _STONES_PER_M * way_m
    kick = jnp.where(hits, laws.stone_yaw_rad * jax.random.laplace(kick_key), 0.0)
    thrown = jnp.where(hits, laws.stone_m * jax.random.laplace(side_key), 0.0)
    aside = thrown - traction * laws.crab * bank * way_m - plant.slide_m * traction * yaw_rate * step_s
    cos, sin = jnp.cos(moved.yaw_rad), jnp.sin(moved.yaw_rad)
    moved = VehiclePose(moved.x_m - sin * aside, moved.y_m + cos * aside, moved.yaw_rad + kick)
    return SkidPlantState(
        pose=moved,
        wheels=wheels,
        waiting=waiting,
        slip=slips,
        left_m=state.left_m + wheels.left_mps * step_s,
        right_m=state.right_m + wheels.right_mps * step_s,
        speed_mps=speed,
        yaw_rate_radps=(moved.yaw_rad - pose.yaw_rad) / step_s,
    )


def read_other_sensors(
    laws: OtherLaws,
    held: LawState,
    model: SkidSensors,
    state: SkidSensorState,
    plant: SkidPlantState,
    tick: Int[Array, ""],
    key: PRNGKeyArray,
    tick_s: float,
) -> tuple[LawState, SkidSensorState, SkidReadings]:
    """Readings at the end of a tick with the other laws; rates, ages and outages are those of ``model``.

    Args:
        laws: error parameters of the field.
        held: state of the error laws.
        model, state: properties and state of the sensors.
        plant: true state at the tick's end.
        tick: number of this tick, from 1.
        key: random key of this tick's noise.
        tick_s: length of a tick.
    """
    burst_key, long_key, way_key, tail_key, late_key, turn_key = jax.random.split(key, 6)
    time_s = tick.astype(jnp.float32) * tick_s
    begins = (held.burst_left_s <= 0.0) & (jax.random.uniform(burst_key) < tick_s / laws.burst_every_s)
    length_s = laws.burst_s * jax.random.exponential(long_key)
    turn = 2.0 * jnp.pi * jax.random.uniform(way_key)
    left_s = jnp.where(begins, length_s, jnp.maximum(held.burst_left_s - tick_s, 0.0))
    direction = jnp.where(begins, jnp.stack([jnp.cos(turn), jnp.sin(turn)]), held.burst_aside)
    begun_s = jnp.where(begins, time_s, held.burst_begun_s)
    swing = jnp.sin(2.0 * jnp.pi * (time_s - begun_s) / laws.burst_period_s + 0.8)
    burst = jnp.where(left_s > 0.0, laws.burst_m * swing, 0.0) * direction

    pose = plant.pose
    cos, sin = jnp.cos(pose.yaw_rad), jnp.sin(pose.yaw_rad)
    at = jnp.stack([model.gnss_x_m, model.gnss_y_m]) + laws.mount_m
    antenna = jnp.stack([pose.x_m + cos * at[0] - sin * at[1], pose.y_m + sin * at[0] + cos * at[1]])
    tail = laws.tail_m * jax.random.t(tail_key, _TAIL_FREEDOM, (2,))
    # A fix that was measured earlier or later than its time stamp.
    late = laws.jitter_s * jax.random.normal(late_key) * plant.speed_mps * jnp.stack([cos, sin])
    wrong = burst + tail + late + laws.base_m
    measured = jnp.where(tick % model.gnss_ticks == 0, antenna + wrong, state.measured_m)
    arrives = (tick % model.gnss_ticks == model.late_ticks % model.gnss_ticks) & (tick > model.late_ticks)
    hears = time_s % model.every_s < model.every_s - model.off_s

    speaks = tick % model.ins_ticks == 0
    span_s = model.ins_ticks.astype(jnp.float32) * tick_s
    drift = laws.warm_radps * jnp.exp(-time_s / laws.warm_s) + laws.day_radps * jnp.sin(
        2.0 * jnp.pi * time_s / laws.day_s
    )
    true_turn = pose.yaw_rad - state.commanded_rad
    ins_noise = model.ins_noise_rad * jax.random.laplace(turn_key) / 2.0**0.5
    turned = true_turn * (1.0 + laws.turn_scale) + drift * span_s + ins_noise

    ways = held.pulse_m + jnp.stack(plant.wheels) * (1.0 + laws.wheel_scale) * tick_s
    counted = jnp.trunc(ways / _PULSE_M) * _PULSE_M
    left, right = counted / tick_s
    readings = SkidReadings(
        left_mps=left,
        right_mps=right,
        gnss_m=measured,
        gnss_sigma_m=model.reported_sigma_m,
        gnss_age_s=model.late_ticks.astype(jnp.float32) * tick_s,
        gnss_valid=arrives & hears,
        turn_rad=turned,
        span_s=span_s,
        turn_valid=speaks,
    )
    executed = jnp.where(speaks, pose.yaw_rad, state.commanded_rad)
    carried = LawState(left_s, direction, begun_s, ways - counted)
    return carried, state._replace(measured_m=measured, commanded_rad=executed), readings
