"""Throttle and brake: what a command between 0 and 1 does to the speed.

The actuator pulls a cable. Up to the pre-tension it takes up slack and nothing answers; from there on the effect grows
with the command. Friction holds the pedal when the command turns back: a reversal smaller than the dead zone has no
effect. What the pedal asks for comes with a first-order lag.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float


class Pedal(NamedTuple):
    """One pedal and what it acts on. Fields are scalars or one value a lane.

    Attributes:
        pre_tension: rising command at which the effect begins, 0 to 1: what to rest at so that the pedal answers.
        dead_zone: change of the command, after it turned back, without effect; at most the pre-tension, else the pedal
            would not come free.
        gain_mps2: acceleration, or deceleration, per unit of command beyond the pre-tension.
        lag_s: time constant of the effect; 0 for none.
    """

    pre_tension: Float[Array, "..."]
    dead_zone: Float[Array, "..."]
    gain_mps2: Float[Array, "..."]
    lag_s: Float[Array, "..."]


class Pedals(NamedTuple):
    """Both pedals and what slows the vehicle without them.

    Attributes:
        throttle, brake: the pedals.
        rolling_mps2: deceleration by rolling resistance; holds the vehicle at standstill against less.
        drag_per_s: deceleration per m/s of speed.
    """

    throttle: Pedal
    brake: Pedal
    rolling_mps2: Float[Array, "..."]
    drag_per_s: Float[Array, "..."]


class PedalState(NamedTuple):
    """What a pedal carries from step to step.

    Attributes:
        pressed: as a command beyond the pre-tension, at least 0.
        effect_mps2: acceleration, or deceleration, that it makes now.
    """

    pressed: Float[Array, "..."]
    effect_mps2: Float[Array, "..."]


class DriveState(NamedTuple):
    """Both pedals' states, and the speed that came of them: not negative, in the gear's direction."""

    throttle: PedalState
    brake: PedalState
    speed_mps: Float[Array, "..."]


def init_drive(speed_mps: Float[Array, "..."]) -> DriveState:
    """At a speed, with both pedals free."""
    free = PedalState(jnp.zeros_like(speed_mps), jnp.zeros_like(speed_mps))
    return DriveState(free, free, speed_mps)


def step_drive(
    state: DriveState,
    pedals: Pedals,
    throttle: Float[Array, "..."],
    brake: Float[Array, "..."],
    step_s: float | Float[Array, ""],
) -> tuple[DriveState, Float[Array, "..."]]:
    """State after ``step_s`` of constant commands, and the way driven meanwhile, in m.

    Exact in the lags and of second order in the drag, so that long steps do. The vehicle stands rather than roll back,
    and moves off, or stops, within a step: at the instant that a linear course of the acceleration, or of the speed,
    says.
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
    """Acceleration by a pedal over a step: at its ends, in the mean, and what its course adds to a trapezoid of way."""

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
