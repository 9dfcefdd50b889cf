"""Where a survey's lines lie: by tape, by the topography beside them, or by a receiver's positions."""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pyproj
from jaxtyping import Float

from lgprjax.errors import InputError
from lgprjax.formats.profile import Profile
from lgprjax.formats.side_positions import SidePositions, TracePlaces, about_as_many, places_of_traces
from lgprjax.formats.survey_track import Place, utm_projection

_STRAIGHT_M = 0.25
"""Lines that keep to their direction within this are an array's channels; others are driven one by one."""
_PARALLEL_DEG = 3.0
_SMOOTHED_M = 5.0
"""Receivers that stand alone scatter by decimetres from second to second: their places are averaged over this."""
_OTHER_STEP = 0.2
_DEGREE_M = 111_200.0
"""Of latitude: good enough to go on from a line's last place."""
_GEOD = pyproj.Geod(ellps="WGS84")


class Layout(NamedTuple):
    """Where lines lie.

    Attributes:
        source: ``tape``, ``topography``, ``receiver`` or ``header``.
        place: origin of the lines and their direction.
        place_assumed: whether nobody said where on the earth that is.
        left_m: of each line, to the left of the origin.
        along_m: place of each row of its topography along the lines; ``None``: by the header or the neighbours.
        on_earth: latitude and longitude of each line's traces as stored, where each has a place of its own; the
            fields before do not count then.
    """

    source: str
    place: Place
    place_assumed: bool
    left_m: Float[np.ndarray, " line"]
    along_m: list[Float[np.ndarray, " _"]] | None
    on_earth: list[tuple[Float[np.ndarray, " _"], Float[np.ndarray, " _"]]] | None


def lay_out(
    lines: Sequence[Profile],
    beside: Sequence[SidePositions | None],
    right_m: Float[np.ndarray, " line"] | None,
    place: Place,
    utm_zone: str | None,
) -> Layout:
    """Lay out lines by the best that is known of all of them.

    Args:
        lines: of the survey.
        beside: the positions that lie beside each line.
        right_m: of each line to the right of the origin, where a tape says it.
        place: origin and direction that the user gave, or stand-ins.
        utm_zone: of positions in metres of a UTM grid.

    Raises:
        InputError: several lines without any positions, or positions that are none.
    """
    assumed = bool(place.assumed())
    beside = [
        side if side is None or _places_traces(line, side) else None for line, side in zip(lines, beside, strict=True)
    ]
    known = [side for side in beside if side is not None]
    whole = len(known) == len(lines)
    if right_m is not None:
        along = _along_rows(known) if whole and _all_of(known, _SURVEYED) else None
        return Layout("tape", place, assumed, -right_m, along, None)
    if not whole:
        if len(lines) > 1:
            bare = next(line for line, side in zip(lines, beside, strict=True) if side is None)
            expected = "positions beside every line, or --line-spacing-m or --lines-at-m"
            raise InputError(bare.path, "positions", expected, "none")
        return Layout("header", place, assumed, np.zeros(1), None, None)
    if _all_of(known, ("along metres",)) and len(lines) == 1:
        return Layout("topography", place, assumed, np.zeros(1), [known[0].x], None)
    if _all_of(known, ("degrees",)):
        degrees = [_receiver_path(line, side) for line, side in zip(lines, known, strict=True)]
        return Layout("receiver", place, False, np.zeros(len(lines)), None, degrees)
    if not _all_of(known, ("local metres", "grid metres")):
        kinds = ", ".join(sorted({side.kind for side in known}))
        raise InputError(known[0].path, "positions", "one kind beside all lines", kinds)
    if known[0].kind == "grid metres":
        place, known, assumed = (*_on_grid(known, utm_zone), False)
    return _by_topography(lines, known, place, assumed)


def _places_traces(line: Profile, side: SidePositions) -> bool:
    """Fewer points than traces, by their distance along the line, tell heights and not where the traces are."""
    return side.kind != "along metres" or about_as_many(len(side.x), len(line.channels), cut=line.cut is not None)


_SURVEYED = ("local metres", "grid metres", "along metres")


def _all_of(known: Sequence[SidePositions], kinds: tuple[str, ...]) -> bool:
    return all(side.kind in kinds for side in known) and len({side.kind for side in known}) == 1


def _along_rows(known: Sequence[SidePositions]) -> list[Float[np.ndarray, " _"]]:
    """Along the lines only: a tape has said the rest. Grids begin at the first line's first row."""
    if known[0].kind == "along metres":
        return [side.x for side in known]
    origin = np.array([known[0].x[0], known[0].y[0]]) if known[0].kind == "grid metres" else np.zeros(2)
    axis = _axis(known)
    return [(np.stack([side.x, side.y], axis=1) - origin) @ axis for side in known]


def _axis(known: Sequence[SidePositions]) -> Float[np.ndarray, "2"]:
    """Direction of the lines in their grid: that in which the first one's rows run."""
    ways = np.array([[side.x[-1] - side.x[0], side.y[-1] - side.y[0]] for side in known])
    first = ways[0] / max(float(np.hypot(*ways[0])), 1e-9)
    signs = np.where(ways @ first < 0.0, -1.0, 1.0)
    way = (ways * signs[:, None]).sum(axis=0)
    length_m = float(np.hypot(*way))
    if not length_m > 0.0:
        raise InputError(known[0].path, "positions", "a line that moves", "one place")
    return np.asarray(way / length_m)


