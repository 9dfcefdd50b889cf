"""What every coverage pattern is held against: its ground covered, its turns joined, in the room and off new ground."""

import math

import numpy as np
from matplotlib.path import Path as Outline

from lgprjax.coverage import Field, Pattern, PatternSettings, field_of_polygon
from lgprjax.coverage.field import outside_m, side_distance_m
from lgprjax.coverage.turns import poses_along

FLAIL = PatternSettings(
    tool_width_m=1.2, overlap=0.1, order="zamboni", smallest_radius_m=1.5, turning_room_m=8.0, tool_ahead_m=1.0
)
BOX = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])


def box(along_m: float, across_m: float, yaw_rad: float = 0.0) -> Field:
    cos, sin = math.cos(yaw_rad), math.sin(yaw_rad)
    return field_of_polygon(BOX * [along_m, across_m] @ np.array([[cos, sin], [-sin, cos]]) + [3.0, -5.0], name="box")


def missing_share(pattern: Pattern, step_m: float = 0.1) -> float:
    """Share of a raster of the field that no line's tool passes over, the tool's width taken a millimetre wider."""
    corners = pattern.field.perimeter_m
    low, high = corners.min(axis=0), corners.max(axis=0)
    axes = [np.arange(low[each] + step_m / 3, high[each], step_m) for each in (0, 1)]
    places = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 2)
    places = places[Outline(np.concatenate([corners, corners[:1]])).contains_points(places)]
    left = np.ones(len(places), bool)
    for line in pattern.lines:
        way = (line.end_m - line.start_m) / line.length_m
        along, aside = (places - line.start_m) @ way, (places - line.start_m) @ np.array([-way[1], way[0]])
        half_m = pattern.settings.tool_width_m / 2.0 + 1e-3
        left &= ~((along > -1e-3) & (along < line.length_m + 1e-3) & (np.abs(aside) < half_m))
    return float(left.mean())


def check_turns(pattern: Pattern) -> None:
    """Each turn leads from its line to the next with joining headings, keeps to the room and above the radius."""
    given_settings = pattern.settings
    body = np.array([given_settings.tool_ahead_m, given_settings.tool_left_m])
    for before, turn, after in zip(pattern.lines[:-1], pattern.turns, pattern.lines[1:], strict=True):
        ends = poses_along(turn.start, turn.pieces, np.array([0.0, turn.length_m]))
        for pose, place, line in zip(ends, (before.end_m, after.start_m), (before, after), strict=True):
            cos, sin = math.cos(pose[2]), math.sin(pose[2])
            np.testing.assert_allclose(pose[:2] + np.array([[cos, -sin], [sin, cos]]) @ body, place, atol=1e-6)
            np.testing.assert_allclose([cos, sin], (line.end_m - line.start_m) / line.length_m, atol=1e-6)
        # The tool's way out and in is straight.
        leads_m = max(body[0], 0.0), max(-body[0], 0.0)
        yaw = poses_along(turn.start, turn.pieces, np.array([leads_m[0], turn.length_m - leads_m[1]]))[:, 2]
        np.testing.assert_allclose(yaw, ends[:, 2], atol=1e-9)
        places = poses_along(turn.start, turn.pieces, np.linspace(0.0, turn.length_m, 500))[:, :2]
        assert outside_m(pattern.field.perimeter_m, places).max() <= given_settings.turning_room_m + 1e-3
        assert turn.tightest_radius_m >= given_settings.smallest_radius_m - 1e-6
    assert pattern.tightest_radius_m == min((turn.tightest_radius_m for turn in pattern.turns), default=math.inf)
    lines_m = sum(np.hypot(*(line.end_m - line.start_m)) for line in pattern.lines)
    np.testing.assert_allclose(pattern.line_length_m, lines_m)
    np.testing.assert_allclose(pattern.length_m, lines_m + sum(turn.pieces[:, 0].sum() for turn in pattern.turns))


def check_ground(pattern: Pattern) -> None:
    """No turn leads over ground that no line before it worked, but for the tool's way out and in."""
    corners = pattern.field.perimeter_m
    half_m = pattern.settings.tool_width_m / 2.0 + 0.06
    out_m, in_m = max(pattern.settings.tool_ahead_m, 0.0), max(-pattern.settings.tool_ahead_m, 0.0)
    for number, turn in enumerate(pattern.turns):
        arc_m = np.linspace(out_m, turn.length_m - in_m, 300)[1:-1]
        places = poses_along(turn.start, turn.pieces, arc_m)[:, :2]
        inside = Outline(np.concatenate([corners, corners[:1]])).contains_points(places)
        inside &= side_distance_m(corners, places) > 0.06
        for line in pattern.lines[: number + 1]:
            way = (line.end_m - line.start_m) / line.length_m
            along, aside = (places - line.start_m) @ way, (places - line.start_m) @ np.array([-way[1], way[0]])
            inside &= (np.abs(aside) > half_m) | (along < -0.06) | (along > line.length_m + 0.06)
        assert not inside.any()
