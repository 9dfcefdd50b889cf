"""Gridding: nearby stations of any number of baselines onto the regular grid of a tile.

Each antenna trace is spread over the cells around it by a Gaussian kernel whose axes follow the station's own
heading: along the track stations are dense, across it they stand a channel pitch apart. The kernel is wide
against its data's spacing, so that the noise of a cell hardly depends on where it lies between the traces;
raw linear interpolation halves the noise at mid-step and draws matches there. Only where stations stand more than
a third of a wavelength apart does the kernel stay narrower: there it would smooth the ground itself away.
"""

from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from lgprjax.radar import air_delay_ns, shift_travel_time
from lgprjax.subsurface.tile import Tile

# In standard deviations of the kernel: where it is cut off, and how near a trace must be to cover a cell.
_REACH = 2.0
_COVERS_ALONG = 1.5
_COVERS_CROSS = 1.0


@dataclass(frozen=True)
class GridSpec:
    """Shape of a tile's grid and of its kernel: static, one compile each.

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
    """Antenna traces near a tile, padded to a fixed number.

    Attributes:
        coefficients: of each trace, as recorded.
        position_m: along and cross in the tile's frame.
        direction: cosine and sine of the station's yaw in the tile's frame.
        above_reference_m: antenna height less the tile's height reference.
        weight: of the trace; 0 where it is padding or invalid.
    """

    coefficients: Float[Array, "trace coefficient"]
    position_m: Float[Array, "trace 2"]
    direction: Float[Array, "trace 2"]
    above_reference_m: Float[Array, " trace"]
    weight: Float[Array, " trace"]


def grid_spec(along_m: float, cross_m: float, *, step_m: float, pitch_m: float, wavelength_m: float) -> GridSpec:
    """Grid of a tile of the given extent; sizes come from a ladder so that few shapes are ever compiled.

    Args:
        along_m, cross_m: extent.
        step_m: spacing of the map's stations.
        pitch_m: spacing of the array's channels.
        wavelength_m: of the centre frequency in nominal soil.
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


@partial(jax.jit, static_argnames="spec")
def grid_traces(
    traces: TraceSet,
    angular_frequency_rad_per_ns: Float[Array, " half"],
    origin_m: Float[Array, "2"],
    *,
    spec: GridSpec,
) -> Tile:
    """Spread traces onto the grid.

    Every trace is first brought to the tile's height reference: one recorded higher above the ground comes
    later by 6.67 ns a metre. A cell is valid where some trace lies within one standard deviation across its
    track (0.6 of the channel pitch) and one and a half along it.

    Args:
        traces: see ``TraceSet``.
        angular_frequency_rad_per_ns: of the coefficients.
        origin_m: along and cross of cell (0, 0).
        spec: the grid.
    """
    levelled = shift_travel_time(
        traces.coefficients, -air_delay_ns(traces.above_reference_m), angular_frequency_rad_per_ns
    )
    cell_m = jnp.asarray([spec.along_cell_m, spec.cross_cell_m], dtype=jnp.float32)
    size = jnp.asarray([spec.along_cells, spec.cross_cells], dtype=jnp.int32)
    reach_m = _REACH * max(spec.along_spread_m, spec.cross_spread_m)
    half = [int(np.ceil(reach_m / c)) for c in (spec.along_cell_m, spec.cross_cell_m)]
    centre = jnp.round((traces.position_m - origin_m[None]) / cell_m[None]).astype(jnp.int32)
    cells = spec.along_cells * spec.cross_cells
    coefficients = levelled.shape[-1]

    def spread(
        carry: tuple[Array, Array], offset: Array
    ) -> tuple[tuple[Float[Array, "cell coefficient_and_weight"], Bool[Array, " cell"]], None]:
        total, covered = carry
        cell = centre + offset[None]
        apart = cell.astype(jnp.float32) * cell_m[None] + origin_m[None] - traces.position_m
        cos, sin = traces.direction[:, 0], traces.direction[:, 1]
        along = (apart[:, 0] * cos + apart[:, 1] * sin) / spec.along_spread_m
        cross = (apart[:, 1] * cos - apart[:, 0] * sin) / spec.cross_spread_m
        near = (jnp.abs(along) <= _REACH) & (jnp.abs(cross) <= _REACH) & (traces.weight > 0.0)
        reached = near & jnp.all((cell >= 0) & (cell < size[None]), axis=-1)
        weight = jnp.where(reached, jnp.exp(-0.5 * (along**2 + cross**2)) * traces.weight, 0.0)
        flat = jnp.where(reached, cell[:, 0] * spec.cross_cells + cell[:, 1], cells)
        rows = jnp.concatenate([levelled, jnp.ones_like(levelled[:, :1])], axis=1) * weight[:, None]
        close = reached & (jnp.abs(along) <= _COVERS_ALONG) & (jnp.abs(cross) <= _COVERS_CROSS)
        return (total.at[flat].add(rows, mode="drop"), covered.at[flat].max(close, mode="drop")), None

    steps = np.stack(
        np.meshgrid(np.arange(-half[0], half[0] + 1), np.arange(-half[1], half[1] + 1), indexing="ij"),
        axis=-1,
    )
    (total, valid), _ = jax.lax.scan(
        spread,
        (jnp.zeros((cells, coefficients + 1), jnp.float32), jnp.zeros(cells, bool)),
        jnp.asarray(steps.reshape(-1, 2), dtype=jnp.int32),
    )
    weight = total[:, -1]
    value = jnp.where(valid[:, None], total[:, :-1] / jnp.maximum(weight, 1e-6)[:, None], 0.0)
    shape = (spec.along_cells, spec.cross_cells)
    return Tile(
        coefficients=value.reshape(*shape, coefficients),
        power=jnp.sum(value**2, axis=-1).reshape(shape),
        valid=valid.reshape(shape),
        origin_m=origin_m.astype(jnp.float32),
        cell_m=cell_m,
    )
