"""The finish: Gauss-Newton from a coarse place to the summit of the correlation, in all degrees of freedom.

With the scale alpha projected out, the correlation of live traces S with the ground G is highest where
|S - alpha G|² is least, so that its gradient is exact and its curvature needs first derivatives only: those of the
bilinear map in the plane, and the phase ramp of a height. All that a step asks of a trace are thirteen sums over
depth (``trace_sums``); the rest is the chain rule.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from lgprjax.radar import LIGHT_SPEED_M_PER_NS
from lgprjax.registration.correlation import OFF_MAP_SCORE, Template, normalise, strength_of
from lgprjax.registration.trace_sums import Heard, hear_traces, leads_off_map, normal_equations, trace_sums
from lgprjax.subsurface import Tile

PRIOR = (3.0, 3.0, 9.0, 9.0, 9.0, 9.0)
"""Information of the prior, per squared half width of the region: position uniform within it, attitude and height
normal with the half width as three sigma."""

CLIMB_STEPS = 3
"""Poses measured on a climb: two steps from a coarse place reach the centimetre."""

_LARGEST_STEP = (1.5, 1.5, 0.04, 0.035, 0.03, 0.03)
"""Of place in cells along the tile, which are a tenth of a wavelength; of the rest in metres and radians."""
_RIDGE = 1e-5  # share of its diagonal that a step's matrix gets on top


class Summit(NamedTuple):
    """Where a climb ended.

    Attributes:
        pose: with pitch as its sixth number.
        correlation, strength: there, see ``Score``; ``OFF_MAP_SCORE`` where overlap is missing.
        information: of the match alone, per unit of 1/(1 - r²) and of independent numbers (see ``covariance_of``).
        covered: traces on the map.
        narrow: along and cross: a cell to either side of the pose leads off the map.
        left_m: along and cross: the step that the slope there still asks for.
    """

    pose: Float[Array, "batch 6"]
    correlation: Float[Array, " batch"]
    strength: Float[Array, " batch"]
    information: Float[Array, "batch 6 6"]
    covered: Bool[Array, "batch trace"]
    narrow: Bool[Array, "batch 2"]
    left_m: Float[Array, "batch 2"]


def climb(
    tile: Tile,
    height_reference_m: Float[Array, ""],
    angular_frequency_rad_per_ns: Float[Array, " half"],
    min_overlap: float | Float[Array, ""],
    template: Template,
    start: Float[Array, "batch 6"],
    prior: Float[Array, "batch 6"],
    half_width: Float[Array, "batch 6"],
    numbers: Float[Array, " batch"],
    free: Bool[Array, "6"],
    *,
    steps: int = CLIMB_STEPS,
) -> Summit:
    """Climb from each start; the best pose on the way is the answer.

    Args:
        tile, height_reference_m, angular_frequency_rad_per_ns, min_overlap: as for ``score_poses``.
        template: batched, one for each start.
        start: along_m, cross_m, height_m, yaw_rad, roll_rad, pitch_rad in the tile's frame.
        prior: the same, with ``half_width`` the search region about it; attitude and height are held to it.
        numbers: independent numbers that a template holds: what the match weighs against the prior.
        free: degrees of freedom that may move.
        steps: poses measured; with one, only the start is.
    """
    live_power = jnp.sum(template.coefficients**2, axis=-1)
    held = jnp.asarray(PRIOR, dtype=jnp.float32)[None] / half_width**2
    pull = held.at[:, :2].set(0.0)
    cap = jnp.asarray(_LARGEST_STEP, dtype=jnp.float32).at[:2].multiply(tile.cell_m[0])[None]
    traces = jnp.maximum(jnp.sum(template.valid, axis=-1, dtype=jnp.float32), 1.0)
    rate = angular_frequency_rad_per_ns * (2.0 / LIGHT_SPEED_M_PER_NS)
    both = free[:, None] & free[None, :]
    unit = jnp.eye(6, dtype=jnp.float32)

    def hear(pose: Float[Array, "batch 6"]) -> Heard:
        return hear_traces(tile, template, pose, height_reference_m, rate)

    def measure(pose: Float[Array, "batch 6"], heard: Heard, best: _Best) -> tuple[Array, _Best]:
        sums = trace_sums(heard, rate, tile.cell_m)
        overlap = jnp.sum(heard.covered, axis=-1, dtype=jnp.float32) / traces
        power = jnp.sum(jnp.where(heard.covered, live_power, 0.0), axis=-1)
        product, ground = jnp.sum(sums.live_ground, axis=-1), jnp.sum(sums.ground_ground, axis=-1)
        correlation = normalise(product, power, ground, overlap, min_overlap)
        strength = strength_of(correlation, overlap)
        information, gradient = normal_equations(sums, heard, template, pose, power)
        weight = numbers / jnp.maximum(1.0 - correlation**2, 1e-3)
        away = pose - prior
        posterior = strength - 0.5 * jnp.sum(pull * away**2, axis=-1) / jnp.maximum(weight * correlation, 1e-3)
        matrix = jnp.where(both[None], weight[:, None, None] * information, 0.0) + unit[None] * held[:, None, :]
        # Directions that only rounding tells apart (a single channel's along and yaw) must not end the factorisation.
        matrix = matrix * (1.0 + _RIDGE * unit[None])
        side = jnp.where(free[None], weight[:, None] * gradient - pull * away, 0.0)
        lower = jax.lax.linalg.cholesky(matrix, symmetrize_input=False)
        move = jnp.clip(jax.scipy.linalg.cho_solve((lower, True), side[..., None])[..., 0], -cap, cap)
        move = jnp.where((strength > OFF_MAP_SCORE)[:, None], move, 0.0)
        here = _Best(pose, posterior, correlation, strength, information, heard.covered, move[:, :2])
        better = posterior > best.posterior
        best = jax.tree.map(
            lambda new, old: jnp.where(better.reshape(-1, *(1,) * (new.ndim - 1)), new, old), here, best
        )
        return jnp.clip(pose + move, prior - half_width, prior + half_width), best

    # What a pose hears is carried into the next round: gathered once, not anew for each of the sums, as the compiler
    # would have it within one.
    def step(_: Int[Array, ""], carry: tuple[Array, Heard, _Best]) -> tuple[Array, Heard, _Best]:
        after, best = measure(*carry)
        return after, hear(after), best

    off = jnp.full(len(start), OFF_MAP_SCORE, jnp.float32)
    none = _Best(
        start,
        jnp.full(len(start), -jnp.inf, jnp.float32),
        off,
        off,
        jnp.zeros((len(start), 6, 6), jnp.float32),
        jnp.zeros(template.valid.shape, bool),
        jnp.zeros((len(start), 2), jnp.float32),
    )
    pose, heard, best = jax.lax.fori_loop(0, steps - 1, step, (start, hear(start), none))
    _, best = measure(pose, heard, best)
    narrow = leads_off_map(tile, template, best.pose, min_overlap)
    return Summit(best.pose, best.correlation, best.strength, best.information, best.covered, narrow, best.left_m)


class _Best(NamedTuple):
    """The best pose of a climb so far."""

    pose: Float[Array, "batch 6"]
    posterior: Float[Array, " batch"]
    correlation: Float[Array, " batch"]
    strength: Float[Array, " batch"]
    information: Float[Array, "batch 6 6"]
    covered: Bool[Array, "batch trace"]
    left_m: Float[Array, "batch 2"]


def covariance_of(
    summit: Summit,
    numbers: Float[Array, " batch"],
    half_width: Float[Array, "batch 6"],
    free: Bool[Array, "6"],
    cell_m: Float[Array, "2"],
) -> Float[Array, "batch 5 5"]:
    """Covariance of each pose, its pitch marginalised.

    With the gain projected out, the log-likelihood of a template of N independent numbers is -N/2 log(1 - r²). N is
    not the number of samples: neighbours in depth, channel and track repeat each other. Ground that does not match
    scatters with variance 1/N, so the surface away from the peak tells N. To this comes the prior (see ``PRIOR``):
    what the radar does not see (roll, often) keeps the prior's width.
    """
    weight = numbers / jnp.maximum(1.0 - summit.correlation**2, 1e-3)
    # Where a step to either side leaves the map (the line of a single channel), the map itself says how far.
    bound = jnp.pad(jnp.where(summit.narrow, 3.0 / cell_m[None] ** 2, 0.0), [(0, 0), (0, 4)])
    diagonal = jnp.asarray(PRIOR, dtype=jnp.float32)[None] / half_width**2 + bound
    matrix = weight[:, None, None] * summit.information
    matrix = jnp.where((free[:, None] & free[None, :])[None], matrix, 0.0) + jax.vmap(jnp.diag)(diagonal)
    scale = 1.0 / jnp.sqrt(jax.vmap(jnp.diag)(matrix))
    inverse = jnp.linalg.inv(matrix * scale[:, :, None] * scale[:, None, :])[:, :5, :5]
    covariance: Float[Array, "batch 5 5"] = inverse * scale[:, :5, None] * scale[:, None, :5]
    return covariance
