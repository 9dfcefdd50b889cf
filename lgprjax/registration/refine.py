"""Refinement of a candidate to a pose: the climb to its peak, and the covariance of the pose there."""

from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int, Key, UInt32

from lgprjax.pso import Objective, SwarmConfig, run_swarm, watch_swarm
from lgprjax.radar import LIGHT_SPEED_M_PER_NS
from lgprjax.registration.judge import independent_numbers
from lgprjax.registration.score import (
    OFF_MAP_SCORE,
    Pieces,
    SampledGround,
    Score,
    Template,
    leads_off_map,
    match_pieces,
    normal_equations,
    normalise,
    sample_ground_under,
    score_poses,
    trace_sums,
)
from lgprjax.subsurface import Tile

# Refinement: Gauss-Newton from a coarse place to the peak of the correlation, in all degrees of freedom.
#
# With the scale alpha projected out, the likelihood of live traces S over the ground G is highest where |S - alpha G|²
# is least, so that its gradient is exact and its curvature needs first derivatives only: those of the bilinear map in
# the plane, and the phase ramp of a height. A step needs only thirteen sums over depth of each trace (``score``); the
# rest is the chain rule.

PRIOR = (3.0, 3.0, 9.0, 9.0, 9.0, 9.0)
"""Information of the prior, per squared half width of the region: position uniform within it, attitude and height
normal with the half width as three sigma."""

CLIMB_STEPS = 3
"""Poses measured on a climb: two steps from a coarse place reach the centimetre."""
FAR_STEPS = 9
"""The same where the attitude may be far from the prior's: steps are short, lest a climb leaves its peak."""

LARGEST_STEP = (1.5, 1.5, 0.04, 0.035, 0.03, 0.03)
"""Position in cells along the tile, which are a tenth of a wavelength; the rest in metres and radians."""
_SHORTER = 0.25  # of a step that led to less
_RIDGE = 1e-5  # share of its diagonal added to a step's matrix


