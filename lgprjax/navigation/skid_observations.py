"""What the filter of a skid-steer vehicle is given in a tick: wheel speeds, and at most one fix and one delta heading.

Each source comes at its own rate and time (MF section 2): wheels every tick, the INS ten times a second, GNSS once. A
slot that is not valid may hold anything, NaN too.
"""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from lgprjax.navigation.observations import GnssObservation

SKID_SOURCES = ("gnss", "heading")
"""Sources in the order in which arrays over sources count: the first two of ``SOURCES``."""


class SkidMotion(NamedTuple):
    """Wheel speeds as measured, means over the tick.

    Attributes:
        left_mps, right_mps: negative backwards.
        step_s: length of the tick.
    """

    left_mps: Float[Array, "..."]
    right_mps: Float[Array, "..."]
    step_s: Float[Array, "..."]


class DeltaHeading(NamedTuple):
    """How far the INS says that the body has turned, counter-clockwise.

    Attributes:
        turn_rad: since the one before it.
        span_s: the time from that one to this one, by the INS.
        valid: whether one ended within the tick.
    """

    turn_rad: Float[Array, "..."]
    span_s: Float[Array, "..."]
    valid: Bool[Array, "..."]


class SkidObservations(NamedTuple):
    """A tick's slots."""

    gnss: GnssObservation
    delta_heading: DeltaHeading


def no_skid_observations() -> SkidObservations:
    """One lane's slots, both empty."""
    zero, no = jnp.float32(0.0), jnp.asarray(False)
    return SkidObservations(
        GnssObservation(zero, zero, jnp.eye(2, dtype=jnp.float32), zero, no), DeltaHeading(zero, zero, no)
    )
