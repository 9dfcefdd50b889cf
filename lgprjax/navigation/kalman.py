"""The filters' common core: an observation against an estimate, its gain, and the update in Joseph's form.

Any number of states, one to three components. An observation depends on a few states, and everything is written out by
rows, so that a tick of hundreds of batch elements stays elementwise.
"""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

Row = dict[int, Float[Array, ""]]
"""Derivatives of one component by the states it depends on."""


class Innovation(NamedTuple):
    """An observation against the filter's expectation; neutral if nothing usable was offered.

    Attributes:
        residual: observed minus expected, one to three components.
        rows: derivatives of the expectation, one a component.
        noise: covariance of the observation's white noise.
        offered: valid, and finite in every number.
    """

    residual: Float[Array, " part"]
    rows: tuple[Row, ...]
    noise: Float[Array, "part part"]
    offered: Bool[Array, ""]


class Weighed(NamedTuple):
    """An innovation against its own covariance.

    Attributes:
        nis: normalised innovation squared.
        gain: one row a component.
        crossed: HP, the covariance of each component with the states.
        covariance: of the innovation, S.
    """

    nis: Float[Array, ""]
    gain: Float[Array, "part state"]
    crossed: Float[Array, "part state"]
    covariance: Float[Array, "part part"]


def usable(observation: tuple[Array, ...]) -> Bool[Array, ""]:
    """Valid, which an observation's last field says, and every number of it finite."""
    finite = [jnp.all(jnp.isfinite(part)) for part in observation[:-1]]
    return observation[-1] & jnp.all(jnp.stack(finite))


def innovation_of(
    residual: Float[Array, " part"],
    rows: tuple[Row, ...],
    noise: Float[Array, "part part"],
    offered: Bool[Array, ""],
) -> Innovation:
    """The innovation, neutral if nothing usable was offered."""
    neutral = jnp.eye(len(rows), dtype=noise.dtype)
    return Innovation(jnp.where(offered, residual, 0.0), rows, jnp.where(offered, noise, neutral), offered)


def weigh(covariance: Float[Array, "state state"], innovation: Innovation) -> Weighed:
    """Gain and normalised innovation squared, by a Cholesky factor written out: one to three components.

    Args:
        covariance: of the states.
        innovation: of the observation.
    """
    rows, parts = innovation.rows, range(len(innovation.rows))
    crossed = [_along_row(row, covariance) for row in rows]
    spread = [[_along_row(rows[j], crossed[i]) + innovation.noise[i, j] for j in range(i + 1)] for i in parts]
    factor: list[list[Float[Array, ""]]] = []
    white: list[Float[Array, ""]] = []
    gain: list[Float[Array, " state"]] = []
    for i in parts:
        line: list[Float[Array, ""]] = []
        for j in range(i + 1):
            value = spread[i][j]
            for m in range(j):
                value = value - line[m] * (factor[j][m] if j < i else line[m])
            # Rounding may reduce a variance to zero; the gate then handles a huge innovation.
            line.append(value / factor[j][j] if j < i else jnp.sqrt(jnp.maximum(value, 1e-12)))
        factor.append(line)
        row, residual = crossed[i], innovation.residual[i]
        for m in range(i):
            row, residual = row - line[m] * gain[m], residual - line[m] * white[m]
        gain.append(row / line[i])
        white.append(residual / line[i])
    nis = white[0] * white[0]
    for i in reversed(parts):
        for m in range(i + 1, len(rows)):
            gain[i] = gain[i] - factor[m][i] * gain[m]
        gain[i] = gain[i] / factor[i][i]
        nis = nis + white[i] * white[i] if i else nis
    whole = jnp.stack([jnp.stack([spread[max(i, j)][min(i, j)] for j in parts]) for i in parts])
    return Weighed(nis, jnp.stack(gain), jnp.stack(crossed), whole)