class RefinedPeak(NamedTuple):
    """Result of a climb.

    Attributes:
        pose: best pose, with pitch as its sixth number.
        correlation: correlation at the pose; ``OFF_MAP_SCORE`` without enough overlap.
        overlap: share of the template's traces on the map.
        information: information matrix of the match alone (see ``covariance_of``).
        covered: mask of traces on the map.
        narrow: whether, along and cross, a cell to either side of the pose is off the map.
        asked: remaining Gauss-Newton step at the pose, without a limit.
    """

    pose: Float[Array, "batch 6"]
    correlation: Float[Array, " batch"]
    overlap: Float[Array, " batch"]
    information: Float[Array, "batch 6 6"]
    covered: Bool[Array, "batch trace"]
    narrow: Bool[Array, "batch 2"]
    asked: Float[Array, "batch 6"]


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
    steps: int | Int[Array, ""] = CLIMB_STEPS,
) -> RefinedPeak:
    """Climb from each start and return the best pose on the way.

    A step to a lower value is repeated from its start, a quarter as long.

    Args:
        tile, height_reference_m, angular_frequency_rad_per_ns, min_overlap: as for ``score_poses``.
        template: templates, one for each start.
        start: along_m, cross_m, height_m, yaw_rad, roll_rad, pitch_rad in the tile's frame.
        prior: prior pose in the same order, with the search region of ``half_width`` about it; attitude and height are
            weighed against it.
        numbers: number of independent numbers in a template, the weight of the match against the prior.
        free: mask of free degrees of freedom.
        steps: number of poses evaluated; 1: only the start.
    """
    live_power = jnp.sum(template.coefficients**2, axis=-1)
    held = jnp.asarray(PRIOR, dtype=jnp.float32)[None] / half_width**2
    pull = held.at[:, :2].set(0.0)
    cap = jnp.asarray(LARGEST_STEP, dtype=jnp.float32).at[:2].multiply(tile.cell_m[0])[None]
    traces = jnp.maximum(jnp.sum(template.valid, axis=-1, dtype=jnp.float32), 1.0)
    rate = angular_frequency_rad_per_ns * (2.0 / LIGHT_SPEED_M_PER_NS)
    both = free[:, None] & free[None, :]
    unit = jnp.eye(6, dtype=jnp.float32)

    def hear(pose: Float[Array, "batch 6"]) -> SampledGround:
        return sample_ground_under(tile, template, pose, height_reference_m, rate)

    def measure(
        pose: Float[Array, "batch 6"], sampled: SampledGround, best: _Best, length: Float[Array, " batch"]
    ) -> tuple[Array, _Best, Array]:
        sums = trace_sums(sampled, rate, tile.cell_m)
        overlap = jnp.sum(sampled.covered, axis=-1, dtype=jnp.float32) / traces
        power = jnp.where(sampled.covered, live_power, 0.0)
        product, live, ground = (jnp.sum(field, axis=-1) for field in (sums.live_ground, power, sums.ground_ground))
        correlation = normalise(product, live, ground, overlap, min_overlap)
        pieces = match_pieces(sums.live_ground, sums.ground_ground, power, template.scan, numbers * overlap)
        information, gradient = normal_equations(sums, pieces, sampled, template, pose)
        away = pose - prior
        on_map = correlation > OFF_MAP_SCORE
        evidence = _evidence(correlation, pieces)
        posterior = jnp.where(on_map, evidence - 0.5 * jnp.sum(pull * away**2, axis=-1), -jnp.inf)
        matrix = jnp.where(both[None], information, 0.0) + unit[None] * held[:, None, :]
        # Directions that differ by rounding only (a single channel's along and yaw) must not break the factorisation.
        matrix = matrix * (1.0 + _RIDGE * unit[None])
        side = jnp.where(free[None], gradient - pull * away, 0.0)
        lower = jax.lax.linalg.cholesky(matrix, symmetrize_input=False)
        asked = jax.scipy.linalg.cho_solve((lower, True), side[..., None])[..., 0]
        asked = jnp.where(on_map[:, None], asked, 0.0)
        here = _Best(
            pose=pose,
            posterior=posterior,
            correlation=correlation,
            overlap=overlap,
            information=information,
            covered=sampled.covered,
            asked=asked,
        )
        better = posterior > best.posterior
        best = jax.tree.map(
            lambda new, old: jnp.where(better.reshape(-1, *(1,) * (new.ndim - 1)), new, old), here, best
        )
        length = jnp.where(better, 1.0, _SHORTER * length)
        move = length[:, None] * jnp.clip(best.asked, -cap, cap)
        return jnp.clip(best.pose + move, prior - half_width, prior + half_width), best, length

    # The traces sampled at a pose are carried into the next round: gathered once, where the compiler would gather them
    # again for each of the sums.
    def step(
        _: Int[Array, ""], carry: tuple[Array, SampledGround, _Best, Array]
    ) -> tuple[Array, SampledGround, _Best, Array]:
        after, best, length = measure(*carry)
        return after, hear(after), best, length

    none = _Best(
        pose=start,
        posterior=jnp.full(len(start), -jnp.inf, jnp.float32),
        correlation=jnp.full(len(start), OFF_MAP_SCORE, jnp.float32),
        overlap=jnp.zeros(len(start), jnp.float32),
        information=jnp.zeros((len(start), 6, 6), jnp.float32),
        covered=jnp.zeros(template.valid.shape, bool),
        asked=jnp.zeros((len(start), 6), jnp.float32),
    )
    whole = jnp.ones(len(start), jnp.float32)
    pose, sampled, best, length = jax.lax.fori_loop(0, steps - 1, step, (start, hear(start), none, whole))
    _, best, _ = measure(pose, sampled, best, length)
    narrow = leads_off_map(tile, template, best.pose, min_overlap)
    return RefinedPeak(
        pose=best.pose,
        correlation=best.correlation,
        overlap=best.overlap,
        information=best.information,
        covered=best.covered,
        narrow=narrow,
        asked=best.asked,
    )


def _evidence(correlation: Float[Array, " batch"], pieces: Pieces) -> Float[Array, " batch"]:
    """Log-likelihood of each pose by the independent numbers on the map; traces off the map do not count. Without a
    match, the correlation itself.
    """
    return jnp.where(correlation > 0.0, pieces.evidence, correlation)


class _Best(NamedTuple):
    """The best pose of a climb so far."""

    pose: Float[Array, "batch 6"]
    posterior: Float[Array, " batch"]
    correlation: Float[Array, " batch"]
    overlap: Float[Array, " batch"]
    information: Float[Array, "batch 6 6"]
    covered: Bool[Array, "batch trace"]
    asked: Float[Array, "batch 6"]


