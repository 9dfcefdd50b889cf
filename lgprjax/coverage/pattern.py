"""A coverage pattern: parallel lines over a field in driving order, and the turns that join them."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from lgprjax.coverage.field import Field, contains, outside_m, side_distance_m
from lgprjax.coverage.swaths import (
    Line,
    Pass,
    PatternSettings,
    Piece,
    ToolStrips,
    chains,
    lay_strips,
    line_order,
    lines_for_zamboni,
    lines_heading_rad,
    reference_pose,
    string_passes,
    to_lines,
    trimmed,
)
from lgprjax.coverage.turns import HeadlandTurn, Pieces, Pose, dubins_ways, one_handed_turn, poses_along
from lgprjax.errors import InputError

# The turn from one drive to the next that keeps within the turning room and off ground not yet worked.
#
# The tool is past the field's edge before a turn begins, and the vehicle is straight on the next line before its tool
# reaches the edge again: straight pieces lead out and in, at least as long as the tool's distance. Along slanting sides
# of the field they are longer, so that the arc passes outside the ground between and next to the two lines.

_SAMPLE_M = 0.1
_EDGE_M = 0.05
"""Tolerance by which a turn may come inside the perimeter: errors of drawing and driving to corners."""
_ROUNDING_M = 1e-6
_RADII = 6


class TurnFound(NamedTuple):
    """Result of the search for a turn.

    Attributes:
        pieces: pieces of the turn; ``None`` if none fits.
        room_m: distance of the turn beyond the perimeter; if none fits, the least that any turn needs, infinite if
            every turn crosses ground not yet worked.
    """

    pieces: Pieces | None
    room_m: float


def find_turn(
    corners_m: Float[np.ndarray, "corner 2"],
    before: Pass,
    after: Pass,
    driven: Sequence[Pass],
    beside: Sequence[Pass],
    settings: PatternSettings,
    *,
    one_handed: bool,
) -> TurnFound:
    """The first turn that fits: gentle before tight, near the field before far from it.

    Args:
        corners_m: corners of the perimeter, in the lines' axes like all other coordinates.
        before, after: drives between whose end and start the turn leads.
        driven: drives already done, over whose worked ground a turn may lead.
        beside: drives of the same part of the field, whose ends the turn passes.
        settings: settings of the pattern.
        one_handed: whether half turns are to one hand only.
    """
    start = reference_pose(before, before.end_m, settings)
    out_m = max(settings.tool_ahead_m, 0.0)
    in_m = max(-settings.tool_ahead_m, 0.0)
    least_m = math.inf
    for pieces in _candidates(before, after, beside, settings, one_handed):
        room_m = _room_m(corners_m, start, pieces, (out_m, in_m), driven, settings.tool_width_m)
        if room_m <= settings.turning_room_m + _ROUNDING_M:
            return TurnFound(trimmed(pieces), room_m)
        least_m = min(least_m, room_m)
    return TurnFound(None, least_m)


def _candidates(
    before: Pass, after: Pass, beside: Sequence[Pass], settings: PatternSettings, one_handed: bool
) -> Iterator[Pieces]:
    """Turns in the order in which they are wanted, each with its straight pieces out and in."""
    radius_m, sign = settings.smallest_radius_m, before.sign
    start = reference_pose(before, before.end_m, settings)
    end = reference_pose(after, after.start_m, settings)
    out_m, in_m = max(settings.tool_ahead_m, 0.0), max(-settings.tool_ahead_m, 0.0)
    if before.forward == after.forward:
        for more_m in () if one_handed else (0.0, radius_m, 2.0 * radius_m):
            yield from _dubins(start, out_m + more_m, end, in_m + more_m, radius_m)
        return
    apart_m = sign * (end.y_m - start.y_m)
    for level_m in _levels(before, after, beside, settings):
        lead_out_m, lead_in_m = max(out_m, level_m - sign * start.x_m), max(in_m, level_m - sign * end.x_m)
        if abs(apart_m) >= 2.0 * radius_m - _ROUNDING_M:
            common_m = max(sign * start.x_m + lead_out_m, sign * end.x_m + lead_in_m)
            leads_m = common_m - sign * start.x_m, common_m - sign * end.x_m
            for each_m in np.linspace(0.5 * abs(apart_m), min(radius_m, 0.5 * abs(apart_m)), _RADII):
                yield _led(leads_m[0], one_handed_turn(apart_m, float(each_m)), leads_m[1])
        if not one_handed:
            yield from _dubins(start, lead_out_m, end, lead_in_m, radius_m)


def _levels(before: Pass, after: Pass, beside: Sequence[Pass], settings: PatternSettings) -> list[float]:
    """Positions along the drive before at which arcs may begin: at the lines' own ends, beyond the ends of all strips
    between them, and beyond the ends of strips that a bulb touches."""
    levels = [-math.inf]
    low_m, high_m = sorted((before.across_m, after.across_m))
    for reach_m in (0.0, 2.0 * settings.smallest_radius_m + abs(settings.tool_left_m)):
        wide_m = reach_m + 0.5 * settings.tool_width_m
        near = [each for each in (*beside, before, after) if low_m - wide_m <= each.across_m <= high_m + wide_m]
        levels.append(max(before.sign * each.span_m[1 if before.forward else 0] for each in near))
    return list(dict.fromkeys(levels))


def _dubins(start: Pose, out_m: float, end: Pose, in_m: float, radius_m: float) -> Iterator[Pieces]:
    for way in dubins_ways(_moved(start, out_m), _moved(end, -in_m), radius_m):
        yield _led(out_m, way, in_m)


def _led(out_m: float, arcs: Pieces, in_m: float) -> Pieces:
    return np.concatenate([[[out_m, 0.0]], arcs, [[in_m, 0.0]]])


def _moved(pose: Pose, ahead_m: float) -> Pose:
    return Pose(pose.x_m + ahead_m * math.cos(pose.yaw_rad), pose.y_m + ahead_m * math.sin(pose.yaw_rad), pose.yaw_rad)


def _room_m(
    corners_m: Float[np.ndarray, "corner 2"],
    start: Pose,
    pieces: Pieces,
    leads_m: tuple[float, float],
    driven: Sequence[Pass],
    tool_width_m: float,
) -> float:
    """Distance of a turn beyond the perimeter; infinite if it crosses ground not yet worked.

    The straight leads for the tool's position are in the lines' own strips, which is allowed.
    """
    length_m = float(pieces[:, 0].sum())
    arc_m = np.linspace(0.0, length_m, math.ceil(length_m / _SAMPLE_M) + 2)
    places = poses_along(start, pieces, arc_m)[:, :2]
    inside, away_m = contains(corners_m, places), side_distance_m(corners_m, places)
    within = inside & (away_m > _EDGE_M) & (arc_m > leads_m[0]) & (arc_m < length_m - leads_m[1])
    for drive in driven:
        if not within.any():
            break
        x, y = places.T
        beside = np.abs(y - drive.across_m) <= 0.5 * tool_width_m + _EDGE_M
        for low_m, high_m in drive.worked_m:
            within &= ~(beside & (x >= low_m) & (x <= high_m))
    if within.any():
        return math.inf
    return float(np.max(away_m[~inside], initial=0.0))


YAW_RATE_RADPS = 0.2
"""Largest in a turn; SLOW_MPS2: deceleration towards a cusp. Of ``default_carrot``."""
SLOW_MPS2 = 0.2
LONGEST_M = 30_000.0
"""Longest way: float32 arc lengths still resolve 2 mm at its end."""


@dataclass(frozen=True, eq=False)
class Pattern:
    """A pattern over a field.

    Attributes:
        field, settings: field and settings of the pattern.
        lines: lines in driving order.
        turns: turns of the vehicle's reference point between the lines; one fewer than lines.
        spacing_m: distance between lines, 0 for a single line; in a plan for gaps the largest allowed distance.
        length_m: length of the whole way.
        line_length_m: length of the lines alone.
        tightest_radius_m: smallest radius of the turns; infinite without turns.
        unreached: lines of a plan for gaps that no turn reaches.
    """

    field: Field
    settings: PatternSettings
    lines: tuple[Line, ...]
    turns: tuple[HeadlandTurn, ...]
    spacing_m: float
    length_m: float
    line_length_m: float
    tightest_radius_m: float
    unreached: tuple[Line, ...] = ()


def plan_pattern(field: Field, settings: PatternSettings, *, name: str) -> Pattern:
    """Swaths over the whole field, in the requested order, joined by turns that the vehicle can drive.

    A concave field is divided into parts, each driven in that order; the nearest part comes next.

    Args:
        field: field to cover.
        settings: settings of the pattern.
        name: name of the field or its file, for errors.

    Raises:
        InputError: the field is narrower than the tool, there are too many lines or the way is too long, lines are too
            close for one-handed turns, or a turn does not fit into the room; the message states what would suffice.
    """
    heading_rad = lines_heading_rad(field, settings.heading_rad)
    corners_m = to_lines(field.perimeter_m, heading_rad)
    strips = lay_strips(corners_m, settings.tool_width_m, settings.overlap, name=name)
    _check_length(sum(high - low for strip in strips.strips for low, high in strip.pieces_m), name)
    parts = chains([strip.pieces_m for strip in strips.strips])
    drives = _drives(parts[0], strips, settings, mirrored=False, forward=True)
    joints = _join_part(corners_m, drives, [], strips, settings, name)
    remaining = list(parts[1:])
    while remaining:
        joint, following, part = _next_part(corners_m, drives, remaining, strips, settings, name)
        joints += [joint, *_join_part(corners_m, following, drives, strips, settings, name)]
        drives = [*drives, *following]
        remaining.remove(part)
    check_ends(corners_m, drives, settings, name)
    lines, turns = string_passes(drives, joints, settings, heading_rad)
    return pattern_of(field, settings, lines, turns, strips.spacing_m, name=name)


def pattern_of(
    field: Field,
    settings: PatternSettings,
    lines: tuple[Line, ...],
    turns: tuple[HeadlandTurn, ...],
    spacing_m: float,
    *,
    unreached: tuple[Line, ...] = (),
    name: str,
) -> Pattern:
    """A pattern of its parts, with its lengths and its tightest arc.

    Raises:
        InputError: a way longer than ``LONGEST_M``.
    """
    line_length_m = sum(line.length_m for line in lines)
    length_m = line_length_m + sum(turn.length_m for turn in turns)
    _check_length(length_m, name)
    tightest_m = min((turn.tightest_radius_m for turn in turns), default=math.inf)
    return Pattern(
        field=field,
        settings=settings,
        lines=lines,
        turns=turns,
        spacing_m=spacing_m,
        length_m=length_m,
        line_length_m=line_length_m,
        tightest_radius_m=tightest_m,
        unreached=unreached,
    )


def driving_time_s(pattern: Pattern, speed_mps: float) -> float:
    """Driving time of a pattern, with reduced speed in bends and at changes of direction, s.

    Args:
        pattern: planned pattern.
        speed_mps: set speed on straight ways.
    """
    time_s = pattern.line_length_m / speed_mps
    for turn in pattern.turns:
        length, bend = np.abs(turn.pieces).T
        time_s += float(np.sum(length / np.minimum(speed_mps, YAW_RATE_RADPS / np.maximum(bend, 1e-6))))
        signs = np.concatenate([[1.0], np.sign(turn.pieces[:, 0]), [1.0]])
        # Slowing down and speeding up each take as long again as the way at full speed.
        time_s += float(np.count_nonzero(signs[1:] != signs[:-1])) * speed_mps / SLOW_MPS2
    return time_s


def _check_length(length_m: float, name: str) -> None:
    if length_m > LONGEST_M:
        expected = f"a path of at most {LONGEST_M / 1e3:g} km: plan the field in parts"
        raise InputError(name, "pattern", expected, f"{length_m / 1e3:.1f} km")


def check_ends(
    corners_m: Float[np.ndarray, "corner 2"], drives: Sequence[Pass], settings: PatternSettings, name: str
) -> None:
    """Refuse a path that begins or ends further from the field than the vehicle may go.

    Raises:
        InputError: too little turning room for the tool's distance.
    """
    first, last = drives[0], drives[-1]
    poses = reference_pose(first, first.start_m, settings), reference_pose(last, last.end_m, settings)
    needed_m = float(outside_m(corners_m, np.array([pose[:2] for pose in poses])).max())
    if needed_m > settings.turning_room_m + _ROUNDING_M:
        raise _no_room(name, "first and last line", needed_m, settings)


def _drives(
    part: Sequence[Piece], strips: ToolStrips, settings: PatternSettings, *, mirrored: bool, forward: bool
) -> list[Pass]:
    """Drives over a part of the field, from its first strip on or from its last, to and fro."""
    pieces = part[::-1] if mirrored else part
    return [
        Pass(
            pieces[place].strip + 1,
            strips.strips[pieces[place].strip].across_m,
            pieces[place].span_m,
            forward == (number % 2 == 0),
            (pieces[place].span_m,),
        )
        for number, place in enumerate(line_order(len(pieces), settings.order, _lines_apart(strips, settings)))
    ]


def _lines_apart(strips: ToolStrips, settings: PatternSettings) -> int:
    """Across how many lines a half turn of the smallest radius leads."""
    return max(math.ceil(2.0 * settings.smallest_radius_m / max(strips.spacing_m, 1e-3) - 1e-9), 1)


def _join_part(
    corners_m: Float[np.ndarray, "corner 2"],
    drives: Sequence[Pass],
    driven: Sequence[Pass],
    strips: ToolStrips,
    settings: PatternSettings,
    name: str,
) -> list[Pieces]:
    one_handed = settings.order == "zamboni"
    if one_handed:
        _check_zamboni(drives, strips, settings, name)
    joints = []
    for number in range(len(drives) - 1):
        before, after = drives[number], drives[number + 1]
        done = [*driven, *drives[: number + 1]]
        found = find_turn(corners_m, before, after, done, drives, settings, one_handed=one_handed)
        if found.pieces is None:
            raise _refusal(found, before, after, settings, name)
        joints.append(found.pieces)
    return joints


def _next_part(
    corners_m: Float[np.ndarray, "corner 2"],
    drives: Sequence[Pass],
    remaining: Sequence[tuple[Piece, ...]],
    strips: ToolStrips,
    settings: PatternSettings,
    name: str,
) -> tuple[Pieces, list[Pass], tuple[Piece, ...]]:
    """The shortest connection to a part not yet driven, by either of its outer swaths in either direction."""
    best: tuple[float, Pieces, list[Pass], tuple[Piece, ...]] | None = None
    least = TurnFound(None, math.inf)
    nearest = drives[-1]
    for part in remaining:
        for mirrored, forward in ((False, True), (False, False), (True, True), (True, False)):
            following = _drives(part, strips, settings, mirrored=mirrored, forward=forward)
            found = find_turn(corners_m, drives[-1], following[0], drives, following, settings, one_handed=False)
            if found.pieces is None:
                if found.room_m <= least.room_m:
                    least, nearest = found, following[0]
                continue
            length_m = float(found.pieces[:, 0].sum())
            if best is None or length_m < best[0]:
                best = (length_m, found.pieces, following, part)
    if best is None:
        raise _refusal(least, drives[-1], nearest, settings, name)
    return best[1:]


def _check_zamboni(drives: Sequence[Pass], strips: ToolStrips, settings: PatternSettings, name: str) -> None:
    if len(drives) < 2:
        return
    poses = [reference_pose(drive, drive.start_m, settings) for drive in drives]
    apart_m = np.abs(np.diff([pose.y_m for pose in poses]))
    radius_m = settings.smallest_radius_m
    if apart_m.min() >= 2.0 * radius_m - _ROUNDING_M:
        return
    # A tool offset from the reference point moves the paths of the two directions closer together, or further apart.
    aside_m = 0.5 * (float(apart_m[0]) - abs(drives[1].across_m - drives[0].across_m))
    needed = lines_for_zamboni(radius_m - aside_m, strips.spacing_m)
    expected = f"at least {needed} lines {strips.spacing_m:.2f} m apart for one-handed turns of {radius_m:g} m"
    found = f"{len(drives)}, turns of {0.5 * apart_m.min():.2f} m: try boustrophedon"
    raise InputError(name, "zamboni", expected, found)


def _refusal(found: TurnFound, before: Pass, after: Pass, settings: PatternSettings, name: str) -> InputError:
    place = f"turn from line {before.number} to line {after.number}"
    if math.isinf(found.room_m):
        radius_m = settings.smallest_radius_m
        expected = f"a turn of radius {radius_m:g} m clear of unworked ground: try another heading or order"
        return InputError(name, place, expected, "none")
    return _no_room(name, place, found.room_m, settings)


def _no_room(name: str, place: str, needed_m: float, settings: PatternSettings) -> InputError:
    expected = f"at least {math.ceil(100.0 * needed_m - 1e-4) / 100.0:.2f} m of turning room"
    return InputError(name, place, expected, f"{settings.turning_room_m:.2f} m")
