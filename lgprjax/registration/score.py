"""The score: normalised correlation of a template with the map where a pose puts its antennas.

    r = sum(S G) / sqrt(sum(S^2) sum(G^2))

over channels and depth (LL figure B; RA-L 2020 with its normaliser repaired, docs/conventions.md), S the live
traces, G the tile sampled under the antennas, both sums over the traces on the map. A template is one scan, or a
window of scans joined by odometry: for the score both are a set of traces with offsets.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from lgprjax.radar import air_delay_ns, cos_sin, shift_travel_time
from lgprjax.subsurface import Tile, sample_tile

OFF_MAP_SCORE = -2.0
"""Score of a pose with too little overlap: below every correlation."""


class Template(NamedTuple):
    """Live traces and their offsets from the array's centre at the template's last scan.

    Attributes:
        coefficients: coefficients of each trace; zeros where invalid.
        offset_m: forward and left of the array's centre at the last scan, in its body frame.
        valid: mask of traces to use.
        scan: scan of each trace, counted backwards from the last one, 0.
    """

    coefficients: Float[Array, "*batch trace coefficient"]
    offset_m: Float[Array, "*batch trace 2"]
    valid: Bool[Array, "*batch trace"]
    scan: Int[Array, "*batch trace"]


class Score(NamedTuple):
    """Match of a template at each pose.

    Attributes:
        correlation: r over the traces on the map; ``OFF_MAP_SCORE`` with too little overlap.
        score: r times the root of the overlap. The standard deviation of r by chance is one over the root of the
            number of traces, so that at the map's edge, where few channels overlap, the same r means less; ranked by r
            alone, false matches accumulate there.
        covered: mask of traces on the map.
        product, ground: product of each trace with the ground below it, and power of that ground; 0 if not covered.
    """

    correlation: Float[Array, " particle"]
    score: Float[Array, " particle"]
    covered: Bool[Array, "particle trace"]
    product: Float[Array, "particle trace"]
    ground: Float[Array, "particle trace"]


def score_poses(
    tile: Tile,
    template: Template,
    pose: Float[Array, "particle 5"],
    height_reference_m: Float[Array, ""],
    angular_frequency_rad_per_ns: Float[Array, " half"],
    min_overlap: float | Float[Array, ""],
) -> Score:
    """Correlation of a template with the tile at each pose.

    An antenna at offset (x, y) is at z = height + y sin(roll) above the ground, and its trace moves by
    2 (z - reference) / c in air (docs/conventions.md).

    Args:
        tile: ground of the map.
        template: one scan or a window.
        pose: along_m, cross_m, height_m above ground, yaw_rad from the tile's axis, roll_rad.
        height_reference_m: antenna height to which the tile was reduced.
        angular_frequency_rad_per_ns: angular frequencies of the coefficients.
        min_overlap: least share of the valid traces on the map; below it the result is ``OFF_MAP_SCORE``.
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
    product = jnp.where(covered, jnp.sum(live * ground, axis=-1), 0.0)
    live_power = jnp.where(covered, jnp.sum(template.coefficients**2, axis=-1)[None], 0.0)
    ground_power = jnp.where(covered, jnp.sum(ground**2, axis=-1), 0.0)
    traces = jnp.maximum(jnp.sum(template.valid, dtype=jnp.float32), 1.0)
    overlap = jnp.sum(covered, axis=-1, dtype=jnp.float32) / traces
    correlation = normalise(
        jnp.sum(product, axis=-1),
        jnp.sum(live_power, axis=-1),
        jnp.sum(ground_power, axis=-1),
        overlap,
        min_overlap,
    )
    return Score(correlation, score_of(correlation, overlap), covered, product, ground_power)


