"""Where an arc takes a point of the body, and how that changes with the arc: the filter's only geometry.

The point without slip goes a way ds along the body axis while the body turns by dθ, so it moves by the arc's chord
ds sinc(dθ/2) in the direction dθ/2; every other point of the body turns about it. Nothing is divided by the curvature,
and a way back is a negative way with a negative turn.
"""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float

Scalar = Float[Array, "..."]
Pair = tuple[Scalar, Scalar]


class Reach(NamedTuple):
    """A body point after an arc, in the body axes before it, from the rear axle before it.

    Attributes:
        at_m: forward and left.
        by_travel: derivative of both by the way.
        by_turn_m: derivative of both by the turn, metres a radian.
        cos, sin: of the turn; its rotation is the derivative by the point's place in the body.
    """

    at_m: Pair
    by_travel: Pair
    by_turn_m: Pair
    cos: Scalar
    sin: Scalar


def reach(
    travel_m: Float[Array, "..."],
    turn_rad: Float[Array, "..."],
    zero_slip_m: Float[Array, "..."],
    x_m: Float[Array, "..."],
    y_m: Float[Array, "..."],
) -> Reach:
    """Where the body point (x, y) is after an arc.

    Args:
        travel_m: ds, negative in reverse.
        turn_rad: dθ, counter-clockwise.
        zero_slip_m: x_c, of the point that moves along the body axis.
        x_m, y_m: the point in the body, from the rear axle.
    """
    half = 0.5 * turn_rad
    cos_half, sin_half = jnp.cos(half), jnp.sin(half)
    square = half * half
    # Below a tenth of a radian the series leaves less than float32 resolves, and the quotients lose digits.
    small = square < 0.01
    safe = jnp.where(small, 1.0, half)
    chord = jnp.where(small, 1.0 - square / 6.0 * (1.0 - square / 20.0), sin_half / safe)
    slope = jnp.where(small, -half / 3.0 * (1.0 - square / 10.0), (cos_half - chord) / safe)
    cos, sin = cos_half * cos_half - sin_half * sin_half, 2.0 * sin_half * cos_half
    arm_x, arm_y = x_m - zero_slip_m, y_m
    turned_x, turned_y = cos * arm_x - sin * arm_y, sin * arm_x + cos * arm_y
    by_travel = (chord * cos_half, chord * sin_half)
    by_turn = (
        0.5 * travel_m * (slope * cos_half - chord * sin_half) - turned_y,
        0.5 * travel_m * (slope * sin_half + chord * cos_half) + turned_x,
    )
    at = (travel_m * by_travel[0] + zero_slip_m + turned_x, travel_m * by_travel[1] + turned_y)
    return Reach(at, by_travel, by_turn, cos, sin)


def turned(cos: Float[Array, "..."], sin: Float[Array, "..."], vector: Pair) -> Pair:
    """A vector of the body in the frame in which the body stands at an angle."""
    return cos * vector[0] - sin * vector[1], sin * vector[0] + cos * vector[1]


def wrap_yaw(angle_rad: Float[Array, "..."]) -> Float[Array, "..."]:
    """The same angle in [-π, π]."""
    return angle_rad - 2.0 * jnp.pi * jnp.round(angle_rad / (2.0 * jnp.pi))
