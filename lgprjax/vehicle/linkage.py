"""The steering linkage: a shaft whose crank turns the wheels, and the rear map that two linkages on one shaft make.

|φ_wheel| = asin(L_a sin(N φ_shaft) / L_b) (LL eq. 4), for the front and for the rear wheels. Front and rear arms of
different length, or a different gear, are what makes the rear wheels follow at nearly a constant share.
"""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from lgprjax.vehicle.chassis import MeasuredRear


class Linkage(NamedTuple):
    """One axle's linkage.

    Attributes:
        crank_m: L_a, of the arm on the shaft.
        arm_m: L_b, of the arm on the wheel.
        gear: N, angle of the crank over that of the shaft.
    """

    crank_m: float | Float[Array, "..."]
    arm_m: float | Float[Array, "..."]
    gear: float | Float[Array, "..."]


def wheel_angle(linkage: Linkage, shaft_rad: Float[Array, "..."]) -> Float[Array, "..."]:
    """Wheel angle, signed as the shaft's: LL eq. 4. Not a number where the arms do not reach."""
    return jnp.arcsin(linkage.crank_m / linkage.arm_m * jnp.sin(linkage.gear * shaft_rad))


def shaft_angle(linkage: Linkage, wheel_rad: Float[Array, "..."]) -> Float[Array, "..."]:
    """Shaft angle of a wheel angle, the inverse of ``wheel_angle`` up to ``largest_shaft_angle``.

    Not a number for a wheel angle beyond ``largest_wheel_angle``.
    """
    return jnp.arcsin(linkage.arm_m / linkage.crank_m * jnp.sin(wheel_rad)) / linkage.gear


def largest_shaft_angle(linkage: Linkage) -> Float[Array, "..."]:
    """Shaft angle at which the linkage jams (the wheel's arm stands across) or turns back (the crank does)."""
    share = jnp.minimum(jnp.asarray(linkage.arm_m) / jnp.asarray(linkage.crank_m), 1.0)
    return jnp.arcsin(share) / linkage.gear


def largest_wheel_angle(linkage: Linkage) -> Float[Array, "..."]:
    """Wheel angle at ``largest_shaft_angle``: a right angle if the crank is the longer arm."""
    return jnp.arcsin(jnp.minimum(jnp.asarray(linkage.crank_m) / jnp.asarray(linkage.arm_m), 1.0))


def straight_slope(linkage: Linkage) -> float | Float[Array, "..."]:
    """Wheel angle over shaft angle where the wheels stand straight: N L_a / L_b."""
    return linkage.gear * linkage.crank_m / linkage.arm_m


def rear_of_linkages(front: Linkage, rear: Linkage, largest_rad: float, *, knots: int = 65) -> MeasuredRear:
    """Rear map of two linkages on one shaft, for a ``Chassis``.

    Args:
        front, rear: of the two axles, scalars.
        largest_rad: front angle that the map reaches to either side.
        knots: of the map; linear between.

    Raises:
        ValueError: one of the linkages does not reach the largest angle.
    """
    front_rad = np.linspace(-largest_rad, largest_rad, knots)
    with np.errstate(invalid="ignore"):
        shaft_rad = np.arcsin(np.float64(front.arm_m) / np.float64(front.crank_m) * np.sin(front_rad)) / front.gear
        rear_rad = np.arcsin(np.float64(rear.crank_m) / np.float64(rear.arm_m) * np.sin(rear.gear * shaft_rad))
    if not np.isfinite(rear_rad).all():
        raise ValueError(f"the linkages do not reach a front angle of {largest_rad} rad")
    step_rad = 2.0 * largest_rad / (knots - 1)
    return MeasuredRear(jnp.float32(-largest_rad), jnp.float32(step_rad), jnp.asarray(rear_rad, jnp.float32))
