"""Coarse search over prior errors: one surface a scan, a window as a difference of running sums.

Over a short stretch the prior's error is the same for all scans, because odometry and heading are accurate there. On a
lattice of prior errors (forward and left) every scan gives one surface of products with the map; the surface of a
window of any length is the sum over its scans and costs one subtraction of running sums.
"""

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from lgprjax.radar import air_delay_ns, shift_travel_time
from lgprjax.registration.score import OFF_MAP_SCORE
from lgprjax.registration.template_bank import ArrayColumns


def _each(one: Callable[[Any], Any], batch: Any, count: int | Int[Array, ""] | None) -> Any:
    """The first ``count`` elements of a batch, all of them without a count; zeros for the others, which fill a
    compiled shape.

    One by one where an element's numbers are to stay in a core's caches, and the others cost nothing; all at once on an
    accelerator, which a single element does not fill.
    """
    size = len(jax.tree.leaves(batch)[0])
    if jax.default_backend() != "cpu":
        asked = jnp.arange(size) < (size if count is None else count)

        def where_asked(part: Array) -> Array:
            return jnp.where(asked.reshape(-1, *(1,) * (part.ndim - 1)), part, jnp.zeros((), part.dtype))

        return jax.tree.map(where_asked, jax.vmap(one)(batch))
    # Traced once, here and in the loop.
    one = jax.jit(one)
    shapes = jax.eval_shape(one, jax.tree.map(lambda field: field[0], batch))
    blank = jax.tree.map(lambda shape: jnp.zeros((size, *shape.shape), shape.dtype), shapes)

    def step(at: Int[Array, ""], made: Any) -> Any:
        now = one(jax.tree.map(lambda field: jax.lax.dynamic_index_in_dim(field, at, keepdims=False), batch))
        return jax.tree.map(lambda whole, part: whole.at[at].set(part), made, now)

    return jax.lax.fori_loop(0, size if count is None else count, step, blank)


class ScanBatch(NamedTuple):
    """Scans that share one template key.

    Attributes:
        coefficients: coefficients of each trace.
        valid: mask of channels with data.
        above_m: prior height of each antenna above the tile's reference.
        at_m: along and cross, in the tile's frame, of the array's centre at the lattice's first point.
    """

    coefficients: Float[Array | np.ndarray, "scan channel coefficient"]
    valid: Bool[Array | np.ndarray, "scan channel"]
    above_m: Float[Array | np.ndarray, "scan channel"]
    at_m: Float[Array | np.ndarray, "scan 2"]


