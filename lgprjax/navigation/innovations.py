"""What each source would observe if the filter were right: innovation, its derivatives by the states, and its noise.

Derivatives are kept as the few states that an observation depends on. An observation of age τ was taken where the
vehicle was τ before the tick's end: the pose moves back along body velocity and yaw rate, which is exact within a tick.
"""

import jax.numpy as jnp
from jaxtyping import Array, Float

from lgprjax.navigation.arc_reach import Pair, Reach, reach, turned, wrap_yaw
from lgprjax.navigation.filter_model import (
    GNSS_ERROR_X,
    GNSS_ERROR_Y,
    LGPR_CLOCK,
    LGPR_ERROR_X,
    LGPR_ERROR_Y,
    LGPR_LEVER_X,
    LGPR_LEVER_Y,
    ODOMETER_SCALE,
    RATE_BIAS,
    SPEED,
    YAW,
    FilterModel,
    NavEstimate,
    X,
    Y,
)
from lgprjax.navigation.kalman import Innovation, Row, innovation_of, usable
from lgprjax.navigation.observations import (
    GnssObservation,
    HeadingObservation,
    LgprObservation,
    Motion,
    OdometerObservation,
)


def gnss_innovation(
    model: FilterModel, estimate: NavEstimate, motion: Motion, observation: GnssObservation
) -> Innovation:
    """Of the antenna's position."""
    age, (back, along, rate) = _clean(observation, observation.age_s), _body_motion(estimate, motion)
    at = reach(-age * along, -age * rate, model.zero_slip_m, model.gnss_x_m, model.gnss_y_m)
    (x, y), (row_x, row_y) = _position(estimate, at, age, back)
    row_x[GNSS_ERROR_X] = row_y[GNSS_ERROR_Y] = jnp.float32(1.0)
    expected = jnp.stack([x + estimate.mean[GNSS_ERROR_X], y + estimate.mean[GNSS_ERROR_Y]])
    observed = jnp.stack([observation.x_m, observation.y_m])
    return innovation_of(observed - expected, (row_x, row_y), observation.covariance, usable(observation))


def heading_innovation(estimate: NavEstimate, motion: Motion, observation: HeadingObservation) -> Innovation:
    """Of the yaw; it depends on no lever."""
    age, (_, _, rate) = _clean(observation, observation.age_s), _body_motion(estimate, motion)
    residual = wrap_yaw(observation.yaw_rad - (estimate.mean[YAW] - age * rate))
    row = {YAW: jnp.float32(1.0), RATE_BIAS: age}
    return innovation_of(residual[None], (row,), observation.variance[None, None], usable(observation))


def odometer_innovation(estimate: NavEstimate, observation: OdometerObservation) -> Innovation:
    """Of the forward speed times one plus the scale."""
    speed, scale = estimate.mean[SPEED], 1.0 + estimate.mean[ODOMETER_SCALE]
    residual = observation.speed_mps - speed * scale
    row = {SPEED: scale, ODOMETER_SCALE: speed}
    return innovation_of(residual[None], (row,), observation.variance[None, None], usable(observation))


def lgpr_innovation(
    model: FilterModel, estimate: NavEstimate, motion: Motion, observation: LgprObservation
) -> Innovation:
    """Of the pose of the array's centre, by the clock later than its stamp."""
    mean = estimate.mean
    back, along, rate = _body_motion(estimate, motion)
    age = _clean(observation, observation.age_s) + mean[LGPR_CLOCK]
    lever = (model.array_x_m + mean[LGPR_LEVER_X], model.array_y_m + mean[LGPR_LEVER_Y])
    at = reach(-age * along, -age * rate, model.zero_slip_m, *lever)
    (x, y), rows = _position(estimate, at, age, back)
    cos, sin = back
    # A moment later is a way and a turn less.
    clock = turned(
        cos,
        sin,
        (
            -along * at.by_travel[0] - rate * at.by_turn_m[0],
            -along * at.by_travel[1] - rate * at.by_turn_m[1],
        ),
    )
    lever_x, lever_y = turned(cos, sin, (at.cos, at.sin)), turned(cos, sin, (-at.sin, at.cos))
    for axis, row in enumerate(rows):
        row[LGPR_CLOCK], row[LGPR_LEVER_X], row[LGPR_LEVER_Y] = clock[axis], lever_x[axis], lever_y[axis]
        row[(LGPR_ERROR_X, LGPR_ERROR_Y)[axis]] = jnp.float32(1.0)
    turn_row = {YAW: jnp.float32(1.0), RATE_BIAS: age, LGPR_CLOCK: -rate}
    residual = jnp.stack(
        [
            observation.x_m - x - mean[LGPR_ERROR_X],
            observation.y_m - y - mean[LGPR_ERROR_Y],
            wrap_yaw(observation.yaw_rad - (mean[YAW] - age * rate)),
        ]
    )
    return innovation_of(residual, (*rows, turn_row), observation.covariance, usable(observation))


def _body_motion(estimate: NavEstimate, motion: Motion) -> tuple[Pair, Float[Array, ""], Float[Array, ""]]:
    """Cosine and sine of the yaw, forward speed, and yaw rate without the gyro's bias."""
    yaw = estimate.mean[YAW]
    return (jnp.cos(yaw), jnp.sin(yaw)), estimate.mean[SPEED], motion.yaw_rate_radps - estimate.mean[RATE_BIAS]


def _position(estimate: NavEstimate, at: Reach, age_s: Float[Array, ""], yaw: Pair) -> tuple[Pair, tuple[Row, Row]]:
    """Position of a body point before the tick's end, and its derivatives by pose, speed and bias."""
    cos, sin = yaw
    one = jnp.float32(1.0)
    x, y = turned(cos, sin, at.at_m)
    travel, turn = turned(cos, sin, at.by_travel), turned(cos, sin, at.by_turn_m)
    row_x = {X: one, YAW: -y, SPEED: -age_s * travel[0], RATE_BIAS: age_s * turn[0]}
    row_y = {Y: one, YAW: x, SPEED: -age_s * travel[1], RATE_BIAS: age_s * turn[1]}
    return (estimate.mean[X] + x, estimate.mean[Y] + y), (row_x, row_y)


def _clean(
    observation: GnssObservation | HeadingObservation | LgprObservation, age_s: Float[Array, ""]
) -> Float[Array, ""]:
    """The age, or none where it would poison what is linearised about it."""
    return jnp.where(observation.valid & jnp.isfinite(age_s), age_s, 0.0)
