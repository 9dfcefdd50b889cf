"""Drives along strips, one after the other with the turns between: what patterns and plans for gaps have in common."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from lgprjax.coverage.end_arcs import Pieces, Pose, Turn
from lgprjax.coverage.line_order import Span
from lgprjax.coverage.lines import Line, from_lines
from lgprjax.coverage.pattern_settings import PatternSettings


class Pass(NamedTuple):
    """One drive along a strip, in axes along and across the lines.

    Attributes:
        number: of the strip, from 1.
        across_m: of the tool's centre.
        span_m: of the tool's centre, from where to where the field has ground in the strip.
        forward: along the lines' heading, or against it.
        worked_m: where the tool is on, ascending, within the span.
    """

    number: int
    across_m: float
    span_m: Span
    forward: bool
    worked_m: tuple[Span, ...]

    @property
    def sign(self) -> float:
        """1 forward, -1 against the lines' heading."""
        return 1.0 if self.forward else -1.0

    @property
    def start_m(self) -> float:
        """Along the lines, where the drive begins."""
        return self.span_m[0] if self.forward else self.span_m[1]

    @property
    def end_m(self) -> float:
        """Along the lines, where the drive ends."""
        return self.span_m[1] if self.forward else self.span_m[0]


def reference_pose(drive: Pass, along_m: float, settings: PatternSettings) -> Pose:
    """Pose of the vehicle's reference point, in the lines' axes, when the tool's centre is at a place of a drive."""
    return Pose(
        along_m - drive.sign * settings.tool_ahead_m,
        drive.across_m - drive.sign * settings.tool_left_m,
        0.0 if drive.forward else math.pi,
    )


def lines_of_pass(drive: Pass, heading_rad: float) -> list[Line]:
    """Lines of a drive, in driving direction, east and north."""
    lines = []
    for low, high in drive.worked_m[:: 1 if drive.forward else -1]:
        ends = (low, high) if drive.forward else (high, low)
        start, end = from_lines(np.array([[each, drive.across_m] for each in ends]), heading_rad)
        lines.append(Line(drive.number, start, end))
    return lines


def string_passes(
    drives: Sequence[Pass], joints: Sequence[Pieces], settings: PatternSettings, heading_rad: float
) -> tuple[tuple[Line, ...], tuple[Turn, ...]]:
    """Lines of all drives in driving order, and the turns between them.

    Args:
        drives: in order.
        joints: from the end of each drive to the start of the next one.
        settings: of the pattern.
        heading_rad: of the lines.
    """
    lines: list[Line] = []
    turns: list[Turn] = []
    for number, drive in enumerate(drives):
        spans = drive.worked_m[:: 1 if drive.forward else -1]
        stops = [low if drive.forward else high for low, high in spans]
        ends = [high if drive.forward else low for low, high in spans]
        if number > 0:
            before = drives[number - 1]
            last_m = lines_end_m(before)
            pieces = [_straight(before.end_m - last_m), joints[number - 1], _straight(stops[0] - drive.start_m)]
            turns.append(_turn(before, last_m, np.concatenate(pieces), settings, heading_rad))
        for end, stop in zip(ends[:-1], stops[1:], strict=True):
            turns.append(_turn(drive, end, _straight(stop - end), settings, heading_rad))
        lines += lines_of_pass(drive, heading_rad)
    return tuple(lines), tuple(turns)


def lines_end_m(drive: Pass) -> float:
    """Along the lines, where the tool last goes off."""
    return drive.worked_m[-1][1] if drive.forward else drive.worked_m[0][0]


def trimmed(pieces: Pieces) -> Pieces:
    """Pieces without those of no length, straight ones that follow each other joined."""
    kept: list[list[float]] = []
    for length, curvature in pieces.tolist():
        if length < 1e-9:
            continue
        if kept and curvature == 0.0 and kept[-1][1] == 0.0:
            kept[-1][0] += length
        else:
            kept.append([length, curvature])
    return np.array(kept).reshape(-1, 2)


def _straight(length_m: float) -> Pieces:
    return np.array([[abs(length_m), 0.0]])


def _turn(drive: Pass, along_m: float, pieces: Pieces, settings: PatternSettings, heading_rad: float) -> Turn:
    pose = reference_pose(drive, along_m, settings)
    place = from_lines(np.array([[pose.x_m, pose.y_m]]), heading_rad)[0]
    return Turn(Pose(float(place[0]), float(place[1]), pose.yaw_rad + heading_rad), trimmed(pieces))
