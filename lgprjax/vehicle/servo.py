"""The steering servo: delay, dead band, lag, rate, play, and what is left of its torque at a supply voltage.

Each part is a line of its own and off at its neutral value, so that a study can switch them one by one.
"""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float


class Servo(NamedTuple):
    """A servo that turns the front wheels. Fields are scalars or one value a lane; angles are those of the wheels.

    Attributes:
        lag_s: time constant towards the command; 0 for none.
        rate_radps: fastest turning at full torque; infinite for no limit.
        delay_s: from a command to its first effect.
        dead_band_rad: what the position may differ from the command by without the motor moving.
        backlash_rad: play of the linkage, from one side to the other.
        asymmetry: share by which turning left is faster than the mean, and right slower.
        nominal_v: supply at which torque is full.
        stall_v: supply at which nothing moves.
    """

    lag_s: Float[Array, "..."]
    rate_radps: Float[Array, "..."]
    delay_s: Float[Array, "..."]
    dead_band_rad: Float[Array, "..."]
    backlash_rad: Float[Array, "..."]
    asymmetry: Float[Array, "..."]
    nominal_v: Float[Array, "..."]
    stall_v: Float[Array, "..."]


class ServoState(NamedTuple):
    """What the servo carries from step to step.

    Attributes:
        motor_rad: position of the motor, as an angle of the wheels.
        wheel_rad: of the front wheels, behind the play.
        waiting_rad: commands that have no effect yet, the newest first; as many as the longest delay has steps.
    """

    motor_rad: Float[Array, "..."]
    wheel_rad: Float[Array, "..."]
    waiting_rad: Float[Array, "slot ..."]


def ideal_servo(lag_s: float = 0.0, rate_radps: float = float("inf")) -> Servo:
    """A servo with no more than a lag and a rate, at full torque whatever the supply."""
    zero = jnp.float32(0.0)
    return Servo(jnp.float32(lag_s), jnp.float32(rate_radps), zero, zero, zero, zero, jnp.float32(1.0), zero)


def init_servo(wheel_rad: Float[Array, "..."], *, delay_slots: int = 0) -> ServoState:
    """A servo at rest. ``delay_slots`` is static: steps of the longest delay that a servo of these lanes has."""
    return ServoState(wheel_rad, wheel_rad, jnp.broadcast_to(wheel_rad, (delay_slots, *wheel_rad.shape)))


def torque_share(servo: Servo, supply_v: Float[Array, "..."]) -> Float[Array, "..."]:
    """Share of the full torque at a supply, between 0 at ``stall_v`` and 1 at ``nominal_v`` and above."""
    return jnp.clip((supply_v - servo.stall_v) / (servo.nominal_v - servo.stall_v), 0.0, 1.0)


class ServoPace(NamedTuple):
    """What of a servo does not change while its step and its torque do not.

    Attributes:
        approach: share of the way to the command that a step covers.
        left_rad, right_rad: farthest that a step turns to either side.
        play_rad: half of it.
        dead_band_rad: as in ``Servo``.
        delay_steps: delay in steps.
    """

    approach: Float[Array, "..."]
    left_rad: Float[Array, "..."]
    right_rad: Float[Array, "..."]
    play_rad: Float[Array, "..."]
    dead_band_rad: Float[Array, "..."]
    delay_steps: Float[Array, "..."]


def servo_pace(servo: Servo, share: float | Float[Array, "..."], step_s: float | Float[Array, ""]) -> ServoPace:
    """What a servo does in a step.

    Against the same load a share of the torque turns the wheels at that share of the rate, and the lag grows by its
    inverse: that is why a weak servo needs a longer look-ahead.

    Args:
        servo: its parameters.
        share: of the full torque, from ``torque_share``.
        step_s: time step.
    """
    # The exact step of a first-order lag; without a lag all of the way at once.
    slow = servo.lag_s > 0.0
    decay = jnp.exp(-step_s * share / jnp.where(slow, servo.lag_s, 1.0))
    turns = jnp.asarray(share) > 0.0
    # No torque moves nothing, where the rate knows no limit too.
    most = jnp.where(turns, servo.rate_radps * jnp.where(turns, share, 1.0) * step_s, 0.0)
    return ServoPace(
        jnp.where(slow, 1.0 - decay, jnp.where(turns, 1.0, 0.0)),
        most * (1.0 + servo.asymmetry),
        most * (1.0 - servo.asymmetry),
        0.5 * servo.backlash_rad,
        servo.dead_band_rad,
        servo.delay_s / step_s,
    )


def turn_servo(state: ServoState, pace: ServoPace, command_rad: Float[Array, "..."]) -> ServoState:
    """The servo after a step of a constant command, which is within the wheels' limits: they are not its business."""
    waiting = jnp.concatenate([command_rad[None], state.waiting_rad])
    wrong = _delayed(waiting, pace.delay_steps) - state.motor_rad
    wrong = wrong - jnp.clip(wrong, -pace.dead_band_rad, pace.dead_band_rad)
    motor = state.motor_rad + jnp.clip(wrong * pace.approach, -pace.right_rad, pace.left_rad)
    wheel = jnp.clip(state.wheel_rad, motor - pace.play_rad, motor + pace.play_rad)
    return ServoState(motor, wheel, waiting[:-1])


def step_servo(
    state: ServoState,
    servo: Servo,
    command_rad: Float[Array, "..."],
    share: float | Float[Array, "..."],
    step_s: float | Float[Array, ""],
) -> ServoState:
    """``turn_servo`` with the pace of this step: where torque or step change from one to the next."""
    return turn_servo(state, servo_pace(servo, share, step_s), command_rad)


def _delayed(waiting_rad: Float[Array, "slot ..."], steps: Float[Array, "..."]) -> Float[Array, "..."]:
    """The command of so many steps ago, linear between steps, so that a delay has a gradient; the oldest at most."""
    oldest = waiting_rad.shape[0] - 1
    if oldest == 0:
        return waiting_rad[0]
    age = jnp.broadcast_to(jnp.clip(steps, 0.0, oldest), waiting_rad.shape[1:])
    newer = jnp.minimum(jnp.floor(age), oldest - 1)
    place = newer.astype(jnp.int32)[None]
    after, before = (jnp.take_along_axis(waiting_rad, at, axis=0)[0] for at in (place, place + 1))
    return after + (age - newer) * (before - after)
