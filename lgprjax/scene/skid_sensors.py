"""Sensors of a skid-steer vehicle (MF section 2): wheels, an INS that tells how far it has turned, RTK GNSS at 1 Hz."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int, PRNGKeyArray

from lgprjax.scene.skid_plant import SkidPlantState


class SkidSensors(NamedTuple):
    """What the sensors are like; float32 scalars, ticks int32.

    Attributes:
        gnss_ticks: from one fix to the next; late_ticks: from its moment to its arrival.
        gnss_x_m, gnss_y_m: antenna in the body.
        gnss_sigma_m: white error an axis; slow_sigma_m, slow_s: slow error an axis, a Gauss-Markov process.
        reported_sigma_m: what a fix says of itself, an axis.
        bias_m: error that stays, east and north; drift_mps: error that grows from the start on.
        off_s, every_s: the receiver is silent for the last ``off_s`` of every ``every_s``.
        ins_ticks: from one delta heading to the next.
        ins_noise_rad: of one; ins_drift_radps: of the INS, with a sign that is drawn.
        wheel_scale: standard deviation of what the wheels read too much by, as a share; the same on both sides.
        wheel_noise_mps: white, of a tick's reading.
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
    """Errors as they stand.

    Attributes:
        slow_m: slow error of GNSS.
        measured_m: the fix that is on its way.
        drift_radps: of the INS.
        told_rad: true heading when the INS last spoke.
        scale: of the wheels.
    """

    slow_m: Float[Array, "2"]
    measured_m: Float[Array, "2"]
    drift_radps: Float[Array, ""]
    told_rad: Float[Array, ""]
    scale: Float[Array, ""]


class SkidReadings(NamedTuple):
    """What the sensors say at the end of a tick.

    Attributes:
        left_mps, right_mps: means over the tick.
        gnss_m: antenna, east and north; gnss_sigma_m: as reported; gnss_age_s: since it was measured.
        gnss_valid: there is a new fix.
        turn_rad, span_s: by the INS since it last spoke; turn_valid: it speaks.
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
    """Errors at the start; one lane."""
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
    """Readings at the end of a tick; one lane, more by ``vmap``.

    Args:
        model, state: of the sensors.
        plant: true, at the tick's end.
        tick: number of this tick, from 1.
        key: of this tick's noise.
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
    turn = pose.yaw_rad - state.told_rad + state.drift_radps * span_s + model.ins_noise_rad * noise[4]
    left, right = (
        wheel * (1.0 + state.scale) + model.wheel_noise_mps * error
        for wheel, error in zip(plant.wheels, noise[5:], strict=True)
    )
    readings = SkidReadings(
        left,
        right,
        measured,
        model.reported_sigma_m,
        model.late_ticks.astype(jnp.float32) * tick_s,
        arrives & hears,
        turn,
        span_s,
        speaks,
    )
    told = jnp.where(speaks, pose.yaw_rad, state.told_rad)
    return SkidSensorState(slow, measured, state.drift_radps, told, state.scale), readings
