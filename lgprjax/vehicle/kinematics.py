"""A counter-steered chassis: wheelbase, rear wheels that follow the front ones, and the resulting turn.

Body frame x forward, y left, origin at the rear axle; angles counter-clockwise positive. The front wheels are at φ, the
rear wheels at −ψ(φ) with ψ ≥ 0 for φ ≥ 0: they counter-steer. ψ = kφ is the usual model, k = 0 a front-steered vehicle;
a measured ψ(φ) replaces it where available.
"""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float


class ProportionalRear(NamedTuple):
    """Rear wheels at a constant share of the front angle: ψ = kφ.

    Attributes:
        ratio: k, the magnitude of rear over front angle.
    """

    ratio: Float[Array, "..."]


class MeasuredRear(NamedTuple):
    """Measured map of the rear wheels: ψ(φ) linear between knots, continued with the end's slope beyond them.

    Attributes:
        first_rad: front angle of the first knot.
        step_rad: front angle between knots.
        rear_rad: magnitude of counter-steer at each knot, signed as the front angle.
    """

    first_rad: Float[Array, ""]
    step_rad: Float[Array, ""]
    rear_rad: Float[Array, " knot"]


Rear = ProportionalRear | MeasuredRear


class Chassis(NamedTuple):
    """Steering geometry of a vehicle. Fields are scalars or one value per batch element.

    Attributes:
        wheelbase_m: L, distance from the front to the rear axle.
        anchor_m: l, distance from the rear axle forward to the point that follows the path.
        rear: rear ratio, or measured map of the rear wheels.
        largest_angle_rad: largest angle of the front wheels, to either side.
        characteristic_speed_mps: V_CHAR of the yaw gain; infinite without slip.
    """

    wheelbase_m: Float[Array, "..."]
    anchor_m: Float[Array, "..."]
    rear: Rear
    largest_angle_rad: Float[Array, "..."]
    characteristic_speed_mps: Float[Array, "..."]


class Turn(NamedTuple):
    """The turn that results from wheel angles.

    Attributes:
        curvature_radpm: curvature of the zero-slip point, without loss of yaw: yaw rate divided by forward speed.
        rear_tangent: tan ψ; the rear axle moves sideways by this share of its forward motion, to the right when
            positive.
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

    It is L tan ψ / (tan φ + tan ψ), or its limit for small angles where the wheels are straight.
    """
    behind, slope = rear_angle(chassis.rear, front_rad)
    front, rear = jnp.tan(front_rad), jnp.tan(behind)
    straight = jnp.abs(front) < 1e-6
    share = jnp.where(straight, slope / (1.0 + slope), rear / jnp.where(straight, 1.0, front + rear))
    return chassis.wheelbase_m * share


def yaw_gain(characteristic_speed_mps: Float[Array, "..."], speed_mps: Float[Array, "..."]) -> Float[Array, "..."]:
    """G_ss = 1 / (1 + (v/V_CHAR)²): the share of the geometric yaw rate that remains at a speed."""
    return 1.0 / (1.0 + (speed_mps / characteristic_speed_mps) ** 2)


# Motion at constant wheel angles: an exact arc, with the straight line as its limit.


class VehiclePose(NamedTuple):
    """Pose of the rear axle in a level local frame: a body-fixed point, unlike the zero-slip point.

    Attributes:
        x_m, y_m: position, east and north or any other level axes.
        yaw_rad: counter-clockwise from x.
    """

    x_m: Float[Array, "..."]
    y_m: Float[Array, "..."]
    yaw_rad: Float[Array, "..."]


def drive_arc(
    pose: VehiclePose, travel_m: Float[Array, "..."], turn: Turn, gain: float | Float[Array, "..."] = 1.0
) -> VehiclePose:
    """Pose after ``travel_m`` (forward component; negative in reverse) at constant wheel angles.

    The rear axle's displacement before rotation is (ds, −G ds tan ψ) and the yaw changes by Gκ ds: the loss of yaw G
    does not move the zero-slip point. The chord is that of the exact arc; near a straight line its two factors are
    computed from their series, so that nothing is divided by the curvature.

    Args:
        pose: pose before the arc.
        travel_m: displacement of any point of the centre line along the body axis.
        turn: turn from ``turn_of``.
        gain: yaw gain G_ss, from ``yaw_gain``.
    """
    change = gain * turn.curvature_radpm * travel_m
    small = jnp.abs(change) < 0.05
    safe = jnp.where(small, 1.0, change)
    square = change * change
    along = jnp.where(small, 1.0 - square / 6.0 * (1.0 - square / 20.0), jnp.sin(safe) / safe)
    aside = jnp.where(small, 0.5 * change * (1.0 - square / 12.0 * (1.0 - square / 30.0)), (1.0 - jnp.cos(safe)) / safe)
    forward, left = travel_m, -gain * travel_m * turn.rear_tangent
    x, y = along * forward - aside * left, aside * forward + along * left
    cos, sin = jnp.cos(pose.yaw_rad), jnp.sin(pose.yaw_rad)
    return VehiclePose(pose.x_m + cos * x - sin * y, pose.y_m + sin * x + cos * y, pose.yaw_rad + change)


def body_point(pose: VehiclePose, ahead_m: Float[Array, "..."]) -> tuple[Float[Array, "..."], Float[Array, "..."]]:
    """Position of a point of the centre line, metres ahead of the rear axle: anchor, front axle, array."""
    return pose.x_m + ahead_m * jnp.cos(pose.yaw_rad), pose.y_m + ahead_m * jnp.sin(pose.yaw_rad)


