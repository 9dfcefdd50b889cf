"""How far along the path the goal lies: a short constant when slow, a long one when fast (Leonard et al.)."""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float


class LookAhead(NamedTuple):
    """A look-ahead over speed. Fields are scalars or one value a lane; equal speeds make a step.

    Attributes:
        short_m: at and below the slow speed; along the path.
        long_m: at and above the fast one.
        slow_mps, fast_mps: between them it grows in proportion.
    """

    short_m: Float[Array, "..."]
    long_m: Float[Array, "..."]
    slow_mps: Float[Array, "..."]
    fast_mps: Float[Array, "..."]


def look_ahead_m(schedule: LookAhead, speed_mps: Float[Array, "..."]) -> Float[Array, "..."]:
    """Look-ahead at a speed, the same forward and in reverse."""
    span = schedule.fast_mps - schedule.slow_mps
    above = jnp.abs(speed_mps) - schedule.slow_mps
    ramp = jnp.clip(above / jnp.where(span > 0.0, span, 1.0), 0.0, 1.0)
    step = jnp.where(above > 0.0, 1.0, 0.0)
    return schedule.short_m + (schedule.long_m - schedule.short_m) * jnp.where(span > 0.0, ramp, step)


def constant_look_ahead(length_m: Float[Array, "..."]) -> LookAhead:
    """The same at every speed."""
    zero = jnp.zeros_like(length_m)
    return LookAhead(length_m, length_m, zero, zero)