def covariance_of(
    peak: RefinedPeak,
    half_width: Float[Array, "batch 6"],
    free: Bool[Array, "6"],
    cell_m: Float[Array, "2"],
) -> Float[Array, "batch 5 5"]:
    """Covariance of each pose, its pitch marginalised.

    With the gain projected out, the log-likelihood of a piece of N independent numbers on the map is -N/2 log(1 - r²)
    (``match_pieces``). N is not the number of samples: neighbours in depth, channel and track are correlated. Ground
    that does not match scores with variance 1/N, so N follows from the surface away from the peak. The prior is added
    (see ``PRIOR``): what the radar does not observe (often roll) keeps the prior's width.
    """
    # Where a step to either side leaves the map (the line of a single channel), the map bounds the error.
    bound = jnp.pad(jnp.where(peak.narrow, 3.0 / cell_m[None] ** 2, 0.0), [(0, 0), (0, 4)])
    diagonal = jnp.asarray(PRIOR, dtype=jnp.float32)[None] / half_width**2 + bound
    matrix = jnp.where((free[:, None] & free[None, :])[None], peak.information, 0.0) + jax.vmap(jnp.diag)(diagonal)
    scale = 1.0 / jnp.sqrt(jax.vmap(jnp.diag)(matrix))
    inverse = jnp.linalg.inv(matrix * scale[:, :, None] * scale[:, None, :])[:, :5, :5]
    covariance: Float[Array, "batch 5 5"] = inverse * scale[:, :5, None] * scale[:, None, :5]
    return covariance


# Refinement by particle swarm: around each coarse peak, in all five degrees of freedom, on the direct score.
#
# The search of the first system of this kind (LL), an alternative to Gauss-Newton that needs no derivative of the
# score.

_REACH_M = 0.12
"""Around a peak the swarm explores only what the coarse stage left open, so that peaks stay distinct."""
_SEEN = 41
"""Positions to a side at which a watched swarm's score is shown."""

Start = tuple[Template, Float[Array, "6"], Float[Array, "6"], Float[Array, "6"], Float[Array, ""], UInt32[Array, ""]]
"""One start: template, start, prior and half widths, independent numbers, seed."""


def swarm_poses(
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
    seed: UInt32[Array, ""],
    start_seed: UInt32[Array, " batch"],
    *,
    config: SwarmConfig,
) -> Float[Array, "batch 6"]:
    """Best pose of a swarm around each start; arguments as for ``climb``, with a seed for each batch element."""
    ground = (tile, height_reference_m, angular_frequency_rad_per_ns, min_overlap)

    def one(given: Start) -> Float[Array, "6"]:
        hunt = _hunt(ground, given, free, seed, config)
        ended = run_swarm(hunt.key, hunt.cloud, hunt.posterior, free[:5], config=config)
        return jnp.concatenate([hunt.centre + ended.position * hunt.reach, given[1][5:]])

    poses: Float[Array, "batch 6"] = jax.lax.map(one, (template, start, prior, half_width, numbers, start_seed))
    return poses


class SwarmView(NamedTuple):
    """History of a swarm around one start; places along and across in the tile's frame.

    Attributes:
        place_m: positions of the particles at the start and after each iteration.
        best_m: the best place found by any of them so far.
        attitude: height in metres, yaw and roll of the particles, less the prior's.
        best_attitude: attitude of the best place found so far.
        best_score: the best score found by each of them so far; -inf before the first.
        along_m, cross_m, score: the objective over positions, with the rest of the pose as the swarm left it.
    """

    place_m: Float[Array | np.ndarray, "iteration particle 2"]
    best_m: Float[Array | np.ndarray, "iteration 2"]
    attitude: Float[Array | np.ndarray, "iteration particle 3"]
    best_attitude: Float[Array | np.ndarray, "iteration 3"]
    best_score: Float[Array | np.ndarray, "iteration particle"]
    along_m: Float[Array | np.ndarray, " along"]
    cross_m: Float[Array | np.ndarray, " cross"]
    score: Float[Array | np.ndarray, "along cross"]


