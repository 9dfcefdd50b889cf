"""The tool's shape at a level of confidence, for the errors of one moment (MF section 3, fig. 3).

A place belongs to the shape if the tool is over it now with at least the level's probability, given the covariance of
the pose. Its density is log-concave and so is the rectangle: the shape is convex, and its border is found along rays
from the tool's centre. The source had to choose among shapes computed in advance; here it is exact and live.
"""

from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from lgprjax.coverage.field import Tool, ToolMoment
from lgprjax.coverage.worked import Passing, covariance_in_body, pass_probability, usable_moment

RAYS = 48
_HALVINGS = 14
"""Bisections of a ray's length: the border is found to a ten-thousandth of the tool's diagonal."""
_FAR_M = 1e3


class ClaimedShape(NamedTuple):
    """The tool's shape at a level of confidence.

    Attributes:
        border_m: points in body axes from the reference point, forward and left, counter-clockwise; NaN where no place
            reaches the level.
        right_m, left_m: offsets from the tool's centre between which a straight pass claims the ground, left positive;
            both 0 where a pass claims nothing.
    """

    border_m: Float[Array, "ray 2"]
    right_m: Float[Array, ""]
    left_m: Float[Array, ""]


@partial(jax.jit, static_argnames="tool")
def claimed_shape(
    tool: Tool, moment: ToolMoment, level: Float[Array, ""], shared_sigma_m: Float[Array, ""]
) -> ClaimedShape:
    """The shape of a moment, whether its tool is on or not; empty where a moment could not count (``step_pass``).

    Args:
        tool: rectangle of the tool, as plain numbers.
        moment: moment, unbatched.
        level: confidence level, 0.5 < level < 1.
        shared_sigma_m: see ``run_worked``.
    """
    covariance = moment.covariance + jnp.square(shared_sigma_m) * jnp.diag(jnp.array([1.0, 1.0, 0.0], jnp.float32))
    usable = usable_moment(moment._replace(covariance=covariance))
    safe = jnp.where(usable, covariance, jnp.eye(3, dtype=jnp.float32))
    body = covariance_in_body(safe, moment.yaw_rad)

    def reached(ahead_m: Float[Array, " ray"], left_m: Float[Array, " ray"], far_m: float) -> Float[Array, " ray"]:
        shape = jnp.shape(left_m)
        passing = Passing(
            jnp.broadcast_to(body, (*shape, 3, 3)), left_m, jnp.zeros(shape), ahead_m + far_m, ahead_m - far_m
        )
        return pass_probability(tool, passing)

    def border(ahead: np.ndarray, left: np.ndarray, far_m: float) -> Float[Array, " ray"]:
        """Share of each ray's length up to which the level is reached; 0 if it is not reached at the centre."""

        def halve(_: int, span: tuple[Array, Array]) -> tuple[Array, Array]:
            low, high = span
            middle = 0.5 * (low + high)
            inside = reached(middle * ahead, middle * left, far_m) >= level
            return jnp.where(inside, middle, low), jnp.where(inside, high, middle)

        none = jnp.zeros(len(ahead), jnp.float32)
        share = jax.lax.fori_loop(0, _HALVINGS, halve, (none, jnp.ones_like(none)))[0]
        return jnp.where(usable & (reached(none, none, far_m) >= level), share, 0.0)

    # Towards the points of an ellipse with the rectangle's proportions, so that its corners are met as well.
    angle = 2.0 * np.pi * np.arange(RAYS) / RAYS
    ahead, left = (np.sqrt(0.5) * size * way(angle) for size, way in ((tool.length_m, np.cos), (tool.width_m, np.sin)))
    share = border(ahead, left, 0.0)
    places = jnp.stack([tool.ahead_m + share * ahead, tool.left_m + share * left], axis=1)
    sides = np.array([-0.5, 0.5]) * tool.width_m
    right_m, left_m = border(np.zeros(2), sides, _FAR_M) * sides
    return ClaimedShape(jnp.where(jnp.any(share > 0.0), places, jnp.nan), right_m, left_m)