@jax.jit
def score_each(
    tile: Tile,
    template: Template,
    pose: Float[Array, "batch 5"],
    height_reference_m: Float[Array, ""],
    angular_frequency_rad_per_ns: Float[Array, " half"],
) -> Float[Array, " batch"]:
    """Correlation of each template at its own pose; NaN if less than half of it is on the map."""

    def one(each: tuple[Template, Float[Array, "5"]]) -> Float[Array, ""]:
        score = score_poses(
            tile, each[0], each[1][None], height_reference_m, angular_frequency_rad_per_ns, jnp.float32(0.5)
        )
        r = score.correlation[0]
        return jnp.where(r > -1.5, r, jnp.nan)

    scores: Float[Array, " batch"] = jax.lax.map(one, (template, pose))
    return scores


def score_of(correlation: Float[Array, "*batch"], overlap: Float[Array, "*batch"]) -> Float[Array, "*batch"]:
    """Correlation weighted by overlap (see ``Score``)."""
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
    # One root each: the product of the powers would underflow for a drive in small units.
    level = jnp.sqrt(jnp.where(usable, live_power, 1.0)) * jnp.sqrt(jnp.where(usable, ground_power, 1.0))
    return jnp.where(usable, product / level, OFF_MAP_SCORE)


# What refinement needs of every trace: the live trace, the ground below it, and their products over depth.


class SampledGround(NamedTuple):
    """The live traces of each pose, and the cells of ground below them.

    Attributes:
        real, imaginary: real and imaginary parts of the live traces, at the tile's height reference.
        corners: ground at the cell, one cell across, one along, and both.
        part: fractional position between the corners, along and across.
        turned_m: offset of each trace, along and across.
        covered: mask of valid traces on the map.
    """

    real: Float[Array, "batch trace half"]
    imaginary: Float[Array, "batch trace half"]
    corners: Float[Array, "batch trace 4 coefficient"]
    part: Float[Array, "batch trace 2"]
    turned_m: Float[Array, "batch trace 2"]
    covered: Bool[Array, "batch trace"]


class Sums(NamedTuple):
    """Products over depth of every trace; 0 where it does not count. ``delayed`` is the ground's change with height."""

    ground_ground: Float[Array, "batch trace"]
    ground_along: Float[Array, "batch trace"]
    ground_cross: Float[Array, "batch trace"]
    along_along: Float[Array, "batch trace"]
    along_cross: Float[Array, "batch trace"]
    cross_cross: Float[Array, "batch trace"]
    along_delayed: Float[Array, "batch trace"]
    cross_delayed: Float[Array, "batch trace"]
    delayed_delayed: Float[Array, "batch trace"]
    live_ground: Float[Array, "batch trace"]
    live_along: Float[Array, "batch trace"]
    live_cross: Float[Array, "batch trace"]
    live_delayed: Float[Array, "batch trace"]


def sample_ground_under(
    tile: Tile,
    template: Template,
    pose: Float[Array, "batch 6"],
    height_reference_m: Float[Array, ""],
    rate_rad_per_m: Float[Array, " half"],
) -> SampledGround:
    """Sample the ground under the traces of each pose; ``rate_rad_per_m`` is the phase per metre of height."""
    forward, left = template.offset_m[..., 0], template.offset_m[..., 1]
    turned = _turned(template, pose)
    corners, part, on_map = _cell_of(tile, pose[:, None, :2] + turned)
    height_m = pose[:, 2, None] + left * jnp.sin(pose[:, 4, None]) + forward * jnp.sin(pose[:, 5, None])
    c, s = cos_sin((height_reference_m - height_m)[..., None] * rate_rad_per_m[None, None])
    real, imaginary = jnp.split(template.coefficients, 2, axis=-1)
    return SampledGround(
        real * c + imaginary * s,
        imaginary * c - real * s,
        tile.coefficients.reshape(-1, tile.coefficients.shape[-1])[corners],
        part,
        turned,
        on_map & template.valid,
    )


def _turned(template: Template, pose: Float[Array, "batch 6"]) -> Float[Array, "batch trace 2"]:
    """Offsets of the traces in the tile's frame."""
    forward, left = template.offset_m[..., 0], template.offset_m[..., 1]
    cos, sin = jnp.cos(pose[:, 3, None]), jnp.sin(pose[:, 3, None])
    return jnp.stack([cos * forward - sin * left, sin * forward + cos * left], axis=-1)