@partial(jax.jit, static_argnames="config")
def watch_finish(
    tile: Tile,
    height_reference_m: Float[Array, ""],
    angular_frequency_rad_per_ns: Float[Array, " half"],
    min_overlap: float | Float[Array, ""],
    template: Template,
    start: Float[Array, "6"],
    prior: Float[Array, "6"],
    half_width: Float[Array, "6"],
    numbers: Float[Array, ""],
    free: Bool[Array, "6"],
    seed: UInt32[Array, ""],
    start_seed: UInt32[Array, ""],
    reach_m: float | Float[Array, ""] = _REACH_M,
    *,
    config: SwarmConfig,
) -> SwarmView:
    """One batch element of ``swarm_poses`` with its full history; ``template`` is a single one.

    Places within ``reach_m`` of the start are searched, as far as the region goes.
    """
    ground = (tile, height_reference_m, angular_frequency_rad_per_ns, min_overlap)
    hunt = _hunt(ground, (template, start, prior, half_width, numbers, start_seed), free, seed, config, reach_m)
    trail = watch_swarm(hunt.key, hunt.cloud, hunt.posterior, free[:5], config=config)
    rows = jnp.arange(len(trail.best_score))
    best = trail.best_position[rows, jnp.argmax(trail.best_score, axis=1)]
    side = jnp.linspace(-1.0, 1.0, _SEEN)
    along, cross = jnp.meshgrid(side, side, indexing="ij")
    seen = jnp.broadcast_to(best[-1][None], (_SEEN**2, 5))
    seen = seen.at[:, 0].set(along.reshape(-1)).at[:, 1].set(cross.reshape(-1))
    middle, reach = hunt.centre[:2], hunt.reach[:2]
    place = middle[None, None] + trail.position[..., :2] * reach[None, None]
    turned = hunt.centre[None, 2:] - prior[None, 2:5]
    return SwarmView(
        place_m=place,
        best_m=middle[None] + best[:, :2] * reach[None],
        attitude=turned[None] + trail.position[..., 2:] * hunt.reach[None, None, 2:],
        best_attitude=turned + best[:, 2:] * hunt.reach[None, 2:],
        best_score=trail.best_score,
        along_m=middle[0] + side * reach[0],
        cross_m=middle[1] + side * reach[1],
        score=hunt.posterior(seen).reshape(_SEEN, _SEEN),
    )


def held_score(
    score: Score,
    pose: Float[Array, "particle 5"],
    prior: Float[Array, "5"],
    half_width: Float[Array, "5"],
    numbers: Float[Array, ""],
) -> Float[Array, " particle"]:
    """Scores of poses minus the weight of the prior's attitude and height against them, as on a climb.

    Args:
        score: scores of the poses.
        pose: along_m, cross_m, height_m, yaw_rad, roll_rad in the tile's frame.
        prior: prior pose in the same order, with the search region of ``half_width`` about it.
        numbers: number of independent numbers in the template.
    """
    pull = jnp.asarray([0.0, 0.0, *PRIOR[2:5]], dtype=jnp.float32)
    r = jnp.clip(score.correlation, 0.05, 0.999)
    away = (pose - prior[None]) / half_width[None]
    return score.score - 0.5 * (1.0 - r**2) / (numbers * r) * jnp.sum(pull[None] * away**2, axis=-1)


class _Hunt(NamedTuple):
    """Inputs of a swarm around one start: its particles are in units of ``reach`` about ``centre``."""

    key: Key[Array, ""]
    cloud: Float[Array, "particle 5"]
    posterior: Objective
    centre: Float[Array, "5"]
    reach: Float[Array, "5"]


def _hunt(
    ground: tuple[Tile, Float[Array, ""], Float[Array, " half"], float | Float[Array, ""]],
    given: Start,
    free: Bool[Array, "6"],
    seed: UInt32[Array, ""],
    config: SwarmConfig,
    reach_m: float | Float[Array, ""] = _REACH_M,
) -> _Hunt:
    tile, height_reference_m, omega, min_overlap = ground
    template, start, prior, half_width, numbers, start_seed = given
    centre, width = start[:5], half_width[:5]
    reach = width.at[:2].set(jnp.minimum(width[:2], reach_m))
    first, second = jax.random.split(jax.random.fold_in(jax.random.key(seed), start_seed))
    cloud = jax.random.uniform(first, (config.particles, 5), minval=-1.0, maxval=1.0)
    cloud = jnp.where(free[None, :5], cloud, 0.0).at[0].set(0.0)

    def posterior(u: Float[Array, "particle 5"]) -> Float[Array, " particle"]:
        pose = centre[None] + u * reach[None]
        score = score_poses(tile, template, pose, height_reference_m, omega, min_overlap)
        return held_score(score, pose, prior[:5], width, numbers)

    return _Hunt(second, cloud, posterior, centre, reach)


