"""Layout of a survey's lines: by tape, by topography files, or by a receiver's positions."""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pyproj
from jaxtyping import Float

from lgprjax.errors import InputError
from lgprjax.formats.line_positions import SidePositions, about_as_many, metres_kind, places_of_traces
from lgprjax.formats.plausible import lengths_disagree
from lgprjax.formats.profile import Profile
from lgprjax.formats.survey_track import SurveyOrigin, check_utm, utm_projection

_STRAIGHT_M = 0.25
"""Lines that keep their direction within this become an array's channels; others are driven one by one."""
_SMOOTHED_M = 5.0
"""Averaging length of stand-alone receivers' positions, which scatter by decimetres from second to second."""
_OTHER_STEP = 0.2
_DEGREE_M = 111_200.0
"""Metres per degree of latitude: accurate enough to extrapolate from a line's last place."""
_ROWS_BEYOND = 0.1
"""Share of a receiver's positions that may follow a line's last trace."""
_GEOD = pyproj.Geod(ellps="WGS84")


class SurveyLine(NamedTuple):
    """A line and its positions, from a file next to it or from its header; ``None`` without any."""

    profile: Profile
    side: SidePositions | None


class SurveyLayout(NamedTuple):
    """Layout of lines.

    Attributes:
        source: ``tape``, ``topography``, ``receiver`` or ``header``.
        place: origin and direction of the lines; not the given one if the positions are geographic.
        place_assumed: whether its geographic position is assumed.
        left_m: position of each line to the left of the origin.
        along_m: position of each row of a line's topography along the lines; ``None``: from the header or the
            neighbours.
        on_earth: latitude and longitude of each line's stored traces, if each trace has its own position; the previous
            fields are then unused.
    """

    source: str
    place: SurveyOrigin
    place_assumed: bool
    left_m: Float[np.ndarray, " line"]
    along_m: list[Float[np.ndarray, " _"]] | None
    on_earth: list[tuple[Float[np.ndarray, " _"], Float[np.ndarray, " _"]]] | None


def lay_out(
    survey: Sequence[SurveyLine],
    right_m: Float[np.ndarray, " line"] | None,
    place: SurveyOrigin,
    utm_zone: str | None,
) -> SurveyLayout:
    """Lay out lines by the best information available for all of them.

    Args:
        survey: lines with their positions.
        right_m: position of each line to the right of the origin, if measured by tape.
        place: origin and direction given by the user, or defaults.
        utm_zone: zone of positions in metres of a UTM grid.

    Raises:
        InputError: there are several lines without any positions, or positions are invalid.
    """
    assumed = bool(place.assumed())
    lines = [line for line, _ in survey]
    placing = [None if side is None or not places_traces(line, side) else side for line, side in survey]
    known = [side for side in placing if side is not None]
    whole = len(known) == len(lines)
    if right_m is not None:
        along = _along_rows(known) if whole and _all_of(known, _SURVEYED) else None
        return SurveyLayout("tape", place, assumed, -right_m, along, None)
    if not whole:
        if len(lines) > 1:
            bare = next(line for line, side in zip(lines, placing, strict=True) if side is None)
            expected = "a position file for every line, or --line-spacing-m or --lines-at-m"
            of_header = bare.metadata.get("coordinates")
            found = "none" if of_header is None else f"none (coordinates: {of_header})"
            raise InputError(bare.path, "positions", expected, found)
        return SurveyLayout("header", place, assumed, np.zeros(1), None, None)
    if _all_of(known, ("along metres",)) and len(lines) == 1:
        return SurveyLayout("topography", place, assumed, np.zeros(1), [known[0].x], None)
    of_headers = all(side.path == line.path for line, side in zip(lines, known, strict=True))
    if _all_of(known, ("degrees",)):
        source = "header" if of_headers else "receiver"
        degrees = [
            (side.y, side.x) if side.path == line.path else _receiver_path(line, side)
            for line, side in zip(lines, known, strict=True)
        ]
        start = SurveyOrigin(float(degrees[0][0][0]), float(degrees[0][1][0]), place.heading_deg)
        return SurveyLayout(source, start, False, np.zeros(len(lines)), None, degrees)
    if not _all_of(known, ("local metres", "grid metres")):
        kinds = ", ".join(sorted({side.kind for side in known}))
        raise InputError(known[0].path, "positions", "one kind of positions for all lines", kinds)
    if known[0].kind == "grid metres":
        place, known, assumed = (*_on_grid(known, utm_zone), False)
    elif of_headers and any(len(np.unique(np.concatenate(values))) == 1 for values in _by_axis(known)):
        expected = "positions across the lines too, or --line-spacing-m or --lines-at-m"
        raise InputError(known[0].path, "coordinates", expected, "positions along the lines only")
    return _by_topography(lines, known, place, assumed, "header" if of_headers else "topography")


