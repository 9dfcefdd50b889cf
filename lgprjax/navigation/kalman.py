"""The extended Kalman filter and smoother that every vehicle uses.

A model gives functions of its states: ``move`` to the end of a tick, and ``expect`` for each observation of one to
three components. Their derivatives are taken here, by forward differentiation at the estimate. The states of every
model begin with x, y and yaw.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

YAW = 2
"""Index of the yaw in the states of every model."""


class Estimate(NamedTuple):
    """Mean and covariance of a model's states; the covariance is symmetric."""

    mean: Float[Array, "... state"]
    covariance: Float[Array, "... state state"]


class Transition(NamedTuple):
    """A tick's motion, linearised at the estimate before it.

    Attributes:
        mean: the states after the tick.
        matrix: F, their derivatives by the states before it.
        noise: Q, the covariance that the tick adds.
    """

    mean: Float[Array, " state"]
    matrix: Float[Array, "state state"]
    noise: Float[Array, "state state"]


class Innovation(NamedTuple):
    """An observation minus its expectation; neutral if nothing usable was offered.

    Attributes:
        residual: observed minus expected, one to three components.
        rows: H, derivatives of the expectation by the states.
        noise: covariance of the observation's white noise.
        offered: valid, and finite in every number.
    """

    residual: Float[Array, " part"]
    rows: Float[Array, "part state"]
    noise: Float[Array, "part part"]
    offered: Bool[Array, ""]


class Weighed(NamedTuple):
    """An innovation against its own covariance.

    Attributes:
        nis: normalised innovation squared.
        gain: one row per component.
        crossed: HP, the covariance of each component with the states.
        covariance: of the innovation, S.
    """

    nis: Float[Array, ""]
    gain: Float[Array, "part state"]
    crossed: Float[Array, "part state"]
    covariance: Float[Array, "part part"]


def linearise(
    move: Callable[[Float[Array, " state"], Float[Array, " noise"]], Float[Array, " state"]],
    mean: Float[Array, " state"],
    sigmas: Float[Array, " noise"],
) -> Transition:
    """The transition of a tick.

    Args:
        move: f, from states and noises to the states after the tick.
        mean: of the states before it.
        sigmas: standard deviations of the noises, which are independent and zero in the mean.
    """
    none = jnp.zeros_like(sigmas)
    # By noises and by states in two passes: with arrays above half a kilobyte XLA runs a small step in several threads,
    # which is slower.
    spread = jax.jacfwd(move, 1)(mean, none) * sigmas[None]
    return Transition(move(mean, none), jax.jacfwd(move)(mean, none), times(spread, spread.T))


def predict(covariance: Float[Array, "state state"], transition: Transition) -> Estimate:
    """The estimate after a tick, from the covariance before it."""
    moved = times(times(transition.matrix, covariance), transition.matrix.T)
    # Rounding leaves the two halves apart by a digit; here they are brought together once a tick.
    return Estimate(transition.mean, 0.5 * (moved + moved.T) + transition.noise)


def usable(observation: tuple[Array, ...]) -> Bool[Array, ""]:
    """Valid, which an observation's last field says, and every number of it finite."""
    finite = [jnp.all(jnp.isfinite(part)) for part in observation[:-1]]
    return observation[-1] & jnp.all(jnp.stack(finite))


def innovation_of(
    mean: Float[Array, " state"],
    expect: Callable[[Float[Array, " state"]], Float[Array, " part"]],
    observed: Float[Array, " part"],
    noise: Float[Array, "part part"],
    offered: Bool[Array, ""],
    *,
    angle: int | None = None,
) -> Innovation:
    """The innovation, neutral if nothing usable was offered.

    Args:
        mean: of the states.
        expect: h, the expected observation; finite with its derivatives whatever the slot holds.
        observed: the observation.
        noise: covariance of its white noise.
        offered: whether it is usable.
        angle: the component that is an angle, whose difference is taken within half a turn.
    """
    residual = observed - expect(mean)
    if angle is not None:
        residual = residual.at[angle].set(wrap_yaw(residual[angle]))
    neutral = jnp.eye(len(residual), dtype=noise.dtype)
    rows = jax.jacfwd(expect)(mean)
    return Innovation(jnp.where(offered, residual, 0.0), rows, jnp.where(offered, noise, neutral), offered)


