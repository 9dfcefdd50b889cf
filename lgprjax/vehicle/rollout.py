"""Closed-loop rollouts along a path: foot, goal, law, servo, arc; for one vehicle or a million.

All functions take batches of any shape: a batch is a leading axis of every field, equivalent to ``vmap``.
"""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from typing import Literal, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jax.tree_util import tree_map
from jaxtyping import Array, Bool, Float

from lgprjax.machine import usable_cores
from lgprjax.vehicle.actuators import Servo, ServoPace, ServoState, init_servo, servo_pace, torque_share, turn_servo
from lgprjax.vehicle.kinematics import Chassis, MeasuredRear, Rear, rear_angle, yaw_gain
from lgprjax.vehicle.metrics import MetricSums, RolloutMetrics, finish_metrics, init_metrics, step_metrics
from lgprjax.vehicle.path import Path, Projection, path_point, project, tangent
from lgprjax.vehicle.pursuit import NEWTON_STEPS, LookAhead, Steering, look_ahead_m, steer_closed, steer_stanley

# Inputs and outputs of a rollout: spec, vehicles, state, trace.
#
# A lane is one vehicle with its own parameters, an element of the batch. The true vehicle (``chassis``) and the law's
# model of it (``believed``) are two fields: errors of k, of the yaw gain or of the anchor are studied by making them
# differ.


@dataclass(frozen=True)
class RolloutSpec:
    """Static settings of a rollout, the same for all vehicles.

    Attributes:
        steps: number of steps.
        step_s: length of a step, in which the vehicle may turn by up to half a radian.
        law: pursuit, exact (LL eq. 2) or closed form (LL eq. 3); or, for comparison, Stanley's, which requires the
            anchor at the front axle. Plain pure pursuit is the exact law of a chassis with the anchor at the rear axle,
            k = 0.
        stanley_gain_ps: gain of Stanley's law.
        delay_slots: number of steps of the longest servo delay.
        tolerance_m: tolerance of the settling distance.
        tail_m: length of the last stretch of travel, searched for a limit cycle.
    """

    steps: int
    step_s: float = 0.05
    law: Literal["exact", "closed", "stanley"] = "exact"
    stanley_gain_ps: float = 1.0
    delay_slots: int = 0
    tolerance_m: float = 0.10
    tail_m: float = 30.0

    def __post_init__(self) -> None:
        if self.steps < 1 or not self.step_s > 0.0:
            raise ValueError(f"a rollout takes at least one step of positive time, not {self.steps} of {self.step_s} s")


class RolloutLane(NamedTuple):
    """A vehicle, the law's model of it, and its speed and look-ahead. Fields are scalars or one value per batch
    element.

    Attributes:
        chassis: true chassis; its largest angle is not used, that of ``believed`` is.
        believed: model of the law. Infinite characteristic speed: no feed-forward.
        servo: steering servo.
        supply_v: supply voltage at the servo.
        speed_mps: constant speed along the body axis; negative in reverse.
        look_ahead: look-ahead over speed.
    """

    chassis: Chassis
    believed: Chassis
    servo: Servo
    supply_v: Float[Array, "..."]
    speed_mps: Float[Array, "..."]
    look_ahead: LookAhead


class RolloutState(NamedTuple):
    """State of a vehicle.

    Attributes:
        x_m, y_m: position of the rear axle.
        cos_yaw, sin_yaw: cosine and sine of the heading, rotated by each arc.
        arc_m: arc length of the true anchor's foot on the path.
        advance_m: advance of the foot in the last step, to predict the next.
        servo: wheels and pending commands.
    """

    x_m: Float[Array, "..."]
    y_m: Float[Array, "..."]
    cos_yaw: Float[Array, "..."]
    sin_yaw: Float[Array, "..."]
    arc_m: Float[Array, "..."]
    advance_m: Float[Array, "..."]
    servo: ServoState


