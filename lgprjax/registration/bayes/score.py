"""Correlation of one scan of the array with the map over a lattice of places: one matrix product, then slices.

Correlation is linear in the map. The scan's traces, at every alternative of time scale and height, are multiplied with
all places around the lattice at once; each channel's products are then moved by the channel's place in the array, which
is the same for the whole lattice: four slices with scalar weights, and no gather at any heading.
"""

from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from lgprjax.radar import air_delay_ns, shift_travel_time
from lgprjax.subsurface import Tile

ON_MAP = 0.3
"""Least share of the array over mapped ground: what is beside it says nothing, for or against."""


class LatticeGround(NamedTuple):
    """A tile's ground at the places of a lattice, with a border of unmapped places.

    Attributes:
        value: leading components of the map's coefficients; 0 off the map.
        power: sum of their squares.
        known: 1 on the map, else 0.
    """

    value: Float[Array, "component along cross"]
    power: Float[Array, "along cross"]
    known: Float[Array, "along cross"]


class Surface(NamedTuple):
    """Correlation of a scan over a lattice.

    Attributes:
        r: correlation with the ground under the part of the array that is on the map; 0 with too little of it.
        cover: share of the channels on the map; 0 with too little of it.
    """

    r: Float[Array, "plane along cross"]
    cover: Float[Array, "along cross"]


@partial(jax.jit, static_argnames=("stride", "finer", "border"))
def lattice_ground(
    tile: Tile,
    components: Float[Array, "coefficient component"],
    *,
    stride: tuple[int, int],
    finer: tuple[int, int],
    border: tuple[int, int],
) -> LatticeGround:
    """Every ``stride``-th cell of a tile, or ``finer`` places a cell; ``border`` places added on all sides."""
    cells = tile.valid[:: stride[0], :: stride[1]]
    known = cells.astype(jnp.float32)[None]
    value = jnp.where(cells[..., None], tile.coefficients[:: stride[0], :: stride[1]] @ components, 0.0)
    value = jnp.moveaxis(value, -1, 0)
    for axis, parts in zip((1, 2), finer, strict=True):
        value, known = _between(value, parts, axis), _between(known, parts, axis)
    # Between two cells of which one is not mapped, nothing is.
    known = (known > 1.0 - 1e-3).astype(jnp.float32)
    value, known = (jnp.pad(each, [(0, 0), (border[0],) * 2, (border[1],) * 2]) for each in (value * known, known))
    return LatticeGround(value, jnp.sum(value**2, axis=0), known[0])


def _between(field: Float[Array, "lead _ _"], parts: int, axis: int) -> Float[Array, "lead _ _"]:
    """``parts`` values a cell along an axis, linear from one to the next; the last cell has one."""
    if parts == 1:
        return field
    count = field.shape[axis]
    first, second = (jax.lax.slice_in_dim(field, at, at + count - 1, axis=axis) for at in (0, 1))
    steps = [first + (part / parts) * (second - first) for part in range(parts)]
    shape = list(field.shape)
    shape[axis] = parts * (count - 1)
    filled = jnp.stack(steps, axis=axis + 1).reshape(shape)
    return jnp.concatenate([filled, jax.lax.slice_in_dim(field, count - 1, count, axis=axis)], axis=axis)


@jax.jit
def live_components(
    coefficients: Float[Array, "scale stop channel coefficient"],
    above_m: Float[Array, "stop channel"],
    heights_m: Float[Array, " plane"],
    scale: Int[Array, " plane"],
    components: Float[Array, "coefficient component"],
    angular_frequency_rad_per_ns: Float[Array, " half"],
) -> Float[Array, "stop plane channel component"]:
    """Traces of stops at every alternative, in the map's leading components.

    Args:
        coefficients: at each time scale.
        above_m: antennas above the tile's height reference, by the prior.
        heights_m, scale: what each alternative adds to the height, and number of its time scale.
        components: leading directions of the map's coefficients.
        angular_frequency_rad_per_ns: of the coefficients.
    """
    raised = above_m[:, None] + heights_m[None, :, None]
    live = jnp.moveaxis(coefficients[scale], 0, 1)
    return shift_travel_time(live, -air_delay_ns(raised), angular_frequency_rad_per_ns) @ components


