"""A vehicle that ignores small commands to turn (MF section 4), and pulses that make up for it.

The command to turn is the difference of the wheel speeds, right less left. Below the threshold the vehicle drives
straight on at the wheels' mean speed; from the threshold on it obeys in full. A controller with feedback cannot see
that: it waits until its error is large enough, then turns too far.

The compensation keeps account of the turn that was asked for and not obeyed. When half a pulse is owed, one pulse just
above the threshold is sent; on the average the vehicle turns as asked. It needs no more than a bound of the threshold:
pulses that are higher than necessary are shorter in their sum.
"""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float

from lgprjax.vehicle.skid_steer import WheelSpeeds

PULSE_S = 0.06
"""Length of a pulse, a few ticks: what it is longer is a delay to the guidance."""
_ABOVE = 1.05
"""Height of a pulse over the threshold, so that rounding does not lose it."""


class PulseState(NamedTuple):
    """What the compensation carries from step to step.

    Attributes:
        owed_m: way that the right side is still to gain on the left one, by what was asked and not obeyed.
        side: 1 in a pulse to the left, −1 to the right, 0 in none.
        left_s: how long the pulse goes on.
    """

    owed_m: Float[Array, "..."]
    side: Float[Array, "..."]
    left_s: Float[Array, "..."]


def obeyed_wheels(threshold_mps: Float[Array, "..."], wheels: WheelSpeeds) -> WheelSpeeds:
    """What a vehicle with a threshold of the wheels' difference makes of a command; 0 obeys everything."""
    mean = 0.5 * (wheels.left_mps + wheels.right_mps)
    obeys = jnp.abs(wheels.right_mps - wheels.left_mps) >= threshold_mps
    return WheelSpeeds(jnp.where(obeys, wheels.left_mps, mean), jnp.where(obeys, wheels.right_mps, mean))


def init_pulses(like: Float[Array, "..."]) -> PulseState:
    """Nothing owed; one value for each of ``like``."""
    zero = jnp.zeros_like(like)
    return PulseState(zero, zero, zero)


def step_pulses(
    threshold_mps: Float[Array, "..."], state: PulseState, asked: WheelSpeeds, step_s: Float[Array, "..."]
) -> tuple[PulseState, WheelSpeeds]:
    """State and the wheels to tell a vehicle with a threshold; ``settle_pulses`` follows when they were sent.

    A turn that the vehicle obeys passes as it is. Standing, nothing is pulsed and nothing stays owed.

    Args:
        threshold_mps: of the wheels' difference, or a little more; 0 changes nothing.
        state: of the last step.
        asked: wheels that are wanted.
        step_s: time step.
    """
    mean, turn = 0.5 * (asked.left_mps + asked.right_mps), asked.right_mps - asked.left_mps
    small = (jnp.abs(turn) < threshold_mps) & (mean != 0.0)
    height = _ABOVE * threshold_mps
    goes_on = small & (state.left_s > 0.0)
    owed = state.owed_m + turn * step_s
    starts = small & ~goes_on & (jnp.abs(owed) >= 0.5 * height * PULSE_S)
    side = jnp.where(goes_on, state.side, jnp.where(starts, jnp.sign(owed), 0.0))
    left_s = jnp.where(goes_on, state.left_s, jnp.where(starts, PULSE_S, 0.0)) - step_s
    told = jnp.where(small, side * height, turn)
    kept = PulseState(jnp.where(mean != 0.0, state.owed_m, 0.0), side, jnp.maximum(left_s, 0.0))
    return kept, WheelSpeeds(mean - 0.5 * told, mean + 0.5 * told)


def settle_pulses(
    threshold_mps: Float[Array, "..."],
    state: PulseState,
    asked: WheelSpeeds,
    sent: WheelSpeeds,
    step_s: Float[Array, "..."],
) -> PulseState:
    """The account after a step: what was asked less what the vehicle makes of what was sent.

    A limiter's ramp may keep a pulse below the threshold for some steps; the account knows. More than a pulse is never
    owed: what the limits of the wheels do not allow is not made up for later.
    """
    obeyed = obeyed_wheels(threshold_mps, sent)
    missing = (asked.right_mps - asked.left_mps) - (obeyed.right_mps - obeyed.left_mps)
    most = _ABOVE * threshold_mps * PULSE_S
    moves = asked.left_mps + asked.right_mps != 0.0
    return state._replace(owed_m=jnp.where(moves, jnp.clip(state.owed_m + missing * step_s, -most, most), 0.0))