class RolloutTrace(NamedTuple):
    """Trace of a vehicle: its state at the beginning of each step, and the wheels at its end.

    Attributes:
        x_m, y_m, yaw_rad: pose of the rear axle.
        arc_m, offset_m: position of the anchor along the path, and offset from it, left positive.
        command_rad, front_rad: commanded and actual angle of the front wheels.
        reachable: whether the goal was reachable.
    """

    x_m: Float[Array, "step ..."]
    y_m: Float[Array, "step ..."]
    yaw_rad: Float[Array, "step ..."]
    arc_m: Float[Array, "step ..."]
    offset_m: Float[Array, "step ..."]
    command_rad: Float[Array, "step ..."]
    front_rad: Float[Array, "step ..."]
    reachable: Bool[Array, "step ..."]


def start_rollout(
    path: Path,
    lane: RolloutLane,
    arc_m: Float[Array, "..."],
    offset_m: Float[Array, "..."],
    heading_rad: Float[Array, "..."],
    *,
    delay_slots: int = 0,
) -> RolloutState:
    """A vehicle at rest near its path, wheels straight.

    Args:
        path: path to follow.
        lane: vehicle, whose true anchor is placed.
        arc_m: position along the path.
        offset_m: offset from the path, positive to the left.
        heading_rad: heading error, from the path's direction to the left.
        delay_slots: as in the spec.
    """
    foot = path_point(path, arc_m)
    turned_cos, turned_sin = jnp.cos(heading_rad), jnp.sin(heading_rad)
    cos, sin = foot.cos * turned_cos - foot.sin * turned_sin, foot.sin * turned_cos + foot.cos * turned_sin
    lead = lane.chassis.anchor_m
    x, y = foot.x_m - foot.sin * offset_m - lead * cos, foot.y_m + foot.cos * offset_m - lead * sin
    zero = jnp.zeros_like(x)
    return RolloutState(
        x_m=x,
        y_m=y,
        cos_yaw=cos,
        sin_yaw=sin,
        arc_m=arc_m + zero,
        advance_m=zero,
        servo=init_servo(zero, delay_slots=delay_slots),
    )


# The exact pursuit law as solved in a rollout: terms of the geometry are computed once, before the steps.
#
# The equation, the limits and the sense of ``reachable`` are those of ``steer_exact``. Lengths are in wheelbases,
# tangents are quotients of polynomials, and only the last Newton step has a gradient: at a root it equals that of the
# root.


class LaneLaw(NamedTuple):
    """The pursuit law of one vehicle.

    Attributes:
        rear: rear ratio, or measured map of the rear wheels.
        lead: distance of the anchor ahead of the rear axle, in wheelbases.
        loss: inverse of the feed-forward yaw gain.
        largest_rad: largest angle of the front wheels.
        slope_straight: dψ/dφ with straight wheels.
        left, right: wheels at the largest angle to either side.
    """

    rear: Rear
    lead: Float[Array, "..."]
    loss: Float[Array, "..."]
    largest_rad: Float[Array, "..."]
    slope_straight: Float[Array, "..."]
    left: "_Lock"
    right: "_Lock"


class _Lock(NamedTuple):
    """tan φ and tan ψ at a largest angle, and their slopes over φ."""

    front: Float[Array, "..."]
    rear: Float[Array, "..."]
    front_slope: Float[Array, "..."]
    rear_slope: Float[Array, "..."]


def prepare_law(chassis: Chassis, gain: Float[Array, "..."]) -> LaneLaw:
    """The law for a model of the chassis and its yaw gain."""
    largest = chassis.largest_angle_rad
    return LaneLaw(
        rear=chassis.rear,
        lead=chassis.anchor_m / chassis.wheelbase_m,
        loss=1.0 / gain,
        largest_rad=largest,
        slope_straight=rear_angle(chassis.rear, jnp.zeros_like(largest))[1],
        left=_lock(chassis.rear, largest),
        right=_lock(chassis.rear, -largest),
    )


