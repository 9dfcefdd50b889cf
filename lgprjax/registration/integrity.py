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
        overlap: least share of the template's traces on the map.
    """

    strength: float | Float[Array, ""]
    margin: float | Float[Array, ""]
    overlap: float | Float[Array, ""]


def default_thresholds() -> Thresholds:
    """One set for all ground.

    Real parallel lines lie at 0.6 to 0.9 where they are right and lead by 0.05 or more; ground that is not
    the map's stays below 0.3 on real and generated data alike (docs/performance.md has the tables).
    """
    return Thresholds(strength=0.55, margin=0.045, overlap=0.6)


def stencil_poses(pose: Float[Array, "5"], steps: Float[Array, "5"]) -> Float[Array, "31 5"]:
    """The pose, its neighbours along each axis, and those along the diagonal of each pair of axes."""
    unit = np.eye(5, dtype=np.float32)
    rows, columns = np.triu_indices(5, k=1)
    pair = unit[rows] + unit[columns]
    offsets = np.concatenate([np.zeros((1, 5), np.float32), unit, -unit, pair, -pair])
    return pose[None, :] + jnp.asarray(offsets) * steps[None, :]


def curvature(stencil: Float[Array, " pose"], steps: Float[Array, "5"]) -> Float[Array, "5 5"]:
    """Hessian of the score from its values at ``stencil_poses``, by central differences."""
    # A step off the map says nothing about the summit's shape.
    stencil = jnp.where(stencil > -1.5, stencil, stencil[0])
    centre, plus, minus = stencil[0], stencil[1:6], stencil[6:11]
    rows, columns = np.triu_indices(5, k=1)
    diagonal = (plus + minus - 2.0 * centre) / steps**2
    mixed = (stencil[11:21] + stencil[21:31] + 2.0 * centre - (plus + minus)[rows] - (plus + minus)[columns]) / (
        2.0 * steps[rows] * steps[columns]
    )
    return jnp.diag(diagonal).at[rows, columns].set(mixed).at[columns, rows].set(mixed)


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
    with variance 1/N, so the surface away from the peak tells N. The search region itself is a prior: what
    the radar does not see (roll, often) keeps the region's width.

    Args:
        stencil: correlations at the poses of ``stencil_poses``.
        steps: of the stencil.
        floor: standard deviation of the correlation away from the peak.
        half_width: of the search region.
    """
    centre, hessian = stencil[0], curvature(stencil, steps)
    numbers = jnp.clip(1.0 / jnp.maximum(floor, 1e-3) ** 2, 4.0, 4000.0)
    r = jnp.clip(centre, 0.0, 0.999)
    information = -hessian * numbers * r / (1.0 - r**2)
    # A direction that looks like a valley (noise on a flat peak) carries no information, not negative one.
    scaled = information * half_width[:, None] * half_width[None, :]
    value, vector = jnp.linalg.eigh(0.5 * (scaled + scaled.T))
    covariance: Float[Array, "5 5"] = (vector / (jnp.maximum(value, 0.0) + 3.0)[None, :]) @ vector.T
    return covariance * half_width[:, None] * half_width[None, :]


def judge(
    strength: Float[Array, ""],
    margin: Float[Array, ""],
    best_overlap: Float[Array, ""],
    on_edge: Bool[Array, ""],
    finite: Bool[Array, ""],
    thresholds: Thresholds,
) -> Int[Array, ""]:
    """The code of a fix; the first reason that applies, from the input outward.

    Args:
        strength, margin: of the fix.
        best_overlap: largest share of the template on the map anywhere in the region.
        on_edge: the best pose stands at the region's rim.
        finite: enough of the template's traces hold finite data.
        thresholds: to reach.
    """
    reasons = (
        (~finite, Code.NON_FINITE),
        (best_overlap <= 0.0, Code.OFF_MAP),
        (best_overlap < thresholds.overlap, Code.LOW_OVERLAP),
        (~(strength >= thresholds.strength), Code.LOW_CORRELATION),
        (on_edge, Code.EDGE),
        (~(margin >= thresholds.margin), Code.AMBIGUOUS),
    )
    code = jnp.asarray(Code.OK, dtype=jnp.int32)
    for applies, reason in reversed(reasons):
        code = jnp.where(applies, jnp.int32(reason), code)
    return code
