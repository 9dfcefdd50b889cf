"""Velocity control: throttle and brake that hold a speed.

The wanted speed is approached by a reference whose acceleration is bounded; filtered by the pedal's lag it gives the
expected speed. The required acceleration is

    a = a_reference + K_p (v_expected − v) + I + rolling + drag · v,

and the pedal model converts it to a command: pre-tension + a / gain, minus its dead zone when the pedal is released, so
that friction does not absorb it. Feedback only corrects the model's errors and grades. The integral is held while it
would push a pedal further into its stop, and the reference never leads the vehicle by more than a bound: a hill that
was too steep causes no overshoot. Speeds count in the gear's direction; at most one pedal is ever pressed.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int32

from lgprjax.vehicle import Pedal, Pedals

_REVERSAL_SHARE = 0.2
"""Share of a pedal's dead zone by which the request must reverse before the command does."""


class VelocitySettings(NamedTuple):
    """Settings of the velocity controller, float32 scalars or one value per batch element.

    Attributes:
        proportional_per_s: K_p, acceleration per m/s of error.
        integral_per_s2: growth of the integral's acceleration per m/s of error.
        rise_mps2, fall_mps2: largest acceleration and deceleration of the reference.
        lead_mps: largest lead of the reference over the speed, above it or, when slowing down, below.
        press_mps2: requested acceleration above which a pedal is pressed; it is released without a request, and in
            between the vehicle coasts.
        hold_brake: command of the brake at standstill.
        standing_mps: speed below which the vehicle is at standstill.
        stop_mps2: deceleration of a controlled stop.
        stop_rise_mps3: rate at which a controlled stop reaches its deceleration.
    """

    proportional_per_s: Float[Array, "..."]
    integral_per_s2: Float[Array, "..."]
    rise_mps2: Float[Array, "..."]
    fall_mps2: Float[Array, "..."]
    lead_mps: Float[Array, "..."]
    press_mps2: Float[Array, "..."]
    hold_brake: Float[Array, "..."]
    standing_mps: Float[Array, "..."]
    stop_mps2: Float[Array, "..."]
    stop_rise_mps3: Float[Array, "..."]


class Pressed(NamedTuple):
    """The model's state of a pedal.

    Attributes:
        amount: command beyond the pre-tension that acts.
        side: 1 while it is pressed further, −1 while it is released: the side of the friction hysteresis.
    """

    amount: Float[Array, "..."]
    side: Float[Array, "..."]


class VelocityState(NamedTuple):
    """State of the velocity controller from step to step.

    Attributes:
        reference_mps: present reference speed.
        expected_mps: reference filtered by the pedal's lag.
        integral_mps2: integral of the feedback.
        pedal: 1 with the throttle pressed, −1 with the brake, 0 with neither.
        throttle, brake: pedal positions; a controlled stop begins with the present brake.
    """

    reference_mps: Float[Array, "..."]
    expected_mps: Float[Array, "..."]
    integral_mps2: Float[Array, "..."]
    pedal: Int32[Array, "..."]
    throttle: Pressed
    brake: Pressed


def default_velocity() -> VelocitySettings:
    """Settings for a heavy vehicle with a pedal lag of half a second or so: gentle, and stable with twice that lag.

    A stop at 1.5 m/s² is firmer than driving and gentle enough for a standing passenger.
    """
    values = (1.3, 0.25, 0.8, 1.0, 1.0, 0.08, 0.4, 0.05, 1.5, 1.5)
    return VelocitySettings(*(jnp.float32(value) for value in values))


def init_velocity(speed_mps: Float[Array, "..."]) -> VelocityState:
    """State at a speed, with zero integral and no pedal pressed."""
    free = _free(speed_mps)
    return VelocityState(speed_mps, speed_mps, free.amount, jnp.zeros(speed_mps.shape, jnp.int32), free, free)