def steer_lane(law: LaneLaw, ahead: Float[Array, "..."], left: Float[Array, "..."]) -> Steering:
    """Front angle that takes the anchor through a goal.

    Args:
        law: law from ``prepare_law``.
        ahead, left: goal from the anchor in the body frame, in wheelbases.
    """
    half_square = 0.5 * (ahead * ahead + left * left)
    front_arm = half_square + law.lead * ahead
    rear_arm = half_square + (law.lead - 1.0) * ahead
    wanted = left * law.loss
    largest = law.largest_rad
    lock = jnp.sign(left) * largest
    rise = front_arm + law.slope_straight * rear_arm
    # The closed form with the arc tangent's continued fraction, truncated early: a starting value is enough.
    ratio = wanted / jnp.where(rise > 0.0, rise, 1.0)
    square = ratio * ratio
    start = jnp.where(rise > 0.0, ratio * (15.0 + 4.0 * square) / (15.0 + 9.0 * square), lock)
    front = lax.stop_gradient(jnp.clip(start, -largest, largest))
    for last in (False,) * (NEWTON_STEPS - 1) + (True,):
        step = _newton_step(law.rear, front_arm, rear_arm, wanted, front)
        front = jnp.clip(front - (step if last else lax.stop_gradient(step)), -largest, largest)
    side = jnp.where(left < 0.0, -1.0, 1.0)
    most, slope = _at_lock(law, front_arm, rear_arm, left < 0.0)
    reachable = (rise > 0.0) & (slope > 0.0) & (side * wanted <= side * most)
    return Steering(jnp.where(reachable, front, lock), reachable)


def _newton_step(
    rear: Rear,
    front_arm: Float[Array, "..."],
    rear_arm: Float[Array, "..."],
    wanted: Float[Array, "..."],
    front_rad: Float[Array, "..."],
) -> Float[Array, "..."]:
    behind, slope = rear_angle(rear, front_rad)
    front_tangent, rear_tangent = tangent(front_rad), tangent(behind)
    value = front_arm * front_tangent + rear_arm * rear_tangent - wanted
    rise = front_arm * (1.0 + front_tangent * front_tangent) + rear_arm * (1.0 + rear_tangent * rear_tangent) * slope
    # The slope's own gradient would only move the iterate, not the root.
    rise = lax.stop_gradient(rise)
    return jnp.where(rise > 0.0, value / jnp.where(rise > 0.0, rise, 1.0), 0.0)


def _lock(rear: Rear, front_rad: Float[Array, "..."]) -> _Lock:
    behind, slope = rear_angle(rear, front_rad)
    front, follow = tangent(front_rad), tangent(behind)
    return _Lock(front, follow, 1.0 + front * front, (1.0 + follow * follow) * slope)


def _at_lock(
    law: LaneLaw, front_arm: Float[Array, "..."], rear_arm: Float[Array, "..."], right: Bool[Array, "..."]
) -> tuple[Float[Array, "..."], Float[Array, "..."]]:
    """Left side of the equation and its slope at the largest angle on the goal's side."""
    front, rear, front_slope, rear_slope = (
        jnp.where(right, at_right, at_left) for at_right, at_left in zip(law.right, law.left, strict=True)
    )
    return front_arm * front + rear_arm * rear, front_arm * front_slope + rear_arm * rear_slope


class _Prepared(NamedTuple):
    """Quantities of a vehicle that are constant over the steps."""

    law: LaneLaw
    ahead_m: Float[Array, "..."]
    way_m: Float[Array, "..."]
    gain: Float[Array, "..."]
    believed_gain: Float[Array, "..."]
    pace: ServoPace


@partial(jax.jit, static_argnums=0)
def roll_out(
    spec: RolloutSpec, path: Path, lane: RolloutLane, start: RolloutState
) -> tuple[RolloutState, RolloutMetrics]:
    """Roll out and return the final state and metrics.

    Gradients are taken through all steps, each recomputed in the backward pass so that only states are kept.

    Args:
        spec: static settings of all vehicles; a new one is compiled separately.
        path: path of all vehicles.
        lane: one vehicle, or many along a leading axis.
        start: state from ``start_rollout``, with the shape of ``lane``.

    Returns:
        State after the last step, and metrics over all steps.
    """
    (final, sums), _ = _run(spec, path, lane, start, traced=False)
    travel_m = jnp.abs(lane.speed_mps) * (spec.step_s * spec.steps) + jnp.zeros_like(start.x_m)
    return final, finish_metrics(sums, spec.steps, travel_m)


