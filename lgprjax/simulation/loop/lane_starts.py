"""Many drives of one course made ready: its centreline as the route, each lane with its own errors from the start."""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Key, PRNGKeyArray

from lgprjax.navigation import (
    PlanCode,
    RoutePath,
    RouteSpeeds,
    RouteTrack,
    acquire,
    find_starts,
    legs_of_track,
    make_route_path,
)
from lgprjax.scene import FixErrors, FixErrorState, init_fix_errors
from lgprjax.scene.road import follow_centre
from lgprjax.simulation.loop.loop_state import LoopSetup, LoopSpec, LoopState, start_loop
from lgprjax.simulation.loop.off_road import Bare
from lgprjax.vehicle import Chassis, VehiclePose

_POINTS_M = 0.2
_STARTS_AT_M = 8.0
_START_MPS = 3.0
_BELIEVED_OFF = (0.3, 0.3, 0.01)


def route_of_road(course: Bare, chassis: Chassis, cruise_mps: float) -> RoutePath:
    """The centreline of a course's road as a route."""
    centre = follow_centre(course.road, np.arange(0.0, course.spec.length_m + 30.0, _POINTS_M))
    points = np.stack([centre.east_m, centre.north_m], axis=1)
    legs, gear = legs_of_track(RouteTrack("road", points, centre.yaw_rad))
    return make_route_path(legs, gear, chassis, RouteSpeeds(cruise_mps))


def start_lanes(
    spec: LoopSpec, setup: LoopSetup, course: Bare, route: RoutePath, errors: FixErrors, keys: Key[Array, " lane"]
) -> tuple[LoopState, FixErrorState]:
    """As many drives as keys, the anchor on the route's start, each fusion wrong by decimetres of its own."""
    at = follow_centre(course.road, np.array([_STARTS_AT_M]))
    east, north, yaw = (float(part[0]) for part in (at.east_m, at.north_m, at.yaw_rad))
    lead = float(setup.plant.chassis.anchor_m)
    pose = VehiclePose(*(jnp.float32(v) for v in (east - lead * np.cos(yaw), north - lead * np.sin(yaw), yaw)))
    planner, code = acquire(find_starts(route, setup.autopilot.planner, setup.autopilot.chassis, pose))
    if int(code) != PlanCode.FOLLOWING:
        raise ValueError(f"the vehicles do not find their start: {PlanCode(int(code)).name}")
    along_m = jnp.float32(_STARTS_AT_M - lead)

    def one(key: PRNGKeyArray) -> tuple[LoopState, FixErrorState]:
        off_key, sensor_key, fix_key = jax.random.split(key, 3)
        off: Float[Array, 3] = jnp.asarray(_BELIEVED_OFF, jnp.float32) * jax.random.normal(off_key, (3,))
        believed = VehiclePose(pose.x_m + off[0], pose.y_m + off[1], pose.yaw_rad + off[2])
        state = start_loop(spec, setup, planner, pose, believed, jnp.float32(_START_MPS), along_m, sensor_key)
        return state, init_fix_errors(errors, fix_key)

    begun: tuple[LoopState, FixErrorState] = jax.jit(jax.vmap(one))(keys)
    return begun