# The steering linkage: a shaft whose crank turns the wheels, and the rear map of two linkages on one shaft.
#
# |φ_wheel| = asin(L_a sin(N φ_shaft) / L_b) (LL eq. 4), for the front and for the rear wheels. With front and rear arms
# of different length, or a different gear, the rear wheels follow at a nearly constant share.


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
    """Wheel angle, signed as the shaft's: LL eq. 4. NaN where the arms do not reach."""
    return jnp.arcsin(linkage.crank_m / linkage.arm_m * jnp.sin(linkage.gear * shaft_rad))


def shaft_angle(linkage: Linkage, wheel_rad: Float[Array, "..."]) -> Float[Array, "..."]:
    """Shaft angle of a wheel angle, the inverse of ``wheel_angle`` up to ``largest_shaft_angle``.

    NaN for a wheel angle beyond ``largest_wheel_angle``.
    """
    return jnp.arcsin(linkage.arm_m / linkage.crank_m * jnp.sin(wheel_rad)) / linkage.gear


def largest_shaft_angle(linkage: Linkage) -> Float[Array, "..."]:
    """Shaft angle at which the linkage jams (the wheel's arm is perpendicular) or reverses (the crank is)."""
    share = jnp.minimum(jnp.asarray(linkage.arm_m) / jnp.asarray(linkage.crank_m), 1.0)
    return jnp.arcsin(share) / linkage.gear


def largest_wheel_angle(linkage: Linkage) -> Float[Array, "..."]:
    """Wheel angle at ``largest_shaft_angle``: a right angle if the crank is the longer arm."""
    return jnp.arcsin(jnp.minimum(jnp.asarray(linkage.crank_m) / jnp.asarray(linkage.arm_m), 1.0))


def straight_slope(linkage: Linkage) -> float | Float[Array, "..."]:
    """Wheel angle over shaft angle at straight wheels: N L_a / L_b."""
    return linkage.gear * linkage.crank_m / linkage.arm_m


def rear_of_linkages(front: Linkage, rear: Linkage, largest_rad: float, *, knots: int = 65) -> MeasuredRear:
    """Rear map of two linkages on one shaft, for a ``Chassis``.

    Args:
        front, rear: linkages of the two axles, scalars.
        largest_rad: largest front angle of the map, to either side.
        knots: number of knots of the map, which is linear between them.

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


# Skid-steer motion: wheels on two sides, the resulting body rates, and the exact arc (MF 2).


class SkidSteer(NamedTuple):
    """Limits of a skid-steer vehicle. Fields are scalars or one value per batch element.

    Attributes:
        track_m: effective track width: the speed difference divided by it is the yaw rate. Scrubbing wheels turn the
            body less than their spacing suggests, so it is wider than that.
        largest_wheel_mps: largest speed of either side, forward and backward.
        wheel_rate_mps2: largest change of a side's speed.
        smallest_radius_m: smallest radius of commanded arcs.
    """

    track_m: Float[Array, "..."]
    largest_wheel_mps: Float[Array, "..."]
    wheel_rate_mps2: Float[Array, "..."]
    smallest_radius_m: Float[Array, "..."]


class WheelSpeeds(NamedTuple):
    """Speeds of both sides over ground, negative backward."""

    left_mps: Float[Array, "..."]
    right_mps: Float[Array, "..."]


def body_rates(track_m: Float[Array, "..."], wheels: WheelSpeeds) -> tuple[Float[Array, "..."], Float[Array, "..."]]:
    """Forward speed of the track's midpoint, m/s, and yaw rate, rad/s, without slip."""
    speed_mps = 0.5 * (wheels.left_mps + wheels.right_mps)
    return speed_mps, (wheels.right_mps - wheels.left_mps) / track_m


def wheel_speeds(
    track_m: Float[Array, "..."], speed_mps: Float[Array, "..."], yaw_rate_radps: Float[Array, "..."]
) -> WheelSpeeds:
    """Speeds of both sides for a forward speed of the midpoint and a yaw rate: the inverse of ``body_rates``."""
    apart = 0.5 * track_m * yaw_rate_radps
    return WheelSpeeds(speed_mps - apart, speed_mps + apart)


def drive_skid_arc(
    pose: VehiclePose, track_m: Float[Array, "..."], wheels: WheelSpeeds, step_s: Float[Array, "..."]
) -> VehiclePose:
    """Pose of the track's midpoint after a time at constant wheel speeds (MF section 2, simplified).

    The turn centre is on the line through the midpoint across the heading. The displacement is the arc's chord, in the
    direction of half the turn: nothing is divided by the yaw rate, so that the straight line is its limit, and a turn
    on the spot does not move.

    Args:
        pose: pose of the midpoint before the arc.
        track_m: effective track width.
        wheels: wheel speeds over ground.
        step_s: duration; a negative time goes back along the arc.
    """
    speed_mps, yaw_rate_radps = body_rates(track_m, wheels)
    turn = yaw_rate_radps * step_s
    chord = speed_mps * step_s * jnp.sinc(turn / (2.0 * jnp.pi))
    direction = pose.yaw_rad + 0.5 * turn
    return VehiclePose(
        pose.x_m + chord * jnp.cos(direction), pose.y_m + chord * jnp.sin(direction), pose.yaw_rad + turn
    )
