"""The planner's form of a route: legs of path tables of one size, with a gear and speeds for each.

A leg ends where the gear changes (a cusp) or where the route ends. Rows and legs are padded to sizes from a ladder, so
that another route of similar length needs no compilation.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from lgprjax.errors import InputError
from lgprjax.vehicle import Chassis, Path, PathPoint, Projection, path_point, project, turn_of, zero_slip_point
from lgprjax.vehicle.path import SPACING_M, path_from_points

_LEAST_ROWS = 512
_BEND_M = 2.0
_TIGHTER = 1.05
"""Tolerance of a bend relative to the vehicle's smallest circle: the labels' noise after smoothing."""


class RoutePath(NamedTuple):
    """A route in its own level frame (that of the map), for the array centre: the vehicle's anchor.

    Attributes:
        legs: path tables with a leading leg axis: ``rows`` [leg, row, 5], the other fields [leg]. Each runs in the
            direction of travel when the route was recorded; padding continues straight. Only a single leg may be
            closed.
        gear: 1 where the vehicle drove forward when the leg was recorded, -1 where it reversed.
        speed_mps: highest on each row, in either direction, for its curvature and for the neighbouring rows.
        leg_count: legs in use.
    """

    legs: Path
    gear: Float[Array, " leg"]
    speed_mps: Float[Array, "leg row"]
    leg_count: Int[Array, ""]


@dataclass(frozen=True)
class RouteSpeeds:
    """Limits of the speed along a route.

    Attributes:
        cruise_mps: highest anywhere.
        lateral_mps2: highest lateral acceleration of the anchor.
        change_mps2: rate at which the speed limit may fall or rise along the route.
    """

    cruise_mps: float
    lateral_mps2: float = 1.5
    change_mps2: float = 0.5

    def __post_init__(self) -> None:
        for name in ("cruise_mps", "lateral_mps2", "change_mps2"):
            value = getattr(self, name)
            if not 0.0 < value < float("inf"):
                raise InputError("route", name, "a number above zero", f"{value:g}")


def make_route_path(
    legs: Sequence[Path], gear: Sequence[int], chassis: Chassis | None, speeds: RouteSpeeds, *, name: str = "route"
) -> RoutePath:
    """Join legs to a route that a vehicle can drive.

    Args:
        legs: in the order and direction in which they were recorded, for the anchor.
        gear: 1 or -1 for each.
        chassis: scalars; its largest angle gives the tightest circle of the anchor. ``None`` without a vehicle, in
            which case the radius is not checked.
        speeds: limits.
        name: of the route, or its file, for errors.

    Raises:
        InputError: no leg, a closed one among several, or one that turns more tightly than the vehicle can; the message
            gives the place in metres along the route.
    """
    if not legs or len(legs) != len(gear) or any(each not in (1, -1) for each in gear):
        raise InputError(name, "legs", "at least one, each with gear 1 or -1", f"{len(legs)} legs, gears {list(gear)}")
    if len(legs) > 1 and any(float(leg.laps_per_m) > 0.0 for leg in legs):
        raise InputError(name, "legs", "one leg for a closed route", f"{len(legs)} legs")
    tightest = np.inf if chassis is None else largest_curvature_radpm(chassis)
    start_m = 0.0
    for leg in legs:
        bend = _bends(leg)
        row = int(np.argmax(bend))
        if bend[row] > _TIGHTER * tightest:
            place = f"{start_m + (row - 1) * float(leg.spacing_m):.1f} m along the route"
            raise InputError(
                name, place, f"a radius of at least {1.0 / tightest:.2f} m at the anchor", f"{1.0 / bend[row]:.2f} m"
            )
        start_m += float(leg.length_m)
    size = _ladder(max(len(leg.rows) for leg in legs), _LEAST_ROWS)
    spare = _ladder(len(legs), 1) - len(legs)
    used = [*legs, *([legs[-1]] * spare)]
    return RoutePath(
        Path(
            jnp.asarray(np.stack([_padded(leg, size) for leg in used])),
            *(jnp.stack([leg[column] for leg in used]) for column in (1, 2, 3)),
        ),
        jnp.asarray([*gear, *([gear[-1]] * spare)], jnp.float32),
        jnp.asarray(np.stack([_speeds(leg, size, speeds) for leg in used])),
        jnp.int32(len(legs)),
    )


def largest_curvature_radpm(chassis: Chassis) -> float:
    """Curvature of the tightest circle that the anchor can drive: R² = 1/κ² + (l − x_c)² at the largest angle."""
    curvature = float(turn_of(chassis, chassis.largest_angle_rad).curvature_radpm)
    lead_m = float(chassis.anchor_m - zero_slip_point(chassis, chassis.largest_angle_rad))
    return float(1.0 / np.hypot(1.0 / curvature, lead_m))


def leg_point(route: RoutePath, leg: Int[Array, ""], arc_m: Float[Array, ""]) -> PathPoint:
    """Point of a leg at an arc length; straight on beyond its ends, never on another leg."""
    row, beyond_m = _fetch(route, leg, arc_m)
    return path_point(row, beyond_m)


def leg_project(
    route: RoutePath, leg: Int[Array, ""], near_m: Float[Array, ""], x_m: Float[Array, ""], y_m: Float[Array, ""]
) -> Projection:
    """Foot of a point on the row of a leg that holds an arc length close to it, as ``vehicle.project`` finds it."""
    row, beyond_m = _fetch(route, leg, near_m)
    foot = project(row, beyond_m, x_m, y_m)
    return Projection(near_m - beyond_m + foot.arc_m, foot.offset_m)


def leg_row(route: RoutePath, leg: Int[Array, ""], arc_m: Float[Array, ""]) -> tuple[Int[Array, ""], Float[Array, ""]]:
    """The row of a leg that holds an arc length, and the way beyond the row's start."""
    legs = route.legs
    lap_m = arc_m - jnp.floor(arc_m * legs.laps_per_m[leg]) * legs.length_m[leg]
    row = jnp.clip(jnp.floor(lap_m / legs.spacing_m[leg]).astype(jnp.int32) + 1, 0, legs.rows.shape[1] - 1)
    return row, lap_m - jnp.maximum(row - 1, 0).astype(arc_m.dtype) * legs.spacing_m[leg]