def correlate(
    ground: LatticeGround,
    live: Float[Array, "plane channel component"],
    valid: Float[Array, " channel"],
    corner: Float[Array, "2"],
    offset: Float[Array, "channel 2"],
    shape: tuple[int, int],
    reach: tuple[int, int],
) -> Surface:
    """Surface of one scan.

    Args:
        ground: of the tile.
        live: see ``live_components``.
        valid: 1 for channels that hold data.
        corner: place of the lattice's first point, along and across, from the ground's first.
        offset: of each channel from the array's centre, along and across, in places.
        shape: of the lattice.
        reach: places that a channel may be from the array's centre.
    """
    planes, channels, kept = live.shape
    low = jnp.floor(corner).astype(jnp.int32)
    size = (shape[0] + 2 * reach[0] + 2, shape[1] + 2 * reach[1] + 2)
    start = (low[0] - reach[0], low[1] - reach[1])
    window = jax.lax.dynamic_slice(ground.value, (0, *start), (kept, *size))
    power, known = (jax.lax.dynamic_slice(field, start, size) for field in (ground.power, ground.known))
    rows = jnp.moveaxis(live, 1, 0).reshape(channels * planes, kept)
    product = (rows @ window.reshape(kept, -1)).reshape(channels, planes, *size)
    loud = jnp.sum(live**2, axis=-1) * valid[None]
    # Alternatives differ in loudness, channels' shares of it hardly.
    whole, share = jnp.sum(loud, axis=1), jnp.mean(loud, axis=0)
    share = share / jnp.maximum(jnp.sum(share), 1e-30)
    moved = offset + (corner - low.astype(jnp.float32))[None]
    most = jnp.asarray(reach, jnp.int32)[None]
    first = jnp.clip(jnp.floor(moved).astype(jnp.int32), -most, most)
    part = moved - first.astype(jnp.float32)
    first = first + most
    beside = jnp.stack([power, known])

    def add(channel: Int[Array, ""], sums: tuple[Array, ...]) -> tuple[Array, ...]:
        u, v = part[channel, 0], part[channel, 1]
        weights = ((1.0 - u) * (1.0 - v), (1.0 - u) * v, u * (1.0 - v), u * v)

        def between(field: Float[Array, "lead _ _"]) -> Float[Array, "lead along cross"]:
            near = jax.lax.dynamic_slice(
                field, (0, first[channel, 0], first[channel, 1]), (len(field), shape[0] + 1, shape[1] + 1)
            )
            corners = (near[:, :-1, :-1], near[:, :-1, 1:], near[:, 1:, :-1], near[:, 1:, 1:])
            return sum((weight * each for weight, each in zip(weights, corners, strict=True)), start=jnp.float32(0.0))

        below, mapped = between(beside)
        on = jnp.where(mapped > 1.0 - 1e-3, valid[channel], 0.0)
        own = between(jax.lax.dynamic_index_in_dim(product, channel, keepdims=False))
        return sums[0] + on[None] * own, sums[1] + on * below, sums[2] + on * share[channel], sums[3] + on

    blank = (jnp.zeros((planes, *shape)), *(jnp.zeros(shape),) * 3)
    number, below, heard, over = jax.lax.fori_loop(0, channels, add, jax.tree.map(jnp.float32, blank))
    cover = over / jnp.maximum(jnp.sum(valid), 1.0)
    usable = (cover >= ON_MAP) & (below > 1e-12) & (heard > 0.0)
    level = jnp.where(usable, jax.lax.rsqrt(jnp.where(usable, below * heard, 1.0)), 0.0)
    quiet = jax.lax.rsqrt(jnp.where(whole > 0.0, whole, jnp.inf))
    return Surface(number * level[None] * quiet[:, None, None], jnp.where(usable, cover, 0.0))


@partial(jax.jit, static_argnames=("shape", "reach"))
def surfaces(
    ground: LatticeGround,
    live: Float[Array, "stop plane channel component"],
    valid: Float[Array, "stop channel"],
    corner: Float[Array, "stop 2"],
    offset: Float[Array, "stop channel 2"],
    *,
    shape: tuple[int, int],
    reach: tuple[int, int],
) -> Surface:
    """``correlate`` for each of some stops."""
    made: Surface = jax.lax.map(
        lambda stop: correlate(ground, stop[0], stop[1], stop[2], stop[3], shape, reach), (live, valid, corner, offset)
    )
    return made


def channel_offsets(
    body_m: Float[np.ndarray, "channel 2"], yaw_rad: Float[np.ndarray, " stop"], step_m: Float[np.ndarray, "2"]
) -> Float[np.ndarray, "stop channel 2"]:
    """Places of channels from the array's centre in a tile's frame, in lattice steps.

    Args:
        body_m: forward and left of the centre; one a stop, or one for all.
        yaw_rad: heading from the tile's axis.
        step_m: of the lattice.
    """
    cos, sin = np.cos(yaw_rad)[:, None], np.sin(yaw_rad)[:, None]
    forward, left = np.moveaxis(np.broadcast_to(body_m, (len(yaw_rad), *body_m.shape[-2:])), -1, 0)
    return np.asarray(np.stack([cos * forward - sin * left, sin * forward + cos * left], axis=-1) / step_m)
