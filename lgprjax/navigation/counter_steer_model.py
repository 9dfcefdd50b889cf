"""The navigation filter's model of vehicle and sensors: 13 states, their noises, and the estimate itself.

| state | what it is |
| --- | --- |
| x, y, yaw | pose of the rear axle in the map's level frame |
| speed | of any point of the centre line along the body axis |
| rate bias | the gyro reads the yaw rate plus this |
| odometer scale | the odometer reads the speed times one plus this |
| LGPR clock | a fix is older than its stamp says by this |
| LGPR lever x, y | the array's centre stands off its nominal place in the body by this |
| GNSS error x, y | GNSS positions against the map's frame: a Gauss-Markov process over time |
| LGPR error x, y | common error of neighbouring fixes: a Gauss-Markov process over travel |

All is float32 on the device. Yaw is kept as driven, without wrapping: only differences of angles are wrapped.
"""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float

from lgprjax.navigation.kalman import Estimate, reach, turned, wrap_yaw
from lgprjax.vehicle import VehiclePose

STATES = (
    "x_m",
    "y_m",
    "yaw_rad",
    "speed_mps",
    "rate_bias_radps",
    "odometer_scale",
    "lgpr_clock_s",
    "lgpr_lever_x_m",
    "lgpr_lever_y_m",
    "gnss_error_x_m",
    "gnss_error_y_m",
    "lgpr_error_x_m",
    "lgpr_error_y_m",
)
"""Names of the states, in order."""
X, Y, YAW, SPEED, RATE_BIAS, ODOMETER_SCALE, LGPR_CLOCK = range(7)
LGPR_LEVER_X, LGPR_LEVER_Y, GNSS_ERROR_X, GNSS_ERROR_Y, LGPR_ERROR_X, LGPR_ERROR_Y = range(7, 13)


class FilterModel(NamedTuple):
    """Geometry and noises of the filter. Every field is a float32 scalar that may be traced and tuned.

    Attributes:
        zero_slip_m: x_c, from the rear axle forward to the point that moves along the body axis.
        gnss_x_m, gnss_y_m: antenna in the body, forward and left of the rear axle.
        array_x_m, array_y_m: nominal place of the array's centre in the body.
        yaw_rate_noise: white noise of the gyro, rad/s/√Hz.
        acceleration_noise: the speed's random walk, m/s²/√Hz.
        side_noise: random walk of the position across the body axis, m/√s.
        rate_bias_walk: rad/s/√s.
        odometer_scale_walk: 1/√s.
        clock_walk: s/√s.
        lever_walk: m/√s, on both axes.
        gnss_error_sigma_m, gnss_error_s: standard deviation an axis and correlation time of the GNSS error.
        lgpr_error_sigma_m, lgpr_error_m: standard deviation an axis and correlation length of the LGPR error.
        initial_position_m, initial_yaw_rad, initial_speed_mps, initial_rate_bias_radps, initial_odometer_scale,
            initial_clock_s, initial_lever_m: standard deviations at the start.
    """

    zero_slip_m: Float[Array, ""]
    gnss_x_m: Float[Array, ""]
    gnss_y_m: Float[Array, ""]
    array_x_m: Float[Array, ""]
    array_y_m: Float[Array, ""]
    yaw_rate_noise: Float[Array, ""]
    acceleration_noise: Float[Array, ""]
    side_noise: Float[Array, ""]
    rate_bias_walk: Float[Array, ""]
    odometer_scale_walk: Float[Array, ""]
    clock_walk: Float[Array, ""]
    lever_walk: Float[Array, ""]
    gnss_error_sigma_m: Float[Array, ""]
    gnss_error_s: Float[Array, ""]
    lgpr_error_sigma_m: Float[Array, ""]
    lgpr_error_m: Float[Array, ""]
    initial_position_m: Float[Array, ""]
    initial_yaw_rad: Float[Array, ""]
    initial_speed_mps: Float[Array, ""]
    initial_rate_bias_radps: Float[Array, ""]
    initial_odometer_scale: Float[Array, ""]
    initial_clock_s: Float[Array, ""]
    initial_lever_m: Float[Array, ""]


NavEstimate = Estimate
"""Of the states in the order of ``STATES``."""


