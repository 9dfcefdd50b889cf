"""The turn from one drive to the next that keeps within the turning room and off ground not yet worked.

The tool is past the field's edge before a turn begins, and the vehicle straight on the next line before its tool
reaches the edge again: straight pieces lead out and in, by the tool's distance at least. Where the field's side slants
they are longer, so that the arc passes outside of the ground between the two lines and beside them.
"""

import math
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from lgprjax.coverage.end_arcs import Pieces, Pose, dubins_ways, one_handed_turn, poses_along
from lgprjax.coverage.passes import Pass, reference_pose, trimmed
from lgprjax.coverage.pattern_settings import PatternSettings
from lgprjax.coverage.polygon import contains, side_distance_m

_SAMPLE_M = 0.1
_EDGE_M = 0.05
"""So far inside the perimeter a turn may come: what drawing and driving to corners leaves."""
_ROUNDING_M = 1e-6
_RADII = 6


class TurnFound(NamedTuple):
    """What the search gave.

    Attributes:
        pieces: of the turn; ``None`` where none fits.
        room_m: how far beyond the perimeter it goes; where none fits, what the turn that needs least would need,
            infinite where every turn crosses ground not yet worked.
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
        corners_m: of the perimeter, in the lines' axes like all else.
        before, after: from the end of the one to the start of the other.
        driven: drives done, over whose worked ground a turn may lead.
        beside: drives whose ends the turn passes: of the same part of the field.
        settings: of the pattern.
        one_handed: half turns to one hand only.
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
    """How far out, towards the end of the drive before, arcs may begin: at the lines' own ends, beyond those of all
    strips between them, and beyond those that a bulb touches."""
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
    """How far beyond the perimeter a turn goes; infinite where it crosses ground not yet worked.

    The leads that the tool's place asks for lie in the lines' own strips and are allowed to.
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
