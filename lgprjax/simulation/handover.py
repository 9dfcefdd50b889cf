"""When the simulated driver of a closed loop hands over to the computer, and that a stop goes on: for every vehicle."""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Bool


class Handover(NamedTuple):
    """Who drives a vehicle in the next tick.

    Attributes:
        engaged: the computer does; it was never taken from it.
        stopping: it was told to stop: that goes on when the reason is gone, as in the mode machine.
    """

    engaged: Bool[Array, "..."]
    stopping: Bool[Array, "..."]


def init_handover() -> Handover:
    """The driver drives."""
    return Handover(jnp.asarray(False), jnp.asarray(False))


def step_handover(handover: Handover, *, sound: Bool[Array, "..."], stop: Bool[Array, "..."]) -> Handover:
    """After a tick.

    Args:
        handover: that the tick was driven with.
        sound: the driver sees no reason not to engage.
        stop: the tick asked for a stop; before the computer drives that says nothing.
    """
    return Handover(handover.engaged | sound, handover.stopping | (handover.engaged & stop))