@partial(jax.jit, static_argnames=("points", "box"))
def scan_surfaces(
    columns: ArrayColumns,
    components: Float[Array, "coefficient component"],
    scans: ScanBatch,
    axes_m: Float[Array, "2 2"],
    decoys_m: Float[Array, "decoy 2"],
    heights_m: Float[Array, " height"],
    angular_frequency_rad_per_ns: Float[Array, " half"],
    *,
    points: tuple[int, int],
    box: tuple[int, int] | None = None,
    count: int | Int[Array, ""] | None = None,
) -> tuple[Float[Array, "scan plane forward left"], Float[Array, "scan plane decoy"], Float[Array, " scan"]]:
    """Surface of each scan over the lattice of prior errors, its values at decoys, and the power of the scan.

    Planes of a surface: a product for each height, the power of the ground, and the share of the channels over it.

    Args:
        columns, components: template bank of the tile, and its basis directions.
        scans: scans of the batch.
        axes_m: along and cross of one step of the lattice forward, and of one to the left.
        decoys_m: along and cross of places beyond the lattice, from its first point: scores there are due to chance.
        heights_m: offsets added to the prior's height.
        angular_frequency_rad_per_ns: angular frequencies of the coefficients.
        points: lattice points, forward and left.
        box: places along and across that contain the lattice at any rotation, if these are few: each scan is then
            multiplied with its own places only. Without it all scans are multiplied with all places at once.
        count: number of scans to compute, the first ones; ``None``: all.
    """
    scan_count = len(scans.at_m)
    live = jnp.where(scans.valid[..., None], scans.coefficients, 0.0)
    raised = jnp.asarray(scans.above_m)[:, None, :] + heights_m[None, :, None]
    level = shift_travel_time(
        jnp.broadcast_to(live[:, None], (*raised.shape, live.shape[-1])),
        -air_delay_ns(raised),
        angular_frequency_rad_per_ns,
    )
    along, cross, size = columns.value.shape
    power = jnp.sum(live**2, axis=(1, 2))
    loud = jnp.sqrt(power)
    quiet = jax.lax.rsqrt(jnp.where(loud > 0.0, loud, 1.0))
    rows = (level @ components).reshape(scan_count, len(heights_m), size) * quiet[:, None, None]
    value = columns.value.reshape(along * cross, size)
    ground = jnp.stack([columns.power.reshape(-1), columns.overlap.reshape(-1)])
    limit = jnp.asarray([along, cross], jnp.int32)
    held = (along, cross) if box is None else box
    own = rows if box is not None else (rows.reshape(-1, size) @ value.T).reshape(scan_count, len(heights_m), -1)
    forward, left = (jnp.arange(count, dtype=jnp.float32) for count in points)
    lattice_m = forward[:, None, None] * axes_m[0][None, None] + left[None, :, None] * axes_m[1][None, None]
    lowest_m = jnp.min(lattice_m, axis=(0, 1))

    def one(scan: tuple[Array, Array]) -> tuple[Array, Array]:
        traces, at_m = scan
        place = (at_m[None] + decoys_m - columns.origin_m[None]) / columns.step_m[None]
        near = jnp.round(place).astype(jnp.int32)
        there = jnp.all((near >= 0) & (near < limit[None]), axis=-1)
        near = jnp.clip(near, 0, limit[None] - 1)
        apart = near[:, 0] * cross + near[:, 1]
        if box is None:
            first = jnp.zeros(2, jnp.int32)
            planes = jnp.concatenate([traces, ground])
            decoy = jnp.stack([_taken(plane, apart) for plane in planes])
        else:
            first = jnp.floor((at_m + lowest_m - columns.origin_m) / columns.step_m).astype(jnp.int32)
            first = jnp.clip(first, 0, limit - jnp.asarray(box, jnp.int32))
            around = jax.lax.dynamic_slice(columns.value, (first[0], first[1], 0), (*box, size)).reshape(-1, size)
            below = jax.lax.dynamic_slice(ground.reshape(2, along, cross), (0, first[0], first[1]), (2, *box))
            planes = jnp.concatenate([traces @ around.T, below.reshape(2, -1)])
            decoy = jnp.concatenate([traces @ value[apart].T, ground[:, apart]])
        cells = (at_m[None, None] + lattice_m - columns.origin_m[None, None]) / columns.step_m[None, None]
        low = jnp.floor(cells)
        part = cells - low
        base = low.astype(jnp.int32)
        inside = jnp.all((base >= 0) & (base + 1 < limit[None, None]), axis=-1)
        base = jnp.clip(base - first[None, None], 0, jnp.asarray(held, jnp.int32)[None, None] - 2)
        flat = base[..., 0] * held[1] + base[..., 1]
        u, v = part[..., 0], part[..., 1]
        corners = ((0, (1 - u) * (1 - v)), (1, (1 - u) * v), (held[1], u * (1 - v)), (held[1] + 1, u * v))
        # Plane by plane: the compiler is fastest here with a gather of single numbers.
        lattice = jnp.stack(
            [
                sum((_taken(plane, flat + step) * weight for step, weight in corners), start=jnp.float32(0.0))
                for plane in planes
            ]
        )
        return _scan_alike(jnp.where(inside[None], lattice, 0.0)), _scan_alike(jnp.where(there[None], decoy, 0.0))

    surfaces, decoys = _each(one, (own, jnp.asarray(scans.at_m)), count)
    return surfaces, decoys, loud


def _taken(plane: Float[Array, " place"], at: Int[Array, "..."]) -> Float[Array, "..."]:
    """Values at indices known to be in bounds: bounds checks take a sixth of the time of a gather."""
    return plane.at[at].get(mode="promise_in_bounds", wrap_negative_indices=False)


def _scan_alike(planes: Float[Array, "plane ..."]) -> Float[Array, "plane ..."]:
    """Products over the fourth root of the ground's power, whose plane is its root then.

    Scans of a window are weighted with the root of their amplitude. Weighted by power, a single strong stone would
    dominate metres of ground, and two stones soon resemble each other; weighted equally, scans of nothing but noise
    would count as much.
    """
    ground = planes[-2]
    there = ground > 1e-9
    level = jnp.where(there, jax.lax.rsqrt(jnp.sqrt(jnp.where(there, ground, 1.0))), 0.0)
    return jnp.concatenate([planes[:-2] * level[None], jnp.sqrt(jnp.where(there, ground, 0.0))[None], planes[-1:]])


