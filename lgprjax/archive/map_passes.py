"""How often each cell of a map's ground was passed, when last, and what lies bare: along the route and across it."""

from datetime import UTC, datetime
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from lgprjax.archive.baseline_weights import moment_of
from lgprjax.archive.map_route import Route
from lgprjax.archive.map_survey import STEP_M, MapSurvey
from lgprjax.formats import MapFile
from lgprjax.subsurface import SpatialIndex

_STATIONS = 256  # read at a time
_REACH = 1.5  # array widths to each side: baselines farther off have a route of their own
_PARTS = 4  # of a cell along the route, each of which a pass must have touched
_DAY_S = 86400.0


class GroundPasses(NamedTuple):
    """Cells of ``STEP_M`` along the route, two channels wide, in the order of the route and from right to left.

    Attributes:
        at_m, across_m: middles of the cells, along the route and to its left.
        passes: baselines that touch every part of a cell with valid channels.
        newest_day: when the newest of them was recorded, days since 1970-01-01 UTC; NaN where no date is known.
        hole: cells well under the array of a drive along the route, without any pass.
    """

    at_m: Float[np.ndarray, " place"]
    across_m: Float[np.ndarray, " cell"]
    passes: Int[np.ndarray, "place cell"]
    newest_day: Float[np.ndarray, "place cell"]
    hole: Bool[np.ndarray, "place cell"]


def ground_passes(source: MapFile, route: Route) -> GroundPasses:
    """Go along every baseline and mark the cells that its antennas touch.

    Memory: a few hundred bytes a metre of route. Stations out of use and dead channels touch nothing.

    Args:
        source: the map.
        route: of it, in steps of ``STEP_M``.

    Raises:
        InputError: a part of the map is damaged.
    """
    description, width_m = source.description, source.description.array_width_m
    cell_m = 2.0 * max(description.channel_pitch_m, description.settings.step_m)
    beside = int(np.ceil(_REACH * width_m / cell_m))
    across_m = cell_m * np.arange(-beside, beside + 1)
    parts = int(np.clip(0.5 * STEP_M / description.settings.step_m, 1, _PARTS))
    # A stretch's last cell may be longer than its ground.
    follows = (np.diff(route.drive) == 0) & (np.diff(route.place) == 1)
    last = np.append(~follows, True)
    days = _days(source)
    passes = np.zeros((len(route.at_m), len(across_m)), np.int64)
    newest = np.full(passes.shape, np.nan)
    for drive, day in enumerate(days):
        touched = np.zeros((len(route.at_m), parts, len(across_m)), bool)
        _touch(touched, source, np.flatnonzero(source.drive == drive), route, cell_m)
        covered = np.where(last[:, None], touched.any(axis=1), touched.all(axis=1))
        passes += covered
        newest = np.where(covered, np.fmax(newest, day), newest)
    under = np.abs(across_m) <= max(0.5 * width_m - cell_m, 0.0)
    return GroundPasses(route.at_m, across_m, passes, newest, under & (passes == 0))


def half_like_m(survey: MapSurvey, pitch_m: float) -> float | None:
    """Distance across at which the ground's signal has lost half of its likeness, noise counted as unlike.

    From the correlation of neighbouring channels, carried on as exp(-d²/(2 l²)). None for a single channel, or where
    neighbours are not like each other at all.
    """
    known = survey.beside[survey.beside > 0.0]
    alike = float(np.median(known)) if known.size else 0.0
    return pitch_m * float(np.sqrt(np.log(2.0) / -np.log(alike))) if 0.0 < alike < 1.0 else None


def _touch(
    touched: Bool[np.ndarray, "place part cell"],
    source: MapFile,
    stations: Int[np.ndarray, " scan"],
    route: Route,
    cell_m: float,
) -> None:
    """Mark what the antennas of some stations touch, each at its nearest place of the route."""
    _, parts, cells = touched.shape
    reach_m = float(np.hypot(0.5 * cells * cell_m, STEP_M))
    index = SpatialIndex(route.pose[:, :2], max(reach_m, 1.0))
    for low in range(0, len(stations), _STATIONS):
        numbers = stations[low : low + _STATIONS]
        read = source.read_stations(numbers)
        antenna_m = (source.pose[numbers, None, :2] + read.antenna_m[..., :2])[read.valid]
        antenna, place = index.near_each(antenna_m, reach_m)
        apart = antenna_m[antenna] - route.pose[place, :2]
        order = np.lexsort((np.sum(apart**2, axis=1), antenna))
        nearest = order[np.unique(antenna[order], return_index=True)[1]]
        apart, place = apart[nearest], place[nearest]
        cos, sin = np.cos(route.pose[place, 2]), np.sin(route.pose[place, 2])
        along, across = cos * apart[:, 0] + sin * apart[:, 1], cos * apart[:, 1] - sin * apart[:, 0]
        part = np.clip(((along / STEP_M + 0.5) * parts).astype(int), 0, parts - 1)
        cell = np.rint(across / cell_m).astype(int) + cells // 2
        inside = (cell >= 0) & (cell < cells)
        touched[place[inside], part[inside], cell[inside]] = True


def _days(source: MapFile) -> list[float]:
    """When each baseline was recorded, days since 1970; NaN where the map does not say."""
    inputs = source.provenance.get("inputs")
    rows = inputs if isinstance(inputs, list) else []
    said = [moment_of(row.get("t0_utc")) if isinstance(row, dict) else None for row in rows]
    said += [None] * (int(source.drive.max()) + 1 - len(said))
    start = datetime(1970, 1, 1, tzinfo=UTC)
    return [float("nan") if moment is None else (moment - start).total_seconds() / _DAY_S for moment in said]
