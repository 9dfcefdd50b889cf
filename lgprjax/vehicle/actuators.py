"""The steering servo: delay, dead band, lag, rate, play, and torque over supply voltage.

Each effect is separate and off at its neutral value, so that a study can enable them one by one.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float


class Servo(NamedTuple):
    """A servo that turns the front wheels. Fields are scalars or one value per batch element; angles are those of the
    wheels.

    Attributes:
        lag_s: time constant towards the command; 0 for none.
        rate_radps: largest rate at full torque; infinite for no limit.
        delay_s: dead time from a command to its first effect.
        dead_band_rad: difference of position and command below which the motor does not move.
        backlash_rad: play of the linkage, from side to side.
        asymmetry: share by which turning left is faster than the mean, and right is slower.
        nominal_v: supply voltage of full torque.
        stall_v: supply voltage at which the servo stalls.
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
    """State of the servo from step to step.

    Attributes:
        motor_rad: position of the motor, as an angle of the wheels.
        wheel_rad: angle of the front wheels, behind the play.
        waiting_rad: delayed commands, newest first; as many as the longest delay has steps.
    """

    motor_rad: Float[Array, "..."]
    wheel_rad: Float[Array, "..."]
    waiting_rad: Float[Array, "slot ..."]


def ideal_servo(lag_s: float = 0.0, rate_radps: float = float("inf")) -> Servo:
    """A servo with a lag and a rate only, at full torque for any supply."""
    zero = jnp.float32(0.0)
    return Servo(
        lag_s=jnp.float32(lag_s),
        rate_radps=jnp.float32(rate_radps),
        delay_s=zero,
        dead_band_rad=zero,
        backlash_rad=zero,
        asymmetry=zero,
        nominal_v=jnp.float32(1.0),
        stall_v=zero,
    )


def init_servo(wheel_rad: Float[Array, "..."], *, delay_slots: int = 0) -> ServoState:
    """A servo at rest. ``delay_slots`` is static: steps of the longest delay of these servos."""
    return ServoState(wheel_rad, wheel_rad, jnp.broadcast_to(wheel_rad, (delay_slots, *wheel_rad.shape)))


def torque_share(servo: Servo, supply_v: Float[Array, "..."]) -> Float[Array, "..."]:
    """Share of the full torque at a supply, between 0 at ``stall_v`` and 1 at ``nominal_v`` and above."""
    return jnp.clip((supply_v - servo.stall_v) / (servo.nominal_v - servo.stall_v), 0.0, 1.0)


class ServoPace(NamedTuple):
    """Quantities of a servo that are constant for a constant step and torque.

    Attributes:
        approach: share of the distance to the command that a step covers.
        left_rad, right_rad: largest turn of a step to either side.
        play_rad: half of the play.
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
    """Pace of a servo for a step.

    Against the same load a share of the torque turns the wheels at that share of the rate, and the lag grows by its
    inverse: this is why a weak servo needs a longer look-ahead.

    Args:
        servo: parameters of the servo.
        share: share of the full torque, from ``torque_share``.
        step_s: time step.
    """
    # The exact step of a first-order lag; without a lag the whole distance at once.
    slow = servo.lag_s > 0.0
    decay = jnp.exp(-step_s * share / jnp.where(slow, servo.lag_s, 1.0))
    turns = jnp.asarray(share) > 0.0
    # Zero torque moves nothing, even with an infinite rate.
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
    """The servo after a step of a constant command, which must be within the wheels' limits."""
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
    """``turn_servo`` with the pace of this step, for torque or step sizes that vary."""
    return turn_servo(state, servo_pace(servo, share, step_s), command_rad)


def _delayed(waiting_rad: Float[Array, "slot ..."], steps: Float[Array, "..."]) -> Float[Array, "..."]:
    """The command of a number of steps ago, linear between steps, so that a delay has a gradient; at most the
    oldest.
    """
    oldest = waiting_rad.shape[0] - 1
    if oldest == 0:
        return waiting_rad[0]
    age = jnp.broadcast_to(jnp.clip(steps, 0.0, oldest), waiting_rad.shape[1:])
    newer = jnp.minimum(jnp.floor(age), oldest - 1)
    place = newer.astype(jnp.int32)[None]
    after, before = (jnp.take_along_axis(waiting_rad, at, axis=0)[0] for at in (place, place + 1))
    return after + (age - newer) * (before - after)


# Throttle and brake: effect of a command between 0 and 1 on the speed.
#
# The actuator pulls a cable. Up to the pre-tension it takes up slack without effect; beyond, the effect grows with the
# command. Friction holds the pedal when the command turns back: a reversal smaller than the dead zone has no effect.
# The effect follows with a first-order lag.


