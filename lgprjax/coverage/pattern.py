"""A coverage pattern: parallel lines over a field in driving order, and the turns that join them."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from lgprjax.coverage.end_arcs import Pieces, Turn
from lgprjax.coverage.field import Field
from lgprjax.coverage.line_order import Piece, chains, line_order, lines_for_zamboni
from lgprjax.coverage.lines import Line, Strips, lay_strips, lines_heading_rad, to_lines
from lgprjax.coverage.passes import Pass, reference_pose, string_passes
from lgprjax.coverage.pattern_settings import PatternSettings
from lgprjax.coverage.polygon import outside_m
from lgprjax.coverage.turn_search import TurnFound, find_turn
from lgprjax.errors import InputError

LONGEST_M = 30_000.0
"""Longest way: float32 arc lengths still resolve 2 mm at its end."""
_ROUNDING_M = 1e-6


@dataclass(frozen=True, eq=False)
class Pattern:
    """A pattern over a field.

    Attributes:
        field, settings: what it was made for.
        lines: in driving order.
        turns: between them, of the vehicle's reference point; one fewer than lines.
        spacing_m: from one line to the next, 0 where there is one only; of a plan for gaps the most that it may be.
        length_m: of the whole way.
        line_length_m: of the lines alone.
        tightest_radius_m: of the turns; infinite where none is.
        unreached: lines of a plan for gaps that no turn leads to.
    """

    field: Field
    settings: PatternSettings
    lines: tuple[Line, ...]
    turns: tuple[Turn, ...]
    spacing_m: float
    length_m: float
    line_length_m: float
    tightest_radius_m: float
    unreached: tuple[Line, ...] = ()


def plan_pattern(field: Field, settings: PatternSettings, *, name: str) -> Pattern:
    """Lines over the whole of a field, in the order asked for, joined by turns that the vehicle can drive.

    A concave field falls into parts, each driven in that order; the nearest part comes next.

    Args:
        field: to be covered.
        settings: of the pattern.
        name: of the field, or its file, for errors.

    Raises:
        InputError: a field narrower than the tool, too many lines or too long a way, lines too close for one-handed
            turns, or a turn that does not fit into the room; it says what would do.
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
    turns: tuple[Turn, ...],
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
    return Pattern(field, settings, lines, turns, spacing_m, length_m, line_length_m, tightest_m, unreached)


def _check_length(length_m: float, name: str) -> None:
    if length_m > LONGEST_M:
        expected = f"a way of at most {LONGEST_M / 1e3:g} km: parts of the field"
        raise InputError(name, "pattern", expected, f"{length_m / 1e3:.1f} km")


def check_ends(
    corners_m: Float[np.ndarray, "corner 2"], drives: Sequence[Pass], settings: PatternSettings, name: str
) -> None:
    """Refuse a way that begins or ends further from the field than the vehicle may go.

    Raises:
        InputError: too little turning room for the tool's distance.
    """
    first, last = drives[0], drives[-1]
    poses = reference_pose(first, first.start_m, settings), reference_pose(last, last.end_m, settings)
    needed_m = float(outside_m(corners_m, np.array([pose[:2] for pose in poses])).max())
    if needed_m > settings.turning_room_m + _ROUNDING_M:
        raise _no_room(name, "first and last line", needed_m, settings)


def _drives(
    part: Sequence[Piece], strips: Strips, settings: PatternSettings, *, mirrored: bool, forward: bool
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
        for number, place in enumerate(line_order(len(pieces), settings.order))
    ]


def _join_part(
    corners_m: Float[np.ndarray, "corner 2"],
    drives: Sequence[Pass],
    driven: Sequence[Pass],
    strips: Strips,
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
    strips: Strips,
    settings: PatternSettings,
    name: str,
) -> tuple[Pieces, list[Pass], tuple[Piece, ...]]:
    """The shortest way on to a part not yet driven, by either of its outer lines in either direction."""
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


def _check_zamboni(drives: Sequence[Pass], strips: Strips, settings: PatternSettings, name: str) -> None:
    if len(drives) < 2:
        return
    poses = [reference_pose(drive, drive.start_m, settings) for drive in drives]
    apart_m = np.abs(np.diff([pose.y_m for pose in poses]))
    radius_m = settings.smallest_radius_m
    if apart_m.min() >= 2.0 * radius_m - _ROUNDING_M:
        return
    # A tool beside the reference point brings the ways of the two directions nearer to each other, or further apart.
    aside_m = 0.5 * (float(apart_m[0]) - abs(drives[1].across_m - drives[0].across_m))
    needed = lines_for_zamboni(radius_m - aside_m, strips.spacing_m)
    expected = f"at least {needed} lines {strips.spacing_m:.2f} m apart for one-handed turns of {radius_m:g} m"
    found = f"{len(drives)}, turns of {0.5 * apart_m.min():.2f} m: boustrophedon may do"
    raise InputError(name, "zamboni", expected, found)


def _refusal(found: TurnFound, before: Pass, after: Pass, settings: PatternSettings, name: str) -> InputError:
    place = f"turn from line {before.number} to line {after.number}"
    if math.isinf(found.room_m):
        radius_m = settings.smallest_radius_m
        expected = f"one of {radius_m:g} m that stays off ground not yet worked: another heading or order may do"
        return InputError(name, place, expected, "none")
    return _no_room(name, place, found.room_m, settings)


def _no_room(name: str, place: str, needed_m: float, settings: PatternSettings) -> InputError:
    expected = f"at least {math.ceil(100.0 * needed_m - 1e-4) / 100.0:.2f} m of turning room"
    return InputError(name, place, expected, f"{settings.turning_room_m:.2f} m")