def _fetch(route: RoutePath, leg: Int[Array, ""], arc_m: Float[Array, ""]) -> tuple[Path, Float[Array, ""]]:
    """One row as a path of its own: a batch element never copies a leg's table."""
    row, beyond_m = leg_row(route, leg, arc_m)
    held = route.legs.rows.at[leg, row].get(mode="clip")
    one = jnp.ones_like(arc_m)
    return Path(held[None], one, one, jnp.zeros_like(arc_m)), beyond_m


def _ladder(needed: int, least: int) -> int:
    """The first size, doubling from the least one, that holds what is needed."""
    size = least
    while size < needed:
        size *= 2
    return size


def _padded(leg: Path, size: int) -> Float[np.ndarray, "row 5"]:
    """Rows of a leg, and as many as are missing straight on."""
    rows = np.asarray(leg.rows, np.float64)
    x, y, cos, sin, _ = rows[-1]
    on_m = float(leg.spacing_m) * np.arange(1, size - len(rows) + 1)
    beyond = np.stack(
        [x + cos * on_m, y + sin * on_m, *(np.full_like(on_m, each) for each in (cos, sin, 0.0))], axis=-1
    )
    return np.concatenate([rows, beyond]).astype(np.float32)


def _bends(leg: Path) -> Float[np.ndarray, " row"]:
    """Magnitude of the curvature about each row, mean over two metres: no vehicle steers over a shorter distance."""
    curvature = np.asarray(leg.rows, np.float64)[1:-1, 4]
    size = min(2 * round(_BEND_M / float(leg.spacing_m) / 2.0) + 1, len(curvature))
    around = np.arange(-(size // 2), len(curvature) + (size - 1) // 2)
    closed = float(leg.laps_per_m) > 0.0
    wide = curvature[around % len(curvature) if closed else np.clip(around, 0, len(curvature) - 1)]
    mean = np.abs(np.convolve(wide, np.full(size, 1.0 / size), mode="valid"))
    return np.concatenate([mean[:1], mean, mean[-1:]])


def _speeds(leg: Path, size: int, speeds: RouteSpeeds) -> Float[np.ndarray, " row"]:
    """Highest speed on each row: v² ≤ a/|κ|, and v² changes by at most 2a' a metre, forward and back."""
    bend = _bends(leg)
    square = np.minimum(speeds.cruise_mps**2, speeds.lateral_mps2 / np.maximum(bend, 1e-9))
    step = 2.0 * speeds.change_mps2 * float(leg.spacing_m)
    # A closed leg is processed twice, so that its start accounts for its end.
    for _ in range(2 if float(leg.laps_per_m) > 0.0 else 1):
        for order in (range(1, len(square)), range(len(square) - 2, -1, -1)):
            back = 1 if order.step > 0 else -1
            for row in order:
                square[row] = min(square[row], square[row - back] + step)
        if float(leg.laps_per_m) > 0.0:
            square[[0, 1, -2, -1]] = square[[0, 1, -2, -1]].min()
    return np.pad(np.sqrt(square), (0, size - len(square)), mode="edge").astype(np.float32)


# A recorded track as legs: cut where the gear changes, smoothed, then a table of arcs.
#
# Positions are smoothed over distance by local parabolas with tapering weights (Cleveland 1979), separately in both
# axes. A parabola keeps curvature: on a circle of 10 m the bias is below a millimetre, where a running mean would cut
# the curve by decimetres. At the ends the parabola is one-sided and nothing is cut off.

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
    metres: noise at standstill does not count.

    Args:
        track: points with noise of centimetres.

    Raises:
        InputError: non-finite numbers, a gap of more than 10 m, or less than two metres of travel.
    """
    values = np.concatenate([track.points_m, track.yaw_rad[:, None]], axis=1)
    if not np.all(np.isfinite(values)):
        place = int(np.flatnonzero(~np.all(np.isfinite(values), axis=1))[0])
        raise InputError(track.name, f"point {place}", "finite numbers", f"{values[place].tolist()}")
    points, yaw = _moved(track.points_m, track.yaw_rad)
    steps = np.hypot(*np.diff(points, axis=0).T)
    arc = np.concatenate([[0.0], np.cumsum(steps)])
    if len(points) < 3 or arc[-1] < _LEAST_LEG_M:
        raise InputError(track.name, "points", f"travel of at least {_LEAST_LEG_M:g} m", f"{arc[-1]:.2f} m")
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
    """Points every quarter of a metre along a track, each the value of a parabola fitted to its surroundings.

    Args:
        points_m: in driving order, no two alike next to each other.
    """
    # Noise lengthens the path of raw points, which narrows the windows slightly; the table is made afterwards.
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
    """The points that moved: a standing vehicle adds noise, and no distance."""
    kept = [0]
    for place in range(1, len(points_m)):
        if np.hypot(*(points_m[place] - points_m[kept[-1]])) >= 0.2 * SPACING_M:
            kept.append(place)
    return points_m[kept], yaw_rad[kept]


def _forward(points_m: Float[np.ndarray, "point 2"], yaw_rad: Float[np.ndarray, " point"]) -> Bool[np.ndarray, " step"]:
    """For each step whether the body moved forward; runs too short for a leg are joined to their neighbour."""
    step = np.diff(points_m, axis=0)
    middle = np.unwrap(yaw_rad)
    middle = 0.5 * (middle[1:] + middle[:-1])
    ahead = step[:, 0] * np.cos(middle) + step[:, 1] * np.sin(middle)
    arc = np.cumsum(np.hypot(*step.T))
    # Over half a metre, so that centimetres of noise do not reverse a slow vehicle.
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
