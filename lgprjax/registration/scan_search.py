"""Exhaustive search of one tile: every cell of the region scored, the best candidate refined.

This plain form of the search accepts any traces anywhere and needs no template bank. Drives are registered by
``Registration``, whose coarse stage computes the same product at a twentieth of the cost.
"""

from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from lgprjax.radar import ArrayGeometry, air_delay_ns, shift_travel_time
from lgprjax.registration.fix import Fix
from lgprjax.registration.judge import MIN_OVERLAP, POOLED, Chance, RegisterOptions, Thresholds, judge, thresholds_at
from lgprjax.registration.refine import Region, finish_best
from lgprjax.registration.score import OFF_MAP_SCORE, Template, normalise, score_of, score_poses
from lgprjax.subsurface import GroundMap, Tile, sample_tile

# The coarse stage: every place of the search region on the grid's own cells, at the prior's attitude.
#
# Correlation is linear in the map, so one matrix product of traces with cells holds every product needed at any place;
# with the antennas rounded to whole cells a place's score is a sum of slices, one per trace, and no gather. Being
# exhaustive, it cannot miss the best place or its rivals: the swarm refines them, and the difference of their scores is
# the margin that integrity relies on.


class CoarseSurface(NamedTuple):
    """Correlation over the region's lattice, whose points are cells of the tile.

    Attributes:
        score: score at each point, see ``Score``; ``OFF_MAP_SCORE`` without enough overlap.
        overlap: share of the template on the map.
        first_cell: tile's cell of lattice point (0, 0).
    """

    score: Float[Array, "along cross"]
    overlap: Float[Array, "along cross"]
    first_cell: Int[Array, "2"]


def trace_products(tile: Tile, templates: Template) -> Float[Array, "batch trace along cross"]:
    """Products of every trace of a batch of templates with every cell: one matrix product."""
    batch, traces, coefficients = templates.coefficients.shape
    product = templates.coefficients.reshape(-1, coefficients) @ tile.coefficients.reshape(-1, coefficients).T
    return product.reshape(batch, traces, *tile.valid.shape)


