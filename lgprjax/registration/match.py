"""Registration of scans and windows against the columns of one tile: places, summits, finish, judgement."""

from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int, UInt32

from lgprjax.pso import SwarmConfig
from lgprjax.registration.columns import ArrayColumns
from lgprjax.registration.correlation import Template, score_poses
from lgprjax.registration.finish import Region, Rules, finish
from lgprjax.registration.fix import Fix
from lgprjax.registration.places import (
    PlaceScores,
    find_summits,
    products_at_places,
    single_scores,
    window_scores,
)
from lgprjax.subsurface import Tile


@dataclass(frozen=True)
class MatchSpec:
    """Static shape of a search: one compile each.

    Attributes:
        heights: tried by the coarse stage over the region's height.
        summits: places that are finished; the best two make the margin.
        border: places that a window's scans may lie outside the tile.
        swarm: finish by this swarm about each summit instead of Gauss-Newton.
    """

    heights: int = 2
    summits: int = 2
    border: tuple[int, int] = (0, 0)
    swarm: SwarmConfig | None = None


class ScanSet(NamedTuple):
    """Scans of a stretch of a drive, on one tile.

    Attributes:
        coefficients: of each trace; zeros where invalid.
        valid: channels that hold data.
        above_m: height of each antenna above the tile's reference by the prior.
    """

    coefficients: Float[Array, "scan channel coefficient"]
    valid: Bool[Array, "scan channel"]
    above_m: Float[Array, "scan channel"]


class Ends(NamedTuple):
    """Templates to register, each a scan or the window that ends with it.

    Attributes:
        member: numbers in the set of the scans that the coarse stage takes, the last scan first.
        shift: columns' places from the last scan to each.
        fine: numbers of the scans that the finish takes, the last scan first.
        offset_m: of the finish's traces, see ``Template``.
        prior: along_m, cross_m, height_m above ground, yaw_rad, roll_rad, pitch_rad in the tile's frame.
        half_width: of the search region about it.
        number: of the scan in its drive; seeds the swarm, so that a fix depends on nothing around it.
    """

    member: Int[Array, "end member"]
    shift: Int[Array, "end member 2"]
    fine: Int[Array, "end fine"]
    offset_m: Float[Array, "end trace 2"]
    prior: Float[Array, "end 6"]
    half_width: Float[Array, "end 6"]
    number: UInt32[Array, " end"]


@partial(jax.jit, static_argnames="spec")
def match_scans(
    columns: ArrayColumns,
    components: Float[Array, "coefficient component"],
    tile: Tile,
    scans: ScanSet,
    ends: Ends,
    rules: Rules,
    height_reference_m: Float[Array, ""],
    angular_frequency_rad_per_ns: Float[Array, " half"],
    *,
    spec: MatchSpec,
) -> Fix:
    """Fixes of a batch of templates, poses in the tile's frame."""
    thresholds = rules.thresholds
    coefficients = jnp.where(scans.valid[..., None], scans.coefficients, 0.0)
    steps = jnp.arange(spec.heights, dtype=jnp.float32) * (2.0 / spec.heights) + (1.0 / spec.heights - 1.0)
    heights_m = ends.half_width[0, 2] * steps
    products = products_at_places(
        columns, components, coefficients, scans.above_m, heights_m, angular_frequency_rad_per_ns
    )
    live_power = jnp.sum(coefficients**2, axis=(1, 2))
    places: PlaceScores
    if ends.member.shape[1] == 1:
        first = ends.member[:, 0]
        places = single_scores(columns, products[first], live_power[first], thresholds.overlap)
    else:
        places = window_scores(
            columns, products, live_power, ends.member, ends.shift, thresholds.overlap, border=spec.border
        )
    found = find_summits(
        columns, places, ends.prior[:, :2], ends.half_width[:, :2], rules.apart_m, summits=spec.summits
    )
    template = _templates(coefficients, scans.valid, ends)
    evaluations = spec.heights * columns.power.size * ends.member.shape[1]
    return finish(
        tile,
        height_reference_m,
        angular_frequency_rad_per_ns,
        template,
        jnp.mean(template.valid, axis=-1, dtype=jnp.float32) >= thresholds.overlap,
        found,
        heights_m,
        Region(ends.prior, ends.half_width, ends.number),
        rules,
        evaluations,
        swarm=spec.swarm,
    )


@jax.jit
def score_truth(
    tile: Tile,
    scans: ScanSet,
    ends: Ends,
    pose: Float[Array, "end 5"],
    height_reference_m: Float[Array, ""],
    angular_frequency_rad_per_ns: Float[Array, " half"],
) -> Float[Array, " end"]:
    """Plain score of each template at one pose of its own, in the tile's frame; NaN where it is off the map."""
    coefficients = jnp.where(scans.valid[..., None], scans.coefficients, 0.0)
    template = _templates(coefficients, scans.valid, ends)

    def one(lane: tuple[Template, Float[Array, "5"]]) -> Float[Array, ""]:
        score = score_poses(
            tile, lane[0], lane[1][None], height_reference_m, angular_frequency_rad_per_ns, jnp.float32(0.5)
        )
        r = score.correlation[0]
        return jnp.where(r > -1.5, r, jnp.nan)

    scores: Float[Array, " end"] = jax.lax.map(one, (template, pose))
    return scores


def _templates(
    coefficients: Float[Array, "scan channel coefficient"], valid: Bool[Array, "scan channel"], ends: Ends
) -> Template:
    count, fine = ends.fine.shape
    channels = valid.shape[1]
    last = jnp.arange(fine * channels) < channels
    return Template(
        coefficients=coefficients[ends.fine].reshape(count, fine * channels, -1),
        offset_m=ends.offset_m,
        valid=valid[ends.fine].reshape(count, -1),
        last_scan=jnp.broadcast_to(last[None], (count, fine * channels)),
    )
