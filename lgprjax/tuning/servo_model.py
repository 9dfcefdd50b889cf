"""A log of the servo as its model sees it, and the model's wheel angle as a function of the numbers sought."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from lgprjax.tuning.estimate import NotExcitedError
from lgprjax.vehicle.servo import Servo, ServoState, init_servo, step_servo, torque_share
from lgprjax.vehicle.signals import DriveSignals

NAMES = ("lag_s", "delay_s", "dead_band_rad", "rate_radps", "asymmetry", "zero_rad")
"""What is sought: of the servo, and what the wheel angle sensor reads where the wheels stand straight."""
LOW = np.array([0.003, 0.0, 0.0, 0.02, -0.5, -0.1])
HIGH = np.array([1.5, 0.5, 0.1, 5.0, 0.5, 0.1])
_BY_FACTOR = np.array([True, False, False, True, False, False])
STEP_S = 0.01
_LEAST_S = 5.0
_SETTLING_S = 2.0
_LONGEST_GAP_S = 0.2


class ServoLog(NamedTuple):
    """Commands on the model's steps, and where the records lie between them.

    Attributes:
        servo: what is not sought: play, and what is left of the torque.
        command_rad, share: what holds from each step on.
        at: steps from the first to each record.
        used: records that count: not those for which the model does not know the state.
        start_rad: of the wheels.
    """

    servo: Servo
    command_rad: Float[Array, " step"]
    share: Float[Array, " step"]
    at: Float[Array, " record"]
    used: Bool[Array, " record"]
    start_rad: Float[Array, ""]


def servo_log(signals: DriveSignals, measured_rad: Float[np.ndarray, " record"], servo: Servo) -> ServoLog:
    """A command holds from its record to the next; through a gap the last one does, and what follows does not count.

    Args:
        signals: with commands and, where the servo's torque depends on it, the supply.
        measured_rad: front wheel angle of every record.
        servo: its play and voltages.

    Raises:
        NotExcitedError: commands are missing or hardly vary, or the log is too short.
    """
    if signals.command_rad is None:
        raise NotExcitedError("servo", "steering commands", "none in the log")
    known = np.isfinite(signals.command_rad) & np.isfinite(signals.time_s)
    time_s, command = signals.time_s[known], signals.command_rad[known]
    if len(time_s) < 50 or time_s[-1] - time_s[0] < _LEAST_S:
        raise NotExcitedError("servo", f"{_LEAST_S:g} s of commands, 50 of them", f"{len(time_s)} commands")
    if np.ptp(command) < 0.02:
        raise NotExcitedError("servo", "commands over 0.02 rad or more", f"over {np.ptp(command):.4f} rad")
    steps = int(np.ceil((time_s[-1] - time_s[0]) / STEP_S)) + 1
    step_time_s = time_s[0] + STEP_S * np.arange(steps)
    held = np.searchsorted(time_s, step_time_s + 1e-6, side="right") - 1
    share = np.ones(len(time_s))
    if signals.supply_v is not None:
        share = np.asarray(torque_share(servo, jnp.asarray(signals.supply_v[known], jnp.float32)), np.float64)
    at = np.clip((signals.time_s - time_s[0]) / STEP_S, 0.0, steps - 1.0)
    gaps = np.flatnonzero(np.diff(time_s) > _LONGEST_GAP_S)
    settled = signals.time_s > time_s[0] + 0.25 * _SETTLING_S
    for gap in gaps:
        settled &= (signals.time_s <= time_s[gap]) | (signals.time_s > time_s[gap + 1] + _SETTLING_S)
    used = settled & np.isfinite(measured_rad)
    if used.sum() < 50:
        raise NotExcitedError("servo", "50 wheel angles or more between gaps", f"{used.sum()}")
    first = measured_rad[np.isfinite(measured_rad)][:5]
    return ServoLog(
        servo,
        jnp.asarray(command[held], jnp.float32),
        jnp.asarray(share[held], jnp.float32),
        jnp.asarray(at, jnp.float32),
        jnp.asarray(used),
        jnp.float32(np.median(first)),
    )


def from_box(u: Float[Array, "6"]) -> Float[Array, "6"]:
    """The numbers at a place in the box [-1, 1]: lag and rate by factors, the others evenly."""
    low, high = jnp.asarray(LOW, jnp.float32), jnp.asarray(HIGH, jnp.float32)
    share = 0.5 * (u + 1.0)
    ratio = jnp.where(_BY_FACTOR, high / jnp.where(_BY_FACTOR, low, 1.0), 1.0)
    return jnp.where(_BY_FACTOR, low * ratio**share, low + share * (high - low))


def to_box(value: Float[np.ndarray, "*lane 6"]) -> Float[np.ndarray, "*lane 6"]:
    """The place of numbers in the box."""
    factor = np.log(np.where(_BY_FACTOR, value / np.where(_BY_FACTOR, LOW, 1.0), 1.0)) / np.log(
        np.where(_BY_FACTOR, HIGH / np.where(_BY_FACTOR, LOW, 1.0), 2.0)
    )
    return np.asarray(2.0 * np.where(_BY_FACTOR, factor, (value - LOW) / (HIGH - LOW)) - 1.0)


def per_box(u: Float[np.ndarray, "*lane 6"]) -> Float[np.ndarray, "*lane 6"]:
    """Derivative of the numbers by the place in the box."""
    share = 0.5 * (u + 1.0)
    ratio = np.where(_BY_FACTOR, HIGH / np.where(_BY_FACTOR, LOW, 1.0), 2.0)
    return np.asarray(0.5 * np.where(_BY_FACTOR, LOW * ratio**share * np.log(ratio), HIGH - LOW))


def wheel_angles(log: ServoLog, u: Float[Array, "6"]) -> Float[Array, " record"]:
    """What the sensor would read at the records, for the numbers at a place in the box.

    A servo that hears its commands late does all that it does late: the delay is taken of the angles, between steps
    too. Blended commands, at the rate's limit, would hide what part of a step it is.
    """
    lag, delay, dead_band, rate, asymmetry, zero = from_box(u)
    servo = log.servo._replace(
        lag_s=lag, rate_radps=rate, delay_s=jnp.zeros_like(lag), dead_band_rad=dead_band, asymmetry=asymmetry
    )

    def step(state: ServoState, told: tuple[Array, Array]) -> tuple[ServoState, Array]:
        return step_servo(state, servo, told[0], told[1], STEP_S), state.wheel_rad

    _, wheel = jax.lax.scan(step, init_servo(log.start_rad - zero), (log.command_rad, log.share))
    at = jnp.clip(log.at - delay / STEP_S, 0.0, len(wheel) - 1.0)
    before = jnp.clip(jnp.floor(at), 0.0, len(wheel) - 2.0)
    index = before.astype(jnp.int32)
    low, high = wheel[index], wheel[index + 1]
    angles: Float[Array, " record"] = low + (at - before) * (high - low) + zero
    return angles
