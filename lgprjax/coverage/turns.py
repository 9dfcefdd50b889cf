"""Headland turns from one swath to the next: straight pieces and arcs, or Dubins paths.

Headings join; the curvature jumps where an arc begins, as a skid-steer vehicle can drive it. Dubins (1957): the
shortest way between two poses with circles of one radius has at most three pieces, arc-straight-arc or three arcs.
Between lines closer than the circle is wide it is a bulb of three arcs.
"""

import math
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

Pieces = Float[np.ndarray, "_ 2"]
"""Length, metres, and curvature, positive to the left, of straight pieces and arcs that follow each other.

A negative length is driven in reverse: the yaw changes by length times curvature all the same.
"""
_NO_TURN_RAD = 1e-9
_NO_WAY = 1e-9
_NO_SQUARE = 1e-12
"""Rounding error of the square of a straight of length zero, in squares of the radius, at a distance of one radius."""
_HANDS = np.array([(1, 0, 1), (-1, 0, -1), (1, 0, -1), (-1, 0, 1), (-1, 1, -1), (1, -1, 1)], float)
"""Direction of the pieces of Dubins' words: 1 left, -1 right, 0 straight."""


class Pose(NamedTuple):
    """A pose on the host.

    Attributes:
        x_m, y_m: place.
        yaw_rad: counter-clockwise from x.
    """

    x_m: float
    y_m: float
    yaw_rad: float


class HeadlandTurn(NamedTuple):
    """The path of the reference point from the end of a swath to the start of the next one.

    Attributes:
        start: east, north and yaw.
        pieces: length and curvature of each piece; the first and the last may be straight on beyond the lines' ends.
    """

    start: Pose
    pieces: Pieces

    @property
    def length_m(self) -> float:
        """Length of the way."""
        return float(np.abs(self.pieces[:, 0]).sum())

    @property
    def tightest_radius_m(self) -> float:
        """Radius of its tightest arc; infinite if it is straight."""
        return tightest_radius_m(self.pieces)


def tightest_radius_m(pieces: Pieces) -> float:
    """Radius of the tightest arc among pieces; infinite where all are straight."""
    sharpest = float(np.max(np.abs(pieces[:, 1]), initial=0.0))
    return 1.0 / sharpest if sharpest > 0.0 else math.inf


def poses_along(start: Pose, pieces: Pieces, arc_m: Float[np.ndarray, " point"]) -> Float[np.ndarray, "point 3"]:
    """Poses (x_m, y_m, yaw_rad) at arc lengths along pieces, straight on beyond both ends; the yaw is not wrapped."""
    length, curvature = pieces.T
    yaw = start.yaw_rad + np.concatenate([[0.0], np.cumsum(length * curvature)])
    x, y = chords(yaw[:-1], length, curvature)
    knots = np.stack(
        [start.x_m + np.concatenate([[0.0], np.cumsum(x)]), start.y_m + np.concatenate([[0.0], np.cumsum(y)]), yaw],
        axis=1,
    )
    begins_m = np.concatenate([[0.0], np.cumsum(np.abs(length))])
    number = np.clip(np.searchsorted(begins_m, arc_m, side="right") - 1, 0, len(length))
    ahead = np.where(length < 0.0, -1.0, 1.0)
    within = (arc_m - begins_m[number]) * np.append(ahead, ahead[-1:])[number]
    bend = np.where(arc_m < 0.0, 0.0, np.append(curvature, 0.0)[number])
    x, y = chords(knots[number, 2], within, bend)
    return np.asarray(knots[number] + np.stack([x, y, within * bend], axis=1))


def turn_points(turn: HeadlandTurn, spacing_m: float = 0.25) -> Float[np.ndarray, "point 2"]:
    """Points along a turn at even spacing, including start and end, for maps and files.

    Args:
        turn: turn to draw.
        spacing_m: largest spacing.
    """
    count = max(math.ceil(turn.length_m / spacing_m), 1) + 1
    return poses_along(turn.start, turn.pieces, np.linspace(0.0, turn.length_m, count))[:, :2]


def one_handed_turn(apart_m: float, radius_m: float) -> Pieces:
    """Half a turn onto a line in the opposite direction: two quarter circles with a straight between, or a semicircle.

    Args:
        apart_m: distance of the lines, positive to the left; at least twice the radius.
        radius_m: radius of the quarter circles.
    """
    hand = math.copysign(1.0 / radius_m, apart_m)
    quarter_m = 0.5 * math.pi * radius_m
    across_m = abs(apart_m) - 2.0 * radius_m
    if across_m < _NO_WAY * radius_m:
        return np.array([[2.0 * quarter_m, hand]])
    return np.array([[quarter_m, hand], [across_m, 0.0], [quarter_m, hand]])