FEW_CHANNELS = 3
"""An array with at most this many channels observes little to its sides."""

_UNFINISHED = (0.67, 0.99, 0.9, 0.9, 0.9)
"""Share of the largest step from which a climb counts as unfinished: at a peak the remaining step is much smaller."""
_MOVES = 0.5  # of a cell, which is a tenth of a wavelength


class Region(NamedTuple):
    """Search region of each template.

    Attributes:
        prior: along_m, cross_m, height_m above ground, yaw_rad, roll_rad, pitch_rad in the tile's frame.
        half_width: half widths of the search region about it, in the same order.
        number: number of the scan in its drive; it seeds the swarm, so that a fix does not depend on its batch.
    """

    prior: Float[Array, "end 6"]
    half_width: Float[Array, "end 6"]
    number: UInt32[Array, " end"]


class Finished(NamedTuple):
    """Results of a batch of climbs, in the tile's frame.

    Attributes:
        pose, covariance: pose and covariance; NaN if a template is off the map.
        correlation: correlation at the pose.
        overlap: share of the template's traces on the map.
        overlap_channels: number of channels of its last scan on the map.
        unfinished: whether the climb has not converged: its peak is elsewhere, or at the map's end.
    """

    pose: Float[Array, "end 5"]
    covariance: Float[Array, "end 5 5"]
    correlation: Float[Array, " end"]
    overlap: Float[Array, " end"]
    overlap_channels: Int[Array, " end"]
    unfinished: Bool[Array, " end"]


_TURNS_APART = 2.5
"""Cells, a quarter of a wavelength: how far the ends of a template move from one trial heading to the next."""


def trial_headings(swing_m: float, wavelength_m: float) -> int:
    """Headings at which a template is tried before the climb, by how far its region of headings moves its ends: one
    where the prior is sure enough for its length.
    """
    turns = swing_m / (0.25 * wavelength_m)
    return 1 if turns < 1.0 else 5 if turns <= 2.0 else 17


