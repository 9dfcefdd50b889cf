"""The filter's algebra: prediction of 13 states over a tick; the update by an observation is the common core's.

The derivatives of a tick's motion touch three rows of the covariance: they are written out by rows, so that a tick of
hundreds of lanes stays elementwise work.
"""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from lgprjax.navigation import kalman
from lgprjax.navigation.arc_reach import reach, turned
from lgprjax.navigation.drifting_frame import step_local
from lgprjax.navigation.filter_model import (
    LGPR_CLOCK,
    LGPR_LEVER_X,
    LGPR_LEVER_Y,
    ODOMETER_SCALE,
    RATE_BIAS,
    SPEED,
    STATES,
    YAW,
    FilterModel,
    NavEstimate,
    X,
    Y,
    pose_of,
)
from lgprjax.navigation.kalman import Innovation, Weighed
from lgprjax.navigation.observations import HeadingObservation, Motion

LEAST_COURSE_MPS = 1.0
"""Below this speed a course says nothing about the heading."""
LARGEST_COURSE_RADPM = 0.05
"""On a tighter arc than 20 m the way from course to heading hangs too much on the point without slip."""


class Transition(NamedTuple):
    """What a tick does to small errors.

    Attributes:
        pose_rows: derivatives of x, y and yaw after the tick by the states before it.
        decay: of the states after the pose: one, or what is left of a Gauss-Markov error.
        yaw_noise: derivatives of x, y and yaw by a turn of the body.
    """

    pose_rows: Float[Array, "3 13"]
    decay: Float[Array, " 10"]
    yaw_noise: Float[Array, " 3"]


def transition_of(model: FilterModel, estimate: NavEstimate, motion: Motion) -> Transition:
    """The derivatives of a tick at the estimate before it; ``transition_matrix`` has them as a matrix."""
    mean, step = estimate.mean, motion.step_s
    travel, turn = mean[SPEED] * step, (motion.yaw_rate_radps - mean[RATE_BIAS]) * step
    nowhere = jnp.zeros_like(travel)
    arc = reach(travel, turn, model.zero_slip_m, nowhere, nowhere)
    cos, sin = jnp.cos(mean[YAW]), jnp.sin(mean[YAW])
    at, by_travel, by_turn = (turned(cos, sin, part) for part in (arc.at_m, arc.by_travel, arc.by_turn_m))
    rows = jnp.zeros((3, len(STATES)), mean.dtype)
    rows = rows.at[X, X].set(1.0).at[Y, Y].set(1.0).at[YAW, YAW].set(1.0)
    rows = rows.at[X, YAW].set(-at[1]).at[Y, YAW].set(at[0])
    rows = rows.at[X, SPEED].set(step * by_travel[0]).at[Y, SPEED].set(step * by_travel[1])
    bias = -step * jnp.stack([*by_turn, jnp.ones_like(step)])
    gnss, lgpr = _error_decay(model, travel, step)
    decay = jnp.concatenate([jnp.ones(LGPR_LEVER_Y - YAW), jnp.stack([gnss, gnss, lgpr, lgpr])])
    return Transition(rows.at[:, RATE_BIAS].set(bias), decay, jnp.stack([*by_turn, jnp.ones_like(step)]))


def transition_matrix(transition: Transition) -> Float[Array, "13 13"]:
    """F, the derivatives of all states after a tick by those before it."""
    rest = jnp.concatenate([jnp.zeros((len(transition.decay), 3)), jnp.diag(transition.decay)], axis=1)
    return jnp.concatenate([transition.pose_rows, rest])


def predict(model: FilterModel, estimate: NavEstimate, motion: Motion) -> NavEstimate:
    """The estimate a tick later, before its observations.

    Speed, bias, scale, clock and lever wander before the motion, which happens at the speed of the tick's end: so an
    observation of some age is found by going back along the same arc. The gyro's noise turns the body about the point
    without slip; side noise and the errors' own come after.

    Args:
        model: of vehicle and sensors.
        estimate: at the tick's start.
        motion: the tick's.
    """
    transition = transition_of(model, estimate, motion)
    mean, step = estimate.mean, motion.step_s
    rate = motion.yaw_rate_radps - mean[RATE_BIAS]
    pose = step_local(pose_of(estimate), mean[SPEED], rate, model.zero_slip_m, step)
    moved = jnp.concatenate([jnp.stack([*pose]), mean[YAW + 1 :] * transition.decay])
    wandered = estimate.covariance + jnp.diag(_wander(model) * step)
    half = _apply(transition, wandered)
    covariance = _apply(transition, half.T)
    cos, sin = jnp.cos(pose.yaw_rad), jnp.sin(pose.yaw_rad)
    turn = model.yaw_rate_noise * jnp.sqrt(step) * transition.yaw_noise
    side = model.side_noise * jnp.sqrt(step) * jnp.stack([-sin, cos, jnp.zeros_like(sin)])
    noise = jnp.outer(turn, turn) + jnp.outer(side, side)
    errors = jnp.stack([model.gnss_error_sigma_m] * 2 + [model.lgpr_error_sigma_m] * 2)
    fresh = errors * errors * (1.0 - transition.decay[-4:]) * (1.0 + transition.decay[-4:])
    injected = jnp.pad(noise, (0, len(STATES) - 3)) + jnp.diag(jnp.pad(fresh, (len(STATES) - 4, 0)))
    # Rounding leaves the two halves apart by a digit; here they are brought together once a tick.
    covariance = 0.5 * (covariance + covariance.T) + injected
    return NavEstimate(moved, covariance)