@partial(jax.jit, static_argnums=0)
def roll_out_traced(
    spec: RolloutSpec, path: Path, lane: RolloutLane, start: RolloutState
) -> tuple[RolloutState, RolloutMetrics, RolloutTrace]:
    """``roll_out`` with every step kept, for few vehicles."""
    (final, sums), trace = _run(spec, path, lane, start, traced=True)
    assert trace is not None
    travel_m = jnp.abs(lane.speed_mps) * (spec.step_s * spec.steps) + jnp.zeros_like(start.x_m)
    return final, finish_metrics(sums, spec.steps, travel_m), trace


def _run(
    spec: RolloutSpec, path: Path, lane: RolloutLane, start: RolloutState, *, traced: bool
) -> tuple[tuple[RolloutState, MetricSums], RolloutTrace | None]:
    fixed = _prepare(spec, lane)

    def step(
        carried: tuple[RolloutState, MetricSums], number: Float[Array, ""]
    ) -> tuple[tuple[RolloutState, MetricSums], RolloutTrace | None]:
        state, sums = carried
        after, seen = _step(spec, path, lane, fixed, state)
        # The remaining metres decide what is late: the last step always is.
        late = (spec.steps - number) * jnp.abs(fixed.way_m) < spec.tail_m
        travelled_m = number * jnp.abs(fixed.way_m)
        moved = jnp.abs(after.servo.wheel_rad - state.servo.wheel_rad)
        sums = step_metrics(sums, seen.offset_m, travelled_m, late, moved, seen.reachable, tolerance_m=spec.tolerance_m)
        return (after, sums), _trace(state, after, seen) if traced else None

    numbers = jnp.arange(1, spec.steps + 1, dtype=start.x_m.dtype)
    return lax.scan(jax.checkpoint(step, prevent_cse=False), (start, init_metrics(start.x_m)), numbers)


@partial(jax.jit, static_argnums=0)
def roll_out_logged(
    spec: RolloutSpec,
    path: Path,
    lane: RolloutLane,
    start: RolloutState,
    speed_mps: Float[Array, "step ..."],
    share: Float[Array, "step ..."],
) -> RolloutTrace:
    """Roll out with the logged speed and share of the servo's torque, and return every step.

    Args:
        spec, path, lane, start: as for ``roll_out``; the lane's speed and supply are not used.
        speed_mps, share: speed and torque share of every step.
    """

    def step(
        state: RolloutState, now: tuple[Float[Array, "..."], Float[Array, "..."]]
    ) -> tuple[RolloutState, RolloutTrace]:
        fixed = _prepare(spec, lane._replace(speed_mps=now[0]))
        fixed = fixed._replace(pace=servo_pace(lane.servo, now[1], spec.step_s))
        after, seen = _step(spec, path, lane._replace(speed_mps=now[0]), fixed, state)
        return after, _trace(state, after, seen)

    trace: RolloutTrace = lax.scan(step, start, (speed_mps, share))[1]
    return trace


class _Seen(NamedTuple):
    """Intermediate results of a step."""

    offset_m: Float[Array, "..."]
    command_rad: Float[Array, "..."]
    reachable: Bool[Array, "..."]


def _prepare(spec: RolloutSpec, lane: RolloutLane) -> _Prepared:
    believed_gain = yaw_gain(lane.believed.characteristic_speed_mps, lane.speed_mps)
    # When reversing, the goal is behind along the path.
    ahead = jnp.where(lane.speed_mps < 0.0, -1.0, 1.0) * look_ahead_m(lane.look_ahead, lane.speed_mps)
    return _Prepared(
        prepare_law(lane.believed, believed_gain),
        ahead,
        lane.speed_mps * spec.step_s,
        yaw_gain(lane.chassis.characteristic_speed_mps, lane.speed_mps),
        believed_gain,
        servo_pace(lane.servo, torque_share(lane.servo, lane.supply_v), spec.step_s),
    )