def trace_sums(sampled: SampledGround, rate_rad_per_m: Float[Array, " half"], cell_m: Float[Array, "2"]) -> Sums:
    """All products in one pass over depth.

    Height moves the live trace in delay. Turned back, it moves the ground the other way, so that the curvature is that
    of the ground, not of anything else in the live trace.
    """
    half = rate_rad_per_m.shape[0]
    lead = sampled.covered.shape
    near, nearer, far, farther = (sampled.corners[:, :, k].reshape(*lead, 2, half) for k in range(4))
    u, v = sampled.part[..., 0][..., None, None], sampled.part[..., 1][..., None, None]
    low = near + v * (nearer - near)
    along = far + v * (farther - far) - low
    ground = low + u * along
    cross = (1.0 - u) * (nearer - near) + u * (farther - far)
    rate = rate_rad_per_m[None, None]
    g, a, c = ((wave[:, :, 0], wave[:, :, 1]) for wave in (ground, along, cross))
    d = (rate * g[1], -rate * g[0])
    live = (sampled.real, sampled.imaginary)
    ground_alone = [(g, g), (g, a), (g, c), (a, a), (a, c), (c, c), (a, d), (c, d), (d, d)]
    pairs = [*ground_alone, (live, g), (live, a), (live, c), (live, d)]
    terms = [one[0] * other[0] + one[1] * other[1] for one, other in pairs]
    p, q, one = 1.0 / cell_m[0], 1.0 / cell_m[1], jnp.float32(1.0)
    per_m = (one, p, q, p * p, p * q, q * q, p, q, one, one, p, q, one)
    return Sums(
        *(jnp.where(sampled.covered, total * unit, 0.0) for total, unit in zip(_totals(terms, 2), per_m, strict=True))
    )


_PIECES = 8
"""Pieces of a template, one after the other along the way, that may match differently."""
_LEAST_LEFT = 1e-3
"""Least share of a piece's power that counts as noise, because maps are not known better."""


class Pieces(NamedTuple):
    """Match of each piece of a template, per trace.

    Attributes:
        gain: gain of the live traces over the ground.
        weight: independent numbers of the trace's piece divided by the piece's residual power.
        evidence: log-likelihood ratio of the template, against unrelated ground.
    """

    gain: Float[Array, "batch trace"]
    weight: Float[Array, "batch trace"]
    evidence: Float[Array, " batch"]


