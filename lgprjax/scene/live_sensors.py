"""Navigation sensors in a closed loop: GNSS, gyro, INS heading and wheel odometry, tick by tick, and their faults.

The way is not known beforehand, so errors are drawn as it is driven. Every error is a first-order Gauss-Markov process,
a random walk or white; one lane, more by ``vmap``.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int, PRNGKeyArray

from lgprjax.scene.live_faults import SensorFaults, during
from lgprjax.vehicle.arc import VehiclePose


class LiveSensors(NamedTuple):
    """What the sensors are like. Scalars or one value a lane.

    Attributes:
        gnss_ticks: ticks from one position to the next.
        gnss_x_m, gnss_y_m: antenna in the body, forward and left of the rear axle.
        gnss_sigma_m: white error an axis.
        gnss_slow_m, gnss_slow_s: sigma an axis and time constant of the slow error, against the map's frame.
        yaw_rate_noise: white noise of the gyro, rad/s/√Hz.
        rate_bias_radps, rate_bias_walk: sigma at the start; rad/s/√s.
        heading_sigma_rad: white error of the INS heading.
        heading_slow_rad, heading_slow_s: its slow error.
        odometer_mps: white error of the speed by the wheels.
        odometer_scale, odometer_scale_walk: sigma of the scale at the start; 1/√s.
    """

    gnss_ticks: Int[Array, "..."]
    gnss_x_m: Float[Array, "..."]
    gnss_y_m: Float[Array, "..."]
    gnss_sigma_m: Float[Array, "..."]
    gnss_slow_m: Float[Array, "..."]
    gnss_slow_s: Float[Array, "..."]
    yaw_rate_noise: Float[Array, "..."]
    rate_bias_radps: Float[Array, "..."]
    rate_bias_walk: Float[Array, "..."]
    heading_sigma_rad: Float[Array, "..."]
    heading_slow_rad: Float[Array, "..."]
    heading_slow_s: Float[Array, "..."]
    odometer_mps: Float[Array, "..."]
    odometer_scale: Float[Array, "..."]
    odometer_scale_walk: Float[Array, "..."]


class LiveSensorState(NamedTuple):
    """Errors as they stand, and the last position that the receiver gave: a frozen one repeats it."""

    gnss_slow_m: Float[Array, "... 2"]
    rate_bias_radps: Float[Array, "..."]
    heading_slow_rad: Float[Array, "..."]
    odometer_scale: Float[Array, "..."]
    last_gnss_m: Float[Array, "... 2"]


class Readings(NamedTuple):
    """What the sensors say at the end of a tick.

    Attributes:
        gnss_m: antenna, east and north.
        gnss_valid: there is a new position.
        yaw_rate_radps: mean over the tick.
        heading_rad: yaw of the body.
        heading_valid: the INS gives one.
        odometer_mps: mean forward speed over the tick.
        odometer_valid: the wheels are counted.
    """

    gnss_m: Float[Array, "... 2"]
    gnss_valid: Bool[Array, "..."]
    yaw_rate_radps: Float[Array, "..."]
    heading_rad: Float[Array, "..."]
    heading_valid: Bool[Array, "..."]
    odometer_mps: Float[Array, "..."]
    odometer_valid: Bool[Array, "..."]


def live_sensors(
    *, tick_s: float, gnss_x_m: float = 0.0, gnss_y_m: float = 0.0, gnss_slow_m: float = 0.03, gnss_hz: float = 7.0
) -> LiveSensors:
    """RTK GNSS with a MEMS INS and wheel odometry, of usual grades: assumptions, no maker's figures.

    Args:
        tick_s: of the loop.
        gnss_x_m, gnss_y_m: antenna in the body.
        gnss_slow_m: how far the position wanders from the map's frame.
        gnss_hz: rate of positions, rounded to whole ticks.
    """
    one = jnp.float32
    return LiveSensors(
        gnss_ticks=jnp.int32(max(round(1.0 / (gnss_hz * tick_s)), 1)),
        gnss_x_m=one(gnss_x_m),
        gnss_y_m=one(gnss_y_m),
        gnss_sigma_m=one(0.01),
        gnss_slow_m=one(gnss_slow_m),
        gnss_slow_s=one(60.0),
        yaw_rate_noise=one(2e-4),
        rate_bias_radps=one(0.002),
        rate_bias_walk=one(1e-5),
        heading_sigma_rad=one(0.001),
        heading_slow_rad=one(0.002),
        heading_slow_s=one(60.0),
        odometer_mps=one(0.03),
        odometer_scale=one(0.005),
        odometer_scale_walk=one(1e-4),
    )


def init_live_sensors(model: LiveSensors, key: PRNGKeyArray) -> LiveSensorState:
    """Errors at the start of a drive; one lane."""
    slow, bias, heading, scale = jax.random.split(key, 4)
    return LiveSensorState(
        model.gnss_slow_m * jax.random.normal(slow, (2,)),
        model.rate_bias_radps * jax.random.normal(bias),
        model.heading_slow_rad * jax.random.normal(heading),
        model.odometer_scale * jax.random.normal(scale),
        jnp.zeros(2, jnp.float32),
    )


def read_live_sensors(
    model: LiveSensors,
    faults: SensorFaults,
    state: LiveSensorState,
    key: PRNGKeyArray,
    pose: VehiclePose,
    speed_mps: Float[Array, ""],
    yaw_rate_radps: Float[Array, ""],
    tick: Int[Array, ""],
    tick_s: float,
) -> tuple[LiveSensorState, Readings]:
    """Readings at the end of a tick; one lane.

    Args:
        model, faults: the sensors, and what is wrong with them when.
        state: of their errors.
        key: of this tick's noise.
        pose: true, of the rear axle, at the tick's end.
        speed_mps, yaw_rate_radps: true, means over the tick.
        tick: number of this tick, from 1.
        tick_s: length of a tick.
    """
    noise = jax.random.normal(key, (10,))
    time_s = tick.astype(jnp.float32) * tick_s
    root_s = tick_s**0.5
    slow = _gauss_markov(state.gnss_slow_m, noise[:2], model.gnss_slow_m, tick_s / model.gnss_slow_s)
    heading_slow = _gauss_markov(
        state.heading_slow_rad, noise[2], model.heading_slow_rad, tick_s / model.heading_slow_s
    )
    bias = state.rate_bias_radps + model.rate_bias_walk * root_s * noise[3]
    scale = state.odometer_scale + model.odometer_scale_walk * root_s * noise[4]
    cos, sin = jnp.cos(pose.yaw_rad), jnp.sin(pose.yaw_rad)
    antenna = jnp.stack(
        [
            pose.x_m + cos * model.gnss_x_m - sin * model.gnss_y_m,
            pose.y_m + sin * model.gnss_x_m + cos * model.gnss_y_m,
        ]
    )
    wrong = jnp.where(time_s >= faults.gnss_jump_s, faults.gnss_jump_m, 0.0)
    drifting_s = jnp.maximum(time_s - faults.gnss_drift_s, 0.0)
    wrong += jnp.where(jnp.isfinite(faults.gnss_drift_s), faults.gnss_drift_mps * drifting_s, 0.0)
    told = antenna + slow + model.gnss_sigma_m * noise[5:7] + wrong
    due = tick % model.gnss_ticks == 0
    told = jnp.where(during(faults.gnss_frozen_s, time_s) | ~due, state.last_gnss_m, told)
    readings = Readings(
        told,
        due & ~during(faults.gnss_lost_s, time_s),
        yaw_rate_radps + bias + model.yaw_rate_noise / root_s * noise[7],
        pose.yaw_rad + heading_slow + model.heading_sigma_rad * noise[8],
        ~during(faults.heading_lost_s, time_s),
        speed_mps * (1.0 + scale) * jnp.where(during(faults.slip_s, time_s), 1.0 + faults.slip, 1.0)
        + model.odometer_mps * noise[9],
        ~during(faults.odometer_lost_s, time_s),
    )
    return LiveSensorState(slow, bias, heading_slow, scale, told), readings


def _gauss_markov(
    value: Float[Array, "*axis"], noise: Float[Array, "*axis"], sigma: Float[Array, ""], share: Float[Array, ""]
) -> Float[Array, "*axis"]:
    keep = jnp.exp(-share)
    return keep * value + jnp.sqrt(1.0 - keep * keep) * sigma * noise