def _turned_best(
    ground: tuple[Tile, Float[Array, ""], Float[Array, " half"], float | Float[Array, ""]],
    template: Template,
    start: Float[Array, "end 6"],
    region: "Region",
    numbers: Float[Array, " end"],
    headings: Int[Array, ""] | int,
) -> Float[Array, "end 6"]:
    """Turn each template about its middle to the best of several headings within its region; of one, not at all."""
    tile, height_reference_m, rate, min_overlap = ground
    valid = template.valid.astype(jnp.float32)[..., None]
    middle_m = jnp.sum(template.offset_m * valid, axis=1) / jnp.maximum(jnp.sum(valid, axis=1), 1.0)
    reach_m = jnp.max(jnp.linalg.norm((template.offset_m - middle_m[:, None]) * valid, axis=-1), axis=1)
    step = _TURNS_APART * tile.cell_m[0] / jnp.maximum(reach_m, 0.1)
    low, high = (region.prior[:, 3] + side * region.half_width[:, 3] for side in (-1.0, 1.0))

    def middle(yaw: Float[Array, " end"]) -> Float[Array, "end 2"]:
        cos, sin = jnp.cos(yaw), jnp.sin(yaw)
        return jnp.stack(
            [cos * middle_m[:, 0] - sin * middle_m[:, 1], sin * middle_m[:, 0] + cos * middle_m[:, 1]], axis=-1
        )

    traces = jnp.maximum(jnp.sum(template.valid, axis=-1, dtype=jnp.float32), 1.0)
    live_power = jnp.sum(template.coefficients**2, axis=-1)

    def match(each: tuple[Template, Float[Array, "6"]]) -> Score:
        score = score_poses(tile, each[0], each[1][None, :5], height_reference_m, rate, min_overlap)
        found: Score = jax.tree.map(lambda field: field[0], score)
        return found

    def turn(number: Int[Array, ""], best: tuple[Array, Array]) -> tuple[Array, Array]:
        away = (number - headings // 2).astype(jnp.float32) * step
        yaw = jnp.clip(start[:, 3] + away, low, high)
        pose = start.at[:, :2].add(middle(start[:, 3]) - middle(yaw)).at[:, 3].set(yaw)
        score = jax.lax.map(match, (template, pose))
        power, on_map = jnp.where(score.covered, live_power, 0.0), jnp.sum(score.covered, axis=-1, dtype=jnp.float32)
        pieces = match_pieces(score.product, score.ground, power, template.scan, numbers * on_map / traces)
        evidence = _evidence(score.correlation, pieces)
        better = evidence > best[1]
        return jnp.where(better[:, None], pose, best[0]), jnp.where(better, evidence, best[1])

    none = jnp.full(len(start), -jnp.inf, jnp.float32)
    # The number of turns is no constant: a vehicle has one program, compiled before it drives.
    turned: Float[Array, "end 6"] = jax.lax.fori_loop(0, jnp.where(headings > 1, headings, 0), turn, (start, none))[0]
    return turned


@partial(jax.jit, static_argnames=("heading", "pitch", "swarm"))
def finish_best(
    tile: Tile,
    height_reference_m: Float[Array, ""],
    angular_frequency_rad_per_ns: Float[Array, " half"],
    template: Template,
    start: Float[Array, "end 6"],
    region: Region,
    floor: Float[Array, " end"],
    min_overlap: Float[Array, ""],
    *,
    heading: bool,
    pitch: bool,
    headings: Int[Array, ""] | int = 1,
    swarm: SwarmConfig | None = None,
    seed: UInt32[Array, ""] | None = None,
    steps: Int[Array, ""] | int = CLIMB_STEPS,
) -> Finished:
    """Climb from one candidate of each template to its peak.

    Args:
        tile, height_reference_m, angular_frequency_rad_per_ns, min_overlap: as for ``score_poses``.
        template: batch of templates.
        start: along_m, cross_m, height_m above ground, yaw_rad, roll_rad, pitch_rad in the tile's frame.
        region: region of the search.
        floor: noise floor of each template, which determines its number of independent samples.
        heading, pitch: whether heading and pitch are searched; one trace does not observe heading.
        swarm: swarm that refines each candidate before the last step of Gauss-Newton; ``None``: no swarm.
        seed: seed of the swarm.
        steps: number of poses evaluated on a climb.
    """
    wide = jnp.sum(template.scan == 0, axis=1)
    several = jnp.max(wide) > 1
    free = jnp.stack([*[jnp.asarray(True)] * 3, jnp.asarray(heading), several, jnp.asarray(pitch)])
    numbers = independent_numbers(floor)
    ground = (tile, height_reference_m, angular_frequency_rad_per_ns, min_overlap)
    start = _turned_best(ground, template, start, region, numbers, headings)
    if swarm is not None:
        assert seed is not None
        start = swarm_poses(
            *ground,
            template,
            start,
            region.prior,
            region.half_width,
            numbers,
            free,
            seed,
            region.number,
            config=swarm,
        )
        steps = 1
    top = climb(*ground, template, start, region.prior, region.half_width, numbers, free, steps=steps)
    found = top.correlation > OFF_MAP_SCORE
    covariance = covariance_of(top, region.half_width, free, tile.cell_m)
    largest = jnp.asarray(LARGEST_STEP[:5], dtype=jnp.float32).at[:2].multiply(tile.cell_m[0])
    asked = jnp.abs(top.asked[:, :5])
    unfinished = asked > (jnp.asarray(_UNFINISHED, dtype=jnp.float32) * largest)[None]
    # An attitude that moves no trace by a share of the wavelength leads to no other peak.
    reach_m = jnp.max(jnp.where(template.valid[..., None], jnp.abs(template.offset_m), 0.0), axis=1)
    moves_m = asked[:, 3:] * jnp.stack([jnp.hypot(reach_m[:, 0], reach_m[:, 1]), reach_m[:, 1]], axis=-1)
    unfinished = unfinished.at[:, 3:].min(moves_m > _MOVES * tile.cell_m[0])

    def known(field: Float[Array, "end ..."]) -> Float[Array, "end ..."]:
        return jnp.where(found.reshape(-1, *(1,) * (field.ndim - 1)), field, jnp.float32(jnp.nan))

    return Finished(
        known(top.pose[:, :5]),
        known(covariance),
        known(top.correlation),
        top.overlap,
        jnp.sum(top.covered & (template.scan == 0), axis=1, dtype=jnp.int32),
        unfinished[:, 0] | (jnp.any(unfinished[:, 1:], axis=1) & (wide > FEW_CHANNELS)),
    )
