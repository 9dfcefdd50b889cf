"""Positions that lie in a file beside a line, and a place for each trace of the line from them."""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np
from jaxtyping import Bool, Float

PositionKind = Literal["local metres", "grid metres", "degrees", "along metres"]
HeightReference = Literal["ellipsoid", "sea level", "unstated"]

_ROWS_MISSING, _ROWS_OVER = 0.02, 0.1
"""Shares of a line's traces that a table may lack, and is continued evenly, or have beyond its end."""


@dataclass(frozen=True)
class SidePositions:
    """Rows of a side file, in the order of the traces.

    Attributes:
        path: the file.
        kind: ``degrees`` (x longitude, y latitude), ``grid metres`` (x easting, y northing of a grid that it does
            not name), ``local metres`` (the same of the site's own grid) or ``along metres`` (x distance along the
            line, y zero).
        trace: index of each row's trace, from 0, rising.
        numbered: the file says which traces its rows belong to. Where it does not, ``trace`` counts the rows; they
            are the traces' only if they are about as many.
        x, y: the places.
        z: heights in m; NaN where a row has none.
        height: what they are above; ``unstated`` where the file does not say.
        time_s: UTC since midnight, of rows that a receiver measured; ``None`` in topography, as the next three.
        quality, satellites, hdop: code of the fix as in NMEA's GGA, satellites in use, horizontal dilution of
            precision; NaN where a row does not say.
        counts: what was read and what was left out. Topography: ``rows``. Receivers: ``rows``, ``traces`` (named in
            the file), ``without fix`` and ``repeated`` (rows with the time of the row before: the receiver had
            nothing new); of NMEA also ``sentences``, ``failed checksum`` and ``cut``.
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


def about_as_many(rows: int, traces: int, *, cut: bool) -> bool:
    """Rows that their file does not number are the traces' own: of a line that was cut there may be any number more."""
    off = rows - traces
    return rows > 1 and -max(2, _ROWS_MISSING * traces) <= off and (cut or off <= max(2, _ROWS_OVER * traces))


class TracePlaces(NamedTuple):
    """A place for each trace; NaN before the first and after the last that was measured.

    Attributes:
        x, y, z: as in ``SidePositions``.
        measured: the trace has a row of its own, with a position that is new; the others lie between such rows.
    """

    x: Float[np.ndarray, " trace"]
    y: Float[np.ndarray, " trace"]
    z: Float[np.ndarray, " trace"]
    measured: Bool[np.ndarray, " trace"]


def places_of_traces(positions: SidePositions, traces: int) -> TracePlaces:
    """A place for each of so many traces, linear between those that were measured.

    Rows that repeat the time of the row before are not taken for measurements: the vehicle went on and the receiver
    had nothing new to say.
    """
    use = positions.trace < traces
    if positions.time_s is not None:
        use &= np.concatenate([[True], np.diff(positions.time_s) != 0])
    at, index = positions.trace[use], np.arange(traces, dtype=np.float64)
    # Degrees go the short way across the date line.
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