NEAR_RIM = 0.8
"""Share of the distance at which places are distinct (half a wavelength): closer to an edge counts as at it."""


class Peaks(NamedTuple):
    """Best and second best place of each window, in lattice points.

    Attributes:
        point: forward and left of the best place.
        height: index of its height.
        score: score of the best place (correlation times the root of the overlap); ``OFF_MAP_SCORE`` if nothing was on
            the map.
        rival: score of the best place apart from it.
        floor: noise floor: root mean square of the score at decoys; 0 if too few of them are on the map.
        region_floor: noise floor over the region far from the best place.
        overlap: largest overlap within the region.
        area: number of lattice points of the region on the map.
        at_rim: whether the score still rises at the region's edge, so that the best place is not a peak.
        open_sides: sides on which the map ends close to the best place: 0 none, 1 left, 2 right, 3 both.
    """

    point: Float[Array | np.ndarray, "*batch 2"]
    height: Int[Array | np.ndarray, "*batch"]
    score: Float[Array | np.ndarray, "*batch"]
    rival: Float[Array | np.ndarray, "*batch"]
    floor: Float[Array | np.ndarray, "*batch"]
    region_floor: Float[Array | np.ndarray, "*batch"]
    overlap: Float[Array | np.ndarray, "*batch"]
    area: Float[Array | np.ndarray, "*batch"]
    at_rim: Bool[Array | np.ndarray, "*batch"]
    open_sides: Int[Array | np.ndarray, "*batch"]


class WindowBatch(NamedTuple):
    """Sums of surfaces over windows of scans, see ``scan_surfaces``, one row of window lengths per end.

    Attributes:
        lattice, decoys: sums over the scans of each window.
        power: summed power of the scans.
        scans: number of scans of each window; 0 for no window.
        centre: lattice point, forward and left, of the prior at that end.
        half_m: half side of the region.
        carried: lattice point of the last accepted place, propagated by odometry.
        carried_m: half side of the region around ``carried``.
    """

    lattice: Float[Array | np.ndarray, "end window plane forward left"]
    decoys: Float[Array | np.ndarray, "end window plane decoy"]
    power: Float[Array | np.ndarray, "end window"]
    scans: Int[Array | np.ndarray, "end window"]
    centre: Float[Array | np.ndarray, "end 2"]
    half_m: Float[Array | np.ndarray, " end"]
    carried: Float[Array | np.ndarray, "end 2"]
    carried_m: Float[Array | np.ndarray, " end"]


@partial(jax.jit, static_argnames="near")
def window_peaks(
    windows: WindowBatch,
    lattice_m: Float[Array, "2"],
    apart_m: Float[Array, ""],
    min_overlap: Float[Array, ""],
    *,
    near: tuple[int, int],
    count: int | Int[Array, ""] | None = None,
) -> tuple[Peaks, Peaks]:
    """Peaks of all windows: in the whole region, and near the carried place.

    Args:
        windows: sums of surfaces over one lattice.
        lattice_m: step of the lattice, forward and left.
        apart_m: places closer than this are the same place.
        min_overlap: least share of a window's channels on the map.
        near: largest size of the region around the carried place, in lattice points forward and left.
        count: number of ends to compute, the first ones; ``None``: all.
    """
    size = windows.lattice.shape[3:]
    near = (min(near[0], size[0]), min(near[1], size[1]))

    def one(end: tuple[Array, ...]) -> tuple[Peaks, Peaks]:
        planes, decoys, live, members, centre, half_m, carried, carried_m = end
        known = members > 0
        scans = jnp.maximum(members, 1).astype(jnp.float32)
        floor = _floor_of(decoys, live, scans, min_overlap)
        peaks = _peaks_of(planes, live, floor, scans, centre, half_m, lattice_m, apart_m, min_overlap)
        corner = jnp.round(carried).astype(jnp.int32) - jnp.asarray(near, jnp.int32) // 2
        corner = jnp.clip(corner, 0, jnp.asarray(size, jnp.int32) - jnp.asarray(near, jnp.int32))
        cut = jax.lax.dynamic_slice(planes, (0, 0, corner[0], corner[1]), (*planes.shape[:2], *near))
        first_m = corner.astype(jnp.float32)
        close = _peaks_of(cut, live, floor, scans, carried - first_m, carried_m, lattice_m, apart_m, min_overlap)
        close = close._replace(point=close.point + first_m[None])
        # The end of the map is not the end of the cut.
        at = jnp.round(close.point).astype(jnp.int32)
        usable = _usable(planes, live, scans, min_overlap)
        close = close._replace(open_sides=_ends_beside(usable, at[:, 0], at[:, 1], lattice_m, apart_m))
        return (
            peaks._replace(score=jnp.where(known, peaks.score, OFF_MAP_SCORE)),
            close._replace(score=jnp.where(known, close.score, OFF_MAP_SCORE)),
        )

    both: tuple[Peaks, Peaks] = _each(one, WindowBatch(*map(jnp.asarray, windows)), count)
    return both


