"""The compiled step of a skid-steer vehicle: one vector in, one out, so that a tick is one call and one copy."""

from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from lgprjax.autopilot.skid_step import Guidance, SkidOrders, SkidSetup, SkidState, init_skid, step_skid
from lgprjax.coverage.guidance import CoverRoute, route_point
from lgprjax.navigation.skid_model import DeltaHeading, SkidMotion, SkidObservations, skid_pose, skid_pose_covariance
from lgprjax.runtime.control.compiled import as_row, bits_of, gnss_of, named_numbers
from lgprjax.vehicle.kinematics import WheelSpeeds, body_rates


class SkidNumbers(NamedTuple):
    """Inputs of a tick as plain numbers; see ``SkidMotion``, ``SkidObservations``, ``SkidOrders``. Flags 0 or 1."""

    step_s: float
    left_mps: float
    right_mps: float
    gnss_valid: float
    gnss_x_m: float
    gnss_y_m: float
    gnss_m2: float
    gnss_age_s: float
    turn_valid: float
    turn_rad: float
    span_s: float
    engaged: float
    drives: float
    stop: float
    speed_cap_mps: float
    set_speed_mps: float
    age_s: float


class SkidResult(NamedTuple):
    """Results of a tick as plain numbers.

    Attributes:
        x_m, y_m, yaw_rad: pose of the reference point.
        xx ... yawyaw: covariance of the pose.
        speed_mps, sigma_m: forward speed, and standard deviation of the position's larger axis.
        heading_known, reaction, reasons: state of navigation.
        accepted, offered: bits of the sources.
        cross_m, heading_error_rad, to_go_m, line, works, done, off_m: plan of the guidance (``works``: the plan wants
            the tool on), and the vehicle's distance from its line.
        edge: whether a crossing of the fence is predicted.
        left_mps, right_mps, tool, depth_m, limited: the command and the limiter's bits.
    """

    x_m: float
    y_m: float
    yaw_rad: float
    xx: float
    xy: float
    xyaw: float
    yy: float
    yyaw: float
    yawyaw: float
    speed_mps: float
    sigma_m: float
    heading_known: float
    reaction: float
    reasons: float
    accepted: float
    offered: float
    cross_m: float
    heading_error_rad: float
    to_go_m: float
    line: float
    works: float
    done: float
    off_m: float
    edge: float
    left_mps: float
    right_mps: float
    tool: float
    depth_m: float
    limited: float


@partial(jax.jit, static_argnames="guidance")
def step_skid_compiled(
    setup: SkidSetup,
    route: CoverRoute,
    fence: Float[Array, "side 2 2"],
    state: SkidState,
    numbers: Float[Array, " number"],
    *,
    guidance: Guidance,
) -> tuple[SkidState, Float[Array, " result"]]:
    """``step_skid`` on ``SkidNumbers``, with ``SkidResult`` as one row."""
    inputs, yes = named_numbers(SkidNumbers, numbers)
    motion = SkidMotion(inputs.left_mps, inputs.right_mps, inputs.step_s)
    observations = SkidObservations(gnss_of(inputs, yes), DeltaHeading(inputs.turn_rad, inputs.span_s, yes.turn_valid))
    orders = SkidOrders(
        engaged=yes.engaged,
        drives=yes.drives,
        stop=yes.stop,
        speed_cap_mps=inputs.speed_cap_mps,
        set_speed_mps=inputs.set_speed_mps,
        age_s=inputs.age_s,
        left_mps=inputs.left_mps,
        right_mps=inputs.right_mps,
    )
    state, command, info = step_skid(setup, route, fence, state, motion, observations, orders, guidance=guidance)
    estimate, plan = state.filter.estimate, info.plan
    pose, covariance = skid_pose(estimate), skid_pose_covariance(estimate)
    speed_mps, _ = body_rates(setup.vehicle.track_m, WheelSpeeds(inputs.left_mps, inputs.right_mps))
    foot = route_point(route, state.carrot.arc_m)
    row = (
        *pose,
        *(covariance[one, other] for one in range(3) for other in range(one, 3)),
        speed_mps,
        info.sigma_m,
        info.filter.heading_known,
        info.reaction,
        info.reasons,
        bits_of(info.filter.accepted),
        bits_of(info.filter.offered),
        plan.cross_m,
        plan.heading_error_rad,
        plan.to_go_m,
        plan.line,
        plan.tool_on & ~info.stops,
        plan.done,
        jnp.hypot(pose.x_m - foot.x_m, pose.y_m - foot.y_m),
        info.edge_predicted,
        *command,
        info.limited,
    )
    return state, as_row(row)


@jax.jit
def start_skid_compiled(setup: SkidSetup, x_m: Float[Array, ""], y_m: Float[Array, ""]) -> SkidState:
    """State at standstill at a position; the heading is unknown."""
    return init_skid(setup, x_m, y_m)
