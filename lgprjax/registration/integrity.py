"""How sure a match must be to be called ok."""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from lgprjax.registration.chance import POOLED, Chance
from lgprjax.registration.fix import Code

MIN_OVERLAP = 0.6
"""Least share of a template's traces on the map."""

_ONE_LOOK = 0.1  # of the independent looks of a piece


class Thresholds(NamedTuple):
    """What a match must reach to be called ``ok``, in units of the noise floor: what its score comes to by chance.

    Attributes:
        strength_by_chance: least score.
        margin_by_chance: least lead over the runner-up.
        overlap: least share of the template's traces on the map.
        sigma_scale: what a match's sigmas are multiplied by to be those of its errors.
    """

    strength_by_chance: float
    margin_by_chance: float
    overlap: float = MIN_OVERLAP
    sigma_scale: float = 1.0


def thresholds_at(
    risk: float, window_m: float, area_m2: float, wavelength_m: float, chance: Chance = POOLED
) -> Thresholds:
    """Thresholds of a single match that foreign ground passes with probability ``risk``.

    A drive has many looks within a piece, which its search counts (``p_foreign``); a template that is matched once has
    one.
    """
    own = chance.for_windows((window_m,), wavelength_m)
    more = max(area_m2 / float(own.area_m2[0]), 0.1)
    square = float(own.start[0] + own.scale[0] * np.log(max(_ONE_LOOK * float(own.share[0]) * more / risk, 1e-3)))
    return Thresholds(strength_by_chance=max(square, 4.0) ** 0.5, margin_by_chance=1.0)


def independent_numbers(floor: Float[Array, "*batch"]) -> Float[Array, "*batch"]:
    """How many independent numbers a template holds, from what ground that does not match scatters by."""
    return jnp.clip(1.0 / jnp.maximum(floor, 1e-3) ** 2, 4.0, 4000.0)


def judge(
    score: Float[Array, "*batch"],
    rival: Float[Array, "*batch"],
    floor: Float[Array, "*batch"],
    best_overlap: Float[Array, "*batch"],
    on_edge: Bool[Array, "*batch"],
    finite: Bool[Array, "*batch"],
    thresholds: Thresholds,
) -> Int[Array, "*batch"]:
    """The code of a fix; the first reason that applies, from the input outward.

    Args:
        score, rival: of the best place and of the best one apart from it.
        floor: standard deviation of the score over the rest of the region.
        best_overlap: largest share of the template on the map anywhere in the region.
        on_edge: the best pose stands at the region's rim.
        finite: enough of the template's traces hold finite data.
        thresholds: to reach.
    """
    reasons = (
        (~finite, Code.NON_FINITE),
        (best_overlap <= 0.0, Code.OFF_MAP),
        (best_overlap < thresholds.overlap, Code.LOW_OVERLAP),
        (~(score >= thresholds.strength_by_chance * floor), Code.LOW_CORRELATION),
        (on_edge, Code.EDGE),
        (~(score - rival >= thresholds.margin_by_chance * floor), Code.AMBIGUOUS),
    )
    code = jnp.full(score.shape, Code.OK, dtype=jnp.int32)
    for applies, reason in reversed(reasons):
        code = jnp.where(applies, jnp.int32(reason), code)
    return code
