"""Gridding: nearby stations of any number of baselines onto the regular grid of a tile.

Each antenna trace is spread over the cells around it by a Gaussian kernel whose axes follow the station's own heading:
along the track stations are dense, across it they are a channel pitch apart. The kernel is wide compared with the
spacing of its data, so that the noise of a cell hardly depends on its position between the traces; raw linear
interpolation halves the noise at mid-step and draws matches there. Only where stations are more than a third of a
wavelength apart does the kernel stay narrower: there it would smooth the ground itself away.

A kernel reaches some twenty cells, a tile has tens of thousands: the weights are a sparse matrix of cells by traces,
built on the host, and the tile is its product with the traces.
"""

from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Float32, Int
from scipy.sparse import csc_array

# The few directions that hold the power of a map's coefficients.


def leading_components(
    coefficients: Float[np.ndarray, "trace coefficient"], share: float
) -> Float[np.ndarray, "coefficient component"]:
    """Fewest leading eigenvectors that hold a share of the power of a map's traces; their number a multiple of 8."""
    value, vector = np.linalg.eigh(coefficients.T.astype(np.float64) @ coefficients)
    held = np.cumsum(value[::-1]) / max(float(np.sum(value)), 1e-30)
    enough = 1 + int(np.searchsorted(held, share))
    count = min(8 * -(-enough // 8), coefficients.shape[1])
    return np.ascontiguousarray(vector[:, ::-1][:, :count]).astype(np.float32)


# A tile: the ground of a map stretch on a regular grid, and its sampling at any place.


class Tile(NamedTuple):
    """Map coefficients on a regular grid in the frame of the tile.

    The frame's x axis (along) follows the route, its y axis (cross) points left. Cell (0, 0) is at ``origin_m``. Cells
    that no baseline came near are masked and hold zeros.

    Attributes:
        coefficients: coefficients of the ground at each cell, at the tile's height reference.
        power: sum of squares of the coefficients of each cell.
        valid: mask of cells that a baseline covers.
        origin_m: along and cross of cell (0, 0).
        cell_m: spacing along and cross.
    """

    coefficients: Float[Array, "along cross coefficient"]
    power: Float[Array, "along cross"]
    valid: Bool[Array, "along cross"]
    origin_m: Float[Array, "2"]
    cell_m: Float[Array, "2"]


def sample_tile(
    tile: Tile, position_m: Float[Array, "*batch 2"]
) -> tuple[Float[Array, "*batch coefficient"], Bool[Array, "*batch"]]:
    """Bilinear sample of the tile; valid only if all four cells are.

    A gather out of range would clamp silently and repeat the tile's edge: only the mask marks missing ground.

    Args:
        position_m: along and cross in the tile's frame.
    """
    plane = (1,) * (position_m.ndim - 1) + (2,)
    cells = (position_m - tile.origin_m.reshape(plane)) / tile.cell_m.reshape(plane)
    low = jnp.floor(cells)
    part = cells - low
    size = jnp.asarray(tile.valid.shape, dtype=jnp.int32).reshape(plane)
    base = low.astype(jnp.int32)
    inside = jnp.all((base >= 0) & (base + 1 < size), axis=-1)
    base = jnp.clip(base, 0, size - 2)
    width = tile.valid.shape[1]
    flat = base[..., 0] * width + base[..., 1]
    rows = tile.coefficients.reshape(-1, tile.coefficients.shape[-1])
    mask = tile.valid.reshape(-1)
    along, cross = part[..., 0], part[..., 1]
    corners = (
        (flat, (1 - along) * (1 - cross)),
        (flat + 1, (1 - along) * cross),
        (flat + width, along * (1 - cross)),
        (flat + width + 1, along * cross),
    )
    value = sum((rows[index] * weight[..., None] for index, weight in corners), start=jnp.float32(0.0))
    covered = inside
    for index, _ in corners:
        covered = covered & mask[index]
    return jnp.where(covered[..., None], value, 0.0), covered


# In standard deviations of the kernel: where it is cut off, and how near a trace must be to cover a cell.
_REACH = 2.0
_COVERS_ALONG = 1.5
_COVERS_CROSS = 1.0
_TOGETHER = 2048
"""Traces whose weights are computed together: their data fit the processor's cache."""
_SLACK = 1e-3
"""Margin of the box around a kernel, in cells, so that rounding does not lose cells at its edge."""


@dataclass(frozen=True)
class GridSpec:
    """Shape of a tile's grid and of its kernel: static; each is compiled once.

    Attributes:
        along_cells, cross_cells: size of the grid.
        along_cell_m, cross_cell_m: spacing.
        along_spread_m, cross_spread_m: the kernel's standard deviations along and across a station's track.
    """

    along_cells: int
    cross_cells: int
    along_cell_m: float
    cross_cell_m: float
    along_spread_m: float
    cross_spread_m: float


class TraceSet(NamedTuple):
    """Antenna traces near a tile, any number of them.

    Attributes:
        coefficients: coefficients of each trace, at the tile's height reference.
        position_m: along and cross in the tile's frame.
        direction: cosine and sine of the station's yaw in the tile's frame.
        weight: weight of the trace; 0 if it is invalid.
    """

    coefficients: Float32[np.ndarray, "trace coefficient"]
    position_m: Float32[np.ndarray, "2 trace"]
    direction: Float32[np.ndarray, "2 trace"]
    weight: Float32[np.ndarray, " trace"]


class _Spread(NamedTuple):
    """Kernels of consecutive traces, cell after cell.

    Attributes:
        cells: number of cells that each trace reaches.
        cell, weight: reached cells and weights of each trace in turn.
        close: whether the trace covers the cell.
    """

    cells: Int[np.ndarray, " trace"]
    cell: Int[np.ndarray, " reached"]
    weight: Float32[np.ndarray, " reached"]
    close: Bool[np.ndarray, " reached"]


def grid_spec(along_m: float, cross_m: float, *, step_m: float, pitch_m: float, wavelength_m: float) -> GridSpec:
    """Grid of a tile of the given extent; sizes come from a ladder so that few shapes are ever compiled.

    Args:
        along_m, cross_m: extent.
        step_m: spacing of the map's stations.
        pitch_m: spacing of the array's channels.
        wavelength_m: wavelength of the centre frequency in nominal soil.
    """
    along_cell_m = min(step_m, wavelength_m / 10.0)
    cross_cell_m = min(pitch_m / 2.0, wavelength_m / 5.0)
    return GridSpec(
        along_cells=_rung(along_m / along_cell_m + 1),
        cross_cells=_rung(cross_m / cross_cell_m + 1),
        along_cell_m=along_cell_m,
        cross_cell_m=cross_cell_m,
        along_spread_m=max(min(0.6 * step_m, 0.2 * wavelength_m), 0.4 * step_m, 0.8 * along_cell_m),
        cross_spread_m=0.6 * pitch_m,
    )


def _rung(cells: float) -> int:
    """The next of 16, 24, 32, ... 128, 160, 192, ...: an eighth to a quarter apart where tiles are large."""
    step = 8 if cells <= 128 else 32
    return max(16, step * -(-int(np.ceil(cells)) // step))


def grid_traces(traces: TraceSet, origin_m: Float[np.ndarray, "2"], *, spec: GridSpec) -> Tile:
    """Spread traces onto the grid.

    A cell is valid if some trace is within one standard deviation across its track (0.6 of the channel pitch) and one
    and a half along it.

    Args:
        traces: see ``TraceSet``.
        origin_m: along and cross of cell (0, 0).
        spec: the grid.
    """
    cells = spec.along_cells * spec.cross_cells
    parts = [_spread(traces, slice(low, low + _TOGETHER), origin_m, spec) for low in _starts(len(traces.weight))]
    count, cell, weight, close = (np.concatenate(field) for field in zip(*parts, strict=True))
    valid = np.zeros(cells, bool)
    valid[cell[close]] = True
    total = np.bincount(cell, weights=weight, minlength=cells)
    # Divided by the cell's total here, which is less work than in the grid itself.
    share = np.where(valid, 1.0 / np.maximum(total, 1e-6), 0.0).astype(np.float32)[cell] * weight
    ends = np.concatenate([[0], np.cumsum(count)]).astype(np.int32)
    value = csc_array((share, cell, ends), shape=(cells, len(count))) @ traces.coefficients
    shape = (spec.along_cells, spec.cross_cells)
    return Tile(
        coefficients=jnp.asarray(value.reshape(*shape, value.shape[1])),
        power=jnp.asarray(np.einsum("ij,ij->i", value, value).reshape(shape)),
        valid=jnp.asarray(valid.reshape(shape)),
        origin_m=jnp.asarray(origin_m, dtype=jnp.float32),
        cell_m=jnp.asarray([spec.along_cell_m, spec.cross_cell_m], dtype=jnp.float32),
    )


def _starts(traces: int) -> range:
    """First traces of the parts that weights are made for; one part where there are no traces."""
    return range(0, max(traces, 1), _TOGETHER)


def _spread(traces: TraceSet, part: slice, origin_m: Float[np.ndarray, "2"], spec: GridSpec) -> _Spread:
    """Kernels of a part of the traces."""
    cell_m = (np.float32(spec.along_cell_m), np.float32(spec.cross_cell_m))
    cells = (spec.along_cells, spec.cross_cells)
    spread_m = (np.float32(spec.along_spread_m), np.float32(spec.cross_spread_m))
    low, high = [], []
    for n in range(2):
        cos, sin = np.abs(traces.direction[n, part]), np.abs(traces.direction[1 - n, part])
        place = (traces.position_m[n, part] - np.float32(origin_m[n])) / cell_m[n]
        reach = (_REACH * spread_m[0] / cell_m[n]) * cos + (_REACH * spread_m[1] / cell_m[n]) * sin + _SLACK
        low.append(np.maximum(np.ceil(place - reach), 0.0))
        high.append(np.minimum(np.floor(place + reach), cells[n] - 1.0))
    used = np.flatnonzero((traces.weight[part] > 0.0) & (low[0] <= high[0]) & (low[1] <= high[1]))
    counts = np.zeros(len(cos), np.int64)
    if not len(used):
        return _Spread(counts, np.zeros(0, np.int32), np.zeros(0, np.float32), np.zeros(0, bool))
    # Traces last, so that every operation runs over many numbers at once.
    first = [low[n][used].astype(np.int32) for n in range(2)]
    last = [high[n][used].astype(np.int32) for n in range(2)]
    size = [int(np.max(last[n] - first[n])) + 1 for n in range(2)]
    index = [first[n] + np.arange(size[n], dtype=np.int32)[:, None] for n in range(2)]
    inside = [index[n] <= last[n] for n in range(2)]
    apart_m = [
        index[n].astype(np.float32) * cell_m[n] - (traces.position_m[n, part] - np.float32(origin_m[n]))[used]
        for n in range(2)
    ]
    cos, sin = (traces.direction[n, part][used] for n in range(2))
    # Along and cross of a turned kernel are sums of what either index gives: two short tables, added.
    along = (apart_m[0] * (cos / spread_m[0]))[:, None] + (apart_m[1] * (sin / spread_m[0]))[None]
    cross = (apart_m[1] * (cos / spread_m[1]))[None] - (apart_m[0] * (sin / spread_m[1]))[:, None]
    np.square(along, out=along)
    np.square(cross, out=cross)
    reached = (along <= _REACH**2) & (cross <= _REACH**2) & inside[0][:, None] & inside[1][None]
    close = (along <= _COVERS_ALONG**2) & (cross <= _COVERS_CROSS**2)
    along += cross
    along *= -0.5
    weight = np.exp(along, out=along)
    weight *= traces.weight[part][used]
    counts[used] = np.count_nonzero(reached, axis=(0, 1))
    offset = np.arange(size[0], dtype=np.int32)[:, None] * cells[1] + np.arange(size[1], dtype=np.int32)
    cell = (first[0] * cells[1] + first[1])[:, None] + offset.reshape(1, -1)
    chosen = np.flatnonzero(_by_trace(reached))
    return _Spread(counts, *(np.take(field, chosen) for field in (cell, _by_trace(weight), _by_trace(close))))


def _by_trace(values: np.ndarray) -> np.ndarray:
    """Numbers by cell of the kernel and trace, rearranged trace after trace."""
    return np.ascontiguousarray(values.reshape(-1, values.shape[-1]).T)


# A tile filtered like a live scan.
#
# From live scans the running mean of the track behind them is removed, from maps that over both sides. The first shifts
# ground of wavelength w forward by about w²/(2 pi² length), so that matches of one with the other are centimetres
# ahead. With the live filter applied to the tile too, in the direction of travel, both are shifted alike.


@partial(jax.jit, static_argnames="direction")
def filter_along(tile: Tile, length_m: Float[Array, ""], *, direction: int) -> Tile:
    """The tile minus the causal running mean along its axis.

    Args:
        tile: tile of a map, filtered to both sides.
        length_m: length of the live filter.
        direction: 1 for travel along the tile's axis, -1 against it.
    """
    # The live filter's mean decays over half its length (radar.run_live_filter).
    forget = 1.0 - jnp.exp(-tile.cell_m[0] / (0.5 * length_m))

    def step(mean: Array, row: tuple[Array, Array]) -> tuple[Array, Array]:
        value, valid = row
        mean = mean + jnp.where(valid[:, None], forget * (value - mean), 0.0)
        return mean, jnp.where(valid[:, None], value - mean, 0.0)

    # The ground before the tile is unknown; the map's own filter has left its mean near zero.
    start = jnp.zeros(tile.coefficients.shape[1:], jnp.float32)
    _, value = jax.lax.scan(step, start, (tile.coefficients, tile.valid), reverse=direction < 0)
    return tile._replace(coefficients=value, power=jnp.sum(value**2, axis=-1))