def _peaks_of(
    planes: Float[Array, "window plane forward left"],
    live_power: Float[Array, " window"],
    floor: Float[Array, " window"],
    scans: Float[Array, " window"],
    centre: Float[Array, "2"],
    half_m: Float[Array, ""],
    lattice_m: Float[Array, "2"],
    apart_m: Float[Array, ""],
    min_overlap: Float[Array, ""],
) -> Peaks:
    count, _, forward_size, left_size = planes.shape
    product, ground, overlap = planes[:, :-2], planes[:, -2], planes[:, -1] / scans[:, None, None]
    usable = _usable(planes, live_power, scans, min_overlap)
    level = (
        jax.lax.rsqrt(jnp.where(usable, ground, 1.0))
        * jax.lax.rsqrt(jnp.where(live_power > 0.0, live_power, 1.0))[:, None, None]
    )
    # Live power off the map counts in full, so that this is the correlation times the root of the overlap.
    score = jnp.where(usable, jnp.max(product, axis=1) * level, OFF_MAP_SCORE)
    forward = jnp.arange(forward_size, dtype=jnp.float32)
    left = jnp.arange(left_size, dtype=jnp.float32)
    room = half_m / lattice_m + 0.5
    inside = (jnp.abs(forward - centre[0]) <= room[0])[:, None] & (jnp.abs(left - centre[1]) <= room[1])[None, :]
    within = jnp.where(inside[None], score, OFF_MAP_SCORE)
    around = _highest_neighbour(score)
    window = jnp.arange(count)
    best = _first_highest(within)
    i, j = best // left_size, best % left_size
    top = within[window, i, j]
    row, column = i.astype(jnp.float32), j.astype(jnp.float32)
    beside = _beside(score, i, j)
    from_best = ((forward[None] - row[:, None]) * lattice_m[0])[:, :, None] ** 2
    from_best = from_best + ((left[None] - column[:, None]) * lattice_m[1])[:, None, :] ** 2
    far = from_best >= 4.0 * apart_m**2
    own = far & usable
    number = _total(own.astype(jnp.float32))
    region_floor = jnp.sqrt(_total(jnp.where(own, score**2, 0.0)) / jnp.maximum(number, 1.0))
    away = from_best >= apart_m**2
    rivals = jnp.where(away & (within >= around), within, OFF_MAP_SCORE)
    return Peaks(
        point=jnp.stack([row, column], axis=-1) + beside,
        height=jnp.argmax(product[window, :, i, j], axis=1).astype(jnp.int32),
        score=top,
        rival=_most(rivals),
        floor=floor,
        region_floor=jnp.where(number >= 16.0, region_floor, 0.0),
        overlap=_most(jnp.where(inside[None], overlap, 0.0)),
        area=_total((usable & inside[None]).astype(jnp.float32)),
        at_rim=around[window, i, j] > top,
        open_sides=_ends_beside(usable, i, j, lattice_m, apart_m),
    )


# Over a lattice in two steps: the compiler uses vectors along the rows' other axis only, and would join the steps.


def _total(values: Float[Array, "window forward left"]) -> Float[Array, " window"]:
    return jnp.sum(jax.lax.optimization_barrier(jnp.sum(values, axis=1)), axis=1)


def _most(values: Float[Array, "window forward left"]) -> Float[Array, " window"]:
    return jnp.max(jax.lax.optimization_barrier(jnp.max(values, axis=1)), axis=1)


def _first_highest(values: Float[Array, "window forward left"]) -> Int[Array, " window"]:
    """Number of the highest value, the first of equal ones."""
    size = values.shape[1] * values.shape[2]
    number = jnp.arange(size, dtype=jnp.int32).reshape(values.shape[1:])
    at = jnp.where(values == _most(values)[:, None, None], number[None], size - 1)
    return jnp.min(jax.lax.optimization_barrier(jnp.min(at, axis=1)), axis=1)