def follow_speed(state: VelocityState, speed_mps: Float[Array, "..."]) -> VelocityState:
    """State of a step in which the operator drives the pedals: that of the vehicle; a NaN speed keeps the last one."""
    known = jnp.isfinite(speed_mps)
    free = _free(state.reference_mps)
    return _pick(known, init_velocity(jnp.where(known, speed_mps, 0.0)), state._replace(throttle=free, brake=free))


def step_velocity(
    settings: VelocitySettings,
    pedals: Pedals,
    state: VelocityState,
    wanted_mps: Float[Array, "..."],
    speed_mps: Float[Array, "..."],
    active: Bool[Array, "..."],
    step_s: Float[Array, "..."],
) -> tuple[VelocityState, Float[Array, "..."], Float[Array, "..."]]:
    """State, throttle and brake (0 to 1) of one step.

    When not active, both commands are 0 and the state follows the vehicle: the first active step starts from the
    present speed, with the throttle that the model needs to keep it. A NaN speed presses nothing and does not change
    the state.

    Args:
        settings: settings of the controller.
        pedals: model of both pedals.
        state: state of the last step.
        wanted_mps: speed to hold; 0: stop, then hold.
        speed_mps: speed in the gear's direction.
        active: whether the autopilot controls the pedals.
        step_s: time step.
    """
    known = jnp.isfinite(speed_mps) & jnp.isfinite(wanted_mps)
    speed = jnp.where(known, speed_mps, state.reference_mps)
    wanted = jnp.maximum(jnp.where(known, wanted_mps, state.reference_mps), 0.0)
    change = jnp.clip(wanted - state.reference_mps, -settings.fall_mps2 * step_s, settings.rise_mps2 * step_s)
    moved = state.reference_mps + change
    reference = jnp.minimum(moved, speed + settings.lead_mps)
    reference = jnp.where(moved > wanted, jnp.maximum(reference, speed - settings.lead_mps), reference)
    lag_s = jnp.where(state.pedal < 0, pedals.brake.lag_s, pedals.throttle.lag_s)
    expected = reference + (state.expected_mps - reference) * jnp.where(
        lag_s > 0.0, jnp.exp(-step_s / jnp.where(lag_s > 0.0, lag_s, 1.0)), 0.0
    )
    missing = expected - speed
    resisted = pedals.rolling_mps2 + pedals.drag_per_s * speed
    # A reference that follows the vehicle has no acceleration of its own to feed forward.
    fed = jnp.where(moved == reference, change / step_s, 0.0)
    requested = fed + settings.proportional_per_s * missing + state.integral_mps2 + resisted
    pedal = _choose_pedal(state.pedal, requested, settings.press_mps2)
    throttle_pressed, throttle = _press(pedals.throttle, state.throttle, requested, pedal > 0)
    brake_pressed, brake = _press(pedals.brake, state.brake, -requested, pedal < 0)
    stuck = ((throttle >= 1.0) & (missing > 0.0)) | ((brake >= 1.0) & (missing < 0.0))
    integral = state.integral_mps2 + jnp.where(stuck, 0.0, settings.integral_per_s2 * missing * step_s)
    stands = (wanted <= 0.0) & (speed < settings.standing_mps)
    driven = VelocityState(reference, expected, integral, pedal, throttle_pressed, brake_pressed)
    throttle, brake = jnp.where(stands, 0.0, throttle), jnp.where(stands, settings.hold_brake, brake)
    held = Pressed(settings.hold_brake - pedals.brake.pre_tension, jnp.ones_like(brake))
    # The integral learnt on a grade while rolling does not apply to moving off.
    standing = init_velocity(jnp.zeros_like(speed))._replace(pedal=jnp.full_like(pedal, -1), brake=held)
    drives = active & known
    undriven = follow_speed(state, jnp.where(known, speed_mps, jnp.nan))
    after = _pick(drives, _pick(stands, standing, driven), undriven)
    return after, jnp.where(drives, throttle, 0.0), jnp.where(drives, brake, 0.0)