def coarse_surface(
    tile: Tile,
    template: Template,
    products: Float[Array, "trace along cross"],
    prior: Float[Array, "5"],
    half_width_m: Float[Array, "2"],
    min_overlap: float | Float[Array, ""],
    *,
    lattice: tuple[int, int],
    margin: tuple[int, int],
) -> CoarseSurface:
    """Correlation at every lattice point, with the prior's heading and height.

    Args:
        tile, template: as for ``score_poses``.
        products: products of this template, from ``trace_products``.
        prior: along_m, cross_m, height_m, yaw_rad, roll_rad; the lattice is centred there as far as the
            tile reaches.
        half_width_m: half width of the region along and cross; lattice points beyond it do not count.
        min_overlap: see ``score_poses``.
        lattice: number of points along and cross; at most the tile's cells.
        margin: number of cells that an antenna may be outside the tile; farther ones count as off the map.
    """
    cells = jnp.asarray(tile.valid.shape, dtype=jnp.int32)
    size = jnp.asarray(lattice, dtype=jnp.int32)
    reach = jnp.asarray(margin, dtype=jnp.int32)
    centre = jnp.round((prior[:2] - tile.origin_m) / tile.cell_m).astype(jnp.int32)
    first = jnp.clip(centre - size // 2, 0, cells - size)
    cos, sin = jnp.cos(prior[3]), jnp.sin(prior[3])
    forward, left = template.offset_m[:, 0], template.offset_m[:, 1]
    offset_m = jnp.stack([cos * forward - sin * left, sin * forward + cos * left], axis=-1)
    offset = jnp.round(offset_m / tile.cell_m[None]).astype(jnp.int32)
    reached = template.valid & jnp.all(jnp.abs(offset) <= reach[None], axis=-1)
    start = (first + reach)[None] + jnp.clip(offset, -reach[None], reach[None])
    live_power = jnp.sum(template.coefficients**2, axis=-1)
    border = [(m, m) for m in margin]
    power = jnp.pad(tile.power, border)
    mask = jnp.pad(tile.valid.astype(jnp.float32), border)
    padded = jnp.pad(products, [(0, 0), *border])

    def add(trace: Int[Array, ""], total: Float[Array, "sum along cross"]) -> Float[Array, "sum along cross"]:
        use = reached[trace].astype(jnp.float32)

        def cut(plane: Array) -> Array:
            return jax.lax.dynamic_slice(plane, (start[trace, 0], start[trace, 1]), lattice)

        there = cut(mask)
        return total + use * jnp.stack(
            [
                jax.lax.dynamic_slice(padded, (trace, start[trace, 0], start[trace, 1]), (1, *lattice))[0],
                live_power[trace] * there,
                cut(power),
                there,
            ]
        )

    traces = template.valid.shape[0]
    total = jax.lax.fori_loop(0, traces, add, jnp.zeros((4, *lattice), jnp.float32))
    at_m = [
        (first[axis] + jnp.arange(lattice[axis])).astype(jnp.float32) * tile.cell_m[axis]
        + tile.origin_m[axis]
        - prior[axis]
        for axis in range(2)
    ]
    inside = (jnp.abs(at_m[0]) <= half_width_m[0])[:, None] & (jnp.abs(at_m[1]) <= half_width_m[1])[None, :]
    overlap = jnp.where(inside, total[3] / jnp.maximum(jnp.sum(template.valid, dtype=jnp.float32), 1.0), 0.0)
    correlation = normalise(total[0], total[1], total[2], overlap, min_overlap)
    return CoarseSurface(score_of(correlation, overlap), overlap, first)


class Modes(NamedTuple):
    """The best lattice points that are apart from each other.

    Attributes:
        place_m: along and cross of each point.
        score: score of each point; ``OFF_MAP_SCORE`` if none was left.
        floor: noise floor: standard deviation of the score away from the best.
    """

    place_m: Float[Array, "mode 2"]
    score: Float[Array, " mode"]
    floor: Float[Array, ""]


def find_modes(tile: Tile, surface: CoarseSurface, apart_m: Float[Array, ""], *, modes: int) -> Modes:
    """Best peaks by repeated maximum, each at least ``apart_m`` from those before it.

    Peaks only: the flank of the best one, just beyond ``apart_m``, is no rival.
    """
    shape = surface.score.shape
    along = (surface.first_cell[0] + jnp.arange(shape[0])).astype(jnp.float32) * tile.cell_m[0] + tile.origin_m[0]
    cross = (surface.first_cell[1] + jnp.arange(shape[1])).astype(jnp.float32) * tile.cell_m[1] + tile.origin_m[1]
    around = jax.lax.reduce_window(surface.score, -jnp.inf, jax.lax.max, (3, 3), (1, 1), "SAME")
    left = jnp.where(surface.score >= around, surface.score, OFF_MAP_SCORE)
    places, scores = [], []
    away = jnp.ones(shape, bool)
    for mode in range(modes):
        best = jnp.argmax(left)
        i, j = best // shape[1], best % shape[1]
        places.append(jnp.stack([along[i], cross[j]]))
        scores.append(left[i, j])
        near = ((along - along[i]) ** 2)[:, None] + ((cross - cross[j]) ** 2)[None, :] < apart_m**2
        left = jnp.where(near, OFF_MAP_SCORE, left)
        if mode == 0:
            away = ~near & (surface.score > OFF_MAP_SCORE)
    count = jnp.maximum(jnp.sum(away, dtype=jnp.float32), 1.0)
    mean = jnp.sum(jnp.where(away, surface.score, 0.0)) / count
    spread = jnp.sum(jnp.where(away, (surface.score - mean) ** 2, 0.0)) / count
    # A handful of places away from the best does not measure chance: the most cautious value is used.
    enough = jnp.sum(away) >= 16
    return Modes(jnp.stack(places), jnp.stack(scores), jnp.where(enough, jnp.sqrt(spread), 0.5))


@dataclass(frozen=True)
class SearchSpec:
    """Static shape of a search; each is compiled once.

    Attributes:
        lattice: number of points of the coarse stage along and cross.
        margin: number of cells that an antenna may be outside the tile.
    """

    lattice: tuple[int, int]
    margin: tuple[int, int]


def search_spec_for(
    ground: GroundMap, tile: int, array: ArrayGeometry, *, search_m: float, window_m: float
) -> SearchSpec:
    """Shape of the search on a tile: the whole region as far as the grid goes."""
    spec, _ = ground.grid_of(tile)
    array_reach_m = float(np.hypot(np.ptp(array.x_m), np.ptp(array.y_m))) + 0.5
    cells_m = (spec.along_cell_m, spec.cross_cell_m)
    sizes = (spec.along_cells, spec.cross_cells)
    lattice = [min(2 * int(search_m / c) + 3, n) for c, n in zip(cells_m, sizes, strict=True)]
    margin = [int(np.ceil((window_m + array_reach_m) / c)) + 1 for c in cells_m]
    return SearchSpec(lattice=(lattice[0], lattice[1]), margin=(margin[0], margin[1]))


class SearchProblem(NamedTuple):
    """A batch of templates with their priors.

    Attributes:
        template: batch of templates.
        prior: along_m, cross_m, height_m above ground, yaw_rad, roll_rad in the tile's frame.
        half_width: half widths of the search region about the prior, in the same order.
        finite: whether there are enough finite traces.
    """

    template: Template
    prior: Float[Array, "batch 5"]
    half_width: Float[Array, "batch 5"]
    finite: Bool[Array, " batch"]


class Rules(NamedTuple):
    """Rules for a whole batch.

    Attributes:
        apart_m: distance below which two places are the same.
        thresholds: acceptance thresholds.
    """

    apart_m: Float[Array, ""]
    thresholds: Thresholds


def rules_of(wavelength_m: float, options: RegisterOptions, window_m: float, chance: Chance = POOLED) -> Rules:
    """Rules for templates of a length, each matched once in a region as large as the options have it."""
    own = options.own_thresholds
    if own is None:
        own = thresholds_at(options.risk, window_m, (2.0 * options.search_half_m()) ** 2, wavelength_m, chance)
    return Rules(jnp.float32(0.6 * wavelength_m), Thresholds(*(jnp.float32(value) for value in own)))


@partial(jax.jit, static_argnames="spec")
def register_batch(
    tile: Tile,
    problem: SearchProblem,
    rules: Rules,
    height_reference_m: Float[Array, ""],
    angular_frequency_rad_per_ns: Float[Array, " half"],
    *,
    spec: SearchSpec,
) -> Fix:
    """Fixes of a batch, poses in the tile's frame.

    The templates share one matrix product; their surfaces are then computed one by one: a vmap over them would turn
    every slice into a gather (measured twenty times slower than this loop). They are independent.
    """
    sane = problem.finite[:, None] & problem.template.valid
    template = problem.template._replace(
        coefficients=jnp.where(sane[..., None], problem.template.coefficients, 0.0), valid=sane
    )
    # The coarse stage uses the prior's height and roll: antennas to the tile's reference, as in score_poses.
    height_m = problem.prior[:, 2, None] + template.offset_m[..., 1] * jnp.sin(problem.prior[:, 4, None])
    levelled = shift_travel_time(
        template.coefficients, -air_delay_ns(height_m - height_reference_m), angular_frequency_rad_per_ns
    )
    products = trace_products(tile, template._replace(coefficients=levelled))

    def one(each: tuple[Template, Array, Array, Array]) -> tuple[Modes, Array]:
        single, own, prior, half_width = each
        surface = coarse_surface(
            tile,
            single,
            own,
            prior,
            half_width[:2],
            jnp.float32(MIN_OVERLAP),
            lattice=spec.lattice,
            margin=spec.margin,
        )
        return find_modes(tile, surface, rules.apart_m, modes=2), jnp.max(surface.overlap)

    modes, overlap = jax.lax.map(one, (template, products, problem.prior, problem.half_width))
    # Pitch is not searched; its width divides.
    level = [(0, 0), (0, 1)]
    start = jnp.concatenate([modes.place_m[:, 0], problem.prior[:, 2:], jnp.zeros_like(problem.prior[:, :1])], axis=1)
    region = Region(
        jnp.pad(problem.prior, level),
        jnp.pad(problem.half_width, level, constant_values=1.0),
        jnp.zeros(len(start), jnp.uint32),
    )
    found = finish_best(
        tile,
        height_reference_m,
        angular_frequency_rad_per_ns,
        template,
        start,
        region,
        modes.floor,
        jnp.float32(MIN_OVERLAP),
        heading=template.valid.shape[1] > 1,
        pitch=False,
    )
    any_found = problem.finite & (modes.score[:, 0] > OFF_MAP_SCORE) & jnp.isfinite(found.correlation)
    away = jnp.abs(found.pose[:, :2] - problem.prior[:, :2])
    on_edge = jnp.any(away > problem.half_width[:, :2] - tile.cell_m[None], axis=1) | found.unfinished
    # Both at lattice points: a refined best place and an unrefined rival cannot be compared.
    score = jnp.where(any_found, modes.score[:, 0], -1.0)
    rival = jnp.maximum(modes.score[:, 1], -1.0)
    code = judge(score, rival, modes.floor, overlap, on_edge, problem.finite, rules.thresholds)
    nothing = jnp.where(any_found, 0.0, jnp.nan)
    return Fix(
        pose=found.pose + nothing[:, None],
        covariance=found.covariance * rules.thresholds.sigma_scale**2 + nothing[:, None, None],
        correlation=found.correlation + nothing,
        runner_up=rival + nothing,
        margin=score - rival + nothing,
        noise_floor=modes.floor + nothing,
        overlap_channels=found.overlap_channels,
        overlap=found.overlap,
        code=code,
        p_false=jnp.where(code == 0, jnp.nan, 1.0),
        window_m=nothing,
    )


# For inspection of one match: the correlation surface around a prior, and the ground under a path.


class SurfacePicture(NamedTuple):
    """Score over the search lattice, in the tile's frame; NaN off the map or the region."""

    along_m: Float[np.ndarray, " along"]
    cross_m: Float[np.ndarray, " cross"]
    score: Float[np.ndarray, "along cross"]


_SEEN_POINTS = 40
"""Points of a picture of the correlation, to each side of the fix."""


def survey_surface(
    tile: Tile,
    template: Template,
    pose: Float[np.ndarray, "5"],
    prior: Float[np.ndarray, "5"],
    half_width_m: float,
    height_reference_m: float | Float[Array, ""],
    angular_frequency_rad_per_ns: Float[Array, " half"],
    min_overlap: float,
) -> SurfacePicture:
    """Correlation of one template (batch of one) over places, with the rest of the pose from its fix.

    The fix is a point of the lattice, so that the picture shows its correlation.

    Args:
        tile, template: see ``score_poses``.
        pose: pose of the fix in the tile's frame.
        prior: middle of the search region.
        half_width_m: half width of the region.
        height_reference_m, angular_frequency_rad_per_ns, min_overlap: see ``score_poses``.
    """
    reach_m = float(np.max(np.abs(prior[:2] - pose[:2]))) + half_width_m
    side_m = reach_m / _SEEN_POINTS * np.arange(-_SEEN_POINTS, _SEEN_POINTS + 1)
    along, cross = pose[0] + side_m, pose[1] + side_m
    score = _surface(
        tile,
        Template(*(field[0] for field in template)),
        jnp.asarray(pose, dtype=jnp.float32),
        jnp.asarray(side_m, dtype=jnp.float32),
        jnp.float32(height_reference_m),
        angular_frequency_rad_per_ns,
        jnp.float32(min_overlap),
    )
    values = np.asarray(score, dtype=np.float64)
    inside = [np.abs(place - prior[axis]) <= half_width_m for axis, place in enumerate((along, cross))]
    # At least two places a side: a picture has an area.
    rows, columns = (part if part.sum() > 1 else np.abs(side_m) <= 1.5 * side_m[-1] / _SEEN_POINTS for part in inside)
    scored = np.where(values > 0.75 * OFF_MAP_SCORE, values, np.nan)
    return SurfacePicture(along[rows], cross[columns], scored[np.ix_(rows, columns)])


@jax.jit
def _surface(
    tile: Tile,
    template: Template,
    pose: Float[Array, "5"],
    side_m: Float[Array, " side"],
    height_reference_m: Float[Array, ""],
    angular_frequency_rad_per_ns: Float[Array, " half"],
    min_overlap: Float[Array, ""],
) -> Float[Array, "side side"]:
    def row(along_m: Float[Array, ""]) -> Float[Array, " side"]:
        places = jnp.broadcast_to(pose[None], (len(side_m), 5))
        places = places.at[:, 0].add(along_m).at[:, 1].add(side_m)
        return score_poses(
            tile, template, places, height_reference_m, angular_frequency_rad_per_ns, min_overlap
        ).correlation

    scores: Float[Array, "side side"] = jax.lax.map(row, side_m)
    return scores


def ground_under(
    tile: Tile, position_m: Float[np.ndarray, "trace 2"]
) -> tuple[Float[np.ndarray, "trace coefficient"], Bool[np.ndarray, " trace"]]:
    """Map coefficients under places (along, cross in the tile's frame), and which of them are on the map."""
    value, covered = sample_tile(tile, jnp.asarray(position_m, dtype=jnp.float32))
    return np.asarray(value), np.asarray(covered)


def rival_of(surface: SurfacePicture, best_m: Float[np.ndarray, "2"], apart_m: float) -> Float[np.ndarray, "2"] | None:
    """Highest peak of a surface at least ``apart_m`` from a place (along, cross); ``None`` without one."""
    score = np.where(np.isfinite(surface.score), surface.score, -np.inf)
    rows, columns = score.shape
    framed = np.pad(score, 1, constant_values=-np.inf)
    around = np.max([framed[i : i + rows, j : j + columns] for i in range(3) for j in range(3)], axis=0)
    away = np.hypot(surface.along_m[:, None] - best_m[0], surface.cross_m[None, :] - best_m[1]) >= apart_m
    left = np.where(away & (score >= around), score, -np.inf)
    i, j = np.unravel_index(int(np.argmax(left)), left.shape)
    return np.array([surface.along_m[i], surface.cross_m[j]]) if np.isfinite(left[i, j]) else None
