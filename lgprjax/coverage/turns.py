"""Headland turns from one swath to the next: straight pieces and arcs, or Dubins paths.

Headings join; the curvature jumps where an arc begins, as a skid-steer vehicle can drive it. Dubins (1957): the
shortest way between two poses with circles of one radius has at most three pieces, arc-straight-arc or three arcs.
Between lines closer than the circle is wide it is a bulb of three arcs.
"""

import math
from itertools import product
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

Pieces = Float[np.ndarray, "_ 2"]
"""Length, metres, and curvature, positive to the left, of straight pieces and arcs that follow each other.

A negative length is driven in reverse: the yaw changes by length times curvature all the same.
"""
_NO_TURN_RAD = 1e-9
_NO_WAY = 1e-9


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
        """Of the way."""
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
    x, y = _chord(yaw[:-1], length, curvature)
    knots = np.stack(
        [start.x_m + np.concatenate([[0.0], np.cumsum(x)]), start.y_m + np.concatenate([[0.0], np.cumsum(y)]), yaw],
        axis=1,
    )
    begins_m = np.concatenate([[0.0], np.cumsum(np.abs(length))])
    number = np.clip(np.searchsorted(begins_m, arc_m, side="right") - 1, 0, len(length))
    ahead = np.where(length < 0.0, -1.0, 1.0)
    within = (arc_m - begins_m[number]) * np.append(ahead, ahead[-1:])[number]
    bend = np.where(arc_m < 0.0, 0.0, np.append(curvature, 0.0)[number])
    x, y = _chord(knots[number, 2], within, bend)
    return np.asarray(knots[number] + np.stack([x, y, within * bend], axis=1))


def turn_points(turn: HeadlandTurn, spacing_m: float = 0.25) -> Float[np.ndarray, "point 2"]:
    """Points along a turn at even spacing, start and end among them: for maps and files.

    Args:
        turn: to be drawn.
        spacing_m: at most so far apart.
    """
    count = max(math.ceil(turn.length_m / spacing_m), 1) + 1
    return poses_along(turn.start, turn.pieces, np.linspace(0.0, turn.length_m, count))[:, :2]


def one_handed_turn(apart_m: float, radius_m: float) -> Pieces:
    """Half a turn onto a line that runs back: two quarter circles with a straight between them, or a semicircle.

    Args:
        apart_m: of the lines, positive to the left; at least twice the radius.
        radius_m: of the quarters.
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
        start, end: poses.
        radius_m: of every arc.
    """
    ways = []
    for first, last in product((1.0, -1.0), repeat=2):
        centre, goal = _centre(start, first * radius_m), _centre(end, last * radius_m)
        apart = goal - centre
        way_m = float(np.hypot(*apart))
        if first == last:
            # On one circle there is no straight, and rounding must not choose its heading.
            yaw = math.atan2(apart[1], apart[0]) if way_m > _NO_WAY * radius_m else start.yaw_rad
            ways.append(_arcs_and_straight(start, end, radius_m, first, last, yaw, way_m))
        elif way_m >= 2.0 * radius_m:
            straight_m = math.sqrt(way_m**2 - 4.0 * radius_m**2)
            yaw = math.atan2(apart[1], apart[0]) + math.atan2(2.0 * first * radius_m, straight_m)
            ways.append(_arcs_and_straight(start, end, radius_m, first, last, yaw, straight_m))
        if first == last and _NO_WAY * radius_m < way_m <= 4.0 * radius_m:
            rise_m = math.sqrt(4.0 * radius_m**2 - way_m**2 / 4.0)
            for side in (1.0, -1.0):
                middle = centre + 0.5 * apart + side * rise_m / way_m * np.array([-apart[1], apart[0]])
                ways.append(_three_arcs(start, end, radius_m, first, middle - centre, middle - goal))
    return sorted(ways, key=lambda way: float(way[:, 0].sum()))


def _arcs_and_straight(
    start: Pose, end: Pose, radius_m: float, first: float, last: float, yaw_rad: float, straight_m: float
) -> Pieces:
    begin = _positive(first * (yaw_rad - start.yaw_rad))
    finish = _positive(last * (end.yaw_rad - yaw_rad))
    return np.array([[begin * radius_m, first / radius_m], [straight_m, 0.0], [finish * radius_m, last / radius_m]])


def _three_arcs(
    start: Pose,
    end: Pose,
    radius_m: float,
    hand: float,
    from_first: Float[np.ndarray, "2"],
    from_last: Float[np.ndarray, "2"],
) -> Pieces:
    """Arcs of one hand, of the other, and of the first again; circles touch where the headings of both agree."""
    one, two = (math.atan2(hand * away[0], -hand * away[1]) for away in (from_first, from_last))
    turns = (
        _positive(hand * (one - start.yaw_rad)),
        _positive(hand * (one - two)),
        _positive(hand * (end.yaw_rad - two)),
    )
    hands = (hand, -hand, hand)
    return np.array([[turn * radius_m, each / radius_m] for turn, each in zip(turns, hands, strict=True)])


def _centre(pose: Pose, radius_m: float) -> Float[np.ndarray, "2"]:
    """Centre of the circle to the left of a pose, to the right where the radius is negative."""
    return np.array([pose.x_m - radius_m * math.sin(pose.yaw_rad), pose.y_m + radius_m * math.cos(pose.yaw_rad)])


def _positive(turn_rad: float) -> float:
    """The same turn from 0 to below a whole one; what rounding makes of none is none."""
    turned = math.fmod(turn_rad, 2.0 * math.pi)
    turned += 2.0 * math.pi if turned < 0.0 else 0.0
    return 0.0 if turned > 2.0 * math.pi - _NO_TURN_RAD else turned


def _chord(
    yaw_rad: Float[np.ndarray, " piece"],
    length_m: Float[np.ndarray, " piece"],
    curvature_radpm: Float[np.ndarray, " piece"],
) -> tuple[Float[np.ndarray, " piece"], Float[np.ndarray, " piece"]]:
    half = 0.5 * length_m * curvature_radpm
    chord_m = length_m * np.sinc(half / np.pi)
    return chord_m * np.cos(yaw_rad + half), chord_m * np.sin(yaw_rad + half)
