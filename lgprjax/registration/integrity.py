"""How sure a fix is: thresholds, and the code."""

from math import log2
from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from lgprjax.registration.fix import Code


class Thresholds(NamedTuple):
    """What a fix must reach to be called ``ok``.

    Attributes:
        strength: least correlation times the root of the overlap (see ``Score``).
        margin: least lead over the runner-up.
        margin_by_chance: the same in units of what the strength scatters by over the rest of the region.
        overlap: least share of the template's traces on the map.
        sigma_scale: what a match's sigmas are multiplied by to be those of its errors.
        strength_by_chance: least strength in units of what it scatters by over the rest of the region.
    """

    strength: float | Float[Array, ""]
    margin: float | Float[Array, ""]
    margin_by_chance: float | Float[Array, ""]
    overlap: float | Float[Array, ""]
    sigma_scale: float | Float[Array, ""] = 1.0
    strength_by_chance: float | Float[Array, ""] = 0.0


def default_thresholds(window_m: float = 0.0, search_m: float = 1.5) -> Thresholds:
    """One set for all ground, by how long a window of scans is matched as one (0 for single scans).

    *Strength* parts ground that is the map's from other ground: over 10,068 single scans of four generated roads that
    are not the map's the best match anywhere in the search reached 0.60, and no sum of strength and margin did
    better than strength alone. The highest of more places is higher: searched to 3.5 and to 7 m, an impostor's single
    scans reach 0.65, and single scans are asked 0.05 more for each doubling of the side. Windows of real parallel lines
    lie at 0.6 to 0.9 where they are right.

    *Margin by chance* parts places from their look-alikes. On ground that repeats itself, over 10,000 single scans, the
    lead of the better of two equal places reached 1.30 of the scatter, with windows of a metre 0.55; on other
    ground a right single scan leads by more than 1.4 of it in 99 cases of 100, in snow in 95. Right windows of
    4 m on real lines lead by 0.5 and more in 9 of 10. What makes one of two equal places look better averages out
    over a window; the form of its fall with the length is a fit to these figures.
    """
    return Thresholds(
        strength=0.55 if window_m > 0.0 else 0.64 + 0.05 * max(0.0, log2(search_m / 1.5)),
        margin=0.045,
        margin_by_chance=1.4 / (1.0 + window_m / 2.0),
        overlap=0.6,
    )


def independent_numbers(floor: Float[Array, "*batch"]) -> Float[Array, "*batch"]:
    """How many independent numbers a template holds, from what ground that does not match scatters by."""
    return jnp.clip(1.0 / jnp.maximum(floor, 1e-3) ** 2, 4.0, 4000.0)


def judge(
    strength: Float[Array, "*batch"],
    margin: Float[Array, "*batch"],
    floor: Float[Array, "*batch"],
    best_overlap: Float[Array, "*batch"],
    on_edge: Bool[Array, "*batch"],
    finite: Bool[Array, "*batch"],
    thresholds: Thresholds,
) -> Int[Array, "*batch"]:
    """The code of a fix; the first reason that applies, from the input outward.

    Args:
        strength, margin: of the fix.
        floor: standard deviation of the strength over the rest of the region.
        best_overlap: largest share of the template on the map anywhere in the region.
        on_edge: the best pose stands at the region's rim.
        finite: enough of the template's traces hold finite data.
        thresholds: to reach.
    """
    least_margin = jnp.maximum(thresholds.margin, thresholds.margin_by_chance * floor)
    least_strength = jnp.maximum(thresholds.strength, thresholds.strength_by_chance * floor)
    reasons = (
        (~finite, Code.NON_FINITE),
        (best_overlap <= 0.0, Code.OFF_MAP),
        (best_overlap < thresholds.overlap, Code.LOW_OVERLAP),
        (~(strength >= least_strength), Code.LOW_CORRELATION),
        (on_edge, Code.EDGE),
        (~(margin >= least_margin), Code.AMBIGUOUS),
    )
    code = jnp.full(strength.shape, Code.OK, dtype=jnp.int32)
    for applies, reason in reversed(reasons):
        code = jnp.where(applies, jnp.int32(reason), code)
    return code
