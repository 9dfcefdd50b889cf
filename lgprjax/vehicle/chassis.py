"""A counter-steered chassis: wheelbase, rear wheels that follow the front ones, and the turn that both make.

Body frame x forward, y left, origin at the rear axle; angles counter-clockwise positive. The front wheels stand at φ,
the rear wheels at −ψ(φ) with ψ ≥ 0 for φ ≥ 0: they counter-steer. ψ = kφ is the usual model, k = 0 a front-steered
vehicle; a measured ψ(φ) takes its place where there is one.
"""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float


class ProportionalRear(NamedTuple):
    """Rear wheels at a constant share of the front angle: ψ = kφ.

    Attributes:
        ratio: k, the magnitude of rear over front angle.
    """

    ratio: Float[Array, "..."]


class MeasuredRear(NamedTuple):
    """Rear wheels as measured: ψ(φ) linear between knots, and on with the end's slope beyond them.

    Attributes:
        first_rad: front angle of the first knot.
        step_rad: from knot to knot.
        rear_rad: magnitude of counter-steer at each knot, signed as the front angle.
    """

    first_rad: Float[Array, ""]
    step_rad: Float[Array, ""]
    rear_rad: Float[Array, " knot"]


Rear = ProportionalRear | MeasuredRear


class Chassis(NamedTuple):
    """What the steering geometry needs to know of a vehicle. Fields are scalars or one value a lane.

    Attributes:
        wheelbase_m: L, front to rear axle.
        anchor_m: l, from the rear axle forward to the point that is to follow the path.
        rear: how the rear wheels follow.
        largest_angle_rad: of the front wheels, to either side.
        characteristic_speed_mps: V_CHAR of the yaw gain; infinite where nothing is lost to slip.
    """

    wheelbase_m: Float[Array, "..."]
    anchor_m: Float[Array, "..."]
    rear: Rear
    largest_angle_rad: Float[Array, "..."]
    characteristic_speed_mps: Float[Array, "..."]


class Turn(NamedTuple):
    """The turn that wheel angles make.

    Attributes:
        curvature_radpm: of the point without slip, without loss of yaw: the yaw rate over the forward speed.
        rear_tangent: tan ψ; the rear axle moves sideways by this share of its way forward, to the right when positive.
    """

    curvature_radpm: Float[Array, "..."]
    rear_tangent: Float[Array, "..."]


def rear_angle(rear: Rear, front_rad: Float[Array, "..."]) -> tuple[Float[Array, "..."], Float[Array, "..."]]:
    """Magnitude of counter-steer ψ(φ), signed as φ, and its slope dψ/dφ."""
    if isinstance(rear, ProportionalRear):
        return rear.ratio * front_rad, jnp.broadcast_to(rear.ratio, front_rad.shape)
    at = (front_rad - rear.first_rad) / rear.step_rad
    knot = jnp.clip(jnp.floor(at).astype(jnp.int32), 0, rear.rear_rad.shape[0] - 2)
    low, high = rear.rear_rad[knot], rear.rear_rad[knot + 1]
    return low + (at - knot.astype(at.dtype)) * (high - low), (high - low) / rear.step_rad


def turn_of(chassis: Chassis, front_rad: Float[Array, "..."]) -> Turn:
    """Turn at a front angle: κ = (tan φ + tan ψ) / L (LL's yaw formula with the wheelbase as L)."""
    behind, _ = rear_angle(chassis.rear, front_rad)
    rear_tangent = jnp.tan(behind)
    return Turn((jnp.tan(front_rad) + rear_tangent) / chassis.wheelbase_m, rear_tangent)


def zero_slip_point(chassis: Chassis, front_rad: Float[Array, "..."]) -> Float[Array, "..."]:
    """x_c, metres ahead of the rear axle: the point that moves straight along the body axis.

    It is L tan ψ / (tan φ + tan ψ), and its limit for small angles where the wheels stand straight.
    """
    behind, slope = rear_angle(chassis.rear, front_rad)
    front, rear = jnp.tan(front_rad), jnp.tan(behind)
    straight = jnp.abs(front) < 1e-6
    share = jnp.where(straight, slope / (1.0 + slope), rear / jnp.where(straight, 1.0, front + rear))
    return chassis.wheelbase_m * share


def yaw_gain(characteristic_speed_mps: Float[Array, "..."], speed_mps: Float[Array, "..."]) -> Float[Array, "..."]:
    """G_ss = 1 / (1 + (v/V_CHAR)²): the share of the geometric yaw rate that is left at a speed."""
    return 1.0 / (1.0 + (speed_mps / characteristic_speed_mps) ** 2)
