"""How sure a fix is: covariance from the correlation's peak, thresholds, and the code."""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from lgprjax.registration.fix import Code


class Thresholds(NamedTuple):
    """What a fix must reach to be called ``ok``.

    Attributes:
        strength: least correlation times the root of the overlap (see ``Score``).
        margin: least lead over the runner-up.
        margin_by_chance: the same in units of what the strength scatters by over the rest of the region.
        overlap: least share of the template's traces on the map.
    """

    strength: float | Float[Array, ""]
    margin: float | Float[Array, ""]
    margin_by_chance: float | Float[Array, ""]
    overlap: float | Float[Array, ""]


PRIOR = (3.0, 3.0, 9.0, 9.0, 9.0)
"""Information of the prior, per squared half width of the region: position uniform within it, attitude and height
normal with the half width as three sigma."""


def default_thresholds(window_m: float = 0.0) -> Thresholds:
    """One set for all ground, by how long a window of scans is matched as one (0 for single scans).

    *Strength* parts ground that is the map's from other ground: over 10,068 single scans of four generated roads that
    are not the map's the best match anywhere in the search reached 0.60, and no sum of strength and margin did
    better than strength alone. Windows of real parallel lines lie at 0.6 to 0.9 where they are right.

    *Margin by chance* parts places from their look-alikes. On ground that repeats itself, over 10,000 single scans, the
    lead of the better of two equal places reached 1.30 of the scatter, with windows of a metre 0.55; on other
    ground a right single scan leads by more than 1.4 of it in 99 cases of 100, in snow in 95. Right windows of
    4 m on real lines lead by 0.5 and more in 9 of 10. What makes one of two equal places look better averages out
    over a window; the form of its fall with the length is a fit to these figures.
    """
    return Thresholds(
        strength=0.55 if window_m > 0.0 else 0.64,
        margin=0.045,
        margin_by_chance=1.4 / (1.0 + window_m / 2.0),
        overlap=0.6,
    )


def stencil_poses(pose: Float[Array, "5"], steps: Float[Array, "5"]) -> Float[Array, "31 5"]:
    """The pose, its neighbours along each axis, and those along the diagonal of each pair of axes."""
    unit = np.eye(5, dtype=np.float32)
    rows, columns = np.triu_indices(5, k=1)
    pair = unit[rows] + unit[columns]
    offsets = np.concatenate([np.zeros((1, 5), np.float32), unit, -unit, pair, -pair])
    return pose[None, :] + jnp.asarray(offsets) * steps[None, :]


def curvature(stencil: Float[Array, " pose"], steps: Float[Array, "5"]) -> Float[Array, "5 5"]:
    """Hessian of the score from its values at ``stencil_poses``, by central differences.

    At the map's rim a step may lead off it, and says nothing there: the step to the other side then stands for
    both (a summit is level), and a diagonal one for none.
    """
    on_map = stencil > -1.5
    centre, plus, minus = stencil[0], stencil[1:6], stencil[6:11]
    plus_on, minus_on = on_map[1:6], on_map[6:11]
    plus, minus = (
        jnp.where(plus_on, plus, jnp.where(minus_on, minus, centre)),
        jnp.where(minus_on, minus, jnp.where(plus_on, plus, centre)),
    )
    rows, columns = np.triu_indices(5, k=1)
    both = plus + minus
    diagonal = (both - 2.0 * centre) / steps**2
    pairs = stencil[11:21] + stencil[21:31] + 2.0 * centre - both[rows] - both[columns]
    known = on_map[11:21] & on_map[21:31] & (plus_on & minus_on)[rows] & (plus_on & minus_on)[columns]
    mixed = jnp.where(known, pairs / (2.0 * steps[rows] * steps[columns]), 0.0)
    return jnp.diag(diagonal).at[rows, columns].set(mixed).at[columns, rows].set(mixed)


def noise_scale(correlation: Float[Array, ""], floor: Float[Array, ""]) -> Float[Array, ""]:
    """How much correlation one unit of log-likelihood is worth at a peak: (1 - r²)/(N r), see ``peak_covariance``."""
    numbers = jnp.clip(1.0 / jnp.maximum(floor, 1e-3) ** 2, 4.0, 4000.0)
    r = jnp.clip(correlation, 0.05, 0.999)
    return (1.0 - r**2) / (numbers * r)


def peak_covariance(
    stencil: Float[Array, " pose"],
    steps: Float[Array, "5"],
    floor: Float[Array, ""],
    half_width: Float[Array, "5"],
) -> Float[Array, "5 5"]:
    """Covariance of a pose from the correlation around its peak.

    With the gain projected out, the log-likelihood of a template of N independent numbers is
    -N/2 log(1 - r²), whose curvature at the peak is N r/(1 - r²) times that of r. N is not the number of
    samples: neighbours in depth, channel and track repeat each other. Ground that does not match scatters
    with variance 1/N, so the surface away from the peak tells N. To this comes the prior (see ``PRIOR``): what
    the radar does not see (roll, often) keeps the prior's width.

    Args:
        stencil: correlations at the poses of ``stencil_poses``.
        steps: of the stencil.
        floor: standard deviation of the correlation away from the peak.
        half_width: of the search region.
    """
    centre, hessian = stencil[0], curvature(stencil, steps)
    information = -hessian / noise_scale(centre, floor)
    # Where a step to either side leaves the map (the line of a single channel), the map itself says how far.
    narrow = ~(stencil[1:6] > -1.5) & ~(stencil[6:11] > -1.5)
    information = information + jnp.diag(jnp.where(narrow, 3.0 / steps**2, 0.0))
    # A direction that looks like a valley (noise on a flat peak) carries no information, not negative one.
    scaled = information * half_width[:, None] * half_width[None, :]
    value, vector = jnp.linalg.eigh(0.5 * (scaled + scaled.T))
    seen = (vector * jnp.maximum(value, 0.0)[None, :]) @ vector.T
    covariance: Float[Array, "5 5"] = jnp.linalg.inv(seen + jnp.diag(jnp.asarray(PRIOR, dtype=jnp.float32)))
    return covariance * half_width[:, None] * half_width[None, :]


def judge(
    strength: Float[Array, ""],
    margin: Float[Array, ""],
    floor: Float[Array, ""],
    best_overlap: Float[Array, ""],
    on_edge: Bool[Array, ""],
    finite: Bool[Array, ""],
    thresholds: Thresholds,
) -> Int[Array, ""]:
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
    reasons = (
        (~finite, Code.NON_FINITE),
        (best_overlap <= 0.0, Code.OFF_MAP),
        (best_overlap < thresholds.overlap, Code.LOW_OVERLAP),
        (~(strength >= thresholds.strength), Code.LOW_CORRELATION),
        (on_edge, Code.EDGE),
        (~(margin >= least_margin), Code.AMBIGUOUS),
    )
    code = jnp.asarray(Code.OK, dtype=jnp.int32)
    for applies, reason in reversed(reasons):
        code = jnp.where(applies, jnp.int32(reason), code)
    return code
