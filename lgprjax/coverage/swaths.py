"""Swaths: parallel lines over a field, their order, and the passes along them."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Literal, NamedTuple

import numpy as np
from jaxtyping import Float

from lgprjax.coverage.field import Field
from lgprjax.coverage.turns import HeadlandTurn, Pieces, Pose
from lgprjax.errors import InputError

# Parallel lines over a field: tool-wide strips, evenly spaced, each cut to the pieces that the field has in it.
#
# The outermost strips are along the field's outermost places, so the tool's edge runs on the perimeter; the rest share
# the width evenly, never further apart than the overlap allows. A piece is as long as the field is anywhere within its
# strip, not along the line alone: at slanting sides the tool works all of the field and some ground outside.

MOST_LINES = 2000
_ROUNDING_M = 1e-6


class Line(NamedTuple):
    """A swath: the path of the tool's centre, in driving direction.

    Attributes:
        number: number of its strip, counted from 1 at the field's first side. Pieces of one strip share it.
        start_m, end_m: east and north of start and end.
    """

    number: int
    start_m: Float[np.ndarray, "2"]
    end_m: Float[np.ndarray, "2"]

    @property
    def length_m(self) -> float:
        """Length from start to end."""
        return float(np.hypot(*(self.end_m - self.start_m)))


class ToolStrip(NamedTuple):
    """A tool-wide strip in axes along and across the lines.

    Attributes:
        across_m: position of its middle across the lines.
        pieces_m: start and end of each piece of the field along the strip, ascending.
    """

    across_m: float
    pieces_m: tuple[tuple[float, float], ...]


class ToolStrips(NamedTuple):
    """The strips of a field.

    Attributes:
        strips: strips from the right of the first line's heading to the left.
        spacing_m: distance between lines; 0 for a single line.
    """

    strips: tuple[ToolStrip, ...]
    spacing_m: float


def lines_heading_rad(field: Field, heading_rad: float | None) -> float:
    """The requested heading, or that of the field's first side."""
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


