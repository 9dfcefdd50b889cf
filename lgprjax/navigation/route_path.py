"""A route as the planner drives it: legs of path tables of one size, a gear and speeds for each.

A leg ends where the gear changes (a cusp) or where the route ends. Rows and legs are padded to sizes from a ladder, so
that another route of like length is the same to the compiler.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from lgprjax.errors import InputError
from lgprjax.vehicle import Chassis, Path, PathPoint, Projection, path_point, project, turn_of, zero_slip_point

_LEAST_ROWS = 512
_BEND_M = 2.0
_TIGHTER = 1.05
"""How much tighter than the vehicle's own circle a bend may be: what is left of the labels' noise after smoothing."""


class RoutePath(NamedTuple):
    """A route in its own level frame (that of the map), for the array centre: the vehicle's anchor.

    Attributes:
        legs: path tables with a leading leg axis: ``rows`` [leg, row, 5], the other fields [leg]. Each runs in the
            direction of travel when the route was recorded; padding goes straight on. Only a lone leg may be closed.
        gear: 1 where the vehicle drove forward when the leg was recorded, -1 where it reversed.
        speed_mps: highest on each row, either way, for curvature and for what lies before and after on the leg.
        leg_count: legs in use.
    """

    legs: Path
    gear: Float[Array, " leg"]
    speed_mps: Float[Array, "leg row"]
    leg_count: Int[Array, ""]


@dataclass(frozen=True)
class RouteSpeeds:
    """What limits the speed along a route.

    Attributes:
        cruise_mps: highest anywhere.
        lateral_mps2: highest lateral acceleration of the anchor.
        change_mps2: how fast the speed limit may fall or rise along the way.
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
    """Legs joined to a route that a vehicle can drive.

    Args:
        legs: in the order and direction in which they were recorded, for the anchor.
        gear: 1 or -1 for each.
        chassis: scalars; its largest angle gives the tightest circle of the anchor. ``None`` where no vehicle is known
            yet, and none can say that the route is too tight.
        speeds: limits.
        name: of the route, or its file, for errors.

    Raises:
        InputError: no leg, a closed one among several, or one that turns more tightly than the vehicle can; the place
            is told in metres along the route.
    """
    if not legs or len(legs) != len(gear) or any(each not in (1, -1) for each in gear):
        raise InputError(name, "legs", "at least one, each with gear 1 or -1", f"{len(legs)} legs, gears {list(gear)}")
    if len(legs) > 1 and any(float(leg.laps_per_m) > 0.0 for leg in legs):
        raise InputError(name, "legs", "a lone one where it is closed", f"{len(legs)} legs")
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
    """One row as a path of its own: a lane never copies a leg's table."""
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
    """Magnitude of the curvature about each row, mean over two metres: shorter than that no vehicle here steers."""
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
    # A closed leg is gone over twice, so that its start knows of its end.
    for _ in range(2 if float(leg.laps_per_m) > 0.0 else 1):
        for order in (range(1, len(square)), range(len(square) - 2, -1, -1)):
            back = 1 if order.step > 0 else -1
            for row in order:
                square[row] = min(square[row], square[row - back] + step)
        if float(leg.laps_per_m) > 0.0:
            square[[0, 1, -2, -1]] = square[[0, 1, -2, -1]].min()
    return np.pad(np.sqrt(square), (0, size - len(square)), mode="edge").astype(np.float32)
