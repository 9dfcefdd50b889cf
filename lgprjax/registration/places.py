"""The coarse stage: strength of scans and windows at every place of a tile's columns, and where its summits are.

A window's products are those of its scans, each taken where the window puts it: sums of slices, no second product.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from lgprjax.radar import air_delay_ns, shift_travel_time
from lgprjax.registration.columns import ArrayColumns
from lgprjax.registration.correlation import OFF_MAP_SCORE


class PlaceScores(NamedTuple):
    """Strength at each place.

    Attributes:
        strength: best over the heights tried; ``OFF_MAP_SCORE`` where overlap is missing.
        product: with each height.
        overlap: share of the template on the map.
    """

    strength: Float[Array, "end along cross"]
    product: Float[Array, "end height along cross"]
    overlap: Float[Array, "end along cross"]


def products_at_places(
    columns: ArrayColumns,
    components: Float[Array, "coefficient component"],
    coefficients: Float[Array, "scan channel coefficient"],
    above_m: Float[Array, "scan channel"],
    heights_m: Float[Array, " height"],
    angular_frequency_rad_per_ns: Float[Array, " half"],
) -> Float[Array, "scan height along cross"]:
    """Products of every scan, at every height, with every place.

    Args:
        columns, components: of the tile.
        coefficients: of each trace; zeros where invalid.
        above_m: height of each antenna above the tile's reference by the prior.
        heights_m: what to add to it.
    """
    scans = coefficients.shape[0]
    raised = above_m[:, None, :] + heights_m[None, :, None]
    live = shift_travel_time(
        jnp.broadcast_to(coefficients[:, None], (*raised.shape, coefficients.shape[-1])),
        -air_delay_ns(raised),
        angular_frequency_rad_per_ns,
    )
    rows = (live @ components).reshape(scans * heights_m.shape[0], -1)
    size, along, cross = columns.value.shape
    product = rows @ columns.value.reshape(size, along * cross)
    return product.reshape(scans, heights_m.shape[0], along, cross)


def single_scores(
    columns: ArrayColumns,
    products: Float[Array, "scan height along cross"],
    live_power: Float[Array, " scan"],
    min_overlap: float | Float[Array, ""],
) -> PlaceScores:
    """Scores of single scans at all places."""
    usable = (columns.overlap >= min_overlap) & (columns.power > 0.0)
    level = jnp.where(usable, jax.lax.rsqrt(jnp.where(usable, columns.power, 1.0)), 0.0)
    quiet = live_power <= 0.0
    loud = jax.lax.rsqrt(jnp.where(quiet, 1.0, live_power))[:, None, None]
    # Live power off the map counts in full and overlap not at all: their shares cancel where channels are equally loud.
    strength = jnp.max(products, axis=1) * level[None] * loud
    strength = jnp.where(usable[None] & ~quiet[:, None, None], strength, OFF_MAP_SCORE)
    return PlaceScores(
        strength,
        products,
        jnp.broadcast_to(columns.overlap[None], strength.shape),
    )


def window_scores(
    columns: ArrayColumns,
    products: Float[Array, "scan height along cross"],
    live_power: Float[Array, " scan"],
    member: Int[Array, "end member"],
    shift: Int[Array, "end member 2"],
    min_overlap: float | Float[Array, ""],
    *,
    border: tuple[int, int],
) -> PlaceScores:
    """Scores of windows at all places of their last scan.

    Args:
        member: numbers of the window's scans, the last scan first.
        shift: places from the last scan to each, along and across; at most ``border``.
    """
    _, heights, along, cross = products.shape
    edge = [(b, b) for b in border]
    padded = jnp.pad(products, [(0, 0), (0, 0), *edge])
    ground = jnp.pad(jnp.stack([columns.power, columns.overlap]), [(0, 0), *edge])
    reach = jnp.asarray(border, dtype=jnp.int32)
    members = member.shape[1]

    def one(lane: tuple[Array, Array]) -> tuple[Array, Array]:
        scans, at = lane[0], jnp.clip(lane[1] + reach[None], 0, 2 * reach[None])

        def add(k: Int[Array, ""], total: tuple[Array, Array]) -> tuple[Array, Array]:
            part = jax.lax.dynamic_slice(padded, (scans[k], 0, at[k, 0], at[k, 1]), (1, heights, along, cross))[0]
            below = jax.lax.dynamic_slice(ground, (0, at[k, 0], at[k, 1]), (2, along, cross))
            return total[0] + part, total[1] + below

        zero = (jnp.zeros((heights, along, cross), jnp.float32), jnp.zeros((2, along, cross), jnp.float32))
        product, below = jax.lax.fori_loop(0, members, add, zero)
        return product, below

    product, below = jax.lax.map(one, (member, shift))
    loud = jnp.sum(live_power[member], axis=1)[:, None, None]
    overlap = below[:, 1] / members
    usable = (overlap >= min_overlap) & (below[:, 0] > 0.0) & (loud > 0.0)
    level = jnp.where(usable, below[:, 0], 1.0) * jnp.where(usable, loud, 1.0)
    strength = jnp.max(product, axis=1) * jax.lax.rsqrt(level)
    return PlaceScores(jnp.where(usable, strength, OFF_MAP_SCORE), product, overlap)


class Summits(NamedTuple):
    """Best summits of each template that lie apart from each other.

    Attributes:
        place_m: along and cross.
        height: number of the best height there.
        strength: there; ``OFF_MAP_SCORE`` where there was none left.
        floor: standard deviation of the strength away from the best: what ground that does not match gives by chance.
        overlap: largest overlap within the region.
    """

    place_m: Float[Array, "end summit 2"]
    height: Int[Array, "end summit"]
    strength: Float[Array, "end summit"]
    floor: Float[Array, " end"]
    overlap: Float[Array, " end"]


def find_summits(
    columns: ArrayColumns,
    scores: PlaceScores,
    centre_m: Float[Array, "end 2"],
    half_width_m: Float[Array, "end 2"],
    apart_m: Float[Array, ""],
    *,
    summits: int,
) -> Summits:
    """Best summits within each template's region, each at least ``apart_m`` from those before it.

    Summits only: the flank of the best one, just beyond ``apart_m``, is no rival. The scatter is that of all places on
    the map, so that a small region knows it as well as a large one.
    """
    ends, along_size, cross_size = scores.strength.shape
    along = columns.origin_m[0] + jnp.arange(along_size, dtype=jnp.float32) * columns.step_m[0]
    cross = columns.origin_m[1] + jnp.arange(cross_size, dtype=jnp.float32) * columns.step_m[1]
    # Half a step more: the summit of a region's rim may belong to a place just outside.
    room = half_width_m + 0.5 * columns.step_m[None]
    inside = (jnp.abs(along[None] - centre_m[:, :1]) <= room[:, :1])[:, :, None]
    inside = inside & (jnp.abs(cross[None] - centre_m[:, 1:]) <= room[:, 1:])[:, None, :]
    left = jnp.where(inside, scores.strength, OFF_MAP_SCORE)
    summit = jnp.where(scores.strength >= _highest_neighbour(scores.strength), left, OFF_MAP_SCORE)
    lane = jnp.arange(ends)
    places, strengths, numbers = [], [], []
    on_map = scores.strength > OFF_MAP_SCORE
    away = on_map
    for number in range(summits):
        # The best place may lie on a slope that rises out of the region: no summit, but found all the same.
        i, j = _highest(left if number == 0 else summit)
        strengths.append((left if number == 0 else summit)[lane, i, j])
        numbers.append(jnp.argmax(scores.product[lane, :, i, j], axis=1))
        at = jnp.stack([along[i], cross[j]], axis=-1)
        places.append(at + _beside(scores.strength, i, j) * columns.step_m[None])
        distance = ((along[None] - at[:, :1]) ** 2)[:, :, None] + ((cross[None] - at[:, 1:]) ** 2)[:, None, :]
        near = distance < apart_m**2
        summit = jnp.where(near, OFF_MAP_SCORE, summit)
        if number == 0:
            away = on_map & ~near
    count = jnp.sum(away, axis=(1, 2), dtype=jnp.float32)
    total = jnp.maximum(count, 1.0)
    mean = jnp.sum(jnp.where(away, scores.strength, 0.0), axis=(1, 2)) / total
    square = jnp.sum(jnp.where(away, scores.strength**2, 0.0), axis=(1, 2)) / total
    # A handful of places away from the best tells nothing of chance: then as little is believed as can be.
    floor = jnp.where(count >= 16.0, jnp.sqrt(jnp.maximum(square - mean**2, 1e-8)), 0.5)
    return Summits(
        jnp.stack(places, axis=1),
        jnp.stack(numbers, axis=1).astype(jnp.int32),
        jnp.stack(strengths, axis=1),
        floor,
        jnp.max(jnp.where(inside, scores.overlap, 0.0), axis=(1, 2)),
    )


def _highest(strength: Float[Array, "end along cross"]) -> tuple[Int[Array, " end"], Int[Array, " end"]]:
    """Where the maximum is: the column first, then the place in it; half the cost of one search over both."""
    column = jnp.argmax(jnp.max(strength, axis=1), axis=1)
    in_column = jnp.take_along_axis(strength, column[:, None, None], axis=2)[:, :, 0]
    return jnp.argmax(in_column, axis=1), column


def _beside(
    strength: Float[Array, "end along cross"], i: Int[Array, " end"], j: Int[Array, " end"]
) -> Float[Array, "end 2"]:
    """How far, in places, the top of a parabola through each place and its neighbours lies beside it."""
    _, along, cross = strength.shape
    lane = jnp.arange(len(i))
    here = strength[lane, i, j]
    inner = (i > 0) & (i < along - 1) & (j > 0) & (j < cross - 1)

    def top(before: Float[Array, " end"], after: Float[Array, " end"]) -> Float[Array, " end"]:
        bend = before + after - 2.0 * here
        good = inner & (bend < -1e-6) & (jnp.minimum(before, after) > OFF_MAP_SCORE)
        return jnp.where(good, jnp.clip(0.5 * (before - after) / jnp.where(good, bend, 1.0), -0.5, 0.5), 0.0)

    i0, i1 = jnp.maximum(i - 1, 0), jnp.minimum(i + 1, along - 1)
    j0, j1 = jnp.maximum(j - 1, 0), jnp.minimum(j + 1, cross - 1)
    ahead = top(strength[lane, i0, j], strength[lane, i1, j])
    return jnp.stack([ahead, top(strength[lane, i, j0], strength[lane, i, j1])], axis=-1)


def _highest_neighbour(strength: Float[Array, "end along cross"]) -> Float[Array, "end along cross"]:
    """Highest of the eight places around each."""
    _, along, cross = strength.shape
    padded = jnp.pad(strength, [(0, 0), (1, 1), (1, 1)], constant_values=OFF_MAP_SCORE)
    highest = jnp.full_like(strength, OFF_MAP_SCORE)
    for i, j in ((0, 0), (0, 1), (0, 2), (1, 0), (1, 2), (2, 0), (2, 1), (2, 2)):
        highest = jnp.maximum(highest, padded[:, i : i + along, j : j + cross])
    return highest
