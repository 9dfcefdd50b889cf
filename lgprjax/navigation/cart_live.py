"""The hand cart live, a few seconds late: each pose smoothed by the fixes that came after it.

A course is seen only by the fix that follows; a stop or a turn on the spot only some fixes later. So the newest heading
is the least certain of all, and may be wrong just before it is given up. What is mapped waits for
``CartModel.notice_s``: its poses are smoothed backward from the newest one (Rauch et al. 1965), and none counts whose
heading has been given up since.
"""

import math
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from lgprjax.navigation.cart_filter import (
    YAW,
    CartEstimate,
    CartFilterState,
    CartModel,
    SmoothedCart,
    cart_pose_covariance,
    init_cart,
    step_back_cart,
    step_cart,
)
from lgprjax.navigation.observations import GateRules, GnssObservation


class LateCart(NamedTuple):
    """The filter, and the ticks that are still waiting, oldest first.

    Attributes:
        filter: at the newest tick's end.
        before: estimate at each tick's start; step_s: its length.
        broken: see ``CartInfo``; known: the heading at its end.
    """

    filter: CartFilterState
    before: CartEstimate
    step_s: Float[Array, " tick"]
    broken: Bool[Array, " tick"]
    known: Bool[Array, " tick"]


def late_ticks(model: CartModel, tick_s: float) -> int:
    """Number of ticks for which a pose waits."""
    return math.ceil(float(model.notice_s) / tick_s)


def init_late_cart(model: CartModel, x_m: Float[Array, ""], y_m: Float[Array, ""], ticks: int) -> LateCart:
    """The start: approximate position, heading unknown; ``ticks``: that a pose waits."""
    state = init_cart(model, x_m, y_m)
    before = jax.tree.map(lambda leaf: jnp.broadcast_to(leaf, (ticks, *leaf.shape)), state.estimate)
    return LateCart(state, before, jnp.zeros(ticks, jnp.float32), jnp.ones(ticks, bool), jnp.zeros(ticks, bool))


def step_late_cart(
    model: CartModel, rules: GateRules, state: LateCart, step_s: Float[Array, ""], fix: GnssObservation
) -> tuple[LateCart, SmoothedCart]:
    """One tick of the filter, and the pose at the start of the oldest tick that waits. Unbatched.

    Args:
        model, rules, step_s, fix: see ``step_cart``.
        state: at the tick's start.
    """
    after, info = step_cart(model, rules, state.filter, step_s, fix)

    def pushed(many: Array, newest: Array) -> Array:
        return jnp.concatenate([many[1:], jnp.asarray(newest)[None]])

    waiting = LateCart(
        after,
        jax.tree.map(pushed, state.before, state.filter.estimate),
        pushed(state.step_s, step_s),
        pushed(state.broken, info.broken),
        pushed(state.known, info.heading_known),
    )

    def back(later: CartEstimate, tick: tuple[CartEstimate, Array, Array]) -> tuple[CartEstimate, None]:
        return step_back_cart(model, later, *tick), None

    ticks = (waiting.before, waiting.step_s, waiting.broken)
    oldest: CartEstimate = jax.lax.scan(back, after.estimate, ticks, reverse=True)[0]
    known = jnp.all(waiting.known) & ~jnp.any(waiting.broken)
    return waiting, SmoothedCart(oldest.mean[: YAW + 1], cart_pose_covariance(model, oldest), known)