def lay_strips(
    corners_m: Float[np.ndarray, "corner 2"], tool_width_m: float, overlap: float, *, name: str
) -> ToolStrips:
    """Strips over a polygon.

    Args:
        corners_m: corners along and across the lines.
        tool_width_m, overlap: see ``PatternSettings``.
        name: name of the field or its file, for errors.

    Raises:
        InputError: the field is narrower than the tool, or there are more than ``MOST_LINES`` lines.
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
    strips = tuple(ToolStrip(float(place), strip_pieces(corners_m, float(place), tool_width_m)) for place in places)
    return ToolStrips(strips, (across_m - tool_width_m) / (count - 1) if count > 1 else 0.0)


def strip_pieces(
    corners_m: Float[np.ndarray, "corner 2"], across_m: float, width_m: float
) -> tuple[tuple[float, float], ...]:
    """Pieces of a polygon along a strip, ascending; pieces less than the strip's width apart are merged.

    Args:
        corners_m: corners along and across the strip.
        across_m: position of the strip's middle.
        width_m: width of the strip.
    """
    low_m, high_m = across_m - width_m / 2.0, across_m + width_m / 2.0
    across = corners_m[:, 1]
    levels = [low_m]
    for level in np.unique(np.append(across[(across > low_m) & (across < high_m)], high_m)):
        # Corners that differ only by rounding are on one level.
        if level - levels[-1] > _ROUNDING_M:
            levels.append(float(level))
    starts, ends = corners_m, np.roll(corners_m, -1, axis=0)
    spans: list[tuple[float, float]] = []
    for bottom, top in pairwise(levels):
        # No corner is between two levels: the area there consists of trapezia, whose sides do not cross.
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


# In which order lines are driven, and which lines of a concave field belong together.

Order = Literal["zamboni", "boustrophedon", "racetrack", "free"]
ORDERS: tuple[Order, ...] = ("zamboni", "boustrophedon", "racetrack", "free")
Span = tuple[float, float]


class Piece(NamedTuple):
    """One piece of one strip.

    Attributes:
        strip: number of the strip, from 0.
        span_m: start and end along the strip.
    """

    strip: int
    span_m: Span


def middle_line(count: int) -> int:
    """Number, from 1, of the line that the first is joined to in Zamboni order: the first of the second half.

    Of an odd number of lines the first half has one more, so that the order ends in it and no two neighbours follow
    each other.
    """
    return (count + 1) // 2 + 1


def line_order(count: int, order: Order, apart: int = 1) -> tuple[int, ...]:
    """Numbers of lines, from 0, in driving order.

    Zamboni is 1, m, 2, m + 1, ... with m the middle line (MF section 2), boustrophedon 1, 2, 3, ... The racetrack is
    Zamboni over successive blocks of lines, so that no turn is wider than the vehicle's circle requires.

    Args:
        count: number of lines.
        order: order of the lines, see above.
        apart: for the racetrack, least number of lines that a half turn crosses.
    """
    if order in ("boustrophedon", "free"):
        return tuple(range(count))
    if order == "racetrack":
        blocks = max(1, count // (2 * apart))
        borders = [round(block * count / blocks) for block in range(blocks + 1)]
        return tuple(low + each for low, high in pairwise(borders) for each in line_order(high - low, "zamboni"))
    half = middle_line(count) - 1
    return tuple(number // 2 + (number % 2) * half for number in range(count))


def lines_for_zamboni(radius_m: float, spacing_m: float) -> int:
    """Fewest lines that one-handed turns of a radius can join: (n/2 − 1) w ≥ 2R for n even (MF section 2)."""
    steps = math.ceil(2.0 * radius_m / spacing_m - 1e-9)
    return 2 if steps <= 1 else 2 * steps + 1


def chains(strips: Sequence[Sequence[Span]]) -> tuple[tuple[Piece, ...], ...]:
    """Chains of pieces of neighbouring strips that follow each other one by one; a concave field has several chains.

    A chain ends where the field divides or merges. A convex field is one chain.

    Args:
        strips: pieces of each strip, ascending.
    """
    done: list[list[Piece]] = []
    open_chains: dict[Span, list[Piece]] = {}
    for number, pieces in enumerate(strips):
        following: dict[Span, list[Piece]] = {}
        for span in pieces:
            below = [each for each in open_chains if _overlap(each, span)]
            if len(below) == 1 and sum(_overlap(below[0], each) for each in pieces) == 1:
                chain = open_chains[below[0]]
            else:
                chain = []
                done.append(chain)
            chain.append(Piece(number, span))
            following[span] = chain
        open_chains = following
    return tuple(tuple(chain) for chain in done)


def _overlap(one: Span, other: Span) -> bool:
    return one[0] < other[1] and other[0] < one[1]


# Settings of a coverage pattern: tool, overlap, order of the swaths, the vehicle's smallest radius and the turning
# room.


@dataclass(frozen=True)
class PatternSettings:
    """Settings of a coverage pattern.

    Attributes:
        tool_width_m: width of the tool across the line.
        overlap: least share of the tool's width in which neighbouring swaths overlap, from 0 to below 1.
        order: order of the lines: ``zamboni`` alternates between the first and the middle line and moves on (MF section
            2), all turns to one hand; ``boustrophedon`` takes adjacent lines in turn; ``racetrack`` is Zamboni in
            blocks; ``free`` takes the cheapest next, see ``plan_tour``.
        smallest_radius_m: smallest radius of the reference point's circles.
        turning_room_m: largest distance of the reference point beyond the perimeter.
        tool_ahead_m: distance from the reference point to the tool's centre, forward; negative for a tool behind.
        tool_left_m: the same distance to the left.
        heading_rad: heading of the first line, counter-clockwise from east; ``None``: that of the field's first side.

    Raises:
        InputError: a value is not a number or out of range.
    """

    tool_width_m: float
    overlap: float
    order: Literal["zamboni", "boustrophedon", "racetrack", "free"]
    smallest_radius_m: float
    turning_room_m: float
    tool_ahead_m: float
    tool_left_m: float = 0.0
    heading_rad: float | None = None

    def __post_init__(self) -> None:
        if self.order not in ORDERS:
            raise InputError("pattern", "order", ", ".join(ORDERS), str(self.order))
        ranges = (
            ("tool_width_m", "a width above zero", self.tool_width_m > 0.0),
            ("overlap", "a fraction from 0 to below 1", 0.0 <= self.overlap < 1.0),
            ("smallest_radius_m", "a radius above zero", self.smallest_radius_m > 0.0),
            ("turning_room_m", "a distance of 0 or more", self.turning_room_m >= 0.0),
            ("tool_ahead_m", "a number", True),
            ("tool_left_m", "a number", True),
            ("heading_rad", "an angle", True),
        )
        for name, expected, fits in ranges:
            value = getattr(self, name)
            if value is not None and not (fits and math.isfinite(value)):
                raise InputError("pattern", name, expected, f"{value:g}")


class Pass(NamedTuple):
    """One drive along a strip, in axes along and across the lines.

    Attributes:
        number: number of the strip, from 1.
        across_m: position of the tool's centre across the lines.
        span_m: start and end of the tool's centre along the strip, where the field is within the strip.
        forward: whether the drive is along the lines' heading, or against it.
        worked_m: spans with the tool on, ascending.
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
        """Start of the drive along the lines."""
        return self.span_m[0] if self.forward else self.span_m[1]

    @property
    def end_m(self) -> float:
        """End of the drive along the lines."""
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
) -> tuple[tuple[Line, ...], tuple[HeadlandTurn, ...]]:
    """Lines of all drives in driving order, and the turns between them.

    Args:
        drives: drives in order.
        joints: pieces from the end of each drive to the start of the next one.
        settings: settings of the pattern.
        heading_rad: heading of the lines.
    """
    lines: list[Line] = []
    turns: list[HeadlandTurn] = []
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
    """Pieces without those of zero length, with consecutive straight ones joined."""
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


def _turn(drive: Pass, along_m: float, pieces: Pieces, settings: PatternSettings, heading_rad: float) -> HeadlandTurn:
    pose = reference_pose(drive, along_m, settings)
    place = from_lines(np.array([[pose.x_m, pose.y_m]]), heading_rad)[0]
    return HeadlandTurn(Pose(float(place[0]), float(place[1]), pose.yaw_rad + heading_rad), trimmed(pieces))
