"""How the estimate of a skid-steer vehicle moves on by a tick: the exact arc, its derivatives, and its noise.

The wheels say how far each side went; scale, slip and turn scale say what the ground saw of it. Noise grows with the
way, so with speed and step (MF section 2), and a vehicle that stands hardly grows less certain.
"""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float

from lgprjax.navigation.arc_reach import reach, turned, wrap_yaw
from lgprjax.navigation.skid_model import (
    SCALE,
    SKID_STATES,
    SLIP_AHEAD,
    SLIP_LEFT,
    SLIP_RIGHT,
    TURN_SCALE,
    TURNED,
    YAW,
    SkidEstimate,
    SkidModel,
    X,
    Y,
)
from lgprjax.navigation.skid_observations import SkidMotion
from lgprjax.vehicle import WheelSpeeds, body_rates


class SkidTransition(NamedTuple):
    """What a tick does to the states.

    Attributes:
        pose: x, y, yaw and turned after it.
        pose_rows: their derivatives by the states before it.
        by_turn: their derivatives by a turn of the body.
        decay: of the states after them: one, or what is left of a Gauss-Markov error.
    """

    pose: Float[Array, " 4"]
    pose_rows: Float[Array, "4 12"]
    by_turn: Float[Array, " 4"]
    decay: Float[Array, " 8"]


def skid_rates(
    model: SkidModel, estimate: SkidEstimate, motion: SkidMotion
) -> tuple[Float[Array, ""], Float[Array, ""]]:
    """Forward speed, m/s, and yaw rate, rad/s, as the estimate has them from the wheel speeds."""
    mean = estimate.mean
    over_ground = WheelSpeeds(
        motion.left_mps * (1.0 + mean[SCALE] + mean[SLIP_LEFT]),
        motion.right_mps * (1.0 + mean[SCALE] + mean[SLIP_RIGHT]),
    )
    speed_mps, yaw_rate_radps = body_rates(model.track_m, over_ground)
    return speed_mps, yaw_rate_radps * (1.0 + _turn_share(model, motion) * mean[TURN_SCALE])


def skid_transition(model: SkidModel, estimate: SkidEstimate, motion: SkidMotion) -> SkidTransition:
    """The pose after a tick and the derivatives of all states, at the estimate before it."""
    mean, step = estimate.mean, motion.step_s
    speed_mps, yaw_rate_radps = skid_rates(model, estimate, motion)
    turn = yaw_rate_radps * step
    nowhere, one = jnp.zeros_like(turn), jnp.ones_like(turn)
    arc = reach(speed_mps * step, turn, mean[SLIP_AHEAD], nowhere, nowhere)
    cos, sin = jnp.cos(mean[YAW]), jnp.sin(mean[YAW])
    by_slip = (1.0 - arc.cos, -arc.sin)
    at, by_travel, by_turn, aside = (
        turned(cos, sin, part) for part in (arc.at_m, arc.by_travel, arc.by_turn_m, by_slip)
    )
    left_m, right_m = motion.left_mps * step, motion.right_mps * step
    share = _turn_share(model, motion)
    stretch = 1.0 + share * mean[TURN_SCALE]
    a_metre = stretch / model.track_m
    # Derivatives of way and turn by each state that stretches them.
    stretches = {
        SCALE: (0.5 * (left_m + right_m), (right_m - left_m) * a_metre),
        TURN_SCALE: (nowhere, share * turn / stretch),
        SLIP_LEFT: (0.5 * left_m, -left_m * a_metre),
        SLIP_RIGHT: (0.5 * right_m, right_m * a_metre),
    }
    columns: dict[int, tuple[Float[Array, ""], ...]] = {
        YAW: (-at[1], at[0], one, nowhere),
        SLIP_AHEAD: (*aside, nowhere, nowhere),
        X: (one, nowhere, nowhere, nowhere),
        Y: (nowhere, one, nowhere, nowhere),
        TURNED: (nowhere, nowhere, nowhere, one),
    }
    for state, (travel, turning) in stretches.items():
        way = (by_travel[axis] * travel + by_turn[axis] * turning for axis in (0, 1))
        columns[state] = (*way, turning, turning)
    none = (nowhere,) * (TURNED + 1)
    rows = jnp.stack([jnp.stack(columns.get(state, none)) for state in range(len(SKID_STATES))], axis=1)
    pose = jnp.stack([mean[X] + at[0], mean[Y] + at[1], wrap_yaw(mean[YAW] + turn), mean[TURNED] + turn])
    return SkidTransition(pose, rows, jnp.stack([*by_turn, one, one]), jnp.exp(-_ages(model, motion)))