def _on_grid(known: Sequence[SidePositions], utm_zone: str | None) -> tuple[Place, list[SidePositions]]:
    """The grid's metres from its first row, whose place on the earth and whose x axis's direction the zone says."""
    file = known[0].path
    if utm_zone is None:
        raise InputError(file, "positions", "metres within 10 km of the site's origin, or --utm-zone", "a grid's")
    projection = utm_projection(file, utm_zone)
    x, y = float(known[0].x[0]), float(known[0].y[0])
    longitude, latitude = projection(x, y, inverse=True)
    if not (np.isfinite(longitude) and np.isfinite(latitude) and abs(latitude) <= 90.0):
        raise InputError(file, "positions", f"metres of UTM zone {utm_zone}", f"{x:g}, {y:g}")
    convergence = projection.get_factors(longitude, latitude).meridian_convergence
    moved = [replace(side, x=side.x - x, y=side.y - y) for side in known]
    return Place(latitude, longitude, 90.0 + convergence), moved


def _by_topography(lines: Sequence[Profile], known: Sequence[SidePositions], place: Place, assumed: bool) -> Layout:
    """Lines in a site's metres: straight and parallel ones beside each other, others on their own paths."""
    axis = _axis(known)
    left = np.array([-axis[1], axis[0]])
    rows = [np.stack([side.x, side.y], axis=1) for side in known]
    across = [each @ left for each in rows]
    left_m = np.array([np.median(each) for each in across])
    wide_m = max(float(np.abs(each - middle).max()) for each, middle in zip(across, left_m, strict=True))
    near = np.diff(np.sort(left_m))
    if wide_m <= _STRAIGHT_M and not np.any(near < 0.005):
        turn_deg = float(np.degrees(np.arctan2(axis[0], axis[1]))) - 90.0
        along = [each @ axis for each in rows]
        heading = place._replace(heading_deg=(place.heading_deg + turn_deg) % 360.0)
        return Layout("topography", heading, assumed, left_m, along, None)
    paths = []
    for line, side in zip(lines, known, strict=True):
        found = _of_traces(line, side)
        east, north = _filled(line, found.x, found.y)
        bearing = place.heading_deg - 90.0 + np.degrees(np.arctan2(east, north))
        there = np.full(len(east), place.longitude_deg), np.full(len(east), place.latitude_deg)
        longitude, latitude, _ = _GEOD.fwd(*there, bearing, np.hypot(east, north))
        paths.append((np.asarray(latitude), np.asarray(longitude)))
    return Layout("topography", place, assumed, np.zeros(len(lines)), None, paths)


def _of_traces(line: Profile, side: SidePositions) -> TracePlaces:
    """Places of traces, by rows that are numbered, or are as many."""
    traces = len(line.channels)
    if not side.numbered and not about_as_many(len(side.x), traces, cut=line.cut is not None):
        raise InputError(line.path, "topography", f"a row for each of {traces} traces", f"{len(side.x)} rows")
    return places_of_traces(side, traces)


def _receiver_path(
    line: Profile, side: SidePositions
) -> tuple[Float[np.ndarray, " trace"], Float[np.ndarray, " trace"]]:
    """Latitude and longitude of a line's traces, averaged along it."""
    found = _of_traces(line, side)
    spacing_m = line.spacing_m or 0.0
    half = int(0.5 * _SMOOTHED_M / spacing_m) if spacing_m else 0
    # Before the first fix there is none to unwrap from.
    longitude, known = found.x.copy(), np.isfinite(found.x)
    longitude[known] = np.unwrap(longitude[known], period=360.0)
    metres = np.array([np.cos(np.radians(np.nanmedian(found.y))), 1.0]) * _DEGREE_M
    place_m = np.stack([longitude, found.y], axis=1) * metres
    origin_m = place_m[int(np.argmax(known))]
    east, north = _filled(line, *(place_m - origin_m).T)
    longitude, latitude = (np.stack([east, north], axis=1) + origin_m).T / metres[:, None]
    return _averaged(latitude, half), (_averaged(longitude, half) + 180.0) % 360.0 - 180.0


def _filled(
    line: Profile, east_m: Float[np.ndarray, " trace"], north_m: Float[np.ndarray, " trace"]
) -> tuple[Float[np.ndarray, " trace"], Float[np.ndarray, " trace"]]:
    """Places of all traces: before the first that has one and after the last the line goes straight on.

    Its direction and step are those of all places together; where the header's step is another altogether, that one
    counts: a few fixes of a receiver that has just found itself say little.
    """
    known = np.flatnonzero(np.isfinite(east_m) & np.isfinite(north_m))
    if len(known) < 2:
        raise InputError(line.path, "positions", "at least two of its traces with a place", f"{len(known)}")
    index = np.arange(len(east_m), dtype=np.float64)
    step = np.array([np.polyfit(index[known], values[known], 1)[0] for values in (east_m, north_m)])
    length_m = float(np.hypot(*step))
    if line.spacing_m and length_m > 0.0 and abs(length_m / line.spacing_m - 1.0) > _OTHER_STEP:
        step *= line.spacing_m / length_m
    low, high = known[0], known[-1]
    out = []
    for values, each_m in ((east_m, step[0]), (north_m, step[1])):
        filled = np.where(index < low, values[low] + each_m * (index - low), values)
        out.append(np.where(index > high, values[high] + each_m * (index - high), filled))
    return out[0], out[1]


def _averaged(values: Float[np.ndarray, " trace"], half: int) -> Float[np.ndarray, " trace"]:
    """Local straight-line fits over ``half`` traces to each side: averages that do not pull the ends inwards."""
    if half < 1:
        return values
    out = np.empty_like(values)
    for i in range(len(values)):
        low, high = max(0, i - half), min(len(values), i + half + 1)
        at = np.arange(low, high) - i
        _, middle = np.polyfit(at, values[low:high] - values[i], 1)
        out[i] = values[i] + middle
    return out
