"""Handover from the simulated driver of a closed loop to the computer, and persistence of stops, for every vehicle."""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Bool


class Handover(NamedTuple):
    """Driver of the vehicle in the next tick.

    Attributes:
        engaged: whether the computer drives; once engaged, it stays so.
        stopping: whether the computer has a stop command, which persists without its reason, as in the mode machine.
    """

    engaged: Bool[Array, "..."]
    stopping: Bool[Array, "..."]


def init_handover() -> Handover:
    """Initial state: the driver drives."""
    return Handover(jnp.asarray(False), jnp.asarray(False))


def step_handover(handover: Handover, *, sound: Bool[Array, "..."], stop: Bool[Array, "..."]) -> Handover:
    """State after a tick.

    Args:
        handover: state during the tick.
        sound: whether the driver has no reason against engaging.
        stop: whether the tick commanded a stop, which has no effect before the computer drives.
    """
    return Handover(handover.engaged | sound, handover.stopping | (handover.engaged & stop))