def _by_axis(known: Sequence[SidePositions]) -> tuple[list[np.ndarray], list[np.ndarray]]:
    return [side.x for side in known], [side.y for side in known]


def header_positions(line: Profile) -> SidePositions | None:
    """Coordinates in a line's trace headers as positions of its traces; ``None`` if it has none.

    Where they repeat, the receiver was slower than the radar: the traces between are interpolated, and those after its
    last fix continued.
    """
    there = line.coordinates
    if there is None:
        return None
    at = np.flatnonzero(np.concatenate([[True], (np.diff(there.x) != 0.0) | (np.diff(there.y) != 0.0)]))
    turns = there.kind == "degrees"
    given = np.stack([np.unwrap(there.x, period=360.0) if turns else there.x, there.y], axis=1)[at]
    index = np.arange(len(there.x))
    x, y = (np.interp(index, at, values) for values in given.T)
    after = index[at[-1] + 1 :] - at[-1]
    # The antenna was at standstill where a position lasts longer than any before.
    if len(at) > 1 and 0 < len(after) < np.diff(at).max():
        x[at[-1] + 1 :], y[at[-1] + 1 :] = given[-1][:, None] + np.outer(
            (given[-1] - given[-2]) / (at[-1] - at[-2]), after
        )
    return SidePositions(
        path=line.path,
        kind="degrees" if turns else metres_kind(x, y),
        trace=index.astype(np.float64),
        numbered=True,
        x=(x + 180.0) % 360.0 - 180.0 if turns else x,
        y=y,
        z=np.full(len(x), np.nan),
        counts={"rows": len(at)},
    )


def check_fit(line: Profile, side: SidePositions) -> None:
    """Raise ``InputError`` for positions that are not this line's: too few or too many, or beyond its end."""
    traces, cut = len(line.channels), line.cut is not None
    another = f"; move {side.path.name} away if it belongs to another line"
    if side.numbered:
        beyond = int(np.count_nonzero(side.trace >= traces))
        if beyond == len(side.trace) or (beyond > max(2, _ROWS_BEYOND * len(side.trace)) and not cut):
            paused = ", or did the radar pause" if beyond < len(side.trace) else ""
            found = f"{beyond} of {len(side.trace)} positions beyond the end of the line (another line{paused}?)"
            raise InputError(side.path, "traces", f"positions of the {traces} traces of {line.path.name}", found)
        own = side.trace < traces
        if len(np.unique(np.stack([side.x[own], side.y[own]]), axis=1).T) < 2:
            raise InputError(side.path, "positions", "positions along a line", "one position")
        return
    if about_as_many(len(side.x), traces, cut=cut):
        return
    points_m, length_m = float(np.max(side.x)), line.usual_step_m * (traces - 1)
    if side.kind != "along metres" or len(side.x) > traces:
        expected = f"one for each of the {traces} traces of {line.path.name}"
        raise InputError(side.path, "rows", expected, f"{len(side.x)} rows{another}")
    if length_m and not cut and points_m > length_m and lengths_disagree(points_m, length_m):
        expected = f"distances within {length_m:g} m, the length of {line.path.name}"
        raise InputError(side.path, "rows", expected, f"{points_m:g} m{another}")


def places_traces(line: Profile, side: SidePositions) -> bool:
    """Whether a file places the traces: fewer points than traces, by their distance along the line, give heights
    only.
    """
    return side.kind != "along metres" or about_as_many(len(side.x), len(line.channels), cut=line.cut is not None)


_SURVEYED = ("local metres", "grid metres", "along metres")


def _all_of(known: Sequence[SidePositions], kinds: tuple[str, ...]) -> bool:
    return all(side.kind in kinds for side in known) and len({side.kind for side in known}) == 1


def _along_rows(known: Sequence[SidePositions]) -> list[Float[np.ndarray, " _"]]:
    """Places along the lines only: the rest is from the tape. Grids begin at the first line's first row."""
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
        raise InputError(known[0].path, "positions", "positions along a line", "one position")
    return np.asarray(way / length_m)


