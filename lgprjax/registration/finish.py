"""From a candidate to a pose: the climb to its peak, and what is known of the pose there."""

from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int, UInt32

from lgprjax.pso import SwarmConfig
from lgprjax.registration.correlation import OFF_MAP_SCORE, Template
from lgprjax.registration.integrity import independent_numbers
from lgprjax.registration.newton import CLIMB_STEPS, climb, covariance_of
from lgprjax.registration.swarm_finish import swarm_poses
from lgprjax.subsurface import Tile

FEW_CHANNELS = 3
"""An array of no more channels than this sees little to its sides."""

_UNFINISHED = 1.0
"""Cells: at a summit the step that is left is a small part of one."""


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


class Finished(NamedTuple):
    """Where the climbs of a batch ended, in the tile's frame.

    Attributes:
        pose, covariance: NaN where nothing of the map was left below a template.
        correlation: there.
        overlap: share of the template's traces on the map.
        overlap_channels: channels of its last scan on the map.
        unfinished: the climb would go on: its peak lies elsewhere, or where the map ends.
    """

    pose: Float[Array, "end 5"]
    covariance: Float[Array, "end 5 5"]
    correlation: Float[Array, " end"]
    overlap: Float[Array, " end"]
    overlap_channels: Int[Array, " end"]
    unfinished: Bool[Array, " end"]


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
    swarm: SwarmConfig | None = None,
    seed: UInt32[Array, ""] | None = None,
) -> Finished:
    """Climb from one candidate of each template to its peak.

    Args:
        tile, height_reference_m, angular_frequency_rad_per_ns, min_overlap: as for ``score_poses``.
        template: batched.
        start: along_m, cross_m, height_m above ground, yaw_rad, roll_rad, pitch_rad in the tile's frame.
        region: of the search.
        floor: noise floor of each template: says how many independent numbers it holds.
        heading, pitch: are searched: one trace sees no heading.
        swarm: finish by this swarm about each candidate before the last step of Gauss-Newton.
        seed: of the swarm.
    """
    wide = jnp.sum(template.last_scan, axis=1)
    several = jnp.max(wide) > 1
    free = jnp.stack([*[jnp.asarray(True)] * 3, jnp.asarray(heading), several, jnp.asarray(pitch)])
    numbers = independent_numbers(floor)
    ground = (tile, height_reference_m, angular_frequency_rad_per_ns, min_overlap)
    steps = CLIMB_STEPS
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
    found = top.strength > OFF_MAP_SCORE
    covariance = covariance_of(top, numbers, region.half_width, free, tile.cell_m)
    unfinished = jnp.abs(top.left_m) > _UNFINISHED * tile.cell_m[None]

    def known(field: Float[Array, "end ..."]) -> Float[Array, "end ..."]:
        return jnp.where(found.reshape(-1, *(1,) * (field.ndim - 1)), field, jnp.float32(jnp.nan))

    valid = jnp.maximum(jnp.sum(template.valid, axis=1, dtype=jnp.float32), 1.0)
    return Finished(
        known(top.pose[:, :5]),
        known(covariance),
        known(top.correlation),
        jnp.sum(top.covered, axis=1, dtype=jnp.float32) / valid,
        jnp.sum(top.covered & template.last_scan, axis=1, dtype=jnp.int32),
        unfinished[:, 0] | (unfinished[:, 1] & (wide > FEW_CHANNELS)),
    )
