"""Where on a whole map a drive is, with no prior position: places proposed, then weighed by the Bayes filter.

Every baseline is a line of cells a quarter of a wavelength apart, each with the map's traces at nodes across. A drive
begins at a cell, is so many nodes aside, goes along the line or against it, at a time scale. ``propose`` scores the
first stops at every such place by one matrix product a stop, and keeps the highest. ``run`` weighs what was kept,
each with its surroundings, from the first stop on: predict, weigh, normalise, report. What was not proposed counts like
foreign ground: its evidence is one, so that a place that was missed makes ``p_false`` large and not the fix wrong.
"""

from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from lgprjax.registration.bayes.filter import diffused, normalised
from lgprjax.registration.bayes.likelihood import RHOS, Likelihood, evidence
from lgprjax.registration.bayes.score import ON_MAP
from lgprjax.registration.fix import WRONG_M

SCALES = np.linspace(0.95, 1.08, 6)
"""Ratios of travel times in the ground, this drive to the map, that are searched."""
FIRST = 16
"""Stops that places are proposed by."""
COARSE = 8
"""Components of a trace that they are proposed by."""
SHARD, HALO = 4096, 24
"""Cells that are scored together, and more of them to both sides."""
ALONG, ACROSS = 8, 4
"""Cells and nodes of a place that is proposed."""
ROOM = 2
"""Cells and nodes around it that it may wander to before it is moved."""
PRIOR_FOREIGN = 0.5
_COARSE_SCALES = (0, 2, 4)
_COARSE_RHO = 0.6
_FOREIGN, _MIXING = 1e-6, 0.02  # a metre
_LEAST_R = -0.9


class Lines(NamedTuple):
    """The map's baselines, one after the other, unmapped cells between them.

    Attributes:
        value: leading components of the traces; 0 where there is none.
        power: sum of their squares.
        known: 1 where there is a trace, else 0.
        pose: east, north and yaw of the array's centre, east and north from the map's first cell.
    """

    value: Float[Array, "cell node component"]
    power: Float[Array, "cell node"]
    known: Float[Array, "cell node"]
    pose: Float[Array, "cell 3"]


class Heard(NamedTuple):
    """Stops of a drive, at the nodes of its own array: forwards, and turned round.

    Attributes:
        live: traces at every time scale, each channel shared out to the two nodes beside it.
        weight: channels of each node.
        loud: share of the scan's power at each node.
        at: travel from the first stop, in cells.
        travel_m: from the stop before.
        there: the stop exists.
    """

    live: Float[Array, "*stop way scale own component"]
    weight: Float[Array, "*stop way own"]
    loud: Float[Array, "*stop way own"]
    at: Float[Array, "*stop"]
    travel_m: Float[Array, "*stop"]
    there: Bool[Array, "*stop"]


class Places(NamedTuple):
    """The proposal of a stop.

    Attributes:
        cell, node: first of each place; a node counts from the outermost at which the arrays meet.
        way: 0 along the line, 1 against it.
    """

    cell: Int[Array, " place"]
    node: Int[Array, " place"]
    way: Int[Array, " place"]


class Shown(NamedTuple):
    """What the places of the whole map show of foreign ground: scatter at each of the first stops, and memory."""

    variance: Float[np.ndarray, " stop"]
    memory: float


class Report(NamedTuple):
    """Report of a stop.

    Attributes:
        p_false: probability of everything more than 0.3 m from the mode or with another heading, foreign ground
            included.
        foreign: of it, foreign ground and all that was not proposed.
        place_m, yaw, covariance_m2: mean of what is near the mode, from the map's first cell; its heading.
        mass, centre_m: of each place that was proposed.
    """

    p_false: Float[Array, "*stop"]
    foreign: Float[Array, "*stop"]
    place_m: Float[Array, "*stop 2"]
    yaw: Float[Array, "*stop"]
    covariance_m2: Float[Array, "*stop 2 2"]
    mass: Float[Array, "*stop place"]
    centre_m: Float[Array, "*stop place 2"]


# Propose.


def _across(own: int, nodes: int) -> tuple[np.ndarray, np.ndarray]:
    """Node of the drive's array over each of the line, wherever the arrays may meet, and whether there is one."""
    of = np.arange(nodes)[:, None] - np.arange(nodes + own - 1)[None] + own - 1
    return np.clip(of, 0, own - 1), (of >= 0) & (of < own)


