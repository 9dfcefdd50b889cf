"""A vehicle's place beside a coverage route: the foot is carried on from the last one, never searched globally.

Lines of a pattern lie side by side and its turns cross them: the nearest point may belong to another line.
"""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float

from lgprjax.coverage.cover_route import CoverRoute, RoutePoint, route_point
from lgprjax.vehicle.arc import VehiclePose

_STEPS = 2
_FARTHEST_M = 0.5
"""A step of the search moves the foot by so much at the most: estimates jump, places on a route do not."""


class RouteFoot(NamedTuple):
    """Where a vehicle is beside its route.

    Attributes:
        arc_m: of the foot; negative before the start.
        point: of the route there.
        cross_m: from the route to the vehicle, positive to the left of the driving direction.
        heading_error_rad: heading less that of the route.
    """

    arc_m: Float[Array, "..."]
    point: RoutePoint
    cross_m: Float[Array, "..."]
    heading_error_rad: Float[Array, "..."]


def route_foot(route: CoverRoute, near_m: Float[Array, ""], pose: VehiclePose) -> RouteFoot:
    """Foot of a pose near an arc length; one lane, more by ``vmap``. A pose that is no number leaves the arc."""
    arc_m = near_m
    for _ in range(_STEPS):
        point = route_point(route, arc_m)
        along, left = beside(point, pose)
        # Near the centre of curvature there is no foot; it is kept from getting there.
        share = jnp.maximum(1.0 - point.curvature_radpm * left, 0.2)
        step_m = jnp.clip(along / share, -_FARTHEST_M, _FARTHEST_M)
        arc_m = arc_m + jnp.where(jnp.isfinite(step_m), step_m, 0.0)
    point = route_point(route, arc_m)
    _, left = beside(point, pose)
    turned = pose.yaw_rad - point.yaw_rad
    return RouteFoot(arc_m, point, left, jnp.arctan2(jnp.sin(turned), jnp.cos(turned)))


def beside(point: RoutePoint, pose: VehiclePose) -> tuple[Float[Array, ""], Float[Array, ""]]:
    """How far along and to the left of a point of the route a pose is."""
    east, north = pose.x_m - point.x_m, pose.y_m - point.y_m
    cos, sin = jnp.cos(point.yaw_rad), jnp.sin(point.yaw_rad)
    return cos * east + sin * north, cos * north - sin * east