def weigh(estimate: Estimate, innovation: Innovation) -> Weighed:
    """Gain and normalised innovation squared, by a Cholesky factor written out: one to three components."""
    crossed = times(innovation.rows, estimate.covariance)
    spread = times(crossed, innovation.rows.T) + innovation.noise
    parts = range(len(spread))
    factor: list[list[Float[Array, ""]]] = []
    solved: list[Float[Array, " state_and_residual"]] = []
    for i in parts:
        row = jnp.append(crossed[i], innovation.residual[i])
        line: list[Float[Array, ""]] = []
        for j in range(i):
            line.append((spread[i, j] - sum(line[m] * factor[j][m] for m in range(j))) / factor[j][j])
            row = row - line[j] * solved[j]
        # Rounding may reduce a variance to zero; the gate then handles a huge innovation.
        line.append(jnp.sqrt(jnp.maximum(spread[i, i] - sum(value * value for value in line), 1e-12)))
        factor.append(line)
        solved.append(row / line[i])
    white = jnp.stack([row[-1] for row in solved])
    gain = [row[:-1] for row in solved]
    for i in reversed(parts):
        gain[i] = (gain[i] - sum(factor[m][i] * gain[m] for m in parts[i + 1 :])) / factor[i][i]
    return Weighed(jnp.sum(white * white), jnp.stack(gain), crossed, spread)


def correct(estimate: Estimate, innovation: Innovation, weighed: Weighed, use: Bool[Array, ""]) -> Estimate:
    """The estimate after an observation, by Joseph's form: P ← (I − KH) P (I − KH)ᵀ + K R Kᵀ.

    It is multiplied out to P − (Kᵀ E + Eᵀ K) with E = HP − S K / 2, K one row per component: that is symmetric, and a
    rounded gain enters squared, as in the product. Rounding errors are 1e-7 of the previous covariance: in
    float32 a standard deviation may fall to a thousandth in one update, not to less.

    Args:
        estimate: before.
        innovation: of the observation.
        weighed: from ``weigh``.
        use: whether it is used; if not, the estimate stays what it is.
    """
    gain = jnp.where(use, weighed.gain, 0.0)
    change = times(gain.T, weighed.crossed - 0.5 * times(weighed.covariance, gain))
    mean = estimate.mean + times(innovation.residual[None], gain)[0]
    return Estimate(mean, estimate.covariance - (change + change.T))


def reopen(
    estimate: Estimate,
    moves: dict[int, Float[Array, ""]],
    variances: dict[int, Float[Array, ""]],
    use: Bool[Array, ""],
) -> Estimate:
    """The estimate with some states reset: moved, with new variances, and uncorrelated with the others.

    Args:
        estimate: before.
        moves: change of each state's mean.
        variances: by state, its variance from now on.
        use: whether they are let go; if not, the estimate stays what it is.
    """
    mean, covariance = estimate
    picks = np.eye(mean.size, dtype=np.bool_)
    gone = use & jnp.asarray(picks[list(moves)].any(axis=0))
    fresh, moved = jnp.zeros_like(mean), jnp.zeros_like(mean)
    for state, move in moves.items():
        fresh, moved = jnp.where(picks[state], variances[state], fresh), jnp.where(picks[state], move, moved)
    # Selected, not multiplied: a NaN must not reach a state through a factor of zero.
    tied = jnp.where(gone[:, None] | gone[None, :], 0.0, covariance)
    return Estimate(mean + jnp.where(gone, moved, 0.0), tied + jnp.diag(jnp.where(gone, fresh, 0.0)))


def smooth(filtered: Estimate, back: Callable[..., Estimate], ticks: tuple[Any, ...]) -> Estimate:
    """Estimates of a drive, each by earlier and later observations (Rauch, Tung and Striebel 1965).

    Args:
        filtered: after each tick.
        back: from the smoothed estimate after a tick, the filtered one before it and the tick to the smoothed one.
        ticks: arguments of ``back``, leading axis tick.
    """

    def step(later: Estimate, tick: tuple[Any, ...]) -> tuple[Estimate, Estimate]:
        smoothed = back(later, *tick)
        return smoothed, smoothed

    last = jax.tree.map(lambda leaf: leaf[-1], filtered)
    before = jax.tree.map(lambda leaf: leaf[:-1], filtered)
    following = jax.tree.map(lambda leaf: leaf[1:], ticks)
    earlier = jax.lax.scan(step, last, (before, *following), reverse=True)[1]
    whole: Estimate = jax.tree.map(lambda many, one: jnp.concatenate([many, one[None]]), earlier, last)
    return whole