def step_stop(
    settings: VelocitySettings,
    pedals: Pedals,
    state: VelocityState,
    speed_mps: Float[Array, "..."],
    step_s: Float[Array, "..."],
) -> tuple[VelocityState, Float[Array, "..."], Float[Array, "..."]]:
    """State, throttle and brake of one step of a controlled stop: throttle idle, brake by the model, ramped.

    It does not feed back the speed, which may have been lost: the brake's deceleration rises from its present value to
    ``stop_mps2``. The speed only accounts for rolling resistance and drag, and detects standstill; without it the brake
    does everything.
    """
    rolls = speed_mps > 0.0
    resisted = jnp.where(rolls, pedals.rolling_mps2 + pedals.drag_per_s * jnp.where(rolls, speed_mps, 0.0), 0.0)
    gain = pedals.brake.gain_mps2
    braking = state.brake.amount * gain
    most = jnp.maximum(settings.stop_mps2 - resisted, 0.0)
    # Harder braking already under way continues.
    requested = jnp.maximum(jnp.minimum(braking + settings.stop_rise_mps3 * step_s, most), braking)
    pressed, command = _press(pedals.brake, state.brake, requested, jnp.ones(braking.shape, jnp.bool_))
    stands = speed_mps < settings.standing_mps
    brake = jnp.where(stands, jnp.maximum(settings.hold_brake, command), command)
    reference = jnp.where(jnp.isfinite(speed_mps), speed_mps, state.reference_mps)
    free = _free(reference)
    after = VelocityState(reference, reference, free.amount, jnp.full_like(state.pedal, -1), free, pressed)
    return after, jnp.zeros_like(brake), brake


def _free(like: Float[Array, "..."]) -> Pressed:
    return Pressed(jnp.zeros_like(like), jnp.ones_like(like))


def _press(
    pedal: Pedal, was: Pressed, effect_mps2: Float[Array, "..."], chosen: Bool[Array, "..."]
) -> tuple[Pressed, Float[Array, "..."]]:
    """Position of a pedal, and its command: the inverse of its onset, gain and friction; released if not chosen.

    A reversal costs the dead zone twice, so that it is made only for more than a share of it.
    """
    wanted = jnp.clip(effect_mps2 / pedal.gain_mps2, 0.0, 1.0 - pedal.pre_tension)
    change = wanted - was.amount
    moves = (change * was.side >= 0.0) | (jnp.abs(change) > _REVERSAL_SHARE * pedal.dead_zone)
    amount = jnp.where(moves, wanted, was.amount)
    side = jnp.where(moves & (change != 0.0), jnp.sign(change), was.side)
    command = pedal.pre_tension + amount - jnp.where(side < 0.0, pedal.dead_zone, 0.0)
    free = _free(amount)
    pressed = Pressed(jnp.where(chosen, amount, free.amount), jnp.where(chosen, side, free.side))
    return pressed, jnp.where(chosen, jnp.clip(command, 0.0, 1.0), 0.0)


def _choose_pedal(
    pedal: Int32[Array, "..."], requested_mps2: Float[Array, "..."], press_mps2: Float[Array, "..."]
) -> Int32[Array, "..."]:
    """The pedal to press: the present one as long as it is needed, a new one only beyond the dead zone."""
    stays = jnp.sign(requested_mps2).astype(jnp.int32) == pedal
    pressed = jnp.where(requested_mps2 > press_mps2, 1, jnp.where(requested_mps2 < -press_mps2, -1, 0))
    return jnp.where(stays, pedal, pressed).astype(jnp.int32)


def _pick(choice: Bool[Array, "..."], chosen: VelocityState, other: VelocityState) -> VelocityState:
    picked: VelocityState = jax.tree.map(lambda one, two: jnp.where(choice, one, two), chosen, other)
    return picked