def _on_grid(known: Sequence[SidePositions], utm_zone: str | None) -> tuple[SurveyOrigin, list[SidePositions]]:
    """The grid's metres from its first row; place on the earth and direction of the x axis follow from the zone."""
    file = known[0].path
    if utm_zone is None:
        spans = ((name, np.concatenate(values)) for name, values in zip("xy", _by_axis(known), strict=True))
        found = ", ".join(f"{name} {values.min():.7g} to {values.max():.7g}" for name, values in spans)
        raise InputError(file, "positions", "metres within 10 km of the site's origin, or --utm-zone", found)
    projection = utm_projection(utm_zone)
    for side in known:
        check_utm(side.path, "positions", side.x, side.y)
    x, y = float(known[0].x[0]), float(known[0].y[0])
    longitude, latitude = projection(x, y, inverse=True)
    convergence = projection.get_factors(longitude, latitude).meridian_convergence
    moved = [replace(side, x=side.x - x, y=side.y - y) for side in known]
    return SurveyOrigin(latitude, longitude, 90.0 + convergence), moved


def _by_topography(
    lines: Sequence[Profile], known: Sequence[SidePositions], place: SurveyOrigin, assumed: bool, source: str
) -> SurveyLayout:
    """Lines in a site's metres: straight and parallel ones side by side, others on their own paths."""
    axis = _axis(known)
    left = np.array([-axis[1], axis[0]])
    rows = [np.stack([side.x, side.y], axis=1) for side in known]
    across = [each @ left for each in rows]
    left_m = np.array([np.median(each) for each in across])
    wide_m = max(float(np.abs(each - middle).max()) for each, middle in zip(across, left_m, strict=True))
    near = np.diff(np.sort(left_m))
    along = [each @ axis for each in rows]
    # A receiver's places may go back and forth: of coordinates in headers only those that do not are an array's.
    steady = source != "header" or all(abs(np.sign(np.diff(each)).sum()) == len(each) - 1 for each in along)
    if wide_m <= _STRAIGHT_M and not np.any(near < 0.005) and steady:
        turn_deg = float(np.degrees(np.arctan2(axis[0], axis[1]))) - 90.0
        heading = place._replace(heading_deg=(place.heading_deg + turn_deg) % 360.0)
        return SurveyLayout(source, heading, assumed, left_m, along, None)
    paths = []
    for line, side in zip(lines, known, strict=True):
        found = places_of_traces(side, len(line.channels))
        east, north = _filled(line, found.x, found.y)
        bearing = place.heading_deg - 90.0 + np.degrees(np.arctan2(east, north))
        there = np.full(len(east), place.longitude_deg), np.full(len(east), place.latitude_deg)
        longitude, latitude, _ = _GEOD.fwd(*there, bearing, np.hypot(east, north))
        paths.append((np.asarray(latitude), np.asarray(longitude)))
    return SurveyLayout(source, place, assumed, np.zeros(len(lines)), None, paths)


def _receiver_path(
    line: Profile, side: SidePositions
) -> tuple[Float[np.ndarray, " trace"], Float[np.ndarray, " trace"]]:
    """Latitude and longitude of a line's traces, averaged along it."""
    found = places_of_traces(side, len(line.channels))
    spacing_m = line.usual_step_m
    half = int(0.5 * _SMOOTHED_M / spacing_m) if spacing_m else 0
    # Before the first fix there is no value to unwrap from.
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
    """Places of all traces: before the first and after the last with a place the line is continued straight.

    Its direction and step are those of all places together; if the header's step is entirely different, that one is
    used: the first few fixes of a receiver are unreliable.
    """
    known = np.flatnonzero(np.isfinite(east_m) & np.isfinite(north_m))
    if len(known) < 2:
        raise InputError(line.path, "positions", "at least two traces with a position", f"{len(known)}")
    index = np.arange(len(east_m), dtype=np.float64)
    step = np.array([np.polyfit(index[known], values[known], 1)[0] for values in (east_m, north_m)])
    length_m = float(np.hypot(*step))
    usual_m = line.usual_step_m
    if usual_m and length_m > 0.0 and abs(length_m / usual_m - 1.0) > _OTHER_STEP:
        step *= usual_m / length_m
    low, high = known[0], known[-1]
    out = []
    for values, each_m in ((east_m, step[0]), (north_m, step[1])):
        filled = np.where(index < low, values[low] + each_m * (index - low), values)
        out.append(np.where(index > high, values[high] + each_m * (index - high), filled))
    return out[0], out[1]


def _averaged(values: Float[np.ndarray, " trace"], half: int) -> Float[np.ndarray, " trace"]:
    """Local straight-line fits over ``half`` traces to each side: averages that do not pull the ends inward."""
    if half < 1:
        return values
    out = np.empty_like(values)
    for i in range(len(values)):
        low, high = max(0, i - half), min(len(values), i + half + 1)
        at = np.arange(low, high) - i
        _, middle = np.polyfit(at, values[low:high] - values[i], 1)
        out[i] = values[i] + middle
    return out
