"""Parallel lines over a field: tool-wide strips, evenly spaced, each cut to the pieces that the field has in it.

The outermost strips lie along the field's outermost places, so the tool's edge runs on the perimeter; the rest share
the width evenly, never further apart than the overlap allows. A piece is as long as the field is anywhere within its
strip, not along the line alone: at slanting sides the tool works all of the field and some ground beside it.
"""

import math
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from lgprjax.coverage.field import Field
from lgprjax.errors import InputError

MOST_LINES = 2000
_ROUNDING_M = 1e-6


class Line(NamedTuple):
    """A line to be worked: the way of the tool's centre, in driving direction.

    Attributes:
        number: of its strip, counted from 1 at the field's first side. Pieces of one strip share it.
        start_m, end_m: east and north.
    """

    number: int
    start_m: Float[np.ndarray, "2"]
    end_m: Float[np.ndarray, "2"]

    @property
    def length_m(self) -> float:
        """From start to end."""
        return float(np.hypot(*(self.end_m - self.start_m)))


class Strip(NamedTuple):
    """A tool-wide strip in axes along and across the lines.

    Attributes:
        across_m: of its middle.
        pieces_m: from where to where the field has ground in it, ascending.
    """

    across_m: float
    pieces_m: tuple[tuple[float, float], ...]


class Strips(NamedTuple):
    """The strips of a field.

    Attributes:
        strips: from the right of the first line's heading to the left.
        spacing_m: from one line to the next; 0 where there is one only.
    """

    strips: tuple[Strip, ...]
    spacing_m: float


def lines_heading_rad(field: Field, heading_rad: float | None) -> float:
    """The heading asked for, or that of the field's first side."""
    if heading_rad is not None:
        return heading_rad
    east_m, north_m = field.perimeter_m[1] - field.perimeter_m[0]
    return math.atan2(north_m, east_m)


def to_lines(places_m: Float[np.ndarray, "place 2"], heading_rad: float) -> Float[np.ndarray, "place 2"]:
    """Along and across the lines, of places given east and north."""
    cos, sin = math.cos(heading_rad), math.sin(heading_rad)
    return np.asarray(places_m @ np.array([[cos, -sin], [sin, cos]]))


def from_lines(places_m: Float[np.ndarray, "place 2"], heading_rad: float) -> Float[np.ndarray, "place 2"]:
    """East and north, of places given along and across the lines."""
    return to_lines(places_m, -heading_rad)


def line_count(across_m: float, tool_width_m: float, overlap: float) -> int:
    """Fewest lines that work a field of a width with at least an overlap: ⌈(W − t) / ((1 − f) t)⌉ + 1.

    Args:
        across_m: W, at least the tool's width t.
    """
    return math.ceil((across_m - tool_width_m - _ROUNDING_M) / ((1.0 - overlap) * tool_width_m)) + 1


def lay_strips(corners_m: Float[np.ndarray, "corner 2"], tool_width_m: float, overlap: float, *, name: str) -> Strips:
    """Strips over a polygon.

    Args:
        corners_m: along and across the lines.
        tool_width_m, overlap: see ``PatternSettings``.
        name: of the field, or its file, for errors.

    Raises:
        InputError: a field narrower than the tool, or more than ``MOST_LINES`` lines.
    """
    low_m, high_m = float(corners_m[:, 1].min()), float(corners_m[:, 1].max())
    across_m = high_m - low_m
    if across_m < tool_width_m - _ROUNDING_M:
        expected = f"at least the tool's {tool_width_m:.2f} m across the lines"
        raise InputError(name, "field", expected, f"{across_m:.2f} m")
    count = line_count(across_m, tool_width_m, overlap)
    if count > MOST_LINES:
        raise InputError(name, "lines", f"at most {MOST_LINES}", f"{count}")
    half_m = tool_width_m / 2.0
    places = np.linspace(low_m + half_m, high_m - half_m, count) if count > 1 else [(low_m + high_m) / 2.0]
    strips = tuple(Strip(float(place), strip_pieces(corners_m, float(place), tool_width_m)) for place in places)
    return Strips(strips, (across_m - tool_width_m) / (count - 1) if count > 1 else 0.0)


def strip_pieces(
    corners_m: Float[np.ndarray, "corner 2"], across_m: float, width_m: float
) -> tuple[tuple[float, float], ...]:
    """Where along a strip a polygon has ground, ascending; pieces less than the strip's width apart are one.

    Args:
        corners_m: along and across the strip.
        across_m: of its middle.
        width_m: of the strip.
    """
    low_m, high_m = across_m - width_m / 2.0, across_m + width_m / 2.0
    across = corners_m[:, 1]
    levels = [low_m]
    for level in np.unique(np.append(across[(across > low_m) & (across < high_m)], high_m)):
        # Corners that rounding alone sets apart are on one level.
        if level - levels[-1] > _ROUNDING_M:
            levels.append(float(level))
    starts, ends = corners_m, np.roll(corners_m, -1, axis=0)
    spans: list[tuple[float, float]] = []
    for bottom, top in pairwise(levels):
        # No corner lies between two levels: the ground there is trapezia, whose sides do not cross.
        middle = 0.5 * (bottom + top)
        crossed = (starts[:, 1] > middle) != (ends[:, 1] > middle)
        foot, head = starts[crossed], ends[crossed]
        at = np.clip([[bottom], [middle], [top]], np.minimum(foot, head)[:, 1], np.maximum(foot, head)[:, 1])
        along = foot[:, 0] + (at - foot[:, 1]) / (head[:, 1] - foot[:, 1]) * (head[:, 0] - foot[:, 0])
        along = along[:, np.argsort(along[1])]
        spans += zip(along[:, ::2].min(axis=0).tolist(), along[:, 1::2].max(axis=0).tolist(), strict=True)
    return join_spans(spans, width_m)


def join_spans(spans: list[tuple[float, float]], gap_m: float) -> tuple[tuple[float, float], ...]:
    """Intervals in ascending order, those less than a gap apart made one."""
    joined: list[tuple[float, float]] = []
    for low, high in sorted(spans):
        if joined and low - joined[-1][1] < gap_m:
            joined[-1] = (joined[-1][0], max(joined[-1][1], high))
        else:
            joined.append((low, high))
    return tuple(joined)