def dubins_ways(start: Pose, end: Pose, radius_m: float) -> list[Pieces]:
    """Ways of Dubins' words from one pose to another, the shortest first.

    Args:
        start, end: start and end pose.
        radius_m: radius of every arc.
    """
    words, hands = forward_words(np.array([start]), np.array([end]), radius_m)
    ways = [
        np.stack([word, hand / radius_m], axis=1)
        for word, hand in zip(words[0], hands, strict=True)
        if np.isfinite(word).all()
    ]
    return sorted(ways, key=lambda way: float(way[:, 0].sum()))


def forward_words(
    starts: Float[np.ndarray, "way 3"],
    ends: Float[np.ndarray, "way 3"],
    radius_m: Float[np.ndarray, " way"] | float,
    *,
    straight: bool = False,
) -> tuple[Float[np.ndarray, "way word 3"], Float[np.ndarray, "word 3"]]:
    """Lengths of Dubins' six words, by Shkel and Lumelsky (2001), NaN without a solution, and their pieces' directions.

    Args:
        starts, ends: x_m, y_m, yaw_rad of each way.
        radius_m: radius of the arcs, per way or common.
        straight: whether to use only the four words with a straight piece; the middle of three arcs is at least half a
            turn.
    """
    east, north = (ends - starts)[:, :2].T
    far, toward = np.hypot(east, north) / radius_m, np.arctan2(north, east)
    a, b = starts[:, 2] - toward, ends[:, 2] - toward
    sa, sb, ca, cb, cab = np.sin(a), np.sin(b), np.cos(a), np.cos(b), np.cos(a - b)
    same, opposite = 2.0 + far**2 - 2.0 * cab, far**2 - 2.0 + 2.0 * cab
    less, more = 2.0 * far * (sa - sb), 2.0 * far * (sa + sb)
    words = np.empty((len(starts), 4 if straight else 6, 3))
    with np.errstate(invalid="ignore"):
        lsl, rsr, lsr, rsl = (
            np.sqrt(np.where(np.abs(square) < _NO_SQUARE * (1.0 + far**2), 0.0, square))
            for square in (same + less, same - less, opposite + more, opposite - more)
        )
        words[:, 0, 1], words[:, 1, 1] = lsl, rsr
        # On one circle there is no straight, and rounding must not choose its heading.
        one = np.where(lsl > 0.0, np.arctan2(cb - ca, far + sa - sb), a)
        two = np.where(rsr > 0.0, np.arctan2(ca - cb, far - sa + sb), a)
        words[:, 2, 1], words[:, 3, 1] = lsr, rsl
        three = np.arctan2(-ca - cb, far + sa + sb) - np.arctan2(-2.0, lsr)
        four = np.arctan2(ca + cb, far - sa - sb) - np.arctan2(2.0, rsl)
        for number, (first, last) in enumerate(
            ((one - a, b - one), (a - two, two - b), (three - a, three - b), (a - four, b - four))
        ):
            words[:, number, 0], words[:, number, 2] = whole_turn(first), whole_turn(last)
        if not straight:
            rlr = 2.0 * np.pi - np.arccos((6.0 - far**2 + 2.0 * cab + less) / 8.0)
            lrl = 2.0 * np.pi - np.arccos((6.0 - far**2 + 2.0 * cab - less) / 8.0)
            five, six = whole_turn(a - two + 0.5 * rlr), whole_turn(-a + one + 0.5 * lrl)
            words[:, 4, 0], words[:, 4, 1], words[:, 4, 2] = five, rlr, whole_turn(a - b - five + rlr)
            words[:, 5, 0], words[:, 5, 1], words[:, 5, 2] = six, lrl, whole_turn(b - a - six + lrl)
    words *= np.reshape(radius_m, (-1, 1, 1))
    return words, _HANDS[: words.shape[1]]


def whole_turn(angle: Float[np.ndarray, " way"]) -> Float[np.ndarray, " way"]:
    """The same turn from 0 to below a whole one; what rounding makes of none is none."""
    turned = angle - 2.0 * np.pi * np.floor(angle * (0.5 / np.pi))
    return np.where(turned > 2.0 * np.pi - _NO_TURN_RAD, 0.0, turned)


def chords(
    yaw_rad: Float[np.ndarray, "*way piece"],
    length_m: Float[np.ndarray, "*way piece"],
    curvature_radpm: Float[np.ndarray, "*way piece"],
) -> tuple[Float[np.ndarray, "*way piece"], Float[np.ndarray, "*way piece"]]:
    """East and north of each piece's chord."""
    half = 0.5 * length_m * curvature_radpm
    chord_m = length_m * np.sinc(half / np.pi)
    return chord_m * np.cos(yaw_rad + half), chord_m * np.sin(yaw_rad + half)