def _usable(
    planes: Float[Array, "window plane forward left"],
    live_power: Float[Array, " window"],
    scans: Float[Array, " window"],
    min_overlap: Float[Array, ""],
) -> Bool[Array, "window forward left"]:
    """Mask of places at which enough of a window is on the map."""
    overlap, ground = planes[:, -1] / scans[:, None, None], planes[:, -2]
    return (overlap >= min_overlap) & (ground > 1e-9) & (live_power > 0.0)[:, None, None]


def _ends_beside(
    usable: Bool[Array, "window forward left"],
    i: Int[Array, " window"],
    j: Int[Array, " window"],
    lattice_m: Float[Array, "2"],
    apart_m: Float[Array, ""],
) -> Int[Array, " window"]:
    """``Peaks.open_sides`` of places; what the lattice does not reach is taken to be on the map."""
    reach = jnp.ceil(NEAR_RIM * apart_m / lattice_m[1]).astype(jnp.int32)
    window, last = jnp.arange(len(i)), usable.shape[2] - 1
    left = (j + reach <= last) & ~usable[window, i, jnp.minimum(j + reach, last)]
    right = (j >= reach) & ~usable[window, i, jnp.maximum(j - reach, 0)]
    return left.astype(jnp.int32) + 2 * right.astype(jnp.int32)


def _floor_of(
    planes: Float[Array, "window plane decoy"],
    live_power: Float[Array, " window"],
    scans: Float[Array, " window"],
    min_overlap: Float[Array, ""],
) -> Float[Array, " window"]:
    """Root mean square score at the decoys; 0 if too few of them are on the map."""
    usable = (planes[:, -1] / scans[:, None] >= min_overlap) & (planes[:, -2] > 1e-9) & (live_power > 0.0)[:, None]
    level = jax.lax.rsqrt(jnp.where(usable, planes[:, -2], 1.0))
    level = level * jax.lax.rsqrt(jnp.where(live_power > 0.0, live_power, 1.0))[:, None]
    square = jnp.where(usable, jnp.max(planes[:, :-2], axis=1) * level, 0.0) ** 2
    number = jnp.sum(usable, axis=1, dtype=jnp.float32)
    mean = jnp.sum(square, axis=1) / jnp.maximum(number, 1.0)
    return jnp.where(number >= 12.0, jnp.sqrt(jnp.maximum(mean, 1e-8)), 0.0)


def _beside(
    score: Float[Array, "window forward left"], i: Int[Array, " window"], j: Int[Array, " window"]
) -> Float[Array, "window 2"]:
    """Offset, in points, of the top of a parabola through each place and its neighbours."""
    _, forward, left = score.shape
    window = jnp.arange(len(i))
    here = score[window, i, j]
    inner = (i > 0) & (i < forward - 1) & (j > 0) & (j < left - 1)

    def top(before: Float[Array, " window"], after: Float[Array, " window"]) -> Float[Array, " window"]:
        bend = before + after - 2.0 * here
        good = inner & (bend < -1e-6) & (jnp.minimum(before, after) > OFF_MAP_SCORE)
        return jnp.where(good, jnp.clip(0.5 * (before - after) / jnp.where(good, bend, 1.0), -0.5, 0.5), 0.0)

    i0, i1 = jnp.maximum(i - 1, 0), jnp.minimum(i + 1, forward - 1)
    j0, j1 = jnp.maximum(j - 1, 0), jnp.minimum(j + 1, left - 1)
    ahead = top(score[window, i0, j], score[window, i1, j])
    return jnp.stack([ahead, top(score[window, i, j0], score[window, i, j1])], axis=-1)


def _highest_neighbour(score: Float[Array, "window forward left"]) -> Float[Array, "window forward left"]:
    """Highest score of the eight places around each."""
    forward = score.shape[1]
    padded = jnp.pad(score, [(0, 0), (1, 1), (1, 1)], constant_values=OFF_MAP_SCORE)
    rows = jnp.maximum(padded[:, :, :-2], padded[:, :, 2:])
    corner = jnp.maximum(rows[:, :forward], rows[:, 2:])
    return jnp.maximum(jnp.maximum(corner, rows[:, 1:-1]), jnp.maximum(padded[:, :forward, 1:-1], padded[:, 2:, 1:-1]))
