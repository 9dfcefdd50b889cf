"""The score: normalised correlation of a template with the map where a pose puts its antennas.

    r = sum(S G) / sqrt(sum(S^2) sum(G^2))

over channels and depth (LL figure B; RA-L 2020 with its normaliser repaired, docs/conventions.md), S the live
traces, G the tile sampled under the antennas, both sums over the traces that lie on the map. A template is one
scan, or a window of scans joined by odometry: to the score both are a set of traces with offsets.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from lgprjax.radar import air_delay_ns, shift_travel_time
from lgprjax.subsurface import Tile, sample_tile

OFF_MAP_SCORE = -2.0
"""Score of a pose with too little overlap: below every correlation."""


class Template(NamedTuple):
    """Live traces and where they stand relative to the array's centre at the template's last scan.

    Attributes:
        coefficients: of each trace; zeros where invalid.
        offset_m: forward and left of the array's centre at the last scan, in its body frame.
        valid: traces to use.
        last_scan: traces of the last scan.
    """

    coefficients: Float[Array, "*batch trace coefficient"]
    offset_m: Float[Array, "*batch trace 2"]
    valid: Bool[Array, "*batch trace"]
    last_scan: Bool[Array, "*batch trace"]


class Score(NamedTuple):
    """How well a template matches at each pose.

    Attributes:
        correlation: r over the traces that lie on the map; ``OFF_MAP_SCORE`` with too little overlap.
        strength: r times the root of the overlap. By chance r scatters with one over the root of what it is
            made of, so that at the map's rim, where few channels overlap, the same r means less; ranked by r
            alone, false matches gather there.
        covered: traces on the map.
    """

    correlation: Float[Array, " particle"]
    strength: Float[Array, " particle"]
    covered: Bool[Array, "particle trace"]


def score_poses(
    tile: Tile,
    template: Template,
    pose: Float[Array, "particle 5"],
    height_reference_m: Float[Array, ""],
    angular_frequency_rad_per_ns: Float[Array, " half"],
    min_overlap: float | Float[Array, ""],
) -> Score:
    """Correlation of a template with the tile at each pose.

    An antenna at offset (x, y) stands at z = height + y sin(roll) above the ground, and its trace moves by
    2 (z - reference) / c in air (docs/conventions.md).

    Args:
        tile: the ground.
        template: one scan or a window.
        pose: along_m, cross_m, height_m above ground, yaw_rad from the tile's axis, roll_rad.
        height_reference_m: antenna height that the tile was brought to.
        angular_frequency_rad_per_ns: of the coefficients.
        min_overlap: share of the valid traces that must lie on the map; else ``OFF_MAP_SCORE``.
    """
    cos, sin = jnp.cos(pose[:, 3])[:, None], jnp.sin(pose[:, 3])[:, None]
    forward, left = template.offset_m[:, 0][None, :], template.offset_m[:, 1][None, :]
    position = jnp.stack(
        [
            pose[:, 0][:, None] + cos * forward - sin * left,
            pose[:, 1][:, None] + sin * forward + cos * left,
        ],
        axis=-1,
    )
    ground, on_map = sample_tile(tile, position)
    covered = on_map & template.valid[None, :]
    height_m = pose[:, 2][:, None] + left * jnp.sin(pose[:, 4])[:, None]
    live = shift_travel_time(
        jnp.broadcast_to(template.coefficients[None], ground.shape),
        -air_delay_ns(height_m - height_reference_m),
        angular_frequency_rad_per_ns,
    )
    product = jnp.sum(live * ground, axis=-1)
    live_power = jnp.broadcast_to(jnp.sum(template.coefficients**2, axis=-1)[None], product.shape)
    ground_power = jnp.sum(ground**2, axis=-1)
    traces = jnp.maximum(jnp.sum(template.valid, dtype=jnp.float32), 1.0)
    overlap = jnp.sum(covered, axis=-1, dtype=jnp.float32) / traces
    correlation = normalise(
        jnp.sum(jnp.where(covered, product, 0.0), axis=-1),
        jnp.sum(jnp.where(covered, live_power, 0.0), axis=-1),
        jnp.sum(jnp.where(covered, ground_power, 0.0), axis=-1),
        overlap,
        min_overlap,
    )
    return Score(correlation, strength_of(correlation, overlap), covered)


@jax.jit
def score_each(
    tile: Tile,
    template: Template,
    pose: Float[Array, "batch 5"],
    height_reference_m: Float[Array, ""],
    angular_frequency_rad_per_ns: Float[Array, " half"],
) -> Float[Array, " batch"]:
    """Correlation of each template at a pose of its own; NaN where less than half of it lies on the map."""

    def one(each: tuple[Template, Float[Array, "5"]]) -> Float[Array, ""]:
        score = score_poses(
            tile, each[0], each[1][None], height_reference_m, angular_frequency_rad_per_ns, jnp.float32(0.5)
        )
        r = score.correlation[0]
        return jnp.where(r > -1.5, r, jnp.nan)

    scores: Float[Array, " batch"] = jax.lax.map(one, (template, pose))
    return scores


def strength_of(correlation: Float[Array, "*batch"], overlap: Float[Array, "*batch"]) -> Float[Array, "*batch"]:
    """Correlation weighed by what it is made of (see ``Score``)."""
    return jnp.where(correlation > -1.5, correlation * jnp.sqrt(overlap), OFF_MAP_SCORE)


def normalise(
    product: Float[Array, "*batch"],
    live_power: Float[Array, "*batch"],
    ground_power: Float[Array, "*batch"],
    overlap: Float[Array, "*batch"],
    min_overlap: float | Float[Array, ""],
) -> Float[Array, "*batch"]:
    """Sums to a correlation; ``OFF_MAP_SCORE`` where overlap or power is missing."""
    usable = (overlap >= min_overlap) & (live_power > 0.0) & (ground_power > 0.0)
    # A root each: the product of the powers of a drive in small units would not be a number any more.
    level = jnp.sqrt(jnp.where(usable, live_power, 1.0)) * jnp.sqrt(jnp.where(usable, ground_power, 1.0))
    return jnp.where(usable, product / level, OFF_MAP_SCORE)