class Pedal(NamedTuple):
    """One pedal and its effect. Fields are scalars or one value per batch element.

    Attributes:
        pre_tension: rising command at which the effect begins, 0 to 1: the rest position for an immediate response.
        dead_zone: change of the command, after a reversal, without effect; at most the pre-tension, else the pedal
            would not release.
        gain_mps2: acceleration, or deceleration, per unit of command beyond the pre-tension.
        lag_s: time constant of the effect; 0 for none.
    """

    pre_tension: Float[Array, "..."]
    dead_zone: Float[Array, "..."]
    gain_mps2: Float[Array, "..."]
    lag_s: Float[Array, "..."]


class Pedals(NamedTuple):
    """Both pedals, and the resistances without them.

    Attributes:
        throttle, brake: the pedals.
        rolling_mps2: deceleration by rolling resistance; keeps the vehicle at standstill against smaller accelerations.
        drag_per_s: deceleration per m/s of speed.
    """

    throttle: Pedal
    brake: Pedal
    rolling_mps2: Float[Array, "..."]
    drag_per_s: Float[Array, "..."]


class PedalState(NamedTuple):
    """State of a pedal from step to step.

    Attributes:
        pressed: pedal position, as a command beyond the pre-tension, at least 0.
        effect_mps2: present acceleration, or deceleration.
    """

    pressed: Float[Array, "..."]
    effect_mps2: Float[Array, "..."]


class DriveState(NamedTuple):
    """Both pedals' states, and the resulting speed: not negative, in the gear's direction."""

    throttle: PedalState
    brake: PedalState
    speed_mps: Float[Array, "..."]


def init_drive(speed_mps: Float[Array, "..."]) -> DriveState:
    """State at a speed, with both pedals released."""
    free = PedalState(jnp.zeros_like(speed_mps), jnp.zeros_like(speed_mps))
    return DriveState(free, free, speed_mps)


def step_drive(
    state: DriveState,
    pedals: Pedals,
    throttle: Float[Array, "..."],
    brake: Float[Array, "..."],
    step_s: float | Float[Array, ""],
) -> tuple[DriveState, Float[Array, "..."]]:
    """State after ``step_s`` of constant commands, and the distance driven meanwhile, in m.

    Exact in the lags and of second order in the drag, so that long steps are possible. The vehicle does not roll back,
    and starts or stops within a step, at the instant given by linear interpolation of the acceleration or of the speed.
    """
    throttle_state, thrust = _step_pedal(state.throttle, pedals.throttle, throttle, step_s)
    brake_state, braked = _step_pedal(state.brake, pedals.brake, brake, step_s)
    net = jax.tree.map(lambda on, off: on - off, thrust, braked)
    before, after, mean = (part - pedals.rolling_mps2 for part in (net.before_mps2, net.after_mps2, net.mean_mps2))
    held = (state.speed_mps <= 0.0) & (before < 0.0)
    late = jnp.where(after > 0.0, 0.5 * after * after / jnp.where(after > 0.0, after - before, 1.0), 0.0)
    half_drag = 0.5 * pedals.drag_per_s * step_s
    gained = jnp.where(held, late, mean) * step_s
    speed = (state.speed_mps * (1.0 - half_drag) + gained) / (1.0 + half_drag)
    stops = (speed < 0.0) & (state.speed_mps > 0.0)
    moving_share = jnp.where(stops, state.speed_mps / jnp.where(stops, state.speed_mps - speed, 1.0), 1.0)
    speed = jnp.maximum(speed, 0.0)
    way_m = 0.5 * (state.speed_mps + speed) * moving_share * step_s
    bend_m = jnp.where(held | (speed <= 0.0), 0.0, net.bend_m)
    return DriveState(throttle_state, brake_state, speed), way_m + bend_m


class _Effect(NamedTuple):
    """Acceleration by a pedal over a step: at its ends, its mean, and its correction to the trapezoidal distance."""

    before_mps2: Float[Array, "..."]
    after_mps2: Float[Array, "..."]
    mean_mps2: Float[Array, "..."]
    bend_m: Float[Array, "..."]


def _step_pedal(
    state: PedalState, pedal: Pedal, command: Float[Array, "..."], step_s: float | Float[Array, ""]
) -> tuple[PedalState, _Effect]:
    taut = command - pedal.pre_tension
    pressed = jnp.maximum(jnp.clip(state.pressed, taut, taut + pedal.dead_zone), 0.0)
    wanted = pedal.gain_mps2 * pressed
    slow = pedal.lag_s > 0.0
    lag = jnp.where(slow, pedal.lag_s, 1.0)
    left = jnp.where(slow, jnp.exp(-step_s / lag), 0.0)
    lost_s = jnp.where(slow, lag * (1.0 - left), 0.0)
    missing = state.effect_mps2 - wanted
    after = wanted + left * missing
    bend_m = missing * jnp.where(slow, lag * (step_s - lost_s) - 0.5 * lost_s * step_s, 0.0)
    return PedalState(pressed, after), _Effect(state.effect_mps2, after, wanted + missing * lost_s / step_s, bend_m)