def _step(
    spec: RolloutSpec, path: Path, lane: RolloutLane, fixed: _Prepared, state: RolloutState
) -> tuple[RolloutState, _Seen]:
    lead = lane.chassis.anchor_m
    anchor_x, anchor_y = state.x_m + lead * state.cos_yaw, state.y_m + lead * state.sin_yaw
    foot = project(path, state.arc_m + state.advance_m, anchor_x, anchor_y)
    if spec.law == "stanley":
        steering = _steer_stanley(spec, path, lane, state, foot)
    else:
        goal = path_point(path, foot.arc_m + fixed.ahead_m)
        east, north = goal.x_m - anchor_x, goal.y_m - anchor_y
        # Quotients, for the same reason as in ``project``.
        base = lane.believed.wheelbase_m
        ahead = (east * state.cos_yaw + north * state.sin_yaw) / base
        left = (north * state.cos_yaw - east * state.sin_yaw) / base
        steering = _steer(spec, lane, fixed, ahead, left)
    servo = turn_servo(state.servo, fixed.pace, steering.front_rad)
    x, y, cos, sin = _drive(lane.chassis, state, servo.wheel_rad, fixed.way_m, fixed.gain)
    after = RolloutState(
        x_m=x, y_m=y, cos_yaw=cos, sin_yaw=sin, arc_m=foot.arc_m, advance_m=foot.arc_m - state.arc_m, servo=servo
    )
    return after, _Seen(foot.offset_m, steering.front_rad, steering.reachable)


def _steer(
    spec: RolloutSpec, lane: RolloutLane, fixed: _Prepared, ahead: Float[Array, "..."], left: Float[Array, "..."]
) -> Steering:
    if spec.law == "exact":
        return steer_lane(fixed.law, ahead, left)
    base = lane.believed.wheelbase_m
    front = steer_closed(lane.believed, ahead * base, left * base, fixed.believed_gain)
    return Steering(front, jnp.abs(front) < lane.believed.largest_angle_rad)


def _steer_stanley(spec: RolloutSpec, path: Path, lane: RolloutLane, state: RolloutState, foot: Projection) -> Steering:
    at = path_point(path, foot.arc_m)
    error = jnp.arctan2(
        at.sin * state.cos_yaw - at.cos * state.sin_yaw, at.cos * state.cos_yaw + at.sin * state.sin_yaw
    )
    front = steer_stanley(lane.believed, error, -foot.offset_m, lane.speed_mps, spec.stanley_gain_ps)
    return Steering(front, jnp.abs(front) < lane.believed.largest_angle_rad)


def _drive(
    chassis: Chassis,
    state: RolloutState,
    wheel_rad: Float[Array, "..."],
    way_m: Float[Array, "..."],
    gain: Float[Array, "..."],
) -> tuple[Float[Array, "..."], Float[Array, "..."], Float[Array, "..."], Float[Array, "..."]]:
    """``drive_arc`` with the heading as cosine and sine: position and heading after an arc of up to half a radian."""
    rear_tangent = tangent(rear_angle(chassis.rear, wheel_rad)[0])
    change = gain * (tangent(wheel_rad) + rear_tangent) / chassis.wheelbase_m * way_m
    square = change * change
    along = 1.0 - square / 6.0 * (1.0 - square / 20.0 * (1.0 - square / 42.0))
    aside = 0.5 * change * (1.0 - square / 12.0 * (1.0 - square / 30.0))
    drift = -gain * way_m * rear_tangent
    forward, left = along * way_m - aside * drift, aside * way_m + along * drift
    cos, sin = state.cos_yaw, state.sin_yaw
    turned_cos, turned_sin = 1.0 - aside * change, along * change
    new_cos, new_sin = cos * turned_cos - sin * turned_sin, sin * turned_cos + cos * turned_sin
    # One Newton step of 1/√: rounding would change the length of the heading over thousands of steps.
    unit = 1.5 - 0.5 * (new_cos * new_cos + new_sin * new_sin)
    return (
        state.x_m + cos * forward - sin * left,
        state.y_m + sin * forward + cos * left,
        new_cos * unit,
        new_sin * unit,
    )


