"""Positions in a side file of a line, and the place of each trace from them."""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np
from jaxtyping import Bool, Float

PositionKind = Literal["local metres", "grid metres", "degrees", "along metres"]
HeightReference = Literal["ellipsoid", "sea level", "unstated"]

_ROWS_MISSING, _ROWS_OVER = 0.02, 0.1
"""Shares of a line's traces that a table may lack (it is then extrapolated) or have in excess."""


@dataclass(frozen=True)
class SidePositions:
    """Rows of a side file, in the order of the traces.

    Attributes:
        path: path of the file.
        kind: ``degrees`` (x longitude, y latitude), ``grid metres`` (x easting, y northing of an unnamed grid),
            ``local metres`` (x easting, y northing of the site's own grid) or ``along metres`` (x distance along the
            line, y zero).
        trace: index of each row's trace, from 0, rising.
        numbered: whether the file states the traces of its rows. Otherwise ``trace`` counts the rows, which belong to
            the traces only if their numbers are about equal.
        x, y: positions.
        z: heights in m; NaN for rows without one.
        height: reference of the heights; ``unstated`` if the file does not say.
        time_s: UTC since midnight of rows measured by a receiver; ``None`` in topography, as the next three.
        quality, satellites, hdop: code of the fix as in NMEA's GGA, satellites in use, horizontal dilution of
            precision; NaN if missing in a row.
        counts: rows read and left out. Topography: ``rows``. Receivers: ``rows``, ``traces`` (named in
            the file), ``without fix`` and ``repeated`` (rows with the time of the row before: the receiver had
            nothing new); of NMEA also ``sentences``, ``failed checksum`` and ``cut``; and implausible ones by reason.
    """

    path: Path
    kind: PositionKind
    trace: Float[np.ndarray, " row"]
    numbered: bool
    x: Float[np.ndarray, " row"]
    y: Float[np.ndarray, " row"]
    z: Float[np.ndarray, " row"]
    height: HeightReference
    time_s: Float[np.ndarray, " row"] | None
    quality: Float[np.ndarray, " row"] | None
    satellites: Float[np.ndarray, " row"] | None
    hdop: Float[np.ndarray, " row"] | None
    counts: dict[str, int]


# A site's own grid does not extend this far from its origin; coordinates of a national grid do.
_SITE_M = 10_000.0


def metres_kind(x: Float[np.ndarray, " row"], y: Float[np.ndarray, " row"]) -> Literal["local metres", "grid metres"]:
    """Whether metres count from a site's own origin or from that of a grid."""
    return "grid metres" if any(np.median(np.abs(values)) > _SITE_M for values in (x, y)) else "local metres"


def about_as_many(rows: int, traces: int, *, cut: bool) -> bool:
    """Whether unnumbered rows belong to the traces one by one; of a truncated line there may be any number more."""
    off = rows - traces
    return rows > 1 and -max(2, _ROWS_MISSING * traces) <= off and (cut or off <= max(2, _ROWS_OVER * traces))


class TracePlaces(NamedTuple):
    """Position of each trace; NaN before the first and after the last measured one.

    Attributes:
        x, y, z: as in ``SidePositions``.
        measured: whether the trace has its own row with a new position; the others are interpolated.
    """

    x: Float[np.ndarray, " trace"]
    y: Float[np.ndarray, " trace"]
    z: Float[np.ndarray, " trace"]
    measured: Bool[np.ndarray, " trace"]


def places_of_traces(positions: SidePositions, traces: int) -> TracePlaces:
    """Places of a number of traces, linear between the measured ones.

    Rows that repeat the time of the previous row are not measurements: the vehicle moved on without a new fix.
    """
    use = positions.trace < traces
    if positions.time_s is not None:
        use &= np.concatenate([[True], np.diff(positions.time_s) != 0])
    at, index = positions.trace[use], np.arange(traces, dtype=np.float64)
    # Degrees are interpolated the short way across the date line.
    turns = positions.kind == "degrees"
    x = _between(index, at, np.unwrap(positions.x[use], period=360.0) if turns else positions.x[use])
    x = (x + 180.0) % 360.0 - 180.0 if turns else x
    y, z = (_between(index, at, values[use]) for values in (positions.y, positions.z))
    return TracePlaces(x, y, z, np.isin(index, at))


def _between(
    index: Float[np.ndarray, " trace"], at: Float[np.ndarray, " row"], values: Float[np.ndarray, " row"]
) -> Float[np.ndarray, " trace"]:
    known = ~np.isnan(values)
    if not known.any():
        return np.full(len(index), np.nan)
    places: Float[np.ndarray, " trace"] = np.interp(index, at[known], values[known], left=np.nan, right=np.nan)
    return places