def weigh(estimate: NavEstimate, innovation: Innovation) -> Weighed:
    """Gain and normalised innovation squared of an observation of one to three components."""
    return kalman.weigh(estimate.covariance, innovation)


def correct(estimate: NavEstimate, innovation: Innovation, weighed: Weighed, use: Bool[Array, ""]) -> NavEstimate:
    """The estimate after an observation, by Joseph's form, where it is used; if not, it stays what it is."""
    return NavEstimate(*kalman.correct(*estimate, innovation, weighed, use))


def update(estimate: NavEstimate, innovation: Innovation) -> NavEstimate:
    """The estimate after an observation that no gate judges; one that is not offered changes nothing."""
    return correct(estimate, innovation, weigh(estimate, innovation), innovation.offered)


def course_observation(
    model: FilterModel,
    course_rad: Float[Array, "..."],
    ahead_m: Float[Array, "..."],
    speed_mps: Float[Array, "..."],
    yaw_rate_radps: Float[Array, "..."],
    variance: Float[Array, "..."],
) -> HeadingObservation:
    """A course over ground as a heading: a point s ahead of the rear axle moves off the body axis by (s − x_c) κ.

    Only the point without slip moves along the axis. In reverse the course points backwards, which is taken off too.
    It is valid from ``LEAST_COURSE_MPS`` on and up to ``LARGEST_COURSE_RADPM``, at the tick's end.

    Args:
        model: for the point without slip.
        course_rad: direction of the point's velocity, counter-clockwise from x.
        ahead_m: s, of the point, which stands on the centre line.
        speed_mps: forward, of the centre line along the body axis; negative in reverse.
        yaw_rate_radps: of the body, without bias.
        variance: of the course, rad².
    """
    aside = jnp.arctan2((ahead_m - model.zero_slip_m) * yaw_rate_radps, speed_mps)
    valid = jnp.abs(speed_mps) >= LEAST_COURSE_MPS
    valid = valid & (jnp.abs(yaw_rate_radps) <= LARGEST_COURSE_RADPM * jnp.abs(speed_mps))
    return HeadingObservation(course_rad - aside, variance, jnp.zeros_like(course_rad), valid)


def _wander(model: FilterModel) -> Float[Array, " 13"]:
    """Variances a second of the states that wander by themselves."""
    sigmas = jnp.zeros(len(STATES)).at[SPEED].set(model.acceleration_noise).at[RATE_BIAS].set(model.rate_bias_walk)
    sigmas = sigmas.at[ODOMETER_SCALE].set(model.odometer_scale_walk).at[LGPR_CLOCK].set(model.clock_walk)
    sigmas = sigmas.at[LGPR_LEVER_X].set(model.lever_walk).at[LGPR_LEVER_Y].set(model.lever_walk)
    return sigmas * sigmas


def _error_decay(
    model: FilterModel, travel_m: Float[Array, ""], step_s: Float[Array, ""]
) -> tuple[Float[Array, ""], Float[Array, ""]]:
    """What a tick leaves of the GNSS error, by time, and of the LGPR error, by travel either way."""
    return jnp.exp(-step_s / model.gnss_error_s), jnp.exp(-jnp.abs(travel_m) / model.lgpr_error_m)


def _apply(transition: Transition, matrix: Float[Array, "13 13"]) -> Float[Array, "13 13"]:
    """F times a matrix: three rows are sums of five, the others are scaled."""
    pose = matrix[: YAW + 1]
    for state in (YAW, SPEED, RATE_BIAS):
        weight = transition.pose_rows[:, state]
        if state == YAW:
            weight = weight.at[YAW].set(0.0)
        pose = pose + jnp.outer(weight, matrix[state])
    return jnp.concatenate([pose, transition.decay[:, None] * matrix[YAW + 1 :]])
