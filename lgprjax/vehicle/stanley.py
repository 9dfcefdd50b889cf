"""Stanley's law, for comparison: the front axle is steered onto the path by its own offset and heading error.

It holds for counter-steered vehicles as it stands, since the front axle moves where the front wheels point
(Hoffmann et al., American Control Conference 2007).
"""

import jax.numpy as jnp
from jaxtyping import Array, Float

from lgprjax.vehicle.chassis import Chassis

_STANDING_MPS = 0.5


def steer_stanley(
    chassis: Chassis,
    heading_error_rad: Float[Array, "..."],
    offset_m: Float[Array, "..."],
    speed_mps: Float[Array, "..."],
    gain_ps: float | Float[Array, "..."],
) -> Float[Array, "..."]:
    """Front angle, clipped to the largest.

    Args:
        chassis: its limits.
        heading_error_rad: direction of the path less that of the body, at the front axle's projection.
        offset_m: of the path from the front axle, positive where the path lies to the left.
        speed_mps: forward.
        gain_ps: rate, per second, at which a small offset dies out.
    """
    front = heading_error_rad + jnp.arctan(gain_ps * offset_m / (jnp.abs(speed_mps) + _STANDING_MPS))
    return jnp.clip(front, -chassis.largest_angle_rad, chassis.largest_angle_rad)
