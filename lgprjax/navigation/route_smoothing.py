"""A recorded track laid as legs: cut where the gear changes, freed of the labels' noise, then a table of arcs.

Positions are smoothed over the way by local parabolas with tapering weights (Cleveland 1979), separately in both axes.
A parabola keeps curvature: on a circle of 10 m the bias is below a millimetre, where a running mean would cut the curve
by decimetres. At the ends the parabola is one-sided and nothing is cut off.
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from jaxtyping import Bool, Float, Int

from lgprjax.errors import InputError
from lgprjax.vehicle import Path
from lgprjax.vehicle.path import SPACING_M, path_from_points

HALF_WINDOW_M = 3.0
"""To either side of a point: 1 cm of noise leaves 3 mm in position and 0.005 rad/m in the curvature of a row."""
_LEAST_LEG_M = 2.0
_WIDEST_GAP_M = 10.0
_BLOCK_M = 0.5
_CLOSE_M = 3.0
_CLOSE_RAD = 0.35
_FEWEST = 5


@dataclass(frozen=True)
class RouteTrack:
    """A drive's track of the array centre, in driving order, in a level frame.

    Attributes:
        name: of the route, for errors.
        points_m: x, y.
        yaw_rad: of the body at each, counter-clockwise from x.
    """

    name: str
    points_m: Float[np.ndarray, "point 2"]
    yaw_rad: Float[np.ndarray, " point"]

    def reversed(self) -> "RouteTrack":
        """The same ground driven the other way, the body turned round: gears stay, the order turns."""
        return RouteTrack(self.name, self.points_m[::-1], self.yaw_rad[::-1] + np.pi)


def legs_of_track(track: RouteTrack) -> tuple[list[Path], list[int]]:
    """Legs of a track in driving order, and the gear of each: 1 forward, -1 reversing.

    A cusp is where the direction of travel turns from the body's heading to its opposite, or back, for at least two
    metres: what noise does at a standstill is none.

    Args:
        track: points with noise of centimetres.

    Raises:
        InputError: something that is no number, a gap of more than 10 m, or less than two metres of way.
    """
    values = np.concatenate([track.points_m, track.yaw_rad[:, None]], axis=1)
    if not np.all(np.isfinite(values)):
        place = int(np.flatnonzero(~np.all(np.isfinite(values), axis=1))[0])
        raise InputError(track.name, f"point {place}", "numbers", f"{values[place].tolist()}")
    points, yaw = _moved(track.points_m, track.yaw_rad)
    steps = np.hypot(*np.diff(points, axis=0).T)
    arc = np.concatenate([[0.0], np.cumsum(steps)])
    if len(points) < 3 or arc[-1] < _LEAST_LEG_M:
        raise InputError(track.name, "points", f"a way of at least {_LEAST_LEG_M:g} m", f"{arc[-1]:.2f} m")
    if steps.max() > _WIDEST_GAP_M:
        wide = int(np.argmax(steps))
        found = f"{steps[wide]:.1f} m"
        raise InputError(
            track.name, f"{arc[wide]:.1f} m along the route", f"gaps of at most {_WIDEST_GAP_M:g} m", found
        )
    forward = _forward(points, yaw)
    cuts = [0, *(np.flatnonzero(np.diff(forward.astype(int))) + 1), len(forward)]
    gears = [1 if forward[low] else -1 for low in cuts[:-1]]
    legs = [path_from_points(smooth_points(points[low : high + 1])) for low, high in pairwise(cuts)]
    return legs, gears


def is_closed(points_m: Float[np.ndarray, "point 2"], yaw_rad: Float[np.ndarray, " point"]) -> bool:
    """Whether a drive of more than 30 m ends where it began, within 3 m and 20°."""
    gap_m = float(np.hypot(*(points_m[-1] - points_m[0])))
    turn = float(np.angle(np.exp(1j * (yaw_rad[-1] - yaw_rad[0]))))
    long = float(np.hypot(*np.diff(points_m, axis=0).T).sum()) > 10.0 * _CLOSE_M
    return long and gap_m < _CLOSE_M and abs(turn) < _CLOSE_RAD


def smooth_points(points_m: Float[np.ndarray, "point 2"]) -> Float[np.ndarray, "place 2"]:
    """Points every quarter of a metre along a track, each the value of a parabola fitted to what lies about it.

    Args:
        points_m: in driving order, no two alike next to each other.
    """
    # Noise lengthens the way along raw points: the windows come out narrower by that, the table is laid afterwards.
    arc = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(points_m, axis=0).T))])
    places = np.linspace(0.0, arc[-1], max(round(arc[-1] / SPACING_M), 2) + 1)
    out = np.empty((len(places), 2))
    for number, place in enumerate(places):
        reach = HALF_WINDOW_M
        low, high = np.searchsorted(arc, [place - reach, place + reach])
        while high - low < _FEWEST and (low > 0 or high < len(arc)):
            reach *= 1.5
            low, high = np.searchsorted(arc, [place - reach, place + reach])
        away = (arc[low:high] - place) / reach
        root = np.sqrt(np.clip(1.0 - np.abs(away) ** 3, 1e-6, None) ** 3)
        terms = np.stack([np.ones_like(away), away, away * away], axis=1)
        found, *_ = np.linalg.lstsq(terms * root[:, None], points_m[low:high] * root[:, None], rcond=None)
        out[number] = found[0]
    return out


def _moved(
    points_m: Float[np.ndarray, "point 2"], yaw_rad: Float[np.ndarray, " point"]
) -> tuple[Float[np.ndarray, "kept 2"], Float[np.ndarray, " kept"]]:
    """The points that moved: a vehicle that stands adds noise, and no way."""
    kept = [0]
    for place in range(1, len(points_m)):
        if np.hypot(*(points_m[place] - points_m[kept[-1]])) >= 0.2 * SPACING_M:
            kept.append(place)
    return points_m[kept], yaw_rad[kept]


def _forward(points_m: Float[np.ndarray, "point 2"], yaw_rad: Float[np.ndarray, " point"]) -> Bool[np.ndarray, " step"]:
    """For each step whether the body moved forward; runs too short to be a leg go with their neighbour."""
    step = np.diff(points_m, axis=0)
    middle = np.unwrap(yaw_rad)
    middle = 0.5 * (middle[1:] + middle[:-1])
    ahead = step[:, 0] * np.cos(middle) + step[:, 1] * np.sin(middle)
    arc = np.cumsum(np.hypot(*step.T))
    # Over half a metre, so that centimetres of noise do not turn a slow vehicle round.
    low = np.searchsorted(arc, arc - _BLOCK_M / 2.0)
    high = np.searchsorted(arc, arc + _BLOCK_M / 2.0, side="right")
    total = np.concatenate([[0.0], np.cumsum(ahead)])
    forward = (total[high] - total[low]) > 0.0
    return _without_short_runs(forward, np.hypot(*step.T))


def _without_short_runs(
    forward: Bool[np.ndarray, " step"], step_m: Float[np.ndarray, " step"]
) -> Bool[np.ndarray, " step"]:
    forward = forward.copy()
    while True:
        cuts: Int[np.ndarray, " cut"] = np.concatenate(
            [[0], np.flatnonzero(np.diff(forward.astype(int))) + 1, [len(forward)]]
        )
        lengths = np.add.reduceat(step_m, cuts[:-1])
        shortest = int(np.argmin(lengths))
        if len(lengths) == 1 or lengths[shortest] >= _LEAST_LEG_M:
            return forward
        span = slice(int(cuts[shortest]), int(cuts[shortest + 1]))
        forward[span] = ~forward[span]