def default_model(
    *, zero_slip_m: float, gnss_x_m: float, gnss_y_m: float, array_x_m: float, array_y_m: float
) -> FilterModel:
    """A model for an off-road vehicle with RTK GNSS, a MEMS gyro, wheel odometry and LGPR; the geometry has no default.

    The noises are assumptions of the usual size of such sensors, not identified on a vehicle: an angular random walk of
    5e-4 rad/√s that also covers rough ground, a random walk of the speed of half a metre per second in a second, 2 cm
    of side slip in a second, GNSS within 10 cm of the map's frame for minutes, and 3 cm common to neighbouring fixes of
    the radar over 5 m.
    """
    return FilterModel(
        zero_slip_m=jnp.float32(zero_slip_m),
        gnss_x_m=jnp.float32(gnss_x_m),
        gnss_y_m=jnp.float32(gnss_y_m),
        array_x_m=jnp.float32(array_x_m),
        array_y_m=jnp.float32(array_y_m),
        yaw_rate_noise=jnp.float32(5e-4),
        acceleration_noise=jnp.float32(0.5),
        side_noise=jnp.float32(0.02),
        rate_bias_walk=jnp.float32(2e-5),
        odometer_scale_walk=jnp.float32(2e-4),
        clock_walk=jnp.float32(1e-5),
        lever_walk=jnp.float32(1e-5),
        gnss_error_sigma_m=jnp.float32(0.10),
        gnss_error_s=jnp.float32(300.0),
        lgpr_error_sigma_m=jnp.float32(0.03),
        lgpr_error_m=jnp.float32(5.0),
        initial_position_m=jnp.float32(0.5),
        initial_yaw_rad=jnp.float32(0.05),
        initial_speed_mps=jnp.float32(0.3),
        initial_rate_bias_radps=jnp.float32(0.005),
        initial_odometer_scale=jnp.float32(0.02),
        initial_clock_s=jnp.float32(0.02),
        initial_lever_m=jnp.float32(0.05),
    )


def initial_sigmas(model: FilterModel) -> Float[Array, " 13"]:
    """Standard deviations of the states at the start, in their units; both errors start in their stationary state."""
    return jnp.stack(
        [
            model.initial_position_m,
            model.initial_position_m,
            model.initial_yaw_rad,
            model.initial_speed_mps,
            model.initial_rate_bias_radps,
            model.initial_odometer_scale,
            model.initial_clock_s,
            model.initial_lever_m,
            model.initial_lever_m,
            model.gnss_error_sigma_m,
            model.gnss_error_sigma_m,
            model.lgpr_error_sigma_m,
            model.lgpr_error_sigma_m,
        ]
    )


def init_estimate(model: FilterModel, pose: VehiclePose, speed_mps: Float[Array, ""]) -> NavEstimate:
    """The estimate at the start: given pose of the rear axle and forward speed, the rest zero."""
    mean = jnp.zeros(len(STATES), jnp.float32).at[: SPEED + 1].set(jnp.stack([*pose, speed_mps]))
    return NavEstimate(mean, jnp.diag(initial_sigmas(model) ** 2))


def pose_of(estimate: NavEstimate) -> VehiclePose:
    """Pose of the rear axle in the map's frame."""
    return VehiclePose(estimate.mean[..., X], estimate.mean[..., Y], estimate.mean[..., YAW])


def position_sigma_m(estimate: NavEstimate) -> tuple[Float[Array, "..."], Float[Array, "..."]]:
    """Standard deviations of the rear axle's position along the body axis and across it."""
    covariance, yaw = estimate.covariance, estimate.mean[..., YAW]
    cos, sin = jnp.cos(yaw), jnp.sin(yaw)
    xx, xy, yy = covariance[..., X, X], covariance[..., X, Y], covariance[..., Y, Y]
    along = cos * cos * xx + 2.0 * cos * sin * xy + sin * sin * yy
    cross = sin * sin * xx - 2.0 * cos * sin * xy + cos * cos * yy
    return jnp.sqrt(jnp.maximum(along, 0.0)), jnp.sqrt(jnp.maximum(cross, 0.0))


# Two frames: a local one in which the vehicle moves smoothly, and the map's, which drifts in it (LL fig. 11).
#
# The local pose is dead reckoning without corrections. Corrections of the filter move the map's frame, and with it the
# path, in the local frame: controllers see a path that moves at a limited rate and never a vehicle that jumps.


class FrameOffset(NamedTuple):
    """Pose of the map frame's origin in the local frame.

    Attributes:
        x_m, y_m: position.
        yaw_rad: of the map's x axis, counter-clockwise from the local one.
    """

    x_m: Float[Array, "..."]
    y_m: Float[Array, "..."]
    yaw_rad: Float[Array, "..."]


class SlewLimits(NamedTuple):
    """Limits of the path's motion at the vehicle.

    Attributes:
        position_mps: of the path's point at the vehicle, in any direction.
        yaw_radps: of the path's direction there.
    """

    position_mps: Float[Array, "..."]
    yaw_radps: Float[Array, "..."]