@partial(jax.jit, static_argnames=("count",))
def _scored(
    value: Float[Array, "cell node component"],
    power: Float[Array, "cell node"],
    known: Float[Array, "cell node"],
    heard: Heard,
    numbers: Float[Array, ""],
    tail: Float[Array, ""],
    count: int,
) -> tuple[Array, Array, Array, Array, Array]:
    """The best places of a shard; sums of squares for ``Shown``: by stop, of sums, and numbers of cells."""
    cells, nodes, kept = value.shape
    stops, ways, scales, own, _ = heard.live.shape
    inner = cells - 2 * HALO
    of, there = (jnp.asarray(each) for each in _across(own, nodes))
    aside = of.shape[1]
    flat = value.reshape(cells, nodes * kept)
    middle = scales // 2

    def stop(k: Int[Array, ""], sums: tuple[Array, ...]) -> tuple[Array, ...]:
        total, summed, squares, over = sums
        ahead = jnp.round(heard.at[k]).astype(jnp.int32)
        for way in range(ways):
            first = HALO + (ahead if way == 0 else -ahead)
            rows = jax.lax.dynamic_slice_in_dim(flat, first, inner)
            below_, known_ = (jax.lax.dynamic_slice_in_dim(each, first, inner) for each in (power, known))
            live = jnp.where(there[..., None, None], jnp.moveaxis(heard.live[k, way], 0, 2)[of], 0.0)
            matrix = jnp.moveaxis(live, 1, 2).reshape(nodes * kept, aside * scales)
            weight, loud = (jnp.where(there, each[k, way][of], 0.0) for each in (heard.weight, heard.loud))
            below, share, cover = below_ @ weight, known_ @ loud, (known_ @ weight) / jnp.sum(heard.weight[k, way])
            usable = (cover >= ON_MAP) & (below > 1e-12) & (share > 0.0)
            level = jnp.where(usable, jax.lax.rsqrt(jnp.where(usable, below * share, 1.0)), 0.0)
            r = (rows @ matrix).reshape(inner, aside, scales) * level[..., None]
            log = (
                numbers
                * jnp.where(usable, cover, 0.0)[..., None]
                * (0.5 * jnp.log1p(-(_COARSE_RHO**2)) - jnp.log1p(-_COARSE_RHO * jnp.clip(r, _LEAST_R, 0.98)))
            )
            gain = log - jnp.logaddexp(jnp.log1p(-tail), jnp.log(tail) + log)
            on = heard.there[k].astype(jnp.float32)
            total = total.at[way].add(on * jnp.where(usable[..., None], gain, 0.0))
            summed = summed.at[way].add(on * r[..., middle])
            squares = squares.at[k].add(on * jnp.sum(r[..., middle] ** 2))
            over = over.at[k].add(on * jnp.sum(usable, dtype=jnp.float32))
        return total, summed, squares, over

    blank = (
        jnp.zeros((ways, inner, aside, scales)),
        jnp.zeros((ways, inner, aside)),
        jnp.zeros(stops),
        jnp.zeros(stops),
    )
    total, summed, squares, over = jax.lax.fori_loop(0, stops, stop, blank)
    groups = -(-aside // ACROSS)
    best = jnp.pad(jnp.max(total, axis=3), [(0, 0), (0, 0), (0, groups * ACROSS - aside)], constant_values=-jnp.inf)
    grouped = jnp.max(best.reshape(ways, inner // ALONG, ALONG, groups, ACROSS), axis=(2, 4))
    high, index = jax.lax.top_k(grouped.ravel(), count)
    return high, index, squares, over, jnp.sum(summed**2)


def propose(lines: Lines, heard: Heard, likelihood: Likelihood, count: int) -> tuple[Places, Shown]:
    """The ``count`` most likely places of a map by the first stops, and what all of them show.

    Args:
        lines: of the map, with ``HALO`` unmapped cells at both ends.
        heard: the first stops.
        likelihood: of map and array.
        count: of places.
    """
    cells, nodes, _ = lines.value.shape
    kept = min(COARSE, lines.value.shape[2])
    scales = jnp.asarray(_COARSE_SCALES)
    live = heard.live[:, :, scales, :, :kept]
    whole = jnp.sum(live**2, axis=(3, 4), keepdims=True)
    coarse = heard._replace(live=live * jax.lax.rsqrt(jnp.where(whole > 0.0, whole, jnp.inf)))
    value = lines.value[..., :kept]
    power = jnp.sum(value**2, axis=-1)
    groups = -(-(nodes + heard.live.shape[3] - 1) // ACROSS)
    numbers = jnp.float32(1.0 / (likelihood.variance * likelihood.memory))
    found, sums = [], 0.0
    squares, over = np.zeros(len(heard.at)), np.zeros(len(heard.at))
    inner = min(SHARD, -(-(cells - 2 * HALO) // 1024) * 1024)
    for low in range(0, max(cells - 2 * HALO, 1), inner):
        size = inner + 2 * HALO
        part = [each[low : low + size] for each in (value, power, lines.known)]
        part = [jnp.pad(each, [(0, size - len(each)), *[(0, 0)] * (each.ndim - 1)]) for each in part]
        high, index, square, many, summed = (
            np.asarray(each)
            for each in _scored(*part, coarse, numbers, jnp.float32(likelihood.tail), min(count, inner // ALONG))
        )
        way, rest = np.divmod(index, inner // ALONG * groups)
        cell, node = np.divmod(rest, groups)
        found.append(np.stack([high, low + HALO + cell * ALONG, node * ACROSS, way]))
        squares, over, sums = squares + square, over + many, sums + float(summed)
    every = np.concatenate(found, axis=1)
    every = every[:, np.argsort(-every[0], kind="stable")[:count]].astype(int)
    mean = np.where(over > 0.0, squares / np.maximum(over, 1.0), np.nan)
    return Places(*(jnp.asarray(each, jnp.int32) for each in every[1:])), Shown(mean, sums / max(squares.sum(), 1e-12))


# Weigh.


class _State(NamedTuple):
    mass: Float[Array, "place scale rho along across"]
    foreign: Float[Array, ""]
    at: Places


def begin(lines: Lines, places: Places, own: int) -> _State:
    """Uniform over the whole map, of which the places are a part; half of it foreign ground."""
    nodes = lines.known.shape[1]
    mapped = float(jnp.sum(jnp.sum(lines.known, axis=1) > 0.0))
    each = (1.0 - PRIOR_FOREIGN) / (2.0 * mapped * (nodes + own - 1) * len(SCALES) * len(RHOS))
    inside = np.zeros((ALONG + 2 * ROOM, ACROSS + 2 * ROOM), np.float32)
    inside[ROOM:-ROOM, ROOM:-ROOM] = each
    mass = jnp.broadcast_to(jnp.asarray(inside), (len(places.cell), len(SCALES), len(RHOS), *inside.shape))
    at = places._replace(cell=places.cell - ROOM, node=places.node - ROOM)
    return _State(mass, 1.0 - jnp.sum(mass), at)


def _surface(
    lines: Lines, stop: Heard, at: Places
) -> tuple[
    Float[Array, "place scale along across"], Float[Array, "place along across"], Float[Array, "place along"], Array
]:
    """Correlation, cover, cell and share of the way to the next one, for every place."""
    own, nodes = stop.live.shape[2], lines.known.shape[1]
    along, across = ALONG + 2 * ROOM, ACROSS + 2 * ROOM
    whole = jnp.floor(stop.at)
    part = stop.at - whole
    forward = at.way == 0
    # Against the line a cell and a part is a cell more, less the rest of it.
    ahead = jnp.where(forward, whole, -whole - 1.0).astype(jnp.int32)
    share = jnp.where(forward, part, 1.0 - part)
    cell = (at.cell + ahead)[:, None] + jnp.arange(along + 1)[None]
    node = at.node[:, None] - (own - 1) + jnp.arange(own + across - 1)[None]
    inside = (node >= 0) & (node < nodes)
    where = (jnp.clip(cell, 0, len(lines.known) - 1)[:, :, None], jnp.clip(node, 0, nodes - 1)[:, None])
    known = jnp.where(inside[:, None] & ((cell >= 0) & (cell < len(lines.known)))[..., None], lines.known[where], 0.0)
    value, power = lines.value[where] * known[..., None], lines.power[where] * known
    live, weight, loud = stop.live[at.way], stop.weight[at.way], stop.loud[at.way]
    places, scales, _, kept = live.shape
    flat = live.reshape(places, scales, own * kept)
    number, below, heard, over = [], [], [], []
    for aside in range(across):
        some = slice(aside, aside + own)
        number.append(jnp.einsum("pax,psx->psa", value[:, :, some].reshape(places, along + 1, own * kept), flat))
        below.append(jnp.einsum("pao,po->pa", power[:, :, some], weight))
        heard.append(jnp.einsum("pao,po->pa", known[:, :, some], loud))
        over.append(jnp.einsum("pao,po->pa", known[:, :, some], weight))

    def between(parts: list[Array]) -> Array:
        whole_ = jnp.stack(parts, axis=-1)
        between_ = share.reshape(-1, *(1,) * (whole_.ndim - 1))
        return (1.0 - between_) * whole_[..., :-1, :] + between_ * whole_[..., 1:, :]

    numbers, under, heard_, cover = between(number), between(below), between(heard), between(over)
    cover = cover / jnp.maximum(jnp.sum(weight, axis=1), 1.0)[:, None, None]
    usable = (cover >= ON_MAP) & (under > 1e-12) & (heard_ > 0.0)
    level = jnp.where(usable, jax.lax.rsqrt(jnp.where(usable, under * heard_, 1.0)), 0.0)
    loudness = jnp.sum(flat**2, axis=2)
    quiet = jax.lax.rsqrt(jnp.where(loudness > 0.0, loudness, jnp.inf))
    r = numbers * level[:, None] * quiet[:, :, None, None]
    return r, jnp.where(usable, cover, 0.0), cell[:, :-1], share


class Fixed(NamedTuple):
    """What does not change along a drive: map, likelihood, and sizes of a cell along and across."""

    lines: Lines
    likelihood: Likelihood
    memory: Float[Array, ""]
    spacing_m: Float[Array, ""]
    wander: Float[Array, "2"]
    node_m: Float[Array, ""]


def step(
    state: _State, stop: Heard, scatter: Float[Array, ""], first: Bool[Array, ""], fixed: Fixed
) -> tuple[_State, Report]:
    """One stop: predict, weigh, normalise, report. ``scatter`` is that of the whole map; where it is NaN, the places
    far from the mode give it.
    """
    mass, foreign, known = state.mass, state.foreign, fixed.likelihood
    moved = jnp.where(first, 0.0, stop.travel_m)
    for axis in range(2):
        mass = diffused(mass, jnp.minimum(0.5 * moved * fixed.wander[axis], 0.25), 3 + axis)
    mixing = jnp.minimum(_MIXING * moved, 0.1)
    mass = diffused(diffused(mass, mixing, 1), mixing, 2)
    foreign, mass = foreign + _FOREIGN * moved * jnp.sum(mass), (1.0 - _FOREIGN * moved) * mass
    r, cover, cell, share = _surface(fixed.lines, stop, state.at)
    pose_m, yaw = _poses(fixed, state.at, cell, share, stop.live.shape[2])
    place = jnp.sum(mass, axis=(1, 2))
    beside = _apart(pose_m, yaw, place)[0] & (cover > 0.0)
    shown = jnp.sum(jnp.where(beside, jnp.mean(r**2, axis=1), 0.0)) / jnp.maximum(
        jnp.sum(beside, dtype=jnp.float32), 1.0
    )
    variance = jnp.maximum(known.variance, jnp.where(jnp.isnan(scatter), shown, scatter))
    numbers = cover / (variance * jnp.maximum(known.memory, fixed.memory))
    numbers = numbers * jnp.minimum(stop.travel_m / fixed.spacing_m, 1.0)
    rho = jnp.asarray(RHOS, jnp.float32)[None, None, :, None, None]
    ratio = evidence(r[:, :, None], rho, numbers[:, None, None])
    mass, foreign = normalised(mass, foreign, ratio, jnp.asarray(known.tail))
    place = jnp.sum(mass, axis=(1, 2))
    away, mode = _apart(pose_m, yaw, place)
    near = jnp.where(away, 0.0, place)
    held = jnp.maximum(jnp.sum(near), 1e-30)
    mean = jnp.einsum("pij,pijx->x", near, pose_m) / held
    off = pose_m - mean[None, None, None]
    report = Report(
        p_false=jnp.clip(foreign + jnp.sum(jnp.where(away, place, 0.0)), 0.0, 1.0),
        foreign=foreign,
        place_m=mean,
        yaw=jnp.broadcast_to(yaw[..., None], place.shape).ravel()[mode],
        covariance_m2=jnp.einsum("pij,pijx,pijy->xy", near, off, off) / held,
        mass=jnp.sum(place, axis=(1, 2)),
        centre_m=jnp.einsum("pij,pijx->px", place, pose_m) / jnp.maximum(jnp.sum(place, axis=(1, 2)), 1e-30)[:, None],
    )
    after = _State(mass, foreign, state.at)
    return jax.tree.map(lambda new, old: jnp.where(stop.there, new, old), after, state), report


def _poses(
    fixed: Fixed, at: Places, cell: Int[Array, "place along"], share: Float[Array, " place"], own: int
) -> tuple[Float[Array, "place along across 2"], Float[Array, "place along"]]:
    """East and north of the array's centre at every cell and node of every place, and its heading."""
    last = len(fixed.lines.pose) - 1
    here, there = (fixed.lines.pose[jnp.clip(each, 0, last)] for each in (cell, cell + 1))
    pose = here + share[:, None, None] * (there - here)
    nodes = fixed.lines.known.shape[1]
    left_m = (
        (at.node[:, None] + jnp.arange(ACROSS + 2 * ROOM)[None]).astype(jnp.float32) - 0.5 * (nodes + own - 2)
    ) * fixed.node_m
    facing = here[..., 2]
    side = jnp.stack([-jnp.sin(facing), jnp.cos(facing)], axis=-1)
    place_m = pose[..., None, :2] + left_m[:, None, :, None] * side[:, :, None]
    return place_m, facing + jnp.pi * at.way[:, None].astype(jnp.float32)


def _apart(
    pose_m: Float[Array, "place along across 2"],
    yaw: Float[Array, "place along"],
    place: Float[Array, "place along across"],
) -> tuple[Bool[Array, "place along across"], Int[Array, ""]]:
    """Whether each is more than 0.3 m from the mode, or headed elsewhere; and the mode."""
    mode = jnp.argmax(place)
    away_m2 = jnp.sum((pose_m - pose_m.reshape(-1, 2)[mode][None, None, None]) ** 2, axis=-1)
    heading = jnp.broadcast_to(yaw[..., None], place.shape)
    return (away_m2 > WRONG_M**2) | (jnp.cos(heading - heading.ravel()[mode]) < 0.5), mode


@jax.jit
def run(
    state: _State, stops: Heard, scatter: Float[Array, " stop"], first: Bool[Array, " stop"], fixed: Fixed
) -> tuple[_State, Report]:
    """``step`` over a chunk of stops."""
    return jax.lax.scan(lambda before, each: step(before, *each, fixed), state, (stops, scatter, first))


@jax.jit
def recentred(state: _State) -> _State:
    """Places moved by whole cells and nodes to where their mass is; what falls off counts as foreign ground."""
    place = jnp.sum(state.mass, axis=(1, 2))
    middle = ((ALONG + 2 * ROOM) // 2, (ACROSS + 2 * ROOM) // 2)

    def one(mass: Array, here: Array) -> tuple[Array, Array]:
        i, j = jnp.unravel_index(jnp.argmax(here), here.shape)
        by = jnp.array([i - middle[0], j - middle[1]])
        by = jnp.where(jnp.abs(by) > ROOM, by, 0)
        size = here.shape
        wide = jnp.pad(mass, [(0, 0), (0, 0), (size[0],) * 2, (size[1],) * 2])
        return jax.lax.dynamic_slice(wide, (0, 0, size[0] + by[0], size[1] + by[1]), mass.shape), by

    mass, by = jax.vmap(one)(state.mass, place)
    at = state.at._replace(cell=state.at.cell + by[:, 0], node=state.at.node + by[:, 1])
    return _State(mass, jnp.maximum(1.0 - jnp.sum(mass), 0.0), at)
