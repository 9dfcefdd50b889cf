"""What a record of a worked field says in numbers, and what may be said of the ground by it."""

import math
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from lgprjax.coverage import CellGrid, CellState, Field, inside_cells
from lgprjax.formats.worked_record import FULL, WorkedRecord, stop_words

PAC = 0.95
"""Probability that the sentence about a layer is asked to hold with."""


class LayerFigures(NamedTuple):
    """A layer at one level; areas are those of cells whose centre lies inside the perimeter.

    Attributes:
        level: probability that each processed cell has at least.
        processed_m2, uncertain_m2, not_processed_m2: areas.
        share: processed, of the field.
        mean_miss: mean probability over the processed cells that the best pass missed the cell.
        worked_share: with probability ``PAC`` or more, at least this share of the processed area was worked.
    """

    level: float
    processed_m2: float
    uncertain_m2: float
    not_processed_m2: float
    share: float
    mean_miss: float
    worked_share: float

    @property
    def sentence(self) -> str:
        """What may be said of the layer, if the errors on board were as the filter had them."""
        if self.processed_m2 == 0.0:
            return f"No cell is processed at {100.0 * self.level:g} %."
        return (
            f"Each cell of {square_metres(self.processed_m2)} ({percent(self.share)} of the field) was passed by the "
            f"working tool with probability {100.0 * self.level:g} % or more. With "
            f"probability {100.0 * PAC:g} % or more, at least {percent(self.worked_share)} of that area was."
        )


class CoverFigures(NamedTuple):
    """A record in numbers.

    Attributes:
        area_m2: of the field.
        layers: one a level, rising.
        passes, way_m: how many, and how long together.
        depth_mean_m, depth_least_m: measured while cells counted; ``None`` where none did.
        stops: how many, by reason.
        hours: from the first to the last moment.
        moments: ten a second; fixed: share of them with a fixed GNSS position.
    """

    area_m2: float
    layers: tuple[LayerFigures, ...]
    passes: int
    way_m: float
    depth_mean_m: float | None
    depth_least_m: float | None
    stops: dict[str, int]
    hours: float
    moments: int
    fixed: float

    def as_json(self) -> dict[str, object]:
        """For who computes with them."""
        layers = [{**layer._asdict(), "sentence": layer.sentence} for layer in self.layers]
        return {**self._asdict(), "layers": layers, "pac": PAC}


def cover_figures(record: WorkedRecord) -> CoverFigures:
    """Numbers of a record."""
    cells, channels, passes = record.cells, record.channels, record.passes
    inside = inside_of(record)
    reasons = [stop_words(int(each)) for each in record.stops.reasons]
    known = len(passes.run) > 0
    weight = passes.length_m if known and passes.length_m.sum() > 0.0 else np.ones(len(passes.run))
    return CoverFigures(
        area_m2=Field(record.perimeter_m).area_m2,
        layers=tuple(
            _layer(record, float(level), state[inside], inside)
            for level, state in zip(cells.level, cells.state, strict=True)
        ),
        passes=len(passes.run),
        way_m=float(passes.length_m.sum()),
        depth_mean_m=float(np.average(passes.depth_mean_m, weights=weight)) if known else None,
        depth_least_m=float(passes.depth_least_m.min()) if known else None,
        stops={reason: reasons.count(reason) for reason in sorted(set(reasons))},
        hours=float(channels.time_s.max() - channels.time_s.min()) / 3600.0,
        moments=len(channels.time_s),
        fixed=float(np.mean(channels.gnss_quality == 3)),
    )


def grid_of(record: WorkedRecord) -> CellGrid:
    """The grid that a record's cells are of."""
    cells = record.cells
    return CellGrid(cells.east_m, cells.north_m, cells.cell_m, *cells.probability.shape)


def inside_of(record: WorkedRecord) -> Bool[np.ndarray, "north east"]:
    """Cells whose centre lies inside the perimeter."""
    return inside_cells(Field(record.perimeter_m), grid_of(record))


def square_metres(area_m2: float) -> str:
    """An area, rounded down to a tenth of a square metre."""
    return f"{math.floor(10.0 * area_m2 + 1e-6) / 10.0:.1f} m²"


def percent(share: float) -> str:
    """A share in per cent, rounded down to two decimals: never more than it is."""
    return f"{math.floor(1e4 * share + 1e-9) / 100.0:.2f} %"


def _layer(
    record: WorkedRecord, level: float, state: np.ndarray, inside: Bool[np.ndarray, "north east"]
) -> LayerFigures:
    cell_m2 = record.cells.cell_m**2
    counts = {each: int(np.count_nonzero(state == each)) for each in CellState}
    processed = counts[CellState.PROCESSED]
    miss = _misses(record.cells.probability[inside][state == CellState.PROCESSED])
    mean_miss = float(miss.mean()) if processed else 1.0
    # Markov: however the errors of cells hang together, P(missed share > d) <= E[missed share] / d.
    worked = max(1.0 - mean_miss / (1.0 - PAC), 0.0)
    return LayerFigures(
        level=level,
        processed_m2=processed * cell_m2,
        uncertain_m2=counts[CellState.UNCERTAIN] * cell_m2,
        not_processed_m2=counts[CellState.NOT_PROCESSED] * cell_m2,
        share=processed / max(len(state), 1),
        mean_miss=mean_miss,
        worked_share=worked,
    )


def _misses(numbers: np.ndarray) -> Float[np.ndarray, " cell"]:
    return np.asarray(1.0 - numbers.astype(np.float64) / FULL)