def correct(
    mean: Float[Array, " state"],
    covariance: Float[Array, "state state"],
    innovation: Innovation,
    weighed: Weighed,
    use: Bool[Array, ""],
) -> tuple[Float[Array, " state"], Float[Array, "state state"]]:
    """Mean and covariance after an observation, by Joseph's form: P ← (I − KH) P (I − KH)ᵀ + K R Kᵀ.

    It is multiplied out to P − Σ (k eᵀ + e kᵀ) with e = HP − S k / 2 by component: that is symmetric but for the last
    digit, and a rounded gain enters squared, as in the product. Rounding errors are 1e-7 of the previous covariance: in
    float32 a standard deviation may fall to a thousandth in one update, not to less.

    Args:
        mean, covariance: of the states before.
        innovation: of the observation.
        weighed: from ``weigh``.
        use: whether it is used; if not, the estimate stays what it is.
    """
    gain = jnp.where(use, weighed.gain, 0.0)
    for part in range(len(innovation.rows)):
        rest = weighed.crossed[part]
        for other in range(len(innovation.rows)):
            rest = rest - 0.5 * weighed.covariance[part, other] * gain[other]
        covariance = covariance - (jnp.outer(gain[part], rest) + jnp.outer(rest, gain[part]))
        mean = mean + innovation.residual[part] * gain[part]
    return mean, covariance


def reopen(
    mean: Float[Array, " state"],
    covariance: Float[Array, "state state"],
    moves: dict[int, Float[Array, ""]],
    variances: dict[int, Float[Array, ""]],
    use: Bool[Array, ""],
) -> tuple[Float[Array, " state"], Float[Array, "state state"]]:
    """Mean and covariance with some states reset: moved, with new variances, and uncorrelated with the others.

    Args:
        mean, covariance: of the states before.
        moves: by state, what is added to its mean.
        variances: by state, its variance from now on.
        use: whether they are let go; if not, the estimate stays what it is.
    """
    picks = np.eye(mean.size, dtype=np.bool_)
    gone = use & jnp.asarray(picks[list(moves)].any(axis=0))
    fresh, moved = jnp.zeros_like(mean), jnp.zeros_like(mean)
    for state, move in moves.items():
        fresh, moved = jnp.where(picks[state], variances[state], fresh), jnp.where(picks[state], move, moved)
    # Selected, not multiplied: a NaN must not reach a state through a factor of zero.
    tied = jnp.where(gone[:, None] | gone[None, :], 0.0, covariance)
    return mean + jnp.where(gone, moved, 0.0), tied + jnp.diag(jnp.where(gone, fresh, 0.0))


def _along_row(row: Row, matrix: Float[Array, "state ..."]) -> Float[Array, "..."]:
    """An observation's row times a matrix or vector of the states."""
    total = jnp.zeros_like(matrix[0])
    for state, weight in row.items():
        total = total + weight * matrix[state]
    return total


# Motion of a body point along an arc, and its derivatives: the filter's only geometry.
#
# The zero-slip point moves ds along the body axis while the body turns by dθ, so it moves by the arc's chord
# ds sinc(dθ/2) in the direction dθ/2; every other point of the body turns about it. Nothing is divided by the
# curvature, and reversing is a negative ds with a negative turn.

Scalar = Float[Array, "..."]
Pair = tuple[Scalar, Scalar]


class Reach(NamedTuple):
    """A body point after an arc, in the body axes before it, from the rear axle before it.

    Attributes:
        at_m: forward and left.
        by_travel: derivative of both by the travel.
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
    # Below a tenth of a radian the series is exact in float32, and the quotients lose digits.
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
    """A body vector in the frame in which the body is rotated by an angle."""
    return cos * vector[0] - sin * vector[1], sin * vector[0] + cos * vector[1]


def wrap_yaw(angle_rad: Float[Array, "..."]) -> Float[Array, "..."]:
    """The same angle in [-π, π]."""
    return angle_rad - 2.0 * jnp.pi * jnp.round(angle_rad / (2.0 * jnp.pi))