def _trace(state: RolloutState, after: RolloutState, seen: _Seen) -> RolloutTrace:
    return RolloutTrace(
        x_m=state.x_m,
        y_m=state.y_m,
        yaw_rad=jnp.arctan2(state.sin_yaw, state.cos_yaw),
        arc_m=after.arc_m,
        offset_m=seen.offset_m,
        command_rad=seen.command_rad,
        front_rad=after.servo.wheel_rad,
        reachable=seen.reachable,
    )


# Many vehicles on the host: chunks of one shape, as many at once as there are cores, in turn on every device.

CHUNK = 8192
"""Vehicles in a chunk: a step's numbers fit a core's caches, and calls between the steps are few."""
CHUNK_ON_ACCELERATOR = 1 << 18
"""The same on an accelerator: enough for every step to fill it, 200 MB with inputs and results."""


def roll_out_many(
    spec: RolloutSpec, path: Path, lane: RolloutLane, start: RolloutState, *, chunk: int | None = None
) -> tuple[RolloutState, RolloutMetrics]:
    """``roll_out`` for any number of vehicles in bounded memory: inputs, outputs and a few chunks.

    Chunks are spread over all devices that JAX has.

    Args:
        spec: static settings of all vehicles.
        path: path of all vehicles.
        lane: fields with one value per vehicle, or scalars for all; a measured ψ(φ) is common to all.
        start: states with one value per vehicle.
        chunk: number of vehicles at once, which affects the time, not the result; by default suited to the device.

    Returns:
        Final states and metrics, NumPy arrays with one value per vehicle.
    """
    devices, count = jax.devices(), len(start.x_m)
    if chunk is None:
        chunk = CHUNK if devices[0].platform == "cpu" else CHUNK_ON_ACCELERATOR
    size = min(chunk, count)
    bounds = [(low, min(low + size, count)) for low in range(0, count, size)]
    # On the host once: a slice of an array on the device would be compiled for every start.
    host_lane, host_start = _map_lanes(np.asarray, lane), tree_map(np.asarray, start)

    def run(number: int) -> tuple[RolloutState, RolloutMetrics]:
        low, high = bounds[number]
        cut_lane = _map_lanes(lambda leaf: _cut(leaf, low, high, size), host_lane)
        cut_start = tree_map(lambda leaf: _cut(leaf, low, high, size), host_start)
        given = jax.device_put((path, cut_lane, cut_start), devices[number % len(devices)])
        done = jax.device_get(roll_out(spec, *given))
        found: tuple[RolloutState, RolloutMetrics] = tree_map(lambda leaf: leaf[..., : high - low], done)
        return found

    with ThreadPoolExecutor(max(usable_cores(), len(devices))) as pool:
        chunks = list(pool.map(run, range(len(bounds))))
    if len(chunks) == 1:
        return chunks[0]
    joined: tuple[RolloutState, RolloutMetrics] = tree_map(lambda *parts: np.concatenate(parts, axis=-1), *chunks)
    return joined


Leaf = Float[np.ndarray, "..."]


def _map_lanes(change: Callable[[Leaf], Leaf], lane: RolloutLane) -> RolloutLane:
    """Map over every field that may have one value per vehicle; a measured ψ(φ) has none."""

    def measured(node: object) -> bool:
        return isinstance(node, MeasuredRear)

    changed: RolloutLane = tree_map(lambda leaf: leaf if measured(leaf) else change(leaf), lane, is_leaf=measured)
    return changed


def _cut(values: Leaf, low: int, high: int, size: int) -> Leaf:
    """Vehicles from low to high, the last repeated up to the size; a scalar as it is. Vehicles are the last axis."""
    if values.ndim == 0:
        return values
    part = values[..., low:high]
    if high - low == size:
        return part
    return np.concatenate([part, np.repeat(part[..., -1:], size - (high - low), axis=-1)], axis=-1)
