"""The probability that one pass of the tool reached a place, its pose known with errors (MF section 3).

The error of the pose is one draw from its covariance, the same while the tool crosses the place. In the tool's axes the
place then comes from ahead and leaves behind. Where it is r ahead of the tool's centre it is seen

    Z(r) = e_left + (A + r) e_yaw − v − κ (A (r + ε) + (r² − ε²)/2)

to the right of it: v its offset to the left as it crosses the centre, A how far the tool is ahead of the reference
point, κ the curvature of its way (the arc is taken exactly), ε = e_forward − y e_yaw the error along the way, y the
place's offset from the reference point. The pass reached it if |Z(r)| ≤ half the width at an r that the tool's length,
the beginning and the end of the pass allow: first − ε ≥ r ≥ last − ε, |r| ≤ half the length.

Over that range Z is least and largest at its ends, so a bound holds if it holds at one of them. With Z in the middle of
the range and the part of e_yaw that is not related to it, each end leaves Z in the middle a bound that moves a little;
the larger one is taken with its mean and variance (Clark 1961). So all but ε is in closed form, and ε is summed over
nodes of Gauss and Legendre.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from lgprjax.coverage.tool import Tool

_TAIL = 4.0
"""Sigmas of the error along the way that are counted: the rest, 6 in 100,000, is never claimed."""
_STEEPEST = 0.95
"""Correlation of the errors along and aside beyond which the nodes no longer see it."""
_LEAST_M2 = 1e-10
_NODES = np.stack(np.polynomial.legendre.leggauss(12), axis=1)


class Passing(NamedTuple):
    """How places go through the tool's axes, the pose taken as it was estimated; any leading axes.

    Attributes:
        covariance: of forward (m), left (m) and yaw (rad) while the tool crosses the place.
        left_m: offset of the place from the tool's centre as it crosses its axis.
        curvature_radpm: of the place's way; 0 on a straight pass.
        first_m, last_m: how far ahead of the tool's centre it was at the beginning of the pass, and is at its end.
    """

    covariance: Float[Array, "... 3 3"]
    left_m: Float[Array, "..."]
    curvature_radpm: Float[Array, "..."]
    first_m: Float[Array, "..."]
    last_m: Float[Array, "..."]


def pass_probability(tool: Tool, passing: Passing) -> Float[Array, "..."]:
    """Probability that the tool was over each place between the beginning and the end of a pass.

    Args:
        tool: its rectangle.
        passing: of the places; covariances must be positive definite.
    """
    half_length = 0.5 * tool.length_m
    side = passing.left_m + tool.left_m
    along, error = _errors(tool, passing.covariance, side)
    # Of second order, on average: a turned lever is shorter, and a turned body moves aside while it moves aside.
    yaw = passing.covariance[..., 2, 2]
    drop = 0.5 * tool.ahead_m * yaw + passing.covariance[..., 1, 2]
    first, last = passing.first_m - drop, passing.last_m - drop
    left = passing.left_m + 0.5 * side * yaw

    sigma = jnp.sqrt(along)
    low = jnp.clip((last - half_length) / sigma, -_TAIL, _TAIL)
    high = jnp.clip((first + half_length) / sigma, -_TAIL, _TAIL)
    half_span = 0.5 * jnp.maximum(high - low, 0.0)

    def part(node: Float[Array, "2"]) -> Float[Array, "..."]:
        standard = low + half_span * (1.0 + node[0])
        shift_m = sigma * standard
        behind, before = jnp.maximum(last - shift_m, -half_length), jnp.minimum(first - shift_m, half_length)
        reached = _aside(tool, left, passing.curvature_radpm, error, shift_m, behind, before)
        return node[1] * half_span * _density(standard) * reached

    total = jnp.sum(jax.vmap(part)(jnp.asarray(_NODES, jnp.float32)), axis=0)
    return jnp.clip(total, 0.0, 1.0)


class _Aside(NamedTuple):
    """Errors to the left and of yaw given that along the way: slopes upon it, and what is left of their covariance."""

    left_slope: Float[Array, "..."]
    yaw_slope_radpm: Float[Array, "..."]
    left_m2: Float[Array, "..."]
    left_yaw_m: Float[Array, "..."]
    yaw_rad2: Float[Array, "..."]


def _errors(
    tool: Tool, covariance: Float[Array, "... 3 3"], side: Float[Array, "..."]
) -> tuple[Float[Array, "..."], _Aside]:
    """Variance of the error along the way at an offset from the reference point, and the others given it."""
    ahead, yaw = tool.ahead_m, covariance[..., 2, 2]
    forward_yaw, left_yaw = covariance[..., 0, 2], covariance[..., 1, 2]
    along = jnp.maximum(covariance[..., 0, 0] - 2.0 * side * forward_yaw + side * side * yaw, _LEAST_M2)
    left = covariance[..., 1, 1] + 2.0 * ahead * left_yaw + ahead * ahead * yaw
    along_yaw = forward_yaw - side * yaw
    both = covariance[..., 0, 1] - side * left_yaw + ahead * along_yaw
    most = _STEEPEST * jnp.sqrt(along * jnp.maximum(left, _LEAST_M2))
    both = jnp.clip(both, -most, most)
    left_turned = left_yaw + ahead * yaw
    given = _Aside(
        left_slope=both / along,
        yaw_slope_radpm=along_yaw / along,
        left_m2=left - both * both / along,
        left_yaw_m=left_turned - both * along_yaw / along,
        yaw_rad2=jnp.maximum(yaw - along_yaw * along_yaw / along, 0.0),
    )
    return along, given


def _aside(
    tool: Tool,
    left_m: Float[Array, "..."],
    curvature_radpm: Float[Array, "..."],
    error: _Aside,
    shift_m: Float[Array, "..."],
    behind: Float[Array, "..."],
    before: Float[Array, "..."],
) -> Float[Array, "..."]:
    """Probability of the width, given the error along the way; r goes from ``behind`` to ``before``."""

    def expected(r: Float[Array, "..."]) -> Float[Array, "..."]:
        turned = tool.ahead_m * (r + shift_m) + 0.5 * (r * r - shift_m * shift_m)
        root = jnp.sqrt(jnp.maximum(1.0 - 2.0 * turned * curvature_radpm * curvature_radpm, 0.0))
        drawn = (error.left_slope + r * error.yaw_slope_radpm) * shift_m
        return drawn - left_m - 2.0 * curvature_radpm * turned / (1.0 + root)

    middle, half_span = 0.5 * (behind + before), 0.5 * (before - behind)
    # Z in the middle of the range, and the yaw as far as it is told by that and as far as it is not.
    shared = error.left_yaw_m + middle * error.yaw_rad2
    middle_m2 = jnp.maximum(error.left_m2 + middle * (error.left_yaw_m + shared), _LEAST_M2)
    slope = jnp.clip(half_span * shared / middle_m2, -0.5, 0.5)
    rest_rad2 = jnp.maximum(error.yaw_rad2 - shared * shared / middle_m2, 0.0)
    ends = _Ends(
        expected(behind), expected(before), 1.0 / (1.0 - slope), 1.0 / (1.0 + slope), half_span * jnp.sqrt(rest_rad2)
    )
    half_width = 0.5 * tool.width_m
    within = _cumulative_of_larger(ends, half_width, middle_m2)
    mirrored = ends._replace(behind=-ends.behind, before=-ends.before)
    beyond = 1.0 - _cumulative_of_larger(mirrored, half_width, middle_m2)
    return jnp.maximum(within - beyond, 0.0)


class _Ends(NamedTuple):
    """Z at both ends of the range.

    Attributes:
        behind, before: expected there.
        behind_gain, before_gain: how far Z in the middle moves for a metre there.
        spread_m: standard deviation of what the rest of the yaw adds, with opposite signs.
    """

    behind: Float[Array, "..."]
    before: Float[Array, "..."]
    behind_gain: Float[Array, "..."]
    before_gain: Float[Array, "..."]
    spread_m: Float[Array, "..."]


def _cumulative_of_larger(
    ends: _Ends, bound_m: float | Float[Array, ""], middle_m2: Float[Array, "..."]
) -> Float[Array, "..."]:
    """Probability that Z is below a bound at one end at least.

    Each end leaves Z in the middle a bound of its own, which moves with the rest of the yaw; the larger one counts, and
    its mean and variance are those of the larger of two normal values (Clark 1961).
    """
    one, other = ends.behind_gain * (bound_m - ends.behind), ends.before_gain * (bound_m - ends.before)
    apart, spread = one - other, ends.spread_m * (ends.behind_gain + ends.before_gain)
    ratio = apart / jnp.maximum(spread, 1e-9)
    share = _cumulative(ratio)
    width = apart * (2.0 * share - 1.0) + 2.0 * spread * _density(ratio)
    moved = share * ends.behind_gain * ends.behind_gain + (1.0 - share) * ends.before_gain * ends.before_gain
    variance = 0.25 * (apart * apart - width * width) + moved * ends.spread_m * ends.spread_m
    return _cumulative(0.5 * (one + other + width) * jax.lax.rsqrt(middle_m2 + jnp.maximum(variance, 0.0)))


def _density(standard: Float[Array, "..."]) -> Float[Array, "..."]:
    return float(1.0 / np.sqrt(2.0 * np.pi)) * jnp.exp(-0.5 * standard * standard)


def _cumulative(standard: Float[Array, "..."]) -> Float[Array, "..."]:
    return 0.5 + 0.5 * jax.lax.erf(float(np.sqrt(0.5)) * standard)