def anchor_frame(pose_global: VehiclePose, pose_local: VehiclePose) -> FrameOffset:
    """The offset that makes both poses coincide."""
    yaw = wrap_yaw(pose_local.yaw_rad - pose_global.yaw_rad)
    x, y = turned(jnp.cos(yaw), jnp.sin(yaw), (pose_global.x_m, pose_global.y_m))
    return FrameOffset(pose_local.x_m - x, pose_local.y_m - y, yaw)


def to_local(frame: FrameOffset, pose_global: VehiclePose) -> VehiclePose:
    """A pose of the map's frame in the local frame."""
    x, y = turned(jnp.cos(frame.yaw_rad), jnp.sin(frame.yaw_rad), (pose_global.x_m, pose_global.y_m))
    return VehiclePose(frame.x_m + x, frame.y_m + y, pose_global.yaw_rad + frame.yaw_rad)


def to_global(frame: FrameOffset, pose_local: VehiclePose) -> VehiclePose:
    """A pose of the local frame in the map's."""
    from_origin = (pose_local.x_m - frame.x_m, pose_local.y_m - frame.y_m)
    x, y = turned(jnp.cos(frame.yaw_rad), -jnp.sin(frame.yaw_rad), from_origin)
    return VehiclePose(x, y, pose_local.yaw_rad - frame.yaw_rad)


def step_local(
    pose_local: VehiclePose,
    speed_mps: Float[Array, "..."],
    yaw_rate_radps: Float[Array, "..."],
    zero_slip_m: Float[Array, "..."],
    step_s: Float[Array, "..."],
) -> VehiclePose:
    """Dead reckoning of the rear axle over a tick, on the exact arc; a negative tick goes back along it.

    Args:
        pose_local: before, in any level frame.
        speed_mps: forward, of any point of the centre line along the body axis.
        yaw_rate_radps: of the body.
        zero_slip_m: x_c, from the rear axle forward to the point that moves along the body axis.
        step_s: length of the tick.
    """
    turn = yaw_rate_radps * step_s
    nowhere = jnp.zeros_like(zero_slip_m)
    way = reach(speed_mps * step_s, turn, zero_slip_m, nowhere, nowhere)
    x, y = turned(jnp.cos(pose_local.yaw_rad), jnp.sin(pose_local.yaw_rad), way)
    return VehiclePose(pose_local.x_m + x, pose_local.y_m + y, pose_local.yaw_rad + turn)


def slew_frame(
    frame: FrameOffset,
    wanted: FrameOffset,
    pose_local: VehiclePose,
    limits: SlewLimits,
    step_s: Float[Array, "..."],
) -> tuple[FrameOffset, Float[Array, "..."]]:
    """Moves the map's frame, and the path with it, towards a wanted offset; the vehicle's local pose does not change.

    The path's point at the vehicle moves straight towards its target and the path turns about it, each within its
    limit; an offset within both limits is applied at once.

    Args:
        frame: present offset.
        wanted: target offset.
        pose_local: of the vehicle, where the limits apply.
        limits: speeds of the path.
        step_s: length of the tick.

    Returns:
        The new offset, and the remaining distance of the path's point at the vehicle, metres.
    """
    here = to_global(frame, pose_local)
    x, y = _missing(wanted, here, pose_local)
    turn = wrap_yaw(wanted.yaw_rad - frame.yaw_rad)
    distance = jnp.hypot(x, y)
    most_m, most_rad = limits.position_mps * step_s, limits.yaw_radps * step_s
    share = jnp.minimum(1.0, most_m / jnp.maximum(distance, 1e-9))
    target = VehiclePose(
        pose_local.x_m + share * x,
        pose_local.y_m + share * y,
        pose_local.yaw_rad + jnp.clip(turn, -most_rad, most_rad),
    )
    moved = anchor_frame(here, target)
    arrives = (distance <= most_m) & (jnp.abs(turn) <= most_rad)
    slewed = FrameOffset(*(jnp.where(arrives, to, by) for to, by in zip(wanted, moved, strict=True)))
    left = _missing(wanted, to_global(slewed, pose_local), pose_local)
    return slewed, jnp.where(arrives, 0.0, jnp.hypot(*left))


def _missing(
    wanted: FrameOffset, here: VehiclePose, pose_local: VehiclePose
) -> tuple[Float[Array, "..."], Float[Array, "..."]]:
    """Displacement of the map's point at the vehicle to the wanted offset."""
    there = to_local(wanted, here)
    return there.x_m - pose_local.x_m, there.y_m - pose_local.y_m