def match_pieces(
    product: Float[Array, "batch trace"],
    ground: Float[Array, "batch trace"],
    live: Float[Array, "batch trace"],
    scan: Int[Array, "batch trace"],
    numbers: Float[Array, " batch"],
) -> Pieces:
    """Gain and noise of each piece of a template.

    If a window extends onto ground unlike the map, some pieces match and others carry no information on the pose,
    however strong they are; with one gain and one noise for all they would count as if they did. If pieces differ no
    more than by chance they share one gain and one noise, else each has its own, shrunk towards the common one by the
    share of the squared differences due to chance (Efron and Morris, 1973). The residual of a piece is its noise.

    Args:
        product, ground, live: product of each trace with the ground, power of the ground and of the trace; 0 if it does
            not count.
        scan: scan of each trace (see ``Template``).
        numbers: number of independent numbers in the template.
    """
    scans = jnp.max(scan, axis=-1, keepdims=True) + 1
    member = (scan * _PIECES // scans)[..., None] == jnp.arange(_PIECES)[None, None]

    def of_pieces(field: Float[Array, "batch trace"]) -> Float[Array, "batch piece"]:
        return jnp.sum(jnp.where(member, field[..., None], 0.0), axis=1)

    def of_traces(field: Float[Array, "batch piece"]) -> Float[Array, "batch trace"]:
        return jnp.sum(jnp.where(member, field[:, None], 0.0), axis=-1)

    traces = of_pieces((ground > 0.0).astype(jnp.float32))
    product, ground, live = of_pieces(product), of_pieces(ground), of_pieces(live)
    there = (ground > 0.0) & (live > 0.0)
    ground, live = (jnp.where(there, field, 1.0) for field in (ground, live))
    numbers = numbers[:, None] * traces / jnp.maximum(jnp.sum(traces, axis=-1, keepdims=True), 1.0)
    numbers = jnp.where(there, numbers, 0.0)
    by_chance = jnp.maximum(jnp.sum(there, axis=-1, dtype=jnp.float32) - 1.0, 0.0)
    whole = jnp.maximum(jnp.sum(numbers, axis=-1, keepdims=True), 1e-6)

    def kept(square: Float[Array, " batch"]) -> Float[Array, "batch 1"]:
        return jnp.maximum(1.0 - by_chance / jnp.maximum(square, 1e-6), 0.0)[:, None]

    def left_of(gain: Float[Array, "batch piece"]) -> Float[Array, "batch piece"]:
        return jnp.maximum(live - 2.0 * gain * product + gain**2 * ground, _LEAST_LEFT * live)

    def noise_of(left: Float[Array, "batch piece"]) -> Float[Array, "batch piece"]:
        level = jnp.log(left)
        away = level - jnp.sum(numbers * level, axis=-1, keepdims=True) / whole
        common = jnp.log(jnp.sum(numbers * left, axis=-1, keepdims=True) / whole)
        # Of N numbers the logarithm of the power scatters by 2/N.
        return jnp.exp(common + kept(0.5 * jnp.sum(numbers * away**2, axis=-1)) * (level - common))

    own = product / ground
    weight = numbers / noise_of(left_of(own))
    common = jnp.sum(weight * product, axis=-1) / jnp.maximum(jnp.sum(weight * ground, axis=-1), 1e-30)
    apart = own - common[:, None]
    # Ground of the opposite sign is no match.
    gain = jnp.maximum(common[:, None] + kept(jnp.sum(weight * ground * apart**2, axis=-1)) * apart, 0.0)
    left = left_of(gain)
    noise = noise_of(left)
    evidence = -0.5 * jnp.sum(numbers * (jnp.log(noise / live) + left / noise - 1.0), axis=-1)
    return Pieces(of_traces(gain), of_traces(numbers / noise), evidence)


def normal_equations(
    sums: Sums, pieces: Pieces, sampled: SampledGround, template: Template, pose: Float[Array, "batch 6"]
) -> tuple[Float[Array, "batch 6 6"], Float[Array, "batch 6"]]:
    """Matrix and right side of a step: P'QP and P'Q(live), Q projecting the ground out, each piece with its gain and
    weight. The matrix is the information that the template holds of its pose.

    How far each degree of freedom moves a trace along, across and up: (1, 0, 0), (0, 1, 0), (0, 0, 1), yaw
    (-b, a, 0) with (a, b) its offset in the tile's frame, roll and pitch (0, 0, lift) and (0, 0, tilt).
    """
    once, twice = pieces.weight * pieces.gain, pieces.weight * pieces.gain**2
    of_live = ("live_ground", "live_along", "live_cross", "live_delayed")
    sums = Sums(**{name: field * (once if name in of_live else twice) for name, field in sums._asdict().items()})
    a, b = sampled.turned_m[..., 0], sampled.turned_m[..., 1]
    lift = template.offset_m[..., 1] * jnp.cos(pose[:, 4, None])
    tilt = template.offset_m[..., 0] * jnp.cos(pose[:, 5, None])
    xx, xy, yy = sums.along_along, sums.along_cross, sums.cross_cross
    xz, yz, zz = sums.along_delayed, sums.cross_delayed, sums.delayed_delayed
    xt, yt, zt = a * xy - b * xx, a * yy - b * xy, a * yz - b * xz
    upper = (
        (xx, xy, xz, xt, lift * xz, tilt * xz),
        (yy, yz, yt, lift * yz, tilt * yz),
        (zz, zt, lift * zz, tilt * zz),
        (a * yt - b * xt, lift * zt, tilt * zt),
        (lift * lift * zz, lift * tilt * zz),
        (tilt * tilt * zz,),
    )
    turn = a * sums.ground_cross - b * sums.ground_along
    onto = (sums.ground_along, sums.ground_cross, turn)
    rise = sums.live_delayed
    turn = a * sums.live_cross - b * sums.live_along
    toward = (sums.live_along, sums.live_cross, rise, turn, lift * rise, tilt * rise)
    terms = [term for row in (*upper, onto, toward, (sums.ground_ground, sums.live_ground)) for term in row]
    totals = iter(_totals(terms, 1))
    gram = {(i, j): next(totals) for i in range(6) for j in range(i, 6)}
    along, cross, yaw = (next(totals) for _ in range(3))
    still = jnp.zeros_like(along)
    on = jnp.stack([along, cross, still, yaw, still, still], axis=-1)
    side = jnp.stack([next(totals) for _ in range(6)], axis=-1)
    ground, product = totals
    full = jnp.stack([gram[min(i, j), max(i, j)] for i in range(6) for j in range(6)], axis=-1).reshape(-1, 6, 6)
    safe = jnp.maximum(ground, 1e-30)
    alpha = product / safe
    matrix = full - on[:, :, None] * (on / safe[:, None])[:, None, :]
    side = side - on * alpha[:, None]
    return matrix * (alpha**2)[:, None, None], side * alpha[:, None]


def _totals(terms: list[Array], axis: int) -> list[Array]:
    """Sums of many terms along an axis in one pass."""
    zeros = [jnp.float32(0.0)] * len(terms)
    totals: list[Array] = jax.lax.reduce(
        terms, zeros, lambda one, other: [a + b for a, b in zip(one, other, strict=True)], (axis,)
    )
    return totals


def _cell_of(
    tile: Tile, position_m: Float[Array, "*batch 2"]
) -> tuple[Int[Array, "*batch 4"], Float[Array, "*batch 2"], Bool[Array, "*batch"]]:
    """Indices of the four cells around each place, the fractions between them, and whether all are on the map."""
    lead = (1,) * (position_m.ndim - 1) + (2,)
    cells = (position_m - tile.origin_m.reshape(lead)) / tile.cell_m.reshape(lead)
    low = jnp.floor(cells)
    size = jnp.asarray(tile.valid.shape, dtype=jnp.int32).reshape(lead)
    base = low.astype(jnp.int32)
    inside = jnp.all((base >= 0) & (base + 1 < size), axis=-1)
    base = jnp.clip(base, 0, size - 2)
    width = tile.valid.shape[1]
    step = jnp.asarray([0, 1, width, width + 1], dtype=jnp.int32).reshape((1,) * (position_m.ndim - 1) + (4,))
    corners = (base[..., 0] * width + base[..., 1])[..., None] + step
    return corners, cells - low, inside & jnp.all(tile.valid.reshape(-1)[corners], axis=-1)


def leads_off_map(
    tile: Tile, template: Template, pose: Float[Array, "batch 6"], min_overlap: float | Float[Array, ""]
) -> Bool[Array, "batch 2"]:
    """Along and across: whether a step of a cell to either side leaves less than ``min_overlap`` on the map."""
    step = np.array([[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]], np.float32)
    moved = jnp.asarray(step)[:, None, None] * tile.cell_m[None, None, None]
    _, _, on_map = _cell_of(tile, (pose[:, None, :2] + _turned(template, pose))[None] + moved)
    traces = jnp.maximum(jnp.sum(template.valid, axis=-1, dtype=jnp.float32), 1.0)[None]
    off = jnp.sum(on_map & template.valid[None], axis=-1, dtype=jnp.float32) / traces < min_overlap
    return jnp.stack([off[0] & off[1], off[2] & off[3]], axis=-1)