def predict_skid(model: SkidModel, estimate: SkidEstimate, motion: SkidMotion) -> SkidEstimate:
    """The estimate a tick later, before its observations.

    Args:
        model: of vehicle and sensors.
        estimate: at the tick's start.
        motion: the tick's; its numbers are finite.
    """
    transition = skid_transition(model, estimate, motion)
    half = _apply(transition, estimate.covariance)
    covariance = _apply(transition, half.T)
    # Rounding leaves the two halves apart by a digit; here they are brought together once a tick.
    covariance = 0.5 * (covariance + covariance.T) + way_noise(model, motion, transition)
    mean = jnp.concatenate([transition.pose, estimate.mean[TURNED + 1 :] * transition.decay])
    return SkidEstimate(mean, covariance)


def way_noise(model: SkidModel, motion: SkidMotion, transition: SkidTransition) -> Float[Array, "12 12"]:
    """Covariance that a tick adds: Q, which grows with speed and step (MF section 2)."""
    step = motion.step_s
    way = 0.5 * (jnp.abs(motion.left_mps) + jnp.abs(motion.right_mps)) * step
    turn = jnp.abs(motion.right_mps - motion.left_mps) * step / model.track_m
    yaw = transition.pose[YAW]
    cos, sin, none = jnp.cos(yaw), jnp.sin(yaw), jnp.zeros_like(yaw)
    turning = jnp.sqrt(model.yaw_noise**2 * way + model.yaw_rest_noise**2 * step) * transition.by_turn
    along = model.along_noise * jnp.sqrt(way) * jnp.stack([cos, sin, none, none])
    aside = model.side_noise * jnp.sqrt(way) * jnp.stack([-sin, cos, none, none])
    pose = jnp.outer(turning, turning) + jnp.outer(along, along) + jnp.outer(aside, aside)
    fresh = -jnp.expm1(-2.0 * _ages(model, motion))
    walks = jnp.stack(
        [
            model.scale_walk**2 * way,
            model.turn_scale_walk**2 * turn,
            model.slip_sigma**2 * fresh[SLIP_LEFT - SCALE],
            model.slip_sigma**2 * fresh[SLIP_RIGHT - SCALE],
            model.slip_ahead_walk_m**2 * turn,
            model.drift_walk**2 * step,
            fresh[-2],
            fresh[-1],
        ]
    )
    return jnp.pad(pose, (0, len(walks))) + jnp.diag(jnp.pad(walks, (len(pose), 0)))


def _turn_share(model: SkidModel, motion: SkidMotion) -> Float[Array, ""]:
    """How much of the turn scale holds: all of it in a turn, nothing where the sides differ by no more than noise.

    A factor fitted to noise would be drawn to minus one on every straight line.
    """
    square = ((motion.right_mps - motion.left_mps) / model.track_m) ** 2
    return square / (square + model.least_turn_radps**2)


def _ages(model: SkidModel, motion: SkidMotion) -> Float[Array, " 8"]:
    """A tick in correlation lengths or times of the states after the pose; none for those that do not fade."""
    none = jnp.zeros_like(motion.step_s)
    left, right = (jnp.abs(side) * motion.step_s / model.slip_m for side in (motion.left_mps, motion.right_mps))
    slow = motion.step_s / model.gnss_slow_s
    return jnp.stack([none, none, left, right, none, none, slow, slow])


def _apply(transition: SkidTransition, matrix: Float[Array, "12 12"]) -> Float[Array, "12 12"]:
    """F times a matrix: four rows are sums, the others are scaled. Elementwise: many lanes, and all digits kept."""
    pose = (transition.pose_rows[:, :, None] * matrix[None, :, :]).sum(axis=1)
    return jnp.concatenate([pose, transition.decay[:, None] * matrix[TURNED + 1 :]])
