"""From the coarse stage's summits to a fix: every summit climbed, the best one judged against the others."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, UInt32

from lgprjax.pso import SwarmConfig
from lgprjax.registration.correlation import OFF_MAP_SCORE, Template
from lgprjax.registration.fix import Fix
from lgprjax.registration.integrity import Thresholds, independent_numbers, judge
from lgprjax.registration.newton import CLIMB_STEPS, Summit, climb, covariance_of
from lgprjax.registration.options import RegisterOptions
from lgprjax.registration.places import Summits
from lgprjax.registration.swarm_finish import swarm_poses
from lgprjax.subsurface import Tile

FEW_CHANNELS = 3
"""An array of no more channels than this sees little to its sides."""

_UNFINISHED = 1.0
"""Cells: at a summit the step that is left is a small part of one."""

_TRACES_AT_ONCE = 4096
"""Traces that the finish holds at a time: a few megabytes of work."""


class Region(NamedTuple):
    """Where each template is searched for.

    Attributes:
        prior: along_m, cross_m, height_m above ground, yaw_rad, roll_rad, pitch_rad in the tile's frame.
        half_width: of the search region about it, in the same order.
        number: of the scan in its drive; seeds the swarm, so that a fix depends on nothing around it.
    """

    prior: Float[Array, "end 6"]
    half_width: Float[Array, "end 6"]
    number: UInt32[Array, " end"]


class Rules(NamedTuple):
    """What holds for a whole drive.

    Attributes:
        apart_m: two places nearer than this are one.
        free: degrees of freedom that are searched.
        thresholds: to reach.
        seed: of the swarm.
    """

    apart_m: Float[Array, ""]
    free: Bool[Array, "6"]
    thresholds: Thresholds
    seed: UInt32[Array, ""]


def rules_of(wavelength_m: float, channels: int, traces: int, options: RegisterOptions) -> Rules:
    """Rules for templates of so many traces of an array: one channel sees no roll, and one trace no heading."""
    return Rules(
        apart_m=jnp.float32(0.6 * wavelength_m),
        free=jnp.asarray([True, True, True, traces > 1, channels > 1, options.pitch_deg > 0.0]),
        thresholds=Thresholds(*(jnp.float32(value) for value in options.thresholds)),
        seed=jnp.uint32(options.seed),
    )


def finish(
    tile: Tile,
    height_reference_m: Float[Array, ""],
    angular_frequency_rad_per_ns: Float[Array, " half"],
    template: Template,
    finite: Bool[Array, " end"],
    found: Summits,
    heights_m: Float[Array, " height"],
    region: Region,
    rules: Rules,
    evaluations: int,
    *,
    swarm: SwarmConfig | None = None,
) -> Fix:
    """Fixes of a batch of templates from the summits that the coarse stage found.

    Args:
        tile, height_reference_m, angular_frequency_rad_per_ns: as for ``score_poses``.
        template: batched.
        finite: enough finite traces to try.
        found: summits of each template, the best two of which make the margin.
        heights_m: above the prior, that ``found.height`` numbers.
        region: of each template.
        rules: of the drive.
        evaluations: of the score that the coarse stage spent on each.
        swarm: finish by this swarm about each summit instead of Gauss-Newton.
    """
    numbers = independent_numbers(found.floor)
    summits = found.strength.shape[1]
    ground = (tile, height_reference_m, angular_frequency_rad_per_ns, rules.thresholds.overlap)

    def some(lane: tuple[Template, Array, Array, Array, Array, Array]) -> Summit:
        start = lane[1].reshape(-1, 6)
        single, prior, half_width, known, number = jax.tree.map(
            lambda field: jnp.repeat(field, summits, axis=0), (lane[0], *lane[2:])
        )
        if swarm is not None:
            seeds = number * jnp.uint32(summits) + jnp.arange(len(start), dtype=jnp.uint32) % summits
            start = swarm_poses(
                *ground, single, start, prior, half_width, known, rules.free, rules.seed, seeds, config=swarm
            )
        steps = 1 if swarm is not None else CLIMB_STEPS
        top = climb(*ground, single, start, prior, half_width, known, rules.free, steps=steps)
        apart: Summit = jax.tree.map(lambda field: field.reshape(-1, summits, *field.shape[1:]), top)
        return apart

    count, traces = template.valid.shape
    work = (template, _starts(found, heights_m, region), region.prior, region.half_width, numbers, region.number)
    group = max(1, _TRACES_AT_ONCE // (traces * summits))
    if count <= group:
        tops = some(work)
    else:
        groups = -(-count // group)
        # Groups of one size, the last one filled with the first templates again.
        order = (jnp.arange(groups * group) % count).reshape(groups, group)
        tops = jax.lax.map(lambda index: some(jax.tree.map(lambda field: field[index], work)), order)
        tops = jax.tree.map(lambda field: field.reshape(groups * group, *field.shape[2:])[:count], tops)
    each = CLIMB_STEPS if swarm is None else swarm.particles * (swarm.iterations + 1)
    return _judged(tops, found, template, finite, region, numbers, rules, tile.cell_m, evaluations + summits * each)


def _starts(found: Summits, heights_m: Float[Array, " height"], region: Region) -> Float[Array, "end summit 6"]:
    height = region.prior[:, None, 2] + heights_m[found.height]
    rest = jnp.broadcast_to(region.prior[:, None, 3:], (*height.shape, 3))
    return jnp.concatenate([found.place_m, height[..., None], rest], axis=-1)


def _judged(
    tops: Summit,
    found: Summits,
    template: Template,
    finite: Bool[Array, " end"],
    region: Region,
    numbers: Float[Array, " end"],
    rules: Rules,
    cell_m: Float[Array, "2"],
    evaluations: int,
) -> Fix:
    """The best summit of each template as a fix, the others as its rivals."""
    lane = jnp.arange(len(numbers))
    strength = jnp.where(found.strength > OFF_MAP_SCORE, tops.strength, OFF_MAP_SCORE)
    best = jnp.argmax(strength, axis=1)
    top: Summit = jax.tree.map(lambda field: field[lane, best], tops)
    reached = strength[lane, best]
    # A rival that climbed to the best place is still one where it started from; one that fell off the map's rim too.
    apart = jnp.linalg.norm(tops.pose[:, :, :2] - top.pose[:, None, :2], axis=-1)
    merged = (apart < 0.75 * rules.apart_m) | (strength <= -1.0)
    rival = jnp.maximum(jnp.where(merged, found.strength, strength), -1.0)
    others = jnp.arange(strength.shape[1])[None] != best[:, None]
    runner_up = jnp.max(jnp.where(others, rival, -1.0), axis=1)
    traces = jnp.sum(template.valid, axis=1, dtype=jnp.float32)
    away = jnp.abs(top.pose[:, :2] - region.prior[:, :2])
    on_edge = jnp.any(away > region.half_width[:, :2] - cell_m[None], axis=1)
    # Where the map ends a climb leans against the least overlap and would go on: the summit lies beyond. Across, an
    # array of few channels has but the rim of its lane; its covariance says so.
    wide = jnp.sum(template.last_scan, axis=1) > FEW_CHANNELS
    unfinished = jnp.abs(top.left_m) > _UNFINISHED * cell_m[None]
    on_edge = on_edge | unfinished[:, 0] | (unfinished[:, 1] & wide)
    code = judge(reached, reached - runner_up, found.floor, found.overlap, on_edge, finite, rules.thresholds)
    held = numbers / rules.thresholds.sigma_scale**2
    covariance = covariance_of(top, held, region.half_width, rules.free, cell_m)
    any_found = finite & (reached > -1.0)

    def known(field: Float[Array, "end ..."]) -> Float[Array, "end ..."]:
        return jnp.where(any_found.reshape(-1, *(1,) * (field.ndim - 1)), field, jnp.float32(jnp.nan))

    return Fix(
        pose=known(top.pose[:, :5]),
        covariance=known(covariance),
        correlation=known(top.correlation),
        runner_up=known(runner_up),
        margin=known(reached - runner_up),
        scatter=known(found.floor),
        overlap_channels=jnp.sum(top.covered & template.last_scan, axis=1, dtype=jnp.int32),
        overlap=jnp.sum(top.covered, axis=1, dtype=jnp.float32) / jnp.maximum(traces, 1.0),
        evaluations=jnp.full(len(numbers), evaluations, jnp.int32),
        code=code,
    )