def step_back(later: Estimate, before: Estimate, transition: Transition, broken: Bool[Array, ""]) -> Estimate:
    """The smoothed estimate before a tick; across a broken tick that is the filtered one.

    Args:
        later: smoothed, after the tick.
        before: filtered, before it.
        transition: the tick's, at ``before``.
        broken: nothing is propagated back.
    """
    forward = times(transition.matrix, before.covariance)
    gain = regression(predict(before.covariance, transition).covariance, forward)
    # A sum of squares: rounding cannot make it indefinite, as the difference of the textbook's form would.
    kept = jnp.eye(before.mean.size, dtype=jnp.float32) - times(gain, transition.matrix)
    spread = times(times(kept, before.covariance), kept.T)
    spread = spread + times(times(gain, transition.noise + later.covariance), gain.T)
    mean = before.mean + times(gain, apart(later.mean, transition.mean)[:, None])[:, 0]
    smoothed = Estimate(mean, 0.5 * (spread + spread.T))
    picked: Estimate = jax.tree.map(lambda one, other: jnp.where(broken, one, other), before, smoothed)
    return picked


def regression(
    covariance: Float[Array, "state state"], crossed: Float[Array, "state part"]
) -> Float[Array, "part state"]:
    """Crossed covariance over covariance, scaled: float32 then holds microradians as well as metres."""
    sigma = jnp.sqrt(jnp.maximum(jnp.diagonal(covariance), 1e-20))
    # The ridge is the precision of a correlation in float32.
    correlation = covariance / (sigma[:, None] * sigma[None, :]) + 1e-6 * jnp.eye(sigma.size, dtype=sigma.dtype)
    solved: Float[Array, "state part"] = jax.scipy.linalg.solve(correlation, crossed / sigma[:, None], assume_a="pos")
    return solved.T / sigma[None, :]


def apart(one: Float[Array, " state"], other: Float[Array, " state"]) -> Float[Array, " state"]:
    """The difference of states, that of the yaw within half a turn."""
    return wrapped(Estimate(one - other, one)).mean


def wrapped(estimate: Estimate) -> Estimate:
    """The estimate with its yaw in [-π, π]."""
    mean = estimate.mean
    return estimate._replace(mean=jnp.where(np.arange(mean.size) == YAW, wrap_yaw(mean), mean))


def times(one: Float[Array, "row inner"], other: Float[Array, "inner column"]) -> Float[Array, "row column"]:
    """The product of matrices with all digits of float32: accelerators round factors by default."""
    # Small ones are fused with what precedes them if summed elementwise: the hand cart's smoother takes half the time.
    if max(*one.shape, *other.shape) <= 8:
        return (one[:, :, None] * other[None]).sum(axis=1)
    return jnp.matmul(one, other, precision="highest")


# Motion of a body point along an arc: the filters' only geometry.
#
# The zero-slip point moves ds along the body axis while the body turns by dθ, so it moves by the arc's chord
# ds sinc(dθ/2) in the direction dθ/2; every other point of the body turns about it. Nothing is divided by the
# curvature, and reversing is a negative ds with a negative turn.

Pair = tuple[Float[Array, "..."], Float[Array, "..."]]


def reach(
    travel_m: Float[Array, "..."],
    turn_rad: Float[Array, "..."],
    zero_slip_m: Float[Array, "..."],
    x_m: Float[Array, "..."],
    y_m: Float[Array, "..."],
) -> Pair:
    """The body point (x, y) after an arc, forward and left in the body axes before it, from the rear axle before it.

    Args:
        travel_m: ds, negative in reverse.
        turn_rad: dθ, counter-clockwise.
        zero_slip_m: x_c, of the point that moves along the body axis.
        x_m, y_m: the point in the body, from the rear axle.
    """
    half = 0.5 * turn_rad
    cos_half, sin_half = jnp.cos(half), jnp.sin(half)
    square = half * half
    # Below a tenth of a radian the series is exact in float32, and the quotient loses digits.
    small = square < 0.01
    chord = jnp.where(small, 1.0 - square / 6.0 * (1.0 - square / 20.0), sin_half / jnp.where(small, 1.0, half))
    cos, sin = cos_half * cos_half - sin_half * sin_half, 2.0 * sin_half * cos_half
    x, y = turned(cos, sin, (x_m - zero_slip_m, y_m))
    return travel_m * (chord * cos_half) + zero_slip_m + x, travel_m * (chord * sin_half) + y


def turned(cos: Float[Array, "..."], sin: Float[Array, "..."], vector: Pair) -> Pair:
    """A body vector in the frame in which the body is rotated by an angle."""
    return cos * vector[0] - sin * vector[1], sin * vector[0] + cos * vector[1]


def wrap_yaw(angle_rad: Float[Array, "..."]) -> Float[Array, "..."]:
    """The same angle in [-π, π]."""
    return angle_rad - 2.0 * jnp.pi * jnp.round(angle_rad / (2.0 * jnp.pi))
